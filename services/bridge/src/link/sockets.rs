//! What zenoh does not set on its connections.

use super::LEASE_MS;
use rustix::fd::BorrowedFd;
use rustix::io;
use rustix::net::ipproto;
use rustix::net::sockopt::{set_tcp_user_timeout, socket_protocol};
use std::fs;

/// What was sent and is not acknowledged by then ends the connection (RFC 5482). After the lease: by then zenoh
/// has given the other side up anyway.
const USER_TIMEOUT_MS: u32 = LEASE_MS as u32 + 1000;

/// Makes the connections of this process end when nobody acknowledges what they send.
///
/// zenoh 1.10.2 gives a cut TLS link up only once all of it is written (`zenoh-link-tls/src/unicast.rs`,
/// `close` flushes), and dials again only then. Where the buffer of the socket was full when the link was
/// cut, that was when the kernel sent it again: up to two minutes after the link was healed. Listeners
/// pass it on to what they accept; for what is dialled this is called once a second.
pub(crate) fn end_when_not_acknowledged() {
    let Ok(entries) = fs::read_dir("/proc/self/fd") else { return };
    for entry in entries.flatten() {
        if let Some(number) = entry.file_name().to_str().and_then(|name| name.parse().ok()) {
            let _ = set(number); // it is no TCP socket, or closed by now
        }
    }
}

fn set(number: i32) -> io::Result<()> {
    // SAFETY: the number is not -1, for it names an entry of /proc/self/fd. Nothing is read, written or closed
    // through it, and it does not leave this function. If another thread closes it meanwhile, the calls
    // below fail with EBADF; if it is another descriptor by then, it is asked again what it is, and a TCP
    // socket of this process is meant in any case.
    let socket = unsafe { BorrowedFd::borrow_raw(number) };
    if socket_protocol(socket)? == Some(ipproto::TCP) {
        set_tcp_user_timeout(socket, USER_TIMEOUT_MS)?;
    }
    Ok(())
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use rustix::net::sockopt::tcp_user_timeout;
    use std::net::{TcpListener, TcpStream, UdpSocket};

    #[test]
    fn every_connection_of_the_process_has_it_and_what_is_accepted_later() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let _other = UdpSocket::bind("127.0.0.1:0").unwrap();
        let dialled = TcpStream::connect(listener.local_addr().unwrap()).unwrap();
        assert_eq!(tcp_user_timeout(&dialled).unwrap(), 0);
        end_when_not_acknowledged();
        let later = TcpStream::connect(listener.local_addr().unwrap()).unwrap();
        let accepted = [listener.accept().unwrap().0, listener.accept().unwrap().0];
        for socket in [&dialled, &accepted[1]] {
            assert_eq!(tcp_user_timeout(socket).unwrap(), USER_TIMEOUT_MS);
        }
        drop(later);
    }
}
