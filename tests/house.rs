//! The house keeps its shape: one-way imports, small files, tables equal to their documents.
#![allow(clippy::disallowed_methods, clippy::expect_used, reason = "tests read the tree and fail loudly")]

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

/// Rooms by layer; a room imports only from lower layers, or from itself.
const LAYERS: &[&[&str]] = &[
    &["diagnostic", "error", "fence", "geometry", "limits", "math", "noise", "par", "progress", "rng", "text", "units"],
    &["scene", "solid"],
    &["export", "plant", "wind"],
    &["grammar", "ifs", "import"],
    &["grow", "surface"],
    &["motion"],
    &["bake", "presets", "preview", "recipe"],
    &["cli"],
];

/// Bake runs what recipe resolves, and both read the presets: the one exception inside a layer, one way.
const SAME_LAYER: &[(&str, &str)] = &[("bake", "recipe"), ("recipe", "presets"), ("bake", "presets")];

fn sources(folder: &Path, out: &mut Vec<PathBuf>) {
    let mut entries: Vec<_> = fs::read_dir(folder).expect("src").map(|e| e.expect("entry").path()).collect();
    entries.sort();
    for path in entries {
        if path.is_dir() {
            sources(&path, out);
        } else if path.extension().is_some_and(|e| e == "rs") {
            out.push(path);
        }
    }
}

fn all_sources() -> Vec<(String, String)> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut paths = Vec::new();
    sources(&root, &mut paths);
    let name = |p: &PathBuf| p.strip_prefix(&root).expect("below src").to_string_lossy().replace('\\', "/");
    paths.iter().map(|p| (name(p), fs::read_to_string(p).expect("utf-8"))).collect()
}

fn room(file: &str) -> &str {
    let first = file.split('/').next().unwrap_or(file);
    first.strip_suffix(".rs").unwrap_or(first)
}

/// Rooms named as `crate::room` in a text, with `use crate::{a, b}` taken apart.
fn imports(text: &str) -> Vec<String> {
    let mut found = Vec::new();
    for part in text.split("crate::").skip(1) {
        let ident = |s: &str| s.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect::<String>();
        if let Some(group) = part.strip_prefix('{') {
            let mut depth = 0;
            let mut start = true;
            for (i, c) in group.char_indices() {
                match c {
                    '{' => depth += 1,
                    '}' if depth == 0 => break,
                    '}' => depth -= 1,
                    ',' if depth == 0 => start = true,
                    c if start && depth == 0 && c.is_alphabetic() => {
                        found.push(ident(&group[i..]));
                        start = false;
                    }
                    _ => {}
                }
            }
        } else {
            found.push(ident(part));
        }
    }
    found
}

#[test]
fn imports_go_one_way() {
    let layer: BTreeMap<&str, usize> =
        LAYERS.iter().enumerate().flat_map(|(i, l)| l.iter().map(move |r| (*r, i))).collect();
    let mut wrong = Vec::new();
    for (file, text) in all_sources().iter().filter(|(f, _)| f != "lib.rs" && f != "main.rs") {
        let from = room(file);
        let Some(&at) = layer.get(from) else {
            wrong.push(format!("{file}: room {from} has no layer"));
            continue;
        };
        for to in imports(text) {
            let allowed = to == from || SAME_LAYER.contains(&(from, to.as_str()));
            if layer.get(to.as_str()).is_some_and(|&l| l > at || (l == at && at > 0)) && !allowed {
                wrong.push(format!("{file} imports {to}"));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn imports_are_seen_in_every_form() {
    let text = "use crate::{Error, scene::{Mesh, Trs}, math};\nlet x = crate::rng::word(\"a\");";
    assert_eq!(imports(text), ["Error", "scene", "math", "rng"]);
}

#[test]
fn files_stay_small() {
    let long: Vec<String> = all_sources()
        .iter()
        .map(|(f, t)| (f, t.lines().count()))
        .filter(|(_, n)| *n > 600)
        .map(|(f, n)| format!("{f} has {n} lines"))
        .collect();
    assert!(long.is_empty(), "{}", long.join("\n"));
}
