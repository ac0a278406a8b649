//! What a replay says of itself, in words. Pure.

/// A time as people say it: 12 ms, 4.2 s, 26 min, 6 h.
pub fn duration(seconds: f64) -> String {
    let whole = seconds.round();
    match seconds {
        s if s < 0.9995 => format!("{:.0} ms", s * 1000.0),
        s if s < 9.95 => format!("{s:.1} s"),
        s if s < 119.5 => format!("{s:.0} s"),
        s if s < 7199.5 && whole % 60.0 == 0.0 => format!("{:.0} min", s / 60.0),
        s if s < 7199.5 => format!("{:.0} min {:.0} s", (whole / 60.0).floor(), whole % 60.0),
        s => {
            let minutes = (s / 60.0).round();
            match minutes % 60.0 {
                0.0 => format!("{:.0} h", minutes / 60.0),
                rest => format!("{:.0} h {rest:.0} min", (minutes / 60.0).floor()),
            }
        }
    }
}

/// How far the detector of an area came in a recording that was too short for it.
#[derive(Debug, Clone, PartialEq)]
pub struct TooShort {
    /// Id of the area.
    pub area: String,
    /// What it had, in words.
    pub had: String,
    /// What it needs to learn, seconds.
    pub learning_s: f64,
    /// What it needs to calibrate, seconds.
    pub calibration_s: f64,
}

/// The same of all areas of a run, in one sentence; `None` if there is nothing to say.
pub fn too_short(areas: &[TooShort]) -> Option<String> {
    let first = areas.first()?;
    let alike = |area: &TooShort| {
        (area.learning_s, area.calibration_s) == (first.learning_s, first.calibration_s)
    };
    let needs = |area: &TooShort| {
        let (learning, calibration) = (duration(area.learning_s), duration(area.calibration_s));
        format!("{learning} of normal life to learn and then {calibration} to calibrate")
    };
    let had: Vec<String> = if areas.iter().all(alike) {
        areas.iter().map(|area| format!("{} had {}", area.area, area.had)).collect()
    } else {
        let had =
            |area: &TooShort| format!("{} needs {}, had {}", area.area, needs(area), area.had);
        areas.iter().map(had).collect()
    };
    let needs = if areas.iter().all(alike) {
        format!("the detector needs {}: ", needs(first))
    } else {
        String::new()
    };
    Some(format!(
        "the recording is too short for events: {needs}{}; a site file may ask for less with \
         learning_s and calibration_s under [area.detector]",
        had.join("; ")
    ))
}

/// What is known of a run that classified no cell.
#[derive(Debug, Clone, Copy)]
pub struct Empty {
    /// Length of all frames, seconds.
    pub replayed_s: f64,
    /// From scan to scan of the slowest laser, on average.
    pub scan_period_ms: f64,
    /// Of the area.
    pub frame_period_ms: f64,
    /// Of the area.
    pub scan_age_max_ms: f64,
    /// The longest timescale, seconds.
    pub longest_s: f64,
    /// Of the area.
    pub known_share_min: f64,
}

impl Empty {
    /// Why, and what to set.
    pub fn why(&self) -> String {
        let Self { replayed_s, scan_period_ms, scan_age_max_ms, longest_s, .. } = *self;
        let known_s = self.known_share_min * longest_s;
        let rule = format!(
            "a cell needs to be seen for {} of {} (known_share_min = {} of the longest timescale)",
            duration(known_s),
            duration(longest_s),
            self.known_share_min
        );
        if scan_period_ms > scan_age_max_ms {
            return format!(
                "a scan comes every {scan_period_ms:.0} ms, but a frame takes none that is older than \
                 scan_age_max_ms = {scan_age_max_ms}, so that most frames are without a scan, and {rule}. Set \
                 scan_age_max_ms = {:.0}, frame_period_ms = {:.0} and laser_lost_ms = {:.0} under [[area]]",
                (scan_period_ms * 2.5).min(60_000.0),
                scan_period_ms.clamp(self.frame_period_ms, 10_000f64.max(self.frame_period_ms)),
                (scan_period_ms * 10.0).min(600_000.0),
            );
        }
        if replayed_s < known_s {
            return format!(
                "the recording has {}, and {rule}. Record for longer, or set known_share_min or timescales_s \
                 under [[area]]",
                duration(replayed_s)
            );
        }
        format!(
            "{rule}, and none was. See with `tog bag info` whether the scans have echoes and where they \
             lie, and whether origin_m, columns and rows of the [[area]] and the pose of the [[laser]] put them \
             into the grid"
        )
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn times_are_said_as_people_say_them() {
        let times = [
            (0.0, "0 ms"),
            (0.0123, "12 ms"),
            (0.9999, "1.0 s"),
            (9.96, "10 s"),
            (119.4, "119 s"),
            (120.0, "2 min"),
            (150.0, "2 min 30 s"),
            (7199.4, "119 min 59 s"),
            (7199.9, "2 h"),
            (21_600.0, "6 h"),
            (9000.0, "2 h 30 min"),
        ];
        for (seconds, words) in times {
            assert_eq!(duration(seconds), words);
        }
    }

    #[test]
    fn what_all_areas_need_is_said_once() {
        let area = |area: &str, learning_s| TooShort {
            area: area.into(),
            had: "60 s of learning".into(),
            learning_s,
            calibration_s: 21_600.0,
        };
        assert_eq!(too_short(&[]), None);
        let said = too_short(&[area("a", 21_600.0), area("b", 21_600.0)]).unwrap();
        assert!(said.matches("6 h of normal life to learn and then 6 h").count() == 1, "{said}");
        assert!(said.contains("a had 60 s of learning; b had 60 s"), "{said}");
        let said = too_short(&[area("a", 21_600.0), area("b", 3600.0)]).unwrap();
        assert!(said.contains("a needs 6 h") && said.contains("b needs 60 min"), "{said}");
    }

    #[test]
    fn an_empty_map_is_explained_by_slow_scans_then_by_a_short_recording_then_by_the_place() {
        let facts = Empty {
            replayed_s: 2600.0,
            scan_period_ms: 2900.0,
            frame_period_ms: 100.0,
            scan_age_max_ms: 250.0,
            longest_s: 60.0,
            known_share_min: 0.5,
        };
        let slow = facts.why();
        assert!(slow.contains("scan_age_max_ms = 7250, frame_period_ms = 2900"), "{slow}");
        let short = Empty { scan_period_ms: 100.0, replayed_s: 12.0, ..facts }.why();
        assert!(short.contains("has 12 s") && short.contains("seen for 30 s of 60 s"), "{short}");
        let elsewhere = Empty { scan_period_ms: 100.0, ..facts }.why();
        assert!(elsewhere.contains("origin_m"), "{elsewhere}");
    }
}
