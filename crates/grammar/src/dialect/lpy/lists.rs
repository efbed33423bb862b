//! Operations on lists: reading items, and the lists that result from changes.

use std::ops::Range;

use osier_base::convert::saturating_index;

use super::emit::constant_of;
use super::expression::{ListChange, MAX_LOOKUP, MAX_OPS, PyExpr, PyOp, is_nothing, size_with};
use super::refusal::{Refusal, nested_change};
use super::scope::{Scope, has_random};
use crate::code::is_zero;

/// Limit on the numbers of a `range(..)`.
const MAX_ITEMS: f64 = 10_000.0;

/// Limit on the items with which `in` compares, one after the other.
const MAX_MEMBERS: usize = 64;

/// An item of a list; a negative index counts from the end. An index that is not constant becomes a choice between the items.
pub(super) fn item(items: &[PyExpr], index: &PyExpr, scope: &Scope, range: &Range<usize>) -> Result<PyExpr, Refusal> {
    let n = f64::from(saturating_index(items.len()));
    if let Some(i) = constant_of(index, scope) {
        let i = if i < 0.0 { i + n } else { i };
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "within the list")]
        let found = (i >= 0.0 && i < n).then(|| items.get(i as usize)).flatten();
        return found.cloned().ok_or_else(|| Refusal::new("an index outside of its list", range.clone()));
    }
    // An index that is not constant is compared with each position, so that the items must not draw random numbers.
    let draws = items.iter().any(|e| has_random(e, scope));
    let Some((last, others)) = items.split_last().filter(|_| items.len() <= MAX_LOOKUP && !draws) else {
        return Err(Refusal::new("an index of this list that is not constant", range.clone()));
    };
    if has_random(index, scope) {
        return Err(Refusal::new("a random number as an index", range.clone()));
    }
    if items.len().saturating_mul(size_with(index, &[], &[])) > MAX_OPS {
        return Err(Refusal::new("an expression that grows too large", range.clone()));
    }
    let is = |k: f64| Box::new(PyExpr::Binary(PyOp::Eq, Box::new(index.clone()), Box::new(PyExpr::Number(k))));
    // The last item is taken if the index equals no other position.
    let mut out = last.clone();
    for (k, value) in others.iter().enumerate().rev() {
        let k = f64::from(saturating_index(k));
        out = PyExpr::Choice(Box::new(PyExpr::Or(is(k), is(k - n))), Box::new(value.clone()), Box::new(out));
    }
    Ok(out)
}

/// The items `from:to:step` of a list, with constant bounds.
pub(super) fn slice(
    items: &[PyExpr],
    parts: &[PyExpr],
    scope: &Scope,
    range: &Range<usize>,
) -> Result<PyExpr, Refusal> {
    let refused = || Refusal::new("a slice '[:]' with bounds that are not constant", range.clone());
    let part = |k: usize| match parts.get(k) {
        None => Ok(None),
        Some(e) if is_nothing(e) => Ok(None),
        Some(e) => constant_of(e, scope).filter(|v| v.fract().abs() <= 0.0).map(Some).ok_or_else(refused),
    };
    let n = f64::from(saturating_index(items.len()));
    let (from, to, step) = (part(0)?, part(1)?, part(2)?.unwrap_or(1.0));
    if is_zero(step) {
        return Err(refused());
    }
    // As in Python, negative bounds count from the end, and bounds beyond the list are clamped.
    let (low, high) = if step > 0.0 { (0.0, n) } else { (-1.0, n - 1.0) };
    let bound = |v: f64| {
        let from_begin = if v < 0.0 { v + n } else { v };
        from_begin.clamp(low, high.max(low))
    };
    let (first, last) = if step > 0.0 { (low, high) } else { (high, low) };
    let (from, to) = (from.map_or(first, bound), to.map_or(last, bound));
    let count = ((to - from) / step).ceil().max(0.0);
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most the length of the list")]
    let count = count as u32;
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "within the list")]
    let at = |k: u32| items.get((from + f64::from(k) * step) as usize).cloned();
    Ok(PyExpr::List((0..count).filter_map(at).collect(), range.clone()))
}

/// An arithmetic operation, or `list + list` or `list * number`.
pub(super) fn combined(op: PyOp, a: Box<PyExpr>, b: Box<PyExpr>, scope: &Scope) -> Result<PyExpr, Refusal> {
    let (items, range) = match (op, &*a, &*b) {
        (PyOp::Add, PyExpr::List(first, range), PyExpr::List(rest, _)) => {
            (first.iter().chain(rest).cloned().collect::<Vec<_>>(), range)
        }
        (PyOp::Mul, PyExpr::List(items, range), count) | (PyOp::Mul, count, PyExpr::List(items, range)) => {
            let count = constant_of(count, scope).filter(|n| n.fract().abs() <= 0.0 && *n <= MAX_ITEMS);
            let Some(count) = count.filter(|_| !items.iter().any(|e| has_random(e, scope))) else {
                return Err(Refusal::new("a list times a number that is not constant", range.clone()));
            };
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "from 0 to MAX_ITEMS")]
            let count = count.max(0.0) as usize;
            let all = items.len().saturating_mul(count);
            (items.iter().cycle().take(all.min(MAX_OPS + 1)).cloned().collect(), range)
        }
        _ => return Ok(PyExpr::Binary(op, a, b)),
    };
    if items.len() > MAX_OPS {
        return Err(Refusal::new("a list of too many items", range.clone()));
    }
    Ok(PyExpr::List(items, range.clone()))
}

/// Sorts a list of constant numbers in ascending order.
pub(super) fn sorted(items: &[PyExpr], scope: &Scope, range: &Range<usize>) -> Result<PyExpr, Refusal> {
    let number = |e: &PyExpr| constant_of(e, scope).filter(|_| !matches!(e, PyExpr::Text(..)));
    let numbers = items.iter().map(number).collect::<Option<Vec<f64>>>();
    let mut numbers =
        numbers.ok_or_else(|| Refusal::new("'sorted' of something other than constant numbers", range.clone()))?;
    numbers.sort_by(f64::total_cmp);
    Ok(PyExpr::List(numbers.into_iter().map(PyExpr::Number).collect(), range.clone()))
}

/// `range(n)`, `range(from, to)`, `range(from, to, step)` as a list.
pub(super) fn numbers_of_range(args: &[PyExpr], scope: &Scope, range: &Range<usize>) -> Result<PyExpr, Refusal> {
    let refused = || Refusal::new("a range that is not constant", range.clone());
    let mut values = Vec::with_capacity(3);
    for a in args {
        values.push(constant_of(a, scope).ok_or_else(refused)?);
    }
    let (from, to, step) = match values.as_slice() {
        [to] => (0.0, *to, 1.0),
        [from, to] => (*from, *to, 1.0),
        [from, to, step] => (*from, *to, *step),
        _ => return Err(refused()),
    };
    // As in Python, the end is excluded; with a step of 0 it is never reached.
    let count = if step.abs() > 0.0 { ((to - from) / step).ceil().max(0.0) } else { f64::INFINITY };
    if count > MAX_ITEMS {
        return Err(Refusal::new("a range of too many numbers", range.clone()));
    }
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most MAX_ITEMS")]
    let count = count as u32;
    Ok(PyExpr::List((0..count).map(|k| PyExpr::Number(from + f64::from(k) * step)).collect(), range.clone()))
}

/// `zip(list, other)`: a list of the first items, one of the second items and so on, up to the length of the shortest list.
pub(super) fn zipped(lists: &[PyExpr], range: &Range<usize>) -> PyExpr {
    let all: Vec<&[PyExpr]> = lists
        .iter()
        .filter_map(|l| if let PyExpr::List(items, _) = l { Some(items.as_slice()) } else { None })
        .collect();
    let length = all.iter().map(|items| items.len()).min().unwrap_or(0);
    let row = |k: usize| PyExpr::List(all.iter().filter_map(|items| items.get(k).cloned()).collect(), range.clone());
    PyExpr::List((0..length).map(row).collect(), range.clone())
}

/// Concatenates lists.
pub(super) fn flat(lists: &[PyExpr], range: &Range<usize>) -> Result<PyExpr, Refusal> {
    let mut out = Vec::new();
    for list in lists {
        let PyExpr::List(items, _) = list else {
            return Err(Refusal::new("'for' over something other than a list", range.clone()));
        };
        out.extend(items.iter().cloned());
        if out.len() > MAX_OPS {
            return Err(Refusal::new("a list of too many items", range.clone()));
        }
    }
    Ok(PyExpr::List(out, range.clone()))
}

/// The constant from which `enumerate` counts, `start=1` or `1`; 0 if it is not given.
pub(super) fn first_number(args: &[PyExpr], scope: &Scope, range: &Range<usize>) -> Result<f64, Refusal> {
    let Some(arg) = args.first() else { return Ok(0.0) };
    let value = match arg {
        PyExpr::Call(word, value, _) if word == "start=" => value.first().unwrap_or(arg),
        _ => arg,
    };
    constant_of(value, scope)
        .ok_or_else(|| Refusal::new("'enumerate' from a number that is not constant", range.clone()))
}

/// `list.index(value)`: the first position of a value in a list of constants.
pub(super) fn index_of(
    value: &PyExpr,
    items: &[PyExpr],
    scope: &Scope,
    range: &Range<usize>,
) -> Result<PyExpr, Refusal> {
    let refused = || Refusal::new("'index' of values that are not constant", range.clone());
    let wanted = constant_of(value, scope).ok_or_else(refused)?;
    for (k, item) in items.iter().enumerate() {
        if is_zero(constant_of(item, scope).ok_or_else(refused)? - wanted) {
            return Ok(PyExpr::Number(f64::from(saturating_index(k))));
        }
    }
    Err(Refusal::new("'index' of a value that its list does not have", range.clone()))
}

/// `value in list`: true if the value equals an item.
pub(super) fn is_one_of(
    value: &PyExpr,
    items: &[PyExpr],
    scope: &Scope,
    range: &Range<usize>,
) -> Result<PyExpr, Refusal> {
    if has_random(value, scope) {
        let why = Refusal::new("a random number before 'in'", range.clone());
        return Err(why.remedy("assign it to a variable first"));
    }
    if items.len() > MAX_MEMBERS {
        let why = Refusal::new(format!("'in' before a list of more than {MAX_MEMBERS} items"), range.clone());
        return Err(why.remedy("compare with < and <="));
    }
    let equals = |item: &PyExpr| PyExpr::Binary(PyOp::Eq, Box::new(value.clone()), Box::new(item.clone()));
    let either = |a, b| PyExpr::Or(Box::new(a), Box::new(b));
    Ok(items.iter().map(equals).reduce(either).unwrap_or(PyExpr::Number(0.0)))
}

/// A random item of a list with equal probabilities: the first of n items with probability 1/n, else one of the other n - 1.
pub(super) fn one_of(items: &[PyExpr], range: &Range<usize>) -> PyExpr {
    let mut out = items[items.len() - 1].clone();
    for (left, item) in (2_u32..).zip(items.iter().rev().skip(1)) {
        let draw = PyExpr::Call("random".to_owned(), Vec::new(), range.clone());
        let test = PyExpr::Binary(PyOp::Lt, Box::new(draw), Box::new(PyExpr::Number(1.0 / f64::from(left))));
        out = PyExpr::Choice(Box::new(test), Box::new(item.clone()), Box::new(out));
    }
    out
}

/// The list after a change, from the resolved list before it and the resolved arguments of the change.
pub(super) fn changed(
    change: ListChange,
    before: &PyExpr,
    args: &[PyExpr],
    scope: &Scope,
    range: &Range<usize>,
) -> Result<PyExpr, Refusal> {
    let refused = || change.refusal(range);
    let PyExpr::List(items, place) = before else { return Err(refused()) };
    // Each change does the same as the Python method of that name.
    let mut items = items.clone();
    match (change, args) {
        (ListChange::Append, [value]) => items.push(value.clone()),
        (ListChange::Extend, [PyExpr::List(more, _)]) => items.extend(more.iter().cloned()),
        (ListChange::Insert, [at, value]) => {
            let at = position(at, items.len(), scope).ok_or_else(refused)?.min(items.len());
            items.insert(at, value.clone());
        }
        (ListChange::Pop, []) if !items.is_empty() => {
            items.pop();
        }
        (ListChange::Pop, [at]) => {
            let at = position(at, items.len(), scope).filter(|at| *at < items.len()).ok_or_else(refused)?;
            items.remove(at);
        }
        (ListChange::Set, [PyExpr::List(..), _]) => return Err(nested_change(range.clone())),
        (ListChange::Set, [at, value]) => {
            let at = position(at, items.len(), scope).ok_or_else(refused)?;
            *items.get_mut(at).ok_or_else(refused)? = value.clone();
        }
        (ListChange::Reverse, []) => items.reverse(),
        (ListChange::Sort, []) => return sorted(&items, scope, range),
        (ListChange::Clear, []) => items.clear(),
        _ => return Err(refused()),
    }
    if items.len() > MAX_OPS {
        return Err(Refusal::new("a list of too many items", range.clone()));
    }
    Ok(PyExpr::List(items, place.clone()))
}

/// The position of a constant index; a negative one counts from the end.
fn position(index: &PyExpr, length: usize, scope: &Scope) -> Option<usize> {
    let n = f64::from(saturating_index(length));
    let i = constant_of(index, scope).filter(|i| i.fract().abs() <= 0.0)?;
    let i = if i < 0.0 { i + n } else { i };
    if !(0.0..=n).contains(&i) {
        return None;
    }
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "from 0 to the length of a list")]
    let at = i as usize;
    Some(at)
}
