//! The heightfield as a mesh in tiles, whose edges match bit by bit.

use glam::{Vec2, Vec3};

use super::{DIAGONAL, Terrain};
use osier_base::par::par_map;
use osier_scene::Mesh;

/// Most cells along a side of a tile, so that its 256 x 256 points can be numbered in 16 bits.
const MAX_TILE_CELLS: usize = 255;

impl Terrain {
    /// Meshes of one material (0) that cover the terrain, called `tile_<row>_<column>`; common edges of neighbours are equal bit
    /// by bit. u runs 0..1 along +x, v along -z. Cells are split as in [`Terrain::height_at`].
    pub fn tiles(&self) -> Vec<(String, Mesh)> {
        let [across, along] = self.counts.map(|n| (n - 1) / self.stride);
        // Cuts at whole cells, so that tiles differ by one cell at most.
        let count = |cells: usize| cells.div_ceil(MAX_TILE_CELLS);
        let cut = |t: usize, cells: usize| t * cells / count(cells);
        let all: Vec<[usize; 2]> = (0..count(along)).flat_map(|r| (0..count(across)).map(move |c| [r, c])).collect();
        par_map(&all, |&[r, c]| {
            let mesh = self.tile([cut(c, across), cut(c + 1, across)], [cut(r, along), cut(r + 1, along)]);
            (format!("tile_{r}_{c}"), mesh.with_material(0))
        })
    }

    /// The mesh of the cells `across` (from, to) along x and `along` along z.
    fn tile(&self, across: [usize; 2], along: [usize; 2]) -> Mesh {
        let (width, s) = (across[1] - across[0] + 1, self.stride);
        let mut mesh = Mesh::default();
        let [across_last, along_last] = self.counts.map(|n| (n - 1) as f32);
        for j in (along[0]..=along[1]).map(|j| j * s) {
            for i in (across[0]..=across[1]).map(|i| i * s) {
                mesh.points.push(Vec3::new(self.coordinate(0, i), self.height(i, j), self.coordinate(1, j)));
                mesh.normals.push(self.normal(i, j, s));
                mesh.uvs.push(Vec2::new(i as f32 / across_last, 1.0 - j as f32 / along_last));
            }
        }
        for j in along[0]..along[1] {
            for i in across[0]..across[1] {
                // A tile has at most 256 x 256 points.
                #[allow(clippy::cast_possible_truncation, reason = "at most 65,535")]
                let [first, width] = [(j - along[0]) * width + (i - across[0]), width].map(|k| k as u32);
                let [a, b, c, d] = [first, first + 1, first + width, first + width + 1];
                // Two triangles, along the diagonal of the smaller height difference.
                let halves = if DIAGONAL.is_main(self.corners(i * s, j * s)) {
                    [[a, d, b], [a, c, d]]
                } else {
                    [[a, c, b], [b, c, d]]
                };
                mesh.triangles.extend(halves);
            }
        }
        mesh
    }
}
