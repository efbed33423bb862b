//! Maps of the water on bark that drops strike: a coat over the faces that rain reaches, whose wetness changes over the clip.
//!
//! The texture of bark repeats over a plant, and so does its map of wetness: it is a patch of bark on which as many drops per area
//! leave spots as on the bark of the plants that have the material.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use super::scene_leaf::WETNESS;
use super::wet_surfaces::{WorldSurface, group_faces, rain_exposed_faces};
use crate::bake::scene::builder::SceneBuilder;
use osier_base::Result;
use osier_base::convert::{index, to_usize};
use osier_base::files::{Names, safe_name};
use osier_base::math;
use osier_motion::rain::{BarkPatch, BarkPatchParams, DropParams, RainExposure, RainFrame};
use osier_scene::{
    Coat, MapEncoding, MapFrame, MapLayer, MapSequence, MapTexels, Material, MaterialClass, MaterialId, Mesh,
    MeshMotion,
};

/// The only layer of a map of bark.
const LAYER: MapLayer = MapLayer { name: WETNESS, file_kind: "exr.wetness", encoding: MapEncoding::Unit };
/// Width of a texel, m. Own: a drop of 1 mm wets a spot of two texels.
const TEXEL: f64 = 2e-3;
/// Smallest and largest side of a map, texels. Own: fewer would show their grid, more would make files as large as those of a leaf
/// that is seen from near.
const SIDES: [usize; 2] = [32, 256];

/// The film of water under the spots that drops wet, and the seed and drying of these.
pub(super) struct BarkSetting<'a> {
    /// Rain on the faces of the scene; used where no film has told wet faces from dry ones.
    pub(super) exposure: &'a RainExposure,
    /// Materials of the faces that a film of earlier rain covers; `None` without a film.
    pub(super) film: Option<&'a BTreeSet<MaterialId>>,
    /// Factor of that film on the albedo; 1 without a film.
    pub(super) film_albedo: f32,
    pub(super) params: &'a DropParams,
    /// Number of plants: the first assets of the scene.
    pub(super) plants: usize,
    /// Value of the key `maps.height_range_m`, m.
    pub(super) height_range: f32,
}

/// A patch of bark before the first drop, and the plants whose strikes wet it.
#[derive(Debug)]
pub(super) struct StruckBark {
    params: BarkPatchParams,
    /// Indices of the plants that have the material.
    plants: BTreeSet<usize>,
}

impl StruckBark {
    /// The dry patch.
    pub(super) fn dry_patch(&self) -> BarkPatch {
        BarkPatch::new(self.params.clone())
    }

    /// Wets the patch by the strikes of a frame.
    pub(super) fn wet(&self, patch: &mut BarkPatch, frame: &RainFrame) {
        frame.wood_strikes.iter().filter(|s| self.plants.contains(&s.plant)).for_each(|strike| patch.wet(strike));
    }
}

/// The map of a patch at time `t` of the simulation, s.
pub(super) fn bark_map_frame(patch: &BarkPatch, t: f64) -> MapFrame {
    MapFrame { layers: vec![MapTexels::Scalar(Arc::new(patch.wetness(t)))] }
}

/// Areas of the faces of a bark that rain reaches.
#[derive(Debug, Clone, Default)]
struct ExposedBark {
    /// In the world, m^2.
    area: f64,
    /// In texture coordinates.
    uv_area: f64,
    /// Indices of the plants that have the material.
    plants: BTreeSet<usize>,
}

/// Gives the faces of bark that rain reaches a coat of water; returns the patches of bark that wet it, and their map sequences, both in
/// the order of materials. Plants whose bark changes from frame to frame as a whole, or has no texture coordinates, get none.
/// # Errors
/// `TooMany` beyond 2^32 materials or map sequences.
pub(super) fn add_bark_maps(
    setting: &BarkSetting<'_>,
    first_sequence: usize,
    builder: &mut SceneBuilder,
) -> Result<(Vec<StruckBark>, Vec<MapSequence>)> {
    // Find the faces that rain reaches, and their areas by material and by plant.
    let mut exposed_faces: BTreeMap<[usize; 2], Vec<bool>> = BTreeMap::new();
    let mut exposed: BTreeMap<MaterialId, ExposedBark> = BTreeMap::new();
    let mut plant_areas = vec![0.0; setting.plants];
    for (k, asset) in builder.assets.iter().enumerate().take(setting.plants) {
        let Some(placement) = builder.placements.iter().find(|p| p.asset == k) else { continue };
        for (i, object) in asset.meshes.iter().enumerate() {
            let mesh = &object.mesh;
            let is_textured = mesh.uvs.len() == mesh.points.len();
            if object.motion == MeshMotion::Varying || !is_textured || !has_bark(mesh, &builder.materials) {
                continue;
            }
            let faces = match setting.film {
                Some(wet) => faces_of_materials(mesh, wet),
                None => {
                    let surface = WorldSurface { exposure: setting.exposure, transform: placement.transform };
                    rain_exposed_faces(mesh, &surface)
                }
            };
            let scale = f64::from(placement.transform.s.x);
            for subset in mesh.subsets.iter().filter(|s| is_bark(&builder.materials, s.material)) {
                let range = to_usize(subset.first)..to_usize(subset.first + subset.count);
                for face in range.filter(|face| faces.get(*face).copied().unwrap_or(false)) {
                    let [area, uv_area] = face_areas(mesh, mesh.triangles[face]);
                    let of_material = exposed.entry(subset.material).or_default();
                    of_material.area += area * scale * scale;
                    of_material.uv_area += uv_area;
                    of_material.plants.insert(k);
                    plant_areas[k] += area * scale * scale;
                }
            }
            exposed_faces.insert([k, i], faces);
        }
    }

    // A material with a coat for each bark with such faces.
    let (mut barks, mut sequences, mut coated, mut names) = (Vec::new(), Vec::new(), BTreeMap::new(), Names::default());
    for (material, of) in exposed {
        if of.uv_area <= 0.0 || of.area <= 0.0 {
            continue;
        }
        let plain = builder.materials[to_usize(material)].clone();
        let name = names.unique(&safe_name(&format!("{}_struck", plain.name)));
        let sequence = index(first_sequence + sequences.len(), "map sequences")?;
        let darkening = Coat::WET_ALBEDO / setting.film_albedo;
        coated.insert(material, index(builder.materials.len(), "materials of a scene")?);
        let coat = Some(Coat { sequence, weight: WETNESS, darkening });
        builder.materials.push(Material { name: name.clone(), coat, ..plain });
        // The mean length of a repeat of the texture.
        let width = math::sqrt(of.area / of.uv_area);
        let side = map_side(width);
        sequences.push(MapSequence {
            name: name.clone(),
            side,
            height_range: setting.height_range,
            layers: vec![LAYER],
            rest: None,
        });
        // Drops strike all bark of a plant alike, whatever its material.
        let bark_area = of.plants.iter().map(|k| plant_areas[*k]).sum();
        let (law, seed) = (setting.params.drying_law(), setting.params.seed);
        barks.push(StruckBark {
            params: BarkPatchParams { side, width, bark_area, law, seed, name },
            plants: of.plants,
        });
    }
    for ([k, i], faces) in &exposed_faces {
        group_faces(&mut builder.assets[*k].meshes[*i].mesh, faces, &coated);
    }
    Ok((barks, sequences))
}

fn is_bark(materials: &[Material], id: MaterialId) -> bool {
    materials.get(to_usize(id)).is_some_and(|m| m.class == MaterialClass::Bark && m.coat.is_none())
}

fn has_bark(mesh: &Mesh, materials: &[Material]) -> bool {
    mesh.subsets.iter().any(|s| s.count > 0 && is_bark(materials, s.material))
}

/// Whether each triangle has one of the materials; parallel to the triangles.
fn faces_of_materials(mesh: &Mesh, of: &BTreeSet<MaterialId>) -> Vec<bool> {
    let mut faces = vec![false; mesh.triangles.len()];
    for subset in mesh.subsets.iter().filter(|s| of.contains(&s.material)) {
        faces[to_usize(subset.first)..to_usize(subset.first + subset.count)].fill(true);
    }
    faces
}

/// Areas of a triangle in the mesh, m^2, and in texture coordinates.
fn face_areas(mesh: &Mesh, corners: [u32; 3]) -> [f64; 2] {
    let [a, b, c] = corners.map(|i| mesh.points[to_usize(i)]);
    let [u, v, w] = corners.map(|i| mesh.uvs[to_usize(i)]);
    [0.5 * f64::from((b - a).cross(c - a).length()), 0.5 * f64::from((v - u).perp_dot(w - u).abs())]
}

/// Texels along a map of the width, m: a power of two.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "saturating, and clamped")]
fn map_side(width: f64) -> usize {
    ((width / TEXEL).ceil() as usize).clamp(SIDES[0], SIDES[1]).next_power_of_two()
}
