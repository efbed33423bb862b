//! Dictionaries with constant keys.

use std::ops::Range;

use osier_base::convert::saturating_index;

use super::emit::constant_of;
use super::expression::{DICTIONARY, ListChange, MAX_LOOKUP, MAX_OPS, PyExpr, PyOp, range_of, size_with, text_number};
use super::refusal::Refusal;
use super::scope::{Scope, has_random};
use crate::code::is_zero;

/// A key and its value in a dictionary.
struct Entry<'p> {
    number: f64,
    key: &'p PyExpr,
    value: &'p PyExpr,
}

/// The pairs of a dictionary in order. If a key is repeated, the last value counts, in the position of the first.
fn entries<'p>(pairs: &'p [PyExpr], scope: &Scope, range: &Range<usize>) -> Result<Vec<Entry<'p>>, Refusal> {
    let mut out: Vec<Entry<'p>> = Vec::new();
    for pair in pairs.chunks(2) {
        let [key, value] = pair else { continue };
        let number = constant_of(key, scope);
        let number = number.ok_or_else(|| Refusal::new("a dictionary of keys that are not constant", range.clone()))?;
        match out.iter_mut().find(|entry| is_zero(entry.number - number)) {
            Some(entry) => entry.value = value,
            None => out.push(Entry { number, key, value }),
        }
    }
    Ok(out)
}

/// The value for a key: `d[key]`, or `d.get(key, other)` if the dictionary may lack it. A key that is not constant becomes a
/// choice between the values.
pub(super) fn value_of(
    pairs: &[PyExpr],
    key: &PyExpr,
    other: Option<&PyExpr>,
    scope: &Scope,
    range: &Range<usize>,
) -> Result<PyExpr, Refusal> {
    let entries = entries(pairs, scope, range)?;
    if let Some(key) = constant_of(key, scope) {
        let found = entries.iter().find(|entry| is_zero(entry.number - key)).map(|entry| entry.value).or(other);
        return found.cloned().ok_or_else(|| Refusal::new("a key that its dictionary does not have", range.clone()));
    }
    let draws = has_random(key, scope) || pairs.iter().chain(other).any(|e| has_random(e, scope));
    // If the key equals no other key, the first value is taken, unless a default value is given.
    let first = other.or(entries.first().map(|entry| entry.value)).filter(|_| entries.len() <= MAX_LOOKUP && !draws);
    let first = first.ok_or_else(|| Refusal::new("a key of this dictionary that is not constant", range.clone()))?;
    if entries.len().saturating_mul(size_with(key, &[], &[])) > MAX_OPS {
        return Err(Refusal::new("an expression that grows too large", range.clone()));
    }
    let compared = entries.iter().skip(usize::from(other.is_none()));
    Ok(compared.fold(first.clone(), |out, entry| {
        let is = PyExpr::Binary(PyOp::Eq, Box::new(key.clone()), Box::new(PyExpr::Number(entry.number)));
        PyExpr::Choice(Box::new(is), Box::new(entry.value.clone()), Box::new(out))
    }))
}

/// The result of a function or method of a dictionary, with resolved arguments: `len(d)`, `d.get(key)`, `d.keys()`,
/// `d.values()`, `d.items()`, `d.copy()`. `None` for other calls.
pub(super) fn method(
    name: &str,
    args: &[PyExpr],
    scope: &Scope,
    range: &Range<usize>,
) -> Option<Result<PyExpr, Refusal>> {
    let [PyExpr::Call(own, pairs, _), rest @ ..] = args else { return None };
    if own != DICTIONARY {
        return None;
    }
    let listed = |of: &dyn Fn(&Entry<'_>) -> PyExpr| -> Result<PyExpr, Refusal> {
        let all = entries(pairs, scope, range)?;
        Ok(PyExpr::List(all.iter().map(of).collect(), range.clone()))
    };
    match (name, rest) {
        ("len", []) => {
            let count = entries(pairs, scope, range).map(|all| saturating_index(all.len()));
            Some(count.map(|n| PyExpr::Number(f64::from(n))))
        }
        (".get", [key, other]) => Some(value_of(pairs, key, Some(other), scope, range)),
        (".get", [key]) => Some(value_of(pairs, key, Some(&PyExpr::none(range.clone())), scope, range)),
        (".keys" | "list" | "tuple", []) => Some(listed(&|entry| entry.key.clone())),
        (".values", []) => Some(listed(&|entry| entry.value.clone())),
        (".items", []) => {
            let pair = |entry: &Entry<'_>| PyExpr::List(vec![entry.key.clone(), entry.value.clone()], range.clone());
            Some(listed(&pair))
        }
        (".copy", []) => args.first().cloned().map(Ok),
        _ => None,
    }
}

/// The keys of a dictionary, which a loop iterates over.
pub(super) fn keys_of(dictionary: PyExpr) -> PyExpr {
    let range = range_of(&dictionary);
    PyExpr::Call(".keys".to_owned(), vec![dictionary], range)
}

/// Reads `dict(a=1, b=2)`.
pub(super) fn dictionary_of(args: &[PyExpr], range: &Range<usize>) -> Result<PyExpr, Refusal> {
    let mut pairs = Vec::with_capacity(2 * args.len());
    for arg in args {
        let PyExpr::Call(key, value, place) = arg else {
            return Err(Refusal::new("'dict' of something other than arguments with names", range.clone()));
        };
        let key = key.strip_suffix('=').zip(value.first());
        let (key, value) = key.ok_or_else(|| Refusal::new("'dict' of this value", place.clone()))?;
        pairs.extend([PyExpr::Text(text_number(key), place.clone()), value.clone()]);
    }
    Ok(PyExpr::Call(DICTIONARY.to_owned(), pairs, range.clone()))
}

/// The dictionary after a change, from the resolved one before it and the resolved arguments; the only change is to set a value.
pub(super) fn changed(
    change: ListChange,
    before: &PyExpr,
    args: &[PyExpr],
    scope: &Scope,
    range: &Range<usize>,
) -> Result<PyExpr, Refusal> {
    match (before, change, args) {
        (PyExpr::Call(name, pairs, place), ListChange::Set, [key, value]) => {
            Ok(PyExpr::Call(name.clone(), with_pair(pairs, key, value, scope)?, place.clone()))
        }
        _ => Err(change.refusal(range)),
    }
}

/// The pairs of a dictionary after setting the value of a constant key.
fn with_pair(pairs: &[PyExpr], key: &PyExpr, value: &PyExpr, scope: &Scope) -> Result<Vec<PyExpr>, Refusal> {
    let refused = || Refusal::new("a dictionary of keys that are not constant", range_of(key));
    let number = constant_of(key, scope).ok_or_else(refused)?;
    let mut out = pairs.to_vec();
    let old = out
        .chunks(2)
        .position(|pair| pair.first().and_then(|own| constant_of(own, scope)).is_some_and(|own| is_zero(own - number)));
    match old {
        Some(k) => out[2 * k + 1] = value.clone(),
        None => out.extend([key.clone(), value.clone()]),
    }
    Ok(out)
}
