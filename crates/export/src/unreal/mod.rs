//! Plants for Unreal Engine: `unreal/PLANT.usdc`, a USD file with a Nanite assembly of skinned bark and leaves on joints, and
//! `unreal/PLANT.wind.json`, the settings of the engine's wind. Plants are at rest: the engine's wind moves them.
//!
//! ```
//! use osier_export::registry::by_word;
//!
//! assert_eq!(by_word("unreal").map(|f| f.folder), Some("unreal"));
//! ```

use std::sync::Arc;

mod joints;
mod leaves;
mod stage;
mod wind;

use super::estimate::EstimateInput;
use super::format::{FormatInfo, TextureUse};
use super::textures::Textures;
use super::up_axis::UpAxis;
use super::usd::Tolerance;
use super::usd::context::UsdContext;
use super::usd::relief::relief_heights;
use super::{Exporter, Summary, Warning};
use osier_base::files::{Folder, safe_name};
use osier_base::geometry::Bounds;
use osier_base::{Error, Result};
use osier_scene::{Asset, ClipChange, Frame, Instancer, RiggedPlant, Scene};

/// Bytes of a vertex in the files. Measured, like the next three, on birches, oaks and an acacia of 10 to 60 years.
const VERTEX: u64 = 29;
/// Bytes of a triangle.
const TRIANGLE: u64 = 4;
/// Bytes of a leaf.
const LEAF: u64 = 36;
/// Bytes of a joint.
const JOINT: u64 = 400;
/// Bytes of the prims of a twig of merged leaves. Measured, like the next one, on an oak of 137,661 leaves; values that
/// twigs have in common are written once.
const TWIG: u64 = 500;
/// Bytes of each vertex of such a twig.
const TWIG_VERTEX: u64 = 22;

/// Most plants that a warning names; further plants are only counted.
const NAMED_PLANTS: usize = 3;

/// Registry entry of Unreal Engine: two files per plant with a rig, at rest.
pub const FORMAT: FormatInfo = FormatInfo {
    word: "unreal",
    about: "Unreal Engine: a USD file per plant, a Nanite assembly with joints, and a JSON file of its wind",
    folder: "unreal",
    names_assets: true,
    // X025 tells which plants have no file.
    notes_missing_files: false,
    endings: &[],
    pictures_beside: false,
    textures: TextureUse::Written,
    memory_percent: 200,
    estimate,
    open: |job| vec![Box::new(UnrealExporter::new(job.folder.clone(), Arc::clone(&job.textures)))],
};

/// Estimate from bytes per vertex, triangle, leaf and joint.
fn estimate(input: &EstimateInput) -> u64 {
    let plants = input.scene.assets.iter().zip(input.assets);
    plants.map(|(asset, size)| asset.rigged.as_ref().map_or(0, |rig| size.weight * plant_bytes(rig))).sum()
}

/// Estimated bytes of the files of one plant, with twigs of merged leaves beyond the limit of parts.
fn plant_bytes(rig: &RiggedPlant) -> u64 {
    let prototypes = rig.instancers.iter().flat_map(|i| &i.prototypes).map(|p| &p.mesh);
    let meshes = rig.meshes.iter().map(|m| &m.mesh).chain(prototypes);
    let geometry: u64 = meshes.map(|m| VERTEX * m.points.len() as u64 + TRIANGLE * m.triangles.len() as u64).sum();
    let leaves: u64 = rig.instancers.iter().map(|i| i.len() as u64).sum();
    // Leaves beyond the limit of parts are merged: a twig of eight leaves saves seven parts.
    let (size, excess) = (leaves::TWIG as u64, leaves.saturating_sub(leaves::MAX_PARTS as u64));
    let prototypes: u64 = rig.instancers.iter().map(|i| i.prototypes.len() as u64).sum();
    let points: u64 = rig.instancers.iter().flat_map(|i| &i.prototypes).map(|p| p.mesh.points.len() as u64).sum();
    let twigs = excess / (size - 1) * (TWIG + TWIG_VERTEX * size * points / prototypes.max(1));
    twigs + geometry + LEAF * leaves + JOINT * rig.skeleton.joints.len() as u64
}

/// Writes each plant that has a rig for Unreal Engine, at rest; other assets are left out.
#[derive(Debug)]
pub struct UnrealExporter {
    folder: Folder,
    textures: Arc<Textures>,
    warnings: Vec<Warning>,
}

impl UnrealExporter {
    /// An exporter into a folder; textures go into its `textures/`.
    pub fn new(folder: Folder, textures: Arc<Textures>) -> Self {
        Self { folder, textures, warnings: Vec::new() }
    }

    /// Writes both files of a plant, unless an interrupted bake has left them complete.
    fn write_plant(&mut self, cx: &UsdContext, asset: &Asset, rig: &RiggedPlant) -> Result<()> {
        let name = safe_name(&asset.id);
        let joints = joints::WindJoints::new(rig)?;
        let wind = wind::Wind::new(&joints, height(rig));
        let parts = leaves::leaf_parts(&rig.instancers, &joints.carrier, leaves::MAX_PARTS)?;
        let leaves: usize = rig.instancers.iter().map(Instancer::len).sum();
        let written: usize = parts.iter().map(|p| p.joints.len()).sum();
        if leaves > written {
            let message = format!("asset {}: {leaves} leaves are merged into {written} parts of an assembly", asset.id);
            self.warnings.push(Warning { code: "X013", message });
        }
        if let Some(out) = self.folder.create(&format!("unreal/{name}.usdc"), "usdc.unreal", None)? {
            stage::write_stage(
                cx,
                out,
                &name,
                &stage::AssemblyInput { rig, joints: &joints, wind: &wind, parts: &parts },
            )?;
        }
        let mut text =
            serde_json::to_vec(&wind).map_err(|e| Error::io("write", format!("unreal/{name}.wind.json"), e.into()))?;
        text.push(b'\n');
        if let Some(mut out) = self.folder.create(&format!("unreal/{name}.wind.json"), "json.wind", None)? {
            out.put(&text)?;
            out.commit()?;
        }
        Ok(())
    }
}

/// X017 for growing plants and for plants whose leaves change, one warning per kind: the files show a single time of
/// the clip.
fn warn_of_changes(scene: &Scene) -> Vec<Warning> {
    let changes = [
        (ClipChange::Growth, "grow over the clip; format unreal has them grown up"),
        (ClipChange::Season, "change their leaves over the clip; format unreal has those of its first frame"),
    ];
    let warning = |(change, what): &(ClipChange, &str)| {
        let changing = scene.assets.iter().filter(|a| a.rigged.as_ref().is_some_and(|rig| rig.change == *change));
        let names: Vec<&str> = changing.map(|a| a.id.as_str()).collect();
        let (shown, more) = names.split_at(names.len().min(NAMED_PLANTS));
        let others = if more.is_empty() { String::new() } else { format!(" and {} more", more.len()) };
        let message = format!("plants {}{others} {what}, usd and glb have every frame", shown.join(", "));
        (!names.is_empty()).then_some(Warning { code: "X017", message })
    };
    changes.iter().filter_map(warning).collect()
}

/// Height of a plant at rest, m: of its wood and of the pivots of its leaves.
fn height(rig: &RiggedPlant) -> f32 {
    let wood = rig.meshes.iter().fold(Bounds::default(), |b, m| b.union(m.mesh.bounds()));
    let leaves = Bounds::of(rig.instancers.iter().flat_map(|i| i.rest.positions.iter().copied()));
    let all = wood.union(leaves);
    if all.is_empty() { 0.0 } else { all.size().y }
}

impl Exporter for UnrealExporter {
    fn begin(&mut self, scene: &Arc<Scene>) -> Result<()> {
        let cx = UsdContext {
            scene: Arc::clone(scene),
            up: UpAxis::Y,
            pictures: "../textures/".to_owned(),
            maps: None,
            first: scene.clip.start,
            tolerance: Tolerance::default(),
            pixels: Arc::default(),
            reliefs: Arc::new(relief_heights(scene)),
        };
        let mut plants = scene.assets.iter().filter_map(|a| a.rigged.as_ref().map(|rig| (a, rig))).peekable();
        if plants.peek().is_none() {
            let message = "the scene has no plants, and format unreal writes nothing else".to_owned();
            self.warnings.push(Warning { code: "X025", message });
            return Ok(());
        }
        self.textures.write(scene, &self.folder, "textures/")?;
        self.warnings.extend(warn_of_changes(scene));
        plants.try_for_each(|(asset, rig)| self.write_plant(&cx, asset, rig))
    }

    fn frame(&mut self, _: &Frame) -> Result<()> {
        Ok(())
    }

    fn finish(&mut self) -> Result<Summary> {
        Ok(Summary { warnings: std::mem::take(&mut self.warnings) })
    }
}
