use glam::{DQuat, DVec2};

use super::*;
use crate::rain::emitter::{DropSizes, IntensityEnvelope, RainfallParams};
use crate::rain::leaf::alpha_mask::AlphaMask;
use crate::rain::leaf::surface::{LeafSurface, tests::flat};
use crate::rain::leaf::veins::{VeinMap, tests::vein};
use crate::rain::params::{DropParams, ImpactImpulseLaw};
use crate::rain::target::StillRainPlant;
use osier_base::geometry::Bounds;
use osier_base::math;
use osier_base::physics::WATER_SURFACE_TENSION;
use osier_wind::TimeNoise;

/// Place of a leaf whose tip points down by the angle `tilt`, rad, from the horizontal, with the upper side up.
fn hanging_pose(tilt: f64) -> (DVec3, DQuat) {
    let turn = DQuat::from_rotation_x(-std::f64::consts::FRAC_PI_2 - tilt);
    (DVec3::new(0.0, 1.0, 0.0), turn)
}

fn simulation(tilts: &[f64], params: DropParams, emitter: Option<RainEmitter>) -> RainSimulation {
    let stem = WoodSegment { ends: [DVec3::ZERO, DVec3::Y], radii: [0.005, 0.003] };
    let plant = StillRainPlant::new(&places(tilts), vec![stem]);
    simulation_of(Box::new(plant), params, emitter)
}

/// Places of leaves, one below the other, at angles from the horizontal, rad.
fn places(tilts: &[f64]) -> Vec<(DVec3, DQuat)> {
    let place = |(i, tilt): (usize, &f64)| {
        let (p, q) = hanging_pose(*tilt);
        (p - DVec3::Y * (0.06 * i as f64) - DVec3::Z * (0.02 * i as f64), q)
    };
    tilts.iter().enumerate().map(place).collect()
}

fn simulation_of(plant: Box<dyn RainPlant>, params: DropParams, emitter: Option<RainEmitter>) -> RainSimulation {
    let blade = Arc::new(LeafSurface::new(&flat(0.08, 0.04, 6)).expect("a blade"));
    let collider = Arc::new(LeafCollider::new(&blade));
    let leaves = (0..plant.leaf_count())
        .map(|i| {
            let leaf = RainLeaf::new(Arc::clone(&blade), 1.0, i as u64);
            (leaf, LeafOnPlant { plant: 0, leaf: i, collider: Arc::clone(&collider) })
        })
        .collect();
    RainSimulation::new(RainConfig {
        params,
        emitter,
        plants: vec![plant],
        leaves,
        wind: None,
        ground: Arc::new(0.0),
        solids: RainSolids::default(),
    })
}

fn uniform_params() -> DropParams {
    DropParams { retention_variation: 0.0, ..DropParams::default() }
}

/// Slope, degrees, at which a drop of `volume`, m^3, begins to run, in steps of 0.1 degrees.
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

/// A drop that falls through a hole is where it is without the leaf, at each step.
#[test]
fn a_hole_does_not_hold_a_drop_up() {
    let blade = || LeafSurface::new(&flat(0.08, 0.04, 6)).expect("a blade");
    let with_hole = blade().with_maps(Some(AlphaMask::of_a_hole()), None);
    let fall = |leaf: Option<LeafSurface>| -> Vec<DVec3> {
        let tilts: &[f64] = if leaf.is_some() { &[0.0] } else { &[] };
        let mut simulation = simulation(tilts, uniform_params(), None);
        simulation.leaves.extend(leaf.map(|blade| RainLeaf::new(Arc::new(blade), 1.0, 0)));
        simulation.leaves.drain(..tilts.len());
        simulation.falling.push(FallingDrop::new(1, DVec3::new(0.003, 1.05, -0.04), DVec3::NEG_Y * 3.0, 1e-9));
        let step = |_| {
            simulation.step(0.004).expect("stiff");
            simulation.falling.first().map(|drop| drop.p)
        };
        (0..12).map_while(step).collect()
    };
    let free = fall(None);
    assert!(free.len() == 12 && free[11].y < 0.95, "{free:?}");
    assert!(fall(Some(blade())).len() < 12, "a leaf without a hole stops it");
    assert_eq!(fall(Some(with_hole)), free);
}

#[test]
fn drops_slip_where_furmidge_says() {
    let params = uniform_params();
    let w = params.wetting;
    for volume in [8e-9, 15e-9, 30e-9] {
        let a = w.cap(volume).a;
        // The drop runs as soon as its weight along the slope exceeds the retention of its contact line.
        let held = 2.0 * a * WATER_SURFACE_TENSION * (math::cos(w.receding) - math::cos(w.advancing));
        let wanted = held / (WATER_DENSITY * 9.81 * volume);
        let found = math::sin(slip_angle(volume).to_radians());
        assert!((found - wanted).abs() < 0.01 * wanted + 0.0018, "{volume}: {found} {wanted}");
    }
    assert!((slip_angle(19.1e-9) - 30.0).abs() < 1.5, "{}", slip_angle(19.1e-9));
}

/// Time steps to compare: frame rates, frames per second, and steps per frame.
const CLOCKS: [(f64, f64); 7] =
    [(24.0, 8.0), (24.0, 4.0), (24.0, 64.0), (24.0, 256.0), (12.0, 4.0), (480.0, 8.0), (1000.0, 32.0)];

/// Runs a simulation until `seconds`, s, with one of [`CLOCKS`].
fn run_for(simulation: &mut RainSimulation, seconds: f64, (fps, substeps): (f64, f64)) {
    let h = 1.0 / (fps * substeps);
    while simulation.time() < seconds - 0.5 * h {
        simulation.step(h).expect("stiff");
    }
}

#[test]
fn a_drop_slides_at_the_same_angle_for_any_time_step() {
    // The limit of 19.5 mm^3 is 30 degrees.
    for clock in CLOCKS {
        for (tilt, slides) in [(25.0_f64, false), (29.0, false), (31.0, true), (35.0, true), (75.0, true)] {
            let mut simulation = simulation(&[tilt.to_radians()], uniform_params(), None);
            simulation.deposit_drop(0, DVec2::new(0.5, 0.3), DVec3::ZERO, 19.5e-9);
            run_for(&mut simulation, 0.05, clock);
            let moved = (simulation.leaves()[0].drops[0].uv.y - 0.3) * 0.08;
            assert_eq!(moved > 1e-5, slides, "{clock:?}, {tilt} degrees: {moved}");
        }
    }
}

#[test]
fn without_hysteresis_every_drop_slides() {
    let mut params = uniform_params();
    params.wetting.receding = params.wetting.contact_angle;
    params.wetting.advancing = params.wetting.contact_angle;
    for clock in CLOCKS {
        let mut simulation = simulation(&[1.0_f64.to_radians()], params.clone(), None);
        simulation.deposit_drop(0, DVec2::new(0.5, 0.3), DVec3::ZERO, 1e-9);
        run_for(&mut simulation, 0.5, clock);
        // v = g sin(1) tau (1 - e^(-t/tau)), s its integral: 3.85 mm.
        let moved = (simulation.leaves()[0].drops[0].uv.y - 0.3) * 0.08;
        assert!((moved / 3.852e-3 - 1.0).abs() < 0.01, "{clock:?}: {moved}");
    }
}

#[test]
fn runs_do_not_depend_on_the_time_step() {
    // Straight down; at first across the slope; and over pinning that varies.
    let cases = [
        (uniform_params(), DVec3::ZERO, 0.25),
        (uniform_params(), DVec3::X * 0.15, 0.25),
        (DropParams::default(), DVec3::new(-0.1, 0.05, 0.0), 0.25),
    ];
    for (params, v, seconds) in cases {
        let ends = CLOCKS.map(|clock| {
            let mut simulation = simulation(&[1.1], params.clone(), None);
            simulation.deposit_drop(0, DVec2::new(0.5, 0.1), v, 14e-9);
            run_for(&mut simulation, seconds, clock);
            let drop = &simulation.leaves()[0].drops[0];
            assert!(drop.pendant.is_none() && !drop.at_margin);
            (drop.uv * DVec2::new(0.04, 0.08), drop.v)
        });
        let (at, speed) = ends[3];
        assert!(at.y - 0.008 > 0.02, "{at}");
        for ((p, v), clock) in ends.iter().zip(CLOCKS) {
            assert!(p.distance(at) < 1e-3 && (*v - speed).length() < 0.03 * speed.length(), "{clock:?}: {ends:?}");
        }
    }
}

/// A free rigid plate: its mass, the water on it, and the forces on it in the next step.
#[derive(Debug)]
struct FreePlate {
    mass: f64,
    water: f64,
    pose: LeafPose,
    impulse: DVec3,
    force: DVec3,
}

impl FreePlate {
    fn boxed(mass: f64, tilt: f64) -> Box<Self> {
        let (p, q) = hanging_pose(tilt);
        let pose = LeafPose { velocity: DVec3::new(0.1, -0.2, 0.05), ..LeafPose::at_rest(p, q) };
        Box::new(Self { mass, water: 0.0, pose, impulse: DVec3::ZERO, force: DVec3::ZERO })
    }
}

impl RainPlant for FreePlate {
    fn leaf_count(&self) -> usize {
        1
    }

    fn leaf_pose(&self, _: usize) -> LeafPose {
        self.pose
    }

    fn inverse_effective_mass(&self, _: usize, _: DVec3, _: DVec3) -> f64 {
        1.0 / (self.mass + self.water)
    }

    fn apply_impulse(&mut self, _: usize, _: DVec3, impulse: DVec3) {
        self.impulse += impulse;
    }

    fn apply_force(&mut self, _: usize, _: DVec3, force: DVec3) {
        self.force += force;
    }

    fn set_attached_mass(&mut self, _: usize, mass: f64, _: DVec3) {
        self.water = mass;
    }

    fn step(&mut self, _: f64, h: f64) -> Result<()> {
        let before = self.pose.velocity;
        self.pose.velocity += (self.impulse + self.force * h) / (self.mass + self.water);
        self.pose.position += self.pose.velocity * h;
        self.pose.acceleration = (self.pose.velocity - before) / h;
        (self.impulse, self.force) = (DVec3::ZERO, DVec3::ZERO);
        Ok(())
    }
}

/// A simulation of one leaf on the given plant.
fn simulation_on(target: Box<dyn RainPlant>, params: DropParams) -> RainSimulation {
    let blade = Arc::new(LeafSurface::new(&flat(0.08, 0.04, 6)).expect("a blade"));
    let collider = Arc::new(LeafCollider::new(&blade));
    RainSimulation::new(RainConfig {
        params,
        emitter: None,
        plants: vec![target],
        leaves: vec![(RainLeaf::new(blade, 1.0, 0), LeafOnPlant { plant: 0, leaf: 0, collider })],
        wind: None,
        ground: Arc::new(-100.0),
        solids: RainSolids::default(),
    })
}

/// Adds a falling drop to a simulation.
fn drop_in_air(simulation: &mut RainSimulation, p: DVec3, v: DVec3, volume: f64) {
    let id = simulation.next_id();
    simulation.emitted += volume;
    simulation.falling.push(FallingDrop {
        id,
        p,
        v,
        volume,
        ignore_leaf: None,
        spawn_offset: 0.0,
        wind: HeldWind::default(),
    });
}

/// Momentum of all water, and of a plate of `mass`, kg.
fn total_momentum(simulation: &RainSimulation, mass: f64) -> DVec3 {
    let pose = simulation.poses()[0];
    let air = simulation.falling_drops().iter().map(|d| d.v * (WATER_DENSITY * d.volume));
    let leaf = &simulation.leaves()[0];
    let on_leaf = leaf.drops.iter().map(|d| (pose.velocity + pose.orientation * d.v) * (WATER_DENSITY * d.volume));
    air.chain(on_leaf).fold(pose.velocity * mass, |sum, p| sum + p)
}

/// Momentum that air at rest will take from falling drops in the next step of `h` seconds, without gravity.
fn momentum_for_air(simulation: &RainSimulation, h: f64) -> DVec3 {
    let taken = |d: &FallingDrop| d.v - step_velocity(d.v, d.volume, 0.0, DVec3::ZERO, h);
    simulation.falling_drops().iter().fold(DVec3::ZERO, |sum, d| sum + taken(d) * (WATER_DENSITY * d.volume))
}

#[test]
fn leaf_drop_and_splash_have_the_momentum_of_before() {
    let plate_mass = 2e-4;
    let volume = crate::rain::fall::sphere_volume(3e-3);
    let impacts = [
        ("stays", DropParams { g: 0.0, ..uniform_params() }),
        ("splashes", DropParams { g: 0.0, splash: 0.4, ..uniform_params() }),
        ("bounces", DropParams { g: 0.0, impact: ImpactImpulseLaw::Momentum { restitution: 0.5 }, ..uniform_params() }),
    ];
    for (what, params) in impacts {
        for (tilt, slant) in [(0.2, 0.0), (1.0, 0.0), (1.0, 0.6), (-0.5, -0.8)] {
            // Without gravity there is no weight: only the drop acts on the plate, and the air on falling drops.
            let mut simulation = simulation_on(FreePlate::boxed(plate_mass, tilt), params.clone());
            let pose = simulation.poses()[0];
            let (middle, v) = (pose.to_world(DVec3::Y * 0.03, 1.0), DVec3::new(1.0, -6.0, slant * 6.0));
            drop_in_air(&mut simulation, middle - v * 0.004, v, volume);
            let before = total_momentum(&simulation, plate_mass);
            let h = 1.0 / 192.0;
            // Until the water on the leaf is at rest, hangs or has left: reactions of a step act in the next one.
            let mut taken_by_air = DVec3::ZERO;
            for _ in 0..400 {
                taken_by_air += momentum_for_air(&simulation, h);
                simulation.step(h).expect("free");
            }
            let after = total_momentum(&simulation, plate_mass) + taken_by_air;
            assert!(simulation.counters().impacts >= 1, "{what}, {tilt}");
            let error = (after - before).length() / before.length();
            assert!(error < 1e-9, "{what}, {tilt}, {slant}: {error} of {before}");
            // The plate has been accelerated, also along its surface.
            let pushed = simulation.poses()[0].velocity - pose.velocity;
            assert!(pushed.length() > 0.05, "{what}, {tilt}: {pushed}");
            let (airborne, on_leaf) = (simulation.falling_drops().len(), simulation.leaves()[0].drops.len());
            match what {
                "splashes" => assert!(airborne > 50),
                "bounces" => assert!(airborne == 1 && on_leaf == 0, "{airborne} {on_leaf}"),
                _ => assert!(airborne + on_leaf == 1),
            }
        }
    }
}

/// An exaggerated impulse is the same one in the events, in the counters and on the leaf.
#[test]
fn events_and_counters_tell_the_impulse_that_a_leaf_receives() {
    let received = |impulse_factor: f64| {
        let params = DropParams { g: 0.0, tangent_keep: 0.0, impulse_factor, ..uniform_params() };
        let mut simulation = simulation_on(FreePlate::boxed(1e-3, 0.2), params);
        let (middle, v) = (simulation.poses()[0].to_world(DVec3::Y * 0.03, 1.0), DVec3::new(1.0, -6.0, 0.0));
        drop_in_air(&mut simulation, middle - v * 0.004, v, crate::rain::fall::sphere_volume(3e-3));
        while simulation.counters().impacts == 0 {
            simulation.step(1.0 / 192.0).expect("free");
            assert!(simulation.time() < 0.1, "it missed the plate");
        }
        let told = simulation.take_events().iter().map(|event| event.impulse).fold(0.0, f64::max);
        assert!(told > 0.0 && (told - simulation.counters().max_impulse).abs() <= 0.0, "{impulse_factor}: {told}");
        told
    };
    let (physical, doubled) = (received(1.0), received(2.0));
    assert!((doubled / physical - 2.0).abs() < 1e-9, "{physical} {doubled}");
}

/// Momentum of rods, with the bodies and the water on them.
fn momentum_of_rods(rods: &crate::rods::RodSystem) -> DVec3 {
    let of_section = |i: usize| {
        let p = rods.apply_mass(i, &rods.v[i], false);
        p.chunks(3).fold(DVec3::ZERO, |sum, corner| sum + DVec3::from_slice(corner))
    };
    (0..rods.len()).map(of_section).fold(DVec3::ZERO, |sum, p| sum + p)
}

#[test]
fn rods_receive_the_momentum_that_a_drop_and_its_splash_have_lost() {
    use crate::rods::RodPlant;
    use crate::rods::plant::tests::{SHORT, plant_params, twig};
    let mut wood = plant_params();
    // Stiffness damping would transmit an impulse to the clamp within the step.
    wood.wood.damping = 0.0;
    let place = osier_scene::Trs::translation(Vec3::new(12.0, -1.04, 3.0));
    let blade = Arc::new(LeafSurface::new(&flat(0.07, 0.04, 4)).expect("a blade"));
    let collider = Arc::new(LeafCollider::new(&blade));
    let params = DropParams { g: 0.0, tangent_keep: 0.0, splash: 0.3, ..uniform_params() };
    let made = || {
        let attachment = LeafOnPlant { plant: 0, leaf: 1, collider: Arc::clone(&collider) };
        RainSimulation::new(RainConfig {
            params: params.clone(),
            emitter: None,
            plants: vec![Box::new(RodPlant::new(&twig(), &place, &wood, "twig"))],
            leaves: vec![(RainLeaf::new(Arc::clone(&blade), 1.0, 0), attachment)],
            wind: None,
            ground: Arc::new(-100.0),
            solids: RainSolids::default(),
        })
    };
    let (mut struck, mut still) = (made(), made());
    let pose = struck.poses()[0];
    let (at, v) = (pose.to_world(DVec3::new(0.004, 0.04, 0.0), 1.0), DVec3::new(1.5, -5.0, 1.0));
    let volume = crate::rain::fall::sphere_volume(3e-3);
    drop_in_air(&mut struck, at - v * 0.002, v, volume);
    let mut taken_by_air = DVec3::ZERO;
    while struck.counters().impacts == 0 {
        taken_by_air += momentum_for_air(&struck, 1.0 / 384.0);
        for simulation in [&mut struck, &mut still] {
            simulation.step(1.0 / 384.0).expect("steps");
            assert!(simulation.time() < 0.1, "it missed the leaf");
        }
    }
    // Steps so short that springs do not act: the difference of momentum of both twigs comes from the drop.
    for simulation in [&mut struck, &mut still] {
        for _ in 0..40 {
            taken_by_air += momentum_for_air(simulation, SHORT);
            simulation.step(SHORT).expect("steps");
        }
    }
    let of_plant = |s: &RainSimulation| momentum_of_rods(s.plants()[0].posed_rods().expect("rods"));
    let gained = of_plant(&struck) - of_plant(&still);
    let flying = struck.falling_drops().iter().fold(DVec3::ZERO, |sum, d| sum + d.v * (WATER_DENSITY * d.volume));
    let brought = v * (WATER_DENSITY * volume);
    assert!(struck.falling_drops().len() > 20 && struck.leaves()[0].drops.len() == 1);
    let lost = gained + flying + taken_by_air - brought;
    // The iteration of the implicit step ends at an update that leaves about 4e-8.
    assert!(lost.length() < 1e-7 * brought.length(), "{lost} of {brought}");
}

/// A leaf that does not move and stores the forces of the last step.
#[derive(Debug)]
struct Scales {
    plant: StillRainPlant,
    force: Arc<std::sync::Mutex<DVec3>>,
    weight: f64,
}

impl RainPlant for Scales {
    fn leaf_count(&self) -> usize {
        1
    }

    fn leaf_pose(&self, leaf: usize) -> LeafPose {
        self.plant.leaf_pose(leaf)
    }

    fn inverse_effective_mass(&self, _: usize, _: DVec3, _: DVec3) -> f64 {
        0.0
    }

    fn apply_impulse(&mut self, _: usize, _: DVec3, _: DVec3) {}

    fn apply_force(&mut self, _: usize, _: DVec3, force: DVec3) {
        *self.force.lock().expect("one thread") += force;
    }

    fn set_attached_mass(&mut self, _: usize, mass: f64, _: DVec3) {
        *self.force.lock().expect("one thread") += DVec3::NEG_Y * (self.weight * mass);
    }

    fn step(&mut self, _: f64, _: f64) -> Result<()> {
        *self.force.lock().expect("one thread") = DVec3::ZERO;
        Ok(())
    }
}

/// A leaf on scales, and the force on it in the last step.
fn weighed(tilt: f64, params: DropParams) -> (RainSimulation, Arc<std::sync::Mutex<DVec3>>) {
    let force = Arc::new(std::sync::Mutex::new(DVec3::ZERO));
    let plant = StillRainPlant::new(&[hanging_pose(tilt)], Vec::new());
    let scales = Scales { plant, force: Arc::clone(&force), weight: params.g };
    (simulation_on(Box::new(scales), params), force)
}

#[test]
fn a_running_drop_loads_its_leaf_by_its_normal_weight_and_its_resistance() {
    let (tilt, volume) = (1.0_f64, 14e-9);
    let params = DropParams { friction_coefficient: 0.05, tail_amount: 0.0, ..uniform_params() };
    let (mut simulation, force) = weighed(tilt, params.clone());
    simulation.deposit_drop(0, DVec2::new(0.5, 0.1), DVec3::ZERO, volume);
    let pose = simulation.poses()[0];
    let (downhill, normal) = (pose.orientation * DVec3::Y, pose.orientation * DVec3::Z);
    let m = WATER_DENSITY * volume;
    let w = params.wetting;
    let width = 2.0 * w.cap(volume).a;
    let mut seen = 0;
    for k in 0..60 {
        let speed = simulation.leaves()[0].drops[0].v.length();
        simulation.step(1e-3).expect("stiff");
        let drop = &simulation.leaves()[0].drops[0];
        let (speed, stretch) = ((speed + drop.v.length()) / 2.0, drop.stretch());
        let retention = WATER_SURFACE_TENSION * width / stretch * (math::cos(w.receding) - math::cos(w.advancing));
        let g2 = m * params.g * normal.y.abs();
        let resistance = 0.7 * retention + 0.05 * g2 + m * speed / params.velocity_decay_time;
        let load = *force.lock().expect("one thread");
        assert!((load.dot(normal) / -g2 - 1.0).abs() < 1e-9, "{k}: {load} {g2}");
        if k > 0 {
            assert!((load.dot(downhill) / resistance - 1.0).abs() < 0.02, "{k}: {load} {resistance}");
            seen += 1;
        }
    }
    assert!(seen > 50 && simulation.leaves()[0].drops[0].v.length() > 0.1);
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
fn what_falls_from_a_margin_is_tates_share() {
    // On Earth, and on the Moon, where drops are larger.
    for (g, fed) in [(9.81, 8e-9), (1.62, 30e-9)] {
        let mut params = DropParams { g, ..uniform_params() };
        params.wetting.capillary_length = crate::rain::params::capillary_length(g);
        let mut simulation = simulation(&[0.8], params, None);
        let mut shares = Vec::new();
        let mut radius: Option<f64> = None;
        for k in 0..6000 {
            if k % 200 == 0 {
                simulation.deposit_drop(0, DVec2::new(0.5, 0.85), DVec3::Y * 0.1, fed);
            }
            simulation.step(0.005).expect("stiff");
            let fell =
                simulation.take_events().into_iter().filter(|e| e.kind == DropEventKind::Fell && e.other.is_some());
            // 2 pi R gamma / (rho g), where R is the radius of attachment before the detachment.
            let whole = |r: f64| std::f64::consts::TAU * r * WATER_SURFACE_TENSION / (WATER_DENSITY * g);
            shares.extend(fell.filter_map(|e| radius.map(|r| e.volume / whole(r))));
            radius = simulation.leaves()[0].drops.iter().find_map(|d| d.pendant).map(|a| a.radius);
        }
        assert!(!shares.is_empty() && shares.iter().all(|s| (0.60..0.80).contains(s)), "{g}: {shares:?}");
    }
}

#[test]
fn a_splash_keeps_all_water() {
    let mut simulation = simulation(&[0.2], DropParams { splash: 0.3, ..uniform_params() }, None);
    let volume = crate::rain::fall::sphere_volume(4e-3);
    let p = simulation.poses[0].position + DVec3::new(0.0, 0.05, -0.03);
    drop_in_air(&mut simulation, p, DVec3::NEG_Y * 8.0, volume);
    while simulation.leaves()[0].drops.is_empty() {
        simulation.step(0.001).expect("stiff");
        assert!(simulation.time() < 0.1, "it missed the leaf");
    }
    let flew: f64 = simulation.falling_drops().iter().map(|d| d.volume).sum();
    // Number of droplets of 0.2 to 0.5 mm with a volume of 10 mm^3.
    assert!((300..=MAX_SPLASH_DROPLETS).contains(&simulation.falling_drops().len()));
    for droplet in simulation.falling_drops() {
        assert!((1.9e-4..5.6e-4).contains(&sphere_diameter(droplet.volume)), "{}", droplet.volume);
    }
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
    // A drop follows a vein that leads sideways for a part of its path.
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
    let (mut simulation, force) = weighed(0.0, uniform_params());
    simulation.deposit_drop(0, DVec2::new(0.5, 0.5), DVec3::new(0.0, 0.25, 0.0), 9e-9);
    simulation.deposit_drop(0, DVec2::new(0.5, 0.56), DVec3::ZERO, 3e-9);
    for _ in 0..400 {
        let before = simulation.leaves()[0].clone();
        simulation.step(0.002).expect("stiff");
        let now = &simulation.leaves()[0];
        if now.drops.len() < before.drops.len() {
            let m = |drops: &[LeafDrop]| drops.iter().fold(DVec3::ZERO, |s, d| s + d.v * d.volume) * WATER_DENSITY;
            assert!((now.volume() / 12e-9 - 1.0).abs() < 1e-12);
            // The momentum that both drops have lost acts on the leaf as a force over the next step.
            let received = *force.lock().expect("one thread") + DVec3::Y * (9.81 * WATER_DENSITY * 12e-9);
            let lost = hanging_pose(0.0).1 * (m(&before.drops) - m(&now.drops));
            assert!((received * 0.002 - lost).length() < 1e-9 * m(&before.drops).length(), "{received} {lost}");
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
        spin_up: 0.0,
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

/// Leaves that the wind makes flutter about the ends of their stalks, as [`crate::sway`] does in a wind of 6 m/s.
#[derive(Debug)]
struct FlutteringLeaves {
    places: Vec<(DVec3, DQuat)>,
    noise: Vec<TimeNoise>,
    poses: Vec<LeafPose>,
}

impl FlutteringLeaves {
    fn new(tilts: &[f64], seed: u64) -> Self {
        let places = places(tilts);
        let key = u32::try_from(seed).expect("small") * 100;
        let noise = (0_u32..).zip(&places).map(|(k, _)| TimeNoise::new(key + k * 10, 5.2, None)).collect();
        let mut all = Self { places, noise, poses: Vec::new() };
        all.poses = all.poses_at(0.0, None);
        all
    }

    fn orientation(&self, k: usize, t: f64) -> DQuat {
        let angle = |of: u32, most: f64| 0.78 * most * f64::from(self.noise[k].with_seed_offset(of).at(t));
        let nod = angle(0, 0.611);
        self.places[k].1 * DQuat::from_scaled_axis(DVec3::new(nod, angle(1, 0.785) + 0.4 * nod, angle(2, 0.436)))
    }

    /// Poses at a time; accelerations are means over the step `h` before it.
    fn poses_at(&self, t: f64, h: Option<f64>) -> Vec<LeafPose> {
        const DELTA: f64 = 1e-4;
        let pose = |k: usize| {
            let [before, orientation, after] = [t - DELTA, t, t + DELTA].map(|t| self.orientation(k, t));
            let turned = after * before.conjugate();
            let angular_velocity = turned.xyz() * (turned.w.signum() / DELTA);
            let last = self.poses.get(k).zip(h);
            let angular_acceleration =
                last.map_or(DVec3::ZERO, |(pose, h)| (angular_velocity - pose.angular_velocity) / h);
            LeafPose { angular_velocity, angular_acceleration, ..LeafPose::at_rest(self.places[k].0, orientation) }
        };
        (0..self.places.len()).map(pose).collect()
    }
}

impl RainPlant for FlutteringLeaves {
    fn leaf_count(&self) -> usize {
        self.places.len()
    }

    fn leaf_pose(&self, leaf: usize) -> LeafPose {
        self.poses[leaf]
    }

    fn inverse_effective_mass(&self, _: usize, _: DVec3, _: DVec3) -> f64 {
        0.0
    }

    fn apply_impulse(&mut self, _: usize, _: DVec3, _: DVec3) {}

    fn apply_force(&mut self, _: usize, _: DVec3, _: DVec3) {}

    fn set_attached_mass(&mut self, _: usize, _: f64, _: DVec3) {}

    fn step(&mut self, t: f64, h: f64) -> Result<()> {
        self.poses = self.poses_at(t + h, Some(h));
        Ok(())
    }
}

/// Mean number of drops on leaves, and counts of mergers, pendant drops and beads, of a rain on three leaves with time
/// step `h`, s; the drops of the rain do not depend on `h`.
fn counts_of_rain(seed: u64, h: f64, flutters: bool) -> [f64; 4] {
    let tilts = [0.35, 0.7, 1.1].repeat(if flutters { 4 } else { 1 });
    let leaves = tilts.len();
    let params = DropParams { seed, ..DropParams::default() };
    let mut simulation = match flutters {
        true => simulation_of(Box::new(FlutteringLeaves::new(&tilts, seed)), params, None),
        false => simulation(&tilts, params, None),
    };
    let mut draw = Rng::at(seed, &["rain of a test".into()]);
    // 16 s of 13 drops a second and leaf, around 2 mm.
    let mut rain: Vec<(f64, f64, f64, f64, f64)> = (0..213 * leaves + 1)
        .map(|_| {
            (
                draw.range(0.0, 16.0),
                draw.range(0.0, leaves as f64),
                draw.range(0.03, 0.97),
                draw.range(0.03, 0.97),
                draw.range(1.2, 2.6),
            )
        })
        .collect();
    rain.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut lying = 0.0;
    while simulation.time() < 17.0 - 0.5 * h {
        while rain.last().is_some_and(|d| d.0 <= simulation.time()) {
            let Some((_, leaf, u, v, mm)) = rain.pop() else { break };
            let leaf = (0..leaves).rev().find(|k| leaf >= *k as f64).unwrap_or(0);
            let place = simulation.leaves()[leaf].point_at(DVec2::new(u, v)).expect("on the blade").p;
            let at = simulation.poses()[leaf].to_world(place, 1.0);
            drop_in_air(
                &mut simulation,
                at + DVec3::Y * 0.012,
                DVec3::NEG_Y * 6.0,
                crate::rain::fall::sphere_volume(mm * 1e-3),
            );
        }
        simulation.step(h).expect("stiff");
        if simulation.time() > 8.5 {
            let drops = simulation.leaves().iter().flat_map(|l| &l.drops);
            lying += drops.filter(|d| d.pendant.is_none() && d.v == DVec3::ZERO).count() as f64 * h;
        }
    }
    let DropCounters { mergers, beads, pendants, .. } = simulation.counters();
    [lying / 8.5, mergers as f64, pendants as f64, beads as f64]
}

#[test]
fn counts_of_drops_do_not_depend_on_the_time_step() {
    let means = |h: f64| {
        let seeds: Vec<u64> = (1..=8).collect();
        let counts = osier_base::par::par_map(&seeds, |seed| counts_of_rain(*seed, h, false));
        counts.iter().fold([0.0; 4], |sum, c| std::array::from_fn(|i| sum[i] + c[i] / 8.0))
    };
    // The default step and a quarter of it, at 12, 24 and 192 frames per second with 8 substeps.
    let table = [12.0, 24.0, 48.0, 96.0, 192.0].map(|fps| means(1.0 / (fps * 8.0)));
    for (row, quarter) in [(0, 2), (1, 3), (2, 4)] {
        for (what, (a, b)) in ["lying", "merged", "hung", "beads"].iter().zip(table[row].iter().zip(table[quarter])) {
            // The mean of the beads is over about a thousand, whose statistical spread is larger.
            let tolerance = if *what == "beads" { 0.1 } else { 0.05 };
            assert!((a / b - 1.0).abs() < tolerance, "{what}: {table:?}");
        }
    }
}

#[test]
#[ignore = "two minutes; tests/full.sh runs it"]
fn counts_of_drops_on_fluttering_leaves_do_not_depend_on_the_time_step() {
    let means = |h: f64| {
        let seeds: Vec<u64> = (1..=8).collect();
        let counts = osier_base::par::par_map(&seeds, |seed| counts_of_rain(*seed, h, true));
        counts.iter().fold([0.0; 4], |sum, c| std::array::from_fn(|i| sum[i] + c[i] / 8.0))
    };
    // The default step at 24 frames per second and a quarter of it. Eleven hundred drops hang in all,
    // with a statistical spread of 3 %.
    let table = [192.0, 768.0].map(|hz| means(1.0 / hz));
    for (what, (a, b)) in ["lying", "merged", "hung", "beads"].iter().zip(table[0].iter().zip(table[1])) {
        assert!((a / b - 1.0).abs() < 0.05, "{what}: {table:?}");
    }
}

#[test]
fn what_is_too_heavy_falls_from_below_a_leaf() {
    // On the lower side a drop falls if its weight exceeds the adhesion.
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
