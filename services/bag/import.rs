//! `tog bag import`: the scans of any recording as our own, and the copying that `export` shares.
//!
//! **Here:** topics keep their names, so that a site file that names a topic of the recording finds it in
//! the copy; a name that ROS does not know (of a Player log) is made one. With `--laser front=TOPIC` the
//! topic is `/front` and the coordinates `laser_front`, as `tools/simulator` names them.

use super::cli::{Import, OutFormat, Selection};
use super::export::Sink;
use super::target::target;
use super::{BagError, progress_bar};
use protocol::time::SECOND_NS;
use recording::{RecordedScan, Recording, RecordingError};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Runs `tog bag import`.
pub fn run(arguments: &Import) -> Result<Option<String>, BagError> {
    if arguments.out.extension().is_some_and(|ending| ending != "mcap") {
        return Err(BagError::NotMcap(arguments.out.clone()));
    }
    copy(&arguments.recording, &arguments.out, OutFormat::Mcap, &arguments.selection)
}

/// Copies the scans of a recording; what is to be told if it ended early.
pub fn copy(
    from: &Path,
    out: &Path,
    format: OutFormat,
    selection: &Selection,
) -> Result<Option<String>, BagError> {
    check_lasers(selection)?;
    let out = &check_out(from, out, selection.force)?;
    let recording = Recording::open_with(from, selection.reading.options())?;
    let mut copy = Copy::new(selection, Sink::new(&recording, out, format)?);
    match copy.all(&recording) {
        Ok(early_end) => {
            copy.finish(out)?;
            let told = |error| format!("{error}; what came before is written to {}", out.display());
            Ok(early_end.map(told))
        }
        Err(error) => {
            copy.sink.abandon();
            Err(error)
        }
    }
}

/// Refuses a mapping that is none.
fn check_lasers(selection: &Selection) -> Result<(), BagError> {
    for (index, laser) in selection.lasers.iter().enumerate() {
        for other in &selection.lasers[..index] {
            if other.laser == laser.laser {
                return Err(BagError::Twice(laser.laser.clone()));
            }
            if other.topic == laser.topic {
                return Err(BagError::Twice(laser.topic.clone()));
            }
        }
    }
    Ok(())
}

/// Refuses to write over something; where to write.
fn check_out(from: &Path, out: &Path, force: bool) -> Result<PathBuf, BagError> {
    let same =
        |a: std::io::Result<_>, b: std::io::Result<_>| matches!((a, b), (Ok(a), Ok(b)) if a == b);
    if same(from.canonicalize(), out.canonicalize()) {
        return Err(BagError::Same(out.to_owned()));
    }
    target(out, force)
}

/// What a laser is called in the copy.
#[derive(Clone)]
struct Named {
    topic: Arc<str>,
    frame_id: Arc<str>,
}

/// Scans on their way.
struct Copy<'a> {
    selection: &'a Selection,
    sink: Sink,
    /// Names in the copy by the topic of the recording; `None` if it is left out.
    names: BTreeMap<Arc<str>, Option<Named>>,
    /// Stamp of the first scan, and the highest, of all topics.
    span_ns: Option<(u64, u64)>,
    copied: u64,
    counts: BTreeMap<Arc<str>, u64>,
    refused: u64,
    first_refusal: Option<RecordingError>,
}

impl<'a> Copy<'a> {
    fn new(selection: &'a Selection, sink: Sink) -> Self {
        Self {
            selection,
            sink,
            names: BTreeMap::new(),
            span_ns: None,
            copied: 0,
            counts: BTreeMap::new(),
            refused: 0,
            first_refusal: None,
        }
    }

    /// Copies what is wanted; why the recording ended early, if it did.
    fn all(&mut self, recording: &Recording) -> Result<Option<RecordingError>, BagError> {
        let bar = progress_bar("copying", recording.bytes());
        let mut scans = recording.scans();
        let mut early_end = None;
        while let Some(item) = scans.next() {
            bar.set_position(scans.position_bytes());
            match item {
                Ok(found) => self.take(found)?,
                Err(error @ RecordingError::Message { .. }) => self.refuse(error),
                Err(error @ RecordingError::Io { .. }) => return Err(error.into()),
                Err(error) => early_end = Some(error),
            }
        }
        bar.finish_and_clear();
        self.missing_laser(scans.topics())?;
        if self.copied == 0 {
            return Err(self.nothing(early_end, scans.no_scans()));
        }
        Ok(early_end)
    }

    fn refuse(&mut self, error: RecordingError) {
        self.refused += 1;
        self.first_refusal.get_or_insert(error);
    }

    fn take(&mut self, mut found: RecordedScan) -> Result<(), BagError> {
        let stamp_ns = found.scan.stamp_ns;
        let (first_ns, last_ns) = *self.span_ns.get_or_insert((stamp_ns, stamp_ns));
        self.span_ns = Some((first_ns, last_ns.max(stamp_ns)));
        let behind_s = (i128::from(stamp_ns) - i128::from(first_ns)) as f64 / SECOND_NS as f64;
        let is_early = self.selection.from_s.is_some_and(|from_s| behind_s < from_s);
        let is_late = self.selection.to_s.is_some_and(|to_s| behind_s > to_s);
        let Some(Named { topic, frame_id }) = self.name(&found) else { return Ok(()) };
        if is_early || is_late {
            return Ok(());
        }
        (found.topic, found.frame_id) = (topic, frame_id);
        self.sink.write(&found)?;
        self.copied += 1;
        *self.counts.entry(found.topic).or_default() += 1;
        Ok(())
    }

    /// What the laser of a scan is called in the copy.
    fn name(&mut self, found: &RecordedScan) -> Option<Named> {
        if let Some(known) = self.names.get(&found.topic) {
            return known.clone();
        }
        let named = if self.selection.lasers.is_empty() {
            let taken: Vec<Arc<str>> =
                self.names.values().flatten().map(|named| named.topic.clone()).collect();
            let topic = if self.sink.wants_ros_names() {
                ros_name(&found.topic, &taken)
            } else {
                found.topic.to_string()
            };
            let frame_id = match &*found.frame_id {
                "" => format!("laser_{}", topic.trim_matches('/').replace('/', "_")),
                frame_id => frame_id.to_owned(),
            };
            Some(Named { topic: topic.into(), frame_id: frame_id.into() })
        } else {
            let mut lasers = self.selection.lasers.iter();
            lasers.find(|laser| *laser.topic == *found.topic).map(|laser| Named {
                topic: format!("/{}", laser.laser).into(),
                frame_id: format!("laser_{}", laser.laser).into(),
            })
        };
        self.names.insert(found.topic.clone(), named.clone());
        named
    }

    /// Why nothing was copied.
    fn nothing(&mut self, early_end: Option<RecordingError>, no_scans: RecordingError) -> BagError {
        match (self.span_ns, early_end.or(self.first_refusal.take())) {
            (Some((first_ns, last_ns)), _) => {
                BagError::Nothing { span_s: (last_ns - first_ns) as f64 / SECOND_NS as f64 }
            }
            (None, Some(error)) => error.into(),
            (None, None) => no_scans.into(),
        }
    }

    /// Refuses a laser whose topic was not there.
    fn missing_laser(&self, topics: &[Arc<str>]) -> Result<(), BagError> {
        let is_there = |topic: &str| topics.iter().any(|there| **there == *topic);
        match self.selection.lasers.iter().find(|laser| !is_there(&laser.topic)) {
            Some(laser) if !topics.is_empty() => Err(BagError::NoTopic {
                laser: laser.laser.clone(),
                topic: laser.topic.clone(),
                topics: topics.join(", "),
            }),
            _ => Ok(()),
        }
    }

    fn finish(self, out: &Path) -> Result<(), BagError> {
        self.sink.finish()?;
        let counts = self.counts.iter();
        let counts: Vec<String> =
            counts.map(|(topic, count)| format!("{topic} {count} scans")).collect();
        eprintln!("tog: wrote {}: {}", out.display(), counts.join(", "));
        for (from, to) in &self.names {
            if let Some(Named { topic, .. }) = to.as_ref().filter(|named| named.topic != *from) {
                eprintln!("tog: {from} is {topic} there");
            }
        }
        if let Some(refusal) = self.first_refusal {
            eprintln!(
                "tog: {} messages were refused and left out, the first: {refusal}",
                self.refused
            );
        }
        Ok(())
    }
}

/// A name that ROS knows: letters, digits, `_` and `/`, no digit behind a `/`; as it is, if it is one.
fn ros_name(name: &str, taken: &[Arc<str>]) -> String {
    let allowed = |c: char| c.is_ascii_alphanumeric() || matches!(c, '_' | '/' | '~');
    let is_valid = |name: &str| {
        let tokens = name.strip_prefix('/').unwrap_or(name).split('/');
        let is_token = |token: &str| token.starts_with(|c: char| !c.is_ascii_digit());
        name.chars().all(allowed) && tokens.into_iter().all(is_token)
    };
    let mut new = name.to_owned();
    if !is_valid(&new) {
        let plain: String = name.chars().map(|c| if allowed(c) { c } else { '_' }).collect();
        let tokens = plain.split('/').filter(|token| !token.is_empty());
        let token = |token: &str| {
            let is_number = token.starts_with(|c: char| c.is_ascii_digit());
            if is_number { format!("/laser_{token}") } else { format!("/{token}") }
        };
        new = tokens.map(token).collect();
    }
    if new.is_empty() {
        new = "/scan".to_owned();
    }
    let is_taken = |name: &str| taken.iter().any(|other| **other == *name);
    let numbered = (2..).map(|number| format!("{new}_{number}"));
    std::iter::once(new.clone()).chain(numbered).find(|name| !is_taken(name)).unwrap_or(new)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn topics_keep_their_names_where_ros_knows_them() {
        for name in ["/scan", "right_scan", "/robot/front_scan", "FLASER"] {
            assert_eq!(ros_name(name, &[]), name);
        }
        assert_eq!(ros_name("6665:laser:0", &[]), "/laser_6665_laser_0");
        assert_eq!(ros_name("front laser", &["/front_laser".into()]), "/front_laser_2");
        assert_eq!(ros_name("", &[]), "/scan");
    }
}
