//! Times the turtle on one thread: `cargo run --release -p osier-plants --example turtle_speed`.
#![allow(
    clippy::expect_used,
    clippy::print_stdout,
    clippy::disallowed_methods,
    reason = "an example that measures time"
)]

use std::collections::BTreeMap;
use std::hint::black_box;
use std::sync::Arc;
use std::time::Instant;

use osier_base::{Error, diagnostic::Sources, limits::Limits};
use osier_grammar::{DeriveOptions, GrammarSource, derive_deferred, parse};
use osier_plants::grow::turtle::{TurtleOptions, grow};

fn main() {
    let text = "Lsystem: 1\nderivation length: 8\nAxiom: F(1)\n\
        F(x) --> F(x/3)[+(30)F(x/3)]F(x/3)[-(30)F(x/3)]F(x/3)\nendlsystem\n";
    let defines = BTreeMap::new();
    let mut none = |r: &str, _: &str| Err(Error::io("open", r, std::io::ErrorKind::NotFound.into()));
    let (bytes, functions) = (text.as_bytes(), Arc::default());
    let source = GrammarSource { name: "speed.l", bytes, includes: &mut none, defines: &defines, functions };
    let limits = Limits::default();
    let (grammar, _) = parse(&mut Sources::default(), source, &limits).expect("reads");
    osier_base::par::on_threads(1, || {
        let derived = derive_deferred(&grammar, &DeriveOptions::default(), &limits).expect("derives");
        let mut best = f64::INFINITY;
        for _ in 0..5 {
            let start = Instant::now();
            black_box(grow(&grammar, &derived, &TurtleOptions::default(), &limits).expect("draws"));
            best = best.min(start.elapsed().as_secs_f64());
        }
        let n = derived.module_count();
        println!("{:.1} M modules/s  ({n} modules, {:.1} ms)", n as f64 / best / 1e6, best * 1e3);
    });
}
