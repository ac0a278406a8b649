//! Workloads of the benchmarks, and scenes with their truth.
//!
//! A workload is a stream of frames that no file holds: it is imagined again, the same bytes for
//! the same seed, at every run.
//!
//! | where | what |
//! |---|---|
//! | [`workload`] | W1r, W2r, W3r: the turned rooms of the performance targets |
//! | [`measure`] | how alive a workload is: no-returns, beams that change, people |
//! | [`export`] | a workload or a scene as a recording (MCAP), the truth as JSON lines beside it |
//! | [`site_file`] | a site file that fits a scene or a workload |
//! | [`picture`] | a scene at an instant in characters, to be looked at |
//! | `main.rs` | the program `simulator` |

pub mod export;
pub mod measure;
pub mod picture;
pub mod site_file;
pub mod workload;
