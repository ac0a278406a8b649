//! Randomness as a function: every draw follows from (seed, who, which) and from nothing before it,
//! so that a process that starts late draws the same people as one that ran all along.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

/// What a stream of draws is for; the first part of its key, so that two uses never share a stream.
#[derive(Debug, Clone, Copy)]
#[repr(u64)]
pub(crate) enum Purpose {
    /// Arrivals of a route in a slot.
    Arrival = 1,
    /// How one walker walks.
    Gait = 2,
    /// People of a loop.
    Loop = 3,
    /// Where a wanderer stands at the begin of a slot.
    WanderPlace = 4,
    /// The way of a wanderer through a slot.
    WanderWay = 5,
    /// How long a door stays open behind a walker.
    DoorHold = 6,
    /// Noise of a scan.
    Noise = 7,
    /// Bias of a laser.
    Bias = 8,
    /// A scripted walker.
    Incident = 9,
    /// When and where a laser is dazzled.
    Dazzle = 10,
}

/// Mixes the parts of a key to 64 bits (the finaliser of SplitMix64, Steele et al. 2014, per part).
pub(crate) fn mix(purpose: Purpose, parts: &[u64]) -> u64 {
    let mut state = purpose as u64;
    for &part in parts {
        state = finalise(state.wrapping_add(0x9E37_79B9_7F4A_7C15) ^ part);
    }
    finalise(state)
}

fn finalise(mut bits: u64) -> u64 {
    bits = (bits ^ (bits >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    bits = (bits ^ (bits >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    bits ^ (bits >> 31)
}

/// The stream of draws of a key.
pub(crate) fn stream(purpose: Purpose, parts: &[u64]) -> ChaCha8Rng {
    ChaCha8Rng::seed_from_u64(mix(purpose, parts))
}

/// A number for a name, stable across runs and machines (FNV-1a).
pub(crate) fn name_key(name: &str) -> u64 {
    name.bytes().fold(0xCBF2_9CE4_8422_2325, |hash, byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01B3)
    })
}
