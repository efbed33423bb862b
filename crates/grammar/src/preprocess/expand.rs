//! Macro expansion with the C rules, on a stack of token lists.

use std::rc::Rc;

use super::{FrameKind, Macro, Preprocessor, TokenFrame};
use crate::token::{Expansion, SourcePlace, Token, TokenKind};

/// Macros inside macros.
const MAX_DEPTH: u32 = 256;

/// Origins with this bit are identifiers that must not be expanded again.
const PAINT: u32 = 1 << 31;

impl Preprocessor<'_> {
    /// The next expanded token above stack height `base`; `None` when the lists above it are used up.
    pub(super) fn next(&mut self, base: usize) -> Option<Token> {
        loop {
            if self.frames.len() <= base {
                return None;
            }
            let Some(mut token) = self.take() else {
                self.pop();
                continue;
            };
            if self.at_directive(token) {
                self.directive();
                continue;
            }
            self.produced += 1;
            if self.produced > self.limits.get("macro-tokens") && !self.exhausted {
                self.exhausted = true;
                let flag = "raise it with --max-macro-tokens";
                self.reading.error_help("L005", "macros expand to too much text".into(), unpainted(token).place, flag);
            }
            if self.exhausted {
                return None;
            }
            if let TokenKind::Ident(name) = token.kind
                && self.try_expand(name, &mut token)
            {
                continue;
            }
            if std::mem::take(&mut self.break_glue) {
                token.glued = false;
            }
            return Some(if base == 0 { unpainted(token) } else { token });
        }
    }

    /// The next token of the topmost list.
    fn take(&mut self) -> Option<Token> {
        let frame = self.frames.last_mut()?;
        let token = frame.tokens.get(frame.pos).copied()?;
        frame.pos += 1;
        Some(token)
    }

    /// Drops the topmost list.
    fn pop(&mut self) {
        let Some(frame) = self.frames.pop() else { return };
        self.break_glue = true;
        if let FrameKind::File { conditions } = frame.kind {
            self.files.pop();
            while self.conditions.len() > conditions {
                if let Some(c) = self.conditions.pop() {
                    self.reading.error("L004", "#if without #endif", c.place, "opened here");
                }
            }
        }
    }

    /// Replaces the macro `name` if it is one and may be; true if the caller must read on.
    fn try_expand(&mut self, name: u32, token: &mut Token) -> bool {
        if token.place.origin & PAINT != 0 {
            return false;
        }
        let Some(found) = self.macros.get(&name).cloned() else { return false };
        // C11 6.10.3.4: a macro met within its own expansion is not replaced, now or later; the bit records that.
        if self.frames.iter().any(|f| f.kind == FrameKind::Macro { name }) {
            token.place.origin |= PAINT;
            return false;
        }
        if self.frames.len() as u64 > u64::from(MAX_DEPTH) {
            self.exhausted = true;
            self.reading.error("L005", "macros nested too deeply", token.place, "here");
            return false;
        }
        match found.params.clone() {
            None => self.push_body(name, &found, token.place, &[]),
            Some(params) => {
                if !self.opens_call() {
                    return false;
                }
                let Some(args) = self.arguments(token.place) else { return true };
                let given = if args.len() == 1 && params.is_empty() && args[0].is_empty() { 0 } else { args.len() };
                if given != params.len() {
                    let (word, n) = (self.reading.names.get(name).to_owned(), params.len());
                    let message = format!("macro {word} takes {n} arguments, got {given}");
                    self.reading.error("L005", message, token.place, "used here");
                    return true;
                }
                let args: Vec<Vec<Token>> = args.into_iter().map(|a| self.expand_list(a)).collect();
                self.push_body(name, &found, token.place, &args);
            }
        }
        true
    }

    /// Is the next token, through lists that are used up, an opening parenthesis?
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
    fn arguments(&mut self, call: SourcePlace) -> Option<Vec<Vec<Token>>> {
        let mut args = vec![Vec::new()];
        let mut depth = 0_u32;
        loop {
            let Some(token) = self.take() else {
                if self.frames.last().is_none_or(|f| f.kind == FrameKind::List) || self.frames.len() == 1 {
                    self.reading.error("L004", "macro call is never closed", call, "opened here");
                    return None;
                }
                self.pop();
                continue;
            };
            match token.kind {
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

    /// A list expanded by itself, as C does with arguments; nesting is bounded by [`MAX_DEPTH`].
    pub(super) fn expand_list(&mut self, tokens: Vec<Token>) -> Vec<Token> {
        if self.depth >= MAX_DEPTH {
            self.exhausted = true;
            if let Some(t) = tokens.first() {
                self.reading.error("L005", "macros nested too deeply", unpainted(*t).place, "here");
            }
            return Vec::new();
        }
        self.depth += 1;
        let base = self.frames.len();
        self.frames.push(TokenFrame { tokens: tokens.into(), pos: 0, kind: FrameKind::List });
        let glue = std::mem::take(&mut self.break_glue);
        let mut out = Vec::new();
        while let Some(t) = self.next(base.max(1)) {
            out.push(t);
        }
        self.frames.truncate(base);
        self.break_glue = glue;
        self.depth -= 1;
        out
    }

    fn push_body(&mut self, name: u32, found: &Macro, used_at: SourcePlace, args: &[Vec<Token>]) {
        self.reading.expansions.push(Expansion { name, used_at });
        let origin = u32::try_from(self.reading.expansions.len()).unwrap_or(0) & !PAINT;
        let params: &[u32] = found.params.as_deref().unwrap_or(&[]);
        let mut body = Vec::with_capacity(found.body.len());
        let mut after_arg = false;
        for token in found.body.iter() {
            let arg = match token.kind {
                TokenKind::Ident(id) => params.iter().position(|p| *p == id).and_then(|i| args.get(i)),
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
        self.frames.push(TokenFrame { tokens: Rc::from(body), pos: 0, kind: FrameKind::Macro { name } });
    }
}

/// A token without the mark that stops its expansion.
fn unpainted(mut token: Token) -> Token {
    token.place.origin &= !PAINT;
    token
}
