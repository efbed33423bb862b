//! USD: a text wrapper with a crate file per asset as payloads, or the whole scene in one file.
//!
//! The writers of prims (meshes, skeletons, instancers, materials, camera and lights) call the trait `LayerWriter`, which a text
//! writer and a crate writer implement.
//!
//! ```
//! use osier_export::usd::{UpAxis, UsdOptions};
//!
//! // One package, in Blender's axes, without camera and lights.
//! let options = UsdOptions { up: UpAxis::Z, file: Some("oak.usdz".into()), look: false, ..UsdOptions::default() };
//! assert_eq!(options.tolerance.metres, 0.0, "samples of every frame");
//! ```

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

pub(crate) mod arrays;
mod asset;
mod byte_sink;
mod camera_light;
mod coat_primvar;
pub(crate) mod context;
mod growth_estimate;
pub(crate) mod instancer;
pub(crate) mod instancer_extent;
pub(crate) mod layer;
pub(crate) mod layer_writer;
mod material;
pub(crate) mod mesh;
pub(crate) mod options;
mod plant_instancer;
mod points;
mod primvar;
pub(crate) mod relief;
mod sample_reduction;
pub(crate) mod skel;
mod usda;
pub(crate) mod usdc;
mod usdz;
pub(crate) mod value;
mod volume;

pub use super::up_axis::UpAxis;
pub use options::{CopyStyle, Tolerance, UsdOptions};

use super::estimate::{AssetSize, EstimateInput};
use super::file_target::file_stem;
use super::format::{ExportJob, FormatInfo, TextureUse};
use super::textures::Textures;
use super::{Exporter, Summary, Warning, exr};
use byte_sink::{ByteSink, CountingSink};
use context::UsdContext;
use layer::{AnimatedPrim, AssetSample, LayerBuilder, MaterialBinding};
use layer_writer::{CompositionArc, LayerMetadata, LayerWriter, PrimMetadata};
use osier_base::files::safe_name;
use osier_base::files::{Folder, Output};
use osier_base::geometry::Bounds;
use osier_base::{Error, Result};
use osier_scene::{AssetFrame, AssetKind, Frame, PixelFootprint, Scene, asset_bounds};
use plant_instancer::{PrototypePrim, SinglePlacement};

/// Path of the stage that holds each asset of a bake once, without placements.
pub const ASSET_STAGE: &str = "usd/assets.usda";
/// Name of the prim of a prototype's hairs.
pub(crate) const HAIRS: &str = "hairs";

/// Registry entry of USD: a bake is a text layer with crate files as payloads.
pub const FORMAT: FormatInfo = FormatInfo {
    word: "usd",
    about: "USD: a root layer (.usda) and a payload (.usdc) per asset; animated",
    folder: "usd",
    names_assets: true,
    notes_missing_files: false,
    endings: &[("usda", "USD as text"), ("usdc", "USD, binary"), ("usdz", "USD with pictures in one file")],
    pictures_beside: true,
    textures: TextureUse::Written,
    memory_percent: 7,
    estimate,
    open: open_exporters,
};

/// Opens the writer of a bake, or that of a single file, which has no animation, camera and lights.
fn open_exporters(job: &ExportJob) -> Vec<Box<dyn Exporter>> {
    let bake = &job.options.usd;
    let options = match job.file {
        None => bake.clone(),
        Some(name) => UsdOptions { up: bake.up, file: Some(name.to_owned()), look: false, ..UsdOptions::default() },
    };
    vec![Box::new(UsdExporter::new(job.folder.clone(), Arc::clone(&job.textures), options))]
}

/// Bytes of an asset's file besides its geometry: materials and the names of prims. Own: measured, as are the constants
/// below.
const ASSET_BYTES: u64 = 6_000;
/// Bytes of a point of a cloud: position and colour; ids and equal widths take next to nothing.
const POINT_BYTES: u64 = 24;
/// Bytes of a moving point in a frame: position and velocity; widths and colours take little, as they are equal or seldom change.
const POINT_SAMPLE_BYTES: u64 = 26;
/// Bytes of a point of a hair: position, width, and its share of the texture coordinate of the curve.
const HAIR_POINT_BYTES: u64 = 16;
/// Bytes of a catkin in a frame: position, orientation in half precision and two velocities; in its point twin position, velocity and
/// orientation in full precision. States and numbers, which seldom change, take little.
const TRACKED_SAMPLE_BYTES: u64 = 44 + 45;
/// Bytes in a frame of an instance of a leaf over a year: numbers of the invisible ones, and what moves while leaves unfold and fall.
/// Measured on five plants, 17 to 22: most instances, one for each look of a leaf, change their visibility alone.
const SEASON_SAMPLE_BYTES: u64 = 22;
/// Bytes of a sample of a leaf in the wind: its position and orientation.
const LEAF_SAMPLE_BYTES: f64 = 20.0;
/// Mean bytes of the samples of a leaf per frame in calm air.
const CALM_LEAF_BYTES: f64 = 0.9;
/// Additional mean bytes per m/s of wind: the faster leaves flutter, the fewer samples interpolation can replace.
const LEAF_BYTES_PER_SPEED: f64 = 1.6;

/// Estimate from bytes per vertex, triangle, instance and time sample in crate files, whose index arrays are compressed.
fn estimate(input: &EstimateInput) -> u64 {
    let frames = input.frames;
    let growing = growth_estimate::growth_sample_bytes(input);
    let of_asset = |(i, a): (usize, &AssetSize)| {
        let vertices = a.vertices + a.drawn_vertices;
        // Most points have two joints with weights, which are equal along a branch.
        let skinned = if a.joints > 0 { a.vertices * 3 } else { 0 };
        let still = vertices * 26 + skinned + (a.triangles + a.drawn_triangles) * 4 + a.instances * 40 + ASSET_BYTES;
        let hairs = a.hair_points * HAIR_POINT_BYTES;
        // Plants on rods: points of the bark, leaves with two velocities.
        let deforms = a.deforming_vertices > 0 && a.joints == 0;
        // Leaves that seasons change are the only free instances of a plant without joints that does not grow.
        let is_plant = input.scene.assets.get(i).is_some_and(|asset| asset.kind == AssetKind::Plant);
        let instance = match (deforms, is_plant && a.joints == 0) {
            (true, _) => 44,
            (false, true) => SEASON_SAMPLE_BYTES,
            (false, false) => 124,
        };
        let deformed = if deforms { a.deforming_vertices * 12 * frames } else { 0 };
        // For growing plants, the samples that interpolation does not restore.
        let followed = a.tracked_instances * TRACKED_SAMPLE_BYTES;
        let tracked = || ((a.free_instances - a.tracked_instances) * instance + followed) * frames + deformed;
        let tracks = growing[i].unwrap_or_else(tracked) + a.moving_curve_points * 12 * frames;
        let leaf = (CALM_LEAF_BYTES + LEAF_BYTES_PER_SPEED * input.wind_speed).min(LEAF_SAMPLE_BYTES);
        let leaves = growth_estimate::whole(leaf * (a.posed_frames(frames) * a.instances) as f64);
        let posed = a.posed_frames(frames) * (a.deforming_vertices * 24 + a.joints * 34) + leaves;
        // Points, normals, velocities, indices and attributes of meshes that frames contain completely: measured on
        // drops.
        let varying = a.varying_vertices * frames * 46;
        let points = a.points * POINT_BYTES + a.moving_points * frames * POINT_SAMPLE_BYTES;
        a.weight * (still + hairs + tracks + varying + points + posed)
    };
    input.assets.iter().enumerate().map(of_asset).sum()
}

/// A layer that is open during the clip and takes the time samples of its prims.
struct OpenLayer {
    layer: LayerBuilder,
    /// Index of the asset whose payload it is.
    payload_of: Option<usize>,
    /// Prims with time samples, each with the index of its asset.
    animated: Vec<(usize, Box<dyn AnimatedPrim>)>,
    /// The first error in a frame, kept here because layers are written in parallel.
    failed: Option<Error>,
}

/// Writes a scene as USD: a wrapper with a payload for each asset, or one file, as [`UsdOptions::file`] says.
pub struct UsdExporter {
    folder: Folder,
    textures: Arc<Textures>,
    options: UsdOptions,
    cx: Option<UsdContext>,
    layers: Vec<OpenLayer>,
    /// Numbers of the frames written so far.
    frames: Vec<u32>,
    warnings: Vec<Warning>,
}

impl UsdExporter {
    /// An exporter into a folder. Textures go into the folder's `textures/`; those of a single file into the package, or into a
    /// folder beside the file.
    pub fn new(folder: Folder, textures: Arc<Textures>, options: UsdOptions) -> Self {
        Self { folder, textures, options, cx: None, layers: Vec::new(), frames: Vec::new(), warnings: Vec::new() }
    }

    /// Begins a crate file per asset, and one with the point twins of its tracked instancers.
    fn begin_payloads(&mut self, cx: &UsdContext) -> Result<()> {
        for (i, asset) in cx.scene.assets.iter().enumerate() {
            let name = safe_name(&asset.id);
            let root = format!("/{name}");
            // A payload that an interrupted bake has left complete is not written again. The wrapper needs its bindings
            // and bounds, so its prims go to a sink that discards the bytes.
            let sink: Box<dyn ByteSink> = match self.folder.create(&format!("usd/{name}.usdc"), "usdc", None)? {
                Some(out) => Box::new(out),
                None => Box::new(CountingSink::default()),
            };
            let mut layer = begin_layer(cx, Box::new(usdc::UsdcWriter::new(sink)), &name)?;
            layer.writer.define_prim(
                &root,
                "Xform",
                &PrimMetadata { kind: Some("component"), ..PrimMetadata::default() },
            )?;
            let animated = asset::define_asset(cx, &mut layer, &root, i)?;
            self.push_layer(layer, Some(i), animated.into_iter().map(|p| (i, p)).collect());
            if !asset.instancers.iter().any(|x| x.tracked) {
                continue;
            }
            if let Some(out) = self.folder.create(&format!("usd/{name}.points.usdc"), "usdc.points", None)? {
                let mut layer = begin_layer(cx, Box::new(usdc::UsdcWriter::new(Box::new(out))), &name)?;
                layer.writer.define_prim(
                    &root,
                    "Xform",
                    &PrimMetadata { kind: Some("component"), ..PrimMetadata::default() },
                )?;
                let animated = asset::define_point_twins(cx, &mut layer, &root, asset)?;
                self.push_layer(layer, None, animated.into_iter().map(|p| (i, p)).collect());
            }
        }
        Ok(())
    }

    fn push_layer(
        &mut self,
        layer: LayerBuilder,
        payload_of: Option<usize>,
        animated: Vec<(usize, Box<dyn AnimatedPrim>)>,
    ) {
        self.layers.push(OpenLayer { layer, payload_of, animated, failed: None });
    }

    /// Begins the single file that has the whole scene in one layer: the first prim of an asset has its contents, the others
    /// refer to that prim.
    fn begin_single(&mut self, cx: &UsdContext, file: &str) -> Result<()> {
        let kind = single_file_kind(file);
        let Some(out) = self.folder.create(file, kind, None)? else { return Ok(()) };
        let scene = safe_name(&cx.scene.name);
        let writer: Box<dyn LayerWriter> = match kind {
            "usda" => Box::new(usda::UsdaWriter::new(Box::new(out))),
            "usdz" => Box::new(usdc::UsdcWriter::new(Box::new(self.usdz_sink(cx, out, &format!("{scene}.usdc"))?))),
            _ => Box::new(usdc::UsdcWriter::new(Box::new(out))),
        };
        let mut layer = begin_layer(cx, writer, &scene)?;
        let root = format!("/{scene}");
        layer.writer.define_prim(
            &root,
            "Xform",
            &PrimMetadata { kind: Some("assembly"), ..PrimMetadata::default() },
        )?;
        // Placements that are separate prims come first, then the prototypes of plants with copies. `finish` writes the instances
        // and extents of the copies, when the bounds over the clip are known.
        let mut animated = Vec::new();
        let mut first: BTreeMap<usize, String> = BTreeMap::new();
        let shared = instanceable_assets(&cx.scene);
        let plan = plant_instancer::plan_placements(&cx.scene, &root, self.options.copies == CopyStyle::Instancer);
        for single in &plan.singles {
            let SinglePlacement { path, placement } = single;
            let target = AssetPrimContents {
                asset: placement.asset,
                phase: placement.phase,
                may_share: shared.contains(&placement.asset),
                kind: Some("component"),
            };
            animated.extend(define_or_reference_asset(cx, &mut layer, path, target, &mut first)?);
            layer.set_xform_ops(path, &cx.up.stage_trs(&placement.transform))?;
        }
        for group in &plan.instancers {
            group.define(&mut layer)?;
            for PrototypePrim { prototype, path } in &group.prototypes {
                let target =
                    AssetPrimContents { asset: prototype.asset, phase: prototype.phase, may_share: false, kind: None };
                animated.extend(define_or_reference_asset(cx, &mut layer, path, target, &mut first)?);
            }
        }
        if self.options.look {
            camera_light::define_camera_and_lights(cx, &mut layer, &root, self.options.aspect, None)?;
        }
        self.push_layer(layer, None, animated);
        if kind != "usdz" {
            let folder = cx.pictures.strip_prefix("./").unwrap_or(&cx.pictures);
            self.textures.write(&cx.scene, &self.folder, folder)?;
        }
        Ok(())
    }

    /// The sink of a package's root layer, with all textures as further members.
    fn usdz_sink(&self, cx: &UsdContext, out: Output, root: &str) -> Result<usdz::UsdzWriter> {
        let member = |(image, bytes): (&osier_scene::Image, &Arc<[u8]>)| usdz::UsdzMember {
            name: format!("textures/{}.png", image.name),
            bytes: Arc::clone(bytes),
        };
        let members = cx.scene.images.iter().zip(self.textures.iter()).map(member).collect();
        usdz::UsdzWriter::new(out, root, members)
    }

    /// Writes the wrapper: payloads of the placements, instancers of the plants with copies, one scope of materials, camera and
    /// lights.
    fn write_scene_layer(&self, cx: &UsdContext, written: &PayloadSummary) -> Result<()> {
        if self.options.look {
            exr::write_sky(&self.folder, &cx.scene)?;
        }
        let scene = safe_name(&cx.scene.name);
        let Some(out) = self.folder.create(&format!("{scene}.usda"), "usda.wrapper", None)? else { return Ok(()) };
        // The wrapper is in the output folder itself, the payloads are in a subfolder: texture paths in the wrapper
        // differ from theirs.
        let cx = &UsdContext { pictures: "./textures/".to_owned(), maps: None, ..cx.clone() };
        let mut layer = begin_layer(cx, Box::new(usda::UsdaWriter::new(Box::new(out))), &scene)?;
        let root = format!("/{scene}");
        layer.writer.define_prim(
            &root,
            "Xform",
            &PrimMetadata { kind: Some("assembly"), ..PrimMetadata::default() },
        )?;
        let shared = instanceable_assets(&cx.scene);
        let plan = plant_instancer::plan_placements(&cx.scene, &root, self.options.copies == CopyStyle::Instancer);
        for single in &plan.singles {
            let SinglePlacement { path, placement } = single;
            let Some(payload) = payload_arc(cx, placement.asset, placement.phase, "./usd/") else { continue };
            let instanceable = shared.contains(&placement.asset);
            let meta = PrimMetadata {
                kind: Some("component"),
                instanceable,
                payload: Some(payload),
                ..PrimMetadata::default()
            };
            layer.writer.define_prim(path, "Xform", &meta)?;
            layer.set_xform_ops(path, &cx.up.stage_trs(&placement.transform))?;
            if !instanceable {
                bind_shared_materials(cx, &mut layer, &root, path, written.bindings(placement.asset))?;
            }
        }
        for group in &plan.instancers {
            group.define(&mut layer)?;
            for PrototypePrim { prototype, path } in &group.prototypes {
                let Some(payload) = payload_arc(cx, prototype.asset, prototype.phase, "./usd/") else { continue };
                // A prototype takes its type from the payload.
                layer.writer.define_prim(
                    path,
                    "",
                    &PrimMetadata { payload: Some(payload), ..PrimMetadata::default() },
                )?;
                bind_shared_materials(cx, &mut layer, &root, path, written.bindings(prototype.asset))?;
            }
            group.write_instance_arrays(cx, &mut layer, &written.clip_bounds)?;
        }
        if self.options.volumes {
            volume::define_volumes(cx, &mut layer, &root, &self.frames)?;
        }
        if self.options.look {
            let sky = format!("./{}", exr::SKY_FILE);
            camera_light::define_camera_and_lights(cx, &mut layer, &root, self.options.aspect, Some(&sky))?;
        }
        layer.writer.finish()
    }

    /// Writes the stage that shows each asset once, at the origin, for importers that place copies by the manifest: a root prim
    /// with the payload of each asset, under the path that it has in its payload.
    fn write_asset_library(&self, cx: &UsdContext) -> Result<()> {
        let Some(first) = cx.scene.assets.first() else { return Ok(()) };
        let Some(out) = self.folder.create(ASSET_STAGE, "usda.assets", None)? else { return Ok(()) };
        let mut layer = begin_layer(cx, Box::new(usda::UsdaWriter::new(Box::new(out))), &safe_name(&first.id))?;
        for (i, asset) in cx.scene.assets.iter().enumerate() {
            let payload = payload_arc(cx, i, 0, "./");
            let meta = PrimMetadata { kind: Some("component"), payload, ..PrimMetadata::default() };
            layer.writer.define_prim(&format!("/{}", safe_name(&asset.id)), "Xform", &meta)?;
        }
        layer.writer.finish()
    }

    /// Warns (X002) of skeletons with more joints than readers handle well.
    fn warn_joint_count(&mut self, scene: &Scene) {
        for asset in &scene.assets {
            let joints = asset.skeleton.as_ref().map_or(0, |s| s.joints.len());
            if joints > skel::MAX_JOINTS && asset.meshes.iter().any(|m| skel::is_skinned(asset, m)) {
                let message =
                    format!("asset {}: {joints} joints, more than {}: readers may be slow", asset.id, skel::MAX_JOINTS);
                self.warnings.push(Warning { code: "X002", message });
            }
        }
    }
}

fn begin_layer(cx: &UsdContext, writer: Box<dyn LayerWriter>, default_prim: &str) -> Result<LayerBuilder> {
    let mut layer = LayerBuilder::new(writer);
    layer.writer.begin(&LayerMetadata::for_scene(&cx.scene, default_prim, cx.up))?;
    Ok(layer)
}

/// Whether a placement of an asset has a phase above 0, so that samples beyond the end of the clip are read.
fn has_phase_offset(scene: &Scene, asset: usize) -> bool {
    scene.placements.iter().any(|p| p.asset == asset && p.phase > 0)
}

/// Static assets with several placements, whose prims become instanceable. Animated ones do not: Blender reads their frames by
/// the names that USD generates for the prototypes of instances, and those names change whenever the file is opened.
fn instanceable_assets(scene: &Scene) -> BTreeSet<usize> {
    let (mut seen, mut shared) = (BTreeSet::new(), BTreeSet::new());
    for p in &scene.placements {
        if !seen.insert(p.asset) && scene.assets.get(p.asset).is_some_and(|a| !a.moves()) {
            shared.insert(p.asset);
        }
    }
    shared
}

/// Results of the payloads from which the wrapper is written.
#[derive(Debug, Default)]
struct PayloadSummary {
    /// Box of each asset over all frames, in the asset's space with the stage's axes.
    clip_bounds: Vec<Bounds>,
    /// Material bindings of each asset's payload.
    bindings: Vec<Vec<MaterialBinding>>,
}

impl PayloadSummary {
    /// Gathers the bounds from the prims of all layers, and the bindings from the payloads.
    fn of(cx: &UsdContext, layers: &[OpenLayer]) -> Self {
        let rest = |asset| plant_instancer::stage_bounds(cx.up, &asset_bounds(asset, &AssetFrame::default()));
        let mut clip_bounds: Vec<Bounds> = cx.scene.assets.iter().map(rest).collect();
        for (asset, prim) in layers.iter().flat_map(|l| &l.animated) {
            if let Some(b) = clip_bounds.get_mut(*asset) {
                *b = b.union(prim.clip_bounds());
            }
        }
        let mut bindings = vec![Vec::new(); cx.scene.assets.len()];
        for layer in layers {
            if let Some(list) = layer.payload_of.and_then(|asset| bindings.get_mut(asset)) {
                *list = layer.layer.bindings().to_vec();
            }
        }
        Self { clip_bounds, bindings }
    }

    /// Material bindings in the payload of an asset, in the order in which they were made; empty for
    /// a payload that was not written.
    fn bindings(&self, asset: usize) -> &[MaterialBinding] {
        self.bindings.get(asset).map_or(&[], Vec::as_slice)
    }
}

/// Contents of a prim in a single file: an asset or a reference to it.
struct AssetPrimContents {
    /// Index in the scene's assets.
    asset: usize,
    /// Frames by which its motion is ahead of the clip.
    phase: u32,
    /// Whether a reference to the asset may be instanceable.
    may_share: bool,
    /// Model kind in the prim's metadata; `None` for prototypes.
    kind: Option<&'static str>,
}

/// Defines the prim at `path` with the contents of an asset, or with a reference to the prim that has them. `first`: the prims
/// with contents so far, by asset. Returns the prims that take time samples, with the index of the asset.
fn define_or_reference_asset(
    cx: &UsdContext,
    layer: &mut LayerBuilder,
    path: &str,
    target: AssetPrimContents,
    first: &mut BTreeMap<usize, String>,
) -> Result<Vec<(usize, Box<dyn AnimatedPrim>)>> {
    let known = first.get(&target.asset).cloned();
    let is_defined = known.is_some();
    let reference = known.map(|prim| CompositionArc { asset: String::new(), prim, phase: target.phase });
    let meta = PrimMetadata {
        kind: target.kind,
        instanceable: is_defined && target.may_share,
        reference,
        ..PrimMetadata::default()
    };
    layer.writer.define_prim(path, "Xform", &meta)?;
    if is_defined {
        return Ok(Vec::new());
    }
    first.insert(target.asset, path.to_owned());
    let animated = asset::define_asset(cx, layer, path, target.asset)?;
    Ok(animated.into_iter().map(|prim| (target.asset, prim)).collect())
}

/// The arc to the payload of an asset, `phase` frames ahead; `None` without such an asset. `folder`: of the
/// payloads, relative to the layer.
fn payload_arc(cx: &UsdContext, asset: usize, phase: u32, folder: &str) -> Option<CompositionArc> {
    let name = safe_name(&cx.scene.assets.get(asset)?.id);
    Some(CompositionArc { asset: format!("{folder}{name}.usdc"), prim: format!("/{name}"), phase })
}

/// Binds the prims of the payload at `path` to materials below the scene's root. Readers such as Blender create a material for
/// each one that is bound: the payloads then share them. Coated materials, whose maps change, remain in the payload, as do
/// those of prims inside variants.
fn bind_shared_materials(
    cx: &UsdContext,
    layer: &mut LayerBuilder,
    root: &str,
    path: &str,
    bindings: &[MaterialBinding],
) -> Result<()> {
    let own = |b: &MaterialBinding| {
        b.prim.contains('{') || cx.scene.materials.get(b.material as usize).is_none_or(|m| m.coat.is_some())
    };
    // Materials of the payload to which none of its prims is bound any more need not be composed.
    let kept: BTreeSet<u32> = bindings.iter().filter(|b| own(b)).map(|b| b.material).collect();
    let inactive = |layer: &mut LayerBuilder, path: &str| {
        let meta = PrimMetadata { over: true, inactive: true, ..PrimMetadata::default() };
        layer.writer.define_prim(path, "", &meta)
    };
    let scope = format!("{path}/mtl");
    if kept.is_empty() && !bindings.is_empty() {
        inactive(layer, &scope)?;
    } else if bindings.iter().any(|b| !kept.contains(&b.material)) {
        layer.writer.define_prim(&scope, "", &PrimMetadata { over: true, ..PrimMetadata::default() })?;
        let mut unused: Vec<u32> = bindings.iter().map(|b| b.material).filter(|m| !kept.contains(m)).collect();
        unused.sort_unstable();
        unused.dedup();
        for name in unused.iter().filter_map(|m| Some(&cx.scene.materials.get(*m as usize)?.name)) {
            inactive(layer, &format!("{scope}/{}", safe_name(name)))?;
        }
    }
    // Bindings share ancestors: define each ancestor once.
    let mut defined = BTreeSet::new();
    for MaterialBinding { prim, material } in bindings.iter().filter(|b| !own(b)) {
        // A path of the payload begins with its root prim, which the prim at `path` replaces here; each prim on the way down
        // needs an `over`.
        let below: Vec<&str> = prim.split('/').skip(2).collect();
        let mut over = path.to_owned();
        for name in below {
            over = format!("{over}/{name}");
            if defined.insert(over.clone()) {
                layer.writer.define_prim(&over, "", &PrimMetadata { over: true, ..PrimMetadata::default() })?;
            }
        }
        layer.bind_material(cx, root, &over, *material)?;
    }
    Ok(())
}

/// Form of a single file by its ending, in capitals or not: `usda`, `usdz`, else `usdc`.
fn single_file_kind(file: &str) -> &'static str {
    let ending = file.rsplit_once('.').map(|(_, ending)| ending.to_ascii_lowercase());
    match ending.as_deref() {
        Some("usda") => "usda",
        Some("usdz") => "usdz",
        _ => "usdc",
    }
}

/// Folder of the textures, relative to the layers that refer to them.
fn texture_folder(options: &UsdOptions) -> String {
    match &options.file {
        None => "../textures/".to_owned(),
        Some(file) if single_file_kind(file) == "usdz" => "./textures/".to_owned(),
        Some(file) => format!("./{}_files/", file_stem(file)),
    }
}

impl Exporter for UsdExporter {
    fn begin(&mut self, scene: &Arc<Scene>) -> Result<()> {
        // A single file has no maps beside it.
        let maps = (self.options.maps && self.options.file.is_none()).then(|| "../maps/".to_owned());
        let cx = UsdContext {
            scene: Arc::clone(scene),
            up: self.options.up,
            pictures: texture_folder(&self.options),
            maps,
            first: self.options.first.unwrap_or(scene.clip.start),
            tolerance: self.options.tolerance,
            pixels: Arc::new(PixelFootprint::of_assets(scene)),
            reliefs: Arc::new(relief::relief_heights(scene)),
        };
        self.warn_joint_count(scene);
        match self.options.file.clone() {
            Some(file) => self.begin_single(&cx, &file)?,
            None => {
                self.textures.write(scene, &self.folder, "textures/")?;
                self.begin_payloads(&cx)?;
            }
        }
        self.cx = Some(cx);
        Ok(())
    }

    fn frame(&mut self, frame: &Frame) -> Result<()> {
        let Some(cx) = &self.cx else { return Ok(()) };
        let time = f64::from(frame.number);
        self.frames.push(frame.number);
        osier_base::par::par_each(&mut self.layers, |layer| {
            let OpenLayer { layer, animated, failed, .. } = layer;
            for (i, prim) in animated {
                let Some((asset, state)) = cx.scene.assets.get(*i).zip(frame.assets.get(*i)) else { continue };
                if let Err(e) = prim.sample_frame(cx, layer, &AssetSample { asset, state, time, maps: &frame.maps }) {
                    *failed = Some(e);
                    return;
                }
            }
            if let Err(e) = layer.sample_map_textures(cx, frame.number) {
                *failed = Some(e);
            }
        });
        self.layers.iter_mut().find_map(|l| l.failed.take()).map_or(Ok(()), Err)
    }

    fn finish(&mut self) -> Result<Summary> {
        let Some(cx) = self.cx.clone() else { return Ok(Summary::default()) };
        let written = PayloadSummary::of(&cx, &self.layers);
        if self.options.file.is_some()
            && let Some(open) = self.layers.first_mut()
        {
            let root = format!("/{}", safe_name(&cx.scene.name));
            let plan = plant_instancer::plan_placements(&cx.scene, &root, self.options.copies == CopyStyle::Instancer);
            plan.instancers
                .iter()
                .try_for_each(|group| group.write_instance_arrays(&cx, &mut open.layer, &written.clip_bounds))?;
        }
        // A layer that some placement shows at a phase is read beyond the end of the clip, so its samples repeat once.
        for OpenLayer { layer, animated, .. } in &mut self.layers {
            animated.iter_mut().try_for_each(|(_, prim)| prim.flush_samples(layer))?;
            if let Some(scene) = self.cx.as_ref().map(|cx| &cx.scene)
                && animated.iter().any(|(asset, _)| has_phase_offset(scene, *asset))
            {
                layer.writer.repeat_clip_once(scene.clip.len() as f64);
            }
            layer.writer.finish()?;
        }
        self.layers.clear();
        if self.options.file.is_none() {
            self.write_scene_layer(&cx, &written)?;
            self.write_asset_library(&cx)?;
        }
        Ok(Summary { warnings: std::mem::take(&mut self.warnings) })
    }
}
