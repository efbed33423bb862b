//! Tokens of a grammar file, and the diagnostics about them.

use std::sync::Arc;

use super::functions::FunctionTables;
use osier_base::diagnostic::{Diagnostic, SourceId, Span};

/// Place of a token in the source, with the macro uses that produced it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct SourcePlace {
    /// Place of the token in a file, or in the body of a macro.
    pub span: Span,
    /// One-based index into [`ParseSession::expansions`]; 0 for a token that no macro produced.
    pub origin: u32,
}

impl SourcePlace {
    /// A place in the source outside macros.
    pub const fn bare(span: Span) -> Self {
        Self { span, origin: 0 }
    }

    /// The empty range at the start of a source.
    pub fn start_of(source: SourceId) -> Self {
        Self::bare(Span::new(source, 0, 0))
    }

    /// The range from here to `other`; only this place if the two come from different macro uses.
    pub fn to(self, other: Self) -> Self {
        if self.origin == other.origin { Self { span: self.span.to(other.span), ..self } } else { self }
    }
}

#[derive(Debug, Clone)]
pub(crate) struct Expansion {
    pub name: u32,
    pub used_at: SourcePlace,
}

/// Lexical class of a token; spellings are indices into [`NameTable`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum TokenKind {
    /// `[A-Za-z_][A-Za-z0-9_]*`, an index into [`NameTable`].
    Ident(u32),
    /// A number; its spelling is an index into [`NameTable`].
    Number(u32),
    /// A string in double quotes, without them.
    Text(u32),
    /// Any other character.
    Char(char),
    /// End of a line, with whether the next line is indented, and whether by a tab.
    Newline { indented: bool, tab: bool },
}

/// A token of the grammar language with its source location.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Token {
    pub kind: TokenKind,
    pub place: SourcePlace,
    /// True if no blank separates it from the token before it and both come from the same text, so that they may form one
    /// operator.
    pub glued: bool,
}

impl Token {
    /// True if the token is this character.
    pub fn is(&self, c: char) -> bool {
        self.kind == TokenKind::Char(c)
    }

    pub fn is_newline(&self) -> bool {
        matches!(self.kind, TokenKind::Newline { .. })
    }
}

/// Spellings of identifiers and numbers.
#[derive(Debug, Clone, Default)]
pub(crate) struct NameTable {
    list: Vec<String>,
    index: std::collections::BTreeMap<String, u32>,
    /// Number of the next new spelling; spellings are numbered from 0.
    next: u32,
}

impl NameTable {
    /// The number of a spelling, which is added if it is new.
    pub fn intern(&mut self, text: &str) -> u32 {
        if let Some(&i) = self.index.get(text) {
            return i;
        }
        let i = self.next;
        self.next += 1;
        self.list.push(text.to_owned());
        self.index.insert(text.to_owned(), i);
        i
    }

    /// The spelling of number `i`; empty if there is none.
    pub fn get(&self, i: u32) -> &str {
        self.list.get(i as usize).map_or("", String::as_str)
    }
}

/// State that preprocessor and compiler share while one file is read: spellings, macro uses, diagnostics.
#[derive(Debug, Default)]
pub(crate) struct ParseSession {
    pub names: NameTable,
    pub expansions: Vec<Expansion>,
    expansion_count: u32,
    pub diagnostics: Vec<Diagnostic>,
    /// Notes, which only a verbose run prints.
    pub notes: Vec<Diagnostic>,
    /// True after `#pragma osier comments block`, which disables comments that begin with `//`.
    pub block_comments_only: bool,
    /// Functions and curves of companion files.
    pub functions: Arc<FunctionTables>,
}

/// Macro uses listed below a diagnostic; deeper nesting is left out.
const MAX_MACRO_LABELS: usize = 4;
/// Limit on the diagnostics of a file, as a damaged file could cause one for each byte.
const MAX_DIAGNOSTICS: usize = 200;

/// Default help for errors with this code, used when the message itself does not say how to fix them.
fn help_for(code: &str) -> Option<&'static str> {
    Some(match code {
        "L004" => "close the parenthesis, brace, comment or #if, or split a construct that is too large",
        "L005" => "give the macro as many arguments as its #define has parameters; a macro must not expand to itself",
        "L006" => "name a file beside this one, in quotes and with '/', that does not include this one",
        "L010" => "write it as: left < predecessor > right : condition --> successor",
        "L022" => "give the function as many values, between commas, as it takes",
        "L024" => "give the second one another name",
        _ => return None,
    })
}

impl ParseSession {
    /// Records a use of a macro; returns its one-based index, the origin of the tokens that it produces.
    pub fn record_expansion(&mut self, name: u32, used_at: SourcePlace) -> u32 {
        self.expansions.push(Expansion { name, used_at });
        self.expansion_count += 1;
        self.expansion_count
    }

    /// Records an error with the default help of its code.
    pub fn error(&mut self, code: &'static str, message: impl Into<String>, place: SourcePlace, label: &str) {
        let mut d = Diagnostic::error(code, message, place.span, label);
        d.help = help_for(code).map(str::to_owned);
        self.push(d, place);
    }

    /// Records L001, a fault of the notation, with the label and the help text of this case.
    pub fn fault(&mut self, message: impl Into<String>, place: SourcePlace, label: &str, help: impl Into<String>) {
        self.push(Diagnostic::error("L001", message, place.span, label).help(help), place);
    }

    /// Records an error with the label `here` at `place` and a help text for this case.
    pub fn error_help(&mut self, code: &'static str, message: String, place: SourcePlace, help: impl Into<String>) {
        self.push(Diagnostic::error(code, message, place.span, "here").help(help), place);
    }

    /// Records an error that is fixed by writing `replacement` in place of `place`.
    pub fn error_fix(
        &mut self,
        code: &'static str,
        message: String,
        place: SourcePlace,
        help: impl Into<String>,
        replacement: impl Into<String>,
    ) {
        let d = Diagnostic::error(code, message, place.span, "here").help(help);
        self.push(with_fix(d, place, replacement), place);
    }

    /// Records a warning with the label `here` at `place`.
    pub fn warning(&mut self, code: &'static str, message: String, place: SourcePlace, help: impl Into<String>) {
        self.push(Diagnostic::warning(code, message, place.span, "here").help(help), place);
    }

    /// Records a note for verbose runs; a second note of the same code and place is dropped.
    pub fn note(&mut self, code: &'static str, message: String, place: SourcePlace, help: impl Into<String>) {
        let d = Diagnostic::warning(code, message, place.span, "here").help(help);
        if self.notes.iter().any(|n| n.code == code && n.labels.first() == d.labels.first()) {
            return;
        }
        if self.notes.len() < MAX_DIAGNOSTICS {
            self.notes.push(d);
        }
    }

    /// Records a diagnostic whose first label is at `place`, with a label for each macro use that led there. A second one of
    /// the same code and place is dropped.
    pub fn push(&mut self, mut diagnostic: Diagnostic, place: SourcePlace) {
        let key = |d: &Diagnostic| (d.code, d.labels.first().map(|l| l.0));
        if self.diagnostics.len() >= MAX_DIAGNOSTICS || self.diagnostics.iter().any(|d| key(d) == key(&diagnostic)) {
            return;
        }
        diagnostic.labels.extend(self.macro_chain(place));
        self.diagnostics.push(diagnostic);
    }

    /// Labels of the macro uses that led to a place, innermost first.
    pub fn macro_chain(&self, place: SourcePlace) -> Vec<(Span, String)> {
        macro_chain(&self.expansions, &self.names, place)
    }

    /// True if the limit on diagnostics is reached and at least one is an error, so that readers of long files may stop.
    pub fn is_full(&self) -> bool {
        self.diagnostics.len() >= MAX_DIAGNOSTICS && self.has_errors()
    }

    /// True if an error was recorded; warnings do not count.
    pub fn has_errors(&self) -> bool {
        self.diagnostics.iter().any(|d| d.severity == osier_base::diagnostic::Severity::Error)
    }
}

/// Adds the edit that fixes a diagnostic, unless a macro produced the place, where the edit would be wrong.
pub(crate) fn with_fix(d: Diagnostic, place: SourcePlace, replacement: impl Into<String>) -> Diagnostic {
    if place.origin == 0 { d.fix(place.span, replacement) } else { d }
}

/// Labels of the macro uses that led to a place, innermost first.
fn macro_chain(expansions: &[Expansion], names: &NameTable, place: SourcePlace) -> Vec<(Span, String)> {
    let mut out = Vec::new();
    let mut at = place;
    while at.origin != 0 && out.len() < MAX_MACRO_LABELS {
        let Some(e) = expansions.get(at.origin as usize - 1) else { break };
        out.push((e.used_at.span, format!("through macro {}", names.get(e.name))));
        at = e.used_at;
    }
    out
}
