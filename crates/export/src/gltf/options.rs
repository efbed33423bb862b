//! Options of the glTF writer.

/// For whom a file is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Profile {
    /// Viewers and engines: instancing by EXT_mesh_gpu_instancing, few keys.
    Web,
    /// Blender 3.4 to 5.0: merged instances, a key for every frame.
    #[default]
    Blender,
}

impl Profile {
    /// The word in file names.
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

/// Which files are written.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub enum GltfTarget {
    /// `gltf/<asset>.<profile>.glb` for each asset and `gltf/<scene>.<profile>.glb` for all placements and the camera.
    #[default]
    Bake,
    /// All placements in one binary file at this path.
    Glb(String),
    /// All placements in a .gltf at this path, its buffer beside it as `<stem>.bin`, its pictures in `<stem>_files/`.
    Gltf(String),
}

/// What to write.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct GltfOptions {
    /// For whom.
    pub profile: Profile,
    /// Which files.
    pub target: GltfTarget,
    /// The only frame, shown still.
    pub frame: Option<u32>,
    /// Most moving instances in a file.
    pub nodes: usize,
    /// Most placements with a skin of their own; the plants beyond stand still and share meshes.
    pub skins: usize,
    /// Whether each asset has a file of its own, too.
    pub assets: bool,
}

/// Skins of a file unless the scene asks for others.
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
