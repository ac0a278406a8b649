//! Who owns an instance, as the kernel knows it: the name of an abstract socket.
//!
//! The lock in the run directory says it to whoever looks there, but somebody may remove the directory
//! of a living site. Then the next start would take its shared memory for that of a dead run, and wipe
//! it. A name in the kernel cannot be removed, and goes with the process that holds it.

use rustix::net::sockopt::socket_peercred;
use std::io;
use std::os::linux::net::SocketAddrExt;
use std::os::unix::net::{SocketAddr, UnixListener, UnixStream};

/// Held as long as the instance lives.
#[derive(Debug)]
pub(crate) struct NameLock {
    _listener: UnixListener,
}

/// Why the name cannot be had.
#[derive(Debug)]
pub(crate) enum NameTaken {
    /// By this living process.
    Process(String),
    /// The system says no.
    Io(io::Error),
}

impl NameLock {
    /// Takes the name of the instance with this prefix.
    pub(crate) fn take(prefix: &str) -> Result<Self, NameTaken> {
        let address = SocketAddr::from_abstract_name(prefix).map_err(NameTaken::Io)?;
        match UnixListener::bind_addr(&address) {
            Ok(listener) => Ok(Self { _listener: listener }),
            Err(error) if error.kind() == io::ErrorKind::AddrInUse => {
                let owner = UnixStream::connect_addr(&address)
                    .and_then(|stream| Ok(socket_peercred(&stream)?))
                    .map_or_else(|_| "unknown".to_owned(), |peer| peer.pid.to_string());
                Err(NameTaken::Process(owner))
            }
            Err(error) => Err(NameTaken::Io(error)),
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn a_name_has_one_owner_and_says_which() {
        let prefix = format!("tog-test-{}_", std::process::id());
        let first = NameLock::take(&prefix).unwrap();
        let Err(NameTaken::Process(pid)) = NameLock::take(&prefix) else { panic!("it was free") };
        assert_eq!(pid, std::process::id().to_string());
        drop(first);
        NameLock::take(&prefix).unwrap();
    }
}
