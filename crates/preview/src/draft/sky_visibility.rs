//! Sky visibility on a voxel grid: a soft ambient occlusion without noise, the same from near and far.

use glam::Vec3;

use super::super::render_scene::RenderScene;
use super::super::solid::Primitives;
use osier_base::math;
use osier_base::par::par_chunks;

/// Voxels along the longest side of the grid.
const VOXELS: f32 = 40.0;
/// Margin around the scene, as a multiple of its height: within it, a ray at the elevation of [`SIDE_UP`] rises by that height.
const MARGIN: f32 = 0.8;
/// Solids of at most this many primitives are put into one voxel as a whole: leaves are smaller than a voxel.
const MAX_SINGLE_VOXEL_PRIMITIVES: usize = 500;
/// Directions around the vertical one; seven directions represent the hemisphere.
const SIDE_DIRECTIONS: u16 = 6;
/// Sine and cosine of their elevation, 51 degrees: with the vertical one they have the mean height of a
/// cosine-weighted hemisphere.
const SIDE_UP: f32 = 0.78;
const SIDE_OUT: f32 = 0.626;

/// Fraction of the sky that is visible from the voxels of a grid around the scene.
#[derive(Debug)]
pub(super) struct SkyVisibility {
    /// Lower corner of the grid in the world, m.
    low: Vec3,
    /// Side of a voxel, m.
    cell: f32,
    /// Voxels along x, y and z.
    size: [usize; 3],
    /// Optical depth of each voxel for light that crosses it along one side; a depth of 1 transmits 1/e.
    depth: Vec<f32>,
    /// Fraction of the sky that is visible from the middle of each voxel, 0 to 1.
    visibility: Vec<f32>,
}

impl SkyVisibility {
    pub(super) fn new(world: &RenderScene<'_>) -> Self {
        // The margin around the scene lets the directions near its edge leave the grid upwards, and
        // shades the ground beside it.
        let extent = world.bounds.size();
        let reach = Vec3::new(extent.y, 0.0, extent.y) * MARGIN;
        let low = world.bounds.min - reach;
        let sides = extent + reach * 2.0;
        // Cubic voxels: their number along an axis follows from its length.
        let cell = (sides.max_element() / VOXELS).max(1e-6);
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most VOXELS")]
        let size = sides.to_array().map(|s| (s / cell).min(VOXELS) as usize + 1);
        let mut grid = Self { low, cell, size, depth: vec![0.0; size.iter().product()], visibility: Vec::new() };
        grid.voxelize(world);
        let voxels: Vec<usize> = (0..grid.depth.len()).collect();
        let visibility =
            par_chunks(&voxels, 1 << 10, |_, list| list.iter().map(|i| grid.integrate(*i)).collect::<Vec<_>>());
        grid.visibility = visibility.concat();
        grid
    }

    /// Adds all primitives as a medium: a surface of area a, averaged over all orientations, has the projected area a
    /// / 2, and so adds a / (2 cell^2) to the optical depth of its voxel.
    fn voxelize(&mut self, world: &RenderScene<'_>) {
        let depth_per_area = 0.5 / (self.cell * self.cell);
        for i in 0..world.primitive_counts().len() {
            let Some((instance, solid)) = world.instance(i) else { continue };
            let transform = instance.world_from_local();
            let to_world = |p: Vec3| transform.linear * p + transform.translation;
            // Areas scale by the determinant to the power of 2/3.
            let area_scale = math::pow_f32(transform.linear.determinant().abs(), 2.0 / 3.0);
            match (&solid.kind, solid.bounds()) {
                (Primitives::Triangles { triangles, .. }, _) if triangles.len() > MAX_SINGLE_VOXEL_PRIMITIVES => {
                    for triangle in triangles {
                        let [ab, ac] = triangle.edges();
                        let area = 0.5 * triangle.normal().length() * area_scale;
                        self.add(to_world(triangle.a + (ab + ac) * (1.0 / 3.0)), area * depth_per_area);
                    }
                }
                (Primitives::Cones { cones, .. }, _) => {
                    for cone in cones {
                        let [min, max] = cone.bounds();
                        // Twice the silhouette: closed bodies have a far side as well.
                        let area = cone.silhouette_area() * 2.0 * area_scale;
                        self.add(to_world((min + max) * 0.5), area * depth_per_area);
                    }
                }
                (_, Some([min, max])) => {
                    self.add(to_world((min + max) * 0.5), solid.area * area_scale * depth_per_area);
                }
                _ => {}
            }
        }
    }

    fn add(&mut self, p: Vec3, depth: f32) {
        if let Some(voxel) = self.voxel(p).and_then(|i| self.depth.get_mut(i)) {
            *voxel += depth;
        }
    }

    /// Index of the voxel at a point; `None` outside of the grid.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "not below zero, and compared")]
    fn voxel(&self, p: Vec3) -> Option<usize> {
        let q = (p - self.low) / self.cell;
        let [x, y, z] = self.size;
        let is_inside = q.min_element() >= 0.0 && q.is_finite();
        let [i, j, k] = q.to_array().map(|v| v as usize);
        (is_inside && i < x && j < y && k < z).then(|| (k * y + j) * x + i)
    }

    /// Mean transmittance from the middle of voxel `i` to the sky over seven directions.
    #[allow(clippy::cast_precision_loss, reason = "at most VOXELS")]
    fn integrate(&self, i: usize) -> f32 {
        let [x, y, _] = self.size;
        let middle = [i % x, i / x % y, i / x / y].map(|v| v as f32 + 0.5);
        let from = self.low + Vec3::from_array(middle) * self.cell;
        let sides = (0..SIDE_DIRECTIONS).map(|k| {
            let azimuth = f32::from(k) / f32::from(SIDE_DIRECTIONS) * std::f32::consts::TAU;
            let direction = Vec3::new(math::cos_f32(azimuth) * SIDE_OUT, SIDE_UP, math::sin_f32(azimuth) * SIDE_OUT);
            self.transmittance(from, direction)
        });
        (sides.sum::<f32>() + self.transmittance(from, Vec3::Y)) / f32::from(SIDE_DIRECTIONS + 1)
    }

    /// Transmittance exp(-depth) from a point to the sky along a unit direction, in steps of one voxel. The voxel of
    /// the point itself is left out, else every leaf would occlude itself.
    fn transmittance(&self, from: Vec3, direction: Vec3) -> f32 {
        let (mut depth, mut p) = (0.0, from + direction * self.cell);
        while let Some(i) = self.voxel(p) {
            depth += self.depth[i];
            p += direction * self.cell;
        }
        math::exp_f32(-depth)
    }

    /// Fraction of the sky that is visible from a point: trilinear between the middles of voxels, repeated beyond the
    /// outermost, where the sky is almost open; 1 for a point that is not finite.
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        clippy::cast_precision_loss,
        reason = "held to the cells"
    )]
    pub(super) fn at(&self, p: Vec3) -> f32 {
        let q = (p - self.low) / self.cell - 0.5;
        if !q.is_finite() {
            return 1.0;
        }
        // Along each axis: the voxels below and above, and the fraction between them.
        let axis = |v: f32, n: usize| {
            let v = v.clamp(0.0, (n - 1) as f32);
            let i = v as usize;
            (i, (i + 1).min(n - 1), v - i as f32)
        };
        let ([x, y, _], [(i, i2, u), (j, j2, v), (k, k2, w)]) =
            (self.size, [axis(q.x, self.size[0]), axis(q.y, self.size[1]), axis(q.z, self.size[2])]);
        let row = |j, k| {
            let voxel = |i| self.visibility.get((k * y + j) * x + i).copied().unwrap_or(1.0);
            math::lerp(voxel(i), voxel(i2), u)
        };
        math::lerp(math::lerp(row(j, k), row(j2, k), v), math::lerp(row(j, k2), row(j2, k2), v), w)
    }
}
