//! The `selenograph` command.
fn main() {}
