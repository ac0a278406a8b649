//! The shell kit: all that a process of tog needs around its pure core. The only crate that knows
//! iceoryx2, signals and clocks.
//!
//! A worker in ten lines: [`worker::run`] gives its body a [`Worker`]; the body opens its ports on
//! [`Worker::bus`], and then loops: take everything that is there, then [`Worker::wait`].
//!
//! ```no_run
//! use process::{Failure, Worker};
//! use protocol::health::ServiceState;
//! use protocol::topic;
//!
//! fn fusion(worker: &mut Worker) -> Result<(), Failure> {
//!     let (index, area) = worker.area().ok_or_else(|| Failure::Config("no area".into()))?;
//!     let words = area.grid().plane_words();
//!     let mut scans = worker.bus.subscriber_with_credit(&topic::scan(&area.id))?;
//!     let mut frames = worker.bus.publisher(&topic::frame(&area.id, words), index)?;
//!     let clock = worker.instance.clock;
//!     loop {
//!         // Lossless sites: take a scan only while a frame could be passed on.
//!         while frames.may_send() {
//!             let Some(scan) = scans.receive()? else { break };
//!             let _ = (scan.header().stamp_ns, scan.payload()); // core.handle(..)
//!             let mut frame = frames.loan(2 * words)?;
//!             frame.header_mut().number = 1;
//!             frame.payload_mut().fill(0);
//!             frame.send();
//!             scans.finish(&scan.receipt());
//!             worker.health.set_state(ServiceState::Running);
//!         }
//!         worker.health.set_count("scans_in", scans.losses().received);
//!         worker.health.set_count("scans_lost", scans.losses().lost);
//!         let lateness = clock.deadline_mono_ns(1_700_000_000_000_000_000);
//!         if worker.wait(lateness)?.stop {
//!             return Ok(());
//!         }
//!     }
//! }
//! # let _ = fusion;
//! ```
//!
//! Invariants:
//! - A process sleeps in [`EventLoop::wait`] and nowhere else; whatever woke it, it takes all there is.
//! - Only the owner ([`domain::Owner`]) creates services, sweeps and wipes; workers open.
//! - No message is lost in silence: overflow replaces the oldest, and the reader counts the gap.
//! - In a lossless site nothing overflows: publishers keep to the credit of their readers.
//! - After the owner's clean end nothing is left; after its death the workers stop by themselves, and
//!   the next owner wipes the rest.
//!
//! | where | what |
//! |---|---|
//! | [`worker`] | a process from its first line to its exit code |
//! | [`event_loop`] | epoll: data, deadlines, signals, descriptors |
//! | [`bus`], [`publisher`], [`subscriber`], [`ports`] | shared memory, typed |
//! | [`loss`], [`credit`] | pure: what was lost, what may be sent |
//! | [`plan`], [`role`] | pure: topics and processes of a site |
//! | [`instance`], [`domain`] | the run directory, and who owns it |
//! | `name_lock`, [`state_lock`] | one owner an instance, one writer a state directory |
//! | [`file`] | reading what nobody vouches for |
//! | [`clock`], [`latency`], [`health`], [`logging`] | time, how we are, what we say |
//! | [`overhear`] | what a library says only in its log |

pub mod bus;
pub mod clock;
pub mod credit;
pub mod descriptors;
pub mod domain;
mod doorbell;
pub mod event_loop;
pub mod file;
pub mod health;
pub mod instance;
pub mod latency;
mod leftovers;
pub mod logging;
pub mod loss;
mod name_lock;
mod node;
pub mod overhear;
pub mod plan;
pub mod ports;
pub mod publisher;
pub mod role;
pub mod state_lock;
pub mod subscriber;
pub mod worker;

pub use bus::Bus;
pub use clock::{Clock, monotonic_ns, wall_ns};
pub use credit::Receipt;
pub use event_loop::{EventLoop, Interest, Token, Wake};
pub use health::HealthReporter;
pub use instance::Instance;
pub use latency::Latencies;
pub use loss::Losses;
pub use ports::{BusError, Element};
pub use publisher::{Loan, Publisher};
pub use role::Role;
pub use state_lock::StateLock;
pub use subscriber::{Sample, Subscriber};
pub use worker::{Failure, Worker, exit, run};
