//! From an alarm budget to a level: how high must a score be, so that normal life passes it at
//! most so often?
//!
//! Normal life was recorded as peaks. Peaks that lie within [`DECLUSTER_S`] are one happening
//! (runs declustering). For a level x let n be the number of peaks at or above x in W weeks. With 95 %
//! confidence the rate is below `garwood_upper(n) / W` (F. Garwood, 1936: the upper bound u of a
//! Poisson mean solves P(N <= n | u) = 0.05; for n = 0 this is the "rule of three", u = 3.0). The level
//! is the smallest for which that is within the budget.
//!
//! If even n = 0 does not prove the budget (W too short), the tail of the peaks over their upper
//! part is taken as a generalised Pareto distribution (method of moments, shape held to a range in
//! which it has a mean and no early end), and the level is `extrapolated`.

use serde::{Deserialize, Serialize};

/// Peaks closer than this are one happening, seconds.
pub(crate) const DECLUSTER_S: f64 = 60.0;
const WEEK_S: f64 = 7.0 * 86_400.0;
/// Most peaks that are kept: a week of one a minute is 10 080. A longer calibration takes longer
/// blocks, see [`Peaks::new`].
const PEAKS_MAX: f64 = 16_384.0;
/// Fewest peaks from which a tail is fitted; below that it is taken as exponential.
const TAIL_PEAKS_MIN: usize = 10;
/// Range of the shape of the tail: -0.3 ends within 3.3 scales; above 0 it would be heavier than
/// exponential, which a score of cells with a ceiling ([`crate::normal::L_MAX`]) is not.
const SHAPE: (f64, f64) = (-0.3, 0.0);

/// The highest score of each block of time: what normal life reaches.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Peaks {
    block_s: f64,
    /// (when, how high), seconds since calibration began.
    blocks: Vec<(f64, f64)>,
    open: Option<(f64, f64)>,
}

impl Peaks {
    /// For a calibration of `calibration_s`.
    pub(crate) fn new(calibration_s: f64) -> Self {
        let block_s = DECLUSTER_S.max(calibration_s / PEAKS_MAX);
        Self { block_s, blocks: Vec::new(), open: None }
    }

    /// Takes a score at `time_s` since calibration began; times do not fall.
    pub(crate) fn observe(&mut self, time_s: f64, score: f64) {
        if score <= 0.0 {
            return;
        }
        let block = |at: f64| (at / self.block_s).floor();
        match &mut self.open {
            Some((at, best)) if block(*at) == block(time_s) => {
                if score > *best {
                    (*at, *best) = (time_s, score);
                }
            }
            open => self.blocks.extend(open.replace((time_s, score))),
        }
    }

    /// Peaks with no higher one within [`DECLUSTER_S`], highest first.
    pub(crate) fn declustered(&self) -> Vec<f64> {
        let mut all: Vec<(f64, f64)> = self.blocks.iter().copied().chain(self.open).collect();
        all.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.total_cmp(&b.0)));
        let mut kept: Vec<(f64, f64)> = Vec::new();
        for (at, height) in all {
            if kept.iter().all(|(other, _)| (other - at).abs() >= DECLUSTER_S) {
                kept.push((at, height));
            }
        }
        kept.into_iter().map(|(_, height)| height).collect()
    }
}

/// A level and how it was found.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) struct Level {
    /// Scores at or above this are alarms.
    pub(crate) on: f64,
    /// The calibration was too short to prove it.
    pub(crate) extrapolated: bool,
}

/// The smallest level, not below `floor`, that keeps `budget_per_week` after `duration_s` of
/// normal life with these peaks (highest first).
pub(crate) fn level(peaks: &[f64], duration_s: f64, budget_per_week: f64, floor: f64) -> Level {
    let weeks = (duration_s / WEEK_S).max(1e-9);
    let allowed = budget_per_week * weeks;
    if garwood_upper(0) <= allowed {
        let mut count = 0;
        while count < peaks.len() && garwood_upper(count as u64 + 1) <= allowed {
            count += 1;
        }
        // At most `count` peaks may reach the level: it lies just above the next one.
        let on = peaks.get(count).map_or(floor, |peak| peak * (1.0 + 1e-6)).max(floor);
        return Level { on, extrapolated: false };
    }
    let on = tail_level(peaks, allowed).max(floor);
    Level { on, extrapolated: true }
}

/// The level that the fitted tail passes `allowed` times in the duration of the calibration.
fn tail_level(peaks: &[f64], allowed: f64) -> f64 {
    let Some(&highest) = peaks.first() else {
        return 0.0;
    };
    let fitted = (peaks.len() / 5).max(TAIL_PEAKS_MIN);
    let (base, scale, shape, above) = if peaks.len() > fitted {
        let base = peaks[fitted];
        let excess: Vec<f64> = peaks[..fitted].iter().map(|peak| peak - base).collect();
        let mean = excess.iter().sum::<f64>() / fitted as f64;
        let variance =
            excess.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / (fitted - 1) as f64;
        let ratio = if variance > 0.0 { mean * mean / variance } else { 1.0 };
        let shape = (0.5 * (1.0 - ratio)).clamp(SHAPE.0, SHAPE.1);
        // The upper end of what so few excesses say of their mean, 80 % one-sided: 95 % would cost more
        // walkers than it saves alarms (example `evaluate`, half an hour of calibration).
        let mean = mean * (1.0 + 0.842 / (fitted as f64).sqrt());
        (base, mean * (1.0 - shape), shape, fitted as f64)
    } else {
        // Too few to fit: exponential, as wide as a tenth of the highest or their own spread.
        let lowest = peaks[peaks.len() - 1];
        let mean = peaks.iter().map(|peak| peak - lowest).sum::<f64>() / peaks.len() as f64;
        (highest, mean.max(0.1 * highest), 0.0, 1.0)
    };
    let ratio = (above / allowed).max(1.0);
    let reach = if shape.abs() < 1e-6 { ratio.ln() } else { (ratio.powf(shape) - 1.0) / shape };
    (base + scale * reach).max(1.05 * highest)
}

/// Upper bound, with 95 % confidence, of a Poisson mean of which `count` were seen.
pub(crate) fn garwood_upper(count: u64) -> f64 {
    let (mut low, mut high) = (count as f64, 2.0 * count as f64 + 10.0);
    for _ in 0..100 {
        let middle = 0.5 * (low + high);
        if poisson_at_most(count, middle) > 0.05 {
            low = middle;
        } else {
            high = middle;
        }
    }
    high
}

fn poisson_at_most(count: u64, mean: f64) -> f64 {
    let (mut log_term, mut sum) = (-mean, (-mean).exp());
    for k in 1..=count {
        log_term += mean.ln() - (k as f64).ln();
        sum += log_term.exp();
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn garwood_is_the_rule_of_three_and_the_published_table() {
        // One-sided 95 % bounds of a Poisson mean: 2.996, 4.744, 6.296, 16.96 for 0, 1, 2, 10.
        for (count, bound) in [(0, 2.9957), (1, 4.7439), (2, 6.2958), (10, 16.9622)] {
            assert!((garwood_upper(count) - bound).abs() < 1e-3, "{count}");
        }
    }

    #[test]
    fn three_weeks_without_an_alarm_prove_one_a_week_and_two_do_not() {
        let peaks = [5.0, 4.0, 3.0];
        let proven = level(&peaks, 3.0 * WEEK_S, 1.0, 1.0);
        assert!(!proven.extrapolated);
        assert!(proven.on > 5.0 && proven.on < 5.001, "{proven:?}");
        let not = level(&peaks, 2.0 * WEEK_S, 1.0, 1.0);
        assert!(not.extrapolated);
        assert!(not.on > proven.on, "{not:?}");
    }

    #[test]
    fn a_larger_budget_never_gives_a_higher_level() {
        let peaks: Vec<f64> = (0..200).map(|i| 20.0 - 0.09 * f64::from(i)).collect();
        let mut last = f64::INFINITY;
        for budget in [0.1, 1.0, 3.0, 30.0, 300.0, 3000.0, 10_000.0] {
            let on = level(&peaks, 6.0 * 3600.0, budget, 1.0).on;
            assert!(on <= last, "{budget}: {on} after {last}");
            last = on;
        }
    }

    #[test]
    fn peaks_within_a_minute_are_one() {
        let mut peaks = Peaks::new(3600.0);
        for (at, height) in [(10.0, 3.0), (50.0, 5.0), (61.0, 4.0), (130.0, 2.0), (400.0, 0.0)] {
            peaks.observe(at, height);
        }
        assert_eq!(peaks.declustered(), [5.0, 2.0]);
    }

    #[test]
    fn a_quiet_area_gets_the_floor() {
        assert_eq!(level(&[], 3600.0, 3.0, 9.0), Level { on: 9.0, extrapolated: true });
    }
}
