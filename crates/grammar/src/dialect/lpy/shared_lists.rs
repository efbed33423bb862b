//! Lists with two names (aliases). In Python a change of a list under one name is also visible under the other: changes of such
//! lists, and of lists that another block has made, are refused.

use std::collections::BTreeSet;
use std::ops::Range;

use super::Model;
use super::execution_path::ExecutionPath;
use super::expression::{PyExpr, PyOp, SLICE, is_change, is_object, range_of};
use super::objects::COPY_OBJECT;
use super::refusal::Refusal;
use super::statement::Statement;

/// Functions that read lists, but do not store any of them in their result.
const READERS: [&str; 23] = [
    "copy",
    "deepcopy",
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

/// True for `q + [..]` assigned to q. It also represents `q += [..]`, which changes the list.
fn extends(name: &str, e: &PyExpr) -> bool {
    let PyExpr::Binary(PyOp::Add, before, more) = e else { return false };
    let is_own = matches!(&**before, PyExpr::Name(own, _) if own == name);
    is_own && matches!(&**more, PyExpr::List(..) | PyExpr::Each(..))
}

/// Named lists that the value of an assignment may share.
#[derive(Debug, Default)]
pub(super) struct HandedOn {
    /// Names of lists that the value may be or contain.
    names: BTreeSet<String>,
    /// True if the value may be one of these lists itself.
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
        // The list before a change is not counted, because the change does not make another list.
        PyExpr::Change(_, args, _) => args.iter().skip(1).for_each(|arg| append_held(arg, out)),
        PyExpr::Call(name, args, _) if !READERS.contains(&name.as_str()) => {
            args.iter().for_each(|arg| append_held(arg, out));
        }
        _ => {}
    }
}

/// The refusal of a change of a list. `why`: the reason.
fn change_refusal(name: &str, why: &str, place: Range<usize>, remedy: &'static str) -> Refusal {
    // Remove the number in which the names of variables in axioms and functions end.
    let name = name.split(" (").next().unwrap_or(name);
    Refusal::new(format!("a change of the list '{name}', which {why}"), place).remedy(remedy)
}

/// Help for a refused change.
const COPY: &str = "make a copy under another name and change that one: p = list(q)";

impl Model<'_, '_> {
    /// The lists that an assignment shares. Refuses a change of a list that was not made on this execution path, or that has two names.
    pub(super) fn handed_on(&self, statement: &Statement, path: &ExecutionPath) -> Result<HandedOn, Refusal> {
        self.check_objects(statement, path)?;
        let Statement::Assign(name, e) = statement else { return Ok(HandedOn::default()) };
        self.check_change(name, e, path)?;
        Ok(HandedOn::new(e))
    }

    /// Refuses an object that two names or modules hold if some line of the model changes such objects: in Python the change
    /// would be visible to both.
    fn check_objects(&self, statement: &Statement, path: &ExecutionPath) -> Result<(), Refusal> {
        let object = |e: &PyExpr| match e {
            PyExpr::Name(name, place) => {
                let value = path.lists.get(name).or_else(|| self.scope.lists.get(name))?;
                (is_object(value) && self.is_changing(value)).then(|| (name.clone(), place.clone()))
            }
            _ => None,
        };
        let shared = |name: &str, place: Range<usize>| {
            let name = name.split(" (").next().unwrap_or(name);
            let why = Refusal::new(format!("the object '{name}' in two places, of which one may change it"), place);
            Err(why.remedy(COPY_OBJECT))
        };
        match statement {
            Statement::Assign(name, e) if !is_change(e) => match object(e) {
                Some((other, place)) if !name.starts_with('(') && other != *name => shared(&other, place),
                _ => Ok(()),
            },
            Statement::Assign(name, e) if path.handed_objects.contains(name) => shared(name, range_of(e)),
            Statement::Produce(modules, _) => {
                let mut handed = path.handed_objects.clone();
                for (name, place) in modules.iter().flat_map(|m| &m.args).filter_map(object) {
                    if !handed.insert(name.clone()) {
                        return shared(&name, place);
                    }
                }
                Ok(())
            }
            _ => Ok(()),
        }
    }

    /// Records the objects that a statement changes or passes on.
    pub(super) fn note_objects_of(&self, statement: &Statement, path: &mut ExecutionPath) {
        let is_held = |name: &String, path: &ExecutionPath| {
            path.lists.get(name).or_else(|| self.scope.lists.get(name)).is_some_and(is_object)
        };
        match statement {
            Statement::Assign(name, e) if is_change(e) && is_held(name, path) => {
                path.changed_objects.insert(name.clone());
            }
            Statement::Assign(name, _) => {
                path.handed_objects.remove(name);
            }
            Statement::Produce(modules, _) => {
                for arg in modules.iter().flat_map(|m| &m.args) {
                    if let PyExpr::Name(name, _) = arg
                        && is_held(name, path)
                    {
                        path.handed_objects.insert(name.clone());
                    }
                }
            }
            _ => {}
        }
    }

    fn check_change(&self, name: &str, e: &PyExpr, path: &ExecutionPath) -> Result<(), Refusal> {
        let is_change = is_change(e);
        if !is_change && !extends(name, e) {
            return Ok(());
        }
        let is_of_model = self.is_in_axiom && self.scope.lists.contains_key(name);
        // An object of the head may be changed, because the production makes the module again.
        let is_of_head =
            self.rule_lists.iter().any(|(own, _)| own == name) && self.scope.lists.get(name).is_some_and(is_object);
        if is_change && !path.lists.contains_key(name) && !is_of_model && !is_of_head {
            return Err(change_refusal(name, "this block has not made", range_of(e), COPY));
        }
        if path.shared_lists.contains(name) || (is_of_model && self.shared_lists.contains(name)) {
            return Err(change_refusal(name, "has two names", range_of(e), COPY));
        }
        Ok(())
    }

    /// Records the lists that have two names after a list is assigned to a name.
    pub(super) fn share_lists(&self, name: &str, handed_on: &HandedOn, path: &mut ExecutionPath) {
        let is_temporary = |name: &str| name.starts_with('(');
        for other in handed_on.names.iter().filter(|other| *other != name) {
            let is_list = path.lists.contains_key(other) || self.scope.lists.contains_key(other);
            // Temporary variables of this reader are read only once, so that a list in one of them has no second name.
            let is_read_again = !is_temporary(name) && !is_temporary(other);
            if is_list && (is_read_again || path.shared_lists.contains(other)) {
                path.shared_lists.insert(other.clone());
                if handed_on.is_same {
                    path.shared_lists.insert(name.to_owned());
                }
            }
        }
    }

    /// Like [`Self::check_change`], for a line of the model outside of blocks. True for a change of an unreadable value,
    /// which is refused where it is used.
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

    /// Like [`Self::share_lists`], for a value of the model.
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
