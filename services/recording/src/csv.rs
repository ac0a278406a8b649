//! A CSV of scans, one a row; its columns are declared (see [`ColumnMap`]).
//!
//! **Here:** a row ends with its line: quotes are read, a line break between quotes is not. Fields are
//! parted by commas, semicolons or tabs, whichever the first line has most of. One line without a
//! number among its ranges may stand before the rows: titles. Lines that begin with `#` are
//! comments, unless they have as many fields as a row, and numbers for ranges. Every other line is
//! a row: a scan, or refused.

use crate::columns::{ColumnMap, Name};
use crate::laser_scan::{Decoded, LINE_BYTES_MAX};
use csv_core::ReadRecordResult;
use protocol::scan::{BEAMS_MAX, LaserScan, ScanGeometry};
use std::borrow::Cow;

/// Most fields of a row.
const FIELDS_MAX: usize = BEAMS_MAX + 512;
/// Name of the laser where the rows do not say it.
const LASER: &str = "/scan";

/// A CSV while it is read.
pub(crate) struct Csv {
    map: ColumnMap,
    parser: csv_core::Reader,
    /// The fields of the current row, one behind the other, and where each ends.
    text: Vec<u8>,
    ends: Vec<usize>,
    fields: usize,
    /// No line but comments was met.
    may_be_titles: bool,
}

/// Comma, semicolon or tab: what the line has most of.
fn delimiter(line: &str) -> u8 {
    let count = |delimiter: &u8| line.bytes().filter(|byte| byte == delimiter).count();
    // `max_by_key` takes the last of equals.
    [b'\t', b';', b','].into_iter().max_by_key(count).unwrap_or(b',')
}

/// The columns that a line declares, if it does.
pub(crate) fn declared(line: &str) -> Option<ColumnMap> {
    if !line.trim_start_matches('\u{feff}').starts_with(['t', 'l', 'a', 'r', 'f', 's', '-']) {
        return None;
    }
    let line = line.trim_start_matches('\u{feff}').trim_end();
    let entries = line.split(char::from(delimiter(line)));
    ColumnMap::of_entries(entries.map(|entry| entry.trim_matches('"'))).ok()
}

impl Csv {
    /// Rows of this map; the first line tells what parts the fields.
    pub fn new(map: ColumnMap, first_line: &str) -> Self {
        Self {
            map,
            parser: csv_core::ReaderBuilder::new().delimiter(delimiter(first_line)).build(),
            text: vec![0; LINE_BYTES_MAX],
            ends: vec![0; FIELDS_MAX],
            fields: 0,
            may_be_titles: true,
        }
    }

    /// Takes a line: the laser of its row, or `None` if it is no row.
    ///
    /// # Errors
    /// A row with too many fields, or a quote that does not end.
    pub fn take(&mut self, line: &str) -> Result<Option<String>, String> {
        self.fields = 0;
        if line.trim().is_empty() {
            return Ok(None);
        }
        if line.starts_with('#') {
            let is_row = self.split(line).is_ok() && self.row().is_ok_and(|row| self.is_full(&row));
            return Ok(is_row.then(|| LASER.to_owned()));
        }
        self.split(line)?;
        let is_first = std::mem::take(&mut self.may_be_titles);
        let row = self.row()?;
        let has_time = matches!(self.map.time_ns(&row, Name::Time), Some(Ok(_)));
        if is_first && !has_time && !self.map.has_range(&row) {
            return Ok(None);
        }
        Ok(Some(self.map.word(&row, Name::Laser).unwrap_or(LASER).to_owned()))
    }

    /// True for as many fields as a row has, with a number for a range.
    fn is_full(&self, row: &[&str]) -> bool {
        row.len() >= self.map.columns().0 && self.map.has_range(row)
    }

    fn split(&mut self, line: &str) -> Result<(), String> {
        let mut bytes = line.trim_end_matches(['\r', '\n']).as_bytes().to_vec();
        bytes.push(b'\n');
        self.parser.reset();
        let (result, _, _, fields) =
            self.parser.read_record(&bytes, &mut self.text, &mut self.ends);
        match result {
            ReadRecordResult::Record => self.fields = fields,
            ReadRecordResult::OutputEndsFull => {
                return Err(format!("more than {FIELDS_MAX} fields in a row"));
            }
            _ => return Err("a quote does not end on its line".to_owned()),
        }
        Ok(())
    }

    fn row(&self) -> Result<Vec<&str>, String> {
        let mut begin = 0;
        let field = |end: &usize| {
            let bytes = self.text.get(begin..*end).unwrap_or_default();
            begin = *end;
            std::str::from_utf8(bytes).map_err(|_| "a field is not UTF-8".to_owned())
        };
        self.ends[..self.fields].iter().map(field).collect()
    }

    /// The scan of the row that was taken last.
    ///
    /// # Errors
    /// What was found and what was expected.
    pub fn decode(&self) -> Result<Decoded<'static>, String> {
        let (row, map) = (self.row()?, &self.map);
        let (columns, has_rest) = map.columns();
        if row.len() < columns || (row.len() > columns && !has_rest) {
            let more = if has_rest { " or more" } else { "" };
            return Err(format!("a row of {} fields, expected {columns}{more}", row.len()));
        }
        let ranges_m = map.ranges_m(&row)?;
        if ranges_m.is_empty() {
            return Err("a scan of 0 ranges, expected at least 1".to_owned());
        }
        let lacks = |what: &str| format!("the row lacks {what}");
        let stamp_ns = map.time_ns(&row, Name::Time).ok_or_else(|| lacks("t"))??;
        let log_time_ns = map.time_ns(&row, Name::LogTime).transpose()?.or(Some(stamp_ns));
        let real = |name, what: &str| map.real(&row, name, what).transpose();
        let angle_min_rad = real(Name::AngleMin, "angle_min")?.ok_or_else(|| lacks("angle_min"))?;
        let angle_increment_rad = match real(Name::AngleIncrement, "angle_increment")? {
            Some(increment) => increment,
            None => {
                let last = real(Name::AngleMax, "angle_max")?.ok_or_else(|| lacks("angle_max"))?;
                (last - angle_min_rad) / (ranges_m.len().max(2) - 1) as f64
            }
        };
        let geometry = crate::writer::as_recorded(&ScanGeometry {
            angle_min_rad,
            angle_increment_rad,
            range_min_m: real(Name::RangeMin, "range_min")?.unwrap_or(0.0),
            range_max_m: real(Name::RangeMax, "range_max")?.ok_or_else(|| lacks("range_max"))?,
        });
        geometry.check()?;
        let scan = LaserScan { stamp_ns, device_stamp_ns: 0, geometry, ranges_m };
        let frame_id = Cow::Owned(map.word(&row, Name::FrameId).unwrap_or_default().to_owned());
        let turn_ns = real(Name::ScanTime, "scan_time")?.unwrap_or(0.0);
        Ok(Decoded { scan, frame_id, scan_time_s: (turn_ns / 1e9) as f32, log_time_ns })
    }
}
