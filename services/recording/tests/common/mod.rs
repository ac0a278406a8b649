//! Makes recordings by the letter of their specifications, good and bad.
#![allow(dead_code, clippy::unwrap_used)]

use std::io::Write;
use std::path::{Path, PathBuf};

pub const MD5: &str = "90c7ef2dc6895d81024acba2ac42f369";

/// Real recordings, which are not part of the repository.
pub fn shared(file: &str) -> Option<PathBuf> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/recordings");
    let path = root.join(file);
    if !path.exists() {
        println!("skipped: {} is not there", path.display());
    }
    path.exists().then_some(path)
}

/// Fields of a LaserScan message; `Default` is a good one.
#[derive(Clone)]
pub struct Fields {
    pub stamp: (u32, u32),
    pub angle_min: f32,
    pub angle_increment: f32,
    pub range_max: f32,
    pub ranges: Vec<f32>,
    /// Written in front of the ranges instead of their count.
    pub announced: Option<u32>,
}

impl Default for Fields {
    fn default() -> Self {
        Self {
            stamp: (1_700_000_000, 5),
            angle_min: -1.5,
            angle_increment: 0.25,
            range_max: 8.0,
            ranges: vec![1.0, f32::INFINITY, 0.001],
            announced: None,
        }
    }
}

impl Fields {
    fn floats(&self) -> [f32; 7] {
        [self.angle_min, 1.5, self.angle_increment, 0.0, 0.1, 0.02, self.range_max]
    }

    pub fn ros1(&self) -> Vec<u8> {
        let mut out = Vec::new();
        for word in [7, self.stamp.0, self.stamp.1, 5] {
            out.extend(word.to_le_bytes());
        }
        out.extend(b"laser");
        self.floats().iter().for_each(|float| out.extend(float.to_le_bytes()));
        out.extend(self.announced.unwrap_or(self.ranges.len() as u32).to_le_bytes());
        self.ranges.iter().for_each(|float| out.extend(float.to_le_bytes()));
        out.extend(0_u32.to_le_bytes());
        out
    }

    /// CDR, big endian: the byte order that our writer does not write.
    pub fn cdr_big_endian(&self) -> Vec<u8> {
        let mut out = vec![0, 0, 0, 0];
        for word in [self.stamp.0, self.stamp.1, 6] {
            out.extend(word.to_be_bytes());
        }
        out.extend(b"laser\0\0\0"); // six bytes of the string, two of padding
        self.floats().iter().for_each(|float| out.extend(float.to_be_bytes()));
        out.extend(self.announced.unwrap_or(self.ranges.len() as u32).to_be_bytes());
        self.ranges.iter().for_each(|float| out.extend(float.to_be_bytes()));
        out.extend(0_u32.to_be_bytes());
        out
    }
}

fn record(fields: &[(&str, &[u8])], data: &[u8]) -> Vec<u8> {
    let mut head = Vec::new();
    for (name, value) in fields {
        head.extend((name.len() as u32 + 1 + value.len() as u32).to_le_bytes());
        head.extend(name.as_bytes());
        head.push(b'=');
        head.extend(*value);
    }
    let mut out = (head.len() as u32).to_le_bytes().to_vec();
    out.extend(head);
    out.extend((data.len() as u32).to_le_bytes());
    out.extend(data);
    out
}

pub fn connection(id: u32, topic: &str, message_type: &str, md5: &str) -> Vec<u8> {
    let fields = [
        ("topic", topic),
        ("type", message_type),
        ("md5sum", md5),
        ("message_definition", "float32 x"),
    ];
    let mut data = Vec::new();
    for (name, value) in fields {
        data.extend((name.len() as u32 + 1 + value.len() as u32).to_le_bytes());
        data.extend(format!("{name}={value}").as_bytes());
    }
    record(&[("op", &[7]), ("conn", &id.to_le_bytes()), ("topic", topic.as_bytes())], &data)
}

pub fn message(connection: u32, seconds: u32, body: &[u8]) -> Vec<u8> {
    let mut time = seconds.to_le_bytes().to_vec();
    time.extend(0_u32.to_le_bytes());
    record(&[("op", &[2]), ("conn", &connection.to_le_bytes()), ("time", &time)], body)
}

pub fn chunk(records: &[Vec<u8>], compression: &str) -> Vec<u8> {
    let plain = records.concat();
    let packed = match compression {
        "bz2" => {
            let mut writer = bzip2::write::BzEncoder::new(Vec::new(), bzip2::Compression::best());
            writer.write_all(&plain).unwrap();
            writer.finish().unwrap()
        }
        "lz4" => {
            let mut writer = lz4::EncoderBuilder::new().build(Vec::new()).unwrap();
            writer.write_all(&plain).unwrap();
            let (packed, result) = writer.finish();
            result.unwrap();
            packed
        }
        _ => plain.clone(),
    };
    let size = (plain.len() as u32).to_le_bytes();
    record(&[("op", &[5]), ("compression", compression.as_bytes()), ("size", &size)], &packed)
}

/// A bag of these chunks, with the index part that its header announces.
pub fn bag(chunks: &[Vec<u8>], connections: &[Vec<u8>]) -> Vec<u8> {
    let header = |index_pos: u64| {
        let counts = [connections.len() as u32, chunks.len() as u32].map(u32::to_le_bytes);
        let fields: [(&str, &[u8]); 4] = [
            ("op", &[3]),
            ("index_pos", &index_pos.to_le_bytes()),
            ("conn_count", &counts[0]),
            ("chunk_count", &counts[1]),
        ];
        [b"#ROSBAG V2.0\n".to_vec(), record(&fields, &[b' '; 100])].concat()
    };
    let chunks_bytes = chunks.concat();
    let index_pos = (header(0).len() + chunks_bytes.len()) as u64;
    let info = record(&[("op", &[6]), ("ver", &1_u32.to_le_bytes())], &[]);
    let infos = vec![info; chunks.len()].concat();
    [header(index_pos), chunks_bytes, connections.concat(), infos].concat()
}

/// A bag with one chunk of scan messages on `/scan`.
pub fn scan_bag(bodies: &[Vec<u8>], compression: &str) -> Vec<u8> {
    let scans = connection(0, "/scan", "sensor_msgs/LaserScan", MD5);
    let mut records = vec![scans.clone()];
    for (number, body) in bodies.iter().enumerate() {
        records.push(message(0, 1_700_000_000 + number as u32, body));
    }
    bag(&[chunk(&records, compression)], &[scans])
}

/// A bag of version 1.2: `(topic, type, MD5, body)` by message, their definitions and their
/// indexes. `is_indexed`: with a header and an index, as recorders from ROS 0.11 on.
pub fn bag_v1(messages: &[(&str, &str, &str, Vec<u8>)], is_indexed: bool) -> Vec<u8> {
    const MAGIC: &[u8] = b"#ROSRECORD V1.2\n";
    let header = |index_pos: u64| {
        record(&[("index_pos", &index_pos.to_le_bytes()), ("op", &[3])], &[b' '; 50])
    };
    let mut records = Vec::new();
    let mut index = std::collections::BTreeMap::<&str, Vec<u8>>::new();
    for (number, (topic, message_type, md5, body)) in messages.iter().enumerate() {
        let is_new = !index.contains_key(topic);
        let [topic_bytes, md5, kind] = [topic, md5, message_type].map(|text| text.as_bytes());
        if is_new {
            let definition = [
                ("def", &b"float32 x"[..]),
                ("md5", md5),
                ("op", &[1]),
                ("topic", topic_bytes),
                ("type", kind),
            ];
            records.extend(record(&definition, &[]));
        }
        let (sec, nsec) = ((1_700_000_000 + number as u32).to_le_bytes(), 7_u32.to_le_bytes());
        let entry = index.entry(*topic).or_default();
        entry.extend([sec, nsec, [1; 4], [0; 4]].concat());
        let fields = [
            ("md5", md5),
            ("nsec", &nsec),
            ("op", &[2]),
            ("sec", &sec),
            ("topic", topic_bytes),
            ("type", kind),
        ];
        records.extend(record(&fields, body));
    }
    if !is_indexed {
        return [MAGIC, &records].concat();
    }
    let index_pos = (MAGIC.len() + header(0).len() + records.len()) as u64;
    for (topic, entries) in index {
        let count = (entries.len() as u32 / 16).to_le_bytes();
        let (topic, ver) = (topic.as_bytes(), [0; 4]);
        let fields = [("count", &count[..]), ("op", &[4]), ("topic", topic), ("ver", &ver)];
        records.extend(record(&fields, &entries));
    }
    [MAGIC, &header(index_pos), &records].concat()
}

/// A bag of version 1.2 with scans on `/scan` and, in between, messages of another type.
pub fn scan_bag_v1(bodies: &[Vec<u8>]) -> Vec<u8> {
    let other = ("odom", "nav_msgs/Odometry", MD5, vec![9; 40]);
    let messages: Vec<_> = (bodies.iter())
        .flat_map(|body| [("/scan", "sensor_msgs/LaserScan", MD5, body.clone()), other.clone()])
        .collect();
    bag_v1(&messages, true)
}

/// An MCAP file with one channel.
pub fn mcap(schema: &str, encoding: &str, bodies: &[Vec<u8>]) -> Vec<u8> {
    let options = mcap::WriteOptions::new().compression_threads(0);
    let mut writer = options.create(std::io::Cursor::new(Vec::new())).unwrap();
    let schema = writer.add_schema(schema, "ros2msg", b"float32 x").unwrap();
    let channel_id =
        writer.add_channel(schema, "/scan", encoding, &std::collections::BTreeMap::new()).unwrap();
    for (number, body) in bodies.iter().enumerate() {
        let log_time = 1_700_000_000_000_000_000 + number as u64;
        let header = mcap::records::MessageHeader {
            channel_id,
            sequence: number as u32,
            log_time,
            publish_time: log_time,
        };
        writer.write_to_known_channel(&header, body).unwrap();
    }
    writer.finish().unwrap();
    writer.into_inner().into_inner()
}

/// Writes bytes to a file that lives as long as the directory that is returned.
pub fn file(bytes: &[u8]) -> (tempfile::TempDir, PathBuf) {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("recording");
    std::fs::write(&path, bytes).unwrap();
    (directory, path)
}

/// Bytes packed with gzip.
pub fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut writer = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::default());
    writer.write_all(bytes).unwrap();
    writer.finish().unwrap()
}

/// A CARMEN log of scans of `beams` ranges, with odometry between them.
pub fn carmen(scans: usize, beams: usize) -> String {
    let mut text = String::from("# message formats defined: PARAM ODOM FLASER\nPARAM x 1 host 0\n");
    for scan in 0..scans {
        text += &format!("ODOM 0 0 0 0 0 0 {scan}.25 host {scan}.25\nFLASER {beams}");
        (0..beams).for_each(|beam| text += &format!(" {}.{:02}", 1 + beam % 7, scan));
        text += &format!(" 0 0 0 0 0 0 {}.5 host {scan}.75\n", 100 + scan);
    }
    text
}

/// A log of Player's `writelog` with scans of two lasers.
pub fn player(scans: usize) -> String {
    let mut text = String::from(
        "## Player version 3.0.2 \n## File version 0.3.0 \n## Format: \n\
         0000000000.000 16777343 6665 laser 00 004 001 +0.000 +0.000 +0.000 0.15 0.15\n",
    );
    for scan in 0..scans {
        let (time, index) = (format!("{:010}.{:03}", 1000 + scan, scan), scan % 2);
        text += &format!(
            "{time} 16777343 6665 laser {index:02} 001 001 {scan:04} -0.5000 +0.5000 +0.5000 +8.1920 \
             0003 1.500 00 8.191 01 8.187 00 \n"
        );
    }
    text
}

/// A ROS 2 bag in SQLite: `(topic, type, body)` by message.
pub fn db3(path: &Path, messages: &[(&str, &str, Vec<u8>)]) {
    let bag = rusqlite::Connection::open(path).unwrap();
    bag.execute_batch(
        "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL, \
         serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL);
         CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, \
         timestamp INTEGER NOT NULL, data BLOB NOT NULL);
         CREATE INDEX timestamp_idx ON messages (timestamp ASC);",
    )
    .unwrap();
    let mut topics: Vec<&str> = Vec::new();
    for (number, (topic, message_type, body)) in messages.iter().enumerate() {
        let id = topics.iter().position(|known| known == topic).unwrap_or_else(|| {
            topics.push(topic);
            let row = (topics.len() as i64, topic, message_type);
            bag.execute("INSERT INTO topics VALUES (?1, ?2, ?3, 'cdr', '')", row).unwrap();
            topics.len() - 1
        });
        let row = (id as i64 + 1, 1_700_000_000_000_000_000 + number as i64, body);
        let insert = "INSERT INTO messages(topic_id, timestamp, data) VALUES (?1, ?2, ?3)";
        bag.execute(insert, row).unwrap();
    }
}

/// A MultiEchoLaserScan of ROS 1 with these (ranges, intensities) by beam.
pub fn multi_echo(beams: &[(&[f32], &[f32])]) -> Vec<u8> {
    let mut body = Fields { ranges: Vec::new(), ..Fields::default() }.ros1();
    body.truncate(body.len() - 8); // both empty sequences
    for part in [0, 1] {
        body.extend((beams.len() as u32).to_le_bytes());
        for beam in beams {
            let floats = [beam.0, beam.1][part];
            body.extend((floats.len() as u32).to_le_bytes());
            floats.iter().for_each(|float| body.extend(float.to_le_bytes()));
        }
    }
    body
}

/// Everything that a recording gives.
pub fn read_with(
    path: &Path,
    options: recording::ReadOptions,
) -> (Vec<recording::RecordedScan>, Vec<recording::RecordingError>) {
    let (mut scans, mut errors) = (Vec::new(), Vec::new());
    for item in recording::Recording::open_with(path, options).unwrap().scans() {
        match item {
            Ok(scan) => scans.push(scan),
            Err(error) => errors.push(error),
        }
    }
    (scans, errors)
}

/// Everything that these bytes give.
pub fn read(bytes: &[u8]) -> (Vec<recording::RecordedScan>, Vec<recording::RecordingError>) {
    let (_directory, path) = file(bytes);
    read_with(&path, recording::ReadOptions::default())
}
