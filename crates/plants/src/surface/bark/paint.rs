//! Paints the maps of a bark: colour, normal, roughness, height.

use glam::Vec3;

use super::marks::{Mark, MarkPattern};
use super::relief::{Relief, ReliefPattern};
use super::{BarkGrain, BarkMarks, BarkRelief, BarkSpec};
use crate::surface::material::square_map;
use crate::surface::periodic_noise::{FractalNoise, pixel_centres};
use crate::surface::{SurfaceMaterial, pixels};
use osier_base::Result;
use osier_base::math::{self, smoothstep};
use osier_base::par::par_map;
use osier_base::units::byte;
use osier_scene::{ImageKind, Maps, Material, MaterialClass, Pixels};

/// Weights of the scales of plates in height and tint; they are multiplied by `BarkSpec::scales`.
const SCALE_RELIEF: f32 = 0.5;
const SCALE_TINT: f32 = 0.9;

/// Tabulated noises of a bark; each has a different seed, derived from that of the bark.
struct BarkNoise {
    warp: [FractalNoise; 2],
    relief: ReliefPattern,
    fibre: FractalNoise,
    coarse: FractalNoise,
    tint: FractalNoise,
    patch: FractalNoise,
    marks: MarkPattern,
}

impl BarkNoise {
    fn new(spec: &BarkSpec) -> Self {
        let s = |k: u64| spec.seed.wrapping_mul(64).wrapping_add(k << 3);
        let [nx, ny] = spec.plates;
        Self {
            warp: [FractalNoise::new(s(0), [4, 2], 6), FractalNoise::new(s(1), [4, 2], 6)],
            // Ridges have more noises than fit between two of these seeds.
            relief: ReliefPattern::new(spec, if spec.relief == BarkRelief::Plates { s(2) } else { s(8) }),
            fibre: FractalNoise::new(s(3), [8 * nx, ny], 4),
            coarse: FractalNoise::new(s(4), [6, 6], 5),
            tint: FractalNoise::new(s(5), [3, 3], 4),
            patch: FractalNoise::new(s(6), [2, 2], 5),
            marks: MarkPattern::new(spec.marks, spec.seed),
        }
    }
}

/// One texel before the heights of the map are stretched to [0, 1].
struct BarkTexel {
    height: f32,
    /// Brightness of the tint, share of patches, share of marks.
    tint: f32,
    patch: f32,
    mark: f32,
}

/// Weight of a grain in the height; at 1 it replaces plates and fibres.
const GRAIN_RELIEF: f32 = 0.25;
/// Range of the brightness that a grain adds: 1 - 0.12 to 1 + 0.12.
const GRAIN_TINT: f32 = 0.24;
/// Number of repeats of a grain across a tile; along the tile there is one, which stretches the fibres along the axis.
const GRAIN_REPEATS: f32 = 5.0;

impl BarkTexel {
    fn with_grain(self, value: f32) -> Self {
        let height = math::lerp(self.height, value, GRAIN_RELIEF);
        Self { height, tint: self.tint * (1.0 + GRAIN_TINT * (value - 0.5)), ..self }
    }
}

/// A bark's material with `<name>_color` (sRGB), `_normal`, `_rough` and `_height` (16 bit), all tiling.
/// # Errors
/// `Range` for a value outside its range.
/// Own: warp, plates, fibre, height, cracks, colour, roughness, normal, in this order; heights are stretched to fill
/// [0, 1]; patches and marks are added on top. A grain takes a quarter of the height and tints.
pub fn bark(spec: &BarkSpec, grain: Option<&BarkGrain>, name: &str) -> Result<SurfaceMaterial> {
    spec.check()?;
    let tables = BarkNoise::new(spec);
    let side = spec.side as usize;
    let rows: Vec<usize> = (0..side).collect();
    // Height, tint, patches and marks of every texel; then stretch the heights to [0, 1]; then compute normals, colours
    // and roughness.
    let samples = par_map(&rows, |&row| sample_row(spec, &tables, grain, row));
    let heights = normalized_heights(&samples);
    // Slope of one height unit over one texel, for normals in metres.
    let step = spec.depth / (spec.tile / spec.side as f32);
    let normals = pixels::normal_map(&heights, side, [step, step]);
    let painted = par_map(&rows, |&row| paint_row(spec, &samples[row], &heights[row * side..(row + 1) * side]));
    let (color, rough): (Vec<Vec<u8>>, Vec<Vec<u8>>) = painted.into_iter().unzip();
    let (color, rough) = (pixels::concatenated(color), pixels::concatenated(rough));
    let image = |kind, what, pixels| square_map(name, what, kind, spec.side, pixels);
    let images = vec![
        image(ImageKind::Color, "color", Pixels::U8(color)),
        image(ImageKind::Data, "normal", Pixels::U8(normals)),
        image(ImageKind::Data, "rough", Pixels::U8(rough)),
        image(ImageKind::Data, "height", Pixels::U16(heights.iter().map(|h| pixels::unorm16(*h)).collect())),
    ];
    let material = Material {
        name: name.to_owned(),
        class: MaterialClass::Bark,
        base_color: spec.ridge,
        roughness: spec.roughness[1],
        ior: 1.5,
        translucency: 0.0,
        double_sided: false,
        alpha_cutoff: None,
        height_range: spec.depth,
        tile: spec.tile,
        maps: Maps { color: Some(0), normal: Some(1), roughness: Some(2), height: Some(3) },
        coat: None,
    };
    Ok(SurfaceMaterial { material, images })
}

/// The texels of a row, with the grain laid over them.
fn sample_row(spec: &BarkSpec, t: &BarkNoise, grain: Option<&BarkGrain>, row: usize) -> Vec<BarkTexel> {
    let xs = pixel_centres(spec.side);
    let y = 1.0 - (row as f32 + 0.5) / spec.side as f32;
    let [a, b] = [&t.warp[0], &t.warp[1]].map(|noise| noise.row(&xs, y));
    let [coarse, tint, patch] = [&t.coarse, &t.tint, &t.patch].map(|noise| noise.row(&xs, y));
    let unwarped = |i: usize| BarkNoiseSample { warp: [a[i], b[i]], coarse: coarse[i], tint: tint[i], patch: patch[i] };
    let places: Vec<[f32; 2]> =
        xs.iter().enumerate().map(|(i, x)| displaced(spec, [*x, y], unwarped(i).warp)).collect();
    let displaced = DisplacedRow {
        reliefs: t.relief.row(&xs, y, &places, spec.gap),
        fibres: t.fibre.at_places(&places),
        marks: t.marks.at_places(&places),
    };
    let one = |(i, x): (usize, &f32)| {
        let base = sample(spec, &displaced, i, &unwarped(i));
        let at = |g: &BarkGrain| g.at(GRAIN_REPEATS * x + 0.05 * unwarped(i).warp[0], y + 0.12 * unwarped(i).warp[1]);
        match grain {
            Some(g) => base.with_grain(at(g)),
            None => base,
        }
    };
    xs.iter().enumerate().map(one).collect()
}

/// What is looked up for a row of texels at their displaced places.
struct DisplacedRow {
    reliefs: Vec<Relief>,
    fibres: Vec<f32>,
    marks: Vec<Mark>,
}

/// Values of the noises that are evaluated at the texel itself, without the warp.
struct BarkNoiseSample {
    warp: [f32; 2],
    coarse: f32,
    tint: f32,
    patch: f32,
}

/// Domain warping: where relief, fibres and marks of the texel at (x, y) of the unit square are looked up.
fn displaced(spec: &BarkSpec, [x, y]: [f32; 2], warp: [f32; 2]) -> [f32; 2] {
    [x + spec.warp[0] * warp[0], y + spec.warp[1] * warp[1]]
}

/// Height, tint, patch and mark of texel `i` of a row.
fn sample(spec: &BarkSpec, row: &DisplacedRow, i: usize, unwarped: &BarkNoiseSample) -> BarkTexel {
    let (Relief { ground, scale }, fibre, mark) = (row.reliefs[i], row.fibres[i], row.marks[i]);
    let coarse = unwarped.coarse;
    let [k1, k2, k3] = spec.weights;
    // Weighted sum; the power 0.6 flattens the tops of the plates.
    let height = k1 * power_06(ground) + k2 * (0.5 + 0.5 * fibre) + k3 * (0.5 + 0.5 * coarse);
    // Scales lie on plates, not in the cracks.
    let scale = spec.scales * scale;
    let height = height + SCALE_RELIEF * scale * ground;
    // Without plates there is nothing to crack.
    let cracked = if k1 > 0.0 { math::lerp(1.0, 0.25 + 0.75 * ground, (k1 * 4.0).min(1.0)) } else { 1.0 };
    // Cracks across go through ridges and end at furrows.
    let cut = if spec.marks == BarkMarks::Cracks && spec.relief == BarkRelief::Ridges { ground } else { 1.0 };
    // Lichen and weathering where a coarse noise exceeds a threshold.
    let patch = smoothstep(0.05, 0.45, unwarped.patch) * spec.patch.1;
    BarkTexel {
        height: height * cracked + 0.4 * mark.height * cut,
        tint: 1.0 + 0.25 * unwarped.tint + 0.10 * fibre + SCALE_TINT * scale,
        patch,
        mark: mark.color * cut,
    }
}

/// x^0.6 on [0, 1], with an error of at most 0.024.
fn power_06(x: f32) -> f32 {
    // sqrt(x) and x bracket x^0.6; their blend by 0.8 and 0.2 is close enough and needs no pow.
    let r = x.sqrt();
    r * (0.8 + 0.2 * r)
}

/// Heights row by row, scaled to [0, 1].
fn normalized_heights(samples: &[Vec<BarkTexel>]) -> Vec<f32> {
    let all = || samples.iter().flatten().map(|s| s.height);
    let (low, high) = all().fold((f32::MAX, f32::MIN), |(a, b), h| (a.min(h), b.max(h)));
    let scale = 1.0 / (high - low).max(1e-9);
    all().map(|h| ((h - low) * scale).clamp(0.0, 1.0)).collect()
}

/// sRGB bytes of the colours (3 a texel) and bytes of the roughness of a row, from its texels and stretched heights.
fn paint_row(spec: &BarkSpec, samples: &[BarkTexel], heights: &[f32]) -> (Vec<u8>, Vec<u8>) {
    let [crack, ridge, patch, mark] = [spec.crack, spec.ridge, spec.patch.0, spec.mark].map(Vec3::from_array);
    let mut color = Vec::with_capacity(samples.len() * 3);
    let mut rough = Vec::with_capacity(samples.len());
    for (s, h) in samples.iter().zip(heights) {
        // Colour from crack to ridge by height, patches mostly on the ridges, marks on top.
        let base = crack.lerp(ridge, *h);
        let c = (base.lerp(patch, s.patch * (0.4 + 0.6 * h)) * s.tint).lerp(mark, s.mark);
        color.extend(pixels::srgb_bytes(c));
        rough.push(byte(math::lerp(spec.roughness[0], spec.roughness[1], *h) + 0.1 * s.mark));
    }
    (color, rough)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn all() -> Vec<(&'static str, BarkSpec)> {
        vec![
            ("furrowed", BarkSpec::furrowed()),
            ("ridged", BarkSpec::ridged()),
            ("scarred", BarkSpec::scarred()),
            ("plated", BarkSpec::plated()),
            ("stringy", BarkSpec::stringy()),
            ("smooth", BarkSpec::smooth()),
            ("birch", BarkSpec::birch()),
            ("poplar", BarkSpec::poplar()),
            ("shoot", BarkSpec::shoot()),
            ("culm", BarkSpec::culm()),
        ]
    }

    /// A sample anywhere, all noises point by point.
    fn point(spec: &BarkSpec, t: &BarkNoise, x: f32, y: f32) -> BarkTexel {
        let at = |noise: &FractalNoise| noise.at_places(&[[x, y]])[0];
        let [coarse, tint, patch] = [&t.coarse, &t.tint, &t.patch].map(at);
        let warp = [at(&t.warp[0]), at(&t.warp[1])];
        let place = [displaced(spec, [x, y], warp)];
        let row = DisplacedRow {
            reliefs: t.relief.row(&[x], y, &place, spec.gap),
            fibres: t.fibre.at_places(&place),
            marks: t.marks.at_places(&place),
        };
        sample(spec, &row, 0, &BarkNoiseSample { warp, coarse, tint, patch })
    }

    #[test]
    fn maps_tile_and_heights_fill_their_range() {
        for (name, spec) in all() {
            let t = BarkNoise::new(&spec);
            for i in 0..64 {
                let v = i as f32 / 64.0;
                for ((x0, y0), (x1, y1)) in [((0.0, v), (1.0, v)), ((v, 0.0), (v, 1.0))] {
                    let (a, b) = (point(&spec, &t, x0, y0), point(&spec, &t, x1, y1));
                    let d = (a.height - b.height).abs().max((a.tint - b.tint).abs()).max((a.mark - b.mark).abs());
                    assert!(d < 1.0 / 255.0, "{name}: {d} at {v}");
                }
            }
            let set = bark(&BarkSpec { side: 256, ..spec }, None, name).expect("maps");
            assert_eq!(set.images.len(), 4);
            let Pixels::U16(h) = &set.images[3].pixels else { panic!("16 bit") };
            let (low, high) = (h.iter().min().expect("some"), h.iter().max().expect("some"));
            assert!(high - low > 52_428, "{name}: {low}..{high}");
            let mut sorted = h.clone();
            sorted.sort_unstable();
            let (a, b) = (sorted[h.len() / 50], sorted[h.len() - h.len() / 50]);
            assert!(b - a > 16_000, "{name}: nearly all heights between {a} and {b}");
        }
    }

    #[test]
    fn a_grain_repeats_and_shows_in_height_and_tint() {
        let grain = BarkGrain { side: 2, values: vec![0.0, 1.0, 1.0, 0.0] };
        assert!((grain.at(0.25, 0.75) - 0.0).abs() < 1e-6 && (grain.at(0.75, 0.75) - 1.0).abs() < 1e-6);
        assert!((grain.at(0.1, 0.3) - grain.at(1.1, -0.7)).abs() < 1e-5);
        let grain = BarkGrain { side: 2, values: vec![0.0, 0.0, 1.0, 1.0] };
        let spec = BarkSpec { side: 64, ..BarkSpec::culm() };
        let lower_half = |grain: Option<&BarkGrain>| {
            let set = bark(&spec, grain, "x").expect("maps");
            let Pixels::U16(h) = &set.images[3].pixels else { panic!("16 bit") };
            let sum = |half: &[u16]| half.iter().map(|h| f64::from(*h)).sum::<f64>();
            (sum(&h[2048..]) - sum(&h[..2048])) / 2048.0
        };
        let (with, without) = (lower_half(Some(&grain)), lower_half(None));
        assert!(with > without + 5000.0, "{with} {without}");
    }

    #[test]
    fn registering_moves_the_maps() {
        let spec = BarkSpec { side: 16, ..BarkSpec::shoot() };
        let (mut images, mut materials) = (Vec::new(), Vec::new());
        bark(&spec, None, "a").expect("a").register(&mut images, &mut materials);
        assert_eq!(bark(&spec, None, "b").expect("b").register(&mut images, &mut materials), 1);
        assert_eq!((images.len(), materials[1].maps.color, materials[1].maps.height), (8, Some(4), Some(7)));
        assert_eq!(images[4].name, "b_color");
    }

    #[test]
    fn values_out_of_range_are_named() {
        let e = bark(&BarkSpec { side: 1000, ..BarkSpec::birch() }, None, "x").expect_err("no power of two");
        assert!(e.to_string().contains("power of two"), "{e}");
        assert!(bark(&BarkSpec { gap: 0.0, ..BarkSpec::birch() }, None, "x").is_err());
    }
}
