//! The process of an area: class maps from shared memory, files, events to the journal.
//!
//! Order of a change: core -> outbox file -> event topic -> outbox synced; journal -> acknowledgement.
//! Written before it is told, so that a killed process neither forgets nor doubles it; synced after,
//! because a disk takes milliseconds and the journal, which syncs before it tells anybody, is what a dead
//! machine is asked. If the disk fails a change is told all the same, and health says so.

use crate::store::{OutboxFile, SAVE_PERIOD_NS, load_normal, save_normal};
use crate::watch::{ClassFrame, Phase, Watch};
use process::{Failure, Latencies, Publisher, Sample, Subscriber, Worker, monotonic_ns, wall_ns};
use protocol::codec::{decode, encode};
use protocol::event::{EventAcknowledgement, EventChange, EventHeader};
use protocol::grid::{ClassMapHeader, CollapsedMapHeader};
use protocol::health::ServiceState;
use protocol::site::Area;
use protocol::time::SECOND_NS;
use protocol::topic;
use protocol::wire::{BytesHeader, Header};
use std::path::PathBuf;

/// What is not acknowledged after this long is sent again.
const RESEND_NS: u64 = 5 * SECOND_NS;
/// Most changes sent again at once: half of what the journal's queue holds.
const RESEND_MAX: usize = 128;
/// No class map for this long is lost coverage.
const SILENCE_NS: u64 = 5 * SECOND_NS;
/// The processes of a site start one after the other.
const START_SILENCE_NS: u64 = 30 * SECOND_NS;

/// The anomaly service of an area (`tog anomaly`), until it is told to stop.
///
/// # Errors
/// If shared memory, or the state directory at the start, cannot be used.
pub fn run(worker: &mut Worker) -> Result<(), Failure> {
    let mut service = Service::open(worker)?;
    loop {
        service.take_all(worker)?;
        let deadline = service.deadline_mono_ns(worker);
        let wake = worker.wait(Some(deadline))?;
        service.on_time(worker);
        if wake.stop {
            service.withdraw(worker);
            service.save(worker);
            return Ok(());
        }
    }
}

struct Service {
    area: Area,
    /// In whose name it tells events on this host.
    origin: String,
    state_dir: PathBuf,
    watch: Watch,
    outbox: OutboxFile,
    classes: Subscriber<ClassMapHeader, u8>,
    collapsed: Subscriber<CollapsedMapHeader, u64>,
    acknowledgements: Subscriber<BytesHeader, u8>,
    events: Publisher<EventHeader, u8>,
    changes: Vec<EventChange>,
    latencies: Latencies,
    percentiles_mono_ns: u64,
    session: Option<u64>,
    phase: Phase,
    ended: bool,
    dirty: bool,
    saved_mono_ns: u64,
    sent_mono_ns: u64,
    fed_mono_ns: u64,
    silence_ns: u64,
}

impl Service {
    fn open(worker: &mut Worker) -> Result<Self, Failure> {
        let Some((index, area)) = worker.area() else {
            return Err(Failure::Config(format!("`{}` has no area", worker.role)));
        };
        let area = area.clone();
        let state_dir = worker.instance.state_dir.clone();
        let fail = |error: std::io::Error| Failure::Failed(error.to_string());
        process::state_lock::create(&state_dir).map_err(fail)?;
        worker.health.set_fault("model_storage", process::state_lock::shortage(&state_dir));
        let mut watch = Watch::new(&area, &worker.site.lasers);
        let origin = area.origin_on(worker.instance.host.as_deref());
        watch.tell_as(&origin);
        let stamp_ns = wall_ns();
        if let Some(words) =
            load_normal(&state_dir, &area.id, &mut watch, stamp_ns).map_err(fail)?
        {
            worker.health.fault("model_damaged", words);
        }
        let (mut outbox, words) = OutboxFile::open(&state_dir, &origin, stamp_ns).map_err(fail)?;
        if worker.site.has_bridges() {
            outbox.begin_if_new(stamp_ns);
        }
        if let Some(words) = words {
            worker.health.fault("outbox_damaged", words);
        }
        let kept = outbox.outbox();
        watch.resume(kept.last_sequence(), kept.last_number(), &kept.open_events());
        let cells = area.grid().cells();
        let bus = &worker.bus;
        let now_ns = monotonic_ns();
        let mut service = Self {
            classes: bus.subscriber_with_credit(&topic::classes(&area.id, cells))?,
            collapsed: bus.subscriber(&topic::collapsed(
                &area.id,
                cells,
                area.class_names().len(),
            ))?,
            acknowledgements: bus.subscriber(&topic::event_acknowledgement())?,
            events: bus.publisher(&topic::event(), index)?,
            state_dir,
            phase: watch.phase(),
            watch,
            outbox,
            changes: Vec::new(),
            latencies: Latencies::default(),
            percentiles_mono_ns: now_ns,
            session: None,
            ended: false,
            dirty: false,
            saved_mono_ns: now_ns,
            sent_mono_ns: now_ns,
            fed_mono_ns: now_ns,
            silence_ns: START_SILENCE_NS,
            area,
            origin,
        };
        if service.phase != Phase::Watching {
            tracing::info!("area `{}`: {}", service.area.id, service.watch.phase_words());
        }
        service.say();
        service.resend();
        Ok(service)
    }

    /// Takes everything that is there.
    fn take_all(&mut self, worker: &mut Worker) -> Result<(), Failure> {
        while let Some(message) = self.acknowledgements.receive()? {
            self.acknowledged(worker, message.payload());
        }
        while let Some(map) = self.collapsed.receive()? {
            let header = map.header();
            let fits = (header.columns, header.rows) == (self.area.columns, self.area.rows);
            if fits && self.watch.seed(header.context as usize, map.payload()) {
                self.say();
            }
        }
        while let Some(map) = self.classes.receive()? {
            if map.is_end_of_stream() {
                self.save(worker);
                self.ended = true;
                worker.health.set_state(ServiceState::Ended);
            } else {
                self.take(worker, &map);
                worker.health.set_state(ServiceState::Running);
            }
            self.classes.finish(&map.receipt());
        }
        self.tell_health(worker);
        Ok(())
    }

    fn take(&mut self, worker: &mut Worker, map: &Sample<ClassMapHeader, u8>) {
        let header = map.header();
        let session = header.envelope().session;
        if self.session.replace(session).is_some_and(|before| before != session) {
            self.watch.feed_restarted();
        }
        self.ended = false;
        self.dirty = true;
        self.fed_mono_ns = monotonic_ns();
        self.silence_ns = SILENCE_NS;
        let frame = ClassFrame {
            number: header.number,
            lasers_present: header.lasers_present,
            context: header.context as usize,
            classes: map.payload(),
        };
        self.watch.handle(&frame, &mut self.changes);
        self.latencies.observe(header.completed_by_mono_ns, monotonic_ns());
        self.publish(worker, header.completed_by_mono_ns);
        if self.watch.phase() != self.phase {
            self.phase = self.watch.phase();
            self.save(worker);
        }
        self.say();
    }

    /// Writes down, tells, then syncs.
    fn publish(&mut self, worker: &mut Worker, completed_by_mono_ns: u64) {
        if self.changes.is_empty() {
            return;
        }
        let written = self.outbox.append(&self.changes);
        for change in &self.changes {
            tracing::debug!(id = change.id, state = ?change.state, "{}", change.text);
            send(&mut self.events, change, completed_by_mono_ns);
        }
        let stored = written.and(self.outbox.sync());
        worker.health.set_fault("outbox_storage", stored.err());
        worker.health.count("events_told", self.changes.len() as u64);
        self.sent_mono_ns = monotonic_ns();
        self.changes.clear();
    }

    fn acknowledged(&mut self, worker: &mut Worker, bytes: &[u8]) {
        let Ok(acknowledgement) = decode::<EventAcknowledgement>(bytes) else {
            worker.health.count("acknowledgements_refused", 1);
            return;
        };
        if acknowledgement.origin != self.origin {
            return;
        }
        match self.outbox.acknowledge(acknowledgement.sequence) {
            // The same again: the journal asks for what comes after.
            Ok(false) => self.resend(),
            Ok(true) => {
                // A journal that knows more than our file: go on behind it.
                let kept = self.outbox.outbox();
                self.watch.resume(kept.last_sequence(), kept.last_number(), &[]);
                worker.health.clear("outbox_storage");
            }
            Err(words) => worker.health.fault("outbox_storage", words),
        }
    }

    /// Sends again what is not acknowledged, oldest first.
    fn resend(&mut self) {
        for change in self.outbox.outbox().unacknowledged().take(RESEND_MAX) {
            send(&mut self.events, change, 0);
        }
        self.sent_mono_ns = monotonic_ns();
    }

    /// When something is to be done although nothing comes.
    fn deadline_mono_ns(&self, worker: &Worker) -> u64 {
        let mut deadline_ns = self.saved_mono_ns + SAVE_PERIOD_NS;
        if self.outbox.is_broken() || self.outbox.outbox().unacknowledged().next().is_some() {
            deadline_ns = deadline_ns.min(self.sent_mono_ns + RESEND_NS);
        }
        if self.expects_maps(worker) {
            deadline_ns = deadline_ns.min(self.fed_mono_ns + self.silence_ns);
        }
        deadline_ns
    }

    /// A site with a clock whose recording is not over delivers all the time.
    fn expects_maps(&self, worker: &Worker) -> bool {
        !self.ended && worker.instance.clock.now_ns().is_some()
    }

    fn on_time(&mut self, worker: &mut Worker) {
        let now_ns = monotonic_ns();
        if now_ns >= self.sent_mono_ns + RESEND_NS {
            if self.outbox.is_broken() {
                let mended = self.outbox.mend();
                worker.health.set_fault("outbox_storage", mended.err());
            }
            self.resend();
        }
        if now_ns >= self.saved_mono_ns + SAVE_PERIOD_NS {
            self.save(worker);
        }
        let silence_ns = now_ns.saturating_sub(self.fed_mono_ns);
        if self.expects_maps(worker) && silence_ns >= self.silence_ns {
            self.silence_ns = self.silence_ns.saturating_mul(2); // told once; looked at ever less often
            let stamp_ns = worker.instance.clock.now_ns().unwrap_or(self.watch.stamp_ns());
            self.watch.feed_silent(stamp_ns, silence_ns as f64 * 1e-9, &mut self.changes);
            self.publish(worker, 0);
        }
    }

    /// An area that another host may run goes on there, and what lasts is told from there: here nobody
    /// would see the end of what is open.
    fn withdraw(&mut self, worker: &mut Worker) {
        let Some(standby) = &self.area.standby else { return };
        let me = worker.instance.host.as_deref();
        let other = if me == Some(standby.as_str()) { &self.area.host } else { &self.area.standby };
        let text = format!(
            "This host stops to watch area {}; host {} tells what goes on there, if it runs.",
            self.area.id,
            other.as_deref().unwrap_or_default()
        );
        let stamp_ns = worker.instance.clock.now_ns().unwrap_or(self.watch.stamp_ns());
        self.changes.extend(self.outbox.outbox().withdrawals(stamp_ns, &text));
        self.publish(worker, 0);
    }

    fn save(&mut self, worker: &mut Worker) {
        self.saved_mono_ns = monotonic_ns();
        if !std::mem::take(&mut self.dirty) {
            return;
        }
        let saved = save_normal(&self.state_dir, &self.area.id, &mut self.watch);
        let words = saved.err().map(|error| {
            format!(
                "what area `{}` has learnt cannot be written to {}: {error}; a restart would learn \
                 again from the last copy",
                self.area.id,
                self.state_dir.display()
            )
        });
        worker.health.set_fault("model_storage", words);
    }

    fn say(&mut self) {
        for notice in self.watch.take_notices() {
            tracing::info!("area `{}`: {notice}", self.area.id);
        }
    }

    fn tell_health(&mut self, worker: &mut Worker) {
        let health = &mut worker.health;
        let counters = self.watch.counters();
        let losses = self.classes.losses();
        health.set_count("class_maps_in", counters.frames_in);
        health.set_count("class_maps_lost", losses.lost);
        health.set_count("frames_missed", counters.frames_missed);
        health.set_count("frames_stale", counters.frames_stale);
        health.set_count("frames_refused", counters.frames_refused);
        health.set_count("happenings_dropped", counters.happenings_dropped);
        health.set_count("events_given_up", self.outbox.outbox().given_up());
        // 0 learning, 1 calibrating, 2 watching.
        health.gauge("phase", f64::from(self.watch.phase() as u8));
        health.gauge("learnt_s", self.watch.learnt_s());
        health.gauge("learning_s", self.area.detector.learning_s);
        health.gauge("calibration_s", self.area.detector.calibration_s);
        // An open fault event is a fault of the site: nobody may read "all is well" beside it.
        health.set_fault("laser_silent", self.watch.silent_lasers());
        health.set_fault("coverage_lost", self.watch.lost_coverage());
        let now_ns = monotonic_ns();
        if now_ns >= self.percentiles_mono_ns + SECOND_NS {
            self.percentiles_mono_ns = now_ns; // they sort: once a second, not once a frame
            for (name, share) in [("frame_latency_p50_ms", 0.5), ("frame_latency_p99_ms", 0.99)] {
                if let Some(latency_ns) = self.latencies.percentile_ns(share) {
                    health.gauge(name, latency_ns as f64 * 1e-6);
                }
            }
        }
        health.gauge("calibrated_s", self.watch.calibrated_s());
        let waiting = self.outbox.outbox().unacknowledged().count();
        health.gauge("events_unacknowledged", waiting as f64);
    }
}

fn send(events: &mut Publisher<EventHeader, u8>, change: &EventChange, completed_by_mono_ns: u64) {
    let header = EventHeader { completed_by_mono_ns, ..EventHeader::default() };
    let sent = encode(change)
        .map_err(|error| error.to_string())
        .and_then(|bytes| events.send(header, &bytes).map_err(|error| error.to_string()));
    if let Err(error) = sent {
        // It is in the outbox: it will be sent again.
        tracing::warn!("change {} of {} is not sent: {error}", change.sequence, change.origin);
    }
}
