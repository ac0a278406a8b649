//! Times between scans in bounded memory: counts of intervals of nearly the same length.

use std::collections::BTreeMap;

/// An interval is counted with those that differ by less than this share.
const BIN_SHARE: f64 = 1e-3;
/// An interval that is so many medians long is a gap: at least one scan is missing.
pub(crate) const GAP_MEDIANS: f64 = 2.5;

/// Times between scans. A stamp that is not above the highest before is only counted.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Intervals {
    /// Count and sum by length.
    bins: BTreeMap<u32, (u64, u64)>,
    /// First and highest stamp.
    pub span_ns: Option<(u64, u64)>,
    pub stamps: u64,
    pub out_of_order: u64,
    pub longest_ns: u64,
}

impl Intervals {
    /// The stamp of the next scan.
    pub fn add(&mut self, stamp_ns: u64) {
        self.stamps += 1;
        let Some((_, last_ns)) = &mut self.span_ns else {
            self.span_ns = Some((stamp_ns, stamp_ns));
            return;
        };
        if stamp_ns <= *last_ns {
            self.out_of_order += 1;
            return;
        }
        let interval_ns = stamp_ns - *last_ns;
        *last_ns = stamp_ns;
        self.longest_ns = self.longest_ns.max(interval_ns);
        let bin = (interval_ns as f64).ln() / BIN_SHARE.ln_1p();
        let (count, sum_ns) = self.bins.entry(bin as u32).or_default();
        *count += 1;
        *sum_ns = sum_ns.saturating_add(interval_ns);
    }

    /// Lengths (means of their bins) and counts, rising.
    fn lengths_ns(&self) -> impl Iterator<Item = (f64, u64)> {
        self.bins.values().map(|(count, sum_ns)| (*sum_ns as f64 / *count as f64, *count))
    }

    /// The median, ns; `None` for less than two scans in order.
    pub fn median_ns(&self) -> Option<f64> {
        share_below(self.lengths_ns(), 0.5)
    }

    /// What 95 of 100 intervals differ from the median by at most, ns.
    pub fn jitter_ns(&self) -> f64 {
        let Some(median_ns) = self.median_ns() else { return 0.0 };
        let off = |(length_ns, count): (f64, u64)| ((length_ns - median_ns).abs(), count);
        let mut offs: Vec<(f64, u64)> = self.lengths_ns().map(off).collect();
        offs.sort_by(|a, b| a.0.total_cmp(&b.0));
        share_below(offs.into_iter(), 0.95).unwrap_or(0.0)
    }

    /// Intervals that are longer than [`GAP_MEDIANS`] medians.
    pub fn gaps(&self) -> u64 {
        let Some(median_ns) = self.median_ns() else { return 0 };
        let is_gap = |(length_ns, _): &(f64, u64)| *length_ns > GAP_MEDIANS * median_ns;
        self.lengths_ns().filter(is_gap).map(|(_, count)| count).sum()
    }
}

/// The value that this share of the counts is not above.
fn share_below(values: impl Iterator<Item = (f64, u64)>, share: f64) -> Option<f64> {
    let values: Vec<(f64, u64)> = values.collect();
    let all: u64 = values.iter().map(|(_, count)| count).sum();
    let wanted = (all as f64 * share).ceil() as u64;
    let mut below = 0;
    values.into_iter().find_map(|(value, count)| {
        below += count;
        (below >= wanted && all > 0).then_some(value)
    })
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn a_hole_is_a_gap_and_does_not_move_the_median() {
        let mut intervals = Intervals::default();
        let period_ns = 13_333_333;
        for turn in (0..1000).filter(|turn| !(300..320).contains(turn)) {
            intervals.add(1_700_000_000_000_000_000 + turn * period_ns);
        }
        assert_eq!(intervals.median_ns().unwrap(), period_ns as f64);
        assert_eq!((intervals.gaps(), intervals.longest_ns), (1, 21 * period_ns));
        assert_eq!(intervals.jitter_ns(), 0.0);
        intervals.add(1_700_000_000_000_000_000);
        assert_eq!(intervals.out_of_order, 1);
    }

    #[test]
    fn jitter_is_what_most_intervals_keep_within() {
        let mut intervals = Intervals::default();
        let mut stamp_ns = 0;
        for turn in 0..1000 {
            stamp_ns += 100_000_000 + if turn % 2 == 0 { 4_000_000 } else { 0 };
            intervals.add(stamp_ns);
        }
        assert!((intervals.jitter_ns() - 4e6).abs() < 1e5, "{}", intervals.jitter_ns());
        assert_eq!(Intervals::default().median_ns(), None);
    }
}
