//! What an area has learnt, as bytes: counts, phase, calibration.
//!
//! Layout: [`MAGIC`], CRC-32 of the body (u32, little endian), body (postcard). Open events and the
//! sequence are the outbox's; the levels follow from the calibration and the budget of the site file, so
//! that a new budget takes effect at a restart. Charges and candidates are not kept: they build up again
//! within a minute.

use crate::watch::{Calibration, Phase, Watch};
use protocol::geometry::GridGeometry;
use serde::{Deserialize, Serialize};

/// First bytes of the file: name and version.
const MAGIC: &[u8; 8] = b"TOGNORM1";

/// Why a snapshot is not used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SnapshotError {
    /// Not a snapshot, or of another version.
    #[error("found {found:?} at the start, expected {MAGIC:?}: not a learnt model of this version")]
    Magic {
        /// The first bytes.
        found: Vec<u8>,
    },
    /// The bytes are not those that were written.
    #[error("the checksum does not fit: the file is damaged")]
    Checksum,
    /// The checksum fits, the content does not.
    #[error("the content cannot be read: {0}")]
    Content(String),
    /// Learnt for something else.
    #[error(
        "it was learnt for {found}, the site file says {expected}: what is normal must be learnt anew"
    )]
    Other {
        /// In the file.
        found: String,
        /// In the site file.
        expected: String,
    },
}

#[derive(Serialize, Deserialize)]
struct Saved {
    area: String,
    grid: GridGeometry,
    period_ns: u64,
    timescales_s: Vec<f64>,
    classes: Vec<String>,
    contexts: usize,
    phase: Phase,
    calibration: Calibration,
    learnt: Vec<u64>,
    unfaded: u64,
    counts: Vec<Vec<u32>>,
}

impl Saved {
    /// What the counts are counts of.
    fn shape(&self) -> String {
        format!(
            "area `{}`, {}x{} cells of {} m at {:?}, T = {} ns, timescales {:?} s, classes {}, {} contexts",
            self.area,
            self.grid.columns,
            self.grid.rows,
            self.grid.cell_m,
            self.grid.origin_m,
            self.period_ns,
            self.timescales_s,
            self.classes.join(" "),
            self.contexts
        )
    }
}

impl Watch {
    fn saved(&mut self, with_counts: bool) -> Saved {
        let classes = self.sense.roles.names().to_vec();
        let contexts = self.sense.normal.contexts();
        let (counts, learnt, unfaded) = self.sense.normal.parts();
        Saved {
            area: self.area.id.clone(),
            grid: self.area.grid(),
            period_ns: self.lattice.period_ns(),
            timescales_s: self.area.timescales_s.clone(),
            classes,
            contexts,
            phase: self.phase,
            calibration: self.calibration.clone(),
            learnt: learnt.to_vec(),
            unfaded,
            counts: if with_counts { counts.to_vec() } else { Vec::new() },
        }
    }

    /// What was learnt, as bytes for a file. O(cells).
    #[must_use]
    pub fn snapshot(&mut self) -> Vec<u8> {
        let saved = self.saved(true);
        // Postcard fails only when its output does, and a Vec does not.
        let body = postcard::to_allocvec(&saved).unwrap_or_default();
        let mut bytes = MAGIC.to_vec();
        bytes.extend_from_slice(&crc32fast::hash(&body).to_le_bytes());
        bytes.extend_from_slice(&body);
        bytes
    }

    /// Most bytes of a snapshot: every count at its longest (5 bytes in postcard), and the rest, of
    /// which descriptions and peaks of the calibration are below 1 MiB.
    #[must_use]
    pub fn snapshot_bytes_max(&self) -> u64 {
        let slots = self.sense.roles.names().len() as u64 + 1;
        let counts = self.sense.normal.contexts() as u64 * self.area.grid().cells() as u64 * slots;
        5 * counts + (1 << 20)
    }

    /// Goes on from a snapshot. To be called before the first class map.
    ///
    /// # Errors
    /// If the bytes are damaged or were learnt for another grid, lattice or set of classes; the core
    /// is as before. Never panics, whatever the bytes.
    pub fn restore(&mut self, bytes: &[u8]) -> Result<(), SnapshotError> {
        let Some(rest) = bytes.strip_prefix(MAGIC) else {
            let found = bytes[..bytes.len().min(MAGIC.len())].to_vec();
            return Err(SnapshotError::Magic { found });
        };
        let Some((crc, body)) = rest.split_first_chunk::<4>() else {
            return Err(SnapshotError::Checksum);
        };
        if crc32fast::hash(body) != u32::from_le_bytes(*crc) {
            return Err(SnapshotError::Checksum);
        }
        let saved: Saved = postcard::from_bytes(body)
            .map_err(|error| SnapshotError::Content(error.to_string()))?;
        let (found, expected) = (saved.shape(), self.saved(false).shape());
        if found != expected {
            return Err(SnapshotError::Other { found, expected });
        }
        if !self.sense.normal.put_back(saved.counts, saved.learnt, saved.unfaded) {
            let reason = "the counts do not have the shape that the file states";
            return Err(SnapshotError::Content(reason.to_owned()));
        }
        self.phase = saved.phase;
        self.calibration = saved.calibration;
        self.sense.take_stock();
        if self.phase != Phase::Learning {
            self.doors = self.sense.find_doors();
            self.sense.set_scoring(true, 0);
        }
        if self.phase == Phase::Watching {
            self.set_levels();
            let words = self.watching_words();
            self.notice(words);
        }
        Ok(())
    }
}
