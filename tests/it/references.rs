//! References inside files never leave their folder and never block.
#![cfg(unix)]
#![allow(clippy::expect_used, clippy::disallowed_methods, reason = "tests set up the disk themselves")]

use std::fs;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};

use crate::common::program::{OSIER, arg, ends};
use osier::files::{ReadError, SearchPaths};

struct Place {
    _dir: tempfile::TempDir,
    top: PathBuf,
}

/// `scene/a.l` beside `scene/sub/b.l`, a secret outside, a library folder for `--search`.
fn place() -> Place {
    let dir = tempfile::tempdir().expect("dir");
    let top = dir.path().canonicalize().expect("real");
    for folder in ["scene/sub", "scene_evil", "library/deep"] {
        fs::create_dir_all(top.join(folder)).expect("folder");
    }
    for file in ["scene/a.l", "scene/sub/b.l", "scene/a b%41.l", "library/deep/c.l", "scene_evil/e.l", "secret"] {
        fs::write(top.join(file), file).expect("file");
    }
    symlink(top.join("secret"), top.join("scene/link_out")).expect("link");
    symlink(&top, top.join("scene/folder_out")).expect("link");
    symlink("sub/b.l", top.join("scene/link_in")).expect("link");
    symlink("loop", top.join("scene/loop")).expect("link");
    rustix::fs::mkfifoat(rustix::fs::CWD, top.join("scene/fifo"), rustix::fs::Mode::RWXU).expect("fifo");
    symlink("/dev/zero", top.join("scene/zero")).expect("link");
    Place { _dir: dir, top }
}

fn roots(place: &Place, search: &[&str]) -> SearchPaths {
    let search: Vec<PathBuf> = search.iter().map(|s| place.top.join(s)).collect();
    SearchPaths::new(&place.top.join("scene/main.toml"), &search).expect("roots")
}

/// A species that is a link out of the folder of its scene is refused with its name, although a preset has that name; one that
/// stays in the folder is read.
#[test]
fn a_link_that_leads_out_does_not_become_the_preset_of_its_name() {
    let p = place();
    let oak = fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/species/oak.species")).expect("oak");
    fs::write(p.top.join("oak.species"), &oak).expect("file");
    fs::write(p.top.join("scene/sub/oak.species"), &oak).expect("file");
    let scene = p.top.join("scene/tree.toml");
    fs::write(&scene, "[plants.tree]\nspecies = \"oak\"\nage = 2\n").expect("scene");
    let link = p.top.join("scene/oak.species");
    symlink(p.top.join("oak.species"), &link).expect("link");
    let (_, err) = ends(1, &["check", arg(&scene)]);
    assert!(err.contains("S005") && err.contains("\"oak.species\" leads out"), "{err}");
    assert!(err.contains("--search") && !err.contains("preset"), "{err}");
    ends(0, &["check", arg(&scene), "--search", arg(&p.top)]);
    fs::remove_file(&link).expect("remove");
    symlink("sub/oak.species", &link).expect("link");
    ends(0, &["check", arg(&scene)]);
}

/// A grammar that is opened by a link may lie anywhere: the user named it. Files that it includes are found beside the link.
#[test]
fn a_link_that_is_opened_may_lead_out() {
    let p = place();
    let grammar = "#include \"size.h\"\nLsystem: 1\nderivation length: 1\nAxiom: A\nA --> F(SIZE)\nendlsystem\n";
    fs::write(p.top.join("library/plant.l"), grammar).expect("file");
    fs::write(p.top.join("scene/size.h"), "#define SIZE 3\n").expect("file");
    let link = p.top.join("scene/plant.l");
    symlink(p.top.join("library/plant.l"), &link).expect("link");
    let (out, _) = ends(0, &["check", "--string", arg(&link)]);
    assert!(out.starts_with("F(3)\n"), "{out}");
    let scene = p.top.join("scene/plant.toml");
    fs::write(&scene, "[plants.plant]\ngrammar = \"plant.l\"\n").expect("scene");
    let (_, err) = ends(1, &["check", arg(&scene)]);
    assert!(err.contains("\"plant.l\" leads out"), "{err}");
}

/// The text of a pipe can be read once, and the grammar would be read again as a reference of its scene.
#[test]
fn a_grammar_in_a_pipe_is_told_to_be_saved() {
    let grammar = r"Lsystem: 1\nderivation length: 1\nAxiom: F\nendlsystem\n";
    let command = format!("printf '{grammar}' | '{OSIER}' check /dev/stdin");
    let run = std::process::Command::new("sh").args(["-c", &command]).output().expect("run");
    let err = String::from_utf8_lossy(&run.stderr);
    assert!(err.contains("S001") && err.contains("pipes") && err.contains("save it in a file"), "{err}");
}

#[test]
fn spellings_that_lead_out_are_refused_and_the_others_are_read() {
    let p = place();
    let roots = roots(&p, &[]);
    let from = p.top.join("scene/main.toml");
    let good =
        ["a.l", "./a.l", "sub/b.l", "sub\\b.l", "sub/../a.l", "sub//b.l", "link_in", "a b%41.l", "nothing/../a.l"];
    for reference in good {
        assert!(roots.read(&from, reference, 100).is_ok(), "{reference:?}");
    }
    let absolute = p.top.join("scene/a.l").display().to_string();
    let evil = [
        "",
        ".",
        "./",
        "/",
        "..",
        "../",
        "../secret",
        "sub/../../secret",
        "./../secret",
        "..\\secret",
        "\\secret",
        "/etc/passwd",
        "//host/share",
        "\\\\host\\share",
        "~/x",
        "~root/x",
        "~",
        "c:/x",
        "C:\\x",
        "c:x",
        "file:///etc/passwd",
        "http://x/y",
        "data:text/plain,x",
        "a.l:stream",
        "a\0.l",
        "a\n.l",
        "\u{1b}[2J",
        "sub/",
        "...",
        "sub/.../x",
        ". .",
        "sub/.. /x",
        "../scene_evil/e.l",
        "../scene/../secret",
        "link_out",
        "folder_out/secret",
        "folder_out/scene/../secret",
        "sub/../../scene_evil/e.l",
        "a.l\u{7f}",
        &absolute,
    ];
    assert!(evil.len() >= 40);
    for reference in evil {
        let refusal = roots.read(&from, reference, 100).expect_err(reference);
        assert_eq!(refusal.code(), "X009", "{reference:?}: {refusal}");
    }
}

#[test]
fn uris_are_decoded_once_and_then_checked() {
    let p = place();
    let roots = roots(&p, &[]);
    let from = p.top.join("scene/main.gltf");
    assert_eq!(roots.read_uri(&from, "a%20b%2541.l", 100).expect("read").bytes, b"scene/a b%41.l");
    for uri in ["%2e%2e/secret", "..%2fsecret", "%2fetc%2fpasswd", "sub%5c..%5c..%5csecret", "%00", "%", "%ff"] {
        assert_eq!(roots.read_uri(&from, uri, 100).expect_err(uri).code(), "X009", "{uri}");
    }
    assert!(matches!(roots.read_uri(&from, "%252e%252e/secret", 100), Err(ReadError::Missing { .. })));
}

#[test]
fn pipes_devices_folders_and_loops_are_refused_at_once() {
    let p = place();
    let roots = roots(&p, &["scene"]);
    let begin = start();
    for reference in ["fifo", "sub", "loop"] {
        let refusal = roots.read(&p.top.join("scene/main.toml"), reference, 100).expect_err(reference);
        assert_eq!(refusal.code(), "X010", "{reference}: {refusal}");
    }
    let dev = SearchPaths::new(Path::new("/dev/x"), &[]).expect("roots");
    for reference in ["zero", "null", "tty"] {
        assert!(dev.read(Path::new("/dev/x"), reference, 100).is_err(), "{reference}");
    }
    assert_eq!(roots.read(&p.top.join("scene/main.toml"), "zero", 100).expect_err("device").code(), "X009");
    assert!(begin.elapsed().as_secs_f64() < 1.0);
}

fn start() -> std::time::Instant {
    std::time::Instant::now()
}

#[test]
fn nested_references_and_search_folders() {
    let p = place();
    let scene = roots(&p, &[]);
    let nested = scene.read(&p.top.join("scene/sub/b.l"), "../a.l", 100).expect("up, but inside");
    assert_eq!(nested.path, p.top.join("scene/a.l"));
    assert!(matches!(scene.read(&p.top.join("scene/x"), "deep/c.l", 100), Err(ReadError::Missing { .. })));
    let wide = roots(&p, &["library"]);
    assert_eq!(wide.read(&p.top.join("scene/x"), "deep/c.l", 100).expect("found").bytes, b"library/deep/c.l");
    assert!(matches!(wide.read(&p.top.join("scene/x"), "deep/c.l", 3), Err(ReadError::TooLong { limit: 3, .. })));
    assert!(matches!(SearchPaths::none().read(&p.top.join("scene/x"), "a.l", 100), Err(ReadError::Missing { .. })));
    assert!(SearchPaths::new(&p.top.join("scene/x"), &[p.top.join("absent")]).is_err());
}
