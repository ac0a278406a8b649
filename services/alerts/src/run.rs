//! The service `tog alerts`: takes changes from the shared memory, hands them to the keeper, and
//! tells whoever listens. Its loop is the whole of what it does.

use crate::absence::{self, Absences, Tiding};
use crate::feed::FeedSocket;
use crate::journal::{JOURNAL_FILE, JournalError};
use crate::keeper::{Keeper, Now, Report};
use crate::words;
use jiff::tz::TimeZone;
use process::{Failure, Latencies, Publisher, Role, Subscriber, Worker, monotonic_ns, wall_ns};
use protocol::codec;
use protocol::event::{EventAcknowledgement, EventChange, EventHeader, journal_origin};
use protocol::health::{Health, ServiceState};
use protocol::time::MILLISECOND_NS;
use protocol::topic;
use protocol::wire::BytesHeader;
use std::collections::BTreeMap;

/// Changes taken from shared memory and journaled in one transaction: what its buffer holds.
const BATCH_MAX: usize = 256;
/// The place of the journal is looked at this often.
const LOOK_NS: u64 = process::health::PERIOD_NS / 2;
/// Origin of the faults of the host.
const HOST: &str = "host";
/// Codes of the faults that the keeper may have.
const FAULT_CODES: [&str; 2] = ["journal_unwritable", "sequence_reused"];

/// Runs the service until it is asked to stop.
///
/// # Errors
/// [`Failure::Config`] if the site's time zone is unknown, or if a file in the place of the journal
/// is none of this tog; others if the system or shared memory fails. A disk that cannot be written
/// is no error: see [`crate::keeper`].
pub fn run(worker: &mut Worker) -> Result<(), Failure> {
    let zone = words::time_zone(&worker.site.timezone).map_err(config)?;
    let path = worker.instance.state_dir.join(JOURNAL_FILE);
    let origin = journal_origin(worker.instance.host.as_deref());
    let (keeper, report) = Keeper::open_as(&origin, &path, now()).map_err(config)?;
    let mut service = Service {
        zone,
        feed: FeedSocket::bind(&worker.instance.run_dir, &worker.events).map_err(failed)?,
        changes: worker.bus.subscriber(&topic::event())?,
        health: is_desk(worker).then(|| worker.bus.subscriber(&topic::health())).transpose()?,
        absences: Absences::new(keeper.missed_hosts()),
        keeper,
        latencies: Latencies::default(),
        acknowledgements: worker.bus.publisher(&topic::event_acknowledgement(), 0)?,
        garbage: 0,
        looked_mono_ns: monotonic_ns(),
    };
    // To all, also to those of whom nothing is known: what was sent while no service ran is lost,
    // and the acknowledgement of a new session asks for it.
    service.acknowledge(Vec::new(), worker);
    service.handle(report, worker);
    worker.health.set_state(ServiceState::Running);
    loop {
        while service.take_batch(worker)? {}
        service.look_for_hosts(worker)?;
        service.serve(worker);
        let deadlines = [service.keeper.deadline_ns(), service.feed.deadline_ns()];
        if worker.wait(deadlines.into_iter().flatten().min())?.stop {
            // What was published before the stop belongs into the journal.
            while service.take_batch(worker)? {}
            service.serve(worker);
            return Ok(());
        }
    }
}

struct Service {
    zone: TimeZone,
    keeper: Keeper,
    feed: FeedSocket,
    changes: Subscriber<EventHeader, u8>,
    /// At a desk of a site of several hosts.
    health: Option<Subscriber<BytesHeader, u8>>,
    absences: Absences,
    latencies: Latencies,
    acknowledgements: Publisher<BytesHeader, u8>,
    garbage: u64,
    /// When the place of the journal was looked at.
    looked_mono_ns: u64,
}

impl Service {
    /// Takes what waits in shared memory; true if there was anything.
    fn take_batch(&mut self, worker: &mut Worker) -> Result<bool, Failure> {
        let mut batch = Vec::new();
        let mut taken = 0;
        while taken < BATCH_MAX
            && let Some(sample) = self.changes.receive()?
        {
            taken += 1;
            if sample.is_end_of_stream() {
                continue;
            }
            match codec::decode::<EventChange>(sample.payload()) {
                Ok(change) => {
                    let completed_by_mono_ns = sample.header().completed_by_mono_ns;
                    self.latencies.observe(completed_by_mono_ns, monotonic_ns());
                    batch.push(change);
                }
                Err(error) => {
                    self.garbage += 1;
                    // The first, and then ever more rarely: a mad publisher does not fill the log.
                    if self.garbage.is_power_of_two() {
                        let count = self.garbage;
                        tracing::warn!("refused {count} messages that are no events; now: {error}");
                    }
                }
            }
        }
        if !batch.is_empty() {
            let report = self.keeper.offer(batch, now());
            self.handle(report, worker);
            for (name, share) in [("event_latency_p50_ms", 0.5), ("event_latency_p99_ms", 0.99)] {
                if let Some(latency_ns) = self.latencies.percentile_ns(share) {
                    worker.health.gauge(name, latency_ns as f64 / MILLISECOND_NS as f64);
                }
            }
        }
        Ok(taken > 0)
    }

    /// Hosts that are missed are events, at a desk: nobody is there who could tell them.
    fn look_for_hosts(&mut self, worker: &mut Worker) -> Result<(), Failure> {
        let Some(health) = &mut self.health else { return Ok(()) };
        let mut tidings = Vec::new();
        while let Some(sample) = health.receive()? {
            let Ok(health) = codec::decode::<Health>(sample.payload()) else { continue };
            if health.service == Role::Bridge.service() {
                tidings.extend(self.absences.observe(&health, monotonic_ns()));
            }
        }
        for Tiding { host, missed } in tidings {
            let missed = missed.map(|text| {
                let open = self.keeper.open_of(&absence::origins(&worker.site, &host));
                absence::words(text, &worker.site, &host, &open)
            });
            let report = self.keeper.absence(&host, missed, now());
            self.handle(report, worker);
        }
        Ok(())
    }

    /// Deadlines, the sockets, and how we are.
    fn serve(&mut self, worker: &mut Worker) {
        let mono_ns = monotonic_ns();
        // No deadline of its own: the beat of the health wakes us once a second.
        if mono_ns >= self.looked_mono_ns + LOOK_NS {
            self.looked_mono_ns = mono_ns;
            let report = self.keeper.look(now());
            self.handle(report, worker);
        }
        if self.keeper.deadline_ns().is_some_and(|deadline_ns| deadline_ns <= mono_ns) {
            let report = self.keeper.tick(now());
            self.handle(report, worker);
        }
        while let Some(token) = worker.events.next_ready() {
            self.feed.ready(token, mono_ns);
        }
        match self.feed.pump(&self.keeper, mono_ns) {
            Ok(()) => worker.health.clear("journal_unreadable"),
            Err(JournalError::Damaged { detail, .. }) => {
                let report = self.keeper.read_damage(detail, now());
                self.handle(report, worker);
            }
            // Clients keep their cursors and get the rows when they can be read.
            Err(error) => worker.health.fault("journal_unreadable", error.to_string()),
        }
        self.acknowledgements.serve_late_readers();
        self.tell_health(worker);
    }

    fn handle(&mut self, report: Report, worker: &mut Worker) {
        for warning in &report.warnings {
            tracing::warn!("{warning}");
        }
        for (change, journaled) in &report.told {
            let sentence = words::sentence(change, &self.zone);
            if *journaled {
                tracing::info!("{sentence}");
            } else {
                tracing::info!("{sentence} (not on disk yet)");
            }
        }
        if !report.acknowledgements.is_empty() {
            self.acknowledge(report.acknowledgements, worker);
        }
        let faults = self.keeper.faults();
        for code in FAULT_CODES {
            let fault = faults.iter().find(|fault| fault.code == code);
            worker.health.set_fault(code, fault.map(|fault| fault.text.clone()));
        }
    }

    /// Publishes what origins may forget: those of the site and the `wanted` ones. The topic keeps
    /// as many messages for late readers as the site has origins, so all of them are said each
    /// time: a restarted origin finds its own.
    fn acknowledge(&mut self, wanted: Vec<EventAcknowledgement>, worker: &Worker) {
        let hosts = worker.site.hosts.iter().map(|host| Some(host.id.as_str()));
        let journals: Vec<String> = hosts.map(journal_origin).collect();
        let areas = worker.site.areas.iter().map(|area| area.id.as_str());
        let standbys = worker.site.areas.iter().filter_map(|area| {
            area.standby.as_deref().map(|standby| area.origin_on(Some(standby)))
        });
        let others: Vec<String> = journals.into_iter().chain(standbys).collect();
        let of_site: Vec<&str> =
            areas.chain([HOST]).chain(others.iter().map(String::as_str)).collect();
        let others: BTreeMap<String, u64> = wanted
            .into_iter()
            .filter(|wanted| !of_site.contains(&wanted.origin.as_str()))
            .map(|wanted| (wanted.origin, wanted.sequence))
            .collect();
        let others =
            others.into_iter().map(|(origin, sequence)| EventAcknowledgement { origin, sequence });
        let of_site = of_site.iter().filter_map(|origin| self.keeper.acknowledgement(origin));
        for acknowledgement in others.chain(of_site) {
            let sent = codec::encode(&acknowledgement).map_err(|error| error.to_string()).and_then(
                |bytes| {
                    let sent = self.acknowledgements.send(BytesHeader::default(), &bytes);
                    sent.map_err(|error| error.to_string())
                },
            );
            if let Err(error) = sent {
                tracing::warn!("cannot acknowledge to {}: {error}", acknowledgement.origin);
            }
        }
    }

    fn tell_health(&self, worker: &mut Worker) {
        let counters = self.keeper.counters();
        let losses = self.changes.losses();
        let health = &mut worker.health;
        for (name, total) in [
            ("changes_in", counters.changes_in),
            ("changes_journaled", counters.changes_journaled),
            ("changes_duplicate", counters.changes_duplicate),
            ("changes_conflicting", counters.changes_conflicting),
            ("changes_given_up", counters.changes_given_up),
            ("changes_refused", counters.changes_refused),
            ("changes_garbage", self.garbage),
            ("changes_lost", losses.lost),
            ("journal_writes_failed", counters.writes_failed),
            ("clients_stalled", self.feed.feed().stalled()),
        ] {
            health.set_count(name, total);
        }
        health.gauge("backlog_changes", self.keeper.backlog_len() as f64);
        health.gauge("feed_clients", self.feed.feed().len() as f64);
    }
}

/// True where people look at the alerts of several hosts.
fn is_desk(worker: &Worker) -> bool {
    let me = worker.instance.host.as_deref().and_then(|id| worker.site.host(id));
    worker.site.has_bridges() && me.is_some_and(|host| host.desk)
}

fn now() -> Now {
    Now { unix_ns: wall_ns(), mono_ns: monotonic_ns() }
}

fn config(error: impl std::fmt::Display) -> Failure {
    Failure::Config(error.to_string())
}

fn failed(error: impl std::fmt::Display) -> Failure {
    Failure::Failed(error.to_string())
}
