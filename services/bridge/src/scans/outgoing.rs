//! Scans of the lasers here: from shared memory to the hosts of their areas, on the thread of zenoh that
//! writes to the network. A scan that is put there is written next, by the same thread.

use super::lock;
use crate::link::{ScanPublishers, spawn_beside_the_writer};
use process::{BusError, Subscriber};
use protocol::codec::encode;
use protocol::link::CarriedScan;
use protocol::scan::{LaserScan, ScanHeader};
use protocol::wire::Envelope;
use std::future::poll_fn;
use std::io;
use std::os::fd::OwnedFd;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;
use tokio::io::Interest;
use tokio::io::unix::AsyncFd;
use tokio::time::{MissedTickBehavior, interval};

/// So often it is looked whether a ring went unheard, which happens to iceoryx2:
/// `services/process/src/doorbell.rs`.
const UNHEARD: Duration = Duration::from_millis(100);

/// The scans of an area that go from here.
#[derive(Debug)]
pub struct Outgoing {
    /// None when the bridge has left.
    scans: Mutex<Option<Subscriber<ScanHeader, f32>>>,
    sent: AtomicU64,
    refused: AtomicU64,
    failed: Mutex<Option<BusError>>,
}

impl Outgoing {
    /// Sends what comes from `scans`, opened for a task, and is of `lasers`, until it is closed.
    ///
    /// # Errors
    /// If the system gives no more file descriptors.
    pub fn start(
        scans: Subscriber<ScanHeader, f32>,
        lasers: &Arc<ScanPublishers>,
    ) -> io::Result<Arc<Self>> {
        let bell = scans.descriptor().try_clone_to_owned()?;
        let (sent, refused) = (AtomicU64::new(0), AtomicU64::new(0));
        let failed = Mutex::new(None);
        let outgoing = Arc::new(Self { scans: Mutex::new(Some(scans)), sent, refused, failed });
        spawn_beside_the_writer(Arc::clone(&outgoing).carry(bell, Arc::clone(lasers)));
        Ok(outgoing)
    }

    /// Scans that were sent, if there was room: who receives them counts the others.
    pub fn sent(&self) -> u64 {
        self.sent.load(Ordering::Relaxed)
    }

    /// Scans that could not be put into a message.
    pub fn refused(&self) -> u64 {
        self.refused.load(Ordering::Relaxed)
    }

    /// Why no more scans are sent, if that is so.
    pub fn take_failure(&self) -> Option<BusError> {
        lock(&self.failed).take()
    }

    /// Sends no more; the port to shared memory is given back.
    pub fn close(&self) {
        *lock(&self.scans) = None;
    }

    async fn carry(self: Arc<Self>, bell: OwnedFd, lasers: Arc<ScanPublishers>) {
        if let Err(error) = self.carry_on(bell, &lasers).await {
            *lock(&self.failed) = Some(error);
        }
    }

    async fn carry_on(&self, bell: OwnedFd, lasers: &ScanPublishers) -> Result<(), BusError> {
        let broken = |source| BusError::System { action: "wait for scans", source };
        // SAFETY: the descriptor is open, is owned by what is made of it, and an `OwnedFd` names the same
        // one until it is dropped.
        let bell = unsafe { AsyncFd::register_with_interest(bell, Interest::READABLE) }
            .map_err(|error| broken(error.into()))?;
        let mut unheard = interval(UNHEARD);
        unheard.set_missed_tick_behavior(MissedTickBehavior::Delay);
        while self.with_scans(Subscriber::begin_turn).is_some() {
            self.send_all(lasers).await?;
            if self.with_scans(Subscriber::take_unfinished) == Some(false) {
                poll_fn(|context| {
                    let rang = bell.poll_read_ready(context).map_ok(|mut rang| rang.clear_ready());
                    let unheard = unheard.poll_tick(context).map(|_| Ok(()));
                    if rang.is_ready() { rang } else { unheard }
                })
                .await
                .map_err(broken)?;
                // First the scan, then the bell: what rings meanwhile is seen in the next turn.
                self.send_all(lasers).await?;
            }
        }
        Ok(())
    }

    /// Sends what is there.
    async fn send_all(&self, lasers: &ScanPublishers) -> Result<(), BusError> {
        while self.send_one(lasers)? {
            // zenoh writes it now: who waits for room on its only thread would wait in vain.
            tokio::task::yield_now().await;
        }
        Ok(())
    }

    /// None if it is closed.
    fn with_scans<T>(&self, act: impl Fn(&Subscriber<ScanHeader, f32>) -> T) -> Option<T> {
        lock(&self.scans).as_ref().map(act)
    }

    /// False if there is none.
    fn send_one(&self, lasers: &ScanPublishers) -> Result<bool, BusError> {
        let mut scans = lock(&self.scans);
        let Some(sample) = scans.as_mut().map(Subscriber::receive).transpose()?.flatten() else {
            return Ok(false);
        };
        let header = *sample.header();
        let Envelope { session, seq, source, .. } = header.envelope;
        let Some(laser) = lasers.laser(source).map(str::to_owned) else {
            return Ok(true); // of another host, for an area that both may run
        };
        let scan = (!sample.is_end_of_stream()).then(|| LaserScan {
            stamp_ns: header.stamp_ns,
            device_stamp_ns: header.device_stamp_ns,
            geometry: header.geometry,
            ranges_m: sample.payload().to_vec(),
        });
        let is_sent = encode(&CarriedScan { laser, session, seq, scan })
            .is_ok_and(|bytes| lasers.put(source, bytes));
        let counter = if is_sent { &self.sent } else { &self.refused };
        counter.fetch_add(1, Ordering::Relaxed);
        Ok(true)
    }
}
