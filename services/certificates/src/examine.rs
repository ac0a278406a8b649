//! Reads certificates, and says everything that is wrong with those of a host at once.

use crate::issue::read_text;
use crate::{Files, Identity};
use rcgen::{KeyPair, PublicKeyData as _};
use serde::Serialize;
use std::fmt;
use std::fs;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use time::OffsetDateTime;
use x509_parser::certificate::X509Certificate;
use x509_parser::extensions::GeneralName;
use x509_parser::pem::Pem;

/// From so many days before its end on, a certificate is to be replaced.
pub const EXPIRES_SOON_DAYS: i64 = 30;
const DAY_S: i64 = 86_400;

/// What a certificate says.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Certificate {
    /// Common name of its subject: `<host>.<site>`.
    pub common_name: String,
    /// Addresses and names that it is good for (subject alternative names).
    pub names: Vec<String>,
    /// Common name of who signed it.
    pub issuer: String,
    /// True for an authority.
    pub is_ca: bool,
    /// First second in which it is good, UNIX.
    pub not_before_s: i64,
    /// Last second in which it is good, UNIX.
    pub not_after_s: i64,
    #[serde(skip)]
    public_key: Vec<u8>,
    #[serde(skip)]
    der: Vec<u8>,
}

/// Something that is wrong with a file of a host.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Problem {
    /// Which file.
    pub path: PathBuf,
    /// What was found, and what was expected.
    pub text: String,
    /// What to do.
    pub help: String,
}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}: {}", self.path.display(), self.text, self.help)
    }
}

impl Certificate {
    /// True if the private key belongs to it.
    #[must_use]
    pub fn has_key(&self, key: &KeyPair) -> bool {
        self.public_key == key.der_bytes()
    }

    /// True if `authority` signed it.
    #[must_use]
    pub fn is_signed_by(&self, authority: &Self) -> bool {
        let (Some(own), Some(ca)) = (parsed(&self.der), parsed(&authority.der)) else {
            return false;
        };
        own.issuer() == ca.subject() && own.verify_signature(Some(ca.public_key())).is_ok()
    }

    /// Whole days until it is no longer good; negative afterwards.
    #[must_use]
    pub fn days_left(&self, now_s: i64) -> i64 {
        (self.not_after_s - now_s).div_euclid(DAY_S)
    }

    /// Why it is to be replaced, if it is.
    #[must_use]
    pub fn expires_soon(&self, now_s: i64) -> Option<String> {
        let days = self.days_left(now_s);
        let end = date(self.not_after_s);
        let name = &self.common_name;
        if days < 0 {
            return Some(format!("the certificate of {name} expired on {end}: nobody talks to us"));
        }
        (days < EXPIRES_SOON_DAYS).then(|| {
            format!(
                "the certificate of {name} ends on {end}, in {days} days: make a new one with \
                 `tog certs issue` and restart this host"
            )
        })
    }
}

fn parsed(der: &[u8]) -> Option<X509Certificate<'_>> {
    x509_parser::parse_x509_certificate(der).ok().map(|(_, certificate)| certificate)
}

/// Reads the first certificate of a PEM text.
///
/// # Errors
/// What was found instead.
pub fn parse(pem: &str) -> Result<Certificate, String> {
    let not =
        |what: &str| format!("{what}, expected a certificate in PEM (-----BEGIN CERTIFICATE)");
    let block = Pem::iter_from_buffer(pem.as_bytes()).next();
    let block = block.ok_or_else(|| not("no PEM block"))?.map_err(|e| not(&e.to_string()))?;
    if block.label != "CERTIFICATE" {
        return Err(not(&format!("a block {:?}", block.label)));
    }
    let parsed = block.parse_x509().map_err(|error| not(&error.to_string()))?;
    let common_name = |name: &x509_parser::x509::X509Name<'_>| {
        let first = name.iter_common_name().next().and_then(|part| part.as_str().ok());
        first.unwrap_or_default().to_owned()
    };
    let names = parsed.subject_alternative_name().ok().flatten();
    let names = names.iter().flat_map(|names| &names.value.general_names).map(name_text).collect();
    Ok(Certificate {
        common_name: common_name(parsed.subject()),
        names,
        issuer: common_name(parsed.issuer()),
        is_ca: parsed.is_ca(),
        not_before_s: parsed.validity().not_before.timestamp(),
        not_after_s: parsed.validity().not_after.timestamp(),
        public_key: parsed.public_key().subject_public_key.data.to_vec(),
        der: block.contents.clone(),
    })
}

fn name_text(name: &GeneralName<'_>) -> String {
    match name {
        GeneralName::DNSName(name) => (*name).to_owned(),
        GeneralName::IPAddress(bytes) => {
            match (<[u8; 4]>::try_from(*bytes), <[u8; 16]>::try_from(*bytes)) {
                (Ok(v4), _) => std::net::Ipv4Addr::from(v4).to_string(),
                (_, Ok(v6)) => std::net::Ipv6Addr::from(v6).to_string(),
                _ => format!("an address of {} bytes", bytes.len()),
            }
        }
        other => other.to_string(),
    }
}

/// Reads the certificate in a file.
///
/// # Errors
/// What is wrong with the file.
pub fn read(path: &Path) -> Result<Certificate, Problem> {
    let problem = |text| Problem {
        path: path.to_owned(),
        text,
        help: "put the file there that `tog certs issue` made for this host".to_owned(),
    };
    let text = read_text(path).map_err(|error| problem(error.to_string()))?;
    parse(&text).map_err(problem)
}

/// Holds the files of a host against what they must be; the certificate, if it can be used.
///
/// # Errors
/// Everything that is wrong, each with what to do.
pub fn examine(
    files: &Files,
    identity: &Identity,
    now_s: i64,
) -> Result<Certificate, Vec<Problem>> {
    let mut problems = Vec::new();
    let key = private_key(&files.key).map_err(|problem| problems.push(problem)).ok();
    let ca = read(&files.ca).map_err(|problem| problems.push(problem)).ok();
    let certificate = match read(&files.certificate) {
        Ok(certificate) => certificate,
        Err(problem) => {
            problems.push(problem);
            return Err(problems);
        }
    };
    let again = format!("make it anew with `tog certs issue SITE {}`", identity.host);
    let mut wrong = |path: &Path, text: String| {
        problems.push(Problem { path: path.to_owned(), text, help: again.clone() });
    };
    let (path, expected) = (&files.certificate, identity.common_name());
    if certificate.common_name != expected {
        wrong(path, format!("it is of {:?}, expected {expected:?}", certificate.common_name));
    }
    if !certificate.names.iter().any(|name| same_name(name, &identity.address)) {
        let (found, address) = (certificate.names.join(", "), &identity.address);
        wrong(path, format!("it is good for {found}, expected {address}, the host's endpoint"));
    }
    if now_s < certificate.not_before_s {
        let (begin, now) = (date(certificate.not_before_s), date(now_s));
        wrong(path, format!("it is good from {begin} on, and the clock says {now}"));
    }
    if now_s > certificate.not_after_s {
        wrong(path, format!("it expired on {}", date(certificate.not_after_s)));
    }
    if key.is_some_and(|key| !certificate.has_key(&key)) {
        wrong(&files.key, format!("it is not the key of {}", path.display()));
    }
    if let Some(ca) = ca {
        if !ca.is_ca {
            wrong(&files.ca, format!("{:?} is not an authority", ca.common_name));
        } else if !certificate.is_signed_by(&ca) {
            let (found, ca) = (&certificate.issuer, files.ca.display());
            wrong(path, format!("it is signed by {found:?}, which is not the authority in {ca}"));
        }
        if now_s > ca.not_after_s {
            let end = date(ca.not_after_s);
            wrong(
                &files.ca,
                format!("the authority expired on {end}: begin with `tog certs init`"),
            );
        }
    }
    if problems.is_empty() { Ok(certificate) } else { Err(problems) }
}

fn private_key(path: &Path) -> Result<KeyPair, Problem> {
    let problem =
        |text: String, help: &str| Problem { path: path.to_owned(), text, help: help.to_owned() };
    let anew = "put the key there that `tog certs issue` made for this host";
    let text = read_text(path).map_err(|error| problem(error.to_string(), anew))?;
    let found = fs::metadata(path).map_err(|error| problem(error.to_string(), anew))?;
    let (mode, owner) = (found.mode() & 0o777, found.uid());
    if mode & 0o077 != 0 {
        let text = format!("others can read it (mode {mode:03o}), expected mode 600");
        return Err(problem(text, &format!("chmod 600 {}", path.display())));
    }
    let own = rustix::process::geteuid().as_raw();
    if owner != own && own != 0 {
        let text = format!("it belongs to user id {owner}, expected {own}");
        return Err(problem(text, "chown it to the user that runs tog"));
    }
    KeyPair::from_pem(&text)
        .map_err(|error| problem(format!("{error}, expected a private key in PEM (PKCS#8)"), anew))
}

/// Whether two addresses or names are one: `::1` and `0:0:0:0:0:0:0:1` are, names whatever their case.
fn same_name(one: &str, other: &str) -> bool {
    use std::net::IpAddr;
    match (one.parse::<IpAddr>(), other.parse::<IpAddr>()) {
        (Ok(one), Ok(other)) => one == other,
        (Err(_), Err(_)) => one.eq_ignore_ascii_case(other),
        _ => false,
    }
}

/// `2026-11-26`, UTC.
#[must_use]
pub fn date(unix_s: i64) -> String {
    OffsetDateTime::from_unix_timestamp(unix_s).map_or_else(
        |_| format!("second {unix_s}"),
        |time| format!("{:04}-{:02}-{:02}", time.year(), u8::from(time.month()), time.day()),
    )
}

#[cfg(test)]
#[path = "tests.rs"]
mod tests;
