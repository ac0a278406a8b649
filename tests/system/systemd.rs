//! What systemd is told; the test takes its place at the other end of the socket.

use super::ROOM;
use harness::{Scratch, Setup, WATCHDOG};
use std::os::unix::net::UnixDatagram;
use std::time::Instant;

#[test]
fn systemd_is_told_that_the_site_works_that_it_still_does_and_that_it_stops() {
    let scratch = Scratch::new();
    let path = scratch.0.join("notify");
    let socket = UnixDatagram::bind(&path).unwrap();
    socket.set_read_timeout(Some(WATCHDOG)).unwrap();
    let (begin, mut said) = (Instant::now(), Vec::<String>::new());
    // The `n`-th line that begins so.
    let mut word = |what: &str, n: usize| loop {
        if let Some(line) = said.iter().filter(|line| line.starts_with(what)).nth(n - 1) {
            return line.clone();
        }
        let mut bytes = [0; 4096];
        let length = socket.recv(&mut bytes).expect(what);
        said.extend(
            String::from_utf8(bytes[..length].to_vec()).unwrap().lines().map(str::to_owned),
        );
        assert!(begin.elapsed() < WATCHDOG, "{what} is never said: {said:?}");
    };
    let mut site =
        Setup::new(ROOM).env("NOTIFY_SOCKET", &path).env("WATCHDOG_USEC", "1000000").start();
    word("READY=1", 1);
    let report = site.status().unwrap();
    assert!(report.services.iter().all(|service| service.health_age_s.is_some()), "{report:?}");
    word("WATCHDOG=1", 2);
    let status = word("STATUS=", 1);
    assert!(status.contains("well"), "{status}");
    site.stop();
    word("STOPPING=1", 1);
}
