#![no_main]
//! Bytes of a stranger as an `EventPage`.

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| fuzz::message::<protocol::link::EventPage>(bytes));
