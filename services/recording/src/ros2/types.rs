//! The messages as structs: the order of the fields is their order on the wire.
#![allow(missing_docs)] // the names are those of ROS, which documents them

use protocol::time::SECOND_NS;
use serde::{Serialize, Serializer};

/// `builtin_interfaces/Time`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct Time {
    pub sec: i32,
    pub nanosec: u32,
}

impl Time {
    /// UNIX nanoseconds; `None` after 2038, which ROS 2 cannot say.
    #[must_use]
    pub fn of(stamp_ns: u64) -> Option<Self> {
        let sec = i32::try_from(stamp_ns / SECOND_NS).ok()?;
        Some(Self { sec, nanosec: (stamp_ns % SECOND_NS) as u32 })
    }
}

/// `builtin_interfaces/Duration`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct Duration {
    pub sec: i32,
    pub nanosec: u32,
}

/// `std_msgs/Header`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct Header<'a> {
    pub stamp: Time,
    pub frame_id: &'a str,
}

/// A sequence of bytes (or of `int8`, bit by bit), written at once.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Bytes<'a>(pub &'a [u8]);

impl Serialize for Bytes<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_bytes(self.0)
    }
}

/// `sensor_msgs/LaserScan`.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct LaserScan<'a> {
    pub header: Header<'a>,
    pub angle_min: f32,
    pub angle_max: f32,
    pub angle_increment: f32,
    pub time_increment: f32,
    pub scan_time: f32,
    pub range_min: f32,
    pub range_max: f32,
    pub ranges: &'a [f32],
    pub intensities: &'a [f32],
}

/// `geometry_msgs/Point`, also `Vector3`.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Point {
    pub x: f64,
    pub y: f64,
    pub z: f64,
}

/// `geometry_msgs/Quaternion`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Quaternion {
    pub x: f64,
    pub y: f64,
    pub z: f64,
    pub w: f64,
}

impl Quaternion {
    /// A turn about z, radians.
    #[must_use]
    pub fn of_yaw(yaw_rad: f64) -> Self {
        Self { x: 0.0, y: 0.0, z: (yaw_rad / 2.0).sin(), w: (yaw_rad / 2.0).cos() }
    }
}

impl Default for Quaternion {
    fn default() -> Self {
        Self::of_yaw(0.0)
    }
}

/// `geometry_msgs/Pose`.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Pose {
    pub position: Point,
    pub orientation: Quaternion,
}

/// `nav_msgs/MapMetaData`.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct MapMetaData {
    pub map_load_time: Time,
    pub resolution: f32,
    pub width: u32,
    pub height: u32,
    pub origin: Pose,
}

/// `nav_msgs/OccupancyGrid`; 255 is -1, unknown.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct OccupancyGrid<'a> {
    pub header: Header<'a>,
    pub info: MapMetaData,
    pub data: Bytes<'a>,
}

/// `foxglove_msgs/Vector2`.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Vector2 {
    pub x: f64,
    pub y: f64,
}

/// `foxglove_msgs/PackedElementField`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct PackedField<'a> {
    pub name: &'a str,
    pub offset: u32,
    pub kind: u8,
}

impl PackedField<'_> {
    /// The `type` of a little-endian f64.
    pub const FLOAT64: u8 = 8;
}

/// `foxglove_msgs/Grid`.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Grid<'a> {
    pub timestamp: Time,
    pub frame_id: &'a str,
    pub pose: Pose,
    pub column_count: u32,
    pub cell_size: Vector2,
    pub row_stride: u32,
    pub cell_stride: u32,
    pub fields: Vec<PackedField<'a>>,
    pub data: Bytes<'a>,
}

/// `rcl_interfaces/Log`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct Log<'a> {
    pub stamp: Time,
    pub level: u8,
    pub name: &'a str,
    pub msg: &'a str,
    pub file: &'a str,
    pub function: &'a str,
    pub line: u32,
}

impl Log<'_> {
    pub const INFO: u8 = 20;
    pub const WARN: u8 = 30;
    pub const ERROR: u8 = 40;
}

/// `std_msgs/ColorRGBA`.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Color {
    pub r: f32,
    pub g: f32,
    pub b: f32,
    pub a: f32,
}

/// `sensor_msgs/CompressedImage`; ours is empty.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct NoImage<'a> {
    pub header: Header<'a>,
    pub format: &'a str,
    pub data: Bytes<'a>,
}

/// `visualization_msgs/MeshFile`; ours is empty.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct MeshFile<'a> {
    pub filename: &'a str,
    pub data: Bytes<'a>,
}

/// `visualization_msgs/Marker`.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Marker<'a> {
    pub header: Header<'a>,
    pub ns: &'a str,
    pub id: i32,
    pub kind: i32,
    pub action: i32,
    pub pose: Pose,
    pub scale: Point,
    pub color: Color,
    pub lifetime: Duration,
    pub frame_locked: bool,
    pub points: Vec<Point>,
    pub colors: Vec<Color>,
    pub texture_resource: &'a str,
    pub texture: NoImage<'a>,
    pub uv_coordinates: Vec<[f32; 2]>,
    pub text: &'a str,
    pub mesh_resource: &'a str,
    pub mesh_file: MeshFile<'a>,
    pub mesh_use_embedded_materials: bool,
}

impl Marker<'_> {
    pub const CUBE: i32 = 1;
    pub const LINE_STRIP: i32 = 4;
    pub const TEXT_VIEW_FACING: i32 = 9;
    pub const ADD: i32 = 0;
    pub const DELETE: i32 = 2;
}

/// `visualization_msgs/MarkerArray`.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct MarkerArray<'a> {
    pub markers: Vec<Marker<'a>>,
}

/// `geometry_msgs/Transform`.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Transform {
    pub translation: Point,
    pub rotation: Quaternion,
}

/// `geometry_msgs/TransformStamped`.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct TransformStamped<'a> {
    pub header: Header<'a>,
    pub child_frame_id: &'a str,
    pub transform: Transform,
}

/// `tf2_msgs/TFMessage`.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct TfMessage<'a> {
    pub transforms: Vec<TransformStamped<'a>>,
}

/// `std_msgs/Float32`.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Float32 {
    pub data: f32,
}
