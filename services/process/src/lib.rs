//! The shell kit: the only crate that knows iceoryx2, signals and clocks.
