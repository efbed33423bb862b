//! Options of all formats.

use super::{
    exr::options::ExrOptions,
    gltf::options::{GltfOptions, Profile},
    points::options::PointsOptions,
    pov::options::PovOptions,
    usd::options::UsdOptions,
    vdb::options::VdbOptions,
};

/// Options of all formats that have options; options of formats that are not written are ignored.
#[derive(Debug, Clone, Default)]
pub struct ExportOptions {
    /// Options of USD; those of a single file follow from the [`ExportJob`](super::format::ExportJob).
    pub usd: UsdOptions,
    /// Options of glTF; profile and target come from [`Self::gltf_profiles`] and the `ExportJob`.
    pub gltf: GltfOptions,
    /// Profiles of glTF; a bake writes a set of files for each.
    pub gltf_profiles: Vec<Profile>,
    /// Options of POV-Ray; the target comes from the `ExportJob`.
    pub pov: PovOptions,
    /// Options of points as CSV; without table names no file is written.
    pub points: PointsOptions,
    /// Options of OpenVDB files: precision, compression and up axis of voxel grids.
    pub vdb: VdbOptions,
    /// Options of EXR maps: whether map sequences are also packed into atlases.
    pub exr: ExrOptions,
}
