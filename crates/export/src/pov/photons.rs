//! Which drops photons aim at. A target gets no ordinary light, so drops that few photons would meet must not be one.

use std::collections::BTreeMap;

use super::mesh::pick;
use osier_base::geometry::Bounds;
use osier_scene::{Material, MaterialClass, Mesh};

/// Largest radius of a target, m: photons are spread so that the smallest gets eight across, which makes large ones dear.
const LARGEST: f32 = 0.02;

/// True if photons aim at something of this radius, m. `smallest`: what was asked for.
pub(super) fn aims(smallest: Option<f32>, radius: f32) -> bool {
    smallest.is_some_and(|least| (least..=LARGEST).contains(&radius))
}

/// True if a mesh is nothing but water.
pub(super) fn is_water(mesh: &Mesh, materials: &[Material]) -> bool {
    let water = |m: u32| materials.get(m as usize).is_some_and(|m| m.class == MaterialClass::Water);
    !mesh.subsets.is_empty() && mesh.subsets.iter().all(|s| water(s.material))
}

/// The drops of a mesh that photons aim at, and the others. A drop is what hangs together by its triangles.
pub(super) fn split(mesh: &Mesh, smallest: Option<f32>) -> (Mesh, Mesh) {
    let mut above: Vec<usize> = (0..mesh.points.len()).collect();
    for t in &mesh.triangles {
        let [a, b, c] = t.map(|i| top(&mut above, i as usize));
        let first = a.min(b).min(c);
        [a, b, c].into_iter().for_each(|i| above[i] = first);
    }
    let mut boxes: BTreeMap<usize, Bounds> = BTreeMap::new();
    for (i, p) in mesh.points.iter().enumerate() {
        let drop = boxes.entry(top(&mut above, i)).or_default();
        *drop = drop.union(Bounds::of([*p]));
    }
    let large = |t: &[u32; 3], above: &mut [usize]| {
        let drop = boxes.get(&top(above, t[0] as usize));
        drop.is_some_and(|b| aims(smallest, b.size().max_element() * 0.5))
    };
    let chosen: Vec<bool> = mesh.triangles.iter().map(|t| large(t, &mut above)).collect();
    (pick(mesh, |i| chosen[i]), pick(mesh, |i| !chosen[i]))
}

/// The first point of what a point hangs together with.
fn top(above: &mut [usize], mut i: usize) -> usize {
    while above[i] != i {
        above[i] = above[above[i]];
        i = above[i];
    }
    i
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
        let (large, small) = split(&mesh, Some(0.001));
        assert_eq!((large.triangles.len(), large.points.len(), small.triangles.len()), (2, 4, 4));
        assert!((large.points[0].x - 0.008).abs() < 1e-6 && small.points.len() == 8);
        assert_eq!(split(&mesh, None).0.triangles.len(), 0);
    }
}
