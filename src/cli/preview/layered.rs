//! A picture of layers, which needs no scene in space.

use std::path::Path;

use super::super::args::Preview;
use super::super::progress::Show;
use super::super::{Context, picture, source};
use super::{Target, shots};
use crate::bake::BakeContext;
use crate::bake::assets::layered_picture;
use crate::recipe::{Recipe, resolve};
use osier_base::Result;
use osier_base::diagnostic::Report;
use osier_export::textures;

/// The recipe of a source that is a picture of layers.
pub fn of(context: &Context, args: &Preview) -> Result<Option<(Recipe, Report)>> {
    let is_file = |ending: &str| args.source.to_ascii_lowercase().ends_with(ending);
    // Standard input is read once, and meshes and folders are no scenes.
    if args.source == "-" || Path::new(&args.source).is_dir() || (args.source.contains('.') && !is_file(".toml")) {
        return Ok(None);
    }
    let request = source::request(context, &args.source)?;
    // Scenes without the word are not resolved twice.
    if !request.text.contains("layer") {
        return Ok(None);
    }
    let (recipe, report) = resolve(&request)?;
    Ok(Some((recipe, report)).filter(|(recipe, _)| !recipe.layers.is_empty()))
}

/// Draws it, in its own size unless `--size` asks for another.
pub fn run(context: &Context, args: &Preview, mut recipe: Recipe, wish: &shots::Wish, warned: bool) -> Result<u8> {
    if args.size.is_some() {
        [recipe.picture.width, recipe.picture.height] = wish.size;
    }
    let show = Show::new(&context.console);
    let work = BakeContext { limits: &context.limits, cancel: &context.cancel, progress: &show, cache: None };
    let canvas = layered_picture::compose(&recipe, &work)?;
    show.done();
    let target = Target::new(context, args, &recipe.name, "png")?;
    target.folder.write(&target.name, "preview", &textures::png(&picture::of_canvas(&canvas, &recipe)?)?)?;
    target.tell(context, [recipe.picture.width, recipe.picture.height], 1)?;
    Ok(context.strict(warned))
}
