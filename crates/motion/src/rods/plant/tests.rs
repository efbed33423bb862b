//! Twigs with leaves on rods.

use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};

use glam::{DVec3, Quat, Vec3};

use super::RodPlant;
use crate::rain::RainPlant;
use crate::rods::plant::layout::RodPlantParams;
use crate::sway::WoodParams;
use osier_scene::plant::{Axis, AxisEnd, AxisKind, NONE, Nodes, Organ, Plant, Proto};
use osier_scene::{Mesh, Trs};
use osier_wind::{GustWind, GustWindOptions, UniformWind, Wind};

/// A twig of 0.4 m along X, rising a little, with six leaves on stalks of 3 cm.
pub(crate) fn twig() -> Plant {
    let count = 9_u16;
    let at = |k: u16| Vec3::new(0.05 * f32::from(k), 1.0 + 0.01 * f32::from(k), 0.0);
    let turn = osier_base::math::rotation_between(Vec3::Y, (at(1) - at(0)).normalize());
    let step = (at(1) - at(0)).length();
    let nodes = Nodes {
        p: (0..count).map(at).collect(),
        q: vec![turn; usize::from(count)],
        r: (0..count).map(|k| 0.0025 - 0.00015 * f32::from(k)).collect(),
        s: (0..count).map(|k| step * f32::from(k)).collect(),
        birth: vec![0.0; usize::from(count)],
        color: vec![0; usize::from(count)],
    };
    let axis = Axis {
        id: 1,
        parent: NONE,
        parent_s: 0.0,
        order: 3,
        kind: AxisKind::Stem,
        first: 0,
        count: u32::from(count),
        length: step * f32::from(count - 1),
        s_exposed: 0.0,
        material: 0,
        fork: NONE,
        end: AxisEnd::Tip,
        birth: 0.0,
    };
    let points = [[-0.02, 0.0], [0.02, 0.0], [0.02, 0.07], [-0.02, 0.07]].map(|p| Vec3::new(p[0], p[1], 0.0));
    let mesh = Mesh { points: points.to_vec(), triangles: vec![[0, 1, 2], [0, 2, 3]], ..Mesh::default() };
    let organ = |k: u16| Organ {
        id: 100 + u64::from(k),
        axis: 0,
        s: step * (f32::from(k) + 2.5),
        offset: Vec3::ZERO,
        q: Quat::from_rotation_z(if k.is_multiple_of(2) { 0.9 } else { -0.9 })
            * Quat::from_rotation_y(0.3 * f32::from(k)),
        scale: 1.0,
        proto: 0,
        petiole: 0.03,
        tint: 0.0,
        birth: 0.0,
    };
    Plant {
        axes: vec![axis],
        nodes,
        organs: (0..6).map(organ).collect(),
        protos: vec![Proto { name: "leaf".into(), mesh: Arc::new(mesh) }],
        ..Plant::default()
    }
}

pub(crate) fn plant_params() -> RodPlantParams {
    RodPlantParams {
        gravity: 9.81,
        wood: WoodParams::default(),
        shear: 1.0 / 15.0,
        recovery: 0.25,
        flexibility: 1.0,
        stalk_young: 3e8,
        stalk_radii: vec![8e-4],
        stalk_radius: None,
        stalk_sections: 5,
        sections: None,
        max_rod_radius: 0.015,
        max_sections: 4000,
        max_leaf_stalks: 400,
    }
}

/// A time step so short that springs do not act, s.
pub(crate) const SHORT: f64 = 5e-10;

fn rod_plant(stand: &Trs) -> RodPlant {
    RodPlant::new(&twig(), stand, &plant_params(), "twig")
}

fn run_steps(rod_plant: &mut RodPlant, seconds: f64, h: f64, mut each: impl FnMut(&RodPlant)) {
    let mut t = 0.0;
    while t < seconds {
        rod_plant.step(t, h).expect("steps");
        each(rod_plant);
        t += h;
    }
}

#[test]
fn steps_resolve_how_fast_gusts_turn_blades() {
    let rod_plant = rod_plant(&Trs::IDENTITY);
    let steps = |wind: Option<f32>| {
        let wind = wind.map(|speed| UniformWind(Vec3::X * speed));
        rod_plant.steps_per_frame(24.0, wind.as_ref().map(|wind| wind as &dyn Wind))
    };
    assert_eq!(steps(Some(2.0)), steps(None), "a breeze is slower than the petioles");
    // A plate of 7 cm that turns about its end in gusts of 1.8 times 30 m/s: w^2 = 3/2 rho C u^2 / (0.2 kg/m^2 c).
    let w = osier_base::math::sqrt(1.5 * 1.225 * 0.4 * (1.8 * 30.0) * (1.8 * 30.0) / (0.2 * 0.07));
    assert!((w - 391.3).abs() < 0.1 && steps(None) < 41);
    assert_eq!(steps(Some(30.0)), 41, "0.4 rad a step");
}

#[test]
fn a_step_that_diverges_names_its_frame_of_the_clip() {
    // Steps count from the beginning of rain, two seconds before frame 101.
    let mut rod_plant = rod_plant(&Trs::IDENTITY).with_frame_numbering(24.0, 101).with_clip_start(2.0);
    let place = rod_plant.leaf_pose(0).position;
    let fails_in = |t: f64| {
        rod_plant.apply_impulse(0, place, DVec3::X * 1e9);
        match rod_plant.step(t, 1.0 / 192.0) {
            Err(osier_base::Error::Simulation { frame, .. }) => frame,
            other => panic!("{other:?}"),
        }
    };
    assert_eq!([1.0, 2.0, 2.51].map(fails_in), [101, 101, 113]);
}

#[test]
fn plant_hangs_in_its_grown_pose_at_any_placement() {
    let turned = Trs {
        t: Vec3::new(2.0, -1.0, 0.5),
        r: Quat::from_euler(glam::EulerRot::XYZ, 0.3, 1.2, -0.4),
        s: Vec3::splat(1.4),
    };
    for stand in [Trs::IDENTITY, turned] {
        let plant = twig();
        let mut rod_plant = rod_plant(&stand);
        assert!(rod_plant.has_rest_shape() && rod_plant.omitted_stems_and_leaves() == [0, 0]);
        assert_eq!(rod_plant.leaf_count(), 6);
        for (i, organ) in plant.organs.iter().enumerate() {
            let (p, q) = plant.organ_site(organ);
            let blade = rod_plant.leaf_pose(i);
            assert!((blade.position - stand.apply(p).as_dvec3()).length() < 1e-6);
            assert!(blade.orientation.dot((stand.r * q).as_dquat()).abs() > 1.0 - 1e-9);
        }
        let start: Vec<DVec3> = (0..6).map(|i| rod_plant.leaf_pose(i).to_world(DVec3::Y * 0.07, 1.4)).collect();
        let mut most = 0.0_f64;
        run_steps(&mut rod_plant, 2.0, 1.0 / 384.0, |b| {
            (0..6).for_each(|i| most = most.max((b.leaf_pose(i).to_world(DVec3::Y * 0.07, 1.4) - start[i]).length()));
        });
        assert!(most < 1e-4, "{most}");
        let mut pieces = Vec::new();
        rod_plant.wood_segments(&mut pieces);
        assert!(pieces.len() >= 4);
        let (first, last) = (pieces[0].ends[0], pieces[pieces.len() - 1].ends[1]);
        assert!((first - stand.apply(plant.nodes.p[0]).as_dvec3()).length() < 1e-3);
        assert!((last - stand.apply(plant.nodes.p[8]).as_dvec3()).length() < 1e-3);
    }
}

#[test]
fn impulse_changes_velocity_by_inverse_effective_mass() {
    let mut free = plant_params();
    // Stiffness damping would transmit an impulse within the step.
    free.wood.damping = 0.0;
    // Near the origin, where positions have the smallest rounding errors.
    let near = Trs::translation(Vec3::new(-0.2, -1.04, 0.0));
    let made = || RodPlant::new(&twig(), &near, &free, "twig");
    let twice = |strike: &dyn Fn(&mut RodPlant, f64), look: &dyn Fn(&RodPlant) -> f64| {
        // The difference of both signs cancels terms of second order in the impulse.
        let [forth, back] = [1e-3, -1e-3].map(|impulse| {
            let mut rod_plant = made();
            strike(&mut rod_plant, impulse);
            run_steps(&mut rod_plant, 24.5 * SHORT, SHORT, |_| ());
            look(&rod_plant)
        });
        (forth - back) / 2e-3
    };
    for (leaf, along) in [(1, DVec3::NEG_Y), (4, DVec3::new(0.6, 0.0, 0.8))] {
        let blade = made().leaf_pose(leaf);
        let [place, wet] = [DVec3::new(0.01, 0.05, 0.0), DVec3::Y * 0.03].map(|p| blade.to_world(p, 1.0));
        let mut rod_plant = made();
        rod_plant.set_attached_mass(leaf, 2e-5, wet);
        // An impulse off the centre of a blade of 0.56 g also rotates it: the effective mass is less than the mass.
        let light = rod_plant.inverse_effective_mass(leaf, place, along);
        assert!(light > 1.0 / 6e-4 && light < 1e5, "{light}");
        let strike = |b: &mut RodPlant, impulse: f64| {
            b.set_attached_mass(leaf, 2e-5, wet);
            b.apply_impulse(leaf, place, along * impulse);
        };
        let got = twice(&strike, &|b| b.leaf_pose(leaf).velocity_at(place).dot(along));
        assert!((got / light - 1.0).abs() < 1e-6, "{got} {light}");
    }
    let light = made().wood_inverse_effective_mass(6, 0.3, DVec3::Y);
    let got = twice(&|b, impulse| b.apply_wood_impulse(6, 0.3, DVec3::Y * impulse), &|b| b.wood_velocity(6, 0.3).y);
    assert!(light > 0.0 && (got / light - 1.0).abs() < 1e-6, "{got} {light}");
}

#[test]
fn released_leaf_oscillates_and_comes_to_rest() {
    let mut free = plant_params();
    free.wood.damping = 0.3;
    let mut rod_plant = RodPlant::new(&twig(), &Trs::IDENTITY, &free, "twig");
    let tip = |b: &RodPlant| b.leaf_pose(3).to_world(DVec3::Y * 0.07, 1.0).y;
    let rest = tip(&rod_plant);
    let place = rod_plant.leaf_pose(3).to_world(DVec3::Y * 0.05, 1.0);
    rod_plant.set_attached_mass(3, 2e-4, place);
    run_steps(&mut rod_plant, 3.0, 1.0 / 384.0, |_| ());
    let sunk = rest - tip(&rod_plant);
    assert!(sunk > 5e-4, "{sunk}");
    rod_plant.set_attached_mass(3, 0.0, place);
    let (mut crossings, mut above) = (0, false);
    run_steps(&mut rod_plant, 4.0, 1.0 / 384.0, |b| {
        let now = tip(b) > rest;
        crossings += usize::from(now != above);
        above = now;
    });
    assert!(crossings >= 2, "{crossings}");
    assert!((tip(&rod_plant) - rest).abs() < 0.05 * sunk, "{} of {sunk}", tip(&rod_plant) - rest);
}

#[test]
fn leaves_flutter_independently_and_never_flip() {
    let wind = Arc::new(UniformWind(Vec3::new(2.5, 0.0, 1.0)));
    let mut rod_plant = rod_plant(&Trs::IDENTITY).with_wind(Some(wind));
    let start: Vec<_> = (0..6).map(|i| rod_plant.leaf_pose(i).orientation).collect();
    let (mut most, mut swings) = (0.0_f64, vec![Vec::new(); 6]);
    run_steps(&mut rod_plant, 6.0, 1.0 / 384.0, |b| {
        for i in 0..6 {
            most = most.max(b.leaf_pose(i).orientation.angle_between(start[i]));
            swings[i].push(b.leaf_pose(i).angular_velocity.length());
        }
    });
    let mean = |s: &[f64]| s.iter().fold(0.0, |a, b| a + b) / s.len() as f64;
    assert!(most < 1.6, "no leaf turns over: {most}");
    let late: Vec<&[f64]> = swings.iter().map(|s| &s[1200..]).collect();
    assert!(late.iter().all(|s| mean(s) > 0.02), "all move: {:?}", late.iter().map(|s| mean(s)).collect::<Vec<_>>());
    let (a, b) = (late[0], late[1]);
    let (ma, mb) = (mean(a), mean(b));
    let product = |x: &[f64], y: &[f64], m: f64, n: f64| x.iter().zip(y).fold(0.0, |s, (x, y)| s + (x - m) * (y - n));
    let alike = product(a, b, ma, mb) / osier_base::math::sqrt(product(a, a, ma, ma) * product(b, b, mb, mb));
    assert!(alike < 0.7, "not in unison: {alike}");
}

#[test]
fn stems_and_leaves_beyond_the_budget_are_rigid_and_counted() {
    let mut small = plant_params();
    small.max_leaf_stalks = 2;
    let rod_plant = RodPlant::new(&twig(), &Trs::IDENTITY, &small, "twig");
    assert_eq!(rod_plant.omitted_stems_and_leaves(), [0, 4]);
    assert_eq!((0..6).filter(|i| rod_plant.leaf_stalk(*i).is_some()).count(), 2);
    assert!((0..6).all(|i| rod_plant.leaf_section(i).is_some()));
    small.max_rod_radius = 1e-4;
    let still = RodPlant::new(&twig(), &Trs::IDENTITY, &small, "twig");
    assert!((0..6).filter(|i| still.leaf_section(*i).is_none()).count() == 4 && still.has_rest_shape());
    assert!(still.inverse_effective_mass(1, DVec3::ZERO, DVec3::Y) >= 0.0);
}

/// A wind that is beyond all bounds in its first samples, so that the step that takes them fails.
#[derive(Debug)]
struct FailsFirst {
    wind: GustWind,
    /// Samples that are left until it blows as `wind`.
    left: AtomicU32,
}

impl Wind for FailsFirst {
    fn sample(&self, places: &[Vec3], t: f64, out: &mut [Vec3]) {
        self.wind.sample(places, t, out);
        if self.left.fetch_update(Ordering::Relaxed, Ordering::Relaxed, |left| left.checked_sub(1)).is_ok() {
            out.iter_mut().for_each(|v| *v *= 1e6);
        }
    }
    fn mean(&self) -> Vec3 {
        self.wind.mean()
    }
    fn mean_at(&self, position: Vec3) -> Vec3 {
        self.wind.mean_at(position)
    }
    fn period(&self) -> Option<f64> {
        None
    }
}

/// A failed step leaves no trace: the plant moves as if it had taken the two halves at once.
#[test]
fn a_repeated_step_starts_from_the_state_before_it() {
    let h = 1.0 / 384.0;
    let wind = || GustWind::new(GustWindOptions { direction: Vec3::X, speed: 4.0, ..GustWindOptions::default() });
    let moving = || {
        let mut plant = rod_plant(&Trs::IDENTITY).with_wind(Some(Arc::new(wind())));
        (0..40).for_each(|k| plant.step(f64::from(k) * h, h).expect("steps"));
        plant
    };
    let t = 40.0 * h;
    // A whole step takes two samples, one for wood and one for leaves.
    let mut failing = moving();
    failing.wind = Some(Arc::new(FailsFirst { wind: wind(), left: AtomicU32::new(2) }));
    failing.step(t, h).expect("its halves succeed");
    let mut halved = moving();
    halved.rods.reset_history();
    halved.advance_in_substeps(t, h, 2).expect("steps");
    halved.rods.reset_history();
    halved.update_leaf_motion(Some(h));
    // That the whole step fails shows in the difference from a plant that takes it.
    let mut whole = moving();
    whole.step(t, h).expect("steps");
    let poses = |plant: &RodPlant| (0..6).map(|leaf| plant.leaf_pose(leaf)).collect::<Vec<_>>();
    assert_ne!(poses(&failing), poses(&whole));
    assert_eq!(poses(&failing), poses(&halved));
    // Vortices and restoring springs, too, continue from the same state.
    for k in 1..40 {
        let t = t + f64::from(k) * h;
        failing.step(t, h).expect("steps");
        halved.step(t, h).expect("steps");
    }
    assert_eq!(poses(&failing), poses(&halved));
}
