//! Curves of PlantGL, and functions that have them as graphs, made by the model or saved after it by the editor of L-Py.
//! Each is represented by a number, like a string, so that parameters can pass it on.

use std::ops::Range;

use super::Model;
use super::curve_table::{Curve, CurveKind, MAX_ALL_POINTS, MAX_CURVES};
use super::emit::constant_of;
use super::expression::{APPLY, FIRST_CURVE, PyExpr};
use super::lines::{Line, block_after};
use super::parser::parse;
use super::pieces::{assignment, is_name, split};
use super::refusal::Refusal;
use super::resolve::resolve;
use super::scope::Scope;
use super::vectors::coordinates_of;
use crate::dialect::text::Piece;

/// Limit on the points of a curve. Own: a spline with more takes a noticeable time.
const MAX_POINTS: usize = 4_096;
/// Limit on the points of a Bézier curve: its degree is one less, and its cost grows with the square.
const MAX_BEZIER_POINTS: usize = 64;

/// Kinds of curves, whether they are plane, and the keywords of their points.
const KINDS: [(&str, CurveKind, bool); 6] = [
    ("NurbsCurve2D", CurveKind::BSpline, true),
    ("BezierCurve2D", CurveKind::Bezier, true),
    ("Polyline2D", CurveKind::Lines, true),
    ("NurbsCurve", CurveKind::BSpline, false),
    ("BezierCurve", CurveKind::Bezier, false),
    ("Polyline", CurveKind::Lines, false),
];

/// The refusal of a curve. `why`: what is wrong with it.
fn curve_refusal(name: &str, why: &str, range: &Range<usize>, remedy: &'static str) -> Refusal {
    Refusal::new(format!("a '{name}' {why}"), range.clone()).remedy(remedy)
}

/// The items of a list, a vector, or an array of points such as `Point3Array([..])`.
fn items_of(e: &PyExpr) -> Option<&[PyExpr]> {
    match e {
        PyExpr::List(items, _) => Some(items),
        PyExpr::Call(name, args, _) if name.starts_with("Point") && name.ends_with("Array") => items_of(args.first()?),
        other => coordinates_of(other),
    }
}

/// The number of the curve or function that a call with resolved arguments makes, as a string constant; `None` for other calls.
pub(super) fn made(
    name: &str,
    args: &[PyExpr],
    range: &Range<usize>,
    scope: &Scope,
) -> Option<Result<PyExpr, Refusal>> {
    if name == "QuantisedFunction" {
        return Some(quantised(args, range, scope));
    }
    let (_, kind, is_flat) = KINDS.iter().find(|(own, ..)| *own == name)?;
    Some(curve(name, args, range, scope).and_then(|(points, remark)| {
        let points = coordinates(name, &points, *is_flat, range, scope)?;
        if let Some(why) = remark.filter(|_| *kind == CurveKind::BSpline) {
            return Err(why);
        }
        let most = if *kind == CurveKind::Bezier { MAX_BEZIER_POINTS } else { MAX_POINTS };
        if points.len() < 2 || points.len() > most {
            let why = format!("of {} points", points.len());
            return Err(curve_refusal(name, &why, range, "give it two points or more, up to 64 of a Bezier curve"));
        }
        text_of(Curve { kind: *kind, is_flat: *is_flat, points }, range, scope)
    }))
}

fn text_of(curve: Curve, range: &Range<usize>, scope: &Scope) -> Result<PyExpr, Refusal> {
    let number = scope.curves.borrow_mut().number(curve);
    let number = number.ok_or_else(|| {
        Refusal::new(format!("more than {MAX_CURVES} curves, or {MAX_ALL_POINTS} points of them"), range.clone())
    })?;
    Ok(PyExpr::Text(number, range.clone()))
}

/// Makes a curve from its arguments; refuses splines that cannot be read.
fn curve(
    name: &str,
    args: &[PyExpr],
    range: &Range<usize>,
    scope: &Scope,
) -> Result<(Vec<PyExpr>, Option<Refusal>), Refusal> {
    let (mut points, mut remark) = (None, None);
    for (k, arg) in args.iter().enumerate() {
        let (word, value) = match arg {
            PyExpr::Call(word, value, _) if word.ends_with('=') => (word.as_str(), value.first()),
            // The second and third arguments of a spline are knots and degree.
            value => (["ctrlPointList=", "knotList=", "degree="].get(k).copied().unwrap_or("width="), Some(value)),
        };
        match (word, value) {
            ("ctrlPointList=" | "pointList=", Some(value)) => points = items_of(value).map(<[PyExpr]>::to_vec),
            ("degree=", Some(value)) if constant_of(value, scope).is_some_and(|d| (d - 3.0).abs() <= 0.0) => {}
            ("degree=" | "knotList=", _) => {
                let what = "with a degree or knots of its own";
                let help = "leave them out: osier reads splines of degree 3 with uniform knots";
                remark = Some(curve_refusal(name, what, range, help));
            }
            // Ignore the number of line segments for drawing the curve, and their width.
            ("stride=" | "width=", _) => {}
            _ => {
                let what = format!("with the argument '{}'", word.trim_end_matches('='));
                return Err(curve_refusal(name, &what, range, "give it its points alone"));
            }
        }
    }
    let points = points
        .ok_or_else(|| curve_refusal(name, "without a list of points", range, "write: Polyline2D([(0,0),(1,0.5)])"))?;
    Ok((points, remark))
}

/// Coordinates of the points of a curve: x, y and a weight in the plane, else x, y, z and a weight.
fn coordinates(
    name: &str,
    points: &[PyExpr],
    is_flat: bool,
    range: &Range<usize>,
    scope: &Scope,
) -> Result<Vec<[f64; 3]>, Refusal> {
    let mut out = Vec::with_capacity(points.len());
    for point in points {
        let numbers =
            items_of(point).map(|items| items.iter().map(|e| constant_of(e, scope)).collect::<Option<Vec<_>>>());
        let Some(Some(numbers)) = numbers else {
            let help = "write its points as numbers, or as values of the model that are known before the first step";
            return Err(curve_refusal(name, "of points that are not constant", range, help));
        };
        let weight = |w: Option<&f64>| w.is_none_or(|w| (w - 1.0).abs() <= 0.0);
        match (is_flat, numbers.as_slice()) {
            (true, [x, y, rest @ ..]) if rest.len() <= 1 && weight(rest.first()) => out.push([*x, *y, 0.0]),
            (false, [x, y, z, rest @ ..]) if rest.len() <= 1 && weight(rest.first()) => out.push([*x, *y, *z]),
            _ => {
                let help = "write each point as its coordinates, and the weight 1 behind them if there is one";
                return Err(curve_refusal(name, "of other points, or of weights other than 1", range, help));
            }
        }
    }
    Ok(out)
}

/// Reads `QuantisedFunction(curve)`, also with a list of points; its number of samples has no effect here.
fn quantised(args: &[PyExpr], range: &Range<usize>, scope: &Scope) -> Result<PyExpr, Refusal> {
    let name = "QuantisedFunction";
    match args.first() {
        Some(PyExpr::Text(id, _)) if scope.curves.borrow().is_function(*id) => Ok(PyExpr::Text(*id, range.clone())),
        Some(list) if items_of(list).is_some() => {
            let points = coordinates(name, items_of(list).unwrap_or_default(), true, range, scope)?;
            if points.len() < 2 || points.len() > MAX_POINTS {
                return Err(curve_refusal(name, &format!("of {} points", points.len()), range, "give it two or more"));
            }
            text_of(Curve { kind: CurveKind::Lines, is_flat: true, points }, range, scope)
        }
        _ => {
            let help = "give it a curve of a plane, or a list of points: QuantisedFunction([(0,0),(1,2)])";
            Err(curve_refusal(name, "of this value", range, help))
        }
    }
}

/// The call of a function that is a variable of the production or a curve of the model; `None` for other names.
pub(super) fn applied(
    name: &str,
    args: &[PyExpr],
    range: &Range<usize>,
    scope: &Scope,
) -> Option<Result<PyExpr, Refusal>> {
    let function = if scope.locals.iter().any(|local| local == name) {
        PyExpr::Name(name.to_owned(), range.clone())
    } else if let Some(id) = scope.constants.get(name).filter(|id| scope.texts.contains(name) && **id >= FIRST_CURVE) {
        PyExpr::Text(*id, range.clone())
    } else if scope.globals.iter().any(|global| global == name) {
        PyExpr::Name(name.to_owned(), range.clone())
    } else {
        return None;
    };
    if let PyExpr::Text(id, _) = &function
        && !scope.curves.borrow().is_function(*id)
    {
        let why = Refusal::new(format!("a call of '{name}', a curve in space"), range.clone());
        return Some(Err(why.remedy("call a function of one number: QuantisedFunction of a curve in a plane")));
    }
    Some(match args {
        [x] => Ok(PyExpr::Call(APPLY.to_owned(), vec![function, x.clone()], range.clone())),
        _ => {
            let why = Refusal::new(format!("a call of '{name}' with {} arguments", args.len()), range.clone());
            Err(why.remedy("a function whose graph is a curve takes one number"))
        }
    })
}

impl Model<'_, '_> {
    /// Reads curves and functions that the editor of L-Py saves in `__initialiseContext__`: `w = pgl.NurbsCurve2D(..)`, or
    /// in older files `functions = [('w', NurbsCurve2D(..))]`. If a name is repeated, the last one counts.
    pub(super) fn curves(&mut self, list: &[Line<'_>]) {
        let is_header = |line: &Line<'_>| line.piece.text.starts_with("def __initialiseContext__");
        let Some(i) = list.iter().position(is_header) else { return };
        let indent = list.get(i).map_or(0, |line| line.indent);
        for (name, value) in block_after(list, i, indent).0.iter().filter_map(|line| assignment(line.piece)) {
            if !KINDS.iter().any(|(kind, ..)| value.text.contains(kind)) {
                continue;
            }
            if !value.text.starts_with('[') {
                self.saved_curve(name.text, value);
                continue;
            }
            let inner = value.from(1).up_to(value.text.len().saturating_sub(2));
            for pair in split(inner) {
                let inner = pair.text.strip_prefix('(').and_then(|t| t.strip_suffix(')'));
                let parts = inner.map(|t| split(Piece::new(pair.at + 1, t))).unwrap_or_default();
                if let [name, value] = parts.as_slice() {
                    self.saved_curve(name.text.trim_matches(['"', '\'']), *value);
                }
            }
        }
    }

    /// Adds a saved curve; an unreadable one is refused where it is used.
    fn saved_curve(&mut self, name: &str, value: Piece<'_>) {
        if !is_name(name) {
            return;
        }
        match parse(value).and_then(|e| resolve(&e, &self.scope, 0)) {
            Ok(PyExpr::Text(id, _)) => {
                self.scope.unreadable.remove(name);
                self.scope.constants.insert(name.to_owned(), id);
                self.scope.texts.insert(name.to_owned());
            }
            Ok(_) => {}
            Err(why) => {
                self.scope.constants.remove(name);
                self.scope.texts.remove(name);
                self.scope.unreadable.insert(name.to_owned(), why);
            }
        }
    }
}
