//! Formatting of layer metadata, prim headers and values in the grammar of text layers.

use half::f16;

use crate::usd::layer_writer::{AttrSpec, CompositionArc, LayerMetadata, PrimMetadata};
use crate::usd::value::{UsdArray, UsdValue};
use osier_base::{Error, Result};

/// Appends lines of text, each indented by `depth` levels of four spaces.
pub(super) fn push_indented(text: &str, depth: usize, out: &mut String) {
    for line in text.split('\n') {
        for _ in 0..depth {
            out.push_str("    ");
        }
        out.push_str(line);
        out.push('\n');
    }
}

/// A string literal with its escapes; other control characters become spaces.
fn quoted(s: &str) -> String {
    let mut out = String::from("\"");
    for c in s.chars() {
        match c {
            '"' => out.push_str("\\\""),
            '\\' => out.push_str("\\\\"),
            '\n' => out.push_str("\\n"),
            // Other control characters, such as tabs, become spaces: no name or path needs them.
            c if c.is_control() => out.push(' '),
            c => out.push(c),
        }
    }
    out.push('"');
    out
}

/// The `#usda 1.0` line and the block of layer metadata.
pub(super) fn layer_header(meta: &LayerMetadata) -> String {
    let custom: String =
        meta.custom_layer_data().iter().map(|(k, v)| format!("            string {k} = {}\n", quoted(v))).collect();
    format!(
        "#usda 1.0\n# {}\n(\n    customLayerData = {{\n        dictionary osier = {{\n{custom}        }}\n    }}\n    \
         defaultPrim = {}\n    endTimeCode = {}\n    framesPerSecond = {}\n    metersPerUnit = 1\n    \
         startTimeCode = {}\n    timeCodesPerSecond = {}\n    upAxis = {}\n)\n",
        crate::GENERATOR,
        quoted(&meta.default_prim),
        meta.end,
        meta.fps,
        meta.start,
        meta.fps,
        quoted(meta.up.token())
    )
}

/// The target of a payload or reference: `@layer@</prim> (offset = -3)`.
fn composition_arc(arc: &CompositionArc) -> String {
    let asset = if arc.asset.is_empty() { String::new() } else { format!("@{}@", arc.asset) };
    let offset = if arc.phase > 0 { format!(" (offset = -{})", arc.phase) } else { String::new() };
    format!("{asset}<{}>{offset}", arc.prim)
}

/// `def Xform "name" (...)`.
pub(super) fn prim_header(type_name: &str, name: &str, meta: &PrimMetadata) -> String {
    let mut lines = Vec::new();
    if !meta.api.is_empty() {
        let names: Vec<String> = meta.api.iter().map(|a| quoted(a)).collect();
        lines.push(format!("prepend apiSchemas = [{}]", names.join(", ")));
    }
    if meta.inactive {
        lines.push("active = false".into());
    }
    if let Some(kind) = meta.kind {
        lines.push(format!("kind = {}", quoted(kind)));
    }
    if meta.instanceable {
        lines.push("instanceable = true".into());
    }
    if let Some(payload) = &meta.payload {
        lines.push(format!("prepend payload = {}", composition_arc(payload)));
    }
    if let Some(reference) = &meta.reference {
        lines.push(format!("prepend references = {}", composition_arc(reference)));
    }
    if let Some(variants) = &meta.variants {
        let selection =
            format!("variants = {{\n        string {} = {}\n    }}", variants.set, quoted(&variants.selection));
        lines.push(selection);
        lines.push(format!("prepend variantSets = {}", quoted(variants.set)));
    }
    let space = if type_name.is_empty() { "" } else { " " };
    let specifier = if meta.over { "over" } else { "def" };
    let head = format!("{specifier}{space}{type_name} \"{name}\"");
    if lines.is_empty() { head } else { format!("{head} (\n    {}\n)", lines.join("\n    ")) }
}

/// ` (interpolation = "vertex")` or nothing.
pub(super) fn attr_metadata_text(spec: &AttrSpec) -> String {
    let mut lines = Vec::new();
    if let Some(size) = spec.element_size {
        lines.push(format!("    elementSize = {size}\n"));
    }
    if let Some(interpolation) = spec.interpolation {
        lines.push(format!("    interpolation = {}\n", quoted(interpolation)));
    }
    if lines.is_empty() { String::new() } else { format!(" (\n{})", lines.concat()) }
}

/// Numbers that have a literal.
trait Decimal: Copy {
    /// The shortest decimal that reads back equal (of a half: as an `f32`), without exponent; -0 as 0. `None` if the number is
    /// not finite.
    fn decimal(self) -> Option<String>;
}

impl Decimal for f32 {
    fn decimal(self) -> Option<String> {
        self.is_finite().then(|| format!("{}", self + 0.0))
    }
}

impl Decimal for f64 {
    fn decimal(self) -> Option<String> {
        self.is_finite().then(|| format!("{}", self + 0.0))
    }
}

impl Decimal for f16 {
    fn decimal(self) -> Option<String> {
        self.to_f32().decimal()
    }
}

/// The text of a value, or the index of its first element that is not finite.
type TextOrNonFiniteIndex = std::result::Result<String, usize>;

fn tuple<T: Decimal>(v: &[T]) -> Option<String> {
    let parts: Option<Vec<String>> = v.iter().map(|x| x.decimal()).collect();
    parts.map(|p| format!("({})", p.join(", ")))
}

/// A quaternion given as x, y, z, w; text layers have w first.
fn quaternion<T: Decimal>(q: &[T; 4]) -> Option<String> {
    tuple(&[q[3], q[0], q[1], q[2]])
}

fn matrix4d(m: &[f64; 16]) -> Option<String> {
    // The array is row-major, so four numbers in a row are a row of the literal.
    let rows: Option<Vec<String>> = m.chunks_exact(4).map(tuple).collect();
    rows.map(|r| format!("( {} )", r.join(", ")))
}

fn list<T>(items: &[T], f: impl Fn(&T) -> Option<String>) -> TextOrNonFiniteIndex {
    let mut out = String::from("[");
    for (i, item) in items.iter().enumerate() {
        if i > 0 {
            out.push_str(", ");
        }
        out.push_str(&f(item).ok_or(i)?);
    }
    out.push(']');
    Ok(out)
}

fn array(a: &UsdArray) -> TextOrNonFiniteIndex {
    match a {
        UsdArray::Int(v) => list(v, |x| Some(x.to_string())),
        UsdArray::Int64(v) => list(v, |x| Some(x.to_string())),
        UsdArray::Float(v) => list(v, |x| x.decimal()),
        UsdArray::Float2(v) => list(v, |x| tuple(x)),
        UsdArray::Float3(v) => list(v, |x| tuple(x)),
        UsdArray::Float4(v) => list(v, |x| tuple(x)),
        UsdArray::Half3(v) => list(v, |x| tuple(x)),
        UsdArray::Quatf(v) => list(v, quaternion),
        UsdArray::Quath(v) => list(v, quaternion),
        UsdArray::Matrix4d(v) => list(v, matrix4d),
        UsdArray::Token(v) => list(v, |x| Some(quoted(x))),
    }
}

/// The literal of an asset path: one that contains `@`, as a file of the user's may be called, stands between three of them.
fn asset_path(path: &str) -> String {
    if path.contains('@') { format!("@@@{}@@@", path.replace("@@@", "\\@@@")) } else { format!("@{path}@") }
}

/// The literal of a value. `place`: names the attribute in errors.
pub(super) fn value(v: &UsdValue, place: &str) -> Result<String> {
    let text = match v {
        UsdValue::Bool(b) => Ok(u8::from(*b).to_string()),
        UsdValue::Float(x) => x.decimal().ok_or(0),
        UsdValue::Double(x) => x.decimal().ok_or(0),
        UsdValue::String(s) | UsdValue::Token(s) => Ok(quoted(s)),
        UsdValue::Asset(s) => Ok(asset_path(s)),
        UsdValue::Float2(x) => tuple(x).ok_or(0),
        UsdValue::Float3(x) => tuple(x).ok_or(0),
        UsdValue::Float4(x) => tuple(x).ok_or(0),
        UsdValue::Double3(x) => tuple(x).ok_or(0),
        UsdValue::Quatf(x) => quaternion(x).ok_or(0),
        UsdValue::Matrix4d(x) => matrix4d(x).ok_or(0),
        UsdValue::Array(a) => array(a),
    };
    text.map_err(|i| Error::export("X001", format!("{place}: element {i} is not finite")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_print_in_the_grammar_of_text_layers() {
        let p = |v: UsdValue| value(&v, "x").expect("finite");
        assert_eq!(p(UsdValue::Quatf([0.1, 0.2, 0.3, 1.0])), "(1, 0.1, 0.2, 0.3)");
        assert_eq!(p(UsdValue::Float(1e-10)), "0.0000000001");
        assert_eq!(p(UsdValue::Float(-0.0)), "0");
        assert_eq!(p(UsdArray::Float3(&[[1.0, 0.5, -2.0]]).into()), "[(1, 0.5, -2)]");
        assert_eq!(p(UsdValue::String("a \"b\"\\\n")), "\"a \\\"b\\\"\\\\\\n\"");
        assert_eq!(p(UsdValue::Asset("./a_files/b.png")), "@./a_files/b.png@");
        assert_eq!(p(UsdValue::Asset("./a@2x_files/b.png")), "@@@./a@2x_files/b.png@@@");
        assert_eq!(p(UsdValue::Asset("./a@@@_files/b.png")), "@@@./a\\@@@_files/b.png@@@");
        let e = value(&UsdArray::Float(&[0.0, f32::NAN]).into(), "/a.b").expect_err("not finite");
        assert_eq!(e.to_string(), "X001: /a.b: element 1 is not finite");
    }
}
