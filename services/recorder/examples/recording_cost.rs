//! What recording costs: the scans of W1r (four lasers, 75 Hz) through encoder, tape and disk, CPU
//! time a recorded second. `cargo run --release -p recorder --example recording_cost -- [SECONDS]
//! [DIRECTORY]`
//!
//! The scans are imagined beforehand, a second at a time, so that imagining them is not measured. A
//! process's share of shared memory and of waking up is not in it: `tog status` shows that of a
//! running recorder (gauge `cpu_s`).

use process::clock::process_cpu_ns;
use protocol::scan::{ScanGeometry, ScanView};
use protocol::time::SECOND_NS;
use recorder::shelf::Shelf;
use recorder::tape::{Head, Limits, Stamps, Tape};
use recording::TopicSpec;
use recording::ros2::MessageType;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// 2026-01-01T00:00:00Z.
const START_NS: u64 = 1_767_225_600 * SECOND_NS;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let seconds: u64 = arguments.next().map_or(Ok(1200), |text| text.parse())?;
    let directory = arguments.next().map_or_else(std::env::temp_dir, PathBuf::from);
    let directory = directory.join(format!("tog-cost-{}", std::process::id()));
    let mut frames = simulator::workload::w1r(1, u64::MAX)?;
    let period_ns = frames.frame_period_ns;
    let geometries: Vec<ScanGeometry> =
        frames.specs().iter().map(|laser| laser.geometry()).collect();
    let topics = frames
        .specs()
        .iter()
        .map(|laser| TopicSpec::new(format!("/laser_{}/scan", laser.id), MessageType::LaserScan));
    let head = Head { topics: topics.collect(), attachments: Vec::new(), session: BTreeMap::new() };
    let limits = Limits { split_bytes: 512_000_000, split_ns: 3600 * SECOND_NS };
    let mut tape = Tape::new(directory.clone(), head, limits, Shelf::start(None)?);

    let a_second = (SECOND_NS / period_ns) as usize;
    let mut second: Vec<Vec<Vec<f32>>> = vec![frames.buffers(); a_second];
    let (mut cpu_ns, mut bytes, mut stamp_ns) = (0, Vec::new(), START_NS);
    for _ in 0..seconds {
        for out in &mut second {
            frames.frame(out);
        }
        let before = process_cpu_ns();
        for turn in &second {
            stamp_ns += period_ns;
            let mono_ns = stamp_ns - START_NS;
            for (laser, ranges_m) in turn.iter().enumerate() {
                let scan = ScanView { stamp_ns, geometry: geometries[laser], ranges_m };
                recording::encode_scan("laser", 1.0 / 75.0, &scan, &mut bytes)?;
                tape.write(
                    laser,
                    Stamps { log_ns: stamp_ns, publish_ns: stamp_ns },
                    &bytes,
                    mono_ns,
                );
            }
            tape.tick(stamp_ns, mono_ns);
        }
        cpu_ns += process_cpu_ns() - before;
    }
    let before = process_cpu_ns();
    let counts = tape.finish(stamp_ns - START_NS);
    cpu_ns += process_cpu_ns() - before;
    let recorded_s = (stamp_ns - START_NS) as f64 / 1e9;
    let cpu_s = cpu_ns as f64 / 1e9;
    println!(
        "{} scans of {} lasers in {recorded_s:.0} s: {:.1} MB, {cpu_s:.2} s of CPU, {:.3} % of a \
         core, {:.1} us a scan, {:.2} GB a day",
        counts.messages_written,
        geometries.len(),
        counts.bytes_written as f64 / 1e6,
        100.0 * cpu_s / recorded_s,
        cpu_ns as f64 / 1e3 / counts.messages_written as f64,
        counts.bytes_written as f64 / recorded_s * 86_400.0 / 1e9
    );
    if let Some(problem) = tape.problem() {
        return Err(problem.to_owned().into());
    }
    std::fs::remove_dir_all(&directory)?;
    Ok(())
}
