//! A whole site for the tests of the supervisor: `site-probe run RUN_ROOT NAME [SECONDS]` supervises
//! it, and as in `tog` the same program is every service. The services only hand messages on: laser
//! -> fusion -> mapper -> anomaly, one for one, so what arrives shows what was lost on the way.
//!
//! | NAME | what is special |
//! |---|---|
//! | `live` | 3 lasers at 20 Hz in 3 areas |
//! | `recording` | one lossless laser of 3000 scans |
//! | `wrong` | fusion finds its configuration wrong |
//! | `broken` | the mapper fails whenever it starts |
//! | `flaky` | the mapper fails whenever it is ready |
//! | `deaf` | the mapper does not listen to signals |

use process::{Failure, Role, Worker, exit, monotonic_ns};
use protocol::health::ServiceState;
use protocol::site::Site;
use protocol::topic::{self, Topic};
use protocol::wire::{FLAG_END_OF_STREAM, Header};
use std::path::Path;
use std::process::ExitCode;

const SCANS: u64 = 3000;
const LIVE_PERIOD_NS: u64 = 50_000_000;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let text = |index: usize| arguments.get(index).map_or("", String::as_str);
    if text(0) == "run" {
        return run(Path::new(text(1)), text(2), text(3).parse().ok());
    }
    let after = |flag: &str| {
        let at = arguments.iter().position(|argument| argument == flag)?;
        arguments.get(at + 1).map(String::as_str)
    };
    let role = Role::from_arguments(text(0), after("--laser"), after("--area"));
    let (Ok(role), Some(run_dir)) = (role, after("--instance")) else {
        eprintln!("usage: see the source of this probe");
        return ExitCode::from(exit::USAGE);
    };
    let body = match role {
        Role::Laser { .. } => laser,
        Role::Fusion { .. } => fusion,
        Role::Mapper { .. } => mapper,
        Role::Anomaly { .. } => anomaly,
        Role::Alerts | Role::Recorder => alerts,
    };
    process::run(role, Path::new(run_dir), body)
}

fn run(run_root: &Path, name: &str, seconds: Option<f64>) -> ExitCode {
    let ids: &[&str] = if name == "live" { &["a", "b", "c"] } else { &["a"] };
    let areas: Vec<_> = ids
        .iter()
        .map(
            |id| serde_json::json!({ "id": id, "origin_m": [0.0, 0.0], "columns": 40, "rows": 30 }),
        )
        .collect();
    let source = if name == "recording" {
        serde_json::json!({ "kind": "replay", "recording": "none.mcap", "pace": "lossless" })
    } else {
        serde_json::json!({ "kind": "simulator", "scene": "none", "rate_hz": 20.0 })
    };
    let lasers: Vec<_> = ids
        .iter()
        .map(|id| {
            serde_json::json!({ "id": format!("l{id}"), "area": id, "x_m": 0.0, "y_m": 0.0,
                "source": source })
        })
        .collect();
    let site = serde_json::json!({ "name": name, "area": areas, "laser": lasers });
    let Ok(site) = serde_json::from_value::<Site>(site) else {
        return ExitCode::from(exit::USAGE);
    };
    let options = supervisor::Options {
        base_dir: run_root.to_path_buf(),
        run_root: Some(run_root.to_path_buf()),
        seconds,
        silence_max_s: Some(3.0),
        ..supervisor::Options::default()
    };
    supervisor::run(&site, &options)
}

fn no_area() -> Failure {
    Failure::Config("the site has no such area".to_owned())
}

fn laser(worker: &mut Worker) -> Result<(), Failure> {
    let (_, area) = worker.area().ok_or_else(no_area)?;
    let topic = topic::scan(&area.id);
    let (index, _) = worker.laser().ok_or_else(no_area)?;
    let lossless = worker.instance.lossless;
    let mut scans = worker.bus.publisher(&topic, index)?;
    worker.health.set_state(ServiceState::Running);
    let (mut sent, mut next_ns) = (0, monotonic_ns());
    loop {
        while scans.may_send() && monotonic_ns() >= next_ns && (!lossless || sent < SCANS) {
            let mut scan = scans.loan(8)?;
            scan.header_mut().stamp_ns = sent;
            if lossless && sent + 1 == SCANS {
                scan.header_mut().envelope.flags = FLAG_END_OF_STREAM;
                worker.health.set_state(ServiceState::Ended);
            }
            scan.payload_mut().fill(sent as f32);
            scan.send();
            sent += 1;
            next_ns += if lossless { 0 } else { LIVE_PERIOD_NS };
        }
        worker.health.set_count("scans_out", sent);
        if worker.wait((!lossless).then_some(next_ns))?.stop {
            return Ok(());
        }
    }
}

/// Hands every message of `from` on to `to`.
fn relay<I: Header, E: process::Element, O: Header, F: process::Element>(
    worker: &mut Worker,
    from: &Topic<I, E>,
    to: &Topic<O, F>,
    index: u32,
) -> Result<(), Failure> {
    let mut from = worker.bus.subscriber_with_credit(from)?;
    let mut to = worker.bus.publisher(to, index)?;
    worker.health.set_state(ServiceState::Running);
    loop {
        while to.may_send() {
            let Some(message) = from.receive()? else { break };
            let mut loan = to.loan(1)?;
            loan.header_mut().envelope_mut().flags = message.header().envelope().flags;
            loan.payload_mut().fill(F::default());
            loan.send();
            from.finish(&message.receipt());
            if message.is_end_of_stream() {
                worker.health.set_state(ServiceState::Ended);
            }
        }
        worker.health.set_count("received", from.losses().received);
        worker.health.set_count("lost", from.losses().lost);
        if worker.wait(None)?.stop {
            return Ok(());
        }
    }
}

fn fusion(worker: &mut Worker) -> Result<(), Failure> {
    if worker.site.name == "wrong" {
        return Err(Failure::Config("the laser la sees nothing of the area a".to_owned()));
    }
    let (index, area) = worker.area().ok_or_else(no_area)?;
    let (scan, frame) = (topic::scan(&area.id), topic::frame(&area.id, area.grid().plane_words()));
    relay(worker, &scan, &frame, index)
}

fn mapper(worker: &mut Worker) -> Result<(), Failure> {
    match worker.site.name.as_str() {
        "broken" => return Err(Failure::Failed("the checkpoint cannot be read".to_owned())),
        "flaky" => {
            worker.health.set_state(ServiceState::Running);
            worker.health.tell();
            // Who dies in the same millisecond was never ready: the supervisor has to hear it first.
            let until_ns = monotonic_ns() + 300_000_000;
            while monotonic_ns() < until_ns {
                if worker.wait(Some(until_ns))?.stop {
                    return Ok(());
                }
            }
            return Err(Failure::Failed("the frame is torn".to_owned()));
        }
        "deaf" => loop {
            worker.health.set_state(ServiceState::Running);
            worker.wait(None)?;
        },
        _ => {}
    }
    let (index, area) = worker.area().ok_or_else(no_area)?;
    let frame = topic::frame(&area.id, area.grid().plane_words());
    let classes = topic::classes(&area.id, area.grid().cells());
    relay(worker, &frame, &classes, index)
}

fn anomaly(worker: &mut Worker) -> Result<(), Failure> {
    let (_, area) = worker.area().ok_or_else(no_area)?;
    let topic = topic::classes(&area.id, area.grid().cells());
    let mut classes = worker.bus.subscriber_with_credit(&topic)?;
    worker.health.set_state(ServiceState::Running);
    loop {
        while let Some(message) = classes.receive()? {
            classes.finish(&message.receipt());
            if message.is_end_of_stream() {
                let losses = classes.losses();
                println!("passed {} lost {}", losses.received, losses.lost);
                worker.health.set_state(ServiceState::Ended);
            }
        }
        worker.health.set_count("received", classes.losses().received);
        if worker.wait(None)?.stop {
            return Ok(());
        }
    }
}

fn alerts(worker: &mut Worker) -> Result<(), Failure> {
    let mut events = worker.bus.subscriber(&topic::event())?;
    worker.health.set_state(ServiceState::Running);
    loop {
        while events.receive()?.is_some() {}
        if worker.wait(None)?.stop {
            return Ok(());
        }
    }
}
