//! The checkpoint of an area on disk: collapsed counts per context and the contents of the windows.
//!
//! Layout: magic (8 bytes, holds the version), CRC-32 of the body (u32 LE), length of the body
//! (u64 LE), body = zstd(postcard([`Checkpoint`])). Written beside the old one, synced, then renamed
//! over it: a crash at any moment leaves one of the two whole. A file that cannot be used is kept
//! aside under another name, never overwritten.

use occupancy::{GridConfig, History};
use process::file::{is_unfit, open_regular, unfit};
use protocol::geometry::GridGeometry;
use serde::{Deserialize, Serialize};
use std::fs::{self, File};
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};

/// Magic of version 1.
const MAGIC: &[u8; 8] = b"TOGMAP\x00\x01";
const HEAD_BYTES: usize = 8 + 4 + 8;
/// Largest body after decompression of any grid: 16 contexts of 16 classes of 1 Mi cells are 2.7 GB;
/// more is not ours.
const BODY_BYTES_MAX: u64 = 4 << 30;
/// Most contexts of a checkpoint: those of a site file, and some that it named before.
const CONTEXTS_MAX: u64 = 32;
/// Descriptions, names and lengths are below that.
const WORDS_BYTES_MAX: u64 = 64 << 10;
/// Most bytes of a u32 and a u64 in postcard: 7 bits a byte.
const VARINT_U32_BYTES: u64 = 5;
const VARINT_U64_BYTES: u64 = 10;
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

/// Most bytes of the body of a checkpoint of a grid before compression: every count of every context
/// at its longest, and every cell flipping in every frame of the longest window.
#[must_use]
pub fn body_bytes_max(config: &GridConfig) -> u64 {
    let (cells, classes) = (config.cells as u64, config.classes() as u64);
    let frames = u64::from(config.longest_frames()) + 1;
    let counts = CONTEXTS_MAX * classes * cells * VARINT_U64_BYTES;
    let planes = 2 * cells.div_ceil(64) * VARINT_U64_BYTES;
    let frame = VARINT_U64_BYTES + VARINT_U32_BYTES + cells.saturating_mul(VARINT_U32_BYTES);
    let all = frames.saturating_mul(frame).saturating_add(counts + planes + WORDS_BYTES_MAX);
    all.min(BODY_BYTES_MAX)
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

/// Reads the bytes of a checkpoint of any grid. Never panics, whatever the bytes.
///
/// # Errors
/// What was found and expected.
pub fn decode(bytes: &[u8]) -> Result<Checkpoint, String> {
    decode_bounded(bytes, BODY_BYTES_MAX)
}

fn decode_bounded(bytes: &[u8], body_bytes_max: u64) -> Result<Checkpoint, String> {
    let Some((head, body)) = bytes.split_first_chunk::<HEAD_BYTES>() else {
        return Err(format!("{} bytes, expected at least {HEAD_BYTES}", bytes.len()));
    };
    let crc = check_head(head, body.len() as u64)?;
    let found = crc32fast::hash(body);
    if found != crc {
        return Err(format!("its CRC is {found:#x}, expected {crc:#x}"));
    }
    let mut plain = Vec::new();
    zstd::Decoder::new(body)
        .and_then(|decoder| decoder.take(body_bytes_max + 1).read_to_end(&mut plain))
        .map_err(|error| format!("it cannot be unpacked: {error}"))?;
    if plain.len() as u64 > body_bytes_max {
        return Err(format!(
            "it unpacks to more than the {body_bytes_max} bytes that a checkpoint of this grid can have"
        ));
    }
    postcard::from_bytes(&plain).map_err(|error| format!("its content cannot be read: {error}"))
}

/// The CRC of the body, if the head is one and fits the length of the body.
fn check_head(head: &[u8; HEAD_BYTES], body_bytes: u64) -> Result<u32, String> {
    if &head[..8] != MAGIC {
        return Err(format!("it begins with {:?}, expected {MAGIC:?}", &head[..8]));
    }
    let mut crc = [0; 4];
    crc.copy_from_slice(&head[8..12]);
    let mut length = [0; 8];
    length.copy_from_slice(&head[12..]);
    if body_bytes != u64::from_le_bytes(length) {
        return Err(format!("{body_bytes} bytes, expected {}", u64::from_le_bytes(length)));
    }
    Ok(u32::from_le_bytes(crc))
}

/// Writes a checkpoint: beside the old one, synced, renamed over it, directory synced.
///
/// # Errors
/// [`CheckpointError::Io`]; the old checkpoint is then still there, and nothing is beside it.
pub fn write(path: &Path, bytes: &[u8]) -> Result<(), CheckpointError> {
    let failed =
        |action| move |source| CheckpointError::Io { action, path: path.to_owned(), source };
    let beside = path.with_extension("map.writing");
    if let Some(directory) = path.parent() {
        fs::create_dir_all(directory).map_err(failed("create the directory of"))?;
    }
    // Of a run that was killed, or put there by somebody: it must not be written through.
    let _ = fs::remove_file(&beside);
    let written = File::create_new(&beside).map_err(failed("create")).and_then(|mut file| {
        file.write_all(bytes).and_then(|()| file.sync_all()).map_err(failed("write"))?;
        fs::rename(&beside, path).map_err(failed("replace"))
    });
    if let Err(error) = written {
        // Half a file is of no use, and may hold the last space of the disk, which the journal needs.
        let _ = fs::remove_file(&beside);
        return Err(error);
    }
    if let Some(directory) = path.parent() {
        File::open(directory).and_then(|d| d.sync_all()).map_err(failed("sync"))?;
    }
    Ok(())
}

/// Reads a checkpoint of the grid `expected`; `None` if there is none. `body_bytes_max` is that of
/// the grid, see [`body_bytes_max`]: takes a small multiple of it in memory at most.
///
/// # Errors
/// See [`CheckpointError`]; what is no regular file, or longer than it can be, is damaged.
pub fn read(
    path: &Path,
    expected: &str,
    body_bytes_max: u64,
) -> Result<Option<Checkpoint>, CheckpointError> {
    let damaged = |reason| CheckpointError::Damaged { path: path.to_owned(), reason };
    let bytes = match read_bytes(path, body_bytes_max) {
        Ok(bytes) => bytes,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
        Err(error) if is_unfit(&error) => return Err(damaged(error.to_string())),
        Err(source) => {
            return Err(CheckpointError::Io { action: "read", path: path.to_owned(), source });
        }
    };
    let checkpoint = decode_bounded(&bytes, body_bytes_max).map_err(damaged)?;
    if checkpoint.grid != expected {
        return Err(CheckpointError::OtherGrid {
            path: path.to_owned(),
            found: checkpoint.grid,
            expected: expected.to_owned(),
        });
    }
    Ok(Some(checkpoint))
}

/// The bytes of a file that has the head of a checkpoint and no more bytes than it can have.
fn read_bytes(path: &Path, body_bytes_max: u64) -> io::Result<Vec<u8>> {
    let (mut file, length) = open_regular(path)?;
    // What cannot be compressed grows by 3 bytes a block of 128 KiB, and some for the frame.
    let bytes_max = HEAD_BYTES as u64 + body_bytes_max + body_bytes_max / 1024 + 1024;
    if length > bytes_max {
        return Err(unfit(format!(
            "it has {length} bytes, a checkpoint of this grid has at most {bytes_max}"
        )));
    }
    let mut bytes = Vec::new();
    Read::by_ref(&mut file).take(HEAD_BYTES as u64).read_to_end(&mut bytes)?;
    if let Some(head) = bytes.first_chunk::<HEAD_BYTES>() {
        check_head(head, length.saturating_sub(HEAD_BYTES as u64)).map_err(unfit)?;
        file.take(length).read_to_end(&mut bytes)?;
    }
    Ok(bytes)
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
        assert_eq!(read(&path, "2 x 3 cells", 1000).unwrap(), None);
        write(&path, &encode(&checkpoint()).unwrap()).unwrap();
        assert_eq!(read(&path, "2 x 3 cells", 1000).unwrap(), Some(checkpoint()));
        let other = read(&path, "4 x 4 cells", 1000).unwrap_err().to_string();
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
        let error = read(&path, "2 x 3 cells", 1000).unwrap_err();
        assert!(matches!(error, CheckpointError::Damaged { .. }), "{error}");
        let aside = keep_aside(&path, 42).unwrap();
        assert_eq!(aside, directory.path().join("hall.map.unusable-42"));
        assert!(!path.exists() && aside.exists());
    }

    #[test]
    fn what_no_checkpoint_of_the_grid_can_be_is_damaged_before_it_takes_memory_or_time() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("hall.map");
        let found = |words: &str| {
            let error = read(&path, "2 x 3 cells", 1000).unwrap_err();
            assert!(matches!(error, CheckpointError::Damaged { .. }), "{error}");
            assert!(error.to_string().contains(words), "{error}");
            keep_aside(&path, 1).unwrap();
            fs::remove_file(directory.path().join("hall.map.unusable-1")).unwrap();
        };
        std::os::unix::fs::symlink("/dev/zero", &path).unwrap();
        found("a device");
        let mode = rustix::fs::Mode::RUSR;
        rustix::fs::mknodat(rustix::fs::CWD, &path, rustix::fs::FileType::Fifo, mode, 0).unwrap();
        found("a pipe");
        File::create_new(&path).unwrap().set_len(4 << 30).unwrap();
        found("it has 4294967296 bytes, a checkpoint of this grid has at most");
        let mut bomb = checkpoint();
        bomb.contexts[0].1 = vec![0; 1_000_000];
        fs::write(&path, encode(&bomb).unwrap()).unwrap();
        assert!(fs::metadata(&path).unwrap().len() < 1000);
        found("unpacks to more than the 1000 bytes");
    }

    #[test]
    fn the_fullest_checkpoint_of_a_grid_is_within_its_bound() {
        let config = GridConfig {
            cells: 70,
            windows: vec![2, 3],
            prototypes: vec![vec![0.1, 0.9]],
            transit: false,
            known_share_min: 0.5,
            contexts: 1,
        };
        let full = Checkpoint {
            grid: "70 cells".to_owned(),
            history: Some(History {
                last_number: u64::MAX,
                window_frames: 3,
                first_hit: vec![u64::MAX; 2],
                first_known: vec![u64::MAX; 2],
                frame_numbers: vec![u64::MAX; 3],
                frame_flips: vec![u32::MAX; 3],
                flips: vec![u32::MAX; 3 * 70],
            }),
            contexts: vec![("always".to_owned(), vec![u64::MAX; 70 * config.classes()]); 32],
        };
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("hall.map");
        write(&path, &encode(&full).unwrap()).unwrap();
        assert_eq!(read(&path, "70 cells", body_bytes_max(&config)).unwrap(), Some(full));
    }

    #[test]
    fn a_write_that_fails_leaves_nothing_beside_the_checkpoint() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("hall.map");
        fs::create_dir_all(path.join("in the way")).unwrap();
        let error = write(&path, &[0; 1000]).unwrap_err().to_string();
        assert!(error.contains("replace"), "{error}");
        assert_eq!(fs::read_dir(directory.path()).unwrap().count(), 1);
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
