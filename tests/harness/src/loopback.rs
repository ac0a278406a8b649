//! Links between hosts that share 127.0.0.1: whoever dials another host dials a door of ours, which hands
//! on what is said. A cut link holds it back, the end of a connection included, as a cable that is pulled
//! behind a switch does: nobody is told, and what was under way comes when it is healed. Payloads pass,
//! packets are not seen: nothing is counted.

use std::collections::{BTreeMap, BTreeSet};
use std::io::{Read, Write};
use std::net::{Ipv4Addr, Shutdown, TcpListener, TcpStream};
use std::sync::{Arc, Condvar, Mutex};
use std::thread;

#[derive(Debug, Default)]
struct State {
    cut: BTreeSet<usize>,
    over: bool,
}

/// Who is cut off.
#[derive(Debug, Default)]
struct Switch {
    state: Mutex<State>,
    changed: Condvar,
}

impl Switch {
    fn change(&self, change: impl FnOnce(&mut State)) {
        change(&mut self.state.lock().unwrap());
        self.changed.notify_all();
    }

    /// Waits until neither of two hosts is cut off; false if the network is no more.
    fn join(&self, (one, other): (usize, usize)) -> bool {
        let apart = |state: &mut State| {
            !state.over && (state.cut.contains(&one) || state.cut.contains(&other))
        };
        let state = self.changed.wait_while(self.state.lock().unwrap(), apart).unwrap();
        !state.over
    }
}

/// A network of hosts, by their numbers.
#[derive(Debug)]
pub(crate) struct Loopback {
    /// Where each listens.
    ports: Vec<u16>,
    /// Where the first of two finds the second.
    doors: BTreeMap<(usize, usize), u16>,
    switch: Arc<Switch>,
}

fn bind() -> (TcpListener, u16) {
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
    let port = listener.local_addr().unwrap().port();
    (listener, port)
}

impl Loopback {
    pub(crate) fn new(hosts: usize) -> Self {
        // All are held until all are known, so that no two are the same.
        let held: Vec<_> = (0..hosts).map(|_| bind()).collect();
        let ports: Vec<u16> = held.iter().map(|(_, port)| *port).collect();
        let switch = Arc::new(Switch::default());
        let mut doors = BTreeMap::new();
        for dials in 0..hosts {
            for (dialled, &to) in ports.iter().enumerate().filter(|(n, _)| *n != dials) {
                let (door, port) = bind();
                let (pair, switch) = ((dials, dialled), Arc::clone(&switch));
                thread::spawn(move || serve(&door, to, pair, &switch));
                doors.insert(pair, port);
            }
        }
        Self { ports, doors, switch }
    }

    /// Where `dials` finds `dialled`; where that listens, if they are the same.
    pub(crate) fn port(&self, dials: usize, dialled: usize) -> u16 {
        self.doors.get(&(dials, dialled)).copied().unwrap_or(self.ports[dialled])
    }

    pub(crate) fn cut(&self, host: usize) {
        self.switch.change(|state| _ = state.cut.insert(host));
    }

    pub(crate) fn heal(&self, host: usize) {
        self.switch.change(|state| _ = state.cut.remove(&host));
    }
}

impl Drop for Loopback {
    fn drop(&mut self) {
        self.switch.change(|state| state.over = true);
        for port in self.doors.values() {
            let _ = TcpStream::connect((Ipv4Addr::LOCALHOST, *port)); // wakes who waits there
        }
    }
}

fn serve(door: &TcpListener, to: u16, pair: (usize, usize), switch: &Arc<Switch>) {
    for caller in door.incoming().map_while(Result::ok) {
        if switch.state.lock().unwrap().over {
            return;
        }
        let switch = Arc::clone(switch);
        thread::spawn(move || {
            if !switch.join(pair) {
                return;
            }
            // Nobody listens there: the caller is told by the end of its connection.
            let Ok(called) = TcpStream::connect((Ipv4Addr::LOCALHOST, to)) else { return };
            let ends = [&caller, &called].map(|end| end.set_nodelay(true).and(end.try_clone()));
            let [Ok(back), Ok(there)] = ends else { return };
            thread::scope(|scope| {
                scope.spawn(|| hand_on(caller, there, pair, &switch));
                hand_on(called, back, pair, &switch);
            });
        });
    }
}

/// Hands on until one side ends, then ends the other.
fn hand_on(mut from: TcpStream, mut to: TcpStream, pair: (usize, usize), switch: &Switch) {
    let mut bytes = [0; 16 * 1024];
    loop {
        let length = from.read(&mut bytes).unwrap_or(0);
        if !switch.join(pair) || length == 0 || to.write_all(&bytes[..length]).is_err() {
            break;
        }
    }
    for end in [&from, &to] {
        let _ = end.shutdown(Shutdown::Both); // the other thread may have done it
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[test]
    fn what_is_said_over_a_cut_link_comes_when_it_is_healed() {
        let lan = Loopback::new(2);
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, lan.port(1, 1))).unwrap();
        let mut caller = TcpStream::connect((Ipv4Addr::LOCALHOST, lan.port(0, 1))).unwrap();
        let (mut called, _) = listener.accept().unwrap();
        let mut heard = [0; 4];
        caller.write_all(b"here").unwrap();
        called.read_exact(&mut heard).unwrap();
        assert_eq!(&heard, b"here");

        lan.cut(1);
        caller.write_all(b"lost").unwrap();
        drop(caller);
        called.set_read_timeout(Some(Duration::from_millis(100))).unwrap();
        called.read(&mut heard).unwrap_err(); // nothing, not even the end
        let _late = TcpStream::connect((Ipv4Addr::LOCALHOST, lan.port(0, 1))).unwrap();
        listener.set_nonblocking(true).unwrap();
        thread::sleep(Duration::from_millis(50));
        listener.accept().unwrap_err();

        lan.heal(1);
        called.set_read_timeout(None).unwrap();
        called.read_exact(&mut heard).unwrap();
        assert_eq!(&heard, b"lost");
        assert_eq!(called.read(&mut heard).unwrap(), 0, "and then the end");
        listener.set_nonblocking(false).unwrap();
        listener.accept().unwrap();
    }
}
