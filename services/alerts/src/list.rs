//! `tog alerts list`: the journal for people and for programs, while the service runs or not.

use crate::journal::{Entry, Filter, Journal, JournalError};
use crate::words::{self, ZoneError};
use jiff::tz::TimeZone;
use jiff::{Span, Timestamp, civil};
use protocol::event::{EventKind, EventState};
use serde::de::DeserializeOwned;
use std::io::{ErrorKind, Write};
use std::path::PathBuf;

/// How lines are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Format {
    /// For people.
    #[default]
    Text,
    /// One JSON object a line, as the feed sends them.
    Json,
}

/// What is to be listed.
#[derive(Debug, Clone, PartialEq)]
pub struct ListOptions {
    /// The journal: `<state_dir>/journal.sqlite3`.
    pub journal: PathBuf,
    /// The site's time zone, an IANA name.
    pub timezone: String,
    /// Which rows.
    pub filter: Filter,
    /// How.
    pub format: Format,
}

/// Why nothing could be listed.
#[derive(Debug, thiserror::Error)]
pub enum ListError {
    /// The journal.
    #[error(transparent)]
    Journal(#[from] JournalError),
    /// The site's time zone.
    #[error(transparent)]
    Zone(#[from] ZoneError),
    /// The output.
    #[error("cannot write the list: {0}")]
    Output(std::io::Error),
}

/// Writes the rows that pass the filter, oldest first.
///
/// # Errors
/// See [`ListError`]; a reader that goes away (`| head`) is no error.
pub fn list(options: &ListOptions, out: &mut impl Write) -> Result<(), ListError> {
    let zone = words::time_zone(&options.timezone)?;
    let rows = Journal::open_read_only(&options.journal)?.list(&options.filter)?;
    let written = match options.format {
        Format::Json => rows.iter().try_for_each(|row| writeln!(out, "{}", row.line())),
        Format::Text => write_table(&rows, &zone, out),
    };
    match written.and_then(|()| out.flush()) {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => Err(ListError::Output(error)),
        _ => Ok(()),
    }
}

fn write_table(rows: &[Entry], zone: &TimeZone, out: &mut impl Write) -> std::io::Result<()> {
    if rows.is_empty() {
        return writeln!(out, "no events in the journal match");
    }
    let mut table: Vec<[String; 6]> =
        vec![["when", "state", "what", "where", "why", "event"].map(str::to_owned)];
    for row in rows {
        // A row that a later tog wrote is still worth a line.
        table.push(match row.change() {
            Ok(change) => [
                words::date_time(change.stamp_ns, zone),
                crate::journal::state_name(change.state).to_owned(),
                change.kind.words().to_owned(),
                words::printable(&words::place(&change)),
                words::printable(&change.text),
                words::printable(&change.id),
            ],
            Err(error) => [
                words::date_time(row.received_ns, zone),
                "?".to_owned(),
                "?".to_owned(),
                "?".to_owned(),
                format!("row {} cannot be read by this tog: {error}", row.journal_id),
                String::new(),
            ],
        });
    }
    let width = |column: usize| {
        table.iter().map(|cells| cells[column].chars().count()).max().unwrap_or_default()
    };
    // The texts go last: they are as long as they like.
    let widths = [width(0), width(1), width(2), width(3), width(5)];
    for [when, state, what, place, why, event] in &table {
        let [w0, w1, w2, w3, w4] = widths;
        writeln!(out, "{when:w0$}  {state:w1$}  {what:w2$}  {place:w3$}  {event:w4$}  {why}")?;
    }
    Ok(())
}

/// A kind by its name in JSON: `object_left`; spaces and hyphens are as good.
///
/// # Errors
/// A sentence with all the names there are.
pub fn parse_kind(name: &str) -> Result<EventKind, String> {
    parse_name(name)
}

/// A state by its name: `raised`, `updated`, `cleared`.
///
/// # Errors
/// A sentence with all the names there are.
pub fn parse_state(name: &str) -> Result<EventState, String> {
    parse_name(name)
}

fn parse_name<T: DeserializeOwned>(name: &str) -> Result<T, String> {
    let name = name.trim().to_lowercase().replace([' ', '-'], "_");
    serde_json::from_value(name.into())
        .map_err(|error| error.to_string().replace("variant", "name"))
}

/// A moment as people give it: `2h`, `7 days` (before `now_ns`), `2026-11-22`, `2026-11-22 19:00`
/// (in the zone), or RFC 3339. UNIX nanoseconds.
///
/// # Errors
/// A sentence with what was expected.
pub fn parse_since(text: &str, now_ns: u64, timezone: &str) -> Result<u64, String> {
    let zone = words::time_zone(timezone).map_err(|error| error.to_string())?;
    let now = Timestamp::from_nanosecond(i128::from(now_ns)).map_err(|error| error.to_string())?;
    let before_now = || {
        let span: Span = text.parse().ok()?;
        now.to_zoned(zone.clone()).checked_sub(span.abs()).ok().map(|time| time.timestamp())
    };
    let civil_time = || {
        let time: civil::DateTime = text.parse().ok()?;
        time.to_zoned(zone.clone()).ok().map(|time| time.timestamp())
    };
    let moment =
        text.parse::<Timestamp>().ok().or_else(civil_time).or_else(before_now).ok_or_else(
            || {
                format!(
                    "{text:?} is no moment, expected one as 2h, \"7 days\", 2026-11-22, \
                 \"2026-11-22 19:00\" (in the time zone of the site) or 2026-11-22T19:00:00Z"
                )
            },
        )?;
    Ok(u64::try_from(moment.as_nanosecond()).unwrap_or(0))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::journal::JOURNAL_FILE;
    use crate::testing::change;

    fn listed(format: Format, filter: Filter) -> String {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join(JOURNAL_FILE);
        let (mut journal, _) = Journal::open(&path, 0).unwrap();
        journal.append(&[change("foyer", 1), change("foyer", 2)], 77).unwrap();
        let timezone = "Europe/Berlin".to_owned();
        let options = ListOptions { journal: path, timezone, filter, format };
        let mut out = Vec::new();
        list(&options, &mut out).unwrap();
        String::from_utf8(out).unwrap()
    }

    #[test]
    fn a_table_has_a_line_an_event_in_the_time_of_the_site() {
        let why = "a person-sized area is lingering; here 99.7 % of 41 h is empty";
        let expected = format!(
            "when                     state   what              where                     event    why\n\
             2026-11-18 05:26:41 CET  raised  unusual activity  door, foyer (1.1, 2.0) m  foyer-1  {why}\n\
             2026-11-18 05:26:41 CET  raised  unusual activity  door, foyer (1.2, 2.0) m  foyer-2  {why}\n"
        );
        assert_eq!(listed(Format::Text, Filter::default()), expected);
        let none = Filter { area: Some("yard".to_owned()), ..Filter::default() };
        assert_eq!(listed(Format::Text, none), "no events in the journal match\n");
    }

    #[test]
    fn json_lines_hold_the_change_and_its_place_in_the_journal() {
        let out = listed(Format::Json, Filter::default());
        let second: serde_json::Value = serde_json::from_str(out.lines().nth(1).unwrap()).unwrap();
        assert_eq!((&second["journal_id"], &second["received_ns"]), (&2.into(), &77.into()));
        assert_eq!(second["journaled"], true);
        let mut fields = serde_json::to_value(change("foyer", 2)).unwrap();
        fields.as_object_mut().unwrap().retain(|name, value| second[name] != *value);
        assert_eq!(fields, serde_json::json!({}), "every field of the change is there");
    }

    #[test]
    fn a_missing_journal_says_what_to_do() {
        let journal = PathBuf::from("/nonexistent/journal.sqlite3");
        let timezone = "UTC".to_owned();
        let options =
            ListOptions { journal, timezone, filter: Filter::default(), format: Format::Text };
        let error = list(&options, &mut Vec::new()).unwrap_err().to_string();
        assert!(error.contains("`tog run SITE`"), "{error}");
    }

    #[test]
    fn kinds_and_states_are_understood_as_people_write_them() {
        assert_eq!(parse_kind("Object left"), Ok(EventKind::ObjectLeft));
        assert_eq!(parse_state("raised"), Ok(EventState::Raised));
        let error = parse_kind("ufo").unwrap_err();
        assert!(error.contains("ufo") && error.contains("loitering"), "{error}");
    }

    #[test]
    fn a_moment_is_understood_in_the_time_of_the_site() {
        let now_ns = 1_794_976_000_000_000_000; // 2026-11-18 04:26:40 UTC
        let since = |text| parse_since(text, now_ns, "Europe/Berlin");
        assert_eq!(since("2h"), Ok(now_ns - 7_200_000_000_000));
        assert_eq!(since("7 days"), Ok(now_ns - 7 * 86_400_000_000_000));
        assert_eq!(since("2026-11-18 05:26:40"), Ok(now_ns));
        assert_eq!(since("2026-11-18T04:26:40Z"), Ok(now_ns));
        assert_eq!(since("2026-11-18"), Ok(now_ns - (5 * 3600 + 26 * 60 + 40) * 1_000_000_000));
        assert!(since("yesterday").unwrap_err().contains("expected one as 2h"));
    }
}
