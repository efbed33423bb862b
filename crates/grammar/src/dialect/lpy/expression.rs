//! Syntax tree of Python expressions, and how its parts are read and replaced.

use std::collections::BTreeMap;
use std::ops::Range;

use osier_base::convert::{limit, saturating_index};

use super::refusal::Refusal;
use crate::code::is_zero;

/// Limit on the operations of one expression after its functions are inlined.
pub(super) const MAX_OPS: usize = 20_000;

/// Limit on the items of a list that a rule accesses by an index which is not constant.
pub(super) const MAX_LOOKUP: usize = 256;

/// The numbers that represent `None` and the empty string, 2^-100 and 2^-101: just above 0, so that no model uses them, and
/// exact in single precision, so that parameters can store them.
pub(super) const NONE: f64 = 7.888_609_052_210_118e-31;

const EMPTY: f64 = 3.944_304_526_105_059e-31;

/// The number that represents the first curve of a model: above the numbers of strings, and low enough that the numbers of
/// all curves stay below 2^24, up to which integers are exact in single precision.
pub(super) const FIRST_CURVE: f64 = 16_000_001.0;

/// An expression of the supported subset of Python; each node stores its place in the text.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum PyExpr {
    Number(f64),
    /// A string constant, by the number that represents it.
    Text(f64, Range<usize>),
    Name(String, Range<usize>),
    Neg(Box<Self>),
    Not(Box<Self>),
    Binary(PyOp, Box<Self>, Box<Self>),
    And(Box<Self>, Box<Self>),
    Or(Box<Self>, Box<Self>),
    /// `then if condition else other`, in the order condition, then, other.
    Choice(Box<Self>, Box<Self>, Box<Self>),
    Call(String, Vec<Self>, Range<usize>),
    /// The list or dictionary that a change makes: the list or dictionary before it, then the arguments of the change.
    Change(ListChange, Vec<Self>, Range<usize>),
    /// A list `[a, b]` or a tuple `(a, b)`.
    List(Vec<Self>, Range<usize>),
    /// `list[index]`.
    Index(Box<Self>, Box<Self>, Range<usize>),
    /// `[value for name in list]`: value, name, list. The value may be a choice with [`NOTHING`], which omits the item.
    Each(Box<Self>, String, Box<Self>, Range<usize>),
}

impl PyExpr {
    /// The value `None` of Python.
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

impl PyOp {
    /// True for comparisons, whose result is 1 or 0.
    pub fn compares(self) -> bool {
        matches!(self, Self::Eq | Self::Ne | Self::Lt | Self::Le | Self::Gt | Self::Ge)
    }
}

/// Changes of a list. All but `Set` are methods of Python; `Set` is `q[i] = x`, also for a dictionary.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ListChange {
    Append,
    Extend,
    Insert,
    Pop,
    Reverse,
    Sort,
    Clear,
    Set,
}

impl ListChange {
    /// The change made by a method; `None` if the method does not change a list.
    pub fn of_method(name: &str) -> Option<Self> {
        let all = [Self::Append, Self::Extend, Self::Insert, Self::Pop, Self::Reverse, Self::Sort, Self::Clear];
        all.into_iter().find(|change| change.word() == name)
    }

    /// Name of the change in messages, which is the method's.
    pub fn word(self) -> &'static str {
        match self {
            Self::Append => "append",
            Self::Extend => "extend",
            Self::Insert => "insert",
            Self::Pop => "pop",
            Self::Reverse => "reverse",
            Self::Sort => "sort",
            Self::Clear => "clear",
            Self::Set => "set",
        }
    }

    /// The refusal of a change that lists or dictionaries do not support.
    pub fn refusal(self, range: &Range<usize>) -> Refusal {
        Refusal::new(format!("this change of a list, '{}'", self.word()), range.clone())
    }
}

/// Assignment operators; those of two characters precede those that they end with.
pub(super) const OPERATORS: [(&str, PyOp); 7] = [
    ("**=", PyOp::Pow),
    ("//=", PyOp::FloorDiv),
    ("%=", PyOp::Mod),
    ("+=", PyOp::Add),
    ("-=", PyOp::Sub),
    ("*=", PyOp::Mul),
    ("/=", PyOp::Div),
];

/// Name of the call that represents `value in list`; a keyword of Python, so that no function can have it.
pub(super) const IN: &str = "in";

/// Name that replaces a variable of unknown value when a constant is required; no scope contains it.
pub(super) const UNKNOWN: &str = "(changes)";

/// Name of the call that represents a string composed at run time, `f"{x}"` or `str(x)`; no function can have it.
pub(super) const JOINED_TEXT: &str = "(text)";

/// Name of the call of a function that a variable or string holds, with the function and its argument; no function can have it.
pub(super) const APPLY: &str = "(apply)";

/// Name of the call that represents an object, whose arguments are calls of its attributes with their values; no function can have it.
pub(super) const OBJECT: &str = "(object)";

/// Prefix in the name of the call that represents an attribute: `p.age` is `(.)age` of p.
pub(super) const ATTRIBUTE: &str = "(.)";

/// Prefix of the name of the call of a method of a class of the model, `p.grow(2)` as `(method) grow` of p and 2.
pub(super) const METHOD: &str = "(method) ";

/// Name of the call that represents `{key: value}`, whose arguments are keys and values in turn; no function has it.
pub(super) const DICTIONARY: &str = "{..}";

/// Names of the calls that represent `from:to:step` in the brackets of an index, and an omitted part of it.
pub(super) const SLICE: &str = "[:]";

pub(super) const NOTHING: &str = "[]";

/// Name of the call that concatenates the lists in a list, for `[.. for a in q for b in a]`.
pub(super) const FLAT: &str = "[[]]";

/// Prefix for names of the model inside functions, because callers may have variables of the same name.
const OF_MODEL: &str = "::";

/// Functions whose arguments must be numbers, not strings.
pub(super) const OF_NUMBERS: [&str; 28] = [
    "sin", "cos", "tan", "asin", "acos", "atan", "atan2", "radians", "degrees", "sqrt", "exp", "log", "floor", "ceil",
    "fabs", "abs", "float", "int", "trunc", "round", "pow", "min", "max", "range", "ran", "uniform", "randint",
    "gauss",
];

/// The refusal of a string or `None` where a number is required.
pub(super) fn text_refusal(value: f64, range: Range<usize>) -> Refusal {
    if is_none(value) {
        let why = Refusal::new("'None' where a number is expected", range);
        return why.remedy("test it with 'is None' before, or begin with a number");
    }
    if value >= FIRST_CURVE {
        let why = Refusal::new("a curve where a number is expected", range);
        return why.remedy("call it, f(x), or give it to SetGuide, SetContour or Sweep");
    }
    Refusal::new("a text where a number is expected", range)
        .remedy("write the number without quotes; texts can be compared with == and !=, and handed on")
}

/// The number that represents a string: an integer above a million, exact in single precision, so that parameters can store it.
pub(super) fn text_number(text: &str) -> f64 {
    if text.is_empty() {
        return EMPTY;
    }
    let hash = osier_base::rng::word(text) % 15_000_000;
    f64::from(saturating_index(limit(hash))) + 1_000_000.0
}

/// The value of a constant of `math`.
pub(super) fn constant_name(name: &str) -> Option<f64> {
    Some(match name {
        "pi" => std::f64::consts::PI,
        "e" => std::f64::consts::E,
        _ => return None,
    })
}

/// True for the number that represents `None`.
pub(super) fn is_none(value: f64) -> bool {
    is_zero(value - NONE)
}

/// True for an omitted item, and for an omitted bound of a slice.
pub(super) fn is_nothing(e: &PyExpr) -> bool {
    matches!(e, PyExpr::Call(name, ..) if name == NOTHING)
}

/// True for a string composed at run time.
pub(super) fn is_joined_text(e: &PyExpr) -> bool {
    match e {
        PyExpr::Call(name, args, _) => {
            name == JOINED_TEXT || (name == "str" && args.len() == 1) || (name == ".format" && !args.is_empty())
        }
        PyExpr::Choice(_, a, b) => is_joined_text(a) && is_joined_text(b),
        _ => false,
    }
}

/// The refusal of such a string where its value is required.
pub(super) fn joined_text_refusal(range: Range<usize>) -> Refusal {
    let why = Refusal::new("a text that is put together while the model runs", range);
    why.remedy(
        "compare texts that are written out, or hand on a number; messages may only be printed and shown by Label",
    )
}

/// True for an object.
pub(super) fn is_object(e: &PyExpr) -> bool {
    matches!(e, PyExpr::Call(name, ..) if name == OBJECT)
}

/// True for a dictionary.
pub(super) fn is_dictionary(e: &PyExpr) -> bool {
    matches!(e, PyExpr::Call(name, ..) if name == DICTIONARY)
}

/// True for numbers, string constants, and lists of them.
pub(super) fn is_written_out(e: &PyExpr) -> bool {
    match e {
        PyExpr::Number(_) | PyExpr::Text(..) => true,
        PyExpr::Neg(a) => matches!(**a, PyExpr::Number(_)),
        PyExpr::List(items, _) => items.iter().all(is_written_out),
        _ => false,
    }
}

/// True for the list that results from a change.
pub(super) fn is_change(e: &PyExpr) -> bool {
    matches!(e, PyExpr::Change(..))
}

/// The place of an expression; numbers do not store theirs.
pub(super) fn range_of(e: &PyExpr) -> Range<usize> {
    match e {
        PyExpr::Number(_) => 0..0,
        PyExpr::Text(_, r)
        | PyExpr::Name(_, r)
        | PyExpr::Call(_, _, r)
        | PyExpr::Change(_, _, r)
        | PyExpr::List(_, r)
        | PyExpr::Index(_, _, r)
        | PyExpr::Each(_, _, _, r) => r.clone(),
        PyExpr::Neg(a) | PyExpr::Not(a) | PyExpr::Binary(_, a, _) | PyExpr::And(a, _) | PyExpr::Or(a, _) => range_of(a),
        PyExpr::Choice(a, ..) => range_of(a),
    }
}

/// The expression with each direct part replaced by the result of `of`.
pub(super) fn with_parts(e: &PyExpr, of: &dyn Fn(&PyExpr) -> PyExpr) -> PyExpr {
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
        PyExpr::Change(change, args, range) => PyExpr::Change(*change, all(args), range.clone()),
        PyExpr::List(items, range) => PyExpr::List(all(items), range.clone()),
        PyExpr::Index(a, b, range) => PyExpr::Index(sub(a), sub(b), range.clone()),
        PyExpr::Each(value, name, list, range) => PyExpr::Each(sub(value), name.clone(), sub(list), range.clone()),
    }
}

/// The expression with names replaced by expressions; the variable of a comprehension `[.. for name in ..]` hides an equal name.
pub(super) fn substitute(e: &PyExpr, names: &[String], values: &[PyExpr]) -> PyExpr {
    let sub = |a: &PyExpr| substitute(a, names, values);
    match e {
        PyExpr::Name(name, _) => names.iter().position(|n| n == name).and_then(|i| values.get(i)).unwrap_or(e).clone(),
        // The variable of the comprehension hides an equal name in the value, but not in the list.
        PyExpr::Each(value, name, list, range) => {
            let others: (Vec<String>, Vec<PyExpr>) =
                names.iter().cloned().zip(values.iter().cloned()).filter(|(n, _)| n != name).unzip();
            let value = Box::new(substitute(value, &others.0, &others.1));
            PyExpr::Each(value, name.clone(), Box::new(sub(list)), range.clone())
        }
        // If a parameter holds a function, `f` in `f(x)` is replaced by another name or a value.
        PyExpr::Call(own, args, range) if names.iter().any(|n| n == own) => {
            let args = args.iter().map(sub);
            match names.iter().position(|n| n == own).and_then(|i| values.get(i)) {
                Some(PyExpr::Name(other, _)) => PyExpr::Call(other.clone(), args.collect(), range.clone()),
                Some(value @ (PyExpr::Text(..) | PyExpr::Number(_))) => {
                    let args = std::iter::once(value.clone()).chain(args).collect();
                    PyExpr::Call(APPLY.to_owned(), args, range.clone())
                }
                _ => PyExpr::Call(own.clone(), args.collect(), range.clone()),
            }
        }
        _ => with_parts(e, &sub),
    }
}

/// The expression with each part that equals `part` replaced by `by`.
pub(super) fn exchanged(e: &PyExpr, part: &PyExpr, by: &PyExpr) -> PyExpr {
    if e == part {
        return by.clone();
    }
    with_parts(e, &|a| exchanged(a, part, by))
}

/// True if the expression reads the name.
pub(super) fn mentions(e: &PyExpr, name: &str) -> bool {
    substitute(e, &[name.to_owned()], &[PyExpr::Number(0.0)]) != *e
}

/// The first call of a function for which `is_one` holds, with arguments before the call they belong to. Values of `[value
/// for name in list]` are not searched, because they are evaluated for each item.
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
        PyExpr::Change(_, items, _) | PyExpr::List(items, _) => items.iter().find_map(of),
    }
}

/// Upper bound on how often an expression reads a name; a comprehension counts its parts twice.
pub(super) fn times_read(e: &PyExpr, name: &str) -> usize {
    let times = |e: &PyExpr| times_read(e, name);
    match e {
        PyExpr::Number(_) | PyExpr::Text(..) => 0,
        PyExpr::Name(own, _) => usize::from(own == name),
        PyExpr::Neg(a) | PyExpr::Not(a) => times(a),
        PyExpr::Binary(_, a, b) | PyExpr::And(a, b) | PyExpr::Or(a, b) | PyExpr::Index(a, b, _) => times(a) + times(b),
        PyExpr::Choice(a, b, c) => times(a) + times(b).max(times(c)),
        PyExpr::Call(_, items, _) | PyExpr::Change(_, items, _) | PyExpr::List(items, _) => {
            items.iter().map(times).sum()
        }
        PyExpr::Each(value, own, list, _) => times(list) * 2 + if own == name { 0 } else { times(value) * 2 },
    }
}

/// A name without the prefix added by [`of_model`].
pub(super) fn plain_name(name: &str) -> &str {
    name.strip_prefix(OF_MODEL).unwrap_or(name)
}

/// A name with the prefix for names of the model, which no variable of a production hides.
pub(super) fn model_name(name: &str) -> String {
    format!("{OF_MODEL}{}", plain_name(name))
}

/// The value of a function in which all names except parameters and `kept` names get the prefix for names of the model.
pub(super) fn of_model(e: &PyExpr, params: &[String], kept: &[String]) -> PyExpr {
    let mut found = BTreeMap::new();
    append_names(e, &mut found);
    // Coordinates of vectors and temporary lists have names that no value of the model can have.
    let is_other = |name: &String| name.contains(['(', '.']) || params.contains(name) || kept.contains(name);
    found.retain(|name, _| !is_other(name));
    let values: Vec<PyExpr> = found.iter().map(|(name, range)| PyExpr::Name(model_name(name), range.clone())).collect();
    let names: Vec<String> = found.into_keys().collect();
    substitute(e, &names, &values)
}

/// Appends the names that an expression reads, each with its last place.
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
        PyExpr::Call(_, items, _) | PyExpr::Change(_, items, _) | PyExpr::List(items, _) => {
            items.iter().for_each(|e| append_names(e, out));
        }
    }
}

/// Number of operands of an expression after names are replaced by expressions.
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
        PyExpr::Call(_, args, _) | PyExpr::Change(_, args, _) | PyExpr::List(args, _) => total(args),
    }
}
