//! The session with the other hosts, before anything is said in it.

use crate::guard;
use crate::link::{self, Session};
use certificates::{Certificate, Files, Identity, common_name};
use process::{Failure, Interest, Worker, monotonic_ns, wall_ns};
use protocol::health::ServiceState;
use protocol::site::{Host, Site};
use protocol::time::SECOND_NS;
use std::os::unix::net::UnixStream;
use std::sync::mpsc;
use std::thread;
use std::time::Duration;

/// Nobody answered a client: it asks again after this long.
const AGAIN: Duration = Duration::from_millis(500);

/// The host that this is.
pub(super) fn me(worker: &Worker, site: &Site) -> Result<Host, Failure> {
    let me = worker.instance.host.as_deref().and_then(|id| site.host(id));
    me.cloned().ok_or_else(|| Failure::Config("a bridge needs a host".to_owned()))
}

pub(super) fn files(worker: &Worker, me: &Host) -> Files {
    Files::of(&worker.instance.resolve(&worker.site.tls_dir), &me.id)
}

/// Opens the session; none if it was asked to stop before a client was answered.
pub(super) fn open(worker: &mut Worker) -> Result<Option<Session>, Failure> {
    let site = worker.site.clone();
    let me = me(worker, &site)?;
    let files = files(worker, &me);
    certificate(&site, &me, &files)?;
    if me.through.is_empty() {
        return link::open(&site, &me, &files).map(Some).map_err(Failure::Failed);
    }
    // A client of zenoh waits for an answer: on a thread, so that this one is well and can be stopped.
    let (tell, told) = mpsc::channel();
    let (bell, ringer) = UnixStream::pair()?;
    let routers = me.through.join(", ");
    thread::Builder::new().name("dial".to_owned()).spawn(move || {
        let _rings_when_it_ends = ringer;
        let session = loop {
            match link::open(&site, &me, &files) {
                Ok(session) => break session,
                Err(error) => tracing::debug!("{error}"),
            }
            thread::sleep(AGAIN);
        };
        let _ = tell.send(session); // if it is to stop, nobody listens any more
    })?;
    let token = worker.events.watch(&bell, Interest::Read)?;
    let begun_ns = monotonic_ns();
    let session = loop {
        if let Ok(session) = told.try_recv() {
            break session;
        }
        let waits = monotonic_ns() - begun_ns > 3 * SECOND_NS;
        let words = waits.then(|| {
            format!("none of the hosts {routers} answers: they are asked again twice a second")
        });
        worker.health.set_fault("no_router", words);
        worker.health.set_state(ServiceState::Running);
        if worker.wait(Some(monotonic_ns() + SECOND_NS))?.stop {
            return Ok(None);
        }
        while worker.events.next_ready().is_some() {}
    };
    worker.health.set_fault("no_router", None);
    worker.events.unwatch(token, &bell)?;
    Ok(Some(session))
}

/// The certificate of this host, as it is when the session opens; none where the hosts speak plain TCP.
pub(super) fn certificate(
    site: &Site,
    me: &Host,
    files: &Files,
) -> Result<Option<Certificate>, Failure> {
    if !site.uses_tls() {
        return Ok(None);
    }
    let others = site.hosts.iter().filter(|host| host.id != me.id);
    guard::admit(others.map(|host| common_name(&site.name, &host.id)).collect());
    let identity = Identity::new(&site.name, &me.id, &me.endpoint);
    let now_s = (wall_ns() / SECOND_NS) as i64;
    let examined = certificates::examine(files, &identity, now_s).map_err(|problems| {
        let words: Vec<String> = problems.iter().map(ToString::to_string).collect();
        Failure::Config(words.join("; "))
    })?;
    Ok(Some(examined))
}
