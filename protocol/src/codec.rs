//! The versioned envelope of everything that is encoded as bytes: for the network, the journal and
//! the messages of variable length in shared memory.
//!
//! Layout: magic `T` `G` (2 bytes), kind (u8), version (u8), body length (u32, little endian), body
//! (postcard). A decoder never panics, never allocates more than about 1 MiB ahead of what it has
//! read, and refuses what it does not know. A change of a struct that postcard would read
//! differently takes a new version.

use crate::carried::{CarriedCounts, CarriedMap};
use crate::event::{EventAcknowledgement, EventChange};
use crate::health::Health;
use crate::link::{CarriedScan, Claims, EventPage, FilePage, HostHealth};
use crate::ownership::Ownership;
use crate::scan::LaserScan;
use serde::Serialize;
use serde::de::DeserializeOwned;

/// Bytes before the body.
pub const ENVELOPE_BYTES: usize = 8;
/// Largest body: a scan of `BEAMS_MAX` f32 beams is 20 kB, a health message a few kB; 1 MiB leaves
/// room for frames of the network and is small enough to allocate for a stranger.
pub const BODY_BYTES_MAX: usize = 1 << 20;
const MAGIC: [u8; 2] = *b"TG";

/// A message that has an envelope.
pub trait Encoded: Serialize + DeserializeOwned {
    /// Number of the kind, never reused.
    const KIND: u8;
    /// Version of the body.
    const VERSION: u8;
    /// Name for errors.
    const NAME: &'static str;

    /// About how many bytes the body takes, or more: so that encoding does not ask for memory again and
    /// again where data is in a hurry.
    fn body_bytes_hint(&self) -> usize {
        256
    }

    /// Bounds that serde cannot express.
    ///
    /// # Errors
    /// A sentence with what was found and what was expected.
    fn check(&self) -> Result<(), String> {
        Ok(())
    }
}

/// Why bytes were refused.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum DecodeError {
    /// Fewer bytes than an envelope, or than the envelope says.
    #[error("{name}: message is cut: found {found} bytes, expected {expected}")]
    Cut {
        /// Message type.
        name: &'static str,
        /// Bytes that are there.
        found: usize,
        /// Bytes that should be.
        expected: usize,
    },
    /// Bytes after the body.
    #[error("{name}: {surplus} bytes follow the end of the message")]
    Surplus {
        /// Message type.
        name: &'static str,
        /// How many.
        surplus: usize,
    },
    /// Not ours.
    #[error("{name}: found magic {found:?}, expected {MAGIC:?}: these bytes are not a tog message")]
    Magic {
        /// Message type.
        name: &'static str,
        /// The first two bytes.
        found: [u8; 2],
    },
    /// Another message.
    #[error("{name}: found message kind {found}, expected {expected}")]
    Kind {
        /// Message type.
        name: &'static str,
        /// Kind in the envelope.
        found: u8,
        /// Kind asked for.
        expected: u8,
    },
    /// Another version.
    #[error("{name}: found version {found}, this tog reads {expected}: update the older host")]
    Version {
        /// Message type.
        name: &'static str,
        /// Version in the envelope.
        found: u8,
        /// Version that is read here.
        expected: u8,
    },
    /// Larger than any message.
    #[error("{name}: body of {found} bytes, at most {BODY_BYTES_MAX} are read")]
    TooLarge {
        /// Message type.
        name: &'static str,
        /// Length in the envelope.
        found: usize,
    },
    /// The body is not what it says.
    #[error("{name}: body is damaged: {reason}")]
    Body {
        /// Message type.
        name: &'static str,
        /// What was found.
        reason: String,
    },
}

/// Encodes a message with its envelope.
///
/// # Errors
/// If the body is larger than [`BODY_BYTES_MAX`] or breaks the message's own bounds.
pub fn encode<M: Encoded>(message: &M) -> Result<Vec<u8>, DecodeError> {
    let body = |reason| DecodeError::Body { name: M::NAME, reason };
    message.check().map_err(body)?;
    let mut bytes = Vec::with_capacity(ENVELOPE_BYTES + message.body_bytes_hint());
    bytes.extend_from_slice(&[MAGIC[0], MAGIC[1], M::KIND, M::VERSION, 0, 0, 0, 0]);
    bytes = postcard::to_extend(message, bytes).map_err(|error| body(error.to_string()))?;
    let length = bytes.len() - ENVELOPE_BYTES;
    if length > BODY_BYTES_MAX {
        return Err(DecodeError::TooLarge { name: M::NAME, found: length });
    }
    bytes[4..8].copy_from_slice(&(length as u32).to_le_bytes());
    Ok(bytes)
}

/// Decodes a message that fills `bytes` exactly.
///
/// # Errors
/// See [`DecodeError`]; never panics, whatever the bytes.
pub fn decode<M: Encoded>(bytes: &[u8]) -> Result<M, DecodeError> {
    let name = M::NAME;
    let Some((head, body)) = bytes.split_first_chunk::<ENVELOPE_BYTES>() else {
        return Err(DecodeError::Cut { name, found: bytes.len(), expected: ENVELOPE_BYTES });
    };
    let [m0, m1, kind, version, l0, l1, l2, l3] = *head;
    if [m0, m1] != MAGIC {
        return Err(DecodeError::Magic { name, found: [m0, m1] });
    }
    if kind != M::KIND {
        return Err(DecodeError::Kind { name, found: kind, expected: M::KIND });
    }
    if version != M::VERSION {
        return Err(DecodeError::Version { name, found: version, expected: M::VERSION });
    }
    let length = u32::from_le_bytes([l0, l1, l2, l3]) as usize;
    if length > BODY_BYTES_MAX {
        return Err(DecodeError::TooLarge { name, found: length });
    }
    if body.len() < length {
        return Err(DecodeError::Cut { name, found: body.len(), expected: length });
    }
    if body.len() > length {
        return Err(DecodeError::Surplus { name, surplus: body.len() - length });
    }
    let damaged = |reason| DecodeError::Body { name, reason };
    let (message, rest) =
        postcard::take_from_bytes::<M>(body).map_err(|error| damaged(error.to_string()))?;
    if !rest.is_empty() {
        return Err(damaged(format!("{} bytes of the body are left over", rest.len())));
    }
    message.check().map_err(damaged)?;
    Ok(message)
}

impl Encoded for LaserScan {
    const KIND: u8 = 1;
    const VERSION: u8 = 1;
    const NAME: &'static str = "LaserScan";

    fn check(&self) -> Result<(), String> {
        if self.ranges_m.len() > crate::scan::BEAMS_MAX {
            return Err(format!(
                "{} beams, expected at most {}",
                self.ranges_m.len(),
                crate::scan::BEAMS_MAX
            ));
        }
        self.geometry.check()
    }
}

impl Encoded for EventChange {
    const KIND: u8 = 2;
    const VERSION: u8 = 1;
    const NAME: &'static str = "EventChange";

    fn check(&self) -> Result<(), String> {
        if self.text.len() > crate::event::TEXT_BYTES_MAX {
            return Err(format!(
                "a text of {} bytes, expected at most {}",
                self.text.len(),
                crate::event::TEXT_BYTES_MAX
            ));
        }
        let numbers = [self.x_m, self.y_m, self.score, self.threshold];
        if !numbers.iter().chain(&self.bounds_m).all(|value| value.is_finite()) {
            return Err("a number that is not finite".to_owned());
        }
        Ok(())
    }
}

impl Encoded for EventAcknowledgement {
    const KIND: u8 = 3;
    const VERSION: u8 = 1;
    const NAME: &'static str = "EventAcknowledgement";
}

impl Encoded for Health {
    const KIND: u8 = 4;
    const VERSION: u8 = 1;
    const NAME: &'static str = "Health";
}

impl Encoded for CarriedScan {
    const KIND: u8 = 5;
    const VERSION: u8 = 2;
    const NAME: &'static str = "CarriedScan";

    fn body_bytes_hint(&self) -> usize {
        self.laser.len() + self.scan.as_ref().map_or(0, |scan| 4 * scan.ranges_m.len()) + 96
    }

    fn check(&self) -> Result<(), String> {
        self.scan.as_ref().map_or(Ok(()), LaserScan::check)
    }
}

impl Encoded for EventPage {
    const KIND: u8 = 6;
    const VERSION: u8 = 2;
    const NAME: &'static str = "EventPage";

    fn check(&self) -> Result<(), String> {
        self.check_order()?;
        self.rows.iter().try_for_each(|row| {
            row.change.check()?;
            row.change.check_fields()
        })
    }
}

impl Encoded for Claims {
    const KIND: u8 = 7;
    const VERSION: u8 = 1;
    const NAME: &'static str = "Claims";

    fn check(&self) -> Result<(), String> {
        self.check_bounds()
    }
}

impl Encoded for FilePage {
    const KIND: u8 = 8;
    const VERSION: u8 = 1;
    const NAME: &'static str = "FilePage";

    fn check(&self) -> Result<(), String> {
        self.check_extent()
    }
}

impl Encoded for Ownership {
    const KIND: u8 = 9;
    const VERSION: u8 = 1;
    const NAME: &'static str = "Ownership";
}

impl Encoded for HostHealth {
    const KIND: u8 = 10;
    const VERSION: u8 = 1;
    const NAME: &'static str = "HostHealth";
}

impl Encoded for CarriedMap {
    const KIND: u8 = 11;
    const VERSION: u8 = 1;
    const NAME: &'static str = "CarriedMap";

    fn check(&self) -> Result<(), String> {
        self.check_lengths()
    }
}

impl Encoded for CarriedCounts {
    const KIND: u8 = 12;
    const VERSION: u8 = 1;
    const NAME: &'static str = "CarriedCounts";

    fn check(&self) -> Result<(), String> {
        self.check_extent()
    }
}
