//! The whole of it, step by step: rain falls, strikes, lies, runs, hangs and drips, and the plants give way.

use std::sync::Arc;

use glam::{DVec3, Vec3};

use crate::rain::collide::{DropHit, LeafCollider, MovingLeaf, RainCollider};
use crate::rain::drops::drop::SurfaceDrop;
use crate::rain::drops::rain_leaf::{DetachedDrop, DropCounters, LeafStep, LeafStepResult, RainLeaf};
use crate::rain::drops::shape::WATER;
use crate::rain::emitter::{EmittedDrop, RainEmitter, across, air_at, fall};
use crate::rain::event::RainEvent;
use crate::rain::impact::blow;
use crate::rain::params::{DropParams, ImpactLaw};
use crate::rain::target::{LeafPose, RainTarget, WoodSegment};
use osier_base::par::{par_chunks, par_map_mut};
use osier_base::rng::Rng;
use osier_base::{Error, Result};
use osier_scene::DropEventKind;
use osier_wind::Wind;

/// Drops that one thread moves at a time.
const CHUNK: usize = 256;
/// A drop that leaves a leaf does not meet it for so long, s.
const BLIND: f64 = 0.005;
/// Weber number from which drops splash.
const SPLASHES: f64 = 100.0;
/// Water may be lost to rounding by this share.
const LOST: f64 = 1e-9;
/// Marks the ids of droplets that splash.
const NEW: u64 = 1 << 62;

/// A drop in the air.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FallingDrop {
    /// By birth.
    pub id: u64,
    /// m.
    pub p: DVec3,
    /// m/s.
    pub v: DVec3,
    /// m^3.
    pub volume: f64,
    /// A leaf that it does not meet until a time, s.
    blind: Option<(usize, f64)>,
    /// Time within this step at which it comes to be, s.
    late: f64,
}

/// Where a leaf hangs, and its blade.
#[derive(Debug)]
pub struct LeafAttachment {
    /// Plant, and number of the leaf on it.
    pub on: (usize, usize),
    /// Its blade.
    pub target: Arc<LeafCollider>,
}

/// Where all water is, m^3.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct WaterBudget {
    /// Fallen from the sky.
    pub emitted: f64,
    /// In the air.
    pub air: f64,
    /// Lying or running on leaves.
    pub leaves: f64,
    /// Hanging.
    pub pendants: f64,
    /// On the ground or beyond.
    pub ground: f64,
    /// On wood.
    pub wood: f64,
}

impl WaterBudget {
    /// What is missing, as a share of all.
    pub fn error(&self) -> f64 {
        let there = self.air + self.leaves + self.pendants + self.ground + self.wood;
        (there - self.emitted).abs() / self.emitted.max(1e-18)
    }
}

/// Places that came under water, with their leaves.
pub type LeafWetSpots = Vec<(usize, crate::rain::drops::rain_leaf::WetSpot)>;

/// Where drops end that strike nothing.
pub trait GroundHeight: std::fmt::Debug + Send + Sync {
    /// Height at x and z, m.
    fn height(&self, x: f64, z: f64) -> f64;
}

/// The same height everywhere.
impl GroundHeight for f64 {
    fn height(&self, _: f64, _: f64) -> f64 {
        *self
    }
}

/// What a storm is made of.
pub struct RainConfig {
    /// How drops behave.
    pub manner: DropParams,
    /// Rain; none for scenes with drops of their own.
    pub shower: Option<RainEmitter>,
    /// Plants.
    pub bearers: Vec<Box<dyn RainTarget>>,
    /// Leaves of all plants.
    pub leaves: Vec<(RainLeaf, LeafAttachment)>,
    /// Moving air.
    pub wind: Option<Arc<dyn Wind>>,
    /// Where drops end that strike nothing.
    pub floor: Box<dyn GroundHeight>,
}

/// Rain over some plants.
#[derive(Debug)]
pub struct RainSimulation {
    /// How drops behave.
    pub manner: DropParams,
    shower: Option<RainEmitter>,
    bearers: Vec<Box<dyn RainTarget>>,
    leaves: Vec<RainLeaf>,
    hung: Vec<LeafAttachment>,
    air: Vec<FallingDrop>,
    blades: Vec<LeafPose>,
    wood: Vec<Vec<WoodSegment>>,
    wind: Option<Arc<dyn Wind>>,
    floor: Box<dyn GroundHeight>,
    t: f64,
    steps: u64,
    born: u64,
    emitted: f64,
    ground: f64,
    wooded: f64,
    told: Vec<LeafStepResult>,
    tally: DropCounters,
    events: Vec<RainEvent>,
}

/// How a drop's step ended.
#[derive(Clone, Copy)]
enum FlightOutcome {
    Flies,
    Ground,
    Hit(DropHit),
}

impl RainSimulation {
    /// Everything as it hangs before the first drop.
    pub fn new(parts: RainConfig) -> Self {
        let (leaves, hung): (Vec<RainLeaf>, Vec<LeafAttachment>) = parts.leaves.into_iter().unzip();
        let mut storm = Self {
            manner: parts.manner,
            shower: parts.shower,
            bearers: parts.bearers,
            told: Vec::new(),
            blades: Vec::new(),
            wood: Vec::new(),
            leaves,
            hung,
            air: Vec::new(),
            wind: parts.wind,
            floor: parts.floor,
            t: 0.0,
            steps: 0,
            born: 0,
            emitted: 0.0,
            ground: 0.0,
            wooded: 0.0,
            tally: DropCounters::default(),
            events: Vec::new(),
        };
        storm.blades = storm.poses();
        storm.wood = storm.boughs();
        storm
    }

    /// Puts a drop on a leaf, as if it had just fallen there. `v`: along the leaf, in its own space, m/s.
    pub fn place(&mut self, leaf: usize, uv: glam::DVec2, v: DVec3, volume: f64) {
        let id = self.next();
        self.emitted += volume;
        let blade = self.blades.get(leaf).copied();
        if let Some((on, blade)) = self.leaves.get_mut(leaf).zip(blade) {
            on.drops.push(SurfaceDrop::new(id, 1.0, uv, v, volume));
            let p = on.at(uv).map_or(blade.position, |s| blade.position + blade.orientation * s.p);
            let born = RainEvent::of(DropEventKind::Born, id, (self.t, p), volume);
            self.events.push(RainEvent { leaf: Some(leaf), ..born });
        }
    }

    fn next(&mut self) -> u64 {
        self.born += 1;
        self.born
    }

    fn poses(&self) -> Vec<LeafPose> {
        self.hung.iter().map(|h| self.bearers[h.on.0].leaf_pose(h.on.1)).collect()
    }

    fn boughs(&self) -> Vec<Vec<WoodSegment>> {
        let one = |b: &dyn RainTarget| {
            let mut out = Vec::new();
            b.wood_segments(&mut out);
            out
        };
        self.bearers.iter().map(|b| one(&**b)).collect()
    }

    /// Seconds passed.
    pub fn time(&self) -> f64 {
        self.t
    }

    /// Leaves with their drops.
    pub fn leaves(&self) -> &[RainLeaf] {
        &self.leaves
    }

    /// Where the leaves are.
    pub fn blades(&self) -> &[LeafPose] {
        &self.blades
    }

    /// Drops in the air.
    pub fn air(&self) -> &[FallingDrop] {
        &self.air
    }

    /// The plants.
    pub fn bearers(&self) -> &[Box<dyn RainTarget>] {
        &self.bearers
    }

    /// What has happened so far.
    pub fn tally(&self) -> DropCounters {
        self.tally
    }

    /// Places that came under water since they were last taken, with their leaves.
    pub fn take(&mut self) -> LeafWetSpots {
        let stamps = self.told.iter_mut().enumerate().flat_map(|(i, told)| {
            let leaf = i % self.leaves.len().max(1);
            std::mem::take(&mut told.stamps).into_iter().map(move |s| (leaf, s))
        });
        let stamps = stamps.collect();
        self.told.clear();
        stamps
    }

    /// What has happened since they were last taken, in the order of steps.
    pub fn take_events(&mut self) -> Vec<RainEvent> {
        std::mem::take(&mut self.events)
    }

    /// Where all water is.
    pub fn ledger(&self) -> WaterBudget {
        let mut l =
            WaterBudget { emitted: self.emitted, ground: self.ground, wood: self.wooded, ..WaterBudget::default() };
        l.air = self.air.iter().map(|d| d.volume).sum();
        for d in self.leaves.iter().flat_map(|l| &l.drops) {
            *if d.hang.is_some() { &mut l.pendants } else { &mut l.leaves } += d.volume;
        }
        l
    }

    /// One step of `h` seconds.
    /// # Errors
    /// `Simulation` where plants fly apart or water is lost.
    pub fn step(&mut self, h: f64) -> Result<()> {
        self.emit(h);
        for bearer in &mut self.bearers {
            bearer.step(self.t, h)?;
        }
        let before = std::mem::take(&mut self.blades);
        self.blades = self.poses();
        self.wood = self.boughs();
        let struck = self.fly(&before, h);
        self.t += h;
        self.steps += 1;
        self.strike(struck);
        self.lie(h);
        Ok(())
    }

    /// An error if water was lost or made.
    /// # Errors
    /// `Simulation`.
    pub fn audit(&self, frame: u32) -> Result<()> {
        if self.ledger().error() > LOST {
            return Err(Error::Simulation { frame, quantity: "the volume of water".into() });
        }
        Ok(())
    }

    fn emit(&mut self, h: f64) {
        let Some(shower) = &mut self.shower else { return };
        let born: Vec<EmittedDrop> = shower.drops(self.steps, (self.t, h));
        for b in born {
            let id = self.next();
            self.emitted += b.volume;
            self.events.push(RainEvent::of(DropEventKind::Born, id, (b.t, b.p), b.volume));
            self.air.push(FallingDrop { id, p: b.p, v: b.v, volume: b.volume, blind: None, late: b.t - self.t });
        }
    }

    /// Moves what is in the air, and returns what struck something.
    fn fly(&mut self, before: &[LeafPose], h: f64) -> Vec<(FallingDrop, DropHit)> {
        let wood: Vec<WoodSegment> = self.wood.iter().flatten().copied().collect();
        let moved: Vec<MovingLeaf> = (0..self.leaves.len())
            .map(|i| MovingLeaf {
                target: &self.hung[i].target,
                scale: self.leaves[i].scale,
                poses: [before[i], self.blades[i]],
            })
            .collect();
        let field = RainCollider::new(&moved, &wood);
        let places: Vec<Vec3> = self.air.iter().map(|d| d.p.as_vec3()).collect();
        let winds = air_at(self.wind.as_deref(), &places, self.t);
        let both: Vec<(FallingDrop, Vec3)> = self.air.iter().copied().zip(winds).collect();
        let (t, floor, g) = (self.t, &self.floor, self.manner.g);
        let one = |(drop, wind): &(FallingDrop, Vec3)| {
            let mut drop = *drop;
            let h = h - std::mem::replace(&mut drop.late, 0.0);
            drop.v = fall(drop.v, (drop.volume, g), wind.as_dvec3(), h);
            let to = drop.p + drop.v * h;
            let without = drop.blind.filter(|(_, until)| t < *until).map(|(leaf, _)| leaf);
            let end = match field.first([drop.p, to], across(drop.volume), without) {
                Some(struck) => FlightOutcome::Hit(struck),
                None if to.y < floor.height(to.x, to.z) => FlightOutcome::Ground,
                None => FlightOutcome::Flies,
            };
            let reach = if let FlightOutcome::Hit(s) = &end { s.t() } else { 1.0 };
            drop.p = drop.p.lerp(to, reach);
            (drop, end)
        };
        let ended = par_chunks(&both, CHUNK, |_, part| part.iter().map(one).collect::<Vec<_>>()).concat();
        let mut struck = Vec::new();
        self.air.clear();
        for (drop, end) in ended {
            match end {
                FlightOutcome::Flies => self.air.push(drop),
                FlightOutcome::Ground => {
                    self.events.push(RainEvent::of(DropEventKind::Ground, drop.id, (t + h, drop.p), drop.volume));
                    self.ground += drop.volume;
                }
                FlightOutcome::Hit(s) => struck.push((drop, s)),
            }
        }
        struck.sort_by(|a, b| a.1.t().total_cmp(&b.1.t()).then(a.0.id.cmp(&b.0.id)));
        struck
    }

    fn strike(&mut self, struck: Vec<(FallingDrop, DropHit)>) {
        for (drop, what) in struck {
            match what {
                DropHit::Leaf(leaf, met) => self.strike_leaf(&drop, leaf, &met),
                DropHit::Wood(k, _, share) => self.strike_wood(&drop, k, share),
            }
        }
    }

    fn strike_wood(&mut self, drop: &FallingDrop, mut k: usize, share: f64) {
        for (plant, wood) in self.wood.iter().enumerate() {
            if k >= wood.len() {
                k -= wood.len();
                continue;
            }
            let bearer = &mut self.bearers[plant];
            let rel = drop.v - bearer.wood_velocity(k, share);
            let along = rel.normalize_or_zero();
            let m = WATER * drop.volume;
            let light = bearer.wood_inverse_effective_mass(k, share, along);
            let energy = 0.5 * m * rel.length_squared();
            let j = blow(self.manner.impact, (m, rel.length()), light, (energy, 0.0));
            bearer.apply_wood_impulse(k, share, along * (j * self.manner.gain));
            break;
        }
        self.events.push(RainEvent::of(DropEventKind::Wood, drop.id, (self.t, drop.p), drop.volume));
        self.wooded += drop.volume;
    }

    fn strike_leaf(&mut self, drop: &FallingDrop, i: usize, met: &crate::rain::collide::LeafHit) {
        let (blade, leaf) = (self.blades[i], &self.leaves[i]);
        let uv = leaf.sheet.uv_of(met.triangle, met.weights);
        let Some(spot) = leaf.at(uv).filter(|_| leaf.sheet.stops(uv)) else {
            // Through a hole, or on the very edge of a triangle at the margin: it passes.
            self.air.push(FallingDrop { blind: Some((i, self.t + BLIND)), ..*drop });
            return;
        };
        let place = blade.position + blade.orientation * spot.p;
        let mut rel = drop.v - blade.velocity_at(place);
        let up = blade.orientation * spot.n;
        let side = if rel.dot(up) <= 0.0 { 1.0 } else { -1.0 };
        let n = up * side;
        let u = (-rel.dot(n)).max(0.0);
        let m = WATER * drop.volume;
        let (plant, k) = self.hung[i].on;
        let along = match self.manner.impact {
            ImpactLaw::Momentum { .. } => n,
            ImpactLaw::PaperEnergy { .. } => -rel.normalize_or(-n),
        };
        let light = self.bearers[plant].inverse_effective_mass(k, place, along);
        let energy = 0.5 * m * rel.length_squared();
        let speed = -blade.velocity_at(place).dot(along);
        let j = blow(self.manner.impact, (m, u), light, (energy, speed));
        self.bearers[plant].apply_impulse(k, place, along * (-j * self.manner.gain));
        self.tally = self.tally.and(DropCounters { struck: 1, hardest: j, ..DropCounters::default() });
        let mut volume = drop.volume;
        let we = WATER * u * u * across(volume) / crate::rain::drops::shape::TENSION;
        if we > SPLASHES && self.manner.splash > 0.0 {
            volume -= self.splash(drop, (i, place), (n, rel));
        }
        let event = RainEvent::of(DropEventKind::Struck, drop.id, (self.t, place), volume);
        self.events.push(RainEvent { leaf: Some(i), blow: j * self.manner.gain, ..event });
        rel -= n * rel.dot(n);
        let v = blade.orientation.inverse() * rel * self.manner.tangent_keep;
        self.leaves[i].drops.push(SurfaceDrop::new(drop.id, side, uv, v, volume));
    }

    /// Lets a share of a drop leave as droplets, and returns its volume.
    fn splash(&mut self, drop: &FallingDrop, (leaf, place): (usize, DVec3), (n, rel): (DVec3, DVec3)) -> f64 {
        let mut draw = Rng::at(self.manner.seed, &["drop".into(), drop.id.into(), "splash".into()]);
        let wanted = self.manner.splash * drop.volume;
        let count = 6 + draw.below(15);
        let sizes: Vec<f64> = (0..count).map(|_| crate::rain::emitter::ball(draw.range(2e-4, 5e-4))).collect();
        let whole: f64 = sizes.iter().sum();
        let (x, y) = n.any_orthonormal_pair();
        let mut gone = 0.0;
        for size in sizes {
            let volume = wanted * size / whole;
            let (turn, lean) = (draw.range(0.0, std::f64::consts::TAU), draw.range(50.0, 70.0).to_radians());
            let flat = x * osier_base::math::cos(turn) + y * osier_base::math::sin(turn);
            let way = n * osier_base::math::cos(lean) + flat * osier_base::math::sin(lean);
            let v = way * (draw.range(0.2, 0.4) * rel.length()) + self.blades[leaf].velocity_at(place);
            let id = self.next() | NEW;
            let blind = Some((leaf, self.t + BLIND));
            let p = place + n * 1e-4;
            let event = RainEvent::of(DropEventKind::Born, id, (self.t, p), volume);
            self.events.push(RainEvent { other: Some(drop.id), ..event });
            self.air.push(FallingDrop { id, p, v, volume, blind, late: 0.0 });
            gone += volume;
        }
        gone
    }

    /// Drops on leaves, and what they do to these.
    fn lie(&mut self, h: f64) {
        let (t, blades, manner) = (self.t, &self.blades, &self.manner);
        let mut jobs: Vec<(&mut RainLeaf, LeafPose)> = self.leaves.iter_mut().zip(blades.iter().copied()).collect();
        let told = par_map_mut(&mut jobs, |(leaf, blade)| {
            if leaf.drops.is_empty() {
                return LeafStepResult { load: (0.0, blade.position), ..LeafStepResult::default() };
            }
            leaf.advance(&LeafStep { blade: *blade, t, h }, manner)
        });
        for (i, told) in told.iter().enumerate() {
            let (plant, k) = self.hung[i].on;
            let bearer = &mut self.bearers[plant];
            for (place, force) in &told.forces {
                bearer.apply_force(k, *place, *force);
            }
            bearer.set_attached_mass(k, told.load.0, told.load.1);
            self.tally = self.tally.and(told.tally);
            self.events.extend(told.events.iter().map(|e| RainEvent { leaf: Some(i), ..*e }));
        }
        for (i, told) in told.iter().enumerate() {
            for DetachedDrop { id: of, p, v, volume, whole } in &told.drips {
                let id = if *whole { *of } else { self.next() };
                let blind = Some((i, t + BLIND));
                let other = (!*whole).then_some(*of);
                self.events.push(RainEvent {
                    leaf: Some(i),
                    other,
                    ..RainEvent::of(DropEventKind::Fell, id, (t, *p), *volume)
                });
                self.air.push(FallingDrop { id, p: *p, v: *v, volume: *volume, blind, late: 0.0 });
            }
        }
        self.told.extend(told);
    }
}

#[cfg(test)]
mod tests;
