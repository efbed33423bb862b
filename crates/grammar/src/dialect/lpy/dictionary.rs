//! Dictionaries whose keys are constant.

use std::ops::Range;

use osier_base::convert::saturating_index;

use super::expression::{DICTIONARY, MAX_LOOKUP, MAX_OPS};
use super::expression::{PyExpr, PyOp, Refusal, Scope, constant_of, has_random, range_of, size_with};
use crate::code::is_zero;

/// One pair of a dictionary.
struct Entry<'p> {
    number: f64,
    key: &'p PyExpr,
    value: &'p PyExpr,
}

/// The pairs of a dictionary in their order. Of equal keys the last value counts, in the place of the first.
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

/// The value of a key, `d[key]`, or `d.get(key, other)` where the dictionary may lack it. A key that is not constant becomes a choice.
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
    // The first value is taken where the key equals no other, unless there is one for such keys.
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

/// What a call of a function or method gives of a dictionary, its arguments resolved: `len(d)`, `d.get(key)`, `d.keys()`, `d.values()`,
/// `d.items()`, `d.copy()`. `None` for any other call.
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

/// The keys of a dictionary, over which a loop goes.
pub(super) fn keys_of(dictionary: PyExpr) -> PyExpr {
    let range = range_of(&dictionary);
    PyExpr::Call(".keys".to_owned(), vec![dictionary], range)
}
