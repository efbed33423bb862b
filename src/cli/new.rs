//! `osier new`: a folder with a copy of a preset.

use std::path::Path;

use serde_json::json;

use super::Context;
use super::args::New;
use crate::presets::{self, Preset};
use osier_base::Result;
use osier_base::diagnostic::nearest;
use osier_base::files::{Folder, WriteOptions, safe_name};

/// Runs `osier new`; the result is the exit code. The folder receives the scene and the presets that it names:
/// grammars, particle-shapes, species, coefficient tables.
pub fn run(context: &Context, args: &New) -> Result<u8> {
    let name = args.name.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
    if name.is_empty() {
        context.console.complain(&format!("\"{}\" is not the name of a folder", args.name.display()));
        return Ok(2);
    }
    let Some((scene, named)) = scene_and_presets(&args.from, &name) else {
        let stems = presets::PRESETS.iter().map(|p| stem(p.name));
        let hint = match nearest(&args.from, stems) {
            Some(near) => format!("did you mean \"{near}\"?"),
            None => "`osier list presets` lists them".into(),
        };
        context.console.complain(&format!("there is no preset \"{}\"; {hint}", args.from));
        return Ok(1);
    };
    let scene_name = format!("{}.toml", safe_name(&name));
    let mut files: Vec<(String, String)> = vec![(scene_name.clone(), scene)];
    files.extend(named.iter().map(|p| (p.name.to_owned(), p.text.to_owned())));
    // All names are compared before the first file is written, so that a refusal leaves no partial copy.
    if let Some(path) = files.iter().map(|(f, _)| args.name.join(f)).find(|p| p.symlink_metadata().is_ok()) {
        let path = path.display();
        context.console.complain(&format!("\"{path}\" already exists and is not overwritten; choose another name"));
        return Ok(1);
    }
    if !context.common.dry_run {
        write(&args.name, &files)?;
    }
    let path = |f: &str| args.name.join(f).display().to_string();
    let paths: Vec<String> = files.iter().map(|(f, _)| path(f)).collect();
    if context.console.json {
        let value = json!({ "folder": args.name.display().to_string(), "files": paths });
        context.console.result(&format!("{value:#}\n"))?;
    } else {
        context.console.result(&format!("{}\n", paths.join("\n")))?;
        let scene = path(&scene_name);
        let quote = if scene.contains(char::is_whitespace) { "'" } else { "" };
        context.console.note(&format!("next: osier bake {quote}{scene}{quote}"));
    }
    Ok(0)
}

fn write(folder: &Path, files: &[(String, String)]) -> Result<()> {
    let out = Folder::plain(folder, WriteOptions::default())?;
    files.iter().try_for_each(|(name, text)| out.write(name, "text", text.as_bytes()))
}

/// What a preset that is no scene grows a plant by: the ending of its file, and the key that names it.
const GROWN_BY: [(&str, &str); 3] = [(".l", "grammar"), (".shapes", "shapes"), (".species", "species")];

/// The text of the scene and the presets that it names; for the name of a grammar, of particle-shapes or of a species a scene with one
/// plant. `None` for an unknown preset.
fn scene_and_presets(from: &str, name: &str) -> Option<(String, Vec<&'static Preset>)> {
    let bare = stem(from);
    let asked_for = GROWN_BY.iter().find(|(ending, _)| from.ends_with(*ending));
    if let Some(scene) = presets::find(&format!("{bare}.toml")).filter(|_| asked_for.is_none()) {
        let mut named = Vec::new();
        if let Ok(table) = scene.text.parse::<toml::Table>() {
            table.iter().for_each(|(key, value)| collect_presets(key, value, &mut named));
        }
        return Some((scene.text.to_owned(), presets::PRESETS.iter().filter(|p| named.contains(&p.name)).collect()));
    }
    let candidates = GROWN_BY.iter().filter(|kind| asked_for.is_none_or(|asked| asked == *kind));
    let (preset, key) = candidates.filter_map(|(e, key)| Some((presets::find(&format!("{bare}{e}"))?, key))).next()?;
    let text = format!(
        "# A scene of your own: change a number, bake again. `osier list options` shows every key.\ntitle = {}\n\n[plants.{}]\n{key} = \"{}\"\n",
        toml::Value::String(name.to_owned()),
        safe_name(bare),
        preset.name,
    );
    Some((text, vec![preset]))
}

/// Adds the names of the presets that a value of a scene refers to: the file names among its strings; a species may lack its ending.
fn collect_presets(key: &str, value: &toml::Value, named: &mut Vec<&'static str>) {
    match value {
        toml::Value::String(text) => {
            let with_ending = if key == "species" { presets::find(&format!("{text}.species")) } else { None };
            let file = presets::find(text).filter(|p| p.name.contains('.'));
            named.extend(file.or(with_ending).map(|p| p.name));
        }
        toml::Value::Array(list) => list.iter().for_each(|v| collect_presets(key, v, named)),
        toml::Value::Table(table) => table.iter().for_each(|(key, v)| collect_presets(key, v, named)),
        _ => {}
    }
}

fn stem(name: &str) -> &str {
    name.rsplit_once('.').map_or(name, |(stem, _)| stem)
}
