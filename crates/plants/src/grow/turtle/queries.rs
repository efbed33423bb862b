//! Derivation of grammars with queries, which a turtle answers with its position and orientation.

use super::interpreter::Turtle;
use super::options::TurtleOptions;
use osier_base::Result;
use osier_base::limits::Limits;
use osier_grammar::{
    BindingEvaluator, DeriveOptions, DerivedString, Grammar, TurtleAnswers, derive_with_queries, interpret_modules,
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
    if !grammar.has_queries() {
        return osier_grammar::derive_deferred(grammar, options, limits);
    }
    derive_with_queries(grammar, options, limits, &mut |string| answers(grammar, string, turtle, limits))
}

/// Derives the string of a grammar as text, as [`osier_grammar::derive_text`] does; queries are answered as by [`derive()`].
/// # Errors
/// Those of [`derive()`].
pub fn derive_text(
    grammar: &Grammar,
    options: &DeriveOptions,
    turtle: &TurtleOptions,
    limits: &Limits,
) -> Result<DerivedString> {
    if !grammar.has_queries() {
        return osier_grammar::derive_text(grammar, options, limits);
    }
    derive(grammar, options, turtle, limits)
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
