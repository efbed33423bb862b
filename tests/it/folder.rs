//! Output folders survive everything: death at any step, full disks, foreign files, company.
#![allow(clippy::expect_used, reason = "a test says what it expected")]

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, Write as _};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicI64, Ordering};

use osier::files::{Disk, Folder, MANIFEST, SystemDisk, WriteOptions};
use osier::progress::Cancel;
use osier::{Error, Result};

/// The real disk without the waiting: what is asked of it matters here, not what survives a power cut.
#[derive(Debug)]
struct Quick;

impl Disk for Quick {
    fn sync(&self, _file: &File) -> io::Result<()> {
        Ok(())
    }
    fn append(&self, path: &Path, line: &[u8]) -> io::Result<()> {
        File::options().append(true).create(true).open(path)?.write_all(line)
    }
    fn sync_dir(&self, _path: &Path) -> io::Result<()> {
        Ok(())
    }
}

/// A disk that does `left` more things and then nothing at all, as if the process had been killed.
#[derive(Debug)]
struct DiesAfter {
    left: AtomicI64,
}

impl DiesAfter {
    fn new(n: i64) -> Self {
        Self { left: AtomicI64::new(n) }
    }

    fn step(&self) -> io::Result<()> {
        if self.left.fetch_sub(1, Ordering::SeqCst) > 0 { Ok(()) } else { Err(io::Error::other("killed")) }
    }
}

impl Disk for DiesAfter {
    fn make_dir(&self, path: &Path) -> io::Result<()> {
        self.step().and_then(|()| Quick.make_dir(path))
    }
    fn create_new(&self, path: &Path) -> io::Result<File> {
        self.step().and_then(|()| Quick.create_new(path))
    }
    fn write(&self, file: &mut File, bytes: &[u8]) -> io::Result<usize> {
        self.step().and_then(|()| Quick.write(file, &bytes[..bytes.len().div_ceil(2)]))
    }
    fn sync(&self, file: &File) -> io::Result<()> {
        self.step().and_then(|()| Quick.sync(file))
    }
    fn append(&self, path: &Path, line: &[u8]) -> io::Result<()> {
        // The last thing done before death may be half a line.
        let half = &line[..line.len() / 2];
        let torn = |e| Quick.append(path, half).and(Err(e));
        match self.left.fetch_sub(1, Ordering::SeqCst) {
            ..=0 => Err(io::Error::other("killed")),
            1 => torn(io::Error::other("killed")),
            _ => Quick.append(path, line),
        }
    }
    fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
        self.step().and_then(|()| Quick.rename(from, to))
    }
    fn remove(&self, path: &Path) -> io::Result<()> {
        self.step().and_then(|()| Quick.remove(path))
    }
    fn remove_dir(&self, path: &Path) -> io::Result<()> {
        self.step().and_then(|()| Quick.remove_dir(path))
    }
    fn sync_dir(&self, path: &Path) -> io::Result<()> {
        self.step().and_then(|()| Quick.sync_dir(path))
    }
}

/// A disk that is full after `left` bytes.
#[derive(Debug)]
struct FailAfter {
    left: AtomicI64,
}

impl Disk for FailAfter {
    fn write(&self, file: &mut File, bytes: &[u8]) -> io::Result<usize> {
        let left = self.left.load(Ordering::SeqCst).max(0);
        if left == 0 {
            return Err(io::Error::from(io::ErrorKind::StorageFull));
        }
        let n = file.write(&bytes[..bytes.len().min(usize::try_from(left).expect("positive"))])?;
        self.left.fetch_sub(i64::try_from(n).expect("small"), Ordering::SeqCst);
        Ok(n)
    }
}

fn options(key: &str, disk: Arc<dyn Disk>) -> WriteOptions {
    WriteOptions { key: key.into(), disk, ..WriteOptions::default() }
}

/// What a bake does: members, some patched, some in folders, then the manifest. Returns how many files it really made.
fn bake(root: &Path, options: WriteOptions) -> Result<usize> {
    let key = options.key.clone();
    let folder = Folder::open_with(root, options)?;
    let mut made = 0;
    for frame in 1..=3_u32 {
        if let Some(mut out) = folder.create(&format!("pov/frames/frame.{frame:04}.inc"), "inc", Some(frame))? {
            out.put(format!("// osier, {key}, frame {frame}\n").as_bytes())?;
            out.commit()?;
            made += 1;
        }
    }
    let own = if key == "a" { "gltf/only_a.glb" } else { "usd/only_b.usdc" };
    for path in [own, "main.usda"] {
        if let Some(mut out) = folder.create(path, "usda", None)? {
            out.put(&[0; 8])?;
            out.put(key.as_bytes())?;
            let end = out.position();
            out.put_at(0, &end.to_le_bytes())?;
            out.put(b" end")?;
            out.commit()?;
            made += 1;
        }
    }
    let list: Vec<String> = folder.files().iter().map(|f| format!("{} {} {}", f.path, f.bytes, f.blake3)).collect();
    folder.write(MANIFEST, "manifest", list.join("\n").as_bytes())?;
    folder.finish()?;
    Ok(made)
}

fn tree(root: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut all = BTreeMap::new();
    let mut open = vec![root.to_owned()];
    while let Some(dir) = open.pop() {
        for entry in std::fs::read_dir(&dir).expect("list").flatten() {
            let path = entry.path();
            let name = path.strip_prefix(root).expect("inside").to_string_lossy().into_owned();
            if path.is_dir() {
                all.insert(format!("{name}/"), Vec::new());
                open.push(path);
            } else {
                all.insert(name, read(&path));
            }
        }
    }
    all
}

#[allow(clippy::disallowed_methods, reason = "tests look at the disk themselves")]
fn read(path: &Path) -> Vec<u8> {
    std::fs::read(path).expect("read")
}

#[allow(clippy::disallowed_methods, reason = "tests look at the disk themselves")]
fn put(path: &Path, bytes: &[u8]) {
    std::fs::write(path, bytes).expect("write");
}

fn undisturbed(key: &str) -> BTreeMap<String, Vec<u8>> {
    let dir = tempfile::tempdir().expect("dir");
    assert_eq!(bake(dir.path(), options(key, Arc::new(Quick))).expect("bake"), 5);
    tree(dir.path())
}

fn manifest_holds(root: &Path) -> bool {
    let Some(list) = tree(root).remove(MANIFEST) else { return true };
    String::from_utf8(list).expect("text").lines().all(|line| {
        let mut words = line.split(' ');
        let path = root.join(words.next().expect("path"));
        path.exists() && blake3::hash(&read(&path)).to_hex().as_str() == words.next_back().expect("hash")
    })
}

#[test]
fn death_at_every_step_is_mended_by_the_next_run() {
    let (a, b) = (undisturbed("a"), undisturbed("b"));
    assert!(a.keys().all(|k| !k.ends_with(".part")) && a.contains_key(".osier"));
    for before in ["", "a", "b"] {
        let mut died = 0;
        for step in 0.. {
            let dir = tempfile::tempdir().expect("dir");
            if !before.is_empty() {
                bake(dir.path(), options(before, Arc::new(Quick))).expect("the bake before");
            }
            let end = bake(dir.path(), options("a", Arc::new(DiesAfter::new(step))));
            assert!(manifest_holds(dir.path()), "a manifest that lies after step {step} on {before:?}");
            if end.is_ok() {
                break;
            }
            died += 1;
            assert_eq!(end.map_err(|e| e.exit_code()), Err(74));
            bake(dir.path(), options("a", Arc::new(Quick))).unwrap_or_else(|e| panic!("step {step}: {e}"));
            assert_eq!(tree(dir.path()), a, "after death at step {step} on {before:?}");
            bake(dir.path(), options("b", Arc::new(Quick))).expect("another bake");
            assert_eq!(tree(dir.path()), b, "another key after death at step {step} on {before:?}");
        }
        assert!(died > 10 || before == "a", "{died} steps were tried on {before:?}");
    }
}

#[test]
fn a_rerun_keeps_what_is_proved_and_makes_what_is_not() {
    let dir = tempfile::tempdir().expect("dir");
    let run = || bake(dir.path(), options("a", Arc::new(Quick))).expect("bake");
    assert_eq!(run(), 5);
    assert_eq!(run(), 0);
    put(&dir.path().join("pov/frames/frame.0002.inc"), b"damaged");
    std::fs::remove_file(dir.path().join("main.usda")).expect("remove");
    assert_eq!(run(), 2);
    assert_eq!(tree(dir.path()), undisturbed("a"));
    assert_eq!(bake(dir.path(), options("b", Arc::new(Quick))).expect("bake"), 5);
}

#[test]
fn no_manifest_lists_files_that_another_bake_replaced() {
    // One that the other replaces by a file of another length, one of the same length, and one that it removes.
    for (path, bytes) in [("main.usda", &b"one"[..]), ("main.usda", b"thirteen byte"), ("gltf/only_a.glb", b"one")] {
        let dir = tempfile::tempdir().expect("dir");
        let folder = Folder::open_with(dir.path(), options("a", Arc::new(Quick))).expect("folder");
        folder.write(path, "usda", bytes).expect("write");
        // Another scene is baked into the folder meanwhile.
        bake(dir.path(), options("b", Arc::new(Quick))).expect("the other");
        let end = folder.write(MANIFEST, "manifest", path.as_bytes());
        assert_eq!(end.map_err(|e| e.exit_code()), Err(75), "{path} {}", bytes.len());
        assert!(!dir.path().join(MANIFEST).exists());
        bake(dir.path(), options("a", Arc::new(Quick))).expect("again");
        assert_eq!(tree(dir.path()), undisturbed("a"));
    }
}

#[test]
fn without_a_key_no_file_of_an_earlier_run_is_kept() {
    let dir = tempfile::tempdir().expect("dir");
    let run = || bake(dir.path(), options("", Arc::new(Quick))).expect("bake");
    assert_eq!((run(), run()), (5, 5));
    let folder = Folder::open(dir.path()).expect("folder");
    folder.write("main.usda", "usda", b"another scene").expect("write");
    assert_eq!(read(&dir.path().join("main.usda")), b"another scene");
    // Of one run it is finished: exporters share textures.
    assert!(folder.create("main.usda", "usda", None).expect("create").is_none());
    folder.write(MANIFEST, "manifest", b"main.usda").expect("write");
    folder.finish().expect("finish");
    assert_eq!(tree(dir.path()).into_keys().collect::<Vec<_>>(), [".osier", "main.usda", MANIFEST]);
}

#[test]
fn the_library_bakes_another_scene_over_the_last_and_refuses_what_the_program_refuses() {
    use osier::bake::BakeContext;
    use osier::limits::Limits;
    use osier::recipe::{Request, resolve};

    let dir = tempfile::tempdir().expect("dir");
    let bake = |seed: &str, frames: &[u32], most: &str| {
        let plant =
            "[plants.grass]\ngrammar = \"grass.l\"\n[plants.grass.bark]\nside = 16\n[plants.grass.leaf]\nside = 32\n";
        let text = format!("{plant}[ground]\nshow = false\n[output]\nformats = [\"obj\"]\n");
        let request = Request { name: "lawn".into(), text, set: vec![format!("seed={seed}")], ..Request::default() };
        let (recipe, _) = resolve(&request)?;
        let mut limits = Limits::default();
        limits.set("output-bytes", most).expect("limit");
        let folder = Folder::open(dir.path())?;
        osier::bake(&recipe, frames, &folder, &BakeContext::quiet(&limits, &Cancel::default())).map(drop)
    };
    let mesh = || read(&dir.path().join("obj/grass.obj"));
    bake("1", &[], "1G").expect("bake");
    let first = mesh();
    bake("2", &[], "1G").expect("bake");
    assert_ne!(mesh(), first, "the grass of another seed");
    bake("1", &[], "1G").expect("bake");
    assert_eq!(mesh(), first);
    assert!(matches!(bake("1", &[2], "1G"), Err(Error::Range { .. })), "the scene has the frame 1 only");
    let twice = bake("1", &[1, 1], "1G").expect_err("one frame twice");
    assert!(twice.to_string().contains("not in rising order"), "{twice}");
    assert!(matches!(bake("1", &[], "1k"), Err(Error::Limit { .. })));
}

#[test]
fn a_stale_file_that_someone_changed_is_theirs() {
    let dir = tempfile::tempdir().expect("dir");
    bake(dir.path(), options("a", Arc::new(Quick))).expect("bake");
    put(&dir.path().join("gltf/only_a.glb"), b"my own edit");
    bake(dir.path(), options("b", Arc::new(Quick))).expect("bake");
    assert_eq!(read(&dir.path().join("gltf/only_a.glb")), b"my own edit");
}

#[test]
fn files_that_someone_changed_are_named_when_they_are_replaced() {
    let dir = tempfile::tempdir().expect("dir");
    let write = |key: &str| {
        let folder = Folder::open_with(dir.path(), options(key, Arc::new(Quick))).expect("opens");
        for path in ["a.txt", "pov/main.pov"] {
            folder.write(path, "text", format!("osier, {key}\n").as_bytes()).expect("writes");
        }
        folder.finish().expect("ends");
        folder.replaced_changes()
    };
    assert!(write("a").is_empty());
    put(&dir.path().join("pov/main.pov"), b"// a camera of my own\n");
    assert_eq!(write("a"), ["pov/main.pov"]);
    // One letter, as one digit of a camera: the length is the same.
    put(&dir.path().join("pov/main.pov"), b"Osier, a\n");
    assert_eq!(write("a"), ["pov/main.pov"]);
    assert!(write("another scene").is_empty(), "files of another scene are replaced as they were written");
    put(&dir.path().join("a.txt"), b"// mine\n");
    assert_eq!(write("b"), ["a.txt"]);
}

#[test]
fn a_full_disk_leaves_whole_files_and_the_rest_for_later() {
    let whole = undisturbed("a");
    for room in (0..200).step_by(7) {
        let dir = tempfile::tempdir().expect("dir");
        let end = bake(dir.path(), options("a", Arc::new(FailAfter { left: AtomicI64::new(room) })));
        assert_eq!(end.map_err(|e| e.exit_code()), Err(74));
        for (name, bytes) in tree(dir.path()) {
            assert!(name.ends_with('/') || name == ".osier" || whole[&name] == bytes, "{name} at {room}");
        }
        bake(dir.path(), options("a", Arc::new(Quick))).expect("bake");
        assert_eq!(tree(dir.path()), whole);
    }
}

#[test]
fn foreign_files_stop_a_bake_until_it_is_forced() {
    for (path, early) in [("main.usda", false), (MANIFEST, true), (".osier", true)] {
        let dir = tempfile::tempdir().expect("dir");
        put(&dir.path().join(path), b"mine");
        let end = bake(dir.path(), options("a", Arc::new(Quick))).expect_err("foreign");
        assert!(matches!(&end, Error::Foreign { path: p } if p.ends_with(path)), "{end}");
        assert_eq!(end.exit_code(), 1);
        assert_eq!(read(&dir.path().join(path)), b"mine");
        assert!(!early || tree(dir.path()).len() == 1, "found before any work");
        bake(dir.path(), WriteOptions { force: true, ..options("a", Arc::new(Quick)) }).expect("forced");
        assert_eq!(tree(dir.path()), undisturbed("a"));
    }
    let dir = tempfile::tempdir().expect("dir");
    std::fs::create_dir(dir.path().join("main.usda")).expect("folder");
    assert_eq!(bake(dir.path(), options("a", Arc::new(Quick))).map_err(|e| e.exit_code()), Err(1));
    let forced = WriteOptions { force: true, ..options("a", Arc::new(Quick)) };
    assert_eq!(bake(dir.path(), forced).map_err(|e| e.exit_code()), Err(74));
}

#[test]
#[cfg(unix)]
fn links_are_replaced_not_followed_and_folders_that_lead_out_are_refused() {
    let outside = tempfile::tempdir().expect("dir");
    put(&outside.path().join("target"), b"mine");
    let link = |name: &str| {
        let dir = tempfile::tempdir().expect("dir");
        std::os::unix::fs::symlink(outside.path().join("target"), dir.path().join(name)).expect("link");
        dir
    };
    let dir = link("main.usda");
    assert!(matches!(bake(dir.path(), options("a", Arc::new(Quick))), Err(Error::Foreign { .. })));
    bake(dir.path(), WriteOptions { force: true, ..options("a", Arc::new(Quick)) }).expect("forced");
    assert_eq!(tree(dir.path()), undisturbed("a"));
    assert!(!dir.path().join("main.usda").is_symlink());

    let dir = tempfile::tempdir().expect("dir");
    std::os::unix::fs::symlink(outside.path(), dir.path().join("pov")).expect("link");
    let end = bake(dir.path(), WriteOptions { force: true, ..options("a", Arc::new(Quick)) });
    assert!(matches!(end, Err(Error::Export { code: "X009", .. })));
    assert_eq!(tree(outside.path()).into_keys().collect::<Vec<_>>(), ["target"]);
    assert_eq!(read(&outside.path().join("target")), b"mine");
}

#[test]
fn paths_that_leave_the_folder_are_refused() {
    let dir = tempfile::tempdir().expect("dir");
    let folder = Folder::open(dir.path()).expect("open");
    for path in ["", "/a", "a/", "a//b", "../a", "a/../b", "./a", "a\\b", "c:a", "a\nb", "a\0b", ".osier"] {
        assert!(matches!(folder.create(path, "x", None), Err(Error::Export { code: "X009", .. })), "{path:?}");
    }
}

#[test]
fn single_files_are_replaced_only_if_osier_made_them() {
    let dir = tempfile::tempdir().expect("dir");
    let grow = |text: &str, force| {
        let folder = Folder::plain(dir.path(), WriteOptions { force, ..WriteOptions::default() })?;
        folder.write("odd \\name: 1.obj", "obj", text.as_bytes())?;
        folder.finish()
    };
    grow("# osier 0.1.0\none", false).expect("first");
    grow("# osier 0.1.0\ntwo", false).expect("again");
    assert_eq!(tree(dir.path()).into_values().collect::<Vec<_>>(), [b"# osier 0.1.0\ntwo"]);
    put(&dir.path().join("odd \\name: 1.obj"), b"# willow (osier)");
    assert!(matches!(grow("# osier 0.1.0", false), Err(Error::Foreign { .. })));
    grow("# osier 0.1.0\nthree", true).expect("forced");
    assert_eq!(tree(dir.path()).into_values().collect::<Vec<_>>(), [b"# osier 0.1.0\nthree"]);
}

#[test]
fn memory_keeps_what_a_pipe_will_get() {
    let folder = Folder::memory();
    let mut out = folder.create("x.glb", "glb.web", None).expect("create").expect("new");
    out.put(b"....body").expect("put");
    out.put_at(0, b"glTF").expect("patch");
    out.put(b"!").expect("put");
    out.commit().expect("commit");
    assert_eq!(folder.files()[0].bytes, 9);
    assert_eq!(folder.take("x.glb").as_deref(), Some(&b"glTFbody!"[..]));
}

#[test]
fn a_request_to_stop_ends_the_bake_without_a_trace_of_the_open_file() {
    let dir = tempfile::tempdir().expect("dir");
    let cancel = Cancel::default();
    let folder = Folder::open_with(dir.path(), WriteOptions { cancel: cancel.clone(), ..WriteOptions::default() });
    let mut out = folder.expect("open").create("a.ply", "ply", None).expect("create").expect("new");
    out.put(b"half").expect("put");
    cancel.request(2);
    assert!(matches!(out.commit(), Err(Error::Cancelled { signal: 2 })));
    assert!(tree(dir.path()).is_empty());
}

/// Runs only as the child of the test below.
#[test]
fn child() {
    #[allow(clippy::disallowed_methods, reason = "how the parent names the folder")]
    let Ok(root) = std::env::var("OSIER_TEST_CHILD") else { return };
    for _ in 0..20 {
        bake(Path::new(&root), options("a", Arc::new(SystemDisk))).expect("bake");
        std::fs::remove_file(Path::new(&root).join("main.usda")).ok();
    }
    bake(Path::new(&root), options("a", Arc::new(SystemDisk))).expect("bake");
}

#[test]
fn two_processes_in_one_folder_both_succeed() {
    let dir = tempfile::tempdir().expect("dir");
    let start = || {
        std::process::Command::new(std::env::current_exe().expect("self"))
            .args(["--exact", "child"])
            .env("OSIER_TEST_CHILD", dir.path())
            .output()
    };
    std::thread::scope(|s| {
        let runs: Vec<_> = (0..3).map(|_| s.spawn(start)).collect();
        for run in runs {
            let output = run.join().expect("thread").expect("start");
            assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stdout));
        }
    });
    bake(dir.path(), options("a", Arc::new(SystemDisk))).expect("bake");
    assert_eq!(tree(dir.path()), undisturbed("a"));
}

/// A small disk of our own, gone when dropped; `None` where we may not mount one.
#[cfg(target_os = "linux")]
struct Tmpfs(tempfile::TempDir);

#[cfg(target_os = "linux")]
impl Tmpfs {
    fn mount(options: &str) -> Option<Self> {
        let dir = tempfile::tempdir().expect("dir");
        let mount =
            std::process::Command::new("mount").args(["-t", "tmpfs", "-o", options, "tmpfs"]).arg(dir.path()).output();
        mount.is_ok_and(|o| o.status.success()).then_some(Self(dir))
    }

    fn remount(&self, options: &str) {
        let done = std::process::Command::new("mount").args(["-o", options]).arg(self.0.path()).status();
        assert!(done.is_ok_and(|s| s.success()));
    }
}

#[cfg(target_os = "linux")]
impl Drop for Tmpfs {
    fn drop(&mut self) {
        std::process::Command::new("umount").arg(self.0.path()).status().ok();
    }
}

#[test]
#[cfg(target_os = "linux")]
fn a_real_disk_that_is_full_or_read_only() {
    let Some(disk) = Tmpfs::mount("size=64k") else {
        let mut out = io::stderr();
        writeln!(out, "skipped: mounting a small disk needs root").ok();
        return;
    };
    let root = disk.0.path().join("out");
    put(&disk.0.path().join("filler"), &[0; 48 << 10]);
    let folder = Folder::open(&root).expect("open");
    let mut out = folder.create("big.usdc", "usdc", None).expect("create").expect("new");
    let end = out.put(&[7; 1 << 16]).and_then(|()| out.commit());
    assert_eq!(end.map_err(|e| e.exit_code()), Err(74));
    assert!(!tree(&root).keys().any(|k| k.contains("big")), "no torn file is left");
    drop(folder);
    std::fs::remove_dir_all(&root).expect("remove");
    std::fs::remove_file(disk.0.path().join("filler")).expect("remove");
    bake(&root, options("a", Arc::new(SystemDisk))).expect("room again");
    assert_eq!(tree(&root), undisturbed("a"));
    disk.remount("remount,ro");
    assert_eq!(bake(&root, options("b", Arc::new(SystemDisk))).map_err(|e| e.exit_code()), Err(74));
    assert_eq!(tree(&root), undisturbed("a"));
}
