//! `tog recorder`: the service that `tog run` starts where the site file has `[recorder]`.

use crate::attach::{attachments, session};
use crate::catalogue::Catalogue;
use crate::core::Recorder;
use crate::shelf::{Scope, Shelf};
use crate::tape::{Head, Limits, Tape};
use process::{Clock, Failure, HealthReporter, Worker, wall_ns};
use protocol::health::ServiceState;
use protocol::site::{Recorder as Settings, Site};
use protocol::time::SECOND_NS;
use recording::Kept;
use std::path::Path;

/// A day, seconds.
const DAY_S: f64 = 86_400.0;

/// Runs the recorder until it is asked to stop.
///
/// # Errors
/// If the site file has no `[recorder]`, or shared memory breaks. A disk that is full or cannot be
/// written is none: see [`crate::tape`].
pub fn run(worker: &mut Worker) -> Result<(), Failure> {
    let settings = worker.site.recorder.clone();
    let settings =
        settings.ok_or_else(|| Failure::Config("the site file has no [recorder]".to_owned()))?;
    let dir = worker.instance.resolve(&settings.dir);
    let host = worker.instance.host.as_deref();
    let now_ns = wall_ns();
    let name = session_name(&worker.site.name, now_ns);
    let shelf = Shelf::start(Some(scope(&worker.site, &settings, &dir)))?;
    let head =
        head(&worker.site.part_on(host), &settings, &worker.instance.clock, "service", now_ns);
    let tape = Tape::new(dir.join(name), head, limits(&settings), shelf);
    let clock = worker.instance.clock;
    let mut recorder =
        Recorder::open(&worker.bus, (&worker.site, host), &settings, clock, true, tape)?;
    tracing::info!("records into {}", recorder.tape().directory().display());
    loop {
        while recorder.take()? {}
        recorder.tick();
        tell(&recorder, &mut worker.health);
        if worker.wait(recorder.deadline_mono_ns())?.stop {
            break;
        }
    }
    recorder.finish()?;
    tell(&recorder, &mut worker.health);
    Ok(())
}

/// `<site>_<begin, UTC>`: sorts by time, and is a name on every file system.
#[must_use]
pub fn session_name(site: &str, begin_ns: u64) -> String {
    let stamp = i64::try_from(begin_ns / 1_000_000)
        .ok()
        .and_then(|ms| jiff::Timestamp::from_millisecond(ms).ok())
        .unwrap_or_default();
    // With milliseconds: a recorder that is restarted at once begins another session.
    format!("{site}_{}", stamp.strftime("%Y-%m-%dT%H-%M-%S.%3fZ"))
}

/// What every file of a session begins with.
pub(crate) fn head(
    site: &Site,
    settings: &Settings,
    clock: &Clock,
    recorder: &str,
    begin_ns: u64,
) -> Head {
    let catalogue = Catalogue::new(site, &settings.topics);
    let host = std::fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default();
    let host = host.trim_end();
    Head {
        attachments: attachments(site, &catalogue),
        session: session(site, clock, recorder, host, begin_ns),
        topics: catalogue.topics,
    }
}

/// When files are complete.
pub(crate) fn limits(settings: &Settings) -> Limits {
    let split_ns = (settings.split_s * SECOND_NS as f64) as u64;
    Limits { split_bytes: settings.split_bytes(), split_ns }
}

fn scope(site: &Site, settings: &Settings, dir: &Path) -> Scope {
    let age_ns = |days: f64| (days * DAY_S * SECOND_NS as f64) as u64;
    Scope {
        dir: dir.to_owned(),
        prefix: format!("{}_2", site.name), // of a year: `a` does not take the files of `a_b`
        kept: Kept { bytes_max: settings.keep_bytes(), age_max_ns: settings.keep_days.map(age_ns) },
        open_bytes: settings.split_bytes(),
    }
}

fn tell(recorder: &Recorder, health: &mut HealthReporter) {
    let (counts, tape) = (recorder.counts(), recorder.tape().counts());
    for (name, total) in [
        ("messages_in", counts.messages_in),
        ("messages_lost", counts.lost),
        ("messages_refused", counts.refused),
        ("messages_written", tape.messages_written),
        ("messages_dropped", tape.messages_dropped),
        ("bytes_written", tape.bytes_written),
        ("files", tape.files),
        ("splits", tape.splits),
        ("writes_failed", tape.writes_failed),
        ("files_recovered", tape.files_recovered),
        ("messages_recovered", tape.messages_recovered),
        ("files_removed", tape.files_removed),
    ] {
        health.set_count(name, total);
    }
    let tape_faults = [
        ("recording_unwritable", recorder.tape().unwritable(), "tried again every 5 s"),
        ("recording_lost", recorder.tape().lost(), "a new file was begun"),
        ("recording_unfinished", recorder.tape().unshelved(), "tried again with the next file"),
        ("message_refused", recorder.first_refusal(), "all are counted in messages_refused"),
    ];
    for (code, text, note) in tape_faults {
        health.set_fault(code, text.map(|text| format!("{text}; {note}")));
    }
    if recorder.is_over() {
        health.set_state(ServiceState::Ended);
    } else if tape.messages_written > 0 {
        health.set_state(ServiceState::Running);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_session_is_named_after_its_begin() {
        let name = session_name("foyer", 1_767_323_045_678_000_000);
        assert_eq!(name, "foyer_2026-01-02T03-04-05.678Z");
    }
}
