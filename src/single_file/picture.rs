//! Pictures of attractors (`.png`, `.exr`) and of composed layers (`.png`).

use serde_json::json;

use crate::bake::BakeContext;
use crate::bake::assets::{attractor, layered_picture};
use crate::recipe::{AttractorRecipe, Recipe};
use osier_base::convert::index;
use osier_base::files::Folder;
use osier_base::units::byte;
use osier_base::{Error, Result};
use osier_export::{exr, textures};
use osier_ifs::picture::tone_mapped;
use osier_scene::{Image, ImageKind, Pixels};

/// File format of a picture, with the values that it stores.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PictureEncoding {
    /// Tone-mapped sRGB with 8 or 16 bits per channel, by the key `picture.bits`.
    Png,
    /// Densities as linear 32-bit floats; mean colours in a second file `NAME.color.exr`.
    Exr,
}

/// Renders the layers of a recipe, or else its first attractor, into a file of a folder.
/// # Errors
/// X030 if the recipe has neither, or if layers are asked for as `.exr`; I023 and I050 of the attractor; `Limit`;
/// `Cancelled`; `Io` of what cannot be written.
pub fn write_picture(
    recipe: &Recipe,
    encoding: PictureEncoding,
    name: &str,
    folder: &Folder,
    context: &BakeContext<'_>,
) -> Result<()> {
    if !recipe.layers.is_empty() {
        if encoding != PictureEncoding::Png {
            return Err(Error::export("X030", "a picture of layers is written as .png"));
        }
        let canvas = layered_picture::compose(recipe, context)?;
        return folder.write(name, "png", &textures::png(&canvas_image(&canvas, recipe)?)?);
    }
    let Some(cloud) = recipe.clouds.first() else {
        let reason = format!("\"{}\" holds no attractor; .png and .exr are for coefficient tables", recipe.name);
        return Err(Error::export("X030", reason));
    };
    match encoding {
        PictureEncoding::Png => {
            let (density, tone, flat) = attractor::ifs_density(cloud, recipe, context)?;
            let samples = tone_mapped(&density, &tone, flat);
            // With a background every pixel is opaque, so that no alpha channel is needed.
            let channels = if tone.background.is_some() { 3 } else { 4 };
            let image = quantised(density.width, density.height, channels, &samples, recipe.picture.bits)?;
            folder.write(name, "png", &textures::png(&image)?)
        }
        PictureEncoding::Exr => write_density(recipe, cloud, name, folder, context),
    }
}

/// Writes the density of an attractor, and its mean colours into a second file if it is coloured by more than density.
fn write_density(
    recipe: &Recipe,
    cloud: &AttractorRecipe,
    name: &str,
    folder: &Folder,
    context: &BakeContext<'_>,
) -> Result<()> {
    let (density, ..) = attractor::ifs_density(cloud, recipe, context)?;
    let comment = |map: &str| {
        json!({ "map": map, "ifs": cloud.system.name, "seed": recipe.general.seed.to_string(), "scene": recipe.hash })
            .to_string()
    };
    let (width, height) = (density.width, density.height);
    folder.write(name, "exr.density", &exr::floats(width, height, 1, &density.value, &comment("density"))?)?;
    // The density has one channel; colours go into a second file.
    if !density.color.is_empty() {
        let stem = name.rsplit_once('.').map_or(name, |(stem, _)| stem);
        let samples: Vec<f32> = density.color.iter().flatten().copied().collect();
        let bytes = exr::floats(width, height, 3, &samples, &comment("color"))?;
        folder.write(&format!("{stem}.color.exr"), "exr.color", &bytes)?;
    }
    Ok(())
}

/// Converts a composed canvas to an image of 8 or 16 bits per channel, without alpha if every pixel is opaque.
/// # Errors
/// `TooMany` for a side beyond 32 bits.
pub fn canvas_image(canvas: &layered_picture::LayerCanvas, recipe: &Recipe) -> Result<Image> {
    let channels: u8 = if recipe.picture.background.is_some() || canvas.is_opaque() { 3 } else { 4 };
    let samples: Vec<f32> = canvas.pixels.iter().flat_map(|p| p.iter().take(usize::from(channels)).copied()).collect();
    quantised(canvas.width, canvas.height, channels, &samples, recipe.picture.bits)
}

/// Converts samples 0 to 1, rows from the top, to an image with `bits` (8 or 16) per channel, rounded to nearest.
fn quantised(width: usize, height: usize, channels: u8, samples: &[f32], bits: u32) -> Result<Image> {
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to 16 bits before the cast")]
    // Half a step is added for rounding to nearest; the cast truncates.
    let word = |v: &f32| (v.clamp(0.0, 1.0) * 65_535.0 + 0.5) as u16;
    let pixels = if bits > 8 {
        Pixels::U16(samples.iter().map(word).collect())
    } else {
        Pixels::U8(samples.iter().map(|v| byte(*v)).collect())
    };
    Ok(Image {
        name: "attractor".into(),
        kind: ImageKind::Color,
        width: index(width, "columns of a picture")?,
        height: index(height, "rows of a picture")?,
        channels,
        pixels,
    })
}
