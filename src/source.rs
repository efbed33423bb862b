//! Finds sources by name (a path, `-` for standard input, or a preset) and makes requests for their scenes.
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
use crate::recipe::scene::no_grammar;
use crate::recipe::{Library, Request, SingleSource};
use osier_base::diagnostic::{Diagnostic, Report, Span, nearest};
use osier_base::files::{folder_of, name_of};
use osier_base::limits::Limits;
use osier_base::{Error, Result, files};
use osier_grammar::{FileKind, Notation};
use osier_ifs::read;

/// The flag that raises the limit of the texts read here.
const TEXT_FLAG: &str = "--max-text-bytes";

/// Search folders, overrides, notation, seed and limits with which sources are read.
#[derive(Debug, Clone, Default)]
pub struct SourceOptions {
    /// Folders in which referenced files are searched, after the folder of the source.
    pub search: Vec<PathBuf>,
    /// Overrides `PATH=VALUE` of scene keys, or of the `#define`s of a bare grammar. `as=cloud` and `as=tree` choose how a
    /// coefficient table is read.
    pub set: Vec<String>,
    /// Notation of a grammar (`cpfg`, `abop`, `catkin`, `fractint`, `lparser`, `lpy`) that replaces the detected one; a source
    /// for which it is set is read as a grammar, whatever its name, except scenes, which refuse it.
    pub dialect: Option<String>,
    /// Random numbers of grammars (`osier`, `cpfg`); `None`: `osier`.
    pub rng: Option<String>,
    /// Seed of all random draws, which replaces the scene's.
    pub seed: Option<u64>,
    /// Limits in force while sources are read and resolved.
    pub limits: Limits,
}

/// Purpose for which a coefficient table without `as=` is read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum TableUse {
    /// A scene: a tree if the maps name branches, else an attractor.
    Scene,
    /// A picture, which is always of an attractor.
    Picture,
}

/// The request for the scene of a source: a scene (`.toml`), a grammar in any notation that `osier_grammar` reads,
/// particle-shapes (`.shapes`), a species (`.species`), a coefficient table (`.ifs`, `.flame`, `.ifs.toml`), or a preset by its
/// name with or without ending. The content of a file decides before its ending. `FILE#ENTRY` and `FILE:ENTRY` name one
/// L-system of a file of Fractint, or one system of a coefficient table. Every source except a scene gets a scene with a single plant or attractor.
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

/// The request for the scene of a preset, even if a file has its name. A mesh becomes a plant whose skeleton is extracted from
/// it.
/// # Errors
/// `Io` if a folder of `options.search` cannot be opened.
pub fn preset_scene(preset: &Preset, options: &SourceOptions) -> Result<Request> {
    let request = find_preset(preset.name, options, TableUse::Scene)?;
    let (library, limits) = (Library::presets(&options.search)?, options.limits.clone());
    Ok(Request { library, limits, seed: options.seed, ..request })
}

fn find(source: &str, options: &SourceOptions, table_use: TableUse) -> Result<Request> {
    let mut request = locate(source, options, table_use)?;
    let forms = options.set.iter().filter_map(|s| s.trim_start().strip_prefix("as="));
    if let Some(form) = forms.map(str::trim).find(|form| !matches!(*form, "cloud" | "tree")) {
        let d = Diagnostic::about("S004", format!("as is \"{form}\", but must be cloud or tree"));
        return Err(d.help("it chooses how a coefficient table is read").into());
    }
    // `as=` chooses how a table is read and is not a key of a scene. What the source itself selects comes first, so that
    // the overrides of the options prevail.
    let set = options.set.iter().filter(|s| !s.trim_start().starts_with("as=")).cloned();
    let selected = std::mem::take(&mut request.set);
    request.set = selected.into_iter().chain(grammar_keys(&request, options)?).chain(set).collect();
    request.seed = options.seed;
    request.limits = options.limits.clone();
    Ok(request)
}

/// The flags `--dialect` and `--rng` as overrides of the only plant of a bare file.
/// # Errors
/// S003 if a flag is given for a scene or an attractor, which would not heed it.
fn grammar_keys(request: &Request, options: &SourceOptions) -> Result<Vec<String>> {
    let flags = [("dialect", &options.dialect), ("rng", &options.rng)];
    let mut keys = Vec::new();
    for (key, value) in flags.into_iter().filter_map(|(key, value)| Some((key, value.as_ref()?))) {
        if !matches!(request.bare, Some(SingleSource::Plant(_))) {
            let message = format!("--{key} is for the file of a grammar, and \"{}\" is none", request.shown);
            let help = format!("in a scene it is a key of the plant: [plants.NAME] {key} = \"{value}\"");
            return Err(Diagnostic::about("S003", message).help(help).into());
        }
        keys.push(format!("{key}={}", toml::Value::String(value.clone())));
    }
    Ok(keys)
}

/// File and entry of `FILE#ENTRY` or `FILE:ENTRY`; a file with the whole text as its name has precedence.
fn split_entry(source: &str) -> (&str, Option<&str>) {
    if Path::new(source).exists() {
        return (source, None);
    }
    // A colon also follows the letter of a drive: `#` is tried first, then every colon.
    let parts = source.rsplit_once('#').filter(|(f, _)| Path::new(f).is_file());
    let parts = parts
        .or_else(|| source.match_indices(':').map(|(i, _)| source.split_at(i)).find(|(f, _)| Path::new(f).is_file()));
    match parts {
        Some((file, entry)) => (file, Some(entry.trim_start_matches(':'))),
        None => (source, None),
    }
}

/// The bytes of a file that may be a grammar; `None` for scenes, meshes and paths without a file.
fn text_of(path: &Path, limits: &Limits) -> Result<Option<Vec<u8>>> {
    let other = ["toml", "glb", "gltf", "obj", "shapes", "species", "ifs", "flame"];
    let ending = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
    // Files with these endings are no grammars; all others are judged by their content.
    if other.contains(&ending.as_str()) || !path.is_file() {
        return Ok(None);
    }
    files::read_input(path, limits.get("text-bytes"), TEXT_FLAG).map(Some)
}

/// Whether a source is an L-system, or a file of them, in Fractint's notation: drawings in the plane x-y, best seen from the
/// front.
/// # Errors
/// `Io` if the file cannot be read.
pub fn is_plane_drawing(source: &str, limits: &Limits) -> Result<bool> {
    let path = Path::new(split_entry(source).0);
    let Some(bytes) = text_of(path, limits)? else { return Ok(false) };
    Ok(osier_grammar::detect(&name_of(path), &bytes) == FileKind::Grammar(Notation::Fractint))
}

/// Sources of the L-systems of a file that holds several, `FILE#ENTRY`; the source itself for any other.
/// # Errors
/// `Io` if the file cannot be read.
pub fn entry_sources(source: &str, limits: &Limits) -> Result<Vec<String>> {
    let path = Path::new(source);
    let Some(bytes) = text_of(path, limits)? else { return Ok(vec![source.to_owned()]) };
    let names = osier_grammar::entries(&name_of(path), &bytes);
    if names.len() < 2 {
        return Ok(vec![source.to_owned()]);
    }
    Ok(names.iter().map(|n| format!("{source}#{n}")).collect())
}

/// Names of the systems of a coefficient table, in the order of the file; empty for another file and for a faulty table, whose
/// errors its readers report.
pub fn table_systems(path: &Path, bytes: &[u8], limits: &Limits) -> Vec<String> {
    if !is_coefficient_table(path, bytes) {
        return Vec::new();
    }
    let systems = read::read(&name_of(path), bytes, limits).map(|r| r.0).unwrap_or_default();
    systems.into_iter().map(|s| s.name).collect()
}

/// Sources of the systems of a coefficient table that holds several, `FILE#SYSTEM`; `None` for any other file.
/// # Errors
/// `Io` if the file cannot be read.
pub fn system_sources(source: &str, limits: &Limits) -> Result<Option<Vec<String>>> {
    let path = Path::new(source);
    let bytes = files::read_input(path, limits.get("text-bytes"), TEXT_FLAG)?;
    let names = table_systems(path, &bytes, limits);
    Ok((names.len() > 1).then(|| names.iter().map(|n| format!("{source}#{n}")).collect()))
}

fn locate(source: &str, options: &SourceOptions, table_use: TableUse) -> Result<Request> {
    let (source, entry) = split_entry(source);
    let path = Path::new(source);
    let search = &options.search;
    // Folders are no sources: a preset may have the name of the folder into which it was baked.
    if source != "-" && !source.contains(['/', '\\']) && (!path.exists() || path.is_dir()) {
        return Ok(Request { library: Library::presets(search)?, ..find_preset(source, options, table_use)? });
    }
    if source != "-" && path.is_dir() {
        return Err(folder_error(source));
    }
    // The file is read before its folder is opened for references, so that a missing path is reported as a missing file.
    let bytes = files::read_input(path, options.limits.get("text-bytes"), TEXT_FLAG)?;
    let has_ending = |list: &[&str]| list.iter().any(|e| path.extension() == Some(OsStr::new(e)));
    // Only grammars and tables, which return before this is asked, hold several sources.
    let is_whole = || entry.map_or(Ok(()), |entry| Err(no_entries(source, entry)));
    if has_ending(&["shapes", "species"]) && options.dialect.is_none() {
        is_whole()?;
        return Ok(Request { library: Library::new(path, search)?, ..plant_request(&file_stem(path), &name_of(path)) });
    }
    let kind = osier_grammar::detect(&name_of(path), &bytes);
    let is_mesh_or_table = has_ending(&["obj", "glb", "gltf", "ifs", "flame"]);
    // Read as a scene, every line of a grammar would be an error. A scene may look like one by an arrow in a comment.
    let is_grammar = || options.dialect.is_some() || matches!(kind, FileKind::Grammar(_)) && !is_toml(&bytes);
    if (source == "-" || !path.is_file()) && is_grammar() {
        let help = "save it in a file: osier grow FILE.l -o FILE.glb";
        return Err(Diagnostic::about("S001", "grammars are not read from standard input and pipes, only scenes")
            .help(help)
            .into());
    }
    // A notation is refused for a scene below; read as a grammar, the scene would be reported as a faulty grammar.
    let has_notation = options.dialect.is_some() && !(has_ending(&["toml"]) && is_toml(&bytes));
    match kind {
        // A file with the ending of a grammar is read as one, so that its errors are those of a grammar.
        _ if has_notation || has_ending(&["l"]) && kind != FileKind::Houdini => {
            return grammar_request(path, entry, options);
        }
        FileKind::Grammar(_) if !is_mesh_or_table && source != "-" => return grammar_request(path, entry, options),
        FileKind::Houdini if !is_mesh_or_table => {
            let mut report = Report::default();
            let text = String::from_utf8_lossy(&bytes).into_owned();
            let id = report.sources.add(source, text.as_str());
            report.push(no_grammar(source, kind, Span::new(id, 0, text.lines().next().map_or(0, str::len))));
            return Err(Error::Input(Box::new(report)));
        }
        _ => {}
    }
    let content = if has_ending(&["toml"]) || is_mesh_or_table || source == "-" { None } else { content_of(&bytes) };
    match content {
        Some(Content::Shapes) => {
            is_whole()?;
            let request = Request::shapes(&file_stem(path), &name_of(path));
            return Ok(Request { library: Library::new(path, search)?, ..request });
        }
        Some(Content::Species) => {
            is_whole()?;
            let request = Request::species(&file_stem(path), &name_of(path));
            return Ok(Request { library: Library::new(path, search)?, ..request });
        }
        Some(Content::Table) | None => {}
    }
    if content == Some(Content::Table) || is_coefficient_table(path, &bytes) {
        let file = name_of(path);
        let short = file.split('.').next().unwrap_or(&file);
        let request = system_request(TableFile { name: short, file: &file, bytes: &bytes }, entry, options, table_use);
        return Ok(Request { library: Library::new(path, search)?, ..request });
    }
    is_whole()?;
    // Reading it as TOML would report a syntax error; this message names the way to use a mesh.
    if let Some(ending) = path.extension().filter(|e| ["obj", "glb", "gltf"].iter().any(|m| e.eq_ignore_ascii_case(m)))
    {
        let message = format!("\"{source}\" is a mesh (.{}), neither scene nor grammar", ending.display());
        return Err(Diagnostic::about("S001", message)
            .help("`osier preview` shows it; a scene takes it as mesh = \"FILE\" of [plants.NAME] (a tree), of [plants.NAME.leaf] or of a [[solid]]")
            .into());
    }
    if let Some((what, help)) = kind_without_scene(path) {
        return Err(Diagnostic::about("S001", format!("\"{source}\" is {what}, neither scene nor grammar"))
            .help(help)
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

/// For a name with the ending of a picture or of a file of another program: what the file is, and what to do with it.
fn kind_without_scene(path: &Path) -> Option<(&'static str, &'static str)> {
    let ending = path.extension()?.to_string_lossy().to_ascii_lowercase();
    match ending.as_str() {
        "png" | "jpg" | "jpeg" | "exr" | "hdr" | "tif" | "tiff" | "tga" | "gif" | "webp" => Some((
            "a picture",
            "a scene takes pictures as `mask` of a [[place]] or [[scatter]], as `file` or `texture` of [terrain], and on meshes",
        )),
        "usd" | "usda" | "usdc" | "usdz" | "abc" | "fbx" | "stl" | "ply" | "dae" | "blend" => Some((
            "a file of other programs",
            "name the scene that it was baked from, or export it as a mesh in OBJ or glTF (.obj, .glb)",
        )),
        _ => None,
    }
}

fn is_toml(bytes: &[u8]) -> bool {
    std::str::from_utf8(bytes).is_ok_and(|text| text.parse::<toml::Table>().is_ok())
}

/// S001 for a folder where a scene was expected.
fn folder_error(source: &str) -> Error {
    let help = "name a scene or grammar in it; `osier info` and `osier preview` take the folder of a bake";
    Diagnostic::about("S001", format!("\"{source}\" is a folder, not a scene")).help(help).into()
}

/// S001 for the entry of a file that holds one source.
fn no_entries(source: &str, entry: &str) -> Error {
    let message = format!("\"{source}\" has no entries, but \"{entry}\" was asked for");
    let help = "leave out the name behind the file: only files of Fractint and coefficient tables hold several systems";
    Diagnostic::about("S001", message).help(help).into()
}

/// A coefficient table: the name of its plant or attractor, the name of its file and its content.
#[derive(Debug, Clone, Copy)]
struct TableFile<'t> {
    name: &'t str,
    file: &'t str,
    bytes: &'t [u8],
}

/// The request for a coefficient table, of which `entry` selects a system as the key `system` does.
fn system_request(table: TableFile<'_>, entry: Option<&str>, options: &SourceOptions, table_use: TableUse) -> Request {
    let Some(entry) = entry else { return table_request(table, options, table_use) };
    let value = toml::Value::String(entry.to_owned());
    // Which system it is decides whether the table is a tree: the entry is known before the request is made.
    let set = std::iter::once(format!("system={value}")).chain(options.set.iter().cloned()).collect();
    let request = table_request(table, &SourceOptions { set, ..options.clone() }, table_use);
    let key = if matches!(request.bare, Some(SingleSource::Tree(_))) { "tree.system" } else { "system" };
    Request { set: vec![format!("{key}={value}")], ..request }
}

/// The request for a coefficient table: a tree if its maps name branches, else an attractor. `as=cloud` and `as=tree`
/// override that, and a picture is always of the attractor.
fn table_request(table: TableFile<'_>, options: &SourceOptions, table_use: TableUse) -> Request {
    let TableFile { name, file, bytes } = table;
    // Errors of the table are reported when it is resolved; here it counts as one without branches.
    let systems = read::read(file, bytes, &options.limits).map(|r| r.0).unwrap_or_default();
    let is_set = |v: &str| options.set.iter().any(|s| s.replace(' ', "") == format!("as={v}"));
    // The system that will be drawn, by the last override that names one.
    let named = options.set.iter().rev().find_map(|s| {
        let (key, name) = s.split_once('=')?;
        matches!(key.trim(), "system" | "tree.system").then(|| name.trim().trim_matches('"'))
    });
    let system = match named {
        Some(name) => systems.iter().find(|s| s.name.eq_ignore_ascii_case(name)),
        None => systems.first(),
    };
    let has_branches = system.is_some_and(|s| s.maps.iter().any(|m| m.branch.is_some()));
    if !is_set("cloud") && table_use == TableUse::Scene && (has_branches || is_set("tree")) {
        Request::tree(name, file)
    } else {
        Request::cloud(name, file)
    }
}

/// The request for a scene of one plant of a grammar file, or of one of its L-systems.
fn grammar_request(path: &Path, entry: Option<&str>, options: &SourceOptions) -> Result<Request> {
    let file = name_of(path);
    let name = entry.map_or_else(|| file_stem(path), str::to_owned);
    let reference = entry.map_or_else(|| file.clone(), |e| format!("{file}#{e}"));
    Ok(Request { library: Library::new(path, &options.search)?, ..Request::bare(&name, &reference) })
}

/// The request for a scene of one plant of a grammar, of particle-shapes or of a species.
fn plant_request(name: &str, file: &str) -> Request {
    match file.rsplit_once('.').map_or("", |parts| parts.1) {
        "shapes" => Request::shapes(name, file),
        "species" => Request::species(name, file),
        _ => Request::bare(name, file),
    }
}

/// Type of a file with an unknown ending that is neither grammar nor scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Content {
    Shapes,
    Species,
    Table,
}

/// Least number of numbers in a row of coefficients.
const TABLE_ROW: usize = 6;

/// Type of a file by its lines: keys that only particle-shapes or species have at the top, or rows of coefficients between
/// braces.
fn content_of(bytes: &[u8]) -> Option<Content> {
    let text = String::from_utf8_lossy(bytes);
    let lines = || text.lines().map(str::trim).filter(|l| !l.is_empty() && !l.starts_with(['#', ';']));
    let has_key =
        |key: &str| lines().any(|l| l.strip_prefix(key).is_some_and(|rest| rest.trim_start().starts_with('=')));
    // A scene may have the same keys in its tables, but then has one of these headers.
    let has_table = lines().any(|l| l.starts_with("[plants") || l.starts_with("[clouds"));
    if !has_table && has_key("apical_control") {
        return Some(Content::Species);
    }
    if !has_table && has_key("levels") {
        return Some(Content::Shapes);
    }
    let is_row = |l: &str| {
        let words: Vec<&str> = l.split_whitespace().collect();
        words.len() >= TABLE_ROW && words.iter().all(|w| w.parse::<f64>().is_ok())
    };
    let is_fractint = lines().any(|l| l.ends_with('{') || l.contains("{ ;") || l.contains("{;")) && lines().any(is_row);
    let is_flame = lines().next().is_some_and(|l| l.starts_with("<flame"));
    (is_fractint || is_flame).then_some(Content::Table)
}

/// Whether a file holds the coefficients of an IFS: by its ending `.ifs` or `.flame`, or for TOML by a line that begins with `[ifs`
/// or `[[ifs`.
fn is_coefficient_table(path: &Path, bytes: &[u8]) -> bool {
    let ending = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
    // Lines are searched before any parsing, so that a scene with a syntax error is still reported as a scene.
    let has_ifs_table = || bytes.split(|b| *b == b'\n').any(|l| l.starts_with(b"[ifs") || l.starts_with(b"[[ifs"));
    matches!(ending.as_str(), "ifs" | "flame") || (ending == "toml" && has_ifs_table())
}

/// The preset that a source names, as commands that take a source find it: `oak` is the scene `oak.toml`, else the grammar `oak.l` and
/// so on; a given ending selects one. `None` for any other name.
pub fn named_preset(name: &str) -> Option<&'static Preset> {
    let endings = ["", ".toml", ".l", ".shapes", ".species", ".ifs.toml", ".ifs"];
    endings.iter().find_map(|ending| presets::find(&format!("{name}{ending}")))
}

/// The error for a name that is neither a file nor a preset: it proposes the nearest preset, for a name with an ending also the
/// nearest file beside it.
pub(crate) fn no_such_source(name: &str) -> Error {
    let missing = |hint: String| Error::io("open", name, std::io::Error::new(std::io::ErrorKind::NotFound, hint));
    // A name with an ending means a file: `dragn.png` is no misspelling of the preset `dragon`.
    if Path::new(name).extension().is_some() {
        let files = names_beside(Path::new(name));
        let file = nearest(&name_of(Path::new(name)), files.iter().map(String::as_str));
        let preset = nearest(name, presets::PRESETS.iter().map(|p| p.name));
        return missing(match (file, preset) {
            (Some(near), _) => {
                format!("no such file; did you mean \"{}\"?", Path::new(name).with_file_name(near).display())
            }
            (None, Some(near)) => format!("no such file; did you mean the preset \"{near}\"?"),
            (None, None) => "no such file".into(),
        });
    }
    let names = presets::PRESETS.iter().map(|p| p.name.split('.').next().unwrap_or(p.name));
    let hint = match (presets::other_name(name), nearest(name, names)) {
        (Some(species), _) => {
            format!("no such file or preset; did you mean \"{species}\", another name of that tree?")
        }
        (None, Some(near)) => format!("no such file or preset; did you mean \"{near}\"?"),
        (None, None) => "no such file or preset; `osier list presets` shows the presets".into(),
    };
    missing(hint)
}

/// Names of the files beside a path in alphabetical order; none where the folder cannot be read.
fn names_beside(path: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder_of(path)).into_iter().flatten().flatten();
    let files = entries.filter(|e| e.file_type().is_ok_and(|kind| !kind.is_dir()));
    let mut names: Vec<String> = files.map(|e| e.file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

/// The request for a preset, found as by [`named_preset`].
fn find_preset(name: &str, options: &SourceOptions, table_use: TableUse) -> Result<Request> {
    let Some(preset) = named_preset(name) else {
        return Err(if Path::new(name).is_dir() { folder_error(name) } else { no_such_source(name) });
    };
    // `bush.ifs.toml` is the plant "bush".
    let stem = preset.name.split('.').next().unwrap_or(preset.name);
    if [".l", ".shapes", ".species"].iter().any(|e| preset.name.ends_with(e)) {
        return Ok(plant_request(stem, preset.name));
    }
    if preset.name.contains(".ifs") {
        let table = TableFile { name: stem, file: preset.name, bytes: preset.text.as_bytes() };
        return Ok(table_request(table, options, table_use));
    }
    let shown = format!("preset:{}", preset.name);
    if presets::kind(preset) == PresetKind::Mesh {
        let text = format!("[plants.mesh]\nmesh = \"{}\"\n[ground]\nshow = false\n", preset.name);
        return Ok(Request { name: stem.into(), shown, text, ..Request::default() });
    }
    Ok(Request { name: stem.into(), shown, text: preset.text.into(), ..Request::default() })
}

fn file_stem(path: &Path) -> String {
    path.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default()
}
