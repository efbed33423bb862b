//! Leaf blades as rigid sheets: their inertia, and the aerodynamic force on them.

use glam::{DMat3, DQuat, DVec3};

use crate::rods::record::AIR_DENSITY;
use crate::rods::tuning::{
    BUFFET_COEFFICIENT, CLOSED_MESH_SHARE, PRESSURE_OFFSET, PRESSURE_WANDER, SKIN_FRICTION, STROUHAL_NUMBER,
};
use osier_base::math;
use osier_base::rng;
use osier_scene::Mesh;
use osier_wind::TimeNoise;

/// A leaf mesh as a uniform rigid sheet, in leaf space at scale 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RigidBlade {
    /// One-sided area, m^2.
    pub area: f64,
    /// Centroid of the blade, m, in leaf space at scale 1.
    pub centroid: DVec3,
    /// Inertia about the centroid per mass per area, m^4.
    inertia: DMat3,
    /// Unit normal of the blade in leaf space.
    normal: DVec3,
    /// Projected area along the normal, m^2.
    pub facing: f64,
    /// Effective width and length, m: the sides of a rectangle with the same second moments.
    extent: [f64; 2],
}

impl RigidBlade {
    /// Integrates over a mesh. A closed mesh has an upper and a lower side, so that half of its area counts. A stalk in the mesh
    /// counts as a part of the blade; if it is a tube, the areas of its faces cancel in the normal.
    pub fn from_mesh(mesh: &Mesh) -> Self {
        let (mut area, mut first, mut all, mut faces) = (0.0, DVec3::ZERO, DMat3::ZERO, DVec3::ZERO);
        for t in &mesh.triangles {
            let [a, b, c] = t.map(|i| mesh.points.get(i as usize).copied().unwrap_or_default().as_dvec3());
            // Vector area of the triangle; its centroid is (a + b + c) / 3.
            let n = 0.5 * (b - a).cross(c - a);
            let (size, sum) = (n.length(), a + b + c);
            area += size;
            faces += n;
            first += sum * (size / 3.0);
            // Exact for triangles: A / 12 (sum of p p^T + (sum of p) (sum of p)^T).
            all += (outer_square(a) + outer_square(b) + outer_square(c) + outer_square(sum)) * (size / 12.0);
        }
        let area = area.max(1e-12);
        let centroid = first / area;
        let spread = all - outer_square(centroid) * area;
        let trace = spread.x_axis.x + spread.y_axis.y + spread.z_axis.z;
        let open = faces.length() > CLOSED_MESH_SHARE * area;
        let sides = if open { 1.0 } else { 2.0 };
        Self {
            area: area / sides,
            centroid,
            inertia: (DMat3::from_diagonal(DVec3::splat(trace)) - spread) * (1.0 / sides),
            normal: if open { faces.normalize() } else { DVec3::Z },
            facing: if open { faces.length() } else { 0.5 * area },
            extent: [spread.x_axis.x, spread.y_axis.y].map(|m| math::sqrt((12.0 * m / area).max(1e-12))),
        }
    }

    /// Inertia about the centroid, kg m^2, in leaf space. `density`: mass per area, kg/m^2; `scale`: factor on the size of the leaf.
    pub fn inertia_about_centroid(&self, density: f64, scale: f64) -> DMat3 {
        let s2 = scale * scale;
        self.inertia * (density * s2 * s2)
    }
}

fn outer_square(a: DVec3) -> DMat3 {
    DMat3::from_cols(a * a.x, a * a.y, a * a.z)
}

/// A leaf blade with its orientation in the world, for aerodynamic forces.
#[derive(Debug, Clone, Copy)]
pub struct OrientedBlade<'a> {
    /// Area, centroid and extent in leaf space.
    pub blade: &'a RigidBlade,
    /// Rotation from leaf space to the world.
    pub q: DQuat,
    /// Factor on lengths in leaf space.
    pub scale: f64,
    /// Drag coefficient across the wind.
    pub drag: f64,
}

/// State of the vortex shedding behind one blade, by which the wind buffets it.
#[derive(Debug, Clone, Copy)]
pub struct VortexShedding {
    noise: TimeNoise,
    /// Number of vortices shed so far.
    passed: f64,
}

impl VortexShedding {
    /// Vortex shedding of the organ `id`, with a random phase.
    #[allow(clippy::cast_possible_truncation, reason = "half of a hash is a hash")]
    pub fn new(id: u64) -> Self {
        let key = rng::child(id, rng::word("eddies"));
        let passed = rng::Rng::from_key(key).range(0.0, 1000.0);
        Self { noise: TimeNoise::new((key >> 32) as u32, 1.0, None), passed }
    }

    /// Aerodynamic force on a blade, N, and its point of action relative to the centroid, m. `wind`: velocity relative
    /// to the centroid, m/s; `h`: time until the next call, s.
    /// Own: a plate whose normal force grows with the sine of the angle of attack and saturates.
    pub fn wind_force(&mut self, oriented: &OrientedBlade<'_>, wind: DVec3, h: f64) -> (DVec3, DVec3) {
        let OrientedBlade { blade, q, scale, drag } = *oriented;
        let speed = wind.length();
        if speed < 1e-6 {
            return (DVec3::ZERO, DVec3::ZERO);
        }
        let normal = q * blade.normal;
        let [wide, long] = blade.extent.map(|e| e * scale);
        // Vortices shed in this step, at the frequency St u / w; the noise runs at twice that rate.
        self.passed += h * STROUHAL_NUMBER * speed / wide.max(1e-4);
        let noise = |k: u32| f64::from(self.noise.with_seed_offset(k).at(2.0 * self.passed));
        let sine = normal.dot(wind) / speed;
        // Normal-force coefficient 2 sin(a) / (1 + sin^2(a)), plus buffeting; skin friction acts along the blade.
        let across = 2.0 * sine / (1.0 + sine * sine) + BUFFET_COEFFICIENT * noise(0);
        let pressure = 0.5 * AIR_DENSITY * blade.facing * scale * scale * speed * speed;
        let along = wind - normal * (sine * speed);
        let force = pressure * (drag * across * normal + SKIN_FRICTION * along / speed);
        // Centre of pressure: a quarter chord upstream in a flow along the blade, at the centroid in a normal flow,
        // plus its wander.
        let local = (q.conjugate() * along).normalize_or_zero();
        let chord = math::sqrt(wide * wide * local.x * local.x + long * long * local.y * local.y);
        let fore = -along.normalize_or_zero() * (PRESSURE_OFFSET * chord * (1.0 - sine.abs()));
        let wander = q * DVec3::new(wide * noise(1), long * noise(2), 0.0) * PRESSURE_WANDER;
        (force, fore + wander)
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;

    fn plate() -> Mesh {
        let points = [[-0.02, 0.0], [0.02, 0.0], [0.02, 0.1], [-0.02, 0.1]].map(|p| Vec3::new(p[0], p[1], 0.0));
        Mesh { points: points.to_vec(), triangles: vec![[0, 1, 2], [0, 2, 3]], ..Mesh::default() }
    }

    #[test]
    fn plate_mesh_has_the_area_and_inertia_of_a_plate() {
        let blade = RigidBlade::from_mesh(&plate());
        assert!((blade.area - 0.004).abs() < 1e-9 && (blade.centroid - DVec3::Y * 0.05).length() < 1e-8);
        let m = 0.2 * blade.area * 4.0;
        let i = blade.inertia_about_centroid(0.2, 2.0);
        let [w2, l2] = [0.08 * 0.08, 0.2 * 0.2];
        for (got, wanted) in
            [(i.x_axis.x, m * l2 / 12.0), (i.y_axis.y, m * w2 / 12.0), (i.z_axis.z, m * (l2 + w2) / 12.0)]
        {
            assert!((got / wanted - 1.0).abs() < 1e-6, "{got} {wanted}");
        }
        assert!((blade.extent[0] - 0.04).abs() < 1e-7 && (blade.extent[1] - 0.1).abs() < 1e-7);
    }

    #[test]
    fn closed_mesh_counts_one_of_its_sides() {
        let open = plate();
        let below = open.triangles.iter().map(|t| [t[0], t[2], t[1]]);
        let closed = Mesh { triangles: open.triangles.iter().copied().chain(below).collect(), ..open.clone() };
        let [one, both] = [&open, &closed].map(RigidBlade::from_mesh);
        assert!((both.area / one.area - 1.0).abs() < 1e-9 && (both.facing / one.facing - 1.0).abs() < 1e-9);
        assert!((both.centroid - one.centroid).length() < 1e-9);
        let [a, b] = [one, both].map(|blade| blade.inertia_about_centroid(0.2, 1.0));
        assert!((a.x_axis - b.x_axis).length() < 1e-12 && (a.y_axis - b.y_axis).length() < 1e-12);
        assert!((0..2).all(|k| (both.extent[k] / one.extent[k] - 1.0).abs() < 1e-9));
    }

    #[test]
    fn wind_force_acts_across_a_plate_and_vanishes_edge_on() {
        let blade = RigidBlade::from_mesh(&plate());
        let mean = |wind: DVec3| {
            let mut eddies = VortexShedding::new(5);
            let oriented = OrientedBlade { blade: &blade, q: DQuat::IDENTITY, scale: 1.0, drag: 1.1 };
            let all = (0..4000).map(|_| eddies.wind_force(&oriented, wind, 0.02));
            all.fold((DVec3::ZERO, DVec3::ZERO), |s, f| (s.0 + f.0 / 4000.0, s.1 + f.1 / 4000.0))
        };
        let (broad, at) = mean(DVec3::Z * 3.0);
        let wanted = 0.5 * AIR_DENSITY * 1.1 * 0.004 * 9.0;
        assert!((broad.z / wanted - 1.0).abs() < 0.05 && broad.x.abs() < 1e-9, "{broad} {wanted}");
        assert!(at.length() < 0.004, "the middle, on average: {at}");
        let (edge, at) = mean(DVec3::Y * 3.0);
        assert!(edge.length() < 0.15 * wanted && edge.y > 0.0, "{edge}");
        assert!((at.y + 0.025).abs() < 0.004, "a quarter of its length before the middle: {at}");
    }
}
