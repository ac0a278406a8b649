//! `tog map`: collapsed maps as pictures, for other programs, compared, added.
//!
//! | file | what |
//! |---|---|
//! | `cli.rs` | verbs and arguments |
//! | `grid_file.rs` | grid.json: the one place that writes and reads it |
//! | `stored.rs` | where maps come from: directories, checkpoints of sites |
//! | `pictures.rs` | overview and classes, also for `tog replay` |
//! | `diff.rs` | what changed (pure) |
//! | `drawing.rs` | pictures of it |
//! | `export.rs` | nav2, NumPy |
//! | `overwrite.rs` | what becomes of the results of an earlier run |
//! | `results.rs` | grid.json and pictures of `tog run --out` |
//! | `text.rs` | what is printed |

pub mod cli;
mod diff;
mod drawing;
pub mod export;
pub mod grid_file;
pub mod overwrite;
pub mod pictures;
mod results;
mod stored;
#[cfg(test)]
mod tests;
mod text;

use crate::cli::Format;
use crate::{fail, site_file};
use cli::{
    Diff, Export, ExportFormat, Info, Look, Map, MapVerb, Maps, Merge, Picture, Render, ScaleName,
};
use drawing::Drawing;
use figures::{FileFormat, Options};
use pictures::{PictureError, Pictures, picture_path};
use process::exit;
pub use results::describe_results;
use std::io;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use stored::{StoredMap, add};

/// Why a verb of `tog map` could not be done.
#[derive(Debug, thiserror::Error)]
pub enum MapError {
    /// The arguments do not go together.
    #[error("{0}")]
    Usage(String),
    /// The site file.
    #[error(transparent)]
    SiteFile(#[from] site_file::SiteFileError),
    /// No map is there.
    #[error("there is no map at {}: {help}", path.display())]
    NoMap {
        /// Where it was looked for.
        path: PathBuf,
        /// What to do.
        help: String,
    },
    /// grid.json, or what should fit it.
    #[error("{}: {reason}", path.display())]
    Grid {
        /// The file.
        path: PathBuf,
        /// What was found and expected.
        reason: String,
    },
    /// An array.
    #[error(transparent)]
    Array(#[from] mapper::npy::NpyError),
    /// A recording.
    #[error(transparent)]
    Recording(#[from] laser::source::SourceError),
    /// A checkpoint.
    #[error(transparent)]
    Checkpoint(#[from] mapper::checkpoint::CheckpointError),
    /// A class, context or area that is not there.
    #[error("{map} has no {what} `{found}`, expected one of `{known}`")]
    Name {
        /// What it should be.
        what: &'static str,
        /// What was asked for.
        found: String,
        /// Where.
        map: String,
        /// What is there.
        known: String,
    },
    /// The grids differ.
    #[error(
        "{map} is of another grid than {first}: {key} is {found}, expected {expected}; only maps of \
         the same grid can be compared or added"
    )]
    OtherGrid {
        /// The map.
        map: String,
        /// The map before it.
        first: String,
        /// Key of grid.json.
        key: &'static str,
        /// Its value.
        found: String,
        /// That of the first map.
        expected: String,
    },
    /// A count beyond 64 bits.
    #[error("the counts of {0} do not fit 64 bits: it is damaged")]
    Overflow(String),
    /// Something is there already.
    #[error(transparent)]
    Overwrite(#[from] overwrite::OverwriteError),
    /// A file cannot be written.
    #[error("cannot write {}: {source}", path.display())]
    Write {
        /// The file or directory.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// A picture.
    #[error(transparent)]
    Picture(#[from] PictureError),
    /// A picture that cannot be drawn.
    #[error(transparent)]
    Figure(#[from] figures::FigureError),
}

/// Runs `tog map`; what it prints goes to stdout.
pub fn main(arguments: &Map) -> ExitCode {
    let done = match &arguments.verb {
        MapVerb::Info(arguments) => info(arguments),
        MapVerb::Render(arguments) => render(arguments),
        MapVerb::Diff(arguments) => difference(arguments),
        MapVerb::Export(arguments) => export(arguments),
        MapVerb::Merge(arguments) => merge(arguments),
    };
    match done {
        Ok(text) => crate::operate::write_out(&text, exit::OK),
        Err(error @ MapError::Usage(_)) => fail(exit::USAGE, error),
        Err(error @ MapError::SiteFile(_)) => fail(exit::BAD_CONFIG, error),
        Err(error) => fail(exit::FAILED, error),
    }
}

/// Opens the maps of the command line, `--site` last.
fn open(maps: &Maps) -> Result<Vec<StoredMap>, MapError> {
    let area = maps.area.as_deref();
    let paths = maps.maps.iter().map(|path| StoredMap::open(path, area));
    paths.chain(maps.site.iter().map(|site| StoredMap::of_site(site, area))).collect()
}

/// Exactly `N` maps, told apart from a slip of the pen.
fn exactly<const N: usize>(maps: &Maps, verb: &str) -> Result<[StoredMap; N], MapError> {
    let found = maps.maps.len() + maps.site.iter().len();
    let wrong = || {
        let plural = if N == 1 { "one map" } else { "two maps" };
        MapError::Usage(format!(
            "`tog map {verb}` takes {plural} (MAP or --site SITE), found {found}: see \
             `tog map {verb} --help`"
        ))
    };
    if found != N {
        return Err(wrong());
    }
    open(maps)?.try_into().map_err(|_| wrong())
}

/// Index of a class by name.
fn class_of(map: &StoredMap, name: &str) -> Result<usize, MapError> {
    map.grid.class(name).ok_or_else(|| MapError::Name {
        what: "class",
        found: name.to_owned(),
        map: map.name.clone(),
        known: map.grid.classes.iter().map(|class| &*class.name).collect::<Vec<_>>().join("`, `"),
    })
}

fn same_grid(first: &StoredMap, map: &StoredMap) -> Result<(), MapError> {
    match first.grid.difference(&map.grid) {
        None => Ok(()),
        Some((key, found, expected)) => {
            let (map, first) = (map.name.clone(), first.name.clone());
            Err(MapError::OtherGrid { map, first, key, found, expected })
        }
    }
}

/// Format of a picture by the name of its file; `None` for a directory.
fn format_of(path: &Path) -> Option<FileFormat> {
    let extension = path.extension()?.to_str()?.to_ascii_lowercase();
    match extension.as_str() {
        "png" => Some(FileFormat::Png),
        "svg" => Some(FileFormat::Svg),
        _ => None,
    }
}

/// Endings of pictures that are not drawn: `x.gif` is a slip of the pen, not a directory.
const OTHER_PICTURES: [&str; 12] =
    ["gif", "jpg", "jpeg", "pdf", "bmp", "tif", "tiff", "webp", "eps", "ps", "pgm", "ppm"];

/// Refuses a path that asks for a picture of another format.
fn check_picture(out: &Path) -> Result<(), MapError> {
    let extension = out.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
    if out.is_dir() || !OTHER_PICTURES.contains(&&*extension) {
        return Ok(());
    }
    Err(MapError::Usage(format!(
        "--out {}: found a picture of format .{extension}, expected .png, .svg, or a directory",
        out.display()
    )))
}

fn options(look: &Look, gamma: f64, out: &Path) -> Options {
    let of_directory = match look.picture {
        Picture::Png => FileFormat::Png,
        Picture::Svg => FileFormat::Svg,
    };
    let format = format_of(out).unwrap_or(of_directory);
    Options { gamma, crop: !look.whole, format, ..Options::default() }
}

fn write_error(path: &Path) -> impl FnOnce(io::Error) -> MapError + '_ {
    move |source| MapError::Write { path: path.to_owned(), source }
}

/// Refuses a share that is none.
fn check_share(flag: &str, value: f64, least: f64) -> Result<(), MapError> {
    if (least..=1.0).contains(&value) {
        return Ok(());
    }
    Err(MapError::Usage(format!("{flag} {value} is no share: expected {least} to 1")))
}

fn info(arguments: &Info) -> Result<String, MapError> {
    let maps = open(&arguments.maps)?;
    if maps.is_empty() {
        let text = "`tog map info` needs a map: a directory, or --site SITE".to_owned();
        return Err(MapError::Usage(text));
    }
    let context = arguments.part.context.as_deref();
    let report = |map: &StoredMap| Ok(text::Report::of(map, &map.counts(context)?, context));
    let reports = maps.iter().map(report).collect::<Result<Vec<_>, MapError>>()?;
    Ok(match arguments.format {
        Format::Text => reports.iter().map(text::Report::text).collect::<Vec<_>>().join("\n"),
        Format::Json => format!("{:#}\n", serde_json::json!(reports)),
    })
}

fn render(arguments: &Render) -> Result<String, MapError> {
    check_picture(&arguments.out)?;
    let [map] = exactly(&arguments.maps, "render")?;
    let class = arguments.look.class.as_deref().map(|name| class_of(&map, name)).transpose()?;
    let context = arguments.part.context.as_deref();
    let counts = map.counts(context)?;
    let name = text::called(&map, context);
    let out = &arguments.out;
    let scale = match arguments.scale {
        ScaleName::Full => figures::Scale::Full,
        ScaleName::Max => figures::Scale::Max,
    };
    let options = Options { scale, ..options(&arguments.look, arguments.gamma, out) };
    let pictures = Pictures::new(&map.grid, &counts, &name, &[], options.clone())?;
    let one = |path: &Path| -> Result<String, MapError> {
        let picture = match class {
            Some(class) => pictures.class(class)?,
            None => pictures.overview()?,
        };
        pictures::write(path, &picture)?;
        Ok(format!("wrote {}\n", path.display()))
    };
    if format_of(out).is_some() {
        return one(out);
    }
    std::fs::create_dir_all(out).map_err(write_error(out))?;
    match class {
        Some(class) => one(&picture_path(out, &map.grid.classes[class].name, options.format)),
        None => {
            pictures.write_all(out)?;
            Ok(format!("wrote {} pictures to {}\n", map.grid.classes.len() + 1, out.display()))
        }
    }
}

fn difference(arguments: &Diff) -> Result<String, MapError> {
    check_share("--change-min", arguments.change_min, 0.001)?;
    arguments.out.as_deref().map_or(Ok(()), check_picture)?;
    let [before, after] = exactly(&arguments.maps, "diff")?;
    same_grid(&before, &after)?;
    let class = arguments.look.class.as_deref().map(|name| class_of(&before, name)).transpose()?;
    let context = arguments.part.context.as_deref();
    let counts = [before.counts(context)?, after.counts(context)?];
    let difference = diff::compare(&before.grid, &counts[0], &counts[1], arguments.change_min);
    let names = [text::called(&before, context), text::called(&after, context)];
    let document = text::document(&before.grid, &names, &difference);
    if let Some(out) = &arguments.out {
        let options = options(&arguments.look, arguments.gamma, out);
        let drawing =
            Drawing { grid: &before.grid, counts: &counts, names: &names, difference: &difference };
        drawing.write(out, class, &options)?;
        if format_of(out).is_none() {
            let path = out.join("diff.json");
            std::fs::write(&path, &document).map_err(write_error(&path))?;
        }
    }
    Ok(match arguments.format {
        Format::Text => text::difference(&before.grid, &names, &difference),
        Format::Json => document,
    })
}

fn export(arguments: &Export) -> Result<String, MapError> {
    check_share("--occupied-min", arguments.occupied_min, 0.0)?;
    let [map] = exactly(&arguments.maps, "export")?;
    let counts = map.counts(arguments.part.context.as_deref())?;
    let out = &arguments.out;
    match arguments.format {
        ExportFormat::Nav2 => {
            let class = match &arguments.class {
                Some(name) => class_of(&map, name)?,
                None => map.grid.class_of_always(1.0).ok_or_else(|| {
                    let text = "no class is occupied on all timescales: say with --class what is an \
                                obstacle";
                    MapError::Usage(text.to_owned())
                })?,
            };
            export::write_nav2(out, &map.grid, &counts, class, arguments.occupied_min)
                .map_err(write_error(out))?;
            Ok(format!("wrote map.yaml and map.pgm to {}\n", out.display()))
        }
        ExportFormat::Npy => {
            overwrite::for_map(out, arguments.force)?;
            let contexts = match &arguments.part.context {
                Some(_) => Vec::new(),
                None => contexts_of(&map)?,
            };
            let mut grid = map.grid.clone();
            if contexts.is_empty() {
                grid.contexts = arguments.part.context.iter().cloned().collect();
            }
            export::write_map(out, &grid, &counts, &contexts)
                .and_then(|()| export::write_shares(out, &grid, &counts))
                .map_err(write_error(out))?;
            Ok(format!(
                "wrote collapsed_counts.npy, shares.npy and grid.json to {}\n",
                out.display()
            ))
        }
    }
}

/// The counts of each context of a map by name.
fn contexts_of(map: &StoredMap) -> Result<Vec<(String, Vec<u64>)>, MapError> {
    let counts = |name: &String| Ok((name.clone(), map.counts(Some(name))?));
    map.grid.contexts.iter().map(counts).collect()
}

fn merge(arguments: &Merge) -> Result<String, MapError> {
    let maps = open(&arguments.maps)?;
    let [first, others @ ..] = maps.as_slice() else {
        return Err(MapError::Usage("`tog map merge` needs two maps or more".to_owned()));
    };
    if others.is_empty() {
        return Err(MapError::Usage("`tog map merge` needs two maps or more, found 1".to_owned()));
    }
    for (index, map) in maps.iter().enumerate() {
        if maps[..index].iter().any(|other| other.place == map.place) {
            return Err(MapError::Usage(format!(
                "{} is given twice: each of its frames would be counted twice",
                map.name
            )));
        }
    }
    let mut grid = first.grid.clone();
    let mut total = first.counts(None)?;
    let mut contexts = contexts_of(first)?;
    for map in others {
        same_grid(first, map)?;
        add(&mut total, &map.counts(None)?, &map.name)?;
        for (name, counts) in contexts_of(map)? {
            match contexts.iter_mut().find(|(known, _)| *known == name) {
                Some((_, sum)) => add(sum, &counts, &map.name)?,
                None => contexts.push((name, counts)),
            }
        }
        for laser in &map.grid.lasers {
            if !grid.lasers.iter().any(|known| known.id == laser.id) {
                grid.lasers.push(laser.clone());
            }
        }
    }
    grid.contexts = contexts.iter().map(|(name, _)| name.clone()).collect();
    let out = &arguments.out;
    overwrite::for_map(out, arguments.force)?;
    export::write_map(out, &grid, &total, &contexts).map_err(write_error(out))?;
    let name = format!("{} maps", maps.len());
    Pictures::new(&grid, &total, &name, &[], Options::default())?.write_all(out)?;
    Ok(format!("wrote the sum of {} maps to {}\n", maps.len(), out.display()))
}
