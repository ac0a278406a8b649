#![no_main]
//! Bytes of a stranger as Claims.

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| fuzz::message::<protocol::link::Claims>(bytes));
