//! Hosts on one machine: a network namespace each, joined by a switch in a namespace of its own, so that
//! nothing of it is seen from outside. A cut is a port that leaves the switch: packets vanish in silence,
//! as when somebody pulls the cable behind a switch.

use std::process::{Command, Output};
use std::sync::atomic::{AtomicU32, Ordering};

static LANS: AtomicU32 = AtomicU32::new(0);

/// A network of hosts. Its end removes all of it.
#[derive(Debug)]
pub struct Lan {
    prefix: String,
    hosts: Vec<String>,
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
    /// Makes a network of these hosts; none, and why, if this user or this machine cannot.
    ///
    /// # Errors
    /// What is missing, in words.
    pub fn new(hosts: &[&str]) -> Result<Self, String> {
        if !rustix::process::geteuid().is_root() {
            return Err("network namespaces need root".to_owned());
        }
        let number = LANS.fetch_add(1, Ordering::Relaxed);
        // Names of interfaces have 15 bytes.
        let prefix = format!("tg{}x{number}", std::process::id());
        let lan = Self { prefix, hosts: hosts.iter().map(|host| (*host).to_owned()).collect() };
        let tried = Command::new("ip").args(["netns", "add", &lan.switch()]).output();
        match tried {
            Err(error) => return Err(format!("`ip` of iproute2: {error}")),
            Ok(done) if !done.status.success() => {
                return Err(String::from_utf8_lossy(&done.stderr).trim().to_owned());
            }
            Ok(_) => {}
        }
        let switch = lan.switch();
        must(&format!("-n {switch} link add br0 type bridge"));
        must(&format!("-n {switch} link set br0 up"));
        for (n, host) in lan.hosts.iter().enumerate() {
            let (namespace, address) = (lan.namespace(host), lan.address(host));
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

    fn number(&self, host: &str) -> usize {
        self.hosts.iter().position(|other| other == host).expect("a host of this network")
    }

    /// Name of the namespace of a host, for [`crate::Setup::namespace`].
    pub fn namespace(&self, host: &str) -> String {
        format!("{}-{}", self.prefix, self.number(host))
    }

    /// Address of a host.
    pub fn address(&self, host: &str) -> String {
        format!("10.77.0.{}", self.number(host) + 1)
    }

    /// Cuts a host off from all others.
    pub fn cut(&self, host: &str) {
        must(&format!("-n {} link set p{} nomaster", self.switch(), self.number(host)));
    }

    /// Joins it again.
    pub fn heal(&self, host: &str) {
        must(&format!("-n {} link set p{} master br0", self.switch(), self.number(host)));
    }

    /// Bytes that a host has sent and received so far, headers of Ethernet included.
    pub fn bytes(&self, host: &str) -> (u64, u64) {
        let counted = |what: &str| -> u64 {
            let path = format!("/sys/class/net/eth0/statistics/{what}");
            let mut cat = Command::new("cat");
            let read = within(&self.namespace(host), cat.arg(path)).output().unwrap();
            String::from_utf8(read.stdout).unwrap().trim().parse().expect(what)
        };
        (counted("tx_bytes"), counted("rx_bytes"))
    }
}

impl Drop for Lan {
    fn drop(&mut self) {
        for host in &self.hosts {
            ip(&format!("netns delete {}", self.namespace(host)));
        }
        ip(&format!("netns delete {}", self.switch()));
    }
}
