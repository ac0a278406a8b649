#![no_main]
//! Bytes of a stranger as FilePage.

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| fuzz::message::<protocol::link::FilePage>(bytes));
