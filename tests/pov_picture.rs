//! What POV-Ray renders is a picture: light, not clipped, with things where they stand.
#![allow(clippy::expect_used, reason = "a test fails by panicking")]

#[path = "common/clients.rs"]
mod clients;
mod common;
#[path = "common/picture.rs"]
mod picture;
#[path = "common/pov.rs"]
mod pov;

use osier::export::pov::Options;
use osier::geometry::Bounds;
use osier::scene::asset_bounds;
use picture::{Picture, Rect, luma};

#[test]
fn the_synthetic_scene_makes_a_picture() {
    let dir = tempfile::tempdir().expect("dir");
    let (scene, frames) = common::synthetic();
    pov::bake(dir.path(), &scene, &frames, Options::default());
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
