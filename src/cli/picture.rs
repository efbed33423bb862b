//! `osier grow TABLE -o NAME.png` and `.exr`: an attractor as a picture.

use serde_json::json;

use super::Context;
use super::args::Grow;
use super::grow::{beside, file_name, result};
use super::progress::Show;
use crate::bake::BakeContext;
use crate::bake::assets::{attractor, layered_picture};
use crate::recipe::Recipe;
use osier_base::units::byte;
use osier_base::{Error, Result};
use osier_export::{exr, textures};
use osier_ifs::picture::{Density, ToneMapping, tone_mapped};
use osier_scene::{Image, ImageKind, Pixels};

/// Draws the first attractor of a recipe into the file asked for.
pub fn run(context: &Context, args: &Grow, recipe: &Recipe, warned: bool) -> Result<u8> {
    if !recipe.layers.is_empty() {
        return layered(context, args, recipe, warned);
    }
    let Some(cloud) = recipe.clouds.first() else {
        let why = format!("\"{}\" holds no attractor; .png and .exr are for coefficient tables", args.source);
        context.console.complain(&why);
        return Ok(2);
    };
    let keys = &recipe.picture;
    if context.common.dry_run {
        let text = format!("{}\n  {} x {} pixels\n", args.output.display(), keys.width, keys.height);
        context.console.result(&text)?;
        return Ok(context.strict(warned));
    }
    let show = Show::new(&context.console);
    let work = BakeContext { limits: &context.limits, cancel: &context.cancel, progress: &show, cache: None };
    let (density, tone, flat) = attractor::render_attractor(cloud, recipe, &work)?;
    show.done();
    let name = file_name(&args.output);
    let is_exr = name.to_ascii_lowercase().ends_with(".exr");
    let (folder, parent) = beside(context, args)?;
    if is_exr {
        let comment = json!({ "map": "density", "ifs": cloud.system.name, "seed": recipe.general.seed.to_string(), "scene": recipe.hash });
        let (width, height) = (density.width, density.height);
        folder.write(&name, "exr.density", &exr::floats(width, height, 1, &density.value, &comment.to_string())?)?;
        if !density.color.is_empty() {
            let stem = name.rsplit_once('.').map_or(name.as_str(), |(s, _)| s);
            let samples: Vec<f32> = density.color.iter().flatten().copied().collect();
            let bytes = exr::floats(width, height, 3, &samples, &comment.to_string())?;
            folder.write(&format!("{stem}.color.exr"), "exr.color", &bytes)?;
        }
    } else {
        folder.write(&name, "png", &textures::png(&image(&density, &tone, flat, keys.bits)?)?)?;
    }
    folder.finish()?;
    result(context, parent, &folder)?;
    Ok(context.strict(warned))
}

/// Draws a recipe's layers into the PNG asked for.
fn layered(context: &Context, args: &Grow, recipe: &Recipe, warned: bool) -> Result<u8> {
    let name = file_name(&args.output);
    if !name.to_ascii_lowercase().ends_with(".png") {
        context.console.complain("a picture of layers is written as .png");
        return Ok(2);
    }
    if context.common.dry_run {
        let keys = &recipe.picture;
        context.console.result(&format!("{}\n  {} x {} pixels\n", args.output.display(), keys.width, keys.height))?;
        return Ok(context.strict(warned));
    }
    let show = Show::new(&context.console);
    let work = BakeContext { limits: &context.limits, cancel: &context.cancel, progress: &show, cache: None };
    let canvas = layered_picture::compose(recipe, &work)?;
    show.done();
    let (folder, parent) = beside(context, args)?;
    folder.write(&name, "png", &textures::png(&of_canvas(&canvas, recipe)?)?)?;
    folder.finish()?;
    result(context, parent, &folder)?;
    Ok(context.strict(warned))
}

/// The canvas as 8 or 16 bits a channel, without alpha where nothing shines through.
pub(super) fn of_canvas(canvas: &layered_picture::LayerCanvas, recipe: &Recipe) -> Result<Image> {
    let channels = if recipe.picture.background.is_some() || canvas.is_opaque() { 3 } else { 4 };
    let samples: Vec<f32> = canvas.pixels.iter().flat_map(|p| p.iter().take(channels).copied()).collect();
    picture(canvas.width, canvas.height, channels, &samples, recipe.picture.bits)
}

fn image(density: &Density, tone: &ToneMapping, flat: [f32; 3], bits: u32) -> Result<Image> {
    let samples = tone_mapped(density, tone, flat);
    let channels = if tone.background.is_some() { 3 } else { 4 };
    picture(density.width, density.height, channels, &samples, bits)
}

/// Samples 0..1 as a picture of 8 or 16 bits a channel.
/// An image of samples in 0 to 1, rows from the top, quantised to `bits` per channel.
fn picture(width: usize, height: usize, channels: usize, samples: &[f32], bits: u32) -> Result<Image> {
    let side = |n: usize| u32::try_from(n).map_err(|_| Error::export("I050", "the picture is too wide"));
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to 16 bits before the cast")]
    let word = |v: &f32| (v.clamp(0.0, 1.0) * 65_535.0 + 0.5) as u16;
    let pixels = if bits > 8 {
        Pixels::U16(samples.iter().map(word).collect())
    } else {
        Pixels::U8(samples.iter().map(|v| byte(*v)).collect())
    };
    Ok(Image {
        name: "attractor".into(),
        kind: ImageKind::Color,
        width: side(width)?,
        height: side(height)?,
        channels: u8::try_from(channels).unwrap_or(4),
        pixels,
    })
}
