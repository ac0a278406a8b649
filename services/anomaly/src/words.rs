//! Events in words that a guard reads: first what happens, where and since when, in one sentence; then
//! what is seen against what is normal; last how sure we are.
//!
//! Times are durations ("for 12 s"): the stamps lie beside the text, and whoever shows them knows the
//! site's time zone.

use crate::life::Happening;
use crate::role::Role;
use crate::sense::Sense;
use protocol::event::{EventKind, EventState};

/// What the words need to know of the calibration.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Certainty {
    pub(crate) budget_per_week: f64,
    pub(crate) extrapolated: bool,
    pub(crate) calibrated_s: f64,
}

/// "12 s", "4 min", "2.5 h", "41 h".
pub(crate) fn duration(seconds: f64) -> String {
    match seconds {
        s if s < 120.0 => format!("{s:.0} s"),
        s if s < 7200.0 => format!("{:.0} min", s / 60.0),
        s if s < 36_000.0 => format!("{:.1} h", s / 3600.0),
        s => format!("{:.0} h", s / 3600.0),
    }
}

/// "till of foyer, at (3.2 m, 4.1 m)".
pub(crate) fn place(area: &str, zone: Option<&str>, at_m: [f64; 2]) -> String {
    let zone = zone.map_or_else(String::new, |zone| format!("{zone} of "));
    format!("{zone}{area}, at ({:.1} m, {:.1} m)", at_m[0], at_m[1])
}

fn size(area_m2: f64) -> String {
    match area_m2 {
        a if a < 0.04 => format!("A small area ({a:.2} m²)"),
        a if a < 0.6 => format!("A person-sized area ({a:.2} m²)"),
        a => format!("An area of {a:.1} m²"),
    }
}

/// How many, or `2.5`, without a needless `.0`.
fn number(value: f64) -> String {
    if value.fract() == 0.0 { format!("{value:.0}") } else { format!("{value:.1}") }
}

/// What a raised or updated happening says. Classes and statistics come last, in parentheses, and
/// once: when it is raised.
pub(crate) fn happening(
    happening: &Happening,
    state: EventState,
    sense: &Sense,
    place: &str,
    stamp_ns: u64,
    certainty: Certainty,
) -> String {
    let age_s = stamp_ns.saturating_sub(happening.first_ns) as f64 * 1e-9;
    let seen = happening.region.as_ref().map(|region| {
        let most = region.slots.iter().enumerate().rev().max_by_key(|(_, cells)| **cells);
        most.map_or(0, |(slot, _)| slot as u8)
    });
    let told = Told {
        kind: happening.kind,
        now: happening.kind_now(stamp_ns),
        seen: seen.map(|slot| sense.roles.role(slot)),
        people: happening.people,
    };
    let mut text = format!("{}: {place}, for {}.", told.plainly(), duration(age_s.max(1.0)));
    let mut classes = String::new();
    if let (Some(region), Some(slot)) = (&happening.region, seen) {
        let cell_m2 = sense.grid.cell_m * sense.grid.cell_m;
        let size = size(f64::from(region.cells) * cell_m2);
        let peak = region.peak as usize;
        text += &format!(" {size}: {}; {}", reading(sense.roles.role(slot)), normally(sense, peak));
        classes = format!("class {}", sense.roles.name(slot));
        if let Some((usual, _)) = sense.normal.usual(peak) {
            classes += &format!(", usually {}", sense.roles.name(usual));
        }
    }
    text + &statistics(state, &classes, happening.score, happening.ratio(), certainty)
}

fn normally(sense: &Sense, cell: usize) -> String {
    let Some((slot, share)) = sense.normal.usual(cell) else {
        return "this place was never seen before.".to_owned();
    };
    let (_, known) = sense.normal.frames(cell, slot);
    format!(
        "normally (in {} % of {}) {}.",
        // 100 % would claim more than a count that has met an exception can.
        number((share * 1000.0).floor() / 10.0),
        duration(known * sense.period_s()),
        usually(sense.roles.role(slot)),
    )
}

/// What a class says of a place now.
fn reading(role: Role) -> &'static str {
    match role {
        Role::Empty => "nothing is there",
        Role::Transit => "something passes by",
        Role::Passing => "something came there a moment ago",
        Role::Lingering => "something has stood there for a short time",
        Role::Vacated => "what stood there for long is not there now",
        Role::Fixed => "something stands there and does not move",
        Role::Unknown => "nothing is observed",
    }
}

/// What a class says of a place all the time.
fn usually(role: Role) -> &'static str {
    match role {
        Role::Empty => "nothing is there",
        Role::Transit | Role::Passing => "somebody passes there",
        Role::Lingering => "somebody stays there for a short time",
        Role::Vacated => "something has just gone from there",
        Role::Fixed => "a wall or a thing stands there",
        Role::Unknown => "it is not observed",
    }
}

/// How sure we are. A score below the level is no reason: it is why an event is not over yet.
fn statistics(
    state: EventState,
    classes: &str,
    score: f64,
    ratio: f64,
    certainty: Certainty,
) -> String {
    let mut parts: Vec<String> = Vec::new();
    if ratio >= 1.0 {
        parts.push(format!("score {score:.1}, {ratio:.1} times the level"));
    }
    if state == EventState::Raised {
        if !classes.is_empty() {
            parts.push(classes.to_owned());
        }
        parts.push(format!(
            "normal life passes the level at most {} times a week, {} {} of calibration",
            number(certainty.budget_per_week),
            if certainty.extrapolated { "extrapolated from" } else { "proven by" },
            duration(certainty.calibrated_s)
        ));
    }
    if parts.is_empty() { String::new() } else { format!(" ({})", parts.join("; ")) }
}

/// What the first sentence is made of.
#[derive(Debug, Clone, Copy)]
struct Told {
    /// The kind of the event: it only gives way to a more telling one.
    kind: EventKind,
    /// What the classes alone say at this moment.
    now: EventKind,
    /// The class of most of what is seen; none right after a restart.
    seen: Option<Role>,
    people: u32,
}

impl Told {
    /// What happens, as one person tells it to another: what was and is over is told as that.
    fn plainly(self) -> String {
        let gone = self.seen.is_some_and(Role::is_absent);
        let words = match self.kind {
            EventKind::UnusualActivity if gone => "Somebody was where people do not go",
            EventKind::UnusualActivity => "Somebody is where people do not go",
            EventKind::Loitering if gone => {
                "Somebody stayed where people do not stay, and has left that place"
            }
            EventKind::Loitering if self.moves() => {
                "Somebody who stayed where people do not stay is moving now"
            }
            EventKind::Loitering => "Somebody stays where people do not stay",
            EventKind::ObjectLeft if gone => "What stood still where nothing stood is gone",
            EventKind::ObjectLeft => {
                "Something stands still where nothing stood, an object or somebody who keeps still"
            }
            EventKind::ObjectMissing => "What always stood here is gone or was moved",
            EventKind::DoorHeldOpen => "A door is held open",
            EventKind::Crowd if self.now != EventKind::Crowd => "A crowd was here and disperses",
            EventKind::Crowd => {
                return format!("Far more people than usual, about {}", self.people);
            }
            fault => fault.words(),
        };
        words.to_owned()
    }

    fn moves(self) -> bool {
        matches!(self.seen, Some(Role::Passing | Role::Transit))
    }
}

/// What a cleared happening says: why it is over, where, and after how long.
pub(crate) fn cleared(why: &str, place: &str, seconds: f64) -> String {
    format!("{why}: {place}, over after {}.", duration(seconds))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_place_is_named_as_people_call_it_and_then_in_metres() {
        let at_m = [8.84, 1.61];
        let corner = place("foyer", Some("south-east corner"), at_m);
        assert_eq!(corner, "south-east corner of foyer, at (8.8 m, 1.6 m)");
        assert_eq!(place("foyer", None, at_m), "foyer, at (8.8 m, 1.6 m)");
        let over = cleared("Nothing unusual is seen any more", &corner, 36.2);
        assert_eq!(
            over,
            "Nothing unusual is seen any more: south-east corner of foyer, at (8.8 m, 1.6 m), over \
             after 36 s."
        );
    }

    #[test]
    fn durations_read_as_a_person_says_them() {
        let said: Vec<String> =
            [3.2, 119.0, 600.0, 9000.0, 147_600.0].into_iter().map(duration).collect();
        assert_eq!(said, ["3 s", "119 s", "10 min", "2.5 h", "41 h"]);
    }

    #[test]
    fn what_is_over_is_not_told_as_if_it_went_on() {
        let told = |kind, now, seen| Told { kind, now, seen: Some(seen), people: 2 }.plainly();
        use EventKind::{Crowd, Loitering, ObjectLeft, UnusualActivity};
        let stays = told(Loitering, Loitering, Role::Lingering);
        assert_eq!(stays, "Somebody stays where people do not stay");
        let left = told(Loitering, Loitering, Role::Vacated);
        assert_eq!(left, "Somebody stayed where people do not stay, and has left that place");
        let walks = told(Loitering, Loitering, Role::Transit);
        assert_eq!(walks, "Somebody who stayed where people do not stay is moving now");
        let taken = told(ObjectLeft, UnusualActivity, Role::Empty);
        assert_eq!(taken, "What stood still where nothing stood is gone");
        assert_eq!(told(Crowd, Crowd, Role::Lingering), "Far more people than usual, about 2");
        assert_eq!(told(Crowd, Loitering, Role::Lingering), "A crowd was here and disperses");
    }

    #[test]
    fn a_score_below_the_level_is_no_reason_and_the_budget_is_told_once() {
        let certainty =
            Certainty { budget_per_week: 20.0, extrapolated: true, calibrated_s: 3600.0 };
        let said =
            |state, ratio| statistics(state, "class transit, usually empty", 8.0, ratio, certainty);
        assert_eq!(
            said(EventState::Raised, 1.2),
            " (score 8.0, 1.2 times the level; class transit, usually empty; normal life passes the \
             level at most 20 times a week, extrapolated from 60 min of calibration)"
        );
        assert_eq!(said(EventState::Updated, 1.2), " (score 8.0, 1.2 times the level)");
        assert_eq!(said(EventState::Updated, 0.9), "");
    }
}
