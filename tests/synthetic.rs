//! The synthetic scene itself is valid: what every exporter test rests on.

mod common;

use osier::scene::{check_frame, check_scene};

#[test]
fn the_synthetic_scene_is_valid_at_every_frame() {
    let (scene, frames) = common::synthetic();
    check_scene(&scene).expect("scene");
    for frame in &frames {
        check_frame(&scene, frame).expect("frame");
    }
    assert_eq!(frames.len(), scene.clip.len());
}
