//! The manifest: equal for equal runs, and it names what was done to a bake.
#![allow(
    clippy::expect_used,
    clippy::disallowed_methods,
    clippy::float_cmp,
    reason = "tests fail by panicking, tamper with files and compare copied values"
)]

use crate::common::program::{arg, ends};
use crate::common::synthetic;
use std::fs;
use std::path::Path;
use std::sync::Arc;

use osier::export::file_target::FileTarget;
use osier::export::manifest::{self, FileEntry, MAX_LISTED_PLACES, PLACES_FILE, PlacesEntry, Settings};
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
        "stage",
        "view",
        "assets",
        "places",
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

/// A plant has a bark, shoots and dead wood, whether they show or not.
#[test]
fn materials_that_nothing_has_are_left_out() {
    let (mut scene, _) = synthetic::scene();
    let names = |scene: &osier::scene::Scene| -> Vec<String> {
        manifest::build(scene, &[], &[], &Settings::default()).materials.into_iter().map(|m| m.name).collect()
    };
    let all = names(&scene);
    let unused = osier::scene::Material { name: "dead".into(), ..scene.materials[0].clone() };
    scene.materials.insert(0, unused);
    // All ids but that of the new material, which nothing has, are one higher.
    for object in scene.assets.iter_mut().flat_map(|a| &mut a.meshes) {
        object.mesh.subsets.iter_mut().for_each(|s| s.material += 1);
    }
    for prototype in scene.assets.iter_mut().flat_map(|a| &mut a.instancers).flat_map(|i| &mut i.prototypes) {
        prototype.mesh.subsets.iter_mut().for_each(|s| s.material += 1);
    }
    scene.assets.iter_mut().flat_map(|a| &mut a.points).for_each(|p| p.material += 1);
    scene.assets.iter_mut().flat_map(|a| &mut a.curves).for_each(|c| c.material += 1);
    assert_eq!(names(&scene), all);
    assert!(all.contains(&"water".to_owned()), "drops that only some frames have: {all:?}");
}

#[test]
fn materials_of_colored_points_say_so() {
    let (mut scene, _) = synthetic::scene();
    let ground = scene.assets.iter_mut().find(|a| a.id == "ground").expect("the ground");
    ground.meshes[0].mesh.colors = vec![[1.0, 0.5, 0.0, 1.0]; 4];
    let manifest = manifest::build(&scene, &[], &[], &Settings::default());
    // Points of the rain have colours as well, but drops of the same material have none.
    let colored = manifest.materials.iter().filter(|m| m.params.vertex_colors).map(|m| m.name.as_str());
    assert_eq!(colored.collect::<Vec<_>>(), ["ground"]);
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
    let torn = verify(&text[..text.len() / 2]).expect_err("torn").to_string();
    assert!(
        torn.starts_with("X010") && torn.contains(&*dir.path().to_string_lossy()) && torn.contains("bake the"),
        "{torn}"
    );
    let other = text.replace("\"bake_hash\": \"", "\"bake_hash\": \"0");
    assert!(!verify(&other).expect("readable").1.sum_holds);
    fs::remove_file(&path).expect("remove");
    assert!(manifest::verify(dir.path(), 1 << 20).is_err());
}

#[test]
fn the_view_is_that_of_the_scene_and_places_are_rows_of_matrices() {
    let dir = tempfile::tempdir().expect("dir");
    bake(dir.path());
    let (m, _) = manifest::verify(dir.path(), 1 << 20).expect("verify");
    let (scene, _) = synthetic::scene();
    let view = m.view.expect("view");
    let [right, up, back] = scene.camera.axes();
    let wanted: Vec<f32> = [(right, 0.0), (up, 0.0), (back, 0.0), (scene.camera.eye, 1.0)]
        .iter()
        .flat_map(|(v, w)| [v.x, v.y, v.z, *w])
        .collect();
    assert!(view.camera.matrix.iter().zip(&wanted).all(|(a, b)| (a - b).abs() < 1e-6), "{:?}", view.camera.matrix);
    assert!((f64::from(view.camera.vfov_deg).to_radians() - f64::from(scene.camera.vfov)).abs() < 1e-6);
    assert_eq!(view.sun.toward, scene.sun.direction().to_array());
    assert_eq!(view.sun.irradiance, scene.sun.color.map(|c| c * scene.sun.strength));
    assert_eq!(view.sky.stops, scene.sky.stops());
    assert_eq!((m.time.written, m.time.loop_frames, m.stage), (Some([scene.clip.start, scene.clip.end]), None, None));
    let PlacesEntry::Lists(lists) = m.places else { panic!("lists") };
    assert_eq!(lists.values().map(Vec::len).sum::<usize>(), scene.placements.len());
    for placement in &scene.placements {
        let matrix = placement.transform.matrix().to_cols_array();
        let list = &lists[&scene.assets[placement.asset].id];
        assert!(list.iter().any(|p| p.matrix == matrix && p.offset == placement.phase), "{}", placement.name);
    }
}

#[test]
fn many_places_are_a_table_beside_the_manifest() {
    let dir = tempfile::tempdir().expect("dir");
    let (mut scene, _) = synthetic::scene();
    let last = scene.placements.last().cloned().expect("placement");
    scene.placements.resize_with(MAX_LISTED_PLACES, || last.clone());
    let folder = Folder::open(dir.path()).expect("folder");
    manifest::write_places(&folder, &scene).expect("few");
    assert!(folder.files().is_empty(), "a thousand are listed");
    scene.placements.push(last.clone());
    manifest::write_places(&folder, &scene).expect("many");
    let m = manifest::build(&scene, &folder.files(), &[], &Settings::default());
    assert_eq!(m.places, PlacesEntry::Table(PLACES_FILE.into()));
    let bytes = fs::read(dir.path().join(PLACES_FILE)).expect("table");
    assert_eq!(bytes.len(), 40 * (MAX_LISTED_PLACES + 1));
    let row: Vec<f32> =
        bytes[bytes.len() - 40..].chunks_exact(4).map(|b| f32::from_le_bytes(b.try_into().expect("4"))).collect();
    let (t, r) = (last.transform.t, last.transform.r);
    assert_eq!(row[2..9], [t.x, t.y, t.z, r.x, r.y, r.z, r.w]);
    assert_eq!([f64::from(row[0]), f64::from(row[1])], [last.asset as f64, f64::from(last.phase)]);
}

#[test]
fn manifests_of_earlier_versions_are_read() {
    let dir = tempfile::tempdir().expect("dir");
    let text = bake(dir.path());
    let mut value: serde_json::Value = serde_json::from_str(&text).expect("JSON");
    for key in ["stage", "view", "places"] {
        value.as_object_mut().expect("object").remove(key).expect(key);
    }
    for (part, keys) in [("time", ["written", "loop"]), ("units", ["wet_albedo", "wet_roughness"])] {
        keys.iter().for_each(|key| drop(value[part].as_object_mut().expect("object").remove(*key).expect("key")));
    }
    for asset in value["assets"].as_array_mut().expect("assets") {
        ["plant", "points_material"].iter().for_each(|key| drop(asset.as_object_mut().expect("object").remove(*key)));
    }
    fs::write(dir.path().join("manifest.json"), value.to_string()).expect("write");
    let (m, found) = manifest::verify(dir.path(), 1 << 20).expect("an old manifest");
    assert!(found.is_complete() && m.view.is_none() && m.time.written.is_none(), "{found:?}");
}

#[test]
fn point_caches_belong_to_their_plant() {
    let dir = tempfile::tempdir().expect("dir");
    let scene = dir.path().join("s.toml");
    // The second plant has the name of the first and of one of its meshes.
    let text = "[frames]\nend = 2\n[plants.twig]\ngrammar = \"poplar-twig.l\"\nmotion = \"cache\"\n[plants.twig.rods]\n\
                [plants.twig_bark]\ngrammar = \"poplar-twig.l\"\nmotion = \"cache\"\n\
                [[place]]\nplant = \"twig\"\n[[place]]\nplant = \"twig_bark\"\n\
                [wind]\nspeed = 3\n[ground]\nshow = false\n[output]\nformats = [\"pc2\"]\n";
    fs::write(&scene, text).expect("scene");
    let out = dir.path().join("out");
    ends(0, &["-q", "bake", arg(&scene), "-o", arg(&out)]);
    let manifest: serde_json::Value =
        serde_json::from_slice(&fs::read(out.join("manifest.json")).expect("manifest")).expect("JSON");
    let caches = serde_json::json!(["cache/twig.bark.pc2", "cache/twig.leaves_stalks.pc2"]);
    assert_eq!(manifest["assets"][0]["files"], caches);
    assert_eq!(manifest["assets"][1]["files"], serde_json::json!(["cache/twig_bark.pc2"]));
    let written: Vec<&str> =
        manifest["files"].as_array().expect("files").iter().filter_map(|f| f["path"].as_str()).collect();
    for file in ["cache/twig.bark.pc2", "cache/twig.leaves_stalks.pc2", "cache/twig_bark.pc2"] {
        assert!(written.contains(&file), "{written:?}");
    }
}
