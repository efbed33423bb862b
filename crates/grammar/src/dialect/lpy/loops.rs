//! Loops on an execution path through a production: unrolled, or compiled to code.

use std::ops::Range;

use super::Model;
use super::execution_path::{ExecutionPath, MAX_STEPS, OpenPath, Step, on_path};
use super::expression::{PyExpr, PyOp, size_with, substitute};
use super::refusal::Refusal;
use super::resolve::{compile, resolve};
use super::scope::has_random;
use super::statement::{Statement, changes, in_turn, names_of, only_computes};
use crate::code::is_zero;
use crate::vm;

/// Limit on the iterations of a loop whose end is bounded, but not constant.
const MAX_COUNTED: f64 = 100.0;

/// Number of iterations that are unrolled for a loop whose end has no known bound.
const MAX_UNKNOWN: u32 = 64;

/// Limit on the unrolled iterations of a `while` with constant tests.
const MAX_KNOWN_TURNS: u32 = 2_000;

/// The argument `end` of `range(end)`.
fn range_end(list: &PyExpr) -> Option<PyExpr> {
    match list {
        PyExpr::Call(name, args, _) if name.ends_with("range") && args.len() == 1 => args.first().cloned(),
        _ => None,
    }
}

/// A loop over `range(from, end, step)`, converted to a loop over a range from 0.
struct CountedRange {
    /// Sets the variable of the range's beginning, which the iterations may read.
    begin: Statement,
    /// `range(turns)`.
    turns: PyExpr,
    /// Variable that counts the iterations.
    name: String,
    /// Value of the original loop variable in an iteration.
    value: PyExpr,
}

/// Refuses a loop with too many iterations to unroll.
fn check_turns(turns: usize, body: &[Statement], place: Range<usize>) -> Result<(), Refusal> {
    if turns.saturating_mul(body.len() + 1) > MAX_STEPS {
        return Err(Refusal::new("'for' with too many turns", place));
    }
    Ok(())
}

impl Model<'_, '_> {
    /// Unrolls a `for` loop, or converts it to a `while` loop.
    pub(super) fn for_loop(
        &mut self,
        name: String,
        list: &PyExpr,
        body: Vec<Statement>,
        place: Range<usize>,
        now: &mut OpenPath,
    ) -> Result<(), Refusal> {
        let why = match self.turns(&on_path(list, &now.path), &place) {
            Ok(turns) => {
                check_turns(turns.len(), &body, place)?;
                now.left.push(Statement::LoopEnd);
                for value in turns.iter().rev() {
                    now.left.push(Statement::TurnEnd);
                    now.left.extend(body.iter().rev().map(|s| in_turn(s, &name, *value)));
                    now.left.push(Statement::Assign(name.clone(), PyExpr::Number(*value)));
                }
                return Ok(());
            }
            Err(why) => why,
        };
        if let Some(list) = self.list_of(list, &now.path) {
            return self.loop_over_items(&name, &list, &body, place, now);
        }
        // Convert a `range(from, end, step)` whose values are not known to a loop that counts from 0.
        if let Some(counted) = self.counted(list, &now.path) {
            let mut turn = vec![Statement::Assign(name, counted.value)];
            turn.extend(body);
            now.left.push(Statement::For(counted.name, counted.turns, turn, place));
            now.left.push(counted.begin);
            return Ok(());
        }
        match range_end(list).filter(|_| only_computes(&body)) {
            Some(end) => self.loop_that_computes(name, end, body, place, now),
            None => {
                let (end, most) = self.last_turn(list, &now.path, &place).ok_or(why)?;
                self.bounded_loop(&name, end, most, &body, &place, now);
            }
        }
        Ok(())
    }

    /// Unrolls a loop over a list whose items are not constant, storing the items before the first iteration.
    fn loop_over_items(
        &mut self,
        name: &str,
        list: &PyExpr,
        body: &[Statement],
        place: Range<usize>,
        now: &mut OpenPath,
    ) -> Result<(), Refusal> {
        let mut taken = Vec::new();
        let (PyExpr::List(items, _) | PyExpr::Call(_, items, _)) = self.kept(list, &now.path, &mut taken) else {
            return Err(Refusal::new("'for' over something other than a list", place));
        };
        if changes(body, name) {
            let why = Refusal::new(format!("a change of '{name}', an item of a list"), place);
            return Err(why.remedy("make a copy under another name and change that one: p = list(q)"));
        }
        check_turns(items.len(), body, place)?;
        now.left.push(Statement::LoopEnd);
        for item in items.into_iter().rev() {
            now.left.push(Statement::TurnEnd);
            now.left.extend(body.iter().rev().cloned());
            now.left.push(Statement::Assign(name.to_owned(), item));
        }
        now.run_next(taken);
        Ok(())
    }

    /// Converts a loop over `range(end)` that only computes numbers to a `while` loop, which runs until its end at run time.
    fn loop_that_computes(
        &mut self,
        name: String,
        end: PyExpr,
        body: Vec<Statement>,
        place: Range<usize>,
        now: &mut OpenPath,
    ) {
        let [count, last] = ["turn", "end"].map(|word| format!("({word} {})", self.temporaries));
        self.temporaries += 1;
        let at = |n: &str| PyExpr::Name(n.to_owned(), place.clone());
        let test = PyExpr::Binary(PyOp::Lt, Box::new(at(&count)), Box::new(at(&last)));
        let next = PyExpr::Binary(PyOp::Add, Box::new(at(&count)), Box::new(PyExpr::Number(1.0)));
        // Count at the beginning, so that `continue` does not skip it.
        let mut turn = vec![Statement::Assign(name, at(&count)), Statement::Assign(count.clone(), next)];
        turn.extend(body);
        now.left.push(Statement::While(test, turn, place, 0));
        now.left.push(Statement::Assign(count, PyExpr::Number(0.0)));
        // Evaluate the end only once: the body may change variables in it, and it may draw a random number.
        now.left.push(Statement::Assign(last, end));
    }

    /// Unrolls a loop over `range(end)` to its largest number of iterations, each within the condition that the loop reaches it.
    fn bounded_loop(
        &mut self,
        name: &String,
        end: PyExpr,
        most: u32,
        body: &[Statement],
        place: &Range<usize>,
        now: &mut OpenPath,
    ) {
        let count = format!("(turns {})", self.temporaries);
        self.temporaries += 1;
        now.path.bounds.assign(&count, &end, &self.scope);
        now.path.steps.push(Step::Assign(count.clone(), end));
        let mut inner = Vec::new();
        for k in (0..most).rev() {
            let value = f64::from(k);
            let number = PyExpr::Number(value);
            let end = PyExpr::Name(count.clone(), place.clone());
            let test = PyExpr::Binary(PyOp::Lt, Box::new(number.clone()), Box::new(end));
            let mut turn = vec![Statement::Assign(name.clone(), number)];
            turn.extend(body.iter().map(|s| in_turn(s, name, value)));
            turn.push(Statement::TurnEnd);
            turn.append(&mut inner);
            inner = vec![Statement::If(vec![(test, turn)], Vec::new())];
        }
        now.left.push(Statement::LoopEnd);
        now.left.append(&mut inner);
    }

    /// The execution paths after the test of a `while` loop, in the order of trial. `turn`: number of iterations unrolled before.
    pub(super) fn while_loop(
        &mut self,
        test: PyExpr,
        body: Vec<Statement>,
        place: Range<usize>,
        turn: u32,
        mut now: OpenPath,
    ) -> Result<Vec<OpenPath>, Refusal> {
        if turn == 0 {
            now.left.push(Statement::LoopEnd);
        }
        let known = self.known_value(&test, &now.path).map(|value| !is_zero(value));
        if known == Some(false) {
            return Ok(vec![now]);
        }
        let computes = only_computes(&body);
        // The test holds: unroll the loop if it does more than compute numbers, so that the modules it makes are known, or
        // if it is in an axiom, which has no code of its own.
        if known.is_some() && (self.is_in_axiom || !computes || turn > 0) {
            if turn > MAX_KNOWN_TURNS {
                return Err(Refusal::new("'while' with too many turns", place));
            }
            // A `break` may end the loop on an unknown condition: each iteration then adds an execution path, as an unknown test would.
            let conditions = now.path.steps.iter().filter(|s| matches!(s, Step::Condition(..))).count();
            if turn >= MAX_UNKNOWN && u32::try_from(conditions).is_ok_and(|n| n >= MAX_UNKNOWN) {
                self.turns_left_out(place);
            } else {
                now.repeat(test, body, place, turn);
            }
            return Ok(vec![now]);
        }
        if computes {
            let (names, globals) = names_of(&body);
            for name in &names {
                now.path.bounds.forget(name);
                now.path.lists.remove(name);
            }
            now.path.known.extend(names.into_iter().map(|name| (name, None)));
            now.path.globals.extend(globals);
            now.path.steps.push(Step::Loop(test, body, place));
            return Ok(vec![now]);
        }
        if turn == MAX_UNKNOWN {
            self.turns_left_out(place);
            return Ok(vec![now]);
        }
        let draws = has_random(&test, &self.scope);
        let mut taken = now.clone();
        taken.path.steps.push(Step::Condition(test.clone(), true));
        let goes_on = draws || taken.path.bounds.refine(&test, true, &self.scope);
        let ends = draws || now.path.bounds.refine(&test, false, &self.scope);
        taken.repeat(test.clone(), body, place, turn);
        now.path.steps.push(Step::Condition(test, false));
        Ok([Some(taken).filter(|_| goes_on), Some(now).filter(|_| ends)].into_iter().flatten().collect())
    }

    /// L008 for a `while` loop with more iterations than are unrolled.
    fn turns_left_out(&mut self, place: Range<usize>) {
        let at = self.reader.place(place);
        let message = format!("this 'while' makes modules: read with up to {MAX_UNKNOWN} turns");
        let help = "further turns are left out; make one module in a turn, by a production that repeats";
        self.reader.session.warning("L008", message, at, help);
    }

    /// Values of a `for` loop's variable, one for each iteration; a list that is not constant is refused.
    fn turns(&self, list: &PyExpr, place: &Range<usize>) -> Result<Vec<f64>, Refusal> {
        let is_constant = |e: &PyExpr| compile(e, &self.scope).is_ok_and(|code| vm::constant_value(&code).is_some());
        let refused = || match list {
            PyExpr::Call(name, args, _) if name.ends_with("range") && args.iter().all(is_constant) => {
                Refusal::new("'for' with too many turns", place.clone())
            }
            PyExpr::Call(name, ..) if name == "range" || name == "xrange" => {
                Refusal::new("'for' over a range that is not constant", place.clone())
            }
            _ => Refusal::new("'for' over something other than range(..)", place.clone()),
        };
        let Ok(PyExpr::List(items, _)) = resolve(list, &self.scope, 0) else { return Err(refused()) };
        let number = |e: &PyExpr| {
            let code = compile(e, &self.scope).map_err(|_| refused())?;
            vm::constant_value(&code).filter(|v| v.is_finite()).ok_or_else(refused)
        };
        items.iter().map(number).collect()
    }

    /// The parts of a loop over `range(from, end)` or `range(from, end, step)` with a constant step; `None` for other lists.
    fn counted(&mut self, list: &PyExpr, path: &ExecutionPath) -> Option<CountedRange> {
        let PyExpr::Call(function, args, place) = list else { return None };
        let (from, end, step) = match args.as_slice() {
            [from, end] => (from, end, 1.0),
            [from, end, step] => (from, end, self.known_value(step, path).filter(|step| step.abs() > 0.0)?),
            _ => return None,
        };
        if !function.ends_with("range") {
            return None;
        }
        let [begin, count] = ["begin", "count"].map(|word| format!("({word} {})", self.temporaries));
        self.temporaries += 1;
        let at = |name: &str| PyExpr::Name(name.to_owned(), place.clone());
        let two = |op, a: PyExpr, b: PyExpr| PyExpr::Binary(op, Box::new(a), Box::new(b));
        // Keep a constant beginning as a number, so that the largest number of iterations can be found.
        let first = self.known_value(from, path).map_or_else(|| at(&begin), PyExpr::Number);
        let (low, high) = if step > 0.0 { (first.clone(), end.clone()) } else { (end.clone(), first.clone()) };
        let span = two(PyOp::Sub, high, low);
        let turns = if is_zero(step.abs() - 1.0) {
            span
        } else {
            PyExpr::Call("ceil".to_owned(), vec![two(PyOp::Div, span, PyExpr::Number(step.abs()))], place.clone())
        };
        let value = two(PyOp::Add, first, two(PyOp::Mul, at(&count), PyExpr::Number(step)));
        Some(CountedRange {
            begin: Statement::Assign(begin, from.clone()),
            turns: PyExpr::Call("range".to_owned(), vec![turns], place.clone()),
            name: count,
            value,
        })
    }

    /// The end of `range(end)` and the number of iterations to unroll: the upper bound of the end, or [`MAX_UNKNOWN`] with a
    /// warning L008.
    fn last_turn(&mut self, list: &PyExpr, path: &ExecutionPath, place: &Range<usize>) -> Option<(PyExpr, u32)> {
        let PyExpr::Call(name, args, _) = list else { return None };
        let [end] = args.as_slice() else { return None };
        let constant = compile(&on_path(end, path), &self.scope).ok().and_then(|code| vm::constant_value(&code));
        if !name.ends_with("range") || constant.is_some() || !self.is_readable(end, path) {
            return None;
        }
        let most = self.at_most(end, &path.steps, 0).map(f64::ceil).filter(|m| *m <= MAX_COUNTED);
        if most.is_none() {
            let at = self.reader.place(place.clone());
            let message = format!("the end of this 'for' is not constant: read with up to {MAX_UNKNOWN} turns");
            let help = "further turns are left out; write an end that has a largest value: min(n, 8)";
            self.reader.session.warning("L008", message, at, help);
        }
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "between 0 and MAX_COUNTED")]
        let turns = most.map_or(MAX_UNKNOWN, |m| m.max(0.0) as u32);
        Some((end.clone(), turns))
    }

    /// True if all names of an expression are known after the steps of an execution path.
    fn is_readable(&self, e: &PyExpr, path: &ExecutionPath) -> bool {
        let mut scope = self.scope.clone();
        for step in &path.steps {
            match step {
                Step::Assign(name, _) => {
                    scope.local(name);
                }
                Step::Loop(_, body, _) => names_of(body).0.iter().for_each(|name| {
                    scope.local(name);
                }),
                Step::Condition(..) | Step::Store(..) => {}
            }
        }
        compile(e, &scope).is_ok()
    }

    /// Upper bound on the value of an expression after these steps of an execution path; `None` if there is none.
    fn at_most(&self, e: &PyExpr, steps: &[Step], depth: usize) -> Option<f64> {
        if depth > 32 {
            return None;
        }
        let of = |e: &PyExpr| self.at_most(e, steps, depth + 1);
        // Variables of the path hide values of the model.
        let fixed = |e: &PyExpr| {
            let code = compile(e, &self.scope).ok()?;
            vm::constant_value(&code).filter(|_| !steps.iter().any(|s| s.changes(e)))
        };
        match e {
            PyExpr::Name(name, _) => {
                // Use the last assignment to the name; the variables it reads were assigned before it.
                let last = steps.iter().enumerate().rev().find_map(|(i, s)| match s {
                    Step::Assign(n, e) if n == name => Some((i, Some(e))),
                    // A loop may assign any value.
                    Step::Loop(..) if s.assigns(name) => Some((i, None)),
                    _ => None,
                });
                match last {
                    Some((i, e)) => self.at_most(e?, &steps[..i], depth + 1),
                    None => fixed(e),
                }
            }
            PyExpr::Binary(PyOp::Add, a, b) => Some(of(a)? + of(b)?),
            PyExpr::Binary(PyOp::Sub, a, b) => Some(of(a)? - fixed(b)?),
            // Only bounds with constant divisors and nonnegative constant factors are derived; a quotient with a negative
            // dividend is at most 0.
            PyExpr::Binary(PyOp::Div, a, b) => Some(of(a)?.max(0.0) / fixed(b).filter(|b| *b > 0.0)?),
            PyExpr::Binary(PyOp::Mul, a, b) => {
                let (factor, other) = fixed(a).map_or_else(|| (fixed(b), a), |a| (Some(a), b));
                Some(of(other)?.max(0.0) * factor.filter(|f| *f >= 0.0)?)
            }
            PyExpr::Choice(_, a, b) => Some(of(a)?.max(of(b)?)),
            PyExpr::Call(name, args, _) => match (name.as_str(), args.as_slice()) {
                ("randint", [_, b]) => of(b),
                ("uniform", [a, b]) => Some(of(a)?.max(of(b)?)),
                ("random", []) => Some(1.0),
                ("int" | "trunc" | "floor" | "float", [a]) => Some(of(a)?.max(0.0)),
                ("round" | "ceil", [a]) => Some(of(a)?.max(0.0) + 1.0),
                ("min", args) => args.iter().filter_map(of).reduce(f64::min),
                ("max", args) => args.iter().map(of).reduce(|a, b| Some(a?.max(b?))).flatten(),
                // For a function of the model, replace the parameters in its body by the arguments.
                _ => {
                    let (params, body) = self.scope.functions.get(name).filter(|f| f.0.len() == args.len())?;
                    (size_with(body, params, args) <= MAX_STEPS).then(|| of(&substitute(body, params, args))).flatten()
                }
            },
            _ => fixed(e),
        }
    }
}
