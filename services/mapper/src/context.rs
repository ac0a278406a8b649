//! Contexts: which collapsed map a frame is counted in, by the hour and weekday of the site.
//!
//! A corridor at noon is not the corridor at night. Context 0 is `always`: what no context of the
//! site file names. A context that spans midnight belongs to the day on which it begins.

use jiff::Timestamp;
use jiff::tz::TimeZone;
use protocol::site::{Context, Weekday, minute_of_day};

const MINUTE_NS: u64 = 60 * protocol::time::SECOND_NS;

/// Why contexts cannot be used.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ContextError {
    /// No such time zone.
    #[error("time zone `{0}` is not known, expected an IANA name such as `Europe/Berlin`")]
    TimeZone(String),
    /// Not a time of day.
    #[error("`{found}` in context `{context}` is not a time of day, expected HH:MM")]
    Time {
        /// Name of the context.
        context: String,
        /// What was found.
        found: String,
    },
}

#[derive(Debug)]
struct Rule {
    name: String,
    days: [bool; 7],
    from_minute: u32,
    to_minute: u32,
}

/// The contexts of an area.
#[derive(Debug)]
pub struct Contexts {
    zone: TimeZone,
    rules: Vec<Rule>,
    /// The last minute that was looked up, and its context: the answer changes on the minute only.
    cached: (u64, usize),
}

impl Contexts {
    /// The contexts of a site file.
    ///
    /// # Errors
    /// If the time zone or a time of day is not one.
    pub fn new(timezone: &str, contexts: &[Context]) -> Result<Self, ContextError> {
        let zone =
            TimeZone::get(timezone).map_err(|_| ContextError::TimeZone(timezone.to_owned()))?;
        let rules = contexts.iter().map(Rule::new).collect::<Result<_, _>>()?;
        Ok(Self { zone, rules, cached: (u64::MAX, 0) })
    }

    /// Names by index, `always` first.
    #[must_use]
    pub fn names(&self) -> Vec<&str> {
        std::iter::once("always").chain(self.rules.iter().map(|rule| rule.name.as_str())).collect()
    }

    /// The context of a frame stamped `stamp_ns`; the first that fits.
    pub fn at(&mut self, stamp_ns: u64) -> usize {
        if self.rules.is_empty() {
            return 0;
        }
        let minute = stamp_ns / MINUTE_NS;
        if self.cached.0 != minute {
            self.cached = (minute, self.look_up(minute));
        }
        self.cached.1
    }

    fn look_up(&self, minute: u64) -> usize {
        let second = i64::try_from(minute * 60).unwrap_or(i64::MAX);
        let Ok(timestamp) = Timestamp::from_second(second) else { return 0 };
        let local = timestamp.to_zoned(self.zone.clone());
        let day = local.weekday().to_monday_zero_offset() as usize;
        let minute_of_day = local.hour() as u32 * 60 + local.minute() as u32;
        let fits = |rule: &Rule| rule.holds(day, minute_of_day);
        self.rules.iter().position(fits).map_or(0, |index| index + 1)
    }
}

impl Rule {
    fn new(context: &Context) -> Result<Self, ContextError> {
        let minute = |text: &str| {
            minute_of_day(text).map(u32::from).ok_or_else(|| ContextError::Time {
                context: context.name.clone(),
                found: text.to_owned(),
            })
        };
        let mut days = [context.days.is_empty(); 7];
        for day in &context.days {
            days[monday_zero(*day)] = true;
        }
        Ok(Self {
            name: context.name.clone(),
            days,
            from_minute: minute(&context.from)?,
            to_minute: minute(&context.to)?,
        })
    }

    fn holds(&self, day: usize, minute_of_day: u32) -> bool {
        if self.from_minute < self.to_minute {
            return self.days[day] && (self.from_minute..self.to_minute).contains(&minute_of_day);
        }
        let began_today = self.days[day] && minute_of_day >= self.from_minute;
        let began_yesterday = self.days[(day + 6) % 7] && minute_of_day < self.to_minute;
        began_today || began_yesterday
    }
}

fn monday_zero(day: Weekday) -> usize {
    match day {
        Weekday::Mon => 0,
        Weekday::Tue => 1,
        Weekday::Wed => 2,
        Weekday::Thu => 3,
        Weekday::Fri => 4,
        Weekday::Sat => 5,
        Weekday::Sun => 6,
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn at(contexts: &mut Contexts, local: &str) -> usize {
        let timestamp: Timestamp = local.parse().unwrap();
        contexts.at(timestamp.as_nanosecond() as u64)
    }

    fn night_and_lunch() -> Contexts {
        let context = |name: &str, days: &[Weekday], from: &str, to: &str| Context {
            name: name.to_owned(),
            days: days.to_vec(),
            from: from.to_owned(),
            to: to.to_owned(),
        };
        let contexts = [
            context("friday_night", &[Weekday::Fri], "20:00", "06:00"),
            context("lunch", &[], "12:00", "13:30"),
        ];
        Contexts::new("Europe/Berlin", &contexts).unwrap()
    }

    #[test]
    fn a_night_belongs_to_the_day_on_which_it_begins() {
        let mut contexts = night_and_lunch();
        // 2026-11-20 is a Friday; Berlin is one hour ahead of UTC in winter.
        assert_eq!(at(&mut contexts, "2026-11-20T18:59:59Z"), 0);
        assert_eq!(at(&mut contexts, "2026-11-20T19:00:00Z"), 1);
        assert_eq!(at(&mut contexts, "2026-11-21T04:59:00Z"), 1);
        assert_eq!(at(&mut contexts, "2026-11-21T05:00:00Z"), 0);
        assert_eq!(at(&mut contexts, "2026-11-21T19:00:00Z"), 0);
        assert_eq!(contexts.names(), ["always", "friday_night", "lunch"]);
    }

    #[test]
    fn summer_time_moves_the_context_with_the_building() {
        let mut contexts = night_and_lunch();
        assert_eq!(at(&mut contexts, "2026-11-20T11:00:00Z"), 2);
        assert_eq!(at(&mut contexts, "2026-07-20T10:00:00Z"), 2);
        assert_eq!(at(&mut contexts, "2026-07-20T11:30:00Z"), 0);
    }

    #[test]
    fn wrong_times_and_zones_are_refused_in_words() {
        assert!(matches!(Contexts::new("Mars/Base", &[]), Err(ContextError::TimeZone(_))));
        let wrong = Context {
            name: "x".to_owned(),
            days: vec![],
            from: "24:00".to_owned(),
            to: "1:00".to_owned(),
        };
        let error = Contexts::new("UTC", &[wrong]).unwrap_err();
        assert_eq!(
            error.to_string(),
            "`24:00` in context `x` is not a time of day, expected HH:MM"
        );
    }
}
