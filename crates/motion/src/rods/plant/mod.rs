//! A plant on rods: stems bend, leaves hang on stalks, and wind drag and the impulses of raindrops act on them.

mod layout;
mod rigid_blade;
#[cfg(test)]
pub(crate) mod tests;

use std::sync::Arc;

use glam::{DQuat, DVec3, Vec3};

pub use self::layout::RodPlantParams;
use self::layout::{AxisMotion, RodPlantLayout};
pub(crate) use self::rigid_blade::RigidBlade;
use self::rigid_blade::{OrientedBlade, VortexShedding};
use crate::rain::{LeafPose, RainPlant, WoodSegment};
use crate::rods::StepFailed;
use crate::rods::prism::{CornerRigidMotion, Matrix9, SectionFrame, Vector9, corner_dot};
use crate::rods::record::AIR_DENSITY;
use crate::rods::system::{AttachedBody, RodSystem, solve_matrix9};
use crate::rods::tuning::{MAX_STEP_HALVINGS, PEAK_WIND, STEP_PHASE};
use osier_base::{Error, Result, math};
use osier_scene::Trs;
use osier_scene::plant::{AxisKind, Plant};
use osier_wind::Wind;

/// Relative change of the step length above which the BDF2 history is discarded.
const SAME_STEP_TOLERANCE: f64 = 1e-9;

/// A leaf that is fixed to a section or to rigid wood.
#[derive(Debug, Clone)]
struct RodPlantLeaf {
    /// Carrying section; none for rigid wood.
    section: Option<usize>,
    /// Index of the rod that is its stalk.
    stalk: Option<usize>,
    /// Pivot, m, and orientation in the section's frame, or in the world.
    p: DVec3,
    q: DQuat,
    scale: f64,
    blade: RigidBlade,
    eddies: VortexShedding,
    now: LeafPose,
}

/// End of a wood segment: carrying section, and position in its frame or in the world.
#[derive(Debug, Clone, Copy)]
struct SegmentEnd {
    section: Option<usize>,
    p: DVec3,
    r: f64,
}

/// The two sections around a position on an axis, between which its pose is interpolated.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SectionBlend {
    /// Preceding and following section; `None` for rigid wood.
    pub sections: [Option<usize>; 2],
    /// Weight of the following section, 0 to 1.
    pub share: f64,
}

/// A plant whose thin stems and leaf stalks are rods, simulated in world space; thicker wood does not move.
#[derive(Debug, Clone)]
pub struct RodPlant {
    rods: RodSystem,
    axes: Vec<AxisMotion>,
    scale: f64,
    leaves: Vec<RodPlantLeaf>,
    wood: Vec<[SegmentEnd; 2]>,
    /// Indices of the bodies attached to each section.
    bodies_on_section: Vec<Vec<usize>>,
    /// Whether each section is clamped, so that impulses do not move it.
    fixed: Vec<bool>,
    drags: Vec<f64>,
    leaf_drag: f64,
    /// Mass of leaves per one-sided area, kg/m^2.
    leaf_mass: f64,
    wind: Option<Arc<dyn Wind>>,
    /// Impulses, N s, and forces, N, of the next step: section, world position, vector.
    impulses: Vec<(usize, DVec3, DVec3)>,
    leaf_forces: Vec<(usize, DVec3, DVec3)>,
    /// Length of the last step, s.
    last_step: f64,
    omitted: [usize; 2],
    hangs_at_rest: bool,
    name: String,
    /// Frame rate, frames per second, and number of the first frame, for messages.
    clock: (f64, u32),
    /// Time of the first frame, s, for messages.
    clip_start: f64,
}

impl RodPlant {
    /// A plant placed by `stand` (of uniform scale), in equilibrium in its grown pose.
    /// Own: which axes and leaves move, and their stalks; springs and blades by [yang-wu] section 2.
    pub fn new(plant: &Plant, stand: &Trs, params: &RodPlantParams, name: &str) -> Self {
        let layout = RodPlantLayout::new(plant, stand, params);
        let rods = RodSystem::new(&layout.rods, &layout.holds);
        let leaf_mass = params.wood.moving_leaf_mass();
        let blades: Vec<RigidBlade> = plant.protos.iter().map(|p| RigidBlade::from_mesh(&p.mesh)).collect();
        // Attach each leaf to a section: the tip of its petiole, or its axis. `p` and `q` are its pose in the section's frame.
        let mut leaves = Vec::with_capacity(layout.leaves.len());
        let (mut own, mut water) = (Vec::new(), Vec::new());
        for (organ, attachment) in plant.organs.iter().zip(&layout.leaves) {
            let section = match (attachment.stalk, attachment.host) {
                (Some(stalk), _) => rods.sections_of_rod(stalk).last(),
                (None, host) => host.map(|(rod, at)| rods.section_at_arc_length(rod, at)),
            };
            let frame = section.map_or(WORLD_FRAME, |s| rods.section_frame(s));
            let (turn, blade) = (world_rotation(&frame), blades[usize::from(organ.proto)]);
            let (p, q) =
                (turn.conjugate() * (attachment.pivot - frame.p), (turn.conjugate() * attachment.q).normalize());
            // The blade is a rigid body on the section, with its mass at its centroid.
            if let Some(section) = section {
                let r = glam::DMat3::from_quat(q);
                let inertia = r * blade.inertia_about_centroid(leaf_mass, attachment.scale) * r.transpose();
                let at = p + q * (blade.centroid * attachment.scale);
                let mass = leaf_mass * blade.area * attachment.scale * attachment.scale;
                own.push(AttachedBody { section, at, mass, inertia, of_plant: true, reach: 0.0 });
            }
            // A body without mass, which becomes the water on the leaf.
            let none = glam::DMat3::ZERO;
            water.push(AttachedBody {
                section: section.unwrap_or(0),
                at: DVec3::ZERO,
                mass: 0.0,
                inertia: none,
                of_plant: false,
                reach: 0.0,
            });
            let now = LeafPose::at_rest(attachment.pivot, attachment.q);
            let (scale, eddies) = (attachment.scale, VortexShedding::new(organ.id));
            leaves.push(RodPlantLeaf { section, stalk: attachment.stalk, p, q, scale, blade, eddies, now });
        }
        // Water bodies come first, so that body k is the water on leaf k; then the blades.
        let mut rods = if rods.is_empty() { rods } else { rods.with_added_bodies(water).with_added_bodies(own) };
        // If no rest shape is found that balances gravity, the weight of the plant is left out.
        rods.gravity = -DVec3::Y * params.gravity;
        let posed = rods.is_empty() || rods.find_rest_shape_by_residual();
        rods.weightless = !posed;
        // Bodies by section, and which sections a clamp holds.
        let mut on = vec![Vec::new(); rods.len()];
        rods.bodies().iter().enumerate().for_each(|(k, b)| on[b.section].push(k));
        let mut fixed = vec![false; rods.len()];
        rods.clamps.iter().for_each(|c| fixed[c.section] = true);
        let mut all = Self {
            drags: vec![params.wood.drag; layout.rods.len()],
            leaf_drag: params.wood.leaf_drag,
            leaf_mass,
            axes: layout.axes,
            scale: f64::from(stand.s.x),
            leaves,
            wood: Vec::new(),
            bodies_on_section: on,
            fixed,
            rods,
            wind: None,
            impulses: Vec::new(),
            leaf_forces: Vec::new(),
            last_step: 0.0,
            omitted: layout.omitted,
            hangs_at_rest: posed,
            name: name.into(),
            clock: (24.0, 1),
            clip_start: 0.0,
        };
        all.wood = all.build_wood_ends(plant, stand);
        all
    }

    /// Sets the wind that drags on wood and leaves; with `None` the air exerts no force, not even resistance.
    #[must_use]
    pub fn with_wind(self, wind: Option<Arc<dyn Wind>>) -> Self {
        Self { wind, ..self }
    }

    /// Sets frame rate, frames per second, and number of the first frame, for messages.
    #[must_use]
    pub fn with_frame_numbering(self, fps: f64, first: u32) -> Self {
        Self { clock: (fps, first), ..self }
    }

    /// Sets the time of the first frame, s, for messages; 0 unless steps count from an earlier start, as those of rain do.
    #[must_use]
    pub fn with_clip_start(self, seconds: f64) -> Self {
        Self { clip_start: seconds, ..self }
    }

    /// The rods of all stems and stalks that bend, in their present pose.
    pub fn rods(&self) -> &RodSystem {
        &self.rods
    }

    /// Number of stems and of leaves that are rigid because the budget was exhausted.
    pub fn omitted_stems_and_leaves(&self) -> [usize; 2] {
        self.omitted
    }

    /// Whether the grown pose is in equilibrium under gravity; if not, the weight of the plant is left out.
    pub fn has_rest_shape(&self) -> bool {
        self.hangs_at_rest
    }

    /// Number of substeps per frame at `fps` frames per second in a wind; 1 if no part of the plant bends. The force of the air
    /// on blades is integrated explicitly, so that steps must also resolve how fast gusts turn the blades.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "not negative, saturates")]
    pub fn steps_per_frame(&self, fps: f64, wind: Option<&dyn Wind>) -> u32 {
        if self.rods.is_empty() {
            return 1;
        }
        let turning = wind.map_or(0.0, |wind| self.max_blade_swing_frequency(wind));
        self.rods.steps_per_frame(fps).max((turning / (STEP_PHASE * fps)).ceil() as u32)
    }

    /// Largest angular frequency, rad/s, at which a blade swings about its foot downwind of it in gusts, as a weather vane does.
    fn max_blade_swing_frequency(&self, wind: &dyn Wind) -> f64 {
        let square = |leaf: &RodPlantLeaf| {
            let (blade, scale) = (&leaf.blade, leaf.scale);
            let speed = PEAK_WIND * f64::from(wind.mean_at(leaf.now.position.as_vec3()).length());
            // The normal force rho/2 C A u^2 2 sin(a) acts at the centroid; the blade turns about its foot (Steiner).
            let arm = blade.centroid.length() * scale;
            let inertia = blade.inertia_about_centroid(self.leaf_mass, scale).x_axis.x
                + self.leaf_mass * blade.area * scale * scale * arm * arm;
            let torque = AIR_DENSITY * self.leaf_drag * blade.facing * scale * scale * speed * speed * arm;
            if inertia > 0.0 { torque / inertia } else { 0.0 }
        };
        let moving = self.leaves.iter().filter(|leaf| leaf.section.is_some());
        math::sqrt(moving.map(square).fold(0.0, f64::max))
    }

    /// Index of the section that a leaf is rigid with; `None` on rigid wood.
    pub fn leaf_section(&self, leaf: usize) -> Option<usize> {
        self.leaves[leaf].section
    }

    /// Index of the rod of a leaf's stalk; `None` for a leaf without a stalk rod.
    pub fn leaf_stalk(&self, leaf: usize) -> Option<usize> {
        self.leaves[leaf].stalk
    }

    /// Sections around arc length `s`, m in the plant, of an axis.
    pub fn section_blend_at(&self, axis: u32, s: f64) -> SectionBlend {
        let still = SectionBlend { sections: [None; 2], share: 0.0 };
        let (rod, at) = match self.axes.get(axis as usize).copied().unwrap_or(AxisMotion::Still) {
            AxisMotion::Still => return still,
            AxisMotion::Rider(rod, at) => {
                return SectionBlend { sections: [Some(self.rods.section_at_arc_length(rod, at)); 2], share: 0.0 };
            }
            AxisMotion::Rod(_, from) if s < from => return still,
            AxisMotion::Rod(rod, from) => (rod, (s - from) * self.scale),
        };
        let mut before = self.rods.base_attachment(rod).map_or((None, 0.0), |(on, _)| (Some(on), 0.0));
        for i in self.rods.sections_of_rod(rod) {
            let place = self.rods.arc_length(i);
            if place >= at && before.0.is_some() {
                let share = (at - before.1) / (place - before.1).max(1e-12);
                return SectionBlend { sections: [before.0, Some(i)], share };
            }
            before = (Some(i), place);
        }
        SectionBlend { sections: [before.0; 2], share: 0.0 }
    }

    /// Ends of wood segments between successive sections, and between successive nodes of rigid wood.
    fn build_wood_ends(&self, plant: &Plant, stand: &Trs) -> Vec<[SegmentEnd; 2]> {
        let mut out = Vec::new();
        let stems = plant.axes.iter().enumerate().filter(|(_, a)| a.kind == AxisKind::Stem);
        for (index, axis) in stems {
            let nodes = plant.nodes_of(axis);
            let place = |k: usize| (stand.apply(plant.nodes.p[k]).as_dvec3(), f64::from(plant.nodes.r[k]) * self.scale);
            let carried = self.axes[index];
            let carrier = if let AxisMotion::Rider(rod, at) = carried {
                Some(self.rods.section_at_arc_length(rod, at))
            } else {
                None
            };
            let until = if let AxisMotion::Rod(_, from) = carried { from } else { f64::MAX };
            // The rigid part of the axis, node by node; then the bending part, section by section.
            for k in nodes.clone().skip(1).filter(|k| f64::from(plant.nodes.s[*k]) <= until) {
                let ends = [k - 1, k].map(|k| {
                    let (position, radius) = place(k);
                    self.attach_wood_end(carrier, position, radius)
                });
                out.push(ends);
            }
            let AxisMotion::Rod(rod, _) = carried else { continue };
            let mut last =
                self.rods.base_attachment(rod).map(|(on, f)| self.attach_wood_end(Some(on), f.p, self.rods.radius(on)));
            for i in self.rods.sections_of_rod(rod) {
                let end = self.attach_wood_end(Some(i), self.rods.reference_frame(i).p, self.rods.radius(i));
                if let Some(last) = last {
                    let r = last.r.min(1.5 * end.r);
                    out.push([SegmentEnd { r, ..last }, end]);
                }
                last = Some(end);
            }
        }
        out
    }

    /// End of a wood segment at `position`, m, in the world at rest, with `radius`, m, made rigid with a section.
    fn attach_wood_end(&self, section: Option<usize>, position: DVec3, radius: f64) -> SegmentEnd {
        let frame = section.map_or(WORLD_FRAME, |s| self.rods.reference_frame(s));
        SegmentEnd { section, p: world_rotation(&frame).conjugate() * (position - frame.p), r: radius }
    }

    fn segment_end_position(&self, end: &SegmentEnd) -> DVec3 {
        end.section.map_or(end.p, |s| {
            let f = self.rods.section_frame(s);
            f.p + f.matrix() * end.p
        })
    }

    /// Velocity, m/s, of a world position that is rigid with a section.
    fn point_velocity(&self, section: usize, place: DVec3) -> DVec3 {
        let (v, spin) = self.rods.section_rigid_velocity(section);
        v + spin.cross(place - self.rods.section_frame(section).p)
    }

    /// Inverse effective mass b^T M^-1 b, 1/kg, for a unit impulse along `along` at a position that is rigid with a
    /// section; 0 for clamped sections.
    fn section_inverse_effective_mass(&self, section: usize, place: DVec3, along: DVec3) -> f64 {
        if self.fixed[section] {
            return 0.0;
        }
        let rigid = CornerRigidMotion::from_corners(&self.rods.x[section]);
        let f = rigid.corner_forces(along, (place - rigid.p).cross(along));
        corner_dot(&f, &self.apply_inverse_section_mass(section, &f))
    }

    /// M^-1 f of a section with its present bodies.
    fn apply_inverse_section_mass(&self, section: usize, f: &Vector9) -> Vector9 {
        let mut m: Matrix9 = [[0.0; 9]; 9];
        (0..9).for_each(|k| m[k][k] = self.rods.tree.sections[section].mass);
        let (rigid, frame) =
            (CornerRigidMotion::from_corners(&self.rods.x[section]), self.rods.section_frame(section).matrix());
        for body in self.bodies_on_section[section].iter().map(|k| &self.rods.bodies[*k]).filter(|b| b.mass > 0.0) {
            let block = rigid.body_mass_matrix(frame * body.at, body.mass, frame * body.inertia * frame.transpose());
            m.as_flattened_mut().iter_mut().zip(block.as_flattened()).for_each(|(m, b)| *m += b);
        }
        solve_matrix9(&m, f)
    }

    /// Updates poses, velocities and accelerations of all leaves after a step of `h` seconds; `None` sets accelerations to 0.
    fn update_leaf_motion(&mut self, h: Option<f64>) {
        let Self { rods, leaves, .. } = self;
        for leaf in leaves {
            let Some(section) = leaf.section else { continue };
            let frame = rods.section_frame(section);
            let turn = world_rotation(&frame);
            let arm = turn * leaf.p;
            let (v, spin) = rods.section_rigid_velocity(section);
            let (v, was) = (v + spin.cross(arm), leaf.now);
            let rate = |now: DVec3, before: DVec3| h.map_or(DVec3::ZERO, |h| (now - before) / h);
            leaf.now = LeafPose {
                position: frame.p + arm,
                orientation: (turn * leaf.q).normalize(),
                velocity: v,
                angular_velocity: spin,
                acceleration: rate(v, was.velocity),
                angular_acceleration: rate(spin, was.angular_velocity),
            };
        }
    }

    /// Sets the external forces of a step of `h` seconds that begins at time `t`, s. `with_impulses`: adds the impulses of
    /// the frame, too, which act in its first substep only.
    fn apply_external_forces(&mut self, t: f64, h: f64, with_impulses: bool) {
        let Self { rods, impulses, leaf_forces, wind, drags, .. } = self;
        rods.clear_forces();
        for (section, place, force) in leaf_forces.iter() {
            // Forces act at points of leaves: the section gets them as a force and a torque about its centre.
            let arm = *place - rods.section_frame(*section).p;
            rods.add_wrench(*section, *force, arm.cross(*force));
        }
        if with_impulses {
            impulses.iter().for_each(|(section, place, impulse)| rods.add_impulse(*section, *place, *impulse, h));
        }
        let Some(wind) = wind.clone() else { return };
        rods.add_wind_drag(drags, &*wind, t + h);
        self.add_leaf_drag(&*wind, t, h);
    }

    /// Adds the wind's force on each leaf at the end of a step of `h` seconds that begins at time `t`, s.
    fn add_leaf_drag(&mut self, wind: &dyn Wind, t: f64, h: f64) {
        let Self { rods, leaves, leaf_drag, .. } = self;
        let centroid = |leaf: &RodPlantLeaf, section: usize| {
            let frame = rods.section_frame(section);
            let turn = world_rotation(&frame);
            let q = turn * leaf.q;
            (frame.p + turn * leaf.p + q * (leaf.blade.centroid * leaf.scale), q)
        };
        let held: Vec<(usize, (DVec3, DQuat))> =
            leaves.iter().filter_map(|l| l.section.map(|s| (s, centroid(l, s)))).collect();
        let places: Vec<Vec3> = held.iter().map(|(_, (p, _))| p.as_vec3()).collect();
        let mut air = vec![Vec3::ZERO; places.len()];
        wind.sample(&places, t + h, &mut air);
        let attached = leaves.iter_mut().filter(|l| l.section.is_some());
        for ((leaf, (section, (p, q))), air) in attached.zip(&held).zip(&air) {
            let (v, spin) = rods.section_rigid_velocity(*section);
            let arm = *p - rods.section_frame(*section).p;
            // The wind relative to the centroid of the blade, which is rigid with its section.
            let relative = air.as_dvec3() - v - spin.cross(arm);
            let plate = OrientedBlade { blade: &leaf.blade, q: *q, scale: leaf.scale, drag: *leaf_drag };
            let (force, at) = leaf.eddies.wind_force(&plate, relative, h);
            rods.add_wrench(*section, force, (arm + at).cross(force));
        }
    }

    /// Advances by `h` seconds from time `t`, s, in `n` equal substeps.
    fn advance_in_substeps(&mut self, t: f64, h: f64, n: u32) -> std::result::Result<(), StepFailed> {
        let h = h / f64::from(n);
        for k in 0..n {
            self.apply_external_forces(t + f64::from(k) * h, h, k == 0);
            self.rods.step_implicit(h)?;
        }
        Ok(())
    }
}

/// Frame of rigid wood: the axes of the world.
const WORLD_FRAME: SectionFrame = SectionFrame { p: DVec3::ZERO, u: DVec3::X, v: DVec3::Y, w: DVec3::Z };

/// Rotation from a frame's coordinates to the world.
fn world_rotation(frame: &SectionFrame) -> DQuat {
    DQuat::from_mat3(&frame.matrix()).normalize()
}

impl RainPlant for RodPlant {
    fn leaf_count(&self) -> usize {
        self.leaves.len()
    }

    fn leaf_pose(&self, leaf: usize) -> LeafPose {
        self.leaves[leaf].now
    }

    fn inverse_effective_mass(&self, leaf: usize, place: DVec3, along: DVec3) -> f64 {
        self.leaves[leaf].section.map_or(0.0, |section| self.section_inverse_effective_mass(section, place, along))
    }

    fn apply_impulse(&mut self, leaf: usize, place: DVec3, impulse: DVec3) {
        if let Some(section) = self.leaves[leaf].section {
            self.impulses.push((section, place, impulse));
        }
    }

    fn apply_force(&mut self, leaf: usize, place: DVec3, force: DVec3) {
        if let Some(section) = self.leaves[leaf].section {
            self.leaf_forces.push((section, place, force));
        }
    }

    fn set_attached_mass(&mut self, leaf: usize, mass: f64, centroid: DVec3) {
        if let (Some(section), Some(water)) = (self.leaves[leaf].section, self.rods.bodies.get_mut(leaf)) {
            let frame = SectionFrame::from_corners(&self.rods.x[section]);
            (water.mass, water.at) = (mass.max(0.0), frame.matrix().transpose() * (centroid - frame.p));
        }
    }

    fn wood_segments(&self, out: &mut Vec<WoodSegment>) {
        out.clear();
        out.extend(self.wood.iter().map(|[a, b]| WoodSegment {
            ends: [self.segment_end_position(a), self.segment_end_position(b)],
            radii: [a.r, b.r],
        }));
    }

    fn wood_inverse_effective_mass(&self, segment: usize, fraction: f64, direction: DVec3) -> f64 {
        let part = |end: &SegmentEnd, fraction: f64| {
            end.section.map_or(0.0, |section| {
                fraction
                    * fraction
                    * self.section_inverse_effective_mass(section, self.segment_end_position(end), direction)
            })
        };
        let [a, b] = &self.wood[segment];
        part(a, 1.0 - fraction) + part(b, fraction)
    }

    fn apply_wood_impulse(&mut self, segment: usize, fraction: f64, impulse: DVec3) {
        for (end, fraction) in self.wood[segment].into_iter().zip([1.0 - fraction, fraction]) {
            if let Some(section) = end.section {
                self.impulses.push((section, self.segment_end_position(&end), impulse * fraction));
            }
        }
    }

    fn wood_velocity(&self, segment: usize, fraction: f64) -> DVec3 {
        let of = |end: &SegmentEnd| {
            end.section.map_or(DVec3::ZERO, |section| self.point_velocity(section, self.segment_end_position(end)))
        };
        of(&self.wood[segment][0]).lerp(of(&self.wood[segment][1]), fraction)
    }

    fn posed_rods(&self) -> Option<&RodSystem> {
        Some(&self.rods)
    }

    /// A failed step is repeated in halves, down to sixteenths.
    fn step(&mut self, t: f64, h: f64) -> Result<()> {
        if self.rods.is_empty() {
            return Ok(());
        }
        // The BDF2 formula holds for equal steps only: start it anew after a change of the step length.
        if (h - self.last_step).abs() > SAME_STEP_TOLERANCE * h {
            self.rods.reset_history();
            self.last_step = h;
        }
        // Newton's method may fail after a hard impact: the step is then repeated from its start in twice as many parts.
        let saved = self.rods.state();
        let eddies: Vec<VortexShedding> = self.leaves.iter().map(|leaf| leaf.eddies).collect();
        for halving in 0..=MAX_STEP_HALVINGS {
            if halving > 0 {
                self.rods.restore(&saved);
                self.leaves.iter_mut().zip(&eddies).for_each(|(leaf, eddies)| leaf.eddies = *eddies);
            }
            if self.advance_in_substeps(t, h, 1 << halving).is_ok() {
                // The next step is whole again and cannot use the history of its parts.
                if halving > 0 {
                    self.rods.reset_history();
                }
                self.impulses.clear();
                self.leaf_forces.clear();
                self.update_leaf_motion(Some(h));
                return Ok(());
            }
        }
        let (fps, first) = self.clock;
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "frames of a clip")]
        let frame = first + ((t - self.clip_start) * fps).floor().max(0.0) as u32;
        Err(Error::Simulation { frame, quantity: format!("rods of \"{}\"", self.name) })
    }
}
