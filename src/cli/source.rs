//! What a typed SOURCE means: a path, `-`, or the name of a preset.

use std::ffi::OsStr;
use std::path::Path;

use super::Context;
use crate::diagnostic::{Diagnostic, Report, nearest};
use crate::recipe::{Library, Request};
use crate::{Error, Result, fence, presets};

/// A request for the recipe of a source, with the common flags laid in.
/// # Errors
/// `Io` if it cannot be read, `Input` if it is no scene or grammar.
pub fn request(context: &Context, source: &str) -> Result<Request> {
    let common = &context.common;
    let mut request = find(context, source)?;
    request.set.clone_from(&common.set);
    request.seed = common.seed;
    request.limits = context.limits.clone();
    Ok(request)
}

fn find(context: &Context, source: &str) -> Result<Request> {
    let path = Path::new(source);
    let search = &context.common.search;
    if source != "-" && !source.contains(['/', '\\']) && !path.exists() {
        return Ok(Request { library: Library::presets(search)?, ..preset(source)? });
    }
    // A path that is not there is best reported before anything that is said about its folder.
    let bytes = fence::read_input(path, context.limits.get("text-bytes"))?;
    if path.extension() == Some(OsStr::new("l")) {
        let name = path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
        return Ok(Request { library: Library::new(path, search)?, ..Request::bare(&stem(path), &name) });
    }
    if let Some(ending) = path.extension().filter(|e| ["obj", "glb", "gltf"].iter().any(|m| e.eq_ignore_ascii_case(m)))
    {
        let message = format!("\"{source}\" is a mesh (.{}), neither scene nor grammar", ending.display());
        let mut report = Report::default();
        report.push(Diagnostic::about("S001", message).help("name it in a scene: mesh = \"FILE\" below an organ"));
        return Err(Error::Input(Box::new(report)));
    }
    let text = fence::decode(&bytes, fence::Encoding::Utf8).map_err(|bad| {
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

/// `oak` is the scene `oak.toml`, else the grammar `oak.l`; an ending picks one.
fn preset(name: &str) -> Result<Request> {
    let found = [name.to_owned(), format!("{name}.toml"), format!("{name}.l")].iter().find_map(|n| presets::find(n));
    let Some(p) = found else {
        let names = presets::PRESETS.iter().map(|p| p.name.rsplit_once('.').map_or(p.name, |(stem, _)| stem));
        let hint = match nearest(name, names) {
            Some(near) => format!("no such file or preset; did you mean \"{near}\"?"),
            None => "no such file or preset; `osier list presets` shows the presets".into(),
        };
        return Err(Error::io("open", name, std::io::Error::new(std::io::ErrorKind::NotFound, hint)));
    };
    let stem = p.name.rsplit_once('.').map_or(p.name, |(stem, _)| stem);
    if p.name.ends_with(".l") {
        return Ok(Request::bare(stem, p.name));
    }
    let shown = format!("preset:{}", p.name);
    Ok(Request { name: stem.into(), shown, text: p.text.into(), ..Request::default() })
}

fn stem(path: &Path) -> String {
    path.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default()
}
