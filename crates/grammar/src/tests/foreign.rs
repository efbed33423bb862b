//! What models of cpfg need: its random numbers, brackets in predecessors, output.

use super::*;

/// Final string with the random numbers of cpfg.
fn as_cpfg(text: &str) -> String {
    let (g, _) = read(text);
    let options = DeriveOptions { draw_as_cpfg: true, seed: 77, ..Default::default() };
    let d = derive(&g, &options, &Limits::default()).expect("derives");
    assert_eq!(derive_text(&g, &options, &Limits::default()).expect("derives").module_count(), d.module_count());
    g.print(&d.modules)
}

fn one_step(items: &str, axiom: &str, rules: &str) -> String {
    as_cpfg(&format!("Lsystem: 1\n{items}derivation length: 1\nAxiom: {axiom}\n{rules}\nendlsystem\n"))
}

#[test]
fn choices_are_those_of_cpfg() {
    // What cpfg 6.6 makes of thirty modules with the weights 1 and 3.
    let rules = "A --> B : 1\nA --> C : 3";
    let seed = "Seed: 5\n";
    assert_eq!(one_step(seed, &"A".repeat(30), rules), "BBBBCBBCCCBCCCCBCBCCCCCCCBCCBC");
    // Every module takes a random number, brackets too: the fifth number chooses C, the sixth B.
    assert_eq!(one_step(seed, "AAAAA", rules), "BBBBC");
    assert_eq!(one_step(seed, "AAAA[A]", rules), "BBBB[B]");
    // A predecessor of two modules takes one number.
    assert_eq!(one_step(seed, "XYAAAA", &format!("XY --> Z\n{rules}")), "ZBBBC");
    // Steps continue in the same numbers: the first takes five, the sixth to tenth are B B C C C.
    let text = format!("Lsystem: 1\nSeed: 1\nderivation length: 2\nAxiom: NNNNN\nN --> A\n{rules}\nendlsystem\n");
    assert_eq!(as_cpfg(&text), "BBCCC");
}

#[test]
fn random_functions_match_cpfg() {
    // drand48 after srand48(0): 0.170828, 0.749902, 0.0963717, 0.870465, 0.577304.
    assert_eq!(one_step("", "AA", "A --> V(ran(1),ran(2))"), "V(0.170828,1.4998)V(0.0963717,1.74093)");
    assert_eq!(
        one_step("Start: { srand(0); }\n", "A", "A : {x = ran(1); srand(0);} 1 --> V(x,ran(1))"),
        "V(0.170828,0.170828)"
    );
    // Each module is decomposed before the next one is rewritten.
    let decomposition = "A --> X(ran(1))Y\ndecomposition\nY --> Z(ran(1))";
    assert_eq!(one_step("", "AA", decomposition), "X(0.170828)Z(0.749902)X(0.0963717)Z(0.870465)");
    // Both sides of && and || are computed.
    assert_eq!(one_step("", "A", "A : 0 && ran(1) --> B\nA : 1 || ran(1) --> V(ran(1))"), "V(0.0963717)");
    // A decomposition takes the first production, also where the rules compete.
    let first = "A --> X X\ndecomposition\nX --> P : 1\nX --> Q : 1000";
    assert_eq!(one_step("Seed: 1\n", "A", first), "PP");
    // Without cpfg's order the seed of the run matters.
    let text = "Lsystem: 1\nderivation length: 1\nAxiom: A\nA --> V(ran(1))\nendlsystem\n";
    assert_ne!(string(text), as_cpfg(text));
}

#[test]
fn a_decomposition_in_order_sees_the_string_before_the_step() {
    // Modules of one successor are taken together; a module that no rule rewrites is decomposed as well.
    let rules = "A --> P Q R\ndecomposition\nP Q --> X\nR --> Y\nB --> C";
    assert_eq!(one_step("", "AB", rules), "XYC");
    assert_eq!(
        one_step("", "[A]B", "A --> A(2)\ndecomposition\nmaximum depth: 9\nA(n) : n > 0 --> F A(n-1)"),
        "[FFA(0)]B"
    );
}

#[test]
fn brackets_of_a_predecessor_are_taken_literally() {
    // A dot, its branch and what is drawn before it vanish together.
    assert_eq!(steps(1, "[f(1)-P(0)][f(2)-P(1)]", "[f(y)-P(s)] : s == 1 --> *"), "[f(1)-P(0)]");
    assert_eq!(steps(1, "[f(1)-P(2)]Q", "[f(y)-P(s)] --> [f(y+s)P(y)]"), "[f(3)P(1)]Q");
    // As many branches as are written, and no others.
    assert_eq!(steps(1, "A[B][C]A[B]", "A[B][C] --> X"), "XA[B]");
    assert_eq!(steps(1, "A[B[C]]", "A[B[C]] --> X\n"), "X");
    // Contexts lie outside of the brackets.
    assert_eq!(steps(1, "S[A]T[A]", "S < [A] > T --> X"), "SXT[A]");
    // In a decomposition, from the string and from a successor.
    assert_eq!(steps(1, "A", "A --> [B]\ndecomposition\n[B] --> C"), "C");
    for (rule, wanted) in [("[] --> A", "brackets alone"), ("[B=] --> A", "'=]' belongs to a context")] {
        let text = format!("Lsystem: 1\nderivation length: 1\nAxiom: A\n{rule}\nendlsystem\n");
        let said = try_read(&text).err().map_or_else(String::new, |e| e.to_string());
        assert!(said.contains("L010") && said.contains(wanted), "{rule}: {said}");
    }
}

#[test]
fn choose_draws_from_the_functions_of_cpfg() {
    // Their first numbers are 0.170828, 0.749902 and 0.0963717.
    let rule = "A --> B(choose(1,0.18, 2,0.82),choose(1,0.74, 2,0.26),ran(1))";
    assert_eq!(one_step("", "A", rule), "B(1,2,0.0963717)");
    let text = format!("Lsystem: 1\nderivation length: 1\nAxiom: AAAAAAAA\n{rule}\nendlsystem\n");
    let (g, _) = read(&text);
    let strings = [1, 2].map(|seed| {
        let options = DeriveOptions { draw_as_cpfg: true, seed, ..Default::default() };
        g.print(&derive(&g, &options, &Limits::default()).expect("derives").modules)
    });
    assert_eq!(strings[0], strings[1], "the seed has no effect");
}

#[test]
fn only_the_production_applied_runs_its_last_block() {
    let text = "Lsystem: 1\nStart: { n = 0; }\nSeed: 1\nderivation length: 1\nAxiom: AAAA\nA : * {n = n+1;} --> B\n\
                A : * {n = n+10;} --> C\nendlsystem\n";
    let (g, _) = read(text);
    let d = derive(&g, &DeriveOptions::default(), &Limits::default()).expect("derives");
    let made = g.print(&d.modules);
    let count = |c: char| made.chars().filter(|x| *x == c).count() as f64;
    assert!((d.globals[0] - (count('B') + 10.0 * count('C'))).abs() < 1e-12, "{made}: {:?}", d.globals);
}

#[test]
fn modules_behind_two_slashes_are_told_from_words() {
    for (rule, is_told) in [
        ("F(x) --> F(x) //A(x)", true),
        ("F(x) --> F(x)//A(x)", true),
        ("F(x) --> F(x) //A(x)B(x)", true),
        ("F(x) --> F(x) // A(x)", false),
        ("F(x) --> F(x) //A", false),
        ("F(x) --> F(x) //grow F(x)", false),
        ("F(x) --> F(x) //(1)", false),
        ("F(x) --> F(x) //(1) A", false),
        ("F(x) --> F(x) //(1)st step", false),
        ("F(x) --> F(x) //(30)A", true),
        ("F(x) --> F(x) //(x*(2+1))[+A]", true),
    ] {
        let (_, warnings) = read(&format!("Lsystem: 1\nderivation length: 1\nAxiom: F(1)\n{rule}\nendlsystem\n"));
        assert_eq!(warnings.iter().any(|w| w.code == "L014"), is_told, "{rule}: {warnings:?}");
    }
}

#[test]
fn printf_writes_to_the_output() {
    let text = "Lsystem: 1\nStart: { n = 0; }\nEndEach: { n = n+1; printf(\"Step %3.0f: %g\\n\", n, n/4); }\n\
                End: { printf(\"done\\n\"); }\nderivation length: 2\nAxiom: AA\nA(x) : {printf(\"never\");} x --> B\n\
                A : {printf(\"%d,\", n);} 1 --> A\nendlsystem\n";
    let (g, warnings) = read(text);
    assert!(warnings.is_empty() || warnings.iter().all(|w| w.code != "L008"), "{warnings:?}");
    let d = derive(&g, &DeriveOptions::default(), &Limits::default()).expect("derives");
    assert_eq!(d.output, "0,0,Step   1: 0.25\n1,1,Step   2: 0.5\ndone\n");
    // Too few and too many values are reported; an endless output is cut.
    let (_, warnings) =
        read("Lsystem: 1\nEnd: { printf(\"%d %d\", 1); }\nderivation length: 1\nAxiom: A\nendlsystem\n");
    assert!(warnings.iter().any(|w| w.code == "L008" && w.message.contains("takes 2 values, got 1")));
    let flood = "Lsystem: 1\nEnd: { i = 0; while (i < 90000) { printf(\"0123456789abcdef\\n\"); i = i+1; } }\n\
                 derivation length: 1\nAxiom: A\nendlsystem\n";
    let d = derive(&read(flood).0, &DeriveOptions::default(), &Limits::default()).expect("derives");
    assert!(d.output.len() <= 1 << 20 && d.output.len() > 1_000_000 && d.warnings.iter().any(|w| w.code == "L008"));
}

#[test]
fn printf_of_a_homomorphism_writes_while_the_string_is_drawn() {
    let text = "Lsystem: 1\nderivation length: 1\nAxiom: AA\nA : {printf(\"step\\n\");} 1 --> B\nhomomorphism\n\
                B : {printf(\"drawn\\n\");} 1 --> F(1)\nendlsystem\n";
    let (g, _) = read(text);
    let d = derive(&g, &DeriveOptions::default(), &Limits::default()).expect("derives");
    assert_eq!(d.output, "step\nstep\n");
    let drawn = interpret(&g, &d, &Limits::default(), |_| ()).expect("draws");
    assert_eq!(drawn.output, "drawn\ndrawn\n");
}

#[test]
fn functions_on_files_are_refused_by_name() {
    for call in
        ["fp = fopen(\"plant.p\", \"r\");", "fscanf(fp, \"%lf\", &a[0]);", "fprintf(fp, \"x\\n\");", "fclose(fp);"]
    {
        let text = format!("Lsystem: 1\nStart: {{ {call} }}\nderivation length: 1\nAxiom: A\nendlsystem\n");
        let said = try_read(&text).err().map_or_else(String::new, |e| e.to_string());
        assert!(said.contains("error[L043]") && said.contains("neither read nor write files"), "{call}: {said}");
    }
}

#[test]
fn functions_on_the_window_of_cpfg_are_told() {
    let text = "Lsystem: 1\nEndEach: { Display(1); }\nderivation length: 3\nAxiom: A\nA --> B(2*GetDerivationLength(1)+1)\nendlsystem\n";
    let (g, warnings) = read(text);
    assert_eq!(
        warnings.iter().filter(|w| w.code == "L008" && w.message.contains("Display")).count(),
        1,
        "{warnings:?}"
    );
    let d = derive(&g, &DeriveOptions::default(), &Limits::default()).expect("derives");
    assert_eq!(g.print(&d.modules), "B(7)");
    for (call, why) in [
        ("SetDerivationLength(3);", "the derivation length is fixed"),
        ("x = vvScale(1);", "no window"),
        ("x = inblob(1,0,0,0);", "no field of blobs"),
    ] {
        let text = format!("Lsystem: 1\nStart: {{ {call} }}\nderivation length: 1\nAxiom: A\nendlsystem\n");
        let said = try_read(&text).err().map_or_else(String::new, |e| e.to_string());
        assert!(said.contains("error[L043]") && said.contains(why), "{call}: {said}");
    }
    let said = try_read(&text.replace("Length(1)", "Length()")).err().map_or_else(String::new, |e| e.to_string());
    assert!(said.contains("error[L022]"), "{said}");
}

/// Final string of a model of L-Py.
fn lpy(text: &str) -> String {
    string(&format!("{text}\nendlsystem\n"))
}

#[test]
fn models_of_lpy_may_count_in_variables_of_their_own() {
    // n is 1 at the start; each step adds 1 before it and 10 after it: the steps see 2 and 13.
    let model = "n = 0\nsteps = 2\n\ndef Start():\n    global n\n    print(\"begin\")\n    n = 1\n\ndef StartEach():\n    global n\n    n += 1\n\n\
                 def EndEach():\n    global n\n    if n > 100:\n        n = 0\n    else:\n        n = n + 10\n\n\
                 Axiom: A\nderivation length: steps\nproduction:\nA --> B(n)A\n";
    assert_eq!(lpy(model), "B(2)B(13)A");
    assert_eq!(lpy(&model.replace("    n += 1", "    forward()\n    n += 1")), "B(2)B(13)A");
    // A rule changes the variable only where its conditions hold, and once; the modules are rewritten from left to right.
    let rule = "c = 5\nAxiom: A(1)A(0)A(1)\nderivation length: 1\nproduction:\nA(x):\n  global c\n  c = c + 1\n  if x > 0:\n    \
                produce B(c)\n  else:\n    produce C(c)\n";
    assert_eq!(lpy(rule), "B(6)C(7)B(8)");
    // One that makes nothing counts as well, and the next rule is tried.
    let idle = "k = 0\nAxiom: A A A\nderivation length: 1\nproduction:\nA:\n  global k\n  k = k + 1\nA --> B(k)\n";
    assert_eq!(lpy(idle), "B(1)B(2)B(3)");
    // A shared name keeps the value that items need, and functions of time are reported where a rule needs them.
    let timed = "import time as t\nn = 2\nstamp = 0\ndef Start():\n  global stamp, n\n  stamp = t.time()\n  n = 2\n\
                 Axiom: A\nderivation length: n\nproduction:\nA --> A B\n";
    assert_eq!(lpy(timed), "ABB");
    let said = try_read(&timed.replace("A B", "A B(stamp)")).err().map_or_else(String::new, |e| e.to_string());
    assert!(said.contains("L007") && said.contains("line 6"), "{said}");
}

#[test]
fn whole_numbers_of_lpy_may_have_other_bases() {
    let text = "w = 0x1F\nAxiom: F(w)\nderivation length: 1\nproduction:\nF(x) --> F(x + 0b101)F(0o17)F(0X_ff)\n";
    assert_eq!(lpy(text), "F(36)F(15)F(255)");
}

#[test]
fn functions_that_lpy_runs_end_at_return() {
    let model = |head: &str| format!("n = 0\n{head}Axiom: A\nderivation length: 4\nproduction:\nA --> B(n)A\n");
    let count = "def StartEach(lstring):\n  global n\n  if n > 1:\n    return lstring\n  n = n + 1\n";
    assert_eq!(lpy(&model(count)), "B(1)B(2)B(2)B(2)A");
    let both =
        "def EndEach(lstring, scene):\n  global n\n  n += 1\n  if n > 2: return\n  n += 2\n  return lstring, scene\n";
    assert_eq!(lpy(&model(both)), "B(0)B(3)B(4)B(5)A");
    assert_eq!(lpy(&model("def Start():\n  return\n")), "B(0)B(0)B(0)B(0)A");
    // Another string would take the place of the one that is rewritten.
    for value in ["AxialTree(\"F(1)\")", "lstring + 1", "other"] {
        let text = format!("{}endlsystem\n", model(&format!("def Start(lstring):\n  return {value}\n")));
        let said = try_read(&text).err().map_or_else(String::new, |e| e.to_string());
        assert!(said.contains("L007") && said.contains("returns another string") && said.contains("line 3"), "{said}");
    }
}

#[test]
fn functions_of_lpy_that_are_not_run_are_told() {
    let model = |head: &str| format!("n = 1\n{head}Axiom: A\nproduction:\nA --> B(n)\nendlsystem\n");
    for (name, lines, is_told) in [
        ("End", "  global n\n  n = 5\n", true),
        ("StartInterpretation", "  global n\n  n = 5\n", true),
        ("End", "  for m in lstring: print(m)\n", true),
        ("End", "  print('ready')\n  return lstring\n", false),
        ("PostDraw", "  pass\n", false),
    ] {
        let (_, told) = read(&model(&format!("def {name}(lstring):\n{lines}")));
        let of = told.iter().filter(|d| d.code == "L008" && d.message == format!("the function '{name}' is not run"));
        assert_eq!(of.count(), usize::from(is_told), "{name} {lines}: {told:?}");
    }
    let said = try_read(&model("def End(lstring):\n  return makestring('F')\n"));
    assert!(said.is_err_and(|e| e.to_string().contains("returns another string")));
}

#[test]
fn the_turtle_of_lpy_is_set_wherever_a_model_does() {
    let angle = |head: &str| {
        let (g, warnings) = read(&format!("{head}Axiom: F+F\nproduction:\nendlsystem\n"));
        let told = warnings.iter().filter(|w| w.code == "L008").count();
        (g.program.turtle.as_ref().and_then(|t| t.settings.angle_deg).map_or_else(String::new, |a| a.to_string()), told)
    };
    assert_eq!(angle("context().turtle.setAngleIncrement(90)\n"), ("90".to_owned(), 0));
    assert_eq!(angle("b = 25\ncontext().turtle.setAngleIncrement( 2*b )\n"), ("50".to_owned(), 0));
    assert_eq!(angle("def Start():\n  context().turtle.setAngleIncrement(30)\n"), ("30".to_owned(), 0));
    assert_eq!(angle("context().turtle.angle_increment = 40;\n"), ("40".to_owned(), 0));
    assert_eq!(angle("context().turtle.setAngleIncrement(unknown)\n"), (String::new(), 1));
    assert_eq!(angle("context().turtle.setDefaultStep(3)\n"), (String::new(), 1));
    // A value of the model may have the name of a member.
    assert_eq!(lpy("angle_increment = 30\nAxiom: +(angle_increment)F\nproduction:\n"), "+(30)F");
}

#[test]
fn models_of_lpy_write_a_star_for_no_context_and_lambdas_for_functions() {
    let model = "grow = lambda x : 2*x\nhalf = lambda x, y : (x+y)/2.\nAxiom: A(1)B\nderivation length: 1\nproduction:\n\
                 * < A(x) > B --> A(grow(x))\nA(x) < B > * --> B(half(x,4))\n";
    assert_eq!(lpy(model), "A(2)B(2.5)");
}

#[test]
fn models_of_lpy_may_declare_values_that_others_can_set() {
    let model = "from math import pi\nextern(n = 3)\nextern(a = 2*n, turn = [10, 20],\n       b = -1)\n\
                 Axiom: A(n)\nderivation length: b+3\nproduction:\nA(x) --> +(turn[1])F(a)A(x+b)\n";
    // Two steps from A(3).
    assert_eq!(lpy(model), "+(20)F(6)+(20)F(6)A(1)");
    // The slider that L-Py saved after the model has set n.
    let saved = "extern(n = 3)\nAxiom: A(n)\nproduction:\nB --> C\nendlsystem\n\
                 def __initialiseContext__(context):\n\tscalars = [('n', 'Integer', 5, 0, 10)]\n";
    assert_eq!(lpy(saved), "A(5)");
    // Older files have no type before the value.
    let old = saved.replace("'n', 'Integer', 5, 0, 10", "'m', False, False, True), ('n', 7, 0, 10");
    assert_eq!(lpy(&old), "A(7)");
}

#[test]
fn names_of_several_letters_are_written_in_texts() {
    for (text, wanted) in [
        ("module Leaf\nAxiom: Leaf A\nderivation length: 2\nproduction:\nA --> Leaf A\nendlsystem\n", "LeafLeafLeafA"),
        // A comma of Fractint is a symbol with a name, too.
        ("One {\nAngle 4\nAxiom F,\nF=F,F\n}\n", "f,f,f,f,f,f,f,f,f,f,f,f,f,f,f,f,"),
    ] {
        let (g, _) = read(text);
        let limits = Limits::default();
        let d = crate::derive_text(&g, &DeriveOptions::default(), &limits).expect("derives");
        assert_eq!(d.into_text(&g, &limits).expect("derives"), wanted);
    }
}

#[test]
fn colors_of_lpy_given_by_red_green_and_blue_take_the_last_indices() {
    let model = "g = 200\nAxiom: SetColor(45,g,g)F SetColor(1,2,3)F SetColor(45,200,100*2,9)F SetColor(7)A(5)\nproduction:\n\
                 A(x) --> SetColor(x,x,x)F\nendlsystem\ndef __initialiseContext__(context):\n\
                 \tcontext.turtle.setMaterial(254,Material((9,9,9)))\n";
    let (g, warnings) = read(model);
    let d = derive(&g, &DeriveOptions::default(), &Limits::default()).expect("derives");
    // 255 for the first colour; 254 is taken; x is not constant.
    assert_eq!(g.print(&d.modules), "SetColor(255)FSetColor(253)FSetColor(255)FSetColor(7)SetColor(5,5,5)F");
    assert_eq!(g.palette(), [(254, [9, 9, 9]), (255, [45, 200, 200]), (253, [1, 2, 3])]);
    assert_eq!(warnings.iter().map(|d| d.code).collect::<Vec<_>>(), ["L008"]);
}

#[test]
fn models_of_lpy_may_hold_lists() {
    let model =
        |head: &str, rules: &str| lpy(&format!("{head}\nAxiom: A(2)\nderivation length: 1\nproduction:\n{rules}\n"));
    // By a constant, from the end, by a parameter, and of lists within lists.
    assert_eq!(model("c = [5, 6,\n     7]", "A(x) --> B(c[0],c[-1],c[x],c[x-3])"), "B(5,7,7,7)");
    assert_eq!(model("t = ((1, 2), (3, 4))", "A(x) --> B(t[1][0],t[0][-1])"), "B(3,2)");
    assert_eq!(model("STEM, LEAF = range(2)\na, b = (8, 9)", "A(x) --> B(STEM,LEAF,a,b)"), "B(0,1,8,9)");
    // Lengths, sums, least and greatest values; 0 1 4 9 are the squares of 0 to 3.
    let head = "q = [k*k for k in range(4)]\nw = [q[i]+i for i in range(len(q))]";
    assert_eq!(model(head, "A(x) --> B(len(q),sum(q),max(q),min(w),w[3])"), "B(4,14,9,0,12)");
    // x + 0, x + 1, x + 2 with x = 2.
    assert_eq!(model("", "A(x) --> B(sum([x+i for i in range(3)]),sum(x*i for i in range(3)))"), "B(9,6)");
    // Loops over lists.
    let loops = "A(x):\n  for v in q:\n    nproduce B(v)\n  for v in [7, 4]:\n    nproduce C(v)\n";
    assert_eq!(model("q = [3, 1]", loops), "B(3)B(1)C(7)C(4)");
    let said = |rule: &str| {
        let text = format!(
            "r = [random() for k in range(3)]\nq = [1]\nAxiom: A(2)\nproduction:\nA(x) --> {rule}\nendlsystem\n"
        );
        try_read(&text).err().map_or_else(String::new, |e| e.to_string())
    };
    assert!(said("F(q)").contains("a list or an index"), "{}", said("F(q)"));
    assert!(said("B(q[1])").contains("an index outside of its list"), "{}", said("B(q[1])"));
    assert!(said("B(r[0])").contains("L007"), "{}", said("B(r[0])"));
    assert!(said("B(sum(range(x)))").contains("a range that is not constant"), "{}", said("B(sum(range(x)))"));
}

#[test]
fn models_of_lpy_may_look_values_up_in_lists_of_lists() {
    let model = |head: &str, rule: &str| format!("{head}\nAxiom: A(0)A(1)A(2)\nproduction:\nA(x) --> {rule}\n");
    let q = "q = [(10, 60), (20, 45), (30, 20)]";
    for (rule, wanted) in [
        ("B(q[x][1])", "B(60)B(45)B(20)"),
        ("B(q[x][0]+q[2-x][-1])", "B(30)B(65)B(90)"),
        ("B(q[x][x-1])", "B(60)B(20)B(20)"),
        ("B(q[x if x < 2 else 0][0])", "B(10)B(20)B(10)"),
    ] {
        assert_eq!(lpy(&model(q, rule)), wanted, "{rule}");
    }
    // A function that gives one of two lists.
    let f = "def f(a):\n  if a > 1: return (a, 7)\n  return [a+1, 5]";
    assert_eq!(lpy(&model(f, "B(f(x)[0],f(x)[1])")), "B(1,5)B(2,5)B(2,7)");
    for (rule, why) in [
        ("B(q[x])", "a list or an index"),
        ("B(q[x][2])", "an index outside of its list"),
        ("B(q[x][0][0])", "a list or an index"),
        ("B(q[int(random()*3)][0])", "a random number as an index"),
    ] {
        let said =
            try_read(&format!("{}endlsystem\n", model(q, rule))).err().map_or_else(String::new, |e| e.to_string());
        assert!(said.contains("L007") && said.contains(why), "{rule}: {said}");
    }
    // Each lookup names its index twice for each item: this one would be as large as all memory.
    let long: Vec<String> = (0..200).map(|k| k.to_string()).collect();
    let long = format!("q = [{}]", long.join(","));
    let said = try_read(&format!("{}endlsystem\n", model(&long, "B(q[q[q[q[q[x]]]]])")));
    let said = said.err().map_or_else(String::new, |e| e.to_string());
    assert!(said.contains("grows too large"), "{said}");
}

#[test]
fn models_of_lpy_may_look_a_value_up_in_a_list() {
    let model = |head: &str, axiom: &str, test: &str| {
        format!("{head}Axiom: {axiom}\nproduction:\nA(x):\n  if {test}: produce B\n  produce C\n")
    };
    for (head, test, wanted) in [
        ("", "x in (1, 3)", "BCB"),
        ("", "x not in [1, 3]", "CBC"),
        ("q = [2, 3]\n", "x in q and not x in [3]", "CBC"),
        ("", "x in range(2)", "BCC"),
        ("", "x+1 in [k*k for k in range(3)]", "CCB"),
        ("", "x in []", "CCC"),
        ("", "1 < x in (1, 2)", "CBC"),
    ] {
        assert_eq!(lpy(&model(head, "A(1)A(2)A(3)", test)), wanted, "{test}");
    }
    assert_eq!(lpy(&model("kinds = ('leaf', 'bud')\n", "A('leaf')A('root')", "x in kinds")), "BC");
    assert_eq!(lpy("Axiom: A(1)A(2)\nproduction:\nA(x if x in [2]) --> B\n"), "A(1)B");
    for (test, why) in [("x in 3", "other than a list"), ("random() in [1]", "a random number before 'in'")] {
        let text = format!("{}endlsystem\n", model("", "A(1)", test));
        let said = try_read(&text).err().map_or_else(String::new, |e| e.to_string());
        assert!(said.contains("L007") && said.contains(why), "{test}: {said}");
    }
}

#[test]
fn loops_of_lpy_may_go_over_enumerate_and_zip() {
    let model = |turns: &str, made: &str| {
        format!("q = [5, 6]\nAxiom: A\nproduction:\nA:\n  for {turns}:\n    nproduce {made}\n")
    };
    for (turns, made, wanted) in [
        ("i, v in enumerate(q)", "B(i,v)", "B(0,5)B(1,6)"),
        ("(i, v) in enumerate([4, 8, 9])", "B(i,v)", "B(0,4)B(1,8)B(2,9)"),
        ("i, v in enumerate(q, 1)", "B(i,v)", "B(1,5)B(2,6)"),
        ("i, v in enumerate(q, start=3)", "B(i,v)", "B(3,5)B(4,6)"),
        ("a, b in zip([1, 2], [3, 4, 5])", "B(a,b)", "B(1,3)B(2,4)"),
        ("a, b, c in zip(q, range(3), [7, 8, 9])", "B(a,b+c)", "B(5,7)B(6,9)"),
    ] {
        assert_eq!(lpy(&model(turns, made)), wanted, "{turns}");
    }
    // In a function, and within one another.
    let head = "def total(n):\n  s = 0\n  for i, v in enumerate([2, 3, 4]):\n    for a, b in zip([1, 2], [5, 6]):\n      \
                s += i*v*a + b\n  return s*n\n";
    // 3 * (3 * 1 + 4 * 2) + 3 * 11.
    assert_eq!(lpy(&format!("{head}Axiom: A(1)\nproduction:\nA(x) --> B(total(x))\n")), "B(66)");
    for turns in
        ["a, b in q", "a, b in enumerate(q, 1, 2)", "a, b, c in zip(q, q)", "a, b in items(q)", "a+b, c in [(1, 2)]"]
    {
        let said =
            try_read(&format!("{}endlsystem\n", model(turns, "B"))).err().map_or_else(String::new, |e| e.to_string());
        assert!(said.contains("L007"), "{turns}: {said}");
    }
}

#[test]
fn loops_of_lpy_may_go_over_lists_of_lists() {
    let model = |turns: &str, made: &str| {
        format!("q = [(1, 2), (3, 4)]\nAxiom: A\nproduction:\nA:\n  for {turns}:\n    {made}\n")
    };
    for (turns, made, wanted) in [
        ("x, y in q", "nproduce B(x,y)", "B(1,2)B(3,4)"),
        ("(x, y) in [[5, -6], [7, 8]]", "nproduce B(x,y)", "B(5,-6)B(7,8)"),
        ("p in q", "nproduce B(p)", "B(1,2)B(3,4)"),
        ("p in q", "nproduce B(p[1],p[0],len(p))", "B(2,1,2)B(4,3,2)"),
        ("p in q", "if p[0] > 1: nproduce B(p[1])", "B(4)"),
        ("p in q", "for v in p: nproduce B(v)", "B(1)B(2)B(3)B(4)"),
        ("i, (x, y) in enumerate(q)", "nproduce B(i,x,y)", "B(0,1,2)B(1,3,4)"),
        ("i, p in enumerate(q)", "nproduce B(i,p[1])", "B(0,2)B(1,4)"),
        ("i, (p, s) in enumerate(zip(q, [8, 9]))", "nproduce B(i,p[0],s)", "B(0,1,8)B(1,3,9)"),
        ("p in zip(q, [8, 9])", "nproduce B(p[0][1],p[1])", "B(2,8)B(4,9)"),
        ("(a, b), (c, d) in zip(q, [[5, 6], [7, 8]])", "nproduce B(a,b,c,d)", "B(1,2,5,6)B(3,4,7,8)"),
        // The item that a turn takes apart itself.
        ("p, r in zip([[1, 2], [4, 5]], [7, 8])", "x, y = p\n    nproduce B(x,y,r)", "B(1,2,7)B(4,5,8)"),
    ] {
        assert_eq!(lpy(&model(turns, made)), wanted, "{turns}");
    }
    let head = "def area(n):\n  s = 0\n  for w, h in [(1, 2), (3, 4)]: s += w*h\n  return s*n\n";
    assert_eq!(lpy(&format!("{head}Axiom: A(area(1))A(area(2))\nproduction:\nX --> Y\n")), "A(14)A(28)");
    for (turns, made) in [("p in q", "p = 3"), ("x, y, z in q", "nproduce B(z)")] {
        let said =
            try_read(&format!("{}endlsystem\n", model(turns, made))).err().map_or_else(String::new, |e| e.to_string());
        assert!(said.contains("L007"), "{turns} {made}: {said}");
    }
}

/// 256 ways through a loop of 1500 turns are refused, though each of them is within its own bounds.
#[test]
fn ways_of_lpy_through_long_loops_are_bounded_together() {
    let model = |ifs: usize, turns: usize| {
        let names: Vec<String> = (0..8).map(|i| format!("p{i}")).collect();
        let tests: String = names[..ifs].iter().map(|p| format!("  if {p} > 0: x = x+{p}\n")).collect();
        let head = names.join(",");
        format!(
            "Axiom: A(1,0,0,0,0,0,0,2)\nproduction:\nA({head}):\n  x = 0\n{tests}  for i in range({turns}): x = x+i\n  \
             nproduce B(x)\n"
        )
    };
    assert_eq!(lpy(&model(1, 4)), "B(7)");
    let said = try_read(&format!("{}endlsystem\n", model(8, 1500))).err().map_or_else(String::new, |e| e.to_string());
    assert!(said.contains("too many statements on all ways"), "{said}");
}

#[test]
fn assignments_of_lpy_may_change_by_any_operator() {
    // 3, 9, 9 // 4 = 2, 2 % 5 = 2, 2 / 4, 0.5 - 1, -0.5 + 3.
    let changes = "  x *= 3\n  x **= 2\n  x //= 4\n  x %= 5\n  x /= 4\n  x -= 1\n  x += 3\n";
    assert_eq!(lpy(&format!("Axiom: A(1)\nproduction:\nA(x):\n{changes}  produce B(x)\n")), "B(2.5)");
}

#[test]
fn productions_of_lpy_may_hold_lists() {
    let model = |lines: &str| format!("q = [[1, 2], [3, 4]]\nAxiom: A(5)\nproduction:\nA(x):\n{lines}");
    for (lines, wanted) in [
        ("  for v in [x, -x, 30]: nproduce B(v)\n", "B(5)B(-5)B(30)"),
        ("  p = [1, x]\n  p += [2]\n  nproduce B(p[2],len(p))\n", "B(2,3)"),
        ("  p = [10, -20]\n  for v in p: nproduce B(v)\n", "B(10)B(-20)"),
        // The items are taken where the list is made.
        ("  p = [x, x+1]\n  x = 0\n  nproduce B(p[0],p[1],len(p))\n", "B(5,6,2)"),
        ("  p = (1, 2)\n  p = (p[1], p[0])\n  nproduce B(p[0],p[1])\n", "B(2,1)"),
        ("  y = 7\n  for v in [y, y]:\n    y = v+1\n    nproduce B(v)\n", "B(7)B(7)"),
        ("  for i in range(2):\n    p = [i, i+x]\n    nproduce B(p[0],p[1])\n", "B(0,5)B(1,6)"),
        ("  p = [1]\n  if x > 3: p = [2, 3]\n  for v in p: nproduce B(v)\n", "B(2)B(3)"),
        ("  p = q[1]\n  a, b = p\n  nproduce B(a,b,sum(p))\n", "B(3,4,7)"),
        ("  p = [30*k for k in range(3)]\n  nproduce B(p[x-3],max(p))\n", "B(60,60)"),
        ("  p = [[x, 1], [2, x]]\n  for a, b in p: nproduce B(a,b)\n", "B(5,1)B(2,5)"),
        ("  for p in [[x, 1], [2, x]]: nproduce B(p[0],p[1])\n", "B(5,1)B(2,5)"),
        ("  p = [1, x]\n  if len(p) > 1: nproduce B(len(p))\n  nproduce B(*p)\n", "B(2)B(1,5)"),
        (
            "  n = x-3\n  p = [n]*2 + [k*n for k in q[0]]\n  for i in range(len(p)): nproduce B(p[i])\n",
            "B(2)B(2)B(2)B(4)",
        ),
        ("  p = [5, 6, 7]\n  i, s = 0, 0\n  while i < x-2:\n    s += p[i]\n    i += 1\n  nproduce B(s)\n", "B(18)"),
    ] {
        assert_eq!(lpy(&model(lines)), wanted, "{lines}");
    }
    // An item that is drawn is drawn once.
    let drawn = lpy(&model("  p = [randint(1,1000000), 0]\n  nproduce B(p[0],p[0])\n"));
    let (a, b) = drawn.split_once(',').unwrap_or_default();
    assert_eq!(a.trim_start_matches("B("), b.trim_end_matches(')'), "{drawn}");
    let said = try_read(&format!("{}endlsystem\n", model("  p = [1, x]\n  nproduce F(p)\n")));
    assert!(said.is_err_and(|e| e.to_string().contains("L007")));
}

#[test]
fn lists_of_lpy_may_change() {
    let head = "m = [1]\nm.extend([2, 3])\nm.append(9)\nm[0] += 4\nd = {}\nd['a'] = 4\nd['b'] = 5\nd['a'] = 6\nlast = m.pop()\n\
                def squares(n):\n  q = []\n  for i in range(n): q.append(i*i)\n  return q\nr = squares(3)\nr.append(7)\n";
    let model = |lines: &str| format!("{head}Axiom: A(5)\nderivation length: 1\nproduction:\nA(x):\n{lines}");
    for (lines, wanted) in [
        ("  nproduce B(m[0],len(m),last,d['a'],d['b'])\n", "B(5,3,9,6,5)"),
        ("  q = []\n  for i in range(3): q.append(2**i)\n  for v in q: nproduce B(v)\n", "B(1)B(2)B(4)"),
        // Items are taken when they are added.
        ("  q = [x]\n  q.append(x+1)\n  x = 0\n  q.extend([7, x])\n  x = 3\n  nproduce B(*q)\n", "B(5,6,7,0)"),
        ("  q = [1, 2, 3]\n  q[1] = 9\n  q[-1] += x\n  nproduce B(q[1],q[2],sum(q))\n", "B(9,8,18)"),
        (
            "  q = [1, 2, 3]\n  v = q.pop()\n  w = q.pop(0)\n  q.insert(0, 7)\n  nproduce B(v,w,q[0],len(q))\n",
            "B(3,1,7,2)",
        ),
        ("  q = [3, 1, 2]\n  q.sort()\n  q.reverse()\n  nproduce B(*q)\n", "B(3,2,1)"),
        ("  q = []\n  i = 0\n  while i < 3:\n    q.append(i*i)\n    i += 1\n  nproduce B(sum(q))\n", "B(5)"),
        ("  q = [1]\n  if x > 3: q.append(2)\n  nproduce B(len(q))\n", "B(2)"),
        (
            "  p = [1, 2]\n  q = p[:]\n  r = list(p)\n  q.append(3)\n  r[0] = 4\n  nproduce B(len(p),len(q),r[0],p[0])\n",
            "B(2,3,4,1)",
        ),
        ("  q = squares(4)\n  q.append(x)\n  nproduce B(*q)\n  nproduce B(r[2],r[3])\n", "B(0,1,4,9,5)B(4,7)"),
    ] {
        assert_eq!(lpy(&model(lines)), wanted, "{lines}");
    }
    for (lines, why) in [
        ("  p = [1]\n  q = p\n  q.append(2)\n  nproduce B(len(p))\n", "the list 'q', which has two names"),
        ("  p = [1]\n  q = [p, 2]\n  p.append(2)\n  nproduce B(len(q[0]))\n", "the list 'p', which has two names"),
        (
            "  p = [[x, 1], [2, x]]\n  for q in p:\n    q.append(2)\n    nproduce B\n",
            "a change of 'q', an item of a list",
        ),
        ("  p = [1]\n  q = p\n  q += [2]\n  nproduce B(len(p))\n", "the list 'q', which has two names"),
        ("  q = [[1], [2]]\n  q[0][0] = 3\n  nproduce B\n", "an item within a list of lists"),
        ("  q = [1]\n  q[x] = 2\n  nproduce B\n", "this change of a list, 'set'"),
        ("  nproduce B(m[0])\na = [1]\nb = a\nb.append(2)\n", "the list 'b', which has two names"),
        ("  nproduce B(m[0])\nx.append(2)\n", "the list 'x', which is no list of known values"),
    ] {
        let said = try_read(&format!("{}endlsystem\n", model(lines))).err().map_or_else(String::new, |e| e.to_string());
        assert!(said.contains("L007") && said.contains(why), "{lines}: {said}");
    }
}

#[test]
fn functions_of_lpy_may_be_more_than_an_expression() {
    let head = "k = 2\ndef total(n):\n  s = 0\n  for i in range(n): s += i*k\n  return s\n\
                def rest(n, by = 3):\n  while n >= by: n -= by\n  return n\n\
                def noise(x):\n  r = randint(4,4)\n  if r*x > 20: return r*r\n  return r*r*x\n\
                def twice(n): return 2*total(n)\n\
                def both():\n  r = randint(1,1000000)\n  return r, r\n\
                def odd(n):\n  s, t = 0, n\n  while t > 0: t -= 1\n  for i in range(3):\n    i = 2*i + 1\n    s += i\n  return s\n\
                def pair(n):\n  l = []\n  for i in range(2): l = l + [i*n]\n  return l\n\
                def first(n):\n  for i in range(9):\n    if i*i >= n: return i\n  return 9\n\
                m = total(4)\np = pair(rest(8))\n";
    let model = |lines: &str| format!("{head}Axiom: A(5)\nproduction:\nA(x):\n{lines}");
    for (lines, wanted) in [
        ("  nproduce B(total(3),total(x),twice(x))\n", "B(6,20,40)"),
        ("  n = 7\n  nproduce B(rest(x)+rest(n,4),n)\n", "B(5,7)"),
        ("  s = 1\n  nproduce B(noise(1),noise(x+1),s)\n", "B(16,16,1)"),
        ("  a, b = pair(x)\n  if total(2) > 1: nproduce B(a,b,first(x))\n", "B(0,5,3)"),
        ("  k = 1\n  nproduce B(total(x),k)\n", "B(20,1)"),
        ("  for i in range(total(2)): nproduce B(i,total(total(x)))\n", "B(0,380)B(1,380)"),
        // One value of two items.
        ("  a, b = both()\n  nproduce B(a-b)\n", "B(0)"),
        // A variable of a loop that the function sets.
        ("  nproduce B(odd(3),odd(x-2))\n", "B(9,9)"),
        ("  nproduce B(m,p[1])\n", "B(12,2)"),
    ] {
        assert_eq!(lpy(&model(lines)), wanted, "{lines}");
    }
    assert_eq!(lpy(&format!("{head}Axiom: A(rest(11),total(3))\nproduction:\nX --> Y\n")), "A(2,6)");
    let said = try_read(&format!("{}endlsystem\n", model("  nproduce B(total(x,2))\n"))).err();
    let said = said.map_or_else(String::new, |e| e.to_string());
    assert!(said.contains("L007") && said.contains("this call of 'total'"), "{said}");
}

#[test]
fn lists_of_lpy_may_be_cut() {
    let model =
        |lines: &str| format!("q = [1, 2, 3, 4]\nAxiom: A(2)\nproduction:\nw = q[1:]\nm = {{1: 2}}\nA(x):\n{lines}");
    for (lines, wanted) in [
        ("  for v in q[1:]: nproduce B(v)\n", "B(2)B(3)B(4)"),
        ("  for v in q[:-1] + q[9:]: nproduce B(v)\n", "B(1)B(2)B(3)"),
        ("  for v in q[::-2]: nproduce B(v)\n", "B(4)B(2)"),
        ("  nproduce B(len(q[1:3]),len(q[:]),len(q[3:1]),len(q[-9:2]),len(q[2::-1]),w[0],m[1])\n", "B(2,4,0,2,3,2,2)"),
        ("  p = [x, x+1, x+2][1:]\n  if len(p[1:]) == 1: nproduce B(p[0],p[1])\n", "B(3,4)"),
        ("  for v in [k*k for k in q if k % 2 == 1 if k > 1]: nproduce B(v)\n", "B(9)"),
        ("  nproduce B(sum(k for k in q if k != 2),len([k if k > 1 else 0 for k in q]))\n", "B(8,4)"),
    ] {
        assert_eq!(lpy(&model(lines)), wanted, "{lines}");
    }
    for (lines, why) in [
        ("  nproduce B(len(q[x:]))\n", "a slice '[:]'"),
        ("  nproduce B(q[::0][0])\n", "a slice '[:]'"),
        ("  nproduce B(len([k for k in q if k > x]))\n", "a list with conditions"),
    ] {
        let said = try_read(&format!("{}endlsystem\n", model(lines))).err().map_or_else(String::new, |e| e.to_string());
        assert!(said.contains("L007") && said.contains(why), "{lines}: {said}");
    }
}

#[test]
fn derivation_lengths_of_lpy_may_end_with_a_semicolon() {
    let text = |axiom: &str| format!("{axiom}\nderivation length: 2; # steps\nproduction:\nA(x) --> A(x+1)B\n");
    assert_eq!(lpy(&text("Axiom: A(1)")), "A(3)BB");
    let plain = text("Axiom: A(1)").replace(" # steps", "");
    assert_eq!(lpy(&plain), "A(3)BB");
    // In L+C the axiom, too, ends with a semicolon.
    let said =
        try_read(&plain.replace("Axiom: A(1)", "Axiom: A(1);")).err().map_or_else(String::new, |e| e.to_string());
    assert!(said.contains("L007") && said.contains("cpfg"), "{said}");
}

#[test]
fn variables_of_lpy_may_be_set_on_some_ways_only() {
    let model = |lines: &str| format!("Axiom: A(1)A(2)A(3)\nproduction:\nA(x):\n{lines}");
    let some = model("  if x == 1: y = 5\n  elif x == 2: y = 6\n  if x == 3: produce C\n  produce B(y)\n");
    assert_eq!(lpy(&some), "B(5)B(6)C");
    let (_, told) = read(&format!("{some}endlsystem\n"));
    assert_eq!(told.iter().filter(|d| d.code == "L008" && d.message.contains("'y'")).count(), 1, "{told:?}");
    assert_eq!(
        lpy(&model("  i = 0\n  while i < x:\n    j = i\n    i += 1\n    nproduce C\n  produce B(j)\n")),
        "CB(0)CCB(1)CCCB(2)"
    );
    let said = try_read(&format!("{}endlsystem\n", model("  produce B(y)\n  y = 1\n"))).err();
    assert!(said.is_some_and(|e| e.to_string().contains("the unknown name 'y'")));
}

#[test]
fn statements_of_lpy_outside_of_productions_run() {
    let model = |lines: &str| format!("n = 3\n{lines}Axiom: A(x)\nproduction:\nA(k) --> B(k)\n");
    for (lines, wanted) in [
        ("if n > 2:\n  x = 1\nelif n > 1:\n  x = 2\nelse: x = 3\n", "B(1)"),
        ("if n > 5:\n  x = 1\nelse:\n  x = n\n  x += 4\n", "B(7)"),
        ("x = 0\nfor i in range(n): x += i\n", "B(3)"),
        ("x = 1\nwhile x < 50:\n  x *= n\nn = 1\n", "B(81)"),
        ("q = []\nfor i in range(n):\n  q = q + [i*i]\nx = len(q) + q[2]\n", "B(7)"),
        ("x = 0\nfor i in range(n):\n  if i == 9: break\nelse: x = 4\n", "B(4)"),
        ("x = 1\nfor i in range(n):\n  if i == 2: break\nelse:\n  x = 4\n", "B(1)"),
    ] {
        assert_eq!(lpy(&model(lines)), wanted, "{lines}");
    }
    let drawn = model("x = 0\nif random() < 0.5: x = 1\n");
    let said = try_read(&format!("{drawn}endlsystem\n")).err().map_or_else(String::new, |e| e.to_string());
    assert!(said.contains("L007") && said.contains("'if' outside of a production"), "{said}");
}

#[test]
fn models_of_lpy_may_have_dictionaries_of_constants() {
    let head = "k = 2\nd = {\n  'len': 3,   # metres\n  'angles': [10, 20*k],\n}\nages = {1: 5, k: 6, 3: 7}\nw = dict(a=1, b=2*k)\n\
                def f(name): return d[name]\n";
    let model = |lines: &str| format!("{head}Axiom: A(2)\nproduction:\nA(x):\n{lines}");
    for (lines, wanted) in [
        ("  nproduce B(d['len'],d['angles'][1],f(\"len\"))\n", "B(3,40,3)"),
        ("  nproduce B(ages[1],ages[x],ages[x+1])\n", "B(5,6,7)"),
        ("  for a in ages: nproduce B(a,ages[a])\n", "B(1,5)B(2,6)B(3,7)"),
        ("  for i, a in enumerate(ages): nproduce B(i,a)\n", "B(0,1)B(1,2)B(2,3)"),
        ("  for a, v in ages.items(): nproduce B(a,v)\n", "B(1,5)B(2,6)B(3,7)"),
        ("  nproduce B(sum(ages.values()),max(ages.keys()),len(ages),sum([a for a in ages]))\n", "B(18,3,3,6)"),
        ("  nproduce B(d.get('len',9),d.get('width',9),ages.get(x,8),ages.get(x+5,8))\n", "B(3,9,6,8)"),
        ("  if d.get('width') is None and not d.get('width'): nproduce B(w['a'],w['b'])\n", "B(1,4)"),
        ("  for v in d['angles']: nproduce B(v)\n  if x in ages and 'l' not in d: nproduce C\n", "B(10)B(40)C"),
    ] {
        assert_eq!(lpy(&model(lines)), wanted, "{lines}");
    }
    for (lines, why) in [
        ("  nproduce B(d['width'])\n", "a key that its dictionary does not have"),
        ("  nproduce B(ages)\n", "a dictionary"),
        ("  nproduce B({1, 2})\n", "a dictionary"),
        ("  nproduce B(ages.get(random(),1))\n", "a key of this dictionary"),
    ] {
        let said = try_read(&format!("{}endlsystem\n", model(lines))).err().map_or_else(String::new, |e| e.to_string());
        assert!(said.contains("L007") && said.contains(why), "{lines}: {said}");
    }
}

#[test]
fn functions_of_lpy_read_values_of_the_model() {
    let head = "a = 3\nq = [5, 6]\nd = randint(4,4)\nc = 1\ndef f(x): return x*a\ng = lambda i: q[i] + len(q)\n\
                def h(x): return d*x\ndef s(n):\n  t = 0\n  for i in range(n): t += a + q[i]\n  return t\ndef k(): return c\n";
    let model = |rule: &str| format!("{head}Axiom: A(7)\nproduction:\n{rule}\n");
    for (rule, wanted) in [
        ("A(a) --> B(f(a),f(2))", "B(21,6)"),
        ("A(q) --> B(g(1),q)", "B(8,7)"),
        ("A(d):\n  a = d\n  produce B(h(a),a)", "B(28,7)"),
        ("A(a):\n  q = [1, a]\n  produce B(s(2),q[1])", "B(17,7)"),
        // A variable of the model that the production changes is the one that the function reads.
        ("A(x):\n  global c\n  c += x\n  produce B(k())", "B(8)"),
        // What follows a production does not know its variables.
        ("C(e) --> D(e)\nm = e + 1 > 3.7\nA(x) --> B(m)", "B(1)"),
    ] {
        assert_eq!(lpy(&model(rule)), wanted, "{rule}");
    }
}

#[test]
fn axioms_of_lpy_may_have_loops() {
    let model = |lines: &str| format!("n = 3\nAxiom:\n{lines}derivation length: 1\nproduction:\nA --> B\n");
    for (lines, wanted) in [
        ("  i = 0\n  while i < n: i += 1\n  nproduce F(i)\n", "F(3)"),
        ("  i = 0\n  while True:\n    i += 1\n    if i > n: break\n  nproduce F(i)A\n", "F(4)B"),
        (
            "  s = 0\n  for i in range(n):\n    j = 0\n    while j < i:\n      s += 1\n      j += 1\n  nproduce F(s)\n",
            "F(3)",
        ),
    ] {
        assert_eq!(lpy(&model(lines)), wanted, "{lines}");
    }
    // A variable of the block hides a value of the model there and nowhere else.
    let hides = "x = 1\nAxiom:\n  x = 2\n  x += 5\n  nproduce A(x)\nproduction:\nA(k) --> B(k,x)\n";
    assert_eq!(lpy(hides), "B(7,1)");
    let drawn = model("  s = 0\n  for i in range(randint(1,3)): s += i\n  nproduce F(s)\n");
    let said = try_read(&format!("{drawn}endlsystem\n")).err().map_or_else(String::new, |e| e.to_string());
    assert!(said.contains("L007") && said.contains("a loop of the axiom"), "{said}");
}

#[test]
fn loops_of_lpy_may_begin_anywhere() {
    let model = |lines: &str| format!("Axiom: A(5)\nproduction:\nA(x):\n{lines}");
    for (lines, wanted) in [
        ("  for i in range(1,x): nproduce B(i)\n", "B(1)B(2)B(3)B(4)"),
        ("  for i in range(x,1,-2): nproduce B(i)\n  nproduce C\n", "B(5)B(3)C"),
        ("  for i in range(x-2,x+2,3):\n    x = 0\n    nproduce B(i,x)\n", "B(3,0)B(6,0)"),
        ("  for i in range(2,x+1):\n    if i == 4: continue\n    nproduce B(i)\n", "B(2)B(3)B(5)"),
        ("  s = 0\n  for i in range(2,x+1): s += i\n  nproduce B(s)\n", "B(14)"),
        ("  k = 2\n  for i in range(x,0,-k): nproduce B(i)\n", "B(5)B(3)B(1)"),
        ("  for i in range(x,2): nproduce B(i)\n  nproduce C\n", "C"),
        ("  i = 2\n  while True:\n    i += 1\n    if i > x: break\n    nproduce B(i)\n", "B(3)B(4)B(5)"),
    ] {
        assert_eq!(lpy(&model(lines)), wanted, "{lines}");
    }
}

#[test]
fn functions_of_lpy_may_have_defaults_and_named_arguments() {
    let head = "w = 5\ndef f(x, k=2, n = w+1):\n  return x*k + n\ndef g(x: float, k: float = 3) -> float: return x-k\nw = 100\n";
    let model = |rule: &str| format!("{head}Axiom: A(10)\nproduction:\nA(x) --> {rule}\n");
    for (rule, wanted) in [
        ("B(f(x),f(x,3),f(x,3,4))", "B(26,36,34)"),
        ("B(f(x,n=1),f(k=x,x=4),f(x, k = x, n=0))", "B(21,46,100)"),
        ("B(g(x),g(x,k=4))", "B(7,6)"),
    ] {
        assert_eq!(lpy(&model(rule)), wanted, "{rule}");
    }
    for (rule, why) in [
        ("B(f())", "this call of 'f'"),
        ("B(f(1,2,3,4))", "this call of 'f'"),
        ("B(f(1,z=4))", "this call of 'f'"),
        ("B(sin(x=1))", "an argument with a name"),
        ("B(f(1,k=2 3))", "where an operator is expected"),
    ] {
        let said = try_read(&format!("{}endlsystem\n", model(rule))).err().map_or_else(String::new, |e| e.to_string());
        assert!(said.contains("L007") && said.contains(why), "{rule}: {said}");
    }
}

#[test]
fn random_arguments_of_lpy_may_be_used_once() {
    let head = "def f(x): return 2*x + 1\ndef g(x): return x*x\ndef h(x): return x if x > 1 else 0\n\
                def k(x, c): return x if c else -x\ndef s(x): return sum([x*i for i in range(3)])\ndef t(x): return f(f(x))\n";
    let model = |rule: &str| format!("{head}Axiom: A(0)\nproduction:\nA(x) --> {rule}\n");
    assert_eq!(lpy(&model("B(f(randint(3,3)),k(randint(3,3),x),t(randint(1,1)))")), "B(7,-3,7)");
    for function in ["g", "h", "s"] {
        let text = format!("{}endlsystem\n", model(&format!("B({function}(randint(3,3)))")));
        let said = try_read(&text).err().map_or_else(String::new, |e| e.to_string());
        assert!(said.contains("L007") && said.contains("this call of"), "{function}: {said}");
    }
}

#[test]
fn functions_of_lpy_may_call_themselves_with_known_numbers() {
    let head = "def fact(n):\n  if n <= 1: return 1\n  return n*fact(n-1)\n\
                def fib(n): return n if n < 2 else fib(n-1)+fib(n-2)\ndef up(n): return up(n+1)\nk = 4\n";
    let model = |rule: &str| format!("{head}Axiom: A(3)\nderivation length: 1\nproduction:\nA(x):\n  {rule}\n");
    for (rule, wanted) in [
        ("produce B(fact(k),fib(6+k),x)", "B(24,55,3)"),
        ("for i in range(4): nproduce B(fact(i+1))", "B(1)B(2)B(6)B(24)"),
        ("for i in range(4):\n    n = fib(i+3)\n    nproduce B(n)", "B(2)B(3)B(5)B(8)"),
        ("produce B(sum([fact(i) for i in range(5)]))", "B(34)"),
    ] {
        assert_eq!(lpy(&model(rule)), wanted, "{rule}");
    }
}

#[test]
fn texts_in_quotes_of_lpy_end_with_their_line_whatever_ends_it() {
    let unclosed = "Axiom: A(1)\nx = \"abc\nderivation length: 1\nproduction:\nA(n) --> F(n+x)\nendlsystem\n";
    // A backslash joins the next line to the text, a parenthesis continues after a blank line.
    let joined = "x = \"ab\\\nc\"\ny = max(1,\n\n  2)\nAxiom: A(1)\nderivation length: 1\nproduction:\n\
                  A(n):\n  if x == \"abc\": produce B(y)\n  produce C(n)\n";
    for end in ["\n", "\r\n", "\r"] {
        let said = try_read(&unclosed.replace('\n', end)).err().map_or_else(String::new, |e| e.to_string());
        assert!(said.contains("line 2: a text in quotes that does not end"), "{end:?}: {said}");
        assert!(said.contains(":2:5") && said.matches("error[").count() == 1, "{end:?}: {said}");
        assert_eq!(lpy(&joined.replace('\n', end)), "B(2)", "{end:?}");
    }
}

#[test]
fn refused_functions_of_lpy_tell_what_to_write_instead() {
    let saved = "def __initialiseContext__(context):\n\timport openalea.plantgl.all as pgl\n\twide = pgl.NurbsCurve2D(\n\t\t\
                 ctrlPointList = pgl.Point3Array([(0, 0, 1),(0.5, 1, 1),(1, 0, 1)]) ,\n\t\t)\n\twide.name = \"wide\"\n\
                 \tcontext[\"wide\"] = pgl.QuantisedFunction(wide)\n";
    let said = |rule: &str| {
        let text = format!(
            "n = 0\ndef inc():\n  global n\n  n = n + 1\nAxiom: A(1)\nderivation length: 1\nproduction:\nA(x):\n  {rule}\nendlsystem\n{saved}"
        );
        try_read(&text).err().map_or_else(String::new, |e| e.to_string())
    };
    for (rule, construct, remedy) in [
        ("produce F(wide(0.5)+wide)", "a curve where a number is expected", "call it, f(x)"),
        ("produce F(wide())", "a call of 'wide' with 0 arguments", "takes one number"),
        ("produce F(inc())", "the function 'inc', which may end without a value", "end it by 'return'"),
        ("produce F(makestring(x))", "the function 'makestring'", "write the modules themselves"),
    ] {
        let said = said(rule);
        assert!(said.contains("L007") && said.contains(construct) && said.contains(remedy), "{rule}: {said}");
    }
    assert_eq!(said("produce F(x)"), "");
}

/// What the editor of L-Py saves behind a model: `line` is 1 + 2x, `arch` the curve of Bézier with the control ordinates 0 1 1 0,
/// `heavy` has a weight, `road` lies in space.
const SAVED_CURVES: &str = "endlsystem\n###### INITIALISATION ######\n\n__lpy_code_version__ = 1.1\n\n\
    def __initialiseContext__(context):\n\timport openalea.plantgl.all as pgl\n\tline = pgl.NurbsCurve2D(\t\n\t    \
    ctrlPointList = pgl.Point3Array([(0, 1, 1),(0.2, 1.4, 1),(0.7, 2.4, 1),(1, 3, 1)]) , \n\t    )\n\tline.name = \"line\"\n\
    \tfunctions = [('arch', NurbsCurve2D(Point3Array([Vector3(0,0,1),Vector3(0,1,1),Vector3(1,1,1),Vector3(1,0,1)])))]\n\
    \theavy = pgl.NurbsCurve2D(pgl.Point3Array([(0, 1, 1),(1, 4, 2)]))\n\
    \troad = pgl.Polyline([(0,0,0),(1,1,1)])\n\
    \tcontext[\"line\"] = pgl.QuantisedFunction(line)\n";

/// Final string of a model of L-Py with these curves behind it; of a model that is refused the message.
fn with_curves(text: &str) -> String {
    let text = format!("{text}{SAVED_CURVES}");
    match try_read(&text) {
        Ok(_) => string(&text),
        Err(why) => why.to_string(),
    }
}

#[test]
fn functions_that_the_editor_of_lpy_saves_have_values() {
    let model = |head: &str, axiom: &str, rule: &str| {
        with_curves(&format!("{head}Axiom: {axiom}\nderivation length: 1\nproduction:\n{rule}\n"))
    };
    // 1 + 2x; beyond its ends the function keeps the values there. The arch is 3/4 high at its middle: 3 (1/8) + 3 (1/8).
    assert_eq!(model("", "A(0.25)", "A(x) --> F(line(x),line(-3),line(7))"), "F(1.5,1,3)");
    assert_eq!(model("", "A(0.5)", "A(x) --> F(arch(x))"), "F(0.75)");
    // Handed on: as a parameter of a module, of a function, and through a variable.
    assert_eq!(model("", "A(line)A(arch)", "A(f) --> F(f(0.5))"), "F(2)F(0.75)");
    assert_eq!(model("def twice(f,x): return 2*f(x)\n", "A(1)", "A(x) --> F(twice(line,x))"), "F(6)");
    assert_eq!(model("", "A(0)", "A(x):\n  f = line if x > 0 else arch\n  produce F(f(0.5))"), "F(0.75)");
    // Made by the model: a curve, points, and a curve of a function of the model.
    let own = "from openalea.plantgl.all import *\ndef f(u): return (u,u*u)\np = Polyline2D([f(u) for u in range(3)])\n\
               s = QuantisedFunction(BezierCurve2D([(0,0,1),(0,1,1),(1,1,1),(1,0,1)]))\nq = QuantisedFunction([(0,1),(4,9)])\n\
               g = lambda t: s(t)\n";
    assert_eq!(model(own, "A(1.5)", "A(x) --> F(p(x),g(0.5),q(1))"), "F(2.5,0.75,3)");
    for (rule, why) in [
        ("A(x) --> F(line)B(2*line)", "a curve where a number is expected"),
        ("A(x) --> F(heavy(x))", "a 'NurbsCurve2D' of other points, or of weights other than 1"),
        ("A(x) --> F(road(x))", "a call of 'road', a curve in space"),
        ("A(x) --> F(line(x,2))", "a call of 'line' with 2 arguments"),
        (
            "A(x):\n  c = Polyline2D([(0,0),(1,x)])\n  produce SetGuide(c,1)",
            "a 'Polyline2D' of points that are not constant",
        ),
    ] {
        let said = model("", "A(1)", rule);
        assert!(said.contains("L007") && said.contains(why), "{rule}: {said}");
    }
    // A number that stands for no function is told where it is called.
    let text = format!("Axiom: A(3)\nderivation length: 1\nproduction:\nA(f) --> F(f(1))\n{SAVED_CURVES}");
    let (g, _) = read(&text);
    let d = derive(&g, &DeriveOptions::default(), &Limits::default()).expect("derives");
    assert!(g.print(&d.modules) == "F(0)" && d.warnings.iter().any(|w| w.code == "L048"), "{:?}", d.warnings);
}

#[test]
fn functions_of_lpy_may_change_values_of_the_model() {
    let model = |rule: &str| {
        format!(
            "n = 0\nm = 5\ndef next(k=1):\n  global n\n  n += k\n  return n\ndef note(x):\n  global m\n  m = x\n\
             Axiom: A(1)A(2)\nderivation length: 1\nproduction:\n{rule}\n"
        )
    };
    // The modules are rewritten from left to right; two calls of a production run in their order.
    assert_eq!(lpy(&model("A(x):\n  k = next()\n  produce B(x,k)")), "B(1,1)B(2,2)");
    assert_eq!(lpy(&model("A(x) --> B(next(),next(10))")), "B(1,11)B(12,22)");
    assert_eq!(lpy(&model("A(x):\n  if next() > 1:\n    produce B(n)\n  produce C(n)")), "C(1)B(2)");
    assert_eq!(lpy(&model("A(x):\n  note(10*x)\n  produce B(m)")), "B(10)B(20)");
    // Only what a way runs is changed.
    assert_eq!(lpy(&model("A(x):\n  if x > 1:\n    k = next(7)\n  produce B(n)")), "B(0)B(7)");
    for (rule, why) in [
        ("A(x):\n  k = next() if x > 1 else 0\n  produce B(k)", "changes values of the model, behind a test"),
        ("A(x):\n  n = 3\n  k = next()\n  produce B(k)", "changes a 'n' that this production has, too"),
    ] {
        let said = try_read(&format!("{}endlsystem\n", model(rule))).err().map_or_else(String::new, |e| e.to_string());
        assert!(said.contains("L007") && said.contains(why), "{rule}: {said}");
    }
}

#[test]
fn functions_of_lpy_have_values_for_parameters_that_a_call_leaves_out() {
    let model =
        |head: &str, rule: &str| lpy(&format!("b = 3\n{head}Axiom: A(2)\nderivation length: 1\nproduction:\n{rule}\n"));
    assert_eq!(model("f = lambda x, k=b: x*k\n", "A(x) --> B(f(x),f(x,5),f(x,k=1))"), "B(6,10,2)");
    assert_eq!(model("", "A(x):\n  f = lambda y, k=4: y*k+x\n  produce B(f(1),f(1,k=0))"), "B(6,2)");
}

#[test]
fn modules_of_lpy_may_have_parameters_by_name() {
    let model = |rule: &str| {
        format!(
            "module Leaf(size, age)\nmodule Bud\nAxiom: Leaf(2, age=1)\nderivation length: 1\nproduction:\n{rule}\n"
        )
    };
    assert_eq!(lpy(&model("Leaf(s,a) --> Leaf(age=s,size=a)new('Bud',s)")), "Leaf(1,2)Bud(2)");
    for (rule, why) in [
        ("Leaf(s,a) --> Leaf(s,b=a)", "which are others than it declares"),
        ("Leaf(s,a) --> Bud(b=a)", "which no 'module' line declares"),
        ("Leaf(s,a) --> new(s,2)", "'new' of a name that is not written out"),
    ] {
        let said = try_read(&format!("{}endlsystem\n", model(rule))).err().map_or_else(String::new, |e| e.to_string());
        assert!(said.contains("L007") && said.contains(why), "{rule}: {said}");
    }
}

#[test]
fn texts_of_lpy_that_are_put_together_are_only_shown() {
    let model =
        |lines: &str| format!("names = ['a','b']\nAxiom: A(2)\nderivation length: 1\nproduction:\nA(x):\n{lines}");
    let lines = "  m = f\"x is {x}\"\n  n = 'a' + str(x)\n  o = '%d of %d' % (x, 3)\n  p = '{}'.format(x)\n  print(m)\n  \
                 produce B(x)[@L(n, 12)]\n";
    assert_eq!(lpy(&model(lines)), "B(2)[@L]");
    // Letters before other texts change nothing.
    assert_eq!(lpy(&model("  m = r'a'\n  produce B(1 if m == u'a' and f'a' == 'a' else 2)\n")), "B(1)");
    for lines in ["  m = f'{x}'\n  produce B(m)\n", "  if 'a' + str(x) == 'a2': produce B\n"] {
        let said = try_read(&format!("{}endlsystem\n", model(lines))).err().map_or_else(String::new, |e| e.to_string());
        assert!(said.contains("L007") && said.contains("a text that is put together"), "{lines}: {said}");
    }
}

#[test]
fn strings_of_lpy_are_read_where_they_are_written_out() {
    let model = |rule: &str| {
        format!("module Leaf\npattern = 'F(1)[+(30)Leaf]'\nAxiom: A\nderivation length: 1\nproduction:\nA:\n  {rule}\n")
    };
    assert_eq!(lpy(&model("nsproduce(makestring(pattern))\n  produce A")), "F(1)[+(30)Leaf]A");
    assert_eq!(lpy(&model("sproduce(Lstring(\"F(2)-F\"))")), "F(2)-F");
    let said = try_read(&format!("{}endlsystem\n", model("sproduce(makestring(pattern+'F'))")));
    let said = said.err().map_or_else(String::new, |e| e.to_string());
    assert!(said.contains("L007") && said.contains("made from something other than a text"), "{said}");
}

#[test]
fn models_of_lpy_may_stop() {
    // The third step is the last one: getIterationNb() counts from 0.
    let model = "def StartEach():\n  if getIterationNb() == 2: Stop()\nAxiom: A\nderivation length: 9\nproduction:\nA --> F A\n";
    assert_eq!(lpy(model), "FFFA");
    let said = try_read("Axiom: A\nproduction:\nA:\n  Stop()\n  produce F\nendlsystem\n");
    let said = said.err().map_or_else(String::new, |e| e.to_string());
    assert!(
        said.contains("L007") && said.contains("'Stop()' in a production") && said.contains("call it in StartEach"),
        "{said}"
    );
}

#[test]
fn vectors_of_lpy_have_angles_and_copies() {
    let rule = "from copy import deepcopy\nq = [1,2]\np = deepcopy(q)\np[0] = 7\nAxiom: A(Vector3(0,0,2))\nderivation length: 1\nproduction:\n\
                A(v):\n  w = deepcopy(v)\n  d = degrees(angle(v, Vector3(3,0,0)))\n  e = degrees(angle(Vector2(1,0),Vector2(0,-2)))\n  \
                produce B(round(d), round(e), w.z, q[0], p[0])\n";
    assert_eq!(lpy(rule), "B(90,-90,2,1,7)");
}

#[test]
fn objects_of_lpy_are_numbers_for_their_attributes() {
    let class = "class State:\n  \"\"\" of an apex \"\"\"\n  kind = 7\n  def __init__(self, age=0, order=0):\n    self.age = age\n    \
                 self.order = order\n    self.limit = 2+self.order\n  def __str__(self):\n    return str(self.age)\n";
    let model = |axiom: &str, steps: u32, rules: &str| {
        format!(
            "{class}from copy import deepcopy\nmodule Apex, Node\nAxiom: {axiom}\nderivation length: {steps}\nproduction:\n{rules}"
        )
    };
    // Attributes: kind, age, order, limit. Age is 1.5 after the first step, and 2 in the second one.
    let grows = "Apex(p):\n  p.age += 0.5\n  if p.age >= p.limit:\n    produce Node(p.order)[Apex(State(0,p.order+1))]Apex(p)\n  produce Apex(p)\n";
    assert_eq!(lpy(&model("Apex(State(age=1))", 1, grows)), "Apex(7,1.5,0,2)");
    assert_eq!(lpy(&model("Apex(State(age=1))", 2, grows)), "Node(0)[Apex(7,0,1,3)]Apex(7,2,0,2)");
    // Attributes given by name, objects that modules hand on, copies, an attribute with the name of a coordinate.
    let set = "Axiom: A(ParameterSet(Q=2,x=1))\nderivation length: 2\nproduction:\nA(d) --> B(d)[C(deepcopy(d))]\nB(d) --> D(d.Q+1,d.x)\n\
               C(d):\n  e = deepcopy(d)\n  e.Q = 5\n  produce D(d.Q,e.Q)\n";
    assert_eq!(lpy(set), "D(3,1)[D(2,5)]");
    // A function changes the object that it is given; an object of the model is read.
    let changed = "P = ParameterSet(rate=3)\ndef grow(d):\n  d.Q *= P.rate\nAxiom: I(ParameterSet(Q=2))\nderivation length: 2\nproduction:\n\
                   I(d):\n  grow(d)\n  produce I(d)\n";
    assert_eq!(lpy(changed), "I(18)");
    // As a context, and in an interpretation.
    let seen = "Axiom: I(ParameterSet(Q=2))A\nderivation length: 1\nproduction:\nI(d) < A --> F(d.Q)\ninterpretation:\nI(d) --> f(d.Q)\n";
    assert_eq!(lpy(seen), "I(2)F(2)");
    for (rules, why) in [
        ("Apex(p):\n  p.age += 1\n  produce Apex(p)Node(p)\n", "the object 'p' in two places"),
        ("Apex(p):\n  nproduce Apex(p)\n  p.age += 1\n", "the object 'p' in two places"),
        ("Apex(p):\n  p.age += 1\n  if p.age > 9: produce Apex(p)\n", "a change of 'p' on a way that makes no modules"),
        ("Apex(p):\n  p.size = 1\n  produce Apex(p)\n", "an attribute 'size' that this value does not have"),
        ("Apex(p) --> Node(p.size)\n", "an attribute 'size' that this value does not have"),
        ("Apex(p) --> Node(1+p)\n", "an object where a number is expected"),
        ("Apex(p) --> F(p)\n", "an object as a parameter of the command 'F'"),
        ("Apex(p) --> Node(State(1,2,3))\n", "this call of the class 'State'"),
        ("Apex(p) --> Apex(ParameterSet(a=1,b=2,c=3,d=4))\n", "with an object of 4 attributes as its parameters"),
    ] {
        let text = format!("{}endlsystem\n", model("Apex(State())", 1, rules));
        let said = try_read(&text).err().map_or_else(String::new, |e| e.to_string());
        assert!(said.contains("L007") && said.contains(why), "{rules}: {said}");
    }
    let other = "class S:\n  def __init__(self):\n    self.a = 1\n  def __add__(self, other):\n    self.a += 1\nAxiom: A(S())\nproduction:\nA(s) --> A(s)\nendlsystem\n";
    let said = try_read(other).err().map_or_else(String::new, |e| e.to_string());
    assert!(
        said.contains("L007") && said.contains("the function 'S' (line 4: the function '__add__' of a class)"),
        "{said}"
    );
}

#[test]
fn items_of_lists_and_dictionaries_of_lpy_may_be_taken_out() {
    let model = |head: &str, rule: &str| {
        lpy(&format!("{head}Axiom: A(1)A(0)\nderivation length: 1\nproduction:\nA(x):\n  {rule}\n"))
    };
    let head = "kinds = {0: {'l': 2, 'a': 30}, 1: {'l': 1, 'a': 45}}\nrows = [[1,2],[3,4]]\nq = [5,6,7]\ndel q[1]\nfirst, *rest = [1,2,3]\n";
    assert_eq!(model(head, "p = kinds[x]\n  produce B(p['l'],p['a'])"), "B(1,45)B(2,30)");
    // The index is that of the assignment.
    assert_eq!(model(head, "p = rows[x]\n  x = 0\n  produce B(p[0],p[1],x)"), "B(3,4,0)B(1,2,0)");
    assert_eq!(model(head, "produce B(q[0],q[1],len(q),first,rest[0],len(rest))"), "B(5,7,2,1,2,2)B(5,7,2,1,2,2)");
    assert_eq!(model("", "r = [x,8,9]\n  del r[0]\n  *a, b = r\n  produce B(a[0],b,len(a))"), "B(8,9,1)B(8,9,1)");
}

#[test]
fn second_items_of_lpy_are_told_with_both_lines() {
    let text = "Axiom: A(1)\nAxiom: B(1)\nderivation length: 2\nderivation length: 1\nignore: F\nconsider: B\nn = 0\n\
                def Start():\n  global n\n  n = 5\ndef Start():\n  global n\n  n = n + 7\nproduction:\nB(x) --> C(n)\n\
                decomposition:\nmaximum depth: 2\ninterpretation:\nmaximum depth: 3\nmaximum depth: 4\nendlsystem\n";
    let (g, warnings) = read(text);
    let told: Vec<&str> = warnings.iter().filter(|w| w.code == "L008").map(|w| w.message.as_str()).collect();
    for wanted in [
        "the axiom in line 2 replaces the one in line 1",
        "the derivation length in line 4 replaces the one in line 3",
        "the list of 'ignore:' or 'consider:' in line 6 replaces the one in line 5",
        "Start in line 11 replaces the one in line 8",
        "the depth of the interpretation in line 20 replaces the one in line 19",
    ] {
        assert!(told.contains(&wanted), "{wanted}: {told:?}");
    }
    assert_eq!(told.len(), 5, "{told:?}");
    let d = derive(&g, &DeriveOptions::default(), &Limits::default()).expect("derives");
    assert_eq!(g.print(&d.modules), "C(7)");
}

#[test]
fn lists_of_lpy_hold_for_the_productions_behind_them() {
    let head = "Axiom: AFBAFCAFD\nderivation length: 1\n";
    let derived = |rules: &str| {
        let (g, warnings) = read(&format!("{head}{rules}endlsystem\n"));
        let d = derive(&g, &DeriveOptions::default(), &Limits::default()).expect("derives");
        let told: Vec<String> = warnings.iter().filter(|w| w.code == "L008").map(|w| w.message.clone()).collect();
        (g.print(&d.modules), told, convert(&g, ConvertTo::Cpfg).map(|c| c.text))
    };
    // The first production sees the F; for the third all symbols but D and F are hidden.
    let (string, told, converted) =
        derived("production:\nA > C --> X\nignore: F\nA > B --> Y\nconsider: DF\nA > FD --> Z\n");
    assert_eq!((string.as_str(), told), ("YFBAFCZFD", Vec::new()));
    let fault = converted.expect_err("two lists").to_string();
    assert!(fault.contains("L061") && fault.contains("another list of 'ignore:'"), "{fault}");
    // One list before all contexts is that of a file of cpfg, too.
    let (string, told, converted) = derived("production:\nF --> G\nignore: F\nA > C --> X\nA > B --> Y\n");
    assert_eq!((string.as_str(), told), ("YGBXGCAGD", Vec::new()));
    let text = converted.expect("one list");
    assert!(text.contains("Ignore: F"), "{text}");
    let (string, told, _) = derived("production:\nA > B --> Y\nignore: F\n");
    assert_eq!((string.as_str(), told.len()), ("AFBAFCAFD", 1));
    assert!(told[0].contains("no production follows it"), "{told:?}");
}

#[test]
fn functions_of_lpy_may_call_themselves_with_parameters() {
    let head = "def fact(n):\n  if n <= 1: return 1\n  return n*fact(n-1)\n\
                def fib(n): return n if n < 2 else fib(n-1)+fib(n-2)\n\
                def down(n): return 0 if n <= 0 else 1+down(n-1)\n\
                def gcd(a, b): return a if b == 0 else gcd(b, a % b)\n\
                def up(n): return up(n+1)\n\
                def deep(q, n): return q[0] if n < 1 else deep(q, n-1)\nk = down(30)\n";
    let model = |rule: &str| format!("{head}Axiom: A(3)\nderivation length: 1\nproduction:\nA(x):\n  {rule}\n");
    for (rule, wanted) in [
        ("produce B(fact(x),fib(x+4),fact(4))", "B(6,13,24)"),
        // Deeper than an expression is written in, with a parameter and with a number.
        ("produce B(down(10*x),down(40),k)", "B(30,40,30)"),
        ("produce B(gcd(14*x,35),fib(22))", "B(7,17711)"),
        ("if fact(x) > 5: produce C(down(fact(x)))", "C(6)"),
        ("for i in range(fact(x)-4): nproduce B(i)", "B(0)B(1)"),
    ] {
        assert_eq!(lpy(&model(rule)), wanted, "{rule}");
    }
    // A function that does not end is reported at the place that runs it.
    let (g, _) = read(&format!("{}endlsystem\n", model("produce B(up(x))")));
    let said =
        derive(&g, &DeriveOptions::default(), &Limits::default()).err().map_or_else(String::new, |e| e.to_string());
    assert!(said.contains("L044") && said.contains("calls itself without end"), "{said}");
    let said = try_read(&format!("{}endlsystem\n", model("produce B(deep([1, 2], x))")));
    let said = said.err().map_or_else(String::new, |e| e.to_string());
    assert!(said.contains("L007") && said.contains("a list as an argument of the recursive function 'deep'"), "{said}");
}

#[test]
fn long_chains_of_functions_of_lpy_are_told_as_such() {
    let said = |n: usize, last: &str, rule: &str| {
        let chain: String = (0..n).map(|i| format!("def f{i}(x): return f{}(x)\n", i + 1)).collect();
        let text = format!(
            "{chain}def f{n}(x): return {last}\nAxiom: A(2)\nderivation length: 1\nproduction:\nA(x):\n  {rule}\nendlsystem\n"
        );
        let run = |g: Grammar| derive(&g, &DeriveOptions::default(), &Limits::default()).map(|d| g.print(&d.modules));
        try_read(&text).and_then(|(g, _)| run(g)).unwrap_or_else(|e| e.to_string())
    };
    assert_eq!(said(150, "x", "produce B(f0(x))"), "B(2)");
    let deep = said(250, "x", "produce B(f0(x))");
    assert!(deep.contains("L044") && deep.contains("more than 200 calls of functions within one another"), "{deep}");
    // Lists are written into the calls.
    assert_eq!(said(20, "x[1]", "produce B(f0([1, x]))"), "B(2)");
    let list = said(40, "x[1]", "produce B(f0([1, x]))");
    assert!(list.contains("L007") && list.contains("the function 'f24', more than 24 calls"), "{list}");
    assert!(!deep.contains("itself") && !list.contains("recursive"), "{deep}{list}");
}

#[test]
fn functions_of_lpy_may_make_modules() {
    let head = "module L, K\ndef leaf(n, last=2):\n  nproduce [L(n)]\n  if n > last: return\n  nproduce K\n\
                def pair(n):\n  for i in range(2): leaf(n+i)\ndef twig(n):\n  if n > 0:\n    nproduce F(n)\n    twig(n-1)\n";
    let model = |lines: &str| format!("{head}Axiom: A(2)\nproduction:\nA(x):\n{lines}");
    for (lines, wanted) in [
        ("  pair(x)\n  produce B(x)\n", "[L(2)]K[L(3)]B(2)"),
        ("  leaf(x, last=1)\n  leaf(x)\n", "[L(2)][L(2)]K"),
        ("  if x > 1: leaf(0)\n  else: leaf(9)\n", "[L(0)]K"),
        ("  twig(3)\n", "F(3)F(2)F(1)"),
        // Modules of Python in a list.
        (
            "  nsproduce([F(x), ('L', x+1), SB(), Left(30), 'K', EB()])\n  nsproduce([])\n  sproduce([B(1)])\n",
            "F(2)L(3)[+(30)K]B(1)",
        ),
    ] {
        assert_eq!(lpy(&model(lines)), wanted, "{lines}");
    }
    for (lines, why) in [
        ("  nproduce B(leaf(x))\n", "the function 'leaf', which may end without a value"),
        ("  nsproduce([Leaf(1)])\n", "'Leaf(1)' as a module of a list"),
        ("  nsproduce(x)\n", "'nsproduce' of something other than a list of modules"),
    ] {
        let said = try_read(&format!("{}endlsystem\n", model(lines))).err().map_or_else(String::new, |e| e.to_string());
        assert!(said.contains("L007") && said.contains(why), "{lines}: {said}");
    }
}

#[test]
fn lists_of_lpy_may_be_mapped_and_filtered() {
    let model = |lines: &str| format!("q = [1, 2, 3]\nAxiom: A(2)\nproduction:\nA(x):\n{lines}");
    for (lines, wanted) in [
        ("  nproduce B(*list(map(lambda v: v*x, q)))\n", "B(2,4,6)"),
        ("  nproduce B(*map(lambda v, w: v+w, q, [10, 20]))\n", "B(11,22)"),
        ("  for v in filter(lambda v: v > 1, q): nproduce B(v)\n", "B(2)B(3)"),
        ("  nproduce B(sum(map(int, [1.5, 2.5])),len(list(filter(None, [0, 4, 5]))))\n", "B(3,2)"),
    ] {
        assert_eq!(lpy(&model(lines)), wanted, "{lines}");
    }
    for (lines, why) in [
        ("  nproduce B(sum(map(lambda v: v+w, q)))\n", "the unknown name 'w'"),
        ("  nproduce B(sum(map(lambda v, w: v+w, q)))\n", "'map' of other lists than its function has"),
        ("  nproduce B(len(list(filter(lambda v: v > x, q))))\n", "a list with conditions"),
    ] {
        let said = try_read(&format!("{}endlsystem\n", model(lines))).err().map_or_else(String::new, |e| e.to_string());
        assert!(said.contains("L007") && said.contains(why), "{lines}: {said}");
    }
}

#[test]
fn functions_that_lpy_runs_may_have_loops() {
    let model = |loops: &str| {
        format!(
            "n = 0\ndef StartEach():\n  global n\n{loops}Axiom: A\nderivation length: 2\nproduction:\nA --> B(n)A\n"
        )
    };
    for (loops, wanted) in [
        // 1 + 2, then as much again.
        ("  for i in range(1, 4):\n    if i == 3: break\n    n += i\n", "B(3)B(6)A"),
        ("  for i in range(4):\n    if i == 2: continue\n    n += i\n", "B(4)B(8)A"),
        ("  for i in range(0, 5, 2): n += i\n  while True:\n    n += 1\n    if n % 10 == 0: break\n", "B(10)B(20)A"),
    ] {
        assert_eq!(lpy(&model(loops)), wanted, "{loops}");
    }
}

#[test]
fn models_of_lpy_may_have_vectors() {
    let head = "from openalea.plantgl.all import *\nv = Vector3(1,2,2)\n";
    let model = |lines: &str| format!("{head}Axiom: A(2)\nproduction:\n{lines}");
    for (lines, wanted) in [
        ("A(x):\n  w = v*x + Vector3(0,0,1)\n  produce B(w.x,w.y,w[2],norm(v),len(w))\n", "B(2,4,5,3,3)"),
        // 1*2 + 2*1 + 2*0; (1,2,2) x (0,0,1) = (2,-1,0).
        ("A(x) --> B(dot(v,Vector3(x,1,0)),cross(v,Vector3(0,0,1)).y)\n", "B(4,-1)"),
        ("A(x) --> OLineTo(-v/2)\n", "OLineTo(-0.5,-1,-1)"),
        ("A(x):\n  w = v if x > 5 else Vector3(x,0,0)\n  if w != v: produce B(*w)\n", "B(2,0,0)"),
        ("A(x):\n  for c in v: nproduce B(c)\n", "B(1)B(2)B(2)"),
        ("A(x):\n  w = Vector2(x,1)\n  for i in range(2): w += Vector2(i,x)\n  produce B(w.x,w.y)\n", "B(3,5)"),
    ] {
        assert_eq!(lpy(&model(lines)), wanted, "{lines}");
    }
    for (lines, why) in [
        ("A(x) --> F(v+1)\n", "this operation on a vector"),
        ("A(x) --> B(v*v)\n", "a vector times a vector"),
        ("A(x) --> B(Vector3(x,1).x)\n", "a 'Vector3' of 2 numbers"),
        ("A(x) --> B(sqrt(v))\n", "a vector where a number is expected"),
    ] {
        let said = try_read(&format!("{}endlsystem\n", model(lines))).err().map_or_else(String::new, |e| e.to_string());
        assert!(said.contains("L007") && said.contains(why), "{lines}: {said}");
    }
}

#[test]
fn parameters_of_modules_of_lpy_may_be_lists_and_vectors() {
    for (model, wanted) in [
        // The middle of two points.
        (
            "Axiom: P(Vector2(0,0),1)E P(Vector2(4,2),1)\nproduction:\nP(a,s) < E > P(b,t) --> P((a+b)/2,s+t)\n",
            "P(0,0,1)P(2,1,2)P(4,2,1)",
        ),
        ("Axiom: A([1,2],5)\nproduction:\nA(q,n) --> A([q[1],q[0]],n+len(q))\n", "A(2,1,7)"),
        (
            "p = [3, 4]\nAxiom: A(p)\nderivation length: 2\nproduction:\nA(q):\n  r = [k+1 for k in q]\n  produce A(r)\n",
            "A(5,6)",
        ),
        ("Axiom: A([1,2])A([5,2])\nproduction:\nA(q if q[0] > 3) --> B(sum(q))\n", "A(1,2)B(7)"),
        ("Axiom: P(1,2)P(1,3)\nproduction:\nP(v,s != 2) --> Q(v)\n", "P(1,2)Q(1)"),
    ] {
        assert_eq!(lpy(model), wanted, "{model}");
    }
    for (model, why) in [
        (
            "Axiom: A([1,2])\nproduction:\nA(q) --> A(q+[3])\n",
            "the module 'A' with a list of 3 as its parameters, and with a list of 2",
        ),
        (
            "Axiom: A([1,2])A(3,4)\nproduction:\nA(q) --> B\n",
            "the module 'A' with a number, a number as its parameters",
        ),
        ("Axiom: A([[1],[2]])\nproduction:\nA(q) --> B\n", "a list of lists as a parameter"),
    ] {
        let said = try_read(&format!("{model}endlsystem\n")).err().map_or_else(String::new, |e| e.to_string());
        assert!(said.contains("L007") && said.contains(why), "{model}: {said}");
    }
}

#[test]
fn models_of_lpy_may_give_imports_other_names() {
    let head = "import math as mt, random as r\nimport numpy as n\nfrom math import sqrt as root, pi as PI, atan2 as angle\n\
                from random import (randint as ri, random as rnd, choice as pick)\n";
    let model = |lines: &str| format!("{head}Axiom: A(9)\nderivation length: 1\nproduction:\nA(x):\n{lines}");
    for (lines, wanted) in [
        ("  produce B(mt.sqrt(x),n.sqrt(x+7),mt.floor(mt.pi))\n", "B(3,4,3)"),
        ("  produce B(root(x),round(PI,2),angle(0,1),pick([4,4]))\n", "B(3,3.14,0,4)"),
        ("  produce B(r.randint(5,5),ri(6,6),1 if rnd() < 2 else 0)\n", "B(5,6,1)"),
        ("  import math as m2\n  from math import floor as fl\n  produce B(m2.sqrt(x),fl(x/2))\n", "B(3,4)"),
        // Other words that end or begin with the name of a module are none.
        ("  gmt, mt2 = 2, 3\n  produce B(gmt,mt2,0.5*mt.sqrt(4))\n", "B(2,3,1)"),
    ] {
        assert_eq!(lpy(&model(lines)), wanted, "{lines}");
    }
    // Two numbers of one range are drawn, each once.
    let drawn = lpy(&model("  a, b = rnd(), rnd()\n  produce B(1 if a == b else 2,a-a)\n"));
    assert_eq!(drawn, "B(2,0)");
    let said = try_read(&format!("{}endlsystem\n", model("  produce B(mt.gamma(x))\n")));
    assert!(said.is_err_and(|e| e.to_string().contains("the function 'gamma'")));
}

#[test]
fn productions_of_lpy_may_define_functions() {
    let model =
        |lines: &str| format!("k = 3\nAxiom: A(2)\nderivation length: 1\nproduction:\nA(x):\n{lines}\nC --> D(f(1))\n");
    for (lines, wanted) in [
        ("  def f(y): return 2*y\n  produce B(f(x),f(f(3)))", "B(4,12)"),
        (
            "  def f(y, z=4):\n    if y > 2: return z\n    w = y*10\n    return w + z\n  produce B(f(x),f(x+1),f(x,z=1))",
            "B(24,4,21)",
        ),
        ("  f = lambda y, z: y*z\n  produce B(f(x,5))", "B(10)"),
        // It reads the variables of the production, as they are where it is called.
        ("  k = 5\n  def f(y): return y*k + x\n  a = f(1)\n  k = 6\n  produce B(a,f(1))", "B(7,8)"),
        ("  def f(y): return y*k\n  def g(y): return f(y) + 1\n  for i in range(2): nproduce B(g(i))", "B(1)B(4)"),
    ] {
        // Other productions do not know it.
        let text = model(lines);
        assert_eq!(lpy(text.rsplit_once("C -->").map_or("", |(head, _)| head)), wanted, "{lines}");
        let said = try_read(&format!("{text}endlsystem\n")).err().map_or_else(String::new, |e| e.to_string());
        assert!(said.contains("the function 'f'"), "{lines}: {said}");
    }
    for (lines, why) in [
        (
            "  def f(n):\n    s = 0\n    for i in range(k): s += i\n    return s\n  produce B(f(x))",
            "outside of the production",
        ),
        ("  if x > 1:\n    def f(y): return y\n  produce B(f(x))", "'def' within another block"),
        ("  def f(y): return y\n  def f(y): return -y\n  produce B(f(x))", "a second function 'f'"),
        ("  def f(y): return y*f(y-1) if y > 0 else 1\n  produce B(f(x))", "the function 'f'"),
    ] {
        let said = try_read(&format!("{}endlsystem\n", model(lines))).err().map_or_else(String::new, |e| e.to_string());
        assert!(said.contains("L007") && said.contains(why), "{lines}: {said}");
    }
}

#[test]
fn lists_of_productions_of_lpy_leave_those_of_the_model_as_they_are() {
    let model = "q = []\nfor i in range(2): q = q + [randint(7,7)]\nAxiom: A(2)\nderivation length: 1\nproduction:\nA(x):\n  \
                 for i in range(2): p = [x*2, x*3]\n  nproduce B(q[0],q[1],p[0],p[1])\n";
    assert_eq!(lpy(model), "B(7,7,4,6)");
}

#[test]
fn imports_of_lpy_may_fail() {
    let model = |head: &str| format!("{head}Axiom: A(4)\nderivation length: 1\nproduction:\nA(x) --> B(root(x))\n");
    let head =
        "try:\n  from openalea.plantgl.all import *\n  from math import sqrt as root\nexcept ImportError:\n  pass\n";
    assert_eq!(lpy(&model(head)), "B(2)");
    let other = head.replace("  from openalea", "  n = 3\n  from openalea");
    assert_eq!(lpy(&model(&other)), "B(2)");
}

#[test]
fn heads_of_lpy_leave_lists_of_the_model_as_they_are() {
    let model = |axiom: &str, rules: &str| format!("v = [5, 6]\nAxiom: {axiom}\nproduction:\n{rules}\n");
    assert_eq!(lpy(&model("A(1)A(1,2)B", "A(*v) --> C(len(v))\nB --> F(v[0])")), "C(1)C(2)F(5)");
    assert_eq!(lpy(&model("?P(0,0,0)AB", "?P(v) < A --> C\n?P(x,y,z) --> *\nB --> F(v[1])")), "CF(6)");
}

#[test]
fn functions_of_lpy_may_stand_in_any_order() {
    let head = "k = 2\ndef twice(n, f=k): return f*total(n)\ndef more(n): return sums(n) + 1\ndef sums(n): return total(n)\n\
                def total(n):\n  s = 0\n  for i in range(n): s += i\n  return s\nk = 5\n";
    // 0 + 1 + 2 + 3, whose factor is the k of the line of the function.
    let model = format!("{head}Axiom: A(4)\nderivation length: 1\nproduction:\nA(x) --> B(twice(x),more(x))\n");
    assert_eq!(lpy(&model), "B(12,7)");
}

#[test]
fn loops_of_lpy_may_have_else() {
    let model = |lines: &str| format!("Axiom: A(2)\nderivation length: 1\nproduction:\nA(x):\n{lines}  nproduce C\n");
    for (lines, wanted) in [
        ("  for i in range(2): nproduce B(i)\n  else: nproduce D\n", "B(0)B(1)DC"),
        ("  for i in range(4):\n    if i == x: break\n    nproduce B(i)\n  else:\n    nproduce D\n", "B(0)B(1)C"),
        ("  for i in range(2):\n    if i == x: break\n    nproduce B(i)\n  else:\n    nproduce D\n", "B(0)B(1)DC"),
        ("  i = 0\n  while i < x:\n    i += 1\n    if i > 5: break\n  else:\n    nproduce D(i)\n", "D(2)C"),
        // The `break` of the inner loop does not end the outer one.
        (
            "  for i in range(2):\n    for j in range(9):\n      if j == i: break\n    else: nproduce E\n    nproduce B(j)\n  else: nproduce D\n",
            "B(0)B(1)DC",
        ),
    ] {
        assert_eq!(lpy(&model(lines)), wanted, "{lines}");
    }
}

#[test]
fn parameters_of_lpy_are_equal_to_fractions() {
    // 0.1 has no exact value in single precision, which parameters have; 0.1000001 is another number there.
    let model =
        |rules: &str| format!("k = 0.1\nAxiom: A(0.1)A(0.1000001)\nderivation length: 1\nproduction:\n{rules}\n");
    for rules in [
        "A(x) : x == 0.1 --> B\nA(x) --> C",
        "A(x) : x != k --> C\nA(x) --> B",
        "A(x) : x in (0.3, k) --> B\nA(x) --> C",
        "A(0.1) --> B\nA(x) --> C",
        "A(x):\n  y = x\n  if 0.1 == y: produce B\n  produce C",
        "A(x):\n  y = 0.1\n  if y == 0.1 and x == y: produce B\n  produce C",
    ] {
        assert_eq!(lpy(&model(rules)), "BC", "{rules}");
    }
}

#[test]
fn models_of_lpy_may_use_none() {
    let head = "def size(x, y=None):\n  if y is None: return x\n  return x+y\nlast = None\n\
                def side(x, name=''):\n  if name: return x\n  return -x\n";
    let model = |rule: &str| format!("{head}Axiom: A(0)\nderivation length: 1\nproduction:\nA(x):\n  {rule}\n");
    for (rule, wanted) in [
        ("produce B(size(3),size(3,4),size(3,y=5))", "B(3,7,8)"),
        ("produce B(1 if last == None else 2,1 if last is not None else 2,last or 5)", "B(1,2,5)"),
        ("if last or not last is None: produce C\n  if not last and not x: produce D", "D"),
        ("y = None\n  if x == 0: y = 7\n  if y is None: produce C\n  produce D(y)", "D(7)"),
        ("produce B(side(3),side(3,'a'),bool(last),bool(0.5))", "B(-3,3,0,1)"),
    ] {
        assert_eq!(lpy(&model(rule)), wanted, "{rule}");
    }
    let handed =
        "Axiom: A(None)A(0)A(2)\nproduction:\nA(x):\n  if x is None: produce C\n  if x: produce D\n  produce E\n";
    assert_eq!(lpy(handed), "CED");
    for rule in ["produce B(last+1)", "produce B(sqrt(None))", "produce B(1 if last < 2 else 3)"] {
        let said = try_read(&format!("{}endlsystem\n", model(rule))).err().map_or_else(String::new, |e| e.to_string());
        assert!(said.contains("L007") && said.contains("'None' where a number is expected"), "{rule}: {said}");
    }
}

#[test]
fn functions_of_lpy_that_draw_in_another_one_are_drawn_once() {
    let model = format!(
        "def g(): return random()\ndef f(): return g()\nAxiom: {}\nderivation length: 1\nproduction:\nA:\n  \
         if f() < 0.5: produce B\n  else: produce C\n",
        "A".repeat(60)
    );
    // Each module takes one of both ways.
    let made = lpy(&model);
    assert!(!made.contains('A') && made.contains('B') && made.contains('C') && made.len() == 60, "{made}");
}

#[test]
fn expressions_of_lpy_of_very_many_parts_are_refused() {
    let said = |value: &str| {
        let text =
            format!("q = [1]\nAxiom: A(1)\nderivation length: 1\nproduction:\nA(x) --> B({value})\nendlsystem\n");
        try_read(&text).err().map_or_else(String::new, |e| e.to_string())
    };
    for sign in [" or ", " and ", "+", "*", " < ", " == "] {
        assert_eq!(said(&["x"; 100].join(sign)), "", "{sign}");
        let long = said(&["x"; 100_000].join(sign));
        assert!(long.contains("L007") && long.contains("too many parts"), "{sign}: {}", &long[..long.len().min(200)]);
    }
    let long = said(&format!("sum([x {} for a in q])", "for a in q ".repeat(10_000)));
    assert!(long.contains("L007") && long.contains("nested too deep"), "{}", &long[..long.len().min(200)]);
    // Many items of a list are no height.
    assert_eq!(said(&format!("len([{}])", ["x+1"; 3000].join(","))), "");
}

#[test]
fn more_functions_of_python_are_known_to_lpy() {
    let model = |rule: &str| format!("q = [3, 1, 2]\nr = [0]*4 + q\nAxiom: A(7)\nproduction:\nA(x):\n  {rule}\n");
    for (rule, wanted) in [
        ("produce B(len(r),r[4],sum(2*[1,5]))", "B(7,3,12)"),
        ("for v in reversed(q): nproduce B(v)", "B(2)B(1)B(3)"),
        ("for v in sorted(q): nproduce B(v)", "B(1)B(2)B(3)"),
        ("for i in reversed(range(3)): nproduce B(i)", "B(2)B(1)B(0)"),
        ("produce B(divmod(x,3)[0],divmod(-x,3)[1])", "B(2,2)"),
        ("if any([v > x for v in q]) or all(v < x for v in q): produce B(any([]),all([]))", "B(0,1)"),
        ("if any(v > 2*x-12 for v in q): produce B", "B"),
        ("produce B(hypot(3,x-3),fmod(-x,4),log(8,2),log10(1000))", "B(5,-3,3,3)"),
        ("for v in sorted(q, reverse=True): nproduce B(v)", "B(3)B(2)B(1)"),
        ("produce B(q.index(2),len([a*b for a in q for b in range(a) if b > 0]))", "B(2,3)"),
        ("produce B(sum([i*v for i, v in enumerate(q)]),sum(a*b for a, b in zip(q, [5,6])))", "B(5,21)"),
        ("produce B(randrange(1),randrange(4,5),1 if isForward() else 2)", "B(0,4,1)"),
        ("produce B(round(x/3,2),round(1234.5,-2),round(cosh(0)+sinh(0)+tanh(0),3))", "B(2.33,1200,1)"),
    ] {
        assert_eq!(lpy(&model(rule)), wanted, "{rule}");
    }
    for (rule, why) in [
        ("produce B(len(q*x))", "that is not constant"),
        ("produce B(sorted([x, 1])[0])", "'sorted'"),
        ("produce B(q.index(8))", "'index' of a value that its list does not have"),
        ("produce B(q.size)", "an attribute 'size' that this value does not have"),
        ("nsproduce(q)", "'nsproduce' of something other than a list"),
        ("produce B(round(x,x))", "digits of 'round'"),
        ("produce B(len([0]*10000*10000))", "too many items"),
    ] {
        let said = try_read(&format!("{}endlsystem\n", model(rule))).err().map_or_else(String::new, |e| e.to_string());
        assert!(said.contains("L007") && said.contains(why), "{rule}: {said}");
    }
}

#[test]
fn variables_of_productions_hide_values_of_the_model() {
    let model = |lines: &str| format!("n = 3\nd = 5\nAxiom: A(4)\nproduction:\nA(x):\n{lines}");
    for (lines, wanted) in [
        ("  n = 2\n  for i in range(n): nproduce B(i)\n", "B(0)B(1)"),
        ("  n = 2\n  for v in [n, 7]: nproduce B(v)\n", "B(2)B(7)"),
        ("  n = x\n  for i in range(min(n,9)): nproduce B(i)\n", "B(0)B(1)B(2)B(3)"),
        // At most 8 turns, not 8 / 5.
        ("  d = 1\n  for i in range(int(min(x,8)/d)): nproduce B(i)\n", "B(0)B(1)B(2)B(3)"),
        ("  for n in range(2):\n    for j in range(n+1): nproduce B(n,j)\n", "B(0,0)B(1,0)B(1,1)"),
        ("  for i in range(n): nproduce B(i)\n", "B(0)B(1)B(2)"),
    ] {
        assert_eq!(lpy(&model(lines)), wanted, "{lines}");
    }
}

#[test]
fn lists_of_lpy_may_be_taken_apart() {
    let head = "q = [(10, 60), (20, 45)]\np = [7, 8]\ndef size(a):\n  if a > 1: return a, a*a\n  return [0, 1]\n";
    let model = |lines: &str| format!("{head}Axiom: A(1)A(2)\nproduction:\nA(x):\n{lines}  produce B(a,b)\n");
    for (lines, wanted) in [
        ("  a, b = p\n", "B(7,8)B(7,8)"),
        ("  (a, b) = (x, 3)\n", "B(1,3)B(2,3)"),
        ("  a, b = q[x-1]\n", "B(10,60)B(20,45)"),
        ("  a, b = size(x)\n", "B(0,1)B(2,4)"),
        ("  a = b = x+1\n", "B(2,2)B(3,3)"),
        ("  a, b = 1, 2\n  a, b = [b, a]\n", "B(2,1)B(2,1)"),
        // The index is set by what it takes.
        ("  a = x-1\n  a, b = q[a]\n", "B(10,60)B(20,45)"),
    ] {
        assert_eq!(lpy(&model(lines)), wanted, "{lines}");
    }
    // Both names of a chain have the one number that was drawn.
    let drawn = lpy(&model("  a = b = randint(1,1000000)\n"));
    for module in drawn.split(['B', '(', ')']).filter(|m| !m.is_empty()) {
        let (a, b) = module.split_once(',').unwrap_or_default();
        assert_eq!(a, b, "{drawn}");
    }
    for lines in ["  a, b = 1, 2, 3\n", "  a, b = 3\n", "  a, b = [1]\n", "  a = b, c = 1, 2\n"] {
        let said = try_read(&format!("{}endlsystem\n", model(lines))).err().map_or_else(String::new, |e| e.to_string());
        assert!(said.contains("L007") && said.contains("in a production"), "{lines}: {said}");
    }
}

#[test]
fn several_names_of_lpy_are_assigned_at_once() {
    let model = |lines: &str| format!("Axiom: A(1,2)\nproduction:\nA(a,b):\n{lines}  produce B(a,b)\n");
    for (lines, wanted) in [
        ("  a, b = b, a+b\n", "B(2,3)"),
        ("  a, b = b, a\n", "B(2,1)"),
        ("  a, b = 7, a\n", "B(7,1)"),
        ("  for i in range(3): a, b = b, a+b\n", "B(5,8)"),
        ("  i = 0\n  while i < 4:\n    i, a, b = i+1, b, a+b\n", "B(8,13)"),
    ] {
        assert_eq!(lpy(&model(lines)), wanted, "{lines}");
    }
    assert_eq!(lpy("a, b = 1, 2\na, b = b, a\nAxiom: A(a,b)\nproduction:\nX --> Y\n"), "A(2,1)");
    let fibonacci = "def f(n):\n  a, b = 0, n\n  for i in range(5): a, b = b, a+b\n  return a\n";
    assert_eq!(lpy(&format!("{fibonacci}Axiom: A(f(2))\nproduction:\nX --> Y\n")), "A(10)");
    let each = "x = 0\ny = 5\ndef EndEach():\n  global x, y\n  x, y = y, x+1\n";
    assert_eq!(
        lpy(&format!("{each}Axiom: A\nderivation length: 3\nproduction:\nA --> A B(x,y)\n")),
        "AB(1,6)B(5,1)B(0,5)"
    );
}

#[test]
fn functions_of_lpy_may_have_several_statements() {
    let head = "def size(age, top):\n  d = age + 1\n  if d > top:\n    return top\n  elif d > 2:\n    d = d * 10\n  return d\n\
                def total(n):\n  s = 0\n  for i in range(4):\n    s += i * n\n  return s\n";
    let model =
        |rule: &str| format!("{head}assert size(1, 1) == 1\nAxiom: A(1)A(2)A(8)\nproduction:\nA(x) --> {rule}\n");
    assert_eq!(lpy(&model("B(size(x,6))")), "B(2)B(30)B(6)");
    assert_eq!(lpy(&model("B(total(x))")), "B(6)B(12)B(48)");
    // 0 + 2 + .. + 18 = 90 for even i; a parameter hides the constant of its name and the number e.
    let even = "e = 3\ndef f(e):\n  s = 0\n  for i in range(20):\n    if i % 2 == 0: s += i*e\n    elif i > 100: s = 0\n  \
                if e > 2: s += 1\n  \
                return s\nAxiom: A(1)A(5)\nproduction:\nA(x) --> B(f(x))\n";
    assert_eq!(lpy(even), "B(90)B(451)");
    // One without a value, and one that would become too large, are named where they are called.
    let none = "def f(x):\n  if x > 1:\n    return 2\nAxiom: A(1)\nproduction:\nA(x) --> B(f(x))\nendlsystem\n";
    let said = try_read(none).err().map_or_else(String::new, |e| e.to_string());
    assert!(said.contains("the function 'f'"), "{said}");
    let nested = format!(
        "def g(x): return x+x\nAxiom: A(1)\nproduction:\nA(x) --> B({}x{})\nendlsystem\n",
        "g(".repeat(60),
        ")".repeat(60)
    );
    let said = try_read(&nested).err().map_or_else(String::new, |e| e.to_string());
    assert!(said.contains("grows too large"), "{said}");
}

#[test]
fn heads_of_lpy_may_hold_constants_and_conditions() {
    let model = "Axiom: A(20,1)A(3,1)A(3,9)\nproduction:\nA(20,k) --> B(k)\nA(x if x < 5, k if k > 4) --> C(x,k)\nA(x,k) --> D(k)\n";
    assert_eq!(lpy(model), "B(1)D(1)C(3,9)");
    let around = "Axiom: K(1)A(5)K(2)A(5)\nproduction:\nK(2) < A(x) --> B(x)\n";
    assert_eq!(lpy(around), "K(1)A(5)K(2)B(5)");
}

#[test]
fn conditions_on_the_variable_of_a_loop_of_lpy_leave_one_way() {
    let model = |rule: &str| lpy(&format!("p = 3\nAxiom: A(0)A(5)\nproduction:\nA(n):\n{rule}"));
    let text = model(
        "  for i in range(40):\n    x = 2*i\n    if i % 2 == 0:\n      nproduce F(x)\n    \
         elif i == 5 and p == 3:\n      nproduce H\n    \
         else:\n      nproduce G\n",
    );
    let one: String = (0..40)
        .map(|i| match i {
            5 => "H".to_owned(),
            i if i % 2 == 0 => format!("F({})", 2 * i),
            _ => "G".to_owned(),
        })
        .collect();
    assert_eq!(text, format!("{one}{one}"));
    // A variable of the rule hides the constant of its name, and counts from one turn to the next.
    assert_eq!(model("  p = n\n  if p < 2: produce B\n  produce C\n"), "BC");
    let counted =
        "  p = 0\n  for i in range(3):\n    p = p + i\n    if p > 0: nproduce B(p)\n    if n > p: nproduce C\n";
    // p is 0, 1, 3.
    assert_eq!(model(counted), "B(1)B(3)CB(1)CB(3)C");
    let said = "Axiom: A\nproduction:\nA:\n  for i in range(300000):\n    nproduce F\nendlsystem\n";
    let said = try_read(said).err().map_or_else(String::new, |e| e.to_string());
    assert!(said.contains("'for' with too many turns") && said.contains("line 4"), "{said}");
}

#[test]
fn loops_of_lpy_may_have_an_end_that_is_drawn() {
    let model = |rule: &str| {
        lpy(&format!("few = lambda o: randint(2, 4)\nAxiom: {}\nproduction:\n{rule}\n", "A(3)".repeat(40)))
    };
    // Two, three or four turns, each of which occurs among forty modules; i is 0, 1, ..; what follows knows the count.
    let text = model("A(x):\n  n = few(x)\n  for i in range(n):\n    nproduce B(i)\n  produce C(n)\n");
    let mut rest = text.as_str();
    let mut seen = [0; 5];
    while !rest.is_empty() {
        let end = rest.find(')').map(|i| rest[i..].find('C').map_or(rest.len(), |c| i + c)).expect("a module");
        let close = end + rest[end..].find(')').expect("C has a number") + 1;
        let n: usize = rest[end + 2..close - 1].parse().expect("a number");
        let want: String = (0..n).map(|i| format!("B({i})")).chain([format!("C({n})")]).collect();
        assert_eq!(rest[..close], want, "{text}");
        seen[n] += 1;
        rest = &rest[close..];
    }
    assert!(seen[0] + seen[1] == 0 && seen[2..].iter().all(|n| *n > 0), "{seen:?}");
    assert_eq!(model("A(x):\n  for i in range(min(int(x), 5)):\n    nproduce B\n"), "BBB".repeat(40));
    // Nothing is known of x: the error names the number of turns that are read.
    let unknown =
        "Axiom: A(2)A(70)A(0)\nproduction:\nA(x):\n  for i in range(x):\n    nproduce B\n  produce C\nendlsystem\n";
    let (g, warnings) = read(unknown);
    assert!(warnings.iter().any(|w| w.code == "L008" && w.message.contains("64 turns")), "{warnings:?}");
    let d = derive(&g, &DeriveOptions::default(), &Limits::default()).expect("derives");
    assert_eq!(g.print(&d.modules), format!("BBC{}CC", "B".repeat(64)));
    let said = try_read(&unknown.replace("range(x)", "range(y)")).err().map_or_else(String::new, |e| e.to_string());
    assert!(said.contains("'for' over a range that is not constant"), "{said}");
}

#[test]
fn models_of_lpy_may_ask_for_the_number_of_the_step() {
    // Steps are counted from 0.
    let model = "Axiom: A\nderivation length: 3\nproduction:\nA --> B(getIterationNb())A\n";
    assert_eq!(lpy(model), "B(0)B(1)B(2)A");
}

#[test]
fn a_bracket_of_a_context_of_lpy_skips_the_rest_of_its_branch() {
    let model = |context: &str| lpy(&format!("Axiom: I[B C]D I[B]D\nproduction:\nI > {context} --> J\n"));
    assert_eq!(model("[B]D"), "J[BC]DJ[B]D");
    assert_eq!(model("[B=]D"), "I[BC]DJ[B]D");
}

#[test]
fn a_line_of_lpy_in_a_grammar_of_cpfg_is_told() {
    let text = "Lsystem: 1\nderivation length: 1\nAxiom: A\nproduction:\nA --> B\nendlsystem\n";
    let said = try_read(text).err().map_or_else(String::new, |e| e.to_string());
    assert!(said.contains("L007") && said.contains("read as a grammar of cpfg") && said.contains(":4:1"), "{said}");
    assert!(!said.contains("not supported"), "{said}");
}

#[test]
fn statements_of_lpy_behind_a_semicolon_run() {
    let model = |head: &str, lines: &str| {
        format!("n = 1\n{head}Axiom: A(1)\nderivation length: 1\nproduction:\nA(x):\n{lines}  produce B(x,n)\n")
    };
    for (head, lines, wanted) in [
        ("", "  print(x); x = 3\n", "B(3,1)"),
        ("", "  pass; x = 3; assert x > 2; x += 1\n", "B(4,1)"),
        ("", "  if x > 0: x = 5; x += 1\n", "B(6,1)"),
        ("", "  x = 2; produce ;(2)B(x,n)\n", ";(2)B(2,1)"),
        ("", "  global n; n = 7\n", "B(1,7)"),
        ("print(n); n = 4\n", "", "B(1,4)"),
        ("import random; n = 4\n", "", "B(1,4)"),
        ("def Start(): global n; n = 8\n", "", "B(1,8)"),
        ("def StartEach():\n  global n\n  seed(3); n = 9\n", "", "B(1,9)"),
    ] {
        assert_eq!(lpy(&model(head, lines)), wanted, "{head}{lines}");
    }
}

#[test]
fn productions_of_lpy_see_the_values_at_the_end_of_the_model() {
    let model = |head: &str, rule: &str| format!("{head}Axiom: A(2)\nderivation length: 1\nproduction:\n{rule}\n");
    for (head, rule, wanted) in [
        ("k = 3\n", "A(x) --> B(k)\nk = 5", "B(5)"),
        ("", "A(x) --> B(k,f(x))\nk = 5\ndef f(x): return x*k", "B(5,10)"),
        ("", "A(x) --> B(total(x))\ndef total(n):\n  s = 0\n  for i in range(n+1): s += i\n  return s", "B(3)"),
        ("k = 1\ndef StartEach():\n  global n\n  n = k\n", "A(x) --> B(n)\nk = 7\nn = 0", "B(7)"),
    ] {
        assert_eq!(lpy(&model(head, rule)), wanted, "{head}{rule}");
    }
}

#[test]
fn texts_of_lpy_may_hold_signs_of_comments_and_quotes() {
    for (text, other) in [("'#'", "'a'"), ("'\"'", "\"'\""), ("'it\\'s # one'", "'# two'"), ("\"don't\"", "'do # not'")]
    {
        let model = format!(
            "k = {text}  # it's \"one\"\nAxiom: A({text})A({other})\nderivation length: 1\nproduction:\n\
             A(x) --> B(1 if x == k else 2)  # don't\n"
        );
        assert_eq!(lpy(&model), "B(1)B(2)", "{text}");
    }
}

#[test]
fn texts_of_lpy_may_hold_any_sign() {
    // Each text is told from the one that has another sign in its place.
    for text in ["a:b", "a,b", "(", "]", "a += b", "x == 3", "A --> B", "F(1)[+F]; G", "a.b", "{%}", "if x: y"] {
        let model = format!(
            "d = {{'{text}': 1}}\nAxiom: A('{text}')A('!')\nderivation length: 1\nproduction:\nA(x):\n  t = '{text}'\n  \
             if x == t and x == \"{text}\": produce B(d['{text}'])\n  produce C\n"
        );
        assert_eq!(lpy(&model), "B(1)C", "{text}");
    }
}

#[test]
fn indented_lines_of_lpy_go_on_with_modules_or_are_refused() {
    let model = |lines: &str| format!("Axiom: A(1)\nderivation length: 1\nproduction:\nA(x):\n{lines}");
    assert_eq!(lpy(&model("  nproduce F(1)\n     [F(2)]\n  produce F(3)\n    G\n")), "F(1)[F(2)]F(3)G");
    for lines in [
        "  y = 1\n    y = 2\n  produce B(y)\n",
        "  produce B(n)\nn = 1\n  n = 2\n",
        "  pass\n    x = 2\n  produce B(x)\n",
    ] {
        let said = try_read(&format!("{}endlsystem\n", model(lines))).err().map_or_else(String::new, |e| e.to_string());
        assert!(
            said.contains("L007") && said.contains("an indented line") && said.contains("begin it where"),
            "{lines}: {said}"
        );
    }
}

#[test]
fn functions_of_lpy_that_cannot_be_read_are_refused_with_the_reason() {
    let head = "n = 0\n\n\n\n\ndef safe(x):\n  with open(x):\n    return x\n\
                def ends(x):\n  produce F(x)\n";
    for (call, why) in [
        ("ends(x)", "the function 'ends' (its 'produce' ends the production: write 'nproduce')"),
        ("safe(x)", "the function 'safe' (line 7: 'with' in a production)"),
    ] {
        let text = format!("{head}Axiom: A(1)\nderivation length: 1\nproduction:\nA(x) --> B({call})\nendlsystem\n");
        let said = try_read(&text).err().map_or_else(String::new, |e| e.to_string());
        assert!(said.contains("L007") && said.contains(why), "{call}: {said}");
    }
}

#[test]
fn scales_of_modules_of_lpy_are_told() {
    let text = "module P : scale = 1\nmodule I\nAxiom: P I A\nproduction:\nI < A --> F\nendlsystem\n";
    let (_, told) = read(text);
    let scales: Vec<_> = told.iter().filter(|d| d.message.contains("the scale of a module")).collect();
    assert!(scales.len() == 1 && scales.iter().all(|d| d.code == "L008"), "{told:?}");
}

#[test]
fn axioms_of_lpy_may_go_on_in_indented_lines() {
    let model = |lines: &str| format!("Axiom: F(1)\n{lines}derivation length: 1\nproduction:\nA(x) --> B(x)\n");
    assert_eq!(lpy(&model("  A(2)\n  [C]\n")), "F(1)B(2)[C]");
    let said = try_read(&format!("{}endlsystem\n", model("  maximum depth: 3\n")));
    let said = said.err().map_or_else(String::new, |e| e.to_string());
    assert!(
        said.contains("L007") && said.contains("line 2: an indented line") && said.contains("without blanks"),
        "{said}"
    );
}

#[test]
fn assignments_of_lpy_may_stand_side_by_side() {
    let model = |head: &str| {
        lpy(&format!("{head}\nAxiom: A(1)\nproduction:\nA(x):\n  y = 2*x; z = y+1;\n  produce ;(2)B(e,f,y,z)\n"))
    };
    for head in ["e = 3; f = 3", "e = 3;\nf = 3;", "e = f = 3", "e = 1\ne += 2\nf = e", "e, f = 3, 6\nf /= 2;"] {
        assert_eq!(model(head), ";(2)B(3,3,2,3)", "{head}");
    }
    // Semicolons within texts and what is no name stay as they are.
    assert_eq!(model("about = \"a; b\"\nmore = 'it\\'s; so'\ne = f = 3 # x; y"), ";(2)B(3,3,2,3)");
    assert!(try_read("a.b += 1\nAxiom: A\nproduction:\nA --> B\nendlsystem\n").is_err());
}

/// The message of the refusal of a model of L-Py; empty for one that is read.
fn lpy_refusal(text: &str) -> String {
    try_read(&format!("{text}\nendlsystem\n")).err().map_or_else(String::new, |e| e.to_string())
}

#[test]
fn targets_of_lpy_may_be_nested() {
    let model = "(p, (r, s)), t = (1, (2, 3)), 4\nq = [(5, (6, 7)), (8, (9, 10))]\nAxiom: A\nderivation length: 1\nproduction:\nA:\n  \
                 (a, b), c = (p, s), t\n  (a, (b, d)) = q[1]\n  for i, (k, (m, n)) in enumerate(q):\n    nproduce C(i,k,m,n)\n  \
                 produce B(a,b,c,d) D(sum([x*z for x, (y, z) in q])) E(sum([i*x for i, (x, y) in enumerate(q)]))\n";
    assert_eq!(lpy(model), "C(0,5,6,7)C(1,8,9,10)B(8,9,4,10)D(115)E(8)");
    // Python swaps: all values are taken before the first name is set.
    let swapped =
        "Axiom: A(1,2,3)\nderivation length: 1\nproduction:\nA(a,b,c):\n  (a, b), c = (c, a), b\n  produce B(a,b,c)\n";
    assert_eq!(lpy(swapped), "B(3,1,2)");
    let said = lpy_refusal(&swapped.replace("(c, a), b", "(c, a, b), b"));
    assert!(said.contains("L007") && said.contains("line 5"), "{said}");
}

#[test]
fn errors_of_lpy_that_a_try_catches_are_tested() {
    // 6/3 = 2 and 102; 6/0; 6/2 = 3 and 103; no fourth item.
    let functions = "q = [3, 0, 2]\nd = {'a': 1, 'b': 2}\ndef f(i):\n  try:\n    x = q[i]\n    y = 6/x\n  except IndexError:\n    return -5\n  \
                     except ZeroDivisionError:\n    return -6\n  else:\n    y += 100\n  return y\ndef g(key):\n  try:\n    return d[key]\n  \
                     except KeyError:\n    return 0\n";
    let model = |block: &str| format!("{functions}Axiom: A(0.5)\nderivation length: 1\nproduction:\nA(n):\n{block}");
    let calls = "  for i in range(4):\n    nproduce B(f(i))\n  produce C(g('b'),g('z'))\n";
    assert_eq!(lpy(&model(calls)), "B(102)B(-6)B(103)B(-5)C(2,0)");
    // In a production; the rest of the block does not run where something fails before it.
    let block = "  x = 1\n  try:\n    if n < 1:\n      x = sqrt(n - 1)\n    x = 5\n  except ValueError as err:\n    x += 10\n  finally:\n    x += 100\n  \
                 produce D(x)\n";
    assert_eq!(lpy(&model(block)), "D(111)");
    assert_eq!(lpy(&model(&block.replace("n < 1", "n > 1"))), "D(105)");
    // A part that is not computed does not fail, and neither does what no `except` is for.
    let parts = "  try:\n    x = n if n > 0 else 1/(n - 0.5)\n    y = n > 1 and 1/(n - 0.5)\n  except ZeroDivisionError:\n    x = 7\n  produce D(x)\n";
    assert_eq!(lpy(&model(parts)), "D(0.5)");
    // Outside of productions, with values that are known.
    let outside = "q = [1, 2]\ntry:\n  k = q[5]\nexcept (IndexError, KeyError):\n  k = -1\nAxiom: B(k)\nproduction:\n";
    assert_eq!(lpy(outside), "B(-1)");
    let many = "    if n > 0:\n      x = 1/n\n".repeat(30);
    let many = format!("  try:\n{many}  except:\n    x = 0\n  produce D(x)\n");
    for (block, why) in [
        ("  try:\n    x = undefined\n  except NameError:\n    x = 0\n  produce D(x)\n", "'except NameError'"),
        (
            "  try:\n    for i in range(9):\n      x = 1/(i-n)\n  except:\n    x = 0\n  produce D(x)\n",
            "a loop in 'try'",
        ),
        ("  try:\n    x = 1/random()\n  except:\n    x = 0\n  produce D(x)\n", "a random number"),
        (many.as_str(), "a 'try' of too many statements that may fail"),
        ("  try:\n    x = 1\n  produce D(x)\n", "'try' without 'except'"),
        (
            "  try:\n    x = 1/n\n    return\n  except:\n    x = 0\n  finally:\n    x = 2\n  produce D(x)\n",
            "'finally' behind",
        ),
    ] {
        let said = lpy_refusal(&model(block));
        assert!(said.contains("L007") && said.contains(why), "{block}: {said}");
    }
}

#[test]
fn steps_of_lpy_may_have_different_directions() {
    // From the end C passes through the A before it in one step; then each A behind a B becomes one, from the beginning.
    let model = "def StartEach():\n  if getIterationNb() % 2 == 0: backward()\n  else:\n    forward()\nAxiom: AAACAA\nderivation length: 2\n\
                 production:\nA >> C --> C\nB << A --> B\nC:\n  if isForward(): produce B\n";
    assert_eq!(lpy(model), "BBBBBB");
    assert_eq!(lpy(&model.replace("length: 2", "length: 1")), "CCCCAA");
    // The direction is kept until it is set again.
    let kept = "n = 0\ndef Start(): backward()\ndef EndEach():\n  global n\n  n += 1\n  if n == 2: forward()\n\
                Axiom: AC\nderivation length: 3\nproduction:\nA >> C --> AC\nC << B --> D\nC --> C B\n";
    // ACB, ACBCB... A sees the C that is made behind it twice, then no more.
    assert_eq!(lpy(&kept.replace("length: 3", "length: 1")), "ACCB");
    let said = lpy_refusal("Axiom: A\nproduction:\nA:\n  if isForward(): backward()\n  produce B\n");
    assert!(said.contains("L007") && said.contains("'backward()' or 'forward()' in a production"), "{said}");
}

#[test]
fn productions_of_lpy_may_change_lists_of_the_model() {
    // Step 1: lengths 11, 2, 103; 11, 12, 203; 11, 12, 313. The first way of a bud takes its stores back where its test fails.
    let model = "lengths = [1, 2, 3]\nseen = []\ndef total():\n  s = 0\n  for x in lengths:\n    s += x\n  return s\nmodule Bud(k)\n\
                 Axiom: Bud(0) Bud(1) Bud(2)\nderivation length: 2\nproduction:\nBud(k):\n  lengths[k] += 10\n  lengths[-1] = lengths[-1] + 100\n  \
                 seen.append(k)\n  if k == 1:\n    produce F(total()) Bud(k)\n  if len(seen) > 3 and k in seen:\n    x = seen.pop()\n    \
                 produce G(x,len(seen),sum(lengths),max(lengths)-min(lengths))\n  produce H Bud(k)\n";
    assert_eq!(lpy(model), "HG(0,3,446,401)F(226)F(556)Bud(1)HG(2,4,666,602)");
    // A queue, whose first item is taken out, and functions that L-Py runs.
    let queue = "queue = [5]\ngrid = [0]*4\ndef Start():\n  global queue\n  queue = [1, 2, 3, 4]\n  for i in range(len(grid)):\n    grid[i] = i*i\n\
                 def EndEach():\n  for i in range(4):\n    grid[i] += 1\n  queue.append(grid[2])\n\
                 Axiom: A A\nderivation length: 3\nproduction:\nA:\n  x = queue.pop(0)\n  produce F(x,len(queue),grid[3]) A\n";
    assert_eq!(lpy(queue), "F(1,3,9)F(3,2,10)F(5,1,11)AF(2,2,9)F(4,1,10)F(6,0,11)A");
    // A dictionary with new keys, and its keys and values in a loop.
    let ages = "ages = {}\nkinds = {'a': 1}\ndef Start():\n  global ages\n  ages = {}\n  ages[100] = 5\ndef age(id):\n  return ages.get(id, 0)\n\
                Axiom: A(1) A(2)\nderivation length: 2\nproduction:\nA(i):\n  ages[i] = age(i) + i\n  kinds['b'] = len(ages)\n  t = 0\n  \
                for k in ages:\n    t += k\n  for k, v in ages.items():\n    t += 1000*v\n  if i in ages and 7 not in ages and 'b' in kinds:\n    \
                produce F(ages[i],len(ages),kinds['b'],t) A(i)\n";
    assert_eq!(lpy(ages), "F(1,2,2,6101)F(2,3,3,9103)A(1)F(2,3,3,8103)F(4,3,3,11103)A(2)");
    // What arrays of numbers cannot hold, and changes that they do not have.
    for (block, why) in [
        ("  q.append((i, 2))\n  produce A(i)\n", "a list as an item of the list 'q'"),
        ("  q[0] = d\n  produce A(i)\n", "a dictionary '{..}' where a number is expected"),
        ("  q[0][i] = 2\n  produce A(i)\n", "a change of an item within a list of lists"),
        ("  q[0] = i\n  produce A(i)\np = q\n", "which has two names"),
        ("  q.insert(0, i)\n  produce A(i)\n", "'insert' of the list 'q'"),
        ("  q[0] = i\n  produce A(q)\n", "the list 'q', which productions change, as a whole"),
        ("  q[0] = i\n  produce A(q[random()])\n", "a random number as an index"),
        ("  for k in range(int(i)): q[k] = 1\n  if i > 0: produce A(1)\n", "a test behind a loop that changes a list"),
    ] {
        let said = lpy_refusal(&format!(
            "q = [1, 2]\nd = {{'a': 1}}\nAxiom: A(0)\nderivation length: 1\nproduction:\nA(i):\n{block}"
        ));
        assert!(said.contains("L007") && said.contains(why), "{block}: {said}");
    }
    // An index outside of the list is reported, and nothing is set.
    let outside = "q = [1, 2]\nAxiom: A(0)\nderivation length: 3\nproduction:\nA(i):\n  q[i] = 5\n  produce A(i+1) F(q[i])\nendlsystem\n";
    let (g, _) = read(outside);
    let d = derive(&g, &DeriveOptions::default(), &Limits::default()).expect("derives");
    assert_eq!(g.print(&d.modules), "A(3)F(0)F(5)F(5)");
    assert!(d.warnings.iter().any(|w| w.code == "L026" && w.message.contains("'q'")), "{:?}", d.warnings);
}

#[test]
fn productions_of_lpy_may_change_lists_of_lists_and_of_points() {
    // grid[i][j] is i*j. Steps 1 and 2 make 1 and 2 of grid[i][1]; then 3 and 4.
    let model = "grid = [[0]*5 for i in range(4)]\npoints = []\npairs = [(1, 2)]\ndef mark(i, j):\n  grid[i][j] += 1\n  return i\n\
                 def addpoint(p):\n  points.append(p)\ndef height():\n  m = 0\n  for p in points:\n    m = max(m, p.z)\n  return m\n\
                 def Start():\n  for i in range(4):\n    for j in range(5):\n      grid[i][j] = i*j\n\
                 Axiom: A(0,0)\nderivation length: 4\nproduction:\nA(i,j):\n  mark(i,j+1)\n  points.append(Vector3(i,j,10*i))\n  \
                 addpoint((i,i,i))\n  pairs[0] = (i, 7)\n  pairs.append((i, grid[i][j+1]))\n  a, b = pairs[-1]\n  \
                 if grid[i][j+1] > 2 and i < 4:\n    \
                 produce F(a,b,height(),points[-2].z,len(points),pairs[0][1],grid[1][4],grid[-1][j]) A(i+1,j)\n  \
                 produce G(grid[i][j+1]) A(i+1,j)\n";
    assert_eq!(lpy(model), "G(1)G(2)F(2,3,20,20,6,7,4,0)F(3,4,30,30,8,7,4,0)A(4,0)");
}

#[test]
fn classes_of_lpy_may_have_methods() {
    // 4 * 0.5 * 2 = 4, which makes the bud dormant; then 5.
    let model = "light = 0.5\nclass Bud:\n  def __init__(self, vigor, dormant=False):\n    self.vigor = vigor\n    self.dormant = dormant\n  \
                 def grow(self, k=2):\n    return self.vigor*light*k\n  def set(self, v):\n    if v > 3:\n      self.dormant = True\n    self.vigor = v\n  \
                 def step(self):\n    self.set(self.vigor + 1)\n    return self.vigor\nmodule B, N\nAxiom: B(Bud(4.0)) N(Bud(1).grow(8))\n\
                 derivation length: 2\nproduction:\nB(b):\n  if b.dormant: produce B(b)\n  v = b.grow()\n  b.set(v)\n  w = b.step()\n  \
                 produce F(v,w)[+B(Bud(v*0.5, True))]B(b)\n";
    assert_eq!(lpy(model), "F(4,5)[+B(2,1)]B(5,1)N(4)");
    // An object with two holders, a method that two classes have, and one that none has.
    let said = lpy_refusal(&model.replace("]B(b)\n", "]B(b)B(b)\n"));
    assert!(said.contains("L007") && said.contains("the object 'b' in two places"), "{said}");
    let said = lpy_refusal(&model.replace("b.grow()", "b.shrink()"));
    assert!(said.contains("L007") && said.contains("the method 'shrink'"), "{said}");
    let second = "class Leaf:\n  def __init__(self):\n    self.vigor = 1\n  def grow(self):\n    return 2\nlight = 0.5";
    let said = lpy_refusal(&model.replacen("light = 0.5", second, 1));
    assert!(said.contains("L007") && said.contains("two classes have a method of this name"), "{said}");
}

#[test]
fn functions_of_lpy_may_change_the_lists_that_they_are_given() {
    // fill: 7, 3, 2, 1. walk: 1, 4, 9, each behind those of the call within it.
    let model = "def fill(q, n):\n  q.append(n)\n  if n > 1:\n    fill(q, n-1)\ndef walk(n, out=None):\n  if out is None: out = []\n  \
                 if n > 0:\n    walk(n-1, out)\n    out.append(n*n)\n  return out\nsizes = walk(2)\nAxiom: A(1)\nderivation length: 1\n\
                 production:\nA(x):\n  p = [7]\n  fill(p, 3)\n  r = walk(3)\n  produce B(len(p),p[1],p[3]) C(*r) D(sizes[1])\n";
    assert_eq!(lpy(model), "B(4,3,1)C(1,4,9)D(4)");
}

#[test]
fn lists_that_lpy_begins_with_in_start_are_those_of_the_model() {
    let model = "def Start():\n  global nodes, last\n  nodes = []\n  last = {}\nmodule N\nAxiom: N(1)\nderivation length: 3\nproduction:\n\
                 N(x):\n  nodes.append(x)\n  last['size'] = len(nodes)\n  produce F(last['size'],nodes[0]) N(x+1)\n";
    assert_eq!(lpy(model), "F(1,1)F(2,1)F(3,1)N(4)");
}
