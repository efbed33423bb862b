//! One picture, two side by side, or a sheet of many.

use super::super::Context;
use super::super::args::Preview;
use super::load::{Change, Loaded, load};
use super::shots::{self, Wish};
use super::{Done, Target};
use crate::bake::BakeContext;
use osier_base::par::par_map;
use osier_base::{Error, Result};
use osier_preview::{
    ContactSheetCell, Looks, Picture, Quality, RenderRequest, Subject, World, columns, render, sheet, sheet_size, tiles,
};
use osier_scene::Frame;

/// Renders a loaded source at a frame.
pub fn render_source(
    loaded: &Loaded,
    frame: Option<&Frame>,
    quality: Quality,
    shot: &RenderRequest,
    work: &BakeContext<'_>,
) -> Result<Picture> {
    let looks = Looks::new(loaded.scene(), quality);
    let world = World::seen_by(loaded.scene(), frame, &looks, &[*shot]);
    render(&world, shot, work.cancel, work.progress)
}

/// What stands in the picture.
/// # Errors
/// P001 if there is nothing.
pub fn subject(loaded: &Loaded, frame: Option<&Frame>) -> Result<Subject> {
    let subject = Subject::of(loaded.scene(), frame);
    if subject.is_empty() {
        let why = format!("\"{}\" draws nothing: no line, leaf, polygon or ground; see `osier check`", loaded.name);
        return Err(Error::export("P001", why));
    }
    Ok(subject)
}

/// One picture, or two with `--compare`.
pub fn single(context: &Context, args: &Preview, wish: &Wish, work: &BakeContext<'_>) -> Result<Done> {
    let sources: Vec<&str> =
        [Some(&args.source), args.compare.as_ref()].into_iter().flatten().map(String::as_str).collect();
    let moving = args.frame.is_some();
    let mut all = Vec::new();
    for source in &sources {
        let loaded = load(context, args, source, wish.quality, moving, &Change::default(), work)?;
        context.console.report(&loaded.report);
        let frame = match shots::frame_of(&loaded, args.frame) {
            Ok(frame) => frame,
            Err(why) => return Ok(Done::Refused(why)),
        };
        let subject = subject(&loaded, frame.as_ref())?;
        all.push((loaded, frame, subject));
    }
    let warned = all.iter().any(|a| !a.0.report.diagnostics.is_empty());
    let count = all.len() as u64;
    work.progress.stage("drawing", tiles(wish.size) * count);
    let both = all.iter().skip(1).fold(all.first().map(|a| a.2.clone()).unwrap_or_default(), |s, a| s.with(&a.2));
    let mut cells = Vec::new();
    for (loaded, frame, own) in &all {
        let shot = wish.shot(loaded, own, wish.camera(loaded, &both));
        cells.push(ContactSheetCell {
            picture: render_source(loaded, frame.as_ref(), wish.quality, &shot, work)?,
            caption: loaded.name.clone(),
        });
    }
    let Some((first, _, _)) = all.first() else { return Ok(Done::Kept { warned }) };
    let (name, picture) = match &cells[..] {
        [one] => (first.name.clone(), one.picture.clone()),
        _ => (format!("{}-compared", first.name), sheet("", "", &cells, cells.len())),
    };
    Target::new(context, args, &name, "png")?.write_picture(context, &picture, wish.quality, first.scene(), &name)?;
    Ok(Done::Kept { warned })
}

/// Pictures of several seeds, or of several values of one or two keys.
pub fn run(context: &Context, args: &Preview, wish: &Wish, work: &BakeContext<'_>) -> Result<Done> {
    let (changes, across) = plan(wish);
    let across = args.columns.map_or(across, |c| c.max(1) as usize);
    if changes.len() as u64 > shots::CELLS {
        return Ok(Done::Refused(format!("a sheet of {} pictures; at most {}", changes.len(), shots::CELLS)));
    }
    if let Err(why) = shots::within(sheet_size(changes.len(), across, wish.size), context) {
        return Ok(Done::Refused(why));
    }
    let grow = |change: &(Change, String)| {
        work.cancel.check()?;
        let quiet = BakeContext { progress: &osier_base::progress::Silent, ..*work };
        let loaded = load(context, args, &args.source, wish.quality, args.frame.is_some(), &change.0, &quiet)?;
        work.progress.advance(1);
        Ok(loaded)
    };
    work.progress.stage("growing", changes.len() as u64);
    // The first alone: a fault in the file is then told once.
    let mut list = vec![grow(&changes[0])?];
    context.console.report(&list[0].report);
    let warned = !list[0].report.diagnostics.is_empty();
    list.extend(par_map(changes.get(1..).unwrap_or_default(), grow).into_iter().collect::<Result<Vec<_>>>()?);
    let mut frames = Vec::new();
    for loaded in &list {
        match shots::frame_of(loaded, args.frame) {
            Ok(frame) => frames.push(frame),
            Err(why) => return Ok(Done::Refused(why)),
        }
    }
    let subjects = list.iter().zip(&frames).map(|(l, f)| subject(l, f.as_ref())).collect::<Result<Vec<_>>>()?;
    let union = subjects.iter().skip(1).fold(subjects[0].clone(), |s, o| s.with(o));
    work.progress.stage("drawing", tiles(wish.size) * list.len() as u64);
    let mut cells = Vec::new();
    for (((loaded, frame), own), (_, caption)) in list.iter().zip(&frames).zip(&subjects).zip(&changes) {
        let shot = wish.shot(loaded, own, wish.camera(loaded, &union));
        cells.push(ContactSheetCell {
            picture: render_source(loaded, frame.as_ref(), wish.quality, &shot, work)?,
            caption: caption.clone(),
        });
    }
    let first = &list[0];
    let name = format!("{}-sheet", first.name);
    let picture = sheet(&first.name, &about(wish), &cells, across);
    Target::new(context, args, &name, "png")?.write_picture(context, &picture, wish.quality, first.scene(), &name)?;
    Ok(Done::Kept { warned })
}

/// What is varied, for the title line.
fn about(wish: &Wish) -> String {
    let keys: Vec<&str> = wish.sweeps.iter().map(|s| s.key.as_str()).collect();
    match (wish.seeds.is_empty(), keys.is_empty()) {
        (false, true) => format!("{} seeds", wish.seeds.len()),
        (false, false) => format!("{} seeds, {}", wish.seeds.len(), keys.join(" and ")),
        _ => keys.join(" across, ") + if keys.len() == 2 { " down" } else { "" },
    }
}

/// All cells in order with their captions, and how many stand in a row.
fn plan(wish: &Wish) -> (Vec<(Change, String)>, usize) {
    let seeds: Vec<(Option<u64>, Vec<String>)> = wish.seeds.iter().map(|s| (Some(u64::from(*s)), Vec::new())).collect();
    let lines: Vec<Vec<(Option<u64>, Vec<String>)>> = wish
        .sweeps
        .iter()
        .map(|sweep| sweep.values.iter().map(|v| (None, vec![format!("{}={v}", sweep.key)])).collect())
        .chain((!seeds.is_empty()).then_some(seeds))
        .collect();
    let caption = |seed: Option<u64>, set: &[String]| {
        let parts = seed.map(|s| format!("seed {s}")).into_iter().chain(set.iter().map(|s| s.replace('=', " = ")));
        parts.collect::<Vec<_>>().join(", ")
    };
    let cell = |seed: Option<u64>, set: Vec<String>| {
        let text = caption(seed, &set);
        (Change { seed, set }, text)
    };
    match &lines[..] {
        [across, down] => {
            let cells = down.iter().flat_map(|d| across.iter().map(move |a| (a, d)));
            let all = cells.map(|(a, d)| cell(a.0.or(d.0), [a.1.clone(), d.1.clone()].concat()));
            (all.collect(), across.len())
        }
        [line, ..] => (line.iter().map(|(s, set)| cell(*s, set.clone())).collect(), columns(line.len())),
        [] => (Vec::new(), 1),
    }
}
