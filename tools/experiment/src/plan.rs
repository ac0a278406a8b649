//! What is run: scenes, times, rates.

use protocol::time::SECOND_NS;
use scene::{Scene, SceneError};

/// One turn of the mirror of an LMS 200, nanoseconds: 148 us for each 1/90 turn (SICK 8007954, 10.9).
pub const TURN_NS: u64 = 13_320_000;
/// Slowest rate: one scan in 75 turns.
const TURNS_MAX: u64 = 75;

/// An experiment of the paper, section 4.1.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Experiment {
    /// 1: nobody in a furnished room, four lasers.
    Static,
    /// 2: one person at random, then four round a quadrilateral, in the same room.
    Walkers,
    /// 3: a foyer, one laser.
    Foyer,
}

impl Experiment {
    /// All, in the order of the paper.
    pub const ALL: [Self; 3] = [Self::Static, Self::Walkers, Self::Foyer];

    /// Its number in the paper, 1..=3.
    #[must_use]
    pub fn number(self) -> u8 {
        match self {
            Self::Static => 1,
            Self::Walkers => 2,
            Self::Foyer => 3,
        }
    }

    /// The experiment of a number of the paper.
    #[must_use]
    pub fn of_number(number: u8) -> Option<Self> {
        Self::ALL.into_iter().find(|experiment| experiment.number() == number)
    }

    /// Name of its scene; the file is `deploy/scenes/<name>.toml`.
    #[must_use]
    pub fn scene_name(self) -> &'static str {
        match self {
            Self::Static | Self::Walkers => "paper-room",
            Self::Foyer => "paper-foyer",
        }
    }

    /// Its scene.
    ///
    /// # Errors
    /// Never with the scenes that are delivered.
    pub fn scene(self) -> Result<Scene, SceneError> {
        Scene::builtin(self.scene_name())
    }

    /// When it begins, seconds of the scene: experiment 1 is over before people come.
    #[must_use]
    pub fn begin_s(self) -> f64 {
        match self {
            Self::Static => -150.0,
            Self::Walkers => 0.0,
            Self::Foyer => 36_000.0,
        }
    }

    /// How long it takes, seconds. Paper: 45 s and three minutes; about 20 minutes. **Here:** the
    /// first takes two minutes (the paper does not say): twice the longest timescale.
    #[must_use]
    pub fn seconds(self) -> f64 {
        match self {
            Self::Static => 120.0,
            Self::Walkers => 225.0,
            Self::Foyer => 1200.0,
        }
    }

    /// What happens, in a few words.
    #[must_use]
    pub fn about(self) -> &'static str {
        match self {
            Self::Static => "a furnished room, nobody in it",
            Self::Walkers => "one person at random, then four round a quadrilateral",
            Self::Foyer => "a foyer: street, elevator, laboratory, and people who talk",
        }
    }
}

/// How often a laser scans: the mirror turns at 75 Hz, and every n-th turn is sent.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Rate {
    turns: u64,
}

/// A rate that the device does not have.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[error(
    "{found} scans a second, expected 1 to 75.1: the mirror of an LMS 200 turns 75.1 times a second"
)]
pub struct RateError {
    found: f64,
}

impl Rate {
    /// At 38 400 baud a scan takes eight turns to send: 9.38 Hz. (SICK 8007954, table 10-17)
    pub const SERIAL_38400: Self = Self { turns: 8 };
    /// At 500 000 baud every turn is sent: 75.08 Hz.
    pub const SERIAL_500K: Self = Self { turns: 1 };

    /// The rate of the device that is nearest.
    ///
    /// # Errors
    /// If the device is never so slow or so fast.
    pub fn nearest(rate_hz: f64) -> Result<Self, RateError> {
        let turns = (SECOND_NS as f64 / TURN_NS as f64 / rate_hz).round();
        if !(1.0..=TURNS_MAX as f64).contains(&turns) {
            return Err(RateError { found: rate_hz });
        }
        Ok(Self { turns: turns as u64 })
    }

    /// From scan to scan, nanoseconds; also the frame period, which gives the paper's cycle: one
    /// reading from each laser.
    #[must_use]
    pub fn period_ns(self) -> u64 {
        self.turns * TURN_NS
    }

    /// Scans a second.
    #[must_use]
    pub fn hz(self) -> f64 {
        SECOND_NS as f64 / self.period_ns() as f64
    }
}

/// When the mirror of a laser passes its first beam, nanoseconds after the frame's stamp: the mirrors
/// are not in step, and where each is, is a matter of chance. Finaliser of `SplitMix64`.
#[must_use]
pub fn phase_ns(seed: u64, laser: usize, rate: Rate) -> u64 {
    let mut bits = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15).wrapping_add(laser as u64 + 1);
    bits = (bits ^ (bits >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    bits = (bits ^ (bits >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    (bits ^ (bits >> 31)) % rate.period_ns()
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn rates_are_those_of_the_device() {
        for (asked, hz) in
            [(9.4, 9.384), (75.0, 75.075), (10.0, 9.384), (37.5, 37.538), (1.0, 1.001)]
        {
            let rate = Rate::nearest(asked).unwrap();
            assert!((rate.hz() - hz).abs() < 0.001, "{asked}: {}", rate.hz());
        }
        for absurd in [0.0, -1.0, 0.9, 1000.0, f64::NAN, f64::INFINITY] {
            let error = Rate::nearest(absurd).unwrap_err().to_string();
            assert!(error.contains("expected 1 to 75.1"), "{error}");
        }
        assert_eq!(Rate::nearest(9.4).unwrap(), Rate::SERIAL_38400);
        assert_eq!(Rate::nearest(75.0).unwrap(), Rate::SERIAL_500K);
    }

    #[test]
    fn the_scenes_of_the_experiments_are_delivered_and_begin_when_they_should() {
        for experiment in Experiment::ALL {
            let scene = experiment.scene().unwrap();
            let lasers = if experiment == Experiment::Foyer { 1 } else { 4 };
            assert_eq!(scene.lasers.len(), lasers);
            assert_eq!(Experiment::of_number(experiment.number()), Some(experiment));
            let mut world = scene::World::new(scene, 1).unwrap();
            let end_s = experiment.begin_s() + experiment.seconds();
            if experiment == Experiment::Static {
                assert!(world.truth(experiment.begin_s()).people.is_empty());
                assert!(world.truth(end_s).people.is_empty());
            }
        }
        assert_eq!(Experiment::of_number(4), None);
    }

    #[test]
    fn mirrors_are_out_of_step_and_the_same_at_every_run() {
        let phases: Vec<u64> = (0..4).map(|laser| phase_ns(7, laser, Rate::SERIAL_38400)).collect();
        assert!(phases.iter().all(|&phase| phase < Rate::SERIAL_38400.period_ns()));
        assert!(phases.windows(2).all(|pair| pair[0] != pair[1]));
        assert_eq!(phases[2], phase_ns(7, 2, Rate::SERIAL_38400));
    }
}
