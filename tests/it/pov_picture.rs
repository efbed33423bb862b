//! What POV-Ray renders is a picture: light, not clipped, with things where they stand.
#![allow(clippy::expect_used, clippy::disallowed_methods, reason = "a test fails by panicking and writes its scene")]

use std::process::Command;

use crate::common::clients;
use crate::common::picture::{Picture, Rect, luma};
use crate::common::pov;
use crate::common::synthetic;
use osier::export::pov::PovOptions;
use osier::geometry::Bounds;
use osier::scene::asset_bounds;

#[test]
fn the_synthetic_scene_makes_a_picture() {
    let dir = tempfile::tempdir().expect("dir");
    let (scene, frames) = synthetic::scene();
    pov::bake(dir.path(), &scene, &frames, PovOptions::default());
    let Some(povray) = clients::povray() else { return };
    let folder = dir.path().join("pov");
    pov::render(&povray, &folder, &["render.ini", "+SF5", "+EF5", "+Op.png", "+W160", "+H120", "-A"]);
    let picture = Picture::open(&folder.join("p5.png"));
    picture.assert_content("synthetic, frame 5");

    let top = Rect { x0: 0, y0: 0, x1: 160, y1: 12 };
    let sky_blue = |c: [f32; 3]| c[2] > c[0] && luma(c) > 0.6;
    assert!(picture.share(top, sky_blue) > 0.99, "the top is sky");
    let bottom = Rect { x0: 0, y0: 112, x1: 160, y1: 120 };
    assert!(picture.share(bottom, sky_blue) < 0.01, "the bottom is ground");

    let dark = |c: [f32; 3]| luma(c) < 0.45;
    for (placement, least) in [(0, 0.05), (2, 0.1)] {
        let placed = &scene.placements[placement];
        let local = asset_bounds(&scene.assets[placed.asset], &frames[4].assets[placed.asset]);
        let world = Bounds::of(local.corners().map(|c| placed.transform.apply(c)));
        let rect = picture.rect_of(&scene.camera, world).expect("in view");
        let share = picture.share(rect, dark);
        assert!(share > least, "{}: {share} of {rect:?} is dark", placed.name);
    }
    let empty = Rect { x0: 0, y0: 15, x1: 18, y1: 50 };
    assert!(picture.share(empty, dark) < 0.01, "nothing stands in the open sky");
}

/// The scene of the page on formats that includes a plant, with another plant of its name.
#[test]
fn a_plant_is_included_in_a_scene_of_ones_own() {
    let Some(povray) = clients::povray() else { return };
    let dir = tempfile::tempdir().expect("dir");
    let sprig = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/scenes/sprig.toml");
    let grow = ["-q", "grow", sprig, "-o", "oak.pov"];
    clients::run(Command::new(env!("CARGO_BIN_EXE_osier")).current_dir(dir.path()).args(grow));
    let page = include_str!("../../docs/formats.md");
    let (_, rest) = page.split_once("```pov\n").expect("a scene of POV-Ray");
    let (text, _) = rest.split_once("```").expect("its end");
    // A sprig is a tenth as high as an oak.
    std::fs::write(dir.path().join("own.pov"), text.replace("scale 0.01", "scale 0.1")).expect("scene");
    pov::render(&povray, dir.path(), &["+Iown.pov", "+Oown.png", "+W160", "+H120", "-A"]);
    let picture = Picture::open(&dir.path().join("own.png"));
    let sky = picture.at(2, 2);
    let drawn = picture.share(picture.all(), |c| (0..3).any(|i| (c[i] - sky[i]).abs() > 0.1));
    assert!(drawn > 0.005, "{drawn} of the picture is plant");
}

/// A sheet that stands still, wet on one side: half of it is darker, and the frame's file says which half.
#[test]
fn the_wet_half_of_a_leaf_differs_from_the_dry_one() {
    use osier::scene::{Mesh, MeshObject, Subset};
    let dir = tempfile::tempdir().expect("dir");
    let (mut scene, frames) = synthetic::scene();
    let mut frames = frames[..2].to_vec();
    scene.clip.end = 2;
    let side = synthetic::SIDE;
    let corners = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)];
    let mesh = Mesh {
        points: corners.map(|(x, y)| glam::Vec3::new(x, y, 0.0)).to_vec(),
        normals: vec![glam::Vec3::Z; 4],
        uvs: corners.map(|(x, y)| glam::Vec2::new(x, y) * 0.5 + 0.5).to_vec(),
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        subsets: vec![Subset { material: 4, first: 0, count: 2 }],
        ..Mesh::default()
    };
    let sheet = MeshObject { name: "sheet".into(), mesh, motion: osier::scene::MeshMotion::Still, skin: None };
    scene.assets = vec![osier::scene::Asset { meshes: vec![sheet], ..scene.assets[4].clone() }];
    scene.placements.truncate(1);
    scene.placements[0].transform = osier::scene::Trs::IDENTITY;
    scene.materials[4].alpha_cutoff = None;
    scene.materials[4].maps.color = None;
    scene.camera.eye = glam::Vec3::new(0.0, 0.0, 5.0);
    (scene.camera.target, scene.camera.roll, scene.camera.vfov) = (glam::Vec3::ZERO, 0.0, 0.3);
    for (k, frame) in frames.iter_mut().enumerate() {
        let wet = |i: usize| if (i % side < side / 2) == (k == 0) { 1.0 } else { 0.0 };
        let wetness = (0..side * side).map(wet).collect();
        frame.maps = vec![synthetic::WetMaps { wetness, ..synthetic::wet_maps(0) }.frame()];
        frame.assets.truncate(1);
        frame.assets[0] = osier::scene::AssetFrame::default();
        (frame.shifted, frame.rows, frame.fields) = Default::default();
    }
    pov::bake(dir.path(), &scene, &frames, PovOptions::default());
    let Some(povray) = clients::povray() else { return };
    let folder = dir.path().join("pov");
    let out = pov::render(&povray, &folder, &["render.ini", "+Op.png", "+W80", "+H60", "-A"]);
    let said = String::from_utf8_lossy(&out.stderr).into_owned();
    let warnings = said.matches("Warning:").count();
    assert_eq!(warnings, said.matches("experimental feature").count(), "{said}");
    let halves = |name: &str| {
        let picture = Picture::open(&folder.join(name));
        [25, 55].map(|x| luma(picture.at(x, 30)))
    };
    let ([left, right], [later_left, later_right]) = (halves("p1.png"), halves("p2.png"));
    assert!(left < right - 0.05 && later_right < later_left - 0.05, "{left} {right}, {later_left} {later_right}");
}
