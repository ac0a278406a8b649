#![no_main]
//! Bytes of a stranger as a `Health`.

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| fuzz::message::<protocol::health::Health>(bytes));
