//! USD: a text wrapper, one crate file per asset, packages.
//!
//! Everything is written once against `stage::Stage`, which has a text and a crate implementation.

use std::collections::BTreeSet;
use std::sync::Arc;

mod axis;
mod body;
mod boxes;
mod instancer;
mod look;
mod material;
mod mesh;
mod points;
mod sink;
mod skel;
mod stage;
mod target;
mod usda;
mod usdc;
mod value;
mod wet;
mod zip;

pub use axis::UpAxis;

use super::textures::Textures;
use super::{Exporter, Summary, Warning};
use crate::fence::{Folder, Output};
use crate::fence::{Names, safe_name};
use crate::scene::{Frame, Scene};
use crate::{Error, Result};
use stage::{LayerMeta, PrimMeta, Stage};
use target::{Context, Part, Shot, Target};

/// What may be chosen about USD files.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Options {
    /// Which way is up.
    pub up: UpAxis,
    /// Write everything into one file of this name (`.usda`, `.usdc`, `.usdz`) instead of a wrapper and payloads.
    pub file: Option<String>,
    /// Write camera and lights.
    pub look: bool,
    /// Wet leaves show the maps that the exporter of EXR writes beside; without, they are dry.
    pub maps: bool,
    /// First frame that is written; without, the clip's.
    pub first: Option<u32>,
}

impl Default for Options {
    fn default() -> Self {
        Self { up: UpAxis::Y, file: None, look: true, maps: false, first: None }
    }
}

/// A layer and those of its parts that change.
struct Layer {
    target: Target,
    /// Asset and part.
    parts: Vec<(usize, Box<dyn Part>)>,
    /// What went wrong in a frame.
    failed: Option<Error>,
}

/// Writes USD.
pub struct Usd {
    folder: Folder,
    textures: Arc<Textures>,
    options: Options,
    cx: Option<Context>,
    layers: Vec<Layer>,
    warnings: Vec<Warning>,
}

impl Usd {
    /// An exporter into a folder. Pictures go into the folder's `textures/`, those of a single file into it or beside it.
    pub fn new(folder: Folder, textures: Arc<Textures>, options: Options) -> Self {
        Self { folder, textures, options, cx: None, layers: Vec::new(), warnings: Vec::new() }
    }

    /// One crate file per asset, and the twins.
    fn begin_payloads(&mut self, cx: &Context) -> Result<()> {
        for (i, asset) in cx.scene.assets.iter().enumerate() {
            let name = safe_name(&asset.id);
            let root = format!("/{name}");
            if let Some(out) = self.folder.create(&format!("usd/{name}.usdc"), "usdc", None)? {
                let mut target = open(cx, Box::new(usdc::Usdc::new(Box::new(out))), &name)?;
                target.stage.prim(&root, "Xform", &PrimMeta { kind: Some("component"), ..PrimMeta::default() })?;
                let parts = body::define(cx, &mut target, &root, asset)?;
                self.push(target, parts.into_iter().map(|p| (i, p)).collect());
            }
            if !asset.instancers.iter().any(|x| x.tracked) {
                continue;
            }
            if let Some(out) = self.folder.create(&format!("usd/{name}.points.usdc"), "usdc.points", None)? {
                let mut target = open(cx, Box::new(usdc::Usdc::new(Box::new(out))), &name)?;
                target.stage.prim(&root, "Xform", &PrimMeta { kind: Some("component"), ..PrimMeta::default() })?;
                let parts = body::define_twins(cx, &mut target, &root, asset)?;
                self.push(target, parts.into_iter().map(|p| (i, p)).collect());
            }
        }
        Ok(())
    }

    fn push(&mut self, target: Target, parts: Vec<(usize, Box<dyn Part>)>) {
        self.layers.push(Layer { target, parts, failed: None });
    }

    /// The whole scene in one layer.
    fn begin_single(&mut self, cx: &Context, file: &str) -> Result<()> {
        let kind = match file.rsplit_once('.') {
            Some((_, "usda")) => "usda",
            Some((_, "usdz")) => "usdz",
            _ => "usdc",
        };
        let Some(out) = self.folder.create(file, kind, None)? else { return Ok(()) };
        let scene = safe_name(&cx.scene.name);
        let stage: Box<dyn Stage> = match kind {
            "usda" => Box::new(usda::Usda::new(Box::new(out))),
            "usdz" => Box::new(usdc::Usdc::new(Box::new(self.package(cx, out, &format!("{scene}.usdc"))?))),
            _ => Box::new(usdc::Usdc::new(Box::new(out))),
        };
        let mut target = open(cx, stage, &scene)?;
        let root = format!("/{scene}");
        target.stage.prim(&root, "Xform", &PrimMeta { kind: Some("assembly"), ..PrimMeta::default() })?;
        let mut parts = Vec::new();
        let mut first: Vec<Option<String>> = vec![None; cx.scene.assets.len()];
        let shared = shared(&cx.scene);
        for (path, placement) in placed(cx, &root) {
            let Some(asset) = cx.scene.assets.get(placement.asset) else { continue };
            let slot = first.get_mut(placement.asset);
            let known = slot.as_ref().and_then(|s| s.as_ref());
            let ahead = placement.phase;
            let reference = known.map(|p| stage::Arc { asset: String::new(), prim: p.clone(), ahead });
            let new = reference.is_none();
            let instanceable = !new && shared.contains(&placement.asset);
            let meta = PrimMeta { kind: Some("component"), instanceable, reference, ..PrimMeta::default() };
            target.stage.prim(&path, "Xform", &meta)?;
            target.transform(&path, &cx.up.trs(&placement.transform))?;
            if new {
                let changing = body::define(cx, &mut target, &path, asset)?;
                parts.extend(changing.into_iter().map(|p| (placement.asset, p)));
                if let Some(slot) = slot {
                    *slot = Some(path);
                }
            }
        }
        if self.options.look {
            look::define(cx, &mut target, &root)?;
        }
        self.push(target, parts);
        if kind != "usdz" {
            let folder = cx.pictures.strip_prefix("./").unwrap_or(&cx.pictures);
            self.textures.write(&cx.scene, &self.folder, folder)?;
        }
        Ok(())
    }

    fn package(&self, cx: &Context, out: Output, root: &str) -> Result<zip::Package> {
        let member = |(image, bytes): (&crate::scene::Image, &Arc<[u8]>)| zip::Member {
            name: format!("textures/{}.png", image.name),
            bytes: Arc::clone(bytes),
        };
        let members = cx.scene.images.iter().zip(self.textures.iter()).map(member).collect();
        zip::Package::new(out, root, members)
    }

    /// The wrapper: a payload per placement, camera and lights.
    fn wrapper(&self, cx: &Context) -> Result<()> {
        let scene = safe_name(&cx.scene.name);
        let Some(out) = self.folder.create(&format!("{scene}.usda"), "usda.wrapper", None)? else { return Ok(()) };
        let mut target = open(cx, Box::new(usda::Usda::new(Box::new(out))), &scene)?;
        let root = format!("/{scene}");
        target.stage.prim(&root, "Xform", &PrimMeta { kind: Some("assembly"), ..PrimMeta::default() })?;
        let shared = shared(&cx.scene);
        for (path, placement) in placed(cx, &root) {
            let Some(asset) = cx.scene.assets.get(placement.asset) else { continue };
            let name = safe_name(&asset.id);
            let ahead = placement.phase;
            let payload = Some(stage::Arc { asset: format!("./usd/{name}.usdc"), prim: format!("/{name}"), ahead });
            let instanceable = shared.contains(&placement.asset);
            let meta = PrimMeta { kind: Some("component"), instanceable, payload, ..PrimMeta::default() };
            target.stage.prim(&path, "Xform", &meta)?;
            target.transform(&path, &cx.up.trs(&placement.transform))?;
        }
        if self.options.look {
            look::define(cx, &mut target, &root)?;
        }
        target.stage.finish()
    }

    /// X002 for skeletons that are larger than readers like.
    fn warn_joints(&mut self, scene: &Scene) {
        for asset in &scene.assets {
            let joints = asset.skeleton.as_ref().map_or(0, |s| s.joints.len());
            if joints > skel::MAX_JOINTS && asset.meshes.iter().any(|m| skel::follows(asset, m)) {
                let message =
                    format!("asset {}: {joints} joints, more than {}: readers may be slow", asset.id, skel::MAX_JOINTS);
                self.warnings.push(Warning { code: "X002", message });
            }
        }
    }
}

fn open(cx: &Context, stage: Box<dyn Stage>, default_prim: &str) -> Result<Target> {
    let mut target = Target::new(stage);
    target.stage.begin(&LayerMeta::of(&cx.scene, default_prim, cx.up))?;
    Ok(target)
}

/// True if a placement shows the asset at another time of the clip.
fn is_phased(scene: &Scene, asset: usize) -> bool {
    scene.placements.iter().any(|p| p.asset == asset && p.phase > 0)
}

/// Assets at rest that several placements show: readers then hold them once. Those that move are not shared, as Blender reads
/// their frames by the names that USD gives to shared prims, and these are others whenever the file is opened.
fn shared(scene: &Scene) -> BTreeSet<usize> {
    let (mut seen, mut shared) = (BTreeSet::new(), BTreeSet::new());
    for p in &scene.placements {
        if !seen.insert(p.asset) && scene.assets.get(p.asset).is_some_and(|a| !a.moves()) {
            shared.insert(p.asset);
        }
    }
    shared
}

/// Placements with the paths of their prims. Camera and lights keep their names.
fn placed<'a>(cx: &'a Context, root: &str) -> Vec<(String, &'a crate::scene::Placement)> {
    let mut names = Names::default();
    for name in ["camera", "sun", "sky"] {
        names.unique(name);
    }
    cx.scene.placements.iter().map(|p| (format!("{root}/{}", names.unique(&p.name)), p)).collect()
}

/// Folder of the pictures, as seen from the layers that show them.
fn pictures(options: &Options) -> String {
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
        let cx = Context {
            scene: Arc::clone(scene),
            up: self.options.up,
            pictures: pictures(&self.options),
            maps,
            first: self.options.first.unwrap_or(scene.clip.start),
        };
        self.warn_joints(scene);
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
        crate::par::par_each(&mut self.layers, |layer| {
            let Layer { target, parts, failed } = layer;
            for (i, part) in parts {
                let Some((asset, state)) = cx.scene.assets.get(*i).zip(frame.assets.get(*i)) else { continue };
                if let Err(e) = part.frame(cx, target, &Shot { asset, state, time, wet: &frame.wet }) {
                    *failed = Some(e);
                    return;
                }
            }
            if let Err(e) = target.sheets(cx, frame.number) {
                *failed = Some(e);
            }
        });
        self.layers.iter_mut().find_map(|l| l.failed.take()).map_or(Ok(()), Err)
    }

    fn finish(&mut self) -> Result<Summary> {
        for layer in &mut self.layers {
            if let Some(scene) = self.cx.as_ref().map(|cx| &cx.scene)
                && layer.parts.iter().any(|(asset, _)| is_phased(scene, *asset))
            {
                layer.target.stage.repeat(f64::from(u32::try_from(scene.clip.len()).unwrap_or(u32::MAX)));
            }
            layer.target.stage.finish()?;
        }
        self.layers.clear();
        if let (Some(cx), None) = (&self.cx, &self.options.file) {
            self.wrapper(cx)?;
        }
        Ok(Summary { warnings: std::mem::take(&mut self.warnings) })
    }
}
