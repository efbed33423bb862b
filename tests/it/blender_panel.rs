//! The Python wheel with the program, and the Blender extension `osier`, whose panel bakes with it.
#![allow(clippy::expect_used, clippy::disallowed_methods, reason = "tests run programs and read their files")]

use std::fs;
use std::os::unix::process::ExitStatusExt as _;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::OnceLock;
use std::time::Duration;

use rustix::process::{Pid, Signal, kill_process};
use serde_json::{Value, json};

use crate::blender_import::holds_license;
use crate::common::clients;
use crate::common::program::{OSIER, arg, assert_same, ends, is_part, tree};

/// What a process runs that calls the module.
const CALL: &str = "import osier, sys; sys.exit(osier.main(sys.argv[1:]))";

fn sources() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// The wheel, built once with the profile and the crates of this test, or `None` without maturin.
fn wheel() -> Option<&'static Path> {
    static WHEEL: OnceLock<Option<(tempfile::TempDir, PathBuf)>> = OnceLock::new();
    let made = WHEEL.get_or_init(|| {
        let maturin = clients::maturin()?;
        let dir = tempfile::tempdir().expect("dir");
        let target = Path::new(OSIER).ancestors().nth(2).expect("the folder that holds the profile's folder");
        let profile = if cfg!(debug_assertions) { "dev" } else { "release" };
        let mut build = Command::new(maturin);
        build.current_dir(sources()).args(["build", "--locked", "--features", "as-tested", "--profile", profile]);
        clients::run(build.arg("--target-dir").arg(target).arg("--out").arg(dir.path()));
        let path = only_file(dir.path());
        Some((dir, path))
    });
    made.as_ref().map(|(_, path)| path.as_path())
}

fn only_file(folder: &Path) -> PathBuf {
    let mut paths: Vec<PathBuf> = fs::read_dir(folder).expect("folder").map(|e| e.expect("entry").path()).collect();
    assert_eq!(paths.len(), 1, "{paths:?}");
    paths.remove(0)
}

/// Starts a long bake and waits until it has grown its plants.
fn start_bake(mut command: Command, out: &Path) -> Child {
    command.args(["bake", "showcase", "--progress", "json", "--formats", "usd,exr", "-o", arg(out)]);
    let mut child = command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().expect("a process");
    let stderr = child.stderr.take().expect("standard error");
    // The rest is read on, so that the process does not wait for its reader.
    let (said, grown) = std::sync::mpsc::channel();
    std::thread::spawn(move || {
        for line in std::io::BufRead::lines(std::io::BufReader::new(stderr)).map_while(Result::ok) {
            let _ = said.send(line);
        }
    });
    while !grown.recv_timeout(Duration::from_secs(60)).expect("progress").contains("skinning") {}
    child
}

#[test]
fn a_wheel_in_a_clean_environment_is_the_program() {
    let (Some(python), Some(wheel)) = (clients::python(), wheel()) else { return };
    let dir = tempfile::tempdir().expect("dir");
    let venv = dir.path().join("venv");
    clients::run(Command::new(&python).args(["-m", "venv"]).arg(&venv));
    let own = venv.join("bin/python");
    clients::run(Command::new(&own).args(["-m", "pip", "install", "-q", "--no-index", "--no-deps"]).arg(wheel));

    let bake = ["-q", "bake", "grass", "--set", "frames.end=3", "--formats", "usd,glb,exr", "-o"];
    let outs = ["program", "script", "module"].map(|name| dir.path().join(name));
    ends(0, &[&bake[..], &[arg(&outs[0])]].concat());
    clients::run(Command::new(venv.join("bin/osier")).args(bake).arg(&outs[1]));
    clients::run(Command::new(&own).args(["-c", CALL]).args(bake).arg(&outs[2]));
    let wanted = tree(&outs[0]);
    assert!(wanted.len() > 5, "{:?}", wanted.keys());
    assert_same(&tree(&outs[1]), &wanted, "the script");
    assert_same(&tree(&outs[2]), &wanted, "the module");

    // Exit codes and messages are those of the program.
    for wrong in [&["bake", "nowhere.toml"][..], &["bake", "--unknown"], &[], &["--version"], &["list", "codes"]] {
        let line = Command::new(OSIER).args(wrong).output().expect("the program");
        let module = Command::new(&own).args(["-c", CALL]).args(wrong).output().expect("python");
        assert_eq!(module, line, "{wrong:?}");
    }

    // A second call in one process cannot set up threads again, and says so.
    let twice = "import osier; osier.main(['list']); osier.main(['list'])";
    let output = Command::new(&own).args(["-c", twice]).output().expect("python");
    assert!(String::from_utf8_lossy(&output.stderr).contains("once in a process"), "{output:?}");

    // A run that takes more memory than it may, which no estimate foresaw, ends without the process.
    let over = format!(
        "import osier; print('ends with', osier.main(['-q', 'preview', 'landscape', '--max-memory', '100M', '-o', '{}']))",
        arg(&dir.path().join("l.png"))
    );
    let output = Command::new(&own).args(["-c", &over]).output().expect("python");
    let said = [&output.stdout, &output.stderr].map(|text| String::from_utf8_lossy(text).into_owned());
    assert!(said[0].contains("ends with 1") && said[1].contains("memory in use"), "{said:?}");

    // After a call the signals are those of Python again.
    let after = "import osier, os, signal, time\nosier.main(['list', 'limits'])\n\
                 try:\n    os.kill(os.getpid(), signal.SIGINT)\n    time.sleep(9)\n\
                 except KeyboardInterrupt:\n    time.sleep(2)\n    print('goes on')";
    let output = Command::new(&own).args(["-c", after]).output().expect("python");
    assert!(output.status.success() && String::from_utf8_lossy(&output.stdout).ends_with("goes on\n"), "{output:?}");
    let ended = "import osier, os, signal, time\nosier.main(['list', 'limits'])\n\
                 os.kill(os.getpid(), signal.SIGTERM)\ntime.sleep(9)";
    let output = Command::new(&own).args(["-c", ended]).output().expect("python");
    assert_eq!(output.status.signal(), Some(15), "{output:?}");

    // Signals end a bake with their code and without unfinished files, although Python has handlers of its own.
    for (signal, code) in [(Signal::TERM, 143), (Signal::INT, 130)] {
        let out = dir.path().join(format!("stopped{code}"));
        let mut command = Command::new(&own);
        command.args(["-c", CALL]);
        let mut child = start_bake(command, &out);
        kill_process(Pid::from_child(&child), signal).expect("signal");
        assert_eq!(child.wait().expect("wait").code(), Some(code));
        assert!(!tree(&out).keys().any(|path| is_part(path) || path == "manifest.json"));
    }
}

/// The module and Blender share a process, as in a script of the user.
#[test]
fn a_wheel_works_beside_bpy() {
    let (Some(python), Some(wheel)) = (clients::python(), wheel()) else { return };
    let dir = tempfile::tempdir().expect("dir");
    let installed = dir.path().join("installed");
    let mut pip = Command::new(&python);
    pip.args(["-m", "pip", "install", "-q", "--no-index", "--no-deps", "--target"]).arg(&installed);
    clients::run(pip.arg(wheel));
    let (mine, its) = (dir.path().join("program"), dir.path().join("module"));
    let bake = ["-q", "bake", "grass", "--formats", "usd,exr", "-o"];
    ends(0, &[&bake[..], &[arg(&mine)]].concat());
    let script =
        "import bpy, osier, sys; code = osier.main(sys.argv[1:]); import os; sys.stdout.flush(); os._exit(code)";
    clients::run(Command::new(&python).args(["-c", script]).args(bake).arg(&its).env("PYTHONPATH", &installed));
    assert_same(&tree(&its), &tree(&mine), "beside bpy");
}

/// The zip of the extension `osier` in a folder.
fn packed(python: &Path, wheel: &Path, folder: &Path) -> PathBuf {
    clients::run(Command::new(python).arg(sources().join("blender/build.py")).arg(folder).arg("--wheel").arg(wheel));
    let paths = fs::read_dir(folder).expect("zips").map(|e| e.expect("entry").path());
    paths.into_iter().find(|p| arg(p).contains("osier-0")).expect("the extension osier")
}

/// The last line that a script printed, as JSON.
fn report(output: &[u8]) -> Value {
    let text = String::from_utf8_lossy(output);
    let line = text.lines().rfind(|l| l.starts_with('{')).unwrap_or_default();
    serde_json::from_str(line).unwrap_or_else(|e| panic!("{e}: {text}"))
}

#[test]
fn the_panel_bakes_imports_reloads_and_leaves_nothing_behind() {
    let (Some(python), Some(wheel)) = (clients::python(), wheel()) else { return };
    let dir = tempfile::tempdir().expect("dir");
    let zip = packed(&python, wheel, &dir.path().join("zips"));
    let again = packed(&python, wheel, &dir.path().join("again"));
    assert!(fs::read(&zip).expect("zip") == fs::read(again).expect("zip"), "two zips of the same files differ");
    assert!(holds_license(&zip), "the zip has no license");
    for folder in ["user", "work"] {
        fs::create_dir(dir.path().join(folder)).expect("folder");
    }
    let mut script = Command::new(&python);
    script.arg(sources().join("blender/tests/panel.py")).arg(&zip).arg(OSIER).arg(dir.path().join("work"));
    let report = report(&clients::run(script.env("BLENDER_USER_RESOURCES", dir.path().join("user"))).stdout);
    assert_eq!(report["failed"], json!([]), "{report:#}");
    assert!(report["keys"].as_u64().is_some_and(|n| n > 1000), "{report}");
    assert_eq!(report["code"], json!(143), "{report}");
}

/// Debian's Blender 3.4 has neither extensions nor USD: the panel registers and bakes, and says why it does not import.
#[test]
fn the_panel_bakes_in_a_blender_without_usd() {
    let (Some(python), Some(blender), Some(wheel)) = (clients::python(), clients::blender(), wheel()) else { return };
    let dir = tempfile::tempdir().expect("dir");
    let zip = packed(&python, wheel, &dir.path().join("zips"));
    let mut script = Command::new(&blender);
    script.args(["--background", "--factory-startup", "--python-exit-code", "9", "--python"]);
    script.arg(sources().join("blender/tests/folder.py")).arg("--").arg(&zip).arg(dir.path());
    let report = report(&clients::run(script.env("OSIER_PROGRAM", OSIER)).stdout);
    assert_eq!(report["baked"], json!(true), "{report}");
    assert_eq!(report["left"], json!([]), "{report}");
    assert!(report["keys"].as_u64().is_some_and(|n| n > 300), "{report}");
    // A value below its range is clamped, and the panel draws many things.
    assert!(report["low"].as_f64() == Some(0.0) && report["drawn"].as_u64().is_some_and(|n| n > 10), "{report}");
    let refusal = report["errors"].to_string().contains("without USD");
    assert!(report["shown"] == report["usd"] && report["usd"] != json!(refusal), "{report}");
}

#[test]
fn the_panel_takes_a_table_of_any_spelling_out_of_a_scene() {
    let Some(python) = clients::python() else { return };
    clients::run(Command::new(python).arg(sources().join("blender/tests/scene_text.py")));
}

#[test]
fn the_panel_has_fields_for_plants_with_dots_in_their_names() {
    let Some(python) = clients::python() else { return };
    let dir = tempfile::tempdir().expect("dir");
    let scene = dir.path().join("s.toml");
    fs::write(&scene, "[plants.\"v1.2\"]\ngrammar = \"birch.l\"\nsteps = 4\n[plants.b]\ngrammar = \"birch.l\"\n")
        .expect("scene");
    let [options, check] = [("options", ["list", "options", "--json"]), ("check", ["check", arg(&scene), "--json"])]
        .map(|(name, call)| {
            let path = dir.path().join(name);
            fs::write(&path, ends(0, &call).0).expect("file");
            path
        });
    let told =
        clients::run(Command::new(python).arg(sources().join("blender/tests/fields.py")).args([&options, &check]));
    let told: Value = serde_json::from_slice(&told.stdout).expect("JSON");
    assert_eq!(told["plants"], json!(["v1.2", "b"]));
    let paths: Vec<&str> = told["paths"].as_array().expect("paths").iter().filter_map(Value::as_str).collect();
    let count = |start: &str| paths.iter().filter(|path| path.starts_with(start)).count();
    assert!(count("plants.b.") > 100, "{paths:?}");
    assert_eq!(count("plants.\"v1.2\"."), count("plants.b."));
    assert_eq!(count("plants."), 2 * count("plants.b."));
    // The program takes these paths.
    assert!(paths.contains(&"plants.\"v1.2\".bark.side"));
    ends(0, &["check", arg(&scene), "--set", "plants.\"v1.2\".bark.side=64"]);
}
