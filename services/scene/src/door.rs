//! Doors: how far open each is at a time, and where its leaves are then.
//!
//! A door is open for intervals: those of the schedule, of incidents, and one for everybody who
//! walks through, from before the walker is in the leaf's reach until a drawn time after. The door
//! follows whichever interval opens it most, so that it never jumps.

use crate::file::{Incident, Opening, Scene};
use crate::seed::{Purpose, name_key, stream};
use crate::shape::{Point, Segment, add, scale};
use crate::walk::{Walk, smooth};
use rand::RngExt;

/// A walker needs so much beyond the swing of a leaf, metres: a stride before the body.
const CLEAR_M: f64 = 0.6;

/// One leaf: straight from its shut place to its open place, or round a hinge.
#[derive(Debug, Clone, Copy)]
enum Leaf {
    Swing { hinge: Point, leaf_m: f64, closed_rad: f64, open_rad: f64 },
    Slide { shut: Segment, shift: Point },
}

impl Leaf {
    fn at(&self, share: f64) -> Segment {
        match *self {
            Self::Swing { hinge, leaf_m, closed_rad, open_rad } => {
                let (sin, cos) = (closed_rad + (open_rad - closed_rad) * share).sin_cos();
                Segment { a: hinge, b: add(hinge, scale([cos, sin], leaf_m)) }
            }
            Self::Slide { shut, shift } => {
                let moved = scale(shift, share);
                Segment { a: add(shut.a, moved), b: add(shut.b, moved) }
            }
        }
    }
}

/// A door of the scene.
#[derive(Debug, Clone)]
pub(crate) struct Door {
    pub id: String,
    leaves: Vec<Leaf>,
    move_s: f64,
    hold_s: [f64; 2],
    reach_m: f64,
    schedule: Vec<Opening>,
    /// Fully open from, until: by the walkers of the present window.
    passages: Vec<(f64, f64)>,
}

impl Door {
    /// The doors of a scene, those on hinges first.
    pub fn all(scene: &Scene) -> Vec<Self> {
        let swing = scene.doors.iter().map(|door| Self {
            id: door.id.clone(),
            leaves: vec![Leaf::Swing {
                hinge: door.hinge_m,
                leaf_m: door.leaf_m,
                closed_rad: door.closed_deg.to_radians(),
                open_rad: door.open_deg.to_radians(),
            }],
            move_s: door.move_s,
            hold_s: door.hold_s,
            reach_m: door.leaf_m + CLEAR_M,
            schedule: door.openings.clone(),
            passages: Vec::new(),
        });
        let slide = scene.sliding_doors.iter().map(|door| Self {
            id: door.id.clone(),
            leaves: (door.leaves.iter())
                .map(|leaf| Leaf::Slide {
                    shut: Segment { a: leaf.from_m, b: leaf.to_m },
                    shift: leaf.shift_m,
                })
                .collect(),
            move_s: door.move_s,
            hold_s: door.hold_s,
            reach_m: CLEAR_M,
            schedule: door.openings.clone(),
            passages: Vec::new(),
        });
        let mut doors: Vec<Self> = swing.chain(slide).collect();
        for incident in &scene.incidents {
            if let Incident::DoorHeld { at_s: Some(at_s), stays_s, door, .. } = incident
                && let Some(held) = doors.iter_mut().find(|candidate| candidate.id == *door)
            {
                let opening = Opening { at_s: *at_s, hold_s: *stays_s, every_s: None };
                held.schedule.push(opening);
            }
        }
        doors
    }

    /// Forgets the walkers.
    pub fn clear(&mut self) {
        self.passages.clear();
    }

    /// Opens for a walker who passes the shut leaves, once for every time.
    pub fn open_for(&mut self, walk: &Walk, speed_m_s: f64) {
        for (at_m, a, b) in walk.path.pieces() {
            let piece = Segment { a, b };
            for leaf in &self.leaves {
                let shut = leaf.at(0.0);
                let Some((share, _)) = piece.crossing(&shut) else { continue };
                let cross_m = at_m + share * crate::shape::norm(crate::shape::sub(b, a));
                let Some(passes_s) = walk.reaches_s(cross_m) else { continue };
                let mut rng = stream(Purpose::DoorHold, &[walk.id, name_key(&self.id)]);
                let [hold_min, hold_max] = self.hold_s;
                let hold = hold_min + (hold_max - hold_min) * rng.random::<f64>();
                let clear_s = self.reach_m / speed_m_s;
                self.passages.push((passes_s - clear_s, passes_s + clear_s + hold));
            }
        }
    }

    /// How far open: 0 shut, 1 open.
    pub fn share(&self, t_s: f64) -> f64 {
        let mut most: f64 = 0.0;
        for &(from, until) in &self.passages {
            most = most.max(self.share_of(from, until, t_s));
        }
        for opening in &self.schedule {
            let Opening { at_s, hold_s, every_s } = *opening;
            let turn = every_s.map_or(0.0, |every| ((t_s - at_s) / every).floor());
            for k in [turn, turn + 1.0] {
                let from = at_s + k * every_s.unwrap_or(0.0);
                most = most.max(self.share_of(from, from + hold_s, t_s));
            }
        }
        smooth(most)
    }

    fn share_of(&self, from_s: f64, until_s: f64, t_s: f64) -> f64 {
        let opening = 1.0 + (t_s - from_s) / self.move_s;
        let closing = 1.0 + (until_s - t_s) / self.move_s;
        opening.min(closing).clamp(0.0, 1.0)
    }

    /// The leaves at a time.
    pub fn leaves(&self, t_s: f64) -> impl Iterator<Item = Segment> + '_ {
        let share = self.share(t_s);
        self.leaves.iter().map(move |leaf| leaf.at(share))
    }

    /// The open leaves.
    pub fn open(&self) -> impl Iterator<Item = Segment> + '_ {
        self.leaves.iter().map(|leaf| leaf.at(1.0))
    }
}
