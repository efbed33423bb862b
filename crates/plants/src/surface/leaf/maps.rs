//! Colour, relief and roughness of a blade, drawn in its own coordinates so that veins end in lobes and teeth.

use glam::{Vec2, Vec3};

use super::BladeSpec;
use super::outline::{BladeHalf, BladeOutline, Vein};
use crate::surface::periodic_noise::{CellularNoise, FractalNoise, NearestFeature};
use crate::surface::pixels::MaterialTexel;
use crate::surface::{SurfaceMaterial, pixels};
use osier_base::math;
use osier_base::par::par_map;
use osier_base::rng::Rng;
use osier_base::{Error, Result};
use osier_scene::{Image, ImageKind, Maps, Material, MaterialClass, Pixels};

/// Linear colours of the maps of a leaf, and their roughness.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LeafColors {
    /// Blade, in its darker and lighter patches.
    pub blade: [[f32; 3]; 2],
    /// Midrib and side veins.
    pub vein: [f32; 3],
    /// Colour along the margin and in small blemishes.
    pub edge: [f32; 3],
    /// Roughness of the blade between veins, 0..1; veins are rougher.
    pub roughness: f32,
}

impl LeafColors {
    /// Deep green, glossy.
    pub const OAK: Self = Self {
        blade: [[0.040, 0.088, 0.014], [0.075, 0.140, 0.022]],
        vein: [0.230, 0.290, 0.085],
        edge: [0.150, 0.150, 0.035],
        roughness: 0.42,
    };
    /// Fresh light green, less glossy.
    pub const BIRCH: Self = Self {
        blade: [[0.066, 0.140, 0.018], [0.120, 0.215, 0.028]],
        vein: [0.290, 0.360, 0.100],
        edge: [0.200, 0.190, 0.040],
        roughness: 0.48,
    };
    /// White petals, matt, with veins hardly darker.
    pub const PETAL: Self = Self {
        blade: [[0.780, 0.780, 0.760], [0.880, 0.880, 0.870]],
        vein: [0.740, 0.740, 0.700],
        edge: [0.820, 0.820, 0.800],
        roughness: 0.62,
    };
    /// Shiny mid green with pale veins.
    pub const POPLAR: Self = Self {
        blade: [[0.050, 0.118, 0.020], [0.096, 0.178, 0.032]],
        vein: [0.330, 0.370, 0.140],
        edge: [0.190, 0.200, 0.060],
        roughness: 0.38,
    };
}

/// Width of the swelling beside the veins in the maps, share of the blade's length; distances are computed up to it.
const SHOULDER: f32 = 0.05;
/// Height range of the relief, share of the blade's length; larger values make the veins stand out in grazing light.
const RELIEF: f32 = 0.004;

/// Distances on the flat blade, one per pixel, m.
struct VeinDistances {
    /// Distance to the edge of the midrib and side veins, negative within them.
    main: Vec<f32>,
    /// Distance to the branches of the side veins.
    branch: Vec<f32>,
    /// Distance to the veins between the side veins.
    fine: Vec<f32>,
    /// Distance to the margin of the blade.
    margin: Vec<f32>,
}

/// A blade's material with `<name>_color`, `<name>_normal` and `<name>_rough`, square, `side` pixels (16..=4096). Needs no
/// alpha: the outline is geometry. `relief`: also `<name>_height`, 16 bit, for programs that take no normals.
/// # Errors
/// `Range` for a value of the blade or a side outside its range.
/// Own: veins as curves with tapered width, a network of cells between them, both as colour and as relief.
pub fn leaf_material(
    spec: &BladeSpec,
    colors: &LeafColors,
    name: &str,
    side: u32,
    relief: bool,
) -> Result<SurfaceMaterial> {
    spec.check()?;
    if !(16..=4096).contains(&side) {
        let name = "leaf: side of the maps".to_owned();
        return Err(Error::Range { name, value: side.into(), min: 16.0, max: 4096.0, unit: "pixels" });
    }
    // Distances to veins and margin on the texture's grid, then colour, height and roughness of each texel from them.
    let outline = BladeOutline::new(spec, 6, true);
    let grid = BladeRaster { outline: &outline, side: side as usize };
    let (distances, noise) = (vein_distances(spec, &outline, &grid), LeafNoise::new(spec.seed));
    let painter = LeafPainter { spec, colors, grid: &grid, distances: &distances, noise: &noise };
    let rows: Vec<usize> = (0..grid.side).collect();
    let texels = pixels::concatenated(par_map(&rows, |&y| painter.row(y)));
    let pixel = [outline.frame.1.x / side as f32, outline.frame.1.y / side as f32];
    let scale = RELIEF * spec.length;
    let images = pixels::surface_images(name, side, &texels, [scale / pixel[0], scale / pixel[1]], relief);
    let material = Material {
        name: name.to_owned(),
        class: MaterialClass::Leaf,
        base_color: colors.blade[1],
        roughness: colors.roughness,
        ior: 1.5,
        translucency: 0.3,
        double_sided: true,
        alpha_cutoff: None,
        height_range: scale,
        tile: spec.length,
        maps: Maps { color: Some(0), normal: Some(1), roughness: Some(2), height: relief.then_some(3) },
        coat: None,
    };
    Ok(SurfaceMaterial { material, images })
}

/// Maps `<name>_color` of the same blade in other colours, one for each entry of `colors`: name and colours. `side` is not
/// checked.
/// # Errors
/// `Range` for a value of the blade outside its range.
pub fn leaf_color_maps(spec: &BladeSpec, colors: &[(String, LeafColors)], side: u32) -> Result<Vec<Image>> {
    spec.check()?;
    let outline = BladeOutline::new(spec, 6, true);
    let grid = BladeRaster { outline: &outline, side: side as usize };
    let (distances, noise) = (vein_distances(spec, &outline, &grid), LeafNoise::new(spec.seed));
    let rows: Vec<usize> = (0..grid.side).collect();
    let map = |(name, colors): &(String, LeafColors)| {
        let painter = LeafPainter { spec, colors, grid: &grid, distances: &distances, noise: &noise };
        let texels = pixels::concatenated(par_map(&rows, |&y| painter.row(y)));
        Image {
            name: format!("{name}_color"),
            kind: ImageKind::Color,
            width: side,
            height: side,
            channels: 3,
            pixels: Pixels::U8(pixels::srgb_image(texels.iter().map(|t| t.color))),
        }
    };
    Ok(colors.iter().map(map).collect())
}

/// Pixels over the frame of an outline; row 0 is the top.
struct BladeRaster<'a> {
    outline: &'a BladeOutline,
    side: usize,
}

impl BladeRaster<'_> {
    /// Centre of a pixel on the flat blade, m.
    fn position(&self, x: usize, y: usize) -> Vec2 {
        let n = self.side as f32;
        let uv = Vec2::new((x as f32 + 0.5) / n, 1.0 - (y as f32 + 0.5) / n);
        self.outline.frame.0 + uv * self.outline.frame.1
    }

    /// Lowers `field` to the distance from the segment from `a` to `b` minus `half` (half widths at both ends), within
    /// `reach`, all in m.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the picture")]
    fn stroke(&self, field: &mut [f32], a: Vec2, b: Vec2, half: [f32; 2], reach: f32) {
        let n = self.side as f32;
        // Visit the pixels of the stroke's bounding box only.
        let pad = Vec2::splat(reach + half[0].max(half[1]));
        let low = (a.min(b) - pad - self.outline.frame.0) / self.outline.frame.1 * n;
        let high = (a.max(b) + pad - self.outline.frame.0) / self.outline.frame.1 * n;
        let cut = |v: f32| v.clamp(0.0, n) as usize;
        let d = b - a;
        let d2 = d.length_squared().max(1e-18);
        for y in cut(n - high.y)..cut(n - low.y + 1.0) {
            for x in cut(low.x)..cut(high.x + 1.0) {
                let p = self.position(x, y) - a;
                // Distance to the segment minus the interpolated half width: the signed distance of a tapered stroke.
                let t = (p.dot(d) / d2).clamp(0.0, 1.0);
                let distance = (p - d * t).length() - math::lerp(half[0], half[1], t);
                let cell = &mut field[y * self.side + x];
                *cell = cell.min(distance);
            }
        }
    }
}

/// Rasterizes the distances to all veins and to the margin.
fn vein_distances(spec: &BladeSpec, outline: &BladeOutline, grid: &BladeRaster<'_>) -> VeinDistances {
    // Distance fields, initialized to the largest distance that any map uses.
    let far = spec.length * SHOULDER;
    let blank = || vec![far; grid.side * grid.side];
    let mut f = VeinDistances { main: blank(), branch: blank(), fine: blank(), margin: blank() };
    let unit = spec.length * 0.0075;
    // The midrib, tapering to a tenth of its width, then side veins, their branches, and the margin.
    let steps = 16_u32;
    for k in 0..steps {
        let y = |k: u32| Vec2::new(0.0, spec.length * k as f32 / steps as f32);
        let half = |k: u32| unit * (1.0 - 0.9 * k as f32 / steps as f32);
        grid.stroke(&mut f.main, y(k), y(k + 1), [half(k), half(k + 1)], far);
    }
    for half in &outline.halves {
        for vein in &half.veins {
            stroke_curve(grid, &mut f.main, |t| vein.point(t), [unit * 0.42, unit * 0.1], far);
        }
        stroke_fine_veins(spec, grid, &mut f, half, unit);
        for w in half.margin.windows(2) {
            grid.stroke(&mut f.margin, w[0], w[1], [0.0; 2], spec.length * 0.03);
        }
    }
    f
}

/// Rasterizes the distance to the curve `at(0..1)` as ten segments; `width`: half widths at its ends, m.
fn stroke_curve(grid: &BladeRaster<'_>, field: &mut [f32], at: impl Fn(f32) -> Vec2, width: [f32; 2], reach: f32) {
    let n = 10_u8;
    for k in 0..n {
        let (t, u) = (f32::from(k) / f32::from(n), f32::from(k + 1) / f32::from(n));
        let width = [math::lerp(width[0], width[1], t), math::lerp(width[0], width[1], u)];
        grid.stroke(field, at(t), at(u), width, reach);
    }
}

/// Branches of the side veins towards the margin, and bridges from each side vein to the next.
fn stroke_fine_veins(spec: &BladeSpec, grid: &BladeRaster<'_>, f: &mut VeinDistances, half: &BladeHalf, unit: f32) {
    let mut draw = Rng::at(spec.seed, &["veins".into(), half.veins.len().into()]);
    let reach = spec.length * 0.012;
    let last = half.margin.len() - 1;
    for (i, vein) in half.veins.iter().enumerate() {
        let next: Option<&Vein> = half.veins.get(i + 1);
        let before = if i > 0 { half.veins[i - 1].at } else { 0 };
        let after = next.map_or(last, |n| n.at);
        // Two branches to each side, leaving at 45 % and 68 % of the vein, as quadratic Bezier curves. They stay in the half of
        // the gap beside their vein; the branch that leaves first extends farthest.
        for (from, share) in [(0.45, 0.46), (0.68_f32, 0.26_f32)] {
            let a = vein.point(from);
            for goal in [after, before] {
                let end = a.lerp(margin_point(&half.margin, vein.at, goal, share), 0.9);
                let bend = a.lerp(end, 0.5).lerp(vein.point(0.9), 0.35);
                let q = |t: f32| a * ((1.0 - t) * (1.0 - t)) + bend * (2.0 * t * (1.0 - t)) + end * (t * t);
                stroke_curve(grid, &mut f.branch, q, [unit * 0.16, unit * 0.03], reach);
            }
        }
        // Tertiary veins: bridges to the next side vein at irregular distances; beyond the last vein they run towards
        // the midrib.
        let bridges = 7_u8;
        for k in 1..bridges {
            let t = (f32::from(k) + math::narrow(draw.range(-0.25, 0.25))) / f32::from(bridges);
            let a = vein.point(t);
            let b =
                next.map_or(Vec2::new(0.0, math::lerp(vein.root.y, spec.length, 0.5 + 0.4 * t)), |n| n.point(t * 0.92));
            let middle = a.lerp(b, 0.5) + (vein.tip - vein.root) * math::narrow(draw.range(-0.02, 0.06));
            let q = |t: f32| a * ((1.0 - t) * (1.0 - t)) + middle * (2.0 * t * (1.0 - t)) + b * (t * t);
            stroke_curve(grid, &mut f.fine, q, [unit * 0.06, unit * 0.06], reach);
        }
    }
}

/// The point of a margin between the points of indices `from` and `to`, at a share of the index difference.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "within the margin")]
fn margin_point(margin: &[Vec2], from: usize, to: usize, share: f32) -> Vec2 {
    let at = math::lerp(from as f32, to as f32, share);
    let k = (at as usize).min(margin.len().saturating_sub(2));
    margin[k].lerp(margin[k + 1], at - k as f32)
}

/// The noises of a blade, in units of its length.
struct LeafNoise {
    patch: FractalNoise,
    grain: FractalNoise,
    net: CellularNoise,
    spots: CellularNoise,
}

impl LeafNoise {
    fn new(seed: u64) -> Self {
        Self {
            patch: FractalNoise::new(seed ^ 0x5EAF00, [7, 7], 3),
            grain: FractalNoise::new(seed ^ 0x6EA100, [150, 150], 1),
            net: CellularNoise::new(seed ^ 0x7E700, [55, 55], 0.9),
            spots: CellularNoise::new(seed ^ 0x590700, [16, 16], 0.9),
        }
    }
}

/// Values of the noises of a blade at a texel.
struct LeafNoiseSample {
    patch: f32,
    grain: f32,
    net: NearestFeature,
    spot: NearestFeature,
}

/// Inputs from which the texels of a leaf's maps are computed, shared by all rows.
struct LeafPainter<'a> {
    spec: &'a BladeSpec,
    colors: &'a LeafColors,
    grid: &'a BladeRaster<'a>,
    distances: &'a VeinDistances,
    noise: &'a LeafNoise,
}

impl LeafPainter<'_> {
    fn row(&self, y: usize) -> Vec<MaterialTexel> {
        let places: Vec<Vec2> = (0..self.grid.side).map(|x| self.grid.position(x, y) / self.spec.length).collect();
        let xs: Vec<f32> = places.iter().map(|q| q.x).collect();
        let v = places.first().map_or(0.0, |q| q.y);
        // Noises are evaluated row by row, which is several times faster than point by point.
        let (patch, grain) = (self.noise.patch.row(&xs, v), self.noise.grain.row(&xs, v));
        let places: Vec<[f32; 2]> = places.iter().map(|q| [q.x, q.y]).collect();
        let (net, spots) = (self.noise.net.at_places(&places), self.noise.spots.at_places(&places));
        let sample = |x: usize| LeafNoiseSample { patch: patch[x], grain: grain[x], net: net[x], spot: spots[x] };
        (0..self.grid.side).map(|x| self.texel(&sample(x), y * self.grid.side + x)).collect()
    }

    /// The texel with index `i`, from the noises at its place.
    fn texel(&self, noise: &LeafNoiseSample, i: usize) -> MaterialTexel {
        let LeafNoiseSample { patch, grain, net, spot } = *noise;
        let (colors, l) = (self.colors, self.spec.length);
        // Masks, 1 on the feature: the network of cells, branches, midrib and side veins, fine veins, margin.
        let mesh = 1.0 - math::smoothstep(0.0, 0.16, net.f2 - net.f1);
        let (main, fine, margin) = (self.distances.main[i], self.distances.fine[i], self.distances.margin[i]);
        let branch = 1.0 - math::smoothstep(-0.0006 * l, 0.0012 * l, self.distances.branch[i]);
        let vein = 1.0 - math::smoothstep(-0.0006 * l, 0.0015 * l, main);
        let bridge = 1.0 - math::smoothstep(0.0, 0.0028 * l, fine);
        let glow = 1.0 - math::smoothstep(0.0, 0.03 * l, main.max(0.0));
        let edge = 1.0 - math::smoothstep(0.0, 0.012 * l, margin);

        // Colour: patches of two greens, lighter near the veins, then network, margin, blemishes and veins on top.
        let [dark, light] = colors.blade.map(Vec3::from_array);
        let (vein_color, edge_color) = (Vec3::from_array(colors.vein), Vec3::from_array(colors.edge));
        let tone = (0.42 + 0.5 * patch + 0.10 * grain + 0.32 * glow * glow).clamp(0.0, 1.0);
        let mut color = dark.lerp(light, tone);
        color = color.lerp(vein_color, 0.10 * mesh + 0.20 * bridge * (1.0 - 0.5 * mesh));
        color = color.lerp(edge_color, 0.40 * edge * edge);
        // Blemishes: brown spots in one of 23 cells of the spot noise.
        if spot.id.is_multiple_of(23) {
            color = color.lerp(edge_color * 0.7, 0.75 * (1.0 - math::smoothstep(0.05, 0.13, spot.f1)));
        }
        color = color.lerp(vein_color, (0.85 * vein).max(0.45 * branch));

        // Between veins the blade swells; veins lie in grooves, the midrib itself is a ridge in its groove.
        let swell = math::smoothstep(0.0, SHOULDER, main.max(0.0) / l).sqrt();
        let (groove, fold) =
            (math::smoothstep(0.0, 0.012, self.distances.branch[i] / l), math::smoothstep(0.0, 0.010, fine / l));
        let height = 0.58 * swell + 0.08 * groove + 0.12 * fold + 0.06 * (1.0 - mesh) + 0.03 * grain + 0.16 * vein;
        let rough = colors.roughness + 0.14 * vein + 0.06 * mesh + 0.06 * patch + 0.05 * grain;
        MaterialTexel { color, height, rough: rough.clamp(0.05, 1.0) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "pixels within the picture")]
    fn maps_show_lighter_veins_on_a_finite_blade() {
        let spec = BladeSpec::oak();
        let set = leaf_material(&spec, &LeafColors::OAK, "oak_leaf", 512, true).expect("maps");
        let [color, normal, rough, height] = set.images.as_slice() else { panic!("four maps") };
        assert_eq!((color.name.as_str(), normal.name.as_str()), ("oak_leaf_color", "oak_leaf_normal"));
        let (Pixels::U8(c), Pixels::U8(n), Pixels::U8(r)) = (&color.pixels, &normal.pixels, &rough.pixels) else {
            panic!("8 bits each")
        };
        assert_eq!((c.len(), n.len(), r.len()), (512 * 512 * 3, 512 * 512 * 3, 512 * 512));
        // Where it is steep by its normals, so it is by its heights.
        let Pixels::U16(h) = &height.pixels else { panic!("16 bits") };
        let steps = |x: usize, y: usize| f32::from(h[y * 512 + x + 1]) - f32::from(h[y * 512 + x - 1]);
        let leans = |x: usize, y: usize| 127.5 - f32::from(n[(y * 512 + x) * 3]);
        let both = (100..400).flat_map(|y| (100..400).map(move |x| (x, y))).map(|(x, y)| (steps(x, y), leans(x, y)));
        let [up, slope, mix] = both.fold([0.0_f64; 3], |s, (a, b)| {
            let (a, b) = (f64::from(a), f64::from(b));
            [s[0] + a * a, s[1] + b * b, s[2] + a * b]
        });
        assert!(mix / (up * slope).sqrt() > 0.95, "{}", mix / (up * slope).sqrt());
        let outline = BladeOutline::new(&spec, 6, true);
        let green = |p: Vec2| {
            let uv = outline.uv(p);
            let (x, y) = ((uv.x * 512.0) as usize, ((1.0 - uv.y) * 512.0) as usize);
            f32::from(c[(y * 512 + x) * 3 + 1])
        };
        for vein in &outline.halves[0].veins[1..4] {
            let (on, off) = (vein.point(0.3), vein.point(0.3) + Vec2::new(0.0, 0.006));
            assert!(green(on) > green(off) + 10.0, "{} on the vein, {} beside", green(on), green(off));
        }
        assert!(leaf_material(&spec, &LeafColors::OAK, "x", 8, false).is_err());
    }
}
