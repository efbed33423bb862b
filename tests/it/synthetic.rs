//! The synthetic scene itself is valid: what every exporter test rests on.

use crate::common::clients;
use crate::common::expect;
use crate::common::synthetic;
use osier::scene::{check_frame, check_scene};

#[test]
fn the_synthetic_scene_is_valid_at_every_frame() {
    let (scene, frames) = synthetic::scene();
    check_scene(&scene).expect("scene");
    for frame in &frames {
        check_frame(&scene, frame).expect("frame");
    }
    assert_eq!(frames.len(), scene.clip.len());
}

#[test]
fn expectations_hold_every_placed_thing() {
    let (scene, frames) = synthetic::scene();
    let all = expect::expect(&scene, &frames, &expect::three(&scene));
    let last = &all["frames"][scene.clip.end.to_string()];
    assert_eq!(last["meshes"].as_object().map(|m| m.len()), Some(5));
    assert_eq!(last["instancers"]["tracks/flying"][2]["alive"], false);
    assert!(clients::script("").is_dir() || !clients::clients().exists());
}
