//! `osier bake`: all files of a scene into a folder.

use std::path::Path;

use serde_json::json;

use super::Context;
use super::args::Bake;
use super::progress::{ProgressDisplay, StageTimer};
use super::{numbers, report, sweep};
use crate::bake::cache::ifs_leaves;
use crate::bake::output::single_file::refuse_without_visible_plants;
use crate::bake::output::unselected::warn_of_unselected_grids;
use crate::bake::scene;
use crate::bake::{self, BakeContext};
use crate::recipe::{Recipe, resolve};
use crate::source::find_scene;
use osier_base::diagnostic::nearest;
use osier_base::files::{BakeCache, Folder, WriteOptions, check_writable, has_finished_files, is_settled};
use osier_base::{Error, Result};
use osier_export::format::FormatInfo;
use osier_export::gltf::Profile;
use osier_export::manifest::{self, Manifest};
use osier_export::{VERSION, registry};

/// Hash of the sources from which this program was built: the output of a build with other sources is not up to date, even with
/// the same version.
const SOURCES: &str = env!("OSIER_SOURCES");

/// Runs `osier bake`, or a sweep if its flags ask for one; the result is the exit code.
pub fn run(context: &Context, args: &Bake) -> Result<u8> {
    if args.output.as_deref() == Some(Path::new("-")) {
        let why = "-o: a bake is a folder of files; `osier grow SOURCE -o -` writes a single glb to standard output";
        context.console.complain(why);
        return Ok(2);
    }
    if !args.sweep.is_empty() || args.seeds.is_some() {
        return sweep::run(context, args);
    }
    let formats = match args.formats.as_deref().map(format_list).transpose() {
        Ok(formats) => formats,
        Err(why) => {
            context.console.complain(&why);
            return Ok(2);
        }
    };
    let mut request = find_scene(args.scene.as_deref().unwrap_or("showcase"), &context.sources)?;
    // The flag becomes an override of the scene's key, so that it is hashed like any other.
    request.set.extend(formats.map(|formats| format!("output.formats={formats}")));
    let (recipe, warnings) = resolve(&request)?;
    context.console.report(&warnings);
    let frames = match selection(context, args, &recipe) {
        Ok(frames) => frames,
        Err(why) => {
            context.console.complain(&why);
            return Ok(2);
        }
    };
    // Report before anything is simulated: the selection and the recipe determine which grids have no frame.
    let unselected = warn_of_unselected_grids(&recipe, &frames);
    context.console.report(&unselected);
    // The default folder is named after the scene.
    let root = args.output.clone().unwrap_or_else(|| Path::new("out").join(&recipe.name));
    // Warnings of the scene's text and of the selected frames, which the manifest does not contain.
    let warning_count = warnings.diagnostics.len() + unselected.diagnostics.len();
    let hash = recipe.hash_of_frames(&frames);
    if !context.common.dry_run
        && let Some(manifest) = current(context, &root, &hash)
    {
        // The same warnings as after the bake that wrote the files, so that `--strict` and `--json` say the same.
        manifest.warnings.iter().for_each(|w| context.console.warning(&w.code, &w.message));
        context.console.note(&format!("\"{}\" is up to date", root.display()));
        let finished = FinishedBake { root: &root, manifest: &manifest, other_warnings: warning_count, stages: None };
        summary(context, &recipe, &finished)?;
        return Ok(context.strict(warning_count > 0 || !manifest.warnings.is_empty()));
    }
    if !context.common.dry_run {
        check_writable(&root)?;
        // A manifest or a journal that osier did not write is refused before anything grows.
        if root.is_dir() && !args.force {
            open(context, args, &hash, &root)?;
        }
    }
    let request = RequestedBake { recipe: &recipe, frames: &frames, root: &root, hash: &hash, warning_count };
    match bake_frames(context, args, &request) {
        Err(e @ Error::Cancelled { .. }) if !context.common.dry_run && has_finished_files(&root, &key(&hash)) => {
            context.console.complain(&format!("{e}; finished files are kept, run again to go on"));
            Ok(e.exit_code())
        }
        other => other,
    }
}

/// A bake whose flags have been checked, into a folder that is not up to date.
struct RequestedBake<'a> {
    recipe: &'a Recipe,
    /// Numbers of the frames to write; empty for a still scene.
    frames: &'a [u32],
    root: &'a Path,
    /// Hash of the scene and its frames.
    hash: &'a str,
    /// Number of warnings so far.
    warning_count: usize,
}

/// Assembles the scene and writes its files, or prints their estimate; the result is the exit code.
fn bake_frames(context: &Context, args: &Bake, request: &RequestedBake<'_>) -> Result<u8> {
    let RequestedBake { recipe, frames, root, hash, warning_count } = *request;
    let display = ProgressDisplay::new(&context.console);
    let timer = StageTimer::new(&display);
    let memory = bake::lattice_memory(recipe);
    if context.common.dry_run && !memory.is_empty() {
        // The memory is printed even if the scene then exceeds a limit.
        context.console.note(&report::lattice_memory_text(&memory));
    }
    let solids = bake::solids_in_cells(recipe);
    if !solids.is_empty() {
        context.console.note(&report::solids_in_cells_text(&solids));
    }
    // Reuse results of an earlier bake into this folder: drawn leaves here, the spun-up wind by the cache below.
    ifs_leaves::load(recipe, root, &context.limits);
    let stores = !context.common.dry_run && stores_spin_up(recipe);
    let cache = if stores { Some(BakeCache::new(open(context, args, hash, root)?)) } else { None };
    let work =
        BakeContext { limits: &context.limits, cancel: &context.cancel, progress: &timer, cache: cache.as_ref() };
    // Assemble the scene; a dry run grows a sample and simulates nothing.
    let parts = scene::SceneOptions::BAKE;
    let mut built = if context.common.dry_run {
        scene::assemble_for_estimate(recipe, parts, &work)?
    } else {
        scene::assemble_scene(recipe, parts, &work)?
    };
    display.done();
    // Messages of the cache are printed after the progress bar has been removed.
    let messages = cache.iter().flat_map(BakeCache::take_messages);
    messages.for_each(|text| context.console.note(&format!("note: {text}")));
    context.console.report(&built.report);
    if let Some(why) = bake::missing_frames(recipe, &built.animated, frames) {
        context.console.complain(&format!("--frames: {why}"));
        return Ok(2);
    }
    // The following checks may refuse the bake, and precede the first file of the output.
    refuse_without_visible_plants(&built.animated.scene)?;
    let counts = built.estimate(recipe, frames);
    counts.check_limits(&context.limits)?;
    if context.common.dry_run {
        report::print_estimate(context, &root.display().to_string(), &counts)?;
        return Ok(context.strict(warning_count > 0 || !built.report.diagnostics.is_empty()));
    }
    if counts.bytes > report::CONFIRM_BYTES && !args.force {
        let (size, most) = (report::byte_size(counts.bytes), report::byte_size(report::CONFIRM_BYTES));
        context.console.complain(&format!(
            "the bake would write about {size}, more than {most}; --dry-run shows the size of each format. Fewer --formats, \
             motion = \"skin\", a larger output.pov.step or fewer frames reduce it; --force writes it"
        ));
        return Ok(2);
    }
    // Write the files, and report what the user should know of them.
    context.console.note(&format!("writing about {}", sizes(counts.bytes, &counts.sizes)));
    let folder = match &cache {
        Some(cache) => cache.folder().clone(),
        None => open(context, args, hash, root)?,
    };
    let written = bake::write_files(recipe, &mut built, frames, &folder, &work);
    display.done();
    let replaced = folder.replaced_changes();
    if let Some(first) = replaced.first() {
        let others = if replaced.len() > 1 { format!(" and {} more", replaced.len() - 1) } else { String::new() };
        context.console.note(&format!(
            "note: replaced {first}{others}, changed since osier wrote it; files under names that osier does not write stay as they are"
        ));
    }
    let (manifest, export_warnings) = written?;
    for w in &export_warnings {
        context.console.warning(w.code, &w.message);
    }
    for format in formats_without_files(recipe, &manifest) {
        let (word, about) = (format.word, format.about);
        context.console.note(&format!("note: format {word} has no file, since the scene has nothing for it ({about})"));
    }
    let stages = Some(timer.seconds());
    summary(context, recipe, &FinishedBake { root, manifest: &manifest, other_warnings: warning_count, stages })?;
    Ok(context.strict(warning_count > 0 || !manifest.warnings.is_empty()))
}

/// Formats of the recipe without a file in the bake, because the scene has nothing that they store.
fn formats_without_files(recipe: &Recipe, manifest: &Manifest) -> Vec<&'static FormatInfo> {
    let files = manifest.expanded();
    let is_in = |path: &str, folder: &str| path.split_once('/').is_some_and(|(first, _)| first == folder);
    let lacks_files =
        |format: &&FormatInfo| format.notes_missing_files && !files.iter().any(|file| is_in(&file.0, format.folder));
    recipe.output.keys.formats.iter().map(|format| format.0).filter(lacks_files).collect()
}

/// The list of `--formats` as a value of the key `output.formats`.
/// # Errors
/// A message for a word that is no format.
fn format_list(list: &str) -> std::result::Result<String, String> {
    let quoted = |word: &str| match registry::by_word(word) {
        Some(format) => Ok(format!("\"{}\"", format.word)),
        None => Err(match nearest(word, registry::FORMATS.iter().map(|f| f.word)) {
            Some(near) => format!("--formats: \"{word}\" is no format; did you mean \"{near}\"?"),
            None => format!("--formats: \"{word}\" is no format; one of {}", registry::words()),
        }),
    };
    let words = list.split(',').map(|word| quoted(word.trim())).collect::<std::result::Result<Vec<_>, _>>()?;
    Ok(format!("[{}]", words.join(",")))
}

/// Numbers of the frames to write; empty for a still scene.
/// # Errors
/// A message for a list that cannot be read or that leaves the clip.
fn selection(context: &Context, args: &Bake, recipe: &Recipe) -> std::result::Result<Vec<u32>, String> {
    let (start, end) = (recipe.clip.start, recipe.clip.end);
    let is_still = recipe.clip.len() == 1;
    let Some(list) = &args.frames else {
        return Ok(if is_still { Vec::new() } else { (start..=end).collect() });
    };
    let frames = numbers::frame_list(list, context.limits.get("frames")).map_err(|e| format!("--frames: {e}"))?;
    if let Some(outside) = frames.iter().find(|f| !(start..=end).contains(f)) {
        return Err(match is_still {
            // A longer clip does not hold frames before its first.
            true if *outside > start => format!(
                "--frames: frame {outside} is outside the scene, which has the one frame {start}; --set frames.end={outside} makes it longer"
            ),
            true => format!("--frames: frame {outside} is outside the scene, which has the one frame {start}"),
            false => format!("--frames: frame {outside} is outside the scene's {start} to {end}"),
        });
    }
    // The only frame is the whole still scene: the list changes nothing.
    if is_still {
        return Ok(Vec::new());
    }
    Ok(frames)
}

/// The manifest of the folder if the folder is up to date: complete, written by this program from the same scene, and closed
/// by the run that wrote it. `hash`: hash of the scene and its frames.
fn current(context: &Context, root: &Path, hash: &str) -> Option<Manifest> {
    let (m, found) = manifest::verify(root, context.limits.get("json-bytes")).ok()?;
    // The hash covers only the scene and its frames; another version of the program may write other bytes. `is_settled` compares
    // the key, which contains a hash of the program's sources, with the key that the last run left in the folder.
    let is_same = m.scene.hash == hash && m.version == VERSION;
    (is_same && found.is_complete() && is_settled(root, &key(hash))).then_some(m)
}

/// Key that determines the bytes of a bake: version and sources of the program, and the hash of the scene and its frames.
fn key(hash: &str) -> String {
    format!("{VERSION} {SOURCES} {hash}")
}

/// Whether the lattice wind is stored after its spin-up: the recipe has one and the key `keep` is set.
fn stores_spin_up(recipe: &Recipe) -> bool {
    recipe.lattice.keep && !bake::lattice_memory(recipe).is_empty()
}

fn open(context: &Context, args: &Bake, hash: &str, root: &Path) -> Result<Folder> {
    let options =
        WriteOptions { key: key(hash), force: args.force, cancel: context.cancel.clone(), ..WriteOptions::default() };
    Folder::open_with(root, options)
}

/// A folder that a bake has written or found up to date.
struct FinishedBake<'a> {
    root: &'a Path,
    /// The manifest in memory, since another process may already rewrite the folder.
    manifest: &'a Manifest,
    /// Number of warnings that the manifest does not hold.
    other_warnings: usize,
    /// Name and seconds of each stage; `None` for a folder that was up to date.
    stages: Option<Vec<(String, f64)>>,
}

/// Prints the written folder, how to open it, and the duration of each stage.
fn summary(context: &Context, recipe: &Recipe, finished: &FinishedBake<'_>) -> Result<()> {
    let (root, m, stages) = (finished.root, finished.manifest, finished.stages.as_deref());
    let files = m.expanded();
    let bytes: u64 = files.iter().map(|f| f.1).sum();
    if context.console.json {
        let value = json!({
            "folder": root.display().to_string(), "scene": m.scene.name, "hash": m.scene.hash, "seed": m.seed,
            "bake_hash": m.bake_hash, "files": files.len(), "bytes": bytes, "up_to_date": stages.is_none(),
            "warnings": finished.other_warnings + m.warnings.len(),
            "seconds": stages.map(|s| s.iter().cloned().collect::<std::collections::BTreeMap<_, _>>()),
        });
        return context.console.result(&format!("{value:#}\n"));
    }
    if context.console.quiet {
        return Ok(());
    }
    // As text: a line of totals, then one line per program that opens a file of the bake.
    let parts = by_folder(&files.iter().map(|f| (f.0.as_str(), f.1)).collect::<Vec<_>>());
    let mut text = format!("{}  {} files, {}\n", root.display(), files.len(), sizes(bytes, &parts));
    let has = |ending: &str| files.iter().map(|f| f.0.as_str()).find(|p| p.ends_with(ending));
    let shown = |path: &str| root.join(path).display().to_string();
    let name = &recipe.name;
    let rate = frame_rate(recipe);
    let mut open = |program: &str, how: String| text += &format!("  {program:12} {how}\n");
    if has(&format!("{name}.usda")).is_some() {
        let path = shown(&format!("{name}.usda"));
        open("Blender 4+", format!("File > Import > USD: {path}{rate}"));
        open("usdview", format!("usdview {}", report::shell_word(&path)));
    }
    if let Some(path) = m.scene_glb(Profile::Blender) {
        open("Blender", format!("File > Import > glTF: {}{rate}", shown(&path)));
    }
    if let Some(path) = m.scene_glb(Profile::Web) {
        open("browsers", format!("drop {} onto a glTF viewer", shown(&path)));
    }
    if let Some(path) = has(".engine.json") {
        open("engines", format!("a .glb of each plant in {}, placed by {}", shown("gltf"), shown(path)));
    }
    if has("render.ini").is_some() {
        open("POV-Ray", format!("cd {} && povray render.ini", report::shell_word(&shown("pov"))));
    }
    // The ground is a file beside the plants, and sorts before most of them.
    let meshes: Vec<&str> = files.iter().map(|f| f.0.as_str()).filter(|p| p.ends_with(".obj")).collect();
    match meshes[..] {
        [] => {}
        [path] => open("anything", format!("meshes at rest: {}", shown(path))),
        _ => open("anything", format!("meshes at rest: {} files in {}", meshes.len(), shown("obj"))),
    }
    for (folder, program, what) in RESULTS {
        // The stored state of a lattice wind, in the folder of its planes, is for the next bake alone.
        let is_result = |path: &str| {
            path.strip_prefix(folder).is_some_and(|rest| rest.starts_with('/') && !rest.ends_with(".state"))
        };
        if files.iter().any(|f| is_result(&f.0)) {
            open(program, format!("{what}: {}", shown(folder)));
        }
    }
    text += &stage_times(stages.unwrap_or_default());
    context.console.result(&text)
}

/// Folders of a bake with results that are no scene for a viewer, what opens them, and what they hold.
const RESULTS: [(&str, &str, &str); 9] = [
    ("stats", "tables", "statistics (.csv, .json) and plots (.svg)"),
    ("maps/deposition", "maps", "catkins at rest per area (.exr)"),
    ("maps/landings", "maps", "all depositions per area (.exr)"),
    ("points", "tables", "points of each frame (.csv)"),
    ("vdb", "volumes", "OpenVDB, a file for each frame"),
    ("wind", "wind", "velocities on planes (.exr) and in boxes (.vti)"),
    ("cloud", "points", "points, and instances as points (.ply)"),
    ("tracks", "records", "binary records of each frame"),
    ("unreal", "Unreal", "assemblies of the plants and their wind"),
];

/// `12.3 MB (usd 10.1 MB, pictures 2.2 MB)`, largest first.
fn sizes(whole: u64, parts: &[(impl AsRef<str>, u64)]) -> String {
    let mut parts: Vec<(&str, u64)> = parts.iter().map(|(name, n)| (name.as_ref(), *n)).filter(|p| p.1 > 0).collect();
    parts.sort_by_key(|(name, n)| (std::cmp::Reverse(*n), *name));
    let each: Vec<String> = parts.iter().map(|(name, n)| format!("{name} {}", report::byte_size(*n))).collect();
    if each.is_empty() {
        report::byte_size(whole)
    } else {
        format!("{} ({})", report::byte_size(whole), each.join(", "))
    }
}

/// Bytes of a bake by its folders; files of its root count as `scene`.
fn by_folder(files: &[(&str, u64)]) -> Vec<(String, u64)> {
    let mut sum: std::collections::BTreeMap<&str, u64> = std::collections::BTreeMap::new();
    for (path, bytes) in files {
        let folder = path.split_once('/').map_or("scene", |(folder, _)| folder);
        *sum.entry(folder).or_default() += bytes;
    }
    sum.into_iter().map(|(name, n)| (name.to_owned(), n)).collect()
}

/// Line with the seconds of the whole run and of every stage that took at least 2 % of it; empty without stages.
fn stage_times(stages: &[(String, f64)]) -> String {
    let whole: f64 = stages.iter().map(|s| s.1).sum();
    let long = stages.iter().filter(|s| s.1 >= 0.02 * whole);
    let each: Vec<String> = long.map(|(name, s)| format!("{name} {s:.1}")).collect();
    if stages.is_empty() { String::new() } else { format!("  {:12} {whole:.1}: {}\n", "seconds", each.join(", ")) }
}

/// Note for Blender, whose importers take the frames of a file but not its frame rate: a scene of another rate than
/// its default of 24 frames per second would play at the wrong speed.
fn frame_rate(recipe: &Recipe) -> String {
    const BLENDER_DEFAULT: f64 = 24.0;
    let fps = recipe.clip.fps();
    if recipe.moves && fps != BLENDER_DEFAULT {
        format!(" (first set Output > Frame Rate to {})", report::rate(fps))
    } else {
        String::new()
    }
}
