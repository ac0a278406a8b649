//! Scans, which go past the inbox: see [`crate::scans`].

use super::{Link, publisher};
use crate::scans::{Incoming, Sent};
use protocol::scan::BEAMS_MAX;
use protocol::topic;
use std::sync::Arc;
use zenoh::Wait;
use zenoh::qos::Priority;

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

impl Link {
    /// What the scans of these lasers (index in the site, and id) of this host are put to.
    ///
    /// # Errors
    /// If zenoh refuses a key.
    pub fn scan_publishers(&self, lasers: &[(u32, String)]) -> Result<Sent, String> {
        let publisher = |(index, laser): &(u32, String)| {
            let key = topic::scan_key(&self.site, &self.host, laser);
            let publisher = publisher(&self.session, key, Priority::Data, true)?;
            Ok((*index, (laser.clone(), publisher)))
        };
        lasers.iter().map(publisher).collect()
    }

    /// From here on the scans of this stream come, or come no more: an area moved.
    pub fn listen(&mut self, stream: usize, listens: bool) {
        if !listens {
            self.listening.remove(&stream);
            return;
        }
        let Some(Stream { host, incoming, .. }) = self.streams.get(stream) else { return };
        if self.listening.contains_key(&stream) {
            return;
        }
        let (key, incoming) =
            (topic::scan_key(&self.site, host, incoming.laser()), Arc::clone(incoming));
        let declared = self
            .session
            .declare_subscriber(key)
            .callback(move |sample| {
                let payload = sample.payload();
                if payload.len() > SCAN_BYTES_MAX {
                    incoming.refuse(&format!(
                        "it has {} bytes, at most {SCAN_BYTES_MAX} are a scan",
                        payload.len()
                    ));
                } else {
                    incoming.take(&payload.to_bytes());
                }
            })
            .wait();
        match declared {
            Ok(subscriber) => drop(self.listening.insert(stream, subscriber)),
            Err(error) => tracing::error!("cannot listen to scans: {error}"),
        }
    }
}
