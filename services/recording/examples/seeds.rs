//! Writes a small recording of every container, for a fuzzer to begin with: `seeds DIRECTORY`.
#![allow(clippy::unwrap_used)]

#[path = "../tests/common/mod.rs"]
mod common;

use common::{Fields, carmen, db3, gzip, mcap, player, scan_bag, scan_bag_v1};
use std::path::Path;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let directory = std::env::args().nth(1).ok_or("usage: seeds DIRECTORY")?;
    std::fs::create_dir_all(&directory)?;
    let write = |name: &str, bytes| std::fs::write(Path::new(&directory).join(name), bytes);
    let fields = Fields::default();
    for compression in ["none", "bz2", "lz4"] {
        write(compression, scan_bag(&vec![fields.ros1(); 3], compression))?;
    }
    write("v1", scan_bag_v1(&vec![fields.ros1(); 3]))?;
    let cdr = vec![fields.cdr_big_endian(); 3];
    write("cdr", mcap("sensor_msgs/msg/LaserScan", "cdr", &cdr))?;
    write("carmen", carmen(3, 20).into_bytes())?;
    write("carmen.gz", gzip(carmen(3, 20).as_bytes()))?;
    write("player", player(3).into_bytes())?;
    let csv = "t,angle_min,angle_increment:deg,range_max,r...:mm\n1,0,1,8,9,,inf\n";
    write("csv", csv.as_bytes().to_vec())?;
    let bag = Path::new(&directory).join("db3");
    let _ = std::fs::remove_file(&bag);
    db3(&bag, &[("/scan", "sensor_msgs/msg/LaserScan", fields.cdr_big_endian())]);
    write("ros1", mcap("sensor_msgs/LaserScan", "ros1", &[fields.ros1()]))?;
    Ok(())
}
