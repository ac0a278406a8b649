//! When a scan goes out. Pure: the site's time is an argument.
//!
//! A scan is due when it is `stamp_ns` at the site. Deadlines are stamps, never "the last one plus a
//! period", so a laser of 75 Hz does not drift however late the process wakes.

/// What to do with the next scan.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Turn {
    /// It is due: send it.
    Send,
    /// Sleep until it is this late at the site, UNIX nanoseconds.
    WaitUntil(u64),
    /// Its time is over by more than a frame would take it: do not send it.
    Skip,
}

/// Decides on a scan stamped `stamp_ns` when it is `now_ns` at the site.
///
/// `now_ns` is `None` in a lossless replay, where every scan is due at once and none is late. A scan
/// that is older than `age_max_ns` is in no frame that is still to come (semantics.md, "Frames"): after
/// a stall (a sleeping host, a replay that is faster than the disk) old scans would only push newer
/// ones out of the queue.
#[must_use]
pub fn turn(stamp_ns: u64, now_ns: Option<u64>, age_max_ns: u64) -> Turn {
    match now_ns {
        None => Turn::Send,
        Some(now_ns) if stamp_ns > now_ns => Turn::WaitUntil(stamp_ns),
        Some(now_ns) if now_ns - stamp_ns > age_max_ns => Turn::Skip,
        Some(_) => Turn::Send,
    }
}

/// Scans a second, measured once a second or more.
#[derive(Debug, Clone, Copy, Default)]
pub struct RateMeter {
    since: Option<(u64, u64)>,
}

impl RateMeter {
    /// Takes the total so far at `mono_ns` of a clock that does not step; the rate since the last time
    /// that this returned one, if that is a second ago.
    pub fn measure(&mut self, total: u64, mono_ns: u64) -> Option<f64> {
        let (total_then, mono_then) = *self.since.get_or_insert((total, mono_ns));
        let elapsed_ns = mono_ns.saturating_sub(mono_then);
        if elapsed_ns < protocol::time::SECOND_NS {
            return None;
        }
        self.since = Some((total, mono_ns));
        Some(total.saturating_sub(total_then) as f64 * 1e9 / elapsed_ns as f64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_scan_goes_out_at_its_stamp_and_not_long_after() {
        assert_eq!(turn(1_000, Some(999), 250), Turn::WaitUntil(1_000));
        assert_eq!(turn(1_000, Some(1_000), 250), Turn::Send);
        assert_eq!(turn(1_000, Some(1_250), 250), Turn::Send);
        assert_eq!(turn(1_000, Some(1_251), 250), Turn::Skip);
        assert_eq!(turn(1_000, None, 250), Turn::Send);
    }

    #[test]
    fn the_rate_is_that_of_the_last_second_or_more() {
        let mut meter = RateMeter::default();
        assert_eq!(meter.measure(10, 0), None);
        assert_eq!(meter.measure(40, 500_000_000), None);
        assert_eq!(meter.measure(160, 2_000_000_000), Some(75.0));
        assert_eq!(meter.measure(160, 3_000_000_000), Some(0.0));
    }
}
