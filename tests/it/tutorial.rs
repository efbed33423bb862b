//! The tutorial, followed to the letter: its files in an empty folder, its commands in their order.
#![allow(clippy::expect_used, clippy::disallowed_methods, reason = "a test may fail and writes where it likes")]

use std::path::Path;
use std::process::Command;

/// Fenced blocks of the tutorial: the words behind the fence, and the lines.
fn blocks() -> Vec<(String, String)> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/tutorial.md");
    let text = std::fs::read_to_string(path).expect("tutorial");
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
}
