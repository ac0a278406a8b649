//! Records of an MCAP file as they lie in it, one behind the other: opcode, length, body.
//!
//! For what needs more than the scans, front to back: recovery, and the index at the end. Chunks
//! are unpacked by the crate `mcap`, and only after their checksum was found right.

use crate::mcap_file::{RECORD_BYTES_MAX, words};
use crate::section::Section;
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};
use std::fs::File;
use std::io::{self, Read};
use std::sync::Arc;

/// Opcode and length.
const HEAD_BYTES: u64 = 9;

/// Where a record begins, what it is, and how long its body is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Place {
    pub offset: u64,
    pub opcode: u8,
    pub length: u64,
}

impl Place {
    /// Where the next record begins.
    pub fn end(&self) -> u64 {
        self.offset + HEAD_BYTES + self.length
    }
}

/// What follows in a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Next {
    Record(Place),
    /// The file ends within a record.
    Cut,
    /// These bytes are no record.
    Garbage,
}

/// The record at `offset` of a file of `length` bytes.
pub(crate) fn place_at(file: &Arc<File>, offset: u64, length: u64) -> io::Result<Next> {
    let left = length.saturating_sub(offset);
    if left == 0 {
        return Ok(Next::Cut);
    }
    let mut head = [0; HEAD_BYTES as usize];
    let there = head.len().min(usize::try_from(left).unwrap_or(usize::MAX));
    Section::new(Arc::clone(file), offset, offset + there as u64).read_exact(&mut head[..there])?;
    let [opcode, length_bytes @ ..] = head;
    if opcode == 0 {
        return Ok(Next::Garbage); // no record has it: a hole in the file, mostly
    }
    let body = u64::from_le_bytes(length_bytes);
    if left < HEAD_BYTES || body > left - HEAD_BYTES {
        return Ok(Next::Cut);
    }
    Ok(Next::Record(Place { offset, opcode, length: body }))
}

/// The body of a record.
pub(crate) fn body(file: &Arc<File>, place: Place, body: &mut Vec<u8>) -> Result<(), String> {
    let length = usize::try_from(place.length).unwrap_or(usize::MAX);
    if length > RECORD_BYTES_MAX {
        return Err(format!("a record of {length} bytes, expected at most {RECORD_BYTES_MAX}"));
    }
    body.resize(length, 0);
    Section::new(Arc::clone(file), place.offset + HEAD_BYTES, place.end())
        .read_exact(body)
        .map_err(|error| error.to_string())
}

/// Unpacks a chunk and hands out its records; none of them if its checksum is wrong (a chunk
/// without one is handed out as far as it can be unpacked).
pub(crate) fn unpack(
    file: &Arc<File>,
    chunk: Place,
    mut take: impl FnMut(u8, &[u8]) -> io::Result<()>,
) -> io::Result<Result<(), String>> {
    let options = LinearReaderOptions::default()
        .with_skip_start_magic(true)
        .with_skip_end_magic(true)
        .with_prevalidate_chunk_crcs(true)
        .with_record_length_limit(RECORD_BYTES_MAX);
    let mut records = LinearReader::new_with_options(options);
    let mut section = Section::new(Arc::clone(file), chunk.offset, chunk.end());
    loop {
        let want = match records.next_event() {
            None => return Ok(Ok(())),
            Some(Ok(LinearReadEvent::ReadRequest(want))) => want,
            Some(Ok(LinearReadEvent::Record { opcode, data })) => {
                take(opcode, data)?;
                continue;
            }
            Some(Err(error)) => return Ok(Err(words(&error))),
        };
        let got = loop {
            match section.read(records.insert(want)) {
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                got => break got?,
            }
        };
        records.notify_read(got);
    }
}
