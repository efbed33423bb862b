#![allow(clippy::disallowed_methods, reason = "tests read the tables")]

use super::*;
use crate::dynamics::study;
use crate::game::extent;
use crate::read::read;
use crate::stems::{is_tree, stems};
use crate::tests::table;
use crate::weights::{WeightRule, probabilities};
use osier_base::limits::Limits;

fn systems(name: &str, text: &str) -> Vec<Ifs> {
    read(name, text.as_bytes(), &Limits::default()).unwrap_or_else(|e| panic!("{name}: {e}\n{text}")).0
}

fn item(system: &Ifs) -> TableItem {
    let rule = system.weights.unwrap_or(WeightRule::File);
    TableItem { system: system.clone(), weights: probabilities(system, rule).0, view: None }
}

fn items(systems: &[Ifs]) -> Vec<TableItem> {
    systems.iter().map(item).collect()
}

/// All shipped tables.
fn tables() -> Vec<(String, Vec<Ifs>)> {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../ifs-tables");
    let files = std::fs::read_dir(folder).expect("folder").map(|e| e.expect("entry").file_name());
    let mut names: Vec<String> = files.map(|n| n.to_string_lossy().into_owned()).collect();
    names.sort();
    assert!(names.len() >= 15, "{names:?}");
    names.iter().map(|n| (n.clone(), systems(n, &table(n)))).collect()
}

#[test]
fn every_table_is_written_read_and_written_the_same() {
    for (name, all) in tables() {
        let (text, _) = entries(&items(&all));
        let again = systems("again.ifs", &text);
        assert_eq!(entries(&items(&again)).0, text, "{name}");
        for (a, b) in all.iter().zip(&again) {
            let numbers = |s: &Ifs| s.maps.iter().map(|m| m.affine.coefficients(s.dim)).collect::<Vec<_>>();
            assert_eq!((&a.name, a.dim, numbers(a)), (&b.name, b.dim, numbers(b)), "{name}");
            let sum: f64 = b.maps.iter().filter_map(|m| m.weight).sum();
            assert!((sum - 1.0).abs() < 1e-12, "{name}: {sum}");
        }
        if all.iter().all(|s| s.dim == 2) {
            let (text, _) = flames(&items(&all)).expect("plane");
            let again = systems("again.flame", &text);
            assert_eq!(flames(&items(&again)).expect("plane").0, text, "{name}");
            let numbers = |s: &Ifs| s.maps.iter().map(|m| m.affine.coefficients(2)).collect::<Vec<_>>();
            assert!(all.iter().zip(&again).all(|(a, b)| numbers(a) == numbers(b)), "{name}");
        }
    }
}

#[test]
fn the_form_is_what_fractint_reads() {
    let fern = systems("f.ifs", "fern {\n 0 0 0 .16 0 0 .01\n .85 .04 -.04 .85 0 1.6 .99\n}\n");
    let (text, warnings) = entries(&items(&fern));
    let body: Vec<&str> = text.lines().filter(|l| !l.starts_with(';')).collect();
    let rows = ["fern {", "     0     0      0  0.16  0    0  0.01", "  0.85  0.04  -0.04  0.85  0  1.6  0.99", "}"];
    assert_eq!((body, warnings.len()), (rows.to_vec(), 0));
    let odd =
        systems("a.ifs", "IFS:a {\n 1e-7 -0. 1e12 .333333333333333 .1 0 1\n .1 0 0 .1 0 0 2\n .1 0 0 .1 1 0 0\n}");
    let (text, _) = entries(&items(&odd));
    assert!(text.contains("1e-7  0  1000000000000  0.333333333333333  0.1  0  0.333333"), "{text}");
    assert_eq!(entries(&items(&systems("b.ifs", &text))).0, text);
}

#[test]
fn shares_sum_to_a_million_and_none_is_lost() {
    assert_eq!(millionths(&[1.0 / 3.0; 3]), [333_333, 333_333, 333_334]);
    assert_eq!(millionths(&[1e-9, 1.0 - 1e-9]), [1, 999_999]);
    assert_eq!(millionths(&[1.0 - 1e-9, 1e-9]), [999_999, 1]);
    assert_eq!(millionths(&[0.0, 1.0, 0.0]).iter().sum::<u64>(), 1_000_000);
    assert_eq!(
        (share(1_000_000), share(0), share(250_000), share(1)),
        ("1".into(), "0".into(), "0.25".into(), "0.000001".into())
    );
}

#[test]
fn what_a_file_cannot_hold_is_said() {
    let text = "[ifs]\nname = \"two words; {x}\"\nchaos = [[1, 1], [0, 1]]\nmap = [\n\
        { abcdef = [0.5, 0, 0, 0.5, 0, 0], p = 0.5, color = \"#4f7a2b\", opacity = 0.5 },\n\
        { abcdef = [0.5, 0, 0, 0.5, 1, 0], p = 0.5 },\n]\n\
        condensation = [{ disc = { center = [0, 0], radius = 2 }, weight = 0.1 }]\n";
    let all = systems("t.ifs.toml", text);
    let (text, warnings) = entries(&items(&all));
    assert_eq!(warnings.len(), 1);
    insta::assert_snapshot!("I011", format!("{}\n{text}", warnings[0].message));
    let (text, warnings) = flames(&items(&all)).expect("plane");
    assert!(text.contains("chaos=\"0 1\"") && text.contains("opacity=\"0.5\""), "{text}");
    assert!(
        warnings[0].message.contains("condensation") && !warnings[0].message.contains("chaos"),
        "{}",
        warnings[0].message
    );
    let tree = systems("monopodial.ifs.toml", &table("monopodial.ifs.toml"));
    assert_eq!(flames(&items(&tree)).expect_err("space").code, "I030");
}

#[test]
fn names_are_sound_and_used_once() {
    let of = |name: &str| {
        let mut s = systems("f.ifs", "fern {\n 0 0 0 .16 0 0 1\n}\n").remove(0);
        s.name = name.into();
        item(&s)
    };
    let long = "x".repeat(60);
    let all: Vec<TableItem> = ["a b", "A_B", "comment", "", "IFS:q", &long, &long].map(of).into();
    let found = names(&all);
    assert_eq!(found[..5], ["a_b", "A_B_2", "comment_", "system", "q"]);
    assert!(found[5].len() == 40 && found[6].len() == 40 && found[5] != found[6]);
    let again = systems("n.ifs", &entries(&all).0);
    assert_eq!(again.iter().map(|s| s.name.clone()).collect::<Vec<_>>(), found);
}

/// The shipped plain trees were written by hand to six decimals from the same branches.
#[test]
fn trees_are_squashed_as_the_shipped_ones() {
    for name in ["monopodial", "sympodial", "pseudodichotomous"] {
        let of = |ending: &str| {
            let file = format!("{name}{ending}");
            systems(&file, &table(&file)).remove(0)
        };
        let tree = of(".ifs.toml");
        assert!(is_tree(&tree));
        let made = squashed(&stems(&tree).expect("a tree"));
        let (text, _) = entries(std::slice::from_ref(&made));
        let (ours, shipped) = (systems("t.ifs", &text).remove(0), of(".ifs"));
        assert_eq!(ours.maps.len(), shipped.maps.len());
        for (a, b) in ours.maps.iter().zip(&shipped.maps) {
            let (x, y) = (a.affine.coefficients(3), b.affine.coefficients(3));
            assert!(x.iter().zip(&y).all(|(x, y)| (x - y).abs() < 2e-5), "{name}: {x:?} {y:?}");
            assert!((a.weight.unwrap_or(0.0) - b.weight.unwrap_or(0.0)).abs() < 1e-3, "{name}");
        }
        // A tree that was written stays what it is.
        let again = squashed(&stems(&ours).expect("still a tree"));
        assert_eq!(entries(&[again]).0, text, "{name}");
    }
}

/// Points of the chaos game stay in the box of the words, 2 % wider.
#[test]
fn a_squashed_tree_fills_its_own_box() {
    use crate::words::{ExpansionLimits, expand};
    let tree = systems("monopodial.ifs.toml", &table("monopodial.ifs.toml"));
    let grown = stems(&tree[0]).expect("a tree");
    let limits =
        ExpansionLimits { eps: 0.004, max_depth: u16::MAX, max_order: u16::MAX, max_words: 5_000_000, raised_by: None };
    let words = expand(&grown.system, &grown.letters, &limits, None).expect("expands").words;
    let ends = || words.iter().flat_map(|w| [w.map.apply(glam::DVec3::ZERO), w.map.apply(glam::DVec3::Y)]);
    let (low, high) =
        (ends().fold(glam::DVec3::MAX, glam::DVec3::min), ends().fold(glam::DVec3::MIN, glam::DVec3::max));
    let slack = 0.02 * (high - low).max_element();
    let plain = squashed(&grown).system;
    let plain = Ifs { condensation: Vec::new(), ..plain };
    let (l, h) = extent(&plain, &study(&plain, WeightRule::Moran)).expect("an attractor").bounds;
    assert!(l.cmpge(low - slack).all() && h.cmple(high + slack).all(), "{l} {h} beyond {low} {high}");
}
