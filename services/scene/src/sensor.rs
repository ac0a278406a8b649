//! From true ranges to readings: noise, bias, quantum, fault codes, lost echoes, mixed pixels.

use crate::file::{LaserSpec, Sensor};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

/// A jump between neighbouring beams of more than this is an edge, metres.
const EDGE_M: f64 = 0.15;
/// Width of the spot at the window, metres, and how it grows, metres a metre (SICK LMS 200).
const SPOT_M: f64 = 0.012;
const SPOT_RAD: f64 = 0.0044;

/// Readings of one scan. Every beam takes the same number of draws, whatever it meets.
pub(crate) fn measure(
    sensor: &Sensor,
    laser: &LaserSpec,
    bias_m: f64,
    rng: &mut ChaCha8Rng,
    true_m: &[f64],
    out_m: &mut Vec<f32>,
) {
    out_m.clear();
    let codes = sensor.fault_share > 0.0 || sensor.dropout_share > 0.0;
    for (beam, &range_m) in true_m.iter().enumerate() {
        let mut range_m = range_m;
        if sensor.mixed_pixels {
            let (straddles, between): (f64, f64) = (rng.random(), rng.random());
            if let Some(&next_m) = true_m.get(beam + 1) {
                range_m = mixed(laser, range_m, next_m, straddles, between);
            }
        }
        let deviate: f64 = StandardNormal.sample(rng);
        let code: f64 = if codes { rng.random() } else { 1.0 };
        out_m.push(if code < sensor.fault_share {
            f32::NAN
        } else if code < sensor.fault_share + sensor.dropout_share {
            f32::INFINITY
        } else {
            reading(sensor, laser, range_m + bias_m + sensor.sigma_m * deviate)
        });
    }
}

/// A spot on an edge returns the foreground, or a range between it and what is behind.
fn mixed(laser: &LaserSpec, range_m: f64, next_m: f64, straddles: f64, between: f64) -> f64 {
    let near = range_m.min(next_m);
    if !near.is_finite() || (range_m - next_m).abs() < EDGE_M || near <= 0.0 {
        return range_m;
    }
    let spot_rad = SPOT_M / near + SPOT_RAD;
    if straddles * laser.angle_increment_deg.to_radians().abs() > spot_rad {
        return range_m;
    }
    let far = range_m.max(next_m);
    if between < 0.5 || !far.is_finite() { near } else { near + (far - near) * (between - 0.5) }
}

pub(crate) fn reading(sensor: &Sensor, laser: &LaserSpec, range_m: f64) -> f32 {
    let range_m = range_m.max(0.0);
    let range_m = if sensor.quantum_m > 0.0 {
        (range_m / sensor.quantum_m).round() * sensor.quantum_m
    } else {
        range_m
    };
    if range_m >= laser.range_max_m { f32::INFINITY } else { range_m as f32 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::seed::{Purpose, stream};

    fn readings(sensor: &Sensor, true_m: &[f64]) -> Vec<f32> {
        let laser = LaserSpec::lms200("l", 0.0, 0.0, 0.0);
        let mut out_m = Vec::new();
        measure(sensor, &laser, 0.0, &mut stream(Purpose::Noise, &[1]), true_m, &mut out_m);
        out_m
    }

    #[test]
    fn noise_has_the_mean_and_the_spread_that_the_file_says() {
        let sensor = Sensor { sigma_m: 0.02, fault_share: 0.0, ..Sensor::default() };
        let all = readings(&sensor, &vec![4.0; 20_000]);
        let mean = all.iter().map(|&r| f64::from(r)).sum::<f64>() / all.len() as f64;
        let spread = all.iter().map(|&r| (f64::from(r) - mean).powi(2)).sum::<f64>();
        assert!((mean - 4.0).abs() < 0.001, "{mean}");
        assert!(((spread / all.len() as f64).sqrt() - 0.02).abs() < 0.0005);
    }

    #[test]
    fn codes_come_at_their_shares_and_beyond_the_limit_is_no_return() {
        let sensor = Sensor { fault_share: 0.0105, dropout_share: 0.05, ..Sensor::default() };
        let all = readings(&sensor, &vec![4.0; 40_000]);
        let share = |test: fn(&f32) -> bool| {
            all.iter().filter(|&reading| test(reading)).count() as f64 / all.len() as f64
        };
        assert!((share(|r| r.is_nan()) - 0.0105).abs() < 0.002);
        assert!((share(|r| r.is_infinite()) - 0.05).abs() < 0.005);
        let clean = Sensor { fault_share: 0.0, sigma_m: 0.0, quantum_m: 0.001, ..sensor };
        let clean = Sensor { dropout_share: 0.0, ..clean };
        let read = readings(&clean, &[7.9994, 7.9996, 8.0, f64::INFINITY, 1.23456]);
        assert_eq!(read, [7.999, f32::INFINITY, f32::INFINITY, f32::INFINITY, 1.235]);
    }

    #[test]
    fn a_mixed_pixel_lies_between_foreground_and_background() {
        let sensor = Sensor { mixed_pixels: true, sigma_m: 0.0, ..Sensor::default() };
        let sensor = Sensor { fault_share: 0.0, ..sensor };
        let edges: Vec<f64> = (0..4000).map(|i| if i % 2 == 0 { 2.0 } else { 5.0 }).collect();
        let read = readings(&sensor, &edges);
        let between = read.iter().filter(|&&r| r > 2.01 && r < 4.99).count();
        assert!(read.iter().all(|&r| (2.0..=5.0).contains(&r)));
        assert!((100..2000).contains(&between), "{between}");
    }
}
