//! The tutorial, followed to the letter: its files in an empty folder, its commands in their order.
#![allow(clippy::expect_used, clippy::disallowed_methods, reason = "a test may fail and writes where it likes")]

use std::path::Path;
use std::process::Command;

use crate::common::clients;

fn tutorial() -> String {
    std::fs::read_to_string(root().join("docs/tutorial.md")).expect("tutorial")
}

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// Fenced blocks of the tutorial: the words behind the fence, and the lines.
fn blocks() -> Vec<(String, String)> {
    let text = tutorial();
    let parts: Vec<&str> = text.split("```").collect();
    let block = |part: &&str| part.split_once('\n').map(|(tag, body)| (tag.to_owned(), body.to_owned()));
    parts.iter().skip(1).step_by(2).filter_map(block).collect()
}

#[test]
fn its_files_and_commands_work_in_an_empty_folder() {
    let dir = tempfile::tempdir().expect("dir");
    let mut commands = 0;
    for (tag, body) in blocks() {
        match tag.split_once(' ') {
            Some((_, file)) => std::fs::write(dir.path().join(file), body).expect("written"),
            None if tag == "sh" => {
                for line in body.lines() {
                    let mut words = line.split(' ');
                    assert_eq!(words.next(), Some("osier"), "{line}");
                    let mut command = Command::new(env!("CARGO_BIN_EXE_osier"));
                    let output = command.args(words).current_dir(dir.path()).output().expect("osier runs");
                    let messages = String::from_utf8_lossy(&output.stderr);
                    assert!(output.status.success(), "{line}\n{messages}");
                    assert!(!messages.contains("warning["), "{line}\n{messages}");
                    commands += 1;
                }
            }
            None => {}
        }
    }
    assert_eq!(commands, 5);
    for file in ["sapling.png", "seeds.png", "wide.png", "out/sapling/manifest.json", "out/sapling/pov/render.ini"] {
        assert!(dir.path().join(file).is_file(), "{file}");
    }
    blender_step(dir.path());
    povray_step(dir.path());
}

/// Step 5 in the folder of the tutorial: the extension is packed by the command of the text, and imports the bake.
fn blender_step(folder: &Path) {
    let Some(python) = clients::python() else { return };
    let text = tutorial();
    let packs = text.split('`').find(|words| words.ends_with("blender/build.py")).expect("the command that packs");
    let [program, script] = packs.split(' ').collect::<Vec<_>>()[..] else { panic!("{packs}") };
    assert_eq!(program, "python3");
    clients::run(Command::new(&python).current_dir(root()).arg(script).arg(folder.join("zips")));
    let zips = std::fs::read_dir(folder.join("zips")).expect("zips");
    assert!(zips.map(|zip| zip.expect("entry").file_name()).any(|name| name.to_string_lossy().ends_with(".zip")));

    assert!(text.contains("choose `out/sapling/manifest.json`"));
    let manifest = folder.join("out/sapling/manifest.json");
    let output = clients::run(Command::new(python).arg(root().join("blender/tests/presets.py")).arg(manifest));
    let report = String::from_utf8_lossy(&output.stdout);
    assert!(report.contains("\"failed\": []") && report.contains("\"sapling\": ["), "{report}");
}

/// Step 6 in the folder of the tutorial: its command, with a smaller picture, writes `main.png`.
fn povray_step(folder: &Path) {
    let Some(povray) = clients::povray() else { return };
    let (_, body) = blocks().into_iter().find(|(_, body)| body.starts_with("povray ")).expect("the command of POV-Ray");
    let mut words = body.split_whitespace();
    assert_eq!(words.next(), Some("povray"));
    let pov = folder.join("out/sapling/pov");
    clients::run(Command::new(povray).current_dir(&pov).args(words).args(["Width=80", "Height=60", "Display=off"]));
    assert!(tutorial().contains("renders the first frame to `main.png`") && pov.join("main.png").is_file());
}
