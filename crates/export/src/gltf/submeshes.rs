//! Meshes split by material into submeshes, each with exactly the vertices it uses: the primitives of glTF.

use std::borrow::Cow;

use osier_scene::{Attribute, MaterialId, Mesh};

/// The triangles of one material and the vertices they use.
#[derive(Debug)]
pub(crate) struct Submesh<'a> {
    /// The material that all triangles have in common.
    pub material: MaterialId,
    /// Indices into the vertices of the submesh, not into those of the mesh.
    pub triangles: Cow<'a, [[u32; 3]]>,
    /// For each vertex of the submesh its index in the mesh, increasing; `None` if it has all of them.
    pub vertices: Option<Vec<u32>>,
}

impl Submesh<'_> {
    /// The elements of a list over the mesh's vertices that belong to the submesh.
    pub(crate) fn gather<'b, T: Copy>(&self, all: &'b [T]) -> Cow<'b, [T]> {
        match &self.vertices {
            None => Cow::Borrowed(all),
            Some(list) => Cow::Owned(list.iter().filter_map(|&i| all.get(i as usize)).copied().collect()),
        }
    }

    /// Attributes of the mesh's vertices, restricted to those of the submesh.
    pub(crate) fn gather_attributes<'b>(&self, all: &'b [Attribute]) -> Cow<'b, [Attribute]> {
        match &self.vertices {
            None => Cow::Borrowed(all),
            Some(list) => Cow::Owned(all.iter().map(|a| Attribute { data: a.data.gather(list), ..*a }).collect()),
        }
    }
}

/// The submeshes of a mesh, one for each material, in order of first appearance; none without triangles. Vertices that
/// no triangle uses are dropped; vertices on a border between materials are copied to each of their submeshes.
pub(crate) fn split_by_material(mesh: &Mesh) -> Vec<Submesh<'_>> {
    let mut materials: Vec<MaterialId> = Vec::new();
    for s in mesh.subsets.iter().filter(|s| s.count > 0) {
        if !materials.contains(&s.material) {
            materials.push(s.material);
        }
    }
    let own = |material: &MaterialId| {
        let runs = mesh.subsets.iter().filter(|s| s.material == *material && s.count > 0);
        // A mesh of one material needs no copy of its triangles.
        let triangles = if materials.len() == 1 {
            Cow::Borrowed(mesh.triangles.as_slice())
        } else {
            Cow::Owned(runs.flat_map(|s| mesh.subset_triangles(s)).copied().collect())
        };
        compact_vertices(*material, triangles, mesh.points.len())
    };
    materials.iter().map(own).collect()
}

fn compact_vertices(material: MaterialId, triangles: Cow<'_, [[u32; 3]]>, count: usize) -> Submesh<'_> {
    // A bitmap instead of a set: linear in vertices and triangles, and it yields the vertices in increasing order.
    let mut used = vec![false; count];
    for i in triangles.iter().flatten() {
        used[*i as usize] = true;
    }
    if used.iter().all(|u| *u) {
        return Submesh { material, triangles, vertices: None };
    }
    // Used vertices keep their order; `index_of` maps their old index to the new one.
    let vertices: Vec<u32> = (0_u32..).zip(&used).filter(|(_, u)| **u).map(|(i, _)| i).collect();
    let mut index_of = vec![0_u32; count];
    for (new, old) in (0_u32..).zip(&vertices) {
        index_of[*old as usize] = new;
    }
    let triangles = triangles.iter().map(|t| t.map(|i| index_of[i as usize])).collect();
    Submesh { material, triangles: Cow::Owned(triangles), vertices: Some(vertices) }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use osier_scene::Subset;

    #[test]
    fn pieces_cover_the_mesh_by_material_and_drop_unused_vertices() {
        let mesh = Mesh {
            points: (0_u8..6).map(|i| Vec3::splat(f32::from(i))).collect(),
            normals: vec![Vec3::Y; 6],
            triangles: vec![[0, 1, 2], [2, 1, 3], [5, 1, 0]],
            subsets: vec![
                Subset { material: 4, first: 0, count: 1 },
                Subset { material: 1, first: 1, count: 1 },
                Subset { material: 4, first: 2, count: 1 },
            ],
            ..Mesh::default()
        };
        let list = split_by_material(&mesh);
        assert_eq!(list.iter().map(|p| p.material).collect::<Vec<_>>(), [4, 1]);
        assert_eq!(list[0].vertices.as_deref(), Some([0, 1, 2, 5].as_slice()));
        assert_eq!(*list[0].triangles, [[0, 1, 2], [3, 1, 0]]);
        assert_eq!(list[1].gather(&mesh.points).iter().map(|p| p.x).collect::<Vec<_>>(), [1.0, 2.0, 3.0]);
    }

    #[test]
    fn a_mesh_of_one_material_is_taken_as_it_is() {
        let mesh = Mesh { points: vec![Vec3::ZERO; 3], triangles: vec![[0, 1, 2]], ..Mesh::default() }.with_material(0);
        let list = split_by_material(&mesh);
        assert!(matches!(list.as_slice(), [Submesh { vertices: None, triangles: Cow::Borrowed(_), .. }]));
    }
}
