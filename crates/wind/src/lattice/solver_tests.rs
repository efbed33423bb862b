//! Tests of winds with the options of scenes.

#![allow(
    clippy::cast_possible_truncation,
    clippy::cast_possible_wrap,
    clippy::cast_sign_loss,
    clippy::cast_precision_loss,
    clippy::disallowed_methods,
    clippy::float_cmp,
    clippy::needless_range_loop,
    clippy::print_stdout,
    reason = "small known numbers, whose last bits do not matter; figures that documents state are printed"
)]

use std::sync::Arc;

use glam::{DVec3, Vec3};
use pulp::Arch;

use super::super::Wind;
use super::cells::cell_center;
use super::domain::{FaceCondition, PopulationSource};
use super::stencil::{Q, VELOCITIES};
use super::*;
use osier_base::limits::Limits;
use osier_base::progress::{Cancel, Silent};
use osier_base::{Error, Result};
use osier_scene::solid::{Form, Prism, Shell, Solid};

/// A small channel: 0.5 m cells and 2 steps a frame, so that 0.08 cells a step are 1.92 m/s.
fn channel_options() -> LatticeOptions {
    LatticeOptions {
        cells: [80, 32, 16],
        spacing: 0.5,
        base_center: DVec3::ZERO,
        inlet: InletOptions {
            direction: DVec3::X,
            speed: 1.92,
            speed_curve: Vec::new(),
            direction_curve: Vec::new(),
            profile: WindProfile::Log(0.05),
            reference_height: Some(16.0),
            gust_strength: 0.0,
            gust_period: 8.0,
            turbulence: 0.0,
            turbulence_length: Some(16.0),
            turbulence_modes: 24,
            seed: 7,
        },
        viscosity: 1.5e-5,
        fps: 24.0,
        steps_per_frame: Some(2),
        smagorinsky: 0.16,
        tau_floor: 0.5005,
        ground: GroundCondition::Rough(0.05),
        sides: SideCondition::Auto,
        outlet_nonequilibrium: false,
        sponge_cells: Some(8),
        lead_frames: 0,
        spin_up: None,
    }
}

/// A wall across the channel, five metres high, a cell thick, 20 cells from the inlet.
fn wall_solids() -> Vec<Solid> {
    let prism = Prism::block(Vec3::new(-9.75, 0.0, 0.0), Vec3::new(0.5, 5.0, 40.0), 0.0);
    vec![Solid { name: "wall".into(), form: Form::Prism(prism), humidity: 0.5 }]
}

fn new_solver(options: &LatticeOptions, solids: &[Solid]) -> LatticeSolver {
    LatticeSolver::new(options, solids, &Limits::default()).expect("lattice")
}

fn next_snapshot(lattice: &mut LatticeSolver) -> Result<Arc<WindSnapshot>> {
    lattice.advance(&Silent, &Cancel::default())
}

/// Snapshots of the next `count` frames of a lattice.
fn run_frames(lattice: &mut LatticeSolver, count: usize) -> Vec<Arc<WindSnapshot>> {
    (0..count).map(|_| next_snapshot(lattice).expect("frame")).collect()
}

/// Mean flux through the plane x: density times velocity, over some frames.
fn mass_flux(snapshots: &[Arc<WindSnapshot>], x: usize) -> f64 {
    let mut sum = 0.0;
    for s in snapshots {
        let [_, ny, nz] = s.cells();
        for c in 0..ny * nz {
            sum += s.cell([x, c % ny, c / ny]).map_or(0.0, |(u, drho)| f64::from(u.x) * f64::from(1.0 + drho));
        }
    }
    sum / snapshots.len() as f64
}

#[test]
fn mass_flux_is_the_same_at_inlet_middle_and_outlet() {
    for (solids, bounds) in [(Vec::new(), [1e-3, 1e-3]), (wall_solids(), [1e-2, 4e-2])] {
        let mut l = new_solver(&channel_options(), &solids);
        let _ = run_frames(&mut l, 200);
        let s = run_frames(&mut l, 250);
        let [a, b, c] = [5, 40, 74].map(|x| mass_flux(&s, x));
        println!("flux, {} solids: mid {:.2e}, outlet {:.2e}", solids.len(), b / a - 1.0, c / a - 1.0);
        assert!((b / a - 1.0).abs() < bounds[0] && (c / a - 1.0).abs() < bounds[1], "{a} {b} {c}");
        assert_eq!(l.stats().clamped_cells, 0);
    }
}

#[test]
fn turbulence_is_advected_by_a_speed_curve() {
    let inlet = |curve: Vec<[f64; 2]>| {
        let mut o = channel_options();
        (o.inlet.turbulence, o.inlet.gust_strength, o.inlet.speed_curve) = (0.2, 0.0, curve);
        new_solver(&o, &[]).inlet().clone()
    };
    let (even, same, rising) = (inlet(Vec::new()), inlet(vec![[0.0, 1.92]]), inlet(vec![[0.0, 0.96], [10.0, 1.92]]));
    let place = DVec3::new(3.1, 5.3, -1.2);
    for t in [-3.0, 0.0, 7.5, 20.0] {
        assert!((even.velocity(place, t) - same.velocity(place, t)).length() < 1e-12);
    }
    // In ten seconds at three quarters of the speed on average, the air moves as far as in seven and a half at full speed.
    assert!((rising.velocity(place, 10.0) - even.velocity(place, 7.5)).length() < 1e-9);
    // Before the curve rises, the whole wind has half the strength and half the speed.
    assert!((rising.velocity(place, -6.0) - even.velocity(place, -3.0) / 2.0).length() < 1e-9);
}

/// A wind that, after two seconds, turns from +x to -z within two seconds, in a cube of cells with a block in its middle.
fn turning_wind_solver(turbulence: f64) -> LatticeSolver {
    let mut o = channel_options();
    (o.cells, o.spin_up) = ([32, 16, 32], Some(4.0));
    (o.inlet.turbulence, o.inlet.gust_strength, o.inlet.reference_height) = (turbulence, 0.0, Some(8.0));
    o.inlet.direction_curve = vec![[2.0, 0.0], [4.0, std::f64::consts::FRAC_PI_2]];
    let block = Prism::block(Vec3::ZERO, Vec3::new(2.0, 3.0, 2.0), 0.0);
    new_solver(&o, &[Solid { name: "block".into(), form: Form::Prism(block), humidity: 0.5 }])
}

#[test]
fn turning_wind_swaps_inlet_and_outlet_faces() {
    let mut l = turning_wind_solver(0.0);
    let before = run_frames(&mut l, 48).pop().expect("frame");
    let roles = |l: &LatticeSolver| [0, 1, 4, 5].map(|f| l.flow.domain.faces[f]);
    assert_eq!(roles(&l), [FaceCondition::Inlet, FaceCondition::Outlet, FaceCondition::Outlet, FaceCondition::Outlet]);
    let part = run_frames(&mut l, 6).len();
    assert_eq!(
        (part, roles(&l)),
        (6, [FaceCondition::Inlet, FaceCondition::Outlet, FaceCondition::Outlet, FaceCondition::Inlet])
    );
    // Continue until the air of the old wind has left.
    let after = run_frames(&mut l, 480).pop().expect("frame");
    assert_eq!(roles(&l), [FaceCondition::Outlet, FaceCondition::Outlet, FaceCondition::Outlet, FaceCondition::Inlet]);
    for (s, d) in [(&before, DVec3::X), (&after, -DVec3::Z)] {
        // Above the block, where the flow is unobstructed.
        let places = (2..30).flat_map(|x| (2..30).map(move |z| [x, 13, z]));
        let all: Vec<DVec3> = places.map(|c| s.cell(c).expect("air").0.as_dvec3()).collect();
        let mean = all.iter().sum::<DVec3>() / all.len() as f64;
        let wanted = d * 1.92 * l.inlet().profile(6.75);
        println!("towards {d}: {mean}, asked {wanted}");
        assert!((mean - wanted).length() < 0.04 * wanted.length(), "{mean}, {wanted}");
    }
    assert!(l.stats().clamped_cells == 0 && l.stats().density_error.abs() < 0.02, "{:?}", l.stats());
    // An interpolated wind between these snapshots has the direction of the inflow.
    for (s, d) in [(before, Vec3::X), (after, Vec3::NEG_Z)] {
        let (t0, t1) = (s.time, s.time);
        let now = InterpolatedWind { before: Arc::clone(&s), after: s, t0, t1 };
        let mean = now.prescribed_mean_at_time(t0);
        assert!((mean.normalize() - d).length() < 1e-6, "{mean}");
    }
}

#[test]
fn turning_wind_resumes_from_a_checkpoint() {
    let mut whole = turning_wind_solver(0.05);
    // Stop in the middle of the turn, when two faces have other conditions than at the start.
    let _ = run_frames(&mut whole, 54);
    let mut again = turning_wind_solver(0.05);
    again.resume(&whole.checkpoint()).expect("resumed");
    assert_eq!(again.flow.domain.faces, whole.flow.domain.faces);
    for _ in 0..20 {
        let (a, b) = (next_snapshot(&mut whole).expect("frame"), next_snapshot(&mut again).expect("frame"));
        assert!(a.values == b.values);
    }
    assert!(whole.checkpoint() == again.checkpoint());
}

#[test]
fn turbulence_is_advected_along_a_direction_curve() {
    let inlet = |turns: Vec<[f64; 2]>| {
        let mut o = channel_options();
        (o.inlet.turbulence, o.inlet.gust_strength, o.inlet.direction_curve, o.sides) =
            (0.2, 0.0, turns, SideCondition::Open);
        new_solver(&o, &[]).inlet().clone()
    };
    let straight = inlet(Vec::new());
    let quarter = std::f64::consts::FRAC_PI_2;
    let bent = inlet(vec![[0.0, 0.0], [3.0, quarter]]);
    // A quarter of a circle of 3 s has a radius of 3 s 1.92 m/s / (pi/2), and ends that far ahead and to the left.
    let radius = 3.0 * 1.92 / quarter;
    let (place, passed) = (DVec3::new(3.1, 5.3, -1.2), DVec3::new(radius, 0.0, -radius));
    let eddies = bent.velocity(place + passed, 3.0) + DVec3::Z * bent.speed_at(5.3, 1.0);
    let before = straight.velocity(place, 0.0) - DVec3::X * straight.speed_at(5.3, 1.0);
    println!("eddies {eddies}, before the turn {before}");
    assert!(before.length() > 0.05 && (eddies - before).length() < 1e-6, "{eddies} {before}");
}

#[test]
fn restored_state_keeps_statistics_and_warnings() {
    let mut first = new_solver(&channel_options(), &wall_solids());
    first.spin_up(&Silent, &Cancel::default()).expect("run-up");
    first.warnings.push(LatticeWarning { code: "S022", text: "fast\tair".into() });
    let state = first.save_state();
    let mut second = new_solver(&channel_options(), &wall_solids());
    assert!(second.restore_state(&state[..state.len() - 1]).is_err() && second.restore_state(&state[..30]).is_err());
    second.restore_state(&state).expect("the same lattice");
    assert!(new_solver(&channel_options(), &[]).restore_state(&state).is_err());
    assert_eq!((second.stats(), second.warnings()), (first.stats(), first.warnings()));
    for _ in 0..3 {
        let (a, b) = (next_snapshot(&mut first).expect("frame"), next_snapshot(&mut second).expect("frame"));
        assert!(a.values == b.values);
    }
    assert_eq!((second.save_state(), second.stats().steps), (first.save_state(), first.spin_up_steps() + 4));
}

#[test]
fn restored_state_tells_of_solids_by_their_present_names() {
    let mut o = channel_options();
    o.spin_up = Some(0.5);
    // 2 m are four cells of 0.5 m, which S031 warns of by name.
    let low = |name: &str| {
        let prism = Prism::block(Vec3::ZERO, Vec3::new(1.0, 2.0, 2.0), 0.0);
        [Solid { name: name.into(), form: Form::Prism(prism), humidity: 0.5 }]
    };
    let mut first = new_solver(&o, &low("before"));
    first.spin_up(&Silent, &Cancel::default()).expect("spin-up");
    first.warnings.push(LatticeWarning { code: "S022", text: "fast air".into() });
    let mut second = new_solver(&o, &low("after"));
    second.restore_state(&first.save_state()).expect("the same lattice");
    let told = |text: &str| second.warnings().iter().filter(|w| w.text.contains(text)).count();
    assert_eq!([told("\"before\""), told("\"after\""), told("fast air")], [0, 1, 1], "{:?}", second.warnings());
}

#[test]
fn inlet_profile_matches_the_log_law() {
    let mut l = new_solver(&channel_options(), &[]);
    let s = run_frames(&mut l, 100).pop().expect("frame");
    let mut worst = 0.0_f64;
    for y in 0..32 {
        let u = f64::from(s.cell([5, y, 8]).expect("air").0.x);
        let wanted = 1.92 * l.inlet().profile((y as f64 + 0.5) * 0.5);
        println!("log profile, cell {y}: {:.4} m/s, {wanted:.4} asked for, {:+.3}", u, u / wanted - 1.0);
        worst = worst.max((u / wanted - 1.0).abs());
    }
    println!("log profile five cells in: {worst:.2e}");
    assert!(worst < 0.02, "{worst}");
}

/// Largest deviations from the requested profile along a channel, by distance from the inlet.
fn profile_errors(ground: GroundCondition) -> [f64; 3] {
    let mut o = channel_options();
    (o.spin_up, o.ground) = (Some(80.0), ground);
    let mut l = new_solver(&o, &[]);
    let s = run_frames(&mut l, 1).pop().expect("frame");
    [5, 30, 60].map(|x| {
        let off = (0..32).map(|y| {
            let wanted = 1.92 * l.inlet().profile((y as f64 + 0.5) * 0.5);
            (f64::from(s.cell([x, y, 8]).expect("air").0.x) / wanted - 1.0).abs()
        });
        off.fold(0.0, f64::max)
    })
}

#[test]
fn rough_ground_preserves_the_log_profile() {
    let (rough, smooth) = (profile_errors(GroundCondition::Rough(0.05)), profile_errors(GroundCondition::Smooth));
    println!("log profile at 5, 30, 60 cells: rough ground {rough:.3?}, smooth {smooth:.3?}");
    assert!(rough[0] < 0.02 && rough.iter().all(|off| *off < 0.08), "{rough:?}");
    assert!(smooth.iter().all(|off| *off > 0.2), "{smooth:?}");
}

#[test]
fn inflow_turbulence_has_the_requested_intensity() {
    let mut o = channel_options();
    (o.inlet.turbulence, o.inlet.profile, o.inlet.turbulence_length) = (0.1, WindProfile::Uniform, Some(24.0));
    let inlet = new_solver(&o, &[]).inlet().clone();
    let (mut square, mut count) = ([0.0; 3], 0.0);
    for step in 0..4000 {
        for y in [8, 14, 20, 28] {
            for z in [2, 9] {
                let place = DVec3::new(-20.25, f64::from(y) * 0.5 + 0.25, f64::from(z) * 0.5 - 4.0);
                let u = inlet.velocity(place, f64::from(step) / 48.0) - DVec3::X * 1.92;
                for a in 0..3 {
                    square[a] += u[a] * u[a];
                }
                count += 1.0;
            }
        }
    }
    let wanted = 0.1 * 0.1 * 1.92 * 1.92;
    let parts = square.map(|s| s / count / wanted);
    println!("turbulence: components {parts:.3?}, sum {:.3} of 3", parts.iter().sum::<f64>());
    assert!((parts.iter().sum::<f64>() / 3.0 - 1.0).abs() < 0.1, "{parts:?}");
    assert!(parts.iter().all(|p| (p - 1.0).abs() < 0.4), "{parts:?}");
}

/// Mean square of the velocity along z behind the wall, (m/s)^2.
fn lateral_velocity_variance(snapshots: &[Arc<WindSnapshot>]) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for s in snapshots {
        for c in 0..10 * 16 {
            if let Some((u, _)) = s.cell([35, c % 10, c / 10]) {
                sum += f64::from(u.z * u.z);
                count += 1.0;
            }
        }
    }
    sum / count
}

#[test]
fn inflow_turbulence_makes_a_three_dimensional_wake() {
    let mut o = channel_options();
    let flat = lateral_velocity_variance(&run_frames(&mut new_solver(&o, &wall_solids()), 50));
    o.inlet.turbulence = 0.1;
    let rough = lateral_velocity_variance(&run_frames(&mut new_solver(&o, &wall_solids()), 50));
    println!("w'^2 behind the wall: {flat:.2e} without, {rough:.2e} with turbulence");
    assert!(flat < 1e-8 && rough > 1e-3, "{flat} {rough}");
}

/// A scene rotated to a direction: a cube of cells with a block in its middle.
fn snapshot_for_direction(direction: DVec3) -> Arc<WindSnapshot> {
    let mut o = channel_options();
    (o.cells, o.inlet.direction, o.spin_up) = ([32, 16, 32], direction, Some(300.0 / 48.0));
    let block = Prism::block(Vec3::ZERO, Vec3::new(2.0, 3.0, 2.0), 0.0);
    let solids = [Solid { name: "block".into(), form: Form::Prism(block), humidity: 0.5 }];
    next_snapshot(&mut new_solver(&o, &solids)).expect("frame")
}

#[test]
fn flow_is_independent_of_wind_direction() {
    let mean = |s: &WindSnapshot, d: DVec3| {
        let n = s.cells();
        let all = (0..n[0] * n[1] * n[2]).map(|c| [c % n[0], c / n[0] % n[1], c / n[0] / n[1]]);
        let air: Vec<f64> = all.filter_map(|c| s.cell(c)).map(|(u, _)| u.as_dvec3().dot(d)).collect();
        air.iter().sum::<f64>() / air.len() as f64
    };
    let along = mean(&snapshot_for_direction(DVec3::X), DVec3::X);
    for d in [DVec3::Z, -DVec3::X, -DVec3::Z] {
        let off = mean(&snapshot_for_direction(d), d) / along - 1.0;
        println!("turned to {d}: mean off by {off:.2e}");
        assert!(off.abs() < 1e-4, "{d}: {off}");
    }
    let oblique = DVec3::new(1.0, 0.0, 1.0).normalize();
    let mut o = channel_options();
    (o.cells, o.inlet.direction, o.spin_up) = ([32, 16, 32], oblique, Some(30.0));
    o.inlet.reference_height = Some(8.0);
    let mut l = new_solver(&o, &[]);
    let s = run_frames(&mut l, 20).pop().expect("frame");
    let mut worst = 0.0_f64;
    for y in 0..16 {
        let u = s.cell([12, y, 12]).expect("air").0.as_dvec3().dot(oblique);
        let wanted = 1.92 * l.inlet().profile((y as f64 + 0.5) * 0.5);
        println!("oblique profile at {y}: {:.3}", u / wanted);
        worst = worst.max((u / wanted - 1.0).abs());
    }
    assert!(worst < 0.05, "{worst}");
}

#[test]
fn turbulent_wake_of_a_wall_is_stable() {
    let mut o = channel_options();
    o.inlet.turbulence = 0.1;
    let mut l = new_solver(&o, &wall_solids());
    let mut fastest = 0.0_f32;
    while l.stats().steps < 5000 {
        let s = next_snapshot(&mut l).expect("stable");
        if l.stats().steps % 50 < 2 {
            fastest = s.values.iter().map(|v| Vec3::new(v[0], v[1], v[2]).length()).fold(fastest, f32::max);
        }
    }
    println!("5000 steps behind a wall: fastest {:.3} cells a step, {:?}", fastest / 24.0, l.stats());
    assert!(fastest / 24.0 < 0.25 && l.stats().clamped_cells == 0, "{fastest}");
    assert!(l.stats().peak_checkerboard < 1e-3);
}

#[test]
fn low_tau_without_eddy_viscosity_is_refused_and_diverges() {
    let mut o = channel_options();
    (o.smagorinsky, o.inlet.turbulence) = (0.0, 0.1);
    assert!(matches!(LatticeSolver::new(&o, &wall_solids(), &Limits::default()), Err(Error::Range { .. })));
    o.smagorinsky = 1e-9;
    let mut l = new_solver(&o, &wall_solids());
    let mut end = Ok(());
    for _ in 0..1000 {
        if let Err(e) = next_snapshot(&mut l) {
            end = Err(e);
            break;
        }
    }
    let e = end.expect_err("blows up");
    println!("{e}");
    assert!(matches!(e, Error::Input(_)), "{e}");
    assert!(e.to_string().contains("S024") && e.to_string().contains("tau_floor"), "{e}");
}

/// State, as bytes after 50 steps, of a cube of cells with all kinds of boundaries.
fn state_bytes(arch: Arch, threads: usize, stop: bool) -> Vec<u8> {
    let run = || {
        let mut o = channel_options();
        (o.cells, o.spin_up) = ([64; 3], Some(1.0 / 48.0));
        (o.inlet.turbulence, o.inlet.gust_strength, o.steps_per_frame) = (0.1, 0.2, Some(3));
        let mut l = new_solver(&o, &wall_solids());
        l.flow.tables.set_arch(arch);
        let mut at = run_frames(&mut l, 9);
        if stop {
            let saved = l.checkpoint();
            l = new_solver(&o, &wall_solids());
            l.flow.tables.set_arch(arch);
            l.resume(&saved).expect("resumed");
        }
        at.extend(run_frames(&mut l, 9));
        let mut all = l.checkpoint();
        all.extend(at.last().expect("frame").values.iter().flatten().flat_map(|v| v.to_le_bytes()));
        all
    };
    osier_base::par::on_threads(threads, run)
}

#[test]
fn results_are_independent_of_threads_simd_and_checkpoints() {
    let one = blake3::hash(&state_bytes(Arch::new(), 1, false));
    for threads in [2, 5, 16] {
        assert_eq!(blake3::hash(&state_bytes(Arch::new(), threads, false)), one, "{threads} threads");
    }
    assert_eq!(blake3::hash(&state_bytes(Arch::Scalar, 2, false)), one, "scalar");
    #[cfg(target_arch = "x86_64")]
    if let Some(v3) = pulp::x86::V3::try_new() {
        assert_eq!(blake3::hash(&state_bytes(Arch::V3(v3), 2, false)), one, "AVX2");
    }
    assert_eq!(blake3::hash(&state_bytes(Arch::new(), 2, true)), one, "broken off and resumed");
    let mut other = new_solver(&channel_options(), &[]);
    assert!(other.resume(&new_solver(&channel_options(), &wall_solids()).checkpoint()).is_err(), "another scene");
}

#[test]
fn interpolation_is_linear_and_vanishes_at_walls() {
    let mut l = new_solver(&channel_options(), &wall_solids());
    let two = run_frames(&mut l, 2);
    let wind = InterpolatedWind { before: two[0].clone(), after: two[1].clone(), t0: 0.0, t1: 1.0 / 24.0 };
    let at = |p: Vec3, t: f64| {
        let mut out = [Vec3::ZERO];
        wind.sample(&[p], t, &mut out);
        out[0]
    };
    // The middle of cell (40, 20, 8).
    let middle = Vec3::new(0.25, 10.25, 0.25);
    let (a, b) = (two[0].cell([40, 20, 8]).expect("air").0, two[1].cell([40, 20, 8]).expect("air").0);
    assert!((at(middle, 0.0) - a).length() < 1e-5 && (at(middle, 1.0) - b).length() < 1e-5);
    assert!((at(middle, 0.5 / 24.0) - (a + b) / 2.0).length() < 1e-5);
    let next = two[0].cell([41, 20, 8]).expect("air").0;
    assert!((at(middle + Vec3::X * 0.125, 0.0) - (a + (next - a) * 0.25)).length() < 1e-5);
    // Straight down to the ground, and to the wall whose face lies at x = -10.
    let (low, half) = (at(Vec3::new(5.0, 0.25, 0.25), 0.0), at(Vec3::new(5.0, 0.125, 0.25), 0.0));
    assert!((half * 2.0 - low).length() < 1e-4 * low.length().max(0.01), "{low} {half}");
    assert!(at(Vec3::new(5.0, -0.1, 0.0), 0.0) == Vec3::ZERO && at(Vec3::new(-9.75, 2.0, 0.0), 0.0) == Vec3::ZERO);
    let (far, near) = (at(Vec3::new(-10.25, 2.25, 0.25), 0.0), at(Vec3::new(-10.125, 2.25, 0.25), 0.0));
    assert!((near * 2.0 - far).length() < 1e-3 * far.length().max(0.1), "{far} {near}");
    // Sides are periodic; far outside the box the inflow applies.
    let p = Vec3::new(3.0, 6.0, 1.3);
    assert!((at(p, 0.0) - at(p + Vec3::Z * 8.0, 0.0)).length() < 1e-4);
    let out = Vec3::new(40.0, 8.0, 0.0);
    assert!((at(out, 0.02).as_dvec3() - l.inlet().velocity(out.as_dvec3(), 0.02)).length() < 1e-5);
}

#[test]
fn interpolation_reproduces_linear_fields() {
    let l = new_solver(&LatticeOptions { sides: SideCondition::Open, ..channel_options() }, &[]);
    let grid = Arc::clone(&l.grid);
    // Velocity at a position and a time, up to 1 m/s.
    let wind = |p: DVec3, t: f64| {
        DVec3::new(0.02 * p.x + 0.01 * p.y - 0.5 * t, 0.04 * p.y - 0.01 * p.z, 0.03 * p.z - 0.02 * p.x + t)
    };
    let (nx, ny) = (grid.n[0] + 2, grid.n[1] + 2);
    let snapshot = |time: f64| {
        let value = |k: usize| {
            let at = DVec3::new((k % nx) as f64 - 0.5, (k / nx % ny) as f64 - 0.5, (k / nx / ny) as f64 - 0.5);
            let u = wind(grid.origin + at * grid.spacing, time).as_vec3();
            [u.x, u.y, u.z, 0.0]
        };
        Arc::new(WindSnapshot { grid: Arc::clone(&grid), values: (0..grid.value_count()).map(value).collect(), time })
    };
    let between = InterpolatedWind { before: snapshot(0.0), after: snapshot(0.25), t0: 0.0, t1: 0.25 };
    let mut rng = osier_base::rng::Rng::at(7, &["places".into()]);
    for _ in 0..2000 {
        let part = DVec3::new(rng.unit_f64(), rng.unit_f64(), rng.unit_f64());
        let (p, t) = (DVec3::new(40.0, 15.5, 8.0) * part + DVec3::new(-20.0, 0.3, -4.0), 0.25 * rng.unit_f64());
        let mut out = [Vec3::ZERO];
        between.sample(&[p.as_vec3()], t, &mut out);
        let off = (out[0].as_dvec3() - wind(p.as_vec3().as_dvec3(), t)).length();
        assert!(off < 1e-6, "off by {off:.2e} at {p}");
    }
}

#[test]
fn steps_per_frame_and_limits_follow_from_the_options() {
    let mut o = channel_options();
    (o.cells, o.inlet.speed, o.inlet.reference_height, o.steps_per_frame) = ([70; 3], 2.0, Some(35.0), None);
    let l = new_solver(&o, &[]);
    assert_eq!(l.steps_per_frame(), 2);
    assert!((l.effective_viscosity() - 2e-3).abs() < 1e-6, "{}", l.effective_viscosity());
    o.steps_per_frame = Some(1);
    assert!(matches!(LatticeSolver::new(&o, &[], &Limits::default()), Err(Error::Range { .. })));
    (o.steps_per_frame, o.inlet.speed) = (Some(2), 3.2);
    assert!(new_solver(&o, &[]).warnings().iter().any(|n| n.code == "S020"));
    let mut few = Limits::default();
    few.set("cells", "1k").expect("limit");
    assert!(matches!(LatticeSolver::new(&o, &[], &few), Err(Error::Limit { .. })));
}

/// 40 m at 1.92 m/s take 1000 steps of 1/48 s, twice that with four open faces.
#[test]
fn open_sides_take_two_crossings_of_spin_up() {
    let mut o = channel_options();
    let steps = |o: &LatticeOptions| new_solver(o, &[]).spin_up_steps();
    assert!((1000..=1001).contains(&steps(&o)), "{}", steps(&o));
    o.sides = SideCondition::Open;
    assert!((1000..=1001).contains(&steps(&o)), "parallel to its sides: {}", steps(&o));
    o.inlet.direction = DVec3::new(0.8, 0.0, 0.6);
    assert!((2000..=2001).contains(&steps(&o)), "{}", steps(&o));
    o.sides = SideCondition::Slip;
    assert!((1000..=1001).contains(&steps(&o)), "{}", steps(&o));
    (o.sides, o.inlet.direction) = (SideCondition::Auto, DVec3::X);
    o.inlet.direction_curve = vec![[2.0, 0.0], [4.0, 1.0]];
    assert!((2000..=2001).contains(&steps(&o)), "turning: {}", steps(&o));
    o.spin_up = Some(4.0);
    assert_eq!(steps(&o), 192);
}

/// Ten degrees to an axis, in an empty box of 8 m: high above the middle the first frame has the requested direction, with a
/// tangent of 0.176. After one crossing it is 0.11, because of the eddies of the air that escapes at the start.
#[test]
fn an_oblique_wind_has_its_direction_from_the_first_frame_on() {
    let mut o = channel_options();
    (o.cells, o.sponge_cells, o.steps_per_frame) = ([16, 12, 16], None, None);
    (o.inlet.speed, o.inlet.reference_height) = (3.0, None);
    o.inlet.direction = DVec3::new(0.984_807_753, 0.0, 0.173_648_178).normalize();
    let s = next_snapshot(&mut new_solver(&o, &[])).expect("frame");
    let (u, _) = s.cell([8, 10, 8]).expect("air");
    assert!((u.z / u.x - 0.176).abs() < 0.02, "{u}");
}

#[test]
fn no_population_crosses_a_thin_wall_and_enclosed_air_is_filled() {
    let o = channel_options();
    // A fence across the whole channel, at several positions within a cell and angles: every link of an air cell on one side ends
    // on the same side, and no other link is cut.
    for (shift, thick, degrees) in
        [(0.0, 0.1, 0.0), (0.13, 0.1, 0.0), (0.25, 0.2, 15.0), (0.37, 0.02, 30.0), (0.2, 0.1, 45.0)]
    {
        let turn = f32::to_radians(degrees);
        let size = Vec3::new(thick, 5.0, 40.0);
        let at = Vec3::new(shift, 0.0, 0.0);
        let fence = |form: Form| vec![Solid { name: "fence".into(), form, humidity: 0.5 }];
        let across = Vec3::new(turn.cos(), 0.0, -turn.sin());
        let along = Vec3::new(turn.sin(), 0.0, turn.cos()) * 20.0;
        let corners = [at - along, at + along, at + along + Vec3::Y * 5.0, at - along + Vec3::Y * 5.0];
        let sheet = Shell::new(&corners, &[[0, 1, 2], [0, 2, 3]]).expect("sheet");
        for solids in [fence(Form::Prism(Prism::block(at, size, turn))), fence(Form::Shell(Arc::new(sheet)))] {
            let l = new_solver(&LatticeOptions { sides: SideCondition::Slip, ..o.clone() }, &solids);
            let domain = &l.flow.domain;
            let n = domain.grid.n;
            let center = |c: [usize; 3]| cell_center(l.setup.cells(), c);
            let mut cut = 0;
            for c in 0..domain.grid.cell_count() {
                let cell = [c % n[0], c / n[0] % n[1], c / n[0] / n[1]];
                for i in (1..Q).filter(|_| !domain.is_solid(cell)) {
                    let (from, left) = match domain.population_source(cell, i) {
                        PopulationSource::Neighbour => {
                            (std::array::from_fn(|a| cell[a].wrapping_add_signed(-(VELOCITIES[i][a] as isize))), i)
                        }
                        PopulationSource::Cell { cell: from, direction } => (from, direction),
                        _ => continue,
                    };
                    // The path to the middle of the link, where it may be reflected, and on. A link that changes sides passes
                    // over the top of the fence.
                    let middle = center(from) + Vec3::from_array(VELOCITIES[left].map(|c| 0.25 * c as f32));
                    for (start, end) in
                        [(center(from), middle), (middle, center(cell))].into_iter().filter(|_| from != cell)
                    {
                        let (a, b) = ((start - at).dot(across), (end - at).dot(across));
                        let passes = start.lerp(end, a / (a - b)).y;
                        assert!(passes > 4.99 || a * b > 0.0, "{degrees}: {from:?} to {cell:?}");
                    }
                    // Faces also reflect.
                    let inside = (1..3).all(|a| cell[a] > 0 && cell[a] + 1 < n[a]);
                    cut += usize::from(from == cell && inside);
                    let near = (center(cell) - at).dot(across).abs() < 0.75 && center(cell).y < 5.75;
                    assert!(from != cell || !inside || near, "{degrees}: {cell:?} {i}");
                }
            }
            assert!(cut > 10 * 16, "{degrees}: {cut} links bounce back");
        }
    }
    let wall = |at: Vec3, size: Vec3| Solid {
        name: "wall".into(),
        form: Form::Prism(Prism::block(at, size, 0.0)),
        humidity: 0.5,
    };
    let room = [
        wall(Vec3::new(-2.0, 0.0, 0.0), Vec3::new(0.5, 3.0, 4.0)),
        wall(Vec3::new(2.0, 0.0, 0.0), Vec3::new(0.5, 3.0, 4.0)),
        wall(Vec3::new(0.0, 0.0, 1.75), Vec3::new(4.5, 3.0, 0.5)),
        wall(Vec3::new(0.0, 0.0, -1.75), Vec3::new(4.5, 3.0, 0.5)),
        wall(Vec3::new(0.0, 2.5, 0.0), Vec3::new(4.5, 0.5, 4.0)),
    ];
    let l = new_solver(&o, &room);
    assert!(l.warnings().iter().any(|n| n.text.contains("enclosed by solids")), "{:?}", l.warnings());
    assert!(l.flow.domain.is_solid([40, 2, 8]));
}

#[test]
fn recording_matches_snapshots_and_loops() {
    use osier_base::geometry::Bounds;
    let mut o = channel_options();
    (o.inlet.turbulence, o.spin_up) = (0.1, Some(2.0));
    let bounds = Bounds { min: Vec3::new(-3.0, 0.0, -1.0), max: Vec3::new(2.0, 5.0, 1.5) };
    let record = |repeats: bool, limits: &Limits| {
        let lead = if repeats { RecordingOptions::loop_lead(60, 24.0) } else { 9 };
        let take = RecordingOptions { bounds, lead, frames: 60, fps: 24.0, repeats };
        let o = LatticeOptions { lead_frames: if repeats { lead } else { 12 }, ..o.clone() };
        let recorded =
            RecordedWind::record(&mut new_solver(&o, &wall_solids()), take, limits, &Silent, &Cancel::default())?;
        assert_eq!(recorded.memory_bytes(), take.predicted_bytes(&o));
        Ok::<_, Error>(recorded)
    };
    let once = record(false, &Limits::default()).expect("recorded");
    let lead = LatticeOptions { lead_frames: 12, ..o.clone() };
    let mut l = new_solver(&lead, &wall_solids());
    let all = run_frames(&mut l, 40);
    assert!((all[0].time() + 0.5).abs() < 1e-12 && all[12].time().abs() < 1e-12);
    let places = [Vec3::new(-2.1, 0.4, 0.3), Vec3::new(1.7, 4.9, -0.9), Vec3::new(0.0, 2.0, 0.0)];
    let ask = |w: &dyn Wind, t: f64| {
        let mut out = [Vec3::ZERO; 3];
        w.sample(&places, t, &mut out);
        out
    };
    let frame = |k: usize| InterpolatedWind {
        before: all[k].clone(),
        after: all[k + 1].clone(),
        t0: (k as f64 - 12.0) / 24.0,
        t1: (k as f64 - 11.0) / 24.0,
    };
    // The recording and the snapshots of another run agree at any time after the first frame that is kept.
    for (k, t) in [(3, -9.0), (5, -6.7), (12, 0.0), (19, 7.4), (38, 26.9)] {
        let (a, b) = (ask(&once, t / 24.0), ask(&frame(k), t / 24.0));
        assert!(a.iter().zip(&b).all(|(a, b)| (*a - *b).length() < 1e-6), "{a:?} {b:?}");
    }
    let round = record(true, &Limits::default()).expect("recorded");
    assert_eq!((round.period(), once.period()), (Some(2.5), None));
    let (end, start) = (ask(&round, 2.5 - 1e-9), ask(&round, 0.0));
    assert!(end.iter().zip(&start).all(|(a, b)| (*a - *b).length() < 1e-4), "{end:?} {start:?}");
    assert_eq!(ask(&round, 0.7), ask(&round, 0.7 + 2.5));
    assert!(ask(&round, 0.3) != ask(&round, 0.9));
    let mut few = Limits::default();
    few.set("wind-bytes", "1k").expect("limit");
    assert!(matches!(record(false, &few), Err(Error::Limit { .. })));
}

/// The mean of a recorded wind is that of its clip: behind a wall far less than that of the inflow, and proportional to a speed
/// curve.
#[test]
fn the_mean_of_a_recording_has_the_wakes_of_its_solids() {
    use osier_base::geometry::Bounds;
    let take = RecordingOptions { bounds: Bounds::of([]), lead: 6, frames: 48, fps: 24.0, repeats: false };
    for curve in [Vec::new(), vec![[0.0, 1.92], [2.0, 0.96]]] {
        let mut o = LatticeOptions { spin_up: Some(30.0), lead_frames: 6, ..channel_options() };
        o.inlet.speed_curve = curve;
        let mut lattice = new_solver(&o, &wall_solids());
        let recorded = RecordedWind::record(&mut lattice, take, &Limits::default(), &Silent, &Cancel::default())
            .expect("recorded");
        let inlet = lattice.inlet();
        let (lee, open) = (Vec3::new(-6.2, 1.4, 0.3), Vec3::new(-6.2, 12.0, 0.3));
        for place in [lee, open] {
            let (mut sum, mut factors) = (Vec3::ZERO, 0.0);
            for k in 0..=48 {
                let (t, mut out) = (f64::from(k) / 24.0, [Vec3::ZERO]);
                recorded.sample(&[place], t, &mut out);
                (sum, factors) = (sum + out[0], factors + inlet.speed_factor(t) as f32);
            }
            let mean = recorded.mean_at(place);
            assert!(mean.distance(sum / factors) < 1e-4, "{mean} {}", sum / factors);
            for t in [0.0, 1.0, 9.0] {
                let expected = mean * inlet.speed_factor(t) as f32;
                assert!(recorded.mean_at_time(place, t).distance(expected) < 1e-6, "{t}");
            }
        }
        let share = |place: Vec3| recorded.mean_at(place).x / inlet.mean_at(place).x;
        assert!(share(lee) < 0.5 && share(open) > 0.9, "{} {}", share(lee), share(open));
    }
}

/// A wall across one of two joined sides is refused, also by the check of the options, which makes no cells. A wall across both
/// sides, one that ends at a side, one beside the box, and one at an open side are not refused.
#[test]
fn solids_across_one_joined_side_are_refused() {
    // The channel takes up 8 m along z, from -4 to 4.
    let code = |center: f32, width: f32, sides: SideCondition| {
        let prism = Prism::block(Vec3::new(0.0, 0.0, center), Vec3::new(0.5, 5.0, width), 0.0);
        let solids = [Solid { name: "fence".into(), form: Form::Prism(prism), humidity: 0.5 }];
        let options = LatticeOptions { sides, ..channel_options() };
        let limits = Limits::default();
        let results = [
            LatticeSolver::new(&options, &solids, &limits).map(|_| ()),
            LatticeSolver::check_options(&options, &solids, &limits).map(|_| ()),
        ];
        results.map(|result| match result {
            Err(Error::Input(report)) => report.diagnostics[0].code,
            _ => "",
        })
    };
    for center in [3.0, -3.0] {
        assert_eq!(code(center, 4.0, SideCondition::Auto), ["S039"; 2]);
        assert_eq!(code(center, 4.0, SideCondition::Open), [""; 2]);
        assert_eq!(code(center, 2.0, SideCondition::Auto), [""; 2]);
        assert_eq!(code(2.0 * center, 2.0, SideCondition::Auto), [""; 2]);
    }
    assert_eq!(code(1.0, 12.0, SideCondition::Auto), [""; 2]);
}

/// A wall beside a corner of the box, at an angle to it, whose bounds cross a joined side although the wall does not reach it.
/// Moved towards the box, the wall reaches the side.
#[test]
fn solids_are_refused_by_their_faces_and_not_by_their_bounds() {
    // The corner is at x = 20, z = 4; turned by 45 degrees, the width of the wall runs along +X and -Z.
    let is_refused = |x: f32| {
        let foot = Vec3::new(x, 0.0, 5.0);
        let prism = Prism::block(foot, Vec3::new(8.0, 5.0, 0.5), std::f32::consts::FRAC_PI_4);
        let solids = [Solid { name: "fence".into(), form: Form::Prism(prism), humidity: 0.5 }];
        LatticeSolver::check_options(&channel_options(), &solids, &Limits::default()).is_err()
    };
    assert!(!is_refused(21.0) && is_refused(17.0));
}
