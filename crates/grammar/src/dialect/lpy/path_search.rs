//! Finds the execution paths through the statements of a production, in the order in which Python would take them.

use std::collections::BTreeSet;
use std::ops::Range;

use super::Model;
use super::execution_path::{ExecutionPath, MAX_STEPS, OpenPath, Step, on_path, with_known};
use super::expression::{
    PyExpr, first_call, is_change, is_dictionary, is_joined_text, is_object, is_written_out, model_name, range_of,
};
use super::objects::{fields_of, object_of, values_of};
use super::refusal::Refusal;
use super::resolve::{compile, is_list_or_vector, may_be_list, resolve};
use super::scope::{Scope, arguments, has_random};
use super::shapes::spread;
use super::shared_lists::HandedOn;
use super::statement::{
    Statement, Store, call_in, changes, names_of, read_name, renamed, sets_anew, stores, with_lists, without_call,
};
use super::strings::PyModule;
use crate::code::is_zero;
use crate::vm;

/// Limit on the execution paths through one production.
const MAX_PATHS: usize = 512;

/// Limit on the calls of functions of statements on one execution path.
const MAX_CALLS: usize = 256;

/// Limit on the modules in the successor of one execution path; a production that makes more is refused.
const MAX_MODULES: usize = 1 << 20;

/// Limit on the work for all execution paths through one production together: about a second. Own: the models of the tests
/// take less than a hundredth of it.
const MAX_WORK: usize = 1 << 22;

/// Work for each statement of a path, in addition to 1 for each known variable.
const STATEMENT_WORK: usize = 16;

/// The refusal of a call of a function that may end without the value that is needed.
fn no_value(function: &str, place: Range<usize>) -> Refusal {
    let why = Refusal::new(format!("the function '{function}', which may end without a value"), place);
    why.remedy("end it by 'return' with a value, or call it on a line of its own for the modules that it makes")
}

/// True for a choice between lists or dictionaries whose items are numbers, strings and lists of them.
fn is_choice_of_lists(e: &PyExpr) -> bool {
    fn is_side(e: &PyExpr) -> bool {
        let is_plain = |e: &PyExpr| is_written_out(e) || is_dictionary(e);
        match e {
            PyExpr::Choice(_, a, b) => is_side(a) && is_side(b),
            PyExpr::Call(_, items, _) if is_dictionary(e) => items.iter().all(is_plain),
            PyExpr::List(items, _) => items.iter().all(is_plain),
            _ => false,
        }
    }
    matches!(e, PyExpr::Choice(..)) && is_side(e)
}

/// True if evaluating an expression always reads a part: the part is not in a side of a choice, nor in a later operand of
/// `and` or `or`.
fn always_reads(e: &PyExpr, part: &PyExpr) -> bool {
    let of = |e: &PyExpr| always_reads(e, part);
    e == part
        || match e {
            PyExpr::Neg(a) | PyExpr::Not(a) | PyExpr::And(a, _) | PyExpr::Or(a, _) | PyExpr::Choice(a, ..) => of(a),
            PyExpr::Binary(_, a, b) | PyExpr::Index(a, b, _) => of(a) || of(b),
            PyExpr::Call(_, args, _) | PyExpr::Change(_, args, _) | PyExpr::List(args, _) => args.iter().any(of),
            PyExpr::Each(_, _, list, _) => of(list),
            PyExpr::Number(_) | PyExpr::Text(..) | PyExpr::Name(..) => false,
        }
}

/// Refuses a call of a function that changes values of the model if a test decides whether it is called, because calls are
/// run before the statement.
fn check_change_of_values(s: &Statement, call: &PyExpr, function: &str, place: &Range<usize>) -> Result<(), Refusal> {
    let is_run = match s {
        Statement::Store(store) => always_reads(&store.value, call) || always_reads(&store.index, call),
        Statement::Assign(_, e) | Statement::Run(e) | Statement::Return(Some(e), _) | Statement::For(_, e, _, _) => {
            always_reads(e, call)
        }
        Statement::If(tests, _) => tests.first().is_some_and(|(test, _)| always_reads(test, call)),
        Statement::Produce(modules, _) => modules.iter().flat_map(|m| &m.args).any(|arg| always_reads(arg, call)),
        _ => false,
    };
    if is_run {
        return Ok(());
    }
    let why = Refusal::new(
        format!("a call of '{function}', which changes values of the model, behind a test"),
        place.clone(),
    );
    Err(why.remedy("write the call on a line of its own, k = f(), into the block of an 'if'"))
}

/// Refuses a call of a function that changes values of the model if the production has variables of the same names.
fn check_own_names(
    globals: &[String],
    function: &str,
    place: &Range<usize>,
    path: &ExecutionPath,
    left: &[Statement],
) -> Result<(), Refusal> {
    let (assigned, declared) = names_of(left);
    let is_own = |name: &&String| {
        let is_set = path.known.contains_key(*name) || path.lists.contains_key(*name) || assigned.contains(name);
        is_set && !path.globals.contains(name) && !declared.contains(name)
    };
    let Some(name) = globals.iter().find(is_own) else { return Ok(()) };
    let why = format!("a call of '{function}', which changes a '{name}' that this production has, too");
    let why = Refusal::new(why, place.clone());
    Err(why.remedy("give the variable of the production another name, or declare it 'global'"))
}

impl Model<'_, '_> {
    /// All execution paths through statements, in the order in which Python would try them.
    pub(super) fn execution_paths(&mut self, statements: &[Statement]) -> Result<Vec<ExecutionPath>, Refusal> {
        let mut out = Vec::new();
        let mut work = 0;
        let mut open =
            vec![OpenPath { path: ExecutionPath::default(), left: statements.iter().rev().cloned().collect() }];
        while let Some(mut now) = open.pop() {
            let too_many = out.len() + open.len() > MAX_PATHS || now.path.steps.len() + now.left.len() > MAX_STEPS;
            if too_many || now.path.modules.len() > MAX_MODULES {
                return Err(Refusal::new("a production with too many ways through it", now.path.range()));
            }
            work += STATEMENT_WORK + now.path.known.len();
            if work > MAX_WORK {
                let why =
                    Refusal::new("a production with too many statements on all ways through it", now.path.range());
                return Err(why.remedy("write fewer independent 'if's before a loop, or fewer turns of the loop"));
            }
            let ended = match now.left.pop() {
                Some(statement) => self.follow(statement, now, &mut open)?,
                None => Some(now.ended()),
            };
            out.extend(ended);
        }
        Ok(out)
    }

    /// Processes one statement of a path, and adds the paths that continue after it to `open`, the first to try last.
    /// Returns the path itself if it ends there.
    fn follow(
        &mut self,
        statement: Statement,
        mut now: OpenPath,
        open: &mut Vec<OpenPath>,
    ) -> Result<Option<ExecutionPath>, Refusal> {
        if self.call(&statement, &mut now.path, &mut now.left)? {
            open.push(now);
            return Ok(None);
        }
        // Find the lists that the assignment shares by name, before the names are replaced by lists.
        let handed_on = self.handed_on(&statement, &now.path)?;
        self.note_objects_of(&statement, &mut now.path);
        match with_lists(statement, &now.path.lists) {
            Statement::Pass | Statement::TurnEnd | Statement::LoopEnd => {}
            Statement::Global(names) => now.path.globals.extend(names),
            Statement::Stop(place) => {
                let why = Refusal::new("'Stop()' in a production", place);
                return Err(why.remedy(
                    "call it in StartEach() or EndEach(), which may test a variable that the production sets",
                ));
            }
            // The `return` gives the value of an inlined function; otherwise it ends the production, and must have no value.
            Statement::Return(value, place) => {
                let end = now.left.iter().rposition(|s| matches!(s, Statement::FunctionEnd(..)));
                let end = end.and_then(|at| now.left.drain(at..).next());
                match (end, value) {
                    (None, None) => return Ok(Some(now.ended())),
                    (None, Some(_)) => return Err(Refusal::new("'return' in a production", place)),
                    (Some(Statement::FunctionEnd(Some(name), ..)), Some(e)) => {
                        now.left.push(Statement::Assign(name, e));
                    }
                    (Some(Statement::FunctionEnd(Some(_), function, place)), None) => {
                        return Err(no_value(&function, place));
                    }
                    // The value of a function called only for its modules is not used.
                    (Some(_), _) => {}
                }
            }
            Statement::Run(PyExpr::Call(name, _, place)) if !self.scope.functions.contains_key(&name) => {
                return Err(self.scope.refused_call(&name, place));
            }
            Statement::Run(_) | Statement::FunctionEnd(None, ..) => {}
            Statement::FunctionEnd(Some(_), function, place) => {
                return Err(no_value(&function, place));
            }
            Statement::Assign(name, e) => self.assign(name, e, &handed_on, &mut now),
            Statement::Store(store) => self.store(store, &mut now)?,
            Statement::Produce(modules, ends) => {
                self.produce(&mut now.path, &modules, ends);
                if ends {
                    now.path.produced = true;
                    return Ok(Some(now.path));
                }
            }
            Statement::If(tests, other) => {
                open.extend(self.branches(tests, other, now).into_iter().rev());
                return Ok(None);
            }
            Statement::For(name, list, body, place) => self.for_loop(name, &list, body, place, &mut now)?,
            Statement::While(test, body, place, turn) => {
                open.extend(self.while_loop(test, body, place, turn, now)?.into_iter().rev());
                return Ok(None);
            }
            Statement::Break(place) => {
                let at = now.left.iter().rposition(|s| matches!(s, Statement::LoopEnd));
                now.left.truncate(at.ok_or_else(|| Refusal::new("'break' outside of a loop", place))?);
            }
            Statement::Continue(place) => {
                let at = now.left.iter().rposition(|s| matches!(s, Statement::TurnEnd));
                now.left.truncate(at.ok_or_else(|| Refusal::new("'continue' outside of a loop", place))?);
            }
        }
        open.push(now);
        Ok(None)
    }

    /// Assigns a value or a list to a variable of a path.
    fn assign(&mut self, name: String, e: PyExpr, handed_on: &HandedOn, now: &mut OpenPath) {
        // A string composed at run time has no value that a variable could hold; an expression that needs one is refused where it
        // reads the name.
        if is_joined_text(&e) {
            now.path.known.remove(&name);
            now.path.lists.insert(name, e);
            return;
        }
        let list = self.list_of(&e, &now.path).filter(|_| !now.path.globals.contains(&name));
        if let Some(list) = list {
            let mut taken = Vec::new();
            let mut list = self.kept(&list, &now.path, &mut taken);
            // The changes of a list need no new name for the list.
            if !is_change(&e) {
                list = self.named_list(list, &mut format!("(list of {})", self.temporaries));
                self.temporaries += 1;
                now.path.shared_lists.remove(&name);
            }
            self.share_lists(&name, handed_on, &mut now.path);
            now.path.lists.insert(name, list);
            now.run_next(taken);
            return;
        }
        // For a choice of lists or dictionaries, as in `p = q[k]`, evaluate the index now, because it may change before the
        // name is read.
        if let Some((taken, choice)) = self.one_of_lists(&e, &now.path) {
            now.path.known.remove(&name);
            now.path.lists.insert(name, choice);
            now.run_next(vec![taken]);
            return;
        }
        now.path.lists.remove(&name);
        let value = self.known_value(&e, &now.path);
        let e = value.filter(|_| self.calls_function(&e)).map_or(e, PyExpr::Number);
        now.path.known.insert(name.clone(), value);
        now.path.bounds.assign(&name, &e, &self.scope);
        now.path.steps.push(Step::Assign(name, e));
    }

    /// Sets an item of a list that productions change.
    fn store(&mut self, store: Store, now: &mut OpenPath) -> Result<(), Refusal> {
        let value = &store.value;
        if let Some(list) = self.list_of(value, &now.path)
            && let Some(stores) = self.row_stores(&store, &list)?
        {
            now.run_next(stores.into_iter().map(Statement::Store).collect());
            return Ok(());
        }
        if self.list_of(value, &now.path).is_some() || is_dictionary(value) || is_joined_text(value) {
            let list = &store.list;
            let why =
                format!("something other than a number as an item of the list '{list}', which productions change");
            let why = Refusal::new(why, range_of(value));
            return Err(why.remedy("keep each coordinate of points in a list of its own"));
        }
        // Evaluate index and value now, like the values of assignments, because their variables may change later.
        let is_plain = |e: &PyExpr| match e {
            PyExpr::Number(_) | PyExpr::Name(..) | PyExpr::Text(..) => true,
            PyExpr::List(both, _) => both.iter().all(|e| matches!(e, PyExpr::Number(_) | PyExpr::Name(..))),
            _ => false,
        };
        let mut taken = Vec::new();
        let mut kept = |e: PyExpr| {
            if is_plain(&e) {
                return e;
            }
            let (name, range) = (format!("(stored {})", self.temporaries), range_of(&e));
            self.temporaries += 1;
            taken.push(Statement::Assign(name.clone(), e));
            PyExpr::Name(name, range)
        };
        let index = match store.index {
            PyExpr::List(both, range) => PyExpr::List(both.into_iter().map(&mut kept).collect(), range),
            index => kept(index),
        };
        let value = kept(store.value);
        let store = Store { index, value, ..store };
        if taken.is_empty() {
            now.path.steps.push(Step::Store(store));
        } else {
            taken.push(Statement::Store(store));
            now.run_next(taken);
        }
        Ok(())
    }

    /// For a list of lists or dictionaries with an index that is not known: the choice between its items, and the assignment of
    /// the index to a temporary variable. `None` for any other expression.
    fn one_of_lists(&mut self, e: &PyExpr, path: &ExecutionPath) -> Option<(Statement, PyExpr)> {
        let PyExpr::Index(list, index, place) = e else { return None };
        if matches!(**index, PyExpr::Call(..)) || !may_be_list(list, &self.scope) {
            return None;
        }
        let name = format!("(item {})", self.temporaries);
        let taken = PyExpr::Name(name.clone(), range_of(index));
        let mut scope = self.scope_of(path);
        scope.locals.push(name.clone());
        let value = resolve(&PyExpr::Index(list.clone(), Box::new(taken), place.clone()), &scope, 0).ok()?;
        if !is_choice_of_lists(&value) {
            return None;
        }
        self.temporaries += 1;
        Some((Statement::Assign(name, (**index).clone()), value))
    }

    /// The execution paths after an `if`, in the order of trial.
    fn branches(
        &self,
        tests: Vec<(PyExpr, Vec<Statement>)>,
        other: Vec<Statement>,
        mut now: OpenPath,
    ) -> Vec<OpenPath> {
        let mut out = Vec::new();
        for (test, then) in tests {
            // A constant test, such as one of a loop variable, leaves a single path, and so does a test that earlier
            // conditions decide. Tests that draw random numbers are always evaluated.
            let test = with_known(&test, &now.path);
            let draws = has_random(&test, &self.scope);
            let known = self.known_value(&test, &now.path).map(|value| !is_zero(value));
            let known = known.or_else(|| now.path.bounds.decide(&test, &self.scope).filter(|_| !draws));
            match known {
                Some(false) => continue,
                Some(true) => {
                    now.run_next(then);
                    out.push(now);
                    return out;
                }
                None => {}
            }
            let mut taken = now.clone();
            taken.path.steps.push(Step::Condition(test.clone(), true));
            taken.run_next(then);
            if draws || taken.path.bounds.refine(&test, true, &self.scope) {
                out.push(taken);
            }
            // If one of the tests must hold, no other path remains.
            if !draws && !now.path.bounds.refine(&test, false, &self.scope) {
                return out;
            }
            now.path.steps.push(Step::Condition(test, false));
        }
        now.run_next(other);
        out.push(now);
        out
    }

    /// If a statement calls a function of statements, inserts the function's statements before it, with its variables
    /// renamed, and replaces the call by a variable for the value. False if there is no such call.
    pub(super) fn call(
        &mut self,
        s: &Statement,
        path: &mut ExecutionPath,
        left: &mut Vec<Statement>,
    ) -> Result<bool, Refusal> {
        if self.bodies.is_empty() {
            return Ok(false);
        }
        let Some(call) = call_in(s, &|name| self.has_body(name)) else { return Ok(false) };
        let PyExpr::Call(function, args, place) = &call else { return Ok(false) };
        let Some((params, body)) = self.bodies.get(function).cloned() else { return Ok(false) };
        path.calls += 1;
        if path.calls > MAX_CALLS {
            return Err(Refusal::new(
                format!("more than {MAX_CALLS} calls of functions in a production"),
                place.clone(),
            ));
        }
        let args = arguments(&params, self.scope.defaults.get(function), args.clone());
        let args = args.ok_or_else(|| Refusal::new(format!("this call of '{function}'"), place.clone()))?;
        let (mut names, globals) = names_of(&body);
        // Variables of the model that the function changes keep their names.
        names.retain(|name| !globals.contains(name));
        if !globals.is_empty() || stores(&body) || params.iter().any(|param| changes(&body, param)) {
            check_change_of_values(s, &call, function, place)?;
            check_own_names(&globals, function, place, path, left)?;
        }
        names.extend(params.iter().cloned());
        let number = self.temporaries;
        self.temporaries += 1;
        let mut own: Vec<String> = names.iter().map(|name| format!("{name} ({number})")).collect();
        // An object that the function changes belongs to the caller: keep the caller's name for it.
        let mut is_same = vec![false; params.len()];
        for ((k, param), arg) in params.iter().enumerate().zip(&args) {
            // The same applies to a list that the caller has made and that the function changes.
            let is_own_list = |name: &String| {
                let list = path.lists.get(name).and_then(|list| self.list_of(list, path));
                matches!(list, Some(PyExpr::List(..))) && changes(&body, param)
            };
            let value = if let PyExpr::Name(name, _) = arg {
                let value = path.lists.get(name).or_else(|| self.scope.lists.get(name));
                value.filter(|e| is_object(e) || is_own_list(name)).map(|_| name)
            } else {
                None
            };
            if let Some(name) = value
                && !sets_anew(&body, param)
                && let Some(at) = names.iter().position(|n| n == param)
            {
                own[at] = name.clone();
                is_same[k] = true;
            }
        }
        // If the production has variables with the names of values of the model, the function must still read the latter.
        let others = self.scope.locals.iter().chain(path.known.keys()).chain(path.lists.keys());
        let others: BTreeSet<&String> =
            others.filter(|name| !name.contains('(') && !names.contains(name) && read_name(&body, name)).collect();
        let others: Vec<String> = others.into_iter().filter(|name| !path.globals.contains(name)).cloned().collect();
        if let Some(name) = others.iter().find(|name| self.shared.contains(name)) {
            let why = format!("a call of '{function}', which reads a '{name}' that this production has, too");
            let why = Refusal::new(why, place.clone());
            return Err(why.remedy("give the variable of the production another name"));
        }
        own.extend(others.iter().map(|name| model_name(name)));
        names.extend(others);
        let result = format!("(result {number})");
        let value = PyExpr::Name(result.clone(), place.clone());
        // In `a, b = f(x)` both names take items of one value.
        for next in left.iter_mut().rev().take_while(|s| matches!(s, Statement::Assign(..))) {
            *next = without_call(next, &call, &value);
        }
        left.push(without_call(s, &call, &value));
        // A call that is the whole statement needs no variable for its value.
        let is_run = matches!(s, Statement::Run(e) if *e == call);
        let result = Some(result).filter(|_| !is_run);
        left.push(Statement::FunctionEnd(result, function.clone(), place.clone()));
        left.extend(body.iter().rev().map(|s| renamed(s, &names, &own)));
        let set = params.iter().zip(args).zip(is_same).filter(|(_, is_same)| !is_same).map(|((p, value), _)| {
            let name = names.iter().position(|n| n == p).and_then(|i| own.get(i)).unwrap_or(p);
            Statement::Assign(name.clone(), value)
        });
        left.extend(set);
        Ok(true)
    }

    /// Adds modules to a path. Their parameters are evaluated now, because variables may change afterwards.
    fn produce(&mut self, path: &mut ExecutionPath, modules: &[PyModule], ends: bool) {
        for m in modules {
            let mut module = m.clone();
            // An unreadable list is refused where the successor is made.
            let is_spread =
                |arg: &PyExpr| matches!(arg, PyExpr::Call(star, ..) if star == "*") || may_be_list(arg, &self.scope);
            if m.args.iter().any(is_spread)
                && let Ok(spread) = spread(m, &self.scope_of(path))
            {
                module.args = spread.args;
                module.shape = Some(spread.shape);
            }
            for arg in &mut module.args {
                let value = if self.calls_function(arg) { self.known_value(arg, path) } else { None };
                if let Some(value) = value {
                    *arg = PyExpr::Number(value);
                }
            }
            for arg in module.args.iter_mut().filter(|a| !ends && !matches!(a, PyExpr::Number(_) | PyExpr::Text(..))) {
                let name = format!("(value {})", self.temporaries);
                self.temporaries += 1;
                let value = std::mem::replace(arg, PyExpr::Name(name.clone(), m.range.clone()));
                path.steps.push(Step::Assign(name, value));
            }
            path.modules.push(module);
        }
    }

    /// The list or vector that an expression evaluates to; `None` for other values.
    pub(super) fn list_of(&self, e: &PyExpr, path: &ExecutionPath) -> Option<PyExpr> {
        if matches!(e, PyExpr::List(..)) {
            return Some(e.clone());
        }
        let is_list = may_be_list(e, &self.scope)
            && resolve(&on_path(e, path), &self.scope, 0).is_ok_and(|e| is_list_or_vector(&e));
        // The items keep the names of variables whose values are not known.
        let list = is_list.then(|| resolve(&with_known(e, path), &self.scope_of(path), 0).ok()).flatten();
        list.filter(is_list_or_vector)
    }

    /// The scope of the production with the variables that a path has assigned.
    fn scope_of(&self, path: &ExecutionPath) -> Scope {
        let own = path.known.keys().filter(|name| !self.scope.locals.contains(name));
        let mut scope = self.scope.clone();
        scope.locals.extend(own.cloned());
        scope
    }

    /// The value of an expression in a form that may be read later: a list of numbers and of temporary variables, which the
    /// statements `taken` set.
    pub(super) fn kept(&mut self, e: &PyExpr, path: &ExecutionPath, taken: &mut Vec<Statement>) -> PyExpr {
        let is_kept = matches!(e, PyExpr::Name(name, _) if name.starts_with("(item "));
        if is_written_out(e) || is_kept {
            return e.clone();
        }
        match self.list_of(e, path) {
            Some(PyExpr::List(items, place)) => {
                let items = items.iter().map(|e| self.kept(e, path, taken)).collect();
                return PyExpr::List(items, place);
            }
            Some(object) if is_object(&object) => {
                let fields = fields_of(&object).unwrap_or_default();
                let values = values_of(&object).unwrap_or_default();
                let values = values.into_iter().map(|e| self.kept(e, path, taken)).collect();
                return object_of(&fields, values, &range_of(&object));
            }
            Some(PyExpr::Call(kind, items, place)) => {
                let items = items.iter().map(|e| self.kept(e, path, taken)).collect();
                return PyExpr::Call(kind, items, place);
            }
            _ => {}
        }
        let name = format!("(item {})", self.temporaries);
        self.temporaries += 1;
        taken.push(Statement::Assign(name.clone(), e.clone()));
        PyExpr::Name(name, range_of(e))
    }

    /// Value of an expression after the steps of a path; `None` if it depends on parameters.
    pub(super) fn known_value(&self, e: &PyExpr, path: &ExecutionPath) -> Option<f64> {
        let code = compile(&on_path(e, path), &self.scope).ok()?;
        vm::constant_value(&code).filter(|v| !v.is_nan())
    }

    /// True for an expression that calls a function of the model. If its value is known, it is replaced by the number,
    /// because the function may be recursive and end only by a test of such numbers.
    fn calls_function(&self, e: &PyExpr) -> bool {
        first_call(e, &|name| self.scope.functions.contains_key(name)).is_some()
    }
}
