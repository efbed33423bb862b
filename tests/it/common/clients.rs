//! The real programs that judge our files: where they are, and what to do without them.
//!
//! `tests/all.sh` installs them and sets `OSIER_JUDGES=require`, which turns a missing client into a failure. `OSIER_BPY` names
//! another Python with another version of bpy, such as the one that `tests/full.sh` installs.
#![allow(dead_code, reason = "each test file uses its own share")]
#![allow(
    clippy::disallowed_methods,
    clippy::expect_used,
    clippy::print_stderr,
    reason = "tests ask the environment and say what they skip"
)]

use std::fs::File;
use std::io::{Read, Seek};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

/// Folder that `tests/all.sh` installs into.
pub fn clients() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("target/clients")
}

/// A script of ours.
pub fn script(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/clients").join(name)
}

/// Python with bpy, usd-core and OpenEXR (import bpy and pxr in separate processes): that of `OSIER_BPY`, else the one with bpy 5.0.1.
pub fn python() -> Option<PathBuf> {
    let chosen = std::env::var_os("OSIER_BPY").map(|path| Path::new(env!("CARGO_MANIFEST_DIR")).join(path));
    present("python with bpy, usd-core and OpenEXR", chosen.unwrap_or_else(|| clients().join("venv/bin/python")))
}

/// maturin, which builds the Python wheel.
pub fn maturin() -> Option<PathBuf> {
    let own = clients().join("tools/bin/maturin");
    present("maturin", if own.exists() { own } else { find("maturin") })
}

/// Blender of the distribution (3.4 on Debian 12).
pub fn blender() -> Option<PathBuf> {
    present("blender", find("blender"))
}

/// POV-Ray 3.7.
pub fn povray() -> Option<PathBuf> {
    present("povray", find("povray"))
}

/// Node with the Khronos validator: the program and the folder to resolve `gltf-validator` in.
pub fn validator() -> Option<(PathBuf, PathBuf)> {
    present("gltf-validator", clients().join("node_modules/gltf-validator"))?;
    Some((present("node", find("node"))?, clients()))
}

/// Node with three.js: the program and the folder to resolve `three` in.
pub fn three() -> Option<(PathBuf, PathBuf)> {
    present("three", clients().join("node_modules/three"))?;
    Some((present("node", find("node"))?, clients()))
}

/// Node with Babylon.js and three.js: the program and the folder to resolve both in.
pub fn babylon() -> Option<(PathBuf, PathBuf)> {
    present("Babylon.js", clients().join("node_modules/@babylonjs/loaders"))?;
    three()
}

fn find(program: &str) -> PathBuf {
    let path = std::env::var_os("PATH").unwrap_or_default();
    std::env::split_paths(&path).map(|d| d.join(program)).find(|p| p.is_file()).unwrap_or_default()
}

fn present(name: &str, path: PathBuf) -> Option<PathBuf> {
    if path.exists() {
        return Some(path);
    }
    let required = std::env::var("OSIER_JUDGES").is_ok_and(|v| v == "require");
    assert!(!required, "{name} is required but not installed; run tests/all.sh");
    eprintln!("SKIPPED: {name} is not installed; tests/all.sh installs it");
    None
}

/// Time after which a client is taken to hang: the longest takes two minutes on a machine with nothing else to do.
const LONGEST: Duration = Duration::from_secs(20 * 60);

/// Runs a client and fails the test with its output unless it ends with 0, within `LONGEST`.
pub fn run(command: &mut Command) -> Output {
    run_for(command, LONGEST)
}

/// `run` with another limit of time, after which the client is killed.
fn run_for(command: &mut Command, longest: Duration) -> Output {
    // Files in place of pipes: a process that the client has started may hold a pipe open behind its end.
    let [mut out, mut err] = [(); 2].map(|()| tempfile::tempfile().expect("a temporary file"));
    let to = |file: &File| Stdio::from(file.try_clone().expect("a second handle"));
    command.stdin(Stdio::null()).stdout(to(&out)).stderr(to(&err));
    let mut client = command.spawn().unwrap_or_else(|e| panic!("cannot start {command:?}: {e}"));
    let began = Instant::now();
    let mut ended = client.try_wait().expect("a state");
    while ended.is_none() && began.elapsed() < longest {
        std::thread::sleep(Duration::from_millis(10));
        ended = client.try_wait().expect("a state");
    }
    let status = ended.unwrap_or_else(|| {
        client.kill().expect("a process of ours");
        client.wait().expect("an end")
    });
    let output = Output { status, stdout: written(&mut out), stderr: written(&mut err) };
    let end = if ended.is_some() { format!("ended with {status}") } else { format!("hung for {longest:?}") };
    assert!(
        ended.is_some() && status.success(),
        "{command:?} {end}\n--- stdout\n{}\n--- stderr\n{}",
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr)
    );
    output
}

/// All that was written to a file.
fn written(file: &mut File) -> Vec<u8> {
    let mut bytes = Vec::new();
    file.rewind().expect("the start");
    file.read_to_end(&mut bytes).expect("a readable file");
    bytes
}

/// Runs one of our Python scripts under Debian's Blender, headless.
pub fn blender_script(blender: &Path, name: &str, arguments: &[&str]) -> Output {
    let mut command = Command::new(blender);
    command
        .args(["--background", "--factory-startup", "--python-exit-code", "9", "--python"])
        .arg(script(name))
        .arg("--");
    run(command.args(arguments))
}

/// Runs one of our Python scripts under the venv's Python (bpy or pxr).
pub fn python_script(python: &Path, name: &str, arguments: &[&str]) -> Output {
    let mut output = run(Command::new(python).arg(script(name)).args(arguments));
    // bpy 4.5 ends with a line about memory, behind what the script has printed.
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    let said = text.lines().filter(|line| !line.starts_with("Error: Not freed memory blocks"));
    output.stdout = said.flat_map(|line| [line, "\n"]).collect::<String>().into_bytes();
    output
}

#[test]
#[should_panic(expected = "hung for 200ms\n--- stdout\nbegan")]
fn a_client_that_hangs_is_killed() {
    run_for(Command::new("sh").args(["-c", "echo began; exec sleep 60"]), Duration::from_millis(200));
}
