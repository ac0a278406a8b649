//! A host that is lost: its area goes on elsewhere, with the map as it was copied, and is run by one host
//! again as soon as all hear each other.

use super::bridge::{hosts, journal_of, of, wait_for_rows};
use super::disk::Disk;
use super::feed::Desk;
use harness::{Setup, Site, fault, find, is_nightly, kill, processes_of};
use protocol::event::EventState;
use rustix::process::Signal;
use std::time::Instant;
use supervisor::StatusReport;

/// `hall` runs on `main`, on `spare` if that is lost; its lasers on `edge`, which is a desk as well.
fn three_hosts() -> String {
    let laser = |id: &str, place: &str| {
        format!(
            "[[laser]]\nid = \"{id}\"\nhost = \"edge\"\narea = \"hall\"\n{place}\n\
             source = {{ kind = \"simulator\", scene = \"room\", seed = 1 }}\n\n"
        )
    };
    [
        "name = \"t\"\ntimezone = \"UTC\"\nstate_dir = \"state\"\n\n".to_owned(),
        hosts(["edge", "main", "spare"], "edge"),
        "[[area]]\nid = \"hall\"\nhost = \"main\"\nstandby = \"spare\"\norigin_m = [-0.5, -0.5]\n\
         columns = 110\nrows = 100\ncheckpoint_s = 1\ntimescales_s = [1, 2, 4]\n\n"
            .to_owned(),
        laser("south", "x_m = 4.6\ny_m = 0.2\nyaw_deg = 90"),
        laser("north", "x_m = 5.2\ny_m = 8.8\nyaw_deg = -90"),
    ]
    .concat()
}

fn start(toml: &str, host: &str) -> Site {
    Setup::new(toml).arguments(["--host", host]).start()
}

fn gauge(report: &StatusReport, service: &str, name: &str) -> Option<f64> {
    find(report, service).gauges.get(name).copied()
}

fn runs_here(report: &StatusReport) -> bool {
    gauge(report, "bridge", "area_runs_here hall") == Some(1.0)
}

/// Waits until the area's frames flow on this host.
fn wait_until_it_runs(site: &mut Site) {
    site.wait_until("frames of the area", |report| {
        let maps = find(report, "anomaly hall").counters.get("class_maps_in").copied();
        (runs_here(report) && maps.unwrap_or(0) > 0).then_some(())
    });
}

fn wait_until_it_stands_by(site: &mut Site) {
    site.wait_until("a standby with a copy", |report| {
        let idle = find(report, "mapper hall").pid.is_none();
        let copied = gauge(report, "bridge", "replica_age_s hall").is_some();
        (idle && copied && !runs_here(report)).then_some(())
    });
}

/// The whole host: its supervisor and all processes at once.
fn kill_host(site: &mut Site) {
    let supervisor = site.status().map(|report| report.pid);
    for pid in supervisor.into_iter().chain(processes_of(&site.run_dir)) {
        kill(pid, Signal::KILL);
    }
    site.wait_end_of_run();
}

#[test]
fn the_area_of_a_lost_host_goes_on_at_its_standby_and_is_never_run_by_two_for_long() {
    let toml = three_hosts();
    let (mut edge, mut main, mut spare) =
        (start(&toml, "edge"), start(&toml, "main"), start(&toml, "spare"));
    wait_until_it_runs(&mut main);
    wait_until_it_stands_by(&mut spare);

    // What happens is told under the name of the area.
    let told = Desk::open_while_degraded(&edge);
    let raised = told.hold_laser_until_told(&mut edge, 0);
    told.release_laser(&mut edge, &raised.change.id);
    assert_eq!(raised.change.origin, "hall");

    // A bridge alone that is killed moves nothing.
    for _ in 0..3 {
        let killed = main.pid_of("bridge");
        main.kill("bridge", Signal::KILL);
        main.wait_until("the bridge again", |report| {
            let is_new = find(report, "bridge").pid.is_some_and(|pid| pid != killed);
            (runs_here(report) && is_new).then_some(())
        });
    }
    let epoch = |site: &mut Site| {
        site.wait_until("the epoch", |report| gauge(report, "bridge", "area_epoch hall"))
    };
    assert_eq!(epoch(&mut main), 2.0);

    // The whole host.
    let rounds = if is_nightly() { 10 } else { 2 };
    let (mut took_ms, mut origins) = (Vec::new(), Vec::new());
    for _ in 0..rounds {
        let (lost, other) = if runs_here(&main.status().unwrap()) {
            (&mut main, &mut spare)
        } else {
            (&mut spare, &mut main)
        };
        let begin = Instant::now();
        kill_host(lost);
        wait_until_it_runs(other);
        took_ms.push(begin.elapsed().as_millis());
        let log = other.log().text();
        assert!(log.contains("goes on from"), "the mapper goes on from the copy:\n{log}");
        // And the detector, under a name of its own where it is the standby.
        let raised = told.hold_laser_until_told(&mut edge, told.count());
        told.release_laser(&mut edge, &raised.change.id);
        origins.push(raised.change.origin);
        lost.start_again();
        wait_until_it_stands_by(lost);
        assert!(runs_here(&other.status().unwrap()), "it stays where it is");
        edge.wait_until("a desk that misses nothing of what stands by", |report| {
            let count = |name: &str, host: &str| gauge(report, "bridge", &format!("{name} {host}"));
            let all_are_heard = |host: &&str| {
                let heard = count("host_services_heard", host);
                heard.is_some() && heard == count("host_services", host)
            };
            ["main", "spare"].iter().all(all_are_heard).then_some(())
        });
    }
    took_ms.sort_unstable();
    println!("back after ms: {took_ms:?}");
    assert_eq!(origins[..2], ["hall@spare", "hall"]);

    // A link that is cut: the owner's bridge stands still for longer than anybody waits.
    let is_main = runs_here(&main.status().unwrap());
    let (owner, other) = if is_main { (&mut main, &mut spare) } else { (&mut spare, &mut main) };
    let held = owner.kill("bridge", Signal::STOP);
    wait_until_it_runs(other);
    kill(held, Signal::CONT);
    wait_until_it_stands_by(owner);
    assert!(runs_here(&other.status().unwrap()));
    let state = owner.dir.join("state");
    owner.wait_until("its own map is kept aside", |_| {
        let kept = |host| state.join(host).join("hall.map.superseded").exists();
        (kept("main") || kept("spare")).then_some(())
    });

    // A host that stops in good order: what is open there, nobody would see end.
    let raised = told.hold_laser_until_told(&mut edge, told.count());
    let begin = Instant::now();
    other.stop();
    wait_until_it_runs(owner);
    println!("handed over after {} ms", begin.elapsed().as_millis());
    let withdrawn = told.wait_for(0, "the end of what was open", |told| {
        told.change.id == raised.change.id && told.change.state == EventState::Cleared
    });
    let text = &withdrawn.change.text;
    assert!(text.starts_with("This host stops to watch area hall; host "), "{text}");
    edge.kill("laser south", Signal::CONT);

    // The desk knows all that was told, whoever told it, once and in order.
    let runs = [(&main, "main", "hall"), (&spare, "spare", "hall@spare")];
    for (site, host, origin) in runs {
        let sent = of(journal_of(site, host, origin));
        assert!(sent.len() >= 2, "{origin}");
        assert_eq!(wait_for_rows(&edge, "edge", origin, sent.len()), sent, "{origin}");
    }
    let owner = if is_main { &mut main } else { &mut spare };
    owner.stop();
    edge.stop();
}

#[test]
fn a_standby_whose_disk_is_full_takes_over_and_says_so() {
    let toml = three_hosts();
    let setup = Setup::new(&toml).arguments(["--host", "spare"]);
    let Some(disk) = Disk::mount(&setup.dir().join("state")) else {
        println!("skipped: no right to mount a small disk");
        return;
    };
    let (mut edge, mut main) = (start(&toml, "edge"), start(&toml, "main"));
    let mut spare = setup.start();
    let disk = disk; // gone before the directory of the site
    wait_until_it_runs(&mut main);
    wait_until_it_stands_by(&mut spare);
    disk.fill();
    kill_host(&mut main);
    wait_until_it_runs(&mut spare);
    let unwritable = |report: &StatusReport| fault(report, "bridge", "tenure_unwritable");
    let text = spare.wait_until("the full disk is told", unwritable);
    assert!(text.contains("tenure-hall.json") && text.contains("No space"), "{text}");
    // Somebody watches. What is not in the journal there is told there only; the desk hears that the host
    // is not well.
    let told = Desk::open_while_degraded(&spare);
    let raised = told.hold_laser_until_told(&mut edge, 0);
    assert_eq!((raised.change.origin.as_str(), raised.journaled), ("hall@spare", false));
    edge.wait_until("the desk hears of it", |report| {
        let text = fault(report, "bridge", "host_unwell spare")?;
        text.contains("journal_unwritable").then_some(())
    });
    disk.free();
    let at_edge = Desk::open_while_degraded(&edge);
    at_edge.wait_for(0, "the event", |told| told.change.id == raised.change.id);
    spare.wait_until("room again", |report| unwritable(report).is_none().then_some(()));
    let stored = std::fs::read_to_string(spare.dir.join("state/spare/bridge/tenure-hall.json"));
    assert!(stored.unwrap().contains("\"owns\":true"));
    spare.stop();
    edge.stop();
}

#[test]
fn damaged_files_of_a_bridge_are_kept_aside_and_the_host_goes_on() {
    let toml = three_hosts();
    let (mut edge, mut main, mut spare) =
        (start(&toml, "edge"), start(&toml, "main"), start(&toml, "spare"));
    wait_until_it_runs(&mut main);
    wait_until_it_stands_by(&mut spare);
    main.stop();
    let bridge = main.dir.join("state/main/bridge");
    for file in ["epoch.json", "tenure-hall.json"] {
        std::fs::write(bridge.join(file), "{").unwrap();
    }
    wait_until_it_runs(&mut spare);
    main.start_again();
    for code in ["tenure_damaged hall", "journal_name_damaged"] {
        let text = main.wait_until(code, |report| fault(report, "bridge", code));
        assert!(text.contains("is damaged") && text.contains(".damaged-"), "{text}");
    }
    wait_until_it_stands_by(&mut main);
    assert!(runs_here(&spare.status().unwrap()), "one runs it");
    spare.stop();
    wait_until_it_runs(&mut main);
    main.stop();
    edge.stop();
}
