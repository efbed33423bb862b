//! Options of the glTF writer.

use super::wind_channels::WindChannels;
use osier_scene::Clip;

/// Programs that a file is made for: determines extensions, storage of vertices and images, and how instances are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Profile {
    /// Viewers: EXT_mesh_gpu_instancing, KHR_mesh_quantization, reduced keys, JPEG images.
    Web,
    /// Game engines: plain glTF that requires no extension, leaves merged into skinned meshes, levels of detail.
    Engine,
    /// Blender 3.4 to 5.0: instances merged into meshes, a key for every frame, PNG images.
    #[default]
    Blender,
}

impl Profile {
    /// Part of the names of files: `<asset>.<profile>.glb`.
    pub fn word(self) -> &'static str {
        match self {
            Self::Web => "web",
            Self::Engine => "engine",
            Self::Blender => "blender",
        }
    }

    pub(super) fn kind(self) -> &'static str {
        match self {
            Self::Web => "glb.web",
            Self::Engine => "glb.engine",
            Self::Blender => "glb.blender",
        }
    }
}

/// Layout of the files that an exporter writes for its profile.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub enum GltfTarget {
    /// `gltf/<asset>.<profile>.glb` for each asset and `gltf/<scene>.<profile>.glb` for all placements and the camera.
    #[default]
    Bake,
    /// All placements in one binary file at this path.
    Glb(String),
    /// All placements in a .gltf at this path, its buffer beside it as `<stem>.bin`, its images in `<stem>_files/`.
    Gltf(String),
}

/// Bytes of three floats: a position or a normal in a morph target.
pub(super) const VECTOR_BYTES: usize = 12;
/// Bytes of the index of a vertex in a sparse morph target, which does not contain all vertices.
pub(super) const INDEX_BYTES: usize = 4;

/// Options of one [`GltfExporter`](super::GltfExporter), which writes one profile.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct GltfOptions {
    /// Determines extensions, storage of vertices and images, and how instances are written.
    pub profile: Profile,
    /// The files of a bake, or a single file.
    pub target: GltfTarget,
    /// Number of the only frame that is written, without animation; `None`: the whole clip.
    pub frame: Option<u32>,
    /// Number of frames that will be written, from which shapes are spread over the clip; `None`: all frames of the clip.
    pub frames: Option<usize>,
    /// Frames after which the motion of the scene repeats, if everything that moves has joints. If the clip ends there,
    /// files of `web` and `engine` get one more key, at which the motion begins again.
    pub loop_frames: Option<u32>,
    /// Width and height of the camera's picture, pixels; `None`: the file gives no aspect ratio, and viewers use that
    /// of their window.
    pub size: Option<[u32; 2]>,
    /// Most moving instances in a file; each is a node with animation channels.
    pub nodes: usize,
    /// Most placements with a skin each; plants beyond it do not move and share meshes.
    pub skins: usize,
    /// Whether each asset has a file besides that of the scene; profile `engine` writes these files in any case.
    pub assets: bool,
    /// Profile `web`: store vertices as integers of 8 and 16 bits, with the transform to metres in nodes and skins.
    pub quantize: bool,
    /// Profile `web`: compress vertices, triangles and keys with EXT_meshopt_compression. Implies `quantize`.
    pub meshopt: bool,
    /// Profile `blender`: approximate limit to the bytes of an asset's merged leaves; leaves get fewer triangles to
    /// keep it.
    pub leaf_bytes: u64,
    /// Profile `engine`: most triangles of a plant at its finest level of detail.
    pub level_triangles: usize,
    /// Profile `engine`: most joints of a plant; values outside of 1 to 256 are clamped.
    pub joints: usize,
    /// Profile `engine`: assignment of wind to the vertex colours of plants; `None`: plants have no such colours.
    pub channels: Option<WindChannels>,
}

impl GltfOptions {
    /// Number of frames that will be written of a clip.
    pub(super) fn written_frames(&self, clip: Clip) -> usize {
        self.frames.unwrap_or(clip.len())
    }

    /// Storage of vertices without morph targets; only profile `web` quantizes them.
    pub(super) fn vertex_storage(&self) -> VertexStorage {
        match self.profile {
            Profile::Web if self.quantize || self.meshopt => VertexStorage::Quantized,
            Profile::Web => VertexStorage::ByteDirections,
            Profile::Blender | Profile::Engine => VertexStorage::Floats,
        }
    }

    /// Bytes of a point's position in a morph target: four integers of 16 bits, one of them padding, or three floats.
    pub(super) fn target_position_bytes(&self) -> usize {
        if self.vertex_storage() == VertexStorage::Quantized { 8 } else { VECTOR_BYTES }
    }

    /// Whether morph targets may have normals: Blender ignores them and computes its own.
    pub(super) fn has_target_normals(&self) -> bool {
        self.profile != Profile::Blender
    }

    /// Bytes of a point's position in a sparse morph target, with the index of its vertex. Sparse elements are not
    /// padded.
    pub(super) fn sparse_position_bytes(&self) -> usize {
        let position = if self.vertex_storage() == VertexStorage::Quantized { 6 } else { VECTOR_BYTES };
        position + INDEX_BYTES
    }

    /// Most joints of an animated skeleton: [`Self::joints`] within 1 to 256 for `engine`, else a constant.
    pub(super) fn most_joints(&self) -> usize {
        match self.profile {
            Profile::Engine => self.joints.clamp(1, 256),
            Profile::Web | Profile::Blender => super::rig::MAX_JOINTS,
        }
    }

    /// Whether buffer views are compressed: only those of profile `web`, with [`Self::meshopt`].
    pub(super) fn compresses(&self) -> bool {
        self.profile == Profile::Web && self.meshopt
    }
}

/// How the vertices of meshes are stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum VertexStorage {
    /// Floats, which need no extension of glTF.
    Floats,
    /// Normals and tangents as signed bytes, all else as floats; meshes with morph targets as floats.
    ByteDirections,
    /// Positions and texture coordinates as 16-bit integers, everything else as bytes.
    Quantized,
}

/// Default of [`GltfOptions::skins`]. Own: beyond it importers and viewers become slow; a higher limit animates more plants.
pub const SKINS: usize = 64;

/// Default of [`GltfOptions::leaf_bytes`]. Own: Blender opens a tree of this size in seconds; without a limit
/// the leaves of a grown oak take 0.9 GB.
pub const LEAF_BYTES: u64 = 160_000_000;
/// Default of [`GltfOptions::level_triangles`]. Own: all levels of a swaying tree, at about 80 bytes per triangle, and its
/// textures then take less than 4 MB.
pub const LEVEL_TRIANGLES: usize = 32_000;
/// Default of [`GltfOptions::joints`]. Own: engines on phones hold 64 to 75 matrices in a draw call.
pub const ENGINE_JOINTS: usize = 64;

impl Default for GltfOptions {
    fn default() -> Self {
        Self {
            profile: Profile::default(),
            target: GltfTarget::default(),
            frame: None,
            frames: None,
            loop_frames: None,
            size: None,
            nodes: 500,
            skins: SKINS,
            assets: true,
            quantize: false,
            meshopt: false,
            leaf_bytes: LEAF_BYTES,
            level_triangles: LEVEL_TRIANGLES,
            joints: ENGINE_JOINTS,
            channels: None,
        }
    }
}
