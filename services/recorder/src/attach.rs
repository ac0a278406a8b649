//! What lies at the begin of every file: the site file, the calibration, and who recorded when.
//!
//! The site file is written anew from what was read: comments are not in it. **Secrets are
//! replaced** by the text `removed`: every text under a key that has `secret`, `password`,
//! `passwd`, `token`, `credential`, `api_key` or `private` in its name, and name and password in
//! an address (`https://me:word@host`). Names of files stay (`state_dir`, scenes, recordings):
//! what is in them does not travel.

use crate::catalogue::Catalogue;
use process::Clock;
use protocol::site::{Area, Site};
use serde_json::{Value, json};
use std::collections::BTreeMap;

/// What a secret is replaced by.
pub const REMOVED: &str = "removed";
/// Name of the site file in a recording.
pub const SITE_FILE: &str = "site.toml";
/// Name of the metadata record about a session.
pub const SESSION: &str = "tog.session";
/// Parts of the names of keys whose texts are secrets.
const SECRET_WORDS: [&str; 7] =
    ["secret", "password", "passwd", "token", "credential", "api_key", "private"];

/// A file to be attached.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Attachment {
    /// Its name.
    pub name: &'static str,
    /// What it is.
    pub media_type: &'static str,
    /// Its text.
    pub text: String,
}

/// The site file without its secrets, and the calibration.
#[must_use]
pub fn attachments(site: &Site, catalogue: &Catalogue) -> Vec<Attachment> {
    let calibration = Attachment {
        name: "calibration.json",
        media_type: "application/json",
        text: format!("{:#}\n", calibration(site, catalogue)),
    };
    // What can be replayed: of a followed area only the maps are here, not its lasers.
    let mut replayable = site.clone();
    let has_laser = |area: &Area| site.lasers.iter().any(|laser| laser.area == area.id);
    replayable.areas.retain(has_laser);
    let site = site_text(&replayable).map(|text| Attachment {
        name: SITE_FILE,
        media_type: "application/toml",
        text,
    });
    site.into_iter().chain([calibration]).collect()
}

/// The site file without its secrets; `None` if a number in it is larger than TOML can say.
#[must_use]
pub fn site_text(site: &Site) -> Option<String> {
    let mut value = serde_json::to_value(site).ok()?;
    strip("", &mut value);
    let head = "# As tog read it; secrets are replaced by \"removed\".\n";
    toml::to_string(&value).ok().map(|text| format!("{head}{text}"))
}

/// Replaces secrets, and takes out what is not set: TOML has no null.
fn strip(key: &str, value: &mut Value) {
    let lower = key.to_ascii_lowercase();
    match value {
        Value::Object(map) => {
            map.retain(|_, value| !value.is_null());
            map.iter_mut().for_each(|(key, value)| strip(key, value));
        }
        Value::Array(items) => items.iter_mut().for_each(|item| strip(key, item)),
        Value::String(text) if SECRET_WORDS.iter().any(|word| lower.contains(word)) => {
            REMOVED.clone_into(text);
        }
        Value::String(text) => strip_address(text),
        _ => {}
    }
}

/// `https://me:word@host/path` becomes `https://removed@host/path`.
fn strip_address(text: &mut String) {
    let Some(begin) = text.find("://").map(|at| at + 3) else { return };
    let authority = text[begin..].find(['/', '?', '#']).map_or(text.len(), |end| begin + end);
    if let Some(at) = text[begin..authority].rfind('@') {
        text.replace_range(begin..begin + at, REMOVED);
    }
}

fn calibration(site: &Site, catalogue: &Catalogue) -> Value {
    let lasers = site.lasers.iter().zip(&catalogue.lasers).map(|(laser, topics)| {
        json!({
            "id": laser.id,
            "area": laser.area,
            "frame": topics.frame,
            "x_m": laser.x_m,
            "y_m": laser.y_m,
            "yaw_deg": laser.yaw_deg,
            "half_beam_deg": laser.half_beam_deg,
        })
    });
    let areas = site.areas.iter().map(|area| {
        json!({
            "id": area.id,
            "grid": serde_json::to_value(area.grid()).unwrap_or_default(),
            "frame_period_ms": area.frame_period_ms,
            "timescales_s": area.timescales_s,
            "classes": area.class_names().iter().map(|c| c.name.clone()).collect::<Vec<_>>(),
            "contexts": area.context_names(),
        })
    });
    json!({
        "site_frame": crate::catalogue::SITE_FRAME,
        "lasers": lasers.collect::<Vec<_>>(),
        "areas": areas.collect::<Vec<_>>(),
    })
}

/// Who records, when, by which clock.
#[must_use]
pub fn session(
    site: &Site,
    clock: &Clock,
    recorder: &str,
    host: &str,
    begin_ns: u64,
) -> BTreeMap<String, String> {
    let clock = match clock {
        Clock::Wall => "the host's clock".to_owned(),
        Clock::Scaled { rate, .. } => format!("a replay at {rate} times real time"),
        Clock::EventTime => "a lossless replay: the stamps of the scans".to_owned(),
    };
    let begin = i64::try_from(begin_ns / 1_000_000)
        .ok()
        .and_then(|ms| jiff::Timestamp::from_millisecond(ms).ok());
    let entries = [
        ("site", site.name.clone()),
        ("software", concat!("tog ", env!("CARGO_PKG_VERSION")).to_owned()),
        ("recorder", recorder.to_owned()),
        ("clock", clock),
        ("timezone", site.timezone.clone()),
        ("begin", begin.map(|begin| begin.to_string()).unwrap_or_default()),
        ("host", host.to_owned()),
        ("lasers", site.lasers.len().to_string()),
        ("areas", site.areas.len().to_string()),
    ];
    entries.into_iter().map(|(key, value)| (key.to_owned(), value)).collect()
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::catalogue::tests::site;

    #[test]
    fn the_attached_site_file_is_the_site() {
        let text = site_text(&site()).unwrap();
        let again = Site::parse(&text, "attached").unwrap_or_else(|errors| panic!("{errors}"));
        assert_eq!(again, site());
    }

    #[test]
    fn secrets_do_not_travel() {
        let mut value = json!({
            "webhook": {
                "url": "https://me:word@desk.example/alerts?x=a@b",
                "secret_file": "/etc/tog/key",
                "headers": [{ "Auth_Token": "abc" }],
                "passwords": ["one", "two"],
                "note": null,
            },
            "mail": "me@desk.example",
            "plain": "http://desk.example/x@y",
        });
        strip("", &mut value);
        let expected = json!({
            "webhook": {
                "url": "https://removed@desk.example/alerts?x=a@b",
                "secret_file": "removed",
                "headers": [{ "Auth_Token": "removed" }],
                "passwords": ["removed", "removed"],
            },
            "mail": "me@desk.example",
            "plain": "http://desk.example/x@y",
        });
        assert_eq!(value, expected);
    }
}
