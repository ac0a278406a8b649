//! A scan: one turn of one laser.
//!
//! Reading (REP 117): finite in [range_min, range_max) is an echo; +inf or >= range_max is no return;
//! -inf, NaN, below range_min is invalid and says nothing. A fault is never "free".

use crate::wire::{ENVELOPE_BYTES, Envelope, header};
use bytemuck::{Pod, Zeroable};
use serde::{Deserialize, Serialize};
use std::fmt;

/// Most beams of a scan: 0.0879 degrees over a full turn; the finest planar lasers have 2 880 to 3 600.
pub const BEAMS_MAX: usize = 4096;

/// How the beams of a scan lie and what range the device can measure.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable, Serialize, Deserialize)]
pub struct ScanGeometry {
    /// Bearing of beam 0 in laser coordinates, radians.
    pub angle_min_rad: f64,
    /// Bearing of beam b is `angle_min_rad + b * angle_increment_rad`; may be negative (clockwise).
    pub angle_increment_rad: f64,
    /// Shortest valid reading, metres.
    pub range_min_m: f64,
    /// A reading at or above this is "no return", metres.
    pub range_max_m: f64,
}

/// As a person reads it: `from -90.000 deg every 0.5000 deg, 0.020 to 8.000 m`.
impl fmt::Display for ScanGeometry {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "from {:.3} deg every {:.4} deg, {:.3} to {:.3} m",
            self.angle_min_rad.to_degrees(),
            self.angle_increment_rad.to_degrees(),
            self.range_min_m,
            self.range_max_m
        )
    }
}

impl ScanGeometry {
    /// Bearing of a beam in laser coordinates, radians, not wrapped.
    #[must_use]
    pub fn bearing_rad(&self, beam: usize) -> f64 {
        self.angle_min_rad + beam as f64 * self.angle_increment_rad
    }

    /// Says what is wrong with the numbers, if anything is: they must be finite, the increment not
    /// zero, 0 <= range_min < range_max <= 1000 m.
    ///
    /// # Errors
    /// A sentence with what was found and what was expected.
    pub fn check(&self) -> Result<(), String> {
        let finite =
            [self.angle_min_rad, self.angle_increment_rad, self.range_min_m, self.range_max_m]
                .iter()
                .all(|value| value.is_finite());
        if !finite {
            return Err(format!("scan geometry holds a number that is not finite: {self}"));
        }
        if self.angle_increment_rad == 0.0 || self.angle_increment_rad.abs() > 1.0 {
            return Err(format!(
                "angle increment is {} rad, expected 0 < |increment| <= 1",
                self.angle_increment_rad
            ));
        }
        if self.angle_min_rad.abs() > 10.0 {
            return Err(format!("angle_min is {} rad, expected -10..10", self.angle_min_rad));
        }
        if !(0.0 <= self.range_min_m
            && self.range_min_m < self.range_max_m
            && self.range_max_m <= 1000.0)
        {
            return Err(format!(
                "ranges are {}..{} m, expected 0 <= range_min < range_max <= 1000",
                self.range_min_m, self.range_max_m
            ));
        }
        Ok(())
    }
}

/// What one reading says.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Reading {
    /// Something is at this range, metres.
    Echo(f64),
    /// Nothing up to range_max.
    NoReturn,
    /// A fault, a nonsense number: says nothing.
    Invalid,
}

/// Reads one raw range (metres) by REP 117 against the limits of its laser.
#[must_use]
pub fn reading(range_m: f32, geometry: &ScanGeometry) -> Reading {
    let range_m = f64::from(range_m);
    if range_m.is_nan() || range_m < geometry.range_min_m {
        Reading::Invalid // -inf is below every range_min
    } else if range_m >= geometry.range_max_m {
        Reading::NoReturn
    } else {
        Reading::Echo(range_m)
    }
}

/// Header of a scan in shared memory; the payload is `[f32]`, one raw range in metres a beam.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
pub struct ScanHeader {
    /// Common part; `source` is the laser's index in the site file.
    pub envelope: Envelope,
    /// Host time of the first beam, UNIX nanoseconds.
    pub stamp_ns: u64,
    /// The device's own clock at the first beam, nanoseconds; 0 if the device has none.
    pub device_stamp_ns: u64,
    /// How the beams lie.
    pub geometry: ScanGeometry,
}
header!(ScanHeader, "tog.ScanHeader.v1", ENVELOPE_BYTES + 8 + 8 + 32);

/// A scan that owns its ranges: for recordings, the network, and tests.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct LaserScan {
    /// Host time of the first beam, UNIX nanoseconds.
    pub stamp_ns: u64,
    /// The device's own clock at the first beam, nanoseconds; 0 if the device has none.
    pub device_stamp_ns: u64,
    /// How the beams lie.
    pub geometry: ScanGeometry,
    /// Raw range of every beam, metres; at most [`BEAMS_MAX`].
    pub ranges_m: Vec<f32>,
}

impl LaserScan {
    /// A view of this scan.
    #[must_use]
    pub fn view(&self) -> ScanView<'_> {
        ScanView { stamp_ns: self.stamp_ns, geometry: self.geometry, ranges_m: &self.ranges_m }
    }
}

/// A borrowed scan: what the cores take, whether it lies in shared memory or in a `LaserScan`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ScanView<'a> {
    /// Host time of the first beam, UNIX nanoseconds.
    pub stamp_ns: u64,
    /// How the beams lie.
    pub geometry: ScanGeometry,
    /// Raw range of every beam, metres.
    pub ranges_m: &'a [f32],
}

impl<'a> ScanView<'a> {
    /// A scan as it lies in shared memory.
    #[must_use]
    pub fn from_wire(header: &ScanHeader, ranges_m: &'a [f32]) -> Self {
        Self { stamp_ns: header.stamp_ns, geometry: header.geometry, ranges_m }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fault_is_never_free() {
        let geometry = ScanGeometry {
            angle_min_rad: 0.0,
            angle_increment_rad: 0.01,
            range_min_m: 0.02,
            range_max_m: 8.0,
        };
        for fault in [f32::NAN, f32::NEG_INFINITY, -1.0, 0.0, 0.0199] {
            assert_eq!(reading(fault, &geometry), Reading::Invalid, "{fault}");
        }
        for none in [f32::INFINITY, 8.0, 81.91] {
            assert_eq!(reading(none, &geometry), Reading::NoReturn, "{none}");
        }
        assert_eq!(reading(7.5, &geometry), Reading::Echo(7.5));
    }
}
