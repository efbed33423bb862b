//! Functions of the model and of productions, and their conversion to expressions.

use std::ops::Range;

use super::Model;
use super::changed_lists::reads_changing;
use super::expression::{PyExpr, first_call, is_change, is_written_out, of_model, size_with, substitute};
use super::lines::{Line, block_after};
use super::parser::{Lambda, lambda, parse};
use super::pieces::{FunctionHead, assignment, function_head, is_name};
use super::refusal::Refusal;
use super::resolve::{compile, resolve};
use super::scope::{OwnFunction, Scope, has_random, with_functions};
use super::statement::{MAX_NESTING, Statement, hindrance};
use crate::code::is_zero;
use crate::dialect::text::Piece;

/// Limit on the statements evaluated for one function.
const MAX_STATEMENTS: usize = 4_096;

/// Value of an expression that does not depend on the variables `names` of its function; `None` if it does.
fn known_value(e: &PyExpr, names: &[String]) -> Option<f64> {
    let scope = Scope { locals: names.to_vec(), has_none: true, ..Scope::default() };
    crate::vm::constant_value(&compile(e, &scope).ok()?).filter(|v| !v.is_nan())
}

/// Converts a function that consists of assignments, `if`, `for` and `return` to a single expression.
struct FunctionValue<'m> {
    pub scope: &'m Scope,
    pub place: Range<usize>,
    /// Number of statements processed.
    pub count: usize,
}

impl FunctionValue<'_> {
    /// Converts the statements of a function to its value. `statements`: a stack whose last entry comes next; `names` and
    /// `values`: the variables so far.
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
                // A variable is replaced by its expression wherever it is read, so that it must not draw a random number.
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
                // Follow each branch to the end of the function, including the statements after the `if`; the tests then
                // choose between the values. A constant test, such as one of a loop variable, leaves a single branch.
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
                    if reads_changing(&list, self.scope) {
                        return Err(Refusal::new("a loop over a list that changes", self.place.clone()));
                    }
                    let PyExpr::List(items, _) = resolve(&list, self.scope, 0)? else {
                        return Err(Refusal::new("'for' over something other than a list", self.place.clone()));
                    };
                    if items.len().saturating_mul(body.len() + 1) > MAX_STATEMENTS {
                        return Err(Refusal::new("'for' with too many turns", self.place.clone()));
                    }
                    // Unroll the loop. The statements are a stack, so that the last iteration is pushed first.
                    for item in items.into_iter().rev() {
                        statements.extend(body.iter().rev().cloned());
                        statements.push(Statement::Assign(name.clone(), item));
                    }
                }
                Statement::Return(Some(e), _) => return self.value(&e, &names, &values),
                Statement::Return(None, place) => return Err(Refusal::new("a function without a value", place)),
                // Unroll a loop whose tests are all constant, such as one that counts.
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
                Statement::Stop(_)
                | Statement::Global(_)
                | Statement::Produce(..)
                | Statement::Run(_)
                | Statement::Store(_) => {
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

/// Reads `name = lambda x: value`.
pub(super) fn own_lambda(piece: Piece<'_>) -> Option<(Piece<'_>, OwnFunction)> {
    let (name, value) = assignment(piece)?;
    let Lambda { params, defaults, value } = lambda(value).filter(|_| is_name(name.text))?;
    // Default values other than numbers and strings would be evaluated again by each call.
    let defaults = defaults.into_iter().map(|d| d.map(parse).transpose()).collect::<Result<Vec<_>, _>>().ok()?;
    if defaults.iter().flatten().any(|e| !is_written_out(e)) {
        return None;
    }
    Some((name, OwnFunction { params, defaults, value }))
}

impl Model<'_, '_> {
    /// Reads a `def`. A function that can be converted to one expression is stored as such, any other as its statements; one that
    /// cannot be read is refused where it is called.
    pub(super) fn function(&mut self, rest: Piece<'_>, block: &[Line<'_>], range: &Range<usize>) {
        let name = rest.text.split('(').next().unwrap_or("").trim().to_owned();
        self.function_named(name, rest, block, range);
    }

    /// As [`Self::function`], with another name than in the text.
    pub(super) fn function_named(&mut self, name: String, rest: Piece<'_>, block: &[Line<'_>], range: &Range<usize>) {
        // The body follows the colon on the same line, or is the block.
        let Some(FunctionHead { params, body }) = function_head(rest) else { return };
        let defaults: Vec<Option<PyExpr>> =
            params.iter().map(|(_, value)| value.and_then(|value| self.default_value(value))).collect();
        let params: Vec<String> = params.into_iter().map(|(name, _)| name).collect();
        let inline = [Line { indent: 0, piece: body }];
        let lines = if body.text.is_empty() { block } else { &inline };
        let statements = self.statements(lines);
        let value = statements.clone().and_then(|mut list| {
            list.reverse();
            let values = params.iter().map(|p| PyExpr::Name(p.clone(), range.clone())).collect();
            let mut function = FunctionValue { scope: &self.scope, place: range.clone(), count: 0 };
            function.of(list, params.clone(), values, 0)
        });
        // A function whose expression calls a function of statements counts as a function of statements itself.
        let value = value.ok().filter(|value| first_call(value, &|name| self.has_body(name)).is_none());
        match value {
            Some(value) => {
                self.bodies.remove(&name);
                self.scope.defaults.insert(name.clone(), defaults);
                let value = of_model(&value, &params, &self.shared);
                self.scope.functions.insert(name, (params, value));
            }
            // A production that calls a function of statements runs the statements. A call of an unreadable function is refused
            // there.
            None => {
                self.scope.functions.remove(&name);
                self.bodies.remove(&name);
                let why = match statements {
                    Ok(list) => match hindrance(&list) {
                        None => {
                            self.scope.defaults.insert(name.clone(), defaults);
                            self.bodies.insert(name, (params, list));
                            return;
                        }
                        Some(why) => why.to_owned(),
                    },
                    Err(why) => format!("line {}: {}", self.reader.line_number(why.range.start), why.construct),
                };
                self.scope.refused_functions.insert(name, why);
            }
        }
    }

    /// The default value of a parameter, which Python evaluates once, where the function is defined. `None` if it cannot be
    /// read, so that each call must give the argument.
    pub(super) fn default_value(&self, value: Piece<'_>) -> Option<PyExpr> {
        let value = parse(value).and_then(|e| resolve(&e, &self.scope, 0)).ok();
        value.filter(|e| !has_random(e, &self.scope))
    }

    /// True for the name of a function of statements, which is not a single expression.
    pub(super) fn has_body(&self, name: &str) -> bool {
        self.bodies.contains_key(name) && !self.scope.functions.contains_key(name)
    }

    /// Rereads the functions that call a function of statements defined after them; they now count as functions of statements
    /// themselves.
    pub(super) fn read_callers_again(&mut self, list: &[Line<'_>]) {
        let calls_body = |model: &Self, name: &str| {
            let value = model.scope.functions.get(name).map(|(_, value)| value);
            value.is_some_and(|value| first_call(value, &|called| model.has_body(called)).is_some())
        };
        loop {
            let caller = self.definitions.iter().find(|(name, _)| calls_body(self, name));
            let Some((name, i)) = caller.map(|(name, i)| (name.clone(), *i)) else { return };
            let Some(line) = list.get(i) else { return };
            let (block, _) = block_after(list, i, line.indent);
            let (_, rest) = line.piece.first_word(&['(', ':', '=']);
            // Default values are those at the definition of the function.
            let defaults = self.scope.defaults.get(&name).cloned().unwrap_or_default();
            self.scope.functions.remove(&name);
            self.function_named(name.clone(), rest, block, &line.piece.range());
            self.scope.defaults.insert(name, defaults);
        }
    }

    /// Reads a `def` inside a production or function; its value depends on its parameters and the variables around it.
    pub(super) fn own_function(
        &mut self,
        rest: Piece<'_>,
        block: &[Line<'_>],
        range: Range<usize>,
    ) -> Result<(), Refusal> {
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
        // Names other than its parameters may be variables of the production, whose values are not known here.
        let (functions, has_none) = (self.scope.functions.clone(), self.scope.has_none);
        let scope = Scope { functions, has_none, ..Scope::default() };
        let values = params.iter().map(|p| PyExpr::Name(p.clone(), range.clone())).collect();
        let mut function = FunctionValue { scope: &scope, place: range.clone(), count: 0 };
        let value = function.of(list, params.clone(), values, 0).map_err(|_| refused())?;
        let name = rest.text.split('(').next().unwrap_or("").trim();
        self.add_own_function(rest.up_to(name.len()), OwnFunction { params, defaults, value })
    }

    /// Adds a function of a production. All its calls refer to this definition, so that a second function of the same name is refused.
    pub(super) fn add_own_function(&mut self, name: Piece<'_>, function: OwnFunction) -> Result<(), Refusal> {
        if self.own_functions.insert(name.text.to_owned(), function).is_none() {
            return Ok(());
        }
        let why = Refusal::new(format!("a second function '{}' of a production", name.text), name.range());
        Err(why.remedy("give each function a name of its own"))
    }
}
