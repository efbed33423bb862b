//! Billboards of tufts: one quad, or three crossed ones.

use glam::{Vec2, Vec3};

use super::{Tuft, hair_material, tuning};
use crate::surface::SurfaceMaterial;
use crate::surface::billboard::{
    self, BillboardSample, BillboardTexel, BillboardView, VIEWS, billboard_images, coverage_cutoff,
};
use crate::surface::pixels::next_index;
use osier_base::math::{self, narrow};
use osier_scene::{Material, Mesh};

/// Pixels along a side of the texture, which three crossed billboards share.
const SIDE: usize = SIDE_U32 as usize;
/// [`SIDE`] in the type of image sizes.
const SIDE_U32: u32 = 256;
/// Samples along a side of a pixel: hairs are thinner than a pixel, and 64 samples resolve their coverage.
const SUPERSAMPLING: usize = 8;
/// Number of dilation passes, one pixel each: about log2 of this number of mipmap levels stay free of background.
const DILATION_PASSES: usize = 4;

/// A square picture of one view, rows from the top.
struct TuftRaster {
    view: BillboardView,
    /// Half of the length that a side of the picture spans, m.
    reach: f32,
    /// Samples along a side.
    side: usize,
    samples: Vec<Option<BillboardSample>>,
}

impl TuftRaster {
    fn new(view: BillboardView, reach: f32, pixels: usize) -> Self {
        let side = pixels * SUPERSAMPLING;
        Self { view, reach, side, samples: vec![None; side * side] }
    }

    /// Scale, samples per metre.
    fn scale(&self) -> f32 {
        self.side as f32 * 0.5 / self.reach
    }

    /// Position of a point in samples, and its depth towards the viewer, m.
    fn project(&self, p: Vec3) -> (Vec2, f32) {
        let [right, up, out] = self.view;
        let half = self.side as f32 * 0.5;
        (Vec2::new(half + p.dot(right) * self.scale(), half - p.dot(up) * self.scale()), p.dot(out))
    }

    /// Draws the surface that `f` returns for the positions of samples in a box; nothing where it returns `None`.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the picture")]
    fn draw(&mut self, [low, high]: [Vec2; 2], f: impl Fn(Vec2) -> Option<BillboardSample>) {
        // Scan the bounding box; a sample keeps the surface nearest to the viewer (depth test).
        let clamp = |v: f32| v.clamp(0.0, self.side as f32) as usize;
        let (x, y) = (clamp(low.x.floor())..clamp(high.x.ceil()), clamp(low.y.floor())..clamp(high.y.ceil()));
        for row in y {
            for column in x.clone() {
                let Some(new) = f(Vec2::new(column as f32 + 0.5, row as f32 + 0.5)) else { continue };
                let old = &mut self.samples[row * self.side + column];
                if old.is_none_or(|s| s.depth < new.depth) {
                    *old = Some(new);
                }
            }
        }
    }

    /// Draws a segment of a hair as a round cone. `widths`: diameters at its ends, m.
    fn draw_hair(&mut self, ends: [Vec3; 2], widths: [f32; 2]) {
        let [(a, near), (b, far)] = ends.map(|p| self.project(p));
        let (along, half) = (b - a, widths.map(|w| w * 0.5 * self.scale()));
        let length2 = along.length_squared().max(1e-12);
        let reach = Vec2::splat(half[0].max(half[1]));
        self.draw([a.min(b) - reach, a.max(b) + reach], |p| {
            // Nearest point of the axis; the offset in local radii gives the normal of a round cross-section.
            let t = ((p - a).dot(along) / length2).clamp(0.0, 1.0);
            let off = (p - a - along * t) / math::lerp(half[0], half[1], t).max(1e-6);
            let out = 1.0 - off.length_squared();
            let normal = Vec3::new(off.x, -off.y, math::sqrt_f32(out.max(0.0)));
            let depth = math::lerp(near, far, t);
            (out >= 0.0).then_some(BillboardSample { depth, color: Vec3::from_array(tuning::HAIR), normal })
        });
    }

    /// Draws the ellipsoid of the stalk; `r`: its small semi-axis, m.
    fn draw_stalk(&mut self, r: f32) {
        let shape = Vec3::new(r, 2.0 * r, r);
        let middle = Vec3::NEG_Y * (2.0 * r);
        let [right, up, out] = self.view;
        let (at, _) = self.project(middle);
        let reach = Vec2::new(shape.dot(right.abs()), shape.dot(up.abs()));
        let depth = shape.dot(out.abs());
        let scale = self.scale();
        self.draw([at - reach * scale, at + reach * scale], |p| {
            let off = (p - at) / scale / reach;
            // On the ellipsoid x^2 + y^2 + z^2 = 1 in semi-axes: z towards the viewer, and the gradient as normal.
            let z2 = 1.0 - off.length_squared();
            let z = math::sqrt_f32(z2.max(0.0));
            let normal = math::normalize_or(Vec3::new(off.x / reach.x, -off.y / reach.y, z / depth), Vec3::Z);
            let depth = middle.dot(out) + z * depth;
            (z2 >= 0.0).then_some(BillboardSample { depth, color: Vec3::from_array(tuning::STALK), normal })
        });
    }
}

/// Dilates colours and normals into empty texels, ring after ring, and fills the rest with the colour of hair, so that
/// filtering does not mix in black.
fn dilate(texels: &mut [BillboardTexel], side: usize) {
    let mut known: Vec<bool> = texels.iter().map(|t| t.alpha > 0.0).collect();
    for _ in 0..DILATION_PASSES {
        let before = (texels.to_vec(), known.clone());
        for i in (0..texels.len()).filter(|i| !before.1[*i]) {
            let (x, y) = (i % side, i / side);
            // The mean of up to eight known neighbours, read from a copy, so that the order of pixels does not matter.
            let mut sum = (Vec3::ZERO, Vec3::ZERO, 0.0_f32);
            for row in y.saturating_sub(1)..(y + 2).min(side) {
                for k in (x.saturating_sub(1)..(x + 2).min(side)).map(|column| row * side + column) {
                    if before.1[k] {
                        sum = (sum.0 + before.0[k].color, sum.1 + before.0[k].normal, sum.2 + 1.0);
                    }
                }
            }
            if sum.2 > 0.0 {
                (texels[i].color, known[i]) = (sum.0 / sum.2, true);
                texels[i].normal = math::normalize_or(sum.1, Vec3::Z);
            }
        }
    }
    for (t, _) in texels.iter_mut().zip(&known).filter(|(_, known)| !**known) {
        (t.color, t.normal) = (Vec3::from_array(tuning::HAIR), Vec3::Z);
    }
}

impl Tuft {
    /// The tuft as billboards through its middle. `crossed`: three quads, each with a quarter of the texture; otherwise
    /// one quad that faces +Z, with the whole texture. The mesh has one material, the returned one, whose images have
    /// straight (not premultiplied) alpha.
    /// Source: own. Hairs are drawn as cylinders with 8 x 8 samples per pixel; the alpha cutoff preserves the covered area.
    pub fn billboards(&self, name: &str, crossed: bool) -> (Mesh, SurfaceMaterial) {
        let (views, pixels) = if crossed { (&VIEWS[..], SIDE / 2) } else { (&VIEWS[..1], SIDE) };
        let mut texels = vec![BillboardTexel::default(); SIDE * SIDE];
        let mut mesh = Mesh::default();
        // Mean height of the hairs, at which the horizontal quad lies.
        let height =
            self.hairs.points.iter().fold(0.0, |s, p| s + f64::from(p.y)) / self.hairs.points.len().max(1) as f64;
        for (k, view) in views.iter().enumerate() {
            // A single view fills the texture; three views take a quarter each.
            let corner = (k % 2 * pixels, k / 2 * pixels);
            let raster = self.rasterize(*view, pixels);
            let seen = billboard::texels(&raster.samples, raster.side, SUPERSAMPLING, |sum, count| sum / count);
            for (i, t) in seen.into_iter().enumerate() {
                texels[(corner.1 + i / pixels) * SIDE + corner.0 + i % pixels] = t;
            }
            // The horizontal quad lies at the hairs' mean height; vertical quads pass through the origin.
            let middle = if view[2] == Vec3::Y { Vec3::Y * narrow(height) } else { Vec3::ZERO };
            push_quad(&mut mesh, *view, middle, self.radius, corner, pixels);
        }
        let cut = coverage_cutoff(&texels, SUPERSAMPLING);
        dilate(&mut texels, SIDE);
        let (images, maps) = billboard_images(&texels, name, SIDE_U32);
        let material = Material { maps, alpha_cutoff: Some(cut), ..hair_material(name) };
        (mesh.with_material(0), SurfaceMaterial { material, images })
    }

    /// Rasterizes hairs and stalk in one view. `pixels`: along a side of the picture.
    fn rasterize(&self, view: BillboardView, pixels: usize) -> TuftRaster {
        let mut raster = TuftRaster::new(view, self.radius.max(1e-6), pixels);
        let mut first = 0;
        for count in &self.hairs.counts {
            let end = first + *count as usize;
            for k in first + 1..end {
                let (p, w) = (&self.hairs.points, &self.hairs.widths);
                raster.draw_hair([p[k - 1], p[k]], [w[k - 1], w[k]]);
            }
            first = end;
        }
        if self.spec.stalk > 0.0 {
            raster.draw_stalk(narrow(self.spec.stalk));
        }
        raster
    }
}

/// Appends a quad of half side `reach` (m) around `middle` that shows the texels of the square of `pixels` whose upper left
/// corner is `corner`.
fn push_quad(mesh: &mut Mesh, view: BillboardView, middle: Vec3, reach: f32, corner: (usize, usize), pixels: usize) {
    let [right, up, out] = view;
    let base = next_index(mesh);
    let part = |n: usize| n as f32 / SIDE as f32;
    for (x, y) in [(0, 0), (1, 0), (1, 1), (0, 1)] {
        let (u, v) = (2.0 * x as f32 - 1.0, 2.0 * y as f32 - 1.0);
        mesh.points.push(middle + (right * u + up * v) * reach);
        mesh.normals.push(out);
        mesh.uvs.push(Vec2::new(part(corner.0 + x * pixels), 1.0 - part(corner.1 + (1 - y) * pixels)));
    }
    mesh.triangles.extend([[base, base + 1, base + 2], [base, base + 2, base + 3]]);
}
