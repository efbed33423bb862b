//! Tables of osier: TOML with everything that Fractint's columns cannot hold.

use std::ops::{Bound, RangeBounds};
use toml::Spanned;
use toml::de::{DeTable, DeValue};

use super::IfsReader;
use crate::affine::Affine;
use crate::faces::MeshReference;
use crate::weights::WeightRule;
use crate::{Branch, Condensation, CondensationShape, Ifs, MAX_COEFFICIENT, Map};
use osier_base::diagnostic::{Diagnostic, Severity, Span, nearest};
use osier_base::units;

const SYSTEM_KEYS: &[&str] = &["name", "dim", "weights", "chaos", "map", "condensation", "palette"];
const MAP_KEYS: &[&str] = &[
    "abcdef",
    "abcdefghijkl",
    "rq",
    "shift",
    "branch",
    "p",
    "color",
    "colour",
    "coord",
    "speed",
    "opacity",
    "radius",
    "axis",
    "leaf",
    "stem",
];
const BRANCH_KEYS: &[&str] = &["h", "roll", "pitch", "scale"];
const CONDENSATION_KEYS: &[&str] = &["segment", "disc", "polygon", "mesh", "weight"];
const SEGMENT_KEYS: &[&str] = &["from", "to", "radius"];
const DISC_KEYS: &[&str] = &["center", "radius"];
/// Keys of which each map, and each condensation set, must have exactly one.
const MAP_FORMS: &[&str] = &["abcdef", "abcdefghijkl", "rq", "branch"];
const SHAPES: &[&str] = &["segment", "disc", "polygon", "mesh"];
const MESH_KEYS: &[&str] = &["file", "scale", "up"];
const MESH_ENDINGS: &[&str] = &[".obj", ".glb", ".gltf"];

/// Reads the system of the table `[ifs]`, or all systems of `[[ifs]]`.
pub(super) fn read(reader: &mut IfsReader<'_>) -> Vec<Ifs> {
    let (document, errors) = DeTable::parse_recoverable(reader.text);
    for e in &errors {
        let at = e.span().unwrap_or(0..0);
        let message = e.message().lines().collect::<Vec<_>>().join(", ");
        let d = Diagnostic::error("I033", message, reader.span(at.start, at.end), "here");
        reader.push(d.help("a table is TOML: [ifs], then name = \"...\" and map = [{ ... }, ...]"));
    }
    if !errors.is_empty() {
        return Vec::new();
    }
    let mut parser = TableReader { reader };
    // One system as a table, several as an array of tables.
    let Some(value) = document.get_ref().get("ifs") else { return Vec::new() };
    match value.get_ref() {
        DeValue::Table(t) => parser.system(t, value.span()).into_iter().collect(),
        DeValue::Array(list) => {
            let mut all = Vec::new();
            for item in list {
                if let Some(t) = parser.table(item, "[[ifs]]") {
                    all.extend(parser.system(t, item.span()));
                }
            }
            all
        }
        _ => {
            parser.report_type(value, "ifs", "a table");
            Vec::new()
        }
    }
}

type TomlItem<'i> = Spanned<DeValue<'i>>;

struct TableReader<'a, 'r> {
    reader: &'a mut IfsReader<'r>,
}

impl TableReader<'_, '_> {
    fn at(&self, range: std::ops::Range<usize>) -> Span {
        self.reader.span(range.start, range.end)
    }

    fn report_type(&mut self, item: &TomlItem<'_>, key: &str, wanted: &str) {
        let d = Diagnostic::error("I033", format!("{key} must be {wanted}"), self.at(item.span()), "another type");
        self.reader.push(d.help("see the page on attractors for every key"));
    }

    fn report_range(&mut self, item: &TomlItem<'_>, key: &str, range: &str) {
        let d = Diagnostic::error("I041", format!("{key} must be {range}"), self.at(item.span()), "outside");
        self.reader.push(d.help(format!("give {key} a value of {range}")));
    }

    fn check_keys(&mut self, table: &DeTable<'_>, place: &str, known: &[&str]) {
        for (key, _) in table.iter().filter(|(k, _)| !known.contains(&k.get_ref().as_ref())) {
            let text = format!("{place} has no key \"{}\"", key.get_ref());
            let d = Diagnostic::error("I032", text, self.at(key.span()), "unknown key");
            let d = match nearest(key.get_ref(), known.iter().copied()) {
                Some(near) => d.help(format!("did you mean \"{near}\"?")),
                None => d.help(format!("known here: {}", known.join(", "))),
            };
            self.reader.push(d);
        }
    }

    /// I033 for a table with several of `forms`, of which all but one would be ignored.
    fn check_forms(&mut self, table: &DeTable<'_>, place: &str, forms: &[&str]) {
        let given: Vec<_> = table.iter().filter(|(k, _)| forms.contains(&k.get_ref().as_ref())).collect();
        if let [(first, _), (second, _), ..] = given[..] {
            let text = format!("{place} is {} or {}, not both", first.get_ref(), second.get_ref());
            let d = Diagnostic::error("I033", text, self.at(second.span()), "a second form");
            self.reader.push(d.help("remove one of them"));
        }
    }

    fn table<'t, 'i>(&mut self, item: &'t TomlItem<'i>, key: &str) -> Option<&'t DeTable<'i>> {
        if let DeValue::Table(t) = item.get_ref() {
            return Some(t);
        }
        self.report_type(item, key, "a table");
        None
    }

    fn list<'t, 'i>(&mut self, item: &'t TomlItem<'i>, key: &str) -> Option<&'t [TomlItem<'i>]> {
        if let DeValue::Array(list) = item.get_ref() {
            return Some(list);
        }
        self.report_type(item, key, "a list");
        None
    }

    fn number(&mut self, item: &TomlItem<'_>, key: &str) -> Option<f64> {
        let value = match item.get_ref() {
            DeValue::Integer(i) => i64::from_str_radix(&i.as_str().replace('_', ""), i.radix()).ok().map(integer_value),
            DeValue::Float(f) => f.as_str().replace('_', "").parse::<f64>().ok(),
            _ => {
                self.report_type(item, key, "a number");
                return None;
            }
        };
        // Larger coefficients would overflow within a few maps.
        let finite = value.filter(|v| v.is_finite() && v.abs() <= MAX_COEFFICIENT);
        if finite.is_none() {
            let text = format!("{key} is not a finite number up to 1e12");
            let d = Diagnostic::error("I005", text, self.at(item.span()), "here");
            self.reader.push(d.help("write a finite decimal such as 0.5 or 1e-3"));
        }
        finite
    }

    /// A number in a range; I041, which states the range, for one outside.
    fn number_in(&mut self, item: &TomlItem<'_>, key: &str, range: impl RangeBounds<f64>) -> Option<f64> {
        let v = self.number(item, key)?;
        if !range.contains(&v) {
            // Spell out the bounds for the message.
            let from = match range.start_bound() {
                Bound::Excluded(min) => format!("above {min} and "),
                Bound::Included(min) => format!("at least {min} and "),
                Bound::Unbounded => String::new(),
            };
            let to = match range.end_bound() {
                Bound::Excluded(max) => format!("below {max}"),
                Bound::Included(max) => format!("at most {max}"),
                Bound::Unbounded => "finite".to_owned(),
            };
            self.report_range(item, key, &format!("{from}{to}"));
            return None;
        }
        Some(v)
    }

    fn numbers(&mut self, item: &TomlItem<'_>, key: &str, count: usize) -> Option<Vec<f64>> {
        let list = self.list(item, key)?;
        let values: Vec<f64> = list.iter().filter_map(|i| self.number(i, key)).collect();
        if values.len() < list.len() {
            return None;
        }
        if values.len() != count {
            let text = format!("{key} has {} numbers, but needs {count}", values.len());
            let d = Diagnostic::error("I007", text, self.at(item.span()), "here");
            self.reader.push(d.help("one number per letter of the key, in this order"));
            return None;
        }
        Some(values)
    }

    fn flag(&mut self, table: &DeTable<'_>, key: &str, fallback: bool) -> bool {
        match table.get(key).map(|i| (i, i.get_ref())) {
            Some((_, DeValue::Boolean(b))) => *b,
            Some((item, _)) => {
                self.report_type(item, key, "true or false");
                fallback
            }
            None => fallback,
        }
    }

    fn share(&mut self, table: &DeTable<'_>, key: &str, fallback: f64) -> f64 {
        table.get(key).and_then(|i| self.number_in(i, key, 0.0..=1.0)).unwrap_or(fallback)
    }

    fn color(&mut self, item: &TomlItem<'_>, key: &str) -> Option<[f32; 3]> {
        let text = if let DeValue::String(s) = item.get_ref() { s.as_ref() } else { "" };
        let digits = text.strip_prefix('#').filter(|d| d.len() == 6 && d.bytes().all(|b| b.is_ascii_hexdigit()));
        let part = |i: usize| {
            let byte = digits.and_then(|d| d.get(2 * i..2 * i + 2)).and_then(|d| u8::from_str_radix(d, 16).ok());
            byte.map(|v| units::linear_from_srgb(f32::from(v) / 255.0))
        };
        let color = part(0).zip(part(1)).zip(part(2)).map(|((r, g), b)| [r, g, b]);
        if color.is_none() {
            self.report_type(item, key, "a color such as \"#4f7a2b\"");
        }
        color
    }

    fn system(&mut self, table: &DeTable<'_>, range: std::ops::Range<usize>) -> Option<Ifs> {
        self.check_keys(table, "[ifs]", SYSTEM_KEYS);
        let before = self.reader.report.diagnostics.len();
        let name = match table.get("name").map(Spanned::get_ref) {
            Some(DeValue::String(s)) => s.to_string(),
            _ => {
                let d = Diagnostic::error("I033", "a system needs a name", self.at(range.clone()), "no name here");
                self.reader.push(d.help("add name = \"...\""));
                String::new()
            }
        };
        // Maps of any other dimension are read as those of the plane, so that their faults show as well.
        let mut dim = 2;
        if let Some(item) = table.get("dim")
            && let Some(d) = self.number(item, "dim")
        {
            match [2.0_f64, 3.0].iter().position(|known| (d - known).abs() < 1e-9) {
                Some(i) => dim += i,
                None => self.report_type(item, "dim", "2 or 3"),
            }
        }
        let span = self.at(table.get("name").map_or(range, Spanned::span));
        let maps = self.maps(table, dim, span);
        let ifs = Ifs {
            name,
            dim,
            maps,
            chaos: table.get("chaos").and_then(|i| self.chaos(i)),
            last: None,
            condensation: self.condensation(table, dim),
            view: None,
            palette: self.palette(table),
            weights: table.get("weights").and_then(|i| self.weight_rule(i)),
            span,
        };
        // A system with errors is dropped; later systems of the file are still read, so that all errors show at once.
        let sound = self.reader.report.diagnostics.iter().skip(before).all(|d| d.severity == Severity::Warning);
        sound.then_some(ifs)
    }

    fn palette(&mut self, table: &DeTable<'_>) -> Vec<[f32; 3]> {
        let Some(item) = table.get("palette") else { return Vec::new() };
        let list = self.list(item, "palette").unwrap_or_default();
        list.iter().filter_map(|i| self.color(i, "palette")).collect()
    }

    fn weight_rule(&mut self, item: &TomlItem<'_>) -> Option<WeightRule> {
        const WORDS: &[(&str, WeightRule)] = &[
            ("file", WeightRule::File),
            ("file-raw", WeightRule::Raw),
            ("det", WeightRule::Det),
            ("moran", WeightRule::Moran),
            ("equal", WeightRule::Equal),
            ("fractint", WeightRule::Fractint),
        ];
        let word = if let DeValue::String(s) = item.get_ref() { s.as_ref() } else { "" };
        let found = WORDS.iter().find(|(w, _)| *w == word).map(|w| w.1);
        if found.is_none() {
            let list: Vec<&str> = WORDS.iter().map(|w| w.0).collect();
            self.report_type(item, "weights", &format!("one of {}", list.join(", ")));
        }
        found
    }

    fn chaos(&mut self, item: &TomlItem<'_>) -> Option<Vec<Vec<f64>>> {
        let rows = self.list(item, "chaos")?;
        let mut out = Vec::with_capacity(rows.len());
        for row in rows {
            let cells = self.list(row, "chaos")?;
            out.push(cells.iter().filter_map(|c| self.number(c, "chaos")).collect());
        }
        Some(out)
    }

    fn maps(&mut self, table: &DeTable<'_>, dim: usize, span: Span) -> Vec<Map> {
        let list = table.get("map").and_then(|i| self.list(i, "map")).unwrap_or_default();
        if list.is_empty() {
            let d = Diagnostic::error("I007", "the system holds no maps", span, "no map here");
            self.reader.push(d.help("add map = [{ abcdef = [a, b, c, d, e, f], p = 0.5 }, ...]"));
        }
        if list.len() > self.reader.max_maps() {
            let text = format!("the system has {} maps, the limit is {}", list.len(), self.reader.max_maps());
            let d = Diagnostic::error("I008", text, span, "too many maps");
            self.reader.push(d.help("use fewer maps, or raise the limit with --max-maps"));
            return Vec::new();
        }
        let mut out = Vec::new();
        for item in list {
            if let Some(t) = self.table(item, "map") {
                out.extend(self.map(t, item, dim));
            }
        }
        out
    }

    fn map(&mut self, t: &DeTable<'_>, item: &TomlItem<'_>, dim: usize) -> Option<Map> {
        self.check_keys(t, "a map", MAP_KEYS);
        self.check_forms(t, "a map", MAP_FORMS);
        if let Some(shift) = t.get("shift").filter(|_| !t.contains_key("rq")) {
            let d = Diagnostic::error("I033", "shift belongs to rq", self.at(shift.span()), "no rq beside it");
            self.reader.push(d.help("other forms of a map contain the shift"));
        }
        let span = self.at(item.span());
        let mut branch = None;
        // A map is given in one of four forms, two for the plane and two for space.
        let affine = if let Some(i) = t.get("abcdef").filter(|_| dim == 2) {
            let c = self.numbers(i, "abcdef", 6)?;
            Affine::plane(std::array::from_fn(|k| c[k]))
        } else if let Some(i) = t.get("abcdefghijkl").filter(|_| dim == 3) {
            let c = self.numbers(i, "abcdefghijkl", 12)?;
            Affine::space(std::array::from_fn(|k| c[k]))
        } else if let Some(i) = t.get("rq").filter(|_| dim == 2) {
            let c = self.numbers(i, "rq", 4)?;
            let shift = match t.get("shift") {
                Some(i) => self.numbers(i, "shift", 2)?,
                None => vec![0.0; 2],
            };
            Affine::polar([c[0], c[1], units::radians(c[2]), units::radians(c[3])], [shift[0], shift[1]])
        } else if let Some(i) = t.get("branch").filter(|_| dim == 3) {
            let b = self.branch(i)?;
            branch = Some(b);
            Affine::branch(&b)
        } else {
            let forms = if dim == 2 { "abcdef or rq" } else { "abcdefghijkl or branch" };
            let d = Diagnostic::error("I033", format!("a map of {dim} dimensions needs {forms}"), span, "none here");
            self.reader.push(d.help("every map is one of these forms; dim = 3 for maps of space"));
            return None;
        };
        let mut map = Map::new(affine, t.get("p").and_then(|i| self.number(i, "p")), span);
        map.branch = branch;
        let color = t.get("color").map(|i| ("color", i)).or(t.get("colour").map(|i| ("colour", i)));
        map.color = color.and_then(|(key, i)| self.color(i, key));
        map.coord = self.share(t, "coord", 0.0);
        map.speed = self.share(t, "speed", 0.5);
        map.opacity = self.share(t, "opacity", 1.0);
        map.radius =
            t.get("radius").and_then(|i| self.number_in(i, "radius", (Bound::Excluded(0.0), Bound::Included(1.0))));
        map.axis = self.flag(t, "axis", false);
        map.leaf = self.flag(t, "leaf", true);
        map.stem = self.flag(t, "stem", false);
        Some(map)
    }

    fn branch(&mut self, item: &TomlItem<'_>) -> Option<Branch> {
        let t = self.table(item, "branch")?;
        self.check_keys(t, "a branch", BRANCH_KEYS);
        let mut angle = |key: &str| t.get(key).map_or(Some(0.0), |i| self.number(i, key)).map(units::radians);
        let (roll, pitch) = (angle("roll")?, angle("pitch")?);
        let h = t.get("h").map_or(Some(1.0), |i| self.number_in(i, "h", 0.0..=1.0))?;
        let scale = t
            .get("scale")
            .map_or(Some(0.5), |i| self.number_in(i, "scale", (Bound::Excluded(0.0), Bound::Included(0.999_999))))?;
        Some(Branch { h, roll, pitch, scale })
    }

    fn condensation(&mut self, table: &DeTable<'_>, dim: usize) -> Vec<Condensation> {
        let list = table.get("condensation").and_then(|i| self.list(i, "condensation")).unwrap_or_default();
        let mut out = Vec::new();
        for item in list {
            let Some(t) = self.table(item, "condensation") else { continue };
            self.check_keys(t, "a condensation set", CONDENSATION_KEYS);
            self.check_forms(t, "a condensation set", SHAPES);
            let weight = self.share(t, "weight", 0.05);
            let shape = match t.get("mesh") {
                Some(mesh) => self.mesh(mesh, dim).map(CondensationShape::Mesh),
                None => {
                    let before = self.reader.report.diagnostics.len();
                    let shape = self.shape(t);
                    // A faulty number in it has been reported.
                    if shape.is_none() && self.reader.report.diagnostics.len() == before {
                        self.report_type(item, "condensation", "a segment, disc, polygon or mesh");
                    }
                    shape
                }
            };
            out.extend(shape.map(|shape| Condensation { shape, weight }));
        }
        // The maps get the rest of the probability, which must be above 0.
        let sum = out.iter().fold(0.0, |s, c| s + c.weight);
        if sum >= 1.0
            && let Some(item) = table.get("condensation")
        {
            self.report_range(item, "the sum of condensation weights", "less than 1");
        }
        out
    }

    /// `mesh = "FILE"` or `mesh = { file = "FILE", scale = 1, up = "y" }`; the caller, who knows the
    /// search path, reads the mesh file.
    fn mesh(&mut self, item: &TomlItem<'_>, dim: usize) -> Option<MeshReference> {
        if dim != 3 {
            let text = "a mesh lies in space, this system in the plane";
            let d = Diagnostic::error("I033", text, self.at(item.span()), "needs dim = 3");
            self.reader.push(d.help("add dim = 3 and maps abcdefghijkl or branch, or take a polygon"));
            return None;
        }
        // A string is just the file name; a table adds scale and up axis.
        let (name, scale, up_z) = match item.get_ref() {
            DeValue::Table(t) => {
                self.check_keys(t, "a mesh", MESH_KEYS);
                let scale = t.get("scale").map_or(Some(1.0), |i| self.number_in(i, "scale", 1e-6..=1e6))?;
                let up = t.get("up").map(|i| (i, i.get_ref()));
                let up_z = match up {
                    None => false,
                    Some((_, DeValue::String(s))) if s == "y" || s == "z" => s == "z",
                    Some((i, _)) => {
                        self.report_type(i, "up", "\"y\" or \"z\"");
                        return None;
                    }
                };
                (t.get("file"), scale, up_z)
            }
            _ => (Some(item), 1.0, false),
        };
        let file = match name.map(|n| (n, n.get_ref())) {
            Some((n, DeValue::String(s))) => Some((n, s.to_string())),
            _ => None,
        };
        let ends = |s: &str| MESH_ENDINGS.iter().any(|e| s.to_ascii_lowercase().ends_with(e));
        let Some((named, file)) = file.filter(|(_, s)| ends(s)) else {
            self.report_type(name.unwrap_or(item), "mesh", "the name of a file .obj, .glb or .gltf");
            return None;
        };
        Some(MeshReference { file, scale, up_z, span: self.at(named.span()), faces: std::sync::Arc::default() })
    }

    fn shape(&mut self, t: &DeTable<'_>) -> Option<CondensationShape> {
        let point = |p: &mut Self, t: &DeTable<'_>, key: &str| -> Option<[f64; 3]> {
            let item = t.get(key)?;
            // Points have two coordinates in the plane and three in space; z defaults to 0.
            let count = p.list(item, key)?.len().clamp(2, 3);
            let v = p.numbers(item, key, count)?;
            Some([v[0], v[1], v.get(2).copied().unwrap_or(0.0)])
        };
        if let Some(item) = t.get("segment") {
            let s = self.table(item, "segment")?;
            self.check_keys(s, "a segment", SEGMENT_KEYS);
            let radius = s.get("radius").map_or(Some(0.05), |i| self.number_in(i, "radius", 0.0..))?;
            return Some(CondensationShape::Segment {
                from: point(self, s, "from")?,
                to: point(self, s, "to")?,
                radius,
            });
        }
        if let Some(item) = t.get("disc") {
            let s = self.table(item, "disc")?;
            self.check_keys(s, "a disc", DISC_KEYS);
            let radius = s.get("radius").map_or(Some(1.0), |i| self.number_in(i, "radius", 0.0..))?;
            return Some(CondensationShape::Disc { center: point(self, s, "center")?, radius });
        }
        let polygon = t.get("polygon")?;
        let list = self.list(polygon, "polygon")?;
        let mut points = Vec::new();
        for item in list {
            let v = self.numbers(item, "polygon", 2)?;
            points.push([v[0], v[1]]);
        }
        if !is_fan(&points) {
            let text = "the polygon has a corner that its first corner does not see";
            let d = Diagnostic::error("I033", text, self.at(polygon.span()), "not convex");
            self.reader
                .push(d.help("begin at another corner, or divide it into convex polygons that share the weight"));
        }
        (points.len() >= 3).then_some(CondensationShape::Polygon { points })
    }
}

/// True if the triangles from the first corner to the edges cover the polygon exactly once, as drawing points requires:
/// seen from that corner, all edges run in the same direction of rotation.
fn is_fan(points: &[[f64; 2]]) -> bool {
    let Some((first, rest)) = points.split_first() else { return true };
    let area = |pair: &[[f64; 2]]| {
        let [a, b] = [pair[0], pair[1]].map(|p| [p[0] - first[0], p[1] - first[1]]);
        a[0] * b[1] - a[1] * b[0]
    };
    let areas: Vec<f64> = rest.windows(2).map(area).collect();
    // Collinear corners give areas that are only rounding errors.
    let slack = 1e-9 * areas.iter().fold(0.0_f64, |most, v| most.max(v.abs()));
    areas.iter().all(|v| *v >= -slack) || areas.iter().all(|v| *v <= slack)
}

#[allow(clippy::cast_precision_loss, reason = "whole numbers of tables are small")]
fn integer_value(v: i64) -> f64 {
    v as f64
}
