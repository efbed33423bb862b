//! Reads the statements of a block.

use std::ops::Range;

use osier_base::convert::saturating_index;

use super::Model;
use super::assignment::{assign_statement, item_of};
use super::changed_lists::is_changing_name;
use super::dictionary::keys_of;
use super::emit::tested;
use super::expression::{METHOD, PyExpr, PyOp, is_dictionary, is_written_out, substitute};
use super::functions::own_lambda;
use super::lines::{Line, block_after};
use super::parser::parse;
use super::pieces::{block_colon, closing, heads_block, inside, is_name, split, statements_of_line};
use super::refusal::{Refusal, indented_refusal, remedy_of};
use super::resolve::resolve;
use super::scope::{Scope, with_functions};
use super::statement::{MAX_NESTING, Statement, assigned, noting_breaks, replaced, stores};
use super::strings::{PyModule, listed_modules, modules};
use crate::code::is_zero;
use crate::dialect::text::Piece;

/// The argument of a call that makes a string of modules: `'F'` of `(makestring('F'))`; `None` for other texts.
fn string_text(piece: Piece<'_>) -> Option<Piece<'_>> {
    let inner = piece.trimmed();
    let inner = inner.text.strip_prefix('(').and_then(|t| t.strip_suffix(')')).map(|t| Piece::new(inner.at + 1, t))?;
    let call = inner.trimmed();
    let name = ["makestring", "Lstring", "AxialTree"].into_iter().find(|name| call.text.starts_with(name))?;
    let args = call.from(name.len()).trimmed();
    args.text.strip_prefix('(').and_then(|t| t.strip_suffix(')')).map(|t| Piece::new(args.at + 1, t).trimmed())
}

/// The names in `x, y` or `(x, y)`.
fn parts_of(targets: Piece<'_>) -> Vec<Piece<'_>> {
    split(inside(targets).unwrap_or(targets))
}

/// The item `list[index]`; for `zip(list, other)` the pair of both items.
fn item_at(list: &PyExpr, index: &PyExpr, place: &Range<usize>) -> PyExpr {
    match list {
        PyExpr::Call(function, lists, _) if function == "zip" => {
            PyExpr::List(lists.iter().map(|l| item_at(l, index, place)).collect(), place.clone())
        }
        _ => PyExpr::Index(Box::new(list.clone()), Box::new(index.clone()), place.clone()),
    }
}

/// The length `len(list)`; for `zip(list, other)` the smaller length.
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

impl Model<'_, '_> {
    /// Reads the lines of a production or a function. Functions defined in it are inlined where it calls them.
    pub(super) fn statements(&mut self, block: &[Line<'_>]) -> Result<Vec<Statement>, Refusal> {
        let around = std::mem::take(&mut self.own_functions);
        let list = self.block(block, 0);
        let own = std::mem::replace(&mut self.own_functions, around);
        let list = list?;
        let list = self.with_stores(list)?;
        if own.is_empty() {
            return Ok(list);
        }
        Ok(list.iter().map(|s| s.mapped(&String::clone, &|e| with_functions(e, &own, &self.scope))).collect())
    }

    /// Reads the lines of a block, with the blocks nested in it. Fails if blocks are nested too deep.
    pub(super) fn block(&mut self, block: &[Line<'_>], nesting: usize) -> Result<Vec<Statement>, Refusal> {
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
            // Find the lines with a deeper indentation, and the line at which this block continues.
            let (inner, next) = block_after(block, i, line.indent);
            let (word, rest) = piece.first_word(&['(', ':', '=', '[']);
            // A block may be on the same line as its heading.
            let body = |model: &mut Self, after: Piece<'_>| {
                let after = after.trimmed();
                if after.text.is_empty() {
                    model.block(inner, nesting + 1)
                } else {
                    model.block(&[Line { indent: 0, piece: after }], nesting + 1)
                }
            };
            let start = i;
            i = next;
            let is_produce = matches!(word.text, "produce" | "nproduce");
            if let Some(inner) = inner.first().filter(|_| !is_produce && !heads_block(word.text)) {
                return Err(indented_refusal(inner.piece));
            }
            match word.text {
                // The modules may continue on indented lines.
                _ if is_produce => {
                    let modules = self.modules_of(rest, inner)?;
                    out.push(Statement::Produce(modules, word.text == "produce"));
                }
                // These statements do not affect the string of modules.
                "pass" | "print" | "assert" => out.push(Statement::Pass),
                // A string alone is the docstring of a function.
                _ if piece.text.starts_with(['"', '\'']) => {}
                "global" => out.push(Statement::Global(split(rest).iter().map(|n| n.text.to_owned()).collect())),
                "return" if rest.text.is_empty() || rest.text == "None" => {
                    out.push(Statement::Return(None, piece.range()));
                }
                // `return x, y` returns a list.
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
                    // The previous statement must be an `if`: Python allows nothing between the two.
                    } else if let Some(Statement::If(tests, _)) = out.last_mut() {
                        tests.push((test, then));
                    } else {
                        return Err(Refusal::new("'elif' without 'if'", piece.range()));
                    }
                }
                "else" => {
                    let c = block_colon(rest).ok_or_else(|| Refusal::new("'else' without ':'", piece.range()))?;
                    let other = body(self, rest.from(c + 1))?;
                    // The previous statement must be an `if`, as for `elif`, or a loop.
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
                    // The `else` block of a loop runs unless a `break` ended the loop.
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
                "sproduce" | "nsproduce" => {
                    let modules = self.made_string(rest)?;
                    let modules = modules.ok_or_else(|| {
                        let why = Refusal::new(
                            format!("'{}' of something other than a list of modules", word.text),
                            piece.range(),
                        );
                        why.remedy(
                            "write the modules into it, nsproduce([F(1), Left(30)]) or makestring('F(1)+(30)'), or behind \
                             'nproduce'",
                        )
                    })?;
                    let modules = modules.into_iter().map(|m| self.in_declared_order(m)).collect::<Result<_, _>>()?;
                    out.push(Statement::Produce(modules, word.text == "sproduce"));
                }
                "del" if rest.text.contains('[') => out.extend(assign_statement(piece)?),
                "try" => {
                    let c = block_colon(rest).ok_or_else(|| Refusal::new("'try' without ':'", piece.range()))?;
                    let own = body(self, rest.from(c + 1))?;
                    let (statements, end) = self.attempt(block, start, own, nesting)?;
                    out.extend(statements);
                    i = end;
                }
                "except" | "finally" => {
                    return Err(Refusal::new(format!("'{}' without 'try'", word.text), piece.range()));
                }
                "with" | "class" | "raise" | "del" | "lambda" => {
                    let why = Refusal::new(format!("'{}' in a production", word.text), piece.range());
                    return Err(Refusal { remedy: remedy_of(word.text), ..why });
                }
                _ => match own_lambda(piece) {
                    Some((name, function)) if nesting == 0 => self.add_own_function(name, function)?,
                    _ => match self.run_of(word, rest, piece)? {
                        Some(call) => out.push(Statement::Run(call)),
                        None => out.extend(assign_statement(piece)?),
                    },
                },
            }
        }
        Ok(out)
    }

    /// The modules in the argument of `nsproduce`: a list, or `makestring('F(1)')` with a string of the model; `None` for
    /// other arguments.
    fn made_string(&self, piece: Piece<'_>) -> Result<Option<Vec<PyModule>>, Refusal> {
        let made = string_text(piece);
        let Some(inner) = made else { return listed_modules(piece, &self.declared) };
        // A name may refer to a string constant of the model.
        let source = if is_name(inner.text) { self.texts.get(inner.text).cloned() } else { None };
        let text = source.unwrap_or_else(|| inner.range());
        let Some(text) = self.quoted(text) else {
            let why = Refusal::new("a string of modules made from something other than a text", inner.range());
            return Err(why.remedy("write the text out, makestring('F(1)[+F(1)]'), or the modules behind 'nproduce'"));
        };
        modules(Piece::new(text.0, text.1), &self.declared).map(Some)
    }

    /// The call of a function of the model, if that is the whole line; else `None`.
    fn run_of(&self, word: Piece<'_>, rest: Piece<'_>, piece: Piece<'_>) -> Result<Option<PyExpr>, Refusal> {
        let is_call = rest.text.strip_prefix('(').is_some_and(|t| closing(t).is_some_and(|end| end + 1 == t.len()));
        // `p.grow(2)`
        let method = word.text.split_once('.').map(|(_, method)| format!("{METHOD}{method}"));
        if !is_call || !self.defined.contains(method.as_deref().unwrap_or(word.text)) {
            return Ok(None);
        }
        parse(piece).map(Some)
    }

    /// Reads the test of a statement or of a production.
    pub(super) fn test(&self, piece: Piece<'_>) -> Result<PyExpr, Refusal> {
        let test = parse(piece)?;
        Ok(if self.scope.has_none { tested(test) } else { test })
    }

    /// Reads a `for` loop: `i in range(a, b, step)`, `x, y in list`, `i, x in enumerate(list)`, `x, y in zip(list, other)`.
    fn loop_over(
        &mut self,
        head: Piece<'_>,
        mut body: Vec<Statement>,
        place: Range<usize>,
    ) -> Result<Statement, Refusal> {
        let refused = || Refusal::new("'for' over something other than range(..)", head.range());
        // Split the heading at `in` into targets and list.
        let (name, rest) = head.first_word(&[]);
        let (word, list) = rest.first_word(&[]);
        let (targets, list) = if word.text == "in" {
            (name, list)
        } else {
            let at = head.text.find(" in ").ok_or_else(refused)?;
            (head.up_to(at).trimmed(), head.from(at + " in ".len()))
        };
        let list = parse(list.trimmed()).map_err(|_| refused())?;
        // `enumerate` sets its first target to the number of the iteration, counted from an optional start.
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
        // A loop over a dictionary is a loop over its keys.
        let list = match resolve(&list, &self.scope, 0) {
            Ok(e) if is_dictionary(&e) => keys_of(list),
            Err(_) if self.is_changing_dictionary(&list) => keys_of(list),
            _ => list,
        };
        // Variable for the number of the iteration, with a name that no model can contain.
        let count = format!("(each {})", head.at);
        let index = PyExpr::Name(count.clone(), head.range());
        let is_list = |e: &PyExpr, scope: &Scope| {
            let first = substitute(e, std::slice::from_ref(&count), &[PyExpr::Number(0.0)]);
            matches!(resolve(&first, scope, 0), Ok(PyExpr::List(..)))
        };
        // A single target whose values are numbers needs no assignment: the loop itself sets it.
        if number.is_none()
            && parts_of(target).len() == 1
            && !is_list(&item_at(&list, &index, &head.range()), &self.scope)
            && !is_changing_name(&list, &self.scope)
        {
            return Ok(Statement::For(target.text.to_owned(), list, body, place));
        }
        // Otherwise loop over the number of the iteration, and assign the items to the targets at the beginning of each iteration.
        let list = self.named_list(list, &mut format!("(list {})", head.at));
        let turns = PyExpr::Call("range".to_owned(), vec![length_of(&list, head.range())], head.range());
        let mut turn = Vec::new();
        if let Some((number, from)) = number {
            let is_plain = matches!(from, PyExpr::Number(n) if is_zero(n));
            let sum = || PyExpr::Binary(PyOp::Add, Box::new(from.clone()), Box::new(index.clone()));
            let count = if is_plain { index.clone() } else { sum() };
            turn.push(Statement::Assign(number.text.to_owned(), count));
        }
        // Stack of nested targets with their values.
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
            if is_list(&value, &self.scope) || (is_changing_name(&list, &self.scope) && !stores(&body)) {
                // A list cannot be the value of a variable: replace the name by the list wherever it is read.
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

    /// Gives a list constant a name, so that the iterations of a loop do not copy it.
    pub(super) fn named_list(&mut self, list: PyExpr, name: &mut String) -> PyExpr {
        match list {
            PyExpr::Call(function, lists, place) if function == "zip" => {
                let lists = lists.into_iter().map(|l| self.named_list(l, name)).collect();
                PyExpr::Call(function, lists, place)
            }
            PyExpr::List(items, place) if items.iter().all(is_written_out) => {
                // Lengthen the name until it is unused.
                name.push('+');
                self.scope.lists.insert(name.clone(), PyExpr::List(items, place.clone()));
                PyExpr::Name(name.clone(), place)
            }
            other => other,
        }
    }
}
