//! Maps as messages. Rows go from the lowest y up, in ours as in those of ROS: nothing is flipped.

use crate::catalogue::{SITE_FRAME, class_value};
use protocol::grid::CLASS_UNKNOWN;
use protocol::site::Area;
use recording::ros2::{
    self, Bytes, EncodeError, Grid, Header, MapMetaData, OccupancyGrid, PackedField, Point, Pose,
    Time, Vector2,
};

/// -1 of an OccupancyGrid: nobody knows.
const UNKNOWN: u8 = 255;
/// Bytes of a count in a Grid.
const COUNT_BYTES: usize = 8;

/// Makes the maps of an area.
#[derive(Debug, Clone)]
pub struct MapMaker {
    area: Area,
    names: Vec<String>,
    cells: Vec<u8>,
}

impl MapMaker {
    /// For this area.
    #[must_use]
    pub fn new(area: &Area) -> Self {
        let names = area.class_names().into_iter().map(|class| class.name).collect();
        Self { area: area.clone(), names, cells: Vec::new() }
    }

    /// Classes of the area.
    #[must_use]
    pub fn classes(&self) -> usize {
        self.names.len()
    }

    /// A class map: a cell's class as [`class_value`], -1 where it is unknown.
    ///
    /// # Errors
    /// None that is known: see [`ros2::encode`].
    pub fn class_map(
        &mut self,
        stamp: Time,
        classes: &[u8],
        buffer: &mut Vec<u8>,
    ) -> Result<(), EncodeError> {
        let count = self.names.len();
        let value = |class: &u8| match *class {
            CLASS_UNKNOWN => UNKNOWN,
            class => class_value(usize::from(class), count),
        };
        self.cells.clear();
        self.cells.extend(classes.iter().map(value));
        self.occupancy_grid(stamp, buffer)
    }

    /// A class of a collapsed map: percent of the frames that were counted, rounded; -1 where none
    /// was. `counts` is [class, row, column].
    ///
    /// # Errors
    /// None that is known: see [`ros2::encode`].
    pub fn percent(
        &mut self,
        stamp: Time,
        counts: &[u64],
        class: usize,
        buffer: &mut Vec<u8>,
    ) -> Result<(), EncodeError> {
        let cells = self.area.grid().cells();
        self.cells.clear();
        self.cells.extend((0..cells).map(|cell| {
            let of = |class: usize| counts[class * cells + cell];
            let total: u128 = (0..self.names.len()).map(|class| u128::from(of(class))).sum();
            let rounded = (u128::from(of(class)) * 200 + total).checked_div(2 * total);
            rounded.map_or(UNKNOWN, |percent| percent as u8)
        }));
        self.occupancy_grid(stamp, buffer)
    }

    fn occupancy_grid(&self, stamp: Time, buffer: &mut Vec<u8>) -> Result<(), EncodeError> {
        let message = OccupancyGrid {
            header: Header { stamp, frame_id: SITE_FRAME },
            info: MapMetaData {
                map_load_time: stamp,
                resolution: self.area.cell_m as f32,
                width: self.area.columns,
                height: self.area.rows,
                origin: self.origin(),
            },
            data: Bytes(&self.cells),
        };
        ros2::encode(&message, 128 + self.cells.len(), buffer)
    }

    /// A collapsed map, exact: in each cell one f64 a class, which holds whole numbers up to 2^53
    /// exactly, millions of years of frames. `counts` is [class, row, column].
    ///
    /// # Errors
    /// None that is known: see [`ros2::encode`].
    pub fn counts(
        &mut self,
        stamp: Time,
        counts: &[u64],
        buffer: &mut Vec<u8>,
    ) -> Result<(), EncodeError> {
        let (cells, classes) = (self.area.grid().cells(), self.names.len());
        self.cells.clear();
        self.cells.reserve(cells * classes * COUNT_BYTES);
        for cell in 0..cells {
            for class in 0..classes {
                let count = counts[class * cells + cell] as f64;
                self.cells.extend_from_slice(&count.to_le_bytes());
            }
        }
        let fields = self.names.iter().enumerate().map(|(class, name)| PackedField {
            name,
            offset: (class * COUNT_BYTES) as u32,
            kind: PackedField::FLOAT64,
        });
        let cell_stride = (classes * COUNT_BYTES) as u32;
        let message = Grid {
            timestamp: stamp,
            frame_id: SITE_FRAME,
            pose: self.origin(),
            column_count: self.area.columns,
            cell_size: Vector2 { x: self.area.cell_m, y: self.area.cell_m },
            row_stride: cell_stride * self.area.columns,
            cell_stride,
            fields: fields.collect(),
            data: Bytes(&self.cells),
        };
        ros2::encode(&message, 512 + self.cells.len(), buffer)
    }

    fn origin(&self) -> Pose {
        let [x, y] = self.area.origin_m;
        Pose { position: Point { x, y, z: 0.0 }, ..Pose::default() }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::catalogue::tests::site;

    /// The cells are the last bytes of both messages.
    fn last(buffer: &[u8], bytes: usize) -> &[u8] {
        &buffer[buffer.len() - bytes..]
    }

    #[test]
    fn percent_is_rounded_and_what_was_never_counted_is_unknown() {
        let mut maker = MapMaker::new(&site().areas[0]);
        assert_eq!((maker.classes(), maker.area.grid().cells()), (6, 4));
        let mut counts = vec![0u64; 6 * 4];
        // Cell 0: 1 of 3 in class 0; cell 1: all in class 0; cell 2: nothing; cell 3: 1 of 200.
        (counts[0], counts[4]) = (1, 2);
        counts[1] = u64::MAX;
        (counts[3], counts[7]) = (1, 199);
        let mut buffer = Vec::new();
        maker.percent(Time::default(), &counts, 0, &mut buffer).unwrap();
        assert_eq!(last(&buffer, 4), [33, 100, UNKNOWN, 1]);
    }

    #[test]
    fn classes_are_values_that_can_be_read_back() {
        let mut maker = MapMaker::new(&site().areas[0]);
        let mut buffer = Vec::new();
        maker.class_map(Time::default(), &[0, 5, CLASS_UNKNOWN, 1], &mut buffer).unwrap();
        assert_eq!(last(&buffer, 4), [0, 100, UNKNOWN, 20]);
    }

    #[test]
    fn counts_are_exact_beyond_what_32_bits_hold() {
        let mut maker = MapMaker::new(&site().areas[0]);
        let mut counts = vec![0u64; 6 * 4];
        counts[3] = (1 << 40) + 1; // class 0 of the last cell
        counts[23] = 7; // class 5 of the last cell
        let mut buffer = Vec::new();
        maker.counts(Time::default(), &counts, &mut buffer).unwrap();
        let cell = last(&buffer, 48);
        assert_eq!(cell[..8], ((1u64 << 40) as f64 + 1.0).to_le_bytes());
        assert_eq!(cell[40..], 7f64.to_le_bytes());
    }
}
