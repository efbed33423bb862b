//! Trees of tables whose ends are copies: the same tree in smaller files, as the programs see it that read them.
#![allow(clippy::expect_used, clippy::disallowed_methods, reason = "tests run the program and read its files")]

use crate::common::clients;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Pixels along a side of POV-Ray's pictures.
const SIDE: usize = 96;

fn osier(arguments: &[&str]) -> std::process::Output {
    Command::new(env!("CARGO_BIN_EXE_osier")).args(arguments).output().expect("osier runs")
}

/// A tree without variation, grown whole or with copies.
fn grown(folder: &Path, file: &str, twigs: bool, eps: f64) -> PathBuf {
    let path = folder.join(file);
    let (twigs, eps) = (format!("tree.twigs={twigs}"), format!("tree.eps={eps}"));
    let mut arguments = vec!["-q", "grow", "monopodial", "-o", path.to_str().expect("path"), "--profile", "web"];
    let sets = [&twigs, &eps, "tree.variation=0", "leaf.side=64", "leaf.variants=1", "bark.side=64", "shoot.side=64"];
    arguments.extend(sets.iter().flat_map(|set| ["--set", set]));
    let run = osier(&arguments);
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    path
}

#[test]
fn files_are_a_fraction_and_hold_what_the_validators_ask_for() {
    let dir = tempfile::tempdir().expect("dir");
    for ending in ["usdc", "glb"] {
        let size = |twigs: bool| {
            let file = grown(dir.path(), &format!("{twigs}.{ending}"), twigs, 0.02);
            std::fs::metadata(file).expect("file").len()
        };
        let (whole, copied) = (size(false), size(true));
        assert!(copied * 2 < whole, "{ending}: {copied} of {whole} bytes");
    }
    if let Some((node, folder)) = clients::validator() {
        let glb = dir.path().join("true.glb");
        let said = clients::run(Command::new(node).arg(clients::script("gltf_validate.mjs")).arg(folder).arg(&glb));
        let report: serde_json::Value = serde_json::from_slice(said.stdout.trim_ascii()).expect("json");
        assert_eq!((&report["errors"], &report["warnings"]), (&0.into(), &0.into()), "{report}");
    }
    if let Some(python) = clients::python() {
        clients::python_script(&python, "usd_validate.py", &[dir.path().join("true.usdc").to_str().expect("path")]);
    }
}

#[test]
fn povray_sees_the_same_tree() {
    let Some(povray) = clients::povray() else { return };
    let dir = tempfile::tempdir().expect("dir");
    let seen = |twigs: bool| -> Vec<bool> {
        let name = format!("tree_{twigs}");
        grown(dir.path(), &format!("{name}.pov"), twigs, 0.15);
        let arguments =
            [format!("+I{name}.pov"), format!("+O{name}.png"), format!("+W{SIDE}"), format!("+H{SIDE}"), "-D".into()];
        clients::run(Command::new(&povray).current_dir(dir.path()).args(arguments).arg("-GA"));
        let picture = image::open(dir.path().join(format!("{name}.png"))).expect("a picture").to_rgb8();
        let sky = *picture.get_pixel(2, 2);
        picture.pixels().map(|p| p.0.iter().zip(sky.0).any(|(a, b)| a.abs_diff(b) > 60)).collect()
    };
    let (whole, copied) = (seen(false), seen(true));
    // Leaves spread by other draws: a pixel is matched by one beside it.
    let near = |other: &[bool], i: usize| {
        let (x, y) = (i % SIDE, i / SIDE);
        let around = |v: usize| v.saturating_sub(1)..=(v + 1).min(SIDE - 1);
        around(y).any(|v| around(x).any(|u| other[v * SIDE + u]))
    };
    for (own, other) in [(&whole, &copied), (&copied, &whole)] {
        let set: Vec<usize> = (0..own.len()).filter(|i| own[*i]).collect();
        let matched = set.iter().filter(|i| near(other, **i)).count();
        assert!(set.len() > 200 && matched * 10 > set.len() * 9, "{matched} of {} pixels", set.len());
    }
}

#[test]
fn twigs_ride_on_branches_that_sway() {
    let dir = tempfile::tempdir().expect("dir");
    let scene = dir.path().join("s.toml");
    let text = "[frames]\nend = 3\n[plants.tree]\nifs = \"sympodial.ifs.toml\"\n[plants.tree.tree]\neps = 0.1\ntwigs = true\n\
        [plants.tree.leaf]\nside = 64\n[plants.tree.bark]\nside = 64\n[wind]\nspeed = 8\n[ground]\nshow = false\n\
        [output]\nformats = [\"usd\"]\n";
    std::fs::write(&scene, text).expect("scene");
    let out = dir.path().join("out");
    let run = osier(&["-q", "bake", scene.to_str().expect("path"), "-o", out.to_str().expect("path")]);
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    if let Some(python) = clients::python() {
        let usd = out.join("usd/tree.usdc");
        clients::python_script(&python, "usd_validate.py", &[usd.to_str().expect("path")]);
    }
}

#[test]
fn twigs_that_cannot_be_are_told() {
    let dir = tempfile::tempdir().expect("dir");
    let sheared = "[ifs]\nname = \"t\"\ndim = 3\nmap = [\n{ branch = { scale = 0.5 } },\n\
        { abcdefghijkl = [0.5, 0.1, 0, 0, 0.5, 0, 0, 0, 0.5, 0, 1, 0] },\n]\n";
    std::fs::write(dir.path().join("sheared.ifs.toml"), sheared).expect("table");
    for (table, tree, more, said) in [
        ("monopodial", "eps = 0.5", "[plants.tree.rods]", "bends on its own as a rod"),
        ("monopodial", "eps = 0.5", "[rain]\n[frames]\nend = 2", "rain needs each leaf on its own"),
        ("monopodial", "radii = \"pipe\"", "", "needs every branch tip"),
        ("monopodial", "lod = 1", "", "replaces them by billboards"),
        ("sheared", "eps = 0.5", "", "map 2 is not a rotation with uniform scale"),
    ] {
        let scene = dir.path().join("s.toml");
        let text =
            format!("[plants.tree]\nifs = \"{table}.ifs.toml\"\n[plants.tree.tree]\n{tree}\ntwigs = true\n{more}\n");
        std::fs::write(&scene, text).expect("scene");
        let run = osier(&["check", scene.to_str().expect("path")]);
        let text = String::from_utf8_lossy(&run.stderr);
        assert!(text.contains("S007") && text.contains("s.toml") && text.contains(said), "{said}: {text}");
    }
}
