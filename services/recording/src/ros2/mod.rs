//! Messages of ROS 2 that a recording of ours holds: their names, their definitions, their bytes.
//!
//! The definitions are the merged `ros2msg` texts of ROS 2 Jazzy (Foxglove's for `Grid`) without
//! comments, as rosbag2 writes them; the hashes are those of REP 2011, so that `ros2 bag play` knows
//! the types. `tests/independent/recordings.py` decodes every one with other people's programs.

mod encode;
mod types;

pub use encode::{EncodeError, encode};
pub use types::{
    Bytes, Color, Duration, Float32, Grid, Header, LaserScan, Log, MapMetaData, Marker,
    MarkerArray, MeshFile, NoImage, OccupancyGrid, PackedField, Point, Pose, Quaternion, TfMessage,
    Time, Transform, TransformStamped, Vector2,
};

/// A type of message that we write.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum MessageType {
    /// A turn of a laser.
    LaserScan,
    /// A map as every viewer shows it.
    OccupancyGrid,
    /// A map with exact numbers, several a cell.
    Grid,
    /// A line of a log.
    Log,
    /// Things to draw.
    MarkerArray,
    /// Where the lasers are.
    TfMessage,
    /// One number.
    Float32,
}

impl MessageType {
    /// All of them.
    pub const ALL: [Self; 7] = [
        Self::LaserScan,
        Self::OccupancyGrid,
        Self::Grid,
        Self::Log,
        Self::MarkerArray,
        Self::TfMessage,
        Self::Float32,
    ];

    /// Its name in ROS 2.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::LaserScan => "sensor_msgs/msg/LaserScan",
            Self::OccupancyGrid => "nav_msgs/msg/OccupancyGrid",
            Self::Grid => "foxglove_msgs/msg/Grid",
            Self::Log => "rcl_interfaces/msg/Log",
            Self::MarkerArray => "visualization_msgs/msg/MarkerArray",
            Self::TfMessage => "tf2_msgs/msg/TFMessage",
            Self::Float32 => "std_msgs/msg/Float32",
        }
    }

    /// Its definition with those that it contains (schema encoding `ros2msg`).
    #[must_use]
    pub fn definition(self) -> &'static str {
        match self {
            Self::LaserScan => include_str!("schemas/LaserScan.msg"),
            Self::OccupancyGrid => include_str!("schemas/OccupancyGrid.msg"),
            Self::Grid => include_str!("schemas/Grid.msg"),
            Self::Log => include_str!("schemas/Log.msg"),
            Self::MarkerArray => include_str!("schemas/MarkerArray.msg"),
            Self::TfMessage => include_str!("schemas/TFMessage.msg"),
            Self::Float32 => include_str!("schemas/Float32.msg"),
        }
    }

    /// Hash of the definition (REP 2011), for `metadata.yaml`.
    #[must_use]
    pub fn hash(self) -> &'static str {
        match self {
            Self::LaserScan => {
                "RIHS01_64c191398013af96509d518dac71d5164f9382553fce5c1f8cca5be7924bd828"
            }
            Self::OccupancyGrid => {
                "RIHS01_8d348150c12913a31ee0ec170fbf25089e4745d17035792a1ba94d6f0bc0cfc7"
            }
            Self::Grid => "RIHS01_b0c6070e6d466742a149b77eda9ef066c31128f29858419125455d0943b0f867",
            Self::Log => "RIHS01_e28ce254ca8abc06abf92773b74602cdbf116ed34fbaf294fb9f81da9f318eac",
            Self::MarkerArray => {
                "RIHS01_86cb8800b6fb05b5eff1abd7a56f62a5641d3ae9a1c29e78e67e704f1d067dcf"
            }
            Self::TfMessage => {
                "RIHS01_e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087"
            }
            Self::Float32 => {
                "RIHS01_7170d3d8f841f7be3172ce5f4f59f3a4d7f63b0447e8b33327601ad64d83d6e2"
            }
        }
    }

    /// The type of this name.
    #[must_use]
    pub fn of_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|known| known.name() == name)
    }
}
