//! Scenes for previews: assembled from a recipe, or read from a mesh file or the folder of a bake.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::bake::BakeContext;
use crate::bake::motion::evaluate_frame;
use crate::bake::scene::{AnimatedScene, SceneOptions, assemble_scene};
use crate::recipe::Recipe;
use osier_base::diagnostic::{Diagnostic, Report};
use osier_base::files::{self, SearchPaths};
use osier_base::limits::Limits;
use osier_base::{Error, Result};
use osier_export::gltf::Profile;
use osier_export::manifest;
use osier_import::{ImportOptions, UpAxis};
use osier_preview::{Quality, Subject};
use osier_scene::{
    Asset, AssetKind, Camera, Clip, Frame, MaterialClass, MeshMotion, MeshObject, Placement, Scene, Sky, Sun, Trs,
};

/// A scene with its motions, ready to be rendered.
#[derive(Debug)]
pub struct PreviewScene {
    animated: AnimatedScene,
    has_camera: bool,
    name: String,
    report: Report,
}

impl PreviewScene {
    /// Assembles the scene of a recipe with maps no larger than `quality` can display. `with_motion`: whether frames of the
    /// clip will be evaluated; otherwise joints, skin weights and leaf flutter are left out.
    /// # Errors
    /// `Input` with the faults of grammars, `Limit`, `Cancelled`.
    pub fn of_recipe(
        mut recipe: Recipe,
        quality: Quality,
        with_motion: bool,
        context: &BakeContext<'_>,
    ) -> Result<Self> {
        if !with_motion {
            recipe.clip.end = recipe.clip.start;
        }
        cap_map_sides(&mut recipe, quality);
        let assembled = assemble_scene(&recipe, SceneOptions::default(), context)?;
        let has_camera = recipe.camera.eye.is_some() || recipe.camera.target.is_some();
        Ok(Self { animated: assembled.animated, has_camera, name: recipe.name, report: assembled.report })
    }

    /// Reads a mesh file (`.glb`, `.gltf`, `.obj`) as a scene. `search`: further folders for the files that it names.
    /// # Errors
    /// `Input` for a damaged file, `Io` if it cannot be read, `Limit`.
    pub fn of_mesh_file(path: &Path, search: &[PathBuf], limits: &Limits) -> Result<Self> {
        let bytes = files::read_input(path, limits.get("mesh-bytes"))?;
        let roots = SearchPaths::new(path, search)?;
        let options = ImportOptions { roots: &roots, limits, up: UpAxis::Y, scale: 1.0, class: MaterialClass::Leaf };
        let imported = osier_import::read(path, &bytes, &options)?;
        let name = path.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default();
        let object = MeshObject { name: "mesh".into(), mesh: imported.mesh, motion: MeshMotion::Still, skin: None };
        let asset = Asset {
            id: "mesh".into(),
            kind: AssetKind::Import,
            group: String::new(),
            skeleton: None,
            meshes: vec![object],
            instancers: Vec::new(),
            points: Vec::new(),
            curves: Vec::new(),
            rigged: None,
        };
        // The hash covers the file and all files that it names; PNG previews store it as their origin.
        let hash = imported.files.iter().fold(blake3::Hasher::new(), |mut h, f| {
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
            images: imported.images,
            materials: imported.materials,
            assets: vec![asset],
            placements: vec![Placement { name: "mesh".into(), asset: 0, transform: Trs::IDENTITY, phase: 0 }],
            land: None,
            tables: Vec::new(),
            enum_labels: Vec::new(),
            fields: Vec::new(),
            air: Vec::new(),
            volumes: Vec::new(),
            map_sequences: Vec::new(),
        };
        let animated = AnimatedScene { scene: Arc::new(scene), motions: vec![None], wind: None };
        Ok(Self { animated, has_camera: false, name, report: imported.warnings })
    }

    /// Reads the `.glb` of the whole scene in the folder of a bake.
    /// # Errors
    /// S001 for a bake without such a file, those of the manifest, and as [`PreviewScene::of_mesh_file`].
    pub fn of_bake(folder: &Path, search: &[PathBuf], limits: &Limits) -> Result<Self> {
        let (manifest, _) = manifest::verify(folder, limits.get("json-bytes"))?;
        // The Blender profile is preferred; the web profile is used if the other was not written.
        match manifest.scene_glb(Profile::Blender).or_else(|| manifest.scene_glb(Profile::Web)) {
            Some(path) => Self::of_mesh_file(&folder.join(path), search, limits),
            None => {
                let message = format!("\"{}\" is a bake without a .glb of the whole scene", folder.display());
                let help = "preview its scene file, or bake it again with --formats glb";
                Err(Diagnostic::about("S001", message).help(help).into())
            }
        }
    }

    /// Inserts warnings from before the assembly, such as those of the scene's text, before the others.
    #[must_use]
    pub fn with_warnings(mut self, mut earlier: Report) -> Self {
        earlier.extend(self.report);
        self.report = earlier;
        self
    }

    /// The scene at rest, without the motions that frames need.
    pub fn scene(&self) -> &Scene {
        &self.animated.scene
    }

    /// Whether the keys `camera.eye` or `camera.target` place a camera; false for mesh files.
    pub fn has_camera(&self) -> bool {
        self.has_camera
    }

    /// Name of the scene, or stem of the mesh file, from which output files are named.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Warnings of the scene, of grammars and growth, or of the mesh file.
    pub fn report(&self) -> &Report {
        &self.report
    }

    /// Whether some asset has a motion, so that frames of the clip can differ.
    pub fn is_animated(&self) -> bool {
        self.animated.motions.iter().any(Option::is_some)
    }

    /// First and last frame of the clip; both are the same for a still scene.
    pub fn frame_range(&self) -> std::ops::RangeInclusive<u32> {
        let clip = self.animated.scene.clip;
        clip.start..=clip.end
    }

    /// Evaluates the motions of all assets at frame `number`, with the phases of copies.
    /// # Errors
    /// `Range` outside of the clip, `Simulation` where a solver diverges, `Cancelled`.
    pub fn frame(&self, number: u32) -> Result<Frame> {
        let range = self.frame_range();
        if !range.contains(&number) {
            let (min, max) = (f64::from(*range.start()), f64::from(*range.end()));
            return Err(Error::Range { name: "frame".into(), value: f64::from(number), min, max, unit: "" });
        }
        evaluate_frame(&self.animated.scene, &self.animated.motions, number, true)
    }

    /// Evaluates a frame. For `None`, the result is that of a still picture: the scene at rest (`None`), or the first frame if
    /// catkins fly, since at rest none of them is in the air.
    /// # Errors
    /// As [`PreviewScene::frame`].
    pub fn frame_or_rest(&self, number: Option<u32>) -> Result<Option<Frame>> {
        let has_flight = self.animated.scene.tables.iter().any(|table| table.name == "flight");
        match number.or(has_flight.then_some(self.animated.scene.clip.start)) {
            Some(number) => self.frame(number).map(Some),
            None => Ok(None),
        }
    }

    /// Bounds and points that a fitted camera frames. `frame`: `None` for rest.
    /// # Errors
    /// P001 if nothing is visible.
    pub fn subject(&self, frame: Option<&Frame>) -> Result<Subject> {
        let subject = Subject::of(self.scene(), frame);
        if subject.is_empty() {
            let reason =
                format!("\"{}\" is empty: no line, leaf, polygon or ground is visible; see `osier check`", self.name);
            return Err(Error::input("P001", reason));
        }
        Ok(subject)
    }
}

/// Limits the sides of all maps to the resolution that a picture of this quality displays, which saves painting larger ones.
fn cap_map_sides(recipe: &mut Recipe, quality: Quality) {
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
        // One map covers the whole terrain, so that it may have more texels.
        terrain.keys.side = terrain.keys.side.min(4 * side);
    }
}
