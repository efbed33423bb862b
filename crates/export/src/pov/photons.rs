//! Selection of the drops that are targets of photons. A target receives no ordinary light, so a drop that only few
//! photons would hit must not be a target.

use std::collections::BTreeMap;

use super::mesh::extract_triangles;
use osier_base::disjoint_sets::DisjointSets;
use osier_base::geometry::Bounds;
use osier_scene::{Material, MaterialClass, Mesh};

/// Largest radius of a target, m. The spacing of photons is an eighth of the smallest target's radius, so their number grows with
/// the square of a target's radius: a larger limit makes rendering slower.
const MAX_TARGET_RADIUS: f32 = 0.02;

/// Whether an object of this radius, m, is a target. `smallest`: smallest radius of a target, `None` without photons.
pub(super) fn is_target_radius(smallest: Option<f32>, radius: f32) -> bool {
    smallest.is_some_and(|least| (least..=MAX_TARGET_RADIUS).contains(&radius))
}

/// Whether all faces of a mesh are water.
pub(super) fn is_all_water(mesh: &Mesh, materials: &[Material]) -> bool {
    let water = |m: u32| materials.get(m as usize).is_some_and(|m| m.class == MaterialClass::Water);
    !mesh.subsets.is_empty() && mesh.subsets.iter().all(|s| water(s.material))
}

/// Splits a mesh of drops into targets and the others. A drop is a connected component of the triangles.
pub(super) fn split_targets(mesh: &Mesh, smallest: Option<f32>) -> (Mesh, Mesh) {
    let mut drops = DisjointSets::connected(mesh.points.len(), &mesh.triangles);
    // The box of each component; half its longest side is taken as the drop's radius.
    let mut boxes: BTreeMap<u32, Bounds> = BTreeMap::new();
    for (i, p) in (0_u32..).zip(&mesh.points) {
        let drop = boxes.entry(drops.find(i)).or_default();
        *drop = drop.union(Bounds::of([*p]));
    }
    let is_target = |t: &[u32; 3]| {
        // All corners of a triangle are in the same component: the first one decides.
        let drop = boxes.get(&drops.find(t[0]));
        drop.is_some_and(|b| is_target_radius(smallest, b.size().max_element() * 0.5))
    };
    let chosen: Vec<bool> = mesh.triangles.iter().map(is_target).collect();
    (extract_triangles(mesh, |i| chosen[i]), extract_triangles(mesh, |i| !chosen[i]))
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;

    #[test]
    fn drops_are_told_apart_by_their_size() {
        let mut mesh = Mesh::default();
        for (x, r) in [(0.0, 0.0004), (0.01, 0.002), (0.02, 0.03)] {
            let corner = |a: f32, b: f32| Vec3::new(x + a * r, b * r, 0.0);
            let one = Mesh {
                points: vec![corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)],
                normals: vec![Vec3::Z; 4],
                triangles: vec![[0, 1, 2], [0, 2, 3]],
                ..Mesh::default()
            };
            mesh.append(&one.with_material(0));
        }
        let (large, small) = split_targets(&mesh, Some(0.001));
        assert_eq!((large.triangles.len(), large.points.len(), small.triangles.len()), (2, 4, 4));
        assert!((large.points[0].x - 0.008).abs() < 1e-6 && small.points.len() == 8);
        assert_eq!(split_targets(&mesh, None).0.triangles.len(), 0);
    }
}
