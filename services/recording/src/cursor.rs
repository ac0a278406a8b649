//! Reads numbers and strings out of a message, never beyond its end.
//!
//! ROS 1 packs without padding, little endian. CDR (ROS 2) aligns a number of 4 bytes to 4, counted
//! behind its encapsulation header, in either byte order. All fields of a LaserScan have 4 bytes.

use std::borrow::Cow;
use std::collections::BTreeMap;

/// A place in a message.
pub(crate) struct Cursor<'a> {
    bytes: &'a [u8],
    at: usize,
    aligned: bool,
    big_endian: bool,
}

impl<'a> Cursor<'a> {
    /// The body of a ROS 1 message, or of a record of MCAP: packed, little endian.
    pub fn packed(bytes: &'a [u8]) -> Self {
        Self { bytes, at: 0, aligned: false, big_endian: false }
    }

    /// A CDR message with its encapsulation header (DDS-XTypes 1.3, table 60).
    pub fn cdr(bytes: &'a [u8]) -> Result<Self, String> {
        let Some((header, body)) = bytes.split_first_chunk::<4>() else {
            return Err(format!("{} bytes, expected a CDR header of 4", bytes.len()));
        };
        let big_endian = match header[..2] {
            [0, 0] => true,
            [0, 1] => false,
            [0x28, 0xb5] => {
                return Err("a message that rosbag2 compressed by itself (zstd), expected plain \
                            CDR: copy the bag with `ros2 bag convert` and no compression"
                    .to_owned());
            }
            _ => {
                return Err(format!(
                    "CDR encapsulation {:02x} {:02x}, expected 00 00 or 00 01 (plain CDR)",
                    header[0], header[1]
                ));
            }
        };
        Ok(Self { bytes: body, at: 0, aligned: true, big_endian })
    }

    /// Bytes that are not read yet.
    pub fn left(&self) -> usize {
        self.bytes.len() - self.at
    }

    fn take(&mut self, count: usize, what: &str) -> Result<&'a [u8], String> {
        if count > self.left() {
            return Err(format!("{what} needs {count} bytes, {} are left", self.left()));
        }
        let taken = &self.bytes[self.at..self.at + count];
        self.at += count;
        Ok(taken)
    }

    fn word(&mut self, what: &str) -> Result<[u8; 4], String> {
        if self.aligned {
            let padding = self.at.next_multiple_of(4) - self.at;
            self.take(padding, what)?;
        }
        let bytes = self.take(4, what)?;
        let mut word = [bytes[0], bytes[1], bytes[2], bytes[3]];
        if self.big_endian {
            word.reverse();
        }
        Ok(word)
    }

    /// An unsigned number.
    pub fn u32(&mut self, what: &str) -> Result<u32, String> {
        self.word(what).map(u32::from_le_bytes)
    }

    /// An unsigned number of two bytes, little endian, not aligned.
    pub fn u16(&mut self, what: &str) -> Result<u16, String> {
        self.take(2, what).map(|bytes| u16::from_le_bytes([bytes[0], bytes[1]]))
    }

    /// An unsigned number of eight bytes, little endian, not aligned.
    pub fn u64(&mut self, what: &str) -> Result<u64, String> {
        let [low, high] = [self.u32(what)?, self.u32(what)?];
        Ok(u64::from(high) << 32 | u64::from(low))
    }

    /// A string (length, bytes).
    pub fn string(&mut self, what: &str) -> Result<Cow<'a, str>, String> {
        let length = self.u32(what)? as usize;
        self.take(length, what).map(String::from_utf8_lossy)
    }

    /// So many bytes.
    pub fn slice(&mut self, count: usize, what: &str) -> Result<&'a [u8], String> {
        self.take(count, what)
    }

    /// A map of strings as MCAP has it: its length in bytes, then keys and values.
    pub fn string_map(&mut self, what: &str) -> Result<BTreeMap<String, String>, String> {
        let length = self.u32(what)? as usize;
        let mut inner = Cursor::packed(self.take(length, what)?);
        let mut map = BTreeMap::new();
        while inner.left() > 0 {
            let key = inner.string(what)?.into_owned();
            map.insert(key, inner.string(what)?.into_owned());
        }
        Ok(map)
    }

    /// All bytes that are left.
    pub fn rest(self) -> &'a [u8] {
        &self.bytes[self.at..]
    }

    /// A float; its bits are kept.
    pub fn f32(&mut self, what: &str) -> Result<f32, String> {
        self.word(what).map(f32::from_le_bytes)
    }

    /// A sequence of floats (count, floats) of at most `count_max`; nothing is allocated before the
    /// count was compared with the bytes that are left.
    pub fn f32s(&mut self, count_max: usize, what: &str) -> Result<Vec<f32>, String> {
        let bytes = self.f32_bytes(count_max, what)?;
        let float = |word: &[u8]| {
            let mut word = [word[0], word[1], word[2], word[3]];
            if self.big_endian {
                word.reverse();
            }
            f32::from_le_bytes(word)
        };
        Ok(bytes.chunks_exact(4).map(float).collect())
    }

    /// The bytes of a sequence of floats, behind its count.
    pub fn f32_bytes(&mut self, count_max: usize, what: &str) -> Result<&'a [u8], String> {
        let count = self.u32(what)? as usize;
        if count > count_max {
            return Err(format!("{count} {what}, expected at most {count_max}"));
        }
        if count * 4 > self.left() {
            return Err(format!(
                "{count} {what} announced, bytes for {} are left",
                self.left() / 4
            ));
        }
        self.take(count * 4, what)
    }
}
