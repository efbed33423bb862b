//! `manifest.json`: what a bake holds. Written last: its presence marks a complete bake.

mod build;
mod verify;

pub use build::{Settings, build};
pub use verify::{Verification, verify};

use serde::{Deserialize, Serialize};

use osier_base::Result;
use osier_base::files::{Folder, MANIFEST};

/// The whole manifest; field order is key order.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Manifest {
    /// Rises on incompatible change.
    pub schema: u32,
    /// `osier`.
    pub generator: String,
    /// Version of osier.
    pub version: String,
    /// Which scene.
    pub scene: SceneEntry,
    /// Decimal: JSON numbers end at 2^53.
    pub seed: String,
    /// Of the USD files.
    pub up_axis: String,
    /// Of the USD files.
    pub meters_per_unit: f64,
    /// Clip.
    pub time: TimeEntry,
    /// What numbers in maps and scenes mean.
    pub units: UnitsEntry,
    /// In scene order.
    pub assets: Vec<AssetEntry>,
    /// In scene order.
    pub materials: Vec<MaterialEntry>,
    /// In path order, sequences grouped.
    pub files: Vec<FileEntry>,
    /// BLAKE3 of the lines `path NUL hex LF` of all files in path order.
    pub bake_hash: String,
    /// In asset order.
    pub warnings: Vec<WarningEntry>,
}

/// Name and hash of the resolved scene.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SceneEntry {
    /// Name.
    pub name: String,
    /// 64 hex digits.
    pub hash: String,
}

/// Frames: sample times are f + k / substeps.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TimeEntry {
    /// Numerator and denominator.
    pub fps: [u32; 2],
    /// First frame.
    pub start: u32,
    /// Last frame.
    pub end: u32,
    /// Frames between samples.
    pub step: u32,
    /// Samples per frame.
    pub substeps: u32,
    /// Digits of frame numbers in names.
    pub digits: usize,
}

/// Units.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct UnitsEntry {
    /// Height that a map value of 1 stands for, m.
    pub height_range_m: f32,
    /// Range of wetness maps.
    pub wetness: String,
    /// POV-Ray units per metre.
    pub pov_units_per_m: f32,
}

/// One asset.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct AssetEntry {
    /// Name.
    pub id: String,
    /// plant, terrain, cloud, tracks, import.
    pub kind: String,
    /// Prim path in its payload.
    pub prim: String,
    /// Files of this asset alone, sequences with `####`.
    pub files: Vec<String>,
    /// Vertices of its meshes at rest.
    pub vertices: usize,
    /// Triangles of its meshes at rest.
    pub triangles: usize,
    /// Instances.
    pub instances: usize,
    /// Joints.
    pub joints: usize,
    /// Box at rest, asset space, m.
    pub bounds: [[f32; 3]; 2],
}

/// One material.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MaterialEntry {
    /// Name.
    pub name: String,
    /// bark, leaf, catkin, water, ground.
    pub class: String,
    /// Pictures by slot.
    pub slots: std::collections::BTreeMap<String, String>,
    /// EXR maps by map, numbers as `####`.
    pub maps: std::collections::BTreeMap<String, String>,
    /// Leaves with maps of their own.
    pub leaf_ids: Vec<String>,
    /// Numbers.
    pub params: ParamsEntry,
}

/// Numbers of a material.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ParamsEntry {
    /// Linear.
    pub base_color: [f32; 3],
    /// 0 mirror .. 1 matt.
    pub roughness: f32,
    /// Index of refraction.
    pub ior: f32,
    /// 0..1.
    pub translucency: f32,
    /// Cut out below this alpha.
    pub alpha_cutoff: Option<f32>,
    /// m.
    pub height_range_m: f32,
    /// m.
    pub tile_m: f32,
}

/// A file or a sequence.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum FileEntry {
    /// Numbered files.
    Sequence {
        /// With `####`.
        path: String,
        /// Kind of each.
        kind: String,
        /// First and last frame.
        frames: [u32; 2],
        /// Of all.
        bytes: u64,
        /// In frame order.
        items: Vec<ItemEntry>,
    },
    /// One file.
    Single {
        /// Relative, with `/`.
        path: String,
        /// Kind.
        kind: String,
        /// Length.
        bytes: u64,
        /// 64 hex digits.
        blake3: String,
    },
}

/// One file of a sequence.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ItemEntry {
    /// Frame number.
    pub frame: u32,
    /// Length.
    pub bytes: u64,
    /// 64 hex digits.
    pub blake3: String,
}

/// Something that was repaired on the way out.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct WarningEntry {
    /// Stable code.
    pub code: String,
    /// What.
    pub message: String,
}

impl Manifest {
    /// JSON text: two spaces, LF, one at the end.
    /// # Errors
    /// X001 for a number that is not finite, which JSON would lose.
    pub fn text(&self) -> Result<String> {
        let numbers = |m: &MaterialEntry| {
            let p = &m.params;
            let [r, g, b] = p.base_color;
            [r, g, b, p.roughness, p.ior, p.translucency, p.alpha_cutoff.unwrap_or(0.0), p.height_range_m, p.tile_m]
        };
        let bounds = self.assets.iter().flat_map(|a| a.bounds.into_iter().flatten());
        if !bounds.chain(self.materials.iter().flat_map(numbers)).all(f32::is_finite) {
            return Err(osier_base::Error::export("X001", "the manifest would hold a number that is not finite"));
        }
        let failed = |e: serde_json::Error| osier_base::Error::export("X001", format!("the manifest: {e}"));
        let mut text = serde_json::to_string_pretty(self).map_err(failed)?;
        text.push('\n');
        Ok(text)
    }

    /// Every file with its hash, in path order, sequences taken apart.
    pub fn expanded(&self) -> Vec<(String, u64, String)> {
        let mut all = Vec::new();
        for file in &self.files {
            match file {
                FileEntry::Single { path, bytes, blake3, .. } => all.push((path.clone(), *bytes, blake3.clone())),
                FileEntry::Sequence { path, items, .. } => {
                    let name = |f: u32| path.replacen("####", &format!("{f:0width$}", width = self.time.digits), 1);
                    all.extend(items.iter().map(|i| (name(i.frame), i.bytes, i.blake3.clone())));
                }
            }
        }
        all.sort();
        all
    }
}

/// Writes the manifest into the folder, as its last file.
/// # Errors
/// X001, and whatever the folder refuses.
pub fn write(folder: &Folder, manifest: &Manifest) -> Result<()> {
    folder.write(MANIFEST, "manifest", manifest.text()?.as_bytes())
}

/// BLAKE3 of the lines `path NUL hex LF`.
fn bake_hash(files: &[(String, u64, String)]) -> String {
    let mut hasher = blake3::Hasher::new();
    for (path, _, hex) in files {
        hasher.update(path.as_bytes()).update(b"\0").update(hex.as_bytes()).update(b"\n");
    }
    hasher.finalize().to_hex().to_string()
}
