//! What the compiler does not hold of the architecture: which crate may know which, one-way imports inside the package.
#![allow(clippy::disallowed_methods, clippy::expect_used, reason = "tests read the tree and fail loudly")]

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

/// Crates with those of ours that each may depend on, `ARCHITECTURE.md`'s table.
const CRATES: &[(&str, &[&str])] = &[
    ("base", &[]),
    ("scene", &["base"]),
    ("grammar", &["base"]),
    ("ifs", &["base", "scene"]),
    ("import", &["base", "scene"]),
    ("wind", &["base", "scene"]),
    ("plants", &["base", "scene", "grammar", "ifs", "import"]),
    ("motion", &["base", "scene", "wind"]),
    ("export", &["base", "scene"]),
    ("preview", &["base", "scene", "export"]),
];

/// Modules of the package itself by layer: a module imports only from layers before its own, or from itself.
const LAYERS: &[&[&str]] =
    &[&["presets"], &["recipe"], &["bake"], &["source"], &["check", "scene_preview", "single_file"], &["cli"]];

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn sources(folder: &Path, out: &mut Vec<PathBuf>) {
    let mut entries: Vec<_> = fs::read_dir(folder).expect("a folder").map(|e| e.expect("entry").path()).collect();
    entries.sort();
    for path in entries {
        if path.is_dir() {
            sources(&path, out);
        } else if path.extension().is_some_and(|e| e == "rs") {
            out.push(path);
        }
    }
}

/// Paths below the root and texts of the sources in a folder.
fn read_sources(folder: &str) -> Vec<(String, String)> {
    let mut paths = Vec::new();
    sources(&root().join(folder), &mut paths);
    let name = |p: &PathBuf| p.strip_prefix(root()).expect("below root").to_string_lossy().replace('\\', "/");
    paths.iter().map(|p| (name(p), fs::read_to_string(p).expect("utf-8"))).collect()
}

/// Crates of ours that a manifest names as dependencies of any kind.
fn dependencies(manifest: &Path) -> BTreeSet<String> {
    let text = fs::read_to_string(manifest).expect("a manifest");
    let table: toml::Table = text.parse().expect("TOML");
    let kinds = ["dependencies", "dev-dependencies", "build-dependencies"];
    let tables = kinds.iter().filter_map(|kind| table.get(*kind)?.as_table());
    tables.flat_map(|t| t.keys()).filter_map(|name| name.strip_prefix("osier-")).map(str::to_owned).collect()
}

#[test]
fn crates_know_only_what_the_table_allows() {
    let found: BTreeSet<String> = fs::read_dir(root().join("crates"))
        .expect("crates")
        .map(|e| e.expect("entry").file_name().to_string_lossy().into_owned())
        .collect();
    let listed: BTreeSet<String> = CRATES.iter().map(|(name, _)| (*name).to_owned()).collect();
    assert_eq!(found, listed);
    for (name, allowed) in CRATES {
        let known = dependencies(&root().join(format!("crates/{name}/Cargo.toml")));
        let allowed: BTreeSet<String> = allowed.iter().map(|a| (*a).to_owned()).collect();
        let wrong: Vec<&String> = known.difference(&allowed).collect();
        assert!(wrong.is_empty(), "osier-{name} depends on {wrong:?}");
    }
}

/// Whether an SPDX expression lets us take licenses of `allowed` alone: one alternative of each of its conditions is among them.
/// Older manifests write `/` for `OR`.
fn is_allowed(expression: &str, allowed: &BTreeSet<&str>) -> bool {
    let expression = expression.replace('/', " OR ");
    expression.split(" AND ").all(|condition| {
        let condition = condition.trim_matches(['(', ')', ' ']);
        condition.split(" OR ").any(|license| allowed.contains(license.trim()))
    })
}

/// `deny.toml` is the list that `cargo deny`, which `tests/full.sh` runs, reads too.
#[test]
fn dependencies_come_from_the_registry_under_allowed_licenses() {
    let text = fs::read_to_string(root().join("deny.toml")).expect("deny.toml");
    let table: toml::Table = text.parse().expect("TOML");
    let allowed: BTreeSet<&str> =
        table["licenses"]["allow"].as_array().expect("a list").iter().filter_map(toml::Value::as_str).collect();
    let yes = ["MIT", "MIT/Unknown", "(MIT OR Unknown) AND ISC"].map(|e| is_allowed(e, &allowed));
    let no = ["Unknown", "MIT AND Unknown", "(ISC OR MIT) AND Unknown"].map(|e| is_allowed(e, &allowed));
    assert_eq!((yes, no), ([true; 3], [false; 3]));

    // The manifests of packages for other systems, which no build here has needed, are downloaded.
    let output = std::process::Command::new(env!("CARGO"))
        .current_dir(root())
        .args(["metadata", "--format-version", "1", "--locked", "--all-features"])
        .output()
        .expect("cargo");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let metadata: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON");
    let packages = metadata["packages"].as_array().expect("packages");
    assert!(packages.len() > 100, "{}", packages.len());
    for package in packages {
        let name = &package["name"];
        let license = package["license"].as_str().unwrap_or_default();
        assert!(is_allowed(license, &allowed), "{name} has the license {license:?}");
        let source = package["source"].as_str();
        assert!(
            source.is_none_or(|s| s == "registry+https://github.com/rust-lang/crates.io-index"),
            "{name} is from {source:?}"
        );
    }
}

#[test]
fn every_package_holds_the_texts_of_its_licenses() {
    for name in ["LICENSE-MIT", "LICENSE-APACHE"] {
        let whole = fs::read(root().join(name)).expect("a license");
        for (package, _) in CRATES {
            let path = root().join(format!("crates/{package}/{name}"));
            assert!(fs::read(&path).is_ok_and(|text| text == whole), "{}", path.display());
        }
    }
}

/// Modules named as `crate::module` in a text, with `use crate::{a, b}` taken apart.
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
    for (file, text) in read_sources("src").iter().filter(|(f, _)| f != "src/lib.rs" && f != "src/main.rs") {
        let module = file.split('/').nth(1).unwrap_or_default().trim_end_matches(".rs");
        let Some(&at) = layer.get(module) else {
            wrong.push(format!("{file}: module {module} has no layer"));
            continue;
        };
        for to in imports(text) {
            if to != module && layer.get(to.as_str()).is_none_or(|&l| l >= at) {
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
