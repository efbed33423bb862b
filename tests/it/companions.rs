//! Companion files of grammars: small models with results worked out by hand, colours in every format, files that must not be read.
#![allow(clippy::expect_used, clippy::disallowed_methods, reason = "a test fails by panicking and looks at files")]

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

use glam::Vec3;

use crate::common::grown::{individuals, stage};
use crate::common::program::{arg, ends, run, said};
use osier::bake::scene::SceneOptions;
use osier::grow::turtle::Paint;
use osier::plant::{PAINTED, Plant};
use osier::recipe::{Recipe, resolve};
use osier::source::{SourceOptions, find_scene};

/// The models, beside the files that they name.
fn models() -> &'static Path {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/grammars/cpfg"))
}

/// A map with a different colour for each index.
fn color_map() -> Vec<u8> {
    (0..=255_u8).flat_map(|i| [i, 255 - i, i.wrapping_mul(37)]).collect()
}

fn load(file: &Path) -> (Recipe, Vec<&'static str>) {
    // A small bark is drawn quickly; a plant with a colour file has none.
    let is_colored = file.with_extension("map").exists();
    let set = if is_colored { Vec::new() } else { vec!["bark.side=16".into()] };
    let options = SourceOptions { set, ..SourceOptions::default() };
    let request = find_scene(arg(file), &options).expect("a request");
    let (recipe, report) = resolve(&request).unwrap_or_else(|e| panic!("{}: {e}", file.display()));
    (recipe, report.diagnostics.iter().map(|d| d.code).collect())
}

/// Colour indices that a plant wears.
fn colors(plant: &Plant) -> BTreeSet<u8> {
    let axes = plant.axes.iter().flat_map(|a| plant.nodes.color[plant.nodes_of(a)].iter().skip(1));
    let mut found: BTreeSet<u8> = axes.filter(|c| **c & PAINTED != 0).map(|c| (*c & 0xff) as u8).collect();
    let used = plant.organs.iter().map(|o| &plant.protos[usize::from(o.proto)].mesh);
    found.extend(used.flat_map(|m| &m.subsets).filter_map(|s| Paint::of(s.material)).map(|p| p.index));
    found
}

/// Corners of the box of all organs, and the number of their triangles.
fn shapes(plant: &Plant) -> (Vec3, Vec3, usize) {
    let (mut low, mut high, mut triangles) = (Vec3::INFINITY, Vec3::NEG_INFINITY, 0);
    for o in &plant.organs {
        let mesh = &plant.protos[usize::from(o.proto)].mesh;
        let (p, q) = plant.organ_site(o);
        for c in &mesh.points {
            let at = p + q * (*c * o.scale);
            (low, high) = (low.min(at), high.max(at));
        }
        triangles += mesh.triangles.len();
    }
    (low, high, triangles)
}

#[test]
fn models_have_the_results_worked_out_by_hand() {
    let mut names: Vec<_> = fs::read_dir(models()).expect("models").map(|e| e.expect("entry").path()).collect();
    names.retain(|p| p.extension().is_some_and(|e| e == "l"));
    names.sort();
    assert!(names.len() >= 20, "{} models", names.len());
    let dir = tempfile::tempdir().expect("dir");
    for entry in fs::read_dir(models()).expect("models").flatten() {
        fs::copy(entry.path(), dir.path().join(entry.file_name())).expect("copied");
    }
    let mut faults: Vec<String> = Vec::new();
    for source in names {
        let text = fs::read_to_string(&source).expect("text");
        let from = text.find("expect:").expect("an expectation") + 7;
        let expected = &text[from..from + text[from..].find("*/").expect("end")];
        let file = dir.path().join(source.file_name().expect("name"));
        let items: Vec<Vec<&str>> = expected.split(';').map(|i| i.split_whitespace().collect()).collect();
        if items.iter().any(|i| i[0] == "map") {
            fs::write(file.with_extension("map"), color_map()).expect("map");
        }
        let (recipe, mut warned) = load(&file);
        let grown = individuals(&recipe).remove(0);
        let scene = stage(&recipe, SceneOptions::WITHOUT_GROUND);
        warned.extend(scene.report.diagnostics.iter().map(|d| d.code));
        let plant = &grown.plant;
        let (low, high, triangles) = shapes(plant);
        let name = source.file_stem().expect("stem").to_string_lossy().into_owned();
        let mut wanted_warnings = BTreeSet::new();
        for item in &items {
            let numbers: Vec<f32> = item[1..].iter().filter_map(|w| w.parse().ok()).collect();
            let mut near = |found: &[f32]| {
                let same = found.iter().zip(&numbers).all(|(a, b)| (a - b).abs() < 2e-4);
                if !same || found.len() != numbers.len() {
                    faults.push(format!("{name}: {found:?}, wanted {item:?}"));
                }
            };
            match item[0] {
                "map" => {}
                "axes" => near(&[plant.axes.len() as f32]),
                "nodes" => near(&[plant.nodes.len() as f32]),
                "organs" => near(&[plant.organs.len() as f32]),
                "triangles" => near(&[triangles as f32]),
                "end" => near(&plant.nodes.p.last().expect("a node").to_array()),
                "radii" => near(&plant.nodes.r),
                "radius" => plant.nodes.r.iter().for_each(|r| near(&[*r])),
                "box" => near(&[low.to_array(), high.to_array()].concat()),
                "colors" => near(&colors(plant).into_iter().map(f32::from).collect::<Vec<_>>()),
                "warns" => wanted_warnings.extend(item[1..].iter().copied()),
                other => panic!("{name}: unknown expectation {other}"),
            }
        }
        let warned: BTreeSet<&str> = warned.into_iter().collect();
        if warned != wanted_warnings {
            faults.push(format!("{name}: warns {warned:?}, wanted {wanted_warnings:?}"));
        }
        // Every colour of the plant is a material of the scene, and no provisional one is left.
        let scene = &scene.animated.scene;
        let prototypes = scene.assets.iter().flat_map(|a| &a.instancers).flat_map(|i| &i.prototypes);
        let meshes = scene.assets.iter().flat_map(|a| &a.meshes).map(|m| &m.mesh);
        for subset in prototypes.map(|p| &p.mesh).chain(meshes).flat_map(|m| &m.subsets) {
            assert!((subset.material as usize) < scene.materials.len(), "{name}: {subset:?}");
        }
        for color in colors(plant) {
            let is_it = |m: &str| m.contains(&format!("_color_{color}")) && !m.contains(&format!("_color_{color}0"));
            assert!(scene.materials.iter().any(|m| is_it(&m.name)), "{name}: colour {color}");
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

/// A curve of two colours in a folder of its own: blue, then red.
fn two_colored(dir: &Path) -> String {
    let text = "/* Two colours. */\nLsystem: 1\nderivation length: 3\nAxiom: ;(2)L,(5)+L\nL --> L+L-L-L+L\nhomomorphism\nL --> F\nendlsystem\n";
    fs::write(dir.join("two.l"), text).expect("grammar");
    fs::write(dir.join("two.v"), "angle increment: 90\nline style: cylinder\ninitial line width: 0.3\n").expect("view");
    let mut map = vec![0; 768];
    map[6..9].copy_from_slice(&[0, 0, 255]);
    map[15..18].copy_from_slice(&[255, 0, 0]);
    fs::write(dir.join("two.map"), map).expect("map");
    arg(&dir.join("two.l")).to_owned()
}

#[test]
fn a_curve_of_two_colors_has_both_in_every_format() {
    let dir = tempfile::tempdir().expect("dir");
    let source = two_colored(dir.path());
    let read = |ending: &str| {
        let file = dir.path().join(format!("out.{ending}"));
        ends(0, &["grow", &source, "-o", arg(&file)]);
        fs::read(&file).expect("written")
    };
    // glTF: two primitives, whose materials are blue and red.
    let gltf: serde_json::Value = serde_json::from_slice(&read("gltf")).expect("JSON");
    let primitives = gltf["meshes"][0]["primitives"].as_array().expect("primitives");
    let color = |i: &serde_json::Value| {
        gltf["materials"].get(i.as_u64().and_then(|i| usize::try_from(i).ok()).expect("an index")).expect("a material")
            ["pbrMetallicRoughness"]["baseColorFactor"]
            .to_string()
    };
    let found: BTreeSet<String> = primitives.iter().map(|p| color(&p["material"])).collect();
    let wanted: BTreeSet<String> = ["[0,0,1,1]".into(), "[1,0,0,1]".into()].into();
    assert_eq!(found, wanted);
    // USD: a subset bound to each material.
    let usd = String::from_utf8(read("usda")).expect("text");
    for (material, diffuse) in [("two_color_2", "(0, 0, 1)"), ("two_color_5", "(1, 0, 0)")] {
        assert!(usd.contains(material) && usd.contains(diffuse), "{material}");
    }
    assert!(usd.matches("def GeomSubset").count() >= 2);
    // OBJ: faces behind each material, whose colours the library file has.
    let obj = String::from_utf8(read("obj")).expect("text");
    assert!(obj.contains("usemtl two_color_2") && obj.contains("usemtl two_color_5"));
    let mtl = fs::read_to_string(dir.path().join("out.mtl")).expect("materials");
    assert!(mtl.contains("Kd 0 0 1") && mtl.contains("Kd 1 0 0"), "{mtl}");
    // PLY: bytes of both colours behind the vertices.
    let ply = read("ply");
    let body = &ply[ply.windows(11).position(|w| w == b"end_header\n").expect("header") + 11..];
    let count = |rgb: [u8; 4]| body.windows(4).filter(|w| *w == rgb).count();
    assert!(count([0, 0, 255, 255]) > 100 && count([255, 0, 0, 255]) > 100);
    // POV-Ray: textures of both colours.
    read("pov");
    let mut pov = String::new();
    for entry in fs::read_dir(dir.path().join("out_files")).expect("files").flatten() {
        pov += &String::from_utf8_lossy(&fs::read(entry.path()).expect("file"));
    }
    assert!(pov.contains("two_color_2") && pov.contains("two_color_5"));
    // The preview shows pixels that are mostly blue and mostly red.
    let picture = dir.path().join("out.png");
    ends(0, &["preview", &source, "-o", arg(&picture), "--size", "300x300"]);
    let pixels = image::open(&picture).expect("picture").into_rgb8();
    let more = |a: usize, b: usize| pixels.pixels().filter(|p| i32::from(p[a]) > 2 * i32::from(p[b]) + 40).count();
    assert!(more(2, 0) > 50 && more(0, 2) > 50, "{} blue, {} red", more(2, 0), more(0, 2));
}

/// The colour file, and the hairs of a tuft, leave nothing to see of bark.
#[test]
fn keys_of_a_bark_that_is_not_shown_are_reported() {
    let dir = tempfile::tempdir().expect("dir");
    two_colored(dir.path());
    let said = |plant: &str| {
        let scene = dir.path().join("scene.toml");
        fs::write(&scene, format!("[plants.p]\n{plant}")).expect("scene");
        ends(0, &["check", arg(&scene)]).1
    };
    let shoot = "[plants.p.shoot]\nside = 32\n";
    let colored = said(&format!("grammar = \"two.l\"\n[plants.p.bark]\nkind = \"smooth\"\ntile = 0.1\n{shoot}"));
    assert!(
        colored.contains("kind, tile of plants.p.bark have no effect") && colored.contains("scene.toml:4:1"),
        "{colored}"
    );
    assert!(colored.contains("side of plants.p.shoot has no effect") && colored.contains("colour file"), "{colored}");
    let tuft = said(&format!("grammar = \"catkin.l\"\n[plants.p.bark]\ndepth_mm = 1\n{shoot}"));
    assert!(tuft.contains("depth_mm of plants.p.bark") && tuft.contains("side of plants.p.shoot"), "{tuft}");
    assert!(tuft.contains("is a tuft"), "{tuft}");
    // Hairs with a radius of a metre have the bark of thick axes.
    let thick = said("grammar = \"catkin.l\"\n[plants.p.turtle]\nwidth = 2\n[plants.p.bark]\ndepth_mm = 1\n");
    assert!(!thick.contains("S007"), "{thick}");
    let plain = said(&format!("grammar = \"oak.l\"\n[plants.p.bark]\ndepth_mm = 1\n{shoot}"));
    assert!(!plain.contains("S007"), "{plain}");
}

#[test]
fn scene_keys_come_before_the_view() {
    let dir = tempfile::tempdir().expect("dir");
    fs::write(dir.path().join("a.l"), "Lsystem: 1\nderivation length: 0\nAxiom: F+F\nendlsystem\n").expect("grammar");
    fs::write(dir.path().join("a.v"), "angle increment: 90\nline style: cylinder\ninitial line width: 0.2\n")
        .expect("view");
    let tip = |turtle: &str| {
        let scene = dir.path().join("s.toml");
        fs::write(&scene, format!("[plants.a]\ngrammar = \"a.l\"\n[plants.a.turtle]\n{turtle}\n")).expect("scene");
        let plant = individuals(&load_scene(&scene)).remove(0).plant;
        (plant.nodes.p.last().copied().expect("a node"), plant.nodes.r[0])
    };
    let near = |a: (Vec3, f32), p: [f32; 3], r: f32| {
        assert!((a.0 - Vec3::from(p)).length() < 1e-4 && (a.1 - r).abs() < 1e-6, "{a:?}")
    };
    near(tip(""), [-1.0, 1.0, 0.0], 0.1);
    near(tip("angle_deg = -90"), [1.0, 1.0, 0.0], 0.1);
    near(tip("width = 0.5"), [-1.0, 1.0, 0.0], 0.25);
    fs::write(dir.path().join("b.v"), "angle increment: 180\nline style: cylinder\n").expect("view");
    near(tip("view = \"b.v\"\nwidth = 0.5"), [0.0, 0.0, 0.0], 0.25);
    // Without a view the angle is 45, and a line that does not branch has one width.
    let (p, r) = tip("view = \"none\"");
    assert!((p - Vec3::new(-0.5_f32.sqrt(), 1.0 + 0.5_f32.sqrt(), 0.0)).length() < 1e-4 && r < 0.01, "{p} {r}");
    // Two views, none of which has the grammar's name: neither is taken; one of them is, unless it has the name of another grammar.
    fs::rename(dir.path().join("a.v"), dir.path().join("c.v")).expect("renamed");
    assert!(tip("").1 < 0.01);
    fs::remove_file(dir.path().join("b.v")).expect("removed");
    near(tip(""), [-1.0, 1.0, 0.0], 0.1);
    fs::copy(dir.path().join("a.l"), dir.path().join("c.l")).expect("copied");
    assert!(tip("").1 < 0.01);
}

fn load_scene(file: &Path) -> Recipe {
    resolve(&find_scene(arg(file), &SourceOptions::default()).expect("a request")).unwrap_or_else(|e| panic!("{e}")).0
}

#[test]
fn files_outside_the_folder_are_refused() {
    let outer = tempfile::tempdir().expect("dir");
    let dir = outer.path().join("inner");
    fs::create_dir(&dir).expect("folder");
    let grammar = dir.join("a.l");
    fs::write(&grammar, "Lsystem: 1\nderivation length: 0\nAxiom: F~l\nendlsystem\n").expect("grammar");
    fs::write(outer.path().join("out.s"), "secret").expect("file");
    let refused = |file: &str| {
        fs::write(dir.join("a.v"), format!("line style: cylinder\nsurface: l {file} 1\n")).expect("view");
        let (code, _, err) = said(&run(&["check", arg(&grammar)]));
        assert!(code == 1 && err.contains("L006") && !err.contains("secret"), "{file}: {code} {err}");
        assert!(err.contains("a.v:2:1"), "{file}: {err}");
    };
    refused("../out.s");
    refused(arg(&outer.path().join("out.s")));
    refused("/dev/zero");
    fs::create_dir(dir.join("folder.s")).expect("folder");
    refused("folder.s");
    // A sparse file of more than 64 MiB is not read.
    fs::File::create(dir.join("huge.s")).expect("file").set_len((64 << 20) + 1).expect("length");
    refused("huge.s");
    #[cfg(unix)]
    {
        std::os::unix::fs::symlink(outer.path().join("out.s"), dir.join("link.s")).expect("link");
        refused("link.s");
        assert!(std::process::Command::new("mkfifo").arg(dir.join("pipe.s")).status().expect("mkfifo").success());
        refused("pipe.s");
    }
}

#[test]
fn damaged_colors_and_textures_are_told() {
    let dir = tempfile::tempdir().expect("dir");
    let grammar = dir.path().join("a.l");
    fs::write(&grammar, "Lsystem: 1\nderivation length: 0\nAxiom: F\nendlsystem\n").expect("grammar");
    fs::write(dir.path().join("a.map"), [1, 2, 3, 4]).expect("map");
    fs::write(dir.path().join("a.v"), "line style: cylinder\ntexture: F: bark.rgb\n").expect("view");
    fs::write(dir.path().join("bark.rgb"), [1, 218, 0, 1]).expect("texture");
    let (code, _, err) = said(&run(&["check", arg(&grammar)]));
    assert_eq!(code, 0, "{err}");
    assert!(err.contains("a colour map is 256 times 3 bytes (768), the file has 4 bytes"), "{err}");
    assert!(err.contains("is no picture of PNG, JPEG, Silicon Graphics or Targa") && err.contains("a.v:2:1"), "{err}");
    // A scene that names a file which is not there says so at the name.
    let scene = dir.path().join("s.toml");
    fs::write(&scene, "[plants.a]\ngrammar = \"a.l\"\n[plants.a.turtle]\ncolors = \"b.map\"\nview = \"none\"\n")
        .expect("scene");
    let (code, _, err) = said(&run(&["check", arg(&scene)]));
    assert!(code == 1 && err.contains("S005") && err.contains("s.toml:4"), "{code} {err}");
}

/// A view that is no view, or a contour that is none, is refused at its key, whatever its lines may be taken for.
#[test]
fn a_key_takes_only_files_of_its_kind() {
    let dir = tempfile::tempdir().expect("dir");
    let grammar = "Lsystem: 1\nderivation length: 0\nAxiom: F\nendlsystem\n";
    for (name, text) in [("a.l", grammar), ("b.v", "angle factor: 25\n"), ("b.con", "angle factor: 25\n")] {
        fs::write(dir.path().join(name), text).expect("file");
    }
    let scene = dir.path().join("s.toml");
    for (key, wanted) in [
        ("view = \"b.con\"", "expected a file .v\n"),
        ("colors = \"b.v\"", "expected a file .mat, .map\n"),
        ("contours = [{ id = 1, file = \"b.v\" }]", "expected a file .con, .cset\n"),
        ("functions = [{ file = \"b.con\" }]", "expected a file .func, .fset\n"),
    ] {
        fs::write(&scene, format!("[plants.a]\ngrammar = \"a.l\"\n[plants.a.turtle]\n{key}\n")).expect("scene");
        let (code, _, err) = said(&run(&["check", arg(&scene)]));
        assert!(code == 1 && err.contains("error[S005]") && err.contains(wanted), "{key}: {code} {err}");
    }
}

#[test]
fn a_plant_with_every_kind_of_companion_bakes() {
    let dir = tempfile::tempdir().expect("dir");
    let poppy = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/grammars/poppy"));
    for entry in fs::read_dir(poppy).expect("poppy").flatten() {
        fs::copy(entry.path(), dir.path().join(entry.file_name())).expect("copied");
    }
    // The binary companions: a map with a red of its own for petals, a material file beside it that is not asked for, a picture.
    let mut map = vec![96; 768];
    map[30..33].copy_from_slice(&[216, 48, 28]);
    fs::write(dir.path().join("poppy.map"), map).expect("map");
    image::RgbImage::from_pixel(4, 4, image::Rgb([90, 140, 60])).save(dir.path().join("veins.png")).expect("picture");
    let view = dir.path().join("poppy.v");
    let text = fs::read_to_string(&view).expect("view");
    let text = text.replace("leaf.s 1 14 10 0", "leaf.s 1 14 10 1") + "texture: F: veins.png\n";
    fs::write(&view, text).expect("view");
    let scene = dir.path().join("garden.toml");
    let keys = "[plants.poppy]\ngrammar = \"poppy.l\"\n[output]\nformats = [\"usd\", \"glb\"]\n";
    fs::write(&scene, keys).expect("scene");
    let out = dir.path().join("out");
    let (_, err) = ends(0, &["bake", arg(&scene), "-o", arg(&out)]);
    assert!(!err.contains("warning[L0"), "{err}");
    ends(0, &["info", arg(&out)]);
    let manifest = fs::read_to_string(out.join("manifest.json")).expect("manifest");
    for name in ["poppy_color_2", "poppy_color_4", "poppy_color_10_thin", "poppy_color_22_thin", "poppy_texture_1"] {
        assert!(manifest.contains(&format!("\"{name}\"")), "{name}");
    }
    // glTF: the petals' material has the map's red, the leaves' the picture.
    let glb = fs::read(out.join("gltf/garden.web.glb")).expect("glb");
    let length = u32::from_le_bytes([glb[12], glb[13], glb[14], glb[15]]);
    let length = usize::try_from(length).expect("a length");
    let gltf: serde_json::Value = serde_json::from_slice(&glb[20..20 + length]).expect("JSON");
    let material = |name: &str| {
        let list = gltf["materials"].as_array().expect("materials");
        list.iter().find(|m| m["name"] == name).unwrap_or_else(|| panic!("no {name}"))["pbrMetallicRoughness"].clone()
    };
    let red = material("poppy_color_10_thin")["baseColorFactor"][0].as_f64().expect("a number");
    assert!((red - 0.6867).abs() < 1e-3, "{red}");
    assert!(material("poppy_texture_1")["baseColorTexture"].is_object());
    // USD as text: petals and leaves are bound to these materials.
    let usd = dir.path().join("poppy.usda");
    ends(0, &["grow", arg(&scene), "-o", arg(&usd)]);
    let usd = fs::read_to_string(&usd).expect("usd");
    for name in ["poppy_color_10_thin", "poppy_texture_1"] {
        assert!(usd.matches(name).count() > 1, "{name}");
    }
}
