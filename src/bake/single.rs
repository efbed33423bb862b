//! How large a file of its own a still scene becomes.

use super::counts::{Counts, count};
use super::memory::predicted;
use super::stage::Built;
use super::write::Stage;
use crate::recipe::Recipe;
use crate::recipe::sections::{Format, Profile};
use osier_base::{Error, Result};
use osier_scene::{Asset, AssetKind, Scene};

/// Bytes of lines of an OBJ file. Own: as measured on trees; corners of a face have three numbers.
const OBJ_POINT: u64 = 33;
const OBJ_NORMAL: u64 = 36;
const OBJ_UV: u64 = 24;
const OBJ_FACE: u64 = 2;
/// Bytes of a point with its normal and colour, of a face, and of a point of a cloud, in a PLY file.
const PLY_POINT: u64 = 28;
const PLY_FACE: u64 = 13;
const PLY_DOT: u64 = 22;

/// What `osier grow` will write into a file with the ending `ending`, without its dot; `web`: for browsers.
pub fn counts(built: &Built, recipe: &Recipe, ending: &str, web: bool) -> Counts {
    let mut alone = recipe.clone();
    let format = match ending {
        "glb" | "gltf" => Format::Glb,
        "obj" => Format::Obj,
        "ply" => Format::Ply,
        "pov" => Format::Pov,
        _ => Format::Usd,
    };
    alone.output.formats = vec![format];
    alone.output.gltf.profiles = vec![if web { Profile::Web } else { Profile::Blender }];
    let mut counts = count(&built.stage, &alone, 0, &built.weights);
    let pictures = counts.sizes.iter().find(|s| s.0 == "pictures").map_or(0, |s| s.1);
    let own = counts.sizes.first().map_or(0, |s| s.1);
    let merged = Merged::of(&built.stage.scene);
    let (own, pictures) = match format {
        // A bake has everything once in the asset's own file and once in the scene's.
        Format::Glb => (own / 2, 0),
        Format::Obj => (merged.obj(), pictures),
        Format::Ply => (merged.ply(), 0),
        _ => (own, pictures),
    };
    counts.sizes = vec![(format.word(), own)];
    counts.sizes.extend((pictures > 0).then_some(("pictures", pictures)));
    counts.bytes = counts.sizes.iter().map(|s| s.1).sum();
    counts.memory = predicted(&built.stage.scene, &alone, &counts);
    counts.modules = built.modules;
    counts
}

/// Refuses a file that would hold nothing.
/// # Errors
/// X030.
pub fn refuse_empty(stage: &Stage, ending: &str) -> Result<()> {
    let merged = Merged::of(&stage.scene);
    let lines = stage.scene.assets.iter().any(|a| !a.curves.is_empty());
    let (shown, what) = match ending {
        "obj" => (merged.triangles > 0, "no triangle; points and lines are not part of an OBJ file"),
        _ => (merged.triangles > 0 || merged.dots > 0 || lines, "no triangle and no point"),
    };
    if shown {
        return Ok(());
    }
    let reason = format!("\"{}\" makes {what}: nothing is written", stage.scene.name);
    Err(Error::export("X030", reason))
}

/// Refuses a scene whose plants all come out without anything to see, and in which nothing else is seen but ground.
/// # Errors
/// X030.
pub fn refuse_bare(scene: &Scene) -> Result<()> {
    let is_plant = |a: &&Asset| a.kind == AssetKind::Plant;
    let is_bare = |a: &Asset| {
        let one = Merged::asset(a);
        one.triangles == 0 && one.dots == 0 && a.curves.is_empty()
    };
    let grown = scene.assets.iter().filter(|a| a.kind != AssetKind::Terrain);
    if scene.assets.iter().any(|a| is_plant(&a)) && grown.clone().all(is_bare) {
        let reason = format!(
            "\"{}\" grows nothing that can be seen: no segment, leaf or polygon is drawn at the end of the derivation",
            scene.name
        );
        return Err(Error::export("X030", reason));
    }
    Ok(())
}

/// Everything of a scene as one mesh.
#[derive(Debug, Default)]
struct Merged {
    vertices: u64,
    triangles: u64,
    /// Vertices of what has texture coordinates somewhere.
    mapped: u64,
    dots: u64,
}

impl Merged {
    fn of(scene: &Scene) -> Self {
        let each: Vec<Self> = scene.assets.iter().map(Self::asset).collect();
        let mut all = Self::default();
        for one in scene.placements.iter().filter_map(|p| each.get(p.asset)) {
            all.vertices += one.vertices;
            all.triangles += one.triangles;
            all.mapped += one.mapped;
            all.dots += one.dots;
        }
        all
    }

    fn asset(asset: &Asset) -> Self {
        let mut all = Self { dots: asset.points.iter().map(|p| p.positions.len() as u64).sum(), ..Self::default() };
        let mut mapped = false;
        let instances = asset
            .instancers
            .iter()
            .flat_map(|i| i.protos.iter().filter_map(|p| i.prototypes.get(*p as usize)).map(|p| &p.mesh));
        for mesh in asset.meshes.iter().map(|m| &m.mesh).chain(instances) {
            all.vertices += mesh.points.len() as u64;
            all.triangles += mesh.triangles.len() as u64;
            mapped |= !mesh.uvs.is_empty();
        }
        all.mapped = if mapped { all.vertices } else { 0 };
        all
    }

    fn ply(&self) -> u64 {
        let dots = if self.triangles == 0 { self.dots * PLY_DOT } else { 0 };
        self.vertices * PLY_POINT + self.triangles * PLY_FACE + dots
    }

    fn obj(&self) -> u64 {
        let digits = u64::from(self.vertices.max(1).ilog10()) + 1;
        let numbers = if self.mapped > 0 { 9 } else { 6 };
        // Of each number: a blank or a slash and its digits, of which those of the first vertices have fewer.
        let fewer = numbers * 10_u64.pow(u32::try_from(digits).unwrap_or(1) - 1) / self.vertices.max(1);
        let face = OBJ_FACE + 9 + numbers * digits - fewer;
        self.vertices * (OBJ_POINT + OBJ_NORMAL) + self.mapped * OBJ_UV + self.triangles * face
    }
}
