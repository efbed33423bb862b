//! `osier grow`: one still plant or scene, picture or coefficient table as one file.

use std::io::IsTerminal as _;
use std::path::Path;

use serde_json::json;

use super::args::{Grow, ProfileArg};
use super::progress::ProgressDisplay;
use super::report::shell_word;
use super::{Context, check_output, report, unreadable_name};
use crate::bake::BakeContext;
use crate::recipe::{Growth, Recipe, resolve};
use crate::single_file::{
    CoefficientTables, DerivedText, PictureEncoding, SingleFileFormat, StillScene, TableFormat, endings, write_picture,
};
use crate::source::{find_picture, find_scene};
use osier_base::Result;
use osier_base::diagnostic::Report;
use osier_base::files::{FileRecord, Folder, WriteOptions, folder_of, name_of};
use osier_export::format::FormatInfo;
use osier_export::gltf::{self, Profile};
use osier_export::usd;

/// Runs `osier grow`: the ending of the output chooses the format. The result is the exit code.
pub fn run(context: &Context, args: &Grow) -> Result<u8> {
    if let Some(why) = unreadable_name(&args.output) {
        context.console.complain(&why);
        return Ok(2);
    }
    let to_pipe = args.output == Path::new("-");
    // Standard output has no name with an ending: it gets a glb, the format that is a single binary file.
    let name = if to_pipe { "stdout.glb".into() } else { name_of(&args.output) };
    let Some(format) = SingleFileFormat::of_file(&name) else {
        let known: Vec<String> = endings().map(|(e, _)| format!(".{e}")).collect();
        let why = format!("\"{}\" has no known ending; one of {}", args.output.display(), known.join(" "));
        context.console.complain(&why);
        return Ok(2);
    };
    if args.profile == ProfileArg::Engine {
        context.console.complain(&format!(
            "--profile: profile engine is a file for each plant and a table of placements, which `osier grow` does not write; run \
             `osier bake {} --formats glb --set 'output.gltf.profiles=[\"engine\"]'`",
            shell_word(&args.source)
        ));
        return Ok(2);
    }
    // A terminal would interpret bytes of a glb as control sequences.
    if to_pipe && std::io::stdout().is_terminal() {
        context.console.complain("standard output is a terminal; redirect the binary file: -o - > x.glb");
        return Ok(2);
    }
    if !to_pipe && !context.common.dry_run {
        // A string cannot name its maker: it is compared with the file once it is derived.
        let is_text = matches!(format, SingleFileFormat::DerivedText);
        check_output(context, &args.output, args.force || is_text)?;
    }
    let is_gltf = matches!(format, SingleFileFormat::Scene(format) if format.word == gltf::FORMAT.word);
    if args.profile == ProfileArg::Web && !is_gltf {
        context.console.note(&format!("note: --profile has no effect on \"{name}\"; profiles are of .glb and .gltf"));
    }
    // For a picture, a table that could grow a tree is read as an attractor.
    let is_picture = matches!(format, SingleFileFormat::Picture(_));
    let find = if is_picture { find_picture } else { find_scene };
    let mut request = find(&args.source, &context.sources)?;
    request.steps = args.steps;
    let (mut recipe, warnings) = resolve(&request)?;
    context.console.report(&warnings);
    // A still file has the first frame only.
    recipe.clip.end = recipe.clip.start;
    let output = OutputFile { args, name: &name, to_pipe };
    match format {
        SingleFileFormat::Scene(format) => write_scene(context, &output, &recipe, format, &warnings),
        SingleFileFormat::Picture(encoding) => write_attractor(context, &output, &recipe, encoding, &warnings),
        SingleFileFormat::Coefficients(format) => write_coefficients(context, &output, &recipe, format, &warnings),
        SingleFileFormat::DerivedText => write_string(context, &output, &recipe, &warnings),
    }
}

/// The file that the command line names.
struct OutputFile<'a> {
    args: &'a Grow,
    name: &'a str,
    /// Whether the file is written to standard output.
    to_pipe: bool,
}

impl OutputFile<'_> {
    /// Opens the folder into which the file is written; a folder in memory for standard output.
    fn folder(&self, context: &Context) -> Result<Folder> {
        if self.to_pipe {
            return Ok(Folder::memory());
        }
        let options =
            WriteOptions { force: self.args.force, cancel: context.cancel.clone(), ..WriteOptions::default() };
        Folder::plain(folder_of(&self.args.output), options)
    }

    /// Prints what a dry run would write: as text, or with the counts of `would_make` as JSON.
    fn print_plan(&self, context: &Context, text: &str, would_make: &serde_json::Value) -> Result<()> {
        let target = self.args.output.display().to_string();
        if context.console.json {
            return context.console.result(&format!("{:#}\n", json!({ "target": target, "would_make": would_make })));
        }
        context.console.result(&format!("{target}\n  {text}\n"))
    }

    /// Closes the folder, then sends the file to standard output or prints the paths of what was written.
    fn finish(&self, context: &Context, folder: &Folder) -> Result<()> {
        folder.finish()?;
        if self.to_pipe {
            context.console.note_unprinted_json();
            return context.console.artefact(&folder.take(self.name).unwrap_or_default());
        }
        // Paths are printed as a user would type them, without "./".
        let parent = folder_of(&self.args.output);
        let is_here = parent == Path::new(".");
        let path = |p: &str| if is_here { p.to_owned() } else { parent.join(p).display().to_string() };
        let files = folder.files();
        if context.console.json {
            let row =
                |f: &FileRecord| json!({ "path": path(&f.path), "kind": f.kind, "bytes": f.bytes, "blake3": f.blake3 });
            let value: Vec<serde_json::Value> = files.iter().map(row).collect();
            return context.console.result(&format!("{:#}\n", json!({ "files": value })));
        }
        if context.console.quiet {
            return Ok(());
        }
        let lines: Vec<String> = files.iter().map(|f| path(&f.path)).collect();
        context.console.result(&format!("{}\n", lines.join("\n")))
    }
}

fn write_scene(
    context: &Context,
    output: &OutputFile<'_>,
    recipe: &Recipe,
    format: &'static FormatInfo,
    warnings: &Report,
) -> Result<u8> {
    let display = ProgressDisplay::new(&context.console);
    let work = BakeContext { limits: &context.limits, cancel: &context.cancel, progress: &display, cache: None };
    let is_dry_run = context.common.dry_run;
    let scene =
        if is_dry_run { StillScene::assemble_for_estimate(recipe, &work) } else { StillScene::assemble(recipe, &work) };
    display.done();
    let scene = scene?;
    context.console.report(scene.report());
    let warned = !warnings.diagnostics.is_empty() || !scene.report().diagnostics.is_empty();
    // The estimate is refused, printed or confirmed before any file is opened.
    let profile = if output.args.profile == ProfileArg::Web { Profile::Web } else { Profile::Blender };
    let estimate = scene.estimate(format, profile)?;
    estimate.check_limits(&context.limits)?;
    if is_dry_run {
        report::print_estimate(context, &output.args.output.display().to_string(), &estimate)?;
        return Ok(context.strict(warned));
    }
    if estimate.bytes > report::CONFIRM_BYTES && !output.args.force {
        let (size, most) = (report::byte_size(estimate.bytes), report::byte_size(report::CONFIRM_BYTES));
        // Formats without instances hold every leaf, USD the shape of each prototype.
        let shared = scene.estimate(&usd::FORMAT, profile)?.bytes;
        let smaller = if shared < estimate.bytes / 2 {
            format!("a .usdc holds copies once and takes about {}, ", report::byte_size(shared))
        } else {
            String::new()
        };
        let why = format!("the file would take about {size}, more than {most}; {smaller}--force writes it");
        context.console.complain(&why);
        return Ok(2);
    }
    let folder = output.folder(context)?;
    let written = scene.write(output.name, &folder, profile, &work);
    display.done();
    let export_warnings = written?;
    for w in &export_warnings {
        context.console.warning(w.code, &w.message);
    }
    output.finish(context, &folder)?;
    Ok(context.strict(warned || !export_warnings.is_empty()))
}

fn write_attractor(
    context: &Context,
    output: &OutputFile<'_>,
    recipe: &Recipe,
    encoding: PictureEncoding,
    warnings: &Report,
) -> Result<u8> {
    let warned = !warnings.diagnostics.is_empty();
    if !recipe.layers.is_empty() && encoding != PictureEncoding::Png {
        context.console.complain("a picture of layers is written as .png");
        return Ok(2);
    }
    if recipe.layers.is_empty() && recipe.clouds.is_empty() {
        let source = &output.args.source;
        let why = format!(
            "\"{source}\" holds no attractor, of which `osier grow` writes .png and .exr; `osier preview {source}` renders a picture of it"
        );
        context.console.complain(&why);
        return Ok(2);
    }
    if let Some(first) = recipe.clouds.first().filter(|_| recipe.layers.is_empty())
        && recipe.clouds.len() + recipe.plants.len() > 1
    {
        let text = format!("note: the picture shows \"{}\" alone; osier preview renders the whole scene", first.id);
        context.console.note(&text);
    }
    // The size of a picture is known without drawing it.
    if context.common.dry_run {
        let keys = &recipe.picture;
        let text = format!("{} x {} pixels", keys.width, keys.height);
        output.print_plan(context, &text, &json!({ "width": keys.width, "height": keys.height }))?;
        return Ok(context.strict(warned));
    }
    let display = ProgressDisplay::new(&context.console);
    let work = BakeContext { limits: &context.limits, cancel: &context.cancel, progress: &display, cache: None };
    let folder = output.folder(context)?;
    let written = write_picture(recipe, encoding, output.name, &folder, &work);
    display.done();
    written?;
    output.finish(context, &folder)?;
    Ok(context.strict(warned))
}

fn write_coefficients(
    context: &Context,
    output: &OutputFile<'_>,
    recipe: &Recipe,
    format: TableFormat,
    warnings: &Report,
) -> Result<u8> {
    // Clouds and plants grown by tables have coefficients.
    if recipe.clouds.is_empty() && !recipe.plants.iter().any(|p| matches!(p.growth, Growth::Ifs(..))) {
        let source = &output.args.source;
        let why = format!("\"{source}\" holds no coefficients; .ifs and .flame are for tables and their trees");
        context.console.complain(&why);
        return Ok(2);
    }
    let tables = CoefficientTables::encode(recipe, format)?;
    let warned = !warnings.diagnostics.is_empty() || !tables.report.diagnostics.is_empty();
    context.console.report(&tables.report);
    if context.common.dry_run {
        let text = format!("{} systems", tables.systems);
        output.print_plan(context, &text, &json!({ "systems": tables.systems }))?;
        return Ok(context.strict(warned));
    }
    let folder = output.folder(context)?;
    folder.write(output.name, "ifs", tables.text.as_bytes())?;
    output.finish(context, &folder)?;
    Ok(context.strict(warned))
}

fn write_string(context: &Context, output: &OutputFile<'_>, recipe: &Recipe, warnings: &Report) -> Result<u8> {
    if !recipe.plants.iter().any(|p| matches!(p.growth, Growth::Grammar(_))) {
        let why = format!("\"{}\" has no grammar; .txt is for derived strings", output.args.source);
        context.console.complain(&why);
        return Ok(2);
    }
    let display = ProgressDisplay::new(&context.console);
    let work = BakeContext { limits: &context.limits, cancel: &context.cancel, progress: &display, cache: None };
    let derived = DerivedText::derive(recipe, &work);
    display.done();
    let derived = derived?;
    let warned = !warnings.diagnostics.is_empty() || !derived.report.diagnostics.is_empty();
    context.console.report(&derived.report);
    if context.common.dry_run {
        let (bytes, modules) = (derived.text.len() as u64, derived.modules);
        let text = format!("{modules} modules, {}", report::byte_size(bytes));
        output.print_plan(context, &text, &json!({ "modules": modules, "bytes": bytes }))?;
        return Ok(context.strict(warned));
    }
    let folder = output.folder(context)?;
    folder.write(output.name, "string", derived.text.as_bytes())?;
    output.finish(context, &folder)?;
    Ok(context.strict(warned))
}
