//! The certificates by which the bridges of a site know each other (X.509 v3, RFC 5280).
//!
//! ```text
//! site-ca.pem   the authority of the site; every host has it         site-ca.key   stays with who issues
//! <host>.pem    CN = <host>.<site>, SAN = the address of its endpoint, for servers and clients; after a
//!               key was lost or stolen CN = <host>.<number>.<site>, counted from 2
//! <host>.key    its private key (PKCS#8), on that host only, mode 0600
//! ```
//!
//! Keys are ECDSA P-256. A bridge believes a peer to be host H if and only if its certificate is signed
//! by the site's authority and its common name is that of the number which the site file gives H: ids hold
//! no dot, so no host of one site can be taken for one of another, even if somebody uses one authority
//! for both. A certificate is revoked by the next number in the site file of every host.
//!
//! | question | where |
//! |---|---|
//! | how are they made | [`issue`] |
//! | what does a file say, and is it what it must be | [`examine`] |
//!
//! Time is an argument (UNIX seconds) everywhere.

pub mod examine;
pub mod issue;

use std::path::{Path, PathBuf};

pub use examine::{Certificate, Problem, examine, read};
pub use issue::{Authority, IssueError, init, issue};

/// Name of the authority's certificate in every directory.
pub const CA_FILE: &str = "site-ca.pem";
/// Name of the authority's private key.
pub const CA_KEY_FILE: &str = "site-ca.key";
/// A certificate or key as text is below 4 kB; chains of a few are below this.
pub const FILE_BYTES_MAX: u64 = 64 * 1024;

/// Who a certificate is for.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Identity {
    /// The site's name.
    pub site: String,
    /// The host's id.
    pub host: String,
    /// Address or name where the others find the host: its endpoint without the port.
    pub address: String,
    /// Which of its certificates, counted from 1: those before it are refused.
    pub number: u32,
}

impl Identity {
    /// Of a host with this endpoint (`address:port`, an IPv6 address in brackets): its first certificate.
    #[must_use]
    pub fn new(site: &str, host: &str, endpoint: &str) -> Self {
        let address = endpoint.rsplit_once(':').map_or(endpoint, |(address, _)| address);
        let address = address.trim_start_matches('[').trim_end_matches(']');
        let (site, host, address) = (site.to_owned(), host.to_owned(), address.to_owned());
        Self { site, host, address, number: 1 }
    }

    /// The same host with its certificate of this number.
    #[must_use]
    pub fn numbered(self, number: u32) -> Self {
        Self { number, ..self }
    }

    /// The common name of its certificate.
    #[must_use]
    pub fn common_name(&self) -> String {
        match self.number {
            1 => format!("{}.{}", self.host, self.site),
            number => format!("{}.{number}.{}", self.host, self.site),
        }
    }
}

/// The three files that a host needs.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Files {
    /// Certificate of the site's authority.
    pub ca: PathBuf,
    /// Certificate of the host.
    pub certificate: PathBuf,
    /// Private key of the host.
    pub key: PathBuf,
}

impl Files {
    /// Where they are in a directory.
    #[must_use]
    pub fn of(directory: &Path, host: &str) -> Self {
        Self {
            ca: directory.join(CA_FILE),
            certificate: directory.join(format!("{host}.pem")),
            key: directory.join(format!("{host}.key")),
        }
    }
}
