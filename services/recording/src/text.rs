//! Logs of lines: CARMEN, Player, CSV, plain or packed with gzip, front to back.
//!
//! **Here:** a line of a CARMEN or Player log without its end at the end of the file is a cut: the
//! last number may be half a number. A CSV may end so: people write them. What gzip unpacks to is not
//! watched: it is 1032 bytes for one at most.

use crate::carmen::{Carmen, scan_kind};
use crate::csv::{Csv, declared};
use crate::format::{Format, Kind};
use crate::laser_scan::{Decoded, LINE_BYTES_MAX, Wire};
use crate::options::ReadOptions;
use crate::player;
use crate::section::Section;
use crate::stream::{Channels, Raw, StreamEnd};
use flate2::bufread::MultiGzDecoder;
use std::fs::File;
use std::io::{self, BufRead, BufReader, Read};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// How far the begin of a CARMEN log is looked through for what it does not declare.
const SURVEY_BYTES: u64 = 8 << 20;

/// A log, front to back.
pub(crate) struct TextReader {
    lines: Lines,
    dialect: Dialect,
}

enum Dialect {
    Carmen(Carmen),
    Player,
    /// `None` until its first line was read.
    Csv(ReadOptions, Option<Box<Csv>>),
}

/// A file as lines of bounded length.
struct Lines {
    source: Box<dyn BufRead + Send>,
    position: Arc<AtomicU64>,
    length: u64,
    /// The current line; of one that is too long, only the begin.
    line: Vec<u8>,
    /// Its length.
    line_length: u64,
    number: u64,
}

/// Counts the bytes of the file.
struct Counted(Section, Arc<AtomicU64>);

impl Read for Counted {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let got = self.0.read(buffer)?;
        self.1.fetch_add(got as u64, Ordering::Relaxed);
        Ok(got)
    }
}

impl Lines {
    fn new(file: Arc<File>, length: u64, is_gzip: bool) -> Self {
        let position = Arc::new(AtomicU64::new(0));
        let counted = Counted(Section::new(file, 0, length), position.clone());
        let bytes = BufReader::with_capacity(64 * 1024, counted);
        let source: Box<dyn BufRead + Send> = if is_gzip {
            Box::new(BufReader::with_capacity(64 * 1024, MultiGzDecoder::new(bytes)))
        } else {
            Box::new(bytes)
        };
        Self { source, position, length, line: Vec::new(), line_length: 0, number: 0 }
    }

    fn offset(&self) -> u64 {
        self.position.load(Ordering::Relaxed)
    }

    /// Reads the next line into `line`, without its end; false at the end of the file.
    fn next(&mut self, may_lack_end: bool) -> Result<bool, StreamEnd> {
        self.line.clear();
        let limit = LINE_BYTES_MAX as u64 + 1;
        let got = self.source.by_ref().take(limit).read_until(b'\n', &mut self.line);
        self.line_length = got.map_err(|error| self.end(error))? as u64;
        if self.line_length == limit && self.line.last() != Some(&b'\n') {
            self.pass_rest()?;
        }
        self.number += 1;
        if self.line_length == 0 {
            return Ok(false);
        }
        match self.line.pop() {
            Some(b'\n') => {}
            Some(other) if may_lack_end => self.line.push(other),
            _ if self.line_length > limit => {}
            _ => {
                let (offset, number) = (self.length, self.number);
                let reason = format!("the file ends in the middle of line {number}");
                return Err(StreamEnd::Cut { offset, reason });
            }
        }
        if self.line.last() == Some(&b'\r') {
            self.line.pop();
        }
        Ok(true)
    }

    /// Passes what is left of a line that is too long.
    fn pass_rest(&mut self) -> Result<(), StreamEnd> {
        loop {
            let (passed, is_end) = match self.source.fill_buf() {
                Ok([]) => (0, true),
                Ok(bytes) => match bytes.iter().position(|byte| *byte == b'\n') {
                    Some(at) => (at + 1, true),
                    None => (bytes.len(), false),
                },
                Err(error) => return Err(self.end(error)),
            };
            self.source.consume(passed);
            self.line_length += passed as u64;
            if is_end {
                return Ok(());
            }
        }
    }

    fn end(&self, error: io::Error) -> StreamEnd {
        let offset = self.offset();
        if error.raw_os_error().is_some() {
            StreamEnd::Io(error)
        } else if error.kind() == io::ErrorKind::UnexpectedEof {
            let reason = "the gzip file ends before its end".to_owned();
            StreamEnd::Cut { offset: self.length, reason }
        } else {
            let reason = format!("it cannot be unpacked: {error}");
            StreamEnd::Damaged { offset, reason }
        }
    }
}

impl TextReader {
    /// Begins at the first line.
    pub fn new(file: Arc<File>, length: u64, kind: Kind, options: &ReadOptions) -> Self {
        let lines = |file| Lines::new(file, length, kind.is_gzip);
        let dialect = match kind.format {
            Format::Player => Dialect::Player,
            Format::Csv => Dialect::Csv(options.clone(), None),
            _ => {
                let mut carmen = Carmen::default();
                let (mut begin, mut bytes) = (lines(file.clone()), 0);
                // What is wrong with the file is told when it is read.
                while bytes < SURVEY_BYTES && matches!(begin.next(true), Ok(true)) {
                    bytes += begin.line_length;
                    if let Ok(line) = std::str::from_utf8(&begin.line) {
                        carmen.survey(line);
                    }
                }
                Dialect::Carmen(carmen)
            }
        };
        Self { lines: lines(file), dialect }
    }

    /// Bytes of the file that were passed.
    pub fn position(&self) -> u64 {
        self.lines.offset()
    }

    /// The next line with a scan, left in `raw`: index of its topic. `None` at the end of the file.
    pub fn next(
        &mut self,
        channels: &mut Channels,
        raw: &mut Raw,
    ) -> Result<Option<(usize, Wire)>, StreamEnd> {
        let may_lack_end = matches!(self.dialect, Dialect::Csv(..));
        while self.lines.next(may_lack_end)? {
            let (offset, number) = (self.lines.offset(), self.lines.number);
            let damaged =
                |reason| StreamEnd::Damaged { offset, reason: format!("line {number}: {reason}") };
            // A line that is no text holds no scan; a scan with bad bytes is refused when decoded.
            let line = String::from_utf8_lossy(&self.lines.line);
            let Some(laser) = self.dialect.laser(&line).map_err(damaged)? else { continue };
            let topic = channels.scan_topic(&laser).map_err(damaged)?;
            raw.log_time_ns = 0;
            raw.copy(line.as_bytes(), Wire::Text);
            if self.lines.line_length > LINE_BYTES_MAX as u64 {
                (raw.length, raw.is_too_long) = (self.lines.line_length, true);
            }
            return Ok(Some((topic, Wire::Text)));
        }
        Ok(None)
    }

    /// The scan of the line that was left in `raw`.
    ///
    /// # Errors
    /// What was found and what was expected.
    pub fn decode(&self, raw: &Raw) -> Result<Decoded<'static>, String> {
        let line = std::str::from_utf8(&raw.bytes).map_err(|error| error.to_string())?;
        let decoded = match &self.dialect {
            Dialect::Carmen(carmen) => match scan_kind(line) {
                Some(kind) => carmen.decode(line, kind),
                None => Err("no line of a laser".to_owned()),
            },
            Dialect::Player => player::decode(line),
            Dialect::Csv(_, Some(csv)) => csv.decode(),
            Dialect::Csv(_, None) => Err("no row".to_owned()),
        };
        decoded.map_err(|reason| format!("line {}: {reason}", self.lines.number))
    }
}

impl Dialect {
    /// Name of the laser, if the line holds a scan.
    fn laser(&mut self, line: &str) -> Result<Option<String>, String> {
        match self {
            Self::Carmen(_) => Ok(scan_kind(line).map(str::to_owned)),
            Self::Player => Ok(player::laser(line)),
            Self::Csv(_, Some(csv)) => csv.take(line),
            Self::Csv(options, csv) => {
                if line.trim().is_empty() {
                    return Ok(None);
                }
                if line.starts_with('#') {
                    // A comment tells nothing of what parts the fields; a row does.
                    let Some(map) = options.columns.clone() else { return Ok(None) };
                    let mut first = Csv::new(map, line);
                    let laser = first.take(line)?;
                    *csv = laser.is_some().then(|| Box::new(first));
                    return Ok(laser);
                }
                let own = declared(line);
                let is_declaration = own.is_some();
                let Some(map) = options.columns.clone().or(own) else {
                    return Err("it declares no columns".to_owned());
                };
                let csv = csv.insert(Box::new(Csv::new(map, line)));
                if is_declaration { Ok(None) } else { csv.take(line) }
            }
        }
    }
}
