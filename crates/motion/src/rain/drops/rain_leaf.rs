//! What drops do on one leaf: they lie, run, merge, hang at the margin and fall.

use std::sync::Arc;

use glam::{DVec2, DVec3};

use super::pendant;
use crate::rain::drops::drop::{BEAD, PendantAnchor, SurfaceDrop};
use crate::rain::drops::shape::{SphericalCap, TENSION, WATER};
use crate::rain::event::RainEvent;
use crate::rain::leaf::surface::{LeafSurface, SurfacePoint};
use crate::rain::leaf::wetness::WetnessGrid;
use crate::rain::params::{DropParams, FrictionModel, LeverArm};
use crate::rain::target::LeafPose;
use osier_base::math;
use osier_base::noise::gradient2;
use osier_base::rng::Rng;
use osier_scene::DropEventKind;

/// Speed below which a drop lies, m/s.
const REST: f64 = 1e-3;
/// Speed across the margin at which a drop leaves, m/s.
const LEAVES: f64 = 0.3;
/// A shaking leaf's acceleration that counts, m/s^2.
const SHAKES: f64 = 50.0;
/// Directions that a running drop chooses from.
const WAYS: u32 = 16;
/// Cells of the leaf's unevenness across it.
const GRAIN: f64 = 14.0;
/// Widest place at the margin that a drop hangs from, m.
const WIDE: f64 = 1.5e-3;
/// Distance from the margin at which a drop goes along it, in base radii.
const AT_EDGE: f64 = 0.3;
/// A drop hangs at the tip if it comes as near as this, in its own radii.
const AT_TIP: f64 = 1.0;
/// Most pieces that one step's way is cut into.
const PIECES: u32 = 64;

/// A leaf with what lies on it.
#[derive(Debug, Clone)]
pub struct RainLeaf {
    /// Its blade.
    pub sheet: Arc<LeafSurface>,
    /// How much larger it is than that.
    pub scale: f64,
    /// In order of their ids.
    pub drops: Vec<SurfaceDrop>,
    /// Where it is wet.
    pub dew: WetnessGrid,
    /// Addresses its draws.
    pub number: u64,
}

/// What acts on a leaf during a step.
#[derive(Debug, Clone, Copy)]
pub struct LeafStep {
    /// Where the leaf is.
    pub blade: LeafPose,
    /// Time at the end of the step, s.
    pub t: f64,
    /// Its length, s.
    pub h: f64,
}

/// Water that leaves a leaf.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DetachedDrop {
    /// The drop it was, or was part of.
    pub id: u64,
    /// Where, in the world, m.
    pub p: DVec3,
    /// m/s.
    pub v: DVec3,
    /// m^3.
    pub volume: f64,
    /// The whole drop is gone.
    pub whole: bool,
}

/// A place that has just been under water.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WetSpot {
    /// Where.
    pub uv: DVec2,
    /// Radius of the base, m.
    pub a: f64,
    /// When, s.
    pub t: f64,
}

/// What happened to drops, by number.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct DropCounters {
    /// Came down on a leaf.
    pub struck: u64,
    /// Were swallowed by others.
    pub merged: u64,
    /// Were left behind by a tail.
    pub beads: u64,
    /// Came to hang.
    pub hung: u64,
    /// Fell from a leaf, or a part of one did.
    pub fell: u64,
    /// The hardest blow on a leaf, N s.
    pub hardest: f64,
}

impl DropCounters {
    /// Both.
    pub fn and(self, o: Self) -> Self {
        Self {
            struck: self.struck + o.struck,
            merged: self.merged + o.merged,
            beads: self.beads + o.beads,
            hung: self.hung + o.hung,
            fell: self.fell + o.fell,
            hardest: self.hardest.max(o.hardest),
        }
    }
}

/// What a leaf tells after a step.
#[derive(Debug, Clone, Default)]
pub struct LeafStepResult {
    /// What left it.
    pub drips: Vec<DetachedDrop>,
    /// Where it became wet.
    pub stamps: Vec<WetSpot>,
    /// What happened, in numbers.
    pub tally: DropCounters,
    /// What happened, one by one, in its order.
    pub events: Vec<RainEvent>,
    /// Forces on it beyond the water's weight, N, with their places in the world.
    pub forces: Vec<(DVec3, DVec3)>,
    /// Mass of the water on it, kg, and its middle in the world.
    pub load: (f64, DVec3),
}

impl LeafStepResult {
    /// A drop at a place of leaf space goes along the margin; told when it comes there.
    fn at_edge(&mut self, now: &LeafStep, drop: &mut SurfaceDrop, p: DVec3) {
        if !std::mem::replace(&mut drop.edge, true) {
            let p = now.blade.position + now.blade.orientation * p;
            self.events.push(RainEvent::of(DropEventKind::Edge, drop.id, (now.t, p), drop.volume));
        }
    }

    /// A drop has come to hang at a place of leaf space.
    fn hung(&mut self, now: &LeafStep, drop: &SurfaceDrop, p: DVec3) {
        self.tally.hung += 1;
        let p = now.blade.position + now.blade.orientation * p;
        self.events.push(RainEvent::of(DropEventKind::Hung, drop.id, (now.t, p), drop.volume));
    }
}

/// What pulls at a drop, in leaf space.
struct EffectiveGravity {
    /// Unit normal on its side.
    n: DVec3,
    /// Along the blade, m/s^2.
    along: DVec3,
    /// Towards the blade, m/s^2; below 0 away from it.
    onto: f64,
    g: DVec3,
}

/// What acts, and how drops answer.
pub(super) type StepLaw<'a> = (&'a LeafStep, &'a DropParams);

impl RainLeaf {
    /// An empty leaf.
    pub fn new(sheet: Arc<LeafSurface>, scale: f64, number: u64) -> Self {
        Self { sheet, scale, drops: Vec::new(), dew: WetnessGrid::default(), number }
    }

    /// The place at texture coordinates, m of leaf space.
    pub fn at(&self, uv: DVec2) -> Option<SurfacePoint> {
        self.sheet.at(uv, self.scale)
    }

    /// Volume of all water on it, m^3.
    pub fn volume(&self) -> f64 {
        self.drops.iter().map(|d| d.volume).sum()
    }

    /// Share of it that is wet, by how much: ways of drops as they dry, and what drops cover. `t`: s.
    pub fn wetness(&self, t: f64, manner: &DropParams) -> f64 {
        let ways = self.dew.mean(self.sheet.cells(), t, (manner.zeta, manner.half_life));
        let base = |d: &SurfaceDrop| {
            let a = d.head(manner, 1.0).a;
            std::f64::consts::PI * a * a
        };
        let lying = self.drops.iter().filter(|d| d.hang.is_none() && d.side > 0.0).map(base);
        let area = self.sheet.area() * self.scale * self.scale;
        (ways + lying.fold(0.0, |sum, b| sum + b) / area.max(f64::MIN_POSITIVE)).min(1.0)
    }

    /// One step of all drops.
    pub fn advance(&mut self, now: &LeafStep, manner: &DropParams) -> LeafStepResult {
        let mut told = LeafStepResult::default();
        let mut drops = std::mem::take(&mut self.drops);
        drops.sort_by_key(|d| d.id);
        let mut beads: Vec<SurfaceDrop> = Vec::new();
        for drop in &mut drops {
            if drop.hang.is_some() {
                self.dangle(drop, now, manner, &mut told);
            } else {
                self.run(drop, now, manner, &mut told);
                self.shed(drop, now, manner, (&mut beads, &mut told));
            }
        }
        drops.retain(|d| d.volume > 0.0);
        drops.append(&mut beads);
        self.merge(&mut drops, (now, manner), &mut told);
        self.drops = drops;
        self.press(now, manner, &mut told);
        self.wet(now, manner, &mut told);
        told
    }

    fn pull(&self, spot: &SurfacePoint, side: f64, now: &LeafStep, manner: &DropParams) -> EffectiveGravity {
        let place = now.blade.position + now.blade.orientation * spot.p;
        let shake = now.blade.acceleration_at(place).clamp_length_max(SHAKES);
        let g = now.blade.orientation.inverse() * (DVec3::NEG_Y * manner.g - shake);
        let n = spot.n * side;
        EffectiveGravity { n, along: g - n * g.dot(n), onto: -g.dot(n), g }
    }

    /// The paper's wedge asks how far the leaf's normal and the drop's agree.
    fn facing(now: &LeafStep, pull: &EffectiveGravity) -> f64 {
        (now.blade.orientation * pull.n).y.abs()
    }

    /// Force that holds a drop back, N.
    fn retention(
        &self,
        drop: &SurfaceDrop,
        (cap, spot): (&SphericalCap, &SurfacePoint),
        way: DVec3,
        (now, manner): StepLaw<'_>,
    ) -> f64 {
        let w = manner.wetting;
        let width = 2.0 * cap.a / drop.stretch();
        let grain = self.grain(drop.uv, manner);
        let ahead = drop.uv + spot.uv(way * (1.3 * cap.a));
        let wet = self.dew.at(ahead, now.t, (manner.zeta, manner.half_life));
        let held = manner.k_f * TENSION * width * (math::cos(w.receding) - math::cos(w.advancing));
        held * (1.0 + manner.pin_noise * grain) * (1.0 - 0.5 * wet)
    }

    /// Unevenness of the leaf at a place, about -1 to 1.
    fn grain(&self, uv: DVec2, manner: &DropParams) -> f64 {
        let p = [math::narrow(uv.x * GRAIN), math::narrow(uv.y * GRAIN)];
        f64::from(gradient2(Rng::key(manner.seed, &["pin".into(), self.number.into()]), p, [4096, 4096]))
    }

    /// A drop that lies or runs.
    fn run(&self, drop: &mut SurfaceDrop, now: &LeafStep, manner: &DropParams, told: &mut LeafStepResult) {
        let Some(spot) = self.at(drop.uv) else {
            return self.release(drop, now, (self.tip_of(drop), DVec3::ZERO), told);
        };
        let pull = self.pull(&spot, drop.side, now, manner);
        let m = WATER * drop.volume;
        drop.merged += now.h;
        let cap = drop.head(manner, Self::facing(now, &pull));
        let hold = 2.0 * std::f64::consts::PI * cap.a * TENSION * math::sin(manner.wetting.receding);
        if -m * pull.onto > hold {
            return self.release(drop, now, (spot.p + pull.n * cap.top(), drop.v), told);
        }
        drop.v -= pull.n * drop.v.dot(pull.n);
        let ghat = pull.along.normalize_or(drop.axis);
        let force = m * pull.along.length();
        let vhat = if drop.v.length() > REST { drop.v.normalize() } else { ghat };
        let held = self.retention(drop, (&cap, &spot), vhat, (now, manner));
        drop.lean = match manner.friction {
            FrictionModel::Retention if held > 0.0 => (force / held).min(1.0),
            _ => 1.0,
        };
        let lies = drop.v.length() <= REST;
        if lies {
            drop.v = DVec3::ZERO;
            let toward = ghat - drop.axis * drop.axis.dot(ghat);
            drop.axis = (drop.axis + toward * (now.h / 0.1).min(1.0)).normalize_or(ghat);
        } else {
            drop.axis = vhat;
        }
        let still = match manner.friction {
            FrictionModel::Retention => force <= held,
            FrictionModel::Paper => force <= manner.mu * m * pull.onto.abs() + manner.h,
        };
        if lies && still {
            drop.tail(cap.a, now.h, manner);
            return;
        }
        self.drive(drop, &pull, (m, held, &cap), (now, manner));
        self.go(drop, (&pull, &cap), (now, manner), told);
    }

    /// Forces change its speed.
    fn drive(
        &self,
        drop: &mut SurfaceDrop,
        pull: &EffectiveGravity,
        (m, held, cap): (f64, f64, &SphericalCap),
        (now, manner): StepLaw<'_>,
    ) {
        let h = now.h;
        drop.quiet = false;
        drop.v += pull.along * h;
        let brake = match manner.friction {
            FrictionModel::Retention => 0.7 * held + manner.mu * m * pull.onto.abs(),
            FrictionModel::Paper => manner.mu * m * pull.onto.abs() + manner.h,
        };
        let speed = drop.v.length();
        let slower = (speed - h * brake / m).max(0.0) / (1.0 + h / manner.tau_v);
        drop.v = drop.v.normalize_or_zero() * slower;
        if slower <= REST {
            drop.v = DVec3::ZERO;
        } else if drop.straight >= 0.5 * cap.a {
            self.choose(drop, (pull, cap), (now, manner));
            drop.straight = 0.0;
        }
    }

    /// Turns to where it is steep, wet and along a vein. Source: own.
    fn choose(
        &self,
        drop: &mut SurfaceDrop,
        (pull, cap): (&EffectiveGravity, &SphericalCap),
        (now, manner): StepLaw<'_>,
    ) {
        let Some(spot) = self.at(drop.uv) else { return };
        let (vhat, ghat) = (drop.v.normalize_or_zero(), pull.along.normalize_or_zero());
        let across = pull.n.cross(vhat);
        let ring = (drop.v.length() * now.h).max(0.6 * cap.a);
        let mut best = (f64::NEG_INFINITY, vhat);
        for k in 0..WAYS {
            let turn = 2.0 * std::f64::consts::PI * f64::from(k) / f64::from(WAYS);
            let d = vhat * math::cos(turn) + across * math::sin(turn);
            let there = drop.uv + spot.uv(d * ring);
            let wet = self.dew.at(there, now.t, (manner.zeta, manner.half_life));
            let vein = self.sheet.vein(there);
            let grain = self.grain(there * 2.0, manner);
            let score = d.dot(vhat) + 0.5 * d.dot(ghat) + 0.3 * wet + 0.2 * vein + 0.15 * grain;
            if score > best.0 {
                best = (score, d);
            }
        }
        drop.v = best.1 * (drop.v.length() * best.1.dot(vhat).max(0.0));
    }

    /// Moves along the blade; the margin turns it, holds it or lets it go.
    fn go(
        &self,
        drop: &mut SurfaceDrop,
        (pull, cap): (&EffectiveGravity, &SphericalCap),
        (now, manner): StepLaw<'_>,
        told: &mut LeafStepResult,
    ) {
        let way = drop.v.length() * now.h;
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped")]
        let pieces = (way / (0.5 * cap.a.max(1e-5))).ceil().clamp(1.0, f64::from(PIECES)) as u32;
        let h = now.h / f64::from(pieces);
        for _ in 0..pieces {
            let Some(spot) = self.at(drop.uv) else { return };
            let Some(rim) = self.sheet.rim(spot.p, self.scale) else { return };
            drop.edge &= rim.distance < 2.0 * AT_EDGE * cap.a;
            if rim.distance < AT_EDGE * cap.a {
                let n = spot.n * drop.side;
                let out = (rim.p - spot.p).normalize_or(n.cross(rim.along));
                let across = drop.v.dot(out);
                if across > LEAVES {
                    return self.release(drop, now, (rim.p, drop.v), told);
                }
                drop.v -= out * across.max(0.0);
                told.at_edge(now, drop, spot.p);
                if self.hang(drop, (pull, cap), (&rim, out), manner) {
                    return told.hung(now, drop, rim.p);
                }
            }
            let step = drop.v * h;
            let next = drop.uv + spot.uv(step);
            match self.at(next) {
                Some(there) => {
                    drop.pass(drop.uv, step.length(), cap.a, manner);
                    drop.uv = next;
                    let n = there.n * drop.side;
                    let speed = drop.v.length();
                    drop.v = (drop.v - n * drop.v.dot(n)).normalize_or_zero() * speed;
                }
                None => {
                    // Over the margin within one piece: it goes on along it.
                    let out = (rim.p - spot.p).normalize_or(spot.n.cross(rim.along));
                    let across = drop.v.dot(out).max(0.0);
                    if across > LEAVES {
                        return self.release(drop, now, (rim.p, drop.v), told);
                    }
                    drop.v = rim.along * drop.v.dot(rim.along);
                    told.at_edge(now, drop, spot.p);
                    let inward = spot.uv((spot.p - rim.p).normalize_or_zero() * (0.02 * cap.a));
                    if self.at(drop.uv + inward).is_some() {
                        drop.uv += inward;
                    }
                    if self.hang(drop, (pull, cap), (&rim, out), manner) {
                        told.hung(now, drop, rim.p);
                    }
                    return;
                }
            }
        }
    }

    /// Whether a drop at the margin, which pulls over it, now hangs there: at a tip, at a low point, or where nothing drives
    /// it along.
    fn hang(
        &self,
        drop: &mut SurfaceDrop,
        (pull, cap): (&EffectiveGravity, &SphericalCap),
        (rim, out): (&crate::rain::leaf::surface::MarginPoint, DVec3),
        manner: &DropParams,
    ) -> bool {
        let m = WATER * drop.volume;
        let held = manner.k_f
            * TENSION
            * 2.0
            * cap.a
            * (math::cos(manner.wetting.receding) - math::cos(manner.wetting.advancing));
        if m * pull.along.dot(out) <= held.min(0.5 * m * pull.g.length()) {
            return false;
        }
        let down = pull.g.normalize_or_zero();
        let reach = cap.a.max(1e-3);
        let above = |way: f64| (self.sheet.along_rim(rim, way, self.scale) - rim.p).dot(down) < 1e-6;
        let tip = self.sheet.is_tip(rim.p, self.scale, AT_TIP * reach);
        let stuck = m * pull.along.dot(rim.along).abs() <= held && drop.v.length() < 10.0 * REST;
        if !(tip || (above(reach) && above(-reach)) || stuck) {
            return false;
        }
        let radius = if tip { manner.tip_radius } else { cap.a.min(WIDE) };
        let bounds = pendant::RADII.map(|r| r * manner.wetting.capillary);
        let hang = PendantAnchor { rim: *rim, radius: radius.clamp(bounds[0], bounds[1]), out, thin: None };
        drop.loosen();
        drop.hang = Some(hang);
        drop.v = DVec3::ZERO;
        drop.lean = 0.0;
        drop.quiet = false;
        true
    }

    /// A drop that hangs at the margin.
    fn dangle(&self, drop: &mut SurfaceDrop, now: &LeafStep, manner: &DropParams, told: &mut LeafStepResult) {
        let Some(mut hang) = drop.hang else { return };
        let place = now.blade.position + now.blade.orientation * hang.rim.p;
        let shake = now.blade.acceleration_at(place).clamp_length_max(SHAKES);
        let g = now.blade.orientation.inverse() * (DVec3::NEG_Y * manner.g - shake);
        drop.axis = g.normalize_or(drop.axis);
        if g.dot(hang.out) < -0.2 * g.length() {
            // The leaf has tipped over: it runs back.
            let inside = hang.rim.p - hang.out * (0.35 * hang.radius);
            let uv = self.sheet.uv_at_rim(&hang.rim);
            let spot = self.at(uv + (DVec2::splat(0.5) - uv) * 1e-3);
            if let Some(spot) = spot {
                let back = uv + spot.uv(inside - spot.p);
                drop.uv = if self.at(back).is_some() { back } else { uv + (DVec2::splat(0.5) - uv) * 1e-2 };
                drop.loosen();
                drop.axis = -hang.out;
                return;
            }
        }
        let most = pendant::holds(hang.radius, g.length());
        if drop.volume <= most {
            hang.thin = None;
        } else {
            let thin = hang.thin.unwrap_or(0.0) + now.h;
            hang.thin = Some(thin);
            if thin >= pendant::THINS {
                let falls = (pendant::FALLS * most).min(drop.volume);
                drop.volume -= falls;
                hang.thin = None;
                let length = most / (std::f64::consts::PI * hang.radius * hang.radius);
                let p = place + (now.blade.orientation * drop.axis) * length.min(5e-3);
                let v = now.blade.velocity_at(place);
                told.drips.push(DetachedDrop { id: drop.id, p, v, volume: falls, whole: drop.volume <= 0.0 });
                told.tally.fell += 1;
            }
        }
        drop.hang = Some(hang);
    }

    fn tip_of(&self, drop: &SurfaceDrop) -> DVec3 {
        let near = drop.uv.clamp(DVec2::splat(0.01), DVec2::splat(0.99));
        self.at(near).map_or(DVec3::ZERO, |s| s.p)
    }

    /// Lets a whole drop go from a place with a velocity, both of leaf space.
    fn release(&self, drop: &mut SurfaceDrop, now: &LeafStep, (p, v): (DVec3, DVec3), told: &mut LeafStepResult) {
        let p = now.blade.position + now.blade.orientation * p;
        let v = now.blade.velocity_at(p) + now.blade.orientation * v;
        told.drips.push(DetachedDrop { id: drop.id, p, v, volume: drop.volume, whole: true });
        told.tally.fell += 1;
        drop.volume = 0.0;
    }

    /// A tail that draws in may leave a bead behind.
    fn shed(
        &self,
        drop: &mut SurfaceDrop,
        now: &LeafStep,
        manner: &DropParams,
        (beads, told): (&mut Vec<SurfaceDrop>, &mut LeafStepResult),
    ) {
        if drop.volume <= 0.0 || drop.hang.is_some() {
            return;
        }
        let a = drop.head(manner, 1.0).a;
        let tail = (drop.active > 1.0).then(|| drop.beads(manner, 1.0));
        let Some((lost, tail)) = drop.tail(a, now.h, manner).zip(tail) else { return };
        let Some(bead) = tail.get(lost).filter(|b| b.cap.r > BEAD) else { return };
        let mut draw = Rng::at(manner.seed, &["drop".into(), drop.id.into(), "bead".into(), drop.draws.into()]);
        drop.draws += 1;
        if !draw.chance(manner.bead) || self.at(bead.uv).is_none() {
            return;
        }
        drop.volume -= bead.volume;
        let id = draw.next_u64() | (1 << 63);
        let mut left = SurfaceDrop::new(id, drop.side, bead.uv, DVec3::ZERO, bead.volume);
        left.axis = drop.axis;
        told.tally.beads += 1;
        let p = self.at(bead.uv).map_or(now.blade.position, |s| now.blade.position + now.blade.orientation * s.p);
        told.events.push(RainEvent {
            other: Some(drop.id),
            ..RainEvent::of(DropEventKind::Bead, id, (now.t, p), bead.volume)
        });
        beads.push(left);
    }

    /// What the water presses on the leaf with. Source: [yang-wu] eq. 14 and 15, as forces.
    fn press(&self, now: &LeafStep, manner: &DropParams, told: &mut LeafStepResult) {
        let mut sum = (0.0, DVec3::ZERO);
        for drop in &self.drops {
            let local = match drop.hang {
                Some(hang) => Some(hang.rim.p),
                None => self.at(drop.uv).map(|s| s.p),
            };
            let Some(local) = local else { continue };
            let place = now.blade.position + now.blade.orientation * local;
            let m = WATER * drop.volume;
            let weight = DVec3::NEG_Y * (m * manner.g);
            let lever = match manner.lever {
                LeverArm::Physical => 1.0,
                LeverArm::Paper(most) => (local.length() / self.reach()).min(most),
            };
            let force = match self.at(drop.uv).filter(|_| drop.hang.is_none() && drop.v.length() > REST) {
                None => weight,
                Some(spot) => {
                    // What runs presses with the part onto the leaf and drags with what holds it.
                    let n = now.blade.orientation * spot.n * drop.side;
                    let along = weight - n * weight.dot(n);
                    let held = (along.length() * 0.7).min(m * drop.v.length() / manner.tau_v);
                    n * weight.dot(n) + along.normalize_or_zero() * held
                }
            };
            // Its load weighs by itself.
            let more = force * lever - weight;
            if more != DVec3::ZERO {
                told.forces.push((place, more));
            }
            sum = (sum.0 + m, sum.1 + place * m);
        }
        told.load = (sum.0, if sum.0 > 0.0 { sum.1 / sum.0 } else { now.blade.position });
    }

    fn reach(&self) -> f64 {
        self.sheet.points().iter().fold(1e-6, |m: f64, p| m.max(p.length())) * self.scale
    }

    /// Remembers what is under water.
    fn wet(&mut self, now: &LeafStep, manner: &DropParams, told: &mut LeafStepResult) {
        for k in 0..self.drops.len() {
            let drop = &self.drops[k];
            if drop.hang.is_some() {
                continue;
            }
            let a = drop.head(manner, 1.0).a;
            let (Some(spot), uv) = (self.at(drop.uv), drop.uv) else { continue };
            let moved = drop.wetted.and_then(|w| self.at(w)).map_or(f64::INFINITY, |w| w.p.distance(spot.p));
            if moved > 0.25 * a {
                told.stamps.push(WetSpot { uv, a, t: now.t });
                // What it lies on does not ease its own way: only what it has left is wet to those that come.
                if let Some(left) = drop.wetted {
                    self.dew.cover(left, spot.fastest() * a, now.t);
                }
                self.drops[k].wetted = Some(uv);
            }
        }
    }
}
