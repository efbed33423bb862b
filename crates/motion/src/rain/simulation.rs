//! The time step of rain: drops are emitted, fall, strike leaves and wood, and move over leaves; plants respond to them.

use std::sync::Arc;

use glam::{DVec2, DVec3, Vec3};

use super::bark_wetness::{WoodStrike, spot_radius};
use super::collide::{DropHit, LeafCollider, MovingLeaf, RainCollider, SweptHierarchy, WoodHit};
use super::drops::rain_leaf::{AttachedWater, DropCounters, LeafStep, LeafStepResult, PointForce, RainLeaf, WetSpot};
use super::drops::surface_drop::LeafDrop;
use super::emitter::RainEmitter;
use super::event::{DropEventKind, RainEvent};
use super::fall::{EmittedDrop, sample_wind, sphere_diameter, sphere_volume, step_velocity};
use super::ground::{GroundHeight, ground_crossing};
use super::impact::{Impact, weber_number, wood_impulse};
use super::params::{DropParams, ImpactImpulseLaw};
use super::shelter::Shelter;
use super::solids::RainSolids;
use super::target::{LeafPose, RainPlant, WoodSegment};
use super::triangle_hierarchy::TriangleHit;
use super::tuning::{
    ACCELERATION_RESPONSE_TIME, BUDGET_TOLERANCE, DROP_WIND_INTERVAL, DROPS_PER_TASK, IGNORE_LEAF_TIME,
    MAX_SPLASH_DROPLETS, SPLASH_ANGLES, SPLASH_DIAMETERS, SPLASH_OFFSET, SPLASH_SPEEDS, SPLASH_WEBER_NUMBER,
};
use osier_base::math;
use osier_base::par::{par_chunks, par_map_mut};
use osier_base::physics::WATER_DENSITY;
use osier_base::rng::Rng;
use osier_base::{Error, Result};
use osier_wind::Wind;

/// Bit that is set in the identifiers of splash droplets, so that tables can distinguish them from emitted drops.
const SPLASH_ID: u64 = 1 << 62;
/// Bit that is set in the identifiers of emitted drops. These have a separate count, so that their identifiers do not depend on
/// other drops.
const EMITTED_ID: u64 = 1 << 61;

/// A falling drop with the state that its time step needs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FallingDrop {
    /// Identifier, stable over frames, threads and time steps; its highest bits give the origin of the drop.
    pub id: u64,
    /// Position in the world, m.
    pub p: DVec3,
    /// Velocity in the world, m/s.
    pub v: DVec3,
    /// Volume of the drop, m^3.
    pub volume: f64,
    ignore_leaf: Option<IgnoredLeaf>,
    /// Time within the present step at which it is emitted, s; 0 for older drops.
    spawn_offset: f64,
    wind: HeldWind,
}

impl FallingDrop {
    /// A drop that falls from the beginning of the step, can strike every leaf, and has not yet sampled the wind. SI units.
    fn new(id: u64, p: DVec3, v: DVec3, volume: f64) -> Self {
        Self { id, p, v, volume, ignore_leaf: None, spawn_offset: 0.0, wind: HeldWind::default() }
    }
}

/// The wind at a drop, sampled every [`DROP_WIND_INTERVAL`] and held in between: a drop follows the wind only
/// within tenths of a second.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct HeldWind {
    /// Wind velocity at the drop when it was last sampled, m/s.
    velocity: Vec3,
    /// Time of the next sample, s; 0 for a drop that has none.
    until: f64,
}

/// A leaf that a drop ignores for a short time, as it has just left it or fallen through one of its holes.
#[derive(Debug, Clone, Copy, PartialEq)]
struct IgnoredLeaf {
    leaf: usize,
    /// Time at which collisions begin again, s.
    until: f64,
}

/// Which plant carries a leaf, and the leaf's collision shape.
#[derive(Debug)]
pub struct LeafOnPlant {
    /// Index of the plant in [`RainConfig::plants`].
    pub plant: usize,
    /// Index of the leaf on that plant.
    pub leaf: usize,
    /// Triangles of the blade at scale 1.
    pub collider: Arc<LeafCollider>,
}

/// Volumes of water by where they are, m^3. Water is conserved: `emitted` equals the sum of the others.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct WaterBudget {
    /// Emitted so far, or deposited on leaves by the scene.
    pub emitted: f64,
    /// In drops in the air: emitted, splashed or detached.
    pub air: f64,
    /// In sessile drops on leaves.
    pub leaves: f64,
    /// In pendant drops at margins.
    pub pendants: f64,
    /// Fallen to the ground or beyond the scene.
    pub ground: f64,
    /// Absorbed by wood that drops struck.
    pub wood: f64,
    /// On walls, roofs and meshes that drops struck.
    pub solids: f64,
}

impl WaterBudget {
    /// Relative error of conservation: |sum - emitted| / emitted.
    pub fn error(&self) -> f64 {
        let sum = self.air + self.leaves + self.pendants + self.ground + self.wood + self.solids;
        (sum - self.emitted).abs() / self.emitted.max(1e-18)
    }
}

/// Momentum of the drops that have struck leaves, kg m/s, added up as lengths over all impacts.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct ImpactMomentum {
    /// Sum over the drops before their impacts.
    pub brought: f64,
    /// Sum of the momentum that is missing afterwards in the impulse on the leaf, the drop and its splash; only rounding if
    /// momentum is conserved.
    pub missing: f64,
}

impl ImpactMomentum {
    /// Relative error of conservation: missing / brought; 0 before the first impact.
    pub fn error(&self) -> f64 {
        self.missing / self.brought.max(f64::MIN_POSITIVE)
    }
}

/// A place on a leaf that water has covered.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LeafWetSpot {
    /// Index of the leaf, as in [`RainSimulation::leaves`].
    pub leaf: usize,
    /// Place on the leaf in texture coordinates, and time.
    pub spot: WetSpot,
}

/// Initial state and parameters of a [`RainSimulation`].
pub struct RainConfig {
    /// Parameters of drops, the same for all leaves.
    pub params: DropParams,
    /// Source of drops; `None` for scenes that only deposit drops.
    pub emitter: Option<RainEmitter>,
    /// Plants that rain falls on; [`LeafOnPlant::plant`] names them by index.
    pub plants: Vec<Box<dyn RainPlant>>,
    /// Leaves of all plants, with the plants that carry them.
    pub leaves: Vec<(RainLeaf, LeafOnPlant)>,
    /// Wind that carries falling drops; `None` in calm air.
    pub wind: Option<Arc<dyn Wind>>,
    /// Ground, at which drops end if they strike nothing before.
    pub ground: Arc<dyn GroundHeight>,
    /// Walls, roofs and meshes at which drops end; they keep rain from places behind them.
    pub solids: RainSolids,
}

/// Raindrops in the air and on leaves, and the plants that they move, advanced step by step. Results do not depend on the number
/// of threads.
#[derive(Debug)]
pub struct RainSimulation {
    /// Parameters of drops, the same for all leaves; changes act from the next step on.
    pub params: DropParams,
    emitter: Option<RainEmitter>,
    plants: Vec<Box<dyn RainPlant>>,
    leaves: Vec<RainLeaf>,
    attachments: Vec<LeafOnPlant>,
    falling: Vec<FallingDrop>,
    poses: Vec<LeafPose>,
    /// Accelerations of the leaves that drops respond to, by leaf.
    responses: Vec<SmoothedLeafAcceleration>,
    wood: Vec<Vec<WoodSegment>>,
    /// Hierarchy over the boxes that leaves and wood sweep in a step.
    hierarchy: SweptHierarchy,
    wind: Option<Arc<dyn Wind>>,
    ground: Arc<dyn GroundHeight>,
    /// Height that the ground nowhere exceeds, m.
    ground_top: f64,
    solids: RainSolids,
    t: f64,
    /// Number of drops emitted so far, and the last number given to a drop that came from elsewhere.
    last_emitted: u64,
    last_id: u64,
    emitted: f64,
    water_on_ground: f64,
    water_on_wood: f64,
    water_on_solids: f64,
    wet_spots: Vec<LeafWetSpot>,
    wood_strikes: Vec<WoodStrike>,
    counters: DropCounters,
    impact_momentum: ImpactMomentum,
    events: Vec<RainEvent>,
}

/// Acceleration of a leaf, smoothed over [`ACCELERATION_RESPONSE_TIME`], since water does not respond to faster vibration.
#[derive(Debug, Clone, Copy, Default)]
struct SmoothedLeafAcceleration {
    /// Acceleration of the origin of leaf space, m/s^2.
    linear: DVec3,
    /// Angular acceleration, rad/s^2.
    angular: DVec3,
}

impl SmoothedLeafAcceleration {
    /// Approaches the acceleration of `pose` for `h`, s; exact for an acceleration that is constant over the step.
    fn follow(&mut self, pose: &LeafPose, h: f64) {
        let share = 1.0 - math::exp(-h / ACCELERATION_RESPONSE_TIME);
        self.linear += (pose.acceleration - self.linear) * share;
        self.angular += (pose.angular_acceleration - self.angular) * share;
    }
}

/// Sums over the droplets that a splash has ejected.
#[derive(Debug, Clone, Copy, Default)]
struct EjectedWater {
    /// Volume of the ejected droplets, m^3.
    volume: f64,
    /// Momentum in the world, kg m/s.
    momentum: DVec3,
}

/// Outcome of a falling drop's time step.
#[derive(Clone, Copy)]
enum FallOutcome {
    Airborne,
    Ground,
    Hit(DropHit),
}

/// A falling drop at the place where it strikes a leaf, wood or a solid; the effect is not yet applied.
#[derive(Clone, Copy)]
struct StrikingDrop {
    drop: FallingDrop,
    hit: DropHit,
}

impl RainSimulation {
    /// A simulation at time 0, without drops; solids and ground shelter the emission plane.
    pub fn new(config: RainConfig) -> Self {
        let (leaves, attachments): (Vec<RainLeaf>, Vec<LeafOnPlant>) = config.leaves.into_iter().unzip();
        let ground = config.ground;
        let shelter = Shelter::new(config.solids.clone(), Arc::clone(&ground), config.params.g);
        let mut simulation = Self {
            params: config.params,
            emitter: config.emitter.map(|emitter| emitter.with_shelter(shelter)),
            plants: config.plants,
            wet_spots: Vec::new(),
            wood_strikes: Vec::new(),
            poses: Vec::new(),
            responses: vec![SmoothedLeafAcceleration::default(); leaves.len()],
            wood: Vec::new(),
            hierarchy: SweptHierarchy::default(),
            leaves,
            attachments,
            falling: Vec::new(),
            wind: config.wind,
            ground_top: ground.max_height(),
            ground,
            solids: config.solids,
            t: 0.0,
            last_emitted: 0,
            last_id: 0,
            emitted: 0.0,
            water_on_ground: 0.0,
            water_on_wood: 0.0,
            water_on_solids: 0.0,
            counters: DropCounters::default(),
            impact_momentum: ImpactMomentum::default(),
            events: Vec::new(),
        };
        // The first step moves leaves from these poses.
        simulation.poses = simulation.leaf_poses();
        simulation.wood = simulation.wood_segments();
        simulation
    }

    /// Deposits a drop of `volume`, m^3, on the upper side of a leaf at texture coordinates. `v`: tangential velocity relative to the
    /// leaf, in leaf space, m/s. Its volume counts as emitted.
    pub fn deposit_drop(&mut self, leaf: usize, uv: DVec2, v: DVec3, volume: f64) {
        let id = self.next_id();
        self.emitted += volume;
        let pose = self.poses.get(leaf).copied();
        if let Some((rain_leaf, pose)) = self.leaves.get_mut(leaf).zip(pose) {
            rain_leaf.drops.push(LeafDrop::new(id, 1.0, uv, v, volume));
            let p = rain_leaf.point_at(uv).map_or(pose.position, |s| pose.position + pose.orientation * s.p);
            let event = RainEvent::new(DropEventKind::Born, id, self.t, p, volume);
            self.events.push(RainEvent { leaf: Some(leaf), ..event });
        }
    }

    /// The next identifier of a drop that is not emitted by the rain, counted from 1.
    fn next_id(&mut self) -> u64 {
        self.last_id += 1;
        self.last_id
    }

    fn leaf_poses(&self) -> Vec<LeafPose> {
        self.attachments.iter().map(|a| self.plants[a.plant].leaf_pose(a.leaf)).collect()
    }

    fn wood_segments(&self) -> Vec<Vec<WoodSegment>> {
        let of_plant = |plant: &dyn RainPlant| {
            let mut out = Vec::new();
            plant.wood_segments(&mut out);
            out
        };
        self.plants.iter().map(|plant| of_plant(&**plant)).collect()
    }

    /// Time since the simulation began, s: the sum of all steps.
    pub fn time(&self) -> f64 {
        self.t
    }

    /// Leaves of all plants with their drops, in the order of [`RainConfig::leaves`].
    pub fn leaves(&self) -> &[RainLeaf] {
        &self.leaves
    }

    /// Poses of the leaves at the present time, in the order of [`RainConfig::leaves`].
    pub fn poses(&self) -> &[LeafPose] {
        &self.poses
    }

    /// Drops that fall, in no particular order.
    pub fn falling_drops(&self) -> &[FallingDrop] {
        &self.falling
    }

    /// The plants in their present state, in the order of [`RainConfig::plants`].
    pub fn plants(&self) -> &[Box<dyn RainPlant>] {
        &self.plants
    }

    /// Counts of events, and the largest impulse on a leaf, since the simulation began.
    pub fn counters(&self) -> DropCounters {
        self.counters
    }

    /// Removes and returns the spots that became wet since the last call, in the order of steps.
    pub fn take_wet_spots(&mut self) -> Vec<LeafWetSpot> {
        std::mem::take(&mut self.wet_spots)
    }

    /// Removes and returns the drops that have struck wood since the last call, in the order of steps.
    pub fn take_wood_strikes(&mut self) -> Vec<WoodStrike> {
        std::mem::take(&mut self.wood_strikes)
    }

    /// Removes and returns the events since the last call, in the order of steps.
    pub fn take_events(&mut self) -> Vec<RainEvent> {
        std::mem::take(&mut self.events)
    }

    /// Where the water is now; sums the volumes of all drops at each call.
    pub fn water_budget(&self) -> WaterBudget {
        // Drops are summed each time instead of kept as totals, so that the check detects water that a drop lost or gained.
        let mut budget = WaterBudget {
            emitted: self.emitted,
            ground: self.water_on_ground,
            wood: self.water_on_wood,
            solids: self.water_on_solids,
            ..WaterBudget::default()
        };
        budget.air = self.falling.iter().map(|d| d.volume).sum();
        for d in self.leaves.iter().flat_map(|l| &l.drops) {
            *if d.pendant.is_some() { &mut budget.pendants } else { &mut budget.leaves } += d.volume;
        }
        budget
    }

    /// Advances rain and plants by `h`, s. Drops that are emitted within the step fall for its remainder.
    /// # Errors
    /// `Simulation` if the motion of a plant diverges.
    pub fn step(&mut self, h: f64) -> Result<()> {
        // Plants move before drops do, under the impulses and loads of the last step.
        self.emit(h);
        self.step_plants(h)?;
        // Leaves move from `before` to `self.poses` while drops fall; collisions need both ends.
        let before = std::mem::take(&mut self.poses);
        self.poses = self.leaf_poses();
        self.wood = self.wood_segments();
        let hits = self.advance_falling_drops(&before, h);
        self.t += h;
        // Hits change plants and draw random numbers: apply them one after the other in a fixed order.
        for StrikingDrop { drop, hit } in hits {
            match hit {
                DropHit::Leaf { leaf, hit } => self.strike_leaf(&drop, leaf, &hit),
                DropHit::Wood { segment, hit } => self.strike_wood(&drop, segment, hit),
                DropHit::Solid { .. } => {
                    self.events.push(RainEvent::new(DropEventKind::Solid, drop.id, self.t, drop.p, drop.volume));
                    self.water_on_solids += drop.volume;
                }
            }
        }
        self.step_leaf_drops(h);
        Ok(())
    }

    /// Steps all plants, which do not act on each other, in parallel.
    fn step_plants(&mut self, h: f64) -> Result<()> {
        let t = self.t;
        // A single plant needs no other thread.
        if let [plant] = &mut self.plants[..] {
            return plant.step(t, h);
        }
        par_map_mut(&mut self.plants, |plant| plant.step(t, h)).into_iter().collect()
    }

    /// Checks that water is conserved.
    /// # Errors
    /// `Simulation` if the relative error exceeds 1e-9; `frame` is the frame that it names.
    pub fn check_water_budget(&self, frame: u32) -> Result<()> {
        if self.water_budget().error() > BUDGET_TOLERANCE {
            return Err(Error::Simulation { frame, quantity: "the volume of water".into() });
        }
        Ok(())
    }

    /// Sums of the momentum of all impacts on leaves so far.
    pub fn impact_momentum(&self) -> ImpactMomentum {
        self.impact_momentum
    }

    /// Checks that impacts conserve momentum. The law of the paper does not, and is not checked.
    /// # Errors
    /// `Simulation` if the relative error exceeds 1e-9; `frame` is the frame that it names.
    pub fn check_impact_momentum(&self, frame: u32) -> Result<()> {
        let conserves = matches!(self.params.impact, ImpactImpulseLaw::Momentum { .. });
        if conserves && self.impact_momentum.error() > BUDGET_TOLERANCE {
            return Err(Error::Simulation { frame, quantity: "the momentum of drops and leaves".into() });
        }
        Ok(())
    }

    fn emit(&mut self, h: f64) {
        let Some(emitter) = &mut self.emitter else { return };
        let emitted: Vec<EmittedDrop> = emitter.emit_until(self.t + h);
        for d in emitted {
            self.last_emitted += 1;
            let id = self.last_emitted | EMITTED_ID;
            self.emitted += d.volume;
            self.events.push(RainEvent::new(DropEventKind::Born, id, d.t, d.p, d.volume));
            let spawn_offset = d.t - self.t;
            self.falling.push(FallingDrop { spawn_offset, ..FallingDrop::new(id, d.p, d.v, d.volume) });
        }
    }

    /// Advances the drops in the air, and returns the drops that strike a leaf, wood or a solid, by time within the step.
    fn advance_falling_drops(&mut self, before: &[LeafPose], h: f64) -> Vec<StrikingDrop> {
        self.sample_due_winds();
        // Leaves sweep from their poses before the step to those after it; wood, which is slower, is taken as at rest.
        let wood: Vec<WoodSegment> = self.wood.iter().flatten().copied().collect();
        let moving: Vec<MovingLeaf> = (0..self.leaves.len())
            .map(|i| MovingLeaf {
                collider: &self.attachments[i].collider,
                scale: self.leaves[i].scale,
                poses: [before[i], self.poses[i]],
            })
            .collect();
        let collider = RainCollider::new(&moving, &wood, &self.solids, &mut self.hierarchy);
        let (t, ground, ground_top, g) = (self.t, &self.ground, self.ground_top, self.params.g);
        let (leaves, end) = (&self.leaves, t + h);
        let advance = |drop: &FallingDrop| {
            // A drop that was emitted within the step falls only from then on. Velocity first, then position (semi-implicit Euler).
            let mut drop = *drop;
            let h = h - std::mem::replace(&mut drop.spawn_offset, 0.0);
            drop.v = step_velocity(drop.v, drop.volume, g, drop.wind.velocity.as_dvec3(), h);
            let to = drop.p + drop.v * h;
            let ignored = drop.ignore_leaf.filter(|ignored| t < ignored.until).map(|ignored| ignored.leaf);
            let mut with_holes: Vec<usize> = Vec::new();
            // A path above the highest ground cannot reach the ground.
            let landing = if to.y < ground_top { ground_crossing(&**ground, [drop.p, to]) } else { None };
            // A path through a hole of a leaf continues: search for the next hit on it.
            let hit = loop {
                let passes = |leaf: usize| ignored == Some(leaf) || with_holes.contains(&leaf);
                match collider.first_hit([drop.p, to], sphere_diameter(drop.volume), passes) {
                    Some(DropHit::Leaf { leaf, hit }) if leaves[leaf].struck_point(&hit).is_none() => {
                        with_holes.push(leaf);
                    }
                    hit => break hit,
                }
            };
            if let Some(leaf) = with_holes.last() {
                drop.ignore_leaf = Some(IgnoredLeaf { leaf: *leaf, until: end + IGNORE_LEAF_TIME });
            }
            // The first thing on the path stops the drop.
            let outcome = match (hit, landing) {
                (Some(hit), landing) if landing.is_none_or(|fraction| hit.path_fraction() <= fraction) => {
                    FallOutcome::Hit(hit)
                }
                (_, Some(_)) => FallOutcome::Ground,
                _ => FallOutcome::Airborne,
            };
            let fraction = match &outcome {
                FallOutcome::Hit(hit) => hit.path_fraction(),
                FallOutcome::Ground => landing.unwrap_or(1.0),
                FallOutcome::Airborne => 1.0,
            };
            drop.p = drop.p.lerp(to, fraction);
            (drop, outcome)
        };
        let task = |_: usize, part: &[FallingDrop]| part.iter().map(advance).collect::<Vec<_>>();
        let outcomes = par_chunks(&self.falling, DROPS_PER_TASK, task).concat();
        // Serial, in the order of drops: sums of volumes do not depend on the number of threads.
        let mut hits = Vec::new();
        self.falling.clear();
        for (drop, outcome) in outcomes {
            match outcome {
                FallOutcome::Airborne => self.falling.push(drop),
                FallOutcome::Ground => {
                    self.events.push(RainEvent::new(DropEventKind::Ground, drop.id, t + h, drop.p, drop.volume));
                    self.water_on_ground += drop.volume;
                }
                FallOutcome::Hit(hit) => hits.push(StrikingDrop { drop, hit }),
            }
        }
        // In the order of time within the step; identifiers decide between hits at the same time.
        hits.sort_by(|a, b| a.hit.path_fraction().total_cmp(&b.hit.path_fraction()).then(a.drop.id.cmp(&b.drop.id)));
        hits
    }

    /// Samples the wind in one call for all drops whose sample is due: recorded and lattice winds are much slower drop by drop.
    fn sample_due_winds(&mut self) {
        let Some(wind) = self.wind.as_deref() else { return };
        let t = self.t;
        let due: Vec<usize> = (0..self.falling.len()).filter(|i| self.falling[*i].wind.until <= t).collect();
        let positions: Vec<Vec3> = due.iter().map(|i| self.falling[*i].p.as_vec3()).collect();
        // Samples are due at whole multiples of the interval, whatever the time step.
        let until = ((t / DROP_WIND_INTERVAL).floor() + 1.0) * DROP_WIND_INTERVAL;
        for (i, velocity) in due.into_iter().zip(sample_wind(Some(wind), &positions, t)) {
            self.falling[i].wind = HeldWind { velocity, until };
        }
    }

    /// Applies the impulse of a drop to the wood that it strikes, which absorbs its water. `segment`: index over the wood of all
    /// plants.
    fn strike_wood(&mut self, drop: &FallingDrop, mut segment: usize, hit: WoodHit) {
        // Find the plant that the segment belongs to, and the index on it.
        let fraction = hit.fraction;
        for (number, wood) in self.wood.iter().enumerate() {
            if segment >= wood.len() {
                segment -= wood.len();
                continue;
            }
            // Wood takes up the whole relative momentum, not only the component along its normal: the drop stays on it.
            let plant = &mut self.plants[number];
            let relative = drop.v - plant.wood_velocity(segment, fraction);
            let inverse_mass = plant.wood_inverse_effective_mass(segment, fraction, relative.normalize_or_zero());
            let j = wood_impulse(self.params.impact, WATER_DENSITY * drop.volume, relative, inverse_mass);
            plant.apply_wood_impulse(segment, fraction, j * self.params.impulse_factor);
            let radius = spot_radius(relative.length(), sphere_diameter(drop.volume));
            self.wood_strikes.push(WoodStrike { plant: number, t: self.t, radius });
            break;
        }
        self.events.push(RainEvent::new(DropEventKind::Wood, drop.id, self.t, drop.p, drop.volume));
        self.water_on_wood += drop.volume;
    }

    /// Lets a drop strike a leaf: it transfers an impulse, may splash, and bounces or becomes a sessile drop. The impulse on the leaf
    /// is the whole momentum that the drop has lost, the loss to its splash included.
    fn strike_leaf(&mut self, drop: &FallingDrop, i: usize, hit: &TriangleHit) {
        let (pose, leaf) = (self.poses[i], &self.leaves[i]);
        let ignore_leaf = Some(IgnoredLeaf { leaf: i, until: self.t + IGNORE_LEAF_TIME });
        let Some((uv, surface)) = leaf.struck_point(hit) else {
            // The drop falls through a hole of the leaf, and ignores the leaf for a short time.
            self.falling.push(FallingDrop { ignore_leaf, ..*drop });
            return;
        };
        // Velocity relative to the material point of the leaf, and the normal of the side that the drop comes from: against the
        // relative motion, so that the speed of approach is not negative.
        let point = pose.position + pose.orientation * surface.p;
        let surface_velocity = pose.velocity_at(point);
        let relative = drop.v - surface_velocity;
        let up = pose.orientation * surface.n;
        let side = if relative.dot(up) <= 0.0 { 1.0 } else { -1.0 };
        let normal = up * side;
        let diameter = sphere_diameter(drop.volume);
        let mut impact = Impact { mass: WATER_DENSITY * drop.volume, diameter, relative, normal, surface_velocity };
        let first_droplet = self.falling.len();
        let mut splashed = EjectedWater::default();
        if weber_number(impact.approach_speed(), diameter) > SPLASH_WEBER_NUMBER && self.params.splash > 0.0 {
            splashed = self.eject_splash_droplets(drop, i, point, &impact);
        }
        // The water that has not splashed strikes the leaf. The plant gives the effective mass with which the leaf resists there.
        let volume = drop.volume - splashed.volume;
        impact.mass = WATER_DENSITY * volume;
        let LeafOnPlant { plant, leaf: leaf_on_plant, .. } = self.attachments[i];
        let target = &mut self.plants[plant];
        let outcome = impact.impulse_and_rebound(&self.params, |direction| {
            target.inverse_effective_mass(leaf_on_plant, point, direction)
        });
        let recoil = drop.v * (WATER_DENSITY * splashed.volume) - splashed.momentum;
        let impulse = outcome.impulse + recoil;
        // The impulse on the leaf, with the artistic factor.
        let applied = impulse * self.params.impulse_factor;
        target.apply_impulse(leaf_on_plant, point, applied);
        let max_impulse = applied.length();
        self.counters = self.counters.combine(DropCounters { impacts: 1, max_impulse, ..DropCounters::default() });
        let event = RainEvent::new(DropEventKind::Struck, drop.id, self.t, point, volume);
        self.events.push(RainEvent { leaf: Some(i), impulse: max_impulse, ..event });
        if outcome.bounces {
            let v = surface_velocity + outcome.relative;
            self.falling.push(FallingDrop { v, volume, ignore_leaf, ..*drop });
        } else {
            let v = pose.orientation.inverse() * outcome.relative;
            self.leaves[i].drops.push(LeafDrop::new(drop.id, side, uv, v, volume));
        }
        // Compare the momentum after the impact, in the air, on the leaf and given to the leaf, with that of the drop before.
        let momentum = |v: DVec3, volume: f64| v * (WATER_DENSITY * volume);
        let in_air = self.falling[first_droplet..].iter().fold(DVec3::ZERO, |sum, d| sum + momentum(d.v, d.volume));
        let stays = self.leaves[i].drops.last().filter(|_| !outcome.bounces);
        let on_leaf = stays.map_or(DVec3::ZERO, |d| momentum(surface_velocity + pose.orientation * d.v, d.volume));
        let before = momentum(drop.v, drop.volume);
        self.impact_momentum.brought += before.length();
        self.impact_momentum.missing += (before - in_air - on_leaf - impulse).length();
    }

    /// Ejects the splashed part of a drop as droplets in a crown around the normal, and returns their volume and momentum.
    fn eject_splash_droplets(
        &mut self,
        drop: &FallingDrop,
        leaf: usize,
        point: DVec3,
        impact: &Impact,
    ) -> EjectedWater {
        // Draws are addressed by the drop's identifier, so that they do not depend on other drops.
        let mut draw = Rng::at(self.params.seed, &["drop".into(), drop.id.into(), "splash".into()]);
        let n = impact.normal;
        let (x, y) = n.any_orthonormal_pair();
        let mut ejected = EjectedWater::default();
        for volume in splash_volumes(self.params.splash * drop.volume, &mut draw) {
            // A direction of the crown: polar angle from the normal, azimuth around it.
            let azimuth = draw.range(0.0, std::f64::consts::TAU);
            let polar = draw.range(SPLASH_ANGLES[0], SPLASH_ANGLES[1]).to_radians();
            let tangent = x * math::cos(azimuth) + y * math::sin(azimuth);
            let direction = n * math::cos(polar) + tangent * math::sin(polar);
            // Droplets start on the moving leaf, and ignore it until they are clear of it.
            let speed = draw.range(SPLASH_SPEEDS[0], SPLASH_SPEEDS[1]) * impact.relative.length();
            let v = direction * speed + impact.surface_velocity;
            let id = self.next_id() | SPLASH_ID;
            let ignore_leaf = Some(IgnoredLeaf { leaf, until: self.t + IGNORE_LEAF_TIME });
            let p = point + n * SPLASH_OFFSET;
            let event = RainEvent::new(DropEventKind::Born, id, self.t, p, volume);
            self.events.push(RainEvent { other: Some(drop.id), ..event });
            self.falling.push(FallingDrop { ignore_leaf, ..FallingDrop::new(id, p, v, volume) });
            ejected.volume += volume;
            ejected.momentum += v * (WATER_DENSITY * volume);
        }
        ejected
    }

    /// Advances the drops on all leaves in parallel, then applies their loads and collects their results leaf by leaf, so that
    /// identifiers and sums do not depend on threads.
    fn step_leaf_drops(&mut self, h: f64) {
        let (t, params) = (self.t, &self.params);
        let felt = self.responses.iter_mut().zip(&self.poses).map(|(response, pose)| {
            response.follow(pose, h);
            LeafPose { acceleration: response.linear, angular_acceleration: response.angular, ..*pose }
        });
        let mut jobs: Vec<(&mut RainLeaf, LeafPose)> = self.leaves.iter_mut().zip(felt).collect();
        let mut results = par_map_mut(&mut jobs, |(leaf, pose)| {
            // Most leaves carry no drops most of the time.
            if leaf.drops.is_empty() {
                let attached = AttachedWater { mass: 0.0, center: pose.position };
                return LeafStepResult { attached, ..LeafStepResult::default() };
            }
            leaf.step_drops(&LeafStep { pose: *pose, t, h, params })
        });
        for (i, result) in results.iter_mut().enumerate() {
            let LeafOnPlant { plant, leaf, .. } = self.attachments[i];
            let plant = &mut self.plants[plant];
            for PointForce { point, force } in &result.forces {
                plant.apply_force(leaf, *point, *force);
            }
            plant.set_attached_mass(leaf, result.attached.mass, result.attached.center);
            self.counters = self.counters.combine(result.counters);
            self.events.extend(result.events.iter().map(|e| RainEvent { leaf: Some(i), ..*e }));
            self.wet_spots.extend(result.wet_spots.drain(..).map(|spot| LeafWetSpot { leaf: i, spot }));
        }
        // A drop that detaches as a whole keeps its identifier; a part gets a new one, and its event names the drop
        // that it came from.
        for (i, result) in results.iter().enumerate() {
            for drop in &result.detached {
                let id = if drop.is_whole { drop.id } else { self.next_id() };
                let ignore_leaf = Some(IgnoredLeaf { leaf: i, until: t + IGNORE_LEAF_TIME });
                let other = (!drop.is_whole).then_some(drop.id);
                let event = RainEvent::new(DropEventKind::Fell, id, t, drop.p, drop.volume);
                self.events.push(RainEvent { leaf: Some(i), other, ..event });
                self.falling.push(FallingDrop { ignore_leaf, ..FallingDrop::new(id, drop.p, drop.v, drop.volume) });
            }
        }
    }
}

/// Volumes of the droplets of a splash, m^3, of random diameters; their sum is `volume`, m^3.
fn splash_volumes(volume: f64, draw: &mut Rng) -> Vec<f64> {
    let [least, most] = SPLASH_DIAMETERS;
    let (mut sizes, mut sum) = (Vec::new(), 0.0);
    while sum < volume && sizes.len() < MAX_SPLASH_DROPLETS {
        let size = sphere_volume(draw.range(least, most));
        sum += size;
        sizes.push(size);
    }
    // The diameters that were drawn give fractions of the volume, so that it is conserved exactly.
    sizes.iter().map(|size| volume * size / sum).collect()
}

#[cfg(test)]
mod tests;
