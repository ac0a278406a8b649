#![no_main]
//! Bytes of a stranger as a `LaserScan`.

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| fuzz::message::<protocol::scan::LaserScan>(bytes));
