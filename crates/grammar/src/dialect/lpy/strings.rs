//! Parses strings of modules of L-Py, such as `F(1)[+(30)Apex(n-1)]`, and the names of modules.

use std::ops::Range;

use super::expression::PyExpr;
use super::param_shape::ParamShape;
use super::parser::parse;
use super::pieces::{assignment, closing, is_name, split};
use super::refusal::Refusal;
use crate::dialect::text::Piece;

/// Names of L-Py that are synonyms of a shorter name. Source: its help card.
const ALIASES: [(&str, &str); 39] = [
    ("SB", "["),
    ("EB", "]"),
    ("Left", "+"),
    ("Right", "-"),
    ("Up", "^"),
    ("Down", "&"),
    ("RollL", "/"),
    ("RollR", "\\"),
    ("TurnAround", "|"),
    ("RollToVert", "@v"),
    ("SetHead", "@R"),
    ("MoveTo", "@M"),
    ("DivScale", "@Dd"),
    ("MultScale", "@Di"),
    ("SetScale", "@D"),
    ("StartGC", "@Gc"),
    ("EndGC", "@Ge"),
    ("BP", "{"),
    ("EP", "}"),
    ("PP", "."),
    ("Sphere", "@O"),
    ("Box", "@B"),
    ("Quad", "@b"),
    ("Circle", "@o"),
    ("Label", "@L"),
    ("PglShape", "@g"),
    ("IncWidth", "_"),
    ("DecWidth", "!"),
    ("IncColor", ";"),
    ("DecColor", ","),
    ("Elasticity", "@Ts"),
    ("Tropism", "@Tp"),
    ("Cut", "%"),
    ("TextureVCoeff", "TextureVScale"),
    ("StartScreenProjection", "@2D"),
    ("EndScreenProjection", "@3D"),
    ("LeftReflexion", "LeftReflection"),
    ("UpReflexion", "UpReflection"),
    ("HeadingReflexion", "HeadingReflection"),
];

/// Names of several characters that need no declaration. Source: the help card of L-Py.
const NAMES: [&str; 48] = [
    "SetContour",
    "SetGuide",
    "EndGuide",
    "PositionOnGuide",
    "Sweep",
    "@Dd",
    "@Di",
    "@D",
    "@R",
    "@M",
    "@v",
    "@Gc",
    "@Ge",
    "@O",
    "@B",
    "@b",
    "@o",
    "@L",
    "@g",
    "@Ts",
    "@Tp",
    "@2D",
    "@3D",
    "?P",
    "?H",
    "?U",
    "?L",
    "?R",
    "?F",
    "nF",
    "iRollL",
    "iRollR",
    "Pinpoint",
    "PinpointRel",
    "EulerAngles",
    "MoveRel",
    "LineTo",
    "OLineTo",
    "LineRel",
    "OLineRel",
    "SetWidth",
    "SetColor",
    "InterpolateColors",
    "Frame",
    "SectionResolution",
    "LeftReflection",
    "UpReflection",
    "HeadingReflection",
];

/// Commands whose parameters are Python objects.
const OBJECTS: [&str; 3] = ["surface", "TextureScale", "TextureTransformation"];

/// Queries that return three numbers.
pub(super) const QUERIES: [&str; 4] = ["?P", "?H", "?U", "?L"];

/// The refusal of a query that returns more than a vector.
pub(super) fn frame_query(name: &str, range: Range<usize>) -> Refusal {
    let why = Refusal::new(format!("the query '{name}'"), range);
    why.remedy("ask for its parts: ?P (position), ?H (heading), ?L (left) and ?U (up)")
}

/// A module in a string, with its parameters as text.
#[derive(Debug, Clone)]
pub(super) struct Spelled<'t> {
    /// The name, with synonyms replaced.
    pub name: String,
    pub params: Option<Vec<Piece<'t>>>,
    pub range: Range<usize>,
}

/// A module that a production makes; its parameters are still expressions.
#[derive(Debug, Clone)]
pub(super) struct PyModule {
    pub name: String,
    pub args: Vec<PyExpr>,
    /// Shapes of its parameters before lists and vectors were replaced by numbers; `None` if `args` still holds lists and
    /// vectors.
    pub shape: Option<Vec<ParamShape>>,
    pub range: Range<usize>,
}

/// True for a command of the turtle, whose parameters are numbers or points.
pub(super) fn is_command(name: &str) -> bool {
    NAMES.contains(&name)
        || OBJECTS.contains(&name)
        || name.starts_with(['@', '~', '?'])
        || matches!(
            name,
            "F" | "f" | "+" | "-" | "^" | "&" | "/" | "\\" | "|" | "_" | "!" | ";" | "," | "." | "{" | "}"
        )
}

/// Length of the name at the beginning of a text, and the name: the longest known name, else one character.
fn name_at(text: &str, declared: &[String]) -> (usize, String) {
    // `~l` is the surface l.
    if let Some(rest) = text.strip_prefix('~')
        && let Some(letter) = rest.chars().next().filter(char::is_ascii_alphabetic)
    {
        return (2, format!("~{letter}"));
    }
    let aliases = ALIASES.iter().map(|(long, short)| (*long, *short));
    // Declared names compete for the longest match: `module Fx` hides the F in `Fx`.
    let own = declared.iter().map(|n| (n.as_str(), n.as_str()));
    // `new` makes a module only with a parenthesis; otherwise its letters are three modules.
    let is_called = |(name, _): &(&str, &str)| text.strip_prefix(*name).is_some_and(|t| t.starts_with('('));
    let aliases = aliases.chain([("newmodule", "new"), ("new", "new")].into_iter().filter(is_called));
    let known = aliases.chain(NAMES.iter().chain(&OBJECTS).map(|n| (*n, *n))).chain(own);
    let longest = known.filter(|(name, _)| text.starts_with(name)).max_by_key(|(name, _)| name.len());
    match longest {
        Some((name, short)) => (name.len(), short.to_owned()),
        None => {
            let c = text.chars().next().unwrap_or(' ');
            // An unknown command that begins with `@` has a name of two characters.
            let second = text[c.len_utf8()..].chars().next().filter(|d| c == '@' && !d.is_whitespace());
            let n = c.len_utf8() + second.map_or(0, char::len_utf8);
            (n, text[..n].to_owned())
        }
    }
}

/// Splits a text into modules; their parameters are not parsed yet.
pub(super) fn spell<'t>(piece: Piece<'t>, declared: &[String]) -> Result<Vec<Spelled<'t>>, Refusal> {
    let mut out = Vec::new();
    let text = piece.text;
    let mut i = 0;
    while i < text.len() {
        let rest = &text[i..];
        let blanks = rest.len() - rest.trim_start().len();
        if blanks > 0 {
            i += blanks;
            continue;
        }
        let (n, name) = name_at(rest, declared);
        let at = piece.at + i;
        // Parameters are read with their module, so that a parenthesis here belongs to no module.
        if matches!(name.as_str(), "(" | ")" | "\"" | "'") {
            return Err(Refusal::new(format!("'{name}' without a module before it"), at..at + n));
        }
        i += n;
        let mut end = piece.at + i;
        let after = &text[i..];
        // Blanks may separate a name and its parenthesis.
        let open = after.len() - after.trim_start().len();
        let mut params = None;
        if after[open..].starts_with('(') {
            let inner = piece.from(i + open + 1);
            let close = closing(inner.text)
                .ok_or_else(|| Refusal::new("an unclosed '('", inner.at.saturating_sub(1)..inner.at))?;
            params = Some(split(inner.up_to(close)));
            i += open + close + 2;
            end = piece.at + i;
        }
        out.push(Spelled { name, params, range: at..end });
    }
    Ok(out)
}

/// The three numbers of a point `Vector3(x,y,z)` or `(x,y,z)`; other parameters unchanged.
fn coordinates(piece: Piece<'_>) -> Vec<Piece<'_>> {
    let inner = piece.text.strip_prefix("Vector3").unwrap_or(piece.text);
    let from = piece.text.len() - inner.len();
    // The opening parenthesis must close at the very end: `(a)*(b)` is an expression.
    let is_list = inner.starts_with('(') && closing(&inner[1..]).is_some_and(|i| i + 2 == inner.len());
    if !is_list {
        return vec![piece];
    }
    let parts = split(piece.up_to(piece.text.len() - 1).from(from + 1));
    // Leave other numbers of parts to the expression parser, which reports them.
    if parts.len() == 3 { parts } else { vec![piece] }
}

/// An argument of a module: an expression; `*list` is represented as a call of `*`, and `size=2` as a call of `size=`.
fn argument(piece: Piece<'_>) -> Result<PyExpr, Refusal> {
    if let Some((name, value)) = assignment(piece).filter(|(name, _)| is_name(name.text)) {
        return Ok(PyExpr::Call(format!("{}=", name.text), vec![parse(value)?], piece.range()));
    }
    if piece.text.starts_with("**") {
        let why = Refusal::new("'**', arguments by name", piece.range());
        return Err(why.remedy("write the parameters of the module in their order"));
    }
    match piece.text.strip_prefix('*') {
        Some(_) => Ok(PyExpr::Call("*".into(), vec![parse(piece.from(1).trimmed())?], piece.range())),
        None => parse(piece),
    }
}

/// Modules in a list argument of `nsproduce`, `([F(1), ('Leaf', 2), SB()])`; `None` for other arguments.
pub(super) fn listed_modules(piece: Piece<'_>, declared: &[String]) -> Result<Option<Vec<PyModule>>, Refusal> {
    let Some(inner) = within(piece, '(', ')').and_then(|list| within(list, '[', ']')) else { return Ok(None) };
    let mut out = Vec::new();
    for item in split(inner) {
        // In `('F', 1)` and `'F'` a string names the module.
        let parts = within(item, '(', ')').or_else(|| within(item, '[', ']')).map_or_else(|| vec![item], split);
        let Some((name, params)) = parts.split_first().filter(|(name, _)| name.text.starts_with(['"', '\''])) else {
            match modules(item, declared)?.as_slice() {
                [module] => out.push(module.clone()),
                _ => return Err(several_modules(item)),
            }
            continue;
        };
        let text = name.text.trim_matches(['"', '\'']);
        let (length, known) = if text.is_empty() { (1, String::new()) } else { name_at(text, declared) };
        if length != text.len() {
            return Err(several_modules(item));
        }
        let args = params.iter().map(|p| argument(*p)).collect::<Result<Vec<_>, _>>()?;
        out.push(PyModule { name: known, args, shape: None, range: item.range() });
    }
    Ok(Some(out))
}

/// The module made by `new('Leaf', 2)`: name, then parameters.
fn new_module(s: &Spelled<'_>, declared: &[String]) -> Result<PyModule, Refusal> {
    let Some((name, params)) = s.params.as_deref().and_then(<[_]>::split_first) else {
        return Err(Refusal::new("'new' without the name of a module", s.range.clone()));
    };
    let text = name.text.trim_matches(['"', '\'']);
    let known = name.text.starts_with(['"', '\'']).then(|| name_at(text, declared));
    let Some((_, name)) = known.filter(|(length, _)| *length == text.len() && !text.is_empty()) else {
        let why = Refusal::new("'new' of a name that is not written out", s.range.clone());
        return Err(why.remedy("write the name of a declared module in quotes, new('Leaf', 2), or the module itself"));
    };
    let args = params.iter().map(|p| argument(*p)).collect::<Result<Vec<_>, _>>()?;
    Ok(PyModule { name, args, shape: None, range: s.range.clone() })
}

/// The text between two characters, if it begins and ends with them.
fn within(piece: Piece<'_>, open: char, close: char) -> Option<Piece<'_>> {
    let piece = piece.trimmed();
    let inner = piece.text.strip_prefix(open)?.strip_suffix(close)?;
    Some(Piece::new(piece.at + open.len_utf8(), inner).trimmed())
}

/// The refusal of an item in a list of modules that is not a single module.
fn several_modules(item: Piece<'_>) -> Refusal {
    let why = Refusal::new(format!("'{}' as a module of a list", item.text), item.range());
    why.remedy("declare names of several letters: module Leaf; separate modules by commas")
}

/// Modules of a successor in order; none for a single `*`, which is the empty string.
pub(super) fn modules(piece: Piece<'_>, declared: &[String]) -> Result<Vec<PyModule>, Refusal> {
    let spelled = spell(piece, declared)?;
    // A single `*` produces no module.
    if let [only] = spelled.as_slice()
        && only.name == "*"
    {
        return Ok(Vec::new());
    }
    let module = |s: Spelled<'_>| {
        if s.name == "new" {
            return new_module(&s, declared);
        }
        if matches!(s.name.as_str(), "?R" | "?F") {
            return Err(frame_query(&s.name, s.range));
        }
        // A query gets three parameters for the turtle's answer, even if the model gives fewer or none.
        if QUERIES.contains(&s.name.as_str()) && s.params.as_ref().map_or(0, Vec::len) != 3 {
            return Ok(PyModule { name: s.name, args: vec![PyExpr::Number(0.0); 3], shape: None, range: s.range });
        }
        // Parameters of these commands are objects that affect only the surface of a drawing, and are omitted.
        let is_object = OBJECTS.contains(&s.name.as_str()) || matches!(s.name.as_str(), "@g" | "@L");
        let args = match &s.params {
            Some(params) if !is_object => {
                // In a command a point is its coordinates; in another module it is one parameter.
                let is_point = is_command(&s.name);
                let parts = params.iter().flat_map(|p| if is_point { coordinates(*p) } else { vec![*p] });
                parts.map(argument).collect::<Result<Vec<_>, _>>()?
            }
            _ => Vec::new(),
        };
        Ok(PyModule { name: s.name, args, shape: None, range: s.range })
    };
    spelled.into_iter().map(module).collect()
}
