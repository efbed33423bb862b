//! The system of connected rods: state, loads, clamps and attached bodies.

use glam::{DMat3, DQuat, DVec3};

use crate::rods::layout::{RodDescription, RodTree, index};
use crate::rods::prism::{
    Matrix9, RigidSectionMap, SectionCorners, SectionFrame, add, centroid, corner, corners, dot, matrix_vector,
};
use crate::rods::solver::assemble::{AttachedBase, SpringAssembly};
use crate::rods::solver::block::{BlockRow, Predecessors, solve};
use osier_base::math;
use osier_scene::plant::NONE;

/// How much stiffer than its section a clamp holds.
const CLAMP_STIFFNESS_FACTOR: f64 = 1e7;
/// Share of its slowest swing's period, over 2 pi, that a step of auto length lasts, and the fastest swing that counts, Hz.
const STEP_PHASE: f64 = 0.4;
const MAX_VISIBLE_HZ: f64 = 25.0;
/// Fewest and most steps of a frame, if nothing is said.
const STEP_COUNT_RANGE: [f64; 2] = [8.0, 64.0];

/// Boundary condition of a clamped section.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ClampKind {
    /// Position and rotation are prescribed (all nine degrees of freedom).
    Fixed,
    /// The position of the centre is prescribed; the section turns freely.
    Pinned,
    /// The centre slides along a line of this direction; the section turns freely.
    Guided(DVec3),
}

/// A section that is held, and where it is moved to.
#[derive(Debug, Clone)]
pub struct RodClamp {
    /// Section.
    pub section: usize,
    /// Boundary condition.
    pub hold: ClampKind,
    /// From where it was drawn, m.
    pub shift: DVec3,
    /// About its centre, from how it was drawn.
    pub turn: DQuat,
    drawn: SectionCorners,
}

impl RodClamp {
    fn target(&self) -> SectionCorners {
        let p = centroid(&self.drawn);
        corners(|c| p + self.shift + self.turn * (corner(&self.drawn, c) - p))
    }

    /// Directions over corners that are held, and how many of them.
    fn ways(&self) -> ([SectionCorners; 9], usize) {
        let mut ways = [[0.0; 9]; 9];
        if self.hold == ClampKind::Fixed {
            ways.iter_mut().enumerate().for_each(|(k, w)| w[k] = 1.0);
            return (ways, 9);
        }
        let across = |d: DVec3| corners(|_| d / math::sqrt(3.0));
        if let ClampKind::Guided(line) = self.hold {
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
pub struct AttachedBody {
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

/// Rayleigh damping and restoring springs of a rod, from its fundamental frequency.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct RodDamping {
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
struct SectionMass {
    all: Matrix9,
    own: Matrix9,
}

/// Connected rods: topology, state (positions, velocities, BDF2 history), clamps, attached bodies and loads.
#[derive(Debug, Clone)]
pub struct RodSystem {
    pub(crate) tree: RodTree,
    pub(crate) clamps: Vec<RodClamp>,
    pub(crate) bodies: Vec<AttachedBody>,
    /// m/s^2.
    pub gravity: DVec3,
    /// Wood and blades weigh nothing; the artist's pose stays.
    pub weightless: bool,
    pub(crate) dampings: Vec<RodDamping>,
    /// Per rod: section whose frame its rest places live in, or the clamp's; none without a fixed one.
    anchors: Vec<RestAnchor>,
    /// Rest places in the anchor's frame, m.
    rest_positions: Vec<SectionCorners>,
    /// Places and velocities, now and a step before.
    pub(crate) x: Vec<SectionCorners>,
    pub(crate) v: Vec<SectionCorners>,
    pub(crate) before: [Vec<SectionCorners>; 2],
    /// Forces from outside during a step, N, and those that last only this step.
    external_forces: Vec<SectionCorners>,
    impulse_forces: Vec<SectionCorners>,
    /// Share of a blow that the step gives by itself; the rest comes with those that follow.
    pub(crate) share: f64,
    /// No step was taken since the start.
    pub(crate) history_reset: bool,
    pub(crate) step: SolverBuffers,
    /// Nothing goes farther from the origin, m.
    pub(crate) divergence_limit: f64,
}

/// The frame that the rest positions of a rod live in.
#[derive(Debug, Clone, Copy, PartialEq)]
enum RestAnchor {
    None,
    Clamp(usize),
    Section(usize),
}

/// Work arrays of the solver, allocated once.
#[derive(Debug, Clone, Default)]
pub(crate) struct SolverBuffers {
    pub rows: Vec<BlockRow>,
    pub change: Vec<SectionCorners>,
    pub force: Vec<SectionCorners>,
    /// Weights and what else does not change within a step.
    pub load: Vec<SectionCorners>,
    /// Rest places in the world.
    pub places: Vec<SectionCorners>,
    pub next: Vec<SectionCorners>,
    pub speed: Vec<SectionCorners>,
    pub attached_bases: Vec<AttachedBase>,
    pub damping: Vec<f64>,
    pub factors: Vec<f64>,
    section_masses: Vec<SectionMass>,
    /// Per section: index among the heavy ones, or [`NONE`].
    mass_index: Vec<u32>,
}

impl RodSystem {
    /// Lays out rods with bodies; every section as drawn, at rest. Parents stand before children. `holds`: rod, arc length
    /// on it, m, and how.
    pub fn new(rods: &[RodDescription], holds: &[(usize, f64, ClampKind)]) -> Self {
        let tree = RodTree::new(rods);
        let n = tree.sections.len();
        let zero = vec![[0.0; 9]; n];
        let clamp = |(rod, s, hold): &(usize, f64, ClampKind)| {
            let section = tree.nearest_section(*rod, *s);
            RodClamp { section, hold: *hold, shift: DVec3::ZERO, turn: DQuat::IDENTITY, drawn: tree.drawn[section] }
        };
        let clamps: Vec<RodClamp> = holds.iter().map(clamp).collect();
        let step = SolverBuffers {
            rows: vec![BlockRow::default(); n],
            change: zero.clone(),
            force: zero.clone(),
            load: zero.clone(),
            places: tree.drawn.clone(),
            next: zero.clone(),
            speed: zero.clone(),
            attached_bases: vec![AttachedBase::default(); tree.bases.len()],
            damping: vec![0.0; rods.len()],
            factors: vec![1.0; rods.len()],
            section_masses: Vec::new(),
            mass_index: vec![NONE; n],
        };
        let mut all = Self {
            x: tree.drawn.clone(),
            v: zero.clone(),
            before: [tree.drawn.clone(), zero.clone()],
            impulse_forces: zero.clone(),
            external_forces: zero,
            share: 1.0,
            history_reset: true,
            dampings: vec![RodDamping::default(); rods.len()],
            anchors: vec![RestAnchor::None; rods.len()],
            rest_positions: tree.drawn.clone(),
            bodies: Vec::new(),
            gravity: DVec3::new(0.0, -9.81, 0.0),
            weightless: false,
            tree,
            clamps,
            step,
            divergence_limit: f64::MAX,
        };
        all.find_rest_anchors();
        all.store_rest_positions(&all.tree.drawn.clone());
        all.update_damping();
        all
    }

    /// Adds bodies, and measures the rods with them.
    #[must_use]
    pub fn with_bodies(mut self, bodies: Vec<AttachedBody>) -> Self {
        self.bodies.extend(bodies);
        self.update_damping();
        self
    }

    fn find_rest_anchors(&mut self) {
        for (rod, span) in self.tree.spans.iter().enumerate() {
            let fixed = |c: &RodClamp| c.hold == ClampKind::Fixed && span.sections.contains(&c.section);
            self.anchors[rod] = match (span.base, self.clamps.iter().position(fixed)) {
                (Some(base), _) => RestAnchor::Section(self.tree.bases[base].on as usize),
                (None, Some(clamp)) => RestAnchor::Clamp(clamp),
                (None, None) => RestAnchor::None,
            };
        }
    }

    /// Where a rod hangs after `h` seconds, as far as its carrier's motion tells.
    fn predicted_anchor_frame(&self, rod: usize, h: f64) -> Option<SectionFrame> {
        match self.anchors[rod] {
            RestAnchor::None => None,
            RestAnchor::Clamp(c) => Some(SectionFrame::from_corners(&self.clamps[c].target())),
            RestAnchor::Section(s) => {
                let (v, spin) = RigidSectionMap::from_corners(&self.x[s]).rigid_velocity(&self.v[s]);
                Some(SectionFrame::from_corners(&self.x[s]).displaced(v * h, spin * h))
            }
        }
    }

    /// Makes these corners the rest places; anchors are where they are now.
    pub(crate) fn store_rest_positions(&mut self, x: &[SectionCorners]) {
        for i in 0..x.len() {
            self.rest_positions[i] = match self.anchors[self.tree.sections[i].rod] {
                RestAnchor::None => x[i],
                RestAnchor::Clamp(c) => SectionFrame::from_corners(&self.clamps[c].drawn).to_local(&x[i]),
                RestAnchor::Section(s) => SectionFrame::from_corners(&x[s]).to_local(&x[i]),
            };
        }
    }

    /// Whether a rod hangs on something that does not turn freely: only such a one is drawn back and damped by its mass.
    pub fn is_anchored(&self, rod: usize) -> bool {
        self.anchors[rod] != RestAnchor::None
    }

    /// The section that holds a rod, if it is one of its own.
    pub(crate) fn clamped_section(&self, rod: usize) -> Option<usize> {
        match self.anchors[rod] {
            RestAnchor::Clamp(c) => Some(self.clamps[c].section),
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
    pub fn nearest_section(&self, rod: usize, s: f64) -> usize {
        self.tree.nearest_section(rod, s)
    }

    /// Arc length of a section on its rod, m.
    pub fn arc_length(&self, section: usize) -> f64 {
        self.tree.sections[section].s
    }

    /// Rod of a section.
    pub fn rod_of(&self, section: usize) -> usize {
        self.tree.sections[section].rod
    }

    /// Where a section is, and how it is turned.
    pub fn section_frame(&self, section: usize) -> SectionFrame {
        SectionFrame::from_corners(&self.x[section])
    }

    /// The same as it was drawn.
    pub fn rest_frame(&self, section: usize) -> SectionFrame {
        SectionFrame::from_corners(&self.tree.drawn[section])
    }

    /// The section that a rod's base rides on, and that base as it was drawn.
    pub fn base_attachment(&self, rod: usize) -> Option<(usize, SectionFrame)> {
        let base = &self.tree.bases[self.tree.spans[rod].base?];
        let on = base.on as usize;
        Some((on, SectionFrame::from_corners(&self.rest_frame(on).to_world(&base.local))))
    }

    /// Radius at a section, m.
    pub fn radius(&self, section: usize) -> f64 {
        self.tree.sections[section].radius
    }

    /// The bodies.
    pub fn bodies(&self) -> &[AttachedBody] {
        &self.bodies
    }

    /// Velocity of a section's centre, m/s, and its turning, rad/s.
    pub fn section_velocity(&self, section: usize) -> (DVec3, DVec3) {
        RigidSectionMap::from_corners(&self.x[section]).rigid_velocity(&self.v[section])
    }

    /// Slowest swing of a rod with all that it carries, Hz, without springs back.
    pub fn fundamental_hz(&self, rod: usize) -> f64 {
        self.dampings[rod].hertz
    }

    /// Steps a frame needs for its fastest visible swing. `fps`: frames per second.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped")]
    pub fn steps_per_frame(&self, fps: f64) -> u32 {
        let fastest = self.dampings.iter().fold(0.0, |m: f64, k| m.max(k.hertz)).min(MAX_VISIBLE_HZ);
        (std::f64::consts::TAU * fastest / (STEP_PHASE * fps)).ceil().clamp(STEP_COUNT_RANGE[0], STEP_COUNT_RANGE[1])
            as u32
    }

    /// How many times softer in torsion than its material a rod is: 1 unless its intervals are long.
    pub fn torsion_softening(&self, rod: usize) -> f64 {
        self.tree.spans[rod].intervals.iter().fold(1.0, |m, l| l.torsion_softening().max(m))
    }

    /// Takes all forces from outside away.
    pub fn clear_forces(&mut self) {
        self.external_forces.fill([0.0; 9]);
        self.impulse_forces.fill([0.0; 9]);
    }

    /// Adds a force, N, and a torque, N m, at a section's centre, until [`RodSystem::clear_forces`].
    pub fn add_wrench(&mut self, section: usize, force: DVec3, torque: DVec3) {
        let f = RigidSectionMap::from_corners(&self.x[section]).corner_forces(force, torque);
        (0..9).for_each(|k| self.external_forces[section][k] += f[k]);
    }

    /// Adds a blow, N s, at a place (m, world) of what is rigid with a section, to a step of `h` seconds. Taken away by
    /// [`RodSystem::clear_forces`], which must follow the step.
    pub fn add_impulse(&mut self, section: usize, place: DVec3, blow: DVec3, h: f64) {
        let arm = place - centroid(&self.x[section]);
        let f = RigidSectionMap::from_corners(&self.x[section]).corner_forces(blow / h, arm.cross(blow) / h);
        (0..9).for_each(|k| self.impulse_forces[section][k] += f[k]);
    }

    /// Sets the velocity of a section, m/s.
    pub fn set_section_velocity(&mut self, section: usize, velocity: DVec3) {
        self.v[section] = corners(|_| velocity);
    }

    /// What a section's mass does with a force: M^-1 f.
    pub(crate) fn solve_mass(&self, i: usize, f: &SectionCorners) -> SectionCorners {
        match self.step.section_masses.get(self.step.mass_index[i] as usize) {
            None => f.map(|f| f / self.tree.sections[i].mass),
            Some(section_masses) => solve_matrix9(&section_masses.all, f),
        }
    }

    /// M times something; `own`: without foreign bodies.
    #[inline]
    pub(crate) fn apply_mass(&self, i: usize, x: &SectionCorners, own: bool) -> SectionCorners {
        match self.step.section_masses.get(self.step.mass_index[i] as usize) {
            None => x.map(|x| x * self.tree.sections[i].mass),
            Some(section_masses) => matrix_vector(if own { &section_masses.own } else { &section_masses.all }, x),
        }
    }

    /// Adds `all` M + `own` M_own to a section's own block.
    #[inline]
    pub(crate) fn add_mass_to_block(&mut self, i: usize, all: f64, own: f64) {
        let rows = &mut self.step.rows[i].0;
        match self.step.section_masses.get(self.step.mass_index[i] as usize) {
            None => {
                let m = self.tree.sections[i].mass * (all + own);
                (0..9).for_each(|k| rows[k][k] += m);
            }
            Some(section_masses) => {
                for (row, (a, o)) in rows.iter_mut().zip(section_masses.all.iter().zip(&section_masses.own)) {
                    (0..9).for_each(|k| row[k] += all * a[k] + own * o[k]);
                }
            }
        }
    }

    /// Masses of the sections that carry bodies, as these are turned now.
    pub(crate) fn update_section_masses(&mut self) {
        let Self { tree, bodies, x, step, .. } = self;
        step.section_masses.clear();
        step.mass_index.fill(NONE);
        for body in bodies.iter() {
            let i = body.section;
            if step.mass_index[i] == NONE {
                step.mass_index[i] = index(step.section_masses.len());
                let mut bare = [[0.0; 9]; 9];
                (0..9).for_each(|k| bare[k][k] = tree.sections[i].mass);
                step.section_masses.push(SectionMass { all: bare, own: bare });
            }
            if body.mass <= 0.0 {
                continue;
            }
            let m = SectionFrame::from_corners(&x[i]).matrix();
            let block = RigidSectionMap::from_corners(&x[i]).mass_matrix(
                m * body.at,
                body.mass,
                m * body.inertia * m.transpose(),
            );
            let section_masses = &mut step.section_masses[step.mass_index[i] as usize];
            for k in 0..9 {
                for c in 0..9 {
                    section_masses.all[k][c] += block[k][c];
                    section_masses.own[k][c] += if body.own { block[k][c] } else { 0.0 };
                }
            }
        }
    }

    /// Everything that stays the same within a step of `h` seconds: masses, rest places, weights, forces from outside, and
    /// what springs back to places in a section's frame do to that section: what they did to their rod in the step before.
    pub(crate) fn prepare_step(&mut self, h: f64) {
        self.update_section_masses();
        for (load, (f, blow)) in self.step.load.iter_mut().zip(self.external_forces.iter().zip(&self.impulse_forces)) {
            (0..9).for_each(|k| load[k] = f[k] + self.share * blow[k]);
        }
        self.add_gravity();
        for rod in 0..self.tree.spans.len() {
            self.add_restoring_reaction(rod);
        }
        for rod in 0..self.tree.spans.len() {
            let frame = self.predicted_anchor_frame(rod, h);
            for i in self.tree.spans[rod].sections.clone() {
                self.step.places[i] = frame.map_or(self.rest_positions[i], |f| f.to_world(&self.rest_positions[i]));
            }
        }
    }

    fn add_gravity(&mut self) {
        let Self { tree, bodies, x, v, step, gravity, weightless, .. } = self;
        if !*weightless {
            for (load, section) in step.load.iter_mut().zip(&tree.sections) {
                (0..3).for_each(|c| add(load, c, *gravity * section.mass));
            }
        }
        for body in bodies.iter().filter(|b| b.mass > 0.0) {
            let i = body.section;
            let (grip, m) = (RigidSectionMap::from_corners(&x[i]), SectionFrame::from_corners(&x[i]).matrix());
            let arm = m * body.at;
            let (_, spin) = grip.rigid_velocity(&v[i]);
            let inertia = m * body.inertia * m.transpose();
            // Off-centre bodies: centripetal force -m w x (w x r) and gyroscopic torque -w x I w.
            let mut force = -body.mass * spin.cross(spin.cross(arm));
            if !(*weightless && body.own) {
                force += body.mass * *gravity;
            }
            let torque = arm.cross(force) - spin.cross(inertia * spin);
            let f = grip.corner_forces(force, torque);
            (0..9).for_each(|k| step.load[i][k] += f[k]);
        }
    }

    /// The opposite of a rod's springs back acts on the section in whose frame their places live.
    fn add_restoring_reaction(&mut self, rod: usize) {
        let RestAnchor::Section(on) = self.anchors[rod] else { return };
        let recovery = self.dampings[rod].recovery;
        if recovery <= 0.0 {
            return;
        }
        let grip = RigidSectionMap::from_corners(&self.x[on]);
        let (mut force, mut torque) = (DVec3::ZERO, DVec3::ZERO);
        for i in self.tree.spans[rod].sections.clone() {
            let away = difference(&self.x[i], &self.step.places[i]);
            let f = self.apply_mass(i, &away, true);
            for c in 0..3 {
                let f = corner(&f, c) * recovery;
                force += f;
                torque += (corner(&self.x[i], c) - grip.p).cross(f);
            }
        }
        let f = grip.corner_forces(force, torque);
        (0..9).for_each(|k| self.step.load[on][k] += f[k]);
    }

    /// Forces of the springs in `step.next` and `step.speed`; `factors`: also their stiffness, times these of `step`.
    pub(crate) fn assemble_springs(&mut self, stiff: bool) {
        let Self { tree, step, .. } = self;
        let SolverBuffers { rows, force, next, speed, attached_bases, damping, factors, .. } = step;
        let rows = stiff.then_some((rows.as_mut_slice(), factors.as_slice()));
        SpringAssembly { tree, x: next, v: speed, damping, attached_bases, force, rows }.run();
    }

    /// Force of the springs back to a section's rest place: -M (x - place), per their strength.
    pub(crate) fn restoring_displacement_force(&self, i: usize) -> SectionCorners {
        self.apply_mass(i, &difference(&self.step.next[i], &self.step.places[i]), true)
    }

    /// Holds what is clamped: rows and right sides then lead to where the clamps are.
    pub(crate) fn add_clamp_penalties(&mut self) {
        let Self { clamps, step, .. } = self;
        for clamp in clamps.iter() {
            let rows = &mut step.rows[clamp.section];
            // Penalty: a stiff spring along each held direction w adds s w w^T to the block and s w (w . gap) to the
            // right-hand side, s a large multiple of the largest diagonal entry.
            let grip = CLAMP_STIFFNESS_FACTOR * rows.peak();
            let away = difference(&clamp.target(), &step.next[clamp.section]);
            let (ways, count) = clamp.ways();
            for way in &ways[..count] {
                let d = grip * dot(way, &away);
                for k in 0..9 {
                    let f = grip * way[k];
                    (0..9).for_each(|c| rows.0[k][c] += f * way[c]);
                    rows.0[k][crate::rods::solver::block::RIGHT_HAND_SIDE] += d * way[k];
                }
            }
        }
    }

    /// Corrects velocities for a step of `h` seconds so that what is clamped arrives where the clamps are.
    pub(crate) fn project_clamp_velocities(&mut self, h: f64) {
        for k in 0..self.clamps.len() {
            let clamp = &self.clamps[k];
            let i = clamp.section;
            let wanted = difference(&clamp.target(), &self.x[i]).map(|d| d / h);
            let (ways, count) = clamp.ways();
            if clamp.hold == ClampKind::Fixed {
                self.v[i] = wanted;
                continue;
            }
            // M^-1 acts alike on all ways of one centre, so one after another is exact where no body sits off it.
            for way in &ways[..count] {
                let push = self.solve_mass(i, way);
                let f = (dot(way, &wanted) - dot(way, &self.v[i])) / dot(way, &push);
                (0..9).for_each(|c| self.v[i][c] += f * push[c]);
            }
        }
    }

    /// Solves for `step.change`; false if the system is not positive.
    pub(crate) fn solve_newton_update(&mut self) -> bool {
        let above: &[Predecessors] = &self.tree.above;
        solve(&mut self.step.rows, above, &mut self.step.change)
    }
}

pub(crate) fn difference(a: &SectionCorners, b: &SectionCorners) -> SectionCorners {
    std::array::from_fn(|k| a[k] - b[k])
}

/// A small positive system. Source: Cholesky.
pub(crate) fn solve_matrix9(m: &Matrix9, f: &SectionCorners) -> SectionCorners {
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
