//! The terrain of a scene: its heights, materials and asset.

use glam::{Vec2, Vec3};

use crate::bake::assets::material_set::MaterialSet;
use crate::bake::scene::builder::SceneBuilder;
use crate::recipe::scene::TerrainKeys;
use crate::recipe::{TerrainFile, TerrainRecipe};
use osier_base::diagnostic::Diagnostic;
use osier_base::math::narrow;
use osier_base::rng::{mix64, word};
use osier_base::{Error, Result};
use osier_import::{HeightMap, HeightUnit, Imported};
use osier_plants::surface::terrain::{
    HeightMapParams, Terrain, TerrainColors, TerrainParams, TerrainSurface, terrain_material,
};
use osier_scene::solid::{CellDiagonal, LandForm, LandGrid};
use osier_scene::{
    Asset, AssetKind, Camera, HeightField, Maps, Material, MaterialClass, Mesh, MeshMotion, MeshObject, Trs,
};

/// Name of the terrain's asset, placement and material.
pub const NAME: &str = "terrain";
/// Height above the ground to which a buried camera is lifted, m: that of a standing person's eye.
const EYE_HEIGHT: f32 = 1.6;
/// Roughness of a terrain with a colour picture, which does not give it. Own: that of the painted ground.
const TEXTURED_ROUGHNESS: f32 = 0.95;

/// Makes the terrain that a recipe describes, with a warning if its mesh is no height field. `seed`: the scene's, which is
/// combined with the terrain's, if that has one.
/// # Errors
/// `Range` for a value outside its range; X010 for a mesh without a triangle that a vertical line can meet.
pub(crate) fn build_terrain(recipe: &TerrainRecipe, seed: u64) -> Result<(Terrain, Option<Diagnostic>)> {
    match &recipe.file {
        None => Ok((generate_terrain(&recipe.keys, seed)?, None)),
        Some(TerrainFile::Map(map)) => Ok((map_terrain(map, &recipe.keys)?, None)),
        Some(TerrainFile::Mesh(mesh)) => mesh_terrain(mesh, &recipe.keys),
    }
}

/// Terrain of a height map. Values of a PNG are shares of the key `height`; values of an EXR are metres times the key `scale`.
fn map_terrain(map: &HeightMap, keys: &TerrainKeys) -> Result<Terrain> {
    // Height, m, of a map value of 1.
    let unit = match map.unit {
        HeightUnit::Fraction { .. } => keys.height,
        HeightUnit::Values => keys.scale,
    };
    let heights: Vec<f32> = map.values.iter().map(|v| narrow(f64::from(*v) * unit + keys.offset)).collect();
    Terrain::from_height_map(
        &heights,
        &HeightMapParams {
            counts: [map.width, map.height],
            width: narrow(keys.size),
            center: keys.at.map(narrow),
            stride: keys.stride,
            smooth: keys.smooth,
            floor: keys.floor.map(narrow),
        },
    )
}

/// World position of the origin of a terrain's mesh, m.
fn mesh_origin(keys: &TerrainKeys) -> Vec3 {
    let [x, z] = keys.at.map(narrow);
    Vec3::new(x, narrow(keys.offset), z)
}

/// Terrain of an imported mesh, with warning X027 if surfaces of it lie above each other.
fn mesh_terrain(imported: &Imported, keys: &TerrainKeys) -> Result<(Terrain, Option<Diagnostic>)> {
    let origin = mesh_origin(keys);
    let points: Vec<Vec3> = imported.mesh.points.iter().map(|p| *p + origin).collect();
    let surface = TerrainSurface::new(&points, &imported.mesh.triangles).ok_or_else(|| {
        let help = "export the faces of the terrain; mesh_up = \"z\" if it stands upright";
        let name = keys.file.as_ref().map_or(NAME, |file| file.text.as_str());
        let text = format!("\"{name}\": the terrain has no surface that can be seen from above");
        Error::from(Diagnostic::about("X010", text).help(help))
    })?;
    let made = Terrain::from_mesh(surface, 1 << keys.subdivisions)?;
    let folded = (made.folded > 0).then(|| {
        let samples = made.land.heights.len();
        let name = keys.file.as_ref().map_or(NAME, |file| file.text.as_str());
        let text = format!(
            "\"{name}\": surfaces of the terrain lie above each other at {} of {samples} samples: the highest is the ground",
            made.folded
        );
        let help = "plants, seeds, rain and wind take the top of an overhang for the ground; remove undersides and caves if that is wrong";
        Diagnostic::about("X027", text).help(help)
    });
    Ok((made.land, folded))
}

fn generate_terrain(keys: &TerrainKeys, seed: u64) -> Result<Terrain> {
    Terrain::generate(&TerrainParams {
        n: keys.subdivisions,
        size: keys.size,
        amplitude: keys.amplitude,
        exponent: keys.exponent,
        corners: keys.corners,
        tileable: keys.tileable,
        paper: keys.paper,
        floor: keys.floor,
        smooth: keys.smooth,
        stride: keys.stride,
        // A terrain with a seed other than 0 differs from others of the same scene seed.
        seed: if keys.seed == 0 { seed } else { mix64(&[seed, keys.seed]) },
    })
}

/// The terrain as a solid for seeds, trees, wind and rain, with the surface of its mesh: every `stride`-th height, cells divided as in
/// the mesh; of an imported mesh its height samples. `None` if the grid forms no surface.
pub(crate) fn shown_terrain_solid(terrain: &Terrain) -> Option<LandForm> {
    let stride = terrain.stride.max(1);
    let counts = terrain.counts.map(|n| (n - 1) / stride + 1);
    let row = |j: usize| (0..counts[0]).map(move |i| terrain.height(i * stride, j * stride));
    LandForm::over(LandGrid {
        counts,
        width: terrain.size[0],
        center: Vec2::from_array(terrain.center),
        heights: (0..counts[1]).flat_map(row).collect(),
        diagonal: CellDiagonal::SmallerDifference,
    })
}

/// Materials and images of a terrain: of the mesh's file, a colour picture, or painted earth, grass, and rock where it is steep.
/// # Errors
/// `Range` for a value that the painter of the map refuses.
fn terrain_materials(terrain: &Terrain, recipe: &TerrainRecipe, seed: u64) -> Result<MaterialSet> {
    let mut set = MaterialSet::default();
    let keys = &recipe.keys;
    if let Some(picture) = &recipe.texture {
        let mut image = picture.clone();
        image.name = format!("{NAME}_color");
        // White, as of imported meshes: PLY then takes the colours of vertices from the picture.
        let plain = Material::plain(NAME.into(), MaterialClass::Ground, [1.0; 3], TEXTURED_ROUGHNESS);
        let maps = Maps { color: Some(0), ..plain.maps };
        set.add(Material { tile: terrain.size[0], maps, ..plain }, vec![image])?;
        return Ok(set);
    }
    if let Some(TerrainFile::Mesh(mesh)) = recipe.file.as_ref().filter(|_| !keys.paint) {
        set.materials.clone_from(&mesh.materials);
        set.images.clone_from(&mesh.images);
        set.materials.iter_mut().for_each(|m| m.name = format!("{NAME}_{}", m.name));
        return Ok(set);
    }
    let own = TerrainColors::default();
    let colors = TerrainColors {
        earth: keys.color.unwrap_or(own.earth),
        grass: keys.color2.unwrap_or(own.grass),
        rock: keys.rock.unwrap_or(own.rock),
        cover: narrow(keys.cover),
        steep: narrow(keys.steep),
    };
    let surface = terrain_material(terrain, &colors, NAME, keys.side, mix64(&[seed, word(NAME)]))?;
    set.add(surface.material, surface.images)?;
    Ok(set)
}

/// The imported mesh of a terrain in world space; its subsets index the materials from `first_material` on. `draped`: with one
/// picture over the whole terrain, instead of the texture coordinates and materials of the file.
fn artist_mesh(terrain: &Terrain, imported: &Imported, keys: &TerrainKeys, first_material: u32, draped: bool) -> Mesh {
    let origin = mesh_origin(keys);
    let mut mesh = imported.mesh.clone();
    mesh.points.iter_mut().for_each(|p| *p += origin);
    mesh.subsets.iter_mut().for_each(|s| s.material += first_material);
    if draped {
        // u rises from -x to +x and v from +z to -z, both 0..1 over the terrain, as on generated tiles.
        let share = |v: f32, axis: usize| (v - terrain.center[axis]) / terrain.size[axis] + 0.5;
        mesh.uvs = mesh.points.iter().map(|p| Vec2::new(share(p.x, 0), 1.0 - share(p.z, 1))).collect();
        mesh.subsets = Vec::new();
        mesh = mesh.with_material(first_material);
    }
    mesh
}

/// The terrain's asset: one mesh per tile, or the imported mesh; `material`: index of its first material in the scene.
fn terrain_asset(terrain: &Terrain, recipe: &TerrainRecipe, material: u32) -> Asset {
    let object = |(name, mesh): (String, Mesh)| MeshObject { name, mesh, motion: MeshMotion::Still, skin: None };
    let draped = recipe.keys.paint || recipe.texture.is_some();
    let meshes = match &recipe.file {
        Some(TerrainFile::Mesh(imported)) => {
            vec![object((NAME.into(), artist_mesh(terrain, imported, &recipe.keys, material, draped)))]
        }
        _ => terrain.tiles().into_iter().map(|(name, mesh)| object((name, mesh.with_material(material)))).collect(),
    };
    Asset {
        id: NAME.into(),
        kind: AssetKind::Terrain,
        group: String::new(),
        skeleton: None,
        meshes,
        instancers: Vec::new(),
        points: Vec::new(),
        curves: Vec::new(),
        rigged: None,
    }
}

/// Adds the terrain's materials and asset; its meshes are in world space, so that it is placed by the identity.
/// # Errors
/// `Range` for a value that the painter of the map refuses; `TooMany`.
pub(crate) fn add_terrain(
    terrain: &Terrain,
    recipe: &TerrainRecipe,
    seed: u64,
    builder: &mut SceneBuilder,
) -> Result<()> {
    let materials = builder.add_materials(terrain_materials(terrain, recipe, seed)?)?;
    builder.add_placed(terrain_asset(terrain, recipe, materials.first_material), Trs::IDENTITY, None);
    Ok(())
}

/// The terrain's heights in world space, which exporters of height fields write.
pub(crate) fn terrain_height_field(terrain: Terrain) -> HeightField {
    let Terrain { counts, size, center, heights, .. } = terrain;
    HeightField { name: NAME.into(), counts, size, center, heights }
}

/// Lifts a camera that lies below the terrain, together with its target: with another seed, hills rise where the scene's
/// camera stands.
pub(crate) fn lift_camera(camera: &mut Camera, terrain: &Terrain) {
    let eye = camera.eye;
    let ground = terrain.height_at(eye.x, eye.z);
    if terrain.covers(eye.x, eye.z) && eye.y < ground {
        // Eye and target move together, so that the direction of the view stays.
        let rise = ground + EYE_HEIGHT - eye.y;
        camera.eye.y += rise;
        camera.target.y += rise;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seeds_rest_on_the_mesh() {
        for stride in [1, 4] {
            let params = TerrainParams { n: 6, stride, exponent: 0.5, ..TerrainParams::default() };
            let terrain = Terrain::generate(&params).expect("land");
            let land = shown_terrain_solid(&terrain).expect("a surface");
            for k in 0..500_u16 {
                // Spread over the terrain of 200 m, a metre within its border.
                let [x, z] = [0.7549, 0.5698].map(|step| (f32::from(k) * step).fract() * 198.0 - 99.0);
                let (found, shown) = (land.height(Vec2::new(x, z)), terrain.height_at(x, z));
                assert!((found - shown).abs() < 1e-3, "stride {stride} at {x} {z}: {found} {shown}");
            }
        }
    }

    #[test]
    fn no_seed_buries_the_camera_and_others_stay() {
        let view = |eye| Camera { eye, target: eye + Vec3::new(3.0, -1.0, 2.0), vfov: 0.7, roll: 0.0 };
        for seed in 0..16 {
            let terrain = Terrain::generate(&TerrainParams { seed, ..TerrainParams::default() }).expect("land");
            let (x, z) = (terrain.size[0] * 0.1, terrain.size[1] * -0.3);
            let ground = terrain.height_at(x, z);
            let mut camera = view(Vec3::new(x, ground - 7.0, z));
            lift_camera(&mut camera, &terrain);
            assert!((camera.eye.y - ground - EYE_HEIGHT).abs() < 1e-4);
            assert!((camera.target - camera.eye).abs_diff_eq(Vec3::new(3.0, -1.0, 2.0), 1e-4));
            for eye in [Vec3::new(x, ground + 0.2, z), Vec3::new(terrain.size[0], ground - 50.0, z)] {
                let mut camera = view(eye);
                lift_camera(&mut camera, &terrain);
                assert_eq!(camera, view(eye), "seed {seed}");
            }
        }
    }
}
