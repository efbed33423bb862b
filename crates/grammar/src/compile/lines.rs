//! Splits tokens into logical lines, each with one item or production.

use super::is_arrow;
use crate::token::{NameTable, ParseSession, SourcePlace, Token, TokenKind};

/// Kinds of items, each identified by the words at the beginning of its line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Keyword {
    Lsystem,
    Ring,
    Seed,
    Length,
    Axiom,
    Ignore,
    Consider,
    Define,
    Start,
    StartEach,
    EndEach,
    End,
    Decomposition,
    Homomorphism,
    Depth,
    Warnings,
    NoWarnings,
    EndLsystem,
    Turtle,
    Angles,
    Bind,
}

/// Keywords: spelling without blanks, kind, spelling in messages.
pub(super) const KEYWORDS: [(&str, Keyword, &str); 22] = [
    ("lsystem", Keyword::Lsystem, "Lsystem"),
    ("ringlsystem", Keyword::Ring, "ring Lsystem"),
    ("ring", Keyword::Ring, "ring Lsystem"),
    ("seed", Keyword::Seed, "Seed"),
    ("derivationlength", Keyword::Length, "derivation length"),
    ("axiom", Keyword::Axiom, "Axiom"),
    ("ignore", Keyword::Ignore, "Ignore"),
    ("consider", Keyword::Consider, "Consider"),
    ("define", Keyword::Define, "Define"),
    ("start", Keyword::Start, "Start"),
    ("starteach", Keyword::StartEach, "StartEach"),
    ("endeach", Keyword::EndEach, "EndEach"),
    ("end", Keyword::End, "End"),
    ("decomposition", Keyword::Decomposition, "Decomposition"),
    ("homomorphism", Keyword::Homomorphism, "Homomorphism"),
    ("maximumdepth", Keyword::Depth, "maximum depth"),
    ("warnings", Keyword::Warnings, "warnings"),
    ("nowarnings", Keyword::NoWarnings, "no warnings"),
    ("endlsystem", Keyword::EndLsystem, "endlsystem"),
    ("turtle", Keyword::Turtle, "turtle"),
    ("defineangle", Keyword::Angles, "define-angle"),
    ("bind", Keyword::Bind, "bind"),
];

/// One logical line without line ends: the position of the arrow if it is a production, else its keyword and the number of
/// tokens of the keyword.
#[derive(Debug)]
pub(super) struct LogicalLine {
    pub tokens: Vec<Token>,
    pub arrow: Option<usize>,
    pub keyword: Option<(Keyword, usize)>,
}

impl LogicalLine {
    /// True for `Lsystem` and `ring Lsystem`, which begin an L-system.
    pub fn is_heading(&self) -> bool {
        matches!(self.keyword, Some((Keyword::Lsystem | Keyword::Ring, _)))
    }

    /// The place from the first token to the last; `None` without tokens.
    pub fn place(&self) -> Option<SourcePlace> {
        Some(self.tokens.first()?.place.to(self.tokens.last()?.place))
    }
}

/// The longest keyword at the beginning of the tokens, and the number of its tokens; blanks and case are ignored.
fn spelled_keyword(names: &NameTable, tokens: &[Token]) -> Option<(Keyword, usize)> {
    let mut word = String::new();
    let mut best = None;
    for (i, t) in tokens.iter().take(3).enumerate() {
        if t.is('-') && word == "define" && t.glued {
            continue;
        }
        let TokenKind::Ident(n) = t.kind else { break };
        word.push_str(&names.get(n).to_ascii_lowercase());
        if let Some((_, k, _)) = KEYWORDS.iter().find(|(w, _, _)| *w == word) {
            best = Some((*k, i + 1));
        }
    }
    best
}

/// Number of tokens in an item's name whose value follows without a colon, as in `Axiom F`; `None` for other lines.
pub(super) fn name_without_colon(names: &NameTable, tokens: &[Token]) -> Option<usize> {
    let (k, n) = spelled_keyword(names, tokens)?;
    let has_value = matches!(
        k,
        Keyword::Axiom | Keyword::Length | Keyword::Seed | Keyword::Ignore | Keyword::Consider | Keyword::Depth
    );
    (has_value && tokens.get(n).is_some_and(|t| !t.is(':'))).then_some(n)
}

/// The keyword at the beginning of the tokens, and the number of its tokens.
pub(super) fn keyword(names: &NameTable, tokens: &[Token]) -> Option<(Keyword, usize)> {
    // The longest keyword wins: "derivation length", "define-angle".
    let (k, n) = spelled_keyword(names, tokens)?;
    let colon_optional = matches!(
        k,
        Keyword::Lsystem
            | Keyword::Ring
            | Keyword::Decomposition
            | Keyword::Homomorphism
            | Keyword::Warnings
            | Keyword::NoWarnings
            | Keyword::EndLsystem
    );
    let next = tokens.get(n);
    // `bind` is followed by any symbol and then a colon.
    let colon_optional = colon_optional || (k == Keyword::Bind && tokens.get(n + 1).is_some_and(|t| t.is(':')));
    // Other keywords need a colon or a brace after them, or a line of their own, so that symbols may be spelled like
    // keywords.
    let fits = next.is_some_and(|t| t.is(':') || t.is('{') || t.is_newline()) || colon_optional || next.is_none();
    fits.then_some((k, n))
}

/// Splits tokens into logical lines, each of which may extend over several lines of the file.
pub(super) fn split_lines(session: &mut ParseSession, tokens: &[Token]) -> Vec<LogicalLine> {
    let mut lines = Vec::new();
    let mut s =
        LineSplitter { session, tokens, current: Vec::new(), arrow: None, parens: 0, braces: 0, opened: None, i: 0 };
    while s.i < tokens.len() {
        if s.take_token() {
            s.finish_line(&mut lines);
        }
    }
    s.finish_line(&mut lines);
    lines
}

struct LineSplitter<'a> {
    session: &'a mut ParseSession,
    tokens: &'a [Token],
    current: Vec<Token>,
    arrow: Option<usize>,
    parens: usize,
    braces: usize,
    /// Place of the outermost open brace.
    opened: Option<SourcePlace>,
    i: usize,
}

impl LineSplitter<'_> {
    /// Consumes one token; true if it ends the logical line.
    fn take_token(&mut self) -> bool {
        let Some(&t) = self.tokens.get(self.i) else { return true };
        // The first arrow outside braces makes the line a production; open parentheses before it are then ignored.
        if self.arrow.is_none() && self.braces == 0 && is_arrow(self.tokens, self.i) {
            self.arrow = Some(self.current.len());
            self.parens = 0;
        }
        self.i += 1;
        if let TokenKind::Newline { indented, tab } = t.kind {
            return self.ends_here(indented, tab, t);
        }
        match t.kind {
            TokenKind::Char('(') => self.parens += 1,
            TokenKind::Char(')') => self.parens = self.parens.saturating_sub(1),
            TokenKind::Char('{') if self.arrow.is_none() => {
                if self.braces == 0 {
                    self.opened = Some(t.place);
                }
                self.braces += 1;
            }
            TokenKind::Char('}') if self.arrow.is_none() => self.braces = self.braces.saturating_sub(1),
            _ => {}
        }
        self.current.push(t);
        // A block item ends with its block.
        t.is('}')
            && self.braces == 0
            && self.arrow.is_none()
            && keyword(&self.session.names, &self.current).is_some_and(|(k, _)| is_block(k))
    }

    /// True if this line end also ends the logical line.
    fn ends_here(&mut self, indented: bool, tab: bool, newline: Token) -> bool {
        if self.current.is_empty() {
            return false;
        }
        // A logical line continues on indented physical lines, inside braces, and inside open parentheses.
        let next = self.next_line();
        let next_is_rule = (0..next.len()).any(|i| is_arrow(next, i));
        if self.braces > 0 {
            // Recover from an unclosed block at the next item, and from an unclosed polygon of the axiom also at the next
            // production.
            let ends = keyword(&self.session.names, next).is_some();
            return if self.lists_symbols(&self.current) { ends || next_is_rule } else { !indented && ends };
        }
        if self.parens > 0 {
            // Recover from an unclosed parenthesis at the next item or production.
            let recover = next_is_rule || keyword(&self.session.names, next).is_some();
            return recover && (self.arrow.is_some() || !indented);
        }
        // The opening brace of a block may be on the line after its keyword.
        let key = keyword(&self.session.names, &self.current);
        if next.first().is_some_and(|t| t.is('{')) && key.is_some_and(|(k, _)| is_block(k)) {
            return false;
        }
        let continues = key.is_none_or(|(k, _)| matches!(k, Keyword::Axiom | Keyword::Angles | Keyword::Bind));
        if continues && next.is_empty() {
            // The next line is blank, a comment or a directive.
            return !self.continues_behind_blank_lines(key.is_some());
        }
        if !indented || !continues || keyword(&self.session.names, next).is_some() {
            return true;
        }
        if next_is_rule && (self.arrow.is_some() || key.is_some()) {
            return true;
        }
        if !tab {
            let help = "cpfg continues a production only on lines that begin with a tab";
            self.session.note("L013", "continued by blanks".into(), newline.place, help);
        }
        false
    }

    /// Called before lines without tokens. True if the indented lines after them continue this logical line, in which case
    /// the empty lines are skipped. They do not continue it if they begin a production, whose arrow may be on a later line.
    /// `is_item`: the logical line begins with a keyword.
    fn continues_behind_blank_lines(&mut self, is_item: bool) -> bool {
        let rest = &self.tokens[self.i.min(self.tokens.len())..];
        let blank = rest.iter().take_while(|t| t.is_newline()).count();
        let (Some(last), behind) = (blank.checked_sub(1), &rest[blank..]) else { return false };
        if !matches!(rest[last].kind, TokenKind::Newline { indented: true, .. }) || behind.is_empty() {
            return false;
        }
        // A production without its arrow continues in any case.
        if (self.arrow.is_some() || is_item) && self.begins_production(behind) {
            return false;
        }
        self.i += last;
        true
    }

    /// True if these lines, up to the next line without tokens, begin with a production. Its arrow may be on a later line.
    fn begins_production(&self, tokens: &[Token]) -> bool {
        for (i, line) in tokens.split(Token::is_newline).enumerate() {
            if line.is_empty() || keyword(&self.session.names, line).is_some() {
                return false;
            }
            if (0..line.len()).any(|k| is_arrow(line, k)) {
                // An arrow further along a later line belongs to a production that begins on that line.
                return i == 0 || is_arrow(line, 0) || line[0].is(':');
            }
        }
        false
    }

    /// True for items in which a brace is a symbol and need not be closed.
    fn lists_symbols(&self, tokens: &[Token]) -> bool {
        let key = keyword(&self.session.names, tokens).map(|(k, _)| k);
        matches!(key, Some(Keyword::Axiom | Keyword::Ignore | Keyword::Consider | Keyword::Bind))
    }

    /// Tokens of the next physical line.
    fn next_line(&self) -> &[Token] {
        let rest = &self.tokens[self.i.min(self.tokens.len())..];
        let n = rest.iter().position(Token::is_newline).unwrap_or(rest.len());
        &rest[..n]
    }

    fn finish_line(&mut self, lines: &mut Vec<LogicalLine>) {
        let mut tokens = std::mem::take(&mut self.current);
        // Free the spare capacity, which would exceed the tokens in a file of many short lines.
        tokens.shrink_to_fit();
        let arrow = self.arrow.take();
        let unclosed = self.opened.take().filter(|_| self.braces > 0 && !self.lists_symbols(&tokens));
        (self.parens, self.braces) = (0, 0);
        if let Some(place) = unclosed {
            let help = "close it with '}'";
            return self.session.error_help("L004", "block is never closed".into(), place, help);
        }
        if tokens.is_empty() {
            return;
        }
        let keyword = if arrow.is_none() { keyword(&self.session.names, &tokens) } else { None };
        lines.push(LogicalLine { tokens, arrow, keyword });
    }
}

/// Items whose value is a block in braces.
pub(super) fn is_block(k: Keyword) -> bool {
    matches!(k, Keyword::Define | Keyword::Start | Keyword::StartEach | Keyword::EndEach | Keyword::End)
}
