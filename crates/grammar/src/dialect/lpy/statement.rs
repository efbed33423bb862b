//! Statements of productions and functions, and the names that they read and set.

use std::collections::BTreeMap;
use std::ops::Range;

use super::expression::{PyExpr, PyOp, exchanged, first_call, is_change, is_none, mentions, substitute};
use super::strings::PyModule;

/// Variable that holds the number of the active group of productions; no model can contain its name.
pub(super) const GROUP: &str = "(group)";

/// Variable that is not 0 in steps that rewrite from the end of the string, if the model changes the direction.
pub(super) const DIRECTION: &str = "(backward)";

/// Limit on the nesting of blocks in a production, since the reader is recursive.
pub(super) const MAX_NESTING: usize = 64;

#[derive(Debug, Clone)]
pub(super) enum Statement {
    Assign(String, PyExpr),
    /// Tests with their blocks, then the block of `else`.
    If(Vec<(PyExpr, Vec<Statement>)>, Vec<Statement>),
    /// A `for` loop: variable, list of its values, body, place.
    For(String, PyExpr, Vec<Statement>, Range<usize>),
    /// Adds modules to the successor; true if it then ends the production.
    Produce(Vec<PyModule>, bool),
    /// Names declared `global`, whose assignments change variables of the model.
    Global(Vec<String>),
    /// A `while` loop: test, body, place of the heading, and number of iterations unrolled before.
    While(PyExpr, Vec<Statement>, Range<usize>, u32),
    Break(Range<usize>),
    Continue(Range<usize>),
    /// Sets an item of a list that productions change.
    Store(Store),
    /// `Stop()`: the derivation ends after the present step.
    Stop(Range<usize>),
    /// Target of `continue` in an unrolled loop.
    TurnEnd,
    /// Target of `break` in an unrolled loop.
    LoopEnd,
    /// A call of a function for the modules that it makes.
    Run(PyExpr),
    /// Target of the `return` of an inlined function: variable for the value, `None` for a function called for its modules;
    /// name of the function, place of the call.
    FunctionEnd(Option<String>, String, Range<usize>),
    /// `return` with a value in a function, without one in a production.
    Return(Option<PyExpr>, Range<usize>),
    Pass,
}

/// A store of an item of a list that productions change.
#[derive(Debug, Clone)]
pub(super) struct Store {
    pub list: String,
    pub index: PyExpr,
    /// True if the index is checked: below 0 it counts from the end, and outside of the list it is reported.
    pub is_checked: bool,
    pub value: PyExpr,
}

impl Store {
    /// The store with its expressions replaced by `read`.
    pub fn mapped(&self, read: &dyn Fn(&PyExpr) -> PyExpr) -> Self {
        Self { index: read(&self.index), value: read(&self.value), ..self.clone() }
    }
}

impl Statement {
    /// The statement in which `read` replaces all expressions, also in nested blocks, and `own` the names that it sets.
    pub fn mapped(&self, own: &dyn Fn(&String) -> String, read: &dyn Fn(&PyExpr) -> PyExpr) -> Self {
        let all = |list: &[Self]| list.iter().map(|s| s.mapped(own, read)).collect::<Vec<_>>();
        match self {
            Self::Assign(name, e) => Self::Assign(own(name), read(e)),
            Self::Run(e) => Self::Run(read(e)),
            Self::Store(store) => Self::Store(store.mapped(read)),
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
            | Self::Stop(_)
            | Self::TurnEnd
            | Self::LoopEnd
            | Self::FunctionEnd(..)
            | Self::Pass => self.clone(),
        }
    }
}

/// A statement in which a name that it does not set is replaced by an expression.
pub(super) fn replaced(s: &Statement, name: &String, by: &PyExpr) -> Statement {
    s.mapped(&String::clone, &|e| substitute(e, std::slice::from_ref(name), std::slice::from_ref(by)))
}

/// A statement with names replaced by other names, also where it sets them.
pub(super) fn renamed(s: &Statement, names: &[String], others: &[String]) -> Statement {
    let values: Vec<PyExpr> = others.iter().map(|other| PyExpr::Name(other.clone(), 0..0)).collect();
    let own = |name: &String| names.iter().position(|n| n == name).and_then(|i| others.get(i)).unwrap_or(name).clone();
    s.mapped(&own, &|e| substitute(e, names, &values))
}

/// A statement with names of lists replaced by the lists. Nested blocks that may set such a name keep it, and read it when
/// they are reached.
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

/// A statement in one iteration of a loop, in which lists of nested loops may contain the loop variable.
pub(super) fn in_turn(s: &Statement, name: &String, value: f64) -> Statement {
    // Nothing else sets the variable of a counter, so that its value can replace it everywhere.
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
            // Lists of loops must be constant and need the number now; elsewhere the variable is read as assigned for this iteration.
            let list = substitute(list, std::slice::from_ref(name), &[PyExpr::Number(value)]);
            Statement::For(own.clone(), list, all(body), place.clone())
        }
        Statement::While(test, body, place, turn) => Statement::While(test.clone(), all(body), place.clone(), *turn),
        other => other.clone(),
    }
}

/// The statements of a loop with an assignment of 1 to a variable before each `break` of the loop.
pub(super) fn noting_breaks(list: Vec<Statement>, name: &str) -> Vec<Statement> {
    let mut out = Vec::with_capacity(list.len());
    for s in list {
        match s {
            Statement::Break(_) => out.extend([Statement::Assign(name.to_owned(), PyExpr::Number(1.0)), s]),
            Statement::If(tests, other) => {
                let tests = tests.into_iter().map(|(test, then)| (test, noting_breaks(then, name))).collect();
                out.push(Statement::If(tests, noting_breaks(other, name)));
            }
            // A `break` in a nested loop ends only that loop.
            _ => out.push(s),
        }
    }
    out
}

/// The first call of a function for which `is_one` holds in the expressions that a statement reads before its nested blocks
/// run; `None` for the test of a `while`, which is evaluated in each iteration.
pub(super) fn call_in(s: &Statement, is_one: &dyn Fn(&str) -> bool) -> Option<PyExpr> {
    let of = |e: &PyExpr| first_call(e, is_one).cloned();
    match s {
        Statement::Assign(_, e) | Statement::Run(e) | Statement::Return(Some(e), _) | Statement::For(_, e, _, _) => {
            of(e)
        }
        Statement::Store(store) => of(&store.index).or_else(|| of(&store.value)),
        Statement::If(tests, _) => tests.iter().find_map(|(test, _)| of(test)),
        Statement::Produce(modules, _) => modules.iter().flat_map(|m| &m.args).find_map(of),
        _ => None,
    }
}

/// A statement in which a call that [`call_in`] found is replaced by an expression.
pub(super) fn without_call(s: &Statement, call: &PyExpr, by: &PyExpr) -> Statement {
    let read = |e: &PyExpr| exchanged(e, call, by);
    match s {
        Statement::Assign(name, e) => Statement::Assign(name.clone(), read(e)),
        Statement::Run(e) => Statement::Run(read(e)),
        Statement::Store(store) => Statement::Store(store.mapped(&read)),
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

/// Appends the expressions of statements, including those of nested blocks.
fn append_expressions<'s>(statements: &'s [Statement], out: &mut Vec<&'s PyExpr>) {
    for s in statements {
        match s {
            Statement::Assign(_, e) | Statement::Run(e) | Statement::Return(Some(e), _) => out.push(e),
            Statement::Store(store) => out.extend([&store.index, &store.value]),
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

/// True if the statements read the name.
pub(super) fn read_name(statements: &[Statement], name: &str) -> bool {
    let mut all = Vec::new();
    append_expressions(statements, &mut all);
    all.into_iter().any(|e| mentions(e, name))
}

/// Appends the names that statements assign, and those that they declare `global`.
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

/// The names that statements assign, and those that they declare `global`.
pub(super) fn names_of(statements: &[Statement]) -> (Vec<String>, Vec<String>) {
    let (mut names, mut globals) = (Vec::new(), Vec::new());
    assigned(statements, &mut names, &mut globals);
    (names, globals)
}

/// True if the statements change the list with this name.
pub(super) fn changes(statements: &[Statement], name: &str) -> bool {
    statements.iter().any(|s| match s {
        Statement::Assign(own, e) => own == name && is_change(e),
        Statement::If(tests, other) => tests.iter().any(|(_, then)| changes(then, name)) || changes(other, name),
        Statement::For(_, _, body, _) | Statement::While(_, body, ..) => changes(body, name),
        _ => false,
    })
}

/// True if statements set a name to another value than a change of its own value. Statements that run only if its value is `None`
/// do not count.
pub(super) fn sets_anew(statements: &[Statement], name: &str) -> bool {
    let is_of_none = |test: &PyExpr| match test {
        PyExpr::Binary(PyOp::Eq, a, b) => {
            matches!((&**a, &**b), (PyExpr::Name(own, _), PyExpr::Text(value, _)) if own == name && is_none(*value))
        }
        PyExpr::Call(bool, args, _) if bool == "bool" => {
            matches!(args.as_slice(), [PyExpr::Binary(PyOp::Eq, a, b)]
                if matches!((&**a, &**b), (PyExpr::Name(own, _), PyExpr::Text(value, _)) if own == name && is_none(*value)))
        }
        _ => false,
    };
    statements.iter().any(|s| match s {
        Statement::Assign(own, e) => own == name && !is_change(e),
        Statement::If(tests, other) => {
            let anew = |(test, then): &(PyExpr, Vec<Statement>)| !is_of_none(test) && sets_anew(then, name);
            tests.iter().any(anew) || sets_anew(other, name)
        }
        Statement::For(own, _, body, _) => own == name || sets_anew(body, name),
        Statement::While(_, body, ..) => sets_anew(body, name),
        _ => false,
    })
}

/// True if statements set items of lists that productions change.
pub(super) fn stores(statements: &[Statement]) -> bool {
    statements.iter().any(|s| match s {
        Statement::Store(_) => true,
        Statement::If(tests, other) => tests.iter().any(|(_, then)| stores(then)) || stores(other),
        Statement::For(_, _, body, _) | Statement::While(_, body, ..) => stores(body),
        _ => false,
    })
}

/// True if statements only compute, so that a loop of them can be compiled to code with any number of iterations.
pub(super) fn only_computes(statements: &[Statement]) -> bool {
    statements.iter().all(|s| match s {
        Statement::If(tests, other) => tests.iter().all(|(_, then)| only_computes(then)) && only_computes(other),
        Statement::For(_, _, body, _) | Statement::While(_, body, ..) => only_computes(body),
        Statement::Produce(..) | Statement::Run(_) | Statement::Return(..) => false,
        Statement::Assign(_, e) => !is_change(e),
        _ => true,
    })
}

/// The reason why productions may not call a function with these statements; `None` if they may.
pub(super) fn hindrance(statements: &[Statement]) -> Option<&'static str> {
    statements.iter().find_map(|s| match s {
        Statement::If(tests, other) => tests.iter().find_map(|(_, then)| hindrance(then)).or_else(|| hindrance(other)),
        Statement::For(_, _, body, _) | Statement::While(_, body, ..) => hindrance(body),
        Statement::Produce(_, true) => Some("its 'produce' ends the production: write 'nproduce'"),
        _ => None,
    })
}
