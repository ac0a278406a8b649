//! A file of a recording, and the reader of its format.

use crate::bag::BagReader;
use crate::bag_v1::BagV1Reader;
use crate::db3::{self, Db3Reader};
use crate::error::RecordingError;
use crate::format::{Format, Kind, detect};
use crate::laser_scan::Wire;
use crate::mcap_file::McapReader;
use crate::options::ReadOptions;
use crate::stream::{Channels, Raw, StreamEnd};
use crate::text::TextReader;
use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A file of a recording.
#[derive(Debug, Clone)]
pub(crate) struct Part {
    pub path: PathBuf,
    pub file: Arc<File>,
    pub length: u64,
    pub kind: Kind,
}

impl Part {
    /// Opens a file; its format is told by its content.
    pub fn open(path: &Path, options: &ReadOptions) -> Result<Self, RecordingError> {
        let io = |source| RecordingError::Io { path: path.to_owned(), action: "open", source };
        // Looked at before it is opened: opening a pipe that nobody writes to would wait for ever.
        let metadata = std::fs::metadata(path).map_err(io)?;
        if metadata.is_dir() {
            let reason = "where a file of a bag was expected".to_owned();
            return Err(RecordingError::Directory { path: path.to_owned(), reason });
        }
        if !metadata.is_file() {
            return Err(io(io::Error::new(
                io::ErrorKind::InvalidInput,
                "found a device or a pipe, expected a file",
            )));
        }
        let file = Arc::new(File::open(path).map_err(io)?);
        let kind = detect(path, &file, options)?;
        if kind.format == Format::Ros2Db3 {
            db3::check(path, metadata.len())?;
        }
        Ok(Self { path: path.to_owned(), file, length: metadata.len(), kind })
    }

    /// A reader that begins at the begin.
    pub fn reader(&self, options: &ReadOptions) -> Reader {
        let (file, length) = (self.file.clone(), self.length);
        match self.kind.format {
            Format::Ros1Bag => Reader::Bag(BagReader::new(file, length)),
            Format::Ros1BagV1 => Reader::BagV1(BagV1Reader::new(file, length)),
            Format::Mcap => Reader::Mcap(Box::new(McapReader::new(file, length))),
            Format::Ros2Db3 => Reader::Db3(Box::new(Db3Reader::new(&self.path, length))),
            Format::Carmen | Format::Player | Format::Csv => {
                Reader::Text(Box::new(TextReader::new(file, length, self.kind, options)))
            }
        }
    }
}

/// A reader, one for each format.
pub(crate) enum Reader {
    Bag(BagReader),
    BagV1(BagV1Reader),
    Mcap(Box<McapReader>),
    Db3(Box<Db3Reader>),
    Text(Box<TextReader>),
}

impl Reader {
    /// The next message of a scan topic; its body in `raw`. `None` at the end of a complete file.
    pub fn next(
        &mut self,
        channels: &mut Channels,
        raw: &mut Raw,
    ) -> Result<Option<(usize, Wire)>, StreamEnd> {
        match self {
            Self::Bag(reader) => reader.next(channels, raw),
            Self::BagV1(reader) => reader.next(channels, raw),
            Self::Mcap(reader) => reader.next(channels, raw),
            Self::Db3(reader) => reader.next(channels, raw),
            Self::Text(reader) => reader.next(channels, raw),
        }
    }

    /// Bytes of the file that were passed.
    pub fn position(&self) -> u64 {
        match self {
            Self::Bag(reader) => reader.position(),
            Self::BagV1(reader) => reader.position(),
            Self::Mcap(reader) => reader.position(),
            Self::Db3(reader) => reader.position(),
            Self::Text(reader) => reader.position(),
        }
    }
}
