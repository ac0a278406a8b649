//! Time: nanoseconds of the UNIX epoch, and the lattice of frames.
//!
//! Frame m has the stamp tau = m*T, counted from the epoch. Everything that asks "which frame?"
//! asks this file, so that replay, fusion and mapper cannot disagree by a rounding.

/// Nanoseconds in a second.
pub const SECOND_NS: u64 = 1_000_000_000;
/// Nanoseconds in a millisecond.
pub const MILLISECOND_NS: u64 = 1_000_000;

/// The fixed lattice of frame stamps: frame m is stamped m*T nanoseconds after the epoch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Lattice {
    period_ns: u64,
}

impl Lattice {
    /// A lattice of period T. A period of zero is raised to 1 ns: the site file refuses it.
    #[must_use]
    pub fn new(period_ns: u64) -> Self {
        Self { period_ns: period_ns.max(1) }
    }

    /// T in nanoseconds.
    #[must_use]
    pub fn period_ns(self) -> u64 {
        self.period_ns
    }

    /// The stamp tau of frame `number`; saturates at the end of u64 (year 2554).
    #[must_use]
    pub fn stamp_ns(self, number: u64) -> u64 {
        number.saturating_mul(self.period_ns)
    }

    /// The first frame whose stamp is not before `stamp_ns`: ceil(stamp / T).
    #[must_use]
    pub fn first_at_or_after(self, stamp_ns: u64) -> u64 {
        stamp_ns.div_ceil(self.period_ns)
    }

    /// The last frame whose stamp is not after `stamp_ns`: floor(stamp / T).
    #[must_use]
    pub fn last_at_or_before(self, stamp_ns: u64) -> u64 {
        stamp_ns / self.period_ns
    }

    /// N_k = max(1, round(timescale / T)) frames; a half is rounded up (semantics.md, "Temporal grid").
    #[must_use]
    pub fn frames_in(self, timescale_s: f64) -> u32 {
        let frames = (timescale_s * SECOND_NS as f64 / self.period_ns as f64 + 0.5).floor();
        frames.clamp(1.0, f64::from(u32::MAX)) as u32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stamp_on_the_lattice_is_its_own_frame() {
        let lattice = Lattice::new(100 * MILLISECOND_NS);
        assert_eq!(lattice.first_at_or_after(1_000_000_000), 10);
        assert_eq!(lattice.last_at_or_before(1_000_000_000), 10);
        assert_eq!(lattice.first_at_or_after(1_000_000_001), 11);
        assert_eq!(lattice.last_at_or_before(999_999_999), 9);
    }

    #[test]
    fn a_timescale_shorter_than_the_period_still_has_one_frame() {
        let lattice = Lattice::new(100 * MILLISECOND_NS);
        assert_eq!(lattice.frames_in(0.01), 1);
        assert_eq!(lattice.frames_in(1.0), 10);
        assert_eq!(lattice.frames_in(0.25), 3);
        // Trap T5 of the measurements: a period rounded to nanoseconds still gives 75 frames a second.
        assert_eq!(Lattice::new(13_333_333).frames_in(60.0), 4500);
    }
}
