//! Reads assignments, and changes of lists, which are represented as assignments of the changed list.

use std::collections::BTreeSet;
use std::ops::Range;

use osier_base::convert::saturating_index;

use super::expression::{
    ATTRIBUTE, ListChange, METHOD, NOTHING, OPERATORS, PyExpr, PyOp, SLICE, first_call, is_joined_text,
    joined_text_refusal, mentions,
};
use super::lines::Line;
use super::parser::parse;
use super::pieces::{AttributeTarget, assignment, attribute_target, bracketed, inside, is_name, method_call, split};
use super::refusal::{Refusal, nested_change};
use super::scope::Scope;
use super::statement::{DIRECTION, GROUP, Statement};
use crate::dialect::text::Piece;

/// A change of an item, `name[index] = value`, or with an operator, `name[index] += value`.
struct ItemChange<'t> {
    name: Piece<'t>,
    index: Piece<'t>,
    /// The second index of `name[index][1] = value`.
    column: Option<Piece<'t>>,
    /// True if there are more than two indices.
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
        let mut column = None;
        if rest.text.starts_with('[') {
            let (second, after) = bracketed(rest)?;
            (column, rest) = (Some(second), after);
        }
        let is_nested = rest.text.starts_with('[');
        while rest.text.starts_with('[') {
            rest = bracketed(rest)?.1;
        }
        let op = OPERATORS.iter().find(|(sign, _)| rest.text.starts_with(sign)).copied();
        let is_set = rest.text.starts_with('=') && !rest.text.starts_with("==");
        let length = op.map_or(1, |(sign, _)| sign.len());
        let value = rest.from(length).trimmed();
        (op.is_some() || is_set).then_some(Self { name, index, column, is_nested, op: op.map(|(_, op)| op), value })
    }
}

/// The assignments (name and value) that represent a line which changes a list; `None` for a line that changes none.
pub(super) fn change_of(piece: Piece<'_>) -> Result<Option<Vec<(String, PyExpr)>>, Refusal> {
    let named = |name: Piece<'_>| PyExpr::Name(name.text.to_owned(), name.range());
    let changed = |name: Piece<'_>, change: ListChange, args: Vec<PyExpr>| {
        let args = std::iter::once(named(name)).chain(args).collect();
        (name.text.to_owned(), PyExpr::Change(change, args, piece.range()))
    };
    // `del q[0]` removes an item, as `q.pop(0)` does.
    if let Some(taken) = piece.text.strip_prefix("del ").map(|_| piece.from("del ".len()).trimmed()) {
        let open = taken.text.find('[').filter(|open| is_name(taken.up_to(*open).trimmed().text));
        let inner = open
            .and_then(|open| Some((open, bracketed(taken.from(open))?)))
            .filter(|(_, (_, rest))| rest.text.is_empty());
        let Some((open, (index, _))) = inner else { return Ok(None) };
        return Ok(Some(vec![changed(taken.up_to(open).trimmed(), ListChange::Pop, vec![parse(index)?])]));
    }
    let parsed = |args: Vec<Piece<'_>>| args.into_iter().map(parse).collect::<Result<Vec<_>, _>>();
    if let Some(call) = method_call(piece)
        && let Some(change) = ListChange::of_method(call.method)
    {
        return Ok(Some(vec![changed(call.name, change, parsed(call.args)?)]));
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
        return Ok(Some(vec![(target.text.to_owned(), value), changed(call.name, ListChange::Pop, args)]));
    }
    if let Some(AttributeTarget { object, field, rest }) = attribute_target(piece) {
        let op = OPERATORS.iter().find(|(sign, _)| rest.text.starts_with(sign)).copied();
        let value = parse(rest.from(op.map_or(1, |(sign, _)| sign.len())).trimmed())?;
        let old = || Box::new(PyExpr::Call(format!("{ATTRIBUTE}{field}"), vec![named(object)], piece.range()));
        let value = op.map_or_else(|| value.clone(), |(_, op)| PyExpr::Binary(op, old(), Box::new(value.clone())));
        let key = PyExpr::Call(format!("{field}="), Vec::new(), piece.range());
        return Ok(Some(vec![changed(object, ListChange::Set, vec![key, value])]));
    }
    let Some(item) = ItemChange::new(piece) else { return Ok(None) };
    if item.is_nested {
        return Err(nested_change(piece.range()));
    }
    let (mut index, value) = (parse(item.index)?, parse(item.value)?);
    let at = |list: PyExpr, index: &PyExpr| PyExpr::Index(Box::new(list), Box::new(index.clone()), piece.range());
    let mut read = at(named(item.name), &index);
    // An item of a list of lists has two indices.
    if let Some(column) = item.column {
        let column = parse(column)?;
        read = at(read, &column);
        index = PyExpr::List(vec![index, column], piece.range());
    }
    let old = || Box::new(read.clone());
    let value = item.op.map_or_else(|| value.clone(), |op| PyExpr::Binary(op, old(), Box::new(value.clone())));
    Ok(Some(vec![changed(item.name, ListChange::Set, vec![index, value])]))
}

/// The expression `list[k]`.
pub(super) fn item_of(list: &PyExpr, k: u32, place: Range<usize>) -> PyExpr {
    PyExpr::Index(Box::new(list.clone()), Box::new(PyExpr::Number(f64::from(k))), place)
}

/// Reads an assignment of a production: `x = e`, `x = y = e`, `x, y = e, f`, `x, y = list`, `x += e`.
pub(super) fn assign_statement(piece: Piece<'_>) -> Result<Vec<Statement>, Refusal> {
    let refused = || {
        let shown: String = piece.text.chars().take(40).collect();
        Refusal::new(format!("'{shown}' in a production"), piece.range())
    };
    if let Some(number) = piece.text.strip_prefix("useGroup(").and_then(|n| n.strip_suffix(')')) {
        let number = parse(Piece::new(piece.at + "useGroup(".len(), number))?;
        return Ok(vec![Statement::Assign(GROUP.to_owned(), number)]);
    }
    if let Some(is_backward) = match piece.text.replace(' ', "").as_str() {
        "backward()" => Some(true),
        "forward()" => Some(false),
        _ => None,
    } {
        let value = PyExpr::Number(if is_backward { 1.0 } else { 0.0 });
        return Ok(vec![Statement::Assign(DIRECTION.to_owned(), value)]);
    }
    if piece.text.replace(' ', "") == "Stop()" {
        return Ok(vec![Statement::Stop(piece.range())]);
    }
    if let Some(changes) = change_of(piece)? {
        return Ok(changes.into_iter().map(|(name, e)| Statement::Assign(name, e)).collect());
    }
    for (sign, op) in OPERATORS {
        if let Some(i) = piece.text.find(sign) {
            let name = piece.up_to(i).trimmed();
            let value = parse(piece.from(i + sign.len()).trimmed())?;
            // `x += e` becomes `x = x + e`.
            let old = PyExpr::Name(name.text.to_owned(), name.range());
            let sum = PyExpr::Binary(op, Box::new(old), Box::new(value));
            return Ok(vec![Statement::Assign(name.text.to_owned(), sum)]);
        }
    }
    let (names, mut value) = assignment(piece).ok_or_else(refused)?;
    let names = split(names);
    // `x = y = e` evaluates e once.
    let mut others = Vec::new();
    while let Some((other, last)) = assignment(value) {
        if split(other).len() != 1 {
            return Err(refused());
        }
        others.push(other);
        value = last;
    }
    if !others.is_empty() {
        let [first] = names.as_slice() else { return Err(refused()) };
        let same = || PyExpr::Name(first.text.to_owned(), first.range());
        let mut out = vec![Statement::Assign(first.text.to_owned(), parse(value)?)];
        out.extend(others.iter().map(|name| Statement::Assign(name.text.to_owned(), same())));
        return Ok(out);
    }
    let values = split(value);
    let values = match (names.iter().position(|name| name.text.starts_with('*')), values.as_slice()) {
        (Some(at), _) => starred(names.len(), at, value, piece.range())?,
        (None, several) if several.len() == names.len() => {
            several.iter().map(|v| parse(*v)).collect::<Result<Vec<_>, _>>()?
        }
        // `x, y = list`: one name for each item.
        (None, [list]) => items_for(names.len(), parse(*list)?, piece.range()).ok_or_else(refused)?,
        _ => return Err(refused()),
    };
    let (names, values) = without_nesting(names, values, piece.range()).ok_or_else(refused)?;
    let mut out = Vec::with_capacity(values.len());
    // Python evaluates all values before it sets the first name. If a value reads a name that an earlier target sets, store all
    // values in temporary variables first.
    let plain = |name: &Piece<'_>| name.text.trim_start_matches('*').trim().to_owned();
    let reads_earlier = |(k, value): (usize, &PyExpr)| names.iter().take(k).any(|name| mentions(value, &plain(name)));
    if values.iter().enumerate().any(reads_earlier) {
        let waiting = |k: usize| format!("(value {k} of {})", piece.at);
        out.extend(values.into_iter().enumerate().map(|(k, value)| Statement::Assign(waiting(k), value)));
        out.extend(names.iter().enumerate().map(|(k, name)| {
            let value = PyExpr::Name(waiting(k), name.range());
            Statement::Assign(plain(name), value)
        }));
    } else {
        out.extend(names.iter().zip(values).map(|(name, value)| Statement::Assign(plain(name), value)));
    }
    Ok(out)
}

/// Items of one list for `count` targets; `None` for a number or string, and for a list of another length.
fn items_for(count: usize, list: PyExpr, place: Range<usize>) -> Option<Vec<PyExpr>> {
    match list {
        PyExpr::List(items, _) => Some(items).filter(|items| items.len() == count),
        PyExpr::Number(_) | PyExpr::Text(..) => None,
        list => Some((0..count).map(|k| item_of(&list, saturating_index(k), place.clone())).collect()),
    }
}

/// Flattens nested targets to single names with their values: `(a, b), c = p, 1` sets `a` to the first item of p. `None` if a
/// list and its targets differ in number.
fn without_nesting(
    names: Vec<Piece<'_>>,
    values: Vec<PyExpr>,
    place: Range<usize>,
) -> Option<(Vec<Piece<'_>>, Vec<PyExpr>)> {
    let mut out = (Vec::with_capacity(names.len()), Vec::with_capacity(names.len()));
    // A stack of targets with their values, of which the last one is next.
    let mut open: Vec<(Piece<'_>, PyExpr)> = names.into_iter().zip(values).rev().collect();
    while let Some((target, value)) = open.pop() {
        let parts = inside(target).map(split);
        match parts.as_deref() {
            None => {
                out.0.push(target);
                out.1.push(value);
            }
            // Parentheses around one name have no effect.
            Some([only]) => open.push((*only, value)),
            Some(parts) => {
                let items = items_for(parts.len(), value, place.clone())?;
                open.extend(parts.iter().copied().zip(items).rev());
            }
        }
    }
    Some(out)
}

/// Values of `count` targets, of which target `at` has a star, as in `first, *rest = q`: it takes the items that the other
/// targets leave.
fn starred(count: usize, at: usize, value: Piece<'_>, place: Range<usize>) -> Result<Vec<PyExpr>, Refusal> {
    let list = parse(value)?;
    let after = count - at - 1;
    let number = |k: usize| PyExpr::Number(f64::from(saturating_index(k)));
    let none = || PyExpr::Call(NOTHING.to_owned(), Vec::new(), place.clone());
    let indexed = |index: PyExpr| PyExpr::Index(Box::new(list.clone()), Box::new(index), place.clone());
    let value = |k: usize| match k.cmp(&at) {
        std::cmp::Ordering::Less => indexed(number(k)),
        // Targets after the starred one take items counted from the end of the list.
        std::cmp::Ordering::Greater => indexed(PyExpr::Neg(Box::new(number(count - k)))),
        std::cmp::Ordering::Equal => {
            let end = if after == 0 { none() } else { PyExpr::Neg(Box::new(number(after))) };
            indexed(PyExpr::Call(SLICE.to_owned(), vec![number(at), end], place.clone()))
        }
    };
    Ok((0..count).map(value).collect())
}

/// The name that a line of a function sets to an unreadable value, with the reason; only uses of the name are refused. `scope`
/// contains the functions of the model, `defined` their names.
pub(super) fn unreadable_assignment<'t>(
    line: &Line<'t>,
    scope: &Scope,
    defined: &BTreeSet<String>,
) -> Option<(&'t str, Refusal)> {
    let (names, value) = assignment(line.piece)?;
    let is_unknown = |name: &str| name.starts_with(METHOD) && !defined.contains(name);
    let why = match parse(value) {
        Err(why) => why,
        Ok(e) if is_joined_text(&e) => joined_text_refusal(value.range()),
        Ok(e) => match first_call(&e, &is_unknown)? {
            PyExpr::Call(name, _, range) => scope.refused_call(name, range.clone()),
            _ => return None,
        },
    };
    (split(names).len() == 1).then_some((names.text, why))
}
