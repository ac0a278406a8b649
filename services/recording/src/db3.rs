//! ROS 2 bags in SQLite (`.db3`; storage plugin `sqlite3` of rosbag2), in the order of the recorder.
//!
//! Tables `topics(id, name, type, serialization_format, ..)` and `messages(id, topic_id, timestamp,
//! data)`. The file is opened read-only and as immutable: nothing is written beside it and no lock
//! is taken, so a bag on a read-only disk, or in somebody's hands, is read as well.
//!
//! **Here:** a database is a program that a stranger wrote: `messages` and `topics` must be plain tables,
//! the table is walked by its row numbers in small batches (nothing is sorted), and the steps of
//! SQLite are counted: a damaged tree that leads in circles ends. What stands in a write-ahead log
//! beside the file is not read; that it is there is told at the end as a cut.

use crate::error::RecordingError;
use crate::laser_scan::Wire;
use crate::record::CONNECTIONS_MAX;
use crate::stream::{Channels, Raw, StreamEnd, check_name};
use rusqlite::limits::Limit;
use rusqlite::types::ValueRef;
use rusqlite::{Connection, ErrorCode, OpenFlags, Row};
use std::collections::{BTreeMap, VecDeque};
use std::path::{Path, PathBuf};

/// Rows that are fetched at once: a row of a scan has some kB.
const BATCH_ROWS: u32 = 16;
/// Longest row that SQLite touches: a message of any sensor.
const ROW_BYTES_MAX: i32 = 256 << 20;
/// Steps of SQLite between two looks at the count.
const STEPS: i32 = 100_000;
/// Steps for opening, and for every byte of the file: a row of a scan costs about 30.
const STEPS_FREE: u64 = 10_000_000;
const STEPS_PER_BYTE: u64 = 8;
const NO_BAG_ADVICE: &str = "name the .db3 file of a ROS 2 bag, or its directory";

/// A bag, in the order of its rows.
pub(crate) struct Db3Reader {
    path: PathBuf,
    length: u64,
    bag: Option<Bag>,
    batch: VecDeque<(usize, Wire, Raw)>,
    /// Messages with scans that were met, for the progress.
    last_row: i64,
    is_over: bool,
}

/// An open bag.
struct Bag {
    connection: Connection,
    /// Statement that fetches a batch of scans behind a row.
    select: String,
    topics: BTreeMap<i64, (usize, Wire)>,
    rows: i64,
    /// What is missing at the end of the file, if anything is.
    cut: Option<String>,
}

/// Says at once whether the file is a bag at all.
///
/// # Errors
/// [`RecordingError::Foreign`] or `Damaged`.
pub(crate) fn check(path: &Path, length: u64) -> Result<(), RecordingError> {
    let path = path.to_owned();
    match Bag::open(&path, length, &mut Channels::default()) {
        Ok(_) | Err(StreamEnd::Cut { .. }) => Ok(()),
        Err(StreamEnd::Damaged { reason, .. }) => {
            let found = format!("an SQLite file that is no ROS 2 bag ({reason})");
            Err(RecordingError::Foreign { path, found, advice: NO_BAG_ADVICE })
        }
        Err(StreamEnd::Io(source)) => Err(RecordingError::Io { path, action: "read", source }),
    }
}

impl Db3Reader {
    /// Begins at the first row.
    pub fn new(path: &Path, length: u64) -> Self {
        let (path, batch) = (path.to_owned(), VecDeque::new());
        Self { path, length, bag: None, batch, last_row: 0, is_over: false }
    }

    /// Bytes of the file that were passed, by the share of the rows.
    pub fn position(&self) -> u64 {
        let rows = self.bag.as_ref().map_or(0, |bag| bag.rows).max(1);
        let share = self.last_row.clamp(0, rows) as f64 / rows as f64;
        if self.is_over { self.length } else { (self.length as f64 * share) as u64 }
    }

    /// The next message of a scan topic; its body in `raw`. `None` at the end of a complete bag.
    pub fn next(
        &mut self,
        channels: &mut Channels,
        raw: &mut Raw,
    ) -> Result<Option<(usize, Wire)>, StreamEnd> {
        let bag = match &mut self.bag {
            Some(bag) => bag,
            None => self.bag.insert(Bag::open(&self.path, self.length, channels)?),
        };
        if self.batch.is_empty() && !self.is_over {
            let before = self.last_row;
            self.last_row =
                bag.fetch(before, &mut self.batch).map_err(|error| bag.end(&error, self.length))?;
            self.is_over = self.batch.is_empty();
        }
        match self.batch.pop_front() {
            Some((topic, wire, message)) => {
                *raw = message;
                Ok(Some((topic, wire)))
            }
            None => match bag.cut.take() {
                Some(reason) => Err(StreamEnd::Cut { offset: self.length, reason }),
                None => Ok(None),
            },
        }
    }
}

impl Bag {
    /// Opens a bag and notes its topics.
    fn open(path: &Path, length: u64, channels: &mut Channels) -> Result<Self, StreamEnd> {
        let damaged = |reason: String| StreamEnd::Damaged { offset: 0, reason };
        let sql = |error: rusqlite::Error| damaged(words(&error));
        let flags = OpenFlags::SQLITE_OPEN_READ_ONLY
            | OpenFlags::SQLITE_OPEN_URI
            | OpenFlags::SQLITE_OPEN_NO_MUTEX;
        let connection = Connection::open_with_flags(uri(path), flags).map_err(sql)?;
        connection.set_limit(Limit::SQLITE_LIMIT_LENGTH, ROW_BYTES_MAX).map_err(sql)?;
        let mut left = (STEPS_FREE + length.saturating_mul(STEPS_PER_BYTE)) / STEPS as u64;
        let is_over = move || {
            left = left.saturating_sub(1);
            left == 0
        };
        connection.progress_handler(STEPS, Some(is_over)).map_err(sql)?;
        let cut = missing(path, length).map_err(StreamEnd::Io)?;
        if cut.as_ref().is_some_and(|cut| cut.is_short) {
            // Otherwise SQLite refuses a file that lacks its last pages as a whole.
            connection.execute_batch("PRAGMA writable_schema = ON").map_err(sql)?;
        }
        let pragmas = "PRAGMA trusted_schema = OFF; PRAGMA cell_size_check = ON; \
                       PRAGMA mmap_size = 0; PRAGMA cache_size = -2000;";
        connection.execute_batch(pragmas).map_err(sql)?;
        check_tables(&connection).map_err(damaged)?;
        let topics = topics(&connection, channels).map_err(damaged)?;
        let rows = "SELECT max(rowid) FROM messages";
        let rows = connection.query_row(rows, [], |row| row.get::<_, Option<i64>>(0));
        let ids = topics.keys().map(i64::to_string).collect::<Vec<_>>().join(", ");
        let most = Wire::Cdr.bytes_max().max(Wire::CdrMultiEcho.bytes_max());
        let select = format!(
            "SELECT rowid, topic_id, timestamp, length(data), \
             CASE WHEN typeof(data) = 'blob' AND length(data) <= {most} THEN data END \
             FROM messages NOT INDEXED WHERE rowid > ?1 AND topic_id IN ({ids}) \
             ORDER BY rowid LIMIT {BATCH_ROWS}"
        );
        let rows = rows.ok().flatten().unwrap_or(0);
        let cut = cut.map(|cut| cut.words);
        Ok(Self { connection, select, topics, rows, cut })
    }

    /// The next scans behind a row; the row of the last.
    fn fetch(
        &self,
        behind: i64,
        batch: &mut VecDeque<(usize, Wire, Raw)>,
    ) -> Result<i64, rusqlite::Error> {
        let mut select = self.connection.prepare_cached(&self.select)?;
        let mut rows = select.query([behind])?;
        let mut last = behind;
        while let Some(row) = rows.next()? {
            let number: i64 = row.get(0)?;
            if number <= last {
                return Err(rusqlite::Error::IntegralValueOutOfRange(0, number));
            }
            last = number;
            let topic = match row.get_ref(1)? {
                ValueRef::Integer(topic) => self.topics.get(&topic),
                _ => None,
            };
            if let Some((topic, wire)) = topic {
                batch.push_back((*topic, *wire, message(row, *wire)?));
            }
        }
        Ok(last)
    }

    fn end(&self, error: &rusqlite::Error, length: u64) -> StreamEnd {
        let offset = length;
        match &self.cut {
            Some(cut) => StreamEnd::Cut { offset, reason: cut.clone() },
            None => StreamEnd::Damaged { offset, reason: words(error) },
        }
    }
}

/// The message of a row.
fn message(row: &Row<'_>, wire: Wire) -> Result<Raw, rusqlite::Error> {
    let mut raw = Raw::default();
    if let ValueRef::Integer(log_time_ns) = row.get_ref(2)? {
        raw.log_time_ns = u64::try_from(log_time_ns).unwrap_or(0);
    }
    let length = match row.get_ref(3)? {
        ValueRef::Integer(length) => u64::try_from(length).unwrap_or(0),
        _ => 0,
    };
    match row.get_ref(4)? {
        ValueRef::Blob(bytes) => raw.copy(bytes, wire),
        _ => (raw.length, raw.is_too_long) = (length, length > wire.bytes_max() as u64),
    }
    Ok(raw)
}

/// Both tables must be plain tables: a view or a computed column is a program.
fn check_tables(connection: &Connection) -> Result<(), String> {
    for table in ["messages", "topics"] {
        let query = "SELECT count(*) FROM sqlite_schema WHERE name = ?1 AND type = 'table' AND \
                     rootpage > 0";
        let plain: i64 = connection
            .query_row(query, [table], |row| row.get(0))
            .map_err(|error| words(&error))?;
        if plain != 1 {
            return Err(format!("found no table `{table}`"));
        }
        let query = "SELECT count(*) FROM pragma_table_xinfo(?1) WHERE hidden <> 0";
        let computed: i64 = connection
            .query_row(query, [table], |row| row.get(0))
            .map_err(|error| words(&error))?;
        if computed != 0 {
            return Err(format!("table `{table}` has {computed} computed columns"));
        }
    }
    Ok(())
}

/// Notes the topics; those with scans by their number.
fn topics(
    connection: &Connection,
    channels: &mut Channels,
) -> Result<BTreeMap<i64, (usize, Wire)>, String> {
    let query = format!(
        "SELECT id, name, type, serialization_format FROM topics LIMIT {}",
        CONNECTIONS_MAX + 1
    );
    let mut statement = connection.prepare(&query).map_err(|error| words(&error))?;
    let row = |row: &Row<'_>| -> Result<(i64, String, String, String), rusqlite::Error> {
        Ok((row.get(0)?, row.get(1)?, row.get(2)?, row.get(3)?))
    };
    let rows = statement.query_map([], row).map_err(|error| words(&error))?;
    let mut topics = BTreeMap::new();
    for (number, row) in rows.enumerate() {
        if number >= CONNECTIONS_MAX {
            return Err(format!("more than {CONNECTIONS_MAX} topics"));
        }
        let (id, name, message_type, encoding) = row.map_err(|error| words(&error))?;
        check_name(&name)?;
        match Wire::of(&message_type, &encoding) {
            Some(wire) => {
                topics.insert(id, (channels.scan_topic(&name)?, wire));
            }
            None => channels.other(&name, format!("{message_type} in {encoding}"))?,
        }
    }
    Ok(topics)
}

/// What a file lacks.
struct Missing {
    words: String,
    /// The file itself is too short.
    is_short: bool,
}

/// Compares the file with its header, and looks for a log beside it.
fn missing(path: &Path, length: u64) -> std::io::Result<Option<Missing>> {
    use std::io::Read as _;
    let mut head = [0; 100];
    let mut begin = Vec::new();
    std::fs::File::open(path)?.take(100).read_to_end(&mut begin)?;
    head[..begin.len()].copy_from_slice(&begin);
    // Offsets 16 and 28 of the database header (sqlite.org/fileformat2.html), big endian.
    let page_bytes = match u16::from_be_bytes([head[16], head[17]]) {
        1 => 65_536,
        bytes => u64::from(bytes),
    };
    let pages = u64::from(u32::from_be_bytes([head[28], head[29], head[30], head[31]]));
    if pages * page_bytes > length {
        let words = format!("its header announces {pages} pages of {page_bytes} bytes");
        return Ok(Some(Missing { words, is_short: true }));
    }
    let mut log = path.as_os_str().to_owned();
    log.push("-wal");
    Ok(match std::fs::metadata(&log) {
        Ok(metadata) if metadata.len() > 0 => {
            let words = format!(
                "what stands in {} beside it is not read (the recorder still runs, or was killed): \
                 stop it, or open a copy of both once with `sqlite3 COPY .tables`",
                Path::new(&log).display()
            );
            Some(Missing { words, is_short: false })
        }
        _ => None,
    })
}

/// The path as an URI that SQLite opens without a lock.
fn uri(path: &Path) -> String {
    use std::os::unix::ffi::OsStrExt as _;
    let path = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
    let mut uri = String::from("file:");
    for byte in path.as_os_str().as_bytes() {
        match byte {
            b'/' | b'.' | b'-' | b'_' | b'0'..=b'9' | b'a'..=b'z' | b'A'..=b'Z' => {
                uri.push(char::from(*byte));
            }
            byte => uri.push_str(&format!("%{byte:02X}")),
        }
    }
    uri + "?mode=ro&immutable=1"
}

fn words(error: &rusqlite::Error) -> String {
    match error.sqlite_error_code() {
        Some(ErrorCode::OperationInterrupted) => {
            "reading it takes more steps than its size explains".to_owned()
        }
        _ => format!("SQLite says: {error}"),
    }
}
