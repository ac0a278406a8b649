//! Schemas and channels of a recording of ours once more, outside its chunks.
//!
//! The crate `mcap` writes a definition once, into the first chunk of the file, and a chunk that is
//! damaged would take those of the whole file along. So a private record (MCAP lets programs have
//! those; others pass over them) repeats them now and then: a checksum and the records as they
//! stand in the chunk. Recovery looks for them there, and in the index of a complete file.

use crate::cursor::Cursor;
use crate::mcap_records::{Next, body, next_known, place_at};
use mcap::records::op;
use std::collections::BTreeMap;
use std::fs::File;
use std::io;
use std::os::unix::fs::FileExt;
use std::sync::Arc;

/// The private record.
pub(crate) const DEFINITIONS_OPCODE: u8 = 0xd7;
/// What it begins with: others have private records of this number too.
const TITLE: &[u8; 8] = b"tog.defs";
/// A definition is written again behind so many bytes: whatever a spot of this size destroys, the
/// definitions survive it.
pub(crate) const REPEAT_BYTES: u64 = 4 << 20;
/// Most bytes of all definitions of a file: those of a whole robot are some megabytes.
pub(crate) const DEFINITIONS_BYTES_MAX: usize = 64 << 20;
/// Footer and magic, at the very end of a complete file.
const TAIL_BYTES: usize = 9 + 20 + 8;

/// The definitions of a file that is being written.
#[derive(Debug, Default)]
pub(crate) struct Definitions {
    records: Vec<u8>,
    /// Length of the file when they were written last; `None` if there are new ones.
    written_at: Option<u64>,
}

impl Definitions {
    /// Takes note of a schema or channel.
    pub fn add(&mut self, opcode: u8, record: &[u8]) {
        self.records.push(opcode);
        self.records.extend_from_slice(&(record.len() as u64).to_le_bytes());
        self.records.extend_from_slice(record);
        self.written_at = None;
    }

    /// The private record, if it is due in a file of `length` bytes.
    pub fn due(&mut self, length: u64) -> Option<Vec<u8>> {
        let is_fresh = |at: u64| length.saturating_sub(at) < REPEAT_BYTES;
        if self.records.is_empty() || self.written_at.is_some_and(is_fresh) {
            return None;
        }
        self.written_at = Some(length);
        let mut record = TITLE.to_vec();
        record.extend_from_slice(&checksum(&self.records).to_le_bytes());
        record.extend_from_slice(&self.records);
        Some(record)
    }
}

/// The length of the private record whose head these bytes begin with, if they do.
pub(crate) fn definitions_length(bytes: &[u8]) -> Option<u64> {
    let (length, rest) = bytes.get(1..)?.split_first_chunk::<8>()?;
    rest.starts_with(TITLE).then_some(u64::from_le_bytes(*length))
}

fn checksum(bytes: &[u8]) -> u32 {
    let mut crc = flate2::Crc::new();
    crc.update(bytes);
    crc.sum()
}

/// A schema as it lies in a file.
pub(crate) fn schema_record(id: u16, name: &str, encoding: &str, data: &[u8]) -> Vec<u8> {
    let mut record = id.to_le_bytes().to_vec();
    put(&mut record, name.as_bytes());
    put(&mut record, encoding.as_bytes());
    put(&mut record, data);
    record
}

/// A channel as it lies in a file.
pub(crate) fn channel_record(
    id: u16,
    schema: u16,
    topic: &str,
    encoding: &str,
    notes: &BTreeMap<String, String>,
) -> Vec<u8> {
    let mut record = [id.to_le_bytes(), schema.to_le_bytes()].concat();
    put(&mut record, topic.as_bytes());
    put(&mut record, encoding.as_bytes());
    let mut map = Vec::new();
    for (key, value) in notes {
        put(&mut map, key.as_bytes());
        put(&mut map, value.as_bytes());
    }
    put(&mut record, &map);
    record
}

fn put(record: &mut Vec<u8>, bytes: &[u8]) {
    // Of topics and definitions of ours; what others wrote was read with such a length.
    record.extend_from_slice(&u32::try_from(bytes.len()).unwrap_or(u32::MAX).to_le_bytes());
    record.extend_from_slice(bytes);
}

/// Definitions that stand outside the chunks of a file: records by their number.
#[derive(Debug, Default)]
pub(crate) struct Found {
    pub schemas: BTreeMap<u16, Vec<u8>>,
    pub channels: BTreeMap<u16, Vec<u8>>,
    bytes: usize,
}

impl Found {
    /// Looks through a file, past damaged parts; the first definition of a number counts.
    pub fn look(file: &Arc<File>, length: u64) -> io::Result<Self> {
        let mut found = Self::default();
        found.walk(file, crate::format::MCAP_MAGIC.len() as u64, length)?;
        if let Some(summary) = summary_at(file, length)? {
            found.walk(file, summary, length)?;
        }
        Ok(found)
    }

    fn walk(&mut self, file: &Arc<File>, begin: u64, length: u64) -> io::Result<()> {
        let (mut offset, mut bytes) = (begin, Vec::new());
        loop {
            let place = match place_at(file, offset, length)? {
                Next::Record(place) if place.opcode == op::FOOTER => return Ok(()),
                Next::Record(place) => place,
                Next::Cut | Next::Garbage => match next_known(file, offset + 1, length)? {
                    Some(chunk) => {
                        offset = chunk;
                        continue;
                    }
                    None => return Ok(()),
                },
            };
            let is_wanted = matches!(place.opcode, op::SCHEMA | op::CHANNEL | DEFINITIONS_OPCODE);
            // One that cannot be read is damaged: there may be others.
            if is_wanted && body(file, place, &mut bytes).is_ok() {
                match place.opcode {
                    DEFINITIONS_OPCODE => self.take_all(&bytes),
                    opcode => self.take(opcode, &bytes),
                }
            }
            offset = place.end();
        }
    }

    /// Takes a private record of ours, if it is whole.
    fn take_all(&mut self, record: &[u8]) {
        let Some(([a, b, c, d], records)) =
            record.strip_prefix(TITLE).and_then(<[u8]>::split_first_chunk::<4>)
        else {
            return;
        };
        if u32::from_le_bytes([*a, *b, *c, *d]) != checksum(records) {
            return;
        }
        let mut cursor = Cursor::packed(records);
        while cursor.left() > 0 {
            let [opcode] = cursor.slice(1, "opcode").unwrap_or_default() else { return };
            let length = cursor.u64("length").unwrap_or(u64::MAX);
            let length = usize::try_from(length).unwrap_or(usize::MAX);
            let Ok(body) = cursor.slice(length, "a definition") else { return };
            self.take(*opcode, body);
        }
    }

    fn take(&mut self, opcode: u8, record: &[u8]) {
        let Some((id, _)) = record.split_first_chunk::<2>() else { return };
        let of_kind = match opcode {
            op::SCHEMA => &mut self.schemas,
            op::CHANNEL => &mut self.channels,
            _ => return,
        };
        let id = u16::from_le_bytes(*id);
        let is_room = self.bytes + record.len() <= DEFINITIONS_BYTES_MAX;
        if is_room && !of_kind.contains_key(&id) {
            self.bytes += record.len();
            of_kind.insert(id, record.to_vec());
        }
    }
}

/// Where the index of a complete file begins.
fn summary_at(file: &File, length: u64) -> io::Result<Option<u64>> {
    let Some(at) = length.checked_sub(TAIL_BYTES as u64) else { return Ok(None) };
    let mut tail = [0; TAIL_BYTES];
    file.read_exact_at(&mut tail, at)?;
    if tail[0] != op::FOOTER || !tail.ends_with(crate::format::MCAP_MAGIC) {
        return Ok(None);
    }
    let begin = Cursor::packed(&tail[9..17]).u64("the begin of the index").unwrap_or(0);
    Ok(Some(begin).filter(|begin| (8..at).contains(begin)))
}
