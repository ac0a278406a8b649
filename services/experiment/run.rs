//! One experiment: imagined lasers -> fusion -> a grid for each preset, beside the truth.
//!
//! Everything is generated in memory and streamed to the cores of the services; a [`Sink`] may
//! watch. The same experiment, seed and rate give the same bytes.

use experiment::{Experiment, Footprints, Ground, Rate, Shares, phase_ns};
use fusion::core::{FusionCore, Origin};
use mapper::context::ContextError;
use mapper::core::MapperCore;
use protocol::scan::ScanView;
use protocol::site::{Area, Laser, Preset, Site};
use protocol::time::{Lattice, SECOND_NS};
use recording::as_recorded;
use scene::{LaserSpec, Scene, SceneError, Truth, World};
use std::fmt::Write as _;
use std::io;
use std::path::PathBuf;

/// The presets that are compared.
pub const PRESETS: [Preset; 3] = [Preset::Default, Preset::Paper, Preset::Onehot];

/// Why an experiment could not be run.
#[derive(Debug, thiserror::Error)]
pub enum ExperimentError {
    /// The scene.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// The site file that is made of the scene.
    #[error("the site file of the experiment is not accepted: {0}")]
    Site(String),
    /// A context of the area.
    #[error(transparent)]
    Context(#[from] ContextError),
    /// A scan that fusion refuses.
    #[error("fusion refuses a scan: {0}")]
    Scan(#[from] fusion::core::ScanRefused),
    /// The recording.
    #[error(transparent)]
    Recording(#[from] recording::RecordingError),
    /// Results are there already.
    #[error(transparent)]
    Overwrite(#[from] crate::map::overwrite::OverwriteError),
    /// A file of the results.
    #[error("cannot write {}: {source}", path.display())]
    Write {
        /// File or directory.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// A picture.
    #[error(transparent)]
    Figure(#[from] figures::FigureError),
}

/// Which run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Which {
    /// The experiment.
    pub experiment: Experiment,
    /// Seed of people and noise.
    pub seed: u64,
    /// Rate of the lasers.
    pub rate: Rate,
}

/// What watches a run.
pub trait Sink {
    /// Every scan, in the order of its stamps.
    fn scan(&mut self, laser: usize, scan: &ScanView<'_>) -> Result<(), ExperimentError>;
    /// The truth, at every eighth turn of the mirrors.
    fn truth(&mut self, stamp_ns: u64, truth: &Truth) -> Result<(), ExperimentError>;
    /// So many seconds of the experiment are over.
    fn progress(&mut self, _seconds: u64) {}
}

/// Nobody watches.
pub struct NoSink;

impl Sink for NoSink {
    fn scan(&mut self, _: usize, _: &ScanView<'_>) -> Result<(), ExperimentError> {
        Ok(())
    }
    fn truth(&mut self, _: u64, _: &Truth) -> Result<(), ExperimentError> {
        Ok(())
    }
}

/// The collapsed map of one preset.
pub struct Mapped {
    /// The area as this preset classifies it.
    pub area: Area,
    /// Counts, [class, row, column].
    pub counts: Vec<u64>,
    /// The same as shares.
    pub shares: Shares,
}

/// What a run came to.
pub struct Outcome {
    /// Which run.
    pub which: Which,
    /// The scene.
    pub scene: Scene,
    /// A map for each of [`PRESETS`].
    pub maps: Vec<Mapped>,
    /// Surfaces before anybody came.
    pub ground: Ground,
    /// Where people trod.
    pub footprints: Footprints,
    /// Scans of all lasers.
    pub scans: u64,
    /// Frames of the lattice.
    pub frames: u64,
}

/// The text of a site file that replays the recording of a run, or lets it run again.
pub fn site_text(which: Which, scene: &Scene, recording: Option<&str>) -> String {
    let Scene { area, lasers, .. } = scene;
    let [x, y] = area.origin_m;
    let mut text = format!(
        "# Experiment {} of the paper: {}.\nname = \"experiment-{}\"\ntimezone = \"UTC\"\n\n\
         [[area]]\nid = \"{}\"\norigin_m = [{x:?}, {y:?}]\ncell_m = {:?}\ncolumns = {}\n\
         rows = {}\nframe_period_ms = {:?}   # the lasers' own: the paper's cycle\n",
        which.experiment.number(),
        which.experiment.about(),
        which.experiment.number(),
        area.id,
        area.cell_m,
        area.columns,
        area.rows,
        which.rate.period_ns() as f64 / 1e6,
    );
    for LaserSpec { id, x_m, y_m, yaw_deg, .. } in lasers {
        let source = match recording {
            Some(file) => format!(
                "kind = \"replay\", recording = \"{file}\", topic = \"/{id}\", pace = \"lossless\""
            ),
            None => format!(
                "kind = \"simulator\", scene = \"{}\", seed = {}, rate_hz = {:?}",
                which.experiment.scene_name(),
                which.seed,
                which.rate.hz()
            ),
        };
        // Writing to a String cannot fail.
        let _ = write!(
            text,
            "\n[[laser]]\nid = \"{id}\"\narea = \"{}\"\nx_m = {x_m:?}\ny_m = {y_m:?}\n\
             yaw_deg = {yaw_deg:?}\nsource = {{ {source} }}\n",
            area.id
        );
    }
    text
}

/// The cores of a run.
struct Cores {
    fusion: FusionCore,
    mappers: Vec<(Area, MapperCore)>,
    frames: u64,
}

impl Cores {
    fn new(site: &Site) -> Result<Self, ExperimentError> {
        let lasers: Vec<&Laser> = site.lasers.iter().collect();
        let mapper = |preset| {
            let area = Area { preset, ..site.areas[0].clone() };
            MapperCore::new(&area, &site.timezone).map(|mapper| (area, mapper))
        };
        Ok(Self {
            fusion: FusionCore::new(&site.areas[0], &lasers, None),
            mappers: PRESETS.into_iter().map(mapper).collect::<Result<_, _>>()?,
            frames: 0,
        })
    }

    fn scan(&mut self, laser: usize, scan: ScanView<'_>) -> Result<(), ExperimentError> {
        let origin = Origin { laser, session: 0, seq: 0, published_mono_ns: 0 };
        self.fusion.scan(origin, scan, None)?;
        self.run_frames();
        Ok(())
    }

    fn run_frames(&mut self) {
        while let Some(frame) = self.fusion.next_frame(None) {
            self.frames += 1;
            for (_, mapper) in &mut self.mappers {
                mapper.frame(frame.view(), Some(frame.changed_cells), |_, _| {});
            }
        }
        self.fusion.drain_finished().for_each(drop);
    }

    fn finish(&mut self, lasers: usize) -> Vec<Mapped> {
        (0..lasers).for_each(|laser| self.fusion.end(laser));
        self.run_frames();
        let map = |(area, mapper): &(Area, MapperCore)| {
            let names = area.class_names();
            let mut counts = vec![0; names.len() * area.grid().cells()];
            mapper.grid().collapsed(0, &mut counts);
            let words: Vec<&str> = names.iter().map(|class| class.name.as_str()).collect();
            let shares = Shares::of_counts(area.grid(), &words, &counts);
            Mapped { area: area.clone(), counts, shares }
        };
        self.mappers.iter().map(map).collect()
    }
}

/// Runs an experiment for its first `seconds`.
///
/// # Errors
/// See [`ExperimentError`]: those of the sink; the delivered scenes are right.
pub fn run(which: Which, seconds: f64, sink: &mut impl Sink) -> Result<Outcome, ExperimentError> {
    let scene = which.experiment.scene()?;
    let text = site_text(which, &scene, None);
    let site = Site::parse(&text, "site.toml")
        .map_err(|errors| ExperimentError::Site(format!("{errors}")))?;
    let mut world = World::new(scene.clone(), which.seed)?;
    let ground = Ground::seen(&mut world, which.experiment.begin_s());
    let mut footprints = Footprints::new(scene.area.grid());
    let mut cores = Cores::new(&site)?;

    let period_ns = which.rate.period_ns();
    let lattice = Lattice::new(period_ns);
    let first = lattice.first_at_or_after(scene.stamp_ns(which.experiment.begin_s()));
    let turns = (seconds * SECOND_NS as f64 / period_ns as f64).round() as u64;
    let truth_every = (Rate::SERIAL_38400.period_ns() / period_ns).max(1);
    let mut order: Vec<(u64, usize)> =
        (0..scene.lasers.len()).map(|i| (phase_ns(which.seed, i, which.rate), i)).collect();
    order.sort_unstable();

    let (mut ranges_m, mut scans) = (Vec::new(), 0);
    for turn in 0..turns {
        let turn_ns = lattice.stamp_ns(first + turn);
        if turn % truth_every == 0 {
            let truth = world.truth(scene.time_s(turn_ns));
            footprints.add(&truth);
            sink.truth(turn_ns, &truth)?;
            sink.progress(turn * period_ns / SECOND_NS);
        }
        for &(phase_ns, laser) in &order {
            let spec = &scene.lasers[laser];
            let stamp_ns = turn_ns + phase_ns;
            world.scan(spec, scene.time_s(stamp_ns), &mut ranges_m);
            let geometry = as_recorded(&spec.geometry());
            let scan = ScanView { stamp_ns, geometry, ranges_m: &ranges_m };
            sink.scan(laser, &scan)?;
            cores.scan(laser, scan)?;
            scans += 1;
        }
    }
    let maps = cores.finish(scene.lasers.len());
    let frames = cores.frames;
    Ok(Outcome { which, scene, maps, ground, footprints, scans, frames })
}
