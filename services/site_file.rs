//! The site file on disk: read, checked, and what is wrong said with line and caret.

use protocol::site::{Diagnostics, Site, TEXT_BYTES_MAX};
use std::io::Read;
use std::path::{Path, PathBuf};

/// Why a site file cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum SiteFileError {
    /// It cannot be read.
    #[error("cannot read the site file {}: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
    /// It is wrong.
    #[error("{0}")]
    Wrong(Diagnostics),
}

/// Reads and checks a site file; warnings go to stderr.
///
/// # Errors
/// All that is wrong with it.
pub fn load(path: &Path) -> Result<Site, SiteFileError> {
    load_with_text(path).map(|(site, _)| site)
}

/// As [`load`], with the text.
///
/// # Errors
/// As [`load`].
pub fn load_with_text(path: &Path) -> Result<(Site, String), SiteFileError> {
    let read = |source| SiteFileError::Read { path: path.to_owned(), source };
    let (file, _) = process::file::open_regular(path).map_err(read)?;
    let mut text = String::new();
    file.take(TEXT_BYTES_MAX as u64 + 1).read_to_string(&mut text).map_err(read)?;
    parse(&text, path).map(|site| (site, text))
}

/// Checks the text of a site file; warnings go to stderr.
///
/// # Errors
/// All that is wrong with it.
pub fn parse(text: &str, path: &Path) -> Result<Site, SiteFileError> {
    let name = path.display().to_string();
    let (site, warnings) = Site::parse_with_warnings(text, &name).map_err(SiteFileError::Wrong)?;
    let warnings = warnings.to_string();
    if !warnings.is_empty() {
        eprint!("{warnings}");
    }
    Ok(site)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use rustix::fs::{CWD, FileType, Mode, mknodat};

    #[test]
    fn a_pipe_in_the_place_of_a_site_file_is_refused_and_not_waited_for() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("site.toml");
        mknodat(CWD, &path, FileType::Fifo, Mode::RUSR | Mode::WUSR, 0).unwrap();
        let error = load(&path).unwrap_err().to_string();
        assert!(error.contains("it is a pipe, expected a regular file"), "{error}");
    }
}
