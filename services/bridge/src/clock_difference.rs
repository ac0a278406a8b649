//! How far the clock of another host is from ours, from the stamps of its messages.
//!
//! `ours at the arrival - stamp = difference + time on the way`, and the way takes 0 or more: so the
//! smallest value of a while is the best one (RFC 5905, section 10, filters by the smallest delay as
//! well). A message that waited behind a cut link says nothing wrong, it only says little.
//!
//! Pure: both times are arguments.

use protocol::time::SECOND_NS;
use std::collections::VecDeque;

/// Two thirds of what a scan may be late (`lateness_max_ms` is 150 unless the site file says
/// otherwise): beyond it, scans of a host whose clock is behind begin to miss their frames.
pub const DIFFERENCE_MAX_NS: i64 = 100_000_000;
/// Values of so long a while are compared.
const WHILE_NS: u64 = 15 * SECOND_NS;
/// So many values are needed before anything is said.
const VALUES_MIN: usize = 8;
/// Most values that are kept: every process of a host speaks once a second, newer ones replace.
const VALUES_MAX: usize = 64;

/// The clock of one other host.
#[derive(Debug, Default)]
pub struct ClockDifference {
    /// When it came (CLOCK_MONOTONIC) and our time less theirs, nanoseconds.
    values: VecDeque<(u64, i64)>,
    is_told: bool,
}

impl ClockDifference {
    /// A message that was stamped `theirs_ns` came when our clock was at `ours_ns` (both UNIX).
    pub fn observe(&mut self, theirs_ns: u64, ours_ns: u64, mono_ns: u64) {
        let is_old = |&(at_ns, _): &(u64, i64)| mono_ns.saturating_sub(at_ns) > WHILE_NS;
        while self.values.front().is_some_and(is_old) || self.values.len() >= VALUES_MAX {
            self.values.pop_front();
        }
        let difference = i128::from(ours_ns) - i128::from(theirs_ns);
        let bounded = difference.clamp(i64::MIN.into(), i64::MAX.into());
        self.values.push_back((mono_ns, bounded as i64));
    }

    /// Nanoseconds that our clock is ahead of theirs; none before enough was heard.
    #[must_use]
    pub fn ahead_ns(&self) -> Option<i64> {
        let enough = self.values.len() >= VALUES_MIN;
        self.values.iter().map(|&(_, difference)| difference).min().filter(|_| enough)
    }

    /// What is wrong between the clocks, if anything is; it is over at half of
    /// [`DIFFERENCE_MAX_NS`], so that it is not told again and again.
    pub fn fault(&mut self, host: &str) -> Option<String> {
        let ahead_ns = self.ahead_ns()?;
        let max_ns = if self.is_told { DIFFERENCE_MAX_NS / 2 } else { DIFFERENCE_MAX_NS };
        self.is_told = ahead_ns.unsigned_abs() > max_ns.unsigned_abs();
        self.is_told.then(|| {
            let seconds = ahead_ns.unsigned_abs() as f64 / 1e9;
            let behind = if ahead_ns > 0 { "behind" } else { "ahead of" };
            format!(
                "the clock of host {host} is {seconds:.2} s {behind} this one, expected at most \
                 {:.2} s: scans of one host are late on the other. Look at `chronyc tracking` on both",
                DIFFERENCE_MAX_NS as f64 / 1e9
            )
        })
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    /// Ten messages a second apart, each `delays_ms` on the way, of a clock `ahead_ms` ahead of ours.
    fn heard(clock: &mut ClockDifference, from_s: u64, ahead_ms: i64, delays_ms: [u64; 10]) {
        for (n, delay_ms) in delays_ms.into_iter().enumerate() {
            let mono_ns = (from_s + n as u64) * SECOND_NS;
            let ours_ns = 1_795_000_000 * SECOND_NS + mono_ns;
            let theirs_ns = ours_ns.saturating_add_signed(ahead_ms * MS as i64) - delay_ms * MS;
            clock.observe(theirs_ns, ours_ns, mono_ns);
        }
    }

    #[test]
    fn messages_that_waited_are_no_wrong_clock() {
        let mut clock = ClockDifference::default();
        heard(&mut clock, 0, 0, [5000, 4000, 3000, 2000, 1000, 1, 2, 900, 1, 30]);
        assert_eq!((clock.ahead_ns(), clock.fault("edge")), (Some(MS as i64), None));
    }

    #[test]
    fn a_clock_that_is_off_is_told_until_it_is_right_again() {
        let mut clock = ClockDifference::default();
        heard(&mut clock, 0, -250, [1, 40, 1, 2, 3, 1, 1, 1, 1, 1]);
        let text = clock.fault("edge").unwrap();
        assert!(text.starts_with("the clock of host edge is 0.25 s behind this one"), "{text}");
        heard(&mut clock, 30, -80, [1; 10]);
        assert!(clock.fault("edge").is_some(), "still more than half");
        heard(&mut clock, 60, 0, [1; 10]);
        assert_eq!(clock.fault("edge"), None);
        heard(&mut clock, 90, 3000, [1; 10]);
        assert!(clock.fault("edge").unwrap().contains("is 3.00 s ahead of this one"));
    }

    #[test]
    fn nothing_is_said_before_enough_was_heard_and_no_stamp_is_a_panic() {
        let mut clock = ClockDifference::default();
        for n in 0..VALUES_MIN as u64 - 1 {
            clock.observe([0, u64::MAX][n as usize % 2], 1, n);
        }
        assert_eq!(clock.fault("edge"), None);
        (0..1000).for_each(|n| clock.observe(u64::MAX, 0, n));
        assert!(clock.fault("edge").is_some());
        assert_eq!(clock.values.len(), VALUES_MAX);
    }
}
