//! Pictures of what changed.

use super::diff::Difference;
use super::grid_file::GridFile;
use super::pictures::{self, picture_path};
use super::{MapError, format_of, write_error};
use figures::{ChangeMap, EventMark, Options};
use std::path::Path;

/// Most places that are marked in a picture of changes: more would hide the map.
const PLACE_MARKS_MAX: usize = 12;

/// Pictures of a difference.
pub struct Drawing<'m> {
    /// Of both maps.
    pub grid: &'m GridFile,
    /// Of both maps, the earlier first.
    pub counts: &'m [Vec<u64>; 2],
    /// Of both maps.
    pub names: &'m [String; 2],
    /// What changed.
    pub difference: &'m Difference,
}

impl Drawing<'_> {
    /// Writes the picture of `class`, or of the one that changed most; into a directory, of all.
    ///
    /// # Errors
    /// If a picture cannot be drawn or written.
    pub fn write(
        &self,
        out: &Path,
        class: Option<usize>,
        options: &Options,
    ) -> Result<(), MapError> {
        if format_of(out).is_some() {
            let class = class.unwrap_or_else(|| self.most_changed());
            return Ok(pictures::write(out, &self.picture(class, options)?)?);
        }
        std::fs::create_dir_all(out).map_err(write_error(out))?;
        let all = 0..self.grid.classes.len();
        for class in all.filter(|index| class.is_none_or(|class| class == *index)) {
            let name = format!("change_{}", self.grid.classes[class].name);
            let path = picture_path(out, &name, options.format);
            pictures::write(&path, &self.picture(class, options)?)?;
        }
        Ok(())
    }

    /// The class with the most changed cells; a wall rather than the emptiness that it took.
    fn most_changed(&self) -> usize {
        let nothing = self.grid.class_of_always(0.0);
        let changed = |index: &usize| {
            let class = &self.difference.classes[*index];
            (class.cells_more + class.cells_less, Some(*index) == self.grid.class_of_always(1.0))
        };
        let classes = (0..self.grid.classes.len()).filter(|index| Some(*index) != nothing);
        classes.max_by_key(changed).unwrap_or(0)
    }

    fn picture(&self, class: usize, options: &Options) -> Result<Vec<u8>, MapError> {
        let name = &self.grid.classes[class].name;
        let geometry = self.grid.geometry();
        let share = |counts: &[u64]| {
            figures::shares(counts, self.grid.classes.len(), geometry.cells())
                .map(|mut shares| shares.swap_remove(class))
        };
        let map = ChangeMap {
            grid: geometry,
            before: share(&self.counts[0])?,
            after: share(&self.counts[1])?,
            title: format!("{}: change of the share of `{name}`", self.grid.area),
            subtitle: format!("from {} to {}", self.names[0], self.names[1]),
        };
        let places = self.difference.places.iter();
        let marks: Vec<EventMark> = places
            .filter(|place| place.from == *name || place.to == *name)
            .map(|place| EventMark { x_m: place.x_m, y_m: place.y_m, label: place.text.clone() })
            .take(PLACE_MARKS_MAX)
            .collect();
        let lasers = pictures::laser_marks(&self.grid.lasers);
        Ok(figures::share_change(&map, &lasers, &marks, options)?)
    }
}
