//! Triangle meshes as condensation sets: points drawn evenly over their area.
//!
//! # Examples
//! ```
//! use glam::Vec3;
//! use osier_ifs::faces::WeightedTriangles;
//!
//! let triangle = WeightedTriangles::new([[Vec3::ZERO, Vec3::X, Vec3::Y]]);
//! let p = triangle.point([0.5, 0.25, 0.5]);
//! assert!(p.x >= 0.0 && p.y >= 0.0 && p.x + p.y <= 1.0);
//! ```

use std::sync::Arc;

use glam::{DVec3, Vec3};

use osier_base::diagnostic::Span;

/// A mesh file that a table names, and its triangles once it has been read.
#[derive(Debug, Clone)]
pub struct MeshReference {
    /// Mesh file as the table names it.
    pub file: String,
    /// Table units per unit of the file, > 0.
    pub scale: f64,
    /// True if +Z points up in the file.
    pub up_z: bool,
    /// Place in the table that names the file, for diagnostics.
    pub span: Span,
    /// Empty until the file has been read.
    pub faces: Arc<WeightedTriangles>,
}

/// Places in texts do not count: the same set may be named by two tables.
impl PartialEq for MeshReference {
    fn eq(&self, other: &Self) -> bool {
        let key = |m: &Self| (m.file.clone(), m.scale.to_bits(), m.up_z);
        key(self) == key(other) && self.faces == other.faces
    }
}

/// Triangles with the running sum of their areas.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct WeightedTriangles {
    corners: Vec<[Vec3; 3]>,
    /// Area of a triangle and of all before it, squared table units.
    sums: Vec<f64>,
}

impl WeightedTriangles {
    /// Keeps the triangles that have an area. `corners`: table units, finite.
    pub fn new(corners: impl IntoIterator<Item = [Vec3; 3]>) -> Self {
        let mut out = Self::default();
        let mut sum = 0.0;
        for triangle in corners {
            let [a, b, c] = triangle.map(Vec3::as_dvec3);
            let area = 0.5 * (b - a).cross(c - a).length();
            if area > 0.0 {
                sum += area;
                out.corners.push(triangle);
                out.sums.push(sum);
            }
        }
        out
    }

    /// A point of the mesh, uniform by area from three uniform draws in [0, 1); the origin of an empty mesh.
    /// Source: G. Turk, "Generating random points in triangles", Graphics Gems, 1990, for the place in a triangle.
    pub fn point(&self, [u, v, w]: [f64; 3]) -> DVec3 {
        let Some(total) = self.sums.last() else { return DVec3::ZERO };
        // Inversion of the running area sum: a triangle is picked in proportion to its area.
        let pick = self.sums.partition_point(|s| *s <= u * total).min(self.sums.len() - 1);
        within(self.corners[pick].map(Vec3::as_dvec3), v, w)
    }
}

/// A uniformly distributed point of a triangle from two uniform draws; draws beyond the diagonal of the unit square are
/// mirrored into the triangle.
pub(super) fn within([a, b, c]: [DVec3; 3], v: f64, w: f64) -> DVec3 {
    let (s, t) = if v + w > 1.0 { (1.0 - v, 1.0 - w) } else { (v, w) };
    a + (b - a) * s + (c - a) * t
}

#[cfg(test)]
mod tests {
    use super::*;
    use osier_base::rng::Rng;

    #[test]
    fn points_are_spread_by_area() {
        // A large triangle, one without area, and a quarter of the first far away.
        let far = Vec3::new(10.0, 0.0, 0.0);
        let faces = WeightedTriangles::new([
            [Vec3::ZERO, Vec3::X * 2.0, Vec3::Z * 2.0],
            [Vec3::ZERO, Vec3::X, Vec3::X * 3.0],
            [far, far + Vec3::X, far + Vec3::Z],
        ]);
        let mut draw = Rng::at(3, &["faces".into()]);
        let n = 40_000;
        let points: Vec<DVec3> = (0..n).map(|_| faces.point([(); 3].map(|()| draw.unit_f64()))).collect();
        let near: Vec<&DVec3> = points.iter().filter(|p| p.x < 5.0).collect();
        let inside = |p: &DVec3| p.y == 0.0 && p.x >= 0.0 && p.z >= 0.0 && p.x + p.z <= 2.0 + 1e-12;
        assert!(near.iter().all(|p| inside(p)));
        assert!(points.iter().filter(|p| p.x > 5.0).all(|p| p.x - 10.0 + p.z <= 1.0 + 1e-12));
        // Five standard errors of the share 4/5 and of the mean 2/3.
        let count = f64::from(u32::try_from(near.len()).expect("few"));
        assert!((count / f64::from(n) - 0.8).abs() < 5.0 * 0.002, "{count}");
        let mean = near.iter().fold(DVec3::ZERO, |s, p| s + **p) / count;
        assert!((mean - DVec3::new(2.0, 0.0, 2.0) / 3.0).abs().max_element() < 5.0 * 0.0027, "{mean}");
    }

    #[test]
    fn the_same_file_in_two_tables_is_the_same_set() {
        let source = osier_base::diagnostic::Sources::default().add("t", "mesh");
        let at = |start, file: &str| MeshReference {
            file: file.into(),
            scale: 1.0,
            up_z: false,
            span: Span::new(source, start, 4),
            faces: Arc::default(),
        };
        assert_eq!(at(0, "a.obj"), at(2, "a.obj"));
        assert_ne!(at(0, "a.obj"), at(0, "b.obj"));
    }
}
