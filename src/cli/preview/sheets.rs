//! One picture, two for comparison, or a contact sheet of many.

use std::path::Path;

use super::super::Context;
use super::super::args::Preview;
use super::flags::{MAX_CELLS, PreviewFlags, check_picture_limits};
use super::source::{Variation, load};
use super::{Outcome, OutputPicture};
use crate::bake::BakeContext;
use crate::scene_preview::{PreviewScene, preview_together};
use osier_base::Result;
use osier_base::par::par_map;
use osier_base::progress::Silent;
use osier_preview::{ContactSheetCell, contact_sheet, contact_sheet_columns, contact_sheet_size};

/// Renders and writes one picture, or two side by side for `--compare`.
pub fn single(context: &Context, args: &Preview, flags: &PreviewFlags, work: &BakeContext<'_>) -> Result<Outcome> {
    let mut scenes = Vec::new();
    for source in std::iter::once(&args.source).chain(&args.compare) {
        let scene =
            load(context, args, source, flags.options.quality, args.frame.is_some(), &Variation::default(), work)?;
        context.console.report(scene.report());
        if let Some(why) = outside_clip(&scene, args.frame) {
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

/// Renders and writes a contact sheet of the L-systems of a file.
pub fn entries(
    context: &Context,
    args: &Preview,
    sources: &[String],
    flags: &PreviewFlags,
    work: &BakeContext<'_>,
) -> Result<Outcome> {
    let cell = |source: &String| PlannedCell {
        caption: source.rsplit_once('#').map_or(source.as_str(), |(_, name)| name).to_owned(),
        variation: Variation { source: Some(source.clone()), ..Variation::default() },
    };
    let cells: Vec<PlannedCell> = sources.iter().map(cell).collect();
    let columns = contact_sheet_columns(cells.len());
    let about = format!("{} L-systems of {}", cells.len(), args.source);
    let stem = Path::new(&args.source).file_stem().map(|s| s.to_string_lossy().into_owned());
    sheet_of(cells, columns, &SheetTitle { name: stem, about }, context, args, flags, work)
}

/// Title lines of a contact sheet.
struct SheetTitle {
    /// `None`: the name of the first scene.
    name: Option<String>,
    about: String,
}

/// Loads all cells, renders them and writes a contact sheet. Each entry of a file has a fitted camera; other cells share one.
fn sheet_of(
    cells: Vec<PlannedCell>,
    columns: usize,
    title: &SheetTitle,
    context: &Context,
    args: &Preview,
    flags: &PreviewFlags,
    work: &BakeContext<'_>,
) -> Result<Outcome> {
    let columns = args.columns.map_or(columns, |c| c.max(1) as usize);
    if cells.len() as u64 > MAX_CELLS {
        return Ok(Outcome::Refused(format!(
            "a contact sheet of {} pictures; at most {MAX_CELLS} are possible",
            cells.len()
        )));
    }
    // The size of the whole sheet is checked before any of its scenes is grown.
    if let Err(why) = check_picture_limits(contact_sheet_size(cells.len(), columns, flags.options.size), context) {
        return Ok(Outcome::Refused(why));
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
    context.console.report(scenes[0].report());
    let warned = !scenes[0].report().diagnostics.is_empty();
    scenes.extend(par_map(cells.get(1..).unwrap_or_default(), load_cell).into_iter().collect::<Result<Vec<_>>>()?);
    if let Some(why) = scenes.iter().find_map(|scene| outside_clip(scene, args.frame)) {
        return Ok(Outcome::Refused(why));
    }
    // Seeds and values of a key are compared at one scale; different L-systems are not.
    let is_of_entries = cells.iter().any(|cell| cell.variation.source.is_some());
    let mut pictures = Vec::with_capacity(scenes.len());
    for group in scenes.chunks(if is_of_entries { 1 } else { scenes.len() }) {
        pictures.extend(render_cells(group, args, flags, work)?);
    }
    for (picture, cell) in pictures.iter_mut().zip(cells) {
        picture.caption = cell.caption;
    }
    let first = &scenes[0];
    let shown = title.name.as_deref().unwrap_or(first.name());
    let name = format!("{shown}-sheet");
    let picture = contact_sheet(shown, &title.about, &pictures, columns)?;
    let target = OutputPicture::new(context, args, &name, "png")?;
    target.write(context, &picture, flags.options.quality, first.scene(), &name)?;
    Ok(Outcome::Written { warned })
}

/// Message if `--frame` is outside of the scene's clip; `None` otherwise.
fn outside_clip(scene: &PreviewScene, frame: Option<u32>) -> Option<String> {
    let range = scene.frame_range();
    let outside = frame.filter(|n| !range.contains(n))?;
    Some(format!("--frame: frame {outside} is outside the scene's {} to {}", range.start(), range.end()))
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
        flags.seeds.iter().map(|s| Variation { seed: Some(u64::from(*s)), ..Variation::default() }).collect();
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
