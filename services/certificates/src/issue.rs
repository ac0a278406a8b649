//! Makes the authority of a site, and the certificates of its hosts.

use crate::{CA_FILE, CA_KEY_FILE, FILE_BYTES_MAX, Files, Identity};
use rcgen::{
    BasicConstraints, CertificateParams, DnType, ExtendedKeyUsagePurpose, IsCa, Issuer, KeyPair,
    KeyUsagePurpose, PKCS_ECDSA_P256_SHA256,
};
use std::fs::{self, OpenOptions};
use std::io::{self, Read, Write};
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};
use time::{Duration, OffsetDateTime};

/// A certificate is good a while before it was made: the clocks of hosts may differ.
const BACKDATED: Duration = Duration::hours(1);
/// The common name of an authority that was made here, before the site's name.
const AUTHORITY_OF: &str = "tog authority of ";

/// Why nothing was made.
#[derive(Debug, thiserror::Error)]
pub enum IssueError {
    /// Something is there already.
    #[error("{} is there already: it is not overwritten; move it away first", .0.display())]
    Exists(PathBuf),
    /// A file.
    #[error("cannot {action} {}: {source}", .path.display())]
    Io {
        /// What was tried.
        action: &'static str,
        /// Which file.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// The authority's files are not what they must be.
    #[error(
        "{} is not a usable authority: {reason}; expected {CA_FILE} and {CA_KEY_FILE} as \
         `tog certs init` makes them", .directory.display()
    )]
    Authority {
        /// Where it was looked for.
        directory: PathBuf,
        /// What was found.
        reason: String,
    },
    /// The certificate cannot be made.
    #[error("cannot make the certificate: {0}")]
    Make(String),
}

/// The files of an authority.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Authority {
    /// Its certificate: to be copied to every host.
    pub certificate: PathBuf,
    /// Its private key: whoever has it can make hosts.
    pub key: PathBuf,
}

impl Authority {
    /// Where they are in a directory.
    #[must_use]
    pub fn of(directory: &Path) -> Self {
        Self { certificate: directory.join(CA_FILE), key: directory.join(CA_KEY_FILE) }
    }
}

fn make(error: impl std::fmt::Display) -> IssueError {
    IssueError::Make(error.to_string())
}

fn validity(params: &mut CertificateParams, now_s: i64, days: u32) -> Result<(), IssueError> {
    let now = OffsetDateTime::from_unix_timestamp(now_s).map_err(make)?;
    params.not_before = now - BACKDATED;
    params.not_after = now
        .checked_add(Duration::days(days.into()))
        .ok_or_else(|| IssueError::Make(format!("{days} days from now is no date")))?;
    Ok(())
}

/// Makes the authority of a site in `directory`, good for `days`.
///
/// # Errors
/// If there is one already, or a file cannot be written.
pub fn init(directory: &Path, site: &str, now_s: i64, days: u32) -> Result<Authority, IssueError> {
    let authority = Authority::of(directory);
    refuse_existing([&authority.certificate, &authority.key])?;
    let key = KeyPair::generate_for(&PKCS_ECDSA_P256_SHA256).map_err(make)?;
    let mut params = CertificateParams::default();
    params.distinguished_name.push(DnType::CommonName, format!("{AUTHORITY_OF}{site}"));
    // It signs hosts and nothing that signs in turn.
    params.is_ca = IsCa::Ca(BasicConstraints::Constrained(0));
    params.key_usages = vec![KeyUsagePurpose::KeyCertSign, KeyUsagePurpose::CrlSign];
    validity(&mut params, now_s, days)?;
    let certificate = params.self_signed(&key).map_err(make)?;
    make_directory(directory)?;
    write_new(&authority.key, key.serialize_pem().as_bytes(), 0o600)?;
    write_new(&authority.certificate, certificate.pem().as_bytes(), 0o644)?;
    Ok(authority)
}

/// Makes key and certificate of a host in `out`, signed by the authority in `ca`, good for `days`;
/// puts the authority's certificate beside them.
///
/// # Errors
/// If the host has one there already, the authority cannot be used, or a file cannot be written.
pub fn issue(
    ca: &Path,
    out: &Path,
    identity: &Identity,
    now_s: i64,
    days: u32,
) -> Result<Files, IssueError> {
    let files = Files::of(out, &identity.host);
    refuse_existing([&files.certificate, &files.key])?;
    let authority = Authority::of(ca);
    let unusable = |reason: String| IssueError::Authority { directory: ca.to_owned(), reason };
    let ca_pem = read_text(&authority.certificate).map_err(|e| unusable(e.to_string()))?;
    let ca_key = read_text(&authority.key).map_err(|e| unusable(e.to_string()))?;
    let ca_key = KeyPair::from_pem(&ca_key).map_err(|e| unusable(e.to_string()))?;
    let ca_certificate = crate::examine::parse(&ca_pem).map_err(&unusable)?;
    if !ca_certificate.has_key(&ca_key) {
        return Err(unusable("its key is not that of its certificate".to_owned()));
    }
    // An authority that somebody else made has a name of its own, and may serve many sites.
    let of_site = ca_certificate.common_name.strip_prefix(AUTHORITY_OF);
    if let Some(other) = of_site.filter(|other| *other != identity.site) {
        let expected = &identity.site;
        return Err(unusable(format!("it is that of the site {other}, expected {expected}")));
    }
    let issuer = Issuer::from_ca_cert_pem(&ca_pem, ca_key).map_err(|e| unusable(e.to_string()))?;

    let key = KeyPair::generate_for(&PKCS_ECDSA_P256_SHA256).map_err(make)?;
    let mut params = CertificateParams::new(vec![identity.address.clone()]).map_err(make)?;
    params.distinguished_name = rcgen::DistinguishedName::new();
    params.distinguished_name.push(DnType::CommonName, identity.common_name());
    params.is_ca = IsCa::ExplicitNoCa;
    params.key_usages = vec![KeyUsagePurpose::DigitalSignature];
    params.extended_key_usages =
        vec![ExtendedKeyUsagePurpose::ServerAuth, ExtendedKeyUsagePurpose::ClientAuth];
    params.use_authority_key_identifier_extension = true;
    validity(&mut params, now_s, days)?;
    let certificate = params.signed_by(&key, &issuer).map_err(make)?;
    make_directory(out)?;
    match read_text(&files.ca) {
        Ok(found) if found != ca_pem => return Err(IssueError::Exists(files.ca)),
        Ok(_) => {}
        Err(_) => write_new(&files.ca, ca_pem.as_bytes(), 0o644)?,
    }
    write_new(&files.key, key.serialize_pem().as_bytes(), 0o600)?;
    write_new(&files.certificate, certificate.pem().as_bytes(), 0o644)?;
    Ok(files)
}

fn refuse_existing(paths: [&PathBuf; 2]) -> Result<(), IssueError> {
    match paths.into_iter().find(|path| path.exists()) {
        Some(path) => Err(IssueError::Exists(path.clone())),
        None => Ok(()),
    }
}

fn make_directory(directory: &Path) -> Result<(), IssueError> {
    fs::create_dir_all(directory).map_err(|source| IssueError::Io {
        action: "make",
        path: directory.to_owned(),
        source,
    })
}

fn write_new(path: &Path, bytes: &[u8], mode: u32) -> Result<(), IssueError> {
    let io = |source| IssueError::Io { action: "write", path: path.to_owned(), source };
    let mut options = OpenOptions::new();
    options.write(true).create_new(true).mode(mode);
    let mut file = options.open(path).map_err(io)?;
    file.write_all(bytes).and_then(|()| file.sync_all()).map_err(io)
}

pub(crate) fn read_text(path: &Path) -> Result<String, IssueError> {
    let io = |source| IssueError::Io { action: "read", path: path.to_owned(), source };
    let file = fs::File::open(path).map_err(io)?;
    let mut text = String::new();
    file.take(FILE_BYTES_MAX + 1).read_to_string(&mut text).map_err(io)?;
    if text.len() as u64 > FILE_BYTES_MAX {
        let reason = format!("it has more than {FILE_BYTES_MAX} bytes");
        return Err(io(io::Error::new(io::ErrorKind::InvalidData, reason)));
    }
    Ok(text)
}
