//! One MCAP file while it is written. The writer of everything that tog records.
//!
//! Chunks of 768 KiB, zstd, all indexes and checksums, on the thread of the caller. The file is
//! called `<name>.active` until it is on the disk: what has its final name is complete. While it
//! is written it is locked (`flock`), so that whoever looks for left-overs can tell the living
//! from the dead.
//!
//! What topics are stands in the first chunk, and again behind it and every few megabytes (see
//! [`crate::definitions`]): a damaged spot costs its chunk and no other.
//!
//! Nothing is flushed by itself: [`McapWriter::flush`] closes the chunk and gives it to the
//! system, and whoever calls it every second loses a second at most when the process is killed.

use crate::definitions::{DEFINITIONS_OPCODE, Definitions, channel_record, schema_record};
use crate::error::RecordingError;
use crate::mcap_file::words;
use crate::ros2::MessageType;
use mcap::records::{MessageHeader, op};
use mcap::{Attachment, Compression, McapError, WriteOptions, Writer};
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fs::{self, File, TryLockError};
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

/// Chunk size that rosbag2 documents: large enough for zstd, small enough to hold.
const CHUNK_BYTES: u64 = 768 * 1024;
/// What a file is called behind its name until it is complete.
pub const ACTIVE_SUFFIX: &str = ".active";
/// What a recording of ours says who wrote it.
pub(crate) const LIBRARY: &str = concat!("tog ", env!("CARGO_PKG_VERSION"), " mcap-rust/0.26");
/// The profile of a recording of ours.
pub(crate) const PROFILE: &str = "ros2";
/// How the types of messages are defined.
const SCHEMA_ENCODING: &str = "ros2msg";
/// How rosbag2 is told that a topic is latched: subscribers that come late get the last message.
const LATCHED_QOS: &str = "\
- history: keep_last
  depth: 1
  reliability: reliable
  durability: transient_local
  deadline:
    sec: 9223372036
    nsec: 854775807
  lifespan:
    sec: 9223372036
    nsec: 854775807
  liveliness: automatic
  liveliness_lease_duration:
    sec: 9223372036
    nsec: 854775807
  avoid_ros_namespace_conventions: false
";

/// What a topic of a recording is.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TopicSpec {
    /// Its name: `/laser_front/scan`.
    pub name: String,
    /// The type of its messages.
    pub message_type: MessageType,
    /// True if the last message is for all who come later: maps, `/tf_static`.
    pub is_latched: bool,
    /// What a reader should know of it, key by key.
    pub notes: BTreeMap<String, String>,
}

impl TopicSpec {
    /// A topic without notes.
    #[must_use]
    pub fn new(name: impl Into<String>, message_type: MessageType) -> Self {
        Self { name: name.into(), message_type, is_latched: false, notes: BTreeMap::new() }
    }

    /// The same, latched.
    #[must_use]
    pub fn latched(self) -> Self {
        Self { is_latched: true, ..self }
    }

    /// Quality of service as rosbag2 writes it; empty for that of a sensor.
    pub(crate) fn qos(&self) -> &'static str {
        if self.is_latched { LATCHED_QOS } else { "" }
    }
}

/// What a file holds, for `metadata.yaml` and for people.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct FileFacts {
    /// Name of the file.
    pub name: String,
    /// Its length, bytes.
    pub bytes: u64,
    /// Messages in it.
    pub messages: u64,
    /// Log time of the first message, UNIX nanoseconds; 0 if there is none.
    pub first_ns: u64,
    /// Log time of the last message, UNIX nanoseconds.
    pub last_ns: u64,
    /// Its topics.
    pub topics: Vec<TopicFacts>,
}

/// A topic of a file.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct TopicFacts {
    /// Its name.
    pub name: String,
    /// Name of the type of its messages.
    pub message_type: String,
    /// How they are encoded: `cdr`.
    pub encoding: String,
    /// Quality of service as rosbag2 writes it; may be empty.
    pub qos: String,
    /// Messages.
    pub messages: u64,
}

impl FileFacts {
    /// Takes note of a message.
    pub(crate) fn count(&mut self, topic: usize, log_time_ns: u64) {
        self.first_ns =
            if self.messages == 0 { log_time_ns } else { self.first_ns.min(log_time_ns) };
        self.last_ns = self.last_ns.max(log_time_ns);
        self.messages += 1;
        if let Some(topic) = self.topics.get_mut(topic) {
            topic.messages += 1;
        }
    }
}

/// A file that knows how long it is.
#[derive(Debug)]
pub(crate) struct Measured {
    file: BufWriter<File>,
    position: u64,
    length: u64,
    told: std::sync::Arc<std::sync::atomic::AtomicU64>,
}

impl Write for Measured {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = self.file.write(bytes)?;
        self.position += written as u64;
        self.length = self.length.max(self.position);
        self.told.store(self.length, std::sync::atomic::Ordering::Relaxed);
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

impl Seek for Measured {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.position = self.file.seek(to)?;
        Ok(self.position)
    }

    fn stream_position(&mut self) -> io::Result<u64> {
        Ok(self.position) // without emptying the buffer
    }
}

/// What became of the name of a file that is being written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Place {
    /// It has it.
    Kept,
    /// The file has another name.
    Moved,
    /// It has none: what was written is gone when it is closed.
    Deleted,
}

/// A recording that is being written.
pub struct McapWriter {
    path: PathBuf,
    active_path: PathBuf,
    writer: Writer<Measured>,
    channels: Vec<(u16, u32)>,
    facts: FileFacts,
    definitions: Definitions,
    /// The open file once more, to be asked where it is.
    witness: File,
    length: std::sync::Arc<std::sync::atomic::AtomicU64>,
}

/// The name of a file while it is not complete.
#[must_use]
pub fn active_path(path: &Path) -> PathBuf {
    let mut active = path.to_owned().into_os_string();
    active.push(ACTIVE_SUFFIX);
    PathBuf::from(active)
}

/// Refuses what is neither absent nor a file: a device, a pipe, a directory, a link would be
/// replaced, or waited for.
///
/// # Errors
/// [`RecordingError::Io`].
pub(crate) fn check_replaceable(path: &Path) -> Result<(), RecordingError> {
    let io = |source| RecordingError::Io { path: path.to_owned(), action: "write", source };
    match fs::symlink_metadata(path) {
        Ok(found) if found.is_file() => Ok(()),
        Ok(_) => Err(io(io::Error::other(
            "found a directory, a link, a device or a pipe, expected a file or nothing",
        ))),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(()),
        Err(error) => Err(io(error)),
    }
}

impl McapWriter {
    /// Creates `<path>.active`, replacing a left-over of that name that nobody writes.
    ///
    /// # Errors
    /// [`RecordingError::Io`] or `Write`; `Io` as well if somebody else writes that file now.
    pub fn create(path: impl AsRef<Path>) -> Result<Self, RecordingError> {
        let path = path.as_ref();
        Self::create_as(path, active_path(path), PROFILE, LIBRARY)
    }

    pub(crate) fn create_as(
        path: &Path,
        active_path: PathBuf,
        profile: &str,
        library: &str,
    ) -> Result<Self, RecordingError> {
        check_replaceable(path)?;
        check_replaceable(&active_path)?;
        let io =
            |source| RecordingError::Io { path: active_path.clone(), action: "create", source };
        let open = File::options().write(true).create(true).truncate(false).open(&active_path);
        let file = open.map_err(io)?;
        match file.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => {
                return Err(io(io::Error::other("another process writes it")));
            }
            Err(TryLockError::Error(source)) => return Err(io(source)),
        }
        file.set_len(0).map_err(io)?;
        let options = WriteOptions::new()
            .profile(profile)
            .library(library)
            .compression(Some(Compression::Zstd))
            .compression_threads(0)
            .chunk_size(Some(CHUNK_BYTES));
        let length = std::sync::Arc::default();
        let told = std::sync::Arc::clone(&length);
        let witness = file.try_clone().map_err(io)?;
        let measured = Measured { file: BufWriter::new(file), position: 0, length: 0, told };
        let writer = options.create(measured).map_err(|error| write_error(&active_path, &error))?;
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        Ok(Self {
            path: path.to_owned(),
            active_path,
            writer,
            channels: Vec::new(),
            facts: FileFacts { name, ..FileFacts::default() },
            definitions: Definitions::default(),
            witness,
            length,
        })
    }

    /// Its name when it is complete.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// What it holds so far; without what the open chunk will add to its length.
    #[must_use]
    pub fn facts(&self) -> &FileFacts {
        &self.facts
    }

    /// Bytes that were written; the open chunk comes on top.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.length.load(std::sync::atomic::Ordering::Relaxed)
    }

    /// Adds a topic; the number that is returned names it in [`McapWriter::write`].
    ///
    /// # Errors
    /// [`RecordingError::Write`].
    pub fn add_topic(&mut self, topic: &TopicSpec) -> Result<usize, RecordingError> {
        let message_type = topic.message_type;
        let mut notes = topic.notes.clone();
        if topic.is_latched {
            notes.insert("offered_qos_profiles".to_owned(), topic.qos().to_owned());
        }
        let definition = message_type.definition().as_bytes();
        let name = message_type.name();
        let added = self.writer.add_schema(name, SCHEMA_ENCODING, definition).and_then(|schema| {
            Ok((schema, self.writer.add_channel(schema, &topic.name, "cdr", &notes)?))
        });
        let (schema, channel) = added.map_err(|error| write_error(&self.active_path, &error))?;
        if !self.facts.topics.iter().any(|topic| topic.message_type == name) {
            self.define(op::SCHEMA, &schema_record(schema, name, SCHEMA_ENCODING, definition));
        }
        self.define(op::CHANNEL, &channel_record(channel, schema, &topic.name, "cdr", &notes));
        self.channels.push((channel, 0));
        self.facts.topics.push(TopicFacts {
            name: topic.name.clone(),
            message_type: message_type.name().to_owned(),
            encoding: "cdr".to_owned(),
            qos: topic.qos().to_owned(),
            messages: 0,
        });
        Ok(self.channels.len() - 1)
    }

    /// Appends a message. `log_time_ns` is when it was received, `publish_time_ns` when it was
    /// made, UNIX nanoseconds; `bytes` as [`crate::ros2::encode`] makes them.
    ///
    /// # Errors
    /// [`RecordingError::Write`]: an unknown topic or a full disk. After that the writer is of no
    /// further use.
    pub fn write(
        &mut self,
        topic: usize,
        log_time_ns: u64,
        publish_time_ns: u64,
        bytes: &[u8],
    ) -> Result<(), RecordingError> {
        let count = self.channels.len();
        let Some((channel_id, sequence)) = self.channels.get_mut(topic) else {
            let reason = format!("topic number {topic}, there are {count}");
            return Err(RecordingError::Write { path: self.active_path.clone(), reason });
        };
        let header = MessageHeader {
            channel_id: *channel_id,
            sequence: *sequence,
            log_time: log_time_ns,
            publish_time: publish_time_ns,
        };
        *sequence = sequence.wrapping_add(1);
        self.writer
            .write_to_known_channel(&header, bytes)
            .map_err(|error| write_error(&self.active_path, &error))?;
        self.facts.count(topic, log_time_ns);
        Ok(())
    }

    /// Appends a whole file as an attachment.
    ///
    /// # Errors
    /// [`RecordingError::Write`].
    pub fn attach(
        &mut self,
        name: &str,
        media_type: &str,
        stamp_ns: u64,
        bytes: &[u8],
    ) -> Result<(), RecordingError> {
        let attachment = Attachment {
            log_time: stamp_ns,
            create_time: stamp_ns,
            name: name.to_owned(),
            media_type: media_type.to_owned(),
            data: Cow::Borrowed(bytes),
        };
        self.writer.attach(&attachment).map_err(|error| write_error(&self.active_path, &error))
    }

    /// Appends a record of metadata.
    ///
    /// # Errors
    /// [`RecordingError::Write`].
    pub fn metadata(
        &mut self,
        name: &str,
        values: &BTreeMap<String, String>,
    ) -> Result<(), RecordingError> {
        let metadata = mcap::records::Metadata { name: name.to_owned(), metadata: values.clone() };
        self.writer
            .write_metadata(&metadata)
            .map_err(|error| write_error(&self.active_path, &error))
    }

    /// Closes the chunk and gives everything to the system: what was written before survives a
    /// kill of this process.
    ///
    /// # Errors
    /// [`RecordingError::Write`], as a full disk.
    pub fn flush(&mut self) -> Result<(), RecordingError> {
        let mut flushed = Ok(());
        if let Some(record) = self.definitions.due(self.bytes()) {
            flushed =
                self.writer.write_private_record(DEFINITIONS_OPCODE, &record, Default::default());
        }
        flushed
            .and_then(|()| self.writer.flush())
            .map_err(|error| write_error(&self.active_path, &error))
    }

    /// Whether what is written still has the name `<path>.active`.
    #[must_use]
    pub fn place(&self) -> Place {
        // A file that cannot be asked is where it was: its writes say what is wrong.
        let Ok(written) = self.witness.metadata() else { return Place::Kept };
        if written.nlink() == 0 {
            return Place::Deleted;
        }
        match fs::symlink_metadata(&self.active_path) {
            Ok(there) if (there.dev(), there.ino()) == (written.dev(), written.ino()) => {
                Place::Kept
            }
            Err(error) if error.kind() != io::ErrorKind::NotFound => Place::Kept,
            _ => Place::Moved,
        }
    }

    /// Takes note of a schema or channel, to be repeated outside the chunks.
    pub(crate) fn define(&mut self, opcode: u8, record: &[u8]) {
        self.definitions.add(opcode, record);
    }

    /// The writer of the library, for what only recovery needs.
    pub(crate) fn raw(&mut self) -> (&mut Writer<Measured>, &mut FileFacts) {
        (&mut self.writer, &mut self.facts)
    }

    /// Writes the index. The file has not got its name yet: see [`WrittenFile::store`].
    ///
    /// # Errors
    /// [`RecordingError::Io`] or `Write`: then what was written so far is in `<path>.active`.
    pub fn finish(mut self) -> Result<WrittenFile, RecordingError> {
        self.writer.finish().map_err(|error| write_error(&self.active_path, &error))?;
        let measured = self.writer.into_inner();
        let (active_path, bytes) = (self.active_path, measured.length);
        let file = measured.file.into_inner().map_err(|error| RecordingError::Io {
            path: active_path.clone(),
            action: "finish",
            source: error.into_error(),
        })?;
        let facts = FileFacts { bytes, ..self.facts };
        Ok(WrittenFile { path: self.path, active_path, file, facts })
    }
}

/// A file with its index, not yet on the disk for sure.
#[derive(Debug)]
pub struct WrittenFile {
    path: PathBuf,
    active_path: PathBuf,
    file: File,
    facts: FileFacts,
}

impl WrittenFile {
    /// What it holds.
    #[must_use]
    pub fn facts(&self) -> &FileFacts {
        &self.facts
    }

    /// Its name when it is stored.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Puts it on the disk and gives it its name. Waits for the disk.
    ///
    /// # Errors
    /// [`RecordingError::Io`]: then it is still `<path>.active`.
    pub fn store(self) -> Result<FileFacts, RecordingError> {
        let parent = match self.path.parent() {
            Some(parent) if !parent.as_os_str().is_empty() => parent,
            _ => Path::new("."),
        };
        self.file
            .sync_all()
            .and_then(|()| fs::rename(&self.active_path, &self.path))
            .and_then(|()| File::open(parent)?.sync_all())
            .map_err(|source| RecordingError::Io {
                path: self.path.clone(),
                action: "finish",
                source,
            })?;
        Ok(self.facts)
    }
}

pub(crate) fn write_error(path: &Path, error: &McapError) -> RecordingError {
    RecordingError::Write { path: path.to_owned(), reason: words(error) }
}
