use glam::{DQuat, DVec2};

use super::*;
use crate::rain::emitter::{DropSizes, IntensityEnvelope, RainfallParams};
use crate::rain::leaf::surface::{LeafSurface, tests::flat};
use crate::rain::leaf::veins::{VeinMap, tests::vein};
use crate::rain::params::DropParams;
use crate::rain::target::StaticPlant;
use osier_base::geometry::Bounds;
use osier_base::math;

/// A flat leaf of 80 x 40 mm whose tip points down by an angle from level, its upper side up.
fn hanging_pose(tilt: f64) -> (DVec3, DQuat) {
    let turn = DQuat::from_rotation_x(-std::f64::consts::FRAC_PI_2 - tilt);
    (DVec3::new(0.0, 1.0, 0.0), turn)
}

fn simulation(tilts: &[f64], params: DropParams, emitter: Option<RainEmitter>) -> RainSimulation {
    let blade = Arc::new(LeafSurface::new(&flat(0.08, 0.04, 6)).expect("a blade"));
    let collider = Arc::new(LeafCollider::new(&blade));
    let place = |(i, tilt): (usize, &f64)| {
        let (p, q) = hanging_pose(*tilt);
        (p - DVec3::Y * (0.06 * i as f64) - DVec3::Z * (0.02 * i as f64), q)
    };
    let places: Vec<(DVec3, DQuat)> = tilts.iter().enumerate().map(place).collect();
    let leaves = (0..tilts.len())
        .map(|i| {
            let leaf = RainLeaf::new(Arc::clone(&blade), 1.0, i as u64);
            (leaf, LeafAttachment { plant: 0, leaf: i, collider: Arc::clone(&collider) })
        })
        .collect();
    let stem = WoodSegment { ends: [DVec3::ZERO, DVec3::Y], radii: [0.005, 0.003] };
    RainSimulation::new(RainConfig {
        params,
        emitter,
        plants: vec![Box::new(StaticPlant::new(&places, vec![stem]))],
        leaves,
        wind: None,
        ground: Box::new(0.0),
    })
}

fn uniform_params() -> DropParams {
    DropParams { pinning_noise: 0.0, ..DropParams::default() }
}

/// Slope, degrees, at which a drop of a volume begins to run, by steps of 0.1 degrees.
fn slip_angle(volume: f64) -> f64 {
    for k in 10..900 {
        let tilt = f64::from(k) * 0.1;
        let mut simulation = simulation(&[tilt.to_radians()], uniform_params(), None);
        simulation.deposit_drop(0, DVec2::new(0.5, 0.5), DVec3::ZERO, volume);
        (0..6).for_each(|_| simulation.step(0.004).expect("stiff"));
        if simulation.leaves()[0].drops[0].v.length() > 0.0 {
            return tilt;
        }
    }
    90.0
}

#[test]
fn drops_slip_where_furmidge_says() {
    let params = uniform_params();
    let w = params.wetting;
    for volume in [8e-9, 15e-9, 30e-9] {
        let a = w.cap(volume, 1.0).a;
        // The drop runs as soon as its weight along the slope exceeds what both rims hold.
        let held = 2.0 * a * WATER_SURFACE_TENSION * (math::cos(w.receding) - math::cos(w.advancing));
        let wanted = held / (WATER_DENSITY * 9.81 * volume);
        let found = math::sin(slip_angle(volume).to_radians());
        assert!((found - wanted).abs() < 0.01 * wanted + 0.0018, "{volume}: {found} {wanted}");
    }
    assert!((slip_angle(19.1e-9) - 30.0).abs() < 1.5, "{}", slip_angle(19.1e-9));
}

#[test]
fn a_running_drop_reaches_the_tip_hangs_and_falls() {
    let mut simulation = simulation(&[0.7], uniform_params(), None);
    simulation.deposit_drop(0, DVec2::new(0.5, 0.3), DVec3::ZERO, 60e-9);
    let (mut fell, mut hung) = (0.0_f64, false);
    for _ in 0..4000 {
        simulation.step(0.002).expect("stiff");
        hung |= simulation.leaves()[0].drops.iter().any(|d| d.pendant.is_some());
        fell = fell.max(simulation.water_budget().ground);
        assert!(simulation.water_budget().error() < 1e-12, "{:?}", simulation.water_budget());
    }
    assert!(hung);
    assert!(fell > 10e-9, "{:?}", simulation.water_budget());
    let DropCounters { pendants, detachments, impacts, .. } = simulation.counters();
    assert!(pendants >= 1 && detachments >= 1 && impacts == 0, "{pendants} {detachments} {impacts}");
}

#[test]
fn a_splash_keeps_all_water() {
    let mut simulation = simulation(&[0.2], DropParams { splash: 0.3, ..uniform_params() }, None);
    let (volume, air) = (crate::rain::fall::sphere_volume(4e-3), simulation.next_id());
    simulation.emitted += volume;
    let p = simulation.poses[0].position + DVec3::new(0.0, 0.05, -0.03);
    simulation.falling.push(FallingDrop {
        id: air,
        p,
        v: DVec3::NEG_Y * 8.0,
        volume,
        ignore_leaf: None,
        spawn_offset: 0.0,
    });
    while simulation.leaves()[0].drops.is_empty() {
        simulation.step(0.001).expect("stiff");
        assert!(simulation.time() < 0.1, "it missed the leaf");
    }
    let flew: f64 = simulation.falling_drops().iter().map(|d| d.volume).sum();
    assert!((6..=20).contains(&simulation.falling_drops().len()));
    assert!((flew / (0.3 * volume) - 1.0).abs() < 1e-12);
    assert!(((flew + simulation.leaves()[0].volume()) / volume - 1.0).abs() < 1e-12);
}

#[test]
fn beads_that_a_tail_leaves_have_its_water() {
    let mut simulation = simulation(&[0.25], DropParams { bead_probability: 1.0, ..uniform_params() }, None);
    for u in [0.2, 0.5, 0.8] {
        simulation.deposit_drop(0, DVec2::new(u, 0.2), DVec3::Y * 0.6, 30e-9);
    }
    for _ in 0..1500 {
        simulation.step(0.002).expect("stiff");
        assert!(simulation.water_budget().error() < 1e-12, "{:?}", simulation.water_budget());
    }
    let beads: Vec<RainEvent> =
        simulation.take_events().into_iter().filter(|e| e.kind == DropEventKind::Bead).collect();
    assert!(beads.len() >= 3 && simulation.counters().beads == beads.len() as u64, "{beads:?}");
    assert!(beads.iter().all(|b| b.volume > 0.0 && b.other.is_some_and(|of| of <= 3)));
}

#[test]
fn running_drops_follow_veins() {
    // A vein that leads aside takes a drop along for a part of its way.
    let ends = |veins: Option<VeinMap>| {
        let blade = Arc::new(LeafSurface::new(&flat(0.08, 0.04, 6)).expect("a blade").with_maps(None, veins));
        let mut simulation = simulation(&[1.0], uniform_params(), None);
        simulation.leaves[0] = RainLeaf::new(blade, 1.0, 0);
        simulation.deposit_drop(0, DVec2::new(0.35, 0.1), DVec3::ZERO, 25e-9);
        while simulation.leaves()[0].drops.first().is_some_and(|d| d.uv.y < 0.6) {
            simulation.step(0.001).expect("stiff");
            assert!(simulation.time() < 5.0, "it lies");
        }
        simulation.leaves()[0].drops.first().expect("still on the leaf").uv.x
    };
    let (with, without) = (ends(Some(vein(|v| 0.32 + 0.35 * v))), ends(None));
    assert!(without - 0.35 < 1e-6 && with > 0.37, "{with} {without}");
}

#[test]
fn drops_that_touch_are_one_with_all_their_water_and_momentum() {
    let mut simulation = simulation(&[0.0], uniform_params(), None);
    simulation.deposit_drop(0, DVec2::new(0.5, 0.5), DVec3::new(0.0, 0.25, 0.0), 9e-9);
    simulation.deposit_drop(0, DVec2::new(0.5, 0.56), DVec3::ZERO, 3e-9);
    for _ in 0..400 {
        let before = simulation.leaves()[0].clone();
        simulation.step(0.002).expect("stiff");
        let now = &simulation.leaves()[0];
        if now.drops.len() < before.drops.len() {
            let m = |drops: &[SurfaceDrop]| drops.iter().fold(DVec3::ZERO, |s, d| s + d.v * d.volume);
            assert!((now.volume() / 12e-9 - 1.0).abs() < 1e-12);
            // Momentum right after merging is that of both, less the friction of one step.
            assert!(m(&now.drops).length() <= m(&before.drops).length());
            assert_eq!(now.drops[0].id, 1);
            return;
        }
    }
    panic!("they never met");
}

fn heavy_rain(seed: u64) -> RainfallParams {
    RainfallParams {
        seed,
        intensity: 100.0 / 3.6e6,
        size: DropSizes::MarshallPalmer,
        total: None,
        envelope: IntensityEnvelope::Constant,
        jitter: 0.2,
        duration: 10.0,
        g: 9.81,
    }
}

fn bounds() -> Bounds {
    Bounds { min: Vec3::new(-0.03, 0.7, -0.09), max: Vec3::new(0.03, 1.0, 0.02) }
}

#[test]
fn no_water_is_lost_in_ten_seconds_of_heavy_rain() {
    let params = DropParams { splash: 0.3, ..DropParams::default() };
    let emitter = RainEmitter::new(heavy_rain(3), bounds(), None);
    let mut simulation = simulation(&[0.3, 0.6, 1.0, -0.4], params, Some(emitter));
    for k in 0..2400 {
        simulation.step(1.0 / 240.0).expect("stiff");
        if k % 10 == 0 {
            assert!(simulation.water_budget().error() < 1e-9, "{k}: {:?}", simulation.water_budget());
        }
    }
    let l = simulation.water_budget();
    assert!(l.ground > 0.0 && l.wood > 0.0 && l.leaves > 0.0 && l.pendants > 0.0, "{l:?}");
}

#[test]
fn any_number_of_threads_gives_the_same_rain() {
    let run = || {
        let emitter = RainEmitter::new(heavy_rain(4), bounds(), None);
        let mut simulation = simulation(&[0.3, 0.6, 1.0], DropParams::default(), Some(emitter));
        (0..400).for_each(|_| simulation.step(1.0 / 200.0).expect("stiff"));
        let drops = simulation.leaves().iter().flat_map(|l| &l.drops);
        let bits: Vec<u64> =
            drops.flat_map(|d| [d.id, d.uv.x.to_bits(), d.uv.y.to_bits(), d.volume.to_bits()]).collect();
        (bits, simulation.falling_drops().len())
    };
    let on = |n: usize| osier_base::par::on_threads(n, run);
    let one = on(1);
    assert!(!one.0.is_empty());
    for n in [2, 5] {
        assert_eq!(on(n), one);
    }
}

#[test]
fn what_is_too_heavy_falls_from_below_a_leaf() {
    // Upside down by more than a drop's weight can hang: it falls.
    let mut simulation = simulation(&[3.0], uniform_params(), None);
    simulation.deposit_drop(0, DVec2::new(0.5, 0.5), DVec3::ZERO, 400e-9);
    (0..20).for_each(|_| simulation.step(0.002).expect("stiff"));
    assert!(simulation.leaves()[0].drops.is_empty());
}

#[test]
fn the_event_edge_is_recorded_once_before_a_drop_hangs() {
    let mut simulation = simulation(&[0.5], uniform_params(), None);
    simulation.deposit_drop(0, DVec2::new(0.5, 0.3), DVec3::ZERO, 60e-9);
    let mut events = Vec::new();
    while events.iter().all(|e: &RainEvent| e.kind != DropEventKind::Hung) {
        simulation.step(0.002).expect("stiff");
        events.extend(simulation.take_events());
        assert!(events.len() < 20 && simulation.leaves()[0].volume() > 0.0, "{events:?}");
    }
    let edges: Vec<usize> = (0..events.len()).filter(|i| events[*i].kind == DropEventKind::Edge).collect();
    assert_eq!(edges.len(), 1, "{events:?}");
    let edge = events[edges[0]];
    assert_eq!(edge.leaf, Some(0));
    // The margin at the tip is 80 mm from the stalk; 0.3 base radii are less than 1.5 mm.
    let (at, _) = hanging_pose(0.5);
    assert!((edge.p.distance(at) - 0.08).abs() < 1.5e-3, "{edge:?}");
    assert!(edges[0] < events.len() - 1 && (edge.volume - 60e-9).abs() < 1e-12);
}
