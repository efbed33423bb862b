//! Solids in the rain: walls, roofs and meshes, at whose faces drops end.

use std::fmt;
use std::sync::Arc;

use glam::{DVec3, Vec3};

use crate::rain::triangle_hierarchy::TriangleHierarchy;
use osier_base::Result;
use osier_base::convert::index;
use osier_base::geometry::Bounds;
use osier_scene::Mesh;

/// The faces of all solids of a scene, which do not move. Faces stop drops from either side, so that open meshes do so too.
#[derive(Clone, Default)]
pub struct RainSolids {
    /// `None` without solids.
    faces: Option<Arc<TriangleHierarchy>>,
    /// Lowest and highest corner of the box around all faces, m.
    bounds: [DVec3; 2],
}

impl fmt::Debug for RainSolids {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "RainSolids within {:?}", self.faces.as_ref().map(|_| self.bounds))
    }
}

impl RainSolids {
    /// Solids from meshes in world space, m.
    /// # Errors
    /// `TooMany` beyond 2^32 points.
    pub fn new<'a>(meshes: impl IntoIterator<Item = &'a Mesh>) -> Result<Self> {
        let (mut points, mut triangles): (Vec<Vec3>, Vec<[u32; 3]>) = Default::default();
        for mesh in meshes {
            let first = index(points.len(), "points of solids")?;
            points.extend_from_slice(&mesh.points);
            triangles.extend(mesh.triangles.iter().map(|t| t.map(|i| i + first)));
        }
        if triangles.is_empty() {
            return Ok(Self::default());
        }
        let corner = |v: Vec3, pick: fn(Vec3, Vec3) -> Vec3| points.iter().fold(v, |m, p| pick(m, *p)).as_dvec3();
        let bounds = [corner(Vec3::INFINITY, Vec3::min), corner(Vec3::NEG_INFINITY, Vec3::max)];
        Ok(Self { faces: Some(Arc::new(TriangleHierarchy::new(&points, &triangles))), bounds })
    }

    /// The box around all faces, m; empty without solids.
    pub fn bounds(&self) -> Bounds {
        if self.faces.is_some() { Bounds::of(self.bounds.map(|p| p.as_vec3())) } else { Bounds::default() }
    }

    /// Height of the lowest and of the highest point, m; `None` without solids.
    pub fn height_range(&self) -> Option<[f64; 2]> {
        self.faces.as_ref().map(|_| self.bounds.map(|p| p.y))
    }

    /// Fraction of the path between two world positions, 0 to 1, at which a drop of diameter `d`, m, first meets a face.
    pub(crate) fn first_hit(&self, [from, to]: [DVec3; 2], d: f64) -> Option<f64> {
        let faces = self.faces.as_ref()?;
        let margin = DVec3::splat(d);
        let [low, high] = self.bounds;
        if from.max(to).cmplt(low - margin).any() || from.min(to).cmpgt(high + margin).any() {
            return None;
        }
        // The front of the drop touches first, half a diameter ahead of its center. This also closes the gap that rounding may
        // leave between the paths of two steps.
        let path = to - from;
        let ahead = path.normalize_or_zero() * (0.5 * d);
        let hit = faces.intersect(from, to + ahead)?;
        let t = hit.t * (path.length() + ahead.length()) / path.length().max(f64::MIN_POSITIVE);
        Some(t.min(1.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn drops_of_any_step_end_on_a_thin_sheet_far_from_the_origin() {
        // A sheet of two triangles, 4 m wide, 300 m away from the origin.
        let at = Vec3::new(300.0, 7.0, -300.0);
        let points = [[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0]].map(|[x, z]| at + Vec3::new(x, 0.1 * x, z));
        let mesh = Mesh { points: points.to_vec(), triangles: vec![[0, 1, 2], [0, 2, 3]], ..Mesh::default() };
        let solids = RainSolids::new([&mesh]).expect("few points");
        assert_eq!(solids.height_range().map(|h| h.map(|y| (y * 10.0).round())), Some([70.0, 74.0]));
        let velocity = DVec3::new(3.0, -6.0, 0.5);
        for i in 0..4000_u32 {
            let share = DVec3::new(f64::from(i % 63) / 63.0, 0.0, f64::from(i / 63) / 64.0) * 3.9 + 0.05;
            let on = at.as_dvec3() + DVec3::new(share.x, 0.1 * share.x, share.z);
            // Drops fall from above; step length and start vary, so that steps end at different distances from the sheet.
            let h = 0.001 + 0.04 * f64::from(i % 7) / 7.0;
            let mut p = on - velocity * (0.3 + 1e-4 * f64::from(i % 97));
            let mut met = None;
            for _ in 0..600 {
                let next = p + velocity * h;
                met = solids.first_hit([p, next], 5e-4).map(|t| p.lerp(next, t));
                if met.is_some() {
                    break;
                }
                p = next;
            }
            let met = met.expect("no drop passes");
            assert!(met.distance(on) < 2e-3, "{i}: {met} for {on}");
        }
        assert!(solids.first_hit([at.as_dvec3() - DVec3::X, at.as_dvec3() - DVec3::X * 2.0], 1e-3).is_none());
        assert!(RainSolids::default().first_hit([DVec3::Y, -DVec3::Y], 1e-3).is_none());
    }
}
