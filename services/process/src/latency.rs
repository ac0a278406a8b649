//! How long from the publication of the scan that completed a frame to what came of it here: the newest
//! [`KEPT`] of them, so that a percentile is exact and its cost is bounded.

use std::collections::VecDeque;

/// Enough for a 99th percentile of ten values beyond it.
pub const KEPT: usize = 1000;

/// The newest latencies, nanoseconds.
#[derive(Debug, Default)]
pub struct Latencies {
    newest: VecDeque<u64>,
}

impl Latencies {
    /// Something that was received at `now_mono_ns`. One without a scan to blame (0), or with one
    /// from the future, says nothing.
    pub fn observe(&mut self, completed_by_mono_ns: u64, now_mono_ns: u64) {
        if completed_by_mono_ns == 0 || completed_by_mono_ns > now_mono_ns {
            return;
        }
        if self.newest.len() == KEPT {
            self.newest.pop_front();
        }
        self.newest.push_back(now_mono_ns - completed_by_mono_ns);
    }

    /// The smallest latency that at least `share` (0..=1) of the newest do not exceed, ns.
    pub fn percentile_ns(&self, share: f64) -> Option<u64> {
        let mut sorted: Vec<u64> = self.newest.iter().copied().collect();
        sorted.sort_unstable();
        let rank = (share * sorted.len() as f64).ceil() as usize;
        sorted.get(rank.max(1) - 1).copied()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_are_those_of_the_newest() {
        let mut latencies = Latencies::default();
        assert_eq!(latencies.percentile_ns(0.5), None);
        latencies.observe(0, 50);
        latencies.observe(60, 50);
        assert_eq!(latencies.percentile_ns(0.5), None, "they say nothing");
        for latency in (1..=2 * KEPT as u64).rev() {
            latencies.observe(10, 10 + latency);
        }
        assert_eq!(latencies.percentile_ns(0.5), Some(500));
        assert_eq!(latencies.percentile_ns(0.99), Some(990));
        assert_eq!(latencies.percentile_ns(1.0), Some(1000));
        assert_eq!(latencies.percentile_ns(0.0), Some(1));
    }
}
