//! What a site of several hosts costs: bytes a second from host to host, and the CPU of each host.
//!
//! Bytes are those on the wire, Ethernet headers included, counted from the messages as they are
//! encoded; a test compares them with the counters of the network within 20 %. CPU is the sum of what
//! the services were measured to take (the constants below say on what); a machine of another make
//! takes more or less. Pure, but for the scenes and recordings that say how many beams a laser has.

use anomaly::store::SAVE_PERIOD_NS;
use laser::replay::ReplaySource;
use occupancy::GridConfig;
use process::Role;
use protocol::carried::{CarriedMap, MapContent};
use protocol::codec::{Encoded, encode};
use protocol::link::{CarriedScan, EventPage};
use protocol::scan::{LaserScan, ScanGeometry};
use protocol::site::{Area, Host, Laser, Pace, Site, Source};
use protocol::time::SECOND_NS;
use std::collections::BTreeSet;
use std::path::Path;

/// What a laser sends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Feed {
    /// Beams of a scan.
    pub beams: usize,
    /// The angle that it sees, degrees.
    pub view_deg: f64,
    /// Scans a second.
    pub rate_hz: f64,
}

/// Ethernet, IP and TCP with timestamps, around a message or an acknowledgement.
const PACKET_BYTES: usize = 66;
/// What zenoh puts round a message whose key it has numbered.
const ZENOH_BYTES: usize = 16;
/// What TLS puts round a record.
const TLS_BYTES: usize = 22;
/// A process tells how it is once a second; counters and their names make most of it.
const HEALTH_BYTES: usize = 420;
/// zenoh keeps a link alive with a message each quarter of the lease of 2 s.
const KEEP_ALIVES_HZ: f64 = 2.0;
/// Of what is received about every second packet is acknowledged, fewer where they come in pairs.
const ACKNOWLEDGED: f64 = 0.4;
/// But a packet that is alone is acknowledged after 40 ms: so many a second all are.
const ALONE_HZ: f64 = 25.0;
// What is in frames and class maps of a place where people walk, key frames included, bytes. Between two
// frames noise turns some cells, the more the more beams there are; and where few lasers see, the shadows of
// those who walk sweep over others, the more the longer it takes. Whatever is more counts. A place where
// nobody walks costs less.

/// Of a frame for each beam of the area's lasers: 0.4 (W3r) to 0.75 (W1r), see `table wire`.
const FRAME_BYTES_A_BEAM: f64 = 0.75;
/// For each degree that its widest laser sees, and each second between two frames: one laser at 10 Hz in
/// the simulated room takes 580 bytes a frame.
const FRAME_BYTES_A_DEG_S: f64 = 32.0;
/// Of a class map, likewise.
const CLASS_BYTES_A_BEAM: f64 = 0.1;
/// Likewise.
const CLASS_BYTES_A_DEG_S: f64 = 6.0;

// What is in the files that a standby copies; both are packed, and most of a map is its longest window.

/// Of a map for each frame of the window and each beam of the area's lasers: four lasers at 75 Hz.
const COPY_BYTES_A_BEAM: f64 = 0.16;
/// Of a map for each frame of the window, each degree that the widest laser sees and each second between
/// two frames; several lasers see into the shadows of each other, see [`SHADOWS`].
const COPY_BYTES_A_DEG_S: f64 = 52.0;
/// A map of n lasers has so many times less of what sweeping shadows turn: n to the power of this. One,
/// two and four lasers at 10 Hz take 930, 480 and 320 bytes a frame.
const SHADOWS: f64 = 0.75;
/// Counts of a map, for each cell, after half a day; some more after months.
const COPY_BYTES_A_CELL: f64 = 1.0;
/// What the detector learnt, for each cell.
const NORMAL_BYTES_A_CELL: f64 = 9.0;
/// What a packet of Ethernet carries of a long message.
const SEGMENT_BYTES: f64 = 1448.0;

/// How many beams a laser has, and how many scans a second; none if its scene or recording cannot be
/// read.
pub fn feed(laser: &Laser, base_dir: &Path) -> Option<Feed> {
    match &laser.source {
        Source::Simulator { scene, rate_hz, .. } => {
            let scene = laser::site::load_scene(scene, base_dir).ok()?;
            let laser = laser::site::simulated_laser(&scene, laser);
            let view_deg = f64::from(laser.beams) * laser.angle_increment_deg.abs();
            Some(Feed { beams: laser.beams as usize, view_deg, rate_hz: *rate_hz })
        }
        Source::Replay { recording, topic, pace } => {
            let pace = match pace {
                Pace::RealTime => 1.0,
                Pace::Times(times) => *times,
                Pace::Lossless => return None, // as fast as it goes
            };
            let mut replay =
                ReplaySource::open(&base_dir.join(recording), topic.as_deref()).ok()?;
            let (mut scan, mut stamps_ns) = (LaserScan::default(), Vec::new());
            while stamps_ns.len() < 21 && replay.next(&mut scan).ok()? {
                stamps_ns.push(scan.stamp_ns);
            }
            let span_s = (stamps_ns.last()? - stamps_ns.first()?) as f64 / 1e9;
            let rate_hz = pace * (stamps_ns.len() - 1) as f64 / span_s;
            let beams = scan.ranges_m.len();
            let increment_deg = scan.geometry.angle_increment_rad.to_degrees();
            Some(Feed {
                beams,
                view_deg: beams as f64 * increment_deg.abs(),
                rate_hz: if span_s > 0.0 { rate_hz } else { 0.0 },
            })
        }
    }
}

/// A stream of messages from one host to another.
#[derive(Debug, Clone, PartialEq)]
pub struct Stream<'s> {
    /// Who sends.
    pub from: &'s str,
    /// Who receives.
    pub to: &'s str,
    /// What it is, in words.
    pub what: String,
    /// On the wire, bytes a second; of events those of a site where nothing happens.
    pub bytes_per_s: f64,
    /// Messages a second.
    pub rate_hz: f64,
}

/// Every host with every other one.
fn all_pairs(site: &Site) -> impl Iterator<Item = (&Host, &Host)> {
    site.hosts.iter().flat_map(move |from| {
        site.hosts.iter().filter(move |to| to.id != from.id).map(move |to| (from, to))
    })
}

/// Every host with every other one that it has a link to, as long as all hosts are there.
pub fn pairs(site: &Site) -> impl Iterator<Item = (&Host, &Host)> {
    all_pairs(site).filter(|(from, to)| way(site, &from.id, &to.id).len() == 2)
}

/// The hosts on the way from one to another, both included. A desk that goes through others is linked to
/// one at a time: the first, as a rule.
fn way<'s>(site: &'s Site, from: &'s str, to: &'s str) -> Vec<&'s str> {
    let router = |id: &str| site.host(id)?.through.first().map(String::as_str);
    let mut way = vec![from];
    way.extend(router(from).filter(|router| *router != to));
    way.extend(router(to).filter(|router| *router != from));
    way.push(to);
    way.dedup(); // two desks behind one host
    way
}

/// A site, and what its lasers send.
#[derive(Debug)]
pub struct Costs<'s> {
    site: &'s Site,
    /// By the index of the laser.
    feeds: Vec<Option<Feed>>,
}

impl<'s> Costs<'s> {
    /// Looks into scenes and recordings.
    pub fn of(site: &'s Site, base_dir: &Path) -> Self {
        Self { site, feeds: site.lasers.iter().map(|laser| feed(laser, base_dir)).collect() }
    }

    /// Bytes on the wire of a message of so many.
    fn on_the_wire(&self, bytes: usize) -> f64 {
        let tls_bytes = if self.site.uses_tls() { TLS_BYTES } else { 0 };
        (bytes + ZENOH_BYTES + PACKET_BYTES + tls_bytes) as f64
    }

    /// All that crosses. A stream whose laser cannot be looked at is counted with nothing.
    pub fn streams(&self) -> Vec<Stream<'s>> {
        let mut streams = self.scans();
        streams.extend(self.maps());
        let site = self.site;
        let head = encoded(&EventPage { host: "host-name".to_owned(), ..EventPage::default() });
        for (from, to) in all_pairs(site).filter(|(_, to)| to.desk) {
            let what = "events, none lost".to_owned();
            streams.push(self.stream(&from.id, &to.id, what, head + 20, 1.0));
        }
        for (from, to) in all_pairs(site) {
            let processes = Role::all(site, Some(&from.id)).len() as f64;
            let health =
                self.stream(&from.id, &to.id, "health".to_owned(), HEALTH_BYTES, processes);
            streams.push(health);
        }
        streams.extend(self.standby());
        let hops = |stream: &Stream<'s>| {
            let way = way(site, stream.from, stream.to);
            let what = match way.len() {
                2 => stream.what.clone(),
                _ => format!("{} ({} to {})", stream.what, stream.from, stream.to),
            };
            let hop = |hop: &[&'s str]| {
                let (from, to, what) = (hop[0], hop[1], what.clone());
                Stream { from, to, what, ..stream.clone() }
            };
            way.windows(2).map(hop).collect::<Vec<_>>()
        };
        // What one host says to several crosses a link that is on the way to all of them once.
        let mut crossed = BTreeSet::new();
        let said = streams.iter().flat_map(|stream| {
            hops(stream).into_iter().map(move |hop| (stream.from, stream.what.as_str(), hop))
        });
        said.filter(|(who, what, hop)| crossed.insert((*who, *what, hop.from, hop.to)))
            .map(|(_, _, hop)| hop)
            .collect()
    }

    fn stream(
        &self,
        from: &'s str,
        to: &'s str,
        what: String,
        bytes: usize,
        rate_hz: f64,
    ) -> Stream<'s> {
        Stream { from, to, what, bytes_per_s: self.on_the_wire(bytes) * rate_hz, rate_hz }
    }

    fn scans(&self) -> Vec<Stream<'s>> {
        let mut streams = Vec::new();
        for (index, laser, area) in self.site.lasers_that_cross() {
            let from = self.site.host_of_laser(laser).unwrap_or_default();
            let Feed { beams, rate_hz, .. } =
                self.feeds[index].unwrap_or(Feed { beams: 0, view_deg: 0.0, rate_hz: 0.0 });
            let bytes = scan_bytes(&laser.id, beams);
            // Of an area with a standby the scans go to where it runs: its own host, as a rule.
            let runs_on = area.host.as_deref().unwrap_or_default();
            let what = format!("scans of laser {}, for area {}", laser.id, area.id);
            if runs_on != from {
                streams.push(self.stream(from, runs_on, what, bytes, rate_hz));
            }
        }
        streams
    }

    fn maps(&self) -> Vec<Stream<'s>> {
        let mut streams = Vec::new();
        for to in &self.site.hosts {
            for area in self.site.areas_followed_by(Some(&to.id)) {
                let from = area.host.as_deref().unwrap_or_default();
                let (beams, rate_hz) = self.of_area(area);
                let widest = self.widest_deg(area);
                let head = map_bytes(from, &area.id);
                let bytes = |a_beam: f64, a_deg_s: f64| {
                    head + (a_beam * beams as f64).max(a_deg_s * widest / rate_hz) as usize
                };
                let frames = format!("frames of area {}", area.id);
                let of_frame = bytes(FRAME_BYTES_A_BEAM, FRAME_BYTES_A_DEG_S);
                let frames = self.stream(from, &to.id, frames, of_frame, rate_hz);
                let what = format!("class maps of area {}", area.id);
                let of_map = bytes(CLASS_BYTES_A_BEAM, CLASS_BYTES_A_DEG_S);
                let classes = self.stream(from, &to.id, what, of_map, rate_hz);
                streams.extend([frames, classes]);
            }
        }
        streams
    }

    /// Claims, twice a second, and the copies of maps and of what was learnt, as often as they are written.
    fn standby(&self) -> Vec<Stream<'s>> {
        let mut streams: Vec<Stream<'s>> = Vec::new();
        for area in self.site.areas.iter().filter(|area| area.standby.is_some()) {
            let (Some(own), Some(standby)) = (area.host.as_deref(), area.standby.as_deref()) else {
                continue;
            };
            for (from, to) in [(own, standby), (standby, own)] {
                let what = "claims of areas that both may run".to_owned();
                if !streams.iter().any(|s| (s.from, s.to) == (from, to)) {
                    streams.push(self.stream(from, to, what, 120, 2.0));
                }
            }
            let what = format!("copies of area {}", area.id);
            let bytes_per_s = self.copied_bytes_per_s(area);
            let packets_hz = bytes_per_s / SEGMENT_BYTES;
            let bytes_per_s = bytes_per_s + packets_hz * self.on_the_wire(0);
            streams.push(Stream { from: own, to: standby, what, bytes_per_s, rate_hz: packets_hz });
        }
        streams
    }

    /// Bytes a second of the files of an area, as they are written.
    fn copied_bytes_per_s(&self, area: &Area) -> f64 {
        let (beams, rate_hz) = self.of_area(area);
        let lasers = self.feeds_of(area).count().max(1) as f64;
        let swept = COPY_BYTES_A_DEG_S * self.widest_deg(area) / rate_hz / lasers.powf(SHADOWS);
        let a_frame = swept.max(COPY_BYTES_A_BEAM * beams as f64);
        let frames = f64::from(GridConfig::of_area(area).longest_frames());
        let cells = area.grid().cells() as f64;
        (frames * a_frame + cells * COPY_BYTES_A_CELL) / area.checkpoint_s
            + cells * NORMAL_BYTES_A_CELL * SECOND_NS as f64 / SAVE_PERIOD_NS as f64
    }

    /// What the lasers of an area send.
    fn feeds_of<'a>(&'a self, area: &'a Area) -> impl Iterator<Item = Feed> + 'a {
        let lasers = self.site.lasers.iter().zip(&self.feeds);
        lasers.filter(|(laser, _)| laser.area == area.id).filter_map(|(_, feed)| *feed)
    }

    /// What the laser of an area that sees most sees, degrees.
    fn widest_deg(&self, area: &Area) -> f64 {
        self.feeds_of(area).map(|feed| feed.view_deg).fold(0.0, f64::max)
    }

    /// Beams of an area's lasers in all, and frames a second.
    fn of_area(&self, area: &Area) -> (usize, f64) {
        let beams = self.feeds_of(area).map(|feed| feed.beams).sum();
        (beams, 1e9 / area.lattice().period_ns() as f64)
    }

    /// Bytes a second from one host to another: streams, acknowledgements of what comes back, and what
    /// keeps the link alive.
    pub fn link_bytes_per_s(&self, streams: &[Stream<'_>], from: &str, to: &str) -> f64 {
        let of = |from: &str, to: &str| {
            let of: Vec<_> = streams.iter().filter(|s| (s.from, s.to) == (from, to)).collect();
            (
                of.iter().map(|s| s.bytes_per_s).sum::<f64>(),
                of.iter().map(|s| s.rate_hz).sum::<f64>(),
            )
        };
        let ((bytes, _), (_, back_hz)) = (of(from, to), of(to, from));
        let kept_alive = KEEP_ALIVES_HZ * self.on_the_wire(0);
        let back_hz = back_hz + KEEP_ALIVES_HZ;
        let acknowledged_hz = back_hz.min(ALONE_HZ) + ACKNOWLEDGED * (back_hz - ALONE_HZ).max(0.0);
        bytes + kept_alive + acknowledged_hz * PACKET_BYTES as f64
    }

    /// Cores of a host that are busy, while it runs what is placed there; `with_standbys` also with the
    /// areas that it is the standby of.
    pub fn cores(&self, streams: &[Stream<'_>], host: Option<&str>, with_standbys: bool) -> f64 {
        let mut us_per_s = Role::all(self.site, host).len() as f64 * IDLE_PROCESS_US;
        for (laser, feed) in self.site.lasers.iter().zip(&self.feeds) {
            let Some(Feed { beams, rate_hz, .. }) = *feed else { continue };
            let is_simulated = matches!(laser.source, Source::Simulator { .. });
            if self.site.host_of_laser(laser) == host {
                let beams_us = if is_simulated { beams as f64 * SIMULATED_BEAM_US } else { 0.0 };
                us_per_s += rate_hz * (MESSAGE_US + beams_us);
            }
        }
        let runs_here =
            |area: &&Area| area.host.as_deref() == host || with_standbys && area.may_run_on(host);
        for area in self.site.areas.iter().filter(runs_here) {
            let (beams, rate_hz) = self.of_area(area);
            us_per_s += rate_hz * (AREA_FRAME_US + beams as f64 * AREA_BEAM_US);
            us_per_s += self.feeds_of(area).map(|feed| feed.rate_hz * TAKEN_US).sum::<f64>();
        }
        if let Some(host) = host {
            let of_host = streams.iter().filter(|s| s.from == host || s.to == host);
            us_per_s += of_host.map(|s| s.rate_hz).sum::<f64>() * CROSSING_US;
        }
        us_per_s / 1e6
    }
}

// Microseconds of CPU, release build, two shared cores of a virtual machine, 2026-11-26: three hosts with
// four lasers of 181 beams at 75 Hz (the test `four_lasers_at_75_hz..` prints what every process took).

/// A process that has nothing to do, a second: its health, and what it looks at.
const IDLE_PROCESS_US: f64 = 400.0;
/// A scan that is published.
const MESSAGE_US: f64 = 30.0;
/// A scan that is taken by fusion.
const TAKEN_US: f64 = 15.0;
/// A message to or from another host, at each.
const CROSSING_US: f64 = 90.0;
/// A beam of a simulated laser.
const SIMULATED_BEAM_US: f64 = 0.2;
/// A frame through fusion, mapper and anomaly.
const AREA_FRAME_US: f64 = 120.0;
/// What a beam more costs the frame: W1r takes 34 us a frame for 724 beams, W3r 1622 us for 17 296.
const AREA_BEAM_US: f64 = 0.15;

fn encoded<M: Encoded>(message: &M) -> usize {
    encode(message).map_or(0, |bytes| bytes.len())
}

fn scan_bytes(laser: &str, beams: usize) -> usize {
    let stamp_ns = 1_800_000_000_000_000_000;
    let geometry = ScanGeometry {
        angle_min_rad: 0.0,
        angle_increment_rad: 0.001,
        range_min_m: 0.0,
        range_max_m: 1.0,
    };
    let ranges_m = vec![0.0; beams.min(protocol::scan::BEAMS_MAX)];
    let scan = LaserScan { stamp_ns, device_stamp_ns: stamp_ns, geometry, ranges_m };
    let (session, seq) = (stamp_ns, 1 << 20);
    encoded(&CarriedScan { laser: laser.to_owned(), session, seq, scan: Some(scan) })
}

fn map_bytes(host: &str, area: &str) -> usize {
    encoded(&CarriedMap {
        host: host.to_owned(),
        area: area.to_owned(),
        content: MapContent::Frame,
        session: 1_800_000_000_000_000_000,
        seq: 1 << 20,
        number: 1 << 37,
        period_ns: 13_333_333,
        lasers_present: 15,
        context: 0,
        classes: 6,
        columns: 400,
        rows: 400,
        is_key: false,
        codes: Vec::new(),
    })
}
