//! The process of one laser: source, clock, shared memory, health.
//!
//! `tog laser` is `process::run(role, run_dir, laser::shell::run)`. The process sends every scan when it
//! is due by the site's clock; in a lossless replay as soon as fusion has credit for it. Behind the last
//! scan it sends the end of the stream, says so in its health, and waits to be stopped.

use crate::pace::{RateMeter, Turn, turn};
use crate::site::open_source;
use crate::source::{Source, SourceCounts, SourceError};
use process::{Clock, Failure, Publisher, Worker, monotonic_ns};
use protocol::health::ServiceState;
use protocol::scan::{LaserScan, ScanHeader};
use protocol::topic;
use protocol::wire::{FLAG_END_OF_STREAM, Header};

/// Scans between two looks at the stop signal while there is always credit: a few milliseconds.
const BATCH: usize = 256;
/// A simulated scan is never due later than one period of the slowest rate, 10 s. If it is, the host's
/// clock was set back.
const WAIT_MAX_NS: u64 = 20 * protocol::time::SECOND_NS;
/// A fault that comes and goes is one fault: it is over after 10 s without it.
const QUIET_NS: u64 = 10 * protocol::time::SECOND_NS;

/// Runs the laser of `worker` until it is stopped.
///
/// # Errors
/// [`Failure::Config`] if its source cannot be used: no such recording, no scans of its topic, a stamp
/// that steps by more than a day, a scene that is not possible. [`Failure::Failed`] if the recording
/// cannot be read on.
pub fn run(worker: &mut Worker) -> Result<(), Failure> {
    let mut shell = Shell::open(worker)?;
    loop {
        let deadline_mono_ns = shell.send_what_is_due(worker)?;
        shell.tell(worker);
        if worker.wait(deadline_mono_ns)?.stop {
            return Ok(());
        }
    }
}

/// What comes next.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Next {
    /// Ask the source.
    Unknown,
    /// `Shell::scan` waits for its time.
    Scan,
    /// The end of the stream waits for credit.
    End,
    /// It was sent at this moment of CLOCK_MONOTONIC.
    EndSent(u64),
}

struct Shell {
    source: Source,
    scans: Publisher<ScanHeader, f32>,
    scan: LaserScan,
    next: Next,
    age_max_ns: u64,
    /// Scans that were too late to be sent.
    skipped: u64,
    out: u64,
    newest_stamp_ns: u64,
    /// Scans dropped for their geometry, and when the last was noticed (CLOCK_MONOTONIC).
    dropped_geometry: (u64, u64),
    rate: RateMeter,
}

impl Shell {
    fn open(worker: &Worker) -> Result<Self, Failure> {
        let nothing = || Failure::Config(format!("{} is no laser of the site", worker.role));
        let (index, laser) = worker.laser().ok_or_else(nothing)?;
        let (_, area) = worker.area().ok_or_else(nothing)?;
        let age_max_ns = area.scan_age_max_ns();
        let begin_ns = begin_ns(worker, age_max_ns);
        let source = open_source(laser, &worker.instance.base_dir, begin_ns)
            .map_err(|error| failure(&laser.id, &error))?;
        let scans = worker.bus.publisher(&topic::scan(&area.id), index)?;
        tracing::info!("{} begins", source.describe());
        Ok(Self {
            source,
            scans,
            scan: LaserScan::default(),
            next: Next::Unknown,
            age_max_ns,
            skipped: 0,
            out: 0,
            newest_stamp_ns: 0,
            dropped_geometry: (0, 0),
            rate: RateMeter::default(),
        })
    }

    /// Sends until nothing is due; then says when to come back, on CLOCK_MONOTONIC.
    fn send_what_is_due(&mut self, worker: &mut Worker) -> Result<Option<u64>, Failure> {
        let clock = worker.instance.clock;
        for _ in 0..BATCH {
            match self.next {
                Next::Unknown => self.next = self.ask(worker)?,
                Next::Scan => match turn(self.scan.stamp_ns, clock.now_ns(), self.age_max_ns) {
                    Turn::WaitUntil(site_ns) => {
                        self.watch_clock(worker, site_ns);
                        return Ok(clock.deadline_mono_ns(site_ns));
                    }
                    // Before its start a scaled clock stands: its first scan is due when it runs.
                    Turn::Send if is_ahead(clock, self.scan.stamp_ns) => {
                        return Ok(clock.deadline_mono_ns(self.scan.stamp_ns));
                    }
                    Turn::Skip => self.skip(clock.now_ns()),
                    Turn::Send if !self.scans.may_send() => return Ok(None),
                    Turn::Send => self.send(worker)?,
                },
                Next::End if !self.scans.may_send() => return Ok(None),
                Next::End => self.send_end(worker)?,
                Next::EndSent(_) => return Ok(None),
            }
        }
        Ok(Some(0)) // a look at the signals, then on
    }

    fn ask(&mut self, worker: &mut Worker) -> Result<Next, Failure> {
        let result = self.source.next(&mut self.scan);
        for oddity in self.source.take_oddities() {
            tracing::warn!(code = oddity.code, "{}", oddity.text);
        }
        match result {
            Ok(true) => Ok(Next::Scan),
            Ok(false) => Ok(Next::End),
            Err(error) if error.is_early_end() => {
                worker.health.fault("recording_ends_early", error.to_string());
                Ok(Next::End)
            }
            Err(error) => Err(failure(&worker.role.to_string(), &error)),
        }
    }

    fn send(&mut self, worker: &mut Worker) -> Result<(), Failure> {
        let mut loan = self.scans.loan(self.scan.ranges_m.len())?;
        let header = loan.header_mut();
        header.stamp_ns = self.scan.stamp_ns;
        header.device_stamp_ns = self.scan.device_stamp_ns;
        header.geometry = self.scan.geometry;
        loan.payload_mut().copy_from_slice(&self.scan.ranges_m);
        loan.send();
        self.out += 1;
        self.newest_stamp_ns = self.scan.stamp_ns;
        self.next = Next::Unknown;
        worker.health.set_state(ServiceState::Running);
        Ok(())
    }

    fn skip(&mut self, now_ns: Option<u64>) {
        self.skipped += 1;
        if let (Source::Simulator(simulator), Some(now_ns)) = (&mut self.source, now_ns) {
            self.skipped += simulator.skip_to(now_ns); // nobody needs the scans of a sleeping host
        }
        self.next = Next::Unknown;
    }

    fn send_end(&mut self, worker: &mut Worker) -> Result<(), Failure> {
        let mut loan = self.scans.loan(0)?;
        let header = loan.header_mut();
        header.stamp_ns = self.newest_stamp_ns;
        header.envelope_mut().flags = FLAG_END_OF_STREAM;
        loan.send();
        if self.next == Next::End {
            tracing::info!("the recording is over after {} scans", self.out);
        }
        self.next = Next::EndSent(monotonic_ns());
        worker.health.set_state(ServiceState::Ended);
        Ok(())
    }

    /// A wall clock that was set back makes a simulated laser wait: say why it is silent.
    fn watch_clock(&self, worker: &mut Worker, due_ns: u64) {
        let now_ns = worker.instance.clock.now_ns().unwrap_or(due_ns);
        let ahead_ns = due_ns.saturating_sub(now_ns);
        let is_simulated = matches!(self.source, Source::Simulator(_));
        let stepped = is_simulated && ahead_ns > WAIT_MAX_NS;
        worker.health.set_fault(
            "clock_stepped_back",
            stepped.then(|| {
                format!(
                    "the next scan is due in {} s, expected at most {} s: the host's clock was set \
                     back; restart the site, or wait",
                    ahead_ns / protocol::time::SECOND_NS,
                    WAIT_MAX_NS / protocol::time::SECOND_NS
                )
            }),
        );
    }

    /// Once in a while: health, and the end of the stream again for a fusion that was restarted.
    fn tell(&mut self, worker: &mut Worker) {
        let mono_ns = monotonic_ns();
        if let Next::EndSent(at_mono_ns) = self.next
            && mono_ns >= at_mono_ns.saturating_add(protocol::time::SECOND_NS)
            && self.scans.may_send()
            && let Err(error) = self.send_end(worker)
        {
            tracing::warn!("the end of the stream is not repeated: {error}");
        }
        let counts = self.source.counts();
        let sent = self.scans.sent();
        let health = &mut worker.health;
        for (name, total) in [
            ("scans_out", self.out),
            ("scans_dropped_out_of_order", counts.dropped_out_of_order),
            ("scans_dropped_geometry", counts.dropped_geometry),
            ("scans_refused", counts.refused),
            ("scans_passed_over", counts.passed_over),
            ("scans_skipped", self.skipped),
            ("messages_without_reader", sent.without_reader),
            ("messages_failed", sent.failed),
            ("connections_failed", sent.connections_failed),
        ] {
            health.set_count(name, total);
        }
        if let Some(rate_hz) = self.rate.measure(self.out, mono_ns) {
            health.gauge("scan_rate_hz", rate_hz);
        }
        if let Some(now_ns) = worker.instance.clock.now_ns().filter(|_| self.out > 0) {
            let age_ns = now_ns.saturating_sub(self.newest_stamp_ns);
            health.gauge("scan_age_s", age_ns as f64 / 1e9);
        }
        self.tell_geometry(worker, &counts, mono_ns);
    }

    /// A fault while scans are dropped for their geometry, and for a while after the last one.
    fn tell_geometry(&mut self, worker: &mut Worker, counts: &SourceCounts, mono_ns: u64) {
        let (dropped, at_mono_ns) = &mut self.dropped_geometry;
        if counts.dropped_geometry > *dropped {
            (*dropped, *at_mono_ns) = (counts.dropped_geometry, mono_ns);
            let text = format!(
                "{dropped} scans dropped so far: their beams lie otherwise than those of the first \
                 scan; restart the site if the device was exchanged"
            );
            worker.health.fault("geometry_changed", text);
        } else if mono_ns > at_mono_ns.saturating_add(QUIET_NS) {
            worker.health.clear("geometry_changed");
        }
    }
}

fn is_ahead(clock: Clock, site_ns: u64) -> bool {
    clock.deadline_mono_ns(site_ns).is_some_and(|deadline| deadline > monotonic_ns())
}

/// Where the source begins, site time: now for a simulator; for a replay as far back as a frame
/// reaches; the start of the run, or of the recording, where no clock runs.
fn begin_ns(worker: &Worker, age_max_ns: u64) -> u64 {
    let is_simulated = worker
        .laser()
        .is_some_and(|(_, laser)| matches!(laser.source, protocol::site::Source::Simulator { .. }));
    match (worker.instance.clock.now_ns(), is_simulated) {
        (Some(now_ns), true) => now_ns,
        (Some(now_ns), false) => now_ns.saturating_sub(age_max_ns),
        (None, true) => worker.instance.started_ns,
        (None, false) => 0,
    }
}

fn failure(laser: &str, error: &SourceError) -> Failure {
    let text = format!("{laser}: {error}");
    match error {
        SourceError::Recording(recording::RecordingError::Io { action: "read", .. }) => {
            Failure::Failed(text)
        }
        _ => Failure::Config(text),
    }
}
