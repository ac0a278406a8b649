//! What a library says only in its log, and a process must count: who overhears gets it as text.
//!
//! zenoh, for one, tells nobody but its log that it refused a message. Nothing of it is printed.

use std::fmt::{self, Write};
use std::sync::OnceLock;
use tracing::field::{Field, Visit};
use tracing::subscriber::Interest;
use tracing::{Event, Level, Metadata, Subscriber};
use tracing_subscriber::layer::{Context, Filter, Layer};
use tracing_subscriber::registry::LookupSpan;

/// Longest text that is looked at, bytes: keys and names are shorter; the rest is left out.
const TEXT_BYTES_MAX: usize = 1024;

/// What is to be overheard.
pub struct Overhear {
    /// Beginnings of targets, each with the most detailed level that is wanted of it.
    pub targets: &'static [(&'static str, Level)],
    /// Takes the target and the text, on whatever thread it is said: it must be quick.
    pub hear: fn(target: &str, text: &str),
}

impl fmt::Debug for Overhear {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Overhear").field("targets", &self.targets).finish_non_exhaustive()
    }
}

static OVERHEAR: OnceLock<Overhear> = OnceLock::new();

/// From the start of logging on, `overhear` hears its targets. The first call counts.
pub fn overhear(overhear: Overhear) {
    let _ = OVERHEAR.set(overhear);
}

/// The layer that hears, if somebody wants to.
pub(crate) fn layer<S>() -> Option<impl Layer<S>>
where
    S: Subscriber + for<'s> LookupSpan<'s>,
{
    OVERHEAR.get().map(|overhear| Ear(overhear).with_filter(Wanted(overhear)))
}

struct Wanted(&'static Overhear);

impl Wanted {
    fn wants(&self, metadata: &Metadata<'_>) -> bool {
        let wants = |(target, level): &(&str, Level)| {
            metadata.target().starts_with(target) && metadata.level() <= level
        };
        metadata.is_event() && self.0.targets.iter().any(wants)
    }
}

impl<S> Filter<S> for Wanted {
    fn enabled(&self, metadata: &Metadata<'_>, _: &Context<'_, S>) -> bool {
        self.wants(metadata)
    }

    /// Answered once a place in the code. Without it each trace of zenoh would ask anew, and each of its
    /// spans would be made: several a message, a tenth of what the thread of the scans did.
    fn callsite_enabled(&self, metadata: &'static Metadata<'static>) -> Interest {
        if self.wants(metadata) { Interest::always() } else { Interest::never() }
    }
}

struct Ear(&'static Overhear);

impl<S: Subscriber> Layer<S> for Ear {
    fn on_event(&self, event: &Event<'_>, _: Context<'_, S>) {
        let mut text = Text(String::with_capacity(256)); // nearly all are shorter
        event.record(&mut text);
        (self.0.hear)(event.metadata().target(), &text.0);
    }
}

struct Text(String);

impl Visit for Text {
    fn record_debug(&mut self, field: &Field, value: &dyn fmt::Debug) {
        if field.name() == "message" {
            let _ = write!(self, "{value:?}"); // what does not fit is left out
        }
    }
}

impl Write for Text {
    fn write_str(&mut self, part: &str) -> fmt::Result {
        if self.0.len() + part.len() > TEXT_BYTES_MAX {
            return Err(fmt::Error);
        }
        self.0.push_str(part);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tracing_subscriber::layer::SubscriberExt as _;

    static HEARS: Overhear = Overhear { targets: &[("zenoh::acl", Level::TRACE)], hear: |_, _| {} };

    #[test]
    fn what_nobody_wants_to_hear_costs_nothing() {
        let layer = Ear(&HEARS).with_filter(Wanted(&HEARS));
        tracing::subscriber::with_default(tracing_subscriber::registry().with(layer), || {
            assert!(tracing::event_enabled!(target: "zenoh::acl", Level::TRACE));
            assert!(!tracing::event_enabled!(target: "zenoh::routing", Level::TRACE));
            // A span of the target as well: only what is said is heard.
            assert!(tracing::error_span!(target: "zenoh::routing", "a").is_disabled());
            assert!(tracing::error_span!(target: "zenoh::acl", "b").is_disabled());
        });
    }
}
