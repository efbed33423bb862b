//! Rods that hang together, and how they move.

use glam::{DMat3, DQuat, DVec3};

use crate::rods::layout::{Rod, Tree, index};
use crate::rods::prism::{Block, Corners, Frame, Grip, add, corner, corners, dot, middle, times};
use crate::rods::solver::assemble::{Assembly, Rider};
use crate::rods::solver::block::{Above, Rows, solve};
use osier_base::math;
use osier_scene::plant::NONE;

/// How much stiffer than its section a clamp holds.
const GRIP: f64 = 1e7;
/// Share of its slowest swing's period, over 2 pi, that a step of auto length lasts, and the fastest swing that counts, Hz.
const PHASE: f64 = 0.4;
const VISIBLE: f64 = 25.0;
/// Fewest and most steps of a frame, if nothing is said.
const STEPS: [f64; 2] = [8.0, 64.0];

/// How a section is held.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Hold {
    /// It neither moves nor turns.
    Fixed,
    /// Its centre stays where it is.
    Pinned,
    /// Its centre stays on a line along this direction.
    Guided(DVec3),
}

/// A section that is held, and where it is moved to.
#[derive(Debug, Clone)]
pub struct Clamp {
    /// Section.
    pub section: usize,
    /// How.
    pub hold: Hold,
    /// From where it was drawn, m.
    pub shift: DVec3,
    /// About its centre, from how it was drawn.
    pub turn: DQuat,
    drawn: Corners,
}

impl Clamp {
    fn target(&self) -> Corners {
        let p = middle(&self.drawn);
        corners(|c| p + self.shift + self.turn * (corner(&self.drawn, c) - p))
    }

    /// Directions over corners that are held, and how many of them.
    fn ways(&self) -> ([Corners; 9], usize) {
        let mut ways = [[0.0; 9]; 9];
        if self.hold == Hold::Fixed {
            ways.iter_mut().enumerate().for_each(|(k, w)| w[k] = 1.0);
            return (ways, 9);
        }
        let across = |d: DVec3| corners(|_| d / math::sqrt(3.0));
        if let Hold::Guided(line) = self.hold {
            let line = line.normalize_or(DVec3::Y);
            let (a, b) = line.any_orthonormal_pair();
            (ways[0], ways[1]) = (across(a), across(b));
            return (ways, 2);
        }
        for (w, d) in ways.iter_mut().zip([DVec3::X, DVec3::Y, DVec3::Z]) {
            *w = across(d);
        }
        (ways, 3)
    }
}

/// A body that is rigid with a section: a blade, or a weight.
#[derive(Debug, Clone)]
pub struct Body {
    /// Section.
    pub section: usize,
    /// Centre, in the section's frame (u, v, w), m.
    pub at: DVec3,
    /// kg.
    pub mass: f64,
    /// About its centre, in the section's frame, kg m^2.
    pub inertia: DMat3,
    /// Part of the plant: it is damped and drawn back with the wood, and the slowest swing is found with it.
    pub own: bool,
    /// Radius with which it comes to lie on the ground once it is let go, m.
    pub reach: f64,
}

/// What a rod does against its motion.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Manner {
    /// Slowest swing, Hz, without springs back.
    pub hertz: f64,
    /// Springs back per mass, 1/s^2.
    pub recovery: f64,
    /// Damping by mass, 1/s, and by stiffness, s.
    pub mass: f64,
    pub stiffness: f64,
}

/// A section with bodies: mass with all of them, and with those of the plant.
#[derive(Debug, Clone)]
struct Heavy {
    all: Block,
    own: Block,
}

/// Rods that hang together: their state, and everything that acts on them.
#[derive(Debug, Clone)]
pub struct Rods {
    pub(crate) tree: Tree,
    pub(crate) clamps: Vec<Clamp>,
    pub(crate) bodies: Vec<Body>,
    /// m/s^2.
    pub gravity: DVec3,
    /// Wood and blades weigh nothing; the artist's pose stays.
    pub weightless: bool,
    pub(crate) manners: Vec<Manner>,
    /// Per rod: section whose frame its rest places live in, or the clamp's; none without a fixed one.
    anchors: Vec<Anchor>,
    /// Rest places in the anchor's frame, m.
    home: Vec<Corners>,
    /// Places and velocities, now and a step before.
    pub(crate) x: Vec<Corners>,
    pub(crate) v: Vec<Corners>,
    pub(crate) before: [Vec<Corners>; 2],
    /// Forces from outside during a step, N, and those that last only this step.
    outside: Vec<Corners>,
    blows: Vec<Corners>,
    /// Share of a blow that the step gives by itself; the rest comes with those that follow.
    pub(crate) share: f64,
    /// No step was taken since the start.
    pub(crate) fresh: bool,
    pub(crate) step: Step,
    /// Nothing goes farther from the origin, m.
    pub(crate) horizon: f64,
}

/// Where the rest places of a rod hang.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Anchor {
    None,
    Clamp(usize),
    Section(usize),
}

/// Numbers of one step: made once, filled anew.
#[derive(Debug, Clone, Default)]
pub(crate) struct Step {
    pub rows: Vec<Rows>,
    pub change: Vec<Corners>,
    pub force: Vec<Corners>,
    /// Weights and what else does not change within a step.
    pub load: Vec<Corners>,
    /// Rest places in the world.
    pub places: Vec<Corners>,
    pub next: Vec<Corners>,
    pub speed: Vec<Corners>,
    pub riders: Vec<Rider>,
    pub damping: Vec<f64>,
    pub factors: Vec<f64>,
    heavy: Vec<Heavy>,
    /// Per section: index among the heavy ones, or [`NONE`].
    heavy_at: Vec<u32>,
}

impl Rods {
    /// Lays out rods with bodies; every section as drawn, at rest. Parents stand before children. `holds`: rod, arc length
    /// on it, m, and how.
    pub fn new(rods: &[Rod], holds: &[(usize, f64, Hold)]) -> Self {
        let tree = Tree::new(rods);
        let n = tree.sections.len();
        let zero = vec![[0.0; 9]; n];
        let clamp = |(rod, s, hold): &(usize, f64, Hold)| {
            let section = tree.nearest(*rod, *s);
            Clamp { section, hold: *hold, shift: DVec3::ZERO, turn: DQuat::IDENTITY, drawn: tree.drawn[section] }
        };
        let clamps: Vec<Clamp> = holds.iter().map(clamp).collect();
        let step = Step {
            rows: vec![Rows::default(); n],
            change: zero.clone(),
            force: zero.clone(),
            load: zero.clone(),
            places: tree.drawn.clone(),
            next: zero.clone(),
            speed: zero.clone(),
            riders: vec![Rider::default(); tree.bases.len()],
            damping: vec![0.0; rods.len()],
            factors: vec![1.0; rods.len()],
            heavy: Vec::new(),
            heavy_at: vec![NONE; n],
        };
        let mut all = Self {
            x: tree.drawn.clone(),
            v: zero.clone(),
            before: [tree.drawn.clone(), zero.clone()],
            blows: zero.clone(),
            outside: zero,
            share: 1.0,
            fresh: true,
            manners: vec![Manner::default(); rods.len()],
            anchors: vec![Anchor::None; rods.len()],
            home: tree.drawn.clone(),
            bodies: Vec::new(),
            gravity: DVec3::new(0.0, -9.81, 0.0),
            weightless: false,
            tree,
            clamps,
            step,
            horizon: f64::MAX,
        };
        all.anchor();
        all.settle_home(&all.tree.drawn.clone());
        all.measure();
        all
    }

    /// Adds bodies, and measures the rods with them.
    #[must_use]
    pub fn with(mut self, bodies: Vec<Body>) -> Self {
        self.bodies.extend(bodies);
        self.measure();
        self
    }

    fn anchor(&mut self) {
        for (rod, span) in self.tree.spans.iter().enumerate() {
            let fixed = |c: &Clamp| c.hold == Hold::Fixed && span.sections.contains(&c.section);
            self.anchors[rod] = match (span.base, self.clamps.iter().position(fixed)) {
                (Some(base), _) => Anchor::Section(self.tree.bases[base].on as usize),
                (None, Some(clamp)) => Anchor::Clamp(clamp),
                (None, None) => Anchor::None,
            };
        }
    }

    /// Where a rod hangs after `h` seconds, as far as its carrier's motion tells.
    fn anchor_frame(&self, rod: usize, h: f64) -> Option<Frame> {
        match self.anchors[rod] {
            Anchor::None => None,
            Anchor::Clamp(c) => Some(Frame::of(&self.clamps[c].target())),
            Anchor::Section(s) => {
                let (v, spin) = Grip::of(&self.x[s]).motion(&self.v[s]);
                Some(Frame::of(&self.x[s]).moved(v * h, spin * h))
            }
        }
    }

    /// Makes these corners the rest places; anchors are where they are now.
    pub(crate) fn settle_home(&mut self, x: &[Corners]) {
        for i in 0..x.len() {
            self.home[i] = match self.anchors[self.tree.sections[i].rod] {
                Anchor::None => x[i],
                Anchor::Clamp(c) => Frame::of(&self.clamps[c].drawn).local(&x[i]),
                Anchor::Section(s) => Frame::of(&x[s]).local(&x[i]),
            };
        }
    }

    /// Whether a rod hangs on something that does not turn freely: only such a one is drawn back and damped by its mass.
    pub fn is_anchored(&self, rod: usize) -> bool {
        self.anchors[rod] != Anchor::None
    }

    /// The section that holds a rod, if it is one of its own.
    pub(crate) fn held_at(&self, rod: usize) -> Option<usize> {
        match self.anchors[rod] {
            Anchor::Clamp(c) => Some(self.clamps[c].section),
            _ => None,
        }
    }

    /// Number of sections.
    pub fn len(&self) -> usize {
        self.x.len()
    }

    /// True without sections.
    pub fn is_empty(&self) -> bool {
        self.x.is_empty()
    }

    /// Sections of a rod, without one that rides on another rod.
    pub fn sections(&self, rod: usize) -> std::ops::Range<usize> {
        self.tree.spans[rod].sections.clone()
    }

    /// The section of a rod nearest to an arc length, m.
    pub fn nearest(&self, rod: usize, s: f64) -> usize {
        self.tree.nearest(rod, s)
    }

    /// Arc length of a section on its rod, m.
    pub fn place(&self, section: usize) -> f64 {
        self.tree.sections[section].s
    }

    /// Rod of a section.
    pub fn rod_of(&self, section: usize) -> usize {
        self.tree.sections[section].rod
    }

    /// Where a section is, and how it is turned.
    pub fn frame(&self, section: usize) -> Frame {
        Frame::of(&self.x[section])
    }

    /// The same as it was drawn.
    pub fn drawn(&self, section: usize) -> Frame {
        Frame::of(&self.tree.drawn[section])
    }

    /// The section that a rod's base rides on, and that base as it was drawn.
    pub fn base(&self, rod: usize) -> Option<(usize, Frame)> {
        let base = &self.tree.bases[self.tree.spans[rod].base?];
        let on = base.on as usize;
        Some((on, Frame::of(&self.drawn(on).carry(&base.local))))
    }

    /// Radius at a section, m.
    pub fn radius(&self, section: usize) -> f64 {
        self.tree.sections[section].radius
    }

    /// The bodies.
    pub fn bodies(&self) -> &[Body] {
        &self.bodies
    }

    /// Velocity of a section's centre, m/s, and its turning, rad/s.
    pub fn motion(&self, section: usize) -> (DVec3, DVec3) {
        Grip::of(&self.x[section]).motion(&self.v[section])
    }

    /// Slowest swing of a rod with all that it carries, Hz, without springs back.
    pub fn hertz(&self, rod: usize) -> f64 {
        self.manners[rod].hertz
    }

    /// Steps a frame needs for its fastest visible swing. `fps`: frames per second.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped")]
    pub fn steps(&self, fps: f64) -> u32 {
        let fastest = self.manners.iter().fold(0.0, |m: f64, k| m.max(k.hertz)).min(VISIBLE);
        (std::f64::consts::TAU * fastest / (PHASE * fps)).ceil().clamp(STEPS[0], STEPS[1]) as u32
    }

    /// How many times softer in torsion than its material a rod is: 1 unless its intervals are long.
    pub fn torsion_lost(&self, rod: usize) -> f64 {
        self.tree.spans[rod].intervals.iter().fold(1.0, |m, l| l.torsion_lost().max(m))
    }

    /// Takes all forces from outside away.
    pub fn calm(&mut self) {
        self.outside.fill([0.0; 9]);
        self.blows.fill([0.0; 9]);
    }

    /// Adds a force, N, and a torque, N m, at a section's centre, until [`Rods::calm`].
    pub fn pull(&mut self, section: usize, force: DVec3, torque: DVec3) {
        let f = Grip::of(&self.x[section]).wrench(force, torque);
        (0..9).for_each(|k| self.outside[section][k] += f[k]);
    }

    /// Adds a blow, N s, at a place (m, world) of what is rigid with a section, to a step of `h` seconds. Taken away by
    /// [`Rods::calm`], which must follow the step.
    pub fn strike(&mut self, section: usize, place: DVec3, blow: DVec3, h: f64) {
        let arm = place - middle(&self.x[section]);
        let f = Grip::of(&self.x[section]).wrench(blow / h, arm.cross(blow) / h);
        (0..9).for_each(|k| self.blows[section][k] += f[k]);
    }

    /// Sets the velocity of a section, m/s.
    pub fn launch(&mut self, section: usize, velocity: DVec3) {
        self.v[section] = corners(|_| velocity);
    }

    /// What a section's mass does with a force: M^-1 f.
    pub(crate) fn accelerated(&self, i: usize, f: &Corners) -> Corners {
        match self.step.heavy.get(self.step.heavy_at[i] as usize) {
            None => f.map(|f| f / self.tree.sections[i].mass),
            Some(heavy) => solved(&heavy.all, f),
        }
    }

    /// M times something; `own`: without foreign bodies.
    #[inline]
    pub(crate) fn massed(&self, i: usize, x: &Corners, own: bool) -> Corners {
        match self.step.heavy.get(self.step.heavy_at[i] as usize) {
            None => x.map(|x| x * self.tree.sections[i].mass),
            Some(heavy) => times(if own { &heavy.own } else { &heavy.all }, x),
        }
    }

    /// Adds `all` M + `own` M_own to a section's own block.
    #[inline]
    pub(crate) fn add_mass(&mut self, i: usize, all: f64, own: f64) {
        let rows = &mut self.step.rows[i].0;
        match self.step.heavy.get(self.step.heavy_at[i] as usize) {
            None => {
                let m = self.tree.sections[i].mass * (all + own);
                (0..9).for_each(|k| rows[k][k] += m);
            }
            Some(heavy) => {
                for (row, (a, o)) in rows.iter_mut().zip(heavy.all.iter().zip(&heavy.own)) {
                    (0..9).for_each(|k| row[k] += all * a[k] + own * o[k]);
                }
            }
        }
    }

    /// Masses of the sections that carry bodies, as these are turned now.
    pub(crate) fn weigh(&mut self) {
        let Self { tree, bodies, x, step, .. } = self;
        step.heavy.clear();
        step.heavy_at.fill(NONE);
        for body in bodies.iter() {
            let i = body.section;
            if step.heavy_at[i] == NONE {
                step.heavy_at[i] = index(step.heavy.len());
                let mut bare = [[0.0; 9]; 9];
                (0..9).for_each(|k| bare[k][k] = tree.sections[i].mass);
                step.heavy.push(Heavy { all: bare, own: bare });
            }
            if body.mass <= 0.0 {
                continue;
            }
            let m = Frame::of(&x[i]).matrix();
            let block = Grip::of(&x[i]).mass(m * body.at, body.mass, m * body.inertia * m.transpose());
            let heavy = &mut step.heavy[step.heavy_at[i] as usize];
            for k in 0..9 {
                for c in 0..9 {
                    heavy.all[k][c] += block[k][c];
                    heavy.own[k][c] += if body.own { block[k][c] } else { 0.0 };
                }
            }
        }
    }

    /// Everything that stays the same within a step of `h` seconds: masses, rest places, weights, forces from outside, and
    /// what springs back to places in a section's frame do to that section: what they did to their rod in the step before.
    pub(crate) fn prepare(&mut self, h: f64) {
        self.weigh();
        for (load, (f, blow)) in self.step.load.iter_mut().zip(self.outside.iter().zip(&self.blows)) {
            (0..9).for_each(|k| load[k] = f[k] + self.share * blow[k]);
        }
        self.add_weights();
        for rod in 0..self.tree.spans.len() {
            self.add_reaction(rod);
        }
        for rod in 0..self.tree.spans.len() {
            let frame = self.anchor_frame(rod, h);
            for i in self.tree.spans[rod].sections.clone() {
                self.step.places[i] = frame.map_or(self.home[i], |f| f.carry(&self.home[i]));
            }
        }
    }

    fn add_weights(&mut self) {
        let Self { tree, bodies, x, v, step, gravity, weightless, .. } = self;
        if !*weightless {
            for (load, section) in step.load.iter_mut().zip(&tree.sections) {
                (0..3).for_each(|c| add(load, c, *gravity * section.mass));
            }
        }
        for body in bodies.iter().filter(|b| b.mass > 0.0) {
            let i = body.section;
            let (grip, m) = (Grip::of(&x[i]), Frame::of(&x[i]).matrix());
            let arm = m * body.at;
            let (_, spin) = grip.motion(&v[i]);
            let inertia = m * body.inertia * m.transpose();
            // What turns keeps to its circle, and what tumbles keeps its moment of momentum.
            let mut force = -body.mass * spin.cross(spin.cross(arm));
            if !(*weightless && body.own) {
                force += body.mass * *gravity;
            }
            let torque = arm.cross(force) - spin.cross(inertia * spin);
            let f = grip.wrench(force, torque);
            (0..9).for_each(|k| step.load[i][k] += f[k]);
        }
    }

    /// The opposite of a rod's springs back acts on the section in whose frame their places live.
    fn add_reaction(&mut self, rod: usize) {
        let Anchor::Section(on) = self.anchors[rod] else { return };
        let recovery = self.manners[rod].recovery;
        if recovery <= 0.0 {
            return;
        }
        let grip = Grip::of(&self.x[on]);
        let (mut force, mut torque) = (DVec3::ZERO, DVec3::ZERO);
        for i in self.tree.spans[rod].sections.clone() {
            let away = minus(&self.x[i], &self.step.places[i]);
            let f = self.massed(i, &away, true);
            for c in 0..3 {
                let f = corner(&f, c) * recovery;
                force += f;
                torque += (corner(&self.x[i], c) - grip.p).cross(f);
            }
        }
        let f = grip.wrench(force, torque);
        (0..9).for_each(|k| self.step.load[on][k] += f[k]);
    }

    /// Forces of the springs in `step.next` and `step.speed`; `factors`: also their stiffness, times these of `step`.
    pub(crate) fn assemble(&mut self, stiff: bool) {
        let Self { tree, step, .. } = self;
        let Step { rows, force, next, speed, riders, damping, factors, .. } = step;
        let rows = stiff.then_some((rows.as_mut_slice(), factors.as_slice()));
        Assembly { tree, x: next, v: speed, damping, riders, force, rows }.run();
    }

    /// Force of the springs back to a section's rest place: -M (x - place), per their strength.
    pub(crate) fn drawn_back(&self, i: usize) -> Corners {
        self.massed(i, &minus(&self.step.next[i], &self.step.places[i]), true)
    }

    /// Holds what is clamped: rows and right sides then lead to where the clamps are.
    pub(crate) fn clamp(&mut self) {
        let Self { clamps, step, .. } = self;
        for clamp in clamps.iter() {
            let rows = &mut step.rows[clamp.section];
            let grip = GRIP * rows.peak();
            let away = minus(&clamp.target(), &step.next[clamp.section]);
            let (ways, count) = clamp.ways();
            for way in &ways[..count] {
                let d = grip * dot(way, &away);
                for k in 0..9 {
                    let f = grip * way[k];
                    (0..9).for_each(|c| rows.0[k][c] += f * way[c]);
                    rows.0[k][crate::rods::solver::block::RIGHT] += d * way[k];
                }
            }
        }
    }

    /// Corrects velocities for a step of `h` seconds so that what is clamped arrives where the clamps are.
    pub(crate) fn clamp_speeds(&mut self, h: f64) {
        for k in 0..self.clamps.len() {
            let clamp = &self.clamps[k];
            let i = clamp.section;
            let wanted = minus(&clamp.target(), &self.x[i]).map(|d| d / h);
            let (ways, count) = clamp.ways();
            if clamp.hold == Hold::Fixed {
                self.v[i] = wanted;
                continue;
            }
            // M^-1 acts alike on all ways of one centre, so one after another is exact where no body sits off it.
            for way in &ways[..count] {
                let push = self.accelerated(i, way);
                let f = (dot(way, &wanted) - dot(way, &self.v[i])) / dot(way, &push);
                (0..9).for_each(|c| self.v[i][c] += f * push[c]);
            }
        }
    }

    /// Solves for `step.change`; false if the system is not positive.
    pub(crate) fn solve(&mut self) -> bool {
        let above: &[Above] = &self.tree.above;
        solve(&mut self.step.rows, above, &mut self.step.change)
    }
}

pub(crate) fn minus(a: &Corners, b: &Corners) -> Corners {
    std::array::from_fn(|k| a[k] - b[k])
}

/// A small positive system. Source: Cholesky.
pub(crate) fn solved(m: &Block, f: &Corners) -> Corners {
    let (mut a, mut x) = (*m, *f);
    for k in 0..9 {
        for j in k + 1..9 {
            let q = a[j][k] / a[k][k];
            let row = a[k];
            (k..9).for_each(|c| a[j][c] -= q * row[c]);
            x[j] -= q * x[k];
        }
    }
    for k in (0..9).rev() {
        let rest = (k + 1..9).fold(x[k], |s, c| s - a[k][c] * x[c]);
        x[k] = rest / a[k][k];
    }
    x
}
