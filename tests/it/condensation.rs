//! Meshes as condensation sets: points of their faces, copies on every word of a tree, and what is said of bad ones.
#![allow(clippy::expect_used, clippy::disallowed_methods, reason = "tests run the program and read its files")]

use std::path::Path;
use std::process::Command;

/// An open cube of side 1 about (0, 0.5, 0), without its lid.
const TUB: &str = "v -.5 0 -.5\nv .5 0 -.5\nv .5 0 .5\nv -.5 0 .5\nv -.5 1 -.5\nv .5 1 -.5\nv .5 1 .5\nv -.5 1 .5\n\
    f 1 2 3 4\nf 1 5 6 2\nf 2 6 7 3\nf 3 7 8 4\nf 4 8 5 1\n";

const MAPS: &str = "map = [\n  { branch = { h = 1, roll = 40, pitch = 30, scale = 0.5 }, axis = true },\n  \
    { branch = { h = 0.5, roll = 200, pitch = 60, scale = 0.5 } },\n]\n";

fn table(folder: &Path, set: &str) -> String {
    let text = format!("[ifs]\nname = \"tubs\"\ndim = 3\nweights = \"equal\"\ncondensation = [{{ {set} }}]\n{MAPS}");
    let path = folder.join("tubs.ifs.toml");
    std::fs::write(&path, text).expect("table");
    path.to_str().expect("path").to_owned()
}

fn osier(arguments: &[&str]) -> std::process::Output {
    Command::new(env!("CARGO_BIN_EXE_osier")).args(arguments).output().expect("osier runs")
}

fn grown(folder: &Path, table: &str, file: &str, more: &[&str]) -> Vec<u8> {
    let path = folder.join(file);
    let mut arguments = vec!["-q", "grow", table, "-o", path.to_str().expect("path")];
    arguments.extend(more);
    let run = osier(&arguments);
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    std::fs::read(path).expect("file")
}

#[test]
fn points_lie_on_the_faces_and_are_the_same_on_any_number_of_threads() {
    let dir = tempfile::tempdir().expect("dir");
    std::fs::write(dir.path().join("tub.obj"), TUB).expect("mesh");
    let table = table(dir.path(), "mesh = \"tub.obj\", weight = 0.4");
    let set = ["--set", "as=cloud", "--set", "points=20000", "--set", "clouds.tubs.foot=origin"];
    let one = grown(dir.path(), &table, "a.ply", &[&set[..], &["-j", "1"]].concat());
    assert_eq!(one, grown(dir.path(), &table, "a.ply", &[&set[..], &["-j", "3"]].concat()));
    let end = one.windows(11).position(|w| w == b"end_header\n").expect("header") + 11;
    let float = |r: &[u8], i: usize| f32::from_le_bytes([r[4 * i], r[4 * i + 1], r[4 * i + 2], r[4 * i + 3]]);
    let jumped: Vec<[f32; 3]> =
        one[end..].chunks_exact(22).filter(|r| r[20] == 2).map(|r| [0, 1, 2].map(|i| float(r, i))).collect();
    // Five standard errors of the share 0.4, and of a fifth of it on the floor.
    assert!((7650..8350).contains(&jumped.len()), "{}", jumped.len());
    let near = |a: f32, b: f32| (a - b).abs() < 1e-5;
    let on = |p: &[f32; 3]| {
        let within = p[0].abs() < 0.500_01 && p[2].abs() < 0.500_01 && (-1e-5..=1.000_01).contains(&p[1]);
        within && (near(p[1], 0.0) || near(p[0].abs(), 0.5) || near(p[2].abs(), 0.5))
    };
    assert!(jumped.iter().all(on));
    let floor = jumped.iter().filter(|p| near(p[1], 0.0)).count();
    assert!((1400..1800).contains(&floor), "{floor} on one of five faces");
}

#[test]
fn a_tree_bears_the_mesh_on_every_word() {
    let dir = tempfile::tempdir().expect("dir");
    std::fs::write(dir.path().join("tub.obj"), TUB).expect("mesh");
    let table = table(dir.path(), "mesh = { file = \"tub.obj\", scale = 0.2 }");
    let scene = "[plants.tubs]\nifs = \"tubs.ifs.toml\"\n[plants.tubs.tree]\neps = 0.2\n";
    let path = dir.path().join("grove.toml");
    std::fs::write(&path, scene).expect("scene");
    let usda = String::from_utf8(grown(dir.path(), path.to_str().expect("path"), "a.usda", &[])).expect("text");
    // 1 + 2 + 4 words are at least a fifth as large as the trunk.
    let sets = usda.split("PointInstancer \"").find(|p| p.starts_with("organ_a")).expect("an instancer");
    let ids = sets.lines().find(|l| l.contains("int64[] ids")).expect("ids");
    assert_eq!(ids.matches(',').count() + 1, 7, "{ids}");
    let hash = || {
        let scene = String::from_utf8(grown(dir.path(), path.to_str().expect("path"), "a.pov", &[])).expect("text");
        scene.lines().next().expect("its mark").to_owned()
    };
    let before = hash();
    std::fs::write(dir.path().join("tub.obj"), TUB.replace("v -.5 1 -.5", "v -.5 2 -.5")).expect("mesh");
    assert_ne!(before, hash(), "the mesh takes part in the scene's hash");
    let run = osier(&["check", &table]);
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
}

#[test]
fn bad_meshes_are_named_where_the_table_names_them() {
    let dir = tempfile::tempdir().expect("dir");
    std::fs::write(dir.path().join("tub.obj"), TUB).expect("mesh");
    std::fs::write(dir.path().join("empty.obj"), "v 0 0 0\n").expect("mesh");
    std::fs::write(dir.path().join("line.obj"), "v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n").expect("mesh");
    std::fs::write(dir.path().join("torn.obj"), "v 0 0 0\nf 1 2 3\n").expect("mesh");
    let cases = [
        ("mesh = \"no.obj\"", "S005", "no.obj", Vec::new()),
        ("mesh = \"../tub.obj\"", "S005", "leads out", Vec::new()),
        ("mesh = \"empty.obj\"", "X010", "no triangle", Vec::new()),
        ("mesh = \"line.obj\"", "X010", "no triangle", Vec::new()),
        ("mesh = \"torn.obj\"", "X010", "torn.obj", Vec::new()),
        ("mesh = \"tub.obj\"", "X010", "the limit is 4", vec!["--max-triangles", "4"]),
        ("mesh = \"tub.stl\"", "I033", ".obj, .glb or .gltf", Vec::new()),
        ("mesh = { fil = \"tub.obj\" }", "I032", "did you mean \"file\"", Vec::new()),
        ("mesh = { file = \"tub.obj\", scale = 0 }", "I041", "scale must be at least 0.000001", Vec::new()),
        ("mesh = { file = \"tub.obj\", up = \"x\" }", "I033", "up must be", Vec::new()),
    ];
    for (set, code, text, more) in cases {
        let table = table(dir.path(), set);
        let run = osier(&[&["check", &table][..], &more].concat());
        let said = String::from_utf8_lossy(&run.stderr).into_owned();
        assert_eq!(run.status.code(), Some(1), "{set}: {said}");
        assert!(said.contains(code) && said.contains(text), "{set}: {said}");
        let place = if set.contains("torn") { "torn.obj:2:" } else { "tubs.ifs.toml:5:" };
        assert!(said.contains(place), "{set}: {said}");
    }
    let flat = dir.path().join("flat.ifs.toml");
    let text = "[ifs]\nname = \"flat\"\ncondensation = [{ mesh = \"tub.obj\" }]\nmap = [{ abcdef = [0.5, 0, 0, 0.5, 0, 0] }]\n";
    std::fs::write(&flat, text).expect("table");
    let said = String::from_utf8_lossy(&osier(&["check", flat.to_str().expect("path")]).stderr).into_owned();
    assert!(said.contains("I033") && said.contains("flat.ifs.toml:3:") && said.contains("dim = 3"), "{said}");
}
