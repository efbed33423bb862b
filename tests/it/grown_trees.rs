//! Trees that grow year by year, through scenes: species, ages, places, neighbours, cuts, wind, and what they complain of.
#![allow(clippy::expect_used, clippy::disallowed_methods, reason = "tests fail loudly and write scenes themselves")]

use std::path::Path;
use std::process::Command;

use glam::Vec3;
use osier::bake::BakeContext;
use osier::bake::motion::{FrameTime, PointOnAxis};
use osier::bake::scene::{self, AssembledScene, SceneOptions};
use osier::limits::Limits;
use osier::presets::PRESETS;
use osier::progress::{Cancel, Silent};
use osier::recipe::Growth;
use osier::scene::plant::Plant;
use osier::scene::{Asset, AssetFrame, Frame, InstancerFrame, MeshFrame, asset_bounds};
use osier::solid::{Form, Prism, Solid};
use serde_json::Value;

use crate::common::clients;
use crate::common::program::{arg, ends};
use crate::common::scene_text::{assembled, complaint, evaluated, recipe};
use crate::common::track_records::records;

/// The plants of a scene, in the order of their places.
fn trees(text: &str) -> Vec<Asset> {
    assembled(text).animated.scene.assets.iter().filter(|a| a.group == "a").cloned().collect()
}

/// Points of a tree's bark, in its own space.
fn wood(tree: &Asset) -> impl Iterator<Item = Vec3> {
    tree.meshes.iter().flat_map(|m| m.mesh.points.iter().copied())
}

fn height(tree: &Asset) -> f32 {
    wood(tree).fold(0.0, |h, p| p.y.max(h))
}

fn middle(tree: &Asset) -> Vec3 {
    wood(tree).sum::<Vec3>() / wood(tree).count() as f32
}

fn leaves(tree: &Asset) -> usize {
    tree.instancers.iter().map(|i| i.rest.positions.len()).sum()
}

#[test]
fn every_species_resolves_and_grows_taller_with_its_age() {
    for preset in PRESETS.iter().filter(|p| p.name.ends_with(".species")) {
        let name = preset.name.trim_end_matches(".species");
        let at = |age: f64| trees(&format!("[plants.a]\nspecies = \"{preset}\"\nage = {age}\n", preset = preset.name));
        let (young, older) = (at(3.0), at(6.5));
        assert!(height(&older[0]) > height(&young[0]), "{name}");
        assert!(leaves(&older[0]) > 0, "{name} bears leaves");
    }
}

#[test]
fn the_tables_of_a_scene_are_laid_over_those_of_a_species() {
    let text = "[plants.a]\nspecies = \"pine.species\"\n[plants.a.habit]\nclear_stem = 3.5\nshoot_rate = [0.4, 0.2]\n\
                [plants.a.stand]\nradius = 5\n";
    let recipe = recipe(text);
    let Growth::Species(species) = &recipe.plants[0].growth else { panic!("a species") };
    let habit = &species.habit.habit;
    assert!((habit.clear_stem - 3.5).abs() < 1e-6 && (habit.shoot_rate[5] - 0.2).abs() < 1e-6);
    assert!((habit.height_max - 21.5).abs() < 1e-6, "that of the table");
    let stand = species.stand.as_ref().expect("neighbours");
    assert!((stand.radius - 5.0).abs() < 1e-9 && (stand.until - 50.0).abs() < 1e-9);
    assert!((species.age - 110.0).abs() < 1e-9);
}

#[test]
fn trees_that_grow_together_share_the_light() {
    let pair = |seed: u32, together: bool| {
        let place = |x: f32| format!("[[place]]\nplant = \"a\"\nat = [{x}, 0, 0]\ntogether = {together}\n");
        let plant = format!("seed = {seed}\n[plants.a]\nspecies = \"oak.species\"\nage = 22\n");
        trees(&format!("{plant}{}{}", place(-1.2), place(1.2)))
    };
    // How far both crowns move apart, over some individuals: each differs in more than the light.
    let apart = |seed: u32| {
        let (together, alone) = (pair(seed, true), pair(seed, false));
        let shift = |i: usize| middle(&together[i]).x - middle(&alone[i]).x;
        shift(1) - shift(0)
    };
    let mean = (1..=6).map(apart).sum::<f32>() / 6.0;
    assert!(mean > 0.1, "{mean}");
}

#[test]
fn neighbours_draw_a_tree_up() {
    let at = |stand: &str| trees(&format!("[plants.a]\nspecies = \"oak.species\"\nage = 22\n{stand}"));
    let (open, shaded) = (at(""), at("[plants.a.stand]\nradius = 1.5\ndensity = 0.6\n"));
    let width = |tree: &Asset| wood(tree).fold(0.0_f32, |w, p| w.max(p.x.abs()));
    assert!(width(&shaded[0]) < width(&open[0]), "{} {}", width(&shaded[0]), width(&open[0]));
}

#[test]
fn a_hedge_keeps_to_its_box() {
    let text = "[plants.a]\nspecies = \"beech.species\"\nage = 16\n[plants.a.habit]\nclear_stem = 0.1\nepicormic = 1\n\
                [[plants.a.prune]]\nyear = 6\nevery = 1\nkeep = [[-1, -1, -1], [1, 1.5, 1]]\n";
    let hedge = &trees(text)[0];
    // A shoot of 0.7 m, whose length varies by a fifth: at most three of its deviations more.
    assert!(height(hedge) < 1.5 + 0.7 * 1.6, "one year's growth beyond the box: {}", height(hedge));
    assert!(leaves(hedge) > 50, "{}", leaves(hedge));
}

#[test]
fn a_wall_stops_shoots() {
    let at = |solids: bool| {
        let text = format!(
            "[plants.a]\nspecies = \"oak.species\"\nage = 24\n[plants.a.site]\nsolids = {solids}\n[[solid]]\nname = \"wall\"\n\
             at = [1.4, 0, 0]\nsize = [0.4, 14, 14]\n"
        );
        trees(&text)
    };
    let (free, walled) = (at(false), at(true));
    let beyond = |tree: &Asset| wood(tree).filter(|p| p.x > 1.3).count() as f32 / wood(tree).count() as f32;
    assert!(beyond(&free[0]) > 0.05, "{}", beyond(&free[0]));
    assert!(beyond(&walled[0]) < 0.01, "{}", beyond(&walled[0]));
}

#[test]
fn a_grown_tree_sways() {
    let text = "[plants.a]\nspecies = \"birch.species\"\nage = 12\n[frames]\nend = 24\n[wind]\nspeed = 6\n";
    let scene = assembled(text);
    let moving = scene.animated.motions.iter().filter(|m| m.is_some()).count();
    assert_eq!(moving, 1, "one tree moves");
    let frame = |n| {
        osier::bake::motion::evaluate_frame(&scene.animated.scene, &scene.animated.motions, n, false).expect("a frame")
    };
    let (first, later) = (frame(2), frame(12));
    assert!(format!("{:?}", first.assets) != format!("{:?}", later.assets), "its pose changes");
}

/// The flare belongs to the skin: what bends in the wind is the wood of the model.
#[test]
fn a_root_flare_widens_the_stem_and_does_not_stiffen_it() {
    let wind = "[frames]\nend = 12\n[wind]\nspeed = 6\n";
    let scene = |skin: &str, habit: &str| {
        assembled(&format!("[plants.a]\nspecies = \"oak.species\"\nage = 25\n{skin}{habit}{wind}"))
    };
    let (own, none) = (scene("", ""), scene("[plants.a.skin]\nflare = 0\n", ""));
    // Greatest distance of the stem's foot from its axis, m.
    let foot = |scene: &AssembledScene| {
        let trees = scene.animated.scene.assets.iter().filter(|a| a.group == "a");
        trees.flat_map(wood).filter(|p| p.y < 0.05).map(|p| p.x.hypot(p.z)).fold(0.0_f32, f32::max)
    };
    let without = foot(&none);
    assert!((1.5..4.0).contains(&(foot(&own) / without)), "{} {without}", foot(&own));
    // The habit is the home of the key; the skin goes before it.
    let habit = scene("", "[plants.a.habit]\nflare = 0\n");
    assert!((foot(&habit) - without).abs() < 1e-6);
    // Joints of the wood in a gust, and the leaves on them.
    let pose = |scene: &AssembledScene| {
        let frame = &evaluated(scene, &[8])[0];
        let all: Vec<_> = frame.assets.iter().map(|a| (&a.pose, &a.instancers)).collect();
        format!("{all:?}")
    };
    let swaying = pose(&own);
    assert!(swaying.len() > 1000 && swaying == pose(&none), "it sways as it does without");
}

#[test]
fn the_same_scene_grows_the_same_trees() {
    let text = "[plants.a]\nspecies = \"hazel.species\"\nage = 9\n[[place]]\nplant = \"a\"\ncount = 3\nradius = 2\ntogether = true\n";
    let points = |tree: &Asset| -> Vec<[u32; 3]> { wood(tree).map(|p| p.to_array().map(f32::to_bits)).collect() };
    let (one, two) = (trees(text), trees(text));
    assert_eq!(one.len(), 3);
    for (a, b) in one.iter().zip(&two) {
        assert!(points(a) == points(b));
    }
    assert!(points(&one[0]) != points(&one[1]), "no two alike");
}

#[test]
fn faults_name_the_key_and_the_remedy() {
    let species = "[plants.a]\nspecies = \"oak.species\"\nage = 5\n";
    for (text, wanted) in [
        ("[plants.a]\nspecies = \"ok.species\"\n".to_owned(), "\"ok.species\" is not found"),
        (format!("{species}[plants.a.habit]\nshed = 11\n"), "plants.a.habit.shed is 11"),
        (format!("{species}[plants.a.habit]\nmaturity = [9, 3]\n"), "maturity must be two increasing years"),
        (format!("{species}[plants.a.habit]\nshads = 1\n"), "has no key \"shads\""),
        (format!("{species}[plants.a.habit]\nstems = 2.4\n"), "stems is 2.4, but must be a whole number"),
        // The thickest trunks have 32 sides, and a ridge takes four.
        (format!("{species}[plants.a.habit]\nbuttresses = 9\n"), "habit.buttresses is 9, but must be 0 to 8"),
        (format!("{species}[plants.a.skin]\nbuttresses = 9\n"), "skin.buttresses is 9, but must be 0 to 8"),
        (format!("{species}[plants.a.site]\nside = [0.8, 0.8, 0]\n"), "side is too long"),
        (format!("{species}[[plants.a.prune]]\nyear = 3\n"), "names nothing to keep"),
        (format!("{species}[[plants.a.prune]]\nsolid = \"wall\"\n"), "names the solid \"wall\""),
        (
            format!(
                "{species}[plants.a.site]\nsolids = true\n[[solid]]\nname = \"w\"\nat = [3, 0, 0]\n[[place]]\nplant = \"a\"\n\
                 count = 5\nindividuals = 1\n"
            ),
            "grows round solids but stands in 5 places as 1 individual\n",
        ),
    ] {
        let found = complaint(&text);
        assert!(found.contains(wanted), "{text}\n{found}");
    }
}

/// A tree that grows for its place stands as it has grown, and what is no tree of light shares none.
#[test]
fn keys_without_effect_on_a_tree_in_its_place_are_told() {
    let species = "[plants.a]\nspecies = \"oak.species\"\nage = 3\n";
    let place = "[[place]]\nplant = \"a\"\nturn_deg = 50\nscale = 2\n";
    for (text, why) in [
        (format!("{species}{place}together = true\n"), "grows together"),
        (format!("{species}[plants.a.site]\nsolids = true\n{place}"), "grows round solids"),
        (format!("{species}[[plants.a.prune]]\nyear = 2\nkeep = [[-1, 0, -1], [1, 1, 1]]\n{place}"), "is cut"),
    ] {
        let found = complaint(&text);
        assert!(found.contains("place.0.turn_deg has no effect") && found.contains(why), "{text}\n{found}");
        assert!(found.contains("place.0.scale has no effect"), "{text}\n{found}");
    }
    assert_eq!(complaint(&format!("{species}{place}")), "");
    let bush = "[plants.a]\nshapes = \"bush.shapes\"\n[[place]]\nplant = \"a\"\ntogether = true\n";
    assert!(complaint(bush).contains("place.0.together has no effect"), "{}", complaint(bush));
}

/// Faults of a file point to its line, not to the scene.
#[test]
fn faults_of_a_species_file_are_shown_there() {
    let dir = tempfile::tempdir().expect("dir");
    let scene = dir.path().join("s.toml");
    std::fs::write(&scene, "[plants.a]\nspecies = \"mine\"\n").expect("written");
    let told = |species: &str| {
        std::fs::write(dir.path().join("mine.species"), species).expect("written");
        ends(1, &["check", arg(&scene)]).1
    };
    let maturity = told("age = 3\nmaturity = [5, 5]\n");
    assert!(
        maturity.contains("plants.a.habit: maturity must be") && maturity.contains("mine.species:2:1"),
        "{maturity}"
    );
    assert_eq!(maturity.matches("S003").count(), 1, "{maturity}");
    let stand = told("age = 3\nstand = 5\n");
    assert!(stand.contains("plants.a.stand is a whole number, but must be a table"), "{stand}");
    assert!(stand.contains("mine.species:2:9"), "{stand}");
}

/// A young oak that grows over eight frames.
const CLIP: &str = "[frames]\nend = 8\n[plants.a]\nspecies = \"oak\"\nage = 12\n[plants.a.site]\nfrom = 4\n";

#[test]
fn a_clip_of_years_ends_as_the_tree_of_its_age() {
    let moving = assembled(CLIP);
    let (asset, still) =
        (&moving.animated.scene.assets[0], &trees(&CLIP.replace("[plants.a.site]\nfrom = 4\n", ""))[0]);
    let frames = evaluated(&moving, &[1, 8]);
    let bounds = |frame: usize| asset_bounds(asset, &frames[frame].assets[0]);
    let whole = asset_bounds(still, &AssetFrame::default());
    assert!(bounds(1).min.distance(whole.min) < 0.02 && bounds(1).max.distance(whole.max) < 0.02, "{:?}", bounds(1));
    assert!(bounds(0).max.y < 0.8 * whole.max.y);
    // The leaves that the clip shows at its end are those of the tree.
    let alive = |state: &InstancerFrame| match state {
        InstancerFrame::State(state) => state.alive.iter().filter(|a| **a).count(),
        _ => panic!("a state"),
    };
    let shown = &frames[1].assets[0].instancers;
    assert!(shown.len() == 8 && shown.iter().map(alive).sum::<usize>() == leaves(still));
}

/// Catkins of a canopy hang where the twigs are at that moment.
#[test]
fn points_on_a_tree_grow_with_it() {
    for (text, growth) in
        [(CLIP.to_owned(), 0.5), (CLIP.replace("[plants.a.site]\nfrom = 4\n", "growth_clip = [0, 1]\n"), 1.0)]
    {
        let scene = assembled(&text);
        let motion = scene.animated.motions[0].clone().expect("it grows");
        // The end of the trunk: arc lengths beyond it are clamped.
        let end = PointOnAxis { position: Vec3::ZERO, axis: 0, arc_length: 1e3 };
        let carried = motion.bind_points(&Plant::default(), &[end]).expect("it carries points");
        let height = |number: u32| {
            carried.positions(FrameTime::of_frame(&scene.animated.scene, number)).expect("positions")[0].y
        };
        let frames = evaluated(&scene, &[1, 8]);
        let top = |frame: &Frame| {
            let MeshFrame::Points { points, .. } = &frame.assets[0].meshes[0] else { panic!("points") };
            points.iter().fold(0.0_f32, |h, p| h.max(p.y))
        };
        assert!(height(8) > height(1) + growth, "{} {}", height(1), height(8));
        assert!(height(1) < top(&frames[0]) + 0.05 && height(8) < top(&frames[1]) + 0.05, "{text}");
    }
}

/// No catkin is left in the air where a branch has fallen during the clip.
#[test]
fn catkins_hang_on_twigs_that_stand_at_the_end() {
    let dir = tempfile::tempdir().expect("dir");
    let (scene, out) = (dir.path().join("s.toml"), dir.path().join("out"));
    let text = "seed = 2\n[frames]\nend = 3\n[ground]\nshow = false\n[wind]\nspeed = 0.3\n[plants.a]\nspecies = \"birch\"\nage = 9\n\
         [plants.a.site]\nfrom = 2\nclip_leaves = \"summer\"\n[plants.a.skin]\nsides = 3\n[[place]]\nplant = \"a\"\n\
         [catkin]\nhairs = 4\n[flight]\nrelease = \"canopy\"\ncount = 400\nrelease_speed = 50\n\
         [output]\nformats = [\"obj\", \"points\"]\n[output.points]\nup = \"y\"\n";
    std::fs::write(&scene, text).expect("written");
    ends(0, &["-q", "bake", arg(&scene), "-o", arg(&out)]);
    let read = |path: &str| std::fs::read_to_string(out.join(path)).expect("a file");
    let place = |numbers: &[&str]| {
        let numbers: Vec<f32> = numbers.iter().map(|n| n.parse().expect("a number")).collect();
        Vec3::from_slice(&numbers)
    };
    // The mesh of an OBJ is the tree at the end of the clip, with its leaves.
    let mesh = read("obj/a.obj");
    let tree: Vec<Vec3> = mesh
        .lines()
        .filter_map(|line| line.strip_prefix("v "))
        .map(|v| place(&v.split_whitespace().take(3).collect::<Vec<_>>()))
        .collect();
    let table = read("points/catkins_0003.csv");
    assert!(table.starts_with("id,state,proto,x,y,z,"), "{table}");
    let off = |row: &str| {
        let at = place(&row.split(',').skip(3).take(3).collect::<Vec<_>>());
        tree.iter().map(|p| p.distance(at)).fold(f32::INFINITY, f32::min)
    };
    let distances: Vec<f32> = table.lines().skip(1).map(off).collect();
    assert_eq!(distances.len(), 400);
    // Catkins lie within 0.2 m of their twig's end.
    let most = distances.iter().copied().fold(0.0, f32::max);
    assert!(most < 0.35, "a catkin hangs {most} m from the tree");
}

/// Neither the branches that fell before nor the leaves of other years.
#[test]
fn a_mesh_at_rest_of_a_clip_of_years_is_the_tree_at_its_end() {
    let dir = tempfile::tempdir().expect("dir");
    let vertices = |name: &str, text: &str| {
        let scene = dir.path().join(format!("{name}.toml"));
        std::fs::write(&scene, format!("{text}[[place]]\nplant = \"a\"\n")).expect("written");
        let out = dir.path().join(name);
        ends(0, &["-q", "bake", arg(&scene), "-o", arg(&out), "--formats", "obj"]);
        let mesh = std::fs::read_to_string(out.join("obj/a.obj")).expect("a mesh");
        mesh.lines().filter(|line| line.starts_with("v ")).count()
    };
    let clip = CLIP.replace("age = 12", "age = 7");
    let still = clip.replace("[plants.a.site]\nfrom = 4\n", "");
    assert_eq!(vertices("grown", &clip), vertices("still", &still));
}

/// A birch of 4 years beside an oak of 12: when the oak is 6, it has not been sown.
#[test]
fn trees_that_grow_together_have_one_clock_in_both_directions() {
    let text = |shares: &str| {
        let plant = |name: &str, species: &str, age: u32| {
            format!("[plants.{name}]\nspecies = \"{species}\"\nage = {age}\ngrowth_clip = {shares}\n")
        };
        let place = |name: &str, x: f32| format!("[[place]]\nplant = \"{name}\"\nat = [{x}, 0, 0]\ntogether = true\n");
        let plants = plant("a", "oak", 12) + &plant("b", "birch", 4);
        format!("[frames]\nend = 7\n{plants}{}{}", place("a", 0.0), place("b", 3.0))
    };
    // Height of the bark of the birch, m.
    let heights = |shares: &str| -> Vec<f32> {
        let scene = assembled(&text(shares));
        let birch = scene.animated.scene.assets.iter().position(|a| a.group == "b").expect("the birch");
        let top = |frame: &Frame| {
            let MeshFrame::Points { points, .. } = &frame.assets[birch].meshes[0] else { panic!("points") };
            points.iter().fold(0.0_f32, |h, p| h.max(p.y))
        };
        evaluated(&scene, &[1, 2, 3, 4, 5, 6, 7]).iter().map(top).collect()
    };
    let (forward, backward) = (heights("[0.5, 1]"), heights("[1, 0.5]"));
    // Frames are a year apart: the oak is 6 to 12, the birch -2 to 4 years old.
    assert!(forward[1] < 0.02 && forward[3] > 0.05 && forward[6] > 0.5, "{forward:?}");
    // While the oak grows to 6 there is no birch.
    assert!(heights("[0, 0.5]").iter().all(|h| *h < 0.02));
    let mut pairs = forward.iter().zip(backward.iter().rev());
    assert!(pairs.all(|(a, b)| (a - b).abs() < 1e-3), "{forward:?} {backward:?}");
}

#[test]
fn a_clip_of_years_opens_in_blender_as_one_object() {
    let Some(python) = clients::python() else { return };
    let dir = tempfile::tempdir().expect("dir");
    let scene = dir.path().join("s.toml");
    let text = CLIP.replace("end = 8", "end = 120").replace("from = 4", "to = 12\nclip_leaves = \"summer\"");
    std::fs::write(&scene, format!("{text}[[place]]\nplant = \"a\"\n")).expect("written");
    let out = dir.path().join("out");
    let profiles = "output.gltf.profiles=[\"blender\", \"web\"]";
    ends(0, &["-q", "bake", arg(&scene), "-o", arg(&out), "--formats", "usd,glb", "--set", profiles]);
    let stage = out.join("s.usda");
    let numbers: Vec<String> = (20..=120).map(|n: u32| n.to_string()).collect();
    let arguments: Vec<&str> = [arg(&stage)].into_iter().chain(numbers.iter().map(String::as_str)).collect();
    let output = clients::python_script(&python, "growth_clip.py", &arguments);
    let text = String::from_utf8_lossy(&output.stdout);
    let frames: Vec<Value> = serde_json::from_str(text.trim_end().lines().last().expect("a line")).expect("JSON");
    let number = |f: &Value, key: &str| f[key].as_f64().expect("a number");
    for pair in frames.windows(2) {
        // One object with one topology; ten frames are a year, in which a shoot grows by 0.9 m at most.
        assert!(pair[1]["barks"] == 1 && pair[0]["topology"] == pair[1]["topology"]);
        assert!(number(&pair[1], "moved") < 0.1 + 0.09, "{}", pair[1]);
    }
    assert!(number(&frames[100], "leaves") > 5.0 * number(&frames[0], "leaves"));

    // The same as glTF: one object of wood and one of leaves, at each frame in the places that USD shows.
    let glb = out.join("gltf/s.blender.glb");
    let wanted = ["24", "25", "60", "91", "119", "120"];
    let arguments: Vec<&str> = [arg(&glb), arg(&stage), "1", "24"].into_iter().chain(wanted).collect();
    let output = clients::python_script(&python, "growth_clip_gltf.py", &arguments);
    let text = String::from_utf8_lossy(&output.stdout);
    let frames: Vec<Value> = serde_json::from_str(text.trim_end().lines().last().expect("a line")).expect("JSON");
    let mut count = 0.0;
    for frame in &frames {
        let meshes = frame["meshes"].as_array().expect("names");
        let plant = meshes.iter().filter_map(Value::as_str).filter(|n| n.contains("bark") || n.contains("leaves"));
        assert_eq!(plant.count(), 2, "{frame}");
        // The tolerances of USD and of shapes that are left out, m. Points of threads are not compared: triangles of less than 5 mm^2, which
        // on a shoot of 0.1 m are narrower than 0.1 mm. Wood that falls shrinks to them within a frame in USD, and over the frames between
        // two shapes in glTF; it has few points.
        for key in ["missing", "beyond"] {
            let [most, farthest] = [0, 1].map(|k| frame[key][k].as_f64().expect("a number"));
            assert!(most < 0.05 && farthest < 0.3, "{frame}");
        }
        assert!((number(frame, "leaves") - number(frame, "blades")).abs() <= 0.01 * number(frame, "leaves"), "{frame}");
        count += number(frame, "blades");
    }
    assert!(count > 5000.0, "{count}");

    // Without errors or warnings.
    let Some((node, folder)) = clients::validator() else { return };
    for profile in ["web", "blender"] {
        let mut validate = Command::new(&node);
        let file = out.join(format!("gltf/s.{profile}.glb"));
        validate.arg(clients::script("gltf_validate.mjs")).arg(&folder).arg(file);
        let report: Value = serde_json::from_slice(&clients::run(&mut validate).stdout).expect("JSON");
        assert_eq!((&report["errors"], &report["warnings"]), (&0.into(), &0.into()), "{report}");
    }
}

#[test]
fn contradictory_clips_of_years_are_refused() {
    let with = |keys: &str| complaint(&format!("[frames]\nend = 8\n[plants.a]\nspecies = \"oak\"\nage = 12\n{keys}"));
    assert!(with("growth_clip = [0, 1]\n[plants.a.site]\nto = 9\n").contains("S003"));
    assert!(with("[plants.a.site]\nto = 20\n").contains("raise its age: age = 20"));
    assert!(with("twigs = \"twigs.shapes\"\n[plants.a.site]\nto = 12\n").contains("twigs has no effect"));
    assert!(with("season = 0.5\n[plants.a.site]\nto = 12\n").contains("season has no effect"));
    assert!(with("[plants.a.site]\nto = 12\n[rain]\nrate_mm_per_h = 5\n").contains("to has no effect"));
    assert!(with("[plants.a.site]\nto = 12\n[plants.a.rods]\n").contains("rods has no effect"));
    // A scene without [frames] is one still picture.
    for keys in ["growth_clip = [0, 0.5]\n", "[plants.a.site]\nto = 6\n"] {
        let found = complaint(&format!("[plants.a]\nspecies = \"oak\"\nage = 12\n{keys}"));
        assert!(found.contains("has no effect") && found.contains("set frames.end"), "{keys}: {found}");
    }
}

#[test]
fn trees_on_a_slope_live_beside_the_solids_of_a_scene() {
    let at = |together: bool| {
        assembled(&format!(
            "seed = 3\n[terrain]\nsize = 60\nsubdivisions = 5\namplitude = 14\nsmooth = 3\nfloor = -20\ncover = 0\n\
             [plants.a]\nspecies = \"birch\"\nage = 4\n[plants.a.site]\nsolids = true\n\
             [[place]]\nplant = \"a\"\ncount = 24\nradius = 22\ntogether = {together}\n"
        ))
    };
    for together in [true, false] {
        let report = at(together).report;
        assert!(report.diagnostics.iter().all(|d| d.code != "S036"), "together = {together}: {report}");
    }
}

#[test]
fn a_growing_tree_stands_as_deep_in_a_slope_as_a_grown_one() {
    let foot = |clip: &str| {
        let scene = assembled(&format!(
            "seed = 3\n[terrain]\nsize = 60\nsubdivisions = 5\namplitude = 14\nsmooth = 3\nfloor = -20\ncover = 0\n\
             [plants.a]\nspecies = \"birch\"\nage = 16\n{clip}[[place]]\nplant = \"a\"\nat = [4, 0, 3]\n"
        ));
        let scene = &scene.animated.scene;
        let tree = scene.placements.iter().find(|p| scene.assets[p.asset].group == "a").expect("a tree");
        tree.transform.t.y
    };
    // Branches that fall during the clip have no parent, but are no feet.
    let (grown, growing) = (foot(""), foot("[plants.a.site]\nto = 16\n[frames]\nend = 4\n"));
    assert!((grown - growing).abs() < 0.1, "{grown} {growing}");
}

/// An estimate grows a sample of plants of more than 64 individuals, whose copies share them; trees that grow together it grows all.
#[test]
fn hedges_of_many_plants_can_be_estimated() {
    for (keys, grown) in [("", 64), ("together = true\n", 70)] {
        let text = format!(
            "[plants.a]\nspecies = \"hazel\"\nage = 2\n[plants.a.habit]\nstems = 1\n[[plants.a.prune]]\nyear = 2\n\
             keep = [[-1, 0, -1], [1, 0.5, 1]]\n[[place]]\nalong = [[0, 0, 0], [69, 0, 0]]\nspacing = 1\n{keys}"
        );
        let work =
            BakeContext { limits: &Limits::default(), cancel: &Cancel::default(), progress: &Silent, cache: None };
        let told = scene::assemble_for_estimate(&recipe(&text), SceneOptions::default(), &work).expect("an estimate");
        let scene = &told.animated.scene;
        assert_eq!(scene.assets.iter().filter(|a| a.group == "a").count(), grown, "{keys}");
        let placed = scene.placements.iter().filter(|p| scene.assets[p.asset].group == "a");
        assert_eq!(placed.count(), 70, "{keys}");
    }
}

#[test]
fn a_tree_that_dies_of_a_cut_says_so() {
    let said = |keys: &str| {
        let scene =
            assembled(&format!("[plants.a]\nspecies = \"beech\"\nage = 8\n[plants.a.habit]\nclear_stem = 0\n{keys}"));
        let dead = scene.report.diagnostics.into_iter().find(|d| d.code == "S036");
        dead.map(|d| d.message).unwrap_or_default()
    };
    // The box begins above the foot, so that nothing of the tree is left.
    let cut = said("[[plants.a.prune]]\nyear = 4\nevery = 1\nkeep = [[-1, 0.5, -1], [1, 1.8, 1]]\n");
    assert!(cut.contains("the cut of year 4"), "{cut}");
    // A cut in the year of its death does not hide that a roof took the light.
    let dark = said(
        "[plants.a.site]\nsolids = true\n[[plants.a.prune]]\nyear = 8\nkeep = [[-1, 0, -1], [1, 9, 1]]\n\
         [[solid]]\nname = \"roof\"\nat = [0, 0.6, 0]\nsize = [20, 0.2, 20]\n",
    );
    assert!(dark.contains("no light since"), "{dark}");
    assert_eq!(said("[[plants.a.prune]]\nyear = 4\nevery = 1\nkeep = [[-1, 0, -1], [1, 1.8, 1]]\n"), "");
}

#[test]
fn a_stem_that_is_too_high_is_shown_where_it_is_written() {
    let dir = tempfile::tempdir().expect("dir");
    let file = dir.path().join("my.species");
    std::fs::write(&file, "# mine\nage = 3\npath_max = 9\nclear_stem = 12\n").expect("written");
    let (_, said) = ends(0, &["check", arg(&file)]);
    assert!(said.contains("my.species:4:") && said.contains("clear_stem = 12"), "{said}");
    assert!(said.contains("raise path_max") && !said.contains("hedge"), "{said}");
}

#[test]
fn a_tree_close_to_a_wall_lives_on_any_side_of_it() {
    for (x, z) in [(0.35_f32, 0.0_f32), (-0.35, 0.0), (0.0, 0.35), (0.0, -0.35)] {
        let size = if z.abs() > 0.0 { "[6, 2, 0.3]" } else { "[0.3, 2, 6]" };
        let scene = assembled(&format!(
            "seed = 2\n[plants.a]\nspecies = \"birch\"\nage = 6\n[plants.a.site]\nsolids = true\n\
             [[solid]]\nname = \"w\"\nshape = \"block\"\nat = [{x}, 0, {z}]\nsize = {size}\n"
        ));
        let tree = scene.animated.scene.assets.iter().find(|a| a.group == "a").expect("a tree");
        assert!(height(tree) > 0.5, "a wall at {x} {z}: {} m", height(tree));
    }
}

#[test]
fn neighbours_are_felled_in_a_year_of_their_own_tree() {
    let points = |stand: &str, old: &str| {
        let scene = assembled(&format!(
            "[plants.a]\nspecies = \"birch\"\nage = 8\n{stand}[plants.old]\nspecies = \"birch\"\nage = 14\n\
             [[place]]\nplant = \"a\"\ntogether = true\n{old}"
        ));
        let tree = scene.animated.scene.assets.iter().find(|a| a.group == "a").expect("a tree").clone();
        wood(&tree).count()
    };
    // A ring that stands for all of its eight years keeps the tree thin, also where an older tree began six years before it.
    let ring = "[plants.a.stand]\nradius = 0.5\ndensity = 3\nuntil = 8\n";
    let old = "[[place]]\nplant = \"old\"\nat = [14, 0, 0]\ntogether = true\n";
    let free = points("", "");
    for count in [points(ring, ""), points(ring, old)] {
        assert!(count * 2 < free, "{count} points of bark, {free} without the ring");
    }
}

#[test]
fn a_tree_under_the_eaves_does_not_grow_through_the_roof() {
    // A roof of 1.5 m over walls of 2.6 m and a depth of 4 m: its slabs, 0.16 m thick, project by 0.35 m.
    let house = Prism::house(Vec3::ZERO, Vec3::new(8.0, 2.6, 4.0), 1.5, 0.0);
    let slab = |form: Prism| Solid { name: "slab".into(), form: Form::Prism(form), humidity: 0.0 };
    let slabs: Vec<Solid> = house.roof_slabs(0.35, 0.16).into_iter().map(slab).collect();
    let scene = assembled(
        "seed = 3\n[plants.a]\nspecies = \"oak\"\nage = 16\n[plants.a.site]\nsolids = true\n\
         [[place]]\nplant = \"a\"\nat = [0, 0, 2.4]\n\
         [[solid]]\nname = \"house\"\nshape = \"house\"\nsize = [8, 2.6, 4]\nroof = 1.5\n",
    );
    let scene = &scene.animated.scene;
    let tree = scene.placements.iter().find(|p| scene.assets[p.asset].group == "a").expect("a tree");
    let points: Vec<Vec3> = wood(&scene.assets[tree.asset]).map(|p| tree.transform.apply(p)).collect();
    let in_roof = |p: &&Vec3| slabs.iter().any(|slab| slab.nearest(**p).distance < -0.03);
    let inside = points.iter().filter(in_roof).count();
    // Wood that thickens may sink into the edge of the eaves.
    assert!(points.len() > 5000 && inside * 400 <= points.len(), "{inside} of {} points are in the roof", points.len());
}

#[test]
fn a_clip_of_a_hedge_has_the_leaves_of_every_year() {
    let hedge = |age: u32, more: &str| {
        assembled(&format!(
            "{more}[plants.a]\nspecies = \"beech\"\nage = {age}\n[plants.a.habit]\nstems = 6\nstem_spread = 0.3\ntilt = 35\n\
             shade_point = 0.02\nshed = 0\npatience = 8\nbud_break = [0.9]\nacrotony = 0.2\nshoot_max = [0.2]\nlevels = 5\n\
             leaf_area_tip = 0.014\n[[plants.a.prune]]\nyear = 4\nevery = 2\nkeep = [[-0.4, 0, -0.4], [0.4, 1.4, 0.4]]\n"
        ))
    };
    // Frames are a year apart; cuts are made at the start of the years 4, 6 and 8.
    let clip = hedge(8, "[frames]\nend = 9\n[plants.a.site]\nto = 8\nclip_leaves = \"summer\"\n");
    for (age, frame) in [4, 5, 7, 8].into_iter().zip(evaluated(&clip, &[5, 6, 8, 9])) {
        let shown = |instancer: &InstancerFrame| {
            let InstancerFrame::State(state) = instancer else { panic!("leaves that come and go") };
            state.sizes.iter().filter(|size| **size > 1e-3).count()
        };
        let shown: usize = frame.assets[0].instancers.iter().map(shown).sum();
        let still = hedge(age, "");
        let tree = still.animated.scene.assets.iter().find(|a| a.group == "a").expect("a tree");
        let share = shown as f64 / leaves(tree) as f64;
        assert!((share - 1.0).abs() < 0.005, "{shown} of {} leaves at {age} years", leaves(tree));
    }
}

/// A column of a table of statistics, by frame.
fn column(table: &str, name: &str) -> Vec<f64> {
    let mut lines = table.lines();
    let header: Vec<&str> = lines.next().expect("a header").split(',').collect();
    let k = header.iter().position(|h| *h == name).unwrap_or_else(|| panic!("{name} in {header:?}"));
    lines.map(|line| line.split(',').nth(k).expect("a cell").parse().unwrap_or(f64::NAN)).collect()
}

/// One birch in a shower and gusts, from whose crown seeds come loose.
#[test]
fn rain_wind_and_seeds_act_on_a_grown_tree_in_one_scene() {
    let folder = tempfile::tempdir().expect("a folder");
    let bake = |name: &str, wind: f64| {
        let text = format!(
            "[frames]\nend = 12\n[plants.a]\nspecies = \"birch\"\nage = 6\n[wind]\nmodel = \"gust\"\nspeed = {wind}\n[maps]\n\
             max_mapped_leaves = 0\n[rain]\nrate_mm_per_h = 60\nsize_distribution = \"fixed\"\nsize_mm = 3\nspin_up_s = 0.5\n\
             [catkin]\n[flight]\ncount = 60\nrelease = \"canopy\"\n"
        );
        let (file, out) = (folder.path().join(format!("{name}.toml")), folder.path().join(name));
        std::fs::write(&file, text).expect("a scene");
        ends(0, &["-q", "bake", arg(&file), "-o", arg(&out), "--formats", "tracks,csv"]);
        out
    };
    let (calm, gusty) = (bake("calm", 0.0), bake("gusty", 8.0));
    let table = |name: &str| std::fs::read_to_string(gusty.join("stats").join(name)).expect("statistics");
    let (rain, flight) = (table("rain.csv"), table("flight.csv"));
    let last = |column: Vec<f64>| *column.last().expect("frames");
    // Drops strike leaves and wood, whose momentum is balanced; water stays on leaves.
    assert!(last(column(&rain, "struck")) > 100.0 && last(column(&rain, "water_wood [mm3]")) > 1.0, "{rain}");
    assert!(last(column(&rain, "water_leaves [mm3]")) > 10.0 && last(column(&rain, "momentum_error")) < 1e-9, "{rain}");
    // Seeds leave the crown and are carried off.
    assert!(last(column(&flight, "airborne")) > 10.0 && last(column(&flight, "mean_speed [m/s]")) > 0.5, "{flight}");
    // Leaves are wet, and swing further in gusts than under the drops alone.
    let leaves = |out: &Path| records(out, "leaves.bin", &["leaf", "wetness", "x", "y", "z"]);
    let swing = |leaves: &[(u64, Vec<f64>)]| {
        let of = |frame: u64| leaves.iter().filter(move |l| l.0 == frame);
        let moved = of(2).zip(of(12)).map(|(a, b)| (2..5).map(|k| (a.1[k] - b.1[k]).powi(2)).sum::<f64>().sqrt());
        moved.sum::<f64>() / of(2).count() as f64
    };
    let (still, blown) = (leaves(&calm), leaves(&gusty));
    assert!(blown.iter().any(|l| l.1[1] > 0.05), "no leaf is wet");
    assert!(swing(&blown) > 2.0 * swing(&still) && swing(&blown) > 2e-3, "{} {}", swing(&blown), swing(&still));
}

#[test]
fn a_grown_tree_moves_on_rods() {
    let text =
        "[plants.a]\nspecies = \"birch.species\"\nage = 3\n[plants.a.rods]\n[frames]\nend = 6\n[wind]\nspeed = 6\n";
    let scene = assembled(text);
    let frames = evaluated(&scene, &[1, 6]);
    let places = |frame: &Frame| -> Vec<Vec3> {
        let of_tree = frame.assets.iter().flat_map(|a| &a.instancers);
        let state = |frame: &InstancerFrame| match frame {
            InstancerFrame::State(state) => state.positions.clone(),
            InstancerFrame::Same => Vec::new(),
        };
        of_tree.flat_map(state).collect()
    };
    let (first, later) = (places(&frames[0]), places(&frames[1]));
    assert!(first.len() > 20 && first.len() == later.len(), "{} {}", first.len(), later.len());
    let moved = first.iter().zip(&later).map(|(a, b)| a.distance(*b)).fold(0.0_f32, f32::max);
    assert!(moved > 2e-3 && moved < 1.0, "leaves move by {moved} m");
}
