//! Terrain: a heightfield by midpoint displacement, of a height map or of an artist's mesh; its mesh in tiles, its material,
//! and the scattering of plants on it.
//!
//! ```
//! use osier_plants::surface::terrain::{Terrain, TerrainParams};
//!
//! # fn main() -> osier_base::Result<()> {
//! let land = Terrain::generate(&TerrainParams { n: 4, ..TerrainParams::default() })?;
//! assert_eq!(land.heights.len(), 17 * 17);
//! # Ok(())
//! # }
//! ```

mod height_map;
mod material;
mod mesh;
mod midpoint;
pub mod scatter;
mod surface;
#[cfg(test)]
mod tests;

use std::sync::Arc;

use glam::Vec3;

use osier_base::{Error, Result};
use osier_scene::solid::CellDiagonal;

pub use height_map::HeightMapParams;
pub use material::{TerrainColors, terrain_material};
pub use surface::{MeshTerrain, SurfaceHit, TerrainSurface};

/// How the cells of the mesh are divided.
const DIAGONAL: CellDiagonal = CellDiagonal::SmallerDifference;

/// Parameters of [`Terrain::generate`]: midpoint displacement on a square.
#[derive(Debug, Clone, PartialEq)]
pub struct TerrainParams {
    /// Number of subdivisions: 2^n + 1 heights along a side, 1..=13.
    pub n: u32,
    /// Length of a side, m, 1..1e6.
    pub size: f64,
    /// Largest displacement of the corners and of the first level, m, 0..1e5.
    pub amplitude: f64,
    /// Exponent H: each level displaces by 2^-H of the one before, 0..=1; 0 is roughest.
    pub exponent: f64,
    /// Heights of the corners (-x -z, +x -z, -x +z, +x +z), m; `None`: random ones.
    pub corners: Option<[f64; 4]>,
    /// Whether opposite edges get equal heights, so that copies of the terrain join.
    pub tileable: bool,
    /// Whether both half steps displace by the same amplitude, as in the paper; false scales the second by 2^(-H / 2).
    pub paper: bool,
    /// Lowest height, m, to which lower ones are raised after smoothing; `None`: no limit.
    pub floor: Option<f64>,
    /// Passes of binomial smoothing (1 2 1) over the finished heights, 0..=8.
    pub smooth: u32,
    /// Length of a cell of the mesh in cells of the heights: a power of two, up to 2^n.
    pub stride: u32,
    /// Seed of the displacements.
    pub seed: u64,
}

impl Default for TerrainParams {
    fn default() -> Self {
        Self {
            n: 9,
            size: 200.0,
            amplitude: 25.0,
            exponent: 0.8,
            corners: None,
            tileable: false,
            paper: false,
            floor: None,
            smooth: 0,
            stride: 1,
            seed: 1,
        }
    }
}

impl TerrainParams {
    /// Checks the ranges stated at the fields; corners and floor must lie within 1e6 m of 0.
    /// # Errors
    /// `Range` naming the first value outside its range.
    pub fn check(&self) -> Result<()> {
        let rows = [
            ("n", f64::from(self.n), 1.0, 13.0, ""),
            ("size", self.size, 1.0, 1e6, "m"),
            ("amplitude", self.amplitude, 0.0, 1e5, "m"),
            ("exponent", self.exponent, 0.0, 1.0, ""),
            ("smooth", f64::from(self.smooth), 0.0, 8.0, "passes"),
            ("stride", f64::from(self.stride), 1.0, f64::from(1_u32 << self.n.min(13)), "cells"),
        ];
        for (name, value, min, max, unit) in rows {
            if !(min..=max).contains(&value) {
                return Err(Error::Range { name: format!("terrain: {name}"), value, min, max, unit });
            }
        }
        let corner = self.corners.iter().flatten().chain(&self.floor).find(|v| !(-1e6..=1e6).contains(*v));
        if let Some(&value) = corner {
            return Err(Error::Range { name: "terrain: height".into(), value, min: -1e6, max: 1e6, unit: "m" });
        }
        if !self.stride.is_power_of_two() {
            let name = "terrain: stride, a power of two,".to_owned();
            return Err(Error::Range { name, value: self.stride.into(), min: 1.0, max: 8192.0, unit: "cells" });
        }
        Ok(())
    }
}

/// Land over a rectangle: heights on a grid of square cells, or the triangles of an artist's mesh.
#[derive(Debug, Clone, PartialEq)]
pub struct Terrain {
    /// Number of heights along x and along z, each at least 2.
    pub counts: [usize; 2],
    /// Lengths along x and along z, m.
    pub size: [f32; 2],
    /// Centre in the world, x and z, m.
    pub center: [f32; 2],
    /// Length of a cell of the mesh in cells of the heights.
    pub stride: usize,
    /// Whether opposite edges have equal heights, and normals at them take both sides into account.
    pub tileable: bool,
    /// Heights, m: rows from -z to +z, in each from -x to +x.
    pub heights: Vec<f32>,
    /// Triangles of an artist's mesh, which then define the surface; `heights` are samples of it for functions that
    /// need a grid.
    pub surface: Option<Arc<TerrainSurface>>,
}

impl Terrain {
    /// Height at column `i` from -x in row `j` from -z, m; indices beyond the border are clamped to it.
    pub fn height(&self, i: usize, j: usize) -> f32 {
        let [columns, rows] = self.counts;
        self.heights.get(j.min(rows - 1) * columns + i.min(columns - 1)).copied().unwrap_or(0.0)
    }

    /// Distance of neighbouring heights along x, m; cells are square.
    pub fn cell(&self) -> f32 {
        self.size[0] / (self.counts[0] - 1) as f32
    }

    /// Coordinate of column (axis 0) or row (axis 1) `i` along x or z, m.
    fn coordinate(&self, axis: usize, i: usize) -> f32 {
        self.size[axis] * (i as f32 / (self.counts[axis] - 1) as f32 - 0.5) + self.center[axis]
    }

    /// Position of (x, z) on the land, 0 to 1 from -x to +x and from -z to +z; outside of 0 to 1 beyond the land.
    pub(crate) fn relative_position(&self, [x, z]: [f32; 2]) -> [f32; 2] {
        [(x - self.center[0]) / self.size[0] + 0.5, (z - self.center[1]) / self.size[1] + 0.5]
    }

    /// True for (x, z) within the rectangle and, for a mesh, neither over a hole nor beyond its edge.
    pub fn covers(&self, x: f32, z: f32) -> bool {
        let inside = [x, z].iter().zip(self.center).zip(self.size).all(|((v, c), s)| (v - c).abs() <= s * 0.5);
        inside && self.surface.as_ref().is_none_or(|mesh| mesh.highest_at(x, z).is_some())
    }

    /// Lowest and highest point of the surface, m, including points of a mesh between the samples.
    pub fn range(&self) -> [f32; 2] {
        // A mesh may rise and fall between the samples of its heights.
        let corners = self.surface.iter().flat_map(|mesh| mesh.corner_heights());
        self.heights.iter().copied().chain(corners).fold([f32::MAX, f32::MIN], |[lo, hi], h| [lo.min(h), hi.max(h)])
    }

    /// Height of the mesh at (x, z), m; points beyond the land are clamped to its border.
    pub fn height_at(&self, x: f32, z: f32) -> f32 {
        self.hit_at(x, z).map_or_else(|| self.triangle_at(x, z).0, |hit| hit.height)
    }

    /// Unit normal, upwards, of the triangle at (x, z); not interpolated.
    pub fn normal_at(&self, x: f32, z: f32) -> Vec3 {
        if let Some(hit) = self.hit_at(x, z) {
            return hit.normal;
        }
        let [dx, dz] = self.triangle_at(x, z).1;
        Vec3::new(-dx, 1.0, -dz).normalize()
    }

    /// The highest surface of an artist's mesh at (x, z); `None` without a mesh, over a hole and beyond the edge.
    fn hit_at(&self, x: f32, z: f32) -> Option<SurfaceHit> {
        self.surface.as_ref()?.highest_at(x, z)
    }

    /// Height and its change along x and z on the triangle under (x, z).
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the cells of the land")]
    fn triangle_at(&self, x: f32, z: f32) -> (f32, [f32; 2]) {
        // Cell and position within it, 0..1 along both sides.
        let across = |count: usize, share: f32| {
            let cells = (count - 1) / self.stride;
            let u = (share * cells as f32).clamp(0.0, cells as f32);
            let i = (u as usize).min(cells - 1);
            (i * self.stride, u - i as f32)
        };
        let [u, v] = self.relative_position([x, z]);
        let ((i, f), (j, g)) = (across(self.counts[0], u), across(self.counts[1], v));
        let [a, b, c, d] = self.corners(i, j);
        // The plane of the triangle that holds the point: h + f dx + g dz, from the corner heights.
        let (dx, dz, h) = if DIAGONAL.is_main([a, b, c, d]) {
            // Split from -x -z to +x +z.
            if f >= g { (b - a, d - b, a) } else { (d - c, c - a, a) }
        } else if f + g <= 1.0 {
            (b - a, c - a, a)
        } else {
            (d - c, d - b, c + b - d)
        };
        let rate = 1.0 / (self.cell() * self.stride as f32);
        (h + f * dx + g * dz, [dx * rate, dz * rate])
    }

    /// Heights at the corners of a cell of the mesh: at (i, j), one stride further along x, along z, and along both.
    fn corners(&self, i: usize, j: usize) -> [f32; 4] {
        let s = self.stride;
        [self.height(i, j), self.height(i + s, j), self.height(i, j + s), self.height(i + s, j + s)]
    }

    /// Unit normal at a height, by central differences over `step` heights; wrapped at the border of tileable land,
    /// one-sided at any other.
    fn normal(&self, i: usize, j: usize, step: usize) -> Vec3 {
        // Indices of both neighbours, and the number of steps between them.
        let around = |k: usize, last: usize| match (k < step, k + step > last) {
            (true, _) if self.tileable => ((last + k - step), k + step, 2),
            (_, true) if self.tileable => (k - step, k + step - last, 2),
            (true, _) => (k, k + step, 1),
            (_, true) => (k - step, k, 1),
            _ => (k - step, k + step, 2),
        };
        let [columns, rows] = self.counts;
        let ((w, e, across), (n, s, along)) = (around(i, columns - 1), around(j, rows - 1));
        let rate = |n: u8| 1.0 / (f32::from(n) * step as f32 * self.cell());
        let dx = (self.height(e, j) - self.height(w, j)) * rate(across);
        let dz = (self.height(i, s) - self.height(i, n)) * rate(along);
        Vec3::new(-dx, 1.0, -dz).normalize()
    }
}
