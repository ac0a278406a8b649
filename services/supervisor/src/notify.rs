//! What systemd is told (sd_notify(3), `Type=notify`): that the site works, that it still does, and how
//! it is. Without systemd nothing is told to anybody.
//!
//! - `READY=1` when every process has told its health and frames flow; at the latest after
//!   [`READY_NS`], because a site without its lasers must run, to say that they are silent.
//! - `WATCHDOG=1` only from the loop that takes the health of the processes, and only when it took some:
//!   each of them tells it from its own data loop. A timer would prove nothing.
//!
//! The words are pure: the time is an argument (CLOCK_MONOTONIC, nanoseconds).

use protocol::time::SECOND_NS;
use sd_notify::NotifyState;

/// Without frames the site is ready after so long all the same.
pub const READY_NS: u64 = 30 * SECOND_NS;

/// How the site is, as far as systemd is concerned.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Look {
    /// Every process that is to run has told its health.
    pub all_told: bool,
    /// Frames flow in an area, or none runs here.
    pub frames: bool,
    /// In half a sentence.
    pub headline: String,
}

/// A word for systemd.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Word {
    /// The site works.
    Ready,
    /// It still does.
    Watchdog,
    /// How it is.
    Status(String),
    /// It stops.
    Stopping,
}

/// Says each thing when it is due.
#[derive(Debug)]
pub struct Notifier {
    start_ns: u64,
    ready: bool,
    stopping: bool,
    /// Half of what systemd waits for.
    period_ns: Option<u64>,
    fed_ns: u64,
    headline: String,
}

impl Notifier {
    /// Begins at this time; `watchdog_ns` is how long systemd waits for a sign of life.
    #[must_use]
    pub fn new(watchdog_ns: Option<u64>, mono_ns: u64) -> Self {
        Self {
            start_ns: mono_ns,
            ready: false,
            stopping: false,
            period_ns: watchdog_ns.map(|wait_ns| wait_ns / 2),
            fed_ns: 0,
            headline: String::new(),
        }
    }

    /// Begins now, as systemd wants it.
    #[must_use]
    pub fn of_environment(mono_ns: u64) -> Self {
        let watchdog = sd_notify::watchdog_enabled();
        Self::new(watchdog.map(|wait| wait.as_nanos() as u64), mono_ns)
    }

    /// What is due, after health was taken (`heard`) or not.
    pub fn words(&mut self, look: &Look, heard: bool, mono_ns: u64) -> Vec<Word> {
        let mut words = Vec::new();
        let waited = mono_ns.saturating_sub(self.start_ns) >= READY_NS;
        if !self.ready && look.all_told && (look.frames || waited) {
            self.ready = true;
            words.push(Word::Ready);
        }
        let is_due = self.period_ns.is_some_and(|period_ns| mono_ns >= self.fed_ns + period_ns);
        if heard && is_due {
            self.fed_ns = mono_ns;
            words.push(Word::Watchdog);
        }
        if look.headline != self.headline {
            self.headline.clone_from(&look.headline);
            words.push(Word::Status(look.headline.clone()));
        }
        words
    }

    /// The site stops; said once.
    pub fn stopping(&mut self) -> Vec<Word> {
        if std::mem::replace(&mut self.stopping, true) { Vec::new() } else { vec![Word::Stopping] }
    }
}

/// Tells them; what systemd does not take is lost, as everything that nobody reads.
pub fn tell(words: &[Word]) {
    let states = words.iter().map(|word| match word {
        Word::Ready => NotifyState::Ready,
        Word::Watchdog => NotifyState::Watchdog,
        Word::Status(text) => NotifyState::Status(text),
        Word::Stopping => NotifyState::Stopping,
    });
    let states: Vec<_> = states.collect();
    if !states.is_empty() {
        let _ = sd_notify::notify(&states);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn look(all_told: bool, frames: bool) -> Look {
        Look { all_told, frames, headline: String::new() }
    }

    #[test]
    fn a_site_is_ready_when_all_are_there_and_frames_flow_or_it_has_waited_long() {
        let mut notifier = Notifier::new(None, 5);
        assert_eq!(notifier.words(&look(false, true), true, 6), []);
        assert_eq!(notifier.words(&look(true, false), true, 7), []);
        assert_eq!(notifier.words(&look(true, true), true, 8), [Word::Ready]);
        assert_eq!(notifier.words(&look(true, true), true, 9), [], "once");
        let mut blind = Notifier::new(None, 5);
        assert_eq!(blind.words(&look(true, false), true, 4 + READY_NS), []);
        assert_eq!(blind.words(&look(true, false), true, 5 + READY_NS), [Word::Ready]);
    }

    #[test]
    fn the_watchdog_is_fed_by_health_and_by_nothing_else() {
        let mut notifier = Notifier::new(Some(10 * SECOND_NS), 0);
        let all = look(false, false);
        let at = |seconds: u64| seconds * SECOND_NS;
        assert_eq!(notifier.words(&all, true, at(5)), [Word::Watchdog]);
        assert_eq!(notifier.words(&all, true, at(9)), []);
        assert_eq!(notifier.words(&all, false, at(60)), [], "nobody told its health");
        assert_eq!(notifier.words(&all, true, at(60)), [Word::Watchdog]);
    }

    #[test]
    fn how_it_is_is_told_when_it_changes() {
        let mut notifier = Notifier::new(None, 0);
        let well = Look { headline: "all is well".to_owned(), ..Look::default() };
        assert_eq!(notifier.words(&well, true, 1), [Word::Status("all is well".to_owned())]);
        assert_eq!(notifier.words(&well, true, 2), []);
        assert_eq!((notifier.stopping(), notifier.stopping()), (vec![Word::Stopping], vec![]));
    }
}
