//! USD: a text wrapper, one crate file per asset, packages.
//!
//! Everything is written once against `layer_writer::LayerWriter`, which has a text and a crate implementation.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

mod asset;
mod axis;
mod byte_sink;
mod camera_light;
mod instancer;
mod instancer_extent;
mod layer;
mod layer_writer;
mod material;
mod mesh;
pub(crate) mod options;
mod plant_instancer;
mod points;
mod sample_reduction;
mod skel;
mod usda;
mod usdc;
mod usdz;
mod value;
mod wetness_primvar;

pub use axis::UpAxis;
pub use options::{CopyStyle, Tolerance, UsdOptions};

use super::estimate::EstimateInput;
use super::format::{ExportJob, FormatInfo};
use super::textures::Textures;
use super::{Exporter, Summary, Warning, exr};
use byte_sink::{ByteSink, CountingSink};
use layer::{AnimatedPrim, AssetSample, LayerBuilder, MaterialBinding, UsdContext};
use layer_writer::{CompositionArc, LayerMeta, LayerWriter, PrimMeta};
use osier_base::files::safe_name;
use osier_base::files::{Folder, Output};
use osier_base::geometry::Bounds;
use osier_base::{Error, Result};
use osier_scene::{AssetFrame, Frame, Scene, asset_bounds};
use plant_instancer::SinglePlacement;

/// USD in the registry.
pub const FORMAT: FormatInfo = FormatInfo {
    word: "usd",
    about: "USD: a root layer (.usda) and a payload (.usdc) per asset; animated",
    asset_folder: Some("usd"),
    endings: &[("usda", "USD as text"), ("usdc", "USD, binary"), ("usdz", "USD with pictures in one file")],
    pictures_beside: true,
    memory_percent: 7,
    estimate,
    open,
};

/// The writer of a bake, or of a single file at rest without camera and lights.
fn open(job: &ExportJob) -> Vec<Box<dyn Exporter>> {
    let bake = &job.options.usd;
    let options = match job.file {
        None => bake.clone(),
        Some(name) => UsdOptions { up: bake.up, file: Some(name.to_owned()), look: false, ..UsdOptions::default() },
    };
    vec![Box::new(Usd::new(job.folder.clone(), Arc::clone(&job.textures), options))]
}

/// Own: bytes per vertex, triangle, instance and time sample as the crate files hold them.
fn estimate(input: &EstimateInput) -> u64 {
    let frames = input.frames;
    input.per_asset(|a| {
        let vertices = a.vertices + a.prototype_vertices;
        let still = vertices * 44 + (a.triangles + a.prototype_triangles) * 8 + a.instances * 40;
        // Position, orientation, two velocities; the point twin once more, with four attributes.
        let tracks = (a.free_instances * 124 + a.moving_curve_points * 12) * frames;
        let posed = a.posed_frames(frames) * (a.deforming_vertices * 24 + a.instances * 20 + a.joints * 34);
        still + tracks + a.points * 44 + a.moving_points * frames * 40 + posed
    })
}

/// A layer and those of its parts that change.
struct OpenLayer {
    layer: LayerBuilder,
    /// Index of the asset whose payload it is.
    payload_of: Option<usize>,
    /// Asset and part.
    parts: Vec<(usize, Box<dyn AnimatedPrim>)>,
    /// What went wrong in a frame.
    failed: Option<Error>,
}

/// Writes USD.
pub struct Usd {
    folder: Folder,
    textures: Arc<Textures>,
    options: UsdOptions,
    cx: Option<UsdContext>,
    layers: Vec<OpenLayer>,
    warnings: Vec<Warning>,
}

impl Usd {
    /// An exporter into a folder. Pictures go into the folder's `textures/`, those of a single file into it or beside it.
    pub fn new(folder: Folder, textures: Arc<Textures>, options: UsdOptions) -> Self {
        Self { folder, textures, options, cx: None, layers: Vec::new(), warnings: Vec::new() }
    }

    /// One crate file per asset, and the twins.
    fn begin_payloads(&mut self, cx: &UsdContext) -> Result<()> {
        for (i, asset) in cx.scene.assets.iter().enumerate() {
            let name = safe_name(&asset.id);
            let root = format!("/{name}");
            // The wrapper needs the bindings and the extent of a payload that an interrupted bake has left complete, too.
            let sink: Box<dyn ByteSink> = match self.folder.create(&format!("usd/{name}.usdc"), "usdc", None)? {
                Some(out) => Box::new(out),
                None => Box::new(CountingSink::default()),
            };
            let mut layer = new_layer(cx, Box::new(usdc::UsdcWriter::new(sink)), &name)?;
            layer.writer.define_prim(&root, "Xform", &PrimMeta { kind: Some("component"), ..PrimMeta::default() })?;
            let parts = asset::define_asset(cx, &mut layer, &root, asset)?;
            self.push_layer(layer, Some(i), parts.into_iter().map(|p| (i, p)).collect());
            if !asset.instancers.iter().any(|x| x.tracked) {
                continue;
            }
            if let Some(out) = self.folder.create(&format!("usd/{name}.points.usdc"), "usdc.points", None)? {
                let mut layer = new_layer(cx, Box::new(usdc::UsdcWriter::new(Box::new(out))), &name)?;
                layer.writer.define_prim(
                    &root,
                    "Xform",
                    &PrimMeta { kind: Some("component"), ..PrimMeta::default() },
                )?;
                let parts = asset::define_point_twins(cx, &mut layer, &root, asset)?;
                self.push_layer(layer, None, parts.into_iter().map(|p| (i, p)).collect());
            }
        }
        Ok(())
    }

    fn push_layer(
        &mut self,
        layer: LayerBuilder,
        payload_of: Option<usize>,
        parts: Vec<(usize, Box<dyn AnimatedPrim>)>,
    ) {
        self.layers.push(OpenLayer { layer, payload_of, parts, failed: None });
    }

    /// The whole scene in one layer.
    fn begin_single(&mut self, cx: &UsdContext, file: &str) -> Result<()> {
        let kind = match file.rsplit_once('.') {
            Some((_, "usda")) => "usda",
            Some((_, "usdz")) => "usdz",
            _ => "usdc",
        };
        let Some(out) = self.folder.create(file, kind, None)? else { return Ok(()) };
        let scene = safe_name(&cx.scene.name);
        let writer: Box<dyn LayerWriter> = match kind {
            "usda" => Box::new(usda::UsdaWriter::new(Box::new(out))),
            "usdz" => Box::new(usdc::UsdcWriter::new(Box::new(self.usdz_sink(cx, out, &format!("{scene}.usdc"))?))),
            _ => Box::new(usdc::UsdcWriter::new(Box::new(out))),
        };
        let mut layer = new_layer(cx, writer, &scene)?;
        let root = format!("/{scene}");
        layer.writer.define_prim(&root, "Xform", &PrimMeta { kind: Some("assembly"), ..PrimMeta::default() })?;
        let mut parts = Vec::new();
        let mut first: BTreeMap<usize, String> = BTreeMap::new();
        let shared = instanceable_assets(&cx.scene);
        let plan = plant_instancer::plan_placements(&cx.scene, &root, self.options.copies == CopyStyle::Instancer);
        for single in &plan.singles {
            let SinglePlacement { path, placement } = single;
            let shown = AssetPrim {
                asset: placement.asset,
                ahead: placement.phase,
                may_share: shared.contains(&placement.asset),
                kind: Some("component"),
            };
            parts.extend(define_asset_prim(cx, &mut layer, path, shown, &mut first)?);
            layer.set_xform_ops(path, &cx.up.trs(&placement.transform))?;
        }
        for group in &plan.instancers {
            group.define(&mut layer)?;
            for (individual, path) in &group.prototypes {
                let shown =
                    AssetPrim { asset: individual.asset, ahead: individual.phase, may_share: false, kind: None };
                parts.extend(define_asset_prim(cx, &mut layer, path, shown, &mut first)?);
            }
        }
        if self.options.look {
            camera_light::define_camera_and_lights(cx, &mut layer, &root, None)?;
        }
        self.push_layer(layer, None, parts);
        if kind != "usdz" {
            let folder = cx.pictures.strip_prefix("./").unwrap_or(&cx.pictures);
            self.textures.write(&cx.scene, &self.folder, folder)?;
        }
        Ok(())
    }

    fn usdz_sink(&self, cx: &UsdContext, out: Output, root: &str) -> Result<usdz::UsdzPackage> {
        let member = |(image, bytes): (&osier_scene::Image, &Arc<[u8]>)| usdz::PackageMember {
            name: format!("textures/{}.png", image.name),
            bytes: Arc::clone(bytes),
        };
        let members = cx.scene.images.iter().zip(self.textures.iter()).map(member).collect();
        usdz::UsdzPackage::new(out, root, members)
    }

    /// The wrapper: a payload per placement, an instancer per plant with copies, one scope of materials, camera and lights.
    fn write_wrapper(&self, cx: &UsdContext, written: &LayerSummary) -> Result<()> {
        if self.options.look {
            exr::write_sky(&self.folder, &cx.scene)?;
        }
        let scene = safe_name(&cx.scene.name);
        let Some(out) = self.folder.create(&format!("{scene}.usda"), "usda.wrapper", None)? else { return Ok(()) };
        // Seen from here, pictures lie beside the payloads, not above them.
        let cx = &UsdContext { pictures: "./textures/".to_owned(), maps: None, ..cx.clone() };
        let mut layer = new_layer(cx, Box::new(usda::UsdaWriter::new(Box::new(out))), &scene)?;
        let root = format!("/{scene}");
        layer.writer.define_prim(&root, "Xform", &PrimMeta { kind: Some("assembly"), ..PrimMeta::default() })?;
        let shared = instanceable_assets(&cx.scene);
        let plan = plant_instancer::plan_placements(&cx.scene, &root, self.options.copies == CopyStyle::Instancer);
        for single in &plan.singles {
            let SinglePlacement { path, placement } = single;
            let Some(payload) = payload_arc(cx, placement.asset, placement.phase, "./usd/") else { continue };
            let instanceable = shared.contains(&placement.asset);
            let meta =
                PrimMeta { kind: Some("component"), instanceable, payload: Some(payload), ..PrimMeta::default() };
            layer.writer.define_prim(path, "Xform", &meta)?;
            layer.set_xform_ops(path, &cx.up.trs(&placement.transform))?;
            if !instanceable {
                rebind_materials(cx, &mut layer, &root, path, written.bindings(placement.asset))?;
            }
        }
        for group in &plan.instancers {
            group.define(&mut layer)?;
            for (individual, path) in &group.prototypes {
                let Some(payload) = payload_arc(cx, individual.asset, individual.phase, "./usd/") else { continue };
                // A prototype takes its type from the payload.
                layer.writer.define_prim(path, "", &PrimMeta { payload: Some(payload), ..PrimMeta::default() })?;
                rebind_materials(cx, &mut layer, &root, path, written.bindings(individual.asset))?;
            }
            group.write_instances(cx, &mut layer, &written.reach)?;
        }
        if self.options.look {
            camera_light::define_camera_and_lights(cx, &mut layer, &root, Some(&format!("./{}", exr::SKY_FILE)))?;
        }
        layer.writer.finish()
    }

    /// X002 for skeletons that are larger than readers like.
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

fn new_layer(cx: &UsdContext, writer: Box<dyn LayerWriter>, default_prim: &str) -> Result<LayerBuilder> {
    let mut layer = LayerBuilder::new(writer);
    layer.writer.begin(&LayerMeta::of(&cx.scene, default_prim, cx.up))?;
    Ok(layer)
}

/// True if a placement shows the asset at another time of the clip.
fn has_phase_offset(scene: &Scene, asset: usize) -> bool {
    scene.placements.iter().any(|p| p.asset == asset && p.phase > 0)
}

/// Assets at rest that several placements show: readers then hold them once. Those that move are not shared, as Blender reads
/// their frames by the names that USD gives to shared prims, and these are others whenever the file is opened.
fn instanceable_assets(scene: &Scene) -> BTreeSet<usize> {
    let (mut seen, mut shared) = (BTreeSet::new(), BTreeSet::new());
    for p in &scene.placements {
        if !seen.insert(p.asset) && scene.assets.get(p.asset).is_some_and(|a| !a.moves()) {
            shared.insert(p.asset);
        }
    }
    shared
}

/// What the layers of a scene turned out to hold.
#[derive(Debug, Default)]
struct LayerSummary {
    /// Box of each asset over all frames, in its own space of the stage.
    reach: Vec<Bounds>,
    /// Bindings of each asset's payload.
    bound: Vec<Vec<MaterialBinding>>,
}

impl LayerSummary {
    /// Gathers it from the layers of all assets; with payloads, the first layer of an asset is its payload.
    fn of(cx: &UsdContext, layers: &[OpenLayer]) -> Self {
        let rest = |asset| plant_instancer::stage_bounds(cx.up, &asset_bounds(asset, &AssetFrame::default()));
        let mut reach: Vec<Bounds> = cx.scene.assets.iter().map(rest).collect();
        for (asset, part) in layers.iter().flat_map(|l| &l.parts) {
            if let Some(b) = reach.get_mut(*asset) {
                *b = b.union(part.reach());
            }
        }
        let mut bound = vec![Vec::new(); cx.scene.assets.len()];
        for layer in layers {
            if let Some(list) = layer.payload_of.and_then(|asset| bound.get_mut(asset)) {
                *list = layer.layer.bindings().to_vec();
            }
        }
        Self { reach, bound }
    }

    /// Bindings of the payload of an asset.
    fn bindings(&self, asset: usize) -> &[MaterialBinding] {
        self.bound.get(asset).map_or(&[], Vec::as_slice)
    }
}

/// An asset as a prim shows it.
struct AssetPrim {
    /// Index of the asset.
    asset: usize,
    /// Frames by which it is ahead of the clip.
    ahead: u32,
    /// Readers may hold it once for all prims that show it.
    may_share: bool,
    /// Model kind of the prim.
    kind: Option<&'static str>,
}

/// Writes an asset under a new prim of the layer: its contents the first time, a reference to those from then on.
fn define_asset_prim(
    cx: &UsdContext,
    layer: &mut LayerBuilder,
    path: &str,
    shown: AssetPrim,
    first: &mut BTreeMap<usize, String>,
) -> Result<Vec<(usize, Box<dyn AnimatedPrim>)>> {
    let Some(asset) = cx.scene.assets.get(shown.asset) else { return Ok(Vec::new()) };
    let known = first.get(&shown.asset).cloned();
    let instanceable = known.is_some() && shown.may_share;
    let reference = known.map(|prim| CompositionArc { asset: String::new(), prim, ahead: shown.ahead });
    let new = reference.is_none();
    let meta = PrimMeta { kind: shown.kind, instanceable, reference, ..PrimMeta::default() };
    layer.writer.define_prim(path, "Xform", &meta)?;
    if !new {
        return Ok(Vec::new());
    }
    first.insert(shown.asset, path.to_owned());
    let changing = asset::define_asset(cx, layer, path, asset)?;
    Ok(changing.into_iter().map(|p| (shown.asset, p)).collect())
}

/// The payload of an asset, `ahead` frames ahead, seen from a layer that has the folder of payloads at `folder`.
fn payload_arc(cx: &UsdContext, asset: usize, ahead: u32, folder: &str) -> Option<CompositionArc> {
    let name = safe_name(&cx.scene.assets.get(asset)?.id);
    Some(CompositionArc { asset: format!("{folder}{name}.usdc"), prim: format!("/{name}"), ahead })
}

/// Binds what a payload at `path` shows to the materials of the scene's root, so that readers that make a material for every
/// one they find bound, as Blender does, make one for all payloads. Wet leaves keep their own, whose maps change, and so does what stands in a variant.
fn rebind_materials(
    cx: &UsdContext,
    layer: &mut LayerBuilder,
    root: &str,
    path: &str,
    bindings: &[MaterialBinding],
) -> Result<()> {
    let own = |b: &MaterialBinding| {
        b.prim.contains('{') || cx.scene.materials.get(b.material as usize).is_none_or(|m| m.wet.is_some())
    };
    if !bindings.is_empty() && !bindings.iter().any(own) {
        // Nothing is bound to the payload's own materials any more; a reader need not look at them.
        let meta = PrimMeta { over: true, inactive: true, ..PrimMeta::default() };
        layer.writer.define_prim(&format!("{path}/mtl"), "", &meta)?;
    }
    let mut made = BTreeSet::new();
    for MaterialBinding { prim, material } in bindings.iter().filter(|b| !own(b)) {
        // The payload's root is its first name.
        let below: Vec<&str> = prim.split('/').skip(2).collect();
        let mut over = path.to_owned();
        for name in below {
            over = format!("{over}/{name}");
            if made.insert(over.clone()) {
                layer.writer.define_prim(&over, "", &PrimMeta { over: true, ..PrimMeta::default() })?;
            }
        }
        layer.bind_material(cx, root, &over, *material)?;
    }
    Ok(())
}

/// Folder of the pictures, as seen from the layers that show them.
fn texture_folder(options: &UsdOptions) -> String {
    match &options.file {
        None => "../textures/".to_owned(),
        Some(file) => match file.rsplit_once('.') {
            Some((_, "usdz")) => "./textures/".to_owned(),
            Some((stem, _)) => format!("./{stem}_files/"),
            None => format!("./{file}_files/"),
        },
    }
}

impl Exporter for Usd {
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
        osier_base::par::par_each(&mut self.layers, |layer| {
            let OpenLayer { layer, parts, failed, .. } = layer;
            for (i, part) in parts {
                let Some((asset, state)) = cx.scene.assets.get(*i).zip(frame.assets.get(*i)) else { continue };
                if let Err(e) = part.frame(cx, layer, &AssetSample { asset, state, time, wet: &frame.wet }) {
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
        let written = LayerSummary::of(&cx, &self.layers);
        if self.options.file.is_some()
            && let Some(open) = self.layers.first_mut()
        {
            let root = format!("/{}", safe_name(&cx.scene.name));
            let plan = plant_instancer::plan_placements(&cx.scene, &root, self.options.copies == CopyStyle::Instancer);
            plan.instancers.iter().try_for_each(|group| group.write_instances(&cx, &mut open.layer, &written.reach))?;
        }
        for OpenLayer { layer, parts, .. } in &mut self.layers {
            parts.iter_mut().try_for_each(|(_, part)| part.finish(layer))?;
            if let Some(scene) = self.cx.as_ref().map(|cx| &cx.scene)
                && parts.iter().any(|(asset, _)| has_phase_offset(scene, *asset))
            {
                layer.writer.repeat_samples(scene.clip.len() as f64);
            }
            layer.writer.finish()?;
        }
        self.layers.clear();
        if self.options.file.is_none() {
            self.write_wrapper(&cx, &written)?;
        }
        Ok(Summary { warnings: std::mem::take(&mut self.warnings) })
    }
}
