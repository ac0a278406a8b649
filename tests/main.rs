//! The system as its users meet it: the real binary, real processes, real files.
#![allow(missing_docs, clippy::unwrap_used)]

mod pipeline;
mod system;
