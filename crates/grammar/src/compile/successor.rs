//! Compiles successors and axioms: modules with expressions as parameters, and `repeat`s.

use super::symbol::{LocatedSymbol, MAX_ARITY, intern, symbols_in, text_of};
use super::{Compiler, TokenCursor, expression};
use crate::code::Expr;
use crate::program::SuccessorModule;
use crate::symbols::Symbols;
use crate::token::{SourcePlace, Token, TokenKind};
use crate::vm;
use osier_base::diagnostic::Diagnostic;

/// Limit on the modules of one successor after its `repeat`s are expanded; productions are the means for larger counts.
const MAX_SUCCESSOR_MODULES: usize = 1 << 20;

/// A `repeat` whose closing brace is not read yet.
#[derive(Debug)]
struct OpenRepeat {
    /// Index of the first module of its body.
    start: usize,
    times: usize,
    /// Number of polygons open in its body.
    polygons: usize,
    place: SourcePlace,
}

struct SuccessorCompiler<'c, 'r, 's> {
    compiler: &'c mut Compiler<'r>,
    symbols: &'s mut Symbols,
    out: Vec<SuccessorModule>,
    repeats: Vec<OpenRepeat>,
    star: Option<SourcePlace>,
    /// False at the beginning and after a `repeat`, where a parenthesis would not follow a module.
    accepts_parameters: bool,
}

/// Compiles modules with their parameters up to a ':'; returns the tokens after it, if there is one.
pub(super) fn successor<'t>(
    compiler: &mut Compiler<'_>,
    symbols: &mut Symbols,
    tokens: &'t [Token],
    place: SourcePlace,
) -> Option<(Vec<SuccessorModule>, Option<&'t [Token]>)> {
    let mut cursor = TokenCursor::new(tokens, place);
    let mut s = SuccessorCompiler {
        compiler,
        symbols,
        out: Vec::new(),
        repeats: Vec::new(),
        star: None,
        accepts_parameters: false,
    };
    while let Some(t) = cursor.peek() {
        // The weight follows; the caller compiles it.
        if t.is(':') {
            let rest = tokens.get(cursor.pos + 1..);
            return s.finish().map(|o| (o, rest));
        }
        cursor.bump();
        s.append_token(t, &mut cursor)?;
    }
    s.finish().map(|o| (o, None))
}

impl SuccessorCompiler<'_, '_, '_> {
    fn error_help<T>(&mut self, message: String, place: SourcePlace, help: &str) -> Option<T> {
        self.compiler.session.error_help("L001", message, place, help);
        None
    }

    fn append_token(&mut self, t: &Token, cursor: &mut TokenCursor<'_>) -> Option<()> {
        let has_turtle = self.compiler.has_turtle;
        match t.kind {
            TokenKind::Char('(') => {
                // Parameters belong to the module directly before the parenthesis, which takes them only once.
                let known = self.accepts_parameters && self.out.last().is_some_and(|m| m.args.is_empty());
                if !known {
                    let help = "write all parameters of a module in one pair of parentheses behind it: A(1,2)";
                    return self.error_help("unexpected '(', expected a module before it".into(), t.place, help);
                }
                let args = arguments(self.compiler, cursor, t.place)?;
                if let Some(last) = self.out.last_mut() {
                    last.args = args.into();
                }
                return Some(());
            }
            TokenKind::Char('*') if !has_turtle => self.star = Some(t.place),
            TokenKind::Char(c @ (')' | '<' | '>')) => {
                let help = match c {
                    ')' => "remove it, or open the parameters behind a module: A(1)",
                    _ => "remove it: contexts stand left of the arrow",
                };
                return self.error_help(format!("unexpected '{c}', expected a module"), t.place, help);
            }
            TokenKind::Ident(n) if has_turtle && self.compiler.session.names.get(n) == "repeat" => {
                return self.open_repeat(cursor, t.place);
            }
            TokenKind::Char('}') if self.repeats.last().is_some_and(|r| r.polygons == 0) => return self.close_repeat(),
            _ => {
                // Braces of polygons nest inside a `repeat`: it ends at the brace that matches its own.
                if let (Some(r), TokenKind::Char(c)) = (self.repeats.last_mut(), t.kind) {
                    r.polygons = (r.polygons + usize::from(c == '{')).saturating_sub(usize::from(c == '}'));
                }
                // A word is one module for each letter; it may be as long as the file.
                let text = text_of(self.compiler, t);
                self.out.reserve(text.len());
                for LocatedSymbol { c, place } in symbols_in(&text, t) {
                    let symbol = intern(self.compiler, self.symbols, c, place)?;
                    self.out.push(SuccessorModule { symbol, args: Box::default(), occurrence: 0, place });
                }
            }
        }
        self.accepts_parameters = true;
        Some(())
    }

    /// Reads `n {` after `repeat`.
    fn open_repeat(&mut self, cursor: &mut TokenCursor<'_>, place: SourcePlace) -> Option<()> {
        let code = expression::compile_expression(self.compiler, cursor)?;
        // The count must be constant, because the successor is expanded here.
        let times = vm::constant_value(&code).filter(|n| (0.0..=1e6).contains(n));
        let Some(times) = times else {
            let message = "'repeat' takes a constant number from 0 to 1,000,000".to_owned();
            return self.error_help(message, place, "write: repeat 3 { F }; the number may be a #define");
        };
        if times.fract().abs() > 0.0 {
            let message = format!("'repeat {times}': {times} is no whole number, {} is taken", times.trunc());
            self.compiler.session.warning("L008", message, place, "write a whole number");
        }
        if !cursor.eat('{') {
            let at = cursor.place();
            let message = "unexpected token, expected '{' after the number of 'repeat'".to_owned();
            return self.error_help(message, at, "put the modules that it repeats in braces: repeat 3 { F }");
        }
        if self.repeats.len() >= self.compiler.max_depth {
            self.compiler.session.error("L004", "'repeat' nested too deep", place, "too deep here");
            return None;
        }
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "between 0 and a million")]
        let times = times as usize;
        self.repeats.push(OpenRepeat { start: self.out.len(), times, polygons: 0, place });
        self.accepts_parameters = false;
        Some(())
    }

    /// Ends the innermost `repeat`: copies its body the given number of times; L050 beyond [`MAX_SUCCESSOR_MODULES`].
    fn close_repeat(&mut self) -> Option<()> {
        let Some(r) = self.repeats.pop() else { return Some(()) };
        let body = self.out.split_off(r.start.min(self.out.len()));
        // Check the size before copying, because nested repeats multiply.
        let wanted = body.len().saturating_mul(r.times).saturating_add(self.out.len());
        if wanted > MAX_SUCCESSOR_MODULES {
            let message =
                format!("this 'repeat' would produce {wanted} modules, at most {MAX_SUCCESSOR_MODULES} are allowed");
            let help = "reduce the count, or produce the modules by productions";
            self.compiler.session.error_help("L050", message, r.place, help);
            return None;
        }
        self.out.reserve(wanted - self.out.len());
        (0..r.times).for_each(|_| self.out.extend_from_slice(&body));
        self.accepts_parameters = false;
        Some(())
    }

    /// Numbers the occurrences of each symbol from 0. `None` after an error if `*` stands beside other modules or a `repeat`
    /// is not closed.
    fn finish(mut self) -> Option<Vec<SuccessorModule>> {
        if let Some(r) = self.repeats.pop() {
            self.compiler.session.error("L004", "'repeat' is never closed", r.place, "opened here");
            return None;
        }
        if let Some(place) = self.star.filter(|_| !self.out.is_empty()) {
            let message = "unexpected '*', expected a module: '*' is the empty successor and stands alone".to_owned();
            return self.error_help(message, place, "remove the '*', or the modules beside it");
        }
        // Occurrences are counted after the repeats are expanded, so that all modules get different lineages.
        let mut counts = vec![0_u32; self.symbols.len()];
        for m in &mut self.out {
            if let Some(count) = counts.get_mut(usize::from(m.symbol)) {
                m.occurrence = *count;
                *count += 1;
            }
        }
        Some(self.out)
    }
}

/// Compiles parameters up to the closing parenthesis.
fn arguments(compiler: &mut Compiler<'_>, cursor: &mut TokenCursor<'_>, open: SourcePlace) -> Option<Vec<Expr>> {
    let mut args = Vec::new();
    if cursor.eat(')') {
        return Some(args);
    }
    loop {
        // The text in a label, `@L("fmt",x)`, is not a parameter: labels are not printed.
        if matches!(cursor.peek().map(|t| t.kind), Some(TokenKind::Text(_))) && args.is_empty() {
            cursor.bump();
            if cursor.eat(')') {
                return Some(args);
            }
            if cursor.eat(',') {
                continue;
            }
        }
        let code = expression::compile_expression(compiler, cursor)?;
        // Constants and single variables are stored without code.
        args.push(code.into_expr());
        if args.len() > MAX_ARITY {
            let message = "a module has at most 255 parameters".to_owned();
            compiler.session.error_help("L010", message, cursor.place(), "distribute them over several modules");
            return None;
        }
        if cursor.eat(')') {
            return Some(args);
        }
        if !cursor.eat(',') {
            let place = cursor.place();
            let found = cursor.peek().map_or_else(|| "end of line".to_owned(), |t| compiler.describe(t));
            let message = format!("unexpected {found}, expected ',' or ')'");
            let d = Diagnostic::error("L001", message, place.span, "here").label(open.span, "opened here");
            let d = d.help("close the parenthesis, or put a ',' between two parameters");
            compiler.session.push(d, place);
            return None;
        }
    }
}
