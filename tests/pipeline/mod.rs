//! What the real binary makes of recordings, good and bad, and what it says.
//!
//! | where | what it holds |
//! |---|---|
//! | `same_numbers` | `tog run` and `tog replay` give the same bytes, at every run |
//! | `oracle` | a program that shares no code with us agrees on every number |
//! | `foreign_logs` | every format gives the same scans as an independent reader, and the same numbers |
//! | `bag` | `tog bag`: what is told, copied, refused |
//! | `bad_recordings`, `bad_sites` | words and an exit code, or a drop that is counted and told |
//! | `cli` | every verb explains itself |
//! | `recordings` | what is recorded, recovered, and read by other people's programs |
//! | `golden` | a made recording as a picture in letters, to be read by people |
//! | `map` | `tog map`: pictures, nav2, NumPy, differences, sums; a program of Python agrees |
//! | `demo` | `tog demo` alarms, ends, and leaves nothing |
//! | `experiment` | the paper's experiments: files, figures, verdicts |
//! | `support` | runs the binary under a watchdog; reads what it wrote |
//! | `made` | recordings made by the letter, good and bad |

mod bad_recordings;
mod bad_sites;
mod bag;
mod cli;
mod demo;
mod experiment;
mod foreign_logs;
mod golden;
pub mod made;
mod map;
pub mod oracle;
mod recordings;
mod same_numbers;
pub mod support;
