//! Logs: short lines on stderr. `TOG_LOG` sets the level (`info` unless set; `debug`,
//! `fusion=trace,info`, ...). iceoryx2 speaks from `warn` on, zenoh
//! not at all: the bridge says itself who cannot be reached.

use crate::clock::wall_ns;
use crate::overhear;
use iceoryx2::prelude::{LogLevel, set_log_level};
use std::fmt;
use std::io::IsTerminal;
use tracing_subscriber::fmt::format::Writer;
use tracing_subscriber::fmt::time::FormatTime;
use tracing_subscriber::layer::SubscriberExt as _;
use tracing_subscriber::util::SubscriberInitExt as _;
use tracing_subscriber::{EnvFilter, Layer as _};

/// Starts logging; a second call does nothing. Under a supervisor, which writes the time and the name of
/// the service itself, lines have neither.
pub fn start() {
    let wanted = std::env::var("TOG_LOG").unwrap_or_default();
    let wanted = if wanted.trim().is_empty() { "info" } else { wanted.trim() };
    let filter = EnvFilter::builder()
        .parse(format!("{wanted},iceoryx2_bb_loggers=warn,zenoh=off"))
        .unwrap_or_else(|_| EnvFilter::new("info,iceoryx2_bb_loggers=warn,zenoh=off"));
    set_log_level(LogLevel::Warn);
    let lines = tracing_subscriber::fmt::layer()
        .with_writer(std::io::stderr)
        .with_target(false)
        .with_ansi(std::io::stderr().is_terminal());
    let lines = if std::env::var_os(SUPERVISED).is_some() {
        lines.without_time().boxed()
    } else {
        lines.with_timer(TimeOfDay).boxed()
    };
    // `try_init` fails if somebody else (a test) logs already: then that is where lines go.
    let _ = tracing_subscriber::registry()
        .with(overhear::layer())
        .with(lines.with_filter(filter))
        .try_init();
}

/// From here on iceoryx2 speaks of errors only: when somebody has removed its files, it would say so
/// of each, and we have said it once. The next [`crate::domain::Owner`] ends it.
pub fn hush() {
    set_log_level(LogLevel::Error);
}

/// iceoryx2 speaks from `warn` on again.
pub(crate) fn speak() {
    set_log_level(LogLevel::Warn);
}

/// Environment variable that tells a worker that its lines are put into a common log.
pub const SUPERVISED: &str = "TOG_SUPERVISED";

struct TimeOfDay;

impl FormatTime for TimeOfDay {
    fn format_time(&self, w: &mut Writer<'_>) -> fmt::Result {
        w.write_str(&time_of_day(wall_ns()))
    }
}

/// `12:34:56.789Z`.
#[must_use]
pub fn time_of_day(unix_ns: u64) -> String {
    let ms = unix_ns / 1_000_000;
    let (s, ms) = (ms / 1000 % 86_400, ms % 1000);
    format!("{:02}:{:02}:{:02}.{ms:03}Z", s / 3600, s / 60 % 60, s % 60)
}

#[cfg(test)]
mod tests {
    #[test]
    fn the_time_of_day_is_utc() {
        assert_eq!(super::time_of_day(1_700_000_000_123_000_000), "22:13:20.123Z");
    }
}
