//! Directives: `#define`, `#undef`, `#include` and conditionals.

use std::rc::Rc;

use super::{Define, FrameKind, MacroDefinition, OpenConditional, Preprocessor};
use crate::compile;
use crate::token::{SourcePlace, Token, TokenKind};
use osier_base::diagnostic::Span;

const DIRECTIVES: [&str; 11] =
    ["define", "undef", "include", "if", "ifdef", "ifndef", "elif", "else", "endif", "pragma", "error"];
/// Limit on the nesting of included files (L006).
const MAX_INCLUDE_DEPTH: usize = 32;

impl Preprocessor<'_> {
    /// True if this token, just taken, begins a directive.
    pub(super) fn at_directive(&self, token: Token) -> bool {
        if !token.is('#') {
            return false;
        }
        let Some(frame) = self.frames.last() else { return false };
        let starts_line = frame.pos < 2 || frame.tokens[frame.pos - 2].is_newline();
        let is_file = matches!(frame.kind, FrameKind::File { .. });
        let word = match frame.tokens.get(frame.pos).map(|t| t.kind) {
            Some(TokenKind::Ident(w)) => self.session.names.get(w),
            _ => return false,
        };
        is_file && starts_line && DIRECTIVES.contains(&word)
    }

    /// The rest of the current line, without its newline.
    fn rest_of_line(&mut self) -> Vec<Token> {
        let Some(frame) = self.frames.last_mut() else { return Vec::new() };
        let rest = &frame.tokens[frame.pos.min(frame.tokens.len())..];
        let n = rest.iter().position(Token::is_newline).unwrap_or(rest.len());
        let line = rest[..n].to_vec();
        frame.pos += n;
        line
    }

    /// Runs the directive whose `#` was just taken.
    pub(super) fn directive(&mut self) {
        let line = self.rest_of_line();
        let Some((first, rest)) = line.split_first() else { return };
        let TokenKind::Ident(word) = first.kind else { return };
        let place = first.place;
        match self.session.names.get(word).to_owned().as_str() {
            "define" => self.define(rest, place),
            "undef" => {
                if let Some(TokenKind::Ident(name)) = rest.first().map(|t| t.kind) {
                    self.macros.remove(&name);
                }
            }
            "include" => self.include(rest, place),
            "if" => {
                let value = self.evaluate_condition(rest, place);
                self.begin_if(value, place);
            }
            "ifdef" | "ifndef" => {
                // A `--set` value counts as defined even before its `#define` is read.
                let defined = match rest.first().map(|t| t.kind) {
                    Some(TokenKind::Ident(name)) => {
                        self.macros.contains_key(&name) || self.overrides.contains_key(&name)
                    }
                    _ => false,
                };
                let wanted = self.session.names.get(word) == "ifdef";
                self.begin_if(defined == wanted, place);
            }
            // An active branch ends here: skip the other branches.
            "elif" | "else" => match self.conditions.last_mut() {
                Some(c) => {
                    c.active = false;
                    self.skip_inactive();
                }
                None => {
                    let help = "remove it, or put its #if before it";
                    self.session.fault("#else without #if", place, "no #if is open here", help);
                }
            },
            "endif" if self.conditions.pop().is_none() => {
                let help = "remove it, or put its #if before it";
                self.session.fault("#endif without #if", place, "no #if is open here", help);
            }
            "error" => {
                let help = "an #if selected this #error: change the macros that it tests";
                self.session.error_help("L005", "#error reached".into(), place, help);
            }
            _ => {}
        }
    }

    fn begin_if(&mut self, value: bool, place: SourcePlace) {
        self.conditions.push(OpenConditional { active: value, taken: value, place });
        if !value {
            self.skip_inactive();
        }
    }

    /// Skips lines up to the branch of the innermost `#if` that holds.
    fn skip_inactive(&mut self) {
        // Conditionals inside an inactive branch are counted and skipped as a whole.
        let mut nested = 0_u32;
        loop {
            self.rest_of_line();
            let Some(frame) = self.frames.last_mut() else { return };
            frame.pos += 1;
            let Some(first) = frame.tokens.get(frame.pos).copied() else { return };
            // `at_directive` expects the `#` to be taken already.
            if !first.is('#') {
                continue;
            }
            frame.pos += 1;
            if !self.at_directive(first) {
                continue;
            }
            let line = self.rest_of_line();
            let Some(TokenKind::Ident(word)) = line.first().map(|t| t.kind) else { continue };
            let place = line[0].place;
            match self.session.names.get(word) {
                "if" | "ifdef" | "ifndef" => nested += 1,
                "endif" if nested > 0 => nested -= 1,
                "endif" => {
                    self.conditions.pop();
                    return;
                }
                w @ ("else" | "elif") if nested == 0 => {
                    let is_else = w == "else";
                    let taken = self.conditions.last().is_none_or(|c| c.taken);
                    if !taken && (is_else || self.evaluate_condition(&line[1..], place)) {
                        if let Some(c) = self.conditions.last_mut() {
                            (c.active, c.taken) = (true, true);
                        }
                        return;
                    }
                }
                _ => {}
            }
        }
    }

    /// Value of an `#if` expression, in which `defined(X)` and `defined X` are replaced before macros are expanded.
    fn evaluate_condition(&mut self, tokens: &[Token], place: SourcePlace) -> bool {
        let mut list = Vec::new();
        let mut i = 0;
        while let Some(&t) = tokens.get(i) {
            i += 1;
            let is_defined = matches!(t.kind, TokenKind::Ident(w) if self.session.names.get(w) == "defined");
            if !is_defined {
                list.push(t);
                continue;
            }
            let open = usize::from(tokens.get(i).is_some_and(|t| t.is('(')));
            let known = match tokens.get(i + open).map(|t| t.kind) {
                Some(TokenKind::Ident(n)) => self.macros.contains_key(&n) || self.overrides.contains_key(&n),
                _ => false,
            };
            i += 1 + 2 * open;
            let digit = self.session.names.intern(if known { "1" } else { "0" });
            list.push(Token { kind: TokenKind::Number(digit), ..t });
        }
        // `defined(X)` is replaced by 1 or 0 before macros are expanded.
        let list = self.expand_list(list);
        compile::evaluate_condition(self.session, &list, place)
    }

    fn define(&mut self, rest: &[Token], place: SourcePlace) {
        let Some(head) = rest.first() else {
            let help = "write: #define NAME value";
            return self.session.fault("#define without a name", place, "expected a name after this", help);
        };
        let TokenKind::Ident(name) = head.kind else {
            let help = "begin the name with a letter: #define NAME value";
            return self.session.fault("unexpected token, expected a macro name", head.place, "not a name", help);
        };
        // C rule: a parenthesis that touches the name begins a parameter list.
        let is_function = rest.get(1).is_some_and(|t| t.is('(') && t.glued);
        let (params, body) = if is_function {
            let Some(close) = rest.iter().position(|t| t.is(')')) else {
                return self.session.error("L004", "macro parameters are never closed", head.place, "opened here");
            };
            let ident = |t: &Token| if let TokenKind::Ident(n) = t.kind { Some(n) } else { None };
            let params: Rc<[u32]> = rest[2..close].iter().filter_map(ident).collect();
            (Some(params), &rest[close + 1..])
        } else {
            (None, &rest[1..])
        };
        let mut body: Rc<[Token]> = body.into();
        // `--set` replaces only macros without arguments.
        if params.is_none() {
            if let Some(value) = self.overrides.get(&name) {
                body = Rc::clone(value);
            }
            self.record_define(name, head.place, &body, rest);
        }
        self.macros.insert(name, MacroDefinition { params, body });
    }

    /// Records a macro without arguments for `osier list options`.
    fn record_define(&mut self, name: u32, place: SourcePlace, body: &[Token], line: &[Token]) {
        let slice = |a: u32, b: u32| self.sources.text(place.span.source).get(a as usize..b as usize).unwrap_or("");
        // Range of a list of tokens; `None` if the list is empty or comes from several files.
        let extent = |tokens: &[Token]| match (tokens.first(), tokens.last()) {
            (Some(a), Some(b)) if a.place.span.source == b.place.span.source => {
                Some(Span { end: b.place.span.end, ..a.place.span })
            }
            _ => None,
        };
        let text_of = |span: Option<Span>| {
            let text = span.map(|s| self.sources.text(s.source).get(s.start as usize..s.end as usize));
            text.flatten().unwrap_or_default().to_owned()
        };
        let own = extent(line.get(1..).unwrap_or_default());
        let (value, written) = (text_of(extent(body)), text_of(own));
        let value_span = own.unwrap_or(Span { start: place.span.end, ..place.span });
        let end = line.last().map_or(place.span.end, |t| t.place.span.end);
        // The comment after a definition on its line describes it in `osier list options`.
        let behind = |c: &&Span| c.source == place.span.source && c.start >= end && !slice(end, c.start).contains('\n');
        // Comments are sorted by source and place, since each file is read as a whole.
        let source = place.span.source;
        let first = self.comments.partition_point(|c| (c.source, c.start) < (source, end));
        let comment = self.comments.get(first).filter(behind).map_or_else(String::new, |c| self.comment_text(*c));
        let is_known = !self.defined.insert(name);
        let name = self.session.names.get(name).to_owned();
        if is_known {
            self.defines.retain(|d| d.name != name);
        }
        self.defines.push(Define { name, value, written, span: place.span, value_span, comment });
    }

    fn include(&mut self, rest: &[Token], place: SourcePlace) {
        let name = match rest.first().map(|t| t.kind) {
            Some(TokenKind::Text(t)) => self.session.names.get(t).to_owned(),
            _ => {
                return self.session.error("L006", "#include without a file name in quotes", place, "here");
            }
        };
        let at = rest.first().map_or(place, |t| t.place);
        // Both limits are needed: on the number of included files, and on their nesting.
        self.included += 1;
        if self.included > self.limits.get("includes") || self.files.len() >= MAX_INCLUDE_DEPTH {
            let help = "merge some of them, or raise --max-includes";
            return self.session.error_help("L006", "too many files included".into(), at, help);
        }
        let from = self.files.last().cloned().unwrap_or_default();
        match (self.includes)(&name, &from) {
            // A file that is still being read must not be included again, as the inclusion would never end.
            Ok((shown, _)) if self.files.contains(&shown) => {
                let chain = format!("{} -> {shown}", self.files.join(" -> "));
                self.session.error("L006", format!("\"{name}\" includes itself: {chain}"), at, "here");
            }
            Ok((shown, bytes)) => self.open_file(&shown, &bytes),
            Err(e) => self.session.error("L006", format!("\"{name}\" cannot be included: {e}"), at, "here"),
        }
    }
}
