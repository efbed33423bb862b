//! Bounds of variables on an execution path through a production, derived from its conditions, so that impossible paths are
//! omitted. A loop `for i in range(int(n))` that contains `if i < n - 1` then has two paths for each number of iterations,
//! instead of two to the power of that number.

use std::collections::BTreeMap;

use super::expression::{PyExpr, PyOp, mentions};
use super::scope::Scope;

/// Limit on the nesting of expressions whose bounds are derived.
const MAX_DEPTH: usize = 32;

/// Smallest and largest value.
type Interval = (f64, f64);

const ANY: Interval = (f64::NEG_INFINITY, f64::INFINITY);

/// Known bounds of the variables on an execution path.
#[derive(Debug, Clone, Default)]
pub(super) struct Bounds {
    intervals: BTreeMap<String, Interval>,
    /// Variables and the expressions that they equal, removed when a variable in the expression changes.
    equal: BTreeMap<String, PyExpr>,
}

fn call<'e>(e: &'e PyExpr, names: &[&str]) -> Option<&'e PyExpr> {
    match e {
        PyExpr::Call(name, args, _) if names.contains(&name.as_str()) && args.len() == 1 => args.first(),
        _ => None,
    }
}

impl Bounds {
    /// Records the assignment of a value to a variable.
    pub fn assign(&mut self, name: &str, e: &PyExpr, scope: &Scope) {
        let interval = self.of(e, scope, 0);
        self.forget(name);
        self.intervals.insert(name.to_owned(), interval);
        if !mentions(e, name) {
            self.equal.insert(name.to_owned(), e.clone());
        }
    }

    /// Discards everything known about a variable.
    pub fn forget(&mut self, name: &str) {
        self.equal.retain(|n, e| n != name && !mentions(e, name));
        self.intervals.insert(name.to_owned(), ANY);
    }

    /// Smallest and largest value of an expression.
    fn of(&self, e: &PyExpr, scope: &Scope, depth: usize) -> Interval {
        if depth > MAX_DEPTH {
            return ANY;
        }
        let of = |e: &PyExpr| self.of(e, scope, depth + 1);
        let (low, high) = match e {
            PyExpr::Number(n) => (*n, *n),
            PyExpr::Name(name, _) => match (self.intervals.get(name), scope.constants.get(name)) {
                (Some(interval), _) => *interval,
                (None, Some(v)) if !scope.locals.contains(name) => (*v, *v),
                _ => ANY,
            },
            PyExpr::Neg(a) => {
                let (low, high) = of(a);
                (-high, -low)
            }
            PyExpr::Binary(PyOp::Add, a, b) => {
                let (a, b) = (of(a), of(b));
                (a.0 + b.0, a.1 + b.1)
            }
            PyExpr::Binary(PyOp::Sub, a, b) => {
                let (a, b) = (of(a), of(b));
                (a.0 - b.1, a.1 - b.0)
            }
            _ => match call(e, &["int", "trunc"]) {
                Some(a) => {
                    let (low, high) = of(a);
                    (low.trunc(), high.trunc())
                }
                None => ANY,
            },
        };
        if low.is_nan() || high.is_nan() { ANY } else { (low, high) }
    }

    /// True if the value is certainly an integer.
    fn is_whole(&self, e: &PyExpr, depth: usize) -> bool {
        if depth > MAX_DEPTH {
            return false;
        }
        match e {
            PyExpr::Number(n) => n.fract().abs() <= 0.0,
            PyExpr::Name(name, _) => self.equal.get(name).is_some_and(|e| self.is_whole(e, depth + 1)),
            PyExpr::Binary(PyOp::Add | PyOp::Sub | PyOp::Mul, a, b) => {
                self.is_whole(a, depth + 1) && self.is_whole(b, depth + 1)
            }
            _ => call(e, &["int", "trunc", "floor", "ceil", "round"]).is_some(),
        }
    }

    /// Value of a test if the bounds determine it.
    pub fn decide(&self, test: &PyExpr, scope: &Scope) -> Option<bool> {
        match test {
            PyExpr::Not(a) => self.decide(a, scope).map(|v| !v),
            PyExpr::And(a, b) => match (self.decide(a, scope), self.decide(b, scope)) {
                (Some(true), Some(true)) => Some(true),
                (Some(false), _) => Some(false),
                _ => None,
            },
            PyExpr::Or(a, b) => match (self.decide(a, scope), self.decide(b, scope)) {
                (Some(false), Some(false)) => Some(false),
                (Some(true), _) => Some(true),
                _ => None,
            },
            PyExpr::Binary(op, a, b) => {
                let (a, b) = (self.of(a, scope, 0), self.of(b, scope, 0));
                let less = |a: Interval, b: Interval| {
                    let (holds, fails) = (a.1 < b.0, a.0 >= b.1);
                    (holds || fails).then_some(holds)
                };
                match op {
                    PyOp::Lt => less(a, b),
                    PyOp::Gt => less(b, a),
                    PyOp::Ge => less(a, b).map(|v| !v),
                    PyOp::Le => less(b, a).map(|v| !v),
                    _ => None,
                }
            }
            _ => None,
        }
    }

    /// Narrows the bounds by the value of a test; false if no values remain.
    pub fn refine(&mut self, test: &PyExpr, value: bool, scope: &Scope) -> bool {
        match test {
            PyExpr::Not(a) => self.refine(a, !value, scope),
            PyExpr::And(a, b) if value => self.refine(a, true, scope) && self.refine(b, true, scope),
            PyExpr::Or(a, b) if !value => self.refine(a, false, scope) && self.refine(b, false, scope),
            PyExpr::Binary(op, a, b) => {
                // Write every comparison as `left < right`, or as `left <= right` if `strict` is false.
                let (left, right, strict) = match (op, value) {
                    (PyOp::Lt, true) => (a, b, true),
                    (PyOp::Lt, false) => (b, a, false),
                    (PyOp::Le, true) => (a, b, false),
                    (PyOp::Le, false) => (b, a, true),
                    (PyOp::Gt, true) => (b, a, true),
                    (PyOp::Gt, false) => (a, b, false),
                    (PyOp::Ge, true) => (b, a, false),
                    (PyOp::Ge, false) => (a, b, true),
                    _ => return true,
                };
                let step = if strict && self.is_whole(left, 0) && self.is_whole(right, 0) { 1.0 } else { 0.0 };
                let (low, high) = (self.of(left, scope, 0).0 + step, self.of(right, scope, 0).1 - step);
                self.narrow(left, (f64::NEG_INFINITY, high), scope, 0)
                    && self.narrow(right, (low, f64::INFINITY), scope, 0)
            }
            _ => true,
        }
    }

    /// Makes an expression lie in an interval; false if it cannot.
    fn narrow(&mut self, e: &PyExpr, to: Interval, scope: &Scope, depth: usize) -> bool {
        if depth > MAX_DEPTH || to.0.is_nan() || to.1.is_nan() {
            return true;
        }
        let (low, high) = self.of(e, scope, 0);
        if low.max(to.0) > high.min(to.1) {
            return false;
        }
        match e {
            PyExpr::Name(name, _) => {
                self.intervals.insert(name.clone(), (low.max(to.0), high.min(to.1)));
                match self.equal.get(name).cloned() {
                    Some(same) => self.narrow(&same, to, scope, depth + 1),
                    None => true,
                }
            }
            PyExpr::Binary(PyOp::Add, a, b) => {
                let (of_a, of_b) = (self.of(a, scope, 0), self.of(b, scope, 0));
                self.narrow(a, (to.0 - of_b.1, to.1 - of_b.0), scope, depth + 1)
                    && self.narrow(b, (to.0 - of_a.1, to.1 - of_a.0), scope, depth + 1)
            }
            PyExpr::Binary(PyOp::Sub, a, b) => {
                let (of_a, of_b) = (self.of(a, scope, 0), self.of(b, scope, 0));
                self.narrow(a, (to.0 + of_b.0, to.1 + of_b.1), scope, depth + 1)
                    && self.narrow(b, (of_a.0 - to.1, of_a.1 - to.0), scope, depth + 1)
            }
            _ => match call(e, &["int", "trunc"]) {
                // int(x) >= 1 needs x >= 1, and int(x) <= k leaves x below k + 1.
                Some(a) => {
                    let low = if to.0 >= 1.0 { to.0 } else { f64::NEG_INFINITY };
                    let high = if to.1 >= 0.0 { to.1 + 1.0 } else { to.1 };
                    self.narrow(a, (low, high), scope, depth + 1)
                }
                None => true,
            },
        }
    }
}
