//! Wind on a birch: nanoseconds per branch and step, per sample of wind, per skinned point and per leaf; then whole clips.
#![allow(clippy::print_stdout, clippy::disallowed_methods, clippy::expect_used, reason = "a bench tells times")]

use std::time::Instant;

use glam::Vec3;
use osier::bake::assets::growth_site::GrowthSite;
use osier::bake::assets::plant_growth::grow_plant;
use osier::bake::assets::plant_materials::plant_materials;
use osier::bake::scene::layout::lay_out_scene;
use osier::bake::scene::{SceneOptions, assemble_scene};
use osier::bake::{BakeContext, motion};
use osier::limits::Limits;
use osier::motion::sway::{BeamElements, JointBudget, JointRig, SwayParams, SwaySimulation, WoodParams};
use osier::plant::Plant;
use osier::presets::find;
use osier::progress::{Cancel, Silent};
use osier::recipe::{Recipe, Request, resolve};
use osier::scene::{Trs, skinned_points, skinning_matrices};
use osier::wind::{GustWind, GustWindOptions, Wind};

const ROUNDS: u32 = 5;

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

fn recipe(name: &str, set: &[&str]) -> Recipe {
    let text = find(&format!("{name}.toml")).expect("preset").text;
    let set: Vec<String> = set.iter().map(|s| (*s).to_owned()).collect();
    resolve(&Request { name: name.into(), text: text.into(), set, ..Request::default() }).expect("scene").0
}

fn grown(name: &str, work: &BakeContext<'_>) -> Plant {
    let recipe = recipe(name, &[]);
    let look = plant_materials(&recipe.plants[0], recipe.general.seed, work).expect("look");
    let layout = lay_out_scene(&recipe, work).expect("layout").plants;
    grow_plant(&recipe.plants[0], &layout.individuals[0], &look, GrowthSite::default(), work).expect("plant").plant
}

/// Simulates 240 frames of up to 2,000 branches.
fn stepped(plant: &Plant, wind: &GustWind, manner: SwayParams) {
    let elements = BeamElements::build(plant, &manner.wood, 2000);
    let (branches, stations) = (elements.list.len(), elements.stations.len());
    let seconds = best(|| {
        let mut run = SwaySimulation::new(&elements, wind, manner);
        for k in 0..240 * run.steps() {
            run.advance(f64::from(k) / (24.0 * f64::from(run.steps())));
        }
    });
    println!(
        "{branches} branches ({stations} stations) x 240 frames x 5 steps: {seconds:.3} s, {:.0} ns a step",
        seconds / (240.0 * 5.0 * branches as f64) * 1e9
    );
}

fn main() {
    let work = BakeContext { limits: &Limits::default(), cancel: &Cancel::default(), progress: &Silent, cache: None };
    let plant = grown("birch", &work);
    let wind = GustWind::new(GustWindOptions { speed: 8.0, period: Some(10.0), ..GustWindOptions::default() });
    let manner = SwayParams {
        wood: WoodParams::default(),
        flicker: 0.15,
        whip: 1.0,
        stand: Trs::IDENTITY,
        gravity: None,
        fps: 24.0,
    };

    stepped(&plant, &wind, manner);
    stepped(&grown("oak", &work), &wind, manner);

    let places: Vec<Vec3> =
        (0..20_000_u16).map(|k| Vec3::new(f32::from(k) * 0.01, f32::from(k % 97) * 0.1, 0.3)).collect();
    let mut air = vec![Vec3::ZERO; places.len()];
    let seconds = best(|| wind.sample(&places, 3.0, &mut air));
    println!("wind: {:.0} ns a sample", seconds / places.len() as f64 * 1e9);

    let few = BeamElements::build(&plant, &manner.wood, 2000);
    let rig = JointRig::build(&plant, &few, JointBudget { joints: 256, coarse: false });
    let bends = vec![[0.1_f32, 0.05]; few.list.len()];
    let bindings: Vec<(u32, f32)> = (0..plant.axes.len())
        .flat_map(|a| plant.nodes_of(&plant.axes[a]).map(move |k| (a, k)))
        .map(|(a, k)| (u32::try_from(a).expect("few"), plant.nodes.s[k]))
        .collect();
    let skin = rig.skin(&plant, bindings.iter().copied());
    let joints = skinning_matrices(&rig.skeleton, &rig.pose(&few, &bends));
    let seconds = best(|| drop(skinned_points(&plant.nodes.p, &skin, &joints)));
    println!("skin: {:.0} M points/s, one thread", plant.nodes.len() as f64 / seconds / 1e6);
    let seconds = best(|| drop(rig.pose(&few, &bends)));
    println!("pose of {} joints: {:.0} us", rig.skeleton.joints.len(), seconds * 1e6);

    for motion in ["skin", "cache"] {
        let set = [format!("plants.birch.motion=\"{motion}\""), "frames.end=240".into(), "wind.speed=8".into()];
        let set: Vec<&str> = set.iter().map(String::as_str).collect();
        let moving = recipe("birch", &set);
        let still = recipe("birch", &[]);
        let before = best(|| drop(assemble_scene(&still, SceneOptions::default(), &work).expect("stage")));
        let start = Instant::now();
        let stage = assemble_scene(&moving, SceneOptions::default(), &work).expect("stage").animated;
        let recorded = start.elapsed().as_secs_f64() - before;
        let frames = best(|| drop(motion::evaluate_frame(&stage.scene, &stage.motions, 100, false)));
        println!(
            "{motion}: {recorded:.2} s to simulate 240 frames and what leads to them, {:.1} ms a frame",
            frames * 1e3
        );
    }
}
