//! `osier grow`.

use std::io::IsTerminal as _;
use std::path::Path;
use std::sync::Arc;

use serde_json::json;

use super::args::{Grow, ProfileArg};
use super::bake::LARGE;
use super::list::endings;
use super::progress::Show;
use super::{Context, report, source};
use crate::bake::output::{exporters, frame_loop, single_file};
use crate::bake::{BakeContext, scene};
use crate::recipe::resolve;
use osier_base::Result;
use osier_base::files::{Folder, WriteOptions};
use osier_export::registry;
use osier_export::textures::Textures;

/// Runs it.
pub fn run(context: &Context, args: &Grow) -> Result<u8> {
    let to_pipe = args.output == Path::new("-");
    let name = if to_pipe { "stdout.glb".into() } else { file_name(&args.output) };
    let ending = name.rsplit_once('.').map(|(_, e)| e.to_ascii_lowercase()).unwrap_or_default();
    if !endings().any(|(e, _)| e == ending) {
        let known: Vec<String> = endings().map(|(e, _)| format!(".{e}")).collect();
        let why = format!("\"{}\" has no known ending; one of {}", args.output.display(), known.join(" "));
        context.console.complain(&why);
        return Ok(2);
    }
    if to_pipe && std::io::stdout().is_terminal() {
        context.console.complain("a binary file would fill the terminal; send it into a file or program: -o - > x.glb");
        return Ok(2);
    }
    let picture = matches!(ending.as_str(), "png" | "exr");
    let mut request =
        if picture { source::picture(context, &args.source)? } else { source::request(context, &args.source)? };
    request.steps = args.steps;
    let (mut recipe, warnings) = resolve(&request)?;
    context.console.report(&warnings);
    recipe.clip.end = recipe.clip.start;
    if matches!(ending.as_str(), "ifs" | "flame") {
        return super::coefficients::run(context, args, &recipe, &warnings);
    }
    let show = Show::new(&context.console);
    let work = BakeContext { limits: &context.limits, cancel: &context.cancel, progress: &show, cache: None };
    let mut warned = !warnings.diagnostics.is_empty();
    if picture {
        return super::picture::run(context, args, &recipe, warned);
    }
    let parts = scene::SceneParts { ground: false };
    let dry = context.common.dry_run;
    let built = if dry {
        scene::assemble_for_estimate(&recipe, parts, &work)
    } else {
        scene::assemble_scene(&recipe, parts, &work)
    };
    show.done();
    let built = built?;
    context.console.report(&built.report);
    warned |= !built.report.diagnostics.is_empty();
    let web = args.profile == ProfileArg::Web;
    let Some(format) = registry::by_ending(&ending) else { return Ok(2) };
    single_file::refuse_empty(&built.animated, &ending)?;
    let counts = single_file::estimate_file(&built, &recipe, format, web);
    context.limits.check("output-bytes", counts.bytes, "the predicted size of the output, in bytes,")?;
    context.limits.check("memory", counts.peak(), "the predicted peak of memory, in bytes,")?;
    if context.common.dry_run {
        report::counts(context, &args.output.display().to_string(), &counts)?;
        return Ok(context.strict(warned));
    }
    if counts.bytes > LARGE && !args.force {
        let (size, most) = (report::size(counts.bytes), report::size(LARGE));
        let why = format!("this would write about {size}, more than {most}; --force writes it");
        context.console.complain(&why);
        return Ok(2);
    }
    let (folder, parent) = if to_pipe { (Folder::memory(), Path::new(".")) } else { beside(context, args)? };
    let textures = Arc::new(Textures::encode(&built.animated.scene)?);
    let Some(writer) = exporters::file_exporter(folder.clone(), &name, &textures, &recipe, web) else { return Ok(2) };
    let told = frame_loop::write_frames(&built.animated, &mut [writer], &[], &work);
    show.done();
    let told = told?;
    folder.finish()?;
    for w in &told {
        context.console.note(&format!("warning[{}]: {}", w.code, w.message));
    }
    if to_pipe {
        context.console.artefact(&folder.take(&name).unwrap_or_default())?;
    } else {
        result(context, parent, &folder)?;
    }
    Ok(context.strict(warned || !told.is_empty()))
}

/// The folder that the file asked for goes to, and where it is.
pub(super) fn beside<'a>(context: &Context, args: &'a Grow) -> Result<(Folder, &'a Path)> {
    let parent = args.output.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let options = WriteOptions { force: args.force, cancel: context.cancel.clone(), ..WriteOptions::default() };
    Ok((Folder::plain(parent, options)?, parent))
}

pub(super) fn file_name(path: &Path) -> String {
    path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default()
}

pub(super) fn result(context: &Context, parent: &Path, folder: &Folder) -> Result<()> {
    let here = parent == Path::new(".");
    let path = |p: &str| if here { p.to_owned() } else { parent.join(p).display().to_string() };
    let files = folder.files();
    if context.console.json {
        let row = |f: &osier_base::files::FileRecord| json!({ "path": path(&f.path), "kind": f.kind, "bytes": f.bytes, "blake3": f.blake3 });
        let value: Vec<serde_json::Value> = files.iter().map(row).collect();
        return context.console.result(&format!("{:#}\n", json!({ "files": value })));
    }
    if context.console.quiet {
        return Ok(());
    }
    let lines: Vec<String> = files.iter().map(|f| path(&f.path)).collect();
    context.console.result(&format!("{}\n", lines.join("\n")))
}
