//! The turtle: a string of modules becomes a [`Plant`].
//!
//! Drawn steps of one bracket level are one axis, `[` opens a child at the current node, `~c` and filled shapes become
//! organs. World: metres, +Y up; the turtle starts at the origin heading up.

mod bound_actions;
mod builder;
mod commands;
mod cylinders;
mod dialect_commands;
mod dialects;
mod extended;
mod frame;
mod guides;
mod interpreter;
mod options;
mod organs;
mod paint;
mod patches;
mod pixels;
mod prototypes;
mod queries;
mod step_part;
mod tropism;

use builder::PlantBuilder;
pub(super) use builder::set_exposed_lengths;
pub use cylinders::Contour;
pub use options::{OrganSpec, RadiusModel, STALK, Tropism, TurtleOptions};
pub use paint::{Paint, TURTLE_COLOR};
pub use patches::{patch_mesh, triangle_mesh};
pub use queries::{derive, derive_text};

use super::radii;
use interpreter::Turtle;
use osier_base::Result;
use osier_base::diagnostic::Diagnostic;
use osier_base::limits::Limits;
use osier_grammar::{
    BindingEvaluator, DerivedString, Dialect, Grammar, Interpretation, Module, interpret, interpret_modules,
};
use osier_scene::plant::{NONE, Plant};
use step_part::StepGrowth;

/// A plant that a turtle drew, with the warnings and the output of its grammar.
#[derive(Debug)]
pub struct Drawing {
    /// The plant, validated.
    pub plant: Plant,
    /// Warnings of the interpretation and of the homomorphism.
    pub warnings: Vec<Diagnostic>,
    /// What `printf` in the homomorphism wrote.
    pub output: String,
}

/// Interprets a derived string, as [`draw`] does.
/// Returns the plant and the warnings.
/// # Errors
/// Those of [`draw`].
pub fn grow(
    grammar: &Grammar,
    derived: &DerivedString,
    options: &TurtleOptions,
    limits: &Limits,
) -> Result<(Plant, Vec<Diagnostic>)> {
    draw(grammar, derived, options, limits).map(|drawing| (drawing.plant, drawing.warnings))
}

/// Interprets a derived string.
/// # Errors
/// `Input` with L043 for a command that is not available, L051 beyond a limit; the errors of `plant::validate`.
/// Source: cpfg's turtle; frame, turns, taper and tropisms as in the lines of each command.
pub fn draw(grammar: &Grammar, derived: &DerivedString, options: &TurtleOptions, limits: &Limits) -> Result<Drawing> {
    // Interpret every module in order; limits and forbidden commands are reported after the last one.
    let bindings = BindingEvaluator::new(grammar, derived, limits);
    let mut turtle = Turtle::new(grammar, bindings, options, limits);
    turtle.builder = PlantBuilder::for_modules(derived.module_count());
    let Interpretation { mut warnings, output } = match derived.last_step() {
        Some(step) => {
            let growth = StepGrowth::new(grammar, derived, step, &turtle.step_symbols());
            let mut draw = |m: Module<'_>, index: usize| turtle.growing_module(m, index, &growth, &step.before);
            let interpreted = interpret_modules(grammar, derived, limits, &mut draw)?;
            turtle.removed_steps(derived.modules.len(), &growth, &step.before);
            interpreted
        }
        None => interpret(grammar, derived, limits, |m| turtle.module(m))?,
    };
    turtle.end();
    warnings.extend(turtle.diagnostics()?);
    warnings.extend(turtle.bindings.warnings(grammar));
    // The plant in canonical order (axes depth first, organs by axis and arc length), then its radii: those that the
    // string sets, or a branching model (pipe model, taper) that overwrites them.
    let (sets_widths, symbol_place) = (turtle.sets_widths, grammar.place_of(None, 'F'));
    let dialect = turtle.dialect.kind;
    let draws_lines = dialect == Dialect::Fractint;
    if turtle.builder.is_empty() {
        warnings.push(nothing_drawn(grammar, derived, limits)?);
    }
    let mut plant = turtle.builder.finish(derived.plant_id, derived.seed, derived.steps, options);
    match options.radii {
        RadiusModel::Pipe(p) => radii::pipe(&mut plant, &p),
        RadiusModel::Taper(t) => radii::taper(&mut plant, &t),
        RadiusModel::Pixels => {
            let pixel = pixels::pixel_size(&plant);
            pixels::scale_widths(&mut plant, pixel / options.unit_m);
            warnings.push(pixels::warning(pixel, symbol_place));
        }
        RadiusModel::Auto if draws_lines => {}
        // Lines that do not branch are no tree: they get one width.
        RadiusModel::Auto if !sets_widths && plant.axes.iter().all(|a| a.parent == NONE) => {
            let pixel = pixels::pixel_size(&plant);
            pixels::set_width(&mut plant, pixel);
        }
        RadiusModel::Auto if !sets_widths => {
            let tip = pixels::visible_tip(&plant, radii::Pipe::default().tip);
            radii::pipe(&mut plant, &radii::Pipe { tip, ..radii::Pipe::default() });
        }
        RadiusModel::Hairs(t) if !sets_widths => radii::taper(&mut plant, &t),
        RadiusModel::Auto | RadiusModel::Widths | RadiusModel::Hairs(_) => {}
    }
    // Validation may thin children; a grammar that halves its widths intends that, so its report is not a warning.
    osier_scene::plant::validate(&mut plant)?;
    // Lines of a drawing have one width, which the validation would thin from branch to branch.
    if draws_lines && matches!(options.radii, RadiusModel::Auto) {
        dialects::set_line_radius(&mut plant);
    }
    if dialect == Dialect::LParser && matches!(options.radii, RadiusModel::Auto) {
        dialects::set_least_radius(&mut plant);
    }
    set_exposed_lengths(&mut plant);
    // Only thickness distinguishes shoots from old wood, since strings name no materials for axes.
    for axis in &mut plant.axes {
        let base = plant.nodes.r.get(axis.first as usize).copied().unwrap_or(0.0);
        let thin = f64::from(base) < options.shoot_radius;
        axis.material = options.shoot_material.filter(|_| thin).unwrap_or(options.axis_material);
    }
    Ok(Drawing { plant, warnings, output })
}

/// Number of symbols that L037 names, the most frequent first.
const NAMED_SYMBOLS: usize = 8;

/// L037 for a string that draws nothing, with the symbols that it consists of.
fn nothing_drawn(grammar: &Grammar, derived: &DerivedString, limits: &Limits) -> Result<Diagnostic> {
    let mut counts: std::collections::BTreeMap<char, u64> = std::collections::BTreeMap::new();
    for symbol in derived.string(grammar, limits)?.symbols() {
        *counts.entry(grammar.symbols().get(*symbol)).or_insert(0) += 1;
    }
    let mut list: Vec<(char, u64)> = counts.into_iter().filter(|(c, _)| !matches!(c, '[' | ']')).collect();
    list.sort_by_key(|(c, n)| (std::cmp::Reverse(*n), *c));
    let times = |n: u64| if n == 1 { "once".to_owned() } else { format!("{n} times") };
    let shown = |c: char| grammar.symbols().long_name(c).map_or_else(|| c.to_string(), str::to_owned);
    let named: Vec<String> =
        list.iter().take(NAMED_SYMBOLS).map(|(c, n)| format!("{} ({})", shown(*c), times(*n))).collect();
    let more = if list.len() > NAMED_SYMBOLS { ", .." } else { "" };
    let first = list.first().map_or('F', |(c, _)| *c);
    let message = if list.is_empty() {
        "the derived string is empty: nothing is drawn".to_owned()
    } else {
        format!("the derived string draws nothing; it consists of {}{more}", named.join(", "))
    };
    let place = grammar.place_of(None, first);
    let help = "draw with F(1), or give the symbols a homomorphism: Homomorphism, then A --> F(1)";
    Ok(Diagnostic::warning("L037", message, place, "made here").help(help))
}

#[cfg(test)]
mod step_part_tests;
#[cfg(test)]
mod tests;
