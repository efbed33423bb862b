//! The material of a terrain: grass on gentle slopes, earth where it is worn, rock where it is steep.

use glam::Vec3;

use super::super::periodic_noise::{FractalNoise, pixel_centres};
use super::super::pixels::MaterialTexel;
use super::super::{SurfaceMaterial, pixels};
use super::Terrain;
use osier_base::math::smoothstep;
use osier_base::par::par_map;
use osier_base::{Error, Result};
use osier_scene::{Maps, Material, MaterialClass};

/// Linear colours of earth, grass and rock, and the parameters that decide which of them is on the surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TerrainColors {
    /// Colour of earth where neither grass nor rock covers it.
    pub earth: [f32; 3],
    /// Colour of grass between its dry and lush parts.
    pub grass: [f32; 3],
    /// Colour of rock on slopes beyond `steep`.
    pub rock: [f32; 3],
    /// Share of gentle slopes that grass covers, 0..1; the rest is earth.
    pub cover: f32,
    /// Slope at which grass gives way to rock, rad.
    pub steep: f32,
}

impl Default for TerrainColors {
    fn default() -> Self {
        Self {
            earth: [0.105, 0.074, 0.045],
            grass: [0.075, 0.110, 0.026],
            rock: [0.185, 0.170, 0.150],
            cover: 0.9,
            steep: 0.65,
        }
    }
}

/// Wavelength of the first octave, m, and number of octaves of each pattern: lush and dry meadow, worn ground, tufts of grass,
/// strata of rock. Chosen by eye at 50 to 200 m.
const MEADOW: (f32, u32) = (70.0, 4);
const WORN: (f32, u32) = (17.0, 5);
const TUFTS: (f32, u32) = (2.2, 4);
const STRATA: (f32, u32) = (6.0, 5);
/// Height range of the painted relief, m; only normals show it.
const RELIEF: f32 = 0.35;
/// Binomial passes that give the smoothed land, from which crests and hollows are measured; more passes find broader ones.
const SMOOTHING_PASSES: u32 = 24;

/// Tabulated noises of the patterns; one period is the whole terrain.
struct TerrainNoise {
    meadow: FractalNoise,
    worn: FractalNoise,
    tufts: FractalNoise,
    strata: FractalNoise,
}

/// The land's material with `<name>_color`, `_normal` and `_rough`: one map over all of it, `side` pixels
/// (16..=4096).
/// # Errors
/// `Range` for a side outside its range.
/// Own: grass in lush and dry parts, worn to earth in patches and on crests, rock from `steep` on, all borders broken by
/// noise; hollows are greener than crests.
pub fn terrain_material(
    land: &Terrain,
    colors: &TerrainColors,
    name: &str,
    side: u32,
    seed: u64,
) -> Result<SurfaceMaterial> {
    if !(16..=4096).contains(&side) {
        let name = "terrain: side of the map".to_owned();
        return Err(Error::Range { name, value: side.into(), min: 16.0, max: 4096.0, unit: "pixels" });
    }
    let patterns = TerrainNoise::new(land.size, side, seed);
    // Slope and relative height decide the layers; noises break their borders.
    let ground = TerrainShape::new(land);
    let (xs, n) = (pixel_centres(side), side as f32);
    let rows: Vec<u32> = (0..side).collect();
    let texels = pixels::concatenated(par_map(&rows, |&y| {
        let down = (y as f32 + 0.5) / n;
        let all = [&patterns.meadow, &patterns.worn, &patterns.tufts, &patterns.strata];
        let [meadow, worn, tufts, strata] = all.map(|p| p.row(&xs, down));
        let one = |i: usize| sample(colors, ground.at(xs[i], down), [meadow[i], worn[i], tufts[i], strata[i]]);
        (0..xs.len()).map(one).collect()
    }));
    let steps = land.size.map(|length| RELIEF / (length / n));
    let images = pixels::surface_images(name, side, &texels, steps, false);
    let material = Material {
        name: name.to_owned(),
        class: MaterialClass::Ground,
        base_color: colors.grass,
        roughness: 0.95,
        ior: 1.5,
        translucency: 0.0,
        double_sided: false,
        alpha_cutoff: None,
        height_range: RELIEF,
        tile: land.size[0],
        maps: Maps { color: Some(0), normal: Some(1), roughness: Some(2), height: None },
        coat: None,
    };
    Ok(SurfaceMaterial { material, images })
}

impl TerrainNoise {
    /// Wavelengths are in metres, independent of the size of the terrain, but at least two pixels of the map.
    fn new(size: [f32; 2], side: u32, seed: u64) -> Self {
        let most = (side / 2).max(1);
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the side of a map")]
        let fractal = |k: u64, (length, octaves): (f32, u32)| {
            // At most one lattice cell per two pixels (Nyquist), and as many octaves as fit below that.
            let cells = size.map(|size| (size / length).round().clamp(1.0, most as f32) as u32);
            FractalNoise::new(
                seed.wrapping_mul(64).wrapping_add(k << 3),
                cells,
                octaves.min((most / cells[0].max(cells[1])).ilog2() + 1),
            )
        };
        Self {
            meadow: fractal(0, MEADOW),
            worn: fractal(1, WORN),
            tufts: fractal(2, TUFTS),
            strata: fractal(3, STRATA),
        }
    }
}

/// Slope of the terrain and its height above the smoothed terrain, bilinear between the samples.
struct TerrainShape {
    counts: [usize; 2],
    /// Slope, rad, and height above the smoothed land, m, at each height.
    cells: Vec<[f32; 2]>,
}

impl TerrainShape {
    /// Slopes by central differences; relative heights are measured from a copy smoothed [`SMOOTHING_PASSES`] times.
    fn new(land: &Terrain) -> Self {
        let mut broad = land.clone();
        (0..SMOOTHING_PASSES).for_each(|_| broad.smooth_binomial());
        let [columns, rows] = land.counts;
        let rows: Vec<usize> = (0..rows).collect();
        let row = |&j: &usize| {
            let one = |i: usize| {
                // Slope from the normal; the height above the smoothed terrain is positive on crests and negative in hollows.
                let slope = osier_base::math::acos_f32(land.normal(i, j, 1).y.clamp(-1.0, 1.0));
                [slope, land.height(i, j) - broad.height(i, j)]
            };
            (0..columns).map(one).collect::<Vec<_>>()
        };
        Self { counts: land.counts, cells: pixels::concatenated(par_map(&rows, row)) }
    }

    /// Slope, rad, and relative height, m. `x`, `y`: shares of the way from -x to +x and from -z to +z, clamped to 0..1.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "shares of the unit line")]
    fn at(&self, x: f32, y: f32) -> [f32; 2] {
        let split = |v: f32, count: usize| {
            let cells = count - 1;
            let u = v.clamp(0.0, 1.0) * cells as f32;
            let i = (u as usize).min(cells - 1);
            (i, u - i as f32)
        };
        let [columns, rows] = self.counts;
        let ((i, f), (j, g)) = (split(x, columns), split(y, rows));
        // The slopes themselves are interpolated: those of a bilinear surface would jump at the borders of cells.
        let row = |j: usize| {
            let [a, b] = [self.cells[j * columns + i], self.cells[j * columns + i + 1]];
            [0, 1].map(|k| osier_base::math::lerp(a[k], b[k], f))
        };
        let (low, high) = (row(j), row(j + 1));
        [0, 1].map(|k| osier_base::math::lerp(low[k], high[k], g))
    }
}

/// Colour, height and roughness of a texel. `shape`: slope (rad) and relative height (m); `noise`: values of [`TerrainNoise`].
fn sample(colors: &TerrainColors, shape: [f32; 2], noise: [f32; 4]) -> MaterialTexel {
    let ([slope, bulge], [meadow, worn, tufts, strata]) = (shape, noise);
    let [earth, grass, rock] = [colors.earth, colors.grass, colors.rock].map(Vec3::from_array);
    // Colours of the three layers. Crests are dry, hollows hold water: grass is straw-coloured on crests, lush in hollows.
    let dry = (0.5 + 0.9 * meadow + 0.35 * bulge).clamp(0.0, 1.0);
    let lush = grass * Vec3::new(0.62, 0.80, 0.70);
    let straw = Vec3::new(grass.y * 1.55, grass.y * 1.32, grass.z * 1.9);
    let green = lush.lerp(grass, dry.min(0.5) * 2.0).lerp(straw, ((dry - 0.5) * 2.0).max(0.0) * 0.75);
    let green = green * (1.0 + 0.45 * tufts + 0.12 * worn);
    let bare = earth * (1.0 + 0.5 * tufts + 0.25 * strata);
    let stone = rock * (0.9 + 0.55 * strata + 0.25 * tufts);

    // Soil is bare where the grass is worn (in patches, on crests, on steeper ground), rock from the steep slope on.
    let worn_away = worn + 0.30 * tufts + 0.12 * bulge.clamp(-2.0, 2.0) + 1.2 * (slope - 0.6 * colors.steep).max(0.0);
    let soil = smoothstep(-0.12, 0.16, worn_away - (colors.cover - 0.5) * 1.1);
    let crag = smoothstep(-0.09, 0.09, slope - colors.steep + 0.16 * strata + 0.08 * worn);
    let color = green.lerp(bare, soil).lerp(stone.max(Vec3::splat(0.01)), crag);
    let height = 0.45 + (0.30 * tufts) * (1.0 - 0.5 * soil) + 0.28 * crag * strata - 0.1 * soil;
    MaterialTexel { color: color.max(Vec3::splat(0.004)), height: height.clamp(0.0, 1.0), rough: 0.96 - 0.12 * crag }
}
