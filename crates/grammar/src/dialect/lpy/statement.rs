//! Statements of productions: what they are, and how they are read.

use std::collections::BTreeMap;
use std::ops::Range;

use osier_base::convert::saturating_index;

use super::bounds::mentions;
use super::dictionary::keys_of;
use super::expression::{OwnFunction, PyExpr, PyOp, Refusal, Scope};
use super::expression::{
    compile, exchanged, first_call, has_random, is_dictionary, resolve, size_with, substitute, tested, with_functions,
};
use super::lists::{change_of, is_change};
use super::parser::parse;
use super::strings::{PyModule, closing, split};
use super::{Line, Model, assignment, block_after, block_colon, function_head, is_name, lambda};
use crate::code::is_zero;
use crate::dialect::text::Piece;

/// Variable with the number of the group of productions that is active, which no model can name.
pub(super) const GROUP: &str = "(group)";

/// Assignments that change a value; signs of two characters before the signs that they end with.
pub(super) const OPERATORS: [(&str, PyOp); 7] = [
    ("**=", PyOp::Pow),
    ("//=", PyOp::FloorDiv),
    ("%=", PyOp::Mod),
    ("+=", PyOp::Add),
    ("-=", PyOp::Sub),
    ("*=", PyOp::Mul),
    ("/=", PyOp::Div),
];

/// Deepest nesting of blocks in a production; deeper ones are refused, as the reader recurses.
const MAX_NESTING: usize = 64;

#[derive(Debug, Clone)]
pub(super) enum Statement {
    Assign(String, PyExpr),
    /// Conditions with their blocks, then the block of `else`.
    If(Vec<(PyExpr, Vec<Statement>)>, Vec<Statement>),
    /// Variable, list of its values.
    For(String, PyExpr, Vec<Statement>, Range<usize>),
    /// Adds modules; true ends the production.
    Produce(Vec<PyModule>, bool),
    /// Names whose assignments change variables of the model.
    Global(Vec<String>),
    /// Test, body, place of the heading, and how many turns lie behind it where it is written out turn by turn.
    While(PyExpr, Vec<Statement>, Range<usize>, u32),
    Break(Range<usize>),
    Continue(Range<usize>),
    /// Where a `continue` goes on in a loop that is written out turn by turn.
    TurnEnd,
    /// Where a `break` goes on.
    LoopEnd,
    /// Where the `return` of a function that a production calls goes on: variable of the value, function, place of the call.
    FunctionEnd(String, String, Range<usize>),
    /// A function has a value, a production has none.
    Return(Option<PyExpr>, Range<usize>),
    Pass,
}

impl Model<'_, '_> {
    /// Reads the lines of a production or a function. Functions that it defines are written in where it calls them.
    pub(super) fn statements(&mut self, block: &[Line<'_>]) -> Result<Vec<Statement>, Refusal> {
        let around = std::mem::take(&mut self.own_functions);
        let list = self.block(block, 0);
        let own = std::mem::replace(&mut self.own_functions, around);
        let list = list?;
        if own.is_empty() {
            return Ok(list);
        }
        Ok(list.iter().map(|s| s.mapped(&String::clone, &|e| with_functions(e, &own, &self.scope))).collect())
    }

    /// Reads the lines of a block, with the blocks nested in it. Fails if blocks are nested too deep.
    fn block(&mut self, block: &[Line<'_>], nesting: usize) -> Result<Vec<Statement>, Refusal> {
        let mut out = Vec::new();
        let mut i = 0;
        if let Some(first) = block.first().filter(|_| nesting > MAX_NESTING) {
            return Err(Refusal::new("blocks nested too deep", first.piece.range()));
        }
        while let Some(line) = block.get(i) {
            let parts = statements_of_line(line.piece);
            if parts.len() > 1 {
                let lines: Vec<Line<'_>> = parts.into_iter().map(|piece| Line { indent: line.indent, piece }).collect();
                out.extend(self.block(&lines, nesting)?);
                i += 1;
                continue;
            }
            let piece = parts.first().copied().unwrap_or(line.piece);
            // The lines indented deeper, and where the block goes on after them.
            let (inner, next) = block_after(block, i, line.indent);
            let (word, rest) = piece.first_word(&['(', ':', '=', '[']);
            // A block may stand on the line of its heading.
            let body = |model: &mut Self, after: Piece<'_>| {
                let after = after.trimmed();
                if after.text.is_empty() {
                    model.block(inner, nesting + 1)
                } else {
                    model.block(&[Line { indent: 0, piece: after }], nesting + 1)
                }
            };
            i = next;
            let is_produce = matches!(word.text, "produce" | "nproduce");
            if let Some(inner) = inner.first().filter(|_| !is_produce && !heads_block(word.text)) {
                return Err(indented_refusal(inner.piece));
            }
            match word.text {
                // The modules may go on in indented lines.
                _ if is_produce => {
                    let modules = self.modules_of(rest, inner)?;
                    out.push(Statement::Produce(modules, word.text == "produce"));
                }
                // What these do does not reach the string of modules.
                "pass" | "print" | "assert" => out.push(Statement::Pass),
                // A text alone describes a function.
                _ if piece.text.starts_with(['"', '\'']) => {}
                "global" => out.push(Statement::Global(split(rest).iter().map(|n| n.text.to_owned()).collect())),
                "return" if rest.text.is_empty() || rest.text == "None" => {
                    out.push(Statement::Return(None, piece.range()));
                }
                // `return x, y` gives a list.
                "return" => {
                    let mut values = split(rest).into_iter().map(parse).collect::<Result<Vec<_>, _>>()?;
                    let value = if values.len() == 1 { values.remove(0) } else { PyExpr::List(values, rest.range()) };
                    out.push(Statement::Return(Some(value), piece.range()));
                }
                "if" | "elif" => {
                    let c = block_colon(rest).ok_or_else(|| Refusal::new("'if' without ':'", piece.range()))?;
                    let test = self.test(rest.up_to(c))?;
                    let then = body(self, rest.from(c + 1))?;
                    if word.text == "if" {
                        out.push(Statement::If(vec![(test, then)], Vec::new()));
                    // The statement before must be an `if`: Python allows nothing between the two.
                    } else if let Some(Statement::If(tests, _)) = out.last_mut() {
                        tests.push((test, then));
                    } else {
                        return Err(Refusal::new("'elif' without 'if'", piece.range()));
                    }
                }
                "else" => {
                    let c = block_colon(rest).ok_or_else(|| Refusal::new("'else' without ':'", piece.range()))?;
                    let other = body(self, rest.from(c + 1))?;
                    // The statement before must be an `if`, as for `elif`, or a loop.
                    let broken = format!("(broken {})", piece.at);
                    match out.last_mut() {
                        Some(Statement::If(_, last)) => {
                            *last = other;
                            continue;
                        }
                        Some(Statement::For(_, _, body, _) | Statement::While(_, body, ..)) => {
                            *body = noting_breaks(std::mem::take(body), &broken);
                        }
                        _ => return Err(Refusal::new("'else' without 'if'", piece.range())),
                    }
                    // `else` of a loop runs unless a `break` has ended the loop.
                    let is_whole = PyExpr::Not(Box::new(PyExpr::Name(broken.clone(), piece.range())));
                    out.insert(out.len() - 1, Statement::Assign(broken, PyExpr::Number(0.0)));
                    out.push(Statement::If(vec![(is_whole, other)], Vec::new()));
                }
                "for" => {
                    let c = block_colon(rest).ok_or_else(|| Refusal::new("'for' without ':'", piece.range()))?;
                    let inner = body(self, rest.from(c + 1))?;
                    out.push(self.loop_over(rest.up_to(c), inner, piece.range())?);
                }
                "while" => {
                    let c = block_colon(rest).ok_or_else(|| Refusal::new("'while' without ':'", piece.range()))?;
                    let test = self.test(rest.up_to(c))?;
                    let inner = body(self, rest.from(c + 1))?;
                    out.push(Statement::While(test, inner, piece.range(), 0));
                }
                "break" => out.push(Statement::Break(piece.range())),
                "continue" => out.push(Statement::Continue(piece.range())),
                "import" | "from" => self.import(piece),
                "def" if nesting == 0 => self.own_function(rest, inner, piece.range())?,
                "def" => {
                    let why = Refusal::new("'def' within another block", piece.range());
                    return Err(why.remedy("write the function outside of the production"));
                }
                "try" | "with" | "class" | "raise" | "del" | "sproduce" | "nsproduce" | "lambda" => {
                    let why = Refusal::new(format!("'{}' in a production", word.text), piece.range());
                    return Err(Refusal { remedy: remedy_of(word.text), ..why });
                }
                _ => match own_lambda(piece) {
                    Some((name, function)) if nesting == 0 => self.add_own_function(name, function)?,
                    _ => out.extend(assign_statement(piece)?),
                },
            }
        }
        Ok(out)
    }

    /// Reads a `def` of a production or a function: a value of its parameters and of the variables around it.
    fn own_function(&mut self, rest: Piece<'_>, block: &[Line<'_>], range: Range<usize>) -> Result<(), Refusal> {
        let refused = || {
            let why = Refusal::new("a 'def' of a production that is more than a value", range.clone());
            why.remedy("write the function outside of the production, with what it reads as parameters")
        };
        let head = function_head(rest).ok_or_else(refused)?;
        let defaults = head.params.iter().map(|(_, value)| value.map(parse).transpose());
        let defaults = defaults.collect::<Result<Vec<_>, _>>()?;
        if defaults.iter().flatten().any(|e| !is_written_out(e)) {
            return Err(refused());
        }
        let params: Vec<String> = head.params.into_iter().map(|(name, _)| name).collect();
        let inline = [Line { indent: 0, piece: head.body }];
        let lines: &[Line<'_>] = if head.body.text.is_empty() { block } else { &inline };
        let list = self.statements(lines)?;
        let with_others = |e: &PyExpr| with_functions(e, &self.own_functions, &self.scope);
        let list = list.iter().rev().map(|s| s.mapped(&String::clone, &with_others)).collect();
        // Other names than its parameters may be variables of the production, whose values are not known here.
        let (functions, has_none) = (self.scope.functions.clone(), self.scope.has_none);
        let scope = Scope { functions, has_none, ..Scope::default() };
        let values = params.iter().map(|p| PyExpr::Name(p.clone(), range.clone())).collect();
        let mut function = FunctionValue { scope: &scope, place: range.clone(), count: 0 };
        let value = function.of(list, params.clone(), values, 0).map_err(|_| refused())?;
        let name = rest.text.split('(').next().unwrap_or("").trim();
        self.add_own_function(rest.up_to(name.len()), OwnFunction { params, defaults, value })
    }

    /// Adds a function of a production. All its calls mean this one, so that a second one of its name is refused.
    fn add_own_function(&mut self, name: Piece<'_>, function: OwnFunction) -> Result<(), Refusal> {
        if self.own_functions.insert(name.text.to_owned(), function).is_none() {
            return Ok(());
        }
        let why = Refusal::new(format!("a second function '{}' of a production", name.text), name.range());
        Err(why.remedy("give each function a name of its own"))
    }

    /// A test of a statement or of a production.
    pub(super) fn test(&self, piece: Piece<'_>) -> Result<PyExpr, Refusal> {
        let test = parse(piece)?;
        Ok(if self.scope.has_none { tested(test) } else { test })
    }

    /// A `for` loop: `i in range(a, b, step)`, `x, y in list`, `i, x in enumerate(list)`, `x, y in zip(list, other)`.
    fn loop_over(
        &mut self,
        head: Piece<'_>,
        mut body: Vec<Statement>,
        place: Range<usize>,
    ) -> Result<Statement, Refusal> {
        let refused = || Refusal::new("'for' over something other than range(..)", head.range());
        let (name, rest) = head.first_word(&[]);
        let (word, list) = rest.first_word(&[]);
        let (targets, list) = if word.text == "in" {
            (name, list)
        } else {
            let at = head.text.find(" in ").ok_or_else(refused)?;
            (head.up_to(at).trimmed(), head.from(at + " in ".len()))
        };
        let list = parse(list.trimmed()).map_err(|_| refused())?;
        let parts = parts_of(targets);
        let (number, target, list) = match (list, parts.as_slice()) {
            (PyExpr::Call(function, lists, _), [number, value]) if function == "enumerate" => {
                let (list, from) = match lists.as_slice() {
                    [list] => (list, PyExpr::Number(0.0)),
                    [list, PyExpr::Call(word, value, _)] if word == "start=" => {
                        (list, value.first().cloned().ok_or_else(refused)?)
                    }
                    [list, from] => (list, from.clone()),
                    _ => return Err(refused()),
                };
                (Some((*number, from)), *value, list.clone())
            }
            (list, _) => (None, targets, list),
        };
        let list = match resolve(&list, &self.scope, 0) {
            Ok(e) if is_dictionary(&e) => keys_of(list),
            _ => list,
        };
        // The number of the turn, under a name that no model has.
        let count = format!("(each {})", head.at);
        let index = PyExpr::Name(count.clone(), head.range());
        let is_list = |e: &PyExpr, scope: &Scope| {
            let first = substitute(e, std::slice::from_ref(&count), &[PyExpr::Number(0.0)]);
            matches!(resolve(&first, scope, 0), Ok(PyExpr::List(..)))
        };
        if number.is_none()
            && parts_of(target).len() == 1
            && !is_list(&item_at(&list, &index, &head.range()), &self.scope)
        {
            return Ok(Statement::For(target.text.to_owned(), list, body, place));
        }
        let list = self.named_list(list, &mut format!("(list {})", head.at));
        let turns = PyExpr::Call("range".to_owned(), vec![length_of(&list, head.range())], head.range());
        let mut turn = Vec::new();
        if let Some((number, from)) = number {
            let is_plain = matches!(from, PyExpr::Number(n) if is_zero(n));
            let sum = || PyExpr::Binary(PyOp::Add, Box::new(from.clone()), Box::new(index.clone()));
            let count = if is_plain { index.clone() } else { sum() };
            turn.push(Statement::Assign(number.text.to_owned(), count));
        }
        // Names within names, with what they stand for; the next one last.
        let mut open = vec![(target, item_at(&list, &index, &head.range()))];
        while let Some((target, value)) = open.pop() {
            let parts = parts_of(target);
            if parts.len() > 1 {
                let item = |k: usize| match &value {
                    PyExpr::List(items, _) => items.get(k).cloned(),
                    list => Some(item_of(list, saturating_index(k), head.range())),
                };
                let items = (0..parts.len()).map(item).collect::<Option<Vec<_>>>().ok_or_else(refused)?;
                open.extend(parts.into_iter().zip(items).rev());
                continue;
            }
            let name = parts.first().filter(|p| is_name(p.text)).ok_or_else(refused)?.text.to_owned();
            if is_list(&value, &self.scope) {
                // A list is no value of a variable: it stands where the name is read.
                let (mut names, mut globals) = (Vec::new(), Vec::new());
                assigned(&body, &mut names, &mut globals);
                if names.contains(&name) {
                    return Err(refused());
                }
                body = body.iter().map(|s| replaced(s, &name, &value)).collect();
            } else {
                turn.push(Statement::Assign(name, value));
            }
        }
        turn.append(&mut body);
        Ok(Statement::For(count, turns, turn, place))
    }

    /// Lists that are written out get a name, so that the turns of a loop do not repeat them.
    pub(super) fn named_list(&mut self, list: PyExpr, name: &mut String) -> PyExpr {
        match list {
            PyExpr::Call(function, lists, place) if function == "zip" => {
                let lists = lists.into_iter().map(|l| self.named_list(l, name)).collect();
                PyExpr::Call(function, lists, place)
            }
            PyExpr::List(items, place) if items.iter().all(is_written_out) => {
                // Each name is longer than the one before.
                name.push('+');
                self.scope.lists.insert(name.clone(), PyExpr::List(items, place.clone()));
                PyExpr::Name(name.clone(), place)
            }
            other => other,
        }
    }
}

/// What to write instead of a statement of Python that is not read.
pub(super) fn remedy_of(word: &str) -> Option<&'static str> {
    Some(match word {
        "try" | "with" => "write the statements of its block without it",
        "raise" | "del" => "leave it out",
        "class" => "hand its values on as parameters of modules",
        "sproduce" | "nsproduce" => "write the modules themselves, behind 'produce' or 'nproduce'",
        _ => return None,
    })
}

/// `name = lambda x: value`.
fn own_lambda(piece: Piece<'_>) -> Option<(Piece<'_>, OwnFunction)> {
    let (name, value) = assignment(piece)?;
    let (params, value) = lambda(value).filter(|_| is_name(name.text))?;
    Some((name, OwnFunction { params, defaults: Vec::new(), value }))
}

/// Statements of a loop that set a variable to 1 before each `break` of the loop.
fn noting_breaks(list: Vec<Statement>, name: &str) -> Vec<Statement> {
    let mut out = Vec::with_capacity(list.len());
    for s in list {
        match s {
            Statement::Break(_) => out.extend([Statement::Assign(name.to_owned(), PyExpr::Number(1.0)), s]),
            Statement::If(tests, other) => {
                let tests = tests.into_iter().map(|(test, then)| (test, noting_breaks(then, name))).collect();
                out.push(Statement::If(tests, noting_breaks(other, name)));
            }
            // A `break` within another loop ends that one.
            _ => out.push(s),
        }
    }
    out
}

/// True for numbers, texts, and lists of them.
pub(super) fn is_written_out(e: &PyExpr) -> bool {
    match e {
        PyExpr::Number(_) | PyExpr::Text(..) => true,
        PyExpr::Neg(a) => matches!(**a, PyExpr::Number(_)),
        PyExpr::List(items, _) => items.iter().all(is_written_out),
        _ => false,
    }
}

/// The names of `x, y` or `(x, y)`.
fn parts_of(targets: Piece<'_>) -> Vec<Piece<'_>> {
    let inner = targets.text.strip_prefix('(').filter(|t| closing(t).is_some_and(|end| end + 1 == t.len()));
    split(inner.map_or(targets, |t| Piece::new(targets.at + 1, &t[..t.len() - 1])))
}

/// `list[index]`; of `zip(list, other)` the list of both items.
fn item_at(list: &PyExpr, index: &PyExpr, place: &Range<usize>) -> PyExpr {
    match list {
        PyExpr::Call(function, lists, _) if function == "zip" => {
            PyExpr::List(lists.iter().map(|l| item_at(l, index, place)).collect(), place.clone())
        }
        _ => PyExpr::Index(Box::new(list.clone()), Box::new(index.clone()), place.clone()),
    }
}

/// `len(list)`; of `zip(list, other)` the lesser length.
fn length_of(list: &PyExpr, place: Range<usize>) -> PyExpr {
    match list {
        PyExpr::Call(function, lists, _) if function == "zip" => {
            let least = |a, b| PyExpr::Call("min".to_owned(), vec![a, b], place.clone());
            let lengths = lists.iter().map(|l| length_of(l, place.clone()));
            lengths.reduce(least).unwrap_or(PyExpr::Number(0.0))
        }
        _ => PyExpr::Call("len".to_owned(), vec![list.clone()], place),
    }
}

impl Statement {
    /// The statement with its expressions, and those of the blocks within it, exchanged by `read`, and the names that it sets by `own`.
    fn mapped(&self, own: &dyn Fn(&String) -> String, read: &dyn Fn(&PyExpr) -> PyExpr) -> Self {
        let all = |list: &[Self]| list.iter().map(|s| s.mapped(own, read)).collect::<Vec<_>>();
        match self {
            Self::Assign(name, e) => Self::Assign(own(name), read(e)),
            Self::If(tests, other) => {
                Self::If(tests.iter().map(|(test, then)| (read(test), all(then))).collect(), all(other))
            }
            Self::For(name, list, body, place) => Self::For(own(name), read(list), all(body), place.clone()),
            Self::While(test, body, place, turn) => Self::While(read(test), all(body), place.clone(), *turn),
            Self::Produce(modules, ends) => {
                let with = |m: &PyModule| PyModule { args: m.args.iter().map(read).collect(), ..m.clone() };
                Self::Produce(modules.iter().map(with).collect(), *ends)
            }
            Self::Return(value, place) => Self::Return(value.as_ref().map(read), place.clone()),
            Self::Global(_)
            | Self::Break(_)
            | Self::Continue(_)
            | Self::TurnEnd
            | Self::LoopEnd
            | Self::FunctionEnd(..)
            | Self::Pass => self.clone(),
        }
    }
}

/// A statement with an expression in place of a name that it does not set.
fn replaced(s: &Statement, name: &String, by: &PyExpr) -> Statement {
    s.mapped(&String::clone, &|e| substitute(e, std::slice::from_ref(name), std::slice::from_ref(by)))
}

/// A statement with other names in place of names that it may set.
pub(super) fn renamed(s: &Statement, names: &[String], others: &[String]) -> Statement {
    let values: Vec<PyExpr> = others.iter().map(|other| PyExpr::Name(other.clone(), 0..0)).collect();
    let own = |name: &String| names.iter().position(|n| n == name).and_then(|i| others.get(i)).unwrap_or(name).clone();
    s.mapped(&own, &|e| substitute(e, names, &values))
}

/// A statement with lists in place of their names. Blocks within it that may set a name read it when they are reached.
pub(super) fn with_lists(s: Statement, lists: &BTreeMap<String, PyExpr>) -> Statement {
    if lists.is_empty() {
        return s;
    }
    let one = |s: &Statement, (name, list): (&String, &PyExpr)| replaced(s, name, list);
    match s {
        Statement::If(tests, other) => {
            let read = |test: PyExpr| {
                let (names, values): (Vec<_>, Vec<_>) = lists.iter().map(|(n, l)| (n.clone(), l.clone())).unzip();
                substitute(&test, &names, &values)
            };
            Statement::If(tests.into_iter().map(|(test, then)| (read(test), then)).collect(), other)
        }
        Statement::For(..) | Statement::While(..) => {
            let (mut names, mut globals) = (Vec::new(), Vec::new());
            assigned(std::slice::from_ref(&s), &mut names, &mut globals);
            lists.iter().filter(|(name, _)| !names.contains(name)).fold(s, |s, list| one(&s, list))
        }
        s => lists.iter().fold(s, |s, list| one(&s, list)),
    }
}

/// Parts of a line between the semicolons outside of brackets, without empty ones; those of texts are masked.
pub(super) fn at_semicolons(piece: Piece<'_>) -> Vec<Piece<'_>> {
    let (mut out, mut depth, mut from) = (Vec::new(), 0_usize, 0);
    for (i, c) in piece.text.char_indices() {
        match c {
            '(' | '[' | '{' => depth += 1,
            ')' | ']' | '}' => depth = depth.saturating_sub(1),
            ';' if depth == 0 => {
                out.push(piece.up_to(i).from(from).trimmed());
                from = i + 1;
            }
            _ => {}
        }
    }
    out.push(piece.from(from).trimmed());
    out.retain(|p| !p.text.is_empty());
    out
}

/// True for a word that begins the heading of a block of Python.
pub(super) fn heads_block(word: &str) -> bool {
    matches!(word, "if" | "elif" | "else" | "for" | "while" | "def" | "class" | "try" | "except" | "finally" | "with")
}

/// The refusal of a line that is indented more than the line before it, which heads no block.
pub(super) fn indented_refusal(piece: Piece<'_>) -> Refusal {
    let why = Refusal::new("an indented line behind a line that heads no block", piece.range());
    why.remedy("begin it where the line before it begins")
}

/// The statements of a line, between its semicolons; one for a line that heads a block. The modules of `produce` reach to the end of
/// the line, as `;` is one of them.
pub(super) fn statements_of_line(piece: Piece<'_>) -> Vec<Piece<'_>> {
    fn word(p: Piece<'_>) -> &str {
        p.first_word(&['(', ':', '=', '[']).0.text
    }
    if heads_block(word(piece)) {
        return vec![piece];
    }
    let mut parts = at_semicolons(piece);
    let produce = parts.iter().position(|p| matches!(word(*p), "produce" | "nproduce"));
    if let Some((k, at)) = produce.and_then(|k| Some((k, parts.get(k)?.at))) {
        parts.truncate(k);
        parts.push(piece.from(at - piece.at));
    }
    parts
}

/// `list[k]`.
fn item_of(list: &PyExpr, k: u32, place: Range<usize>) -> PyExpr {
    PyExpr::Index(Box::new(list.clone()), Box::new(PyExpr::Number(f64::from(k))), place)
}

/// Assignments of a production: `x = e`, `x = y = e`, `x, y = e, f`, `x, y = list`, `x += e`.
pub(super) fn assign_statement(piece: Piece<'_>) -> Result<Vec<Statement>, Refusal> {
    let refused = || {
        let shown: String = piece.text.chars().take(40).collect();
        Refusal::new(format!("'{shown}' in a production"), piece.range())
    };
    if let Some(number) = piece.text.strip_prefix("useGroup(").and_then(|n| n.strip_suffix(')')) {
        let number = parse(Piece::new(piece.at + "useGroup(".len(), number))?;
        return Ok(vec![Statement::Assign(GROUP.to_owned(), number)]);
    }
    if let Some(changes) = change_of(piece)? {
        return Ok(changes.into_iter().map(|(name, e)| Statement::Assign(name, e)).collect());
    }
    for (sign, op) in OPERATORS {
        if let Some(i) = piece.text.find(sign) {
            let name = piece.up_to(i).trimmed();
            let value = parse(piece.from(i + sign.len()).trimmed())?;
            // `x += e` becomes `x = x + e`.
            let old = PyExpr::Name(name.text.to_owned(), name.range());
            let sum = PyExpr::Binary(op, Box::new(old), Box::new(value));
            return Ok(vec![Statement::Assign(name.text.to_owned(), sum)]);
        }
    }
    let (names, mut value) = assignment(piece).ok_or_else(refused)?;
    let names = split(names);
    // `x = y = e` takes the value once.
    let mut others = Vec::new();
    while let Some((other, last)) = assignment(value) {
        if split(other).len() != 1 {
            return Err(refused());
        }
        others.push(other);
        value = last;
    }
    if !others.is_empty() {
        let [first] = names.as_slice() else { return Err(refused()) };
        let same = || PyExpr::Name(first.text.to_owned(), first.range());
        let mut out = vec![Statement::Assign(first.text.to_owned(), parse(value)?)];
        out.extend(others.iter().map(|name| Statement::Assign(name.text.to_owned(), same())));
        return Ok(out);
    }
    let values = split(value);
    let values = match values.as_slice() {
        several if several.len() == names.len() => several.iter().map(|v| parse(*v)).collect::<Result<Vec<_>, _>>()?,
        // `x, y = list`: one name for each item.
        [list] => match parse(*list)? {
            PyExpr::List(items, _) if items.len() == names.len() => items,
            PyExpr::Number(_) | PyExpr::Text(..) | PyExpr::List(..) => return Err(refused()),
            list => (0..names.len()).map(|k| item_of(&list, saturating_index(k), piece.range())).collect(),
        },
        _ => return Err(refused()),
    };
    let mut out = Vec::with_capacity(values.len());
    // Python takes all values first: those that read a name which an earlier one sets wait under names that no model has.
    let reads_earlier =
        |(k, value): (usize, &PyExpr)| names.iter().take(k).any(|name: &Piece<'_>| mentions(value, name.text));
    if values.iter().enumerate().any(reads_earlier) {
        let waiting = |k: usize| format!("(value {k} of {})", piece.at);
        out.extend(values.into_iter().enumerate().map(|(k, value)| Statement::Assign(waiting(k), value)));
        out.extend(names.iter().enumerate().map(|(k, name)| {
            let value = PyExpr::Name(waiting(k), name.range());
            Statement::Assign(name.text.to_owned(), value)
        }));
    } else {
        out.extend(names.iter().zip(values).map(|(name, value)| Statement::Assign(name.text.to_owned(), value)));
    }
    Ok(out)
}

/// A statement in one turn of a loop: ranges of loops within it may name the variable.
pub(super) fn in_turn(s: &Statement, name: &String, value: f64) -> Statement {
    // Nothing sets the number of a turn, so that its value can stand wherever it is read.
    if name.starts_with('(') {
        return replaced(s, name, &PyExpr::Number(value));
    }
    let all = |list: &[Statement]| list.iter().map(|s| in_turn(s, name, value)).collect::<Vec<_>>();
    match s {
        Statement::If(tests, other) => {
            let tests = tests.iter().map(|(test, then)| (test.clone(), all(then))).collect();
            Statement::If(tests, all(other))
        }
        Statement::For(own, list, body, place) => {
            // Lists must be constant, so that they need the number now; elsewhere the variable is read as it was assigned for this turn.
            let list = substitute(list, std::slice::from_ref(name), &[PyExpr::Number(value)]);
            Statement::For(own.clone(), list, all(body), place.clone())
        }
        Statement::While(test, body, place, turn) => Statement::While(test.clone(), all(body), place.clone(), *turn),
        other => other.clone(),
    }
}

/// True if statements only compute: a loop of them becomes code that runs as often as it must.
pub(super) fn only_computes(statements: &[Statement]) -> bool {
    statements.iter().all(|s| match s {
        Statement::If(tests, other) => tests.iter().all(|(_, then)| only_computes(then)) && only_computes(other),
        Statement::For(_, _, body, _) | Statement::While(_, body, ..) => only_computes(body),
        Statement::Produce(..) | Statement::Return(..) => false,
        Statement::Assign(_, e) => !is_change(e),
        _ => true,
    })
}

/// True if the statements of a function change nothing of the model, and each of its `return` has a value.
pub(super) fn only_returns(statements: &[Statement]) -> bool {
    statements.iter().all(|s| match s {
        Statement::If(tests, other) => tests.iter().all(|(_, then)| only_returns(then)) && only_returns(other),
        Statement::For(_, _, body, _) | Statement::While(_, body, ..) => only_returns(body),
        Statement::Produce(..) | Statement::Global(_) | Statement::Return(None, _) => false,
        _ => true,
    })
}

/// Appends the expressions of statements, with those of the blocks within them.
fn append_expressions<'s>(statements: &'s [Statement], out: &mut Vec<&'s PyExpr>) {
    for s in statements {
        match s {
            Statement::Assign(_, e) | Statement::Return(Some(e), _) => out.push(e),
            Statement::If(tests, other) => {
                for (test, then) in tests {
                    out.push(test);
                    append_expressions(then, out);
                }
                append_expressions(other, out);
            }
            Statement::For(_, e, body, _) | Statement::While(e, body, ..) => {
                out.push(e);
                append_expressions(body, out);
            }
            Statement::Produce(modules, _) => out.extend(modules.iter().flat_map(|m| &m.args)),
            _ => {}
        }
    }
}

/// True if statements read a name.
pub(super) fn read_name(statements: &[Statement], name: &str) -> bool {
    let mut all = Vec::new();
    append_expressions(statements, &mut all);
    all.into_iter().any(|e| mentions(e, name))
}

/// The first call of one of some functions in what a statement reads before the blocks within it run; the test of a `while` is
/// read again for each turn, and has none.
pub(super) fn call_in(s: &Statement, is_one: &dyn Fn(&str) -> bool) -> Option<PyExpr> {
    let of = |e: &PyExpr| first_call(e, is_one).cloned();
    match s {
        Statement::Assign(_, e) | Statement::Return(Some(e), _) | Statement::For(_, e, _, _) => of(e),
        Statement::If(tests, _) => tests.iter().find_map(|(test, _)| of(test)),
        Statement::Produce(modules, _) => modules.iter().flat_map(|m| &m.args).find_map(of),
        _ => None,
    }
}

/// A statement with an expression in place of a call that [`call_in`] has found.
pub(super) fn without_call(s: &Statement, call: &PyExpr, by: &PyExpr) -> Statement {
    let read = |e: &PyExpr| exchanged(e, call, by);
    match s {
        Statement::Assign(name, e) => Statement::Assign(name.clone(), read(e)),
        Statement::Return(Some(e), place) => Statement::Return(Some(read(e)), place.clone()),
        Statement::For(name, e, body, place) => Statement::For(name.clone(), read(e), body.clone(), place.clone()),
        Statement::If(tests, other) => {
            Statement::If(tests.iter().map(|(test, then)| (read(test), then.clone())).collect(), other.clone())
        }
        Statement::Produce(modules, ends) => {
            let with = |m: &PyModule| PyModule { args: m.args.iter().map(read).collect(), ..m.clone() };
            Statement::Produce(modules.iter().map(with).collect(), *ends)
        }
        other => other.clone(),
    }
}

/// Names that statements assign, and those that they declare `global`.
pub(super) fn assigned(statements: &[Statement], names: &mut Vec<String>, globals: &mut Vec<String>) {
    for s in statements {
        match s {
            Statement::Assign(name, _) => names.push(name.clone()),
            Statement::Global(list) => globals.extend(list.iter().cloned()),
            Statement::If(tests, other) => {
                tests.iter().for_each(|(_, then)| assigned(then, names, globals));
                assigned(other, names, globals);
            }
            Statement::For(name, _, body, _) => {
                names.push(name.clone());
                assigned(body, names, globals);
            }
            Statement::While(_, body, ..) => assigned(body, names, globals),
            _ => {}
        }
    }
}

/// Upper limit on the statements that are followed through one function.
const MAX_STATEMENTS: usize = 4_096;

/// Value of an expression that is a number whatever the variables `names` of its function are.
fn known_value(e: &PyExpr, names: &[String]) -> Option<f64> {
    let scope = Scope { locals: names.to_vec(), has_none: true, ..Scope::default() };
    crate::vm::constant_value(&compile(e, &scope).ok()?).filter(|v| !v.is_nan())
}

/// The value of a function of assignments, `if`, `for` and `return` as one expression.
pub(super) struct FunctionValue<'m> {
    pub scope: &'m Scope,
    pub place: Range<usize>,
    /// Statements that were looked at.
    pub count: usize,
}

impl FunctionValue<'_> {
    /// `statements` with the next one last; `names` and `values` are the variables so far.
    pub fn of(
        &mut self,
        mut statements: Vec<Statement>,
        mut names: Vec<String>,
        mut values: Vec<PyExpr>,
        depth: usize,
    ) -> Result<PyExpr, Refusal> {
        while let Some(statement) = statements.pop() {
            self.count += 1;
            if self.count > MAX_STATEMENTS || depth > MAX_NESTING {
                return Err(Refusal::new("a function that is too long", self.place.clone()));
            }
            match statement {
                Statement::Pass => {}
                Statement::Assign(_, e) if is_change(&e) => {
                    return Err(Refusal::new("a list that changes in a function with a value", self.place.clone()));
                }
                Statement::Assign(name, e) => {
                    let value = self.value(&e, &names, &values)?;
                    if has_random(&value, self.scope) {
                        return Err(Refusal::new("a random number in a variable of a function", self.place.clone()));
                    }
                    if let Some(i) = names.iter().position(|n| *n == name) {
                        values[i] = value;
                    } else {
                        names.push(name);
                        values.push(value);
                    }
                }
                // Each branch is followed to the end of the function with the statements behind the `if`; the tests choose between the
                // values. Tests of numbers alone, such as those of the variable of a loop, leave one branch.
                Statement::If(tests, mut other) => {
                    let mut undecided = Vec::new();
                    for (test, then) in tests {
                        let test = self.value(&test, &names, &values)?;
                        match known_value(&test, &names) {
                            Some(value) if is_zero(value) => {}
                            Some(_) => {
                                other = then;
                                break;
                            }
                            None => undecided.push((test, then)),
                        }
                    }
                    if undecided.is_empty() {
                        statements.extend(other.into_iter().rev());
                        continue;
                    }
                    let with = |body: Vec<Statement>| {
                        let mut all = statements.clone();
                        all.extend(body.into_iter().rev());
                        all
                    };
                    let mut out = self.of(with(other), names.clone(), values.clone(), depth + 1)?;
                    for (test, then) in undecided.into_iter().rev() {
                        let then = self.of(with(then), names.clone(), values.clone(), depth + 1)?;
                        out = PyExpr::Choice(Box::new(test), Box::new(then), Box::new(out));
                    }
                    return Ok(out);
                }
                Statement::For(name, list, body, _) => {
                    let list = self.value(&list, &names, &values)?;
                    let PyExpr::List(items, _) = resolve(&list, self.scope, 0)? else {
                        return Err(Refusal::new("'for' over something other than a list", self.place.clone()));
                    };
                    if items.len().saturating_mul(body.len() + 1) > MAX_STATEMENTS {
                        return Err(Refusal::new("'for' with too many turns", self.place.clone()));
                    }
                    // The loop is unrolled: statements are a stack, so that the last turn is pushed first.
                    for item in items.into_iter().rev() {
                        statements.extend(body.iter().rev().cloned());
                        statements.push(Statement::Assign(name.clone(), item));
                    }
                }
                Statement::Return(Some(e), _) => return self.value(&e, &names, &values),
                Statement::Return(None, place) => return Err(Refusal::new("a function without a value", place)),
                // Each test must be known, as in a loop that counts: the turns are written out.
                Statement::While(test, body, place, turn) => {
                    let now = self.value(&test, &names, &values)?;
                    let known = known_value(&now, &names);
                    let known =
                        known.ok_or_else(|| Refusal::new("'while' in a function with a value", place.clone()))?;
                    if !is_zero(known) {
                        statements.push(Statement::While(test, body.clone(), place, turn + 1));
                        statements.extend(body.into_iter().rev());
                    }
                }
                Statement::Break(place) | Statement::Continue(place) => {
                    return Err(Refusal::new("'break' or 'continue' in a function with a value", place));
                }
                Statement::TurnEnd | Statement::LoopEnd | Statement::FunctionEnd(..) => {}
                Statement::Global(_) | Statement::Produce(..) => {
                    return Err(Refusal::new("a function that changes the model", self.place.clone()));
                }
            }
        }
        Err(Refusal::new("a function without a value", self.place.clone()))
    }

    fn value(&self, e: &PyExpr, names: &[String], values: &[PyExpr]) -> Result<PyExpr, Refusal> {
        if size_with(e, names, values) > MAX_STATEMENTS {
            return Err(Refusal::new("an expression that grows too large", self.place.clone()));
        }
        Ok(substitute(e, names, values))
    }
}
