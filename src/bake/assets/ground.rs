//! The wavy ground disc under a scene without terrain.

use glam::Vec3;

use crate::bake::assets::material_set::MaterialSet;
use crate::bake::scene::builder::{GROUND_ID, SceneBuilder};
use crate::bake::scene::plant_layout::PlantLayout;
use crate::recipe::Recipe;
use crate::recipe::scene::GroundKeys;
use osier_base::Result;
use osier_base::geometry::Bounds;
use osier_base::math::narrow;
use osier_base::rng::{mix64, word};
use osier_plants::surface::ground::{Ground, GroundColors, ground_material};
use osier_scene::{Asset, AssetKind, Mesh, MeshMotion, MeshObject, Trs};

/// A wavy ground disc and where it lies in the world.
pub(crate) struct PlacedGround {
    pub(crate) shape: Ground,
    /// World position of the disc's centre at height 0, m.
    pub(crate) center: Vec3,
}

/// Shape of the ground that the keys describe, centred at the origin of its asset space; the scene's seed chooses its waves.
pub(crate) fn ground_shape(keys: &GroundKeys, seed: u64) -> Ground {
    Ground {
        radius: narrow(keys.size * 0.5),
        amplitude: narrow(keys.relief),
        wavelength: narrow(keys.wavelength),
        tile: narrow(keys.tile),
        seed: mix64(&[seed, word("ground")]),
        ..Ground::default()
    }
}

/// Painted material and images of a ground. `horizon`: linear colour of the sky at the horizon, into which the far ground
/// fades.
/// # Errors
/// `Range` for a value that the painter of the ground refuses.
pub(crate) fn ground_materials(shape: &Ground, keys: &GroundKeys, horizon: [f32; 3]) -> Result<MaterialSet> {
    let defaults = GroundColors::default();
    let scaled = |c: [f32; 3], k: f32| c.map(|v| v * k);
    // The haze is lit by the sun like the ground: with the full brightness of the sky it would be brighter than the sky.
    let haze = (scaled(horizon, 0.7), if shape.is_one_repeat() { narrow(keys.haze) } else { 0.0 });
    let colors = GroundColors {
        haze,
        soil: keys.color.map_or(defaults.soil, |c| [scaled(c, 0.3), c]),
        green: keys.color2.map_or(defaults.green, |c| [scaled(c, 0.3), c]),
        cover: narrow(keys.cover),
        ..defaults
    };
    let mut set = MaterialSet::default();
    let surface = ground_material(&colors, "ground", keys.side, shape.tile, shape.seed)?;
    set.add(surface.material, surface.images)?;
    Ok(set)
}

/// Centres the ground under the plants and raises each plant to the ground's height at its foot, except those at absolute heights.
pub(crate) fn place_on_ground(recipe: &Recipe, layout: &mut PlantLayout) -> PlacedGround {
    let shape = ground_shape(&recipe.ground, recipe.general.seed);
    let feet = Bounds::of(layout.instances.iter().map(|s| s.transform.t));
    let center = feet.center() * Vec3::new(1.0, 0.0, 1.0);
    for instance in layout.instances.iter_mut().filter(|i| !i.absolute_height) {
        let local = instance.transform.t - center;
        instance.transform.t.y += shape.height(local.x, local.z);
    }
    PlacedGround { shape, center }
}

/// Adds the ground's asset, centred at `center` (world, m). `materials` and `mesh` were made earlier, while the plants grew.
/// # Errors
/// `TooMany` beyond 2^32 materials or images.
pub(crate) fn add_ground(
    materials: MaterialSet,
    mut mesh: Mesh,
    center: Vec3,
    builder: &mut SceneBuilder,
) -> Result<()> {
    let materials = builder.add_materials(materials)?;
    mesh.subsets.iter_mut().for_each(|s| s.material += materials.first_material);
    let asset = Asset {
        id: GROUND_ID.into(),
        kind: AssetKind::Terrain,
        group: String::new(),
        skeleton: None,
        meshes: vec![MeshObject { name: "ground".into(), mesh, motion: MeshMotion::Still, skin: None }],
        instancers: Vec::new(),
        points: Vec::new(),
        curves: Vec::new(),
        rigged: None,
    };
    builder.add_placed(asset, Trs::translation(center), None);
    Ok(())
}
