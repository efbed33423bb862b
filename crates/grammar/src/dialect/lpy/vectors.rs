//! `Vector2`, `Vector3` and `Vector4` of PlantGL, represented as calls of these names with one number for each coordinate.

use std::ops::Range;

use osier_base::convert::saturating_index;

use super::expression::{PyExpr, PyOp, range_of};
use super::refusal::Refusal;
use super::scope::{Scope, has_random};

/// Names of the vector types, with their numbers of coordinates.
const KINDS: [(&str, usize); 3] = [("Vector2", 2), ("Vector3", 3), ("Vector4", 4)];
/// Names of the coordinates.
pub(super) const AXES: [&str; 4] = ["x", "y", "z", "w"];

/// The coordinates of a resolved vector; `None` for other expressions.
pub(super) fn coordinates_of(e: &PyExpr) -> Option<&[PyExpr]> {
    let PyExpr::Call(name, items, _) = e else { return None };
    KINDS.contains(&(name.as_str(), items.len())).then_some(items.as_slice())
}

/// True for a call that makes a vector, or returns one.
pub(super) fn gives_vector(name: &str) -> bool {
    dimension(name).is_some() || matches!(name, "cross" | "direction")
}

/// Number of coordinates of the vector type with this name; `None` for other names.
pub(super) fn dimension(name: &str) -> Option<usize> {
    KINDS.iter().find(|(kind, _)| *kind == name).map(|(_, count)| *count)
}

/// Makes a vector of 2 to 4 coordinates.
pub(super) fn vector(items: Vec<PyExpr>, range: Range<usize>) -> PyExpr {
    let kind = KINDS.iter().find(|(_, count)| *count == items.len()).map_or("Vector3", |(kind, _)| kind);
    PyExpr::Call(kind.to_owned(), items, range)
}

/// Applies a binary operator to two operands.
fn binary(op: PyOp, a: &PyExpr, b: &PyExpr) -> PyExpr {
    PyExpr::Binary(op, Box::new(a.clone()), Box::new(b.clone()))
}

/// Result of a function with resolved arguments, if these are vectors or the result is one; `None` for other calls.
pub(super) fn function(
    name: &str,
    args: &[PyExpr],
    scope: &Scope,
    range: &Range<usize>,
) -> Option<Result<PyExpr, Refusal>> {
    if let Some(count) = dimension(name) {
        return Some(made(name, count, args, range));
    }
    let vectors: Option<Vec<&[PyExpr]>> = args.iter().map(coordinates_of).collect();
    let vectors = vectors.filter(|vectors| !vectors.is_empty())?;
    if !matches!(name, "len" | "norm" | "normSquared" | "direction" | "dot" | "cross" | "angle") {
        return None;
    }
    // Each coordinate is read twice, so that random numbers are refused.
    if args.iter().any(|a| has_random(a, scope)) {
        return Some(Err(random_refusal(range)));
    }
    let dot = |a: &[PyExpr], b: &[PyExpr]| {
        let products = a.iter().zip(b).map(|(a, b)| binary(PyOp::Mul, a, b));
        products.reduce(|a, b| binary(PyOp::Add, &a, &b)).unwrap_or(PyExpr::Number(0.0))
    };
    let norm = |a: &[PyExpr]| PyExpr::Call("sqrt".to_owned(), vec![dot(a, a)], range.clone());
    let value = match (name, vectors.as_slice()) {
        ("len", &[a]) => PyExpr::Number(f64::from(saturating_index(a.len()))),
        ("norm", &[a]) => norm(a),
        ("normSquared", &[a]) => dot(a, a),
        ("direction", &[a]) => {
            let length = norm(a);
            vector(a.iter().map(|c| binary(PyOp::Div, c, &length)).collect(), range.clone())
        }
        ("dot", &[a, b]) if a.len() == b.len() => dot(a, b),
        ("cross", [a, b]) if a.len() == 3 && b.len() == 3 => vector(cross(a, b), range.clone()),
        // The angle, from 0 to pi in space and from -pi to pi in the plane; the cross product has the length of its sine.
        ("angle", &[a, b]) if a.len() == b.len() && a.len() < 4 => {
            let sine = match cross(a, b).as_slice() {
                [one] => one.clone(),
                all => norm(all),
            };
            PyExpr::Call("atan2".to_owned(), vec![sine, dot(a, b)], range.clone())
        }
        _ => return Some(Err(Refusal::new(format!("this call of '{name}'"), range.clone()))),
    };
    Some(Ok(value))
}

/// The cross product of two vectors of three coordinates; in the plane its only nonzero coordinate.
fn cross(a: &[PyExpr], b: &[PyExpr]) -> Vec<PyExpr> {
    // Determinant of two coordinates of both vectors.
    let part = |a, b, c, d| binary(PyOp::Sub, &binary(PyOp::Mul, a, d), &binary(PyOp::Mul, b, c));
    match (a, b) {
        ([a, b, c], [d, e, f]) => vec![part(b, c, e, f), part(c, a, f, d), part(a, b, d, e)],
        ([a, b], [d, e]) => vec![part(a, b, d, e)],
        _ => Vec::new(),
    }
}

/// Makes a vector: `Vector3()`, `Vector3(x, y, z)`, `Vector3(point)`, `Vector3(plane, z)`.
fn made(name: &str, count: usize, args: &[PyExpr], range: &Range<usize>) -> Result<PyExpr, Refusal> {
    let mut items = Vec::with_capacity(count);
    for arg in args {
        match (coordinates_of(arg), arg) {
            (Some(own), _) => items.extend_from_slice(own),
            (None, PyExpr::List(own, _)) => items.extend_from_slice(own),
            (None, own) => items.push(own.clone()),
        }
    }
    if items.is_empty() {
        items = vec![PyExpr::Number(0.0); count];
    }
    if items.len() != count {
        let why = Refusal::new(format!("a '{name}' of {} numbers", items.len()), range.clone());
        return Err(why.remedy("give it as many numbers as its name says"));
    }
    Ok(PyExpr::Call(name.to_owned(), items, range.clone()))
}

/// The refusal of a random number that a vector would draw more than once.
fn random_refusal(range: &Range<usize>) -> Refusal {
    let why = Refusal::new("a random number in an operation on vectors", range.clone());
    why.remedy("assign it to a variable first")
}

/// An operation on resolved operands, at least one of which is a vector; `None` if none is.
pub(super) fn combined(op: PyOp, a: &PyExpr, b: &PyExpr, scope: &Scope) -> Option<Result<PyExpr, Refusal>> {
    let (first, second) = (coordinates_of(a), coordinates_of(b));
    let range = match (first, second) {
        (Some(_), _) => range_of(a),
        (_, Some(_)) => range_of(b),
        _ => return None,
    };
    let each =
        |items: &[PyExpr], of: &dyn Fn(&PyExpr) -> PyExpr| Ok(vector(items.iter().map(of).collect(), range.clone()));
    Some(match (op, first, second) {
        (PyOp::Add | PyOp::Sub, Some(a), Some(b)) if a.len() == b.len() => {
            Ok(vector(a.iter().zip(b).map(|(a, b)| binary(op, a, b)).collect(), range.clone()))
        }
        (PyOp::Mul | PyOp::Div, Some(_), None) if has_random(b, scope) => Err(random_refusal(&range)),
        (PyOp::Mul, None, Some(_)) if has_random(a, scope) => Err(random_refusal(&range)),
        (PyOp::Mul | PyOp::Div, Some(a), None) => each(a, &|c| binary(op, c, b)),
        (PyOp::Mul, None, Some(b)) => each(b, &|c| binary(op, a, c)),
        (PyOp::Mul, Some(_), Some(_)) => {
            let why = Refusal::new("a vector times a vector", range.clone());
            Err(why.remedy("write dot(v, w) for a number, cross(v, w) for a vector"))
        }
        _ => {
            let why = Refusal::new("this operation on a vector", range.clone());
            Err(why.remedy("vectors of one length are added and subtracted, and multiplied and divided by numbers"))
        }
    })
}

/// The vector `-v`; `None` if the operand is not a vector.
pub(super) fn negated(a: &PyExpr) -> Option<PyExpr> {
    let items = coordinates_of(a)?;
    let negative = items.iter().map(|c| PyExpr::Neg(Box::new(c.clone()))).collect();
    Some(vector(negative, range_of(a)))
}

/// `v == w` or `v != w` of two vectors; `None` for other operands.
pub(super) fn compared(op: PyOp, a: &PyExpr, b: &PyExpr) -> Option<PyExpr> {
    let (a, b) = (coordinates_of(a)?, coordinates_of(b)?);
    if a.len() != b.len() {
        return Some(PyExpr::Number(if op == PyOp::Ne { 1.0 } else { 0.0 }));
    }
    let equal = a.iter().zip(b).map(|(a, b)| binary(PyOp::Eq, a, b));
    let all = equal.reduce(|a, b| PyExpr::And(Box::new(a), Box::new(b)))?;
    Some(if op == PyOp::Ne { PyExpr::Not(Box::new(all)) } else { all })
}

/// A choice between two resolved vectors as a vector of choices, if its test draws no random numbers; `None` for other choices.
pub(super) fn chosen(test: &PyExpr, then: &PyExpr, other: &PyExpr, scope: &Scope) -> Option<PyExpr> {
    let (a, b) = (coordinates_of(then)?, coordinates_of(other)?);
    if a.len() != b.len() || has_random(test, scope) {
        return None;
    }
    let one =
        |(a, b): (&PyExpr, &PyExpr)| PyExpr::Choice(Box::new(test.clone()), Box::new(a.clone()), Box::new(b.clone()));
    Some(vector(a.iter().zip(b).map(one).collect(), range_of(then)))
}
