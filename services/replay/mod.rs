//! `tog replay`: a recording through all cores in one process, as fast as it goes.
//!
//! The same cores as the services, without clock, shared memory and processes, so that what a
//! recording says here is, bit for bit, what the running system says of it.
//!
//! | file | what |
//! |---|---|
//! | `layout.rs` | a site file for a recording that has none |
//! | `lane.rs` | the scans of a laser, decoded on a thread of their own |
//! | `area.rs` | one area: lanes -> pipeline -> files |
//! | `words.rs` | what it says of itself |
//! | `output.rs` | events.jsonl; grid.json and pictures as `services/map/` draws them |

mod area;
mod lane;
pub mod layout;
mod output;
mod words;

use crate::bag::site::{RecordedSiteError, attached, fed_by};
use crate::cli::{PresetName, Replay};
use crate::map::overwrite;
use crate::{fail, site_file};
use area::AreaRun;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use process::exit;
use protocol::geometry::Pose;
use protocol::site::{Laser, Pace, Preset, Site, Source};
use protocol::time::SECOND_NS;
use recording::{Recording, RecordingIndex};
use std::io;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Why a recording could not be replayed.
#[derive(Debug, thiserror::Error)]
pub enum ReplayError {
    /// The recording itself.
    #[error(transparent)]
    Recording(#[from] recording::RecordingError),
    /// Its scans.
    #[error(transparent)]
    Source(#[from] laser::source::SourceError),
    /// No area can be laid round the scans of a topic.
    #[error("topic {topic}: {source}")]
    Layout {
        /// The topic.
        topic: String,
        /// Why.
        source: recording::ExtentError,
    },
    /// A laser of the site is not replayed.
    #[error(
        "laser `{laser}` of the site file is {found}, expected `source = {{ kind = \"replay\", .. }}`: \
         `tog replay` feeds lasers from the recording"
    )]
    NotReplayed {
        /// The laser.
        laser: String,
        /// Its source.
        found: &'static str,
    },
    /// The contexts of an area.
    #[error(transparent)]
    Context(#[from] mapper::context::ContextError),
    /// A thread for the scans of a laser.
    #[error("cannot start a thread that reads the recording: {0}")]
    Thread(io::Error),
    /// Results are there already.
    #[error(transparent)]
    Overwrite(#[from] overwrite::OverwriteError),
    /// A file of the results.
    #[error("cannot write the results to {}: {source}", path.display())]
    Write {
        /// Directory or file.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// A picture.
    #[error(transparent)]
    Picture(#[from] crate::map::pictures::PictureError),
    /// A picture that cannot be drawn.
    #[error(transparent)]
    Figure(#[from] figures::FigureError),
    /// The site that is attached to the recording.
    #[error(transparent)]
    Recorded(#[from] RecordedSiteError),
    /// The site file.
    #[error(transparent)]
    SiteFile(#[from] site_file::SiteFileError),
}

/// Wraps an error of the file system with the path.
fn write_error(path: &Path) -> impl FnOnce(io::Error) -> ReplayError + '_ {
    move |source| ReplayError::Write { path: path.to_owned(), source }
}

/// What a replay came to.
struct Outcome {
    /// Why the recording ended before its end, if it did; what came before is written.
    cut: Option<laser::source::SourceError>,
    /// Lasers whose scans were mostly dropped, in words.
    mostly_dropped: Vec<String>,
}

/// Runs `tog replay`.
pub fn main(arguments: &Replay) -> ExitCode {
    match run(arguments) {
        Ok(Outcome { cut: None, mostly_dropped }) if mostly_dropped.is_empty() => {
            ExitCode::from(exit::OK)
        }
        Ok(Outcome { cut: None, mostly_dropped }) => {
            fail(exit::FAILED, mostly_dropped.join("\ntog: "))
        }
        Ok(Outcome { cut: Some(cut), .. }) => {
            fail(exit::FAILED, format_args!("{cut}; what came before is replayed and written"))
        }
        Err(
            error @ (ReplayError::SiteFile(_) | ReplayError::Recorded(RecordedSiteError::Site(_))),
        ) => fail(exit::BAD_CONFIG, error),
        Err(error) => fail(exit::FAILED, error),
    }
}

/// Replays every area of the recording.
fn run(arguments: &Replay) -> Result<Outcome, ReplayError> {
    // What is wrong with the site is told before a recording of hours is read.
    let site = arguments.site.as_deref().map(site_file::load).transpose()?;
    site.as_ref().map_or(Ok(()), all_replayed)?;
    overwrite::for_run(&arguments.out, arguments.force)?;
    let recording = Recording::open(&arguments.recording)?;
    let attached = if site.is_none() { attached_site(arguments, &recording)? } else { None };
    let has_site = site.is_some() || attached.is_some();
    eprintln!("tog: reading {}", arguments.recording.display());
    let index = RecordingIndex::scan(&recording, |_| (!has_site).then(Pose::default))?;
    report_contents(&index);
    let site = match (site, attached) {
        (Some(site), _) => site,
        (None, Some(site)) => {
            let topics: Vec<String> =
                index.topics.iter().map(|topic| topic.topic.to_string()).collect();
            fed_by(site, &arguments.recording, &topics, Pace::default())?
        }
        (None, None) => laid_out(arguments, &recording, &index)?,
    };
    let mut sources = Vec::with_capacity(site.areas.len());
    for area in &site.areas {
        sources.push(sources_of(&site, &area.id, &arguments.recording, &index)?);
    }

    let several = site.areas.len() > 1;
    let (mut cut, mut mostly_dropped, mut too_short) = (None, Vec::new(), Vec::new());
    for (area_index, sources) in sources.into_iter().enumerate() {
        let area = &site.areas[area_index];
        let directory = if several { arguments.out.join(&area.id) } else { arguments.out.clone() };
        let rows = if arguments.every_frame {
            mapper::results::Rows::EveryFrame
        } else {
            mapper::results::Rows::OneASecond
        };
        let mut run = AreaRun::new(&site, area_index, sources, &directory, rows)?;
        let bar = progress_bar(&area.id, &index);
        run.replay_all(&bar)?;
        bar.finish_and_clear();
        eprintln!("tog: {}", run.summary());
        too_short.extend(run.too_short());
        cut = run.take_cut().or(cut);
        mostly_dropped.extend(run.mostly_dropped());
        if let Some(why_empty) = run.finish(&arguments.recording)? {
            eprintln!("tog: {why_empty}");
        }
        eprintln!("tog: results of area {} are in {}", area.id, directory.display());
    }
    if let Some(why) = words::too_short(&too_short) {
        eprintln!("tog: {why}");
    }
    Ok(Outcome { cut, mostly_dropped })
}

/// The site that our recorder put into the recording; not if a preset is asked for, which is of a
/// site that is laid out.
fn attached_site(
    arguments: &Replay,
    recording: &Recording,
) -> Result<Option<Site>, RecordedSiteError> {
    match arguments.preset {
        PresetName::Default => attached(recording),
        PresetName::Paper | PresetName::Onehot => Ok(None),
    }
}

/// Refuses a site with a laser that no recording can feed.
fn all_replayed(site: &Site) -> Result<(), ReplayError> {
    let simulated = |laser: &&Laser| !matches!(laser.source, Source::Replay { .. });
    match site.lasers.iter().find(simulated) {
        None => Ok(()),
        Some(laser) => {
            Err(ReplayError::NotReplayed { laser: laser.id.clone(), found: "simulated" })
        }
    }
}

/// The site of a recording that comes without one; its text is written beside the results.
fn laid_out(
    arguments: &Replay,
    recording: &Recording,
    index: &RecordingIndex,
) -> Result<Site, ReplayError> {
    let preset = match arguments.preset {
        PresetName::Default => Preset::Default,
        PresetName::Paper => Preset::Paper,
        PresetName::Onehot => Preset::Onehot,
    };
    let text = layout::lay_out(recording, index, preset)?;
    std::fs::create_dir_all(&arguments.out).map_err(write_error(&arguments.out))?;
    let path = arguments.out.join("site.toml");
    std::fs::write(&path, &text).map_err(write_error(&path))?;
    let site = site_file::parse(&text, &path)?;
    for area in &site.areas {
        eprintln!(
            "tog: no site file: laid area `{}` round the scans, {} x {} cells of {} cm, its laser at \
             (0, 0)",
            area.id,
            area.columns,
            area.rows,
            area.cell_m * 100.0
        );
        if area.frame_period_ms != layout::FRAME_PERIOD_MS {
            eprintln!(
                "tog: its scans come more slowly than 4 Hz: a frame every {} ms (frame_period_ms), of \
                 scans not older than {} ms (scan_age_max_ms)",
                area.frame_period_ms, area.scan_age_max_ms
            );
        }
    }
    eprintln!("tog: wrote {}: put the poses right there and replay with --site", path.display());
    Ok(site)
}

fn report_contents(index: &RecordingIndex) {
    let mut topics: Vec<_> = index.topics.iter().collect();
    topics.sort_by(|a, b| a.topic.cmp(&b.topic)); // as `tog bag info` shows them
    for topic in topics {
        let percent = |part: u64| 100.0 * part as f64 / topic.readings.max(1) as f64;
        let span_s = (topic.last_stamp_ns - topic.first_stamp_ns) as f64 / SECOND_NS as f64;
        eprintln!(
            "tog: {}: {} scans of {} beams in {span_s:.1} s ({:.1} Hz), {:.0} % no return, {:.1} % \
             invalid",
            topic.topic,
            topic.scans,
            topic.beams,
            topic.rate_hz(),
            percent(topic.no_return),
            percent(topic.invalid)
        );
    }
    if let Some(refusal) = &index.first_refusal {
        let refused: u64 = index.topics.iter().map(|topic| topic.refused).sum();
        eprintln!("tog: {refused} messages were refused and dropped, the first: {refusal}");
    }
}

/// The sources of the lasers of an area, from the recording of the command line.
fn sources_of(
    site: &Site,
    area: &str,
    recording: &Path,
    index: &RecordingIndex,
) -> Result<Vec<laser::replay::ReplaySource>, ReplayError> {
    let mut sources = Vec::new();
    let mut begins_ns = Vec::new();
    for (_, laser) in site.lasers_of(area) {
        let Source::Replay { topic, .. } = &laser.source else { continue }; // see `all_replayed`
        let topic = index.topic(topic.as_deref())?;
        begins_ns.push((laser, topic.first_stamp_ns));
        sources.push(laser::replay::ReplaySource::open(recording, Some(&topic.topic))?);
    }
    laser::site::check_begins(&begins_ns)?;
    Ok(sources)
}

/// A bar over the seconds of the recording, on a terminal only.
fn progress_bar(area: &str, index: &RecordingIndex) -> ProgressBar {
    let first_ns = index.topics.iter().map(|topic| topic.first_stamp_ns).min().unwrap_or(0);
    let last_ns = index.topics.iter().map(|topic| topic.last_stamp_ns).max().unwrap_or(0);
    let seconds = last_ns.saturating_sub(first_ns) / SECOND_NS;
    let bar = ProgressBar::with_draw_target(Some(seconds), ProgressDrawTarget::stderr());
    let template = "{prefix} [{wide_bar}] {pos}/{len} s, {eta} left";
    if let Ok(style) = ProgressStyle::with_template(template) {
        bar.set_style(style.progress_chars("=> "));
    }
    bar.set_prefix(area.to_owned());
    bar
}
