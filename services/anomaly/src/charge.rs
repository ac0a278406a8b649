//! Evidence in time: a leaky CUSUM a cell.
//!
//! ```text
//! dC/dt = u - C / LEAK_S,  C >= 0,   u = l - DRIFT while the cell is evidence, else -DRAIN
//! ```
//!
//! u is constant between two changes of a cell, so C has a closed form and is brought up to date
//! only when somebody looks: C(t) = u*LEAK + (C0 - u*LEAK) * exp(-t/LEAK). Charge is in nat seconds.

use crate::plane::Plane;

/// Time constant of the leak, seconds: what happens for 10 to 60 s shows.
const LEAK_S: f64 = 60.0;
/// Evidence below this does not charge, nats.
const DRIFT: f64 = crate::sense::L_MIN;
/// How fast a cell that is normal again is discharged beside the leak, nats.
const DRAIN: f64 = 2.0;

/// The charge of every cell.
#[derive(Debug, Clone)]
pub(crate) struct Charge {
    period_s: f64,
    charge: Vec<f32>,
    rate: Vec<f32>,
    at: Vec<u32>,
    active: Plane,
}

impl Charge {
    pub(crate) fn new(cells: usize, period_s: f64) -> Self {
        Self {
            period_s,
            charge: vec![0.0; cells],
            rate: vec![0.0; cells],
            at: vec![0; cells],
            active: Plane::new(cells),
        }
    }

    /// From frame `now` (modulo 2^32) on, a cell has evidence l, or none.
    pub(crate) fn set(&mut self, cell: usize, l: Option<f32>, now: u32) {
        let active = self.active.get(cell);
        if !active && l.is_none() {
            return;
        }
        if active {
            self.settle(cell, now);
        }
        self.at[cell] = now;
        self.rate[cell] = l.map_or(-DRAIN as f32, |l| l - DRIFT as f32);
        self.active.set(cell, true);
    }

    fn settle(&mut self, cell: usize, now: u32) {
        let elapsed_s = f64::from(now.wrapping_sub(self.at[cell])) * self.period_s;
        let goal = f64::from(self.rate[cell]) * LEAK_S;
        let charge = goal + (f64::from(self.charge[cell]) - goal) * (-elapsed_s / LEAK_S).exp();
        self.charge[cell] = charge.max(0.0) as f32;
        self.at[cell] = now;
    }

    /// Brings all charged cells up to date and forgets those that are empty; returns the highest
    /// charge, and marks the cells with at least `level` in `above`.
    pub(crate) fn sweep(&mut self, now: u32, level: f64, above: &mut Plane) -> f64 {
        above.clear();
        if self.active.is_empty() {
            return 0.0;
        }
        let mut highest = 0.0f64;
        let active = self.active.clone();
        active.for_each(|cell| {
            self.settle(cell, now);
            let charge = f64::from(self.charge[cell]);
            if charge <= 0.0 && self.rate[cell] <= 0.0 {
                self.active.set(cell, false);
            }
            above.set(cell, charge >= level);
            highest = highest.max(charge);
        });
        highest
    }

    pub(crate) fn charge(&self, cell: usize) -> f64 {
        f64::from(self.charge[cell])
    }

    /// Discharges all cells.
    pub(crate) fn reset(&mut self) {
        self.active.clear();
        self.charge.fill(0.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn looking_often_or_once_gives_the_same_charge() {
        let mut above = Plane::new(2);
        let mut once = Charge::new(2, 0.1);
        let mut often = Charge::new(2, 0.1);
        for charge in [&mut once, &mut often] {
            charge.set(1, Some(7.0), u32::MAX - 20);
        }
        for step in 0..200u32 {
            often.sweep((u32::MAX - 20).wrapping_add(step), 1.0, &mut above);
        }
        let now = (u32::MAX - 20).wrapping_add(200);
        let (a, b) = (once.sweep(now, 1.0, &mut above), often.sweep(now, 1.0, &mut above));
        assert!((a - b).abs() < 1e-2, "{a} {b}");
        assert!(above.get(1) && !above.get(0));
    }

    #[test]
    fn a_stay_charges_and_leaving_discharges_to_nothing() {
        let mut above = Plane::new(1);
        let mut charge = Charge::new(1, 0.1);
        charge.set(0, Some(8.0), 0);
        let after_20_s = charge.sweep(200, 1.0, &mut above);
        assert!((66.0..69.0).contains(&after_20_s), "{after_20_s}");
        charge.set(0, None, 200);
        assert_eq!(charge.sweep(200 + 1200, 1.0, &mut above), 0.0);
        assert!(charge.active.is_empty());
    }
}
