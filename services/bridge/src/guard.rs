//! Who knocks without the right to: counted, told, and told to be over.
//!
//! zenoh refuses in silence: a denied message leaves a line of its log at `trace`, a connection without
//! a good certificate one at `warn` with a hint that is wrong. So the bridge overhears those lines
//! (zenoh 1.10.2: `access_control.rs`, `zenoh-link-tls/unicast.rs`) and prints none of them. When zenoh
//! changes its words, `tests/system/intruder.rs` fails.

use process::overhear::{Overhear, overhear};
use protocol::time::SECOND_NS;
use std::cell::Cell;
use std::collections::BTreeMap;
use std::sync::{Mutex, OnceLock, PoisonError};
use tracing::Level;

const ACCESS: &str = "zenoh::net::routing::interceptor::access_control";
const TLS: &str = "zenoh_link_tls";
/// The fault is over when nobody knocked for so long.
const QUIET_NS: u64 = 300 * SECOND_NS;
/// What is said of the last one is cut to this, characters.
const WORDS_MAX: usize = 160;
/// For each key that a peer declares, zenoh looks up what it may do with it, and says so of each of
/// these kinds of messages; nothing was sent yet.
const KINDS_LOOKED_UP: u8 = 9;

/// Who may connect: the common names of the hosts of the site.
static KNOWN: OnceLock<Vec<String>> = OnceLock::new();
static TOTALS: Mutex<Totals> = Mutex::new(Totals::NONE);

/// The names in the certificates of those who speak, by their sessions.
static SESSIONS: Mutex<BTreeMap<String, String>> = Mutex::new(BTreeMap::new());
const SESSIONS_MAX: usize = 256;

thread_local! {
    static LOOKED_UP: Cell<u8> = const { Cell::new(0) };
}

/// What was refused so far.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Totals {
    /// Messages of peers that they may not send.
    pub messages: u64,
    /// Connections without a good certificate, or of a host that the site does not have.
    pub connections: u64,
    /// The last message, in words.
    pub last_message: String,
    /// The last connection, in words.
    pub last_connection: String,
    /// Connections that ended before a word was said: whoever looks whether somebody is there (`tog
    /// doctor`), and friends whose link was cut meanwhile. No reason to call anybody.
    pub wordless: u64,
}

impl Totals {
    const NONE: Self = Self {
        messages: 0,
        connections: 0,
        last_message: String::new(),
        last_connection: String::new(),
        wordless: 0,
    };

    fn take(&mut self, knock: Knock) {
        let (count, last, words) = match knock {
            Knock::Message(words) => (&mut self.messages, &mut self.last_message, words),
            Knock::Connection(words) => (&mut self.connections, &mut self.last_connection, words),
            Knock::Wordless => {
                self.wordless += 1;
                return;
            }
        };
        *count += 1;
        *last = words.chars().filter(|c| !c.is_control()).take(WORDS_MAX).collect();
    }
}

#[derive(Debug, PartialEq, Eq)]
enum Knock {
    Message(String),
    Connection(String),
    Wordless,
}

/// Makes this process hear what zenoh refuses. Call it before logging starts.
pub fn listen() {
    overhear(Overhear { targets: &[(ACCESS, Level::TRACE), (TLS, Level::DEBUG)], hear });
}

/// From here on these common names may connect.
pub(crate) fn admit(common_names: Vec<String>) {
    let _ = KNOWN.set(common_names);
}

/// What was refused so far.
pub(crate) fn totals() -> Totals {
    TOTALS.lock().unwrap_or_else(PoisonError::into_inner).clone()
}

fn hear(target: &str, text: &str) {
    let known = KNOWN.get().map_or(&[][..], Vec::as_slice);
    let knock = if target.starts_with(ACCESS) {
        LOOKED_UP.with(|looked_up| denied(text, looked_up))
    } else {
        refused(text, known)
    };
    if let Some(knock) = knock {
        TOTALS.lock().unwrap_or_else(PoisonError::into_inner).take(knock);
    }
}

/// A line of the access control: a message that was refused, if it is one.
fn denied(text: &str, looked_up: &Cell<u8>) -> Option<Knock> {
    if text.starts_with("ACL (ingress): caching") {
        looked_up.set(KINDS_LOOKED_UP);
        return None;
    }
    let cached = text.strip_prefix("Using cached result: ");
    let refused = cached.unwrap_or(text).split_once(" is unauthorized to ");
    let refused = refused.map(|(who, what)| (speaker(who), what));
    if cached.is_none() && looked_up.get() > 0 {
        looked_up.set(looked_up.get() - 1);
        return None;
    }
    let (who, what) = refused?;
    let (kind, key) = what.split_once(" (ingress) on ")?;
    let kind = kind.to_lowercase();
    Some(Knock::Message(format!("a {kind} for {key} from {who}, which may not send it")))
}

/// Who speaks: `<session> on ..+CertCommonName(<name>)+..`, and a session that was heard of so is known by
/// its name later.
fn speaker(who: &str) -> String {
    let mut sessions = SESSIONS.lock().unwrap_or_else(PoisonError::into_inner);
    let named = who.split_once(" on ").and_then(|(session, subject)| {
        let (_, name) = subject.split_once("CertCommonName(")?;
        Some((session, name.split_once(')')?.0))
    });
    if let Some((session, name)) = named {
        if sessions.len() >= SESSIONS_MAX && !sessions.contains_key(session) {
            sessions.clear(); // each is heard of again with its next key
        }
        sessions.insert(session.to_owned(), name.to_owned());
        return name.to_owned();
    }
    sessions.get(who).cloned().unwrap_or_else(|| "whoever has no name here".to_owned())
}

/// A line of the listener: a connection that was refused, or is of somebody the site does not have.
fn refused(text: &str, known: &[String]) -> Option<Knock> {
    if let Some((reason, _)) = text.split_once(". Hint: increase the system open file limit") {
        let is_wordless = reason.contains("handshake eof");
        let refused = || Knock::Connection(format!("no good certificate ({reason})"));
        return Some(if is_wordless { Knock::Wordless } else { refused() });
    }
    if text.starts_with("Error getting client cert") {
        return Some(Knock::Connection(text.to_owned()));
    }
    let accepted = text.strip_prefix("Accepted TLS connection on ")?;
    // `<address of ours>: <address of theirs>. Common Name: <name>.`
    let name = accepted.split_once(". Common Name: ").and_then(|(_, name)| name.strip_suffix('.'));
    if name.is_some_and(|name| known.iter().any(|other| other == name)) {
        return None;
    }
    Some(Knock::Connection(format!("a certificate of no host of this site ({accepted})")))
}

/// Turns totals into a fault that ends when it is quiet again. Pure.
#[derive(Debug, Default)]
pub struct Alarm {
    told: Totals,
    last_ns: Option<u64>,
    since: Totals,
}

impl Alarm {
    /// The fault, given the totals at this time (CLOCK_MONOTONIC, nanoseconds).
    pub fn fault(&mut self, totals: &Totals, mono_ns: u64) -> Option<String> {
        let counts = |totals: &Totals| (totals.messages, totals.connections);
        if counts(totals) != counts(&self.told) {
            if self.last_ns.is_none() {
                self.since = std::mem::take(&mut self.told);
            }
            (self.told, self.last_ns) = (totals.clone(), Some(mono_ns));
        }
        let last_ns = self.last_ns?;
        if mono_ns.saturating_sub(last_ns) >= QUIET_NS {
            self.last_ns = None;
            return None;
        }
        let messages = totals.messages - self.since.messages;
        let connections = totals.connections - self.since.connections;
        let last = |count: u64, words: &str| match count {
            0 => String::new(),
            _ => format!(" (the last: {words})"),
        };
        Some(format!(
            "somebody without the right to tried to reach this host: {connections} connections{} and \
             {messages} messages{} were refused, nothing of them was taken. This is said until nobody tried \
             for {} minutes",
            last(connections, &totals.last_connection),
            last(messages, &totals.last_message),
            QUIET_NS / (60 * SECOND_NS),
        ))
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn message(text: &str, looked_up: &Cell<u8>) -> Option<String> {
        match denied(text, looked_up)? {
            Knock::Message(words) => Some(words),
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn a_message_that_is_refused_is_heard_and_what_is_only_looked_up_is_not() {
        let none = Cell::new(0);
        let text = "ab12 on Interface(lo)+CertCommonName(edge.lab)+Transport(Tls) is unauthorized to Put (ingress) on tog/lab/desk/health";
        let words = message(text, &none).unwrap();
        assert_eq!(words, "a put for tog/lab/desk/health from edge.lab, which may not send it");
        assert_eq!(
            message(
                "ab12 on Interface(lo)+CertCommonName(edge.lab)+Transport(Tls) is authorized to Put (ingress) on tog/a",
                &none
            ),
            None
        );
        assert_eq!(
            message(
                "ab12 on Interface(lo)+CertCommonName(edge.lab)+Transport(Tls) is unauthorized to Put (egress) on tog/a",
                &none
            ),
            None
        );
        assert_eq!(message("ACL (ingress): caching permissions for `tog/a` ...", &none), None);
        for _ in 0..KINDS_LOOKED_UP {
            assert_eq!(message(text, &none), None);
        }
        assert!(message(text, &none).is_some());
        none.set(KINDS_LOOKED_UP);
        let cached = "Using cached result: ab12 is unauthorized to Put (ingress) on tog/a";
        assert!(message(cached, &none).unwrap().ends_with("from edge.lab, which may not send it"));
        let stranger = cached.replace("ab12", "cd34");
        assert!(
            message(&stranger, &none).unwrap().contains("from whoever has no name here, which"),
            "not heard of yet"
        );
    }

    #[test]
    fn a_connection_is_refused_for_its_certificate_or_because_nobody_knows_its_name() {
        let known = ["edge.lab".to_owned()];
        let words = |text: &str| match refused(text, &known)? {
            Knock::Connection(words) => Some(words),
            other => panic!("{other:?}"),
        };
        let eof = "tls handshake eof. Hint: increase the system open file limit.";
        assert_eq!(refused(eof, &known), Some(Knock::Wordless));
        let text = "peer sent no certificates. Hint: increase the system open file limit.";
        assert_eq!(words(text).unwrap(), "no good certificate (peer sent no certificates)");
        let accepted = |name: &str| {
            format!("Accepted TLS connection on 10.0.0.1:1: 10.0.0.2:2. Common Name: {name}.")
        };
        assert_eq!(words(&accepted("edge.lab")), None);
        assert!(words(&accepted("xedge.lab")).unwrap().contains("no host of this site"));
        assert!(words(&accepted("edge.lab.evil")).is_some());
    }

    #[test]
    fn the_alarm_ends_when_it_is_quiet_and_counts_anew() {
        let mut alarm = Alarm::default();
        let mut totals = Totals::default();
        assert_eq!(alarm.fault(&totals, 1), None);
        totals.take(Knock::Message("a\u{7}b".to_owned()));
        totals.take(Knock::Connection("c".to_owned()));
        let text = alarm.fault(&totals, 2).unwrap();
        let both = "1 connections (the last: c) and 1 messages (the last: ab) were refused";
        assert!(text.contains(both), "{text}");
        assert!(alarm.fault(&totals, 2 + QUIET_NS - 1).is_some());
        assert_eq!(alarm.fault(&totals, 2 + QUIET_NS), None);
        totals.take(Knock::Message("d".to_owned()));
        let text = alarm.fault(&totals, 3 + QUIET_NS).unwrap();
        assert!(text.contains("0 connections and 1 messages (the last: d) were"), "{text}");
    }
}
