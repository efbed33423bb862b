//! Places through whole bakes: terrain of files, lines, outlines and masks, and what is said about those that do not work.
#![allow(
    clippy::expect_used,
    clippy::disallowed_methods,
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "tests run the program and read its files, whose numbers are small and known"
)]

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use glam::Vec3;
use image::{ImageBuffer, Luma, Rgb};
use osier::scene::AssetKind;
use serde_json::Value;

use crate::common::grown;
use crate::common::picture::vertex_colors_of_ply;
use osier::bake::scene::SceneOptions;
use osier::export::Exporter as _;
use osier::export::file_target::FileTarget;
use osier::export::ply::PlyExporter;
use osier::files::Folder;
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
fn heights_from_zero_are_absolute() {
    let dir = tempfile::tempdir().expect("dir");
    write_map(&dir.path().join("hills.png"));
    let terrain = "[terrain]\nfile = \"hills.png\"\nsize = 80\nheight = 20\n";
    let wavy = "[ground]\nrelief = 1\nside = 16\n";
    let places = |datum: &str| {
        format!(
            "[[place]]\nplant = \"tree\"\nat = [20, 9.5, -10]\n{datum}[[place]]\nplant = \"tree\"\nat = [-20, 3, 0]\n\
             along = [[0, 0, 0], [10, 1, 0]]\ncount = 3\nindividuals = 1\n{datum}[[place]]\nplant = \"tree\"\nat = [-90, 4, 0]\n{datum}"
        )
    };
    for (kind, land) in [("terrain", terrain), ("ground", wavy)] {
        let heights = |datum: &str| -> Vec<f32> {
            feet(dir.path(), &format!("{TREE}{land}{}", places(datum))).iter().map(|p| p.y).collect()
        };
        let absolute = heights("height_from = \"zero\"\n");
        let wanted = [9.5, 3.0, 3.5, 4.0, 4.0];
        assert!(absolute.len() == 5 && absolute.iter().zip(wanted).all(|(a, b)| (a - b).abs() < 1e-5), "{absolute:?}");
        // Without the key they count from the land, as they do with its default.
        let above = heights("");
        assert_eq!(above, heights("height_from = \"ground\"\n"));
        assert!(above.iter().zip(&absolute).any(|(a, b)| (a - b).abs() > 0.1), "{kind}: {above:?}");
    }
    // Beyond the edge of the terrain only heights above it are uncertain.
    let text = |datum: &str| format!("{TREE}{terrain}{}", places(datum));
    for (datum, warned) in [("height_from = \"zero\"\n", false), ("", true)] {
        let path = scene(dir.path(), "edge", &text(datum));
        let out = dir.path().join("edge");
        let (code, said) =
            osier(&["bake", path.to_str().expect("path"), "--dry-run", "-o", out.to_str().expect("path")]);
        assert_eq!((code, said.contains("S037")), (Some(0), warned), "{said}");
    }
    let path = scene(dir.path(), "wrong", &text("height_from = \"sea\"\n"));
    let (code, said) = osier(&["check", path.to_str().expect("path")]);
    assert!(code != Some(0) && said.contains("wrong.toml:") && said.contains("\"zero\""), "{said}");
}

#[test]
fn a_terrain_read_from_its_own_heights_is_the_same() {
    let dir = tempfile::tempdir().expect("dir");
    let land = "subdivisions = 5\nsize = 60\namplitude = 9\nside = 16\n";
    let out =
        baked(dir.path(), "made", &format!("seed = 3\n[terrain]\n{land}[output]\nformats = [\"exr\", \"obj\"]\n"));
    fs::copy(out.join("maps/terrain/height.exr"), dir.path().join("own.exr")).expect("copy");
    // The manifest lists them as a file, not as the relief of the material that has the terrain's name.
    let manifest = fs::read_to_string(out.join("manifest.json")).expect("manifest");
    let manifest: Value = serde_json::from_str(&manifest).expect("JSON");
    let lists = |list: &str, key: &str| {
        let entries = manifest[list].as_array().expect("list").iter();
        entries.filter(|e| e[key].to_string().contains("maps/terrain/height.exr")).count()
    };
    assert_eq!((lists("files", "path"), lists("materials", "maps")), (1, 0));
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
            "[frames]\nend = 145\n[terrain]\n{land}side = 16\n[catkin]\nlod = 3\nhairs = 12\n[flight]\ncount = 200\n\
             fall_speed = 2.5\nsize = [50, 14, 50]\nband = [0.8, 0.95]\nhumidity = 1\n[wind]\nspeed = 0\n\
             [output]\nformats = [\"points\"]\n"
        );
        let out = baked(dir.path(), kind, &text);
        let table = fs::read_to_string(out.join("points/catkins_0145.csv")).expect("points");
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

/// Velocities of a slice of the wind, m/s, row by row from -z, with its width in texels.
fn slice(path: &Path) -> (usize, Vec<[f32; 3]>) {
    use exr::prelude::*;
    let read = read_first_rgba_layer_from_file(
        path,
        |size, _| (size, vec![[0.0_f32; 3]; size.area()]),
        |(size, texels), at, (r, g, b, _): (f32, f32, f32, f32)| texels[at.y() * size.width() + at.x()] = [r, g, b],
    );
    let (size, texels) = read.expect("EXR").layer_data.channel_data.pixels;
    (size.width(), texels)
}

#[test]
fn a_lattice_wind_is_blocked_by_the_terrain_of_a_file() {
    let dir = tempfile::tempdir().expect("dir");
    // A dam of 3 m along z, 3 m wide at its crest, on a plain; 0.5 m between heights.
    let dam = ImageBuffer::<Luma<u16>, Vec<u16>>::from_fn(81, 81, |i, _| {
        let x = (f64::from(i) * 0.5 - 20.0).abs();
        Luma([((2.5 - x).clamp(0.0, 1.0) * 65_535.0) as u16])
    });
    dam.save(dir.path().join("dam.png")).expect("png");
    let text = "seed = 2\n[frames]\nend = 49\n[terrain]\nfile = \"dam.png\"\nsize = 40\nheight = 3\nside = 16\n[wind]\nmodel = \"lattice\"\n\
                speed = 3\n[wind.lattice]\ncells = [44, 16, 24]\ndx = 0.5\n[output]\nformats = [\"obj\"]\n[output.wind]\n\
                texel = 0.5\n[[output.wind.slice]]\nat = 1\nevery = 12\n";
    let out = baked(dir.path(), "dam", text);
    let (mut inside, mut before, mut behind) = (0.0_f32, Vec::new(), Vec::new());
    for frame in [25, 37, 49] {
        let (width, texels) = slice(&out.join("wind").join(format!("y1.{frame:04}.exr")));
        for (k, u) in texels.iter().enumerate() {
            let x = ((k % width) as f64 + 0.5) * 0.5 - 11.0;
            match x {
                x if x.abs() < 1.0 => inside = inside.max(Vec3::from_array(*u).length()),
                x if (-8.0..-6.0).contains(&x) => before.push(u[0]),
                x if (3.0..5.0).contains(&x) => behind.push(u[0]),
                _ => {}
            }
        }
    }
    let mean = |v: &[f32]| v.iter().sum::<f32>() / v.len() as f32;
    assert!(inside < 1e-3, "{inside} m/s inside the dam");
    assert!(mean(&before) > 0.8 && mean(&behind) < 0.4 * mean(&before), "{} {}", mean(&before), mean(&behind));
}

#[test]
fn a_changed_file_changes_the_hash() {
    let dir = tempfile::tempdir().expect("dir");
    let text = "[terrain]\nfile = \"hills.png\"\n[[place]]\nplant = \"tree\"\narea = [4, 4]\nmask = \"mask.png\"\n";
    let text = format!("{TREE}{text}");
    let write = |name: &str, value: u16| {
        ImageBuffer::<Luma<u16>, _>::from_pixel(3, 3, Luma([value])).save(dir.path().join(name)).expect("png");
    };
    write("hills.png", 500);
    write("mask.png", 60_000);
    let first = recipe(dir.path(), &text).hash;
    assert_eq!(first, recipe(dir.path(), &text).hash);
    write("hills.png", 501);
    let second = recipe(dir.path(), &text).hash;
    write("mask.png", 50_000);
    assert!(first != second && second != recipe(dir.path(), &text).hash);
}

/// Severity, words of the message and of the help for scenes that are refused or have keys without effect.
#[test]
fn each_fault_of_a_place_is_named_with_its_mend() {
    let dir = tempfile::tempdir().expect("dir");
    let picture = |name: &str, value: u16| {
        ImageBuffer::<Luma<u16>, _>::from_pixel(3, 3, Luma([value])).save(dir.path().join(name)).expect("png");
    };
    picture("hills.png", 500);
    picture("black.png", 0);
    ImageBuffer::<Luma<u8>, _>::from_pixel(3, 3, Luma([9])).save(dir.path().join("coarse.png")).expect("png");
    fs::write(dir.path().join("broken.png"), b"\x89PNG\r\n\x1a\n").expect("write");
    fs::write(dir.path().join("wall.obj"), "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").expect("write");
    fs::write(dir.path().join("flat.obj"), "v 0 0 0\nv 1 0 0\nv 0 0 -1\nf 1 2 3\n").expect("write");
    fs::write(dir.path().join("empty.obj"), "").expect("write");
    let oak = "[plants.a]\nspecies = \"oak\"\nage = 3\n";
    let wood = |more: &str| format!("{oak}{more}");
    let cases = [
        // Terrain.
        ("missing", "[terrain]\nfile = \"no.png\"\n".to_owned(), "error[S005]", "no.png"),
        ("ending", "[terrain]\nfile = \"hills.tif\"\n".into(), "error[S005]", "expected a file .png, .exr"),
        ("broken", "[terrain]\nfile = \"broken.png\"\n".into(), "error[X010]", "broken.toml:2"),
        ("empty", "[terrain]\nfile = \"empty.obj\"\n".into(), "error[X010]", "empty.obj"),
        ("coarse", "[terrain]\nfile = \"coarse.png\"\n".into(), "warning[X026]", "smooth = 3"),
        ("generated", "[terrain]\nfile = \"hills.png\"\namplitude = 3\n".into(), "warning[S007]", "terrain.amplitude"),
        ("scale", "[terrain]\nfile = \"hills.png\"\nscale = 3\n".into(), "warning[S007]", "see height"),
        ("offset", "[terrain]\noffset = 3\n".into(), "warning[S007]", "file = \"hills.png\""),
        ("colour", "[terrain]\nfile = \"flat.obj\"\ncover = 1\n".into(), "warning[S007]", "paint = true"),
        // Lines and areas.
        ("regions", format!("{TREE}[[place]]\nring = 3\noutline = [2, 2]\n"), "error[S003]", "both outline and ring"),
        (
            "both",
            format!("{TREE}[[place]]\nring = 3\ncount = 4\nspacing = 2\n"),
            "error[S003]",
            "both count and spacing",
        ),
        ("neither", format!("{TREE}[[place]]\nring = 3\n"), "error[S006]", "spacing = 0.5"),
        ("point", format!("{TREE}[[place]]\nalong = [[1, 0, 1]]\ncount = 2\n"), "error[S003]", "two corners"),
        ("many", format!("{TREE}[[place]]\nring = 9000\nspacing = 0.1\n"), "error[S004]", "larger spacing"),
        ("jitter", format!("{TREE}[[place]]\njitter = 1\n"), "warning[S007]", "along, outline or ring"),
        ("mask", format!("{TREE}[[place]]\nmask = \"hills.png\"\n"), "error[S006]", "add area"),
        ("black", format!("{TREE}[[place]]\narea = [3, 3]\nmask = \"black.png\"\n"), "error[S003]", "black everywhere"),
        // Species and their places.
        ("sources", wood("grammar = \"oak.l\"\n"), "error[S003]", "both grammar and species"),
        (
            "turtle",
            wood("steps = 3\n[plants.a.turtle]\n"),
            "warning[S007]",
            "plants.a.turtle has no effect on a species",
        ),
        ("years", wood("[plants.a.habit]\nmaturity = [30]\n"), "error[S003]", "= help: write 2 numbers"),
        ("orders", wood("[plants.a.habit]\nangle = []\n"), "error[S003]", "number for each order of axes"),
        ("segment", wood("[plants.a.skin]\nsegment = \"q\"\n"), "error[S003]", "its organs are \"l\""),
        (
            "shared",
            wood("[plants.a.site]\nsolids = true\n[[place]]\ncount = 5\nindividuals = 2\n"),
            "error[S003]",
            "individuals = 5",
        ),
        (
            "skies",
            wood(
                "[plants.b]\nspecies = \"birch\"\n[plants.b.site]\nside = [0.5, 0, 0]\n[[place]]\nplant = \"a\"\n\
                 together = true\n[[place]]\nplant = \"b\"\ntogether = true\n",
            ),
            "error[S003]",
            "plants.b.site differs from plants.a.site",
        ),
        (
            // A plant without a table of its own for the site is shown by its table.
            "sky",
            wood(
                "[plants.a.site]\nside = [0.5, 0, 0]\n[plants.b]\nspecies = \"birch\"\n[[place]]\nplant = \"a\"\n\
                 together = true\n[[place]]\nplant = \"b\"\ntogether = true\n",
            ),
            "error[S003]",
            "^^^^^^^^^^ another site",
        ),
        (
            "stem",
            wood("[[plants.a.prune]]\nkeep = [[-1, 0, -1], [1, 1.8, 1]]\n"),
            "warning[S038]",
            "a plant that is cut at 1.8 m",
        ),
        ("tall", wood("[plants.a.habit]\nclear_stem = 40\n"), "warning[S038]", "takes away the branches below 40 m"),
        (
            "keep",
            wood("[[plants.a.prune]]\nkeep = \"hosue\"\n[[solid]]\nname = \"house\"\n"),
            "error[S005]",
            "did you mean \"house\"?",
        ),
        ("keeps", wood("[[plants.a.prune]]\nkeep = \"a\"\nsolid = \"a\"\n"), "error[S003]", "by keep and by solid"),
    ];
    for (name, text, code, words) in cases {
        let path = scene(dir.path(), name, &text);
        let (status, said) = osier(&["check", path.to_str().expect("path")]);
        assert_eq!(status, Some(i32::from(code.starts_with("error"))), "{name}: {said}");
        assert!(said.contains(code) && said.contains(words), "{name}: {said}");
        assert!(said.contains(".toml:") || said.contains("empty.obj"), "{name} has no place: {said}");
    }
    // A fault of a region is told once, by the key that has it.
    for region in ["ring = -3", "outline = [\"a\", 2]", "outline = [0, 2]"] {
        let path = scene(dir.path(), "region", &format!("{TREE}[[place]]\n{region}\nspacing = 2\n"));
        let (status, said) = osier(&["check", path.to_str().expect("path")]);
        assert_eq!((status, said.matches("error[").count(), said.contains("along")), (Some(1), 1, false), "{said}");
    }
    // What only the terrain's heights tell.
    let wall = scene(dir.path(), "upright", "[terrain]\nfile = \"wall.obj\"\n");
    let (status, said) = osier(&["check", wall.to_str().expect("path")]);
    assert!(status == Some(1) && said.contains("X010") && said.contains("mesh_up"), "{said}");
    let far = scene(dir.path(), "far", &format!("{TREE}[terrain]\nsize = 20\n[[place]]\nat = [30, 0, 0]\n"));
    let (status, said) = osier(&["check", far.to_str().expect("path")]);
    assert!(status == Some(0) && said.contains("S037") && said.contains("1 plant of [[place]] stands"), "{said}");
    let scatter = "[terrain]\nsize = 20\n[[scatter]]\nplants = { tree = 1 }\nradius = 5\n";
    let none = scene(dir.path(), "none", &format!("{TREE}{scatter}inner = 8\n"));
    let sets = [("scatter.0.fade=0.3", true), ("scatter.0.max_count=0", false), ("scatter.0.inner=1", false)];
    for (set, warned) in sets {
        let (status, said) = osier(&["check", none.to_str().expect("path"), "--set", set]);
        assert_eq!((status, said.contains("scatter.0 places no plant")), (Some(0), warned), "{set}: {said}");
    }
}

#[test]
fn a_cut_to_a_solid_is_named_by_keep() {
    let dir = tempfile::tempdir().expect("dir");
    let text = |key: &str| {
        format!(
            "[plants.a]\nspecies = \"hazel\"\nage = 4\n[[plants.a.prune]]\nyear = 3\n{key} = \"tub\"\n[[solid]]\nname = \"tub\"\nsize = [1, 1, 1]\n"
        )
    };
    let of = |key: &str| {
        let stage = grown::stage(&recipe(dir.path(), &text(key)), SceneOptions::default());
        stage.animated.scene.assets[0].meshes[0].mesh.points.clone()
    };
    assert!(of("keep").len() > 100 && of("keep") == of("solid"));
}

/// A tree that grows round solids has the terrain as its ground: below the level of the scene it grows as on it.
#[test]
fn trees_round_solids_grow_at_any_height_of_the_terrain() {
    let dir = tempfile::tempdir().expect("dir");
    let bark = |y: i32| {
        let text = format!(
            "[terrain]\nsize = 60\namplitude = 0\nsubdivisions = 4\ncorners = [{y}, {y}, {y}, {y}]\n[plants.a]\nspecies = \"oak\"\nage = 9\n\
             [plants.a.site]\nsolids = true\n[[place]]\nat = [3, 0, 2]\n[[solid]]\nname = \"wall\"\nat = [4, {y}, 2]\nsize = [0.3, 4, 8]\n"
        );
        let stage = grown::stage(&recipe(dir.path(), &text), SceneOptions::default());
        let points = &stage.animated.scene.assets[0].meshes[0].mesh.points;
        (points.len(), points.iter().fold(0.0, |h: f32, p| h.max(p.y)))
    };
    let ((level, height), (below, height_below)) = (bark(0), bark(-16));
    assert!(
        height > 1.5 && level.abs_diff(below) * 50 < level && (height - height_below).abs() < 0.05,
        "{level} {below} {height} {height_below}"
    );
}

/// Trees round solids grow on the mesh of the terrain, not on the heights that it leaves out: the valley between two triangles is
/// filled by the heights between their corners, 2.3 m deep where the tree stands. Its slopes of 23
/// degrees take no light from a seedling, whose lowest directions of light are at 25 degrees.
#[test]
fn trees_round_solids_grow_on_the_terrain_that_is_shown() {
    let dir = tempfile::tempdir().expect("dir");
    let text = "[terrain]\nsize = 20\namplitude = 0\nsubdivisions = 3\nstride = 8\ncorners = [6, 0, 0, 6]\n\
        [plants.a]\nspecies = \"oak\"\nage = 9\n[plants.a.site]\nsolids = true\n[[place]]\nat = [1.5, 0, 1]\n\
        [[solid]]\nname = \"wall\"\nat = [4, 0, 2]\nsize = [0.3, 4, 8]\n";
    let stage = grown::stage(&recipe(dir.path(), text), SceneOptions::default());
    let points = &stage.animated.scene.assets[0].meshes[0].mesh.points;
    assert!(points.len() > 500 && points.iter().any(|p| p.y > 1.5), "{}", points.len());
}

#[test]
fn a_new_folder_holds_what_its_scene_names() {
    let dir = tempfile::tempdir().expect("dir");
    // Of a species its leaf and bark come with it.
    let birch = dir.path().join("birch");
    let (status, said) = osier(&["new", birch.to_str().expect("path"), "--from", "birch.species"]);
    let text = fs::read_to_string(birch.join("birch.toml")).unwrap_or_default();
    assert!(status == Some(0) && text.contains("[plants.birch.leaf]") && text.contains("scarred"), "{said}{text}");
    let cases = [
        ("tree", vec!["new.toml", "tree.shapes"]),
        ("oak-grown", vec!["new.toml", "oak.species"]),
        ("hazel.species", vec!["new.toml", "hazel.species"]),
        ("vine.shapes", vec!["new.toml", "vine.shapes"]),
        (
            "landscape",
            vec![
                "new.toml",
                "ash.species",
                "birch.species",
                "grass.l",
                "linden.species",
                "maple.species",
                "oak.species",
            ],
        ),
    ];
    for (preset, wanted) in cases {
        let folder = dir.path().join(preset).join("new");
        let (status, said) = osier(&["new", folder.to_str().expect("path"), "--from", preset]);
        assert_eq!(status, Some(0), "{preset}: {said}");
        let mut made: Vec<String> = fs::read_dir(&folder)
            .expect("folder")
            .map(|e| e.expect("entry").file_name().into_string().expect("name"))
            .collect();
        made.sort();
        let mut wanted = wanted;
        wanted.sort_unstable();
        assert_eq!(made, wanted, "{preset}");
    }
    let scene = dir.path().join("hazel.species/new/new.toml");
    let (status, said) = osier(&["check", scene.to_str().expect("path")]);
    assert_eq!(status, Some(0), "{said}");
}

/// A plant, a cloud and a solid with the names of the drops, the catkins and the ground, and a cloud with that of an individual.
#[test]
fn assets_that_the_scene_adds_share_no_name_with_others() {
    let dir = tempfile::tempdir().expect("dir");
    let rain = TREE.replace("plants.tree", "plants.rain");
    let text = format!(
        "seed = 3\n[frames]\nend = 2\n[wind]\nspeed = 2\n{rain}{TREE}[[place]]\nplant = \"rain\"\n\
         [[place]]\nplant = \"tree\"\ncount = 2\nradius = 4\n[clouds.tree_1]\nifs = \"fern_leaf.ifs\"\npoints = 50\n\
         [clouds.catkins]\nifs = \"fern_leaf.ifs\"\npoints = 60\n\
         [clouds.water]\nifs = \"fern_leaf.ifs\"\npoints = 40\n[[solid]]\nname = \"ground\"\nat = [6, 0, 0]\nsize = [1, 1, 1]\n\
         [rain]\nrate_mm_per_h = 2\n[catkin]\nhairs = 4\n[flight]\ncount = 5\nspin_up_s = 1\nsize = [16, 8, 16]\n\
         [output]\nformats = [\"usd\"]\n"
    );
    let out = baked(dir.path(), "named", &text);
    let manifest: Value =
        serde_json::from_slice(&fs::read(out.join("manifest.json")).expect("manifest")).expect("JSON");
    let ids: Vec<&str> =
        manifest["assets"].as_array().expect("list").iter().map(|a| a["id"].as_str().expect("id")).collect();
    // Without the numbers and suffixes, four of the ten were written over the files of others.
    let plants_and_rain = ["rain_2", "tree_1_2", "tree_2", "rain"];
    let others = ["tree_1", "catkins_cloud", "water", "catkins", "ground_solid", "ground"];
    assert_eq!(ids, [&plants_and_rain[..], &others].concat());
    assert!(ids.iter().all(|id| out.join(format!("usd/{id}.usdc")).is_file()), "{ids:?}");
    // The cloud called water had the material of the drops.
    let names = manifest["materials"].as_array().expect("list").iter().map(|m| m["name"].as_str().expect("name"));
    let water: Vec<&str> = names.filter(|name| name.starts_with("water")).collect();
    assert_eq!(water, ["water", "water_2"]);
}

/// Two solids of files with a material `wall` and a picture `wall.png` each, and a third of the first file.
#[test]
fn pictures_of_files_that_name_a_material_alike_stay_apart() {
    let dir = tempfile::tempdir().expect("dir");
    for (name, color) in [("a", [200, 20, 20]), ("b", [20, 20, 200])] {
        let folder = dir.path().join(name);
        fs::create_dir(&folder).expect("folder");
        let mesh = "mtllib wall.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl wall\nf 1/1 2/2 3/3\n";
        fs::write(folder.join("wall.obj"), mesh).expect("obj");
        fs::write(folder.join("wall.mtl"), "newmtl wall\nmap_Kd wall.png\n").expect("mtl");
        let picture = ImageBuffer::<Rgb<u8>, Vec<u8>>::from_pixel(4, 4, Rgb(color));
        picture.save(folder.join("wall.png")).expect("png");
    }
    let solids = ["a", "b", "a"].map(|name| format!("[[solid]]\nshape = \"mesh\"\nmesh = \"{name}/wall.obj\"\n"));
    let plant = "[plants.line]\ngrammar = \"koch.l\"\n[[place]]\nplant = \"line\"\n";
    let text = format!("{plant}{}[ground]\nshow = false\n[output]\nformats = [\"usd\"]\n", solids.concat());
    let out = baked(dir.path(), "walls", &text);
    let manifest: Value =
        serde_json::from_slice(&fs::read(out.join("manifest.json")).expect("manifest")).expect("JSON");
    let is_wall = |m: &&Value| m["name"].as_str().is_some_and(|name| name.ends_with("_wall"));
    let walls = manifest["materials"].as_array().expect("list").iter().filter(is_wall);
    let files: Vec<&str> = walls.map(|m| m["slots"]["color"].as_str().expect("a picture")).collect();
    // The second solid had the picture of the first.
    assert_eq!(files, ["textures/wall_color.png", "textures/wall_color_2.png", "textures/wall_color.png"]);
    let color = |file: &str| image::open(out.join(file)).expect("png").to_rgb8().get_pixel(0, 0).0;
    assert_eq!([color(files[0]), color(files[1])], [[200, 20, 20], [20, 20, 200]]);
}

/// PLY has no textures: the vertices of a terrain have the colours of its picture, also of a grey one.
#[test]
fn vertices_of_a_terrain_have_the_colors_of_its_picture() {
    let dir = tempfile::tempdir().expect("dir");
    let color = |x: u32, y: u32| Rgb([40 + 50 * x as u8, 10 + 60 * y as u8, 90]);
    ImageBuffer::<Rgb<u8>, Vec<u8>>::from_fn(4, 4, color).save(dir.path().join("land.png")).expect("png");
    let grey = |x: u32, y: u32| Luma([20 + 50 * x as u8 + 10 * y as u8]);
    ImageBuffer::<Luma<u8>, Vec<u8>>::from_fn(4, 4, grey).save(dir.path().join("grey.png")).expect("png");
    let pixels = || (0..4).flat_map(|x| (0..4).map(move |y| (x, y)));
    let pictured =
        [pixels().map(|(x, y)| color(x, y).0).collect(), pixels().map(|(x, y)| [grey(x, y).0[0]; 3]).collect()];
    for (picture, pictured) in ["land.png", "grey.png"].into_iter().zip(pictured) {
        let text = format!("{TREE}[terrain]\nsubdivisions = 4\nsize = 40\ntexture = \"{picture}\"\n");
        let built = grown::stage(&recipe(dir.path(), &text), SceneOptions::default());
        // `osier grow` leaves the ground out; a caller of the library may write the whole scene.
        let folder = Folder::memory();
        let mut ply = PlyExporter::new(folder.clone(), FileTarget::Single("land.ply".into()));
        ply.begin(&built.animated.scene).expect("written");
        ply.finish().expect("finished");
        let found = vertex_colors_of_ply(&folder.take("land.ply").expect("ply"));
        let pictured: BTreeSet<[u8; 3]> = pictured;
        // The tree adds a colour or two of its own.
        assert!(found.intersection(&pictured).count() > 10, "{picture}: {found:?}");
        assert!(found.difference(&pictured).count() < 6, "{picture}: {found:?}");
    }
}

#[test]
fn copies_that_shaders_sway_are_turned_and_those_of_a_recorded_motion_are_not() {
    let dir = tempfile::tempdir().expect("dir");
    let turns = |motion: &str| {
        let text = format!(
            "{}[[place]]\nplant = \"tree\"\ncount = 6\nradius = 20\nindividuals = 1\n[frames]\nend = 2\n\
             [wind]\nspeed = 4\n[ground]\nshow = false\n[output]\nformats = [\"obj\"]\n",
            TREE.replacen("[plants.tree]\n", &format!("[plants.tree]\nmotion = \"{motion}\"\n"), 1)
        );
        let out = baked(dir.path(), motion, &text);
        let manifest = fs::read_to_string(out.join("manifest.json")).expect("manifest");
        let manifest: serde_json::Value = serde_json::from_str(&manifest).expect("JSON");
        let places = manifest["places"]["tree"].as_array().expect("places").clone();
        // The first number of a matrix for row vectors: the cosine of the turn.
        let first: Vec<f64> = places.iter().map(|p| p["matrix"][0].as_f64().expect("number")).collect();
        first.iter().filter(|x| (**x - first[0]).abs() > 1e-4).count()
    };
    assert_eq!(turns("skin"), 0);
    assert!(turns("static") > 2);
}
