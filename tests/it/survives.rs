//! A bake outlives what happens to it: kill -9 at any moment, signals, a full disk, a second bake in its folder. What
//! is under a final name is whole, and a second run ends with the bytes of an undisturbed one.
#![cfg(unix)]
#![allow(clippy::expect_used, clippy::disallowed_methods, reason = "tests fail by panicking and look at the disk")]
#![allow(clippy::print_stderr, reason = "tests say what they skip")]

use crate::common::program;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command};
use std::sync::OnceLock;
use std::time::{Duration, Instant};

use crate::common::program::{arg, assert_same, is_part, osier, said, tree};
use osier::rng::Rng;
use rustix::process::{Pid, Signal, kill_process};

type Tree = BTreeMap<String, Vec<u8>>;

const SCENE: &str = "tests/scenes/sprig.toml";

/// Bakes the small scene with more frames than it has, so that there is time to disturb it.
fn bake(out: &Path) -> Command {
    osier(&["bake", SCENE, "-q", "--set", "frames.end=24", "-o", arg(out)])
}

fn finish(out: &Path, what: &str) {
    let (code, _, err) = said(&bake(out).output().expect("osier runs"));
    assert_eq!(code, 0, "{what}: {err}");
}

/// What an undisturbed bake leaves, and how long it takes.
fn undisturbed() -> &'static (Tree, Duration) {
    static ONCE: OnceLock<(Tree, Duration)> = OnceLock::new();
    ONCE.get_or_init(|| {
        let dir = tempfile::tempdir().expect("dir");
        let out = dir.path().join("out");
        let start = Instant::now();
        finish(&out, "undisturbed");
        let took = start.elapsed();
        let tree = tree(&out);
        for ending in
            [".usda", ".usdc", ".blender.glb", ".web.glb", ".pc2", ".obj", ".ply", ".inc", ".png", ".exr", ".osier"]
        {
            assert!(tree.keys().any(|path| path.ends_with(ending)), "the scene writes no {ending}");
        }
        assert!(!tree.keys().any(|path| is_part(path)), "part files are left");
        (tree, took)
    })
}

/// Fails unless every file under a final name is whole, and a manifest stands only where everything it names does.
/// Gives the number of finished files.
fn finals_are_whole(out: &Path, what: &str) -> usize {
    let wanted = &undisturbed().0;
    let found: Tree = tree(out).into_iter().filter(|(path, _)| path != ".osier" && !is_part(path)).collect();
    for (path, bytes) in &found {
        let whole = wanted.get(path).unwrap_or_else(|| panic!("{what}: {path} is a stray file"));
        assert!(bytes == whole, "{what}: {path} is torn ({} of {} bytes)", bytes.len(), whole.len());
    }
    if found.contains_key("manifest.json") {
        let (code, _, err) = said(&program::run(&["info", arg(out)]));
        assert_eq!(code, 0, "{what}: the manifest lies: {err}");
    }
    found.len()
}

fn journal_length(out: &Path) -> u64 {
    fs::metadata(out.join(".osier")).map_or(0, |m| m.len())
}

/// Waits until the journal of a running bake holds `wanted` bytes, or the bake has ended.
fn wait_for_journal(child: &mut Child, out: &Path, wanted: u64) {
    let start = Instant::now();
    while journal_length(out) < wanted && child.try_wait().expect("child").is_none() {
        assert!(start.elapsed() < Duration::from_secs(60), "the bake hangs");
        std::thread::sleep(Duration::from_micros(200));
    }
}

/// Moments at which a bake is killed, spread over its time.
const KILLS: u32 = 12;

#[test]
fn killed_at_any_moment_a_second_run_ends_as_if_nothing_had_happened() {
    let (wanted, took) = undisturbed();
    let journal = wanted[".osier"].len() as f64;
    let mut rng = Rng::at(9, &["kill".into()]);
    let mut midway = 0;
    for turn in 0..KILLS {
        let dir = tempfile::tempdir().expect("dir");
        let out = dir.path().join("out");
        let share = (f64::from(turn) + rng.unit_f64()) / f64::from(KILLS);
        let what = format!("kill {turn} at {share:.3}");
        let mut child = bake(&out).spawn().expect("osier starts");
        // By turns at a time, and by what is written, which a busy machine does not shift.
        if turn % 2 == 0 {
            std::thread::sleep(took.mul_f64(share));
        } else {
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a share of a small length")]
            wait_for_journal(&mut child, &out, (share * journal) as u64);
            std::thread::sleep(Duration::from_secs_f64(rng.range(0.0, 0.004)));
        }
        child.kill().expect("kill");
        child.wait().expect("wait");
        let finished = finals_are_whole(&out, &what);
        midway += usize::from(finished > 0 && !out.join("manifest.json").exists());
        finish(&out, &what);
        assert_same(&tree(&out), wanted, &what);
    }
    assert!(midway >= 3, "only {midway} kills met a bake that was writing");
}

#[test]
fn killed_again_and_again_in_one_folder_a_bake_still_ends_right() {
    let (wanted, took) = undisturbed();
    let mut rng = Rng::at(9, &["kill again".into()]);
    let dir = tempfile::tempdir().expect("dir");
    let out = dir.path().join("out");
    for turn in 0..6 {
        let mut child = bake(&out).spawn().expect("osier starts");
        std::thread::sleep(took.mul_f64(rng.range(0.2, 0.9)));
        child.kill().expect("kill");
        child.wait().expect("wait");
        finals_are_whole(&out, &format!("kill {turn}"));
    }
    finish(&out, "after six kills");
    assert_same(&tree(&out), wanted, "after six kills");
}

/// Rain is stepped as a whole before the first frame is written, and its maps go on from frame to frame.
#[test]
fn rain_ends_with_the_same_bytes_on_any_threads_and_after_any_kill() {
    let bake = |out: &Path, threads: &str| {
        let mut said = osier(&["bake", "rain-leaves", "-q", "-j", threads, "-o", arg(out)]);
        said.args(["--set", "frames.end=6", "--set", "maps.resolution=64", "--set", "rain.spin_up_s=0.5"]);
        said.args(["--set", "output.formats=[\"usd\",\"pov\",\"exr\",\"csv\",\"tracks\"]"]);
        said
    };
    let dir = tempfile::tempdir().expect("dir");
    let out = dir.path().join("wanted");
    let start = Instant::now();
    assert_eq!(said(&bake(&out, "1").output().expect("osier runs")).0, 0);
    let (wanted, took) = (tree(&out), start.elapsed());
    assert!(wanted.contains_key("stats/rain.csv") && wanted.contains_key("tracks/drops.bin"), "no table");
    assert!(wanted.keys().filter(|k| k.ends_with(".0006.exr")).count() >= 15, "no maps of the last frame");
    for threads in ["2", "8"] {
        let out = dir.path().join(threads);
        let mut rng = Rng::at(9, &["kill rain".into(), threads.into()]);
        for _ in 0..2 {
            let mut child = bake(&out, threads).spawn().expect("osier starts");
            std::thread::sleep(took.mul_f64(rng.range(0.3, 0.9)));
            child.kill().expect("kill");
            child.wait().expect("wait");
            let torn = tree(&out).into_iter().find(|(k, bytes)| k != ".osier" && !is_part(k) && wanted[k] != *bytes);
            assert!(torn.is_none(), "{:?} is torn", torn.map(|t| t.0));
        }
        assert_eq!(said(&bake(&out, threads).output().expect("osier runs")).0, 0);
        assert_same(&tree(&out), &wanted, &format!("-j {threads}, killed twice"));
    }
}

/// The last thing a bake does, after its manifest, is to put its journal in order.
#[test]
fn a_run_that_died_after_its_manifest_is_tidied_up_after() {
    let wanted = &undisturbed().0;
    let dir = tempfile::tempdir().expect("dir");
    let out = dir.path().join("out");
    finish(&out, "first");
    let journal = fs::read_to_string(out.join(".osier")).expect("journal");
    fs::write(out.join(".osier"), format!("{journal}folder\tusd\n")).expect("write");
    finish(&out, "second");
    assert_same(&tree(&out), wanted, "second");
}

/// A file system of its own, held in memory.
struct Tmpfs(PathBuf);

impl Tmpfs {
    /// `None`, with the reason printed, where it cannot be mounted.
    fn mount(path: PathBuf, size: &str) -> Option<Self> {
        let done =
            Command::new("mount").args(["-t", "tmpfs", "-o", &format!("size={size}"), "tmpfs"]).arg(&path).output();
        match done {
            Ok(output) if output.status.success() => Some(Self(path)),
            Ok(output) => {
                eprintln!("skipped: no tmpfs: {}", String::from_utf8_lossy(&output.stderr).trim());
                None
            }
            Err(e) => {
                eprintln!("skipped: no mount: {e}");
                None
            }
        }
    }

    fn resize(&self, size: &str) {
        let option = format!("remount,size={size}");
        let done = Command::new("mount").args(["-o", &option]).arg(&self.0).status().expect("mount");
        assert!(done.success(), "remount");
    }
}

impl Drop for Tmpfs {
    fn drop(&mut self) {
        let _ = Command::new("umount").arg("-l").arg(&self.0).status();
    }
}

#[test]
fn a_full_disk_is_named_and_tears_nothing() {
    let wanted = &undisturbed().0;
    for size in ["16k", "200k", "1m", "2m"] {
        let dir = tempfile::tempdir().expect("dir");
        let Some(disk) = Tmpfs::mount(dir.path().to_path_buf(), size) else { return };
        let out = disk.0.join("out");
        let (code, _, err) = said(&bake(&out).output().expect("osier runs"));
        assert_eq!(code, 74, "{size}: {err}");
        assert!(err.contains("No space left") && err.contains("out"), "{size}: {err}");
        finals_are_whole(&out, size);
        let left: Vec<String> = tree(&out).into_keys().filter(|path| is_part(path)).collect();
        assert!(left.is_empty() && !out.join("manifest.json").exists(), "{size}: {left:?}");
        disk.resize("64m");
        finish(&out, size);
        assert_same(&tree(&out), wanted, size);
    }
}

#[test]
fn two_bakes_in_one_folder_both_end_well_and_leave_the_bytes_of_one() {
    let (wanted, took) = undisturbed();
    for turn in 0..4u32 {
        let dir = tempfile::tempdir().expect("dir");
        let out = dir.path().join("out");
        let first = bake(&out).spawn().expect("osier starts");
        std::thread::sleep(took.mul_f64(f64::from(turn) * 0.2));
        let second = bake(&out).spawn().expect("osier starts");
        for child in [first, second] {
            let (code, _, err) = said(&child.wait_with_output().expect("wait"));
            assert_eq!(code, 0, "turn {turn}: {err}");
        }
        assert_same(&tree(&out), wanted, &format!("turn {turn}"));
    }
}

/// A sweep writes its tables after the last run, and a bake of tables alone its first file after the last frame.
#[test]
fn an_interrupted_run_without_files_does_not_tell_of_any() {
    let dir = tempfile::tempdir().expect("dir");
    let out = dir.path().join("out");
    let calls: [&[&str]; 2] = [
        &["bake", "catkins-wall", "-q", "--seeds", "1-40", "-o", arg(&out)],
        // Minutes of spin-up before the first frame.
        &["bake", "catkins-wall", "-q", "--formats", "csv", "--set", "flight.spin_up_s=3600", "-o", arg(&out)],
    ];
    for call in calls {
        let child = osier(call).spawn().expect("osier starts");
        // Neither call leaves a trace by which its progress could be seen. Both run for many times this delay, and the
        // handler of the signal is installed within its first twentieth.
        std::thread::sleep(Duration::from_secs(2));
        kill_process(Pid::from_child(&child), Signal::INT).expect("signal");
        let (code, _, err) = said(&child.wait_with_output().expect("wait"));
        assert_eq!(code, 130, "{err}");
        assert!(err.contains("interrupted") && !err.contains("finished files"), "{call:?}: {err}");
        assert!(tree(&out).keys().all(|path| path == ".osier"), "{call:?}");
    }
}

#[test]
fn signals_end_a_bake_soon_with_their_code_and_nothing_half_done() {
    let wanted = &undisturbed().0;
    for (signal, code) in [(Signal::TERM, 143), (Signal::INT, 130)] {
        let dir = tempfile::tempdir().expect("dir");
        let out = dir.path().join("out");
        let mut child = bake(&out).spawn().expect("osier starts");
        wait_for_journal(&mut child, &out, 400);
        let sent = Instant::now();
        kill_process(Pid::from_child(&child), signal).expect("signal");
        let (got, _, err) = said(&child.wait_with_output().expect("wait"));
        assert_eq!(got, code, "{err}");
        assert!(err.contains("run again to go on"), "{err}");
        // 2 s are promised; a machine full of other work gets more.
        assert!(sent.elapsed() < Duration::from_secs(8), "{:?}", sent.elapsed());
        finals_are_whole(&out, "signal");
        assert!(!tree(&out).keys().any(|path| is_part(path)), "part files are left");
        finish(&out, "signal");
        assert_same(&tree(&out), wanted, "signal");
    }
}
