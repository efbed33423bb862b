//! `osier list`: presets, species, scene keys, parameters of grammars, formats, codes and limits.

use std::ffi::OsString;
use std::path::Path;

use clap::ValueEnum as _;
use serde_json::json;

use super::args::{List, What};
use super::preset_list::{begins_a_word, matching_presets, matching_species};
use super::{Context, SCENE_FLAGS, knobs, preset_list};
use crate::recipe::{KeyInfo, TableInfo, options};
use crate::single_file::endings;
use crate::source::{entry_sources, find_scene, system_sources};
use osier_base::Result;
use osier_base::diagnostic::codes::{CODES, Code};
use osier_base::diagnostic::{Severity, visible};
use osier_base::limits::{LIMITS, grouped};
use osier_export::format::FormatInfo;
use osier_export::registry;

/// Runs `osier list`: composes one text and prints it. The result is the exit code: 2 for words that do not fit, 3 for
/// warnings under `--strict`.
pub fn run(context: &Context, args: &List) -> Result<u8> {
    if let Some(why) = misplaced(args) {
        context.console.complain(&why);
        return Ok(2);
    }
    // Flags without effect: none for parameters, which are read from the named scenes; three for presets; all scene flags for
    // other lists.
    let without_effect: &[&'static str] = match args.what {
        What::Knobs => &[],
        What::Presets => &["--set", "--dialect", "--rng"],
        _ => &SCENE_FLAGS,
    };
    if let Some(flag) = context.scene_flag(without_effect) {
        context.console.complain(&format!("{flag} does not change this list, for which no scene of yours is read"));
        return Ok(2);
    }
    // Words without a matching key are an error, not an empty list.
    let tables = matching(&args.words);
    if args.what == What::Options && tables.is_empty() {
        context
            .console
            .complain(&format!("no key contains {}; `osier list options` lists all keys", quoted(&args.words)));
        return Ok(2);
    }
    let is_knobs = args.what == What::Knobs;
    let (knobs, warned) = if is_knobs { knobs::of_sources(context, &args.words)? } else { (Vec::new(), false) };
    // A dry run draws nothing.
    let thumbnails = args.thumbnails.as_deref().filter(|_| !context.common.dry_run);
    // One text per kind of list; kinds without a JSON arm here share `as_json`.
    let text = match (args.what, context.console.json) {
        (What::Presets, true) => {
            format!("{:#}\n", preset_list::as_json(context, &matching_presets(&args.words), thumbnails)?)
        }
        (What::Presets, false) => {
            let chosen = matching_presets(&args.words);
            thumbnails.map_or(Ok(()), |folder| preset_list::write_pictures(context, &chosen, folder))?;
            preset_list::as_text(&chosen)
        }
        (What::Species, true) => format!("{:#}\n", preset_list::species_json(&matching_species(&args.words))),
        (What::Entries, as_json) => {
            let sources = entries(context, &args.words)?;
            if as_json {
                format!("{:#}\n", json!(sources))
            } else {
                sources.iter().map(|s| format!("{}\n", visible(s))).collect()
            }
        }
        (What::Knobs, false) => knobs::as_text(&knobs),
        (What::Knobs, true) => format!("{:#}\n", knobs::as_json(&knobs)),
        (What::Options, false) => options_text(&tables),
        (What::Options, true) => format!("{:#}\n", options_json(&tables)),
        (What::Species, false) => preset_list::species_text(&matching_species(&args.words)),
        (What::Formats, false) => formats_text(),
        (What::Codes, false) => codes_text(&args.words),
        (What::Limits, false) => limits_text(context),
        (What::Codes, true) => format!("{:#}\n", codes_json(&args.words)),
        (what, true) => format!("{:#}\n", as_json(context, what)),
    };
    context.console.result(&text)?;
    Ok(context.strict(warned))
}

/// Rewrites the arguments `osier list FILE`, where FILE is a file and not a word, to `osier list entries FILE`.
pub fn with_entries(mut args: Vec<OsString>) -> Vec<OsString> {
    let is_list = args.get(1).is_some_and(|a| a == "list");
    let is_word = |a: &OsString| a.to_str().is_some_and(|w| What::from_str(w, true).is_ok());
    if is_list && args.get(2).is_some_and(|a| !is_word(a) && Path::new(a).is_file()) {
        args.insert(2, "entries".into());
    }
    args
}

/// Names of the L-systems and of the systems of coefficient tables of files, in the form `FILE#ENTRY` that other commands take.
/// # Errors
/// Those of [`find_scene`] for what is neither a file nor a preset, `Io` for a file that cannot be read.
fn entries(context: &Context, files: &[String]) -> Result<Vec<String>> {
    let mut sources = Vec::new();
    for file in files {
        if !Path::new(file).is_file() {
            find_scene(file, &context.sources)?;
        } else if let Some(systems) = system_sources(file, &context.limits)? {
            sources.extend(systems);
            continue;
        }
        sources.extend(entry_sources(file, &context.limits)?);
    }
    Ok(sources)
}

/// Message about words or flags that do not fit the first argument; `None` if all do.
fn misplaced(args: &List) -> Option<String> {
    if args.thumbnails.is_some() && args.what != What::Presets {
        return Some("only `list presets` draws --thumbnails".to_owned());
    }
    match args.what {
        What::Options => None,
        What::Presets if matching_presets(&args.words).is_empty() => Some(format!(
            "no preset has {} in its name or description; `osier list presets` lists all",
            quoted(&args.words)
        )),
        What::Species if matching_species(&args.words).is_empty() => Some(format!(
            "no species has {} in its name or description; `osier list species` lists all",
            quoted(&args.words)
        )),
        What::Knobs if args.words.is_empty() => {
            Some("name a scene, grammar or preset: osier list knobs oak".to_owned())
        }
        What::Entries if args.words.is_empty() => Some("name a file of L-systems: osier list FILE.l".to_owned()),
        What::Codes => {
            let unknown = args.words.iter().find(|word| !CODES.iter().any(|c| begins_with(c, word)))?;
            Some(format!("no code begins with \"{unknown}\"; `osier list codes` lists all codes"))
        }
        What::Presets | What::Species | What::Knobs | What::Entries => None,
        What::Formats | What::Limits if args.words.is_empty() => None,
        What::Formats | What::Limits => {
            Some(format!("`list formats` and `list limits` take no words, here {}", quoted(&args.words)))
        }
    }
}

fn quoted(words: &[String]) -> String {
    words.iter().map(|w| format!("\"{w}\"")).collect::<Vec<_>>().join(" and ")
}

/// Whether a word in lower case is the path of a key as scenes, `--set` and messages spell it: `plants.oak.leaf.size`, `solid.0.at`.
/// Any name stands for `NAME` and `LETTER`; the numbers of list elements do not count. `paths`: those of the table.
fn is_path_of(word: &str, paths: &[&str], key: &str) -> bool {
    let given: Vec<&str> = word.split('.').filter(|part| !part.bytes().all(|b| b.is_ascii_digit())).collect();
    paths.iter().any(|path| {
        let wanted: Vec<&str> = path.split('.').filter(|part| !part.is_empty()).chain([key]).collect();
        wanted.len() == given.len()
            && wanted
                .iter()
                .zip(&given)
                .all(|(want, part)| matches!(*want, "NAME" | "LETTER") || want.eq_ignore_ascii_case(part))
    })
}

/// The tables of options, reduced to keys for which each of the words begins a word of their description or is their path. Case is
/// ignored; tables without keys are left out.
fn matching(words: &[String]) -> Vec<TableInfo> {
    let words: Vec<String> = words.iter().map(|w| w.to_lowercase()).collect();
    let mut tables = options();
    for table in &mut tables {
        // Path and description of a table count for all of its keys: `list options wind speed` finds `speed` in `[wind]`.
        let place = format!("{} {}", table.path, table.about).to_lowercase();
        let path = table.path;
        let paths: Vec<&str> = std::iter::once(path).chain(table.also.iter().copied()).collect();
        table.keys.retain(|key| {
            // The key as --set takes it: `list options wind.speed` finds `speed` in `[wind]`.
            let name = format!("{path}.{} {}", key.name, key.name);
            let text = format!("{place} {name} {} {}", key.help, key.listing.accepts).to_lowercase();
            words.iter().all(|w| begins_a_word(&text, w) || is_path_of(w, &paths, key.name))
        });
    }
    tables.retain(|table| !table.keys.is_empty());
    tables
}

/// Whether `osier list options` has keys for a word.
pub fn has_options(word: &str) -> bool {
    !word.is_empty() && !matching(&[word.to_owned()]).is_empty()
}

fn options_text(tables: &[TableInfo]) -> String {
    let mut out = String::from(
        "Keys of a scene file (TOML). Values without a unit are in SI units; keys in degrees end in `_deg`.\n",
    );
    for table in tables {
        let header = match table.path {
            "" => String::new(),
            path if table.is_list => format!("[[{path}]]  "),
            path => format!("[{path}]  "),
        };
        out += &format!("\n{header}{}\n", table.about);
        for key in &table.keys {
            let default = &key.listing.default;
            let default = if default.is_empty() { String::new() } else { format!(" [{default}]") };
            out += &format!("  {:18} {}{default}\n  {:18}   {}\n", key.name, key.help, "", key.listing.accepts);
        }
    }
    out
}

fn formats_text() -> String {
    let mut out = String::from("Formats of a bake (output.formats, --formats):\n\n");
    for format in registry::FORMATS {
        out += &format!("  {:6} {}\n", format.word, format.about);
    }
    out += "\nEndings of `osier grow -o FILE`:\n\n";
    for (ending, about) in endings() {
        out += &format!("  .{ending:5} {about}\n");
    }
    out
}

/// Codes that begin with one of the words, in either case; all without words.
fn matching_codes(words: &[String]) -> impl Iterator<Item = &'static Code> {
    CODES.iter().filter(move |c| words.is_empty() || words.iter().any(|word| begins_with(c, word)))
}

fn begins_with(code: &Code, word: &str) -> bool {
    code.code.starts_with(&word.to_ascii_uppercase())
}

fn severity_word(severity: Severity) -> &'static str {
    if severity == Severity::Error { "error" } else { "warning" }
}

fn codes_text(words: &[String]) -> String {
    matching_codes(words).map(|c| format!("{}  {:7}  {}\n", c.code, severity_word(c.severity), c.summary)).collect()
}

fn codes_json(words: &[String]) -> serde_json::Value {
    matching_codes(words)
        .map(|c| json!({ "code": c.code, "severity": severity_word(c.severity), "summary": c.summary }))
        .collect()
}

fn limits_text(context: &Context) -> String {
    let mut out = String::from(
        "--max-NAME N changes a limit; N takes the suffixes k, M, G, or is `none`. OSIER_MAX=NAME=N,... does too.\n\n",
    );
    for l in LIMITS {
        out += &format!("  {:14} {:>16}  {}\n", l.name, shown(context.limits.get(l.name)), l.counts);
    }
    out
}

fn shown(limit: u64) -> String {
    if limit == u64::MAX { "none".into() } else { grouped(limit) }
}

fn options_json(tables: &[TableInfo]) -> serde_json::Value {
    // `lists`: the tables along a path of which a scene may have several; an override puts an index after their names.
    let all = options();
    let lists = |path: &str| -> Vec<&str> {
        let is_of_path =
            |t: &&TableInfo| path == t.path || path.strip_prefix(t.path).is_some_and(|rest| rest.starts_with('.'));
        let mut lists: Vec<&str> = all.iter().filter(|t| t.is_list).filter(is_of_path).map(|t| t.path).collect();
        lists.sort_unstable();
        lists
    };
    let row = |(t, k): (&TableInfo, &KeyInfo)| {
        let mut row = k.listing.form.as_json();
        let path = if t.path.is_empty() { k.name.to_owned() } else { format!("{}.{}", t.path, k.name) };
        let fields = json!({
            "table": t.path, "also": t.also, "key": k.name, "path": path, "help": k.help, "accepts": k.listing.accepts,
            "default_text": k.listing.default, "unit": k.listing.unit, "basic": k.basic, "lists": lists(t.path),
        });
        if let (Some(row), serde_json::Value::Object(fields)) = (row.as_object_mut(), fields) {
            row.extend(fields);
        }
        row
    };
    tables.iter().flat_map(|t| t.keys.iter().map(move |k| (t, k))).map(row).collect()
}

fn as_json(context: &Context, what: What) -> serde_json::Value {
    match what {
        // The caller makes the JSON of these kinds.
        What::Presets | What::Species | What::Options | What::Knobs | What::Entries | What::Codes => {
            serde_json::Value::Null
        }
        What::Formats => {
            let row = |f: &&FormatInfo| {
                let endings: Vec<String> = f.endings.iter().map(|(ending, _)| format!(".{ending}")).collect();
                json!({ "name": f.word, "about": f.about, "endings": endings })
            };
            registry::FORMATS.iter().map(row).collect()
        }
        What::Limits => {
            let row = |l: &osier_base::limits::Limit| {
                // The largest u64, which means "no limit", is above 2^53 and many JSON readers would change it: write null.
                let value = Some(context.limits.get(l.name)).filter(|value| *value != u64::MAX);
                json!({ "name": l.name, "default": l.default, "value": value, "counts": l.counts })
            };
            LIMITS.iter().map(row).collect()
        }
    }
}
