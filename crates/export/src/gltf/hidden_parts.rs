//! Meshes with parts that are invisible over much of a clip, such as branches and leaves of a growing plant: targets
//! contain vertices only where these are visible.
//!
//! A part is a connected set of triangles. Target 0 has weight 1 over the whole clip and collapses every part to a
//! point, where its triangles have no area. The other targets are differences from that state. Each contains the
//! vertices of the parts that are visible in its shape or in the shape before or after it. So a part is in its place,
//! as a whole, at both ends of each interval in which it is visible, and collapsed otherwise. Between a collapsed shape
//! and a shape without area the part has no area either.
//!
//! ```text
//! shape            0     1     2     3     4     5     6
//! a part is seen   -     -     -     yes   yes   -     -
//! target holds it              x     x     x     x          at 2 and 5 where its shape has no area
//! ```

use glam::Vec3;

use super::morph_shape::MorphShape;
use super::options::{INDEX_BYTES, VECTOR_BYTES};
use osier_base::convert::saturating_index;
use osier_base::disjoint_sets::DisjointSets;
use osier_scene::Mesh;

/// The vertices of a shape that its target contains.
#[derive(Debug, Default, PartialEq)]
pub(super) struct ShownVertices {
    /// Indices of vertices of the mesh, increasing.
    pub indices: Vec<u32>,
    /// Position of each vertex in `indices`.
    pub points: Vec<Vec3>,
    /// Normal of each vertex in `indices`; may be empty.
    pub normals: Vec<Vec3>,
}

/// The shapes of a mesh, each without the parts that are invisible.
#[derive(Debug, Default)]
pub(super) struct HiddenParts {
    /// Points of the mesh when all parts are hidden: the points of each part coincide.
    pub hidden: Vec<Vec3>,
    /// One for each shape.
    pub shapes: Vec<ShownVertices>,
}

impl HiddenParts {
    /// Finds the hidden parts. `None` if targets with all vertices are shorter, for example if everything is always
    /// visible.
    pub(super) fn of(mesh: &Mesh, shapes: &[MorphShape]) -> Option<Self> {
        if shapes.iter().all(|shape| !shape.unseen.contains(&true)) {
            return None;
        }
        let parts = parts_of(mesh);
        let count = parts.iter().max().map_or(0, |last| last + 1);
        let is_seen = |shape: &MorphShape| {
            let mut seen = vec![false; count];
            for (i, part) in parts.iter().enumerate() {
                seen[*part] |= shape.unseen.get(i) != Some(&true);
            }
            seen
        };
        let seen: Vec<Vec<bool>> = shapes.iter().map(is_seen).collect();
        let is_held = |k: usize, part: usize| {
            let near = k.saturating_sub(1)..(k + 2).min(seen.len());
            seen[near].iter().any(|shape| shape[part])
        };
        let mut hidden: Vec<Option<Vec3>> = vec![None; count];
        let mut list = Vec::with_capacity(shapes.len());
        for (k, shape) in shapes.iter().enumerate() {
            let mut shown = ShownVertices::default();
            let has_normals = shape.normals.len() == shape.points.len();
            let held: Vec<bool> = (0..count).map(|part| is_held(k, part)).collect();
            for (i, (part, point)) in parts.iter().zip(&shape.points).enumerate().filter(|(_, (part, _))| held[**part])
            {
                // A hidden part collapses to its first vertex in the first shape that stores the part.
                hidden[*part].get_or_insert(*point);
                shown.indices.push(saturating_index(i));
                shown.points.push(*point);
                if has_normals {
                    shown.normals.push(shape.normals[i]);
                }
            }
            list.push(shown);
        }
        let held: usize = list.iter().map(|shown| shown.indices.len()).sum();
        let all = mesh.points.len();
        // The target that hides all parts contains all vertices.
        if held * (VECTOR_BYTES + INDEX_BYTES) + all * VECTOR_BYTES >= all * VECTOR_BYTES * shapes.len() {
            return None;
        }
        // A part that is never visible is a point at its first vertex.
        for (part, point) in parts.iter().zip(&mesh.points) {
            hidden[*part].get_or_insert(*point);
        }
        let hidden = parts.iter().map(|part| hidden[*part].unwrap_or_default()).collect();
        Some(Self { hidden, shapes: list })
    }

    /// The shape with the most vertices; the last one of several.
    pub(super) fn fullest(&self) -> Option<usize> {
        (0..self.shapes.len()).max_by_key(|k| self.shapes[*k].indices.len())
    }

    /// Whether the shapes have normals: true if all shapes that have vertices have them.
    pub(super) fn has_normals(&self) -> bool {
        let mut shown = self.shapes.iter().filter(|s| !s.indices.is_empty()).peekable();
        shown.peek().is_some() && shown.all(|s| s.normals.len() == s.indices.len())
    }
}

/// For each point the number of its part; parts are numbered from 0 in the order of their first points.
fn parts_of(mesh: &Mesh) -> Vec<usize> {
    let mut sets = DisjointSets::connected(mesh.points.len(), &mesh.triangles);
    let mut part_of_first = vec![None; mesh.points.len()];
    let mut next = 0;
    (0..)
        .take(mesh.points.len())
        .map(|i| {
            let first = sets.find(i) as usize;
            *part_of_first[first].get_or_insert_with(|| {
                next += 1;
                next - 1
            })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two triangles that share no points, and a third that joins the second.
    fn mesh() -> Mesh {
        let points = (0_u8..7).map(|i| Vec3::new(f32::from(i), f32::from(i % 2), 0.0)).collect();
        Mesh { points, triangles: vec![[0, 1, 2], [3, 5, 4], [4, 5, 6]], ..Mesh::default() }
    }

    /// The shape in which the triangles of the second part have no area, shifted by `y`.
    fn shape(mesh: &Mesh, y: f32, hides: bool) -> MorphShape {
        let place = |(i, p): (usize, &Vec3)| if hides && i > 2 { Vec3::new(9.0, y, 0.0) } else { *p + Vec3::Y * y };
        let points: Vec<Vec3> = mesh.points.iter().enumerate().map(place).collect();
        let unseen = mesh.unseen_points(&points);
        MorphShape { normals: Vec::new(), points, unseen }
    }

    #[test]
    fn parts_are_connected_triangles() {
        assert_eq!(parts_of(&mesh()), [0, 0, 0, 1, 1, 1, 1]);
        let apart = Mesh { points: vec![Vec3::ZERO; 3], triangles: vec![[2, 1, 2]], ..Mesh::default() };
        assert_eq!(parts_of(&apart), [0, 1, 1]);
    }

    #[test]
    fn targets_hold_what_is_seen_in_a_shape_and_beside_it() {
        let mesh = mesh();
        // The second part is seen in shape 4 of nine.
        let shapes: Vec<MorphShape> = (0_u8..9).map(|k| shape(&mesh, f32::from(k), k != 4)).collect();
        let parts = HiddenParts::of(&mesh, &shapes).expect("shorter");
        let held: Vec<usize> = parts.shapes.iter().map(|s| s.indices.len()).collect();
        assert_eq!(held, [3, 3, 3, 7, 7, 7, 3, 3, 3]);
        assert_eq!(parts.fullest(), Some(5));
        // It waits at its place in shape 3, where it has no area; the first part at that of its first point.
        assert_eq!(parts.hidden[..3], [mesh.points[0]; 3]);
        assert_eq!(parts.hidden[3..], [Vec3::new(9.0, 3.0, 0.0); 4]);
        assert_eq!((parts.shapes[4].indices[3], parts.shapes[4].points[3]), (3, shapes[4].points[3]));
        // At no time between two shapes does it have an area that the shapes do not give it.
        let points_at = |k: usize| {
            let mut points = parts.hidden.clone();
            for (i, p) in parts.shapes[k].indices.iter().zip(&parts.shapes[k].points) {
                points[*i as usize] = *p;
            }
            points
        };
        for k in 0..8 {
            let middle: Vec<Vec3> = points_at(k).iter().zip(points_at(k + 1)).map(|(a, b)| a.lerp(b, 0.5)).collect();
            let is_hidden = mesh.unseen_points(&middle)[3..] == [true; 4];
            assert_eq!(is_hidden, !(3..5).contains(&k), "between shapes {k} and {}", k + 1);
        }
    }

    #[test]
    fn what_is_seen_at_all_times_is_written_as_it_is() {
        let mesh = mesh();
        let shapes: Vec<MorphShape> = (0_u8..9).map(|k| shape(&mesh, f32::from(k), false)).collect();
        assert!(HiddenParts::of(&mesh, &shapes).is_none());
        // A part that is hidden in one shape of nine saves nothing.
        let shapes: Vec<MorphShape> = (0_u8..9).map(|k| shape(&mesh, f32::from(k), k == 0)).collect();
        assert!(HiddenParts::of(&mesh, &shapes).is_none());
    }
}
