//! Knobs of grammars: their #defines, which a scene sets by `plants.NAME.set.KNOB`.

use serde_json::{Value, json};

use super::{Context, source};
use crate::recipe::{Growth, Recipe, resolve};
use osier_base::Result;

/// A #define of a plant's grammar.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Knob {
    /// The key that sets it: `plants.oak.set.CROOK`.
    pub key: String,
    /// Its value, as the grammar or the scene writes it.
    pub value: String,
    /// The comment beside it.
    pub about: String,
}

/// The knobs of all grammars of a recipe, plant by plant in the order of their grammars.
pub fn of(recipe: &Recipe) -> Vec<Knob> {
    let mut knobs = Vec::new();
    for plant in &recipe.plants {
        let Growth::Grammar(grammar) = &plant.growth else { continue };
        knobs.extend(grammar.defines().iter().map(|d| Knob {
            key: format!("plants.{}.set.{}", plant.name, d.name),
            value: d.value.clone(),
            about: d.comment.clone(),
        }));
    }
    knobs
}

/// The knobs of scenes, grammars or presets.
/// # Errors
/// What reading and resolving them refuses.
pub fn of_sources(context: &Context, sources: &[String]) -> Result<Vec<Knob>> {
    let mut knobs = Vec::new();
    for name in sources {
        let (recipe, warnings) = resolve(&source::request(context, name)?)?;
        context.console.report(&warnings);
        knobs.extend(of(&recipe));
    }
    Ok(knobs)
}

/// One knob a line; nothing without any.
pub fn as_text(knobs: &[Knob]) -> String {
    let Some(width) = knobs.iter().map(|k| k.key.len() + k.value.len() + 1).max() else { return String::new() };
    let width = width.min(48);
    let row = |k: &Knob| {
        let set = format!("{}={}", k.key, k.value);
        format!("  {set:width$}  {}", k.about).trim_end().to_owned() + "\n"
    };
    "knobs of the grammars (--set KEY=VALUE):\n".to_owned() + &knobs.iter().map(row).collect::<String>()
}

/// As a list of objects.
pub fn as_json(knobs: &[Knob]) -> Value {
    knobs.iter().map(|k| json!({ "key": k.key, "value": k.value, "about": k.about })).collect()
}
