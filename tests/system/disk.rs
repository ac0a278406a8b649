//! A full disk under the journal: nothing is silent, and nothing is lost when there is room again.

use super::ROOM;
use super::feed::{Desk, assert_whole, journal, wait_until_all_is_journaled};
use harness::{Setup, find};
use protocol::event::{EventKind, EventState};
use std::fs::{self, File};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::Command;

/// A small disk, gone at the end.
pub struct Disk(PathBuf);

impl Disk {
    /// `None` where nobody may mount.
    pub fn mount(at: &Path) -> Option<Self> {
        Self::mount_of(at, "4m")
    }

    /// As [`Disk::mount`], of another size.
    pub fn mount_of(at: &Path, size: &str) -> Option<Self> {
        fs::create_dir_all(at).unwrap();
        let mut mount = Command::new("mount");
        mount.args(["-t", "tmpfs", "-o", &format!("size={size}"), "tog-test"]).arg(at);
        mount.output().ok()?.status.success().then(|| Self(at.to_owned()))
    }

    fn ballast(&self) -> PathBuf {
        self.0.join("ballast")
    }

    /// Takes all the room there is.
    pub fn fill(&self) {
        let mut file = File::create(self.ballast()).unwrap();
        while file.write_all(&[0; 4096]).is_ok() {}
    }

    pub fn free(&self) {
        fs::remove_file(self.ballast()).unwrap();
    }
}

impl Drop for Disk {
    fn drop(&mut self) {
        let _ = Command::new("umount").arg("-l").arg(&self.0).output();
    }
}

#[test]
fn a_full_disk_is_told_the_feed_goes_on_and_nothing_is_lost() {
    // Nothing but the journal and what goes to it shall write.
    let setup = Setup::new(&ROOM.replace("checkpoint_s = 1\n", "checkpoint_s = 3600\n"));
    let Some(disk) = Disk::mount(&setup.dir().join("state")) else {
        println!("skipped: no right to mount a small disk");
        return;
    };
    let mut site = setup.start();
    let disk = disk; // gone before the directory of the site
    site.wait_until_frames_flow(5);
    let desk = Desk::open(&mut site);

    disk.fill();
    let raised = desk.hold_laser_until_told(&mut site, 0);
    assert!(!raised.journaled && raised.journal_id.is_none(), "{raised:?}");
    for (service, code) in [("alerts", "journal_unwritable"), ("anomaly room", "outbox_storage")] {
        let text = site.wait_until(code, |report| {
            let fault = find(report, service).faults.iter().find(|fault| fault.code == code);
            fault.map(|fault| fault.text.clone())
        });
        assert!(text.contains("full") || text.contains("No space"), "{text}");
        let warned = |line: &String| line.contains(service) && line.contains("WARN");
        assert!(site.log().all().iter().any(warned), "{}", site.log().text());
        let status = site.tog(&["status"], &[]);
        let words = String::from_utf8(status.stdout).unwrap();
        assert!(status.status.code() == Some(1) && words.contains(code), "{words}");
    }
    desk.release_laser(&mut site, &raised.change.id);
    assert!(desk.told().iter().all(|told| !told.journaled), "there was no room");

    disk.free();
    for state in [EventState::Raised, EventState::Cleared] {
        desk.wait_for(0, "it is journaled", |told| {
            told.journaled && told.change.id == raised.change.id && told.change.state == state
        });
    }
    let storage = EventKind::StorageFault;
    desk.wait_for(0, "the end of the fault", |told| {
        told.journaled && told.change.kind == storage && told.change.state == EventState::Cleared
    });
    site.wait_until_healthy();
    wait_until_all_is_journaled(&mut site);
    let rows = journal(&site);
    assert_whole(&rows);
    let kinds: Vec<_> = rows.iter().map(|(_, change)| (change.kind, change.state)).collect();
    for kind in [EventKind::LaserSilent, storage] {
        for state in [EventState::Raised, EventState::Cleared] {
            assert_eq!(kinds.iter().filter(|k| **k == (kind, state)).count(), 1, "{rows:#?}");
        }
    }
    site.stop();
}
