//! `osier info`: description and verification of a bake, and description of single files and presets.

use std::path::{Path, PathBuf};

use serde_json::json;

use super::args::Info;
use super::{Context, SCENE_FLAGS, report};
use crate::presets::{self, Preset, PresetKind};
use crate::source::{named_preset, no_such_source, table_systems};
use osier_base::diagnostic::visible;
use osier_base::files::{MANIFEST, SearchPaths, folder_of, name_of, read_input};
use osier_base::limits::grouped;
use osier_base::{Error, Result};
use osier_export::gltf::Profile;
use osier_export::manifest::{AssetEntry, Manifest, Verification, verify};
use osier_grammar::FileKind;
use osier_import as import;
use osier_scene::MaterialClass;

/// Runs `osier info` on a bake, one of its files, any other file or a preset; the result is the exit code: 1 for an incomplete bake, 3
/// for warnings of a mesh under `--strict`.
pub fn run(context: &Context, args: &Info) -> Result<u8> {
    let path = args.path.as_path();
    if let Some(flag) = context.scene_flag(&SCENE_FLAGS) {
        context.console.complain(&format!("{flag} does not change what `info` describes, a finished file"));
        return Ok(2);
    }
    let limit = context.limits.get("json-bytes");
    // A folder or its manifest means the whole bake, any other file only itself.
    if path.is_dir() || path.file_name().is_some_and(|n| n == MANIFEST) {
        let root = if path.is_dir() { path } else { folder_of(path) };
        if !root.join(MANIFEST).is_file() {
            let is_sweep = root.join("sweep.json").is_file();
            let root = root.display();
            let why = if is_sweep {
                format!("\"{root}\" is a sweep, which has no {MANIFEST}: read its sweep.json, sweep.csv and means.csv")
            } else {
                format!("\"{root}\" contains no {MANIFEST}: it is not a bake, or the bake did not finish")
            };
            context.console.complain(&why);
            return Ok(1);
        }
        return describe_bake(context, &VerifiedBake::read(root, limit)?, None);
    }
    // Other programs have files of the manifest's name, too, and the folder of a bake may hold further files.
    if let Some((root, inside)) = bake_of(path)
        && let Ok(bake) = VerifiedBake::read(&root, limit)
        && bake.manifest.expanded().iter().any(|file| file.0 == inside)
    {
        return describe_bake(context, &bake, Some(&inside));
    }
    // A bare name without a file is that of a preset, as in the commands that take a scene.
    if let Some(name) = path.to_str().filter(|name| !path.exists() && !name.contains(['/', '\\'])) {
        let preset = named_preset(name).ok_or_else(|| no_such_source(name))?;
        return describe_preset(context, name, preset);
    }
    describe_file(context, path)
}

/// Folder of the bake to which a file belongs, and its path in it; `None` for other files. Bakes have files at most three
/// folders deep.
fn bake_of(path: &Path) -> Option<(PathBuf, String)> {
    let mut inside = path.file_name()?.to_string_lossy().into_owned();
    let mut folder = folder_of(path);
    for _ in 0..3 {
        if folder.join(MANIFEST).is_file() {
            return Some((folder.to_path_buf(), inside));
        }
        inside = format!("{}/{inside}", folder.file_name()?.to_string_lossy());
        folder = folder_of(folder);
    }
    None
}

/// A bake with its manifest, and the differences of its files from that.
struct VerifiedBake {
    root: PathBuf,
    manifest: Manifest,
    found: Verification,
}

impl VerifiedBake {
    fn read(root: &Path, limit: u64) -> Result<Self> {
        let (manifest, found) = verify(root, limit)?;
        Ok(Self { root: root.to_path_buf(), manifest, found })
    }
}

fn describe_bake(context: &Context, bake: &VerifiedBake, only: Option<&str>) -> Result<u8> {
    let VerifiedBake { root, manifest, found } = bake;
    if context.console.json {
        let value = json!({
            "folder": root.display().to_string(), "complete": found.is_complete(), "missing": found.missing,
            "changed": found.changed, "extra": found.extra, "sum_holds": found.sum_holds, "manifest": manifest,
        });
        context.console.result(&format!("{value:#}\n"))?;
    } else {
        context.console.result(&describe(root, manifest, only))?;
        report_verification(context, found);
    }
    Ok(u8::from(!found.is_complete()))
}

fn describe(root: &Path, m: &Manifest, only: Option<&str>) -> String {
    let files = m.expanded();
    let bytes = files.iter().map(|f| f.1).sum();
    let fps = report::rate(f64::from(m.time.fps[0]) / f64::from(m.time.fps[1].max(1)));
    let mut out = format!(
        "{}  scene {}, seed {}, by {} {}\nframes {} to {} at {fps} per second, {} files, {}\nscene {}\nbake  {}\n\n",
        visible(&root.display().to_string()),
        visible(&m.scene.name),
        visible(&m.seed),
        visible(&m.generator),
        visible(&m.version),
        m.time.start,
        m.time.end,
        files.len(),
        report::byte_size(bytes),
        visible(&m.scene.hash),
        visible(&m.bake_hash),
    );
    // One line per asset; for a single file, only for the assets in it, of which pictures and tables have none.
    let is_whole = only.is_none_or(|file| shows_scene(m, file));
    let is_in = |a: &&AssetEntry| is_whole || only.is_some_and(|file| a.files.iter().any(|f| f == file));
    let mut rows = m.assets.iter().filter(is_in).peekable();
    if rows.peek().is_some() {
        out += &format!(
            "{:16} {:8} {:>11} {:>11} {:>10} {:>7}  size, m\n",
            "asset", "kind", "vertices", "triangles", "instances", "joints"
        );
    }
    for a in rows {
        let [lo, hi] = a.bounds;
        let size: Vec<String> = lo.iter().zip(hi).map(|(l, h)| format!("{:.2}", h - l)).collect();
        out += &format!(
            "{:16} {:8} {:>11} {:>11} {:>10} {:>7}  {}\n",
            visible(&a.id),
            visible(&a.kind),
            grouped(a.vertices as u64),
            grouped(a.triangles as u64),
            grouped(a.instances as u64),
            a.joints,
            size.join(" x ")
        );
    }
    if let Some((path, bytes, hash)) = only.and_then(|o| files.iter().find(|f| f.0 == o)) {
        // The lines above end with an empty one where no asset follows.
        let gap = if out.ends_with("\n\n") { "" } else { "\n" };
        out += &format!("{gap}{}  {}\nblake3 {}\n", visible(path), report::byte_size(*bytes), visible(hash));
    }
    out
}

/// Whether a file of a bake shows all of its assets: the glTF file of the scene in one of the profiles, the USD stages, the scene of
/// POV-Ray.
fn shows_scene(m: &Manifest, file: &str) -> bool {
    let profiles = [Profile::Web, Profile::Blender, Profile::Engine];
    profiles.into_iter().any(|profile| m.scene_glb(profile).as_deref() == Some(file))
        || m.stage.as_deref() == Some(file)
        || file == format!("{}.usda", m.scene.name)
        || file == "pov/main.pov"
}

fn report_verification(context: &Context, found: &Verification) {
    for (what, list) in [("missing", &found.missing), ("changed", &found.changed)] {
        for path in list {
            context.console.complain(&format!("{what}: {path}"));
        }
    }
    for path in &found.extra {
        context.console.note(&format!("not part of the bake: {path}"));
    }
    if !found.sum_holds {
        context.console.complain("the checksum of the manifest does not match its content");
    }
    if found.is_complete() {
        context.console.note("complete: every file has the size and hash of the manifest");
    } else {
        context.console.note("bake again to repair it");
    }
}

/// Describes a preset, which is compiled into the program: its kind, size and first sentence, and the commands that take it. `name`: as
/// it was given, without its ending or with it.
fn describe_preset(context: &Context, name: &str, preset: &Preset) -> Result<u8> {
    let bytes = preset.text.len();
    let hash = blake3::hash(preset.text.as_bytes()).to_hex().to_string();
    let (kind, about) = (presets::kind(preset), presets::about(preset));
    if context.console.json {
        let value =
            json!({ "preset": preset.name, "kind": kind.word(), "about": about, "bytes": bytes, "blake3": hash });
        context.console.result(&format!("{value:#}\n"))?;
        return Ok(0);
    }
    let (what, uses) = match kind {
        PresetKind::Species | PresetKind::Scene => (
            "scene",
            format!(
                "`osier preview {name}` shows it, `osier bake {name}` bakes it; `osier new FOLDER --from {name}` copies its files"
            ),
        ),
        PresetKind::Grammar => ("grammar", format!("`osier preview {name}` shows it; scenes name it as grammar")),
        PresetKind::Shapes => {
            ("particle-shapes", format!("`osier preview {name}` shows them; scenes name them as shapes"))
        }
        PresetKind::Habit => ("species", format!("`osier preview {name}` shows it; scenes name it as species")),
        PresetKind::IfsTable => {
            ("coefficient table", format!("`osier preview {name}` shows it; scenes name it as ifs"))
        }
        PresetKind::Mesh => ("mesh", format!("`osier preview {name}` shows it; scenes name it as mesh")),
    };
    let size = report::byte_size(bytes as u64);
    let bake = Path::new("out").join(name);
    let text = format!("{}  preset ({what}), {size}\nblake3 {hash}\n{about}\n", preset.name);
    context.console.result(&text)?;
    context.console.note(&format!("\"{name}\" is a preset, whose file is in the program; {uses}"));
    if bake.join(MANIFEST).is_file() {
        context.console.note(&format!("a bake of that name: `osier info {}`", bake.display()));
    }
    Ok(0)
}

/// Describes a file outside of bakes: its size and hash, extents of a mesh, notation and entries of a grammar, systems of a table.
fn describe_file(context: &Context, path: &Path) -> Result<u8> {
    let bytes = read_input(path, context.limits.get("mesh-bytes"), "--max-mesh-bytes")?;
    let hash = blake3::hash(&bytes).to_hex().to_string();
    let ending = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
    // Meshes are read as in a scene, so that their errors and warnings are reported too.
    let mut warned = false;
    let mesh = if matches!(ending.as_str(), "glb" | "gltf" | "obj") {
        let roots = SearchPaths::new(path, &context.common.search)?;
        let options = import::ImportOptions {
            roots: &roots,
            limits: &context.limits,
            up: import::UpAxis::Y,
            scale: 1.0,
            class: MaterialClass::Bark,
        };
        match import::read(path, &bytes, &options) {
            Ok(imported) => {
                context.console.report(&imported.warnings);
                warned = !imported.warnings.diagnostics.is_empty();
                Some(imported.mesh)
            }
            Err(Error::Input(report)) => {
                context.console.report(&report);
                return Ok(1);
            }
            Err(e) => return Err(e),
        }
    } else {
        None
    };
    let size = mesh.as_ref().map(|m| m.bounds().size().to_array());
    // Other files may be grammars of any notation, or files with several L-systems or tables.
    let file_name = name_of(path);
    let notation = match osier_grammar::detect(&file_name, &bytes) {
        FileKind::Grammar(notation) if mesh.is_none() && std::str::from_utf8(&bytes).is_ok() => Some(notation.word()),
        _ => None,
    };
    let systems = table_systems(path, &bytes, &context.limits);
    let entries = if systems.is_empty() { osier_grammar::entries(&file_name, &bytes) } else { systems.clone() };
    if context.console.json {
        let value = json!({
            "file": path.display().to_string(), "bytes": bytes.len(), "blake3": hash,
            "vertices": mesh.as_ref().map(|m| m.points.len()), "triangles": mesh.as_ref().map(|m| m.triangles.len()),
            "size": size, "notation": notation, "entries": entries,
        });
        context.console.result(&format!("{value:#}\n"))?;
        return Ok(context.strict(warned));
    }
    // As text, only the lines that apply to the file.
    let shown = visible(&path.display().to_string());
    let mut out = format!("{shown}  {}\nblake3 {hash}\n", report::byte_size(bytes.len() as u64));
    if let (Some(m), Some([x, y, z])) = (mesh, size) {
        let (v, t) = (grouped(m.points.len() as u64), grouped(m.triangles.len() as u64));
        out += &format!("{v} vertices, {t} triangles, {x:.2} x {y:.2} x {z:.2} m\n");
    }
    if let Some(notation) = notation {
        out += &format!("grammar in the notation of {notation}\n");
    }
    if !systems.is_empty() {
        out += "coefficient table with the systems\n";
    }
    for entry in &entries {
        out += &format!("  {}\n", visible(entry));
    }
    context.console.result(&out)?;
    Ok(context.strict(warned))
}
