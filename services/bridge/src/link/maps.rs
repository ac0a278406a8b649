//! Frames and maps of areas between hosts: published while somebody elsewhere listens.

use super::{Asker, Link, publisher, receive};
use crate::inbox::Inbox;
use protocol::carried::COUNTS_PAGE_MAX;
use protocol::codec::{BODY_BYTES_MAX, ENVELOPE_BYTES};
use protocol::site::{Host, Site};
use protocol::topic;
use std::sync::Arc;
use zenoh::Wait;
use zenoh::pubsub::Publisher;
use zenoh::qos::Priority;

/// Which of the three streams of an area.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum View {
    /// Frames.
    Frame,
    /// Class maps.
    Classes,
    /// Collapsed maps.
    Collapsed,
}

impl View {
    /// All of them, in the order of their indices.
    pub const ALL: [Self; 3] = [Self::Frame, Self::Classes, Self::Collapsed];

    /// Longest message of an area of `cells` cells: varints of 5 bytes, runs of 5 + 10, and room for the
    /// rest.
    fn bytes_max(self, cells: usize) -> usize {
        let content = match self {
            Self::Frame | Self::Classes => 5 * cells,
            Self::Collapsed => 15 * COUNTS_PAGE_MAX,
        };
        (content + 256).min(BODY_BYTES_MAX) + ENVELOPE_BYTES
    }

    /// Behind scans and events, and dropped first.
    fn priority(self) -> Priority {
        match self {
            Self::Frame | Self::Classes => Priority::DataLow,
            Self::Collapsed => Priority::Background,
        }
    }

    fn key(self, site: &str, host: &str, area: &str) -> String {
        match self {
            Self::Frame => topic::frame_key(site, host, area),
            Self::Classes => topic::classes_key(site, host, area),
            Self::Collapsed => topic::collapsed_key(site, host, area),
        }
    }
}

/// What is declared for the areas that this host may run: by their index in the site.
#[derive(Debug)]
pub(super) struct Views(Vec<((usize, View), Publisher<'static>)>);

impl Views {
    /// Declares what `me` publishes, and listens to what it follows.
    pub(super) fn declare(
        session: &zenoh::Session,
        site: &Site,
        me: &Host,
        inbox: &Arc<Inbox<Asker>>,
    ) -> Result<Self, String> {
        let mut publishers = Vec::new();
        for (index, area) in site.areas.iter().enumerate() {
            if !area.may_run_on(Some(&me.id)) {
                continue;
            }
            for view in View::ALL {
                let key = view.key(&site.name, &me.id, &area.id);
                let publisher = publisher(session, key, view.priority(), false)?;
                let (inbox, place) = (Arc::clone(inbox), (index, view));
                publisher
                    .matching_listener()
                    .callback(move |status| inbox.wanted(place, status.matching()))
                    .background()
                    .wait()
                    .map_err(|error| error.to_string())?;
                publishers.push((place, publisher));
            }
        }
        for (stream, area) in site.areas_followed_by(Some(&me.id)).enumerate() {
            let told_by = |host: &&(usize, &Host)| area.may_run_on(Some(&host.1.id));
            for (index, host) in site.hosts.iter().enumerate().filter(|host| told_by(&host)) {
                for view in View::ALL {
                    let key = view.key(&site.name, &host.id, &area.id);
                    let bytes_max = view.bytes_max(area.grid().cells());
                    receive(session, key, bytes_max, inbox, move |inbox, bytes| {
                        inbox.view((stream, view), index, bytes);
                    })?;
                }
            }
        }
        Ok(Self(publishers))
    }
}

impl Link {
    /// Sends an encoded frame or map, if there is room and somebody listens.
    pub fn send_view(&self, place: (usize, View), bytes: Vec<u8>) {
        if let Some((_, publisher)) = self.views.0.iter().find(|(of, _)| *of == place) {
            let _ = publisher.put(bytes).wait(); // the reader counts, by the numbers
        }
    }
}
