//! The system of connected rods: state, loads, clamps and attached bodies.

use glam::{DMat3, DQuat, DVec3};

use crate::rods::layout::{RodDescription, SectionTree, to_stored_index};
use crate::rods::prism::{
    CornerRigidMotion, Matrix9, SectionFrame, Vector9, add_to_corner, centroid, corner, corner_dot, corners_from_fn,
    matrix_vector,
};
use crate::rods::solver::assemble::{AttachedBaseState, SpringAssembly};
use crate::rods::solver::block::{BlockRow, PrecedingSections, solve_block_system};
use crate::rods::tuning::{
    CLAMP_STIFFNESS_FACTOR, MAX_VISIBLE_HZ, MIN_STEPS_PER_FRAME, MIN_STEPS_PER_SECOND, STEP_PHASE,
};
use osier_base::math;
use osier_scene::plant::NONE;

/// Which degrees of freedom of a clamped section are prescribed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum SupportKind {
    /// Position and rotation are prescribed (all nine degrees of freedom).
    Fixed,
    /// The position of the centre is prescribed; the section turns freely.
    Pinned,
    /// The centre slides along a line of this direction; the section turns freely.
    Guided(DVec3),
}

/// Boundary condition at a section, and its prescribed motion.
#[derive(Debug, Clone)]
pub struct SectionSupport {
    /// Index of the section that it acts on.
    pub section: usize,
    /// Its prescribed degrees of freedom; the others stay free.
    pub hold: SupportKind,
    /// Prescribed translation from the reference shape, m.
    pub shift: DVec3,
    /// Prescribed rotation about the section's centre, from the reference shape.
    pub turn: DQuat,
    reference: Vector9,
}

impl SectionSupport {
    fn target_corners(&self) -> Vector9 {
        let p = centroid(&self.reference);
        corners_from_fn(|c| p + self.shift + self.turn * (corner(&self.reference, c) - p))
    }

    /// Unit vectors over the section's nine degrees of freedom along which motion is prescribed, and their number.
    fn constrained_directions(&self) -> ([Vector9; 9], usize) {
        let mut directions = [[0.0; 9]; 9];
        if self.hold == SupportKind::Fixed {
            directions.iter_mut().enumerate().for_each(|(k, w)| w[k] = 1.0);
            return (directions, 9);
        }
        // Translation of the centre: the same displacement of all corners, normalized over the nine components.
        let across = |d: DVec3| corners_from_fn(|_| d / math::sqrt(3.0));
        if let SupportKind::Guided(line) = self.hold {
            let line = line.normalize_or(DVec3::Y);
            let (a, b) = line.any_orthonormal_pair();
            (directions[0], directions[1]) = (across(a), across(b));
            return (directions, 2);
        }
        for (w, d) in directions.iter_mut().zip([DVec3::X, DVec3::Y, DVec3::Z]) {
            *w = across(d);
        }
        (directions, 3)
    }
}

/// Rigid body attached to a section: a leaf blade, or a weight.
#[derive(Debug, Clone)]
pub struct AttachedBody {
    /// Index of the section that it is attached to, in whose frame `at` and `inertia` are given.
    pub section: usize,
    /// Centre of mass in the section's frame (u, v, w), m.
    pub at: DVec3,
    /// Mass, kg; 0 for a body that is absent or has been released.
    pub mass: f64,
    /// Inertia about its centre of mass, in the section's frame, kg m^2.
    pub inertia: DMat3,
    /// Whether it belongs to the plant: mass damping and restoring springs act on it, and it counts towards the fundamental
    /// frequency.
    pub of_plant: bool,
    /// Height of its centre above the ground when it lies there after its release, m.
    pub reach: f64,
}

/// Rayleigh damping and restoring springs of a rod, both derived from its fundamental frequency.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct RodModalParams {
    /// Fundamental frequency without restoring springs, Hz.
    pub hertz: f64,
    /// Stiffness of the restoring springs per mass, 1/s^2.
    pub recovery: f64,
    /// Rayleigh coefficients: mass part, 1/s, and stiffness part, s.
    pub mass: f64,
    pub stiffness: f64,
}

/// Mass matrices of a section that carries bodies: with all of them, and with those of the plant only.
#[derive(Debug, Clone)]
struct TotalAndPlantMassMatrices {
    all: Matrix9,
    own: Matrix9,
}

/// Connected rods: topology, state (positions, velocities, BDF2 history), clamps, attached bodies and loads.
#[derive(Debug, Clone)]
pub struct RodSystem {
    pub(crate) tree: SectionTree,
    pub(crate) clamps: Vec<SectionSupport>,
    pub(crate) bodies: Vec<AttachedBody>,
    /// Gravitational acceleration in the world, m/s^2; at first 9.81 along -Y.
    pub gravity: DVec3,
    /// Whether gravity leaves out wood and plant bodies, so that the reference shape is in equilibrium.
    pub weightless: bool,
    pub(crate) dampings: Vec<RodModalParams>,
    /// Per rod: the frame relative to which its rest positions are constant.
    anchors: Vec<RestAnchor>,
    /// Rest positions in the anchor's frame, m.
    rest_positions: Vec<Vector9>,
    /// Present positions, m, and velocities, m/s.
    pub(crate) x: Vec<Vector9>,
    pub(crate) v: Vec<Vector9>,
    /// BDF2 history: displacements in the last step, m, and velocities before it, m/s.
    pub(crate) before: [Vec<Vector9>; 2],
    /// External forces, N: forces that last until they are cleared, and impulses divided by the step length, which act in one step
    /// only.
    external_forces: Vec<Vector9>,
    impulse_forces: Vec<Vector9>,
    /// Factor on impulses in this step, less than 1 in a first step; see [`RodSystem::step_implicit`].
    pub(crate) share: f64,
    /// Whether the BDF2 history is invalid, so that the next step is an implicit Euler step.
    pub(crate) history_reset: bool,
    pub(crate) step: SolverBuffers,
    /// Distance from the origin, m, beyond which a step counts as diverged.
    pub(crate) divergence_limit: f64,
}

/// The frame that carries the rest positions of a rod.
#[derive(Debug, Clone, Copy, PartialEq)]
enum RestAnchor {
    None,
    Clamp(usize),
    Section(usize),
}

/// Work arrays of the solver, allocated once and overwritten in every step.
#[derive(Debug, Clone, Default)]
pub(crate) struct SolverBuffers {
    pub rows: Vec<BlockRow>,
    pub change: Vec<Vector9>,
    pub force: Vec<Vector9>,
    /// Loads that stay constant within a step, N.
    pub load: Vec<Vector9>,
    /// Rest positions in the world, m.
    pub places: Vec<Vector9>,
    pub next: Vec<Vector9>,
    /// Displacements of the iterate from the beginning of the step, m.
    pub moved: Vec<Vector9>,
    pub speed: Vec<Vector9>,
    pub attached_bases: Vec<AttachedBaseState>,
    pub damping: Vec<f64>,
    pub factors: Vec<f64>,
    section_masses: Vec<TotalAndPlantMassMatrices>,
    /// Per section: index into `section_masses`, or [`NONE`] for a section without bodies.
    mass_index: Vec<u32>,
}

/// State that a step of the implicit integrator changes and the next one reads, without the BDF2 history.
#[derive(Debug, Clone)]
pub(crate) struct RodSystemState {
    x: Vec<Vector9>,
    v: Vec<Vector9>,
    /// Rest positions of the last step, m, from which the reaction of restoring springs on their anchors is computed.
    places: Vec<Vector9>,
}

impl RodSystem {
    /// The present state, to return to if a step fails.
    pub(crate) fn state(&self) -> RodSystemState {
        RodSystemState { x: self.x.clone(), v: self.v.clone(), places: self.step.places.clone() }
    }

    /// Returns to an earlier state; the next step has no history.
    pub(crate) fn restore(&mut self, state: &RodSystemState) {
        self.x.clone_from(&state.x);
        self.v.clone_from(&state.v);
        self.step.places.clone_from(&state.places);
        self.reset_history();
    }

    /// Discretizes rods; every section is in its reference shape, at rest. A parent must precede its children. `holds`:
    /// rod, arc length on it, m, and boundary condition of each clamp.
    pub fn new(rods: &[RodDescription], holds: &[(usize, f64, SupportKind)]) -> Self {
        let tree = SectionTree::discretize(rods);
        let n = tree.sections.len();
        let zero = vec![[0.0; 9]; n];
        // A clamp holds the section nearest to its arc length.
        let clamp = |(rod, s, hold): &(usize, f64, SupportKind)| {
            let section = tree.section_at_arc_length(*rod, *s);
            SectionSupport {
                section,
                hold: *hold,
                shift: DVec3::ZERO,
                turn: DQuat::IDENTITY,
                reference: tree.reference[section],
            }
        };
        let clamps: Vec<SectionSupport> = holds.iter().map(clamp).collect();
        let step = SolverBuffers {
            rows: vec![BlockRow::default(); n],
            change: zero.clone(),
            force: zero.clone(),
            load: zero.clone(),
            places: tree.reference.clone(),
            next: zero.clone(),
            moved: zero.clone(),
            speed: zero.clone(),
            attached_bases: vec![AttachedBaseState::default(); tree.bases.len()],
            damping: vec![0.0; rods.len()],
            factors: vec![1.0; rods.len()],
            section_masses: Vec::new(),
            mass_index: vec![NONE; n],
        };
        // The order matters: anchors depend on clamps and tree, rest positions on anchors, and damping on both.
        let mut all = Self {
            x: tree.reference.clone(),
            v: zero.clone(),
            before: [zero.clone(), zero.clone()],
            impulse_forces: zero.clone(),
            external_forces: zero,
            share: 1.0,
            history_reset: true,
            dampings: vec![RodModalParams::default(); rods.len()],
            anchors: vec![RestAnchor::None; rods.len()],
            rest_positions: tree.reference.clone(),
            bodies: Vec::new(),
            gravity: DVec3::new(0.0, -9.81, 0.0),
            weightless: false,
            tree,
            clamps,
            step,
            divergence_limit: f64::MAX,
        };
        all.choose_rest_anchors();
        all.store_rest_positions(&all.tree.reference.clone());
        all.update_damping();
        all
    }

    /// Adds bodies behind the present ones, and recomputes frequencies and damping with them.
    #[must_use]
    pub fn with_added_bodies(mut self, bodies: Vec<AttachedBody>) -> Self {
        self.bodies.extend(bodies);
        self.update_damping();
        self
    }

    fn choose_rest_anchors(&mut self) {
        for (rod, span) in self.tree.rods.iter().enumerate() {
            let fixed = |c: &SectionSupport| c.hold == SupportKind::Fixed && span.sections.contains(&c.section);
            // A parent rod takes precedence; else the first fixed clamp on the rod itself.
            self.anchors[rod] = match (span.base, self.clamps.iter().position(fixed)) {
                (Some(base), _) => RestAnchor::Section(self.tree.bases[base].on as usize),
                (None, Some(clamp)) => RestAnchor::Clamp(clamp),
                (None, None) => RestAnchor::None,
            };
        }
    }

    /// Frame of a rod's anchor after `h` seconds, extrapolated from the present velocity of the carrying section; `None` for
    /// a free rod.
    fn predicted_anchor_frame(&self, rod: usize, h: f64) -> Option<SectionFrame> {
        match self.anchors[rod] {
            RestAnchor::None => None,
            RestAnchor::Clamp(c) => Some(SectionFrame::from_corners(&self.clamps[c].target_corners())),
            RestAnchor::Section(s) => {
                // Extrapolate by the carrier's rigid-body velocity, so that rest positions do not lag a moving
                // carrier.
                let (v, spin) = CornerRigidMotion::from_corners(&self.x[s]).rigid_velocity(&self.v[s]);
                Some(SectionFrame::from_corners(&self.x[s]).translated_and_rotated(v * h, spin * h))
            }
        }
    }

    /// Stores `x` as rest positions, relative to the present frames of the anchors.
    pub(crate) fn store_rest_positions(&mut self, x: &[Vector9]) {
        for i in 0..x.len() {
            self.rest_positions[i] = match self.anchors[self.tree.sections[i].rod] {
                RestAnchor::None => x[i],
                RestAnchor::Clamp(c) => SectionFrame::from_corners(&self.clamps[c].reference).corners_to_local(&x[i]),
                RestAnchor::Section(s) => SectionFrame::from_corners(&x[s]).corners_to_local(&x[i]),
            };
        }
    }

    /// Whether a rod has a fixed clamp or a parent rod: restoring springs and mass damping act on such rods only.
    pub fn is_anchored(&self, rod: usize) -> bool {
        self.anchors[rod] != RestAnchor::None
    }

    /// Index of the clamped section of a rod whose anchor is a clamp on the rod itself; `None` for other rods.
    pub(crate) fn clamped_section_of_rod(&self, rod: usize) -> Option<usize> {
        match self.anchors[rod] {
            RestAnchor::Clamp(c) => Some(self.clamps[c].section),
            _ => None,
        }
    }

    /// Number of free sections of all rods; attached bases are not counted.
    pub fn len(&self) -> usize {
        self.x.len()
    }

    /// Whether there is nothing to simulate: no rod has a free section.
    pub fn is_empty(&self) -> bool {
        self.x.is_empty()
    }

    /// Indices of a rod's free sections from base to tip; an attached base is not among them.
    pub fn sections_of_rod(&self, rod: usize) -> std::ops::Range<usize> {
        self.tree.rods[rod].sections.clone()
    }

    /// The section of a rod nearest to an arc length, m.
    pub fn section_at_arc_length(&self, rod: usize, s: f64) -> usize {
        self.tree.section_at_arc_length(rod, s)
    }

    /// Arc length of a section on its rod, m.
    pub fn arc_length(&self, section: usize) -> f64 {
        self.tree.sections[section].s
    }

    /// Index of the rod of a section, in the order of the descriptions given to [`RodSystem::new`].
    pub fn rod_of_section(&self, section: usize) -> usize {
        self.tree.sections[section].rod
    }

    /// Centre, m, and axes of a section in its present shape, in the world.
    pub fn section_frame(&self, section: usize) -> SectionFrame {
        SectionFrame::from_corners(&self.x[section])
    }

    /// Frame of a section in the reference shape, m.
    pub fn reference_frame(&self, section: usize) -> SectionFrame {
        SectionFrame::from_corners(&self.tree.reference[section])
    }

    /// The section that carries a rod's base, and the frame of the base in the reference shape; `None` without a parent rod.
    pub fn base_attachment(&self, rod: usize) -> Option<(usize, SectionFrame)> {
        let base = &self.tree.bases[self.tree.rods[rod].base?];
        let on = base.on as usize;
        Some((on, SectionFrame::from_corners(&self.reference_frame(on).local_positions_to_world(&base.local))))
    }

    /// Radius of the rod at a section, m.
    pub fn radius(&self, section: usize) -> f64 {
        self.tree.sections[section].radius
    }

    /// Attached bodies, in the order in which they were added.
    pub fn bodies(&self) -> &[AttachedBody] {
        &self.bodies
    }

    /// Velocity, m/s, and angular velocity, rad/s, of a section.
    pub fn section_rigid_velocity(&self, section: usize) -> (DVec3, DVec3) {
        CornerRigidMotion::from_corners(&self.x[section]).rigid_velocity(&self.v[section])
    }

    /// Fundamental frequency of a rod with its load, Hz, without restoring springs.
    pub fn fundamental_hz(&self, rod: usize) -> f64 {
        self.dampings[rod].hertz
    }

    /// Number of substeps per frame at `fps` frames per second: at least 8, of about 1/192 s or less, and so many that they resolve the
    /// fastest visible mode.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at least 8, saturates")]
    pub fn steps_per_frame(&self, fps: f64) -> u32 {
        // h = STEP_PHASE / w of the fastest visible fundamental.
        let fastest = self.dampings.iter().fold(0.0, |m: f64, k| m.max(k.hertz)).min(MAX_VISIBLE_HZ);
        let resolving = (std::f64::consts::TAU * fastest / (STEP_PHASE * fps)).ceil();
        // Rounded, so that 23.976 frames per second have as many substeps as 24.
        resolving.max((MIN_STEPS_PER_SECOND / fps).round()).max(MIN_STEPS_PER_FRAME) as u32
    }

    /// Torsional stiffness of the material divided by that of the rod: 1 unless its intervals are long.
    pub fn torsional_softening_ratio(&self, rod: usize) -> f64 {
        self.tree.rods[rod].intervals.iter().fold(1.0, |m, l| l.torsional_softening_ratio().max(m))
    }

    /// Removes all forces and impulses that [`RodSystem::add_wrench`] and [`RodSystem::add_impulse`] have added.
    pub fn clear_forces(&mut self) {
        self.external_forces.fill([0.0; 9]);
        self.impulse_forces.fill([0.0; 9]);
    }

    /// Adds a force, N, and a torque, N m, at a section's centre, until [`RodSystem::clear_forces`].
    pub fn add_wrench(&mut self, section: usize, force: DVec3, torque: DVec3) {
        // Convert the wrench to corner forces, since the positions of corners are the degrees of freedom.
        let f = CornerRigidMotion::from_corners(&self.x[section]).corner_forces(force, torque);
        (0..9).for_each(|k| self.external_forces[section][k] += f[k]);
    }

    /// Adds an `impulse`, N s, at a world position `place`, m, that is rigid with a section, to the next step of
    /// `h` seconds. [`RodSystem::clear_forces`] must follow that step.
    pub fn add_impulse(&mut self, section: usize, place: DVec3, impulse: DVec3, h: f64) {
        // An impulse is a force J/h that acts for one step.
        let arm = place - centroid(&self.x[section]);
        let f = CornerRigidMotion::from_corners(&self.x[section]).corner_forces(impulse / h, arm.cross(impulse) / h);
        (0..9).for_each(|k| self.impulse_forces[section][k] += f[k]);
    }

    /// Moves all rods as a rigid body with the first clamp, from where they are drawn to where the clamp is now.
    pub(crate) fn move_with_first_clamp(&mut self) {
        let Some(clamp) = self.clamps.first() else { return };
        let (shift, turn, middle) = (clamp.shift, clamp.turn, centroid(&clamp.reference));
        if shift == DVec3::ZERO && turn == DQuat::IDENTITY {
            return;
        }
        for x in &mut self.x {
            let drawn = *x;
            *x = corners_from_fn(|c| middle + shift + turn * (corner(&drawn, c) - middle));
        }
        self.divergence_limit = self.divergence_radius();
    }

    /// Gives all corners of a section this velocity, m/s, so that it does not rotate.
    pub fn set_section_velocity(&mut self, section: usize, velocity: DVec3) {
        self.v[section] = corners_from_fn(|_| velocity);
    }

    /// Acceleration of the corners of section `i` under corner forces, N: M^-1 f, attached bodies included.
    pub(crate) fn apply_inverse_mass(&self, i: usize, f: &Vector9) -> Vector9 {
        // Sections without bodies have the same lumped mass at every corner.
        match self.step.section_masses.get(self.step.mass_index[i] as usize) {
            None => f.map(|f| f / self.tree.sections[i].mass),
            Some(section_masses) => solve_matrix9(&section_masses.all, f),
        }
    }

    /// M x of section `i`; `of_plant`: with the bodies that belong to the plant only.
    #[inline]
    pub(crate) fn apply_mass(&self, i: usize, x: &Vector9, of_plant: bool) -> Vector9 {
        match self.step.section_masses.get(self.step.mass_index[i] as usize) {
            None => x.map(|x| x * self.tree.sections[i].mass),
            Some(section_masses) => matrix_vector(if of_plant { &section_masses.own } else { &section_masses.all }, x),
        }
    }

    /// Adds `all` M + `own` M_own to the diagonal block of section `i`.
    #[inline]
    pub(crate) fn add_section_mass_to_block(&mut self, i: usize, all: f64, own: f64) {
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

    /// Recomputes the mass matrices of sections with bodies in the present orientation.
    pub(crate) fn update_section_masses(&mut self) {
        let Self { tree, bodies, x, step, .. } = self;
        step.section_masses.clear();
        step.mass_index.fill(NONE);
        for body in bodies.iter() {
            let i = body.section;
            // The first body of a section creates its entry with the lumped corner masses.
            if step.mass_index[i] == NONE {
                step.mass_index[i] = to_stored_index(step.section_masses.len());
                let mut bare = [[0.0; 9]; 9];
                (0..9).for_each(|k| bare[k][k] = tree.sections[i].mass);
                step.section_masses.push(TotalAndPlantMassMatrices { all: bare, own: bare });
            }
            if body.mass <= 0.0 {
                continue;
            }
            // Inertia of the body in world directions: m I m^T.
            let m = SectionFrame::from_corners(&x[i]).matrix();
            let block = CornerRigidMotion::from_corners(&x[i]).body_mass_matrix(
                m * body.at,
                body.mass,
                m * body.inertia * m.transpose(),
            );
            let section_masses = &mut step.section_masses[step.mass_index[i] as usize];
            for k in 0..9 {
                for c in 0..9 {
                    section_masses.all[k][c] += block[k][c];
                    section_masses.own[k][c] += if body.of_plant { block[k][c] } else { 0.0 };
                }
            }
        }
    }

    /// Prepares all constants of a step of `h` seconds: mass matrices, rest positions, gravity, external
    /// forces, and the reaction of restoring springs on the sections that carry their anchors, which lags by one step.
    pub(crate) fn prepare_step(&mut self, h: f64) {
        self.update_section_masses();
        // Loads of the step: forces and torques, the share of impulses that acts in this step, gravity, and the reaction of the
        // restoring springs of child rods.
        for (load, (f, impulse)) in self.step.load.iter_mut().zip(self.external_forces.iter().zip(&self.impulse_forces))
        {
            (0..9).for_each(|k| load[k] = f[k] + self.share * impulse[k]);
        }
        self.add_weight_and_spin_loads();
        for rod in 0..self.tree.rods.len() {
            self.add_restoring_reaction_to_anchor(rod);
        }
        for rod in 0..self.tree.rods.len() {
            // Rest positions move with their anchor over the step.
            let frame = self.predicted_anchor_frame(rod, h);
            for i in self.tree.rods[rod].sections.clone() {
                self.step.places[i] =
                    frame.map_or(self.rest_positions[i], |f| f.local_positions_to_world(&self.rest_positions[i]));
            }
        }
    }

    fn add_weight_and_spin_loads(&mut self) {
        let Self { tree, bodies, x, v, step, gravity, weightless, .. } = self;
        if !*weightless {
            for (load, section) in step.load.iter_mut().zip(&tree.sections) {
                (0..3).for_each(|c| add_to_corner(load, c, *gravity * section.mass));
            }
        }
        for body in bodies.iter().filter(|b| b.mass > 0.0) {
            let i = body.section;
            let (rigid, m) = (CornerRigidMotion::from_corners(&x[i]), SectionFrame::from_corners(&x[i]).matrix());
            let arm = m * body.at;
            let (_, spin) = rigid.rigid_velocity(&v[i]);
            let inertia = m * body.inertia * m.transpose();
            // Off-centre bodies: centripetal force -m w x (w x r) and gyroscopic torque -w x I w.
            let mut force = -body.mass * spin.cross(spin.cross(arm));
            if !(*weightless && body.of_plant) {
                force += body.mass * *gravity;
            }
            let torque = arm.cross(force) - spin.cross(inertia * spin);
            let f = rigid.corner_forces(force, torque);
            (0..9).for_each(|k| step.load[i][k] += f[k]);
        }
    }

    /// Adds the reaction of a rod's restoring springs to the section that is its anchor.
    fn add_restoring_reaction_to_anchor(&mut self, rod: usize) {
        let RestAnchor::Section(on) = self.anchors[rod] else { return };
        let recovery = self.dampings[rod].recovery;
        if recovery <= 0.0 {
            return;
        }
        // Sum the restoring forces of the rod to a force and a torque about the centre of the anchor (Newton's third law).
        let rigid = CornerRigidMotion::from_corners(&self.x[on]);
        let (mut force, mut torque) = (DVec3::ZERO, DVec3::ZERO);
        for i in self.tree.rods[rod].sections.clone() {
            // Restoring force of the section, from the rest positions of the previous step.
            let away = subtract_corners(&self.x[i], &self.step.places[i]);
            let f = self.apply_mass(i, &away, true);
            for c in 0..3 {
                let f = corner(&f, c) * recovery;
                force += f;
                torque += (corner(&self.x[i], c) - rigid.p).cross(f);
            }
        }
        let f = rigid.corner_forces(force, torque);
        (0..9).for_each(|k| self.step.load[on][k] += f[k]);
    }

    /// Computes spring forces at positions `step.next` and velocities `step.speed`; if `stiff`, also the tangent
    /// stiffness blocks, scaled per rod by `step.factors`.
    pub(crate) fn assemble_springs(&mut self, stiff: bool) {
        let Self { tree, step, .. } = self;
        let SolverBuffers { rows, force, next, speed, attached_bases, damping, factors, .. } = step;
        let rows = stiff.then_some((rows.as_mut_slice(), factors.as_slice()));
        SpringAssembly { tree, x: next, v: speed, damping, attached_bases, force, rows }.assemble();
    }

    /// M_own (x - x_rest) of section `i` at `step.next`; the restoring force is minus `recovery` times it.
    pub(crate) fn mass_times_rest_offset(&self, i: usize) -> Vector9 {
        self.apply_mass(i, &subtract_corners(&self.step.next[i], &self.step.places[i]), true)
    }

    /// Adds penalty terms that drive clamped degrees of freedom to their targets.
    pub(crate) fn add_clamp_penalties_to_rows(&mut self) {
        let Self { clamps, step, .. } = self;
        for clamp in clamps.iter() {
            let rows = &mut step.rows[clamp.section];
            // Penalty: a stiff spring along each held direction w adds s w w^T to the block and s w (w . gap) to the
            // right-hand side, s a large multiple of the largest diagonal entry.
            let rigid = CLAMP_STIFFNESS_FACTOR * rows.max_diagonal();
            let away = subtract_corners(&clamp.target_corners(), &step.next[clamp.section]);
            let (directions, count) = clamp.constrained_directions();
            for direction in &directions[..count] {
                let d = rigid * corner_dot(direction, &away);
                for k in 0..9 {
                    let f = rigid * direction[k];
                    (0..9).for_each(|c| rows.0[k][c] += f * direction[c]);
                    rows.0[k][crate::rods::solver::block::RIGHT_HAND_SIDE] += d * direction[k];
                }
            }
        }
    }

    /// Changes velocities so that clamped degrees of freedom reach their targets after `h` seconds.
    pub(crate) fn set_clamp_velocities(&mut self, h: f64) {
        for k in 0..self.clamps.len() {
            let clamp = &self.clamps[k];
            let i = clamp.section;
            // Velocity by which the section reaches its target in one step.
            let wanted = subtract_corners(&clamp.target_corners(), &self.x[i]).map(|d| d / h);
            let (directions, count) = clamp.constrained_directions();
            if clamp.hold == SupportKind::Fixed {
                self.v[i] = wanted;
                continue;
            }
            // The directions share one centre and M^-1 is isotropic there, so that correcting them one by one is exact
            // unless a body sits off the centre.
            for direction in &directions[..count] {
                // Impulse along the direction that changes its velocity to the wanted one.
                let push = self.apply_inverse_mass(i, direction);
                let f =
                    (corner_dot(direction, &wanted) - corner_dot(direction, &self.v[i])) / corner_dot(direction, &push);
                (0..9).for_each(|c| self.v[i][c] += f * push[c]);
            }
        }
    }

    /// Solves the Newton system for `step.change`; false if its matrix is not positive definite.
    pub(crate) fn solve_newton_update(&mut self) -> bool {
        let predecessors: &[PrecedingSections] = &self.tree.predecessors;
        solve_block_system(&mut self.step.rows, predecessors, &mut self.step.change)
    }
}

pub(crate) fn subtract_corners(a: &Vector9, b: &Vector9) -> Vector9 {
    std::array::from_fn(|k| a[k] - b[k])
}

/// Solves a 9x9 symmetric positive definite system by elimination without pivoting.
pub(crate) fn solve_matrix9(m: &Matrix9, f: &Vector9) -> Vector9 {
    let (mut a, mut x) = (*m, *f);
    // Forward elimination, then back substitution.
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
