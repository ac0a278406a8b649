//! The site that our recorder put into a recording, with lasers that replay the recording; for
//! `tog bag play` and `tog replay`.

use crate::site_file::{self, SiteFileError};
use protocol::site::{Laser, Pace, Site, Source};
use recorder::attach::SITE_FILE;
use recorder::catalogue::Catalogue;
use recording::{Recording, RecordingError};
use std::path::{Path, PathBuf};

/// Why the site of a recording cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum RecordedSiteError {
    /// The recording cannot be read.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// It is no site file.
    #[error(transparent)]
    Site(#[from] SiteFileError),
    /// A laser of the site is not in the recording.
    #[error(
        "no scans of laser `{laser}` in {}; topics with scans: {topics}. Write the right one into \
         the site file: source = {{ kind = \"replay\", recording = .., topic = .. }}",
        path.display()
    )]
    NoTopic {
        /// The laser.
        laser: String,
        /// The recording.
        path: PathBuf,
        /// What is there.
        topics: String,
    },
}

/// The site that is attached to a recording, as it was recorded; `None` if there is none.
pub fn attached(recording: &Recording) -> Result<Option<Site>, RecordedSiteError> {
    let path = recording.first_file();
    let attached = recording::attachment(path, SITE_FILE)?;
    let text = attached.and_then(|attached| String::from_utf8(attached.bytes).ok());
    let Some(text) = text else { return Ok(None) };
    eprintln!("tog: the site is the one that is attached to the recording");
    Ok(Some(site_file::parse(&text, &path.join(SITE_FILE))?))
}

/// The site with lasers that replay their topics of a recording.
pub fn fed_by(
    site: Site,
    path: &Path,
    topics: &[String],
    pace: Pace,
) -> Result<Site, RecordedSiteError> {
    let catalogue = Catalogue::new(&site, &[]);
    let only = site.lasers.len() == 1;
    let mut lasers = Vec::with_capacity(site.lasers.len());
    for (laser, names) in site.lasers.iter().zip(&catalogue.lasers) {
        let own = format!("/{}/scan", names.frame);
        let no_topic = || RecordedSiteError::NoTopic {
            laser: laser.id.clone(),
            path: path.to_owned(),
            topics: topics.join(", "),
        };
        let topic = topic_of(laser, &own, topics, only).ok_or_else(no_topic)?;
        let recording = path.display().to_string();
        let source = Source::Replay { recording, topic: Some(topic), pace };
        lasers.push(Laser { source, ..laser.clone() });
    }
    Ok(Site { lasers, ..site })
}

/// The topic of a laser: what its site file says, what our recorder calls it, what it is called
/// itself, or the only one.
fn topic_of(laser: &Laser, own: &str, topics: &[String], only: bool) -> Option<String> {
    let named = match &laser.source {
        Source::Replay { topic, .. } => topic.clone(),
        Source::Simulator { .. } => None,
    };
    let bare = format!("/{}", laser.id);
    let candidates = [named.as_deref(), Some(own), Some(&bare)];
    let mut known = candidates.into_iter().flatten().filter(|name| has(topics, name));
    let found = known.next().map(str::to_owned);
    found.or_else(|| topics.first().filter(|_| only && topics.len() == 1).cloned())
}

fn has(topics: &[String], name: &str) -> bool {
    topics.iter().any(|topic| topic == name)
}
