//! `tog bag play`: a site made round a recording, every service a process of its own, in step with
//! time.
//!
//! The site is the first of: the one of `--site`; the one that our recorder put into the
//! recording; one that is laid round the scans. Its lasers replay the recording, whatever their
//! source is otherwise; nothing that it learns is kept.

use super::site::{RecordedSiteError, attached, fed_by};
use crate::replay::layout;
use crate::{fail, site_file};
use clap::Args;
use process::exit;
use protocol::geometry::Pose;
use protocol::site::{Pace, Preset, Site};
use recorder::attach::site_text;
use recording::ros2::MessageType;
use recording::{Recording, RecordingError, RecordingIndex};
use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// What is put behind the name of a site that is played.
const PLAYED: &str = "-play";
/// Longest name of a site.
const NAME_CHARS_MAX: usize = 32;

#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  tog bag play walk/walk_0.mcap
  tog bag play night.bag --site building.toml --rate 10

Without --site: the site that is attached to a recording of ours; else an area is laid round the
scans of each laser. In another terminal `tog status` and `tog alerts watch` take the site file that
is named at the start. For results in files, and as fast as it goes: tog replay.

Exit code 0: played to the end, or ended by Ctrl-C or --seconds. 78: the site file is wrong. 1:
refused.")]
/// Arguments of `tog bag play`.
pub struct Play {
    /// The recording, or the directory of a bag of one file.
    pub recording: PathBuf,
    /// Site file whose lasers replay the recording.
    #[arg(long, value_name = "SITE")]
    pub site: Option<PathBuf>,
    /// So many times real time.
    #[arg(long, value_name = "N", default_value_t = 1.0, value_parser = rate)]
    pub rate: f64,
    /// End by itself after so many seconds.
    #[arg(long, value_name = "N")]
    pub seconds: Option<u64>,
}

fn rate(text: &str) -> Result<f64, String> {
    let rate: f64 = text.parse().map_err(|_| format!("{text} is not a number"))?;
    let fits = (0.01..=10_000.0).contains(&rate);
    fits.then_some(rate).ok_or_else(|| format!("{rate}, expected 0.01 to 10000"))
}

/// Why a recording cannot be played.
#[derive(Debug, thiserror::Error)]
enum PlayError {
    #[error(transparent)]
    Recording(#[from] RecordingError),
    #[error(transparent)]
    Site(#[from] site_file::SiteFileError),
    #[error(transparent)]
    Layout(#[from] crate::replay::ReplayError),
    #[error(transparent)]
    Source(#[from] laser::source::SourceError),
    #[error("{} holds {files} recordings, expected one: name the file", path.display())]
    NotOne { path: PathBuf, files: usize },
    #[error(transparent)]
    Recorded(#[from] RecordedSiteError),
    #[error("cannot write {}: {source}", path.display())]
    Write { path: PathBuf, source: io::Error },
}

/// What the directories of plays are called, before the number of the process.
const SCRATCH: &str = "tog-play-";
/// The file in them that is locked while the play goes on.
const SCRATCH_LOCK: &str = "lock";

/// A directory that is gone when the play is over; locked until then.
struct Scratch(PathBuf, #[expect(dead_code, reason = "held for its lock")] fs::File);

impl Scratch {
    fn new(parent: &Path) -> Result<Self, PlayError> {
        clear_dead(parent);
        let path = parent.join(format!("{SCRATCH}{}", std::process::id()));
        let make = || {
            fs::create_dir(&path)?;
            let lock = fs::File::create(path.join(SCRATCH_LOCK))?;
            lock.try_lock()?;
            Ok(lock)
        };
        match make() {
            Ok(lock) => Ok(Self(path, lock)),
            Err(source) => Err(PlayError::Write { path, source }),
        }
    }
}

/// Removes the directories of plays that were killed: their locks are free.
fn clear_dead(parent: &Path) {
    for entry in fs::read_dir(parent).into_iter().flatten().flatten() {
        let is_ours = entry.file_name().to_string_lossy().starts_with(SCRATCH)
            && entry.file_type().is_ok_and(|kind| kind.is_dir());
        let lock = entry.path().join(SCRATCH_LOCK);
        let is_dead = is_ours
            && fs::symlink_metadata(&lock).is_ok_and(|found| found.is_file())
            && fs::File::open(&lock).is_ok_and(|lock| lock.try_lock().is_ok());
        if is_dead {
            let _ = fs::remove_dir_all(entry.path()); // of somebody else: they will
        }
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0); // a leftover in the temporary directory harms nobody
    }
}

/// Runs `tog bag play`.
pub fn run(arguments: &Play) -> ExitCode {
    match prepare(arguments) {
        Ok((site, scratch, replay_start_ns)) => {
            let options = supervisor::Options {
                base_dir: scratch.0.clone(),
                seconds: arguments.seconds.map(|seconds| seconds as f64),
                replay_start_ns,
                ..supervisor::Options::default()
            };
            supervisor::run(&site, &options)
        }
        Err(error @ (PlayError::Site(_) | PlayError::Recorded(RecordedSiteError::Site(_)))) => {
            fail(exit::BAD_CONFIG, error)
        }
        Err(error) => fail(exit::FAILED, error),
    }
}

fn prepare(arguments: &Play) -> Result<(Site, Scratch, Option<u64>), PlayError> {
    let path = the_file(&arguments.recording)?;
    let recording = Recording::open(&path)?;
    let topics = scan_topics(&path, &recording)?;
    let scratch = Scratch::new(&std::env::temp_dir())?;
    let site = the_site(arguments, &recording)?;
    let site = played(site, &path, &topics, arguments.rate)?;
    let file = scratch.0.join("play.toml");
    let text = site_text(&site).unwrap_or_default();
    fs::write(&file, text).map_err(|source| PlayError::Write { path: file.clone(), source })?;
    let replay_start_ns = laser::site::replay_begin_ns(&site, &scratch.0)?;
    eprintln!("tog: plays {} as the site {}", path.display(), file.display());
    Ok((site, scratch, replay_start_ns))
}

/// The recording itself, or the only one in a directory.
fn the_file(path: &Path) -> Result<PathBuf, PlayError> {
    let absolute = |path: &Path| {
        std::path::absolute(path)
            .map_err(|source| PlayError::Write { path: path.to_owned(), source })
    };
    if !path.is_dir() {
        return absolute(path);
    }
    let entries = fs::read_dir(path).into_iter().flatten().flatten();
    let is_recording =
        |path: &PathBuf| path.extension().is_some_and(|ending| ending == "mcap" || ending == "bag");
    let mut files: Vec<PathBuf> = entries.map(|e| e.path()).filter(is_recording).collect();
    match (files.pop(), files.len()) {
        (Some(file), 0) => absolute(&file),
        (file, more) => {
            let files = more + usize::from(file.is_some());
            Err(PlayError::NotOne { path: path.to_owned(), files })
        }
    }
}

/// Topics with scans: from the index, or from the whole file where there is none.
fn scan_topics(path: &Path, recording: &Recording) -> Result<Vec<String>, PlayError> {
    if let Ok(facts) = recording::file_facts(path) {
        let is_scan = |name: &str| name == MessageType::LaserScan.name();
        let scans = facts.topics.into_iter().filter(|topic| is_scan(&topic.message_type));
        let topics: Vec<String> =
            scans.filter(|topic| topic.messages > 0).map(|topic| topic.name).collect();
        if !topics.is_empty() {
            return Ok(topics);
        }
    }
    let index = RecordingIndex::scan(recording, |_| None)?;
    Ok(index.topics.into_iter().map(|topic| topic.topic).collect())
}

fn the_site(arguments: &Play, recording: &Recording) -> Result<Site, PlayError> {
    if let Some(site) = &arguments.site {
        return Ok(site_file::load(site)?);
    }
    if let Some(site) = attached(recording)? {
        return Ok(site);
    }
    eprintln!("tog: no site file: reading the scans, to lay an area round those of each laser");
    let index = RecordingIndex::scan(recording, |_| Some(Pose::default()))?;
    let text = layout::lay_out(recording, &index, Preset::Default)?;
    Ok(site_file::parse(&text, recording.path())?)
}

/// The site as it is played.
fn played(site: Site, path: &Path, topics: &[String], rate: f64) -> Result<Site, PlayError> {
    let pace = if rate == 1.0 { Pace::RealTime } else { Pace::Times(rate) };
    let site = fed_by(site, path, topics, pace)?;
    let mut name = site.name.clone();
    name.truncate(NAME_CHARS_MAX - PLAYED.len()); // ASCII, as the site file has it
    let state_dir = "state".to_owned();
    let played = Site { name: name + PLAYED, state_dir, recorder: None, ..site };
    Ok(played.on_one_host())
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use protocol::site::Source;

    fn site(text: &str) -> Site {
        let head = "name = \"a-very-long-name-of-a-building-x\"\n[[area]]\nid = \"a\"\n\
                    origin_m = [0.0, 0.0]\ncolumns = 10\nrows = 10\n";
        Site::parse(&format!("{head}{text}"), "t").unwrap_or_else(|errors| panic!("{errors}"))
    }

    fn laser(id: &str) -> String {
        format!(
            "[[laser]]\nid = \"{id}\"\narea = \"a\"\nx_m = 1\ny_m = 1\n\
             source = {{ kind = \"simulator\", scene = \"room\", rate_hz = 10 }}\n"
        )
    }

    #[test]
    fn lasers_find_their_topics_by_the_names_of_our_recorder() {
        let site = site(&(laser("left-1") + &laser("right")));
        let topics = ["/laser_right/scan".to_owned(), "/laser_left_1/scan".to_owned()];
        let played = played(site, Path::new("/x.mcap"), &topics, 2.0).unwrap();
        assert!(played.name.len() <= 32 && played.name.ends_with("-play"), "{}", played.name);
        let of = |index: usize| match &played.lasers[index].source {
            Source::Replay { topic, pace, .. } => (topic.clone().unwrap(), *pace),
            Source::Simulator { .. } => panic!("it is not replayed"),
        };
        assert_eq!(of(0), ("/laser_left_1/scan".to_owned(), Pace::Times(2.0)));
        assert_eq!(of(1).0, "/laser_right/scan");
    }

    #[test]
    fn the_only_laser_takes_the_only_topic_and_two_do_not() {
        let topics = ["/robot/scan".to_owned()];
        let played_one = played(site(&laser("l")), Path::new("/x.mcap"), &topics, 1.0).unwrap();
        assert!(matches!(&played_one.lasers[0].source,
            Source::Replay { topic: Some(topic), pace: Pace::RealTime, .. }
                if topic == "/robot/scan"));
        let two = site(&(laser("l") + &laser("m")));
        let error = played(two, Path::new("/x.mcap"), &topics, 1.0).unwrap_err().to_string();
        assert!(error.contains("laser `l`") && error.contains("/robot/scan"), "{error}");
    }

    #[test]
    fn what_a_killed_play_left_goes_with_the_next() {
        let parent = tempfile::tempdir().unwrap();
        let dir = |name: &str| parent.path().join(name);
        for name in ["tog-play-1", "tog-play-2", "tog-play-3", "other"] {
            fs::create_dir(dir(name)).unwrap();
            fs::write(dir(name).join("play.toml"), "x").unwrap();
        }
        fs::write(dir("tog-play-1").join(SCRATCH_LOCK), "").unwrap();
        let living = fs::File::create(dir("tog-play-2").join(SCRATCH_LOCK)).unwrap();
        living.try_lock().unwrap();
        let scratch = Scratch::new(parent.path()).unwrap();
        assert!(scratch.0.is_dir() && !dir("tog-play-1").exists());
        assert!(dir("tog-play-2").exists(), "it goes on");
        assert!(dir("tog-play-3").exists() && dir("other").exists(), "not known to be ours");
        let path = scratch.0.clone();
        drop(scratch);
        assert!(!path.exists());
    }
}
