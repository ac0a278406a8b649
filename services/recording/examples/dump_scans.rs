//! Prints every scan of a recording as a line: topic, number, log time, stamp, geometry and ranges
//! as bit patterns. For comparison with other readers (`tests/independent/compare_recordings.py`).

use std::io::Write;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let path = std::env::args().nth(1).ok_or("usage: dump_scans RECORDING")?;
    let recording = recording::Recording::open(path)?;
    let mut out = std::io::BufWriter::new(std::io::stdout().lock());
    for item in recording.scans() {
        let found = item?;
        let (scan, g) = (&found.scan, &found.scan.geometry);
        write!(out, "{} {} {} {}", found.topic, found.number, found.log_time_ns, scan.stamp_ns)?;
        for value in [g.angle_min_rad, g.angle_increment_rad, g.range_min_m, g.range_max_m] {
            write!(out, " {:016x}", value.to_bits())?;
        }
        write!(out, " ")?;
        for range_m in &scan.ranges_m {
            write!(out, "{:08x}", range_m.to_bits())?;
        }
        writeln!(out)?;
    }
    out.flush()?;
    Ok(())
}
