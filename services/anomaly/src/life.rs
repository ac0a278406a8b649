//! The life of happenings: candidate -> raised -> updated -> cleared.
//!
//! A region belongs to the told happening that is nearest, within [`MERGE_M`] and [`MERGE_NS`]; else to
//! the nearest candidate; else it is one. What was open when the process ended may have walked on since
//! its last change: until it is seen again it reaches as far as somebody walks in that time. A candidate that stays above its level for [`Life::persist_frames`] frames is raised. A
//! happening lives while a region reaches [`OFF`] of the level, and is cleared [`QUIET_NS`] after the last
//! one. What comes back within [`MERGE_NS`] is the same happening: it is *updated*, so that after a
//! `cleared` an `updated` opens it again; the last change tells how it stands.

use crate::place::{Bounds, bounds_of, gap_m, point_m, union};
use crate::sense::{Region, Test};
use protocol::event::{EventChange, EventKind, EventState};
use protocol::geometry::GridGeometry;
use protocol::time::SECOND_NS;

/// Share of the level at which a happening goes on.
pub(crate) const OFF: f64 = 0.7;
pub(crate) const QUIET_NS: u64 = 10 * SECOND_NS;
const MERGE_NS: u64 = 60 * SECOND_NS;
const MERGE_M: f64 = 2.0;
/// How fast people walk on while nobody looks, metres a second, and for how long that is believed: a
/// move of [`MOVED_M`] is told after [`UPDATE_NS`] at the latest, so a last change is not much older.
const WALK_M_S: f64 = 1.5;
const WALKED_ON_NS: u64 = UPDATE_NS;
/// Least time between two updates that do not change the kind.
const UPDATE_NS: u64 = 10 * SECOND_NS;
/// An update is worth telling if the place moved by this, metres, or the score grew by this.
const MOVED_M: f64 = 2.0;
const GREW: f64 = 1.5;
/// Somebody who is unusual for this long within this distance of where it began loiters.
const STAY_NS: u64 = 20 * SECOND_NS;
const STAY_M: f64 = 2.5;
/// Unusual people at once that are a crowd.
const CROWD: u32 = 5;
/// Two standing legs closer than this are one person, metres; people this near to the centre count.
const PERSON_M: f64 = 0.5;
const CROWD_M: f64 = 2.5;
/// What keeps still does not go away: if it moves by this, metres, it was somebody.
const WALKED_M: f64 = 0.7;
/// When a happening was seen that was open when the process ended: at the first frame, at best.
const NOT_YET: u64 = u64::MAX;
/// More people are a crowd all the same.
const PEOPLE_MAX: usize = 32;
/// Most happenings at once: a guard cannot attend to more; what exceeds it is counted.
const HAPPENINGS_MAX: usize = 64;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Stage {
    /// Frames in a row above the level.
    Candidate(u32),
    Open,
    /// Cleared; frames in a row above the level since.
    Quiet(u32),
}

/// A happening in the building.
#[derive(Debug, Clone)]
pub(crate) struct Happening {
    /// Of its id; 0 for a candidate.
    pub(crate) number: u64,
    pub(crate) kind: EventKind,
    pub(crate) stage: Stage,
    pub(crate) first_ns: u64,
    pub(crate) seen_ns: u64,
    pub(crate) bounds: Bounds,
    /// Everywhere it was: nothing is learnt there.
    pub(crate) trail: Bounds,
    pub(crate) centre_m: [f64; 2],
    start_m: [f64; 2],
    /// Where it kept still when it was taken for an object.
    still_m: [f64; 2],
    /// The strongest region of the last frame with one; `None` after a restart.
    pub(crate) region: Option<Region>,
    pub(crate) score: f64,
    pub(crate) level: f64,
    pub(crate) people: u32,
    told_kind: EventKind,
    told_ns: u64,
    told_m: [f64; 2],
    told_ratio: f64,
    quiet_ns: u64,
    /// How far it may have walked while nobody looked, metres; 0 once it was seen.
    unwatched_m: f64,
}

/// Levels of both tests.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Levels {
    pub(crate) space: f64,
    pub(crate) time: f64,
}

impl Levels {
    fn of(&self, test: Test) -> f64 {
        match test {
            Test::Space => self.space,
            Test::Time => self.time,
        }
    }
}

/// What a frame adds to one happening.
#[derive(Debug, Clone, Copy)]
struct Share {
    owner: usize,
    bounds: Bounds,
    best: Region,
    ratio: f64,
}

/// All happenings of an area.
#[derive(Debug, Clone)]
pub(crate) struct Life {
    grid: GridGeometry,
    persist_frames: u32,
    pub(crate) happenings: Vec<Happening>,
    shares: Vec<Share>,
    /// Candidates that found no room.
    pub(crate) dropped: u64,
}

impl Life {
    pub(crate) fn new(grid: GridGeometry, persist_frames: u32) -> Self {
        Self { grid, persist_frames, happenings: Vec::new(), shares: Vec::new(), dropped: 0 }
    }

    /// Goes on with an event that was open when the process ended, given its last change.
    pub(crate) fn resume(&mut self, number: u64, change: &EventChange) {
        let centre_m = [change.x_m, change.y_m];
        self.happenings.push(Happening {
            number,
            kind: change.kind,
            stage: Stage::Open,
            first_ns: change.first_evidence_ns,
            seen_ns: NOT_YET,
            bounds: change.bounds_m,
            trail: change.bounds_m,
            centre_m,
            start_m: centre_m,
            still_m: centre_m,
            region: None,
            score: change.score,
            level: change.threshold,
            people: 1,
            told_kind: change.kind,
            told_ns: change.stamp_ns,
            told_m: centre_m,
            told_ratio: change.score / change.threshold.max(1e-9),
            // Charges start anew: what only the time test sees needs a minute to show again.
            quiet_ns: MERGE_NS,
            unwatched_m: 0.0,
        });
    }

    /// Time begins anew at `stamp_ns`, before what was seen last.
    pub(crate) fn rebase(&mut self, stamp_ns: u64) {
        for happening in &mut self.happenings {
            happening.seen_ns = happening.seen_ns.min(stamp_ns);
            happening.told_ns = happening.told_ns.min(stamp_ns);
        }
    }

    /// Takes the regions of a frame (each at least [`OFF`] of its level); `all` are those of the
    /// space test at any level, to count people by. Calls `tell` with every
    /// happening that changed and how; `tell` gives a raised one its number.
    pub(crate) fn step(
        &mut self,
        stamp_ns: u64,
        regions: impl Iterator<Item = Region>,
        all: &[Region],
        levels: Levels,
        mut tell: impl FnMut(&mut Happening, EventState),
    ) {
        self.shares.clear();
        for resumed in self.happenings.iter_mut().filter(|known| known.seen_ns == NOT_YET) {
            resumed.resume(stamp_ns);
        }
        for region in regions {
            self.assign(stamp_ns, region, levels);
        }
        for index in 0..self.happenings.len() {
            let share = self.shares.iter().find(|share| share.owner == index).copied();
            let happening = &mut self.happenings[index];
            if let Some(share) = share {
                happening.take(&self.grid, &share, all, levels, stamp_ns);
            }
            let above = share.is_some_and(|share| share.ratio >= 1.0);
            let sudden = share.is_some_and(|share| share.best.test == Test::Time);
            let state = happening.turn(stamp_ns, above, sudden, self.persist_frames);
            if let Some(state) = state {
                tell(happening, state);
                happening.told_kind = happening.kind;
                happening.told_ns = stamp_ns;
                happening.told_m = happening.centre_m;
                happening.told_ratio = happening.ratio();
            }
        }
        self.happenings.retain(|happening| {
            let age_ns = stamp_ns.saturating_sub(happening.seen_ns);
            match happening.stage {
                Stage::Candidate(_) => age_ns <= SECOND_NS,
                Stage::Open => true,
                Stage::Quiet(_) => age_ns <= MERGE_NS,
            }
        });
    }

    /// Finds the happening that a region belongs to, or makes a candidate.
    fn assign(&mut self, stamp_ns: u64, region: Region, levels: Levels) {
        let bounds = bounds_of(&self.grid, region.span);
        let mut ratio = region.score / levels.of(region.test).max(1e-9);
        if region.counted == 0 {
            // What is over goes on for a while; it does not begin.
            ratio = ratio.min(0.99);
        }
        let nearest = self
            .happenings
            .iter()
            .enumerate()
            .filter(|(_, known)| stamp_ns.saturating_sub(known.seen_ns) <= MERGE_NS)
            .map(|(index, known)| (index, known, gap_m(bounds, known.bounds)))
            .filter(|(_, known, gap)| *gap <= MERGE_M + known.unwatched_m)
            .min_by(|a, b| a.1.is_candidate().cmp(&b.1.is_candidate()).then(a.2.total_cmp(&b.2)));
        let owner = match nearest {
            Some((index, _, _)) => index,
            None if ratio < 1.0 => return,
            None if self.happenings.len() >= HAPPENINGS_MAX => {
                self.dropped += 1;
                return;
            }
            None => {
                self.happenings.push(Happening::candidate(&self.grid, &region, bounds, stamp_ns));
                self.happenings.len() - 1
            }
        };
        let Some(share) = self.shares.iter_mut().find(|share| share.owner == owner) else {
            self.shares.push(Share { owner, bounds, best: region, ratio });
            return;
        };
        share.bounds = union(share.bounds, bounds);
        if ratio > share.ratio {
            (share.best, share.ratio) = (region, ratio);
        }
    }
}

impl Happening {
    fn candidate(grid: &GridGeometry, region: &Region, bounds: Bounds, stamp_ns: u64) -> Self {
        let centre_m = point_m(grid, region.centre);
        Self {
            number: 0,
            kind: EventKind::UnusualActivity,
            stage: Stage::Candidate(0),
            first_ns: stamp_ns,
            seen_ns: stamp_ns,
            bounds,
            trail: bounds,
            centre_m,
            start_m: centre_m,
            still_m: centre_m,
            region: None,
            score: 0.0,
            level: 1.0,
            people: 1,
            told_kind: EventKind::UnusualActivity,
            told_ns: 0,
            told_m: centre_m,
            told_ratio: 0.0,
            quiet_ns: QUIET_NS,
            unwatched_m: 0.0,
        }
    }

    fn is_candidate(&self) -> bool {
        matches!(self.stage, Stage::Candidate(_))
    }

    /// The first frame after a restart.
    fn resume(&mut self, stamp_ns: u64) {
        self.seen_ns = stamp_ns;
        if rank(self.kind) < rank(EventKind::ObjectLeft) {
            let unwatched_ns = stamp_ns.saturating_sub(self.told_ns).min(WALKED_ON_NS);
            self.unwatched_m = WALK_M_S * unwatched_ns as f64 / SECOND_NS as f64;
        }
    }

    /// Score in levels.
    pub(crate) fn ratio(&self) -> f64 {
        self.score / self.level.max(1e-9)
    }

    fn take(
        &mut self,
        grid: &GridGeometry,
        share: &Share,
        all: &[Region],
        levels: Levels,
        stamp_ns: u64,
    ) {
        self.seen_ns = stamp_ns;
        self.unwatched_m = 0.0;
        self.bounds = share.bounds;
        self.trail = union(self.trail, share.bounds);
        self.centre_m = point_m(grid, share.best.centre);
        self.score = share.best.score;
        self.level = levels.of(share.best.test);
        self.region = Some(whole(all, &share.best));
        self.people = people(grid, all, self.centre_m);
        let kind = self.kind_now(stamp_ns);
        if kind == EventKind::ObjectLeft && self.kind != kind {
            self.still_m = self.centre_m;
        }
        let moves = rank(kind) < rank(EventKind::ObjectLeft);
        if self.kind == EventKind::ObjectLeft
            && moves
            && distance_m(self.centre_m, self.still_m) >= WALKED_M
        {
            self.kind = EventKind::Loitering;
        } else if rank(kind) > rank(self.kind) {
            self.kind = kind;
        }
    }

    /// What the classes of the strongest region say.
    pub(crate) fn kind_now(&self, stamp_ns: u64) -> EventKind {
        let Some(region) = &self.region else {
            return self.kind;
        };
        let stays = stamp_ns.saturating_sub(self.first_ns) >= STAY_NS
            && distance_m(self.centre_m, self.start_m) <= STAY_M;
        if self.people >= CROWD {
            EventKind::Crowd
        } else if 2 * region.gone >= region.cells {
            EventKind::ObjectMissing
        } else if 2 * region.fixed >= region.cells {
            EventKind::ObjectLeft
        } else if stays || 2 * (region.lingering + region.fixed) >= region.cells {
            EventKind::Loitering
        } else {
            EventKind::UnusualActivity
        }
    }

    /// The next stage, and what is to be told.
    fn turn(
        &mut self,
        stamp_ns: u64,
        above: bool,
        sudden: bool,
        persist_frames: u32,
    ) -> Option<EventState> {
        let unseen_ns = stamp_ns.saturating_sub(self.seen_ns);
        match &mut self.stage {
            Stage::Candidate(frames) | Stage::Quiet(frames) => {
                *frames = if above { *frames + 1 } else { 0 };
                // The time test has waited long enough by itself.
                if *frames < persist_frames && !(above && sudden) {
                    return None;
                }
                let again = matches!(self.stage, Stage::Quiet(_));
                self.stage = Stage::Open;
                Some(if again { EventState::Updated } else { EventState::Raised })
            }
            Stage::Open if unseen_ns >= self.quiet_ns => {
                self.stage = Stage::Quiet(0);
                Some(EventState::Cleared)
            }
            Stage::Open => self.is_news(stamp_ns).then_some(EventState::Updated),
        }
    }

    fn is_news(&self, stamp_ns: u64) -> bool {
        self.told_kind != self.kind
            || (self.seen_ns == stamp_ns
                && stamp_ns.saturating_sub(self.told_ns) >= UPDATE_NS
                && (distance_m(self.centre_m, self.told_m) >= MOVED_M
                    || self.ratio() >= GREW * self.told_ratio))
    }
}

/// The component that a region is part of: charged cells are often but the core of what stands there.
fn whole(all: &[Region], region: &Region) -> Region {
    let [c0, r0, c1, r1] = region.span;
    let holds = |other: &&Region| {
        let [a0, b0, a1, b1] = other.span;
        a0 <= c1 && c0 <= a1 && b0 <= r1 && r0 <= b1
    };
    let widest = all.iter().filter(holds).max_by_key(|other| other.cells);
    widest.filter(|other| other.cells >= region.cells).copied().unwrap_or(*region)
}

/// People who stand within [`CROWD_M`] of a point, by their legs: regions of presence that are not a
/// trail, those of one person taken together.
fn people(grid: &GridGeometry, all: &[Region], at_m: [f64; 2]) -> u32 {
    let mut found: [[f64; 2]; PEOPLE_MAX] = [[0.0; 2]; PEOPLE_MAX];
    let mut count = 0;
    for region in all {
        let stands = 2 * (region.lingering + region.fixed) >= region.cells && region.gone == 0;
        let leg_m = point_m(grid, region.centre);
        let new = found[..count].iter().all(|other| distance_m(*other, leg_m) > PERSON_M);
        if stands && new && distance_m(at_m, leg_m) <= CROWD_M && count < PEOPLE_MAX {
            found[count] = leg_m;
            count += 1;
        }
    }
    count.max(1) as u32
}

fn distance_m(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

/// A kind only gives way to a more telling one.
fn rank(kind: EventKind) -> u8 {
    match kind {
        EventKind::UnusualActivity => 0,
        EventKind::Loitering => 1,
        EventKind::ObjectLeft | EventKind::ObjectMissing => 2,
        _ => 3,
    }
}

#[cfg(test)]
#[path = "life_tests.rs"]
mod tests;
