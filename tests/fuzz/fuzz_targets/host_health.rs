#![no_main]
//! Bytes of a stranger as HostHealth.

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| fuzz::message::<protocol::link::HostHealth>(bytes));
