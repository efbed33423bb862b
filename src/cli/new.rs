//! `osier new`: a folder with a copy of a preset.

use std::path::Path;

use serde_json::json;

use super::Context;
use super::args::New;
use crate::presets::{self, Preset};
use osier_base::Result;
use osier_base::diagnostic::nearest;
use osier_base::files::{Folder, WriteOptions, safe_name};

/// Runs `osier new`; the result is the exit code. The folder receives the scene and the grammars that it names.
pub fn run(context: &Context, args: &New) -> Result<u8> {
    let name = args.name.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
    if name.is_empty() {
        context.console.complain(&format!("\"{}\" is not the name of a folder", args.name.display()));
        return Ok(2);
    }
    let Some((scene, grammars)) = scene_and_grammars(&args.from, &name) else {
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
    files.extend(grammars.iter().map(|p| (p.name.to_owned(), p.text.to_owned())));
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

/// The text of the scene and the grammars that it names; for the name of a grammar a scene with one plant. `None` for
/// an unknown preset.
fn scene_and_grammars(from: &str, name: &str) -> Option<(String, Vec<&'static Preset>)> {
    let bare = stem(from);
    if let Some(scene) = presets::find(&format!("{bare}.toml")).filter(|_| !from.ends_with(".l")) {
        // Grammars are found by their quoted name in the text of the scene.
        let needed = |p: &&Preset| p.name.ends_with(".l") && scene.text.contains(&format!("\"{}\"", p.name));
        return Some((scene.text.to_owned(), presets::PRESETS.iter().filter(needed).collect()));
    }
    let grammar = presets::find(&format!("{bare}.l"))?;
    let text = format!(
        "# A scene of your own: change a number, bake again. `osier list options` shows every key.\ntitle = {}\n\n[plants.{}]\ngrammar = \"{}\"\n",
        toml::Value::String(name.to_owned()),
        safe_name(bare),
        grammar.name,
    );
    Some((text, vec![grammar]))
}

fn stem(name: &str) -> &str {
    name.rsplit_once('.').map_or(name, |(stem, _)| stem)
}
