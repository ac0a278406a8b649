//! Pure: when a process that ended is started again, and when the site gives up.
//!
//! | what happened | what follows |
//! |---|---|
//! | first end, or an end after 10 s of health | started again at once |
//! | ends again | after 100 ms, doubling to 5 s |
//! | exit 78: its configuration is wrong | the site stops |
//! | 5 failures of its own within 10 s, at start-up, never once ready | the site stops |
//!
//! Alive is who tells its health; ready is who says more than `starting`. Start-up is the first half
//! minute of a service: a site that has run since must not stop because a laser goes mad at night.
//!
//! A SIGKILL or SIGTERM from outside is not a failure of its own: it says nothing about whether the
//! site can run.

use std::collections::VecDeque;
use std::fmt;

const SECOND_NS: u64 = 1_000_000_000;
/// Delay of the second restart; doubles from there.
const DELAY_MIN_NS: u64 = SECOND_NS / 10;
/// A service that keeps dying is tried this often: often enough to come back soon after its cause
/// went away, seldom enough to leave the processor to the others.
const DELAY_MAX_NS: u64 = 5 * SECOND_NS;
/// So long a health forgives what was before.
const HEALTHY_NS: u64 = 10 * SECOND_NS;
/// So many failures in [`HEALTHY_NS`] before it ever was ready mean that it cannot start.
const FAILURES_MAX: usize = 5;
/// The start-up of a service.
const STARTUP_NS: u64 = 30 * SECOND_NS;
/// Exit code of a process whose configuration is wrong.
const EXIT_BAD_CONFIG: i32 = 78;

/// How a process ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum End {
    /// It left with this code.
    Exit(i32),
    /// A signal ended it.
    Signal(i32),
}

impl fmt::Display for End {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Exit(code) => write!(f, "exit code {code}"),
            Self::Signal(signal) => write!(f, "signal {signal}"),
        }
    }
}

/// What to do about an end.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Decision {
    /// Start it again so many nanoseconds from now.
    RestartAfter(u64),
    /// Its configuration is wrong: stop the site.
    BadConfig,
    /// It fails whenever it starts: stop the site.
    CannotStart,
}

/// The history of one service that matters.
#[derive(Debug, Default)]
pub struct RestartPolicy {
    first_start_ns: Option<u64>,
    alive_since_ns: Option<u64>,
    ever_ready: bool,
    ends: u32,
    failures_ns: VecDeque<u64>,
}

impl RestartPolicy {
    /// The process was started.
    pub fn started(&mut self, now_ns: u64) {
        self.first_start_ns.get_or_insert(now_ns);
        self.alive_since_ns = None;
    }

    /// The process told its health; `ready` if it says more than `starting`.
    pub fn alive(&mut self, now_ns: u64, ready: bool) {
        self.alive_since_ns.get_or_insert(now_ns);
        self.ever_ready |= ready;
    }

    /// The process ended without being asked to.
    pub fn ended(&mut self, now_ns: u64, end: End) -> Decision {
        let healthy = self.alive_since_ns.take().is_some_and(|since| now_ns - since >= HEALTHY_NS);
        if end == End::Exit(EXIT_BAD_CONFIG) {
            return Decision::BadConfig;
        }
        if healthy {
            self.ends = 0;
        }
        self.ends = self.ends.saturating_add(1);
        let from_outside = matches!(end, End::Signal(9 | 15));
        let at_startup = self.first_start_ns.is_none_or(|first| now_ns - first < STARTUP_NS);
        if at_startup && !self.ever_ready && !from_outside {
            self.failures_ns.retain(|&failure| now_ns - failure < HEALTHY_NS);
            self.failures_ns.push_back(now_ns);
            if self.failures_ns.len() >= FAILURES_MAX {
                return Decision::CannotStart;
            }
        }
        let delay_ns = match self.ends {
            1 => 0,
            n => (DELAY_MIN_NS << (n - 2).min(16)).min(DELAY_MAX_NS),
        };
        Decision::RestartAfter(delay_ns)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const KILLED: End = End::Signal(9);

    /// Delays in milliseconds of ends at these times (seconds), each after a readiness at once.
    fn delays_ms(policy: &mut RestartPolicy, ends_s: &[(f64, f64)]) -> Vec<u64> {
        let ns = |s: f64| (s * 1e9) as u64;
        ends_s
            .iter()
            .map(|&(ready_s, end_s)| {
                policy.started(ns(ready_s));
                policy.alive(ns(ready_s), true);
                match policy.ended(ns(end_s), KILLED) {
                    Decision::RestartAfter(delay_ns) => delay_ns / 1_000_000,
                    other => panic!("{other:?}"),
                }
            })
            .collect()
    }

    #[test]
    fn the_first_restart_is_at_once_and_then_the_delay_doubles_to_five_seconds() {
        let ends: Vec<_> = (0..10).map(|n| (f64::from(n), f64::from(n) + 0.5)).collect();
        let delays = delays_ms(&mut RestartPolicy::default(), &ends);
        assert_eq!(delays, [0, 100, 200, 400, 800, 1600, 3200, 5000, 5000, 5000]);
    }

    #[test]
    fn ten_seconds_of_health_forgive() {
        let ends = [(0.0, 1.0), (1.0, 2.0), (2.0, 3.0), (3.0, 13.0), (13.0, 14.0)];
        assert_eq!(delays_ms(&mut RestartPolicy::default(), &ends), [0, 100, 200, 0, 100]);
    }

    #[test]
    fn a_wrong_configuration_stops_the_site_whenever_it_shows() {
        let mut policy = RestartPolicy::default();
        assert_eq!(policy.ended(0, End::Exit(78)), Decision::BadConfig);
        policy.alive(1, true);
        assert_eq!(policy.ended(2, End::Exit(78)), Decision::BadConfig);
    }

    #[test]
    fn five_failures_before_it_was_ever_ready_stop_the_site() {
        let mut policy = RestartPolicy::default();
        let second = |n: u64| n * SECOND_NS;
        for n in 0..4 {
            assert!(matches!(policy.ended(second(n), End::Exit(1)), Decision::RestartAfter(_)));
        }
        assert_eq!(policy.ended(second(4), End::Signal(11)), Decision::CannotStart);
    }

    #[test]
    fn who_is_alive_but_never_ready_cannot_start_but_only_at_startup() {
        for (first_s, decision) in
            [(0, Decision::CannotStart), (31, Decision::RestartAfter(800_000_000))]
        {
            let mut policy = RestartPolicy::default();
            policy.started(0);
            policy.alive(0, false);
            let last = (0..5).map(|n| policy.ended((first_s + n) * SECOND_NS, End::Exit(1))).last();
            assert_eq!(last, Some(decision), "{first_s}");
        }
    }

    #[test]
    fn failures_far_apart_or_after_it_was_ready_do_not() {
        let mut policy = RestartPolicy::default();
        for n in 0..20 {
            let decision = policy.ended(n * 3 * SECOND_NS, End::Exit(1));
            assert!(matches!(decision, Decision::RestartAfter(_)), "{n}");
        }
        let mut policy = RestartPolicy::default();
        policy.alive(0, true);
        for n in 0..20 {
            assert!(matches!(policy.ended(n, End::Exit(1)), Decision::RestartAfter(_)), "{n}");
        }
    }

    #[test]
    fn kills_from_outside_at_start_do_not_stop_the_site() {
        let mut policy = RestartPolicy::default();
        for n in 0..100 {
            assert!(matches!(policy.ended(n, KILLED), Decision::RestartAfter(_)), "{n}");
        }
    }
}
