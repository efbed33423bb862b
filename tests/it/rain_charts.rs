//! Leaves of artists whose texture coordinates are missing, overlap or leave the texture: rain meets them as it meets any leaf.
#![allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    clippy::expect_used,
    clippy::disallowed_methods,
    reason = "tests run the program and read its files"
)]

use crate::common::clients;
use crate::common::program::{arg, ends};
use std::fs;
use std::path::Path;

/// A leaf of 40 x 80 mm in three by three vertices, with texture coordinates by a function of those that are one-to-one.
fn leaf(uv: Option<&dyn Fn(f64, f64) -> [f64; 2]>) -> String {
    let mut text = "mtllib leaf.mtl\nusemtl leaf\n".to_owned();
    let places = || (0..3).flat_map(|y| (0..3).map(move |x| (f64::from(x) * 0.5, f64::from(y) * 0.5)));
    for (u, v) in places() {
        text += &format!("v {} {} 0\n", (u - 0.5) * 0.5, v);
    }
    for [u, v] in uv.iter().flat_map(|uv| places().map(|(u, v)| uv(u, v))) {
        text += &format!("vt {u} {v}\n");
    }
    let corner = |i: usize| if uv.is_some() { format!("{i}/{i}") } else { format!("{i}") };
    for (x, y) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
        let a = 1 + y * 3 + x;
        let [a, b, c, d] = [a, a + 1, a + 4, a + 3].map(corner);
        text += &format!("f {a} {b} {c}\nf {a} {c} {d}\n");
    }
    text
}

/// What a bake of a leaf in the rain says and leaves.
struct Baked {
    warnings: String,
    struck: f64,
    /// Texture coordinates and position of each drop on the leaf.
    drops: Vec<[f64; 5]>,
}

fn bake(dir: &Path, name: &str, mesh: &str) -> Baked {
    let folder = dir.join(name);
    fs::create_dir(&folder).expect("folder");
    fs::write(folder.join("leaf.obj"), mesh).expect("mesh");
    fs::write(folder.join("leaf.mtl"), "newmtl leaf\nKd 0.2 0.4 0.1\nmap_Kd leaf.png\n").expect("material");
    // Red grows with u, green with v.
    let color = |x: u32, y: u32| image::Rgb([8 * x as u8 + 4, 252 - 8 * y as u8, 10]);
    image::RgbImage::from_fn(32, 32, color).save(folder.join("leaf.png")).expect("picture");
    let grammar = "Lsystem: leaf\nDerivation length: 0\nAxiom: !(0.002) F(0.3) &(70) ~l(1)\nendlsystem\n";
    fs::write(folder.join("leaf.l"), grammar).expect("grammar");
    let scene = "seed = 4\n[frames]\nend = 13\n[plants.p]\ngrammar = \"leaf.l\"\nmotion = \"still\"\n[plants.p.leaf]\nmesh = \"leaf.obj\"\n\
        size = 0.16\n[[place]]\nplant = \"p\"\n[ground]\nshow = false\n[maps]\nresolution = 64\n[wind]\nmodel = \"calm\"\n\
        [output]\nformats = [\"usd\", \"exr\", \"csv\", \"tracks\"]\n[rain]\nrate_mm_per_h = 150\nspin_up_s = 1\nsubsteps = 8\n\
        [rain.drop]\npin_noise = 0\n";
    fs::write(folder.join("wet.toml"), scene).expect("scene");
    let out = folder.join("out");
    let (_, warnings) = ends(0, &["bake", arg(&folder.join("wet.toml")), "-o", arg(&out)]);
    let table = fs::read_to_string(out.join("stats/rain.csv")).expect("table");
    let mut rows = table.lines().filter(|l| !l.starts_with('#'));
    let column = rows.next().expect("names").split(',').position(|c| c == "struck").expect("a column");
    let struck = rows.next_back().and_then(|row| row.split(',').nth(column)?.parse().ok()).expect("a number");
    Baked { warnings, struck, drops: drops_on_leaf(&out) }
}

/// u, v, x, y and z of the records of drops on leaves.
fn drops_on_leaf(out: &Path) -> Vec<[f64; 5]> {
    let text = fs::read(out.join("tracks/index.json")).expect("index");
    let index: serde_json::Value = serde_json::from_slice(&text).expect("json");
    let file = index["files"].as_array().expect("files").iter().find(|f| f["file"] == "drops.bin").expect("drops");
    let number = |v: &serde_json::Value| usize::try_from(v.as_u64().expect("a number")).expect("small");
    let at = |name: &str| {
        let field = file["fields"].as_array().expect("fields").iter().find(|f| f["name"] == name).expect("a field");
        number(&field["offset"])
    };
    let bytes = fs::read(out.join("tracks/drops.bin")).expect("records");
    let four = |record: &[u8], name: &str| <[u8; 4]>::try_from(&record[at(name)..at(name) + 4]).expect("four bytes");
    let on_leaf = |record: &&[u8]| {
        i32::from_le_bytes(four(record, "leaf")) == 0 && f32::from_le_bytes(four(record, "side")) > 0.0
    };
    let values =
        |record: &[u8]| ["u", "v", "x", "y", "z"].map(|name| f64::from(f32::from_le_bytes(four(record, name))));
    bytes.chunks(number(&file["record_bytes"])).filter(on_leaf).map(values).collect()
}

/// Largest wetness of a map, left and right of the middle.
fn wetness(python: &Path, dir: &Path, name: &str) -> [f64; 2] {
    let path = dir.join(name).join("out/maps/p_l0000/wetness.0013.exr");
    let said = clients::python_script(python, "read_exr.py", &[arg(&path)]);
    let found: serde_json::Value = serde_json::from_slice(&said.stdout).expect("json");
    let mut most = [0.0_f64; 2];
    for row in found["pixels"]["Y"].as_array().expect("rows") {
        let row = row.as_array().expect("a row");
        for (x, value) in row.iter().enumerate() {
            let half = usize::from(2 * x >= row.len());
            most[half] = most[half].max(value.as_f64().expect("a number"));
        }
    }
    most
}

#[test]
fn rain_meets_leaves_whatever_their_texture_coordinates() {
    let dir = tempfile::tempdir().expect("dir");
    let plain = bake(dir.path(), "plain", &leaf(Some(&|u, v| [u, v])));
    assert!(plain.struck > 60.0 && !plain.warnings.contains("X022"), "{} {}", plain.struck, plain.warnings);
    let half = |u: f64| (u - 0.5).abs() * 2.0;
    let mirrored = bake(dir.path(), "mirrored", &leaf(Some(&|u, v| [half(u), v])));
    let beyond = bake(dir.path(), "beyond", &leaf(Some(&|u, v| [3.0 * u + 1.0, v])));
    let none = bake(dir.path(), "none", &leaf(None));
    for (baked, fault) in [(&mirrored, "several parts"), (&beyond, "range of 0 to 1"), (&none, "are missing")] {
        assert!(baked.warnings.contains("X022") && baked.warnings.contains(fault), "{}", baked.warnings);
        // The same drops strike; those that drip from the margin and come back may differ.
        assert!((baked.struck / plain.struck - 1.0).abs() < 0.03, "{} {}", baked.struck, plain.struck);
    }
    for (name, baked) in [("plain", &plain), ("mirrored", &mirrored), ("beyond", &beyond), ("none", &none)] {
        // Drops lie on both halves, and the chart's u tells on which: it grows across the leaf, linearly.
        let (first, last) = (baked.drops.first().expect("drops"), baked.drops.last().expect("drops"));
        assert!(first[0].is_finite() && last[0].is_finite());
        let [left, right] = [false, true].map(|right| baked.drops.iter().filter(|d| (d[0] > 0.5) == right).count());
        assert!(left * 4 > baked.drops.len() && right * 4 > baked.drops.len(), "{name}: {left} {right}");
        let across = |d: &[f64; 5], axis: usize| d[2 + axis];
        let spread = |axis: usize| {
            let all = baked.drops.iter().map(|d| across(d, axis));
            all.clone().fold(f64::MIN, f64::max) - all.fold(f64::MAX, f64::min)
        };
        // The horizontal axis across the leaf is the one along which drops are spread over 40 x 160 / 80 mm by their u.
        let fits = (0..3).any(|axis| {
            let scale = if name == "plain" { 0.08 } else { 0.08 / (1.0 - 1.0 / 32.0) };
            let offset = |d: &[f64; 5], sign: f64| across(d, axis) - sign * scale * d[0];
            [1.0, -1.0].iter().any(|sign| {
                let all = baked.drops.iter().map(|d| offset(d, *sign));
                spread(axis) > 0.04 && all.clone().fold(f64::MIN, f64::max) - all.fold(f64::MAX, f64::min) < 1e-4
            })
        });
        assert!(fits, "{name}: u and position across the leaf belong together");
    }
    // The picture of the mirrored leaf is drawn anew: red grows from the middle to either side.
    let picture =
        image::open(dir.path().join("mirrored/out/textures").join(redrawn(&dir.path().join("mirrored/out/textures"))))
            .expect("picture")
            .into_rgb8();
    let (w, h) = picture.dimensions();
    let red = |share: f64| f64::from(picture.get_pixel((f64::from(w) * share) as u32, h / 2)[0]);
    assert!(red(0.5) < 20.0 && red(0.04) > 225.0 && red(0.96) > 225.0, "{} {} {}", red(0.04), red(0.5), red(0.96));
    assert!((red(0.27) - red(0.73)).abs() < 10.0 && (red(0.27) - 122.0).abs() < 16.0, "{} {}", red(0.27), red(0.73));
    let green = |share: f64| f64::from(picture.get_pixel(w / 4, (f64::from(h) * share) as u32)[1]);
    assert!(green(0.04) > 235.0 && green(0.96) < 20.0, "{} {}", green(0.04), green(0.96));
    let Some(python) = clients::python() else { return };
    for name in ["plain", "mirrored", "beyond", "none"] {
        assert!(wetness(&python, dir.path(), name).iter().all(|w| *w > 0.5), "{name}");
    }
    let said = clients::python_script(&python, "materials.py", &[arg(&dir.path().join("mirrored/out/wet.usda"))]);
    let text = String::from_utf8_lossy(&said.stdout).into_owned();
    let line = text.lines().rev().find(|l| l.starts_with('{')).expect("a report");
    let seen: serde_json::Value = serde_json::from_str(line).expect("JSON");
    let file = redrawn(&dir.path().join("mirrored/out/textures"));
    assert_eq!(
        (&seen["p_l0000"]["Base Color"], &seen["p_l0000"]["Coat Weight"]),
        (&file.into(), &"wetness.0001.exr".into())
    );
}

/// The texture that was drawn anew.
fn redrawn(textures: &Path) -> String {
    let names = fs::read_dir(textures).expect("textures").filter_map(Result::ok);
    let mut names = names.map(|e| e.file_name().to_string_lossy().into_owned());
    names.find(|n| n.contains("_chart0")).expect("a texture over the chart")
}

/// Teeth without a depth of their own do not fold, however many there are.
#[test]
fn many_teeth_are_as_shallow_as_they_need_to_be() {
    let dir = tempfile::tempdir().expect("dir");
    for keys in ["lobes = 40\nminor_teeth = 0", "lobes = 40\nminor_teeth = 2", "lobes = 60\nminor_teeth = 1"] {
        let scene = format!(
            "seed = 5\n[frames]\nend = 2\nfps = 48\n[plants.leaf]\ngrammar = \"rain-twig.l\"\nsteps = 2\n\
             set = {{ LEAVES = 4, LENGTH = 0.06, GIRTH = 0.003, DROOP = 26, RISE = 88 }}\n[plants.leaf.leaf]\n\
             blade = \"toothed\"\nsize = 0.09\nwidth = 0.56\ndetail = \"close\"\n{keys}\n[rain]\nfalls = false\n\
             [output]\nformats = [\"usd\"]\n"
        );
        let file = dir.path().join("teeth.toml");
        fs::write(&file, scene).expect("written");
        let (_, said) = ends(0, &["check", arg(&file)]);
        assert!(!said.contains("X022"), "{keys}: {said}");
    }
}

/// The leaves of the program's own scenes have texture coordinates that drops can use. Drops are left out, whose meshes count too.
#[test]
fn leaves_of_the_paper_have_their_own_charts() {
    for (scene, triangles) in [(1, "4,476"), (2, "3,050"), (3, "3,524")] {
        let scene_name = format!("rain-table-{scene}");
        let (out, said) = ends(0, &["check", "--strict", &scene_name, "--set", "rain.falls=false"]);
        assert!(!said.contains("X022") && out.contains(&format!("triangles    {triangles}")), "{scene}: {out}{said}");
    }
}
