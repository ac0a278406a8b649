//! `tog experiment verdict`: all experiments over many seeds at both rates, on all cores.

use super::run::{ExperimentError, NoSink, Outcome, PRESETS, Which, run};
use super::table::{self, Tally};
use super::{judge, progress_bar};
use experiment::claims::{Claim, Verdict};
use experiment::{Experiment, Rate};
use protocol::site::Preset;
use serde_json::{Value, json};
use std::num::NonZero;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

/// The rates of the device, the slow one first.
pub const RATES: [Rate; 2] = [Rate::SERIAL_38400, Rate::SERIAL_500K];

/// The verdicts of all experiments for one seed at one rate.
struct Judged {
    seed: u64,
    rate: Rate,
    /// [preset][verdict]: experiments 1, 2, 3 in turn.
    verdicts: Vec<Vec<Verdict>>,
}

/// All verdicts.
pub struct Many {
    seeds: u64,
    judged: Vec<Judged>,
}

/// Runs everything for seeds 1 to `seeds`.
///
/// # Errors
/// The first error of any run.
pub fn run_all(seeds: u64) -> Result<Many, ExperimentError> {
    // The long ones first, so that no core waits for another at the end.
    let jobs: Vec<(u64, Rate)> =
        RATES.iter().rev().flat_map(|&rate| (1..=seeds).map(move |seed| (seed, rate))).collect();
    let bar = progress_bar("runs", jobs.len() as u64 * 3, "runs");
    let (next, done) = (AtomicUsize::new(0), Mutex::new(Vec::new()));
    let work = || {
        while let Some(&(seed, rate)) = jobs.get(next.fetch_add(1, Ordering::Relaxed)) {
            let judged = one(seed, rate, || bar.inc(1));
            let failed = judged.is_err();
            done.lock().unwrap_or_else(std::sync::PoisonError::into_inner).push(judged);
            if failed {
                next.store(jobs.len(), Ordering::Relaxed);
            }
        }
    };
    let threads = std::thread::available_parallelism().map_or(1, NonZero::get).min(jobs.len());
    std::thread::scope(|scope| (0..threads).for_each(|_| drop(scope.spawn(work))));
    bar.finish_and_clear();
    let done = done.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner);
    let mut judged = done.into_iter().collect::<Result<Vec<Judged>, _>>()?;
    judged.sort_by_key(|judged| (judged.rate, judged.seed));
    Ok(Many { seeds, judged })
}

fn one(seed: u64, rate: Rate, step: impl Fn()) -> Result<Judged, ExperimentError> {
    let mut verdicts: Vec<Vec<Verdict>> = vec![Vec::new(); PRESETS.len()];
    let mut empty_room: Option<Outcome> = None;
    for experiment in Experiment::ALL {
        let outcome = run(Which { experiment, seed, rate }, experiment.seconds(), &mut NoSink)?;
        let judged = judge(&outcome, empty_room.as_ref());
        verdicts.iter_mut().zip(judged).for_each(|(all, of_run)| all.extend(of_run));
        if experiment == Experiment::Static {
            empty_room = Some(outcome);
        }
        step();
    }
    Ok(Judged { seed, rate, verdicts })
}

impl Many {
    fn tally(&self, claim: Claim, preset: Preset, rate: Rate) -> Tally {
        let at = PRESETS.iter().position(|candidate| *candidate == preset).unwrap_or(0);
        let of_rate = self.judged.iter().filter(|judged| judged.rate == rate);
        Tally::of(
            of_rate.flat_map(|judged| {
                judged.verdicts[at].iter().filter(|verdict| verdict.claim == claim)
            }),
        )
    }

    /// Each claim that does not hold with the default preset for nine seeds of ten at a rate, with
    /// the seeds for which it fails.
    pub fn failing(&self) -> Vec<String> {
        let mut failing = Vec::new();
        for claim in Claim::ALL {
            for rate in RATES {
                let Tally { held, of, .. } = self.tally(claim, Preset::Default, rate);
                if self.tally(claim, Preset::Default, rate).is_enough() {
                    continue;
                }
                let seeds = self.seeds_against(claim, rate).join(", ");
                failing.push(format!(
                    "claim `{}` (experiment {}, preset default, {:.1} Hz) holds for {held} of {of} seeds, \
                     not for seed {seeds}",
                    claim.id(),
                    claim.experiment(),
                    rate.hz(),
                ));
            }
        }
        failing
    }

    /// Seeds for which a claim does not hold with the default preset.
    fn seeds_against(&self, claim: Claim, rate: Rate) -> Vec<String> {
        let against = |judged: &&Judged| {
            let verdicts = judged.verdicts.first().into_iter().flatten(); // PRESETS begins with it
            judged.rate == rate
                && verdicts.filter(|verdict| verdict.claim == claim).any(|verdict| !verdict.holds)
        };
        self.judged.iter().filter(against).map(|judged| judged.seed.to_string()).collect()
    }

    /// The table in Markdown.
    pub fn table(&self) -> String {
        let rates_hz = RATES.map(Rate::hz);
        table::of_many(&rates_hz, |claim, preset, rate| self.tally(claim, preset, RATES[rate]))
    }

    /// Everything, for programs.
    pub fn json(&self) -> Value {
        let mut runs = Vec::new();
        for judged in &self.judged {
            for (preset, verdicts) in PRESETS.iter().zip(&judged.verdicts) {
                runs.push(json!({
                    "seed": judged.seed,
                    "rate_hz": judged.rate.hz(),
                    "preset": preset.name(),
                    "verdicts": verdicts,
                }));
            }
        }
        json!({ "seeds": self.seeds, "holds": self.failing().is_empty(), "runs": runs })
    }
}
