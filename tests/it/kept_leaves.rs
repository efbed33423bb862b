//! Leaves of tables kept in a bake's folder: fetched where they fit in every byte, made again otherwise.
#![allow(clippy::expect_used, clippy::disallowed_methods, reason = "tests run the program and read its files")]

use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;
use std::sync::Arc;

use osier::bake::cache::ifs_leaves::load;
use osier::ifs::leaf::DrawnLeaf;
use osier::limits::Limits;
use osier::recipe::{Library, Recipe, Request, resolve};

const SCENE: &str = "[plants.a]\ngrammar = \"one.l\"\n[plants.a.leaf]\nifs = \"bamboo_leaf.ifs\"\nside = 128\n\
    [plants.b]\ngrammar = \"one.l\"\n[plants.b.leaf]\nifs = \"fern_leaf.ifs\"\nside = 64\n[output]\nformats = [\"obj\"]\n";

fn scene(folder: &Path, text: &str) -> std::path::PathBuf {
    let grammar = "Lsystem: one\nDerivation length: 0\nAxiom: !(0.004)F(0.05)~l\nendlsystem\n";
    std::fs::write(folder.join("one.l"), grammar).expect("grammar");
    let path = folder.join("scene.toml");
    std::fs::write(&path, text).expect("scene");
    path
}

fn bake(scene: &Path, out: &Path) {
    let run = Command::new(env!("CARGO_BIN_EXE_osier")).args(["-q", "bake"]).arg(scene).arg("-o").arg(out).output();
    let run = run.expect("osier runs");
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
}

fn recipe(scene: &Path) -> Recipe {
    let text = std::fs::read_to_string(scene).expect("scene");
    let library = Library::new(scene, &[]).expect("library");
    resolve(&Request { text, library, ..Request::default() }).expect("resolves").0
}

/// What a folder gives back for the leaves of a and b.
fn recalled(scene: &Path, out: &Path) -> [Option<DrawnLeaf>; 2] {
    let recipe = recipe(scene);
    load(&recipe, out, &Limits::default());
    [0, 1].map(|i| recipe.plants[i].organs[0].drawn.get().map(|d| d.clone().expect("a leaf")))
}

fn files(root: &Path) -> BTreeMap<String, Vec<u8>> {
    let list = osier::files::list_files(root).expect("files");
    list.into_iter().map(|f| (f.clone(), std::fs::read(root.join(f)).expect("bytes"))).collect()
}

#[test]
fn a_bake_beside_kept_leaves_has_the_same_bytes() {
    let dir = tempfile::tempdir().expect("dir");
    let (used, fresh) = (dir.path().join("used"), dir.path().join("fresh"));
    let first = scene(dir.path(), SCENE);
    assert_eq!(recalled(&first, &used), [None, None]);
    bake(&first, &used);
    let [a, b] = recalled(&first, &used);
    assert!(a.is_some_and(|d| d.side == 128) && b.is_some_and(|d| d.side == 64), "both are fetched");
    // Another seed, another colour of b: a is fetched, b made again.
    let text = format!("seed = 9\n{}", SCENE.replace("side = 64", "side = 64\ncolor = \"#a04020\""));
    let second = scene(dir.path(), &text);
    let [a, b] = recalled(&second, &used);
    assert!(a.is_some() && b.is_none());
    bake(&second, &used);
    bake(&second, &fresh);
    assert!(files(&used).keys().any(|f| f == "leaves/a_leaf/leaf.toml"));
    assert_eq!(files(&used), files(&fresh));
    assert_eq!(recalled(&second, &used), recalled(&second, &fresh));
}

#[test]
fn what_is_not_whole_is_made_again() {
    let dir = tempfile::tempdir().expect("dir");
    let out = dir.path().join("out");
    let scene = scene(dir.path(), SCENE);
    bake(&scene, &out);
    let whole = files(&out);
    let page = "leaves/a_leaf/leaf.toml";
    let text = String::from_utf8(whole[page].clone()).expect("text");
    let harm = |path: &str, bytes: &[u8]| {
        std::fs::write(out.join(path), bytes).expect("write");
        let [a, b] = recalled(&scene, &out);
        assert!(a.is_none() && b.is_some(), "{path}: {} bytes", bytes.len());
        std::fs::write(out.join(path), &whole[path]).expect("write");
    };
    harm(page, b"");
    harm(page, b"\xff\xfe");
    harm(page, &text.as_bytes()[..text.len() / 2]);
    harm(page, text.replace("side = 128", "side = 129").as_bytes());
    harm(page, text.replacen("points = [[", "points = [[1", 1).as_bytes());
    for map in ["color", "normal", "rough", "height"] {
        let path = format!("textures/a_leaf_{map}.png");
        let png = &whole[&path];
        harm(&path, &png[..png.len() - 20]);
        harm(&path, &[&png[..], b"x"].concat());
        harm(&path, &whole[&format!("textures/b_leaf_{map}.png")]);
    }
    std::fs::remove_file(out.join("textures/a_leaf_rough.png")).expect("gone");
    assert!(recalled(&scene, &out)[0].is_none());
    // The bake mends what was harmed.
    std::fs::write(out.join(page), b"").expect("write");
    bake(&scene, &out);
    assert_eq!(files(&out), whole);
}

#[test]
fn plants_that_bear_the_same_leaf_draw_it_once() {
    let dir = tempfile::tempdir().expect("dir");
    let same = SCENE.replace("fern_leaf.ifs\"\nside = 64", "bamboo_leaf.ifs\"\nside = 128");
    let leaves = |text: &str| {
        let recipe = recipe(&scene(dir.path(), text));
        [0, 1].map(|i| Arc::clone(&recipe.plants[i].organs[0].drawn))
    };
    let ([a, b], [c, d]) = (leaves(&same), leaves(SCENE));
    assert!(Arc::ptr_eq(&a, &b) && !Arc::ptr_eq(&c, &d));
}
