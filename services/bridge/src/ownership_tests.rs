#![allow(clippy::unwrap_used)]
use super::*;
use proptest::prelude::*;

const STEP_NS: u64 = SECOND_NS / 10;
/// A cut link is noticed after the lease, a killed process at once.
const LEASE_NS: u64 = 2 * SECOND_NS;

/// One host: what is on its disk, and its bridge while it runs.
struct Host {
    is_standby: bool,
    disk: Stored,
    run: u64,
    bridge: Option<Tenure>,
}

/// An area's host and its standby, and the link between them.
struct Pair {
    hosts: [Host; 2],
    now_ns: u64,
    /// Since when the link is as it is.
    link: (bool, u64),
    claimed_ns: u64,
    /// The area ran on both in these many steps in a row, while both heard each other.
    both: u64,
}

impl Pair {
    fn new() -> Self {
        let host = |is_standby| Host { is_standby, disk: Stored::default(), run: 0, bridge: None };
        let (now_ns, link) = (SECOND_NS, (true, 0));
        let mut pair =
            Self { hosts: [host(false), host(true)], now_ns, link, claimed_ns: 0, both: 0 };
        (0..2).for_each(|n| pair.start(n, true));
        pair
    }

    fn start(&mut self, n: usize, new_run: bool) {
        let host = &mut self.hosts[n];
        host.run += u64::from(new_run);
        host.bridge = Some(Tenure::new(host.is_standby, host.disk, host.run, self.now_ns));
    }

    fn owners(&self) -> Vec<u64> {
        let owners = self.hosts.iter().filter_map(|host| host.bridge.as_ref());
        owners.filter(|tenure| tenure.owns()).map(Tenure::epoch).collect()
    }

    fn step(&mut self) {
        self.now_ns += STEP_NS;
        let (now_ns, (linked, since_ns)) = (self.now_ns, self.link);
        let seen = linked || now_ns < since_ns + LEASE_NS;
        for n in 0..2 {
            let alive = seen && self.hosts[1 - n].bridge.is_some();
            if let Some(tenure) = &mut self.hosts[n].bridge {
                tenure.token(alive, now_ns);
                tenure.tick(now_ns);
                self.hosts[n].disk = tenure.stored();
            }
        }
        if linked && now_ns >= self.claimed_ns + SECOND_NS / 2 {
            self.claimed_ns = now_ns;
            self.claim();
        }
        let owners = self.owners();
        self.both = if owners.len() == 2 && linked { self.both + 1 } else { 0 };
        assert!(self.both * STEP_NS <= SECOND_NS, "two owners for {} steps", self.both);
        assert!(owners.len() < 2 || owners[0] != owners[1], "two owners of one epoch");
    }

    fn claim(&mut self) {
        let claims = [0, 1].map(|n| {
            self.hosts[n].bridge.as_ref().map(|tenure| Said {
                epoch: tenure.epoch(),
                owns: tenure.owns(),
                releases: tenure.releases(),
            })
        });
        for n in 0..2 {
            if let (Some(tenure), Some(said)) = (&mut self.hosts[n].bridge, claims[1 - n]) {
                tenure.said(said, self.now_ns);
                self.hosts[n].disk = tenure.stored();
            }
        }
    }

    fn run_s(&mut self, seconds: u64) {
        (0..seconds * SECOND_NS / STEP_NS).for_each(|_| self.step());
    }

    /// Steps until exactly this host owns; after how many seconds.
    fn until_owned_by(&mut self, n: usize) -> f64 {
        let begin_ns = self.now_ns;
        while !self.hosts[n].bridge.as_ref().is_some_and(Tenure::owns) {
            self.step();
            assert!(self.now_ns < begin_ns + 60 * SECOND_NS, "it never does");
        }
        (self.now_ns - begin_ns) as f64 / 1e9
    }
}

#[test]
fn a_site_that_is_switched_on_runs_where_its_file_says() {
    let mut pair = Pair::new();
    assert!(pair.until_owned_by(0) <= 1.0);
    pair.run_s(60);
    assert_eq!(pair.owners(), [2]);
}

#[test]
fn the_standby_takes_over_and_keeps_the_area_when_the_host_is_back() {
    let mut pair = Pair::new();
    pair.run_s(5);
    pair.hosts[0].bridge = None;
    let seconds = pair.until_owned_by(1);
    assert!((1.5..2.0).contains(&seconds), "{seconds}");
    pair.start(0, true);
    pair.run_s(60);
    assert_eq!(pair.owners(), [3]);
    pair.hosts[1].bridge = None;
    assert!(pair.until_owned_by(0) < 2.0);
    assert_eq!(pair.owners(), [4]);
}

#[test]
fn a_bridge_that_is_restarted_within_its_run_moves_nothing() {
    let mut pair = Pair::new();
    pair.run_s(5);
    for _ in 0..10 {
        pair.hosts[0].bridge = None;
        (0..12).for_each(|_| pair.step());
        pair.start(0, false);
        pair.run_s(2);
        assert_eq!(pair.owners(), [2]);
    }
}

#[test]
fn of_two_halves_of_a_cut_site_one_yields_when_they_hear_each_other() {
    let mut pair = Pair::new();
    pair.run_s(5);
    pair.link = (false, pair.now_ns);
    let seconds = pair.until_owned_by(1);
    assert!((3.4..3.8).contains(&seconds), "{seconds}");
    pair.run_s(60);
    assert_eq!(pair.owners(), [2, 3], "both watch");
    pair.link = (true, pair.now_ns);
    pair.run_s(1);
    assert_eq!(pair.owners(), [3]);
}

#[test]
fn a_host_that_stops_in_good_order_hands_over_at_once() {
    let mut pair = Pair::new();
    pair.run_s(5);
    pair.hosts[0].bridge.as_mut().unwrap().release();
    pair.claim();
    assert!(pair.until_owned_by(1) <= 0.1);
    assert_eq!(pair.owners(), [3]);
}

#[derive(Debug, Clone, Copy)]
enum Blow {
    Cut,
    Heal,
    Kill(usize),
    Restart(usize, bool),
    Wait(u64),
}

fn blow() -> impl Strategy<Value = Blow> {
    prop_oneof![
        Just(Blow::Cut),
        Just(Blow::Heal),
        (0usize..2).prop_map(Blow::Kill),
        (0usize..2, any::<bool>()).prop_map(|(n, run)| Blow::Restart(n, run)),
        (1u64..120).prop_map(Blow::Wait),
    ]
}

proptest! {
    #[test]
    fn whatever_happened_once_all_hear_each_other_one_owns_it_and_of_the_highest_epoch(
        blows in proptest::collection::vec(blow(), 1..40),
    ) {
        let mut pair = Pair::new();
        for blow in blows {
            match blow {
                Blow::Cut => pair.link = (false, pair.now_ns),
                Blow::Heal => pair.link = (true, pair.now_ns),
                Blow::Kill(n) => pair.hosts[n].bridge = None,
                Blow::Restart(n, new_run) => pair.start(n, new_run),
                Blow::Wait(steps) => (0..steps).for_each(|_| pair.step()),
            }
        }
        pair.link = (true, pair.now_ns);
        for n in 0..2 {
            if pair.hosts[n].bridge.is_none() {
                pair.start(n, true);
            }
        }
        pair.run_s(20);
        let highest = pair.hosts.iter().map(|host| host.disk.epoch).max().unwrap();
        prop_assert_eq!(pair.owners(), [highest]);
    }
}
