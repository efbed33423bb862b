//! Bytecode for the steps of an execution path.

use std::ops::Range;
use std::sync::Arc;

use super::Model;
use super::emit::append_code;
use super::execution_path::{ExecutionPath, Step};
use super::expression::{PyExpr, PyOp};
use super::refusal::Refusal;
use super::resolve::compile;
use super::scope::has_random;
use super::statement::{Statement, Store, names_of, stores};
use crate::code::{Bytecode, Op, UnaryOp};

/// Appends a test and a placeholder for the jump that is taken if it is 0; returns the index of the placeholder.
pub(super) fn push_test(ops: &mut Vec<Op>, test: &Bytecode) -> usize {
    append_code(ops, &test.ops);
    ops.push(Op::Pop);
    ops.len() - 1
}

/// Beginning, end and positive step of a `range(..)`; `None` for other lists.
fn range_of_loop(list: &PyExpr) -> Option<(PyExpr, PyExpr, f64)> {
    let PyExpr::Call(name, args, _) = list else { return None };
    if !name.ends_with("range") {
        return None;
    }
    match args.as_slice() {
        [end] => Some((PyExpr::Number(0.0), end.clone(), 1.0)),
        [from, end] => Some((from.clone(), end.clone(), 1.0)),
        [from, end, PyExpr::Number(step)] if *step > 0.0 => Some((from.clone(), end.clone(), *step)),
        _ => None,
    }
}

/// Jumps out of a loop's body, whose targets are known at the loop's end.
#[derive(Debug, Default)]
pub(super) struct LoopJumps {
    pub breaks: Vec<usize>,
    pub continues: Vec<usize>,
}

impl LoopJumps {
    /// Ends a loop: appends the jump to its test at `start`, and sets the targets of the jumps. `skip`: index of the jump
    /// after a false test.
    pub fn close(self, ops: &mut Vec<Op>, start: usize, skip: usize) {
        for at in self.continues {
            ops[at] = Op::Jump(start);
        }
        ops.push(Op::Jump(start));
        ops[skip] = Op::JumpIfZero(ops.len());
        for at in self.breaks {
            ops[at] = Op::Jump(ops.len());
        }
    }
}

/// Code that undoes a store needs the array, and the variables that hold the position and the element before the store.
struct UndoneStore {
    array: usize,
    index: u16,
    old: u16,
}

/// A `for` loop over a range, as a `while` loop that counts.
pub(super) struct CountedLoop {
    /// Sets the counter and the end of the range: Python evaluates a range once, before the first iteration.
    pub begin: [Statement; 2],
    pub test: PyExpr,
    pub turn: Vec<Statement>,
}

impl Model<'_, '_> {
    /// Converts a `for` loop to a loop that counts; `None` unless it is over a range with a positive step.
    pub(super) fn counted_loop(
        &mut self,
        name: &str,
        list: &PyExpr,
        body: &[Statement],
        place: &Range<usize>,
    ) -> Option<CountedLoop> {
        let [count, last] = ["turn", "end"].map(|word| format!("({word} {})", self.temporaries));
        self.temporaries += 1;
        let (from, end, step) = range_of_loop(list)?;
        let at = |n: &str| PyExpr::Name(n.to_owned(), place.clone());
        let test = PyExpr::Binary(PyOp::Lt, Box::new(at(&count)), Box::new(at(&last)));
        let next = PyExpr::Binary(PyOp::Add, Box::new(at(&count)), Box::new(PyExpr::Number(step)));
        // Count at the beginning, so that `continue` does not skip it.
        let mut turn = vec![Statement::Assign(name.to_owned(), at(&count)), Statement::Assign(count.clone(), next)];
        turn.extend(body.iter().cloned());
        Some(CountedLoop { begin: [Statement::Assign(count, from), Statement::Assign(last, end)], test, turn })
    }

    /// Code for the steps of an execution path: a block before the condition, and the condition.
    pub(super) fn path_code(&mut self, path: &ExecutionPath) -> Result<(Option<Bytecode>, Option<Bytecode>), Refusal> {
        // If the path has only conditions without random numbers, join them in one expression.
        let is_plain = |s: &Step| matches!(s, Step::Condition(e, _) if !has_random(e, &self.scope));
        if path.steps.iter().all(is_plain) {
            let test = |s: &Step| match s {
                Step::Condition(e, true) => Some(e.clone()),
                Step::Condition(e, false) => Some(PyExpr::Not(Box::new(e.clone()))),
                Step::Assign(..) | Step::Loop(..) | Step::Store(..) => None,
            };
            let all = path.steps.iter().filter_map(test).reduce(|a, b| PyExpr::And(Box::new(a), Box::new(b)));
            return Ok((None, all.map(|e| compile(&e, &self.scope)).transpose()?));
        }
        // Otherwise a block computes everything in order, and a variable stores whether all conditions held. All paths must
        // draw the same random numbers, because they represent the same run of Python.
        let result = self.scope.local("(applies)");
        let mut ops = vec![Op::RestartDraws];
        // Jumps of failing conditions, each with the number of stores made before it, which must be undone.
        let mut failures = Vec::new();
        let mut undone = Vec::new();
        let mut stored_in_loop: Option<Range<usize>> = None;
        for step in &path.steps {
            let (e, store) = match step {
                Step::Assign(name, e) => (e, Some(name)),
                Step::Condition(e, _) => (e, None),
                Step::Store(store) => {
                    undone.extend(self.store_code(store, &mut ops)?);
                    continue;
                }
                Step::Loop(test, body, place) => {
                    if stores(body) {
                        stored_in_loop = Some(place.clone());
                    }
                    self.loop_code(test, body, place, &mut ops)?;
                    continue;
                }
            };
            let code = compile(e, &self.scope)?;
            append_code(&mut ops, &code.ops);
            match (store, step) {
                (Some(name), _) => ops.push(Op::StoreLocal(self.scope.local(name))),
                (None, Step::Condition(_, wanted)) => {
                    if let Some(place) = stored_in_loop {
                        let why = Refusal::new("a test behind a loop that changes a list of the model", place);
                        return Err(
                            why.remedy("write the test before the loop, or the loop into StartEach() or EndEach()")
                        );
                    }
                    if !wanted {
                        ops.push(Op::Unary(UnaryOp::Not));
                    }
                    failures.push((ops.len(), undone.len()));
                    ops.push(Op::Pop);
                }
                (None, Step::Assign(..) | Step::Loop(..) | Step::Store(..)) => {}
            }
        }
        // So far the variables are local: only the path that is taken changes those of the model.
        for name in path.written() {
            let (local, global) = (self.scope.local(name), self.scope.global(name));
            ops.extend([Op::Local(local), Op::StoreGlobal(global)]);
        }
        ops.extend([Op::Const(if path.produced { 1.0 } else { 0.0 }), Op::StoreLocal(result)]);
        let jump = ops.len();
        ops.push(Op::Pop);
        // A condition that fails after some stores jumps to the code that undoes the last of them; that code continues with the
        // earlier ones.
        for count in (0..=undone.len()).rev() {
            for (at, _) in failures.iter().filter(|(_, before)| *before == count) {
                ops[*at] = Op::JumpIfZero(ops.len());
            }
            if let Some(store) = count.checked_sub(1).and_then(|k| undone.get(k)) {
                ops.extend([Op::Local(store.index), Op::Local(store.old), Op::StoreElement(store.array)]);
            }
        }
        ops.extend([Op::Const(0.0), Op::StoreLocal(result)]);
        ops[jump] = Op::Jump(ops.len());
        let condition = Bytecode { ops: vec![Op::Local(result)], ..Bytecode::default() };
        Ok((Some(self.bytecode(ops)), Some(condition)))
    }

    /// Appends the store of an item of a list that productions change. Returns the variables for undoing it; `None` for a name
    /// that is no such list.
    fn store_code(&mut self, store: &Store, ops: &mut Vec<Op>) -> Result<Option<UndoneStore>, Refusal> {
        let Some(own) = self.scope.arrays.get(&store.list).cloned() else { return Ok(None) };
        let [index_name, old_name] = ["at", "old"].map(|word| format!("({word} {})", self.temporaries));
        self.temporaries += 1;
        let value = compile(&store.value, &self.scope)?;
        let at = compile(&self.position_of(store)?, &self.scope)?;
        append_code(ops, &at.ops);
        let (index, old) = (self.scope.local(&index_name), self.scope.local(&old_name));
        // Save the present element, so that a later condition that fails can restore it; beyond the last item there is no element
        // to save.
        ops.extend([Op::StoreLocal(index), Op::Local(index), Op::LoadElement(own.number), Op::StoreLocal(old)]);
        ops.push(Op::Local(index));
        append_code(ops, &value.ops);
        ops.push(Op::StoreElement(own.number));
        Ok(Some(UndoneStore { array: own.number, index, old }))
    }

    /// Code with the places of its loops and the functions that it calls.
    pub(super) fn bytecode(&self, mut ops: Vec<Op>) -> Bytecode {
        let has_loops = ops.iter().any(|op| matches!(op, Op::Count(_)));
        let places = if has_loops { self.loop_places.clone() } else { Vec::new() };
        let calls = ops.iter().any(|op| matches!(op, Op::Call(_)));
        let functions = calls.then(|| Arc::clone(&self.scope.run_code));
        // In the list of places, those of calls follow those of loops: shift their indices.
        for op in &mut ops {
            if let Op::Table(_, place) = op {
                *place = place.saturating_add(places.len());
            }
        }
        self.scope.with_tables(Bytecode { ops, places, functions, ..Bytecode::default() })
    }

    /// Appends a loop: test, JumpIfZero to its end, body, Jump to the test.
    fn loop_code(
        &mut self,
        test: &PyExpr,
        body: &[Statement],
        place: &Range<usize>,
        ops: &mut Vec<Op>,
    ) -> Result<(), Refusal> {
        // Declare the names that the body assigns before the test, which may read them.
        for name in names_of(body).0 {
            self.scope.local(&name);
        }
        let start = ops.len();
        ops.push(Op::Count(self.loop_places.len()));
        self.loop_places.push(self.reader.place(place.clone()));
        let skip = push_test(ops, &compile(test, &self.scope)?);
        let mut jumps = LoopJumps::default();
        self.computing_code(body, ops, &mut jumps)?;
        jumps.close(ops, start, skip);
        Ok(())
    }

    /// Appends the code of statements that only compute numbers. `jumps`: jumps of the enclosing loop.
    fn computing_code(&mut self, body: &[Statement], ops: &mut Vec<Op>, jumps: &mut LoopJumps) -> Result<(), Refusal> {
        for statement in body {
            match statement {
                Statement::Assign(name, e) => {
                    let code = compile(e, &self.scope)?;
                    append_code(ops, &code.ops);
                    ops.push(Op::StoreLocal(self.scope.local(name)));
                }
                Statement::If(tests, other) => {
                    let mut ends = Vec::new();
                    for (test, then) in tests {
                        let skip = push_test(ops, &compile(test, &self.scope)?);
                        self.computing_code(then, ops, jumps)?;
                        ends.push(ops.len());
                        ops.push(Op::Pop);
                        ops[skip] = Op::JumpIfZero(ops.len());
                    }
                    self.computing_code(other, ops, jumps)?;
                    for end in ends {
                        ops[end] = Op::Jump(ops.len());
                    }
                }
                Statement::While(test, inner, place, _) => self.loop_code(test, inner, place, ops)?,
                Statement::For(name, list, inner, place) => {
                    let counted = self
                        .counted_loop(name, list, inner, place)
                        .ok_or_else(|| Refusal::new("'for' over a list in a loop", place.clone()))?;
                    self.computing_code(&counted.begin, ops, jumps)?;
                    self.loop_code(&counted.test, &counted.turn, place, ops)?;
                }
                Statement::Store(store) => self.plain_store(store, ops)?,
                Statement::Break(_) => {
                    jumps.breaks.push(ops.len());
                    ops.push(Op::Pop);
                }
                Statement::Continue(_) => {
                    jumps.continues.push(ops.len());
                    ops.push(Op::Pop);
                }
                // Names of `global` are known from the path; a loop that only computes numbers contains no other statements.
                _ => {}
            }
        }
        Ok(())
    }
}
