//! Scans, out and in.

use super::{Bridge, refuse};
use crate::link::Stream;
use process::loss::LossCounter;
use process::{Failure, Publisher, Subscriber, Worker};
use protocol::codec::{decode, encode};
use protocol::link::CarriedScan;
use protocol::scan::{LaserScan, ScanHeader};
use protocol::site::{Host, Site};
use protocol::topic;
use protocol::wire::{Envelope, FLAG_END_OF_STREAM};
use std::collections::BTreeSet;

/// Scans of another host.
pub(super) struct Incoming {
    laser: String,
    /// Index of the laser in the site.
    index: u32,
    scans: Publisher<ScanHeader, f32>,
    pub(super) losses: LossCounter,
}

/// What of the lasers crosses here, in which direction.
pub(super) struct Lanes {
    pub(super) incoming: Vec<Incoming>,
    pub(super) streams: Vec<Stream>,
    /// The area of each stream.
    pub(super) of_areas: Vec<String>,
    /// Index and id of the lasers whose scans go from here.
    pub(super) sent: Vec<(usize, String)>,
    pub(super) outgoing: Vec<Subscriber<ScanHeader, f32>>,
}

impl Lanes {
    pub(super) fn open(worker: &Worker, site: &Site, me: &Host) -> Result<Self, Failure> {
        let (mut incoming, mut streams, mut of_areas) = (Vec::new(), Vec::new(), Vec::new());
        let (mut sent, mut areas) = (Vec::new(), BTreeSet::new());
        for (index, laser, area) in site.lasers_that_cross() {
            let host = site.host_of_laser(laser).unwrap_or_default().to_owned();
            if host == me.id {
                sent.push((index, laser.id.clone()));
                areas.insert(area.id.clone());
            } else if area.may_run_on(Some(&me.id)) {
                let scans = worker.bus.publisher(&topic::scan(&area.id), index as u32)?;
                let (id, losses) = (laser.id.clone(), LossCounter::default());
                incoming.push(Incoming { laser: id, index: index as u32, scans, losses });
                let (laser, shared) = (laser.id.clone(), area.standby.is_some());
                streams.push(Stream { host, laser, shared });
                of_areas.push(area.id.clone());
            }
        }
        let outgoing = areas.iter().map(|area| worker.bus.subscriber(&topic::scan(area)));
        let outgoing = outgoing.collect::<Result<_, _>>()?;
        Ok(Self { incoming, streams, of_areas, sent, outgoing })
    }
}

impl Bridge {
    /// Scans of the lasers here, to the hosts of their areas.
    pub(super) fn send_scans(&mut self) -> Result<(), Failure> {
        for scans in &mut self.outgoing {
            while let Some(sample) = scans.receive()? {
                let header = *sample.header();
                let Envelope { session, seq, source, .. } = header.envelope;
                let Some(laser) = self.link.sends(source as usize).map(str::to_owned) else {
                    continue; // of another host, for an area that both may run
                };
                let scan = (!sample.is_end_of_stream()).then(|| LaserScan {
                    stamp_ns: header.stamp_ns,
                    device_stamp_ns: header.device_stamp_ns,
                    geometry: header.geometry,
                    ranges_m: sample.payload().to_vec(),
                });
                let sent = encode(&CarriedScan { laser, session, seq, scan })
                    .is_ok_and(|bytes| self.link.send_scan(source as usize, bytes));
                if sent {
                    self.counters.scans_out += 1;
                } else {
                    self.counters.scans_refused += 1;
                }
            }
        }
        Ok(())
    }

    pub(super) fn take_scan(&mut self, stream: usize, bytes: &[u8]) -> Result<(), Failure> {
        let Some(incoming) = self.incoming.get_mut(stream) else { return Ok(()) };
        let carried = match decode::<CarriedScan>(bytes) {
            Ok(carried) => carried,
            Err(error) => {
                let laser = format!("laser {}", incoming.laser);
                refuse(&mut self.counters.scans_refused, &laser, &error);
                return Ok(());
            }
        };
        if carried.laser != incoming.laser {
            let expected = format!("laser {}", incoming.laser);
            self.misrouted(&expected, &carried.laser);
            return Ok(());
        }
        let (session, seq, source) = (carried.session, carried.seq, incoming.index);
        incoming.losses.observe(&Envelope { session, seq, source, ..Envelope::default() });
        let ranges_m = carried.scan.as_ref().map_or(&[][..], |scan| &scan.ranges_m);
        let mut loan = incoming.scans.loan(ranges_m.len())?;
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
        self.counters.scans_in += 1;
        Ok(())
    }
}
