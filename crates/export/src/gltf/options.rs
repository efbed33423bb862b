//! Options of the glTF writer.

use super::wind_channels::WindChannels;

/// The readers that a file is made for.
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
    /// Its part of file names: `<asset>.<profile>.glb`.
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

/// Which files a writer makes for its profile.
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

/// Options of the glTF writer.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct GltfOptions {
    /// The readers that the files are made for.
    pub profile: Profile,
    /// The files to write.
    pub target: GltfTarget,
    /// Number of the only frame that is written, without animation; `None`: the whole clip.
    pub frame: Option<u32>,
    /// Most moving instances in a file; each is a node with animation channels.
    pub nodes: usize,
    /// Most placements with a skin of their own; further plants do not move and share meshes.
    pub skins: usize,
    /// Write a file for each asset, besides that of the scene.
    pub assets: bool,
    /// Profile `web`: store vertices as integers of 8 and 16 bits, with the transform to metres in nodes and skins.
    pub quantize: bool,
    /// Profile `web`: compress vertices, triangles and keys with EXT_meshopt_compression. Implies `quantize`.
    pub meshopt: bool,
    /// Profile `engine`: most triangles of a plant at its finest level of detail.
    pub level_triangles: usize,
    /// Profile `engine`: most joints of a plant; values outside of 1 to 256 are clamped.
    pub joints: usize,
    /// Profile `engine`: what the vertex colours of plants hold; `None` writes none.
    pub channels: Option<WindChannels>,
}

impl GltfOptions {
    /// How the vertices of meshes are stored.
    pub(super) fn vertex_storage(&self) -> VertexStorage {
        match self.profile {
            Profile::Web if self.quantize || self.meshopt => VertexStorage::Quantized,
            Profile::Web => VertexStorage::ByteDirections,
            Profile::Blender | Profile::Engine => VertexStorage::Floats,
        }
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

/// How the vertices of meshes without morph targets are stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum VertexStorage {
    /// Floats, as the core of glTF has them.
    Floats,
    /// Normals and tangents as signed bytes, all else as floats.
    ByteDirections,
    /// Positions and texture coordinates as 16-bit integers, all else as bytes.
    Quantized,
}

/// Default of [`GltfOptions::skins`]. Own: beyond it importers and viewers become slow; a higher limit animates more plants.
pub const SKINS: usize = 64;

/// Default of [`GltfOptions::level_triangles`]. Own: all levels of a swaying tree, of about 80 bytes a triangle, with its pictures take less
/// than 4 MB.
pub const LEVEL_TRIANGLES: usize = 32_000;
/// Default of [`GltfOptions::joints`]. Own: engines on phones hold 64 to 75 matrices in a draw call.
pub const ENGINE_JOINTS: usize = 64;

impl Default for GltfOptions {
    fn default() -> Self {
        Self {
            profile: Profile::default(),
            target: GltfTarget::default(),
            frame: None,
            nodes: 500,
            skins: SKINS,
            assets: true,
            quantize: false,
            meshopt: false,
            level_triangles: LEVEL_TRIANGLES,
            joints: ENGINE_JOINTS,
            channels: None,
        }
    }
}
