//! Text stages: wrappers, and whatever a person is meant to edit. Everything is held until the end, so the size is
//! limited; what is sampled belongs into crate files.

mod text;

use std::collections::BTreeMap;

use super::byte_sink::ByteSink;
use super::layer_writer::{
    AttrHandle, AttrSpec, LayerMeta, LayerWriter, PrimMeta, split_prim_path, split_property_path, variant_path,
};
use super::value::UsdValue;
use osier_base::{Error, Result};

/// Largest text, bytes.
const MAX_TEXT_BYTES: usize = 10_000_000;

/// A text stage being written.
pub struct UsdaWriter {
    sink: Option<Box<dyn ByteSink>>,
    head: String,
    prims: Vec<TextPrim>,
    index: BTreeMap<String, usize>,
    /// TextPrim and property of each attribute.
    attrs: Vec<(usize, usize)>,
    bytes: usize,
}

#[derive(Debug)]
struct TextPrim {
    /// `def Xform "name"` and its metadata.
    head: String,
    properties: Vec<TextProperty>,
    children: Vec<usize>,
    /// Name of its variant set, and prims that stand for the variants, their heads the names.
    variants: Option<(&'static str, Vec<usize>)>,
}

impl TextPrim {
    fn new(head: String) -> Self {
        Self { head, properties: Vec::new(), children: Vec::new(), variants: None }
    }
}

/// A property as the pieces of its text.
#[derive(Debug)]
struct TextProperty {
    path: String,
    /// `uniform token[] name`; empty for a relationship, whose text is all in `lines`.
    declaration: String,
    default: Option<String>,
    metadata: String,
    /// `time: value`.
    samples: Vec<(f64, String)>,
    /// Whole further lines.
    lines: Vec<String>,
}

impl UsdaWriter {
    /// A text that goes into `sink`.
    pub(super) fn new(sink: Box<dyn ByteSink>) -> Self {
        let root = TextPrim::new(String::new());
        let index = [("/".to_owned(), 0)].into();
        Self { sink: Some(sink), head: String::new(), prims: vec![root], index, attrs: Vec::new(), bytes: 0 }
    }

    /// Counts text before it is kept.
    fn count_bytes(&mut self, bytes: usize) -> Result<()> {
        self.bytes += bytes;
        if self.bytes <= MAX_TEXT_BYTES {
            return Ok(());
        }
        Err(Error::export(
            "X004",
            format!("usda would pass {MAX_TEXT_BYTES} bytes; write usdc, or name the file .usdc or .usdz"),
        ))
    }

    fn add_property(&mut self, path: &str, property: TextProperty) -> Result<(usize, usize)> {
        self.count_bytes(property.declaration.len() + property.lines.iter().map(String::len).sum::<usize>() + 16)?;
        let prim = self.index.get(split_property_path(path).0).copied().unwrap_or(0);
        let Some(p) = self.prims.get_mut(prim) else { return Ok((0, 0)) };
        p.properties.push(property);
        Ok((prim, p.properties.len() - 1))
    }

    fn render(&self) -> String {
        let mut out = self.head.clone();
        out.reserve(self.bytes);
        if let Some(root) = self.prims.first() {
            for child in &root.children {
                out.push('\n');
                self.render_prim(*child, 0, &mut out);
            }
        }
        out
    }

    fn render_prim(&self, prim: usize, depth: usize, out: &mut String) {
        let Some(prim) = self.prims.get(prim) else { return };
        text::push_indented(&prim.head, depth, out);
        text::push_indented("{", depth, out);
        for p in &prim.properties {
            render_property(p, depth + 1, out);
        }
        if let Some((set, variants)) = &prim.variants {
            text::push_indented(&format!("variantSet \"{set}\" = {{"), depth + 1, out);
            variants.iter().for_each(|v| self.render_prim(*v, depth + 2, out));
            text::push_indented("}", depth + 1, out);
        }
        for (i, child) in prim.children.iter().enumerate() {
            if i > 0 || !prim.properties.is_empty() {
                out.push('\n');
            }
            self.render_prim(*child, depth + 1, out);
        }
        text::push_indented("}", depth, out);
    }
}

fn render_property(p: &TextProperty, depth: usize, out: &mut String) {
    if let Some(value) = &p.default {
        text::push_indented(&format!("{} = {value}{}", p.declaration, p.metadata), depth, out);
    } else if !p.declaration.is_empty() && p.lines.is_empty() {
        text::push_indented(&format!("{}{}", p.declaration, p.metadata), depth, out);
    }
    if !p.samples.is_empty() {
        text::push_indented(&format!("{}.timeSamples = {{", p.declaration), depth, out);
        for (t, s) in &p.samples {
            text::push_indented(&format!("{t}: {s},"), depth + 1, out);
        }
        text::push_indented("}", depth, out);
    }
    for line in &p.lines {
        text::push_indented(line, depth, out);
    }
}

impl LayerWriter for UsdaWriter {
    fn begin(&mut self, meta: &LayerMeta) -> Result<()> {
        self.head = text::layer_header(meta);
        Ok(())
    }

    fn define_prim(&mut self, path: &str, type_name: &'static str, meta: &PrimMeta) -> Result<()> {
        let (parent, name) = split_prim_path(path);
        let head = text::prim_header(type_name, name, meta);
        self.count_bytes(head.len() + 16)?;
        let number = self.prims.len();
        self.prims.push(TextPrim::new(head));
        self.index.insert(path.to_owned(), number);
        if let Some(variants) = &meta.variants {
            let first = self.prims.len();
            for (name, i) in variants.names.iter().zip(first..) {
                self.prims.push(TextPrim::new(format!("\"{name}\"")));
                self.index.insert(variant_path(path, variants.set, name), i);
            }
            let all = (first..self.prims.len()).collect();
            if let Some(p) = self.prims.get_mut(number) {
                p.variants = Some((variants.set, all));
            }
        }
        let parent = self.index.get(parent).copied().unwrap_or(0);
        if let Some(p) = self.prims.get_mut(parent) {
            p.children.push(number);
        }
        Ok(())
    }

    fn create_attr(&mut self, path: &str, spec: &AttrSpec, default: Option<UsdValue>) -> Result<AttrHandle> {
        let name = split_property_path(path).1;
        let custom = if spec.custom { "custom " } else { "" };
        let uniform = if spec.uniform { "uniform " } else { "" };
        let declaration = format!("{custom}{uniform}{} {name}", spec.type_name);
        let default = default.map(|v| text::value(&v, path)).transpose()?;
        self.count_bytes(default.as_ref().map_or(0, String::len))?;
        let lines = spec.connection.iter().map(|source| format!("{declaration}.connect = <{source}>")).collect();
        let metadata = text::attr_metadata(spec);
        let property =
            TextProperty { path: path.to_owned(), declaration, default, metadata, samples: Vec::new(), lines };
        let place = self.add_property(path, property)?;
        self.attrs.push(place);
        Ok(AttrHandle(self.attrs.len() - 1))
    }

    fn set_time_sample(&mut self, attr: AttrHandle, time: f64, value: UsdValue) -> Result<()> {
        let Some((prim, property)) = self.attrs.get(attr.0).copied() else { return Ok(()) };
        let Some(p) = self.prims.get_mut(prim).and_then(|p| p.properties.get_mut(property)) else { return Ok(()) };
        let sample = text::value(&value, &format!("{}, frame {time}", p.path))?;
        let bytes = sample.len() + 8;
        p.samples.push((time, sample));
        self.count_bytes(bytes + 16)
    }

    fn repeat_samples(&mut self, period: f64) {
        for p in self.prims.iter_mut().flat_map(|p| &mut p.properties) {
            let again: Vec<_> = p.samples.iter().map(|(t, v)| (t + period, v.clone())).collect();
            p.samples.extend(again);
        }
    }

    fn create_relationship(&mut self, path: &str, targets: &[String]) -> Result<()> {
        let name = split_property_path(path).1;
        let quoted: Vec<String> = targets.iter().map(|t| format!("<{t}>")).collect();
        let value = match quoted.as_slice() {
            [one] => one.clone(),
            all => format!("[{}]", all.join(", ")),
        };
        let property = TextProperty {
            path: path.to_owned(),
            declaration: String::new(),
            default: None,
            metadata: String::new(),
            samples: Vec::new(),
            lines: vec![format!("rel {name} = {value}")],
        };
        self.add_property(path, property).map(|_| ())
    }

    fn finish(&mut self) -> Result<()> {
        let text = self.render();
        if let Some(mut sink) = self.sink.take() {
            sink.put(text.as_bytes())?;
            sink.commit()?;
        }
        Ok(())
    }
}
