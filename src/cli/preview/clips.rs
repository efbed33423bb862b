//! `osier preview --turntable` and `--frames`: clips as GIF, APNG or numbered PNG files.

use std::ops::RangeInclusive;

use super::super::args::Preview;
use super::super::{Context, check_output};
use super::flags::PreviewFlags;
use super::sheets::outside_of;
use super::source::{Variation, clip_of, ending, load};
use super::{Outcome, OutputPicture, is_to_pipe, notes, numbered};
use crate::bake::BakeContext;
use crate::scene_preview::{ClipContent, PreviewClip};
use osier_base::Result;
use osier_preview::ClipFormat;

/// Renders and writes a turntable or a range of frames, in the format that the ending of the output chooses.
pub fn run(context: &Context, args: &Preview, flags: &PreviewFlags, work: &BakeContext<'_>) -> Result<Outcome> {
    let format = match args.output.as_deref().filter(|_| !is_to_pipe(args)).map(ending).as_deref() {
        None | Some("gif") => ClipFormat::Gif,
        Some("png" | "apng") => ClipFormat::Apng,
        Some(other) => {
            return Ok(Outcome::Refused(format!(
                "a clip is written as .gif, .png or .apng, not as .{other}; for a video -o NAME_####.png writes numbered pictures, \
                 of which other programs make one"
            )));
        }
    };
    check_numbered_pictures(context, args, flags)?;
    // A turntable without `--frame` has the scene at rest, which needs no simulation of motion.
    let with_motion = args.turntable.is_none() || args.frame.is_some();
    let asked_frames = if args.turntable.is_some() { args.frame.as_slice() } else { &flags.frames };
    let outside = |range: &RangeInclusive<u32>| {
        let flag = if args.turntable.is_some() { "--frame" } else { "--frames" };
        let first = asked_frames.iter().find(|n| !range.contains(n))?;
        Some(Outcome::Refused(format!("{flag}: {}", outside_of(*first, range, args))))
    };
    // Before the scene grows, as far as its clip is known by then.
    if !asked_frames.is_empty()
        && let Some(refused) = clip_of(context, args, &args.source)?.and_then(|range| outside(&range))
    {
        return Ok(refused);
    }
    // Load the scene, and check the frames and its motion again with what is known now.
    let scene = load(context, args, &args.source, flags.options.quality, with_motion, &Variation::default(), work)?;
    context.console.report(scene.report());
    let content = match args.turntable {
        Some(steps) => ClipContent::Turntable { steps, frame: args.frame },
        None => ClipContent::Frames(&flags.frames),
    };
    if let Some(refused) = outside(&scene.frame_range()) {
        return Ok(refused);
    }
    if args.turntable.is_none() && !scene.is_animated() {
        return Ok(Outcome::Refused(format!(
            "\"{}\" is not animated; --turntable renders a clip of it from all sides",
            scene.name()
        )));
    }
    // Write numbered pictures, if the name of the output has a `####`, else one file.
    let clip = PreviewClip::new(&scene, &flags.options, content)?;
    let target = OutputPicture::new(context, args, scene.name(), "gif")?;
    if let Some(pattern) = numbered_pictures(context, args) {
        let notes = notes(scene.scene(), scene.name());
        clip.draw(work, |number, picture| {
            let name = numbered(&pattern, number).unwrap_or_default();
            if let Some(mut output) = target.folder.create(&name, "preview", Some(number))? {
                output.put(&picture.png(&notes, flags.options.quality.prefers_speed())?)?;
                output.commit()?;
            }
            Ok(())
        })?;
        target.finish(context, flags.options.size, clip.len())?;
        return Ok(Outcome::Written { warned: !scene.report().diagnostics.is_empty() });
    }
    let Some(mut output) = target.folder.create(&target.name, "preview", None)? else {
        return Ok(Outcome::Written { warned: false });
    };
    clip.write(&mut output, format, work)?;
    output.commit()?;
    target.finish(context, flags.options.size, clip.len())?;
    Ok(Outcome::Written { warned: !scene.report().diagnostics.is_empty() })
}

/// Checks that no file of the user has the name of a numbered picture, before any is drawn: the first ones would be written else.
/// # Errors
/// `Io`, `Foreign`.
fn check_numbered_pictures(context: &Context, args: &Preview, flags: &PreviewFlags) -> Result<()> {
    let pattern = numbered_pictures(context, args).filter(|_| !context.common.dry_run);
    let (Some(pattern), Some(output)) = (pattern, &args.output) else { return Ok(()) };
    let numbers: Vec<u32> = args.turntable.map_or_else(|| flags.frames.clone(), |steps| (1..=steps).collect());
    let mut names = numbers.into_iter().filter_map(|number| numbered(&pattern, number));
    names.try_for_each(|name| check_output(context, &output.with_file_name(name), args.force))
}

/// The name of a PNG per frame, with `####` for its number, if the output has such a name; `None` for a clip in one file.
fn numbered_pictures(context: &Context, args: &Preview) -> Option<String> {
    let path = args.output.as_deref().filter(|path| ending(path) == "png")?;
    let name = path.file_name()?.to_str().filter(|name| numbered(name, 0).is_some())?;
    // A dry run writes to a folder in memory, which accepts portable file names only.
    Some(if context.common.dry_run { "preview_####.png".to_owned() } else { name.to_owned() })
}
