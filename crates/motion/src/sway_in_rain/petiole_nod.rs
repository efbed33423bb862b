//! Nodding of one leaf on its petiole under drops and water.

use std::f64::consts::TAU;

use glam::DVec3;

use super::tuning::{MAX_NOD, PETIOLE_HZ, PETIOLE_TWIST_RATIO, REST_ANGLE};
use crate::rods::RigidBlade;
use crate::sway::OscillatorStep;
use osier_base::math;

/// Rotation of a blade about the end of its petiole in addition to that by the wind. Vectors are in leaf space, about whose axes
/// the blade's inertia is nearly diagonal: x across, y along the midrib, z normal.
#[derive(Debug, Clone)]
pub(super) struct PetioleNod {
    /// Moments of inertia of the blade about the pivot, kg m^2.
    inertia: DVec3,
    /// Moments of inertia of the water on it about the pivot, kg m^2; 0 for a dry leaf.
    water: DVec3,
    /// Stiffness of the petiole about each axis, N m/rad.
    stiffness: DVec3,
    damping_ratio: f64,
    /// Rotation vector, rad, and its rate, rad/s.
    pub angle: DVec3,
    pub rate: DVec3,
    torque: DVec3,
    impulse: DVec3,
}

impl PetioleNod {
    /// A blade at rest. `leaf_mass`: kg/m^2; `scale`: factor on the size of the blade.
    pub fn new(blade: &RigidBlade, leaf_mass: f64, scale: f64, damping_ratio: f64) -> Self {
        // Inertia about the end of the petiole: that about the centroid plus that of the mass at the centroid (Steiner).
        let own = blade.inertia_about_centroid(leaf_mass, scale);
        let mass = leaf_mass * blade.area * scale * scale;
        let inertia =
            DVec3::new(own.x_axis.x, own.y_axis.y, own.z_axis.z) + point_inertia(mass, blade.centroid * scale);
        // A round petiole bends alike about both axes; the frequency is that of nodding, about x.
        let bending = inertia.x * (TAU * PETIOLE_HZ) * (TAU * PETIOLE_HZ);
        let stiffness = DVec3::new(bending, bending / PETIOLE_TWIST_RATIO, bending);
        let none = DVec3::ZERO;
        Self { inertia, water: none, stiffness, damping_ratio, angle: none, rate: none, torque: none, impulse: none }
    }

    /// Sets the water on the blade, which adds to its inertia: mass, kg, at a point, m.
    pub fn set_water(&mut self, mass: f64, at: DVec3) {
        self.water = point_inertia(mass, at);
    }

    /// Adds a torque about the pivot, N m, constant over the next step.
    pub fn add_torque(&mut self, torque: DVec3) {
        self.torque += torque;
    }

    /// Adds an angular impulse about the pivot, N m s, at the beginning of the next step.
    pub fn add_impulse(&mut self, impulse: DVec3) {
        self.impulse += impulse;
    }

    /// Change of the velocity along the unit vector `n` at the point `p` for an impulse of 1 N s along it, 1/kg.
    pub fn inverse_effective_mass(&self, p: DVec3, n: DVec3) -> f64 {
        let moment = p.cross(n);
        // J M^-1 J^T with the diagonal M of the three axes.
        (moment * moment / self.moments()).element_sum()
    }

    fn moments(&self) -> DVec3 {
        self.inertia + self.water
    }

    /// Advances by `h`, s, about the static rotation under the present torque, and clears torque and impulse.
    pub fn advance(&mut self, h: f64) {
        let moments = self.moments();
        let (torque, impulse) = (std::mem::take(&mut self.torque), std::mem::take(&mut self.impulse));
        let rate_after = self.rate + impulse / moments;
        // A leaf that nothing moves is set to rest, so that it costs only this comparison.
        let resting = self.angle.length_squared() < REST_ANGLE * REST_ANGLE
            && rate_after.length_squared() < REST_ANGLE * REST_ANGLE * PETIOLE_HZ * PETIOLE_HZ;
        if torque == DVec3::ZERO && impulse == DVec3::ZERO && resting {
            (self.angle, self.rate) = (DVec3::ZERO, DVec3::ZERO);
            return;
        }
        for i in 0..3 {
            let w = math::sqrt(self.stiffness[i] / moments[i]);
            let [a, b, c, d] = OscillatorStep::new(w, self.damping_ratio, h).coefficients();
            // The oscillation about the deflection under the present load has a closed form, exact for any step.
            let goal = torque[i] / self.stiffness[i];
            let (away, rate) = (self.angle[i] - goal, rate_after[i]);
            self.angle[i] = goal + a * away + b * rate;
            self.rate[i] = c * away + d * rate;
            // The blade stops where it would touch its twig.
            if self.angle[i].abs() > MAX_NOD {
                self.angle[i] = self.angle[i].clamp(-MAX_NOD, MAX_NOD);
                self.rate[i] = 0.0;
            }
        }
    }
}

/// Moments of inertia, kg m^2, of a mass, kg, at a point, m, about the axes through the origin.
fn point_inertia(mass: f64, p: DVec3) -> DVec3 {
    let square = p * p;
    (DVec3::splat(square.element_sum()) - square) * mass
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use osier_scene::Mesh;

    /// A blade of 60 x 100 mm along +Y, of 1.2 g.
    fn nod() -> PetioleNod {
        let corner = |x: f32, y: f32| Vec3::new(x, y, 0.0);
        let mesh = Mesh {
            points: vec![corner(-0.03, 0.0), corner(0.03, 0.0), corner(0.03, 0.1), corner(-0.03, 0.1)],
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            ..Mesh::default()
        };
        PetioleNod::new(&RigidBlade::from_mesh(&mesh), 0.2, 1.0, 0.1)
    }

    #[test]
    fn a_drop_swings_a_leaf_at_the_petioles_frequency() {
        let mut leaf = nod();
        // A drop of 4 mm at 8 m/s strikes halfway along the midrib, from above.
        let (p, impulse) = (DVec3::new(0.0, 0.05, 0.0), DVec3::NEG_Z * (33.5e-6 * 8.0));
        let gained = leaf.inverse_effective_mass(p, DVec3::NEG_Z) * impulse.length();
        leaf.add_impulse(p.cross(impulse));
        let h = 1e-3;
        let angles: Vec<f64> = (0..2000)
            .map(|_| {
                leaf.advance(h);
                leaf.angle.x
            })
            .collect();
        assert!((angles[0] / h * -0.05 / gained - 1.0).abs() < 0.05, "the point moves as the effective mass says");
        let depth = angles.iter().fold(0.0_f64, |m, a| m.max(a.abs())).to_degrees();
        assert!((3.0..40.0).contains(&depth), "{depth} degrees");
        let crossings = angles.windows(2).filter(|w| w[0] * w[1] < 0.0).count() as f64;
        assert!((crossings / (2.0 * 2.0 * PETIOLE_HZ) - 1.0).abs() < 0.15, "{crossings} in 2 s");
        (0..20_000).for_each(|_| leaf.advance(h));
        assert_eq!(leaf.angle, DVec3::ZERO);
    }

    #[test]
    fn water_bends_and_slows_a_leaf() {
        let (mut dry, mut wet) = (nod(), nod());
        let at = DVec3::new(0.0, 0.08, 0.0);
        wet.set_water(2e-4, at);
        let swing = |leaf: &mut PetioleNod, torque: DVec3| {
            (0..5000).for_each(|_| {
                leaf.add_torque(torque);
                leaf.advance(1e-3);
            });
            leaf.angle.x
        };
        let sag = swing(&mut wet, at.cross(DVec3::NEG_Z * (2e-4 * 9.81)));
        assert!(sag < -0.02, "{sag} rad");
        assert!(wet.inverse_effective_mass(at, DVec3::Z) < dry.inverse_effective_mass(at, DVec3::Z));
        assert!(swing(&mut dry, DVec3::ZERO).abs() < 1e-12);
    }
}
