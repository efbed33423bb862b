//! The file system operations that the writer uses, behind a trait for tests, and retries of transient errors.

use std::fmt::Debug;
use std::fs::{self, File, OpenOptions};
use std::io::{self, Read as _, Write as _};
use std::path::Path;
use std::time::Duration;

/// File system operations of the writer. [`SystemDisk`] calls the operating system; tests implement disks that fill up or fail
/// at a chosen call.
pub trait Disk: Debug + Send + Sync {
    /// Makes a folder and its missing parents; an existing folder is no error.
    /// # Errors
    /// The error of the system call.
    fn make_dir(&self, path: &Path) -> io::Result<()> {
        fs::create_dir_all(path)
    }

    /// Makes a file, readable and writable. A name that exists, even as a symbolic link, is an error.
    /// # Errors
    /// The error of the system call.
    fn create_new(&self, path: &Path) -> io::Result<File> {
        OpenOptions::new().read(true).write(true).create_new(true).open(path)
    }

    /// Writes a leading part of the bytes and returns its length; 0 means that the disk accepts no more.
    /// # Errors
    /// The error of the system call; then nothing was written.
    fn write(&self, file: &mut File, bytes: &[u8]) -> io::Result<usize> {
        file.write(bytes)
    }

    /// Waits until the contents and metadata of the file are on the storage device (`fsync`).
    /// # Errors
    /// The error of the system call.
    fn sync(&self, file: &File) -> io::Result<()> {
        file.sync_all()
    }

    /// Appends one line to a file, which is made if absent, and waits until it is on the storage device.
    /// # Errors
    /// The error of the system call.
    fn append(&self, path: &Path, line: &[u8]) -> io::Result<()> {
        let mut file = OpenOptions::new().append(true).create(true).open(path)?;
        file.write_all(line)?;
        file.sync_data()
    }

    /// Renames a file within a file system, replacing a file of the new name.
    /// # Errors
    /// The error of the system call.
    fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
        fs::rename(from, to)
    }

    /// Removes a file. A symbolic link itself is removed, not its target.
    /// # Errors
    /// The error of the system call.
    fn remove(&self, path: &Path) -> io::Result<()> {
        fs::remove_file(path)
    }

    /// Removes a folder; one that is not empty is an error.
    /// # Errors
    /// The error of the system call.
    fn remove_dir(&self, path: &Path) -> io::Result<()> {
        fs::remove_dir(path)
    }

    /// Waits until the directory entries of a folder are on the storage device; does nothing outside Unix.
    /// # Errors
    /// The error of the system call.
    fn sync_dir(&self, path: &Path) -> io::Result<()> {
        if cfg!(unix) {
            #[allow(clippy::disallowed_methods, reason = "a folder, opened to be synced")]
            File::open(path)?.sync_all()?;
        }
        Ok(())
    }
}

/// The file system of the operating system: every method of [`Disk`] as provided.
#[derive(Debug, Clone, Copy, Default)]
pub struct SystemDisk;

impl Disk for SystemDisk {}

/// Delays before further attempts, ms: exponential backoff of 3.1 s in total, enough for a network share to reconnect.
const RETRY_DELAYS_MS: [u64; 5] = [100, 200, 400, 800, 1600];

/// Runs `action` until it succeeds, fails with a permanent error, or has failed six times with a transient one.
pub(super) fn retry<T>(mut action: impl FnMut() -> io::Result<T>) -> io::Result<T> {
    for wait in RETRY_DELAYS_MS {
        match action() {
            Err(e) if crate::error::is_transient(&e) => std::thread::sleep(Duration::from_millis(wait)),
            done => return done,
        }
    }
    action()
}

/// BLAKE3 and length of an open file, read to its end.
pub(super) fn hash(mut file: impl io::Read) -> io::Result<(blake3::Hash, u64)> {
    let mut hasher = blake3::Hasher::new();
    let mut buffer = vec![0; 1 << 18];
    loop {
        let n = retry(|| file.read(&mut buffer))?;
        if n == 0 {
            return Ok((hasher.finalize(), hasher.count()));
        }
        hasher.update(&buffer[..n]);
    }
}

/// Opens a regular file for reading, without blocking on a pipe. `follow`: whether a symbolic link as the last component of
/// the path is followed or refused.
pub(super) fn open_regular(path: &Path, follow: bool) -> io::Result<File> {
    let mut options = OpenOptions::new();
    options.read(true);
    #[cfg(unix)]
    {
        use std::os::unix::fs::OpenOptionsExt as _;
        // Opening a pipe without a writer would block for ever; non-blocking, it opens and is refused below.
        let flags = rustix::fs::OFlags::NONBLOCK | rustix::fs::OFlags::CLOEXEC;
        let flags = if follow { flags } else { flags | rustix::fs::OFlags::NOFOLLOW };
        options.custom_flags(flags.bits().cast_signed());
    }
    #[cfg(not(unix))]
    if !follow && fs::symlink_metadata(path)?.is_symlink() {
        return Err(io::Error::new(io::ErrorKind::InvalidInput, "is a link"));
    }
    let file = retry(|| options.open(path))?;
    // The type is that of the opened file: the name could refer to another file by now.
    if file.metadata()?.is_file() {
        Ok(file)
    } else {
        Err(io::Error::new(io::ErrorKind::InvalidInput, "not a regular file"))
    }
}

/// At most `limit` bytes of a file; `None` if it is longer.
pub(super) fn read_limited(file: impl io::Read, limit: u64) -> io::Result<Option<Vec<u8>>> {
    let mut bytes = Vec::new();
    // One byte more than allowed distinguishes a longer file from one of exactly `limit` bytes, without reading the rest.
    file.take(limit.saturating_add(1)).read_to_end(&mut bytes)?;
    Ok((bytes.len() as u64 <= limit).then_some(bytes))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn passing_errors_are_tried_again_and_others_are_not() {
        let mut left = 2;
        let result = retry(|| {
            left -= 1;
            if left >= 0 { Err(io::Error::from(io::ErrorKind::ResourceBusy)) } else { Ok(7) }
        });
        assert_eq!((result.ok(), left), (Some(7), -1));
        let mut calls = 0;
        let result: io::Result<()> = retry(|| {
            calls += 1;
            Err(io::Error::from(io::ErrorKind::StorageFull))
        });
        assert!(result.is_err() && calls == 1);
    }
}
