//! Tokens to [`Program`]: items, productions, statements, expressions.

mod binding;
mod expression;
mod items;
mod lines;
mod production;
mod statement;
mod successor;
mod symbol;

use std::rc::Rc;

use super::code::{ArrayShape, Bytecode, ElementAccess, Op};
use super::token::{NameTable, ParseSession, SourcePlace, Token, TokenKind, with_fix};
use osier_base::diagnostic::{Diagnostic, nearest};

pub(super) use items::parse;
pub(super) use production::check_balance;

/// A place in a list of tokens without line ends.
pub(super) struct TokenCursor<'t> {
    tokens: &'t [Token],
    pos: usize,
    /// Location of diagnostics about a missing token.
    fallback: SourcePlace,
}

impl<'t> TokenCursor<'t> {
    pub fn new(tokens: &'t [Token], fallback: SourcePlace) -> Self {
        Self { tokens, pos: 0, fallback: tokens.last().map_or(fallback, |t| t.place) }
    }

    pub fn peek(&self) -> Option<&'t Token> {
        self.tokens.get(self.pos)
    }

    pub fn peek_at(&self, ahead: usize) -> Option<&'t Token> {
        self.tokens.get(self.pos + ahead)
    }

    /// The character `ahead` tokens on, if all tokens up to it stick together.
    pub fn glued_char(&self, ahead: usize) -> Option<char> {
        // Operators of several characters come as single characters that touch.
        let run = self.tokens.get(self.pos + 1..=self.pos + ahead)?;
        match run.last()?.kind {
            TokenKind::Char(c) if run.iter().all(|t| t.glued) => Some(c),
            _ => None,
        }
    }

    pub fn bump(&mut self) {
        self.pos += 1;
    }

    /// Takes this character if it comes next.
    pub fn eat(&mut self, c: char) -> bool {
        let found = self.peek().is_some_and(|t| t.is(c));
        self.pos += usize::from(found);
        found
    }

    pub fn place(&self) -> SourcePlace {
        self.peek().map_or(self.fallback, |t| t.place)
    }
}

/// Which names an expression may use.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum NameScope {
    /// `#if`: every name counts as 0.
    Preprocessor,
    /// Item values and blocks: what blocks assign is global.
    Global,
    /// Productions: formal parameters, then locals, then globals.
    Production,
    /// Angles of the turtle: locals are the angles.
    Angle,
}

/// Variables in scope, and the session that diagnostics go to.
pub(super) struct Compiler<'r> {
    pub session: &'r mut ParseSession,
    pub scope: NameScope,
    /// Numbers of global names; the position is the slot.
    pub globals: Vec<u32>,
    /// Numbers of local names; the position is the slot.
    pub locals: Vec<u32>,
    /// Slots of the locals that hold a module's parameter as it was stored.
    pub parameter_slots: Vec<u16>,
    /// Most nested expressions, blocks and `repeat`s; no flag changes it.
    pub max_depth: usize,
    /// The grammar has a `turtle:`: `*` is a letter and `repeat` a word.
    pub has_turtle: bool,
    /// Arrays of all `Define` blocks of the file.
    pub arrays: Rc<[Array]>,
}

/// An array of the grammar; `name` is its number in the table of names.
#[derive(Debug)]
pub(super) struct Array {
    pub name: u32,
    pub shape: ArrayShape,
}

impl<'r> Compiler<'r> {
    pub fn new(session: &'r mut ParseSession, scope: NameScope) -> Self {
        let (globals, locals, parameter_slots) = (Vec::new(), Vec::new(), Vec::new());
        let arrays = Rc::from([]);
        Self { session, scope, globals, locals, parameter_slots, max_depth: 1000, has_turtle: false, arrays }
    }

    /// Index in `arrays` of the array of a name; a formal parameter or a local variable of the same name hides it.
    pub fn array(&self, name: u32) -> Option<usize> {
        self.arrays.iter().position(|a| a.name == name).filter(|_| !self.locals.contains(&name))
    }

    /// An element of an array with `given` indices; L022 if it takes another number of them.
    pub fn element(&mut self, array: usize, given: usize, place: SourcePlace) -> Option<ElementAccess> {
        let array = self.arrays.get(array)?;
        let (wanted, name) = (array.shape.sizes.len(), self.session.names.get(array.name).to_owned());
        if given != wanted {
            let s = if wanted == 1 { "index" } else { "indices" };
            let message = format!("array '{name}' takes {wanted} {s}, got {given}");
            let help = format!("write one index for each of its sizes: {name}[{}]", vec!["i"; wanted].join(","));
            self.session.error_help("L022", message, place, help);
            return None;
        }
        Some(ElementAccess { shape: array.shape.clone(), name, place })
    }

    pub fn describe(&self, t: &Token) -> String {
        describe(&self.session.names, t)
    }

    fn slot(list: &[u32], name: u32) -> Option<u16> {
        // The last of a name: an inner variable hides an outer one.
        list.iter().rposition(|n| *n == name).and_then(|i| u16::try_from(i).ok())
    }

    /// Instruction that reads a variable: a local, a global, then `Q`, `Z` and `remaining`, then the number of a function of a
    /// companion file. Other names read 0, with L020 except in `#if`.
    pub fn load_variable(&mut self, name: u32, place: SourcePlace) -> Op {
        if let Some(slot) = Self::slot(&self.locals, name) {
            return Op::Local(slot);
        }
        if let Some(slot) = Self::slot(&self.globals, name) {
            return Op::Global(slot);
        }
        let word = self.session.names.get(name).to_owned();
        match word.as_str() {
            // Predefined variables; a variable of the grammar with the same name hides them.
            "Q" => return Op::Step,
            "Z" => return Op::Length,
            "remaining" => return Op::Remaining,
            _ if self.scope == NameScope::Preprocessor => return Op::Const(0.0),
            _ => {}
        }
        // cpfg has the names of functions as their file has them.
        if let Some(id) = self.session.functions.id_of(&word) {
            return Op::Const(f64::from(id));
        }
        // Unknown names count as 0, with a warning that suggests the nearest known one.
        let known = self.locals.iter().chain(&self.globals).map(|n| self.session.names.get(*n));
        let near = nearest(&word, known.filter(|k| *k != word)).map(str::to_owned);
        let help = match &near {
            Some(n) => format!("did you mean '{n}'?"),
            None if self.scope == NameScope::Angle => format!("define it: define-angle: {word} = uniform(0,60)"),
            None => "assign it in a Start block, or #define it".to_owned(),
        };
        let message = format!("undefined variable '{word}' counts as 0");
        let mut d = Diagnostic::warning("L020", message, place.span, "here").help(help);
        if let Some(near) = near {
            d = with_fix(d, place, near);
        }
        self.session.push(d, place);
        Op::Const(0.0)
    }

    /// Slot of the next local variable; `None` after an error if the table is full.
    pub fn next_slot(&mut self, place: SourcePlace) -> Option<u16> {
        next_slot(self.session, &self.locals, place)
    }

    /// Instruction that writes a variable. The first assignment of a name declares it.
    pub fn store_variable(&mut self, name: u32, place: SourcePlace) -> Option<Op> {
        if let Some(slot) = Self::slot(&self.locals, name) {
            self.parameter_slots.retain(|s| *s != slot);
            return Some(Op::StoreLocal(slot));
        }
        if let Some(slot) = Self::slot(&self.globals, name) {
            return Some(Op::StoreGlobal(slot));
        }
        let is_local = self.scope == NameScope::Production;
        let list = if is_local { &mut self.locals } else { &mut self.globals };
        let slot = next_slot(self.session, list, place)?;
        list.push(name);
        Some(if is_local { Op::StoreLocal(slot) } else { Op::StoreGlobal(slot) })
    }
}

/// Slot after the last variable of a table; `None` after an error if the table is full.
fn next_slot(session: &mut ParseSession, variables: &[u32], place: SourcePlace) -> Option<u16> {
    let slot = u16::try_from(variables.len()).ok();
    if slot.is_none() {
        session.error("L004", "more than 65,535 variables", place, "this one is too many");
    }
    slot
}

/// A token in quotes as in messages, `'x'` or `"file"`; `end of line` for a line end.
pub(super) fn describe(names: &NameTable, t: &Token) -> String {
    match t.kind {
        TokenKind::Ident(n) | TokenKind::Number(n) => format!("'{}'", names.get(n)),
        TokenKind::Text(n) => format!("\"{}\"", names.get(n)),
        TokenKind::Char(c) => format!("'{c}'"),
        TokenKind::Newline { .. } => "end of line".to_owned(),
    }
}

/// Value of an `#if` expression as a truth value; false after a syntax error.
pub(super) fn evaluate_condition(session: &mut ParseSession, tokens: &[Token], place: SourcePlace) -> bool {
    let mut compiler = Compiler::new(session, NameScope::Preprocessor);
    let mut cursor = TokenCursor::new(tokens, place);
    let code = expression::compile_expression(&mut compiler, &mut cursor);
    if let (Some(_), Some(t)) = (&code, cursor.peek()) {
        let word = describe(&session.names, t);
        let help = "remove it, or put an operator between two values: #if A == 1";
        session.error_help("L001", format!("unexpected {word}, expected an operator"), t.place, help);
        return false;
    }
    code.is_some_and(|c| crate::vm::constant_value(&c) != Some(0.0))
}

/// True for `-->` beginning at token `i`.
pub(super) fn is_arrow(tokens: &[Token], i: usize) -> bool {
    match tokens.get(i..i + 3) {
        Some([a, b, c]) => a.is('-') && b.is('-') && b.glued && c.is('>') && c.glued,
        _ => false,
    }
}

/// Compiles an expression that must fill the whole list of tokens; L001 for tokens after it.
fn whole_expression(compiler: &mut Compiler<'_>, tokens: &[Token], place: SourcePlace) -> Option<Bytecode> {
    let mut cursor = TokenCursor::new(tokens, place);
    let code = expression::compile_expression(compiler, &mut cursor)?;
    match cursor.peek() {
        None => Some(code),
        Some(t) => {
            let word = compiler.describe(t);
            let message = format!("unexpected {word}, expected an operator or the end");
            if t.is('=') {
                let help = "did you mean '=='? A single '=' assigns in a block";
                compiler.session.error_fix("L001", message, t.place, help, "==");
            } else {
                let help = "remove it, or put an operator between two values";
                compiler.session.error_help("L001", message, t.place, help);
            }
            None
        }
    }
}
