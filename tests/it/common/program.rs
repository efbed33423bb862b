//! The `osier` program as a person runs it, and what it leaves in a folder.
#![allow(dead_code, reason = "each test file uses its own share")]
#![allow(clippy::disallowed_methods, clippy::expect_used, reason = "tests look at the disk and fail by panicking")]

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

/// The program.
pub const OSIER: &str = env!("CARGO_BIN_EXE_osier");

/// A call of the program from the root of the repository, with nothing to read and its words caught.
pub fn osier(args: &[&str]) -> Command {
    let mut command = Command::new(OSIER);
    command.current_dir(env!("CARGO_MANIFEST_DIR")).args(args).env_remove("COLUMNS").env_remove("OSIER_MAX");
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

/// Runs it to its end.
pub fn run(args: &[&str]) -> Output {
    osier(args).output().expect("osier runs")
}

/// Exit code, standard output and standard error of a run. A panic's code fails every test.
pub fn said(output: &Output) -> (i32, String, String) {
    let text = |bytes: &[u8]| String::from_utf8(bytes.to_vec()).expect("utf-8");
    let (out, err) = (text(&output.stdout), text(&output.stderr));
    let code = output.status.code().expect("an exit code, not a signal");
    assert!(code != 101 && !err.contains("internal error"), "panic: {err}");
    (code, out, err)
}

/// Runs it and fails unless it ends with `code`.
pub fn ends(code: i32, args: &[&str]) -> (String, String) {
    let (got, out, err) = said(&run(args));
    assert_eq!(got, code, "osier {args:?}\n{out}\n{err}");
    (out, err)
}

/// A path as an argument.
pub fn arg(path: &Path) -> &str {
    path.to_str().expect("utf-8 path")
}

/// Every file below a folder, journal included, by relative path.
pub fn tree(root: &Path) -> BTreeMap<String, Vec<u8>> {
    fn walk(folder: &Path, prefix: &str, out: &mut BTreeMap<String, Vec<u8>>) {
        // A folder may be tidied away while a run goes on.
        let Ok(entries) = fs::read_dir(folder) else { return };
        for entry in entries.flatten() {
            let path: PathBuf = entry.path();
            let name = format!("{prefix}{}", entry.file_name().to_string_lossy());
            if path.is_dir() {
                walk(&path, &format!("{name}/"), out);
            } else if let Ok(bytes) = fs::read(&path) {
                out.insert(name, bytes);
            }
        }
    }
    let mut out = BTreeMap::new();
    walk(root, "", &mut out);
    out
}

/// Fails, naming the files, unless two trees are equal.
pub fn assert_same(found: &BTreeMap<String, Vec<u8>>, wanted: &BTreeMap<String, Vec<u8>>, what: &str) {
    let differing: Vec<&String> =
        found.keys().chain(wanted.keys()).filter(|path| found.get(*path) != wanted.get(*path)).collect();
    assert!(differing.is_empty(), "{what}: {differing:?} differ");
}

/// True for the name of a file that is being written.
pub fn is_part(path: &str) -> bool {
    let name = path.rsplit('/').next().unwrap_or(path);
    name.starts_with('.') && name.ends_with(".part")
}
