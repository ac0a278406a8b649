//! Verdicts as text for people: one run, and many.

use super::run::{Outcome, PRESETS};
use experiment::claims::{Claim, Limit, Measure, Verdict};
use protocol::site::Preset;
use std::fmt::Write as _;

/// The verdicts of one run on each preset, [preset][verdict], as a table.
pub fn of_run(outcome: &Outcome, verdicts: &[Vec<Verdict>]) -> String {
    let which = outcome.which;
    let mut text = format!(
        "experiment {}: {}\nseed {}, {:.2} Hz, {} scans, {} frames of {} ms\n\n  {:<44}{:>8}",
        which.experiment.number(),
        which.experiment.about(),
        which.seed,
        which.rate.hz(),
        outcome.scans,
        outcome.frames,
        which.rate.period_ns() as f64 / 1e6,
        "number",
        "limit",
    );
    for preset in PRESETS {
        let _ = write!(text, "{:>10}", preset.name()); // writing to a String cannot fail
    }
    text.push('\n');
    let Some(first) = verdicts.first() else { return text };
    for (i, verdict) in first.iter().enumerate() {
        let _ = writeln!(text, "\n`{}`: {}", verdict.claim.id(), verdict.claim.words());
        for (j, measure) in verdict.measures.iter().enumerate() {
            let limit = measure.limit.to_string();
            let _ = write!(text, "  {:<44}{limit:>8}", measure.name);
            for of_preset in verdicts {
                let measure = &of_preset[i].measures[j];
                let wrong = if measure.holds() { ' ' } else { '!' };
                let _ = write!(text, "{:>9}{wrong}", number(measure));
            }
            text.push('\n');
        }
        let _ = write!(text, "  {:<52}", "holds");
        for of_preset in verdicts {
            let _ = write!(text, "{:>9} ", if of_preset[i].holds { "yes" } else { "NO" });
        }
        text.push('\n');
    }
    text.lines().flat_map(|line| [line.trim_end(), "\n"]).collect()
}

/// A number with as many digits as it deserves; a share in percent.
fn number(measure: &Measure) -> String {
    let Measure { value, limit, .. } = measure;
    let (Limit::AtLeast(bound) | Limit::AtMost(bound)) = *limit;
    let fine = if bound < 1.0 { 4 } else { 1 };
    if *value >= 100.0 { format!("{value:.0}") } else { format!("{value:.fine$}") }
}

/// How often a claim held, and what its first number was.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tally {
    /// Seeds for which it held.
    pub held: usize,
    /// Seeds.
    pub of: usize,
    /// Median of the first number.
    pub median: f64,
}

impl Tally {
    /// Counts verdicts on one claim.
    pub fn of<'a>(verdicts: impl Iterator<Item = &'a Verdict>) -> Self {
        let verdicts: Vec<&Verdict> = verdicts.collect();
        let mut values: Vec<f64> =
            verdicts.iter().map(|verdict| verdict.measures[0].value).collect();
        values.sort_by(f64::total_cmp);
        let middle = |at: usize| values.get(at).copied().unwrap_or(f64::NAN);
        let median = (middle(values.len() / 2) + middle(values.len().saturating_sub(1) / 2)) / 2.0;
        let held = verdicts.iter().filter(|verdict| verdict.holds).count();
        Self { held, of: verdicts.len(), median }
    }

    /// At least nine of ten.
    pub fn is_enough(&self) -> bool {
        self.held * 10 >= self.of * 9
    }
}

/// The table of many runs in Markdown: a row a claim, a column a preset and rate.
pub fn of_many(rates_hz: &[f64], tally: impl Fn(Claim, Preset, usize) -> Tally) -> String {
    let mut text = String::from("| the paper says | exp. | number (median) |");
    for preset in PRESETS {
        for rate_hz in rates_hz {
            let _ = write!(text, " {}, {rate_hz:.1} Hz |", preset.name());
        }
    }
    text.push_str("\n|---|---|---|");
    (0..PRESETS.len() * rates_hz.len()).for_each(|_| text.push_str("---|"));
    text.push('\n');
    for claim in Claim::ALL {
        let (words, experiment) = (claim.words(), claim.experiment());
        let _ = write!(text, "| `{}`: {words} | {experiment} | {} |", claim.id(), claim.number());
        for preset in PRESETS {
            for rate in 0..rates_hz.len() {
                let Tally { held, of, median } = tally(claim, preset, rate);
                let digits = if median.abs() >= 100.0 { 0 } else { 3 };
                let _ = write!(text, " {held}/{of} ({median:.digits$}) |");
            }
        }
        text.push('\n');
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nine_of_ten_are_enough_and_the_median_is_in_the_middle() {
        let verdict = |value: f64| Verdict {
            claim: Claim::Walls,
            holds: value > 0.0,
            measures: vec![Measure { name: "x", value, limit: Limit::AtLeast(0.0) }],
        };
        let tally = |values: &[f64]| {
            let verdicts: Vec<Verdict> = values.iter().map(|&value| verdict(value)).collect();
            Tally::of(verdicts.iter())
        };
        let mut values = vec![5.0; 9];
        values.push(-1.0);
        let nine = tally(&values);
        assert_eq!((nine.held, nine.of, nine.median), (9, 10, 5.0));
        assert!(nine.is_enough());
        values[0] = -1.0;
        assert!(!tally(&values).is_enough());
        assert_eq!(tally(&[3.0, 1.0, 2.0, 9.0]).median, 2.5);
        assert_eq!(tally(&[3.0, 1.0, 9.0]).median, 3.0);
    }
}
