//! L-system files in the cpfg notation, and their derivation.
//!
//! [`parse`] turns text into a [`Grammar`] (or into diagnostics, all of them at once), [`derive()`] rewrites its axiom step by step,
//! [`interpret`] passes the modules of the final string to a turtle. Text is data: nothing in a grammar opens files or runs programs.
//!
//! # Examples
//! ```
//! use std::collections::BTreeMap;
//! use std::io::ErrorKind::NotFound;
//!
//! use osier_base::{Error, diagnostic::Sources, limits::Limits};
//! use osier_grammar::{DeriveOptions, GrammarSource, derive, interpret, parse};
//!
//! let text = "Lsystem: 1\nderivation length: 3\nAxiom: A\nA --> A B\nB --> A\nendlsystem\n";
//! let (mut sources, limits, defines) = (Sources::default(), Limits::default(), BTreeMap::new());
//! let mut includes = |name: &str, _: &str| Err(Error::io("open", name, NotFound.into()));
//! let source =
//!     GrammarSource { name: "algae.l", bytes: text.as_bytes(), includes: &mut includes, defines: &defines, functions: Default::default() };
//! let (grammar, _warnings) = parse(&mut sources, source, &limits)?;
//! let derived = derive(&grammar, &DeriveOptions::default(), &limits)?;
//! assert_eq!(grammar.print(&derived.modules), "ABAAB");
//!
//! let mut letters = String::new();
//! interpret(&grammar, &derived, &limits, |m| letters.push(grammar.symbols().get(m.symbol)))?;
//! assert_eq!(letters, "ABAAB");
//! # Ok::<(), Error>(())
//! ```

mod binding;
mod code;
pub mod companion;
mod compile;
mod cpfg_random;
mod derive;
mod dialect;
mod evaluate;
mod functions;
mod grammar;
mod lint;
mod modules;
mod notation;
mod preprocess;
mod print_format;
mod program;
mod symbols;
mod token;
mod vm;

use std::collections::BTreeMap;
use std::sync::Arc;

pub use binding::{Dialect, DialectSettings, TurtleAction, TurtleAxis};
pub use derive::{
    AskTurtle, DeriveOptions, DerivedString, Interpretation, LastStep, Origin, Prediction, QueryAnswer, QueryValue,
    TurtleAnswers, derive, derive_deferred, derive_part, derive_steps, derive_text, derive_with_queries, interpret,
    interpret_modules, predict,
};
pub use dialect::{ConvertTo, Converted, FileKind, ReadAs, convert, detect, entries};
pub use evaluate::BindingEvaluator;
pub use functions::{DataFunction, FunctionTables, Spline, SplineEnds};
pub use grammar::Grammar;
pub use modules::{Module, ModuleString};
pub use notation::Notation;
pub use preprocess::{Define, DefineRange, Includes};
pub use symbols::{SymbolId, Symbols};

use osier_base::diagnostic::{Diagnostic, Report, Sources};
use osier_base::limits::Limits;
use osier_base::{Error, Result};
use token::{ParseSession, SourcePlace};

/// A grammar file in memory, with its includes and overrides.
pub struct GrammarSource<'a> {
    /// Name of the file in diagnostics; its extension helps to detect the notation.
    pub name: &'a str,
    /// Content of the file: UTF-8, or Latin-1 with a warning.
    pub bytes: &'a [u8],
    /// Finds the files that the grammar includes.
    pub includes: &'a mut Includes<'a>,
    /// Values that replace those of the grammar's `#define`s. Names that the grammar does not define have no effect:
    /// [`Grammar::defines`] lists those it has.
    pub defines: &'a BTreeMap<String, String>,
    /// Functions and curves that the grammar's expressions read; empty without companion files.
    pub functions: Arc<FunctionTables>,
}

/// Parses a grammar in the notation that its content and name indicate. Adds its texts to `sources`, which all diagnostics
/// refer to. Returns the grammar with its warnings.
/// # Errors
/// `Input` with all errors of the file.
pub fn parse(sources: &mut Sources, source: GrammarSource<'_>, limits: &Limits) -> Result<(Grammar, Vec<Diagnostic>)> {
    parse_as(sources, source, ReadAs::default(), limits)
}

/// Like [`parse`], but with a given notation, and for one entry of a file that holds several.
/// # Errors
/// As [`parse`]; L061 if the file has several entries and none is named.
pub fn parse_as(
    sources: &mut Sources,
    source: GrammarSource<'_>,
    read_as: ReadAs<'_>,
    limits: &Limits,
) -> Result<(Grammar, Vec<Diagnostic>)> {
    let notation = read_as.notation.unwrap_or_else(|| match detect(source.name, source.bytes) {
        FileKind::Grammar(notation) => notation,
        FileKind::Houdini | FileKind::Other => Notation::Cpfg,
    });
    match notation {
        Notation::Cpfg | Notation::Abop | Notation::Catkin => parse_cpfg(sources, source, notation, limits),
        _ => dialect::parse(notation, read_as.entry, sources, &source, limits),
    }
}

fn parse_cpfg(
    sources: &mut Sources,
    source: GrammarSource<'_>,
    notation: Notation,
    limits: &Limits,
) -> Result<(Grammar, Vec<Diagnostic>)> {
    let mut session = ParseSession::default();
    let first = sources.ids().count();
    let GrammarSource { name, bytes, includes, defines, functions } = source;
    session.functions = functions;
    let input = preprocess::PreprocessorInput { name, bytes, includes, defines, limits };
    // Preprocess: expand includes, conditionals and macros into one list of tokens.
    let preprocessed = preprocess::run(&mut session, sources, input);
    if preprocessed.is_unreadable {
        return Err(input_error(&mut session, sources));
    }
    // Diagnostics without a location point to the start of the main file.
    let main = (first..).zip(sources.ids().skip(first)).map(|(_, id)| id).find(|id| sources.name(*id) == name);
    let start = SourcePlace::start_of(main.unwrap_or(osier_base::diagnostic::SourceId(0)));
    // Compile all lines even after errors, so that all are reported; run the lints only if compilation succeeded.
    let tokens = dialect::with_turtle(&mut session, preprocessed.tokens, notation, start);
    let parsed = compile::parse(&mut session, tokens, start);
    if !session.has_errors() {
        lint::check(&mut session, &parsed.program);
    }
    if session.has_errors() {
        return Err(input_error(&mut session, sources));
    }
    let grammar = Grammar {
        program: Arc::new(parsed.program),
        label: parsed.label,
        description: preprocessed.description,
        defines: preprocessed.defines,
        notes: std::mem::take(&mut session.notes),
        sources: sources.clone(),
        expansions: session.expansions.iter().map(|e| (session.names.get(e.name).to_owned(), e.used_at)).collect(),
        start,
        notation,
        palette: Vec::new(),
    };
    Ok((grammar, std::mem::take(&mut session.diagnostics)))
}

/// The collected diagnostics as an error.
fn input_error(session: &mut ParseSession, sources: &Sources) -> Error {
    let diagnostics = std::mem::take(&mut session.diagnostics);
    Error::Input(Box::new(Report { sources: sources.clone(), diagnostics, ..Report::default() }))
}

#[cfg(test)]
mod tests;
