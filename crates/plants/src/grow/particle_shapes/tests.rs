use std::f64::consts::{PI, TAU};
use std::sync::Arc;

use glam::{DVec3, Vec3};

use super::axis::ShapeAxis;
use super::growth::{GrownShapes, grow_axes};
use super::params::{
    ByLevel, CrownShape, Leaves, Limits, Motion, Roots, ShapeParams, Spawning, Thickness, ThicknessRule, Variant,
    WeightedRatio,
};
use super::particle::{Influence, PAPER_STEP, Particle, StepRates, carried, rotated};
use super::region::Region;
use super::shade::ShadeGrid;
use super::*;
use osier_base::math::{cos, exp, sin, sqrt};
use osier_base::par::on_threads;
use osier_base::rng::Rng;
use osier_scene::plant::{AxisEnd, AxisKind, validate};
use osier_scene::solid::{Form, Prism, Solid};
use osier_scene::{Mesh, Trs};

/// A plain tree of three levels without tropisms.
fn params() -> ShapeParams {
    let zero = || ByLevel::from([0.0]);
    ShapeParams {
        variant: Variant::Corrected,
        step: 1.0,
        roots: Roots { count: 1, radius: 0.0, tilt: [0.0, 0.0], outward: 0.0 },
        motion: Motion {
            speed: [1.0, 0.7, 0.5].into(),
            spread: [4.0, 3.0].into(),
            wander: [0.05, 0.15, 0.25].into(),
            twist: zero(),
            coil: zero(),
            coil_angle: 25.0_f64.to_radians(),
            gravity: zero(),
            up: zero(),
            light: zero(),
            attract: zero(),
            avoid: zero(),
            climb: zero(),
            paper_spread: 0.1,
        },
        spawning: Spawning {
            spacing: [0.2, 0.1].into(),
            spacing_sigma: 0.3,
            base: [0.2, 0.1].into(),
            dormancy: 0.15,
            buds: 1,
            angle: [55.0_f64.to_radians()].into(),
            angle_deviation: 5.0_f64.to_radians(),
            azimuth_deviation: 8.0_f64.to_radians(),
            up_bias: 0.0,
            flow: 0.35,
            crown: CrownShape::Spherical,
            split: zero(),
            split_angle: 50.0_f64.to_radians(),
            apex_death: zero(),
        },
        limits: Limits {
            levels: 3,
            length: [4.0, 1.2, 0.4].into(),
            length_deviation: 0.15,
            max_age: None,
            max_shade: None,
            max_nodes: 2_000_000,
            envelope: None,
            obstacles: Vec::new(),
            ground: false,
        },
        thickness: Thickness { rule: ThicknessRule::Pipe, base: Some(0.06), tip: 0.0015, exponent: 2.3 },
        leaves: Leaves {
            spacing: 0.03,
            max_radius: 0.006,
            angle: 50.0_f64.to_radians(),
            angle_deviation: 10.0_f64.to_radians(),
            size_deviation: 0.12,
            face_up: 0.4,
        },
        blade_width: None,
    }
}

fn leaf() -> OrganSpec {
    let mesh = Mesh {
        points: vec![Vec3::ZERO, Vec3::new(0.02, 0.03, 0.0), Vec3::new(0.0, 0.06, 0.0)],
        triangles: vec![[0, 1, 2]],
        ..Mesh::default()
    };
    OrganSpec { name: "leaf".into(), meshes: vec![Arc::new(mesh)], size: 0.06, petiole: 0.02 }
}

fn materials() -> ShapeMaterials {
    let names = vec!["bark".into(), "shoot".into()];
    ShapeMaterials { names, bark: 0, shoot: 1, shoot_radius: 0.008, source: "test".into() }
}

fn grown(params: &ShapeParams, seed: u64) -> Plant {
    grow(params, (7, seed), Some(&leaf()), &materials()).expect("a plant").0
}

fn axes(params: &ShapeParams, seed: u64) -> GrownShapes {
    grow_axes(params, spawn::roots(params, (7, seed)), (7, seed))
}

/// Steps a particle for the growth time `t` without moving it.
fn turned(particle: &mut Particle, rates: &StepRates, t: f64, steps: u32, draws: &mut Rng) {
    for _ in 0..steps {
        particle.turn(rates, &Influence::default(), t / f64::from(steps), draws);
    }
}

fn rates() -> StepRates {
    StepRates {
        speed: 1.0,
        spread: 0.0,
        wander: 0.0,
        twist: 0.0,
        coil: 0.0,
        gravity: 0.0,
        up: 0.0,
        step_length: 0.05,
        length: 8.0,
        paper_spread: 0.1,
    }
}

#[test]
fn a_wandering_direction_forgets_its_start_at_the_same_rate_for_any_step() {
    // Diffusion on the sphere: mean d(0) . d(T) = exp(-wander^2 T) = exp(-0.72) = 0.4868.
    let rates = StepRates { wander: 0.3, ..rates() };
    for steps in [160, 40] {
        let cosines = (0..4000_u64).map(|i| {
            let mut draws = Rng::at(3, &[i.into()]);
            let mut p = Particle::new(DVec3::ZERO, DVec3::Y, DVec3::Y, &rates, Variant::Corrected);
            turned(&mut p, &rates, 8.0, steps, &mut draws);
            p.d.y
        });
        let mean = cosines.sum::<f64>() / 4000.0;
        assert!((mean - 0.4868).abs() < 0.02, "{steps} steps: {mean}");
    }
}

#[test]
fn velocity_follows_its_direction_exponentially_and_falls_to_its_limit() {
    let mut draws = Rng::at(1, &[]);
    // The part of v perpendicular to d decays as exp(-spread t), whatever the step.
    let rates_of_spread = StepRates { spread: 3.0, ..rates() };
    for steps in [1, 7, 100] {
        let mut p = Particle::new(DVec3::ZERO, DVec3::Y, DVec3::X, &rates_of_spread, Variant::Corrected);
        turned(&mut p, &rates_of_spread, 0.8, steps, &mut draws);
        assert!((p.v.x - exp(-2.4)).abs() < 1e-4 && (p.v.y - (1.0 - exp(-2.4))).abs() < 1e-4, "{steps}: {}", p.v);
    }
    // At the full length v tends to speed d - (gravity / spread) Y.
    let falling = StepRates { spread: 3.0, gravity: 0.6, ..rates() };
    let mut p = Particle::new(DVec3::ZERO, DVec3::X, DVec3::X, &falling, Variant::Corrected);
    p.s = falling.length;
    turned(&mut p, &falling, 20.0, 50, &mut draws);
    assert!(p.v.distance(DVec3::new(1.0, -0.2, 0.0)) < 1e-9, "{}", p.v);
}

#[test]
fn a_coiling_axis_winds_with_the_radius_of_its_formula() {
    // Steady state, twist 0: v lags behind d, which turns at the rate coil; its part across the home direction has the size
    // speed sin(angle) spread / sqrt(spread^2 + coil^2), so that the radius of the helix is that over coil.
    let mut p = params();
    p.limits.levels = 1;
    p.limits.length = [40.0].into();
    p.limits.length_deviation = 0.0;
    p.motion.speed = [1.0].into();
    p.motion.spread = [2.0].into();
    p.motion.wander = [0.0].into();
    p.motion.coil = [4.0].into();
    let grown = axes(&p, 1);
    let nodes: Vec<&super::axis::ShapeNode> = grown.axes[0].nodes.iter().filter(|n| n.s > 20.0).collect();
    let radius_of = |wanted: f64| {
        // The helix is upright: its axis passes through the mean of whole turns.
        let period = TAU / 4.0;
        let first = nodes[0].time;
        let turns = ((nodes[nodes.len() - 1].time - first) / period).floor();
        let whole: Vec<_> = nodes.iter().filter(|n| n.time < first + turns * period).collect();
        let middle = whole.iter().map(|n| n.p).sum::<DVec3>() / whole.len() as f64;
        let r = whole.iter().map(|n| DVec3::new(n.p.x - middle.x, 0.0, n.p.z - middle.z).length()).sum::<f64>();
        (r / whole.len() as f64) / wanted
    };
    let wanted = sin(25.0_f64.to_radians()) / 4.0 * sqrt(4.0 / (4.0 + 16.0));
    assert!((wanted - 0.04725).abs() < 1e-5);
    assert!((radius_of(wanted) - 1.0).abs() < 0.01, "{}", radius_of(wanted));
}

#[test]
fn printed_equations_step_as_by_hand() {
    let rates = StepRates { wander: 0.4, twist: 0.3, ..rates() };
    let mut draws = Rng::at(9, &[]);
    let mut p = Particle::new(DVec3::ZERO, DVec3::Y, DVec3::new(0.6, 0.8, 0.0), &rates, Variant::Paper);
    // The same ten steps by hand: a quaternion rotation about the old direction written out as a matrix.
    let mut by_hand = Rng::at(9, &[]);
    let (mut d, mut v, mut x) = (DVec3::Y, DVec3::new(0.6, 0.8, 0.0), DVec3::ZERO);
    for _ in 0..10 {
        assert!(!p.turn_as_printed(&rates, &mut draws));
        p.move_to(p.p + p.v * PAPER_STEP, PAPER_STEP, 0.0);
        let old = d;
        let rand = DVec3::new(by_hand.range(-1.0, 1.0), by_hand.range(-1.0, 1.0), by_hand.range(-1.0, 1.0));
        d += rand * 0.4 * 0.05;
        let u = v + 0.1 * (d - v);
        let (k, c, s) = (old / old.length(), cos(0.3), sin(0.3));
        let one = 1.0 - c;
        v = DVec3::new(
            (c + k.x * k.x * one) * u.x + (k.x * k.y * one - k.z * s) * u.y + (k.x * k.z * one + k.y * s) * u.z,
            (k.y * k.x * one + k.z * s) * u.x + (c + k.y * k.y * one) * u.y + (k.y * k.z * one - k.x * s) * u.z,
            (k.z * k.x * one - k.y * s) * u.x + (k.z * k.y * one + k.x * s) * u.y + (c + k.z * k.z * one) * u.z,
        );
        x += v * 0.05;
    }
    assert!(p.d.distance(d) < 1e-6 && p.v.distance(v) < 1e-6 && p.p.distance(x) < 1e-6);
}

#[test]
fn a_printed_velocity_without_bound_is_cut_and_counted() {
    let mut p = params();
    p.variant = Variant::Paper;
    p.motion.wander = [3.0].into();
    p.motion.paper_spread = 1.0;
    p.limits.levels = 1;
    p.limits.length = [100.0].into();
    p.motion.speed = [0.02].into();
    let (plant, warnings) = grow(&p, (1, 1), None, &materials()).expect("grows");
    assert!(plant.nodes.len() > 10 && warnings.iter().any(|w| w.message.contains("was cut to 4 times")));
}

#[test]
fn sites_and_buds_have_the_distributions_asked_for() {
    // One long straight axis: 1e5 sites in all over 20 axes.
    let mut p = params();
    p.limits.levels = 2;
    p.limits.length = [100.0, 0.5].into();
    p.limits.length_deviation = 0.0;
    p.limits.max_nodes = 20_000_000;
    p.motion.wander = [0.0].into();
    p.spawning.spacing = [0.02].into();
    p.spawning.base = [0.0].into();
    p.spawning.azimuth_deviation = 8.0_f64.to_radians();
    p.roots.count = 20;
    p.roots.radius = 5.0;
    let roots: Vec<ShapeAxis> = {
        let mut only = p.clone();
        only.limits.levels = 1;
        axes(&only, 4).axes
    };
    let mut gaps: Vec<f64> = roots.iter().flat_map(|a| a.sites.windows(2).map(|w| w[1] - w[0])).collect();
    assert!(gaps.len() > 90_000, "{}", gaps.len());
    gaps.sort_by(f64::total_cmp);
    let median = gaps[gaps.len() / 2];
    assert!((median / 0.02 - 1.0).abs() < 0.02, "{median}");
    assert!(gaps[0] >= 0.3 * 0.02 - 1e-12 && gaps[gaps.len() - 1] <= 3.0 * 0.02 + 1e-9);
    // Dormancy: Pearson's statistic of two bins, 10.8 is the 0.999 quantile for one degree of freedom.
    let starts: Vec<Vec<spawn::AxisStart>> =
        roots.iter().enumerate().map(|(i, a)| spawn::children(&p, a, i, 4)).collect();
    let buds: f64 = roots.iter().map(|a| a.sites.len() as f64).sum();
    let woken: f64 = starts.iter().map(|s| s.len() as f64).sum();
    let (dormant, expected) = (buds - woken, 0.15 * buds);
    let chi = (dormant - expected) * (dormant - expected) / expected * (1.0 + 0.15 / 0.85);
    assert!(chi < 10.8, "{dormant} of {buds}");
    // Azimuths advance by the golden angle from bud to bud.
    let azimuth = |axis: &ShapeAxis, start: &spawn::AxisStart| {
        let at = axis.at(start.parent_s);
        let z = at.reference.cross(at.tangent);
        osier_base::math::atan2(start.direction.dot(z), start.direction.dot(at.reference))
    };
    let mut steps = Vec::new();
    for (axis, starts) in roots.iter().zip(&starts) {
        for pair in starts.windows(2).filter(|w| w[1].ordinal == w[0].ordinal + 1) {
            let step = azimuth(axis, &pair[1]) - azimuth(axis, &pair[0]);
            steps.push(step.rem_euclid(TAU));
        }
    }
    let mean = steps.iter().sum::<f64>() / steps.len() as f64;
    assert!((mean.to_degrees() - 137.51).abs() < 0.3, "{}", mean.to_degrees());
}

#[test]
fn branches_leave_at_the_angle_asked_for() {
    for degrees in [10.0_f64, 90.0, 170.0] {
        let mut p = params();
        p.spawning.angle = [degrees.to_radians()].into();
        p.spawning.angle_deviation = 0.0;
        let trunk = axes(&p, 4).axes.swap_remove(0);
        let children = spawn::children(&p, &trunk, 0, 4);
        assert!(children.len() > 5);
        for child in children {
            let cosine = child.direction.dot(trunk.at(child.parent_s).tangent);
            assert!((cosine - osier_base::math::cos(degrees.to_radians())).abs() < 1e-9, "{degrees} {cosine}");
        }
    }
}

#[test]
fn halving_the_step_changes_height_spread_and_counts_by_less_than_three_percent() {
    let measure = |step: f64| {
        let mut sums = [0.0; 4];
        for seed in 0..64 {
            let mut p = params();
            p.step = step;
            p.motion.gravity = [0.05, 0.1, 0.2].into();
            p.motion.up = [0.1].into();
            p.motion.twist = [0.3, 0.2, 0.0].into();
            let plant = grown(&p, seed);
            let low = plant.nodes.p.iter().copied().fold(Vec3::INFINITY, Vec3::min);
            let high = plant.nodes.p.iter().copied().fold(Vec3::NEG_INFINITY, Vec3::max);
            sums[0] += f64::from(high.y);
            sums[1] += f64::from(high.x - low.x + high.z - low.z);
            sums[2] += plant.axes.len() as f64;
            sums[3] += plant.organs.len() as f64;
        }
        sums
    };
    let (whole, half) = (measure(1.0), measure(0.5));
    for (name, (a, b)) in ["height", "spread", "axes", "leaves"].iter().zip(whole.iter().zip(&half)) {
        assert!((a / b - 1.0).abs() < 0.03, "{name}: {a} against {b}");
    }
}

#[test]
fn threads_change_nothing_and_a_change_of_one_level_leaves_those_below_it_alone() {
    let plant = |p: &ShapeParams| {
        let plant = grown(p, 11);
        (plant.nodes.p.clone(), plant.nodes.r.clone(), plant.organs.iter().map(|o| (o.id, o.q)).collect::<Vec<_>>())
    };
    let mut shaded = params();
    shaded.motion.light = [0.0, 0.5].into();
    shaded.limits.envelope = Some(Region::Sphere { center: DVec3::Y * 2.5, radius: 2.5 });
    shaded.motion.attract = [0.3].into();
    for p in [params(), shaded] {
        let one = on_threads(1, || plant(&p));
        assert_eq!(one, on_threads(2, || plant(&p)));
        assert_eq!(one, on_threads(5, || plant(&p)));
    }
    // Another wander of twigs moves neither trunk nor boughs, and all ids stay.
    let mut other = params();
    other.motion.wander = [0.05, 0.15, 0.6].into();
    let (a, b) = (axes(&params(), 11), axes(&other, 11));
    let thick =
        |g: &GrownShapes| g.axes.iter().filter(|x| x.level < 2).map(|x| (x.id, x.nodes[5].p)).collect::<Vec<_>>();
    assert_eq!(thick(&a), thick(&b));
    assert_eq!(a.axes.iter().map(|x| x.id).collect::<Vec<_>>(), b.axes.iter().map(|x| x.id).collect::<Vec<_>>());
}

#[test]
fn pipe_radii_start_and_end_as_asked_and_never_grow_upwards() {
    let plant = grown(&params(), 5);
    let trunk = plant.nodes_of(&plant.axes[0]);
    assert!((plant.nodes.r[trunk.start] - 0.06).abs() < 1e-6);
    for axis in &plant.axes {
        let r = &plant.nodes.r[plant.nodes_of(axis)];
        assert!(r.windows(2).all(|w| w[1] <= w[0] * 1.000_001));
        assert!(r[r.len() - 1] >= 0.0015 * 0.99);
    }
}

#[test]
fn cones_draw_their_ratios_with_their_weights() {
    let mut p = params();
    p.limits.levels = 1;
    p.limits.length = [60.0].into();
    p.limits.length_deviation = 0.0;
    p.spawning.spacing = [2.0].into();
    p.spawning.base = [0.0].into();
    p.spawning.spacing_sigma = 0.0;
    p.thickness.base = Some(1e3);
    p.thickness.tip = 1e-5;
    let ratios = [(0.78, 0.25), (0.84, 0.5), (0.9, 0.25)];
    p.thickness.rule = ThicknessRule::Cone(ratios.iter().map(|r| WeightedRatio { ratio: r.0, weight: r.1 }).collect());
    p.roots.count = 400;
    p.roots.radius = 20.0;
    let shapes = axes(&p, 3);
    let plant = grow(&p, (7, 3), None, &materials()).expect("grows").0;
    let mut counts = [0.0_f64; 3];
    for (axis, shape) in plant.axes.iter().zip(&shapes.axes) {
        assert_eq!(axis.id, shape.id);
        // Radii are linear between sites: read the ratio of each whole internode from the frames at its ends.
        for ends in shape.sites.windows(2) {
            let ds = 0.1;
            let at = |s: f64| f64::from(plant.frame(axis, osier_base::math::narrow(s)).r);
            // Extrapolate to the ends from two points inside the internode.
            let (a, b) = (at(ends[0] + ds), at(ends[1] - ds));
            let slope = (b - a) / (ends[1] - ends[0] - 2.0 * ds);
            let ratio = (b + slope * ds) / (a - slope * ds);
            let (i, gap) = ratios
                .iter()
                .enumerate()
                .map(|(i, r)| (i, (r.0 - ratio).abs()))
                .min_by(|x, y| x.1.total_cmp(&y.1))
                .expect("ratios");
            assert!(gap < 0.005, "{ratio}");
            counts[i] += 1.0;
        }
    }
    let n: f64 = counts.iter().sum();
    let chi: f64 = counts.iter().zip(&ratios).map(|(c, r)| (c - n * r.1) * (c - n * r.1) / (n * r.1)).sum();
    assert!(n > 5000.0 && chi < 13.8, "two degrees of freedom: {counts:?}");
}

#[test]
fn frames_are_carried_without_torsion() {
    // Around a closed square of tangents, the holonomy is the solid angle that the tangents enclose: an eighth of the sphere.
    let path = [DVec3::X, DVec3::Y, DVec3::Z, DVec3::X];
    let start = DVec3::Y;
    let end = path.windows(2).fold(start, |r, w| carried(r, w[0], w[1]));
    assert!((end.dot(start)).abs() < 1e-12, "a quarter turn, {end}");
    assert!((rotated(DVec3::X, DVec3::Y, PI / 2.0) + DVec3::Z).length() < 1e-12);
    let plant = grown(&params(), 2);
    for axis in &plant.axes {
        for k in plant.nodes_of(axis).skip(1) {
            let t = plant.nodes.q[k] * Vec3::Y;
            let along = (plant.nodes.p[k] - plant.nodes.p[k - 1]).normalize();
            assert!(t.dot(along) > 0.999, "the frame follows the step that led to the node");
        }
    }
}

#[test]
fn a_level_beyond_the_limit_is_left_out_whole_and_told() {
    let mut p = params();
    p.limits.levels = 8;
    p.spawning.spacing = [0.002].into();
    let (plant, warnings) = grow(&p, (1, 1), None, &materials()).expect("a smaller plant");
    assert!(plant.nodes.len() as u64 <= p.limits.max_nodes);
    assert_eq!(warnings.len(), 1);
    assert!(warnings[0].message.contains("level 2 was not grown"), "{}", warnings[0].message);
}

#[test]
fn degenerate_parameters_give_plants_or_errors_but_no_nan() {
    for edit in 0..8 {
        let mut p = params();
        match edit {
            0 => p.thickness.base = Some(p.thickness.tip),
            1 => p.limits.length = [0.005].into(),
            2 => p.motion.spread = [0.0].into(),
            3 => p.motion.gravity = [5.0].into(),
            4 => p.limits.max_age = Some(0.0),
            5 => p.spawning.dormancy = 1.0,
            6 => {
                p.limits.ground = true;
                p.roots.tilt = [3.0, 3.0];
            }
            _ => {
                p.motion.speed = [0.01].into();
                p.motion.gravity = [-5.0].into();
            }
        }
        match grow(&p, (1, 2), Some(&leaf()), &materials()) {
            Ok((mut plant, _)) => assert!(validate(&mut plant).is_ok(), "{edit}"),
            Err(e) => assert!(edit == 4 || edit == 6, "{edit}: {e}"),
        }
    }
    let mut p = params();
    p.motion.speed = [f64::NAN].into();
    assert!(grow(&p, (1, 1), None, &materials()).is_err());
}

#[test]
fn blades_taper_to_their_tip_and_have_no_leaves() {
    let mut p = params();
    p.limits.levels = 1;
    p.limits.length = [0.45].into();
    p.roots = Roots { count: 50, radius: 0.2, tilt: [0.1, 0.4], outward: 0.0 };
    p.blade_width = Some(0.004);
    p.leaves.spacing = 0.0;
    let plant = grown(&p, 1);
    assert!(plant.axes.len() == 50 && plant.organs.is_empty());
    for axis in &plant.axes {
        assert_eq!(axis.kind, AxisKind::Blade);
        let r = &plant.nodes.r[plant.nodes_of(axis)];
        assert!((r[0] - 0.002).abs() < 1e-6 && r[r.len() - 1] < 2e-4);
    }
}

#[test]
fn signed_distances_are_those_of_the_shapes() {
    let at = DVec3::new;
    let cone = Region::Cone { base: DVec3::ZERO, radius: 1.0, height: 2.0 };
    let rows = [
        (Region::Sphere { center: at(1.0, 0.0, 0.0), radius: 0.5 }, at(3.0, 0.0, 0.0), 1.5),
        (Region::Box { center: DVec3::ZERO, half: at(1.0, 2.0, 3.0) }, at(4.0, 6.0, 0.0), 5.0),
        (Region::Box { center: DVec3::ZERO, half: at(1.0, 2.0, 3.0) }, at(0.5, 0.0, 0.0), -0.5),
        (Region::Capsule { from: DVec3::ZERO, to: at(0.0, 2.0, 0.0), radius: 0.1 }, at(0.0, 3.0, 0.0), 0.9),
        (Region::HalfSpace { point: at(0.0, 1.0, 0.0), normal: DVec3::Y }, at(5.0, 3.0, 1.0), 2.0),
        (cone.clone(), at(0.0, 3.0, 0.0), 1.0),
        (cone.clone(), at(0.0, -1.0, 0.0), 1.0),
        (cone.clone(), at(2.0, 0.0, 0.0), 1.0),
        (cone, at(0.0, 1.0, 0.0), -1.0 / sqrt(5.0)),
        (Region::Ellipsoid { center: DVec3::ZERO, radii: at(1.0, 2.0, 3.0) }, at(0.0, 2.0, 0.0), 0.0),
    ];
    for (region, p, wanted) in rows {
        assert!((region.distance(p) - wanted).abs() < 1e-9, "{region:?} at {p}: {}", region.distance(p));
        let near = region.clearance(p + DVec3::new(1e-3, 2e-3, 3e-3));
        assert!((near.normal.length() - 1.0).abs() < 1e-6);
    }
    let wall = Solid {
        name: "wall".into(),
        form: Form::Prism(Prism::block(Vec3::ZERO, Vec3::new(0.4, 3.0, 6.0), 0.0)),
        humidity: 0.0,
    };
    let transform = Trs { t: Vec3::new(2.0, 0.0, 0.0), ..Trs::IDENTITY };
    let region = Region::Solid { solid: Box::new(wall), world_from_plant: transform };
    let near = region.clearance(at(-1.0, 1.0, 0.0));
    assert!((near.distance - 0.8).abs() < 1e-6 && near.normal.distance(DVec3::X) < 1e-6, "{near:?}");
    let (low, high) = region.bounds().expect("a box");
    assert!(low.distance(at(-2.2, 0.0, -3.0)) < 1e-5 && high.distance(at(-1.8, 3.0, 3.0)) < 1e-5);
}

#[test]
fn axes_slide_along_solids_and_end_at_the_envelope() {
    // A wall across the way of every bough: nothing enters it, and some axes come as near as they may.
    let mut p = params();
    p.thickness.base = Some(0.02);
    p.motion.avoid = [0.0].into();
    let wall = Region::Box { center: DVec3::new(0.5, 2.0, 0.0), half: DVec3::new(0.1, 3.0, 5.0) };
    p.limits.obstacles = vec![wall.clone()];
    let plant = grown(&p, 3);
    let nearest = plant.nodes.p.iter().map(|n| wall.distance(n.as_dvec3())).fold(f64::INFINITY, f64::min);
    assert!((-1e-6..0.02).contains(&nearest), "{nearest}");
    // Avoidance keeps the crown farther away on the whole.
    let mean_distance = |avoid: f64| {
        let mut q = p.clone();
        q.motion.avoid = [avoid].into();
        let plant = grown(&q, 3);
        plant.nodes.p.iter().map(|n| wall.distance(n.as_dvec3())).sum::<f64>() / plant.nodes.len() as f64
    };
    assert!(mean_distance(3.0) > 1.05 * mean_distance(0.0));
    let mut cut = params();
    let ball = Region::Sphere { center: DVec3::Y * 1.5, radius: 1.6 };
    cut.limits.envelope = Some(ball.clone());
    let plant = grown(&cut, 3);
    assert!(plant.nodes.p.iter().all(|n| ball.distance(n.as_dvec3()) < 1e-5));
    assert!(plant.axes.iter().filter(|a| a.end == AxisEnd::Cut).count() > 3);
    // An envelope that does not contain the plant cuts nothing, which is reported.
    let told = |p: &ShapeParams| grow(p, (7, 3), None, &materials()).expect("grows").1;
    assert!(told(&cut).is_empty());
    cut.limits.envelope = Some(Region::Sphere { center: DVec3::X * 50.0, radius: 1.0 });
    let beside = told(&cut);
    assert!(beside.len() == 1 && beside[0].code == "S007" && beside[0].message.contains("envelope"), "{beside:?}");
}

#[test]
fn roots_that_are_too_short_to_leave_a_solid_do_not_grow() {
    let inside = |half: f64| {
        let mut p = params();
        p.limits.obstacles = vec![Region::Box { center: DVec3::ZERO, half: DVec3::splat(half) }];
        grow(&p, (7, 3), None, &materials())
    };
    // The trunk is 4 m long: it leaves a solid of 0.5 m around its root, not one of 8 m.
    assert!(inside(0.5).is_ok());
    let refused = inside(8.0).expect_err("nothing grows").to_string();
    assert!(refused.contains("no axis had room to grow"), "{refused}");
}

#[test]
fn shade_does_not_depend_on_the_order_of_nodes_and_leads_out() {
    let nodes: Vec<DVec3> = (0..500_u64)
        .map(|i| {
            let mut r = Rng::at(1, &[i.into()]);
            DVec3::new(r.range(-1.0, 1.0), r.range(2.0, 3.0), r.range(-1.0, 1.0))
        })
        .collect();
    let (mut a, mut b) = (ShadeGrid::new(8.0), ShadeGrid::new(8.0));
    a.add(nodes.iter().copied());
    b.add(nodes[250..].iter().chain(&nodes[..250]).copied());
    for n in &nodes {
        let below = *n - DVec3::Y * 0.3;
        assert!(a.shade(below).to_bits() == b.shade(below).to_bits() && a.shade(below) > 0.0);
    }
    // One node: 0.2 on its own cell, half of that a cell below, nothing above.
    let mut one = ShadeGrid::new(8.0);
    one.add([DVec3::new(0.05, 1.05, 0.05)].into_iter());
    let cell = 0.125;
    assert!((one.shade(DVec3::new(0.05, 1.05, 0.05)) - 0.2).abs() < 1e-5);
    assert!((one.shade(DVec3::new(0.05, 1.05 - cell, 0.05)) - 0.1).abs() < 1e-5);
    assert!(one.shade(DVec3::new(0.05, 1.05 + cell, 0.05)) < 1e-9);
    assert!(a.way_out(DVec3::new(1.2, 2.3, 0.0)).x > 0.0, "at the edge of a canopy the way out is outwards");
}

#[test]
fn an_axis_below_a_canopy_turns_out_of_its_shade() {
    // A roof of level axes over x < 0 at 1.4 m, and an axis that rises towards it near its edge.
    let start = |i: u64, p: DVec3, direction: DVec3| spawn::AxisStart {
        id: i,
        parent: super::axis::ROOT,
        parent_s: 0.0,
        ordinal: i,
        level: 1,
        forks: 0,
        fork: osier_scene::plant::NONE,
        length: 1.0,
        p,
        direction,
        heading: direction,
        time: 0.0,
        exposed: 0.0,
    };
    let tip_of = |light: f64| {
        let mut p = params();
        p.limits.levels = 2;
        p.motion.wander = [0.0].into();
        p.motion.light = [light].into();
        let roof = (0..40_u64).map(|i| start(i, DVec3::new(0.0, 1.4, (i as f64 - 20.0) * 0.03), -DVec3::X));
        let mut starts: Vec<_> = roof.collect();
        starts.push(start(99, DVec3::new(-0.1, 0.6, 0.0), DVec3::Y));
        let grown = grow_axes(&p, starts, (7, 1));
        grown.axes.iter().find(|a| a.id == 99).and_then(|a| a.nodes.last()).expect("an axis").p
    };
    let [straight, turned] = [0.0, 2.0].map(tip_of);
    assert!(straight.x.abs() < 0.11 && turned.x - straight.x > 0.08, "{straight} {turned}");
    let mut dark = params();
    dark.limits.max_shade = Some(0.35);
    let (all, fewer) = (grown(&params(), 6), grown(&dark, 6));
    assert!(fewer.nodes.len() < all.nodes.len() && fewer.axes.iter().any(|a| a.end == AxisEnd::Shade));
}

#[test]
fn the_crown_guide_draws_a_crown_into_its_envelope() {
    let share_inside = |attract: f64| {
        let mut p = params();
        // A ball beside the trunk: without the guide most of the crown grows elsewhere.
        let ball = Region::Sphere { center: DVec3::new(1.4, 3.0, 0.0), radius: 1.2 };
        p.limits.envelope = Some(ball.clone());
        p.motion.attract = [0.0, attract].into();
        let plant = grown(&p, 4);
        plant.nodes.p.iter().filter(|n| ball.distance(n.as_dvec3()) <= 1e-5).count()
    };
    assert!(share_inside(4.0) > 2 * share_inside(0.0), "{} {}", share_inside(4.0), share_inside(0.0));
}

#[test]
fn forks_share_a_number_and_lost_apices_end_at_their_last_child() {
    let mut p = params();
    p.spawning.split = [1.0, 0.0].into();
    let plant = grown(&p, 8);
    let forked: Vec<_> = plant.axes.iter().filter(|a| a.fork != osier_scene::plant::NONE).collect();
    assert!(forked.len() >= 2 && forked.len() % 2 == 0);
    // At most four forks in a lineage: two halves each time, 2 + 4 + 8 + 16.
    assert!(forked.len() <= 30 && forked.iter().all(|a| a.order == 0));
    let mut dead = params();
    dead.spawning.apex_death = [1.0].into();
    let (dead, alive) = (axes(&dead, 8), axes(&params(), 8));
    for axis in dead.axes.iter().filter(|a| a.level < 2 && a.sites.len() > 1) {
        let last = axis.sites.last().copied().unwrap_or_default();
        assert!((axis.grown_length() - last).abs() < 1e-9);
    }
    // Twigs bear no axes that could continue them: they keep their length, that of the same twigs with living apices.
    let lengths: std::collections::BTreeMap<u64, f64> =
        alive.axes.iter().filter(|a| a.level == 2).map(|a| (a.id, a.grown_length())).collect();
    let both = dead.axes.iter().filter_map(|a| lengths.get(&a.id).map(|length| (a.grown_length(), *length)));
    let both: Vec<(f64, f64)> = both.collect();
    assert!(both.len() > 20 && both.iter().all(|(a, b)| (a - b).abs() < 1e-9));
}

#[test]
fn filling_adds_twigs_and_leaves_and_keeps_what_was_there() {
    let before = bare_plant();
    let mut twigs = params();
    twigs.limits.levels = 2;
    twigs.spawning.spacing = [0.08].into();
    twigs.limits.length = [1.0, 0.2].into();
    let filled = |threads: usize| {
        on_threads(threads, || {
            let mut plant = before.clone();
            fill(&mut plant, &twigs, Some(&leaf()), &materials()).expect("fills");
            plant
        })
    };
    let plant = filled(1);
    assert_eq!(plant.nodes.p, filled(3).nodes.p);
    assert!(plant.axes.len() > 2 * before.axes.len() && plant.organs.len() > plant.axes.len());
    // The old axes are all there, in their order and place.
    let ids: Vec<u64> = before.axes.iter().map(|a| a.id).collect();
    let kept: Vec<&osier_scene::plant::Axis> = plant.axes.iter().filter(|a| ids.contains(&a.id)).collect();
    assert_eq!(kept.iter().map(|a| a.id).collect::<Vec<_>>(), ids);
    for (old, new) in before.axes.iter().zip(&kept) {
        assert_eq!(before.nodes.p[before.nodes_of(old)], plant.nodes.p[plant.nodes_of(new)]);
    }
    // Twigs hang on axes that bore nothing before.
    for twig in plant.axes.iter().filter(|a| !ids.contains(&a.id) && a.order == 2) {
        let parent = &plant.axes[twig.parent as usize];
        assert!(
            ids.contains(&parent.id) && before.axes.iter().all(|a| a.parent as usize != index_of(&before, parent.id))
        );
    }
    let mut again = plant;
    assert!(validate(&mut again).expect("valid").is_empty());
}

#[test]
fn twigs_above_forks_shade_each_other_too() {
    let mut p = params();
    p.limits.levels = 2;
    p.limits.length = [3.0, 0.6].into();
    p.motion.up = [0.5, 0.0].into();
    p.spawning.split = [1.0, 0.0].into();
    p.spawning.split_angle = 20.0_f64.to_radians();
    p.spawning.spacing = [0.06].into();
    // Nodes above the length of a stem and of a twig, where only forks lead.
    let high = |p: &ShapeParams| {
        let all = axes(p, 8).axes;
        all.iter().flat_map(|axis| &axis.nodes).filter(|node| node.p.y > 4.5).count()
    };
    let free = high(&p);
    p.limits.max_shade = Some(0.5);
    let shaded = high(&p);
    assert!(free > 1000 && shaded * 10 < free * 9, "{shaded} of {free} nodes");
}

#[test]
fn twigs_of_a_plant_that_hangs_begin_on_its_wood() {
    let mut stem = params();
    stem.limits = Limits { levels: 1, length: [2.0].into(), ground: false, ..stem.limits };
    stem.roots.tilt = [3.0, 3.05];
    stem.leaves.spacing = 0.0;
    let mut plant = grown(&stem, 5);
    let stems = plant.axes.len();
    let mut twigs = params();
    twigs.limits = Limits { levels: 2, length: [1.0, 0.3].into(), ground: true, ..twigs.limits };
    fill(&mut plant, &twigs, Some(&leaf()), &materials()).expect("fills");
    assert!(plant.axes.len() > stems + 3);
    for axis in plant.axes.iter().filter(|a| a.parent != osier_scene::plant::NONE) {
        let p = &plant.nodes.p[plant.nodes_of(axis)];
        assert!(p[0].y < 0.0 && p[0].distance(p[1]) < 0.1, "a twig jumps from {} to {}", p[0], p[1]);
    }
}

/// A plant of two levels without leaves, to be filled with twigs.
fn bare_plant() -> Plant {
    let mut bare = params();
    bare.limits.levels = 2;
    bare.leaves.spacing = 0.0;
    grow(&bare, (7, 5), None, &materials()).expect("grows").0
}

/// Growth time of the place where an axis is attached.
fn time_of_site(plant: &Plant, axis: &osier_scene::plant::Axis) -> f32 {
    let (i, t) = plant.segment(&plant.axes[axis.parent as usize], axis.parent_s);
    plant.nodes.birth[i] + (plant.nodes.birth[i + 1] - plant.nodes.birth[i]) * t
}

#[test]
fn twigs_of_a_filled_plant_grow_no_earlier_than_the_wood_that_bears_them() {
    let before = bare_plant();
    let mut twigs = params();
    twigs.limits.levels = 2;
    twigs.limits.length = [1.0, 0.2].into();
    let filled = |mut plant: Plant| {
        fill(&mut plant, &twigs, Some(&leaf()), &materials()).expect("fills");
        plant
    };
    let plant = filled(before.clone());
    assert!(plant.axes.len() > before.axes.len());
    for axis in plant.axes.iter().filter(|a| a.parent != osier_scene::plant::NONE) {
        let (site, own) = (time_of_site(&plant, axis), plant.nodes.birth[axis.first as usize]);
        assert!(own > site - 1e-5, "an axis begins at {own} on wood of {site}");
    }
    // The times of all nodes are shares of that of the last.
    let last = plant.nodes.birth.iter().fold(0.0_f32, |m, b| m.max(*b));
    assert!((last - 1.0).abs() < 1e-5, "{last}");
    // A plant without times, as one of a coefficient table, gets none: a clip grows it by path lengths.
    let mut timeless = before;
    timeless.nodes.birth.iter_mut().for_each(|b| *b = 0.0);
    timeless.axes.iter_mut().for_each(|a| a.birth = 0.0);
    let plant = filled(timeless);
    assert!(plant.nodes.birth.iter().chain(plant.organs.iter().map(|o| &o.birth)).all(|b| b.abs() < 1e-9));
}

#[test]
fn twigs_of_a_filled_plant_grow_at_its_pace() {
    let before = bare_plant();
    let mut twigs = params();
    twigs.limits.levels = 2;
    twigs.limits.length = [1.0, 0.2].into();
    let path = before.axes.iter().fold(vec![(0.0, 0.0)], |mut list, axis| {
        let parent = if axis.parent == osier_scene::plant::NONE { 0.0 } else { list[axis.parent as usize + 1].0 };
        let start = parent + axis.parent_s;
        list.push((start, start + axis.length));
        list
    });
    let longest = path.iter().fold(0.0_f32, |m, p| m.max(p.1));
    // Whatever the unit of time of the twigs is.
    for speed in [0.05, 1.0] {
        twigs.motion.speed = [speed].into();
        let mut plant = before.clone();
        fill(&mut plant, &twigs, None, &materials()).expect("fills");
        let (mut length, mut time) = (0.0, 0.0);
        for axis in plant.axes.iter().filter(|a| before.axes.iter().all(|b| b.id != a.id)) {
            let nodes = plant.nodes_of(axis);
            length += axis.length;
            time += plant.nodes.birth[nodes.end - 1] - plant.nodes.birth[nodes.start];
        }
        // The times of the whole plant are shares of that of the last twig.
        let pace = time * longest / length;
        assert!(
            length > 1.0 && (0.6..1.05).contains(&pace),
            "{length} m of twigs grow at {pace} of the pace of the plant"
        );
    }
}

#[test]
fn filling_a_leafy_plant_keeps_its_leaves_and_doubles_none() {
    let mut leafy = params();
    leafy.limits.levels = 2;
    let before = grown(&leafy, 5);
    assert!(!before.organs.is_empty());
    let mut twigs = params();
    twigs.limits.levels = 2;
    twigs.limits.length = [1.0, 0.2].into();
    let mut plant = before.clone();
    fill(&mut plant, &twigs, Some(&leaf()), &materials()).expect("fills");
    let mut ids: Vec<u64> = plant.organs.iter().map(|o| o.id).collect();
    ids.sort_unstable();
    let all = ids.len();
    ids.dedup();
    assert_eq!(ids.len(), all, "leaves with the same id");
    assert!(before.organs.iter().all(|o| ids.binary_search(&o.id).is_ok()));
    // The branches keep the number of their leaves; new ones hang on twigs.
    let on = |plant: &Plant, id: u64| plant.organs.iter().filter(|o| plant.axes[o.axis as usize].id == id).count();
    let branches: Vec<u64> = before.axes.iter().filter(|a| a.order == 1).map(|a| a.id).collect();
    assert!(branches.iter().all(|id| on(&plant, *id) == on(&before, *id)));
    assert!(plant.organs.len() > before.organs.len());
}

#[test]
fn leaves_begin_at_the_surface_of_their_wood() {
    // A thick stem that bears leaves itself, and twigs.
    let mut thick = params();
    thick.limits.levels = 1;
    thick.limits.length = [1.0].into();
    thick.thickness = Thickness { rule: ThicknessRule::Taper, base: Some(0.1), tip: 0.02, exponent: 1.0 };
    // The petiole of `leaf()` is 0.02 m, times the size of the leaf over the 0.06 m of its mesh, here its scale.
    let beyond = |leaf: &osier_scene::plant::Organ| leaf.petiole - 0.02 * leaf.scale;
    let thick = grown(&thick, 3);
    assert!(thick.organs.len() > 15);
    for leaf in &thick.organs {
        // The stem tapers from 0.1 m to 0.02 m.
        let r = 0.1 - 0.08 * leaf.s / thick.axes[0].length;
        assert!((beyond(leaf) - r).abs() < 1e-4, "{} at a radius of {r}", beyond(leaf));
    }
    // No wood is thinner than its tip, 1.5 mm.
    let tree = grown(&params(), 3);
    assert!(tree.organs.len() > 100 && tree.organs.iter().all(|leaf| beyond(leaf) > 0.0014));
}

#[test]
fn twigs_end_in_shade_at_any_height_of_the_plant_that_they_fill() {
    let mut bare = params();
    bare.limits.levels = 1;
    bare.limits.length = [6.0].into();
    bare.leaves.spacing = 0.0;
    let mut plant = grow(&bare, (7, 5), None, &materials()).expect("grows").0;
    let mut twigs = params();
    twigs.limits.levels = 2;
    twigs.limits.length = [1.0, 0.4].into();
    twigs.spawning.crown = CrownShape::Cylindrical;
    // Shade is updated every 8 of about 16 steps, and every node shades its own cell.
    twigs.limits.max_shade = Some(0.0);
    fill(&mut plant, &twigs, Some(&leaf()), &materials()).expect("fills");
    let high: Vec<_> = plant.axes.iter().filter(|a| a.order == 1 && a.parent_s > 3.0).collect();
    assert!(high.len() > 5 && high.iter().all(|a| a.end == AxisEnd::Shade), "{high:?}");
}

#[test]
fn twigs_of_the_last_level_bear_leaves_whatever_their_radius() {
    let mut bare = params();
    bare.limits.levels = 2;
    bare.leaves.spacing = 0.0;
    let mut plant = grow(&bare, (7, 5), None, &materials()).expect("grows").0;
    let old: Vec<u64> = plant.axes.iter().map(|a| a.id).collect();
    let mut twigs = params();
    twigs.limits.levels = 2;
    twigs.limits.length = [1.0, 0.2].into();
    twigs.leaves.max_radius = 0.0;
    fill(&mut plant, &twigs, Some(&leaf()), &materials()).expect("fills");
    assert!(plant.organs.len() > 100);
    assert!(plant.organs.iter().all(|o| !old.contains(&plant.axes[o.axis as usize].id)));
}

fn index_of(plant: &Plant, id: u64) -> usize {
    plant.axes.iter().position(|a| a.id == id).expect("an axis")
}
