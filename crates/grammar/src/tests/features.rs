//! Arrays, rings, predecessors of several modules, and what the preprocessor accepts.

use super::*;

#[test]
fn arrays_are_read_and_written_by_index() {
    // a = 1 2 3 / 4 5 6: a[1,0] = 4, a[0][2] = 3; indices are cut: 1.9 is 1.
    let define = "Define: { array a[2,3] = {1,2,3, {4,5,6}}; array b[4], c[2]; }\n";
    let rules = format!("{define}S --> V(a[1,0],a[0][2],a[1.9,-0.5],b[3])");
    assert_eq!(steps(1, "S", &rules), "V(4,3,4,0)");
    let rules = format!(
        "{define}Start: {{ i = 0; while (i < 4) {{ b[i] = i*i; i = i+1; }} a[1][2] = b[3] + a[0,1]; c[1] = a[1,2]; }}\n\
         S(x) --> V(b[x], a[1,b[1]+1], c[1]*(b[2]-a[0,0]))"
    );
    // b = 0 1 4 9, a[1][2] = 9 + 2 = 11, c[1] = 11; (4 - 1) * 11 = 33.
    assert_eq!(steps(1, "S(2)", &rules), "V(4,11,33)");
    // Productions write from left to right; the string sees each write at once.
    let rules = format!("{define}A : {{ b[0] = b[0] + 1; }} b[0] < 3 --> B(b[0])");
    assert_eq!(steps(1, "AAAA", &rules), "B(1)B(2)AA");
}

#[test]
fn outside_an_array_reads_are_0_and_writes_are_lost() {
    let (g, _) = read(
        "Lsystem: 1\nDefine: { array a[2] = {5, 6}; array b[1] = {7}; }\nStart: { a[2] = 9; a[-1] = 9; }\n\
         derivation length: 1\nAxiom: S\nS --> V(a[2],a[-1],a[0],a[1],b[0])\nendlsystem",
    );
    let d = derive(&g, &DeriveOptions::default(), &Limits::default()).expect("derives");
    assert_eq!(g.print(&d.modules), "V(0,0,5,6,7)");
    let places: Vec<&str> = d.warnings.iter().map(|w| w.code).collect();
    assert_eq!(places, ["L026"; 4]);
    assert!(g.report(d.warnings).to_string().contains("index outside array 'a'"));
}

#[test]
fn faults_of_arrays_are_told() {
    let fault = |define: &str, rule: &str| {
        let text = format!("Lsystem: 1\n{define}\nderivation length: 1\nAxiom: A\n{rule}\nendlsystem\n");
        try_read(&text).err().map_or_else(String::new, |e| e.to_string())
    };
    let one = "Define: { array a[2,3]; }";
    for (define, rule, wanted) in [
        (one, "A --> B(a[1])", "array 'a' takes 2 indices, got 1"),
        (one, "A --> B(a[1,2,0])", "array 'a' takes 2 indices, got 3"),
        (one, "A --> B(a[1,2)", "expected ']'"),
        (one, "A : {a[1] = 3;} --> B", "array 'a' takes 2 indices, got 1"),
        (one, "A : {x[1] = 3;} --> B", "'x' is no array"),
        ("Define: { array a[2] = {1,2,3}; }", "", "array 'a' has 2 elements"),
        ("Define: { array a[0]; }", "", "a size of an array"),
        ("Define: { array a; }", "", "expected '['"),
        ("Define: { array a[2] }", "", "expected ';'"),
        ("Define: { x = 3; }", "", "expected 'array NAME[SIZE];'"),
        ("Define: { array a[2]; array a[3]; }", "", "'a' is defined twice"),
        ("Define: { array a[300,300]; }", "", "more than 65535 elements"),
    ] {
        let said = fault(define, rule);
        assert!(said.contains(wanted), "{define} {rule}: {said}");
    }
}

#[test]
fn contexts_of_a_ring_see_across_its_ends() {
    let ring = |header: &str, axiom: &str, rules: &str| {
        string(&format!("{header}\nderivation length: 1\nAxiom: {axiom}\n{rules}\nendlsystem\n"))
    };
    for header in ["ring Lsystem: 1", "Lsystem: 1\nring Lsystem", "ring\nLsystem: 1", "Ring Lsystem"] {
        assert_eq!(ring(header, "ABC", "C < A > B --> X"), "XBC", "{header}");
        assert_eq!(ring(header, "ABC", "B < C > A --> X"), "ABX", "{header}");
    }
    assert_eq!(steps(1, "ABC", "C < A --> X\nC > A --> Y"), "ABC", "without a ring");
    // Once around, to the module itself and no further.
    assert_eq!(ring("ring Lsystem", "A", "A < A > A --> X"), "X");
    assert_eq!(ring("ring Lsystem", "A", "AA < A --> X"), "A");
    assert_eq!(ring("ring Lsystem", "AB", "B > AB --> X\nB > ABA --> Y"), "AX");
    // Branches are skipped across the seam, too; ignored symbols as well.
    assert_eq!(ring("ring Lsystem", "[Q]ABC[D]", "C < A --> X\nC > A --> Y"), "[Q]XBY[D]");
    assert_eq!(ring("ring Lsystem", "A+B-", "Ignore: +-\nB < A --> X"), "X+B-");
    // The signal of one cell goes round.
    let text = "ring Lsystem\nderivation length: 4\nAxiom: A B B B\nA < B --> A\nA --> B\nendlsystem";
    assert_eq!(string(text), "ABBB");
}

#[test]
fn decomposition_and_homomorphism_take_several_modules() {
    // AB in the string, then XY in the successor of A: both are one predecessor.
    let rules = "S --> ABC\nDecomposition\nmaximum depth: 2\nAB --> XYZ\nXY --> W";
    assert_eq!(steps(1, "S", rules), "WZC");
    // At depth 1 XY stays; BA is no predecessor.
    assert_eq!(steps(1, "S", "S --> ABBA\nDecomposition\nAB --> XY\nXY --> W"), "XYBA");
    // Parameters of all modules; a successor's last module does not take the string's next one.
    let rules = "S --> A(1)B(2)B(5)\nDecomposition\nmaximum depth: 3\nA(x)B(y) --> C(x+y)A(9)\nA(x) --> D(x)";
    assert_eq!(steps(1, "S", rules), "C(3)D(9)B(5)");
    let (g, _) = read(
        "Lsystem: 1\nderivation length: 0\nAxiom: ABA\nHomomorphism\nmaximum depth: 2\nAB > A --> FG\nFG --> H\nendlsystem",
    );
    let d = derive(&g, &DeriveOptions::default(), &Limits::default()).expect("derives");
    let mut drawn = String::new();
    interpret(&g, &d, &Limits::default(), |m| drawn.push(g.symbols().get(m.symbol))).expect("draws");
    assert_eq!(drawn, "HA");
}

#[test]
fn an_axiom_module_that_is_copied_is_decomposed_in_its_step() {
    // cpfg: X(3) is first decomposed in step 1.
    let rules = "A --> B\nDecomposition\nX(n) : n>1 --> X(n-1)B\nX(n) : n==1 --> A";
    assert_eq!(steps(1, "X(3)", rules), "X(2)B");
    assert_eq!(steps(3, "X(3)", rules), "ABB");
    assert_eq!(steps(4, "X(3)", rules), "BBB");
}

#[test]
fn expressions_alone_are_statements_without_effect() {
    let (g, said) = read(
        "Lsystem: 1\nderivation length: 1\nAxiom: A(3)\nA(x) : {x; x == 4; (x+1); 7; y = x;} --> B(y)\nendlsystem",
    );
    assert_eq!(said.iter().map(|d| d.code).collect::<Vec<_>>(), ["L008"; 4]);
    let d = derive(&g, &DeriveOptions::default(), &Limits::default()).expect("derives");
    assert_eq!(g.print(&d.modules), "B(3)");
}

#[test]
fn two_hash_signs_join_words() {
    let text = "#define JOIN(a,b) a ## b\n#define N1 5\n#define X N\n#define V(n) JOIN(N,n)\n\
        Lsystem: 1\nderivation length: 1\nAxiom: S\nS --> A(JOIN(N,1),V(1),JOIN(1,2)) JOIN(X,1) ##F\nendlsystem";
    // X beside ## stays as it is written: X1.
    assert_eq!(string(text), "A(5,5,12)X1##F");
}

#[test]
fn a_pragma_makes_two_slashes_two_symbols() {
    let text = "#pragma osier comments block\nLsystem: 1\nderivation length: 1\nAxiom: S\nS --> F//[A] /* said */ B\nendlsystem";
    assert_eq!(string(text), "F//[A]B");
    assert_eq!(string(&text.replace("block", "lines")), "F");
}

#[test]
fn a_doubled_backslash_continues_a_directive() {
    let text = "#define BODY A \\\\\nB \\\r\nC\nLsystem: 1\nderivation length: 1\nAxiom: S\nS --> BODY\n\nendlsystem";
    assert_eq!(string(text), "ABC");
}

#[test]
fn lines_that_end_in_a_lone_cr_are_counted() {
    let e =
        try_read("Lsystem: 1\rderivation length: 1\rAxiom: A\rA --> B(sinn(1))\rendlsystem\r").expect_err("unknown");
    assert!(e.to_string().contains("test.l:4:9"), "{e}");
}

#[test]
fn utf_16_is_told_once() {
    let text = "Lsystem: 1\nderivation length: 1\nAxiom: A\nendlsystem\n";
    let units = |swap: bool, mark: bool| -> Vec<u8> {
        let all = mark.then_some(0xfeff_u16).into_iter().chain(text.encode_utf16());
        all.flat_map(|u| if swap { u.to_be_bytes() } else { u.to_le_bytes() }).collect()
    };
    for (swap, mark) in [(false, true), (true, true), (false, false), (true, false)] {
        let (mut sources, defines) = (Sources::default(), BTreeMap::new());
        let mut none = |_: &str, _: &str| -> Result<(String, Vec<u8>)> { unreachable!() };
        let bytes = &units(swap, mark);
        let source =
            GrammarSource { name: "u.l", bytes, includes: &mut none, defines: &defines, functions: Default::default() };
        let Err(Error::Input(report)) = parse(&mut sources, source, &Limits::default()) else {
            panic!("it is refused")
        };
        assert_eq!(report.diagnostics.len(), 1, "{report}");
        assert!(report.to_string().contains("UTF-16") && report.to_string().contains("iconv"), "{report}");
    }
}

#[test]
fn a_step_that_changes_a_global_alone_is_not_the_last() {
    // The block runs even where its condition fails, and counts the steps; the production applies in the third.
    assert_eq!(steps(5, "A", "Start: { n = 0; }\nA : { n = n+1; } n >= 3 --> B(n)"), "B(3)");
}

#[test]
fn other_l_systems_of_the_file_rewrite_what_stands_between_their_borders() {
    let sub = |n: u32, axiom: &str, main: &str, second: &str| {
        string(&format!(
            "Lsystem: 1\nderivation length: {n}\nAxiom: {axiom}\n{main}\nendlsystem\n\
             Lsystem: 2\nderivation length: 7\nAxiom: Q\n{second}\nendlsystem\n\
             Lsystem: 3\nderivation length: 1\nAxiom: Q\nA --> D\nendlsystem\n"
        ))
    };
    // Outside A --> AB; inside A --> C, C --> CC, and B has no production.
    let (main, second) = ("A --> AB", "A --> C\nC --> CC");
    assert_eq!(sub(2, "A?(2,0.5)AB$A", main, second), "ABB?(2,0.5)CCB$ABB");
    // They nest; a label that no L-system has changes nothing.
    assert_eq!(sub(1, "?(2)A?(3)A$A$A", main, second), "?(2)C?(3)D$C$AB");
    assert_eq!(sub(1, "?(9)A$", main, second), "?(9)AB$");
    // Borders end contexts; inside, the second L-system's own symbols are ignored.
    let (main, second) = ("A < B --> X", "Ignore: +\nA < B --> Y");
    assert_eq!(sub(1, "A?(2)B A+B$B", main, second), "A?(2)BA+Y$B");
    // A query is no border; without a turtle that answers it keeps its values.
    let (main, second) = ("A > ?P(x,y) : y < 1 --> F(0.6)A\n?P(x,y) : y > 9 --> *", "A --> C");
    assert_eq!(sub(4, "A?P(0,0)?(2)A$", main, second), "F(0.6)F(0.6)F(0.6)F(0.6)A?P(0,0)?(2)C$");
    // Decomposition is that of the L-system around; variables are shared, blocks of both run.
    let (main, second) =
        ("Start: { n = 2; }\nA --> B(n)\nDecomposition\nB(x) --> E(x)", "Start: { n = n*5; }\nA --> B(n)");
    assert_eq!(sub(1, "A?(2)A$", main, second), "E(10)?(2)B(10)$");
}

#[test]
fn a_production_of_a_sub_l_system_may_wait_for_its_step() {
    // Nothing is rewritten in steps 1 to 4; the derivation continues, as another L-system of the file counts its steps.
    let second = "Lsystem: 2\nderivation length: 1\nAxiom: A\n";
    let sub = |rules: &str| {
        string(&format!("Lsystem: 1\nderivation length: 8\nAxiom: ?(2)A$\nendlsystem\n{second}{rules}\nendlsystem\n"))
    };
    assert_eq!(sub("A : Q==5 --> B C"), "?(2)BC$");
    assert_eq!(sub("Decomposition\nA : remaining==2 --> D"), "?(2)D$");
}

#[test]
fn a_predecessor_of_several_modules_takes_them_across_borders() {
    let text = "Lsystem: 1\nderivation length: 1\nAxiom: FA?(2,1)BBC$F\nA ?(l,s) B --> X?(l,s)\nendlsystem\n\
                Lsystem: 2\nderivation length: 1\nAxiom: A\nB --> D\nC $ --> E$\nendlsystem\n";
    assert_eq!(string(text), "FX?(2,1)DE$F");
    let (g, _) = read(text);
    let as_cpfg = DeriveOptions { draw_as_cpfg: true, ..DeriveOptions::default() };
    let d = derive(&g, &as_cpfg, &Limits::default()).expect("derives");
    assert_eq!(g.print(&d.modules), "FX?(2,1)DE$F");
}

#[test]
fn contexts_of_a_sub_l_system_skip_its_own_symbols_in_every_section() {
    let (main, second) = ("Ignore: +\n", "Lsystem: 2\nderivation length: 1\nAxiom: A\nIgnore: X\n");
    let text = |rules: &str| {
        format!(
            "Lsystem: 1\nderivation length: 1\n{main}Axiom: A+B?(2)AXB A+B$A+B\n{rules}endlsystem\n{second}{rules}endlsystem\n"
        )
    };
    // Outside `+` is passed over, inside X, in productions, decompositions and homomorphisms alike.
    assert_eq!(string(&text("A < B --> C\n")), "A+C?(2)AXCA+B$A+C");
    assert_eq!(string(&text("Decomposition\nA < B --> C\n")), "A+C?(2)AXCA+B$A+C");
    let (g, _) = read(&text("Homomorphism\nA < B --> C\n"));
    let d = derive(&g, &DeriveOptions::default(), &Limits::default()).expect("derives");
    let mut drawn = String::new();
    interpret(&g, &d, &Limits::default(), |m| drawn.push(g.symbols().get(m.symbol))).expect("draws");
    assert_eq!(drawn, "A+C?AXCA+B$A+C");
    // The same in the order of cpfg.
    let as_cpfg = DeriveOptions { draw_as_cpfg: true, ..DeriveOptions::default() };
    for rules in ["A < B --> C\n", "Decomposition\nA < B --> C\n"] {
        let (g, _) = read(&text(rules));
        let d = derive(&g, &as_cpfg, &Limits::default()).expect("derives");
        assert_eq!(g.print(&d.modules), "A+C?(2)AXCA+B$A+C", "{rules}");
    }
}

#[test]
fn the_homomorphism_of_a_sub_l_system_is_its_own() {
    let (g, _) = read(
        "Lsystem: 1\nderivation length: 0\nAxiom: A?(2)A$A\nHomomorphism\nA --> F\nendlsystem\n\
         Lsystem: 2\nderivation length: 0\nAxiom: A\nHomomorphism\nA --> GG\nendlsystem\n",
    );
    let d = derive(&g, &DeriveOptions::default(), &Limits::default()).expect("derives");
    let mut drawn = String::new();
    interpret(&g, &d, &Limits::default(), |m| drawn.push(g.symbols().get(m.symbol))).expect("draws");
    assert_eq!(drawn, "F?GG$F");
}

#[test]
fn fractions_where_whole_numbers_stand_are_told() {
    let said = |length: &str| {
        let (_, warnings) = read(&format!("Lsystem: 1\nderivation length: {length}\nAxiom: A\nA --> AF\nendlsystem\n"));
        warnings.into_iter().filter(|w| w.code == "L008").map(|w| w.message).collect::<Vec<_>>()
    };
    assert_eq!(said("2.7"), ["2.7 is no whole number, 2 is taken"]);
    assert_eq!(said("5/2"), ["2.5 is no whole number, 2 is taken"]);
    assert!(said("2").is_empty() && said("2.0").is_empty());
}

#[test]
fn values_of_every_function_and_operator() {
    for (e, v) in [
        // Precedence from low to high, associativity to the left.
        ("1 || 0 && 0", "1"),
        ("1 == 2 < 3", "1"),
        ("3 < 2 == 0", "1"),
        ("2+3*2^2", "14"),
        ("7-2-1", "4"),
        ("8/4/2", "1"),
        ("7%4%2", "1"),
        ("!3^2", "0"),
        ("-2*-3", "6"),
        ("1 >= 1 && 2 <= 1", "0"),
        // In degrees.
        ("cos(60)", "0.5"),
        ("tan(45)", "1"),
        ("asin(1)", "90"),
        ("acos(0.5)", "60"),
        ("atan(1)", "45"),
        ("atan(0,0-1)", "180"),
        ("exp(0)+log(exp(2))", "3"),
        ("sqrt(2)", "1.41421"),
        ("fabs(0-2.5)", "2.5"),
        ("floor(0-0.5)", "-1"),
        ("ceil(0.2)", "1"),
        ("sign(0)", "0"),
        ("trunc(0-1.5)", "-1"),
        ("trunc(1.49)", "1"),
        ("0%3", "0"),
        ("0/0", "0"),
        // Printing with six digits.
        ("1/7", "0.142857"),
        ("1234567", "1.23457e+06"),
        ("0.0001", "0.0001"),
        ("0.00001", "1e-05"),
        ("100000", "100000"),
        ("12.", "12"),
    ] {
        assert_eq!(value(e), format!("V({v})"), "{e}");
    }
}

#[test]
fn a_name_that_the_file_assigns_is_its_own() {
    // Q, Z and remaining are predefined until the grammar assigns them.
    assert_eq!(steps(2, "A", "A --> A(Q,Z,remaining)\nA(q,z,r) --> B(Q,Z,remaining)"), "B(2,2,0)");
    assert_eq!(steps(2, "A", "Start: { Q = 7; remaining = 5; }\nA --> B(Q,Z,remaining)"), "B(7,2,5)");
    // In blocks Q counts the steps that are completed.
    assert_eq!(steps(3, "A", "StartEach: { s = Q; }\nEndEach: { e = Q; }\nA --> A B(s,e)"), "AB(2,2)B(1,1)B(0,0)");
}

#[test]
fn each_sentence_about_matching_holds() {
    for (axiom, rules, result) in [
        // 1. Same symbol and number of parameters.
        ("A A(1) A(1,2)", "A(x) --> X", "AXA(1,2)"),
        ("BA B(1)A", "B(x) < A --> X", "BAB(1)X"),
        // 2. An unmatched `[` is stepped over, `]` jumps over its branch, ignored symbols are skipped.
        ("AB[C[D]E", "AB < E --> X\nD < E --> Y", "AB[C[D]E"),
        ("A[C[D]E]", "AC < E --> X\nD < E --> Y", "A[C[D]X]"),
        ("A+[D]-B", "Ignore: +-\nA < B --> X", "A+[D]-X"),
        // 3. `]` of the axis fails unless the element is `]`.
        ("[AB]C", "AB > C --> X", "[AB]C"),
        ("[AB]", "B > ] --> X", "[AX]"),
        ("A[B]C", "A > [B]C --> X", "X[B]C"),
        ("A[+B]C", "Ignore: +\nA > [B] --> X", "X[+B]C"),
        ("A[BD]C", "A > [B] --> X", "A[BD]C"),
        ("A[B[D]]C", "A > [B] --> X", "X[B[D]]C"),
        ("A[BD]C", "A > [B=]C --> X", "X[BD]C"),
        ("A[BD]C", "A > [B --> X", "X[BD]C"),
        // 4. Brackets always count.
        ("A[B]", "Consider: A\nA > B --> X", "A[B]"),
        ("A+B", "Consider: AB\nA > B --> X", "X+B"),
        // Contexts read the string as it was before the step.
        ("ABB", "A < B --> A\nA --> C", "CAB"),
        // 5. Decomposition sees contexts of the derived string.
        ("AB", "B --> C\nDecomposition\nA > C --> X\nA > B --> Y", "XC"),
    ] {
        assert_eq!(steps(1, axiom, rules), result, "{axiom} | {rules}");
    }
}

#[test]
fn blanks_stars_and_lines_mean_what_they_should() {
    // `*` alone: empty successor, empty context, true condition; the condition may be left out after a block.
    assert_eq!(steps(1, "AB", "* < A > * : * --> *"), "B");
    assert_eq!(steps(1, "A(3)", "A(x) : {y=x;} * {z=y+1;} --> B(z)"), "B(4)");
    assert_eq!(steps(1, "A(3)", "A(x) : {y=x;} --> B(y)"), "B(3)");
    // A production continues after an indented line end, and in an open group.
    assert_eq!(steps(1, "A", "A --> B\n\tC\nB --> D"), "BC");
    assert_eq!(steps(1, "A", "A --> B(1,\n2)C"), "B(1,2)C");
    // Length 0 is the axiom; blanks in keywords and their case do not count.
    let text = "lsystem\nStart Each: {n=n+1;}\nDerivationLength: 2\naxiom: A\nA --> A B(n)\nendlsystem";
    assert_eq!(string(text), "AB(2)B(1)");
}

#[test]
fn comments_directives_and_blank_lines_do_not_end_a_production() {
    for between in ["/* left */", "\t/* left */", "// left", "\t// left", "/* left\n right */", "", "\n\n"] {
        let rules = format!("A --> B\n{between}\n\t[C]\n{between}\n\tD\n{between}\nB --> E");
        assert_eq!(steps(2, "A", &rules), "E[C]D", "{between:?}");
        let axiom = format!("A\n{between}\n\tB");
        assert_eq!(steps(1, &axiom, "A --> C"), "CB", "{between:?}");
        let split = format!("A(x)\n{between}\n\t: x > 1\n{between}\n\t--> B");
        assert_eq!(steps(1, "A(1)A(2)", &split), "A(1)B", "{between:?}");
        // Productions of a file that is indented throughout stay apart, also if their arrows stand on lines of their own.
        let rules = format!("\tA --> B\n{between}\n\tB\n\t--> C\n{between}\n\tC(x)\n\t: x > 1 --> D");
        assert_eq!(steps(1, "ABC(2)", &rules), "BCD", "{between:?}");
    }
    let rules = "A --> B\n#ifdef OSIER\n\tC\n#else\n\tD\n#endif\n\tE";
    assert_eq!(steps(1, "A", rules), "BCE");
}

#[test]
fn a_polygon_may_begin_in_the_axiom_and_end_in_a_production() {
    let rules = "A(n) : n<2 --> F.A(n+1)\nA(n) --> F.}";
    assert_eq!(steps(3, "{A(1)", rules), "{F.F.}");
    assert_eq!(steps(3, "{\n\tA(1)\n", rules), "{F.F.}");
    assert_eq!(steps(3, "{A(1)", &rules.replace("A(n) ", "\tA(n) ")), "{F.F.}");
    assert_eq!(steps(1, "A{B", "Ignore: +}{\nA < B --> C\nA > C --> D"), "A{C");
    assert_eq!(steps(1, "{A(1)", "Homomorphism\nA(n) --> F.}"), "{A(1)");
    let (_, said) = read(&format!("Lsystem: 1\nderivation length: 3\nAxiom: {{A(1)\n{rules}\nendlsystem\n"));
    assert!(said.iter().any(|d| d.code == "L012"), "{said:?}");
}

#[test]
fn items_of_a_section_may_follow_its_heading() {
    // At depth 2 B becomes C and C D; at depth 1 the string keeps C.
    for heading in ["maximum depth: 2", "no warnings maximum depth: 2", "seed: 3 maximum depth: 2 warnings"] {
        for colon in ["", ":"] {
            let rules = format!("A --> B\nDecomposition{colon} {heading}\nB --> C\nC --> D");
            assert_eq!(steps(1, "A", &rules), "D", "{heading}");
        }
    }
    let read_with = |heading: &str| {
        let text = format!(
            "Lsystem: 1\nderivation length: 1\nAxiom: A\nA --> A\nDecomposition: {heading}\nA --> A\nendlsystem\n"
        );
        let (g, said) = read(&text);
        let d = derive(&g, &DeriveOptions::default(), &Limits::default()).expect("derives");
        said.into_iter().chain(d.warnings).map(|d| d.code).filter(|c| ["L008", "L052"].contains(c)).collect::<Vec<_>>()
    };
    assert_eq!(read_with("warnings maximum depth: 3"), ["L052"]);
    assert_eq!(read_with("maximum depth: 3 no warnings"), [""; 0]);
    assert_eq!(read_with("no warnings of any kind"), [""; 0]);
    assert_eq!(read_with("rubbish"), ["L008"]);
}

#[test]
fn letters_of_long_commands_are_no_idle_symbols() {
    let idle = |axiom: &str| {
        let (g, _) = read(&format!("Lsystem: 1\nderivation length: 0\nAxiom: {axiom}\nendlsystem\n"));
        let notes = g.notes().iter().filter(|d| d.code == "L037");
        notes.map(|d| d.message.split(' ').next().unwrap_or_default().to_owned()).collect::<Vec<_>>()
    };
    assert_eq!(idle("@PS(1,1)@PC(1,0,0)f@PD(1,2,2)@Gs f @Ge(1)@bo(2)@Di(2)@Ts(1,0.5)@D(3)@Tp"), [""; 0]);
    assert_eq!(idle("@D X @PS(1,1) S F"), ["X", "S"]);
}

#[test]
fn a_step_that_cuts_a_branch_changes_the_string() {
    let told = |length: u32| {
        let (g, _) = read(&format!("Lsystem: 1\nderivation length: {length}\nAxiom: A\nA --> F%F\nendlsystem\n"));
        let d = derive(&g, &DeriveOptions::default(), &Limits::default()).expect("derives");
        (g.print(&d.modules), d.warnings.iter().map(|w| w.message.clone()).collect::<Vec<_>>())
    };
    assert_eq!(told(1), ("F%F".to_owned(), Vec::new()));
    assert_eq!(told(3), ("F".to_owned(), Vec::new()));
    assert_eq!(told(4), ("F".to_owned(), vec!["nothing changes from step 3 on".to_owned()]));
}

#[test]
fn a_production_that_loses_prints_in_every_step() {
    let (g, _) =
        read("Lsystem: 1\nderivation length: 3\nAxiom: A(0)\nA(x) : {printf(\"x %g\\n\", x);} x>0 --> F\nendlsystem\n");
    let d = derive(&g, &DeriveOptions::default(), &Limits::default()).expect("derives");
    assert_eq!((g.print(&d.modules).as_str(), d.output.as_str()), ("A(0)", "x 0\nx 0\nx 0\n"));
}

#[test]
fn faults_of_the_notation_say_how_to_mend_them() {
    for (rule, help) in [
        ("A --> F(1+)", "put a number, a variable or a function there"),
        ("A --> F((1 2))", "close it with ')', or put an operator between two values"),
        ("A --> F)", "open the parameters behind a module"),
        ("A --> F(1)(2)", "in one pair of parentheses"),
        ("A --> *F", "remove the '*'"),
        ("A : 1 2 --> F", "remove it, or put an operator between two values"),
        ("A : {x = 1} --> F", "end each statement with ';'"),
        ("A : {for (i=0; i<3; i=i+1) {x=i;}} 1 --> F", "count in a loop with 'while'"),
        ("A : {double x = 3;} 1 --> F(x)", "remove the type"),
        ("F F F", "write an item such as 'Axiom: F'"),
        ("A : {x = 1;} 1 {y = 2;} 3 --> F", "put '-->' behind the second block"),
        ("A --> F(1 ? 2)", "condition ? value : other value"),
        ("A --> F((1,2))", "put ')' before it"),
        ("A --> F(1e999)", "write a number of at most"),
        ("A : {do {x = 1;}} 1 --> F", "put the condition behind the block"),
        ("A : {) = 1;} 1 --> F", "write an assignment such as 'x = 1;'"),
        ("StartEach: x = 1;", "put the statements of the block in braces"),
        ("maximum depth: -1", "maximum depth: 5"),
        ("Seed:", "write the number behind the colon"),
        ("Define: { array [2]; }", "array a[2] = {1, 2};"),
        ("Define: { array a; }", "array a[2] = {1, 2};"),
        ("#else", "put its #if before it"),
        ("#endif", "put its #if before it"),
        ("#define", "write: #define NAME value"),
        ("#define 3 4", "begin the name with a letter"),
        ("#if 1 2\n#endif", "put an operator between two values"),
    ] {
        let text = format!("Lsystem: 1\nderivation length: 1\nAxiom: A\n{rule}\nendlsystem\n");
        let said = try_read(&text).err().map_or_else(String::new, |e| e.to_string());
        assert!(said.contains("error[L001]") && said.contains(help) && said.contains("test.l:4:"), "{rule}: {said}");
    }
}

#[test]
fn a_second_item_and_numbers_with_a_fraction_are_told() {
    for (items, count) in [
        ("derivation length: 2", 1),
        ("Seed: 1\nSeed: 2", 1),
        ("Start: {x = 1;}\nEnd: {x = 2;}", 0),
        ("Start: {x = 1;}\nStart: {x = 2;}", 1),
        ("Decomposition\nmaximum depth: 2\nHomomorphism\nmaximum depth: 3", 0),
        ("Homomorphism\nmaximum depth: 2\nmaximum depth: 3", 1),
        ("Homomorphism\nderivation length: 2", 1),
        ("Define: { array a[2.5]; }", 1),
    ] {
        let (_, said) = read(&format!("Lsystem: 1\nderivation length: 1\nAxiom: A\nA --> F A\n{items}\nendlsystem\n"));
        assert_eq!(said.iter().filter(|d| d.code == "L008").count(), count, "{items}: {said:?}");
    }
    let turtle = |numbers: &str, axiom: &str| {
        format!("Lsystem: 1\nderivation length: 1\nturtle: lparser {numbers}\nAxiom: {axiom}\nendlsystem\n")
    };
    let (g, said) = read(&turtle("fraction = 0.5", "repeat 2.5 { F }"));
    let d = derive(&g, &DeriveOptions::default(), &Limits::default()).expect("derives");
    assert_eq!((g.print(&d.modules).as_str(), said.iter().filter(|d| d.code == "L008").count()), ("FF", 1));
    for numbers in ["fraction = 2", "fraction = -0.5", "unit = 0", "thickness = -1", "min_thickness = -1"] {
        let said = try_read(&turtle(numbers, "F")).err().map_or_else(String::new, |e| e.to_string());
        assert!(said.contains("error[L001]") && said.contains("must be") && said.contains("test.l:3:17"), "{said}");
    }
}

#[test]
fn quotes_are_symbols_that_contexts_skip_and_a_second_list_replaces_the_first() {
    for (items, axiom, result) in [
        ("Ignore: '\n", "A'B", "A'X"),
        ("Ignore: \"\n", "A\"B", "A\"X"),
        ("Ignore: \"+\"\n", "A+\"B", "A+\"X"),
        ("Consider: AB'\n", "A'B", "A'B"),
        ("Ignore: -\nIgnore: +\n", "A+B A-B", "A+XA-B"),
    ] {
        assert_eq!(steps(1, axiom, &format!("{items}A < B --> X")), result, "{items}");
    }
    let (_, said) = read("Lsystem: 1\nIgnore: -\nIgnore: +\nderivation length: 1\nAxiom: A\nA --> F\nendlsystem\n");
    assert_eq!(said.iter().filter(|d| d.code == "L008").count(), 1, "{said:?}");
}

#[test]
fn what_needs_a_program_beside_the_grammar_is_refused_by_name() {
    for (text, place, why) in [
        ("Lsystem: 1\nderivation length: 1\nAxiom: A\nA -o> B\nendlsystem\n", "4:3", "'-o>'"),
        // Also behind a condition, and of a predecessor of several modules.
        ("Lsystem: 1\nderivation length: 1\nAxiom: A\nA ?E(x) : x > 0 -o> B\nendlsystem\n", "4:17", "'-o>'"),
        ("Lsystem: 1\nDefine: { external a[3]; }\nderivation length: 1\nAxiom: A\nendlsystem\n", "2:11", "'external'"),
    ] {
        let said = try_read(text).err().map_or_else(String::new, |e| e.to_string());
        assert!(said.contains("error[L001]") && said.contains(why) && said.contains(place), "{text}: {said}");
    }
}

#[test]
fn models_in_the_style_of_the_manual_derive_to_what_they_say() {
    // A macro of two values, arrays of one and two sizes, and a block behind the condition: total[1][0] is 10.
    let arrays = "#define N 5\n#define MAX(a,b) ((a)>(b)?(a):(b))\nLsystem: 1\nDefine: {\n\tarray len[N] = {1.0, 0.8, 0.6, 0.4, 0.2};\n\t\
                  array total[2][3];\n}\nStart: { i = 0; while (i < 2) { j = 0; while (j < 3) { total[i][j] = i*10+j; j = j+1; } i = i+1; } }\n\
                  derivation length: N\naxiom: A(0)\nA(k) : k < N {\n\
                  \tif (len[k] > 0.5) { w = MAX(len[k], 0.7); } else { w = total[1][k%3]; }\n} --> !(w)F(len[k])A(k+1)\nendlsystem\n";
    assert_eq!(string(arrays), "!(1)F(1)!(0.8)F(0.8)!(0.7)F(0.6)!(10)F(0.4)!(11)F(0.2)A(5)");
    // Contexts with brackets see what 'Consider:' leaves: B(0) has more than B(1) on its first branch; 10 + 2; 4 becomes -4.
    let contexts = "#define STAGE(x) \\\n\t((x)>2)\nLsystem: 1\nConsider: B S X\nderivation length: 2\n\
                    Axiom: S(1)FB(0)[+B(1)[X]B(2)][-B(3)]FB(4)X\n\
                    S(s) < B(n) > [B(m)][B(k)]B(j) : STAGE(j) --> S(s+m+k+j)\nB(m) < B(n) > [X]B(k) : n==1 --> B(10+k)\n\
                    B(a)B(b) --> B(a+b)\nB(n) > X : n==4 { q = n*1; } --> B(-q)\nX < F > X --> G\nendlsystem\n";
    assert_eq!(string(contexts), "S(1)FB(0)[+B(12)[X]B(2)][-B(3)]FB(-4)X");
    // n is 5, 6, 7, 8; m is 2, 12, 84. B(7) sees B(6), and X is decomposed in the same step.
    let blocks = "Lsystem: 1\nStart: {n = 0; m = 2;\n  do { n = n + 1; } while (n < 5);\n}\nEndEach: {m = m*n;}\nderivation length: 3\naxiom: A\n\
                  A : {k = m; if (k > 5) {k = 5;}} k < 6 {n = n + 1;} --> F(k)A B(n)\nB(x) > B(y) : x > y --> X(x,y)\n\
                  decomposition: warnings\nmaximum depth: 3\nX(a,b) : 1 --> [Y(a)Y(b)]\nhomomorphism: no warnings\nY(a) : a > 0 --> !(a)F(1)\n\
                  endlsystem\n";
    assert_eq!(string(blocks), "F(2)F(5)F(5)AB(8)[Y(7)Y(6)]B(6)");
    // Two L-systems of the file rewrite what stands between their borders; a ring sees across its ends.
    let systems = "lsystem: 1\nderivation length: 3\naxiom: A\nA --> F[+?(2,0.5)A(1)$][-?(3)B$]A\nendlsystem\nlsystem: 2\nderivation length: 1\n\
                   axiom: A\nA(n) : n < 4 --> F(n)A(n+1)\nendlsystem\nlsystem: 3\nderivation length: 7\naxiom: B\nB --> G[B]\nendlsystem\n";
    assert_eq!(
        string(systems),
        "F[+?(2,0.5)F(1)F(2)A(3)$][-?(3)G[G[B]]$]F[+?(2,0.5)F(1)A(2)$][-?(3)G[B]$]F[+?(2,0.5)A(1)$][-?(3)B$]A"
    );
    let ring = "ring Lsystem: 1\nderivation length: 4\naxiom: ABCB\nA < B --> A\nB < A > C : 1 --> *\nC < B > A --> X(1)\nendlsystem\n";
    assert_eq!(string(ring), "AACX(1)");
    // Arrows beside their condition, an empty successor, comments behind a rule, notes behind the end.
    let glued = "Lsystem: 1\nderivation length: 4\naxiom: A(8,2)B\nA(x,y):x>=y*2&&y!=0-->F(x)A(x/2,y)\nA(x,y):*-->\nB --> \n\
                 F(x):x>1-->F(x/2)F(x-x/2)/* half */\nendlsystem\n\nNotes: A --> B\nfor details (and ask me).\n";
    assert_eq!(string(glued), "F(1)".repeat(12));
}
