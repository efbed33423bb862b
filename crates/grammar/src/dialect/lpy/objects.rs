//! Objects of classes that hold values, such as `ParameterSet(age=0)`: their attributes, and how to read and set these. As a
//! parameter of a module, an object becomes one number for each attribute.

use std::collections::BTreeMap;
use std::ops::Range;

use super::Model;
use super::expression::{ATTRIBUTE, METHOD, OBJECT, PyExpr, is_object, substitute, times_read, with_parts};
use super::lines::{Line, block_after};
use super::param_shape::{Class, ParamShape};
use super::parser::parse;
use super::pieces::{
    FunctionHead, assignment, attribute_target, closing, function_head, is_name, is_rule, parameters_of_modules, split,
};
use super::refusal::Refusal;
use super::scope::{Scope, arguments, has_random};
use super::strings::spell;
use super::vectors::AXES;
use crate::dialect::text::Piece;

/// The class of L-Py whose objects have the attributes given at construction.
const PARAMETER_SET: &str = "ParameterSet";
/// Limit on the rounds that search for modules to which another module passes an object. Own: longer chains of modules are not
/// found.
const MAX_ROUNDS: usize = 16;

/// Help for objects that two modules would share.
pub(super) const COPY_OBJECT: &str = "hand a copy on: from copy import deepcopy, then deepcopy(p)";

/// Makes the call that represents an attribute with its value in an object.
fn pair(field: &str, value: PyExpr, range: &Range<usize>) -> PyExpr {
    PyExpr::Call(format!("{field}="), vec![value], range.clone())
}

/// Attribute and value in such a call.
fn parts(pair: &PyExpr) -> Option<(&str, &PyExpr)> {
    let PyExpr::Call(name, value, _) = pair else { return None };
    Some((name.strip_suffix('=')?, value.first()?))
}

/// The attribute values of an object; `None` for other expressions.
pub(super) fn values_of(e: &PyExpr) -> Option<Vec<&PyExpr>> {
    let PyExpr::Call(name, pairs, _) = e else { return None };
    (name == OBJECT).then(|| pairs.iter().filter_map(|p| parts(p).map(|(_, value)| value)).collect())
}

/// The attribute names of an object; `None` for other expressions.
pub(super) fn fields_of(e: &PyExpr) -> Option<Vec<String>> {
    let PyExpr::Call(name, pairs, _) = e else { return None };
    (name == OBJECT).then(|| pairs.iter().filter_map(|p| parts(p).map(|(field, _)| field.to_owned())).collect())
}

/// Makes the object with these attributes and values.
pub(super) fn object_of(fields: &[String], values: Vec<PyExpr>, range: &Range<usize>) -> PyExpr {
    let pairs = fields.iter().zip(values).map(|(field, value)| pair(field, value, range)).collect();
    PyExpr::Call(OBJECT.to_owned(), pairs, range.clone())
}

/// The refusal of an attribute that the object does not have.
fn attribute_refusal(field: &str, range: &Range<usize>) -> Refusal {
    let why = Refusal::new(format!("an attribute '{field}' that this value does not have"), range.clone());
    why.remedy("set the attribute where the object is made: in __init__, or ParameterSet(age=0)")
}

/// The value of an attribute of a resolved object.
pub(super) fn attribute(object: &PyExpr, field: &str, range: &Range<usize>) -> Result<PyExpr, Refusal> {
    match object {
        PyExpr::Call(name, pairs, _) if name == OBJECT => {
            let found = pairs.iter().filter_map(parts).find(|(own, _)| *own == field);
            found.map(|(_, value)| value.clone()).ok_or_else(|| attribute_refusal(field, range))
        }
        PyExpr::Choice(test, a, b) if is_object(a) && is_object(b) => {
            let (a, b) = (attribute(a, field, range)?, attribute(b, field, range)?);
            Ok(PyExpr::Choice(test.clone(), Box::new(a), Box::new(b)))
        }
        _ => Err(attribute_refusal(field, range)),
    }
}

/// The attribute for the index that an axis name was read as: `p.x` is read as `p[0]`.
pub(super) fn axis_name(index: &PyExpr) -> Option<&'static str> {
    let PyExpr::Number(k) = index else { return None };
    AXES.iter().enumerate().find(|(axis, _)| (*axis as f64 - k).abs() <= 0.0).map(|(_, name)| *name)
}

/// The object after `p.field = value`.
pub(super) fn with_attribute(object: &PyExpr, args: &[PyExpr], range: &Range<usize>) -> Result<PyExpr, Refusal> {
    let (PyExpr::Call(name, pairs, place), [PyExpr::Call(field, ..), value]) = (object, args) else {
        return Err(Refusal::new("this change of an object", range.clone()));
    };
    let field = field.strip_suffix('=').unwrap_or(field);
    let mut pairs = pairs.clone();
    let old = pairs.iter_mut().find(|p| parts(p).is_some_and(|(own, _)| own == field));
    *old.ok_or_else(|| attribute_refusal(field, range))? = pair(field, value.clone(), range);
    Ok(PyExpr::Call(name.clone(), pairs, place.clone()))
}

/// The object that a call with resolved arguments makes; `None` for other calls.
pub(super) fn made(
    name: &str,
    args: &[PyExpr],
    range: &Range<usize>,
    scope: &Scope,
) -> Option<Result<PyExpr, Refusal>> {
    let any = Class { takes_any: true, ..Class::default() };
    let class = match scope.classes.get(name) {
        Some(class) => class.clone(),
        None if name == PARAMETER_SET => any,
        None => return None,
    };
    Some(class.object(name, args, range, scope))
}

impl Class {
    fn object(&self, name: &str, args: &[PyExpr], range: &Range<usize>, scope: &Scope) -> Result<PyExpr, Refusal> {
        let refused = || Refusal::new(format!("this call of the class '{name}'"), range.clone());
        let is_known = |arg: &&PyExpr| parts(arg).is_none_or(|(own, _)| self.params.iter().any(|p| p == own));
        let (known, other): (Vec<&PyExpr>, Vec<&PyExpr>) = args.iter().partition(is_known);
        if !other.is_empty() && !self.takes_any {
            return Err(refused().remedy("give it the parameters of its __init__"));
        }
        let given = arguments(&self.params, Some(&self.defaults), known.into_iter().cloned().collect());
        let given = given.ok_or_else(|| refused().remedy("give it the parameters of its __init__"))?;
        // Each value may read the parameters and earlier attributes.
        let mut fields: Vec<(String, PyExpr)> = Vec::new();
        for (field, value) in &self.fields {
            let value = with_own(value, &self.own, &fields);
            let drawn = |(p, a): (&String, &PyExpr)| has_random(a, scope) && times_read(&value, p) > 1;
            if self.params.iter().zip(&given).any(drawn) {
                let why = Refusal::new(format!("a random number as an argument of the class '{name}'"), range.clone());
                return Err(why.remedy("assign it to a variable first"));
            }
            let value = super::resolve::resolve(&substitute(&value, &self.params, &given), scope, 0)?;
            fields.retain(|(own, _)| own != field);
            fields.push((field.clone(), value));
        }
        for (field, value) in other.into_iter().filter_map(parts) {
            match fields.iter_mut().find(|(own, _)| own == field) {
                Some((_, own)) => *own = value.clone(),
                None => fields.push((field.to_owned(), value.clone())),
            }
        }
        let (names, values): (Vec<String>, Vec<PyExpr>) = fields.into_iter().unzip();
        Ok(object_of(&names, values, range))
    }
}

/// An expression in `__init__` with the values of attributes set before it.
fn with_own(e: &PyExpr, own: &str, fields: &[(String, PyExpr)]) -> PyExpr {
    if let PyExpr::Call(name, args, _) = e
        && let (Some(field), [PyExpr::Name(object, _)]) = (name.strip_prefix(ATTRIBUTE), args.as_slice())
        && object == own
        && let Some((_, value)) = fields.iter().find(|(known, _)| known == field)
    {
        return value.clone();
    }
    with_parts(e, &|a| with_own(a, own, fields))
}

impl Model<'_, '_> {
    /// Reads the classes whose objects hold values. Other classes are refused where an object is made.
    pub(super) fn classes(&mut self, list: &[Line<'_>]) {
        for (i, line) in
            list.iter().enumerate().filter(|(_, line)| line.indent == 0 || line.piece.text.starts_with("class "))
        {
            let (word, rest) = line.piece.first_word(&[]);
            if word.text != "class" {
                continue;
            }
            let name = rest.text.split(['(', ':']).next().unwrap_or("").trim().to_owned();
            match class_of(block_after(list, i, line.indent).0) {
                Ok(class) => {
                    self.scope.classes.insert(name, class);
                }
                Err(why) => {
                    let why = format!("line {}: {}", self.reader.line_number(why.range.start), why.construct);
                    self.scope.refused_functions.insert(name, why);
                }
            }
        }
        self.find_methods(list);
        // Collect the attributes that lines outside of `__init__` set. Objects with such an attribute can change, so all holders
        // would see the change.
        let targets = list.iter().filter_map(|line| attribute_target(line.piece));
        self.changed_attributes.extend(targets.filter(|t| t.object.text != "self").map(|t| t.field.to_owned()));
    }

    /// Records the methods of classes, and the attributes that they change.
    fn find_methods(&mut self, list: &[Line<'_>]) {
        for (i, line) in list.iter().enumerate().filter(|(_, line)| line.piece.text.starts_with("class ")) {
            for method in methods_of(list, i, line.indent) {
                let Some(line) = list.get(method.index) else { continue };
                let lines = block_after(list, method.index, line.indent).0;
                let targets = lines.iter().filter_map(|line| attribute_target(line.piece));
                self.changed_attributes.extend(targets.map(|t| t.field.to_owned()));
                let name = format!("{METHOD}{}", method.name);
                if !self.defined.insert(name.clone()) {
                    self.scope.refused_functions.insert(name, "two classes have a method of this name".to_owned());
                }
            }
        }
    }

    /// Reads the methods of the class at line `i`, each as a function of the object and its other parameters.
    pub(super) fn methods(&mut self, list: &[Line<'_>], i: usize, indent: usize) {
        for method in methods_of(list, i, indent) {
            let Some(line) = list.get(method.index) else { continue };
            let name = format!("{METHOD}{}", method.name);
            // If several classes have a method of the same name, a call does not determine which one is meant; such a method is
            // refused.
            if self.scope.refused_functions.contains_key(&name) {
                continue;
            }
            let (block, _) = block_after(list, method.index, line.indent);
            let (_, rest) = line.piece.first_word(&['(', ':', '=']);
            self.definitions.insert(name.clone(), method.index);
            self.function_named(name, rest, block, &line.piece.range());
        }
    }

    /// True for an object of which some line of the model sets an attribute.
    pub(super) fn is_changing(&self, object: &PyExpr) -> bool {
        fields_of(object).is_some_and(|fields| fields.iter().any(|field| self.changed_attributes.contains(field)))
    }

    /// The shape of a parameter whose text makes an object, or copies one; `None` for other texts.
    pub(super) fn object_shape(&self, text: Piece<'_>, known: &BTreeMap<String, ParamShape>) -> Option<ParamShape> {
        if let Some(shape) = known.get(text.text) {
            return Some(*shape);
        }
        let open = text.text.find('(')?;
        let inner = text.from(open + 1);
        let close = closing(inner.text).filter(|close| close + 1 == inner.text.len())?;
        let inner = inner.up_to(close).trimmed();
        let name = text.up_to(open).text.trim();
        if matches!(name, "deepcopy" | "copy" | "copy.deepcopy" | "copy.copy") {
            return self.object_shape(inner, known);
        }
        let class = self.scope.classes.get(name);
        if class.is_none() && name != PARAMETER_SET {
            return None;
        }
        let mut fields: Vec<String> =
            class.iter().flat_map(|c| c.fields.iter().map(|(field, _)| field.clone())).collect();
        if class.is_none_or(|class| class.takes_any) {
            let params = class.map_or(&[][..], |class| class.params.as_slice());
            let named = split(inner).into_iter().filter_map(assignment).map(|(field, _)| field.text.to_owned());
            for field in named.filter(|field| !params.contains(field)) {
                if !fields.contains(&field) {
                    fields.push(field);
                }
            }
        }
        Some(self.scope.object_shape(&fields))
    }

    /// Records the modules to which productions pass the objects of their heads, until no more are found.
    pub(super) fn find_object_shapes(&mut self, list: &[Line<'_>], names: &std::collections::BTreeSet<String>) {
        for _ in 0..MAX_ROUNDS {
            let before = self.written_shapes.clone();
            for (i, line) in list.iter().enumerate() {
                let is_head = is_rule(line.piece);
                if !is_head && !line.piece.text.contains('(') {
                    continue;
                }
                if !is_head {
                    // Axioms and functions have no objects in their heads: they can pass on only objects made on the same line.
                    self.note_objects(*line, names, &BTreeMap::new());
                    continue;
                }
                let mut known = self.objects_of_head(line.piece);
                self.note_objects(*line, names, &known);
                for inner in block_after(list, i, line.indent).0 {
                    if let Some((name, value)) = assignment(inner.piece)
                        && let Some(shape) = self.object_shape(value, &known)
                    {
                        known.insert(name.text.to_owned(), shape);
                    }
                    self.note_objects(*inner, names, &known);
                }
            }
            if self.written_shapes == before {
                return;
            }
        }
    }

    /// The parameters of a head that are objects, with their shapes.
    fn objects_of_head(&self, piece: Piece<'_>) -> BTreeMap<String, ParamShape> {
        let mut out = BTreeMap::new();
        let end = ["-->", "-static->"].iter().find_map(|a| piece.text.find(a));
        let head = piece.up_to(end.or_else(|| super::pieces::colon(piece)).unwrap_or(piece.text.len()));
        let plain = head.text.replace(['<', '>'], " ");
        let Ok(spelled) = spell(Piece::new(head.at, &plain), &self.declared) else { return out };
        for s in spelled {
            let params = s.params.unwrap_or_default();
            for (param, shape) in params.iter().zip(self.shape_of(&s.name, params.len())) {
                if matches!(shape, ParamShape::Object { .. }) {
                    out.insert(param.text.split(" if ").next().unwrap_or("").trim().to_owned(), shape);
                }
            }
        }
        out
    }

    /// Records the modules on a line whose parameters are objects.
    fn note_objects(
        &mut self,
        line: Line<'_>,
        names: &std::collections::BTreeSet<String>,
        known: &BTreeMap<String, ParamShape>,
    ) {
        for name in names {
            for params in parameters_of_modules(line.piece, name) {
                let shapes: Vec<Option<ParamShape>> = params.iter().map(|p| self.object_shape(*p, known)).collect();
                if shapes.iter().any(Option::is_some) {
                    self.note_shape(name, shapes.into_iter().map(|s| s.unwrap_or(ParamShape::Number)).collect());
                }
            }
        }
    }
}

/// A method of a class (name and line), except methods whose names begin with `__`.
struct Method<'t> {
    name: &'t str,
    index: usize,
}

/// The methods of the class at line `i`.
fn methods_of<'t>(list: &[Line<'t>], i: usize, indent: usize) -> Vec<Method<'t>> {
    let block = block_after(list, i, indent).0;
    let least = block.iter().map(|line| line.indent).min().unwrap_or(0);
    let method = |(k, line): (usize, &Line<'t>)| {
        let (word, rest) = line.piece.first_word(&['(', ':', '=']);
        let name = rest.text.split('(').next().unwrap_or("").trim();
        let is_method = word.text == "def" && line.indent == least && !name.starts_with("__");
        is_method.then_some(Method { name, index: i + 1 + k })
    };
    block.iter().enumerate().filter_map(method).collect()
}

/// Reads the lines of a class: `__init__`, and values of attributes. `__str__` and `__repr__` have no effect; [`Model::methods`]
/// reads other methods.
fn class_of(block: &[Line<'_>]) -> Result<Class, Refusal> {
    let mut class = Class::default();
    let mut i = 0;
    while let Some(line) = block.get(i) {
        let (inner, next) = block_after(block, i, line.indent);
        i = next;
        let (word, rest) = line.piece.first_word(&['(', ':', '=']);
        match word.text {
            "pass" => {}
            "def" => {
                let name = rest.text.split('(').next().unwrap_or("").trim();
                if name.starts_with("__") && !matches!(name, "__init__" | "__str__" | "__repr__") {
                    let why = Refusal::new(format!("the function '{name}' of a class"), line.piece.range());
                    return Err(why.remedy("give it a name of its own, and call it as a method: p.add(q)"));
                }
                // Other methods are read as functions of the object.
                if name == "__init__" {
                    init_of(rest, inner, &mut class)?;
                }
            }
            _ if line.piece.text.starts_with(['"', '\'']) => {}
            _ => match assignment(line.piece).filter(|(name, _)| is_name(name.text)) {
                Some((name, value)) => class.fields.insert(0, (name.text.to_owned(), parse(value)?)),
                None => return Err(Refusal::new(format!("'{}' in a class", line.piece.text), line.piece.range())),
            },
        }
    }
    Ok(class)
}

/// Reads the lines of `__init__`: `self.name = value`, and `self.__dict__.update(kwd)`.
fn init_of(head: Piece<'_>, block: &[Line<'_>], class: &mut Class) -> Result<(), Refusal> {
    let refused = || Refusal::new("this '__init__' of a class", head.range());
    let FunctionHead { params, body } = function_head(head).ok_or_else(refused)?;
    let mut params = params.into_iter();
    class.own = params.next().ok_or_else(refused)?.0;
    let mut any = String::new();
    for (name, value) in params {
        match name.strip_prefix("**") {
            Some(name) => any = name.to_owned(),
            None => {
                class.params.push(name);
                class.defaults.push(value.map(parse).transpose()?);
            }
        }
    }
    let inline = [Line { indent: 0, piece: body }];
    let lines: &[Line<'_>] = if body.text.is_empty() { block } else { &inline };
    for line in lines {
        let text: String = line.piece.text.chars().filter(|c| !c.is_whitespace()).collect();
        if !any.is_empty() && text == format!("{}.__dict__.update({any})", class.own) {
            class.takes_any = true;
            continue;
        }
        if text == "pass" || text.starts_with(['"', '\'']) || text.starts_with("super(") {
            continue;
        }
        let target = attribute_target(line.piece).filter(|t| t.object.text == class.own);
        let value = target.as_ref().and_then(|t| t.rest.text.strip_prefix('=').map(|_| t.rest.from(1).trimmed()));
        let Some((target, value)) = target.zip(value) else {
            let why = format!("'{}' in the '__init__' of a class", line.piece.text);
            return Err(Refusal::new(why, line.piece.range()));
        };
        class.fields.retain(|(own, _)| own != target.field);
        class.fields.push((target.field.to_owned(), parse(value)?));
    }
    Ok(())
}
