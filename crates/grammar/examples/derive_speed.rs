//! Times derivations on one thread: `cargo run --release -p osier-grammar --example derive_speed [NAME]`.
#![allow(
    clippy::expect_used,
    clippy::print_stdout,
    clippy::disallowed_methods,
    reason = "an example that measures time"
)]

use std::collections::BTreeMap;
use std::hint::black_box;
use std::time::Instant;

use osier_base::{Error, diagnostic::Sources, limits::Limits};
use osier_grammar::{DeriveOptions, Grammar, GrammarSource, derive, derive_deferred, derive_text, interpret, parse};

fn system(n: u32, rules: &str, axiom: &str, items: &str) -> Grammar {
    let text = format!("Lsystem: 1\n{items}\nderivation length: {n}\nAxiom: {axiom}\n{rules}\nendlsystem\n");
    let defines = BTreeMap::new();
    let mut none = |r: &str, _: &str| Err(Error::io("open", r, std::io::ErrorKind::NotFound.into()));
    let (bytes, functions) = (text.as_bytes(), std::sync::Arc::default());
    let source = GrammarSource { name: "speed.l", bytes, includes: &mut none, defines: &defines, functions };
    parse(&mut Sources::default(), source, &Limits::default()).expect("reads").0
}

/// Prints the best of five runs in millions of modules a second.
fn time(name: &str, modules: u64, mut run: impl FnMut() -> u64) {
    let mut best = f64::INFINITY;
    for _ in 0..5 {
        let start = Instant::now();
        black_box(run());
        best = best.min(start.elapsed().as_secs_f64());
    }
    println!("{name:36} {:8.1} M/s  ({modules} modules, {:.1} ms)", modules as f64 / best / 1e6, best * 1e3);
}

fn main() {
    let mut limits = Limits::default();
    limits.set("modules", "100M").expect("a limit");
    limits.set("work", "2G").expect("a limit");
    let options = DeriveOptions::default();
    let grammars = [
        ("plain", system(9, "F --> F[+F]F[-F]F", "F", "")),
        ("weighted", system(9, "F --> F[+F]F[-F]F : 1\nF --> F[+F]F[-F]F : 2", "F", "Seed: 1")),
        ("parametric", system(9, "F(x) : x > 0 --> F(x/3)[+(30)F(x/3)]F(x/3)[-(30)F(x/3)]F(x/3)", "F(1)", "")),
        ("parametric 1.9", system(10, "F(x) --> F(x*0.3)+F(x*0.7)--F(x*0.7)+F(x*0.3)", "F(1)", "")),
        ("doubling", system(22, "F(x) : x>0 --> F(x*0.9)F(x*0.9)", "F(1)", "")),
        ("contexts", system(11, "F < F > F --> F\nF --> F[+F]F[-F]F", "F", "")),
        ("signals", system(2000, "A < B --> A\nA --> B\nC --> C[+B]", "CABBB", "")),
    ];
    osier_base::par::on_threads(1, || {
        let wanted = std::env::args().nth(1).unwrap_or_default();
        for (name, g) in grammars.iter().filter(|(name, _)| name.starts_with(&wanted)) {
            let n = derive_deferred(g, &options, &limits).expect("derives").module_count();
            time(&format!("{name}: string"), n, || derive(g, &options, &limits).expect("derives").module_count());
            time(&format!("{name}: count"), n, || {
                derive_deferred(g, &options, &limits).expect("derives").module_count()
            });
            time(&format!("{name}: text"), n, || {
                let derived = derive_text(g, &options, &limits).expect("derives");
                derived.into_text(g, &limits).expect("derives").len() as u64
            });
            time(&format!("{name}: handed over"), n, || {
                let derived = derive_deferred(g, &options, &limits).expect("derives");
                let mut sum = 0;
                interpret(g, &derived, &limits, |m| sum += u64::from(m.symbol)).expect("draws");
                sum
            });
        }
    });
}
