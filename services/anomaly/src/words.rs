//! Events in words that a guard reads: first what happens, where and since when, in one sentence; then
//! what is seen against what is normal; last how sure we are.
//!
//! Times are durations ("for 12 s"): the stamps lie beside the text, and whoever shows them knows the
//! site's time zone.

use crate::life::Happening;
use crate::sense::Sense;
use protocol::event::EventKind;

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

/// What a raised or updated happening says.
pub(crate) fn happening(
    happening: &Happening,
    sense: &Sense,
    place: &str,
    stamp_ns: u64,
    certainty: Certainty,
) -> String {
    let age_s = stamp_ns.saturating_sub(happening.first_ns) as f64 * 1e-9;
    let what = plainly(happening.kind, happening.people as usize);
    let mut text = format!("{what}: {place}, for {}.", duration(age_s.max(1.0)));
    if let Some(region) = &happening.region {
        let cell_m2 = sense.grid.cell_m * sense.grid.cell_m;
        let (slot, _) = region.slots.iter().enumerate().fold((0, 0), |best, (slot, count)| {
            if *count > best.1 { (slot, *count) } else { best }
        });
        text += &format!(
            " {} reads `{}`; ",
            size(f64::from(region.cells) * cell_m2),
            sense.roles.name(slot as u8)
        );
        text += &normal_here(sense, region.peak as usize);
    }
    text + &format!(
        " Score {:.1}, {:.1} times the level that normal life passes at most {} times a week{}.",
        happening.score,
        happening.ratio(),
        number(certainty.budget_per_week),
        basis(certainty),
    )
}

fn normal_here(sense: &Sense, cell: usize) -> String {
    let Some((slot, share)) = sense.normal.usual(cell) else {
        return "this place was never seen before.".to_owned();
    };
    let (_, known) = sense.normal.frames(cell, slot);
    format!(
        "here {} % of {} is `{}`.",
        // 100 % would claim more than a count that has met an exception can.
        number((share * 1000.0).floor() / 10.0),
        duration(known * sense.period_s()),
        sense.roles.name(slot)
    )
}

/// What happens, as one person tells it to another.
fn plainly(kind: EventKind, people: usize) -> String {
    let words = match kind {
        EventKind::UnusualActivity => "Somebody is where people do not go",
        EventKind::Loitering => "Somebody stays where people do not stay",
        EventKind::ObjectLeft => {
            "Something stands still where nothing stood, an object or somebody who keeps still"
        }
        EventKind::ObjectMissing => "What always stood here is gone or was moved",
        EventKind::DoorHeldOpen => "A door is held open",
        EventKind::Crowd => return format!("Far more people than usual, about {people}"),
        fault => fault.words(),
    };
    words.to_owned()
}

fn basis(certainty: Certainty) -> String {
    let calibrated = duration(certainty.calibrated_s);
    if certainty.extrapolated {
        format!(" (extrapolated: {calibrated} of calibration are too short to prove it)")
    } else {
        format!(" (proven by {calibrated} of calibration)")
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
}
