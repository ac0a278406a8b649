//! The index of an MCAP file: which messages are where, without unpacking a chunk.
//!
//! The summary at the end of the file repeats schemas and channels and says where each chunk is;
//! behind each chunk stand the log times of its messages (mcap.dev/spec).

use crate::cursor::Cursor;
use crate::mcap_file::{Known, RECORD_BYTES_MAX};
use crate::part::Part;
use crate::stream::{Channels, Raw};
use mcap::MAGIC;
use mcap::records::op;
use std::io;
use std::ops::Range;
use std::os::unix::fs::FileExt as _;

/// Opcode and length of a record.
const HEAD_BYTES: u64 = 9;
/// Summary start, offset start and checksum.
const FOOTER_BYTES: u64 = 20;
/// Log time and offset of a message.
const ENTRY_BYTES: usize = 16;

/// A chunk, by the index.
pub(crate) struct Chunk {
    /// Its record.
    pub bytes: Range<u64>,
    /// The records with the times of its messages.
    times: Range<u64>,
}

/// The index of a file.
pub(crate) struct McapIndex {
    pub known: Known,
    pub chunks: Vec<Chunk>,
    /// Messages of all channels, as the statistics say.
    pub messages: u64,
}

impl McapIndex {
    /// Reads the summary of a file; its topics are noted. `None` if there is none, or if it does not
    /// hold what it should: then the file itself must be read.
    pub fn read(part: &Part, channels: &mut Channels) -> io::Result<Option<Self>> {
        let end_bytes = HEAD_BYTES + FOOTER_BYTES + MAGIC.len() as u64;
        let Some(end) = part.length.checked_sub(end_bytes) else { return Ok(None) };
        let tail = bytes(part, end..part.length)?;
        let (footer, magic) = tail.split_at((HEAD_BYTES + FOOTER_BYTES) as usize);
        let summary = u64::from_le_bytes(footer[9..17].try_into().unwrap_or_default());
        let is_footer = footer[0] == op::FOOTER && magic == MAGIC && summary > 0;
        if !is_footer || summary > end || end - summary > RECORD_BYTES_MAX as u64 {
            return Ok(None);
        }
        let summary = bytes(part, summary..end)?;
        let mut index = Self { known: Known::default(), chunks: Vec::new(), messages: 0 };
        let is_whole = index.take(&summary, part.length, channels).is_ok();
        Ok((is_whole && index.messages > 0).then_some(index))
    }

    /// The records of the summary.
    fn take(&mut self, summary: &[u8], length: u64, channels: &mut Channels) -> Result<(), String> {
        for (opcode, record) in Records(summary) {
            match opcode {
                op::SCHEMA | op::CHANNEL => {
                    self.known.take(opcode, record, channels, &mut Raw::default())?;
                }
                op::STATISTICS => self.messages = Cursor::packed(record).u64("the count")?,
                op::CHUNK_INDEX => self.chunks.push(chunk(record, length)?),
                _ => {}
            }
        }
        self.chunks.sort_by_key(|chunk| chunk.bytes.start);
        Ok(())
    }

    /// Hands the log time of every message with a scan to `take`, with its topic; returns how many
    /// messages of all topics the indexes hold. `None` if one of them makes no sense.
    pub fn times(&self, part: &Part, mut take: impl FnMut(usize, u64)) -> io::Result<Option<u64>> {
        let mut messages = 0;
        for chunk in &self.chunks {
            let times = bytes(part, chunk.times.clone())?;
            for (opcode, record) in Records(&times) {
                let [low, high, _, _, _, _, entries @ ..] = record else { return Ok(None) };
                let channel = u16::from_le_bytes([*low, *high]);
                let Some(scans) = self.known.channels.get(&channel) else { return Ok(None) };
                if opcode != op::MESSAGE_INDEX {
                    return Ok(None);
                }
                for entry in entries.chunks_exact(ENTRY_BYTES) {
                    messages += 1;
                    if let (Some((topic, _)), Some(time)) = (scans, entry.first_chunk()) {
                        take(*topic, u64::from_le_bytes(*time));
                    }
                }
            }
        }
        Ok(Some(messages))
    }
}

/// Where a chunk is, from the record of its index.
fn chunk(record: &[u8], length: u64) -> Result<Chunk, String> {
    let mut cursor = Cursor::packed(record);
    cursor.u64("its first time")?;
    cursor.u64("its last time")?;
    let (begin, bytes) = (cursor.u64("its begin")?, cursor.u64("its length")?);
    cursor.string("its message indexes")?; // a map is a length and bytes, as a string is
    let times_bytes = cursor.u64("the length of its message indexes")?;
    let end = begin.checked_add(bytes);
    let times_end = end.and_then(|end| end.checked_add(times_bytes));
    match (end, times_end) {
        (Some(end), Some(times_end))
            if times_end <= length && times_bytes <= RECORD_BYTES_MAX as u64 =>
        {
            Ok(Chunk { bytes: begin..end, times: end..times_end })
        }
        _ => Err("a chunk beyond the end of the file".to_owned()),
    }
}

/// Bytes of a file, which has them.
fn bytes(part: &Part, range: Range<u64>) -> io::Result<Vec<u8>> {
    let mut bytes = vec![0; (range.end - range.start) as usize];
    part.file.read_exact_at(&mut bytes, range.start)?;
    Ok(bytes)
}

/// The records in a row of bytes: opcode and content; ends where one is cut.
struct Records<'a>(&'a [u8]);

impl<'a> Iterator for Records<'a> {
    type Item = (u8, &'a [u8]);

    fn next(&mut self) -> Option<Self::Item> {
        let (head, rest) = self.0.split_first_chunk::<{ HEAD_BYTES as usize }>()?;
        let [opcode, length @ ..] = head;
        let length = usize::try_from(u64::from_le_bytes(*length)).ok()?;
        let (record, rest) = rest.split_at_checked(length)?;
        self.0 = rest;
        Some((*opcode, record))
    }
}
