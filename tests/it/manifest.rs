//! The manifest: equal for equal runs, and it names what was done to a bake.
#![allow(clippy::expect_used, clippy::disallowed_methods, reason = "tests fail by panicking and tamper with files")]

use crate::common::synthetic;
use std::fs;
use std::path::Path;
use std::sync::Arc;

use osier::export::file_target::FileTarget;
use osier::export::manifest::{self, FileEntry, Settings};
use osier::export::textures::Textures;
use osier::export::{Exporter, exr, obj, ply, pov};
use osier::files::Folder;
use osier::scene::{Image, ImageKind, Pixels};

/// Bakes the synthetic scene, its bark with a height map, with every exporter of this group.
fn bake(dir: &Path) -> String {
    let (mut scene, frames) = synthetic::scene();
    let pixels = Pixels::U16((0..16).map(|i| i * 4096).collect());
    let name = "bark_height".into();
    scene.images.push(Image { name, kind: ImageKind::Data, width: 4, height: 4, channels: 1, pixels });
    scene.materials[0].maps.height = Some(3);
    let folder = Folder::open(dir).expect("folder");
    let textures = Arc::new(Textures::encode(&scene).expect("textures"));
    let scene = Arc::new(scene);
    let mut exporters: Vec<Box<dyn Exporter>> = vec![
        Box::new(pov::PovExporter::new(folder.clone(), textures.clone(), pov::PovOptions::default())),
        Box::new(obj::ObjExporter::new(folder.clone(), textures, FileTarget::Bake)),
        Box::new(ply::PlyExporter::new(folder.clone(), FileTarget::Bake)),
        Box::new(exr::ExrExporter::new(folder.clone(), exr::ExrOptions::default())),
    ];
    let mut warnings = Vec::new();
    for exporter in &mut exporters {
        exporter.begin(&scene).expect("begin");
        frames.iter().for_each(|f| exporter.frame(f).expect("frame"));
        warnings.extend(exporter.finish().expect("finish").warnings);
    }
    let manifest = manifest::build(&scene, &folder.files(), &warnings, &Settings::default());
    manifest::write(&folder, &manifest).expect("manifest");
    folder.finish().expect("finish");
    fs::read_to_string(dir.join("manifest.json")).expect("text")
}

#[test]
fn two_runs_are_equal_and_nothing_personal_is_inside() {
    let (a, b) = (tempfile::tempdir().expect("dir"), tempfile::tempdir().expect("dir"));
    let text = bake(a.path());
    assert_eq!(text, bake(b.path()));
    for dir in [a.path(), Path::new(env!("CARGO_MANIFEST_DIR"))] {
        let named = dir.to_string_lossy().into_owned();
        for path in osier::files::list_files(a.path()).expect("files") {
            let bytes = fs::read(a.path().join(&path)).expect("bytes");
            assert!(!bytes.windows(named.len()).any(|w| w == named.as_bytes()), "{path} names {named}");
        }
    }
}

#[test]
fn keys_stand_in_order_and_sequences_are_grouped() {
    let dir = tempfile::tempdir().expect("dir");
    let text = bake(dir.path());
    let keys: Vec<&str> =
        text.lines().filter_map(|l| l.strip_prefix("  \"")).filter_map(|l| l.split('"').next()).collect();
    let wanted = [
        "schema",
        "generator",
        "version",
        "scene",
        "seed",
        "up_axis",
        "meters_per_unit",
        "time",
        "units",
        "assets",
        "materials",
        "files",
        "bake_hash",
        "warnings",
    ];
    assert_eq!(keys, wanted);
    let (m, found) = manifest::verify(dir.path(), 1 << 20).expect("verify");
    assert!(found.is_complete() && found.extra.is_empty(), "{found:?}");
    assert_eq!(m.seed, "18446744073709551557");
    let sequence = |wanted: &str| {
        m.files.iter().find_map(|f| match f {
            FileEntry::Sequence { path, frames, items, .. } if path == wanted => Some((*frames, items.len())),
            _ => None,
        })
    };
    assert_eq!(sequence("pov/frames/frame.####.inc"), Some(([1, 9], 9)));
    assert_eq!(sequence("cloud/tracks.flying.####.ply"), Some(([1, 9], 9)));
    assert_eq!(m.assets[0].files, ["cloud/rig.leaves.ply", "obj/rig.mtl", "obj/rig.obj"]);
    assert_eq!((m.assets[0].vertices, m.assets[0].joints, m.assets[0].instances), (35, 3, 4));
    assert_eq!(m.materials[0].maps["height"], "maps/bark/height.exr");
    assert_eq!(m.materials[0].slots["color"], "textures/bark_color.png");
}

#[test]
fn deleted_changed_and_foreign_files_are_named() {
    let dir = tempfile::tempdir().expect("dir");
    bake(dir.path());
    fs::remove_file(dir.path().join("maps/bark/height.exr")).expect("remove");
    fs::write(dir.path().join("pov/frames/frame.0003.inc"), "x").expect("change");
    fs::write(dir.path().join("notes.txt"), "mine").expect("add");
    let (_, found) = manifest::verify(dir.path(), 1 << 20).expect("verify");
    assert_eq!(found.missing, ["maps/bark/height.exr"]);
    assert_eq!(found.changed, ["pov/frames/frame.0003.inc"]);
    assert_eq!(found.extra, ["notes.txt"]);
    assert!(!found.is_complete() && found.sum_holds);
}

#[test]
fn a_manifest_that_lies_or_leads_out_is_refused() {
    let dir = tempfile::tempdir().expect("dir");
    let text = bake(dir.path());
    let path = dir.path().join("manifest.json");
    let verify = |text: &str| {
        fs::write(&path, text).expect("write");
        manifest::verify(dir.path(), 1 << 20)
    };
    let out = text.replace("pov/main.pov", "../etc/passwd");
    assert!(verify(&out).expect_err("leads out").to_string().starts_with("X009"));
    assert!(verify(&text[..text.len() / 2]).expect_err("torn").to_string().starts_with("X010"));
    let other = text.replace("\"bake_hash\": \"", "\"bake_hash\": \"0");
    assert!(!verify(&other).expect("readable").1.sum_holds);
    fs::remove_file(&path).expect("remove");
    assert!(manifest::verify(dir.path(), 1 << 20).is_err());
}
