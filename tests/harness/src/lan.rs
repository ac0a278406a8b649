//! Hosts on one machine, whose links can be cut. As root a network namespace each, joined by a switch in a
//! namespace of its own, so that nothing of it is seen from outside; a cut is a port that leaves the switch:
//! packets vanish in silence, as when somebody pulls the cable behind a switch. Otherwise, or if the
//! environment says `TOG_LAN=loopback`, all on 127.0.0.1 and each link through a door of ours.

use crate::loopback::Loopback;
use std::process::{Command, Output};
use std::sync::atomic::{AtomicU32, Ordering};

static LANS: AtomicU32 = AtomicU32::new(0);

/// Where the bridges listen, each in its own namespace.
const PORT: u16 = 7447;

/// A network of hosts. Its end removes all of it.
#[derive(Debug)]
pub struct Lan {
    hosts: Vec<String>,
    links: Links,
}

#[derive(Debug)]
enum Links {
    Namespaces(Namespaces),
    Loopback(Loopback),
}

/// The namespaces of a network. Its end removes them.
#[derive(Debug)]
struct Namespaces {
    prefix: String,
    hosts: usize,
}

fn ip(arguments: &str) -> Output {
    Command::new("ip").args(arguments.split_whitespace()).output().unwrap()
}

fn must(arguments: &str) {
    let done = ip(arguments);
    assert!(done.status.success(), "ip {arguments}: {}", String::from_utf8_lossy(&done.stderr));
}

/// The same command in a namespace; its process id is that of the program.
pub(crate) fn within(namespace: &str, command: &Command) -> Command {
    let mut inside = Command::new("ip");
    inside.args(["netns", "exec", namespace]).arg(command.get_program()).args(command.get_args());
    for (name, value) in command.get_envs() {
        value.map(|value| inside.env(name, value));
    }
    inside.stdin(std::process::Stdio::null());
    inside
}

impl Lan {
    /// Makes a network of these hosts: of namespaces if this user and this machine can, else on loopback.
    pub fn new(hosts: &[&str]) -> Self {
        if std::env::var_os("TOG_LAN").is_some_and(|value| value == "loopback") {
            return Self::on_loopback(hosts);
        }
        match Namespaces::new(hosts.len()) {
            Ok(namespaces) => Self::of(hosts, Links::Namespaces(namespaces)),
            Err(reason) => {
                println!("hosts on loopback: {reason}");
                Self::on_loopback(hosts)
            }
        }
    }

    /// Makes one on loopback.
    pub fn on_loopback(hosts: &[&str]) -> Self {
        Self::of(hosts, Links::Loopback(Loopback::new(hosts.len())))
    }

    fn of(hosts: &[&str], links: Links) -> Self {
        Self { hosts: hosts.iter().map(|host| (*host).to_owned()).collect(), links }
    }

    fn number(&self, host: &str) -> usize {
        self.hosts.iter().position(|other| other == host).expect("a host of this network")
    }

    /// Address and port of `host` as the site file of `reader` names it. On loopback each host has a
    /// site file of its own: where it listens, and through which doors it finds the others.
    pub fn endpoint(&self, host: &str, reader: &str) -> String {
        let (host, reader) = (self.number(host), self.number(reader));
        match &self.links {
            Links::Namespaces(_) => format!("{}:{PORT}", Namespaces::address(host)),
            Links::Loopback(loopback) => format!("127.0.0.1:{}", loopback.port(reader, host)),
        }
    }

    /// Name of the namespace of a host, if it has one.
    pub(crate) fn namespace(&self, host: &str) -> Option<String> {
        match &self.links {
            Links::Namespaces(namespaces) => Some(namespaces.name(self.number(host))),
            Links::Loopback(_) => None,
        }
    }

    /// Cuts a host off from all others.
    pub fn cut(&self, host: &str) {
        let host = self.number(host);
        match &self.links {
            Links::Namespaces(namespaces) => namespaces.cut(host),
            Links::Loopback(loopback) => loopback.cut(host),
        }
    }

    /// Joins it again.
    pub fn heal(&self, host: &str) {
        let host = self.number(host);
        match &self.links {
            Links::Namespaces(namespaces) => namespaces.heal(host),
            Links::Loopback(loopback) => loopback.heal(host),
        }
    }

    /// Bytes that a host has sent and received so far, headers of Ethernet included; none on loopback,
    /// which has no packets.
    pub fn bytes(&self, host: &str) -> Option<(u64, u64)> {
        match &self.links {
            Links::Namespaces(namespaces) => Some(namespaces.bytes(self.number(host))),
            Links::Loopback(_) => None,
        }
    }
}

impl Namespaces {
    /// None, and why, if this user or this machine cannot.
    fn new(hosts: usize) -> Result<Self, String> {
        if !rustix::process::geteuid().is_root() {
            return Err("network namespaces need root".to_owned());
        }
        let number = LANS.fetch_add(1, Ordering::Relaxed);
        // Names of interfaces have 15 bytes.
        let lan = Self { prefix: format!("tg{}x{number}", std::process::id()), hosts };
        let switch = lan.switch();
        match Command::new("ip").args(["netns", "add", &switch]).output() {
            Err(error) => return Err(format!("`ip` of iproute2: {error}")),
            Ok(done) if !done.status.success() => {
                return Err(String::from_utf8_lossy(&done.stderr).trim().to_owned());
            }
            Ok(_) => {}
        }
        must(&format!("-n {switch} link add br0 type bridge"));
        must(&format!("-n {switch} link set br0 up"));
        for n in 0..hosts {
            let (namespace, address) = (lan.name(n), Self::address(n));
            must(&format!("netns add {namespace}"));
            must(&format!("-n {switch} link add p{n} type veth peer name eth0 netns {namespace}"));
            must(&format!("-n {namespace} address add {address}/24 dev eth0"));
            must(&format!("-n {namespace} link set lo up"));
            must(&format!("-n {namespace} link set eth0 up"));
            must(&format!("-n {switch} link set p{n} master br0"));
            must(&format!("-n {switch} link set p{n} up"));
        }
        Ok(lan)
    }

    fn switch(&self) -> String {
        format!("{}-sw", self.prefix)
    }

    fn name(&self, host: usize) -> String {
        format!("{}-{host}", self.prefix)
    }

    fn address(host: usize) -> String {
        format!("10.77.0.{}", host + 1)
    }

    fn cut(&self, host: usize) {
        must(&format!("-n {} link set p{host} nomaster", self.switch()));
    }

    fn heal(&self, host: usize) {
        must(&format!("-n {} link set p{host} master br0", self.switch()));
    }

    fn bytes(&self, host: usize) -> (u64, u64) {
        let counted = |what: &str| -> u64 {
            let path = format!("/sys/class/net/eth0/statistics/{what}");
            let mut cat = Command::new("cat");
            let read = within(&self.name(host), cat.arg(path)).output().unwrap();
            String::from_utf8(read.stdout).unwrap().trim().parse().expect(what)
        };
        (counted("tx_bytes"), counted("rx_bytes"))
    }
}

impl Drop for Namespaces {
    fn drop(&mut self) {
        for host in 0..self.hosts {
            ip(&format!("netns delete {}", self.name(host)));
        }
        ip(&format!("netns delete {}", self.switch()));
    }
}
