//! The strings that the grammars of a scene derive, as text.

use crate::bake::BakeContext;
use crate::bake::assets::plant_growth::derived_string_text;
use crate::bake::scene::layout::lay_out;
use crate::recipe::{Growth, Recipe};
use osier_base::diagnostic::Report;
use osier_base::{Error, Result};

/// The derived strings of a recipe, one for each individual of a plant that grows by a grammar, each on a line, as cpfg prints
/// them: parameters with six significant digits, no blanks.
#[derive(Debug)]
pub struct DerivedText {
    /// One line per individual, in the order of the layout.
    pub text: String,
    /// Number of modules of all strings.
    pub modules: u64,
    /// Warnings of the derivations, individual by individual.
    pub report: Report,
}

impl DerivedText {
    /// Derives every individual of the recipe that grows by a grammar, in the order of its places, without drawing it.
    /// # Errors
    /// X030 if the recipe has no grammar; `Input` as a derivation; `Cancelled`.
    pub fn derive(recipe: &Recipe, context: &BakeContext<'_>) -> Result<Self> {
        let mut out = Self { text: String::new(), modules: 0, report: Report::default() };
        let mut has_grammar = false;
        for individual in &lay_out(recipe).individuals {
            let Some(plant) = recipe.plants.get(individual.plant) else { continue };
            let Growth::Grammar(grammar) = &plant.growth else { continue };
            has_grammar = true;
            let mut derived = derived_string_text(plant, grammar, individual, context)?;
            let diagnostics = std::mem::take(&mut derived.warnings);
            let output = std::mem::take(&mut derived.output);
            out.modules += derived.module_count();
            out.text.push_str(&derived.into_text(grammar, context.limits)?);
            out.text.push('\n');
            out.report.extend(Report { sources: grammar.sources().clone(), diagnostics, output });
        }
        // An empty text is valid: a grammar may derive the empty string.
        if !has_grammar {
            let reason = format!("\"{}\" has no grammar; .txt is for derived strings", recipe.name);
            return Err(Error::export("X030", reason));
        }
        Ok(out)
    }
}
