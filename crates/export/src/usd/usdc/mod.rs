//! Crate files (`.usdc`), written as a stream: arrays go to disk when they arrive, the structural sections follow at
//! the end. Memory holds only the tables, and 8 bytes for each time sample. Version 0.8.0, little endian.
//!
//! Layout of a file: header of 88 bytes (magic, version, offset of the table of contents, reserved), the values, the sections,
//! the table of contents (number of sections; for each a name of 16 bytes, its offset and its length).
//! Source: `pxr/usd/sdf/crateFile.h` and `.cpp` of OpenUSD.

mod integer_coding;
mod sections;
mod value_heap;

use sections::{Interner, PathTable, SpecEntry, SpecType};
use value_heap::{ValueHeap, inline_value_rep, type_code};

use super::byte_sink::ByteSink;
use super::layer_writer::{
    AttrHandle, AttrSpec, CompositionArc, LayerMetadata, LayerWriter, PrimMetadata, VariantSet, split_prim_path,
    split_property_path, variant_path,
};
use super::value::{UsdArray, UsdValue};
use osier_base::Result;

const HEADER_BYTES: usize = 88;
const MAGIC: &[u8; 8] = b"PXR-USDC";
const VERSION: [u8; 8] = [0, 8, 0, 0, 0, 0, 0, 0];

/// Writes a layer as a crate file; values go to the file when they arrive.
pub struct UsdcWriter {
    heap: ValueHeap,
    tokens: Interner,
    strings: Interner,
    paths: PathTable,
    specs: Vec<SpecEntry>,
    /// Names of the children and properties of each prim, by the index of the prim's spec.
    members: std::collections::BTreeMap<usize, ChildNames>,
    /// Index of each prim's spec, by path.
    prim_specs: std::collections::BTreeMap<String, usize>,
    attrs: Vec<TimeSamples>,
    /// All times that any sample has, in order of arrival.
    times: Vec<f64>,
    /// Time codes after which all samples repeat once.
    repeat_period: Option<f64>,
}

/// Tokens of the fields `primChildren` and `properties` of a prim, in order of definition.
#[derive(Debug, Default)]
struct ChildNames {
    children: Vec<u32>,
    properties: Vec<u32>,
}

/// The time samples of an attribute, whose values are in the file already.
#[derive(Debug)]
struct TimeSamples {
    spec: usize,
    /// Path of the attribute, for errors.
    path: String,
    /// `ValueRep` of each sample.
    values: Vec<u64>,
    times: SampleTimes,
}

/// Times of the samples of an attribute, as indices into the times of the whole file.
#[derive(Debug)]
enum SampleTimes {
    /// A run of the list that begins at this index: the common case, which takes no memory per sample.
    Consecutive(usize),
    /// One index per sample.
    Indices(Vec<usize>),
}

impl UsdcWriter {
    /// Starts a crate file in `sink`; the pseudo-root is its first spec.
    pub(crate) fn new(sink: Box<dyn ByteSink>) -> Self {
        let mut tokens = Interner::default();
        // PATHS marks a property by the negated number of its name. Since 0 cannot be negated, number 0 is given to a
        // token that is no name. The writer of OpenUSD uses the same token.
        tokens.intern(";-)");
        let mut paths = PathTable::default();
        paths.intern("/");
        let root = SpecEntry { path: 0, spec_type: SpecType::PseudoRoot, fields: Vec::new() };
        Self {
            heap: ValueHeap::new(sink),
            tokens,
            strings: Interner::default(),
            paths,
            specs: vec![root],
            members: [(0, ChildNames::default())].into(),
            prim_specs: [("/".to_owned(), 0)].into(),
            attrs: Vec::new(),
            times: Vec::new(),
            repeat_period: None,
        }
    }

    /// Row of a string in STRINGS. Its text is a token, too.
    fn intern_string(&mut self, text: &str) -> u32 {
        self.tokens.intern(text);
        self.strings.intern(text)
    }

    fn token_rep(&mut self, text: &str) -> u64 {
        inline_value_rep(type_code::TOKEN, self.tokens.intern(text))
    }

    /// Adds a field to a spec. `value`: a `ValueRep`.
    fn set_field(&mut self, spec: usize, name: &str, value: u64) {
        let name = self.tokens.intern(name);
        if let Some(spec) = self.specs.get_mut(spec) {
            spec.fields.push((name, value));
        }
    }

    /// `ValueRep` of any value; interns the tokens and strings in it. `place`: names the attribute in errors.
    fn value_rep(&mut self, value: &UsdValue, place: &dyn Fn() -> String) -> Result<u64> {
        let index = match value {
            UsdValue::Token(t) | UsdValue::Asset(t) => self.tokens.intern(t),
            UsdValue::String(t) => self.intern_string(t),
            UsdValue::Array(array @ UsdArray::Token(list)) => {
                let tokens: Vec<u32> = list.iter().map(|t| self.tokens.intern(t)).collect();
                return self.heap.array_value_rep(array, &tokens, place);
            }
            _ => 0,
        };
        self.heap.scalar_value_rep(value, index, place)
    }

    /// Adds a spec for a prim or property path, and its name to its parent's list. Returns the index of the spec.
    fn add_spec(&mut self, path: &str, spec_type: SpecType) -> usize {
        let number = self.specs.len();
        let is_prim = spec_type == SpecType::Prim;
        let (parent, name) = if is_prim { split_prim_path(path) } else { split_property_path(path) };
        let token = self.tokens.intern(name);
        if let Some(members) = self.prim_specs.get(parent).and_then(|p| self.members.get_mut(p)) {
            // Children and properties are separate lists of names, in the order in which they were defined.
            if is_prim { members.children.push(token) } else { members.properties.push(token) }
        }
        let path = self.paths.intern(path);
        self.specs.push(SpecEntry { path, spec_type, fields: Vec::new() });
        number
    }

    /// `SdfListOp`: a byte of flags ([`EXPLICIT_LIST`] or [`PREPENDED`]), the number of items, the encoded items.
    fn list_op_rep(&mut self, code: u8, flags: u8, items: &[Vec<u8>]) -> Result<u64> {
        let mut bytes = vec![flags];
        bytes.extend((items.len() as u64).to_le_bytes());
        bytes.extend(items.iter().flatten());
        self.heap.store_scalar(code, &bytes)
    }

    /// An explicit `SdfPathListOp`: targets of a relationship, or sources of a connection.
    fn path_list_op_rep(&mut self, targets: &[String]) -> Result<u64> {
        let items: Vec<Vec<u8>> = targets.iter().map(|t| self.paths.intern(t).to_le_bytes().to_vec()).collect();
        self.list_op_rep(type_code::PATH_LIST_OP, EXPLICIT_LIST, &items)
    }

    /// `SdfPayload`, and the first part of `SdfReference`: string index of the layer, path index of the prim, layer offset
    /// (negative, so that the layer is read `phase` frames ahead), layer scale 1.
    fn layer_arc_bytes(&mut self, arc: &CompositionArc) -> Vec<u8> {
        let mut item = self.intern_string(&arc.asset).to_le_bytes().to_vec();
        item.extend(self.paths.intern(&arc.prim).to_le_bytes());
        // 0 - phase instead of -phase: the phase 0 gives +0.
        item.extend((0.0 - f64::from(arc.phase)).to_le_bytes());
        item.extend(1.0_f64.to_le_bytes());
        item
    }

    /// `VtDictionary`: number of entries; for each the string index of the key, the distance to the value's `ValueRep` (8: it
    /// follows at once), the `ValueRep`.
    fn dictionary_rep(&mut self, entries: &[(&str, u64)]) -> Result<u64> {
        let mut bytes = (entries.len() as u64).to_le_bytes().to_vec();
        for (key, value) in entries {
            bytes.extend(self.intern_string(key).to_le_bytes());
            bytes.extend(8_i64.to_le_bytes());
            bytes.extend(value.to_le_bytes());
        }
        self.heap.store_scalar(type_code::DICTIONARY, &bytes)
    }

    /// `TfTokenVector`: number of tokens, then their token indices.
    fn token_vector_rep(&mut self, tokens: &[u32]) -> Result<u64> {
        let mut bytes = (tokens.len() as u64).to_le_bytes().to_vec();
        bytes.extend(tokens.iter().flat_map(|t| t.to_le_bytes()));
        self.heap.store_scalar(type_code::TOKEN_VECTOR, &bytes)
    }

    /// Adds a variant set to a prim: fields with its name and selection, a spec for the set, and one for each variant, below
    /// which prims can be defined.
    fn add_variant_set(&mut self, path: &str, spec: usize, variants: &VariantSet) -> Result<()> {
        let set = self.intern_string(variants.set).to_le_bytes().to_vec();
        let names = self.list_op_rep(type_code::STRING_LIST_OP, PREPENDED, std::slice::from_ref(&set))?;
        self.set_field(spec, "variantSetNames", names);
        // `SdfVariantSelectionMap`: number of entries, then string indices of set and selection.
        let mut map = 1_u64.to_le_bytes().to_vec();
        map.extend(set);
        map.extend(self.intern_string(&variants.selection).to_le_bytes());
        let selection = self.heap.store_scalar(type_code::VARIANT_SELECTION_MAP, &map)?;
        self.set_field(spec, "variantSelection", selection);
        let token = self.tokens.intern(variants.set);
        let children = self.token_vector_rep(&[token])?;
        self.set_field(spec, "variantSetChildren", children);
        // The set is the path `prim{set=}`, a variant `prim{set=name}`; a variant has the specifier `over`.
        let set_path = self.paths.intern(&variant_path(path, variants.set, ""));
        let tokens: Vec<u32> = variants.names.iter().map(|n| self.tokens.intern(n)).collect();
        let children = self.token_vector_rep(&tokens)?;
        let name = self.tokens.intern("variantChildren");
        self.specs.push(SpecEntry { path: set_path, spec_type: SpecType::VariantSet, fields: vec![(name, children)] });
        for name in &variants.names {
            let path = variant_path(path, variants.set, name);
            let number = self.specs.len();
            let interned = self.paths.intern(&path);
            self.specs.push(SpecEntry { path: interned, spec_type: SpecType::Variant, fields: Vec::new() });
            self.set_field(number, "specifier", inline_value_rep(type_code::SPECIFIER, 1));
            self.prim_specs.insert(path, number);
            self.members.insert(number, ChildNames::default());
        }
        Ok(())
    }

    /// Appends the times and the `ValueRep`s of an attribute's samples, and sets its field `timeSamples`.
    fn write_time_samples(&mut self, samples: &TimeSamples) -> Result<()> {
        let time = |i: usize| self.times.get(i).copied().unwrap_or(0.0);
        let mut times: Vec<f64> = match &samples.times {
            SampleTimes::Consecutive(first) => (0..samples.values.len()).map(|i| time(first + i)).collect(),
            SampleTimes::Indices(list) => list.iter().map(|i| time(*i)).collect(),
        };
        let mut values = samples.values.clone();
        if let Some(period) = self.repeat_period {
            // A repeated sample refers to the value of the first one: it costs 8 bytes for the time and 8 for the `ValueRep`.
            times.extend(times.clone().iter().map(|t| t + period));
            values.extend_from_slice(&samples.values);
        }
        let mut bytes = (times.len() as u64).to_le_bytes().to_vec();
        bytes.extend(times.iter().flat_map(|t| t.to_le_bytes()));
        let times = self.heap.store_scalar(type_code::DOUBLE_VECTOR, &bytes)?;
        // `TimeSamples`: distance to the `ValueRep` of the times (8: it follows at once), that `ValueRep`, distance to the
        // values, their number, their `ValueRep`s. Attributes of equal times share one list of times.
        let mut bytes = 8_i64.to_le_bytes().to_vec();
        bytes.extend(times.to_le_bytes());
        bytes.extend(8_i64.to_le_bytes());
        bytes.extend((values.len() as u64).to_le_bytes());
        bytes.extend(values.iter().flat_map(|v| v.to_le_bytes()));
        let value = self.heap.store_scalar(type_code::TIME_SAMPLES, &bytes)?;
        self.set_field(samples.spec, "timeSamples", value);
        Ok(())
    }

    /// Index of a time in the common list. The search runs backwards, as most samples are of the latest time.
    fn intern_time(&mut self, time: f64) -> usize {
        match self.times.iter().rposition(|t| t.to_bits() == time.to_bits()) {
            Some(i) => i,
            None => {
                self.times.push(time);
                self.times.len() - 1
            }
        }
    }

    /// Appends the sections and the table of contents, and rewrites the header.
    fn write_sections(&mut self) -> Result<()> {
        // PATHS and STRINGS may add tokens, so TOKENS is encoded after them.
        let mut tokens = std::mem::take(&mut self.tokens);
        let paths = self.paths.paths_section(&mut |t| tokens.intern(t))?;
        let strings: Vec<u32> = self.strings.list().iter().map(|s| tokens.intern(s)).collect();
        let [fields, sets, specs] = sections::spec_sections(&self.specs)?;
        tokens.check_row_count("tokens of a crate file")?;
        let sections = [
            ("TOKENS", sections::tokens_section(tokens.list())),
            ("STRINGS", sections::strings_section(&strings)),
            ("FIELDS", fields),
            ("FIELDSETS", sets),
            ("PATHS", paths),
            ("SPECS", specs),
        ];
        let sink = &mut self.heap.sink;
        let mut table = (sections.len() as u64).to_le_bytes().to_vec();
        for (name, bytes) in &sections {
            let mut padded = [0; 16];
            // Names of sections have at most 10 characters; the rest of the field stays 0.
            padded[..name.len()].copy_from_slice(name.as_bytes());
            table.extend(padded);
            table.extend(sink.position().to_le_bytes());
            table.extend((bytes.len() as u64).to_le_bytes());
            sink.put(bytes)?;
        }
        let table_offset = sink.position();
        sink.put(&table)?;
        let mut header = [0; HEADER_BYTES];
        header[..8].copy_from_slice(MAGIC);
        header[8..16].copy_from_slice(&VERSION);
        header[16..24].copy_from_slice(&table_offset.to_le_bytes());
        // The header was written as zeros: a file that was cut off has no magic and is refused.
        sink.put_at(0, &header)
    }
}

/// `SdfListOp` flags: the list is explicit and has explicit items.
const EXPLICIT_LIST: u8 = 0x03;
/// `SdfListOp` flag: the list has prepended items.
const PREPENDED: u8 = 0x20;

impl LayerWriter for UsdcWriter {
    fn begin(&mut self, meta: &LayerMetadata) -> Result<()> {
        self.heap.sink.put(&[0; HEADER_BYTES])?;
        // No section refers to these bytes: they let `strings` or a hex dump name the program that wrote the file.
        self.heap.sink.put(crate::GENERATOR.as_bytes())?;
        self.heap.sink.put(&[0])?;
        let mut strings = Vec::new();
        for (key, text) in meta.custom_layer_data() {
            strings.push((key, inline_value_rep(type_code::STRING, self.intern_string(text))));
        }
        let osier = self.dictionary_rep(&strings)?;
        let custom = self.dictionary_rep(&[("osier", osier)])?;
        // Layer metadata are fields of the pseudo-root, which is spec 0.
        self.set_field(0, "customLayerData", custom);
        let tokens = [("defaultPrim", meta.default_prim.as_str()), ("upAxis", meta.up.token())];
        for (name, text) in tokens {
            let value = self.token_rep(text);
            self.set_field(0, name, value);
        }
        let numbers = [
            ("endTimeCode", meta.end),
            ("framesPerSecond", meta.fps),
            ("metersPerUnit", 1.0),
            ("startTimeCode", meta.start),
            ("timeCodesPerSecond", meta.fps),
        ];
        for (name, number) in numbers {
            let value = self.value_rep(&UsdValue::Double(number), &|| name.to_owned())?;
            self.set_field(0, name, value);
        }
        Ok(())
    }

    fn define_prim(&mut self, path: &str, type_name: &'static str, meta: &PrimMetadata) -> Result<()> {
        let spec = self.add_spec(path, SpecType::Prim);
        self.prim_specs.insert(path.to_owned(), spec);
        self.members.insert(spec, ChildNames::default());
        // `SdfSpecifier`: 0 def, 1 over.
        self.set_field(spec, "specifier", inline_value_rep(type_code::SPECIFIER, u32::from(meta.over)));
        if !type_name.is_empty() {
            let value = self.token_rep(type_name);
            self.set_field(spec, "typeName", value);
        }
        if !meta.api.is_empty() {
            let items: Vec<Vec<u8>> = meta.api.iter().map(|a| self.tokens.intern(a).to_le_bytes().to_vec()).collect();
            let value = self.list_op_rep(type_code::TOKEN_LIST_OP, PREPENDED, &items)?;
            self.set_field(spec, "apiSchemas", value);
        }
        if meta.inactive {
            self.set_field(spec, "active", inline_value_rep(type_code::BOOL, 0));
        }
        if let Some(kind) = meta.kind {
            let value = self.token_rep(kind);
            self.set_field(spec, "kind", value);
        }
        if meta.instanceable {
            self.set_field(spec, "instanceable", inline_value_rep(type_code::BOOL, 1));
        }
        if let Some(payload) = &meta.payload {
            let item = self.layer_arc_bytes(payload);
            let value = self.list_op_rep(type_code::PAYLOAD_LIST_OP, PREPENDED, &[item])?;
            self.set_field(spec, "payload", value);
        }
        if let Some(reference) = &meta.reference {
            // A reference ends in a dictionary of custom data, here with no entries.
            let mut item = self.layer_arc_bytes(reference);
            item.extend([0; 8]);
            let value = self.list_op_rep(type_code::REFERENCE_LIST_OP, PREPENDED, &[item])?;
            self.set_field(spec, "references", value);
        }
        if let Some(variants) = &meta.variants {
            self.add_variant_set(path, spec, variants)?;
        }
        Ok(())
    }

    fn create_attr(&mut self, path: &str, spec: &AttrSpec, default: Option<UsdValue>) -> Result<AttrHandle> {
        let number = self.add_spec(path, SpecType::Attribute);
        if spec.custom {
            self.set_field(number, "custom", inline_value_rep(type_code::BOOL, 1));
        }
        let type_name = self.token_rep(spec.type_name);
        self.set_field(number, "typeName", type_name);
        // `SdfVariability`: 0 varying, which is the default, 1 uniform.
        if spec.uniform {
            self.set_field(number, "variability", inline_value_rep(type_code::VARIABILITY, 1));
        }
        if let Some(size) = spec.element_size {
            self.set_field(number, "elementSize", inline_value_rep(type_code::INT, size.cast_unsigned()));
        }
        if let Some(interpolation) = spec.interpolation {
            let value = self.token_rep(interpolation);
            self.set_field(number, "interpolation", value);
        }
        if let Some(value) = default {
            let value = self.value_rep(&value, &|| path.to_owned())?;
            self.set_field(number, "default", value);
        }
        if let Some(source) = &spec.connection {
            let value = self.path_list_op_rep(std::slice::from_ref(source))?;
            self.set_field(number, "connectionPaths", value);
        }
        self.attrs.push(TimeSamples {
            spec: number,
            path: path.to_owned(),
            values: Vec::new(),
            times: SampleTimes::Consecutive(0),
        });
        Ok(AttrHandle(self.attrs.len() - 1))
    }

    fn set_default(&mut self, attr: AttrHandle, value: UsdValue) -> Result<()> {
        let Some((spec, path)) = self.attrs.get(attr.0).map(|a| (a.spec, a.path.clone())) else { return Ok(()) };
        let value = self.value_rep(&value, &|| path.clone())?;
        let name = self.tokens.intern("default");
        let field = self.specs.get_mut(spec).and_then(|s| s.fields.iter_mut().find(|field| field.0 == name));
        if let Some(field) = field {
            field.1 = value;
        }
        Ok(())
    }

    fn set_time_sample(&mut self, attr: AttrHandle, time: f64, value: UsdValue) -> Result<()> {
        let time_index = self.intern_time(time);
        let path = self.attrs.get(attr.0).map(|a| a.path.clone()).unwrap_or_default();
        let value = self.value_rep(&value, &|| format!("{path}, frame {time}"))?;
        let Some(samples) = self.attrs.get_mut(attr.0) else { return Ok(()) };
        let n = samples.values.len();
        // The run of consecutive times continues, or becomes a list of indices at the first gap.
        match &mut samples.times {
            SampleTimes::Consecutive(first) if n == 0 => *first = time_index,
            SampleTimes::Consecutive(first) if *first + n == time_index => {}
            SampleTimes::Consecutive(first) => {
                samples.times = SampleTimes::Indices((*first..*first + n).chain([time_index]).collect())
            }
            SampleTimes::Indices(list) => list.push(time_index),
        }
        samples.values.push(value);
        Ok(())
    }

    fn repeat_clip_once(&mut self, period: f64) {
        self.repeat_period = Some(period);
    }

    fn create_relationship(&mut self, path: &str, targets: &[String]) -> Result<()> {
        let spec = self.add_spec(path, SpecType::Relationship);
        self.set_field(spec, "variability", inline_value_rep(type_code::VARIABILITY, 1));
        let value = self.path_list_op_rep(targets)?;
        self.set_field(spec, "targetPaths", value);
        Ok(())
    }

    fn finish(&mut self) -> Result<()> {
        // All values of the samples are in the file; the sample tables and the lists of children are still missing.
        let attrs = std::mem::take(&mut self.attrs);
        for samples in attrs.iter().filter(|a| !a.values.is_empty()) {
            self.write_time_samples(samples)?;
        }
        for (spec, members) in std::mem::take(&mut self.members) {
            for (name, list) in [("properties", members.properties), ("primChildren", members.children)] {
                if !list.is_empty() {
                    let value = self.token_vector_rep(&list)?;
                    self.set_field(spec, name, value);
                }
            }
        }
        self.write_sections()?;
        std::mem::replace(&mut self.heap.sink, Box::new(DiscardingSink)).commit()
    }
}

/// Replaces the sink of a writer whose file is committed; discards everything.
struct DiscardingSink;

impl ByteSink for DiscardingSink {
    fn put(&mut self, _: &[u8]) -> Result<()> {
        Ok(())
    }

    fn put_at(&mut self, _: u64, _: &[u8]) -> Result<()> {
        Ok(())
    }

    fn position(&self) -> u64 {
        0
    }

    fn commit(self: Box<Self>) -> Result<()> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::up_axis::UpAxis;
    use half::f16;
    use osier_base::files::Folder;

    /// Bytes of an instancer's clip; `scale` gives the scale of a frame.
    fn clip(frames: u32, n: u32, scale: impl Fn(u32) -> f32) -> usize {
        let folder = Folder::memory();
        let out = folder.create("a.usdc", "usdc", None).expect("create").expect("new");
        let mut writer = UsdcWriter::new(Box::new(out));
        let meta = LayerMetadata {
            default_prim: "a".into(),
            up: UpAxis::Y,
            fps: 24.0,
            start: 1.0,
            end: f64::from(frames),
            seed: "1".into(),
            scene: String::new(),
        };
        writer.begin(&meta).expect("begin");
        writer.define_prim("/a", "PointInstancer", &PrimMetadata::default()).expect("prim");
        let types = [("positions", "point3f[]"), ("orientations", "quath[]"), ("scales", "float3[]")];
        let attrs = types
            .map(|(name, kind)| writer.create_attr(&format!("/a.{name}"), &AttrSpec::new(kind), None).expect("attr"));
        for f in 1..=frames {
            #[allow(clippy::cast_precision_loss, reason = "small numbers")]
            let at = |i: u32, k: u32| (i * 7 + k * 31 + f * 13) as f32 * 0.01;
            let positions: Vec<[f32; 3]> = (0..n).map(|i| [at(i, 0), at(i, 1), at(i, 2)]).collect();
            let turns: Vec<[f16; 4]> = (0..n).map(|i| [0, 1, 2, 3].map(|k| f16::from_f32(at(i, k)))).collect();
            let scales = vec![[scale(f); 3]; n as usize];
            let arrays = [UsdArray::Float3(&positions), UsdArray::Quath(&turns), UsdArray::Float3(&scales)];
            for (attr, array) in attrs.iter().zip(arrays) {
                writer.set_time_sample(*attr, f64::from(f), array.into()).expect("sample");
            }
        }
        writer.finish().expect("finish");
        folder.take("a.usdc").expect("file").len()
    }

    #[test]
    fn equal_arrays_are_stored_once() {
        let shared = clip(240, 2000, |_| 1.0);
        #[allow(clippy::cast_precision_loss, reason = "small numbers")]
        let each = clip(240, 2000, |f| f as f32);
        assert!(shared * 100 <= each * 70, "{shared} of {each} bytes");
        assert!(each > 240 * 2000 * 32);
    }

    #[test]
    fn the_layout_is_the_documented_one() {
        let folder = Folder::memory();
        let out = folder.create("a.usdc", "usdc", None).expect("create").expect("new");
        let mut writer = UsdcWriter::new(Box::new(out));
        let meta = LayerMetadata {
            default_prim: "a".into(),
            up: UpAxis::Z,
            fps: 24.0,
            start: 1.0,
            end: 2.0,
            seed: "1".into(),
            scene: "s".into(),
        };
        writer.begin(&meta).expect("begin");
        writer.define_prim("/a", "Xform", &PrimMetadata::default()).expect("prim");
        writer.finish().expect("finish");
        let bytes = folder.take("a.usdc").expect("file");
        assert_eq!(&bytes[..16], b"PXR-USDC\0\x08\0\0\0\0\0\0");
        let number =
            |at: usize| usize::try_from(u64::from_le_bytes(bytes[at..at + 8].try_into().expect("8"))).expect("size");
        let table = number(16);
        assert_eq!(number(table), 6);
        assert_eq!(bytes.len(), table + 8 + 6 * 32);
        let mut end = number(table + 8 + 16);
        for (i, name) in ["TOKENS", "STRINGS", "FIELDS", "FIELDSETS", "PATHS", "SPECS"].iter().enumerate() {
            let row = table + 8 + i * 32;
            assert_eq!(&bytes[row..row + name.len()], name.as_bytes());
            assert_eq!(number(row + 16), end, "sections follow each other");
            end += number(row + 24);
        }
        assert_eq!(end, table);
    }
}
