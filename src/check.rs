//! Validation of a scene without drawing or simulating it: all errors, and an estimate of what a bake would write.

use crate::bake::output::single_file::refuse_without_visible_plants;
use crate::bake::scene::{SceneOptions, assemble_for_estimate};
use crate::bake::{BakeContext, BakeEstimate};
use crate::recipe::{GivenKey, Growth, Recipe, Request, given_keys, path_element, resolve};
use osier_base::diagnostic::Report;
use osier_base::{Error, Result};
use osier_grammar::DefineRange;

/// A `#define` of a plant's grammar, which a scene may override.
#[derive(Debug, Clone, PartialEq)]
pub struct GrammarParameter {
    /// Scene key that overrides it: `plants.oak.set.CROOK`.
    pub key: String,
    /// Value as written in the grammar, or in the scene if that overrides it.
    pub value: String,
    /// Value as a number; `None` for an expression.
    pub number: Option<f64>,
    /// Range of useful values: the one with which the comment begins, else 0 to twice the grammar's value; widened to the value.
    /// `None` for an expression.
    pub range: Option<DefineRange>,
    /// Comment beside the `#define`, without the range.
    pub about: String,
    /// Name of the grammar's file, as messages show it.
    pub file: String,
    /// Byte range of the value in the grammar, also if the scene overrides it: the first byte, and the byte after the last.
    pub span: [u32; 2],
}

/// The `#define`s of all grammars of a recipe, plant by plant in the order of their grammars.
pub fn grammar_parameters(recipe: &Recipe) -> Vec<GrammarParameter> {
    let mut parameters = Vec::new();
    for plant in &recipe.plants {
        let Growth::Grammar(grammar) = &plant.growth else { continue };
        let defines = grammar.defines().iter().filter(|d| d.is_parameter(grammar.defines()));
        parameters.extend(defines.map(|d| GrammarParameter {
            key: format!("plants.{}.set.{}", path_element(&plant.name), d.name),
            value: d.value.clone(),
            number: d.number(),
            range: d.range(),
            about: d.about().to_owned(),
            file: grammar.sources().name(d.value_span.source).to_owned(),
            span: [d.value_span.start, d.value_span.end],
        }));
    }
    parameters
}

/// Diagnostics, estimate and keys of one scene, as far as [`check`] got.
#[derive(Debug, Default)]
pub struct CheckResult {
    /// All errors and warnings of the scene and of the files that it names.
    pub report: Report,
    /// Prediction of a bake of the whole clip; `None` if the scene has errors or is a picture of layers.
    pub estimate: Option<BakeEstimate>,
    /// Keys that the text of the scene sets, in its order, without overrides.
    pub keys: Vec<GivenKey>,
    /// Macros of the plants' grammars that the tables `plants.NAME.set` can override.
    pub parameters: Vec<GrammarParameter>,
    /// Error that ended the check, other than errors of the scene: `Limit`, also of an estimated size that a bake would refuse,
    /// `Cancelled`, or X030 for a scene in which nothing is visible.
    pub failure: Option<Error>,
}

/// Resolves a scene, grows its plants and estimates its bake. Maps are not drawn and no wind, rain or motion is
/// simulated. `with_notes`: the report also holds the notes of the grammars.
/// # Examples
/// ```
/// use osier::bake::BakeContext;
/// use osier::limits::Limits;
/// use osier::progress::Cancel;
/// use osier::recipe::Request;
///
/// let (limits, cancel) = (Limits::default(), Cancel::default());
/// let context = BakeContext::quiet(&limits, &cancel);
/// let request = |text: &str| Request { name: "tuft".into(), text: text.into(), ..Request::default() };
/// let good = osier::check(&request("[plants.tuft]\ngrammar = \"grass.l\"\n"), false, &context);
/// assert!(!good.report.has_errors() && good.estimate.is_some_and(|e| e.triangles > 0));
/// let misspelt = osier::check(&request("[plants.tuft]\ngramar = \"grass.l\"\n"), false, &context);
/// assert!(misspelt.report.diagnostics.iter().any(|d| d.code == "S002"));
/// ```
pub fn check(request: &Request, with_notes: bool, context: &BakeContext<'_>) -> CheckResult {
    let mut result = CheckResult { keys: given_keys(request), ..CheckResult::default() };
    match check_into(request, with_notes, context, &mut result) {
        Ok(()) => {}
        // Results from before the error are kept; errors of the scene join the report.
        Err(Error::Input(report)) => result.report.extend(*report),
        Err(other) => result.failure = Some(other),
    }
    result
}

fn check_into(request: &Request, with_notes: bool, context: &BakeContext<'_>, result: &mut CheckResult) -> Result<()> {
    let (recipe, warnings) = resolve(&Request { thorough: true, ..request.clone() })?;
    result.report.extend(warnings);
    result.parameters = grammar_parameters(&recipe);
    if with_notes {
        for plant in &recipe.plants {
            let Growth::Grammar(grammar) = &plant.growth else { continue };
            result.report.extend(plant.companions.notes.clone());
            result.report.extend(Report {
                sources: grammar.sources().clone(),
                diagnostics: grammar.notes().to_vec(),
                ..Report::default()
            });
        }
    }
    // A picture of layers has no geometry to estimate.
    if recipe.is_layered_picture() {
        return Ok(());
    }
    let assembled = assemble_for_estimate(&recipe, SceneOptions::BAKE, context)?;
    result.report.extend(assembled.report.clone());
    // An empty list of frames means a still scene.
    let frames: Vec<u32> =
        if recipe.clip.len() > 1 { (recipe.clip.start..=recipe.clip.end).collect() } else { Vec::new() };
    let estimate = result.estimate.insert(assembled.estimate(&recipe, &frames));
    refuse_without_visible_plants(&assembled.animated.scene)?;
    // The limit of memory depends on the machine that bakes, so the estimate reports memory without checking it.
    estimate.check_size(context.limits)
}
