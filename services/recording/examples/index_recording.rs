//! Prints what a recording holds, and how long reading its scans and looking through them took:
//! `index_recording RECORDING`.

use protocol::geometry::Pose;
use recording::{Recording, RecordingIndex};
use std::time::Instant;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let path = std::env::args().nth(1).ok_or("usage: index_recording RECORDING")?;
    let recording = Recording::open(path)?;
    let begin = Instant::now();
    let scans = recording.scans().filter(Result::is_ok).count();
    println!("{scans} scans read in {:.3} s", begin.elapsed().as_secs_f64());
    let begin = Instant::now();
    let index = RecordingIndex::scan(&recording, |_| Some(Pose::default()))?;
    println!("the index took {:.3} s", begin.elapsed().as_secs_f64());
    for topic in &index.topics {
        println!(
            "{}: {} scans of {} beams, {:.2} Hz, {} readings: {} no return, {} invalid",
            topic.topic,
            topic.scans,
            topic.beams,
            topic.rate_hz(),
            topic.readings,
            topic.no_return,
            topic.invalid
        );
    }
    Ok(())
}
