//! Where scans come from. A source gives scans with rising stamps; the shell decides when they go out:
//! a scan is due when it is `stamp_ns` at the site.

use crate::replay::ReplaySource;
use crate::simulator::SimulatorSource;
use protocol::scan::LaserScan;

/// Totals of a source since its start.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct SourceCounts {
    /// Scans handed out.
    pub scans: u64,
    /// Scans dropped because their stamp was not after the last one.
    pub dropped_out_of_order: u64,
    /// Scans dropped because their beams lay otherwise than at the start.
    pub dropped_geometry: u64,
    /// Messages of a recording that could not be read as a scan.
    pub refused: u64,
    /// Scans of a recording that were passed because their time was over at the start.
    pub passed_over: u64,
}

/// Why a source cannot begin or go on.
#[derive(Debug, thiserror::Error)]
pub enum SourceError {
    /// The recording: missing, foreign, damaged, cut.
    #[error(transparent)]
    Recording(#[from] recording::RecordingError),
    /// The clock of the recorder stepped.
    #[error("{}: {step}", path.display())]
    StampStep {
        /// The recording.
        path: std::path::PathBuf,
        /// What was found.
        step: crate::gate::StampStep,
    },
    /// The scene file.
    #[error(transparent)]
    Scene(#[from] scene::SceneError),
    /// The scene file cannot be read.
    #[error("cannot read the scene {}: {source}", path.display())]
    SceneFile {
        /// Which file.
        path: std::path::PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
    /// The site has no such laser.
    #[error("found laser `{laser}`, expected one of the site's lasers: {known}")]
    NoSuchLaser {
        /// What was asked for.
        laser: String,
        /// What is there.
        known: String,
    },
    /// Two lasers of one area whose recordings are not of one time.
    #[error(
        "area {area}: laser {later} begins {found_h} h after laser {earlier}, expected at most \
         {} h: frames are counted through the time between; are both recordings of one day, and by \
         one clock?",
        crate::gate::STEP_MAX_NS / (3600 * protocol::time::SECOND_NS)
    )]
    Apart {
        /// The area.
        area: String,
        /// The laser that begins first.
        earlier: String,
        /// The laser that begins last.
        later: String,
        /// Hours between.
        found_h: u64,
    },
}

impl SourceError {
    /// True if everything up to here was handed out and the rest is lost: the recording is cut or
    /// damaged. The source is over, as at the end of its recording.
    #[must_use]
    pub fn is_early_end(&self) -> bool {
        use recording::RecordingError::{Cut, Damaged};
        matches!(self, Self::Recording(Cut { .. } | Damaged { .. }))
    }
}

/// Something odd that a source met, told at the 1st, 2nd, 4th, 8th.. change, not once a scan.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Oddity {
    /// Short and stable: `scans_out_of_order`, `geometry_changed`, `message_refused`.
    pub code: &'static str,
    /// What was found, what was expected.
    pub text: String,
}

/// The scans of one laser.
pub enum Source {
    /// A recording.
    Replay(Box<ReplaySource>),
    /// An imagined building.
    Simulator(Box<SimulatorSource>),
}

impl Source {
    /// Puts the next scan into `scan`; it is due when it is `scan.stamp_ns` at the site. False at the end.
    ///
    /// # Errors
    /// See [`SourceError`]; nothing follows an error.
    pub fn next(&mut self, scan: &mut LaserScan) -> Result<bool, SourceError> {
        match self {
            Self::Replay(source) => source.next(scan),
            Self::Simulator(source) => {
                source.next(scan);
                Ok(true)
            }
        }
    }

    /// What it is, for the log.
    #[must_use]
    pub fn describe(&self) -> String {
        match self {
            Self::Replay(source) => source.describe(),
            Self::Simulator(source) => source.describe(),
        }
    }

    /// Totals.
    #[must_use]
    pub fn counts(&self) -> SourceCounts {
        match self {
            Self::Replay(source) => source.counts(),
            Self::Simulator(source) => source.counts(),
        }
    }

    /// What was odd since the last call.
    pub fn take_oddities(&mut self) -> Vec<Oddity> {
        match self {
            Self::Replay(source) => source.take_oddities(),
            Self::Simulator(_) => Vec::new(),
        }
    }
}
