//! Records of an MCAP file as they lie in it, one behind the other: opcode, length, body.
//!
//! For what needs more than the scans, front to back: recovery, and the index at the end. Chunks
//! are unpacked by the crate `mcap`, and only after their checksum was found right.

use crate::cursor::Cursor;
use crate::definitions::{DEFINITIONS_OPCODE, definitions_length};
use crate::mcap_file::{RECORD_BYTES_MAX, words};
use crate::section::Section;
use mcap::records::op;
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};
use std::fs::File;
use std::io::{self, Read};
use std::sync::Arc;

/// Opcode and length.
const HEAD_BYTES: u64 = 9;
/// Head of a chunk, up to its records: its compression has four letters at most.
const CHUNK_HEAD_BYTES_MAX: usize = 9 + 8 + 8 + 8 + 4 + 4 + 4 + 8;
/// So much is looked through at once for the next chunk.
const WINDOW_BYTES: usize = 256 * 1024;

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

/// Where the next chunk begins at `from` or behind it, past bytes that are no records (told by a
/// head whose lengths fit each other), or the next definitions of ours.
pub(crate) fn next_known(file: &Arc<File>, from: u64, length: u64) -> io::Result<Option<u64>> {
    let mut window = vec![0; WINDOW_BYTES];
    let mut begin = from;
    while begin < length {
        let left = usize::try_from(length - begin).unwrap_or(usize::MAX);
        let there = WINDOW_BYTES.min(left);
        Section::new(Arc::clone(file), begin, length).read_exact(&mut window[..there])?;
        let seen = &window[..there];
        let is_known = |at: &usize| {
            let body = match seen[*at] {
                op::CHUNK => chunk_length(&seen[*at..]),
                DEFINITIONS_OPCODE => definitions_length(&seen[*at..]),
                _ => None,
            };
            let left = (length - begin - *at as u64).saturating_sub(HEAD_BYTES);
            body.is_some_and(|body| body <= left)
        };
        if let Some(at) = (0..there).find(is_known) {
            return Ok(Some(begin + at as u64));
        }
        if there == left {
            return Ok(None);
        }
        begin += (there - CHUNK_HEAD_BYTES_MAX) as u64;
    }
    Ok(None)
}

/// True if the lengths in the head of a chunk fit each other. Zeros in it are not found by its
/// checksum: they say that it has none, and no records.
pub(crate) fn is_chunk(file: &Arc<File>, chunk: Place) -> io::Result<bool> {
    let there = CHUNK_HEAD_BYTES_MAX.min(usize::try_from(chunk.length + HEAD_BYTES).unwrap_or(0));
    let mut head = [0; CHUNK_HEAD_BYTES_MAX];
    let head = &mut head[..there];
    Section::new(Arc::clone(file), chunk.offset, chunk.end()).read_exact(head)?;
    Ok(chunk_length(head) == Some(chunk.length))
}

/// The length of a chunk whose head these bytes begin with, if they do.
fn chunk_length(bytes: &[u8]) -> Option<u64> {
    let mut cursor = Cursor::packed(bytes.get(1..CHUNK_HEAD_BYTES_MAX.min(bytes.len()))?);
    let length = cursor.u64("length").ok()?;
    let (begin, end) = (cursor.u64("begin").ok()?, cursor.u64("end").ok()?);
    cursor.slice(8 + 4, "size and checksum").ok()?;
    let compression = cursor.string("compression").ok()?;
    let records = cursor.u64("records").ok()?;
    let head = 8 + 8 + 8 + 4 + 4 + compression.len() as u64 + 8;
    let is_known = matches!(&*compression, "" | "lz4" | "zstd");
    (is_known && begin <= end && records.checked_add(head) == Some(length)).then_some(length)
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
