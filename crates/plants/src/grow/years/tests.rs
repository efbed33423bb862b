//! Compares the passes of a year with closed forms, and tests that results do not depend on order, threads, age and place.

use std::sync::Arc;

use glam::{Vec2, Vec3};

use super::light::{CellMarks, LightField};
use super::season::Season;
use super::stand::Stand;
use super::tree::{Bud, NONE, Node, Tree, flag, index_of, y_axis};
use super::*;
use crate::grow::turtle::OrganSpec;
use osier_base::math;
use osier_base::par::on_threads;
use osier_scene::Mesh;
use osier_scene::plant::Plant;

/// A broadleaved tree that grows quickly.
pub(super) fn habit() -> Habit {
    let mut habit = Habit::default();
    for (key, values) in [
        ("shoot_rate", [0.5, 0.4, 0.35].as_slice()),
        ("shoot_max", &[0.7, 0.6, 0.5]),
        ("short_shoot", &[0.05]),
        ("internode", &[0.2, 0.18, 0.15]),
        ("wander", &[0.15, 0.28]),
        ("apex_death", &[0.1, 0.2]),
        ("leaf_area_tip", &[0.04]),
        ("clear_stem", &[1.0]),
        ("shade_point", &[0.08]),
    ] {
        habit.set(key, values).expect("a key");
    }
    habit
}

pub(super) fn spec(age: f64) -> TreeSpec {
    TreeSpec {
        name: "tree".into(),
        habit: habit(),
        seed: 7,
        id: 3,
        base: Vec3::ZERO,
        age,
        neighbours: None,
        prunes: Vec::new(),
    }
}

fn grow_one(spec: &TreeSpec) -> GrownTree {
    let mut grown = grow(std::slice::from_ref(spec), &Site::default(), &Limits::default()).expect("grows");
    grown.pop().expect("one tree")
}

/// The bits of all properties of a tree's nodes.
fn bits(tree: &GrownTree) -> Vec<u32> {
    let nodes = &tree.tree.nodes;
    let stands = (0..nodes.len()).filter(|i| nodes.flags[*i] & flag::FALLEN == 0);
    let of = |i: usize| {
        let (p, q) = (nodes.p[i].to_array(), nodes.q[i].to_array());
        p.into_iter().chain(q).chain([nodes.r[i], nodes.length[i], nodes.s[i], nodes.vigour[i]]).map(f32::to_bits)
    };
    stands.flat_map(of).collect()
}

#[test]
fn wood_turns_in_lanes_as_it_does_one_by_one() {
    for age in [6, 25, 40] {
        let grown = grow_one(&spec(f64::from(age)));
        let season = Season::new(&habit(), age + 1);
        let bent = |bend: fn(&mut Tree)| {
            let mut grown = grown.clone();
            grown.tree.thicken(&season);
            bend(&mut grown.tree);
            (bits(&grown), grown.tree.scratch.turn)
        };
        let (lanes, one_by_one) = (bent(Tree::bend), bent(Tree::bend_one_by_one));
        assert!(lanes.0 != bits(&grown), "{age}: nothing bends");
        assert!(lanes == one_by_one, "{age}");
    }
}

#[test]
fn shoots_that_fall_short_need_no_full_draw() {
    let chance = super::shoots::Chance { deviation: 0.15, least: 0.4 };
    let (mut short, mut long) = (0, 0);
    for key in 0..20_000 {
        let draw = || osier_base::rng::Rng::from_key(key);
        let length = 0.1 * (1.0 + 0.15 * super::shoots::PolarDraw::new(&mut draw()).normal()).max(0.4);
        for needed in [0.05, 0.1, 0.105, 0.117, 0.13, 0.15] {
            let expected = if length < needed { 0.0 } else { length };
            assert_eq!(chance.length(0.1, needed, &mut draw()).to_bits(), expected.to_bits(), "{key} {needed}");
            *if length < needed { &mut short } else { &mut long } += 1;
        }
    }
    assert!(short > 10_000 && long > 10_000, "{short} {long}");
}

/// A tree of hand-made nodes: parent, order and whether it continues the axis.
fn hand_made(habit: &Habit, nodes: &[(u32, u8, bool, Vec3)]) -> Tree {
    let mut tree = Tree::new("hand", habit, 1, 1, Vec3::ZERO);
    let seed = tree.nodes.len();
    assert_eq!(seed, 1);
    tree.nodes = super::tree::Nodes::default();
    for (i, &(parent, order, main, p)) in nodes.iter().enumerate() {
        let from = tree.nodes.p.get(parent as usize).copied().unwrap_or(p - Vec3::X * 0.02);
        let way = p - from;
        tree.nodes.push(Node {
            parent,
            axis: 0,
            index: u16::try_from(i).expect("few"),
            order,
            flags: if main { flag::MAIN } else { 0 },
            dormant: 0,
            woken: 0,
            starve: 0,
            death: 0,
            p,
            q: math::rotation_between(Vec3::Y, way.normalize()),
            length: way.length(),
            r: 0.01,
            area: math::pow_f32(0.01, habit.pipe_exponent),
            lost: 0.0,
            path: 0.0,
            s: 0.0,
            moment: 0.0,
            birth: 0.0,
            azimuth: 0.0,
            light: 0.0,
            gathered: 0.0,
            vigour: 0.0,
        });
    }
    tree.scratch.main = vec![0.0; nodes.len()];
    tree.scratch.side = vec![0.0; nodes.len()];
    tree.scratch.wood = vec![0.0; nodes.len()];
    tree.scratch.beyond = vec![2.0; nodes.len()];
    tree
}

#[test]
fn a_fork_of_three_shares_vigour_in_closed_form() {
    let mut habit = habit();
    habit.set("apical_control", &[0.6]).expect("sets");
    habit.set("apical_control_old", &[0.6]).expect("sets");
    habit.set("vigour", &[2.0]).expect("sets");
    let tip = |x: f32| Vec3::new(x, 2.0, 0.0);
    // A root with a continuation and a side branch, both tips, and a bud.
    let mut tree = hand_made(&habit, &[(NONE, 0, false, Vec3::Y), (0, 0, true, tip(0.1)), (0, 1, false, tip(1.0))]);
    for i in 1..3 {
        tree.nodes.flags[i] |= flag::OPEN;
    }
    tree.scratch.main = vec![0.0, 0.8, 0.5];
    tree.scratch.side = vec![0.3, 0.0, 0.0];
    tree.buds.push(Bud { node: 0, azimuth: 0.0, slot: 0, age: 0, gathered: 0.3 });
    tree.sum_light(false);
    tree.share_vigour(&Season::new(&habit, 5));
    // v = 2 Q; v_main = v 0.6 Q_m / (0.6 Q_m + 0.4 Q_l), the rest in proportion to light.
    let total = 2.0 * (0.8 + 0.5 + 0.3);
    let wanted = 0.6 * 0.8 + 0.4 * 0.8;
    assert!((tree.nodes.vigour[0] - total).abs() < 1e-6);
    assert!((tree.nodes.vigour[1] - total * 0.6 * 0.8 / wanted).abs() < 1e-6);
    assert!((tree.nodes.vigour[2] - total * 0.4 * 0.5 / wanted).abs() < 1e-6);
    // The bud gets what is left.
    let bud = tree.scratch.factor[0] * (1.0 - tree.control_at(&Season::new(&habit, 5), 0)) * tree.buds[0].gathered;
    assert!((bud - total * 0.4 * 0.3 / wanted).abs() < 1e-6);
}

#[test]
fn the_vigour_of_tips_and_buds_sums_to_that_of_the_root() {
    let limits = Limits::default();
    let site = Site::default();
    let mut stand = Stand::new(vec![plant_seed(&spec(20.0))], &site, &limits);
    for _ in 0..20 {
        stand.grow_year(true).expect("grows");
    }
    let tree = &mut stand.trees[0];
    let season = Season::new(&tree.habit, 21);
    tree.scratch.main = (0..tree.nodes.len()).map(|i| if tree.nodes.grows(i) { 0.5 } else { 0.0 }).collect();
    tree.scratch.side = vec![0.0; tree.nodes.len()];
    tree.scratch.wood = vec![0.0; tree.nodes.len()];
    for bud in &mut tree.buds {
        bud.gathered = 0.25;
        tree.scratch.side[bud.node as usize] += 0.25;
    }
    tree.sum_light(false);
    tree.share_vigour(&season);
    let tip = |i: usize| f64::from(tree.scratch.factor[i] * tree.control_at(&season, i) * tree.scratch.main[i]);
    let tips: f64 = (0..tree.nodes.len()).filter(|i| tree.nodes.grows(*i)).map(tip).sum();
    let bud = |b: &Bud| {
        let i = b.node as usize;
        f64::from(tree.scratch.factor[i] * (1.0 - tree.control_at(&season, i)) * b.gathered)
    };
    let buds: f64 = tree.buds.iter().map(bud).sum();
    let root = f64::from(tree.nodes.vigour[0]);
    assert!(((tips + buds) / root - 1.0).abs() < 1e-5, "{tips} + {buds} of {root}");
}

#[test]
fn no_branch_is_thicker_than_what_carries_it() {
    let grown = grow_one(&spec(30.0));
    let nodes = &grown.tree.nodes;
    for i in (0..nodes.len()).filter(|i| nodes.flags[*i] & flag::FALLEN == 0 && nodes.parent[*i] != NONE) {
        let carrier = nodes.r[nodes.parent[i] as usize];
        assert!(nodes.r[i] <= carrier * (1.0 + 1e-6), "{} on {carrier}", nodes.r[i]);
    }
}

#[test]
fn areas_of_pipes_add_up_at_forks() {
    let mut spec = spec(12.0);
    for (key, value) in [
        ("buckling_safety", 0.0),
        ("pipe_memory", 0.0),
        ("stout", 0.0),
        ("shed", 0.0),
        ("bare_max", 1000.0),
        ("shade_point", 0.0),
        ("clear_stem", 0.0),
    ] {
        spec.habit.set(key, &[value]).expect("sets");
    }
    let grown = grow_one(&spec);
    let nodes = &grown.tree.nodes;
    let exponent = f64::from(spec.habit.pipe_exponent);
    let power = |r: f32| math::pow(f64::from(r), exponent);
    let mut sums = vec![0.0; nodes.len()];
    for i in (1..nodes.len()).filter(|i| nodes.lives(*i)) {
        sums[nodes.parent[i] as usize] += power(nodes.r[i]);
    }
    assert!(nodes.len() > 300);
    // Wood that ended at the ground has neither a tip nor a branch.
    let bears = |i: usize| nodes.lives(i) && (nodes.grows(i) || sums[i] > 0.0);
    for (i, sum) in sums.iter().enumerate().filter(|(i, _)| bears(*i)) {
        let tip = if nodes.grows(i) { power(spec.habit.tip_radius) } else { 0.0 };
        assert!((power(nodes.r[i]) / (sum + tip) - 1.0).abs() < 1e-6, "{i}: {} {sum}", nodes.r[i]);
    }
}

#[test]
fn a_cantilever_bends_as_a_beam_and_only_under_added_load() {
    const COUNT: u16 = 100;
    const LENGTH: f32 = 0.02;
    let mut habit = habit();
    for (key, value) in [("sag", 1.0), ("upright", 0.0), ("leaf_mass", 1.0), ("leaf_area_tip", 0.25)] {
        habit.set(key, &[value]).expect("sets");
    }
    let at = |i: u16| Vec3::new(LENGTH * (f32::from(i) + 1.0), 2.0, 0.0);
    let nodes: Vec<_> =
        (0..COUNT).map(|i| if i == 0 { (NONE, 0, false, at(i)) } else { (u32::from(i) - 1, 0, true, at(i)) }).collect();
    let mut tree = hand_made(&habit, &nodes);
    // Wood laid down without bending, as in the first year of a shoot: its moment is stored, so that it adds no gain.
    tree.habit.set("sag", &[0.0]).expect("sets");
    tree.bend();
    tree.habit.set("sag", &[1.0]).expect("sets");
    let before = tree.nodes.q.clone();
    tree.bend();
    let far = usize::from(COUNT) - 1;
    assert!(tree.nodes.q.iter().zip(&before).all(|(a, b)| (*a - *b).length() < 1e-6), "no load, no bend");
    // A leaf of 250 g at the tip: the angle there is P L^2 / (2 E I).
    tree.nodes.flags[far] |= flag::OPEN;
    tree.bend();
    let load = 0.25 * 9.81;
    let length = f64::from(LENGTH) * f64::from(COUNT);
    let stiffness = 6e9 * std::f64::consts::FRAC_PI_4 * 1e-8;
    let exact = load * length * length / (2.0 * stiffness);
    let d = y_axis(tree.nodes.q[far]);
    let angle = math::atan2(f64::from(-d.y), f64::from(d.x));
    assert!((angle / exact - 1.0).abs() < 0.02, "{angle} {exact}");
    for i in 1..usize::from(COUNT) {
        assert!((tree.nodes.p[i].distance(tree.nodes.p[i - 1]) - LENGTH).abs() < 1e-6, "lengths hold");
    }
}

#[test]
fn a_younger_age_is_a_part_of_an_older_run() {
    let limits = Limits::default();
    let row = grow_through(&spec(14.0), &[6, 14, 22], &Site::default(), &limits).expect("grows");
    for (tree, age) in row.iter().zip([6.0, 14.0, 22.0]) {
        assert_eq!(bits(tree), bits(&grow_one(&spec(age))), "{age}");
    }
}

#[test]
fn young_trees_bear_more_leaves_along_their_shoots_and_old_ones_as_many() {
    let area = |young: f64, age: f64| {
        let mut tree = spec(age);
        // Leaves that hardly shade: more of them must not change how the tree grows.
        for (key, value) in [("leaf_area_shoot", 0.1), ("leaf_young", young), ("extinction", 0.1)] {
            tree.habit.set(key, &[value]).expect("sets");
        }
        tree.habit.set("maturity", &[8.0, 14.0]).expect("sets");
        grow_one(&tree).measures().leaf_area
    };
    // The first four years bear three times as many leaves; wood after the fourteenth year bears as many as without the key.
    let (plain, young) = (area(1.0, 4.0), area(3.0, 4.0));
    assert!(young > 1.5 * plain, "{plain} {young}");
    let (plain, young) = (area(1.0, 18.0), area(3.0, 18.0));
    assert!((young / plain - 1.0).abs() < 0.1, "{plain} {young}");
}

/// A bush of ten stems, six of which sprout over twelve years in the shade of the others.
#[test]
fn late_stems_sprout_in_their_years_and_grow_in_the_shade_of_others() {
    let mut bush = spec(20.0);
    for (key, value) in [("stems", 10.0), ("stem_spread", 0.4), ("tilt", 25.0), ("stem_years", 12.0)] {
        bush.habit.set(key, &[value]).expect("sets");
    }
    let row = grow_through(&bush, &[1, 8, 20], &Site::default(), &Limits::default()).expect("grows");
    let stems = |tree: &GrownTree| plant_of(tree, None).axes.iter().filter(|a| a.parent == NONE).count();
    assert_eq!(row.iter().map(stems).collect::<Vec<_>>(), [4, 8, 10]);
    for (tree, age) in row.iter().zip([1.0, 8.0, 20.0]) {
        assert_eq!(bits(tree), bits(&grow_one(&TreeSpec { age, ..bush.clone() })), "{age}");
    }
    // The late stems live on the reserves of the older stems: a shoot of at least 0.2 m a year, for five years.
    let last = &row[2].tree.nodes;
    let late: Vec<u32> = (0..10).filter(|i| last.birth[*i as usize] > 0.0).collect();
    for stem in late {
        let length = (0..last.len()).filter(|i| last.axis[*i] == stem).map(|i| last.path[i]).fold(0.0, f32::max);
        assert!(length > 1.0, "stem {stem}: {length}");
    }
}

#[test]
fn threads_and_the_order_of_trees_change_no_bit() {
    let other = TreeSpec { id: 4, seed: 8, base: Vec3::new(2.5, 0.0, 1.0), age: 14.0, ..spec(20.0) };
    let pair = [spec(20.0), other.clone()];
    let grown = |specs: &[TreeSpec], threads: usize| -> Vec<Vec<u32>> {
        let grown = on_threads(threads, || grow(specs, &Site::default(), &Limits::default()));
        grown.expect("grows").iter().map(bits).collect()
    };
    let one = grown(&pair, 1);
    assert_ne!(one[0], bits(&grow_one(&spec(20.0))), "they shade each other");
    for threads in [2, 5] {
        assert_eq!(one, grown(&pair, threads));
    }
    let swapped = grown(&[other, spec(20.0)], 2);
    assert_eq!((&one[0], &one[1]), (&swapped[1], &swapped[0]));
}

#[test]
fn trees_far_apart_grow_alone() {
    let far = TreeSpec { id: 4, base: Vec3::new(80.0, 0.0, 0.0), ..spec(12.0) };
    let grown = grow(&[spec(12.0), far], &Site::default(), &Limits::default()).expect("grows");
    assert_eq!(bits(&grown[0]), bits(&grow_one(&spec(12.0))));
}

/// Trees of a row share one field of light, whose cells do not grow with the length of the row.
#[test]
fn trees_of_a_long_row_have_as_many_leaves_as_alone() {
    let at = |i: u16| TreeSpec { id: u32::from(i), base: Vec3::X * (48.0 * f32::from(i)), ..spec(12.0) };
    let row: Vec<TreeSpec> = (0..5).map(at).collect();
    assert_eq!(groups_in_shade(&row).len(), 1, "one field of light");
    let grown = grow(&row, &Site::default(), &Limits::default()).expect("grows");
    let of_row: f32 = grown.iter().map(|tree| tree.measures().leaf_area).sum();
    let alone: f32 = row.iter().map(|spec| grow_one(spec).measures().leaf_area).sum();
    assert!((of_row / alone - 1.0).abs() < 0.05, "{of_row} {alone}");
}

#[test]
fn a_tree_that_is_moved_is_the_same() {
    let moved = TreeSpec { base: Vec3::splat(10.13), ..spec(18.0) };
    let (a, b) = (grow_one(&spec(18.0)), grow_one(&moved));
    assert_eq!(a.tree.nodes.len(), b.tree.nodes.len());
    for (p, q) in a.tree.nodes.p.iter().zip(&b.tree.nodes.p) {
        assert!(p.distance(*q) < 1e-4);
    }
}

#[test]
fn a_part_of_a_year_lies_between_both() {
    let (before, half, nearly, after) =
        (grow_one(&spec(9.0)), grow_one(&spec(9.5)), grow_one(&spec(9.9999)), grow_one(&spec(10.0)));
    let wood = |tree: &GrownTree| {
        let nodes = &tree.tree.nodes;
        (0..nodes.len()).filter(|i| nodes.lives(*i)).map(|i| nodes.length[i]).sum::<f32>()
    };
    assert!(wood(&before) < wood(&half) && wood(&half) < wood(&after));
    assert!((wood(&nearly) / wood(&after) - 1.0).abs() < 1e-3, "{} {}", wood(&nearly), wood(&after));
    assert!((nearly.measures().height / after.measures().height - 1.0).abs() < 1e-3);
    assert!(half.measures().tips > 0);
    for tree in [before, half, nearly, after, grow_one(&spec(0.1)), grow_one(&spec(1.0))] {
        plant_of(&tree, None);
    }
}

/// Tips that begin in a year unfold their leaves over it, and leaves along the shoots of the year before fall over it.
#[test]
fn leaves_come_and_go_over_a_part_of_a_year() {
    let leaves = |age: f64| {
        let mut spec = spec(age);
        spec.habit.set("leaf_area_shoot", &[0.1]).expect("sets");
        let plant = plant_of(&grow_one(&spec), Some(Foliage::Blades(leaf())));
        plant.organs.iter().map(|organ| organ.id).collect::<std::collections::BTreeSet<u64>>()
    };
    let [before, start, half, end, after] = [9.0, 9.001, 9.5, 9.999, 10.0].map(leaves);
    let kept = |later: &std::collections::BTreeSet<u64>| before.intersection(later).count();
    // At its start only leaves that lost their light in the tenth year are missing.
    assert!(kept(&start) * 10 > before.len() * 6, "{} of {}", kept(&start), before.len());
    assert!((start.len() - kept(&start)) * 10 < before.len(), "{} new leaves", start.len() - kept(&start));
    assert!(kept(&half) < kept(&start) && kept(&end) < kept(&half), "leaves fall over the year");
    assert!(end.intersection(&after).count() * 20 > after.len() * 19, "{} and {}", end.len(), after.len());
}

#[test]
fn too_many_nodes_are_refused_before_they_are_made() {
    let mut limits = Limits::default();
    limits.set("nodes", "2k").expect("sets");
    let error = grow(&[spec(60.0)], &Site::default(), &limits).expect_err("too many").to_string();
    assert!(error.contains("plant \"tree\" in year ") && error.ends_with("raise it with --max-nodes"), "{error}");
    assert!(grow(&[spec(0.05)], &Site::default(), &limits).is_err());
    let mut wrong = spec(5.0);
    wrong.habit.set("maturity", &[9.0, 9.0]).expect("in range");
    assert!(grow(&[wrong], &Site::default(), &limits).is_err());
}

#[test]
fn hard_cases_end_without_faults() {
    // Sixty stems of six orders, a seed of five weeks, a cut that takes all wood, and a tree in the dark.
    let mut bush = spec(8.0);
    for (key, value) in [("stems", 60.0), ("levels", 6.0), ("stem_spread", 1.0), ("tilt", 40.0)] {
        bush.habit.set(key, &[value]).expect("sets");
    }
    let all = Keep::Box { min: Vec3::splat(-9.0), max: Vec3::new(9.0, -1.0, 9.0) };
    let prune = Prune { year: 6, every: 1, until: 60, keep: all };
    let cut = TreeSpec { prunes: vec![prune], ..spec(12.0) };
    let dense = Neighbours { radius: 0.0, density: 40.0, until: 99.0 };
    let dark = TreeSpec { neighbours: Some(dense), ..spec(20.0) };
    let dark_bush = TreeSpec { neighbours: Some(dense), age: 14.0, ..bush.clone() };
    let trees = [bush, spec(0.1), cut, dark, dark_bush].map(|spec| grow_one(&spec));
    assert!(trees[0].measures().nodes > 500);
    assert!(trees[2].measures().height < 0.1, "{:?}", trees[2].measures());
    for tree in &trees {
        let nodes = &tree.tree.nodes;
        assert!(nodes.p.iter().all(|p| p.is_finite()) && nodes.r.iter().all(|r| *r > 0.0 && r.is_finite()));
        assert!(!plant_of(tree, None).axes.is_empty());
    }
}

#[test]
fn a_tree_without_light_dies_and_keeps_its_wood() {
    let spec = spec(20.0);
    let site = Site::default();
    let limits = Limits::default();
    let mut stand = Stand::new(vec![plant_seed(&spec)], &site, &limits);
    for _ in 0..12 {
        stand.grow_year(true).expect("grows");
    }
    // A roof that lets no light through.
    stand.trees[0].neighbours = Some(Neighbours { radius: 0.0, density: 400.0, until: 99.0 });
    stand.trees[0].habit.set("patience", &[0.0]).expect("sets");
    for _ in 0..8 {
        stand.grow_year(true).expect("grows");
    }
    let tree = &stand.trees[0];
    let lit = (0..tree.nodes.len()).filter(|i| tree.nodes.grows(*i)).count();
    assert!(tree.died.is_some() || lit < 20, "{lit} tips live in the dark");
}

#[test]
fn a_dead_tip_gets_a_new_leader() {
    let habit = habit();
    let y = |v: f32| Vec3::Y * v;
    // A stem of three internodes whose tip dies; the middle one bears a strong and a weak branch.
    let strong = Vec3::new(0.5, 1.2, 0.0);
    let nodes = [
        (NONE, 0, false, y(0.5)),
        (0, 0, true, y(1.0)),
        (1, 0, true, y(1.5)),
        (1, 1, false, strong),
        (1, 1, false, Vec3::new(-0.5, 1.2, 0.0)),
        (3, 1, true, strong + y(0.3)),
        (3, 2, false, strong + Vec3::Z * 0.2),
    ];
    let mut tree = hand_made(&habit, &nodes);
    for i in [4, 5, 6] {
        tree.nodes.flags[i] |= flag::OPEN;
        tree.scratch.main[i] = 1.0;
    }
    tree.nodes.vigour = vec![3.0, 3.0, 0.0, 2.0, 1.0, 1.0, 1.0];
    tree.year = 5;
    tree.sum_light(true);
    tree.shed_dead_wood();
    assert!(!tree.nodes.lives(2));
    let season = Season::new(&habit, 5);
    assert!(tree.replace_leaders(&season));
    tree.sum_light_again();
    let order = |i: usize| tree.nodes.order[i];
    assert_eq!((order(3), order(5), order(6), order(4)), (0, 0, 1, 1));
    assert!(tree.nodes.flags[3] & flag::MAIN != 0 && tree.nodes.flags[4] & flag::MAIN == 0);
    assert!((tree.scratch.main[1] - 2.0).abs() < 1e-6 && (tree.scratch.side[1] - 1.0).abs() < 1e-6);
}

/// If a side bud takes over from the tip of the stem, the stem bends over several internodes; a branch bends at one.
#[test]
fn relays_bend_the_stem_over_several_internodes() {
    let mut spec = spec(6.0);
    for (key, values) in [
        ("apex_death", [1.0, 1.0].as_slice()),
        ("internode", &[0.1]),
        ("wander", &[0.0]),
        ("phototropism", &[0.0]),
        ("elevation_rate", &[0.0]),
        ("upright", &[0.0]),
        ("sag", &[0.0]),
    ] {
        spec.habit.set(key, values).expect("a key");
    }
    let tree = grow_one(&spec).tree;
    let nodes = &tree.nodes;
    let bends = |order: u8| {
        let inner = (0..nodes.len()).filter(move |i| nodes.flags[*i] & flag::MAIN != 0 && nodes.order[*i] == order);
        inner.map(|i| {
            let cosine = nodes.direction(i).dot(nodes.direction(nodes.parent[i] as usize));
            math::acos_f32(cosine.clamp(-1.0, 1.0)).to_degrees()
        })
    };
    let sharpest = bends(0).fold(0.0, f32::max);
    assert!(bends(0).sum::<f32>() > 60.0 && sharpest < 15.0, "{sharpest} degrees");
    assert!(bends(1).fold(0.0, f32::max) > 20.0);
}

/// The limbs of a stem keep the deviations of the angles at which they left it: with one elevation for all they would be parallel.
#[test]
fn limbs_that_leave_at_wider_angles_stay_lower() {
    let mut habit = habit();
    for (key, value) in [("angle_var", 15.0), ("elevation", 40.0)] {
        habit.set(key, &[value]).expect("sets");
    }
    let elevations = |habit: &Habit| {
        let tree = Tree::new("limbs", habit, 1, 1, Vec3::ZERO);
        let season = Season::new(habit, 1);
        let of = |id: u64| {
            let [sine, cosine] = super::shoots::axis_elevation(tree.leaving_deviation(id), 1, &season);
            assert!((sine * sine + cosine * cosine - 1.0).abs() < 1e-5 && cosine >= 0.0);
            math::atan2(f64::from(sine), f64::from(cosine)).to_degrees()
        };
        (0..400).map(of).collect::<Vec<f64>>()
    };
    let deviation = |values: &[f64]| {
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        (mean, (values.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>() / values.len() as f64).sqrt())
    };
    // 15 degrees times the cosine of 40 degrees.
    let (mean, spread) = deviation(&elevations(&habit));
    assert!((mean - 40.0).abs() < 1.5 && (spread - 11.5).abs() < 1.5, "{mean} {spread}");
    // Axes near the vertical keep close to it.
    habit.set("elevation", &[84.0]).expect("sets");
    let (mean, spread) = deviation(&elevations(&habit));
    assert!((mean - 84.0).abs() < 0.5 && spread < 2.0, "{mean} {spread}");
    // Grown limbs also differ: they rise at different angles between stem and end.
    let mut spec = spec(20.0);
    for (key, value) in [("angle_var", 15.0), ("elevation_rate", 0.5), ("wander", 0.0), ("phototropism", 0.0)] {
        spec.habit.set(key, &[value]).expect("sets");
    }
    let tree = grow_one(&spec).tree;
    let nodes = &tree.nodes;
    let limb_ends = (0..nodes.len()).filter(|i| nodes.grows(*i) && nodes.order[*i] == 1 && nodes.s[*i] > 1.5);
    let rise = |i: usize| {
        let d = nodes.direction(i);
        math::atan2(f64::from(d.y), f64::from(Vec2::new(d.x, d.z).length())).to_degrees()
    };
    let rises: Vec<f64> = limb_ends.map(rise).collect();
    let (mean, spread) = deviation(&rises);
    assert!(rises.len() > 5 && spread > 6.0, "{mean} {spread} {}", rises.len());
}

/// Crown lifting removes wood that hangs below the clear stem, and keeps the limbs that rise above it.
#[test]
fn crown_lifting_spares_rising_limbs() {
    const LIMBS: u16 = 20;
    let mut habit = habit();
    habit.set("clear_stem", &[2.0]).expect("sets");
    habit.set("clear_rate", &[1.0]).expect("sets");
    // A stem with limbs at 2.2 m: each rises at first, and its end hangs down to 0.6 m.
    let mut nodes = vec![(NONE, 0, false, Vec3::Y * 2.2), (0, 0, true, Vec3::Y * 3.0)];
    for k in 0..LIMBS {
        let around = f32::from(k) * math::GOLDEN_ANGLE_F32;
        let out = Vec3::new(math::cos_f32(around), 0.0, math::sin_f32(around));
        let first = u32::try_from(nodes.len()).expect("few");
        nodes.push((0, 1, false, out + Vec3::Y * 2.3));
        nodes.push((first, 1, true, out * 2.0 + Vec3::Y * 2.5));
        nodes.push((first + 1, 1, true, out * 2.5 + Vec3::Y * 0.6));
    }
    let mut tree = hand_made(&habit, &nodes);
    tree.axis_ids = (0..=u64::from(LIMBS)).collect();
    for i in 0..nodes.len() {
        tree.nodes.s[i] = tree.nodes.p[i].y;
        tree.nodes.axis[i] = index_of(i.saturating_sub(2) / 3 + usize::from(i > 1));
    }
    tree.cut(&Season::new(&habit, 20));
    let fallen = |i: &usize| tree.nodes.flags[*i] & flag::FALLEN != 0;
    let ends = (0..usize::from(LIMBS)).map(|k| 3 * k + 4);
    assert_eq!((0..nodes.len()).filter(fallen).collect::<Vec<_>>(), ends.collect::<Vec<_>>());
}

#[test]
fn a_cut_wakes_dormant_buds() {
    // A large part of the crown is cut off, so that the rest has lost more than half of its light.
    let cut_to = |reach: f32| {
        let keep = Keep::Box { min: Vec3::new(-reach, -1.0, -reach), max: Vec3::new(reach, 2.0, reach) };
        TreeSpec { prunes: vec![Prune { year: 16, every: 0, until: 0, keep }], ..spec(16.0) }
    };
    let cut = cut_to(0.8);
    // On the stem between the clear stem and the cut.
    let woken = |spec: &TreeSpec| {
        let nodes = grow_one(spec).tree.nodes;
        let on_stem = |i: &usize| nodes.order[*i] == 0 && (1.0..2.0).contains(&nodes.p[*i].y);
        (0..nodes.len()).filter(on_stem).map(|i| usize::from(nodes.woken[i])).sum::<usize>()
    };
    let all = |spec: &TreeSpec| (1..=8).map(|seed| woken(&TreeSpec { seed, ..spec.clone() })).sum::<usize>();
    let (with, without) = (all(&cut), all(&TreeSpec { prunes: Vec::new(), ..cut.clone() }));
    assert!(with > without + 2, "{with} {without}");
    // A tree that keeps its low limbs grows on.
    let grown = grow_one(&TreeSpec { age: 20.0, ..cut_to(9.0) });
    assert!(grown.died().is_none() && grown.measures().height > 2.0, "{:?}", grown.measures());
}

pub(super) fn leaf() -> OrganSpec {
    // A square of 8 cm as a blade.
    let points: Vec<Vec3> =
        [(-0.5, 0.0), (0.5, 0.0), (0.5, 1.0), (-0.5, 1.0)].map(|(x, y)| Vec3::new(x, y, 0.0)).to_vec();
    let mesh = Mesh {
        normals: vec![Vec3::Z; 4],
        uvs: points.iter().map(|p| Vec2::new(p.x + 0.5, p.y)).collect(),
        points,
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        ..Mesh::default()
    };
    OrganSpec { name: "leaf".into(), meshes: vec![Arc::new(mesh.with_material(0))], size: 0.08, petiole: 0.02 }
}

fn plant_of(tree: &GrownTree, foliage: Option<Foliage>) -> Plant {
    let options = PlantOptions { foliage, materials: vec!["bark".into()], ..PlantOptions::default() };
    tree.plant(&options, &Limits::default()).expect("a sound plant")
}

#[test]
fn a_plant_has_the_wood_and_the_leaf_area_of_its_tree() {
    let mut spec = spec(26.0);
    spec.habit.set("leaf_area_shoot", &[0.03]).expect("sets");
    let grown = grow_one(&spec);
    let plant = plant_of(&grown, Some(Foliage::Blades(leaf())));
    let mean = plant.organs.iter().map(|o| f64::from(o.scale) * f64::from(o.scale)).sum::<f64>();
    let model = f64::from(grown.measures().leaf_area);
    assert!((mean / model - 1.0).abs() < 0.02, "{mean} {model}");
    // Wood: the length of axes is that of the internodes, except for nodes that straight pieces leave out.
    let nodes = &grown.tree.nodes;
    let wood: f32 = (0..nodes.len()).filter(|i| nodes.flags[*i] & flag::FALLEN == 0).map(|i| nodes.length[i]).sum();
    let length: f32 = plant.axes.iter().map(|a| a.length).sum();
    assert!((length / wood - 1.0).abs() < 0.01, "{length} {wood}");
    let mut ids: Vec<u64> = plant.axes.iter().map(|a| a.id).collect();
    ids.sort_unstable();
    assert!(ids.windows(2).all(|w| w[0] != w[1]), "ids of axes are unique");
    let mut ids: Vec<u64> = plant.organs.iter().map(|o| o.id).collect();
    ids.sort_unstable();
    assert!(ids.windows(2).all(|w| w[0] != w[1]), "ids of organs are unique");
    assert!(plant.nodes.birth.iter().all(|b| (0.0..=1.0).contains(b)));
    // Needles: pieces of shoot on every internode and tip that bears leaves, of the same area, at the size of the organ.
    let mut piece = leaf();
    let mut mesh = (*piece.meshes[0]).clone();
    let shrink = 0.08 / mesh.bounds().max.y;
    mesh.points.iter_mut().for_each(|p| *p *= shrink);
    let at = |i: u32| mesh.points[i as usize];
    let doubled = |[a, b, c]: &[u32; 3]| (at(*b) - at(*a)).cross(at(*c) - at(*a)).length();
    let one = 0.5 * mesh.triangles.iter().map(doubled).sum::<f32>();
    piece.meshes = vec![Arc::new(mesh)];
    let plant = plant_of(&grown, Some(Foliage::Needles(piece)));
    let area: f32 = plant.organs.iter().map(|o| o.scale * o.scale * one).sum();
    assert!((f64::from(area) / model - 1.0).abs() < 0.02, "{area} {model}");
    assert!(
        plant.organs.iter().all(|o| (0.7..1.3).contains(&o.scale)),
        "needles have one size on short and long shoots"
    );
}

#[test]
fn axes_keep_their_ids_as_the_tree_grows_older() {
    let limits = Limits::default();
    let row = grow_through(&spec(14.0), &[12, 13], &Site::default(), &limits).expect("grows");
    let ids = |tree: &GrownTree| -> Vec<u64> {
        let mut ids: Vec<u64> = plant_of(tree, None).axes.iter().map(|a| a.id).collect();
        ids.sort_unstable();
        ids
    };
    let (young, old) = (ids(&row[0]), ids(&row[1]));
    let kept = young.iter().filter(|id| old.binary_search(id).is_ok()).count();
    assert!(kept * 10 > young.len() * 9, "{kept} of {}", young.len());
}

#[test]
fn a_field_without_leaves_is_full_light() {
    let site = Site::default();
    let mut tree = plant_seed(&spec(5.0));
    let grid = super::light::Grid::over(osier_base::geometry::Bounds::of(tree.nodes.p.iter().copied()));
    let mut marks = CellMarks::new(&grid);
    tree.mark_cells(&grid, &mut marks);
    let sky = super::light::sky(&site);
    let field = LightField::compute(&super::light::LeafAreas::new(grid), &sky, &[], &marks);
    assert!((field.in_cell(tree.scratch.cell[0]).q - 1.0).abs() < 1e-6);
}
