//! Exact values of the language, sentence by sentence.

use std::collections::BTreeMap;

use super::*;

mod features;
mod foreign;
mod hostile;

pub(crate) fn read(text: &str) -> (Grammar, Vec<Diagnostic>) {
    try_read(text).unwrap_or_else(|e| panic!("{e}"))
}

pub(crate) fn try_read(text: &str) -> Result<(Grammar, Vec<Diagnostic>)> {
    let mut sources = Sources::default();
    let defines = BTreeMap::new();
    let mut includes = |r: &str, _: &str| match r {
        "part.h" => Ok(("part.h".to_owned(), b"#define STEP 7\n".to_vec())),
        "self.h" => Ok(("self.h".to_owned(), b"#include \"self.h\"\n".to_vec())),
        _ => Err(Error::io("open", r, std::io::Error::from(std::io::ErrorKind::NotFound))),
    };
    let source = GrammarSource {
        name: "test.l",
        bytes: text.as_bytes(),
        includes: &mut includes,
        defines: &defines,
        functions: Default::default(),
    };
    parse(&mut sources, source, &Limits::default())
}

/// Final string of a grammar with seed 1.
fn string(text: &str) -> String {
    let (g, _) = read(text);
    let d = derive(&g, &DeriveOptions { seed: 1, ..Default::default() }, &Limits::default()).expect("derives");
    g.print(&d.modules)
}

/// Final string of axiom and productions after `n` steps.
fn steps(n: u32, axiom: &str, rules: &str) -> String {
    string(&format!("Lsystem: 1\nderivation length: {n}\nAxiom: {axiom}\n{rules}\nendlsystem\n"))
}

/// Value of an expression, through a module's parameter.
fn value(e: &str) -> String {
    steps(1, "S", &format!("S --> V({e})"))
}

#[test]
fn expressions_have_the_values_of_the_language() {
    for (e, v) in [
        ("-2^2", "4"),
        ("2^3^2", "64"),
        ("5/0", "5"),
        ("-7%4", "-3"),
        ("7.9%2.9", "1"),
        ("7%0", "0"),
        ("0^0", "1"),
        ("sqrt(-1)", "NaN"),
        ("log(0)", "-inf"),
        ("trunc(2.5)", "3"),
        ("atan(1,-1)", "135"),
        ("sin(30)", "0.5"),
        ("1/3", "0.333333"),
        ("1e-3+.5+3.", "3.501"),
        ("2+3*4", "14"),
        ("10-4-3", "3"),
        ("1<2 && 2<1 || !0", "1"),
        ("1 ? 2 : 3", "2"),
        ("0 ? 2 : 1 ? 4 : 5", "4"),
        ("1 ? 0 ? 6 : 7 : 8", "7"),
        ("3 <> 4", "1"),
        ("3 != 3", "0"),
        ("(1+2)*(3-(4-6))", "15"),
        ("-(-3)", "3"),
        ("!0 + 1", "2"),
        ("floor(-1.5)+ceil(1.2)+fabs(-3)+sign(-2)", "2"),
    ] {
        assert_eq!(value(e), format!("V({v})"), "{e}");
    }
}

#[test]
fn functions_of_companion_files_are_read_by_number_and_name() {
    let mut tables = FunctionTables::default();
    tables.add_function(1, "width", DataFunction::new(&[[0.0, 2.0], [1.0, 4.0]], 0));
    tables.add_function(2, "Ang_1", DataFunction::new(&[[0.0, 7.0], [1.0, 7.0]], 0));
    tables.add_curve(2, Spline::new(&[[0.0; 3], [3.0, 0.0, 4.0]], SplineEnds::Clamped));
    let text = "#define BEND func(Ang_1,0)\nLsystem: 1\nderivation length: 1\nAxiom: S W(9)\nS --> V(func(WIDTH,0.25)) V(func(1,7)) \
        V(curveX(2,0.5)) V(curveY(2,0.5)) V(curveZ(2,0.25)) V(curveGAL(2)) V(BEND) V(func(ANG_1,0)) V(func(width,0.25)) : 1\n\
        W(width) --> V(width)\nendlsystem";
    let (mut sources, defines, limits) = (Sources::default(), BTreeMap::new(), Limits::default());
    let mut none = |_: &str, _: &str| -> Result<(String, Vec<u8>)> { unreachable!() };
    let functions = Arc::new(tables);
    let source =
        GrammarSource { name: "t.l", bytes: text.as_bytes(), includes: &mut none, defines: &defines, functions };
    let (g, _) = parse(&mut sources, source, &limits).expect("reads");
    let d = derive(&g, &DeriveOptions::default(), &limits).expect("derives");
    // A name counts as it is written, too, unless a variable has it.
    assert_eq!(g.print(&d.modules), "V(2.5)V(4)V(1.5)V(0)V(1)V(5)V(7)V(7)V(2.5)V(9)");
    // In a block the locations of a call move after those before it.
    let (g, _) = read("Lsystem: 1\nderivation length: 1\nAxiom: A\nA : {x = 1; y = func(3,x);} --> B(y)\nendlsystem");
    let d = derive(&g, &DeriveOptions::default(), &limits).expect("derives");
    assert_eq!(g.print(&d.modules), "B(0)");
    let said = g.report(d.warnings).to_string();
    assert!(said.contains("function 3 is unknown") && said.contains(":4:17"), "{said}");
}

#[test]
fn formulas_keep_short_circuits_and_conditions_apart() {
    assert_eq!(steps(1, "A(2)", "A(x) : x>1 && (x<3 || 5/0) --> B(x?x*2:0)\n"), "B(4)");
    assert_eq!(steps(1, "A(0)", "A(x) : x>1 --> B\nA(x) : x<=1-->C"), "C");
}

#[test]
fn parameters_are_single_precision_and_variables_double() {
    assert_eq!(steps(20, "A(0,0)", "A(t,n) : t+0.1<1 --> A(t+0.1,n+1)"), "A(0.9,9)");
    assert_eq!(steps(1, "A(0.1)", "A(x) : x==0.1 --> B"), "A(0.1)");
}

#[test]
fn words_are_modules_and_blanks_mean_nothing() {
    assert_eq!(steps(0, "AXIOM F (1, 2)", ""), "AXIOMF(1,2)");
    assert_eq!(steps(1, "ABA", "A --> *\nB-->BB"), "BB");
}

#[test]
fn macros_follow_the_rules_of_c() {
    let text = "#define D 3\n#define TWICE(x) ((x)+(x))\n#define SQ(x) MUL(x,x)\n#define MUL(a,b) ((a)*(b))\n\
        Lsystem: 1\nderivation length: 1\nAxiom: S\nS --> A(D) FD B(TWICE(TWICE(D))) C(SQ(SQ(2))) \\\n E(-D)\nendlsystem";
    assert_eq!(string(text), "A(3)FDB(12)C(16)E(-3)");
    let text = "#include \"part.h\"\n#if STEP > 5 && !defined(NOPE)\n#define L 4 /* note */\n#elif 1\n#define L 5\n#else\n\
        #define L 6\n#endif\n#ifdef NOPE\n[[[[\n#else\nLsystem: 1\nderivation length: 0 // two\nAxiom: A(L,STEP,OSIER)\n\
        endlsystem\n#endif\n";
    assert_eq!(string(text), "A(4,7,1)");
    assert_eq!(steps(1, "S", "#define M -\n#define S2 > C\nS --> A MM B"), "AMMB");
    assert_eq!(steps(1, "S", "S --> #(2) F ! #\n"), "#(2)F!#");
}

#[test]
fn defines_are_known_with_comment_and_can_be_overridden() {
    let text = "/* A twig.\n * Second line. */\n#define ANGLE 30 // branching angle, degrees\n#define N (2+1)\n\
        lsystem: twig\nderivation length: N\naxiom: F(ANGLE)\nendlsystem\n";
    let (g, _) = read(text);
    assert_eq!(g.label(), "twig");
    assert_eq!(g.description(), "A twig. Second line.");
    assert_eq!(g.steps(), 3);
    let list: Vec<_> = g.defines().iter().map(|d| (d.name.as_str(), d.value.as_str(), d.comment.as_str())).collect();
    assert_eq!(list, [("ANGLE", "30", "branching angle, degrees"), ("N", "(2+1)", "")]);
    // Macros that abbreviate parts of productions are no parameters.
    let rules = "#define A 3\n#define B (A*2e1+sin(A))\n#define C n\n#define D G(A*n)\n#define E n // counts\n#define F\n#define H \"t.png\"\n\
        lsystem: 1\nderivation length: 1\naxiom: G(A)\nG(n) --> D G(C-B)\nendlsystem\n";
    let (macros, _) = read(rules);
    let all = macros.defines();
    let shown: Vec<_> = all.iter().filter(|d| d.is_parameter(all)).map(|d| d.name.as_str()).collect();
    assert_eq!(shown, ["A", "B", "E", "F", "H"]);
    let mut sources = Sources::default();
    let set = BTreeMap::from([("ANGLE".to_owned(), "45".to_owned())]);
    let mut none = |_: &str, _: &str| -> Result<(String, Vec<u8>)> { unreachable!() };
    let source = GrammarSource {
        name: "t.l",
        bytes: text.as_bytes(),
        includes: &mut none,
        defines: &set,
        functions: Default::default(),
    };
    let (g, _) = parse(&mut sources, source, &Limits::default()).expect("reads");
    let d = derive(&g, &DeriveOptions { steps: Some(0), ..Default::default() }, &Limits::default()).expect("derives");
    assert_eq!(g.print(&d.modules), "F(45)");
}

#[test]
fn blocks_run_in_their_order() {
    let rules = "Start{q=3;} StartEach{r=r+1;} EndEach{q=q*2;}\nA --> A B(q,r)";
    assert_eq!(steps(2, "A", rules), "AB(6,2)B(3,1)");
    let rules = "Start: {\n  i = 0; s = 0;\n  while (i < 5) { i = i + 1; if (i % 2 == 0) { s = s + i; } else if (i == 3) \
        { s = s + 100; } else { s = s + 1; } }\n do { s = s - 1; } while (s > 107);\n}\nA --> B(s,i)";
    assert_eq!(steps(1, "A", rules), "B(107,5)");
    let rules = "A(x) : {y = x*2;} y > 3 {z = y+1;} --> B(y,z)\nA(x) : {w=7;} --> C(w)";
    assert_eq!(steps(1, "A(2)A(1)", rules), "B(4,5)C(7)");
    assert_eq!(steps(3, "A", "A --> A(Q,Z,remaining)"), "A(1,3,2)");
}

#[test]
fn first_applicable_production_wins_without_seed() {
    assert_eq!(steps(1, "A(5)", "A(x) : x>9 --> B\nA(x) : * --> C\nA(x) --> D"), "C");
}

#[test]
fn contexts_see_past_branches_and_hidden_symbols() {
    for (axiom, rules, result) in [
        ("ABC", "A < B > C --> X", "AXC"),
        ("ABC", "A < B > A --> X", "ABC"),
        // Left: closed branches are jumped over, openings stepped over.
        ("A[C]B", "A < B --> X", "A[C]X"),
        ("A[B]", "A < B --> X", "A[X]"),
        ("A[[B]]", "A < B --> X", "A[[X]]"),
        // Right: whole branches are skipped, the end of the axis fails.
        ("A[C]B", "A > B --> X", "X[C]B"),
        ("[A]B", "A > B --> X", "[A]B"),
        // A pattern '[' needs a branch right here.
        ("A[B][C]", "A > [C] --> X", "A[B][C]"),
        ("A[B][C]", "A > [B][C] --> X", "X[B][C]"),
        ("A[C]D", "A > [C]D --> X", "X[C]D"),
        ("A[CE]D", "A > [C]D --> X", "A[CE]D"),
        ("A[C[E]]D", "A > [C]D --> X", "X[C[E]]D"),
        ("A[CE]D", "A > [C=]D --> X", "X[CE]D"),
        ("A[CE]D", "A > [C --> X", "X[CE]D"),
        ("A(1)B(2)C(3)", "A(x) < B(y) > C(z) --> B(x+y+z)", "A(1)B(6)C(3)"),
        ("A(1)B", "A < B --> X", "A(1)B"),
        ("A+B", "Ignore: + -\nA < B --> X", "A+X"),
        ("A+B", "A < B --> X", "A+B"),
        ("A+FB", "Consider: AB\nA < B --> X", "A+FX"),
        // An ignored '[' is passed, so that the context enters the branch instead of skipping it.
        ("A+[B]C", "Ignore: +[\nA > B --> X", "X+[B]C"),
        ("A+[B]C", "Ignore: +[\nA > C --> X", "A+[B]C"),
        ("A[BD][C]", "Ignore: [\nA > B=]C --> X", "X[BD][C]"),
        // The predecessor is literal.
        ("Y+Z", "Ignore: +\nY+Z --> X", "X"),
        ("Y+Z", "Ignore: +\nYZ --> X", "Y+Z"),
        ("* < A", "", ""),
    ] {
        if axiom.starts_with('*') {
            continue;
        }
        assert_eq!(steps(1, axiom, rules), result, "{axiom} | {rules}");
    }
}

#[test]
fn signals_travel_one_module_per_step() {
    let rules = "A < B --> A\nA --> B";
    assert_eq!(steps(1, "ABBB", rules), "BABB");
    assert_eq!(steps(3, "ABBB", rules), "BBBA");
    assert_eq!(steps(2, "AB[BB]B", "A < B --> A"), "AA[AB]A");
}

#[test]
fn cut_removes_the_rest_of_its_branch() {
    assert_eq!(steps(1, "A[+F%F[F]F]F%F", ""), "A[+F]F");
    assert_eq!(steps(1, "A", "A --> F%G"), "F%G");
    assert_eq!(steps(2, "A", "A --> F%G"), "F");
}

#[test]
fn decomposition_and_depth() {
    let rules = "A --> BA\nDecomposition\nmaximum depth: 3\nB --> CC\nC --> D";
    assert_eq!(steps(1, "A", rules), "DDA");
    let rules = "A --> BA\nDecomposition\nB --> CC\nC --> D";
    assert_eq!(steps(1, "AB", rules), "CCACC", "B of the axiom is copied and decomposed");
}

#[test]
fn homomorphism_is_seen_by_the_interpreter_only() {
    let (g, _) = read(
        "Lsystem: 1\nderivation length: 1\nAxiom: A(1)\nA(x) --> A(x+1)B\nHomomorphism\nmaximum depth: 2\n\
         A(x) --> F(x)G\nG --> [f]\nendlsystem",
    );
    let d = derive(&g, &DeriveOptions::default(), &Limits::default()).expect("derives");
    assert_eq!(g.print(&d.modules), "A(2)B");
    let mut drawn = String::new();
    interpret(&g, &d, &Limits::default(), |m| drawn.push(g.symbols().get(m.symbol))).expect("draws");
    assert_eq!(drawn, "F[f]B");
}

#[test]
fn textbook_plants_have_their_lengths() {
    let figure = [
        ("F", "F --> F[+F]F[-F]F", 5, 3125, 7811),
        ("F", "F --> F[+F]F[-F][F]", 5, 3125, 9373),
        ("F", "F --> FF-[-F+F+F]+[+F-F-F]", 4, 4096, 11116),
        ("X", "X --> F[+X]F[-X]+X\nF --> FF", 7, 4118, 13956),
        ("X", "X --> F[+X][-X]FX\nF --> FF", 7, 4118, 12863),
        ("X", "X --> F-[[X]+X]+F[+FX]-X\nF --> FF", 5, 1488, 6263),
    ];
    for (axiom, rules, n, f, length) in figure {
        let text = format!("Lsystem: 1\nderivation length: {n}\nAxiom: {axiom}\n{rules}\nendlsystem");
        let (g, _) = read(&text);
        let p = predict(&g, n, false);
        assert_eq!((p.lower, p.upper), (length, length), "{rules}");
        let d = derive(&g, &DeriveOptions::default(), &Limits::default()).expect("derives");
        assert_eq!(d.modules.len() as u128, length);
        let id = g.symbols().find('F').expect("F");
        assert_eq!(d.modules.symbols().iter().filter(|s| **s == id).count(), f, "{rules}");
    }
}

/// Counts of `F` and of all modules by the formulas of the textbook figure.
struct FigureCounts {
    axiom: &'static str,
    rules: &'static str,
    steps: u32,
    /// `F` after n steps, from powers p^n.
    f: fn(u32) -> u128,
    /// Other modules after n steps.
    rest: fn(u32) -> u128,
}

#[test]
fn textbook_plants_have_their_lengths_at_every_step() {
    let p = |b: u128, n: u32| b.pow(n);
    let figures = [
        FigureCounts {
            axiom: "F",
            rules: "F --> F[+F]F[-F]F",
            steps: 5,
            f: |n| 5_u128.pow(n),
            rest: |n| 6 * (5_u128.pow(n) - 1) / 4,
        },
        FigureCounts {
            axiom: "F",
            rules: "F --> F[+F]F[-F][F]",
            steps: 5,
            f: |n| 5_u128.pow(n),
            rest: |n| 8 * (5_u128.pow(n) - 1) / 4,
        },
        FigureCounts {
            axiom: "F",
            rules: "F --> FF-[-F+F+F]+[+F-F-F]",
            steps: 4,
            f: |n| 8_u128.pow(n),
            rest: |n| 12 * (8_u128.pow(n) - 1) / 7,
        },
        FigureCounts {
            axiom: "X",
            rules: "X --> F[+X]F[-X]+X\nF --> FF",
            steps: 7,
            f: |n| 2 * (3_u128.pow(n) - 2_u128.pow(n)),
            rest: |n| 3_u128.pow(n) + 7 * (3_u128.pow(n) - 1) / 2,
        },
        FigureCounts {
            axiom: "X",
            rules: "X --> F[+X][-X]FX\nF --> FF",
            steps: 7,
            f: |n| 2 * (3_u128.pow(n) - 2_u128.pow(n)),
            rest: |n| 3_u128.pow(n) + 6 * (3_u128.pow(n) - 1) / 2,
        },
        FigureCounts {
            axiom: "X",
            rules: "X --> F-[[X]+X]+F[+FX]-X\nF --> FF",
            steps: 5,
            f: |n| 3 * (4_u128.pow(n) - 2_u128.pow(n)) / 2,
            rest: |n| 4_u128.pow(n) + 11 * (4_u128.pow(n) - 1) / 3,
        },
        // The Koch curve: four segments and four turns for each segment.
        FigureCounts {
            axiom: "F(1)",
            rules: "F(d) --> F(d/3)+F(d/3)--F(d/3)+F(d/3)",
            steps: 6,
            f: |n| 4_u128.pow(n),
            rest: |n| 4 * (4_u128.pow(n) - 1) / 3,
        },
    ];
    assert_eq!((p(5, 5), (figures[3].f)(7), (figures[5].rest)(5)), (3125, 4118, 6263 - 1488));
    for FigureCounts { axiom, rules, steps, f, rest } in figures {
        let (g, _) = read(&format!("Lsystem: 1\nderivation length: {steps}\nAxiom: {axiom}\n{rules}\nendlsystem"));
        let id = g.symbols().find('F').expect("F");
        for n in 0..=steps {
            let wanted = f(n) + rest(n);
            let predicted = predict(&g, n, false);
            assert_eq!((predicted.lower, predicted.upper), (wanted, wanted), "{rules}, {n}");
            let options = DeriveOptions { steps: Some(n), ..Default::default() };
            let d = derive(&g, &options, &Limits::default()).expect("derives");
            let count = d.modules.symbols().iter().filter(|s| **s == id).count();
            assert_eq!((count as u128, d.modules.len() as u128), (f(n), wanted), "{rules}, {n}");
        }
    }
}

#[test]
fn a_printed_string_is_read_as_it_was_printed() {
    let rules = "A(x) --> F(x/3)[+(30)&(-1e-9)A(x*1e7)]~l(ran(1),2)@Ts(1,0.5)B;(3)'!A(x/7)";
    let text = format!("Lsystem: 1\nderivation length: 4\nAxiom: A(1)\n{rules}\nendlsystem\n");
    let printed = string(&text);
    assert!(printed.len() > 500 && printed.contains("F(0.333333)"), "{printed}");
    assert_eq!(steps(0, &printed, ""), printed);
}

#[test]
fn too_long_derivations_are_refused_before_they_start() {
    let text = "Lsystem: 1\nderivation length: 13\nAxiom: F\nF --> F[+F]F[-F]F\nendlsystem";
    let (g, _) = read(text);
    let e = derive(&g, &DeriveOptions::default(), &Limits::default()).expect_err("too long").to_string();
    assert!(e.contains("step 13 would make 3,051,757,811 modules; --max-modules 20000000 allows 9"), "{e}");
    let (g, _) = read("Lsystem: 1\nderivation length: 60\nAxiom: F\nF --> FF\nendlsystem");
    assert!(derive(&g, &DeriveOptions::default(), &Limits::default()).is_err());
    // Unpredictable growth is met while deriving.
    let (g, _) = read("Lsystem: 1\nderivation length: 90\nAxiom: F(1)\nF(x) : x>0 --> F(x)F(x)\nendlsystem");
    let mut limits = Limits::default();
    limits.set("modules", "1000").expect("sets");
    let e = derive(&g, &DeriveOptions::default(), &limits).expect_err("too long").to_string();
    assert!(e.contains("L051") && e.contains("step 10"), "{e}");
    let (g, _) = read(
        "Lsystem: 1\nderivation length: 1\nAxiom: F\nF --> F\nDecomposition\nmaximum depth: 99\nF --> FF\nendlsystem",
    );
    assert!(derive(&g, &DeriveOptions::default(), &limits).is_err());
}

#[test]
fn refused_derivations_are_told_with_their_numbers() {
    let refused = |length: u32, axiom: &str, rules: &str, modules: u64| {
        let (g, _) = read(&format!("Lsystem: 1\nderivation length: {length}\nAxiom: {axiom}\n{rules}\nendlsystem"));
        let mut limits = Limits::default();
        limits.set("modules", &modules.to_string()).expect("a limit");
        derive(&g, &DeriveOptions::default(), &limits).expect_err("too long").to_string()
    };
    // 1 + 3 n modules after n steps, the last of many.
    let e = refused(50_000, "A", "A --> AFFF", 100_000);
    assert!(e.contains("step 50000 would make 150,001 modules; --max-modules 100000 allows 33333"), "{e}");
    // Six modules after step 1, none after step 2.
    let e = refused(2, "A", "A --> BBBBBB\nB --> *", 5);
    assert!(e.contains("step 1 would make 6 modules; --max-modules 5 allows 0"), "{e}");
    // A length of the options is not that of the file, which is not underlined; the production is.
    let (g, _) = read("Lsystem: 1\nderivation length: 1\nAxiom: F\nF --> FF\nendlsystem");
    let asked = DeriveOptions { steps: Some(60), ..Default::default() };
    let e = derive(&g, &asked, &Limits::default()).expect_err("too long").to_string();
    assert!(e.contains("set --steps (or the key 'steps') to 24 or less") && !e.contains(":2:1"), "{e}");
    assert!(e.contains(":4:1") && e.contains("makes most of them"), "{e}");
    // No derivation length is short enough for the axiom.
    let e = refused(1, "AAAAAA", "A --> BB", 5);
    assert!(e.contains("the axiom has 6 modules") && !e.contains("derivation length to"), "{e}");
    assert!(!e.contains("this production"), "{e}");
}

#[test]
fn iterations_of_loops_are_limited_whatever_stands_in_them() {
    let text = |turns: u32| {
        format!(
            "Lsystem: 1\nderivation length: 1\nAxiom: A\nStart: {{ i = 0; while (i < {turns}) {{ i = i+1; a = i; b = a; \
             if (b > a) {{ c = 1; }} }} }}\nA --> F(b)\nendlsystem\n"
        )
    };
    // A million iterations of five statements each.
    assert_eq!(string(&text(1_000_000)), "F(1e+06)");
    let (g, _) = read(&text(1_000_002));
    let e = derive(&g, &DeriveOptions::default(), &Limits::default()).expect_err("too many").to_string();
    assert!(e.contains("L044") && e.contains("test.l:4:17"), "{e}");
}

#[test]
fn weights_choose_in_proportion_and_every_draw_has_its_address() {
    let rules = "A --> B : 1\nA --> C : 3";
    let axiom = "A".repeat(20_000);
    let text = format!("Lsystem: 1\nSeed: 7\nderivation length: 1\nAxiom: {axiom}\n{rules}\nendlsystem");
    let s = string(&text);
    let b = s.chars().filter(|c| *c == 'B').count() as f64;
    // Four standard deviations of a binomial with n = 20000, p = 1/4.
    assert!((b - 5000.0).abs() < 245.0, "{b}");
    assert_eq!(s, string(&text));
    assert_ne!(s, string(&text.replace("Seed: 7", "Seed: 8")));
}

#[test]
fn choose_keeps_its_shares() {
    let axiom = "A".repeat(20_000);
    let rules = "A --> A(choose(1,0.4, 2,0.4, 3,0.2))";
    let s = steps(1, &axiom, rules);
    let share = |c: char| s.chars().filter(|x| *x == c).count() as f64;
    let counts = [share('1'), share('2'), share('3')];
    let expected = [8000.0, 8000.0, 4000.0];
    let chi: f64 = counts.iter().zip(expected).map(|(c, e)| (c - e) * (c - e) / e).fold(0.0, |s, x| s + x);
    assert!(chi < 13.8, "2 degrees of freedom, p = 0.001: {counts:?}");
}

#[test]
fn editing_one_branch_leaves_the_draws_of_others() {
    let grammar = |turn: &str| {
        let rules = format!("A(n) : n>0 --> F(ran(1)) [{turn}B(n-1)] A(n-1)\nB(n) : n>0 --> G(ran(1)) B(n-1)");
        let text = format!("Lsystem: 1\nSeed: 3\nderivation length: 8\nAxiom: A(7)\n{rules}\nendlsystem");
        let (g, _) = read(&text);
        let d = derive(&g, &DeriveOptions { seed: 5, ..Default::default() }, &Limits::default()).expect("derives");
        let keep = |m: &Module<'_>| matches!(g.symbols().get(m.symbol), 'F' | 'G' | 'A' | 'B');
        d.modules
            .iter()
            .filter(keep)
            .map(|m| (g.symbols().get(m.symbol), m.lineage(), m.params.to_vec()))
            .collect::<Vec<_>>()
    };
    let plain = grammar("");
    assert!(plain.len() > 30);
    assert_eq!(plain, grammar("+(30);"));
    let mut lineages: Vec<u64> = plain.iter().map(|m| m.1).collect();
    lineages.sort_unstable();
    lineages.dedup();
    assert_eq!(lineages.len(), plain.len(), "lineages are unique");
}

#[test]
fn any_number_of_threads_derives_the_same_string() {
    let text = "Lsystem: 1\nSeed: 3\nderivation length: 11\nAxiom: X(1)\nX(s) --> F(s*ran(2))[+X(s/2)]F[-X(s)]+X(s) : 2\n\
        X(s) --> F[X(s)]X(nran(1,0.1)) : 1\nF(s) < X(t) --> X(s+t) : 1\nF(s) --> F(s)F(s/2)\nendlsystem";
    let (g, _) = read(text);
    let run = |threads: usize| {
        osier_base::par::on_threads(threads, || {
            derive(&g, &DeriveOptions { seed: 9, ..Default::default() }, &Limits::default()).expect("derives")
        })
    };
    let one = run(1);
    assert!(one.modules.len() > 150_000, "several blocks: {}", one.modules.len());
    for threads in [2, 5] {
        assert!(run(threads).modules == one.modules, "{threads} threads");
    }
}

#[test]
fn any_number_of_threads_passes_the_same_budget_of_statements() {
    // One statement for each of 140,000 modules, of which no block of 65,536 passes the budget.
    let axiom = "F(1)".repeat(140_000);
    let text =
        format!("Lsystem: 1\nderivation length: 1\nAxiom: {axiom}\nF(x) > F(y) : {{a=x;}} a>0 --> F(a)\nendlsystem");
    let (g, _) = read(&text);
    let run = |threads: usize, statements: &str| {
        let mut limits = Limits::default();
        limits.set("statements", statements).expect("a limit");
        let derived = osier_base::par::on_threads(threads, || derive(&g, &DeriveOptions::default(), &limits));
        derived.map(|d| d.modules.len()).map_err(|e| e.to_string())
    };
    for threads in [1, 2, 5] {
        let why = run(threads, "100000").expect_err("too many statements");
        assert!(why.contains("L051") && why.contains("step 1 passes the budget of statements"), "{threads}: {why}");
        assert_eq!(run(threads, "140000"), Ok(140_000), "{threads} threads");
    }
}

#[test]
fn a_production_may_have_more_variables_than_registers() {
    let formals: Vec<String> = (0..200).map(|i| format!("p{i}")).collect();
    let values: Vec<String> = (0..200).map(|i| i.to_string()).collect();
    let rules = format!("A({}) : p199 == 199 --> B(p150, p3+p199, p199)", formals.join(","));
    assert_eq!(steps(1, &format!("A({})", values.join(",")), &rules), "B(150,202,199)");
}
