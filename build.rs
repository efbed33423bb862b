//! Tells the program which sources it was built from: files of a bake that another program wrote are then made anew,
//! even if both call themselves by the same version. Lists the presets: every file of their folders.
#![allow(clippy::disallowed_methods, clippy::print_stdout, reason = "reads the sources, speaks to cargo")]

use std::env;
use std::ffi::OsString;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// All that ends up in the program.
const SOURCES: [&str; 10] =
    ["src", "crates", "grammars", "ifs-tables", "meshes", "scenes", "shapes", "species", "Cargo.toml", "Cargo.lock"];

/// Offset and prime of the 64-bit FNV-1a hash.
const FNV: [u64; 2] = [0xcbf2_9ce4_8422_2325, 0x0100_0000_01b3];

/// Folders whose files are presets.
const PRESETS: [&str; 6] = ["grammars", "ifs-tables", "meshes", "scenes", "shapes", "species"];

fn add(hash: u64, bytes: &[u8]) -> u64 {
    let length = (bytes.len() as u64).to_le_bytes();
    length.iter().chain(bytes).fold(hash, |h, b| (h ^ u64::from(*b)).wrapping_mul(FNV[1]))
}

fn files(path: &Path, found: &mut Vec<PathBuf>) -> io::Result<()> {
    if path.is_dir() {
        for entry in fs::read_dir(path)? {
            files(&entry?.path(), found)?;
        }
    } else if path.is_file() {
        found.push(path.to_owned());
    }
    Ok(())
}

fn main() -> io::Result<()> {
    let mut found = Vec::new();
    for source in SOURCES {
        // A published package has no folder of crates; Cargo would run a script that names an absent path in every build.
        if Path::new(source).exists() {
            println!("cargo::rerun-if-changed={source}");
            files(Path::new(source), &mut found)?;
        }
    }
    found.sort();
    let mut hash = FNV[0];
    for path in found {
        let name = path.to_string_lossy().replace('\\', "/");
        hash = add(add(hash, name.as_bytes()), &fs::read(&path)?);
    }
    println!("cargo::rustc-env=OSIER_SOURCES={hash:016x}");
    write_preset_list()
}

/// Writes `presets.rs` into Cargo's output folder: an array of name and content of each preset, sorted by name.
fn write_preset_list() -> io::Result<()> {
    let missing = |name: &str| io::Error::other(format!("Cargo sets no {name}"));
    let root = PathBuf::from(env::var_os("CARGO_MANIFEST_DIR").ok_or_else(|| missing("CARGO_MANIFEST_DIR"))?);
    let target = PathBuf::from(env::var_os("OUT_DIR").ok_or_else(|| missing("OUT_DIR"))?).join("presets.rs");
    let mut presets = Vec::new();
    for folder in PRESETS {
        let mut paths = Vec::new();
        files(&root.join(folder), &mut paths)?;
        presets.extend(paths.into_iter().filter_map(|path| Some((path.file_name()?.to_owned(), path))));
    }
    presets.sort();
    let entry = |(name, path): &(OsString, PathBuf)| {
        let name = name.to_string_lossy();
        format!("    Preset {{ name: {name:?}, text: include_str!({:?}) }},\n", path.to_string_lossy())
    };
    let entries: String = presets.iter().map(entry).collect();
    fs::write(target, format!("&[\n{entries}]\n"))
}
