//! Messages for tests: one fixed sample of each, and strategies for any.

use proptest::collection::{btree_map, vec};
use proptest::prelude::*;
use protocol::carried::{CarriedCounts, CarriedMap, MapContent};
use protocol::event::{EventAcknowledgement, EventChange, EventKind, EventState};
use protocol::health::{Fault, Health, ServiceState};
use protocol::link::{
    AreaFile, CarriedScan, Claim, Claims, EventPage, EventRow, FilePage, FileVersion, HostHealth,
};
use protocol::ownership::{AreaOwnership, Ownership};
use protocol::scan::{LaserScan, ScanGeometry};

/// 2026-01-02 03:04:05.678 UTC.
pub const STAMP_NS: u64 = 1_767_323_045_678_000_000;

pub fn scan() -> LaserScan {
    LaserScan {
        stamp_ns: STAMP_NS,
        device_stamp_ns: 42,
        geometry: ScanGeometry {
            angle_min_rad: -1.5,
            angle_increment_rad: 0.25,
            range_min_m: 0.125,
            range_max_m: 8.0,
        },
        ranges_m: vec![1.0, f32::INFINITY, f32::NEG_INFINITY, 0.5],
    }
}

pub fn event() -> EventChange {
    EventChange {
        origin: "foyer".into(),
        sequence: 7,
        id: "foyer-3".into(),
        kind: EventKind::Loitering,
        state: EventState::Updated,
        stamp_ns: STAMP_NS,
        first_evidence_ns: STAMP_NS - 12_000_000_000,
        area: "foyer".into(),
        zone: Some("door".into()),
        x_m: 1.5,
        y_m: -2.25,
        bounds_m: [1.0, -2.5, 2.0, -2.0],
        score: 12.5,
        threshold: 10.0,
        extrapolated: true,
        text: "Somebody stands.".into(),
    }
}

pub fn acknowledgement() -> EventAcknowledgement {
    EventAcknowledgement { origin: "foyer".into(), sequence: 300 }
}

pub fn carried_scan() -> CarriedScan {
    CarriedScan { laser: "front".to_owned(), session: STAMP_NS, seq: 300, scan: Some(scan()) }
}

pub fn event_page() -> EventPage {
    let row = EventRow { journal_id: 8, change: event() };
    EventPage { host: "desk".to_owned(), epoch: STAMP_NS, after: 7, head: 9, rows: vec![row] }
}

pub fn health() -> Health {
    Health {
        service: "fusion foyer".into(),
        pid: 4321,
        started_ns: STAMP_NS,
        stamp_ns: STAMP_NS + 1,
        state: ServiceState::Degraded,
        counters: [("frames_out".to_owned(), 10), ("scans_in".to_owned(), 200)].into(),
        gauges: [("scan_rate_hz".to_owned(), 9.5)].into(),
        faults: vec![Fault {
            code: "laser_silent".into(),
            text: "front: no scan for 3 s".into(),
            since_ns: STAMP_NS - 3,
        }],
    }
}

/// Any kind that there is. A new kind must be appended: its number is on the wire.
pub const KINDS: [EventKind; 14] = [
    EventKind::UnusualActivity,
    EventKind::Loitering,
    EventKind::ObjectLeft,
    EventKind::ObjectMissing,
    EventKind::DoorHeldOpen,
    EventKind::Crowd,
    EventKind::LaserSilent,
    EventKind::LaserStuck,
    EventKind::LaserBlocked,
    EventKind::LaserBlinded,
    EventKind::LaserMoved,
    EventKind::CoverageLost,
    EventKind::ProcessRestarted,
    EventKind::StorageFault,
];

fn finite() -> impl Strategy<Value = f64> {
    any::<f64>().prop_filter("finite", |value| value.is_finite())
}

fn geometry() -> impl Strategy<Value = ScanGeometry> {
    let increment = prop_oneof![-1.0..-1e-6, 1e-6..1.0];
    (-10.0..10.0, increment, 0.0..10.0, 10.5..1000.0).prop_map(|(min, increment, near, far)| {
        ScanGeometry {
            angle_min_rad: min,
            angle_increment_rad: increment,
            range_min_m: near,
            range_max_m: far,
        }
    })
}

/// Ranges are raw: any bits, NaN with a payload included.
pub fn any_scan() -> impl Strategy<Value = LaserScan> {
    let ranges_m = vec(any::<u32>().prop_map(f32::from_bits), 0..200);
    (any::<u64>(), any::<u64>(), geometry(), ranges_m).prop_map(
        |(stamp_ns, device_stamp_ns, geometry, ranges_m)| LaserScan {
            stamp_ns,
            device_stamp_ns,
            geometry,
            ranges_m,
        },
    )
}

pub fn any_event() -> impl Strategy<Value = EventChange> {
    let states =
        prop::sample::select(vec![EventState::Raised, EventState::Updated, EventState::Cleared]);
    let names = (".{0,40}", ".{0,40}", ".{0,40}", prop::option::of(".{0,40}"), ".{0,400}");
    let numbers =
        (finite(), finite(), [finite(), finite(), finite(), finite()], finite(), finite());
    let rest = (any::<u64>(), any::<u64>(), any::<u64>(), any::<bool>());
    (names, numbers, rest, prop::sample::select(KINDS.to_vec()), states).prop_map(
        |(
            (origin, id, area, zone, text),
            (x_m, y_m, bounds_m, score, threshold),
            rest,
            kind,
            state,
        )| {
            let (sequence, stamp_ns, first_evidence_ns, extrapolated) = rest;
            EventChange {
                origin,
                sequence,
                id,
                kind,
                state,
                stamp_ns,
                first_evidence_ns,
                area,
                zone,
                x_m,
                y_m,
                bounds_m,
                score,
                threshold,
                extrapolated,
                text,
            }
        },
    )
}

pub fn any_acknowledgement() -> impl Strategy<Value = EventAcknowledgement> {
    (".{0,40}", any::<u64>())
        .prop_map(|(origin, sequence)| EventAcknowledgement { origin, sequence })
}

pub fn any_health() -> impl Strategy<Value = Health> {
    let states = prop::sample::select(vec![
        ServiceState::Starting,
        ServiceState::Running,
        ServiceState::Degraded,
        ServiceState::Ended,
    ]);
    let fault = (".{0,20}", ".{0,80}", any::<u64>()).prop_map(|(code, text, since_ns)| Fault {
        code,
        text,
        since_ns,
    });
    let maps = (btree_map(".{0,20}", any::<u64>(), 0..20), btree_map(".{0,20}", finite(), 0..20));
    let head = (".{0,40}", any::<u32>(), any::<u64>(), any::<u64>());
    (head, states, maps, vec(fault, 0..5)).prop_map(
        |((service, pid, started_ns, stamp_ns), state, (counters, gauges), faults)| Health {
            service,
            pid,
            started_ns,
            stamp_ns,
            state,
            counters,
            gauges,
            faults,
        },
    )
}

fn file_version() -> FileVersion {
    FileVersion { file: AreaFile::Normal, modified_ns: STAMP_NS, bytes: 300 }
}

pub fn host_health() -> HostHealth {
    HostHealth { host: "edge".to_owned(), health: health() }
}

pub fn claims() -> Claims {
    let claim = Claim {
        area: "foyer".to_owned(),
        epoch: 4,
        owns: true,
        releases: false,
        files: vec![file_version()],
    };
    Claims { host: "desk".to_owned(), claims: vec![claim] }
}

pub fn file_page() -> FilePage {
    FilePage {
        area: "foyer".to_owned(),
        version: file_version(),
        offset: 297,
        bytes: vec![1, 2, 3],
    }
}

pub fn ownership() -> Ownership {
    Ownership { areas: vec![AreaOwnership { area: "foyer".to_owned(), runs: true }] }
}

pub fn carried_map() -> CarriedMap {
    CarriedMap {
        host: "desk".to_owned(),
        area: "foyer".to_owned(),
        content: MapContent::Classes,
        session: STAMP_NS,
        seq: 300,
        number: 7,
        period_ns: 100_000_000,
        lasers_present: 5,
        context: 1,
        classes: 6,
        columns: 20,
        rows: 10,
        is_key: false,
        codes: vec![3, 300],
    }
}

pub fn carried_counts() -> CarriedCounts {
    CarriedCounts {
        host: "desk".to_owned(),
        area: "foyer".to_owned(),
        number: 7,
        period_ns: 100_000_000,
        context: 1,
        classes: 6,
        columns: 20,
        rows: 10,
        offset: 1000,
        runs: vec![(150, 0), (50, 300)],
    }
}
