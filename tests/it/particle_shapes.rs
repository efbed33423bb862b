//! Particle-shapes through scenes and bakes: presets, files and their tables, solids, growth over a clip, wind and rain.
#![allow(clippy::expect_used, clippy::disallowed_methods, reason = "tests run programs and read their files")]

use std::fs;
use std::path::Path;

use glam::Vec3;
use osier::bake::scene::SceneOptions;
use osier::presets::find;
use osier::recipe::{Library, Request, resolve};
use osier::scene::{AssetFrame, InstancerMotion, MeshMotion, asset_bounds};
use osier::solid::{Form, Prism, Solid};
use serde_json::Value;

use crate::common::program::{arg, ends};
use crate::common::scene_text::{assembled, complaint, evaluated, recipe, request};
use crate::common::{clients, grown};

#[test]
fn the_tree_has_the_nodes_and_leaves_of_its_table_at_every_seed() {
    let preset = find("tree.shapes").expect("preset");
    for seed in 0..100 {
        let plants = grown::individuals(&grown::recipe(preset, Some(seed), false));
        let (nodes, leaves) = (plants[0].plant.nodes.len(), plants[0].plant.organs.len());
        assert!((10_000..=25_000).contains(&nodes), "seed {seed}: {nodes} nodes");
        assert!((9_000..=20_000).contains(&leaves), "seed {seed}: {leaves} leaves");
    }
}

#[test]
fn a_table_of_the_scene_lies_over_the_file_and_faults_name_their_own() {
    let dir = tempfile::tempdir().expect("dir");
    let write = |name: &str, text: &str| fs::write(dir.path().join(name), text).expect("file");
    write("stick.shapes", "# A stick.\nlevels = 1\nlength = 2\nlength_var = 0\nwander = 0\nleaf_spacing = 0\n");
    write("bad.shapes", "levels = 1\nlenght = 2\n");
    let run = |scene: &str, code: i32| {
        write("s.toml", scene);
        ends(code, &["check", arg(&dir.path().join("s.toml"))])
    };
    run("[plants.a]\nshapes = \"stick.shapes\"\n[plants.a.growth]\nlength = 3\n", 0);
    let height = |growth: &str| {
        let path = dir.path().join("s.toml");
        let text = format!("[plants.a]\nshapes = \"stick.shapes\"\n{growth}[ground]\nshow = false\n");
        let library = Library::new(&path, &[]).expect("library");
        let recipe = resolve(&Request { library, ..request(&text) }).expect("scene").0;
        let scene = grown::stage(&recipe, SceneOptions::default()).animated.scene;
        asset_bounds(&scene.assets[0], &AssetFrame::default()).max.y
    };
    assert!((height("") - 2.0).abs() < 0.05 && (height("[plants.a.growth]\nlength = 3\n") - 3.0).abs() < 0.05);
    // A fault in the file is shown in the file, with the key that was meant.
    let (_, err) = run("[plants.a]\nshapes = \"bad.shapes\"\n", 1);
    assert!(err.contains("bad.shapes") && err.contains("did you mean \"length\"?"), "{err}");
    let (_, err) = run("[plants.a]\nshapes = \"stick.shapes\"\n[plants.a.growth]\nspeed = [1, 0]\n", 1);
    assert!(err.contains("S004") && err.contains("plants.a.growth.speed"), "{err}");
    // A file alone is a source, too.
    let picture = dir.path().join("p.png");
    ends(0, &["-q", "preview", arg(&dir.path().join("stick.shapes")), "-o", arg(&picture), "--size", "64x64"]);
    assert!(picture.is_file());
}

#[test]
fn faults_that_single_keys_cannot_show_are_told() {
    let plant = "[plants.a]\nshapes = \"bush.shapes\"\n[plants.a.growth]\n";
    let with = |keys: &str| complaint(&format!("{plant}{keys}"));
    assert!(
        with("obstacles = [{ shape = \"solid\", name = \"wal\" }]\n[[solid]]\nname = \"wall\"\n")
            .contains("did you mean \"wall\"?")
    );
    assert!(with("attract = 1\n").contains("needs an `envelope`"));
    let plane = "attract = 1\nenvelope = [{ shape = \"sphere\", radius = 2 }, { shape = \"plane\" }]\n";
    assert!(with(plane).contains("without planes"));
    let sphere = with("envelope = [{ shape = \"sphere\", at = [0, 1, 0], size = [4, 4, 4] }]\n");
    assert!(sphere.contains("S007") && sphere.contains("envelope.0.size") && sphere.contains("reads at, radius"));
    let flat = with("obstacles = [{ shape = \"sphere\" }, { shape = \"plane\", normal = [0, 0, 0] }]\n");
    assert!(flat.contains("error[S003]") && flat.contains("obstacles.1.normal has no direction"), "{flat}");
    assert!(with("radii = \"cone\"\nratios = [[0.8, 1], [1.2, 1]]\n").contains("would widen upwards"));
    assert!(with("length = [1, 2, 3, 4, 5, 6, 7, 8, 9]\n").contains("1 to 8"));
    assert!(with("exponent = 0.5\n").contains("that of the pipe model is at least 1"));
    assert_eq!(with("radii = \"taper\"\nexponent = 0.5\n"), "");
    // The printed equations have no tropisms; keys of a file that was written for the others are not reported.
    for key in ["gravity", "up", "light", "coil", "climb", "spread"] {
        let said = with(&format!("equations = \"paper\"\n{key} = 1\n"));
        assert!(said.contains("S007") && said.contains(&format!("growth.{key} has no effect")), "{key}: {said}");
    }
    let said = with("equations = \"paper\"\ngravity = 0\n");
    assert!(!said.contains("S007"), "{said}");
    // Keys of what the plant does not have, and the same with it.
    let twig = "[plants.a]\nshapes = \"twigs.shapes\"\n[plants.a.growth]\nlevels = 1\n";
    for (name, lines, mended) in [
        ("root_radius", "root_radius = 0.3\n", "root_radius = 0.3\nroots = 4\n"),
        ("coil_angle_deg", "coil_angle_deg = 40\n", "coil_angle_deg = 40\ncoil = 3\n"),
        ("split_deg", "split_deg = 40\n", "split_deg = 40\nsplit = 0.5\n"),
        (
            "climb",
            "climb = 2\n",
            "climb = 2\nobstacles = [{ shape = \"plane\", at = [3, 0, 0], normal = [-1, 0, 0] }]\n",
        ),
        ("face_up", "leaf_spacing = 0\nface_up = 1\n", "face_up = 1\n"),
        ("exponent", "blade_width = 0.01\nexponent = 2\n", "exponent = 2\n"),
    ] {
        let said = complaint(&format!("{twig}{lines}"));
        assert!(said.contains("S007") && said.contains(&format!("growth.{name} has no effect")), "{lines}: {said}");
        assert_eq!(complaint(&format!("{twig}{mended}")), "", "{mended}");
    }
    // Twigs have neither roots nor blades; a file that describes a whole plant may be one of twigs.
    let filled = "[plants.a]\nshapes = \"twigs.shapes\"\ntwigs = \"bush.shapes\"\n[plants.a.growth]\nlevels = 1\n[plants.a.fill]\nlevels = 2\n";
    assert_eq!(complaint(filled), "");
    for (name, line) in
        [("roots", "roots = 3\n"), ("exponent", "exponent = 2\n"), ("blade_width", "blade_width = 0.01\n")]
    {
        let said = complaint(&format!("{filled}{line}"));
        assert_eq!(said.matches("S007").count(), 1, "{said}");
        assert!(said.contains(&format!("plants.a.fill.{name} has no effect")), "{said}");
    }
    // The helix of the vine's file is switched off by its scene.
    let straight = "[plants.a]\nshapes = \"vine.shapes\"\n[plants.a.growth]\nlevels = 1\nlength = 1\ncoil = 0\n";
    assert_eq!(complaint(straight), "");
    let twice = "solids = true\n[[solid]]\nsize = [1, 2, 1]\nat = [3, 0, 0]\n[[place]]\ncount = 3\nindividuals = 1\n";
    let said = with(twice);
    assert!(
        said.contains("individuals = 3") && said.contains("s.toml:") && said.contains("as 1 individual\n"),
        "{said}"
    );
    let rain = "[rain]\n[frames]\nend = 4\n";
    let growing = format!("[plants.a]\nshapes = \"bush.shapes\"\ngrowth_clip = [0, 1]\n{rain}");
    assert!(complaint(&growing).contains("rain meets grown plants"));
    let segments = format!("[plants.a]\nshapes = \"bush.shapes\"\n[plants.a.skin]\nform = \"segments\"\n{rain}");
    assert!(complaint(&segments).contains("rain needs a closed skin"));
    // The whole first level beyond the limit: nothing grows.
    let refused = with("max_nodes = 3\n");
    assert!(
        refused.contains("nodes of preset:bush.shapes would be") && refused.contains("the limit is 3;"),
        "{refused}"
    );
    let ended = with("max_age = 0\n");
    assert!(ended.contains("bush.shapes: no axis had room") && ended.contains("`max_age`"), "{ended}");
}

#[test]
fn a_vine_climbs_a_house_and_does_not_enter_it() {
    let vine = find("vine.toml").expect("preset");
    let recipe = grown::recipe(vine, None, false);
    let scene = grown::stage(&recipe, SceneOptions::default()).animated.scene;
    let placement = scene.placements.iter().find(|p| scene.assets[p.asset].id.starts_with("vine")).expect("a vine");
    let bark = &scene.assets[placement.asset].meshes[0].mesh;
    let keys = &recipe.solids[0].keys;
    let size = Vec3::from_array(keys.size.map(osier::math::narrow));
    let form = Form::Prism(Prism::house(Vec3::ZERO, size, osier::math::narrow(keys.roof), 0.0));
    let Form::Prism(prism) = &form else { panic!("a prism") };
    // The roof projects by 0.35 m, with slabs of 0.16 m.
    let slab = |form: Prism| Solid { name: "slab".into(), form: Form::Prism(form), humidity: 0.0 };
    let slabs: Vec<Solid> = prism.roof_slabs(0.35, 0.16).into_iter().map(slab).collect();
    let house = Solid { name: "house".into(), form, humidity: 0.0 };
    let (mut highest, mut in_roof) = (0.0_f32, 0_usize);
    for p in &bark.points {
        let p = placement.transform.apply(*p);
        highest = highest.max(p.y);
        // Radii are known only after growth: a base of several centimetres may sink into the plaster by its radius at most.
        assert!(house.nearest(p).distance > -0.03, "{p} is in the house");
        in_roof += usize::from(slabs.iter().any(|slab| slab.nearest(p).distance < -0.03));
    }
    // Wood that thickens in the corner of wall and roof sinks into one of them.
    assert!(in_roof * 200 < bark.points.len(), "{in_roof} of {} points are in the roof", bark.points.len());
    assert!(highest > 3.5, "the vine reaches the roof: {highest}");
}

/// Height and radius of the rings of a closed column of revolution, m.
const COLUMN: [[f32; 2]; 5] = [[0.0, 0.35], [0.8, 0.45], [1.6, 0.28], [2.4, 0.4], [3.2, 0.22]];

/// The column as an OBJ of so many sides.
fn column_obj(sides: usize) -> String {
    let mut text = String::new();
    for [y, r] in COLUMN {
        for k in 0..sides {
            let (sin, cos) = (std::f64::consts::TAU * k as f64 / sides as f64).sin_cos();
            text += &format!("v {} {y} {}\n", f64::from(r) * cos, -f64::from(r) * sin);
        }
    }
    let top = COLUMN[COLUMN.len() - 1][0];
    text += &format!("v 0 0 0\nv 0 {top} 0\n");
    let last = (COLUMN.len() - 1) * sides;
    for k in 0..sides {
        let next = (k + 1) % sides;
        for j in 0..COLUMN.len() - 1 {
            let [a, b] = [k, next].map(|i| j * sides + i + 1);
            text += &format!("f {a} {b} {} {}\n", b + sides, a + sides);
        }
        let ends = last + sides + 1;
        text += &format!("f {ends} {} {}\nf {} {} {}\n", next + 1, k + 1, ends + 1, last + k + 1, last + next + 1);
    }
    text
}

/// Distance of a point from the side of the column, m, negative inside; above it that from the axis counts.
fn from_column(p: Vec3) -> f32 {
    let away = p.x.hypot(p.z);
    let ring = COLUMN.windows(2).find(|w| (w[0][0]..=w[1][0]).contains(&p.y));
    ring.map_or(away, |w| {
        let [[y, r], [next_y, next_r]] = [w[0], w[1]];
        away - r - (next_r - r) * (p.y - y) / (next_y - y)
    })
}

/// Points of the wood of an OBJ that `bake` has written: those whose material is not that of leaves.
fn wood_of_obj(path: &Path) -> Vec<Vec3> {
    let text = fs::read_to_string(path).expect("OBJ");
    let (mut points, mut used, mut leaves) = (Vec::new(), Vec::new(), false);
    for line in text.lines() {
        let mut words = line.split_whitespace();
        match words.next() {
            Some("v") => {
                let numbers: Vec<f32> = words.take(3).map(|w| w.parse().expect("a number")).collect();
                points.push(Vec3::from_slice(&numbers));
                used.push(false);
            }
            Some("usemtl") => leaves = words.next().is_some_and(|name| name.ends_with("leaf")),
            Some("f") if !leaves => {
                for word in words {
                    let index: usize = word.split('/').next().expect("a corner").parse().expect("an index");
                    used[index - 1] = true;
                }
            }
            _ => {}
        }
    }
    points.into_iter().zip(used).filter(|(_, used)| *used).map(|(p, _)| p).collect()
}

/// A pole of 0.16 m and a column that is a mesh: a vine beside each climbs it and stays outside.
#[test]
fn a_vine_climbs_a_pole_and_a_mesh_and_does_not_enter_them() {
    let dir = tempfile::tempdir().expect("dir");
    fs::write(dir.path().join("column.obj"), column_obj(48)).expect("mesh");
    let block = Prism::block(Vec3::ZERO, Vec3::new(0.16, 4.0, 0.16), 0.0);
    let pole = Solid { name: "pole".into(), form: Form::Prism(block), humidity: 0.0 };
    // Name, place of the vine along x, keys of the solid, its height.
    for (name, x, solid, height) in [
        ("pole", 0.2_f32, "size = [0.16, 4, 0.16]", 4.0),
        ("column", 0.55, "shape = \"mesh\"\nmesh = \"column.obj\"", 3.2),
    ] {
        let (scene, out) = (dir.path().join(format!("{name}.toml")), dir.path().join(name));
        let text = format!(
            "[plants.vine]\nshapes = \"vine.shapes\"\n[plants.vine.growth]\nsolids = true\nclimb = [4, 2.5, 1]\navoid = 0\n\
             gravity = [0, 0.05, 0.1]\nup = [0.3, 0.2, 0]\nwander = [0.3, 0.5, 0.5]\nroots = 3\ncoil = 0\nroot_radius = 0.12\n\
             root_tilt_deg = [0, 20]\ntwist = [1, 1, 0]\nlength = [5, 0.6, 0.2]\nradius = 0.015\n[plants.vine.leaf]\nside = 64\n\
             [plants.vine.bark]\nside = 64\n[plants.vine.skin]\nflare = 0\nbury = 0\n[ground]\nshow = false\n\
             [[place]]\nplant = \"vine\"\nat = [{x}, 0, 0]\n[[solid]]\nname = \"{name}\"\n{solid}\n"
        );
        fs::write(&scene, text).expect("scene");
        ends(0, &["-q", "bake", arg(&scene), "-o", arg(&out), "--formats", "obj"]);
        let from = |p: Vec3| if name == "pole" { pole.nearest(p).distance } else { from_column(p) };
        // The OBJ is in the space of the plant.
        let wood: Vec<Vec3> = wood_of_obj(&out.join("obj/vine.obj")).into_iter().map(|p| p + Vec3::X * x).collect();
        let deepest = wood.iter().map(|p| from(*p)).fold(f32::MAX, f32::min);
        assert!(deepest > -0.005, "{name}: wood is {deepest} m inside");
        // It stays near to beyond two thirds of the height, on all sides.
        let near: Vec<&Vec3> = wood.iter().filter(|p| from(**p) < 0.15).collect();
        let highest = near.iter().map(|p| p.y).fold(0.0, f32::max);
        assert!(
            near.len() * 3 > wood.len() && highest > 0.9 * height,
            "{name}: {} of {}, {highest}",
            near.len(),
            wood.len()
        );
        for side in [Vec3::X, -Vec3::X, Vec3::Z, -Vec3::Z] {
            let beyond = near.iter().filter(|p| p.dot(side) > 0.08 && p.y > 0.3 * height).count();
            assert!(beyond > 0, "{name}: nothing at {side}");
        }
    }
}

#[test]
fn a_growth_clip_ends_as_the_grown_plant_and_begins_with_nothing() {
    let text = "[frames]\nend = 12\n[plants.a]\nshapes = \"bush.shapes\"\ngrowth_clip = [0, 1]\n";
    let (moving, still) = (assembled(text), assembled(&text.replace("growth_clip = [0, 1]\n", "")));
    let scene = &moving.animated.scene;
    let plant = &scene.assets[0];
    assert!(plant.meshes[0].motion == MeshMotion::Deforming && plant.instancers[0].motion == InstancerMotion::Free);
    let frames = evaluated(&moving, &[1, 6, 12]);
    let boxes: Vec<f32> = frames.iter().map(|f| asset_bounds(plant, &f.assets[0]).size().length()).collect();
    let whole = asset_bounds(&still.animated.scene.assets[0], &AssetFrame::default());
    assert!(boxes[0] < 0.8 && boxes[1] > boxes[0] && boxes[1] < boxes[2], "{boxes:?}");
    let last = asset_bounds(plant, &frames[2].assets[0]);
    assert!(last.min.distance(whole.min) < 1e-4 && last.max.distance(whole.max) < 1e-4, "{last:?} {whole:?}");
}

#[test]
fn a_growth_clip_opens_in_blender_as_one_object() {
    let Some(python) = clients::python() else { return };
    let dir = tempfile::tempdir().expect("dir");
    let out = dir.path().join("vine");
    ends(0, &["-q", "bake", "vine", "-o", arg(&out), "--formats", "usd"]);
    let stage = out.join("vine.usda");
    let numbers: Vec<String> = (40..=80).map(|n: u32| n.to_string()).collect();
    let arguments: Vec<&str> = [arg(&stage)].into_iter().chain(numbers.iter().map(String::as_str)).collect();
    let output = clients::python_script(&python, "growth_clip.py", &arguments);
    let text = String::from_utf8_lossy(&output.stdout);
    let frames: Vec<Value> = serde_json::from_str(text.trim_end().lines().last().expect("a line")).expect("JSON");
    let number = |f: &Value, key: &str| f[key].as_f64().expect("a number");
    for pair in frames.windows(2) {
        // One object with one topology; nothing shrinks, and nothing jumps farther than a tip grows.
        assert!(pair[1]["barks"] == 1 && pair[0]["topology"] == pair[1]["topology"]);
        assert!(number(&pair[1], "extent") >= number(&pair[0], "extent") - 1e-3);
        assert!(number(&pair[1], "leaves") >= number(&pair[0], "leaves"));
        assert!(number(&pair[1], "moved") < 0.25, "{}", pair[1]);
    }
    assert!(number(&frames[40], "leaves") > 1.3 * number(&frames[0], "leaves"));
}

#[test]
fn segments_are_one_instance_between_each_two_nodes() {
    let text = "[plants.a]\nshapes = \"bush.shapes\"\n[plants.a.skin]\nform = \"segments\"\n";
    let recipe = recipe(text);
    let plants = grown::individuals(&recipe);
    let segments: usize = plants[0].plant.axes.iter().map(|a| a.count as usize - 1).sum();
    let asset = &plants[0].asset;
    assert!(asset.meshes.is_empty());
    let instancer = asset.instancers.last().expect("segments");
    assert!(instancer.name == "segments" && instancer.len() == segments);
    // [hoetzlein] Table 2: scale (2r, segment length, 2r).
    let nodes = &plants[0].plant.nodes;
    let scale = instancer.scales[0];
    assert!(
        (scale.y - nodes.p[0].distance(nodes.p[1])).abs() < 1e-6 && (scale.x - nodes.r[0] - nodes.r[1]).abs() < 1e-6
    );
    // Organs take the place of the prisms.
    let with_organs = format!("{text}segment = \"s\"\n[plants.a.organs.s]\nblade = \"toothed\"\n");
    let asset = &assembled(&with_organs).animated.scene.assets[0].clone();
    let organs = asset.instancers.iter().find(|i| i.name == "segments").expect("segments");
    assert!(organs.len() == segments && organs.prototypes.len() > 1);
}

#[test]
fn twigs_fill_a_tree_of_any_source() {
    let bare = "[plants.a]\ngrammar = \"oak.l\"\nsteps = 5\n";
    let filled =
        format!("{bare}twigs = \"bush.shapes\"\n[plants.a.fill]\nlevels = 2\nlength = [1, 0.2]\nspacing = 0.1\n");
    let [before, after] = [bare, &filled].map(|text| grown::individuals(&recipe(text)).swap_remove(0).plant);
    assert!(after.axes.len() > before.axes.len() && after.organs.len() > before.organs.len());
    assert!(before.axes.iter().all(|a| after.axes.iter().any(|b| b.id == a.id)));
}

#[test]
fn grass_blades_are_strips_that_move_in_the_wind() {
    let text = "[frames]\nend = 24\n[plants.a]\nshapes = \"turf.shapes\"\n[plants.a.growth]\nroots = 40\nroot_radius = 0.3\n\
        [plants.a.wood]\nelasticity_gpa = 0.3\nstiffness = 0.1\n[wind]\nspeed = 6\n";
    let scene = assembled(text);
    let asset = &scene.animated.scene.assets[0];
    let mesh = &asset.meshes[0].mesh;
    // Rows of three points and one at the tip, every triangle with an area.
    assert!(mesh.triangles.len() > 40 * 8 && mesh.points.len() < 40 * 60);
    let frames = evaluated(&scene, &[1, 12]);
    let [a, b] =
        [0, 1].map(|k| osier::scene::mesh_points(asset, &asset.meshes[0], 0, &frames[k].assets[0]).into_owned());
    let moved = a.iter().zip(&b).map(|(p, q)| p.distance(*q)).fold(0.0_f32, f32::max);
    assert!(moved > 0.01, "the tips sway: {moved}");
}

#[test]
fn particle_shapes_stand_in_wind_and_rain_and_shed_seeds() {
    // One scene: a bush in the rain, a bush that sways, catkins released from a tree of particle-shapes.
    let dir = tempfile::tempdir().expect("dir");
    let path = dir.path().join("mixed.toml");
    let text = "[frames]\nend = 8\n[plants.bush]\nshapes = \"bush.shapes\"\n[plants.bush.growth]\nroots = 3\n\
        [[place]]\nplant = \"bush\"\n[wind]\nspeed = 5\n[rain]\nrate_mm_per_h = 30\n[maps]\nmax_mapped_leaves = 2\nresolution = 64\n\
        [catkin]\n[flight]\nrelease = \"canopy\"\ncanopy = { bush = 1 }\ncount = 40\nduration = 1\nsize = [6, 6, 4]\n";
    fs::write(&path, text).expect("scene");
    let out = dir.path().join("out");
    let (_, err) = ends(0, &["bake", arg(&path), "-o", arg(&out), "--formats", "usd,glb,pov"]);
    assert!(!err.contains("error"), "{err}");
    let manifest: Value =
        serde_json::from_slice(&fs::read(Path::new(&out).join("manifest.json")).expect("manifest")).expect("JSON");
    assert!(manifest.to_string().contains("bush"));
}

#[test]
fn tips_are_not_thicker_than_the_base() {
    let with =
        |keys: &str| complaint(&format!("[plants.a]\nshapes = \"bush.shapes\"\n[plants.a.growth]\nlevels = 2\n{keys}"));
    let said = with("radius = 0.001\ntip_radius = 0.01\n");
    assert!(said.contains("S003") && said.contains("0.001 m") && said.contains("tip_radius"), "{said}");
    assert!(with("radius = 0.015\nradii = \"taper\"\ntip_radius = 0.03\n").contains("S003"));
    // Equal radii make rods, and blades have none.
    assert_eq!(with("radius = 0.01\ntip_radius = 0.01\n"), "");
    assert_eq!(with("radius = 0.001\ntip_radius = 0.01\nblade_width = 0.02\n"), "");
}
