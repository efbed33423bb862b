//! `try` with `except`. The compiled code raises no errors. Instead, a test before each statement that may fail decides whether
//! it would fail, and then the block of the `except` runs.

use std::cell::Cell;
use std::ops::Range;

use super::Model;
use super::expression::{DICTIONARY, IN, ListChange, PyExpr, PyOp, SLICE, is_dictionary, range_of, substitute};
use super::lines::{Line, block_after};
use super::pieces::{block_colon, inside, split};
use super::refusal::Refusal;
use super::resolve::resolve;
use super::scope::has_random;
use super::statement::{MAX_NESTING, Statement};
use crate::code::is_zero;
use crate::dialect::text::Piece;

/// Largest nesting of function calls that is searched for errors.
const MAX_FUNCTIONS: usize = 8;

/// Largest number of statements to which a `try` is expanded.
const MAX_STATEMENTS: usize = 4_096;

/// The errors that an `except` catches, among those that numbers and lists can raise.
#[derive(Debug, Clone, Copy, Default)]
struct Errors {
    /// A division by zero.
    division: bool,
    /// An index outside of its list.
    index: bool,
    /// A key that its dictionary does not have.
    key: bool,
    /// A number for which a function has no value: `sqrt(-1)`.
    value: bool,
}

/// An `except` with its block.
struct Handler {
    errors: Errors,
    body: Vec<Statement>,
}

/// The blocks of a `try`.
#[derive(Default)]
struct Attempt {
    handlers: Vec<Handler>,
    /// The block of `else`, which runs if nothing has failed.
    otherwise: Vec<Statement>,
    /// The block of `finally`.
    last: Vec<Statement>,
    /// Number of statements written so far; the statements after an `if` are copied into each of its branches.
    count: Cell<usize>,
}

fn either(a: Option<PyExpr>, b: Option<PyExpr>) -> Option<PyExpr> {
    match (a, b) {
        (Some(a), Some(b)) => Some(PyExpr::Or(Box::new(a), Box::new(b))),
        (a, b) => a.or(b),
    }
}

fn compared(op: PyOp, a: &PyExpr, b: PyExpr) -> PyExpr {
    PyExpr::Binary(op, Box::new(a.clone()), Box::new(b))
}

/// True if the statements contain a `return`, `produce`, `break` or `continue`, so that the statements after the block may not
/// run.
fn leaves(statements: &[Statement]) -> bool {
    statements.iter().any(|s| match s {
        Statement::Return(..) | Statement::Produce(_, true) | Statement::Break(_) | Statement::Continue(_) => true,
        Statement::If(tests, other) => tests.iter().any(|(_, then)| leaves(then)) || leaves(other),
        Statement::For(_, _, body, _) | Statement::While(_, body, ..) => leaves(body),
        _ => false,
    })
}

/// The errors named by the words of an `except`, `ZeroDivisionError` or `(IndexError, KeyError)`; without words all of them.
fn errors_of(words: Piece<'_>) -> Result<Errors, Refusal> {
    let all = Errors { division: true, index: true, key: true, value: true };
    let named = words.text.find(" as ").map_or(words, |i| words.up_to(i).trimmed());
    if named.text.is_empty() {
        return Ok(all);
    }
    let mut out = Errors::default();
    for word in split(inside(named).unwrap_or(named)) {
        match word.text {
            "Exception" | "BaseException" | "StandardError" => return Ok(all),
            "ArithmeticError" | "ZeroDivisionError" => out.division = true,
            "LookupError" => (out.index, out.key) = (true, true),
            "IndexError" => out.index = true,
            "KeyError" => out.key = true,
            "ValueError" => out.value = true,
            // These errors never occur here: imports cannot fail, assertions are skipped, and a model is never interrupted.
            "ImportError" | "ModuleNotFoundError" | "KeyboardInterrupt" | "AssertionError" => {}
            _ => {
                let why = Refusal::new(format!("'except {}'", word.text), word.range());
                return Err(why.remedy(
                    "osier knows ZeroDivisionError, IndexError, KeyError and ValueError: test the value with 'if' before its use",
                ));
            }
        }
    }
    Ok(out)
}

impl Model<'_, '_> {
    /// The statements of the `try` at line `i` of a block, and the index of the line after its last block. `body`: statements of
    /// the `try` block itself.
    pub(super) fn attempt(
        &mut self,
        block: &[Line<'_>],
        i: usize,
        body: Vec<Statement>,
        nesting: usize,
    ) -> Result<(Vec<Statement>, usize), Refusal> {
        let Some(line) = block.get(i) else { return Ok((body, i + 1)) };
        let refused = |what: &str, place: Range<usize>| Err(Refusal::new(what, place));
        // The blocks that follow at the indent of `try`: handlers, `else` and `finally`.
        let mut next = block_after(block, i, line.indent).1;
        let mut parts = Attempt::default();
        while let Some(more) = block.get(next).filter(|more| more.indent == line.indent) {
            let (word, rest) = more.piece.first_word(&[':', '(']);
            if !matches!(word.text, "except" | "else" | "finally") {
                break;
            }
            let Some(c) = block_colon(rest) else { return refused("'except' without ':'", more.piece.range()) };
            let (lines, end) = block_after(block, next, line.indent);
            let after = rest.from(c + 1).trimmed();
            let inline = [Line { indent: 0, piece: after }];
            let own = self.block(if after.text.is_empty() { lines } else { &inline }, nesting + 1)?;
            match word.text {
                "except" => parts.handlers.push(Handler { errors: errors_of(rest.up_to(c).trimmed())?, body: own }),
                "else" => parts.otherwise = own,
                _ => parts.last = own,
            }
            next = end;
        }
        if parts.handlers.is_empty() && next == block_after(block, i, line.indent).1 {
            return refused("'try' without 'except'", line.piece.range());
        }
        let last = std::mem::take(&mut parts.last);
        let mut out = self.guarded(body, &parts, line.piece.range(), 0)?;
        if !last.is_empty() && leaves(&out) {
            let why = Refusal::new("'finally' behind statements that leave the block", line.piece.range());
            return Err(why.remedy("write its statements before each 'return' and 'produce'"));
        }
        out.extend(last);
        Ok((out, next))
    }

    /// Statements of a `try` block, with a test before each that may fail. The statements after it run only if it does not fail.
    fn guarded(
        &self,
        statements: Vec<Statement>,
        parts: &Attempt,
        place: Range<usize>,
        depth: usize,
    ) -> Result<Vec<Statement>, Refusal> {
        parts.count.set(parts.count.get() + statements.len());
        if depth > MAX_NESTING || parts.count.get() > MAX_STATEMENTS {
            return Err(Refusal::new("a 'try' of too many statements that may fail", place));
        }
        let mut out = Vec::new();
        let mut rest = statements.into_iter();
        while let Some(s) = rest.next() {
            let failure = self.failure_of(&s, parts, &place)?;
            let is_split = matches!(&s, Statement::If(tests, other)
                if self.may_fail(other, parts, &place)? || self.any_fails(tests, parts, &place)?);
            if failure.is_none() && !is_split {
                if matches!(s, Statement::For(..) | Statement::While(..)) && self.any_within(&s, parts, &place)? {
                    let why = Refusal::new("a loop in 'try' whose statements may fail", place);
                    return Err(why.remedy("write the 'try' into the loop, or test the values with 'if'"));
                }
                out.push(s);
                continue;
            }
            let left: Vec<Statement> = rest.collect();
            let then = match s {
                // The statements after the `if` are appended to each branch, where they run if nothing has failed before.
                Statement::If(tests, other) if is_split => {
                    let side = |list: Vec<Statement>| {
                        let all = list.into_iter().chain(left.iter().cloned()).collect();
                        self.guarded(all, parts, place.clone(), depth + 1)
                    };
                    let tests = tests.into_iter().map(|(test, then)| Ok((test, side(then)?)));
                    let tests = tests.collect::<Result<Vec<_>, Refusal>>()?;
                    vec![Statement::If(tests, side(other)?)]
                }
                s => {
                    let mut then = vec![s];
                    then.extend(self.guarded(left, parts, place, depth + 1)?);
                    then
                }
            };
            match failure {
                Some((test, handler)) => out.push(Statement::If(vec![(test, handler)], then)),
                None => out.extend(then),
            }
            return Ok(out);
        }
        out.extend(parts.otherwise.iter().cloned());
        Ok(out)
    }

    fn may_fail(&self, list: &[Statement], parts: &Attempt, place: &Range<usize>) -> Result<bool, Refusal> {
        for s in list {
            if self.failure_of(s, parts, place)?.is_some() || self.any_within(s, parts, place)? {
                return Ok(true);
            }
        }
        Ok(false)
    }

    fn any_fails(
        &self,
        tests: &[(PyExpr, Vec<Statement>)],
        parts: &Attempt,
        place: &Range<usize>,
    ) -> Result<bool, Refusal> {
        for (_, then) in tests {
            if self.may_fail(then, parts, place)? {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// True if a statement in a block within `s` may fail.
    fn any_within(&self, s: &Statement, parts: &Attempt, place: &Range<usize>) -> Result<bool, Refusal> {
        match s {
            Statement::If(tests, other) => {
                Ok(self.any_fails(tests, parts, place)? || self.may_fail(other, parts, place)?)
            }
            Statement::For(_, _, body, _) | Statement::While(_, body, ..) => self.may_fail(body, parts, place),
            _ => Ok(false),
        }
    }

    /// The test that is true if a statement fails, and the block of the `except` for it; `None` if it cannot fail.
    fn failure_of(
        &self,
        s: &Statement,
        parts: &Attempt,
        place: &Range<usize>,
    ) -> Result<Option<(PyExpr, Vec<Statement>)>, Refusal> {
        let read: Vec<&PyExpr> = match s {
            Statement::Assign(_, e) | Statement::Run(e) | Statement::Return(Some(e), _) | Statement::For(_, e, ..) => {
                vec![e]
            }
            Statement::While(test, ..) => vec![test],
            Statement::If(tests, _) => tests.iter().map(|(test, _)| test).collect(),
            Statement::Produce(modules, _) => modules.iter().flat_map(|m| &m.args).collect(),
            _ => Vec::new(),
        };
        let mut out: Option<(PyExpr, Vec<Statement>)> = None;
        for handler in &parts.handlers {
            let mut test = None;
            for e in &read {
                test = either(test, self.failure(e, handler.errors, 0)?);
            }
            let Some(test) = test else { continue };
            if has_random(&test, &self.scope) {
                let why = Refusal::new("a random number in what a 'try' tests", place.clone());
                return Err(why.remedy("assign it to a variable before the 'try'"));
            }
            if matches!(s, Statement::While(..)) {
                return Err(Refusal::new("a 'while' in 'try' whose test may fail", place.clone()));
            }
            if out.is_some() {
                let why = Refusal::new("a statement in 'try' that may fail in two ways", place.clone());
                return Err(why.remedy("write its parts on lines of their own"));
            }
            out = Some((test, handler.body.clone()));
        }
        Ok(out)
    }

    /// The test that is true if an expression raises one of these errors; `None` if it cannot.
    fn failure(&self, e: &PyExpr, errors: Errors, depth: usize) -> Result<Option<PyExpr>, Refusal> {
        let of = |e: &PyExpr| self.failure(e, errors, depth);
        let zero = || PyExpr::Number(0.0);
        // A part that is evaluated only if a test holds can fail only if the test holds.
        let where_true = |test: &PyExpr, fails: Option<PyExpr>| {
            fails.map(|fails| PyExpr::Choice(Box::new(test.clone()), Box::new(fails), Box::new(zero())))
        };
        let where_false = |test: &PyExpr, fails: Option<PyExpr>| {
            fails.map(|fails| PyExpr::Choice(Box::new(test.clone()), Box::new(zero()), Box::new(fails)))
        };
        let all = |list: &[PyExpr]| -> Result<Option<PyExpr>, Refusal> {
            let mut out = None;
            for e in list {
                out = either(out, of(e)?);
            }
            Ok(out)
        };
        Ok(match e {
            PyExpr::Number(_) | PyExpr::Text(..) | PyExpr::Name(..) => None,
            PyExpr::Neg(a) | PyExpr::Not(a) => of(a)?,
            PyExpr::Binary(op, a, b) => {
                let own = match (op, &**b) {
                    _ if !errors.division => None,
                    (PyOp::Div | PyOp::FloorDiv | PyOp::Mod, PyExpr::Number(n)) if !is_zero(*n) => None,
                    (PyOp::Div | PyOp::FloorDiv | PyOp::Mod, b) => Some(compared(PyOp::Eq, b, zero())),
                    (PyOp::Pow, PyExpr::Number(n)) if *n >= 0.0 => None,
                    (PyOp::Pow, b) => {
                        let (is_zero, is_below) = (compared(PyOp::Eq, a, zero()), compared(PyOp::Lt, b, zero()));
                        Some(PyExpr::And(Box::new(is_zero), Box::new(is_below)))
                    }
                    _ => None,
                };
                either(either(of(a)?, of(b)?), own)
            }
            PyExpr::And(a, b) => either(of(a)?, where_true(a, of(b)?)),
            PyExpr::Or(a, b) => either(of(a)?, where_false(a, of(b)?)),
            PyExpr::Choice(test, a, b) => {
                either(of(test)?, either(where_true(test, of(a)?), where_false(test, of(b)?)))
            }
            PyExpr::Call(name, args, range) => {
                either(all(args)?, self.failure_of_call(name, args, range, errors, depth)?)
            }
            PyExpr::List(items, _) => all(items)?,
            PyExpr::Each(value, _, list, range) => {
                if of(value)?.is_some() {
                    let why = Refusal::new("a list in 'try' whose items may fail", range.clone());
                    return Err(why.remedy("test the values with 'if' in the list: [a/b for b in q if b != 0]"));
                }
                of(list)?
            }
            PyExpr::Index(list, index, _) => {
                either(either(of(list)?, of(index)?), self.failure_of_index(list, index, errors)?)
            }
            PyExpr::Change(change, args, _) => {
                let own = match (change, args.as_slice()) {
                    (ListChange::Set, [list, index, _]) if !matches!(index, PyExpr::Call(..)) && errors.index => {
                        let is_known = resolve(list, &self.scope, 0).is_ok_and(|e| is_dictionary(&e));
                        if is_known { None } else { self.failure_of_index(list, index, errors)? }
                    }
                    (ListChange::Pop, [list, index]) => self.failure_of_index(list, index, errors)?,
                    (ListChange::Pop, [list]) => self.failure_of_index(list, &PyExpr::Number(-1.0), errors)?,
                    _ => None,
                };
                either(all(args)?, own)
            }
        })
    }

    /// As [`Self::failure`], for a call whose arguments do not fail.
    fn failure_of_call(
        &self,
        name: &str,
        args: &[PyExpr],
        range: &Range<usize>,
        errors: Errors,
        depth: usize,
    ) -> Result<Option<PyExpr>, Refusal> {
        let zero = || PyExpr::Number(0.0);
        let of_value = |test: PyExpr| Ok(Some(test).filter(|_| errors.value));
        match (name, args) {
            ("sqrt", [a]) => return of_value(compared(PyOp::Lt, a, zero())),
            ("log" | "log10", [a, ..]) => return of_value(compared(PyOp::Le, a, zero())),
            ("asin" | "acos", [a]) => {
                let size = PyExpr::Call("abs".to_owned(), vec![a.clone()], range.clone());
                return of_value(compared(PyOp::Gt, &size, PyExpr::Number(1.0)));
            }
            ("divmod" | "fmod", [_, b]) if errors.division => return Ok(Some(compared(PyOp::Eq, b, zero()))),
            _ => {}
        }
        // Functions of the model may fail themselves.
        if let Some((params, value)) = self.scope.functions.get(name).filter(|(params, _)| params.len() == args.len())
            && depth < MAX_FUNCTIONS
        {
            return self.failure(&substitute(value, params, args), errors, depth + 1);
        }
        if self.defined.contains(name) || self.own_functions.contains_key(name) {
            let why = Refusal::new(format!("a call of '{name}' in 'try'"), range.clone());
            return Err(why.remedy("write the 'try' into the function, or the function as one expression"));
        }
        Ok(None)
    }

    /// The test that is true if a list or dictionary lacks an index or key.
    fn failure_of_index(&self, list: &PyExpr, index: &PyExpr, errors: Errors) -> Result<Option<PyExpr>, Refusal> {
        let is_slice = matches!(index, PyExpr::Call(name, ..) if name == SLICE);
        if is_slice || (!errors.index && !errors.key) {
            return Ok(None);
        }
        let known = resolve(list, &self.scope, 0).ok();
        let is_dictionary = match &known {
            Some(PyExpr::Call(name, ..)) => name == DICTIONARY,
            Some(_) => false,
            None if errors.index != errors.key => errors.key,
            None => {
                let why =
                    Refusal::new("an item in 'try' of a value that may be a list or a dictionary", range_of(list));
                return Err(why.remedy("name the error: 'except IndexError' or 'except KeyError'"));
            }
        };
        // A vector has all its coordinates.
        if matches!(&known, Some(PyExpr::Call(name, ..)) if name != DICTIONARY) {
            return Ok(None);
        }
        if is_dictionary {
            let has = PyExpr::Call(IN.to_owned(), vec![index.clone(), list.clone()], range_of(list));
            return Ok(Some(PyExpr::Not(Box::new(has))).filter(|_| errors.key));
        }
        let length = PyExpr::Call("len".to_owned(), vec![list.clone()], range_of(list));
        let below = compared(PyOp::Lt, index, PyExpr::Neg(Box::new(length.clone())));
        let above = compared(PyOp::Ge, index, length);
        Ok(either(Some(below), Some(above)).filter(|_| errors.index))
    }
}
