//! Lists and dictionaries of the model that productions and functions change: arrays of the stack machine, which hold numbers.
//! Outside of blocks, and in the axiom, they are ordinary lists; productions begin with the items that they have at the end of
//! the model.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;
use std::rc::Rc;

use osier_base::convert::saturating_index;

use super::Model;
use super::arrays::{ChangedList, ELEMENT, ListRow};
use super::assignment::change_of;
use super::emit::{append_code, constant_of};
use super::expression::{DICTIONARY, IN, ListChange, PyExpr, PyOp, SLICE, is_nothing, plain_name, range_of};
use super::lines::{Line, block_after};
use super::pieces::{assignment, block_colon, heads_block, is_name, split, statements_of_line};
use super::refusal::{Refusal, nested_change};
use super::resolve::{compile, may_be_list, resolve};
use super::scope::{RUN, RunFunction, Scope, has_random, slot_number};
use super::statement::{Statement, Store};
use super::vectors::{coordinates_of, dimension, vector};
use crate::code::{ArrayShape, BinaryOp, ElementAccess, Op};

/// Limit on the elements of all changed lists together; each list gets an equal share. The rest of the 65,535 slots is for
/// variables of the model.
const MAX_ELEMENTS: usize = 49_152;
/// Limit on the items of one such list. Own: the stack machine is copied with its variables in each step.
const MAX_LENGTH: usize = 8_192;

/// Limit on the number of changed lists. Own: each is searched for in all lines of the model.
const MAX_LISTS: usize = 64;

/// Name of the call that represents the position of a key in such a dictionary; no function has it.
const POSITION: &str = "(position)";

/// Kind of the items of a list, derived from an unresolved expression for one item; `None` if the item may be a number.
fn row_of(e: &PyExpr) -> Option<ListRow> {
    match e {
        PyExpr::List(items, _) if !items.is_empty() => Some(ListRow { width: items.len(), is_vector: false }),
        PyExpr::Call(name, ..) => dimension(name).map(|width| ListRow { width, is_vector: true }),
        _ => None,
    }
}

/// The numbers of a resolved list or vector.
fn numbers_of(e: &PyExpr) -> Option<&[PyExpr]> {
    match e {
        PyExpr::List(items, _) => Some(items),
        other => coordinates_of(other),
    }
}

/// Name of the variable that holds the length of such a list.
fn length_name(list: &str) -> String {
    format!("(length of {list})")
}

/// Name of the list of the keys of a dictionary.
fn keys_name(dictionary: &str) -> String {
    format!("(keys of {dictionary})")
}

/// True if `word` occurs in `text` as a whole word.
fn has_word(text: &str, word: &str) -> bool {
    text.split(|c: char| !c.is_alphanumeric() && c != '_').any(|own| own == word)
}

/// Names of lists in the text of a model.
#[derive(Default)]
struct ListNames {
    /// Lists of the model: set outside of blocks, or in a block that declares the name `global`.
    made: BTreeSet<String>,
    /// Names that some block uses for a local variable or a parameter.
    own: BTreeSet<String>,
    /// Names that blocks change as lists.
    changed: BTreeSet<String>,
    /// Kind of the items that blocks add to each list.
    rows: BTreeMap<String, ListRow>,
}

impl ListNames {
    /// Adds the names of a block with this heading.
    fn add_block(&mut self, head: &str, block: &[Line<'_>]) {
        let mut global: BTreeSet<String> = BTreeSet::new();
        let (mut set, mut lists, mut altered) = (BTreeSet::new(), BTreeSet::new(), BTreeSet::new());
        // A statement may follow the heading of a block on the same line.
        let parts = block.iter().flat_map(|line| {
            let piece = line.piece;
            let (word, _) = piece.first_word(&['(', ':', '=', '[']);
            let inline = block_colon(piece).filter(|_| heads_block(word.text)).map(|c| piece.from(c + 1).trimmed());
            let plain = Some(piece).filter(|_| !heads_block(word.text));
            statements_of_line(inline.or(plain).unwrap_or(piece))
        });
        for part in parts {
            if let Some(names) = part.text.strip_prefix("global ") {
                global.extend(names.split(',').map(|n| n.trim().to_owned()));
            }
            if let Ok(Some(changes)) = change_of(part) {
                for (name, e) in changes {
                    let PyExpr::Change(change, args, _) = &e else { continue };
                    if matches!(change, ListChange::Append | ListChange::Set)
                        && let Some(row) = args.last().and_then(row_of)
                    {
                        self.rows.insert(name.clone(), row);
                    }
                    altered.insert(name);
                }
            } else if let Some((names, value)) = assignment(part) {
                let names: Vec<String> = split(names).iter().map(|n| n.text.to_owned()).collect();
                if is_list_text(value.text) {
                    lists.extend(names.iter().cloned());
                }
                set.extend(names);
            }
        }
        // Collect the loop variables; below, record the changed lists and the parameters and local names that hide them.
        for line in block {
            if let Some((targets, _)) = line.piece.text.strip_prefix("for ").and_then(|t| t.split_once(" in ")) {
                set.extend(targets.split([',', '(', ')']).map(|n| n.trim().to_owned()));
            }
        }
        self.made.extend(lists.intersection(&global).cloned());
        self.own.extend(altered.iter().filter(|name| has_word(head, name)).cloned());
        self.own.extend(set.difference(&global).cloned());
        self.changed.extend(altered);
    }
}

/// True for a text that makes a list or a dictionary.
fn is_list_text(text: &str) -> bool {
    text.starts_with(['[', '{']) || text.starts_with("list(") || text.starts_with("dict(")
}

impl Model<'_, '_> {
    /// Finds the lists and dictionaries of the model that productions and functions change, except those whose name is a local
    /// variable or parameter in some block.
    pub(super) fn find_changed_lists(&mut self, list: &[Line<'_>]) {
        let mut names = ListNames::default();
        let mut i = 0;
        while let Some(line) = list.get(i).filter(|line| line.piece.text != "endlsystem") {
            let (block, next) = block_after(list, i, line.indent);
            let (word, rest) = line.piece.first_word(&['(', ':', '=']);
            let is_block = word.text == "def" || !(heads_block(word.text) || assignment(line.piece).is_some());
            if is_block {
                let c = block_colon(rest);
                let head = c.map_or(rest, |c| rest.up_to(c));
                // A block of one line may follow its heading on the same line.
                let after = c.map_or(rest.from(rest.text.len()), |c| rest.from(c + 1).trimmed());
                let inline = [Line { indent: 1, piece: after }];
                let lines = if block.is_empty() && !line.piece.text.contains("-->") { &inline } else { block };
                names.add_block(head.text, lines);
            } else if let Some((targets, _)) = assignment(line.piece) {
                names.made.extend(split(targets).iter().filter(|n| is_name(n.text)).map(|n| n.text.to_owned()));
            }
            i = next.max(i + 1);
        }
        let ListNames { made, own, mut changed, rows } = names;
        changed.retain(|name| made.contains(name) && !own.contains(name));
        self.scope.rows = rows;
        if changed.is_empty() || changed.len() > MAX_LISTS {
            return;
        }
        // A dictionary also has an array of its keys.
        let mut names = Vec::new();
        for name in &changed {
            let is_it = |line: &&Line<'_>| assignment(line.piece).is_some_and(|(n, _)| has_word(n.text, name));
            let line = list.iter().find(is_it);
            let place = self.reader.place(line.map_or(0..0, |line| line.piece.range()));
            names.push((name.clone(), place));
            let value = line.and_then(|line| assignment(line.piece)).map_or("", |(_, value)| value.text);
            if value.starts_with(['{']) || value.starts_with("dict(") {
                names.push((keys_name(name), place));
            }
        }
        let length = (MAX_ELEMENTS / names.len()).min(MAX_LENGTH);
        self.scope.array_slots = names.len() * length;
        let elements = names.into_iter().enumerate().map(|(k, (name, place))| ElementAccess {
            // Below 65,536, as all arrays together have at most `MAX_ELEMENTS` elements.
            shape: ArrayShape { first: slot_number(k * length), sizes: vec![saturating_index(length)] },
            name,
            place,
        });
        self.scope.elements = Rc::new(elements.collect());
        self.scope.changing = Rc::new(changed);
    }

    /// Creates the arrays of the lists that productions change, with the items that these have at the end of the model.
    pub(super) fn begin_changed_lists(&mut self) {
        let names: Vec<String> = self.scope.changing.iter().cloned().collect();
        for name in names {
            let value = self.scope.lists.remove(&name);
            self.scope.constants.remove(&name);
            let find = |wanted: &str| self.scope.elements.iter().position(|own| own.name == wanted);
            let Some(number) = find(&name) else { continue };
            let keys_number = find(&keys_name(&name));
            let (keys, items) = match value {
                Some(PyExpr::List(items, _)) => (Vec::new(), items),
                Some(PyExpr::Call(call, pairs, _)) if call == DICTIONARY => {
                    (pairs.iter().step_by(2).cloned().collect(), pairs.into_iter().skip(1).step_by(2).collect())
                }
                _ => (Vec::new(), Vec::new()),
            };
            let access = self.scope.elements.get(number);
            let most = access.and_then(|a| a.shape.sizes.first()).map_or(0, |n| *n as usize);
            let range = access.map_or(0..0, |a| a.place.span.start as usize..a.place.span.end as usize);
            if self.shared_lists.contains(&name) {
                let why = Refusal::new(format!("a change of the list '{name}', which has two names"), range);
                self.refuse(&why.remedy("make a copy under another name and change that one: p = list(q)"));
                continue;
            }
            let is_list = keys.is_empty();
            // Items that are lists or vectors are stored as rows of numbers, one after the other.
            let known = self.scope.rows.get(&name).copied();
            let row = items.first().map_or(known, row_of);
            let length = items.len();
            let is_row = |item: &PyExpr| row_of(item) == row;
            if row.is_some() && (keys_number.is_some() || !items.iter().all(is_row)) {
                let why = format!("the list '{name}', which productions change, with items of several kinds");
                self.refuse(&Refusal::new(why, range).remedy("give all of its lists one length"));
                continue;
            }
            let items: Vec<PyExpr> = match row {
                Some(_) => items.iter().filter_map(numbers_of).flatten().cloned().collect(),
                None => items,
            };
            if items.len() > most || (!is_list && keys_number.is_none()) {
                let what = if is_list { format!("more than {most} items") } else { "another kind of value".to_owned() };
                let why = Refusal::new(format!("the list '{name}', which productions change, with {what}"), range);
                self.refuse(&why.remedy("give the values to modules as parameters"));
                continue;
            }
            let arrays = [(Some(number), &items), (keys_number, &keys)];
            for (number, values) in arrays.into_iter().filter_map(|(number, values)| Some((number?, values))) {
                for (k, item) in values.iter().enumerate() {
                    let code = compile(item, &self.scope).map_err(|why| {
                        let construct = format!("the list '{name}', which productions change: {}", why.construct);
                        let why = Refusal { construct, range: range.clone(), ..why };
                        why.remedy("such a list holds numbers: keep each coordinate of points in a list of its own")
                    });
                    let Some(code) = self.settle(code) else { break };
                    self.start.push(Op::Const(f64::from(saturating_index(k))));
                    append_code(&mut self.start, &code.ops);
                    self.start.push(Op::StoreElement(number));
                }
            }
            let slot = self.scope.global(&length_name(&name));
            self.start.extend([Op::Const(f64::from(saturating_index(length))), Op::StoreGlobal(slot)]);
            if let Some(number) = keys_number {
                self.scope.arrays.insert(keys_name(&name), ChangedList { number, keys: None, row: None });
            }
            self.scope.arrays.insert(name, ChangedList { number, keys: keys_number, row });
        }
    }

    /// True for the name of a dictionary that productions change.
    pub(super) fn is_changing_dictionary(&self, e: &PyExpr) -> bool {
        list_of(e, &self.scope).is_some_and(|(_, list)| list.keys.is_some())
    }

    /// The position, in the array of a list, that a store writes.
    pub(super) fn position_of(&self, store: &Store) -> Result<PyExpr, Refusal> {
        let index = resolve(&store.index, &self.scope, 0)?;
        let range = range_of(&index);
        let Some(list) = self.scope.arrays.get(&store.list) else { return Ok(index) };
        let checked = |index: &PyExpr| -> Result<PyExpr, Refusal> {
            if store.is_checked { position(&store.list, list, index, &self.scope, &range) } else { Ok(index.clone()) }
        };
        match (&index, list.row) {
            (PyExpr::List(both, _), Some(row)) => match both.as_slice() {
                [at, column] => Ok(cell(&checked(at)?, column, row, &self.scope)),
                _ => Err(nested_change(range)),
            },
            (PyExpr::List(..), None) => Err(nested_change(range)),
            (_, None) => checked(&index),
            (_, Some(_)) => {
                let why = format!("a number as an item of the list '{}', which holds lists", store.list);
                Err(Refusal::new(why, range).remedy("give all of its items one length: q.append([x])"))
            }
        }
    }

    /// The stores of the numbers of a list or vector, which is an item of a list; `None` for a store of a number.
    pub(super) fn row_stores(&self, store: &Store, value: &PyExpr) -> Result<Option<Vec<Store>>, Refusal> {
        let Some(items) = numbers_of(value) else { return Ok(None) };
        let row = self.scope.arrays.get(&store.list).and_then(|list| list.row);
        if row.is_none_or(|row| row.width != items.len()) || matches!(store.index, PyExpr::List(..)) {
            let list = &store.list;
            let why = format!("a list as an item of the list '{list}', which productions change, beside other items");
            let why = Refusal::new(why, range_of(value));
            return Err(why.remedy("give all of its items one length, and write one of them out: q.append([x, y])"));
        }
        let column = |(k, value): (usize, &PyExpr)| {
            let k = PyExpr::Number(f64::from(saturating_index(k)));
            let index = PyExpr::List(vec![store.index.clone(), k], range_of(value));
            Store { index, value: value.clone(), ..store.clone() }
        };
        Ok(Some(items.iter().enumerate().map(column).collect()))
    }

    /// Appends the code of a store that is never undone.
    pub(super) fn plain_store(&self, store: &Store, ops: &mut Vec<Op>) -> Result<(), Refusal> {
        let Some(list) = self.scope.arrays.get(&store.list) else { return Ok(()) };
        if may_be_list(&store.value, &self.scope)
            && let Ok(value) = resolve(&store.value, &self.scope, 0)
            && let Some(stores) = self.row_stores(store, &value)?
        {
            return stores.iter().try_for_each(|store| self.plain_store(store, ops));
        }
        append_code(ops, &compile(&self.position_of(store)?, &self.scope)?.ops);
        append_code(ops, &compile(&store.value, &self.scope)?.ops);
        ops.push(Op::StoreElement(list.number));
        Ok(())
    }

    /// The statements of a block, in which stores of elements replace the changes of such lists.
    pub(super) fn with_stores(&self, list: Vec<Statement>) -> Result<Vec<Statement>, Refusal> {
        if self.scope.changing.is_empty() || self.is_outside_of_blocks {
            return Ok(list);
        }
        let mut out = Vec::with_capacity(list.len());
        for s in list {
            match s {
                Statement::Assign(name, e) if self.scope.changing.contains(&name) => {
                    self.append_stores(&name, e, &mut out)?;
                }
                Statement::If(tests, other) => {
                    let tests = tests.into_iter().map(|(test, then)| Ok((test, self.with_stores(then)?)));
                    out.push(Statement::If(tests.collect::<Result<_, Refusal>>()?, self.with_stores(other)?));
                }
                Statement::For(name, items, body, place) => {
                    out.push(Statement::For(name, items, self.with_stores(body)?, place));
                }
                Statement::While(test, body, place, turn) => {
                    out.push(Statement::While(test, self.with_stores(body)?, place, turn));
                }
                other => out.push(other),
            }
        }
        Ok(out)
    }

    /// Appends the stores that replace a change of a list, or the assignment of another list to its name.
    fn append_stores(&self, name: &str, e: PyExpr, out: &mut Vec<Statement>) -> Result<(), Refusal> {
        let place = range_of(&e);
        let length = || PyExpr::Name(length_name(name), place.clone());
        let number = |n: usize| PyExpr::Number(f64::from(saturating_index(n)));
        let sum = |n: f64| PyExpr::Binary(PyOp::Add, Box::new(length()), Box::new(PyExpr::Number(n)));
        let set_length = |value: PyExpr, out: &mut Vec<Statement>| {
            out.push(Statement::Global(vec![length_name(name)]));
            out.push(Statement::Assign(length_name(name), value));
        };
        let append = |value: PyExpr, out: &mut Vec<Statement>| {
            let store = Store { list: name.to_owned(), index: length(), is_checked: false, value };
            out.push(Statement::Store(store));
            set_length(sum(1.0), out);
        };
        // A key that the dictionary lacks is appended after its last key.
        let is_dictionary = self.scope.elements.iter().any(|own| own.name == keys_name(name));
        let set_key = |key: &PyExpr, value: &PyExpr, k: usize, out: &mut Vec<Statement>| {
            let [key_name, found, at] =
                ["key", "found", "place"].map(|word| format!("({word} {k} at {})", place.start));
            let named = |name: &String| PyExpr::Name(name.clone(), place.clone());
            let position = PyExpr::Call(
                POSITION.to_owned(),
                vec![PyExpr::Name(name.to_owned(), place.clone()), named(&key_name)],
                place.clone(),
            );
            let is_new = PyExpr::Binary(PyOp::Lt, Box::new(named(&found)), Box::new(PyExpr::Number(0.0)));
            let set_at = PyExpr::Choice(Box::new(is_new), Box::new(length()), Box::new(named(&found)));
            out.push(Statement::Assign(key_name.clone(), key.clone()));
            out.push(Statement::Assign(found.clone(), position));
            out.push(Statement::Assign(at.clone(), set_at));
            for (list, value) in [(name.to_owned(), value.clone()), (keys_name(name), named(&key_name))] {
                out.push(Statement::Store(Store { list, index: named(&at), is_checked: false, value }));
            }
            let end = PyExpr::Binary(PyOp::Add, Box::new(named(&at)), Box::new(PyExpr::Number(1.0)));
            set_length(PyExpr::Call("max".to_owned(), vec![length(), end], place.clone()), out);
        };
        let extend = |more: &PyExpr, out: &mut Vec<Statement>| -> Result<(), Refusal> {
            let items = match more {
                PyExpr::List(items, _) => items.clone(),
                other => match resolve(other, &self.scope, 0) {
                    Ok(PyExpr::List(items, _)) => items,
                    _ => {
                        let why = Refusal::new(format!("items of unknown number for the list '{name}'"), place.clone());
                        return Err(why.remedy("append them in a loop: for x in q: p.append(x)"));
                    }
                },
            };
            items.into_iter().for_each(|item| append(item, out));
            Ok(())
        };
        match &e {
            PyExpr::Change(change, args, _) => match (change, args.as_slice()) {
                (ListChange::Set, [_, index, value]) if !matches!(index, PyExpr::Call(key, ..) if key.ends_with('=')) => {
                    if is_dictionary {
                        set_key(index, value, 0, out);
                    } else {
                        let (list, index, value) = (name.to_owned(), index.clone(), value.clone());
                        out.push(Statement::Store(Store { list, index, is_checked: true, value }));
                    }
                }
                _ if is_dictionary => {
                    let why = format!("'{}' of the dictionary '{name}', which productions change", change.word());
                    return Err(Refusal::new(why, place.clone()).remedy("set its values: d[key] = x"));
                }
                (ListChange::Append, [_, value]) => append(value.clone(), out),
                (ListChange::Extend, [_, more]) => extend(more, out)?,
                (ListChange::Clear, [_]) => set_length(PyExpr::Number(0.0), out),
                // `x = q.pop()` has already read the item.
                (ListChange::Pop, [_]) => {
                    let left = PyExpr::Call("max".to_owned(), vec![sum(-1.0), PyExpr::Number(0.0)], place.clone());
                    set_length(left, out);
                }
                // The items after the removed one move down by one position.
                (ListChange::Pop, [_, from @ PyExpr::Number(n)])
                    if *n >= 0.0 && !self.scope.rows.contains_key(name) =>
                {
                    let count = format!("(moved {})", place.start);
                    let at = PyExpr::Name(count.clone(), place.clone());
                    let next = PyExpr::Binary(PyOp::Add, Box::new(at.clone()), Box::new(PyExpr::Number(1.0)));
                    let list = Box::new(PyExpr::Name(name.to_owned(), place.clone()));
                    let next = PyExpr::Index(list, Box::new(next), place.clone());
                    let turns = PyExpr::Call("range".to_owned(), vec![from.clone(), sum(-1.0)], place.clone());
                    let store = Store { list: name.to_owned(), index: at, is_checked: false, value: next };
                    let body = vec![Statement::Store(store)];
                    out.push(Statement::For(count, turns, body, place.clone()));
                    let left = PyExpr::Call("max".to_owned(), vec![sum(-1.0), PyExpr::Number(0.0)], place.clone());
                    set_length(left, out);
                }
                _ => {
                    let why = format!("'{}' of the list '{name}', which productions change", change.word());
                    let why = Refusal::new(why, place.clone());
                    return Err(why.remedy("use q[i] = x, q.append(x), q.pop(), q.pop(0) or q.clear()"));
                }
            },
            PyExpr::Binary(PyOp::Add, before, more) if matches!(&**before, PyExpr::Name(own, _) if own == name) => {
                extend(more, out)?;
            }
            // Assignment of another list to this name: its items replace all present ones.
            other => {
                let items = match resolve(other, &self.scope, 0) {
                    Ok(PyExpr::List(items, _)) if !is_dictionary => items,
                    Ok(PyExpr::Call(call, pairs, _)) if call == DICTIONARY && is_dictionary => {
                        set_length(PyExpr::Number(0.0), out);
                        for (k, pair) in pairs.chunks(2).enumerate() {
                            if let [key, value] = pair {
                                set_key(key, value, k, out);
                            }
                        }
                        return Ok(());
                    }
                    Ok(_) => {
                        let why =
                            format!("another value than a list of known length as '{name}', which productions change");
                        return Err(Refusal::new(why, place.clone()).remedy("set its items: q[i] = x, or q.clear()"));
                    }
                    Err(why) => return Err(why),
                };
                set_length(number(items.len()), out);
                let store = |(k, value)| {
                    Statement::Store(Store { list: name.to_owned(), index: number(k), is_checked: false, value })
                };
                out.extend(items.into_iter().enumerate().map(store));
            }
        }
        Ok(())
    }
}

/// The name and the changed list of the model to which an expression refers; `None` for anything else.
pub(super) fn list_of<'s>(e: &PyExpr, scope: &'s Scope) -> Option<(&'s str, &'s ChangedList)> {
    let PyExpr::Name(name, _) = e else { return None };
    if scope.arrays.is_empty() || scope.locals.contains(name) {
        return None;
    }
    scope.arrays.get_key_value(plain_name(name)).map(|(name, list)| (name.as_str(), list))
}

/// The refusal of such a list as a whole where a number is expected.
pub(super) fn whole_refusal(name: &str, range: Range<usize>) -> Refusal {
    let why = Refusal::new(format!("the list '{name}', which productions change, as a whole"), range);
    why.remedy("read its items, q[i], in a loop over it, or by len, sum, min, max and 'in'")
}

/// True for an expression that reads a list which productions change.
pub(super) fn reads_changing(e: &PyExpr, scope: &Scope) -> bool {
    !scope.changing.is_empty() && scope.changing.iter().any(|name| super::expression::mentions(e, name))
}

/// The position of an element by a resolved index or key; -1 if the list lacks it, which the stack machine reports.
pub(super) fn position(
    name: &str,
    list: &ChangedList,
    index: &PyExpr,
    scope: &Scope,
    range: &Range<usize>,
) -> Result<PyExpr, Refusal> {
    if has_random(index, scope) {
        let why = Refusal::new("a random number as an index", range.clone());
        return Err(why.remedy("assign it to a variable first"));
    }
    let missing = || Box::new(PyExpr::Number(-1.0));
    if let Some(keys) = list.keys {
        return Ok(key_position(name, keys, index.clone(), scope, range));
    }
    let length = PyExpr::Name(length_name(name), range.clone());
    let two = |op, a: PyExpr, b: PyExpr| PyExpr::Binary(op, Box::new(a), Box::new(b));
    let below = two(PyOp::Lt, index.clone(), length.clone());
    let from_end = || two(PyOp::Add, length.clone(), index.clone());
    let within = |at: PyExpr, test: PyExpr| PyExpr::Choice(Box::new(test), Box::new(at), missing());
    Ok(match constant_of(index, scope) {
        Some(n) if n >= 0.0 => within(index.clone(), below),
        Some(_) => within(from_end(), two(PyOp::Ge, from_end(), PyExpr::Number(0.0))),
        None => {
            let counted = within(from_end(), two(PyOp::Ge, from_end(), PyExpr::Number(0.0)));
            let test = two(PyOp::Lt, index.clone(), PyExpr::Number(0.0));
            PyExpr::Choice(Box::new(test), Box::new(counted), Box::new(within(index.clone(), below)))
        }
    })
}

/// The position of a key among the keys of a dictionary; -1 if the dictionary lacks the key.
fn key_position(name: &str, keys: usize, key: PyExpr, scope: &Scope, range: &Range<usize>) -> PyExpr {
    let length = PyExpr::Name(length_name(name), range.clone());
    let args = vec![PyExpr::Number(0.0), PyExpr::Number(-1.0), length, key];
    run(Search::Key, keys, args, scope, range)
}

/// The item at a position of the keys, values or items of a changed dictionary, over which a loop iterates; `None` for anything
/// else.
pub(super) fn turn_item(list: &PyExpr, index: &PyExpr, scope: &Scope, range: &Range<usize>) -> Option<PyExpr> {
    let PyExpr::Call(method, args, _) = list else { return None };
    let (name, own) = list_of(args.first()?, scope)?;
    own.keys?;
    let of = |name: &str| PyExpr::Call(format!("{ELEMENT}{name}"), vec![index.clone()], range.clone());
    Some(match method.as_str() {
        ".keys" => of(&keys_name(name)),
        ".values" => of(name),
        ".items" => PyExpr::List(vec![of(&keys_name(name)), of(name)], range.clone()),
        _ => return None,
    })
}

/// The position, in the array of a list of rows, of a column of the row at `at`; -1 for a column outside of the row, which the
/// stack machine reports.
fn cell(at: &PyExpr, column: &PyExpr, row: ListRow, scope: &Scope) -> PyExpr {
    let two = |op, a: PyExpr, b: PyExpr| PyExpr::Binary(op, Box::new(a), Box::new(b));
    let width = PyExpr::Number(f64::from(saturating_index(row.width)));
    let known = constant_of(column, scope);
    let column = match known {
        Some(k) if k < 0.0 => two(PyOp::Add, width.clone(), column.clone()),
        _ => column.clone(),
    };
    let index = two(PyOp::Add, two(PyOp::Mul, at.clone(), width.clone()), column.clone());
    let has = |a: PyExpr, b: PyExpr| two(PyOp::Le, a, b);
    // A row that does not exist has the position -1, which puts its columns below 0.
    let least = has(PyExpr::Number(0.0), column.clone());
    let within = PyExpr::And(Box::new(least), Box::new(two(PyOp::Lt, column, width)));
    PyExpr::Choice(Box::new(within), Box::new(index), Box::new(PyExpr::Number(-1.0)))
}

/// The item `q[i][j]`, a column of a row of such a list, by resolved indices; `None` for any other expression.
pub(super) fn item_of_row(
    list: &PyExpr,
    column: &PyExpr,
    scope: &Scope,
    depth: usize,
) -> Option<Result<PyExpr, Refusal>> {
    let PyExpr::Index(list, index, range) = list else { return None };
    let (name, own) = list_of(list, scope)?;
    let row = own.row?;
    if has_random(column, scope) {
        return None;
    }
    Some(resolve(index, scope, depth).and_then(|index| {
        let at = position(name, own, &index, scope, range)?;
        Ok(PyExpr::Call(format!("{ELEMENT}{name}"), vec![cell(&at, column, row, scope)], range.clone()))
    }))
}

/// An element of such a list, by a resolved index.
pub(super) fn element(
    name: &str,
    list: &ChangedList,
    index: &PyExpr,
    scope: &Scope,
    range: &Range<usize>,
) -> Result<PyExpr, Refusal> {
    if matches!(index, PyExpr::Call(part, ..) if part == SLICE) || is_nothing(index) {
        let why = Refusal::new(format!("a slice of the list '{name}', which productions change"), range.clone());
        return Err(why.remedy("read its items: [q[i] for i in range(3)]"));
    }
    let at = position(name, list, index, scope, range)?;
    let of = |at: PyExpr| PyExpr::Call(format!("{ELEMENT}{name}"), vec![at], range.clone());
    let Some(row) = list.row else { return Ok(of(at)) };
    let column = |k: usize| of(cell(&at, &PyExpr::Number(f64::from(saturating_index(k))), row, scope));
    let items: Vec<PyExpr> = (0..row.width).map(column).collect();
    Ok(if row.is_vector { vector(items, range.clone()) } else { PyExpr::List(items, range.clone()) })
}

/// Result of a call on such a list, which is its first argument, or the second one of `in`; `None` for other calls.
pub(super) fn call(
    function: &str,
    args: &[PyExpr],
    scope: &Scope,
    range: &Range<usize>,
    depth: usize,
) -> Option<Result<PyExpr, Refusal>> {
    let mut first = args.get(usize::from(function == IN))?;
    // A dictionary has as many keys as values.
    if let PyExpr::Call(method, own, _) = first
        && matches!((function, method.as_str()), ("len", ".keys" | ".values" | ".items") | (IN, ".keys"))
        && list_of(own.first()?, scope)?.1.keys.is_some()
    {
        first = own.first()?;
    }
    let (name, list) = list_of(first, scope)?;
    let length = || PyExpr::Name(length_name(name), range.clone());
    let zero = || PyExpr::Number(0.0);
    let resolved = |k: usize| resolve(args.get(k).unwrap_or(&PyExpr::Number(0.0)), scope, depth);
    let at_least_zero = |at: &PyExpr| PyExpr::Binary(PyOp::Ge, Box::new(at.clone()), Box::new(zero()));
    let all = |search: Search| run(search, list.number, vec![zero(), zero(), length()], scope, range);
    if list.row.is_some() && !matches!(function, "len" | "bool") {
        return Some(Err(whole_refusal(name, range.clone())));
    }
    Some(match (function, list.keys, args.len()) {
        ("len", _, 1) => Ok(length()),
        ("bool", _, 1) => Ok(PyExpr::Binary(PyOp::Gt, Box::new(length()), Box::new(zero()))),
        ("sum", None, 1) => Ok(all(Search::Sum)),
        ("min", None, 1) => Ok(all(Search::Least)),
        ("max", None, 1) => Ok(all(Search::Greatest)),
        (IN, None, 2) => resolved(0).map(|value| {
            let args = vec![zero(), PyExpr::Number(-1.0), length(), value];
            at_least_zero(&run(Search::Key, list.number, args, scope, range))
        }),
        (IN, Some(keys), 2) => resolved(0).map(|key| at_least_zero(&key_position(name, keys, key, scope, range))),
        (POSITION, Some(keys), 2) => resolved(1).map(|key| key_position(name, keys, key, scope, range)),
        (".get", Some(_), 2 | 3) => resolved(1).and_then(|key| {
            let other = if args.len() == 3 { resolved(2)? } else { PyExpr::none(range.clone()) };
            let at = position(name, list, &key, scope, range)?;
            let read = PyExpr::Call(format!("{ELEMENT}{name}"), vec![at.clone()], range.clone());
            Ok(PyExpr::Choice(Box::new(at_least_zero(&at)), Box::new(read), Box::new(other)))
        }),
        _ => Err(whole_refusal(name, range.clone())),
    })
}

/// Result of generated code that loops over all items of a list.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Search {
    Sum,
    Least,
    Greatest,
    /// The position of an item.
    Key,
}

/// A call of generated code that loops over all items of a list. Its parameters are its variables: position, result, length,
/// value.
fn run(search: Search, array: usize, args: Vec<PyExpr>, scope: &Scope, range: &Range<usize>) -> PyExpr {
    let own = format!("{search:?} of array {array}");
    if scope.run_index(&own).is_none() {
        let binary = |op| Op::Binary(op, usize::MAX);
        let item = [Op::Local(0), Op::LoadElement(array)];
        // The loop consists of its test, the code for an item, and the step to the next position.
        let mut ops = vec![Op::Count(0), Op::Local(0), Op::Local(2), binary(BinaryOp::Lt), Op::Pop];
        let skip = ops.len() - 1;
        let first = ops.len();
        match search {
            Search::Sum => ops.extend([Op::Local(1), item[0], item[1], binary(BinaryOp::Add), Op::StoreLocal(1)]),
            // At a match, store the position as the result and set the position to the length, which ends the loop.
            Search::Key => {
                ops.extend([item[0], item[1], Op::Local(3), binary(BinaryOp::Eq), Op::JumpIfZero(first + 9)]);
                ops.extend([Op::Local(0), Op::StoreLocal(1), Op::Local(2), Op::StoreLocal(0)]);
            }
            // Take the first item, and every later one that is less (or greater) than the result so far.
            Search::Least | Search::Greatest => {
                let compares = if search == Search::Least { BinaryOp::Lt } else { BinaryOp::Gt };
                ops.extend([Op::Local(0), Op::Const(0.0), binary(BinaryOp::Eq), Op::Or(first + 8)]);
                ops.extend([item[0], item[1], Op::Local(1), binary(compares)]);
                ops.extend([Op::JumpIfZero(first + 12), item[0], item[1], Op::StoreLocal(1)]);
            }
        }
        ops.extend([Op::Local(0), Op::Const(1.0), binary(BinaryOp::Add), Op::StoreLocal(0), Op::Jump(0)]);
        ops[skip] = Op::JumpIfZero(ops.len());
        ops.push(Op::Local(1));
        scope.run.borrow_mut().push(RunFunction {
            name: own.clone(),
            is_before_step: scope.is_before_step,
            parameters: args.len(),
            place: range.clone(),
            code: Ok(ops),
        });
    }
    PyExpr::Call(format!("{RUN}{own}"), args, range.clone())
}

/// True for such a list, or for the keys, values or items of such a dictionary, over which a loop counts positions.
pub(super) fn is_changing_name(e: &PyExpr, scope: &Scope) -> bool {
    match e {
        PyExpr::Name(name, _) => scope.changing.contains(plain_name(name)) && !scope.locals.contains(name),
        PyExpr::Call(method, args, _) if matches!(method.as_str(), ".keys" | ".values" | ".items") => {
            args.first().is_some_and(|own| is_changing_name(own, scope))
        }
        _ => false,
    }
}
