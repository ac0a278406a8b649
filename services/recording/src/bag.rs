//! Container of ROS 1 bags, version 2.0 (wiki.ros.org/Bags/Format/2.0), read from front to back.
//!
//! A bag is a row of records: length and header of `name=value` fields, length and data. Chunks
//! hold records themselves, plain or compressed. The index at the end is only counted: a bag that
//! is cut, or was never closed, has none, and front to back is the order of the recorder.
//!
//! **Here:** not the crate `rosbag`: it maps the whole file, takes a slice up to the `index_pos` of
//! the header without a look at the length of the file (a cut bag is a panic), and unpacks whole
//! chunks to whatever size they announce. A chunk is a stream here: memory is one message, and a
//! cut chunk gives the messages before the cut.

use crate::format::ROS1_MAGIC;
use crate::laser_scan::Wire;
use crate::record::{
    CONNECTION_BYTES_MAX, CONNECTIONS_MAX, Fault, field, field_op, field_u32, read_begin, sized,
    time_ns,
};
use crate::section::Section;
use crate::stream::{Channels, Raw, StreamEnd};
use crate::unpack::Budget;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, BufReader, Read};
use std::sync::Arc;

/// Longest header of a record: real ones are below 300 bytes (a topic name is the longest part).
const HEAD_BYTES_MAX: usize = 64 * 1024;

const OP_MESSAGE: u8 = 2;
const OP_BAG_HEADER: u8 = 3;
const OP_INDEX_DATA: u8 = 4;
const OP_CHUNK: u8 = 5;
const OP_CHUNK_INFO: u8 = 6;
const OP_CONNECTION: u8 = 7;
/// Bytes of an entry of index data, version 1: seconds, nanoseconds, offset.
const INDEX_ENTRY_BYTES: u64 = 12;

/// A bag, front to back.
pub(crate) struct BagReader {
    file: Arc<File>,
    length: u64,
    /// Where the next record outside of chunks begins.
    at: u64,
    chunk: Option<Chunk>,
    /// `index_pos`, `conn_count` and `chunk_count` as the bag's header has them.
    announced: [u64; 3],
    chunks: u64,
    connections_in_index: u64,
    chunk_infos: u64,
    /// Index into the scan topics and layout by connection; `None` for other messages.
    connections: BTreeMap<u32, Option<(usize, Wire)>>,
    budget: Budget,
    head: Vec<u8>,
}

/// A chunk that is being read.
struct Chunk {
    records: BufReader<Box<dyn Read + Send>>,
    begin: u64,
    /// The file ends before the chunk does.
    is_cut: bool,
    /// Bytes of records that are still to come, as the header announced.
    left: u64,
}

impl BagReader {
    /// Begins at the first record.
    pub fn new(file: Arc<File>, length: u64) -> Self {
        Self {
            file,
            length,
            at: ROS1_MAGIC.len() as u64,
            chunk: None,
            announced: [0; 3],
            chunks: 0,
            connections_in_index: 0,
            chunk_infos: 0,
            connections: BTreeMap::new(),
            budget: Budget::default(),
            head: Vec::new(),
        }
    }

    /// Bytes of the file that were passed.
    pub fn position(&self) -> u64 {
        self.at
    }

    /// The next message of a scan topic; its body in `raw`. `None` at the end of a complete bag.
    pub fn next(
        &mut self,
        channels: &mut Channels,
        raw: &mut Raw,
    ) -> Result<Option<(usize, Wire)>, StreamEnd> {
        loop {
            if self.chunk.is_some() {
                if let Some(topic) = self.next_in_chunk(channels, raw)? {
                    return Ok(Some(topic));
                }
            } else if self.at == self.length {
                return self.check_complete().map(|()| None);
            } else {
                self.next_record(channels)?;
            }
        }
    }

    /// One record outside of chunks. Afterwards `at` is behind it, and `chunk` set if it was one.
    fn next_record(&mut self, channels: &mut Channels) -> Result<(), StreamEnd> {
        let begin = self.at;
        let section = Section::new(self.file.clone(), begin, self.length);
        let mut reader = BufReader::with_capacity(4096, section);
        self.read_record(&mut reader, channels).map_err(|fault| fault.in_record_at(begin))
    }

    fn read_record(
        &mut self,
        reader: &mut impl Read,
        channels: &mut Channels,
    ) -> Result<(), Fault> {
        let (data_length, read) = read_begin(reader, &mut self.head, HEAD_BYTES_MAX)?;
        let data_begin = self.at + read;
        let mut data_end = data_begin + data_length;
        let is_first = self.at == ROS1_MAGIC.len() as u64;
        let op = field_op(&self.head)?;
        if is_first != (op == OP_BAG_HEADER) {
            return Err(Fault::Bad(format!(
                "record kind {op} at byte {}, expected the bag's header once, at the begin",
                self.at
            )));
        }
        match op {
            OP_BAG_HEADER => {
                let index_pos = field(&self.head, b"index_pos")?;
                self.announced = [
                    u64::from_le_bytes(sized(index_pos, b"index_pos")?),
                    u64::from(field_u32(&self.head, b"conn_count")?),
                    u64::from(field_u32(&self.head, b"chunk_count")?),
                ];
            }
            OP_CHUNK => {
                self.chunks += 1;
                self.chunk = Some(self.open_chunk(data_begin, data_end)?);
                self.at = data_end.min(self.length);
                return Ok(()); // a cut chunk still has a begin
            }
            OP_CHUNK_INFO => self.chunk_infos += 1,
            OP_CONNECTION => {
                self.connections_in_index += 1;
                self.read_connection(reader, data_length, channels)?;
            }
            OP_INDEX_DATA => {
                // Recorders of 2010 announce 20 bytes an entry and write 12: the count is right.
                let entries = u64::from(field_u32(&self.head, b"count")?);
                data_end = data_begin + entries * INDEX_ENTRY_BYTES;
            }
            _ => {} // kinds that a later version may add
        }
        if data_end > self.length {
            return Err(Fault::Short);
        }
        self.at = data_end;
        Ok(())
    }

    fn open_chunk(&mut self, begin: u64, end: u64) -> Result<Chunk, Fault> {
        let left = u64::from(field_u32(&self.head, b"size")?);
        self.budget.announce(left, end.min(self.length)).map_err(Fault::Bad)?;
        let section = Section::new(self.file.clone(), begin, end.min(self.length));
        let packed = BufReader::with_capacity(32 * 1024, section);
        let records: Box<dyn Read + Send> = match field(&self.head, b"compression")? {
            b"none" => Box::new(packed),
            b"bz2" => Box::new(bzip2::bufread::BzDecoder::new(packed)),
            b"lz4" => Box::new(lz4::Decoder::new(packed)?),
            other => {
                return Err(Fault::Bad(format!(
                    "chunk compression is \"{}\", expected none, bz2 or lz4",
                    other.escape_ascii()
                )));
            }
        };
        let records = BufReader::with_capacity(16 * 1024, records);
        Ok(Chunk { records, begin, is_cut: end > self.length, left })
    }

    /// The next scan message of the open chunk, or `None` where the chunk ends.
    fn next_in_chunk(
        &mut self,
        channels: &mut Channels,
        raw: &mut Raw,
    ) -> Result<Option<(usize, Wire)>, StreamEnd> {
        let Some(mut chunk) = self.chunk.take() else { return Ok(None) };
        let result = loop {
            if chunk.left == 0 {
                return Ok(None);
            }
            match self.read_chunk_record(&mut chunk, channels, raw) {
                Ok(None) => {}
                other => break other,
            }
        };
        let (begin, is_cut) = (chunk.begin, chunk.is_cut);
        self.chunk = Some(chunk);
        result.map_err(|fault| match fault {
            Fault::Io(source) if source.raw_os_error().is_some() => StreamEnd::Io(source),
            _ if is_cut => StreamEnd::Cut {
                offset: self.length,
                reason: format!("the file ends in the chunk that begins at byte {begin}"),
            },
            Fault::Short => StreamEnd::Damaged {
                offset: begin,
                reason: "a record reaches beyond the end of its chunk".to_owned(),
            },
            Fault::Bad(reason) => StreamEnd::Damaged { offset: begin, reason },
            Fault::Io(source) => StreamEnd::Damaged {
                offset: begin,
                reason: format!("the chunk cannot be unpacked: {source}"),
            },
        })
    }

    fn read_chunk_record(
        &mut self,
        chunk: &mut Chunk,
        channels: &mut Channels,
        raw: &mut Raw,
    ) -> Result<Option<(usize, Wire)>, Fault> {
        let mut reader = chunk.records.by_ref().take(chunk.left);
        let (data_length, _) = read_begin(&mut reader, &mut self.head, HEAD_BYTES_MAX)?;
        if data_length > reader.limit() {
            return Err(Fault::Short);
        }
        let behind = reader.limit() - data_length;
        let mut scan_topic = None;
        match field_op(&self.head)? {
            OP_CONNECTION => self.read_connection(&mut reader, data_length, channels)?,
            OP_MESSAGE => {
                let id = field_u32(&self.head, b"conn")?;
                let Some(topic) = self.connections.get(&id) else {
                    return Err(Fault::Bad(format!("a message of the unknown connection {id}")));
                };
                if let Some((topic, wire)) = *topic {
                    let time = u64::from_le_bytes(sized(field(&self.head, b"time")?, b"time")?);
                    raw.log_time_ns = time_ns(time as u32, (time >> 32) as u32);
                    raw.read(&mut reader, data_length, wire)?;
                    scan_topic = Some((topic, wire));
                }
            }
            _ => {}
        }
        let rest = reader.limit() - behind;
        if io::copy(&mut reader.take(rest), &mut io::sink())? < rest {
            return Err(Fault::Short);
        }
        chunk.left = behind;
        Ok(scan_topic)
    }

    fn read_connection(
        &mut self,
        reader: &mut impl Read,
        length: u64,
        channels: &mut Channels,
    ) -> Result<(), Fault> {
        let id = field_u32(&self.head, b"conn")?;
        if self.connections.contains_key(&id) {
            return Ok(()); // repeated in every chunk and in the index
        }
        if self.connections.len() >= CONNECTIONS_MAX {
            return Err(Fault::Bad(format!("more than {CONNECTIONS_MAX} connections")));
        }
        if length > CONNECTION_BYTES_MAX as u64 {
            return Err(Fault::Bad(format!(
                "a connection described by {length} bytes, at most {CONNECTION_BYTES_MAX} are read"
            )));
        }
        let mut data = Vec::new();
        reader.take(length).read_to_end(&mut data)?;
        if (data.len() as u64) < length {
            return Err(Fault::Short);
        }
        let topic = field(&self.head, b"topic")?;
        let scan_topic =
            channels.ros1_topic(topic, field(&data, b"type")?, field(&data, b"md5sum")?);
        self.connections.insert(id, scan_topic.map_err(Fault::Bad)?);
        Ok(())
    }

    /// At the end of the file: is everything there that the bag's header announces?
    fn check_complete(&self) -> Result<(), StreamEnd> {
        let [index_pos, connections, chunks] = self.announced;
        let reason = if self.at == ROS1_MAGIC.len() as u64 {
            "the file ends before the bag's header".to_owned()
        } else if index_pos == 0 {
            "the bag was never closed (the recorder was killed): it has no index".to_owned()
        } else if self.chunks < chunks {
            format!("found {} chunks, expected {chunks}", self.chunks)
        } else if self.connections_in_index < connections || self.chunk_infos < chunks {
            format!(
                "its index is cut: found {} connections and {} chunks, expected {connections} and \
                 {chunks}",
                self.connections_in_index, self.chunk_infos
            )
        } else {
            return Ok(());
        };
        Err(StreamEnd::Cut { offset: self.length, reason })
    }
}
