//! A fault is not an intrusion, and silence is not peace: lasers that are silent, and coverage that
//! is lost. Both are debounced both ways; both are told in every phase.

use protocol::time::SECOND_NS;

/// A laser that has been absent for longer than `laser_lost` plus this is silent.
pub(crate) const SILENT_DEBOUNCE_NS: u64 = SECOND_NS;
/// Processes of a host start one after the other: a laser gets this long to deliver its first scan.
pub(crate) const START_GRACE_NS: u64 = 10 * SECOND_NS;
/// A laser is back when it was present for this long.
pub(crate) const BACK_DEBOUNCE_NS: u64 = 2 * SECOND_NS;
/// Share of the covered cells that are unknown, from which coverage is lost, and below which it is
/// restored.
pub(crate) const LOST_SHARE: f64 = 0.20;
pub(crate) const RESTORED_SHARE: f64 = 0.10;
/// Debounce of lost coverage, both ways: longer than somebody needs to walk by a laser.
pub(crate) const COVERAGE_DEBOUNCE_NS: u64 = 10 * SECOND_NS;

/// A condition that must hold for a time before it counts, both ways.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct Debounced {
    /// Number of the open event.
    pub(crate) event: Option<u64>,
    /// Since which stamp the condition differs from `event`.
    since_ns: Option<u64>,
}

/// What became of a debounced condition.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Turn {
    /// Nothing changed.
    Stays,
    /// It holds; first seen at this stamp.
    Begins(u64),
    /// It ended; the event's number.
    Ends(u64),
}

impl Debounced {
    pub(crate) fn restored(event: u64) -> Self {
        Self { event: Some(event), since_ns: None }
    }

    /// Takes the condition at a stamp: `Some(true)` it is wrong, `Some(false)` it is well, `None` between.
    pub(crate) fn observe(
        &mut self,
        wrong: Option<bool>,
        stamp_ns: u64,
        begin_ns: u64,
        end_ns: u64,
    ) -> Turn {
        let differs = wrong == Some(self.event.is_none());
        if !differs {
            self.since_ns = None;
            return Turn::Stays;
        }
        let since_ns = *self.since_ns.get_or_insert(stamp_ns);
        let debounce_ns = if self.event.is_none() { begin_ns } else { end_ns };
        if stamp_ns.saturating_sub(since_ns) < debounce_ns {
            return Turn::Stays;
        }
        self.since_ns = None;
        match self.event.take() {
            Some(number) => Turn::Ends(number),
            None => Turn::Begins(since_ns),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flicker_is_nothing_and_a_lasting_fault_begins_and_ends_once() {
        let mut fault = Debounced::default();
        let mut story = Vec::new();
        for (second, mark) in "..x.xxxxxx.x.x....x..".chars().enumerate() {
            let stamp_ns = second as u64 * SECOND_NS;
            match fault.observe(Some(mark == 'x'), stamp_ns, 3 * SECOND_NS, 2 * SECOND_NS) {
                Turn::Stays => {}
                Turn::Begins(since_ns) => {
                    fault.event = Some(7);
                    story.push((second as u64, since_ns / SECOND_NS));
                }
                Turn::Ends(number) => story.push((second as u64, number)),
            }
        }
        assert_eq!(story, [(7, 4), (16, 7)]);
    }
}
