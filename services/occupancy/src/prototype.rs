//! Eq. 8: the class of a cell, and for how long it cannot change.
//!
//! Paper: the nearest prototype. Here: squared Euclidean distance in f64, ties to the lower id;
//! `unknown` first; `transit` instead of class 0 while there is a hit in the shortest window.
//!
//! How long: the difference of two squared distances is linear in the occupancies o,
//! `g(q) = |o-q|^2 - |o-c|^2 = sum 2 o (c-q) + const`, and one frame moves o_k by 1/N_k at most, so
//! class c is safe from q for `g(q) / rate` frames. While the evidence stays a hit, o can only rise
//! (only fall, with a miss), and the rate is smaller or nothing at all. The horizons are never too
//! long: distances are compared with a margin far above all rounding, and the class itself is
//! always computed by the literal formula.

use crate::calendar::SLOTS;
use crate::config::GridConfig;
use protocol::grid::{CLASS_UNKNOWN, CLASSES_MAX};

/// Two distances in [0, 8] of eight terms each are exact to 1e-14; this is what we take off.
const DISTANCE_MARGIN: f64 = 1e-9;
/// A horizon that no change of the window contents can reach.
pub(crate) const NEVER: u32 = u32::MAX;

/// Class, and the number of frames from now at which the class may be another one, at the earliest.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Verdict {
    pub(crate) class: u8,
    /// If the evidence of the cell stays what it is; [`NEVER`] or below [`SLOTS`].
    pub(crate) frames_if_steady: u32,
    /// Whatever happens, but for a first hit in a cell of class 0 with `transit` on; below [`SLOTS`].
    pub(crate) frames_in_any_case: u32,
}

/// What the windows of a cell hold.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Contents<const K: usize> {
    /// S_k.
    pub(crate) sums: [i32; K],
    /// K.
    pub(crate) known: u32,
    /// Evidence code of the newest frame.
    pub(crate) evidence: u32,
    /// Frames since the last hit: 0 if the newest frame is one.
    pub(crate) hit_age: u32,
}

/// Prototypes and windows, with the rates at which a class can lose to another.
#[derive(Debug, Clone)]
pub(crate) struct Classifier<const K: usize> {
    frames: [u32; K],
    frames_f64: [f64; K],
    shortest: u32,
    prototypes: Vec<[f64; K]>,
    transit: Option<u8>,
    known_min: u32,
    /// Per class: frames per unit of lead, for each rival; by evidence code, then in any case (3).
    frames_per_lead: Vec<[[f64; CLASSES_MAX]; 4]>,
}

impl<const K: usize> Classifier<K> {
    /// `config` is checked and has K timescales.
    pub(crate) fn new(config: &GridConfig) -> Self {
        let mut frames = [1; K];
        frames.copy_from_slice(&config.windows);
        let prototypes: Vec<[f64; K]> = config
            .prototypes
            .iter()
            .map(|values| {
                let mut prototype = [0.0; K];
                prototype.copy_from_slice(values);
                prototype
            })
            .collect();
        let frames_f64 = frames.map(f64::from);
        let frames_per_lead =
            prototypes.iter().map(|class| rates(class, &prototypes, &frames_f64)).collect();
        Self {
            frames,
            frames_f64,
            shortest: config.shortest_frames(),
            prototypes,
            transit: config.transit.then_some(config.prototypes.len() as u8),
            known_min: known_min(config),
            frames_per_lead,
        }
    }

    pub(crate) fn has_transit(&self) -> bool {
        self.transit.is_some()
    }

    /// o_k of S_k: the literal formula.
    #[inline]
    pub(crate) fn occupancy(&self, k: usize, sum: i32) -> f64 {
        (f64::from(sum) / self.frames_f64[k] + 1.0) / 2.0
    }

    /// Class and horizons of a cell.
    pub(crate) fn judge(&self, cell: &Contents<K>) -> Verdict {
        let known = cell.evidence != crate::flip::UNKNOWN;
        if cell.known < self.known_min {
            // K rises by one a frame at most, and not while the cell is not seen.
            let any = (self.known_min - cell.known).min(SLOTS - 1);
            let steady = if known { any } else { NEVER };
            return Verdict {
                class: CLASS_UNKNOWN,
                frames_if_steady: steady,
                frames_in_any_case: any,
            };
        }
        let (base, mut steady, mut any) = self.nearest(cell);
        if self.known_min > 0 {
            let until_unknown = cell.known - self.known_min + 1;
            any = any.min(until_unknown);
            steady = if known { steady } else { steady.min(until_unknown) };
        }
        let mut class = base as u8;
        if let (0, Some(transit)) = (base, self.transit)
            && cell.hit_age < self.shortest
        {
            class = transit;
            let until_no_hit = self.shortest - cell.hit_age;
            any = any.min(until_no_hit);
            steady = if cell.hit_age == 0 { steady } else { steady.min(until_no_hit) };
        }
        let steady = if steady == NEVER { NEVER } else { steady.min(SLOTS - 1) };
        Verdict { class, frames_if_steady: steady, frames_in_any_case: any.min(SLOTS - 1) }
    }

    /// The nearest prototype, and its horizons (steady, any).
    #[inline]
    fn nearest(&self, cell: &Contents<K>) -> (usize, u32, u32) {
        let mut occupancy = [0.0; K];
        for (k, o) in occupancy.iter_mut().enumerate() {
            *o = self.occupancy(k, cell.sums[k]);
        }
        let mut distances = [f64::INFINITY; CLASSES_MAX];
        let (mut class, mut least) = (0, f64::INFINITY);
        for (id, prototype) in self.prototypes.iter().enumerate() {
            let mut distance = 0.0;
            for (o, p) in occupancy.iter().zip(prototype) {
                distance += (o - p) * (o - p);
            }
            distances[id] = distance;
            if distance < least {
                (class, least) = (id, distance);
            }
        }
        let [steady_rates, any_rates] = {
            let rates = &self.frames_per_lead[class];
            [&rates[(cell.evidence & 3) as usize % 3], &rates[3]]
        };
        let (mut steady, mut any) = (f64::INFINITY, f64::INFINITY);
        for rival in 0..self.prototypes.len() {
            // A prototype equal to the class never wins: its rate is infinite, its lead is made so.
            if any_rates[rival] < f64::INFINITY {
                let lead = (distances[rival] - least - DISTANCE_MARGIN).max(0.0);
                any = any.min(lead * any_rates[rival]);
                // 0 * inf: a near tie with a rival that cannot gain. Rounding may still move it.
                steady = steady.min(if lead > 0.0 { lead * steady_rates[rival] } else { 0.0 });
            }
        }
        // After n frames of drift the lead is not gone yet, so n is safe to look at, and so is 1.
        let frames = |n: f64| if n == f64::INFINITY { NEVER } else { (n as u32).max(1) };
        let steady = if self.is_saturated(cell) { NEVER } else { frames(steady) };
        (class, steady, frames(any))
    }

    /// Whether all windows are full of the evidence of now: nothing moves while it stays.
    #[inline]
    fn is_saturated(&self, cell: &Contents<K>) -> bool {
        let value = crate::flip::value(cell.evidence);
        if value == 0 {
            return cell.known == 0;
        }
        cell.sums.iter().zip(&self.frames).all(|(&sum, &frames)| sum == value * frames as i32)
    }
}

/// 1 / (greatest loss of lead in a frame), see `Classifier::frames_per_lead`.
fn rates<const K: usize>(
    class: &[f64; K],
    prototypes: &[[f64; K]],
    frames: &[f64; K],
) -> [[f64; CLASSES_MAX]; 4] {
    let mut table = [[f64::INFINITY; CLASSES_MAX]; 4];
    for (rival, other) in prototypes.iter().enumerate() {
        // The lead falls by 2 (q - c) for each unit that o rises.
        let (mut unknown, mut miss, mut hit, mut any) = (0.0, 0.0, 0.0, 0.0);
        for k in 0..K {
            let slope = 2.0 * (other[k] - class[k]) / frames[k];
            // S_k moves by v - (what leaves): for unknown -1..1, miss -2..0, hit 0..2, else -2..2;
            // o_k by half of that over N_k.
            unknown += slope.abs() / 2.0;
            miss += (-slope).max(0.0);
            hit += slope.max(0.0);
            any += slope.abs();
        }
        for (row, rate) in table.iter_mut().zip([unknown, miss, hit, any]) {
            row[rival] = 1.0 / rate; // +inf for a rate of +0
        }
    }
    table
}

/// The least K that is not unknown: the literal comparison, which is monotone in K.
fn known_min(config: &GridConfig) -> u32 {
    let limit = config.known_share_min * f64::from(config.longest_frames());
    let near = limit as u32;
    (near.saturating_sub(1)..=near.saturating_add(1))
        .find(|&known| f64::from(known) >= limit)
        .unwrap_or(near)
}
