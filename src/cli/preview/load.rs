//! What is previewed: a scene, grammar or preset grown on the spot, or a file that exists.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::super::args::Preview;
use super::super::{Context, source};
use super::shots::ending;
use crate::bake::motion::evaluate_frame;
use crate::bake::scene::AnimatedScene;
use crate::bake::{BakeContext, scene};
use crate::recipe::{Recipe, resolve};
use osier_base::diagnostic::{Diagnostic, Report};
use osier_base::files::{self, SearchPaths};
use osier_base::{Error, Result};
use osier_export::manifest;
use osier_import::{Options, Up};
use osier_preview::Quality;
use osier_scene::{
    Asset, AssetKind, Camera, Clip, Frame, MaterialClass, MeshMotion, MeshObject, Placement, Scene, Sky, Sun, Trs,
};

/// Files that are read as they are.
const MESHES: [&str; 3] = ["glb", "gltf", "obj"];

/// Something to take pictures of.
pub struct Loaded {
    stage: AnimatedScene,
    /// The scene places its own camera.
    pub has_camera: bool,
    /// Short name.
    pub name: String,
    /// What was said about it.
    pub report: Report,
}

impl Loaded {
    pub fn scene(&self) -> &Scene {
        &self.stage.scene
    }

    /// The scene's things at a frame.
    /// # Errors
    /// Those of a wind that is stepped.
    pub fn frame(&self, number: u32) -> Result<Frame> {
        evaluate_frame(&self.stage.scene, &self.stage.motions, number, true)
    }

    /// True with catkins in flight.
    pub fn flies(&self) -> bool {
        self.stage.scene.tables.iter().any(|table| table.name == "flight")
    }

    /// True if something moves.
    pub fn moves(&self) -> bool {
        self.stage.motions.iter().any(Option::is_some)
    }
}

/// Another individual of the same source.
#[derive(Debug, Clone, Default)]
pub struct Change {
    pub seed: Option<u64>,
    /// `path=value`.
    pub set: Vec<String>,
}

/// Loads a source and assembles its scene; `moving`: with what a clip needs (joints, weights, flutter).
/// # Errors
/// `Input` with its faults, `Io`, `Limit`, `Cancelled`.
pub fn load(
    context: &Context,
    args: &Preview,
    name: &str,
    quality: Quality,
    moving: bool,
    change: &Change,
    work: &BakeContext<'_>,
) -> Result<Loaded> {
    let path = Path::new(name);
    if path.is_dir() {
        return mesh_file(context, &baked(context, path)?);
    }
    if MESHES.contains(&ending(path).as_str()) {
        return mesh_file(context, path);
    }
    if let "usda" | "usdc" | "usdz" | "ply" | "pov" | "pc2" | "exr" = ending(path).as_str() {
        let why = format!("\"{name}\" (.{}) is a file for other programs", ending(path));
        let help = "preview its scene, or the .glb of the same bake (--formats glb)";
        return Err(fault(Diagnostic::about("S001", why).help(help)));
    }
    let mut request = source::request(context, name)?;
    request.steps = args.steps;
    request.set.extend(change.set.iter().cloned());
    request.seed = change.seed.or(request.seed);
    let (mut recipe, mut report) = resolve(&request)?;
    if !moving {
        // Joints, weights and flutter are only made for a clip that moves.
        recipe.clip.end = recipe.clip.start;
    }
    cap_maps(&mut recipe, quality);
    let built = scene::assemble_scene(&recipe, scene::SceneParts::default(), work)?;
    report.extend(built.report);
    let keys = &recipe.camera;
    let has_camera = keys.eye.is_some() || keys.target.is_some();
    Ok(Loaded { stage: built.animated, has_camera, name: recipe.name, report })
}

/// Maps larger than the picture can show are not painted.
fn cap_maps(recipe: &mut Recipe, quality: Quality) {
    let side = quality.texture_side();
    for plant in &mut recipe.plants {
        plant.bark.side = plant.bark.side.min(side);
        plant.shoot.side = plant.shoot.side.min(side / 2);
        for organ in &mut plant.organs {
            organ.keys.side = organ.keys.side.min(side);
        }
    }
    recipe.ground.side = recipe.ground.side.min(side);
    if let Some(terrain) = &mut recipe.terrain {
        // One map covers the whole land.
        terrain.side = terrain.side.min(4 * side);
    }
}

fn fault(diagnostic: Diagnostic) -> Error {
    let mut report = Report::default();
    report.push(diagnostic);
    Error::Input(Box::new(report))
}

/// The file of a bake's folder that holds all of it.
fn baked(context: &Context, folder: &Path) -> Result<PathBuf> {
    let (m, _) = manifest::verify(folder, context.limits.get("json-bytes"))?;
    let files = m.expanded();
    let find = |ends: &str| files.iter().map(|f| f.0.as_str()).find(|p| p.ends_with(ends));
    let whole = |profile: &str| find(&format!("{}.{profile}.glb", m.scene.name));
    match whole("blender").or_else(|| whole("web")) {
        Some(path) => Ok(folder.join(path)),
        None => {
            let why = format!("\"{}\" is a bake without a .glb of the whole scene", folder.display());
            Err(fault(
                Diagnostic::about("S001", why).help("preview its scene file, or bake it again with --formats glb"),
            ))
        }
    }
}

fn mesh_file(context: &Context, path: &Path) -> Result<Loaded> {
    let bytes = files::read_input(path, context.limits.get("mesh-bytes"))?;
    let roots = SearchPaths::new(path, &context.common.search)?;
    let options = Options { roots: &roots, limits: &context.limits, up: Up::Y, scale: 1.0, class: MaterialClass::Leaf };
    let read = osier_import::read(path, &bytes, &options)?;
    let name = path.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default();
    let object = MeshObject { name: "mesh".into(), mesh: read.mesh, motion: MeshMotion::Still, skin: None };
    let asset = Asset {
        id: "mesh".into(),
        kind: AssetKind::Import,
        group: String::new(),
        skeleton: None,
        meshes: vec![object],
        instancers: Vec::new(),
        points: Vec::new(),
        curves: Vec::new(),
    };
    let hash = read.files.iter().fold(blake3::Hasher::new(), |mut h, f| {
        h.update(&f.blake3);
        h
    });
    let scene = Scene {
        name: "mesh".into(),
        title: name.clone(),
        seed: 0,
        hash: hash.finalize().to_hex().to_string(),
        clip: Clip::default(),
        camera: Camera { eye: glam::Vec3::Z, target: glam::Vec3::ZERO, vfov: 0.6, roll: 0.0 },
        sun: Sun::default(),
        sky: Sky::default(),
        images: read.images,
        materials: read.materials,
        assets: vec![asset],
        placements: vec![Placement { name: "mesh".into(), asset: 0, transform: Trs::IDENTITY, phase: 0 }],
        land: None,
        tables: Vec::new(),
        code_lists: Vec::new(),
        fields: Vec::new(),
        air: Vec::new(),
        map_sequences: Vec::new(),
    };
    let stage = AnimatedScene { scene: Arc::new(scene), motions: vec![None], wind: None };
    Ok(Loaded { stage, has_camera: false, name, report: read.warnings })
}
