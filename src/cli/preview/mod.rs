//! `osier preview`: pictures, contact sheets, turntables and clips.

mod clips;
mod flags;
mod sheets;
mod source;

use std::io::IsTerminal as _;
use std::path::{Path, PathBuf};

use serde_json::json;

use super::args::Preview;
use super::progress::ProgressDisplay;
use super::{Context, check_output};
use crate::bake::BakeContext;
use crate::bake::assets::layered_picture;
use crate::recipe::Recipe;
use crate::single_file::canvas_image;
use crate::source::{entry_sources, is_plane_drawing};
use flags::PreviewFlags;
use osier_base::Result;
use osier_base::files::{FileRecord, Folder, WriteOptions, check_writable, folder_of, name_of};
use osier_export::{GENERATOR, textures};
use osier_preview::{Picture, Quality};
use osier_scene::Scene;

/// Runs `osier preview`: a picture, a contact sheet or a clip, depending on flags and source. The result is the exit code.
pub fn run(context: &Context, args: &Preview) -> Result<u8> {
    let mut flags = match PreviewFlags::new(context, args) {
        Ok(flags) => flags,
        Err(why) => {
            context.console.complain(&why);
            return Ok(2);
        }
    };
    // A terminal would interpret bytes of a picture as control sequences.
    if is_to_pipe(args) && std::io::stdout().is_terminal() {
        context.console.complain("standard output is a terminal; redirect the picture: -o - > x.png");
        return Ok(2);
    }
    // Whether the picture can be written is checked first, since rendering may take minutes.
    if !context.common.dry_run && !is_to_pipe(args) {
        match &args.output {
            Some(output) => check_output(context, output, args.force)?,
            None => check_writable(Path::new("out"))?,
        }
    }
    if let Some(flag) = flag_unfit_for_meshes(context, args) {
        context.console.complain(&format!(
            "{flag}: \"{}\" is a finished mesh, which no seed, key or step changes; preview its scene",
            args.source
        ));
        return Ok(2);
    }
    // A picture of layers has a fixed size, and no space for a camera.
    if let Some((recipe, report)) = source::layered_picture(context, args)? {
        context.console.report(&report);
        if let Some(flag) = flag_unfit_for_layers(args) {
            let why = format!(
                "{flag}: \"{}\" is a picture of layers, which only --size, --seed and --set change",
                args.source
            );
            context.console.complain(&why);
            return Ok(2);
        }
        return write_layers(context, args, recipe, &flags, !report.diagnostics.is_empty());
    }
    let display = ProgressDisplay::new(&context.console);
    let work = BakeContext { limits: &context.limits, cancel: &context.cancel, progress: &display, cache: None };
    let entries = entry_sources(&args.source, &context.limits)?;
    // The sheet of a file's L-systems is one picture: a clip in its place would be that picture in a file named as a clip.
    if let [first, _, ..] = &entries[..]
        && let Some(flag) = flag_unfit_for_entries(args)
    {
        let why = format!("{flag}: \"{}\" has {} L-systems; name one, such as \"{first}\"", args.source, entries.len());
        context.console.complain(&why);
        return Ok(2);
    }
    if args.columns.is_some() && entries.len() < 2 && !flags.is_sheet() {
        let why = "--columns: it arranges the pictures of a contact sheet; add --seeds 0-8 or a --sweep";
        context.console.complain(why);
        return Ok(2);
    }
    if args.view.is_none() && is_plane_drawing(&args.source, &context.limits)? {
        flags.options.view = Some(flags::front());
    }
    // The sheet of a file's L-systems has small pictures.
    if entries.len() > 1 && args.size.is_none() && !flags.is_sheet() {
        flags.options.size = [320, 320];
    }
    // Several seeds make a contact sheet; several frames or a turntable make a clip; else a single picture.
    let outcome = if flags.is_sheet() {
        sheets::run(context, args, &flags, &work)
    } else if entries.len() > 1 {
        sheets::entries(context, args, &entries, &flags, &work)
    } else if !flags.frames.is_empty() || args.turntable.is_some() {
        clips::run(context, args, &flags, &work)
    } else {
        sheets::single(context, args, &flags, &work)
    };
    display.done();
    match outcome? {
        Outcome::Written { warned } => Ok(context.strict(warned)),
        Outcome::Refused(why) => {
            context.console.complain(&why);
            Ok(2)
        }
    }
}

/// Whether the picture goes to standard output: `-o -`.
fn is_to_pipe(args: &Preview) -> bool {
    args.output.as_deref() == Some(Path::new("-"))
}

/// The first flag given that changes how a scene is made, if all sources are meshes or bakes, which are made already.
fn flag_unfit_for_meshes(context: &Context, args: &Preview) -> Option<&'static str> {
    if !std::iter::once(&args.source).chain(&args.compare).all(|name| source::is_finished(name)) {
        return None;
    }
    let given = [
        ("--seeds", args.seeds.is_some()),
        ("--sweep", !args.sweep.is_empty()),
        ("--seed", context.sources.seed.is_some()),
        ("--set", !context.sources.set.is_empty()),
        ("--steps", args.steps.is_some()),
    ];
    given.iter().find(|flag| flag.1).map(|flag| flag.0)
}

/// The first flag given for a camera, for light or for several pictures, of which a picture of layers has neither.
fn flag_unfit_for_layers(args: &Preview) -> Option<&'static str> {
    let given = [
        ("--view", args.view.is_some()),
        ("--sun", args.sun.is_some()),
        ("--background", args.background.is_some()),
        ("--frame", args.frame.is_some()),
        ("--frames", args.frames.is_some()),
        ("--turntable", args.turntable.is_some()),
        ("--seeds", args.seeds.is_some()),
        ("--sweep", !args.sweep.is_empty()),
        ("--columns", args.columns.is_some()),
        ("--compare", args.compare.is_some()),
    ];
    given.iter().find(|flag| flag.1).map(|flag| flag.0)
}

/// The first given flag that is for clips or comparisons; a sheet of the L-systems of a file is neither.
fn flag_unfit_for_entries(args: &Preview) -> Option<&'static str> {
    let given = [
        ("--frames", args.frames.is_some()),
        ("--turntable", args.turntable.is_some()),
        ("--compare", args.compare.is_some()),
    ];
    given.iter().find(|flag| flag.1).map(|flag| flag.0)
}

/// Composes a picture of layers in the size of its keys, or in that of `--size`.
fn write_layers(
    context: &Context,
    args: &Preview,
    mut recipe: Recipe,
    flags: &PreviewFlags,
    warned: bool,
) -> Result<u8> {
    if args.size.is_some() {
        [recipe.picture.width, recipe.picture.height] = flags.options.size;
    }
    let display = ProgressDisplay::new(&context.console);
    let work = BakeContext { limits: &context.limits, cancel: &context.cancel, progress: &display, cache: None };
    let canvas = layered_picture::compose(&recipe, &work)?;
    display.done();
    let target = OutputPicture::new(context, args, &recipe.name, "png")?;
    target.folder.write(&target.name, "preview", &textures::png(&canvas_image(&canvas, &recipe)?)?)?;
    target.finish(context, [recipe.picture.width, recipe.picture.height], 1)?;
    Ok(context.strict(warned))
}

/// Outcome of a run without errors.
enum Outcome {
    /// The file is complete; `warned`: whether there were warnings.
    Written { warned: bool },
    /// A flag does not fit the source: a usage error with this message.
    Refused(String),
}

/// Text chunks of a PNG: title, hash and seed of its scene.
fn notes(scene: &Scene, title: &str) -> [(&'static str, String); 3] {
    let origin = format!("scene {}, seed {}", scene.hash, scene.seed);
    [("Software", GENERATOR.to_owned()), ("Title", title.to_owned()), ("Source", origin)]
}

/// The name of one of several pictures: its first run of two or more `#` replaced by a number of at least as many digits; `None` for
/// a name without one.
fn numbered(name: &str, number: u32) -> Option<String> {
    let (before, rest) = name.split_once("##")?;
    let after = rest.trim_start_matches('#');
    let digits = 2 + rest.len() - after.len();
    Some(format!("{before}{number:0digits$}{after}"))
}

/// The file into which a preview is written, in its opened folder; of numbered pictures `name` and `path` have `####` for the number.
struct OutputPicture {
    folder: Folder,
    name: String,
    path: PathBuf,
    /// Whether it is sent to standard output when it is complete.
    to_pipe: bool,
}

impl OutputPicture {
    /// Opens the folder of the output: that of `-o`, else `out` with the file `NAME.ENDING`; a folder in memory for standard output
    /// and a dry run.
    fn new(context: &Context, args: &Preview, name: &str, ending: &str) -> Result<Self> {
        let path = args.output.clone().unwrap_or_else(|| Path::new("out").join(format!("{name}.{ending}")));
        let options = WriteOptions { force: args.force, cancel: context.cancel.clone(), ..WriteOptions::default() };
        // A folder in memory has portable names only.
        let to_pipe = is_to_pipe(args) && !context.common.dry_run;
        let (folder, name) = if context.common.dry_run || to_pipe {
            (Folder::memory(), format!("preview.{ending}"))
        } else {
            (Folder::plain(folder_of(&path), options)?, name_of(&path))
        };
        Ok(Self { folder, name, path, to_pipe })
    }

    /// Writes a picture with title, hash and seed of its scene as PNG text chunks, and prints its path.
    fn write(&self, context: &Context, picture: &Picture, quality: Quality, scene: &Scene, title: &str) -> Result<()> {
        let png = picture.png(&notes(scene, title), quality.prefers_speed())?;
        self.folder.write(&self.name, "preview", &png)?;
        self.finish(context, [picture.width, picture.height], 1)
    }

    /// Closes the folder, then sends the file to standard output or prints its path, size and number of frames.
    fn finish(&self, context: &Context, [width, height]: [u32; 2], frames: usize) -> Result<()> {
        self.folder.finish()?;
        if self.to_pipe {
            context.console.note_unprinted_json();
            return context.console.artefact(&self.folder.take(&self.name).unwrap_or_default());
        }
        if context.console.json {
            // In a dry run the names in the folder differ from those of the command line.
            let name = name_of(&self.path);
            let path = |f: &FileRecord| match f.frame.and_then(|number| numbered(&name, number)) {
                Some(name) => self.path.with_file_name(name).display().to_string(),
                None => self.path.display().to_string(),
            };
            let row = |f: &FileRecord| json!({ "path": path(f), "kind": f.kind, "bytes": f.bytes, "blake3": f.blake3 });
            let files: Vec<_> = self.folder.files().iter().map(row).collect();
            let value = json!({ "files": files, "width": width, "height": height, "frames": frames });
            return context.console.result(&format!("{value:#}\n"));
        }
        if context.console.quiet {
            return Ok(());
        }
        let frames = if frames > 1 { format!(", {frames} frames") } else { String::new() };
        context.console.result(&format!("{}  {width} x {height}{frames}\n", self.path.display()))
    }
}
