//! A laser of an imagined building.
//!
//! Scan k is stamped k/rate seconds after the epoch, whatever happened before: a laser that was restarted
//! goes on with the scans that it would have made, and two runs make the same bytes. The geometry is
//! rounded to what a recording can hold, so that a recording of it replays to the same bits.

use crate::source::{SourceCounts, SourceError};
use protocol::scan::{LaserScan, ScanGeometry};
use scene::{LaserSpec, Scene, World};

/// Rates are held in microhertz, so that stamps are exact integers: 75 Hz never drifts.
const MICROHERTZ: f64 = 1e6;
/// Nanoseconds in a second times microhertz in a hertz.
const NANO_MICRO: u128 = 1_000_000_000_000_000;

/// The scans of one simulated laser, without end.
pub struct SimulatorSource {
    world: World,
    laser: LaserSpec,
    geometry: ScanGeometry,
    rate_microhertz: u128,
    next: u128,
    scans: u64,
}

impl SimulatorSource {
    /// A laser of a scene; its first scan is the first that is stamped at or after `begin_ns`.
    ///
    /// `rate_hz` is taken to the microhertz and is at least one microhertz.
    ///
    /// # Errors
    /// If the scene breaks a bound.
    pub fn new(
        scene: Scene,
        laser: LaserSpec,
        seed: u64,
        rate_hz: f64,
        begin_ns: u64,
    ) -> Result<Self, SourceError> {
        let rate_microhertz = ((rate_hz * MICROHERTZ).round() as u128).max(1);
        let next = (u128::from(begin_ns) * rate_microhertz).div_ceil(NANO_MICRO);
        let geometry = recording::as_recorded(&laser.geometry());
        let world = World::new(scene, seed)?;
        Ok(Self { world, laser, geometry, rate_microhertz, next, scans: 0 })
    }

    /// Puts the next scan into `scan`; allocates nothing once `scan` is large enough.
    pub fn next(&mut self, scan: &mut LaserScan) {
        // Rounded up, so that the number of a scan follows from its stamp.
        let stamp_ns = (self.next * NANO_MICRO).div_ceil(self.rate_microhertz);
        scan.stamp_ns = u64::try_from(stamp_ns).unwrap_or(u64::MAX);
        scan.device_stamp_ns = 0;
        scan.geometry = self.geometry;
        let t_s = self.world.scene().time_s(scan.stamp_ns);
        self.world.scan(&self.laser, t_s, &mut scan.ranges_m);
        self.next += 1;
        self.scans += 1;
    }

    /// Skips the scans that are stamped before `begin_ns`: the host slept, or could not keep up.
    /// Returns how many they were.
    pub fn skip_to(&mut self, begin_ns: u64) -> u64 {
        let next = (u128::from(begin_ns) * self.rate_microhertz).div_ceil(NANO_MICRO);
        let skipped = next.saturating_sub(self.next);
        self.next += skipped;
        u64::try_from(skipped).unwrap_or(u64::MAX)
    }

    /// What it is, for the log.
    #[must_use]
    pub fn describe(&self) -> String {
        let rate_hz = self.rate_microhertz as f64 / MICROHERTZ;
        format!("the simulation of scene {} at {rate_hz} Hz", self.world.scene().name)
    }

    /// Totals.
    #[must_use]
    pub fn counts(&self) -> SourceCounts {
        SourceCounts { scans: self.scans, ..SourceCounts::default() }
    }
}
