//! The session with the other bridges: the only place that knows zenoh.
//!
//! A peer among peers: every bridge dials those before it in the site file, and is dialled by those
//! after it; no scouting, no gossip, nobody relays. But for desks that go `through` others: a client of
//! one of these at a time, dialled by nobody, for whom those relay. They stay peers: two sessions in zenoh's
//! mode `router` did not always hear each other again after a cut. A cut link is noticed
//! after 2 s (the lease is announced, so it must be the same everywhere) and dialled again every 0.5 to
//! 1 s. TCP buffers are small, so that nothing old sits in the kernel in front of an event.
//!
//! Why only one of two dials: zenoh 1.10 (zenoh-transport, `unicast/universal/transport.rs`,
//! `add_link`) refuses a second link of a peer only if both came in. If both sides dial, the side that
//! has not noticed a cut yet adds the new link of the side that has to its old transport, and goes on
//! with numbers of keys that mean something else there: messages arrive under wrong keys.

mod areas;
mod maps;
mod refused;
mod scans;
pub(crate) mod sockets;

use crate::access;
use crate::inbox::{Ask, Inbox};
use areas::Sharing;
use certificates::Files;
pub use maps::View;
use maps::Views;
use protocol::codec::ENVELOPE_BYTES;
use protocol::link::PAGE_BYTES_MAX;
use protocol::site::{Area, Host, Site, Transport};
use protocol::topic;
use refused::Refuser;
pub use scans::{ScanPublishers, Stream, spawn_beside_the_writer};
use serde_json::json;
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;
pub use zenoh::Session;
use zenoh::Wait;
use zenoh::pubsub::{Publisher, Subscriber};
use zenoh::qos::{CongestionControl, Priority};
use zenoh::query::Query;
use zenoh::sample::{Locality, Sample};

/// What zenoh's links read when they are compiled is in a file that cargo reads only there. Without it the
/// thread that reads and writes all links would wait ten seconds for each one that was cut.
const _: () = assert!(
    option_env!("TLS_LINGER_TIMEOUT").is_some() && option_env!("TCP_LINGER_TIMEOUT").is_some(),
    "run cargo in the directory of the repository: its .cargo/config.toml says how zenoh is compiled"
);

/// Longest message of all: a page of events with its envelope.
const MESSAGE_BYTES_MAX: usize = PAGE_BYTES_MAX + ENVELOPE_BYTES;
/// A question that is not answered by then ends without an answer.
const QUERY_TIMEOUT: Duration = Duration::from_secs(3);
/// Notices a host that is gone, in the words of the lease: see the page.
const LEASE_MS: u64 = 2000;

/// Who asks the journal of this host.
#[derive(Debug)]
pub struct Asker(Query);

/// The session, and what is sent on it.
#[derive(Debug)]
pub struct Link {
    session: Session,
    site: String,
    /// This one.
    host: String,
    health: Publisher<'static>,
    live: Publisher<'static>,
    /// The streams of scans that may come.
    streams: Vec<Stream>,
    /// Those that come now.
    listening: BTreeMap<usize, Subscriber<()>>,
    sharing: Option<Sharing>,
    views: Views,
}

impl Link {
    /// Declares what host `me` says and hears in its session. `streams` are the scans that come here.
    /// `areas` are those that this host shares with another one. What comes is put into `inbox`.
    ///
    /// # Errors
    /// If zenoh refuses a key.
    pub fn open(
        site: &Site,
        me: &Host,
        streams: Vec<Stream>,
        areas: &[String],
        inbox: &Arc<Inbox<Asker>>,
        session: Session,
    ) -> Result<Self, String> {
        let others = site.hosts.iter().enumerate().filter(|(_, host)| host.id != me.id);
        for (index, host) in others {
            let key = topic::health_key(&site.name, &host.id);
            receive(&session, key, topic::BYTES_MAX, inbox, move |i, b| i.health(index, b))?;
            if me.desk {
                let key = topic::live_key(&site.name, &host.id);
                receive(&session, key, MESSAGE_BYTES_MAX, inbox, move |i, b| i.page(index, b))?;
            }
        }
        let refuser = Refuser::start().map_err(|error| error.to_string())?;
        answer(&session, topic::log_key(&site.name, &me.id), inbox, &refuser)?;
        let publisher = |key, priority| publisher(&session, key, priority, true);
        let sharing = (!areas.is_empty())
            .then(|| Sharing::declare(&session, site, me, areas, inbox, &refuser));
        let mut link = Self {
            streams,
            listening: BTreeMap::new(),
            sharing: sharing.transpose()?,
            views: Views::declare(&session, site, me, inbox)?,
            site: site.name.clone(),
            host: me.id.clone(),
            health: publisher(topic::health_key(&site.name, &me.id), Priority::DataLow)?,
            live: publisher(topic::live_key(&site.name, &me.id), Priority::InteractiveHigh)?,
            session,
        };
        let always: Vec<usize> =
            (0..link.streams.len()).filter(|&stream| !link.streams[stream].shared).collect();
        always.into_iter().for_each(|stream| link.listen(stream, true, inbox));
        Ok(link)
    }

    /// Sends encoded health, if there is room.
    pub fn send_health(&self, bytes: Vec<u8>) {
        let _ = self.health.put(bytes).wait(); // the next one is due in a second
    }

    /// Sends an encoded page of events to all desks, if there is room.
    pub fn send_live(&self, bytes: Vec<u8>) {
        let _ = self.live.put(bytes).wait(); // who misses it asks for it
    }

    /// Asks the journal of a host for everything after a row; the answer comes as a page.
    pub fn ask(&self, host: &str, index: usize, after: u64, inbox: &Arc<Inbox<Asker>>) {
        let inbox = Arc::clone(inbox);
        let selector = format!("{}?after={after}", topic::log_key(&self.site, host));
        let asked = self
            .session
            .get(selector)
            .timeout(QUERY_TIMEOUT)
            .congestion_control(CongestionControl::Drop)
            .priority(Priority::InteractiveHigh)
            .callback(move |reply| {
                if let Ok(sample) = reply.result() {
                    take(sample, MESSAGE_BYTES_MAX, &inbox, |inbox, bytes| {
                        inbox.page(index, bytes);
                    });
                }
            })
            .wait();
        if let Err(error) = asked {
            tracing::debug!("cannot ask host {host}: {error}"); // it is asked again
        }
    }

    /// Answers who asked.
    pub fn answer(&self, asker: &Asker, bytes: Vec<u8>) {
        if let Err(error) = asker.0.reply(asker.0.key_expr().clone(), bytes).wait() {
            tracing::debug!("cannot answer a desk: {error}"); // it asks again
        }
    }

    /// Leaves without a word: closing over a cut link takes ten seconds, and the others notice the
    /// end of the connection at once.
    pub fn leave(self) {
        std::mem::forget(self);
    }
}

/// Makes zenoh read the network on the thread that writes to it.
///
/// zenoh 1.10.2 reads and writes a TLS connection on two threads at once, which rustls does not bear: a
/// link that is busy both ways ends in a SIGSEGV (`zenoh-link-tls/src/unicast.rs`, its issue 2557). On one
/// thread they take turns. The price: what is done in a callback of zenoh must not wait for room to
/// write, for nobody makes it; ours do not, see [`refused`]. Connections that we dialled, which belong to
/// `net`, are waited for on that thread as well: one wake less on the way of a scan. Those that came in
/// are not: strangers would shake hands on the thread of the scans.
///
/// Call it while the process has one thread, and before the first use of zenoh, which reads this once.
pub(crate) fn read_and_write_on_one_thread() {
    // SAFETY: the environment is changed while nobody else can read it: the caller has one thread.
    unsafe {
        std::env::set_var(
            "ZENOH_RUNTIME",
            "(rx: (handover: tx), net: (handover: tx), tx: (worker_threads: 1))",
        )
    };
}

/// Opens the session of host `me`: listens, and dials those before it in the background, for ever. A
/// client dials, and waits until somebody answers. `files` are read where the hosts use TLS.
///
/// # Errors
/// If the endpoint cannot be listened on; of a client, if nobody answers.
pub fn open(site: &Site, me: &Host, files: &Files) -> Result<Session, String> {
    let failed = |error: zenoh::Error| {
        let (id, endpoint) = (&me.id, &me.endpoint);
        let error = without_places(&error.to_string());
        if me.through.is_empty() {
            format!("host {id} cannot listen on {endpoint}: {error}, or this is not host {id}")
        } else {
            format!("none of the hosts {} answers: {error}", me.through.join(", "))
        }
    };
    let config = zenoh::Config::from_json5(&config(site, me, files).to_string()).map_err(failed)?;
    zenoh::open(config).wait().map_err(failed)
}

/// An error of zenoh without the places in its sources (` at /path/of/a/machine.rs:12`).
fn without_places(error: &str) -> String {
    let words = error.split(' ').collect::<Vec<_>>();
    let is_place = |word: &str| word.starts_with('/') && word.contains(".rs:");
    let stays = |at: &usize| {
        let next_is_place = words.get(at + 1).is_some_and(|next| is_place(next));
        let leads_to_one = words[*at] == "at" && next_is_place;
        !is_place(words[*at]) && !leads_to_one
    };
    let kept: Vec<&str> = (0..words.len()).filter(stays).map(|at| words[at]).collect();
    kept.join(" ").trim_end_matches(['.', ' ']).to_owned()
}

/// The hosts that may run an area that this one may run as well.
fn partners(site: &Site, me: &Host) -> Vec<usize> {
    let shares = |other: &Host| {
        let both = |area: &Area| {
            area.standby.is_some() && [me, other].iter().all(|h| area.may_run_on(Some(&h.id)))
        };
        other.id != me.id && site.areas.iter().any(both)
    };
    (0..site.hosts.len()).filter(|&index| shares(&site.hosts[index])).collect()
}

/// Says something under a key; what finds no room is dropped. Express: not held back for others.
fn publisher(
    session: &Session,
    key: String,
    priority: Priority,
    is_express: bool,
) -> Result<Publisher<'static>, String> {
    session
        .declare_publisher(key)
        .congestion_control(CongestionControl::Drop)
        .priority(priority)
        .express(is_express)
        .allowed_destination(Locality::Remote) // nobody in this session listens to it
        .wait()
        .map_err(|error| error.to_string())
}

/// Receives what comes on a key; what is too long is counted and left.
fn receive(
    session: &Session,
    key: String,
    bytes_max: usize,
    inbox: &Arc<Inbox<Asker>>,
    put: impl Fn(&Inbox<Asker>, Vec<u8>) + Send + Sync + 'static,
) -> Result<(), String> {
    let inbox = Arc::clone(inbox);
    session
        .declare_subscriber(key)
        .callback(move |sample| take(&sample, bytes_max, &inbox, &put))
        .background()
        .wait()
        .map_err(|error| error.to_string())
}

fn take(
    sample: &Sample,
    bytes_max: usize,
    inbox: &Inbox<Asker>,
    put: impl Fn(&Inbox<Asker>, Vec<u8>),
) {
    if let Some(bytes) = fitting(sample, bytes_max, inbox) {
        put(inbox, bytes.into_owned());
    }
}

/// What came, unless it is too long: that is counted.
fn fitting<'s>(
    sample: &'s Sample,
    bytes_max: usize,
    inbox: &Inbox<Asker>,
) -> Option<Cow<'s, [u8]>> {
    if sample.payload().len() > bytes_max {
        inbox.too_long();
        return None;
    }
    Some(sample.payload().to_bytes())
}

/// Lets others ask the journal of this host.
fn answer(
    session: &Session,
    key: String,
    inbox: &Arc<Inbox<Asker>>,
    refuser: &Refuser,
) -> Result<(), String> {
    let (inbox, refuser) = (Arc::clone(inbox), refuser.clone());
    session
        .declare_queryable(key)
        .callback(move |query| {
            let after = query.parameters().get("after").and_then(|text| text.parse().ok());
            match after {
                Some(after) => {
                    if let Some(refused) = inbox.ask(Ask { after, query: Asker(query) }) {
                        refuser.end(refused.query);
                    }
                }
                None => {
                    inbox.not_understood();
                    refuser.end(Asker(query));
                }
            }
        })
        .background()
        .wait()
        .map_err(|error| error.to_string())
}

/// Bytes that wait in the kernel, each way: what is there nothing more urgent can overtake.
const SOCKET_BYTES: usize = 256 * 1024;

/// Whoever connects and shows no certificate by then is thrown out: each holds a descriptor until then.
const HANDSHAKE_MS: u64 = 3000;

fn locator(host: &Host) -> String {
    let (protocol, more) = match host.transport {
        Transport::PlainTcp => ("tcp", String::new()),
        Transport::Tls => ("tls", format!(";tls_handshake_timeout_ms={HANDSHAKE_MS}")),
    };
    let endpoint = &host.endpoint;
    format!("{protocol}/{endpoint}#so_sndbuf={SOCKET_BYTES};so_rcvbuf={SOCKET_BYTES}{more}")
}

/// Both sides show their certificates, and hold the other's against the address that was dialled.
fn tls(files: &Files) -> serde_json::Value {
    json!({
        "root_ca_certificate": files.ca,
        "listen_certificate": files.certificate, "listen_private_key": files.key,
        "connect_certificate": files.certificate, "connect_private_key": files.key,
        "enable_mtls": true, "verify_name_on_connect": true, "close_link_on_expiration": true,
    })
}

/// The configuration of a session: all that differs from what zenoh does by itself.
fn config(site: &Site, me: &Host, files: &Files) -> serde_json::Value {
    let mut config = plain_config(site, me);
    if site.uses_tls() {
        config["transport"]["link"]["protocols"] = json!(["tls"]);
        config["transport"]["link"]["tls"] = tls(files);
        config["access_control"] = access::control(site, me);
    }
    config
}

fn plain_config(site: &Site, me: &Host) -> serde_json::Value {
    let is_client = !me.through.is_empty();
    let before = site.hosts.iter().take_while(|host| host.id != me.id);
    let dialled: Vec<String> = if is_client {
        me.through.iter().filter_map(|id| site.host(id)).map(locator).collect()
    } else {
        before.filter(|host| host.through.is_empty()).map(locator).collect()
    };
    json!({
        "mode": if is_client { "client" } else { "peer" },
        "metadata": { "host": me.id, "site": site.name },
        "listen": { "endpoints": if is_client { Vec::new() } else { vec![locator(me)] } },
        "connect": {
            "endpoints": dialled,
            "retry": {
                "period_init_ms": 500, "period_max_ms": 1000, "period_increase_factor": 1.5
            },
        },
        "scouting": { "multicast": { "enabled": false }, "gossip": { "enabled": false } },
        "open": { "return_conditions": { "connect_scouted": false, "declares": true } },
        "timestamping": { "enabled": false },
        "queries_default_timeout": QUERY_TIMEOUT.as_millis() as u64,
        "adminspace": { "enabled": false },
        "transport": {
            "unicast": {
                "open_timeout": 2000, "accept_timeout": 2000,
                "max_sessions": 2 * protocol::site::HOSTS_MAX,
            },
            "link": {
                "protocols": ["tcp"],
                "tx": {
                    "lease": LEASE_MS, "keep_alive": 4,
                    "queue": {
                        "congestion_control": { "block": { "wait_before_close": 2_000_000 } }
                    },
                },
                "rx": { "max_message_size": 1 << 20 },
            },
        },
    })
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn a_bridge_dials_those_before_it_and_looks_for_nobody() {
        let host = |id: &str, port: u16| Host {
            id: id.to_owned(),
            endpoint: format!("127.0.0.1:{port}"),
            transport: Transport::PlainTcp,
            desk: false,
            cores: 2,
            network_mbit_s: 1000,
            follows: Vec::new(),
            through: Vec::new(),
            certificate_number: 1,
        };
        let mut site: Site = serde_json::from_value(json!({
            "name": "s",
            "area": [{ "id": "a", "origin_m": [0.0, 0.0], "columns": 1, "rows": 1 }],
            "laser": [],
        }))
        .unwrap();
        site.hosts = vec![host("a", 1), host("b", 2), host("c", 3)];
        let files = Files::of("/etc/tog/tls".as_ref(), "b");
        assert_eq!(config(&site, &site.hosts[0], &files)["connect"]["endpoints"], json!([]));
        let json = config(&site, &site.hosts[2], &files);
        let dialled = json["connect"]["endpoints"].as_array().unwrap();
        let begins =
            |value: &serde_json::Value, with: &str| value.as_str().unwrap().starts_with(with);
        assert_eq!(dialled.len(), 2);
        assert!(begins(&dialled[0], "tcp/127.0.0.1:1#") && begins(&dialled[1], "tcp/127.0.0.1:2#"));
        assert!(begins(&json["listen"]["endpoints"][0], "tcp/127.0.0.1:3#"));
        // zenoh reads it, and each of our settings is one that it knows.
        let read = zenoh::Config::from_json5(&json.to_string()).unwrap();
        for (key, expected) in [
            ("scouting/multicast/enabled", "false"),
            ("scouting/gossip/enabled", "false"),
            ("transport/link/tx/lease", "2000"),
            ("transport/link/rx/max_message_size", "1048576"),
            ("transport/unicast/max_sessions", "64"),
        ] {
            assert_eq!(read.get_json(key).unwrap(), expected, "{key}");
        }
        assert_eq!(read.get_json("access_control/enabled").unwrap(), "false");

        // A desk that goes through others dials them, and is dialled by nobody.
        let mut behind = site.clone();
        behind.hosts[1].through = vec!["c".to_owned(), "a".to_owned()];
        let [a, b, c] = [0, 1, 2].map(|n| config(&behind, &behind.hosts[n], &files));
        assert_eq!([&a["mode"], &b["mode"], &c["mode"]], ["peer", "client", "peer"]);
        assert_eq!(b["listen"]["endpoints"], json!([]));
        let dialled = |config: &serde_json::Value| config["connect"]["endpoints"].clone();
        assert_eq!(dialled(&c), json!([locator(&site.hosts[0])]));
        assert_eq!(dialled(&b), json!([locator(&site.hosts[2]), locator(&site.hosts[0])]));
        zenoh::Config::from_json5(&b.to_string()).unwrap();

        site.hosts.iter_mut().for_each(|host| host.transport = Transport::Tls);
        let json = config(&site, &site.hosts[1], &files);
        assert!(begins(&json["connect"]["endpoints"][0], "tls/127.0.0.1:1#"));
        let read = zenoh::Config::from_json5(&json.to_string()).unwrap();
        for (key, expected) in [
            ("transport/link/protocols", "[\"tls\"]"),
            ("transport/link/tls/enable_mtls", "true"),
            ("transport/link/tls/verify_name_on_connect", "true"),
            ("transport/link/tls/listen_private_key", "\"/etc/tog/tls/b.key\""),
            ("access_control/enabled", "true"),
            ("access_control/default_permission", "\"deny\""),
        ] {
            assert_eq!(read.get_json(key).unwrap(), expected, "{key}");
        }
    }
}
