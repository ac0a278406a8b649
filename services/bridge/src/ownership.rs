//! Which of two hosts runs an area: its own one, or its standby.
//!
//! ```text
//! owner     tells its claim (epoch, owns) twice a second; holds a liveliness token
//! the other takes over when the owner is gone for a while: epoch = the next of its own, stored, then owns
//! two own it (a cut link, healed): the lower epoch yields at once
//! ```
//!
//! Epochs fence: the area's host takes even ones, its standby odd ones, each above all that it knows of.
//! So no two claims are of one epoch, and whoever hears a higher one than its own has lost. An area
//! stays where it is until its owner is lost or stops. A host that hears nobody goes on: a hall that is
//! watched twice is better than one that nobody watches, and what both told is told apart by its origin.
//!
//! Invariants (tests drive two of these against each other through cut links, deaths and restarts):
//! once both hear each other, exactly one owns, and it is the one of the highest epoch; what is owned
//! was stored before.
//!
//! Pure: the time is an argument (CLOCK_MONOTONIC, nanoseconds).

use protocol::time::SECOND_NS;
use serde::{Deserialize, Serialize};

/// An owner whose token is gone is lost after so long: a bridge that was killed is back before.
pub const GONE_NS: u64 = 3 * SECOND_NS / 2;
/// An owner that holds its token and claims nothing for so long hangs.
pub const SILENT_NS: u64 = 4 * SECOND_NS;
/// After the start the host of an area waits so long for a word of the standby, which may own it.
pub const START_NS: u64 = 3 * SECOND_NS;
/// The standby waits longer: both may have been switched on together.
pub const STANDBY_START_NS: u64 = 10 * SECOND_NS;

/// What is stored of an area.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Stored {
    /// The highest epoch that is known.
    pub epoch: u64,
    /// True if this host owned the area in it.
    pub owns: bool,
    /// The run (its start, UNIX nanoseconds) in which it did: another run begins anew.
    pub run: u64,
}

/// What the other host says of the area.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Said {
    /// The highest epoch that it knows of.
    pub epoch: u64,
    /// True if it owns the area.
    pub owns: bool,
    /// True if it stops.
    pub releases: bool,
}

/// The area as one of its two hosts sees it.
#[derive(Debug, Clone)]
pub struct Tenure {
    is_standby: bool,
    run: u64,
    epoch: u64,
    owns: bool,
    /// Whether the other one's token is there, and since when it is as it is.
    alive: bool,
    since_ns: u64,
    heard: Option<(u64, Said)>,
    start_ns: u64,
    released: bool,
}

impl Tenure {
    /// Goes on from what was stored; a bridge that was restarted within the run owns what it owned.
    #[must_use]
    pub fn new(is_standby: bool, stored: Stored, run: u64, mono_ns: u64) -> Self {
        Self {
            is_standby,
            run,
            epoch: stored.epoch,
            owns: stored.owns && stored.run == run,
            alive: false,
            since_ns: mono_ns,
            heard: None,
            start_ns: mono_ns,
            released: false,
        }
    }

    /// True if the area runs here.
    #[must_use]
    pub fn owns(&self) -> bool {
        self.owns
    }

    /// The highest epoch that is known.
    #[must_use]
    pub fn epoch(&self) -> u64 {
        self.epoch
    }

    /// What is to be stored before anything else is done.
    #[must_use]
    pub fn stored(&self) -> Stored {
        Stored { epoch: self.epoch, owns: self.owns, run: self.run }
    }

    /// The other one's token came or went.
    pub fn token(&mut self, alive: bool, mono_ns: u64) {
        if alive != self.alive {
            (self.alive, self.since_ns) = (alive, mono_ns);
        }
    }

    /// The other one claims something.
    pub fn said(&mut self, said: Said, mono_ns: u64) {
        self.heard = Some((mono_ns, said));
        if said.owns && said.epoch > self.epoch {
            self.owns = false;
        }
        self.epoch = self.epoch.max(said.epoch);
    }

    /// What is due: takes the area over if it is time. True if it did.
    pub fn tick(&mut self, mono_ns: u64) -> bool {
        let takes = !self.owns && self.due_ns().is_some_and(|due_ns| mono_ns >= due_ns);
        if takes {
            self.take_over();
        }
        takes
    }

    fn take_over(&mut self) {
        // The next of its own parity, above all that is known.
        let next = self.epoch.saturating_add(1);
        let other_parity = u64::from((next % 2 == 1) != self.is_standby);
        self.epoch = next.saturating_add(other_parity);
        self.owns = true;
    }

    /// When [`Tenure::tick`] takes over, if nothing else is heard.
    #[must_use]
    pub fn due_ns(&self) -> Option<u64> {
        if self.owns || self.released {
            return None;
        }
        let start_ns = if self.is_standby { STANDBY_START_NS } else { START_NS };
        let Some((heard_ns, said)) = self.heard else {
            return Some(self.start_ns.saturating_add(start_ns)); // never heard
        };
        if said.releases {
            return Some(heard_ns);
        }
        let gone_ns = if self.alive { u64::MAX } else { self.since_ns.max(heard_ns) };
        let lost_ns = gone_ns.saturating_add(GONE_NS).min(heard_ns.saturating_add(SILENT_NS));
        if said.owns {
            return Some(lost_ns);
        }
        // Nobody owns it. Its host takes it; the standby does if that does not happen.
        if !self.is_standby {
            return Some(heard_ns);
        }
        Some(lost_ns.min(self.start_ns.saturating_add(start_ns)).max(heard_ns))
    }

    /// This host stops in good order: the other one may take over at once.
    pub fn release(&mut self) {
        (self.owns, self.released) = (false, true);
    }

    /// True after [`Tenure::release`].
    #[must_use]
    pub fn releases(&self) -> bool {
        self.released
    }
}

#[cfg(test)]
#[path = "ownership_tests.rs"]
mod tests;
