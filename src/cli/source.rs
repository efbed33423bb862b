//! What a typed SOURCE means: a path, `-`, or the name of a preset.

use std::ffi::OsStr;
use std::path::Path;

use super::Context;
use crate::presets;
use crate::recipe::{Library, Request};
use osier_base::diagnostic::{Diagnostic, Report, nearest};
use osier_base::{Error, Result, files};
use osier_ifs::read;

/// A request for the recipe of a source, with the common flags laid in.
/// # Errors
/// `Io` if it cannot be read, `Input` if it is no scene or grammar.
pub fn request(context: &Context, source: &str) -> Result<Request> {
    resolved(context, source, false)
}

/// As [`request`] for a picture: a coefficient table is drawn as points even if it could grow a tree.
/// # Errors
/// As [`request`].
pub fn picture(context: &Context, source: &str) -> Result<Request> {
    resolved(context, source, true)
}

fn resolved(context: &Context, source: &str, picture: bool) -> Result<Request> {
    let common = &context.common;
    let mut request = find(context, source, picture)?;
    request.set = common.set.iter().filter(|s| !s.trim_start().starts_with("as=")).cloned().collect();
    request.seed = common.seed;
    request.limits = context.limits.clone();
    Ok(request)
}

fn find(context: &Context, source: &str, picture: bool) -> Result<Request> {
    let path = Path::new(source);
    let search = &context.common.search;
    // A folder is no source: the name of a preset may also be that of the folder it was baked into.
    if source != "-" && !source.contains(['/', '\\']) && (!path.exists() || path.is_dir()) {
        return Ok(Request { library: Library::presets(search)?, ..preset(context, source, picture)? });
    }
    if path.is_dir() {
        return Err(folder(source));
    }
    // A path that is not there is best reported before anything that is said about its folder.
    let bytes = files::read_input(path, context.limits.get("text-bytes"))?;
    if path.extension() == Some(OsStr::new("l")) {
        let name = path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
        return Ok(Request { library: Library::new(path, search)?, ..Request::bare(&stem(path), &name) });
    }
    if is_table(path, &bytes) {
        let name = path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
        let short = name.split('.').next().unwrap_or(&name);
        let table = table(&name, short, &bytes, context, picture);
        return Ok(Request { library: Library::new(path, search)?, ..table });
    }
    if let Some(ending) = path.extension().filter(|e| ["obj", "glb", "gltf"].iter().any(|m| e.eq_ignore_ascii_case(m)))
    {
        let message = format!("\"{source}\" is a mesh (.{}), neither scene nor grammar", ending.display());
        let mut report = Report::default();
        report.push(Diagnostic::about("S001", message).help("name it in a scene: mesh = \"FILE\" below an organ"));
        return Err(Error::Input(Box::new(report)));
    }
    let text = files::decode(&bytes, files::Encoding::Utf8).map_err(|bad| {
        let mut report = Report::default();
        bad.report("S001", source, &bytes, &mut report);
        Error::Input(Box::new(report))
    })?;
    let name = if source == "-" { "stdin".into() } else { stem(path) };
    Ok(Request {
        name,
        shown: source.into(),
        text: text.text,
        library: Library::new(path, search)?,
        ..Request::default()
    })
}

/// A folder where a scene was expected.
fn folder(source: &str) -> Error {
    let mut report = Report::default();
    let help = "name a scene or grammar in it; `osier info` and `osier preview` take the folder of a bake";
    report.push(Diagnostic::about("S001", format!("\"{source}\" is a folder, not a scene")).help(help));
    Error::Input(Box::new(report))
}

/// A table of branches grows a tree, any other is drawn as points; `--set as=cloud` draws a tree's points as well.
fn table(file: &str, name: &str, bytes: &[u8], context: &Context, picture: bool) -> Request {
    let systems = read::read(file, bytes, &context.limits).map(|r| r.0).unwrap_or_default();
    let wanted = |v: &str| context.common.set.iter().any(|s| s.replace(' ', "") == format!("as={v}"));
    let branches = systems.first().is_some_and(|s| s.maps.iter().any(|m| m.branch.is_some()));
    if !wanted("cloud") && !picture && (branches || wanted("tree")) {
        Request::tree(name, file)
    } else {
        Request::cloud(name, file)
    }
}

/// Whether a file holds coefficients: by its ending, or for TOML by a table `[ifs]`.
fn is_table(path: &Path, bytes: &[u8]) -> bool {
    let ending = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
    let holds = || bytes.split(|b| *b == b'\n').any(|l| l.starts_with(b"[ifs") || l.starts_with(b"[[ifs"));
    matches!(ending.as_str(), "ifs" | "flame") || (ending == "toml" && holds())
}

/// `oak` is the scene `oak.toml`, else the grammar `oak.l`; an ending picks one.
fn preset(context: &Context, name: &str, picture: bool) -> Result<Request> {
    let endings = ["", ".toml", ".l", ".ifs.toml", ".ifs"];
    let found = endings.iter().map(|e| format!("{name}{e}")).collect::<Vec<_>>();
    let found = found.iter().find_map(|n| presets::find(n));
    let Some(p) = found else {
        if Path::new(name).is_dir() {
            return Err(folder(name));
        }
        let names = presets::PRESETS.iter().map(|p| p.name.split('.').next().unwrap_or(p.name));
        let hint = match nearest(name, names) {
            Some(near) => format!("no such file or preset; did you mean \"{near}\"?"),
            None => "no such file or preset; `osier list presets` shows the presets".into(),
        };
        return Err(Error::io("open", name, std::io::Error::new(std::io::ErrorKind::NotFound, hint)));
    };
    let stem = p.name.split('.').next().unwrap_or(p.name);
    if p.name.ends_with(".l") {
        return Ok(Request::bare(stem, p.name));
    }
    if p.name.contains(".ifs") {
        return Ok(table(p.name, stem, p.text.as_bytes(), context, picture));
    }
    let shown = format!("preset:{}", p.name);
    Ok(Request { name: stem.into(), shown, text: p.text.into(), ..Request::default() })
}

fn stem(path: &Path) -> String {
    path.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default()
}
