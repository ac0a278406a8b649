//! A site file for a recording that comes without one: every laser gets an area of its own, laid
//! round its scans. A recording does not say how its lasers are mounted, so each stands at (0, 0),
//! yaw 0, of its own coordinates; two rooms laid over each other would be a map of neither.
//!
//! The text is written beside the results: put the poses right, give the lasers one area, and
//! replay again with `--site`.

use super::ReplayError;
use protocol::site::Preset;
use recording::{Recording, RecordingIndex};
use std::fmt::Write as _;

/// Edge of a cell where nobody says otherwise, metres.
pub const CELL_M: f64 = 0.1;

/// Text of a site file for the scans of a recording.
///
/// # Errors
/// If a topic has no echo, or spans more than an area may.
pub fn lay_out(
    recording: &Recording,
    index: &RecordingIndex,
    preset: Preset,
) -> Result<String, ReplayError> {
    let mut text = String::from(
        "# Laid round the scans of a recording by `tog replay`. The poses are not known: every laser\n\
         # stands at (0, 0) of an area of its own. Correct them, then replay with --site.\n\
         name = \"replay\"\n",
    );
    let mut ids = Vec::new();
    let path = toml_string(&recording.path().display().to_string());
    for topic in &index.topics {
        let id = identifier(&topic.topic, &ids);
        let grid = topic
            .extent
            .area(CELL_M)
            .map_err(|source| ReplayError::Layout { topic: topic.topic.clone(), source })?;
        let topic = toml_string(&topic.topic);
        let [x_m, y_m] = grid.origin_m;
        // Writing to a String cannot fail.
        let _ = write!(
            text,
            "\n[[area]]\nid = \"{id}\"\norigin_m = [{x_m:?}, {y_m:?}]\ncell_m = {:?}\n\
             columns = {}\nrows = {}\npreset = \"{}\"\n\
             \n[[laser]]\nid = \"{id}\"\narea = \"{id}\"\nx_m = 0.0\ny_m = 0.0\nyaw_deg = 0.0\n\
             source = {{ kind = \"replay\", recording = {path}, topic = {topic}, pace = \"lossless\" }}\n",
            grid.cell_m,
            grid.columns,
            grid.rows,
            preset.name(),
        );
        ids.push(id);
    }
    Ok(text)
}

/// A basic string of TOML, escaped.
fn toml_string(text: &str) -> String {
    let mut quoted = String::from("\"");
    for c in text.chars() {
        match c {
            '"' | '\\' => quoted.extend(['\\', c]),
            c if c.is_control() => {
                let _ = write!(quoted, "\\u{:04X}", u32::from(c));
            }
            c => quoted.push(c),
        }
    }
    quoted.push('"');
    quoted
}

/// `/front_scan` becomes `front_scan`: letters, digits, `-`, `_`, unique, at most 32.
fn identifier(topic: &str, taken: &[String]) -> String {
    let allowed = |c: char| if c.is_ascii_alphanumeric() || c == '-' { c } else { '_' };
    let id: String = topic.trim_matches('/').chars().map(allowed).take(28).collect();
    if id.is_empty() || taken.contains(&id) { format!("{id}_{}", taken.len()) } else { id }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn topics_become_ids_that_a_site_file_takes() {
        assert_eq!(identifier("/front_scan", &[]), "front_scan");
        assert_eq!(identifier("/robot/scan", &[]), "robot_scan");
        assert_eq!(identifier("/scan", &["scan".to_owned()]), "scan_1");
        assert_eq!(identifier("/", &[]), "_0");
    }

    #[test]
    fn any_path_can_be_written_in_toml() {
        assert_eq!(toml_string("a\"b\\c\n"), "\"a\\\"b\\\\c\\u000A\"");
    }
}
