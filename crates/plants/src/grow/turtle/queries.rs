//! Derivation of grammars with queries, which a turtle answers with its position and orientation.

use super::interpreter::Turtle;
use super::options::TurtleOptions;
use super::step_part::SymbolRole;
use osier_base::diagnostic::Diagnostic;
use osier_base::limits::Limits;
use osier_base::{Error, Result};
use osier_grammar::{
    BindingEvaluator, DeriveOptions, DerivedString, Dialect, Grammar, TurtleAnswers, derive_part, derive_with_queries,
    interpret_modules,
};

/// Derives a grammar for [`super::grow`], as [`osier_grammar::derive_deferred`] does. Queries `?P ?H ?L ?U ?Q` and bounds such as
/// `vvXmin()` are answered by a turtle with these options, which interprets the string after the axiom and after each step.
/// # Errors
/// As [`osier_grammar::derive`]; for a grammar with queries also as [`super::grow`].
pub fn derive(
    grammar: &Grammar,
    options: &DeriveOptions,
    turtle: &TurtleOptions,
    limits: &Limits,
) -> Result<DerivedString> {
    if let Some(part) = turtle.step_part {
        return derive_growing(grammar, options, turtle, part, limits);
    }
    if !grammar.has_queries() {
        return osier_grammar::derive_deferred(grammar, options, limits);
    }
    derive_with_queries(grammar, options, limits, &mut |string| answers(grammar, string, turtle, limits))
}

/// Derives the string of a grammar as text, as [`osier_grammar::derive_text`] does; queries are answered as by [`derive()`].
/// # Errors
/// Those of [`derive()`]; `Input` with L063 if a part of a step is requested, which text cannot show.
pub fn derive_text(
    grammar: &Grammar,
    options: &DeriveOptions,
    turtle: &TurtleOptions,
    limits: &Limits,
) -> Result<DerivedString> {
    if turtle.step_part.is_some() {
        return Err(refused(
            grammar,
            "a part of a step can be drawn, but not written as a string",
            "use a whole number of steps",
        ));
    }
    if !grammar.has_queries() {
        return osier_grammar::derive_text(grammar, options, limits);
    }
    derive(grammar, options, turtle, limits)
}

/// Derives a string whose last step is drawn only by the share `part`.
fn derive_growing(
    grammar: &Grammar,
    options: &DeriveOptions,
    turtle: &TurtleOptions,
    part: f64,
    limits: &Limits,
) -> Result<DerivedString> {
    let derived = derive_part(grammar, options, part, limits)?;
    // Checks that the notation has parts of steps.
    roles(grammar, &derived, turtle, limits)?;
    Ok(derived)
}

/// What the symbols of a grammar do for the growth within a step.
/// # Errors
/// `Input` with L063 for a grammar of another program than cpfg, unless it binds its symbols itself.
pub(super) fn roles(
    grammar: &Grammar,
    derived: &DerivedString,
    turtle: &TurtleOptions,
    limits: &Limits,
) -> Result<Vec<SymbolRole>> {
    let own = Turtle::new(grammar, BindingEvaluator::new(grammar, derived, limits), turtle, limits);
    let dialect = own.dialect.kind;
    if !dialect.has_cpfg_commands() && !matches!(dialect, Dialect::Catkin | Dialect::None) {
        let help = "use a whole number of steps, or `osier convert --to cpfg`";
        return Err(refused(grammar, "a part of a step can be drawn of grammars in the notation of cpfg only", help));
    }
    Ok(own.symbol_roles())
}

/// The error L063 for a part of a step.
pub(super) fn refused(grammar: &Grammar, message: &str, help: &str) -> Error {
    let place = grammar.place_of(None, 'F');
    grammar.report(vec![Diagnostic::error("L063", message.to_owned(), place, "here").help(help)])
}

fn answers(
    grammar: &Grammar,
    string: &DerivedString,
    options: &TurtleOptions,
    limits: &Limits,
) -> Result<TurtleAnswers> {
    let mut turtle = Turtle::new(grammar, BindingEvaluator::new(grammar, string, limits), options, limits);
    turtle.asked = true;
    interpret_modules(grammar, string, limits, |m, index| {
        turtle.index = index;
        turtle.module(m);
    })?;
    turtle.end();
    // Errors that end the interpretation are returned now; warnings are reported for the final string only.
    turtle.diagnostics()?;
    Ok(turtle.answers)
}
