//! Shapes of leaves that are young or dry, bent from the leaf of summer.

use glam::Vec3;

use super::LeafShape;
use osier_base::math::{cos_f32, sin_f32};
use osier_scene::Mesh;

/// Rotations of the parts of a blade that bend it from its shape in summer.
#[derive(Debug, Clone, Copy)]
struct Bend {
    /// Rotation of each half about the midrib, upper sides towards each other, rad.
    fold: f32,
    /// Downward rotation of the tip relative to the base, rad.
    curl: f32,
}

/// Own: by eye. Young leaves are folded along the midrib, dry ones roll in from the sides and hang their tips.
fn bend_of(shape: LeafShape) -> Option<Bend> {
    match shape {
        LeafShape::Furled => Some(Bend { fold: 1.15, curl: -0.3 }),
        LeafShape::Unfolding => Some(Bend { fold: 0.6, curl: 0.0 }),
        LeafShape::Open => None,
        LeafShape::Withered => Some(Bend { fold: 0.55, curl: 0.9 }),
    }
}

/// The mesh of a leaf, in organ space with the midrib along +Y and the upper side towards +Z, bent into a shape. Only points and
/// normals change.
pub fn shaped_leaf(mesh: &Mesh, shape: LeafShape) -> Mesh {
    let mut bent = mesh.clone();
    let Some(bend) = bend_of(shape) else { return bent };
    let length = bent.points.iter().fold(1e-6_f32, |m, p| m.max(p.y));
    let midrib = Midrib::of(mesh);
    for (p, n) in bent.points.iter_mut().zip(&mut bent.normals) {
        // Each half turns about the midrib; points on the midrib stay.
        let side = p.x.signum() * f32::from(u8::from(p.x.abs() > 1e-6 * length));
        let (sin, cos) = (sin_f32(bend.fold), cos_f32(bend.fold));
        let turn = |v: Vec3| Vec3::new(v.x * cos - side * v.z * sin, v.y, side * v.x * sin + v.z * cos);
        if side.abs() > 0.0 {
            let root = Vec3::Z * midrib.height(p.y);
            (*p, *n) = (turn(*p - root) + root, turn(*n));
        }
        // Then the midrib bends to an arc of the same length.
        if bend.curl.abs() > 1e-6 {
            let angle = bend.curl * (p.y / length).clamp(0.0, 1.0);
            let (sin, cos) = (sin_f32(angle), cos_f32(angle));
            let radius = length / bend.curl;
            let below = p.y.min(0.0);
            let axis = Vec3::new(p.x, radius * sin + below, -radius * (1.0 - cos));
            *p = axis + Vec3::new(0.0, sin, cos) * p.z;
            *n = Vec3::new(n.x, n.y * cos + n.z * sin, n.z * cos - n.y * sin);
        }
    }
    bent
}

/// Share of a leaf's half width within which points belong to its midrib.
const MIDRIB: f32 = 0.08;

/// Height of the midrib along the leaf, about which the halves fold: the blade of summer may be curled.
struct Midrib {
    /// (y, z) of points along the midrib, m, with rising y.
    points: Vec<[f32; 2]>,
}

impl Midrib {
    fn of(mesh: &Mesh) -> Self {
        let half = mesh.points.iter().fold(0.0_f32, |m, p| m.max(p.x.abs()));
        let near = mesh.points.iter().filter(|p| p.x.abs() <= MIDRIB * half);
        let mut points: Vec<[f32; 2]> = near.map(|p| [p.y, p.z]).collect();
        points.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
        Self { points }
    }

    fn height(&self, y: f32) -> f32 {
        let after = self.points.partition_point(|p| p[0] < y);
        match (after.checked_sub(1).and_then(|i| self.points.get(i)), self.points.get(after)) {
            (Some([y0, z0]), Some([y1, z1])) if y1 > y0 => z0 + (z1 - z0) * (y - y0) / (y1 - y0),
            (_, Some([_, z])) | (Some([_, z]), None) => *z,
            (None, None) => 0.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surface::leaf::{BladeDetail, BladeSpec, blade};

    #[test]
    fn a_furled_leaf_is_narrow_and_a_withered_one_short() {
        let open = blade(&BladeSpec::elliptic(), 0, BladeDetail::Light).expect("a blade");
        let size = |shape| shaped_leaf(&open, shape).bounds().size();
        let flat = size(LeafShape::Open);
        let [furled, unfolding] = [LeafShape::Furled, LeafShape::Unfolding].map(|s| size(s).x / flat.x);
        assert!(furled < 0.5 && unfolding > furled && unfolding < 0.9, "{furled} {unfolding}");
        assert!(size(LeafShape::Withered).y < 0.95 * flat.y);
        for shape in [LeafShape::Furled, LeafShape::Withered] {
            let bent = shaped_leaf(&open, shape);
            assert!(bent.normals.iter().all(|n| (n.length() - 1.0).abs() < 1e-3));
            // Lengths along the midrib stay: no edge is stretched to more than half as long again.
            for t in &open.triangles {
                let edge = |m: &Mesh| m.points[t[0] as usize].distance(m.points[t[1] as usize]);
                assert!(edge(&bent) < 1.5 * edge(&open) + 1e-4);
            }
        }
    }
}
