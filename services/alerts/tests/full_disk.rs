//! A disk that is really full: a small tmpfs, filled up. Needs the right to mount; says so and ends
//! if it is missing.
#![allow(clippy::unwrap_used)]

use alerts::journal::JOURNAL_FILE;
use alerts::keeper::ORIGIN;
use alerts::{Keeper, Now, Report};
use protocol::event::{EventChange, EventKind, EventState};
use protocol::time::SECOND_NS;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

struct SmallDisk {
    directory: tempfile::TempDir,
}

impl SmallDisk {
    fn mount(bytes: usize) -> Option<Self> {
        let directory = tempfile::tempdir().unwrap();
        let mounted = Command::new("mount")
            .args(["-t", "tmpfs", "-o", &format!("size={bytes}"), "tmpfs"])
            .arg(directory.path())
            .stderr(Stdio::null())
            .status();
        if mounted.is_ok_and(|status| status.success()) {
            return Some(Self { directory });
        }
        println!("skipped: no right to mount a small disk here");
        None
    }

    fn journal(&self) -> PathBuf {
        self.directory.path().join(JOURNAL_FILE)
    }

    fn ballast(&self) -> PathBuf {
        self.directory.path().join("ballast")
    }

    fn fill(&self) {
        let mut file = std::fs::File::create(self.ballast()).unwrap();
        while file.write_all(&[7; 512]).is_ok() {}
    }

    fn make_room(&self) {
        std::fs::remove_file(self.ballast()).unwrap();
    }
}

impl Drop for SmallDisk {
    fn drop(&mut self) {
        let _ = Command::new("umount").arg("-l").arg(self.directory.path()).status();
    }
}

fn now(mono_s: u64) -> Now {
    Now { unix_ns: (1_795_000_000 + mono_s) * SECOND_NS, mono_ns: mono_s * SECOND_NS }
}

fn change(sequence: u64) -> EventChange {
    EventChange {
        origin: "foyer".to_owned(),
        sequence,
        id: format!("foyer-{sequence}"),
        kind: EventKind::Crowd,
        state: EventState::Raised,
        stamp_ns: 1_794_976_001_000_000_000,
        first_evidence_ns: 1_794_976_000_000_000_000,
        area: "foyer".to_owned(),
        zone: None,
        x_m: 1.0,
        y_m: 2.0,
        bounds_m: [0.0, 1.0, 2.0, 3.0],
        score: 2.0,
        threshold: 1.0,
        extrapolated: false,
        text: "seven people where two are normal".to_owned(),
    }
}

/// Room comes back when the last descriptor of the ballast is closed, and a process that another
/// test is just starting may hold a copy for a moment.
fn tick_until_written(keeper: &mut Keeper) -> Report {
    let began = std::time::Instant::now();
    for mono_s in (100..).step_by(100) {
        let report = keeper.tick(now(mono_s));
        if keeper.faults().is_empty() {
            return report;
        }
        assert!(began.elapsed().as_secs() < 60, "{:?}", keeper.faults());
    }
    unreachable!("numbers do not end")
}

fn journaled(path: &Path, now: Now) -> Vec<(String, u64)> {
    let (keeper, _) = Keeper::open(path, now).unwrap();
    let rows = keeper.after(0, 9999).unwrap();
    let changes = rows.iter().map(|row| row.change().unwrap());
    changes.map(|change| (change.origin, change.sequence)).collect()
}

#[test]
fn a_disk_that_fills_up_loses_nothing_and_the_journal_goes_on_when_there_is_room() {
    let Some(disk) = SmallDisk::mount(1 << 20) else { return };
    let (mut keeper, _) = Keeper::open(&disk.journal(), now(0)).unwrap();
    keeper.offer(vec![change(1)], now(0));
    disk.fill();
    let mut sequence = 1;
    let fault = loop {
        sequence += 1;
        keeper.offer(vec![change(sequence)], now(1));
        if let [fault] = &keeper.faults()[..] {
            break fault.clone();
        }
    };
    assert!(
        fault.text.contains("free space") || fault.text.contains("check the disk"),
        "{fault:?}"
    );
    sequence += 1;
    let report = keeper.offer(vec![change(sequence)], now(1));
    assert!(report.acknowledgements.is_empty());
    assert!(!report.told[0].1, "told, and marked as not on disk");
    assert!(keeper.tick(now(2)).told.is_empty());
    assert_eq!(keeper.faults().len(), 1, "still full");
    disk.make_room();
    let report = tick_until_written(&mut keeper);
    assert_eq!(report.acknowledgements[0].sequence, sequence);
    drop(keeper);
    let rows = journaled(&disk.journal(), now(101));
    let of_foyer: Vec<u64> = rows
        .iter()
        .filter(|(origin, _)| origin == "foyer")
        .map(|(_, sequence)| *sequence)
        .collect();
    assert_eq!(of_foyer, (1..=sequence).collect::<Vec<_>>());
    assert_eq!(rows.iter().filter(|(origin, _)| origin == ORIGIN).count(), 2, "raised, cleared");
}

#[test]
fn a_service_that_starts_on_a_full_disk_tells_and_journals_later() {
    let Some(disk) = SmallDisk::mount(1 << 20) else { return };
    let (mut keeper, _) = Keeper::open(&disk.journal(), now(0)).unwrap();
    keeper.offer(vec![change(1), change(2)], now(0));
    drop(keeper);
    disk.fill();
    let (mut keeper, _) = Keeper::open(&disk.journal(), now(1)).unwrap();
    let mut sequence = 2;
    while keeper.faults().is_empty() {
        sequence += 1;
        keeper.offer(vec![change(sequence)], now(1));
    }
    sequence += 1;
    let report = keeper.offer(vec![change(sequence)], now(1));
    assert_eq!(report.told, [(change(sequence), false)]);
    disk.make_room();
    tick_until_written(&mut keeper);
    assert_eq!(keeper.acknowledgement("foyer").unwrap().sequence, sequence);
    drop(keeper);
    let rows = journaled(&disk.journal(), now(101));
    assert!((1..=sequence).all(|sequence| rows.contains(&("foyer".to_owned(), sequence))));
}
