#![allow(clippy::unwrap_used)]
use super::*;
use crate::issue::{init, issue};
use std::os::unix::fs::PermissionsExt;

const NOW_S: i64 = 1_795_000_000;

fn identity() -> Identity {
    Identity::new("lab", "edge", "10.0.0.7:7447")
}

fn made() -> (tempfile::TempDir, Files) {
    let directory = tempfile::tempdir().unwrap();
    init(&directory.path().join("ca"), "lab", NOW_S, 3650).unwrap();
    let out = directory.path().join("edge");
    let files = issue(&directory.path().join("ca"), &out, &identity(), NOW_S, 365).unwrap();
    (directory, files)
}

#[track_caller]
fn wrong(files: &Files, identity: &Identity, now_s: i64, part: &str) {
    let problems = examine(files, identity, now_s).unwrap_err();
    let text: Vec<String> = problems.iter().map(ToString::to_string).collect();
    assert!(text.iter().any(|text| text.contains(part)), "{part}: {text:#?}");
}

#[test]
fn what_is_issued_is_what_a_host_must_have() {
    let (directory, files) = made();
    let certificate = examine(&files, &identity(), NOW_S).unwrap();
    assert_eq!(certificate.common_name, "edge.lab");
    assert_eq!(certificate.names, ["10.0.0.7"]);
    assert_eq!(certificate.issuer, "tog authority of lab");
    assert_eq!((certificate.is_ca, certificate.days_left(NOW_S)), (false, 365));
    let mode = |path: &Path| fs::metadata(path).unwrap().permissions().mode() & 0o777;
    assert_eq!(mode(&files.key), 0o600);
    assert_eq!(mode(&directory.path().join("ca/site-ca.key")), 0o600);
}

#[test]
fn nothing_is_overwritten() {
    let (directory, files) = made();
    let before = fs::read(&files.key).unwrap();
    let ca = directory.path().join("ca");
    assert!(init(&ca, "lab", NOW_S, 1).unwrap_err().to_string().contains("not overwritten"));
    let out = files.key.parent().unwrap();
    let again = issue(&ca, out, &identity(), NOW_S, 1).unwrap_err();
    assert!(again.to_string().contains("is there already"), "{again}");
    assert_eq!(fs::read(&files.key).unwrap(), before);
}

#[test]
fn the_authority_of_another_site_signs_nothing() {
    let (directory, _) = made();
    let (ca, out) = (directory.path().join("ca"), directory.path().join("out"));
    let stranger = Identity::new("shop", "edge", "10.0.0.7:7447");
    let refused = issue(&ca, &out, &stranger, NOW_S, 1).unwrap_err().to_string();
    assert!(refused.contains("it is that of the site lab, expected shop"), "{refused}");
    assert!(!out.exists());
}

#[test]
fn each_thing_that_can_be_wrong_is_said() {
    let (directory, files) = made();
    wrong(&files, &identity(), NOW_S + 366 * DAY_S, "it expired on 2027-11-18");
    wrong(&files, &identity(), NOW_S - 2 * DAY_S, "and the clock says 2026-11-16");
    let desk = Identity::new("lab", "desk", "10.0.0.7:7447");
    wrong(&files, &desk, NOW_S, "it is of \"edge.lab\", expected \"desk.lab\"");
    let moved = Identity::new("lab", "edge", "10.0.0.8:7447");
    wrong(&files, &moved, NOW_S, "good for 10.0.0.7, expected 10.0.0.8");
    fs::set_permissions(&files.key, fs::Permissions::from_mode(0o640)).unwrap();
    wrong(&files, &identity(), NOW_S, "others can read it (mode 640)");
    fs::set_permissions(&files.key, fs::Permissions::from_mode(0o600)).unwrap();

    let other = directory.path().join("other");
    init(&other, "lab", NOW_S, 3650).unwrap();
    let foreign = Files { ca: other.join("site-ca.pem"), ..files.clone() };
    wrong(&foreign, &identity(), NOW_S, "which is not the authority in");
    let out = directory.path().join("twin");
    let twin = issue(&other, &out, &identity(), NOW_S, 365).unwrap();
    let mixed = Files { key: twin.key, ..files.clone() };
    wrong(&mixed, &identity(), NOW_S, "it is not the key of");
    let no_ca = Files { ca: files.certificate.clone(), ..files.clone() };
    wrong(&no_ca, &identity(), NOW_S, "is not an authority");
    fs::write(&files.certificate, "garbage").unwrap();
    wrong(&files, &identity(), NOW_S, "expected a certificate in PEM");
    fs::remove_file(&files.key).unwrap();
    wrong(&files, &identity(), NOW_S, "edge.key: cannot read");
}

#[test]
fn a_certificate_of_another_number_is_not_that_of_the_host() {
    let (directory, files) = made();
    let second = identity().numbered(2);
    wrong(&files, &second, NOW_S, "it is of \"edge.lab\", expected \"edge.2.lab\"");
    let (ca, out) = (directory.path().join("ca"), directory.path().join("second"));
    let anew = issue(&ca, &out, &second, NOW_S, 365).unwrap();
    assert_eq!(examine(&anew, &second, NOW_S).unwrap().common_name, "edge.2.lab");
    wrong(&anew, &identity(), NOW_S, "it is of \"edge.2.lab\", expected \"edge.lab\"");
}

#[test]
fn an_end_that_comes_near_is_told_in_time() {
    let (_directory, files) = made();
    let certificate = read(&files.certificate).unwrap();
    assert_eq!(certificate.expires_soon(NOW_S + 300 * DAY_S), None);
    let soon = certificate.expires_soon(NOW_S + 340 * DAY_S).unwrap();
    assert!(soon.contains("in 25 days"), "{soon}");
    let late = certificate.expires_soon(NOW_S + 400 * DAY_S).unwrap();
    assert!(late.contains("expired on 2027-11-18"), "{late}");
}

#[test]
fn an_endpoint_is_an_address_and_a_port() {
    let address = |endpoint| Identity::new("s", "h", endpoint).address;
    assert_eq!(address("[fd00::2]:7447"), "fd00::2");
    assert_eq!(address("edge.example:1"), "edge.example");
    assert!(
        same_name("fd00::2", "fd00:0:0:0:0:0:0:2") && same_name("Edge.example", "edge.EXAMPLE")
    );
    assert!(!same_name("10.0.0.1", "10.0.0.2"));
}
