#![no_main]
//! Bytes of a stranger as a `EventAcknowledgement`.

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| fuzz::message::<protocol::event::EventAcknowledgement>(bytes));
