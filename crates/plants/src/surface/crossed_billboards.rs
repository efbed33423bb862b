//! Distant plants: pictures of meshes on quads that cross in their middle.

use glam::{Vec2, Vec3};

use super::SurfaceMaterial;
use super::billboard::{
    BillboardSample, BillboardTexel, BillboardView, VIEWS, billboard_images, coverage_cutoff, texels,
};
use super::pixels::next_index;
use osier_base::geometry::Bounds;
use osier_base::math::{self, narrow};
use osier_base::par::par_map;
use osier_base::units::linear_from_srgb;
use osier_scene::{Image, Material, MaterialClass, Mesh, Pixels, pixel_at};

/// Samples along a side of a pixel: 16 levels of alpha.
const SUPERSAMPLING: usize = 4;
/// A billboard is darkened by (mean number of layers)^-this, for the shadows that its leaves would cast on each other. Larger
/// values darken dense branches more; chosen by comparing trees with their billboards from afar.
const SHADE_EXPONENT: f32 = 0.52;
/// Empty pixels around a view, so that filtering does not mix neighbouring views.
const MARGIN: usize = 2;

/// The materials of meshes: their subsets index `materials`, whose maps index `images`.
#[derive(Debug, Clone, Copy)]
pub struct SourceMaterials<'a> {
    /// Materials, indexed by the subsets' material ids.
    pub materials: &'a [Material],
    /// Images, indexed by the materials' maps.
    pub images: &'a [Image],
}

/// An orthographic view of a mesh, rasterized with a depth buffer.
struct MeshRaster {
    view: BillboardView,
    /// Corners of the view, m along right and up.
    low: Vec2,
    high: Vec2,
    /// Position of its quad along the line of sight, m.
    depth: f32,
    /// Samples along a side.
    side: usize,
    samples: Vec<Option<BillboardSample>>,
    /// Number of surfaces hit over all samples, including hidden ones.
    hits: u64,
}

impl MeshRaster {
    fn new(mesh: &Mesh, view: BillboardView, pixels: usize) -> Self {
        let [right, up, out] = view;
        let seen = Bounds::of(mesh.points.iter().map(|p| Vec3::new(p.dot(right), p.dot(up), p.dot(out))));
        let (low, high) = (seen.min.truncate(), seen.max.truncate());
        // The mesh fills the image except for MARGIN pixels on each side: pixel size = mesh size / inner pixels.
        let inner = narrow((pixels - 2 * MARGIN) as f64);
        let margin = (high - low).max(Vec2::splat(1e-4)) * (narrow(MARGIN as f64) / inner);
        // The horizontal quad lies at the mean height of the mesh's area; vertical quads pass through the stem.
        let depth = if out == Vec3::Y { area_mean(mesh, out) } else { 0.0 };
        let side = pixels * SUPERSAMPLING;
        let (low, high) = (low - margin, high.max(low + 1e-4) + margin);
        Self { view, low, high, depth, side, samples: vec![None; side * side], hits: 0 }
    }

    /// Rasterizes the triangles of a mesh, in the colours of their materials; subsets of unknown materials are skipped.
    fn draw(&mut self, mesh: &Mesh, source: SourceMaterials<'_>) {
        for subset in &mesh.subsets {
            let Some(material) = source.materials.get(subset.material as usize) else { continue };
            let colors = ColorSampler::new(material, source.images);
            for t in mesh.subset_triangles(subset) {
                self.draw_triangle(mesh, *t, &colors);
            }
        }
    }

    /// Rasterizes a triangle: barycentric weights by edge functions, nearest surface per sample.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the picture")]
    fn draw_triangle(&mut self, mesh: &Mesh, t: [u32; 3], colors: &ColorSampler<'_>) {
        let [right, up, out] = self.view;
        let scale = Vec2::splat(self.side as f32) / (self.high - self.low);
        let corners = t.map(|i| mesh.points[i as usize]);
        let [a, b, c] = corners.map(|p| (Vec2::new(p.dot(right), p.dot(up)) - self.low) * scale);
        let area = (b - a).perp_dot(c - a);
        if area == 0.0 {
            return;
        }
        let most = self.side as f32;
        let (low, high) = (a.min(b).min(c), a.max(b).max(c));
        let range = |low: f32, high: f32| low.floor().clamp(0.0, most) as usize..high.ceil().clamp(0.0, most) as usize;
        let at = |list: &[Vec3], i: usize| list.get(t[i] as usize).copied().unwrap_or(Vec3::Y);
        for row in range(low.y, high.y) {
            for column in range(low.x, high.x) {
                let p = Vec2::new(column as f32 + 0.5, row as f32 + 0.5);
                // Barycentric weights by edge functions, which are negative outside.
                let w = [(b - p).perp_dot(c - p), (c - p).perp_dot(a - p), (a - p).perp_dot(b - p)].map(|v| v / area);
                if w.iter().any(|v| *v < 0.0) {
                    continue;
                }
                let mix = |f: &dyn Fn(usize) -> Vec3| f(0) * w[0] + f(1) * w[1] + f(2) * w[2];
                let depth = mix(&|i| corners[i]).dot(out);
                let uv = mix(&|i| mesh.uvs.get(t[i] as usize).map_or(Vec3::ZERO, |uv| uv.extend(0.0))).truncate();
                let Some(color) = colors.at(uv) else { continue };
                self.hits += 1;
                let slot = &mut self.samples[(self.side - 1 - row) * self.side + column];
                if slot.is_some_and(|s| s.depth >= depth) {
                    continue;
                }
                let n = mix(&|i| at(&mesh.normals, i));
                let n = math::normalize_or(Vec3::new(n.dot(right), n.dot(up), n.dot(out)), Vec3::Z);
                // Leaves are two-sided: a normal that points away from the viewer is reversed.
                let normal = if n.z < 0.0 { -n } else { n };
                *slot = Some(BillboardSample { depth, color, normal });
            }
        }
    }

    /// Factor that darkens the view in place of the shadows that the leaves of the mesh cast on each other, at most 1.
    /// Own: mean number of layers to the power -[`SHADE_EXPONENT`].
    fn shade(&self) -> f32 {
        let covered = self.samples.iter().flatten().count().max(1);
        #[allow(clippy::cast_precision_loss, reason = "an area mean")]
        let layers = self.hits as f64 / covered as f64;
        math::pow_f32(narrow(layers.max(1.0)), -SHADE_EXPONENT)
    }

    fn texels(&self) -> Vec<BillboardTexel> {
        let shade = self.shade();
        texels(&self.samples, self.side, SUPERSAMPLING, |sum, count| sum * (shade / count))
    }

    /// Appends the quad that shows this view. `corner`, `part`: upper left corner and side of its texels, as shares of the
    /// texture.
    fn push_quad(&self, mesh: &mut Mesh, corner: Vec2, part: f32) {
        let [right, up, out] = self.view;
        let base = next_index(mesh);
        for (x, y) in [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)] {
            let p = self.low + (self.high - self.low) * Vec2::new(x, y);
            mesh.points.push(right * p.x + up * p.y + out * self.depth);
            mesh.normals.push(out);
            mesh.uvs.push(Vec2::new(corner.x + x * part, 1.0 - corner.y - (1.0 - y) * part));
        }
        mesh.triangles.extend([[base, base + 1, base + 2], [base, base + 2, base + 3]]);
    }
}

/// Area-weighted mean position of a mesh along a direction, m.
fn area_mean(mesh: &Mesh, along: Vec3) -> f32 {
    let (mut sum, mut area) = (0.0_f64, 0.0_f64);
    for t in &mesh.triangles {
        let [a, b, c] = t.map(|i| mesh.points[i as usize]);
        let own = f64::from((b - a).cross(c - a).length());
        (sum, area) = (sum + own * f64::from((a + b + c).dot(along) / 3.0), area + own);
    }
    if area > 0.0 { narrow(sum / area) } else { 0.0 }
}

/// The colour of a material by texture coordinates.
struct ColorSampler<'a> {
    base: Vec3,
    map: Option<(&'a Image, &'a [u8])>,
    coverage_cutoff: f32,
}

impl<'a> ColorSampler<'a> {
    fn new(material: &Material, images: &'a [Image]) -> Self {
        let image = material.maps.color.and_then(|i| images.get(i as usize));
        let map = image.and_then(|i| match &i.pixels {
            Pixels::U8(bytes) if i.channels >= 3 && i.width > 0 && i.height > 0 => Some((i, bytes.as_slice())),
            _ => None,
        });
        Self { base: Vec3::from_array(material.base_color), map, coverage_cutoff: material.alpha_cutoff.unwrap_or(0.0) }
    }

    /// Linear colour (nearest texel); `None` where the alpha is below the cutoff.
    fn at(&self, uv: Vec2) -> Option<Vec3> {
        let Some((image, bytes)) = self.map else { return Some(self.base) };
        let channels = usize::from(image.channels);
        let p = bytes.get(pixel_at(uv, [image.width, image.height]) * channels..)?.get(..channels)?;
        let clear = p.get(3).is_some_and(|a| f32::from(*a) / 255.0 < self.coverage_cutoff);
        (!clear).then(|| Vec3::from_array([p[0], p[1], p[2]].map(|v| linear_from_srgb(f32::from(v) / 255.0))))
    }
}

/// Replaces each mesh by three crossed billboards: two quads through +Y, one across it. All share one texture of `side` pixels,
/// straight in alpha, and the returned material `name`; subsets are 0.
/// Own: views along the axes, 4 x 4 samples to a pixel; the alpha cutoff preserves the covered area.
pub fn crossed_billboards(
    meshes: &[Mesh],
    source: SourceMaterials<'_>,
    name: &str,
    side: u32,
) -> (Vec<Mesh>, SurfaceMaterial) {
    // Views per row of the texture: the smallest square that holds them all.
    let across = (1_usize..).find(|n| n * n >= meshes.len() * VIEWS.len()).unwrap_or(1);
    let n = side as usize;
    let pixels = (n / across).max(4 * MARGIN);
    let views: Vec<(&Mesh, BillboardView)> = meshes.iter().flat_map(|m| VIEWS.map(|v| (m, v))).collect();
    // Rasterize all views in parallel; the samples are dropped once they are filtered to texels.
    let drawn: Vec<(MeshRaster, Vec<BillboardTexel>)> = par_map(&views, |(mesh, view)| {
        let mut tile = MeshRaster::new(mesh, *view, pixels);
        tile.draw(mesh, source);
        let texels = tile.texels();
        tile.samples = Vec::new();
        (tile, texels)
    });
    // Copy the views into their squares of the shared texture.
    let mut all = vec![BillboardTexel::default(); n * n];
    let mut quads = vec![Mesh::default(); meshes.len()];
    let share = |k: usize| narrow(k as f64 / n as f64);
    for (k, (tile, texels)) in drawn.iter().enumerate() {
        let corner = (k % across * pixels, k / across * pixels);
        for (i, t) in texels.iter().enumerate() {
            if let Some(slot) = all.get_mut((corner.1 + i / pixels) * n + corner.0 + i % pixels) {
                *slot = *t;
            }
        }
        let corner = Vec2::new(share(corner.0), share(corner.1));
        tile.push_quad(&mut quads[k / VIEWS.len()], corner, share(pixels));
    }
    let surface = billboard_material(all, source, name, side);
    (quads.into_iter().map(|q| q.with_material(0)).collect(), surface)
}

/// The material of all billboards from their texels; empty texels get the mean colour. Translucency and roughness are those of
/// the first material of leaves.
fn billboard_material(
    mut texels: Vec<BillboardTexel>,
    source: SourceMaterials<'_>,
    name: &str,
    side: u32,
) -> SurfaceMaterial {
    // The cutoff depends on alpha alone, so that it can be computed before empty texels take a colour.
    let cut = coverage_cutoff(&texels, SUPERSAMPLING);
    let sum = texels.iter().fold((Vec3::ZERO, 0.0), |s, t| (s.0 + t.color * t.alpha, s.1 + t.alpha));
    let area_mean = sum.0 / sum.1.max(1e-6);
    // Mipmaps average many texels: transparent ones take the mean colour, since black ones would darken the edges.
    for t in texels.iter_mut().filter(|t| t.alpha <= 0.0) {
        (t.color, t.normal) = (area_mean, Vec3::Z);
    }
    let (images, maps) = billboard_images(&texels, name, side);
    let leaf = source.materials.iter().find(|m| m.class == MaterialClass::Leaf);
    let material = Material {
        double_sided: true,
        translucency: leaf.map_or(0.0, |l| l.translucency),
        alpha_cutoff: Some(cut),
        maps,
        ..Material::plain(name.to_owned(), MaterialClass::Leaf, area_mean.to_array(), leaf.map_or(0.6, |l| l.roughness))
    };
    SurfaceMaterial { material, images }
}

#[cfg(test)]
mod tests {
    use super::*;
    use osier_base::units::srgb_byte;
    use osier_scene::{ImageKind, Maps};

    /// A square of side 2 about (0, 1, 0), facing +Z, and as many of them behind it as asked for.
    fn squares(count: u32) -> Mesh {
        let mut all = Mesh::default();
        for k in 0..count {
            let z = -0.1 * narrow(f64::from(k));
            let at = |x: f32, y: f32| Vec3::new(x, y, z);
            let square = Mesh {
                points: vec![at(-1.0, 0.0), at(1.0, 0.0), at(1.0, 2.0), at(-1.0, 2.0)],
                normals: vec![Vec3::Z; 4],
                uvs: vec![Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y],
                triangles: vec![[0, 1, 2], [0, 2, 3]],
                ..Mesh::default()
            };
            all.append(&square.with_material(0));
        }
        all
    }

    fn drawn(mesh: &Mesh, materials: &[Material], images: &[Image]) -> (Vec<Mesh>, SurfaceMaterial) {
        crossed_billboards(std::slice::from_ref(mesh), SourceMaterials { materials, images }, "card", 64)
    }

    fn bytes(image: &Image) -> &[u8] {
        if let Pixels::U8(b) = &image.pixels { b } else { &[] }
    }

    #[test]
    fn quads_stand_where_the_mesh_is_and_show_its_color() {
        let leaf = Material::plain("leaf".into(), MaterialClass::Leaf, [0.1, 0.5, 0.2], 0.5);
        let (quads, made) = drawn(&squares(1), &[leaf], &[]);
        assert_eq!((quads.len(), quads[0].triangles.len(), quads[0].points.len()), (1, 6, 12));
        // The first quad is the square plus a small margin: within its tile of 32 by 32 texels the square covers 26 to 28 a
        // side, in the leaf's colour and with the normal facing the viewer.
        let first = Bounds::of(quads[0].points[..4].iter().copied());
        assert!((first.min - Vec3::new(-1.0, 0.0, 0.0)).abs().max_element() < 0.2, "{first:?}");
        assert!((first.max - Vec3::new(1.0, 2.0, 0.0)).abs().max_element() < 0.2, "{first:?}");
        let tile = |p: &usize| p % 64 < 32 && p / 64 < 32;
        let texel = |p: usize| &bytes(&made.images[0])[4 * p..4 * p + 4];
        let full: Vec<usize> = (0..64 * 64).filter(tile).filter(|p| texel(*p)[3] == 255).collect();
        assert!((26 * 26..=28 * 28).contains(&full.len()), "{}", full.len());
        let want = [0.1, 0.5, 0.2].map(srgb_byte);
        assert!(full.iter().all(|p| texel(*p)[..3] == want), "{want:?}");
        let normal = |p: usize| &bytes(&made.images[1])[3 * p..3 * p + 3];
        assert!(full.iter().all(|p| normal(*p) == [128, 128, 255]));
        // The second looks along the square's plane: hardly anything to see.
        let second = (0..64 * 64).filter(|p| p % 64 >= 32 && p / 64 < 32).filter(|p| texel(*p)[3] > 0).count();
        assert_eq!(second, 0);
    }

    #[test]
    fn many_layers_are_darker() {
        let leaf = Material::plain("leaf".into(), MaterialClass::Leaf, [0.5; 3], 0.5);
        let green = |count: u32| {
            let (_, made) = drawn(&squares(count), std::slice::from_ref(&leaf), &[]);
            linear_from_srgb(f32::from(bytes(&made.images[0])[4 * (16 * 64 + 16) + 1]) / 255.0)
        };
        assert!((green(1) - 0.5).abs() < 0.01);
        assert!((green(8) - 0.5 * math::pow_f32(8.0, -SHADE_EXPONENT)).abs() < 0.01);
    }

    #[test]
    fn what_is_cut_out_of_a_leaf_is_cut_out_of_its_picture() {
        let half: Vec<u8> = (0..16).flat_map(|i| [90, 120, 60, if i % 4 < 2 { 255 } else { 0 }]).collect();
        let pixels = Pixels::U8(half);
        let name = "leaf_color".into();
        let image = Image { name, kind: ImageKind::Color, width: 4, height: 4, channels: 4, pixels };
        let plain = Material::plain("leaf".into(), MaterialClass::Leaf, [0.5; 3], 0.5);
        let maps = Maps { color: Some(0), ..Maps::default() };
        let leaf = Material { maps, alpha_cutoff: Some(0.5), ..plain };
        let (_, made) = drawn(&squares(1), &[leaf], &[image]);
        let alpha = |x: usize, y: usize| bytes(&made.images[0])[4 * (y * 64 + x) + 3];
        assert_eq!((alpha(8, 16), alpha(24, 16)), (255, 0));
    }
}
