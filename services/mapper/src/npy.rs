//! NumPy `.npy` files, the last dimension fastest, little endian. (NumPy Enhancement Proposal 1)
//!
//! Writing: format 1.0; the number of rows may be unknown until [`NpyWriter::finish`]: the header is
//! padded, and put right at the end. Reading: formats 1.0 to 3.0, arrays of u64 of a shape that the
//! caller knows; nothing is allocated before header and length of the file agree with it.

use std::fs::File;
use std::io::{self, BufWriter, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

/// Room for the header: a multiple of 64 that holds eight 20-digit dimensions.
const HEADER_BYTES: usize = 256;

/// A `.npy` file of `rows` x `shape`, written row by row.
#[derive(Debug)]
pub struct NpyWriter {
    file: BufWriter<File>,
    descr: &'static str,
    shape: Vec<usize>,
    rows: usize,
}

impl NpyWriter {
    /// Creates the file. `descr` is NumPy's type (`|u1`, `<u8`, `<f8`), `shape` that of one row.
    ///
    /// # Errors
    /// Those of the file system.
    pub fn create(path: &Path, descr: &'static str, shape: &[usize]) -> io::Result<Self> {
        let mut file = BufWriter::with_capacity(1 << 18, File::create(path)?);
        file.write_all(&[b' '; HEADER_BYTES])?;
        Ok(Self { file, descr, shape: shape.to_vec(), rows: 0 })
    }

    /// Appends one row of bytes, little endian, of the length that the shape says.
    ///
    /// # Errors
    /// Those of the file system.
    pub fn row(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.rows += 1;
        self.file.write_all(bytes)
    }

    /// Writes the header and syncs the file.
    ///
    /// # Errors
    /// Those of the file system.
    pub fn finish(mut self) -> io::Result<()> {
        let dimensions: String =
            std::iter::once(self.rows).chain(self.shape).map(|n| format!("{n}, ")).collect();
        let dictionary = format!(
            "{{'descr': '{}', 'fortran_order': False, 'shape': ({}), }}",
            self.descr,
            dimensions.trim_end()
        );
        let mut header = b"\x93NUMPY\x01\x00".to_vec();
        header.extend(((HEADER_BYTES - 10) as u16).to_le_bytes());
        header.extend(dictionary.as_bytes());
        header.resize(HEADER_BYTES - 1, b' ');
        header.push(b'\n');
        self.file.seek(SeekFrom::Start(0))?;
        self.file.write_all(&header)?;
        self.file.into_inner().map_err(io::IntoInnerError::into_error)?.sync_all()
    }
}

/// Writes an array of u64: rows of `shape`.
///
/// # Errors
/// Those of the file system.
pub fn write_u64(path: &Path, shape: &[usize], values: &[u64]) -> io::Result<()> {
    write_words(path, "<u8", shape, values.iter().map(|value| value.to_le_bytes()))
}

/// Writes an array of f64: rows of `shape`.
///
/// # Errors
/// Those of the file system.
pub fn write_f64(path: &Path, shape: &[usize], values: &[f64]) -> io::Result<()> {
    write_words(path, "<f8", shape, values.iter().map(|value| value.to_le_bytes()))
}

fn write_words(
    path: &Path,
    descr: &'static str,
    shape: &[usize],
    words: impl ExactSizeIterator<Item = [u8; 8]>,
) -> io::Result<()> {
    let row_words = shape.iter().product::<usize>().max(1);
    let mut writer = NpyWriter::create(path, descr, shape)?;
    let mut words = words.peekable();
    let mut row = Vec::with_capacity(row_words * 8);
    while words.peek().is_some() {
        row.clear();
        row.extend(words.by_ref().take(row_words).flatten());
        writer.row(&row)?;
    }
    writer.finish()
}

/// Longest header that is read: NumPy's own are below 200 bytes.
const HEADER_BYTES_MAX: usize = 1 << 16;
/// Most dimensions, as in NumPy.
const DIMENSIONS_MAX: usize = 32;

/// Why an array cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum NpyError {
    /// The file system.
    #[error("cannot read {}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// It is not the array that was expected.
    #[error("{}: {reason}", path.display())]
    Wrong {
        /// The file.
        path: PathBuf,
        /// What was found and expected.
        reason: String,
    },
}

/// What the header of a `.npy` file says.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NpyHeader {
    /// NumPy's type: `<u8`, `|u1`, `<f8`.
    pub descr: String,
    /// Whether the first dimension is the fastest.
    pub fortran_order: bool,
    /// The sides.
    pub shape: Vec<usize>,
    /// Where the numbers begin, bytes.
    pub begin: usize,
}

impl NpyHeader {
    /// Reads the header at the beginning of a file. Never panics, whatever the bytes.
    ///
    /// # Errors
    /// What was found and expected.
    pub fn parse(bytes: &[u8]) -> Result<Self, String> {
        let magic = bytes.get(..6).unwrap_or(bytes);
        if magic != b"\x93NUMPY" {
            return Err(format!(
                "it begins with \"{}\", expected \"\\x93NUMPY\"",
                magic.escape_ascii()
            ));
        }
        let (length, begin) = match bytes.get(6..12) {
            Some(&[1, 0, a, b, _, _]) => (usize::from(u16::from_le_bytes([a, b])), 10),
            Some(&[2 | 3, 0, a, b, c, d]) => (u32::from_le_bytes([a, b, c, d]) as usize, 12),
            Some(&[major, minor, ..]) => {
                return Err(format!("format {major}.{minor}, expected 1.0, 2.0 or 3.0"));
            }
            _ => return Err(format!("{} bytes, expected a header", bytes.len())),
        };
        if length > HEADER_BYTES_MAX {
            return Err(format!("a header of {length} bytes, expected at most {HEADER_BYTES_MAX}"));
        }
        let Some(header) = bytes.get(begin..begin + length) else {
            return Err(format!("{} bytes, its header alone has {length}", bytes.len()));
        };
        let text = std::str::from_utf8(header).map_err(|_| "its header is no text".to_owned())?;
        let (descr, fortran_order, shape) = dictionary(text).ok_or_else(|| {
            format!("its header is {:?}, expected descr, fortran_order, shape", cut(text))
        })?;
        Ok(Self { descr, fortran_order, shape, begin: begin + length })
    }
}

fn cut(text: &str) -> String {
    text.trim_end().chars().take(120).collect()
}

/// `{'descr': '<u8', 'fortran_order': False, 'shape': (2, 3), }`: the three keys in any order, each
/// once, and nothing else.
fn dictionary(text: &str) -> Option<(String, bool, Vec<usize>)> {
    let mut rest = text.trim().strip_prefix('{')?.strip_suffix('}')?.trim();
    let (mut descr, mut fortran_order, mut shape) = (None, None, None);
    while !rest.is_empty() {
        let (key, after) = quoted(rest)?;
        let value = after.trim_start().strip_prefix(':')?.trim_start();
        rest = match key {
            "descr" if descr.is_none() => {
                let (text, after) = quoted(value)?;
                descr = Some(text.to_owned());
                after
            }
            "fortran_order" if fortran_order.is_none() => {
                let falsity = value.strip_prefix("False");
                fortran_order = Some(falsity.is_none());
                falsity.or_else(|| value.strip_prefix("True"))?
            }
            "shape" if shape.is_none() => {
                let (inside, after) = value.strip_prefix('(')?.split_once(')')?;
                shape = Some(sides(inside)?);
                after
            }
            _ => return None,
        };
        rest = rest.trim_start();
        rest = match rest.strip_prefix(',') {
            Some(rest) => rest.trim_start(),
            None if rest.is_empty() => rest,
            None => return None,
        };
    }
    Some((descr?, fortran_order?, shape?))
}

/// A text in quotes, and what follows it.
fn quoted(text: &str) -> Option<(&str, &str)> {
    let quote = text.chars().next().filter(|c| matches!(c, '\'' | '"'))?;
    text[1..].split_once(quote)
}

/// `2, 3, 4` or `2,`; as Python writes a tuple.
fn sides(text: &str) -> Option<Vec<usize>> {
    let text = text.trim();
    let text = text.strip_suffix(',').unwrap_or(text);
    if text.is_empty() {
        return Some(Vec::new());
    }
    let digits = |side: &str| !side.is_empty() && side.bytes().all(|b| b.is_ascii_digit());
    let side = |side: &str| Some(side.trim()).filter(|side| digits(side))?.parse().ok();
    text.split(',')
        .take(DIMENSIONS_MAX + 1)
        .map(side)
        .collect::<Option<Vec<usize>>>()
        .filter(|sides| sides.len() <= DIMENSIONS_MAX)
}

/// Reads an array of u64 of exactly this shape.
///
/// # Errors
/// [`NpyError::Wrong`] says what was found and expected; nothing of a file of another length is read.
pub fn read_u64(path: &Path, shape: &[usize]) -> Result<Vec<u64>, NpyError> {
    let failed = |source| NpyError::Io { path: path.to_owned(), source };
    let wrong = |reason| NpyError::Wrong { path: path.to_owned(), reason };
    let mut file = File::open(path).map_err(failed)?;
    let length = file.metadata().map_err(failed)?.len();
    let mut head = Vec::new();
    Read::by_ref(&mut file)
        .take(HEADER_BYTES_MAX as u64 + 12)
        .read_to_end(&mut head)
        .map_err(failed)?;
    let header = NpyHeader::parse(&head).map_err(wrong)?;
    let expected = format!("`<u8` in C order of shape {shape:?}");
    if header.descr != "<u8" || header.fortran_order || header.shape != shape {
        let NpyHeader { descr, fortran_order, shape, .. } = header;
        let order = if fortran_order { "Fortran" } else { "C" };
        let descr = cut(&descr);
        return Err(wrong(format!(
            "found `{descr}` in {order} order of shape {shape:?}, expected {expected}"
        )));
    }
    let bytes = shape.iter().try_fold(8usize, |bytes, side| bytes.checked_mul(*side));
    let bytes = bytes.ok_or_else(|| wrong(format!("{expected} is more than memory holds")))?;
    let whole = header.begin as u64 + bytes as u64;
    if length != whole {
        return Err(wrong(format!("{length} bytes, expected {whole} for {expected}")));
    }
    let mut data = head.split_off(header.begin);
    data.reserve_exact(bytes.saturating_sub(data.len()));
    let rest = bytes.saturating_sub(data.len()) as u64;
    file.take(rest).read_to_end(&mut data).map_err(failed)?;
    if data.len() != bytes {
        return Err(wrong(format!("{} bytes of numbers, expected {bytes}", data.len())));
    }
    let (words, _) = data.as_chunks::<8>();
    Ok(words.iter().map(|word| u64::from_le_bytes(*word)).collect())
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A header of format 1.0 with this dictionary.
    fn with_header(dictionary: &str) -> Vec<u8> {
        let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
        bytes.extend((dictionary.len() as u16).to_le_bytes());
        bytes.extend(dictionary.as_bytes());
        bytes
    }

    fn read(bytes: &[u8], shape: &[usize]) -> Result<Vec<u64>, String> {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), bytes).unwrap();
        read_u64(file.path(), shape).map_err(|error| error.to_string())
    }

    #[test]
    fn what_was_written_is_read_and_another_shape_is_refused_in_words() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("x.npy");
        let values: Vec<u64> = (0..24).map(|n| n * u64::from(u32::MAX)).collect();
        write_u64(&path, &[3, 4], &values).unwrap();
        assert_eq!(read_u64(&path, &[2, 3, 4]).unwrap(), values);
        let error = read_u64(&path, &[2, 4, 3]).unwrap_err().to_string();
        let words = "found `<u8` in C order of shape [2, 3, 4], expected `<u8` in C order of shape [2, 4, 3]";
        assert!(error.contains(words), "{error}");
    }

    #[test]
    fn headers_as_numpy_writes_them_are_understood() {
        let shape = |text: &str| NpyHeader::parse(&with_header(text)).map(|header| header.shape);
        let plain = "{'descr': '<u8', 'fortran_order': False, 'shape': (2, 3), }      \n";
        assert_eq!(shape(plain), Ok(vec![2, 3]));
        let other = "{\"shape\":(7,),\"fortran_order\":True,\"descr\":\"<f8\"}";
        assert_eq!(shape(other), Ok(vec![7]));
        assert_eq!(shape("{'descr': '<u8', 'fortran_order': False, 'shape': ()}"), Ok(vec![]));
        for wrong in [
            "",
            "{}",
            "{'descr': '<u8'}",
            "{'descr': [('a', '<u8')], 'fortran_order': False, 'shape': ()}",
            "{'descr': '<u8', 'fortran_order': 0, 'shape': (1,)}",
            "{'descr': '<u8', 'fortran_order': False, 'shape': (-1,)}",
            "{'descr': '<u8', 'fortran_order': False, 'shape': (99999999999999999999,)}",
            "{'descr': '<u8', 'fortran_order': False, 'shape': (1,), 'shape': (2,)}",
            "{'descr': '<u8', 'fortran_order': False, 'shape': (1,), 'x': (2,)}",
        ] {
            assert!(shape(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn a_header_that_promises_more_than_the_file_holds_is_refused_before_anything_is_allocated() {
        let side = usize::MAX / 16;
        let dictionary = format!("{{'descr': '<u8', 'fortran_order': False, 'shape': ({side},)}}");
        let error = read(&with_header(&dictionary), &[side]).unwrap_err();
        assert!(error.contains("bytes, expected"), "{error}");
        let error = read(&with_header(&dictionary), &[usize::MAX]).unwrap_err();
        assert!(error.contains("found `<u8`"), "{error}");
    }

    proptest! {
        #[test]
        fn no_bytes_panic(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
            let _ = NpyHeader::parse(&bytes);
            let mut after_magic = b"\x93NUMPY\x01\x00".to_vec();
            after_magic.extend(&bytes);
            prop_assert!(NpyHeader::parse(&after_magic).is_err());
        }

        #[test]
        fn no_dictionary_panics(text in "[{}()'\",: 0-9a-zA-Z<|]{0,80}") {
            let _ = NpyHeader::parse(&with_header(&text));
        }

        #[test]
        fn a_file_with_a_byte_changed_or_cut_is_read_whole_or_refused(
            at in any::<usize>(), byte in any::<u8>(), cut in any::<usize>(),
        ) {
            let mut bytes = with_header("{'descr': '<u8', 'fortran_order': False, 'shape': (2, 4), }");
            bytes.resize(bytes.len() + 64, 7);
            let (at, cut) = (at % bytes.len(), cut % bytes.len());
            prop_assert!(read(&bytes[..cut], &[2, 4]).is_err());
            bytes[at] = byte;
            if let Ok(values) = read(&bytes, &[2, 4]) {
                prop_assert_eq!(values.len(), 8);
            }
        }
    }

    #[test]
    fn the_header_says_how_many_rows_were_written() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("x.npy");
        let mut writer = NpyWriter::create(&path, "|u1", &[1, 2]).unwrap();
        writer.row(&[1, 2]).unwrap();
        writer.row(&[3, 4]).unwrap();
        writer.finish().unwrap();
        let bytes = std::fs::read(path).unwrap();
        assert_eq!(&bytes[..10], b"\x93NUMPY\x01\x00\xf6\x00");
        let header = std::str::from_utf8(&bytes[10..HEADER_BYTES]).unwrap();
        assert_eq!(
            header.trim_end(),
            "{'descr': '|u1', 'fortran_order': False, 'shape': (2, 1, 2,), }"
        );
        assert!(header.ends_with('\n'));
        assert_eq!(&bytes[HEADER_BYTES..], [1, 2, 3, 4]);
    }
}
