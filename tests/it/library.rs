//! The grammars of the library do what their comments say.
#![allow(clippy::expect_used, reason = "tests fail by panicking")]

use std::collections::{BTreeMap, BTreeSet};

use osier::diagnostic::Sources;
use osier::grammar::{DeriveOptions, GrammarSource, derive, parse};
use osier::limits::Limits;
use osier::presets::find;
use osier::recipe::{Request, resolve};

use crate::common::grown;

/// The derived string of a grammar with other values of its `#define`s.
pub fn derived(name: &str, text: &str, set: &[(&str, &str)]) -> String {
    let defines: BTreeMap<String, String> = set.iter().map(|(k, v)| ((*k).to_owned(), (*v).to_owned())).collect();
    let mut includes = |name: &str, _: &str| panic!("{name} is included");
    let (bytes, functions) = (text.as_bytes(), Default::default());
    let source = GrammarSource { name, bytes, includes: &mut includes, defines: &defines, functions };
    let grammar = parse(&mut Sources::default(), source, &Limits::default()).unwrap_or_else(|e| panic!("{e}")).0;
    let string = derive(&grammar, &DeriveOptions::default(), &Limits::default()).unwrap_or_else(|e| panic!("{e}"));
    grammar.print(&string.modules)
}

fn preset(name: &str, set: &[(&str, &str)]) -> String {
    derived(name, find(name).expect("preset").text, set)
}

/// Modules of a symbol with their parameters, in order.
fn modules(string: &str, symbol: &str) -> Vec<Vec<f64>> {
    let numbers = |text: &str| text.split(',').map(|n| n.parse().expect("a number")).collect();
    let opening = format!("{symbol}(");
    let arguments = string.split(&opening).skip(1).filter_map(|rest| rest.split(')').next());
    arguments.map(numbers).collect()
}

/// The plant of a bare grammar.
fn plant(name: &str, set: &[&str]) -> osier::plant::Plant {
    let mut request = Request::bare(name.trim_end_matches(".l"), name);
    request.set = set.iter().map(|s| (*s).to_owned()).collect();
    let mut recipe = resolve(&request).expect("resolves").0;
    grown::small(&mut recipe);
    grown::individuals(&recipe).remove(0).plant
}

/// The counts of F of the structures a to f of the textbook, by its closed forms.
#[test]
fn textbook_structures_have_their_lengths() {
    for (figure, count) in [("1", 3125), ("2", 3125), ("3", 4096), ("4", 4118), ("5", 4118), ("6", 1488)] {
        let string = preset("textbook-plants.l", &[("FIGURE", figure)]);
        assert_eq!(string.matches('F').count(), count, "figure {figure}");
    }
}

#[test]
fn the_curve_in_space_visits_every_cell_once() {
    let curve = plant("hilbert.l", &["SIZE=8", "ORDER=3"]);
    assert_eq!(curve.axes.len(), 1);
    // Adding zero turns -0 into 0.
    let cell = |v: f32| format!("{}", v.round() + 0.0);
    let cells: BTreeSet<[String; 3]> = curve.nodes.p.iter().map(|p| p.to_array().map(cell)).collect();
    assert_eq!((curve.nodes.p.len(), cells.len()), (512, 512));
    for axis in 0..3 {
        let values: BTreeSet<&String> = cells.iter().map(|c| &c[axis]).collect();
        assert_eq!(values.len(), 8, "{values:?}");
    }
}

/// Each step adds one thin and one thick half to a thin one, two thick and one thin to a thick one.
#[test]
fn penrose_halves_grow_as_their_matrix_says() {
    let (mut thin, mut thick) = (10, 0);
    for order in 1..=5 {
        (thin, thick) = (thin + thick, thin + 2 * thick);
        let string = preset("penrose.l", &[("ORDER", &order.to_string())]);
        assert_eq!((string.matches("T(").count(), string.matches("P(").count()), (thin, thick), "order {order}");
    }
    // No corner lies outside the decagon, and the sides have one length.
    let tiling = plant("penrose.l", &["ORDER=3", "SIZE=1"]);
    let far = tiling.nodes.p.iter().map(|p| (p.x * p.x + (p.y - 1.0) * (p.y - 1.0)).sqrt()).fold(0.0, f32::max);
    assert!(far < 1.0 + 1e-4, "{far}");
    let side = 5.0_f32.sqrt() - 2.0;
    assert!(tiling.axes.iter().all(|a| (a.length / side - 1.0).abs() < 1e-3));
}

/// Fold k of a strip turns left if the odd part of k is 1 modulo 4.
#[test]
fn the_dragon_folds_as_paper_does() {
    let string = preset("dragon.l", &[("ORDER", "8")]);
    let folds: Vec<char> = string.chars().filter(|c| "LR".contains(*c)).collect();
    assert_eq!(folds.len(), 255);
    for (k, fold) in (1_u32..).zip(folds) {
        let odd = k >> k.trailing_zeros();
        assert_eq!(fold == 'L', odd % 4 == 1, "fold {k}");
    }
}

#[test]
fn plane_curves_end_where_they_should() {
    for (name, edges) in [("gosper.l", 2401), ("sierpinski.l", 729)] {
        let curve = plant(name, &[]);
        assert_eq!(curve.nodes.p.len(), edges + 1, "{name}");
        let gap = curve.nodes.p[0].distance(curve.nodes.p[edges]);
        assert!((gap - 1.0).abs() < 1e-4, "{name}: its ends are {gap} apart");
    }
}

/// Cells of Anabaena: special ones are never neighbours, their distances even, and their share stays about the same.
#[test]
fn special_cells_keep_their_distances() {
    for steps in ["30", "46", "60"] {
        let string = preset("anabaena.l", &[("STEPS", steps)]);
        let kinds: String = string.chars().filter(|c| "CH".contains(*c)).collect();
        let gaps: Vec<usize> = kinds.trim_matches('H').split('H').map(str::len).collect();
        assert!(gaps.len() >= 2, "{kinds}");
        assert!(gaps.iter().all(|n| (2..=16).contains(n)), "step {steps}: {kinds}");
    }
}

/// The spike appears only after the first signal has climbed, and upper branches wake first.
#[test]
fn signals_of_the_mint_climb_and_descend() {
    let count = |age: &str, symbol: &str| modules(&preset("mint.l", &[("AGE", age), ("SHOOTS", "1")]), symbol).len();
    assert_eq!((count("24", "V"), count("24", "C")), (0, 0));
    assert_eq!(count("48", "V"), 1);
    let ages: Vec<f64> =
        modules(&preset("mint.l", &[("AGE", "48"), ("SHOOTS", "1")]), "C").iter().map(|c| c[0]).collect();
    assert!(ages.len() >= 8, "{ages:?}");
    assert!(ages.windows(2).all(|w| w[0] <= w[1]) && ages[0] < ages[ages.len() - 1], "bottom to top: {ages:?}");
}

/// All ages are on one axis of shepherd's purse, and each step adds one node to each.
#[test]
fn a_raceme_carries_all_ages() {
    let string = preset("shepherds-purse.l", &[("STEMS", "1"), ("NODES", "3")]);
    let main = string.rsplit('A').nth(1).expect("an apex");
    let ages: Vec<f64> = modules(main, "I").iter().map(|i| i[0]).collect();
    assert!(ages.len() > 10 && ages.windows(2).all(|w| (w[0] - w[1] - 1.0).abs() < 1e-9), "{ages:?}");
}

/// Florets of a daisy: consecutive ones are turned by the golden angle, their distances grow as the root of their number.
#[test]
fn florets_stand_in_golden_angles() {
    let preset = find("daisy.toml").expect("preset");
    let mut recipe = grown::recipe(preset, Some(1), false);
    recipe.clip.end = recipe.clip.start;
    let daisy = grown::individuals(&recipe).remove(0);
    let disc = daisy.asset.instancers.iter().find(|i| i.name.contains("organ_d")).expect("florets");
    assert_eq!(disc.len(), 6 * 130, "six heads");
    // Florets of one head relative to the node that bears them, from the innermost outwards.
    let organs: BTreeMap<u64, &osier::plant::Organ> = daisy.plant.organs.iter().map(|o| (o.id, o)).collect();
    let bearer = |k: usize| {
        let organ = organs[&disc.ids[k]];
        (organ.axis, daisy.plant.frame(&daisy.plant.axes[organ.axis as usize], organ.s).p)
    };
    let (axis, centre) = bearer(0);
    let on_head = (0..disc.len()).filter(|k| bearer(*k).0 == axis);
    let mut head: Vec<glam::Vec3> = on_head.map(|k| disc.rest.positions[k] - centre).collect();
    assert_eq!(head.len(), 130);
    // The innermost lie too near to the node for an angle.
    head.sort_by(|a, b| a.length().total_cmp(&b.length()));
    assert!((head[120].length() / head[30].length() - (120.5_f32 / 30.5).sqrt()).abs() < 0.01);
    for pair in head[20..].windows(2) {
        let turn = pair[0].angle_between(pair[1]).to_degrees();
        assert!((turn - 137.508).abs() < 4.0, "{turn}");
    }
}
