//! Leaves through the year and the light of crowns, through scenes and bakes: how many leaves a season has, their colours in files, bare
//! trees in wind and rain, clips, and what their keys complain of.
#![allow(clippy::expect_used, clippy::disallowed_methods, reason = "tests run programs and read their files")]

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

use glam::Vec3;
use osier::bake::motion;
use osier::bake::scene::{AssembledScene, SceneOptions};
use osier::recipe::{Recipe, Request, resolve};
use osier::scene::{Asset, AttributeData, CANOPY_OCCLUSION, Instancer, InstancerFrame, InstancerMotion, LEAF_COLOR};
use serde_json::Value;

use crate::common::gltf_player::Player;
use crate::common::program::{arg, assert_same, ends, tree};
use crate::common::{clients, grown};

/// Plants of every source that has leaves, cheap to grow.
const SOURCES: [&str; 4] = [
    "grammar = \"birch.l\"\nsteps = 14\n",
    "shapes = \"bush.shapes\"\n",
    "species = \"hazel\"\nage = 6\n",
    "ifs = \"monopodial.ifs.toml\"\n",
];

fn recipe(text: &str) -> Recipe {
    let request = Request { name: "s".into(), shown: "s.toml".into(), text: text.into(), ..Request::default() };
    let mut recipe = resolve(&request).unwrap_or_else(|e| panic!("{e}")).0;
    grown::small(&mut recipe);
    recipe
}

fn assembled(text: &str) -> AssembledScene {
    grown::stage(&recipe(text), SceneOptions::WITHOUT_GROUND)
}

/// The first plant of a scene.
fn plant(text: &str) -> Asset {
    assembled(text).animated.scene.assets[0].clone()
}

fn instancer<'a>(asset: &'a Asset, name: &str) -> Option<&'a Instancer> {
    asset.instancers.iter().find(|i| i.name == name)
}

fn count(asset: &Asset, name: &str) -> usize {
    instancer(asset, name).map_or(0, Instancer::len)
}

/// Diagnostics of a scene that resolves or not.
fn complaint(text: &str) -> String {
    let request = Request { name: "s".into(), shown: "s.toml".into(), text: text.into(), ..Request::default() };
    match resolve(&request) {
        Ok((_, report)) => format!("{}", osier::Error::Input(Box::new(report))),
        Err(e) => e.to_string(),
    }
}

#[test]
fn leaves_of_every_source_come_turn_and_fall() {
    for source in SOURCES {
        let at = |season: &str| plant(&format!("[plants.a]\n{source}season = {season}\n"));
        let summer = plant(&format!("[plants.a]\n{source}"));
        let all = count(&summer, "leaves");
        let share = |season: &str| count(&at(season), "leaves") as f64 / all as f64;
        assert!(all > 100, "{source}: {all} leaves");
        assert!(share("0") < 1e-9 && share("1") < 1e-9, "{source}: closed buds and bare twigs");
        assert!(share("0.3") > 0.999 && share("0.5") > 0.999, "{source}");
        let (october, november) = (share("0.8"), share("0.9"));
        assert!((0.6..0.95).contains(&october), "{source}: {october}");
        assert!((0.25..0.6).contains(&november), "{source}: {november}");
        // Buds stand where leaves are missing, one at a place.
        let buds = count(&at("1"), "buds");
        assert!(buds > 0 && buds <= all && count(&at("0.5"), "buds") == 0, "{source}: {buds} buds");
        // A date is a season: midwinter is bare.
        let winter = ["\"01-15\"", "\"12-24\""].map(|date| count(&at(date), "leaves"));
        assert_eq!(winter, [0, 0], "{source}");
    }
}

#[test]
fn summer_is_the_plant_without_a_season() {
    let text = "[plants.a]\nspecies = \"hazel\"\nage = 6\n";
    let (plain, summer) = (plant(text), plant(&format!("{text}season = 0.5\n")));
    let (plain, summer) = (instancer(&plain, "leaves").expect("leaves"), instancer(&summer, "leaves").expect("leaves"));
    assert!(plain.rest.positions == summer.rest.positions && plain.rest.orientations == summer.rest.orientations);
    assert!(plain.protos == summer.protos && plain.scales == summer.scales && plain.ids == summer.ids);
    assert!(plain.rest.attributes.is_empty() && summer.rest.attribute(LEAF_COLOR).is_some());
    assert_eq!(plain.prototypes.len(), summer.prototypes.len());
}

#[test]
fn the_season_of_a_scene_is_that_of_its_plants() {
    let hazel = |name: &str, keys: &str| format!("[plants.{name}]\nspecies = \"hazel\"\nage = 4\n{keys}");
    let scene = assembled(&format!("season = 1\n{}{}", hazel("a", ""), hazel("b", "season = 0.5\n")));
    let assets = &scene.animated.scene.assets;
    assert!(count(&assets[0], "leaves") == 0 && count(&assets[1], "leaves") > 50);
    // In the south, winter is in July.
    let july = |latitude: &str| {
        count(&plant(&format!("season = \"07-15\"\nlatitude = {latitude}\n{}", hazel("a", ""))), "leaves")
    };
    assert!(july("-50") == 0 && july("50") > 50);
}

#[test]
fn needles_stay_and_larches_lose_theirs() {
    let at = |season: &str, keys: &str| {
        let text = format!(
            "[plants.a]\nspecies = \"larch\"\nage = 6\nseason = {season}\n[plants.a.leaf]\nblade = \"needles\"\n{keys}"
        );
        count(&plant(&text), "leaves")
    };
    let all = at("0.5", "");
    assert!(all > 10 && at("1", "") == all && at("0", "") == all);
    assert_eq!(at("1", "evergreen = false\n"), 0);
    // Young beeches keep dry leaves.
    let kept = at("1", "evergreen = false\nkeeps = 0.3\n") as f64 / all as f64;
    assert!((0.25..0.35).contains(&kept), "{kept}");
}

#[test]
fn all_shoots_of_the_year_are_fresh_on_evergreens_of_any_age() {
    let at = |age: u32, season: &str| {
        let leaf = "[plants.a.leaf]\nblade = \"needles\"\nsize = 0.2\n";
        let asset = plant(&format!("[plants.a]\nspecies = \"spruce\"\nage = {age}\nseason = {season}\n{leaf}"));
        instancer(&asset, "leaves").expect("leaves").clone()
    };
    let colors = |leaves: &Instancer| -> Vec<[f32; 4]> {
        let Some(AttributeData::Unit4(colors)) = leaves.rest.attribute(LEAF_COLOR) else { panic!("colours") };
        colors.clone()
    };
    for age in [5, 12] {
        let (before, spring, summer) = (at(age - 1, "0.5"), at(age, "0.1"), at(age, "0.5"));
        assert_eq!(spring.ids, summer.ids);
        let fresh: BTreeSet<u64> = (spring.ids.iter().zip(colors(&spring).iter().zip(&colors(&summer))))
            .filter(|(_, (now, green))| (now[1] - green[1]).abs() > 1e-3)
            .map(|(id, _)| *id)
            .collect();
        // Pieces that the tree did not have a year before are on shoots of this year.
        let known: BTreeSet<u64> = before.ids.iter().copied().collect();
        let new: Vec<u64> = spring.ids.iter().copied().filter(|id| !known.contains(id)).collect();
        assert!(new.len() > 10 && new.iter().all(|id| fresh.contains(id)), "{} new of {age} years", new.len());
        assert!(fresh.len() * 10 < spring.ids.len() * 8, "{} of {}", fresh.len(), spring.ids.len());
    }
}

#[test]
fn the_sunlit_leaves_of_a_crown_turn_first() {
    let asset = plant("[plants.a]\ngrammar = \"oak.l\"\nseason = 0.68\ncanopy_occlusion = true\n");
    let leaves = instancer(&asset, "leaves").expect("leaves");
    let Some(AttributeData::Unit1(shade)) = leaves.rest.attribute(CANOPY_OCCLUSION) else { panic!("occlusion") };
    let Some(AttributeData::Unit4(colors)) = leaves.rest.attribute(LEAF_COLOR) else { panic!("colours") };
    let (mut turned, mut green) = ((0.0, 0.0_f32), (0.0, 0.0_f32));
    for (shade, [r, g, ..]) in shade.iter().zip(colors) {
        let side = if r > g { &mut turned } else { &mut green };
        (side.0, side.1) = (side.0 + shade, side.1 + 1.0);
    }
    assert!(turned.1 > 0.1 * green.1 && turned.1 < 3.0 * green.1, "{turned:?} {green:?}");
    assert!(turned.0 / turned.1 < green.0 / green.1 - 0.05, "{turned:?} {green:?}");
}

/// A small scene in autumn, in wind.
const AUTUMN: &str = "seed = 3\n[frames]\nend = 3\n[plants.a]\ngrammar = \"poplar-twig.l\"\nseason = 0.82\n\
    canopy_occlusion = true\ncanopy_normals = 0.5\n[plants.a.leaf]\nblade = \"deltoid\"\nside = 32\n\
    autumn = [\"#d02020\", \"#e0c030\"]\nautumn_weights = [1, 1]\n[plants.a.bark]\nside = 32\n[wind]\n[ground]\nshow = false\n";

fn bake(folder: &Path, name: &str, text: &str, formats: &str, more: &[&str]) -> std::path::PathBuf {
    let scene = folder.join(format!("{name}.toml"));
    fs::write(&scene, text).expect("scene");
    let out = folder.join(format!("{name}-{}", formats.replace(',', "-")));
    ends(0, &[&["-q", "bake", arg(&scene), "-o", arg(&out), "--formats", formats], more].concat());
    out
}

/// What usd-core reads of a stage's leaves.
fn usd_leaves(stage: &Path) -> Option<Vec<Value>> {
    let python = clients::python()?;
    let told = clients::python_script(&python, "usd_leaves.py", &[arg(stage)]);
    Some(serde_json::from_slice(&told.stdout).expect("JSON"))
}

fn numbers(v: &Value) -> Vec<f64> {
    v.as_array().expect("a list").iter().map(|x| x.as_f64().expect("a number")).collect()
}

#[test]
fn usd_has_the_colour_of_every_leaf() {
    let dir = tempfile::tempdir().expect("dir");
    let out = bake(dir.path(), "autumn", AUTUMN, "usd", &[]);
    let Some(told) = usd_leaves(&out.join("autumn.usda")) else { return };
    let leaves = told.iter().find(|t| t["name"] == "leaves").expect("leaves");
    let names: BTreeSet<&str> =
        leaves["materials"].as_array().expect("materials").iter().filter_map(Value::as_str).collect();
    assert!(names.contains("a_leaf_turned_0") && names.contains("a_leaf_turned_1"), "{names:?}");
    let colors = leaves["values"]["leaf_color"].as_array().expect("colours");
    for (color, material) in colors.iter().zip(leaves["materials"].as_array().expect("materials")) {
        let [r, g, b, a] = numbers(color)[..] else { panic!("four numbers") };
        assert!(a > 0.999 && b < r);
        match material.as_str().expect("a name") {
            // The first colour of autumn is a red, the second a yellow.
            "a_leaf_turned_0" => assert!(r > 3.0 * g, "{r} {g}"),
            "a_leaf_turned_1" => assert!(r > g && g > 0.3 * r, "{r} {g}"),
            "a_leaf" => assert!(g > r, "{r} {g}"),
            _ => {}
        }
    }
    // The crown: occlusion between 0 and 1, directions as long as normals are bent.
    let occlusion = numbers(&leaves["values"]["canopy_occlusion"]);
    assert!(occlusion.iter().all(|o| (0.0..=1.0).contains(o)) && occlusion.iter().any(|o| *o > 0.05));
    for direction in leaves["values"]["canopy_normal"].as_array().expect("directions") {
        let length = numbers(direction).iter().map(|v| v * v).sum::<f64>().sqrt();
        assert!((length - 0.5).abs() < 1e-4, "{length}");
    }
    // With +Z up the directions turn with the points.
    let turned = bake(dir.path(), "turned", AUTUMN, "usd", &["--set", "output.usd.up=\"z\""]);
    let told = usd_leaves(&turned.join("turned.usda")).expect("python");
    let leaves_z = told.iter().find(|t| t["name"] == "leaves").expect("leaves");
    let first = |t: &Value| numbers(&t["values"]["canopy_normal"][0]);
    let (y_up, z_up) = (first(leaves), first(leaves_z));
    assert!((z_up[2] - y_up[1]).abs() < 1e-5 && (z_up[1] + y_up[2]).abs() < 1e-5, "{y_up:?} {z_up:?}");
}

#[test]
fn gltf_has_the_colour_of_every_leaf() {
    let dir = tempfile::tempdir().expect("dir");
    let profiles = ["--set", "output.gltf.profiles=[\"web\",\"blender\",\"engine\"]"];
    let out = bake(dir.path(), "autumn", AUTUMN, "glb", &profiles).join("gltf");
    let read = |name: &str| Player::new(&fs::read(out.join(name)).expect("a file"));
    let index = |v: &Value| usize::try_from(v.as_u64().expect("an index")).expect("small");
    // Instances carry their colour, their occlusion and the direction out of the crown.
    let web = read("autumn.web.glb");
    let mut seen = 0;
    for node in web.json["nodes"].as_array().expect("nodes") {
        let attributes = &node["extensions"]["EXT_mesh_gpu_instancing"]["attributes"];
        let Some(colors) = attributes.get("_LEAF_COLOR") else { continue };
        let mesh = &web.json["meshes"][index(&node["mesh"])];
        let material = &web.json["materials"][index(&mesh["primitives"][0]["material"])]["name"];
        for row in web.rows(index(colors)) {
            if material == "a_leaf_turned_0" {
                assert!(row[0] > 3.0 * row[1], "{row:?}");
                seen += 1;
            }
        }
        assert!(web.rows(index(&attributes["_CANOPY_OCCLUSION"])).iter().all(|r| (0.0..=1.0).contains(&r[0])));
        assert!(
            web.rows(index(&attributes["_CANOPY_NORMAL"]))
                .iter()
                .all(|r| { (Vec3::from_slice(r).length() - 0.5).abs() < 1e-4 })
        );
    }
    assert!(seen > 3, "{seen} red leaves");
    // Merged leaves have them at their vertices, and bent normals.
    let merged = read("autumn.blender.glb");
    let flat = bake(dir.path(), "flat", &AUTUMN.replace("canopy_normals = 0.5\n", ""), "glb", &profiles).join("gltf");
    let plain = Player::new(&fs::read(flat.join("flat.blender.glb")).expect("a file"));
    let (mut colored, mut bent) = (0, 0);
    let meshes = |p: &Player| p.json["meshes"].as_array().expect("meshes").clone();
    for (mesh, unbent) in meshes(&merged).iter().zip(meshes(&plain)) {
        let pairs = mesh["primitives"].as_array().expect("primitives").iter();
        for (primitive, other) in pairs.zip(unbent["primitives"].as_array().expect("primitives")) {
            let Some(colors) = primitive["attributes"].get("_LEAF_COLOR") else { continue };
            assert_eq!(
                merged.rows(index(colors)).len(),
                merged.vectors(index(&primitive["attributes"]["NORMAL"])).len()
            );
            colored += 1;
            let normals = |p: &Player, primitive: &Value| p.vectors(index(&primitive["attributes"]["NORMAL"]));
            let (a, b) = (normals(&merged, primitive), normals(&plain, other));
            bent += a.iter().zip(&b).filter(|(a, b)| a.distance(**b) > 0.1).count();
        }
    }
    assert!(colored > 3 && bent > 100, "{colored} {bent}");
    if let Some((node, modules)) = clients::validator() {
        for file in [out.join("autumn.web.glb"), out.join("autumn.blender.glb"), out.join("a.engine.glb")] {
            let mut command = std::process::Command::new(&node);
            let told = clients::run(command.arg(clients::script("gltf_validate.mjs")).arg(&modules).arg(&file));
            let report: Value = serde_json::from_slice(&told.stdout).expect("JSON");
            assert!(report["errors"] == 0 && report["warnings"] == 0, "{report}");
        }
    }
}

#[test]
fn copies_in_gltf_have_the_colours_of_their_leaves() {
    let dir = tempfile::tempdir().expect("dir");
    let still = AUTUMN.replace("end = 3", "end = 1");
    let with = |count: u32| {
        let place = format!("{still}[[place]]\nplant = \"a\"\ncount = {count}\nradius = 4\nindividuals = 1\n");
        let profiles = ["--set", "output.gltf.profiles=[\"web\",\"blender\"]"];
        let name = format!("wood_{count}");
        let out = bake(dir.path(), &name, &place, "glb", &profiles).join("gltf");
        ["web", "blender"].map(|p| Player::new(&fs::read(out.join(format!("{name}.{p}.glb"))).expect("a file")))
    };
    let index = |v: &Value| usize::try_from(v.as_u64().expect("an index")).expect("small");
    let ([one, _], [web, merged]) = (with(1), with(3));
    // The instances of a node by its name.
    let instances = |player: &Player, name: &str| -> Value {
        let node = player.node(name).expect("a node");
        player.json["nodes"][node]["extensions"]["EXT_mesh_gpu_instancing"]["attributes"].clone()
    };
    let turns = web.rows(index(&instances(&web, "a_bark")["ROTATION"]));
    assert_eq!(turns.len(), 3);
    let mut seen = 0;
    for node in one.json["nodes"].as_array().expect("nodes") {
        let Some(name) = node["name"].as_str().filter(|name| name.starts_with("a_leaves")) else { continue };
        let [own, all] = [instances(&one, name), instances(&web, name)];
        let [own, all] = [(&one, own), (&web, all)].map(|(player, list)| {
            ["_LEAF_COLOR", "_CANOPY_OCCLUSION", "_CANOPY_NORMAL"].map(|key| player.rows(index(&list[key])))
        });
        for (k, turn) in turns.iter().enumerate() {
            let turn = glam::Quat::from_slice(turn).normalize();
            for i in 0..own[0].len() {
                let copy = k * own[0].len() + i;
                assert_eq!((&all[0][copy], &all[1][copy]), (&own[0][i], &own[1][i]), "{name} {k} {i}");
                let toward = turn * Vec3::from_slice(&own[2][i]);
                assert!((Vec3::from_slice(&all[2][copy]) - toward).length() < 1e-3, "{name} {k} {i}");
                seen += 1;
            }
        }
    }
    assert!(seen > 30, "{seen}");
    // Copies of profile `blender` are one mesh: its bark is white.
    let (mut red, mut white) = (0, 0);
    for primitive in
        merged.json["meshes"].as_array().expect("meshes").iter().flat_map(|m| m["primitives"].as_array()).flatten()
    {
        let attributes = &primitive["attributes"];
        let material = merged.json["materials"][index(&primitive["material"])]["name"].as_str().expect("a name");
        let colors = merged.rows(index(&attributes["_LEAF_COLOR"]));
        let occlusion = merged.rows(index(&attributes["_CANOPY_OCCLUSION"]));
        let points = merged.vectors(index(&attributes["POSITION"])).len();
        assert_eq!((colors.len(), occlusion.len()), (points, points));
        if material == "a_leaf_turned_0" {
            assert!(colors.iter().all(|c| c[0] > 3.0 * c[1]) && occlusion.iter().any(|o| o[0] > 0.05), "{colors:?}");
            red += 1;
        }
        if material.ends_with("_bark") {
            assert!(colors.iter().flatten().all(|c| *c > 0.999) && occlusion.iter().all(|o| o[0] <= 0.0), "{colors:?}");
            white += 1;
        }
    }
    assert!(red > 0 && white > 0, "{red} {white}");
}

#[test]
fn the_blender_importer_gives_leaves_their_colour_and_occlusion() {
    let Some(python) = clients::python() else { return };
    let dir = tempfile::tempdir().expect("dir");
    let out = bake(dir.path(), "autumn", AUTUMN, "usd", &[]);
    let manifest: Value = serde_json::from_slice(&fs::read(out.join("manifest.json")).expect("file")).expect("JSON");
    let leaves = &manifest["assets"][0]["leaves"];
    let rows = fs::read(out.join(leaves["file"].as_str().expect("a path"))).expect("a table");
    let values: Vec<f64> =
        rows.chunks_exact(4).map(|b| f64::from(f32::from_le_bytes([b[0], b[1], b[2], b[3]]))).collect();
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("blender/tests/leaves.py");
    let mut command = std::process::Command::new(&python);
    let told = clients::run(command.arg(script).arg(out.join("manifest.json")).arg(dir.path()));
    let text = String::from_utf8_lossy(&told.stdout);
    let told: Value = serde_json::from_str(text.trim_end().lines().last().expect("a line")).expect("JSON");
    // The means of each instancer are those of the table.
    let mut start = 0;
    for name in leaves["order"].as_array().expect("instancers").iter().filter_map(Value::as_str) {
        let count = usize::try_from(leaves["instancers"][name].as_u64().expect("a number")).expect("small");
        let mean =
            |k: usize| values[4 * start..4 * (start + count)].iter().skip(k).step_by(4).sum::<f64>() / count as f64;
        let of = &told["leaves"][name];
        assert_eq!(of["count"].as_u64(), leaves["instancers"][name].as_u64(), "{told}");
        let near = |v: &Value, wanted: f64| (v.as_f64().expect("a number") - wanted).abs() < 1e-4;
        assert!((0..3).all(|k| near(&of["color"][k], mean(k))) && near(&of["occlusion"], mean(3)), "{name}: {told}");
        start += count;
    }
    assert_eq!(4 * start, values.len());
    // Materials of leaves read it, and a picture shows it.
    assert!(told["readers"].as_u64().expect("a number") > 3, "{told}");
    assert!((0.05..=1.0).contains(&told["brightest"].as_f64().expect("a number")), "{told}");
    // Without the keys the manifest has no table.
    let plain = AUTUMN.replace("season = 0.82", "").replace("canopy_occlusion = true", "");
    let out = bake(dir.path(), "plain", &plain, "usd", &[]);
    let manifest: Value = serde_json::from_slice(&fs::read(out.join("manifest.json")).expect("file")).expect("JSON");
    assert!(manifest["assets"][0].get("leaves").is_none() && !out.join("usd/a.leaves.f4").exists());
}

#[test]
fn bytes_of_a_season_do_not_depend_on_threads() {
    let dir = tempfile::tempdir().expect("dir");
    let scene = dir.path().join("clip.toml");
    fs::write(&scene, AUTUMN.replace("season = 0.82", "season = [0.7, 0.95]")).expect("scene");
    let made = ["-j1", "-j2", "-j5"].map(|jobs| {
        let out = dir.path().join(jobs);
        ends(0, &["-q", "bake", arg(&scene), "-o", arg(&out), "--formats", "usd,glb,pov", jobs]);
        let mut files = tree(&out);
        files.retain(|name, _| !name.starts_with('.'));
        files
    });
    assert!(made[0].len() > 10);
    assert_same(&made[0], &made[1], "two threads");
    assert_same(&made[0], &made[2], "five threads");
}

#[test]
fn a_bare_tree_stands_in_wind_and_rain() {
    for (season, motion) in [("1", "skin"), ("1", "game"), ("\"02-01\"", "cache")] {
        let text = format!(
            "[frames]\nend = 3\n[plants.a]\ngrammar = \"poplar-twig.l\"\nseason = {season}\nmotion = \"{motion}\"\n[wind]\n"
        );
        let scene = assembled(&text);
        let asset = &scene.animated.scene.assets[0];
        assert!(asset.moves() && count(asset, "leaves") == 0);
        motion::evaluate_frame(&scene.animated.scene, &scene.animated.motions, 3, false).expect("a frame");
    }
    let dir = tempfile::tempdir().expect("dir");
    let rainy = AUTUMN.replace("season = 0.82", "season = 1") + "[rain]\n";
    let out = bake(dir.path(), "rain", &rainy, "usd,glb,pov", &[]);
    if let Some(told) = usd_leaves(&out.join("rain.usda")) {
        assert!(told.iter().all(|t| t["name"] != "leaves"));
    }
    // On rods, too.
    let rods = AUTUMN.replace("season = 0.82", "season = 1").replace("[wind]", "[plants.a.rods]\n[wind]");
    bake(dir.path(), "rods", &rods, "usd", &[]);
}

#[test]
fn leaves_change_over_a_clip() {
    let text = |season: &str| {
        format!("[frames]\nend = 9\n[plants.a]\nspecies = \"hazel\"\nage = 5\nseason = {season}\n[wind]\n")
    };
    let scene = assembled(&text("[0.55, 1.0]"));
    let asset = &scene.animated.scene.assets[0];
    let leaves = asset.instancers.iter().position(|i| i.name == "leaves").expect("leaves");
    assert!(asset.instancers[leaves].motion == InstancerMotion::Free);
    let shown = |number: u32| {
        let frame =
            motion::evaluate_frame(&scene.animated.scene, &scene.animated.motions, number, false).expect("a frame");
        let InstancerFrame::State(state) = frame.assets[0].instancer(leaves) else { panic!("a state") };
        state.alive.iter().filter(|a| **a).count()
    };
    let still = |season: &str| count(&plant(&text(season)), "leaves");
    let counts: Vec<usize> = (1..=9).map(shown).collect();
    assert!(counts[0] == still("0.55") && counts[8] == 0, "{counts:?}");
    assert!(counts.windows(2).all(|w| w[1] <= w[0]) && counts[6] < counts[0], "{counts:?}");
    // Half of the clip is the season in the middle.
    assert_eq!(counts[4], still("0.775"));
    // Too many leaves for nodes of glTF are as at the first frame.
    let dir = tempfile::tempdir().expect("dir");
    let clip = AUTUMN.replace("season = 0.82", "season = [0.5, 0.9]");
    let out = bake(dir.path(), "still", &clip, "glb", &["--set", "output.gltf.nodes=20"]);
    let manifest: Value = serde_json::from_slice(&fs::read(out.join("manifest.json")).expect("file")).expect("JSON");
    let warnings = manifest["warnings"].to_string();
    assert!(warnings.contains("X003") && warnings.contains("stay as at the first frame"), "{warnings}");
    let web = Player::new(&fs::read(out.join("gltf/still.web.glb")).expect("a file"));
    let instances = |node: &Value| {
        let accessor = node["extensions"]["EXT_mesh_gpu_instancing"]["attributes"]["TRANSLATION"].as_u64()?;
        web.json["accessors"][usize::try_from(accessor).ok()?]["count"].as_u64()
    };
    let shown: u64 = web.json["nodes"].as_array().expect("nodes").iter().filter_map(instances).sum();
    let summer = count(&plant(&AUTUMN.replace("season = 0.82", "season = 0.5")), "leaves");
    assert_eq!(shown, summer as u64, "all leaves of the first frame");
    // In files: colours have samples, and what has fallen is invisible.
    let out = bake(dir.path(), "clip", &clip, "usd,pov,unreal", &[]);
    let Some(told) = usd_leaves(&out.join("clip.usda")) else { return };
    let leaves: Vec<&Value> = told.iter().filter(|t| t["name"] == "leaves").collect();
    let greens = |t: &Value| {
        let colors = t["values"]["leaf_color"].as_array().expect("colours");
        colors.iter().filter(|c| numbers(c)[1] > numbers(c)[0]).count() as f64 / colors.len() as f64
    };
    let count = |t: &Value| t["materials"].as_array().expect("materials").len();
    assert!(greens(leaves[0]) > 0.99 && greens(leaves[1]) < 0.05, "{} {}", greens(leaves[0]), greens(leaves[1]));
    assert!(count(leaves[1]) < count(leaves[0]));
}

/// The first and the last day of the year are both in winter: what is between them are the days, not their seasons.
#[test]
fn a_clip_of_a_year_has_a_summer() {
    let text = "[frames]\nend = 13\n[plants.a]\nspecies = \"hazel\"\nage = 4\nseason = [\"01-01\", \"12-31\"]\nlatitude = 50\n";
    let scene = assembled(text);
    let leaves = scene.animated.scene.assets[0].instancers.iter().position(|i| i.name == "leaves").expect("leaves");
    let shown = |number: u32| {
        let frame =
            motion::evaluate_frame(&scene.animated.scene, &scene.animated.motions, number, false).expect("a frame");
        let InstancerFrame::State(state) = frame.assets[0].instancer(leaves) else { panic!("a state") };
        state.alive.iter().filter(|a| **a).count()
    };
    // Frame 7 is day 183, in summer: every leaf is there.
    let summer = count(&plant("[plants.a]\nspecies = \"hazel\"\nage = 4\nseason = 0.4\n"), "leaves");
    assert!(summer > 0 && shown(1) == 0 && shown(7) == summer && shown(13) == 0, "{summer} {}", shown(7));
}

#[test]
fn faults_of_a_season_are_told_at_their_place() {
    let with = |keys: &str| complaint(&format!("[plants.a]\ngrammar = \"birch.l\"\n{keys}"));
    assert!(with("season = 1.2\n").contains("0 to 1"));
    let date = with("season = \"15-10\"\n");
    assert!(date.contains("S003") && date.contains("is not a date") && date.contains("s.toml:3:10"), "{date}");
    let date = with("season = 2026-10-15\n");
    assert!(date.contains("S003") && date.contains("write month and day in quotes"), "{date}");
    let speed = with("[wind]\nspeed = 2026-10-15\n");
    assert!(speed.contains("wind.speed is a date, but must be a number"), "{speed}");
    assert!(with("season = [0.1, 0.2, 0.3]\n").contains("has 3 values, but must have 2"));
    assert!(with("season = true\n").contains("a season from 0 to 1"));
    let leaf = |keys: &str| with(&format!("season = 0.8\n[plants.a.leaf]\n{keys}"));
    let many = format!("autumn = [{}]\n", vec!["\"#c04020\""; 13].join(", "));
    assert!(leaf(&many).contains("has 13 colors, but may have 12"));
    assert!(leaf("autumn = [\"#c04020\"]\nautumn_weights = [1, 2]\n").contains("2 numbers for 1 colors"));
    assert!(leaf("autumn = [\"#c04020\"]\nautumn_weights = [0]\n").contains("leaves no color"));
    assert!(leaf("falls = \"tip\"\n").contains("did you mean \"tips\"?"));
    // What cannot change over the clip, and what has no season.
    let clip = "season = [0.2, 0.8]\n";
    assert!(with(&format!("{clip}[rain]\n[frames]\nend = 3\n")).contains("rain meets leaves that stay"));
    assert!(with(&format!("{clip}motion = \"game\"\n")).contains("left to shaders"));
    assert!(with(&format!("{clip}growth_clip = [0, 1]\n[frames]\nend = 3\n")).contains("grows over the clip"));
    assert!(with(&format!("{clip}[plants.a.rods]\n")).contains("leaves on rods stay"));
    assert!(with(clip).contains("the scene has one frame"), "{}", with(clip));
    assert!(!with(&format!("{clip}[frames]\nend = 3\n")).contains("has one frame"));
    let growing =
        "[frames]\nend = 9\n[plants.a]\nspecies = \"hazel\"\nseason = 0.8\n[plants.a.site]\nfrom = 1\nto = 4\n";
    assert!(complaint(growing).contains("`clip_leaves`"), "{}", complaint(growing));
    let tree = "[plants.a]\nifs = \"monopodial.ifs.toml\"\nseason = 0.8\n[plants.a.tree]\n";
    assert!(complaint(&format!("{tree}lod = 1\n")).contains("pictures on billboards"));
    assert!(complaint(&format!("{tree}twigs = true\n")).contains("each leaf on its own"));
    let mesh = "[plants.a]\nmesh = \"young-tree.obj\"\nseason = 0.8\n";
    assert!(complaint(mesh).contains("has no effect on a mesh"));
}
