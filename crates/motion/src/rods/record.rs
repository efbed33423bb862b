//! Recording of a clip: keyed actuations, substeps, and the pose at every frame.

use std::ops::Range;

use glam::{DQuat, DVec3, Quat, Vec3};

use crate::rain::GroundHeight;
use crate::rods::StepFailed;
use crate::rods::system::RodSystem;
use crate::rods::tuning::{MAX_STEP_HALVINGS, STABILITY_MARGIN};
use osier_base::keyframes::Keyframes;
use osier_base::math;
use osier_base::progress::Cancel;
use osier_base::{Error, Result};
use osier_wind::Wind;

/// Density of air at sea level, kg/m^3, in the drag of rods and blades.
pub(crate) const AIR_DENSITY: f64 = osier_base::physics::AIR_DENSITY;
/// Largest number of substeps per frame that an explicit integrator may need; beyond, the limit error suggests the
/// implicit one.
pub const MAX_SUBSTEPS: u32 = 200_000;

/// Time integration scheme of rods. All but the first are for comparison with the literature.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Integrator {
    /// Implicit BDF2, [`RodSystem::step_implicit`].
    Xpbd,
    /// One Gauss-Seidel pass of XPBD, [`RodSystem::step_gauss_seidel`].
    XpbdGs,
    /// Symplectic Euler, [`RodSystem::step_symplectic_euler`].
    Symplectic,
    /// Explicit Euler as in [yang-wu], [`RodSystem::step_forward_euler`].
    Explicit,
}

/// A load on a section, the mass of a body or the motion of a clamp, keyed over time.
#[derive(Debug, Clone)]
pub enum Actuation {
    /// Force, N, and torque, N m, at the centre of the section of this index.
    Wrench(usize, Keyframes<6>),
    /// Impulses on a section, N s, each applied once at its key's time.
    Impulse(usize, Keyframes<3>),
    /// Mass of an attached body, kg.
    Mass(usize, Keyframes<1>),
    /// Translation of the clamp of this index from the reference shape, m.
    Shift(usize, Keyframes<3>),
    /// Rotation of the clamp of this index about this axis through its section's centre, rad.
    Turn(usize, DVec3, Keyframes<1>),
}

/// Length, scheme, actuations and wind of a recording.
pub struct RecordingParams<'a> {
    /// Number of frames, the start included.
    pub frames: u32,
    /// Number of the first frame, by which errors name frames.
    pub first: u32,
    /// Frame rate of the clip, frames per second.
    pub fps: f64,
    /// Substeps per frame; `None` chooses them from the frequencies of the rods.
    pub steps: Option<u32>,
    /// Scheme of the substeps; explicit schemes need many more of them.
    pub integrator: Integrator,
    /// Loads and clamp motions, keyed by the time since the first frame, s.
    pub acts: Vec<Actuation>,
    /// Drag coefficient of each rod, and the wind field; `None` without any force of the air.
    pub wind: Option<(Vec<f64>, &'a dyn Wind)>,
    /// Ground on which released bodies come to rest.
    pub ground: &'a dyn GroundHeight,
    /// Name of the rod in error messages.
    pub name: String,
}

/// Poses of all sections and bodies in one frame, in world space.
#[derive(Debug, Clone, Default)]
pub struct RodSystemPose {
    /// Per section: position, m, and rotation: +Y along the rod, +X towards its corner 0.
    pub sections: Vec<(Vec3, Quat)>,
    /// Position of each attached body, m; of a released body, its position in free fall or on the ground.
    pub bodies: Vec<Vec3>,
}

impl RecordingParams<'_> {
    /// Whether the attached body of this index has a key with a mass > 0 at or before time `t`, s.
    fn had_mass_before(&self, body: usize, t: f64) -> bool {
        let carries = |keys: &Keyframes<1>| keys.0.iter().any(|(at, [mass])| *at <= t && *mass > 0.0);
        self.acts.iter().any(|act| matches!(act, Actuation::Mass(b, keys) if *b == body && carries(keys)))
    }
}

/// A body that is not part of the plant, in free fall since its mass became 0.
#[derive(Debug, Clone, Copy)]
struct DetachedBody {
    p: DVec3,
    v: DVec3,
    /// Height over the ground at which it comes to rest, m.
    clearance: f64,
}

/// Time, s, at which the `k`-th of `n` substeps of a frame begins; `k` = `n` gives the first substep of the next frame. The end
/// of a substep is computed as the beginning of the next, so that rounding puts every time into exactly one substep.
fn substep_time(fps: f64, frame: u32, k: u32, n: u32) -> f64 {
    if k < n {
        f64::from(frame) / fps + f64::from(k) * (1.0 / (fps * f64::from(n)))
    } else {
        f64::from(frame + 1) / fps
    }
}

impl RodSystem {
    /// Simulates a clip and returns the pose at each frame; the first is the start.
    /// # Errors
    /// `Simulation` with frame and rod if a step fails, `Limit` for too many substeps, `Cancelled`.
    pub fn record_clip(&mut self, clip: &RecordingParams<'_>, cancel: &Cancel) -> Result<Vec<RodSystemPose>> {
        let n = self.substeps_for_clip(clip)?;
        let mut released: Vec<Option<DetachedBody>> = vec![None; self.bodies.len()];
        let mut frames = Vec::new();
        // Loads and clamps of the first frame apply before its pose is taken.
        self.apply_actuations(clip, 0.0);
        self.move_with_first_clamp();
        self.reset_history();
        for frame in 0..clip.frames {
            cancel.check()?;
            frames.push(self.current_pose(&released));
            self.advance_frame(clip, frame, n, &mut released).map_err(|StepFailed| Error::Simulation {
                frame: clip.first + frame,
                quantity: format!("rod \"{}\"", clip.name),
            })?;
        }
        Ok(frames)
    }

    fn substeps_for_clip(&mut self, clip: &RecordingParams<'_>) -> Result<u32> {
        // Use the count of the clip, or that of the implicit integrators; only explicit ones need a stability bound.
        let explicit = matches!(clip.integrator, Integrator::Symplectic | Integrator::Explicit);
        if let (Some(n), _) | (None, Some(n)) = (clip.steps, (!explicit).then(|| self.steps_per_frame(clip.fps))) {
            return Ok(n);
        }
        // Symplectic Euler is stable for h < 2 / w_max, explicit Euler only for h <= a / w_max^2 with mass damping a.
        let w = self.max_angular_frequency_bound();
        let longest = match clip.integrator {
            Integrator::Symplectic => 2.0 / w,
            _ => (0..self.len()).fold(f64::MAX, |m, i| m.min(self.explicit_mass_damping(i))) / (w * w),
        };
        let wanted = (1.0 / (clip.fps * STABILITY_MARGIN * longest)).ceil();
        if wanted > f64::from(MAX_SUBSTEPS) || wanted.is_nan() {
            return Err(Error::Limit {
                name: format!("the number of substeps per frame of rod \"{}\"", clip.name),
                wanted: format!("{wanted:.0}"),
                limit: MAX_SUBSTEPS.to_string(),
                flag: String::new(),
                help: "set integrator = \"xpbd\"".into(),
            });
        }
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "bounded above")]
        Ok(wanted.max(1.0) as u32)
    }

    fn current_pose(&self, released: &[Option<DetachedBody>]) -> RodSystemPose {
        // Sections have the pose of their frames; a released body has its free-fall position, an attached one
        // follows its section.
        let section = |i: usize| {
            let f = self.section_frame(i);
            (f.p.as_vec3(), f.rotation().as_quat().normalize())
        };
        let body = |(body, released): (&super::AttachedBody, &Option<DetachedBody>)| {
            let f = self.section_frame(body.section);
            released.map_or(f.p + f.matrix() * body.at, |k| k.p).as_vec3()
        };
        RodSystemPose {
            sections: (0..self.len()).map(section).collect(),
            bodies: self.bodies.iter().zip(released).map(body).collect(),
        }
    }

    /// Advances from the `frame`-th frame of the clip, counted from 0, to the next in `n` substeps; on failure restores the
    /// state and doubles their number, up to [`MAX_STEP_HALVINGS`] times.
    fn advance_frame(
        &mut self,
        clip: &RecordingParams<'_>,
        frame: u32,
        n: u32,
        released: &mut [Option<DetachedBody>],
    ) -> std::result::Result<(), StepFailed> {
        // State to return to if a substep fails.
        let saved = (self.state(), released.to_vec());
        let mut last = StepFailed;
        for halving in 0..=MAX_STEP_HALVINGS {
            let n = n << halving;
            if halving > 0 {
                self.restore(&saved.0);
                released.copy_from_slice(&saved.1);
            }
            match self.run_substeps(clip, frame, n, released) {
                Ok(()) => {
                    if halving > 0 {
                        self.reset_history();
                    }
                    return Ok(());
                }
                Err(lost) => last = lost,
            }
        }
        Err(last)
    }

    /// Advances by one frame from the `frame`-th in `n` equal steps; fails where a section leaves the divergence limit.
    fn run_substeps(
        &mut self,
        clip: &RecordingParams<'_>,
        frame: u32,
        n: u32,
        released: &mut [Option<DetachedBody>],
    ) -> std::result::Result<(), StepFailed> {
        // Implicit loads: keys are evaluated at the end of each substep.
        let h = 1.0 / (clip.fps * f64::from(n));
        for k in 0..n {
            let t = substep_time(clip.fps, frame, k, n);
            self.apply_actuations(clip, t + h);
            self.add_keyed_impulses(clip, t..substep_time(clip.fps, frame, k + 1, n), h);
            match clip.integrator {
                Integrator::Xpbd => self.step_implicit(h)?,
                Integrator::XpbdGs => self.step_gauss_seidel(h)?,
                Integrator::Symplectic => self.step_symplectic_euler(h),
                Integrator::Explicit => self.step_forward_euler(h),
            }
            // NaN and infinity count as beyond the divergence limit.
            let far =
                self.x.iter().flatten().fold(0.0_f64, |m, x| if x.is_finite() { m.max(x.abs()) } else { f64::MAX });
            if far > self.divergence_limit {
                return Err(StepFailed);
            }
            self.advance_detached_bodies(clip, t + h, released, h);
        }
        Ok(())
    }

    /// Removes the forces of the last substep, and sets loads, body masses and clamp targets to their keys at time `t`, s.
    fn apply_actuations(&mut self, clip: &RecordingParams<'_>, t: f64) {
        self.clear_forces();
        for act in &clip.acts {
            match act {
                Actuation::Wrench(section, keys) => {
                    let [a, b, c, d, e, f] = keys.at(t).unwrap_or_default();
                    self.add_wrench(*section, DVec3::new(a, b, c), DVec3::new(d, e, f));
                }
                // Impulses act once and are added in `add_keyed_impulses`.
                Actuation::Impulse(..) => {}
                Actuation::Mass(body, keys) => self.bodies[*body].mass = keys.at(t).unwrap_or_default()[0],
                Actuation::Shift(clamp, keys) => {
                    self.clamps[*clamp].shift = DVec3::from_array(keys.at(t).unwrap_or_default())
                }
                Actuation::Turn(clamp, axis, keys) => {
                    let half = keys.at(t).unwrap_or_default()[0] / 2.0;
                    let v = *axis * math::sin(half);
                    self.clamps[*clamp].turn = DQuat::from_xyzw(v.x, v.y, v.z, math::cos(half));
                }
            }
        }
        if let Some((drag, wind)) = &clip.wind {
            self.add_wind_drag(drag, *wind, t);
        }
    }

    /// Adds the impulses whose keys lie within the times `span`, s, of a substep of `h` seconds.
    fn add_keyed_impulses(&mut self, clip: &RecordingParams<'_>, span: Range<f64>, h: f64) {
        for act in &clip.acts {
            let Actuation::Impulse(section, keys) = act else { continue };
            let place = self.section_frame(*section).p;
            for (_, impulse) in keys.0.iter().filter(|k| span.contains(&k.0)) {
                self.add_impulse(*section, place, DVec3::from_array(*impulse), h);
            }
        }
    }

    /// Adds the drag of the wind at time `t`, s, to each section. `drag`: coefficient of each rod. Source: F = rho/2 C A |u| u
    /// with the relative wind u normal to the rod.
    pub(crate) fn add_wind_drag(&mut self, drag: &[f64], wind: &dyn Wind, t: f64) {
        let places: Vec<Vec3> = (0..self.len()).map(|i| self.section_frame(i).p.as_vec3()).collect();
        let mut air = vec![Vec3::ZERO; places.len()];
        wind.sample(&places, t, &mut air);
        for (i, air) in air.iter().enumerate() {
            // Projected area of the interval around the section, 2 r l.
            let section = &self.tree.sections[i];
            let span = &self.tree.rods[section.rod];
            let length = span.length / span.intervals.len().max(1) as f64;
            // Sections at either end of a rod represent half an interval.
            let end = i + 1 == span.sections.end || (i == span.sections.start && span.base.is_none());
            let area = 2.0 * section.radius * length * if end { 0.5 } else { 1.0 };
            let along = self.section_frame(i).w;
            let u = air.as_dvec3() - self.section_rigid_velocity(i).0;
            // Cross-flow principle: only the normal component exerts drag.
            let u = u - along * along.dot(u);
            let f = 0.5 * AIR_DENSITY * drag[section.rod] * area * u.length() * u;
            self.add_wrench(i, f, DVec3::ZERO);
        }
    }

    /// Advances released weights in free fall by `h` seconds to time `t`, s, until they rest on the ground.
    fn advance_detached_bodies(
        &self,
        clip: &RecordingParams<'_>,
        t: f64,
        released: &mut [Option<DetachedBody>],
        h: f64,
    ) {
        let ground = |p: DVec3| clip.ground.height(p.x, p.z);
        for ((i, body), state) in self.bodies.iter().enumerate().zip(released) {
            if body.of_plant {
                continue;
            }
            match state {
                // Exact parabola of free fall over the step; the body stops where it meets the ground.
                Some(k) => {
                    k.p += h * k.v + 0.5 * h * h * self.gravity;
                    k.v += h * self.gravity;
                    let floor = ground(k.p) + k.clearance;
                    if k.p.y < floor {
                        (k.p.y, k.v) = (floor, DVec3::ZERO);
                    }
                }
                // The body is released in this step, with the velocity of its point of attachment. A weight whose keys have given
                // it no mass yet is not released: it stays at its point of attachment.
                None if body.mass <= 0.0 && clip.had_mass_before(i, t) => {
                    let (f, (v, spin)) = (self.section_frame(body.section), self.section_rigid_velocity(body.section));
                    let arm = f.matrix() * body.at;
                    let p = f.p + arm;
                    let clearance = body.reach.min(p.y - ground(p));
                    *state = Some(DetachedBody { p, v: v + spin.cross(arm), clearance });
                }
                None => {}
            }
        }
    }
}
