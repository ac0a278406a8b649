//! What two hosts that may run an area say to each other: that they are there, what they claim, and the
//! files that the one copies of the other.

use super::refused::Refuser;
use super::{Asker, Link, MESSAGE_BYTES_MAX, QUERY_TIMEOUT, partners, publisher, receive, take};
use crate::inbox::{FileAsk, Inbox};
use protocol::codec::ENVELOPE_BYTES;
use protocol::link::{AreaFile, FILE_PAGE_BYTES_MAX, FilePage};
use protocol::site::{Host, Site};
use protocol::topic;
use std::sync::Arc;
use zenoh::Wait;
use zenoh::liveliness::LivelinessToken;
use zenoh::pubsub::Publisher;
use zenoh::qos::{CongestionControl, Priority};
use zenoh::query::Query;
use zenoh::sample::SampleKind;

/// Longest page of a file: its bytes, and room for the rest.
const FILE_MESSAGE_BYTES_MAX: usize = FILE_PAGE_BYTES_MAX + 256 + ENVELOPE_BYTES;

/// What is declared for the areas that this host shares with others.
#[derive(Debug)]
pub(super) struct Sharing {
    claims: Publisher<'static>,
    /// That this host is there, for as long as its session is.
    _token: LivelinessToken,
}

impl Sharing {
    /// Declares what `me` says, and listens to those that may run an area of this host.
    pub(super) fn declare(
        session: &zenoh::Session,
        site: &Site,
        me: &Host,
        areas: &[String],
        inbox: &Arc<Inbox<Asker>>,
        refuser: &Refuser,
    ) -> Result<Self, String> {
        let failed = |error: zenoh::Error| error.to_string();
        for index in partners(site, me) {
            let host = &site.hosts[index].id;
            let key = topic::claim_key(&site.name, host);
            receive(session, key, MESSAGE_BYTES_MAX, inbox, move |i, b| i.claims(index, b))?;
            let put = Arc::clone(inbox);
            session
                .liveliness()
                .declare_subscriber(topic::alive_key(&site.name, host))
                .history(true)
                .callback(move |sample| put.alive(index, sample.kind() == SampleKind::Put))
                .background()
                .wait()
                .map_err(failed)?;
        }
        for area in areas {
            let (inbox, area, refuser) = (Arc::clone(inbox), area.clone(), refuser.clone());
            session
                .declare_queryable(topic::replica_key(&site.name, &me.id, &area))
                .callback(move |query| {
                    let Some((file, offset)) = part(&query) else {
                        inbox.not_understood();
                        return refuser.end(Asker(query));
                    };
                    let area = area.clone();
                    let ask = FileAsk { area, file, offset, query: Asker(query) };
                    if let Some(refused) = inbox.ask_file(ask) {
                        refuser.end(refused.query);
                    }
                })
                .background()
                .wait()
                .map_err(failed)?;
        }
        let claim_key = topic::claim_key(&site.name, &me.id);
        let claims = publisher(session, claim_key, Priority::InteractiveHigh, true)?;
        let token = session.liveliness().declare_token(topic::alive_key(&site.name, &me.id));
        Ok(Self { claims, _token: token.wait().map_err(failed)? })
    }
}

/// `file=map;offset=0`; none if it is not understood.
fn part(query: &Query) -> Option<(AreaFile, u64)> {
    let parameters = query.parameters();
    let file = match parameters.get("file")? {
        "map" => AreaFile::Map,
        "normal" => AreaFile::Normal,
        _ => return None,
    };
    Some((file, parameters.get("offset")?.parse().ok()?))
}

impl Link {
    /// Sends encoded claims, if there is room.
    pub fn send_claims(&self, bytes: Vec<u8>) {
        if let Some(sharing) = &self.sharing {
            let _ = sharing.claims.put(bytes).wait(); // the next ones are due in half a second
        }
    }

    /// Asks a host for a part of a file; the answer comes as a page.
    pub fn ask_file(
        &self,
        (index, host): (usize, &str),
        area: &str,
        (file, offset): (AreaFile, u64),
        inbox: &Arc<Inbox<Asker>>,
    ) {
        let (inbox, key) = (Arc::clone(inbox), topic::replica_key(&self.site, host, area));
        let file = match file {
            AreaFile::Map => "map",
            AreaFile::Normal => "normal",
        };
        let asked = self
            .session
            .get(format!("{key}?file={file};offset={offset}"))
            .timeout(QUERY_TIMEOUT)
            .congestion_control(CongestionControl::Drop)
            .priority(Priority::DataLow)
            .callback(move |reply| {
                if let Ok(sample) = reply.result() {
                    take(sample, FILE_MESSAGE_BYTES_MAX, &inbox, |inbox, bytes| {
                        inbox.file(index, bytes);
                    });
                }
            })
            .wait();
        if let Err(error) = asked {
            tracing::debug!("cannot ask host {host} for a file: {error}"); // it is asked again
        }
    }

    /// Answers who asked for a part of a file.
    pub fn answer_file(&self, asker: &Asker, page: &FilePage) {
        match protocol::codec::encode(page) {
            Ok(bytes) => self.answer(asker, bytes),
            Err(error) => tracing::warn!("a page of a file is not sent: {error}"),
        }
    }
}
