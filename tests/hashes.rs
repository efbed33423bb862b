//! The bytes that every preset makes, held to a list: whatever changes them says so in the list's diff.
//!
//! Every preset is baked for its first frames in all formats, and every grammar and table is grown into single files, each with
//! another number of threads, and with another one than when the list was written. `tests/hashes.txt` holds a hash for each folder
//! of a bake and each file; `OSIER_BLESS=1 cargo test --release --test hashes` writes it anew, and the change belongs under "Output
//! changes" of the changelog.
#![allow(
    clippy::expect_used,
    clippy::disallowed_methods,
    clippy::print_stdout,
    reason = "a test may fail, and says what it did"
)]

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;
use std::path::Path;
use std::sync::Mutex;

use osier::presets::PRESETS;

#[path = "it/common/program.rs"]
mod program;
#[path = "it/common/short_bakes.rs"]
mod short_bakes;

use program::{arg, run, said, tree};
use short_bakes::{is_grown, is_picture, shortened};

/// Numbers of threads, in turn.
const THREADS: [usize; 3] = [1, 2, 5];

/// The hash of each folder of a bake: of the lines `path NUL hash LF` of its files. The journal is not part of the result, and the
/// manifest repeats the hashes of the files beside a hash of the scene's text.
fn of_bake(preset: &str, threads: usize, out: &Path) -> BTreeMap<String, String> {
    // A grown tree has millions of triangles, which texts would write in hundreds of megabytes.
    let formats = if is_grown(preset) { "usd,glb" } else { "usd,glb,pov,obj,ply,pc2,exr,csv,tracks" };
    let threads = format!("-j{threads}");
    let mut args = vec!["-q", &threads, "bake", preset, "--force", "-o", arg(out), "--formats", formats];
    args.extend(["--set", "output.gltf.profiles=[\"blender\",\"web\"]"]);
    let overrides = shortened(preset);
    args.extend(overrides.iter().flat_map(|key| ["--set", key.as_str()]));
    let (code, _, told) = said(&run(&args));
    assert_eq!(code, 0, "{preset}: {told}");
    let mut folders: BTreeMap<String, blake3::Hasher> = BTreeMap::new();
    for (path, bytes) in tree(out).iter().filter(|(p, _)| *p != "manifest.json" && !p.starts_with(".osier")) {
        let folder = path.split_once('/').map_or("scene", |(folder, _)| folder);
        let hash = blake3::hash(bytes).to_hex();
        let hasher = folders.entry(folder.to_owned()).or_default();
        hasher.update(path.as_bytes()).update(b"\0").update(hash.as_bytes()).update(b"\n");
    }
    folders.into_iter().map(|(folder, h)| (format!("bake {preset} {folder}"), short(&h.finalize()))).collect()
}

/// Half of a hash tells files apart as well, and two of them fit a line.
fn short(hash: &blake3::Hash) -> String {
    hash.to_hex()[..32].to_owned()
}

/// Years that a species grows into a single file.
const YEARS_OF_A_FILE: u32 = 8;

/// The hash of a single file that a preset grows into; a species grows for some years.
fn of_file(preset: &str, ending: &str, threads: usize, folder: &Path) -> (String, String) {
    let file = folder.join(format!("{preset}.{ending}"));
    let threads = format!("-j{threads}");
    let mut args = vec!["-q", &threads, "grow", preset, "--force", "-o", arg(&file)];
    let years = format!("age={YEARS_OF_A_FILE}");
    if preset.ends_with(".species") {
        args.extend(["--set", &years]);
    }
    let (code, _, told) = said(&run(&args));
    assert_eq!(code, 0, "{preset}: {told}");
    (format!("grow {preset} {ending}"), short(&blake3::hash(&fs::read(&file).expect("a file"))))
}

/// The hashes of all presets. `turn`: number by which the numbers of threads are shifted.
fn all(turn: usize) -> BTreeMap<String, String> {
    let found = Mutex::new(BTreeMap::new());
    let next = Mutex::new(PRESETS.iter().enumerate());
    let work = || {
        loop {
            let Some((i, preset)) = next.lock().expect("lock").next() else { return };
            let dir = tempfile::tempdir().expect("folder");
            let threads = |k: usize| THREADS[(i + k + turn) % THREADS.len()];
            let (name, path) = (preset.name, dir.path());
            let mut hashes = BTreeMap::new();
            match name.rsplit_once('.').map(|(_, ending)| ending) {
                Some("obj") => {}
                Some("species") => hashes.extend([of_file(name, "glb", threads(0), path)]),
                Some("l") => {
                    hashes.extend([of_file(name, "glb", threads(0), path)]);
                    hashes.extend([of_file(name, "ply", threads(1), path)]);
                    hashes.extend([of_file(name, "usdc", threads(2), path)]);
                }
                Some("ifs") => {
                    hashes.extend([of_file(name, "png", threads(0), path)]);
                    hashes.extend([of_file(name, "ply", threads(1), path)]);
                }
                _ if name.ends_with(".ifs.toml") => {
                    hashes.extend([of_file(name, "png", threads(0), path)]);
                    hashes.extend([of_file(name, "glb", threads(1), path)]);
                }
                _ if is_picture(preset) => hashes.extend([of_file(name, "png", threads(0), path)]),
                _ => hashes.extend(of_bake(name, threads(0), &path.join("out"))),
            }
            assert!(!hashes.is_empty() || name.ends_with(".obj"), "{name} makes nothing");
            found.lock().expect("lock").extend(hashes);
        }
    };
    std::thread::scope(|scope| (0..2).for_each(|_| _ = scope.spawn(work)));
    found.into_inner().expect("lock")
}

#[test]
fn every_preset_makes_the_bytes_of_the_list() {
    if cfg!(debug_assertions) {
        println!("left out: takes an hour without optimisation");
        return;
    }
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/hashes.txt");
    let is_written = std::env::var_os("OSIER_BLESS").is_some();
    let found = all(usize::from(!is_written));
    if is_written {
        let mut text = String::new();
        found.iter().for_each(|(what, hash)| writeln!(text, "{hash} {what}").expect("text"));
        fs::write(&path, text).expect("list");
        return;
    }
    let text = fs::read_to_string(&path).expect("list");
    let wanted: BTreeMap<String, String> =
        text.lines().filter_map(|l| l.split_once(' ')).map(|(hash, what)| (what.to_owned(), hash.to_owned())).collect();
    let differing: Vec<&String> =
        found.keys().chain(wanted.keys()).filter(|what| found.get(*what) != wanted.get(*what)).collect();
    assert!(differing.is_empty(), "other bytes than in tests/hashes.txt: {differing:#?}");
}
