//! One picture, two for comparison, or a contact sheet of many.

use std::ops::RangeInclusive;
use std::path::Path;

use super::super::Context;
use super::super::args::Preview;
use super::flags::{MAX_CELLS, PreviewFlags, check_picture_limits};
use super::source::{Variation, clip_of, is_finished, load};
use super::{Outcome, OutputPicture};
use crate::bake::BakeContext;
use crate::scene_preview::{PreviewScene, preview_together};
use osier_base::diagnostic::Report;
use osier_base::par::par_map;
use osier_base::progress::Silent;
use osier_base::{Error, Result};
use osier_preview::{ContactSheetCell, contact_sheet, contact_sheet_columns, contact_sheet_size};

/// Renders and writes one picture, or two side by side for `--compare`.
pub fn single(context: &Context, args: &Preview, flags: &PreviewFlags, work: &BakeContext<'_>) -> Result<Outcome> {
    let mut scenes = Vec::new();
    // Before a scene grows, as far as its clip is known by then.
    if args.frame.is_some() {
        for source in std::iter::once(&args.source).chain(&args.compare) {
            if let Some(why) = clip_of(context, args, source)?.and_then(|range| outside_range(&range, args)) {
                return Ok(Outcome::Refused(why));
            }
        }
    }
    for source in std::iter::once(&args.source).chain(&args.compare) {
        let scene =
            load(context, args, source, flags.options.quality, args.frame.is_some(), &Variation::default(), work)?;
        context.console.report(scene.report());
        if let Some(why) = outside_clip(&scene, args) {
            return Ok(Outcome::Refused(why));
        }
        scenes.push(scene);
    }
    let warned = scenes.iter().any(|scene| !scene.report().diagnostics.is_empty());
    let mut cells = render_cells(&scenes, args, flags, work)?;
    let first = &scenes[0];
    let (name, picture) = if cells.len() == 1 {
        (first.name().to_owned(), cells.swap_remove(0).picture)
    } else {
        (format!("{}-compared", first.name()), contact_sheet("", "", &cells, cells.len())?)
    };
    let target = OutputPicture::new(context, args, &name, "png")?;
    target.write(context, &picture, flags.options.quality, first.scene(), &name)?;
    Ok(Outcome::Written { warned })
}

/// Renders and writes a contact sheet of several seeds, or of several values of one or two keys.
pub fn run(context: &Context, args: &Preview, flags: &PreviewFlags, work: &BakeContext<'_>) -> Result<Outcome> {
    let (cells, columns) = plan(flags);
    sheet_of(cells, columns, &SheetTitle { name: None, about: about(flags) }, context, args, flags, work)
}

/// Pictures of a contact sheet of entries whose scenes are in memory at a time.
const ENTRIES_AT_A_TIME: usize = 4;

/// Settings that make such a picture cheap, unless the command line sets the key: its lines are a few pixels wide, on which neither bark
/// maps nor the sides of a tube are seen.
const ENTRY_SETTINGS: [&str; 4] = ["bark.side=16", "skin.edge=10", "skin.sides=3", "skin.turn_deg=85"];

/// Renders and writes a contact sheet of the L-systems of a file, each with a camera of its own. One that cannot be drawn is
/// reported and left out; without any other it is an error.
pub fn entries(
    context: &Context,
    args: &Preview,
    sources: &[String],
    flags: &PreviewFlags,
    work: &BakeContext<'_>,
) -> Result<Outcome> {
    let columns = args.columns.map_or(contact_sheet_columns(sources.len()), |c| c as usize);
    if let Some(refused) = refused(sources.len(), columns, flags, context) {
        return Ok(refused);
    }
    let is_given =
        |key: &str| context.sources.set.iter().any(|s| s.split('=').next().is_some_and(|k| k.trim().ends_with(key)));
    let own = ENTRY_SETTINGS.iter().filter(|s| !s.split('=').next().is_some_and(is_given));
    let set: Vec<String> = own.map(|s| (*s).to_owned()).collect();
    let quiet = BakeContext { progress: &Silent, ..*work };
    let load_entry = |source: &String| {
        work.cancel.check()?;
        let variation = Variation { source: Some(source.clone()), set: set.clone(), ..Variation::default() };
        let scene = load(context, args, source, flags.options.quality, args.frame.is_some(), &variation, &quiet);
        work.progress.advance(1);
        scene
    };
    work.progress.stage("drawing", sources.len() as u64);
    let (mut cells, mut first, mut failure, mut warned) = (Vec::new(), None, None, false);
    for group in sources.chunks(ENTRIES_AT_A_TIME) {
        // Scenes of a group are grown side by side, drawn, and dropped before those of the next.
        for (source, scene) in group.iter().zip(par_map(group, load_entry)) {
            let caption = source.rsplit_once('#').map_or(source.as_str(), |(_, name)| name);
            let drawn = scene.and_then(|scene| {
                if let Some(why) = outside_clip(&scene, args) {
                    return Ok((scene, Err(why)));
                }
                let cell = render_cells(std::slice::from_ref(&scene), args, flags, &quiet)?.pop();
                Ok((scene, Ok(cell)))
            });
            match drawn {
                Ok((_, Err(why))) => return Ok(Outcome::Refused(why)),
                Ok((scene, Ok(cell))) => {
                    context.console.report(scene.report());
                    warned |= !scene.report().diagnostics.is_empty();
                    cells.extend(cell.map(|cell| ContactSheetCell { caption: caption.to_owned(), ..cell }));
                    first.get_or_insert(scene);
                }
                Err(e @ (Error::Input(_) | Error::Limit { .. })) => {
                    // An excess of memory, too, is a limit, but ends the run.
                    work.cancel.check()?;
                    // The last failure is returned, and so reported, if no entry can be drawn.
                    if let Some(e) = failure.replace(e) {
                        context.console.error(&e);
                    }
                }
                Err(e) => return Err(e),
            }
        }
    }
    let Some(first) = first else {
        return failure.map_or_else(|| Ok(Outcome::Refused("the file has no L-systems".into())), Err);
    };
    warned |= failure.is_some();
    if let Some(e) = failure {
        context.console.error(&e);
    }
    let stem = Path::new(&args.source).file_stem().map(|s| s.to_string_lossy().into_owned());
    let about = format!("{} L-systems of {}", cells.len(), args.source);
    let title = SheetTitle { name: stem, about };
    write_sheet(&title, &cells, columns, &first, context, args, flags)?;
    Ok(Outcome::Written { warned })
}

/// The reason for which a sheet of `cells` pictures cannot be made; `None` if it can.
fn refused(cells: usize, columns: usize, flags: &PreviewFlags, context: &Context) -> Option<Outcome> {
    if cells as u64 > MAX_CELLS {
        let why = format!("a contact sheet of {cells} pictures; at most {MAX_CELLS} are possible");
        return Some(Outcome::Refused(why));
    }
    // The size of the whole sheet is checked before any of its scenes is grown.
    let size = contact_sheet_size(cells, columns, flags.options.size);
    check_picture_limits(size, context).err().map(Outcome::Refused)
}

/// Writes a contact sheet. `first`: the scene whose name it bears, unless `title` has one.
fn write_sheet(
    title: &SheetTitle,
    pictures: &[ContactSheetCell],
    columns: usize,
    first: &PreviewScene,
    context: &Context,
    args: &Preview,
    flags: &PreviewFlags,
) -> Result<()> {
    let shown = title.name.as_deref().unwrap_or(first.name());
    let name = format!("{shown}-sheet");
    let picture = contact_sheet(shown, &title.about, pictures, columns)?;
    let target = OutputPicture::new(context, args, &name, "png")?;
    target.write(context, &picture, flags.options.quality, first.scene(), &name)
}

/// Title lines of a contact sheet.
struct SheetTitle {
    /// `None`: the name of the first scene.
    name: Option<String>,
    about: String,
}

/// Loads all cells, renders them with cameras of one scale and writes a contact sheet.
fn sheet_of(
    cells: Vec<PlannedCell>,
    columns: usize,
    title: &SheetTitle,
    context: &Context,
    args: &Preview,
    flags: &PreviewFlags,
    work: &BakeContext<'_>,
) -> Result<Outcome> {
    let columns = args.columns.map_or(columns, |c| c as usize);
    if let Some(refused) = refused(cells.len(), columns, flags, context) {
        return Ok(refused);
    }
    let quiet = BakeContext { progress: &Silent, ..*work };
    let load_cell = |cell: &PlannedCell| {
        work.cancel.check()?;
        let with_motion = args.frame.is_some();
        let quality = flags.options.quality;
        let scene = load(context, args, &args.source, quality, with_motion, &cell.variation, &quiet)?;
        work.progress.advance(1);
        Ok(scene)
    };
    work.progress.stage("growing", cells.len() as u64);
    // The first cell is loaded before the others, so that an error of the file is reported once.
    let mut scenes = vec![load_cell(&cells[0])?];
    scenes.extend(par_map(cells.get(1..).unwrap_or_default(), load_cell).into_iter().collect::<Result<Vec<_>>>()?);
    // The cells have most warnings in common; print each once.
    let mut found = Report::default();
    scenes.iter().for_each(|scene| found.extend(scene.report().clone()));
    context.console.report(&found);
    let warned = !found.diagnostics.is_empty();
    if let Some(why) = scenes.iter().find_map(|scene| outside_clip(scene, args)) {
        return Ok(Outcome::Refused(why));
    }
    // Seeds and values of a key are compared at one scale.
    let mut pictures = render_cells(&scenes, args, flags, work)?;
    for (picture, cell) in pictures.iter_mut().zip(cells) {
        picture.caption = cell.caption;
    }
    write_sheet(title, &pictures, columns, &scenes[0], context, args, flags)?;
    Ok(Outcome::Written { warned })
}

/// Message if `--frame` is outside of the scene's clip; `None` otherwise.
fn outside_clip(scene: &PreviewScene, args: &Preview) -> Option<String> {
    outside_range(&scene.frame_range(), args)
}

/// Message if `--frame` is outside of a clip; `None` otherwise.
fn outside_range(clip: &RangeInclusive<u32>, args: &Preview) -> Option<String> {
    let outside = args.frame.filter(|n| !clip.contains(n))?;
    Some(format!("--frame: {}", outside_of(outside, clip, args)))
}

/// Message about a frame outside of a clip. A scene of one frame gets more by a key, which meshes and bakes do not have.
pub(super) fn outside_of(frame: u32, clip: &RangeInclusive<u32>, args: &Preview) -> String {
    let (start, end) = (*clip.start(), *clip.end());
    let has_keys = !std::iter::once(&args.source).chain(&args.compare).any(|name| is_finished(name));
    if start == end && frame > start && has_keys {
        return format!(
            "frame {frame} is outside the scene, which has the one frame {start}; --set frames.end={frame} makes it longer"
        );
    }
    format!("frame {frame} is outside the scene's {start} to {end}")
}

/// Renders scenes with cameras of one scale, fitted to all of them; captions are the scenes' names.
fn render_cells(
    scenes: &[PreviewScene],
    args: &Preview,
    flags: &PreviewFlags,
    work: &BakeContext<'_>,
) -> Result<Vec<ContactSheetCell>> {
    let states =
        scenes.iter().map(|scene| Ok((scene, scene.frame_or_rest(args.frame)?))).collect::<Result<Vec<_>>>()?;
    let pictures = preview_together(&states, &flags.options, work)?;
    let cells = pictures.into_iter().zip(scenes);
    Ok(cells.map(|(picture, scene)| ContactSheetCell { picture, caption: scene.name().to_owned() }).collect())
}

/// Second line of the sheet's title: the number of seeds and the keys that vary.
fn about(flags: &PreviewFlags) -> String {
    let keys: Vec<&str> = flags.sweeps.iter().map(|s| s.key.as_str()).collect();
    match (flags.seeds.is_empty(), keys.is_empty()) {
        (false, true) => format!("{} seeds", flags.seeds.len()),
        (false, false) => format!("{} seeds, {}", flags.seeds.len(), keys.join(" and ")),
        _ => keys.join(" across, ") + if keys.len() == 2 { " down" } else { "" },
    }
}

/// Variation and caption of a cell, before its scene is loaded.
struct PlannedCell {
    variation: Variation,
    caption: String,
}

impl PlannedCell {
    fn new(variation: Variation) -> Self {
        let seed = variation.seed.map(|s| format!("seed {s}"));
        let caption = seed.into_iter().chain(captions(&variation.set)).collect::<Vec<_>>().join(", ");
        Self { variation, caption }
    }
}

/// The overrides of a cell as `NAME = VALUE`. The title has whole keys, of which a caption as wide as a picture would show little
/// more than the tables: names are their last parts, unless two keys end alike.
fn captions(set: &[String]) -> Vec<String> {
    let pairs: Vec<(&str, &str)> = set.iter().filter_map(|s| s.split_once('=')).collect();
    let names: Vec<&str> = pairs.iter().map(|(key, _)| key.rsplit('.').next().unwrap_or(key)).collect();
    let is_alike = |name: &str| names.iter().filter(|other| **other == name).count() > 1;
    let named = pairs.iter().zip(&names);
    named.map(|((key, value), name)| format!("{} = {value}", if is_alike(name) { key } else { name })).collect()
}

/// All cells row by row, and the number of columns. Of two axes the first runs across and the second down; seeds are the last
/// axis.
fn plan(flags: &PreviewFlags) -> (Vec<PlannedCell>, usize) {
    let seeds: Vec<Variation> =
        flags.seeds.iter().map(|s| Variation { seed: Some(*s), ..Variation::default() }).collect();
    let axes: Vec<Vec<Variation>> = flags
        .sweeps
        .iter()
        .map(|sweep| {
            let value = |v: &String| Variation { set: vec![format!("{}={v}", sweep.key)], ..Variation::default() };
            sweep.values.iter().map(value).collect()
        })
        .chain((!seeds.is_empty()).then_some(seeds))
        .collect();
    match &axes[..] {
        [across, down] => {
            // Row by row: the second axis is the outer loop.
            let pairs = down.iter().flat_map(|d| across.iter().map(move |a| (a, d)));
            let both = |(a, d): (&Variation, &Variation)| {
                // Only one of the two axes can be seeds.
                PlannedCell::new(Variation {
                    seed: a.seed.or(d.seed),
                    set: [&a.set[..], &d.set].concat(),
                    source: None,
                })
            };
            (pairs.map(both).collect(), across.len())
        }
        [one, ..] => (one.iter().cloned().map(PlannedCell::new).collect(), contact_sheet_columns(one.len())),
        [] => (Vec::new(), 1),
    }
}

#[cfg(test)]
mod tests {
    use super::captions;

    #[test]
    fn captions_name_the_last_part_of_a_key_unless_two_are_alike() {
        let of = |set: &[&str]| captions(&set.iter().map(|s| (*s).to_owned()).collect::<Vec<_>>()).join(", ");
        assert_eq!(of(&["plants.birch.set.HANG=0.3", "plants.birch.set.RISE=30"]), "HANG = 0.3, RISE = 30");
        assert_eq!(of(&["plants.a.seed=1", "plants.b.seed=2"]), "plants.a.seed = 1, plants.b.seed = 2");
        assert_eq!(of(&["angle=30"]), "angle = 30");
        assert_eq!(of(&[]), "");
    }
}
