//! The hosts of a site: who they are, where their bridges listen, and what runs where.

use super::{Area, ID_PATTERN, Laser, Site, default_state_dir};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::net::{Ipv4Addr, Ipv6Addr};
use std::path::{Path, PathBuf};

/// Most hosts of a site: every bridge holds a link to every other one (but for clients), and 32 of them are
/// 496 links; more floors are more sites.
pub const HOSTS_MAX: usize = 32;
/// What an endpoint looks like.
pub(super) const ENDPOINT_PATTERN: &str = r"^(\[[0-9A-Fa-f:.]+\]|[A-Za-z0-9.-]+):[0-9]{1,5}$";

/// A host of a site that has several.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Host {
    /// Name of the host, unique in the site: letters, digits, `-`, `_`; at most 32.
    #[schemars(regex(pattern = ID_PATTERN))]
    pub id: String,
    /// Address and port where its bridge listens and where the others find it.
    #[schemars(regex(pattern = ENDPOINT_PATTERN))]
    pub endpoint: String,
    /// How the bridges talk. There is no default: that nothing is encrypted must be said aloud.
    pub transport: Transport,
    /// True for a host where people look at the alerts: the events of all hosts come here.
    #[serde(default)]
    pub desk: bool,
    /// Cores of its processor: `tog check` refuses what they cannot do.
    #[serde(default = "two_cores", skip_serializing_if = "is_two_cores")]
    #[schemars(range(min = 1, max = 1024))]
    pub cores: u32,
    /// How fast its network is, megabits a second: `tog check` refuses what does not fit.
    #[serde(default = "a_gigabit", skip_serializing_if = "is_a_gigabit")]
    #[schemars(range(min = 1, max = 400_000))]
    pub network_mbit_s: u32,
    /// Areas of other hosts whose frames, class maps and collapsed maps are to be had here, too: in
    /// shared memory, as if they ran here.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub follows: Vec<String>,
    /// Hosts whose bridges this one is a client of, two for when one is lost: it is linked to one of them
    /// at a time and to nobody else, and nobody dials it. For a desk without areas and lasers.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub through: Vec<String>,
    /// Which of its certificates the others believe: one more each time that a key of this host is lost or
    /// stolen. Those before it are refused from then on.
    #[serde(default = "first_certificate", skip_serializing_if = "is_first_certificate")]
    #[schemars(range(min = 1, max = 9999))]
    pub certificate_number: u32,
}

fn first_certificate() -> u32 {
    1
}

#[allow(clippy::trivially_copy_pass_by_ref)] // serde wants it so
fn is_first_certificate(number: &u32) -> bool {
    *number == first_certificate()
}

fn two_cores() -> u32 {
    2
}

#[allow(clippy::trivially_copy_pass_by_ref)] // serde wants it so
fn is_two_cores(cores: &u32) -> bool {
    *cores == two_cores()
}

fn a_gigabit() -> u32 {
    1000
}

#[allow(clippy::trivially_copy_pass_by_ref)] // serde wants it so
fn is_a_gigabit(network_mbit_s: &u32) -> bool {
    *network_mbit_s == a_gigabit()
}

/// How bridges talk with each other.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Transport {
    /// TLS, where both sides prove who they are by certificates of the site's authority (`tog certs`):
    /// each host may say what is its own, and nothing else.
    Tls,
    /// TCP as it is: whoever reaches the network reads everything and can speak as any host.
    PlainTcp,
}

impl Host {
    /// True if there is a link between the two: all have one but desks that go through others.
    #[must_use]
    pub fn has_link_to(&self, other: &Self) -> bool {
        let direct =
            |from: &Self, to: &Self| from.through.is_empty() || from.through.contains(&to.id);
        self.id != other.id && direct(self, other) && direct(other, self)
    }
}

impl Area {
    /// True if `host` is its host or its standby.
    #[must_use]
    pub fn may_run_on(&self, host: Option<&str>) -> bool {
        self.host.as_deref() == host || self.standby.is_some() && self.standby.as_deref() == host
    }

    /// Origin of the events that it tells from `host`: its id, and `<id>@<host>` from its standby, so
    /// that each host counts its own; no id has an `@`.
    #[must_use]
    pub fn origin_on(&self, host: Option<&str>) -> String {
        match host.filter(|host| self.standby.as_deref() == Some(host)) {
            Some(host) => format!("{}@{host}", self.id),
            None => self.id.clone(),
        }
    }
}

impl Site {
    /// True if the site has more than one host, and so needs bridges.
    #[must_use]
    pub fn has_bridges(&self) -> bool {
        self.hosts.len() > 1
    }

    /// True if the hosts prove to each other who they are; the rules see to it that all do or none.
    #[must_use]
    pub fn uses_tls(&self) -> bool {
        self.hosts.iter().any(|host| host.transport == Transport::Tls)
    }

    /// A host by its id.
    #[must_use]
    pub fn host(&self, id: &str) -> Option<&Host> {
        self.hosts.iter().find(|host| host.id == id)
    }

    /// The hosts that are heard only through `router`, in the order of the file.
    pub fn clients_of<'s>(&'s self, router: &'s str) -> impl Iterator<Item = &'s Host> {
        self.hosts.iter().filter(move |host| host.through.iter().any(|id| id == router))
    }

    /// The same site with everything on one host.
    #[must_use]
    pub fn on_one_host(mut self) -> Self {
        self.hosts.clear();
        self.areas.iter_mut().for_each(|area| (area.host, area.standby) = (None, None));
        self.lasers.iter_mut().for_each(|laser| laser.host = None);
        self.recorder.iter_mut().for_each(|recorder| recorder.host = None);
        self
    }

    /// True if `host` has the recorder of this site.
    #[must_use]
    pub fn records_on(&self, host: Option<&str>) -> bool {
        let Some(recorder) = &self.recorder else { return false };
        let desk = || self.hosts.iter().find(|host| host.desk).or(self.hosts.first());
        let chosen = recorder.host.as_deref().or_else(|| desk().map(|host| host.id.as_str()));
        chosen == host
    }

    /// What of the site is to be heard on `host`, as a site of its own without hosts: the areas that it
    /// may run or follows, and the lasers whose scans are there. All of a site without hosts.
    #[must_use]
    pub fn part_on(&self, host: Option<&str>) -> Self {
        let is_heard = |laser: &Laser| {
            let mut here = self.areas_on(host);
            self.host_of_laser(laser) == host || here.any(|area| area.id == laser.area)
        };
        let mut part = self.clone();
        part.lasers.retain(is_heard);
        let has_laser = |area: &Area| part.lasers.iter().any(|laser| laser.area == area.id);
        let is_there = |area: &&Area| self.has_maps_on(host, &area.id) || has_laser(area);
        part.areas = self.areas.iter().filter(is_there).cloned().collect();
        part.on_one_host()
    }

    /// The host that runs an area, while it is there; none if the site has no hosts.
    #[must_use]
    pub fn host_of_area<'s>(&'s self, area: &'s Area) -> Option<&'s str> {
        area.host.as_deref()
    }

    /// The host that runs a laser: its own, else that of its area; none if the site has no hosts.
    #[must_use]
    pub fn host_of_laser<'s>(&'s self, laser: &'s Laser) -> Option<&'s str> {
        let of_area = || self.areas.iter().find(|area| area.id == laser.area)?.host.as_deref();
        laser.host.as_deref().or_else(of_area)
    }

    /// The areas that `host` may run, as their host or as their standby, in the order of the file; all
    /// of a site without hosts.
    pub fn areas_on<'s>(&'s self, host: Option<&'s str>) -> impl Iterator<Item = &'s Area> {
        self.areas.iter().filter(move |area| area.may_run_on(host))
    }

    /// True if frames and maps of the area are on `host`: it may run there, or is followed.
    #[must_use]
    pub fn has_maps_on(&self, host: Option<&str>, area: &str) -> bool {
        self.areas_on(host).chain(self.areas_followed_by(host)).any(|there| there.id == area)
    }

    /// The areas that do not run on `host` and whose maps it wants, in the order of the file.
    pub fn areas_followed_by(&self, host: Option<&str>) -> impl Iterator<Item = &Area> {
        let follows = host.and_then(|id| self.host(id)).map_or(&[][..], |host| &host.follows);
        self.areas.iter().filter(move |area| follows.contains(&area.id))
    }

    /// The lasers that run on `host`, in the order of the file; all of a site without hosts.
    pub fn lasers_on<'s>(&'s self, host: Option<&'s str>) -> impl Iterator<Item = &'s Laser> {
        self.lasers.iter().filter(move |laser| self.host_of_laser(laser) == host)
    }

    /// The lasers whose scans must reach another host, with their index in the site: those that do
    /// not run where their area does, or may have to.
    pub fn lasers_that_cross(&self) -> impl Iterator<Item = (usize, &Laser, &Area)> {
        let with_area = |(index, laser): (usize, _)| {
            let laser: &Laser = laser;
            let area = self.areas.iter().find(|area| area.id == laser.area)?;
            let host = self.host_of_laser(laser);
            let crosses = host != self.host_of_area(area)
                || area.standby.is_some() && host != area.standby.as_deref();
            crosses.then_some((index, laser, area))
        };
        self.lasers.iter().enumerate().filter_map(with_area)
    }

    /// Directory of the state of one host; `base_dir` is that of the site file. Of a site with hosts each
    /// has its own, so that one directory can hold the states of all. Services do not write below /etc
    /// (FHS 3.0, 5.8): unless the site file says where, its state is in /var/lib/tog/<site> then.
    #[must_use]
    pub fn state_dir_of(&self, base_dir: &Path, host: Option<&str>) -> PathBuf {
        let state_dir = if self.state_dir == default_state_dir() && base_dir.starts_with("/etc") {
            Path::new("/var/lib/tog").join(&self.name)
        } else {
            base_dir.join(&self.state_dir)
        };
        host.map_or_else(|| state_dir.clone(), |host| state_dir.join(host))
    }
}

/// Whether a text is an endpoint: an address or a name, a colon, a port from 1 to 65535. Not "every
/// address" (0.0.0.0, [::]): others dial it.
pub(super) fn is_endpoint(text: &str) -> bool {
    let Some((address, port)) = text.rsplit_once(':') else { return false };
    let in_brackets = address.strip_prefix('[').and_then(|rest| rest.strip_suffix(']'));
    let is_address = match in_brackets {
        Some(inner) => inner.parse::<Ipv6Addr>().is_ok_and(|address| !address.is_unspecified()),
        None => {
            let allowed = |byte: u8| byte.is_ascii_alphanumeric() || byte == b'-' || byte == b'.';
            let is_every =
                address.parse::<Ipv4Addr>().is_ok_and(|address| address.is_unspecified());
            !address.is_empty() && !is_every && address.len() <= 253 && address.bytes().all(allowed)
        }
    };
    let digits = (1..=5).contains(&port.len()) && port.bytes().all(|byte| byte.is_ascii_digit());
    is_address && digits && port.parse::<u16>().is_ok_and(|port| port > 0)
}
