//! The preprocessor: merges a grammar file and its includes into one list of expanded tokens.

pub(super) mod brackets;
mod define;
mod directive;
mod expand;
mod foreign;
mod lexer;

use std::collections::BTreeMap;
use std::rc::Rc;

pub use define::{Define, DefineRange};

use super::token::{ParseSession, SourcePlace, Token};
use osier_base::Result;
use osier_base::diagnostic::{Sources, Span};
use osier_base::limits::Limits;

/// Finds an included file. Arguments: reference as written, displayed name of the including file. Returns the displayed name
/// and the bytes.
pub type Includes<'a> = dyn FnMut(&str, &str) -> Result<(String, Vec<u8>)> + 'a;

#[derive(Debug, Clone)]
struct MacroDefinition {
    /// Parameter names; `None` for a macro without arguments.
    params: Option<Rc<[u32]>>,
    body: Rc<[Token]>,
}

/// Kind of a frame of the reading stack.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum FrameKind {
    /// A file, with the number of conditionals open at its beginning.
    File { conditions: usize },
    /// A macro's body after substitution.
    Macro { name: u32 },
    /// A list of tokens that is expanded separately from the text around it.
    List,
}

#[derive(Debug)]
struct TokenFrame {
    tokens: Vec<Token>,
    pos: usize,
    kind: FrameKind,
}

/// An `#if` that is not closed by `#endif` yet; `taken`: one of its branches was active.
#[derive(Debug, Clone, Copy)]
struct OpenConditional {
    active: bool,
    taken: bool,
    place: SourcePlace,
}

struct Preprocessor<'a> {
    session: &'a mut ParseSession,
    sources: &'a mut Sources,
    includes: &'a mut Includes<'a>,
    overrides: BTreeMap<u32, Rc<[Token]>>,
    macros: BTreeMap<u32, MacroDefinition>,
    frames: Vec<TokenFrame>,
    /// Displayed names of the files being read, the main file first.
    files: Vec<String>,
    comments: Vec<Span>,
    conditions: Vec<OpenConditional>,
    defines: Vec<Define>,
    /// Names of all macros defined so far.
    defined: std::collections::BTreeSet<u32>,
    included: u64,
    produced: u64,
    depth: u32,
    break_glue: bool,
    /// True after a limit was exceeded: macros are no longer expanded.
    exhausted: bool,
    is_foreign: bool,
    limits: &'a Limits,
}

/// Tokens of the grammar after preprocessing, with the other data collected from the text.
pub(super) struct Preprocessed {
    pub tokens: Vec<Token>,
    pub defines: Vec<Define>,
    /// The comment at the beginning of the main file.
    pub description: String,
    /// True if the file was written for another program or exceeds a limit, so that there is nothing to parse.
    pub is_unreadable: bool,
}

/// The main file and the inputs of its directives: includes, values of `--set`, limits.
pub(super) struct PreprocessorInput<'a> {
    pub name: &'a str,
    pub bytes: &'a [u8],
    pub includes: &'a mut Includes<'a>,
    pub defines: &'a BTreeMap<String, String>,
    pub limits: &'a Limits,
}

/// Reads a file with everything it includes and expands its macros; errors go to the session.
pub(super) fn run(session: &mut ParseSession, sources: &mut Sources, input: PreprocessorInput<'_>) -> Preprocessed {
    // Lex values of `--set` like the body of a macro, so that they can be expressions.
    let mut overrides = BTreeMap::new();
    for (name, value) in input.defines {
        let source = sources.add(format!("--set {name}"), value.as_str());
        let mut tokens = lexer::lex(session, source, value).tokens;
        tokens.retain(|t| !t.is_newline());
        overrides.insert(session.names.intern(name), Rc::from(tokens));
    }
    // Give the borrowed parts, whose lifetimes differ, one common lifetime.
    let includes = input.includes;
    let mut p = Preprocessor {
        session,
        sources,
        includes: &mut |a, b| includes(a, b),
        overrides,
        macros: BTreeMap::new(),
        frames: Vec::new(),
        files: Vec::new(),
        comments: Vec::new(),
        conditions: Vec::new(),
        defines: Vec::new(),
        defined: std::collections::BTreeSet::new(),
        included: 0,
        produced: 0,
        depth: 0,
        break_glue: false,
        exhausted: false,
        is_foreign: false,
        limits: input.limits,
    };
    p.predefine();
    p.open_file(input.name, input.bytes);
    let description = p.description();
    let mut tokens = Vec::new();
    while let Some(t) = p.next_expanded(0) {
        tokens.push(t);
    }
    let (defines, is_unreadable) = (p.defines, p.is_foreign || p.exhausted);
    Preprocessed { tokens, defines, description, is_unreadable }
}

impl Preprocessor<'_> {
    fn predefine(&mut self) {
        // Predefine `OSIER`, and the names of functions in companion files.
        let functions = std::sync::Arc::clone(&self.session.functions);
        for (name, value) in [("OSIER", 1)].into_iter().chain(functions.names()) {
            let text = value.to_string();
            let source = self.sources.add("predefined", text.as_str());
            let body = lexer::lex(self.session, source, &text).tokens;
            let body: Rc<[Token]> = body.into_iter().filter(|t| !t.is_newline()).collect();
            let name = self.session.names.intern(name);
            self.macros.insert(name, MacroDefinition { params: None, body });
        }
    }

    /// Pushes a file onto the reading stack.
    fn open_file(&mut self, name: &str, bytes: &[u8]) {
        if lexer::is_utf16(bytes) {
            let start = SourcePlace::start_of(self.sources.add(name, ""));
            let message = format!("\"{name}\" is UTF-16 text, expected UTF-8");
            let help = "save it as UTF-8 in its editor, or run: iconv -f UTF-16 -t UTF-8";
            self.session.error_help("L001", message, start, help);
            self.is_foreign = true;
            return;
        }
        let (text, latin1) = lexer::decode(bytes);
        let source = self.sources.add(name, text.as_str());
        let start = SourcePlace::start_of(source);
        // An included file that is too large is skipped as a whole.
        if bytes.len() as u64 > self.limits.get("text-bytes") {
            let message = format!("\"{name}\" is larger than --max-text-bytes");
            self.session.error_help("L005", message, start, "shorten the file, or raise the limit");
            return;
        }
        if latin1 {
            let help = "save the file as UTF-8";
            self.session.warning("L009", format!("\"{name}\" is not UTF-8, read as Latin-1"), start, help);
        }
        if brackets::check_nesting(self.session, source, &text, self.limits) {
            self.is_foreign = true;
            return;
        }
        let lexed = lexer::lex(self.session, source, &text);
        // Files of other programs would only cause misleading errors: stop at the first line that identifies one.
        if let Some((program, place)) = foreign::detect(&self.session.names, &lexed.tokens) {
            // L-Py has a reader of its own, but a heading of cpfg or `--dialect` has selected this one.
            let (message, help) = if program == "L-Py" {
                let message = format!("\"{name}\" is read as a grammar of cpfg, but has a line of {program}");
                (message, "remove this line; or remove 'Lsystem:' or give --dialect lpy, to have it read as L-Py")
            } else {
                let message = format!("\"{name}\" is written for {program}, whose language is not supported");
                (message, "rewrite it in the notation of cpfg: modules, '-->' and 'Axiom:'")
            };
            self.session.error_help("L007", message, place, help);
            self.is_foreign = true;
            return;
        }
        self.comments.extend(lexed.comments);
        let kind = FrameKind::File { conditions: self.conditions.len() };
        self.frames.push(TokenFrame { tokens: lexed.tokens, pos: 0, kind });
        self.files.push(name.to_owned());
    }

    /// The comments before the first token, as plain text.
    fn description(&self) -> String {
        let Some(frame) = self.frames.first() else { return String::new() };
        let first = frame.tokens.iter().find(|t| !t.is_newline()).map_or(u32::MAX, |t| t.place.span.start);
        let lines = self.comments.iter().take_while(|c| c.end <= first).map(|c| self.comment_text(*c));
        lines.collect::<Vec<_>>().join(" ").trim().to_owned()
    }

    /// The text of a comment without its delimiters, on one line.
    fn comment_text(&self, span: Span) -> String {
        let text = self.sources.text(span.source).get(span.start as usize..span.end as usize).unwrap_or("");
        let text = text.trim_start_matches(['/', '*']).trim_end_matches(['/', '*']);
        text.split_whitespace().filter(|w| *w != "*").collect::<Vec<_>>().join(" ")
    }
}
