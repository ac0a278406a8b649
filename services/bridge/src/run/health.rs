//! What the bridge says of itself, and of the other hosts: `tog status` shows it.

use super::Bridge;
use crate::agreement::GAUGE;
use crate::follower::Replaced;
use crate::guard;
use crate::link::sockets;
use crate::remote::RemoteHost;
use process::{Worker, monotonic_ns, wall_ns};
use protocol::time::SECOND_NS;
use std::collections::BTreeSet;

/// The fault is over when nothing came under a wrong key for so long.
const MISROUTED_QUIET_NS: u64 = 60 * SECOND_NS;
/// For so long a desk says that another host began a new journal.
const REPLACED_TOLD_NS: u64 = 3600 * SECOND_NS;
/// Questions and pages are put off now and then while a desk catches up; so many a second are a flood.
const FLOOD_A_SECOND: u64 = 100;

/// A count that should not grow: looked at once a second.
#[derive(Debug)]
pub(super) struct Strange {
    /// Growth within a second that is no reason to say anything.
    tolerated: u64,
    before: u64,
    /// When it last grew by more, CLOCK_MONOTONIC, and what it was before that began.
    last: Option<(u64, u64)>,
}

impl Strange {
    /// Of what is refused none, of what is put off less than a flood.
    pub(super) fn both() -> [Self; 2] {
        [0, FLOOD_A_SECOND].map(|tolerated| Self { tolerated, before: 0, last: None })
    }

    /// What to say, given how often it was since it began; for a minute after it last grew.
    fn fault(&mut self, total: u64, now_ns: u64, say: impl Fn(u64) -> String) -> Option<String> {
        let before = std::mem::replace(&mut self.before, total);
        if total.saturating_sub(before) > self.tolerated {
            let began = self.last.map_or(before, |(_, began)| began);
            self.last = Some((now_ns, began));
        }
        self.last =
            self.last.filter(|(last_ns, _)| now_ns.saturating_sub(*last_ns) < MISROUTED_QUIET_NS);
        self.last.map(|(_, began)| say(total - began))
    }
}

impl Bridge {
    /// Once a second: how we are, and how the others are.
    pub(super) fn tell_health(&mut self, worker: &mut Worker) {
        let now_ns = monotonic_ns();
        if now_ns < self.looked_ns + SECOND_NS {
            return;
        }
        self.looked_ns = now_ns;
        sockets::end_when_not_acknowledged();
        let scans = self.count_scans();
        let misrouted = self.counters.misrouted.count + scans.misrouted;
        let health = &mut worker.health;
        let (dropped, counters) = (self.inbox.dropped(), &self.counters);
        let remotes = self.remote.iter().flatten();
        let not_there: u64 = remotes.map(RemoteHost::refused).sum();
        let foreign = self.followed.iter().map(|followed| followed.follower.foreign()).sum();
        let repeated = self.followed.iter().map(|followed| followed.follower.repeated()).sum();
        for (name, total) in [
            ("scans_out", scans.sent),
            ("scans_in", scans.came),
            ("scans_lost", scans.lost),
            ("scans_refused", scans.refused),
            ("messages_refused_misrouted", misrouted),
            ("health_dropped", dropped.health),
            ("health_refused", counters.health_refused + not_there),
            ("events_out", counters.events_out),
            ("events_in", counters.events_in),
            ("events_refused", foreign),
            ("events_repeated", repeated),
            ("pages_refused", counters.pages_refused),
            ("pages_put_off", dropped.pages),
            ("questions_put_off", dropped.asks + self.teller.unanswered()),
            ("messages_refused_too_long", dropped.too_long),
            ("questions_refused", dropped.not_understood),
        ] {
            health.set_count(name, total);
        }
        for (name, total) in self.maps.counts() {
            health.set_count(name, total);
        }
        let refused = scans.refused
            + counters.health_refused
            + not_there
            + foreign
            + counters.pages_refused
            + dropped.too_long
            + dropped.not_understood;
        let put_off = dropped.health + dropped.pages + dropped.asks;
        let [nonsense, flood] = &mut self.strange;
        let fault = nonsense.fault(refused, now_ns, |count| {
            format!(
                "{count} messages of other hosts were refused in the last minute or before: they \
                 broke a bound, or were of nobody who is there; the log says more. A host with \
                 another version or another site file, or one that lies"
            )
        });
        health.set_fault("messages_refused", fault);
        let fault = flood.fault(put_off, now_ns, |count| {
            format!(
                "other hosts send faster than this one reads: {count} messages were put off. If it \
                 stays, look which host is beside itself (`tog status --site`) and restart it"
            )
        });
        health.set_fault("flooded", fault);
        health.set_count("maps_dropped", dropped.maps);
        health.gauge("maps_wanted", self.maps.wanted() as f64);
        let lately = |last: &&(u64, String)| now_ns.saturating_sub(last.0) < MISROUTED_QUIET_NS;
        let fault = counters.misrouted.last.as_ref().filter(lately).map(|(_, last)| {
            format!(
                "{} messages came under the key of somebody else, nothing of them was taken; the last one: \
                 {last}. A host that lies, or a network that confuses: restart this host if it stays",
                misrouted
            )
        });
        health.set_fault("misrouted", fault);
        let fault = self
            .teller
            .fault(now_ns)
            .map(|reason| format!("the events of this host cannot be told to others: {reason}"));
        health.set_fault("journal_unreadable", fault);
        self.tell_security(worker, now_ns);
        self.tell_areas(worker, now_ns);
        self.tell_remote(worker, now_ns);
        self.serve_late_readers();
    }

    fn tell_security(&mut self, worker: &mut Worker, now_ns: u64) {
        let Some(certificate) = &self.certificate else { return };
        let (health, totals) = (&mut worker.health, guard::totals());
        health.set_count("messages_refused_unauthorised", totals.messages);
        health.set_count("connections_refused_unauthorised", totals.connections);
        health.set_count("connections_without_a_word", totals.wordless);
        health.set_fault("unauthorised", self.alarm.fault(&totals, now_ns));
        let now_s = (wall_ns() / SECOND_NS) as i64;
        health.set_fault("certificate_expires", certificate.expires_soon(now_s));
        health.gauge("certificate_days_left", certificate.days_left(now_s) as f64);
    }

    /// An area that is heard from one host does not run on another one that is silent about it: that one
    /// was killed, or handed it over, and stands by.
    fn forget_what_moved(&mut self, now_ns: u64) {
        let fusion = |area: &String| format!("fusion {area}");
        let runs = |remote: &RemoteHost, area: &String| remote.hears(&fusion(area), now_ns);
        let there: BTreeSet<String> = self
            .remote
            .iter()
            .flatten()
            .flat_map(|remote| {
                let areas = self.areas_of[remote.id()].iter();
                areas.filter(move |area| runs(remote, area)).cloned()
            })
            .collect();
        for remote in self.remote.iter_mut().flatten() {
            for area in self.areas_of[remote.id()].iter().filter(|area| there.contains(*area)) {
                if !runs(remote, area) {
                    remote.left(area);
                }
            }
        }
    }

    fn tell_remote(&mut self, worker: &mut Worker, now_ns: u64) {
        self.forget_what_moved(now_ns);
        let uses_tls = worker.site.uses_tls();
        let health = &mut worker.health;
        health.gauge(GAUGE, f64::from(self.fingerprint));
        for (host, remote) in self.hosts.iter().zip(&mut self.remote) {
            let Some(remote) = remote else { continue };
            let id = &host.id;
            let lost = remote.lost(now_ns, &host.endpoint, uses_tls);
            // A lost host is one fault, not one for each of its processes.
            let unwell = remote.unwell(now_ns).filter(|_| self.me.desk && lost.is_none());
            health.set_fault(&format!("host_lost {id}"), lost);
            health.set_fault(&format!("host_unwell {id}"), unwell);
            let differs = remote.differs(self.fingerprint);
            health.set_fault(&format!("site_differs {id}"), differs);
            health.set_fault(&format!("clock_differs {id}"), remote.clock.fault(id));
            if let Some(ahead_ns) = remote.clock.ahead_ns() {
                health.gauge(&format!("clock_ahead_s {id}"), ahead_ns as f64 / 1e9);
            }
            let (all, heard) = remote.services(now_ns);
            health.gauge(&format!("host_services {id}"), all as f64);
            health.gauge(&format!("host_services_heard {id}"), heard as f64);
            for area in &self.areas_of[id] {
                let runs = remote.hears(&format!("fusion {area}"), now_ns);
                health.gauge(&format!("host_runs_area {id} {area}"), f64::from(u8::from(runs)));
            }
            if let Some(age_s) = remote.age_s(now_ns) {
                health.gauge(&format!("host_age_s {id}"), age_s);
            }
        }
        for followed in &self.followed {
            let id = &self.hosts[followed.host].id;
            health.gauge(&format!("events_behind {id}"), followed.follower.behind() as f64);
            let lately =
                |replaced: &Replaced| now_ns.saturating_sub(replaced.mono_ns) < REPLACED_TOLD_NS;
            let replaced = followed.follower.replaced().filter(lately);
            let replaced = replaced.map(|Replaced { row, head, .. }| {
                let lost = match head.saturating_sub(row) {
                    0 => "all that was heard of the old one is here".to_owned(),
                    lost => format!("up to {lost} rows of the old one are not here"),
                };
                format!(
                    "host {id} began a new journal: its state was lost, or restored. It is followed \
                     from its first row on; {lost}. Nothing is to be done; this is said for an hour"
                )
            });
            health.set_fault(&format!("journal_replaced {id}"), replaced);
            let other = followed.follower.other().map(|other| {
                format!(
                    "another journal answers for host {id}: {}. Do two machines run as {id}, or with a \
                     copy of its state? Stop the wrong one. If {id} was restored: on it, stop, remove \
                     bridge/epoch.json and *.outbox of its state, start. Its events are not taken \
                     until then; then remove {} and restart this host",
                    other.reason,
                    self.shelf.path(id).display()
                )
            });
            health.set_fault(&format!("other_journal {id}"), other);
        }
    }
}
