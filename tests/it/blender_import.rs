//! The Blender extension in `blender/`: it is packed, installed, imports bakes and leaves nothing behind.
#![allow(clippy::expect_used, clippy::disallowed_methods, reason = "tests run programs and read their files")]

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::{Value, json};

use crate::common::clients;
use crate::common::picture::Picture;
use crate::common::program::{arg, ends};

fn sources() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("blender")
}

/// A meadow of a few copies with time offsets, and the wet leaf over three frames.
fn bake_scenes(dir: &Path) -> [PathBuf; 2] {
    let meadow = dir.join("lawn.toml");
    let text = "[frames]\nend = 48\n[plants.tuft]\ngrammar = \"grass.l\"\n[plants.tuft.wood]\nelasticity_gpa = 0.3\n\
        stiffness = 0.1\n[[place]]\nplant = \"tuft\"\ncount = 60\nradius = 2\nindividuals = 2\n[wind]\nspeed = 7\n\
        gust = 0.8\n[sway]\nphases = 4\n[ground]\nside = 64\n";
    fs::write(&meadow, text).expect("scene");
    let formats = ["--formats", "usd,exr"];
    let lawn = dir.join("lawn");
    ends(0, &[&["-q", "bake", arg(&meadow), "-o", arg(&lawn)], &formats[..]].concat());
    let leaf = dir.join("leaf");
    let clip = ["--frames", "36-44", "--set", "maps.resolution=128"];
    ends(0, &[&["-q", "bake", "wet-leaf", "-o", arg(&leaf)], &formats[..], &clip[..]].concat());
    [lawn.join("manifest.json"), leaf.join("manifest.json")]
}

/// True if a zip, whose files are stored as they are, has the text of the license of the extensions.
pub(crate) fn holds_license(zip: &Path) -> bool {
    let license = fs::read(sources().join("LICENSE")).expect("license");
    fs::read(zip).expect("zip").windows(license.len()).any(|part| part == license)
}

/// The last line that a program printed, as JSON.
fn last_line(output: &[u8]) -> Value {
    let text = String::from_utf8_lossy(output);
    serde_json::from_str(text.trim_end().lines().last().unwrap_or_default()).unwrap_or_else(|e| panic!("{e}: {text}"))
}

#[test]
fn the_extension_installs_imports_and_leaves_nothing_behind() {
    let Some(python) = clients::python() else { return };
    let dir = tempfile::tempdir().expect("dir");
    let packed = |name: &str| {
        let folder = dir.path().join(name);
        clients::run(Command::new(&python).arg(sources().join("build.py")).arg(&folder));
        let mut zips: Vec<PathBuf> =
            fs::read_dir(folder).expect("zips").map(|entry| entry.expect("entry").path()).collect();
        zips.sort();
        zips
    };
    // The same sources give the same bytes.
    let (zips, again) = (packed("a"), packed("b"));
    assert_eq!(zips.len(), 2);
    assert!(zips.iter().zip(&again).all(|(a, b)| fs::read(a).expect("zip") == fs::read(b).expect("zip")));
    assert!(zips.iter().all(|zip| holds_license(zip)), "a zip without its license");

    let manifests = bake_scenes(dir.path());
    let user = dir.path().join("user");
    fs::create_dir(&user).expect("folder");
    let zip = zips.iter().find(|z| !arg(z).contains("legacy")).expect("the extension");
    let mut install = Command::new(&python);
    install.arg(sources().join("tests/install.py")).arg(zip).args(&manifests).env("BLENDER_USER_RESOURCES", &user);
    let report = last_line(&clients::run(&mut install).stdout);

    // 60 copies are one cloud of points beside the ground; the clip is that of the bake.
    let [lawn, leaf] = [&report[0], &report[1]];
    assert_eq!(lawn["range"], json!([1, 48]), "{report}");
    assert!(lawn["objects"].as_u64().is_some_and(|n| n < 20), "{report}");
    assert_eq!(leaf["range"], json!([36, 44]), "{report}");
    assert_eq!(leaf["fps"][0], json!(48), "{report}");
    assert!(leaf["camera"].is_string() && lawn["camera"].is_string(), "{report}");
    let sequences = leaf["wetness"].as_array().expect("a list");
    assert!(!sequences.is_empty() && sequences.iter().all(|s| *s == json!([36, 9, 35])), "{report}");

    // Leaves get wetter over the clip in Cycles, with nothing set by hand.
    let mut wetness = Command::new(&python);
    wetness.arg(sources().join("tests/wetness.py")).arg(&manifests[1]).arg(dir.path()).args(["36", "40", "44"]);
    let told = last_line(&clients::run(&mut wetness).stdout);
    let means = |key: &str| -> Vec<f64> { serde_json::from_value(told[key].clone()).expect("means") };
    let wet = means("wetness");
    assert!(wet[0] > 0.0 && wet.windows(2).all(|w| w[1] > 1.05 * w[0]), "{told}");
    // In pictures of the bake as it was imported wetted leaves are darker: 30 % where they got wet, 1 % of all that shows leaves.
    for (key, most) in [("wetted", 0.85), ("leaf", 0.995)] {
        let seen = means(key);
        assert!(seen[1] > 0.0 && seen[1] < most * seen[0], "{key}: {told}");
    }

    pictures_are_those_of_the_preview(&python, &manifests[1], dir.path());

    // What imports, failures, reloads, files and undo change and keep.
    let kept = dir.path().join("kept");
    fs::create_dir(&kept).expect("folder");
    let mut behaviour = Command::new(&python);
    behaviour.arg(sources().join("tests/behaviour.py")).arg(&manifests[1]).arg(&manifests[0]).arg(&kept);
    let report = last_line(&clients::run(&mut behaviour).stdout);
    assert_eq!(report["failed"], json!([]), "{report}");
}

/// Frames of the wet leaf in Cycles and EEVEE look as the preview shows them: in blocks of ten pixels the mean difference is below 0.03 of
/// white, and that of no block above 0.15. In EEVEE a block of a dark drop is 0.22 apart.
fn pictures_are_those_of_the_preview(python: &Path, manifest: &Path, folder: &Path) {
    for (engine, frames) in [("CYCLES", &["36", "40", "44"][..]), ("EEVEE", &["40"])] {
        let mut blender = Command::new(python);
        // EEVEE draws with OpenGL, which Mesa computes where there is no GPU.
        blender.env("LIBGL_ALWAYS_SOFTWARE", "1").arg(sources().join("tests/pictures.py")).arg(manifest).arg(folder);
        clients::run(blender.args(["160x120", engine]).args(frames));
        for frame in frames {
            let preview = folder.join(format!("preview_{frame}.png"));
            let view = ["--view", "scene", "--size", "160x120", "--frame", frame];
            ends(0, &[&["-q", "preview", "wet-leaf", "--force", "-o", arg(&preview)], &view[..]].concat());
            let (here, there) = (blocks(&folder.join(format!("{engine}_{frame}.png"))), blocks(&preview));
            let apart: Vec<f32> = here.iter().zip(&there).map(|(a, b)| (a - b).abs()).collect();
            let mean = apart.iter().sum::<f32>() / apart.len() as f32;
            let most = apart.iter().copied().fold(0.0, f32::max);
            assert!(mean < 0.03 && most < 0.15, "{engine}, frame {frame}: {mean}, at most {most}");
        }
    }
}

/// Mean colours of blocks of ten pixels of a picture of 160 x 120.
fn blocks(path: &Path) -> Vec<f32> {
    let picture = Picture::open(path);
    assert_eq!((picture.width, picture.height), (160, 120));
    let block = |x: usize, y: usize, c: usize| {
        let texels = (0..100).map(|i| picture.at(10 * x + i % 10, 10 * y + i / 10)[c]);
        texels.sum::<f32>() / 100.0
    };
    (0..12 * 16 * 3).map(|i| block(i / 3 % 16, i / 48, i % 3)).collect()
}

/// Blender before 4.2 has no extensions: Debian's 3.4.1 installs the zip that is made for it as an add-on. It has no USD either, and says so.
#[test]
fn the_legacy_zip_installs_in_a_blender_without_extensions() {
    let (Some(python), Some(blender)) = (clients::python(), clients::blender()) else { return };
    let dir = tempfile::tempdir().expect("dir");
    clients::run(Command::new(&python).arg(sources().join("build.py")).arg(dir.path()));
    let zips = fs::read_dir(dir.path()).expect("zips").map(|entry| entry.expect("entry").path());
    let zip = zips.into_iter().find(|z| arg(z).contains("legacy")).expect("the zip for old versions");
    let mut script = Command::new(&blender);
    script.args(["--background", "--factory-startup", "--python-exit-code", "9", "--python"]);
    script.arg(sources().join("tests/legacy.py")).arg("--").arg(&zip).arg(dir.path().join("manifest.json"));
    let user = dir.path().join("user");
    fs::create_dir(&user).expect("folder");
    let output = clients::run(script.env("BLENDER_USER_SCRIPTS", &user)).stdout;
    let text = String::from_utf8_lossy(&output);
    let line = text.lines().rfind(|line| line.starts_with('{')).unwrap_or_default();
    let report: Value = serde_json::from_str(line).unwrap_or_else(|e| panic!("{e}: {text}"));
    assert_eq!(report["name"], json!("osier Import"), "{report}");
    for file in ["LICENSE", "__init__.py", "ops.py", "stage.py"] {
        assert!(report["files"].as_array().is_some_and(|files| files.contains(&json!(file))), "{file}: {report}");
    }
    assert!(report["classes"].as_array().is_some_and(|classes| classes.len() >= 2), "{report}");
    assert_eq!(report["menu"].as_array().map(Vec::len), Some(1), "{report}");
    let refused = report["refusal"].as_str().is_some_and(|words| words.contains("without USD"));
    assert_eq!(refused, report["usd"] == json!(false), "{report}");
    assert_eq!((&report["disabled"], &report["left"]), (&json!([]), &json!(false)), "{report}");
}

/// Blender's USD importer gives curves no material; osier's takes it from the manifest.
#[test]
fn hairs_have_their_material_in_blender() {
    let Some(python) = clients::python() else { return };
    let dir = tempfile::tempdir().expect("dir");
    let out = dir.path().join("catkin");
    ends(0, &["-q", "bake", "catkin", "--formats", "usd", "-o", arg(&out)]);
    let manifest = out.join("manifest.json");
    let told: Value = serde_json::from_slice(&fs::read(&manifest).expect("manifest")).expect("JSON");
    assert_eq!(told["assets"][0]["curve_materials"], json!({"hairs": "catkin_hair"}));
    let shown = clients::run(Command::new(python).arg(sources().join("tests/curves.py")).arg(&manifest));
    assert_eq!(last_line(&shown.stdout), json!([["hairs", "catkin_hair"]]));
}

/// The extensions read and write only what they say: the rules of the platform's repository.
#[test]
fn the_extensions_neither_evaluate_text_nor_open_connections() {
    let folders = ["osier_import", "osier"].map(|name| fs::read_dir(sources().join(name)).expect("sources"));
    let paths: Vec<PathBuf> = folders.into_iter().flatten().map(|entry| entry.expect("entry").path()).collect();
    let modules: Vec<&PathBuf> = paths.iter().filter(|p| p.extension().is_some_and(|e| e == "py")).collect();
    assert!(modules.len() > 15, "{modules:?}");
    for path in modules {
        let text = fs::read_to_string(path).expect("source");
        for word in [
            "exec(",
            "eval(",
            "__import__",
            "import socket",
            "import ssl",
            "import urllib",
            "import http",
            "import requests",
            "from socket",
            "from urllib",
            "from http",
        ] {
            assert!(!text.contains(word), "{}: {word}", path.display());
        }
    }
}
