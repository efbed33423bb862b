//! The plants of [wang-hao]: what its expressions count must come out.
#![allow(clippy::expect_used, reason = "tests fail by panicking")]

use crate::common::grown;
use crate::library::derived;
use std::collections::BTreeMap;

use osier::plant::Plant;
use osier::presets::find;
use osier::recipe::{Recipe, Request, resolve};

fn recipe(name: &str, seed: u64, set: &[&str]) -> Recipe {
    let preset = find(name).expect("preset");
    let (stem, ending) = name.split_once('.').expect("ending");
    let mut request = if ending == "l" {
        Request::bare(stem, name)
    } else {
        Request { name: stem.into(), shown: name.into(), text: preset.text.into(), ..Request::default() }
    };
    request.seed = Some(seed);
    request.set = set.iter().map(|s| (*s).to_owned()).collect();
    let mut recipe = resolve(&request).expect("resolves").0;
    grown::small(&mut recipe);
    recipe
}

fn plant(name: &str, seed: u64, set: &[&str]) -> Plant {
    grown::individuals(&recipe(name, seed, set)).remove(0).plant
}

fn orders(plant: &Plant) -> Vec<usize> {
    let mut counts = BTreeMap::new();
    plant.axes.iter().for_each(|a| *counts.entry(a.order).or_insert(0) += 1);
    counts.into_values().collect()
}

/// Expression 6 with five orders: two whorls of three on the first three, pairs on the last two, a leaf at each end.
#[test]
fn the_tree_of_expression_6_has_its_counts() {
    for seed in 0..4 {
        let tree = plant("silk-tree.l", seed, &["HEIGHT=4"]);
        assert_eq!(orders(&tree), [1, 6, 36, 216, 432], "seed {seed}");
        assert_eq!(tree.axes.len(), 691);
        let segments: usize = tree.axes.iter().map(|a| a.count as usize - 1).sum();
        assert_eq!(segments, 777);
        assert_eq!(tree.organs.len(), 864);
    }
    // The scene hangs more leaves on each end and changes nothing else.
    let scene = plant("silk-tree.toml", 0, &[]);
    assert_eq!((scene.axes.len(), scene.organs.len() % 864), (691, 0));
}

/// Eq. 7-8: lengths of children are sines of 30, 45 and 60 degrees of their parent's, with the weights of the file.
#[test]
fn children_draw_their_lengths_by_weight() {
    let sines = [0.5_f32.sqrt(), 0.75_f32.sqrt(), 0.5];
    let mut found = [0_u32; 3];
    for seed in 0..12 {
        let tree = plant("silk-tree.l", seed, &[]);
        for axis in tree.axes.iter().filter(|a| (1..=3).contains(&a.order)) {
            let ratio = axis.length / tree.axes[axis.parent as usize].length;
            let kind = sines.iter().position(|s| (ratio - s).abs() < 2e-3);
            found[kind.unwrap_or_else(|| panic!("{ratio} is none of eq. 7"))] += 1;
        }
    }
    let n: u32 = found.iter().sum();
    assert_eq!(n, 12 * (6 + 36 + 216));
    for (count, share) in found.iter().zip([0.6, 0.2, 0.2]) {
        let deviation = f64::from(*count) - share * f64::from(n);
        let limit = 4.0 * (share * (1.0 - share) * f64::from(n)).sqrt();
        assert!(deviation.abs() < limit, "{found:?}");
    }
}

/// Fig. 7: the culm swells at every node, and its branches stand there.
#[test]
fn culms_swell_at_their_nodes() {
    let bamboo = plant("bamboo.toml", 1, &[]);
    let culm = &bamboo.axes[0];
    let nodes = bamboo.nodes_of(culm);
    let r = &bamboo.nodes.r[nodes.clone()];
    let swollen: Vec<f32> = (1..r.len() - 1)
        .filter(|i| r[*i] > 1.08 * r[i - 1] && r[*i] > 1.05 * r[i + 1])
        .map(|i| bamboo.nodes.s[nodes.start + i])
        .collect();
    // A scar and a ridge at each.
    assert!(swollen.len() >= 50, "{}", swollen.len());
    for branch in bamboo.axes.iter().filter(|a| a.parent == 0 && a.parent_s < 0.95 * culm.length) {
        let gap = swollen.iter().map(|s| (s - branch.parent_s).abs()).fold(f32::MAX, f32::min);
        assert!(gap < 0.02, "a branch {gap} m from the next node");
    }
}

/// Expression 6 as printed: the counts of its text, straight axes, cones by r_3, the same tree by `remaining`.
#[test]
fn the_printed_tree_has_its_counts_and_cones() {
    let mut tops = [0_u32; 2];
    for seed in 0..6 {
        let tree = plant("wang-tree.l", seed, &[]);
        assert_eq!(orders(&tree), [1, 6, 36, 216, 432], "seed {seed}");
        let segments: usize = tree.axes.iter().map(|a| a.count as usize - 1).sum();
        assert_eq!((tree.axes.len(), segments, tree.organs.len()), (691, 777, 864));
        let by_steps = plant("wang-tree.l", seed, &["BY_STEPS=1"]);
        assert_eq!(by_steps.nodes.p, tree.nodes.p, "seed {seed}: the same tree by the steps that remain");
        assert_eq!(by_steps.nodes.r, tree.nodes.r);
        for axis in &tree.axes {
            let nodes = tree.nodes_of(axis);
            let (foot, tip) = (tree.nodes.p[nodes.start], tree.nodes.p[nodes.end - 1]);
            assert!((foot.distance(tip) / axis.length - 1.0).abs() < 1e-4, "an axis is straight");
            // Branches of pairs end in the first width of the next; whorled axes end by r_3.
            if axis.order <= 2 {
                let ratio = tree.nodes.r[nodes.end - 1] / tree.nodes.r[nodes.start];
                let kind = [0.7, 0.8].iter().position(|r3| (ratio - r3).abs() < 2e-3);
                tops[kind.unwrap_or_else(|| panic!("{ratio} is no value of r_3"))] += 1;
            }
        }
    }
    // Both values of r_3 have probability 0.5: 6 * 43 draws, chi-square with one degree of freedom, p = 0.001.
    let expected = f64::from(tops[0] + tops[1]) / 2.0;
    let chi: f64 = tops.iter().map(|n| (f64::from(*n) - expected) * (f64::from(*n) - expected) / expected).sum();
    assert!(tops[0] + tops[1] == 6 * 43 && chi < 10.83, "{tops:?}");
}

/// Eq. 7-8 with the weights of the printed tree, first and second whorl apart: chi-square over many trees.
#[test]
fn whorls_of_the_printed_tree_draw_their_own_ratios() {
    let sines = [0.5_f32.sqrt(), 0.75_f32.sqrt(), 0.5];
    let mut found = [[0_u32; 3]; 2];
    for seed in 0..12 {
        let tree = plant("wang-tree.l", seed, &[]);
        for axis in tree.axes.iter().filter(|a| (1..=3).contains(&a.order)) {
            let parent = &tree.axes[axis.parent as usize];
            let ratio = axis.length / parent.length;
            let kind = sines.iter().position(|s| (ratio - s).abs() < 2e-3);
            let whorl = usize::from(axis.parent_s > 0.7 * parent.length);
            found[whorl][kind.unwrap_or_else(|| panic!("{ratio} is none of eq. 7"))] += 1;
        }
    }
    for (counts, shares) in found.iter().zip([[0.4, 0.4, 0.2], [0.3, 0.2, 0.5]]) {
        let n: u32 = counts.iter().sum();
        assert_eq!(n, 12 * (3 + 18 + 108));
        let expected = shares.map(|s| s * f64::from(n));
        let chi: f64 = counts.iter().zip(expected).map(|(c, e)| (f64::from(*c) - e) * (f64::from(*c) - e) / e).sum();
        assert!(chi < 13.8, "2 degrees of freedom, p = 0.001: {found:?}");
    }
}

/// The Koch curve as the paper prints it, minus signs lost, and as it was meant.
#[test]
fn the_printed_koch_rule_loads_and_the_preset_closes() {
    let curve = plant("koch.l", 0, &[]);
    let segments: usize = curve.axes.iter().map(|a| a.count as usize - 1).sum();
    assert_eq!(segments, 3 * 256);
    let (first, last) = (curve.nodes.p[0], curve.nodes.p[curve.nodes.p.len() - 1]);
    assert!(first.distance(last) < 1e-4, "closed: {last}");
    let printed = "Lsystem: p\nDerivation length: 3\nAxiom: F(1)-(60)F(1)\n\
        F(d) --> F(d/3)+(60)F(d/3)-(60)F(d/3)+(60)F(d/3)\nendlsystem\n";
    let string = derived("printed.l", printed, &[]);
    assert_eq!(string.matches("F(").count(), 2 * 64, "2 * 4^n");
}
