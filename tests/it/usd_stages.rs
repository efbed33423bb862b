//! USD files judged by usd-core and Blender.
#![allow(clippy::expect_used, clippy::disallowed_methods, reason = "tests panic and look at the disk themselves")]

use crate::common::clients;
use crate::common::expect;
use crate::common::gltf_player::Player;
use crate::common::program::{arg, ends};
use crate::common::synthetic;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use osier::export::Exporter as _;
use osier::export::exr::{ExrExporter, ExrOptions};
use osier::export::textures::Textures;
use osier::export::usd::{UpAxis, UsdExporter, UsdOptions};
use osier::files::Folder;
use osier::scene::{Frame, Scene};

/// A fresh folder for a test.
fn place(name: &str) -> PathBuf {
    let dir = Path::new(env!("CARGO_TARGET_TMPDIR")).join("usd").join(name);
    let _ = std::fs::remove_dir_all(&dir);
    dir
}

/// Writes a scene with some frames, and the maps that its wet leaves show.
fn write(dir: &Path, scene: &Scene, frames: &[Frame], options: UsdOptions) {
    let folder = Folder::open(dir).expect("folder");
    let mut maps = ExrExporter::new(folder.clone(), ExrOptions::default());
    maps.begin(&Arc::new(scene.clone())).expect("begin");
    frames.iter().for_each(|f| maps.frame(f).expect("frame"));
    maps.finish().expect("finish");
    let options = UsdOptions { maps: true, ..options };
    let textures = Arc::new(Textures::encode(scene).expect("pictures"));
    let mut usd = UsdExporter::new(folder, textures, options);
    usd.begin(&Arc::new(scene.clone())).expect("begin");
    for frame in frames {
        usd.frame(frame).expect("frame");
    }
    let summary = usd.finish().expect("finish");
    assert!(summary.warnings.is_empty(), "{:?}", summary.warnings);
}

fn single(file: &str) -> UsdOptions {
    UsdOptions { file: Some(file.into()), ..UsdOptions::default() }
}

/// All USD files beneath a folder.
fn files(dir: &Path) -> Vec<String> {
    let mut out = Vec::new();
    let mut folders = vec![dir.to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(&folder).expect("folder") {
            let path = entry.expect("entry").path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|e| e.to_string_lossy().starts_with("usd")) {
                out.push(path.to_string_lossy().into_owned());
            }
        }
    }
    out.sort();
    out
}

/// The synthetic scene in every form: animated and still, folders and single files, both up axes.
fn everything(dir: &Path) {
    let (scene, frames) = synthetic::scene();
    let z = |file: Option<&str>| UsdOptions { up: UpAxis::Z, file: file.map(String::from), ..UsdOptions::default() };
    for (name, frames) in [("moving", &frames[..]), ("still", &[])] {
        write(&dir.join(name), &scene, frames, UsdOptions::default());
        write(&dir.join(format!("{name}_z")), &scene, frames, z(None));
        for file in ["all.usda", "all.usdc", "all.usdz"] {
            write(&dir.join(format!("{name}_single")), &scene, frames, single(file));
        }
        write(&dir.join(format!("{name}_single_z")), &scene, frames, z(Some("all.usdz")));
    }
}

#[test]
fn every_file_passes_all_validators() {
    let dir = place("validate");
    everything(&dir);
    let files = files(&dir);
    assert_eq!(files.len(), 2 * (8 + 8 + 3 + 1), "{files:?}");
    let Some(python) = clients::python() else { return };
    let files: Vec<&str> = files.iter().map(String::as_str).collect();
    clients::python_script(&python, "usd_validate.py", &files);
}

/// The mesh of varying topology has other faces at rest than at the only frame.
#[test]
fn a_selection_of_one_frame_passes_all_validators() {
    let Some(python) = clients::python() else { return };
    let dir = place("one_frame");
    let (scene, frames) = synthetic::scene();
    for options in [UsdOptions::default(), single("all.usda")] {
        write(&dir, &scene, &frames[3..4], UsdOptions { first: Some(frames[3].number), ..options });
    }
    let files = files(&dir);
    assert!(files.len() >= 6, "{files:?}");
    clients::python_script(&python, "usd_validate.py", &files.iter().map(String::as_str).collect::<Vec<_>>());
}

#[test]
fn everything_stands_where_osier_says() {
    let dir = place("positions");
    everything(&dir);
    let (scene, frames) = synthetic::scene();
    let wanted = dir.join("expected.json");
    let json = expect::expect(&scene, &frames, &expect::three(&scene)).to_string();
    std::fs::write(&wanted, json).expect("expectations");
    let Some(python) = clients::python() else { return };
    for (stage, up) in [
        ("moving/synthetic.usda", ""),
        ("moving_z/synthetic.usda", "z"),
        ("moving_single/all.usda", ""),
        ("moving_single/all.usdc", ""),
        ("moving_single/all.usdz", ""),
        ("moving_single_z/all.usdz", "z"),
    ] {
        let (stage, wanted) = (dir.join(stage), wanted.to_string_lossy());
        let stage = stage.to_string_lossy();
        let arguments: Vec<&str> = [&*stage, &*wanted, up].into_iter().filter(|a| !a.is_empty()).collect();
        clients::python_script(&python, "usd_positions.py", &arguments);
    }
}

#[test]
fn text_and_crate_say_the_same() {
    let dir = place("equal");
    let (scene, frames) = synthetic::scene();
    for (name, frames) in [("still", &[][..]), ("moving", &frames[..])] {
        for file in ["all.usda", "all.usdc"] {
            write(&dir.join(name), &scene, frames, single(file));
        }
    }
    let Some(python) = clients::python() else { return };
    for name in ["still", "moving"] {
        let [a, b] = ["all.usda", "all.usdc"].map(|f| dir.join(name).join(f).to_string_lossy().into_owned());
        // The pictures' folder is named after the stem, which is the same.
        clients::python_script(&python, "usd_equal.py", &[&a, &b]);
    }
}

#[test]
fn what_follows_from_the_points_agrees_with_them() {
    let dir = place("derived");
    let (scene, frames) = synthetic::scene();
    let z = UsdOptions { up: UpAxis::Z, ..UsdOptions::default() };
    for (name, options) in [("y", UsdOptions::default()), ("z", z)] {
        write(&dir.join(name), &scene, &frames, options);
    }
    let Some(python) = clients::python() else { return };
    for name in ["y", "z"] {
        let files = files(&dir.join(name).join("usd"));
        let files: Vec<&str> = files.iter().map(String::as_str).collect();
        clients::python_script(&python, "usd_derived.py", &files);
    }
}

#[test]
fn blender_shows_everything_where_osier_says() {
    let dir = place("blender");
    let (scene, frames) = synthetic::scene();
    write(&dir.join("y"), &scene, &frames, UsdOptions::default());
    write(&dir.join("z"), &scene, &frames, UsdOptions { up: UpAxis::Z, ..UsdOptions::default() });
    write(&dir.join("one"), &scene, &frames, single("all.usdz"));
    let wanted = dir.join("expected.json");
    let json = expect::expect(&scene, &frames, &expect::three(&scene)).to_string();
    std::fs::write(&wanted, json).expect("expectations");
    let [_, up, back] = scene.camera.axes().map(|a| a.to_array());
    let look = serde_json::json!({
        "eye": scene.camera.eye.to_array(), "up": up, "back": back, "sun": scene.sun.direction().to_array(),
    });
    let Some(python) = clients::python() else { return };
    for stage in ["y/synthetic.usda", "z/synthetic.usda", "one/all.usdz"] {
        let (stage, wanted) = (dir.join(stage), wanted.to_string_lossy());
        let arguments = [&*stage.to_string_lossy(), &*wanted, &look.to_string()];
        clients::python_script(&python, "usd_blender.py", &arguments);
    }
}

#[test]
fn displaced_bark_leaves_a_young_trunk_as_thick_as_it_is() {
    let Some(python) = clients::python() else { return };
    let dir = place("relief");
    let scene = dir.join("young.toml");
    std::fs::create_dir_all(&dir).expect("folder");
    let text = "[plants.oak]\nspecies = \"oak\"\nage = 4\n[[place]]\nplant = \"oak\"\n[ground]\nshow = false\n\
                [output]\nformats = [\"usd\"]\n";
    std::fs::write(&scene, text).expect("scene");
    let out = dir.join("out");
    ends(0, &["-q", "bake", arg(&scene), "-o", arg(&out), "--force"]);
    // The stem between 0.1 and 0.4 m, which is 3 cm thick.
    let stage = out.join("young.usda");
    let output = clients::python_script(&python, "bark_relief.py", &[arg(&stage), "0.1", "0.4", "0.02"]);
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    let line = text.lines().rev().find(|l| l.starts_with('{')).expect("a report");
    let seen: serde_json::Value = serde_json::from_str(line).expect("JSON");
    let number = |key: &str| seen[key].as_f64().expect("a number");
    assert!(number("points") >= 20.0 && (0.012..0.02).contains(&number("before")), "{seen}");
    assert!((number("after") / number("before") - 1.0).abs() < 0.1, "{seen}");
    // There is a relief, about the surface.
    assert!(number("scale") > 5e-4 && (number("midlevel") - 0.5).abs() < 1e-3, "{seen}");
}

/// The texture of a leaf ends at its edges, but repeats where the texture coordinates of an artist's mesh or of a blade of grass leave
/// the square from 0 to 1; it had the colours of its edge there.
#[test]
fn textures_of_leaves_repeat_where_their_coordinates_do() {
    let (mut scene, _) = synthetic::scene();
    let wrap_of_leaf = |scene: &Scene, folder: &str| {
        let dir = place(folder);
        write(&dir, scene, &[], single("all.usda"));
        let text = std::fs::read_to_string(dir.join("all.usda")).expect("file");
        let leaf = text.split("def Material \"leaf\"").nth(1).expect("the leaf").to_owned();
        let wrap = leaf.lines().find(|line| line.contains("inputs:wrapS")).expect("a texture").to_owned();
        wrap.split('"').nth(1).expect("a token").to_owned()
    };
    assert_eq!(wrap_of_leaf(&scene, "wrap_once"), "clamp");
    let instancers = scene.assets.iter_mut().flat_map(|asset| &mut asset.instancers);
    for mesh in instancers.flat_map(|instancer| &mut instancer.prototypes).map(|prototype| &mut prototype.mesh) {
        mesh.uvs.iter_mut().for_each(|uv| *uv += 1.0);
    }
    assert_eq!(wrap_of_leaf(&scene, "wrap_repeat"), "repeat");
}

/// The camera of USD and of glTF shows what `output.pov.size` frames; that of USD had 16:9 for any picture.
#[test]
fn cameras_have_the_shape_of_the_picture() {
    let dir = place("aspect");
    std::fs::create_dir_all(&dir).expect("folder");
    for (name, [width, height]) in [("tall", [600.0, 800.0]), ("wide", [1280.0, 720.0])] {
        let scene = dir.join(format!("{name}.toml"));
        let text = format!(
            "[plants.oak]\nspecies = \"oak\"\nage = 1\n[[place]]\nplant = \"oak\"\n[ground]\nshow = false\n\
             [output]\nformats = [\"usd\", \"glb\"]\n[output.pov]\nsize = [{width}, {height}]\n"
        );
        std::fs::write(&scene, text).expect("scene");
        let out = dir.join(name);
        ends(0, &["-q", "bake", arg(&scene), "-o", arg(&out), "--force"]);
        let layer = std::fs::read_to_string(out.join(format!("{name}.usda"))).expect("layer");
        let number = |attribute: &str| -> f64 {
            let line = layer.lines().find(|line| line.contains(attribute)).expect("an attribute of the camera");
            line.rsplit(' ').next().and_then(|text| text.parse().ok()).expect("a number")
        };
        let ratio = number("float horizontalAperture") / number("float verticalAperture");
        assert!((ratio - width / height).abs() < 1e-5, "{name}: {ratio}");
        let glb = std::fs::read(out.join(format!("gltf/{name}.web.glb"))).expect("file");
        let ratio = Player::new(&glb).json["cameras"][0]["perspective"]["aspectRatio"].as_f64().expect("a ratio");
        assert!((ratio - width / height).abs() < 1e-5, "{name}: {ratio}");
    }
}

#[test]
fn layers_are_edited_and_saved_in_place() {
    let dir = place("save");
    let (scene, frames) = synthetic::scene();
    write(&dir, &scene, &frames, UsdOptions::default());
    write(&dir, &scene, &frames, single("all.usda"));
    let files = files(&dir);
    assert!(files.len() >= 6, "{files:?}");
    let Some(python) = clients::python() else { return };
    clients::python_script(&python, "usd_save.py", &files.iter().map(String::as_str).collect::<Vec<_>>());
}

#[test]
fn packages_are_plain_aligned_archives() {
    let dir = place("package");
    let (scene, frames) = synthetic::scene();
    write(&dir, &scene, &frames, single("all.usdz"));
    let Some(python) = clients::python() else { return };
    let path = dir.join("all.usdz");
    let file = path.to_string_lossy();
    let members = ["synthetic.usdc", "textures/bark_color.png", "textures/bark_normal.png", "textures/leaf_color.png"];
    let arguments: Vec<&str> = [&*file].into_iter().chain(members).collect();
    clients::python_script(&python, "usd_package.py", &arguments);
}

#[test]
fn endings_in_capitals_name_the_same_formats() {
    let dir = place("capitals");
    let (scene, _) = synthetic::scene();
    for (file, start) in [("all.USDA", "#usda"), ("all.USDC", "PXR-USDC"), ("all.USDZ", "PK\u{3}\u{4}")] {
        write(&dir, &scene, &[], single(file));
        let bytes = std::fs::read(dir.join(file)).expect("file");
        // The text and the package were crate files under a wrong name.
        assert!(bytes.starts_with(start.as_bytes()), "{file}");
    }
}
