//! Resolves expressions: replaces names by the values that they refer to.

use std::cell::{Cell, RefCell};
use std::collections::BTreeSet;
use std::ops::Range;
use std::sync::Arc;

use osier_base::convert::saturating_index;

use super::dictionary::dictionary_of;
use super::emit::{constant_of, emit, folded, known_truth};
use super::expression::{
    ATTRIBUTE, DICTIONARY, FLAT, IN, MAX_OPS, OBJECT, OF_NUMBERS, PyExpr, PyOp, SLICE, UNKNOWN, constant_name,
    first_call, is_dictionary, is_none, is_nothing, is_object, plain_name, range_of, size_with, substitute,
    text_refusal, times_read,
};
use super::lists::{
    combined, first_number, flat, index_of, is_one_of, item, numbers_of_range, one_of, slice, sorted, zipped,
};
use super::refusal::Refusal;
use super::scope::{RUN, RunFunction, Scope, arguments, has_random};
use super::statement::DIRECTION;
use super::{changed_lists, curves, dictionary, lists, objects, vectors};
use crate::code::{Bytecode, Op};

/// Limit on the nesting of inlined calls of functions of the model, which may be recursive.
const MAX_CALL_DEPTH: usize = 24;
/// Limit on the inlined calls in one expression.
const MAX_CALLS: usize = 10_000;

/// Compiles an expression to bytecode; a constant one becomes a single number.
pub(super) fn compile(e: &PyExpr, scope: &Scope) -> Result<Bytecode, Refusal> {
    let resolved = resolve(e, scope, 0)?;
    let mut code = Bytecode::default();
    emit(&resolved, scope, &mut code.ops)?;
    // An expression without variables and random numbers is replaced by its value.
    code = scope.with_tables(code);
    if let Some(value) = crate::vm::constant_value(&code) {
        code = Bytecode { ops: vec![Op::Const(value)], ..Bytecode::default() };
    }
    if code.ops.iter().any(|op| matches!(op, Op::Call(_))) {
        code.functions = Some(Arc::clone(&scope.run_code));
    }
    Ok(code)
}

/// Resolves an expression: inlines functions of the model, and replaces functions of Python by those of the grammar language.
pub(super) fn resolve(e: &PyExpr, scope: &Scope, depth: usize) -> Result<PyExpr, Refusal> {
    let sub = |a: &PyExpr| resolve(a, scope, depth).map(Box::new);
    let number = |a: &PyExpr| resolve(a, scope, depth).and_then(as_number).map(Box::new);
    Ok(match e {
        PyExpr::Number(_) | PyExpr::Text(..) => e.clone(),
        // A name is a variable, a value or list of the model, or a constant such as `pi`; local variables hide all others.
        PyExpr::Name(name, range) => {
            let is_local = name == UNKNOWN || scope.locals.contains(name);
            let name = plain_name(name);
            if let Some(why) = scope.unreadable.get(name).filter(|_| !is_local) {
                return Err(why.clone());
            }
            if let Some((name, _)) = changed_lists::list_of(e, scope) {
                return Err(changed_lists::whole_refusal(name, range.clone()));
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
        // Arithmetic of numbers, or of vectors, which `vectors` computes by coordinate.
        PyExpr::Neg(a) => {
            let a = number(a)?;
            match vectors::negated(&a) {
                Some(vector) => vector,
                None => PyExpr::Neg(a),
            }
        }
        PyExpr::Not(a) => PyExpr::Not(sub(a)?),
        // Strings can only be compared for equality: their order is not known.
        PyExpr::Binary(op @ (PyOp::Eq | PyOp::Ne), a, b) => {
            let (a, b) = (sub(a)?, sub(b)?);
            // A list, a dictionary or an object is not `None`.
            let is_none = |e: &PyExpr| matches!(e, PyExpr::Text(value, _) if is_none(*value));
            let is_other = |e: &PyExpr| is_list_or_vector(e) || is_dictionary(e);
            if (is_none(&a) && is_other(&b)) || (is_none(&b) && is_other(&a)) {
                return Ok(PyExpr::Number(if *op == PyOp::Ne { 1.0 } else { 0.0 }));
            }
            match vectors::compared(*op, &a, &b) {
                Some(test) => test,
                None => PyExpr::Binary(*op, a, b),
            }
        }
        PyExpr::Binary(op, a, b) => {
            let (a, b) = (number(a)?, number(b)?);
            match vectors::combined(*op, &a, &b, scope) {
                Some(vector) => vector?,
                None => combined(*op, a, b, scope)?,
            }
        }
        PyExpr::And(a, b) => PyExpr::And(sub(a)?, sub(b)?),
        PyExpr::Or(a, b) => PyExpr::Or(sub(a)?, sub(b)?),
        PyExpr::Choice(test, then, other) => {
            let test = resolve(test, scope, depth)?;
            match known_truth(&test, scope) {
                // Resolve only the chosen side. The other one may be unreadable, because it computes with `None`, or its
                // recursion would not end.
                Some(holds) => return resolve(if holds { then } else { other }, scope, depth),
                None => {
                    let (then, other) = (sub(then)?, sub(other)?);
                    match vectors::chosen(&test, &then, &other, scope) {
                        Some(vector) => vector,
                        None => PyExpr::Choice(Box::new(test), then, other),
                    }
                }
            }
        }
        PyExpr::Call(name, args, range) if name == OBJECT => {
            let args = args.iter().map(|a| resolved_pair(a, scope, depth)).collect::<Result<Vec<_>, _>>()?;
            PyExpr::Call(name.clone(), args, range.clone())
        }
        PyExpr::Call(name, args, range) => return resolved_call(name, args, range, scope, depth),
        // A change of a list or dictionary, such as `append`, is resolved to the new list or dictionary.
        PyExpr::Change(change, args, range) => {
            let args = args.iter().map(|a| resolve(a, scope, depth)).collect::<Result<Vec<_>, _>>()?;
            match args.split_first() {
                Some((before, rest)) if is_dictionary(before) => {
                    dictionary::changed(*change, before, rest, scope, range)?
                }
                Some((before, rest)) if is_object(before) => objects::with_attribute(before, rest, range)?,
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
            if let Some((name, own)) = changed_lists::list_of(list, scope) {
                return changed_lists::element(name, own, &index, scope, range);
            }
            let is_slice = matches!(&index, PyExpr::Call(name, ..) if name == SLICE);
            if let Some(item) = changed_lists::item_of_row(list, &index, scope, depth).filter(|_| !is_slice) {
                return item;
            }
            if let Some(turn) = changed_lists::turn_item(list, &index, scope, range) {
                return Ok(turn);
            }
            if let PyExpr::Call(name, parts, _) = &index
                && name == SLICE
            {
                return match resolve(list, scope, depth)? {
                    PyExpr::List(items, range) => slice(&items, parts, scope, &range),
                    _ => Err(Refusal::new("a slice '[:]' of something other than a list", range.clone())),
                };
            }
            // Do not copy a list of the model to access one of its items.
            match list_of_model(list, scope) {
                Some(items) => item(items, &index, scope, range)?,
                None => indexed(&resolve(list, scope, depth)?, &index, scope, range)?,
            }
        }
    })
}

/// An attribute of an object, with its value resolved.
fn resolved_pair(pair: &PyExpr, scope: &Scope, depth: usize) -> Result<PyExpr, Refusal> {
    let PyExpr::Call(field, value, range) = pair else { return resolve(pair, scope, depth) };
    let value = value.iter().map(|a| resolve(a, scope, depth)).collect::<Result<Vec<_>, _>>()?;
    Ok(PyExpr::Call(field.clone(), value, range.clone()))
}

/// A resolved operand that must be a number; strings are refused.
fn as_number(e: PyExpr) -> Result<PyExpr, Refusal> {
    if let PyExpr::Text(value, range) = e { Err(text_refusal(value, range)) } else { Ok(e) }
}

/// A vector as the list of its coordinates; other expressions unchanged.
fn as_list(e: PyExpr) -> PyExpr {
    match vectors::coordinates_of(&e) {
        Some(items) => PyExpr::List(items.to_vec(), range_of(&e)),
        None => e,
    }
}

/// Resolves a call: inlines a function of the model, and evaluates operations on lists and dictionaries.
fn resolved_call(
    name: &str,
    args: &[PyExpr],
    range: &Range<usize>,
    scope: &Scope,
    depth: usize,
) -> Result<PyExpr, Refusal> {
    if let Some(of_list) = changed_lists::call(name, args, scope, range, depth) {
        return of_list;
    }
    let args = args.iter().map(|a| resolve(a, scope, depth)).collect::<Result<Vec<_>, _>>()?;
    if let (Some(field), [object]) = (name.strip_prefix(ATTRIBUTE), args.as_slice()) {
        return objects::attribute(object, field, range);
    }
    if let Some(object) = objects::made(name, &args, range, scope) {
        return object;
    }
    // Functions of the model hide Python functions of the same name.
    if scope.functions.contains_key(name) {
        return function_value(name, args, range, scope, depth);
    }
    if let Some(of_curves) = curves::made(name, &args, range, scope) {
        return of_curves;
    }
    if let Some(call) = curves::applied(name, &args, range, scope) {
        return call;
    }
    if let Some(why) = scope.unreadable.get(name) {
        return Err(why.clone());
    }
    // Refuse strings where Python accepts only numbers.
    if OF_NUMBERS.contains(&name)
        && let Some(PyExpr::Text(value, range)) = args.iter().find(|a| matches!(a, PyExpr::Text(..)))
    {
        return Err(text_refusal(*value, range.clone()));
    }
    // Try functions of vectors, of sequences, and of dictionaries, in this order.
    if let Some(of_vectors) = vectors::function(name, &args, scope, range) {
        return of_vectors;
    }
    // A vector is read like a list.
    let reads_list =
        matches!(name, "sum" | "min" | "max" | "list" | "tuple" | "sorted" | "reversed" | "enumerate" | "zip" | IN);
    let args = if reads_list { args.into_iter().map(as_list).collect() } else { args };
    if let Some(of_dictionary) = dictionary::method(name, &args, scope, range) {
        return of_dictionary;
    }
    // Functions whose result follows from the items of their lists become numbers, lists or expressions of the items. Other
    // calls remain, and are compiled or refused later.
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
        // A copy of a number, a string, a list or a vector is the same value.
        ("copy" | "deepcopy", [value]) => value.clone(),
        ("dict", _) => dictionary_of(&args, range)?,
        ("isForward", []) if scope.direction_changes => {
            PyExpr::Not(Box::new(PyExpr::Name(DIRECTION.to_owned(), range.clone())))
        }
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

/// The value of a call of a function of the model with resolved arguments: its expression inlined, or a call of its code if
/// its recursion is deeper than calls are inlined.
fn function_value(
    name: &str,
    args: Vec<PyExpr>,
    range: &Range<usize>,
    scope: &Scope,
    depth: usize,
) -> Result<PyExpr, Refusal> {
    let Some((params, body)) = scope.functions.get(name) else {
        return Err(scope.refused_call(name, range.clone()));
    };
    let args = arguments(params, scope.defaults.get(name), args);
    let args = args.ok_or_else(|| Refusal::new(format!("this call of '{name}'"), range.clone()))?;
    // Once the function is compiled to code, only calls with constant arguments are inlined.
    let is_run = scope.run_index(name).is_some();
    if is_run && args.iter().any(|a| constant_of(a, scope).is_none()) {
        return call_of_code(name, args, range, scope);
    }
    if depth == 0 {
        scope.has_too_many_calls.set(false);
    }
    let value = written_in(name, &args, range, scope, depth);
    // A recursive function may have become too large before its calls were too many.
    let calls_itself = || first_call(body, &|called| called == name).is_some() && args.iter().all(is_number);
    if value.is_err() && depth == 0 && (scope.has_too_many_calls.get() || calls_itself()) {
        // Code accepts only numbers; for lists report the call that exceeded the limit.
        if !args.iter().all(is_number) && !is_recursive(name, scope) {
            return value;
        }
        return call_of_code(name, args, range, scope);
    }
    value
}

/// Inlines a function: its expression with the parameters replaced by the arguments of a call.
fn written_in(
    name: &str,
    args: &[PyExpr],
    range: &Range<usize>,
    scope: &Scope,
    depth: usize,
) -> Result<PyExpr, Refusal> {
    let Some((params, body)) = scope.functions.get(name) else {
        return Err(scope.refused_call(name, range.clone()));
    };
    count_call(name, range, scope, depth)?;
    // An argument is copied wherever the body reads it, so that one that draws random numbers may be read only once.
    let is_drawn_once = |(p, a): (&String, &PyExpr)| !has_random(a, scope) || times_read(body, p) <= 1;
    if !params.iter().zip(args).all(is_drawn_once) {
        return Err(Refusal::new(format!("this call of '{name}'"), range.clone()));
    }
    let args: Vec<PyExpr> = args.iter().map(|a| folded(a.clone(), scope)).collect();
    if size_with(body, params, &args) > MAX_OPS {
        return Err(Refusal::new("an expression that grows too large", range.clone()));
    }
    resolve(&substitute(body, params, &args), scope, depth + 1)
}

/// False for lists, vectors and dictionaries, which are not numbers.
fn is_number(e: &PyExpr) -> bool {
    !is_list_or_vector(e) && !is_dictionary(e)
}

/// A call of a function compiled to code, which the first call compiles. Its arguments must be numbers.
fn call_of_code(name: &str, args: Vec<PyExpr>, range: &Range<usize>, scope: &Scope) -> Result<PyExpr, Refusal> {
    if !args.iter().all(is_number) {
        let why = Refusal::new(format!("a list as an argument of the recursive function '{name}'"), range.clone());
        return Err(why.remedy("hand its items on as numbers, or write the function with 'while' or 'for'"));
    }
    let Some((params, body)) = scope.functions.get(name) else {
        return Err(scope.refused_call(name, range.clone()));
    };
    let at = scope.run_index(name).unwrap_or_else(|| {
        // Register the function before compiling it, so that its recursive calls find it.
        let number = scope.run.borrow().len();
        scope.run.borrow_mut().push(RunFunction {
            name: name.to_owned(),
            is_before_step: scope.is_before_step,
            parameters: params.len(),
            place: range.clone(),
            code: Ok(Vec::new()),
        });
        let own = Scope { locals: params.clone(), calls: Cell::new(0), ..scope.clone() };
        let code = compile(body, &own).map(|code| code.ops);
        if let Some(function) = scope.run.borrow_mut().get_mut(number) {
            function.code = code;
        }
        number
    });
    if let Some(Err(why)) = scope.run.borrow().get(at).map(|f| &f.code) {
        return Err(why.clone());
    }
    Ok(PyExpr::Call(format!("{RUN}{name}"), args, range.clone()))
}

/// Resolves `[value for name in list]`.
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
    let items = match list {
        PyExpr::List(items, _) => items,
        other => match vectors::coordinates_of(&other) {
            Some(items) => items.to_vec(),
            None => return Err(Refusal::new("'for' over something other than a list", range.clone())),
        },
    };
    let mut out = Vec::with_capacity(items.len());
    for item in items {
        let mut one = substitute(value, std::slice::from_ref(name), &[item]);
        // A test that omits items must be constant.
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

/// Counts an inlined call of a function of the model, nested in `depth` others; fails beyond the limits.
fn count_call(name: &str, range: &Range<usize>, scope: &Scope, depth: usize) -> Result<(), Refusal> {
    scope.calls.set(if depth == 0 { 1 } else { scope.calls.get() + 1 });
    let construct = if depth >= MAX_CALL_DEPTH {
        format!("more than {MAX_CALL_DEPTH} calls within one another")
    } else if scope.calls.get() > MAX_CALLS {
        format!("more than {MAX_CALLS} calls in one expression")
    } else {
        return Ok(());
    };
    scope.has_too_many_calls.set(true);
    let (what, remedy) = if is_recursive(name, scope) {
        (
            "recursive function",
            "write it with 'while' or 'for', or call it with numbers that are known before the model runs",
        )
    } else {
        (
            "function",
            "write several of the functions that call one another as one, or hand on numbers in place of lists",
        )
    };
    let why = Refusal::new(format!("the {what} '{name}', {construct}"), range.clone());
    Err(why.remedy(remedy))
}

/// True if a function of the model calls itself, directly or through others.
fn is_recursive(name: &str, scope: &Scope) -> bool {
    let mut seen = BTreeSet::new();
    let mut open = vec![name.to_owned()];
    while let Some(one) = open.pop() {
        let Some((_, body)) = scope.functions.get(&one) else { continue };
        let called = RefCell::new(Vec::new());
        // Return false for each call, so that the search continues and finds all of them.
        let note = |called_name: &str| {
            called.borrow_mut().push(called_name.to_owned());
            false
        };
        first_call(body, &note);
        for next in called.into_inner() {
            if next == name {
                return true;
            }
            if seen.insert(next.clone()) {
                open.push(next);
            }
        }
    }
    false
}

/// The items of a list of the model, by its name; `None` for other expressions.
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

/// An item of a list, or of each list in a choice, as in `list[i][1]` of a list of lists.
fn indexed(list: &PyExpr, index: &PyExpr, scope: &Scope, range: &Range<usize>) -> Result<PyExpr, Refusal> {
    if let Some(items) = vectors::coordinates_of(list) {
        return item(items, index, scope, range);
    }
    if is_object(list)
        && let Some(field) = objects::axis_name(index)
    {
        return objects::attribute(list, field, range);
    }
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

/// True for a list or a vector.
pub(super) fn is_list_or_vector(e: &PyExpr) -> bool {
    matches!(e, PyExpr::List(..)) || vectors::coordinates_of(e).is_some() || is_object(e)
}

/// False if an expression is certainly neither a list nor a vector, so that it need not be resolved.
pub(super) fn may_be_list(e: &PyExpr, scope: &Scope) -> bool {
    let of = |e: &PyExpr| may_be_list(e, scope);
    match e {
        PyExpr::List(..) | PyExpr::Change(..) | PyExpr::Index(..) | PyExpr::Each(..) => true,
        PyExpr::Name(name, _) => scope.lists.contains_key(plain_name(name)),
        PyExpr::Binary(PyOp::Add | PyOp::Sub | PyOp::Mul | PyOp::Div, a, b) => of(a) || of(b),
        PyExpr::Neg(a) => of(a),
        PyExpr::Choice(_, a, b) => of(a) && of(b),
        PyExpr::Call(name, ..) => {
            // `[[]]` represents a comprehension over several lists.
            matches!(name.as_str(), "range" | "xrange" | "list" | "tuple" | "reversed" | "sorted" | "divmod")
                || matches!(name.as_str(), "copy" | "deepcopy")
                || matches!(name.as_str(), "enumerate" | "zip" | ".keys" | ".values" | ".items" | ".copy" | "[[]]")
                || vectors::gives_vector(name)
                || scope.functions.contains_key(name)
                || name == OBJECT
                || name == "ParameterSet"
                || scope.classes.contains_key(name)
        }
        _ => false,
    }
}
