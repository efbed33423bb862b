//! How large the files of a bake are, and what they lose for it.
#![allow(clippy::cast_possible_truncation, reason = "small test numbers")]
#![allow(clippy::expect_used, clippy::disallowed_methods, reason = "tests panic and look at the disk themselves")]

use crate::common::clients;
use crate::common::gltf_player::Player;
use crate::common::program::{arg, ends};
use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::Value;

/// Writes a scene and bakes it.
fn bake(folder: &Path, name: &str, scene: &str, sets: &[&str]) -> PathBuf {
    let file = folder.join(format!("{name}.toml"));
    std::fs::write(&file, scene).expect("scene");
    let out = folder.join(name);
    let mut arguments = vec!["-q", "bake", arg(&file), "-o", arg(&out)];
    arguments.extend(sets.iter().flat_map(|s| ["--set", s]));
    ends(0, &arguments);
    out
}

fn length(file: &Path) -> u64 {
    std::fs::metadata(file).expect("file").len()
}

const BIRCH: &str = r#"
[frames]
end = 16
fps = 24
[plants.birch]
grammar = "birch.l"
steps = 9
[plants.birch.leaf]
size = 0.06
[plants.birch.bark]
tile = 0.4
side = 512
[[place]]
plant = "birch"
[wind]
speed = 5
[ground]
show = false
[camera]
eye = [0, 2, 14]
target = [0, 2, 0]
vfov_deg = 40
[output]
formats = ["usd"]
"#;

#[test]
fn leaves_far_away_have_fewer_samples_and_are_where_they_were_to_a_pixel() {
    let Some(python) = clients::python() else { return };
    let temp = tempfile::tempdir().expect("temp");
    let all = bake(temp.path(), "all", BIRCH, &["output.usd.tolerance_mm=0", "output.usd.turn_tolerance_deg=0"]);
    let few = bake(temp.path(), "few", BIRCH, &[]);
    let near = bake(temp.path(), "near", BIRCH, &["camera.eye=[0, 2, 1]"]);
    let payload = |folder: &Path| folder.join("usd/birch.usdc");
    // A pixel of 1080 rows at 13 m from the camera; most of the crown is farther.
    let pixel = 2.0 * 13.0 * 20.0_f64.to_radians().tan() / 1080.0;
    let compare = |one: &Path| -> Value {
        let (one, other) = (payload(one), payload(&all));
        let output = clients::python_script(&python, "usd_reduction.py", &[arg(&one), arg(&other), &pixel.to_string()]);
        serde_json::from_slice(&output.stdout).expect("JSON")
    };
    let seen = compare(&few);
    let number = |v: &Value| v.as_f64().expect("a number");
    assert!(number(&seen["p99"]) < 1.3 && number(&seen["most"]) < 5.1, "{seen}");
    let [reduced, whole] = [0, 1].map(|k| number(&seen["samples"][k][0]));
    assert!((whole - 16.0).abs() < 0.5 && reduced <= 12.0, "{seen}");
    assert!(length(&payload(&few)) < length(&payload(&all)));
    // Weights are rounded, and sum to 1.
    assert!((number(&seen["weights"][0]) - 1.0).abs() < 1e-6 && (number(&seen["weights"][1]) - 1.0).abs() < 1e-6);
    // With the camera before the crown only the strict tolerances count.
    assert!(length(&payload(&near)) > length(&payload(&few)));
}

/// Width of a PNG file.
fn width(file: &Path) -> u32 {
    image::open(file).expect("a picture").width()
}

#[test]
fn textures_are_as_large_as_the_camera_sees_them() {
    let temp = tempfile::tempdir().expect("temp");
    let scene = BIRCH.replace("end = 16", "end = 1");
    let bark = |name: &str, sets: &[&str]| {
        let folder = bake(temp.path(), name, &scene, sets).join("textures");
        ["color", "normal", "rough", "height"].map(|map| width(&folder.join(format!("birch_bark_{map}.png"))))
    };
    assert_eq!(bark("far", &[]), [256; 4]);
    assert_eq!(bark("full", &["output.texels_per_pixel=0"]), [512; 4]);
    assert_eq!(bark("close", &["camera.eye=[0, 1, 0.3]"]), [512; 4]);
    // The colours stay.
    let mean = |name: &str| {
        let picture =
            image::open(temp.path().join(name).join("textures/birch_bark_color.png")).expect("a picture").to_rgb8();
        let sum: f64 = picture.pixels().map(|p| p.0.iter().map(|c| f64::from(*c)).sum::<f64>()).sum();
        sum / f64::from(picture.width() * picture.height() * 3)
    };
    assert!((mean("far") - mean("full")).abs() < 3.0, "{} {}", mean("far"), mean("full"));
}

/// Targets of the bark, the largest number of keys of its weights, and what the bake warned of.
fn growth(name: &str, profile: &str, sets: &[&str]) -> (usize, usize, String) {
    let temp = tempfile::tempdir().expect("temp");
    let file = temp.path().join(format!("{name}.toml"));
    let scene = "[frames]\nend = 60\n[plants.a]\nspecies = \"oak\"\nage = 14\n[plants.a.site]\nto = 14\nclip_leaves = \"summer\"\n\
         [plants.a.skin]\nsides = 3\n[[place]]\nplant = \"a\"\n[ground]\nshow = false\n[output]\nformats = [\"glb\"]\n";
    std::fs::write(&file, format!("{scene}[output.gltf]\nprofiles = [\"{profile}\"]\n")).expect("scene");
    let out = temp.path().join("out");
    let mut arguments = vec!["bake", arg(&file), "-o", arg(&out)];
    arguments.extend(sets.iter().flat_map(|s| ["--set", s]));
    let run = Command::new(env!("CARGO_BIN_EXE_osier")).args(&arguments).output().expect("osier runs");
    let said = String::from_utf8_lossy(&run.stderr).into_owned();
    assert!(run.status.success(), "{said}");
    let stem = if profile == "engine" { "a" } else { name };
    let json = Player::new(&std::fs::read(out.join(format!("gltf/{stem}.{profile}.glb"))).expect("file")).json;
    let list = |v: &Value, key: &str| v[key].as_array().cloned().unwrap_or_default();
    let targets =
        list(&json, "meshes").iter().flat_map(|m| list(m, "primitives")).map(|p| list(&p, "targets").len()).max();
    let animation = &json["animations"][0];
    let weights: Vec<Value> =
        list(animation, "channels").into_iter().filter(|c| c["target"]["path"] == "weights").collect();
    let keys = weights.iter().map(|c| {
        let sampler = &animation["samplers"][c["sampler"].as_u64().expect("sampler") as usize];
        json["accessors"][sampler["input"].as_u64().expect("input") as usize]["count"].as_u64().expect("count") as usize
    });
    (targets.unwrap_or(0), keys.max().unwrap_or(0), said)
}

#[test]
fn growth_is_in_gltf_of_every_profile() {
    for profile in ["web", "engine"] {
        let (targets, keys, said) = growth("s", profile, &[]);
        // One target hides what is not seen.
        assert!(targets >= 16 && keys + 1 >= targets, "{profile}: {targets} targets, {keys} keys");
        assert!(!said.contains("X017"), "{said}");
    }
}

/// Area of all meshes whose nodes' names have `part`, m^2, and number of their triangles that are seen, at a time, s.
fn area_of(player: &Player, part: &str, time: f32) -> (f32, usize) {
    let (mut area, mut seen) = (0.0, 0);
    for (k, node) in player.json["nodes"].as_array().expect("nodes").iter().enumerate() {
        if node["mesh"].is_null() || !node["name"].as_str().is_some_and(|name| name.contains(part)) {
            continue;
        }
        let points = player.positions(k, time);
        let mesh = &player.json["meshes"][node["mesh"].as_u64().expect("index") as usize];
        let mut base = 0;
        for primitive in mesh["primitives"].as_array().expect("primitives") {
            let index = |v: &Value| v.as_u64().expect("index") as usize;
            for t in player.rows(index(&primitive["indices"])).concat().chunks(3) {
                let [a, b, c] = [0, 1, 2].map(|i| points[base + t[i] as usize]);
                let triangle = 0.5 * (b - a).cross(c - a).length();
                area += triangle;
                seen += usize::from(triangle > 1e-9);
            }
            base += player.vectors(index(&primitive["attributes"]["POSITION"])).len();
        }
    }
    (area, seen)
}

#[test]
fn leaves_of_a_growing_tree_cover_in_gltf_what_they_cover() {
    let temp = tempfile::tempdir().expect("temp");
    let scene = "[frames]\nend = 41\n[plants.a]\nspecies = \"oak\"\nage = 16\n[plants.a.site]\nfrom = 2\nto = 16\n\
         clip_leaves = \"summer\"\n[[place]]\nplant = \"a\"\n[ground]\nshow = false\n[output]\nformats = [\"glb\"]\n";
    let player = |name: &str, sets: &[&str]| {
        let out = bake(temp.path(), name, scene, sets);
        Player::new(&std::fs::read(out.join(format!("gltf/{name}.blender.glb"))).expect("file"))
    };
    let profile = "output.gltf.profiles=[\"blender\"]";
    let clip = player("clip", &[profile]);
    for (frame, time) in [("11", 10.0 / 24.0), ("41", 40.0 / 24.0)] {
        // One frame has all leaves as they are.
        let still = player(&format!("still{frame}"), &[profile, &format!("output.gltf.frame={frame}")]);
        let (full, all) = area_of(&still, "leaf", 0.0);
        let (area, seen) = area_of(&clip, "leaves", time);
        assert!((area / full - 1.0).abs() < 0.15, "frame {frame}: {area} of {full} m^2, {seen} of {all} triangles");
        assert!(seen > 1000, "frame {frame}: {seen}");
    }
}

/// Growing trees of these species and ages, side by side, over so many frames.
fn growing(species: &[(&str, u32)], frames: u32, formats: &str) -> String {
    let plants: String = (0..)
        .zip(species)
        .map(|(k, (name, age))| {
            format!(
                "[plants.p{k}]\nspecies = \"{name}\"\nage = {age}\n[plants.p{k}.site]\nto = {age}\n\
                 clip_leaves = \"summer\"\n[[place]]\nplant = \"p{k}\"\nat = [{}, 0, 0]\n",
                5 * k
            )
        })
        .collect();
    format!("[frames]\nend = {frames}\n{plants}[ground]\nshow = false\n[output]\nformats = [{formats}]\n")
}

#[test]
#[ignore = "takes half a minute; tests/full.sh runs it"]
fn leaves_of_growing_trees_nearly_keep_their_area_between_frames() {
    let temp = tempfile::tempdir().expect("temp");
    for (name, species) in [("oak", &[("oak", 12)][..]), ("stand", &[("oak", 8), ("birch", 7)])] {
        let scene = growing(species, 41, "\"glb\"");
        let out = bake(temp.path(), name, &scene, &["output.gltf.profiles=[\"blender\"]"]);
        let clip = Player::new(&std::fs::read(out.join(format!("gltf/{name}.blender.glb"))).expect("file"));
        let nodes = clip.json["nodes"].as_array().expect("nodes");
        let is_leaves = |n: &Value| !n["mesh"].is_null() && n["name"].as_str().is_some_and(|n| n.contains("leaves"));
        let mut times: Vec<f32> = (0..nodes.len())
            .filter(|k| is_leaves(&nodes[*k]))
            .flat_map(|k| clip.key_times(k, "weights"))
            .filter(|time| (time * 24.0 - (time * 24.0).round()).abs() < 1e-3)
            .collect();
        times.sort_by(f32::total_cmp);
        times.dedup();
        // Every frame is a shape.
        assert_eq!(times.len(), 41, "{name}: {times:?}");
        let area = |time: f32| area_of(&clip, "leaves", time).0;
        for pair in times.windows(2).skip(5) {
            let (before, after) = (area(pair[0]), area(pair[1]));
            for share in [0.1, 0.3, 0.5, 0.7, 0.9] {
                let between = area(pair[0] + share * (pair[1] - pair[0]));
                // Where leaves give way to others between two frames, the ones shrink while the others grow.
                let (least, most) = (before.min(after), before.max(after));
                assert!(
                    between > 0.75 * least && between < 1.01 * most,
                    "{name}: {before} m^2 at {} s, {between} at {share} of the way, then {after}",
                    pair[0]
                );
            }
        }
    }
}

/// Bytes of the files below a folder.
fn bytes_in(folder: &Path) -> u64 {
    let entries = std::fs::read_dir(folder).expect("folder").flatten();
    entries.map(|e| if e.path().is_dir() { bytes_in(&e.path()) } else { length(&e.path()) }).sum()
}

#[test]
#[ignore = "takes half a minute; tests/full.sh runs it"]
fn the_predicted_size_of_growth_in_usd_is_near_that_of_its_files() {
    let temp = tempfile::tempdir().expect("temp");
    let oak = growing(&[("oak", 12)], 40, "\"usd\"");
    let strict = "[output.usd]\ntolerance_mm = 0\nturn_tolerance_deg = 0\n";
    for (name, scene) in [
        ("oak", oak.clone()),
        ("near", format!("{oak}[camera]\neye = [0, 1.5, 4]\ntarget = [0, 2, 0]\n")),
        ("strict", format!("{oak}{strict}")),
        ("seasons", oak.replace("summer", "seasons").replace("end = 40", "end = 100")),
        ("stand", growing(&[("spruce", 10), ("birch", 8), ("hazel", 6)], 30, "\"usd\"")),
        ("short", growing(&[("beech", 10)], 12, "\"usd\"")),
    ] {
        let file = temp.path().join(format!("{name}.toml"));
        std::fs::write(&file, scene).expect("scene");
        is_near_its_prediction(&temp.path().join(name), arg(&file), &[]);
    }
    // A plant of a grammar, whose nodes have times of birth.
    is_near_its_prediction(&temp.path().join("vine"), "vine", &["--set", "frames.end=40"]);
}

/// A year of the leaves of a tree, whose looks are instances of their own: only the visibility of most of them changes.
#[test]
fn the_predicted_size_of_a_year_in_usd_is_near_that_of_its_files() {
    let temp = tempfile::tempdir().expect("temp");
    let scene =
        "[frames]\nend = 24\n[plants.a]\nspecies = \"birch\"\nage = 10\nseason = [0, 1]\n[ground]\nshow = false\n";
    let file = temp.path().join("year.toml");
    std::fs::write(&file, scene).expect("scene");
    is_near_its_prediction(&temp.path().join("year"), arg(&file), &[]);
}

/// Bakes a scene as USD, and fails unless the payloads are within a factor of 1.4 of what a dry run predicts.
fn is_near_its_prediction(out: &Path, scene: &str, more: &[&str]) {
    let arguments = [&["-q", "bake", scene, "--formats", "usd", "-o", arg(out)][..], more].concat();
    let (told, _) = ends(0, &[&arguments[..], &["-n", "--json"]].concat());
    let told: Value = serde_json::from_str(&told).expect("JSON");
    let predicted = told["would_make"]["sizes"]["usd"].as_f64().expect("bytes");
    ends(0, &arguments);
    let written = bytes_in(&out.join("usd")) as f64;
    assert!((1.0 / 1.4..1.4).contains(&(predicted / written)), "{}: {predicted} of {written} bytes", out.display());
}

/// Bytes of a format that a dry run predicts, divided by those of the files in its folder.
fn predicted_share(out: &Path, scene: &Path, [format, folder]: [&str; 2]) -> f64 {
    let arguments = ["-q", "bake", arg(scene), "-o", arg(out)];
    let (told, _) = ends(0, &[&arguments[..], &["-n", "--json"]].concat());
    let told: Value = serde_json::from_str(&told).expect("JSON");
    ends(0, &arguments);
    told["would_make"]["sizes"][format].as_f64().expect("bytes") / bytes_in(&out.join(folder)) as f64
}

/// Trees at rest, leaves in a light, a fresh and a strong wind, and the leaves of many copies in glTF.
#[test]
fn the_predicted_size_of_trees_at_rest_and_in_the_wind_is_near_that_of_their_files() {
    let temp = tempfile::tempdir().expect("temp");
    let tree = "[plants.a]\nspecies = \"birch\"\nage = 10\n[[place]]\nplant = \"a\"\n[ground]\nshow = false\n";
    let usd = "[output]\nformats = [\"usd\"]\n";
    let sway = |speed: u32| format!("[frames]\nend = 24\n[wind]\nspeed = {speed}\n{tree}{usd}");
    let copies = tree.replace("plant = \"a\"\n", "plant = \"a\"\ncount = 30\nradius = 30\nindividuals = 2\n");
    let web = format!("{copies}[output]\nformats = [\"glb\"]\n[output.gltf]\nprofiles = [\"web\"]\n");
    for (name, scene, format) in [
        ("still", format!("{tree}{usd}"), ["usd", "usd"]),
        ("light", sway(2), ["usd", "usd"]),
        ("fresh", sway(5), ["usd", "usd"]),
        ("strong", sway(12), ["usd", "usd"]),
        ("floats", format!("{web}quantize = false\n"), ["glb", "gltf"]),
        ("meshopt", format!("{web}meshopt = true\n"), ["glb", "gltf"]),
        ("unreal", format!("{tree}[output]\nformats = [\"unreal\"]\n"), ["unreal", "unreal"]),
        // Of thirty that sway ten have skins; the others stand.
        ("skins", format!("[frames]\nend = 6\n[wind]\nspeed = 5\n{web}skins = 10\n"), ["glb", "gltf"]),
        ("web", web, ["glb", "gltf"]),
    ] {
        let file = temp.path().join(format!("{name}.toml"));
        std::fs::write(&file, scene).expect("scene");
        let share = predicted_share(&temp.path().join(name), &file, format);
        assert!((0.87..1.15).contains(&share), "{name}: {share}");
    }
}

#[test]
fn the_predicted_size_of_clouds_is_near_that_of_their_files() {
    let temp = tempfile::tempdir().expect("temp");
    let still = "[clouds.a]\nifs = \"fern_leaf.ifs\"\npoints = 50000\n[ground]\nshow = false\n";
    let moving = "[frames]\nend = 12\n[clouds.a]\npoints = 4000\n[clouds.a.morph]\n\
         key = [{ ifs = \"fern_bud.ifs.toml\", at = 0 }, { ifs = \"fern_half.ifs.toml\", at = 0.5 }]\n[ground]\nshow = false\n";
    for (name, scene, format) in
        [("usd", still, ["usd", "usd"]), ("glb", still, ["glb", "gltf"]), ("moving", moving, ["usd", "usd"])]
    {
        let file = temp.path().join(format!("{name}.toml"));
        std::fs::write(&file, format!("{scene}[output]\nformats = [\"{}\"]\n", format[0])).expect("scene");
        let share = predicted_share(&temp.path().join(name), &file, format);
        assert!((0.8..1.25).contains(&share), "{name}: {share}");
    }
}

/// Catkins of the sky fly from the first frame on; those that a rain of catkins releases later are in no file at rest.
#[test]
fn the_predicted_size_of_catkins_counts_those_that_files_have() {
    let temp = tempfile::tempdir().expect("temp");
    let scene = |release: &str, format: &str| {
        format!(
            "[frames]\nend = 24\n[catkin]\nhairs = 40\nlod = 2\n[flight]\ncount = 60\nrelease = \"{release}\"\n[wind]\nspeed = 2\n\
             [ground]\nshow = false\n[output]\nformats = [\"{format}\"]\n"
        )
    };
    for format in [["obj", "obj"], ["ply", "cloud"]] {
        let file = temp.path().join(format!("{}.toml", format[0]));
        std::fs::write(&file, scene("sky", format[0])).expect("scene");
        let share = predicted_share(&temp.path().join(format[0]), &file, format);
        assert!((0.75..1.34).contains(&share), "{format:?}: {share}");
    }
    // In USD hairs are curves, which counted as triangles, and what flies has a point twin.
    let flown = scene("sky", "usd").replace("count = 60", "count = 600");
    let hairy = scene("sky", "usd").replace("lod = 2\n", "smooth = 7\n").replace("hairs = 40", "hairs = 700");
    for (name, text) in [("flown", flown), ("hairy", hairy)] {
        let file = temp.path().join(format!("{name}.toml"));
        std::fs::write(&file, text).expect("scene");
        let share = predicted_share(&temp.path().join(name), &file, ["usd", "usd"]);
        assert!((0.77..1.3).contains(&share), "{name}: {share}");
    }
    let file = temp.path().join("rain.toml");
    std::fs::write(&file, scene("rain", "obj")).expect("scene");
    let (told, _) = ends(0, &["-q", "bake", arg(&file), "-n", "--json"]);
    let told: Value = serde_json::from_str(&told).expect("JSON");
    assert_eq!(told["would_make"]["sizes"]["obj"], 0, "{told:#}");
}

#[test]
fn leaves_of_a_growing_tree_have_shapes_at_the_frames_that_are_written() {
    let temp = tempfile::tempdir().expect("temp");
    let scene = "[frames]\nend = 201\n[plants.a]\nspecies = \"oak\"\nage = 14\n[plants.a.site]\nto = 14\nclip_leaves = \"summer\"\n\
         [plants.a.skin]\nsides = 3\n[[place]]\nplant = \"a\"\n[ground]\nshow = false\n[output]\nformats = [\"glb\"]\n\
         [output.gltf]\nprofiles = [\"web\"]\nnodes = 20\n";
    let file = temp.path().join("s.toml");
    std::fs::write(&file, scene).expect("scene");
    let out = temp.path().join("out");
    ends(0, &["-q", "bake", arg(&file), "--frames", "1-201:10", "-o", arg(&out)]);
    let player = Player::new(&std::fs::read(out.join("gltf/s.web.glb")).expect("file"));
    let index = |v: &Value| v.as_u64().expect("index") as usize;
    let animation = &player.json["animations"][0];
    let mut times: Vec<f32> = Vec::new();
    for channel in animation["channels"].as_array().expect("channels") {
        let name = player.json["nodes"][index(&channel["target"]["node"])]["name"].as_str().unwrap_or_default();
        if channel["target"]["path"] == "weights" && name.contains("leaves") {
            let sampler = &animation["samplers"][index(&channel["sampler"])];
            times.extend(player.rows(index(&sampler["input"])).concat());
        }
    }
    // Every tenth frame of the clip has its own shape: there are fewer than a plant may have. Keys between them are those of areas.
    for shape in 0..21 {
        let at = (shape * 10) as f32 / 24.0;
        assert!(times.iter().any(|t| (t - at).abs() < 1e-4), "no shape at {at} s");
    }
}

#[test]
fn the_height_maps_of_many_individuals_are_predicted() {
    let temp = tempfile::tempdir().expect("temp");
    let file = temp.path().join("m.toml");
    // All individuals of a plant share its materials.
    let scene = "[plants.a]\ngrammar = \"grass.l\"\nsteps = 3\n[[place]]\nplant = \"a\"\ncount = 40\nradius = 9\nindividuals = 40\n\
         [terrain]\nsubdivisions = 6\n[output]\nformats = [\"exr\"]\n";
    std::fs::write(&file, scene).expect("scene");
    let (said, _) = ends(0, &["bake", arg(&file), "-n", "--json"]);
    let predicted: Value = serde_json::from_str(&said).expect("JSON");
    let out = temp.path().join("out");
    ends(0, &["-q", "bake", arg(&file), "-o", arg(&out)]);
    let written: u64 = crate::common::program::tree(&out.join("maps")).values().map(|bytes| bytes.len() as u64).sum();
    let share = predicted["would_make"]["sizes"]["exr"].as_f64().expect("bytes") / written as f64;
    assert!((0.7..1.4).contains(&share), "{share} of {written} bytes");
}

/// Ground of fine texels, coarse bark, leaves, and maps of catkins at rest beside no other map.
#[test]
fn textures_and_maps_of_presets_are_predicted() {
    let temp = tempfile::tempdir().expect("temp");
    let seeds = "[frames]\nend = 12\n[ground]\nshow = false\n[catkin]\nhairs = 20\nlod = 2\n[flight]\ncount = 100\nsize = [6, 4, 6]\n\
                 band = [0.02, 0.7]\nspin_up_s = 4\nmap_every = 4\n[wind]\nspeed = 1\n[output]\nformats = [\"exr\"]\n";
    let file = temp.path().join("seeds.toml");
    std::fs::write(&file, seeds).expect("scene");
    for (scene, part, folder) in [
        ("moss", "pictures", "textures"),
        ("birch", "pictures", "textures"),
        ("rain-twig", "pictures", "textures"),
        ("moss", "exr", "maps"),
        (arg(&file), "exr", "maps"),
    ] {
        let out = temp.path().join("out");
        let formats = if part == "exr" { "exr" } else { "obj" };
        let flags = ["bake", scene, "--formats", formats, "--force", "-o", arg(&out)];
        let (said, _) = ends(0, &[&flags[..], &["-n", "--json"]].concat());
        let predicted: Value = serde_json::from_str(&said).expect("JSON");
        ends(0, &[&["-q"], &flags[..]].concat());
        let files = crate::common::program::tree(&out.join(folder));
        let written: u64 = files.values().map(|bytes| bytes.len() as u64).sum();
        let share = predicted["would_make"]["sizes"][part].as_f64().expect("bytes") / written as f64;
        assert!((1.0 / 1.2..1.2).contains(&share), "{scene}: {share} of {written} bytes of {part}");
        std::fs::remove_dir_all(&out).expect("a folder");
    }
}

/// Maps of leaves with a relief, and of leaves with drops alone.
#[test]
fn maps_of_leaves_in_rain_are_predicted() {
    let temp = tempfile::tempdir().expect("temp");
    for (scene, frames, most) in [("wet-leaf", "frames.end=12", 1.1), ("rain-table-1", "frames.end=24", 1.35)] {
        let out = temp.path().join(scene);
        let flags = ["-q", "bake", scene, "--set", frames, "--formats", "exr", "-o", arg(&out)];
        let (told, _) = ends(0, &[&flags[..], &["-n", "--json"]].concat());
        let told: Value = serde_json::from_str(&told).expect("JSON");
        ends(0, &flags);
        let share = told["would_make"]["sizes"]["exr"].as_f64().expect("bytes") / bytes_in(&out.join("maps")) as f64;
        assert!((1.0 / most..most).contains(&share), "{scene}: {share}");
    }
}

/// PLY has a file for each frame with the leaves that the plant has by then.
#[test]
fn the_leaves_of_a_growing_plant_in_ply_are_predicted() {
    let temp = tempfile::tempdir().expect("temp");
    let out = temp.path().join("out");
    let flags = ["-q", "bake", "vine", "--set", "frames.end=40", "--formats", "ply", "-o", arg(&out)];
    let (told, _) = ends(0, &[&flags[..], &["-n", "--json"]].concat());
    let told: Value = serde_json::from_str(&told).expect("JSON");
    ends(0, &flags);
    let share = told["would_make"]["sizes"]["ply"].as_f64().expect("bytes") / bytes_in(&out.join("cloud")) as f64;
    assert!((0.85..1.15).contains(&share), "{share}");
}

/// Drops on leaves near the camera, in a clip and in a still scene.
#[test]
fn drops_on_leaves_are_predicted() {
    let temp = tempfile::tempdir().expect("temp");
    for (frames, format, folder) in
        [("frames.end=24", "usd", "usd"), ("frames.end=24", "pov", "pov"), ("frames.end=1", "obj", "obj")]
    {
        let out = temp.path().join(format);
        let flags = ["-q", "bake", "rain-table-1", "--set", frames, "--formats", format, "-o", arg(&out)];
        let (told, _) = ends(0, &[&flags[..], &["-n", "--json"]].concat());
        let told: Value = serde_json::from_str(&told).expect("JSON");
        ends(0, &flags);
        // The prediction for POV-Ray holds the maps of leaves, which are beside its files.
        let maps = if format == "pov" { bytes_in(&out.join("maps")) } else { 0 };
        let written = (bytes_in(&out.join(folder)) + maps) as f64;
        let share = told["would_make"]["sizes"][format].as_f64().expect("bytes") / written;
        // The number of drops is a guess from the area of the leaves.
        assert!((0.5..1.5).contains(&share), "{format}: {share} of {written} bytes");
    }
}

#[test]
fn the_joints_of_all_copies_are_predicted() {
    let temp = tempfile::tempdir().expect("temp");
    let file = temp.path().join("j.toml");
    let scene = "[frames]\nend = 4\n[plants.a]\ngrammar = \"birch.l\"\nsteps = 8\n[[place]]\nplant = \"a\"\ncount = 60\nradius = 50\n\
         individuals = 1\n[wind]\nspeed = 3\n[ground]\nshow = false\n[output]\nformats = [\"tracks\", \"points\"]\n";
    std::fs::write(&file, scene).expect("scene");
    let (said, _) = ends(0, &["bake", arg(&file), "-n", "--json"]);
    let predicted: Value = serde_json::from_str(&said).expect("JSON");
    let out = temp.path().join("out");
    ends(0, &["-q", "bake", arg(&file), "-o", arg(&out)]);
    for format in ["tracks", "points"] {
        let files = crate::common::program::tree(&out.join(format));
        let written = files.values().map(|bytes| bytes.len() as f64).sum::<f64>();
        let share = predicted["would_make"]["sizes"][format].as_f64().expect("bytes") / written;
        assert!((0.7..1.4).contains(&share), "{format}: {share} of {written} bytes");
    }
}

#[test]
fn the_points_of_a_growing_plant_are_predicted() {
    let temp = tempfile::tempdir().expect("temp");
    let file = temp.path().join("g.toml");
    let scene = "[frames]\nend = 9\n[plants.a]\ngrammar = \"birch.l\"\nsteps = 9\ngrowth_clip = [0, 1]\n[[place]]\nplant = \"a\"\n\
         [ground]\nshow = false\n[output]\nformats = [\"pc2\", \"pov\"]\n";
    std::fs::write(&file, scene).expect("scene");
    let predicted = |step: u32, format: &str| {
        let set = format!("output.pov.step={step}");
        let (out, _) = ends(0, &["bake", arg(&file), "-n", "--json", "--set", &set]);
        let json: Value = serde_json::from_str(&out).expect("JSON");
        json["would_make"]["sizes"][format].as_f64().expect("bytes")
    };
    let out = temp.path().join("out");
    ends(0, &["-q", "bake", arg(&file), "-o", arg(&out)]);
    let written = |folder: &str| {
        let files = crate::common::program::tree(&out.join(folder));
        files.values().map(|bytes| bytes.len() as f64).sum::<f64>()
    };
    for (format, folder) in [("pc2", "cache"), ("pov", "pov")] {
        let share = predicted(1, format) / written(folder);
        assert!((0.7..1.4).contains(&share), "{format}: {share}");
    }
    // Of nine frames every fourth are three, every ninth and every twentieth are the first alone.
    let [one, four, nine, twenty] = [1, 4, 9, 20].map(|step| predicted(step, "pov"));
    assert!(
        (one - nine - 4.0 * (four - nine)).abs() < 0.5 && (nine - twenty).abs() < 0.5,
        "{one} {four} {nine} {twenty}"
    );
}

#[test]
fn the_leaves_of_a_growing_tree_are_predicted() {
    let temp = tempfile::tempdir().expect("temp");
    let file = temp.path().join("o.toml");
    let scene = "[frames]\nend = 24\n[plants.a]\nspecies = \"oak\"\nage = 14\n[plants.a.site]\nto = 14\nclip_leaves = \"summer\"\n\
         [plants.a.skin]\nsides = 3\n[[place]]\nplant = \"a\"\n[ground]\nshow = false\n[output]\nformats = [\"usd\"]\n";
    std::fs::write(&file, scene).expect("scene");
    let (said, _) = ends(0, &["bake", arg(&file), "-n", "--json"]);
    let predicted: Value = serde_json::from_str(&said).expect("JSON");
    let out = temp.path().join("out");
    ends(0, &["-q", "bake", arg(&file), "-o", arg(&out)]);
    let written = crate::common::program::tree(&out.join("usd")).values().map(|bytes| bytes.len() as f64).sum::<f64>();
    let share = predicted["would_make"]["sizes"]["usd"].as_f64().expect("bytes") / written;
    assert!((0.7..1.4).contains(&share), "{share} of {written} bytes");
}

/// Leaves that come during the clip, and the geometry that is written once.
#[test]
fn the_lines_of_a_growing_tree_for_pov_ray_are_predicted() {
    let temp = tempfile::tempdir().expect("temp");
    for (species, age, from, frames) in [("oak", 12, 6, 8), ("birch", 14, 2, 20)] {
        let (file, out) = (temp.path().join(format!("{species}.toml")), temp.path().join(species));
        let scene = format!(
            "[frames]\nend = {frames}\n[plants.a]\nspecies = \"{species}\"\nage = {age}\n[plants.a.site]\nfrom = {from}\n\
             [[place]]\nplant = \"a\"\n[ground]\nshow = false\n[output]\nformats = [\"pov\"]\n"
        );
        std::fs::write(&file, scene).expect("scene");
        let (said, _) = ends(0, &["bake", arg(&file), "-n", "--json"]);
        let predicted: Value = serde_json::from_str(&said).expect("JSON");
        ends(0, &["-q", "bake", arg(&file), "-o", arg(&out)]);
        let files = crate::common::program::tree(&out.join("pov"));
        let written = files.values().map(|bytes| bytes.len() as f64).sum::<f64>();
        let share = predicted["would_make"]["sizes"]["pov"].as_f64().expect("bytes") / written;
        assert!((0.75..1.33).contains(&share), "{species}: {share} of {written} bytes");
    }
}

#[test]
#[ignore = "takes half a minute; tests/full.sh runs it"]
fn a_swaying_oak_of_sixty_years_is_four_megabytes_for_engines() {
    let temp = tempfile::tempdir().expect("temp");
    let scene = "[frames]\nend = 8\n[plants.oak]\nspecies = \"oak\"\nage = 60\n[[place]]\nplant = \"oak\"\n[wind]\nspeed = 5\n\
         [ground]\nshow = false\n[output]\nformats = [\"glb\"]\n[output.gltf]\nprofiles = [\"engine\"]\n";
    let file = bake(temp.path(), "grove", scene, &[]).join("gltf/oak.engine.glb");
    assert!(length(&file) <= 4_000_000, "{} bytes", length(&file));
    let json = Player::new(&std::fs::read(&file).expect("file")).json;
    assert!(json["extensionsRequired"].is_null());
    let levels = json["meshes"].as_array().expect("meshes");
    assert_eq!(levels.len(), 4);
    let mut triangles = 0;
    for level in levels {
        let extras = &level["extras"]["osier"];
        let number = |key: &str| extras[key].as_f64().expect("a number");
        assert!(number("plant_triangles") > 100_000.0 && (1.0..=8.0).contains(&number("leaf_size")), "{extras}");
        triangles += extras["triangles"].as_u64().expect("triangles");
    }
    // Both viewers draw all levels, with the skin and its joints.
    let Some((node, modules)) = clients::babylon() else { return };
    let mut command = Command::new(&node);
    let out = clients::run(command.arg(clients::script("gltf_counts.mjs")).arg(&modules).arg(&file));
    let line: Value = serde_json::from_slice(&out.stdout).expect("JSON");
    for reader in ["three", "babylon"] {
        assert_eq!(
            (line[reader]["triangles"].as_u64(), line[reader]["joints"].as_u64()),
            (Some(triangles), Some(64)),
            "{line}"
        );
    }
    let Some((node, folder)) = clients::validator() else { return };
    let out = clients::run(Command::new(node).arg(clients::script("gltf_validate.mjs")).arg(folder).arg(&file));
    let report: Value = serde_json::from_slice(&out.stdout).expect("JSON");
    assert_eq!((&report["errors"], &report["warnings"]), (&0.into(), &0.into()), "{report}");
}

/// The leaves of a tree in one file for Blender, which merges them: area, m^2, triangles, bytes of the file, and what was said.
fn merged_leaves(folder: &Path, leaves_mb: u32) -> (f32, usize, u64, String) {
    let file = folder.join(format!("oak_{leaves_mb}.glb"));
    let key = format!("output.gltf.leaves_mb={leaves_mb}");
    let arguments = ["grow", "oak-grown", "--set", "plants.oak.age=12", "--set", &key, "-o", arg(&file)];
    let run = Command::new(env!("CARGO_BIN_EXE_osier")).args(arguments).output().expect("osier runs");
    let said = String::from_utf8_lossy(&run.stderr).into_owned();
    assert!(run.status.success(), "{said}");
    let player = Player::new(&std::fs::read(&file).expect("file"));
    let (area, triangles) = area_of(&player, "leaves", 0.0);
    (area, triangles, length(&file), said)
}

#[test]
fn merged_leaves_keep_to_the_size_that_a_scene_allows() {
    let temp = tempfile::tempdir().expect("temp");
    let (area, triangles, bytes, said) = merged_leaves(temp.path(), 160);
    assert!(!said.contains("X029"), "{said}");
    let (light_area, light_triangles, light_bytes, said) = merged_leaves(temp.path(), 4);
    assert!(said.contains("X029") && said.contains("instead of"), "{said}");
    let saved = (bytes - light_bytes) as f64 / 1e6;
    let all = saved + 4.0;
    // What is left of the leaves takes 4 MB, and covers the area of all of them.
    assert!(all > 20.0 && light_triangles * 5 < triangles, "{saved} MB, {light_triangles} of {triangles}");
    let told =
        said.split(" MB instead of ").next().and_then(|s| s.rsplit(' ').next()).and_then(|s| s.parse::<f64>().ok());
    assert!(told.is_some_and(|mb| (2.0..=4.0).contains(&mb)), "{said}");
    assert!((light_area / area - 1.0).abs() < 0.15, "{light_area} of {area} m2");
}

#[test]
fn a_file_of_single_leaves_is_refused_with_a_smaller_format() {
    let temp = tempfile::tempdir().expect("temp");
    let file = temp.path().join("oak.obj");
    let (_, said) = ends(2, &["grow", "oak-grown", "-o", arg(&file)]);
    assert!(said.contains("more than 2.0 GB") && said.contains(".usdc") && said.contains("--force"), "{said}");
    assert!(!file.exists());
}

/// A closed tube of 3 m with texture coordinates, as an OBJ whose material is `bark`.
fn textured_tube() -> String {
    const SIDES: usize = 6;
    const RINGS: usize = 9;
    let mut text = "mtllib tree.mtl\nusemtl bark\n".to_owned();
    for i in 0..RINGS * SIDES {
        let (ring, angle) = (i / SIDES, std::f32::consts::TAU * (i % SIDES) as f32 / SIDES as f32);
        let height = 3.0 * ring as f32 / (RINGS - 1) as f32;
        text += &format!("v {} {height} {}\n", 0.1 * angle.cos(), 0.1 * angle.sin());
        text += &format!("vt {} {height}\n", (i % SIDES) as f32 / SIDES as f32);
    }
    let face = |corners: &[usize]| {
        let words: Vec<String> = corners.iter().map(|c| format!("{0}/{0}", c + 1)).collect();
        format!("f {}\n", words.join(" "))
    };
    for i in 0..(RINGS - 1) * SIDES {
        let next = i / SIDES * SIDES + (i + 1) % SIDES;
        text += &face(&[i, i + SIDES, next + SIDES, next]);
    }
    let top = (RINGS - 1) * SIDES;
    text + &face(&(0..SIDES).collect::<Vec<_>>()) + &face(&(top..top + SIDES).rev().collect::<Vec<_>>())
}

/// Pictures of a file keep their size in a prediction, whatever the key `side` of painted bark is.
#[test]
fn pictures_of_files_are_predicted_in_their_own_size() {
    let temp = tempfile::tempdir().expect("temp");
    let folder = temp.path();
    image::RgbImage::new(64, 64).save(folder.join("bark.png")).expect("picture");
    std::fs::write(folder.join("tree.obj"), textured_tube()).expect("tree");
    std::fs::write(folder.join("tree.mtl"), "newmtl bark\nKd 1 1 1\nmap_Kd bark.png\n").expect("materials");
    let grown = "species = \"birch\"\nage = 8\nshoot.side = 16\nleaf.side = 16\nbark.texture = \"bark.png\"\n";
    for (name, plant) in [("mesh", "mesh = \"tree.obj\"\n"), ("bark", grown)] {
        let file = folder.join(format!("{name}.toml"));
        std::fs::write(&file, format!("[ground]\nshow = false\n[plants.t]\n{plant}")).expect("scene");
        let (told, _) = ends(0, &["-q", "bake", arg(&file), "-o", arg(&folder.join(name)), "-n", "--json"]);
        let told: Value = serde_json::from_str(&told).expect("JSON");
        let bytes = told["would_make"]["memory"]["pictures"].as_u64().expect("bytes");
        // The samples of the picture, and a few times as much to encode it.
        assert!((64 * 64 * 3..64 * 64 * 3 * 20).contains(&bytes), "{name}: {bytes} bytes");
    }
}
