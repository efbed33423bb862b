//! Bends that raindrops add to the elements of a swaying plant.
//!
//! Each element answers as the oscillator that it is in the wind: a damped angle about each of its two bending axes. A bend of an
//! element moves all that it carries as a small rigid motion, so that the displacement of a point p of the plant is linear in p:
//!
//! ```text
//! u(p) = sum over the elements e from p down to the trunk of  phi_e x (shift_e + slope_e p)
//! ```
//!
//! `phi_e` is the rotation vector of the tip of e. By the principle of virtual work a force F at p acts on `phi_e` with the moment
//! (shift_e + slope_e p) x F, so that impulses and the velocities that they cause belong to one mass matrix.
//! Source: own; the elements are those of [zhao-zhang] 3.2.

use glam::DVec3;

use super::tuning::{MAX_RAIN_BEND, REST_ANGLE};
use crate::sway::{BeamElement, BeamElements, ElementLocation, OscillatorStep};
use osier_base::math;
use osier_scene::plant::NONE;

/// A small rigid motion: displacement, m, or velocity, m/s, of the point p is `offset + turn x p`.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct RigidMotion {
    /// Rotation vector, rad, or angular velocity, rad/s.
    pub turn: DVec3,
    /// Displacement, m, or velocity, m/s, of the origin of plant space.
    pub offset: DVec3,
}

impl RigidMotion {
    /// Displacement or velocity of a point of plant space, m.
    pub fn at(&self, p: DVec3) -> DVec3 {
        self.offset + self.turn.cross(p)
    }

    /// The sum of this motion and that of a bend with rotation vector `phi` at a lever.
    fn with_bend(self, lever: &BendLever, phi: DVec3) -> Self {
        Self { turn: self.turn + phi * lever.slope, offset: self.offset + phi.cross(lever.shift) }
    }
}

/// Displacement of points p that are attached at one location of an element, by a bend phi of it: phi x (shift + slope p).
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct BendLever {
    element: usize,
    /// Slope at the location divided by that of the tip.
    slope: f64,
    /// Part of the lever that does not depend on the point p, m, in plant space.
    shift: DVec3,
}

impl BendLever {
    /// The vector A by which a rotation phi of the tip moves the point p, as phi x A.
    fn arm(&self, p: DVec3) -> DVec3 {
        self.shift + p * self.slope
    }
}

/// Sum of forces on an element and on all that it carries: N and N m about the origin, or N s and N m s for impulses.
#[derive(Debug, Clone, Copy, Default)]
struct Wrench {
    force: DVec3,
    moment: DVec3,
    /// Moment that acts on the rotation of the element's tip: the sum of (shift + slope p) x F.
    bending: DVec3,
}

impl Wrench {
    fn add(&mut self, lever: &BendLever, force: DVec3, moment: DVec3) {
        // (shift + slope p) x F = shift x F + slope (p x F): the moment about the origin is enough, whatever the points of attack.
        self.bending += lever.shift.cross(force) + moment * lever.slope;
        self.force += force;
        self.moment += moment;
    }
}

/// An element that drops bend.
#[derive(Debug, Clone)]
struct ElementResponse {
    /// Attachment to the carrier; `None` on the ground.
    carrier: Option<BendLever>,
    bend_axes: [DVec3; 2],
    /// Stiffness, N m/rad, and inverse inertia, 1/(kg m^2), about each axis; 0 inverse inertia for an element that does not bend.
    stiffness: [f64; 2],
    inverse_inertia: [f64; 2],
    /// Natural angular frequencies, rad/s, and damping ratio.
    w: [f64; 2],
    damping_ratio: f64,
    oscillators: [OscillatorStep; 2],
    /// Angles, rad, and rates, rad/s, in addition to those that the wind causes.
    angles: [f64; 2],
    rates: [f64; 2],
    load: Wrench,
    impulse: Wrench,
    /// Motion of the element's base, by the bends of all elements that carry it.
    displacement: RigidMotion,
    velocity: RigidMotion,
}

impl ElementResponse {
    /// Rotation vector of the tip, rad, or its rate, from angles or rates.
    fn tip_turn(&self, about: [f64; 2]) -> DVec3 {
        self.bend_axes[0] * about[0] + self.bend_axes[1] * about[1]
    }

    /// One step about the static bend under the present load, after the impulses.
    fn advance(&mut self) {
        for i in 0..2 {
            if self.inverse_inertia[i] <= 0.0 {
                continue;
            }
            let rate_change = self.bend_axes[i].dot(self.impulse.bending) * self.inverse_inertia[i];
            // The load bends the element until its elastic moment balances it; the arctangent bounds the rotation by long levers.
            let goal = math::atan(self.bend_axes[i].dot(self.load.bending) / self.stiffness[i]);
            let (angle, rate) = (self.angles[i], self.rates[i] + rate_change);
            if rate_change == 0.0 && goal == 0.0 && angle.abs() < REST_ANGLE && rate.abs() < REST_ANGLE * self.w[i] {
                (self.angles[i], self.rates[i]) = (0.0, 0.0);
                continue;
            }
            // The damped oscillation about that bend has a closed form, exact for any step.
            let [a, b, c, d] = self.oscillators[i].coefficients();
            let away = angle - goal;
            (self.angles[i], self.rates[i]) = (goal + a * away + b * rate, c * away + d * rate);
            // An end stop: the model holds for small motions only.
            if self.angles[i].abs() > MAX_RAIN_BEND {
                (self.angles[i], self.rates[i]) = (self.angles[i].clamp(-MAX_RAIN_BEND, MAX_RAIN_BEND), 0.0);
            }
        }
    }
}

/// Bends that drops add to all elements of a plant. All positions, forces and impulses are in plant space.
#[derive(Debug, Clone)]
pub(super) struct BranchResponse {
    elements: Vec<ElementResponse>,
    /// Number of bends of the plant, those of second modes included.
    bend_count: usize,
    /// Step that the oscillators are computed for, s.
    step: f64,
}

impl BranchResponse {
    /// All elements at rest; stiffness and inertia follow from their compliance and frequency. `scale`: scale of the plant in the
    /// world, in which forces and frequencies are given.
    pub fn new(elements: &BeamElements, scale: f64) -> Self {
        let response = |e: &BeamElement| {
            // The tip is displaced by this arm times its rotation, so that a force at the tip bends the element with this arm.
            let arm = e.length * e.shape.integral(1.0);
            // In the world the stiffness is scale^3 times as large. Moments are computed with arms in plant space, which are
            // shorter by the factor scale, so that scale^2 remains.
            let own = if e.tip_compliance > 0.0 { arm / e.tip_compliance } else { 0.0 };
            let stiffness = own * scale * scale;
            // The geometric mean of the frequencies of both directions.
            let w = math::sqrt(e.w[0] * e.w[1]);
            // Both directions have one inertia, k / w^2; their stiffnesses differ as their frequencies do.
            let inverse_inertia = if stiffness > 0.0 { w * w / stiffness } else { 0.0 };
            ElementResponse {
                carrier: bend_lever(elements, ElementLocation { element: e.parent, at: e.at }),
                bend_axes: e.bend_axes,
                stiffness: e.w.map(|own| stiffness * (own / w) * (own / w)),
                inverse_inertia: [inverse_inertia; 2],
                w: e.w,
                damping_ratio: e.damping_ratio,
                oscillators: e.w.map(|w| OscillatorStep::new(w, e.damping_ratio, 1.0)),
                angles: [0.0; 2],
                rates: [0.0; 2],
                load: Wrench::default(),
                impulse: Wrench::default(),
                displacement: RigidMotion::default(),
                velocity: RigidMotion::default(),
            }
        };
        Self { elements: elements.list.iter().map(response).collect(), bend_count: elements.bend_count(), step: 0.0 }
    }

    /// Applies a force, N, at a point `p`, m, that is attached at a lever; constant over the next step.
    pub fn add_force(&mut self, lever: &BendLever, p: DVec3, force: DVec3) {
        self.elements[lever.element].load.add(lever, force, p.cross(force));
    }

    /// Applies an impulse, N s, at a point `p`, m, that is attached at a lever; it acts at the beginning of the next step.
    pub fn add_impulse(&mut self, lever: &BendLever, p: DVec3, impulse: DVec3) {
        self.elements[lever.element].impulse.add(lever, impulse, p.cross(impulse));
    }

    /// Advances all elements by `h`, s, and clears the forces and impulses.
    pub fn advance(&mut self, h: f64) {
        if h.to_bits() != self.step.to_bits() {
            self.step = h;
            for e in &mut self.elements {
                e.oscillators = e.w.map(|w| OscillatorStep::new(w, e.damping_ratio, h));
            }
        }
        // Loads go from the tips down: the elements on a carrier act on it as one wrench. Carriers precede the elements on them.
        for k in (0..self.elements.len()).rev() {
            let ElementResponse { carrier: Some(lever), load, impulse, .. } = self.elements[k] else { continue };
            let carrier = &mut self.elements[lever.element];
            carrier.load.add(&lever, load.force, load.moment);
            carrier.impulse.add(&lever, impulse.force, impulse.moment);
        }
        // Motions go from the ground up.
        for k in 0..self.elements.len() {
            let [displacement, velocity] = self.elements[k].carrier.map_or_else(Default::default, |c| self.motion(&c));
            let e = &mut self.elements[k];
            (e.displacement, e.velocity) = (displacement, velocity);
            e.advance();
            (e.load, e.impulse) = (Wrench::default(), Wrench::default());
        }
    }

    /// Displacement, m, and velocity, m/s, in plant space, of all points that are attached at a lever.
    pub fn motion(&self, lever: &BendLever) -> [RigidMotion; 2] {
        let e = &self.elements[lever.element];
        [e.displacement.with_bend(lever, e.tip_turn(e.angles)), e.velocity.with_bend(lever, e.tip_turn(e.rates))]
    }

    /// Change of the velocity along the unit vector `n` of a point `p` that is attached at a lever, for an impulse of 1 N s along
    /// `n`, 1/kg: n^T M^-1 n, summed over the elements that carry the point.
    pub fn inverse_effective_mass(&self, lever: &BendLever, p: DVec3, n: DVec3) -> f64 {
        let mut sum = 0.0;
        let mut next = Some(*lever);
        while let Some(lever) = next {
            let e = &self.elements[lever.element];
            let moment = lever.arm(p).cross(n);
            for (axis, inverse_inertia) in e.bend_axes.iter().zip(e.inverse_inertia) {
                // Each bending axis is a separate degree of freedom: J M^-1 J^T with a diagonal M.
                sum += inverse_inertia * axis.dot(moment) * axis.dot(moment);
            }
            next = e.carrier;
        }
        sum
    }

    /// Both angles that drops add to each bend of the plant, rad, as in [`BendTrack`](crate::sway::BendTrack); second modes get none.
    pub fn bends(&self) -> Vec<[f32; 2]> {
        let first = self.elements.iter().map(|e| e.angles.map(math::narrow));
        first.chain(std::iter::repeat([0.0; 2])).take(self.bend_count).collect()
    }
}

/// The lever of points that are attached at a location; `None` where nothing bends.
pub(super) fn bend_lever(elements: &BeamElements, spot: ElementLocation) -> Option<BendLever> {
    if spot.element == NONE {
        return None;
    }
    let element = spot.element as usize;
    let e = elements.list.get(element)?;
    // The centreline moves by phi x chord times the integral of the slope up to the location; points that are attached there
    // rotate with the slope of the location.
    let slope = e.shape.at(spot.at);
    let chord = e.chord;
    let shift = chord * e.shape.integral(spot.at) - (e.base + chord * spot.at) * slope;
    Some(BendLever { element, slope, shift })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sway::WoodParams;
    use crate::sway::testing::{leafy, rod};

    fn elements_of_tree() -> BeamElements {
        BeamElements::build(&leafy(5), &WoodParams::default(), 1000)
    }

    #[test]
    fn a_steady_force_bends_a_rod_as_its_compliance_says() {
        let elements = BeamElements::build(&rod(2.0, 0.01, 0.01), &WoodParams::default(), 10);
        let mut response = BranchResponse::new(&elements, 1.0);
        let tip = bend_lever(&elements, ElementLocation { element: 0, at: 1.0 }).expect("bends");
        let p = elements.list[0].base + elements.list[0].chord;
        for _ in 0..20_000 {
            response.add_force(&tip, p, DVec3::X * 0.05);
            response.advance(0.005);
        }
        let turned = response.elements[0].tip_turn(response.elements[0].angles).length();
        let expected = math::atan(0.05 * elements.list[0].tip_compliance);
        // The stiffness differs by a few percent between the two directions.
        assert!((turned / expected - 1.0).abs() < 0.07, "{turned} {expected}");
        let moved = response.motion(&tip)[0].at(p);
        assert!(moved.x > 0.0 && moved.x > 10.0 * moved.z.abs(), "it moves with the force: {moved}");
    }

    #[test]
    fn an_impulse_changes_the_velocity_by_the_inverse_effective_mass() {
        let elements = elements_of_tree();
        let (n, p) = (DVec3::new(0.3, -0.9, 0.2).normalize(), DVec3::new(0.2, 1.4, -0.1));
        let mut tried = 0;
        for k in 0..elements.list.len() {
            let spot = ElementLocation { element: u32::try_from(k).expect("few"), at: 0.7 };
            let lever = bend_lever(&elements, spot).expect("bends");
            let mut response = BranchResponse::new(&elements, 1.0);
            let inverse = response.inverse_effective_mass(&lever, p, n);
            response.add_impulse(&lever, p, n * 1e-4);
            // A step so short that no angle changes: only velocities do. The velocity at the lever includes those of all elements
            // below, on which the impulse acts as well.
            response.advance(1e-9);
            let gained = response.motion(&lever)[1].at(p).dot(n);
            assert!((gained / (inverse * 1e-4) - 1.0).abs() < 1e-5, "{k}: {gained} {inverse}");
            tried += 1;
        }
        assert!(tried > 10);
    }

    #[test]
    fn what_is_struck_comes_to_rest() {
        let elements = elements_of_tree();
        let mut response = BranchResponse::new(&elements, 1.0);
        let spot = ElementLocation { element: u32::try_from(elements.list.len() - 1).expect("few"), at: 1.0 };
        let lever = bend_lever(&elements, spot).expect("bends");
        response.add_impulse(&lever, DVec3::Y, DVec3::NEG_Y * 1e-3);
        let mut largest = 0.0_f64;
        for _ in 0..20_000 {
            response.advance(1.0 / 192.0);
            largest = response.bends().iter().flatten().fold(largest, |m, b| m.max(f64::from(b.abs())));
        }
        assert!(largest > 1e-5, "{largest}");
        assert!(response.bends().iter().flatten().all(|b| *b == 0.0), "idle elements rest exactly");
    }

    /// The stiffness that moments of plant space meet grows with the square of the scale, and the inertia with it.
    #[test]
    fn larger_plants_answer_less() {
        let elements = elements_of_tree();
        let (n, p) = (DVec3::NEG_Y, DVec3::new(0.2, 1.4, -0.1));
        let lever = bend_lever(&elements, ElementLocation { element: 0, at: 0.7 }).expect("bends");
        // Frequencies of the elements are those of the world: here the same at both sizes.
        let [one, two] = [1.0, 2.0].map(|scale| BranchResponse::new(&elements, scale));
        let small = one.inverse_effective_mass(&lever, p, n);
        let large = two.inverse_effective_mass(&lever, p, n);
        assert!(small > 0.0 && (large / small - 0.25).abs() < 1e-12, "{large} {small}");
    }
}
