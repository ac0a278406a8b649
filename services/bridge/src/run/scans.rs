//! Which scans cross here, in which direction, and what is told of them. They do not wait for this loop:
//! see [`crate::scans`].

use super::{Bridge, say_refused};
use crate::link::{Link, Stream};
use crate::scans::{Incoming, IncomingCounts, Outgoing};
use process::{Failure, Worker};
use protocol::site::{Host, Site};
use protocol::topic;
use std::collections::BTreeSet;
use std::sync::Arc;

/// The scans that come here.
pub(super) struct Arrivals {
    pub(super) streams: Vec<Stream>,
    /// The area of each stream.
    pub(super) of_areas: Vec<String>,
}

impl Arrivals {
    pub(super) fn open(worker: &Worker, site: &Site, me: &Host) -> Result<Self, Failure> {
        let (mut streams, mut of_areas) = (Vec::new(), Vec::new());
        for (index, laser, area) in site.lasers_that_cross() {
            let host = site.host_of_laser(laser).unwrap_or_default();
            if host == me.id || !area.may_run_on(Some(&me.id)) {
                continue;
            }
            let scans = worker.bus.publisher(&topic::scan(&area.id), index as u32)?;
            let incoming = Arc::new(Incoming::new(&laser.id, index as u32, scans));
            let (host, shared) = (host.to_owned(), area.standby.is_some());
            streams.push(Stream { host, shared, incoming });
            of_areas.push(area.id.clone());
        }
        Ok(Self { streams, of_areas })
    }
}

/// Begins to send the scans of the lasers here whose areas may run elsewhere.
pub(super) fn start(
    worker: &Worker,
    site: &Site,
    me: &Host,
    link: &Link,
) -> Result<Vec<Arc<Outgoing>>, Failure> {
    let (mut lasers, mut areas) = (Vec::new(), BTreeSet::new());
    for (index, laser, area) in site.lasers_that_cross() {
        if site.host_of_laser(laser) == Some(&me.id) {
            lasers.push((index as u32, laser.id.clone()));
            areas.insert(&area.id);
        }
    }
    let lasers = Arc::new(link.scan_publishers(&lasers).map_err(Failure::Failed)?);
    let start = |area: &String| {
        let scans = worker.bus.subscriber_of_task(&topic::scan(area))?;
        Ok(Outgoing::start(scans, &lasers)?)
    };
    areas.into_iter().map(start).collect()
}

/// What was counted of all lasers.
#[derive(Default)]
pub(super) struct ScanCounts {
    pub(super) sent: u64,
    pub(super) came: u64,
    pub(super) lost: u64,
    pub(super) refused: u64,
    pub(super) misrouted: u64,
}

/// What of a stream was told in the log so far.
#[derive(Clone, Copy, Default)]
pub(super) struct Told {
    refused: u64,
    misrouted: u64,
}

impl Bridge {
    /// Counts the scans, and says what was refused of them since the last time.
    pub(super) fn count_scans(&mut self) -> ScanCounts {
        let mut counts = ScanCounts::default();
        for outgoing in &self.outgoing {
            counts.sent += outgoing.sent();
            counts.refused += outgoing.refused();
        }
        for (n, stream) in self.streams.iter().enumerate() {
            let IncomingCounts { came, lost, refused, misrouted, refused_last, misrouted_last } =
                stream.incoming.counts();
            counts.came += came;
            counts.lost += lost;
            counts.refused += refused;
            counts.misrouted += misrouted;
            let laser = format!("laser {}", stream.incoming.laser());
            let told = &mut self.scans_told[n];
            say_refused(told.refused, refused, &laser, &refused_last);
            if misrouted > told.misrouted {
                let found = format!("it is of {misrouted_last:?}");
                say_refused(told.misrouted, misrouted, &laser, &found);
                self.counters.misrouted.note(&laser, &found);
            }
            self.scans_told[n] = Told { refused, misrouted };
        }
        counts
    }

    /// If shared memory refused to carry scans.
    pub(super) fn failed_scans(&self) -> Result<(), Failure> {
        let incoming = self.streams.iter().filter_map(|stream| stream.incoming.take_failure());
        let mut failed =
            incoming.chain(self.outgoing.iter().filter_map(|outgoing| outgoing.take_failure()));
        failed.next().map_or(Ok(()), |error| Err(error.into()))
    }

    /// Gives the ports of the scans back: zenoh calls as long as the process lives.
    pub(super) fn close_scans(&self) {
        self.streams.iter().for_each(|stream| stream.incoming.close());
        self.outgoing.iter().for_each(|outgoing| outgoing.close());
    }
}
