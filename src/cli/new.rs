//! `osier new`: a folder with a copy of a preset's scene and of the files that it names.

use std::path::Path;

use serde_json::json;

use super::args::New;
use super::report::shell_word;
use super::{Context, SCENE_FLAGS, preset_list};
use crate::presets::{self, Preset};
use osier_base::diagnostic::nearest;
use osier_base::files::{Folder, WriteOptions, name_of, safe_name};
use osier_base::{Error, Result};

/// Runs `osier new`; the result is the exit code. The folder receives the scene and the presets that it names:
/// grammars, particle-shapes, species, coefficient tables.
pub fn run(context: &Context, args: &New) -> Result<u8> {
    // Refuse names of files, and flags that a copied scene would not keep.
    let name = name_of(&args.name);
    if name.is_empty() {
        context.console.complain(&format!("\"{}\" is not the name of a folder", args.name.display()));
        return Ok(2);
    }
    let ending = args.name.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
    if ["toml", "l", "species", "shapes"].contains(&ending.as_str()) {
        let (given, folder) = (args.name.display(), args.name.with_extension(""));
        let folder = folder.display();
        context
            .console
            .complain(&format!("\"{given}\" is the name of a file; `osier new {folder}` makes a folder with a scene"));
        return Ok(2);
    }
    if let Some(flag) = context.scene_flag(&SCENE_FLAGS) {
        let why = format!("{flag} does not change what `new` copies; edit the copied scene");
        context.console.complain(&why);
        return Ok(2);
    }
    // Choose the preset: the one of `--from`, or the grammar that fits the words of `--grammar` best.
    let from = match &args.grammar {
        None => args.from.as_str(),
        Some(words) => {
            let Some(fits) = fitting_grammar(words) else {
                let grammars = presets::PRESETS.iter().filter(|p| p.name.ends_with(GRAMMAR));
                let hint = preset_hint(words, grammars);
                context.console.complain(&format!("no grammar of the library fits \"{words}\"; {hint}"));
                return Ok(1);
            };
            if !context.console.json {
                context.console.note(&format!("{}: {}", stem(fits.name), presets::about(fits)));
            }
            stem(fits.name)
        }
    };
    let Some((scene, named)) = scene_and_presets(from, &name) else {
        // A coefficient table is a file that scenes and `osier grow` name; `new` has no scene of it to copy.
        let bare = stem(from);
        let table = [".ifs", ".ifs.toml"].iter().find_map(|ending| presets::find(&format!("{bare}{ending}")));
        let why = match table.map(|p| p.name) {
            Some(file) if file.ends_with(".toml") => format!("there is no preset \"{from}\"; did you mean \"{file}\"?"),
            Some(file) => {
                let way = format!("`osier grow {file} -o {file}` writes its text");
                format!("the preset \"{file}\" is a coefficient table and no scene; {way}")
            }
            None => {
                let is_copied = |p: &&Preset| scene_and_presets(p.name, "").is_some();
                let hint = preset_hint(from, presets::PRESETS.iter().filter(is_copied));
                format!("there is no preset \"{from}\"; {hint}")
            }
        };
        context.console.complain(&why);
        return Ok(1);
    };
    // The files of the folder: the scene, and the presets that it names.
    let scene_name = format!("{}.toml", safe_name(&name));
    let mut files: Vec<(String, String)> = vec![(scene_name.clone(), scene)];
    files.extend(named.iter().map(|p| (p.name.to_owned(), p.text.to_owned())));
    // All names are checked before the first file is written, so that a refusal leaves no partial copy.
    if let Some(path) = files.iter().map(|(f, _)| args.name.join(f)).find(|p| p.symlink_metadata().is_ok()) {
        let path = path.display();
        context.console.complain(&format!("\"{path}\" already exists and is not overwritten; choose another name"));
        return Ok(1);
    }
    if !context.common.dry_run {
        write(&args.name, &files)?;
    }
    // Report the files and the next command.
    let path = |f: &str| args.name.join(f).display().to_string();
    let paths: Vec<String> = files.iter().map(|(f, _)| path(f)).collect();
    if context.console.json {
        let value = json!({ "folder": args.name.display().to_string(), "files": paths });
        context.console.result(&format!("{value:#}\n"))?;
    } else if !context.console.quiet {
        context.console.result(&format!("{}\n", paths.join("\n")))?;
        context.console.note(&format!("next: osier bake {}", shell_word(&path(&scene_name))));
    }
    Ok(0)
}

/// Help text for an unknown name: the most similar preset of `among`, or how to list them.
fn preset_hint(word: &str, among: impl Iterator<Item = &'static Preset>) -> String {
    match nearest(&word.to_lowercase(), among.map(|p| stem(p.name))) {
        Some(near) => format!("did you mean \"{near}\"?"),
        None => "`osier list presets` lists them".into(),
    }
}

const GRAMMAR: &str = ".l";
/// Weights of a word that occurs in the name of a grammar, in the first line of its comment, and elsewhere in the comment: a
/// name outweighs a first line, and that outweighs as many other words as a short query has.
const WORD_WEIGHTS: [u32; 3] = [16, 4, 1];

/// The grammar of the library that the words name or describe best: the one of that name, else the one with the highest score
/// of words; of equal scores the first in the alphabet. `None` if no word occurs.
fn fitting_grammar(words: &str) -> Option<&'static Preset> {
    let words = words.to_lowercase();
    let bare = words.trim().trim_end_matches(GRAMMAR).replace(' ', "-");
    if let Some(exact) = presets::find(&format!("{bare}{GRAMMAR}")) {
        return Some(exact);
    }
    let grammars: Vec<&'static Preset> = presets::PRESETS.iter().filter(|p| p.name.ends_with(GRAMMAR)).collect();
    let mut scores = vec![0_u32; grammars.len()];
    for word in words_of(&words) {
        let weights: Vec<u32> = grammars.iter().map(|preset| weight_of_word(preset, word)).collect();
        // Words that occur in many grammars count less.
        let bearers = (0_u32..).zip(weights.iter().filter(|w| **w > 0)).map(|(i, _)| i + 1).last().unwrap_or(1);
        scores.iter_mut().zip(weights).for_each(|(score, weight)| *score += weight * RARITY / bearers);
    }
    // `max_by_key` returns the last of equal maxima: reversed, it is the first in the alphabet.
    let scored = scores.into_iter().zip(grammars).rev();
    scored.max_by_key(|(score, _)| *score).filter(|(score, _)| *score > 0).map(|(_, preset)| preset)
}

/// Score of a word of weight 1 that occurs in only one grammar.
const RARITY: u32 = 1000;

/// Sum of the weights of the parts of a grammar's name and comment in which a word occurs; 0 if it occurs in none.
fn weight_of_word(preset: &Preset, word: &str) -> u32 {
    let comment = preset.text.split("*/").next().unwrap_or_default().to_lowercase();
    let mut lines = comment.splitn(2, '\n');
    let parts = [stem(preset.name), lines.next().unwrap_or_default(), lines.next().unwrap_or_default()];
    let found = |part: &&str| words_of(part).any(|w| is_same_word(w, word));
    parts.iter().zip(WORD_WEIGHTS).filter(|(part, _)| found(part)).map(|(_, weight)| weight).sum()
}

/// The words of a text with more than two bytes; shorter ones, such as articles, would match everywhere.
fn words_of(text: &str) -> impl Iterator<Item = &str> {
    text.split(|c: char| !c.is_alphanumeric()).filter(|w| w.len() > 2)
}

/// Whether two words are equal apart from a final "s".
fn is_same_word(a: &str, b: &str) -> bool {
    let singular = |w: &str| w.strip_suffix('s').unwrap_or(w).to_owned();
    a == b || singular(a) == singular(b)
}

/// Writes the files of the new folder. Messages of failures name no flag `-o`, which `osier new` does not have.
fn write(folder: &Path, files: &[(String, String)]) -> Result<()> {
    let out = Folder::plain(folder, WriteOptions::default());
    let written =
        out.and_then(|out| files.iter().try_for_each(|(name, text)| out.write(name, "text", text.as_bytes())));
    written.map_err(|e| match e {
        Error::Io { path, source, .. } => Error::io("make", path, source),
        other => other,
    })
}

/// Endings of presets that grow a plant, with the key of a plant that names such a file.
const GROWN_BY: [(&str, &str); 3] = [(".l", "grammar"), (".shapes", "shapes"), (".species", "species")];

/// The text of a preset's scene and the presets that it names, for a species those of the scene that shows it, with its leaf and
/// bark; for the name of a grammar, of particle-shapes or of another species, a scene with one plant. `None` for an unknown preset.
fn scene_and_presets(from: &str, name: &str) -> Option<(String, Vec<&'static Preset>)> {
    let shown = from.strip_suffix(".species").and_then(preset_list::scene_of_species);
    let bare = shown.unwrap_or_else(|| stem(from));
    let asked_for = GROWN_BY.iter().find(|(ending, _)| shown.is_none() && from.ends_with(*ending));
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

/// Collects the names of presets to which a value of a scene refers: strings that are file names; a species may lack its
/// ending.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_find_the_nearest_grammar() {
        let found = |words: &str| fitting_grammar(words).map(|p| p.name);
        assert_eq!(found("daisy"), Some("daisy.l"));
        assert_eq!(found("Lily of the Valley"), Some("lily-of-the-valley.l"));
        assert_eq!(found("wang-tree.l"), Some("wang-tree.l"));
        assert_eq!(found("parsley"), Some("cow-parsley.l"));
        assert_eq!(found("white umbels"), Some("cow-parsley.l"));
        assert_eq!(found("a flower with a capitulum"), Some("daisy.l"));
        assert_eq!(found("panicle"), Some("oat.l"));
        assert_eq!(found("rhombs"), Some("penrose.l"));
        assert_eq!(found("qqqq"), None);
        assert_eq!(found(""), None);
        for preset in presets::PRESETS.iter().filter(|p| p.name.ends_with(GRAMMAR)) {
            assert_eq!(found(stem(preset.name)), Some(preset.name), "found by its name");
        }
    }
}
