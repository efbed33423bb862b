//! The ways through the statements of a production, in the order in which Python would take them.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;

use super::Model;
use super::bounds::{Bounds, mentions};
use super::expression::{PyExpr, PyOp, Refusal, Scope, UNKNOWN};
use super::expression::{arguments, compile, first_call, has_random, model_name, plain_name, range_of, resolve};
use super::expression::{size_with, substitute};
use super::lists::{HandedOn, changes, is_change};
use super::statement::{Statement, assigned, call_in, in_turn, is_written_out, only_computes};
use super::statement::{read_name, renamed, with_lists, without_call};
use super::strings::PyModule;
use crate::code::is_zero;
use crate::vm;

/// Most ways through one production, and most statements of one way.
const MAX_WAYS: usize = 512;
const MAX_STEPS: usize = 20_000;
/// Upper limit on the turns of a loop whose end is not constant, but bounded.
const MAX_COUNTED: f64 = 100.0;
/// Turns that are read of a loop whose end has no known bound.
const MAX_UNKNOWN: u32 = 64;
/// Turns of a `while` whose tests are known, which are written out.
const MAX_KNOWN_TURNS: u32 = 2_000;
/// Most calls, on one way, of functions that are more than one expression.
const MAX_CALLS: usize = 256;
/// Most modules of the successor of one way; a production that makes more is refused.
const MAX_MODULES: usize = 1 << 20;

/// The end of `range(end)`.
fn range_end(list: &PyExpr) -> Option<PyExpr> {
    match list {
        PyExpr::Call(name, args, _) if name.ends_with("range") && args.len() == 1 => args.first().cloned(),
        _ => None,
    }
}

/// A loop over `range(from, end, step)` as one over a range from 0.
struct CountedRange {
    /// Sets the variable of the beginning, which the turns may read.
    begin: Statement,
    /// `range(turns)`.
    turns: PyExpr,
    /// Variable of the number of the turn.
    name: String,
    /// Value of the variable of the model's loop in a turn.
    value: PyExpr,
}

/// The arguments of a module, `*list` replaced by the items of the list.
pub(super) fn spread(args: &[PyExpr], scope: &Scope) -> Result<Vec<PyExpr>, Refusal> {
    let mut out = Vec::with_capacity(args.len());
    for arg in args {
        match arg {
            PyExpr::Call(star, list, range) if star == "*" => {
                match list.first().map(|l| resolve(l, scope, 0)).transpose()? {
                    Some(PyExpr::List(items, _)) => out.extend(items),
                    _ => return Err(Refusal::new("'*' before something other than a list", range.clone())),
                }
            }
            _ => out.push(arg.clone()),
        }
    }
    Ok(out)
}

/// One step of a way through a production: an assignment, or a condition with the value it has on this way.
#[derive(Debug, Clone)]
pub(super) enum Step {
    Assign(String, PyExpr),
    Condition(PyExpr, bool),
    /// A `while` loop of statements that only compute.
    Loop(PyExpr, Vec<Statement>, Range<usize>),
}

impl Step {
    fn assigns(&self, name: &str) -> bool {
        match self {
            Self::Assign(n, _) => n == name,
            Self::Condition(..) => false,
            Self::Loop(_, body, _) => names_of(body).0.iter().any(|n| n == name),
        }
    }

    /// True if an expression reads a variable that the step assigns.
    fn changes(&self, e: &PyExpr) -> bool {
        match self {
            Self::Assign(name, _) => mentions(e, name),
            Self::Condition(..) => false,
            Self::Loop(_, body, _) => names_of(body).0.iter().any(|name| mentions(e, name)),
        }
    }
}

/// An expression with the values of the variables of a way, which hide those of the model; [`UNKNOWN`] stands for one whose value
/// is not known, so that what reads it is not constant.
fn in_way(e: &PyExpr, way: &Way) -> PyExpr {
    let names: Vec<String> = way.known.keys().cloned().collect();
    let unknown = || PyExpr::Name(UNKNOWN.to_owned(), 0..0);
    let values: Vec<PyExpr> = way.known.values().map(|v| v.map_or_else(unknown, PyExpr::Number)).collect();
    substitute(e, &names, &values)
}

/// An expression with the values of those variables of a way whose values are known.
fn with_known(e: &PyExpr, way: &Way) -> PyExpr {
    let known = way.known.iter().filter_map(|(name, value)| Some((name.clone(), PyExpr::Number((*value)?))));
    let (names, values): (Vec<String>, Vec<PyExpr>) = known.unzip();
    substitute(e, &names, &values)
}

/// Names that statements assign, and names that they declare `global`.
pub(super) fn names_of(statements: &[Statement]) -> (Vec<String>, Vec<String>) {
    let (mut names, mut globals) = (Vec::new(), Vec::new());
    assigned(statements, &mut names, &mut globals);
    (names, globals)
}

/// A way through a production: what it computes, and what it makes.
#[derive(Debug, Clone, Default)]
pub(super) struct Way {
    pub steps: Vec<Step>,
    pub modules: Vec<PyModule>,
    /// It makes modules, or ends by `produce`.
    pub produced: bool,
    /// Names declared `global` on the way.
    globals: Vec<String>,
    /// Variables that the way has assigned, with their values where these are numbers whatever the parameters are.
    known: BTreeMap<String, Option<f64>>,
    /// Variables that the way has set to lists, which stand where the names are read.
    pub lists: BTreeMap<String, PyExpr>,
    /// Those of them, and lists of the model, that have two names.
    pub shared_lists: BTreeSet<String>,
    /// What its conditions leave of the values of its variables.
    bounds: Bounds,
    /// How many functions it has called.
    calls: usize,
}

impl Way {
    /// Names declared `global` on the way that it also assigns.
    pub fn written(&self) -> Vec<&String> {
        let assigns = |name: &String| self.steps.iter().any(|s| s.assigns(name));
        self.globals.iter().filter(|g| assigns(g)).collect()
    }

    /// True if it reads a variable that it does not set.
    pub fn misses(&self, name: &str) -> bool {
        let is_set = self.known.contains_key(name) || self.lists.contains_key(name);
        let reads = |step: &Step| match step {
            Step::Assign(_, e) | Step::Condition(e, _) => mentions(e, name),
            Step::Loop(test, body, _) => mentions(test, name) || read_name(body, name),
        };
        let is_read =
            || self.steps.iter().any(reads) || self.modules.iter().flat_map(|m| &m.args).any(|arg| mentions(arg, name));
        !is_set && is_read()
    }

    /// Where its modules are written, for messages.
    fn range(&self) -> Range<usize> {
        self.modules.first().map_or(0..0, |m| m.range.clone())
    }
}

/// A way whose statements have not all been followed.
#[derive(Debug, Clone)]
struct OpenWay {
    way: Way,
    /// The statements that are left, the next one last.
    left: Vec<Statement>,
}

impl OpenWay {
    /// Puts a block before the statements that are left.
    fn run_next(&mut self, block: Vec<Statement>) {
        self.left.extend(block.into_iter().rev());
    }

    /// Puts a turn of a `while` before the statements that are left, and the loop behind it.
    fn repeat(&mut self, test: PyExpr, body: Vec<Statement>, place: Range<usize>, turn: u32) {
        self.left.push(Statement::While(test, body.clone(), place, turn + 1));
        self.left.push(Statement::TurnEnd);
        self.run_next(body);
    }

    /// The way, whose statements end here.
    fn ended(self) -> Way {
        let produced = self.way.produced || !self.way.modules.is_empty();
        Way { produced, ..self.way }
    }
}

/// Refuses a loop of more turns than are written out.
fn check_turns(turns: usize, body: &[Statement], place: Range<usize>) -> Result<(), Refusal> {
    if turns.saturating_mul(body.len() + 1) > MAX_STEPS {
        return Err(Refusal::new("'for' with too many turns", place));
    }
    Ok(())
}

impl Model<'_, '_> {
    /// Every way through statements, in the order in which Python would try them.
    pub(super) fn ways(&mut self, statements: &[Statement]) -> Result<Vec<Way>, Refusal> {
        let mut out = Vec::new();
        let mut open = vec![OpenWay { way: Way::default(), left: statements.iter().rev().cloned().collect() }];
        while let Some(mut now) = open.pop() {
            let too_many = out.len() + open.len() > MAX_WAYS || now.way.steps.len() + now.left.len() > MAX_STEPS;
            if too_many || now.way.modules.len() > MAX_MODULES {
                return Err(Refusal::new("a production with too many ways through it", now.way.range()));
            }
            let ended = match now.left.pop() {
                Some(statement) => self.follow(statement, now, &mut open)?,
                None => Some(now.ended()),
            };
            out.extend(ended);
        }
        Ok(out)
    }

    /// Follows one statement of a way, and adds the ways that go on behind it to the open ones, the first to try last. The way itself
    /// if it ends there.
    fn follow(
        &mut self,
        statement: Statement,
        mut now: OpenWay,
        open: &mut Vec<OpenWay>,
    ) -> Result<Option<Way>, Refusal> {
        if self.call(&statement, &mut now.way, &mut now.left)? {
            open.push(now);
            return Ok(None);
        }
        // What an assignment hands on is known by names, before lists take their place.
        let handed_on = self.handed_on(&statement, &now.way)?;
        match with_lists(statement, &now.way.lists) {
            Statement::Pass | Statement::TurnEnd | Statement::LoopEnd => {}
            Statement::Global(names) => now.way.globals.extend(names),
            Statement::Return(None, _) => return Ok(Some(now.ended())),
            // The value of a function that the production calls; else the production has no value.
            Statement::Return(Some(e), place) => {
                let at = now.left.iter().rposition(|s| matches!(s, Statement::FunctionEnd(..)));
                let at = at.ok_or_else(|| Refusal::new("'return' in a production", place))?;
                let end = now.left.drain(at..).next();
                if let Some(Statement::FunctionEnd(name, ..)) = end {
                    now.left.push(Statement::Assign(name, e));
                }
            }
            Statement::FunctionEnd(_, function, place) => {
                return Err(Refusal::new(format!("the function '{function}', which may end without a value"), place));
            }
            Statement::Assign(name, e) => self.assign(name, e, &handed_on, &mut now),
            Statement::Produce(modules, ends) => {
                self.produce(&mut now.way, &modules, ends);
                if ends {
                    now.way.produced = true;
                    return Ok(Some(now.way));
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

    /// Assigns a value or a list to a variable of a way.
    fn assign(&mut self, name: String, e: PyExpr, handed_on: &HandedOn, now: &mut OpenWay) {
        let list = self.list_of(&e, &now.way).filter(|_| !now.way.globals.contains(&name));
        if let Some(list) = list {
            let mut taken = Vec::new();
            let mut list = self.kept(&list, &now.way, &mut taken);
            // A list that changes has no name for each of its changes.
            if !is_change(&e) {
                list = self.named_list(list, &mut format!("(list of {})", self.temporaries));
                self.temporaries += 1;
                now.way.shared_lists.remove(&name);
            }
            self.share_lists(&name, handed_on, &mut now.way);
            now.way.lists.insert(name, list);
            now.run_next(taken);
            return;
        }
        now.way.lists.remove(&name);
        let value = self.known_value(&e, &now.way);
        let e = value.filter(|_| self.calls_function(&e)).map_or(e, PyExpr::Number);
        now.way.known.insert(name.clone(), value);
        now.way.bounds.assign(&name, &e, &self.scope);
        now.way.steps.push(Step::Assign(name, e));
    }

    /// The ways behind an `if`, the first to try first.
    fn branches(&self, tests: Vec<(PyExpr, Vec<Statement>)>, other: Vec<Statement>, mut now: OpenWay) -> Vec<OpenWay> {
        let mut out = Vec::new();
        for (test, then) in tests {
            // Tests of numbers alone, such as those of the variable of a loop, leave one way; so do those that conditions before have
            // decided, but what draws is tested all the same.
            let test = with_known(&test, &now.way);
            let draws = has_random(&test, &self.scope);
            let known = self.known_value(&test, &now.way).map(|value| !is_zero(value));
            let known = known.or_else(|| now.way.bounds.decide(&test, &self.scope).filter(|_| !draws));
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
            taken.way.steps.push(Step::Condition(test.clone(), true));
            taken.run_next(then);
            if draws || taken.way.bounds.refine(&test, true, &self.scope) {
                out.push(taken);
            }
            // Nothing is left beside these where one of the tests must hold.
            if !draws && !now.way.bounds.refine(&test, false, &self.scope) {
                return out;
            }
            now.way.steps.push(Step::Condition(test, false));
        }
        now.run_next(other);
        out.push(now);
        out
    }

    /// Writes a `for` out turn by turn, or makes it a `while`.
    fn for_loop(
        &mut self,
        name: String,
        list: &PyExpr,
        body: Vec<Statement>,
        place: Range<usize>,
        now: &mut OpenWay,
    ) -> Result<(), Refusal> {
        let why = match self.turns(&in_way(list, &now.way), &place) {
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
        if let Some(list) = self.list_of(list, &now.way) {
            return self.loop_over_items(&name, &list, &body, place, now);
        }
        // `range(from, end, step)` whose turns are not known counts them from 0.
        if let Some(counted) = self.counted(list, &now.way) {
            let mut turn = vec![Statement::Assign(name, counted.value)];
            turn.extend(body);
            now.left.push(Statement::For(counted.name, counted.turns, turn, place));
            now.left.push(counted.begin);
            return Ok(());
        }
        match range_end(list).filter(|_| only_computes(&body)) {
            Some(end) => self.loop_that_computes(name, end, body, place, now),
            None => {
                let (end, most) = self.last_turn(list, &now.way, &place).ok_or(why)?;
                self.bounded_loop(&name, end, most, &body, &place, now);
            }
        }
        Ok(())
    }

    /// The items of a list that are not constant are taken before the first turn.
    fn loop_over_items(
        &mut self,
        name: &str,
        list: &PyExpr,
        body: &[Statement],
        place: Range<usize>,
        now: &mut OpenWay,
    ) -> Result<(), Refusal> {
        let mut taken = Vec::new();
        let PyExpr::List(items, _) = self.kept(list, &now.way, &mut taken) else {
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

    /// A loop over `range(end)` that only computes runs as often as it must.
    fn loop_that_computes(
        &mut self,
        name: String,
        end: PyExpr,
        body: Vec<Statement>,
        place: Range<usize>,
        now: &mut OpenWay,
    ) {
        let [count, last] = ["turn", "end"].map(|word| format!("({word} {})", self.temporaries));
        self.temporaries += 1;
        let at = |n: &str| PyExpr::Name(n.to_owned(), place.clone());
        let test = PyExpr::Binary(PyOp::Lt, Box::new(at(&count)), Box::new(at(&last)));
        let next = PyExpr::Binary(PyOp::Add, Box::new(at(&count)), Box::new(PyExpr::Number(1.0)));
        // Counted first, so that `continue` does not pass over it.
        let mut turn = vec![Statement::Assign(name, at(&count)), Statement::Assign(count.clone(), next)];
        turn.extend(body);
        now.left.push(Statement::While(test, turn, place, 0));
        now.left.push(Statement::Assign(count, PyExpr::Number(0.0)));
        // Evaluated once: the body may change what it reads, and it may draw a random number.
        now.left.push(Statement::Assign(last, end));
    }

    /// A loop over `range(end)` as so many turns as there may be, each inside a condition that the loop gets that far.
    fn bounded_loop(
        &mut self,
        name: &String,
        end: PyExpr,
        most: u32,
        body: &[Statement],
        place: &Range<usize>,
        now: &mut OpenWay,
    ) {
        let count = format!("(turns {})", self.temporaries);
        self.temporaries += 1;
        now.way.bounds.assign(&count, &end, &self.scope);
        now.way.steps.push(Step::Assign(count.clone(), end));
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

    /// The ways behind the test of a `while`, the first to try first. `turn`: how many turns lie behind it.
    fn while_loop(
        &mut self,
        test: PyExpr,
        body: Vec<Statement>,
        place: Range<usize>,
        turn: u32,
        mut now: OpenWay,
    ) -> Result<Vec<OpenWay>, Refusal> {
        if turn == 0 {
            now.left.push(Statement::LoopEnd);
        }
        let known = self.known_value(&test, &now.way).map(|value| !is_zero(value));
        if known == Some(false) {
            return Ok(vec![now]);
        }
        let computes = only_computes(&body);
        // The test holds: a loop that makes modules is written out, so that what it makes is known, and so is one of the axiom, which
        // has no code of its own.
        if known.is_some() && (self.is_in_axiom || !computes || turn > 0) {
            if turn > MAX_KNOWN_TURNS {
                return Err(Refusal::new("'while' with too many turns", place));
            }
            // A `break` on a condition that is not known ends it: each turn makes a way, as a test would.
            let conditions = now.way.steps.iter().filter(|s| matches!(s, Step::Condition(..))).count();
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
                now.way.bounds.forget(name);
                now.way.lists.remove(name);
            }
            now.way.known.extend(names.into_iter().map(|name| (name, None)));
            now.way.globals.extend(globals);
            now.way.steps.push(Step::Loop(test, body, place));
            return Ok(vec![now]);
        }
        if turn == MAX_UNKNOWN {
            self.turns_left_out(place);
            return Ok(vec![now]);
        }
        let draws = has_random(&test, &self.scope);
        let mut taken = now.clone();
        taken.way.steps.push(Step::Condition(test.clone(), true));
        let goes_on = draws || taken.way.bounds.refine(&test, true, &self.scope);
        let ends = draws || now.way.bounds.refine(&test, false, &self.scope);
        taken.repeat(test.clone(), body, place, turn);
        now.way.steps.push(Step::Condition(test, false));
        Ok([Some(taken).filter(|_| goes_on), Some(now).filter(|_| ends)].into_iter().flatten().collect())
    }

    /// L008 for a `while` of more turns than are read.
    fn turns_left_out(&mut self, place: Range<usize>) {
        let at = self.reader.place(place);
        let message = format!("this 'while' makes modules: read with up to {MAX_UNKNOWN} turns");
        let help = "further turns are left out; make one module in a turn, by a production that repeats";
        self.reader.session.warning("L008", message, at, help);
    }

    /// Puts the statements of the first function of more than one expression that a statement calls before it, under names of
    /// their own, with the name of the value in place of the call; false for a statement without such a call.
    fn call(&mut self, s: &Statement, way: &mut Way, left: &mut Vec<Statement>) -> Result<bool, Refusal> {
        if self.bodies.is_empty() {
            return Ok(false);
        }
        let Some(call) = call_in(s, &|name| self.has_body(name)) else { return Ok(false) };
        let PyExpr::Call(function, args, place) = &call else { return Ok(false) };
        let Some((params, body)) = self.bodies.get(function).cloned() else { return Ok(false) };
        way.calls += 1;
        if way.calls > MAX_CALLS {
            return Err(Refusal::new(
                format!("more than {MAX_CALLS} calls of functions in a production"),
                place.clone(),
            ));
        }
        let args = arguments(&params, self.scope.defaults.get(function), args.clone());
        let args = args.ok_or_else(|| Refusal::new(format!("this call of '{function}'"), place.clone()))?;
        let mut names = names_of(&body).0;
        names.extend(params.iter().cloned());
        let number = self.temporaries;
        self.temporaries += 1;
        let mut own: Vec<String> = names.iter().map(|name| format!("{name} ({number})")).collect();
        // The function reads values of the model where the production has variables of their names.
        let others = self.scope.locals.iter().chain(way.known.keys()).chain(way.lists.keys());
        let others: BTreeSet<&String> =
            others.filter(|name| !name.contains('(') && !names.contains(name) && read_name(&body, name)).collect();
        let others: Vec<String> = others.into_iter().filter(|name| !way.globals.contains(name)).cloned().collect();
        if let Some(name) = others.iter().find(|name| self.shared.contains(name)) {
            let why = format!("a call of '{function}', which reads a '{name}' that this production has, too");
            let why = Refusal::new(why, place.clone());
            return Err(why.remedy("give the variable of the production another name"));
        }
        own.extend(others.iter().map(|name| model_name(name)));
        names.extend(others);
        let result = format!("(result {number})");
        let value = PyExpr::Name(result.clone(), place.clone());
        // `a, b = f(x)` takes both items of one value.
        for next in left.iter_mut().rev().take_while(|s| matches!(s, Statement::Assign(..))) {
            *next = without_call(next, &call, &value);
        }
        left.push(without_call(s, &call, &value));
        left.push(Statement::FunctionEnd(result, function.clone(), place.clone()));
        left.extend(body.iter().rev().map(|s| renamed(s, &names, &own)));
        let set = params.iter().zip(args).map(|(p, value)| {
            let name = names.iter().position(|n| n == p).and_then(|i| own.get(i)).unwrap_or(p);
            Statement::Assign(name.clone(), value)
        });
        left.extend(set);
        Ok(true)
    }

    /// The list that an expression is; `None` for any other.
    fn list_of(&self, e: &PyExpr, way: &Way) -> Option<PyExpr> {
        if matches!(e, PyExpr::List(..)) {
            return Some(e.clone());
        }
        let is_list = self.may_be_list(e) && matches!(resolve(&in_way(e, way), &self.scope, 0), Ok(PyExpr::List(..)));
        // The items keep the names of variables whose values are not known.
        let list = is_list.then(|| resolve(&with_known(e, way), &self.scope_of(way), 0).ok()).flatten();
        list.filter(|e| matches!(e, PyExpr::List(..)))
    }

    /// False for an expression that is no list whatever its names are; it need not be resolved.
    fn may_be_list(&self, e: &PyExpr) -> bool {
        match e {
            PyExpr::List(..) | PyExpr::Index(..) | PyExpr::Each(..) => true,
            PyExpr::Name(name, _) => self.scope.lists.contains_key(plain_name(name)),
            PyExpr::Binary(PyOp::Add | PyOp::Mul, a, b) => self.may_be_list(a) || self.may_be_list(b),
            PyExpr::Call(name, ..) => {
                // `[[]]` is a list over several lists.
                matches!(name.as_str(), "range" | "xrange" | "list" | "tuple" | "reversed" | "sorted" | "divmod")
                    || matches!(name.as_str(), "enumerate" | "zip" | ".keys" | ".values" | ".items" | ".copy" | "[[]]")
                    || self.scope.functions.contains_key(name)
                    || is_change(e)
            }
            _ => false,
        }
    }

    /// The scope of the production with the variables that a way has assigned.
    fn scope_of(&self, way: &Way) -> Scope {
        let own = way.known.keys().filter(|name| !self.scope.locals.contains(name));
        let mut scope = self.scope.clone();
        scope.locals.extend(own.cloned());
        scope
    }

    /// A list of numbers, and of variables that the statements `taken` set, so that it may be read at any time.
    fn kept(&mut self, e: &PyExpr, way: &Way, taken: &mut Vec<Statement>) -> PyExpr {
        let is_kept = matches!(e, PyExpr::Name(name, _) if name.starts_with("(item "));
        if is_written_out(e) || is_kept {
            return e.clone();
        }
        if let Some(PyExpr::List(items, place)) = self.list_of(e, way) {
            let items = items.iter().map(|e| self.kept(e, way, taken)).collect();
            return PyExpr::List(items, place);
        }
        let name = format!("(item {})", self.temporaries);
        self.temporaries += 1;
        taken.push(Statement::Assign(name.clone(), e.clone()));
        PyExpr::Name(name, range_of(e))
    }

    /// Value of an expression after the steps of a way, if it is a number whatever the parameters are.
    fn known_value(&self, e: &PyExpr, way: &Way) -> Option<f64> {
        let code = compile(&in_way(e, way), &self.scope).ok()?;
        vm::constant_value(&code).filter(|v| !v.is_nan())
    }

    /// True for an expression with a call of a function of the model: where its value is known, the number stands in its place, as the
    /// function may call itself until a test of such numbers ends it.
    fn calls_function(&self, e: &PyExpr) -> bool {
        first_call(e, &|name| self.scope.functions.contains_key(name)).is_some()
    }

    /// Values that the variable of a `for` loop takes, one per turn; a list that is not constant is refused.
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

    /// The parts of a loop over `range(from, end)` or `range(from, end, step)`, the step constant; `None` for any other list.
    fn counted(&mut self, list: &PyExpr, way: &Way) -> Option<CountedRange> {
        let PyExpr::Call(function, args, place) = list else { return None };
        let (from, end, step) = match args.as_slice() {
            [from, end] => (from, end, 1.0),
            [from, end, step] => (from, end, self.known_value(step, way).filter(|step| step.abs() > 0.0)?),
            _ => return None,
        };
        if !function.ends_with("range") {
            return None;
        }
        let [begin, count] = ["begin", "count"].map(|word| format!("({word} {})", self.temporaries));
        self.temporaries += 1;
        let at = |name: &str| PyExpr::Name(name.to_owned(), place.clone());
        let two = |op, a: PyExpr, b: PyExpr| PyExpr::Binary(op, Box::new(a), Box::new(b));
        // A beginning that is constant stays a number, so that a largest number of turns is found.
        let first = self.known_value(from, way).map_or_else(|| at(&begin), PyExpr::Number);
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

    /// The end of `range(end)` and how many turns are read: the most that there may be, else [`MAX_UNKNOWN`] with a warning L008.
    fn last_turn(&mut self, list: &PyExpr, way: &Way, place: &Range<usize>) -> Option<(PyExpr, u32)> {
        let PyExpr::Call(name, args, _) = list else { return None };
        let [end] = args.as_slice() else { return None };
        let constant = compile(&in_way(end, way), &self.scope).ok().and_then(|code| vm::constant_value(&code));
        if !name.ends_with("range") || constant.is_some() || !self.is_readable(end, way) {
            return None;
        }
        let most = self.at_most(end, &way.steps, 0).map(f64::ceil).filter(|m| *m <= MAX_COUNTED);
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

    /// True if all names of an expression are known after the steps of a way.
    fn is_readable(&self, e: &PyExpr, way: &Way) -> bool {
        let mut scope = self.scope.clone();
        for step in &way.steps {
            match step {
                Step::Assign(name, _) => {
                    scope.local(name);
                }
                Step::Loop(_, body, _) => names_of(body).0.iter().for_each(|name| {
                    scope.local(name);
                }),
                Step::Condition(..) => {}
            }
        }
        compile(e, &scope).is_ok()
    }

    /// Upper bound on the value of an expression after these steps of a way; `None` if none is found.
    fn at_most(&self, e: &PyExpr, steps: &[Step], depth: usize) -> Option<f64> {
        if depth > 32 {
            return None;
        }
        let of = |e: &PyExpr| self.at_most(e, steps, depth + 1);
        // Variables of the way hide values of the model.
        let fixed = |e: &PyExpr| {
            let code = compile(e, &self.scope).ok()?;
            vm::constant_value(&code).filter(|_| !steps.iter().any(|s| s.changes(e)))
        };
        match e {
            PyExpr::Name(name, _) => {
                // The last assignment before this place counts; what it reads was assigned before it.
                let last = steps.iter().enumerate().rev().find_map(|(i, s)| match s {
                    Step::Assign(n, e) if n == name => Some((i, Some(e))),
                    // A loop may assign anything.
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
            // Bounds hold for divisors and factors that are constant and not negative; a dividend below 0 is at most 0.
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
                // A function of the model: its body with the arguments in place of its parameters.
                _ => {
                    let (params, body) = self.scope.functions.get(name).filter(|f| f.0.len() == args.len())?;
                    (size_with(body, params, args) <= MAX_STEPS).then(|| of(&substitute(body, params, args))).flatten()
                }
            },
            _ => fixed(e),
        }
    }

    /// Adds modules to a way. Their parameters are computed now, for variables may change afterwards.
    fn produce(&mut self, way: &mut Way, modules: &[PyModule], ends: bool) {
        for m in modules {
            let mut module = m.clone();
            // A list that cannot be read is refused where the successor is made.
            if m.args.iter().any(|arg| matches!(arg, PyExpr::Call(star, ..) if star == "*"))
                && let Ok(args) = spread(&m.args, &self.scope_of(way))
            {
                module.args = args;
            }
            for arg in &mut module.args {
                let value = if self.calls_function(arg) { self.known_value(arg, way) } else { None };
                if let Some(value) = value {
                    *arg = PyExpr::Number(value);
                }
            }
            for arg in module.args.iter_mut().filter(|a| !ends && !matches!(a, PyExpr::Number(_) | PyExpr::Text(..))) {
                let name = format!("(value {})", self.temporaries);
                self.temporaries += 1;
                let value = std::mem::replace(arg, PyExpr::Name(name.clone(), m.range.clone()));
                way.steps.push(Step::Assign(name, value));
            }
            way.modules.push(module);
        }
    }
}
