//! The recorder in the site file: what is recorded, where, and how much of it is kept.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Smallest and largest `split_mb`: a file of less is mostly index, one of more takes minutes to
/// recover.
const SPLIT_MB_MAX: f64 = 100_000.0;

/// Records what the site sees and says, as ROS 2 MCAP files. Without this section nothing is
/// recorded.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Recorder {
    /// Which host records what is there: scans and maps of the areas that it runs or follows, scans of its
    /// own lasers, and the events that reach it. The first desk, or the first host, unless set.
    #[schemars(regex(pattern = super::ID_PATTERN))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub host: Option<String>,
    /// Directory of the recordings; one of each run of the recorder is made in it. Relative to the
    /// site file.
    #[schemars(length(min = 1, max = 1024))]
    pub dir: String,
    /// What is recorded.
    #[schemars(length(min = 1, max = 3))]
    pub topics: Vec<RecordedTopics>,
    /// A file is complete, and the next one begins, at this size, megabytes.
    #[schemars(range(min = 1.0, max = SPLIT_MB_MAX))]
    pub split_mb: f64,
    /// A file is complete after this time, seconds.
    #[schemars(range(min = 1.0, max = 604_800.0))]
    pub split_s: f64,
    /// The oldest files go when all together are larger than this, megabytes; all stay unless set.
    #[schemars(range(min = 1.0, max = 1_000_000_000.0))]
    pub keep_mb: Option<f64>,
    /// Files that are older than this go, days; all stay unless set.
    #[schemars(range(min = 0.001, max = 36_500.0))]
    pub keep_days: Option<f64>,
    /// Time between two of the same collapsed map, seconds.
    #[schemars(range(min = 1.0, max = 86_400.0))]
    pub maps_period_s: f64,
    /// Time between two class maps of the same area, seconds.
    #[schemars(range(min = 0.01, max = 86_400.0))]
    pub classes_period_s: f64,
}

impl Default for Recorder {
    fn default() -> Self {
        Self {
            host: None,
            dir: "recordings".to_owned(),
            topics: vec![RecordedTopics::Scans, RecordedTopics::Maps, RecordedTopics::Events],
            split_mb: 512.0,
            split_s: 3600.0,
            keep_mb: None,
            keep_days: None,
            maps_period_s: 60.0,
            classes_period_s: 1.0,
        }
    }
}

impl Recorder {
    /// Whether these are recorded.
    #[must_use]
    pub fn records(&self, topics: RecordedTopics) -> bool {
        self.topics.contains(&topics)
    }

    /// `split_mb` in bytes.
    #[must_use]
    pub fn split_bytes(&self) -> u64 {
        megabytes(self.split_mb)
    }

    /// `keep_mb` in bytes.
    #[must_use]
    pub fn keep_bytes(&self) -> Option<u64> {
        self.keep_mb.map(megabytes)
    }
}

fn megabytes(value_mb: f64) -> u64 {
    (value_mb * 1e6).round() as u64
}

/// A group of topics of a recording.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum RecordedTopics {
    /// Every scan of every laser.
    Scans,
    /// Class maps and collapsed maps.
    Maps,
    /// Events, and where they are.
    Events,
}
