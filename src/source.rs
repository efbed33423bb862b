//! From the name of a source to a request for its scene: a path, `-` for standard input, or the name of a preset.
//!
//! ```
//! use osier::recipe::resolve;
//! use osier::source::{SourceOptions, find_scene};
//!
//! # fn main() -> osier::Result<()> {
//! let options = SourceOptions { set: vec!["wind.speed=6".into()], ..SourceOptions::default() };
//! let (recipe, _warnings) = resolve(&find_scene("poplar-twig", &options)?)?;
//! assert_eq!((recipe.plants.len(), recipe.wind.speed), (1, 6.0));
//! # Ok(())
//! # }
//! ```

use std::ffi::OsStr;
use std::path::{Path, PathBuf};

use crate::presets::{self, Preset, PresetKind};
use crate::recipe::{Library, Request};
use osier_base::diagnostic::{Diagnostic, Report, nearest};
use osier_base::limits::Limits;
use osier_base::{Error, Result, files};
use osier_ifs::read;

/// Where sources are looked for, and which values of their scenes are overridden.
#[derive(Debug, Clone, Default)]
pub struct SourceOptions {
    /// Folders in which referenced files are looked up after the folder of the source.
    pub search: Vec<PathBuf>,
    /// Overrides `PATH=VALUE` of scene keys, or of the `#define`s of a bare grammar. `as=cloud` and `as=tree` choose
    /// what a coefficient table is read as.
    pub set: Vec<String>,
    /// Seed of all random draws in place of the scene's.
    pub seed: Option<u64>,
    /// Limits in force while sources are read and resolved.
    pub limits: Limits,
}

/// What a coefficient table without `as=` is wanted for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum TableUse {
    /// A tree if its maps name branches, else an attractor.
    Scene,
    /// An attractor: its picture is wanted.
    Picture,
}

/// The request for the scene of a source: a scene (`.toml`), a grammar (`.l`), particle-shapes (`.shapes`), a species (`.species`), a coefficient table
/// (`.ifs`, `.flame`, `.ifs.toml`), or a preset by its name with or without ending. All but a scene become a scene of their own.
/// # Errors
/// `Io` if the source cannot be read, `Input` if it is neither scene nor grammar nor table.
pub fn find_scene(source: &str, options: &SourceOptions) -> Result<Request> {
    find(source, options, TableUse::Scene)
}

/// As [`find_scene`] for a picture: a coefficient table becomes an attractor even if it could grow a tree.
/// # Errors
/// As [`find_scene`].
pub fn find_picture(source: &str, options: &SourceOptions) -> Result<Request> {
    find(source, options, TableUse::Picture)
}

/// The request for the scene of a preset, whatever files have its name. A mesh becomes a plant whose skeleton is found in it.
/// # Errors
/// `Io` if a folder of `options.search` cannot be opened.
pub fn preset_scene(preset: &Preset, options: &SourceOptions) -> Result<Request> {
    let request = match presets::kind(preset) {
        PresetKind::Mesh => {
            let text = format!("[plants.mesh]\nmesh = \"{}\"\n[ground]\nshow = false\n", preset.name);
            Request { name: "mesh".into(), shown: format!("preset:{}", preset.name), text, ..Request::default() }
        }
        _ => find_preset(preset.name, options, TableUse::Scene)?,
    };
    let (library, limits) = (Library::presets(&options.search)?, options.limits.clone());
    Ok(Request { library, limits, seed: options.seed, ..request })
}

fn find(source: &str, options: &SourceOptions, table_use: TableUse) -> Result<Request> {
    let mut request = locate(source, options, table_use)?;
    // `as=` chooses how a table is read and is no key of a scene.
    request.set = options.set.iter().filter(|s| !s.trim_start().starts_with("as=")).cloned().collect();
    request.seed = options.seed;
    request.limits = options.limits.clone();
    Ok(request)
}

fn locate(source: &str, options: &SourceOptions, table_use: TableUse) -> Result<Request> {
    let path = Path::new(source);
    let search = &options.search;
    // A folder is no source: the name of a preset may also be that of the folder it was baked into.
    if source != "-" && !source.contains(['/', '\\']) && (!path.exists() || path.is_dir()) {
        return Ok(Request { library: Library::presets(search)?, ..find_preset(source, options, table_use)? });
    }
    if path.is_dir() {
        return Err(folder_error(source));
    }
    // Read the file before its folder is opened for references: of a path that does not exist, the
    // file is reported.
    let bytes = files::read_input(path, options.limits.get("text-bytes"))?;
    if ["l", "shapes", "species"].iter().any(|e| path.extension() == Some(OsStr::new(e))) {
        return Ok(Request {
            library: Library::new(path, search)?,
            ..plant_request(&file_stem(path), &file_name(path))
        });
    }
    if is_coefficient_table(path, &bytes) {
        let file = file_name(path);
        let short = file.split('.').next().unwrap_or(&file);
        let request = table_request(&file, short, &bytes, options, table_use);
        return Ok(Request { library: Library::new(path, search)?, ..request });
    }
    if let Some(ending) = path.extension().filter(|e| ["obj", "glb", "gltf"].iter().any(|m| e.eq_ignore_ascii_case(m)))
    {
        let message = format!("\"{source}\" is a mesh (.{}), neither scene nor grammar", ending.display());
        return Err(Diagnostic::about("S001", message)
            .help("name it in a scene: mesh = \"FILE\" below an organ")
            .into());
    }
    let text = files::decode(&bytes, files::Encoding::Utf8).map_err(|bad| {
        let mut report = Report::default();
        bad.report("S001", source, &bytes, &mut report);
        Error::Input(Box::new(report))
    })?;
    let name = if source == "-" { "stdin".into() } else { file_stem(path) };
    Ok(Request {
        name,
        shown: source.into(),
        text: text.text,
        library: Library::new(path, search)?,
        ..Request::default()
    })
}

/// S001 for a folder where a scene was expected.
fn folder_error(source: &str) -> Error {
    let help = "name a scene or grammar in it; `osier info` and `osier preview` take the folder of a bake";
    Diagnostic::about("S001", format!("\"{source}\" is a folder, not a scene")).help(help).into()
}

/// The request for a coefficient table: a tree if its maps name branches, else an attractor. `as=cloud` and `as=tree`
/// override that, and a picture is always of the attractor.
fn table_request(file: &str, name: &str, bytes: &[u8], options: &SourceOptions, table_use: TableUse) -> Request {
    let systems = read::read(file, bytes, &options.limits).map(|r| r.0).unwrap_or_default();
    let is_set = |v: &str| options.set.iter().any(|s| s.replace(' ', "") == format!("as={v}"));
    let has_branches = systems.first().is_some_and(|s| s.maps.iter().any(|m| m.branch.is_some()));
    if !is_set("cloud") && table_use == TableUse::Scene && (has_branches || is_set("tree")) {
        Request::tree(name, file)
    } else {
        Request::cloud(name, file)
    }
}

/// The request for a scene of one plant of a grammar, of particle-shapes or of a species.
fn plant_request(name: &str, file: &str) -> Request {
    match file.rsplit_once('.').map_or("", |parts| parts.1) {
        "shapes" => Request::shapes(name, file),
        "species" => Request::species(name, file),
        _ => Request::bare(name, file),
    }
}

/// Whether a file holds coefficients: by its ending, or for TOML by a table `[ifs]`.
fn is_coefficient_table(path: &Path, bytes: &[u8]) -> bool {
    let ending = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
    // Searched line by line before any parsing: a scene with a syntax error must still be reported as a scene.
    let has_ifs_table = || bytes.split(|b| *b == b'\n').any(|l| l.starts_with(b"[ifs") || l.starts_with(b"[[ifs"));
    matches!(ending.as_str(), "ifs" | "flame") || (ending == "toml" && has_ifs_table())
}

/// The request for a preset: `oak` is the scene `oak.toml`, else the grammar `oak.l` and so on; an ending picks one.
fn find_preset(name: &str, options: &SourceOptions, table_use: TableUse) -> Result<Request> {
    let endings = ["", ".toml", ".l", ".shapes", ".species", ".ifs.toml", ".ifs"];
    let Some(preset) = endings.iter().find_map(|e| presets::find(&format!("{name}{e}"))) else {
        if Path::new(name).is_dir() {
            return Err(folder_error(name));
        }
        let names = presets::PRESETS.iter().map(|p| p.name.split('.').next().unwrap_or(p.name));
        let hint = match nearest(name, names) {
            Some(near) => format!("no such file or preset; did you mean \"{near}\"?"),
            None => "no such file or preset; `osier list presets` shows the presets".into(),
        };
        return Err(Error::io("open", name, std::io::Error::new(std::io::ErrorKind::NotFound, hint)));
    };
    let stem = preset.name.split('.').next().unwrap_or(preset.name);
    if [".l", ".shapes", ".species"].iter().any(|e| preset.name.ends_with(e)) {
        return Ok(plant_request(stem, preset.name));
    }
    if preset.name.contains(".ifs") {
        return Ok(table_request(preset.name, stem, preset.text.as_bytes(), options, table_use));
    }
    let shown = format!("preset:{}", preset.name);
    Ok(Request { name: stem.into(), shown, text: preset.text.into(), ..Request::default() })
}

fn file_stem(path: &Path) -> String {
    path.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default()
}

fn file_name(path: &Path) -> String {
    path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default()
}
