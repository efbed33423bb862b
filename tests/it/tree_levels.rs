//! Trees of tables at several levels of detail: less of them, and from afar the same.
#![allow(clippy::expect_used, clippy::disallowed_methods, reason = "tests run the program and read its pictures")]

use std::path::Path;
use std::process::Command;

const SCENE: &str = "[plants.t]\nifs = \"monopodial.ifs.toml\"\n[plants.t.tree]\nheight = 6\neps = 0.06\nleaves = 2\n\
    [plants.t.leaf]\ndetail = \"crown\"\nside = 64\n[plants.t.bark]\nside = 64\n[ground]\nshow = false\n";

fn run(arguments: &[&str]) {
    let run = Command::new(env!("CARGO_BIN_EXE_osier")).arg("-q").args(arguments).output().expect("osier runs");
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
}

/// Covered share of a small picture, and its mean brightness, linear.
fn seen(folder: &Path, scene: &str, level: u32, view: &str) -> [f64; 2] {
    let (set, out) = (format!("plants.t.tree.lod={level}"), folder.join("x.png"));
    let out = out.to_str().expect("path");
    let look = ["--size", "160x160", "--background", "none", "--view", view, "-o", out];
    run(&[&["preview", scene, "--set", &set][..], &look].concat());
    let picture = image::open(out).expect("picture").to_rgba32f();
    let mut sum = [0.0; 2];
    for p in picture.pixels() {
        let linear = osier::units::linear_from_srgb(p[1]);
        sum = [sum[0] + f64::from(p[3]), sum[1] + f64::from(linear * p[3])];
    }
    sum.map(|s| s / (160.0 * 160.0))
}

#[test]
fn coarse_trees_cover_as_much_and_are_as_bright() {
    let dir = tempfile::tempdir().expect("dir");
    let path = dir.path().join("scene.toml");
    std::fs::write(&path, SCENE).expect("scene");
    let scene = path.to_str().expect("path");
    let [cover, light] = seen(dir.path(), scene, 0, "40,20");
    for level in [1, 2] {
        let [own, shine] = seen(dir.path(), scene, level, "40,20");
        assert!((own / cover - 1.0).abs() < 0.12, "level {level}: covers {own:.4}, should {cover:.4}");
        let share = shine / own * cover / light;
        assert!((share - 1.0).abs() < 0.2, "level {level}: shines {share:.3} of what it should");
    }
}

#[test]
fn every_level_is_smaller_and_the_same_twice() {
    let dir = tempfile::tempdir().expect("dir");
    let path = dir.path().join("scene.toml");
    std::fs::write(&path, SCENE).expect("scene");
    let grown = |level: u32, threads: &str| {
        let out = dir.path().join(format!("t{level}.usdc"));
        let set = format!("plants.t.tree.lod={level}");
        let to = out.to_str().expect("path");
        run(&["grow", path.to_str().expect("path"), "--set", &set, "-j", threads, "-o", to]);
        std::fs::read(out).expect("file")
    };
    let files: Vec<Vec<u8>> = (0..4).map(|level| grown(level, "1")).collect();
    assert!(
        files.windows(2).all(|w| w[1].len() * 3 < w[0].len() * 2),
        "{:?}",
        files.iter().map(Vec::len).collect::<Vec<_>>()
    );
    let picture = dir.path().join("t2_files/t_card_color.png");
    let first = std::fs::read(&picture).expect("picture");
    assert_eq!(files[2], grown(2, "3"));
    assert_eq!(first, std::fs::read(&picture).expect("picture"));
}
