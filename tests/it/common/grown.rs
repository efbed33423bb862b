//! Presets through the library, as the command line takes them: recipe, then bake.
#![allow(dead_code, reason = "each test file uses its own share")]
#![allow(clippy::expect_used, reason = "a test fails by panicking")]

use osier::bake::BakeContext;
use osier::bake::assets::growth_site::GrowthSite;
use osier::bake::assets::material_set::PlantMaterials;
use osier::bake::assets::plant_growth::grow_plant;
use osier::bake::assets::plant_materials::plant_materials;
use osier::bake::assets::plant_mesh::build_plant_asset;
use osier::bake::assets::seasons::add_season_materials;
use osier::bake::assets::skin_options::skin_options;
use osier::bake::assets::species_growth::grow_species;
use osier::bake::scene::layout::lay_out_scene;
use osier::bake::scene::{AssembledScene, SceneOptions, assemble_scene};
use osier::grow::years::RecordedTree;
use osier::limits::Limits;
use osier::plant::Plant;
use osier::presets::Preset;
use osier::progress::{Cancel, Silent};
use osier::recipe::{Growth, PlantRecipe, Recipe, Request, resolve};
use osier::scene::Asset;
use osier::surface::{PlantSkin, skin};

/// Pixels along a side of the maps where a test does not look at them.
const SMALL: u32 = 16;

/// The recipe of a preset; `seed` replaces its own. Maps are drawn small unless `maps` is true.
pub fn recipe(preset: &Preset, seed: Option<u64>, maps: bool) -> Recipe {
    let (stem, ending) = preset.name.split_once('.').expect("ending");
    let mut request = if ending == "l" {
        Request::bare(stem, preset.name)
    } else if ending == "shapes" {
        Request::shapes(stem, preset.name)
    } else if ending == "ifs.toml" {
        Request::tree(stem, preset.name)
    } else {
        Request { name: stem.into(), shown: preset.name.into(), text: preset.text.into(), ..Request::default() }
    };
    request.seed = seed;
    let mut recipe = resolve(&request).unwrap_or_else(|e| panic!("{}: {e}", preset.name)).0;
    if !maps {
        small(&mut recipe);
    }
    recipe
}

/// Draws the maps of a recipe small.
pub fn small(recipe: &mut Recipe) {
    recipe.plants.iter_mut().for_each(small_maps);
    recipe.ground.side = SMALL;
}

fn small_maps(plant: &mut PlantRecipe) {
    (plant.bark.side, plant.shoot.side) = (SMALL, SMALL);
    plant.organs.iter_mut().for_each(|o| o.keys.side = SMALL);
}

/// Scene and movers of a recipe.
pub fn stage(recipe: &Recipe, parts: SceneOptions) -> AssembledScene {
    with_work(|work| assemble_scene(recipe, parts, work)).unwrap_or_else(|e| panic!("{}: {e}", recipe.name))
}

/// Calls `f` with what work needs, nobody listening.
fn with_work<T>(f: impl FnOnce(&BakeContext<'_>) -> T) -> T {
    f(&BakeContext { limits: &Limits::default(), cancel: &Cancel::default(), progress: &Silent, cache: None })
}

/// One individual of a still scene, with what its asset was made from.
pub struct Grown {
    pub plant: Plant,
    pub skin: PlantSkin,
    pub asset: Asset,
    /// How far its foot goes on below the ground, m.
    pub bury: f32,
    /// Whether its branches leave bent parents at small angles: particle-shapes, and trees grown year by year.
    pub leans: bool,
    /// Whether its axes are blades of grass.
    pub blades: bool,
}

/// All individuals of a recipe at rest, one after the other as [`assemble_scene`] makes them.
pub fn individuals(recipe: &Recipe) -> Vec<Grown> {
    let layout = with_work(|w| lay_out_scene(recipe, w)).expect("layout").plants;
    let trees = with_work(|w| grow_species(recipe, &layout, &[], w.limits)).expect("trees");
    let one = |(individual, tree): (&osier::bake::scene::plant_layout::Individual, &Option<RecordedTree>)| {
        let site = GrowthSite { tree: tree.as_ref(), ..GrowthSite::default() };
        let keys = &recipe.plants[individual.plant];
        let mut look = with_work(|w| plant_materials(keys, recipe.general.seed, w)).expect("look");
        add_season_materials(&mut look, keys, recipe.general.seed).expect("colours");
        let grown = with_work(|w| grow_plant(keys, individual, &look, site, w)).expect("plant");
        let kind =
            PlantMaterials { tiles: look.bark_tiles(), organ_names: look.names.clone(), ..PlantMaterials::default() };
        let skin = with_work(|w| skin(&grown.plant, &skin_options(&keys.skin, kind.tiles, w))).expect("skin");
        let asset = with_work(|w| build_plant_asset(&grown, keys, &kind, individual, None, w)).expect("asset").0;
        let leans = matches!(keys.growth, Growth::Shapes(_) | Growth::Species(_));
        let blades = matches!(&keys.growth, Growth::Shapes(shapes) if shapes.blade_width.is_some());
        Grown { plant: grown.plant, skin, asset, bury: osier::math::narrow(keys.skin.bury), leans, blades }
    };
    layout.individuals.iter().zip(&trees).map(one).collect()
}
