//! An area for tests.

#![allow(clippy::unwrap_used)]

use protocol::site::{Area, Detector, Laser, NoReturn, Preset, Source};

/// An area with 10 cm cells at the origin and 10 frames a second.
pub(crate) fn area(columns: u32, rows: u32) -> Area {
    Area {
        id: "hall".to_owned(),
        host: None,
        standby: None,
        origin_m: [0.0, 0.0],
        cell_m: 0.1,
        columns,
        rows,
        range_tolerance_m: None,
        frame_period_ms: 100.0,
        scan_age_max_ms: 250.0,
        lateness_max_ms: 150.0,
        laser_lost_ms: 1000.0,
        timescales_s: vec![1.0, 15.0, 60.0],
        preset: Preset::Default,
        classes: Vec::new(),
        transit: None,
        known_share_min: 0.5,
        contexts: Vec::new(),
        checkpoint_s: 10.0,
        detector: Detector::default(),
        zones: Vec::new(),
    }
}

/// A laser of that area.
pub(crate) fn laser(id: &str, x_m: f64, y_m: f64) -> Laser {
    Laser {
        id: id.to_owned(),
        area: "hall".to_owned(),
        host: None,
        x_m,
        y_m,
        yaw_deg: 0.0,
        half_beam_deg: None,
        no_return: NoReturn::Free,
        source: Source::Simulator { scene: "hall".to_owned(), seed: 0, rate_hz: 10.0 },
    }
}
