//! `grid.json`: what somebody needs to read the arrays of a map, and to compute them again. The one
//! place that writes and reads it.

use protocol::geometry::GridGeometry;
use protocol::grid::{CLASSES_MAX, ClassName, TIMESCALES_MAX};
use protocol::scan::ScanGeometry;
use protocol::site::{Area, LASERS_MAX, Laser, NoReturn, Source, Zone, is_id};
use serde::{Deserialize, Serialize};
use std::io::Read;
use std::path::Path;

/// Its name in the directory of a map.
pub const GRID_FILE: &str = "grid.json";
/// Longest text: 256 lasers with paths of 1 KiB are 0.5 MiB.
const TEXT_BYTES_MAX: u64 = 1 << 20;

/// The grid of a map, its classes, and who looked.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct GridFile {
    /// Id of the area.
    pub area: String,
    /// Lower left corner, metres.
    pub origin_m: [f64; 2],
    /// Edge of a cell, metres.
    pub cell_m: f64,
    /// Cells along x.
    pub columns: u32,
    /// Cells along y.
    pub rows: u32,
    /// T, nanoseconds.
    pub frame_period_ns: u64,
    /// A scan older than this is not in a frame.
    pub scan_age_max_ms: f64,
    /// Half depth of a hit.
    pub range_tolerance_m: f64,
    /// Timescales, ascending.
    pub timescales_s: Vec<f64>,
    /// A cell is classified if it is known in this share of the longest timescale.
    pub known_share_min: f64,
    /// Name of the set of classes.
    pub preset: String,
    /// Ids from 0 and names.
    pub classes: Vec<ClassName>,
    /// Occupancy per timescale of each class but `transit`.
    pub prototypes: Vec<Vec<f64>>,
    /// Whether the last class is `transit`.
    pub transit: bool,
    /// Names of the contexts, `always` first.
    #[serde(default = "always")]
    pub contexts: Vec<String>,
    /// Who looked.
    pub lasers: Vec<LaserEntry>,
    /// Named places, for the pictures; absent in files of earlier versions.
    #[serde(default)]
    pub zones: Vec<Zone>,
}

/// A laser in `grid.json`. What only its scans tell is absent where nobody saw one.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs)] // as in `Laser` and `ScanGeometry`
pub struct LaserEntry {
    pub id: String,
    pub x_m: f64,
    pub y_m: f64,
    pub yaw_rad: f64,
    pub angle_min_rad: Option<f64>,
    pub angle_increment_rad: Option<f64>,
    pub beams: Option<usize>,
    pub range_min_m: Option<f64>,
    pub range_max_m: Option<f64>,
    pub half_beam_rad: Option<f64>,
    #[serde(default)]
    pub no_return: NoReturn,
    pub source: Option<Source>,
}

fn always() -> Vec<String> {
    vec!["always".to_owned()]
}

impl LaserEntry {
    /// A laser of the site file and, if a scan was seen, its geometry and number of beams.
    pub fn of(laser: &Laser, scans: Option<(ScanGeometry, usize)>) -> Self {
        let pose = laser.pose();
        let geometry = scans.map(|(geometry, _)| geometry);
        Self {
            id: laser.id.clone(),
            x_m: pose.x_m,
            y_m: pose.y_m,
            yaw_rad: pose.yaw_rad,
            angle_min_rad: geometry.map(|geometry| geometry.angle_min_rad),
            angle_increment_rad: geometry.map(|geometry| geometry.angle_increment_rad),
            beams: scans.map(|(_, beams)| beams),
            range_min_m: geometry.map(|geometry| geometry.range_min_m),
            range_max_m: geometry.map(|geometry| geometry.range_max_m),
            half_beam_rad: laser.half_beam_deg.map(f64::to_radians),
            no_return: laser.no_return,
            source: Some(laser.source.clone()),
        }
    }
}

impl GridFile {
    /// The grid of an area.
    pub fn of(area: &Area, lasers: Vec<LaserEntry>) -> Self {
        let prototypes = area.prototypes().into_iter().map(|class| class.prototype).collect();
        Self {
            area: area.id.clone(),
            origin_m: area.origin_m,
            cell_m: area.cell_m,
            columns: area.columns,
            rows: area.rows,
            frame_period_ns: area.lattice().period_ns(),
            scan_age_max_ms: area.scan_age_max_ms,
            range_tolerance_m: area.range_tolerance_m(),
            timescales_s: area.timescales_s.clone(),
            known_share_min: area.known_share_min,
            preset: area.preset.name().to_owned(),
            classes: area.class_names(),
            prototypes,
            transit: area.has_transit(),
            contexts: area.context_names().into_iter().map(str::to_owned).collect(),
            lasers,
            zones: area.zones.clone(),
        }
    }

    /// Where the cells are.
    pub fn geometry(&self) -> GridGeometry {
        let Self { origin_m, cell_m, columns, rows, .. } = *self;
        GridGeometry { origin_m, cell_m, columns, rows }
    }

    /// Shape of the counts: class, row, column.
    pub fn shape(&self) -> [usize; 3] {
        [self.classes.len(), self.rows as usize, self.columns as usize]
    }

    /// Index of a class.
    pub fn class(&self, name: &str) -> Option<usize> {
        self.classes.iter().position(|class| class.name == name)
    }

    /// The class whose prototype is `occupancy` on every timescale: 0 nothing, 1 a wall.
    pub fn class_of_always(&self, occupancy: f64) -> Option<usize> {
        self.prototypes.iter().position(|class| class.iter().all(|value| *value == occupancy))
    }

    /// Writes it into the directory of a map.
    ///
    /// # Errors
    /// Those of the file system.
    pub fn write(&self, directory: &Path) -> std::io::Result<()> {
        let text = serde_json::to_string_pretty(self)?;
        std::fs::write(directory.join(GRID_FILE), text + "\n")
    }

    /// Reads it from the directory of a map.
    ///
    /// # Errors
    /// What was found and expected, without the path.
    pub fn read(directory: &Path) -> Result<Self, String> {
        let mut text = Vec::new();
        std::fs::File::open(directory.join(GRID_FILE))
            .and_then(|file| file.take(TEXT_BYTES_MAX + 1).read_to_end(&mut text))
            .map_err(|error| error.to_string())?;
        Self::parse(&text)
    }

    /// Reads the text. Never panics, whatever the bytes.
    ///
    /// # Errors
    /// What was found and expected.
    pub fn parse(text: &[u8]) -> Result<Self, String> {
        if text.len() as u64 > TEXT_BYTES_MAX {
            return Err(format!("more than {TEXT_BYTES_MAX} bytes, which no grid.json has"));
        }
        let file: Self = serde_json::from_slice(text).map_err(|error| error.to_string())?;
        file.check()?;
        Ok(file)
    }

    /// Says what is wrong with the numbers, if anything is.
    fn check(&self) -> Result<(), String> {
        let need = |holds: bool, what: String| if holds { Ok(()) } else { Err(what) };
        let side = 1..=GridGeometry::SIDE_MAX;
        let cells_max = GridGeometry::CELLS_MAX;
        let (columns, rows) = (self.columns, self.rows);
        need(
            side.contains(&columns) && side.contains(&rows) && self.geometry().cells() <= cells_max,
            format!("{columns} x {rows} cells, expected sides of 1 to 4096 and {cells_max} cells"),
        )?;
        let metres = (1e-3..=1e3).contains(&self.cell_m);
        need(
            metres && self.origin_m.iter().all(|side| side.abs() <= 1e6),
            format!(
                "cells of {} m from {:?}, expected 0.001 to 1000 m",
                self.cell_m, self.origin_m
            ),
        )?;
        need(self.frame_period_ns > 0, "frame_period_ns 0, expected more".to_owned())?;
        let timescales = self.timescales_s.len();
        need(
            (1..=TIMESCALES_MAX).contains(&timescales)
                && self.timescales_s.iter().all(|scale| *scale > 0.0 && scale.is_finite()),
            format!("timescales_s {:?}, expected 1 to {TIMESCALES_MAX} of them", self.timescales_s),
        )?;
        let (classes, prototypes) = (self.classes.len(), self.prototypes.len());
        let in_order =
            self.classes.iter().enumerate().all(|(id, class)| usize::from(class.id) == id);
        need(
            (1..=CLASSES_MAX).contains(&classes) && in_order && prototypes > 0,
            format!("{classes} classes, expected 1 to {CLASSES_MAX} with ids from 0 on"),
        )?;
        need(
            prototypes + usize::from(self.transit) == classes
                && self.prototypes.iter().all(|class| class.len() == timescales),
            format!(
                "{prototypes} prototypes do not fit {classes} classes, {timescales} timescales"
            ),
        )?;
        let share = 0.0..=1.0;
        let odd = self.prototypes.iter().flatten().find(|value| !share.contains(*value));
        if let Some(odd) = odd {
            return Err(format!("a prototype of {odd}, expected occupancies of 0 to 1"));
        }
        let known = self.known_share_min;
        need(share.contains(&known), format!("known_share_min {known}, expected 0 to 1"))?;
        let names = self.classes.iter().map(|class| &class.name).chain(&self.contexts);
        let names: Vec<&String> = names.chain([&self.area]).collect();
        // Names become names of files.
        let odd = names.iter().find(|name| !is_id(name));
        let odd = odd.map(|name| name.chars().take(40).collect::<String>());
        need(
            odd.is_none(),
            format!("the name {odd:?}, expected 1 to 32 letters, digits, `-`, `_`"),
        )?;
        let mut contexts = self.contexts.clone();
        contexts.sort_unstable();
        contexts.dedup();
        need(
            (1..=CLASSES_MAX).contains(&contexts.len()) && contexts.len() == self.contexts.len(),
            format!("{} contexts, expected 1 to {CLASSES_MAX}, each once", self.contexts.len()),
        )?;
        need(
            self.lasers.len() <= LASERS_MAX,
            format!("{} lasers, expected at most {LASERS_MAX}", self.lasers.len()),
        )
    }

    /// The first key in which another grid differs so that the counts do not mean the same:
    /// `(key, found in other, expected)`.
    pub fn difference(&self, other: &Self) -> Option<(&'static str, String, String)> {
        fn pair<T: std::fmt::Debug + PartialEq>(
            expected: &T,
            found: &T,
        ) -> Option<(String, String)> {
            (expected != found).then(|| (format!("{found:?}"), format!("{expected:?}")))
        }
        let keys = [
            ("area", pair(&self.area, &other.area)),
            ("origin_m", pair(&self.origin_m, &other.origin_m)),
            ("cell_m", pair(&self.cell_m, &other.cell_m)),
            ("columns", pair(&self.columns, &other.columns)),
            ("rows", pair(&self.rows, &other.rows)),
            ("frame_period_ns", pair(&self.frame_period_ns, &other.frame_period_ns)),
            ("timescales_s", pair(&self.timescales_s, &other.timescales_s)),
            ("known_share_min", pair(&self.known_share_min, &other.known_share_min)),
            ("classes", pair(&names(&self.classes), &names(&other.classes))),
            ("prototypes", pair(&self.prototypes, &other.prototypes)),
            ("transit", pair(&self.transit, &other.transit)),
        ];
        let differs = |(key, pair): (_, Option<(String, String)>)| {
            pair.map(|(found, expected)| (key, found, expected))
        };
        keys.into_iter().find_map(differs)
    }
}

fn names(classes: &[ClassName]) -> Vec<&str> {
    classes.iter().map(|class| class.name.as_str()).collect()
}
