//! `manifest.json`: the contents of a bake. It is written last: its presence marks a complete bake.
//!
//! ```
//! let settings = osier_export::manifest::Settings::default();
//! assert_eq!((settings.up_axis.as_str(), settings.step), ("Y", 1));
//! ```

mod build;
mod leaves;
mod places;
mod settings;
mod verify;
mod view;

pub use build::build;
pub use leaves::write_leaves;
pub use places::{MAX_LISTED_PLACES, PLACES_FILE, write_places};
pub use settings::Settings;
pub use verify::{Verification, verify};

use serde::{Deserialize, Serialize};

use crate::gltf::{Profile, scene_stem};
use osier_base::Result;
use osier_base::files::{Folder, MANIFEST};

/// The contents of `manifest.json`; the order of the fields is that of the keys.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Manifest {
    /// Version of this layout, increased by incompatible changes.
    pub schema: u32,
    /// Name of the program, `osier`.
    pub generator: String,
    /// Version of the program that wrote the bake.
    pub version: String,
    /// Identity of the baked scene.
    pub scene: SceneEntry,
    /// Seed as a decimal string, as JSON numbers are exact up to 2^53 only.
    pub seed: String,
    /// Up axis of the USD files, `Y` or `Z`.
    pub up_axis: String,
    /// Metres per unit of the USD files; this version writes 1.
    pub meters_per_unit: f64,
    /// Frames and samples of the clip.
    pub time: TimeEntry,
    /// Units of maps and of POV-Ray scenes.
    pub units: UnitsEntry,
    /// Path of the USD stage that holds each asset once, without placements; null without USD.
    #[serde(default)]
    pub stage: Option<String>,
    /// Camera, light and display; `None` in manifests of earlier versions.
    #[serde(default)]
    pub view: Option<ViewEntry>,
    /// Assets in the order of the scene.
    pub assets: Vec<AssetEntry>,
    /// Transforms of the placements, as lists or as the path of a table.
    #[serde(default)]
    pub places: PlacesEntry,
    /// Materials in the order of the scene.
    pub materials: Vec<MaterialEntry>,
    /// Files in the order of their paths, numbered ones as sequences.
    pub files: Vec<FileEntry>,
    /// BLAKE3 of the lines `path NUL hex LF` of all files in the order of their paths.
    pub bake_hash: String,
    /// Warnings of growth, wind and simulation, then those of the exporters in the order of the assets.
    pub warnings: Vec<WarningEntry>,
}

/// Name and hash of the resolved scene.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SceneEntry {
    /// Name of the scene, as in file names.
    pub name: String,
    /// BLAKE3 of the resolved scene and, of a part of its clip, of the frames that were written; 64 hex digits.
    pub hash: String,
}

/// The clip. Times of samples are f + k / substeps for the frames f.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TimeEntry {
    /// Frames per second, numerator and denominator.
    pub fps: [u32; 2],
    /// Number of the first frame, as in file names.
    pub start: u32,
    /// Number of the last frame, inclusive.
    pub end: u32,
    /// First and last frame that this bake wrote; `None` in manifests of earlier versions.
    #[serde(default)]
    pub written: Option<[u32; 2]>,
    /// Frames after which the motion repeats; `None` if it does not.
    #[serde(default, rename = "loop")]
    pub loop_frames: Option<u32>,
    /// Largest step that reaches all written frames from the first one, at least 1.
    pub step: u32,
    /// Time samples from one frame to the next, >= 1; this version writes 1.
    pub substeps: u32,
    /// Digits of frame numbers in file names, at least 4; `####` in a path represents as many.
    pub digits: usize,
}

/// Units of maps and of POV-Ray scenes, and how a closed film of water changes a surface.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct UnitsEntry {
    /// Height for the map value 1, m.
    pub height_range_m: f32,
    /// Range of wetness maps from dry to wet, as text: `0..1`.
    pub wetness: String,
    /// Units of the POV-Ray scene in one metre; at 100, a unit is a centimetre.
    pub pov_units_per_m: f32,
    /// Albedo where wetness is 1, as a share of that of the dry surface.
    pub wet_albedo: f32,
    /// Roughness where wetness is 1; a surface that is smoother than this when dry keeps its dry roughness.
    pub wet_roughness: f32,
}

/// Camera, light and display, in the scene's axes: +Y up, right-handed, metres, whatever the up axis of the USD files.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ViewEntry {
    /// The camera, which does not move.
    pub camera: CameraEntry,
    /// The sun as a parallel light; the sky excludes its disc.
    pub sun: SunEntry,
    /// Light of the sky without the sun's disc.
    pub sky: SkyEntry,
    /// Exposure, tone curve and shutter of pictures.
    pub look: LookEntry,
}

/// The camera: it looks along -Z of its space, +Y is up in the picture.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CameraEntry {
    /// World from camera, row vectors: the position is in elements 12 to 14.
    pub matrix: [f32; 16],
    /// Full vertical field of view, degrees.
    pub vfov_deg: f32,
    /// Distances of the near and far clipping planes, m.
    pub clip: [f32; 2],
    /// Width and height of the picture, pixels.
    pub size: [u32; 2],
}

/// The sun as a parallel light with an angular diameter.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SunEntry {
    /// Unit vector from the scene towards the sun.
    pub toward: [f32; 3],
    /// Linear RGB irradiance of a surface that faces the sun, W/m^2.
    pub irradiance: [f32; 3],
    /// Angular diameter, degrees.
    pub angle_deg: f32,
}

/// Light of the sky: a gradient from straight down to straight up, with a glow around the sun, seen through fog.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SkyEntry {
    /// Positions from 0, straight down, to 1, straight up, equally spaced in the sine of the elevation, with linear radiance.
    pub stops: Vec<(f32, [f32; 3])>,
    /// Linear radiance in the direction of the sun, without its disc; `None` without a glow.
    pub glow: Option<[f32; 3]>,
    /// Cosines of the angle to the sun with the share of the glow in the radiance there.
    pub glow_stops: Vec<(f32, f32)>,
    /// Fog; `None` for clear air.
    pub fog: Option<FogEntry>,
    /// Latitude-longitude picture of the sky without the sun's disc, EXR; `None` if it is not written.
    pub file: Option<String>,
}

/// Homogeneous fog, which blends distant objects into its colour.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FogEntry {
    /// Linear radiance that distant objects fade to.
    pub color: [f32; 3],
    /// Distance at which 2 % of a contrast remains, m.
    pub visibility: f32,
    /// Height at which a quarter of the density remains, m; 0: the same at all heights.
    pub height: f32,
}

/// How the camera exposes a frame: conversion of radiance to displayed values, and shutter.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LookEntry {
    /// Factor on radiance before the curve.
    pub exposure: f32,
    /// Displayed luminance by exposed luminance; colours are scaled with it.
    pub curve: CurveEntry,
    /// Fraction of the frame interval for which the shutter is open, 0 to 1.
    pub shutter: f32,
}

/// A quotient of two polynomials: coefficients of x^2, x and 1.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CurveEntry {
    /// Coefficients of x^2, x and 1 of the numerator; x is the exposed luminance.
    pub numerator: [f32; 3],
    /// Coefficients of x^2, x and 1 of the denominator.
    pub denominator: [f32; 3],
}

/// Placements of the assets, as lists in the manifest or as a table beside it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum PlacesEntry {
    /// Path of a table, written for more than [`MAX_LISTED_PLACES`] placements: see [`write_places`].
    Table(String),
    /// Placements by asset, in the order of the scene.
    Lists(std::collections::BTreeMap<String, Vec<PlaceEntry>>),
}

impl Default for PlacesEntry {
    fn default() -> Self {
        Self::Lists(std::collections::BTreeMap::new())
    }
}

/// One placement of an asset: its transform and the phase of its motion.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PlaceEntry {
    /// World from asset, row vectors, in the scene's axes: the position, m, is in elements 12 to 14.
    pub matrix: [f32; 16],
    /// Frames by which its motion is ahead of the clip.
    pub offset: u32,
}

/// An asset: its files, and counts of its elements.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct AssetEntry {
    /// Name of the asset, as in file names.
    pub id: String,
    /// One of the words plant, terrain, cloud, tracks, import.
    pub kind: String,
    /// Name of the plant that it is an individual of, as in file names: `grass` for `grass_1`; null for all but plants.
    #[serde(default)]
    pub plant: Option<String>,
    /// Material of its points that have no mesh; null without points.
    #[serde(default)]
    pub points_material: Option<String>,
    /// Materials of its curves, hairs of prototypes included, by the names of their prims; missing without curves.
    #[serde(default, skip_serializing_if = "std::collections::BTreeMap::is_empty")]
    pub curve_materials: std::collections::BTreeMap<String, String>,
    /// Prim path in its payload and in the stage of assets.
    pub prim: String,
    /// Files that hold this asset and no other, sequences with `####`.
    pub files: Vec<String>,
    /// Points of the meshes at rest, without those of instancers, clouds and curves.
    pub vertices: usize,
    /// Triangles of the meshes at rest, without those of instancers.
    pub triangles: usize,
    /// Number of instances of all instancers, alive or not.
    pub instances: usize,
    /// Number of joints of the skeleton; 0 without one.
    pub joints: usize,
    /// Lower and upper corner of the box at rest, in the asset's space, m.
    pub bounds: [[f32; 3]; 2],
    /// Colour and occlusion of the leaves at rest; missing without them or without USD.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub leaves: Option<LeavesEntry>,
}

/// Colour and occlusion of an asset's leaves: see [`write_leaves`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LeavesEntry {
    /// Path of the table of leaves, relative to the manifest.
    pub file: String,
    /// Names of the instancers in the order of the table.
    pub order: Vec<String>,
    /// Number of instances of each instancer in `order`, by its name.
    pub instancers: std::collections::BTreeMap<String, usize>,
    /// Whether leaves have colours of a season.
    pub color: bool,
    /// Whether leaves have the occlusion of their crown.
    pub occlusion: bool,
}

/// A material: paths of its textures and maps, and its shading parameters.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MaterialEntry {
    /// Name of the material, as in file names.
    pub name: String,
    /// One of the words bark, leaf, catkin, water, ground.
    pub class: String,
    /// Paths of textures by slot: color, height, normal, rough.
    pub slots: std::collections::BTreeMap<String, String>,
    /// Paths of EXR maps by map, frame numbers as `####`.
    pub maps: std::collections::BTreeMap<String, String>,
    /// Name of the map sequence of the coat, at most one; empty without a coat.
    pub leaf_ids: Vec<String>,
    /// Values that no texture gives, and scales of the textures.
    pub params: ParamsEntry,
}

/// Parameters of a material's shading model: values that no texture gives, and scales of the textures.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ParamsEntry {
    /// Linear RGB, 0 to 1.
    pub base_color: [f32; 3],
    /// GGX roughness, 0 (mirror) to 1 (matt).
    pub roughness: f32,
    /// Index of refraction, for the Fresnel reflectance and the refraction by water.
    pub ior: f32,
    /// Share of light that is transmitted diffusely, 0 to 1.
    pub translucency: f32,
    /// Alpha below which the surface is cut out; `None`: nothing is cut out.
    pub alpha_cutoff: Option<f32>,
    /// Height for the value 1 of the height map, m.
    pub height_range_m: f32,
    /// Side of a tile of the textures, m.
    pub tile_m: f32,
    /// Whether all meshes and points with the material have colours of their own, which multiply the colour of meshes and replace
    /// that of points.
    #[serde(default)]
    pub vertex_colors: bool,
    /// Albedo where the map of wetness is 1, as a share of that of the dry surface; absent where it is that of `units`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub wet_albedo: Option<f32>,
    /// Roughness where the map of wetness is 1; absent where it is that of `units`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub wet_roughness: Option<f32>,
}

/// A file, or a numbered sequence of files as one entry.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum FileEntry {
    /// A file for each of several frames.
    Sequence {
        /// Path with `####` for the frame number.
        path: String,
        /// Format and purpose of each file: `inc`, `exr.height`, ...
        kind: String,
        /// Numbers of the first and the last frame, inclusive; those between may have gaps.
        frames: [u32; 2],
        /// Sum of the sizes of all files, bytes.
        bytes: u64,
        /// The files in the order of frames.
        items: Vec<ItemEntry>,
    },
    /// A file without a frame number.
    Single {
        /// Path in the output folder, with `/`.
        path: String,
        /// Format and purpose: `usdc`, `png`, ...
        kind: String,
        /// Size of the file, bytes; checked together with the hash.
        bytes: u64,
        /// BLAKE3 of the file, 64 hex digits.
        blake3: String,
    },
}

/// A file of a sequence, whose path follows from that of the sequence and the frame.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ItemEntry {
    /// Frame of the clip; the file's name holds it padded with zeros (`Clip::tag`).
    pub frame: u32,
    /// Size of the file, bytes; checked together with the hash.
    pub bytes: u64,
    /// BLAKE3 of the file, 64 hex digits.
    pub blake3: String,
}

/// A warning of growth, wind and simulation, or of an exporter; see [`Warning`](crate::Warning).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct WarningEntry {
    /// Code, such as `X002`; docs/codes.md lists them.
    pub code: String,
    /// What was found and what was written instead, without the code.
    pub message: String,
}

impl Manifest {
    /// JSON text, indented by two spaces, with a line feed at the end.
    /// # Errors
    /// X001 for a number that is not finite, which JSON would lose.
    pub fn text(&self) -> Result<String> {
        let of_material = |m: &MaterialEntry| {
            let p = &m.params;
            let [r, g, b] = p.base_color;
            [r, g, b, p.roughness, p.ior, p.translucency, p.alpha_cutoff.unwrap_or(0.0), p.height_range_m, p.tile_m]
        };
        let bounds = self.assets.iter().flat_map(|a| a.bounds.into_iter().flatten());
        let places: Vec<&PlaceEntry> = match &self.places {
            PlacesEntry::Table(_) => Vec::new(),
            PlacesEntry::Lists(lists) => lists.values().flatten().collect(),
        };
        let places = places.into_iter().flat_map(|p| p.matrix);
        let view = self.view.iter().flat_map(ViewEntry::numbers);
        let mut numbers = bounds.chain(self.materials.iter().flat_map(of_material)).chain(places).chain(view);
        if !numbers.all(f32::is_finite) {
            return Err(osier_base::Error::export("X001", "the manifest would hold a number that is not finite"));
        }
        let failed = |e: serde_json::Error| osier_base::Error::export("X001", format!("the manifest: {e}"));
        let mut text = serde_json::to_string_pretty(self).map_err(failed)?;
        text.push('\n');
        Ok(text)
    }

    /// Path of the glTF file of the whole scene in a profile; `None` if the bake has none. Files of single assets have similar
    /// names.
    pub fn scene_glb(&self, profile: Profile) -> Option<String> {
        let stem = scene_stem(&self.scene.name, self.assets.iter().map(|a| a.id.as_str()));
        let wanted = format!("gltf/{stem}.{}.glb", profile.word());
        let is_written = |f: &FileEntry| matches!(f, FileEntry::Single { path, .. } if *path == wanted);
        self.files.iter().any(is_written).then_some(wanted)
    }

    /// Path, size and hash of every file, in the order of paths; sequences are expanded.
    pub fn expanded(&self) -> Vec<(String, u64, String)> {
        let mut all = Vec::new();
        for file in &self.files {
            match file {
                FileEntry::Single { path, bytes, blake3, .. } => all.push((path.clone(), *bytes, blake3.clone())),
                FileEntry::Sequence { path, items, .. } => {
                    // The inverse of grouping: the placeholder becomes the frame number with the digits of the bake.
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
