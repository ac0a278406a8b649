//! A message as CDR, little endian, with its encapsulation header.

use byteorder::LittleEndian;
use serde::Serialize;

/// CDR, little endian (DDS-XTypes 1.3, table 60).
const CDR_LITTLE_ENDIAN: [u8; 4] = [0, 1, 0, 0];

/// A message that CDR cannot hold.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("the message cannot be encoded: {reason}")]
pub struct EncodeError {
    /// What the encoder said.
    pub reason: String,
}

/// Puts a message into `buffer`, which is emptied before. `size_hint` is about how long it will be,
/// bytes.
///
/// # Errors
/// If a string or a sequence is longer than CDR can say (2^32).
pub fn encode<M: Serialize>(
    message: &M,
    size_hint: usize,
    buffer: &mut Vec<u8>,
) -> Result<(), EncodeError> {
    buffer.clear();
    buffer.extend_from_slice(&CDR_LITTLE_ENDIAN);
    let body = cdr_encoding::to_vec_with_size_hint::<_, LittleEndian>(message, size_hint)
        .map_err(|error| EncodeError { reason: error.to_string() })?;
    buffer.extend_from_slice(&body);
    Ok(())
}
