//! The SICK LMS 200 as it really measures: from what its spot meets to a reading.
//!
//! Sources: SICK 8007954/Q501 (codes), 8008970 (spot), shares of codes counted in recordings of a
//! real device. What [`Sensor`] says (noise, bias, quantum, share of codes) holds here too.
//!
//! - **Spot.** It is 12 mm wide at the window and grows by 4.4 mrad: three rays a beam, at its
//!   middle and 3.5 mrad to each side (half the spot at 4.6 m, the middle of the range).
//! - **Mixed pixels.** A spot that meets two surfaces less than a pulse apart reads between them,
//!   by the light that falls on each; further apart, the first echo wins if it is strong enough.
//!   So a spot on an edge errs in the same way in every scan, as on a real device: a phantom that
//!   stands still.
//! - **Codes** (3FFF no stop pulse, 3FFB too weak, 3FFD overflow: 0.73, 0.31 and 0.013 % of the
//!   beams) say nothing, whatever is there. Only "beyond the range" (3FF7) is no return.
//! - **Dazzle** (3FFE): now and then a few neighbouring beams are blind for a second.
//! - **Dust**: one beam in 10 000 meets something in the air.
//!
//! **Here:** the pulse length, the strength of a first echo, and how often dazzle comes are not in
//! these sources; they are set below. Left out: dark, glossy and glass surfaces, the turn of the
//! mirror during a scan (13 ms: a walker moves 2 cm), lost scans.

use crate::file::{LaserSpec, Sensor};
use crate::seed::{Purpose, stream};
use crate::sensor::reading;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use std::ops::Range;

/// The rays of a beam, from its bearing, degrees: 3.5 mrad to the right, the middle, to the left.
pub(crate) const RAYS_DEG: [f64; 3] = [-0.2, 0.0, 0.2];
/// Light that falls on each third of the spot: its middle is the brightest.
const RAY_LIGHT: [f64; 3] = [0.25, 0.5, 0.25];
/// The light on one of two surfaces varies by so much from scan to scan, each way.
const LIGHT_JITTER: f64 = 0.1;
/// Rays that bend by more than this do not lie on one surface, metres.
const EDGE_M: f64 = 0.15;
/// Two echoes nearer to each other than this are one, metres: 4 ns of a pulse, there and back.
const PULSE_M: f64 = 0.6;
/// The least light that makes a first echo.
const FIRST_ECHO_LIGHT: f64 = 0.2;
/// Ranges beyond count as this far, metres: far above any range limit of the device.
const FAR_M: f64 = 100.0;
/// Share of the beams that meet dust.
const DUST_SHARE: f64 = 1e-4;

/// A burst of dazzle begins in one minute of five.
const DAZZLE_SLOT_S: f64 = 60.0;
const DAZZLE_SHARE: f64 = 0.2;
/// How long it takes, seconds, and how many beams it blinds.
const DAZZLE_S: Range<f64> = 0.3..1.5;
const DAZZLE_BEAMS: Range<u32> = 3..12;

/// The beams that are dazzled at a time; the same for all who ask.
pub(crate) fn dazzled(laser: &LaserSpec, seed: u64, laser_key: u64, t_s: f64) -> Range<usize> {
    let slot = (t_s / DAZZLE_SLOT_S).floor();
    let mut rng = stream(Purpose::Dazzle, &[seed, laser_key, slot as i64 as u64]);
    let happens = rng.random::<f64>() < DAZZLE_SHARE;
    let from_s = (slot + rng.random::<f64>()) * DAZZLE_SLOT_S; // its end is cut at the slot's end
    let until_s = from_s + rng.random_range(DAZZLE_S);
    let first = rng.random_range(0..laser.beams.max(1)) as usize;
    let beams = rng.random_range(DAZZLE_BEAMS) as usize;
    if happens && (from_s..until_s).contains(&t_s) { first..first + beams } else { 0..0 }
}

/// Readings of one scan. Every beam takes the same number of draws, whatever it meets.
///
/// `rays_m[i]` are the exact ranges along the i-th of [`RAYS_DEG`] of every beam.
pub(crate) fn measure(
    sensor: &Sensor,
    laser: &LaserSpec,
    bias_m: f64,
    rng: &mut ChaCha8Rng,
    dazzled: &Range<usize>,
    rays_m: &[Vec<f64>; 3],
    out_m: &mut Vec<f32>,
) {
    out_m.clear();
    let [right, middle, left] = rays_m;
    for (beam, ((&right, &middle), &left)) in right.iter().zip(middle).zip(left).enumerate() {
        let (jitter, chance): (f64, f64) = (rng.random(), rng.random());
        let deviate: f64 = StandardNormal.sample(rng);
        let met_m = spot_m([right, middle, left], (2.0 * jitter - 1.0) * LIGHT_JITTER);
        let dust = (0.0..DUST_SHARE).contains(&(chance - sensor.fault_share));
        let met_m = if dust { met_m.min(laser.range_max_m) * jitter } else { met_m };
        let measured_m = met_m + bias_m + sensor.sigma_m * deviate;
        out_m.push(if chance < sensor.fault_share || dazzled.contains(&beam) {
            f32::NAN
        } else {
            reading(sensor, laser, measured_m)
        });
    }
}

/// The range that a spot reads whose three rays meet these ranges.
fn spot_m(rays_m: [f64; 3], jitter: f64) -> f64 {
    let rays = rays_m.map(|ray| ray.min(FAR_M));
    let [right, middle, left] = rays;
    if (right + left - 2.0 * middle).abs() < EDGE_M {
        return rays_m[1]; // one surface, seen at whatever slant
    }
    let (near, far) = (right.min(middle).min(left), right.max(middle).max(left));
    let light_of = |ray: usize| if rays[ray] - near < EDGE_M { RAY_LIGHT[ray] } else { 0.0 };
    let light = (light_of(0) + light_of(1) + light_of(2) + jitter).clamp(0.0, 1.0);
    if far - near < PULSE_M {
        near * light + far * (1.0 - light)
    } else if light >= FIRST_ECHO_LIGHT {
        near
    } else {
        far
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CLEAN: Sensor = Sensor {
        sigma_m: 0.0,
        bias_m: 0.0,
        quantum_m: 0.0,
        fault_share: 0.0,
        dropout_share: 0.0,
        mixed_pixels: false,
    };

    fn readings(sensor: &Sensor, ray_m: [f64; 3], beams: u32, dazzled: Range<usize>) -> Vec<f32> {
        let laser = LaserSpec { beams, ..LaserSpec::lms200("l", 0.0, 0.0, 0.0) };
        let rays = ray_m.map(|range_m| vec![range_m; beams as usize]);
        let (mut out_m, mut rng) = (Vec::new(), stream(Purpose::Noise, &[1]));
        measure(sensor, &laser, 0.0, &mut rng, &dazzled, &rays, &mut out_m);
        out_m
    }

    #[test]
    fn a_wall_at_a_slant_is_no_edge() {
        assert_eq!(spot_m([5.3, 5.0, 4.7], 0.0), 5.0);
        assert_eq!(spot_m([f64::INFINITY; 3], 0.0), f64::INFINITY);
    }

    #[test]
    fn two_near_surfaces_are_mixed_by_their_light_and_of_two_far_ones_the_first_is_read() {
        assert!((spot_m([2.0, 2.4, 2.4], 0.0) - 2.3).abs() < 1e-12, "a quarter of the light");
        assert!((spot_m([2.0, 2.0, 2.4], 0.0) - 2.1).abs() < 1e-12, "three quarters of it");
        assert_eq!(spot_m([2.0, 5.0, 5.0], 0.0), 2.0, "the first echo");
        assert_eq!(spot_m([2.0, 5.0, 5.0], -0.1), 5.0, "too weak for a first echo");
        assert_eq!(spot_m([2.0, f64::INFINITY, f64::INFINITY], 0.1), 2.0);
    }

    #[test]
    fn a_spot_on_an_edge_errs_in_the_same_way_in_every_scan() {
        let read = readings(&CLEAN, [2.0, 2.4, 2.4], 4000, 0..0);
        let steady = read.iter().filter(|&&r| (2.25..=2.35).contains(&r)).count();
        assert!(steady >= 3990, "all but dust: {steady}");
    }

    #[test]
    fn codes_dust_and_dazzle_come_at_their_shares() {
        let sensor = Sensor { fault_share: 0.0105, ..CLEAN };
        let read: Vec<f32> =
            (0..50).flat_map(|_| readings(&sensor, [4.0; 3], 4000, 0..0)).collect();
        let share = |test: fn(&f32) -> bool| {
            read.iter().filter(|r| test(r)).count() as f64 / read.len() as f64
        };
        assert!((share(|r| r.is_nan()) - 0.0105).abs() < 0.002);
        let blind = readings(&CLEAN, [4.0; 3], 20, 5..9);
        let nan: Vec<usize> = (0..20).filter(|&beam| blind[beam].is_nan()).collect();
        assert_eq!(nan, [5, 6, 7, 8]);
        let dusty = readings(&CLEAN, [4.0; 3], 400_000, 0..0);
        let dust = dusty.iter().filter(|&&r| r < 3.99).count();
        assert!((15..80).contains(&dust), "{dust} of 400000");
    }

    #[test]
    fn dazzle_is_rare_short_and_the_same_for_all_who_ask() {
        let laser = LaserSpec::lms200("l", 0.0, 0.0, 0.0);
        let (mut blind, mut bursts, mut was) = (0, 0, false);
        for tick in 0..36_000 {
            let beams = dazzled(&laser, 3, 7, f64::from(tick) * 0.1);
            assert_eq!(beams, dazzled(&laser, 3, 7, f64::from(tick) * 0.1));
            let is = !beams.is_empty();
            blind += usize::from(is);
            bursts += usize::from(is && !was);
            was = is;
        }
        assert!((4..25).contains(&bursts), "{bursts} in an hour");
        assert!(blind < 15 * bursts, "{blind} tenths of a second in {bursts} bursts");
    }
}
