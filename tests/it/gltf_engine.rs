//! Profile `engine` of glTF, through the program: plain files, levels of detail, one skin, wind in vertex colours, and a table of
//! placements.
#![allow(clippy::expect_used, clippy::disallowed_methods, reason = "tests run the program and read its files")]
#![allow(clippy::cast_possible_truncation, clippy::cast_precision_loss, reason = "small test numbers")]

use std::path::{Path, PathBuf};
use std::process::Command;

use glam::Vec3;
use osier::neighbours::NeighbourGrid;
use serde_json::Value;

use crate::common::clients;
use crate::common::gltf_player::Player;

/// Two kinds of swaying trees, two individuals of one and three copies of an individual of the other, and ground.
const SCENE: &str = r#"
[frames]
end = 8
[plants.birch]
grammar = "birch.l"
[plants.birch.leaf]
size = 0.058
[plants.silk]
grammar = "silk-tree.l"
[[place]]
plant = "birch"
[[place]]
plant = "birch"
at = [5, 0, 2]
turn_deg = 40
scale = 1.25
[[place]]
plant = "silk"
at = [-9, 0, 1]
count = 3
individuals = 1
[wind]
model = "gust"
speed = 6
"#;

/// Bakes the scene as glTF of one profile.
fn bake(folder: &Path, profile: &str, sets: &[&str]) -> PathBuf {
    let scene = folder.join("grove.toml");
    std::fs::write(&scene, SCENE).expect("scene");
    let out = folder.join(profile);
    let mut command = Command::new(env!("CARGO_BIN_EXE_osier"));
    command.args(["-q", "bake"]).arg(&scene).arg("-o").arg(&out).args(["--formats", "glb"]);
    command.args(["--set", &format!("output.gltf.profiles=[\"{profile}\"]")]);
    for set in sets {
        command.args(["--set", set]);
    }
    clients::run(&mut command);
    out.join("gltf")
}

fn player(path: &Path) -> Player {
    Player::new(&std::fs::read(path).expect("file"))
}

fn list<'a>(v: &'a Value, key: &str) -> &'a [Value] {
    v[key].as_array().map_or(&[], Vec::as_slice)
}

fn index(v: &Value) -> usize {
    v.as_u64().map_or(usize::MAX, |n| n as usize)
}

/// Triangles of a mesh, by material.
fn triangles(player: &Player, mesh: &Value) -> Vec<(usize, usize)> {
    let count = |p: &Value| index(&player.json["accessors"][index(&p["indices"])]["count"]) / 3;
    list(mesh, "primitives").iter().map(|p| (index(&p["material"]), count(p))).collect()
}

/// The area of the triangles of a mesh whose material is double-sided, that is of leaves, m^2.
fn leaf_area(player: &Player, mesh: &Value) -> f32 {
    let is_leaf = |p: &&Value| player.json["materials"][index(&p["material"])]["doubleSided"] == true;
    let area = |p: &Value| {
        let points = player.vectors(index(&p["attributes"]["POSITION"]));
        let corners: Vec<f32> = player.rows(index(&p["indices"])).into_iter().flatten().collect();
        let at = |i: f32| points[i as usize];
        corners.chunks(3).map(|c| (at(c[1]) - at(c[0])).cross(at(c[2]) - at(c[0])).length() * 0.5).sum::<f32>()
    };
    list(mesh, "primitives").iter().filter(is_leaf).map(area).sum()
}

fn bounds(points: &[Vec3]) -> [Vec3; 2] {
    points.iter().fold([Vec3::INFINITY, Vec3::NEG_INFINITY], |[l, h], p| [l.min(*p), h.max(*p)])
}

#[test]
fn plants_are_levels_with_one_skin_and_nothing_is_required() {
    let temp = tempfile::tempdir().expect("temp");
    let folder = bake(temp.path(), "engine", &["output.gltf.triangles=12000"]);
    for name in ["birch_1", "silk"] {
        let player = player(&folder.join(format!("{name}.engine.glb")));
        let json = &player.json;
        assert!(json["extensionsRequired"].is_null(), "{name}");
        let nodes = list(json, "nodes");
        let levels: Vec<&Value> = nodes
            .iter()
            .filter(|n| n["name"].as_str().is_some_and(|w| w.starts_with(&format!("{name}_LOD"))))
            .collect();
        assert!(levels.len() >= 3, "{name}: {} levels", levels.len());
        let mut counts = Vec::new();
        let mut screens = Vec::new();
        for (lod, node) in levels.iter().enumerate() {
            assert_eq!(node["name"], format!("{name}_LOD{lod}"));
            assert_eq!((&node["skin"], &node["translation"]), (&0.into(), &Value::Null), "one skin, at the root");
            let mesh = &json["meshes"][index(&node["mesh"])];
            assert_eq!(mesh["name"], node["name"]);
            let own: usize = triangles(&player, mesh).iter().map(|t| t.1).sum();
            let extras = &mesh["extras"]["osier"];
            assert_eq!((index(&extras["lod"]), index(&extras["triangles"])), (lod, own));
            counts.push(own);
            screens.push(extras["screen"].as_f64().expect("screen"));
            for primitive in list(mesh, "primitives") {
                let attribute = |key: &str| index(&primitive["attributes"][key]);
                assert_eq!(json["accessors"][attribute("JOINTS_0")]["componentType"], 5121);
                let weights = player.rows(attribute("WEIGHTS_0"));
                assert!(weights.iter().all(|w| (w.iter().sum::<f32>() * 255.0 - 255.0).abs() < 1e-3), "{name}");
                assert!(primitive["attributes"]["COLOR_0"].is_null(), "colours only where they are asked for");
            }
        }
        assert!(counts[0] <= 13_200 && counts.windows(2).all(|w| w[1] * 5 < w[0] * 4), "{name}: {counts:?}");
        assert!(counts.windows(2).all(|w| w[1] * 2 > w[0] / 4), "{name}: levels of about 1/4, 1/12, 1/60: {counts:?}");
        assert!(screens.windows(2).all(|w| w[1] < w[0]) && screens.last() == Some(&0.0), "{screens:?}");
        assert_eq!(list(json, "skins").len(), 1);
        assert!((8..=64).contains(&list(&json["skins"][0], "joints").len()));
        assert_eq!(list(json, "animations").len(), 1);
        // A coarse crown covers what the fine one does.
        let areas: Vec<f32> = levels.iter().map(|n| leaf_area(&player, &json["meshes"][index(&n["mesh"])])).collect();
        assert!(areas[0] > 0.1, "{name}: {areas:?}");
        assert!(areas[..3].iter().all(|a| (a / areas[0] - 1.0).abs() < 0.2), "{name}: {areas:?} m^2");
        let boxes: Vec<[Vec3; 2]> = levels
            .iter()
            .map(|n| bounds(&player.positions(player.node(n["name"].as_str().expect("name")).expect("node"), 0.0)))
            .collect();
        let size = (boxes[0][1] - boxes[0][0]).max_element();
        let off = |b: &[Vec3; 2]| (b[0] - boxes[0][0]).abs().max((b[1] - boxes[0][1]).abs()).max_element();
        assert!(boxes[..3].iter().all(|b| off(b) < 0.12 * size), "{name}: {boxes:?}");
    }
}

/// Pixels that triangles cover, seen level from `turn` of eight sides; a picture has `SIDE` pixels over `size` m.
fn covered(triangles: &[[Vec3; 3]], turn: u8, size: f32) -> usize {
    const SIDE: usize = 300;
    let (sin, cos) = (std::f64::consts::FRAC_PI_4 * f64::from(turn)).sin_cos();
    let (sin, cos) = (sin as f32, cos as f32);
    let scale = SIDE as f32 / size;
    let mut seen = vec![false; SIDE * SIDE];
    for triangle in triangles {
        let [a, b, c] =
            triangle.map(|p| glam::Vec2::new(p.x * cos + p.z * sin + 0.5 * size, p.y + 0.05 * size) * scale);
        let area = (b - a).perp_dot(c - a);
        let (low, high) = (a.min(b).min(c).max(glam::Vec2::ZERO), a.max(b).max(c));
        for y in low.y as usize..SIDE.min(high.y as usize + 1) {
            for x in low.x as usize..SIDE.min(high.x as usize + 1) {
                let p = glam::Vec2::new(x as f32 + 0.5, y as f32 + 0.5) - a;
                let (u, v) = ((b - a).perp_dot(p) / area, p.perp_dot(c - a) / area);
                seen[y * SIDE + x] |= u >= 0.0 && v >= 0.0 && u + v <= 1.0;
            }
        }
    }
    seen.iter().filter(|s| **s).count()
}

/// Levels of grown trees from eight sides against the finest one. Leaves of a coarser level are fewer and larger, so that they hide
/// less of each other: their outline is larger until they may not grow any further.
#[test]
fn levels_of_grown_trees_cover_what_the_finest_does() {
    let temp = tempfile::tempdir().expect("temp");
    // Least and greatest difference of area that was measured, with a tenth of room, for levels 1 to 3.
    for (species, marks) in [("birch", [[0.06, 0.11], [0.12, 0.205], [0.08, 0.235]])] {
        let scene = temp.path().join(format!("{species}.toml"));
        let text = format!(
            "[frames]\nend = 1\n[plants.t]\nspecies = \"{species}\"\nage = 12\n[plants.t.leaf]\nsize = 0.08\nside = 64\n\
             [plants.t.bark]\nside = 64\n[ground]\nshow = false\n[[place]]\nplant = \"t\"\n[output.gltf]\nprofiles = [\"engine\"]\n"
        );
        std::fs::write(&scene, text).expect("scene");
        let out = temp.path().join(species);
        let mut command = Command::new(env!("CARGO_BIN_EXE_osier"));
        clients::run(command.args(["-q", "bake"]).arg(&scene).arg("-o").arg(&out).args(["--formats", "glb"]));
        let player = player(&out.join("gltf/t.engine.glb"));
        let triangles = |level: usize| {
            let node = &player.json["nodes"][player.node(&format!("t_LOD{level}")).expect("a level")];
            let mut all = Vec::new();
            for primitive in list(&player.json["meshes"][index(&node["mesh"])], "primitives") {
                let points = player.vectors(index(&primitive["attributes"]["POSITION"]));
                let corners: Vec<f32> = player.rows(index(&primitive["indices"])).into_iter().flatten().collect();
                all.extend(corners.chunks(3).map(|c| [0, 1, 2].map(|k| points[c[k] as usize])));
            }
            all
        };
        let finest = triangles(0);
        let size = 2.0 * finest.iter().flatten().fold(0.0_f32, |m, p| m.max(p.abs().max_element()));
        let areas: Vec<usize> = (0..8).map(|turn| covered(&finest, turn, size)).collect();
        for (level, [least, most]) in (1..).zip(marks) {
            let coarse = triangles(level);
            let off = |turn: u8| covered(&coarse, turn, size) as f64 / areas[usize::from(turn)] as f64 - 1.0;
            let off: Vec<f64> = (0..8).map(off).collect();
            assert!(off.iter().all(|o| (least..=most).contains(o)), "{species}, level {level}: {off:.3?}");
        }
    }
}

/// The level with all triangles moves as the plant of the other profile does.
#[test]
fn the_finest_level_moves_as_the_blender_profile_does() {
    let temp = tempfile::tempdir().expect("temp");
    let all = ["output.gltf.triangles=9000000", "output.gltf.joints=256", "output.gltf.assets=true"];
    let engine = player(&bake(temp.path(), "engine", &all).join("silk.engine.glb"));
    let blender = player(&bake(temp.path(), "blender", &all).join("silk.blender.glb"));
    let joints = |p: &Player| list(&p.json["skins"][0], "joints").len();
    assert_eq!(joints(&engine), joints(&blender), "so few that no profile leaves any out");
    let level = engine.node("silk_LOD0").expect("level");
    for frame in [0, 3, 7] {
        let time = frame as f32 / 24.0;
        let there: Vec<Vec3> = engine.positions(level, time);
        let shown =
            blender.json["nodes"].as_array().expect("nodes").iter().enumerate().filter(|(_, n)| n["mesh"].is_u64());
        let wanted: Vec<Vec3> = shown.flat_map(|(i, _)| blender.positions(i, time)).collect();
        assert_eq!(there.len(), wanted.len(), "frame {frame}");
        // The order differs; each vertex has one of the other file where it is.
        let grid = NeighbourGrid::new(0.02, (0..).zip(wanted.iter().copied()));
        let nearest = |p: &Vec3| {
            grid.nearest(*p, 1.0, |i| wanted[i as usize]).map_or(f32::MAX, |i| wanted[i as usize].distance(*p))
        };
        let worst = there.iter().map(nearest).fold(0.0, f32::max);
        // Weights of bytes move a vertex by at most 1/255 of the way between its joints' transforms.
        assert!(worst < 2e-3, "frame {frame}: off by {worst} m");
        let centre = |list: &[Vec3]| list.iter().fold(Vec3::ZERO, |s, p| s + *p) / list.len() as f32;
        let moved = centre(&there).distance(centre(&wanted));
        assert!(moved < 2e-4, "frame {frame}: centres differ by {moved} m");
    }
    let (first, last) = (engine.positions(level, 0.0), engine.positions(level, 7.0 / 24.0));
    let way = first.iter().zip(&last).map(|(a, b)| a.distance(*b)).fold(0.0, f32::max);
    assert!(way > 0.01, "it moves: {way} m");
}

/// Of each channel of rotation the times of its keys, and its values at the first and the last one.
fn turns(player: &Player) -> Vec<(Vec<f32>, [glam::Vec4; 2])> {
    let animation = &player.json["animations"][0];
    let of = |c: &Value| {
        let sampler = &animation["samplers"][index(&c["sampler"])];
        let values = player.rows(index(&sampler["output"]));
        let [first, last] = [values.first(), values.last()].map(|v| glam::Vec4::from_slice(v.expect("a key")));
        (player.rows(index(&sampler["input"])).concat(), [first, last])
    };
    list(animation, "channels").iter().filter(|c| c["target"]["path"] == "rotation").map(of).collect()
}

#[test]
fn a_clip_that_loops_ends_as_it_begins() {
    let temp = tempfile::tempdir().expect("temp");
    // Copies of one individual are ahead of each other by different numbers of frames.
    for (profile, names) in [("engine", vec!["birch_1", "silk"]), ("web", vec!["grove"])] {
        let folder = bake(temp.path(), profile, &["frames.end=48"]);
        for name in names {
            let turns = turns(&player(&folder.join(format!("{name}.{profile}.glb"))));
            assert!(turns.len() > 10, "{profile}, {name}");
            for (times, [first, last]) in turns {
                assert_eq!((times.first(), times.last()), (Some(&0.0), Some(&2.0)), "{profile}, {name}");
                // A quaternion and its negative are one rotation.
                assert!(first.dot(last).abs() > 0.999_999, "{profile}, {name}: {first} {last}");
            }
        }
    }
    // Neither a clip that does not loop, nor frames for Blender, which repeats a range of them.
    for (profile, name, sets) in [("engine", "birch_1", "sway.repeat=false"), ("blender", "grove", "seed=1")] {
        let folder = bake(temp.path(), profile, &["frames.end=48", sets]);
        for (times, _) in turns(&player(&folder.join(format!("{name}.{profile}.glb")))) {
            assert_eq!(times.last(), Some(&(47.0 / 24.0)), "{profile}");
        }
    }
}

/// Leaves of one mesh, as `motion = "game"` has them, are thinned out as whole leaves with their stalks, each part with its material.
#[test]
fn merged_leaves_stay_whole() {
    let temp = tempfile::tempdir().expect("temp");
    let sets = ["frames.end=2", "plants.birch.motion=\"game\"", "output.gltf.triangles=8000"];
    let folder = bake(temp.path(), "engine", &sets);
    let player = player(&folder.join("birch_1.engine.glb"));
    let levels: Vec<&Value> =
        list(&player.json, "meshes").iter().filter(|m| m["extras"]["osier"].is_object()).collect();
    assert!(levels.len() >= 3, "{}", levels.len());
    let materials = |m: &Value| triangles(&player, m).iter().map(|t| t.0).collect::<Vec<_>>();
    assert!(levels.iter().all(|m| materials(m) == materials(levels[0])), "every level has every material");
    let areas: Vec<f32> = levels.iter().map(|m| leaf_area(&player, m)).collect();
    assert!(areas[..2].iter().all(|a| (a / areas[0] - 1.0).abs() < 0.2), "{areas:?} m^2");
    // A leaf is connected: its vertices lie within a few times its length, so that no triangle is longer.
    for mesh in &levels {
        for p in list(mesh, "primitives") {
            if player.json["materials"][index(&p["material"])]["doubleSided"] != true {
                continue;
            }
            let points = player.vectors(index(&p["attributes"]["POSITION"]));
            let corners: Vec<f32> = player.rows(index(&p["indices"])).into_iter().flatten().collect();
            let side = |c: &[f32]| points[c[0] as usize].distance(points[c[1] as usize]);
            assert!(corners.chunks(3).map(side).fold(0.0, f32::max) < 0.058 * 1.3 * 8.0);
        }
    }
}

#[test]
fn vertex_colours_hold_the_wind_of_each_preset() {
    let temp = tempfile::tempdir().expect("temp");
    let wanted = [
        ("unity", vec!["phase", "flutter", "zero", "light", "sway", "branch"]),
        ("godot", vec!["-sway", "sway", "zero", "one"]),
        ("crysis", vec!["flutter", "phase", "branch", "light"]),
        ("o3de", vec!["flutter", "phase", "branch", "light"]),
        ("unreal", vec!["flutter", "phase", "branch", "zero"]),
    ];
    for (preset, words) in wanted {
        let at = temp.path().join(preset);
        std::fs::create_dir(&at).expect("folder");
        let channels = format!("output.gltf.channels=[\"{preset}\"]");
        let folder = bake(&at, "engine", &[&channels, "output.gltf.triangles=12000", "frames.end=2"]);
        let player = player(&folder.join("birch_1.engine.glb"));
        let mesh = &player.json["meshes"][0];
        assert_eq!(mesh["extras"]["osier"]["channels"], serde_json::json!(words));
        for primitive in list(mesh, "primitives") {
            let colors = player.rows(index(&primitive["attributes"]["COLOR_0"]));
            assert_eq!(player.json["accessors"][index(&primitive["attributes"]["COLOR_0"])]["componentType"], 5121);
            let largest = |k: usize| colors.iter().map(|c| c[k]).fold(0.0_f32, f32::max);
            let leaves = player.json["materials"][index(&primitive["material"])]["doubleSided"] == true;
            let second = &primitive["attributes"]["TEXCOORD_1"];
            match preset {
                "unity" => {
                    assert_eq!(
                        (largest(2), largest(1) > 0.99),
                        (0.0, leaves),
                        "no blue; leaves flutter, wood does not"
                    );
                    let rows = player.rows(index(second));
                    // Half at the tip of the trunk, more on its branches, 0 at the root.
                    let sway = rows.iter().map(|r| r[0]).fold(0.0_f32, f32::max);
                    assert!((0.5..=1.0).contains(&sway), "{sway}");
                }
                "godot" => {
                    let sums = colors.iter().map(|c| c[0] + c[1]);
                    assert!(sums.into_iter().all(|s| (s - 1.0).abs() < 0.005), "red is 1 - green");
                    assert!(colors.iter().all(|c| c[2] < 1e-6 && c[3] > 0.999) && second.is_null());
                }
                _ => {
                    let alpha = if preset == "unreal" { 0.0 } else { 1.0 };
                    assert_eq!((largest(0) > 0.99, largest(3), second.is_null()), (leaves, alpha, true), "{preset}");
                }
            }
        }
    }
}

#[test]
fn the_table_places_what_the_scene_places() {
    let temp = tempfile::tempdir().expect("temp");
    let folder = bake(temp.path(), "engine", &["frames.end=2", "output.gltf.triangles=3000"]);
    let text = std::fs::read(folder.join("grove.engine.json")).expect("table");
    let table: Value = serde_json::from_slice(&text).expect("json");
    assert_eq!((&table["scene"], &table["fps"]), (&"grove".into(), &serde_json::json!([24, 1])));
    assert!(!folder.join("grove.engine.glb").exists(), "the scene is a table");
    let files = list(&table, "files");
    let copies = |name: &str| {
        let file = files.iter().find(|f| f["file"] == format!("{name}.engine.glb")).expect("listed");
        assert!(folder.join(file["file"].as_str().expect("name")).exists());
        let numbers =
            |c: &Value| c.as_array().expect("copy").iter().map(|n| n.as_f64().expect("number") as f32).collect();
        list(file, "copies").iter().map(numbers).collect::<Vec<Vec<f32>>>()
    };
    let birch = copies("birch_2");
    assert_eq!([birch.len(), copies("birch_1").len(), copies("silk").len(), copies("ground").len()], [1, 1, 3, 1]);
    let half = 20.0_f32.to_radians();
    let wanted = [5.0, 0.0, 2.0, 0.0, half.sin(), 0.0, half.cos(), 1.25];
    // The ground is uneven by a few millimetres.
    let difference = |k: usize| (birch[0][k] - wanted[k]).abs();
    assert!(difference(1) < 0.01, "{:?}", birch[0]);
    let off = [0, 2, 3, 4, 5, 6, 7].map(difference).into_iter().fold(0.0, f32::max);
    assert!(birch[0].len() == 8 && off < 1e-5, "{:?}", birch[0]);
}

#[test]
fn a_bake_for_engines_alone_says_where_its_files_are() {
    let temp = tempfile::tempdir().expect("temp");
    let out = temp.path().join("out");
    let mut command = Command::new(env!("CARGO_BIN_EXE_osier"));
    command.args(["bake", "struck-twig", "--formats", "glb", "--frames", "1"]).arg("-o").arg(&out);
    let said = clients::run(command.args(["--set", "output.gltf.profiles=[\"engine\"]"])).stdout;
    let said = String::from_utf8_lossy(&said);
    assert!(said.contains("  engines ") && said.contains("struck_twig.engine.json"), "{said}");
}

/// Godot before 4.1 takes a missing buffer view for the first one of the file, which its targets of growth must not become.
#[test]
fn targets_of_a_plant_that_grows_have_a_buffer_view_of_zeros() {
    let temp = tempfile::tempdir().expect("temp");
    let scene = temp.path().join("grown.toml");
    let text = "[frames]\nend = 24\n[plants.birch]\nspecies = \"birch\"\nage = 4\n[plants.birch.site]\nfrom = 1\nto = 3.6\n\
        [[place]]\nplant = \"birch\"\n[output.gltf]\nprofiles = [\"engine\"]\n";
    std::fs::write(&scene, text).expect("scene");
    let out = temp.path().join("out");
    let mut command = Command::new(env!("CARGO_BIN_EXE_osier"));
    clients::run(command.args(["-q", "bake"]).arg(&scene).args(["--formats", "glb"]).arg("-o").arg(&out));
    let file = out.join("gltf/birch.engine.glb");
    let json = player(&file).json;
    let (accessors, views) = (list(&json, "accessors"), list(&json, "bufferViews"));
    assert!(accessors.iter().all(|a| a["bufferView"].is_u64()), "an accessor without a view");
    let sparse: Vec<&Value> = accessors.iter().filter(|a| !a["sparse"].is_null()).collect();
    assert!(sparse.len() > 20, "{} sparse accessors", sparse.len());
    for accessor in sparse {
        let view = &views[index(&accessor["bufferView"])];
        assert_eq!(view["byteStride"], 12, "{view}");
        assert!(index(&view["byteLength"]) >= 12 * index(&accessor["count"]), "{view}");
    }
    let Some((node, folder)) = clients::validator() else { return };
    let out = clients::run(Command::new(node).arg(clients::script("gltf_validate.mjs")).arg(folder).arg(&file));
    let report: Value = serde_json::from_slice(&out.stdout).expect("json");
    assert_eq!((&report["errors"], &report["warnings"]), (&0.into(), &0.into()), "{report}");
}

#[test]
fn faulty_channels_are_refused() {
    let temp = tempfile::tempdir().expect("temp");
    let scene = temp.path().join("s.toml");
    for (channels, word) in [
        ("[\"sway\", \"zero\"]", "four words, or one preset"),
        ("[\"crysis\", \"zero\", \"zero\", \"zero\"]", "four words, or one preset"),
        ("[\"sways\"]", "did you mean"),
    ] {
        let text = format!("{SCENE}\n[output.gltf]\nprofiles = [\"engine\"]\nchannels = {channels}\n");
        std::fs::write(&scene, text).expect("scene");
        let run = Command::new(env!("CARGO_BIN_EXE_osier")).arg("check").arg(&scene).output().expect("osier runs");
        let said = String::from_utf8_lossy(&run.stderr);
        assert!(!run.status.success() && said.contains(word) && said.contains("s.toml:"), "{channels}: {said}");
    }
}

/// What both viewers would draw of a file, and what its JSON says.
#[test]
fn three_and_babylon_load_every_profile_with_the_same_counts() {
    let Some((node, modules)) = clients::babylon() else { return };
    let temp = tempfile::tempdir().expect("temp");
    let sets = ["frames.end=3", "output.gltf.triangles=6000", "output.gltf.channels=[\"unity\"]"];
    let mut files = Vec::new();
    let engine = bake(temp.path(), "engine", &sets);
    files.extend(["birch_2", "silk", "ground"].map(|n| engine.join(format!("{n}.engine.glb"))));
    let web = bake(temp.path(), "web", &["frames.end=3"]);
    files.push(web.join("grove.web.glb"));
    let small = temp.path().join("small");
    std::fs::create_dir(&small).expect("folder");
    files.push(bake(&small, "web", &["frames.end=3", "output.gltf.meshopt=true"]).join("grove.web.glb"));
    let mut command = Command::new(&node);
    let out = clients::run(command.arg(clients::script("gltf_counts.mjs")).arg(&modules).args(&files));
    let lines: Vec<Value> =
        String::from_utf8_lossy(&out.stdout).lines().map(|l| serde_json::from_str(l).expect("json")).collect();
    assert_eq!(lines.len(), files.len());
    for (line, file) in lines.iter().zip(&files) {
        let json = player(file).json;
        let count = |accessor: &Value| index(&json["accessors"][index(accessor)]["count"]);
        let (mut triangles, mut instances, mut skinned) = (0, 0, 0);
        for n in list(&json, "nodes").iter().filter(|n| n["mesh"].is_u64()) {
            let attributes = n.pointer("/extensions/EXT_mesh_gpu_instancing/attributes/TRANSLATION");
            let copies = attributes.map_or(1, count);
            let primitives = list(&json["meshes"][index(&n["mesh"])], "primitives");
            triangles += copies * primitives.iter().map(|p| count(&p["indices"]) / 3).sum::<usize>();
            instances += attributes.map_or(0, |a| count(a) * primitives.len());
            skinned += if n["skin"].is_u64() { primitives.len() } else { 0 };
        }
        let joints = list(&json, "skins").iter().map(|s| list(s, "joints").len()).max().unwrap_or(0);
        let colored = |p: &&Value| p["attributes"]["COLOR_0"].is_u64();
        let shown = list(&json, "nodes").iter().filter(|n| n["mesh"].is_u64());
        let channels: usize =
            shown.map(|n| list(&json["meshes"][index(&n["mesh"])], "primitives").iter().filter(colored).count()).sum();
        for reader in ["three", "babylon"] {
            let seen = |key: &str| index(&line[reader][key]);
            let got = ["triangles", "instances", "skinned", "joints", "channels"].map(seen);
            assert_eq!(got, [triangles, instances, skinned, joints, channels], "{reader}, {}", file.display());
        }
    }
    let sizes: Vec<u64> = files[3..].iter().map(|f| std::fs::metadata(f).expect("file").len()).collect();
    assert!(sizes[1] * 2 < sizes[0], "compressed {} of {} bytes", sizes[1], sizes[0]);
    let Some((node, folder)) = clients::validator() else { return };
    let out = clients::run(Command::new(node).arg(clients::script("gltf_validate.mjs")).arg(folder).args(&files));
    for line in String::from_utf8_lossy(&out.stdout).lines() {
        let report: Value = serde_json::from_str(line).expect("json");
        assert_eq!((&report["errors"], &report["warnings"]), (&0.into(), &0.into()), "{line}");
    }
}

#[test]
fn keys_of_profiles_that_are_not_written_are_told() {
    let dir = tempfile::tempdir().expect("dir");
    let file = dir.path().join("s.toml");
    let warned = |profiles: &str, key: &str| {
        let text = format!("[plants.a]\nspecies = \"birch\"\nage = 1\n[output.gltf]\nprofiles = [{profiles}]\n{key}\n");
        std::fs::write(&file, text).expect("scene");
        let run = Command::new(env!("CARGO_BIN_EXE_osier")).args(["check", file.to_str().expect("path")]).output();
        String::from_utf8_lossy(&run.expect("osier runs").stderr).into_owned()
    };
    for (key, profile) in [("leaves_mb = 5", "\"blender\""), ("assets = true", "\"web\""), ("skins = 2", "\"web\"")] {
        let name = key.split(' ').next().expect("name");
        let said = warned("\"engine\"", key);
        assert!(
            said.contains(&format!("warning[S007]: output.gltf.{name} ")) && said.contains(profile),
            "{key}: {said}"
        );
        let said = warned(&format!("\"engine\", {profile}"), key);
        assert!(!said.contains("S007"), "{key}: {said}");
    }
}
