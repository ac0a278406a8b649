#![no_main]
//! Bytes of a stranger as CarriedMap.

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| fuzz::message::<protocol::carried::CarriedMap>(bytes));
