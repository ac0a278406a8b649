//! `tog bag info`: what a recording holds, for people and for programs.

use super::cli::Info;
use super::{BagError, progress_bar};
use crate::cli::Format;
use indicatif::DecimalBytes;
use jiff::Timestamp;
use protocol::time::SECOND_NS;
use recording::{Recording, RecordingInfo, TopicInfo};
use std::fmt::Write as _;
use std::io::Write as _;

/// Topics without scans that are named.
const OTHERS_SHOWN: usize = 12;

/// Runs `tog bag info`; what is to be told if the recording ended early, or holds no scan.
pub fn run(arguments: &Info) -> Result<Option<String>, BagError> {
    let recording = Recording::open_with(&arguments.recording, arguments.reading.options())?;
    let bar = progress_bar("reading", recording.bytes());
    let info = RecordingInfo::look(&recording, arguments.full, |bytes| bar.set_position(bytes))?;
    bar.finish_and_clear();
    let text = match arguments.format {
        Format::Text => text(&info),
        Format::Json => json(&info),
    };
    // Nobody may be there to read it any more.
    let _ = std::io::stdout().write_all(text.as_bytes());
    let has_scans = info.topics.iter().any(|topic| topic.beams > 0);
    Ok(match (info.early_end, info.first_refusal) {
        (Some(early_end), _) => Some(early_end),
        (None, _) if has_scans => None,
        // Which refusal was told above.
        (None, Some(_)) => Some(format!("{}: holds no scan that can be used", info.path)),
        (None, None) => Some(format!("{}: holds no laser scans", info.path)),
    })
}

fn json(info: &RecordingInfo) -> String {
    match serde_json::to_string_pretty(info) {
        Ok(text) => text + "\n",
        Err(error) => format!("{{\"error\":\"{error}\"}}\n"),
    }
}

/// One paragraph for the recording, two lines for each laser.
fn text(info: &RecordingInfo) -> String {
    let mut text = String::new();
    let files = if info.files > 1 { format!(" in {} files", info.files) } else { String::new() };
    // Writing to a String cannot fail.
    let _ = writeln!(text, "{}: {}, {}{files}", info.path, info.format, DecimalBytes(info.bytes));
    if let Some((first_ns, last_ns)) = info.span_ns {
        let span_s = (last_ns - first_ns) as f64 / SECOND_NS as f64;
        let _ = writeln!(text, "{} to {}, {span_s:.3} s", time(first_ns), time(last_ns));
    }
    for topic in &info.topics {
        laser(topic, &mut text);
    }
    let mut others: Vec<String> = (info.others.iter().take(OTHERS_SHOWN))
        .map(|other| format!("{} ({})", other.topic, other.message_type))
        .collect();
    if info.others.len() > OTHERS_SHOWN {
        others.push(format!("and {} more", info.others.len() - OTHERS_SHOWN));
    }
    if !others.is_empty() {
        let _ = writeln!(text, "\nother topics:\n  {}", others.join("\n  "));
    }
    if let Some(sample) = info.sample {
        let _ = writeln!(
            text,
            "from the index: counts, rates and gaps are of all messages (log times), beams and shares of \
             the {} scans in {} of {} chunks; --full reads all",
            sample.scans, sample.chunks, sample.of_chunks
        );
    }
    if let Some(refusal) = &info.first_refusal {
        let refused: u64 = info.topics.iter().map(|topic| topic.refused).sum();
        // The path stands above.
        let refusal = refusal.strip_prefix(&format!("{}: ", info.path)).unwrap_or(refusal);
        let _ = writeln!(text, "{refused} messages were refused, the first: {refusal}");
    }
    text
}

fn laser(topic: &TopicInfo, text: &mut String) {
    let _ = write!(text, "\n{}", topic.topic);
    if !topic.frame_id.is_empty() {
        let _ = write!(text, " (frame {})", topic.frame_id);
    }
    let _ = writeln!(
        text,
        ": {} scans, {:.2} Hz, jitter {:.1} ms, {}",
        topic.scans,
        topic.rate_hz,
        topic.jitter_ms,
        gaps(topic)
    );
    if let Some(geometry) = &topic.geometry {
        let field_deg =
            geometry.angle_increment_rad.to_degrees().abs() * (topic.beams.max(1) - 1) as f64;
        let _ = writeln!(
            text,
            "  {} beams over {field_deg:.1} deg {geometry}; {:.1} % no return, {:.1} % invalid",
            topic.beams,
            100.0 * topic.no_return_share,
            100.0 * topic.invalid_share
        );
    }
    let odd = [
        (topic.out_of_order, "stamps not above the one before"),
        (topic.geometry_changes, "changes of geometry"),
        (topic.refused, "messages refused"),
    ];
    for (count, what) in odd.into_iter().filter(|(count, _)| *count > 0) {
        let _ = writeln!(text, "  {count} {what}");
    }
}

fn gaps(topic: &TopicInfo) -> String {
    match topic.gaps {
        0 => "no gaps".to_owned(),
        1 => format!("1 gap of {:.2} s", topic.longest_gap_s),
        gaps => format!("{gaps} gaps, the longest {:.2} s", topic.longest_gap_s),
    }
}

fn time(stamp_ns: u64) -> String {
    match Timestamp::from_nanosecond(i128::from(stamp_ns)) {
        Ok(time) => format!("{time:.3}"),
        Err(_) => format!("{stamp_ns} ns"),
    }
}
