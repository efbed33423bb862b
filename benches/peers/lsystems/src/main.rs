//! Derives L-systems by osier and by the crates lindenmayer and dcc-lsystem and Python's `str.replace`, in turn, on one thread; prints
//! the best of five rounds in millions of symbols a second and osier's ratio to each peer.

use std::collections::BTreeMap;
use std::hint::black_box;
use std::process::Command;
use std::time::Instant;

use osier_base::{Error, diagnostic::Sources, limits::Limits};
use osier_grammar::{DeriveOptions, Grammar, GrammarSource, derive_deferred, derive_text, interpret, parse};

const ROUNDS: usize = 5;
const STEPS: usize = 10;
const RULE: &str = "F[+F]F[-F]F";

fn grammar(rules: &str, axiom: &str, items: &str) -> Grammar {
    let text = format!("Lsystem: 1\n{items}\nderivation length: {STEPS}\nAxiom: {axiom}\n{rules}\nendlsystem\n");
    let defines = BTreeMap::new();
    let mut none = |r: &str, _: &str| Err(Error::io("open", r, std::io::ErrorKind::NotFound.into()));
    let (bytes, functions) = (text.as_bytes(), Default::default());
    let source = GrammarSource { name: "peers.l", bytes, includes: &mut none, defines: &defines, functions };
    parse(&mut Sources::default(), source, &Limits::default()).expect("reads").0
}

/// A way to derive a string; returns its number of symbols.
struct Runner<'a> {
    name: &'static str,
    run: Box<dyn FnMut() -> usize + 'a>,
}

/// Runs all in turn, several rounds; the first one is osier's.
fn compare(title: &str, mut runners: Vec<Runner<'_>>) {
    let mut best = vec![f64::INFINITY; runners.len()];
    let mut symbols = vec![0; runners.len()];
    for _ in 0..ROUNDS {
        for (i, runner) in runners.iter_mut().enumerate() {
            let start = Instant::now();
            symbols[i] = black_box((runner.run)());
            best[i] = best[i].min(start.elapsed().as_secs_f64());
        }
    }
    println!("{title}");
    let speed = |i: usize| symbols[i] as f64 / best[i] / 1e6;
    for (i, runner) in runners.iter().enumerate() {
        println!("  {:32} {:9.1} M/s  {:6.2}x", runner.name, speed(i), speed(0) / speed(i));
    }
}

fn main() {
    let mut limits = Limits::default();
    limits.set("modules", "100M").expect("a limit");
    limits.set("work", "2G").expect("a limit");
    let limits = &limits;
    let options = &DeriveOptions::default();
    let text = |g: &Grammar| {
        derive_text(g, options, limits).and_then(|d| d.into_text(g, limits)).expect("derives").len()
    };
    let plain = grammar(&format!("F --> {RULE}"), "F", "");
    let weighted = grammar(&format!("F --> {RULE} : 1\nF --> {RULE} : 2"), "F", "Seed: 1");
    let parametric = grammar("F(x) : x > 0 --> F(x/3)[+(30)F(x/3)]F(x/3)[-(30)F(x/3)]F(x/3)", "F(1)", "");
    let contexts = grammar(&format!("F < F > F --> F\nF --> {RULE}\nX --> X"), "FX", "");
    osier_base::par::on_threads(1, || {
        let system = lindenmayer::LSystem::new("F".into(), &[('F', RULE)]);
        let mut tokens = {
            let mut b = dcc_lsystem::LSystemBuilder::new();
            let [f, plus, minus, open, close] = ["F", "+", "-", "[", "]"].map(|t| b.token(t));
            b.axiom(vec![f]);
            b.transformation_rule(f, vec![f, open, plus, f, close, f, open, minus, f, close, f]);
            b.finish()
        };
        compare(
            "strings without parameters",
            vec![
                Runner { name: "osier, text", run: Box::new(|| text(&plain)) },
                Runner { name: "lindenmayer 0.3, string()", run: Box::new(|| system.string(STEPS).len()) },
                Runner { name: "lindenmayer 0.3, builder()", run: Box::new(|| system.builder(STEPS).count()) },
                Runner {
                    name: "dcc-lsystem 0.6",
                    run: Box::new(|| {
                        tokens.reset();
                        tokens.step_by(STEPS);
                        tokens.get_state().len()
                    }),
                },
            ],
        );
        python(text(&plain));
        let productions = vec![(RULE, 1.0_f32), (RULE, 2.0)];
        let stochastic = lindenmayer::builder::LSystemStochastic::new("F".into(), &[('F', productions)]);
        compare(
            "two productions by weight",
            vec![
                Runner { name: "osier, text", run: Box::new(|| text(&weighted)) },
                Runner { name: "lindenmayer 0.3, string()", run: Box::new(|| stochastic.string(STEPS, Some(3)).len()) },
            ],
        );
        let counted = |g: &Grammar| derive_deferred(g, options, limits).expect("derives").module_count() as usize;
        let derived = derive_deferred(&parametric, options, limits).expect("derives");
        compare(
            "parameters and a condition",
            vec![
                Runner { name: "osier, counted", run: Box::new(|| counted(&parametric)) },
                Runner {
                    name: "osier, handed over one by one",
                    run: Box::new(|| {
                        let mut n = 0;
                        interpret(&parametric, &derived, limits, |m| n += m.params.len().min(1) + 1).expect("draws");
                        black_box(n);
                        derived.module_count() as usize
                    }),
                },
            ],
        );
        compare("contexts", vec![Runner { name: "osier, text", run: Box::new(|| text(&contexts)) }]);
    });
}

/// Times `str.replace` of Python, if there is one.
fn python(symbols: usize) {
    let code = format!(
        "import time\nbest = 9e9\nfor _ in range({ROUNDS}):\n s = 'F'\n t = time.perf_counter()\n for _ in range({STEPS}): s = s.replace('F', '{RULE}')\n best = min(best, time.perf_counter() - t)\nprint(best)"
    );
    let output = Command::new("python3").args(["-c", &code]).output();
    let seconds = output.ok().and_then(|o| String::from_utf8_lossy(&o.stdout).trim().parse::<f64>().ok());
    if let Some(seconds) = seconds {
        println!("  {:32} {:9.1} M/s", "Python, str.replace", symbols as f64 / seconds / 1e6);
    }
}
