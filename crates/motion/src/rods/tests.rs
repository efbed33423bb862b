//! Rods against beams with known answers.

use std::f64::consts::{PI, TAU};

use glam::{DQuat, DVec3};

use super::{
    Actuation, AttachedBody, Integrator, RecordingParams, RodDescription, RodMaterial, RodSystem, SupportKind,
};
use crate::rods::prism::{CornerRigidMotion, SectionFrame, Vector9, corner, corner_dot, corners_from_fn};
use crate::rods::system::subtract_corners;
use osier_base::keyframes::Keyframes;
use osier_base::progress::Cancel;
use osier_base::rng::Rng;

const MATERIAL: RodMaterial = RodMaterial {
    young: 5e9,
    shear: 1.0 / 15.0,
    density: 900.0,
    damping_ratio: 0.0,
    recovery: 0.0,
    spread_for_torsion: false,
};

/// A straight rod of `n` sections along X whose intervals are `slender` radii long.
fn straight_rod(n: usize, slender: f64, radius: f64, material: RodMaterial) -> RodDescription {
    let length = (n - 1) as f64 * slender * radius;
    RodDescription {
        points: vec![DVec3::ZERO, DVec3::X * length],
        radii: vec![radius; 2],
        material,
        sections: Some(n),
        parent: None,
    }
}

/// The same rod, clamped at its base, without weight.
fn cantilever(n: usize, slender: f64, material: RodMaterial) -> RodSystem {
    weightless(RodSystem::new(&[straight_rod(n, slender, 0.01, material)], &[(0, 0.0, SupportKind::Fixed)]))
}

fn weightless(mut rods: RodSystem) -> RodSystem {
    rods.gravity = DVec3::ZERO;
    rods
}

fn bending_rigidity(radius: f64, young: f64) -> f64 {
    young * PI * radius.powi_(4) / 4.0
}

trait IntegerPower {
    fn powi_(self, n: u32) -> f64;
}

impl IntegerPower for f64 {
    fn powi_(self, n: u32) -> f64 {
        (0..n).fold(1.0, |p, _| p * self)
    }
}

/// Fundamental frequency of the spring lattice itself, Hz, by inverse iteration.
fn fundamental_hz_by_inverse_iteration(rods: &mut RodSystem) -> f64 {
    let n = rods.len();
    let mut y: Vec<Vector9> = (0..n).map(|i| corners_from_fn(|_| DVec3::Y * (i as f64 / n as f64))).collect();
    let mut w2 = 0.0;
    for _ in 0..60 {
        rods.prepare_step(0.0);
        rods.step.factors.fill(1.0);
        rods.step.next.copy_from_slice(&rods.x.clone());
        rods.step.speed.fill([0.0; 9]);
        rods.assemble_springs(true);
        for i in 0..n {
            let back = rods.dampings[rods.tree.sections[i].rod].recovery;
            rods.add_section_mass_to_block(i, 0.0, back);
            let right = rods.apply_mass(i, &y[i], false);
            rods.step.rows[i].set_right_hand_side(&right);
        }
        rods.add_clamp_penalties_to_rows();
        assert!(rods.solve_newton_update());
        let next = rods.step.change.clone();
        let of = |a: &[Vector9], b: &[Vector9]| {
            (0..n).fold(0.0, |s, i| s + corner_dot(&a[i], &rods.apply_mass(i, &b[i], false)))
        };
        w2 = of(&next, &y) / of(&next, &next);
        let size = of(&next, &next).sqrt();
        y = next.iter().map(|x| x.map(|v| v / size)).collect();
    }
    w2.sqrt() / TAU
}

#[test]
fn cantilever_matches_euler_bernoulli_deflection_and_frequency() {
    for (n, slender, tolerance) in
        [(9, 2.0, 0.04), (9, 3.0, 0.04), (9, 5.0, 0.04), (9, 10.0, 0.04), (17, 3.0, 0.03), (17, 10.0, 0.03)]
    {
        let mut rods = cantilever(n, slender, MATERIAL);
        let (length, ei) = ((n - 1) as f64 * slender * 0.01, bending_rigidity(0.01, MATERIAL.young));
        let force = 1e-4 * 3.0 * ei / (length * length);
        rods.add_wrench(n - 1, DVec3::Y * force, DVec3::ZERO);
        assert!(rods.solve_equilibrium());
        let deflection = rods.section_frame(n - 1).p.y / (1e-4 * length);
        assert!((0.995..1.0 + tolerance).contains(&deflection), "{n} sections, l/R {slender}: {deflection}");
        let mut rods = cantilever(n, slender, MATERIAL);
        let beam = 3.516 / (TAU * length * length) * (ei / (MATERIAL.density * PI * 1e-4)).sqrt();
        let swing = fundamental_hz_by_inverse_iteration(&mut rods) / beam;
        assert!((1.0 - tolerance..1.005).contains(&swing), "{n} sections, l/R {slender}: {swing} of {beam} Hz");
        assert!((rods.fundamental_hz(0) / beam - 1.0).abs() < 0.03, "Rayleigh's {} of {beam}", rods.fundamental_hz(0));
    }
}

#[test]
fn five_sections_are_slightly_too_soft() {
    let mut rods = cantilever(5, 3.0, MATERIAL);
    let (length, ei) = (0.12, bending_rigidity(0.01, MATERIAL.young));
    rods.add_wrench(4, DVec3::Z * (1e-4 * 3.0 * ei / (length * length)), DVec3::ZERO);
    assert!(rods.solve_equilibrium());
    let deflection = rods.section_frame(4).p.z / (1e-4 * length);
    assert!((1.03..1.09).contains(&deflection), "{deflection}");
}

#[test]
fn torsion_matches_the_shear_modulus() {
    let (n, slender) = (9, 2.0);
    let mut rods = cantilever(n, slender, MATERIAL);
    let length = 0.16;
    let gj = MATERIAL.young * MATERIAL.shear * PI * 1e-8 / 2.0;
    let torque = 1e-3 * gj / length;
    rods.add_wrench(n - 1, DVec3::ZERO, DVec3::X * torque);
    assert!(rods.solve_equilibrium());
    let (was, is) = (rods.section_frame(0).u, rods.section_frame(n - 1).u);
    let angle = was.cross(is).dot(DVec3::X);
    assert!((angle / 1e-3 - 1.0).abs() < 0.01, "{angle}");
    assert!((rods.torsional_softening_ratio(0) - 1.0).abs() < 1e-12);
    assert!((cantilever(9, 10.0, MATERIAL).torsional_softening_ratio(0) - 8.889).abs() < 1e-3);
}

#[test]
fn restoring_springs_raise_the_frequency() {
    let bare = fundamental_hz_by_inverse_iteration(&mut cantilever(9, 3.0, MATERIAL));
    let drawn =
        fundamental_hz_by_inverse_iteration(&mut cantilever(9, 3.0, RodMaterial { recovery: 0.25, ..MATERIAL }));
    assert!((drawn / bare / 1.118 - 1.0).abs() < 0.01, "{}", drawn / bare);
}

#[test]
fn moved_clamp_carries_the_rod_rigidly() {
    let mut rods = cantilever(9, 3.0, RodMaterial { recovery: 0.25, ..MATERIAL });
    let (shift, turn) = (DVec3::new(0.3, -0.2, 0.5), DQuat::from_axis_angle(DVec3::new(0.6, 0.0, 0.8), 1.3));
    (rods.clamps[0].shift, rods.clamps[0].turn) = (shift, turn);
    let moved: Vec<Vector9> =
        rods.tree.reference.iter().map(|x| corners_from_fn(|c| shift + turn * corner(x, c))).collect();
    let mut draw = Rng::at(1, &["rigid".into()]);
    rods.x = moved.iter().map(|x| x.map(|v| v + 1e-5 * draw.range(-1.0, 1.0))).collect();
    assert!(rods.solve_equilibrium());
    let worst =
        rods.x.iter().zip(&moved).flat_map(|(a, b)| subtract_corners(a, b)).fold(0.0_f64, |m, d| m.max(d.abs()));
    assert!(worst < 1e-9, "{worst}");
}

/// Highest angular frequency, rad/s, by power iteration on differences of accelerations.
fn max_angular_frequency_by_power_iteration(rods: &mut RodSystem) -> f64 {
    let rest = rods.x.clone();
    let mut draw = Rng::at(5, &["fastest".into()]);
    let mut y: Vec<Vector9> = rest.iter().map(|_| std::array::from_fn(|_| draw.range(-1.0, 1.0))).collect();
    let mut w2 = 0.0;
    for _ in 0..400 {
        y[0] = [0.0; 9];
        let size = y.iter().fold(0.0, |s, v| s + corner_dot(v, v)).sqrt();
        y.iter_mut().flatten().for_each(|v| *v /= size);
        let e = 1e-9;
        for i in 0..rest.len() {
            rods.x[i] = std::array::from_fn(|k| rest[i][k] + e * y[i][k]);
        }
        rods.prepare_step(0.0);
        rods.step.next.copy_from_slice(&rods.x.clone());
        rods.step.speed.fill([0.0; 9]);
        rods.assemble_springs(false);
        y = (0..rest.len()).map(|i| rods.apply_inverse_mass(i, &rods.step.force[i]).map(|a| -a / e)).collect();
        w2 = y[1..].iter().fold(0.0, |s, v| s + corner_dot(v, v)).sqrt();
    }
    rods.x = rest;
    w2.sqrt()
}

fn max_displacement(rods: &RodSystem) -> f64 {
    let away = rods.x.iter().zip(&rods.tree.reference).flat_map(|(a, b)| subtract_corners(a, b));
    away.fold(0.0, |m: f64, d| if d.is_finite() { m.max(d.abs()) } else { f64::INFINITY })
}

/// Sets small random velocities of all corners but those of the base.
fn perturb_velocities(rods: &mut RodSystem) {
    let mut draw = Rng::at(9, &["nudge".into()]);
    for v in rods.v.iter_mut().skip(1) {
        *v = std::array::from_fn(|_| 1e-4 * draw.range(-1.0, 1.0));
    }
}

#[test]
fn explicit_integrators_have_their_stability_limits() {
    let make = || weightless(RodSystem::new(&[straight_rod(9, 3.0, 0.002, MATERIAL)], &[(0, 0.0, SupportKind::Fixed)]));
    let w = max_angular_frequency_by_power_iteration(&mut make());
    let bound = make().max_angular_frequency_bound();
    assert!(bound >= w && w > 0.6 * bound, "{w} within {bound}");
    for (factor, holds) in [(0.98, true), (1.02, false)] {
        let mut rods = make();
        perturb_velocities(&mut rods);
        (0..4000).for_each(|_| rods.step_symplectic_euler(factor * 2.0 / w));
        assert_eq!(max_displacement(&rods) < 1e-6, holds, "symplectic at {factor}: {}", max_displacement(&rods));
    }
    // The amplitude grows by w^2 h^2 - a h per explicit step: without damping at any step length.
    for (damping, factor, holds) in [(0.3, 0.95, true), (0.3, 1.05, false), (0.0, 0.1, false)] {
        let mut rods = make();
        rods.dampings[0].mass = damping * w / 2.0;
        perturb_velocities(&mut rods);
        let h = if damping > 0.0 { factor * damping / w } else { factor / w };
        (0..20_000).for_each(|_| rods.step_forward_euler(h));
        assert_eq!(
            max_displacement(&rods) < 1e-6,
            holds,
            "explicit, {damping} at {factor}: {}",
            max_displacement(&rods)
        );
    }
}

/// A soft rod that is released from a deflection of its tip: 5 MPa, below 2 Hz.
fn rod_released_from_deflection(damping_ratio: f64) -> RodSystem {
    let material = RodMaterial { young: 5e6, damping_ratio, ..MATERIAL };
    let rod = RodDescription {
        points: vec![DVec3::ZERO, DVec3::Y * 0.25],
        radii: vec![0.005; 2],
        material,
        sections: Some(9),
        parent: None,
    };
    let mut rods = weightless(RodSystem::new(&[rod], &[(0, 0.0, SupportKind::Fixed)]));
    let ei = bending_rigidity(0.005, 5e6);
    rods.add_wrench(8, DVec3::X * (0.05 * 3.0 * ei / 0.0625), DVec3::ZERO);
    assert!(rods.solve_equilibrium());
    rods.clear_forces();
    rods
}

#[test]
fn implicit_integrator_is_second_order_and_matches_symplectic_euler() {
    let end = |steps: u32| {
        let mut rods = rod_released_from_deflection(0.05);
        let h = 0.25 / f64::from(steps);
        rods.reset_history();
        (0..steps).for_each(|_| rods.step_implicit(h).expect("steps"));
        rods.section_frame(8).p
    };
    let [a, b, c] = [96, 192, 384].map(end);
    let order = ((a - b).length() / (b - c).length()).log2();
    assert!(order > 1.8, "order {order}");
    // One second of the same motion by both integrators.
    let mut by_springs = rod_released_from_deflection(0.0);
    assert!(by_springs.fundamental_hz(0) < 2.0);
    let h = 0.9 * 2.0 / by_springs.max_angular_frequency_bound();
    let mut by_all = rod_released_from_deflection(0.0);
    by_all.reset_history();
    let (mut t, mut most) = (0.0, 0.0_f64);
    for k in 1..=1536_u32 {
        by_all.step_implicit(1.0 / 1536.0).expect("steps");
        while t < f64::from(k) / 1536.0 {
            by_springs.step_symplectic_euler(h);
            t += h;
        }
        most = most.max((by_all.section_frame(8).p - by_springs.section_frame(8).p).length());
    }
    let amplitude = rod_released_from_deflection(0.0).section_frame(8).p.x;
    assert!(most < 0.02 * amplitude, "{most} of {amplitude}");
}

#[test]
fn implicit_integrator_is_stable_at_long_steps() {
    let mut rods = rod_released_from_deflection(0.05);
    let start = rods.section_frame(8).p.x;
    rods.reset_history();
    for _ in 0..240 {
        rods.step_implicit(1.0 / 24.0).expect("steps");
        assert!(rods.section_frame(8).p.x.abs() < 1.2 * start);
    }
    assert!(rods.section_frame(8).p.x.abs() < 0.1 * start);
}

#[test]
fn energy_decays_at_the_damping_ratio() {
    for damping_ratio in [0.0, 0.05, 0.2] {
        let mut rods = rod_released_from_deflection(damping_ratio);
        let hertz = fundamental_hz_by_inverse_iteration(&mut rods.clone());
        // w h = 0.1.
        let h = 0.1 / (TAU * hertz);
        rods.reset_history();
        let start = rods.elastic_energy();
        let (mut last, mut peaks, mut before) = (start, Vec::new(), [0.0; 2]);
        for _ in 0..260 {
            rods.step_implicit(h).expect("steps");
            let energy = rods.elastic_energy() + rods.kinetic_energy();
            assert!(energy - last < 1e-3 * start, "rises by {} of {start}", energy - last);
            last = energy;
            let x = rods.section_frame(8).p.x;
            if before[1] > before[0] && before[1] > x && x > 0.0 {
                peaks.push(before[1]);
            }
            before = [before[1], x];
        }
        assert!(peaks.len() > 2 && peaks.windows(2).all(|p| p[1] < p[0]), "{peaks:?}");
        let decrement = osier_base::math::ln(peaks[0] / peaks[2]) / (2.0 * TAU);
        let wanted = damping_ratio / (1.0 - damping_ratio * damping_ratio).sqrt() + 0.1_f64.powi_(3) / 5.0;
        assert!((decrement - wanted).abs() < 0.1 * wanted + 0.005, "damping ratio {damping_ratio}: {decrement}");
    }
}

#[test]
fn low_frame_rates_have_no_longer_time_steps() {
    // A rod of less than 2 Hz swings for four seconds: longer steps damp it and slow it down.
    let tip_after_four_seconds = |fps: u32| {
        let clip = RecordingParams {
            frames: 4 * fps + 1,
            first: 1,
            fps: f64::from(fps),
            steps: None,
            integrator: Integrator::Xpbd,
            acts: Vec::new(),
            wind: None,
            ground: &-2.0_f64,
            name: "rod".into(),
        };
        let poses = rod_released_from_deflection(0.01).record_clip(&clip, &Cancel::default()).expect("a clip");
        poses.last().expect("frames").sections[8].0
    };
    let known = tip_after_four_seconds(24);
    for fps in [1, 2, 6, 12] {
        let tip = tip_after_four_seconds(fps);
        assert!((tip - known).length() < 1e-5, "{tip} at {fps} frames per second for {known}");
    }
    let rods = rod_released_from_deflection(0.01);
    assert_eq!([1000.0, 24_000.0 / 1001.0, 0.1].map(|fps| rods.steps_per_frame(fps)), [8, 8, 1920]);
}

/// A curved horizontal twig with the weight of a leaf at its tip.
fn twig() -> RodSystem {
    let rod = RodDescription {
        points: vec![DVec3::ZERO, DVec3::new(0.15, 0.1, 0.0), DVec3::new(0.3, 0.12, 0.1)],
        radii: vec![0.003, 0.0025, 0.002],
        material: RodMaterial { damping_ratio: 0.2, recovery: 0.25, ..MATERIAL },
        sections: Some(9),
        parent: None,
    };
    let body = AttachedBody {
        section: 8,
        at: DVec3::Z * 0.03,
        mass: 0.002,
        inertia: glam::DMat3::ZERO,
        of_plant: true,
        reach: 0.0,
    };
    RodSystem::new(&[rod], &[(0, 0.0, SupportKind::Fixed)]).with_added_bodies(vec![body])
}

#[test]
fn rest_shape_keeps_a_loaded_twig_in_its_reference_pose() {
    let mut loose = twig();
    assert!(loose.solve_equilibrium());
    assert!(max_displacement(&loose) > 1e-3, "without it the twig droops by {}", max_displacement(&loose));
    let mut rods = twig();
    assert!(rods.find_rest_shape_by_equilibrium());
    let h = 1.0 / (24.0 * f64::from(rods.steps_per_frame(24.0)));
    rods.reset_history();
    let mut t = 0.0;
    while t < 2.0 {
        rods.step_implicit(h).expect("steps");
        t += h;
    }
    assert!(max_displacement(&rods) < 1e-4, "{}", max_displacement(&rods));
}

/// Lateral deflection of the middle of a pole, over its length. It is pinned at its foot and guided along its axis at its top,
/// where `share` of Euler's load presses on it.
fn buckled_deflection(share: f64) -> f64 {
    let (length, radius, ei) = (4.6, 0.018, 2000.0);
    let young = 4.0 * ei / (PI * f64::powi_(radius, 4));
    let material = RodMaterial { young, density: 490.0, damping_ratio: 0.5, ..MATERIAL };
    let points = vec![DVec3::ZERO, DVec3::new(0.002, 2.3, 0.0), DVec3::Y * length];
    let rod = RodDescription { points, radii: vec![radius; 3], material, sections: Some(17), parent: None };
    let holds = [(0, 0.0, SupportKind::Pinned), (0, length, SupportKind::Guided(DVec3::Y))];
    let mut rods = weightless(RodSystem::new(&[rod], &holds));
    let load = share * PI * PI * ei / (length * length);
    assert!((load / share - 933.0).abs() < 1.0);
    let h = 1.0 / 240.0;
    rods.reset_history();
    for _ in 0..1200 {
        rods.clear_forces();
        rods.add_wrench(16, DVec3::Y * -load, DVec3::ZERO);
        rods.step_implicit(h).expect("steps");
    }
    let p = rods.section_frame(8).p;
    (p.x * p.x + p.z * p.z).sqrt() / length
}

#[test]
fn pole_buckles_at_eulers_load() {
    let (below, above) = (buckled_deflection(0.9), buckled_deflection(1.1));
    assert!(below < 0.01, "{below}");
    assert!(above > 0.05, "{above}");
}

/// A rod with a side rod, without clamps and without gravity.
fn free_floating_rods() -> RodSystem {
    let parent = straight_rod(6, 4.0, 0.01, MATERIAL);
    let child = RodDescription {
        points: vec![DVec3::X * 0.1, DVec3::new(0.15, 0.2, 0.03)],
        radii: vec![0.004, 0.003],
        parent: Some((0, 0.1)),
        sections: Some(6),
        ..parent.clone()
    };
    let body = AttachedBody {
        section: 10,
        at: DVec3::Z * 0.02,
        mass: 0.01,
        inertia: glam::DMat3::ZERO,
        of_plant: true,
        reach: 0.0,
    };
    weightless(RodSystem::new(&[parent, child], &[])).with_added_bodies(vec![body])
}

/// Momentum, kg m/s, and its moment about the origin.
fn linear_and_angular_momentum(rods: &mut RodSystem) -> (DVec3, DVec3) {
    rods.update_section_masses();
    let (mut sum, mut moment) = (DVec3::ZERO, DVec3::ZERO);
    for i in 0..rods.len() {
        let p = rods.apply_mass(i, &rods.v[i], false);
        for c in 0..3 {
            sum += corner(&p, c);
            moment += corner(&rods.x[i], c).cross(corner(&p, c));
        }
    }
    (sum, moment)
}

/// Inverse effective mass, 1/kg, of a position that is rigid with a section, along the unit vector `n`, if the
/// section had no neighbours.
fn inverse_effective_mass(rods: &mut RodSystem, section: usize, place: DVec3, n: DVec3) -> f64 {
    rods.update_section_masses();
    let rigid = CornerRigidMotion::from_corners(&rods.x[section]);
    let b = rigid.corner_forces(n, (place - rigid.p).cross(n));
    corner_dot(&b, &rods.apply_inverse_mass(section, &b))
}

#[test]
fn impulse_adds_its_momentum_and_attachments_conserve_it() {
    let mut rods = free_floating_rods();
    assert_eq!(rods.len(), 6 + 5, "the base of the side rod rides");
    let (impulse, h) = (DVec3::new(1e-4, -2e-4, 1e-4), 1e-4);
    let place = rods.section_frame(10).p + rods.section_frame(10).matrix() * (DVec3::Z * 0.02);
    let light = inverse_effective_mass(&mut rods, 10, place, impulse.normalize());
    rods.reset_history();
    rods.add_impulse(10, place, impulse, h);
    rods.step_implicit(h).expect("steps");
    rods.clear_forces();
    for _ in 0..2000 {
        rods.step_implicit(h).expect("steps");
    }
    let (sum, moment) = linear_and_angular_momentum(&mut rods);
    assert!((sum - impulse).length() < 3e-3 * impulse.length(), "{sum}");
    let wanted = place.cross(impulse);
    assert!((moment - wanted).length() < 0.02 * wanted.length(), "{moment} {wanted}");
    // At the position of the weight: the weight and a small part of the section, which rotates about it.
    assert!(light > 1.0 / 0.0115 && light < 1.0 / 0.01, "{light}");
}

#[test]
fn two_attached_rods_bend_as_one() {
    let whole = straight_rod(17, 3.0, 0.01, MATERIAL);
    let half = straight_rod(9, 3.0, 0.01, MATERIAL);
    let rest =
        RodDescription { points: vec![DVec3::X * 0.24, DVec3::X * 0.48], parent: Some((0, 0.24)), ..half.clone() };
    let bent = |rods: &[RodDescription]| {
        let mut rods = weightless(RodSystem::new(rods, &[(0, 0.0, SupportKind::Fixed)]));
        assert_eq!(rods.len(), 17);
        rods.add_wrench(16, DVec3::Y * 5.0, DVec3::ZERO);
        assert!(rods.solve_equilibrium());
        rods.section_frame(16).p.y
    };
    let (one, two) = (bent(&[whole]), bent(&[half, rest]));
    assert!((two / one - 1.0).abs() < 0.02, "{two} {one}");
}

#[test]
fn gauss_seidel_passes_let_a_stiff_twig_sag() {
    let rod = RodDescription {
        points: vec![DVec3::ZERO, DVec3::X * 0.4],
        radii: vec![0.003; 2],
        material: RodMaterial { damping_ratio: 0.2, ..MATERIAL },
        sections: Some(16),
        parent: None,
    };
    let mut rods = RodSystem::new(&[rod], &[(0, 0.0, SupportKind::Fixed)]);
    let mut right = rods.clone();
    assert!(right.solve_equilibrium());
    let h = 1.0 / (24.0 * 16.0);
    assert!(rods.max_step_stiffness_ratio(h) > super::MAX_GAUSS_SEIDEL_STIFFNESS);
    (0..768).for_each(|_| rods.step_gauss_seidel(h).expect("steps"));
    let drop = |rods: &RodSystem| -rods.section_frame(15).p.y / 0.4;
    assert!(drop(&rods) > 2.0 * drop(&right) && drop(&right) < 0.01, "{} {}", drop(&rods), drop(&right));
}

#[test]
fn frames_of_a_bent_rod_are_twist_free() {
    let rods = twig();
    for i in 1..rods.len() {
        let (a, b): (SectionFrame, SectionFrame) = (rods.section_frame(i - 1), rods.section_frame(i));
        let carried = a.u - b.w * b.w.dot(a.u);
        assert!(carried.normalize().dot(b.u) > 0.999_99);
    }
}

#[test]
fn rest_shape_keeps_a_forked_twig_with_weights_in_its_reference_pose() {
    let material = RodMaterial { young: 3e9, damping_ratio: 0.06, recovery: 0.25, ..MATERIAL };
    let main = RodDescription {
        points: [[0.0, 1.0, 0.0], [0.12, 1.07, 0.01], [0.26, 1.09, 0.0], [0.4, 1.06, -0.03]]
            .map(DVec3::from_array)
            .to_vec(),
        radii: vec![0.0032, 0.0026, 0.002, 0.0014],
        material,
        sections: Some(48),
        parent: None,
    };
    let side = RodDescription {
        points: [[0.27, 1.089, 0.0], [0.31, 1.11, -0.06], [0.36, 1.09, -0.11]].map(DVec3::from_array).to_vec(),
        radii: vec![0.0011, 0.0009, 0.0007],
        sections: Some(16),
        parent: Some((0, 0.28)),
        ..main.clone()
    };
    let berry = |section| AttachedBody {
        section,
        at: DVec3::ZERO,
        mass: 0.001,
        inertia: glam::DMat3::ZERO,
        of_plant: false,
        reach: 0.005,
    };
    let mut rods =
        RodSystem::new(&[main, side], &[(0, 0.0, SupportKind::Fixed)]).with_added_bodies(vec![berry(47), berry(62)]);
    assert!(rods.find_rest_shape_by_equilibrium());
    let h = 1.0 / 480.0;
    for _ in 0..960 {
        rods.step_implicit(h).expect("steps");
    }
    assert!(max_displacement(&rods) < 1e-4, "{}", max_displacement(&rods));
}

#[test]
fn released_weights_fall_to_the_ground_and_later_ones_wait() {
    // A rod of 0.8 m at y = 0 over ground at -2 m, with a weight of 5 cm radius at its tip, for 1.25 s.
    let tip = AttachedBody {
        section: 8,
        at: DVec3::ZERO,
        mass: 0.01,
        inertia: glam::DMat3::ZERO,
        of_plant: false,
        reach: 0.05,
    };
    let record = |keys: &[(f64, f64)]| {
        let clip = RecordingParams {
            frames: 31,
            first: 1,
            fps: 24.0,
            steps: None,
            integrator: Integrator::Xpbd,
            acts: vec![Actuation::Mass(0, Keyframes(keys.iter().map(|(t, mass)| (*t, [*mass])).collect()))],
            wind: None,
            ground: &-2.0_f64,
            name: "rod".into(),
        };
        let description = straight_rod(9, 10.0, 0.01, MATERIAL);
        let rods = RodSystem::new(&[description], &[(0, 0.0, SupportKind::Fixed)]);
        rods.with_added_bodies(vec![tip.clone()]).record_clip(&clip, &Cancel::default()).expect("a clip")
    };
    // Let go after 0.1 s it falls the two metres in 0.63 s, and rests with its radius over the ground.
    let fallen = record(&[(0.0, 0.01), (0.05, 0.01), (0.1, 0.0)]);
    assert!((fallen[30].bodies[0].y + 1.95).abs() < 1e-5, "{}", fallen[30].bodies[0]);
    assert!(fallen[9].bodies[0].y > -1.0 && fallen[9].bodies[0].y < -0.1, "{}", fallen[9].bodies[0]);
    // A mass that begins later hangs at the tip all the time.
    let hangs = record(&[(0.0, 0.0), (0.5, 0.0), (0.6, 0.01)]);
    assert!(hangs.iter().all(|pose| pose.bodies[0].distance(pose.sections[8].0) < 1e-4));
}

#[test]
fn an_impulse_acts_once_wherever_its_time_lies() {
    // One impulse J gives a free rod without weight the momentum J. At 0.75 s (8 substeps) the rounded end of a substep lies
    // after the beginning of the next, at 0.3 s (10 substeps) before it.
    let impulse = DVec3::Y * 1e-3;
    for (steps, at) in [(8, 0.75), (10, 0.3), (8, 0.5), (8, 0.51), (10, 1.0 / 24.0), (8, 0.0)] {
        let clip = RecordingParams {
            frames: 25,
            first: 1,
            fps: 24.0,
            steps: Some(steps),
            integrator: Integrator::Xpbd,
            acts: vec![Actuation::Impulse(4, Keyframes(vec![(at, impulse.to_array())]))],
            wind: None,
            ground: &-2.0_f64,
            name: "rod".into(),
        };
        let mut rods = weightless(RodSystem::new(&[straight_rod(9, 3.0, 0.01, MATERIAL)], &[]));
        rods.record_clip(&clip, &Cancel::default()).expect("a clip");
        let (sum, _) = linear_and_angular_momentum(&mut rods);
        assert!((sum - impulse).length() < 0.01 * impulse.length(), "{sum} by an impulse at {at} s");
    }
}

#[test]
fn a_clamp_that_is_displaced_at_the_first_frame_has_its_rod_with_it() {
    // A rod along X, turned about Z by a right angle and moved: from the first frame on it stands upright at x = 0.3.
    let clip = RecordingParams {
        frames: 12,
        first: 1,
        fps: 24.0,
        steps: None,
        integrator: Integrator::Xpbd,
        acts: vec![
            Actuation::Shift(0, Keyframes(vec![(0.0, [0.3, 0.0, 0.0])])),
            Actuation::Turn(0, DVec3::Z, Keyframes(vec![(0.2, [0.5 * PI])])),
        ],
        wind: None,
        ground: &-2.0_f64,
        name: "rod".into(),
    };
    let mut rods = cantilever(9, 3.0, RodMaterial { damping_ratio: 0.1, recovery: 0.25, ..MATERIAL });
    let poses = rods.record_clip(&clip, &Cancel::default()).expect("a clip");
    for pose in &poses {
        let (base, tip) = (pose.sections[0].0.as_dvec3(), pose.sections[8].0.as_dvec3());
        assert!(
            base.distance(DVec3::X * 0.3) < 1e-6 && tip.distance(DVec3::new(0.3, 0.24, 0.0)) < 1e-6,
            "{base} {tip}"
        );
    }
}
