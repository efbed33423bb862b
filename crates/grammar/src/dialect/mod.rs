//! Notations of other programs. Each reader compiles a file to the same program that a grammar of osier has, with places in
//! the file, and sets the turtle dialect that draws it.

mod convert;
mod detect;
mod fractint;
mod lparser;
mod lpy;
mod text;

use super::binding::{Dialect, TurtleBindings};
use super::code::Expr;
use super::grammar::Grammar;
use super::notation::Notation;
use super::preprocess::{Define, brackets};
use super::program::{FormalModule, Production, Program, SuccessorModule};
use super::token::{ParseSession, SourcePlace, Token, TokenKind};
use super::{GrammarSource, input_error, lint};
use std::sync::Arc;

use osier_base::Result;
use osier_base::diagnostic::{Diagnostic, SourceId, Sources, Span};
use osier_base::limits::Limits;

pub use convert::{ConvertTo, Converted, convert};
pub use detect::{FileKind, detect};

/// Notation of a grammar file and, in a file of several L-systems, which of them to read.
#[derive(Debug, Clone, Copy, Default)]
pub struct ReadAs<'a> {
    /// The notation of the file; `None` to detect it from the content.
    pub notation: Option<Notation>,
    /// The entry to read of a file that holds several; `None` for its only entry.
    pub entry: Option<&'a str>,
}

/// Names of the L-systems in a file of Fractint, in file order; empty for other files.
pub fn entries(name: &str, bytes: &[u8]) -> Vec<String> {
    match detect(name, bytes) {
        FileKind::Grammar(Notation::Fractint) => fractint::names(&text::decode(bytes).text),
        _ => Vec::new(),
    }
}

/// Inserts the `turtle:` line of the notation before the tokens of a grammar of cpfg, unless the grammar has one.
pub(super) fn with_turtle(
    session: &mut ParseSession,
    tokens: Vec<Token>,
    notation: Notation,
    start: SourcePlace,
) -> Vec<Token> {
    // Tokens are compared by number, so that the word is interned once.
    let word = session.names.intern("turtle");
    let has_turtle = tokens
        .split(Token::is_newline)
        .any(|line| matches!(line, [first, colon, ..] if first.kind == TokenKind::Ident(word) && colon.is(':')));
    if has_turtle || notation == Notation::Cpfg {
        return tokens;
    }
    let name = session.names.intern(notation.word());
    let newline = TokenKind::Newline { indented: false, tab: false };
    let line = [TokenKind::Ident(word), TokenKind::Char(':'), TokenKind::Ident(name), newline];
    line.into_iter().map(|kind| Token { kind, place: start, glued: false }).chain(tokens).collect()
}

/// Reads a file in a notation other than cpfg's.
pub(super) fn parse(
    notation: Notation,
    entry: Option<&str>,
    sources: &mut Sources,
    source: &GrammarSource<'_>,
    limits: &Limits,
) -> Result<(Grammar, Vec<Diagnostic>)> {
    let mut session = ParseSession::default();
    let decoded = text::decode(source.bytes);
    let id = sources.add(source.name, decoded.text.as_str());
    let start = SourcePlace::start_of(id);
    // Add the text to the sources first, because the error refers to it.
    if source.bytes.len() as u64 > limits.get("text-bytes") {
        let message = format!("\"{}\" is larger than --max-text-bytes", source.name);
        session.error_help("L005", message, start, "shorten the file, or raise the limit");
        return Err(input_error(&mut session, sources));
    }
    if decoded.is_latin1 {
        let message = format!("\"{}\" is not UTF-8, read as Latin-1", source.name);
        session.warning("L009", message, start, "save the file as UTF-8");
    }
    if brackets::check_nesting(&mut session, id, &decoded.text, limits) {
        return Err(input_error(&mut session, sources));
    }
    // Each reader makes the same kind of program as the compiler of cpfg grammars.
    let mut reader = Reader::new(&mut session, id, &decoded.text, notation);
    match notation {
        Notation::Fractint => fractint::read(&mut reader, &decoded.text, source.name, entry),
        Notation::LPy => lpy::read(&mut reader, &decoded.text),
        _ => lparser::read(&mut reader, &decoded.text),
    }
    let (program, label, description, palette) = reader.finish();
    if !session.has_errors() {
        lint::check_dialect(&mut session, &program, notation);
    }
    if session.has_errors() {
        return Err(input_error(&mut session, sources));
    }
    let grammar = Grammar {
        program: Arc::new(program),
        label,
        description,
        defines: Vec::<Define>::new(),
        notes: std::mem::take(&mut session.notes),
        sources: sources.clone(),
        expansions: Vec::new(),
        start,
        notation,
        palette,
    };
    Ok((grammar, std::mem::take(&mut session.diagnostics)))
}

/// A program under construction, and the session for diagnostics.
struct Reader<'s> {
    session: &'s mut ParseSession,
    source: SourceId,
    /// Byte offsets of line starts.
    line_starts: Vec<usize>,
    program: Program,
    label: String,
    description: String,
    palette: Vec<(u8, [u8; 3])>,
}

impl<'s> Reader<'s> {
    fn new(session: &'s mut ParseSession, source: SourceId, text: &str, notation: Notation) -> Self {
        let mut program = Program::default();
        // These notations have neither decomposition nor homomorphism; a depth of 1 leaves both without effect.
        program.decomposition.depth = 1;
        program.homomorphism.depth = 1;
        // Brackets and the cut symbol get the first numbers, as in grammars of cpfg.
        for c in ['[', ']', '%'] {
            program.symbols.intern(c);
        }
        let dialect = match notation {
            Notation::Fractint => Dialect::Fractint,
            Notation::LParser => Dialect::LParser,
            Notation::LPy => Dialect::LPy,
            Notation::Cpfg | Notation::Abop | Notation::Catkin => Dialect::Cpfg,
        };
        program.turtle = Some(TurtleBindings { dialect, first_applies: true, ..TurtleBindings::default() });
        let line_starts = text::lines(text).map(|l| l.at).collect();
        Self {
            session,
            source,
            line_starts,
            program,
            label: String::new(),
            description: String::new(),
            palette: Vec::new(),
        }
    }

    fn place(&self, range: std::ops::Range<usize>) -> SourcePlace {
        SourcePlace::bare(Span::new(self.source, range.start, range.end))
    }

    /// Line number of a byte, from 1.
    fn line_number(&self, at: usize) -> usize {
        self.line_starts.partition_point(|start| *start <= at).max(1)
    }

    /// A module without parameters; L004 beyond 65,535 symbols.
    fn module(&mut self, c: char, place: SourcePlace) -> Option<SuccessorModule> {
        let Some(symbol) = self.program.symbols.intern(c) else {
            self.session.error("L004", "more than 65,535 different symbols", place, "this one is too many");
            return None;
        };
        Some(SuccessorModule { symbol, args: Box::default(), occurrence: 0, place })
    }

    /// A module with one constant as its parameter.
    fn module_with(&mut self, c: char, value: f64, place: SourcePlace) -> Option<SuccessorModule> {
        let module = self.module(c, place)?;
        Some(SuccessorModule { args: Box::new([Expr::Const(value)]), ..module })
    }

    /// Adds a production for one symbol without parameters, without contexts and condition.
    fn rule(&mut self, c: char, successor: Vec<SuccessorModule>, place: SourcePlace) {
        // Only the symbol is needed; `module` reports L004 if there are too many symbols.
        let Some(SuccessorModule { symbol, .. }) = self.module(c, place) else { return };
        self.program.rules.list.push(Production {
            left: Vec::new(),
            predecessor: vec![FormalModule { symbol, arity: 0, slot: 0, place }],
            right: Vec::new(),
            new_left: Vec::new(),
            new_right: Vec::new(),
            ignored: None,
            before: None,
            condition: None,
            after: None,
            successor: self.numbered(successor),
            weight: None,
            locals: 0,
            place,
        });
    }

    /// Numbers the occurrences of each symbol, which are part of the lineage.
    fn numbered(&self, mut modules: Vec<SuccessorModule>) -> Vec<SuccessorModule> {
        let mut counts = vec![0_u32; self.program.symbols.len()];
        for m in &mut modules {
            if let Some(count) = counts.get_mut(usize::from(m.symbol)) {
                m.occurrence = *count;
                *count += 1;
            }
        }
        modules
    }

    fn axiom(&mut self, modules: Vec<SuccessorModule>) {
        self.program.axiom = self.numbered(modules);
    }

    /// Returns the complete program, its label, its description and its colours.
    fn finish(mut self) -> (Program, String, String, Vec<(u8, [u8; 3])>) {
        // All symbols are known only now; they determine the size of the tables.
        let symbols = self.program.symbols.len();
        self.program.rules.index(symbols);
        self.program.decomposition.index(symbols);
        self.program.homomorphism.index(symbols);
        (self.program, self.label, self.description, self.palette)
    }
}
