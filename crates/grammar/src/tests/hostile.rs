//! Grammars that would run or grow without end: they are refused after an amount of work that takes less than a second. Work is
//! counted, not timed: each text is refused with the same message by limits that allow no more than a stated amount. The bench
//! `derive` of the workspace times the same texts.

use std::collections::BTreeMap;

use super::super::*;

/// A grammar, the limits that its refusal needs at most, and the beginning of the message.
struct Refusal {
    name: &'static str,
    text: String,
    limits: &'static [(&'static str, &'static str)],
    says: &'static str,
}

fn cpfg(steps: u32, axiom: &str, rules: &str) -> String {
    format!("Lsystem: 1\nderivation length: {steps}\nAxiom: {axiom}\n{rules}\nendlsystem\n")
}

/// The error of reading, deriving or interpreting a grammar.
fn refusal(text: &str, limits: &Limits) -> String {
    let defines = BTreeMap::new();
    let mut none = |r: &str, _: &str| Err(Error::io("open", r, std::io::ErrorKind::NotFound.into()));
    let bytes = text.as_bytes();
    let source =
        GrammarSource { name: "test.l", bytes, includes: &mut none, defines: &defines, functions: Default::default() };
    let run = || {
        let (grammar, _) = parse(&mut Sources::default(), source, limits)?;
        let derived = derive_deferred(&grammar, &DeriveOptions::default(), limits)?;
        interpret(&grammar, &derived, limits, |_| {})
    };
    run().expect_err("hostile").to_string()
}

fn with(changes: &[(&str, &str)]) -> Limits {
    let mut limits = Limits::default();
    for (name, value) in changes {
        limits.set(name, value).expect("a limit");
    }
    limits
}

/// Grammars of a few lines that ask for endless work.
fn refusals() -> Vec<Refusal> {
    // Forty million modules are counted in a fifth of a second, a million statements run in some milliseconds.
    const DERIVED: &[(&str, &str)] = &[("work", "40M"), ("statements", "1")];
    const STORED: &[(&str, &str)] = &[("work", "20M"), ("statements", "1")];
    const LOOP: &[(&str, &str)] = &[("statements", "3M"), ("work", "10")];
    const EXPANDED: &[(&str, &str)] = &[("statements", "900k"), ("work", "10")];
    const READ: &[(&str, &str)] = &[("macro-tokens", "100k"), ("work", "0"), ("statements", "0")];
    let macros = (1..400)
        .fold("#define M0(x) x\n".to_owned(), |text, i| text + &format!("#define M{i}(x) M{0}(x)M{0}(x)\n", i - 1));
    let refused = |name, text, limits, says| Refusal { name, text, limits, says };
    vec![
        // Refused from the growth matrix, before the first step.
        refused("doubling", cpfg(60, "F", "F --> FF"), &[("statements", "0")], "error[L050]"),
        refused(
            "condition",
            cpfg(60, "F(1)", "F(x) : x>0 --> F(x*0.9)F(x*0.9)"),
            DERIVED,
            "error[L051]: step 25 passes the limit of 20,000,000 modules",
        ),
        refused(
            "contexts",
            cpfg(60, "B A(1)", "A(x) < A(y) --> A(x)A(y)\nB < A(x) : x>0 --> A(x)A(x)"),
            STORED,
            "error[L051]",
        ),
        refused(
            "loop",
            cpfg(1, "A", "A : {while (1) {x = x+1;}} 1 --> F"),
            LOOP,
            "error[L044]: this loop does not end",
        ),
        refused(
            "loops",
            cpfg(1, "A", "A : {while (1) {while (1) {x = x+1;}}} 1 --> F"),
            LOOP,
            "error[L044]: this loop does not end",
        ),
        refused(
            "homomorphism",
            cpfg(1, "A(1)", "Homomorphism\nmaximum depth: 60\nA(x) : x>0 --> F A(x*0.9)A(x*0.9)"),
            EXPANDED,
            "error[L051]: step 1: this production expands a single module without end",
        ),
        refused(
            "decomposition",
            cpfg(1, "A", "A --> B\nDecomposition\nmaximum depth: 60\nB --> BB"),
            EXPANDED,
            "error[L051]: step 1: this production expands a single module without end",
        ),
        refused("macros", macros + &cpfg(1, "M399(F)", "F --> F"), READ, "error[L005]"),
        refused("brackets", cpfg(1, &"[".repeat(1_000_000), "F --> F"), READ, "error[L004]"),
    ]
}

#[test]
fn hostile_grammars_are_refused_after_little_work() {
    for Refusal { name, text, limits, says } in refusals() {
        let (usual, scarce) = (refusal(&text, &Limits::default()), refusal(&text, &with(limits)));
        assert!(usual.starts_with(says), "{name}: {}", &usual[..usual.len().min(400)]);
        // The message of the macros tells the limit itself.
        if name == "macros" {
            assert!(scarce.starts_with(says), "{name}: {}", &scarce[..scarce.len().min(400)]);
        } else {
            assert_eq!(usual, scarce, "{name}: refused for lack of work");
        }
    }
}

#[test]
fn a_budget_below_the_stated_one_is_the_one_that_refuses() {
    // So much is done in fact: without it, equal messages under scarce limits would say nothing.
    let text = cpfg(1, "A", "A : {while (1) {x = x+1;}} 1 --> F");
    let refused = refusal(&text, &with(&[("statements", "900k")]));
    assert!(refused.contains("budget of statements"), "{refused}");
    let text = cpfg(60, "F(1)", "F(x) : x>0 --> F(x*0.9)F(x*0.9)");
    let refused = refusal(&text, &with(&[("work", "1M")]));
    assert!(refused.contains("modules over all steps"), "{refused}");
}
