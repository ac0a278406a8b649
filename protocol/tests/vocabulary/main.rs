//! Tests of the vocabulary from outside: layouts, bytes on the wire, the site file.
#![allow(clippy::unwrap_used)]

mod broken;
mod broken_areas;
mod broken_hosts;
mod broken_keys;
mod broken_lasers;
mod broken_recorder;
mod broken_values;
mod codec;
mod deploy;
mod layout;
mod samples;
mod site_properties;
mod wire_format;
