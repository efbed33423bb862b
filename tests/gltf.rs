//! glTF files: what the gltf crate and the Khronos validator read in them.
#![allow(clippy::expect_used, clippy::disallowed_methods, reason = "a test may fail and writes where it likes")]

#[path = "common/clients.rs"]
mod clients;
mod common;

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;

use osier::export::gltf::{Gltf, Layout, Options, Profile};
use osier::export::textures::Textures;
use osier::export::{Exporter as _, Warning};
use osier::fence::Folder;
use osier::scene::{Frame, Scene};

const PROFILES: [Profile; 2] = [Profile::Web, Profile::Blender];

/// Writes a scene with the frames given and returns what was said.
fn export(folder: &Path, scene: &Arc<Scene>, frames: &[Frame], options: Options) -> Vec<Warning> {
    let textures = Arc::new(Textures::encode(scene).expect("pictures"));
    let mut exporter = Gltf::new(Folder::open(folder).expect("folder"), textures, options);
    exporter.begin(scene).expect("begin");
    frames.iter().for_each(|f| exporter.frame(f).expect("frame"));
    exporter.finish().expect("finish").warnings
}

fn files(folder: &Path, ending: &str) -> Vec<PathBuf> {
    let mut list: Vec<PathBuf> = std::fs::read_dir(folder).expect("folder").map(|e| e.expect("entry").path()).collect();
    list.retain(|p| p.to_string_lossy().ends_with(ending));
    list.sort();
    list
}

/// Every layout and profile, still and moving: all .glb and .gltf files.
fn everything(folder: &Path) -> Vec<PathBuf> {
    let (scene, frames) = common::synthetic();
    let scene = Arc::new(scene);
    let mut list = Vec::new();
    for (word, frames) in [("still", &frames[..0]), ("moving", &frames[..])] {
        for profile in PROFILES {
            let at = folder.join(word);
            export(&at, &scene, frames, Options { profile, layout: Layout::Bake });
            let one = Layout::Glb(format!("one_{}.glb", profile.word()));
            export(&at, &scene, frames, Options { profile, layout: one });
            let text = Layout::Gltf(format!("text {}.gltf", profile.word()));
            export(&at, &scene, frames, Options { profile, layout: text });
        }
        list.extend(files(&folder.join(word), ".glb"));
        list.extend(files(&folder.join(word), ".gltf"));
        list.extend(files(&folder.join(word).join("gltf"), ".glb"));
    }
    list
}

#[test]
fn the_khronos_validator_finds_no_error_and_no_warning() {
    let Some((node, folder)) = clients::validator() else { return };
    let temp = tempfile::tempdir().expect("temp");
    let list = everything(temp.path());
    assert!(list.len() >= 2 * (2 * 5 + 4), "{list:?}");
    let output = clients::run(Command::new(node).arg(clients::script("gltf_validate.mjs")).arg(folder).args(&list));
    let text = String::from_utf8(output.stdout).expect("utf-8");
    let mut seen = 0;
    for line in text.lines() {
        let report: serde_json::Value = serde_json::from_str(line).expect("json");
        assert_eq!((&report["errors"], &report["warnings"]), (&0.into(), &0.into()), "{line}");
        for message in report["messages"].as_array().expect("messages") {
            let code = message["code"].as_str().unwrap_or_default();
            assert!(["UNSUPPORTED_EXTENSION", "UNUSED_OBJECT"].contains(&code), "{line}");
            if code == "UNUSED_OBJECT" {
                let pointer = message["pointer"].as_str().unwrap_or_default();
                assert!(line.contains("UNSUPPORTED_EXTENSION") && pointer.starts_with("/accessors/"), "{line}");
            }
        }
        seen += 1;
    }
    assert_eq!(seen, list.len());
}
