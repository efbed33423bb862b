//! An execution path through a production: its computations and the modules that it makes.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;

use super::bounds::Bounds;
use super::expression::{PyExpr, UNKNOWN, mentions, substitute};
use super::statement::{Statement, Store, names_of, read_name, stores};
use super::strings::PyModule;

/// Limit on the statements of one execution path.
pub(super) const MAX_STEPS: usize = 20_000;

/// One step of an execution path: an assignment, or a condition with its value on this path.
#[derive(Debug, Clone)]
pub(super) enum Step {
    Assign(String, PyExpr),
    Condition(PyExpr, bool),
    /// Sets an item of a list that productions change.
    Store(Store),
    /// A `while` loop of statements that only compute.
    Loop(PyExpr, Vec<Statement>, Range<usize>),
}

impl Step {
    pub fn assigns(&self, name: &str) -> bool {
        match self {
            Self::Assign(n, _) => n == name,
            Self::Condition(..) | Self::Store(..) => false,
            Self::Loop(_, body, _) => names_of(body).0.iter().any(|n| n == name),
        }
    }

    /// True if an expression reads a variable that the step assigns.
    pub fn changes(&self, e: &PyExpr) -> bool {
        match self {
            Self::Assign(name, _) => mentions(e, name),
            Self::Condition(..) | Self::Store(..) => false,
            Self::Loop(_, body, _) => names_of(body).0.iter().any(|name| mentions(e, name)),
        }
    }
}

/// An execution path through the statements of a production.
#[derive(Debug, Clone, Default)]
pub(super) struct ExecutionPath {
    pub steps: Vec<Step>,
    pub modules: Vec<PyModule>,
    /// True if the path makes modules, or ends with `produce`.
    pub produced: bool,
    /// Names declared `global` on the path.
    pub globals: Vec<String>,
    /// Variables that the path has assigned, with their values if these do not depend on parameters.
    pub known: BTreeMap<String, Option<f64>>,
    /// Variables that the path has set to lists; the lists replace the names where they are read.
    pub lists: BTreeMap<String, PyExpr>,
    /// Names, of these lists and of the model's, whose list also has another name.
    pub shared_lists: BTreeSet<String>,
    /// Variables whose objects the path has changed, and those whose objects it has passed to a module.
    pub changed_objects: BTreeSet<String>,
    pub handed_objects: BTreeSet<String>,
    /// Bounds of the path's variables under its conditions.
    pub bounds: Bounds,
    /// Number of functions called on the path.
    pub calls: usize,
}

impl ExecutionPath {
    /// Names declared `global` on the path that it also assigns.
    pub fn written(&self) -> Vec<&String> {
        let assigns = |name: &String| self.steps.iter().any(|s| s.assigns(name));
        self.globals.iter().filter(|g| assigns(g)).collect()
    }

    /// True if the path changes a list of the model.
    pub fn stores(&self) -> bool {
        self.steps.iter().any(|step| match step {
            Step::Store(..) => true,
            Step::Loop(_, body, _) => stores(body),
            Step::Assign(..) | Step::Condition(..) => false,
        })
    }

    /// True if the path reads a variable that it does not set.
    pub fn misses(&self, name: &str) -> bool {
        let is_set = self.known.contains_key(name) || self.lists.contains_key(name);
        let reads = |step: &Step| match step {
            Step::Assign(_, e) | Step::Condition(e, _) => mentions(e, name),
            Step::Store(store) => mentions(&store.index, name) || mentions(&store.value, name),
            Step::Loop(test, body, _) => mentions(test, name) || read_name(body, name),
        };
        let is_read =
            || self.steps.iter().any(reads) || self.modules.iter().flat_map(|m| &m.args).any(|arg| mentions(arg, name));
        !is_set && is_read()
    }

    /// Place of the path's modules in the text, for messages.
    pub fn range(&self) -> Range<usize> {
        self.modules.first().map_or(0..0, |m| m.range.clone())
    }
}

/// The expression in which the variables of an execution path are replaced by their values, which hide those of the model;
/// [`UNKNOWN`] replaces variables of unknown value, so that the expression is not constant.
pub(super) fn on_path(e: &PyExpr, path: &ExecutionPath) -> PyExpr {
    let names: Vec<String> = path.known.keys().cloned().collect();
    let unknown = || PyExpr::Name(UNKNOWN.to_owned(), 0..0);
    let values: Vec<PyExpr> = path.known.values().map(|v| v.map_or_else(unknown, PyExpr::Number)).collect();
    substitute(e, &names, &values)
}

/// The expression in which those variables of an execution path whose values are known are replaced by them.
pub(super) fn with_known(e: &PyExpr, path: &ExecutionPath) -> PyExpr {
    let known = path.known.iter().filter_map(|(name, value)| Some((name.clone(), PyExpr::Number((*value)?))));
    let (names, values): (Vec<String>, Vec<PyExpr>) = known.unzip();
    substitute(e, &names, &values)
}

/// An execution path with statements that are not processed yet.
#[derive(Debug, Clone)]
pub(super) struct OpenPath {
    pub path: ExecutionPath,
    /// The remaining statements: a stack whose last entry is next.
    pub left: Vec<Statement>,
}

impl OpenPath {
    /// Inserts a block before the remaining statements.
    pub fn run_next(&mut self, block: Vec<Statement>) {
        self.left.extend(block.into_iter().rev());
    }

    /// Inserts an iteration of a `while` loop before the remaining statements, and the loop again after it.
    pub fn repeat(&mut self, test: PyExpr, body: Vec<Statement>, place: Range<usize>, turn: u32) {
        self.left.push(Statement::While(test, body.clone(), place, turn + 1));
        self.left.push(Statement::TurnEnd);
        self.run_next(body);
    }

    /// The finished execution path; `produced` is set if it has made modules.
    pub fn ended(self) -> ExecutionPath {
        let produced = self.path.produced || !self.path.modules.is_empty();
        ExecutionPath { produced, ..self.path }
    }
}
