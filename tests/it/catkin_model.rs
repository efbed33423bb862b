//! Catkins: the grammar that binds its own symbols, the tufts that it grows, their statistics.
#![allow(
    clippy::expect_used,
    clippy::disallowed_methods,
    clippy::cast_possible_truncation,
    reason = "tests measure and fail loudly"
)]

use std::collections::BTreeMap;

use glam::{DVec3, Vec3};
use osier::bake::BakeContext;
use osier::bake::assets::catkin::{CatkinLods, catkin_models, grow_skeleton};
use osier::diagnostic::Sources;
use osier::grammar::{DeriveOptions, DerivedString, Grammar, GrammarSource, derive, parse};
use osier::grow::turtle::{TurtleOptions, grow};
use osier::limits::Limits;
use osier::par::par_map;
use osier::plant::Plant;
use osier::progress::{Cancel, Silent};
use osier::recipe::KeyTable as _;
use osier::recipe::scene::{CatkinKeys, HairAngles, HairDistribution};
use osier::scene::Prototype;

fn read(text: &str) -> Grammar {
    let mut none = |reference: &str, _: &str| {
        Err(osier::Error::io("open", reference, std::io::Error::from(std::io::ErrorKind::NotFound)))
    };
    let source = GrammarSource {
        name: "test.l",
        bytes: text.as_bytes(),
        includes: &mut none,
        defines: &BTreeMap::default(),
        functions: Default::default(),
    };
    let (grammar, warnings) =
        parse(&mut Sources::default(), source, &Limits::default()).unwrap_or_else(|e| panic!("{e}"));
    assert!(warnings.is_empty(), "{warnings:?}");
    grammar
}

fn derived(grammar: &Grammar, seed: u64) -> DerivedString {
    let options = DeriveOptions { seed, ..DeriveOptions::default() };
    derive(grammar, &options, &Limits::default()).unwrap_or_else(|e| panic!("{e}"))
}

fn drawn(grammar: &Grammar, seed: u64) -> Plant {
    grow(grammar, &derived(grammar, seed), &TurtleOptions::default(), &Limits::default())
        .unwrap_or_else(|e| panic!("{e}"))
        .0
}

/// A text with a turtle of its own.
fn system(turtle: &str, axiom: &str) -> String {
    format!("lsystem: 1\nderivation length: 1\n{turtle}\naxiom: {axiom}\nendlsystem\n")
}

fn shipped() -> Grammar {
    read(osier::presets::find("catkin.l").expect("preset").text)
}

/// Sum of squared deviations over expectations, for counts that should be equal.
fn chi_square(counts: &[u64]) -> f64 {
    let total: u64 = counts.iter().sum();
    let expected = total as f64 / counts.len() as f64;
    counts.iter().map(|c| (*c as f64 - expected).powi(2) / expected).sum()
}

/// Bins of values that should be even between two bounds.
fn binned(values: impl Iterator<Item = f64>, [low, high]: [f64; 2]) -> Vec<u64> {
    let mut bins = vec![0_u64; 20];
    for v in values {
        let k = ((v - low) / (high - low) * 20.0).floor();
        assert!((-1e-3..20.001).contains(&k), "{v} is outside of {low} to {high}");
        bins[(k.max(0.0) as usize).min(19)] += 1;
    }
    bins
}

/// Beyond it lies a thousandth of chi-square: 19 degrees of freedom, 2 degrees.
const LIMIT_19: f64 = 43.82;
const LIMIT_2: f64 = 13.82;

fn work<'a>(limits: &'a Limits, cancel: &'a Cancel) -> BakeContext<'a> {
    BakeContext { limits, cancel, progress: &Silent, cache: None }
}

#[test]
fn the_shipped_grammar_has_the_papers_numbers() {
    let g = shipped();
    let d = derived(&g, 1);
    let text = g.print(&d.modules);
    assert_eq!(d.modules.len(), 901);
    assert_eq!(text.matches('F').count(), 300);
    let options = TurtleOptions::default();
    let (plant, warnings) = grow(&g, &d, &options, &Limits::default()).expect("draws");
    // Only the stalk's look is missing: organs come from scenes.
    assert!(warnings.iter().all(|w| w.code == "L048"), "{warnings:?}");
    assert_eq!((plant.axes.len(), plant.nodes.len()), (100, 400));
    for axis in &plant.axes {
        assert_eq!((axis.count, plant.nodes.p[axis.first as usize]), (4, Vec3::ZERO));
        assert!((axis.length - 3.0 * 0.0058).abs() < 1e-6);
    }
}

#[test]
fn rules_and_angles_keep_their_shares_over_a_thousand_seeds() {
    let g = shipped();
    let seeds: Vec<u64> = (0..1000).collect();
    let each = par_map(&seeds, |seed| {
        let d = derived(&g, *seed);
        let text = g.print(&d.modules);
        let mut rules = [0_u64; 6];
        for hair in text.split('[').skip(1) {
            let second = usize::from(hair.starts_with("*%")) * 3;
            let body = &hair[2..hair.len() - 1];
            let rule = ["F@F'F", "F@F-F", "F-F#F"].iter().position(|r| *r == body).expect("a rule");
            rules[second + rule] += 1;
        }
        let plant = grow(&g, &d, &TurtleOptions::default(), &Limits::default()).expect("draws").0;
        let first = |a: &osier::plant::Axis| (plant.nodes.p[a.first as usize + 1]).as_dvec3().normalize();
        (rules, plant.axes.iter().map(first).collect::<Vec<DVec3>>())
    });
    let mut rules = [0_u64; 6];
    each.iter().for_each(|(r, _)| rules.iter_mut().zip(r).for_each(|(a, b)| *a += b));
    assert!(chi_square(&rules[..3]) < LIMIT_2 && chi_square(&rules[3..]) < LIMIT_2, "{rules:?}");
    let hairs = || each.iter().flat_map(|(_, h)| h);
    let tilt = binned(hairs().map(|h| h.y.clamp(-1.0, 1.0).acos().to_degrees()), [0.0, 60.0]);
    assert!(chi_square(&tilt) < LIMIT_19, "tilt {tilt:?}");
    // The round of P and that of Q are a half each. A hair that stands upright points nowhere.
    let round = binned(hairs().filter(|h| h.y < 0.999).map(|h| h.z.atan2(h.x).to_degrees()), [-180.0, 180.0]);
    assert!(chi_square(&round) < LIMIT_19, "round {round:?}");
}

#[test]
fn bends_are_even_and_have_either_sign() {
    let turtle = "turtle: none\ndefine-angle: gamma = uniform(-15,15)\nbind F : forward 1 ; @ : rotate world z -gamma";
    let plant = drawn(&read(&system(turtle, "repeat 20000 { [F@F] }")), 3);
    let bend = |a: &osier::plant::Axis| {
        let at = |k: u32| plant.nodes.p[(a.first + k) as usize];
        let d = at(2) - at(1);
        f64::from(d.x.atan2(d.y).to_degrees())
    };
    let bins = binned(plant.axes.iter().map(bend), [-15.0, 15.0]);
    assert!(chi_square(&bins) < LIMIT_19, "{bins:?}");
}

/// Tilts of the first sections of many tufts of some keys.
fn tilts(keys: &CatkinKeys) -> Vec<f64> {
    let (limits, cancel) = (Limits::default(), Cancel::default());
    let all = (0..200).map(|seed| grow_skeleton(keys, 0, seed, &work(&limits, &cancel)).expect("grows"));
    let tilt = |p: &Plant, a: &osier::plant::Axis| p.nodes.p[a.first as usize + 1].as_dvec3().normalize().y.acos();
    all.flat_map(|p| p.axes.iter().map(|a| tilt(&p, a)).collect::<Vec<_>>()).collect()
}

#[test]
fn solid_angles_and_the_papers_angles_are_what_they_say() {
    let base = CatkinKeys { fluffiness: Some(60_f64.to_radians()), bend: Some(0.2), ..CatkinKeys::defaults() };
    let even = tilts(&CatkinKeys { polar: HairDistribution::SolidAngle, ..base.clone() });
    let bins = binned(even.iter().map(|t| t.cos()), [0.5, 1.0]);
    assert!(chi_square(&bins) < LIMIT_19, "{bins:?}");
    // With one angle for both turns no hair is swung further round than it could be tilted.
    let (limits, cancel) = (Limits::default(), Cancel::default());
    let plant =
        grow_skeleton(&CatkinKeys { angles: HairAngles::Paper, ..base }, 0, 5, &work(&limits, &cancel)).expect("grows");
    let rounds = plant.axes.iter().map(|a| {
        let d = plant.nodes.p[a.first as usize + 1];
        d.z.atan2(d.x).to_degrees().abs()
    });
    assert!(rounds.fold(0.0, f32::max) < 60.01);
}

#[test]
fn five_models_have_the_papers_numbers_and_true_balls() {
    let (limits, cancel) = (Limits::default(), Cancel::default());
    let keys = CatkinKeys::defaults();
    let models = catkin_models(&keys, 1, &work(&limits, &cancel)).expect("grows");
    assert_eq!(models.iter().map(|m| m.name.as_str()).collect::<Vec<_>>(), ["p000", "p001", "p002", "p003", "p004"]);
    let level = |lod| CatkinLods::from_keys(&CatkinKeys { lod, ..keys.clone() });
    for m in &models {
        let hero = m.prototype(&level(0), 7);
        let fine = hero.fine.as_ref().expect("curves");
        assert_eq!((fine.curves.counts.len(), fine.curves.points.len()), (100, 400));
        let far = fine.curves.points.iter().map(|p| p.length()).fold(0.0, f32::max);
        assert!((far - m.radius).abs() < 1e-9 && (0.016..0.0205).contains(&m.radius), "{}", m.radius);
        assert!(hero.mesh.points.iter().all(|p| p.length() < m.radius + 31e-6));
        assert_eq!((fine.curves.material, fine.mesh.subsets[0].material), (7, 8));
        let root = fine.curves.widths[0];
        assert!((root - 60e-6).abs() < 1e-9 && (fine.curves.widths[3] / root - 0.25).abs() < 1e-4);
        let triangles = |p: Prototype| p.mesh.triangles.len();
        assert_eq!([1, 2, 3].map(|lod| triangles(m.prototype(&level(lod), 0))), [1968, 648, 192]);
    }
    let again = catkin_models(&keys, 1, &work(&limits, &cancel)).expect("grows");
    assert_eq!(again[3].tuft().hairs.points, models[3].tuft().hairs.points);
    let other = catkin_models(&keys, 2, &work(&limits, &cancel)).expect("grows");
    assert_ne!(other[3].tuft().hairs.points, models[3].tuft().hairs.points);
    let few = catkin_models(&CatkinKeys { hairs: 7, variants: 1, ..keys }, 1, &work(&limits, &cancel)).expect("grows");
    assert_eq!(few[0].tuft().hairs.counts.len(), 7);
}

#[test]
fn every_action_draws_what_it_says() {
    let base = "turtle: none\ndefine-angle: a = 30\n";
    let like = |bind: &str, mine: &str, theirs: &str| {
        let own = drawn(&read(&system(&format!("{base}{bind}"), mine)), 1);
        let cpfg = drawn(&read(&format!("lsystem: 1\nderivation length: 0\naxiom: {theirs}\nendlsystem\n")), 1);
        assert_eq!(own.axes.len(), cpfg.axes.len(), "{bind}");
        for (a, b) in own.nodes.p.iter().zip(&cpfg.nodes.p) {
            assert!(a.distance(*b) < 1e-6, "{bind}: {a} {b}");
        }
        for (a, b) in own.nodes.r.iter().zip(&cpfg.nodes.r) {
            assert!((a - b).abs() < 1e-6, "{bind}: {a} {b}");
        }
        assert_eq!(own.organs.len(), cpfg.organs.len(), "{bind}");
        assert_eq!(own.nodes.color, cpfg.nodes.color, "{bind}");
        for (a, b) in own.organs.iter().zip(&cpfg.organs) {
            assert!((a.scale - b.scale).abs() < 1e-6, "{bind}");
        }
    };
    let f = "bind d : forward 2 ; m : move 1 ;";
    like(&format!("{f} t : rotate turtle u a"), "d t d(1)", "F(2)+(30)F(1)");
    like(&format!("{f} t : rotate turtle l -a"), "d t d", "F(2)^(30)F(2)");
    like(&format!("{f} t : rotate turtle h a ; u : rotate turtle u 40"), "d t u d", "F(2)\\(30)+(40)F(2)");
    like(&format!("{f} t : rotate world z a"), "d t d m d", "F(2)+(30)F(2)f(1)F(2)");
    like(&format!("{f} w : width a/300 ; v : widen a/600 ; c : colour 7"), "w d c v d", "!(0.1)F(2);(7)!(0.15)F(2)");
    like(
        &format!("{f} p : polygon ; . : vertex ; q : fill ; + : as + "),
        "d p . m . +(90) m . q",
        "F(2){.f(1).+(90)f(1).}",
    );
    like(&format!("{f} o : sphere a/100 ; n : none"), "w(1) d o n d", "F(2)@O(0.3)F(2)");
    // Parameters take the place of the action's own number, and a turn about the world leaves the place.
    like(f, "d(3) m(2) d(1)", "F(3)f(2)F(1)");
    let turned =
        drawn(&read(&system(&format!("{base}{f} y : rotate world y 90 ; z : rotate world z -90"), "z d y d")), 1);
    let end = turned.nodes.p.last().expect("nodes");
    assert!(end.distance(Vec3::new(2.0, 0.0, -2.0)) < 1e-6, "{end}");
}

#[test]
fn bound_letters_lose_their_roles() {
    // Not cut, not empty, not a prefix, not a query: four letters that draw.
    let turtle = "turtle: none\nbind % : forward 1 ; * : forward 2 ; @ : forward 4 ; ? : forward 8 ; ~ : forward 16";
    let plant = drawn(&read(&system(turtle, "%*@?~")), 1);
    assert!((plant.axes[0].length - 31.0).abs() < 1e-5);
    // What is not bound keeps its role with cpfg's turtle and means nothing with none.
    let length =
        |turtle: &str, axiom: &str| drawn(&read(&system(turtle, axiom)), 1).axes.iter().map(|a| a.length).sum::<f32>();
    assert!((length("turtle: cpfg\nbind A : forward 5", "A F(1) f(1) F(2)") - 8.0).abs() < 1e-5);
    assert!((length("turtle: none\nbind A : forward 5", "A F(1) f(1) F(2)") - 5.0).abs() < 1e-5);
    // An empty successor is nothing at all, and rules compete without a seed.
    let text = "lsystem: 1\nderivation length: 1\nturtle: none\nbind F : forward 1\naxiom: F repeat 300 { [AF] }\n\
                A -->\nA --> *F\nA --> F*F\nendlsystem\n";
    let g = read(text);
    let made = g.print(&derived(&g, 2).modules);
    let counts = ["[F]", "[*FF]", "[F*FF]"].map(|s| made.matches(s).count() as u64);
    assert_eq!(counts.iter().sum::<u64>(), 300);
    assert!(chi_square(&counts) < LIMIT_2, "{counts:?}");
}

#[test]
fn repeats_nest_and_number_their_modules() {
    let g = read(&system("turtle: none", "A repeat 2 { B repeat 3 { C {D} } } repeat 0 { E } A"));
    let d = derived(&g, 1);
    assert_eq!(g.print(&d.modules), "ABC{D}C{D}C{D}BC{D}C{D}C{D}A");
    let lineages: std::collections::BTreeSet<u64> = d.modules.iter().map(|m| m.lineage()).collect();
    assert_eq!(lineages.len(), d.modules.len(), "no two modules share their draws");
}

#[test]
fn draws_hang_on_lineage_alone() {
    let hair = |angles: &str, length: u32, extra: &str| {
        let text = format!(
            "lsystem: 1\nderivation length: {length}\nturtle: none\ndefine-angle: {angles}\n\
             bind F : forward 1 ; @ : rotate world z g\naxiom: {extra} repeat 5 {{ [F@F] }}\nX --> X\nendlsystem\n"
        );
        drawn(&read(&text), 9).nodes.p
    };
    let rest = hair("g = normal(0,20)", 1, "X");
    assert_eq!(rest, hair("g = normal(0,20)", 7, "X"), "no flicker from step to step");
    assert_eq!(rest, hair("h = uniform(0,9) g = normal(0,20)", 1, "XX"), "other angles and symbols change nothing");
    assert_ne!(rest, hair("g = normal(1,20)", 1, "X"));
    // Angles of angles are drawn for each use.
    let two = hair("h = choose(10,0.5, 50,0.5) g = 2*h", 1, "X");
    let bends: std::collections::BTreeSet<i32> = two
        .chunks(3)
        .map(|p| {
            let d = p[2] - p[1];
            (-d.x).atan2(d.y).to_degrees().round() as i32
        })
        .collect();
    assert_eq!(bends.into_iter().collect::<Vec<_>>(), [20, 100]);
}
