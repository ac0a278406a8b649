//! Where messages go: files, one after the other, each of whole seconds.
//!
//! Time is an argument: `mono_ns` is CLOCK_MONOTONIC, `now_ns` the host's time of the day. A
//! failed write is the end of its file, never of the tape: the messages are counted as dropped,
//! and a new file is tried every [`RETRY_NS`]. A file that somebody deletes or moves away while it is
//! written is missed within a second: a new one begins at once.

use crate::attach::{Attachment, SESSION};
use crate::shelf::{Order, Outcome, Shelf};
use protocol::time::SECOND_NS;
use recording::{BagDirectory, McapWriter, Place, RecordingError, TopicSpec};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// The chunk is closed so often.
pub const FLUSH_NS: u64 = SECOND_NS;
/// A new file is tried so often after a failure.
pub const RETRY_NS: u64 = 5 * SECOND_NS;
/// A file is not begun with less room than this: a few chunks and an index.
pub const ROOM_BYTES_MIN: u64 = 16 << 20;

/// When a file is complete.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Limits {
    /// At this length, bytes.
    pub split_bytes: u64,
    /// After this time, nanoseconds.
    pub split_ns: u64,
}

/// What every file begins with.
#[derive(Debug, Clone)]
pub struct Head {
    /// Its topics.
    pub topics: Vec<TopicSpec>,
    /// Its attachments.
    pub attachments: Vec<Attachment>,
    /// The metadata record `tog.session`.
    pub session: BTreeMap<String, String>,
}

/// What was done so far.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct TapeCounts {
    /// Messages that were written.
    pub messages_written: u64,
    /// Messages for which there was no room.
    pub messages_dropped: u64,
    /// Bytes of all files, the open one included.
    pub bytes_written: u64,
    /// Files that were begun.
    pub files: u64,
    /// Files that were complete because they were long enough.
    pub splits: u64,
    /// Writes that failed.
    pub writes_failed: u64,
    /// Files of earlier recorders that were recovered.
    pub files_recovered: u64,
    /// Messages in them.
    pub messages_recovered: u64,
    /// Files that were deleted because of `keep_mb` or `keep_days`.
    pub files_removed: u64,
}

/// When a message was received and made, UNIX nanoseconds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Stamps {
    /// Received.
    pub log_ns: u64,
    /// Made.
    pub publish_ns: u64,
}

struct Open {
    writer: McapWriter,
    since_mono_ns: u64,
    flush_mono_ns: Option<u64>,
    /// Messages that every file begins with.
    head_messages: u64,
    /// Messages since the last closed second: a write that fails takes them along.
    unflushed: u64,
}

/// The files of a session.
pub struct Tape {
    directory: PathBuf,
    head: Head,
    limits: Limits,
    shelf: Shelf,
    open: Option<Open>,
    retry_mono_ns: Option<u64>,
    latched: BTreeMap<usize, (u64, Vec<u8>)>,
    unwritable: Option<String>,
    lost: Option<String>,
    unshelved: Option<String>,
    closed_bytes: u64,
    counts: TapeCounts,
}

impl Tape {
    /// A tape whose files go into `directory`, which is made with the first of them.
    #[must_use]
    pub fn new(directory: PathBuf, head: Head, limits: Limits, shelf: Shelf) -> Self {
        Self {
            directory,
            head,
            limits,
            shelf,
            open: None,
            retry_mono_ns: None,
            latched: BTreeMap::new(),
            unwritable: None,
            lost: None,
            unshelved: None,
            closed_bytes: 0,
            counts: TapeCounts::default(),
        }
    }

    /// Where the files go.
    #[must_use]
    pub fn directory(&self) -> &Path {
        &self.directory
    }

    /// What was done.
    #[must_use]
    pub fn counts(&self) -> TapeCounts {
        let open_bytes = self.open.as_ref().map_or(0, |open| open.writer.bytes());
        TapeCounts { bytes_written: self.closed_bytes + open_bytes, ..self.counts }
    }

    /// Why nothing is recorded now, if nothing is.
    #[must_use]
    pub fn unwritable(&self) -> Option<&str> {
        self.unwritable.as_deref()
    }

    /// What somebody deleted or moved away while it was recorded, if anybody did: the last of it.
    #[must_use]
    pub fn lost(&self) -> Option<&str> {
        self.lost.as_deref()
    }

    /// What could not be put on the disk, recovered or deleted, if anything could not.
    #[must_use]
    pub fn unshelved(&self) -> Option<&str> {
        self.unshelved.as_deref()
    }

    /// Appends a message to a topic of the head. Of a latched topic the message is kept, and every
    /// later file begins with it.
    pub fn write(&mut self, topic: usize, stamps: Stamps, bytes: &[u8], mono_ns: u64) {
        if self.head.topics.get(topic).is_some_and(|topic| topic.is_latched) {
            let (publish_ns, kept) = self.latched.entry(topic).or_default();
            *publish_ns = stamps.publish_ns;
            kept.clear();
            kept.extend_from_slice(bytes);
            if self.open.is_none() && self.may_try(mono_ns) {
                self.begin(stamps.log_ns, mono_ns); // with this message
                return;
            }
        }
        if self.open.is_none() && self.may_try(mono_ns) {
            self.begin(stamps.log_ns, mono_ns);
        }
        let Some(open) = &mut self.open else {
            self.counts.messages_dropped += 1;
            return;
        };
        match open.writer.write(topic, stamps.log_ns, stamps.publish_ns, bytes) {
            Ok(()) => {
                self.counts.messages_written += 1;
                open.unflushed += 1;
                open.flush_mono_ns.get_or_insert(mono_ns + FLUSH_NS);
            }
            Err(error) => {
                self.counts.messages_dropped += 1;
                self.fail(&error, mono_ns);
            }
        }
    }

    fn may_try(&self, mono_ns: u64) -> bool {
        self.retry_mono_ns.is_none_or(|retry| retry <= mono_ns)
    }

    /// When [`Tape::tick`] wants to be called next, CLOCK_MONOTONIC nanoseconds.
    #[must_use]
    pub fn deadline_mono_ns(&self) -> Option<u64> {
        match &self.open {
            Some(open) => open.flush_mono_ns,
            None => self.retry_mono_ns,
        }
    }

    /// Does what is due: closes the second, the file, tries again. `now_ns` is the log time of the
    /// messages that a new file begins with.
    pub fn tick(&mut self, now_ns: u64, mono_ns: u64) {
        self.note_outcomes();
        if self.open.is_none() && self.retry_mono_ns.is_some_and(|retry| retry <= mono_ns) {
            self.begin(now_ns, mono_ns);
        }
        let Some(open) = &mut self.open else { return };
        if open.flush_mono_ns.is_some_and(|flush| flush <= mono_ns) {
            open.flush_mono_ns = None;
            if let Err(error) = open.writer.flush() {
                return self.fail(&error, mono_ns);
            }
            open.unflushed = 0;
            if self.note_place() {
                return self.begin(now_ns, mono_ns);
            }
        }
        let Some(open) = &self.open else { return };
        let is_long = open.writer.bytes() >= self.limits.split_bytes
            || mono_ns.saturating_sub(open.since_mono_ns) >= self.limits.split_ns;
        if is_long && open.writer.facts().messages > open.head_messages {
            self.counts.splits += 1;
            self.close(mono_ns);
            self.begin(now_ns, mono_ns);
        }
    }

    /// Begins a file.
    fn begin(&mut self, now_ns: u64, mono_ns: u64) {
        match self.begin_file(now_ns) {
            Ok(writer) => {
                let head_messages = writer.facts().messages;
                self.counts.messages_written += head_messages;
                self.counts.files += 1;
                let flush_mono_ns = Some(mono_ns + FLUSH_NS);
                let unflushed = head_messages;
                let since_mono_ns = mono_ns;
                let open = Open { writer, since_mono_ns, flush_mono_ns, head_messages, unflushed };
                self.open = Some(open);
                self.retry_mono_ns = None;
                if self.unwritable.take().is_some() {
                    // What the full disk left of the last file can be saved now.
                    self.shelf.order(Order::TidyUp);
                }
            }
            Err(error) => self.fail(&error, mono_ns),
        }
    }

    fn begin_file(&self, now_ns: u64) -> Result<McapWriter, RecordingError> {
        enough_room(&self.directory)?;
        let bag = BagDirectory::open(&self.directory)?;
        let mut writer = McapWriter::create(bag.next_path()?)?;
        for attachment in &self.head.attachments {
            let bytes = attachment.text.as_bytes();
            writer.attach(attachment.name, attachment.media_type, now_ns, bytes)?;
        }
        writer.metadata(SESSION, &self.head.session)?;
        for topic in &self.head.topics {
            writer.add_topic(topic)?;
        }
        for (topic, (publish_ns, bytes)) in &self.latched {
            writer.write(*topic, now_ns, *publish_ns, bytes)?;
        }
        Ok(writer)
    }

    /// Gives the open file up if somebody deleted it or moved it away; true if so.
    fn note_place(&mut self) -> bool {
        let Some(open) = &self.open else { return false };
        let messages = open.writer.facts().messages;
        let name = recording::active_path(open.writer.path());
        let name = name.display();
        let text = match open.writer.place() {
            Place::Kept => return false,
            Place::Deleted => {
                format!(
                    "{name} was deleted while it was recorded: its {messages} messages are lost"
                )
            }
            Place::Moved => format!(
                "{name} was moved away while it was recorded: `tog bag recover` makes a complete \
                 file of its {messages} messages"
            ),
        };
        tracing::error!("{text}");
        if open.writer.place() == Place::Deleted {
            self.counts.messages_written -= messages;
            self.counts.messages_dropped += messages;
        }
        if let Some(open) = self.open.take() {
            self.closed_bytes += open.writer.bytes();
        }
        self.lost = Some(text);
        true
    }

    /// Closes the open file.
    fn close(&mut self, mono_ns: u64) {
        if self.note_place() {
            return;
        }
        let Some(open) = self.open.take() else { return };
        let unflushed = open.unflushed;
        match open.writer.finish() {
            Ok(written) => {
                self.closed_bytes += written.facts().bytes;
                self.shelf.order(Order::Store(written));
            }
            Err(error) => {
                self.lose(unflushed);
                self.fail(&error, mono_ns);
            }
        }
    }

    fn lose(&mut self, messages: u64) {
        self.counts.messages_written -= messages;
        self.counts.messages_dropped += messages;
    }

    fn fail(&mut self, error: &RecordingError, mono_ns: u64) {
        // After a failed write nothing can follow in that file.
        if let Some(open) = self.open.take() {
            self.lose(open.unflushed);
            self.closed_bytes += open.writer.bytes();
        }
        self.counts.writes_failed += 1;
        self.retry_mono_ns = Some(mono_ns + RETRY_NS);
        self.unwritable =
            Some(format!("nothing is recorded: {error}; free space on the disk, or keep less"));
    }

    fn note_outcomes(&mut self) {
        while let Some(outcome) = self.shelf.outcome() {
            match outcome {
                Outcome::Stored => self.unshelved = None,
                Outcome::Recovered { messages } => {
                    self.counts.files_recovered += 1;
                    self.counts.messages_recovered += messages;
                }
                Outcome::Removed => self.counts.files_removed += 1,
                Outcome::Failed(text) => self.unshelved = Some(text),
            }
        }
    }

    /// Completes the last file and waits until everything is on the disk.
    pub fn finish(&mut self, mono_ns: u64) -> TapeCounts {
        self.close(mono_ns);
        self.shelf.finish();
        self.note_outcomes();
        self.counts()
    }

    /// As [`Tape::unwritable`], [`Tape::lost`] or [`Tape::unshelved`], at the end.
    #[must_use]
    pub fn problem(&self) -> Option<&str> {
        self.unwritable().or_else(|| self.lost()).or_else(|| self.unshelved())
    }
}

fn enough_room(directory: &Path) -> Result<(), RecordingError> {
    // The directory itself is made when there is something to be put into it.
    let found = directory.ancestors().find_map(|there| {
        let there = if there.as_os_str().is_empty() { Path::new(".") } else { there };
        rustix::fs::statvfs(there).ok()
    });
    let Some(found) = found else { return Ok(()) };
    let free = found.f_bavail.saturating_mul(found.f_frsize);
    if free >= ROOM_BYTES_MIN {
        return Ok(());
    }
    let (free_mb, min_mb) = (free / 1_000_000, ROOM_BYTES_MIN / 1_000_000);
    let reason = format!("the disk has {free_mb} MB left, expected at least {min_mb} MB");
    Err(RecordingError::Write { path: directory.to_owned(), reason })
}
