//! Clocks. The only file of the project that reads one.
//!
//! | time | unit | what for |
//! |---|---|---|
//! | [`monotonic_ns`] | ns since boot, CLOCK_MONOTONIC | deadlines, latencies: never steps, shared by all processes of a host |
//! | [`Clock::now_ns`] | ns of the UNIX epoch, **site time** | what a scan is stamped with; lateness |
//!
//! Site time of a replay is an affine function of CLOCK_MONOTONIC, written once into the instance
//! file, so that all processes agree on it to the nanosecond without talking to each other.

use rustix::time::{ClockId, Timespec, clock_gettime};
use serde::{Deserialize, Serialize};

/// Nanoseconds of CLOCK_MONOTONIC: the same in all processes of a host.
#[must_use]
pub fn monotonic_ns() -> u64 {
    nanoseconds(clock_gettime(ClockId::Monotonic))
}

/// Nanoseconds of the UNIX epoch by the host's clock.
#[must_use]
pub fn wall_ns() -> u64 {
    nanoseconds(clock_gettime(ClockId::Realtime))
}

/// CPU time that this process has used, all threads, nanoseconds.
#[must_use]
pub fn process_cpu_ns() -> u64 {
    nanoseconds(clock_gettime(ClockId::ProcessCPUTime))
}

fn nanoseconds(time: Timespec) -> u64 {
    // Clocks of a host are after 1970 and before 2554.
    (time.tv_sec.max(0) as u64).saturating_mul(1_000_000_000).saturating_add(time.tv_nsec as u64)
}

/// What time it is at the site.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum Clock {
    /// The host's clock: live lasers and simulators.
    #[default]
    Wall,
    /// A replay in step with time: site = start_site + (monotonic - start_mono) * rate.
    Scaled {
        /// Site time at `start_mono_ns`, UNIX nanoseconds.
        start_site_ns: u64,
        /// CLOCK_MONOTONIC at that moment, nanoseconds.
        start_mono_ns: u64,
        /// Site seconds a second, > 0.
        rate: f64,
    },
    /// A lossless replay: time is what the scans say, no clock runs.
    EventTime,
}

impl Clock {
    /// Site time now, UNIX nanoseconds; `None` in event time. Before the start of a scaled clock
    /// it stands at the start.
    #[must_use]
    pub fn now_ns(&self) -> Option<u64> {
        self.site_at(monotonic_ns(), wall_ns())
    }

    /// The moment of CLOCK_MONOTONIC at which it is `site_ns` at the site, for a deadline; `None` in
    /// event time, where nothing ever is late. A moment of the past is a deadline that is over.
    #[must_use]
    pub fn deadline_mono_ns(&self, site_ns: u64) -> Option<u64> {
        self.mono_at(site_ns, monotonic_ns(), wall_ns())
    }

    fn site_at(&self, mono_ns: u64, wall_ns: u64) -> Option<u64> {
        match *self {
            Self::Wall => Some(wall_ns),
            Self::Scaled { start_site_ns, start_mono_ns, rate } => {
                let elapsed_ns = mono_ns.saturating_sub(start_mono_ns) as f64 * rate;
                Some(start_site_ns.saturating_add(elapsed_ns as u64))
            }
            Self::EventTime => None,
        }
    }

    fn mono_at(&self, site_ns: u64, mono_ns: u64, wall_ns: u64) -> Option<u64> {
        match *self {
            Self::Wall => Some(if site_ns >= wall_ns {
                mono_ns.saturating_add(site_ns - wall_ns)
            } else {
                mono_ns.saturating_sub(wall_ns - site_ns)
            }),
            Self::Scaled { start_site_ns, start_mono_ns, rate } => {
                let elapsed_ns = site_ns.saturating_sub(start_site_ns) as f64 / rate;
                Some(start_mono_ns.saturating_add(elapsed_ns.ceil() as u64))
            }
            Self::EventTime => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_scaled_clock_runs_as_many_times_faster_as_it_says() {
        let clock = Clock::Scaled { start_site_ns: 1_000_000, start_mono_ns: 500, rate: 4.0 };
        assert_eq!(clock.site_at(500, 0), Some(1_000_000));
        assert_eq!(clock.site_at(750, 0), Some(1_001_000));
        assert_eq!(clock.site_at(0, 0), Some(1_000_000), "it stands before its start");
        assert_eq!(clock.mono_at(1_001_000, 0, 0), Some(750));
    }

    #[test]
    fn a_deadline_of_the_scaled_clock_is_not_before_its_site_time() {
        let clock = Clock::Scaled { start_site_ns: 7, start_mono_ns: 11, rate: 3.0 };
        for site_ns in 7..200 {
            let mono_ns = clock.mono_at(site_ns, 0, 0).expect("a scaled clock has deadlines");
            assert!(clock.site_at(mono_ns, 0).expect("and a time") >= site_ns, "{site_ns}");
        }
    }

    #[test]
    fn a_wall_clock_deadline_of_the_past_is_over() {
        assert_eq!(Clock::Wall.mono_at(900, 5_000, 1_000), Some(4_900));
        assert_eq!(Clock::Wall.mono_at(1_100, 5_000, 1_000), Some(5_100));
    }

    #[test]
    fn event_time_has_no_now_and_no_deadline() {
        assert_eq!(Clock::EventTime.now_ns(), None);
        assert_eq!(Clock::EventTime.deadline_mono_ns(5), None);
    }
}
