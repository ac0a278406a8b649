//! A complete recording out of one that was cut: everything up to the last whole chunk, with an
//! index.
//!
//! For any MCAP file, whoever wrote it: schemas, channels, messages, attachments and metadata keep
//! their numbers and their bytes. A chunk whose checksum is wrong is left out, and reading goes on
//! behind it. The result is read back, from its index and from front to back, before it gets its
//! name; the original is not touched.

use crate::cursor::Cursor;
use crate::definitions::{DEFINITIONS_BYTES_MAX, Found};
use crate::error::RecordingError;
use crate::facts::file_facts;
use crate::format::{Format, MCAP_MAGIC, detect};
use crate::mcap_records::{Next, body, is_chunk, next_known, place_at, unpack};
use crate::mcap_writer::{FileFacts, LIBRARY, McapWriter, TopicFacts};
use crate::options::ReadOptions;
use mcap::records::{MessageHeader, op};
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::fs::{self, File, TryLockError};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// What was recovered.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Recovered {
    /// What the new file holds; of a complete one, what it holds itself.
    pub facts: FileFacts,
    /// True if nothing was missing: then no file was written.
    pub was_complete: bool,
    /// Chunks of the original, damaged or not.
    pub chunks: u64,
    /// Bytes of the original behind its last whole record.
    pub bytes_lost: u64,
    /// Chunks and records that were left out because they are damaged.
    pub damaged: u64,
    /// Their bytes, as they lie in the original.
    pub bytes_damaged: u64,
    /// The first of them in words.
    pub first_damage: Option<String>,
}

/// Writes what can be saved of the MCAP file `from` to `to`, which is replaced. `progress` is told
/// how many bytes of how many were read.
///
/// # Errors
/// [`RecordingError::Io`] (it cannot be read, somebody writes it, the disk is full), `Foreign` (no
/// MCAP), or `Write`. Then there is no new file, and `from` is what it was.
pub fn recover(
    from: &Path,
    to: &Path,
    mut progress: impl FnMut(u64, u64),
) -> Result<Recovered, RecordingError> {
    let (file, length) = open(from)?;
    if let Ok(facts) = file_facts(from) {
        let mut count = Counted::default();
        let walked = walk(&file, length, &mut count, &mut progress).map_err(|e| e.of(from))?;
        if walked.is_whole && walked.damaged == 0 && count.messages == facts.messages {
            let chunks = walked.chunks;
            return Ok(Recovered { facts, was_complete: true, chunks, ..Recovered::default() });
        }
    }
    let mut unfinished = to.to_owned().into_os_string();
    unfinished.push(".recovering");
    let unfinished = PathBuf::from(unfinished);
    let written = write(&file, length, from, to, &unfinished, &mut progress);
    if written.is_err() {
        let _ = fs::remove_file(&unfinished); // nobody wants half of a copy
    }
    written
}

fn open(from: &Path) -> Result<(Arc<File>, u64), RecordingError> {
    let io = |action| move |source| RecordingError::Io { path: from.to_owned(), action, source };
    let metadata = fs::metadata(from).map_err(io("open"))?;
    if !metadata.is_file() {
        return Err(io("open")(io::Error::other("expected a file")));
    }
    let file = File::open(from).map_err(io("open"))?;
    match file.try_lock_shared() {
        Ok(()) => {}
        Err(TryLockError::WouldBlock) => {
            let text = "it is being written: stop the recorder first";
            return Err(io("recover")(io::Error::other(text)));
        }
        Err(TryLockError::Error(source)) => return Err(io("lock")(source)),
    }
    let file = Arc::new(file);
    let (found, advice) = match detect(from, &file, &ReadOptions::default()) {
        Ok(kind) if kind.format == Format::Mcap => return Ok((file, metadata.len())),
        Ok(kind) => {
            (format!("a recording of the kind {}", kind.format.name()), advice(kind.format))
        }
        Err(RecordingError::Foreign { found, .. }) => (found, "is it the file that you meant?"),
        Err(error) => return Err(error),
    };
    Err(RecordingError::NotMcap { path: from.to_owned(), found, advice })
}

/// What recovers another format.
fn advice(format: Format) -> &'static str {
    match format {
        Format::Ros1Bag | Format::Ros1BagV1 => "`rosbag reindex` recovers a ROS 1 bag",
        _ => "`tog bag import` takes what comes before a cut",
    }
}

fn write(
    file: &Arc<File>,
    length: u64,
    from: &Path,
    to: &Path,
    unfinished: &Path,
    progress: &mut impl FnMut(u64, u64),
) -> Result<Recovered, RecordingError> {
    let elsewhere = Found::look(file, length).map_err(|error| Stop::Read(error).of(from))?;
    let mut copy = Copy::new(to, unfinished, elsewhere);
    let walked = walk(file, length, &mut copy, progress).map_err(|error| error.of(from))?;
    let (refused, refused_bytes) = (copy.refused, copy.refused_bytes);
    let first_refusal = copy.first_refusal.take();
    let written = copy.finish()?;
    let expected = written.facts().clone();
    verify(unfinished, &expected, progress)?;
    let facts = written.store()?;
    Ok(Recovered {
        facts,
        was_complete: false,
        chunks: walked.chunks,
        bytes_lost: length - walked.end,
        damaged: walked.damaged + refused,
        bytes_damaged: walked.damaged_bytes + refused_bytes,
        first_damage: walked.first_damage.or(first_refusal),
    })
}

/// Reads back what was written: by the index, and from front to back.
fn verify(
    path: &Path,
    expected: &FileFacts,
    progress: &mut impl FnMut(u64, u64),
) -> Result<(), RecordingError> {
    let facts = file_facts(path)?;
    let file = File::open(path).map_err(|source| RecordingError::Io {
        path: path.to_owned(),
        action: "read back",
        source,
    })?;
    let mut count = Counted::default();
    let walked = walk(&Arc::new(file), facts.bytes, &mut count, progress);
    let walked = walked.map_err(|error| error.of(path))?;
    let found = (facts.messages, count.messages, walked.is_whole, walked.damaged);
    if found != (expected.messages, expected.messages, true, 0) {
        let reason = format!(
            "it was read back with {} messages in its index and {} in its chunks, expected {}: \
             the disk is not to be trusted",
            facts.messages, count.messages, expected.messages
        );
        return Err(RecordingError::Write { path: path.to_owned(), reason });
    }
    Ok(())
}

/// Why a walk was given up.
enum Stop {
    Read(io::Error),
    Write(RecordingError),
}

impl Stop {
    fn of(self, path: &Path) -> RecordingError {
        match self {
            Self::Read(source) => {
                RecordingError::Io { path: path.to_owned(), action: "read", source }
            }
            Self::Write(error) => error,
        }
    }
}

/// Takes the records of a walk.
trait Sink {
    fn take(&mut self, opcode: u8, body: &[u8]) -> Result<(), RecordingError>;
    fn end_of_chunk(&mut self) -> Result<(), RecordingError>;
}

/// How far a walk came.
#[derive(Default)]
struct Walked {
    /// Behind the last whole record.
    end: u64,
    /// True if the end of the file was reached as it should be.
    is_whole: bool,
    chunks: u64,
    damaged: u64,
    damaged_bytes: u64,
    first_damage: Option<String>,
}

impl Walked {
    fn damage(&mut self, offset: u64, bytes: u64, reason: String) {
        self.damaged += 1;
        self.damaged_bytes += bytes;
        self.first_damage.get_or_insert_with(|| format!("at byte {offset}: {reason}"));
    }
}

/// All whole records from the begin to the end of the data; behind bytes that are no record it goes
/// on with the next chunk.
fn walk(
    file: &Arc<File>,
    length: u64,
    sink: &mut impl Sink,
    progress: &mut impl FnMut(u64, u64),
) -> Result<Walked, Stop> {
    let mut walked = Walked { end: MCAP_MAGIC.len() as u64, ..Walked::default() };
    let mut bytes = Vec::new();
    loop {
        progress(walked.end, length);
        let place = match place_at(file, walked.end, length).map_err(Stop::Read)? {
            Next::Record(place) => place,
            Next::Cut | Next::Garbage => {
                let begin = walked.end;
                let next = next_known(file, begin + 1, length).map_err(Stop::Read)?;
                let Some(next) = next else { return Ok(walked) };
                walked.damage(begin, next - begin, "bytes that are no record".to_owned());
                walked.end = next;
                continue;
            }
        };
        match place.opcode {
            op::FOOTER => {
                walked.is_whole = place.end() + MCAP_MAGIC.len() as u64 <= length;
                walked.end = length;
                return Ok(walked);
            }
            op::CHUNK => {
                walked.chunks += 1;
                if !is_chunk(file, place).map_err(Stop::Read)? {
                    let bytes = place.end() - place.offset;
                    walked.damage(place.offset, bytes, "a chunk without its head".to_owned());
                    walked.end = place.end();
                    continue;
                }
                let mut failed = None;
                let unpacked = unpack(file, place, |opcode, body| {
                    sink.take(opcode, body).map_err(|error| {
                        failed = Some(error);
                        io::Error::other("not written")
                    })
                });
                if let Some(error) = failed {
                    return Err(Stop::Write(error));
                }
                if let Err(reason) = unpacked.map_err(Stop::Read)? {
                    let bytes = place.end() - place.offset;
                    walked.damage(place.offset, bytes, format!("a chunk: {reason}"));
                }
                sink.end_of_chunk().map_err(Stop::Write)?;
            }
            _ => match body(file, place, &mut bytes) {
                Ok(()) => sink.take(place.opcode, &bytes).map_err(Stop::Write)?,
                Err(reason) => walked.damage(place.offset, place.end() - place.offset, reason),
            },
        }
        walked.end = place.end();
    }
}

/// Counts messages.
#[derive(Default)]
struct Counted {
    messages: u64,
}

impl Sink for Counted {
    fn take(&mut self, opcode: u8, _: &[u8]) -> Result<(), RecordingError> {
        self.messages += u64::from(opcode == op::MESSAGE);
        Ok(())
    }

    fn end_of_chunk(&mut self) -> Result<(), RecordingError> {
        Ok(())
    }
}

/// Writes a new file.
struct Copy<'a> {
    to: &'a Path,
    unfinished: &'a Path,
    writer: Option<McapWriter>,
    /// Names by number.
    schemas: BTreeMap<u16, String>,
    /// Index of a channel in the facts.
    channels: BTreeMap<u16, usize>,
    definitions_bytes: usize,
    /// Definitions for messages whose own were lost with a damaged chunk.
    elsewhere: Found,
    /// Records that make no sense.
    refused: u64,
    refused_bytes: u64,
    first_refusal: Option<String>,
}

impl<'a> Copy<'a> {
    fn new(to: &'a Path, unfinished: &'a Path, elsewhere: Found) -> Self {
        Self {
            to,
            unfinished,
            writer: None,
            schemas: BTreeMap::new(),
            channels: BTreeMap::new(),
            definitions_bytes: 0,
            elsewhere,
            refused: 0,
            refused_bytes: 0,
            first_refusal: None,
        }
    }

    fn writer(&mut self, profile: &str, library: &str) -> Result<&mut McapWriter, RecordingError> {
        if self.writer.is_none() {
            let unfinished = self.unfinished.to_owned();
            self.writer = Some(McapWriter::create_as(self.to, unfinished, profile, library)?);
        }
        // Just filled.
        self.writer.as_mut().ok_or_else(|| RecordingError::Write {
            path: self.unfinished.to_owned(),
            reason: "no writer".to_owned(),
        })
    }

    fn finish(mut self) -> Result<crate::WrittenFile, RecordingError> {
        self.writer("", LIBRARY)?;
        let writer = self.writer.take().ok_or_else(|| RecordingError::Write {
            path: self.unfinished.to_owned(),
            reason: "no writer".to_owned(),
        })?;
        writer.finish()
    }

    /// A record: what is wrong with it, if anything is. The outer error is that of the new file.
    fn record(&mut self, opcode: u8, body: &[u8]) -> Result<Result<(), String>, RecordingError> {
        let mut cursor = Cursor::packed(body);
        if opcode == op::HEADER {
            let parts = cursor
                .string("the profile")
                .and_then(|profile| Ok((profile, cursor.string("the library")?)));
            let (profile, library) = match parts {
                Ok((profile, library)) => (profile, format!("{library}; recovered by {LIBRARY}")),
                Err(reason) => return Ok(Err(reason)),
            };
            self.writer(&profile, &library)?;
            return Ok(Ok(()));
        }
        self.writer("", LIBRARY)?;
        match opcode {
            op::SCHEMA | op::CHANNEL => {
                self.definitions_bytes += body.len();
                if self.definitions_bytes > DEFINITIONS_BYTES_MAX {
                    let max = DEFINITIONS_BYTES_MAX;
                    return Ok(Err(format!("definitions of more than {max} bytes")));
                }
                Ok(if opcode == op::SCHEMA { self.schema(body) } else { self.channel(body) })
            }
            op::MESSAGE => self.message(cursor),
            op::ATTACHMENT => self.attachment(cursor),
            op::METADATA => self.metadata(cursor),
            _ => Ok(Ok(())), // indexes and statistics are made anew
        }
    }

    fn schema(&mut self, body: &[u8]) -> Result<(), String> {
        let mut record = Cursor::packed(body);
        let id = record.u16("the number of a schema")?;
        let name = record.string("the name of a schema")?;
        let encoding = record.string("the encoding of a schema")?;
        let length = record.u32("the length of a schema")? as usize;
        let data = record.slice(length, "a schema")?;
        let Some(writer) = self.writer.as_mut() else { return Ok(()) };
        let (raw, _) = writer.raw();
        raw.add_schema_with_id(id, &name, &encoding, data).map_err(|error| error.to_string())?;
        if let Entry::Vacant(place) = self.schemas.entry(id) {
            place.insert(name.into_owned());
            writer.define(op::SCHEMA, body);
        }
        Ok(())
    }

    fn channel(&mut self, body: &[u8]) -> Result<(), String> {
        let mut record = Cursor::packed(body);
        let id = record.u16("the number of a channel")?;
        let schema = record.u16("the schema of a channel")?;
        if schema != 0 && !self.schemas.contains_key(&schema) {
            // If it is nowhere else either, the writer refuses the channel.
            self.elsewhere.schemas.remove(&schema).map_or(Ok(()), |found| self.schema(&found))?;
        }
        let name = record.string("the topic of a channel")?.into_owned();
        let encoding = record.string("the encoding of a channel")?.into_owned();
        let mut notes = record.string_map("the notes of a channel")?;
        let Some(writer) = self.writer.as_mut() else { return Ok(()) };
        let (raw, facts) = writer.raw();
        raw.add_channel_with_id(id, schema, &name, &encoding, &notes)
            .map_err(|error| error.to_string())?;
        if self.channels.contains_key(&id) {
            return Ok(());
        }
        let message_type = self.schemas.get(&schema).cloned().unwrap_or_default();
        let qos = notes.remove("offered_qos_profiles").unwrap_or_default();
        self.channels.insert(id, facts.topics.len());
        facts.topics.push(TopicFacts { name, message_type, encoding, qos, messages: 0 });
        writer.define(op::CHANNEL, body);
        Ok(())
    }

    fn message(&mut self, mut record: Cursor<'_>) -> Result<Result<(), String>, RecordingError> {
        let header = (|| {
            Ok::<_, String>(MessageHeader {
                channel_id: record.u16("the channel of a message")?,
                sequence: record.u32("the number of a message")?,
                log_time: record.u64("the log time of a message")?,
                publish_time: record.u64("the publish time of a message")?,
            })
        })();
        let header = match header {
            Ok(header) => header,
            Err(reason) => return Ok(Err(reason)),
        };
        if !self.channels.contains_key(&header.channel_id)
            && let Some(found) = self.elsewhere.channels.remove(&header.channel_id)
            && let Err(reason) = self.channel(&found)
        {
            return Ok(Err(reason));
        }
        let Some(topic) = self.channels.get(&header.channel_id) else {
            let channel = header.channel_id;
            return Ok(Err(format!("a message of the unknown channel {channel}")));
        };
        let Some(writer) = self.writer.as_mut() else { return Ok(Ok(())) };
        let (raw, facts) = writer.raw();
        raw.write_to_known_channel(&header, record.rest())
            .map_err(|error| crate::mcap_writer::write_error(self.unfinished, &error))?;
        facts.count(*topic, header.log_time);
        Ok(Ok(()))
    }

    fn attachment(&mut self, mut record: Cursor<'_>) -> Result<Result<(), String>, RecordingError> {
        let attachment = (|| {
            let log_time = record.u64("the time of an attachment")?;
            let create_time = record.u64("the time of an attachment")?;
            let name = record.string("the name of an attachment")?.into_owned();
            let media_type = record.string("the type of an attachment")?.into_owned();
            let length = record.u64("the length of an attachment")?;
            let length = usize::try_from(length).unwrap_or(usize::MAX);
            let data = Cow::Borrowed(record.slice(length, "an attachment")?);
            Ok(mcap::Attachment { log_time, create_time, name, media_type, data })
        })();
        let attachment = match attachment {
            Ok(attachment) => attachment,
            Err(reason) => return Ok(Err(reason)),
        };
        let Some(writer) = self.writer.as_mut() else { return Ok(Ok(())) };
        let written = writer.raw().0.attach(&attachment);
        written.map(Ok).map_err(|error| crate::mcap_writer::write_error(self.unfinished, &error))
    }

    fn metadata(&mut self, mut record: Cursor<'_>) -> Result<Result<(), String>, RecordingError> {
        let parts = record
            .string("the name of metadata")
            .and_then(|name| Ok((name, record.string_map("metadata")?)));
        let (name, values) = match parts {
            Ok(parts) => parts,
            Err(reason) => return Ok(Err(reason)),
        };
        let Some(writer) = self.writer.as_mut() else { return Ok(Ok(())) };
        writer.metadata(&name, &values).map(Ok)
    }
}

impl Sink for Copy<'_> {
    fn take(&mut self, opcode: u8, body: &[u8]) -> Result<(), RecordingError> {
        if let Err(reason) = self.record(opcode, body)? {
            self.refused += 1;
            self.refused_bytes += body.len() as u64;
            self.first_refusal.get_or_insert(reason);
        }
        Ok(())
    }

    fn end_of_chunk(&mut self) -> Result<(), RecordingError> {
        match &mut self.writer {
            Some(writer) => writer.flush(),
            None => Ok(()),
        }
    }
}
