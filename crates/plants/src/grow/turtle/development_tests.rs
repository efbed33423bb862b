//! Clips of developing plants have one topology, change without jumps, and show the plants of their steps.

use glam::Vec3;

use osier_base::limits::Limits;
use osier_base::math;
use osier_base::units::radians;
use osier_grammar::{DeriveOptions, Grammar};
use osier_scene::plant::{NONE, Plant};

use super::step_part_tests::{GRAMMARS, distance, grammar, size};
use super::tests::{leaf, read};
use super::*;
use crate::grow::clip::PosedGrowth;
use crate::grow::years::PoseNow;

/// The tree with cone-shaped segments of which each order is shorter, and the leaves of the last one.
const PARAMETRIC: &str = "#define C1 B(0.7*d,v1*0.6,n-1)\n#define C2 B(0.6*d,v2*0.6,n-1)\nlsystem: tree\nSeed: 7\nderivation length: 6\n\
     Start: { T1=0.45; T2=0.5; A1=35; A2=28; B1=20; B2=110; }\naxiom: B(1,0.08,5)\n\
     B(d,w,n) : n>2 {r3=choose(0.7,0.5, 0.8,0.5); v1=w*(1-(1-r3)*T1); v2=w*(1-(1-r3)*(T1+T2));} --> \
     !(w)F(T1*d)!(v1) [/(B1)+(A1)C1][/(B1)-(A1)C1][/(B2)+(A1)C1] F(T2*d)!(v2) [/(B1)+(A2)C2][/(B1)-(A2)C2][/(B2)+(A2)C2] F((1-T1-T2)*d)!(w*r3)\n\
     B(d,w,n) : n>0 && n<=2 {r3=choose(0.7,0.5, 0.8,0.5); v2=w*r3;} --> !(w)F(d)!(v2) [+(A2)C2][-(A2)C2]\n\
     B(d,w,n) : n<=0 --> ~l(d)\nendlsystem\n";

/// A tuft of hairs with an action bound to each symbol.
const CATKIN: &str = "lsystem: catkin\nSeed: 3\nderivation length: 1\nturtle: none\ndefine-angle: delta = uniform(0,60)  spin = uniform(0,180)\n\
     bind F : forward 0.0058\nbind $ : rotate world y -spin\nbind * : rotate world z -delta\nbind ? : rotate world y -delta\n\
     axiom: repeat 9 { [*$P] }\nP --> F?F*F\nP --> F$F?F\nendlsystem\n";

/// Modules that the homomorphism draws, with heirs and without, and organs that go.
const DRAWN: &str = "Lsystem: 1\nderivation length: 5\nAxiom: F(1)A(1)\n\
     A(k) : k<4 --> [&(50)L(k)]/(137)B(k)+(5)A(k+1)\nB(k) --> F(1)[+(40)~l(0.5)]C\nC --> F(0.3)\nL(k) : k>1 --> D\nD --> *\n\
     homomorphism\nA(k) --> F(0.2*k)~l(0.3)\nL(k) --> F(k*0.5)~l(1)\nD --> F(0.4)[+(30)F(0.2)]\nendlsystem\n";

/// Branches that are cut after they have grown.
const CUT: &str = "Lsystem: 1\nderivation length: 5\nAxiom: A\nA --> F(1)[+(40)B(0)]A\nB(k) : k==1 --> %F(0.2)B(k+1)\n\
     B(k) : k<4 --> F(0.5)[-(30)F(0.2)~l(1)]B(k+1)\nendlsystem\n";

struct Case {
    name: &'static str,
    grammar: Grammar,
    angle: f64,
    steps: u32,
    radii: RadiusModel,
}

fn cases() -> Vec<Case> {
    let textbook = |(name, angle, steps, lines): &(&'static str, f64, u32, &str)| Case {
        name,
        grammar: grammar(lines),
        angle: *angle,
        steps: (*steps).min(2) + 1,
        radii: RadiusModel::Auto,
    };
    let own = |name, text, steps| Case { name, grammar: read(text), angle: 30.0, steps, radii: RadiusModel::Auto };
    let mut cases: Vec<Case> = GRAMMARS.iter().map(textbook).collect();
    cases.push(own("tree of 4.3", PARAMETRIC, 6));
    cases.push(own("catkin", CATKIN, 1));
    cases.push(own("drawn by homomorphism", DRAWN, 5));
    cases.push(own("cut", CUT, 5));
    cases
}

impl Case {
    fn options(&self) -> TurtleOptions {
        let mut options =
            TurtleOptions { angle: Some(radians(self.angle)), radii: self.radii, ..TurtleOptions::default() };
        options.organs.insert('l', leaf());
        options
    }

    fn clip(&self, shares: [f64; 2], whole_steps: bool) -> DevelopmentClip {
        let derivation = DeriveOptions { steps: Some(self.steps), ..DeriveOptions::default() };
        let clip = DevelopmentOptions { steps: f64::from(self.steps), shares, whole_steps };
        let made = DevelopmentClip::new(&self.grammar, &derivation, self.options(), clip, &Limits::default());
        made.unwrap_or_else(|e| panic!("{}: {e}", self.name))
    }

    /// The plant of a number of steps, of which a part of the last one may be drawn.
    fn plant(&self, steps: u32, step_part: Option<f64>) -> Plant {
        let options = TurtleOptions { step_part, ..self.options() };
        let steps = DeriveOptions { steps: Some(steps), ..DeriveOptions::default() };
        let derived = derive(&self.grammar, &steps, &options, &Limits::default()).expect("derives");
        grow(&self.grammar, &derived, &options, &Limits::default()).expect("grows").0
    }
}

/// The plant of a clip in a pose, without what does not exist then.
fn posed(clip: &DevelopmentClip, pose: &PoseNow) -> Plant {
    let mut plant = Plant::default();
    for axis in &clip.plant.axes {
        // Both ends of a segment that exists are apart.
        for k in clip.plant.nodes_of(axis).skip(1).filter(|k| pose.p[*k].distance(pose.p[*k - 1]) > 0.0) {
            if pose.r[k].max(pose.r[k - 1]) > 0.0 {
                let first = u32::try_from(plant.nodes.p.len()).expect("small");
                plant.nodes.p.extend([pose.p[k - 1], pose.p[k]]);
                plant.nodes.r.extend([pose.r[k - 1], pose.r[k]]);
                plant.axes.push(osier_scene::plant::Axis { first, count: 2, ..axis.clone() });
            }
        }
    }
    plant
}

/// Largest move of a node, change of a radius, and change of an organ that is seen, between two poses; m.
fn change(a: &PoseNow, b: &PoseNow) -> [f32; 3] {
    let nodes = a.p.iter().zip(&b.p).map(|(p, q)| p.distance(*q)).fold(0.0, f32::max);
    let radii = a.r.iter().zip(&b.r).map(|(r, s)| (r - s).abs()).fold(0.0, f32::max);
    let leaves = a.leaves.iter().zip(&b.leaves).map(|(l, m)| {
        let moved = (l.position * l.size.min(m.size)).distance(m.position * l.size.min(m.size));
        (l.size - m.size).abs().max(moved)
    });
    [nodes, radii, leaves.fold(0.0, f32::max)]
}

#[test]
fn nothing_jumps_where_a_step_begins() {
    for case in cases() {
        let clip = case.clip([0.0, 1.0], false);
        let size = size(&clip.plant);
        for step in 1..case.steps {
            for e in [1e-2_f32, 1e-3] {
                let at = |t: f32| clip.pose(t).expect("poses");
                let t = math::narrow(f64::from(step));
                let [nodes, radii, leaves] = change(&at(t - e), &at(t + e));
                let most = 16.0 * e;
                assert!(nodes < most * size, "{} at {step}: nodes move {nodes} of {size} in {e}", case.name);
                assert!(
                    radii < most * 0.05 * size,
                    "{} at {step}: radii change by {radii} of {size} in {e}",
                    case.name
                );
                assert!(leaves < most * size.max(1.0), "{} at {step}: leaves change by {leaves} in {e}", case.name);
            }
        }
    }
}

#[test]
fn a_clip_shows_the_plants_of_its_steps_and_their_parts() {
    for case in cases() {
        let clip = case.clip([0.0, 1.0], false);
        for step in 1..=case.steps {
            for part in [None, Some(0.25)] {
                let plant = case.plant(step, part);
                let t = f64::from(step) - part.map_or(0.0, |part| 1.0 - part);
                let now = posed(&clip, &clip.pose(math::narrow(t)).expect("poses"));
                let most = 1e-4 * size(&plant).max(1e-3);
                let away = (distance(&plant, &now), distance(&now, &plant));
                assert!(away.0 < most && away.1 < most, "{} at {t}: {away:?} of {}", case.name, size(&plant));
                let thick = |p: &Plant| p.nodes.r.iter().copied().fold(0.0, f32::max);
                assert!((thick(&plant) - thick(&now)).abs() < 0.02 * thick(&plant), "{} at {t}: radii", case.name);
            }
        }
    }
}

#[test]
fn the_end_of_a_clip_is_the_plant_of_the_last_step() {
    for case in cases() {
        let clip = case.clip([0.0, 1.0], false);
        let plant = case.plant(case.steps, None);
        let pose = clip.pose(math::narrow(f64::from(case.steps))).expect("poses");
        let own = plant.nodes.len();
        assert_eq!(clip.plant.nodes.p[..own], plant.nodes.p, "{}", case.name);
        for k in 0..own {
            assert!(pose.p[k].distance(plant.nodes.p[k]) < 1e-5 * size(&plant).max(1.0), "{} node {k}", case.name);
            assert!((pose.r[k] - plant.nodes.r[k]).abs() < 1e-6, "{} node {k}", case.name);
            assert!(pose.q[k].dot(plant.nodes.q[k]).abs() > 0.999, "{} node {k}", case.name);
        }
        // What has gone has no thickness and no size.
        assert!(pose.r[own..].iter().all(|r| *r <= 0.0), "{}", case.name);
        for (organ, now) in clip.plant.organs.iter().zip(&pose.leaves).take(plant.organs.len()) {
            let (pivot, _) = clip.plant.organ_site(organ);
            assert!(pivot.distance(now.position) < 1e-5 && (now.size - 1.0).abs() < 1e-5, "{}", case.name);
        }
        assert!(pose.leaves[plant.organs.len()..].iter().all(|leaf| leaf.size <= 0.0), "{}", case.name);
    }
}

#[test]
fn all_frames_have_the_nodes_and_ids_of_one_plant() {
    for case in cases() {
        let clip = case.clip([0.0, 1.0], false);
        let mut ids: Vec<u64> = clip.plant.axes.iter().map(|axis| axis.id).collect();
        ids.sort_unstable();
        ids.dedup();
        assert_eq!(ids.len(), clip.plant.axes.len(), "{}: ids of axes", case.name);
        for k in 0..=8_u16 {
            let pose = clip.pose(f32::from(k) / 8.0 * math::narrow(f64::from(case.steps))).expect("poses");
            let n = clip.plant.nodes.len();
            assert_eq!(
                [pose.p.len(), pose.q.len(), pose.r.len(), pose.leaves.len()],
                [n, n, n, clip.plant.organs.len()]
            );
            assert!(pose.p.iter().all(|p| p.is_finite()) && pose.q.iter().all(|q| (q.length() - 1.0).abs() < 1e-4));
        }
    }
    // Modules that continue others keep their ids: the plant of fewer steps has the axes of this one.
    let case = &cases()[7];
    let of = |plant: &Plant| plant.axes.iter().map(|axis| axis.id).collect::<std::collections::BTreeSet<u64>>();
    let (few, many) = (case.clip([0.0, 0.5], false), case.clip([0.0, 1.0], false));
    assert!(of(&few.plant).is_subset(&of(&many.plant)));
}

#[test]
fn what_a_step_removes_shrinks_in_place() {
    // The branch is cut in the fourth step, and half as long in its middle.
    let case = cases().pop().expect("the branches that are cut");
    let clip = case.clip([0.0, 1.0], false);
    let removed = || clip.plant.axes.iter().filter(|axis| axis.parent == NONE && axis.order > 0);
    assert!(removed().count() > 0);
    let length = |pose: &PoseNow| -> f32 {
        let of = |k: usize| pose.p[k].distance(pose.p[k - 1]);
        removed().flat_map(|axis| clip.plant.nodes_of(axis).skip(1)).map(of).sum()
    };
    let lengths = [3.0, 3.5, 4.0].map(|t| length(&clip.pose(t).expect("poses")));
    assert!(lengths[0] > 0.0 && lengths[1] > 0.0, "{lengths:?}");
    // A lone image without heir shrinks by the part of the step.
    let one = read("Lsystem: 1\nderivation length: 1\nAxiom: F(1)D\nD --> *\nhomomorphism\nD --> F(0.4)\nendlsystem\n");
    let case = Case { name: "D", grammar: one, angle: 0.0, steps: 1, radii: RadiusModel::Auto };
    let clip = case.clip([0.0, 1.0], false);
    let pose = clip.pose(0.25).expect("poses");
    let tip = pose.p.iter().copied().fold(Vec3::ZERO, |a, b| if b.y > a.y { b } else { a });
    assert!((tip.y - 1.3).abs() < 1e-5, "{tip}");
}

#[test]
fn whole_steps_switch_at_once() {
    let case = &cases()[0];
    let clip = case.clip([0.0, 1.0], true);
    let at = |t: f32| clip.pose(t).expect("poses").p;
    assert_eq!(at(2.0), at(2.9));
    assert_ne!(at(2.9), at(3.0));
}

#[test]
fn radii_do_not_jump_in_parts_of_steps() {
    // A trunk whose tip becomes four branches: their pipes count in proportion to the part of the step.
    let g = grammar("Axiom: FA\nA --> [+F][-F][&F][^F]\n");
    let case = Case { name: "fork", grammar: g, angle: 40.0, steps: 1, radii: RadiusModel::Pipe(Default::default()) };
    let base = |part: Option<f64>| case.plant(1, part).nodes.r[0];
    let (before, begins, half, after) = (case.plant(0, None).nodes.r[0], base(Some(1e-3)), base(Some(0.5)), base(None));
    assert!((begins - before).abs() < 0.01 * before, "{before} {begins}");
    assert!(before < half && half < after, "{before} {half} {after}");
}

#[test]
fn clips_of_grammars_without_parts_of_steps_are_refused() {
    let said = |text: &str| {
        let derivation = DeriveOptions { steps: Some(2), ..DeriveOptions::default() };
        let clip = DevelopmentOptions { steps: 2.0, shares: [0.0, 1.0], whole_steps: false };
        let made = DevelopmentClip::new(&read(text), &derivation, TurtleOptions::default(), clip, &Limits::default());
        made.err().map_or_else(String::new, |e| e.to_string())
    };
    let head = "Lsystem: 1\nderivation length: 2\n";
    assert!(said(&format!("{head}Axiom: F(1)?P(0,0,0)A\nA --> F(1)?P(0,0,0)A\nendlsystem\n")).contains("L063"));
    let by_context = format!("{head}Axiom: FA\nA --> FA\nhomomorphism\nF < A --> G\nendlsystem\n");
    assert!(said(&by_context).contains("depends on modules around"));
    let cylinder = format!("{head}Axiom: @GsA\nA --> F(1)@Gc(4)+A\nendlsystem\n");
    assert!(said(&cylinder).contains("L063"), "{}", said(&cylinder));
}
