//! The objects of the glTF 2.0 schema that osier writes: fields are in the order of the keys, and values that equal the schema's
//! default are omitted.

use serde::Serialize;

/// Index into one of the top-level lists.
pub(super) type Index = u32;

/// Values of `componentType` of accessors (glTF 2.0, section 3.6.2.2).
pub(super) mod component {
    // The numbers are those of OpenGL: GL_BYTE, GL_UNSIGNED_BYTE, GL_SHORT and so on.
    pub(in crate::gltf) const I8: u32 = 5120;
    pub(in crate::gltf) const U8: u32 = 5121;
    pub(in crate::gltf) const I16: u32 = 5122;
    pub(in crate::gltf) const U16: u32 = 5123;
    pub(in crate::gltf) const U32: u32 = 5125;
    pub(in crate::gltf) const F32: u32 = 5126;
}

/// Targets of buffer views: vertex attributes (ARRAY_BUFFER), vertex indices (ELEMENT_ARRAY_BUFFER).
pub(super) mod target {
    pub(in crate::gltf) const VERTICES: u32 = 34962;
    pub(in crate::gltf) const INDICES: u32 = 34963;
}

/// The root object of the JSON text of a document.
#[derive(Debug, Default, Serialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Root {
    pub asset: AssetInfo,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    // Lists that are empty must be left out: the schema wants at least one element in each.
    pub extensions_used: Vec<&'static str>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub extensions_required: Vec<&'static str>,
    pub scene: Index,
    pub scenes: Vec<SceneNodes>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub nodes: Vec<Node>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub cameras: Vec<Camera>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub meshes: Vec<Mesh>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub skins: Vec<Skin>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub animations: Vec<Animation>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub materials: Vec<Material>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub textures: Vec<Texture>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub images: Vec<Image>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub samplers: Vec<TextureSampler>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub accessors: Vec<Accessor>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub buffer_views: Vec<BufferView>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub buffers: Vec<Buffer>,
}

#[derive(Debug, Default, Serialize)]
pub(super) struct AssetInfo {
    pub version: &'static str,
    pub generator: &'static str,
    pub extras: Extras<FileExtras>,
}

/// `extras` with osier's data under one key.
#[derive(Debug, Default, Serialize)]
pub(super) struct Extras<T> {
    pub osier: T,
}

#[derive(Debug, Clone, Copy, Serialize)]
pub(super) struct FogExtras {
    pub visibility: f32,
    pub color: [f32; 3],
    pub height: f32,
}

#[derive(Debug, Default, Serialize)]
pub(super) struct FileExtras {
    /// Haze, for renderers: visibility in m, linear colour, height in m.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fog: Option<FogExtras>,
    pub schema: u32,
    pub version: &'static str,
    // As text: numbers of JSON are exact up to 2^53 only.
    pub seed: String,
    pub scene: SceneExtras,
    pub fps: [u32; 2],
    pub start: u32,
    pub end: u32,
}

#[derive(Debug, Default, Serialize)]
pub(super) struct SceneExtras {
    pub name: String,
    pub hash: String,
}

#[derive(Debug, Default, Serialize)]
pub(super) struct SceneNodes {
    #[serde(skip_serializing_if = "String::is_empty")]
    pub name: String,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub nodes: Vec<Index>,
}

#[derive(Debug, Default, Serialize)]
pub(super) struct Node {
    pub name: String,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub children: Vec<Index>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub translation: Option<[f32; 3]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rotation: Option<[f32; 4]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub scale: Option<[f32; 3]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub camera: Option<Index>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mesh: Option<Index>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub skin: Option<Index>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub extensions: Option<NodeExtensions>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub extras: Option<Extras<NodeExtras>>,
}

#[derive(Debug, Clone, Default, Serialize)]
pub(super) struct NodeExtras {
    pub id: String,
    pub kind: &'static str,
}

#[derive(Debug, Clone, Serialize)]
pub(super) struct NodeExtensions {
    #[serde(rename = "EXT_mesh_gpu_instancing")]
    pub instancing: Instancing,
}

#[derive(Debug, Clone, Serialize)]
pub(super) struct Instancing {
    pub attributes: InstanceAttributes,
}

#[derive(Debug, Clone, Serialize)]
#[serde(rename_all = "SCREAMING_SNAKE_CASE")]
pub(super) struct InstanceAttributes {
    pub rotation: Index,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub scale: Option<Index>,
    pub translation: Index,
    /// Attributes that the extension does not define: their names begin with an underscore.
    #[serde(flatten)]
    pub custom: std::collections::BTreeMap<String, Index>,
}

#[derive(Debug, Serialize)]
pub(super) struct Camera {
    pub name: String,
    #[serde(rename = "type")]
    pub kind: &'static str,
    pub perspective: Perspective,
}

#[derive(Debug, Serialize)]
pub(super) struct Perspective {
    #[serde(rename = "aspectRatio", skip_serializing_if = "Option::is_none")]
    pub aspect_ratio: Option<f32>,
    pub yfov: f32,
    pub znear: f32,
    pub zfar: f32,
}

#[derive(Debug, Default, Serialize)]
pub(super) struct Mesh {
    pub name: String,
    pub primitives: Vec<Primitive>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub weights: Vec<f32>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub extras: Option<MeshExtras>,
}

#[derive(Debug, Serialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct MeshExtras {
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub target_names: Vec<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub osier: Option<LevelExtras>,
}

/// Data by which an engine chooses among the levels of detail, in the extras of a level's mesh.
#[derive(Debug, Serialize)]
pub(super) struct LevelExtras {
    /// Number of the level, from 0, the finest.
    pub lod: usize,
    pub triangles: usize,
    /// Triangles of the plant without simplification.
    pub plant_triangles: usize,
    /// Size of the leaves relative to those of the plant; omitted without leaves.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub leaf_size: Option<f32>,
    /// Smallest height of the plant on screen for this level, as a share of the picture's height; 0 for the coarsest level.
    pub screen: f32,
    /// Names of the values in red, green, blue and alpha of the vertex colours; empty without them.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub channels: Vec<String>,
}

#[derive(Debug, Default, Serialize)]
pub(super) struct Primitive {
    pub attributes: Attributes,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub indices: Option<Index>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub material: Option<Index>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mode: Option<u32>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub targets: Vec<MorphTarget>,
}

#[derive(Debug, Default, Serialize)]
pub(super) struct Attributes {
    #[serde(rename = "COLOR_0", skip_serializing_if = "Option::is_none")]
    pub color: Option<Index>,
    #[serde(rename = "JOINTS_0", skip_serializing_if = "Option::is_none")]
    pub joints: Option<Index>,
    #[serde(rename = "NORMAL", skip_serializing_if = "Option::is_none")]
    pub normal: Option<Index>,
    #[serde(rename = "POSITION")]
    pub position: Index,
    #[serde(rename = "TANGENT", skip_serializing_if = "Option::is_none")]
    pub tangent: Option<Index>,
    #[serde(rename = "TEXCOORD_0", skip_serializing_if = "Option::is_none")]
    pub uv: Option<Index>,
    #[serde(rename = "TEXCOORD_1", skip_serializing_if = "Option::is_none")]
    pub second_uv: Option<Index>,
    #[serde(rename = "WEIGHTS_0", skip_serializing_if = "Option::is_none")]
    pub weights: Option<Index>,
    /// Attributes of the scene under names with an underscore: `_MAP`, `_DEPTH`, ...
    #[serde(flatten)]
    pub custom: std::collections::BTreeMap<String, Index>,
}

#[derive(Debug, Serialize)]
pub(super) struct MorphTarget {
    #[serde(rename = "NORMAL", skip_serializing_if = "Option::is_none")]
    pub normal: Option<Index>,
    #[serde(rename = "POSITION")]
    pub position: Index,
}

#[derive(Debug, Serialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Skin {
    pub name: String,
    pub inverse_bind_matrices: Index,
    pub skeleton: Index,
    pub joints: Vec<Index>,
}

#[derive(Debug, Default, Serialize)]
pub(super) struct Animation {
    pub name: String,
    pub channels: Vec<Channel>,
    pub samplers: Vec<Sampler>,
}

#[derive(Debug, Serialize)]
pub(super) struct Channel {
    pub sampler: Index,
    pub target: ChannelTarget,
}

#[derive(Debug, Serialize)]
pub(super) struct ChannelTarget {
    pub node: Index,
    pub path: &'static str,
}

#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub(super) struct Sampler {
    pub input: Index,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub interpolation: Option<&'static str>,
    pub output: Index,
}

#[derive(Debug, Default, Serialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Material {
    pub name: String,
    pub pbr_metallic_roughness: Pbr,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub normal_texture: Option<TextureRef>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub alpha_mode: Option<&'static str>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub alpha_cutoff: Option<f32>,
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub double_sided: bool,
    #[serde(skip_serializing_if = "MaterialExtensions::is_empty")]
    pub extensions: MaterialExtensions,
}

#[derive(Debug, Default, Serialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Pbr {
    #[serde(skip_serializing_if = "Option::is_none")]
    pub base_color_factor: Option<[f32; 4]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub base_color_texture: Option<TextureRef>,
    pub metallic_factor: f32,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub roughness_factor: Option<f32>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub metallic_roughness_texture: Option<TextureRef>,
}

#[derive(Debug, Clone, Copy, Serialize)]
pub(super) struct TextureRef {
    pub index: Index,
}

#[derive(Debug, Default, Serialize)]
pub(super) struct MaterialExtensions {
    #[serde(rename = "KHR_materials_diffuse_transmission", skip_serializing_if = "Option::is_none")]
    pub diffuse_transmission: Option<DiffuseTransmission>,
    #[serde(rename = "KHR_materials_ior", skip_serializing_if = "Option::is_none")]
    pub ior: Option<Ior>,
    #[serde(rename = "KHR_materials_transmission", skip_serializing_if = "Option::is_none")]
    pub transmission: Option<Transmission>,
    #[serde(rename = "KHR_materials_volume", skip_serializing_if = "Option::is_none")]
    pub volume: Option<Volume>,
}

impl MaterialExtensions {
    pub(super) fn is_empty(&self) -> bool {
        self.diffuse_transmission.is_none()
            && self.ior.is_none()
            && self.transmission.is_none()
            && self.volume.is_none()
    }
}

/// Light that enters one side of a thin surface and leaves the other one in all directions.
#[derive(Debug, Serialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct DiffuseTransmission {
    pub diffuse_transmission_factor: f32,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub diffuse_transmission_color_factor: Option<[f32; 3]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub diffuse_transmission_color_texture: Option<TextureRef>,
}

#[derive(Debug, Serialize)]
pub(super) struct Ior {
    pub ior: f32,
}

#[derive(Debug, Serialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Transmission {
    pub transmission_factor: f32,
}

#[derive(Debug, Serialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Volume {
    pub thickness_factor: f32,
    pub attenuation_distance: f32,
    pub attenuation_color: [f32; 3],
}

#[derive(Debug, Serialize)]
pub(super) struct Texture {
    pub sampler: Index,
    pub source: Index,
}

#[derive(Debug, Serialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Image {
    pub name: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub uri: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mime_type: Option<&'static str>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub buffer_view: Option<Index>,
}

#[derive(Debug, Serialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct TextureSampler {
    pub mag_filter: u32,
    pub min_filter: u32,
}

#[derive(Debug, Default, Serialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Accessor {
    /// `None`: all elements are zero except those of `sparse`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub buffer_view: Option<Index>,
    pub component_type: u32,
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub normalized: bool,
    pub count: usize,
    #[serde(rename = "type")]
    pub shape: &'static str,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub max: Vec<f32>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub min: Vec<f32>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sparse: Option<SparseElements>,
}

/// The elements of an accessor that are not zero.
#[derive(Debug, Serialize)]
pub(super) struct SparseElements {
    pub count: usize,
    pub indices: SparseIndices,
    pub values: SparseValues,
}

#[derive(Debug, Serialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct SparseIndices {
    pub buffer_view: Index,
    pub component_type: u32,
}

#[derive(Debug, Serialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct SparseValues {
    pub buffer_view: Index,
}

#[derive(Debug, Default, Serialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct BufferView {
    pub buffer: Index,
    #[serde(skip_serializing_if = "is_zero")]
    pub byte_offset: usize,
    pub byte_length: usize,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub byte_stride: Option<usize>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub target: Option<u32>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub extensions: Option<ViewExtensions>,
    /// Kind of the elements, which determines their compression; `None` for images.
    #[serde(skip)]
    pub stream: Option<super::stream::Stream>,
}

#[derive(Debug, Serialize)]
pub(super) struct ViewExtensions {
    #[serde(rename = "EXT_meshopt_compression")]
    pub meshopt: CompressedView,
}

/// Where the compressed bytes of a view are, and how they are decoded.
#[derive(Debug, Serialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct CompressedView {
    pub buffer: Index,
    #[serde(skip_serializing_if = "is_zero")]
    pub byte_offset: usize,
    pub byte_length: usize,
    pub byte_stride: usize,
    pub count: usize,
    pub mode: &'static str,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub filter: Option<&'static str>,
}

#[allow(clippy::trivially_copy_pass_by_ref, reason = "the signature serde asks for")]
fn is_zero(n: &usize) -> bool {
    *n == 0
}

#[derive(Debug, Default, Serialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Buffer {
    #[serde(skip_serializing_if = "Option::is_none")]
    pub uri: Option<String>,
    pub byte_length: usize,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub extensions: Option<BufferExtensions>,
}

#[derive(Debug, Serialize)]
pub(super) struct BufferExtensions {
    #[serde(rename = "EXT_meshopt_compression")]
    pub meshopt: FallbackBuffer,
}

/// Marks a buffer without bytes: readers allocate it for the decompressed views.
#[derive(Debug, Serialize)]
pub(super) struct FallbackBuffer {
    pub fallback: bool,
}
