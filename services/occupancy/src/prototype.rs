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
    /// [timescale][class], in lanes that are computed together; [`FAR`] behind the last class.
    prototypes: [[f64; CLASSES_MAX]; K],
    classes: usize,
    transit: Option<u8>,
    known_min: u32,
    leads: Vec<Leads>,
}

/// How the lead of a class over each rival can be lost.
#[derive(Debug, Clone)]
struct Leads {
    /// Added to the lead: infinite for rivals that never win, since they equal the class, or are none.
    head_start: [f64; CLASSES_MAX],
    /// Frames per unit of lead: by evidence code while that stays, then in any case (3). Not for
    /// unknown: see `Classifier::steady_unseen`.
    frames: [[f64; CLASSES_MAX]; 4],
}

/// Occupancy that is nearer to every class than to a lane without one.
const FAR: f64 = 1e9;
/// Frames per unit of lead against a rival that cannot gain: beyond every horizon, but finite, so that
/// no lead times this is none (0 * inf would be NaN). Rounding may still move a near tie.
const NO_GAIN: f64 = 1e300;
/// Lanes for up to so many classes: all presets.
const FEW_CLASSES: usize = 8;

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
        let leads = prototypes.iter().map(|class| Leads::new(class, &prototypes, &frames_f64));
        let leads = leads.collect();
        let mut lanes = [[FAR; CLASSES_MAX]; K];
        for (id, prototype) in prototypes.iter().enumerate() {
            for (row, &value) in lanes.iter_mut().zip(prototype) {
                row[id] = value;
            }
        }
        Self {
            frames,
            frames_f64,
            shortest: config.shortest_frames(),
            prototypes: lanes,
            classes: prototypes.len(),
            transit: config.transit.then_some(config.prototypes.len() as u8),
            known_min: known_min(config),
            leads,
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
        let (base, mut steady, mut any) = if self.classes <= FEW_CLASSES {
            self.nearest::<FEW_CLASSES>(cell)
        } else {
            self.nearest::<CLASSES_MAX>(cell)
        };
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

    /// The nearest prototype, and its horizons (steady, any), in lanes without a branch.
    #[inline]
    fn nearest<const LANES: usize>(&self, cell: &Contents<K>) -> (usize, u32, u32) {
        let mut distances = [0.0; LANES];
        for (k, prototypes) in self.prototypes.iter().enumerate() {
            let o = self.occupancy(k, cell.sums[k]);
            for (distance, p) in distances.iter_mut().zip(prototypes) {
                *distance += (o - p) * (o - p);
            }
        }
        let (mut class, mut least) = (0, f64::INFINITY);
        for (id, &distance) in distances.iter().enumerate() {
            let nearer = distance < least;
            class = if nearer { id } else { class };
            least = if nearer { distance } else { least };
        }
        let leads = &self.leads[class];
        let [steady_rates, any_rates] =
            [&leads.frames[(cell.evidence & 3) as usize % 3], &leads.frames[3]];
        let (mut steadies, mut anys) = ([0.0; LANES], [0.0; LANES]);
        for lane in 0..LANES {
            let ahead = distances[lane] - least - DISTANCE_MARGIN;
            let ahead = if ahead > 0.0 { ahead } else { 0.0 };
            let lead = ahead + leads.head_start[lane];
            steadies[lane] = lead * steady_rates[lane];
            anys[lane] = lead * any_rates[lane];
        }
        let lower = |a: f64, b: f64| if a < b { a } else { b };
        let steady = if cell.evidence == crate::flip::UNKNOWN {
            self.steady_unseen(cell, class, &distances, least)
        } else {
            steadies.into_iter().fold(f64::INFINITY, lower)
        };
        let any = anys.into_iter().fold(f64::INFINITY, lower);
        // After n frames of drift the lead is not gone yet, so n is safe to look at, and so is 1.
        let frames = |n: f64| if n == f64::INFINITY { NEVER } else { (n as u32).max(1) };
        let steady = if self.is_saturated(cell) { NEVER } else { frames(steady) };
        (class, steady, frames(any))
    }

    /// Frames that a class is safe while its cell is not seen.
    ///
    /// After a gap or the loss of a laser that are most cells, and their classes would be looked at in
    /// almost every frame if only the rates counted: unseen, every window drifts towards 1/2, where
    /// prototypes tie. So: a window with nothing known in it does not drift any more, one without a
    /// hit only rises, and a tie of equal terms stays one.
    fn steady_unseen(
        &self,
        cell: &Contents<K>,
        class: usize,
        distances: &[f64],
        least: f64,
    ) -> f64 {
        let mut steady = f64::INFINITY;
        for (rival, distance) in distances.iter().enumerate().take(self.classes) {
            let (mut loss, mut is_level) = (0.0, true);
            for k in 0..K {
                let (c, q) = (self.prototypes[k][class], self.prototypes[k][rival]);
                let slope = 2.0 * (q - c) / self.frames_f64[k];
                if slope == 0.0 {
                    continue;
                }
                let without_hit = cell.hit_age >= self.frames[k];
                if without_hit && cell.sums[k] == 0 {
                    let o = self.occupancy(k, 0);
                    is_level &= (o - c) * (o - c) == (o - q) * (o - q);
                } else {
                    // o_k moves by 1 / 2 N_k a frame.
                    loss += if without_hit { slope.max(0.0) } else { slope.abs() } / 2.0;
                    is_level = false;
                }
            }
            let lead = (distance - least - DISTANCE_MARGIN).max(0.0);
            if !is_level {
                let frames = if lead > 0.0 { lead / loss } else { 0.0 }; // +inf for a loss of 0
                steady = steady.min(frames);
            }
        }
        steady
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

impl Leads {
    /// 1 / (greatest loss of lead in a frame) against each of the prototypes.
    fn new<const K: usize>(class: &[f64; K], prototypes: &[[f64; K]], frames: &[f64; K]) -> Self {
        let mut leads =
            Self { head_start: [f64::INFINITY; CLASSES_MAX], frames: [[1.0; CLASSES_MAX]; 4] };
        for (rival, other) in prototypes.iter().enumerate() {
            // The lead falls by 2 (q - c) for each unit that o rises.
            let (mut unknown, mut miss, mut hit, mut any) = (0.0, 0.0, 0.0, 0.0);
            for k in 0..K {
                let slope = 2.0 * (other[k] - class[k]) / frames[k];
                // S_k moves by v - (what leaves): for unknown -1..1, miss -2..0, hit 0..2, else
                // -2..2; o_k by half of that over N_k.
                unknown += slope.abs() / 2.0;
                miss += (-slope).max(0.0);
                hit += slope.max(0.0);
                any += slope.abs();
            }
            if any > 0.0 {
                leads.head_start[rival] = 0.0;
                for (row, loss) in leads.frames.iter_mut().zip([unknown, miss, hit, any]) {
                    row[rival] = if loss > 0.0 { 1.0 / loss } else { NO_GAIN };
                }
            }
        }
        leads
    }
}

/// The least K that is not unknown: the literal comparison, which is monotone in K.
fn known_min(config: &GridConfig) -> u32 {
    let limit = config.known_share_min * f64::from(config.longest_frames());
    let near = limit as u32;
    (near.saturating_sub(1)..=near.saturating_add(1))
        .find(|&known| f64::from(known) >= limit)
        .unwrap_or(near)
}
