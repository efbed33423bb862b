//! The affine part of flames (flam3, Apophysis): linear maps, post transforms, chaos rows, palette and view.

use glam::DVec3;
use roxmltree::{Attribute, Document, Node, ParsingOptions};

use super::IfsReader;
use crate::affine::Affine;
use crate::{Ifs, MAX_COEFFICIENT, Map, PictureView};
use osier_base::diagnostic::{Diagnostic, Span};
use osier_base::files::number;
use osier_base::units;

/// Attributes of a map that are read.
const MAP_ATTRIBUTES: &[&str] = &[
    "weight",
    "color",
    "color_speed",
    "symmetry",
    "opacity",
    "plotmode",
    "coefs",
    "post",
    "chaos",
    "linear",
    "linear3D",
    "name",
];
/// Attributes that change nothing when they have this value or are only for show.
const IGNORED_ATTRIBUTES: &[(&str, &str)] =
    &[("animate", ""), ("var_color", ""), ("enabled", "1"), ("solo", "0"), ("density", "1")];
/// Attributes of a flame that are read or say nothing about the attractor.
const FLAME_ATTRIBUTES: &[&str] = &[
    "name",
    "version",
    "size",
    "center",
    "scale",
    "zoom",
    "rotate",
    "background",
    "gamma",
    "brightness",
    "vibrancy",
    "filter",
    "quality",
    "oversample",
    "supersample",
    "time",
    "palette",
    "hue",
    "passes",
    "temporal_samples",
    "nick",
    "url",
    "notes",
    "highlight_power",
    "gamma_threshold",
    "estimator_radius",
    "estimator_minimum",
    "estimator_curve",
    "palette_mode",
    "palette_interpolation",
    "interpolation",
    "interpolation_type",
    "temporal_filter_type",
    "temporal_filter_width",
    "filter_shape",
    "curves",
    "plugins",
    "new_linear",
];
/// Upper limit on the nodes of an XML document.
const MAX_XML_NODES: u32 = 1_000_000;

/// Reads all flames of a document; I033 without any, or for malformed XML.
pub(super) fn read(reader: &mut IfsReader<'_>) -> Vec<Ifs> {
    let options = ParsingOptions { allow_dtd: false, nodes_limit: MAX_XML_NODES, ..ParsingOptions::default() };
    // Apophysis writes several flames without a root element: one is put around them, and locations are shifted back.
    let text = reader.text;
    let several = text.matches("<flame").count() > 1 && !text.contains("<flames") && !text.contains("<Flames");
    let wrapped = format!("<f>{text}</f>");
    let (source, shift) = if several { (wrapped.as_str(), 3) } else { (text, 0) };
    let document = match Document::parse_with_options(source, options) {
        Ok(document) => document,
        Err(e) => {
            let at = offset(source, e.pos()).saturating_sub(shift).min(text.len());
            let span = reader.span(at, at);
            let d = Diagnostic::error("I033", format!("not valid XML: {e}"), span, "here");
            reader.push(d.help("a flame file is XML: <flame name=\"...\"> <xform .../> ... </flame>"));
            return Vec::new();
        }
    };
    let flames = document.descendants().filter(|n| n.has_tag_name("flame"));
    let systems: Vec<Ifs> =
        flames.enumerate().filter_map(|(index, f)| FlameReader { reader, shift, index }.flame(f)).collect();
    if systems.is_empty() && !reader.report.has_errors() {
        let span = reader.span(0, 0);
        let d = Diagnostic::error("I033", "no flame in this file", span, "no <flame>");
        reader.push(d.help("a flame file is XML: <flame name=\"...\"> <xform .../> ... </flame>"));
    }
    systems
}

fn offset(text: &str, at: roxmltree::TextPos) -> usize {
    // The XML reader counts rows and columns from 1, columns in characters.
    let row = (at.row as usize).saturating_sub(1);
    let start: usize = text.split_inclusive('\n').take(row).map(str::len).sum();
    let column = (at.col as usize).saturating_sub(1);
    let rest = text.get(start..).unwrap_or_default();
    start + rest.chars().take(column).map(char::len_utf8).sum::<usize>()
}

struct FlameReader<'a, 'r> {
    reader: &'a mut IfsReader<'r>,
    /// Number of bytes that were inserted before the text.
    shift: usize,
    /// Index of the flame in the file, from 0.
    index: usize,
}

impl FlameReader<'_, '_> {
    fn span(&self, range: std::ops::Range<usize>) -> Span {
        let end = self.reader.text.len();
        let back = |v: usize| v.saturating_sub(self.shift).min(end);
        self.reader.span(back(range.start), back(range.end))
    }

    /// Location of a start tag: its `<` and its name.
    fn tag(&self, node: Node<'_, '_>) -> Span {
        let r = node.range();
        self.span(r.start..(r.start + 1 + node.tag_name().name().len()).min(r.end))
    }

    fn flame(&mut self, node: Node<'_, '_>) -> Option<Ifs> {
        let span = self.tag(node);
        let before = self.reader.report.diagnostics.len();
        for a in node.attributes().filter(|a| !FLAME_ATTRIBUTES.contains(&a.name())) {
            self.warn_unknown(&a);
        }
        // Sequences of flam3 have no names: the first flame is called after the file, others are numbered.
        let unnamed = || match self.index {
            0 => self.reader.stem.clone(),
            i => format!("{}_{}", self.reader.stem, i + 1),
        };
        let mut ifs = Ifs {
            name: node.attribute("name").map_or_else(unnamed, str::to_owned),
            dim: 2,
            maps: Vec::new(),
            chaos: None,
            last: None,
            condensation: Vec::new(),
            view: self.view(node),
            palette: self.palette(node),
            weights: Some(crate::weights::WeightRule::Raw),
            span,
        };
        let mut rows: Vec<Option<Vec<f64>>> = Vec::new();
        for child in node.children().filter(Node::is_element) {
            match child.tag_name().name() {
                "xform" => {
                    let map = self.map(child)?;
                    rows.push(self.numbers_attribute(child, "chaos"));
                    ifs.maps.push(map);
                }
                // Apophysis keeps a final transform that is switched off.
                "finalxform" if child.attribute("enabled") == Some("0") => {}
                "finalxform" => ifs.last = Some(self.map(child)?.affine),
                "color" | "palette" | "edit" | "colors" => {}
                other => self.reject_nonlinear(self.tag(child), &format!("<{other}>")),
            }
        }
        // Checks on the whole system come after its maps, with the location of the flame's tag.
        if ifs.maps.is_empty() {
            let d = Diagnostic::error("I007", format!("\"{}\" holds no maps", ifs.name), span, "no <xform>");
            self.reader.push(d.help("a map is <xform weight=\"1\" linear=\"1\" coefs=\"a c b d e f\"/>"));
        }
        if ifs.maps.len() > self.reader.max_maps() {
            let text = format!("\"{}\" has {} maps, the limit is {}", ifs.name, ifs.maps.len(), self.reader.max_maps());
            let d = Diagnostic::error("I008", text, span, "too many maps");
            self.reader.push(d.help("use fewer maps, or raise the limit with --max-maps"));
        }
        if rows.iter().any(Option::is_some) {
            let n = ifs.maps.len();
            // Chaos rows are optional: maps without one may be followed by any map.
            let full = |r: Option<Vec<f64>>| {
                let mut row = r.unwrap_or_default();
                // Missing entries at the end are 1.
                row.resize(n, 1.0);
                row
            };
            ifs.chaos = Some(rows.into_iter().map(full).collect());
        }
        let new = self.reader.report.diagnostics.iter().skip(before);
        let sound = !new.clone().any(|d| d.severity == osier_base::diagnostic::Severity::Error);
        sound.then_some(ifs)
    }

    /// Reads one map. The file's coefficients are column by column with y down: the map is conjugated by diag(1, -1)
    /// and composed with the post transform.
    fn map(&mut self, node: Node<'_, '_>) -> Option<Map> {
        let span = self.tag(node);
        for a in node.attributes() {
            let quiet = IGNORED_ATTRIBUTES.iter().any(|(n, v)| *n == a.name() && (v.is_empty() || *v == a.value()));
            if MAP_ATTRIBUTES.contains(&a.name()) || quiet {
                continue;
            }
            let zero = number(a.value()).is_ok_and(|v| v == 0.0);
            if zero {
                continue;
            }
            let place = self.span(a.range());
            self.reject_nonlinear(place, a.name());
        }
        let coefs = self.affine_attribute(node, "coefs", [1.0, 0.0, 0.0, 1.0, 0.0, 0.0]);
        let post = self.affine_attribute(node, "post", [1.0, 0.0, 0.0, 1.0, 0.0, 0.0]);
        // The variation "linear" scales the map; it is 1 where the file does not state it.
        let mut amount = self.number_attribute(node, "linear", 0.0) + self.number_attribute(node, "linear3D", 0.0);
        if node.attribute("linear").is_none() && node.attribute("linear3D").is_none() {
            amount = 1.0;
        }
        let scaled = Affine { a: coefs.a * amount, b: coefs.b * amount };
        // Flames have y down: w' = F w F with F = diag(1, -1).
        let flip = DVec3::new(1.0, -1.0, 1.0);
        let weight = self.number_attribute(node, "weight", 0.0);
        let mut map = Map::new(post.after(&scaled).conjugated(flip, DVec3::ZERO), Some(weight), span);
        map.coord = self.number_attribute(node, "color", 0.0).clamp(0.0, 1.0);
        // Older files state the speed of the colour as symmetry = 1 - 2 speed.
        let speed = match node.attribute("symmetry") {
            Some(_) if node.attribute("color_speed").is_none() => {
                (1.0 - self.number_attribute(node, "symmetry", 0.0)) * 0.5
            }
            _ => self.number_attribute(node, "color_speed", 0.5),
        };
        // Beyond 0 to 1 a colour coordinate would leave the palette.
        map.speed = speed.clamp(0.0, 1.0);
        let opacity = self.number_attribute(node, "opacity", 1.0).clamp(0.0, 1.0);
        map.opacity = if node.attribute("plotmode") == Some("off") { 0.0 } else { opacity };
        Some(map)
    }

    /// Reads an affine map, `a d b e c f` in the file, where x' = a x + b y + c, y' = d x + e y + f.
    fn affine_attribute(&mut self, node: Node<'_, '_>, name: &str, fallback: [f64; 6]) -> Affine {
        let c = match self.numbers_attribute(node, name) {
            Some(v) if v.len() == 6 => std::array::from_fn(|i| v.get(i).copied().unwrap_or(0.0)),
            Some(v) => {
                let text = format!("{name} has {} numbers", v.len());
                let span = self.attribute_span(node, name);
                let d = Diagnostic::error("I007", text, span, "six are needed");
                self.reader.push(d.help("columns of the matrix, then the shift"));
                fallback
            }
            None => fallback,
        };
        Affine::plane([c[0], c[2], c[1], c[3], c[4], c[5]])
    }

    fn attribute_span(&self, node: Node<'_, '_>, name: &str) -> Span {
        let range = node.attribute_node(name).map(|a| a.range());
        range.map_or_else(|| self.tag(node), |r| self.span(r))
    }

    fn numbers_attribute(&mut self, node: Node<'_, '_>, name: &str) -> Option<Vec<f64>> {
        let words: Vec<&str> = node.attribute(name)?.split_whitespace().collect();
        let mut out = Vec::with_capacity(words.len());
        for word in words {
            match number(word) {
                Ok(v) if v.abs() <= MAX_COEFFICIENT => out.push(v),
                _ => {
                    let span = self.attribute_span(node, name);
                    let text = format!("\"{}\" is not a finite number", word.chars().take(64).collect::<String>());
                    let d = Diagnostic::error("I005", text, span, format!("in {name}"));
                    self.reader.push(d.help("write finite decimals of at most 1e12, separated by blanks"));
                    return None;
                }
            }
        }
        Some(out)
    }

    fn number_attribute(&mut self, node: Node<'_, '_>, name: &str, fallback: f64) -> f64 {
        self.numbers_attribute(node, name).and_then(|v| v.first().copied()).unwrap_or(fallback)
    }

    fn reject_nonlinear(&mut self, span: Span, what: &str) {
        let d = Diagnostic::error("I030", format!("{what} is not an affine map"), span, "not supported");
        self.reader.push(d.help("only linear maps with post transforms are read; remove this variation"));
    }

    fn warn_unknown(&mut self, a: &Attribute<'_, '_>) {
        let text = format!("unknown attribute \"{}\"", a.name());
        let known = self.reader.report.diagnostics.iter().any(|d| d.code == "I031" && d.message == text);
        if !known {
            let span = self.span(a.range());
            self.reader.push(Diagnostic::warning("I031", text, span, "ignored").help("it does not change the maps"));
        }
    }

    /// Size and scale of the picture: `scale` pixels per unit, doubled by each step of `zoom`.
    fn view(&mut self, node: Node<'_, '_>) -> Option<PictureView> {
        let size = self.numbers_attribute(node, "size").filter(|s| s.len() == 2 && s[0] >= 1.0 && s[1] >= 1.0)?;
        let scale = self.number_attribute(node, "scale", 50.0)
            * osier_base::math::pow(2.0, self.number_attribute(node, "zoom", 0.0).clamp(-60.0, 60.0));
        let center = self.numbers_attribute(node, "center").filter(|c| c.len() == 2).unwrap_or_else(|| vec![0.0, 0.0]);
        let background =
            self.numbers_attribute(node, "background").filter(|c| c.len() == 3).unwrap_or_else(|| vec![0.0; 3]);
        let linear =
            |i: usize| units::linear_from_srgb(osier_base::math::narrow(background.get(i).copied().unwrap_or(0.0)));
        (scale > 0.0).then(|| PictureView {
            center: [center[0], -center[1]],
            width: size[0] / scale,
            rotate: units::radians(self.number_attribute(node, "rotate", 0.0)),
            aspect: size[0] / size[1],
            background: [linear(0), linear(1), linear(2)],
        })
    }

    fn palette(&mut self, node: Node<'_, '_>) -> Vec<[f32; 3]> {
        // Palettes are stored in sRGB; colours are averaged in linear light.
        let linear = |v: f64| units::linear_from_srgb(osier_base::math::narrow((v / 255.0).clamp(0.0, 1.0)));
        let mut out: Vec<(f64, [f32; 3])> = Vec::new();
        for child in node.children().filter(|c| c.has_tag_name("color")) {
            let index = self.number_attribute(child, "index", 0.0);
            if let Some(rgb) = self.numbers_attribute(child, "rgb").filter(|v| v.len() >= 3) {
                out.push((index, [linear(rgb[0]), linear(rgb[1]), linear(rgb[2])]));
            }
        }
        out.sort_by(|a, b| a.0.total_cmp(&b.0));
        let bytes = |text: &str| -> Vec<u8> {
            let digits: Vec<u8> = text.bytes().filter(u8::is_ascii_hexdigit).collect();
            let byte = |c: &[u8]| std::str::from_utf8(c).ok().and_then(|t| u8::from_str_radix(t, 16).ok()).unwrap_or(0);
            digits.chunks_exact(2).map(byte).collect()
        };
        let color = |c: &[u8]| [linear(c[0].into()), linear(c[1].into()), linear(c[2].into())];
        // Older versions of Apophysis write 00RRGGBB per colour.
        let data = node.children().find(|c| c.has_tag_name("colors")).and_then(|c| c.attribute("data"));
        if let Some(data) = data {
            out = bytes(data).chunks_exact(4).map(|c| (0.0, color(&c[1..]))).collect();
        }
        if let Some(p) = node.children().find(|c| c.has_tag_name("palette")) {
            let skip = usize::from(p.attribute("format") == Some("RGBA"));
            out = bytes(p.text().unwrap_or_default()).chunks_exact(3 + skip).map(|c| (0.0, color(c))).collect();
        }
        out.into_iter().take(65_536).map(|c| c.1).collect()
    }
}
