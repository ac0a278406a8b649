//! The checkpoint of an area on disk: collapsed counts per context and the contents of the windows.
//!
//! Layout: magic (8 bytes, holds the version), CRC-32 of the body (u32 LE), length of the body
//! (u64 LE), body = zstd(postcard([`Checkpoint`])). Written beside the old one, synced, then renamed
//! over it: a crash at any moment leaves one of the two whole. A file that cannot be used is kept
//! aside under another name, never overwritten.

use occupancy::{GridConfig, History};
use protocol::geometry::GridGeometry;
use serde::{Deserialize, Serialize};
use std::fs::{self, File};
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};

/// Magic of version 1.
const MAGIC: &[u8; 8] = b"TOGMAP\x00\x01";
const HEAD_BYTES: usize = 8 + 4 + 8;
/// Largest body after decompression: 16 contexts of 16 classes of 1 Mi cells are 2.7 GB; more is not
/// ours.
const BODY_BYTES_MAX: u64 = 4 << 30;
/// zstd level: 1 packs 8 MB of counts in some 10 ms, higher levels save little on varints.
const ZSTD_LEVEL: i32 = 1;

/// What a checkpoint holds.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Checkpoint {
    /// Which grid this is of, in words; only a checkpoint of the very same grid is restored.
    pub grid: String,
    /// Contents of the windows; `None` before the first frame.
    pub history: Option<History>,
    /// Name and counts [class, row, column] of each context.
    pub contexts: Vec<(String, Vec<u64>)>,
}

/// Why a checkpoint cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum CheckpointError {
    /// The file system.
    #[error("cannot {action} checkpoint {}: {source}", path.display())]
    Io {
        /// What was tried.
        action: &'static str,
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// The bytes are not a whole checkpoint.
    #[error("checkpoint {} is damaged: {reason}", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What was found and expected.
        reason: String,
    },
    /// The site file has changed.
    #[error(
        "checkpoint {} is of another grid: found {found}, expected {expected}", path.display()
    )]
    OtherGrid {
        /// The file.
        path: PathBuf,
        /// Grid of the file.
        found: String,
        /// Grid of the site file.
        expected: String,
    },
}

/// Says in words which grid a checkpoint is of: all that gives its counts their meaning.
#[must_use]
pub fn describe(geometry: &GridGeometry, period_ns: u64, config: &GridConfig) -> String {
    let GridGeometry { origin_m, cell_m, columns, rows } = geometry;
    let transit = if config.transit { " and transit" } else { "" };
    format!(
        "{columns} x {rows} cells of {cell_m} m from {origin_m:?} m, period {period_ns} ns, windows \
         of {:?} frames, prototypes {:?}{transit}, known share {}",
        config.windows, config.prototypes, config.known_share_min
    )
}

/// The bytes of a checkpoint.
///
/// # Errors
/// If it cannot be compressed.
pub fn encode(checkpoint: &Checkpoint) -> io::Result<Vec<u8>> {
    let mut bytes = vec![0; HEAD_BYTES];
    let encoder = zstd::Encoder::new(&mut bytes, ZSTD_LEVEL)?;
    let encoder = postcard::to_io(checkpoint, encoder).map_err(io::Error::other)?;
    encoder.finish()?;
    let (head, body) = bytes.split_at_mut(HEAD_BYTES);
    head[..8].copy_from_slice(MAGIC);
    head[8..12].copy_from_slice(&crc32fast::hash(body).to_le_bytes());
    head[12..].copy_from_slice(&(body.len() as u64).to_le_bytes());
    Ok(bytes)
}

/// Reads the bytes of a checkpoint. Never panics, whatever the bytes.
///
/// # Errors
/// What was found and expected.
pub fn decode(bytes: &[u8]) -> Result<Checkpoint, String> {
    let Some((head, body)) = bytes.split_first_chunk::<HEAD_BYTES>() else {
        return Err(format!("{} bytes, expected at least {HEAD_BYTES}", bytes.len()));
    };
    if &head[..8] != MAGIC {
        return Err(format!("it begins with {:?}, expected {MAGIC:?}", &head[..8]));
    }
    let mut crc = [0; 4];
    crc.copy_from_slice(&head[8..12]);
    let mut length = [0; 8];
    length.copy_from_slice(&head[12..]);
    if body.len() as u64 != u64::from_le_bytes(length) {
        return Err(format!("{} bytes, expected {}", body.len(), u64::from_le_bytes(length)));
    }
    let found = crc32fast::hash(body);
    if found != u32::from_le_bytes(crc) {
        return Err(format!("its CRC is {found:#x}, expected {:#x}", u32::from_le_bytes(crc)));
    }
    let mut plain = Vec::new();
    zstd::Decoder::new(body)
        .and_then(|decoder| decoder.take(BODY_BYTES_MAX).read_to_end(&mut plain))
        .map_err(|error| format!("it cannot be unpacked: {error}"))?;
    postcard::from_bytes(&plain).map_err(|error| format!("its content cannot be read: {error}"))
}

/// Writes a checkpoint: beside the old one, synced, renamed over it, directory synced.
///
/// # Errors
/// [`CheckpointError::Io`]; the old checkpoint is then still there.
pub fn write(path: &Path, bytes: &[u8]) -> Result<(), CheckpointError> {
    let failed =
        |action| move |source| CheckpointError::Io { action, path: path.to_owned(), source };
    let beside = path.with_extension("map.writing");
    if let Some(directory) = path.parent() {
        fs::create_dir_all(directory).map_err(failed("create the directory of"))?;
    }
    let mut file = File::create(&beside).map_err(failed("create"))?;
    file.write_all(bytes).and_then(|()| file.sync_all()).map_err(failed("write"))?;
    fs::rename(&beside, path).map_err(failed("replace"))?;
    if let Some(directory) = path.parent() {
        File::open(directory).and_then(|d| d.sync_all()).map_err(failed("sync"))?;
    }
    Ok(())
}

/// Reads a checkpoint of the grid `expected`; `None` if there is none.
///
/// # Errors
/// See [`CheckpointError`].
pub fn read(path: &Path, expected: &str) -> Result<Option<Checkpoint>, CheckpointError> {
    let bytes = match fs::read(path) {
        Ok(bytes) => bytes,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
        Err(source) => {
            return Err(CheckpointError::Io { action: "read", path: path.to_owned(), source });
        }
    };
    let damaged = |reason| CheckpointError::Damaged { path: path.to_owned(), reason };
    let checkpoint = decode(&bytes).map_err(damaged)?;
    if checkpoint.grid != expected {
        return Err(CheckpointError::OtherGrid {
            path: path.to_owned(),
            found: checkpoint.grid,
            expected: expected.to_owned(),
        });
    }
    Ok(Some(checkpoint))
}

/// Moves a checkpoint that cannot be used aside: `<name>.map.unusable-<stamp>`.
///
/// # Errors
/// [`CheckpointError::Io`] if it cannot be renamed: then nothing must be written over it.
pub fn keep_aside(path: &Path, stamp_ns: u64) -> Result<PathBuf, CheckpointError> {
    let aside = path.with_extension(format!("map.unusable-{stamp_ns}"));
    fs::rename(path, &aside).map_err(|source| CheckpointError::Io {
        action: "keep aside",
        path: path.to_owned(),
        source,
    })?;
    Ok(aside)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn checkpoint() -> Checkpoint {
        Checkpoint {
            grid: "2 x 3 cells".to_owned(),
            history: Some(History { last_number: 7, window_frames: 9, ..History::default() }),
            contexts: vec![("always".to_owned(), vec![1, 2, u64::MAX])],
        }
    }

    #[test]
    fn what_was_written_is_read() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("hall.map");
        assert_eq!(read(&path, "2 x 3 cells").unwrap(), None);
        write(&path, &encode(&checkpoint()).unwrap()).unwrap();
        assert_eq!(read(&path, "2 x 3 cells").unwrap(), Some(checkpoint()));
        let other = read(&path, "4 x 4 cells").unwrap_err().to_string();
        assert!(other.contains("found 2 x 3 cells, expected 4 x 4 cells"), "{other}");
    }

    #[test]
    fn a_checkpoint_cut_anywhere_is_damaged_and_can_be_kept_aside() {
        let bytes = encode(&checkpoint()).unwrap();
        for length in 0..bytes.len() {
            assert!(decode(&bytes[..length]).is_err(), "{length}");
        }
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("hall.map");
        fs::write(&path, &bytes[..20]).unwrap();
        let error = read(&path, "2 x 3 cells").unwrap_err();
        assert!(matches!(error, CheckpointError::Damaged { .. }), "{error}");
        let aside = keep_aside(&path, 42).unwrap();
        assert_eq!(aside, directory.path().join("hall.map.unusable-42"));
        assert!(!path.exists() && aside.exists());
    }

    proptest! {
        #[test]
        fn a_flipped_bit_is_found(position in 0usize..10_000, bit in 0u8..8) {
            let mut bytes = encode(&checkpoint()).unwrap();
            let position = position % bytes.len();
            bytes[position] ^= 1 << bit;
            prop_assert!(decode(&bytes).is_err());
        }

        #[test]
        fn any_bytes_are_refused_in_words(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
            prop_assert!(decode(&bytes).is_err());
        }
    }
}
