//! The process `tog bridge`. Its loop is the whole of what it does: what is here goes out, what came
//! goes in, what is due is done, then it sleeps.

mod areas;
mod health;
mod maps;
mod scans;
mod session;

use areas::Areas;
use maps::Maps;
use scans::Arrivals;

use crate::agreement::fingerprint;
use crate::cursor::{Kept, Shelf};
use crate::follower::{Follower, Origins};
use crate::guard::Alarm;
use crate::inbox::{Arrived, Inbox};
use crate::link::{Asker, Link, Stream};
use crate::remote::RemoteHost;
use crate::scans::Outgoing;
use crate::teller::{Tell, Teller};
use certificates::Certificate;
use process::{
    Failure, Interest, Publisher, Role, Subscriber, Token, Worker, monotonic_ns, wall_ns,
};
use protocol::codec::{Encoded, decode, encode};
use protocol::event::{EventAcknowledgement, EventChange, EventHeader, journal_origin};
use protocol::health::{Health, ServiceState};
use protocol::link::{EventPage, HostHealth};
use protocol::site::{Host, Site};
use protocol::time::SECOND_NS;
use protocol::topic;
use protocol::wire::BytesHeader;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Runs the bridge until it is asked to stop.
///
/// # Errors
/// If the endpoint cannot be listened on, or shared memory or the state directory cannot be used.
pub fn run(worker: &mut Worker) -> Result<(), Failure> {
    let Some(opened) = session::open(worker)? else { return Ok(()) };
    let mut bridge = Bridge::open(worker, opened)?;
    bridge.begin_areas();
    worker.health.set_state(ServiceState::Running);
    loop {
        bridge.failed_scans()?;
        bridge.open_wanted(worker)?;
        bridge.send_maps()?;
        bridge.send_health()?;
        bridge.take_acknowledgements(worker)?;
        bridge.take_arrived()?;
        bridge.serve(worker)?;
        bridge.tell_health(worker);
        let deadline_ns = bridge.deadline_ns();
        if worker.wait(Some(deadline_ns))?.stop {
            bridge.release_areas();
            bridge.close_scans();
            bridge.tell_the_last(worker)?;
            bridge.link.leave();
            return Ok(());
        }
    }
}

/// What was told last is on its way to the journal when a host stops: so long a bridge waits for it.
const LINGER_NS: u64 = SECOND_NS * 3 / 10;

/// What came under the key of somebody else.
#[derive(Default)]
struct Misrouted {
    count: u64,
    /// When the last one came, CLOCK_MONOTONIC, and what it was.
    last: Option<(u64, String)>,
}

impl Misrouted {
    fn note(&mut self, expected: &str, error: &str) {
        self.last = Some((monotonic_ns(), format!("{expected}: {error}")));
    }
}

/// The journal of another host, as this desk follows it.
struct Followed {
    follower: Follower,
    /// Index of the host.
    host: usize,
}

#[derive(Default)]
struct Counters {
    misrouted: Misrouted,
    health_refused: u64,
    pages_refused: u64,
    events_out: u64,
    events_in: u64,
}

struct Bridge {
    me: Host,
    hosts: Vec<Host>,
    link: Link,
    inbox: Arc<Inbox<Asker>>,
    bell: Token,
    outgoing: Vec<Arc<Outgoing>>,
    streams: Vec<Stream>,
    /// By the stream.
    scans_told: Vec<scans::Told>,
    health: Subscriber<BytesHeader, u8>,
    /// At a desk only, as the two below.
    events: Option<Publisher<EventHeader, u8>>,
    acknowledgements: Option<Subscriber<BytesHeader, u8>>,
    followed: Vec<Followed>,
    shelf: Shelf,
    teller: Teller<Asker>,
    /// By the index of the host; none for this one.
    remote: Vec<Option<RemoteHost>>,
    /// The areas that each host may run.
    areas_of: BTreeMap<String, Vec<String>>,
    looked_ns: u64,
    /// Where the hosts use TLS.
    certificate: Option<Certificate>,
    alarm: Alarm,
    areas: Areas,
    maps: Maps,
    counters: Counters,
    strange: [health::Strange; 2],
    /// Of the site file here.
    fingerprint: u32,
}

impl Bridge {
    fn open(worker: &mut Worker, opened: session::Opened) -> Result<Self, Failure> {
        let site = worker.site.clone();
        let session::Opened { me, session, certificate } = opened;
        let Arrivals { streams, of_areas } = Arrivals::open(worker, &site, &me)?;
        let shelf = Shelf::open(&worker.instance.state_dir)?;
        let Kept { value: epoch, damage } = shelf.epoch(wall_ns())?;
        let fault = damage.map(|damage| {
            format!(
                "{damage}; the desks read the journal of this host once more from its first row"
            )
        });
        worker.health.set_fault("journal_name_damaged", fault);
        let now_ns = monotonic_ns();
        let followed = if me.desk { follow(&site, &me, &shelf, now_ns) } else { Vec::new() };
        let events = if me.desk {
            let source = site.areas.len() as u32 + 1; // behind the areas and the supervisor
            Some(worker.bus.publisher(&topic::event(), source)?)
        } else {
            None
        };
        let acknowledgements = if me.desk {
            Some(worker.bus.subscriber(&topic::event_acknowledgement())?)
        } else {
            None
        };
        let inbox = Arc::new(Inbox::new()?);
        let bell = worker.events.watch(inbox.bell(), Interest::Read)?;
        let shared = areas::shared_areas(&site, &me);
        let link = Link::open(&site, &me, streams.clone(), &shared, &inbox, session)
            .map_err(Failure::Failed)?;
        let areas = Areas::open(worker, &me, &shelf, &of_areas)?;
        let maps = Maps::open(worker, &site, &me)?;
        let count = site.hosts.len() - 1;
        tracing::info!("host {} listens on {} and looks for {count} more", me.id, me.endpoint);
        Ok(Self {
            outgoing: scans::start(worker, &site, &me, &link)?,
            scans_told: vec![scans::Told::default(); streams.len()],
            streams,
            link,
            bell,
            health: worker.bus.subscriber(&topic::health())?,
            events,
            acknowledgements,
            followed,
            teller: Teller::new(&me.id, &worker.instance.run_dir, &worker.events, epoch),
            shelf,
            remote: site.hosts.iter().map(|host| remote(&site, host, &me, now_ns)).collect(),
            areas_of: site.hosts.iter().map(|host| areas_of(&site, host)).collect(),
            looked_ns: 0,
            fingerprint: fingerprint(&site),
            hosts: site.hosts,
            me,
            inbox,
            certificate,
            alarm: Alarm::default(),
            areas,
            maps,
            counters: Counters::default(),
            strange: health::Strange::both(),
        })
    }

    /// Health of everybody here, to all hosts.
    fn send_health(&mut self) -> Result<(), Failure> {
        while let Some(sample) = self.health.receive()? {
            // A service of this host that tells nonsense is no reason to tell it to others.
            let Ok(health) = decode::<Health>(sample.payload()) else { continue };
            let told = HostHealth { host: self.me.id.clone(), health };
            encoded(&told).into_iter().for_each(|bytes| self.link.send_health(bytes));
        }
        Ok(())
    }

    /// What the journal of this desk has moves the cursors on.
    fn take_acknowledgements(&mut self, worker: &mut Worker) -> Result<(), Failure> {
        let Some(acknowledgements) = &mut self.acknowledgements else { return Ok(()) };
        let before: Vec<_> = self.followed.iter().map(|f| f.follower.cursor()).collect();
        while let Some(sample) = acknowledgements.receive()? {
            let Ok(known) = decode::<EventAcknowledgement>(sample.payload()) else { continue };
            for followed in &mut self.followed {
                followed.follower.acknowledged(&known.origin, known.sequence);
            }
        }
        let (mut stored, mut trouble) = (false, None);
        for (followed, before) in self.followed.iter().zip(before) {
            let cursor = followed.follower.cursor();
            let host = &self.hosts[followed.host].id;
            if cursor == before {
                continue;
            }
            stored = true;
            if let Err(error) = self.shelf.store(host, cursor) {
                let path = self.shelf.path(host);
                trouble = Some(format!(
                    "{}: {error}: a restart would ask host {host} again for what is here already",
                    path.display()
                ));
            }
        }
        if stored {
            worker.health.set_fault("cursor_unwritable", trouble);
        }
        Ok(())
    }

    /// Something came under the key of somebody else. It is left out.
    fn misrouted(&mut self, expected: &str, found: &str) {
        let (misrouted, error) = (&mut self.counters.misrouted, format!("it is of {found:?}"));
        refuse(&mut misrouted.count, expected, &error);
        misrouted.note(expected, &error);
    }

    /// What came from other hosts.
    fn take_arrived(&mut self) -> Result<(), Failure> {
        let Arrived { health, pages, asks, alive, claims, files, file_asks, views } =
            self.inbox.take();
        self.take_areas(alive, claims);
        self.take_files(files, file_asks);
        let now_ns = monotonic_ns();
        self.take_maps(views)?;
        for (host, bytes) in health {
            let Some(remote) = self.remote.get_mut(host).and_then(Option::as_mut) else { continue };
            match decode::<HostHealth>(&bytes) {
                Ok(HostHealth { host, .. }) if host != remote.id() => {
                    let expected = remote.id().to_owned();
                    self.misrouted(&expected, &host);
                }
                Ok(HostHealth { health, .. }) => {
                    hear(remote, now_ns);
                    remote.clock.observe(health.stamp_ns, wall_ns(), now_ns);
                    remote.health(health, now_ns);
                }
                Err(error) => {
                    refuse(&mut self.counters.health_refused, remote.id(), &error);
                }
            }
        }
        for (host, bytes) in pages {
            let known = self.hosts.get(host).map_or("", |host| host.id.as_str());
            match decode::<EventPage>(&bytes) {
                Ok(page) if page.host != known => {
                    let known = known.to_owned();
                    self.misrouted(&known, &page.host);
                }
                Ok(page) => self.take_page(host, page, now_ns),
                Err(error) => refuse(&mut self.counters.pages_refused, known, &error),
            }
        }
        let mut out = Vec::new();
        for ask in asks {
            self.teller.ask(ask, now_ns, &mut out);
        }
        self.tell(out);
        Ok(())
    }

    fn take_page(&mut self, host: usize, page: EventPage, now_ns: u64) {
        if let Some(remote) = self.remote.get_mut(host).and_then(Option::as_mut) {
            hear(remote, now_ns);
        }
        let followed = self.followed.iter_mut().find(|followed| followed.host == host);
        let Some(followed) = followed else { return };
        let was_stopped = followed.follower.other().is_some();
        match followed.follower.page(page, now_ns) {
            Ok(changes) => self.hand_on(&changes),
            Err(other) if !was_stopped => {
                tracing::error!("events of host {}: {}", self.hosts[host].id, other.reason);
            }
            Err(_) => {}
        }
    }

    /// Hands changes of other hosts to the journal of this desk.
    fn hand_on(&mut self, changes: &[EventChange]) {
        let Some(events) = &mut self.events else { return };
        for change in changes {
            let sent = encode(change)
                .map_err(|error| error.to_string())
                .and_then(|b| events.send(EventHeader::default(), &b).map_err(|e| e.to_string()));
            match sent {
                Ok(_) => self.counters.events_in += 1,
                // It is not acknowledged, so it is handed on again.
                Err(error) => tracing::warn!("change {} is not handed on: {error}", change.id),
            }
        }
    }

    /// Descriptors and deadlines.
    fn serve(&mut self, worker: &Worker) -> Result<(), Failure> {
        let (now_ns, mut out) = (monotonic_ns(), Vec::new());
        while let Some(token) = worker.events.next_ready() {
            if token != self.bell {
                self.teller.ready(token, now_ns, &mut out);
            }
        }
        self.serve_areas();
        self.teller.tick(now_ns, &mut out);
        self.tell(out);
        let mut again = Vec::new();
        for followed in &mut self.followed {
            if let Some(after) = followed.follower.question(now_ns) {
                let host = &self.hosts[followed.host].id;
                self.link.ask(host, followed.host, after, &self.inbox);
            }
            again.extend(followed.follower.resend(now_ns));
        }
        self.hand_on(&again);
        self.take_arrived() // the bell may have rung since it was looked at
    }

    /// Events that the areas told when they stopped; who misses them here has them when the host is back.
    fn tell_the_last(&mut self, worker: &Worker) -> Result<(), Failure> {
        let until_ns = monotonic_ns() + LINGER_NS;
        while monotonic_ns() < until_ns {
            self.serve(worker)?;
            worker.events.wait(Some(self.deadline_ns().min(until_ns)))?;
        }
        Ok(())
    }

    fn tell(&mut self, out: Vec<Tell<Asker>>) {
        for tell in out {
            match tell {
                Tell::Live(page) => {
                    self.counters.events_out += page.rows.len() as u64;
                    encoded(&page).into_iter().for_each(|bytes| self.link.send_live(bytes));
                }
                Tell::Answer(asker, page) => {
                    let bytes = encoded(&page);
                    bytes.into_iter().for_each(|bytes| self.link.answer(&asker, bytes));
                }
            }
        }
    }

    fn deadline_ns(&self) -> u64 {
        let followers = self.followed.iter().filter_map(|f| f.follower.deadline_ns());
        let due = followers
            .chain(self.teller.deadline_ns())
            .chain(self.areas.deadline_ns())
            .chain([self.looked_ns + SECOND_NS]);
        due.min().unwrap_or(u64::MAX)
    }
}

/// The journals of all other hosts, from where the cursors are.
fn follow(site: &Site, me: &Host, shelf: &Shelf, now_ns: u64) -> Vec<Followed> {
    let others = site.hosts.iter().enumerate().filter(|(_, host)| host.id != me.id);
    let follow = |(index, host): (usize, &Host)| {
        let cursor = shelf.cursor(&host.id).unwrap_or_else(|error| {
            tracing::warn!("{error}; the journal of host {} is read from its first row", host.id);
            None
        });
        let origins_on = |host: &Host| {
            let areas = site.areas_on(Some(&host.id)).map(|area| area.origin_on(Some(&host.id)));
            areas.chain([journal_origin(Some(&host.id))]).collect::<Vec<_>>()
        };
        let elsewhere = site.hosts.iter().filter(|other| other.id != host.id);
        let origins = Origins {
            own: origins_on(host).into_iter().collect(),
            elsewhere: elsewhere.flat_map(origins_on).collect(),
        };
        let follower = Follower::new(cursor.unwrap_or_default(), origins, now_ns);
        Followed { follower, host: index }
    };
    others.map(follow).collect()
}

/// Something came from there; what is heard anew stands in the log once.
fn hear(remote: &mut RemoteHost, now_ns: u64) {
    if remote.heard(now_ns) {
        tracing::info!("host {} is heard", remote.id());
    }
}

fn areas_of(site: &Site, host: &Host) -> (String, Vec<String>) {
    (host.id.clone(), site.areas_on(Some(&host.id)).map(|area| area.id.clone()).collect())
}

fn remote(site: &Site, host: &Host, me: &Host, now_ns: u64) -> Option<RemoteHost> {
    let names = Role::all(site, Some(&host.id)).iter().map(Role::to_string).collect();
    (host.id != me.id).then(|| RemoteHost::new(&host.id, names, now_ns))
}

/// Counts what was refused; says the first, and then ever more rarely.
fn refuse(count: &mut u64, who: &str, error: &dyn std::fmt::Display) {
    say_refused(*count, *count + 1, who, error);
    *count += 1;
}

/// The same of several that were refused since the last time: `before` and `count` are all of them.
fn say_refused(before: u64, count: u64, who: &str, error: &dyn std::fmt::Display) {
    if count.checked_ilog2() > before.checked_ilog2() {
        tracing::warn!("refused {count} messages; now of {who}: {error}");
    }
}

fn encoded<M: Encoded>(message: &M) -> Option<Vec<u8>> {
    encode(message).map_err(|error| tracing::warn!("is not sent: {error}")).ok()
}
