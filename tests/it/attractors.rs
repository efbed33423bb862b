//! Attractors through the program: pictures held against goldens, points read back, clients that open them.
#![allow(clippy::expect_used, clippy::disallowed_methods, reason = "tests run the program and read its files")]

use crate::common::clients;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Every shipped table with its golden picture in `tests/golden/ifs`.
const TABLES: [&str; 11] = [
    "bamboo_leaf",
    "bamboo_node",
    "fern_leaf",
    "hill",
    "green_tree",
    "palm_tree",
    "gray_tree",
    "sun",
    "monopodial",
    "sympodial",
    "pseudodichotomous",
];

fn osier(arguments: &[&str]) -> std::process::Output {
    Command::new(env!("CARGO_BIN_EXE_osier")).args(arguments).output().expect("osier runs")
}

fn grown(folder: &Path, name: &str, file: &str, more: &[&str]) -> PathBuf {
    let path = folder.join(file);
    let mut arguments = vec!["-q", "grow", name, "-o", path.to_str().expect("path")];
    arguments.extend(more);
    let run = osier(&arguments);
    assert!(run.status.success(), "{name}: {}", String::from_utf8_lossy(&run.stderr));
    path
}

#[test]
fn pictures_are_the_golden_ones() {
    let dir = tempfile::tempdir().expect("dir");
    let mut wrong = Vec::new();
    for name in TABLES {
        let set = ["--set", "picture.width=256", "--set", "picture.height=256", "--set", "picture.background=#ffffff"];
        let file = format!("{name}.png");
        let made = grown(dir.path(), &format!("{name}.ifs"), &file, &set);
        wrong.extend(unlike(&made, &file));
    }
    assert!(wrong.is_empty(), "OSIER_BLESS=1 renews them: {}", wrong.join(", "));
}

/// What a picture differs by from its golden one, if by more than 1 of 255; `OSIER_BLESS` renews it.
fn unlike(made: &Path, file: &str) -> Option<String> {
    let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/ifs");
    if std::env::var("OSIER_BLESS").is_ok() {
        std::fs::create_dir_all(&golden).expect("folder");
        std::fs::copy(made, golden.join(file)).expect("copy");
    }
    let read = |p: &Path| image::open(p).map(|i| i.to_rgba8().into_raw()).unwrap_or_default();
    let (ours, want) = (read(made), read(&golden.join(file)));
    let most = ours.iter().zip(&want).map(|(a, b)| a.abs_diff(*b)).max().unwrap_or(255);
    (ours.len() != want.len() || most > 1).then(|| format!("{file}: {most}"))
}

#[test]
fn maps_of_leaves_are_the_golden_ones() {
    let dir = tempfile::tempdir().expect("dir");
    let grammar = "Lsystem: one\nDerivation length: 0\nAxiom: !(0.004)F(0.05)~l\nendlsystem\n";
    std::fs::write(dir.path().join("one.l"), grammar).expect("grammar");
    let mut wrong = Vec::new();
    for table in ["bamboo_leaf", "fern_leaf"] {
        let scene = format!("[plants.x]\ngrammar = \"one.l\"\n[plants.x.leaf]\nifs = \"{table}.ifs\"\nside = 256\n");
        let path = dir.path().join(format!("{table}.toml"));
        std::fs::write(&path, scene).expect("scene");
        let made = grown(dir.path(), path.to_str().expect("path"), &format!("{table}.gltf"), &[]);
        for map in ["color", "normal"] {
            let file = made.with_file_name(format!("{table}_files/x_leaf_{map}.png"));
            wrong.extend(unlike(&file, &format!("leaf-{table}-{map}.png")));
        }
    }
    assert!(wrong.is_empty(), "OSIER_BLESS=1 renews them: {}", wrong.join(", "));
}

#[test]
fn a_picture_of_layers_is_the_golden_one_at_any_number_of_threads() {
    let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/pictures/fig9.png");
    let dir = tempfile::tempdir().expect("dir");
    let set = ["--set", "picture.width=320", "--set", "picture.height=180"];
    let made = ["-j1", "-j2", "-j8"].map(|jobs| {
        let more: Vec<&str> = [jobs].into_iter().chain(set).collect();
        std::fs::read(grown(dir.path(), "fig9", &format!("fig9{jobs}.png"), &more)).expect("picture")
    });
    assert!(made[0] == made[1] && made[0] == made[2], "the bytes depend on the number of threads");
    if std::env::var("OSIER_BLESS").is_ok() {
        std::fs::write(&golden, &made[0]).expect("write");
    }
    let read = |bytes: &[u8]| image::load_from_memory(bytes).map(|i| i.to_rgb8()).expect("png");
    let (ours, want) = (read(&made[0]), read(&std::fs::read(&golden).expect("golden")));
    assert_eq!((ours.dimensions(), want.dimensions()), ((320, 180), (320, 180)));
    let most = ours.as_raw().iter().zip(want.as_raw()).map(|(a, b)| a.abs_diff(*b)).max();
    assert!(most <= Some(1), "a channel differs by {most:?}; OSIER_BLESS=1 renews the picture");
    // Sky above, meadow below, a sun on the right.
    let at = |x, y| ours.get_pixel(x, y).0;
    assert!(at(5, 5)[2] > at(5, 5)[0] && at(300, 176)[1] > at(300, 176)[2] && at(256, 36)[2] < at(256, 36)[0]);
}

#[test]
fn a_stretched_layer_stretches_its_condensation_sets() {
    let dir = tempfile::tempdir().expect("dir");
    let table = "[ifs]\nname = \"disc\"\nmap = [{ abcdef = [0.25, 0, 0, 0.25, 0, 0], p = 1 }]\n\
        condensation = [{ disc = { center = [0, 0], radius = 1 }, weight = 0.9 }]\n";
    std::fs::write(dir.path().join("disc.ifs.toml"), table).expect("file");
    let scene = dir.path().join("layer.toml");
    let text = "[picture]\nwidth = 80\nheight = 40\n[[layer]]\nifs = \"disc.ifs.toml\"\nwidth = 1\nheight = 1\n";
    std::fs::write(&scene, text).expect("file");
    let made = grown(dir.path(), scene.to_str().expect("path"), "layer.png", &[]);
    let picture = image::open(made).expect("a picture").to_rgba8();
    let seen = |x, y| picture.get_pixel(x, y).0[3] > 0;
    // The unit disc becomes the ellipse of the half axes 40 and 20 pixels: it reaches both sides, not the corners.
    assert!(seen(2, 20) && seen(77, 20) && seen(40, 2) && seen(40, 37));
    assert!(!seen(2, 2) && !seen(77, 2) && !seen(2, 37) && !seen(77, 37));
}

#[test]
fn a_rectangle_larger_than_the_canvas_shows_its_part_of_the_gradient() {
    let dir = tempfile::tempdir().expect("dir");
    let scene = dir.path().join("sky.toml");
    let text = "[picture]\nwidth = 16\nheight = 200\n[[layer]]\ncolor = \"#000\"\ncolor2 = \"#fff\"\nwidth = 10\nheight = 10\n\
        at = [-4.5, -5]\n";
    std::fs::write(&scene, text).expect("file");
    let made = grown(dir.path(), scene.to_str().expect("path"), "sky.png", &[]);
    let picture = image::open(made).expect("a picture").to_rgba8();
    // The canvas is the sixth tenth from below: from half way up to 0.6.
    let at = |x, y| picture.get_pixel(x, y).0;
    assert!((126..=128).contains(&at(0, 199)[0]) && (152..=154).contains(&at(0, 0)[0]), "{:?}", at(0, 0));
    // Its right edge, 0.5 of the width of the canvas, is the middle of the picture.
    assert_eq!((at(7, 0)[3], at(8, 0)[3]), (255, 0));
    // One that would take 27 GB, of which the canvas shows a hundredth.
    let all = ["--set", "picture.width=4096", "--set", "picture.height=4096", "--max-memory", "2G"];
    grown(dir.path(), scene.to_str().expect("path"), "sky.png", &all);
    for (source, set) in [("sky.toml", "--max-memory=400M"), ("fern_leaf", "--max-memory=1G")] {
        let source = if source == "sky.toml" { scene.to_str().expect("path") } else { source };
        let out = dir.path().join("refused.png");
        let run = osier(&[&["grow", source, "-o", out.to_str().expect("path"), set][..], &all[..4]].concat());
        let said = String::from_utf8_lossy(&run.stderr).into_owned();
        assert!(run.status.code() == Some(1) && said.contains("the memory of the picture"), "{source}: {said}");
        assert!(said.contains("--max-memory") && !out.exists(), "{source}: {said}");
    }
}

#[test]
fn points_of_a_ply_carry_map_and_depth() {
    let dir = tempfile::tempdir().expect("dir");
    let path = grown(dir.path(), "fern_leaf", "fern.ply", &["--set", "points=5000", "--set", "height=1"]);
    let bytes = std::fs::read(path).expect("bytes");
    let end = bytes.windows(11).position(|w| w == b"end_header\n").expect("header") + 11;
    let header = String::from_utf8_lossy(&bytes[..end]).into_owned();
    assert!(header.contains("element vertex 5000") && header.contains("property uchar map\nproperty uchar depth"));
    let rows: Vec<&[u8]> = bytes[end..].chunks_exact(22).collect();
    assert_eq!((rows.len(), bytes.len() - end), (5000, 110_000));
    let float = |r: &[u8], i: usize| f32::from_le_bytes([r[4 * i], r[4 * i + 1], r[4 * i + 2], r[4 * i + 3]]);
    assert!(rows.iter().all(|r| (-0.02..=1.02).contains(&float(r, 1)) && float(r, 2).abs() < 1e-6 && r[20] < 4));
    let share = rows.iter().filter(|r| r[20] == 1).count();
    assert!((4100..4400).contains(&share), "{share} of 5000 points of a map with the weight 0.85");
}

#[test]
fn maps_of_opacity_0_are_in_neither_clouds_nor_pictures_of_the_density() {
    let dir = tempfile::tempdir().expect("dir");
    let table = dir.path().join("corner.ifs.toml");
    let text = "[ifs]\nname = \"corner\"\nmap = [{ abcdef = [0.5, 0, 0, 0.5, 0, 0] }, \
        { abcdef = [0.5, 0, 0, 0.5, 0.5, 0], opacity = 0 }, { abcdef = [0.5, 0, 0, 0.5, 0, 0.5], opacity = 0 }]\n";
    std::fs::write(&table, text).expect("file");
    let table = table.to_str().expect("path");
    // The triangle from 0 to 1; its lower left part, up to 0.5, is the image under the first map.
    let window = ["picture.width=64", "picture.height=64", "picture.center=[0.5, 0.5]", "picture.span=1"];
    let set: Vec<&str> = window.iter().flat_map(|key| ["--set", *key]).collect();
    for by in ["map", "density"] {
        let by = format!("color_by={by}");
        let set = [&set[..], &["--set", by.as_str(), "--force"]].concat();
        let picture = image::open(grown(dir.path(), table, "corner.png", &set)).expect("a picture").to_rgba8();
        let seen = picture.enumerate_pixels().filter(|(_, _, p)| p.0[3] > 0);
        let (most_x, least_y) = seen.fold((0_u32, 64_u32), |(x, y), p| (x.max(p.0), y.min(p.1)));
        // A point at 0.5 may fall into the next pixel.
        assert!((28..=32).contains(&most_x) && (31..=36).contains(&least_y), "{by}: {most_x} {least_y}");
    }
    let bytes = std::fs::read(grown(dir.path(), table, "corner.ply", &["--set", "points=3000"])).expect("bytes");
    let end = bytes.windows(11).position(|w| w == b"end_header\n").expect("header") + 11;
    let rows: Vec<&[u8]> = bytes[end..].chunks_exact(22).collect();
    // A third of the points, within five standard errors.
    assert!(rows.iter().all(|r| r[20] == 0) && rows.len().abs_diff(1000) < 130, "{}", rows.len());
}

#[test]
fn overrides_of_a_bare_tree_are_keys_of_its_growth() {
    let dir = tempfile::tempdir().expect("dir");
    // The second system grows a tree, which an OBJ file holds; the points of a cloud would be refused.
    let table = dir.path().join("two.ifs.toml");
    let text = "[[ifs]]\nname = \"flat\"\nmap = [{ abcdef = [0.5, 0, 0, 0.5, 0, 0] }]\n\
        [[ifs]]\nname = \"fork\"\ndim = 3\nmap = [\n\
        { branch = { h = 1, roll = 120, pitch = 20, scale = 0.8 }, radius = 0.7, axis = true },\n\
        { branch = { h = 0.5, pitch = 60, scale = 0.5 }, radius = 0.4 },\n]\n\
        condensation = [{ segment = { from = [0, 0, 0], to = [0, 1, 0], radius = 0.05 }, weight = 0.1 }]\n";
    std::fs::write(&table, text).expect("file");
    let table = table.to_str().expect("path");
    let size = |eps: &str| {
        let eps = format!("eps={eps}");
        let set = ["--set", "system=fork", "--set", eps.as_str(), "--force"];
        std::fs::metadata(grown(dir.path(), table, "fork.obj", &set)).expect("file").len()
    };
    assert!(size("0.1") > 2 * size("0.3"), "more branches");
    for (set, word) in [("nonsense=3", "nonsense"), ("as=bush", "cloud or tree")] {
        let run = osier(&["check", "monopodial", "--set", set]);
        let err = String::from_utf8_lossy(&run.stderr).into_owned();
        assert!(run.status.code() == Some(1) && err.contains(word), "{err}");
    }
}

#[test]
fn a_picture_of_a_scene_says_what_it_leaves_out() {
    let dir = tempfile::tempdir().expect("dir");
    let said = |clouds: &str| {
        let scene = dir.path().join("scene.toml");
        std::fs::write(&scene, clouds).expect("file");
        let out = dir.path().join("scene.png");
        let (scene, out) = (scene.to_str().expect("path"), out.to_str().expect("path"));
        let run =
            osier(&["grow", scene, "-o", out, "--force", "--set", "picture.width=16", "--set", "picture.height=16"]);
        assert!(run.status.success());
        String::from_utf8_lossy(&run.stderr).into_owned()
    };
    let one = "[clouds.fern]\nifs = \"fern_leaf.ifs\"\n";
    assert!(!said(one).contains("alone"));
    let two = said(&format!("{one}[clouds.tree]\nifs = \"green_tree.ifs\"\n"));
    assert!(two.contains("\"fern\" alone"), "{two}");
}

#[test]
fn voxels_thin_and_count() {
    let dir = tempfile::tempdir().expect("dir");
    let set = ["--set", "points=20000", "--set", "height=1", "--set", "voxel_mm=20"];
    let bytes = std::fs::read(grown(dir.path(), "fern_leaf", "fern.ply", &set)).expect("bytes");
    let header = String::from_utf8_lossy(&bytes[..400.min(bytes.len())]).into_owned();
    assert!(header.contains("density"), "{header}");
    let count: usize =
        header.lines().find_map(|l| l.strip_prefix("element vertex ")).and_then(|n| n.parse().ok()).expect("count");
    assert!((300..3000).contains(&count), "{count}");
}

#[test]
fn hostile_tables_end_with_their_message() {
    let dir = tempfile::tempdir().expect("dir");
    let cases: [(&str, String, &str); 8] = [
        ("nan", "a {\nnan 0 0 .5 0 0 1\n}".into(), "I005"),
        ("huge", "a {\n1e999 0 0 .5 0 0 1\n}".into(), "I005"),
        ("many", format!("a {{\n{}}}", ".5 0 0 .5 0 0 .01\n".repeat(10_000)), "I008"),
        ("empty", "a {\n}".into(), "I007"),
        ("brace", "a {\n.5 0 0 .5 0 0 1\n".into(), "I006"),
        ("grows", "a {\n1.5 0 0 1.5 0 0 .5\n2 0 0 2 1 0 .5\n}".into(), "I021"),
        ("flat", "a {\n.5 .5 0 0 0 0 .5\n.5 .5 0 0 1 0 .5\n}".into(), "I025"),
        ("line", format!("a {{ {} }}", "0.5 ".repeat(1_250_000)), "I007"),
    ];
    for (name, text, code) in cases {
        let path = dir.path().join(format!("{name}.ifs"));
        std::fs::write(&path, text).expect("write");
        let run = osier(&["check", path.to_str().expect("path")]);
        let said = String::from_utf8_lossy(&run.stderr).into_owned();
        assert!(said.contains(code), "{name}: {said}");
        assert!(matches!(run.status.code(), Some(0 | 1)), "{name}: {:?}", run.status);
    }
}

#[test]
fn every_printed_system_is_judged() {
    let run = osier(&["check", "as_printed.ifs"]);
    let said = String::from_utf8_lossy(&run.stderr).into_owned();
    assert!(said.contains("I020") && said.contains("I025") && said.contains("b = -0.105"), "{said}");
}

#[test]
fn points_open_in_the_clients() {
    let dir = tempfile::tempdir().expect("dir");
    let set = ["--set", "points=3000", "--set", "height=1"];
    let glb = grown(dir.path(), "fern_leaf", "fern.glb", &set);
    let usd = grown(dir.path(), "fern_leaf", "fern.usda", &set);
    let text = std::fs::read_to_string(&usd).expect("usda");
    assert!(text.contains("primvars:map") && text.contains("primvars:depth") && text.contains("def Points"));
    let json = String::from_utf8_lossy(&std::fs::read(&glb).expect("glb")).into_owned();
    assert!(json.contains("\"_MAP\"") && json.contains("\"_DEPTH\""));
    if let Some((node, folder)) = clients::validator() {
        let said = clients::run(Command::new(node).arg(clients::script("gltf_validate.mjs")).arg(folder).arg(&glb));
        let report: serde_json::Value = serde_json::from_slice(said.stdout.trim_ascii()).expect("json");
        assert_eq!((&report["errors"], &report["warnings"]), (&0.into(), &0.into()), "{report}");
    }
    if let Some(python) = clients::python() {
        clients::python_script(&python, "usd_validate.py", &[usd.to_str().expect("path")]);
    }
}

#[test]
fn povray_draws_the_points_and_the_tree() {
    let dir = tempfile::tempdir().expect("dir");
    grown(dir.path(), "fern_leaf", "fern.pov", &["--set", "points=20000", "--set", "height=1", "--set", "point_mm=6"]);
    grown(dir.path(), "pseudodichotomous", "tree.pov", &["--set", "tree.eps=0.2", "--set", "leaf.side=64"]);
    let Some(povray) = clients::povray() else { return };
    for name in ["fern", "tree"] {
        let picture = dir.path().join(format!("{name}.png"));
        clients::run(Command::new(&povray).current_dir(dir.path()).args([
            &format!("+I{name}.pov"),
            &format!("+O{name}.png"),
            "+W96",
            "+H96",
            "-D",
            "-GA",
        ]));
        let seen = image::open(&picture).expect("a picture").to_rgb8();
        let first = *seen.get_pixel(2, 2);
        let other = seen.pixels().filter(|p| p.0.iter().zip(first.0).any(|(a, b)| a.abs_diff(b) > 24)).count();
        assert!(other > 200, "{name}: {other} pixels show something");
    }
}

#[test]
fn coefficients_are_written_again() {
    let dir = tempfile::tempdir().expect("dir");
    let read = |p: &Path| std::fs::read_to_string(p).expect("text");
    for (name, file) in [("fern_leaf", "fern.ifs"), ("sun", "sun.flame"), ("monopodial", "tree.ifs")] {
        let first = grown(dir.path(), name, file, &[]);
        let again = grown(dir.path(), first.to_str().expect("path"), &format!("again-{file}"), &[]);
        assert_eq!(read(&first), read(&again), "{name}");
    }
    let tree = read(&dir.path().join("tree.ifs"));
    assert!(tree.contains("monopodial (3D) {") && tree.lines().filter(|l| l.starts_with("  ")).count() == 5, "{tree}");
    // The written tree still grows, and what a file cannot hold is told.
    let path = dir.path().join("tree.ifs");
    grown(dir.path(), path.to_str().expect("path"), "tree.glb", &["--set", "as=tree"]);
    let run = osier(&["grow", "monopodial", "-n", "-o", "x.ifs"]);
    assert!(String::from_utf8_lossy(&run.stderr).contains("I011"), "{}", String::from_utf8_lossy(&run.stderr));
    for (source, file, word) in [("oak", "x.ifs", "no coefficients"), ("monopodial", "x.flame", "I030")] {
        let run = osier(&["grow", source, "-o", dir.path().join(file).to_str().expect("path")]);
        assert!(!run.status.success() && String::from_utf8_lossy(&run.stderr).contains(word), "{source}");
    }
}

/// Pixels where something stands, of a flame whose two maps meet near (2, 1), y down, at 20 pixels a unit.
fn seen_of_flame(folder: &Path, rotate: u32, set: &[&str]) -> Vec<(u32, u32)> {
    let file = folder.join(format!("dot{rotate}.flame"));
    let text = format!(
        "<flame name=\"dot\" size=\"200 100\" center=\"0 0\" scale=\"20\" rotate=\"{rotate}\">\n\
         <xform weight=\".5\" linear=\"1\" coefs=\".1 0 0 .1 1.8 .9\"/>\n\
         <xform weight=\".5\" linear=\"1\" coefs=\".1 0 0 .1 1.81 .9\"/>\n</flame>\n"
    );
    std::fs::write(&file, text).expect("file");
    let size = ["--set", "picture.width=200", "--set", "picture.height=100"];
    let png = grown(folder, file.to_str().expect("path"), &format!("dot{rotate}.png"), &[&size[..], set].concat());
    let picture = image::open(png).expect("a picture").to_rgba8();
    picture.enumerate_pixels().filter(|(_, _, p)| p.0[3] > 0).map(|(x, y, _)| (x, y)).collect()
}

#[test]
fn a_flame_is_seen_as_its_file_says() {
    let dir = tempfile::tempdir().expect("dir");
    // Where flam3 3.1 puts them.
    assert_eq!(seen_of_flame(dir.path(), 0, &[]), [(140, 70)]);
    assert_eq!(seen_of_flame(dir.path(), 30, &["--force"]), [(124, 87)]);
    let whole = seen_of_flame(dir.path(), 0, &["--force", "--set", "picture.fit=bounds"]);
    assert!(whole.iter().any(|p| p.0 < 20) && whole.iter().any(|p| p.0 > 180), "all of it: {whole:?}");
}

/// Twenty thousand leaves of a table open in Blender as instances of a few meshes.
#[test]
fn blender_opens_a_crown_of_twenty_thousand_leaves() {
    let Some(python) = clients::python() else { return };
    let dir = tempfile::tempdir().expect("dir");
    let more = ["--set", "plants.silk_tree.set.TUFT=24", "--set", "plants.silk_tree.leaf.side=128"];
    let stage = grown(dir.path(), "silk-tree", "tree.usdc", &more);
    let run = Command::new(python).arg(clients::script("usd_crown.py")).arg(&stage).output().expect("python runs");
    let out = String::from_utf8_lossy(&run.stdout);
    assert!(run.status.success(), "{out}{}", String::from_utf8_lossy(&run.stderr));
    let line = out.lines().find(|l| l.starts_with("crown ")).expect("a line of figures");
    let figures: Vec<u64> = line.split(' ').skip(1).map(|w| w.parse().expect("number")).collect();
    let [instances, meshes, cut] = figures[..] else { panic!("{line}") };
    assert_eq!((instances, meshes, cut), (20_736, 4, 1), "{line}");
}

/// A file of two systems, of which the second one is a square that is half as wide.
const TWO_SYSTEMS: &str = "first {\n .5 0 0 .5 0 0 .34\n .5 0 0 .5 1 0 .33\n .5 0 0 .5 0 1 .33\n}\n\
     second {\n .5 0 0 .5 0 0 .25\n .5 0 0 .5 1 0 .25\n .5 0 0 .5 0 1 .25\n .5 0 0 .5 1 1 .25\n}\n";

#[test]
fn a_system_of_a_table_is_named_behind_its_file() {
    let dir = tempfile::tempdir().expect("dir");
    let table = dir.path().join("two.ifs");
    std::fs::write(&table, TWO_SYSTEMS).expect("table");
    let table = table.to_str().expect("path");
    let second = format!("{table}#second");
    let size = ["--set", "picture.width=64", "--set", "picture.height=64", "--set", "picture.points=100000"];
    let picture = |source: &str, name: &str, more: &[&str]| {
        std::fs::read(grown(dir.path(), source, name, &[&size[..], more].concat())).expect("picture")
    };
    let first = picture(table, "a.png", &[]);
    let named = picture(&second, "b.png", &[]);
    assert!(first != named, "the second system is drawn");
    assert_eq!(named, picture(table, "c.png", &["--set", "system=second"]));
    assert_eq!(named, picture(&second.replace('#', ":"), "d.png", &[]));
    // A key prevails over the name behind the file.
    assert_eq!(first, picture(&second, "e.png", &["--set", "system=first"]));

    let refused = |arguments: &[&str]| {
        let run = osier(arguments);
        assert_eq!(run.status.code(), Some(1), "{arguments:?}");
        String::from_utf8_lossy(&run.stderr).into_owned()
    };
    let err = refused(&["check", &format!("{table}#third")]);
    assert!(err.contains("I001") && err.contains("first, second"), "{err}");
    // Other files hold one source.
    let scene = dir.path().join("s.toml");
    std::fs::write(&scene, "[clouds.a]\nifs = \"two.ifs#second\"\n").expect("scene");
    let scene = scene.to_str().expect("path");
    let err = refused(&["check", &format!("{scene}#second")]);
    assert!(err.contains("S001") && err.contains("has no entries"), "{err}");
    // In a scene the system is a key of its own.
    let err = refused(&["check", scene]);
    assert!(err.contains("system = \"second\""), "{err}");

    // Only plants have places.
    let placed = dir.path().join("placed.toml");
    std::fs::write(&placed, "[clouds.a]\nifs = \"two.ifs\"\n[[place]]\nplant = \"a\"\n").expect("scene");
    let err = refused(&["check", placed.to_str().expect("path")]);
    assert!(err.contains("there is no plant \"a\"") && err.contains("stand at their own `at`"), "{err}");

    let told = |arguments: &[&str]| String::from_utf8_lossy(&osier(arguments).stdout).into_owned();
    assert_eq!(told(&["list", table]), format!("{table}#first\n{table}#second\n"));
    let info = told(&["info", table]);
    assert!(info.contains("coefficient table") && info.contains("  first\n  second\n"), "{info}");
}
