//! `simulator`: says what a workload or a scene is like.
fn main() {}
