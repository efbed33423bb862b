//! The ground: an undulating disc, and its material of soil, moss and grass.

use glam::{Vec2, Vec3};

use super::periodic_noise::{CellularNoise, FractalNoise, NearestFeature, pixel_centres};
use super::pixels::MaterialTexel;
use super::{SurfaceMaterial, pixels};
use osier_base::math::{self, smoothstep};
use osier_base::noise;
use osier_base::par::par_map;
use osier_base::{Error, Result};
use osier_scene::{Maps, Material, MaterialClass, Mesh};

/// Parameters of an undulating disc of ground around the origin.
#[derive(Debug, Clone, PartialEq)]
pub struct Ground {
    /// Radius, m, 0.1..10000.
    pub radius: f32,
    /// Amplitude of the waves about their mean, m, 0..100.
    pub amplitude: f32,
    /// Length of the longest waves, m, > 0.
    pub wavelength: f32,
    /// Number of rings of points around the centre, 4..=512.
    pub rings: u32,
    /// Points on each ring, 8..=1024.
    pub sectors: u32,
    /// Size of one repeat of the maps, m, 0.01..1000.
    pub tile: f32,
    /// Seed of the waves and of the warp of the texture coordinates.
    pub seed: u64,
}

impl Default for Ground {
    fn default() -> Self {
        Self { radius: 30.0, amplitude: 0.35, wavelength: 9.0, rings: 48, sectors: 96, tile: 2.0, seed: 1 }
    }
}

impl Ground {
    /// Height at (x, z), m; 0 at the origin.
    pub fn height(&self, x: f32, z: f32) -> f32 {
        // The value at the origin is subtracted, so that plants there stand at height 0.
        let wave = |x: f32, z: f32| {
            let k = 1.0 / self.wavelength.max(1e-3);
            noise::fractal2(self.seed ^ 0x6E0D, [x * k + 0.5, z * k + 0.5], [1 << 20, 1 << 20], 3)
        };
        self.amplitude * (wave(x, z) - wave(0.0, 0.0))
    }

    /// The disc as a mesh of one material (0), rings closer near the middle; u along +X, v along -Z, in tiles.
    /// # Errors
    /// `Range` for a value outside its range.
    /// Own: normals by central differences of [`Ground::height`] over 5 cm.
    pub fn mesh(&self) -> Result<Mesh> {
        self.check()?;
        let mut mesh = Mesh::default();
        self.push_point(&mut mesh, 0.0, 0.0);
        for ring in 1..=self.rings {
            let share = ring as f32 / self.rings as f32;
            // Radii grow with share (0.25 + 0.75 share): rings are four times as dense in the middle, near the
            // plants, as on average.
            let r = self.radius * share * (0.25 + 0.75 * share);
            for k in 0..self.sectors {
                let a = k as f32 / self.sectors as f32 * std::f32::consts::TAU;
                self.push_point(&mut mesh, r * math::cos_f32(a), -r * math::sin_f32(a));
            }
        }
        // A fan around the middle, then two triangles per sector and ring.
        let n = self.sectors;
        for k in 0..n {
            let next = (k + 1) % n;
            mesh.triangles.push([0, 1 + k, 1 + next]);
            for ring in 0..self.rings - 1 {
                let (a, b) = (1 + ring * n, 1 + (ring + 1) * n);
                mesh.triangles.push([a + k, b + k, b + next]);
                mesh.triangles.push([a + k, b + next, a + next]);
            }
        }
        Ok(mesh.with_material(0))
    }

    /// Appends the point of the surface above (x, z), with its normal and texture coordinates.
    fn push_point(&self, mesh: &mut Mesh, x: f32, z: f32) {
        const STEP: f32 = 0.05;
        // Central differences of the height function itself: normals do not depend on the tessellation.
        let slope = |dx: f32, dz: f32| (self.height(x + dx, z + dz) - self.height(x - dx, z - dz)) / (2.0 * STEP);
        mesh.points.push(Vec3::new(x, self.height(x, z), z));
        mesh.normals.push(Vec3::new(-slope(STEP, 0.0), 1.0, -slope(0.0, STEP)).normalize());
        mesh.uvs.push(self.uv(x, z));
    }

    /// Texture coordinates, in tiles: u along +X, v along -Z. Where the maps repeat, the coordinates are warped a little, which
    /// hides the regular rows of repeats.
    /// Own: two waves of noise of 0.16 tiles, 3 tiles long.
    fn uv(&self, x: f32, z: f32) -> Vec2 {
        let plain = Vec2::new(x, -z) / self.tile;
        if self.is_one_repeat() {
            return plain;
        }
        // Two independent noises displace u and v; their wavelength of three repeats hides the grid.
        let bend = |k: u64| {
            let at = [plain.x / 3.0 + 0.5, plain.y / 3.0 + 0.5];
            noise::fractal2(self.seed ^ (0xBE2D + k), at, [1 << 20, 1 << 20], 2)
        };
        plain + 0.16 * Vec2::new(bend(0), bend(1))
    }

    /// True if one repeat of the maps covers the whole disc.
    pub fn is_one_repeat(&self) -> bool {
        self.tile >= 2.0 * self.radius
    }

    fn check(&self) -> Result<()> {
        let rows = [
            ("radius", self.radius, 0.1, 1e4, "m"),
            ("amplitude", self.amplitude, 0.0, 100.0, "m"),
            ("wavelength", self.wavelength, 1e-3, 1e5, "m"),
            ("rings", self.rings as f32, 4.0, 512.0, ""),
            ("sectors", self.sectors as f32, 8.0, 1024.0, ""),
            ("tile", self.tile, 0.01, 1000.0, "m"),
        ];
        for (name, value, min, max, unit) in rows {
            if !(min..=max).contains(&value) {
                let name = format!("ground: {name}");
                return Err(Error::Range { name, value: value.into(), min: min.into(), max: max.into(), unit });
            }
        }
        Ok(())
    }
}

/// Linear colours of the ground, and the shares of green and haze.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GroundColors {
    /// Bare soil, dark and light.
    pub soil: [[f32; 3]; 2],
    /// Short grass and moss, dark and light.
    pub green: [[f32; 3]; 2],
    /// Fallen leaves and stalks.
    pub litter: [f32; 3],
    /// Share of the ground that grass and moss cover, 0..1.
    pub cover: f32,
    /// Air between the eye and the far ground: its colour, and the share of it at the rim of a map that covers the whole
    /// ground, 0..1.
    pub haze: ([f32; 3], f32),
}

impl Default for GroundColors {
    fn default() -> Self {
        Self {
            soil: [[0.030, 0.021, 0.013], [0.105, 0.078, 0.050]],
            green: [[0.022, 0.045, 0.010], [0.095, 0.145, 0.032]],
            litter: [0.190, 0.130, 0.065],
            cover: 0.62,
            haze: ([0.7; 3], 0.0),
        }
    }
}

/// Tabulated noises of soil, grass and litter; one period is one repeat of the maps.
struct GroundNoise {
    /// Lush and dry parts of a meadow.
    meadow: FractalNoise,
    cover: FractalNoise,
    tint: FractalNoise,
    clod: FractalNoise,
    blades: [FractalNoise; 3],
    litter: CellularNoise,
    /// Sines and cosines of 256 angles at which litter may lie, from 0 to pi.
    turns: Vec<(f32, f32)>,
}

/// Height range of the ground's maps, m.
const RELIEF: f32 = 0.03;

/// The ground's material with `<name>_color`, `_normal`, `_rough` and `_height` (16 bit), tiling; `side` pixels
/// (16..=4096), `tile` m a repeat.
/// # Errors
/// `Range` for a side outside its range.
/// Own: patches of short grass (streaks in three directions) on cloddy soil, strewn with litter.
pub fn ground_material(colors: &GroundColors, name: &str, side: u32, tile: f32, seed: u64) -> Result<SurfaceMaterial> {
    if !(16..=4096).contains(&side) {
        let name = "ground: side of the maps".to_owned();
        return Err(Error::Range { name, value: side.into(), min: 16.0, max: 4096.0, unit: "pixels" });
    }
    let tables = GroundNoise::new(tile, side, seed);
    let rows: Vec<u32> = (0..side).collect();
    let n = side as f32;
    let xs = pixel_centres(side);
    let texels = pixels::concatenated(par_map(&rows, |&y| {
        let y = 1.0 - (y as f32 + 0.5) / n;
        let [meadow, tint, clod, cover] =
            [&tables.meadow, &tables.tint, &tables.clod, &tables.cover].map(|noise| noise.row(&xs, y));
        // Three layers of streaks are the grass blades; the clods warp them, otherwise they would look woven.
        let warped = |(i, x): (usize, &f32)| [x + 0.03 * clod[i], y + 0.03 * tint[i] - 0.02 * clod[i]];
        let along: Vec<[f32; 2]> = xs.iter().enumerate().map(warped).collect();
        let across: Vec<[f32; 2]> = along.iter().map(|[x, y]| [*y, *x]).collect();
        let [a, b, c] = &tables.blades;
        let blades = [a.at_places(&along), b.at_places(&across), c.at_places(&along)];
        let places: Vec<[f32; 2]> = xs.iter().map(|x| [*x, y]).collect();
        let litter = tables.litter.at_places(&places);
        let values = |i: usize| GroundNoiseSample {
            meadow: meadow[i],
            tint: tint[i],
            clod: clod[i],
            cover: cover[i],
            blades: blades.each_ref().map(|blade| blade[i]),
            litter: litter[i],
        };
        places.iter().enumerate().map(|(i, place)| sample(colors, &tables, *place, &values(i))).collect()
    }));
    let step = RELIEF / (tile.max(0.01) / n);
    let images = pixels::surface_images(name, side, &texels, [step, step], true);
    let material = Material {
        name: name.to_owned(),
        class: MaterialClass::Ground,
        base_color: colors.soil[1],
        roughness: 0.95,
        ior: 1.5,
        translucency: 0.0,
        double_sided: false,
        alpha_cutoff: None,
        height_range: RELIEF,
        tile,
        maps: Maps { color: Some(0), normal: Some(1), roughness: Some(2), height: Some(3) },
        coat: None,
    };
    Ok(SurfaceMaterial { material, images })
}

impl GroundNoise {
    /// Patterns have the same size on the ground whatever the size of a repeat: lengths are in metres. Detail finer
    /// than two pixels is made as coarse as the map can show.
    fn new(tile: f32, side: u32, seed: u64) -> Self {
        let s = |k: u64| seed.wrapping_mul(64).wrapping_add(k << 3);
        let most = (side / 2).max(2);
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the side of a map")]
        let times = |length: f32| ((tile.max(0.01) / length).round().clamp(1.0, most as f32)) as u32;
        // Each octave halves the cells; there are as many octaves as leave at least two pixels per cell.
        let fractal = |k: u64, lengths: [f32; 2], octaves: u32| {
            let cells = lengths.map(times);
            let room = most / cells[0].max(cells[1]);
            FractalNoise::new(s(k), cells, octaves.min(room.ilog2() + 1))
        };
        Self {
            meadow: fractal(7, [9.0; 2], 4),
            cover: fractal(0, [0.67; 2], 5),
            tint: fractal(1, [1.0; 2], 4),
            clod: fractal(2, [0.125; 2], 5),
            blades: [fractal(3, [0.0125, 0.0714], 2), fractal(4, [0.0182, 0.0455], 2), fractal(5, [0.0208; 2], 2)],
            litter: CellularNoise::new(s(6), [times(0.059), times(0.067)], 0.9),
            turns: (0..=u8::MAX)
                .map(|i| f32::from(i) * (std::f32::consts::PI / 256.0))
                .map(|a| (math::sin_f32(a), math::cos_f32(a)))
                .collect(),
        }
    }
}

/// Blends a colour into the haze, from a third of the radius on. `x`, `y`: position in a map whose corners meet in the
/// middle of the ground.
fn with_haze(colors: &GroundColors, color: Vec3, x: f32, y: f32) -> Vec3 {
    let (air, most) = colors.haze;
    // Distance from the nearest corner of the map, which is the middle of the ground.
    let (dx, dy) = (x.min(1.0 - x), y.min(1.0 - y));
    let share = most * smoothstep(0.16, 0.5, (dx * dx + dy * dy).sqrt());
    color.lerp(Vec3::from_array(air), share)
}

/// Values of the noises of a texel.
struct GroundNoiseSample {
    meadow: f32,
    tint: f32,
    clod: f32,
    cover: f32,
    /// Layers of streaks, at the places to which the clods warp the texel.
    blades: [f32; 3],
    litter: NearestFeature,
}

/// Colour, height and roughness of the texel at (x, y) of the unit square.
fn sample(colors: &GroundColors, t: &GroundNoise, [x, y]: [f32; 2], noise: &GroundNoiseSample) -> MaterialTexel {
    let GroundNoiseSample { meadow, tint, clod, cover, blades: [a, b, c], litter: near } = *noise;
    // Grass grows where the cover noise exceeds a threshold, with a soft, uneven border.
    let bare = cover + 0.25 * clod + 0.3 * meadow;
    let cover = smoothstep(-0.18, 0.18, bare + (colors.cover - 0.5));
    let blade = (0.5 + 0.55 * a.max(b).max(0.7 * c)).clamp(0.0, 1.0);
    let [soil, green] = [colors.soil, colors.green].map(|c| c.map(Vec3::from_array));
    // Albedo of bare soil by clods, of grass by blade brightness, mixed by the cover.
    let earth = soil[0].lerp(soil[1], (0.5 + 0.6 * clod + 0.2 * tint).clamp(0.0, 1.0));
    let grass = green[0].lerp(green[1], (blade * blade * 1.1 + 0.15 * tint).clamp(0.0, 1.0));
    let grass = grass
        .lerp(Vec3::new(grass.y * 1.05, grass.y * 0.92, grass.z), (0.3 + 0.4 * tint + 0.9 * meadow).clamp(0.0, 0.9));
    let mut color = earth.lerp(grass, cover * (0.55 + 0.45 * blade));
    let mut height = 0.35 + 0.22 * clod + cover * (0.30 * blade - 0.05);

    // Litter: in every fourth cell an ellipse at a random angle with a darker rib, a fallen leaf.
    let (sin, cos) = t.turns[usize::from((near.id >> 20).to_le_bytes()[0])];
    let [fx, fy] = near.from;
    let (along, across) = (fx * cos + fy * sin, fy * cos - fx * sin);
    let leaf = 1.0 - smoothstep(0.8, 1.0, (along * along * 8.0 + across * across * 42.0).sqrt());
    if near.id.is_multiple_of(4) {
        let shade = 0.6 + 0.8 * ((near.id >> 32) & 0xFF) as f32 / 256.0;
        let rib = 1.0 - 0.3 * (1.0 - smoothstep(0.0, 0.02, across.abs()));
        color = color.lerp(Vec3::from_array(colors.litter) * shade * rib, 0.85 * leaf);
        height += 0.18 * leaf;
    }
    let rough = 0.93 - 0.08 * cover * blade - 0.10 * leaf;
    let color = color * (1.0 + 0.14 * tint + 0.3 * meadow);
    MaterialTexel { color: with_haze(colors, color, x, y), height: height.clamp(0.0, 1.0), rough }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_disc_faces_up_and_follows_its_height() {
        let ground = Ground { rings: 12, sectors: 24, ..Ground::default() };
        let mesh = ground.mesh().expect("mesh");
        assert_eq!((mesh.points.len(), mesh.triangles.len()), (1 + 12 * 24, 24 + 2 * 24 * 11));
        for t in &mesh.triangles {
            let [a, b, c] = t.map(|i| mesh.points[i as usize]);
            assert!((b - a).cross(c - a).y > 0.0);
        }
        assert!(mesh.points.iter().all(|p| (p.y - ground.height(p.x, p.z)).abs() < 1e-6));
        assert!(mesh.points[0] == Vec3::ZERO && mesh.normals.iter().all(|n| n.y > 0.5));
        assert!(Ground { radius: f32::NAN, ..Ground::default() }.mesh().is_err());
    }

    #[test]
    fn maps_tile() {
        let set = ground_material(&GroundColors::default(), "ground", 128, 2.0, 1).expect("maps");
        let osier_scene::Pixels::U16(h) = &set.images[3].pixels else { panic!("16 bit") };
        let (mut border, mut inside) = (0_u64, 0_u64);
        for y in 0..128 {
            let row = &h[y * 128..(y + 1) * 128];
            border += u64::from(row[127].abs_diff(row[0]));
            inside += u64::from(row[63].abs_diff(row[64]));
        }
        assert!(border < inside * 2, "the border jumps no more than the middle: {border}, {inside}");
    }
}
