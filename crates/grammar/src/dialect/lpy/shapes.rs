//! Lists and vectors as parameters of modules. Modules hold only numbers: a list becomes its items, so that it must have the
//! same length wherever the model makes the module.

use std::collections::BTreeSet;
use std::ops::Range;

use super::Model;
use super::expression::{PyExpr, is_object, range_of};
use super::lines::Line;
use super::objects::{fields_of, values_of};
use super::param_shape::ParamShape;
use super::pieces::{closing, parameters_of_modules, split};
use super::refusal::Refusal;
use super::resolve::{may_be_list, resolve};
use super::scope::Scope;
use super::strings::{PyModule, is_command};
use super::vectors::{coordinates_of, dimension};
use crate::dialect::text::Piece;

/// Every line with a list or vector as a parameter contains one of these texts.
const LIST_BEGINNINGS: [&str; 7] = ["Vector", "([", ",[", ", [", "((", ",(", ", ("];

/// The arguments of a module as numbers, and their shapes.
pub(super) struct SpreadModule {
    pub args: Vec<PyExpr>,
    pub shape: Vec<ParamShape>,
}

/// Replaces vectors and `*list` in the arguments of a module by their items, and also lists, except in turtle commands.
pub(super) fn spread(module: &PyModule, scope: &Scope) -> Result<SpreadModule, Refusal> {
    let mut out = SpreadModule { args: Vec::with_capacity(module.args.len()), shape: Vec::new() };
    for arg in &module.args {
        // Each item of `*list` is a parameter of its own.
        if let PyExpr::Call(star, list, range) = arg
            && star == "*"
        {
            let list = list.first().map(|l| resolve(l, scope, 0)).transpose()?;
            let items = match &list {
                Some(PyExpr::List(items, _)) => Some(items.as_slice()),
                other => other.as_ref().and_then(coordinates_of),
            };
            let items = items.ok_or_else(|| Refusal::new("'*' before something other than a list", range.clone()))?;
            out.shape.extend(items.iter().map(|_| ParamShape::Number));
            out.args.extend_from_slice(items);
            continue;
        }
        // An unreadable value is refused where its code is made.
        let value = may_be_list(arg, scope).then(|| resolve(arg, scope, 0).ok()).flatten();
        match value {
            Some(PyExpr::List(items, _)) if !is_command(&module.name) => {
                if let Some(PyExpr::List(_, range)) = items.iter().find(|e| matches!(e, PyExpr::List(..))) {
                    let why = Refusal::new("a list of lists as a parameter of a module", range.clone());
                    return Err(why.remedy("hand its lists on as parameters of their own"));
                }
                out.shape.push(ParamShape::List(items.len()));
                out.args.extend(items);
            }
            Some(object) if is_object(&object) && is_command(&module.name) => {
                let why =
                    Refusal::new(format!("an object as a parameter of the command '{}'", module.name), range_of(arg));
                return Err(why.remedy("hand on one of its attributes: F(p.length)"));
            }
            Some(object) if is_object(&object) => {
                let values = values_of(&object).unwrap_or_default();
                let is_number =
                    |e: &&PyExpr| !matches!(e, PyExpr::List(..)) && coordinates_of(e).is_none() && !is_object(e);
                if !values.iter().all(is_number) {
                    let why = Refusal::new("an object that holds a list, a vector or an object", range_of(arg));
                    return Err(why.remedy("give each of its items an attribute, or a parameter of the module"));
                }
                out.shape.push(scope.object_shape(&fields_of(&object).unwrap_or_default()));
                out.args.extend(values.into_iter().cloned());
            }
            other => match other.as_ref().and_then(coordinates_of) {
                Some(items) => {
                    out.shape.push(ParamShape::Vector(items.len()));
                    out.args.extend_from_slice(items);
                }
                None => {
                    out.shape.push(ParamShape::Number);
                    out.args.push(arg.clone());
                }
            },
        }
    }
    Ok(out)
}

/// Total number of numeric parameters.
fn count(shape: &[ParamShape]) -> usize {
    shape.iter().map(|p| p.count()).sum()
}

/// Describes parameters in words.
fn described(shape: &[ParamShape]) -> String {
    let words = shape.iter().map(|p| match p {
        ParamShape::Number => "a number".to_owned(),
        ParamShape::List(n) => format!("a list of {n}"),
        ParamShape::Vector(n) => format!("a vector of {n}"),
        ParamShape::Object { count, .. } => format!("an object of {count} attributes"),
    });
    words.collect::<Vec<_>>().join(", ")
}

/// Shape of a parameter derived only from its text: a list or vector constant. A name counts as a number, since it may be a
/// variable of a production.
fn written_shape(piece: Piece<'_>) -> ParamShape {
    let text = piece.text;
    let is_whole = |open: usize| {
        let inner = text.get(open + 1..).unwrap_or("");
        closing(inner).is_some_and(|end| open + end + 2 == text.len())
    };
    if let Some(open) = text.find('(')
        && let Some(n) = dimension(text.get(..open).unwrap_or(""))
        && is_whole(open)
    {
        return ParamShape::Vector(n);
    }
    let items = match text.strip_prefix('[').and_then(|t| t.strip_suffix(']')) {
        Some(inner) if !inner.contains([']', '[']) && !inner.contains(" for ") => {
            split(Piece::new(piece.at + 1, inner)).len()
        }
        _ if text.starts_with('(') && is_whole(0) => {
            // A single value in parentheses is that value.
            let n = split(piece.up_to(text.len() - 1).from(1)).len();
            if n > 1 { n } else { 0 }
        }
        _ => 0,
    };
    if items > 0 { ParamShape::List(items) } else { ParamShape::Number }
}

impl Model<'_, '_> {
    /// Records the modules to which the text passes lists or vectors, for the heads of productions; except undeclared names
    /// in lower case, which look like functions.
    pub(super) fn find_shapes(&mut self, list: &[Line<'_>]) {
        let capitals = ('A'..='Z').map(String::from);
        let mut names: BTreeSet<String> = self.declared.iter().cloned().chain(capitals).collect();
        names.retain(|name| !is_command(name) && !self.defined.contains(name));
        if !self.scope.classes.is_empty() || list.iter().any(|line| line.piece.text.contains("ParameterSet(")) {
            self.find_object_shapes(list, &names);
        }
        for line in list {
            let text = line.piece.text;
            if !LIST_BEGINNINGS.iter().any(|begin| text.contains(begin)) {
                continue;
            }
            for name in &names {
                for params in parameters_of_modules(line.piece, name) {
                    let shape: Vec<ParamShape> = params.iter().map(|p| written_shape(*p)).collect();
                    if shape.iter().any(|p| *p != ParamShape::Number) {
                        self.note_shape(name, shape);
                    }
                }
            }
        }
    }

    /// Merges the shape of parameters in the text with that of earlier modules of the same name and number of parameters.
    pub(super) fn note_shape(&mut self, name: &str, shape: Vec<ParamShape>) {
        let known = self.written_shapes.entry(name.to_owned()).or_default();
        match known.iter_mut().find(|own| own.len() == shape.len()) {
            Some(own) => {
                for (own, new) in own.iter_mut().zip(shape).filter(|(own, _)| **own == ParamShape::Number) {
                    *own = new;
                }
            }
            None => known.push(shape),
        }
    }

    /// Shapes of the parameters of a module that has this many of them.
    pub(super) fn shape_of(&self, name: &str, parameters: usize) -> Vec<ParamShape> {
        let mut known = self.shapes.get(name).into_iter().chain(self.written_shapes.get(name)).flatten();
        let shape = known.find(|shape| shape.len() == parameters);
        shape.cloned().unwrap_or_else(|| vec![ParamShape::Number; parameters])
    }

    /// Refuses parameters whose lists have another length than in an earlier use of the module, and those that would be
    /// confused with others, such as a vector and a number with four numbers.
    pub(super) fn check_shape(
        &mut self,
        name: &str,
        shape: &[ParamShape],
        range: &Range<usize>,
    ) -> Result<(), Refusal> {
        // Commands of the turtle accept a vector in place of its coordinates, so that any shape is allowed.
        if is_command(name) {
            return Ok(());
        }
        let is_plain = shape.iter().all(|p| *p == ParamShape::Number);
        if is_plain && self.shapes.is_empty() && self.written_shapes.is_empty() {
            return Ok(());
        }
        let known = self.shapes.entry(name.to_owned()).or_default();
        let is_same = |own: &[ParamShape]| {
            let is_list = |p: &ParamShape| *p != ParamShape::Number;
            let is_object = |p: &ParamShape| matches!(p, ParamShape::Object { .. });
            own.iter().zip(shape).all(|(a, b)| {
                let is_kind = a == b || !(is_object(a) || is_object(b));
                a.count() == b.count() && is_list(a) == is_list(b) && is_kind
            })
        };
        for own in known.iter() {
            if own.len() == shape.len() && is_same(own) {
                return Ok(());
            }
            if own.len() == shape.len() || count(own) == count(shape) {
                let construct = format!(
                    "the module '{name}' with {} as its parameters, and with {} elsewhere",
                    described(shape),
                    described(own)
                );
                let why = Refusal::new(construct, range.clone());
                return Err(why.remedy(
                    "give a list of a module one length, and write it out where the module is made first; other parameters need \
                     another module",
                ));
            }
        }
        known.push(shape.to_vec());
        Ok(())
    }
}
