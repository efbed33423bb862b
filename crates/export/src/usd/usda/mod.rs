//! Text layers (`.usda`): the wrapper, and single files that a person is meant to edit. The text is held in memory until the
//! end, so its size is limited; animation belongs into crate files.

mod text;

use std::collections::BTreeMap;

use super::byte_sink::ByteSink;
use super::layer_writer::{
    AttrHandle, AttrSpec, LayerMetadata, LayerWriter, PrimMetadata, split_prim_path, split_property_path, variant_path,
};
use super::value::UsdValue;
use osier_base::{Error, Result};

/// Largest text layer, bytes; a larger one is an error (X004).
const MAX_TEXT_BYTES: usize = 10_000_000;

/// Writes a layer as text, in one piece when it is finished.
pub struct UsdaWriter {
    sink: Option<Box<dyn ByteSink>>,
    /// Text of the layer metadata.
    head: String,
    /// All prims; the first is the pseudo-root.
    prims: Vec<TextPrim>,
    /// Index into `prims` by path; paths of variants are included.
    index: BTreeMap<String, usize>,
    attrs: Vec<PropertyIndex>,
    /// Estimated length of the text so far.
    bytes: usize,
}

/// Where an attribute is held: indices of the prim and of its property.
#[derive(Debug, Clone, Copy)]
struct PropertyIndex {
    prim: usize,
    property: usize,
}

/// A prim as the pieces of its text.
#[derive(Debug)]
struct TextPrim {
    /// `def Xform "name"` and its metadata.
    head: String,
    properties: Vec<TextProperty>,
    children: Vec<usize>,
    variants: Option<TextVariantSet>,
}

/// A variant set as the pieces of its text.
#[derive(Debug)]
struct TextVariantSet {
    set: &'static str,
    /// Indices of one entry of the prims for each variant; its head is the variant's name.
    variants: Vec<usize>,
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
    /// ` (interpolation = "vertex")`, or empty.
    metadata: String,
    /// Time codes and value texts.
    samples: Vec<(f64, String)>,
    /// Complete lines that follow: a connection, or the whole of a relationship.
    lines: Vec<String>,
}

impl UsdaWriter {
    /// Starts an empty layer, whose text goes into `sink` at the end.
    pub(super) fn new(sink: Box<dyn ByteSink>) -> Self {
        // The pseudo-root is not written as a block; its children are the top-level prims.
        let root = TextPrim::new(String::new());
        let index = [("/".to_owned(), 0)].into();
        Self { sink: Some(sink), head: String::new(), prims: vec![root], index, attrs: Vec::new(), bytes: 0 }
    }

    /// Adds to the length of the text; X004 if it exceeds the limit.
    fn add_bytes_within_limit(&mut self, bytes: usize) -> Result<()> {
        self.bytes += bytes;
        if self.bytes <= MAX_TEXT_BYTES {
            return Ok(());
        }
        Err(Error::export(
            "X004",
            format!("the text layer exceeds {MAX_TEXT_BYTES} bytes; write usdc, or name the file .usdc or .usdz"),
        ))
    }

    fn add_property(&mut self, path: &str, property: TextProperty) -> Result<PropertyIndex> {
        self.add_bytes_within_limit(
            property.declaration.len() + property.lines.iter().map(String::len).sum::<usize>() + 16,
        )?;
        let prim = self.index.get(split_property_path(path).0).copied().unwrap_or(0);
        let Some(p) = self.prims.get_mut(prim) else { return Ok(PropertyIndex { prim: 0, property: 0 }) };
        p.properties.push(property);
        Ok(PropertyIndex { prim, property: p.properties.len() - 1 })
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
        if let Some(TextVariantSet { set, variants }) = &prim.variants {
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
    // An attribute without a value is only declared, unless a connection below declares it.
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
    fn begin(&mut self, meta: &LayerMetadata) -> Result<()> {
        self.head = text::layer_header(meta);
        Ok(())
    }

    fn define_prim(&mut self, path: &str, type_name: &'static str, meta: &PrimMetadata) -> Result<()> {
        let (parent, name) = split_prim_path(path);
        let head = text::prim_header(type_name, name, meta);
        self.add_bytes_within_limit(head.len() + 16)?;
        let number = self.prims.len();
        self.prims.push(TextPrim::new(head));
        self.index.insert(path.to_owned(), number);
        // Each variant is a separate entry, found by the path below which its prims will be defined.
        if let Some(variants) = &meta.variants {
            let first = self.prims.len();
            for (name, i) in variants.names.iter().zip(first..) {
                self.prims.push(TextPrim::new(format!("\"{name}\"")));
                self.index.insert(variant_path(path, variants.set, name), i);
            }
            let all = (first..self.prims.len()).collect();
            if let Some(p) = self.prims.get_mut(number) {
                p.variants = Some(TextVariantSet { set: variants.set, variants: all });
            }
        }
        // Parents are defined before their children; a prim without a parent belongs to the pseudo-root.
        let parent = self.index.get(parent).copied().unwrap_or(0);
        if let Some(p) = self.prims.get_mut(parent) {
            p.children.push(number);
        }
        Ok(())
    }

    fn create_attr(&mut self, path: &str, spec: &AttrSpec, default: Option<UsdValue>) -> Result<AttrHandle> {
        // `custom uniform token[] name`; the value, samples and metadata follow when the text is rendered.
        let name = split_property_path(path).1;
        let custom = if spec.custom { "custom " } else { "" };
        let uniform = if spec.uniform { "uniform " } else { "" };
        let declaration = format!("{custom}{uniform}{} {name}", spec.type_name);
        let default = default.map(|v| text::value(&v, path)).transpose()?;
        self.add_bytes_within_limit(default.as_ref().map_or(0, String::len))?;
        let lines = spec.connection.iter().map(|source| format!("{declaration}.connect = <{source}>")).collect();
        let metadata = text::attr_metadata_text(spec);
        let property =
            TextProperty { path: path.to_owned(), declaration, default, metadata, samples: Vec::new(), lines };
        let added = self.add_property(path, property)?;
        self.attrs.push(added);
        Ok(AttrHandle(self.attrs.len() - 1))
    }

    fn set_default(&mut self, attr: AttrHandle, value: UsdValue) -> Result<()> {
        let Some(PropertyIndex { prim, property }) = self.attrs.get(attr.0).copied() else { return Ok(()) };
        let Some(p) = self.prims.get_mut(prim).and_then(|p| p.properties.get_mut(property)) else { return Ok(()) };
        let text = text::value(&value, &p.path)?;
        let bytes = text.len();
        p.default = Some(text);
        self.add_bytes_within_limit(bytes)
    }

    fn set_time_sample(&mut self, attr: AttrHandle, time: f64, value: UsdValue) -> Result<()> {
        let Some(PropertyIndex { prim, property }) = self.attrs.get(attr.0).copied() else { return Ok(()) };
        let Some(p) = self.prims.get_mut(prim).and_then(|p| p.properties.get_mut(property)) else { return Ok(()) };
        let sample = text::value(&value, &format!("{}, frame {time}", p.path))?;
        let bytes = sample.len() + 8;
        p.samples.push((time, sample));
        self.add_bytes_within_limit(bytes + 16)
    }

    fn repeat_clip_once(&mut self, period: f64) {
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
