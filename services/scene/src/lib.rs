//! The imagined building: walls, doors, walkers and the rays that see them.
//!
//! A [`World`] is a pure function of (scene, seed, time): no clock, no file, no memory of what was
//! asked before. So every laser process imagines the same people, a process that starts late agrees
//! with one that ran all along, and hours can be looked at in seconds.
//!
//! Invariants: nobody walks through a wall (the check refuses such a file); every count has a limit
//! ([`check`]); every draw is keyed, never a continuation; a scan casts only what moves.
//! Left out: people do not avoid each other, the turn of the mirror during a scan, glass, and what
//! happens at other heights than the knee.
//!
//! | where | what |
//! |---|---|
//! | [`Scene`] (`file`) | the scene file (TOML) as plain data |
//! | [`check`] | its bounds, in words |
//! | [`World`] (`world`) | scans and truth at any time |
//! | `population`, `ways` | who is there: arrivals, loops, wanderers, incidents |
//! | `walk`, `path` | one person: body, gait, legs |
//! | `door`, `obstacle` | leaves and when they open; what nobody walks through |
//! | `view`, `shape` | exact ray casting |
//! | `sensor`, `lms200`, `seed` | noise and codes; a real device; keyed randomness |
//!
//! ```
//! use scene::{Scene, World};
//! let scene = Scene::builtin("foyer")?;
//! let laser = scene.lasers[0].clone();
//! let mut world = World::new(scene, 7)?;
//! let mut ranges_m = Vec::new();
//! world.scan(&laser, 12.5, &mut ranges_m);
//! assert_eq!(ranges_m.len(), laser.beams as usize);
//! # Ok::<(), scene::SceneError>(())
//! ```

mod builtin;
pub mod check;
mod door;
mod error;
mod file;
mod lms200;
mod obstacle;
mod path;
mod population;
mod seed;
mod sensor;
mod shape;
mod view;
mod walk;
mod ways;
mod world;

pub use builtin::BUILTIN;
pub use error::SceneError;
pub use file::{
    Area, BoxObject, Incident, LaserSpec, Loop, Opening, Pillar, Route, RoutePoint,
    SCENE_BYTES_MAX, Scene, Sensor, SensorModel, SlidingDoor, SlidingLeaf, SwingDoor, Wall, Wander,
};
pub use world::{DoorTruth, PersonTruth, Truth, World};

#[cfg(test)]
mod tests;
