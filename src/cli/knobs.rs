//! `osier list knobs`: parameters of grammars (their #defines), which a scene overrides by `plants.NAME.set.PARAMETER`.

use serde_json::{Value, json};

use super::Context;
use crate::check::{GrammarParameter, grammar_parameters};
use crate::recipe::resolve;
use crate::source::find_scene;
use osier_base::Result;

/// Largest width of the column `KEY=VALUE`; the comments of longer entries are not aligned.
const MAX_KEY_WIDTH: usize = 48;

/// The parameters of scenes, grammars or presets, source by source, and whether there were warnings, which go to the console.
/// # Errors
/// `Io` for a source that cannot be read, `Input` for one with faults.
pub fn of_sources(context: &Context, sources: &[String]) -> Result<(Vec<GrammarParameter>, bool)> {
    let (mut parameters, mut warned) = (Vec::new(), false);
    for name in sources {
        let (recipe, warnings) = resolve(&find_scene(name, &context.sources)?)?;
        context.console.report(&warnings);
        warned |= !warnings.diagnostics.is_empty();
        let found = grammar_parameters(&recipe);
        if found.is_empty() {
            context.console.note(&format!(
                "note: \"{name}\" has no grammar with a #define to set; `osier list options` lists the keys of its scene, `osier list \
                 options habit` those of species, `osier list options growth` those of particle-shapes"
            ));
        }
        parameters.extend(found);
    }
    Ok((parameters, warned))
}

/// A heading and one parameter per line; empty text without any.
pub fn as_text(parameters: &[GrammarParameter]) -> String {
    // The widest `KEY=VALUE`, with one column for the sign between.
    let Some(width) = parameters.iter().map(|p| p.key.len() + p.value.len() + 1).max() else { return String::new() };
    let width = width.min(MAX_KEY_WIDTH);
    let row = |p: &GrammarParameter| {
        let set = format!("{}={}", p.key, p.value);
        format!("  {set:width$}  {}", p.about).trim_end().to_owned() + "\n"
    };
    "knobs of the grammars (--set KEY=VALUE):\n".to_owned() + &parameters.iter().map(row).collect::<String>()
}

/// A JSON list of objects: key, value as text and as a number, range with unit, meaning, file and byte range of the value.
pub fn as_json(parameters: &[GrammarParameter]) -> Value {
    let row = |p: &GrammarParameter| {
        let range = p.range.as_ref();
        json!({
            "key": p.key, "value": p.value, "number": p.number, "min": range.map(|r| r.min), "max": range.map(|r| r.max),
            "unit": range.map_or("", |r| r.unit.as_str()), "about": p.about, "file": p.file, "span": p.span,
        })
    };
    parameters.iter().map(row).collect()
}
