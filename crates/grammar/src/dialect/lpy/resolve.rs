//! Expressions with the values of the names that they read.

use std::ops::Range;

use osier_base::convert::saturating_index;

use super::dictionary::dictionary_of;
use super::emit::{emit, folded, known_truth};
use super::expression::{
    DICTIONARY, FLAT, IN, MAX_OPS, OF_NUMBERS, PyExpr, PyOp, SLICE, UNKNOWN, constant_name, is_dictionary, is_nothing,
    plain_name, size_with, substitute, text_refusal, times_read,
};
use super::lists::{
    combined, first_number, flat, index_of, is_one_of, item, numbers_of_range, one_of, slice, sorted, zipped,
};
use super::refusal::Refusal;
use super::scope::{Scope, arguments, has_random};
use super::{dictionary, lists};
use crate::code::{Bytecode, Op};

/// Calls of functions of the model within one another that are written in: a function may call itself.
const MAX_CALL_DEPTH: usize = 24;
/// All calls of one expression that are written in.
const MAX_CALLS: usize = 10_000;

/// Code of an expression; one that is constant becomes a single number.
pub(super) fn compile(e: &PyExpr, scope: &Scope) -> Result<Bytecode, Refusal> {
    let resolved = resolve(e, scope, 0)?;
    let mut code = Bytecode::default();
    emit(&resolved, scope, &mut code.ops)?;
    // A value without variables and random numbers becomes one number.
    if let Some(value) = crate::vm::constant_value(&code) {
        code.ops = vec![Op::Const(value)];
    }
    Ok(code)
}

/// The expression with functions of the model replaced by their expressions, and the functions of Python by those of the language.
pub(super) fn resolve(e: &PyExpr, scope: &Scope, depth: usize) -> Result<PyExpr, Refusal> {
    let sub = |a: &PyExpr| resolve(a, scope, depth).map(Box::new);
    let number = |a: &PyExpr| resolve(a, scope, depth).and_then(as_number).map(Box::new);
    Ok(match e {
        PyExpr::Number(_) | PyExpr::Text(..) => e.clone(),
        PyExpr::Name(name, range) => {
            let is_local = name == UNKNOWN || scope.locals.contains(name);
            let name = plain_name(name);
            if let Some(why) = scope.unreadable.get(name).filter(|_| !is_local) {
                return Err(why.clone());
            }
            let is_global = scope.globals.iter().any(|global| global == name);
            let known = is_local || is_global || scope.lists.contains_key(name);
            if !known && !scope.constants.contains_key(name) {
                if let Some(value) = constant_name(name) {
                    return Ok(PyExpr::Number(value));
                }
                return Err(Refusal::new(format!("the unknown name '{name}'"), range.clone()));
            }
            if is_local {
                return Ok(e.clone());
            }
            if let Some(list) = scope.lists.get(name) {
                return Ok(list.clone());
            }
            match scope.constants.get(name) {
                Some(v) if scope.texts.contains(name) => PyExpr::Text(*v, range.clone()),
                Some(v) => PyExpr::Number(*v),
                None => e.clone(),
            }
        }
        PyExpr::Neg(a) => PyExpr::Neg(number(a)?),
        PyExpr::Not(a) => PyExpr::Not(sub(a)?),
        // Texts are equal or not; their order is not known.
        PyExpr::Binary(op @ (PyOp::Eq | PyOp::Ne), a, b) => PyExpr::Binary(*op, sub(a)?, sub(b)?),
        PyExpr::Binary(op, a, b) => combined(*op, number(a)?, number(b)?, scope)?,
        PyExpr::And(a, b) => PyExpr::And(sub(a)?, sub(b)?),
        PyExpr::Or(a, b) => PyExpr::Or(sub(a)?, sub(b)?),
        PyExpr::Choice(test, then, other) => {
            let test = resolve(test, scope, depth)?;
            match known_truth(&test, scope) {
                // The other side may be one that cannot be read: it computes with `None`, or its function calls itself for ever.
                Some(holds) => return resolve(if holds { then } else { other }, scope, depth),
                None => PyExpr::Choice(Box::new(test), sub(then)?, sub(other)?),
            }
        }
        PyExpr::Call(name, args, range) => return resolved_call(name, args, range, scope, depth),
        PyExpr::Change(change, args, range) => {
            let args = args.iter().map(|a| resolve(a, scope, depth)).collect::<Result<Vec<_>, _>>()?;
            match args.split_first() {
                Some((before, rest)) if is_dictionary(before) => {
                    dictionary::changed(*change, before, rest, scope, range)?
                }
                Some((before, rest)) => lists::changed(*change, before, rest, scope, range)?,
                None => return Err(change.refusal(range)),
            }
        }
        PyExpr::List(items, range) => {
            let items = items.iter().map(|a| resolve(a, scope, depth)).collect::<Result<Vec<_>, _>>()?;
            PyExpr::List(items, range.clone())
        }
        PyExpr::Each(value, name, list, range) => return resolved_each(value, name, list, range, scope, depth),
        PyExpr::Index(list, index, range) => {
            let index = resolve(index, scope, depth)?;
            if let PyExpr::Call(name, parts, _) = &index
                && name == SLICE
            {
                return match resolve(list, scope, depth)? {
                    PyExpr::List(items, range) => slice(&items, parts, scope, &range),
                    _ => Err(Refusal::new("a slice '[:]' of something other than a list", range.clone())),
                };
            }
            // A list of the model is not copied for one of its items.
            match list_of_model(list, scope) {
                Some(items) => item(items, &index, scope, range)?,
                None => indexed(&resolve(list, scope, depth)?, &index, scope, range)?,
            }
        }
    })
}

/// A resolved operand that must be a number: a text is refused.
fn as_number(e: PyExpr) -> Result<PyExpr, Refusal> {
    if let PyExpr::Text(value, range) = e { Err(text_refusal(value, range)) } else { Ok(e) }
}

/// As [`resolve`], of a call: a function of the model is replaced by its value, and what lists and dictionaries give is looked up.
fn resolved_call(
    name: &str,
    args: &[PyExpr],
    range: &Range<usize>,
    scope: &Scope,
    depth: usize,
) -> Result<PyExpr, Refusal> {
    let args = args.iter().map(|a| resolve(a, scope, depth)).collect::<Result<Vec<_>, _>>()?;
    if let Some((params, body)) = scope.functions.get(name) {
        count_call(name, range, scope, depth)?;
        let args = arguments(params, scope.defaults.get(name), args).filter(|args| {
            // An argument is written in as often as the body reads it, so that one which draws may be read once.
            let is_drawn_once = |(p, a): (&String, &PyExpr)| !has_random(a, scope) || times_read(body, p) <= 1;
            params.iter().zip(args).all(is_drawn_once)
        });
        let args = args.ok_or_else(|| Refusal::new(format!("this call of '{name}'"), range.clone()))?;
        let args: Vec<PyExpr> = args.into_iter().map(|a| folded(a, scope)).collect();
        if size_with(body, params, &args) > MAX_OPS {
            return Err(Refusal::new("an expression that grows too large", range.clone()));
        }
        let body = substitute(body, params, &args);
        return resolve(&body, scope, depth + 1);
    }
    if OF_NUMBERS.contains(&name)
        && let Some(PyExpr::Text(value, range)) = args.iter().find(|a| matches!(a, PyExpr::Text(..)))
    {
        return Err(text_refusal(*value, range.clone()));
    }
    if let Some(of_dictionary) = dictionary::method(name, &args, scope, range) {
        return of_dictionary;
    }
    Ok(match (name, args.as_slice()) {
        ("range" | "xrange" | "arange", _) => numbers_of_range(&args, scope, range)?,
        ("len", [PyExpr::List(items, _)]) => PyExpr::Number(f64::from(saturating_index(items.len()))),
        ("sum", [PyExpr::List(items, _)]) => {
            let add = |a, b| PyExpr::Binary(PyOp::Add, Box::new(a), Box::new(b));
            items.iter().cloned().reduce(add).unwrap_or(PyExpr::Number(0.0))
        }
        ("min" | "max", [PyExpr::List(items, _)]) if !items.is_empty() => {
            PyExpr::Call(name.to_owned(), items.clone(), range.clone())
        }
        ("bool", [PyExpr::List(items, _)]) => PyExpr::Number(if items.is_empty() { 0.0 } else { 1.0 }),
        ("list" | "tuple" | ".copy", [list @ PyExpr::List(..)]) => list.clone(),
        ("dict", _) => dictionary_of(&args, range)?,
        ("isForward", []) => PyExpr::Number(if scope.is_backward { 0.0 } else { 1.0 }),
        (".index", [PyExpr::List(items, _), value]) => index_of(value, items, scope, range)?,
        (FLAT, [PyExpr::List(lists, _)]) => flat(lists, range)?,
        ("enumerate", [PyExpr::List(items, _), start @ ..]) if start.len() <= 1 => {
            let start = first_number(start, scope, range)?;
            let number = |k: usize| PyExpr::Number(start + f64::from(saturating_index(k)));
            let pairs = items.iter().enumerate().map(|(k, e)| vec![number(k), e.clone()]);
            PyExpr::List(pairs.map(|pair| PyExpr::List(pair, range.clone())).collect(), range.clone())
        }
        ("zip", lists) if !lists.is_empty() && lists.iter().all(|l| matches!(l, PyExpr::List(..))) => {
            zipped(lists, range)
        }
        ("reversed", [PyExpr::List(items, range)]) => {
            PyExpr::List(items.iter().rev().cloned().collect(), range.clone())
        }
        ("sorted", [PyExpr::List(items, range)]) => sorted(items, scope, range)?,
        ("sorted", [PyExpr::List(items, range), PyExpr::Call(word, value, _)]) if word == "reverse=" => {
            let falls = value.first().and_then(|e| known_truth(e, scope));
            let falls = falls.ok_or_else(|| Refusal::new("'reverse' that is not constant", range.clone()))?;
            match sorted(items, scope, range)? {
                PyExpr::List(items, range) if falls => PyExpr::List(items.into_iter().rev().collect(), range),
                list => list,
            }
        }
        ("any" | "all", [PyExpr::List(items, _)]) if !items.iter().any(|e| has_random(e, scope)) => {
            let is_any = name == "any";
            let one = |e: &PyExpr| PyExpr::Call("bool".to_owned(), vec![e.clone()], range.clone());
            let both = |a, b| {
                let (a, b) = (Box::new(a), Box::new(b));
                if is_any { PyExpr::Or(a, b) } else { PyExpr::And(a, b) }
            };
            let of_none = PyExpr::Number(if is_any { 0.0 } else { 1.0 });
            items.iter().map(one).reduce(both).unwrap_or(of_none)
        }
        ("divmod", [a, b]) if !args.iter().any(|a| has_random(a, scope)) => {
            let one = |op| PyExpr::Binary(op, Box::new(a.clone()), Box::new(b.clone()));
            PyExpr::List(vec![one(PyOp::FloorDiv), one(PyOp::Mod)], range.clone())
        }
        ("choice", [PyExpr::List(items, _)]) if !items.is_empty() => one_of(items, range),
        (IN, [value, PyExpr::List(items, _)]) => is_one_of(value, items, scope, range)?,
        (IN, [value, PyExpr::Call(own, pairs, _)]) if own == DICTIONARY => {
            let keys: Vec<PyExpr> = pairs.iter().step_by(2).cloned().collect();
            is_one_of(value, &keys, scope, range)?
        }
        (IN, _) => return Err(Refusal::new("'in' before something other than a list", range.clone())),
        _ => PyExpr::Call(name.to_owned(), args, range.clone()),
    })
}

/// As [`resolve`], of `[value for name in list]`.
fn resolved_each(
    value: &PyExpr,
    name: &String,
    list: &PyExpr,
    range: &Range<usize>,
    scope: &Scope,
    depth: usize,
) -> Result<PyExpr, Refusal> {
    let mut list = resolve(list, scope, depth)?;
    if is_dictionary(&list) {
        list = resolve(&dictionary::keys_of(list), scope, depth)?;
    }
    let PyExpr::List(items, _) = list else {
        return Err(Refusal::new("'for' over something other than a list", range.clone()));
    };
    let mut out = Vec::with_capacity(items.len());
    for item in items {
        let mut one = substitute(value, std::slice::from_ref(name), &[item]);
        // A test that leaves items out must be known.
        while let PyExpr::Choice(test, then, other) = &one
            && is_nothing(other)
        {
            let holds = known_truth(&resolve(test, scope, depth)?, scope);
            let holds = holds.ok_or_else(|| Refusal::new("a list with conditions", range.clone()))?;
            let next = if holds { then.as_ref() } else { other.as_ref() };
            one = next.clone();
        }
        if !is_nothing(&one) {
            out.push(resolve(&one, scope, depth)?);
        }
    }
    Ok(PyExpr::List(out, range.clone()))
}

/// Counts a call of a function of the model, `depth` within others. Fails where a function calls itself too often.
fn count_call(name: &str, range: &Range<usize>, scope: &Scope, depth: usize) -> Result<(), Refusal> {
    scope.calls.set(if depth == 0 { 1 } else { scope.calls.get() + 1 });
    let construct = if depth >= MAX_CALL_DEPTH {
        format!("the recursive function '{name}', more than {MAX_CALL_DEPTH} calls within one another")
    } else if scope.calls.get() > MAX_CALLS {
        format!("the recursive function '{name}', more than {MAX_CALLS} calls")
    } else {
        return Ok(());
    };
    let why = Refusal::new(construct, range.clone());
    Err(why.remedy("write it with 'while' or 'for', or call it with numbers that are known before the model runs"))
}

/// The items of a list that a name stands for.
fn list_of_model<'s>(e: &PyExpr, scope: &'s Scope) -> Option<&'s [PyExpr]> {
    let PyExpr::Name(name, _) = e else { return None };
    let is_hidden = scope.locals.contains(name);
    let name = plain_name(name);
    let is_hidden = is_hidden || scope.unreadable.contains_key(name);
    match scope.lists.get(name).filter(|_| !is_hidden) {
        Some(PyExpr::List(items, _)) => Some(items),
        _ => None,
    }
}

/// An item of a list, or of the list that a choice gives: `list[i][1]` with a list of lists.
fn indexed(list: &PyExpr, index: &PyExpr, scope: &Scope, range: &Range<usize>) -> Result<PyExpr, Refusal> {
    match list {
        PyExpr::List(items, _) => item(items, index, scope, range),
        PyExpr::Call(name, pairs, _) if name == DICTIONARY => dictionary::value_of(pairs, index, None, scope, range),
        PyExpr::Choice(test, a, b) if !has_random(test, scope) => {
            if size_with(list, &[], &[]).saturating_mul(size_with(index, &[], &[])) > MAX_OPS {
                return Err(Refusal::new("an expression that grows too large", range.clone()));
            }
            let (a, b) = (indexed(a, index, scope, range)?, indexed(b, index, scope, range)?);
            Ok(PyExpr::Choice(test.clone(), Box::new(a), Box::new(b)))
        }
        _ => Err(Refusal::new("a list or an index '[..]'", range.clone())),
    }
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
