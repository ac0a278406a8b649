//! How much a recording may unpack to: a few hundred bytes of zstd, bzip2 or gzip can announce
//! gigabytes, which would keep a core busy for minutes.
//!
//! The sizes that are announced are added up and compared with the bytes of the file so far: the
//! readers unpack no more than is announced. Scans of 4096 equal ranges, 16 KiB each, cost about 30
//! bytes with their index, which is the most that a real recording reaches.

use mcap::records::op;

/// What any file may unpack to: one large chunk.
const FREE_BYTES: u64 = 64 << 20;
/// Beyond that: bytes that come out of one byte of the file.
const RATIO_MAX: u64 = 1000;

/// What a file has unpacked to so far.
#[derive(Debug, Default)]
pub(crate) struct Budget {
    unpacked: u64,
}

impl Budget {
    /// A `count`-th of what a file may unpack to from the first.
    fn one_of(count: u64) -> Self {
        Self { unpacked: FREE_BYTES - FREE_BYTES / count.max(1) }
    }

    /// Counts `bytes` that are to come out of the first `packed` bytes of a file.
    ///
    /// # Errors
    /// More than any recording unpacks to.
    pub fn announce(&mut self, bytes: u64, packed: u64) -> Result<(), String> {
        self.unpacked = self.unpacked.saturating_add(bytes);
        let bytes_max = packed.saturating_mul(RATIO_MAX).saturating_add(FREE_BYTES);
        if self.unpacked > bytes_max {
            return Err(format!(
                "its first {packed} bytes unpack to {} bytes, expected at most {bytes_max}: this is \
                 made to keep its readers busy",
                self.unpacked
            ));
        }
        Ok(())
    }
}

/// Opcode and length of a record of MCAP.
const RECORD_HEAD_BYTES: usize = 9;
/// Start time, end time and size of a chunk behind it.
const CHUNK_HEAD_BYTES: usize = 24;

/// Looks at the bytes of an MCAP file as they pass, and adds up what its chunks announce.
#[derive(Debug)]
pub(crate) struct ChunkWatch {
    budget: Budget,
    seen: u64,
    /// Bytes until the next record begins.
    skip: u64,
    /// The begin of a record, as far as it was seen.
    head: Vec<u8>,
    fault: Option<String>,
}

impl ChunkWatch {
    /// The first record begins behind `skip` bytes.
    pub fn behind(skip: u64) -> Self {
        Self { budget: Budget::default(), seen: 0, skip, head: Vec::new(), fault: None }
    }

    /// Watches one chunk of `count` that are looked at.
    pub fn of_one_chunk_of(count: u64) -> Self {
        Self { budget: Budget::one_of(count), ..Self::behind(0) }
    }

    /// What is wrong with the bytes so far, once.
    pub fn take_fault(&mut self) -> Option<String> {
        self.fault.take()
    }

    /// The next bytes.
    pub fn see(&mut self, mut bytes: &[u8]) {
        self.seen += bytes.len() as u64;
        while !bytes.is_empty() {
            if self.skip > 0 {
                let passed = self.skip.min(bytes.len() as u64);
                self.skip -= passed;
                bytes = &bytes[passed as usize..];
                continue;
            }
            let is_chunk = self.head.len() >= RECORD_HEAD_BYTES;
            let want = RECORD_HEAD_BYTES + if is_chunk { CHUNK_HEAD_BYTES } else { 0 };
            let (taken, rest) = bytes.split_at(bytes.len().min(want - self.head.len()));
            self.head.extend_from_slice(taken);
            bytes = rest;
            if self.head.len() == want {
                self.take_head();
            }
        }
    }

    /// `head` holds the begin of a record, or of a chunk.
    fn take_head(&mut self) {
        let number = |at: usize| {
            let bytes = self.head.get(at..at + 8).and_then(|bytes| bytes.try_into().ok());
            u64::from_le_bytes(bytes.unwrap_or_default())
        };
        let length = number(1);
        if self.head.len() > RECORD_HEAD_BYTES {
            let size = number(RECORD_HEAD_BYTES + 16);
            self.skip = length - CHUNK_HEAD_BYTES as u64;
            self.fault = self.budget.announce(size, self.seen.saturating_add(self.skip)).err();
        } else if self.head[0] == op::CHUNK && length >= CHUNK_HEAD_BYTES as u64 {
            return; // its own head is still to come
        } else {
            self.skip = length;
        }
        self.head.clear();
    }
}
