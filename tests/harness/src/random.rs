//! Random moments that can be had again.

/// A generator with a seed: `TOG_SEED`, else always the same.
pub struct Random(u64);

impl Random {
    /// Prints its seed.
    pub fn from_environment() -> Self {
        let given = std::env::var("TOG_SEED").ok().map(|text| text.parse().expect("TOG_SEED"));
        let seed = given.unwrap_or(20_261_122);
        println!("TOG_SEED={seed}");
        Self(seed)
    }

    /// A number below `limit`. splitmix64 (Steele, Lea, Flood 2014).
    pub fn below(&mut self, limit: u64) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mixed = (self.0 ^ self.0 >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let mixed = (mixed ^ mixed >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        (mixed ^ mixed >> 31) % limit
    }
}
