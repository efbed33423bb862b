//! Files that are being written: `.NAME.HOST-PID-N.part` in the folder of the final name, one per writer, removed when it ends.
//!
//! A writer keeps its part locked until the part is renamed or removed. Process ids alone do not show whether the writer is
//! still alive: processes in two containers on one machine may have the same id. N counts from a random number, so that no two
//! processes use the same name: a writer that removes its part by name cannot remove the part of another.

use std::collections::BTreeSet;
use std::collections::hash_map::RandomState;
use std::fs::{self, File};
use std::hash::BuildHasher as _;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, LazyLock, Mutex, PoisonError};
use std::time::Duration;

use super::file_system::{Disk, open_regular, retry};

/// Parts that this process is writing now; others with its process id were left by a dead process of the same id.
static LIVE: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());

/// Number of this process's first part. It is random; part names appear in no result, so outputs do not depend on it.
static FIRST: LazyLock<u64> = LazyLock::new(|| RandomState::new().hash_one(std::process::id()));
static COUNT: AtomicU64 = AtomicU64::new(0);

/// True if `n` is the number of a part of this process; numbers wrap around at 2^64.
fn made_here(n: u64) -> bool {
    n.wrapping_sub(*FIRST) < COUNT.load(Ordering::Relaxed)
}

/// Largest number of bytes of the final name in the name of a part, which must stay under 255 bytes.
const NAME_BYTES: usize = 120;

/// Age after which a part is removed even if another host made it or its lock cannot be queried.
const PATIENCE: Duration = Duration::from_secs(24 * 3600);

/// A part file; removed when dropped unless it was moved to its final name.
#[derive(Debug)]
pub(super) struct PartFile {
    disk: Arc<dyn Disk>,
    path: PathBuf,
    moved: bool,
    /// Open as long as this process holds the lock on the part.
    lock: Option<File>,
}

impl PartFile {
    /// Makes and locks a part file in `folder` for the final name `name`, under a number without a file yet.
    pub(super) fn create(disk: &Arc<dyn Disk>, folder: &Path, name: &str) -> io::Result<(Self, File)> {
        loop {
            let n = FIRST.wrapping_add(COUNT.fetch_add(1, Ordering::Relaxed));
            let path = folder.join(format!(".{}.{}-{}-{n}.part", cut(name), host(), std::process::id()));
            live(|l| l.insert(path.clone()));
            let mut part = Self { disk: Arc::clone(disk), path, moved: false, lock: None };
            match retry(|| disk.create_new(&part.path)) {
                Ok(file) if is_held(&file) => {
                    part.lock = file.try_clone().ok();
                    return Ok((part, file));
                }
                // Before the part was locked, another process took it for that of a dead process and removed it: try the next number.
                Ok(_) => {}
                // Another file has this name: it is left to `remove_stale_parts`, and the next number is tried.
                Err(e) if e.kind() == io::ErrorKind::AlreadyExists => part.moved = true,
                Err(e) => {
                    part.moved = true;
                    return Err(e);
                }
            }
        }
    }

    /// Renames the part to `target`, replacing a file there; after an error the part is removed.
    pub(super) fn rename(mut self, target: &Path) -> io::Result<()> {
        if cfg!(not(unix)) {
            // Some systems do not rename an open file.
            self.lock = None;
        }
        retry(|| self.disk.rename(&self.path, target))?;
        self.moved = true;
        Ok(())
    }
}

impl Drop for PartFile {
    fn drop(&mut self) {
        if !self.moved {
            // A part that cannot be removed now is removed by the next run.
            let _ = self.disk.remove(&self.path);
        }
        live(|l| l.remove(&self.path));
    }
}

/// Removes the part files that this process is writing, before an exit that runs no destructors.
pub fn drop_parts() {
    for path in live(std::mem::take) {
        let _ = fs::remove_file(path);
    }
}

/// Locks a part that was just made; false if another process has locked or removed it meanwhile. A file system without locks
/// counts as locked.
#[cfg(unix)]
fn is_held(file: &File) -> bool {
    use std::os::unix::fs::MetadataExt as _;
    lock(file) != Lock::Taken && file.metadata().is_ok_and(|m| m.nlink() > 0)
}

#[cfg(not(unix))]
fn is_held(_file: &File) -> bool {
    true
}

#[derive(Debug, PartialEq, Eq)]
enum Lock {
    Ours,
    Taken,
    /// The file system has no locks.
    Unknown,
}

#[cfg(unix)]
fn lock(file: &File) -> Lock {
    use rustix::fs::{FlockOperation, flock};
    match flock(file, FlockOperation::NonBlockingLockExclusive) {
        Ok(()) => Lock::Ours,
        Err(rustix::io::Errno::WOULDBLOCK) => Lock::Taken,
        Err(_) => Lock::Unknown,
    }
}

#[cfg(not(unix))]
fn lock(_file: &File) -> Lock {
    Lock::Unknown
}

fn live<T>(f: impl FnOnce(&mut BTreeSet<PathBuf>) -> T) -> T {
    f(&mut LIVE.lock().unwrap_or_else(PoisonError::into_inner))
}

fn cut(name: &str) -> &str {
    let mut end = name.len().min(NAME_BYTES);
    while !name.is_char_boundary(end) {
        end -= 1;
    }
    &name[..end]
}

/// Name of this machine in `[A-Za-z0-9_]`, at most 40 bytes.
fn host() -> String {
    #[cfg(unix)]
    let name = rustix::system::uname().nodename().to_string_lossy().into_owned();
    #[cfg(not(unix))]
    let name = String::from("host");
    let plain = |c: char| if c.is_ascii_alphanumeric() { c } else { '_' };
    name.chars().map(plain).chain(name.is_empty().then_some('_')).take(40).collect()
}

/// Host, process and number of a part's name; `None` for any other name.
fn owner(name: &str) -> Option<(&str, i32, u64)> {
    let middle = name.strip_prefix('.')?.strip_suffix(".part")?;
    let tail = middle.rsplit('.').next().filter(|t| t.len() < middle.len())?;
    let mut fields = tail.rsplitn(3, '-');
    let n = fields.next()?.parse().ok()?;
    let pid = fields.next()?.parse().ok()?;
    Some((fields.next()?, pid, n))
}

#[cfg(unix)]
fn is_dead(pid: i32) -> bool {
    let Some(pid) = rustix::process::Pid::from_raw(pid) else { return true };
    rustix::process::test_kill_process(pid) == Err(rustix::io::Errno::SRCH)
}

#[cfg(not(unix))]
fn is_dead(_pid: i32) -> bool {
    false
}

/// Removes parts in a folder that no process holds locked: those of this host if their process has ended, others after a
/// day.
pub(super) fn remove_stale_parts(disk: &Arc<dyn Disk>, folder: &Path) {
    let Ok(entries) = fs::read_dir(folder) else { return };
    let mut now = None;
    for entry in entries.flatten() {
        let name = entry.file_name();
        let Some((their_host, pid, n)) = name.to_str().and_then(owner) else { continue };
        if !entry.file_type().is_ok_and(|t| t.is_file()) {
            continue;
        }
        let path = entry.path();
        // `_file` keeps the lock until the part is removed.
        let held = open_regular(&path, false).map(|file| (lock(&file), file));
        let Ok((lock, _file)) = held else { continue };
        let own = their_host == host();
        let same_pid = own && u32::try_from(pid) == Ok(std::process::id());
        let gone = match lock {
            // A forked child holds the locks of this process until it executes another program, so `LIVE` decides instead.
            _ if same_pid && made_here(n) => !live(|l| l.contains(&path)),
            Lock::Taken => continue,
            // This process could take the lock, so no process holds it. A part with the id of this process was left by an earlier
            // process with that id.
            Lock::Ours => own && (same_pid || is_dead(pid)),
            Lock::Unknown => false,
        };
        let mut aged = || {
            let now = *now.get_or_insert_with(|| disk_time(disk, folder));
            let age = now.zip(entry.metadata().and_then(|m| m.modified()).ok());
            age.is_some_and(|(now, then)| now.duration_since(then).is_ok_and(|a| a > PATIENCE))
        };
        if gone || aged() {
            let _ = disk.remove(&path);
        }
    }
}

/// Current time by the clock of the file system, which may be a server's: the modification time of a new file.
fn disk_time(disk: &Arc<dyn Disk>, folder: &Path) -> Option<std::time::SystemTime> {
    let (_part, file) = PartFile::create(disk, folder, "now").ok()?;
    file.metadata().ok()?.modified().ok()
}

#[cfg(test)]
#[allow(clippy::disallowed_methods, reason = "tests look at the disk themselves")]
mod tests {
    use super::*;
    use crate::files::file_system::SystemDisk;

    #[test]
    fn only_part_names_have_an_owner() {
        assert_eq!(owner(".frame.0001.exr.farm_7-123-4.part"), Some(("farm_7", 123, 4)));
        for other in ["x.part", ".x.part", ".osier", ".a.b-c-d.part", ".h-1-2.part", ".a.h-1-2.parts"] {
            assert_eq!(owner(other), None, "{other}");
        }
    }

    #[test]
    fn the_sweep_takes_the_dead_and_spares_the_living() {
        let dir = tempfile::tempdir().expect("dir");
        let disk: Arc<dyn Disk> = Arc::new(SystemDisk);
        let (_kept, _file) = PartFile::create(&disk, dir.path(), "mine").expect("part");
        let own = std::process::id();
        let names = [
            (format!(".a.{}-{own}-999999999.part", host()), false),
            (format!(".b.{}-2147483646-0.part", host()), false),
            (format!(".c.{}-1-0.part", host()), true),
            (".d.elsewhere-1-0.part".into(), true),
            ("e.part".into(), true),
        ];
        for (name, _) in &names {
            fs::write(dir.path().join(name), b"x").expect("write");
        }
        remove_stale_parts(&disk, dir.path());
        for (name, stays) in &names {
            assert_eq!(dir.path().join(name).exists(), *stays, "{name}");
        }
        let mine = fs::read_dir(dir.path()).expect("list").flatten();
        assert_eq!(mine.filter(|e| e.file_name().to_string_lossy().starts_with(".mine")).count(), 1);
        let old = File::options().write(true).open(dir.path().join(".d.elsewhere-1-0.part")).expect("open");
        old.set_modified(std::time::UNIX_EPOCH).expect("age");
        remove_stale_parts(&disk, dir.path());
        assert!(!dir.path().join(".d.elsewhere-1-0.part").exists());
    }
}
