//! Tells the program which sources it was built from: files of a bake that another program wrote are then made anew,
//! even if both call themselves by the same version.
#![allow(clippy::disallowed_methods, clippy::print_stdout, reason = "reads the sources, speaks to cargo")]

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// All that ends up in the program.
const SOURCES: [&str; 8] = ["src", "crates", "grammars", "ifs-tables", "meshes", "scenes", "Cargo.toml", "Cargo.lock"];

/// Offset and prime of the 64-bit FNV-1a hash.
const FNV: [u64; 2] = [0xcbf2_9ce4_8422_2325, 0x0100_0000_01b3];

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
        println!("cargo::rerun-if-changed={source}");
        files(Path::new(source), &mut found)?;
    }
    found.sort();
    let mut hash = FNV[0];
    for path in found {
        let name = path.to_string_lossy().replace('\\', "/");
        hash = add(add(hash, name.as_bytes()), &fs::read(&path)?);
    }
    println!("cargo::rustc-env=OSIER_SOURCES={hash:016x}");
    Ok(())
}
