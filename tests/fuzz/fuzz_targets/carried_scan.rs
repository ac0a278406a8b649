#![no_main]
//! Bytes of a stranger as a `CarriedScan`.

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| fuzz::message::<protocol::link::CarriedScan>(bytes));
