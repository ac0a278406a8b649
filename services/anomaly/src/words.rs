//! Events in words that a guard reads: where, since when, what is seen against what is normal, how sure.
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

/// "in zone `till`, at (3.2 m, 4.1 m)".
pub(crate) fn place(zone: Option<&str>, at_m: [f64; 2]) -> String {
    let point = format!("at ({:.1} m, {:.1} m)", at_m[0], at_m[1]);
    zone.map_or(point.clone(), |zone| format!("in zone `{zone}`, {point}"))
}

fn size(area_m2: f64) -> String {
    match area_m2 {
        a if a < 0.04 => format!("a small area ({a:.2} m²)"),
        a if a < 0.6 => format!("a person-sized area ({a:.2} m²)"),
        a => format!("an area of {a:.1} m²"),
    }
}

fn capital(words: &str) -> String {
    let mut letters = words.chars();
    letters.next().map_or_else(String::new, |first| first.to_uppercase().chain(letters).collect())
}

/// How many, or `2.5`, without a needless `.0`.
fn number(value: f64) -> String {
    if value.fract() == 0.0 { format!("{value:.0}") } else { format!("{value:.1}") }
}

/// What a raised or updated happening says.
pub(crate) fn happening(
    happening: &Happening,
    sense: &Sense,
    zone: Option<&str>,
    stamp_ns: u64,
    certainty: Certainty,
) -> String {
    let age_s = stamp_ns.saturating_sub(happening.first_ns) as f64 * 1e-9;
    let mut text = format!(
        "{} {}, for {}: ",
        capital(happening.kind.words()),
        place(zone, happening.centre_m),
        duration(age_s.max(1.0)),
    );
    if let Some(region) = &happening.region {
        let cell_m2 = sense.grid.cell_m * sense.grid.cell_m;
        let (slot, _) = region.slots.iter().enumerate().fold((0, 0), |best, (slot, count)| {
            if *count > best.1 { (slot, *count) } else { best }
        });
        text += &format!(
            "{} reads `{}`; ",
            size(f64::from(region.cells) * cell_m2),
            sense.roles.name(slot as u8)
        );
        text += &normal_here(sense, region.peak as usize);
        text += explanation(happening.kind);
        if happening.kind == EventKind::Crowd {
            text += &format!(" About {} people.", happening.people);
        }
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
        "here {:.1} % of {} is `{}`.",
        // 100.0 % would claim more than a count that has met an exception can.
        (share * 1000.0).floor() / 10.0,
        duration(known * sense.period_s()),
        sense.roles.name(slot)
    )
}

fn explanation(kind: EventKind) -> &'static str {
    match kind {
        EventKind::ObjectLeft => {
            " Something stands there and does not move: an object, or somebody who keeps still."
        }
        EventKind::ObjectMissing => " What always stood there is gone or was moved.",
        EventKind::Loitering => " Somebody stays where people do not stay.",
        EventKind::UnusualActivity => " Somebody is where people do not go.",
        _ => "",
    }
}

fn basis(certainty: Certainty) -> String {
    let calibrated = duration(certainty.calibrated_s);
    if certainty.extrapolated {
        format!(" (extrapolated: {calibrated} of calibration are too short to prove it)")
    } else {
        format!(" (proven by {calibrated} of calibration)")
    }
}

/// What a cleared happening says.
pub(crate) fn cleared(
    kind: EventKind,
    zone: Option<&str>,
    at_m: [f64; 2],
    seconds: f64,
    why: &str,
) -> String {
    format!("Over after {}: {} {}. {why}", duration(seconds), kind.words(), place(zone, at_m))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn durations_read_as_a_person_says_them() {
        let said: Vec<String> =
            [3.2, 119.0, 600.0, 9000.0, 147_600.0].into_iter().map(duration).collect();
        assert_eq!(said, ["3 s", "119 s", "10 min", "2.5 h", "41 h"]);
    }
}
