//! Options of all formats.

use super::{
    exr::options::ExrOptions,
    gltf::options::{GltfOptions, Profile},
    pov::options::PovOptions,
    usd::options::UsdOptions,
};

/// Choices of all formats that have some.
#[derive(Debug, Clone, Default)]
pub struct ExportOptions {
    /// USD.
    pub usd: UsdOptions,
    /// glTF; profile and target come from [`Self::gltf_profiles`] and the `ExportJob`.
    pub gltf: GltfOptions,
    /// Profiles of glTF, each with a set of files.
    pub gltf_profiles: Vec<Profile>,
    /// POV-Ray.
    pub pov: PovOptions,
    /// Maps.
    pub exr: ExrOptions,
}
