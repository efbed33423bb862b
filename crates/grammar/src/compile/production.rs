//! Compiles productions: contexts, predecessor, blocks, condition, successor, weight.

use super::lines::LogicalLine;
use super::symbol::{intern, symbols_of};
use super::{Compiler, statement, successor, whole_expression};
use crate::program::{ContextElement, FormalModule, Production, SuccessorModule};
use crate::symbols::Symbols;
use crate::token::{ParseSession, SourcePlace, Token, TokenKind, with_fix};
use osier_base::diagnostic::{Diagnostic, Span};

/// Token ranges of a production before its arrow.
struct ProductionHead<'t> {
    left: &'t [Token],
    predecessor: &'t [Token],
    right: &'t [Token],
    before: Option<&'t [Token]>,
    condition: &'t [Token],
    after: Option<&'t [Token]>,
}

/// Compiles one production; `None` after an error, which is recorded.
pub(super) fn production(
    compiler: &mut Compiler<'_>,
    symbols: &mut Symbols,
    line: &LogicalLine,
    arrow: usize,
) -> Option<Production> {
    let place = line.place()?;
    // Head first: its formal parameters become the local variables that blocks, condition, successor and weight use.
    let head = split_head(compiler, line.tokens.get(..arrow)?, place)?;
    let mut heads = HeadCompiler { compiler, symbols, place };
    let predecessor = heads.predecessor(head.predecessor)?;
    let left = heads.context(head.left, true)?;
    let right = heads.context(head.right, false)?;
    let block = |c: &mut Compiler<'_>, tokens: Option<&[Token]>| match tokens {
        None => Some(None),
        Some(t) => statement::block(c, t, place).map(Some),
    };
    let before = block(compiler, head.before)?;
    let condition = statement::condition(compiler, head.condition, place)?;
    let after = block(compiler, head.after)?;
    // The arrow is three tokens. After the successor a ":" begins the weight.
    let tail = line.tokens.get(arrow + 3..).unwrap_or(&[]);
    let arrow_place = line.tokens.get(arrow).map_or(place, |t| t.place);
    let (successor, rest) = successor::successor(compiler, symbols, tail, arrow_place)?;
    let weight = match rest {
        None => None,
        Some(tokens) => Some(whole_expression(compiler, tokens, place)?),
    };
    let first = head.predecessor.first().map_or(place, |t| t.place);
    let place = head.predecessor.last().map_or(first, |t| first.to(t.place));
    let length = tail.len() - rest.map_or(0, |r| r.len() + 1);
    let end = tail[..length].last().map_or(arrow_place, |t| t.place);
    check_balance(compiler.session, &successor, symbols, "successor", place, end);
    let locals = compiler.locals.len();
    Some(Production {
        left,
        predecessor,
        right,
        new_left: Vec::new(),
        new_right: Vec::new(),
        ignored: None,
        before,
        condition,
        after,
        successor,
        weight,
        locals,
        place,
    })
}

/// Tokens of `{ .. }` beginning at `i`, and the index after the closing brace; `None` if no brace closes it.
fn braced(tokens: &[Token], i: usize) -> Option<(&[Token], usize)> {
    let mut depth = 0_usize;
    for (k, t) in tokens.iter().enumerate().skip(i) {
        match t.kind {
            TokenKind::Char('{') => depth += 1,
            TokenKind::Char('}') if depth == 1 => return Some((&tokens[i + 1..k], k + 1)),
            TokenKind::Char('}') => depth = depth.saturating_sub(1),
            _ => {}
        }
    }
    None
}

fn split_head<'t>(compiler: &mut Compiler<'_>, tokens: &'t [Token], place: SourcePlace) -> Option<ProductionHead<'t>> {
    // Find the first "<" and ">" outside parentheses and the ":" or "{" that ends the strict part of the head.
    let (mut depth, mut less, mut greater) = (0_usize, None, None);
    let mut end = tokens.len();
    for (i, t) in tokens.iter().enumerate() {
        match t.kind {
            TokenKind::Char('(') => depth += 1,
            TokenKind::Char(')') => depth = depth.saturating_sub(1),
            TokenKind::Char('<') if depth == 0 && less.is_none() && greater.is_none() => less = Some(i),
            TokenKind::Char('>') if depth == 0 && greater.is_none() => greater = Some(i),
            TokenKind::Char(':' | '{') if depth == 0 => {
                end = i;
                break;
            }
            _ => {}
        }
    }
    // In other programs `<<` and `>>` are contexts in the new string.
    for i in [less, greater].into_iter().flatten() {
        if let (Some(t), Some(next)) = (tokens.get(i), tokens.get(i + 1))
            && next.glued
            && next.kind == t.kind
        {
            let (sign, once) = if t.is('<') { ("<<", '<') } else { (">>", '>') };
            let message =
                format!("ill-formed production: '{sign}' is a context of the new string, which cpfg does not have");
            let help =
                format!("write '{once}', which sees the string before the step; models of L-Py may have '{sign}'");
            compiler.session.error_help("L010", message, t.place.to(next.place), help);
            return None;
        }
    }
    // Cut the head at the positions found: left context, strict predecessor, right context.
    let left = less.map_or(&[][..], |l| &tokens[..l]);
    let right = greater.map_or(&[][..], |g| &tokens[g + 1..end]);
    let predecessor = &tokens[less.map_or(0, |l| l + 1)..greater.unwrap_or(end)];
    // Optional block before the condition, the condition, optional block after it.
    let mut i = end + usize::from(tokens.get(end).is_some_and(|t| t.is(':')));
    let mut blocks: [Option<&[Token]>; 2] = [None, None];
    let mut condition: &[Token] = &[];
    if tokens.get(i).is_some_and(|t| t.is('{')) {
        let Some((inner, next)) = braced(tokens, i) else { return unclosed_block(compiler, tokens, i, place) };
        (blocks[0], i) = (Some(inner), next);
    }
    // The condition reaches to the second block or to the arrow.
    let stop = tokens[i..].iter().position(|t| t.is('{')).map_or(tokens.len(), |n| i + n);
    condition = if stop > i { &tokens[i..stop] } else { condition };
    if stop < tokens.len() {
        let Some((inner, next)) = braced(tokens, stop) else { return unclosed_block(compiler, tokens, stop, place) };
        blocks[1] = Some(inner);
        if let Some(t) = tokens.get(next) {
            let word = compiler.describe(t);
            let help = "put '-->' behind the second block, and a condition before it";
            compiler.session.error_help("L001", format!("unexpected {word}, expected '-->'"), t.place, help);
            return None;
        }
    }
    Some(ProductionHead { left, predecessor, right, before: blocks[0], condition, after: blocks[1] })
}

fn unclosed_block<T>(compiler: &mut Compiler<'_>, tokens: &[Token], i: usize, place: SourcePlace) -> Option<T> {
    let at = tokens.get(i).map_or(place, |t| t.place);
    compiler.session.error("L004", "block is never closed before '-->'", at, "opened here");
    None
}

struct HeadCompiler<'c, 'r, 's> {
    compiler: &'c mut Compiler<'r>,
    symbols: &'s mut Symbols,
    place: SourcePlace,
}

impl HeadCompiler<'_, '_, '_> {
    fn ill_formed<T>(&mut self, reason: &str, place: SourcePlace) -> Option<T> {
        self.compiler.session.error("L010", format!("ill-formed production: {reason}"), place, "here");
        None
    }

    /// Compiles the strict predecessor. Brackets among its modules are matched literally; a predecessor of brackets alone is
    /// an error.
    fn predecessor(&mut self, tokens: &[Token]) -> Option<Vec<FormalModule>> {
        let elements = self.context_elements(tokens)?;
        let bracket = elements.iter().find(|(e, _)| !matches!(e, ContextElement::Module(_))).map(|(_, place)| *place);
        if let Some(place) = bracket
            && !elements.iter().any(|(e, _)| matches!(e, ContextElement::Module(_)))
        {
            return self.ill_formed("brackets alone cannot be rewritten", place);
        }
        let mut out = Vec::new();
        for (element, place) in elements {
            let c = match element {
                ContextElement::Module(f) => {
                    out.push(f);
                    continue;
                }
                ContextElement::Open => '[',
                ContextElement::Close => ']',
                ContextElement::CloseRest => {
                    return self.ill_formed("'=]' belongs to a context, a predecessor names every module", place);
                }
            };
            // A bracket is matched like a module without parameters.
            let symbol = intern(self.compiler, self.symbols, c, place)?;
            out.push(FormalModule { symbol, arity: 0, slot: 0, place });
        }
        if out.is_empty() {
            return self.ill_formed("it has no predecessor", tokens.first().map_or(self.place, |t| t.place));
        }
        Some(out)
    }

    fn context(&mut self, tokens: &[Token], is_left: bool) -> Option<Vec<ContextElement>> {
        if let [t] = tokens
            && t.is('*')
            && !self.compiler.has_turtle
        {
            return Some(Vec::new());
        }
        let elements = self.context_elements(tokens)?;
        if is_left && let Some((_, place)) = elements.iter().find(|(e, _)| !matches!(e, ContextElement::Module(_))) {
            return self.ill_formed("brackets in a left context never match", *place);
        }
        Some(elements.into_iter().map(|e| e.0).collect())
    }

    /// Reads modules with their formal parameters, which become locals, and brackets.
    fn context_elements(&mut self, tokens: &[Token]) -> Option<Vec<(ContextElement, SourcePlace)>> {
        let mut out: Vec<(ContextElement, SourcePlace)> = Vec::new();
        let mut i = 0;
        while let Some(t) = tokens.get(i) {
            i += 1;
            if t.is('(') {
                i = self.formal_parameters(tokens, i, &mut out)?;
                continue;
            }
            for s in symbols_of(self.compiler, t) {
                // `=]` is one element: it skips the rest of a branch.
                let closes = s.c == '=' && tokens.get(i).is_some_and(|t| t.is(']'));
                match s.c {
                    '[' => out.push((ContextElement::Open, s.place)),
                    ']' => out.push((ContextElement::Close, s.place)),
                    '=' if closes => {
                        i += 1;
                        out.push((ContextElement::CloseRest, s.place));
                    }
                    // With a `turtle:` line `*` is an ordinary symbol.
                    '*' if self.compiler.has_turtle => {
                        let symbol = intern(self.compiler, self.symbols, s.c, s.place)?;
                        let formal = FormalModule { symbol, arity: 0, slot: 0, place: s.place };
                        out.push((ContextElement::Module(formal), s.place));
                    }
                    ')' | '*' | '<' | '>' | ':' => {
                        return self.ill_formed(&format!("'{}' cannot stand here", s.c), s.place);
                    }
                    c => {
                        let symbol = intern(self.compiler, self.symbols, c, s.place)?;
                        let formal = FormalModule { symbol, arity: 0, slot: 0, place: s.place };
                        out.push((ContextElement::Module(formal), s.place));
                    }
                }
            }
        }
        Some(out)
    }

    /// Reads the parameter names `a, b)` after a module; returns the index after the parenthesis.
    fn formal_parameters(
        &mut self,
        tokens: &[Token],
        mut i: usize,
        out: &mut [(ContextElement, SourcePlace)],
    ) -> Option<usize> {
        let open = tokens.get(i - 1).map_or(self.place, |t| t.place);
        let Some((ContextElement::Module(formal), _)) = out.last_mut() else {
            return self.ill_formed("'(' without a module before it", open);
        };
        let slot = self.compiler.next_slot(open)?;
        formal.slot = slot;
        let mut count = 0_usize;
        loop {
            let Some(t) = tokens.get(i) else { return self.ill_formed("parameters are never closed", open) };
            // An empty list `()` means no parameters.
            let TokenKind::Ident(name) = t.kind else {
                if t.is(')') && count == 0 {
                    return Some(i + 1);
                }
                let word = self.compiler.describe(t);
                let help = "write conditions on values after ':'";
                let message = format!("unexpected {word}, expected the name of a parameter");
                self.compiler.session.error_help("L001", message, t.place, help);
                return None;
            };
            // Names must differ over all modules of the head, as each is one variable.
            if self.compiler.locals.contains(&name) {
                let word = self.compiler.session.names.get(name).to_owned();
                let message = format!("parameter '{word}' is named twice");
                self.compiler.session.error("L024", message, t.place, "the second one");
                return None;
            }
            let slot = self.compiler.next_slot(t.place)?;
            self.compiler.parameter_slots.push(slot);
            self.compiler.locals.push(name);
            count += 1;
            // The module is already in `out`; its arity is set after its parameters are read.
            let Ok(arity) = u8::try_from(count) else {
                return self.ill_formed("a module has at most 255 parameters", t.place);
            };
            if let Some((ContextElement::Module(f), _)) = out.last_mut() {
                f.arity = arity;
            }
            match tokens.get(i + 1) {
                Some(n) if n.is(',') => i += 2,
                Some(n) if n.is(')') => return Some(i + 2),
                other => {
                    let at = other.map_or(open, |t| t.place);
                    return self.ill_formed("expected ',' or ')' after a parameter", at);
                }
            }
        }
    }
}

/// Warns about brackets and braces that a successor or the axiom (`what`, at `place`) opens but does not close. `end`: its
/// last token.
pub fn check_balance(
    session: &mut ParseSession,
    successor: &[SuccessorModule],
    symbols: &Symbols,
    what: &str,
    place: SourcePlace,
    end: SourcePlace,
) {
    for (open, close, code) in [('[', ']', "L011"), ('{', '}', "L012")] {
        let mut stack = Vec::new();
        for m in successor {
            match symbols.get(m.symbol) {
                c if c == open => stack.push(m.place),
                // A closing bracket without an opening one is legal: its partner may be in another successor.
                c if c == close => {
                    stack.pop();
                }
                _ => {}
            }
        }
        if let Some(innermost) = stack.last() {
            let message = format!("this {what} has {} '{open}' without '{close}'", stack.len());
            let here = if what == "axiom" { "in this axiom" } else { "in this production" };
            let mut d = Diagnostic::warning(code, message, innermost.span, "the innermost")
                .label(place.span, here)
                .help(format!("close it with '{close}'"));
            // If a single bracket is open, it may be meant to extend to the end.
            if stack.len() == 1 && innermost.origin == 0 {
                let behind = Span { start: end.span.end, ..end.span };
                d = with_fix(d, SourcePlace { span: behind, ..end }, close.to_string());
            }
            session.push(d, *innermost);
        }
    }
}
