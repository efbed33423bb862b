//! Sway of whole plants against beam theory, and invariants of clips.

use glam::{DVec3, Quat, Vec3};

use super::testing::{leafy, rod, tree};
use super::*;
use osier_base::limits::Limits;
use osier_base::math;
use osier_base::progress::Cancel;
use osier_scene::Trs;
use osier_scene::plant::Plant;
use osier_wind::{GustWind, GustWindOptions, UniformWind, Wind};

const FPS: f64 = 24.0;

fn params(wood: WoodParams) -> SwayParams {
    SwayParams { wood, flicker: 0.0, whip: 1.0, stand: Trs::IDENTITY, gravity: None, fps: FPS }
}

fn elements(plant: &Plant, wood: &WoodParams) -> BeamElements {
    BeamElements::build(plant, wood, 1000)
}

fn take(frames: usize, repeats: bool) -> ClipOptions {
    ClipOptions { frames, repeats, from_rest: false, lean: 1.0, gain: 1.0 }
}

fn record(elements: &BeamElements, wind: &dyn Wind, params: SwayParams, clip: ClipOptions) -> BendTrack {
    BendTrack::record(elements, wind, params, clip, &Limits::default(), &Cancel::default()).expect("track")
}

/// Advances by `seconds` from time `from`, s, and returns the bends of element 0 after each step.
fn run(sim: &mut SwaySimulation<'_>, from: f64, seconds: f64) -> Vec<[f64; 2]> {
    let h = 1.0 / (FPS * f64::from(sim.steps()));
    let mut list = Vec::new();
    let mut t = from;
    while t < from + seconds {
        sim.advance(t);
        list.push(sim.bends()[0]);
        t += h;
    }
    list
}

/// A uniform wind that changes at time `at`, s.
#[derive(Debug)]
struct Turning {
    first: Vec3,
    then: Vec3,
    at: f64,
}

impl Wind for Turning {
    fn sample(&self, _: &[Vec3], t: f64, out: &mut [Vec3]) {
        out.fill(if t < self.at { self.first } else { self.then });
    }
    fn mean(&self) -> Vec3 {
        self.then
    }
    fn mean_at(&self, _: Vec3) -> Vec3 {
        self.then
    }
    fn period(&self) -> Option<f64> {
        None
    }
}

/// Decay rate of the oscillation's peaks, 1/s.
fn decay(series: &[f64], h: f64) -> f64 {
    let rest = series[series.len() - 1];
    let y: Vec<f64> = series.iter().map(|v| (v - rest).abs()).collect();
    let peaks: Vec<(f64, f64)> = (1..y.len() - 1)
        .filter(|&k| y[k] > y[k - 1] && y[k] >= y[k + 1])
        .map(|k| (k as f64 * h, y[k]))
        .take_while(|p| p.1 > 0.02 * y[0].max(y[1]))
        .collect();
    let (a, b) = (peaks[1], peaks[peaks.len() - 1]);
    math::ln(a.1 / b.1) / (b.0 - a.0)
}

#[test]
fn aerodynamic_damping_is_half_as_strong_across_the_wind() {
    let plant = rod(3.5, 0.02, 0.02);
    let wood = WoodParams { elasticity: Some(8e9), damping: 0.0, density: 500.0, ..WoodParams::default() };
    let all = elements(&plant, &wood);
    let speed = 6.0;
    let mass = 500.0 * std::f64::consts::PI * 0.02 * 0.02;
    // The random spread of frequencies acts like a spread of masses.
    let free = 3.516 / (3.5 * 3.5) * math::sqrt(wood.rigidity(0.02) / mass);
    let heavier = |way: usize| free * free / (all.list[0].w[way] * all.list[0].w[way]);
    let expected = |way: usize| 1.225 * 1.1 * 0.04 * speed / (2.0 * mass * heavier(way));
    let wind = UniformWind(Vec3::X * math::narrow(speed));
    let mut sim = SwaySimulation::new(&all, &wind, params(wood));
    let h = 1.0 / (FPS * f64::from(sim.steps()));
    // From rest the oscillation about the static bend is along the wind.
    let along: Vec<f64> = run(&mut sim, 0.0, 60.0).iter().map(|b| b[1]).collect();
    let found = decay(&along, h);
    assert!((found / expected(1) - 1.0).abs() < 0.10, "along {found}, expected {}", expected(1));
    // After a lateral impulse in the same wind the oscillation is across it.
    let turning = Turning { first: Vec3::new(math::narrow(speed), 0.0, 2.0), then: wind.0, at: 90.0 };
    let mut sim = SwaySimulation::new(&all, &turning, params(wood));
    run(&mut sim, 0.0, 90.0);
    let across: Vec<f64> = run(&mut sim, 90.0, 80.0).iter().map(|b| b[0]).collect();
    let found = decay(&across, h);
    assert!((found / expected(0) * 2.0 - 1.0).abs() < 0.10, "across {found}, half of {} expected", expected(0));
}

/// Of two similar plants in one steady wind, the one of a quarter of the size takes the same bends, four times as fast: static
/// bends, damping by the air and the inertia of twigs keep their relations.
#[test]
fn similar_plants_move_alike() {
    let plant = leafy(6);
    let wind = UniformWind(Vec3::X * 2.0);
    // Bends of all elements from rest on, after each hundredth step, of a size at whose pace steps are as long.
    let bends = |scale: f64| {
        let wood = WoodParams { hertz: 1.0 / scale, ..WoodParams::default() };
        let all = elements(&plant, &wood);
        let stand = Trs { s: Vec3::splat(math::narrow(scale)), ..Trs::IDENTITY };
        let fps = 120.0 / scale;
        let mut sim = SwaySimulation::new(&all, &wind, SwayParams { stand, fps, ..params(wood) });
        assert_eq!(sim.steps(), 1);
        let mut taken = Vec::new();
        for k in 0..1000_u32 {
            sim.advance(f64::from(k) / fps);
            if k % 100 == 99 {
                taken.push(sim.bends());
            }
        }
        taken
    };
    let (whole, quarter) = (bends(1.0), bends(0.25));
    let angles = |taken: &[Vec<[f64; 2]>]| -> Vec<f64> { taken.iter().flatten().flatten().copied().collect() };
    let (whole, quarter) = (angles(&whole), angles(&quarter));
    let most = whole.iter().fold(0.0_f64, |m, b| m.max(b.abs()));
    let apart = whole.iter().zip(&quarter).fold(0.0_f64, |m, (a, b)| m.max((a - b).abs()));
    assert!(whole.len() == quarter.len() && most > 1e-3 && apart < 1e-6 * most, "{apart} of {most}");
}

#[test]
fn steady_wind_reaches_equilibrium_with_a_downwind_lean() {
    let (plant, wood) = (rod(6.0, 0.03, 0.015), WoodParams::default());
    let all = elements(&plant, &wood);
    let mut bends = Vec::new();
    for wind in [Vec3::X * 8.0, Vec3::NEG_Z * 8.0] {
        let wind = UniformWind(wind);
        let mut sim = SwaySimulation::new(&all, &wind, params(wood));
        let path = run(&mut sim, 0.0, 80.0);
        let (end, before) = (path[path.len() - 1], path[path.len() - 200]);
        assert!((end[0] - before[0]).abs() + (end[1] - before[1]).abs() < 1e-4);
        let mut still = SwaySimulation::new(&all, &wind, params(wood));
        still.relax_to_mean_wind();
        let b = still.bends()[0];
        assert!((b[0] - end[0]).abs() + (b[1] - end[1]).abs() < 1e-4, "{b:?} {end:?}");
        let element = &all.list[0];
        let tip = beam::rotation_from_vector(element.bend_axes[0] * end[0] + element.bend_axes[1] * end[1]) * DVec3::Y;
        assert!(tip.dot(wind.0.as_dvec3()) > 1e-3, "leans with the wind: {tip}");
        bends.push(tip);
    }
    assert!((bends[0].x + bends[1].z).abs() < 0.03 * bends[0].x, "as far to every side: {bends:?}");
}

fn gusts(period: Option<f64>) -> GustWind {
    GustWind::new(GustWindOptions { speed: 7.0, period, seed: 3, ..GustWindOptions::default() })
}

#[test]
fn loops_close_in_angle_and_rate() {
    let (plant, wood) = (leafy(12), WoodParams::default());
    let all = elements(&plant, &wood);
    let wind = gusts(Some(5.0));
    let shaken = SwayParams { flicker: 0.15, ..params(wood) };
    let track = record(&all, &wind, shaken, take(120, true));
    assert_eq!(track.frame_count(), 120);
    assert_eq!(track.at(0.0), track.at(120.0));
    assert_eq!(track.at(-0.5), track.at(119.5));
    for e in 0..all.list.len() {
        for way in 0..2 {
            let b: Vec<f32> = (0..=121_u16).map(|k| track.at(f64::from(k))[e][way]).collect();
            let rates: Vec<f32> = b.windows(2).map(|w| w[1] - w[0]).collect();
            let jumps: Vec<f32> = rates.windows(2).map(|w| (w[1] - w[0]).abs()).collect();
            let most = jumps[..118].iter().copied().fold(0.0, f32::max);
            // Accelerations at the seam are no larger than elsewhere in the clip.
            assert!(
                jumps[118] <= most * 1.05 + 1e-7 && jumps[119] <= most * 1.05 + 1e-7,
                "element {e}: {most} {:?}",
                &jumps[118..]
            );
        }
    }
}

#[test]
fn loops_end_where_they_began() {
    // Short clips and little damping: the start has an effect for many repetitions.
    let (plant, wood) = (leafy(12), WoodParams { damping: 0.3, ..WoodParams::default() });
    let all = elements(&plant, &wood);
    let shaken = SwayParams { flicker: 0.15, ..params(wood) };
    let track = record(&all, &gusts(Some(2.0)), shaken, take(48, true));
    assert!(track.closed_gap() > 0.0 && track.closed_gap() <= 1e-4, "{} rad", track.closed_gap());
    for e in 0..all.list.len() {
        for way in 0..2 {
            let b: Vec<f32> = (0..=48_u16).map(|k| track.at(f64::from(k))[e][way]).collect();
            let rms =
                math::sqrt(b.windows(2).map(|w| f64::from(w[1] - w[0]) * f64::from(w[1] - w[0])).sum::<f64>() / 48.0);
            // Closing the loop changes every rate by the gap over the clip, and so the rate at the seam.
            assert!(track.closed_gap() / 48.0 < 0.02 * rms, "element {e}: {rms} a frame");
        }
    }
}

#[test]
fn amplitudes_do_not_depend_on_the_frame_rate() {
    let (plant, wood) = (leafy(12), WoodParams::default());
    let all = elements(&plant, &wood);
    let amplitudes = |fps: f64| -> Vec<f64> {
        let frames = (0..).take_while(|k| f64::from(*k) < 6.0 * fps).count();
        let track =
            record(&all, &gusts(Some(6.0)), SwayParams { flicker: 0.15, fps, ..params(wood) }, take(frames, true));
        let spread = |e: usize, way: usize| {
            let b: Vec<f64> = (0..frames).map(|k| f64::from(track.at(k as f64)[e][way])).collect();
            let mean = b.iter().sum::<f64>() / frames as f64;
            b.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>() / frames as f64
        };
        (0..all.list.len()).map(|e| math::sqrt(spread(e, 0) + spread(e, 1))).collect()
    };
    let (once, twice, four) = (amplitudes(24.0), amplitudes(48.0), amplitudes(96.0));
    for other in [&twice, &four] {
        for (e, (a, b)) in all.list.iter().zip(once.iter().zip(other)) {
            assert!((a / b - 1.0).abs() < 0.02, "element of order {}, {:?} rad/s: {a} and {b} rad", e.order, e.w);
        }
    }
}

#[test]
fn thin_wood_carries_its_own_weight() {
    // A level limb whose weight, as drawn, would bend its tip by more than half a right angle, and one twice as thick.
    let limb = |r: f32| {
        let mut plant = rod(0.5, 0.1, 0.1);
        testing::axis(&mut plant, (0, 0.4), (Vec3::Y * 0.4, Vec3::X * 3.0), (r, r));
        elements(&plant, &WoodParams::default())
    };
    let swing = |r: f32| {
        let all = limb(r);
        let e = &all.list[1];
        let stations = &all.stations[e.stations.clone()];
        let slope: f64 = stations.iter().map(|s| s.load.mass * 9.81 * s.tip_compliances[1]).sum();
        (slope, e.w[0] / std::f64::consts::TAU)
    };
    let drawn = |r: f64| 900.0 * 9.81 * 4.0 * 27.0 / (6.0 * WoodParams::default().elasticity_at(r) * r * r);
    let ((slope, hertz), (thick, _)) = (swing(0.008), swing(0.05));
    // The cube root of the slope in units of 0.02 is left.
    let expected = 0.02 * math::pow(drawn(0.008) / 0.02, 1.0 / 3.0);
    assert!(drawn(0.008) > 0.4 && (slope / expected - 1.0).abs() < 0.02, "{} as drawn, {slope}", drawn(0.008));
    assert!((thick / drawn(0.05) - 1.0).abs() < 0.02, "thick wood is as drawn: {thick}");
    // g / (L slope) sets the frequency of a level beam: 1.24 sqrt(g / deflection) / (2 pi), with a deflection of 3/4 L slope.
    let wanted = 1.24 / std::f64::consts::TAU * math::sqrt(9.81 / (0.75 * 3.0 * expected));
    assert!((hertz / wanted - 1.0).abs() < 0.22, "{hertz} Hz for {wanted}");
    // The factor on the stiffness multiplies the result.
    let mut plant = rod(0.5, 0.1, 0.1);
    testing::axis(&mut plant, (0, 0.4), (Vec3::Y * 0.4, Vec3::X * 3.0), (0.008, 0.008));
    let soft = elements(&plant, &WoodParams { stiffness: 0.25, ..WoodParams::default() });
    assert!((soft.list[1].w[0] / limb(0.008).list[1].w[0] - 0.5).abs() < 1e-3);
}

#[test]
fn nothing_moves_in_calm_air() {
    let (plant, wood) = (leafy(8), WoodParams::default());
    let all = elements(&plant, &wood);
    let track = record(&all, &UniformWind(Vec3::ZERO), params(wood), take(60, true));
    let rig = JointRig::build(&plant, &all, JointBudget { joints: 256, coarse: false });
    for k in 0..60_u16 {
        let pose = rig.pose(&all, &track.at(f64::from(k)));
        assert!(pose.iter().all(|t| t.r == Quat::IDENTITY));
    }
}

#[test]
fn twigs_are_faster_than_trunks_and_neighbours_are_uncorrelated() {
    let (plant, wood) = (leafy(24), WoodParams::default());
    let all = elements(&plant, &wood);
    let shaken = SwayParams { flicker: 0.15, ..params(wood) };
    let track = record(&all, &gusts(Some(10.0)), shaken, take(240, true));
    let series = |e: usize| -> Vec<f32> { (0..240_u16).map(|k| track.at(f64::from(k))[e][0]).collect() };
    let swings = |b: &[f32]| {
        let mean = b.iter().sum::<f32>() / b.len() as f32;
        b.windows(2).filter(|w| (w[0] - mean) * (w[1] - mean) < 0.0).count()
    };
    let (trunk, twigs): (Vec<usize>, Vec<usize>) = (0..all.list.len()).partition(|e| all.list[*e].order == 0);
    let twigs: Vec<usize> = twigs.into_iter().filter(|e| all.list[*e].order == 2).collect();
    let mean = twigs.iter().map(|e| swings(&series(*e))).sum::<usize>() / twigs.len();
    assert!(mean > swings(&series(trunk[0])), "{mean} {}", swings(&series(trunk[0])));
    let branches: Vec<usize> = (0..all.list.len()).filter(|e| all.list[*e].order == 1).collect();
    let alike = branches.windows(2).filter(|w| correlation(&series(w[0]), &series(w[1])).abs() > 0.95).count();
    assert!(alike * 4 < branches.len(), "{alike} of {} pairs swing alike", branches.len());
}

fn correlation(a: &[f32], b: &[f32]) -> f32 {
    let mean = |v: &[f32]| v.iter().sum::<f32>() / v.len() as f32;
    let (ma, mb) = (mean(a), mean(b));
    let dot = |x: &[f32], mx: f32, y: &[f32], my: f32| x.iter().zip(y).map(|(p, q)| (p - mx) * (q - my)).sum::<f32>();
    dot(a, ma, b, mb) / math::sqrt_f32(dot(a, ma, a, ma) * dot(b, mb, b, mb)).max(1e-12)
}

#[test]
fn skinning_follows_the_full_motion_of_thick_wood() {
    let (plant, wood) = (leafy(40), WoodParams::default());
    let all = BeamElements::build(&plant, &wood, 300);
    let rig = JointRig::build(&plant, &all, JointBudget { joints: 300, coarse: false });
    let mut bark = Vec::new();
    for (a, axis) in plant.axes.iter().enumerate().filter(|(_, axis)| axis.order <= 1) {
        for k in plant.nodes_of(axis) {
            let out = plant.nodes.q[k] * Vec3::X * plant.nodes.r[k];
            bark.push((plant.nodes.p[k] + out, (u32::try_from(a).expect("few"), plant.nodes.s[k])));
        }
    }
    let (points, bindings): (Vec<Vec3>, Vec<(u32, f32)>) = bark.into_iter().unzip();
    let body = PointBinding::new(&plant, &all, &points, &bindings);
    let skin = rig.skin(&plant, bindings.iter().copied());
    let track = record(&all, &gusts(Some(5.0)), params(wood), take(120, true));
    let (mut wrong, mut moved) = (0.0_f64, 0.0_f64);
    for k in (0..120_u16).step_by(10) {
        let bends = track.at(f64::from(k));
        let full = body.bark(&body.pose(&all, &bends));
        let joints = osier_scene::skinning_matrices(&rig.skeleton, &rig.pose(&all, &bends));
        for ((f, s), rest) in full.iter().zip(osier_scene::skinned_points(&points, &skin, &joints)).zip(&points) {
            wrong += f64::from((*f - s).length_squared());
            moved += f64::from((*f - *rest).length_squared());
        }
    }
    let share = math::sqrt(wrong / moved);
    assert!(share < 0.05, "{share}");
}

#[test]
fn bends_preserve_branch_lengths_and_attachments() {
    let (plant, wood) = (tree(12), WoodParams::default());
    let all = elements(&plant, &wood);
    let body = PointBinding::new(&plant, &all, &plant.nodes.p, &[]);
    let bends: Vec<[f32; 2]> = (0..all.list.len()).map(|k| [0.4 - 0.03 * k as f32, 0.2]).collect();
    let skeleton = body.pose(&all, &bends);
    let p = skeleton.positions();
    for axis in &plant.axes {
        for k in plant.nodes_of(axis).skip(1) {
            let (now, rest) = ((p[k] - p[k - 1]).length(), (plant.nodes.p[k] - plant.nodes.p[k - 1]).length());
            assert!((now / rest - 1.0).abs() < 1e-4);
        }
    }
    assert!((p[0] - plant.nodes.p[0]).length() < 1e-6, "the foot stands");
}

#[test]
fn bends_are_independent_of_other_plants() {
    let (plant, wood) = (leafy(12), WoodParams::default());
    let all = elements(&plant, &wood);
    let shaken = SwayParams { flicker: 0.15, ..params(wood) };
    let (a, b) = (
        record(&all, &gusts(Some(3.0)), shaken, take(72, true)),
        record(&all, &gusts(Some(3.0)), shaken, take(72, true)),
    );
    assert!((0..72_u16).all(|k| a.at(f64::from(k)) == b.at(f64::from(k))));
}

#[test]
fn gain_scales_oscillation_and_not_the_mean() {
    let (plant, wood) = (leafy(8), WoodParams::default());
    let all = elements(&plant, &wood);
    let wind = gusts(Some(5.0));
    let of = |gain: f64, lean: f64| record(&all, &wind, params(wood), ClipOptions { gain, lean, ..take(120, true) });
    let (one, still) = (of(1.0, 1.0), of(0.0, 1.0));
    let (three, upright) = (of(3.0, 1.0), of(1.0, 0.0));
    let at = |t: &BendTrack, k: u16| t.at(f64::from(k))[0][1];
    for k in [0, 30, 77] {
        let swing = at(&one, k) - at(&still, k);
        assert!((at(&three, k) - at(&still, k) - 3.0 * swing).abs() < 0.02 * swing.abs() + 1e-4);
        assert!((at(&upright, k) - swing).abs() < 0.02 * swing.abs() + 1e-4);
    }
}

/// Gusts push by the square of their speed, so that the mean bend is larger than that in the mean wind; exaggerated gusts leaned a plant
/// a quarter more.
#[test]
fn gain_does_not_change_the_mean_lean_in_gusts() {
    let wood = WoodParams::default();
    let all = elements(&rod(3.5, 0.035, 0.035), &wood);
    let wind = gusts(Some(5.0));
    let mean = |gain: f64| -> [f32; 2] {
        let track = record(&all, &wind, params(wood), ClipOptions { gain, ..take(120, true) });
        let bends: Vec<[f32; 2]> = (0..120_u8).map(|k| track.at(f64::from(k))[0]).collect();
        [0, 1].map(|k| bends.iter().map(|b| b[k]).sum::<f32>() / 120.0)
    };
    let largest = |b: [f32; 2]| b[0].abs().max(b[1].abs());
    let own = mean(1.0);
    for gain in [0.0, 4.0] {
        let other = mean(gain);
        assert!(largest([0, 1].map(|k| other[k] - own[k])) < 0.01 * largest(own), "{gain}: {other:?} for {own:?}");
    }
}

#[test]
fn gravity_acts_on_deviations_from_the_grown_pose() {
    // On an upright stick at the tip of a soft stem that the wind bends by an angle, the force m g sin(angle) acts transversely.
    let mut plant = rod(3.0, 0.02, 0.02);
    testing::axis(&mut plant, (0, 3.0), (Vec3::Y * 3.0, Vec3::Y), (0.01, 0.01));
    let wood = WoodParams { elasticity: Some(2e9), ..WoodParams::default() };
    let all = elements(&plant, &wood);
    let wind = UniformWind(Vec3::X * 5.0);
    let bends = |gravity: Option<f64>| {
        let mut sim = SwaySimulation::new(&all, &wind, SwayParams { gravity, ..params(wood) });
        sim.relax_to_mean_wind();
        sim.bends()
    };
    let without = bends(None);
    let mass = 900.0 * std::f64::consts::PI * 0.01 * 0.01;
    for g in [9.81, 3.7] {
        let with = bends(Some(g));
        assert!((without[0][1] - with[0][1]).abs() < 1e-5, "the stem stands on level ground");
        let lean = math::sqrt(with[0][0] * with[0][0] + with[0][1] * with[0][1]);
        let expected = mass * g * math::sin(lean) / (6.0 * wood.rigidity(0.01));
        let more = with[1][1] - without[1][1];
        assert!(lean > 0.01 && (more.abs() / expected - 1.0).abs() < 0.02, "{more} for {expected} at {lean} under {g}");
        assert!(more * without[1][1] > 0.0, "farther the same way");
    }
}

#[test]
fn second_modes_respond_to_gusts_only() {
    let plant = rod(6.0, 0.05, 0.05);
    let wood = WoodParams { second_modes: true, ..WoodParams::default() };
    let all = elements(&plant, &wood);
    assert_eq!((all.list.len(), all.bend_count(), all.list[0].second_mode), (1, 2, Some(1)));
    let steady = UniformWind(Vec3::X * 8.0);
    let mut sim = SwaySimulation::new(&all, &steady, params(wood));
    sim.relax_to_mean_wind();
    let rest = sim.bends()[0][1].abs();
    let most = |sim: &mut SwaySimulation<'_>, steps: u32| {
        (0..steps).fold(0.0_f64, |m, k| {
            sim.advance(f64::from(k) / 120.0);
            m.max(sim.bends()[1][1].abs())
        })
    };
    assert!(most(&mut sim, 600) < 1e-3 * rest, "a steady wind");
    // At the onset of a wind the second mode oscillates at 6.27 times the fundamental frequency.
    let gust = Turning { first: Vec3::ZERO, then: Vec3::X * 8.0, at: 0.25 };
    let mut sim = SwaySimulation::new(&all, &gust, params(wood));
    sim.relax_to_mean_wind();
    let mut signs = Vec::new();
    let mut last = 0.0;
    for k in 0..240_u32 {
        sim.advance(f64::from(k) / 120.0);
        // It oscillates about a share of the load, which the first mode hardly changes within a period of the second.
        let bend = sim.bends()[1][1];
        signs.push(bend > last);
        last = bend;
    }
    let turns: Vec<usize> = (1..signs.len()).filter(|k| signs[*k] != signs[k - 1]).collect();
    let half = (turns[turns.len() - 1] - turns[2]) as f64 / (turns.len() - 3) as f64 / 120.0;
    let hertz = all.list[0].w[1] / std::f64::consts::TAU
        * 6.27
        * math::sqrt(1.0 - (1.5 * all.list[0].damping_ratio) * (1.5 * all.list[0].damping_ratio));
    assert!((0.5 / half / hertz - 1.0).abs() < 0.1, "{} Hz for {hertz}", 0.5 / half);
}

#[test]
fn measured_shapes_bend_more_at_thin_ends() {
    let plant = rod(4.0, 0.05, 0.02);
    let build = |measured: bool| elements(&plant, &WoodParams { measured, ..WoodParams::default() });
    let (even, measured) = (build(false), build(true));
    let bend = [[0.2_f32, 0.0]];
    let angle = |all: &BeamElements, at: f64| {
        all.rotation_at(&all.base_rotations(&bend), &bend, all.bind(ElementLocation { element: 0, at }))
            .angle_between(Quat::IDENTITY)
    };
    assert!((angle(&even, 1.0) - 0.2).abs() < 1e-4 && (angle(&measured, 1.0) - 0.2).abs() < 1e-4);
    assert!((angle(&even, 0.5) - 0.2 * 0.875).abs() < 1e-4);
    assert!(angle(&measured, 0.5) < angle(&even, 0.5) - 0.01);
}

#[test]
fn frames_lie_between_the_steps_of_the_printed_equations() {
    let wood = WoodParams { elasticity: Some(1e9), ..WoodParams::default() };
    let plant = rod(3.5, 0.035, 0.035);
    let all = elements(&plant, &wood);
    let wind = GustWind::new(GustWindOptions { speed: 9.0, ..GustWindOptions::default() });
    let fixes = PaperCorrections { radius: true, air: true, damping: true };
    let printed = |fps: f64, frames: usize| {
        let params = SwayParams { fps, ..params(wood) };
        let simulation =
            PaperSimulation::new(&plant, &all, &wind, params, PaperParams { fixes, recoil: 0.3, damping: 0.01 });
        BendTrack::record_as_printed(simulation, take(frames, false), &Limits::default(), &Cancel::default())
            .expect("track")
    };
    // 60 steps a second: frame k of 24 a second is shown at step 2.5 k, for odd k in the middle between two steps.
    let (steps, frames) = (printed(60.0, 61), printed(24.0, 25));
    let mut farthest = 0.0_f32;
    for k in 0..24_u32 {
        let step = 2.5 * f64::from(k);
        let [before, after] = [step.floor(), step.ceil()].map(|at| steps.at(at)[0]);
        let found = frames.at(f64::from(k))[0];
        for way in 0..2 {
            let wanted = 0.5 * (before[way] + after[way]);
            assert!((found[way] - wanted).abs() < 2e-7, "frame {k}: {} for {wanted}", found[way]);
            farthest = farthest.max((after[way] - before[way]).abs());
        }
    }
    assert!(farthest > 2e-6, "the wind varies: {farthest}");
}

#[test]
fn lean_and_gain_tell_mean_and_oscillation_apart_in_a_clip_from_rest() {
    // A steady wind sets in: after 20 s the oscillation has died away, and only the mean bend is left.
    let wood = WoodParams::default();
    let all = elements(&rod(3.5, 0.035, 0.035), &wood);
    let ends = |lean: f64, gain: f64| {
        let clip = ClipOptions { frames: 480, repeats: false, from_rest: true, lean, gain };
        let track = record(&all, &UniformWind(Vec3::X * 10.0), params(wood), clip);
        [track.at(0.0)[0], track.at(479.0)[0]]
    };
    let own = ends(1.0, 1.0)[1];
    let size = own.iter().fold(0.0_f32, |m, b| m.max(b.abs()));
    assert!(size > 1e-4, "{own:?}");
    for (lean, gain) in [(1.0, 5.0), (2.0, 1.0), (0.0, 1.0), (3.0, 3.0)] {
        let [first, last] = ends(lean, gain);
        assert!(first.iter().all(|b| b.abs() <= 0.0), "{first:?}");
        for way in 0..2 {
            let wanted = math::narrow(lean) * own[way];
            assert!((last[way] - wanted).abs() < 0.01 * size, "lean {lean}, gain {gain}: {last:?} of {own:?}");
        }
    }
}

/// A wind whose speed rises by 1.2 m/s each second from time 0 on, up to 12 m/s.
#[derive(Debug)]
struct Rising;

impl Wind for Rising {
    fn sample(&self, places: &[Vec3], t: f64, out: &mut [Vec3]) {
        out.iter_mut().zip(places).for_each(|(u, place)| *u = self.mean_at_time(*place, t));
    }
    fn mean(&self) -> Vec3 {
        Vec3::X * 12.0
    }
    fn mean_at(&self, _: Vec3) -> Vec3 {
        self.mean()
    }
    fn mean_at_time(&self, _: Vec3, t: f64) -> Vec3 {
        Vec3::X * math::narrow((1.2 * t).clamp(0.0, 12.0))
    }
    fn has_varying_mean(&self) -> bool {
        true
    }
    fn period(&self) -> Option<f64> {
        None
    }
}

#[test]
fn the_lean_in_a_wind_that_rises_slowly_is_no_oscillation() {
    let wood = WoodParams::default();
    let all = elements(&rod(3.5, 0.035, 0.035), &wood);
    let track = |gain: f64| record(&all, &Rising, params(wood), ClipOptions { gain, ..take(240, false) });
    let (own, exaggerated) = (track(1.0), track(5.0));
    let size = own.at(239.0)[0].iter().fold(0.0_f32, |m, b| m.max(b.abs()));
    assert!(size > 1e-4 && exaggerated.at(0.0)[0].iter().all(|b| b.abs() < 1e-3 * size), "{size}");
    for frame in 0..240_u32 {
        let [a, b] = [&own, &exaggerated].map(|track| track.at(f64::from(frame))[0]);
        assert!((0..2).all(|k| (a[k] - b[k]).abs() < 0.05 * size), "frame {frame}: {a:?} {b:?}");
    }
}
