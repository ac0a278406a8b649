//! Recordings made by the letter, good and bad, and site files for them.

use protocol::scan::{LaserScan, ScanGeometry};
use protocol::time::{MILLISECOND_NS, SECOND_NS};
use recording::{ScanTopic, ScanWriter, as_recorded};
use scene::{Scene, World};
use std::fmt::Write as _;
use std::path::Path;

/// 2026-01-01T00:00:00Z, nanoseconds.
pub const NEW_YEAR_NS: u64 = 1_767_225_600 * SECOND_NS;
/// Beams of [`corner`].
pub const BEAMS: usize = 181;
/// An area that holds what [`corner`] sees, to be given to [`site`].
pub const CORNER_AREA: &str = "origin_m = [-0.5, -5.0]\ncolumns = 60\nrows = 100\n\
                               timescales_s = [1, 3, 10]\n";

/// Writes scans, each with the number of its topic, as MCAP. They are logged in this order, a tenth of
/// a second apart, whatever their stamps say.
pub fn write(path: &Path, topics: &[&str], scans: impl IntoIterator<Item = (usize, LaserScan)>) {
    let mut writer = ScanWriter::create(path).unwrap();
    for topic in topics {
        let (topic, frame_id) = ((*topic).to_owned(), "laser".to_owned());
        writer.add_topic(ScanTopic { topic, frame_id, scan_time_s: 0.1 }).unwrap();
    }
    for (number, (topic, scan)) in scans.into_iter().enumerate() {
        let log_time_ns = NEW_YEAR_NS + number as u64 * 100 * MILLISECOND_NS;
        writer.write(topic, log_time_ns, &scan.view()).unwrap();
    }
    writer.finish().unwrap();
}

/// Scan `number` of 10 a second of one laser in a corner: 181 beams over 180 degrees, a wall ahead at
/// 4 m, no echo to the sides; from second 12 to second 16 somebody stands 2 m ahead.
pub fn corner(number: u64) -> LaserScan {
    let geometry = as_recorded(&ScanGeometry {
        angle_min_rad: -std::f64::consts::FRAC_PI_2,
        angle_increment_rad: std::f64::consts::PI / 180.0,
        range_min_m: 0.05,
        range_max_m: 8.0,
    });
    // Half a centimetre of noise, from a hash: Knuth's multiplier.
    let noise_m = |beam: usize| {
        let hash = (number * BEAMS as u64 + beam as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        (hash >> 40) as f64 / f64::from(1 << 24) * 0.01 - 0.005
    };
    let range_m = |beam: usize| match geometry.bearing_rad(beam) {
        bearing if bearing.abs() < 0.08 && (120..160).contains(&number) => {
            (2.0 + noise_m(beam)) as f32
        }
        bearing if bearing.abs() < 0.8 => (4.0 / bearing.cos() + noise_m(beam)) as f32,
        _ => f32::INFINITY,
    };
    LaserScan {
        stamp_ns: NEW_YEAR_NS + number * SECOND_NS / 10 + 7 * MILLISECOND_NS,
        device_stamp_ns: 0,
        geometry,
        ranges_m: (0..BEAMS).map(range_m).collect(),
    }
}

/// A site file with one area, fed from a recording: lasers as `(id, topic, [x, y, yaw in degrees])`.
pub fn site(recording: &Path, area: &str, lasers: &[(&str, &str, [f64; 3])]) -> String {
    let mut text =
        format!("name = \"made\"\ntimezone = \"UTC\"\n\n[[area]]\nid = \"hall\"\n{area}\n");
    for (id, topic, [x_m, y_m, yaw_deg]) in lasers {
        let recording = recording.display();
        let _ = write!(
            text,
            "\n[[laser]]\nid = \"{id}\"\narea = \"hall\"\nx_m = {x_m:?}\ny_m = {y_m:?}\n\
             yaw_deg = {yaw_deg:?}\nsource = {{ kind = \"replay\", recording = \"{recording}\", \
             topic = \"{topic}\", pace = \"lossless\" }}\n"
        );
    }
    text
}

/// Records `seconds` of the built-in room as its four lasers see it, each with a rate and a phase of its
/// own, so that no two scans share a stamp; returns a site file for it.
pub fn room(recording: &Path, seconds: u64) -> String {
    let mut world = World::new(Scene::builtin("room").unwrap(), 3).unwrap();
    let lasers = world.scene().lasers.clone();
    let from_ns = world.scene().stamp_ns(600.0);
    let mut stamps: Vec<(u64, usize)> = Vec::new();
    for laser in 0..lasers.len() {
        let (period_ns, phase_ns) = ([100, 133, 75, 140][laser % 4], [0, 34, 9, 88][laser % 4]);
        let stamp_ns = |turn| from_ns + (phase_ns + turn * period_ns) * MILLISECOND_NS;
        let turns = seconds * 1000 / period_ns;
        stamps.extend((0..turns).map(|turn| (stamp_ns(turn), laser)));
    }
    stamps.sort_unstable();
    let topics: Vec<String> = lasers.iter().map(|laser| format!("/{}", laser.id)).collect();
    let scans = stamps.into_iter().map(|(stamp_ns, laser)| {
        let geometry = as_recorded(&lasers[laser].geometry());
        let mut scan = LaserScan { stamp_ns, geometry, ..LaserScan::default() };
        let t_s = world.scene().time_s(stamp_ns);
        world.scan(&lasers[laser], t_s, &mut scan.ranges_m);
        (laser, scan)
    });
    write(recording, &topics.iter().map(String::as_str).collect::<Vec<_>>(), scans);
    let poses: Vec<(&str, &str, [f64; 3])> = (lasers.iter().zip(&topics))
        .map(|(laser, topic)| {
            (laser.id.as_str(), topic.as_str(), [laser.x_m, laser.y_m, laser.yaw_deg])
        })
        .collect();
    let area = "origin_m = [-0.5, -0.5]\ncell_m = 0.1\ncolumns = 110\nrows = 100\n\
                timescales_s = [1, 4, 12]\n";
    site(recording, area, &poses)
}

/// A ROS 1 bag without a message: its first line and a header that promises nothing.
pub fn empty_bag() -> Vec<u8> {
    let field = |name: &str, value: &[u8]| {
        let length = (name.len() + 1 + value.len()) as u32;
        [&length.to_le_bytes()[..], name.as_bytes(), b"=", value].concat()
    };
    let head = [
        field("op", &[3]),
        field("index_pos", &4117_u64.to_le_bytes()),
        field("conn_count", &0_u32.to_le_bytes()),
        field("chunk_count", &0_u32.to_le_bytes()),
    ]
    .concat();
    let padding = vec![b' '; 4096 - head.len()]; // as the format's page lays it down
    let sizes = [head.len() as u32, padding.len() as u32].map(u32::to_le_bytes);
    [&b"#ROSBAG V2.0\n"[..], &sizes[0], &head, &sizes[1], &padding].concat()
}
