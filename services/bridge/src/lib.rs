//! The way to the other hosts of a site: one process a host, the only one that knows a network.
//!
//! ```text
//!  edge host                                                     desk host
//!  laser ──scan/room──▶ bridge ══ tog/<site>/edge/scan/<laser> ══▶ bridge ──scan/room──▶ fusion
//!  alerts ──its feed──▶ bridge ══ .../event/live, .../event/log ═▶ bridge ──event──▶ alerts
//!  everybody ─health──▶ bridge ══ .../health ════════════════════▶ bridge: its faults, `tog status`
//! ```
//!
//! Invariants
//! - **Scans: the newest wins.** A scan that finds no room goes, on this side (zenoh drops what does
//!   not fit its queue) and on that (the oldest in the queue of a reader in shared memory); both are
//!   counted by the numbers of the laser's process.
//! - **Frames and maps: only while somebody elsewhere listens**, and the newest wins: see [`maps`].
//! - **Events: none is lost, none comes twice.** The journal of the host where an event happened is
//!   the truth. A desk asks "everything after row n" in pages, is told rows as they come and where
//!   the journal ends once a second, and moves its cursor on when *its* journal has acknowledged
//!   what was handed to it. So a bridge may die at any moment: see [`follower`].
//! - **Nothing enters shared memory that was not decoded and bounded**: kind, version, length, every
//!   field; a scan only of a laser that runs there, an event only of an origin that lives there,
//!   health only of a process that the site file places there. What is refused is counted.
//! - **An area that two hosts may run is run by one**, as soon as they hear each other: [`ownership`].
//! - Callbacks of zenoh only move bytes into bounded queues ([`inbox`]); all else is one thread. But for
//!   scans, which are in a hurry: those never wait for that thread (`scans`).
//! - **Who is on the other side is proved by its certificate**, and it may say only what is its own
//!   ([`access`]); what it tries besides is refused and told ([`guard`]). With `plain-tcp` nobody proves
//!   anything: a host is believed to be what its key says.
//!
//! | question | where |
//! |---|---|
//! | what does zenoh do for us, with which settings, and what we do for its connections | `link` |
//! | what does the process do, in which order | `run` |
//! | how do scans get from shared memory into the network and back | `scans` |
//! | which links are there, who relays for whom | `Host::has_link_to`, `link` |
//! | who may say what | [`access`], pure |
//! | who tried without the right to | [`guard`] |
//! | which of two hosts runs an area | [`ownership`], pure; `run/areas.rs` acts |
//! | how does a standby get the map | [`replica`] |
//! | what is said of frames and maps, and made of it | [`maps`], pure; `run/maps.rs` acts |
//! | when has a desk everything | [`follower`], pure |
//! | how is the own journal told | `teller`, `feed_line` |
//! | what is known of the other hosts | [`remote`], pure |
//! | do they have the same site file | [`agreement`], pure |
//! | how far are their clocks from ours | [`clock_difference`], pure |
//! | where does a desk go on after a restart | `cursor` |

pub mod access;
pub mod agreement;
pub mod clock_difference;
mod cursor;
mod feed_line;
pub mod follower;
pub mod guard;
pub mod inbox;
mod link;
pub mod maps;
pub mod ownership;
pub mod remote;
pub mod replica;
mod run;
mod scans;
mod teller;

pub use run::run;

/// Makes this process fit to be a bridge. Call it before anything else: there must be no other thread
/// yet, and no log.
pub fn prepare() {
    link::read_and_write_on_one_thread();
    guard::listen();
}
