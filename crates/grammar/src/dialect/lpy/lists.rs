//! Lists that change: `q.append(x)`, `q[1] = x` and the like are assignments of the list that they leave. In Python a list may have
//! two names, of which a change of one is a change of the other: such a list, and one that another block has made, is not changed.

use std::collections::BTreeSet;
use std::ops::Range;

use osier_base::convert::saturating_index;

use super::expression::{MAX_OPS, PyExpr, PyOp, Refusal, SLICE, Scope, constant_of, is_dictionary, range_of, sorted};
use super::parser::parse;
use super::statement::{OPERATORS, Statement};
use super::strings::{closing, split};
use super::ways::Way;
use super::{Model, assignment, is_name};
use crate::code::is_zero;
use crate::dialect::text::Piece;

/// What the names of calls begin with that stand for changed lists; no function has such a name.
const CHANGE: &str = "list.";
/// Methods that change a list.
const METHODS: [&str; 7] = ["append", "extend", "insert", "pop", "reverse", "sort", "clear"];
/// Functions that read lists and keep none of them.
const READERS: [&str; 21] = [
    "len",
    "sum",
    "min",
    "max",
    "any",
    "all",
    "list",
    "tuple",
    "reversed",
    "sorted",
    "range",
    "xrange",
    "bool",
    "in",
    "enumerate",
    "zip",
    ".keys",
    ".values",
    ".items",
    ".index",
    ".copy",
];

/// True for a list that a change leaves.
pub(super) fn is_change(e: &PyExpr) -> bool {
    matches!(e, PyExpr::Call(name, ..) if name.starts_with(CHANGE))
}

/// True for `q + [..]` as the value of q, which `q += [..]` is, too: it changes the list.
fn extends(name: &str, e: &PyExpr) -> bool {
    let PyExpr::Binary(PyOp::Add, before, more) = e else { return false };
    let is_own = matches!(&**before, PyExpr::Name(own, _) if own == name);
    is_own && matches!(&**more, PyExpr::List(..) | PyExpr::Each(..))
}

/// The change that the name of a call stands for.
pub(super) fn change_named(name: &str) -> Option<&str> {
    name.strip_prefix(CHANGE)
}

/// A call of a method, `name.method(arguments)`.
struct MethodCall<'t> {
    name: Piece<'t>,
    method: &'t str,
    args: Vec<Piece<'t>>,
}

fn method_call(piece: Piece<'_>) -> Option<MethodCall<'_>> {
    let dot = piece.text.find('.')?;
    let name = piece.up_to(dot).trimmed();
    let call = piece.from(dot + 1);
    let open = call.text.find('(')?;
    let inner = call.from(open + 1);
    let close = closing(inner.text)?;
    let is_whole = inner.from(close + 1).text.trim().is_empty();
    let method = call.up_to(open).text.trim();
    (is_name(name.text) && is_whole).then(|| MethodCall { name, method, args: split(inner.up_to(close)) })
}

/// The assignments, of names and values, that a line makes which changes a list; `None` for any other line.
pub(super) fn change_of(piece: Piece<'_>) -> Result<Option<Vec<(String, PyExpr)>>, Refusal> {
    let named = |name: Piece<'_>| PyExpr::Name(name.text.to_owned(), name.range());
    let changed = |name: Piece<'_>, method: &str, args: Vec<PyExpr>| {
        let args = std::iter::once(named(name)).chain(args).collect();
        (name.text.to_owned(), PyExpr::Call(format!("{CHANGE}{method}"), args, piece.range()))
    };
    let parsed = |args: Vec<Piece<'_>>| args.into_iter().map(parse).collect::<Result<Vec<_>, _>>();
    if let Some(call) = method_call(piece).filter(|call| METHODS.contains(&call.method)) {
        return Ok(Some(vec![changed(call.name, call.method, parsed(call.args)?)]));
    }
    // `x = q.pop()`
    let taken = assignment(piece).and_then(|(target, value)| Some((target, method_call(value)?)));
    if let Some((target, call)) = taken.filter(|(target, call)| call.method == "pop" && is_name(target.text)) {
        if target.text == call.name.text {
            return Ok(None);
        }
        let args = parsed(call.args)?;
        let index = args.first().cloned().unwrap_or(PyExpr::Number(-1.0));
        let value = PyExpr::Index(Box::new(named(call.name)), Box::new(index), piece.range());
        return Ok(Some(vec![(target.text.to_owned(), value), changed(call.name, "pop", args)]));
    }
    let Some(item) = ItemChange::new(piece) else { return Ok(None) };
    if item.is_nested {
        let why = Refusal::new("a change of an item within a list of lists", piece.range());
        return Err(why.remedy("change the inner list under a name of its own, then set the whole item: q[0] = p"));
    }
    let (index, value) = (parse(item.index)?, parse(item.value)?);
    let old = || Box::new(PyExpr::Index(Box::new(named(item.name)), Box::new(index.clone()), piece.range()));
    let value = item.op.map_or_else(|| value.clone(), |op| PyExpr::Binary(op, old(), Box::new(value.clone())));
    Ok(Some(vec![changed(item.name, "set", vec![index, value])]))
}

/// `name[index] = value`, or with an operator, `name[index] += value`.
struct ItemChange<'t> {
    name: Piece<'t>,
    index: Piece<'t>,
    /// More brackets follow, `name[index][1] = value`.
    is_nested: bool,
    op: Option<PyOp>,
    value: Piece<'t>,
}

impl<'t> ItemChange<'t> {
    fn new(piece: Piece<'t>) -> Option<Self> {
        let open = piece.text.find('[')?;
        let name = piece.up_to(open).trimmed();
        if !is_name(name.text) {
            return None;
        }
        let (index, mut rest) = bracketed(piece.from(open))?;
        let is_nested = rest.text.starts_with('[');
        while rest.text.starts_with('[') {
            rest = bracketed(rest)?.1;
        }
        let op = OPERATORS.iter().find(|(sign, _)| rest.text.starts_with(sign)).copied();
        let is_set = rest.text.starts_with('=') && !rest.text.starts_with("==");
        let length = op.map_or(1, |(sign, _)| sign.len());
        let value = rest.from(length).trimmed();
        (op.is_some() || is_set).then_some(Self { name, index, is_nested, op: op.map(|(_, op)| op), value })
    }
}

/// What stands in the bracket at the beginning of a text, and what stands behind it.
fn bracketed(piece: Piece<'_>) -> Option<(Piece<'_>, Piece<'_>)> {
    let mut depth = 0_usize;
    let close = piece.text.char_indices().find_map(|(i, c)| {
        match c {
            '[' | '(' => depth += 1,
            ']' | ')' => depth = depth.saturating_sub(1),
            _ => {}
        }
        (c == ']' && depth == 0).then_some(i)
    })?;
    Some((piece.up_to(close).from(1).trimmed(), piece.from(close + 1).trimmed()))
}

/// The list that a change leaves, from the resolved list before it and the resolved arguments of the change.
pub(super) fn changed(change: &str, args: &[PyExpr], scope: &Scope, range: &Range<usize>) -> Result<PyExpr, Refusal> {
    let refused = || Refusal::new(format!("this change of a list, '{change}'"), range.clone());
    let (before, args) = args.split_first().ok_or_else(refused)?;
    // Of a dictionary only a value is set.
    if is_dictionary(before) {
        return match (before, change, args) {
            (PyExpr::Call(name, pairs, range), "set", [key, value]) => {
                Ok(PyExpr::Call(name.clone(), with_pair(pairs, key, value, scope)?, range.clone()))
            }
            _ => Err(refused()),
        };
    }
    let PyExpr::List(items, place) = before else { return Err(refused()) };
    // Of a list, each change does what the method of Python of that name does.
    let mut items = items.clone();
    match (change, args) {
        ("append", [value]) => items.push(value.clone()),
        ("extend", [PyExpr::List(more, _)]) => items.extend(more.iter().cloned()),
        ("insert", [at, value]) => {
            let at = position(at, items.len(), scope).ok_or_else(refused)?.min(items.len());
            items.insert(at, value.clone());
        }
        ("pop", []) if !items.is_empty() => {
            items.pop();
        }
        ("pop", [at]) => {
            let at = position(at, items.len(), scope).filter(|at| *at < items.len()).ok_or_else(refused)?;
            items.remove(at);
        }
        ("set", [at, value]) => {
            let at = position(at, items.len(), scope).ok_or_else(refused)?;
            *items.get_mut(at).ok_or_else(refused)? = value.clone();
        }
        ("reverse", []) => items.reverse(),
        ("sort", []) => return sorted(&items, scope, range),
        ("clear", []) => items.clear(),
        _ => return Err(refused()),
    }
    if items.len() > MAX_OPS {
        return Err(Refusal::new("a list of too many items", range.clone()));
    }
    Ok(PyExpr::List(items, place.clone()))
}

/// The pairs of a dictionary with another value of a key, which is constant.
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

/// The position of a constant index, which counts from the end below 0.
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

/// True if statements change the list of a name.
pub(super) fn changes(statements: &[Statement], name: &str) -> bool {
    statements.iter().any(|s| match s {
        Statement::Assign(own, e) => own == name && is_change(e),
        Statement::If(tests, other) => tests.iter().any(|(_, then)| changes(then, name)) || changes(other, name),
        Statement::For(_, _, body, _) | Statement::While(_, body, ..) => changes(body, name),
        _ => false,
    })
}

/// What an assignment makes of lists that have names.
#[derive(Debug, Default)]
pub(super) struct HandedOn {
    /// Names whose lists the value may be, or may hold as items.
    names: BTreeSet<String>,
    /// The value may be one of these lists itself.
    is_same: bool,
}

impl HandedOn {
    fn new(e: &PyExpr) -> Self {
        let mut names = BTreeSet::new();
        append_held(e, &mut names);
        Self { names, is_same: !matches!(e, PyExpr::List(..)) && !is_change(e) }
    }
}

fn append_held(e: &PyExpr, out: &mut BTreeSet<String>) {
    match e {
        PyExpr::Name(name, _) => {
            out.insert(name.clone());
        }
        // A slice is a copy.
        PyExpr::Index(_, part, _) if matches!(&**part, PyExpr::Call(name, ..) if name == SLICE) => {}
        PyExpr::Index(list, _, _) => append_held(list, out),
        PyExpr::Choice(_, a, b) | PyExpr::And(a, b) | PyExpr::Or(a, b) => {
            append_held(a, out);
            append_held(b, out);
        }
        PyExpr::List(items, _) => items.iter().for_each(|item| append_held(item, out)),
        PyExpr::Each(value, _, list, _) => {
            append_held(value, out);
            append_held(list, out);
        }
        PyExpr::Call(name, args, _) if is_change(e) || !READERS.contains(&name.as_str()) => {
            args.iter().skip(usize::from(is_change(e))).for_each(|arg| append_held(arg, out));
        }
        _ => {}
    }
}

/// The refusal of a change of a list.
fn change_refusal(name: &str, why: &str, place: Range<usize>, remedy: &'static str) -> Refusal {
    // Variables of axioms and functions have a number behind their names.
    let name = name.split(" (").next().unwrap_or(name);
    Refusal::new(format!("a change of the list '{name}', which {why}"), place).remedy(remedy)
}

/// What to write instead of a change of such a list.
const COPY: &str = "make a copy under another name and change that one: p = list(q)";

impl Model<'_, '_> {
    /// What a statement hands on. Refuses a change of a list that the statements of the way have not made, or that has two names.
    pub(super) fn handed_on(&self, statement: &Statement, way: &Way) -> Result<HandedOn, Refusal> {
        let Statement::Assign(name, e) = statement else { return Ok(HandedOn::default()) };
        self.check_change(name, e, way)?;
        Ok(HandedOn::new(e))
    }

    fn check_change(&self, name: &str, e: &PyExpr, way: &Way) -> Result<(), Refusal> {
        let is_change = is_change(e);
        if !is_change && !extends(name, e) {
            return Ok(());
        }
        let is_of_model = self.is_in_axiom && self.scope.lists.contains_key(name);
        if is_change && !way.lists.contains_key(name) && !is_of_model {
            return Err(change_refusal(name, "this block has not made", range_of(e), COPY));
        }
        if way.shared_lists.contains(name) || (is_of_model && self.shared_lists.contains(name)) {
            return Err(change_refusal(name, "has two names", range_of(e), COPY));
        }
        Ok(())
    }

    /// Notes the lists that have two names after a list is assigned to a name.
    pub(super) fn share_lists(&self, name: &str, handed_on: &HandedOn, way: &mut Way) {
        let is_temporary = |name: &str| name.starts_with('(');
        for other in handed_on.names.iter().filter(|other| *other != name) {
            let is_list = way.lists.contains_key(other) || self.scope.lists.contains_key(other);
            // Variables of this reader are read once: what they hand on has two names if it had before.
            let is_read_again = !is_temporary(name) && !is_temporary(other);
            if is_list && (is_read_again || way.shared_lists.contains(other)) {
                way.shared_lists.insert(other.clone());
                if handed_on.is_same {
                    way.shared_lists.insert(name.to_owned());
                }
            }
        }
    }

    /// As [`Self::check_change`], for a line of the model outside of blocks. True for a change of a value that cannot be read, which is
    /// refused where it is used.
    pub(super) fn check_change_of_model(&self, name: &str, e: &PyExpr) -> Result<bool, Refusal> {
        let is_change = is_change(e);
        if is_change && self.scope.unreadable.contains_key(name) {
            return Ok(true);
        }
        if is_change && !self.scope.lists.contains_key(name) {
            return Err(change_refusal(name, "is no list of known values", range_of(e), "begin with a list: q = []"));
        }
        if (is_change || extends(name, e)) && self.shared_lists.contains(name) {
            return Err(change_refusal(name, "has two names", range_of(e), COPY));
        }
        Ok(false)
    }

    /// As [`Self::share_lists`], for a value of the model.
    pub(super) fn share_lists_of_model(&mut self, name: &str, e: &PyExpr) {
        let handed_on = HandedOn::new(e);
        if !is_change(e) {
            self.shared_lists.remove(name);
        }
        for other in handed_on.names {
            if other != name && self.scope.lists.contains_key(&other) {
                self.shared_lists.insert(other);
                if handed_on.is_same {
                    self.shared_lists.insert(name.to_owned());
                }
            }
        }
    }
}
