//! Triangle meshes.

use std::collections::BTreeMap;

use glam::{Vec2, Vec3};

use super::{Attribute, MaterialId};
use osier_base::convert::saturating_index;
use osier_base::geometry::Bounds;

/// A run of triangles with one material.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Subset {
    /// Index into the materials of the scene, or of the plant that the mesh is a prototype of.
    pub material: MaterialId,
    /// Index of the run's first triangle in the mesh.
    pub first: u32,
    /// Number of triangles; the next subset begins at `first + count`.
    pub count: u32,
}

/// Triangles with one normal and one UV per vertex (vertices are doubled at seams).
#[derive(Debug, Clone, Default)]
pub struct Mesh {
    /// Positions in the space of the asset or prototype, m.
    pub points: Vec<Vec3>,
    /// Unit normals, one per point; never empty for a mesh with points.
    pub normals: Vec<Vec3>,
    /// Texture coordinates, one per point, or empty. v points up.
    pub uvs: Vec<Vec2>,
    /// Linear RGBA, one per point, or empty.
    pub colors: Vec<[f32; 4]>,
    /// Further values, one per point or one for the mesh.
    pub attributes: Vec<Attribute>,
    /// Indices of three points each, counter-clockwise as seen from outside.
    pub triangles: Vec<[u32; 3]>,
    /// Consecutive runs that cover all triangles exactly once.
    pub subsets: Vec<Subset>,
}

impl Mesh {
    /// The axis-aligned box of all points; empty without points.
    #[inline]
    pub fn bounds(&self) -> Bounds {
        Bounds::of(self.points.iter().copied())
    }

    /// Index of the point that is added next. The limit `vertices` refuses meshes long before they hold 2^32 points, which
    /// would take 48 GB for positions alone.
    #[inline]
    pub fn next_point(&self) -> u32 {
        saturating_index(self.points.len())
    }

    /// Index of the triangle that is added next; triangles are bounded as points are.
    #[inline]
    pub fn next_triangle(&self) -> u32 {
        saturating_index(self.triangles.len())
    }

    /// The mesh with one subset over all triangles in place of its subsets.
    #[inline]
    pub fn with_material(mut self, material: MaterialId) -> Self {
        let count = self.next_triangle();
        self.subsets = vec![Subset { material, first: 0, count }];
        self
    }

    /// Appends another mesh, whose first subset is merged into the last one here if both have one material. Texture
    /// coordinates and colours are joined too: both meshes must have them, or neither.
    pub fn append(&mut self, other: &Self) {
        let (base, first) = (self.next_point(), self.next_triangle());
        Attribute::append_all(&mut self.attributes, self.points.len(), &other.attributes, other.points.len());
        self.points.extend_from_slice(&other.points);
        self.normals.extend_from_slice(&other.normals);
        self.uvs.extend_from_slice(&other.uvs);
        self.colors.extend_from_slice(&other.colors);
        self.triangles.extend(other.triangles.iter().map(|t| t.map(|i| i + base)));
        for s in &other.subsets {
            match self.subsets.last_mut() {
                Some(last) if last.material == s.material => last.count += s.count,
                _ => self.subsets.push(Subset { first: first + s.first, ..*s }),
            }
        }
    }

    /// Sorts the triangles by material, so that each material has one subset.
    pub fn join_subsets(&mut self) {
        let mut by_material: BTreeMap<MaterialId, Vec<[u32; 3]>> = BTreeMap::new();
        for s in &self.subsets {
            by_material.entry(s.material).or_default().extend_from_slice(self.subset_triangles(s));
        }
        (self.triangles, self.subsets) = (Vec::new(), Vec::new());
        for (material, triangles) in by_material {
            self.append_subset(material, triangles);
        }
    }

    /// For each point, true if all its triangles have no area when the points of the mesh are at `points`, so that the point is
    /// not visible.
    pub fn unseen_points(&self, points: &[Vec3]) -> Vec<bool> {
        /// Largest width of a triangle whose corners are collinear but for rounding, as a share of their distance from the origin.
        const ROUNDING: f32 = 1e-6;
        let mut unseen = vec![true; points.len()];
        for t in &self.triangles {
            let [a, b, c] = t.map(|i| i as usize);
            let (Some(pa), Some(pb), Some(pc)) = (points.get(a), points.get(b), points.get(c)) else { continue };
            // The width is twice the area divided by the longest edge; both sides are squared, to save roots.
            let (ab, ac, bc) = (*pb - *pa, *pc - *pa, *pc - *pb);
            let longest = ab.length_squared().max(ac.length_squared()).max(bc.length_squared());
            if ab.cross(ac).length_squared() > ROUNDING * ROUNDING * pa.length_squared() * longest {
                [a, b, c].into_iter().for_each(|i| unseen[i] = false);
            }
        }
        unseen
    }

    /// Appends triangles over points of the mesh as a new subset, even if the last one has the same material.
    pub fn append_subset(&mut self, material: MaterialId, triangles: Vec<[u32; 3]>) {
        let first = self.next_triangle();
        self.triangles.extend(triangles);
        self.subsets.push(Subset { material, first, count: self.next_triangle() - first });
    }

    /// Triangles of a subset; what lies beyond the mesh's last one is left out.
    #[inline]
    pub fn subset_triangles(&self, s: &Subset) -> &[[u32; 3]] {
        let first = (s.first as usize).min(self.triangles.len());
        let end = (first + s.count as usize).min(self.triangles.len());
        &self.triangles[first..end]
    }
}

/// How a mesh changes over the clip: not at all, by joints, or by data in the frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MeshMotion {
    /// The mesh keeps its rest shape over the clip.
    Still,
    /// By its skin and the asset's skeleton; frames carry poses only.
    Skinned,
    /// Frames carry new points of the same topology. A skin, if there is one, approximates the motion for formats without vertex caches.
    Deforming,
    /// Frames carry whole meshes, whose numbers of points and triangles change.
    Varying,
}

/// Joints that move the points of a mesh, up to four for each point.
#[derive(Debug, Clone, Default)]
pub struct SkinWeights {
    /// Indices into the asset's skeleton; unused places are 0.
    pub joints: Vec<[u16; 4]>,
    /// Weights, largest first, sum 1 within 1e-6; unused places are 0.
    pub weights: Vec<[f32; 4]>,
}

/// A mesh that occurs once in an asset, and how it moves.
#[derive(Debug, Clone)]
pub struct MeshObject {
    /// Prim and node name, `[a-z0-9_]+`, unique in the asset.
    pub name: String,
    /// Rest shape (for a varying mesh: the shape in formats whose meshes cannot vary; may be empty).
    pub mesh: Mesh,
    /// Kind of change, which decides what frames hold for the mesh.
    pub motion: MeshMotion,
    /// Present for skinned meshes, optional for deforming ones.
    pub skin: Option<SkinWeights>,
}
