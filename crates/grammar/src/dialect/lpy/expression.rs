//! Expressions of Python: what they are, and the code that they become.

use std::cell::Cell;
use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;

use osier_base::convert::{limit, saturating_index};

use super::{dictionary, lists};
use crate::code::{BinaryOp, Bytecode, Op, RandomFunction, UnaryOp, is_zero};

/// Operations of one expression after its functions are inserted.
pub(super) const MAX_OPS: usize = 20_000;
/// Upper limit on the numbers of a `range(..)`.
const MAX_ITEMS: f64 = 10_000.0;
/// Numbers of a list that a rule looks up by an index which is not constant.
pub(super) const MAX_LOOKUP: usize = 256;
/// A divisor larger than any number of a model: the remainder of a division by it cuts a number to an integer.
const CUT: f64 = 1e18;

/// Calls of functions of the model within one another, and all calls of one expression: a function may call itself.
const MAX_CALL_DEPTH: usize = 24;
const MAX_CALLS: usize = 10_000;
/// The numbers that stand for `None` and for an empty text: just above 0, so that no number of a model is one of them, and exact in
/// single precision, so that parameters keep them. 2^-100 and 2^-101.
const NONE: f64 = 7.888_609_052_210_118e-31;
const EMPTY: f64 = 3.944_304_526_105_059e-31;

/// Why a text cannot be read: what it contains that is more than rules and expressions, and where.
#[derive(Debug, Clone)]
pub(super) struct Refusal {
    pub construct: String,
    pub range: Range<usize>,
    /// How to write it so that it can be read; `None`: the general advice.
    pub remedy: Option<&'static str>,
}

impl Refusal {
    pub fn new(construct: impl Into<String>, range: Range<usize>) -> Self {
        Self { construct: construct.into(), range, remedy: None }
    }

    pub fn remedy(self, remedy: &'static str) -> Self {
        Self { remedy: Some(remedy), ..self }
    }
}

/// An expression of the subset of Python that rules may use; each node keeps its place in the text.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum PyExpr {
    Number(f64),
    /// A text in quotes, by the number that stands for it.
    Text(f64, Range<usize>),
    Name(String, Range<usize>),
    Neg(Box<Self>),
    Not(Box<Self>),
    Binary(PyOp, Box<Self>, Box<Self>),
    And(Box<Self>, Box<Self>),
    Or(Box<Self>, Box<Self>),
    /// `then if condition else other`: condition, then, other.
    Choice(Box<Self>, Box<Self>, Box<Self>),
    Call(String, Vec<Self>, Range<usize>),
    /// `[a, b]` or `(a, b)`.
    List(Vec<Self>, Range<usize>),
    /// `list[index]`.
    Index(Box<Self>, Box<Self>, Range<usize>),
    /// `[value for name in list]`: value, name, list. The value may be a choice whose other side is [`NOTHING`], no item.
    Each(Box<Self>, String, Box<Self>, Range<usize>),
}

impl PyExpr {
    /// `None` of Python.
    pub fn none(range: Range<usize>) -> Self {
        Self::Text(NONE, range)
    }
}

/// Binary operators; `FloorDiv` and `Mod` round towards minus infinity, as in Python.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum PyOp {
    Add,
    Sub,
    Mul,
    Div,
    FloorDiv,
    Mod,
    Pow,
    Eq,
    Ne,
    Lt,
    Le,
    Gt,
    Ge,
}

/// Name of the call that stands for `value in list`; a word of Python, so that no function has it.
pub(super) const IN: &str = "in";
/// Name that stands for a variable whose value is not known where a value that must be constant is looked for; no scope has it.
pub(super) const UNKNOWN: &str = "(changes)";
/// Name of the call that stands for `{key: value}`, whose arguments are keys and values in turns; no function has it.
pub(super) const DICTIONARY: &str = "{..}";
/// Name of the call that stands for `from:to:step` in the brackets of an index, and of one for a part that is missing.
pub(super) const SLICE: &str = "[:]";
pub(super) const NOTHING: &str = "[]";
/// Name of the call that stands for the items of the lists of a list, `[.. for a in q for b in a]`.
pub(super) const FLAT: &str = "[[]]";
/// What names of the model begin with in functions, whose callers may have variables of these names.
const OF_MODEL: &str = "::";
/// Most items of a list that `in` compares with, one after the other.
const MAX_MEMBERS: usize = 64;

/// Functions whose arguments are numbers, which no text is.
pub(super) const OF_NUMBERS: [&str; 28] = [
    "sin", "cos", "tan", "asin", "acos", "atan", "atan2", "radians", "degrees", "sqrt", "exp", "log", "floor", "ceil",
    "fabs", "abs", "float", "int", "trunc", "round", "pow", "min", "max", "range", "ran", "uniform", "randint",
    "gauss",
];

/// The refusal of a text, or of `None`, where a number is expected.
pub(super) fn text_refusal(value: f64, range: Range<usize>) -> Refusal {
    if is_zero(value - NONE) {
        let why = Refusal::new("'None' where a number is expected", range);
        return why.remedy("test it with 'is None' before, or begin with a number");
    }
    Refusal::new("a text where a number is expected", range)
        .remedy("write the number without quotes; texts can be compared with == and !=, and handed on")
}

/// A resolved operand that must be a number: a text is refused.
fn as_number(e: PyExpr) -> Result<PyExpr, Refusal> {
    if let PyExpr::Text(value, range) = e { Err(text_refusal(value, range)) } else { Ok(e) }
}

/// The number that stands for a text: whole, above a million, and exact in single precision, so that parameters keep it.
pub(super) fn text_number(text: &str) -> f64 {
    if text.is_empty() {
        return EMPTY;
    }
    let hash = osier_base::rng::word(text) % 15_000_000;
    f64::from(saturating_index(limit(hash))) + 1_000_000.0
}

/// Names that expressions may use.
#[derive(Debug, Clone, Default)]
pub(super) struct Scope {
    /// Variables and parameters of a rule; the position is the slot.
    pub locals: Vec<String>,
    /// Values of the model that are drawn once, before the first step; the position is the slot.
    pub globals: Vec<String>,
    pub constants: BTreeMap<String, f64>,
    /// Names among the constants whose values are texts.
    pub texts: BTreeSet<String>,
    /// Lists that no statement changes, by name; an expression may index them or loop over them.
    pub lists: BTreeMap<String, PyExpr>,
    /// Names whose values are more than expressions.
    pub unreadable: BTreeMap<String, Refusal>,
    /// Functions whose body is one expression, by name: their parameters and the expression.
    pub functions: BTreeMap<String, (Vec<String>, PyExpr)>,
    /// Functions that cannot be read, with the reason.
    pub refused_functions: BTreeMap<String, String>,
    /// Values that parameters of functions have where a call gives none, by the name of the function.
    pub defaults: BTreeMap<String, Vec<Option<PyExpr>>>,
    /// The model has `None` or an empty text, which fail a test.
    pub has_none: bool,
    /// The model calls `backward()`.
    pub is_backward: bool,
    /// Calls of functions in the expression that is resolved.
    pub calls: Cell<usize>,
    /// The code is that of `StartEach`, which runs before the step: `Q` counts the steps that are completed.
    pub is_before_step: bool,
}

impl Scope {
    /// Slot of a local variable, which is made if it is new.
    pub fn local(&mut self, name: &str) -> u16 {
        let found = self.locals.iter().position(|l| l == name);
        let i = found.unwrap_or_else(|| {
            self.locals.push(name.to_owned());
            self.locals.len() - 1
        });
        // A way has at most MAX_STEPS (20,000) steps, each of which adds at most one variable to the parameters.
        slot_number(i)
    }

    /// Slot of a variable of the model, which is made if it is new.
    pub fn global(&mut self, name: &str) -> u16 {
        let found = self.globals.iter().position(|g| g == name);
        let i = found.unwrap_or_else(|| {
            self.globals.push(name.to_owned());
            self.globals.len() - 1
        });
        slot_number(i)
    }

    fn slot(list: &[String], name: &str) -> Option<u16> {
        list.iter().position(|l| l == name).and_then(|i| u16::try_from(i).ok())
    }
}

/// True if the expression draws a random number, itself or in a function of the model that it calls.
pub(super) fn has_random(e: &PyExpr, scope: &Scope) -> bool {
    draws(e, scope, &mut Vec::new())
}

/// As [`has_random`], without the functions `seen`: one may call itself.
fn draws<'s>(e: &PyExpr, scope: &'s Scope, seen: &mut Vec<&'s str>) -> bool {
    match e {
        PyExpr::Number(_) | PyExpr::Text(..) | PyExpr::Name(..) => false,
        PyExpr::Neg(a) | PyExpr::Not(a) => draws(a, scope, seen),
        PyExpr::Binary(_, a, b)
        | PyExpr::And(a, b)
        | PyExpr::Or(a, b)
        | PyExpr::Index(a, b, _)
        | PyExpr::Each(a, _, b, _) => draws(a, scope, seen) || draws(b, scope, seen),
        PyExpr::Choice(a, b, c) => [a, b, c].into_iter().any(|e| draws(e, scope, seen)),
        PyExpr::List(items, _) => items.iter().any(|e| draws(e, scope, seen)),
        PyExpr::Call(name, args, _) => {
            let own = matches!(
                name.as_str(),
                "random"
                    | "choice"
                    | "uniform"
                    | "randint"
                    | "randrange"
                    | "gauss"
                    | "normalvariate"
                    | "normal"
                    | "ran"
            );
            if own || args.iter().any(|e| draws(e, scope, seen)) {
                return true;
            }
            match scope.functions.get_key_value(name) {
                Some((name, (_, body))) if !seen.contains(&name.as_str()) => {
                    seen.push(name);
                    draws(body, scope, seen)
                }
                _ => false,
            }
        }
    }
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
    if let Some(change) = lists::change_named(name) {
        return lists::changed(change, &args, scope, range);
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

/// A name without the mark of [`of_model`].
pub(super) fn plain_name(name: &str) -> &str {
    name.strip_prefix(OF_MODEL).unwrap_or(name)
}

/// A name as one of the model, which no variable of a production hides.
pub(super) fn model_name(name: &str) -> String {
    format!("{OF_MODEL}{}", plain_name(name))
}

/// The value of a function with its names, other than its parameters and those `kept`, marked as names of the model.
pub(super) fn of_model(e: &PyExpr, params: &[String], kept: &[String]) -> PyExpr {
    let mut found = BTreeMap::new();
    append_names(e, &mut found);
    // Coordinates of vectors and the lists of this reader have names that no value of the model has.
    let is_other = |name: &String| name.contains(['(', '.']) || params.contains(name) || kept.contains(name);
    found.retain(|name, _| !is_other(name));
    let values: Vec<PyExpr> = found.iter().map(|(name, range)| PyExpr::Name(model_name(name), range.clone())).collect();
    let names: Vec<String> = found.into_keys().collect();
    substitute(e, &names, &values)
}

/// Appends the names that an expression reads, each with the last of its places.
fn append_names(e: &PyExpr, out: &mut BTreeMap<String, Range<usize>>) {
    match e {
        PyExpr::Number(_) | PyExpr::Text(..) => {}
        PyExpr::Name(name, range) => {
            out.insert(name.clone(), range.clone());
        }
        PyExpr::Neg(a) | PyExpr::Not(a) => append_names(a, out),
        PyExpr::Binary(_, a, b)
        | PyExpr::And(a, b)
        | PyExpr::Or(a, b)
        | PyExpr::Index(a, b, _)
        | PyExpr::Each(a, _, b, _) => {
            append_names(a, out);
            append_names(b, out);
        }
        PyExpr::Choice(a, b, c) => [a, b, c].into_iter().for_each(|e| append_names(e, out)),
        PyExpr::Call(_, items, _) | PyExpr::List(items, _) => items.iter().for_each(|e| append_names(e, out)),
    }
}

/// The first call of one of some functions, arguments before the call that they are for; none in the values of
/// `[value for name in list]`, which are computed for each item.
pub(super) fn first_call<'e>(e: &'e PyExpr, is_one: &dyn Fn(&str) -> bool) -> Option<&'e PyExpr> {
    let of = |a: &'e PyExpr| first_call(a, is_one);
    match e {
        PyExpr::Number(_) | PyExpr::Text(..) | PyExpr::Name(..) => None,
        PyExpr::Neg(a) | PyExpr::Not(a) => of(a),
        PyExpr::Binary(_, a, b) | PyExpr::And(a, b) | PyExpr::Or(a, b) | PyExpr::Index(a, b, _) => {
            of(a).or_else(|| of(b))
        }
        PyExpr::Choice(a, b, c) => of(a).or_else(|| of(b)).or_else(|| of(c)),
        PyExpr::Each(_, _, list, _) => of(list),
        PyExpr::Call(name, args, _) => args.iter().find_map(of).or_else(|| is_one(name).then_some(e)),
        PyExpr::List(items, _) => items.iter().find_map(of),
    }
}

/// An expression with another in place of each part that is `part`.
pub(super) fn exchanged(e: &PyExpr, part: &PyExpr, by: &PyExpr) -> PyExpr {
    if e == part {
        return by.clone();
    }
    with_parts(e, &|a| exchanged(a, part, by))
}

/// How often an expression reads a name, at the most; a list that is made from another counts as two values.
fn times_read(e: &PyExpr, name: &str) -> usize {
    let times = |e: &PyExpr| times_read(e, name);
    match e {
        PyExpr::Number(_) | PyExpr::Text(..) => 0,
        PyExpr::Name(own, _) => usize::from(own == name),
        PyExpr::Neg(a) | PyExpr::Not(a) => times(a),
        PyExpr::Binary(_, a, b) | PyExpr::And(a, b) | PyExpr::Or(a, b) | PyExpr::Index(a, b, _) => times(a) + times(b),
        PyExpr::Choice(a, b, c) => times(a) + times(b).max(times(c)),
        PyExpr::Call(_, items, _) | PyExpr::List(items, _) => items.iter().map(times).sum(),
        PyExpr::Each(value, own, list, _) => times(list) * 2 + if own == name { 0 } else { times(value) * 2 },
    }
}

/// The arguments of a call in the order of the parameters; `None` where one is missing or has none.
pub(super) fn arguments(
    params: &[String],
    defaults: Option<&Vec<Option<PyExpr>>>,
    args: Vec<PyExpr>,
) -> Option<Vec<PyExpr>> {
    let mut values = defaults.cloned().unwrap_or_default();
    values.resize(params.len(), None);
    for (k, arg) in args.into_iter().enumerate() {
        let (k, value) = match arg {
            PyExpr::Call(name, mut value, _) if name.ends_with('=') => {
                (params.iter().position(|p| name.strip_suffix('=') == Some(p.as_str()))?, value.pop()?)
            }
            value => (k, value),
        };
        *values.get_mut(k)? = Some(value);
    }
    values.into_iter().collect()
}

/// A function that a production defines. Its value may read variables of the production.
#[derive(Debug)]
pub(super) struct OwnFunction {
    pub params: Vec<String>,
    /// Values that parameters have where a call gives none.
    pub defaults: Vec<Option<PyExpr>>,
    pub value: PyExpr,
}

/// An expression with the values of functions in place of their calls. A call that does not fit its function stays, and is refused as
/// one of an unknown function.
pub(super) fn with_functions(e: &PyExpr, functions: &BTreeMap<String, OwnFunction>, scope: &Scope) -> PyExpr {
    let e = with_parts(e, &|a| with_functions(a, functions, scope));
    let PyExpr::Call(name, args, _) = &e else { return e };
    let Some(function) = functions.get(name) else { return e };
    let OwnFunction { params, defaults, value } = function;
    let Some(args) = arguments(params, Some(defaults), args.clone()) else { return e };
    let is_drawn_once = |(p, a): (&String, &PyExpr)| !has_random(a, scope) || times_read(value, p) <= 1;
    if size_with(value, params, &args) > MAX_OPS || !params.iter().zip(&args).all(is_drawn_once) {
        return e;
    }
    substitute(value, params, &args)
}

/// An operation on numbers, `list + list` or `list * number`.
fn combined(op: PyOp, a: Box<PyExpr>, b: Box<PyExpr>, scope: &Scope) -> Result<PyExpr, Refusal> {
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

/// A list of constant numbers in ascending order.
pub(super) fn sorted(items: &[PyExpr], scope: &Scope, range: &Range<usize>) -> Result<PyExpr, Refusal> {
    let number = |e: &PyExpr| constant_of(e, scope).filter(|_| !matches!(e, PyExpr::Text(..)));
    let numbers = items.iter().map(number).collect::<Option<Vec<f64>>>();
    let mut numbers =
        numbers.ok_or_else(|| Refusal::new("'sorted' of something other than constant numbers", range.clone()))?;
    numbers.sort_by(f64::total_cmp);
    Ok(PyExpr::List(numbers.into_iter().map(PyExpr::Number).collect(), range.clone()))
}

/// `dict(a=1, b=2)`.
fn dictionary_of(args: &[PyExpr], range: &Range<usize>) -> Result<PyExpr, Refusal> {
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

/// The constant that `enumerate` counts from, `start=1` or `1`; 0 without one.
fn first_number(args: &[PyExpr], scope: &Scope, range: &Range<usize>) -> Result<f64, Refusal> {
    let Some(arg) = args.first() else { return Ok(0.0) };
    let value = match arg {
        PyExpr::Call(word, value, _) if word == "start=" => value.first().unwrap_or(arg),
        _ => arg,
    };
    constant_of(value, scope)
        .ok_or_else(|| Refusal::new("'enumerate' from a number that is not constant", range.clone()))
}

/// `list.index(value)`: the first position of a value among constant ones.
fn index_of(value: &PyExpr, items: &[PyExpr], scope: &Scope, range: &Range<usize>) -> Result<PyExpr, Refusal> {
    let refused = || Refusal::new("'index' of values that are not constant", range.clone());
    let wanted = constant_of(value, scope).ok_or_else(refused)?;
    for (k, item) in items.iter().enumerate() {
        if is_zero(constant_of(item, scope).ok_or_else(refused)? - wanted) {
            return Ok(PyExpr::Number(f64::from(saturating_index(k))));
        }
    }
    Err(Refusal::new("'index' of a value that its list does not have", range.clone()))
}

/// The items of lists, one list after the other.
fn flat(lists: &[PyExpr], range: &Range<usize>) -> Result<PyExpr, Refusal> {
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

/// `zip(list, other)`: lists of the first items, of the second items and so on, as many as the shortest list has.
fn zipped(lists: &[PyExpr], range: &Range<usize>) -> PyExpr {
    let all: Vec<&[PyExpr]> = lists
        .iter()
        .filter_map(|l| if let PyExpr::List(items, _) = l { Some(items.as_slice()) } else { None })
        .collect();
    let length = all.iter().map(|items| items.len()).min().unwrap_or(0);
    let row = |k: usize| PyExpr::List(all.iter().filter_map(|items| items.get(k).cloned()).collect(), range.clone());
    PyExpr::List((0..length).map(row).collect(), range.clone())
}

/// `value in list`: whether the value equals one of the items.
fn is_one_of(value: &PyExpr, items: &[PyExpr], scope: &Scope, range: &Range<usize>) -> Result<PyExpr, Refusal> {
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

/// One item of a list, each as likely as the others: the first of n items with a chance of 1/n, else one of the n - 1 others.
fn one_of(items: &[PyExpr], range: &Range<usize>) -> PyExpr {
    let mut out = items[items.len() - 1].clone();
    for (left, item) in (2_u32..).zip(items.iter().rev().skip(1)) {
        let draw = PyExpr::Call("random".to_owned(), Vec::new(), range.clone());
        let test = PyExpr::Binary(PyOp::Lt, Box::new(draw), Box::new(PyExpr::Number(1.0 / f64::from(left))));
        out = PyExpr::Choice(Box::new(test), Box::new(item.clone()), Box::new(out));
    }
    out
}

/// `range(n)`, `range(from, to)`, `range(from, to, step)` as a list.
fn numbers_of_range(args: &[PyExpr], scope: &Scope, range: &Range<usize>) -> Result<PyExpr, Refusal> {
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
    // As in Python the end is not included; with a step of 0 it is never reached.
    let count = if step.abs() > 0.0 { ((to - from) / step).ceil().max(0.0) } else { f64::INFINITY };
    if count > MAX_ITEMS {
        return Err(Refusal::new("a range of too many numbers", range.clone()));
    }
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most MAX_ITEMS")]
    let count = count as u32;
    Ok(PyExpr::List((0..count).map(|k| PyExpr::Number(from + f64::from(k) * step)).collect(), range.clone()))
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

/// Whether a resolved test holds, if it is constant.
fn known_truth(test: &PyExpr, scope: &Scope) -> Option<bool> {
    let value = if scope.has_none { constant_of(&tested(test.clone()), scope) } else { constant_of(test, scope) };
    value.map(|v| !is_zero(v))
}

/// A resolved argument as a number, if it is one whatever the variables are: calls within calls end by such numbers.
fn folded(e: PyExpr, scope: &Scope) -> PyExpr {
    match e {
        PyExpr::Number(_) | PyExpr::Text(..) => e,
        _ => constant_of(&e, scope).map_or(e, PyExpr::Number),
    }
}

/// The value of a resolved expression that is constant.
pub(super) fn constant_of(e: &PyExpr, scope: &Scope) -> Option<f64> {
    let mut ops = Vec::new();
    emit(e, scope, &mut ops).ok()?;
    crate::vm::constant_value(&Bytecode { ops, ..Bytecode::default() }).filter(|v| v.is_finite())
}

/// The slot of the variable of an index; the last one beyond 65,535, where `Scope::slot` finds no variable, so that each use is refused.
fn slot_number(i: usize) -> u16 {
    u16::try_from(i).unwrap_or(u16::MAX)
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

/// An item of a list; an index below 0 counts from the end. An index that is not constant becomes a choice.
fn item(items: &[PyExpr], index: &PyExpr, scope: &Scope, range: &Range<usize>) -> Result<PyExpr, Refusal> {
    let n = f64::from(saturating_index(items.len()));
    if let Some(i) = constant_of(index, scope) {
        let i = if i < 0.0 { i + n } else { i };
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "within the list")]
        let found = (i >= 0.0 && i < n).then(|| items.get(i as usize)).flatten();
        return found.cloned().ok_or_else(|| Refusal::new("an index outside of its list", range.clone()));
    }
    // An index that is not constant is compared with each position, so that the items must need no draw.
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
    // The last item is taken where the index equals no other position.
    let mut out = last.clone();
    for (k, value) in others.iter().enumerate().rev() {
        let k = f64::from(saturating_index(k));
        out = PyExpr::Choice(Box::new(PyExpr::Or(is(k), is(k - n))), Box::new(value.clone()), Box::new(out));
    }
    Ok(out)
}

/// The items `from:to:step` of a list, with bounds that are constant.
fn slice(items: &[PyExpr], parts: &[PyExpr], scope: &Scope, range: &Range<usize>) -> Result<PyExpr, Refusal> {
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
    // As in Python: bounds below 0 count from the end, and those beyond the list are its ends.
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

/// True for what stands for no item and for a bound that is missing.
fn is_nothing(e: &PyExpr) -> bool {
    matches!(e, PyExpr::Call(name, ..) if name == NOTHING)
}

/// True for a dictionary.
pub(super) fn is_dictionary(e: &PyExpr) -> bool {
    matches!(e, PyExpr::Call(name, ..) if name == DICTIONARY)
}

/// Operands of an expression whose names are replaced by expressions.
pub(super) fn size_with(e: &PyExpr, names: &[String], values: &[PyExpr]) -> usize {
    let sizes: Vec<usize> = values.iter().map(|v| size_of(v, &[], &[])).collect();
    size_of(e, names, &sizes)
}

fn size_of(e: &PyExpr, names: &[String], sizes: &[usize]) -> usize {
    let size = |a: &PyExpr| size_of(a, names, sizes);
    let total = |list: &[PyExpr]| list.iter().map(size).fold(1, usize::saturating_add);
    match e {
        PyExpr::Number(_) | PyExpr::Text(..) => 1,
        PyExpr::Name(name, _) => names.iter().position(|n| n == name).and_then(|i| sizes.get(i)).copied().unwrap_or(1),
        PyExpr::Neg(a) | PyExpr::Not(a) => size(a).saturating_add(1),
        PyExpr::Binary(_, a, b)
        | PyExpr::And(a, b)
        | PyExpr::Or(a, b)
        | PyExpr::Index(a, b, _)
        | PyExpr::Each(a, _, b, _) => size(a).saturating_add(size(b)).saturating_add(1),
        PyExpr::Choice(a, b, c) => size(a).saturating_add(size(b)).saturating_add(size(c)).saturating_add(1),
        PyExpr::Call(_, args, _) | PyExpr::List(args, _) => total(args),
    }
}

/// Constants of `math`.
pub(super) fn constant_name(name: &str) -> Option<f64> {
    Some(match name {
        "pi" => std::f64::consts::PI,
        "e" => std::f64::consts::E,
        _ => return None,
    })
}

/// The expression with each of its direct parts replaced by what `of` makes of it.
fn with_parts(e: &PyExpr, of: &dyn Fn(&PyExpr) -> PyExpr) -> PyExpr {
    let sub = |a: &PyExpr| Box::new(of(a));
    let all = |list: &[PyExpr]| list.iter().map(of).collect::<Vec<_>>();
    match e {
        PyExpr::Number(_) | PyExpr::Text(..) | PyExpr::Name(..) => e.clone(),
        PyExpr::Neg(a) => PyExpr::Neg(sub(a)),
        PyExpr::Not(a) => PyExpr::Not(sub(a)),
        PyExpr::Binary(op, a, b) => PyExpr::Binary(*op, sub(a), sub(b)),
        PyExpr::And(a, b) => PyExpr::And(sub(a), sub(b)),
        PyExpr::Or(a, b) => PyExpr::Or(sub(a), sub(b)),
        PyExpr::Choice(a, b, c) => PyExpr::Choice(sub(a), sub(b), sub(c)),
        PyExpr::Call(name, args, range) => PyExpr::Call(name.clone(), all(args), range.clone()),
        PyExpr::List(items, range) => PyExpr::List(all(items), range.clone()),
        PyExpr::Index(a, b, range) => PyExpr::Index(sub(a), sub(b), range.clone()),
        PyExpr::Each(value, name, list, range) => PyExpr::Each(sub(value), name.clone(), sub(list), range.clone()),
    }
}

/// The expression with names replaced by expressions; the variable of a list `[.. for name in ..]` hides an equal name.
pub(super) fn substitute(e: &PyExpr, names: &[String], values: &[PyExpr]) -> PyExpr {
    let sub = |a: &PyExpr| substitute(a, names, values);
    match e {
        PyExpr::Name(name, _) => names.iter().position(|n| n == name).and_then(|i| values.get(i)).unwrap_or(e).clone(),
        // In the value, but not in the list, the variable of the comprehension hides others of its name.
        PyExpr::Each(value, name, list, range) => {
            let others: (Vec<String>, Vec<PyExpr>) =
                names.iter().cloned().zip(values.iter().cloned()).filter(|(n, _)| n != name).unzip();
            let value = Box::new(substitute(value, &others.0, &others.1));
            PyExpr::Each(value, name.clone(), Box::new(sub(list)), range.clone())
        }
        _ => with_parts(e, &sub),
    }
}

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

fn emit(e: &PyExpr, scope: &Scope, ops: &mut Vec<Op>) -> Result<(), Refusal> {
    if ops.len() > MAX_OPS {
        return Err(Refusal::new("an expression that grows too large", range_of(e)));
    }
    if let Some(choice) = operand_choice(e, scope) {
        return emit(&choice, scope, ops);
    }
    // An index beyond all places: divisions by zero of these models are not reported.
    let binary = |op: BinaryOp| Op::Binary(op, usize::MAX);
    match e {
        PyExpr::Number(n) | PyExpr::Text(n, _) => ops.push(Op::Const(*n)),
        PyExpr::Name(name, range) => {
            // Variables of the rule hide values of the model, save those that functions of the model read.
            let of_model = plain_name(name);
            if let Some(slot) = Scope::slot(&scope.locals, name) {
                ops.push(Op::Local(slot));
            } else if let Some(value) = scope.constants.get(of_model) {
                ops.push(Op::Const(*value));
            } else if let Some(slot) = Scope::slot(&scope.globals, of_model) {
                ops.push(Op::Global(slot));
            } else {
                return Err(Refusal::new(format!("the unknown name '{of_model}'"), range.clone()));
            }
        }
        PyExpr::Neg(a) => {
            emit(a, scope, ops)?;
            ops.push(Op::Unary(UnaryOp::Neg));
        }
        PyExpr::Not(a) => {
            emit_test(a, scope, ops)?;
            ops.push(Op::Unary(UnaryOp::Not));
        }
        PyExpr::And(a, b) | PyExpr::Or(a, b) => {
            // The place of the jump is kept until its target, the end of the right side, is known.
            emit_test(a, scope, ops)?;
            let jump = ops.len();
            ops.push(Op::Pop);
            emit_test(b, scope, ops)?;
            ops.push(Op::Bool);
            let end = ops.len();
            ops[jump] = if matches!(e, PyExpr::And(..)) { Op::And(end) } else { Op::Or(end) };
        }
        PyExpr::Choice(condition, then, other) => {
            // condition, JumpIfZero to `other`, then, Jump to the end: each target is set once it is known.
            emit_test(condition, scope, ops)?;
            let to_other = ops.len();
            ops.push(Op::Pop);
            emit(then, scope, ops)?;
            let to_end = ops.len();
            ops.push(Op::Pop);
            ops[to_other] = Op::JumpIfZero(ops.len());
            emit(other, scope, ops)?;
            ops[to_end] = Op::Jump(ops.len());
        }
        PyExpr::Binary(op, a, b) => {
            if let Some(near) = equal_in_single(*op, a, b) {
                return emit(&near, scope, ops);
            }
            let op = match op {
                PyOp::Add => BinaryOp::Add,
                PyOp::Sub => BinaryOp::Sub,
                PyOp::Mul => BinaryOp::Mul,
                PyOp::Div => BinaryOp::Div,
                PyOp::Pow => BinaryOp::Pow,
                PyOp::Eq => BinaryOp::Eq,
                PyOp::Ne => BinaryOp::Ne,
                PyOp::Lt => BinaryOp::Lt,
                PyOp::Le => BinaryOp::Le,
                PyOp::Gt => BinaryOp::Gt,
                PyOp::Ge => BinaryOp::Ge,
                PyOp::FloorDiv | PyOp::Mod => return emit(&floored(e, *op, a, b, scope)?, scope, ops),
            };
            emit(a, scope, ops)?;
            emit(b, scope, ops)?;
            ops.push(binary(op));
        }
        PyExpr::Call(name, args, range) => return emit_call(name, args, range, scope, ops),
        PyExpr::List(_, range) | PyExpr::Index(_, _, range) | PyExpr::Each(_, _, _, range) => {
            let why = Refusal::new("a list or an index '[..]' where a number is expected", range.clone());
            return Err(why.remedy("hand the items on, each as a number: A(p[0],p[1]), or A(*p)"));
        }
    }
    Ok(())
}

/// Code of a test: that of the value, but for `None` and empty texts, which fail it.
fn emit_test(e: &PyExpr, scope: &Scope, ops: &mut Vec<Op>) -> Result<(), Refusal> {
    if scope.has_none { emit(&tested(e.clone()), scope, ops) } else { emit(e, scope, ops) }
}

/// A test whose parts are truth values: of a part that is any value, whether Python takes it as true.
pub(super) fn tested(e: PyExpr) -> PyExpr {
    match e {
        PyExpr::And(a, b) => PyExpr::And(Box::new(tested(*a)), Box::new(tested(*b))),
        PyExpr::Or(a, b) => PyExpr::Or(Box::new(tested(*a)), Box::new(tested(*b))),
        _ if is_truth(&e) => e,
        _ => {
            let range = range_of(&e);
            PyExpr::Call("bool".to_owned(), vec![e], range)
        }
    }
}

/// `a and b` or `a or b` as a choice between its operands, one of which Python gives. `None` for any other expression, for truth
/// values, which the code of `&&` and `||` gives as well, and where an operand that is tested and given draws a random number: a
/// choice would draw it twice.
fn operand_choice(e: &PyExpr, scope: &Scope) -> Option<PyExpr> {
    let is_and = match e {
        PyExpr::And(..) => true,
        PyExpr::Or(..) => false,
        _ => return None,
    };
    let mut all = Vec::new();
    append_operands(e, is_and, &mut all);
    let (last, tested) = all.split_last()?;
    let draws = |o: &PyExpr| !is_truth(o) && has_random(o, scope);
    if all.iter().all(|o| is_truth(o)) || tested.iter().any(|o| draws(o)) {
        return None;
    }
    // Each operand is tested, and given if it decides; a truth value that decides is 0 for `and`, 1 for `or`.
    let choice = tested.iter().rev().fold(PyExpr::clone(last), |rest, o| {
        let decided = if is_and { 0.0 } else { 1.0 };
        let own = if is_truth(o) { PyExpr::Number(decided) } else { PyExpr::clone(o) };
        let (then, other) = if is_and { (rest, own) } else { (own, rest) };
        PyExpr::Choice(Box::new(PyExpr::clone(o)), Box::new(then), Box::new(other))
    });
    Some(choice)
}

/// Appends the operands of a chain of `and` (or of `or`) from left to right.
fn append_operands<'e>(e: &'e PyExpr, is_and: bool, out: &mut Vec<&'e PyExpr>) {
    match (e, is_and) {
        (PyExpr::And(a, b), true) | (PyExpr::Or(a, b), false) => {
            append_operands(a, is_and, out);
            append_operands(b, is_and, out);
        }
        _ => out.push(e),
    }
}

/// True if the value is 0 or 1 whatever the values of its names are.
fn is_truth(e: &PyExpr) -> bool {
    match e {
        PyExpr::Number(n) => is_zero(*n) || is_zero(*n - 1.0),
        PyExpr::Not(_) => true,
        PyExpr::Binary(op, ..) => {
            matches!(op, PyOp::Eq | PyOp::Ne | PyOp::Lt | PyOp::Le | PyOp::Gt | PyOp::Ge)
        }
        PyExpr::And(a, b) | PyExpr::Or(a, b) => is_truth(a) && is_truth(b),
        PyExpr::Choice(_, a, b) => is_truth(a) && is_truth(b),
        PyExpr::Call(name, ..) => name == "bool",
        _ => false,
    }
}

/// The place of an expression; that of a number is not kept.
pub(super) fn range_of(e: &PyExpr) -> Range<usize> {
    match e {
        PyExpr::Number(_) => 0..0,
        PyExpr::Text(_, r)
        | PyExpr::Name(_, r)
        | PyExpr::Call(_, _, r)
        | PyExpr::List(_, r)
        | PyExpr::Index(_, _, r)
        | PyExpr::Each(_, _, _, r) => r.clone(),
        PyExpr::Neg(a) | PyExpr::Not(a) | PyExpr::Binary(_, a, _) | PyExpr::And(a, _) | PyExpr::Or(a, _) => range_of(a),
        PyExpr::Choice(a, ..) => range_of(a),
    }
}

/// `a == b` and `a != b` where one side is a number that single precision does not hold, such as 0.1: a parameter, which has single
/// precision, is equal to the number that is nearest to it. `None` for other comparisons.
fn equal_in_single(op: PyOp, a: &PyExpr, b: &PyExpr) -> Option<PyExpr> {
    let (value, number) = match (a, b) {
        (PyExpr::Number(_), PyExpr::Number(_)) => return None,
        (value, PyExpr::Number(n)) | (PyExpr::Number(n), value) => (value, *n),
        _ => return None,
    };
    #[allow(clippy::cast_possible_truncation, reason = "rounded to single precision")]
    let nearest = f64::from(number as f32);
    if !matches!(op, PyOp::Eq | PyOp::Ne) || is_zero(nearest - number) {
        return None;
    }
    let difference = PyExpr::Binary(PyOp::Sub, Box::new(value.clone()), Box::new(PyExpr::Number(number)));
    let distance = PyExpr::Call("fabs".to_owned(), vec![difference], range_of(value));
    // Rounding changes a number by 2^-24 of it at the most.
    let most = PyExpr::Number(number.abs() / 16_777_216.0);
    let is_near = PyExpr::Binary(PyOp::Le, Box::new(distance), Box::new(most));
    Some(if op == PyOp::Eq { is_near } else { PyExpr::Not(Box::new(is_near)) })
}

/// `a // b` = floor(a / b), `a % b` = a - b floor(a / b), which has the sign of b.
fn floored(e: &PyExpr, op: PyOp, a: &PyExpr, b: &PyExpr, scope: &Scope) -> Result<PyExpr, Refusal> {
    let quotient = PyExpr::Binary(PyOp::Div, Box::new(a.clone()), Box::new(b.clone()));
    let floor = PyExpr::Call("floor".into(), vec![quotient], range_of(e));
    if op == PyOp::FloorDiv {
        return Ok(floor);
    }
    if has_random(e, scope) {
        return Err(Refusal::new("a random number in '%'", range_of(e)));
    }
    let whole = PyExpr::Binary(PyOp::Mul, Box::new(b.clone()), Box::new(floor));
    Ok(PyExpr::Binary(PyOp::Sub, Box::new(a.clone()), Box::new(whole)))
}

/// `round(a)`: a half above an even number is rounded down, any other half up.
fn rounded(a: &PyExpr, range: &Range<usize>) -> PyExpr {
    let half = || Box::new(PyExpr::Number(0.5));
    let floor = |e: PyExpr| Box::new(PyExpr::Call("floor".into(), vec![e], range.clone()));
    let part = PyExpr::Binary(PyOp::Mod, Box::new(a.clone()), Box::new(PyExpr::Number(2.0)));
    let is_above_even = PyExpr::Binary(PyOp::Eq, Box::new(part), half());
    let up = PyExpr::Binary(PyOp::Add, Box::new(a.clone()), half());
    PyExpr::Choice(Box::new(is_above_even), floor(a.clone()), floor(up))
}

/// Angles of Python are in radians, those of the language in degrees.
const DEGREES: f64 = 180.0 / std::f64::consts::PI;

fn emit_call(
    name: &str,
    args: &[PyExpr],
    range: &Range<usize>,
    scope: &Scope,
    ops: &mut Vec<Op>,
) -> Result<(), Refusal> {
    let scaled =
        |ops: &mut Vec<Op>, factor: f64| ops.extend([Op::Const(factor), Op::Binary(BinaryOp::Mul, usize::MAX)]);
    let one = |name: &str| UnaryOp::named(name);
    match (name, args) {
        ("sin" | "cos" | "tan", [a]) => {
            emit(a, scope, ops)?;
            scaled(ops, DEGREES);
            ops.extend(one(name).map(Op::Unary));
        }
        ("asin" | "acos" | "atan", [a]) => {
            emit(a, scope, ops)?;
            ops.extend(one(name).map(Op::Unary));
            scaled(ops, 1.0 / DEGREES);
        }
        ("atan2", [a, b]) => {
            emit(a, scope, ops)?;
            emit(b, scope, ops)?;
            ops.push(Op::Binary(BinaryOp::Atan2, usize::MAX));
            scaled(ops, 1.0 / DEGREES);
        }
        ("radians", [a]) => {
            emit(a, scope, ops)?;
            scaled(ops, 1.0 / DEGREES);
        }
        ("degrees", [a]) => {
            emit(a, scope, ops)?;
            scaled(ops, DEGREES);
        }
        ("sqrt" | "exp" | "log" | "floor" | "ceil" | "fabs", [a]) => {
            emit(a, scope, ops)?;
            ops.extend(one(name).map(Op::Unary));
        }
        ("abs", [a]) => {
            emit(a, scope, ops)?;
            ops.push(Op::Unary(UnaryOp::Fabs));
        }
        ("float", [a]) => emit(a, scope, ops)?,
        ("bool", [a]) if scope.has_none && !is_truth(a) => {
            emit(a, scope, ops)?;
            ops.extend([Op::Unary(UnaryOp::Fabs), Op::Const(NONE), Op::Binary(BinaryOp::Le, usize::MAX)]);
            ops.push(Op::Unary(UnaryOp::Not));
        }
        ("bool", [a]) => {
            emit(a, scope, ops)?;
            ops.extend([Op::Unary(UnaryOp::Not), Op::Unary(UnaryOp::Not)]);
        }
        // The remainder cuts both sides to integers.
        ("int" | "trunc", [a]) => {
            emit(a, scope, ops)?;
            ops.extend([Op::Const(CUT), Op::Binary(BinaryOp::Rem, usize::MAX)]);
        }
        // `Trunc` rounds halves up. Python 3 rounds them to the even neighbour; a random number, which must be drawn once, is no half.
        ("round", [a]) if has_random(a, scope) => {
            emit(a, scope, ops)?;
            ops.push(Op::Unary(UnaryOp::Trunc));
        }
        ("round", [a]) => emit(&rounded(a, range), scope, ops)?,
        ("pow", [a, b]) => {
            emit(a, scope, ops)?;
            emit(b, scope, ops)?;
            ops.push(Op::Binary(BinaryOp::Pow, usize::MAX));
        }
        ("min" | "max", [first, rest @ ..]) if !rest.is_empty() => {
            if args.iter().any(|a| has_random(a, scope)) {
                return Err(Refusal::new(format!("a random number in '{name}'"), range.clone()));
            }
            let op = if name == "min" { PyOp::Le } else { PyOp::Ge };
            let least = rest.iter().fold(first.clone(), |a, b| {
                let test = PyExpr::Binary(op, Box::new(a.clone()), Box::new(b.clone()));
                PyExpr::Choice(Box::new(test), Box::new(a), Box::new(b.clone()))
            });
            emit(&least, scope, ops)?;
        }
        ("log", [a, base]) => {
            let log = |e: &PyExpr| Box::new(PyExpr::Call("log".to_owned(), vec![e.clone()], range.clone()));
            emit(&PyExpr::Binary(PyOp::Div, log(a), log(base)), scope, ops)?;
        }
        ("log10", [a]) => {
            emit(a, scope, ops)?;
            ops.push(Op::Unary(UnaryOp::Log));
            scaled(ops, std::f64::consts::LOG10_E);
        }
        // To so many digits behind the point.
        ("round", [a, digits]) => {
            let digits = constant_of(digits, scope).filter(|d| d.fract().abs() <= 0.0 && d.abs() <= 15.0);
            let digits =
                digits.ok_or_else(|| Refusal::new("digits of 'round' that are not constant", range.clone()))?;
            let unit = format!("1e{digits}").parse().unwrap_or(1.0);
            let unit = || Box::new(PyExpr::Number(unit));
            let larger = PyExpr::Binary(PyOp::Mul, Box::new(a.clone()), unit());
            let whole = PyExpr::Call("round".to_owned(), vec![larger], range.clone());
            emit(&PyExpr::Binary(PyOp::Div, Box::new(whole), unit()), scope, ops)?;
        }
        ("hypot" | "fmod" | "sinh" | "cosh" | "tanh", _) if !args.iter().any(|a| has_random(a, scope)) => {
            let call = |name: &str, a: PyExpr| Box::new(PyExpr::Call(name.to_owned(), vec![a], range.clone()));
            let two = |op: PyOp, a: &PyExpr, b: &PyExpr| PyExpr::Binary(op, Box::new(a.clone()), Box::new(b.clone()));
            let e = match (name, args) {
                ("hypot", [a, b]) => {
                    let sum = two(PyOp::Add, &two(PyOp::Mul, a, a), &two(PyOp::Mul, b, b));
                    *call("sqrt", sum)
                }
                // The remainder with the sign of the first number.
                ("fmod", [a, b]) => two(PyOp::Sub, a, &two(PyOp::Mul, b, &call("trunc", two(PyOp::Div, a, b)))),
                (_, [a]) if name != "hypot" && name != "fmod" => {
                    let (up, down) = (call("exp", a.clone()), call("exp", PyExpr::Neg(Box::new(a.clone()))));
                    let (sum, difference) = (two(PyOp::Add, &up, &down), two(PyOp::Sub, &up, &down));
                    match name {
                        "sinh" => two(PyOp::Div, &difference, &PyExpr::Number(2.0)),
                        "cosh" => two(PyOp::Div, &sum, &PyExpr::Number(2.0)),
                        _ => two(PyOp::Div, &difference, &sum),
                    }
                }
                _ => return Err(Refusal::new(format!("this call of '{name}'"), range.clone())),
            };
            emit(&e, scope, ops)?;
        }
        // L-Py counts from 0, `Q` from 1 in productions and from 0 in the function before a step.
        ("getIterationNb", []) if scope.is_before_step => ops.push(Op::Step),
        ("getIterationNb", []) => {
            ops.extend([Op::Step, Op::Const(1.0), Op::Binary(BinaryOp::Sub, usize::MAX)]);
        }
        ("random", []) => ops.extend([Op::Const(1.0), Op::Random(RandomFunction::Ran)]),
        ("ran", [a]) => {
            emit(a, scope, ops)?;
            ops.push(Op::Random(RandomFunction::Ran));
        }
        ("uniform", [a, b]) => {
            emit(a, scope, ops)?;
            emit(b, scope, ops)?;
            ops.push(Op::Random(RandomFunction::Uniform));
        }
        // A whole number from a to b, both included.
        ("randint", [a, b]) => {
            emit(a, scope, ops)?;
            emit(b, scope, ops)?;
            ops.extend([Op::Const(1.0), Op::Binary(BinaryOp::Add, usize::MAX), Op::Random(RandomFunction::Uniform)]);
            ops.push(Op::Unary(UnaryOp::Floor));
        }
        // A whole number below b.
        ("randrange", [bounds @ .., b]) if bounds.len() <= 1 => {
            emit(bounds.first().unwrap_or(&PyExpr::Number(0.0)), scope, ops)?;
            emit(b, scope, ops)?;
            ops.extend([Op::Random(RandomFunction::Uniform), Op::Unary(UnaryOp::Floor)]);
        }
        ("gauss" | "normalvariate" | "normal", [a, b]) => {
            emit(a, scope, ops)?;
            emit(b, scope, ops)?;
            ops.push(Op::Random(RandomFunction::Nran));
        }
        _ if name == DICTIONARY => {
            let why = Refusal::new("a dictionary '{..}' where a number is expected", range.clone());
            return Err(why.remedy("write the dictionary outside of the productions, and look up its values: d[key]"));
        }
        _ if name.ends_with('=') => return Err(Refusal::new("an argument with a name", range.clone())),
        _ => {
            let why = scope.refused_functions.get(name).map_or_else(String::new, |why| format!(" ({why})"));
            return Err(Refusal::new(format!("the function '{name}'{why}"), range.clone()));
        }
    }
    Ok(())
}
