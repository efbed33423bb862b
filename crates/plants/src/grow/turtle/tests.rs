//! Drawings of single commands of the turtle.

use std::collections::BTreeMap;
use std::sync::Arc;

use glam::{DVec3, Vec3};

use super::*;
use osier_base::diagnostic::Sources;
use osier_base::units::radians;
use osier_grammar::{DeriveOptions, GrammarSource, derive, parse};
use osier_scene::Mesh;
use osier_scene::plant::{NONE, validate};

pub(super) fn read(text: &str) -> Grammar {
    let mut sources = Sources::default();
    let defines = BTreeMap::new();
    let mut includes = |_: &str, _: &str| -> Result<(String, Vec<u8>)> { unreachable!("includes nothing") };
    let source = GrammarSource {
        name: "test.l",
        bytes: text.as_bytes(),
        includes: &mut includes,
        defines: &defines,
        functions: Default::default(),
    };
    parse(&mut sources, source, &Limits::default()).unwrap_or_else(|e| panic!("{e}")).0
}

fn try_draw(text: &str, options: &TurtleOptions) -> Result<(Plant, Vec<Diagnostic>)> {
    let g = read(text);
    let d = derive(&g, &DeriveOptions { seed: 3, plant_id: 9, ..Default::default() }, &Limits::default())?;
    grow(&g, &d, options, &Limits::default())
}

/// Draws an axiom with widths as they are.
fn draw(axiom: &str) -> Plant {
    let options = TurtleOptions { radii: RadiusModel::Widths, angle: Some(radians(90.0)), ..Default::default() };
    let text = format!("Lsystem: 1\nderivation length: 0\nAxiom: {axiom}\nendlsystem");
    try_draw(&text, &options).unwrap_or_else(|e| panic!("{e}")).0
}

fn near(a: Vec3, b: [f32; 3]) {
    assert!((a - Vec3::from(b)).length() < 1e-5, "{a} is not {b:?}");
}

fn tips(plant: &Plant) -> Vec<Vec3> {
    plant.axes.iter().map(|a| plant.nodes.p[plant.nodes_of(a).end - 1]).collect()
}

pub(super) fn leaf() -> OrganSpec {
    let mesh = Mesh {
        points: vec![Vec3::ZERO, Vec3::new(0.2, 0.5, 0.0), Vec3::new(-0.2, 0.5, 0.0)],
        normals: vec![Vec3::Z; 3],
        triangles: vec![[0, 1, 2]],
        ..Default::default()
    };
    let mesh = Arc::new(mesh.with_material(0));
    OrganSpec { name: "leaf".into(), meshes: vec![Arc::clone(&mesh), mesh], size: 0.1, petiole: 0.02 }
}

#[test]
fn steps_and_brackets_make_axes() {
    let plant = draw("F(1)[+F(2)[F(1)]F(1)]F(1)[-F(3)]f(1)F(1)");
    assert_eq!(plant.axes.len(), 5);
    let parents: Vec<u32> = plant.axes.iter().map(|a| a.parent).collect();
    assert_eq!(parents, [NONE, 0, 1, 0, NONE]);
    assert_eq!(plant.axes.iter().map(|a| a.order).collect::<Vec<_>>(), [0, 1, 2, 1, 0]);
    assert_eq!(plant.axes.iter().map(|a| a.count).collect::<Vec<_>>(), [3, 3, 2, 2, 2]);
    assert!((plant.axes[1].parent_s - 1.0).abs() < 1e-6 && (plant.axes[3].parent_s - 2.0).abs() < 1e-6);
    let tips = tips(&plant);
    // The start heads up, left is -X.
    near(tips[0], [0.0, 2.0, 0.0]);
    near(tips[1], [-3.0, 1.0, 0.0]);
    near(tips[2], [-3.0, 1.0, 0.0]);
    near(tips[3], [3.0, 2.0, 0.0]);
    near(tips[4], [0.0, 4.0, 0.0]);
    for (i, q) in plant.nodes.q.iter().enumerate() {
        assert!((q.length() - 1.0).abs() < 1e-6, "node {i}");
    }
    let side = plant.nodes.q[plant.axes[3].first as usize];
    near(side * Vec3::Y, [1.0, 0.0, 0.0]);
    near(side * Vec3::Z, [0.0, 0.0, 1.0]);
}

#[test]
fn nested_brackets_without_a_step_keep_their_parent() {
    let plant = draw("F(1)[[+F(1)][-F(1)]&F(1)]F(1)");
    assert_eq!(plant.axes.len(), 4);
    assert!(plant.axes[1..].iter().all(|a| a.parent == 0 && (a.parent_s - 1.0).abs() < 1e-6));
    let ids: std::collections::BTreeSet<u64> = plant.axes.iter().map(|a| a.id).collect();
    assert_eq!(ids.len(), 4);
}

#[test]
fn branches_on_axes_without_length_are_drawn() {
    // A root of one node: its branch becomes a root.
    let plant = draw("F(0)[+(90)F(1)]");
    assert_eq!((plant.axes.len(), plant.axes[0].parent), (1, NONE));
    near(tips(&plant)[0], [-1.0, 0.0, 0.0]);
    // A branch of one node half way up the stem: its branch grows from the stem there.
    let plant = draw("F(1)[F(0)[+(90)F(1)]]F(1)");
    assert_eq!((plant.axes.len(), plant.axes[1].parent, plant.axes[1].parent_s), (2, 0, 1.0));
    near(tips(&plant)[1], [-1.0, 1.0, 0.0]);
}

#[test]
fn widths_taper_from_segment_to_segment() {
    let plant = draw("!(2)F!(1)F");
    assert_eq!(plant.nodes.r.iter().map(|r| (r * 100.0).round()).collect::<Vec<_>>(), [100.0, 50.0, 50.0]);
    let plant = draw("!(2)F!(1)F!(0.5)");
    assert_eq!(plant.nodes.r.iter().map(|r| (r * 100.0).round()).collect::<Vec<_>>(), [100.0, 50.0, 25.0]);
    // The segment closes at the bracket, so the node has two widths: their mean counts.
    let plant = draw("!(2)F[+!(1)F]!(1)F");
    assert_eq!(plant.nodes.r.iter().take(3).map(|r| (r * 100.0).round()).collect::<Vec<_>>(), [100.0, 75.0, 50.0]);
    let plant = draw("@D(2)!(1)F(1)@Di(0.5)F(1)@Dd(0.25)F(1)@DF(1)");
    let s: Vec<f32> = plant.nodes.s.clone();
    assert_eq!(s, [0.0, 2.0, 3.0, 7.0, 8.0]);
}

#[test]
fn positions_and_directions_can_be_set() {
    let plant = draw("@M(1,2,3)@R(1,0,0)F(2)@R(0,0,1,0,-1,0)F");
    near(plant.nodes.p[0], [1.0, 2.0, 3.0]);
    near(plant.nodes.p[1], [3.0, 2.0, 3.0]);
    near(plant.nodes.p[2], [3.0, 2.0, 4.0]);
    let plant = draw("+(60)/(40)@vF");
    near(plant.nodes.q[0] * Vec3::Z, [0.5 * 3.0_f32.sqrt() / 3.0_f32.sqrt(), 0.75_f32.sqrt(), 0.0]);
    let plant = draw("F|F(3)");
    near(tips(&plant)[0], [0.0, -2.0, 0.0]);
}

#[test]
fn organs_stand_in_the_turtles_frame() {
    let mut options = TurtleOptions { radii: RadiusModel::Widths, ..Default::default() };
    options.organs.insert('l', leaf());
    let text = "Lsystem: 1\nderivation length: 0\nAxiom: F(1)[+(90)~l(2)]F(1)~l@O(0.5)~l(1,2,1)~k\nendlsystem";
    let (plant, warnings) = try_draw(text, &options).expect("draws");
    assert_eq!(plant.organs.len(), 4);
    let o = &plant.organs[0];
    assert!((o.s - 1.0).abs() < 1e-6 && (o.scale - 0.4).abs() < 1e-6 && (o.petiole - 0.04).abs() < 1e-6);
    let (pivot, q) = plant.organ_site(o);
    near(pivot, [-0.04, 1.0, 0.0]);
    near(q * Vec3::Y, [-1.0, 0.0, 0.0]);
    near(q * Vec3::Z, [0.0, 0.0, 1.0]);
    assert!(plant.organs.iter().all(|o| (0.0..1.0).contains(&o.tint)));
    let names: Vec<&str> = plant.protos.iter().map(|p| p.name.as_str()).collect();
    assert_eq!(names[..3], ["leaf_0", "leaf_1", "sphere"]);
    assert_eq!(warnings.iter().map(|w| w.code).collect::<Vec<_>>(), ["L048"]);
}

#[test]
fn a_string_of_organs_alone_gets_a_stub() {
    let mut options = TurtleOptions::default();
    options.organs.insert('l', leaf());
    let text = "Lsystem: 1\nderivation length: 0\nAxiom: [+(30)~l][-(30)~l]\nendlsystem";
    let (plant, _) = try_draw(text, &options).expect("draws");
    assert_eq!((plant.axes.len(), plant.organs.len()), (1, 2));
}

#[test]
fn polygons_are_filled_where_they_stand() {
    let text = "F(1)[+(90){.f(1)-(90)f(1)-(90)f(1).}][-(90){.f(2)+(90)f(2)+(90)f(2).}]";
    let plant = draw(text);
    assert_eq!(plant.organs.len(), 2);
    for (o, area) in plant.organs.iter().zip([1.0, 4.0]) {
        let mesh = &plant.protos[usize::from(o.proto)].mesh;
        let (p, q) = plant.organ_site(o);
        let world: Vec<Vec3> = mesh.points.iter().map(|c| p + q * (*c * o.scale)).collect();
        let sum: f32 = mesh.triangles.iter().fold(0.0, |s, t| {
            let [a, b, c] = t.map(|i| world[i as usize]);
            s + (b - a).cross(c - a).length() * 0.5
        });
        let expected = [area, 5.0 - area];
        assert!(expected.iter().any(|e| (sum - e).abs() < 1e-4), "{sum}");
        assert!(world.iter().any(|w| (*w - Vec3::Y).length() < 1e-5), "begins at the node");
    }
}

#[test]
fn koch_ends_where_it_should() {
    for n in 0..6 {
        let text = format!(
            "Lsystem: 1\nderivation length: {n}\nAxiom: F(1)\nF(d) --> F(d/3)+(60)F(d/3)-(120)F(d/3)+(60)F(d/3)\nendlsystem"
        );
        let (plant, _) = try_draw(&text, &TurtleOptions::default()).expect("draws");
        assert_eq!(plant.axes.len(), 1);
        assert_eq!(plant.axes[0].count, 4_u32.pow(n) + 1);
        near(tips(&plant)[0], [0.0, 1.0, 0.0]);
        let step = plant.nodes.p[1].distance(plant.nodes.p[0]);
        assert!((step * osier_base::math::pow_f32(3.0, n as f32) - 1.0).abs() < 1e-5);
    }
}

#[test]
fn tropisms_are_steered_from_the_string() {
    let options = TurtleOptions {
        tropisms: vec![Tropism { elasticity: 0.0, step: 0.05, ..Default::default() }],
        radii: RadiusModel::Widths,
        ..Default::default()
    };
    let heading = |axiom: &str| {
        let text = format!("Lsystem: 1\nderivation length: 0\nAxiom: {axiom}\nendlsystem");
        let (plant, _) = try_draw(&text, &options).expect("draws");
        let n = plant.nodes.len();
        let d = (plant.nodes.p[n - 1] - plant.nodes.p[n - 2]).normalize();
        osier_base::math::acos(DVec3::from(d).y) * 180.0 / std::f64::consts::PI
    };
    assert!((heading("+(60)F") - 60.0).abs() < 1e-4);
    assert!((heading("@Ts(1,0.1)+(60)F") - 55.038).abs() < 1e-3);
    assert!((heading("@Ti(1)@Ti(1,0.05)+(60)F") - 55.038).abs() < 1e-3);
    assert!((heading("@Ts(1,0.3)@Td(1,0.2)+(60)F") - 55.038).abs() < 1e-3);
}

#[test]
fn a_roll_is_kept_by_the_command_behind_it() {
    let options = TurtleOptions {
        tropisms: vec![Tropism { elasticity: 0.1, ..Default::default() }],
        radii: RadiusModel::Widths,
        ..Default::default()
    };
    // The tropism of the second segment undoes the roll before it, and the branch lies in the plane of the first turn; `@Tf` keeps
    // the roll since the last segment and no later one.
    for (axiom, is_kept) in
        [("+(60)F/(90)F[+(90)F]", false), ("+(60)F/(90)@Tf F[+(90)F]", true), ("@Tf+(60)F/(90)F[+(90)F]", false)]
    {
        let text = format!("Lsystem: 1\nderivation length: 0\nAxiom: {axiom}\nendlsystem");
        let (plant, _) = try_draw(&text, &options).expect("draws");
        let depth = plant.nodes.p.iter().fold(0.0_f32, |z, p| z.max(p.z.abs()));
        assert_eq!(depth > 0.5, is_kept, "{axiom}: {depth}");
        assert!(is_kept || depth < 1e-5, "{axiom}: {depth}");
    }
}

#[test]
fn numbers_that_commands_of_cpfg_leave_out() {
    // `@Ts(i)` sets an elasticity of 0, whatever the tropism has.
    let options = TurtleOptions {
        tropisms: vec![Tropism { elasticity: 0.1, ..Default::default() }],
        radii: RadiusModel::Widths,
        ..Default::default()
    };
    for (command, angle) in [("", 55.038), ("@Ts(1)", 60.0), ("@Ts(1,0.1)", 55.038)] {
        let text = format!("Lsystem: 1\nderivation length: 0\nAxiom: {command}+(60)F\nendlsystem");
        let (plant, _) = try_draw(&text, &options).expect("draws");
        let d = (plant.nodes.p[1] - plant.nodes.p[0]).normalize();
        let found = osier_base::math::acos(DVec3::from(d).y) * 180.0 / std::f64::consts::PI;
        assert!((found - angle).abs() < 1e-3, "{command}: {found}");
    }
    // Of generalised cylinders the numbers of one side are those of both.
    let points = |command: &str| {
        let plant = draw(&format!("#(0.2)@Gs{command}f(1)@Gc(4)+f(1)@Ge(4)"));
        assert_eq!(plant.organs.len(), 1, "{command}");
        plant.protos[usize::from(plant.organs[0].proto)].mesh.points.clone()
    };
    for (short, long) in [("@Gt(0.3)", "@Gt(0.3,0.3)"), ("@Gr(30,1)", "@Gr(30,1,30,1)")] {
        assert_eq!(points(short), points(long), "{short}");
        assert_ne!(points(short), points(""), "{short}");
    }
}

#[test]
fn oddities_are_told() {
    let code = |axiom: &str| {
        let text = format!("Lsystem: 1\nderivation length: 0\nAxiom: {axiom}\nendlsystem");
        match try_draw(&text, &TurtleOptions::default()) {
            Ok((_, w)) => w.iter().map(|d| d.code).collect::<Vec<_>>(),
            Err(e) => vec![if e.to_string().contains("L043") { "L043!" } else { "other!" }],
        }
    };
    assert_eq!(code("F]F"), ["L053"]);
    assert_eq!(code("F+F"), ["L045"]);
    assert_eq!(code("F?E(1)"), ["L008"]);
    assert_eq!(code("F(log(0))F(1)"), ["L041"]);
    assert_eq!(code("F@GzF"), ["L008"]);
    assert_eq!(code("F@GzF@GyF@mcF@mcF"), ["L008"; 3]);
    assert_eq!(code("@Gs@#(7)f@Ge"), ["L048"]);
    assert_eq!(code("@PD(1,2,2)@Tx(3)F"), ["L048"; 2]);
    assert_eq!(code("F@SF"), ["L043!"]);
    // Commands for rayshade are reported and left out.
    for axiom in ["F@I(1)F", "F@JF", "F@moF", "F@mo(2,2,2)F"] {
        assert_eq!(code(axiom), ["L008"], "{axiom}");
        assert_eq!(draw(axiom).nodes.len(), 3, "{axiom}");
    }
    assert_eq!(code("@Ts(3,1)F"), ["L048"]);
    // A parameter is reported once for each of its occurrences in the string.
    let text = "Lsystem: 1\nderivation length: 0\nAxiom: @Ts(log(0),1)F\nendlsystem";
    let (_, told) = try_draw(text, &TurtleOptions::default()).expect("draws");
    assert!(told.iter().any(|d| d.code == "L041" && !d.message.contains("times")), "{told:?}");
}

#[test]
fn cylinders_go_on_in_branches_and_end_with_the_string() {
    // Strips of each cylinder of 8 sides, in the order of the string, and its height.
    let cylinders = |axiom: &str| -> Vec<(usize, f32)> {
        let plant = draw(axiom);
        let cylinder = |o: &osier_scene::plant::Organ| {
            let mesh = &plant.protos[usize::from(o.proto)].mesh;
            let tall = mesh.points.iter().fold(0.0_f32, |m, p| m.max(p.y)) * o.scale;
            (mesh.triangles.len() / 16, (tall * 1e3).round() / 1e3)
        };
        plant.organs.iter().map(cylinder).collect()
    };
    // A branch continues the cylinder from its last point on; beside it, segments are drawn as ever.
    assert_eq!(cylinders("#(0.2)@Gsf(1)@Gc(2)[f(2)@Ge(3)]f(4)@Ge(4)").len(), 2);
    let mut found = cylinders("#(0.2)@Gsf(1)@Gc(2)[f(2)@Gc(3)]f(4)@Ge(4)");
    found.sort_by_key(|c| c.0);
    assert_eq!(found, [(3, 2.0), (6, 5.0)]);
    // The end of the string is that of the cylinder, also within brackets that it leaves open.
    assert_eq!(cylinders("#(0.2)@Gsf(1)@Gc(2)"), [(2, 1.0)]);
    assert_eq!(cylinders("#(0.2)@Gsf(1)@Gc(2)[f(2)@Gc(3)").len(), 2);
    // A branch without a point of its own draws its segments, and nothing of the cylinder.
    let plant = draw("#(0.2)@Gsf(1)@Gc[+F(3)]f(1)@Ge");
    assert_eq!((plant.organs.len(), plant.axes.len()), (1, 1));
}

#[test]
fn deep_brackets_neither_recurse_nor_pass_the_limit() {
    let grow_on_small_stack = |text: String| {
        std::thread::Builder::new()
            .stack_size(256 * 1024)
            .spawn(move || try_draw(&text, &TurtleOptions::default()).map(|p| p.0.axes.len()))
            .expect("thread")
            .join()
            .expect("no overflow")
    };
    let text = format!("Lsystem: 1\nderivation length: 0\nAxiom: F{}\nendlsystem", "[F".repeat(50_000));
    assert_eq!(grow_on_small_stack(text).expect("within limits"), 50_001);
    // A million brackets in a text are refused as it is read; these come from productions.
    let text = "Lsystem: 1\nderivation length: 21\nAxiom: F A(0)\nA(n) : n < 20 --> A(n+1) A(n+1)\nA(n) : n >= 20 --> [\nendlsystem";
    let e = grow_on_small_stack(text.to_owned()).expect_err("too deep").to_string();
    assert!(e.contains("L051") && e.contains("open branches"), "{e}");
}

#[test]
fn pipe_model_keeps_its_sums() {
    let text = "Lsystem: 1\nderivation length: 6\nAxiom: A\nA --> F(0.5)[+(30)A]/(90)[-(30)A]/(90)F(0.3)A\nendlsystem";
    let (plant, _) = try_draw(text, &TurtleOptions::default()).expect("draws");
    assert!(plant.axes.len() > 200);
    for a in &plant.axes {
        let r = &plant.nodes.r[plant.nodes_of(a)];
        assert!(r.windows(2).all(|w| w[1] <= w[0]), "never grows along s");
        assert!((r[r.len() - 1] - 0.0015).abs() < 1e-6, "tip");
    }
    let pipe = radii::Pipe { base: Some(0.08), ..Default::default() };
    let options = TurtleOptions { radii: RadiusModel::Pipe(pipe), ..Default::default() };
    let (mut plant, _) = try_draw(text, &options).expect("draws");
    assert!((plant.nodes.r[0] - 0.08).abs() < 1e-6, "base {}", plant.nodes.r[0]);
    let thinnest = plant.nodes.r.iter().fold(1.0_f32, |m, r| m.min(*r));
    assert!((thinnest - 0.0015).abs() < 1e-6, "tip {thinnest}");
    let taper = radii::Taper { base: 0.05, tip: 0.001, exponent: 1.0 };
    radii::taper(&mut plant, &taper);
    assert!((plant.nodes.r[0] - 0.05).abs() < 1e-6);
    assert!((plant.nodes.r[plant.axes[0].count as usize - 1] - 0.001).abs() < 1e-6);
}

#[test]
fn any_number_of_threads_grows_the_same_plant() {
    let text = "Lsystem: 1\nSeed: 2\nderivation length: 9\nAxiom: A(1)\n\
        A(s) --> F(s)[+(ran(60))A(s*0.8)]/(90+nran(0,9))[-(20)A(s*0.7)~l]A(s*0.9) : 3\nA(s) --> F(s)A(s) : 1\nendlsystem";
    let mut options = TurtleOptions::default();
    options.organs.insert('l', leaf());
    let run = |threads: usize| {
        let plant = osier_base::par::on_threads(threads, || try_draw(text, &options)).expect("draws").0;
        format!("{:?}{:?}{:?}", plant.axes, plant.nodes, plant.organs)
    };
    let one = run(1);
    assert!(one == run(2) && one == run(5));
}

#[test]
fn grown_plants_need_no_repair() {
    let text = "Lsystem: 1\nderivation length: 5\nAxiom: !(0.2)A(0.2)\nA(w) --> !(w)F(1)[+(30)!(w*2)A(w*2)]F(0)/(70)A(w*0.7)\nendlsystem";
    let options = TurtleOptions { radii: RadiusModel::Widths, ..Default::default() };
    let (mut plant, _) = try_draw(text, &options).expect("draws");
    let again = validate(&mut plant).expect("valid");
    assert!(again.iter().all(|w| !w.message.contains("thinned") && !w.message.contains("dropped")), "{again:?}");
    for a in plant.axes.iter().filter(|a| a.parent != NONE) {
        assert!(a.s_exposed > 0.0 && a.s_exposed <= a.length);
    }
}

/// The string of a grammar whose queries a turtle with these units answers.
fn asked(steps: u32, axiom: &str, rules: &str, unit_m: f64) -> (Grammar, osier_grammar::DerivedString) {
    let g = read(&format!("Lsystem: 1\nderivation length: {steps}\nAxiom: {axiom}\n{rules}\nendlsystem"));
    let options = TurtleOptions { unit_m, ..Default::default() };
    let d =
        super::derive(&g, &DeriveOptions::default(), &options, &Limits::default()).unwrap_or_else(|e| panic!("{e}"));
    (g, d)
}

#[test]
fn queries_are_answered_in_turtle_units() {
    let (_, d) = asked(0, "F(2)+(90)F(3)?P(0,0,0)?H(0,0)?L(0,0,0)[&(90)?U(9,9,9)]f(5)?P(0)", "", 0.01);
    let found: Vec<f32> = d.modules.iter().flat_map(|m| m.params.to_vec()).collect();
    // Behind the lengths and angles: P, H (two of its values), L; after `&(90)` H is -U and U is the old H, here -X, whose
    // opposite cpfg prints; then P again, 5 further along -X.
    let wanted = [2.0, 90.0, 3.0, -3.0, 2.0, 0.0, -1.0, 0.0, 0.0, -1.0, 0.0, 90.0, 1.0, 0.0, 0.0, 5.0, -8.0];
    assert_eq!(found.len(), wanted.len(), "{found:?}");
    assert!(found.iter().zip(wanted).all(|(a, b): (&f32, f32)| (a - b).abs() < 1e-5), "{found:?}");
}

#[test]
fn the_up_vector_has_the_sign_of_cpfg() {
    let (g, d) = asked(0, "+(30)&(30)/(30)?U(0,0,0)", "", 1.0);
    assert!(g.print(&d.modules).ends_with("?U(0.649519,-0.125,-0.75)"), "{}", g.print(&d.modules));
}

#[test]
fn answers_steer_the_next_step() {
    // The query says 0, 1, 2 after the axiom and two steps; then the condition fails.
    let (g, d) = asked(5, "A?P(0,0)", "A > ?P(x,y) : y < 2 --> FA", 1.0);
    assert_eq!(g.print(&d.modules), "FFA?P(0,2)");
    // Bounds of what is drawn, without a query in the string; moves count for nothing.
    let (g, d) = asked(5, "A", "A : vvYmax() < 2 && vvXmin() == 0 --> FA", 1.0);
    assert_eq!(g.print(&d.modules), "FFA");
    // cpfg writes them with the number of the view.
    let (g, d) = asked(5, "A", "A : 3+vvYmax(2-1) < 5 && vvXmin(1) == 0 --> FA", 1.0);
    assert_eq!(g.print(&d.modules), "FFA");
    // A homomorphism draws what the query asks about.
    let (g, d) = asked(1, "A?P(0,0)", "A --> AA\nHomomorphism\nA --> F(3)", 1.0);
    assert_eq!(g.print(&d.modules), "AA?P(0,6)");
    let d = osier_grammar::derive(&g, &DeriveOptions::default(), &Limits::default()).expect("derives");
    assert_eq!(g.print(&d.modules), "AA?P(0,0)", "nobody answers");
}

#[test]
fn a_sub_l_system_is_drawn_at_its_scale() {
    let options = TurtleOptions { radii: RadiusModel::Widths, ..Default::default() };
    let text = "Lsystem: 1\nderivation length: 0\nAxiom: !(1)F(1)?(2,0.5)F(1)!(1)F(1)$F(1)\nendlsystem\n\
        Lsystem: 2\nderivation length: 0\nAxiom: F\nendlsystem";
    let plant = try_draw(text, &options).unwrap_or_else(|e| panic!("{e}")).0;
    // 1 + 0.5 + 0.5 + 1; each segment ends with the width in force at the next one: 1 to 0.5, 0.5, 0.5 to 1, 1.
    near(tips(&plant)[0], [0.0, 3.0, 0.0]);
    let r = &plant.nodes.r;
    assert!(r.iter().zip([0.5, 0.25, 0.25, 0.5, 0.5]).all(|(a, b): (&f32, f32)| (a - b).abs() < 1e-6), "{r:?}");
}

#[test]
fn labels_are_read_and_draw_nothing() {
    let g =
        read("Lsystem: 1\nderivation length: 1\nAxiom: A(3)\nA(x) --> F(x) @L(\"height %f\",x) @L(\"b\")\nendlsystem");
    let d = derive(&g, &DeriveOptions::default(), &Limits::default()).expect("derives");
    let (plant, warnings) = grow(&g, &d, &TurtleOptions::default(), &Limits::default()).expect("draws");
    assert!(warnings.is_empty(), "{warnings:?}");
    assert_eq!(plant.axes.len(), 1);
}

#[test]
fn numbers_without_end_are_told_with_the_module_that_makes_them() {
    let said = |rule: &str| {
        let text = format!("Lsystem: 1\nderivation length: 1\nAxiom: F(1)A\nB --> F(2)\nA --> {rule}\nendlsystem");
        let g = read(&text);
        let d = derive(&g, &DeriveOptions::default(), &Limits::default()).expect("derives");
        let (plant, warnings) = grow(&g, &d, &TurtleOptions::default(), &Limits::default()).expect("draws");
        assert!(plant.nodes.p.iter().all(|p| p.is_finite()));
        let codes: Vec<&str> = warnings.iter().map(|w| w.code).collect();
        (codes.join(" "), g.report(warnings).to_string())
    };
    for rule in ["F(exp(1000))F(1)", "F(3*10^38)F(1)", "@D(exp(60))F(exp(30))F(1)", "F(sqrt(0-1))F(1)"] {
        let (codes, text) = said(rule);
        assert!(codes.contains("L041") && text.contains("test.l:5:"), "{rule}: {text}");
    }
}

#[test]
fn a_string_that_draws_nothing_names_its_symbols() {
    let g = read("Lsystem: 1\nderivation length: 1\nAxiom: AB\nA --> CCC\nendlsystem");
    let d = derive(&g, &DeriveOptions::default(), &Limits::default()).expect("derives");
    let (_, warnings) = grow(&g, &d, &TurtleOptions::default(), &Limits::default()).expect("draws");
    let [one] = warnings.as_slice() else { panic!("{warnings:?}") };
    assert_eq!(
        (one.code, one.message.as_str()),
        ("L037", "the derived string draws nothing; it consists of C (3 times), B (once)")
    );
}

#[test]
fn a_query_for_the_rotation_gets_a_quaternion() {
    // Half angles: a turn by 90 degrees about +Z is (0, 0, sin 45, cos 45), a pitch about L = -X has its axis along -X.
    let (_, d) = asked(0, "?Q(9,9,9,9)[+(90)?Q(9,9,9,9)]&(90)?Q(9,9,9,9)", "", 1.0);
    let found: Vec<f32> = d.modules.iter().flat_map(|m| m.params.to_vec()).collect();
    let half = std::f32::consts::FRAC_1_SQRT_2;
    let wanted = [0.0, 0.0, 0.0, 1.0, 90.0, 0.0, 0.0, half, half, 90.0, -half, 0.0, 0.0, half];
    assert_eq!(found.len(), wanted.len(), "{found:?}");
    assert!(found.iter().zip(wanted).all(|(a, b): (&f32, f32)| (a - b).abs() < 1e-6), "{found:?}");
}

#[test]
fn nothing_is_drawn_behind_a_cut_if_the_view_says_so() {
    let text = "Lsystem: 1\nderivation length: 0\nAxiom: F(1)[+F(2)%F(3)[F(4)]F(5)]F(1)%F(9)\nendlsystem";
    let length = |past_cut: bool| {
        let options = TurtleOptions { past_cut, angle: Some(radians(90.0)), ..Default::default() };
        let plant = try_draw(text, &options).unwrap_or_else(|e| panic!("{e}")).0;
        plant.axes.iter().map(|a| a.length).sum::<f32>()
    };
    // 1 + 2 + 1 are left of 1 + 2 + 3 + 4 + 5 + 1 + 9.
    assert!((length(true) - 25.0).abs() < 1e-4 && (length(false) - 4.0).abs() < 1e-4);
}

/// Draws an axiom of L-Py with the curves `bend`, a step along x and one along y; `rise`, a step along y and one along x; `path`, along
/// x; `square`, with corners at 1 and -1; and the function `half`, 1 - x / 2.
fn draw_lpy(axiom: &str) -> (Plant, Vec<Diagnostic>) {
    let text = format!(
        "bend = Polyline2D([(0,0),(1,0),(1,1)])\nrise = Polyline2D([(0,0),(0,1),(1,1)])\npath = Polyline2D([(3,0),(4,0)])\n\
         square = Polyline2D([(-1,-1),(1,-1),(1,1),(-1,1),(-1,-1)])\nhalf = QuantisedFunction([(0,1),(1,0.5)])\n\
         Axiom: {axiom}\nderivation length: 0\nproduction:\nendlsystem\n"
    );
    let options = TurtleOptions { radii: RadiusModel::Widths, ..Default::default() };
    try_draw(&text, &options).unwrap_or_else(|e| panic!("{e}"))
}

#[test]
fn steps_of_lpy_follow_a_guide() {
    let end = |axiom: &str| tips(&draw_lpy(axiom).0).last().copied().unwrap_or(Vec3::NAN);
    // The curve, 2 long, is stretched to 4: 2 ahead, which is +Y, then 2 to up, which is +X. Behind its end the turtle goes straight on.
    near(end("SetGuide(bend,4)F(2)"), [0.0, 2.0, 0.0]);
    near(end("SetGuide(bend,4)F(2)F(2)"), [2.0, 2.0, 0.0]);
    near(end("SetGuide(bend,4)F(2)F(2)F(1)"), [3.0, 2.0, 0.0]);
    near(end("SetGuide(bend,4)nF(4,1)"), [2.0, 2.0, 0.0]);
    // A step over the corner is its chord, and one over the end goes on in the last direction.
    near(end("SetGuide(bend,4)F(4)"), [2.0, 2.0, 0.0]);
    near(end("SetGuide(bend,4)F(3)F(2)"), [3.0, 2.0, 0.0]);
    // A branch has the guide as it is there; without it the turtle keeps the direction of the curve.
    let branched = tips(&draw_lpy("SetGuide(bend,4)F(2)[F(1)]F(2)").0);
    near(branched[0], [2.0, 2.0, 0.0]);
    near(branched[1], [1.0, 2.0, 0.0]);
    near(end("SetGuide(bend,4)F(3)EndGuide F(2)"), [3.0, 2.0, 0.0]);
    near(end("SetGuide(bend,4)PositionOnGuide(3)F(1)"), [0.0, 1.0, 0.0]);
    // The curve that begins along y turns about up: its x is to the right, -Z.
    near(end("SetGuide(rise,2,True)F(1)F(1)"), [0.0, 1.0, -1.0]);
    let (_, told) = draw_lpy("SetGuide(7,2)F(1)SetGuide(bend,0)F(1)");
    assert_eq!(told.iter().map(|d| d.code).collect::<Vec<_>>(), ["L048", "L041"], "{told:?}");
}

#[test]
fn contours_of_lpy_are_swept_along_paths() {
    // Sizes of the surface along the axes of its space, sorted.
    let sizes = |axiom: &str| {
        let (plant, told) = draw_lpy(axiom);
        assert!(told.iter().all(|d| d.code != "L008"), "{told:?}");
        let organ = plant.organs.first().expect("a surface");
        let points = &plant.protos[usize::from(organ.proto)].mesh.points;
        let low = points.iter().fold(Vec3::INFINITY, |a, p| a.min(*p));
        let high = points.iter().fold(Vec3::NEG_INFINITY, |a, p| a.max(*p));
        let mut sizes = ((high - low) * organ.scale).to_array();
        sizes.sort_unstable_by(f32::total_cmp);
        Vec3::from(sizes)
    };
    // A prism of width 1, twice the radius, and length 2.
    near(sizes("F(1)Sweep(path,square,2,1,0.5)"), [1.0, 1.0, 2.0]);
    near(sizes("F(1)SetContour(square)_(0.5)StartGC F(1)F(1)EndGC"), [1.0, 1.0, 2.0]);
    // The radius falls to a half.
    let (plant, _) = draw_lpy("F(1)Sweep(path,square,2,1,0.5,half)");
    let mesh = &plant.protos[usize::from(plant.organs[0].proto)].mesh;
    let rings = mesh.points.chunks(17).map(|ring| (ring[0] - ring[8]).length() * plant.organs[0].scale);
    let diagonal = std::f32::consts::SQRT_2;
    for (ring, wanted) in rings.zip([diagonal, 0.75 * diagonal, 0.5 * diagonal]) {
        assert!((ring - wanted).abs() < 1e-5, "{ring} is not {wanted}");
    }
    // The turtle stays at the beginning of a sweep.
    near(tips(&draw_lpy("F(1)Sweep(path,square,2,1,0.5)F(1)").0)[0], [0.0, 2.0, 0.0]);
    // Segments beside StartGC are round.
    assert!(draw_lpy("SetContour(square)F(1)").1.iter().any(|d| d.code == "L008"));
}
