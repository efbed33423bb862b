//! The items of an L-system: header, values, blocks, sections.

use super::lines::{self, KEYWORDS, Keyword, LogicalLine, is_block};
use super::{Compiler, NameScope, describe, production, statement, successor, whole_expression};
use crate::code::Bytecode;
use crate::program::{IgnoredSymbols, Program};
use crate::token::{ParseSession, SourcePlace, Token, TokenKind};
use crate::vm;
use osier_base::diagnostic::{Diagnostic, nearest};

/// Result of compiling the main L-system of a file.
#[derive(Debug)]
pub(crate) struct ParsedGrammar {
    pub program: Program,
    pub label: String,
}

/// Section of the file, which decides where productions are stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum ProductionSection {
    Productions,
    Decomposition,
    Homomorphism,
}

pub(super) struct ItemParser<'r> {
    pub(super) session: &'r mut ParseSession,
    pub(super) program: Program,
    label: String,
    section: ProductionSection,
    globals: Vec<u32>,
    header: Option<SourcePlace>,
    axiom: Option<SourcePlace>,
    ended: bool,
}

/// Reads the main L-system of a file.
pub(crate) fn parse(session: &mut ParseSession, tokens: &[Token], start: SourcePlace) -> ParsedGrammar {
    let lines = lines::split_lines(session, tokens);
    let mut p = ItemParser {
        session,
        program: Program::default(),
        label: String::new(),
        section: ProductionSection::Productions,
        globals: Vec::new(),
        header: None,
        axiom: None,
        ended: false,
    };
    p.program.decomposition.depth = 1;
    p.program.homomorphism.depth = 1;
    // Brackets and the cut symbol have fixed meanings and get the first numbers.
    for c in ['[', ']', '%'] {
        p.program.symbols.intern(c);
    }
    let main = p.main_lines(lines);
    // Global variables and the turtle are known before any production is compiled, wherever their items stand.
    p.collect_globals(&main);
    for line in main.iter().filter(|l| l.keyword.is_some_and(|(k, _)| is_block(k))) {
        p.block_item(line);
    }
    p.turtle_items(&main);
    for line in &main {
        p.item(line);
    }
    p.check_complete(start);
    let symbols = p.program.symbols.len();
    p.program.rules.index(symbols);
    p.program.decomposition.index(symbols);
    p.program.homomorphism.index(symbols);
    p.program.blocks.globals = p.globals.len();
    ParsedGrammar { program: p.program, label: p.label }
}

impl ItemParser<'_> {
    /// The lines of the first L-system; others are named and left out.
    fn main_lines(&mut self, lines: Vec<LogicalLine>) -> Vec<LogicalLine> {
        let mut out = Vec::new();
        let mut skipping = false;
        for line in lines {
            let key = line.keyword.map(|k| k.0);
            // An L-system begins with its heading; lines before it belong to it too.
            let begins = matches!(key, Some(Keyword::Lsystem | Keyword::Ring));
            if skipping {
                continue;
            }
            if begins && self.header.is_some() {
                skipping = true;
                if let Some(place) = line.place() {
                    let help = "the first L-system of the file is the one that is read";
                    self.session.warning("L008", "sub-L-systems are not supported".into(), place, help);
                }
                continue;
            }
            if begins {
                self.header = line.place();
            }
            out.push(line);
        }
        out
    }

    /// Every name that a block assigns is global, wherever the block stands.
    fn collect_globals(&mut self, lines: &[LogicalLine]) {
        let blocks = lines.iter().filter(|l| l.keyword.is_some_and(|(k, _)| is_block(k) && k != Keyword::Define));
        for line in blocks {
            for (i, t) in line.tokens.iter().enumerate() {
                let TokenKind::Ident(name) = t.kind else { continue };
                // `name =` but not `name ==`.
                let assigned = line.tokens.get(i + 1).is_some_and(|t| t.is('='))
                    && !line.tokens.get(i + 2).is_some_and(|t| t.is('=') && t.glued);
                if assigned && !self.globals.contains(&name) {
                    self.globals.push(name);
                }
            }
        }
    }

    pub(super) fn compiler(&mut self, scope: NameScope) -> Compiler<'_> {
        let globals = self.globals.clone();
        let mut c = Compiler::new(self.session, scope);
        c.globals = globals;
        c.has_turtle = self.program.turtle.is_some();
        c
    }

    fn block_item(&mut self, line: &LogicalLine) {
        let (Some((key, n)), Some(place)) = (line.keyword, line.place()) else { return };
        if key == Keyword::Define {
            let help = "use single variables in Start: { .. }";
            self.session.warning("L008", "arrays are not supported, Define is ignored".into(), place, help);
            return;
        }
        let colon = usize::from(line.tokens.get(n).is_some_and(|t| t.is(':')));
        let body = &line.tokens[(n + colon).min(line.tokens.len())..];
        // The block is everything between the outer braces.
        let inner = match body {
            [open, inner @ .., close] if open.is('{') && close.is('}') => inner,
            [open, ..] if open.is('{') => {
                return self.session.error("L004", "block is never closed", open.place, "opened here");
            }
            _ => {
                let at = body.first().map_or(place, |t| t.place);
                return self.session.error("L001", "unexpected token, expected '{'", at, "here");
            }
        };
        let mut compiler = self.compiler(NameScope::Global);
        let Some(code) = statement::block(&mut compiler, inner, place) else { return };
        // A second block of the same kind replaces the first.
        let slot = match key {
            Keyword::Start => &mut self.program.blocks.start,
            Keyword::StartEach => &mut self.program.blocks.start_each,
            Keyword::EndEach => &mut self.program.blocks.end_each,
            _ => &mut self.program.blocks.end,
        };
        *slot = Some(code);
    }

    fn item(&mut self, line: &LogicalLine) {
        if self.ended {
            return;
        }
        let Some(place) = line.place() else { return };
        if let Some(arrow) = line.arrow {
            return self.production(line, arrow, place);
        }
        let Some((key, n)) = line.keyword else { return self.unknown_line(line, place) };
        let colon = usize::from(line.tokens.get(n).is_some_and(|t| t.is(':')));
        let head = line.tokens.first().map_or(place, |t| t.place);
        // The value of an item follows its keyword and the optional colon.
        let value = &line.tokens[(n + colon).min(line.tokens.len())..];
        match key {
            Keyword::Lsystem => self.label = self.spelling(value),
            Keyword::Ring => {
                let help = "contexts do not see across the ends of the string";
                self.session.warning("L008", "ring L-systems are not supported".into(), head, help);
            }
            // `Seed:` belongs to the section in which it stands; sections other than the homomorphism share one seed.
            Keyword::Seed => {
                let seed = self.integer(value, head);
                match self.section {
                    ProductionSection::Homomorphism => self.program.homomorphism.seed = seed,
                    _ => self.program.seed = seed,
                }
            }
            Keyword::Length => {
                self.program.length_place = Some(place);
                match self.integer(value, head).map(u32::try_from) {
                    Some(Ok(length)) => self.program.length = length,
                    Some(Err(_)) => {
                        self.session.error("L001", "derivation length must lie in 0 to 1,000,000", place, "here");
                    }
                    None => {}
                }
            }
            Keyword::Axiom => self.axiom_item(value, place),
            Keyword::Ignore | Keyword::Consider => self.set_ignored(key, value, head),
            Keyword::Decomposition | Keyword::Homomorphism => self.begin_section(key, value, head),
            Keyword::Depth => {
                let depth = match self.integer(value, head).map(u32::try_from) {
                    Some(Ok(depth)) => depth,
                    Some(Err(_)) => {
                        return self.session.error("L001", "maximum depth must be 0 or more", place, "here");
                    }
                    None => return,
                };
                match self.section {
                    ProductionSection::Homomorphism => self.program.homomorphism.depth = depth,
                    _ => self.program.decomposition.depth = depth,
                }
            }
            Keyword::Warnings | Keyword::NoWarnings => self.set_depth_warnings(key == Keyword::Warnings),
            Keyword::EndLsystem => self.ended = true,
            _ => {}
        }
    }

    fn set_depth_warnings(&mut self, warn: bool) {
        match self.section {
            ProductionSection::Homomorphism => self.program.homomorphism.warn_depth = warn,
            _ => self.program.decomposition.warn_depth = warn,
        }
    }

    fn begin_section(&mut self, key: Keyword, value: &[Token], place: SourcePlace) {
        let is_homomorphism = key == Keyword::Homomorphism;
        self.section = if is_homomorphism { ProductionSection::Homomorphism } else { ProductionSection::Decomposition };
        let rules = if is_homomorphism { &mut self.program.homomorphism } else { &mut self.program.decomposition };
        rules.place = Some(place);
        let words = self.spelling(value).to_ascii_lowercase();
        if words.contains("warnings") {
            self.set_depth_warnings(!words.contains("no"));
        }
    }

    /// Spellings of tokens, joined by blanks.
    pub(super) fn spelling(&self, tokens: &[Token]) -> String {
        let word = |t: &Token| describe(&self.session.names, t).trim_matches(['\'', '"']).to_owned();
        tokens.iter().map(word).collect::<Vec<_>>().join(" ")
    }

    /// A constant item value, cut to an integer.
    fn integer(&mut self, tokens: &[Token], place: SourcePlace) -> Option<i64> {
        if tokens.is_empty() {
            self.session.error("L001", "unexpected end of line, expected a number", place, "after this");
            return None;
        }
        let mut compiler = self.compiler(NameScope::Global);
        let code: Bytecode = whole_expression(&mut compiler, tokens, place)?;
        match vm::constant_value(&code) {
            #[allow(clippy::cast_possible_truncation, reason = "saturates; ranges are checked by the caller")]
            Some(v) if v.is_finite() => Some(v.trunc() as i64),
            _ => {
                self.session.error("L001", "value is not a constant number", place, "here");
                None
            }
        }
    }

    fn axiom_item(&mut self, value: &[Token], place: SourcePlace) {
        if let Some(first) = self.axiom {
            let d = Diagnostic::error("L001", "second axiom", place.span, "here").label(first.span, "the first one");
            return self.session.push(d.help("keep one axiom with the modules of both"), place);
        }
        self.axiom = Some(place);
        let globals = self.globals.clone();
        let mut compiler = Compiler::new(self.session, NameScope::Global);
        compiler.globals = globals;
        compiler.has_turtle = self.program.turtle.is_some();
        if let Some((modules, _)) = successor::successor(&mut compiler, &mut self.program.symbols, value, place) {
            if modules.is_empty() {
                self.session.error("L003", "the axiom is empty", place, "expected modules after this");
            }
            self.program.axiom = modules;
        }
    }

    fn set_ignored(&mut self, key: Keyword, value: &[Token], place: SourcePlace) {
        if !matches!(self.program.ignored, IgnoredSymbols::Nothing) {
            let message = "Ignore and Consider exclude each other".to_owned();
            return self.session.error_help("L010", message, place, "remove this line or the one before");
        }
        let spelled = self.spelling(value);
        let symbols = &mut self.program.symbols;
        let list = spelled.chars().filter(|c| *c != ' ').filter_map(|c| symbols.intern(c)).collect();
        self.program.ignored =
            if key == Keyword::Ignore { IgnoredSymbols::Listed(list) } else { IgnoredSymbols::AllExcept(list) };
    }

    fn production(&mut self, line: &LogicalLine, arrow: usize, place: SourcePlace) {
        let globals = self.globals.clone();
        let mut compiler = Compiler::new(self.session, NameScope::Production);
        compiler.globals = globals;
        compiler.has_turtle = self.program.turtle.is_some();
        let parsed = production::production(&mut compiler, &mut self.program.symbols, line, arrow);
        let Some(parsed) = parsed else { return };
        let rules = match self.section {
            ProductionSection::Productions => &mut self.program.rules,
            ProductionSection::Decomposition => &mut self.program.decomposition,
            ProductionSection::Homomorphism => &mut self.program.homomorphism,
        };
        // Expansion works on single modules.
        if self.section != ProductionSection::Productions && parsed.predecessor.len() > 1 {
            let message = "ill-formed production: only one predecessor is allowed in this section".to_owned();
            return self.session.error_help("L010", message, place, "write one production for each predecessor");
        }
        rules.list.push(parsed);
    }

    /// A line that is neither an item nor a production.
    fn unknown_line(&mut self, line: &LogicalLine, place: SourcePlace) {
        // A few plain words before a ":" look like a misspelled item; anything else lacks its arrow.
        let colon = line.tokens.iter().position(|t| t.is(':') || t.is('{'));
        let words = &line.tokens[..colon.unwrap_or(line.tokens.len())];
        let all_words = !words.is_empty() && words.iter().all(|t| matches!(t.kind, TokenKind::Ident(_)));
        let first = line.tokens.first().map_or(place, |t| t.place);
        if all_words && (colon.is_some() || words.len() < 3) {
            let spelled = self.spelling(words);
            let lower = spelled.to_ascii_lowercase();
            let known = KEYWORDS.iter().map(|k| k.2);
            let near = nearest(
                &lower,
                known.clone().map(str::to_ascii_lowercase).collect::<Vec<_>>().iter().map(|s| s.as_str()),
            )
            .map(str::to_owned);
            // Suggest the nearest keyword in its usual spelling.
            let near = near.and_then(|n| known.clone().find(|k| k.eq_ignore_ascii_case(&n)));
            let help = match near {
                Some(n) => format!("did you mean '{n}'?"),
                None => "a production needs '-->' between predecessor and successor".to_owned(),
            };
            let at = words.last().map_or(first, |t| first.to(t.place));
            return self.session.error_help("L002", format!("unknown item '{spelled}'"), at, help);
        }
        let found = line.tokens.first().map_or_else(String::new, |t| describe(&self.session.names, t));
        let message = format!("unexpected {found}, expected an item or a production with '-->'");
        self.session.error("L001", message, first, "this line");
    }

    fn check_complete(&mut self, start: SourcePlace) {
        let at = self.header.unwrap_or(start);
        if self.axiom.is_none() {
            let help = "add a line such as 'Axiom: F(1)'";
            self.session.error_help("L003", "the L-system has no axiom".into(), at, help);
        }
        if self.program.length_place.is_none() {
            let help = "add a line such as 'derivation length: 5'";
            self.session.error_help("L003", "the L-system has no derivation length".into(), at, help);
        }
        if !self.ended {
            let help = "add a last line 'endlsystem'";
            self.session.error_help("L003", "the L-system has no 'endlsystem'".into(), at, help);
        }
    }
}
