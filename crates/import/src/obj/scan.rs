//! Checks every line of an OBJ text and notes which libraries it names.

use std::collections::BTreeSet;

use super::tokens::{CornerForm, ObjToken, lines, plain, rest, tokens};
use super::{CheckedText, SyntaxError};
use crate::{ImportContext, ImportResult};

/// Most corners of one face: triangulation takes time in proportion to their square.
const MAX_FACE_CORNERS: usize = 10_000;

/// Errors after which checking stops: a broken exporter repeats one error in every line.
const MAX_REPORTED_ERRORS: usize = 20;

/// References of an OBJ text.
pub(super) struct ObjSummary {
    /// Library names in order, with their first byte.
    pub(super) libraries: Vec<(String, usize)>,
    /// Names of the materials that faces use.
    pub(super) materials: BTreeSet<String>,
    /// Whether `tobj` would misread the text, so that [`super::tokens::for_tobj`] must rewrite it.
    pub(super) needs_rewrite: bool,
    /// Whether some vertices have a colour and others none.
    pub(super) lacks_colors: bool,
}

/// Numbers of elements so far; `colored`, `weighted`: vertices with a colour, with a weight; `faceless`: faces of fewer than three
/// corners; `forms_differ`: some faces have texture coordinates or normals, others do not.
#[derive(Default)]
struct ObjCounts {
    vertices: u64,
    colored: u64,
    weighted: u64,
    uvs: u64,
    normals: u64,
    triangles: u64,
    faceless: u64,
    points: u64,
    lines: u64,
    form: Option<CornerForm>,
    forms_differ: bool,
}

/// Checks a text; `None` if it has errors, which are then in the report.
/// # Errors
/// X010 if it holds more than the limits allow.
pub(super) fn scan(context: &mut ImportContext<'_>, checked: &mut CheckedText<'_>) -> ImportResult<Option<ObjSummary>> {
    let plain = plain(checked.text);
    let mut counts = ObjCounts::default();
    let mut libraries = Vec::new();
    let mut materials: BTreeSet<String> = BTreeSet::new();
    let mut errors = 0;
    let mut indented = false;
    // Check every statement that is read later; other keywords (groups, smoothing, curves) are ignored.
    for (start, line) in lines(&plain) {
        let mut tokens = tokens(start, line);
        let Some(key) = tokens.next() else { continue };
        indented |= key.start != start && matches!(key.text, "usemtl" | "o" | "g");
        let result = match key.text {
            "v" => vertex(key, tokens, &mut counts),
            "vt" => numbers(key, tokens, 1..=3).map(|n| counts.uvs += u64::from(n > 0)),
            "vn" => numbers(key, tokens, 3..=3).map(|_| counts.normals += 1),
            "f" | "l" => face(key, tokens, &mut counts),
            "p" => {
                counts.points += 1;
                Ok(())
            }
            "mtllib" | "usemtl" => {
                let rest = rest(start, line);
                // A library that several lines name is read once.
                if key.text == "mtllib" && !libraries.iter().any(|(l, _)| l == rest.text) {
                    libraries.push((rest.text.to_owned(), rest.start));
                }
                if key.text == "usemtl" && !materials.contains(rest.text) {
                    materials.insert(rest.text.to_owned());
                }
                if rest.text.is_empty() {
                    Err(key.syntax_error("a name is missing", "add it, or remove the line"))
                } else {
                    Ok(())
                }
            }
            _ => Ok(()),
        };
        if let Err(syntax_error) = result {
            checked.report(context, syntax_error);
            errors += 1;
            if errors == MAX_REPORTED_ERRORS {
                break;
            }
        }
    }
    context.limit("vertices", counts.vertices.max(counts.uvs).max(counts.normals))?;
    context.limit("triangles", counts.triangles)?;
    // Vertices of objects without colours become white if other vertices have colours.
    let lacks_colors = counts.colored != 0 && counts.colored != counts.vertices;
    if lacks_colors && counts.weighted > 0 {
        let (some, all) = (counts.colored, counts.vertices);
        return Err(Box::new(
            context
                .error_about_file("X010", format_args!("gives {some} of {all} vertices a colour, and others a weight"))
                .help("colour all of them, or leave the weights out"),
        ));
    }
    if counts.faceless > 0 {
        let n = counts.faceless;
        context.warn("X016", format_args!("holds {n} faces with fewer than three corners; they are left out"));
    }
    if counts.points + counts.lines > 0 {
        let n = counts.points + counts.lines;
        context.warn("X016", format_args!("holds {n} points or lines, which are no faces; they are left out"));
    }
    let needs_rewrite = counts.forms_differ || counts.lines > 0 || indented || lacks_colors;
    Ok((errors == 0).then_some(ObjSummary { libraries, materials, needs_rewrite, lacks_colors }))
}

/// Checks that all tokens are numbers and that their count is allowed; returns the count.
fn numbers<'a>(
    key: ObjToken<'_>,
    tokens: impl Iterator<Item = ObjToken<'a>>,
    allowed: std::ops::RangeInclusive<usize>,
) -> Result<usize, SyntaxError> {
    let mut n = 0;
    for token in tokens {
        token.number()?;
        n += 1;
        if n > *allowed.end() {
            return Err(
                token.syntax_error(format!("at most {} numbers follow {:?}", allowed.end(), key.text), "remove it")
            );
        }
    }
    // `vt u` is valid OBJ, but `tobj` reads two numbers.
    let least = (*allowed.start()).max(if key.text == "vt" { 2 } else { 0 });
    if n < least {
        let message = format!("{:?} needs {least} numbers, {n} follow", key.text);
        return Err(key.syntax_error(message, "add the missing numbers"));
    }
    Ok(n)
}

/// Checks a `v` statement: x y z, with w or with r g b.
fn vertex<'a>(
    key: ObjToken<'_>,
    tokens: impl Iterator<Item = ObjToken<'a>>,
    counts: &mut ObjCounts,
) -> Result<(), SyntaxError> {
    let all: Vec<ObjToken<'a>> = tokens.take(7).collect();
    match numbers(key, all.iter().copied(), 3..=6)? {
        // The fourth number is the weight w of a rational vertex, by which x, y and z are divided.
        4 => {
            if let Some(w) = all.get(3)
                && w.number()?.abs() < f64::from(f32::MIN_POSITIVE)
            {
                return Err(w.syntax_error("a vertex cannot be divided by 0", "remove the fourth number"));
            }
            counts.weighted += 1;
        }
        5 => return Err(key.syntax_error("5 numbers are no vertex", "write x y z, x y z w, or x y z r g b")),
        6 => counts.colored += 1,
        _ => {}
    }
    counts.vertices += 1;
    Ok(())
}

/// Checks an `f` or `l` statement: number of corners, and indices of elements that are defined above it.
fn face<'a>(
    key: ObjToken<'_>,
    tokens: impl Iterator<Item = ObjToken<'a>>,
    counts: &mut ObjCounts,
) -> Result<(), SyntaxError> {
    let mut n = 0_usize;
    let mut form = None;
    for token in tokens {
        n += 1;
        if n > MAX_FACE_CORNERS {
            let message = format!("a face has more than {MAX_FACE_CORNERS} corners");
            return Err(key.syntax_error(message, "triangulate the mesh before exporting it"));
        }
        let mut fields = token.text.split('/');
        index(token, fields.next(), counts.vertices, "vertices", false)?;
        index(token, fields.next(), counts.uvs, "texture coordinates", true)?;
        index(token, fields.next(), counts.normals, "normals", true)?;
        if fields.next().is_some() {
            return Err(token.syntax_error("a corner has at most three indices", "write v, v/vt, v//vn or v/vt/vn"));
        }
        let given = CornerForm::of(token.text);
        if *form.get_or_insert(given) != given {
            let help = "write v, v/vt, v//vn or v/vt/vn at all corners of a face";
            return Err(token.syntax_error("this corner has other indices than the first one of its face", help));
        }
    }
    if n == 0 {
        return Err(key.syntax_error("a face without corners", "add them, or remove the line"));
    }
    if key.text == "l" {
        counts.lines += 1;
    } else {
        if let Some(form) = form {
            counts.forms_differ |= *counts.form.get_or_insert(form) != form;
        }
        counts.faceless += u64::from(n < 3);
        // A polygon of n corners is cut into n - 2 triangles.
        counts.triangles += n.saturating_sub(2) as u64;
    }
    Ok(())
}

/// Checks one index of a corner against the number of elements defined above it.
fn index(token: ObjToken<'_>, field: Option<&str>, count: u64, what: &str, optional: bool) -> Result<(), SyntaxError> {
    let field = match field {
        None | Some("") if optional => return Ok(()),
        Some(field) => field,
        None => "",
    };
    let help = "count from 1, or backwards from -1, over what stands above this line";
    // Negative indices count backwards from the last element defined so far; 0 is none.
    let digits = field.strip_prefix('-').unwrap_or(field);
    let plain = !digits.is_empty() && digits.bytes().all(|b| b.is_ascii_digit());
    if !plain {
        return Err(token.syntax_error("expected an index such as 3 or -1", help));
    }
    match digits.parse::<u64>() {
        Ok(0) => Err(token.syntax_error("indices count from 1", help)),
        Ok(n) if n <= count => Ok(()),
        _ => Err(token.syntax_error(format!("index {field} is out of range: {count} {what} stand above"), help)),
    }
}
