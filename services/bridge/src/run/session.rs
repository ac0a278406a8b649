//! The session with the other hosts, before anything is said in it.

use crate::access::identity;
use crate::guard;
use crate::link::{self, Session};
use certificates::{Certificate, Files};
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

/// The session of this host.
pub(super) struct Opened {
    pub(super) me: Host,
    pub(super) session: Session,
    /// As it was when the session opened; none where the hosts speak plain TCP.
    pub(super) certificate: Option<Certificate>,
}

/// Opens the session; none if it was asked to stop before a client was answered.
pub(super) fn open(worker: &mut Worker) -> Result<Option<Opened>, Failure> {
    let site = worker.site.clone();
    let me = worker.instance.host.as_deref().and_then(|id| site.host(id)).cloned();
    let me = me.ok_or_else(|| Failure::Config("a bridge needs a host".to_owned()))?;
    let files = Files::of(&worker.instance.resolve(&site.tls_dir), &me.id);
    let certificate = certificate(&site, &me, &files)?;
    // A peer listens at once or not at all; a client waits for an answer.
    let opened = if me.through.is_empty() {
        link::open(&site, &me, &files)
    } else {
        Err(format!("none of the hosts {} answers", me.through.join(", ")))
    };
    let session = match opened {
        Ok(session) => Some(session),
        Err(error) => open_in_background(worker, site, me.clone(), files, &error)?,
    };
    Ok(session.map(|session| Opened { me, session, certificate }))
}

/// The session does not open: nobody answers a client, or somebody else has the port. It is tried again on
/// a thread, so that this one is well and can be stopped; the areas of this host go on meanwhile.
fn open_in_background(
    worker: &mut Worker,
    site: Site,
    me: Host,
    files: Files,
    error: &str,
) -> Result<Option<Session>, Failure> {
    let (tell, told) = mpsc::channel();
    let (bell, ringer) = UnixStream::pair()?;
    let (code, hint) = if me.through.is_empty() {
        ("cannot_listen", "`ss -ltnp` says who has the port. ")
    } else {
        ("no_router", "")
    };
    let words = format!("{error}. {hint}It is tried again twice a second");
    thread::Builder::new().name("dial".to_owned()).spawn(move || {
        let _rings_when_it_ends = ringer;
        let session = loop {
            match link::open(&site, &me, &files) {
                Ok(session) => break session,
                Err(error) => tracing::debug!("{error}"),
            }
            thread::sleep(AGAIN); // whoever refuses does so at once
        };
        let _ = tell.send(session); // if it is to stop, nobody listens any more
    })?;
    let token = worker.events.watch(&bell, Interest::Read)?;
    let begun_ns = monotonic_ns();
    worker.health.set_state(ServiceState::Running);
    let session = loop {
        if let Ok(session) = told.try_recv() {
            break session;
        }
        let waits = monotonic_ns() - begun_ns > 3 * SECOND_NS;
        worker.health.set_fault(code, waits.then(|| words.clone()));
        if worker.wait(None)?.stop {
            return Ok(None);
        }
        while worker.events.next_ready().is_some() {}
    };
    worker.health.set_fault(code, None);
    worker.events.unwatch(token, &bell)?;
    Ok(Some(session))
}

fn certificate(site: &Site, me: &Host, files: &Files) -> Result<Option<Certificate>, Failure> {
    if !site.uses_tls() {
        return Ok(None);
    }
    let others = site.hosts.iter().filter(|host| host.id != me.id);
    guard::admit(others.map(|host| identity(site, host).common_name()).collect());
    let now_s = (wall_ns() / SECOND_NS) as i64;
    let examined =
        certificates::examine(files, &identity(site, me), now_s).map_err(|problems| {
            let words: Vec<String> = problems.iter().map(ToString::to_string).collect();
            Failure::Config(words.join("; "))
        })?;
    Ok(Some(examined))
}
