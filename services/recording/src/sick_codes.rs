//! Range values that are fault codes of a SICK LMS-2xx: logs keep them as metres.
//!
//! The device sends the highest codes of its number as words instead of ranges (SICK telegram
//! listing 8007954/Q501): ..F7 "beyond the maximum" and ..FF "no pulse came back" mean that nothing
//! was there; dazzle (..FE), overflow (..FD), signal to noise (..FB) and channel errors (..FA) say
//! nothing. What the number is depends on the mode: 13 bits of cm (81.83 to 81.91 m) or of mm (8.183
//! to 8.191), 14 or 15 bits of mm (16.375 to 16.383, 32.759 to 32.767).

/// The codes of one mode of measurement.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct SickCodes {
    /// What code ..F7 reads, metres: no reading is longer.
    pub range_max_m: f64,
    unit_m: f64,
}

const ALL: [SickCodes; 4] = [
    SickCodes { range_max_m: 81.83, unit_m: 0.01 },
    SickCodes { range_max_m: 32.759, unit_m: 0.001 },
    SickCodes { range_max_m: 16.375, unit_m: 0.001 },
    SickCodes { range_max_m: 8.183, unit_m: 0.001 },
];
/// The codes that there are, counted from ..F7: the numbers between them are ranges.
const CODES: [u32; 6] = [0, 3, 4, 6, 7, LAST_CODE];
const LAST_CODE: u32 = 8;

impl SickCodes {
    /// The mode in which the highest number of a log is a code.
    pub fn of_highest(highest_m: f64) -> Option<Self> {
        ALL.into_iter().find(|codes| codes.code(highest_m).is_some())
    }

    /// The mode of a driver that tells a range of 8.192, 16.384, 32.768 or 81.92 m.
    pub fn of_declared_max(range_max_m: f64) -> Option<Self> {
        let next_m = |codes: &Self| codes.range_max_m + f64::from(LAST_CODE + 1) * codes.unit_m;
        ALL.into_iter().find(|codes| (next_m(codes) - range_max_m).abs() < codes.unit_m / 2.0)
    }

    /// Number of the code behind ..F7, if the reading is one.
    fn code(&self, range_m: f64) -> Option<u32> {
        let exact_m = |code: &u32| self.range_max_m + f64::from(*code) * self.unit_m;
        CODES.into_iter().find(|code| (range_m - exact_m(code)).abs() < 2e-4)
    }

    /// A reading by REP 117: +inf for "nothing there", NaN for a fault, else as it is.
    pub fn decoded(&self, range_m: f32) -> f32 {
        match self.code(f64::from(range_m)) {
            None => range_m,
            Some(0 | LAST_CODE) => f32::INFINITY,
            Some(_) => f32::NAN,
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn codes_are_told_from_ranges_by_the_highest_number_of_a_log() {
        let highest = |m| SickCodes::of_highest(m).map(|codes| codes.range_max_m);
        assert_eq!(highest(81.83), Some(81.83));
        assert_eq!(highest(81.91), Some(81.83));
        assert_eq!(highest(32.767), Some(32.759));
        assert_eq!(highest(8.191), Some(8.183));
        assert_eq!([25.38, 32.76, 80.0, 81.92, 8.0, f64::NAN].map(highest), [None; 6]);
        let declared = |m| SickCodes::of_declared_max(m).map(|codes| codes.range_max_m);
        assert_eq!(
            [8.192, 16.384, 32.768, 81.92].map(declared),
            [8.183, 16.375, 32.759, 81.83].map(Some)
        );
        assert_eq!([8.0, 30.0, 5.6].map(declared), [None; 3]);
    }

    #[test]
    fn nothing_there_is_no_return_and_a_fault_says_nothing() {
        let codes = SickCodes::of_highest(32.767).unwrap();
        assert_eq!(codes.decoded(32.767), f32::INFINITY);
        assert_eq!(codes.decoded(32.759), f32::INFINITY);
        assert!(codes.decoded(32.763).is_nan() && codes.decoded(32.765).is_nan());
        assert_eq!(codes.decoded(32.75), 32.75);
        assert_eq!(codes.decoded(3.46), 3.46);
    }
}
