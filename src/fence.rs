//! The only place where files are opened and written.
//!
//! Reading: references inside files stay inside their folder. Writing: a file appears whole or not at all, and a journal
//! in the output folder says which files are ours and finished.

use std::collections::BTreeMap;
use std::fs::{self, File, OpenOptions};
use std::io::{self, BufWriter, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use crate::{Error, Result};

/// Bytes of a file named by the user, at most `limit` of them.
/// # Errors
/// `Io` if it cannot be read, `Limit` if it is longer.
pub fn read_input(path: &Path, limit: u64) -> Result<Vec<u8>> {
    #[allow(clippy::disallowed_methods, reason = "this is the place")]
    let file = File::open(path).map_err(|e| Error::io("open", path, e))?;
    let mut bytes = Vec::new();
    file.take(limit.saturating_add(1)).read_to_end(&mut bytes).map_err(|e| Error::io("read", path, e))?;
    if bytes.len() as u64 > limit {
        return Err(Error::Limit {
            name: format!("size of \"{}\"", path.display()),
            wanted: "more".into(),
            limit: format!("{limit} bytes"),
            flag: "--max-text-bytes or --max-mesh-bytes".into(),
        });
    }
    Ok(bytes)
}

/// A finished file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FileRecord {
    /// Relative to the folder, with `/`.
    pub path: String,
    /// Kind as in the manifest: `usdc`, `glb.web`, ...
    pub kind: &'static str,
    /// Frame number for members of a sequence.
    pub frame: Option<u32>,
    /// Length.
    pub bytes: u64,
    /// BLAKE3, 64 hex digits.
    pub blake3: String,
}

/// An output folder. Cheap to clone; clones share the journal.
#[derive(Debug, Clone)]
pub struct Folder {
    root: PathBuf,
    done: Arc<Mutex<BTreeMap<String, FileRecord>>>,
}

impl Folder {
    /// Opens (and makes) an output folder.
    /// # Errors
    /// `Io` if it cannot be made.
    pub fn open(root: impl Into<PathBuf>) -> Result<Self> {
        let root = root.into();
        fs::create_dir_all(&root).map_err(|e| Error::io("create", &root, e))?;
        Ok(Self { root, done: Arc::default() })
    }

    /// The folder's own path.
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// Starts a file at a relative path with `/`, or gives `None` if the journal proves that it is already finished:
    /// then skip the work. `frame`: number for members of a sequence.
    /// # Errors
    /// X009 for a path that leaves the folder, `Foreign` if something that is not ours is in the way, `Io`.
    pub fn create(&self, path: &str, kind: &'static str, frame: Option<u32>) -> Result<Option<Output>> {
        if path.split('/').any(|c| c.is_empty() || c == "." || c == "..") || path.contains('\\') {
            return Err(Error::export("X009", format!("\"{path}\" leaves the output folder")));
        }
        let target = self.root.join(path);
        let parent = target.parent().unwrap_or(&self.root);
        fs::create_dir_all(parent).map_err(|e| Error::io("create", parent, e))?;
        let name = target.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let part = parent.join(format!(".{name}.{}.part", std::process::id()));
        let file = OpenOptions::new()
            .write(true)
            .read(true)
            .create(true)
            .truncate(true)
            .open(&part)
            .map_err(|e| Error::io("create", &part, e))?;
        let writer = Some(BufWriter::with_capacity(1 << 20, file));
        let record = FileRecord { path: path.to_owned(), kind, frame, bytes: 0, blake3: String::new() };
        Ok(Some(Output {
            folder: self.clone(),
            target,
            part,
            writer,
            hasher: blake3::Hasher::new(),
            moved: false,
            record,
        }))
    }

    /// Writes a whole small file.
    /// # Errors
    /// As [`Folder::create`].
    pub fn write(&self, path: &str, kind: &'static str, bytes: &[u8]) -> Result<()> {
        if let Some(mut out) = self.create(path, kind, None)? {
            out.put(bytes)?;
            out.commit()?;
        }
        Ok(())
    }

    /// Finished files in path order.
    pub fn files(&self) -> Vec<FileRecord> {
        self.done.lock().unwrap_or_else(PoisonError::into_inner).values().cloned().collect()
    }
}

/// A file being written; it appears under its name at [`Output::commit`] and leaves nothing behind if dropped before.
#[derive(Debug)]
pub struct Output {
    folder: Folder,
    target: PathBuf,
    part: PathBuf,
    writer: Option<BufWriter<File>>,
    hasher: blake3::Hasher,
    moved: bool,
    record: FileRecord,
}

impl Output {
    /// Appends bytes.
    /// # Errors
    /// `Io` naming the file.
    pub fn put(&mut self, bytes: &[u8]) -> Result<()> {
        self.write_all(bytes).map_err(|e| Error::io("write", &self.target, e))
    }

    /// Overwrites bytes at an absolute offset, then goes on at the end. The hash is then taken from the finished file.
    /// # Errors
    /// `Io` naming the file.
    pub fn put_at(&mut self, offset: u64, bytes: &[u8]) -> Result<()> {
        self.moved = true;
        let failed = |e| Error::io("write", &self.target, e);
        let Some(w) = self.writer.as_mut() else { return Ok(()) };
        w.seek(SeekFrom::Start(offset)).map_err(failed)?;
        w.write_all(bytes).map_err(failed)?;
        w.seek(SeekFrom::End(0)).map_err(failed)?;
        Ok(())
    }

    /// Bytes written so far.
    pub fn position(&self) -> u64 {
        self.record.bytes
    }

    /// Flushes, syncs and renames; the file is then in the folder's list.
    /// # Errors
    /// `Io` naming the file; nothing is left behind.
    pub fn commit(mut self) -> Result<()> {
        let Some(writer) = self.writer.take() else { return Ok(()) };
        let failed = |action| move |e: io::Error| (action, e);
        let finish = || -> std::result::Result<blake3::Hash, (&'static str, io::Error)> {
            let mut file = writer.into_inner().map_err(|e| ("write", e.into_error()))?;
            let hash = if self.moved {
                let mut hasher = blake3::Hasher::new();
                file.seek(SeekFrom::Start(0)).map_err(failed("read"))?;
                hasher.update_reader(&mut file).map_err(failed("read"))?;
                hasher.finalize()
            } else {
                self.hasher.finalize()
            };
            file.sync_all().map_err(failed("sync"))?;
            fs::rename(&self.part, &self.target).map_err(failed("rename"))?;
            Ok(hash)
        };
        let hash = finish().map_err(|(action, e)| Error::io(action, &self.target, e))?;
        let mut record = self.record.clone();
        record.blake3 = hash.to_hex().to_string();
        let mut done = self.folder.done.lock().unwrap_or_else(PoisonError::into_inner);
        done.insert(record.path.clone(), record);
        Ok(())
    }
}

impl Write for Output {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let Some(w) = self.writer.as_mut() else { return Ok(bytes.len()) };
        let n = w.write(bytes)?;
        self.hasher.update(&bytes[..n]);
        self.record.bytes += n as u64;
        Ok(n)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.writer.as_mut().map_or(Ok(()), Write::flush)
    }
}

impl Drop for Output {
    fn drop(&mut self) {
        // After a commit the part file is gone and this finds nothing.
        let _ = fs::remove_file(&self.part);
    }
}
