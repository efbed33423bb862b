//! Options of the glTF writer.

/// The readers that a file is made for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Profile {
    /// Viewers and engines: EXT_mesh_gpu_instancing, KHR_mesh_quantization, reduced keys, JPEG images.
    Web,
    /// Blender 3.4 to 5.0: instances merged into meshes, a key for every frame, PNG images.
    #[default]
    Blender,
}

impl Profile {
    /// The name of the profile in file names.
    pub fn word(self) -> &'static str {
        match self {
            Self::Web => "web",
            Self::Blender => "blender",
        }
    }

    pub(super) fn kind(self) -> &'static str {
        match self {
            Self::Web => "glb.web",
            Self::Blender => "glb.blender",
        }
    }
}

/// The files to write.
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
    /// Write this frame alone, without animation.
    pub frame: Option<u32>,
    /// Most moving instances in a file; each is a node with animation channels.
    pub nodes: usize,
    /// Most placements with a skin of their own; further plants do not move and share meshes.
    pub skins: usize,
    /// Write a file for each asset, besides that of the scene.
    pub assets: bool,
}

/// Default of [`GltfOptions::skins`]. Own: beyond it importers and viewers become slow; a higher limit animates more plants.
pub const SKINS: usize = 64;

impl Default for GltfOptions {
    fn default() -> Self {
        Self {
            profile: Profile::default(),
            target: GltfTarget::default(),
            frame: None,
            nodes: 500,
            skins: SKINS,
            assets: true,
        }
    }
}
