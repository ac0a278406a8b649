//! What must agree between the contexts of an area.

use super::super::diagnostics::Finding;
use super::super::place::minute_of_day;
use super::super::tree::Node;
use super::super::words::quoted;
use super::{areas, unique};

const DAY: usize = 24 * 60;
const WEEK: usize = 7 * DAY;
const DAYS: [&str; 7] = ["mon", "tue", "wed", "thu", "fri", "sat", "sun"];

pub(super) fn check(contexts: &[Node<'_>], findings: &mut Vec<Finding>) {
    unique(contexts, "name", "context", findings);
    for context in contexts {
        let why = "the context of all times that no other names";
        areas::reserved(context, "name", &["always"], why, findings);
        days(context, findings);
    }
    overlaps(contexts, findings);
}

fn days(context: &Node<'_>, findings: &mut Vec<Finding>) {
    let mut seen: Vec<&str> = Vec::new();
    for item in context.list("days") {
        let Some(day) = item.value.as_str().filter(|day| DAYS.contains(day)) else { continue };
        if seen.contains(&day) {
            findings.push(
                Finding::error(&item, quoted(day), "each day once").help("remove one of the two"),
            );
        }
        seen.push(day);
    }
}

/// Tells of each context that begins to overlap with an earlier one. The first counts.
fn overlaps(contexts: &[Node<'_>], findings: &mut Vec<Finding>) {
    let mut owner: Vec<Option<usize>> = vec![None; WEEK];
    for (index, context) in contexts.iter().enumerate() {
        let Some(minutes) = minutes(context) else { continue };
        let taken = minutes.iter().find_map(|&minute| Some((minute, owner[minute]?)));
        if let (Some((minute, first)), Some(node)) = (taken, context.get("from")) {
            let name = |node: &Node<'_>| quoted(node.text("name").map_or("", |(name, _)| name));
            let (day, minute) = (DAYS[minute / DAY], minute % DAY);
            let when = format!("{day} {:02}:{:02}", minute / 60, minute % 60);
            let first = &contexts[first];
            let found = format!("a time in two contexts, {when}");
            findings.push(
                Finding::warning(&node, found, "contexts that do not overlap")
                    .message(format!("{} overlaps with {}", name(context), name(first)))
                    .related(first.get_or_self("from").span, format!("{} counts", name(first)))
                    .help(format!("from {when} on the first of the two in the file counts")),
            );
        }
        for minute in minutes {
            owner[minute] = owner[minute].or(Some(index));
        }
    }
}

/// The minutes of the week, from Monday, of a context; `None` if it cannot be read.
fn minutes(context: &Node<'_>) -> Option<Vec<usize>> {
    let time = |key: &str| minute_of_day(context.text(key)?.0).map(usize::from);
    let (from, to) = (time("from")?, time("to")?);
    let length = if to > from { to - from } else { to + DAY - from };
    let listed = context.list("days");
    let is_day = |day: &str| listed.iter().any(|item| item.value.as_str() == Some(day));
    let days = (0..7).filter(|&day| listed.is_empty() || is_day(DAYS[day]));
    let of_day = |day: usize| (0..length).map(move |minute| (day * DAY + from + minute) % WEEK);
    Some(days.flat_map(of_day).collect())
}
