//! A change as a guard reads it: what, where, when in the time of the site, and why.

use jiff::Timestamp;
use jiff::tz::TimeZone;
use protocol::event::{EventChange, EventState};

/// Why a name is no time zone.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{name:?} is not a time zone ({reason}), expected an IANA name as Europe/Berlin or UTC")]
pub struct ZoneError {
    /// What was given.
    pub name: String,
    /// What the time zone library says.
    pub reason: String,
}

/// The time zone of a site by its IANA name.
///
/// # Errors
/// If nobody knows it.
pub fn time_zone(name: &str) -> Result<TimeZone, ZoneError> {
    TimeZone::get(name)
        .map_err(|error| ZoneError { name: name.to_owned(), reason: error.to_string() })
}

/// Date and time of the site, with the zone's abbreviation: `2026-11-22 19:54:38 CET`.
#[must_use]
pub fn date_time(unix_ns: u64, zone: &TimeZone) -> String {
    format_time(unix_ns, zone, "%Y-%m-%d %H:%M:%S %Z")
}

fn format_time(unix_ns: u64, zone: &TimeZone, format: &str) -> String {
    match Timestamp::from_nanosecond(i128::from(unix_ns)) {
        Ok(time) => time.to_zoned(zone.clone()).strftime(format).to_string(),
        Err(_) => format!("{unix_ns} ns"),
    }
}

/// Where: `door, foyer (3.2, 4.1) m`, or `this host`.
#[must_use]
pub fn place(change: &EventChange) -> String {
    if change.area.is_empty() {
        return "this host".to_owned();
    }
    let zone = change.zone.as_ref().map_or_else(String::new, |zone| format!("{zone}, "));
    format!("{zone}{} ({:.1}, {:.1}) m", change.area, change.x_m, change.y_m)
}

/// How a state is called out: an alert is over, a fault is restored. An update says `now:`, because
/// it may be of another kind than before, or come after an `over`.
#[must_use]
pub fn call(change: &EventChange) -> &'static str {
    match (change.state, change.kind.is_fault()) {
        (EventState::Raised, false) => "ALERT",
        (EventState::Raised, true) => "FAULT",
        (EventState::Updated, _) => "now:",
        (EventState::Cleared, false) => "over",
        (EventState::Cleared, true) => "restored",
    }
}

/// The change in one line of a log, whose own stamp says the date:
/// `ALERT object left, 19:54:38 CET: why and where [foyer-12]`,
/// `FAULT coverage lost, 19:54:38 CET: foyer (3.2, 4.1) m: why [foyer-13]`.
#[must_use]
pub fn sentence(change: &EventChange, zone: &TimeZone) -> String {
    let time = format_time(change.stamp_ns, zone, "%H:%M:%S %Z");
    told(change, &format!(", {time}"))
}

/// The change in one line of the feed:
/// `2026-11-22 19:54:38 CET  ALERT object left: why and where [foyer-12]`.
#[must_use]
pub fn line(change: &EventChange, zone: &TimeZone) -> String {
    let time = date_time(change.stamp_ns, zone);
    format!("{time}  {}", told(change, ""))
}

fn told(change: &EventChange, time: &str) -> String {
    let (call, kind) = (call(change), change.kind.words());
    // The text of a happening says where in its first sentence; that of a fault need not.
    let at = match change.kind.is_fault() {
        true => format!("{}: ", place(change)),
        false => String::new(),
    };
    printable(&format!("{call} {kind}{time}: {at}{} [{}]", change.text, change.id))
}

/// Control characters could move the cursor of a terminal or fake a line: they become a space.
#[must_use]
pub fn printable(text: &str) -> String {
    text.chars().map(|letter| if letter.is_control() { ' ' } else { letter }).collect()
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::testing::change;
    use protocol::event::EventKind;

    #[test]
    fn a_guard_reads_the_time_of_the_site_in_summer_and_in_winter() {
        let berlin = time_zone("Europe/Berlin").unwrap();
        assert_eq!(date_time(1_794_976_001_000_000_000, &berlin), "2026-11-18 05:26:41 CET");
        assert_eq!(date_time(1_782_000_000_000_000_000, &berlin), "2026-06-21 02:00:00 CEST");
        let utc = time_zone("UTC").unwrap();
        assert_eq!(date_time(1_782_000_000_000_000_000, &utc), "2026-06-21 00:00:00 UTC");
        let error = time_zone("Mars/Base").unwrap_err().to_string();
        assert!(error.contains("Mars/Base") && error.contains("Europe/Berlin"), "{error}");
    }

    #[test]
    fn a_line_says_what_where_when_and_why() {
        let utc = time_zone("UTC").unwrap();
        let mut object = change("foyer", 12);
        object.kind = EventKind::ObjectLeft;
        object.text = "something stands here".to_owned();
        assert_eq!(
            line(&object, &utc),
            "2026-11-18 04:26:42 UTC  ALERT object left: something stands here [foyer-12]"
        );
        assert_eq!(
            sentence(&object, &utc),
            "ALERT object left, 04:26:42 UTC: something stands here [foyer-12]"
        );
        object.state = EventState::Updated;
        assert!(sentence(&object, &utc).starts_with("now: object left, 04:26:42 UTC: some"));
        object.state = EventState::Cleared;
        object.zone = None;
        assert!(line(&object, &utc).contains("over object left: something"));
        object.kind = EventKind::CoverageLost;
        let restored = "restored coverage lost, 04:26:42 UTC: foyer (2.2, 2.0) m: some";
        assert!(sentence(&object, &utc).starts_with(restored));
        assert!(line(&object, &utc).contains("restored coverage lost: foyer (2.2, 2.0) m: some"));
        object.kind = EventKind::ProcessRestarted;
        object.area.clear();
        assert!(line(&object, &utc).contains("restored process restarted: this host:"));
    }

    #[test]
    fn a_text_cannot_move_the_cursor_or_fake_a_line() {
        let utc = time_zone("UTC").unwrap();
        let mut nasty = change("foyer", 1);
        nasty.text = "all is well\r\n\u{1b}[2Jreally".to_owned();
        assert!(!line(&nasty, &utc).chars().any(char::is_control));
    }
}
