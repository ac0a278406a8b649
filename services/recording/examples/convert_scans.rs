//! Copies the scans of a recording into a new MCAP file: `convert_scans RECORDING OUT.mcap`.

use recording::{Recording, ScanTopic, ScanWriter};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let (Some(from), Some(to)) = (arguments.next(), arguments.next()) else {
        return Err("usage: convert_scans RECORDING OUT.mcap".into());
    };
    let mut writer = ScanWriter::create(to)?;
    let mut topics = std::collections::BTreeMap::new();
    for item in Recording::open(from)?.scans() {
        let found = item?;
        let number = match topics.get(&found.topic_index) {
            Some(number) => *number,
            None => {
                let (topic, frame_id) = (found.topic.to_string(), "laser".to_owned());
                let number = writer.add_topic(ScanTopic { topic, frame_id, scan_time_s: 0.0 })?;
                topics.insert(found.topic_index, number);
                number
            }
        };
        writer.write(number, found.log_time_ns, &found.scan.view())?;
    }
    writer.finish()?;
    Ok(())
}
