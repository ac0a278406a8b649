//! A process of its own for the tests and measurements of shared memory:
//! `bus-probe ROLE RUN_DIR [COUNT] [PERIOD_US]`. It prints what it saw on stdout, one line a fact.
//!
//! | role | what it does |
//! |---|---|
//! | `own` | owns the instance of a small site (RUN_DIR is the run root) until stdin closes |
//! | `send` | publishes COUNT scans, every PERIOD_US (0: as fast as possible) |
//! | `receive` | takes scans until the end of the stream; prints counts and latencies |
//! | `hold` | opens a subscriber and takes nothing until stdin closes, then all |
//! | `swallow` | takes the first ring out of its bell without looking, then waits for what was rung for |
//! | `stuffed` | opens a bell; once stdin closes, silences it and says whether it is silent |
//! | `idle` | waits for COUNT beats of its health, prints the CPU time used meanwhile |

use process::clock::process_cpu_ns;
use process::domain::{Owner, OwnerOptions};
use process::{Clock, EventLoop, Failure, Interest, Role, Worker, monotonic_ns};
use protocol::scan::ScanHeader;
use protocol::site::Site;
use protocol::topic;
use protocol::wire::FLAG_END_OF_STREAM;
use rustix::event::{PollFd, PollFlags, poll};
use rustix::net::{RecvFlags, recv};
use rustix::time::Timespec;
use std::io::Write;
use std::os::fd::BorrowedFd;
use std::path::Path;
use std::process::ExitCode;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let text = |index: usize| arguments.get(index).map_or("", String::as_str);
    let number = |index: usize| text(index).parse::<u64>().unwrap_or(0);
    let (run_dir, count, period_us) = (Path::new(text(1)), number(2), number(3));
    let area = || Role::Fusion { area: "a".into() };
    match text(0) {
        "own" => own(run_dir, text(2) == "lossless"),
        "send" => process::run(Role::Laser { laser: "l".into() }, run_dir, |worker| {
            send(worker, count, period_us)
        }),
        "receive" => process::run(area(), run_dir, receive),
        "hold" => process::run(area(), run_dir, hold),
        "swallow" => process::run(area(), run_dir, swallow),
        "stuffed" => process::run(area(), run_dir, stuffed),
        "idle" => process::run(area(), run_dir, |worker| idle(worker, count)),
        other => {
            say(&format!("unknown role {other:?}"));
            ExitCode::from(process::exit::USAGE)
        }
    }
}

fn say(line: &str) {
    let mut out = std::io::stdout();
    // A parent that does not listen any more is no reason to fail.
    let _ = writeln!(out, "{line}").and_then(|()| out.flush());
}

fn site(lossless: bool) -> Result<Site, serde_json::Error> {
    let pace = if lossless { "lossless" } else { "real_time" };
    serde_json::from_value(serde_json::json!({
        "name": "probe",
        "area": [{ "id": "a", "origin_m": [0.0, 0.0], "columns": 40, "rows": 30 }],
        "laser": [{ "id": "l", "area": "a", "x_m": 0.0, "y_m": 0.0,
            "source": { "kind": "replay", "recording": "none.mcap", "pace": pace } }],
    }))
}

fn own(run_root: &Path, lossless: bool) -> ExitCode {
    process::logging::start();
    let outcome = (|| -> Result<(), Box<dyn std::error::Error>> {
        let events = EventLoop::new()?;
        let stdin = std::io::stdin();
        events.watch(&stdin, Interest::Read)?;
        let options = OwnerOptions {
            host: None,
            run_root: run_root.to_path_buf(),
            base_dir: run_root.to_path_buf(),
            out_dir: None,
            clock: Clock::Wall,
        };
        let owner = Owner::start(&site(lossless)?, &options)?;
        say(&format!("up {}", owner.instance().run_dir.display()));
        loop {
            let wake = events.wait(None)?;
            if wake.stop || wake.descriptors {
                return Ok(());
            }
        }
    })();
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            say(&format!("error {error}"));
            ExitCode::FAILURE
        }
    }
}

fn send(worker: &mut Worker, count: u64, period_us: u64) -> Result<(), Failure> {
    let mut scans = worker.bus.publisher(&topic::scan("a"), 0)?;
    say("up");
    let mut next_mono_ns = monotonic_ns();
    let mut sent = 0;
    while sent < count {
        while sent < count && scans.may_send() && monotonic_ns() >= next_mono_ns {
            let mut scan = scans.loan(181)?;
            scan.header_mut().stamp_ns = sent;
            if sent + 1 == count {
                scan.header_mut().envelope.flags = FLAG_END_OF_STREAM;
            }
            scan.payload_mut().fill(sent as f32);
            scan.send();
            sent += 1;
            next_mono_ns += period_us * 1000;
        }
        let deadline = if period_us > 0 { Some(next_mono_ns) } else { None };
        if sent < count && worker.wait(deadline)?.stop {
            return Ok(());
        }
    }
    say(&format!("sent {sent}"));
    while !worker.wait(None)?.stop {} // what was sent is in this process's memory
    Ok(())
}

fn receive(worker: &mut Worker) -> Result<(), Failure> {
    let mut scans = worker.bus.subscriber_with_credit(&topic::scan("a"))?;
    say("up");
    let mut latencies_ns = Vec::new();
    let mut disordered = 0;
    let cpu_ns = process_cpu_ns();
    let mut last: Option<ScanHeader> = None;
    loop {
        while let Some(scan) = scans.receive()? {
            let now_ns = monotonic_ns();
            let header = *scan.header();
            latencies_ns.push(now_ns.saturating_sub(header.envelope.published_mono_ns));
            let torn = scan.payload().iter().any(|range| *range != header.stamp_ns as f32);
            let later = last.is_none_or(|last| {
                (last.envelope.session, last.stamp_ns) < (header.envelope.session, header.stamp_ns)
            });
            disordered += u64::from(torn || !later || scan.payload().len() != 181);
            last = Some(header);
            scans.finish(&scan.receipt());
            if scan.is_end_of_stream() {
                let losses = scans.losses();
                latencies_ns.sort_unstable();
                let at = |share: f64| {
                    latencies_ns[((latencies_ns.len() - 1) as f64 * share) as usize] as f64 / 1e3
                };
                let cpu_us = (process_cpu_ns() - cpu_ns) / 1000;
                say(&format!(
                    "received {} lost {} disordered {disordered} restarts {} p50_us {:.1} p99_us {:.1} \
                     max_us {:.1} cpu_us {cpu_us}",
                    losses.received,
                    losses.lost,
                    losses.restarts,
                    at(0.5),
                    at(0.99),
                    at(1.0),
                ));
                return Ok(());
            }
        }
        if worker.wait(None)?.stop {
            say("stopped");
            return Ok(());
        }
    }
}

fn hold(worker: &mut Worker) -> Result<(), Failure> {
    let mut scans = worker.bus.subscriber(&topic::scan("a"))?;
    let stdin = std::io::stdin();
    worker.events.watch(&stdin, Interest::Read)?;
    say("up");
    loop {
        let wake = worker.wait(None)?;
        if wake.stop || wake.descriptors {
            break;
        }
    }
    let mut first = None;
    while let Some(scan) = scans.receive()? {
        first.get_or_insert(scan.header().envelope.seq);
    }
    let losses = scans.losses();
    say(&format!("received {} lost {} first {first:?}", losses.received, losses.lost));
    Ok(())
}

fn is_readable(fd: BorrowedFd<'_>, patience: Option<&Timespec>) -> bool {
    let mut fds = [PollFd::from_borrowed_fd(fd, PollFlags::IN)];
    matches!(poll(&mut fds, patience), Ok(1..))
}

fn swallow(worker: &mut Worker) -> Result<(), Failure> {
    let mut scans = worker.bus.subscriber(&topic::scan("a"))?;
    say("up");
    while !is_readable(scans.descriptor(), None) {}
    let _ = recv(scans.descriptor(), &mut [0u8; 8], RecvFlags::DONTWAIT);
    say("swallowed");
    let mut received = 0;
    loop {
        let wake = worker.wait(None)?; // its health is due once a second
        if wake.stop {
            return Ok(());
        }
        while wake.data && scans.receive()?.is_some() {
            received += 1;
        }
        if received > 0 {
            say(&format!("received {received}"));
            return Ok(());
        }
    }
}

fn stuffed(worker: &mut Worker) -> Result<(), Failure> {
    let scans = worker.bus.subscriber_of_task(&topic::scan("a"))?;
    let stdin = std::io::stdin();
    worker.events.watch(&stdin, Interest::Read)?;
    say("up");
    while !worker.wait(None)?.descriptors {}
    let zero = Timespec { tv_sec: 0, tv_nsec: 0 };
    let before = is_readable(scans.descriptor(), Some(&zero));
    scans.begin_turn();
    say(&format!("rang {before} then {}", is_readable(scans.descriptor(), Some(&zero))));
    Ok(())
}

fn idle(worker: &mut Worker, beats: u64) -> Result<(), Failure> {
    let _scans = worker.bus.subscriber(&topic::scan("a"))?;
    say("up");
    let (cpu_ns, wakes, start_ns) = (process_cpu_ns(), worker.events.wakes(), monotonic_ns());
    for _ in 0..beats {
        if worker.wait(None)?.stop {
            break;
        }
    }
    let elapsed_ns = monotonic_ns() - start_ns;
    say(&format!(
        "idle {:.3} s, {} wakes, cpu {} us",
        elapsed_ns as f64 / 1e9,
        worker.events.wakes() - wakes,
        (process_cpu_ns() - cpu_ns) / 1000
    ));
    Ok(())
}
