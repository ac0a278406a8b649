//! The areas that this host shares with another one: who runs them, and the copies for when that changes.

use super::{Bridge, encoded, hear, refuse};
use crate::cursor::Kept;
use crate::inbox::FileAsk;
use crate::link::Asker;
use crate::ownership::{Said, Stored, Tenure};
use crate::replica::{self, Replica};
use process::{Failure, Publisher, Worker, monotonic_ns, wall_ns};
use protocol::codec::{decode, encode};
use protocol::link::{AreaFile, Claim, Claims, FilePage, FileVersion};
use protocol::ownership::{AreaOwnership, Ownership};
use protocol::site::{Area, Host, Site};
use protocol::time::SECOND_NS;
use protocol::topic;
use protocol::wire::BytesHeader;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// Claims are told this often, and at once when they change.
const CLAIM_NS: u64 = SECOND_NS / 2;
/// A copy that is older than three checkpoints and so much is a fault.
const REPLICA_AGE_S: f64 = 60.0;

/// One area.
struct Shared {
    area: Area,
    /// The index of the other host.
    other: usize,
    tenure: Tenure,
    /// What of it is on disk.
    on_disk: Stored,
    replica: Replica,
    /// The streams of its scans that come from other hosts.
    streams: Vec<usize>,
    files: Vec<FileVersion>,
    /// When it began to be copied, CLOCK_MONOTONIC.
    since_ns: u64,
}

/// All of them.
pub(super) struct Areas {
    /// The id of this host.
    host: String,
    shared: Vec<Shared>,
    ownership: Publisher<BytesHeader, u8>,
    state_dir: PathBuf,
    claimed_ns: u64,
    moves: u64,
    files_refused: u64,
    trouble: Option<String>,
    /// When a tenure could not be written, CLOCK_MONOTONIC, and why.
    unwritten: Option<(u64, String)>,
}

/// The ids of the areas that `me` shares with another host.
pub(super) fn shared_areas(site: &Site, me: &Host) -> Vec<String> {
    let areas = site.areas_on(Some(&me.id)).filter(|area| area.standby.is_some());
    areas.map(|area| area.id.clone()).collect()
}

impl Areas {
    /// `streams`: the laser's area of each stream.
    pub(super) fn open(
        worker: &mut Worker,
        me: &Host,
        shelf: &crate::cursor::Shelf,
        streams: &[String],
    ) -> Result<Self, Failure> {
        let (site, now_ns) = (&worker.site, monotonic_ns());
        let run = worker.instance.started_ns;
        let state_dir = worker.instance.state_dir.clone();
        let mut shared = Vec::new();
        for id in shared_areas(site, me) {
            let Some(area) = site.areas.iter().find(|area| area.id == id) else { continue };
            let is_standby = area.standby.as_deref() == Some(me.id.as_str());
            let other = if is_standby { &area.host } else { &area.standby };
            let other = site.hosts.iter().position(|host| Some(&host.id) == other.as_ref());
            let Some(other) = other else { continue };
            let Kept { value, damage } = shelf.tenure(&id, wall_ns())?;
            let fault = damage.map(|damage| {
                format!("{damage}; who owns area {id} is asked of host {}", site.hosts[other].id)
            });
            worker.health.set_fault(&format!("tenure_damaged {id}"), fault);
            let stored = value.unwrap_or_default();
            let of_area = |(_, other): &(usize, &String)| **other == id;
            shared.push(Shared {
                area: area.clone(),
                other,
                tenure: Tenure::new(is_standby, stored, run, now_ns),
                on_disk: stored,
                replica: Replica::new(&state_dir, &id),
                streams: streams.iter().enumerate().filter(of_area).map(|(n, _)| n).collect(),
                files: Vec::new(),
                since_ns: now_ns,
            });
        }
        let ownership = worker.bus.publisher(&topic::ownership(), 0)?;
        Ok(Self {
            host: me.id.clone(),
            shared,
            ownership,
            state_dir,
            claimed_ns: 0,
            moves: 0,
            files_refused: 0,
            trouble: None,
            unwritten: None,
        })
    }

    fn of(&mut self, area: &str) -> Option<&mut Shared> {
        self.shared.iter_mut().find(|shared| shared.area.id == area)
    }

    pub(super) fn deadline_ns(&self) -> Option<u64> {
        if self.shared.is_empty() {
            return None;
        }
        let tenures = self.shared.iter().filter_map(|shared| shared.tenure.due_ns());
        let replicas = self.shared.iter().filter(|shared| !shared.tenure.owns());
        let replicas = replicas.filter_map(|shared| shared.replica.deadline_ns());
        tenures.chain(replicas).chain([self.claimed_ns + CLAIM_NS]).min()
    }

    fn claims(&self) -> Claims {
        let claim = |shared: &Shared| Claim {
            area: shared.area.id.clone(),
            epoch: shared.tenure.epoch(),
            owns: shared.tenure.owns(),
            releases: shared.tenure.releases(),
            files: if shared.tenure.owns() { shared.files.clone() } else { Vec::new() },
        };
        Claims { host: self.host.clone(), claims: self.shared.iter().map(claim).collect() }
    }

    fn tell_supervisor(&mut self) {
        let area = |shared: &Shared| AreaOwnership {
            area: shared.area.id.clone(),
            runs: shared.tenure.owns(),
        };
        let message = Ownership { areas: self.shared.iter().map(area).collect() };
        let sent = encode(&message).map_err(|error| error.to_string()).and_then(|bytes| {
            let sent = self.ownership.send(BytesHeader::default(), &bytes);
            sent.map_err(|error| error.to_string())
        });
        if let Err(error) = sent {
            tracing::error!("the supervisor is not told which areas run here: {error}");
        }
    }
}

impl Bridge {
    /// Says at the start what this host owns: after a restart of the bridge alone, what it owned.
    pub(super) fn begin_areas(&mut self) {
        let owned: Vec<_> = self.areas.shared.iter().map(|shared| shared.tenure.owns()).collect();
        self.areas.tell_supervisor();
        for (index, owns) in owned.into_iter().enumerate() {
            self.listen_for(index, owns);
        }
    }

    fn listen_for(&mut self, index: usize, owns: bool) {
        for &stream in &self.areas.shared[index].streams {
            self.link.listen(stream, owns, &self.inbox);
        }
    }

    /// What came of the other hosts of shared areas.
    pub(super) fn take_areas(
        &mut self,
        alive: BTreeMap<usize, bool>,
        claims: BTreeMap<usize, Vec<u8>>,
    ) {
        let now_ns = monotonic_ns();
        for (host, alive) in alive {
            let shared = self.areas.shared.iter_mut().filter(|shared| shared.other == host);
            shared.for_each(|shared| shared.tenure.token(alive, now_ns));
        }
        for (host, bytes) in claims {
            match decode::<Claims>(&bytes) {
                Ok(claims) if claims.host != self.hosts[host].id => {
                    let expected = self.hosts[host].id.clone();
                    self.misrouted(&expected, &claims.host);
                }
                Ok(claims) => self.take_claims(host, claims, now_ns),
                Err(error) => {
                    refuse(&mut self.areas.files_refused, &self.hosts[host].id, &error);
                }
            }
        }
    }

    /// Brings to the disk who owns what, if that is not there yet. A disk that takes nothing is a fault, and
    /// is tried again; the areas are watched all the same: the epochs of two hosts are never the same
    /// ones, and after a restart the other host tells the highest.
    fn keep_tenures(&mut self, now_ns: u64) {
        let mut unwritten = None;
        for shared in &mut self.areas.shared {
            let stored = shared.tenure.stored();
            if stored == shared.on_disk {
                continue;
            }
            match self.shelf.store_tenure(&shared.area.id, stored) {
                Ok(()) => shared.on_disk = stored,
                Err(error) => unwritten = Some((now_ns, error.to_string())),
            }
        }
        self.areas.unwritten = unwritten;
    }

    fn take_claims(&mut self, host: usize, claims: Claims, now_ns: u64) {
        if let Some(remote) = self.remote.get_mut(host).and_then(Option::as_mut) {
            hear(remote, now_ns);
            let not_there = claims.claims.iter().filter(|claim| !claim.owns);
            not_there.for_each(|claim| remote.left(&claim.area));
        }
        for Claim { area, epoch, owns, releases, files } in claims.claims {
            let index = self
                .areas
                .shared
                .iter()
                .position(|shared| shared.other == host && shared.area.id == area);
            let Some(index) = index else { continue };
            let shared = &mut self.areas.shared[index];
            let owned = shared.tenure.owns();
            shared.tenure.said(Said { epoch, owns, releases }, now_ns);
            if owns && !shared.tenure.owns() {
                shared.replica.offered(&files);
            }
            if owned && !self.areas.shared[index].tenure.owns() {
                let host = &self.hosts[host].id;
                tracing::warn!("area {area} is run by host {host} in epoch {epoch}: it stops here");
                self.areas.shared[index].replica.begin_anew(now_ns);
                self.moved(index, false, now_ns);
            }
        }
    }

    fn moved(&mut self, index: usize, owns: bool, now_ns: u64) {
        self.areas.moves += 1;
        self.areas.shared[index].since_ns = now_ns;
        self.listen_for(index, owns);
        self.areas.tell_supervisor();
        self.areas.claimed_ns = 0; // at once
    }

    /// Pages of files that came, and questions for ours.
    pub(super) fn take_files(
        &mut self,
        files: impl IntoIterator<Item = (usize, Vec<u8>)>,
        asks: impl IntoIterator<Item = FileAsk<Asker>>,
    ) {
        for (host, bytes) in files {
            let page = match decode::<FilePage>(&bytes) {
                Ok(page) => page,
                Err(error) => {
                    refuse(&mut self.areas.files_refused, &self.hosts[host].id, &error);
                    continue;
                }
            };
            let Some(shared) = self.areas.of(&page.area).filter(|s| s.other == host) else {
                continue;
            };
            if shared.tenure.owns() {
                continue;
            }
            let trouble = shared.replica.take(&page).err().map(|error| {
                shared.replica.abandon();
                format!("area {}: {error}: free space, or repair the disk", page.area)
            });
            self.areas.trouble = trouble;
        }
        for FileAsk { area, file, offset, query } in asks {
            let owns = self.areas.of(&area).is_some_and(|shared| shared.tenure.owns());
            match replica::page(&self.areas.state_dir, &area, file, offset) {
                Ok(page) if owns => self.link.answer_file(&query, &page),
                // Who does not own it has nothing to say; who asked asks again.
                Ok(_) => {}
                Err(error) => tracing::debug!("{}: {error}", file.name(&area)),
            }
        }
    }

    /// What is due: an area that nobody runs any more, claims, a page of a copy.
    pub(super) fn serve_areas(&mut self) {
        let now_ns = monotonic_ns();
        let retry_ns =
            self.areas.unwritten.as_ref().map_or(0, |(tried_ns, _)| tried_ns + SECOND_NS);
        if now_ns >= retry_ns {
            self.keep_tenures(now_ns);
        }
        for index in 0..self.areas.shared.len() {
            let shared = &mut self.areas.shared[index];
            if shared.tenure.tick(now_ns) {
                let (id, epoch) = (shared.area.id.clone(), shared.tenure.epoch());
                shared.replica.stop();
                // Stored before anybody acts on it: no epoch is used twice.
                self.keep_tenures(now_ns);
                tracing::warn!("area {id} runs on this host from now on, epoch {epoch}");
                self.moved(index, true, now_ns);
                continue;
            }
            if shared.tenure.owns() {
                continue;
            }
            let host = &self.hosts[shared.other].id;
            match shared.replica.question(now_ns) {
                Ok(None) => {}
                Ok(Some(wanted)) => {
                    let id = &shared.area.id;
                    self.link.ask_file((shared.other, host), id, wanted, &self.inbox);
                }
                Err(error) => {
                    shared.replica.abandon();
                    self.areas.trouble = Some(format!("area {}: {error}", shared.area.id));
                }
            }
        }
        if !self.areas.shared.is_empty() && now_ns >= self.areas.claimed_ns + CLAIM_NS {
            self.areas.claimed_ns = now_ns;
            let state_dir = self.areas.state_dir.clone();
            for shared in self.areas.shared.iter_mut().filter(|shared| shared.tenure.owns()) {
                let version =
                    |file: &AreaFile| replica::version(&state_dir, &shared.area.id, *file);
                shared.files = AreaFile::ALL.iter().filter_map(version).collect();
            }
            let claims = self.areas.claims();
            encoded(&claims).into_iter().for_each(|bytes| self.link.send_claims(bytes));
        }
    }

    /// This host stops in good order: the others need not wait until it is missed.
    pub(super) fn release_areas(&mut self) {
        for shared in self.areas.shared.iter_mut().filter(|shared| shared.tenure.owns()) {
            shared.tenure.release();
            if let Err(error) = self.shelf.store_tenure(&shared.area.id, shared.tenure.stored()) {
                tracing::warn!("{error}"); // the next start asks who owns it anyway
            }
        }
        let claims = self.areas.claims();
        encoded(&claims).into_iter().for_each(|bytes| self.link.send_claims(bytes));
    }

    /// How the shared areas are.
    pub(super) fn tell_areas(&mut self, worker: &mut Worker, now_ns: u64) {
        if self.areas.shared.is_empty() {
            return;
        }
        let health = &mut worker.health;
        health.set_count("areas_moved", self.areas.moves);
        health.set_count("claims_refused", self.areas.files_refused);
        let copied = self.areas.shared.iter().map(|shared| shared.replica.copied()).sum();
        health.set_count("files_copied", copied);
        let trouble = self.areas.trouble.as_ref().map(|trouble| format!("no copy: {trouble}"));
        health.set_fault("replica_unwritable", trouble);
        let unwritten = self.areas.unwritten.as_ref().map(|(_, error)| {
            format!(
                "{error}: which host owns its areas is not on disk. They are watched all the same; after a \
                 restart this host asks the other one. Free space, or repair the disk"
            )
        });
        health.set_fault("tenure_unwritable", unwritten);
        for shared in &self.areas.shared {
            let (id, owns) = (&shared.area.id, shared.tenure.owns());
            health.gauge(&format!("area_runs_here {id}"), f64::from(u8::from(owns)));
            health.gauge(&format!("area_epoch {id}"), shared.tenure.epoch() as f64);
            let written_ns = shared.replica.map_written_ns();
            let age_s = written_ns.map(|ns| wall_ns().saturating_sub(ns) as f64 / 1e9);
            let name = format!("replica_age_s {id}");
            match age_s.filter(|_| !owns) {
                Some(age_s) => health.gauge(&name, age_s),
                None => health.drop_gauge(&name),
            }
            let waited_s = now_ns.saturating_sub(shared.since_ns) as f64 / 1e9;
            let age_max_s = 3.0 * shared.area.checkpoint_s + REPLICA_AGE_S;
            let is_old = !owns && age_s.unwrap_or(waited_s) > age_max_s && waited_s > age_max_s;
            let fault = is_old.then(|| {
                let other = &self.hosts[shared.other].id;
                let found = age_s.map_or("there is no copy".to_owned(), |age_s| {
                    format!("the copy is {age_s:.0} s old")
                });
                format!(
                    "{found}, expected at most {age_max_s:.0} s: if host {other} failed now, area {id} \
                     would go on here from that"
                )
            });
            health.set_fault(&format!("replica_old {id}"), fault);
        }
    }
}
