//! A record of a ROS bag, versions 1.2 and 2.0: length and header of `name=value` fields, length
//! and data; all numbers little endian (wiki.ros.org/Bags/Format).

use crate::stream::StreamEnd;
use std::io::{self, Read};

/// Longest description of a topic: the text of the largest message definitions is about 30 kB.
pub(crate) const CONNECTION_BYTES_MAX: usize = 1 << 20;
/// Most connections: a recording of a whole robot has a few hundred.
pub(crate) const CONNECTIONS_MAX: usize = 65_536;

/// Why a record could not be read.
pub(crate) enum Fault {
    /// The bytes end in the middle of it.
    Short,
    Bad(String),
    Io(io::Error),
}

impl Fault {
    /// A fault in the record that begins at byte `offset` of the file.
    pub fn in_record_at(self, offset: u64) -> StreamEnd {
        match self {
            Self::Short => StreamEnd::Cut {
                offset,
                reason: "the file ends in the middle of the record that begins here".to_owned(),
            },
            Self::Bad(reason) => StreamEnd::Damaged { offset, reason },
            Self::Io(source) => StreamEnd::Io(source),
        }
    }
}

impl From<io::Error> for Fault {
    fn from(error: io::Error) -> Self {
        if error.kind() == io::ErrorKind::UnexpectedEof { Self::Short } else { Self::Io(error) }
    }
}

/// Four bytes, little endian.
fn read_u32(reader: &mut impl Read) -> Result<u32, Fault> {
    let mut bytes = [0; 4];
    reader.read_exact(&mut bytes)?;
    Ok(u32::from_le_bytes(bytes))
}

/// The header of a record, behind its length; `bytes_max` says how long it may be.
fn read_head(reader: &mut impl Read, head: &mut Vec<u8>, bytes_max: usize) -> Result<(), Fault> {
    let length = read_u32(reader)? as usize;
    if length > bytes_max {
        return Err(Fault::Bad(format!(
            "a record header of {length} bytes, expected at most {bytes_max}"
        )));
    }
    head.resize(length, 0);
    reader.read_exact(head)?;
    Ok(())
}

/// The begin of a record: its header into `head`; returns how long its data is and how many bytes
/// were read so far.
pub(crate) fn read_begin(
    reader: &mut impl Read,
    head: &mut Vec<u8>,
    bytes_max: usize,
) -> Result<(u64, u64), Fault> {
    read_head(reader, head, bytes_max)?;
    let data_length = u64::from(read_u32(reader)?);
    Ok((data_length, 8 + head.len() as u64))
}

/// The value of a field of a record header.
pub(crate) fn field<'a>(mut head: &'a [u8], name: &[u8]) -> Result<&'a [u8], Fault> {
    let text = name.escape_ascii();
    while let Some((length, rest)) = head.split_first_chunk::<4>() {
        let length = u32::from_le_bytes(*length) as usize;
        if length > rest.len() {
            return Err(Fault::Bad(format!(
                "a header field of {length} bytes where {} are left",
                rest.len()
            )));
        }
        let (entry, behind) = rest.split_at(length);
        if let Some(value) = entry.strip_prefix(name).and_then(|rest| rest.strip_prefix(b"=")) {
            return Ok(value);
        }
        head = behind;
    }
    Err(Fault::Bad(format!("a record without the field \"{text}\"")))
}

/// A value that must have `N` bytes.
pub(crate) fn sized<const N: usize>(value: &[u8], name: &[u8]) -> Result<[u8; N], Fault> {
    value.try_into().map_err(|_| {
        let (name, length) = (name.escape_ascii(), value.len());
        Fault::Bad(format!("field \"{name}\" has {length} bytes, expected {N}"))
    })
}

/// What kind of record it is.
pub(crate) fn field_op(head: &[u8]) -> Result<u8, Fault> {
    sized::<1>(field(head, b"op")?, b"op").map(|[op]| op)
}

/// A value of four bytes.
pub(crate) fn field_u32(head: &[u8], name: &[u8]) -> Result<u32, Fault> {
    Ok(u32::from_le_bytes(sized(field(head, name)?, name)?))
}

/// Seconds and nanoseconds of a record to nanoseconds.
pub(crate) fn time_ns(seconds: u32, nanoseconds: u32) -> u64 {
    u64::from(seconds) * protocol::time::SECOND_NS + u64::from(nanoseconds)
}
