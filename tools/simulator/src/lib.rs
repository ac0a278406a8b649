//! Workloads of the benchmarks, and scenes with their truth.
//!
//! A workload is a stream of frames that no file holds: it is imagined again, the same bytes for the
//! same seed, at every run.
//!
//! | where | what |
//! |---|---|
//! | [`workload`] | W1r, W2r, W3r: the turned rooms of the performance targets |
//! | [`measure`] | how alive a workload is: no-returns, beams that change, people |
//! | `main.rs` | the program `simulator` |

pub mod measure;
pub mod workload;
