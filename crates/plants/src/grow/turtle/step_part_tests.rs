//! Plants of fractional numbers of steps change without jumps.

use osier_base::limits::Limits;
use osier_base::math;
use osier_base::units::radians;
use osier_grammar::{DeriveOptions, Grammar};
use osier_scene::plant::Plant;

use super::tests::read;
use super::*;

/// Textbook plants a to f, the curve of Koch, a plant whose modules have parameters, conditions and contexts, and one whose segments
/// become moves.
pub(super) const GRAMMARS: [(&str, f64, u32, &str); 9] = [
    ("a", 25.7, 3, "Axiom: F\nF --> F[+F]F[-F]F\n"),
    ("b", 20.0, 3, "Axiom: F\nF --> F[+F]F[-F][F]\n"),
    ("c", 22.5, 3, "Axiom: F\nF --> FF-[-F+F+F]+[+F-F-F]\n"),
    ("d", 20.0, 4, "Axiom: X\nX --> F[+X]F[-X]+X\nF --> FF\n"),
    ("e", 25.7, 4, "Axiom: X\nX --> F[+X][-X]FX\nF --> FF\n"),
    ("f", 22.5, 3, "Axiom: X\nX --> F-[[X]+X]+F[+FX]-X\nF --> FF\n"),
    ("Koch", 60.0, 3, "Axiom: F(1)\nF(x) --> F(x/3)+F(x/3)--F(x/3)+F(x/3)\n"),
    (
        "parameters",
        30.0,
        4,
        "Axiom: !(1)F(1)A(1,0)\nA(w,k) : k<9 --> !(w*0.8)/(137.5)[&(40)!(w*0.6)F(0.5)B(0.5)]F(1)A(w*0.8,k+1)\n\
         B(l) --> +(20)F(l)B(l*0.7)\nF(l) --> F(l*1.2)\n",
    ),
    ("moves", 30.0, 3, "Axiom: F(1)G(1)\nF(l) --> F(l)[+F(l)]f(l*0.5)F(l)\nG(l) --> [+F(l)]\n"),
];

pub(super) fn grammar(lines: &str) -> Grammar {
    read(&format!("Lsystem: 1\nderivation length: 1\n{lines}endlsystem\n"))
}

/// A plant of a number of steps, with the widths that its string sets.
fn plant(grammar: &Grammar, angle: f64, steps: u32, step_part: Option<f64>) -> Plant {
    let options = TurtleOptions {
        angle: Some(radians(angle)),
        radii: RadiusModel::Widths,
        step_part,
        ..TurtleOptions::default()
    };
    let steps = DeriveOptions { steps: Some(steps), ..DeriveOptions::default() };
    let derived = derive(grammar, &steps, &options, &Limits::default()).expect("derives");
    grow(grammar, &derived, &options, &Limits::default()).expect("grows").0
}

/// Largest distance of a node of one plant from the nearest segment of the other, m.
pub(super) fn distance(of: &Plant, from: &Plant) -> f32 {
    let segments: Vec<_> = from.axes.iter().flat_map(|a| from.nodes_of(a).skip(1)).map(|k| [k - 1, k]).collect();
    let nearest = |p: glam::Vec3| {
        let away = |[a, b]: &[usize; 2]| {
            let (a, b) = (from.nodes.p[*a], from.nodes.p[*b]);
            let t = ((p - a).dot(b - a) / (b - a).length_squared().max(f32::MIN_POSITIVE)).clamp(0.0, 1.0);
            p.distance(a.lerp(b, t))
        };
        segments.iter().map(away).fold(f32::INFINITY, f32::min)
    };
    of.nodes.p.iter().map(|p| nearest(*p)).fold(0.0, f32::max)
}

pub(super) fn size(plant: &Plant) -> f32 {
    osier_base::geometry::Bounds::of(plant.nodes.p.iter().copied()).size().length()
}

#[test]
fn a_step_begins_and_ends_without_a_jump() {
    for (name, angle, steps, lines) in GRAMMARS {
        let g = grammar(lines);
        let (before, after) = (plant(&g, angle, steps, None), plant(&g, angle, steps + 1, None));
        // At both ends the distance is proportional to the part, so that it can be made as small as one likes.
        for part in [1e-2_f64, 1e-3] {
            let (begins, ends) =
                (plant(&g, angle, steps + 1, Some(part)), plant(&g, angle, steps + 1, Some(1.0 - part)));
            let most = 8.0 * math::narrow(part) * size(&after);
            assert!(distance(&begins, &before) < most && distance(&before, &begins) < most, "{name} begins, {part}");
            assert!(distance(&ends, &after) < most && distance(&after, &ends) < most, "{name} ends, {part}");
        }
        let half = plant(&g, angle, steps + 1, Some(0.5));
        assert!(distance(&half, &before) > 0.02 * size(&before), "{name}: nothing grows");
    }
}

#[test]
fn parts_of_a_step_have_the_lengths_and_angles_of_the_rules() {
    // The curve of Koch after half a step: four segments of (1/4 + 1/3) / 2, the second turned by 30 degrees.
    let g = grammar(GRAMMARS[6].3);
    let half = plant(&g, 60.0, 1, Some(0.5));
    let s: Vec<f32> = half.nodes.s.clone();
    let quarter = 0.5 * (0.25 + 1.0 / 3.0);
    assert_eq!(s.len(), 5);
    for (k, s) in s.iter().enumerate() {
        assert!((f64::from(*s) - quarter * k as f64).abs() < 1e-6, "{s}");
    }
    let direction = (half.nodes.p[2] - half.nodes.p[1]).normalize();
    assert!((f64::from(direction.y) - math::cos(radians(30.0))).abs() < 1e-6, "{direction}");
    // A parameter moves from its old to its new value; a segment that the step removes shrinks.
    let g = grammar("Axiom: F(1)+(10)G(1)\n+(a) --> +(a+20)\nG(l) --> *\n");
    let third = plant(&g, 0.0, 1, Some(0.25));
    let direction = (third.nodes.p[2] - third.nodes.p[1]).normalize();
    assert!((third.nodes.s[2] - 1.75).abs() < 1e-6);
    assert!((f64::from(direction.y) - math::cos(radians(15.0))).abs() < 1e-6, "{direction}");
}

#[test]
fn grammars_whose_parts_cannot_be_drawn_are_refused() {
    let said = |g: &Grammar| {
        let options = TurtleOptions { step_part: Some(0.5), ..TurtleOptions::default() };
        let steps = DeriveOptions { steps: Some(1), ..DeriveOptions::default() };
        derive(g, &steps, &options, &Limits::default()).err().map_or_else(String::new, |e| e.to_string())
    };
    let asks = said(&grammar("Axiom: F(1)?P(0,0,0)A\nA --> F(1)?P(0,0,0)A\n"));
    assert!(asks.contains("L063") && asks.contains("queried"), "{asks}");
    let foreign = said(&read("Koch {\n  Angle 6\n  Axiom F--F--F\n  F=F+F--F+F\n}\n"));
    assert!(foreign.contains("L063"), "{foreign}");
}
