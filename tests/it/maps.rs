//! Height maps and maps of wet leaves: equal bytes, exact values, and OpenEXR, Blender and POV-Ray read the same.
#![allow(clippy::expect_used, clippy::disallowed_methods, reason = "a test fails by panicking and looks at files")]
#![allow(clippy::cast_possible_truncation, reason = "small test numbers")]

use crate::common::clients;
use crate::common::pov;
use crate::common::synthetic;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use osier::export::Exporter;
use osier::export::exr::{ExrExporter, ExrOptions};
use osier::files::Folder;
use osier::scene::*;

const WIDTH: u32 = 37;
const HEIGHT: u32 = 29;

/// The synthetic scene with a height map on its bark; heights run over the whole range, row 0 on top.
fn scene() -> Scene {
    let (mut scene, _) = synthetic::scene();
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
    let mut exporter = ExrExporter::new(Folder::open(dir).expect("folder"), ExrOptions::default());
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

/// Writes the synthetic scene with its wet sheet, frame after frame.
fn wet(
    dir: &Path,
    wanted: ExrOptions,
    change: impl Fn(&mut Scene, &mut Vec<Frame>),
) -> osier::Result<osier::export::Summary> {
    let (mut scene, mut frames) = synthetic::scene();
    change(&mut scene, &mut frames);
    let mut exporter = ExrExporter::new(Folder::open(dir).expect("folder"), wanted);
    exporter.begin(&Arc::new(scene))?;
    frames.iter().try_for_each(|f| exporter.frame(f))?;
    exporter.finish()
}

/// Adds the layer of water alone.
fn with_water(scene: &mut Scene, _: &mut Vec<Frame>) {
    scene.map_sequences[0].layers.push(synthetic::WATER_LAYER);
}

/// What maps of the wet sheet hold at a frame, 0..1.
fn meant(map: &str, frame: u32) -> Vec<f64> {
    let maps = synthetic::wet_maps((frame - synthetic::START) as usize);
    let over = |v: &[f32]| v.iter().map(|h| f64::from(h / 0.004)).collect();
    match map {
        "height" => over(&maps.height),
        "water" => over(&maps.water),
        "wetness" => maps.wetness.iter().map(|v| f64::from(*v)).collect(),
        _ => maps.normal.as_flattened().iter().map(|v| f64::from(0.5 * v + 0.5)).collect(),
    }
}

/// Half floats have eleven bits.
fn assert_half(found: &[f64], wanted: &[f64], what: &str) {
    assert_eq!(found.len(), wanted.len(), "{what}");
    for (i, (f, w)) in found.iter().zip(wanted).enumerate() {
        assert!((f - w).abs() <= w * 4.9e-4 + 6e-8, "{what}, {i}: {f} {w}");
    }
}

/// All numbers in a nest of lists.
fn flat(value: &serde_json::Value) -> Vec<f64> {
    match value {
        serde_json::Value::Array(list) => list.iter().flat_map(flat).collect(),
        v => vec![v.as_f64().expect("number")],
    }
}

#[test]
fn openexr_reads_the_maps_of_a_wet_leaf() {
    let dir = tempfile::tempdir().expect("dir");
    let summary = wet(dir.path(), ExrOptions::default(), with_water).expect("written");
    assert!(summary.warnings.is_empty(), "{:?}", summary.warnings);
    let Some(python) = clients::python() else { return };
    for (map, channel) in [("height", "Y"), ("water", "Y"), ("wetness", "Y"), ("normal", "RGB")] {
        for frame in [1, 2, 7] {
            let path = dir.path().join(format!("maps/cache_l0/{map}.{frame:04}.exr"));
            let out = clients::python_script(&python, "read_exr.py", &[&path.to_string_lossy()]);
            let found: serde_json::Value = serde_json::from_slice(&out.stdout).expect("json");
            assert_eq!(found["channels"], serde_json::json!({channel: "float16"}));
            assert_half(&flat(&found["pixels"][channel]), &meant(map, frame), &format!("{map} {frame}"));
            let comment: serde_json::Value =
                serde_json::from_str(found["comments"].as_str().expect("text")).expect("json");
            let said = (&comment["map"], &comment["leaf"], &comment["frame"]);
            assert_eq!(said, (&map.into(), &"cache_l0".into(), &frame.into()));
        }
    }
}

#[test]
fn blender_reads_the_maps_of_a_wet_leaf() {
    let dir = tempfile::tempdir().expect("dir");
    wet(dir.path(), ExrOptions::default(), |_, _| ()).expect("written");
    let Some(python) = clients::python() else { return };
    let paths = ["height", "wetness"].map(|m| dir.path().join(format!("maps/cache_l0/{m}.0006.exr")));
    let paths: Vec<_> = paths.iter().map(|p| p.to_string_lossy()).collect();
    let out = clients::python_script(&python, "maps_blender.py", &paths.iter().map(|p| &**p).collect::<Vec<_>>());
    // Blender greets before it answers.
    let text = String::from_utf8_lossy(&out.stdout).into_owned();
    let line = text.lines().find(|l| l.starts_with("[[")).expect("an answer");
    let found: serde_json::Value = serde_json::from_str(line).expect("json");
    for (i, map) in ["height", "wetness"].iter().enumerate() {
        assert_half(&flat(&found[i]), &meant(map, 6), map);
    }
}

#[test]
fn pov_ray_reads_the_maps_of_a_wet_leaf() {
    let dir = tempfile::tempdir().expect("dir");
    wet(dir.path(), ExrOptions::default(), |_, _| ()).expect("written");
    let (scene, frames) = synthetic::scene();
    pov::bake(dir.path(), &scene, &frames, osier::export::pov::PovOptions::default());
    let Some(povray) = clients::povray() else { return };
    for (map, ending) in [("wetness", "png"), ("wetness", "exr"), ("height", "png"), ("height", "exr")] {
        let file = format!("maps/cache_l0/{map}.0006.{ending}");
        let side = synthetic::SIDE;
        // A square whose texels are the picture's pixels, glowing as bright as the pattern says.
        let text = format!(
            "#version 3.7; global_settings {{ assumed_gamma 1 }}\n\
             camera {{ orthographic location <0.5, 0.5, -1> right x up y look_at <0.5, 0.5, 0> }}\n\
             box {{ <0, 0, 0>, <1, 1, 1> pigment {{ image_pattern {{ {ending} \"{file}\" }}\n\
             color_map {{ [0 rgb 0] [1 rgb 1] }} }} finish {{ diffuse 0 ambient 0 emission 1 }} }}\n"
        );
        fs::write(dir.path().join("judge.pov"), text).expect("scene");
        let size = [format!("+W{side}"), format!("+H{side}")];
        let arguments = ["judge.pov", "+FN16", "File_Gamma=1", "-A", "+Ojudge.png", &size[0], &size[1]];
        pov::render(&povray, dir.path(), &arguments);
        let picture = image::open(dir.path().join("judge.png")).expect("picture").to_rgb16();
        for ((i, pixel), wanted) in picture.pixels().enumerate().zip(meant(map, 6)) {
            let found = f64::from(pixel.0[1]) / 65535.0;
            assert!((found - wanted).abs() < 6e-4, "{file}, {i}: {found} {wanted}");
        }
    }
}

#[test]
fn frames_that_show_the_same_differ_in_their_number_alone() {
    let dir = tempfile::tempdir().expect("dir");
    wet(dir.path(), ExrOptions::default(), |_, _| ()).expect("written");
    let read = |frame: u32| fs::read(dir.path().join(format!("maps/cache_l0/wetness.{frame:04}.exr"))).expect("map");
    let (one, two) = (read(1), read(2));
    let differ: Vec<(u8, u8)> = one.iter().zip(&two).filter(|(a, b)| a != b).map(|(a, b)| (*a, *b)).collect();
    assert_eq!((one.len(), differ), (two.len(), vec![(b'1', b'2')]));
}

#[test]
fn maps_of_wet_leaves_do_not_depend_on_threads() {
    let all = |threads: usize| {
        let dir = tempfile::tempdir().expect("dir");
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("pool");
        pool.install(|| wet(dir.path(), ExrOptions::default(), with_water)).expect("written");
        let names = osier::files::list_files(dir.path()).expect("files");
        let maps: Vec<PathBuf> =
            names.iter().filter(|n| n.starts_with("maps/cache")).map(|n| dir.path().join(n)).collect();
        assert_eq!(maps.len(), 4 * 9);
        maps.iter().map(|p| fs::read(p).expect("map")).collect::<Vec<_>>()
    };
    assert!(all(1) == all(5));
}

#[test]
fn what_no_map_may_hold_stops_the_bake() {
    let dir = tempfile::tempdir().expect("dir");
    let spoil = |f: fn(&mut synthetic::WetMaps)| {
        let mut maps = synthetic::wet_maps(3);
        f(&mut maps);
        wet(dir.path(), ExrOptions::default(), |_, frames| frames[3].maps = vec![maps.clone().frame()])
            .expect_err("refused")
            .to_string()
    };
    assert_eq!(spoil(|m| m.wetness[33] = 1.5), "X001: map sequence cache_l0, wetness, frame 4: texel 1, 1 is 1.5");
    assert!(spoil(|m| m.normal[0][1] = f32::NAN).starts_with("X001"));
    assert!(spoil(|m| m.height.truncate(9)).starts_with("X012"));
}

#[test]
fn what_is_higher_than_the_range_is_cut_and_counted() {
    let dir = tempfile::tempdir().expect("dir");
    let high = |frames: &mut Vec<Frame>| {
        for frame in frames {
            let MapTexels::Scalar(height) = &mut frame.maps[0].layers[0] else { panic!("heights come first") };
            Arc::make_mut(height)[5] = 0.005;
        }
    };
    let summary = wet(dir.path(), ExrOptions::default(), |_, frames| high(frames)).expect("written");
    assert_eq!(summary.warnings.len(), 1);
    let w = &summary.warnings[0];
    assert!(w.code == "X007" && w.message.starts_with("9 texels") && w.message.contains("frame 1"), "{w:?}");
}

#[test]
fn an_atlas_holds_each_sheet_where_its_list_says() {
    let dir = tempfile::tempdir().expect("dir");
    let two = |scene: &mut Scene, frames: &mut Vec<Frame>| {
        scene.map_sequences.push(MapSequence { name: "other".into(), ..scene.map_sequences[0].clone() });
        frames.truncate(1);
        let blank =
            synthetic::WetMaps { wetness: vec![0.25; synthetic::SIDE * synthetic::SIDE], ..synthetic::wet_maps(0) };
        frames[0].maps.push(blank.frame());
    };
    wet(dir.path(), ExrOptions { atlas: true }, two).expect("written");
    let text = fs::read_to_string(dir.path().join("maps/atlas.json")).expect("list");
    let list: serde_json::Value = serde_json::from_str(&text).expect("json");
    let texel = |i: usize| {
        let (scale, offset) = (flat(&list["sheets"][i]["scale"]), flat(&list["sheets"][i]["offset"]));
        // The place of its upper left corner, where u = 0 and v = 1.
        [offset[0] * 4096.0, (1.0 - offset[1] - scale[1]) * 4096.0].map(|v| v.round() as usize)
    };
    let Some(python) = clients::python() else { return };
    let path = dir.path().join("maps/atlas_00/wetness.0001.exr");
    for (i, wanted) in [(0, meant("wetness", 1)), (1, vec![0.25; synthetic::SIDE * synthetic::SIDE])] {
        let part = texel(i).into_iter().chain([synthetic::SIDE; 2]).map(|v| v.to_string()).collect::<Vec<_>>();
        let arguments = [&*path.to_string_lossy(), &part[0], &part[1], &part[2], &part[3]];
        let out = clients::python_script(&python, "read_exr.py", &arguments);
        let found: serde_json::Value = serde_json::from_slice(&out.stdout).expect("json");
        assert_half(&flat(&found["pixels"]["Y"]), &wanted, &format!("tile {i}"));
    }
}
