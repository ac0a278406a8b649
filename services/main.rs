//! tog.
fn main() {}
