//! The `osier` program: arguments in, exit code out.

fn main() {}
