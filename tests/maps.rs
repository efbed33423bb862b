//! Height maps: equal bytes, exact values, and OpenEXR's own reader agrees.
#![allow(clippy::expect_used, clippy::disallowed_methods, reason = "a test fails by panicking and looks at files")]

#[path = "common/clients.rs"]
mod clients;
mod common;

use std::fs;
use std::path::Path;
use std::sync::Arc;

use osier::export::Exporter;
use osier::export::exr::{Exr, Wanted};
use osier::fence::Folder;
use osier::scene::*;

const WIDTH: u32 = 37;
const HEIGHT: u32 = 29;

/// The synthetic scene with a height map on its bark; heights run over the whole range, row 0 on top.
fn scene() -> Scene {
    let (mut scene, _) = common::synthetic();
    let samples = (0..WIDTH * HEIGHT).map(|i| u16::try_from(i * 61).expect("in range")).collect();
    scene.images.push(Image {
        name: "bark_height".into(),
        kind: ImageKind::Data,
        width: WIDTH,
        height: HEIGHT,
        channels: 1,
        pixels: Pixels::U16(samples),
    });
    scene.materials[0].maps.height = Some(3);
    scene
}

fn write(dir: &Path, scene: Scene) -> osier::Result<Vec<u8>> {
    let mut exporter = Exr::new(Folder::open(dir).expect("folder"), Wanted::default());
    exporter.begin(&Arc::new(scene))?;
    exporter.finish()?;
    Ok(fs::read(dir.join("maps/bark/height.exr")).expect("map"))
}

fn in_pool(threads: usize) -> Vec<u8> {
    let dir = tempfile::tempdir().expect("dir");
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("pool");
    pool.install(|| write(dir.path(), scene())).expect("written")
}

#[test]
fn bytes_do_not_depend_on_threads() {
    let one = in_pool(1);
    assert!(one == in_pool(4) && one == in_pool(2));
}

#[test]
fn openexr_reads_the_same_heights() {
    let dir = tempfile::tempdir().expect("dir");
    write(dir.path(), scene()).expect("written");
    let Some(python) = clients::python() else { return };
    let path = dir.path().join("maps/bark/height.exr");
    let out = clients::python_script(&python, "read_exr.py", &[&path.to_string_lossy()]);
    let found: serde_json::Value = serde_json::from_slice(&out.stdout).expect("json");
    assert_eq!(found["channels"], serde_json::json!({"Y": "float16"}));
    assert!(found["compression"].as_str().expect("word").contains("ZIP_COMPRESSION"), "{}", found["compression"]);
    assert!(found["lineOrder"].as_str().expect("word").contains("INCREASING"), "{}", found["lineOrder"]);
    assert_eq!((&found["software"], &found["parts"]), (&"osier 0.1.0".into(), &1.into()));
    let keys: Vec<&str> = found["keys"].as_array().expect("list").iter().filter_map(|k| k.as_str()).collect();
    let wanted = [
        "channels",
        "chunkCount",
        "comments",
        "compression",
        "dataWindow",
        "displayWindow",
        "framesPerSecond",
        "lineOrder",
        "pixelAspectRatio",
        "screenWindowCenter",
        "screenWindowWidth",
        "software",
        "type",
    ];
    assert_eq!(keys, wanted);
    let comment: serde_json::Value = serde_json::from_str(found["comments"].as_str().expect("text")).expect("json");
    assert_eq!(comment["map"], "height");
    assert_eq!(comment["seed"], "18446744073709551557");
    assert_eq!(comment["unit"], "m");
    let rows = found["pixels"]["Y"].as_array().expect("rows");
    assert_eq!(rows.len(), HEIGHT as usize);
    for (i, value) in rows.iter().flat_map(|r| r.as_array().expect("row")).enumerate() {
        let wanted = i as f64 * 61.0 / 65535.0;
        let v = value.as_f64().expect("number");
        assert!((v - wanted).abs() <= wanted * 4.9e-4 + 6e-8 && (0.0..=1.0).contains(&v), "{i}: {v} {wanted}");
    }
}

#[test]
fn a_map_without_its_picture_is_an_error() {
    let dir = tempfile::tempdir().expect("dir");
    let mut scene = scene();
    scene.images.pop();
    let error = write(dir.path(), scene).expect_err("missing");
    assert!(error.to_string().starts_with("X012: material bark"), "{error}");
}
