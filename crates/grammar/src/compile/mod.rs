//! Compiles tokens to a [`Program`]: items, productions, statements, expressions.

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

/// A cursor over a list of tokens without line ends.
pub(super) struct TokenCursor<'t> {
    tokens: &'t [Token],
    pos: usize,
    /// Place of diagnostics about a missing token.
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

    /// The character `ahead` tokens after the cursor, if no blank separates the tokens up to it.
    pub fn glued_char(&self, ahead: usize) -> Option<char> {
        // Operators of several characters are lexed as single characters that touch.
        let run = self.tokens.get(self.pos + 1..=self.pos + ahead)?;
        match run.last()?.kind {
            TokenKind::Char(c) if run.iter().all(|t| t.glued) => Some(c),
            _ => None,
        }
    }

    pub fn bump(&mut self) {
        self.pos += 1;
    }

    /// Consumes the next token if it is this character.
    pub fn eat(&mut self, c: char) -> bool {
        let found = self.peek().is_some_and(|t| t.is(c));
        self.pos += usize::from(found);
        found
    }

    pub fn place(&self) -> SourcePlace {
        self.peek().map_or(self.fallback, |t| t.place)
    }
}

/// Context of an expression, which determines the names that it may use.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum NameScope {
    /// `#if`: every name counts as 0.
    Preprocessor,
    /// Item values and blocks: all assigned variables are global.
    Global,
    /// Productions: names are formal parameters, then local, then global variables.
    Production,
    /// Angle definitions of the turtle: the local variables are the angles.
    Angle,
}

/// The variables in scope, and the session that collects diagnostics.
pub(super) struct Compiler<'r> {
    pub session: &'r mut ParseSession,
    pub scope: NameScope,
    /// Name numbers of global variables; the position is the slot.
    pub globals: Vec<u32>,
    /// Name numbers of local variables; the position is the slot.
    pub locals: Vec<u32>,
    /// Slots of local variables that still hold a module's parameter as it was stored.
    pub parameter_slots: Vec<u16>,
    /// Limit on the nesting of expressions, blocks and `repeat`s; no option changes it.
    pub max_depth: usize,
    /// True if the grammar has a `turtle:` item: then `*` is an ordinary symbol and `repeat` a keyword.
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

    /// Index in `arrays` of the array with this name; a formal parameter or local variable of the same name hides it.
    pub fn array(&self, name: u32) -> Option<usize> {
        self.arrays.iter().position(|a| a.name == name).filter(|_| !self.locals.contains(&name))
    }

    /// Access to an array element with `given` indices; L022 if the array has another number of dimensions.
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
        // If a name occurs repeatedly, the last one counts: an inner variable hides an outer one.
        list.iter().rposition(|n| *n == name).and_then(|i| u16::try_from(i).ok())
    }

    /// Instruction that reads a variable. Names are searched among local variables, global variables, `Q`, `Z`, `remaining`,
    /// and functions of companion files, in this order. Other names read as 0, with L020 except in `#if`.
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
        // cpfg knows functions by their names as written in their files.
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

    /// Instruction that writes a variable; the first assignment to a name declares the variable.
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

/// Slot for a new variable at the end of a table; `None` after an error if the table is full.
fn next_slot(session: &mut ParseSession, variables: &[u32], place: SourcePlace) -> Option<u16> {
    let slot = u16::try_from(variables.len()).ok();
    if slot.is_none() {
        session.error("L004", "more than 65,535 variables", place, "this one is too many");
    }
    slot
}

/// A token in quotes for messages, `'x'` or `"file"`; `end of line` for a line end.
pub(super) fn describe(names: &NameTable, t: &Token) -> String {
    match t.kind {
        TokenKind::Ident(n) | TokenKind::Number(n) => format!("'{}'", names.get(n)),
        TokenKind::Text(n) => format!("\"{}\"", names.get(n)),
        TokenKind::Char(c) => format!("'{c}'"),
        TokenKind::Newline { .. } => "end of line".to_owned(),
    }
}

/// Truth value of an `#if` expression; false after a syntax error.
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

/// Compiles an expression that must use all tokens; L001 for tokens after it.
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
