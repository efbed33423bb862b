//! Places through whole bakes: terrain of files, lines, outlines and masks, and what is said about those that do not work.
#![allow(
    clippy::expect_used,
    clippy::disallowed_methods,
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "tests run the program and read its files, whose numbers are small and known"
)]

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use glam::Vec3;
use image::{ImageBuffer, Luma};
use osier::scene::AssetKind;
use serde_json::Value;

use crate::common::grown;
use osier::bake::scene::SceneOptions;
use osier::recipe::{Library, Recipe, Request, resolve};

/// A tree of a few hundred triangles.
const TREE: &str = "[plants.tree]\nifs = \"pseudodichotomous.ifs.toml\"\n[plants.tree.tree]\nheight = 5\neps = 0.4\n\
    leaf_density = 0\n[plants.tree.bark]\nside = 16\n[plants.tree.shoot]\nside = 16\n";

fn osier(arguments: &[&str]) -> (Option<i32>, String) {
    let run = Command::new(env!("CARGO_BIN_EXE_osier")).args(arguments).output().expect("osier runs");
    (run.status.code(), String::from_utf8_lossy(&run.stderr).into_owned())
}

fn scene(folder: &Path, name: &str, text: &str) -> PathBuf {
    let path = folder.join(format!("{name}.toml"));
    fs::write(&path, text).expect("scene");
    path
}

fn baked(folder: &Path, name: &str, text: &str) -> PathBuf {
    let (path, out) = (scene(folder, name, text), folder.join(name));
    let arguments = ["-q", "bake", path.to_str().expect("path"), "-o", out.to_str().expect("path")];
    let (code, said) = osier(&arguments);
    assert_eq!(code, Some(0), "{name}: {said}");
    out
}

fn recipe(folder: &Path, text: &str) -> Recipe {
    let library = Library::new(&folder.join("s.toml"), &[]).expect("folder");
    let request = Request { name: "s".into(), text: text.into(), library, ..Request::default() };
    let mut recipe = resolve(&request).unwrap_or_else(|e| panic!("{e}")).0;
    grown::small(&mut recipe);
    recipe.terrain.iter_mut().for_each(|t| t.keys.side = 16);
    recipe
}

/// The height of the test's land at x, z: level at 2 m for x < 0, then a slope of 1 in 4, and a step of 3 m at z > 20.
fn height(x: f64, z: f64) -> f64 {
    2.0 + x.max(0.0) / 4.0 + if z > 20.0 { 3.0 } else { 0.0 }
}

/// That land as a picture of 16 bits over 80 x 60 m, 0.25 m between pixels, from 0 m (black) to 20 m (white).
fn write_map(path: &Path) {
    let picture = ImageBuffer::<Luma<u16>, Vec<u16>>::from_fn(321, 241, |i, j| {
        let (x, z) = (f64::from(i) * 0.25 - 40.0, f64::from(j) * 0.25 - 30.0);
        Luma([(height(x, z) / 20.0 * 65_535.0).round() as u16])
    });
    picture.save(path).expect("png");
}

/// That land as a mesh with Z up, 0.5 m between points, and a slab at 12 m over (-20, -20).
fn write_mesh(path: &Path, with_slab: bool) {
    use std::fmt::Write as _;
    let mut text = "mtllib hills.mtl\nusemtl grass\n".to_owned();
    fs::write(path.with_extension("mtl"), "newmtl grass\nKd 0.2 0.4 0.1\n").expect("mtl");
    for j in 0..121_u32 {
        for i in 0..161_u32 {
            let (x, z) = (f64::from(i) * 0.5 - 40.0, f64::from(j) * 0.5 - 30.0);
            writeln!(text, "v {x} {} {}", -z, height(x, z)).expect("text");
            writeln!(text, "vt {} {}", f64::from(i) / 160.0, 1.0 - f64::from(j) / 120.0).expect("text");
        }
    }
    for j in 0..120 {
        for i in 0..160 {
            let a = j * 161 + i + 1;
            let quad = [a, a + 161, a + 162, a + 1].map(|v| format!("{v}/{v}"));
            writeln!(text, "f {}", quad.join(" ")).expect("text");
        }
    }
    if with_slab {
        text += "v -22 22 12\nv -18 22 12\nv -18 18 12\nv -22 18 12\nf -4/1 -3/1 -2/1 -1/1\n";
    }
    fs::write(path, text).expect("obj");
}

/// Feet of the plants of a scene, m.
fn feet(folder: &Path, text: &str) -> Vec<Vec3> {
    let stage = grown::stage(&recipe(folder, text), SceneOptions::default());
    let scene = &stage.animated.scene;
    let plants = scene.placements.iter().filter(|p| scene.assets[p.asset].kind == AssetKind::Plant);
    plants.map(|p| p.transform.t).collect()
}

#[test]
fn plants_stand_on_the_terrain_of_a_file() {
    let dir = tempfile::tempdir().expect("dir");
    write_map(&dir.path().join("hills.png"));
    write_mesh(&dir.path().join("hills.obj"), true);
    let map = "[terrain]\nfile = \"hills.png\"\nsize = 80\nheight = 20\n";
    let mesh = "[terrain]\nfile = \"hills.obj\"\nmesh_up = \"z\"\nsubdivisions = 7\n";
    let level = "[[place]]\nplant = \"tree\"\nat = [-20, 0, 10]\n[[place]]\nplant = \"tree\"\nat = [-15, 0, 26]\n\
                 [[place]]\nplant = \"tree\"\nat = [20, 0, -10]\n[[place]]\nplant = \"tree\"\nat = [-20, 0, -20]\n";
    let scattered = "[[scatter]]\nplants = { tree = 1 }\nspacing = 8\nindividuals = 1\n";
    for (kind, land) in [("map", map), ("mesh", mesh)] {
        let feet = feet(dir.path(), &format!("{TREE}{land}{level}{scattered}"));
        // On level land a foot is 2 cm deep, on the slab too where there is one.
        let slab = if kind == "mesh" { 12.0 } else { 2.0 };
        for (i, wanted) in [(0, 2.0), (1, 5.0), (3, slab)] {
            let deep: f32 = wanted - feet[i].y;
            assert!((deep - 0.02).abs() < 1e-3, "{kind}: {deep} m deep at {}", feet[i]);
        }
        // On the slope and everywhere else no foot is above the land, nor more than its own radius below it.
        assert!(feet.len() > 40, "{kind}: {}", feet.len());
        for p in feet.iter().filter(|p| (p.z - 20.0).abs() > 0.6 && (p.x + 20.0).abs().max((p.z + 20.0).abs()) > 2.5) {
            let deep = height(p.x.into(), p.z.into()) - f64::from(p.y);
            assert!((0.015..0.25).contains(&deep), "{kind}: {deep} m deep at {p}");
        }
    }
}

#[test]
fn a_terrain_read_from_its_own_heights_is_the_same() {
    let dir = tempfile::tempdir().expect("dir");
    let land = "subdivisions = 5\nsize = 60\namplitude = 9\nside = 16\n";
    let out =
        baked(dir.path(), "made", &format!("seed = 3\n[terrain]\n{land}[output]\nformats = [\"exr\", \"obj\"]\n"));
    fs::copy(out.join("maps/terrain/height.exr"), dir.path().join("own.exr")).expect("copy");
    let again = baked(
        dir.path(),
        "read",
        "seed = 3\n[terrain]\nfile = \"own.exr\"\nsize = 60\nside = 16\n[output]\nformats = [\"exr\", \"obj\"]\n",
    );
    let mesh = |out: &Path| {
        let text = fs::read_to_string(out.join("obj/terrain.obj")).expect("obj");
        text.lines().filter(|l| !l.starts_with('#')).map(str::to_owned).collect::<Vec<_>>()
    };
    assert!(mesh(&out).len() > 3000);
    assert_eq!(mesh(&out), mesh(&again), "points, normals, texture coordinates and faces");
    // Turned by `at` and `offset`: the same land elsewhere.
    let moved = baked(
        dir.path(),
        "moved",
        "seed = 3\n[terrain]\nfile = \"own.exr\"\nsize = 60\nat = [100, -50]\noffset = 7\nscale = 2\nside = 16\n\
         [output]\nformats = [\"obj\"]\n",
    );
    let points = |lines: Vec<String>| -> Vec<[f64; 3]> {
        let point = |l: &str| {
            let v: Vec<f64> = l[2..].split(' ').map(|v| v.parse().expect("number")).collect();
            [v[0], v[1], v[2]]
        };
        lines.iter().filter(|l| l.starts_with("v ")).map(|l| point(l)).collect()
    };
    for (a, b) in points(mesh(&out)).iter().zip(points(mesh(&moved))) {
        let wanted = [a[0] + 100.0, a[1] * 2.0 + 7.0, a[2] - 50.0];
        assert!(wanted.iter().zip(b).all(|(w, b)| (w - b).abs() < 2e-4), "{a:?} {b:?}");
    }
}

#[test]
fn a_mesh_is_exported_with_its_coordinates_and_material() {
    let dir = tempfile::tempdir().expect("dir");
    write_mesh(&dir.path().join("hills.obj"), false);
    let text = "[terrain]\nfile = \"hills.obj\"\nmesh_up = \"z\"\n[output]\nformats = [\"obj\", \"exr\"]\n";
    let out = baked(dir.path(), "mesh", text);
    let obj = fs::read_to_string(out.join("obj/terrain.obj")).expect("obj");
    let count = |start: &str| obj.lines().filter(|l| l.starts_with(start)).count();
    assert_eq!((count("f "), count("vt ")), (2 * 160 * 120, 161 * 121));
    assert!(obj.contains("usemtl terrain_grass"), "the material of the file");
    let manifest: Value =
        serde_json::from_slice(&fs::read(out.join("manifest.json")).expect("manifest")).expect("json");
    let asset = manifest["assets"].as_array().expect("assets").iter().find(|a| a["id"] == "terrain").expect("terrain");
    assert_eq!((&asset["kind"], &asset["triangles"]), (&Value::from("terrain"), &Value::from(38_400)));
    assert!((asset["bounds"][1][1].as_f64().expect("number") - 15.0).abs() < 1e-3, "{}", asset["bounds"]);
    // Painted, its coordinates are shares of the way over the land.
    let text = text.replace("mesh_up", "paint = true\nside = 16\nmesh_up");
    let obj = fs::read_to_string(baked(dir.path(), "painted", &text).join("obj/terrain.obj")).expect("obj");
    assert!(obj.contains("usemtl terrain\n") && obj.lines().any(|l| l.starts_with("vt 0.5 0.5")));
}

#[test]
fn seeds_land_on_the_terrain_of_a_file() {
    let dir = tempfile::tempdir().expect("dir");
    write_map(&dir.path().join("hills.png"));
    write_mesh(&dir.path().join("hills.obj"), false);
    for (kind, land) in [
        ("map", "file = \"hills.png\"\nsize = 80\nheight = 20\n"),
        ("mesh", "file = \"hills.obj\"\nmesh_up = \"z\"\nsubdivisions = 8\n"),
    ] {
        let text = format!(
            "[frames]\nend = 121\n[terrain]\n{land}side = 16\n[catkin]\nlod = 3\nhairs = 12\n[flight]\ncount = 200\n\
             fall_speed = 2.5\nsize = [50, 14, 50]\nband = [0.8, 0.95]\nhumidity = 1\n[wind]\nspeed = 0\n\
             [output]\nformats = [\"points\"]\n"
        );
        let out = baked(dir.path(), kind, &text);
        let table = fs::read_to_string(out.join("points/catkins_0121.csv")).expect("points");
        let names: Vec<&str> =
            table.lines().next().expect("header").split(',').map(|n| n.split(':').next().expect("name")).collect();
        let column =
            |name: &str| names.iter().position(|n| *n == name).unwrap_or_else(|| panic!("{name} in {names:?}"));
        let at = [column("x"), column("y"), column("z")];
        let mut landed = 0;
        for line in table.lines().skip(1) {
            let row: Vec<&str> = line.split(',').collect();
            // Points have Blender's axes: Z up.
            let [x, north, y] = at.map(|i| row[i].parse::<f64>().expect("number"));
            let z = -north;
            // Away from the step, whose face the samples of a mesh lean.
            if (z - 20.0).abs() < 1.0 || x.abs() > 24.5 || z.abs() > 24.5 {
                continue;
            }
            landed += usize::from((y - height(x, z)).abs() < 0.03);
            assert!(y > height(x, z) - 0.02, "{kind}: below the land at {x} {y} {z}");
        }
        assert!(landed > 130, "{kind}: {landed} of 200 lie on the land");
    }
}
