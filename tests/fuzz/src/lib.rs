//! What every target of a message does with the bytes that the fuzzer made.

use protocol::codec::{Encoded, decode, encode};

/// Decodes the bytes as they are, and as the body behind a right envelope. Whatever is accepted can
/// be encoded, and what was encoded decodes to the same bytes.
///
/// # Panics
/// If a message that was accepted does not survive the wire: that is what the fuzzer looks for.
pub fn message<M: Encoded>(bytes: &[u8]) {
    check::<M>(bytes);
    let mut framed = vec![b'T', b'G', M::KIND, M::VERSION];
    framed.extend((bytes.len() as u32).to_le_bytes());
    framed.extend(bytes);
    check::<M>(&framed);
}

fn check<M: Encoded>(bytes: &[u8]) {
    let Ok(message) = decode::<M>(bytes) else { return };
    let encoded = encode(&message).expect("an accepted message can be encoded");
    let again = decode::<M>(&encoded).expect("an encoded message can be decoded");
    assert_eq!(encode(&again).as_ref(), Ok(&encoded));
}
