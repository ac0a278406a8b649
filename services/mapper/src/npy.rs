//! Writes NumPy `.npy` files (format 1.0), the last dimension fastest, little endian.
//!
//! The number of rows may be unknown while writing: the header is padded, and put right by
//! [`NpyWriter::finish`]. (NumPy Enhancement Proposal 1)

use std::fs::File;
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::path::Path;

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

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

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
