//! Macro expansion with the C rules, on a stack of token lists.

use super::{FrameKind, MacroDefinition, Preprocessor, TokenFrame};
use crate::token::{SourcePlace, Token, TokenKind};

/// Limit on the nesting of macro expansions (L005).
const MAX_MACRO_DEPTH: u32 = 256;

/// Bit of [`SourcePlace::origin`] that marks identifiers which must not be expanded again (C11 6.10.3.4).
const EXPANSION_DISABLED: u32 = 1 << 31;

impl Preprocessor<'_> {
    /// The next expanded token above stack height `base`; `None` at the end of the lists above it.
    pub(super) fn next_expanded(&mut self, base: usize) -> Option<Token> {
        loop {
            if self.frames.len() <= base {
                return None;
            }
            let Some(mut token) = self.next_raw() else {
                self.pop_frame();
                continue;
            };
            if self.at_directive(token) {
                self.directive();
                continue;
            }
            // The text of files is limited by their size, so that only tokens from macros are counted.
            let from_macro = self.frames.last().is_some_and(|f| !matches!(f.kind, FrameKind::File { .. }));
            self.produced += u64::from(from_macro);
            // Nested macros can grow exponentially: stop at the budget and report it once.
            if self.produced > self.limits.get("macro-tokens") && !self.exhausted {
                self.exhausted = true;
                let flag = "raise it with --max-macro-tokens";
                self.session.error_help(
                    "L005",
                    "macros expand to too much text".into(),
                    without_mark(token).place,
                    flag,
                );
            }
            if self.exhausted {
                return None;
            }
            if let TokenKind::Ident(name) = token.kind
                && self.try_expand(name, &mut token)
            {
                continue;
            }
            // Tokens from different texts never form one operator.
            if std::mem::take(&mut self.break_glue) {
                token.glued = false;
            }
            return Some(if base == 0 { without_mark(token) } else { token });
        }
    }

    /// The next token of the topmost list.
    fn next_raw(&mut self) -> Option<Token> {
        let frame = self.frames.last_mut()?;
        let token = frame.tokens.get(frame.pos).copied()?;
        frame.pos += 1;
        Some(token)
    }

    /// Removes the topmost list; L004 for each `#if` of a file without its `#endif`.
    fn pop_frame(&mut self) {
        let Some(frame) = self.frames.pop() else { return };
        self.break_glue = true;
        if let FrameKind::File { conditions } = frame.kind {
            self.files.pop();
            while self.conditions.len() > conditions {
                if let Some(c) = self.conditions.pop() {
                    self.session.error("L004", "#if without #endif", c.place, "opened here");
                }
            }
        }
    }

    /// Replaces the macro `name` if it is defined and enabled; true if the caller must read the next token.
    fn try_expand(&mut self, name: u32, token: &mut Token) -> bool {
        if token.place.origin & EXPANSION_DISABLED != 0 {
            return false;
        }
        let Some(definition) = self.macros.get(&name).cloned() else { return false };
        // C11 6.10.3.4: a macro within its own expansion is not replaced, now or later; the bit records that.
        if self.frames.iter().any(|f| f.kind == FrameKind::Macro { name }) {
            token.place.origin |= EXPANSION_DISABLED;
            return false;
        }
        if self.frames.len() as u64 > u64::from(MAX_MACRO_DEPTH) {
            self.exhausted = true;
            self.session.error("L005", "macros nested too deeply", token.place, "here");
            return false;
        }
        match definition.params.clone() {
            None => self.push_body(name, &definition, token.place, &MacroArguments::default()),
            Some(params) => {
                if !self.opens_call() {
                    return false;
                }
                let Some(args) = self.call_arguments(token.place) else { return true };
                // C rule: `M()` calls a macro without parameters with no argument, not with an empty one.
                let given = if args.len() == 1 && params.is_empty() && args[0].is_empty() { 0 } else { args.len() };
                if given != params.len() {
                    let (word, n) = (self.session.names.get(name).to_owned(), params.len());
                    let message = format!("macro {word} takes {n} arguments, got {given}");
                    self.session.error("L005", message, token.place, "used here");
                    return true;
                }
                // Arguments are fully expanded before they are substituted, except beside `##`.
                let written = if pastes(&definition.body) { args.clone() } else { Vec::new() };
                let args: Vec<Vec<Token>> = args.into_iter().map(|a| self.expand_list(a)).collect();
                self.push_body(name, &definition, token.place, &MacroArguments { expanded: &args, written: &written });
            }
        }
        true
    }

    /// True if the next token, across exhausted lists, is an opening parenthesis.
    fn opens_call(&self) -> bool {
        for frame in self.frames.iter().rev() {
            if let Some(t) = frame.tokens.get(frame.pos) {
                return t.is('(');
            }
            if frame.kind == FrameKind::List {
                return false;
            }
        }
        false
    }

    /// Reads a macro call's arguments, from its parenthesis to the matching one.
    fn call_arguments(&mut self, call: SourcePlace) -> Option<Vec<Vec<Token>>> {
        let mut args = vec![Vec::new()];
        let mut depth = 0_u32;
        loop {
            // A call may end in the text after the macro's body, but not after the end of a separate list or of the main
            // file.
            let Some(token) = self.next_raw() else {
                if self.frames.last().is_none_or(|f| f.kind == FrameKind::List) || self.frames.len() == 1 {
                    self.session.error("L004", "macro call is never closed", call, "opened here");
                    return None;
                }
                self.pop_frame();
                continue;
            };
            match token.kind {
                // Only commas at depth 1 separate arguments; line ends inside a call are blanks.
                TokenKind::Char('(') => depth += 1,
                TokenKind::Char(')') => depth -= 1,
                TokenKind::Newline { .. } => continue,
                _ => {}
            }
            match token.kind {
                TokenKind::Char('(') if depth == 1 => {}
                TokenKind::Char(')') if depth == 0 => return Some(args),
                TokenKind::Char(',') if depth == 1 => args.push(Vec::new()),
                _ => {
                    if let Some(last) = args.last_mut() {
                        last.push(token);
                    }
                }
            }
        }
    }

    /// Expands a list by itself, as C does with arguments; [`MAX_MACRO_DEPTH`] limits the nesting.
    pub(super) fn expand_list(&mut self, tokens: Vec<Token>) -> Vec<Token> {
        if self.depth >= MAX_MACRO_DEPTH {
            self.exhausted = true;
            if let Some(t) = tokens.first() {
                self.session.error("L005", "macros nested too deeply", without_mark(*t).place, "here");
            }
            return Vec::new();
        }
        self.depth += 1;
        let base = self.frames.len();
        // The list is a frame of its own, so that expansion stops at its end.
        self.frames.push(TokenFrame { tokens, pos: 0, kind: FrameKind::List });
        let glue = std::mem::take(&mut self.break_glue);
        let mut out = Vec::new();
        while let Some(t) = self.next_expanded(base.max(1)) {
            out.push(t);
        }
        self.frames.truncate(base);
        self.break_glue = glue;
        self.depth -= 1;
        out
    }

    /// Joins the last token of `body` with the next one if both are words or numbers and form a single one; true if it did.
    fn paste(
        &mut self,
        body: &mut Vec<Token>,
        right: &Token,
        params: &[u32],
        args: &MacroArguments<'_>,
        place: SourcePlace,
    ) -> bool {
        // If the right side is a parameter, its unexpanded argument is pasted.
        let argument = match right.kind {
            TokenKind::Ident(id) => params.iter().position(|p| *p == id).and_then(|i| args.get(i, true)),
            _ => None,
        };
        let right: &[Token] = argument.map_or(std::slice::from_ref(right), Vec::as_slice);
        let word = |t: &Token| match t.kind {
            TokenKind::Ident(n) | TokenKind::Number(n) => Some(n),
            _ => None,
        };
        let (Some(left), Some((first, rest))) = (body.last().and_then(word), right.split_first()) else { return false };
        let Some(first) = word(first) else { return false };
        let text = format!("{}{}", self.session.names.get(left), self.session.names.get(first));
        // The joined text must be exactly one token, followed by the line end.
        let tokens = super::lexer::lex(self.session, place.span.source, &text).tokens;
        let [Token { kind, .. }, _] = tokens[..] else { return false };
        body.pop();
        body.push(Token { kind, place, glued: false });
        body.extend(rest.iter().copied());
        true
    }

    fn push_body(&mut self, name: u32, definition: &MacroDefinition, used_at: SourcePlace, args: &MacroArguments<'_>) {
        let origin = self.session.record_expansion(name, used_at) & !EXPANSION_DISABLED;
        let params: &[u32] = definition.params.as_deref().unwrap_or(&[]);
        let mut body = Vec::with_capacity(definition.body.len());
        let mut after_arg = false;
        let mut at = 0;
        while let Some(token) = definition.body.get(at) {
            at += 1;
            // `a ## b`: the unexpanded texts of both sides are joined to one word.
            if is_paste(&definition.body, at - 1) {
                let right = definition.body.get(at + 1);
                if let Some(right) = right.filter(|_| at > 1)
                    && self.paste(&mut body, right, params, args, SourcePlace { origin, ..token.place })
                {
                    at += 2;
                    after_arg = true;
                    continue;
                }
            }
            let is_left = is_paste(&definition.body, at);
            // Parameters are replaced by their arguments; other tokens point to this use of the macro.
            let arg = match token.kind {
                TokenKind::Ident(id) => params.iter().position(|p| *p == id).and_then(|i| args.get(i, is_left)),
                _ => None,
            };
            if let Some(arg) = arg {
                self.produced += arg.len() as u64;
                body.extend(arg.iter().enumerate().map(|(i, t)| Token { glued: t.glued && i > 0, ..*t }));
                after_arg = true;
            } else {
                let place = SourcePlace { origin, ..token.place };
                body.push(Token { place, glued: token.glued && !after_arg, ..*token });
                after_arg = false;
            }
            if self.produced > self.limits.get("macro-tokens") {
                break;
            }
        }
        self.break_glue = true;
        self.frames.push(TokenFrame { tokens: body, pos: 0, kind: FrameKind::Macro { name } });
    }
}

/// Arguments of one macro call by position, each a list of tokens.
#[derive(Debug, Clone, Copy, Default)]
struct MacroArguments<'a> {
    expanded: &'a [Vec<Token>],
    /// Unexpanded arguments; empty if the macro does not paste tokens.
    written: &'a [Vec<Token>],
}

impl<'a> MacroArguments<'a> {
    /// Argument `i`; `as_written` for an argument beside `##`, which is not expanded.
    fn get(&self, i: usize, as_written: bool) -> Option<&'a Vec<Token>> {
        if as_written { self.written.get(i) } else { self.expanded.get(i) }
    }
}

/// True if token `i` begins a `##`.
fn is_paste(body: &[Token], i: usize) -> bool {
    matches!(body.get(i..i + 2), Some([a, b]) if a.is('#') && b.is('#') && b.glued)
}

/// True if the macro's body contains `##`.
fn pastes(body: &[Token]) -> bool {
    (0..body.len()).any(|i| is_paste(body, i))
}

/// The token without the bit that disables its expansion.
fn without_mark(mut token: Token) -> Token {
    token.place.origin &= !EXPANSION_DISABLED;
    token
}
