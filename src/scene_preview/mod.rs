//! Previews: pictures, clips and comparable pictures of scenes, rendered without any other program.
//!
//! ```text
//! Recipe, mesh file or bake ─► PreviewScene ─┬─ preview          one picture
//!                                            ├─ preview_together pictures with cameras fitted to all of them
//!                                            └─ PreviewClip      turntable or frames, as GIF or APNG
//! ```

mod clip;
mod load;
mod options;

use crate::bake::BakeContext;
use osier_base::Result;
use osier_preview::{Picture, PreviewMaterials, RenderScene, render, tile_count};
use osier_scene::Frame;

pub use clip::{ClipContent, PreviewClip};
pub use load::PreviewScene;
pub use options::{PreviewBackground, PreviewOptions, PreviewView};

/// Renders one picture of a scene. `frame`: number of a frame; `None` for the scene at rest, or for the first frame
/// if catkins fly in it.
/// # Errors
/// `Range` for a frame outside of the clip; P001 if nothing is visible; P002 for a camera that is not finite; those
/// of the simulation; `Cancelled`.
/// # Examples
/// ```
/// use osier::bake::BakeContext;
/// use osier::limits::Limits;
/// use osier::preview::Quality;
/// use osier::progress::Cancel;
/// use osier::scene_preview::{PreviewOptions, PreviewScene};
/// use osier::source::{SourceOptions, find_scene};
///
/// # fn main() -> osier::Result<()> {
/// let (limits, cancel) = (Limits::default(), Cancel::default());
/// let context = BakeContext::quiet(&limits, &cancel);
/// let (recipe, _warnings) = osier::recipe::resolve(&find_scene("koch.l", &SourceOptions::default())?)?;
/// let options = PreviewOptions { size: [48, 32], quality: Quality::Draft, ..PreviewOptions::default() };
/// let scene = PreviewScene::of_recipe(recipe, options.quality, false, &context)?;
/// let picture = osier::preview(&scene, &options, None, &context)?;
/// assert_eq!((picture.width, picture.height), (48, 32));
/// assert!(picture.png(&[], true)?.starts_with(b"\x89PNG"));
/// # Ok(())
/// # }
/// ```
pub fn preview(
    scene: &PreviewScene,
    options: &PreviewOptions,
    frame: Option<u32>,
    context: &BakeContext<'_>,
) -> Result<Picture> {
    let frame = scene.frame_or_rest(frame)?;
    let mut pictures = preview_together(&[(scene, frame)], options, context)?;
    Ok(pictures.pop().unwrap_or_else(|| Picture::new(options.size[0], options.size[1])))
}

/// Renders scenes for comparison: a fitted camera is fitted to all subjects together, so that the scale is the same in every
/// picture.
/// Each scene comes with the frame to render, `None` for rest.
/// # Errors
/// P001 if nothing is visible in one of them; P002 for a camera that is not finite; `Cancelled`.
pub fn preview_together(
    scenes: &[(&PreviewScene, Option<Frame>)],
    options: &PreviewOptions,
    context: &BakeContext<'_>,
) -> Result<Vec<Picture>> {
    let subjects = scenes.iter().map(|(scene, frame)| scene.subject(frame.as_ref())).collect::<Result<Vec<_>>>()?;
    let Some((first, others)) = subjects.split_first() else { return Ok(Vec::new()) };
    // One subject that holds all others: cameras fitted to it have the same scale in every picture.
    let union = others.iter().fold(first.clone(), |union, subject| union.with(subject));
    context.progress.stage("drawing", tile_count(options.size) * scenes.len() as u64);
    let mut pictures = Vec::with_capacity(scenes.len());
    for ((scene, frame), subject) in scenes.iter().zip(&subjects) {
        let request = options.request(scene, subject, options.camera(scene, &union));
        let materials = PreviewMaterials::new(scene.scene(), options.quality);
        let world = RenderScene::for_requests(scene.scene(), frame.as_ref(), &materials, &[request]);
        pictures.push(render(&world, &request, context.cancel, context.progress)?);
    }
    Ok(pictures)
}
