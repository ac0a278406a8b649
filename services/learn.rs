//! `tog learn`: a simulated site sees its own past, as fast as it goes, until it has caught up with the
//! present. What it learnt lies where the services look for it, so that `tog run` begins watching at
//! once. For the demo, for integration tests, and for trying a detector on a scene.

use crate::cli::Learn;
use crate::operate::base_dir;
use crate::pipeline::Pipeline;
use crate::{fail, site_file};
use fusion::core::Origin;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use laser::simulator::SimulatorSource;
use process::{exit, wall_ns};
use protocol::scan::LaserScan;
use protocol::site::{Site, Source};
use protocol::time::SECOND_NS;
use std::collections::BTreeSet;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Time on top of learning and calibration: the windows must fill before a frame counts.
const MARGIN_S: f64 = 120.0;

/// Why nothing can be learnt.
#[derive(Debug, thiserror::Error)]
pub enum LearnError {
    /// A laser is not simulated.
    #[error(
        "laser `{laser}` replays a recording, expected `source = {{ kind = \"simulator\", .. }}`: only \
         a simulation has a past that can be seen in fast motion"
    )]
    NotSimulated {
        /// The laser.
        laser: String,
    },
    /// The site runs.
    #[error(transparent)]
    State(#[from] process::state_lock::StateError),
    /// What was learnt cannot be written.
    #[error("cannot write {}: {source}", path.display())]
    Write {
        /// File or directory.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// A scene.
    #[error(transparent)]
    Laser(#[from] laser::source::SourceError),
    /// A context of the site file.
    #[error(transparent)]
    Context(#[from] mapper::context::ContextError),
    /// The checkpoint of an area.
    #[error(transparent)]
    Checkpoint(#[from] mapper::checkpoint::CheckpointError),
}

/// Runs `tog learn`.
pub fn run(arguments: &Learn) -> ExitCode {
    let site = match site_file::load(&arguments.site) {
        Ok(site) => site,
        Err(error) => return fail(exit::BAD_CONFIG, error),
    };
    match from_the_past(&site, &base_dir(&arguments.site)) {
        Ok(learnt) => {
            let site_file = arguments.site.display();
            let next = format!("next: tog run {site_file}\n");
            crate::operate::write_out(&(learnt.join("") + &next), exit::OK)
        }
        Err(error) => fail(exit::FAILED, error),
    }
}

/// Shows the cores of every area the past up to the present, and leaves what they learnt in the state
/// directory. A line for each area says what was learnt.
///
/// # Errors
/// If a laser is not simulated, or the results cannot be written.
pub fn from_the_past(site: &Site, base_dir: &Path) -> Result<Vec<String>, LearnError> {
    let mut learnt = Vec::new();
    let of_area = |area| site.state_dir_of(base_dir, site.host_of_area(area));
    let state_dirs: BTreeSet<PathBuf> = site.areas.iter().map(of_area).collect();
    let mut locks = Vec::new();
    for state_dir in &state_dirs {
        fs::create_dir_all(state_dir)
            .map_err(|source| LearnError::Write { path: state_dir.clone(), source })?;
        locks.push(process::StateLock::take(state_dir)?);
    }
    for area_index in 0..site.areas.len() {
        let state_dir = of_area(&site.areas[area_index]);
        let mut pipeline = Pipeline::new(site, area_index)?;
        let detector = &pipeline.area.detector;
        let past_s = detector.learning_s + detector.calibration_s + MARGIN_S;
        let begin_ns = wall_ns().saturating_sub((past_s * SECOND_NS as f64) as u64);
        let sources = sources_of(&pipeline, base_dir, begin_ns)?;
        let bar = progress_bar(&pipeline.area.id, past_s as u64);
        catch_up(&mut pipeline, sources, begin_ns, &bar);
        bar.finish_and_clear();
        store(&mut pipeline, &state_dir)?;
        learnt.push(format!(
            "area {}: learnt {:.0} min of its past; {}; kept in {}\n",
            pipeline.area.id,
            pipeline.watch.learnt_s() / 60.0,
            pipeline.watch.phase_words(),
            state_dir.display()
        ));
    }
    Ok(learnt)
}

fn sources_of(
    pipeline: &Pipeline,
    base_dir: &Path,
    begin_ns: u64,
) -> Result<Vec<SimulatorSource>, LearnError> {
    let source = |laser: &protocol::site::Laser| {
        let Source::Simulator { scene, seed, rate_hz } = &laser.source else {
            return Err(LearnError::NotSimulated { laser: laser.id.clone() });
        };
        let scene = laser::site::load_scene(scene, base_dir)?;
        let spec = laser::site::simulated_laser(&scene, laser);
        Ok(SimulatorSource::new(scene, spec, *seed, *rate_hz, begin_ns)?)
    };
    pipeline.lasers.iter().map(source).collect()
}

/// Every laser in turn, the one furthest behind first, until the present.
fn catch_up(
    pipeline: &mut Pipeline,
    mut sources: Vec<SimulatorSource>,
    begin_ns: u64,
    bar: &ProgressBar,
) {
    let mut newest_ns = vec![0u64; sources.len()];
    let (mut scan, mut changes) = (LaserScan::default(), Vec::new());
    while let Some((index, stamp_ns)) =
        newest_ns.iter().copied().enumerate().min_by_key(|(_, stamp_ns)| *stamp_ns)
        && stamp_ns < wall_ns()
    {
        sources[index].next(&mut scan);
        newest_ns[index] = scan.stamp_ns;
        let origin = Origin { laser: index, session: 0, seq: 0, published_mono_ns: 0 };
        // The simulator's scans are well formed; were one refused, the area would not learn, and
        // the service says so at its start.
        let _ = pipeline.fusion.scan(origin, scan.view(), None);
        pipeline.run_frames(&mut changes, |_, _| {});
        changes.clear();
        bar.set_position(scan.stamp_ns.saturating_sub(begin_ns) / SECOND_NS);
    }
}

/// Leaves what was learnt where the services look for it.
fn store(pipeline: &mut Pipeline, state_dir: &Path) -> Result<(), LearnError> {
    let id = pipeline.area.id.clone();
    let map = mapper::shell::checkpoint_path(state_dir, &id);
    let bytes = mapper::checkpoint::encode(&pipeline.mapper.checkpoint())
        .map_err(|source| LearnError::Write { path: map.clone(), source })?;
    mapper::checkpoint::write(&map, &bytes)?;
    anomaly::store::save_normal(state_dir, &id, &mut pipeline.watch)
        .map_err(|source| LearnError::Write { path: state_dir.to_owned(), source })
}

fn progress_bar(area: &str, seconds: u64) -> ProgressBar {
    let bar = ProgressBar::with_draw_target(Some(seconds), ProgressDrawTarget::stderr());
    let template = "{prefix} learns [{wide_bar}] {pos}/{len} s of its past";
    if let Ok(style) = ProgressStyle::with_template(template) {
        bar.set_style(style.progress_chars("=> "));
    }
    bar.set_prefix(area.to_owned());
    bar
}
