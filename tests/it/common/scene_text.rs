//! Scenes that a test writes as text: their recipes, their frames and what they complain of.
#![allow(dead_code, reason = "each test file uses its own share")]
#![allow(clippy::expect_used, reason = "a test fails by panicking")]

use osier::bake::BakeContext;
use osier::bake::motion::evaluate_frame;
use osier::bake::scene::{AssembledScene, SceneOptions, assemble_scene};
use osier::limits::Limits;
use osier::progress::{Cancel, Silent};
use osier::recipe::{Recipe, Request, resolve};
use osier::scene::Frame;

use super::grown;

/// A scene file `s.toml` with this text.
pub fn request(text: &str) -> Request {
    Request { name: "s".into(), shown: "s.toml".into(), text: text.into(), ..Request::default() }
}

/// The recipe of a text, with small maps.
pub fn recipe(text: &str) -> Recipe {
    let mut recipe = resolve(&request(text)).unwrap_or_else(|e| panic!("{e}")).0;
    grown::small(&mut recipe);
    recipe
}

/// The scene of a text, with small maps.
pub fn assembled(text: &str) -> AssembledScene {
    grown::stage(&recipe(text), SceneOptions::default())
}

/// Frames of a scene by their numbers.
pub fn evaluated(scene: &AssembledScene, numbers: &[u32]) -> Vec<Frame> {
    let animated = &scene.animated;
    let frame = |n: &u32| evaluate_frame(&animated.scene, &animated.motions, *n, false).expect("a frame");
    numbers.iter().map(frame).collect()
}

/// What resolving and assembling a scene complains of.
pub fn complaint(text: &str) -> String {
    let recipe = match resolve(&request(text)) {
        Ok((recipe, report)) if report.diagnostics.is_empty() => recipe,
        Ok((_, report)) => return format!("{}", osier::Error::Input(Box::new(report))),
        Err(e) => return e.to_string(),
    };
    let work = BakeContext { limits: &Limits::default(), cancel: &Cancel::default(), progress: &Silent, cache: None };
    assemble_scene(&recipe, SceneOptions::default(), &work).map_or_else(|e| e.to_string(), |_| String::new())
}
