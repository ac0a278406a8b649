//! Scans, which go past the inbox: see [`crate::scans`].

use super::{Asker, Link, fitting, publisher};
use crate::inbox::Inbox;
use crate::scans::Incoming;
use protocol::scan::BEAMS_MAX;
use protocol::topic;
use std::collections::BTreeMap;
use std::sync::Arc;
use zenoh::Wait;
use zenoh::pubsub::Publisher;
use zenoh::qos::Priority;
use zenoh_runtime::ZRuntime;

/// Longest message of a scan: its ranges, and room for the rest.
const SCAN_BYTES_MAX: usize = 4 * BEAMS_MAX + 256;

/// A stream of scans that comes from another host.
#[derive(Debug, Clone)]
pub struct Stream {
    /// Where the laser runs.
    pub host: String,
    /// True if its area has a standby: the scans come only while the area runs here.
    pub shared: bool,
    /// Where they go.
    pub incoming: Arc<Incoming>,
}

/// The lasers whose scans go from here: by the index in the site the id, and its key.
#[derive(Debug)]
pub struct ScanPublishers(BTreeMap<u32, (String, Publisher<'static>)>);

impl ScanPublishers {
    /// The id of a laser if its scans go from here; those of others may lie in the same topic.
    pub fn laser(&self, index: u32) -> Option<&str> {
        self.0.get(&index).map(|(laser, _)| laser.as_str())
    }

    /// Sends an encoded scan, if there is room; false if no such laser sends from here.
    pub fn put(&self, index: u32, bytes: Vec<u8>) -> bool {
        // `Ok` means nothing but that it was tried: the reader counts by the scans' numbers.
        self.0.get(&index).is_some_and(|(_, publisher)| publisher.put(bytes).wait().is_ok())
    }
}

/// Runs a task on the thread of zenoh that writes to the network.
pub fn spawn_beside_the_writer(task: impl Future<Output = ()> + Send + 'static) {
    drop(ZRuntime::TX.spawn(task)); // it runs as long as the process does
}

impl Link {
    /// Declares the scans of these lasers (index in the site, and id) of this host.
    ///
    /// # Errors
    /// If zenoh refuses a key.
    pub fn scan_publishers(&self, lasers: &[(u32, String)]) -> Result<ScanPublishers, String> {
        let publisher = |(index, laser): &(u32, String)| {
            let key = topic::scan_key(&self.site, &self.host, laser);
            let publisher = publisher(&self.session, key, Priority::Data, true)?;
            Ok((*index, (laser.clone(), publisher)))
        };
        lasers.iter().map(publisher).collect::<Result<_, String>>().map(ScanPublishers)
    }

    /// From here on the scans of this stream come, or come no more: an area moved.
    pub fn listen(&mut self, stream: usize, listens: bool, inbox: &Arc<Inbox<Asker>>) {
        if !listens {
            self.listening.remove(&stream);
            return;
        }
        let Some(Stream { host, incoming, .. }) = self.streams.get(stream) else { return };
        if self.listening.contains_key(&stream) {
            return;
        }
        let key = topic::scan_key(&self.site, host, incoming.laser());
        let (incoming, inbox) = (Arc::clone(incoming), Arc::clone(inbox));
        let declared = self
            .session
            .declare_subscriber(key)
            .callback(move |sample| {
                if let Some(bytes) = fitting(&sample, SCAN_BYTES_MAX, &inbox) {
                    incoming.take(&bytes);
                }
            })
            .wait();
        match declared {
            Ok(subscriber) => drop(self.listening.insert(stream, subscriber)),
            Err(error) => tracing::error!("cannot listen to scans: {error}"),
        }
    }
}
