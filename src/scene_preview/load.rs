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
use osier_base::math;
use osier_base::units::radians_f32;
use osier_base::{Error, Result};
use osier_export::gltf::Profile;
use osier_export::manifest::{self, CameraEntry, Manifest, SunEntry};
use osier_import::{ImportOptions, Imported, UpAxis};
use osier_preview::{Quality, Subject};
use osier_scene::{
    Asset, AssetKind, Camera, Clip, Frame, Material, MaterialClass, Mesh, MeshMotion, MeshObject, Placement, Scene,
    Sky, Sun, Trs,
};

/// A scene with its motions, ready to be rendered.
#[derive(Debug)]
pub struct PreviewScene {
    animated: AnimatedScene,
    has_camera: bool,
    has_own_view: bool,
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
        Ok(Self {
            animated: assembled.animated,
            has_camera,
            has_own_view: true,
            name: recipe.name,
            report: assembled.report,
        })
    }

    /// Reads a mesh file (`.glb`, `.gltf`, `.obj`) as a scene. `search`: further folders for the files that it names.
    /// # Errors
    /// `Input` for a damaged file, `Io` if it cannot be read, `Limit`.
    pub fn of_mesh_file(path: &Path, search: &[PathBuf], limits: &Limits) -> Result<Self> {
        Ok(Self::of_imported(path, read_mesh(path, search, limits)?, |_| false))
    }

    /// A mesh as a scene. `is_land`: whether the part of a name is land, on which all others stand.
    fn of_imported(path: &Path, imported: Imported, is_land: impl Fn(&str) -> bool) -> Self {
        let name = path.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default();
        // Land is an asset of its own: cameras are fitted to what stands on it.
        let mut land = vec![false; imported.mesh.triangles.len()];
        for part in imported.parts.iter().filter(|part| is_land(&part.name)) {
            land.get_mut(part.triangles.clone()).into_iter().flatten().for_each(|covered| *covered = true);
        }
        let assets: Vec<Asset> = if land.contains(&true) {
            let standing = triangles_where(&imported.mesh, |i| land.get(i) == Some(&false));
            let below = triangles_where(&imported.mesh, |i| land.get(i) == Some(&true));
            // A scene may show nothing but its land.
            let standing = Some(standing).filter(|mesh| !mesh.triangles.is_empty());
            let standing = standing.map(|mesh| asset_of("mesh", AssetKind::Import, mesh));
            standing.into_iter().chain([asset_of("land", AssetKind::Terrain, below)]).collect()
        } else {
            vec![asset_of("mesh", AssetKind::Import, imported.mesh)]
        };
        let place =
            |(asset, a): (usize, &Asset)| Placement { name: a.id.clone(), asset, transform: Trs::IDENTITY, phase: 0 };
        let placements = assets.iter().enumerate().map(place).collect();
        let motions = vec![None; assets.len()];
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
            assets,
            placements,
            land: None,
            tables: Vec::new(),
            enum_labels: Vec::new(),
            fields: Vec::new(),
            air: Vec::new(),
            volumes: Vec::new(),
            map_sequences: Vec::new(),
        };
        let animated = AnimatedScene { scene: Arc::new(scene), motions, wind: None };
        Self { animated, has_camera: false, has_own_view: false, name, report: imported.warnings }
    }

    /// Reads the `.glb` of the whole scene in the folder of a bake, with land, materials, camera and sun of its manifest.
    /// # Errors
    /// S001 for a bake without such a file, those of the manifest, and as [`PreviewScene::of_mesh_file`].
    pub fn of_bake(folder: &Path, search: &[PathBuf], limits: &Limits) -> Result<Self> {
        let (manifest, _) = manifest::verify(folder, limits.get("json-bytes"))?;
        // The Blender profile is preferred; the web profile is used if the other was not written.
        let Some(path) = manifest.scene_glb(Profile::Blender).or_else(|| manifest.scene_glb(Profile::Web)) else {
            let message = format!("\"{}\" is a bake without a .glb of the whole scene", folder.display());
            let help = "preview its scene file; a bake has such a file with format glb and profile web or blender, unless \
                        all that the scene shows are moving points";
            return Err(Diagnostic::about("S001", message).help(help).into());
        };
        let path = folder.join(path);
        let mut imported = read_mesh(&path, search, limits)?;
        set_materials(&mut imported.materials, &manifest);
        let mut read = Self::of_imported(&path, imported, |name| is_land(name, &manifest));
        if let Some(view) = &manifest.view {
            let scene = Arc::make_mut(&mut read.animated.scene);
            (scene.camera, scene.sun) = (camera_of(&view.camera), sun_of(&view.sun));
            read.has_own_view = true;
        }
        Ok(read)
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

    /// Whether the camera of [`PreviewScene::scene`] belongs to the scene; false for mesh files, of which no camera is read.
    pub fn has_own_view(&self) -> bool {
        self.has_own_view
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

/// Reads a mesh file in metres, +Y up.
fn read_mesh(path: &Path, search: &[PathBuf], limits: &Limits) -> Result<Imported> {
    let bytes = files::read_input(path, limits.get("mesh-bytes"), "--max-mesh-bytes")?;
    let roots = SearchPaths::new(path, search)?;
    // glTF states which materials transmit light. OBJ does not: its materials are taken for leaves, which do, unless their names
    // say otherwise.
    let is_gltf = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("glb") || e.eq_ignore_ascii_case("gltf"));
    let class = if is_gltf { MaterialClass::Bark } else { MaterialClass::Leaf };
    let options = ImportOptions { roots: &roots, limits, up: UpAxis::Y, scale: 1.0, class };
    let mut imported = osier_import::read(path, &bytes, &options)?;
    if !is_gltf {
        imported.materials.iter_mut().filter(|m| is_named_opaque(&m.name)).for_each(|m| m.translucency = 0.0);
    }
    Ok(imported)
}

/// Whether the name of a material says that no light passes through it: one of wood or ground, such as `oak_bark`, and of no leaf.
fn is_named_opaque(name: &str) -> bool {
    const OPAQUE: [&str; 11] =
        ["bark", "wood", "trunk", "branch", "twig", "shoot", "dead", "ground", "terrain", "wall", "roof"];
    const LEAVES: [&str; 7] = ["leaf", "leaves", "blade", "needle", "frond", "petal", "flower"];
    let name = name.to_ascii_lowercase();
    let has = |words: &[&str]| words.iter().any(|word| name.contains(word));
    has(&OPAQUE) && !has(&LEAVES)
}

/// An asset of one mesh that stands still.
fn asset_of(id: &str, kind: AssetKind, mesh: Mesh) -> Asset {
    Asset {
        id: id.into(),
        kind,
        group: String::new(),
        skeleton: None,
        meshes: vec![MeshObject { name: id.into(), mesh, motion: MeshMotion::Still, skin: None }],
        instancers: Vec::new(),
        points: Vec::new(),
        curves: Vec::new(),
        rigged: None,
    }
}

/// The triangles of an imported mesh that `is_kept` accepts by their index, with the points that they use.
fn triangles_where(mesh: &Mesh, is_kept: impl Fn(usize) -> bool) -> Mesh {
    let mut kept = Mesh::default();
    let mut new_index: Vec<Option<u32>> = vec![None; mesh.points.len()];
    for subset in &mesh.subsets {
        let numbered = mesh.subset_triangles(subset).iter().zip(subset.first as usize..);
        let mut triangles = Vec::new();
        for (triangle, _) in numbered.filter(|(_, i)| is_kept(*i)) {
            triangles.push(triangle.map(|point| {
                let old = point as usize;
                *new_index[old].get_or_insert_with(|| {
                    let new = kept.next_point();
                    kept.points.push(mesh.points[old]);
                    kept.normals.extend(mesh.normals.get(old));
                    kept.uvs.extend(mesh.uvs.get(old));
                    kept.colors.extend(mesh.colors.get(old));
                    new
                })
            }));
        }
        if !triangles.is_empty() {
            kept.append_subset(subset.material, triangles);
        }
    }
    kept
}

/// Whether a part of a baked mesh is terrain. Names of its nodes begin with the name of the asset.
fn is_land(name: &str, manifest: &Manifest) -> bool {
    let node = name.split(' ').next().unwrap_or_default();
    let is_part = |id: &str| node.strip_prefix(id).is_some_and(|rest| rest.is_empty() || rest.starts_with('_'));
    // If the node name fits several assets, such as `ground` and `ground_elder`, the longest asset name is meant.
    let asset = manifest.assets.iter().filter(|a| is_part(&a.id)).max_by_key(|a| a.id.len());
    asset.is_some_and(|a| a.kind == AssetKind::Terrain.word())
}

/// Sets properties that glTF does not hold: bark does not transmit light, water refracts.
fn set_materials(materials: &mut [Material], manifest: &Manifest) {
    const CLASSES: [MaterialClass; 5] =
        [MaterialClass::Bark, MaterialClass::Leaf, MaterialClass::Catkin, MaterialClass::Water, MaterialClass::Ground];
    for material in materials {
        let Some(entry) = manifest.materials.iter().find(|entry| entry.name == material.name) else { continue };
        material.class = CLASSES.into_iter().find(|c| c.word() == entry.class).unwrap_or(material.class);
        material.translucency = entry.params.translucency;
        material.ior = entry.params.ior;
    }
}

/// The camera of a manifest.
fn camera_of(entry: &CameraEntry) -> Camera {
    let axis = |i: usize| glam::Vec3::from_slice(&entry.matrix[i..i + 3]);
    let (right, back, eye) = (axis(0), axis(8), axis(12));
    let level = math::normalize_or(glam::Vec3::Y.cross(back), glam::Vec3::X);
    // The inverse of `Camera::axes`, which turns the level axis by -roll about the viewing axis.
    let turn = math::atan2(f64::from(back.cross(level).dot(right)), f64::from(level.dot(right)));
    Camera { eye, target: eye - back, vfov: radians_f32(entry.vfov_deg), roll: -math::narrow(turn) }
}

/// The sun of a manifest.
fn sun_of(entry: &SunEntry) -> Sun {
    let [x, y, z] = entry.toward.map(f64::from);
    let strength = entry.irradiance.into_iter().fold(0.0, f32::max);
    Sun {
        elevation: math::narrow(math::atan2(y, (x * x + z * z).sqrt())),
        azimuth: math::narrow(math::atan2(x, z)),
        color: if strength > 0.0 { entry.irradiance.map(|c| c / strength) } else { [1.0; 3] },
        strength,
        angle: radians_f32(entry.angle_deg),
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_wood_and_ground_are_opaque() {
        assert!(["oak_bark", "Trunk.001", "oak_shoot", "ground", "house_wall"].into_iter().all(is_named_opaque));
        assert!(!["oak_leaf", "Material.001", "woodbine_leaf", "dead_needles"].into_iter().any(is_named_opaque));
    }
}
