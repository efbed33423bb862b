//! Growth by particle-shapes: nanoseconds per node, with and without light; milliseconds of the preset `tree`, a thousand of its seeds on
//! all threads.
#![allow(clippy::print_stdout, clippy::disallowed_methods, clippy::expect_used, reason = "a bench tells times")]

use std::time::Instant;

use osier::bake::assets::growth_site::GrowthSite;
use osier::bake::assets::plant_growth::grow_plant;
use osier::bake::assets::plant_materials::plant_materials;
use osier::bake::assets::skin_options::{BarkTiles, skin_options};
use osier::bake::scene::layout::lay_out_scene;
use osier::bake::{BakeContext, scene::plant_layout::Individual};
use osier::limits::Limits;
use osier::par::{on_threads, par_map};
use osier::progress::{Cancel, Silent};
use osier::recipe::{Recipe, Request, resolve};
use osier::surface::{PlantSkin, skin_into};

const ROUNDS: u32 = 7;

/// Least seconds of a few rounds.
fn best(mut f: impl FnMut()) -> f64 {
    (0..ROUNDS)
        .map(|_| {
            let start = Instant::now();
            f();
            start.elapsed().as_secs_f64()
        })
        .fold(f64::MAX, f64::min)
}

fn recipe(set: &[&str]) -> Recipe {
    let set = set.iter().map(|s| format!("plants.tree.{s}")).collect();
    resolve(&Request { set, ..Request::shapes("tree", "tree.shapes") }).expect("scene").0
}

fn main() {
    let work = BakeContext { limits: &Limits::default(), cancel: &Cancel::default(), progress: &Silent, cache: None };
    for (what, set) in [
        ("plain", &[][..]),
        ("without leaves", &["growth.leaf_spacing=0"]),
        ("with light", &["growth.light=[0, 1, 1, 1]", "growth.leaf_spacing=0"]),
    ] {
        let recipe = recipe(set);
        let look = plant_materials(&recipe.plants[0], 0, &work).expect("look");
        let layout = lay_out_scene(&recipe, &work).expect("layout").plants;
        let grow = |individual: &Individual| {
            grow_plant(&recipe.plants[0], individual, &look, GrowthSite::default(), &work).expect("plant").plant
        };
        let first = &layout.individuals[0];
        let plant = grow(first);
        let (nodes, leaves) = (plant.nodes.len(), plant.organs.len());
        let one = on_threads(1, || best(|| drop(grow(first))));
        println!(
            "{what}: {nodes} nodes, {leaves} leaves: {:.2} ms on one thread, {:.0} ns a node",
            one * 1e3,
            one / nodes as f64 * 1e9
        );
        if !set.is_empty() {
            continue;
        }
        let options = skin_options(&recipe.plants[0].skin, BarkTiles { bark: [0.5; 2], shoot: [0.5; 2] }, &work);
        let mut skin = PlantSkin::default();
        let lofted = on_threads(1, || best(|| skin_into(&plant, &options, &mut skin).expect("skin")));
        println!("  its skin: {} vertices, {:.2} ms", skin.mesh.points.len(), lofted * 1e3);
        let seeds: Vec<Individual> = (0..1000).map(|seed| Individual { seed, ..first.clone() }).collect();
        let start = Instant::now();
        let total: usize = par_map(&seeds, |individual| grow(individual).nodes.len()).into_iter().sum();
        println!("  1,000 seeds, {total} nodes: {:.2} s on all threads", start.elapsed().as_secs_f64());
    }
}
