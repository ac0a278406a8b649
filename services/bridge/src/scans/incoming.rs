//! Scans of a laser of another host: from the thread of zenoh that received them into shared memory.

use super::lock;
use process::loss::LossCounter;
use process::{BusError, Publisher};
use protocol::codec::decode;
use protocol::link::CarriedScan;
use protocol::scan::ScanHeader;
use protocol::wire::{Envelope, FLAG_END_OF_STREAM};
use std::sync::Mutex;

/// What came of a laser.
#[derive(Debug, Clone, Default)]
pub struct IncomingCounts {
    /// Handed on.
    pub came: u64,
    /// By the numbers of the laser's process: never came.
    pub lost: u64,
    /// Were no scans, and were left out.
    pub refused: u64,
    /// Were of another laser, and were left out.
    pub misrouted: u64,
    /// The last that was no scan: why.
    pub refused_last: String,
    /// The last that was of another laser: of which.
    pub misrouted_last: String,
}

/// The stream of scans of a laser.
#[derive(Debug)]
pub struct Incoming {
    laser: String,
    /// Index of the laser in the site.
    index: u32,
    /// None when the bridge has left: zenoh still calls.
    entrance: Mutex<Option<Entrance>>,
}

#[derive(Debug)]
struct Entrance {
    scans: Publisher<ScanHeader, f32>,
    losses: LossCounter,
    counts: IncomingCounts,
    failed: Option<BusError>,
}

impl Incoming {
    /// Scans of `laser`, the site's laser of this index, go to `scans`.
    pub fn new(laser: &str, index: u32, scans: Publisher<ScanHeader, f32>) -> Self {
        let (losses, counts) = (LossCounter::default(), IncomingCounts::default());
        let entrance = Mutex::new(Some(Entrance { scans, losses, counts, failed: None }));
        Self { laser: laser.to_owned(), index, entrance }
    }

    /// The laser's id.
    pub fn laser(&self) -> &str {
        &self.laser
    }

    /// Takes a message that came for this laser. What is no scan of it is counted and left out.
    pub fn take(&self, bytes: &[u8]) {
        let carried = decode::<CarriedScan>(bytes);
        let mut entrance = lock(&self.entrance);
        let Some(Entrance { scans, losses, counts, failed }) = &mut *entrance else { return };
        match carried {
            Err(error) => {
                counts.refused += 1;
                counts.refused_last = error.to_string();
            }
            Ok(carried) if carried.laser != self.laser => {
                counts.misrouted += 1;
                counts.misrouted_last = carried.laser;
            }
            Ok(carried) => {
                let (session, seq, source) = (carried.session, carried.seq, self.index);
                losses.observe(&Envelope { session, seq, source, ..Envelope::default() });
                match hand_on(scans, &carried) {
                    Ok(()) => counts.came += 1,
                    Err(error) => *failed = Some(error),
                }
            }
        }
    }

    /// What came so far.
    pub fn counts(&self) -> IncomingCounts {
        let entrance = lock(&self.entrance);
        let Some(entrance) = &*entrance else { return IncomingCounts::default() };
        IncomingCounts { lost: entrance.losses.total().lost, ..entrance.counts.clone() }
    }

    /// Why scans could not be handed on, if that was so.
    pub fn take_failure(&self) -> Option<BusError> {
        lock(&self.entrance).as_mut().and_then(|entrance| entrance.failed.take())
    }

    /// From here on nothing is handed on: the port to shared memory is given back.
    pub fn close(&self) {
        *lock(&self.entrance) = None;
    }
}

fn hand_on(scans: &mut Publisher<ScanHeader, f32>, carried: &CarriedScan) -> Result<(), BusError> {
    let ranges_m = carried.scan.as_ref().map_or(&[][..], |scan| &scan.ranges_m);
    let mut loan = scans.loan(ranges_m.len())?;
    loan.payload_mut().copy_from_slice(ranges_m);
    let header = loan.header_mut();
    *header = ScanHeader::default();
    match &carried.scan {
        Some(scan) => {
            header.stamp_ns = scan.stamp_ns;
            header.device_stamp_ns = scan.device_stamp_ns;
            header.geometry = scan.geometry;
        }
        None => header.envelope.flags = FLAG_END_OF_STREAM,
    }
    loan.send();
    Ok(())
}
