//! Names that expressions may use, and functions of the model.

use std::cell::{Cell, RefCell};
use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;
use std::rc::Rc;
use std::sync::{Arc, OnceLock};

use osier_base::diagnostic::{SourceId, Span};

use super::arrays::{ChangedList, ListRow};
use super::curve_table::Curves;
use super::expression::{MAX_OPS, METHOD, PyExpr, size_with, substitute, times_read, with_parts};
use super::param_shape::{Class, ParamShape};
use super::refusal::Refusal;
use crate::code::{Bytecode, CalledFunction, ElementAccess, Op};
use crate::token::SourcePlace;

/// Prefix in the name of a call of a function's code. It contains a blank, so that no function of a model can have such a name.
pub(super) const RUN: &str = "run ";

/// A function that is compiled to code.
#[derive(Debug)]
pub(super) struct RunFunction {
    pub name: String,
    /// Value of [`Scope::is_before_step`] where it is called.
    pub is_before_step: bool,
    pub parameters: usize,
    /// Place of its first call.
    pub place: Range<usize>,
    pub code: Result<Vec<Op>, Refusal>,
}

/// The names that expressions may use.
#[derive(Debug, Clone, Default)]
pub(super) struct Scope {
    /// Variables and parameters of a rule; the position is the slot.
    pub locals: Vec<String>,
    /// Values of the model that are computed once, before the first step; the position is the slot.
    pub globals: Vec<String>,
    pub constants: BTreeMap<String, f64>,
    /// Names of constants whose values are strings.
    pub texts: BTreeSet<String>,
    /// Lists by name that no statement changes; expressions may index them or loop over them.
    pub lists: BTreeMap<String, PyExpr>,
    /// Names with unsupported values, each with the reason.
    pub unreadable: BTreeMap<String, Refusal>,
    /// Functions whose body is one expression, by name: parameters and expression.
    pub functions: BTreeMap<String, (Vec<String>, PyExpr)>,
    /// Functions that cannot be read, each with the reason.
    pub refused_functions: BTreeMap<String, String>,
    /// Default values of parameters, by the name of the function.
    pub defaults: BTreeMap<String, Vec<Option<PyExpr>>>,
    /// True if the model contains `None` or an empty string, which count as false.
    pub has_none: bool,
    /// True if the model calls `backward()`.
    pub is_backward: bool,
    /// Lists and dictionaries of the model that productions and functions change, by name.
    pub changing: Rc<BTreeSet<String>>,
    /// Those of the lists in `changing` that are arrays of the stack machine, as blocks access them; empty until the values of
    /// the model are known.
    pub arrays: BTreeMap<String, ChangedList>,
    /// Kind of the items of those changed lists that hold lists or vectors, derived from the text.
    pub rows: BTreeMap<String, ListRow>,
    /// The arrays, in the order of their numbers. Their elements are the first global variables.
    pub elements: Rc<Vec<ElementAccess>>,
    pub array_slots: usize,
    /// True if the steps of the model have different rewriting directions.
    pub direction_changes: bool,
    /// Calls of functions in the expression that is resolved.
    pub calls: Cell<usize>,
    /// True after the limit on the nesting or the number of calls was exceeded.
    pub has_too_many_calls: Cell<bool>,
    /// Functions compiled to code because they are recursive.
    pub run: Rc<RefCell<Vec<RunFunction>>>,
    /// The code of these functions; set once the model is read.
    pub run_code: Arc<OnceLock<Vec<CalledFunction>>>,
    /// Curves of the model, including those saved after it.
    pub curves: Rc<RefCell<Curves>>,
    /// Classes whose objects hold values.
    pub classes: BTreeMap<String, Class>,
    /// Attribute names of each kind of objects that modules have as parameters.
    pub kinds: Rc<RefCell<Vec<Vec<String>>>>,
    /// The text of the model, for places; `None` in a scope without a model.
    pub source: Option<SourceId>,
    /// True for the code of `StartEach`, which runs before the step: `Q` then counts completed steps.
    pub is_before_step: bool,
}

impl Scope {
    /// Slot of a local variable, which is added if it is new.
    pub fn local(&mut self, name: &str) -> u16 {
        let found = self.locals.iter().position(|l| l == name);
        let i = found.unwrap_or_else(|| {
            self.locals.push(name.to_owned());
            self.locals.len() - 1
        });
        // An execution path has at most MAX_STEPS (20,000) steps, each of which adds at most one variable to the parameters.
        slot_number(i)
    }

    /// Slot of a variable of the model, which is added if it is new.
    pub fn global(&mut self, name: &str) -> u16 {
        let found = self.globals.iter().position(|g| g == name);
        let i = found.unwrap_or_else(|| {
            self.globals.push(name.to_owned());
            self.globals.len() - 1
        });
        slot_number(self.array_slots + i)
    }

    /// Slot of a variable of the model; `None` if there is no such variable, or its slot lies beyond 65,535.
    pub fn global_slot(&self, name: &str) -> Option<u16> {
        let i = self.globals.iter().position(|g| g == name)?;
        u16::try_from(self.array_slots + i).ok()
    }

    /// Index of a function among those compiled to code.
    pub fn run_index(&self, name: &str) -> Option<usize> {
        let is_it = |f: &RunFunction| f.name == name && f.is_before_step == self.is_before_step;
        self.run.borrow().iter().position(is_it)
    }

    /// The refusal of a call of an unknown function, with the reason if the model defines it.
    pub fn refused_call(&self, name: &str, range: Range<usize>) -> Refusal {
        let why = self.refused_functions.get(name).map(String::as_str);
        if let Some(method) = name.strip_prefix(METHOD) {
            let why = why.map_or_else(String::new, |why| format!(" ({why})"));
            let refusal = Refusal::new(format!("the method '{method}'{why}"), range);
            return refusal.remedy(
                "of methods those of classes of the model are read: write it as a function f(p), or into the class",
            );
        }
        let remedy = match (name, why) {
            ("makestring", None) => Some("write the modules themselves, behind 'produce' or 'nproduce'"),
            _ => None,
        };
        let why = why.map_or_else(String::new, |why| format!(" ({why})"));
        Refusal { remedy, ..Refusal::new(format!("the function '{name}'{why}"), range) }
    }

    /// The shape of a parameter that is an object with these attributes.
    pub fn object_shape(&self, fields: &[String]) -> ParamShape {
        let kinds = &mut self.kinds.borrow_mut();
        let kind = kinds.iter().position(|own| own == fields).unwrap_or_else(|| {
            kinds.push(fields.to_vec());
            kinds.len() - 1
        });
        ParamShape::Object { kind, count: fields.len() }
    }

    /// The attribute names of a kind of objects.
    pub fn fields(&self, kind: usize) -> Vec<String> {
        self.kinds.borrow().get(kind).cloned().unwrap_or_default()
    }

    /// Adds to code the tables of the curves that it reads, and the places of its calls after its own places.
    pub fn with_tables(&self, mut code: Bytecode) -> Bytecode {
        if code.tables.is_none() && code.ops.iter().any(|op| matches!(op, Op::Table(..))) {
            let curves = self.curves.borrow();
            code.tables = Some(curves.tables());
            code.places.extend(curves.call_places.iter().copied());
        }
        if code.elements.is_empty() && code.ops.iter().any(|op| matches!(op, Op::LoadElement(_) | Op::StoreElement(_)))
        {
            code.elements.clone_from(&self.elements);
        }
        code
    }

    /// Index into [`Curves::call_places`] of a place in the text, for a call of a function that a variable holds.
    pub fn call_place(&self, range: &Range<usize>) -> usize {
        let Some(source) = self.source else { return usize::MAX };
        let place = SourcePlace::bare(Span::new(source, range.start, range.end));
        let places = &mut self.curves.borrow_mut().call_places;
        let known = places.iter().position(|own| *own == place);
        known.unwrap_or_else(|| {
            places.push(place);
            places.len() - 1
        })
    }

    /// Slot of a variable; `None` if there is no such variable, or if its slot would exceed 65,535.
    pub fn slot(list: &[String], name: &str) -> Option<u16> {
        list.iter().position(|l| l == name).and_then(|i| u16::try_from(i).ok())
    }
}

/// The slot for an index. Indices above 65,535 get the last slot, in which `Scope::slot` finds no variable, so that each use
/// is refused.
pub(super) fn slot_number(i: usize) -> u16 {
    u16::try_from(i).unwrap_or(u16::MAX)
}

/// True if the expression draws a random number, itself or in a called function of the model.
pub(super) fn has_random(e: &PyExpr, scope: &Scope) -> bool {
    draws(e, scope, &mut Vec::new())
}

/// Like [`has_random`], but skips the functions in `seen`, because functions may be recursive.
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
        PyExpr::Change(_, items, _) | PyExpr::List(items, _) => items.iter().any(|e| draws(e, scope, seen)),
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
            match scope.functions.get_key_value(name.strip_prefix(RUN).unwrap_or(name)) {
                Some((name, (_, body))) if !seen.contains(&name.as_str()) => {
                    seen.push(name);
                    draws(body, scope, seen)
                }
                _ => false,
            }
        }
    }
}

/// A function defined in a production. Its value may read variables of the production.
#[derive(Debug)]
pub(super) struct OwnFunction {
    pub params: Vec<String>,
    /// Default values of the parameters.
    pub defaults: Vec<Option<PyExpr>>,
    pub value: PyExpr,
}

/// The arguments of a call in the order of the parameters; `None` if one is missing or unknown.
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

/// An expression with calls of functions replaced by their values. A call that does not match its function remains, and is
/// refused like one of an unknown function.
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
