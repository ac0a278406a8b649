//! File descriptors of a process: enough of them, and none for its children.

use rustix::io::{FdFlags, fcntl_setfd};
use rustix::process::{Resource, getrlimit, setrlimit};
use std::os::fd::BorrowedFd;

/// Raises the soft limit of descriptors to the hard one. iceoryx2 loses messages in silence when
/// descriptors run out (iceoryx2.md, section 1): about eight a topic and five a connection, so
/// a large site passes the usual soft limit of 1024.
pub fn raise_limit() {
    let mut limit = getrlimit(Resource::Nofile);
    limit.current = limit.maximum;
    let _ = setrlimit(Resource::Nofile, limit); // not raised is noticed when they run out
}

/// Marks all descriptors but stdin, stdout and stderr to be closed in programs that this process
/// starts: iceoryx2 opens its sockets and memory without that mark, and a child that inherits them
/// would keep them alive after our death. To be called before each start of a child.
pub fn close_on_exec() {
    for entry in std::fs::read_dir("/proc/self/fd").into_iter().flatten().flatten() {
        let Some(fd) = entry.file_name().to_str().and_then(|name| name.parse::<i32>().ok()) else {
            continue;
        };
        if fd > 2 {
            // SAFETY: the descriptor was listed as open a moment ago and is used for this one call. If
            // it was closed since, the call fails or marks its successor, and neither touches memory.
            let _ = fcntl_setfd(unsafe { BorrowedFd::borrow_raw(fd) }, FdFlags::CLOEXEC);
        }
    }
}
