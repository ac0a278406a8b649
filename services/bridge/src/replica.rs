//! The files of an area as its standby copies them from the owner: asked for page by page, written
//! beside, synced, and put in place whole. What the copy says is judged by who reads it (the mapper, the
//! detector): a damaged file is kept aside by them.

use protocol::link::{AreaFile, FILE_BYTES_MAX, FILE_PAGE_BYTES_MAX, FilePage, FileVersion};
use protocol::time::SECOND_NS;
use std::fs::{self, File};
use std::io::{self, Seek, SeekFrom, Write};
use std::os::unix::fs::{FileExt, MetadataExt};
use std::path::{Path, PathBuf};

/// A page that did not come is asked for again after this long: the network gives up after 3 s.
const ANSWER_NS: u64 = 3_500_000_000;
/// After an area moved away its services may write for a while yet: they are killed after 3 s.
pub const SETTLE_NS: u64 = 6 * SECOND_NS;

/// Which content a file of the owner has now; none if it has none yet.
#[must_use]
pub fn version(state_dir: &Path, area: &str, file: AreaFile) -> Option<FileVersion> {
    let found = fs::metadata(state_dir.join(file.name(area))).ok()?;
    let modified_ns = u64::try_from(found.mtime()).ok()? * SECOND_NS + found.mtime_nsec() as u64;
    let fits = found.is_file() && found.len() <= FILE_BYTES_MAX;
    fits.then_some(FileVersion { file, modified_ns, bytes: found.len() })
}

/// A page of a file of the owner.
///
/// # Errors
/// If it cannot be read.
pub fn page(state_dir: &Path, area: &str, file: AreaFile, offset: u64) -> io::Result<FilePage> {
    let none =
        || io::Error::new(io::ErrorKind::NotFound, format!("{} is not there", file.name(area)));
    let version = version(state_dir, area, file).ok_or_else(none)?;
    let opened = File::open(state_dir.join(file.name(area)))?;
    let length = version.bytes.saturating_sub(offset).min(FILE_PAGE_BYTES_MAX as u64);
    let mut bytes = vec![0; length as usize];
    opened.read_exact_at(&mut bytes, offset.min(version.bytes))?;
    Ok(FilePage { area: area.to_owned(), version, offset, bytes })
}

/// A file on its way.
#[derive(Debug)]
struct Pull {
    version: FileVersion,
    file: File,
    offset: u64,
    asked_ns: Option<u64>,
}

/// The copies of an area on its standby.
#[derive(Debug)]
pub struct Replica {
    state_dir: PathBuf,
    area: String,
    /// As the owner claims.
    wanted: Vec<FileVersion>,
    have: Vec<FileVersion>,
    pull: Option<Pull>,
    /// Files of our own that are kept aside when a copy replaces them.
    keep: Vec<AreaFile>,
    not_before_ns: u64,
    copied: u64,
}

impl Replica {
    /// Nothing was copied yet in this run.
    #[must_use]
    pub fn new(state_dir: &Path, area: &str) -> Self {
        Self {
            state_dir: state_dir.to_owned(),
            area: area.to_owned(),
            wanted: Vec::new(),
            have: Vec::new(),
            pull: None,
            keep: Vec::new(),
            not_before_ns: 0,
            copied: 0,
        }
    }

    /// The area came to this host: nothing is copied any more.
    pub fn stop(&mut self) {
        self.abandon();
        (self.wanted, self.have) = (Vec::new(), Vec::new());
    }

    /// The area left this host: what it wrote here is kept aside when the copies come.
    pub fn begin_anew(&mut self, mono_ns: u64) {
        self.stop();
        self.keep = AreaFile::ALL.to_vec();
        self.not_before_ns = mono_ns + SETTLE_NS;
    }

    /// The owner has these files.
    pub fn offered(&mut self, files: &[FileVersion]) {
        self.wanted = files.to_vec();
    }

    /// The page to ask for now, if one is due; counts as asked.
    ///
    /// # Errors
    /// If the copy cannot be written.
    pub fn question(&mut self, mono_ns: u64) -> io::Result<Option<(AreaFile, u64)>> {
        if mono_ns < self.not_before_ns {
            return Ok(None);
        }
        if self.pull.is_none() {
            let Some(&version) = self.wanted.iter().find(|wanted| !self.have.contains(wanted))
            else {
                return Ok(None);
            };
            let file = File::create(self.unfinished(version.file))?;
            self.pull = Some(Pull { version, file, offset: 0, asked_ns: None });
        }
        let Some(pull) = &mut self.pull else { return Ok(None) };
        if pull.asked_ns.is_some_and(|asked_ns| mono_ns < asked_ns + ANSWER_NS) {
            return Ok(None);
        }
        pull.asked_ns = Some(mono_ns);
        Ok(Some((pull.version.file, pull.offset)))
    }

    /// When [`Replica::question`] has something to ask, if ever.
    #[must_use]
    pub fn deadline_ns(&self) -> Option<u64> {
        let due_ns = match &self.pull {
            Some(pull) => pull.asked_ns.map_or(0, |asked_ns| asked_ns + ANSWER_NS),
            None => self.wanted.iter().any(|wanted| !self.have.contains(wanted)).then_some(0)?,
        };
        Some(due_ns.max(self.not_before_ns))
    }

    /// Takes a page; the file, if it is whole now and in its place.
    ///
    /// # Errors
    /// If it cannot be written; it is begun anew.
    pub fn take(&mut self, page: &FilePage) -> io::Result<Option<AreaFile>> {
        let Some(pull) = &mut self.pull else { return Ok(None) };
        if page.version.file != pull.version.file {
            return Ok(None);
        }
        if page.version != pull.version {
            // It was written anew meanwhile: from its beginning.
            pull.file.set_len(0)?;
            pull.file.seek(SeekFrom::Start(0))?;
            (pull.version, pull.offset, pull.asked_ns) = (page.version, 0, None);
        }
        if page.offset != pull.offset {
            return Ok(None); // an answer to an older question
        }
        pull.file.write_all(&page.bytes)?;
        pull.offset += page.bytes.len() as u64;
        pull.asked_ns = None;
        if pull.offset < pull.version.bytes {
            return Ok(None);
        }
        self.finish().map(Some)
    }

    fn finish(&mut self) -> io::Result<AreaFile> {
        let Some(Pull { version, file, .. }) = self.pull.take() else {
            return Err(io::Error::other("nothing is on its way"));
        };
        file.sync_all()?;
        let path = self.state_dir.join(version.file.name(&self.area));
        if let Some(at) = self.keep.iter().position(|kept| *kept == version.file) {
            self.keep.remove(at);
            let aside =
                self.state_dir.join(format!("{}.superseded", version.file.name(&self.area)));
            match fs::rename(&path, &aside) {
                Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error),
                _ => {}
            }
        }
        fs::rename(self.unfinished(version.file), &path)?;
        File::open(&self.state_dir)?.sync_all()?;
        self.have.retain(|have| have.file != version.file);
        self.have.push(version);
        // What the owner claimed may be older than what it gave.
        self.wanted.retain(|wanted| wanted.file != version.file);
        self.copied += 1;
        Ok(version.file)
    }

    /// Nothing of a copy that cannot be finished is left.
    pub fn abandon(&mut self) {
        if let Some(pull) = self.pull.take() {
            let _ = fs::remove_file(self.unfinished(pull.version.file)); // it is written over next time
        }
    }

    fn unfinished(&self, file: AreaFile) -> PathBuf {
        self.state_dir.join(format!("{}.replica", file.name(&self.area)))
    }

    /// When the map was written that is here now, by the clock of its owner, UNIX nanoseconds; none
    /// before the first copy of this run.
    #[must_use]
    pub fn map_written_ns(&self) -> Option<u64> {
        let map = self.have.iter().find(|have| have.file == AreaFile::Map);
        map.map(|have| have.modified_ns)
    }

    /// Files that were copied whole.
    #[must_use]
    pub fn copied(&self) -> u64 {
        self.copied
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    /// A copy from one directory into another, as if each answer came; how many pages it took.
    fn copy(from: &Path, to: &mut Replica, now_ns: &mut u64) -> usize {
        let versions: Vec<_> =
            AreaFile::ALL.iter().filter_map(|file| version(from, "hall", *file)).collect();
        to.offered(&versions);
        let mut pages = 0;
        while let Some((file, offset)) = to.question(*now_ns).unwrap() {
            to.take(&page(from, "hall", file, offset).unwrap()).unwrap();
            pages += 1;
            *now_ns += 1;
        }
        pages
    }

    #[test]
    fn a_file_comes_page_by_page_and_is_there_whole_or_as_it_was() {
        let (from, to) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
        let map: Vec<u8> = (0..300_000u32).map(|n| (n * 7 % 251) as u8).collect();
        fs::write(from.path().join("hall.map"), &map).unwrap();
        let mut replica = Replica::new(to.path(), "hall");
        let mut now_ns = 5;
        assert_eq!(copy(from.path(), &mut replica, &mut now_ns), 3);
        assert_eq!(fs::read(to.path().join("hall.map")).unwrap(), map);
        assert_eq!(copy(from.path(), &mut replica, &mut now_ns), 0, "it is there already");
        // An empty file is a file, too.
        fs::write(from.path().join("hall.normal"), b"").unwrap();
        assert_eq!(copy(from.path(), &mut replica, &mut now_ns), 1);
        assert_eq!(
            (fs::read(to.path().join("hall.normal")).unwrap().len(), replica.copied()),
            (0, 2)
        );
        let left: Vec<_> = fs::read_dir(to.path()).unwrap().collect();
        assert_eq!(left.len(), 2);
    }

    #[test]
    fn a_file_that_is_written_anew_on_the_way_begins_anew() {
        let (from, to) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
        let path = from.path().join("hall.map");
        fs::write(&path, vec![1; 200_000]).unwrap();
        let mut replica = Replica::new(to.path(), "hall");
        replica.offered(&[version(from.path(), "hall", AreaFile::Map).unwrap()]);
        let first = page(from.path(), "hall", AreaFile::Map, 0).unwrap();
        assert_eq!(replica.question(1).unwrap(), Some((AreaFile::Map, 0)));
        assert_eq!(replica.question(2).unwrap(), None, "it was asked for");
        assert_eq!(replica.question(2 + ANSWER_NS).unwrap(), Some((AreaFile::Map, 0)));
        assert_eq!(replica.take(&first).unwrap(), None);
        fs::write(&path, vec![2; 150_000]).unwrap();
        let mut now_ns = 3 + 2 * ANSWER_NS;
        while let Some((file, offset)) = replica.question(now_ns).unwrap() {
            now_ns += 1;
            replica.take(&page(from.path(), "hall", file, offset).unwrap()).unwrap();
        }
        assert_eq!(fs::read(to.path().join("hall.map")).unwrap(), vec![2; 150_000]);
    }

    #[test]
    fn what_an_area_wrote_here_before_it_left_is_kept_aside_and_not_raced_with() {
        let (from, to) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
        fs::write(from.path().join("hall.map"), b"theirs").unwrap();
        fs::write(to.path().join("hall.map"), b"ours").unwrap();
        let mut replica = Replica::new(to.path(), "hall");
        replica.begin_anew(100);
        let mut now_ns = 100 + SETTLE_NS - 10;
        assert_eq!(copy(from.path(), &mut replica, &mut now_ns), 0, "it may still write");
        assert_eq!(replica.deadline_ns(), Some(100 + SETTLE_NS));
        now_ns = 100 + SETTLE_NS;
        assert_eq!(copy(from.path(), &mut replica, &mut now_ns), 1);
        let read = |name: &str| fs::read(to.path().join(name)).unwrap();
        assert_eq!(
            (read("hall.map"), read("hall.map.superseded")),
            (b"theirs".into(), b"ours".into())
        );
        fs::write(from.path().join("hall.map"), b"theirs, later").unwrap();
        copy(from.path(), &mut replica, &mut now_ns);
        assert_eq!(
            (read("hall.map"), read("hall.map.superseded")),
            (b"theirs, later".into(), b"ours".into())
        );
    }
}
