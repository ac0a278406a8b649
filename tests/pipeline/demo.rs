//! `tog demo`: the whole system, alive, in a minute.

use super::support::{files, scratch, watched};
use harness::shared_memory;
use std::path::{Path, PathBuf};
use std::process::Command;

/// The intruder comes after 12 s of live running and is told within a minute.
const SECONDS: &str = "45";

#[test]
fn the_demo_raises_an_alert_ends_by_itself_and_leaves_nothing() {
    let scratch = scratch();
    let (run, temporary) = (scratch.path().join("r"), scratch.path().join("t"));
    std::fs::create_dir(&temporary).unwrap();
    let mut command = Command::new(env!("CARGO_BIN_EXE_tog"));
    command.args(["demo", "--seconds", SECONDS]).current_dir(scratch.path());
    command.env("TOG_RUN_DIR", &run).env("TMPDIR", &temporary).env_remove("RUST_LOG");
    let ended = watched(command);
    ended.expect(0, &["Watch for:", "ALERT", "tog alerts watch", "stopped"]);
    let alert = ended.err.lines().chain(ended.out.lines()).find(|line| line.contains("ALERT"));
    println!("{}", alert.unwrap_or_default());
    let says = |part| alert.is_some_and(|line| line.contains(part));
    assert!(says("foyer") && says("score"), "it says where and how sure it is: {alert:?}");

    assert_eq!(files(&temporary), Vec::<PathBuf>::new());
    assert_eq!(std::fs::read_dir(&temporary).unwrap().count(), 0, "no directory is left");
    assert_eq!(files(&run), Vec::<PathBuf>::new());
    let prefix = prefix(&ended.said(), &run);
    assert_eq!(shared_memory(&prefix), Vec::<PathBuf>::new());
}

/// The prefix of the demo's files in shared memory: `tog<12 hex digits>_`, a hash (FNV-1a) of the run
/// directory that it names and of the user. Written again here: a test that asked the code under test
/// where to look would look where the code looks.
fn prefix(said: &str, run: &Path) -> String {
    let (_, name) = said.split_once("demo-").unwrap();
    let pid: String = name.chars().take_while(char::is_ascii_digit).collect();
    let directory = run.canonicalize().unwrap().join(format!("demo-{pid}"));
    assert!(said.contains(&*directory.to_string_lossy()), "{}:\n{said}", directory.display());
    let user = rustix::process::getuid().as_raw().to_le_bytes();
    let bytes = directory.as_os_str().as_encoded_bytes().iter().chain(&user);
    let hash = bytes.fold(0xcbf2_9ce4_8422_2325_u64, |hash, byte| {
        (hash ^ u64::from(*byte)).wrapping_mul(0x0000_0100_0000_01b3)
    });
    format!("tog{:012x}_", (hash ^ hash >> 48) & 0xffff_ffff_ffff)
}
