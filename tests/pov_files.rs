//! POV-Ray reads what we write.
#![allow(clippy::expect_used, reason = "a test fails by panicking")]

#[path = "common/clients.rs"]
mod clients;
mod common;

use std::path::Path;
use std::process::{Command, Output};
use std::sync::Arc;

use osier::export::pov::{Options, Pov};
use osier::export::textures::Textures;
use osier::export::{Exporter, Summary};
use osier::fence::Folder;
use osier::scene::{Frame, Scene};

fn bake(dir: &Path, scene: Scene, frames: &[Frame], options: Options) -> Summary {
    let folder = Folder::open(dir).expect("folder");
    let textures = Textures::encode(&scene).expect("textures");
    let mut pov = Pov::new(folder, textures, options);
    pov.begin(&Arc::new(scene)).expect("begin");
    frames.iter().for_each(|f| pov.frame(f).expect("frame"));
    pov.finish().expect("finish")
}

fn render(povray: &Path, dir: &Path, arguments: &[&str]) -> Output {
    clients::run(Command::new(povray).current_dir(dir).args(arguments).args(["+W8", "+H6", "-A", "-D"]))
}

#[test]
fn every_file_of_the_synthetic_scene_parses() {
    let dir = tempfile::tempdir().expect("dir");
    let (scene, frames) = common::synthetic();
    let summary = bake(dir.path(), scene, &frames, Options::default());
    assert!(summary.warnings.is_empty());
    let Some(povray) = clients::povray() else { return };
    let pov = dir.path().join("pov");
    for frame in ["1", "5", "9"] {
        let (from, to) = (format!("+SF{frame}"), format!("+EF{frame}"));
        render(&povray, &pov, &["render.ini", &from, &to, "+Oframe.png"]);
        assert!(pov.join(format!("frame{frame}.png")).is_file());
    }
    render(&povray, &pov, &["main.pov", "+L..", "+Ostill.png"]);
    assert!(pov.join("still.png").is_file());
}
