//! The system as its users meet it: the real binary, real processes, real files.
#![allow(missing_docs, clippy::unwrap_used)]

#[allow(dead_code)] // each room uses what it needs
mod harness;
mod pipeline;
mod system;
