//! Decodes bytes to text and splits text into tokens: encodings, spliced lines, comments.

use crate::token::{ParseSession, SourcePlace, Token, TokenKind};
use osier_base::convert::saturating_index;
use osier_base::diagnostic::{Diagnostic, SourceId, Span};

/// Text of a file, and whether it had to be decoded as Latin-1. A byte order mark is removed; line ends of a single CR
/// become LF, so that line numbers are right.
pub(super) fn decode(bytes: &[u8]) -> (String, bool) {
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    let ends_with_cr = |i: usize| bytes.get(i) == Some(&b'\r') && bytes.get(i + 1) != Some(&b'\n');
    let lines: std::borrow::Cow<'_, [u8]> = if (0..bytes.len()).any(ends_with_cr) {
        (0..bytes.len()).map(|i| if ends_with_cr(i) { b'\n' } else { bytes[i] }).collect::<Vec<u8>>().into()
    } else {
        bytes.into()
    };
    match std::str::from_utf8(&lines) {
        Ok(text) => (text.to_owned(), false),
        Err(_) => (lines.iter().map(|&b| char::from(b)).collect(), true),
    }
}

/// Number of bytes that [`is_utf16`] inspects.
const UTF16_SAMPLE: usize = 4096;

/// True if the file is UTF-16: it begins with the byte order mark of UTF-16, or every other byte at its start is 0.
pub(super) fn is_utf16(bytes: &[u8]) -> bool {
    if bytes.starts_with(b"\xff\xfe") || bytes.starts_with(b"\xfe\xff") {
        return true;
    }
    let sample = bytes.get(..UTF16_SAMPLE).unwrap_or(bytes);
    let zeros = |first: usize| sample.iter().skip(first).step_by(2).filter(|b| **b == 0).count();
    let (even, odd) = (zeros(0), zeros(1));
    // Latin text in UTF-16 has a zero in nearly every pair of bytes, always on the same side.
    sample.len() >= 4 && even.min(odd) == 0 && even.max(odd) * 4 > sample.len()
}

/// The tokens of a file, which end in a newline, and the places of its comments.
#[derive(Debug, Default)]
pub(super) struct LexedText {
    pub tokens: Vec<Token>,
    pub comments: Vec<Span>,
}

/// Splits a text into tokens, whose places are byte ranges of `text`. Errors and the warnings L014 and L057 go to the
/// session.
pub(super) fn lex(session: &mut ParseSession, source: SourceId, text: &str) -> LexedText {
    warn_of_joined_lines(session, source, text);
    let mut lexer = Lexer {
        session,
        source,
        chars: splice(text),
        i: 0,
        end: text.len(),
        rule: RuleState::Elsewhere,
        out: LexedText::default(),
    };
    lexer.run();
    lexer.out
}

/// Characters with their byte offsets; backslash-newline is removed, and CRLF and CR become LF.
fn splice(text: &str) -> Vec<(u32, char)> {
    let bytes = text.as_bytes();
    let mut out = Vec::with_capacity(text.len());
    // Offsets refer to the original text, so that places stay exact across spliced lines.
    let mut skip_to = 0;
    let (mut starts_line, mut is_directive) = (true, false);
    for (i, c) in text.char_indices() {
        if i < skip_to {
            continue;
        }
        is_directive = if starts_line { c == '#' } else { is_directive };
        starts_line = c == '\n' || (starts_line && c.is_whitespace());
        match c {
            // Some authors double the backslash that continues a directive.
            '\\' if is_directive && bytes[i + 1..].starts_with(b"\\\n") => skip_to = i + 3,
            '\\' if is_directive && bytes[i + 1..].starts_with(b"\\\r\n") => skip_to = i + 4,
            '\\' if bytes.get(i + 1) == Some(&b'\n') => skip_to = i + 2,
            '\\' if bytes.get(i + 1) == Some(&b'\r') => {
                skip_to = if bytes.get(i + 2) == Some(&b'\n') { i + 3 } else { i + 2 };
            }
            '\r' if bytes.get(i + 1) == Some(&b'\n') => {}
            '\r' => out.push((saturating_index(i), '\n')),
            c => out.push((saturating_index(i), c)),
        }
    }
    out
}

/// First words of items: a line that begins with one is not meant to continue the line before (L057).
const LINE_WORDS: [&str; 9] =
    ["axiom", "derivation", "decomposition", "homomorphism", "endlsystem", "lsystem", "ignore", "consider", "maximum"];

/// L057: the backslash of a roll command at the end of a production joins the next line, which is a production or an item
/// itself.
fn warn_of_joined_lines(session: &mut ParseSession, source: SourceId, text: &str) {
    let mut start = 0;
    for line in text.split_inclusive('\n') {
        let (from, end) = (start, start + line.len());
        start = end;
        let own = line.trim_end_matches(['\n', '\r']);
        let is_rule = own.contains("-->") && !own.starts_with('#');
        if !is_rule || !own.ends_with('\\') {
            continue;
        }
        let next = text[end..].lines().next().unwrap_or("");
        let word = next.split(|c: char| !c.is_ascii_alphabetic()).next().unwrap_or("").to_ascii_lowercase();
        if !next.contains("-->") && !LINE_WORDS.contains(&word.as_str()) {
            continue;
        }
        let at = from + own.len() - 1;
        let place = SourcePlace::bare(Span::new(source, at, at + 1));
        let message = "the backslash at the end of this line joins the next line to it".to_owned();
        session.warning("L057", message, place, "put a blank behind it if it is a roll, else remove it");
    }
}

/// True if the text after `//` is probably a list of modules rather than words, which have several lower-case letters in a
/// row outside parentheses. `touches`: no blank follows the `//`, and either none precedes it or a module in the text has
/// parameters; few authors write comments in this way.
fn looks_like_modules(text: &str, touches: bool) -> bool {
    let (mut depth, mut small, mut has_turns, mut has_symbols) = (0_u32, 0_u32, false, false);
    let mut before = ' ';
    for c in text.chars() {
        match c {
            // A parameter list follows its symbol without a blank.
            '(' if depth > 0 || !before.is_whitespace() => depth += 1,
            ')' => depth = depth.saturating_sub(1),
            _ if depth > 0 => {}
            '[' | ']' | '+' | '&' | '^' | '!' => has_turns = true,
            _ => has_symbols |= c.is_alphabetic(),
        }
        small = if depth == 0 && c.is_lowercase() { small + 1 } else { 0 };
        if small > 1 {
            return false;
        }
        before = c;
    }
    (has_symbols || has_turns) && (touches || (has_turns && has_symbols))
}

/// The text after the angle of a second roll, as in `(30)A`, if a module follows without a blank; in comments a blank
/// follows.
fn behind_angle(text: &str) -> Option<&str> {
    let inner = text.strip_prefix('(')?;
    let mut depth = 1_u32;
    let close = inner.find(|c: char| {
        match c {
            '(' => depth += 1,
            ')' => depth -= 1,
            _ => {}
        }
        depth == 0
    })?;
    let behind = &inner[close + 1..];
    behind.starts_with(|c: char| c.is_alphabetic() || "[+-&^/\\|!".contains(c)).then_some(behind)
}

struct Lexer<'a> {
    session: &'a mut ParseSession,
    source: SourceId,
    /// Characters with 32-bit offsets, which suffice for the limited length of texts and halve the memory of long ones.
    chars: Vec<(u32, char)>,
    i: usize,
    end: usize,
    rule: RuleState,
    out: LexedText,
}

/// Position of the lexer within a production.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum RuleState {
    Elsewhere,
    /// After this many characters of `-->`.
    Arrow(u8),
    Successor,
}

impl Lexer<'_> {
    fn peek(&self, ahead: usize) -> Option<char> {
        self.chars.get(self.i + ahead).map(|c| c.1)
    }

    fn offset(&self) -> usize {
        self.chars.get(self.i).map_or(self.end, |c| c.0 as usize)
    }

    fn run(&mut self) {
        // `glued` is false after blanks, line ends and comments, because tokens that they separate do not form an operator.
        let mut glued = false;
        while let Some(c) = self.peek(0) {
            let start = self.offset();
            match c {
                '\n' => {
                    self.i += 1;
                    self.newline(start);
                    glued = false;
                    continue;
                }
                c if c.is_whitespace() => {
                    self.i += 1;
                    glued = false;
                    continue;
                }
                // After `#pragma osier comments block` only `/*` begins a comment.
                '/' if self.peek(1) == Some('*')
                    || (self.peek(1) == Some('/') && !self.session.block_comments_only) =>
                {
                    self.comment(glued);
                    glued = false;
                    continue;
                }
                '\0' => {
                    let place = SourcePlace::bare(Span::new(self.source, start, start + 1));
                    let help = "remove the byte, and save the file as text in UTF-8";
                    self.session.fault("unexpected NUL byte, expected text", place, "NUL byte", help);
                    // Report a run of NUL characters, as left by a damaged disk, as one error.
                    while self.peek(0) == Some('\0') {
                        self.i += 1;
                    }
                    continue;
                }
                _ => {}
            }
            // At a `#` that begins a line: the pragma must take effect before the next token.
            if c == '#' && self.out.tokens.last().is_none_or(Token::is_newline) {
                self.pragma();
            }
            // `-->` begins a successor, in which `//` may stand for two modules (L014).
            self.rule = match (self.rule, c) {
                (RuleState::Successor, _) => RuleState::Successor,
                (RuleState::Arrow(2), '>') if glued => RuleState::Successor,
                (RuleState::Arrow(1), '-') if glued => RuleState::Arrow(2),
                (_, '-') => RuleState::Arrow(1),
                _ => RuleState::Elsewhere,
            };
            let kind = self.token(c);
            let place = SourcePlace::bare(Span::new(self.source, start, self.last_end()));
            self.out.tokens.push(Token { kind, place, glued });
            glued = true;
        }
        // Add the line end that the last line of a file may lack.
        if !self.out.tokens.last().is_some_and(Token::is_newline) {
            self.newline(self.end);
        }
    }

    /// Byte offset of the end of the character before the cursor.
    fn last_end(&self) -> usize {
        self.i.checked_sub(1).and_then(|i| self.chars.get(i)).map_or(0, |(o, c)| *o as usize + c.len_utf8())
    }

    fn newline(&mut self, start: usize) {
        let tab = self.peek(0) == Some('\t');
        if !matches!(self.peek(0), Some('\t' | ' ')) {
            self.rule = RuleState::Elsewhere;
        }
        let place = SourcePlace::bare(Span::new(self.source, start, (start + 1).min(self.end)));
        let kind = TokenKind::Newline { indented: tab || self.peek(0) == Some(' '), tab };
        self.out.tokens.push(Token { kind, place, glued: false });
    }

    fn take_while(&mut self, f: impl Fn(char) -> bool) -> String {
        let mut text = String::new();
        while let Some(c) = self.peek(0).filter(|c| f(*c)) {
            text.push(c);
            self.i += 1;
        }
        text
    }

    fn token(&mut self, c: char) -> TokenKind {
        // Numbers begin with a digit, or with a dot before a digit; any other dot is a symbol.
        let digit_after_dot = c == '.' && self.peek(1).is_some_and(|d| d.is_ascii_digit());
        if c.is_ascii_alphabetic() || c == '_' {
            let text = self.take_while(|c| c.is_ascii_alphanumeric() || c == '_');
            TokenKind::Ident(self.session.names.intern(&text))
        } else if c.is_ascii_digit() || digit_after_dot {
            let text = self.number();
            TokenKind::Number(self.session.names.intern(&text))
        } else if c == '"' {
            self.string()
        } else {
            self.i += 1;
            TokenKind::Char(c)
        }
    }

    /// Reads digits, one dot, more digits, and an exponent if it has digits.
    fn number(&mut self) -> String {
        let mut text = self.take_while(|c| c.is_ascii_digit());
        if self.peek(0) == Some('.') {
            text.push('.');
            self.i += 1;
            text.push_str(&self.take_while(|c| c.is_ascii_digit()));
        }
        // In `2e` without exponent digits, 2 is the number and e a symbol.
        if matches!(self.peek(0), Some('e' | 'E')) {
            let signed = matches!(self.peek(1), Some('+' | '-'));
            if self.peek(1 + usize::from(signed)).is_some_and(|c| c.is_ascii_digit()) {
                for _ in 0..=usize::from(signed) {
                    text.extend(self.peek(0));
                    self.i += 1;
                }
                text.push_str(&self.take_while(|c| c.is_ascii_digit()));
            }
        }
        text
    }

    /// Reads a quoted text on one line; a quote without a partner is a symbol like any other.
    fn string(&mut self) -> TokenKind {
        let line = self.chars[self.i + 1..].iter().take_while(|c| c.1 != '\n');
        let Some(length) = line.map(|c| c.1).position(|c| c == '"') else {
            self.i += 1;
            return TokenKind::Char('"');
        };
        let text: String = self.chars[self.i + 1..self.i + 1 + length].iter().map(|c| c.1).collect();
        self.i += length + 2;
        TokenKind::Text(self.session.names.intern(&text))
    }

    /// Handles `#pragma osier comments block`: from here on `//` is two symbols.
    fn pragma(&mut self) {
        let line: String = self.chars[self.i + 1..].iter().map(|c| c.1).take_while(|c| *c != '\n').collect();
        if line.split_whitespace().eq(["pragma", "osier", "comments", "block"]) {
            self.session.block_comments_only = true;
        }
    }

    /// L014: a `//` in a successor followed by what looks like modules. `glued`: no blank precedes it.
    fn check_hidden_modules(&mut self, start: usize, glued: bool) {
        let rest: String = self.chars[self.i + 2..].iter().map(|c| c.1).take_while(|c| *c != '\n').collect();
        let has_parameters = rest.as_bytes().windows(2).any(|w| w[0].is_ascii_alphabetic() && w[1] == b'(');
        let touches = (glued || has_parameters) && rest.starts_with(|c: char| !c.is_whitespace());
        let has_modules = match behind_angle(&rest) {
            Some(behind) => looks_like_modules(behind, true),
            None => looks_like_modules(&rest, touches),
        };
        if self.rule != RuleState::Successor || !has_modules {
            return;
        }
        let place = SourcePlace::bare(Span::new(self.source, start, start + 2));
        let message = "'//' makes the rest of this production a comment";
        let d = Diagnostic::warning("L014", message, place.span, "the comment begins here")
            .help("write two rolls as '/ /'; '#pragma osier comments block' turns such comments off")
            .fix(place.span, "/ /");
        self.session.push(d, place);
    }

    fn comment(&mut self, glued: bool) {
        let start = self.offset();
        // A line comment does not include its line end, which ends the logical line.
        if self.peek(1) == Some('/') {
            self.check_hidden_modules(start, glued);
            while self.peek(0).is_some_and(|c| c != '\n') {
                self.i += 1;
            }
        } else {
            self.i += 2;
            while self.peek(0).is_some() && !(self.peek(0) == Some('*') && self.peek(1) == Some('/')) {
                self.i += 1;
            }
            if self.peek(0).is_none() {
                let place = SourcePlace::bare(Span::new(self.source, start, start + 2));
                self.session.error("L004", "unterminated comment", place, "opened here, never closed by '*/'");
            }
            self.i = (self.i + 2).min(self.chars.len());
        }
        self.out.comments.push(Span::new(self.source, start, self.last_end()));
    }
}
