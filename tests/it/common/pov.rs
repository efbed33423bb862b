//! Baking for POV-Ray and running it.
#![allow(dead_code, reason = "each test file uses its own share")]
#![allow(clippy::expect_used, reason = "a test fails by panicking")]

use std::path::Path;
use std::process::{Command, Output};
use std::sync::Arc;

use osier::export::pov::{PovExporter, PovOptions};
use osier::export::textures::Textures;
use osier::export::{Exporter, Summary};
use osier::files::Folder;
use osier::scene::{Frame, Scene};

/// Writes a scene and its frames.
pub fn bake(dir: &Path, scene: &Scene, frames: &[Frame], options: PovOptions) -> Summary {
    let folder = Folder::open(dir).expect("folder");
    let textures = Arc::new(Textures::encode(scene).expect("textures"));
    let mut pov = PovExporter::new(folder, textures, options);
    pov.begin(&Arc::new(scene.clone())).expect("begin");
    frames.iter().for_each(|f| pov.frame(f).expect("frame"));
    pov.finish().expect("finish")
}

/// Runs POV-Ray in a folder; the test fails with its output unless it ends with 0.
pub fn render(povray: &Path, dir: &Path, arguments: &[&str]) -> Output {
    super::clients::run(Command::new(povray).current_dir(dir).args(arguments).arg("-D"))
}
