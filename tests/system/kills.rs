//! SIGKILL: each service in turn, and anybody at any moment.

use super::{ROOM, SERVICES};
use harness::{Random, Site, count, find, is_nightly, kill, pids};
use mapper::checkpoint::{self, Checkpoint};
use mapper::shell::checkpoint_path;
use rustix::process::Signal;
use std::collections::BTreeMap;
use std::time::{Duration, Instant};
use supervisor::ProcessState;

#[test]
fn each_service_that_is_killed_twice_comes_back_and_the_others_never_stop() {
    let mut site = Site::start(ROOM);
    site.wait_until_frames_flow(10);
    for service in SERVICES {
        for time in ["first", "second"] {
            let before = site.wait_until_frames_flow(5);
            let others = |report| {
                let mut pids = pids(report);
                pids.remove(service);
                pids
            };
            let killed = site.kill(service, Signal::KILL);
            let start = Instant::now();
            let back = site.wait_until("its return", |report| {
                let found = find(report, service);
                let is_back = found.state == ProcessState::Running && found.pid != Some(killed);
                is_back.then(|| found.clone())
            });
            println!("{service}, {time} kill: back after {} ms", start.elapsed().as_millis());
            assert_eq!(back.restarts, find(&before, service).restarts + 1);
            assert_eq!(back.last_end.as_deref(), Some("signal 9"));
            let after = site.wait_until_frames_flow(5);
            assert_eq!(others(&after), others(&before), "{}", site.log().text());
            for service in &after.services {
                let lost = ["frames_lost", "class_maps_lost", "changes_lost"];
                let lost: u64 = lost.iter().map(|counter| count(service, counter)).sum();
                assert_eq!(lost, 0, "{service:?}");
            }
        }
    }
    let restarts: Vec<u64> = site.status().unwrap().services.iter().map(|s| s.restarts).collect();
    assert_eq!(restarts, [2; 6]);
    site.stop();
}

/// The checkpoint on disk, and all its counts.
fn checkpoint_of(site: &Site) -> Checkpoint {
    let path = checkpoint_path(&site.dir.join("state"), "room");
    checkpoint::decode(&std::fs::read(path).unwrap()).unwrap()
}

fn last_number(checkpoint: &Checkpoint) -> u64 {
    checkpoint.history.as_ref().map_or(0, |history| history.last_number)
}

#[test]
fn a_killed_mapper_loses_no_count_of_its_last_checkpoint() {
    let mut site = Site::start(ROOM);
    for _ in 0..3 {
        let checkpoints = |written: u64| {
            move |report: &supervisor::StatusReport| {
                let mapper = find(report, "mapper room");
                (count(mapper, "checkpoints_written") >= written).then_some(())
            }
        };
        let path = checkpoint_path(&site.dir.join("state"), "room");
        site.wait_until("a checkpoint with counts", |_| {
            let checkpoint = checkpoint::decode(&std::fs::read(&path).ok()?).ok()?;
            (checkpoint.contexts[0].1.iter().sum::<u64>() > 0).then_some(())
        });
        let killed = site.kill("mapper room", Signal::KILL);
        site.wait_until("its return", |report| {
            let mapper = find(report, "mapper room");
            let is_back = mapper.pid.is_some_and(|pid| pid != killed);
            is_back.then_some(())
        });
        // Whoever is killed leaves a whole file; whoever comes goes on from just that.
        let before = checkpoint_of(&site);
        assert!(before.contexts[0].1.iter().sum::<u64>() > 0, "it has counted");
        site.wait_until("a checkpoint of the new one", checkpoints(1));
        let after = checkpoint_of(&site);
        assert!(last_number(&after) > last_number(&before));
        for (old, new) in before.contexts.iter().zip(&after.contexts) {
            assert_eq!(old.0, new.0);
            assert!(old.1.iter().zip(&new.1).all(|(old, new)| new >= old), "a count was lost");
        }
        let gone_on = |line: &&String| line.contains("mapper room") && line.contains("goes on");
        assert!(site.log().all().iter().any(|line| gone_on(&line)), "{}", site.log().text());
    }
    site.stop();
}

#[test]
fn a_mapper_that_is_asked_to_stop_writes_what_it_has_counted() {
    let mut site = Site::start(&ROOM.replace("checkpoint_s = 1", "checkpoint_s = 3600"));
    let path = checkpoint_path(&site.dir.join("state"), "room");
    // Frames are counted from half of the longest timescale on.
    site.wait_until_frames_flow(40);
    assert!(!path.exists(), "the first is due in an hour");
    site.stop();
    assert!(checkpoint_of(&site).contexts[0].1.iter().sum::<u64>() > 0);
}

/// Kills anybody at any moment, start-up included.
fn storm(kills: u32) {
    let mut random = Random::from_environment();
    let mut site = Site::start(ROOM);
    let start = Instant::now();
    let mut killed = BTreeMap::<String, u32>::new();
    let mut hits = BTreeMap::<String, u32>::new();
    while hits.values().sum::<u32>() < kills {
        // Half of them as soon as there is anybody, half a moment later: the moment is random, it
        // stands for no condition.
        if random.below(2) == 0 {
            site.log().wait_a_moment(Duration::from_millis(random.below(500)));
        }
        let pick = random.below(1 << 30) as usize;
        let (name, pid) = site.wait_until("somebody to kill", |report| {
            let fresh =
                pids(report).into_iter().filter(|(name, pid)| killed.get(name) != Some(pid));
            let fresh: Vec<_> = fresh.collect();
            (!fresh.is_empty()).then(|| fresh[pick % fresh.len()].clone())
        });
        if kill(pid, Signal::KILL) {
            *hits.entry(name.clone()).or_default() += 1;
        }
        killed.insert(name, pid);
    }
    let stormed = start.elapsed();
    let report = site.wait_until_frames_flow(20);
    let healed = start.elapsed() - stormed;
    println!("{hits:?} in {stormed:.1?}, well and flowing {healed:.1?} later");
    let restarts: u64 = report.services.iter().map(|service| service.restarts).sum();
    assert_eq!(restarts, u64::from(kills), "nobody died of anything else: {}", report.table());
    for service in &report.services {
        assert_eq!(service.faults, [], "{}", service.name);
    }
    site.stop();
}

#[test]
fn forty_kills_at_any_moment_heal_without_a_hand() {
    storm(40);
}

#[test]
fn four_hundred_kills_at_any_moment_heal_without_a_hand() {
    if is_nightly() {
        storm(400);
    } else {
        println!("skipped: set TOG_NIGHTLY=1");
    }
}
