//! The JSON document: parts that are decoded here are removed before the `gltf` crate validates the rest.

use std::collections::BTreeMap;

use gltf::json::Root;
use serde_json::{Map, Value};

use crate::{ImportContext, ImportResult};
use osier_base::convert::limit;
use osier_base::diagnostic::{Diagnostic, Span};
use osier_base::files::{Encoding, decode};
use osier_base::limits::grouped;

/// Extensions that are read, and those that change only the appearance and can be ignored.
const SUPPORTED_EXTENSIONS: [&str; 18] = [
    "EXT_mesh_gpu_instancing",
    "EXT_meshopt_compression",
    "KHR_lights_punctual",
    "KHR_materials_anisotropy",
    "KHR_materials_clearcoat",
    "KHR_materials_diffuse_transmission",
    "KHR_materials_dispersion",
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_iridescence",
    "KHR_materials_pbrSpecularGlossiness",
    "KHR_materials_sheen",
    "KHR_materials_specular",
    "KHR_materials_transmission",
    "KHR_materials_unlit",
    "KHR_materials_volume",
    "KHR_mesh_quantization",
    "KHR_texture_transform",
];

/// Accessors of the attributes of EXT_mesh_gpu_instancing at a node; `None` for an absent attribute.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct InstanceAccessors {
    pub(super) translation: Option<usize>,
    pub(super) rotation: Option<usize>,
    pub(super) scale: Option<usize>,
}

/// JSON pointers within a material to the maps that are read; the texture coordinates of the first map present apply to
/// all.
const MAPS: [&str; 3] =
    ["/pbrMetallicRoughness/baseColorTexture", "/normalTexture", "/pbrMetallicRoughness/metallicRoughnessTexture"];

/// A texture transform: offset, rotation (rad), scale.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct UvTransform {
    pub(super) offset: [f64; 2],
    pub(super) rotation: f64,
    pub(super) scale: [f64; 2],
}

/// The set of texture coordinates that a map uses, and how they are transformed.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct TextureCoordinates {
    pub(super) set: u32,
    /// `None` where nothing changes.
    pub(super) transform: Option<UvTransform>,
}

/// Where the compressed bytes of a buffer view are (EXT_meshopt_compression).
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct CompressedView {
    pub(super) buffer: usize,
    pub(super) offset: usize,
    pub(super) length: usize,
    pub(super) stride: usize,
    pub(super) count: usize,
    /// ATTRIBUTES, TRIANGLES or INDICES.
    pub(super) mode: String,
    /// NONE, OCTAHEDRAL, QUATERNION or EXPONENTIAL.
    pub(super) filter: String,
}

/// A validated document, and the extensions that are decoded here.
#[derive(Debug)]
pub(super) struct GltfDocument {
    pub(super) root: Root,
    /// Accessors of EXT_mesh_gpu_instancing, by index of the node whose mesh they multiply.
    pub(super) instance_accessors: BTreeMap<usize, InstanceAccessors>,
    /// Texture coordinates of the maps of a material, by its index.
    pub(super) texture_coordinates: BTreeMap<usize, TextureCoordinates>,
    /// Index of refraction by KHR_materials_ior, by index of the material.
    pub(super) iors: BTreeMap<usize, f64>,
    /// Share of diffuse light that is transmitted, by index of the material.
    pub(super) translucencies: BTreeMap<usize, f64>,
    /// Place and coding of compressed buffer views (EXT_meshopt_compression), by index of the view.
    pub(super) compressed_views: BTreeMap<usize, CompressedView>,
}

impl GltfDocument {
    /// Reads the JSON; `None` if it has errors with a position, which are then in the report.
    /// # Errors
    /// X010 if it is damaged or too large, X011 for a required extension that is not known.
    pub(super) fn read(context: &mut ImportContext<'_>, json: &[u8]) -> ImportResult<Option<Self>> {
        let limit = context.options.limits.get("json-bytes");
        if json.len() as u64 > limit {
            let limit = grouped(limit);
            let message = format_args!("holds more than {} bytes of JSON", limit);
            return Err(Box::new(
                context.error_about_file("X010", message).help("raise the limit with --max-json-bytes"),
            ));
        }
        let name = context.name();
        let text = match decode(json, Encoding::Utf8) {
            Ok(text) => text.text,
            // Only a JSON text can be corrected by hand and gets the position of its stray byte; other files must be
            // exported again.
            Err(_) if !begins_as_json(json) => {
                let message = "is not glTF: it begins neither with the word glTF nor with a brace";
                return Err(Box::new(
                    context
                        .error_about_file("X010", message)
                        .help("it is damaged or in another format; export the mesh again as .glb or .gltf"),
                ));
            }
            Err(bad) => {
                bad.report("X010", &name, json, &mut context.report);
                return Ok(None);
            }
        };
        // Parse into a tree first: what the `gltf` crate would refuse or lose is read and removed here.
        let mut value: Value = match serde_json::from_str(&text) {
            Ok(value) => value,
            Err(e) => {
                syntax_error(context, &text, &e);
                return Ok(None);
            }
        };
        let Some(top) = value.as_object_mut() else {
            return Err(context.error_about_file("X010", "is not a glTF document: its JSON is no object"));
        };
        check_required_extensions(context, top)?;
        check_position_accessors(context, top)?;
        if read_specular_glossiness(top) {
            let what = "holds pictures of specular colour and glossiness; they are not read, the roughness is 1 - glossinessFactor";
            context.warn("X016", what);
        }
        // Remove the animations before validation: a defect in them must not make the mesh unreadable.
        if top.remove("animations").is_some() {
            context.warn("X016", "holds animations; they are not read");
        }
        let instance_accessors = entries(top, "nodes").filter_map(|(i, n)| Some((i, instance_accessors(n)?))).collect();
        let texture_coordinates = coordinates_of_materials(context, top);
        let ior = |m: &Value| m.pointer("/extensions/KHR_materials_ior/ior")?.as_f64();
        let iors = entries(top, "materials").filter_map(|(i, m)| Some((i, ior(m)?))).collect();
        let translucency =
            |m: &Value| m.pointer("/extensions/KHR_materials_diffuse_transmission/diffuseTransmissionFactor")?.as_f64();
        let translucencies = entries(top, "materials").filter_map(|(i, m)| Some((i, translucency(m)?))).collect();
        let compressed_views =
            entries(top, "bufferViews").filter_map(|(i, v)| Some((i, compressed_view(v)?))).collect();
        // The `gltf` crate validates the rest.
        let stripped = serde_json::to_vec(&value)
            .map_err(|e| context.error_about_file("X010", format_args!("is damaged: {e}")))?;
        drop(value);
        let root = match gltf::Gltf::from_slice(&stripped) {
            Ok(gltf) => gltf.document.into_json(),
            Err(e) => return Err(validation_error(context, e)),
        };
        Ok(Some(Self { root, instance_accessors, texture_coordinates, iors, translucencies, compressed_views }))
    }
}

/// Reports a JSON syntax error with its position.
fn syntax_error(context: &mut ImportContext<'_>, text: &str, e: &serde_json::Error) {
    // The parser gives line and column; a span needs the byte offset.
    let line_start: usize = text.split_inclusive('\n').take(e.line().saturating_sub(1)).map(str::len).sum();
    let at = (line_start + e.column().saturating_sub(1)).min(text.len());
    let source = context.report.sources.add(context.name(), text);
    let words = e.to_string();
    let message = words.split(" at line ").next().unwrap_or(&words).to_owned();
    let diagnostic = Diagnostic::error("X010", message, Span::new(source, at, at + 1), "here");
    context.report.push(diagnostic.help("the JSON is damaged; export the file again"));
}

/// The diagnostic of a document that fails validation, with its first five faults.
fn validation_error(context: &ImportContext<'_>, e: gltf::Error) -> Box<Diagnostic> {
    let list = match e {
        gltf::Error::Validation(list) => {
            let shown = list.iter().take(5).map(|(path, e)| format!("{path}: {e}"));
            let more = list.len().saturating_sub(5);
            shown.chain((more > 0).then(|| format!("and {more} more"))).collect::<Vec<_>>().join(", ")
        }
        other => other.to_string(),
    };
    Box::new(
        context
            .error_about_file("X010", format_args!("is not valid glTF: {list}"))
            .help("export it again, or check it with the Khronos validator"),
    )
}

/// Whether a file begins with the brace of a JSON object, behind a byte order mark and blanks.
fn begins_as_json(bytes: &[u8]) -> bool {
    bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes).trim_ascii_start().starts_with(b"{")
}

/// Removes the extensions that this reader decodes from the list of required ones; any other fails with X011.
fn check_required_extensions(context: &ImportContext<'_>, top: &mut Map<String, Value>) -> ImportResult<()> {
    let Some(list) = top.remove("extensionsRequired") else { return Ok(()) };
    let names: Vec<String> = match list {
        Value::Array(items) => items.iter().map(|v| v.as_str().map_or_else(|| v.to_string(), str::to_owned)).collect(),
        other => vec![other.to_string()],
    };
    match names.iter().find(|n| !SUPPORTED_EXTENSIONS.contains(&n.as_str())) {
        None => Ok(()),
        Some(name) => Err(Box::new(
            context
                .error_about_file("X011", format_args!("requires the glTF extension {name:?}, which is not known"))
                .help("export the file without it (no Draco compression, PNG or JPEG images)"),
        )),
    }
}

/// Fails for positions in accessors that do not exist: the crate's validation would panic on them.
fn check_position_accessors(context: &ImportContext<'_>, top: &Map<String, Value>) -> ImportResult<()> {
    let count = top.get("accessors").and_then(Value::as_array).map_or(0, Vec::len) as u64;
    for (i, mesh) in entries(top, "meshes") {
        let primitives = mesh.get("primitives").and_then(Value::as_array);
        for (k, primitive) in primitives.into_iter().flatten().enumerate() {
            let index = primitive.pointer("/attributes/POSITION").and_then(Value::as_u64);
            if index.is_some_and(|n| n >= count) {
                let message = format_args!("meshes[{i}].primitives[{k}].attributes.POSITION names no accessor");
                return Err(context.error_in_file("X010", message));
            }
        }
    }
    Ok(())
}

/// Converts KHR_materials_pbrSpecularGlossiness to base colour and roughness in materials that have nothing else, as
/// Sketchfab and other programs wrote them. Returns whether one of them also has a picture of specular colour and
/// glossiness.
/// Source: KHR_materials_pbrSpecularGlossiness, whose defaults are a white diffuse colour and a glossiness of 1.
fn read_specular_glossiness(top: &mut Map<String, Value>) -> bool {
    let mut has_pictures = false;
    let materials = top.get_mut("materials").and_then(Value::as_array_mut);
    for material in materials.into_iter().flatten() {
        let given = material.pointer("/extensions/KHR_materials_pbrSpecularGlossiness").cloned();
        let (Some(given), Some(material)) = (given, material.as_object_mut()) else { continue };
        // A file may also describe the same material by base colour and roughness, which are then read with all their
        // pictures.
        if material.contains_key("pbrMetallicRoughness") {
            continue;
        }
        let glossiness = given.get("glossinessFactor").and_then(Value::as_f64).unwrap_or(1.0);
        let mut pbr = Map::new();
        pbr.insert("roughnessFactor".to_owned(), Value::from((1.0 - glossiness).clamp(0.0, 1.0)));
        pbr.insert("metallicFactor".to_owned(), Value::from(0.0));
        for (from, to) in [("diffuseFactor", "baseColorFactor"), ("diffuseTexture", "baseColorTexture")] {
            if let Some(value) = given.get(from) {
                pbr.insert(to.to_owned(), value.clone());
            }
        }
        has_pictures |= given.get("specularGlossinessTexture").is_some();
        material.insert("pbrMetallicRoughness".to_owned(), Value::Object(pbr));
    }
    has_pictures
}

/// Index and value of the entries of a top-level array.
fn entries<'a>(top: &'a Map<String, Value>, key: &str) -> impl Iterator<Item = (usize, &'a Value)> + use<'a> {
    top.get(key).and_then(Value::as_array).into_iter().flatten().enumerate()
}

/// Accessors of EXT_mesh_gpu_instancing. An index beyond the address space becomes one that no accessor has: an error
/// on use.
fn instance_accessors(node: &Value) -> Option<InstanceAccessors> {
    let attributes = node.pointer("/extensions/EXT_mesh_gpu_instancing/attributes")?;
    let index = |key: &str| attributes.get(key)?.as_u64().map(limit);
    Some(InstanceAccessors { translation: index("TRANSLATION"), rotation: index("ROTATION"), scale: index("SCALE") })
}

/// EXT_meshopt_compression of a buffer view. A number that is missing or beyond the address space names no bytes, which is an error
/// on use.
fn compressed_view(view: &Value) -> Option<CompressedView> {
    let source = view.pointer("/extensions/EXT_meshopt_compression")?;
    let number = |key: &str| source.get(key).and_then(Value::as_u64).map_or(0, limit);
    let word = |key: &str| source.get(key).and_then(Value::as_str).unwrap_or("NONE").to_owned();
    Some(CompressedView {
        buffer: number("buffer"),
        offset: number("byteOffset"),
        length: number("byteLength"),
        stride: number("byteStride"),
        count: number("count"),
        mode: word("mode"),
        filter: word("filter"),
    })
}

/// Texture coordinates by index of the material. A mesh has one set of them: if the maps of a material use different
/// sets, those of the first map apply (X016).
fn coordinates_of_materials(
    context: &mut ImportContext<'_>,
    top: &Map<String, Value>,
) -> BTreeMap<usize, TextureCoordinates> {
    let mut of_materials = BTreeMap::new();
    let mut unequal = Vec::new();
    for (i, material) in entries(top, "materials") {
        let mut maps = MAPS.iter().filter_map(|map| material.pointer(map)).map(texture_coordinates);
        let Some(first) = maps.next() else { continue };
        if maps.any(|other| other != first) {
            unequal.push(i);
        }
        of_materials.insert(i, first);
    }
    if let Some(first) = unequal.first() {
        let n = unequal.len();
        let what = format_args!(
            "holds {n} materials whose maps have different texture coordinates, the first is materials[{first}]; \
             all maps of a material get those of its colour, or of its normals where it has no picture of its colour"
        );
        context.warn("X016", what);
    }
    of_materials
}

/// Set and transform of the texture coordinates of a map.
/// Source: KHR_texture_transform, whose `texCoord` counts more than that of the map.
fn texture_coordinates(map: &Value) -> TextureCoordinates {
    let set_of = |v: &Value| v.get("texCoord").and_then(Value::as_u64).and_then(|n| u32::try_from(n).ok());
    let given = map.pointer("/extensions/KHR_texture_transform");
    let set = given.and_then(set_of).or_else(|| set_of(map)).unwrap_or(0);
    let unchanged = UvTransform { offset: [0.0; 2], rotation: 0.0, scale: [1.0; 2] };
    TextureCoordinates { set, transform: given.map(uv_transform).filter(|t| *t != unchanged) }
}

/// Offset, rotation and scale of KHR_texture_transform.
fn uv_transform(given: &Value) -> UvTransform {
    let pair = |key: &str, default: f64| {
        let at = |i: usize| given.get(key).and_then(|v| v.get(i)).and_then(Value::as_f64).unwrap_or(default);
        [at(0), at(1)]
    };
    let rotation = given.get("rotation").and_then(Value::as_f64).unwrap_or(0.0);
    UvTransform { offset: pair("offset", 0.0), rotation, scale: pair("scale", 1.0) }
}
