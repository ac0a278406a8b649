//! What every message in shared memory begins with, and the promise that no padding byte crosses
//! a process: a header is `bytemuck::Pod`, which the compiler refuses for a type with padding.

use bytemuck::{Pod, Zeroable};

/// First field of every shared-memory header.
///
/// A reader counts losses by it: within one `session` the sequence grows by one a message.
/// A new session is a restarted publisher, not a loss.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Pod, Zeroable)]
pub struct Envelope {
    /// Grows by one a message, from 0, within a session.
    pub seq: u64,
    /// Names the run of the publisher: the UNIX nanoseconds of its start.
    pub session: u64,
    /// Index of the publisher among its kind in the site: laser index, area index.
    pub source: u32,
    /// Message specific bits; 0 if there are none.
    pub flags: u32,
    /// CLOCK_MONOTONIC at publication on this host, nanoseconds: for latency only, never for meaning.
    pub published_mono_ns: u64,
}

/// Bit of [`Envelope::flags`]: the publisher reached the end of its recording; the payload is empty.
pub const FLAG_END_OF_STREAM: u32 = 1;

/// A header of a message in shared memory.
pub trait Header: Pod + Default + Send + Sync + std::fmt::Debug + 'static {
    /// Stable name of the layout. **Bump the version on any change of the layout**: iceoryx2
    /// compares name and size only, so that swapped fields of one size would open happily.
    const TYPE_NAME: &'static str;

    /// The common first field.
    fn envelope(&self) -> &Envelope;
    /// The common first field, to be filled by the port that publishes.
    fn envelope_mut(&mut self) -> &mut Envelope;
}

/// Implements [`Header`] for a struct whose first field is `envelope`, and asserts at compile
/// time that the size of the struct is the sum that is stated.
macro_rules! header {
    ($type:ty, $name:literal, $size:expr) => {
        impl crate::wire::Header for $type {
            const TYPE_NAME: &'static str = $name;
            fn envelope(&self) -> &crate::wire::Envelope {
                &self.envelope
            }
            fn envelope_mut(&mut self) -> &mut crate::wire::Envelope {
                &mut self.envelope
            }
        }
        const _: () = assert!(std::mem::size_of::<$type>() == $size);
        const _: () = assert!(std::mem::align_of::<$type>() == 8);
        const _: () = assert!(std::mem::offset_of!($type, envelope) == 0);
    };
}
pub(crate) use header;

/// Bytes of the [`Envelope`].
pub const ENVELOPE_BYTES: usize = 32;
const _: () = assert!(size_of::<Envelope>() == ENVELOPE_BYTES);

/// Header of messages whose payload is an encoded byte string (see `codec`): health, events.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Pod, Zeroable)]
pub struct BytesHeader {
    /// Common part.
    pub envelope: Envelope,
}
header!(BytesHeader, "tog.BytesHeader.v1", ENVELOPE_BYTES);
