//! The sky as an equirectangular image of linear radiance, without the disc of the sun, which is a separate light.

use glam::Vec3;
use half::f16;

use super::encode_f16;
use osier_base::files::Folder;
use osier_base::{Result, math, noise};
use osier_scene::{Scene, Sky};

/// Path of the image in the output folder.
pub const FILE: &str = "maps/sky.exr";

/// Rows; there are twice as many columns. Own: the innermost ring of the sun's glow, 6 degrees in radius, then spans 17
/// texels.
const HEIGHT: u16 = 512;
/// Seed of [`dapple`], the same for all scenes, so that a sky depends only on its keys.
const SEED: u64 = 0x0073_6b79;
/// Noise cells around the horizon: patches of foliage some 10 degrees wide. More make them smaller.
const FOLIAGE_CELLS: i16 = 36;
/// Cells of the gaps of light around the horizon, discs of 3 to 4 degrees. More make them smaller and denser.
const GAP_CELLS: i16 = 60;

/// Writes the sky of a scene as `maps/sky.exr`: half floats, channels R, G, B, row 0 at the zenith.
/// Column u in 0..1 has the azimuth 2 pi (0.5 - u) from +Z towards +X, row v from the top the elevation pi (0.5 - v), as
/// OpenUSD's DomeLight reads `latlong` textures.
/// # Errors
/// `Io`.
pub fn write(folder: &Folder, scene: &Scene) -> Result<()> {
    let Some(mut out) = folder.create(FILE, "exr.sky", None)? else { return Ok(()) };
    let (width, height) = (2 * usize::from(HEIGHT), usize::from(HEIGHT));
    let mut samples = Vec::with_capacity(width * height * 3);
    for row in 0..HEIGHT {
        // Radiance is taken at the centre of each texel: no row lies on a pole, where all columns would have one direction.
        let v = (f32::from(row) + 0.5) / f32::from(HEIGHT);
        let elevation = std::f32::consts::PI * (0.5 - v);
        let (horizontal, y) = (math::cos_f32(elevation), math::sin_f32(elevation));
        for column in 0..2 * HEIGHT {
            let u = (f32::from(column) + 0.5) / f32::from(2 * HEIGHT);
            let azimuth = std::f32::consts::TAU * (0.5 - u);
            let direction = Vec3::new(horizontal * math::sin_f32(azimuth), y, horizontal * math::cos_f32(azimuth));
            let plain = scene.sky.radiance(&scene.sun, direction);
            let color = if scene.sky.dapple > 0.0 { dapple(&scene.sky, plain, [u, v], y) } else { plain };
            samples.extend(color.to_array().map(f16::from_f32));
        }
    }
    let comment = serde_json::json!({ "map": "sky", "projection": "latlong", "unit": "radiance", "scene": scene.hash });
    out.put(&encode_f16(width, height, 3, samples, scene.clip.fps, &comment.to_string())?)?;
    out.commit()
}

/// Blends defocused foliage over the sky: patches of shade, and discs of light in small gaps. It fades out up to about 45 degrees
/// above the horizon. `y`: sine of the elevation.
/// Own: shades chosen by eye, after photographs of drops in gardens; POV-Ray's sky has the same shades in other places.
fn dapple(sky: &Sky, plain: Vec3, [u, v]: [f32; 2], y: f32) -> Vec3 {
    // `deep` is the colour of the first stop of the gradient, below the horizon; `bright` is that of the last stop but one, above
    // the horizon. The cover decreases from 1 at sin(elevation) = 0.2 to 0 at 0.7.
    let stops = sky.stops();
    let (Some(deep), Some(bright)) = (stops.first(), stops.iter().rev().nth(1)) else { return plain };
    let (deep, bright) = (Vec3::from_array(deep.1) * 0.5, Vec3::from_array(bright.1));
    let cover = sky.dapple * (1.0 - ((y - 0.2) / 0.5).clamp(0.0, 1.0));
    // Patches of shade: dark where the fractal noise is low, light of the horizon where it is high. The noise is periodic around
    // the horizon, so that the image has no seam.
    let at = |cells: i16| [u * f32::from(cells), v * f32::from(cells) * 0.5];
    let period = |cells: i16| [i32::from(cells), i32::from(cells)];
    let mass = noise::fractal2(SEED, at(FOLIAGE_CELLS), period(FOLIAGE_CELLS), 3);
    let share = ((mass + 0.1) / 0.6).clamp(0.0, 1.0);
    let shaded = plain.lerp(deep.lerp(bright, share * share), 0.75 * cover);
    // Gaps of light: a disc with a soft edge around the point of two cells in five.
    let gap = noise::cellular2(SEED + 8, at(GAP_CELLS), period(GAP_CELLS), 0.6);
    let edge = 1.0 - ((gap.f1 - 0.28) / 0.06).clamp(0.0, 1.0);
    let lit = if gap.id % 5 < 2 { 0.22 * edge * cover } else { 0.0 };
    shaded.lerp(bright * 1.1, lit)
}
