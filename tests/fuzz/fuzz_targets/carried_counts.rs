#![no_main]
//! Bytes of a stranger as CarriedCounts.

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| fuzz::message::<protocol::carried::CarriedCounts>(bytes));
