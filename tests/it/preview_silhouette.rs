//! The preview against POV-Ray: the same scene, the same camera, the same outline.
#![allow(
    clippy::expect_used,
    clippy::disallowed_methods,
    clippy::print_stdout,
    reason = "a test may fail, and says what it saw"
)]

use crate::common::clients;
use crate::common::grown;
use crate::common::pov;
use crate::common::synthetic;
use std::path::Path;

use osier::bake::motion;
use osier::bake::scene::SceneOptions;
use osier::export::pov::PovOptions;
use osier::presets;
use osier::preview::{Backdrop, Light, PreviewMaterials, Quality, RenderRequest, RenderScene, render};
use osier::progress::{Cancel, Silent};
use osier::scene::{Frame, Scene};

const SIZE: [u32; 2] = [640, 480];

/// Where things are, as the preview sees it: one look through the middle of each pixel.
fn ours(scene: &Scene, frame: Option<&Frame>) -> Vec<bool> {
    let materials = PreviewMaterials::new(scene, Quality::Draft);
    let world = RenderScene::new(scene, frame, &materials);
    let shot = RenderRequest {
        camera: scene.camera,
        size: SIZE,
        light: Light::new(&scene.sun, &scene.sky),
        backdrop: Backdrop::Clear { floor: None },
        seed: 0,
    };
    let picture = render(&world, &shot, &Cancel::default(), &Silent).expect("picture");
    picture.pixels.iter().map(|p| p[3] > 127).collect()
}

/// The same from POV-Ray, whose sky is taken away so that its alpha shows what stands before it.
fn theirs(povray: &Path, dir: &Path, scene: &Scene, frame: Option<&Frame>) -> Vec<bool> {
    pov::bake(dir, scene, frame.map(std::slice::from_ref).unwrap_or_default(), PovOptions::default());
    let folder = dir.join("pov");
    let main = folder.join("main.pov");
    let text = std::fs::read_to_string(&main).expect("scene");
    let start = text.find("sky_sphere").expect("a sky");
    let end = start + text[start..].find("\n}\n").expect("the sky's end") + 3;
    std::fs::write(&main, format!("{}{}", &text[..start], &text[end..])).expect("scene");
    let look = ["+Oalpha.png", "+W640", "+H480", "+UA", "-A", "+Q1"];
    match frame.map(|f| (format!("+SF{}", f.number), format!("+EF{}", f.number))) {
        Some((from, to)) => pov::render(povray, &folder, &[&["render.ini", &from, &to][..], &look].concat()),
        None => pov::render(povray, &folder, &[&["main.pov", "+L.."][..], &look].concat()),
    };
    let made = std::fs::read_dir(&folder).expect("folder").flatten().map(|e| e.path());
    let made = made.filter(|p| p.extension().is_some_and(|e| e == "png")).min().expect("a picture");
    let picture = image::open(made).expect("picture").to_rgba8();
    assert_eq!([picture.width(), picture.height()], SIZE);
    picture.pixels().map(|p| p.0[3] > 127).collect()
}

/// Shared over joint pixels.
fn overlap(a: &[bool], b: &[bool]) -> f64 {
    let both = a.iter().zip(b).filter(|(a, b)| **a && **b).count();
    let any = a.iter().zip(b).filter(|(a, b)| **a || **b).count();
    assert!(any > 2000, "only {any} pixels show anything");
    both as f64 / any as f64
}

#[test]
fn outlines_agree_with_povray_on_five_scenes() {
    let Some(povray) = clients::povray() else { return };
    let (synthetic, frames) = synthetic::scene();
    let mut scenes: Vec<(String, Scene, Option<Frame>)> =
        vec![("synthetic".into(), synthetic, frames.into_iter().find(|f| f.number == 5))];
    for (name, seed, frame) in
        [("oak.toml", 1, None), ("birch.toml", 3, None), ("poplar-twig.toml", 2, Some(40)), ("oak.toml", 8, Some(10))]
    {
        let preset = presets::find(name).expect("preset");
        let stage = grown::stage(&grown::recipe(preset, Some(seed), false), SceneOptions::WITHOUT_GROUND).animated;
        let frame: Option<Frame> =
            frame.map(|n| motion::evaluate_frame(&stage.scene, &stage.motions, n, true).expect("a frame"));
        scenes.push((format!("{name} {seed}"), (*stage.scene).clone(), frame));
    }
    for (name, scene, frame) in &scenes {
        let dir = tempfile::tempdir().expect("dir");
        let shared = overlap(&ours(scene, frame.as_ref()), &theirs(&povray, dir.path(), scene, frame.as_ref()));
        println!("{name}: {:.2} % of the outline is shared", shared * 100.0);
        assert!(shared >= 0.98, "{name}: only {shared:.4} is shared");
    }
}
