//! The loop.

mod outside;

use crate::control::Control;
use crate::notify::{Look, Notifier};
use crate::output::Output;
use crate::policy::{Decision, End};
use crate::report::StatusReport;
use crate::service::Service;
use process::domain::{Owner, OwnerOptions, is_lossless};
use process::{Bus, Clock, EventLoop, Role, Subscriber, exit, monotonic_ns, wall_ns};
use protocol::codec::decode;
use protocol::health::Health;
use protocol::site::{Pace, Site, Source};
use protocol::topic;
use protocol::wire::BytesHeader;
use std::path::PathBuf;
use std::process::ExitCode;

const SECOND_NS: u64 = 1_000_000_000;
/// A process that is silent for so long hangs: ten missed beats are no busy moment.
const SILENCE_MAX_S: f64 = 10.0;
/// A process that was asked to stop has so long: a mapper writes its checkpoint in well below that.
const GRACE_NS: u64 = 3 * SECOND_NS;
/// The next kind of process is asked at the latest so long after the one before.
const STAGE_NS: u64 = 600_000_000;
/// Kinds of processes in the order of the shutdown.
const STAGES: usize = 6;
/// A replay in step with time begins so long after the start, when everybody listens.
const REPLAY_LEAD_NS: u64 = SECOND_NS;

/// How to run a site.
#[derive(Debug, Clone, Default)]
pub struct Options {
    /// Where relative paths of the site file begin.
    pub base_dir: PathBuf,
    /// Which host of the site this is; none for a site without hosts.
    pub host: Option<String>,
    /// Directory of run directories; the default one unless set.
    pub run_root: Option<PathBuf>,
    /// Where results go (`--out`), absolute.
    pub out_dir: Option<PathBuf>,
    /// Stop by itself after so many seconds.
    pub seconds: Option<f64>,
    /// Stamp of the first scan of the recordings, UNIX nanoseconds; needed if the site replays in
    /// step with time, because then it is the site's time at the start.
    pub replay_start_ns: Option<u64>,
    /// When the recordings of a replay in step with time begin, UNIX nanoseconds of the host's clock:
    /// the same on all hosts of a site. A second after the start unless set.
    pub replay_at_ns: Option<u64>,
    /// A process without a sign of life for so long is killed, six times that while it starts; 10 s
    /// unless set.
    pub silence_max_s: Option<f64>,
}

/// Runs a site until it is asked to stop, its time is over, its recordings are over, or it cannot
/// go on. All that has to be said is said on stderr.
#[must_use]
pub fn run(site: &Site, options: &Options) -> ExitCode {
    process::logging::start();
    let roles = Role::all(site, options.host.as_deref());
    let width = roles.iter().map(|role| role.to_string().len()).max().unwrap_or(0).max(10);
    let mut output = Output::new(width);
    let clock = match clock(site, options) {
        Ok(clock) => clock,
        Err(reason) => {
            output.say(&format!("ERROR {reason}"));
            return ExitCode::from(exit::BAD_CONFIG);
        }
    };
    let after_ns = |s: f64| monotonic_ns().saturating_add((s.max(0.0) * 1e9) as u64);
    let stop_at_ns = options.seconds.map(after_ns);
    loop {
        match Supervisor::start(site, roles.clone(), options, clock, stop_at_ns, output) {
            Ok(mut supervisor) => match supervisor.supervise() {
                Outcome::Over(code) => return ExitCode::from(code),
                Outcome::Anew => output = supervisor.into_output(),
            },
            Err(reason) => {
                // The log's thread belongs to the supervisor that is not there.
                eprintln!("error: {reason}");
                return ExitCode::from(exit::FAILED);
            }
        }
    }
}

/// How a run of the processes ended.
enum Outcome {
    /// The site stops with this exit code.
    Over(u8),
    /// All processes have stopped, and the site is to begin again.
    Anew,
}

fn clock(site: &Site, options: &Options) -> Result<Clock, String> {
    if is_lossless(site) {
        return Ok(Clock::EventTime);
    }
    let rate = site.lasers.iter().find_map(|laser| match &laser.source {
        Source::Replay { pace: Pace::RealTime, .. } => Some(1.0),
        Source::Replay { pace: Pace::Times(rate), .. } => Some(*rate),
        _ => None,
    });
    match (rate, options.replay_start_ns) {
        (None, _) => Ok(Clock::Wall),
        (Some(rate), Some(start_site_ns)) => {
            let now_ns = monotonic_ns();
            let at = |at_ns: u64| {
                let wall_ns = wall_ns();
                now_ns.saturating_add(at_ns.saturating_sub(wall_ns)).saturating_sub(
                    wall_ns.saturating_sub(at_ns), // it has begun: this host joins late
                )
            };
            let start_mono_ns = options.replay_at_ns.map_or(now_ns + REPLAY_LEAD_NS, at);
            Ok(Clock::Scaled { start_site_ns, start_mono_ns, rate })
        }
        (Some(_), None) => {
            Err("the recordings hold no scan, so a replay has no time to start at".to_owned())
        }
    }
}

#[derive(Debug)]
enum Phase {
    Running,
    Stopping { code: u8, stage: usize, since_ns: u64, anew: bool },
}

struct Supervisor {
    services: Vec<Service>,
    health: Subscriber<BytesHeader, u8>,
    /// Where several hosts may run an area.
    ownership: Option<Subscriber<BytesHeader, u8>>,
    control: Control,
    output: Output,
    phase: Phase,
    stop_at_ns: Option<u64>,
    /// When the files of the domain were looked at.
    looked_ns: u64,
    silence_max_ns: u64,
    notifier: Notifier,
    look: Look,
    // The bus and its events before the owner, whose end removes everything.
    _bus: Bus,
    events: EventLoop,
    owner: Owner,
}

impl Supervisor {
    fn start(
        site: &Site,
        roles: Vec<Role>,
        options: &Options,
        clock: Clock,
        stop_at_ns: Option<u64>,
        output: Output,
    ) -> Result<Self, String> {
        let owner_options = OwnerOptions {
            host: options.host.clone(),
            run_root: options.run_root.clone().unwrap_or_else(process::instance::default_run_root),
            base_dir: options.base_dir.clone(),
            out_dir: options.out_dir.clone(),
            clock,
        };
        let events = EventLoop::new().map_err(|error| error.to_string())?;
        let owner = Owner::start(site, &owner_options).map_err(|error| error.to_string())?;
        let bus = owner.bus(&events).map_err(|error| error.to_string())?;
        let health = bus.subscriber(&topic::health()).map_err(|error| error.to_string())?;
        let socket = owner.instance().control_socket();
        let control = Control::listen(&socket, &events)
            .map_err(|error| format!("cannot listen on {}: {error}", socket.display()))?;
        let services = roles.into_iter().enumerate().map(|(n, role)| Service::new(role, n));
        let mut services: Vec<_> = services.collect();
        let shared = |area: &protocol::site::Area| area.standby.is_some();
        let shared: Vec<_> =
            site.areas.iter().filter(|a| shared(a)).map(|a| a.id.as_str()).collect();
        let is_shared = |role: &Role| role.area().is_some_and(|area| shared.contains(&area));
        // The bridge says which of them run here.
        services.iter_mut().filter(|service| is_shared(&service.role)).for_each(Service::hold);
        let ownership = site.has_bridges().then(|| bus.subscriber(&topic::ownership()));
        let ownership = ownership.transpose().map_err(|error| error.to_string())?;
        Ok(Self {
            services,
            health,
            ownership,
            control,
            output,
            phase: Phase::Running,
            stop_at_ns,
            looked_ns: monotonic_ns(),
            notifier: Notifier::of_environment(monotonic_ns()),
            look: Look::default(),
            silence_max_ns: (options.silence_max_s.unwrap_or(SILENCE_MAX_S) * 1e9) as u64,
            _bus: bus,
            events,
            owner,
        })
    }

    fn supervise(&mut self) -> Outcome {
        let instance = self.owner.instance();
        let (count, run_dir) = (self.services.len(), instance.run_dir.display().to_string());
        self.output
            .say(&format!("INFO {} starts: {count} processes, {run_dir}", instance.site_name));
        loop {
            self.tick();
            match self.is_over() {
                Some(Outcome::Over(code)) => {
                    self.output.say("INFO stopped");
                    return Outcome::Over(code);
                }
                Some(Outcome::Anew) => return Outcome::Anew,
                None => {}
            }
            match self.events.wait(self.due_ns()) {
                Ok(wake) => {
                    let heard = self.take_health();
                    self.take_ownership();
                    self.notify(heard);
                    while let Some(token) = self.events.next_ready() {
                        self.serve(token);
                    }
                    if wake.stop {
                        self.stop(exit::OK, "INFO asked to stop");
                    }
                }
                Err(error) => {
                    self.output.say(&format!("ERROR the event loop is broken: {error}"));
                    return Outcome::Over(exit::FAILED); // dropping the services kills them
                }
            }
        }
    }

    /// True if somebody told something.
    fn take_health(&mut self) -> bool {
        let mut heard = false;
        while let Ok(Some(message)) = self.health.receive() {
            // A damaged message is silence, and silence has its own remedy.
            if let Ok(health) = decode::<Health>(message.payload())
                && let Some(service) = self.services.iter_mut().find(|s| s.name == health.service)
            {
                service.heard(health);
                heard = true;
            }
        }
        heard
    }

    fn serve(&mut self, token: process::Token) {
        if let Some(index) = self.services.iter().position(|service| service.logs_on(token)) {
            self.services[index].take_log(&self.events, &mut self.output);
        } else if let Some(index) = self.services.iter().position(|service| service.ends_on(token))
        {
            self.bury(index);
        } else {
            let (services, owner, phase) = (&self.services, &self.owner, &self.phase);
            self.control.serve(token, &self.events, || report(services, owner, phase));
        }
    }

    /// A process ended: sweep up after it, and decide what follows.
    fn bury(&mut self, index: usize) {
        self.take_health(); // its last beat may say that it was done
        let service = &mut self.services[index];
        let Some(end) = service.take_end(&self.events, &mut self.output) else { return };
        self.owner.sweep();
        if matches!(self.phase, Phase::Stopping { .. }) {
            return;
        }
        if end == End::Exit(0) && service.has_ended() {
            return; // the recording is over, and it was done
        }
        if self.has_lost_its_domain() {
            return; // its end is the beginning of all others'
        }
        let service = &mut self.services[index];
        if service.is_held() {
            return;
        }
        let now_ns = monotonic_ns();
        match service.policy.ended(now_ns, end) {
            Decision::RestartAfter(delay_ns) => {
                service.start_at_ns = Some(now_ns + delay_ns);
                let line =
                    format!("WARN ended with {end}; starts again in {} ms", delay_ns / 1_000_000);
                self.output.line(index, &service.name, &line);
            }
            Decision::BadConfig => {
                self.give_up(index, exit::BAD_CONFIG, "its configuration is wrong (exit code 78)");
            }
            Decision::CannotStart => {
                let reason = format!("5 failures in 10 s, never ready, now {end}");
                self.give_up(index, exit::FAILED, &reason);
            }
        }
    }

    fn give_up(&mut self, index: usize, code: u8, reason: &str) {
        let service = &self.services[index];
        self.output.say(&format!("ERROR {} cannot run: {reason}. Its last lines:", service.name));
        for line in service.last_words() {
            self.output.say(&format!("    {line}"));
        }
        self.stop(code, "INFO the site stops");
    }

    fn stop(&mut self, code: u8, why: &str) {
        let begins_anew = matches!(self.phase, Phase::Stopping { anew: true, .. });
        if begins_anew || matches!(self.phase, Phase::Running) {
            self.output.say(why);
            let since_ns = monotonic_ns();
            self.phase = Phase::Stopping { code, stage: 0, since_ns, anew: false };
        }
    }

    /// True if somebody removed files that a process needs to join; then the site begins anew.
    fn has_lost_its_domain(&mut self) -> bool {
        let Some(path) = self.owner.first_missing() else { return false };
        self.output.say(&format!(
            "ERROR {} is gone: somebody removed it, and without it no process can join. All \
             processes stop and the site begins anew, from its state directory",
            path.display()
        ));
        process::logging::hush();
        let (code, since_ns) = (exit::OK, monotonic_ns());
        self.phase = Phase::Stopping { code, stage: 0, since_ns, anew: true };
        true
    }

    /// What somebody may have removed under our feet: the domain's files, the state directory.
    fn look_at_files(&mut self) {
        if self.has_lost_its_domain() {
            return;
        }
        match self.owner.look_at_state() {
            Ok(None) => {}
            Ok(Some(words)) => self.output.say(&format!("ERROR {words}")),
            Err(error) => {
                self.output
                    .say(&format!("ERROR {error}. Two writers would undo each other's work"));
                self.stop(exit::FAILED, "INFO the site stops");
            }
        }
    }

    /// The log, for the next run; everything else ends here.
    fn into_output(self) -> Output {
        self.output
    }

    /// Everything that is due by now.
    fn tick(&mut self) {
        let now_ns = monotonic_ns();
        self.control.tick(now_ns, &self.events);
        if let Phase::Running = self.phase {
            self.start_due(now_ns);
            self.watch_for_silence(now_ns);
            // No deadline of its own: the beats of the services wake us often enough.
            if now_ns >= self.looked_ns + SECOND_NS {
                self.looked_ns = now_ns;
                self.look = self.look();
                self.look_at_files();
            }
        }
        if let Phase::Running = self.phase {
            if self.stop_at_ns.is_some_and(|at| at <= now_ns) {
                self.stop(exit::OK, "INFO its time is over");
            } else if self.recordings_are_over() {
                self.stop(exit::OK, "INFO the recording is over");
            }
        }
        self.tick_shutdown(now_ns);
    }

    fn start_due(&mut self, now_ns: u64) {
        let run_dir = self.owner.instance().run_dir.clone();
        let mut started = false;
        for service in &mut self.services {
            if service.start_at_ns.is_none_or(|at| at > now_ns) {
                continue;
            }
            started = true;
            if let Err(error) = service.start(&run_dir, &self.events) {
                let (name, index) = (service.name.clone(), service.index);
                self.output.line(index, &name, &format!("ERROR cannot be started: {error}"));
                service.start_at_ns = Some(now_ns + SECOND_NS);
            }
        }
        if started {
            let pids = self.services.iter().filter_map(Service::pid);
            if let Err(error) = self.owner.record_children(pids) {
                self.output.say(&format!("WARN cannot write down the process ids: {error}"));
            }
        }
    }

    fn watch_for_silence(&mut self, now_ns: u64) {
        for service in &mut self.services {
            let silence_max_ns = self.silence_max_ns;
            let late = service.asked_to_stop_ns().is_some_and(|at| now_ns >= at + GRACE_NS);
            if late && service.kill() {
                let line = "WARN did not stop: killed";
                self.output.line(service.index, &service.name, line);
            }
            let silent = service.silent_at_ns(silence_max_ns).is_some_and(|at| now_ns >= at);
            if silent && service.kill() {
                let silence_s = silence_max_ns as f64 / 1e9;
                let line = format!("ERROR no sign of life for {silence_s} s: killed");
                self.output.line(service.index, &service.name, &line);
            }
        }
    }

    fn recordings_are_over(&self) -> bool {
        let anomalies =
            self.services.iter().filter(|s| matches!(s.role, Role::Anomaly { .. }) && !s.is_held());
        let mut anomalies = anomalies.peekable();
        anomalies.peek().is_some() && anomalies.all(Service::has_ended)
    }

    fn tick_shutdown(&mut self, now_ns: u64) {
        let hurry = self.events.signals() > 1;
        let Phase::Stopping { stage, since_ns, .. } = &mut self.phase else { return };
        for service in &mut self.services {
            service.start_at_ns = None;
            if stage_of(&service.role) <= *stage {
                service.ask_to_stop();
            }
            let late = service.asked_to_stop_ns().is_some_and(|at| now_ns >= at + GRACE_NS);
            if (late || hurry) && service.kill() {
                let line = "WARN did not stop: killed";
                self.output.line(service.index, &service.name, line);
            }
        }
        let waits = self.services.iter().any(|s| s.pid().is_some() && stage_of(&s.role) == *stage);
        if *stage + 1 < STAGES && (!waits || now_ns >= *since_ns + STAGE_NS) {
            *stage += 1;
            *since_ns = now_ns;
            self.tick_shutdown(now_ns);
        }
    }

    /// What follows, once everything has stopped.
    fn is_over(&self) -> Option<Outcome> {
        let Phase::Stopping { code, anew, .. } = self.phase else { return None };
        let outcome = if anew { Outcome::Anew } else { Outcome::Over(code) };
        self.services.iter().all(|service| service.pid().is_none()).then_some(outcome)
    }

    fn due_ns(&self) -> Option<u64> {
        let stopping = match self.phase {
            Phase::Running => None,
            Phase::Stopping { stage, since_ns, .. } => {
                (stage + 1 < STAGES).then_some(since_ns + STAGE_NS)
            }
        };
        let is_running = matches!(self.phase, Phase::Running);
        let of_service = |service: &Service| {
            let silence = service.silent_at_ns(self.silence_max_ns);
            let grace = service.asked_to_stop_ns().map(|at| at + GRACE_NS);
            let death = if is_running { silence.into_iter().chain(grace).min() } else { grace };
            let death = if service.is_dying() { None } else { death };
            service.start_at_ns.into_iter().chain(death).min()
        };
        let services = self.services.iter().filter_map(of_service);
        let own = [stopping, self.control.due_ns(), self.stop_at_ns.filter(|_| is_running)];
        services.chain(own.into_iter().flatten()).min()
    }
}

fn stage_of(role: &Role) -> usize {
    match role {
        Role::Laser { .. } => 0,
        Role::Fusion { .. } => 1,
        Role::Mapper { .. } => 2,
        Role::Anomaly { .. } => 3,
        Role::Recorder | Role::Bridge => 4,
        Role::Alerts => 5,
    }
}

fn report(services: &[Service], owner: &Owner, phase: &Phase) -> StatusReport {
    let instance = owner.instance();
    StatusReport {
        site: instance.site_name.clone(),
        run_dir: instance.run_dir.display().to_string(),
        pid: std::process::id(),
        started_ns: instance.started_ns,
        stamp_ns: wall_ns(),
        stopping: matches!(phase, Phase::Stopping { .. }),
        services: services.iter().map(Service::status).collect(),
    }
}
