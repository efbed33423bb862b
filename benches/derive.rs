//! Reading, deriving and drawing grammars.
#![allow(missing_docs, clippy::expect_used, reason = "a bench is no library")]

use std::collections::BTreeMap;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use osier::bake::BakeContext;
use osier::bake::assets::catkin::{CatkinLods, catkin_models};
use osier::diagnostic::Sources;
use osier::grammar::{DeriveOptions, Grammar, GrammarSource, derive, parse};
use osier::grow::turtle::{TurtleOptions, grow};
use osier::limits::Limits;
use osier::progress::{Cancel, Silent};
use osier::recipe::KeyTable as _;
use osier::recipe::scene::CatkinKeys;

fn read(text: &str) -> Grammar {
    let defines = BTreeMap::new();
    let mut none = |r: &str, _: &str| Err(osier::Error::io("open", r, std::io::ErrorKind::NotFound.into()));
    let source = GrammarSource {
        name: "bench.l",
        bytes: text.as_bytes(),
        includes: &mut none,
        defines: &defines,
        functions: Default::default(),
    };
    parse(&mut Sources::default(), source, &Limits::default()).expect("reads").0
}

fn system(n: u32, rules: &str, axiom: &str, seed: &str) -> Grammar {
    read(&format!("Lsystem: 1\n{seed}\nderivation length: {n}\nAxiom: {axiom}\n{rules}\nendlsystem\n"))
}

fn derivation(c: &mut Criterion) {
    let limits = Limits::default();
    let options = DeriveOptions::default();
    let mut group = c.benchmark_group("derive");
    group.sample_size(10);
    for (name, g) in [
        ("plain", system(9, "F --> F[+F]F[-F]F", "F", "")),
        ("weighted", system(9, "F --> F[+F]F[-F]F : 1\nF --> F[+F]F[-F]F : 2", "F", "Seed: 1")),
        ("parametric", system(9, "F(x) : x > 0 --> F(x/3)[+(30)F(x/3)]F(x/3)[-(30)F(x/3)]F(x/3)", "F(1)", "")),
        ("contexts", system(9, "F < F > F --> F\nF --> F[+F]F[-F]F", "F", "")),
    ] {
        let n = derive(&g, &options, &limits).expect("derives").modules.len();
        group.throughput(Throughput::Elements(n as u64));
        group.bench_function(name, |b| b.iter(|| derive(&g, &options, &limits).expect("derives").modules.len()));
    }
    group.finish();
}

fn drawing(c: &mut Criterion) {
    let limits = Limits::default();
    let g = system(7, "F(x) --> F(x/3)[+(30)F(x/3)]F(x/3)[-(30)F(x/3)]F(x/3)", "F(1)", "");
    let d = derive(&g, &DeriveOptions::default(), &limits).expect("derives");
    let mut group = c.benchmark_group("turtle");
    group.sample_size(10);
    group.throughput(Throughput::Elements(d.modules.len() as u64));
    let options = TurtleOptions::default();
    group.bench_function("tree", |b| b.iter(|| grow(&g, &d, &options, &limits).expect("draws").0.nodes.len()));
    group.finish();
}

/// Five tufts of hair from text to curves: at most 5 ms (table 4 of [catkin]: 15 s).
fn catkins(c: &mut Criterion) {
    let (limits, cancel) = (Limits::default(), Cancel::default());
    let work = BakeContext { limits: &limits, cancel: &cancel, progress: &Silent, cache: None };
    let keys = CatkinKeys::defaults();
    c.bench_function("catkins/five", |b| {
        b.iter(|| {
            let models = catkin_models(&keys, 1, &work).expect("grows");
            models.iter().map(|m| m.prototype(&CatkinLods::from_keys(&keys), 0)).collect::<Vec<_>>()
        });
    });
}

criterion_group!(benches, derivation, drawing, catkins);
criterion_main!(benches);
