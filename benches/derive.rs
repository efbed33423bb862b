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
    try_read(text).expect("reads")
}

fn try_read(text: &str) -> osier::Result<Grammar> {
    let defines = BTreeMap::new();
    let mut none = |r: &str, _: &str| Err(osier::Error::io("open", r, std::io::ErrorKind::NotFound.into()));
    let source = GrammarSource {
        name: "bench.l",
        bytes: text.as_bytes(),
        includes: &mut none,
        defines: &defines,
        functions: Default::default(),
    };
    Ok(parse(&mut Sources::default(), source, &Limits::default())?.0)
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

/// Grammars that ask for endless work, until they are refused: at most 1 s each. `hostile_grammars_are_refused_after_little_work`
/// of the grammar crate counts their work.
fn hostile(c: &mut Criterion) {
    let limits = Limits::default();
    let cpfg = |steps: u32, axiom: &str, rules: &str| {
        format!("Lsystem: 1\nderivation length: {steps}\nAxiom: {axiom}\n{rules}\nendlsystem\n")
    };
    let macros = (1..400)
        .fold("#define M0(x) x\n".to_owned(), |text, i| text + &format!("#define M{i}(x) M{0}(x)M{0}(x)\n", i - 1));
    let mut group = c.benchmark_group("hostile");
    group.sample_size(10);
    for (name, text) in [
        ("doubling", cpfg(60, "F", "F --> FF")),
        ("condition", cpfg(60, "F(1)", "F(x) : x>0 --> F(x*0.9)F(x*0.9)")),
        ("contexts", cpfg(60, "B A(1)", "A(x) < A(y) --> A(x)A(y)\nB < A(x) : x>0 --> A(x)A(x)")),
        ("loop", cpfg(1, "A", "A : {while (1) {x = x+1;}} 1 --> F")),
        ("draws", cpfg(1, "A", "A : {i=0; while (i<999999) {x=biran(1000000,0.5); i=i+1;}} 1 --> F")),
        ("decomposition", cpfg(1, "A", "A --> B\nDecomposition\nmaximum depth: 60\nB --> BB")),
        ("macros", macros + &cpfg(1, "M399(F)", "F --> F")),
        ("brackets", cpfg(1, &"[".repeat(1_000_000), "F --> F")),
    ] {
        let refused =
            || try_read(&text).and_then(|g| derive(&g, &DeriveOptions::default(), &limits)).expect_err("hostile");
        group.bench_function(name, |b| b.iter(refused));
    }
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

criterion_group!(benches, derivation, drawing, hostile, catkins);
criterion_main!(benches);
