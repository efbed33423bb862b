//! Output folders: which files in them osier wrote, which are already finished, and in which order changes become visible.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use super::file_system::{Disk, SystemDisk, hash, open_regular, retry};
use super::generator::names_osier;
use super::journal::{JOURNAL, Journal, JournalEntry, JournalError, key_digest};
use super::part_file::remove_stale_parts;
use super::unique_names::is_plain_path;
use crate::progress::Cancel;
use crate::{Error, Result};

/// The file that makes a folder's files a finished set; written last, withdrawn before any of them changes.
pub const MANIFEST: &str = "manifest.json";

/// A finished file, as the manifest lists it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FileRecord {
    /// Relative to the folder, with `/`.
    pub path: String,
    /// Kind as in the manifest: `usdc`, `glb.web`, ...
    pub kind: &'static str,
    /// Frame number for members of a sequence; `None` for a file that the clip has once.
    pub frame: Option<u32>,
    /// Length of the file, bytes.
    pub bytes: u64,
    /// BLAKE3, 64 hex digits.
    pub blake3: String,
}

/// Options of an output folder: what its files depend on, and what may be overwritten.
#[derive(Debug, Clone)]
pub struct WriteOptions {
    /// Everything that the bytes of the files depend on: scene hash, version, options. Files finished under an equal key are kept.
    /// An empty key identifies no bytes: every file is written, and files of earlier runs are removed like files of another key.
    pub key: String,
    /// Overwrite files that osier did not write, instead of ending with [`Error::Foreign`].
    pub force: bool,
    /// Polled while files are written; a request ends the bake.
    pub cancel: Cancel,
    /// The file system that is written to; by default that of the operating system.
    pub disk: Arc<dyn Disk>,
}

impl Default for WriteOptions {
    fn default() -> Self {
        Self { key: String::new(), force: false, cancel: Cancel::default(), disk: Arc::new(SystemDisk) }
    }
}

/// Where files are written and what is recorded about them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum FolderKind {
    /// An output folder with a journal.
    Journalled,
    /// A folder of the user, into which single files are written.
    Plain,
    /// No folder: files are kept in memory.
    Memory,
}

#[derive(Debug, Default)]
pub(super) struct FolderState {
    finished: BTreeMap<String, FileRecord>,
    journal: Option<Journal>,
    /// Relative paths of folders that were made and cleared of stale parts.
    prepared_folders: BTreeSet<String>,
    /// A file was begun, so the manifest is withdrawn.
    manifest_withdrawn: bool,
    memory: BTreeMap<String, Vec<u8>>,
    /// Files of earlier runs that this run replaces although someone else has changed them.
    replaced_changes: BTreeSet<String>,
}

#[derive(Debug)]
struct Shared {
    root: PathBuf,
    kind_of_folder: FolderKind,
    key: String,
    options: WriteOptions,
    state: Mutex<FolderState>,
}

/// An output folder. Cheap to clone; clones share the journal.
#[derive(Debug, Clone)]
pub struct Folder {
    shared: Arc<Shared>,
}

impl Folder {
    /// Opens (and makes) an output folder with the default options.
    /// # Errors
    /// As [`Folder::open_with`].
    pub fn open(root: impl Into<PathBuf>) -> Result<Self> {
        Self::open_with(root, WriteOptions::default())
    }

    /// Opens (and makes) an output folder, reads its journal and removes part files of writers that ended.
    /// # Errors
    /// `Io` if it cannot be made, `Foreign` if its journal or manifest is not ours and `force` is not set.
    pub fn open_with(root: impl Into<PathBuf>, options: WriteOptions) -> Result<Self> {
        let folder = Self::new(root.into(), FolderKind::Journalled, options);
        let (root, disk) = (folder.root(), folder.disk());
        retry(|| disk.make_dir(root)).map_err(|e| Error::io("create", root, e))?;
        remove_stale_parts(disk, root);
        let journal = match Journal::open(disk, root) {
            Err(JournalError::Foreign) if folder.shared.options.force => {
                Journal::replacing(disk, root).map_err(|e| Error::io("replace", root.join(JOURNAL), e))?
            }
            Err(JournalError::Foreign) => return Err(Error::Foreign { path: root.join(JOURNAL) }),
            Err(JournalError::Io(e)) => return Err(Error::io("read", root.join(JOURNAL), e)),
            Ok(journal) => journal,
        };
        for relative in journal.folders() {
            if folder.is_own_folder(&relative) {
                remove_stale_parts(disk, &root.join(relative));
            }
        }
        let mut state = folder.state();
        state.journal = Some(journal);
        state.prepared_folders.insert(String::new());
        folder.check_replaceable(&mut state, MANIFEST)?;
        drop(state);
        Ok(folder)
    }

    /// A folder that belongs to the user, for single files named on the command line: no journal, no resuming; files
    /// that do not name osier as their maker are foreign.
    /// # Errors
    /// `Io` if it cannot be made.
    pub fn plain(root: impl Into<PathBuf>, options: WriteOptions) -> Result<Self> {
        let folder = Self::new(root.into(), FolderKind::Plain, options);
        let (root, disk) = (folder.root(), folder.disk());
        retry(|| disk.make_dir(root)).map_err(|e| Error::io("create", root, e))?;
        Ok(folder)
    }

    /// Files kept in memory, for a result that goes to a pipe; fetch them with [`Folder::take`].
    pub fn memory() -> Self {
        Self::new(PathBuf::new(), FolderKind::Memory, WriteOptions::default())
    }

    fn new(root: PathBuf, kind_of_folder: FolderKind, options: WriteOptions) -> Self {
        let key = key_digest(&options.key);
        Self { shared: Arc::new(Shared { root, kind_of_folder, key, options, state: Mutex::default() }) }
    }

    /// Path of the folder; empty for one in memory.
    pub fn root(&self) -> &Path {
        &self.shared.root
    }

    pub(super) fn disk(&self) -> &Arc<dyn Disk> {
        &self.shared.options.disk
    }

    pub(super) fn cancel(&self) -> &Cancel {
        &self.shared.options.cancel
    }

    pub(super) fn state(&self) -> MutexGuard<'_, FolderState> {
        self.shared.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Checks and prepares a new file: path, folder, manifest. `None` if the journal proves that it is already finished.
    /// # Errors
    /// As [`Folder::create`].
    pub(super) fn begin_file(&self, path: &str, kind: &'static str, frame: Option<u32>) -> Result<Option<FileRecord>> {
        // In the user's own folder, a name typed on the command line may have characters that portable names must not have.
        let typed = self.shared.kind_of_folder == FolderKind::Plain
            && !path.contains(['/', '\0'])
            && !matches!(path, "" | "." | "..");
        if !(is_plain_path(path) || typed) || path == JOURNAL {
            return Err(Error::export("X009", format!("{path:?} leaves the output folder")));
        }
        self.cancel().check()?;
        let record = FileRecord { path: path.to_owned(), kind, frame, bytes: 0, blake3: String::new() };
        if self.is_in_memory() {
            return Ok(Some(record));
        }
        self.prepare_folder(path.rsplit_once('/').map_or("", |(folder, _)| folder))?;
        // The manifest lists a finished set: before it is written, files of earlier bakes are removed, and before any other file
        // is written, the manifest is withdrawn.
        if path == MANIFEST {
            self.check_finished()?;
            self.remove_stale_files()?;
        }
        if self.reuse_finished(&record)? {
            return Ok(None);
        }
        let mut state = self.state();
        self.check_replaceable(&mut state, path)?;
        if path == MANIFEST {
            return Ok(Some(record));
        }
        self.withdraw_manifest(&mut state)?;
        let entries: Vec<JournalEntry> = state.journal.iter().flat_map(|j| j.entries(path)).cloned().collect();
        // Release the lock before the file is read, so that other threads can write meanwhile.
        drop(state);
        if !self.shared.options.force && self.has_other_content(path, &entries) {
            self.state().replaced_changes.insert(path.to_owned());
        }
        Ok(Some(record))
    }

    /// Checks that this run may write a file of a name. [`Folder::create`] checks it too, but for a file that refers to others
    /// and is written after them, an early check avoids writing these in vain.
    /// # Errors
    /// `Foreign` if a file that osier did not write has the name; `Io`.
    pub fn check_name(&self, path: &str) -> Result<()> {
        if self.is_in_memory() {
            return Ok(());
        }
        self.check_replaceable(&mut self.state(), path)
    }

    /// Counts a file in the user's folder as finished and returns true if it has these bytes already, whoever wrote it.
    pub(super) fn keep_equal(&self, path: &str, kind: &'static str, bytes: &[u8]) -> bool {
        if self.shared.kind_of_folder != FolderKind::Plain {
            return false;
        }
        let Ok(file) = open_regular(&self.root().join(path), false) else { return false };
        let (length, blake3) = (bytes.len() as u64, blake3::hash(bytes));
        // Lengths are compared first: a file of another length is not read.
        let is_equal = file.metadata().is_ok_and(|m| m.len() == length) && hash(file).is_ok_and(|(h, _)| h == blake3);
        if is_equal {
            let blake3 = blake3.to_hex().to_string();
            let record = FileRecord { path: path.to_owned(), kind, frame: None, bytes: length, blake3 };
            self.state().finished.insert(record.path.clone(), record);
        }
        is_equal
    }

    /// True for a folder of [`Folder::memory`].
    pub(super) fn is_in_memory(&self) -> bool {
        self.shared.kind_of_folder == FolderKind::Memory
    }

    /// Files finished in this run, written or kept, in path order.
    pub fn files(&self) -> Vec<FileRecord> {
        self.state().finished.values().cloned().collect()
    }

    /// Files that this run replaces without [`WriteOptions::force`] although their bytes are not those that osier wrote: someone has
    /// edited them since. In path order.
    pub fn replaced_changes(&self) -> Vec<String> {
        self.state().replaced_changes.iter().cloned().collect()
    }

    /// Moves out the bytes of a finished file of [`Folder::memory`]; `None` for any other path and on a second call.
    pub fn take(&self, path: &str) -> Option<Vec<u8>> {
        self.state().memory.remove(path)
    }

    /// Ends the run, after the manifest: removes files of bakes under other keys, syncs directory entries, and rewrites the
    /// journal to one line per file. Without this call a later run still resumes from all finished files.
    /// # Errors
    /// `Io`, `Cancelled`.
    pub fn finish(&self) -> Result<()> {
        self.cancel().check()?;
        if self.shared.kind_of_folder == FolderKind::Memory {
            return Ok(());
        }
        self.remove_stale_files()?;
        let mut guard = self.state();
        // Entries of this key whose file still has its length stay; files of this run are added.
        let FolderState { finished, journal, .. } = &mut *guard;
        let Some(journal) = journal else { return Ok(()) };
        let mut files: BTreeMap<String, JournalEntry> = BTreeMap::new();
        for (path, entries) in journal.files() {
            // Other processes may have finished files of the same key; their lengths are checked, their hashes only when
            // reused.
            let length = fs::symlink_metadata(self.root().join(path)).map(|m| m.len());
            let kept = entries.iter().find(|e| self.is_own_key(e) && length.as_ref().is_ok_and(|l| *l == e.bytes));
            files.extend(kept.map(|e| (path.clone(), e.clone())));
        }
        files.extend(finished.values().map(|r| (r.path.clone(), self.entry(r))));
        let path = self.root().join(JOURNAL);
        journal.rewrite(files).map_err(|e| Error::io("write", path, e))?;
        retry(|| self.disk().sync_dir(self.root())).map_err(|e| Error::io("sync", self.root(), e))
    }

    /// Whether an entry was written under the key of this run. False for the empty key, since entries with it may be of any scene.
    fn is_own_key(&self, entry: &JournalEntry) -> bool {
        !self.shared.options.key.is_empty() && entry.key == self.shared.key
    }

    fn entry(&self, record: &FileRecord) -> JournalEntry {
        JournalEntry { key: self.shared.key.clone(), blake3: record.blake3.clone(), bytes: record.bytes }
    }

    /// True if no component of a relative folder is a symbolic link, which could lead out of the root.
    fn is_own_folder(&self, relative: &str) -> bool {
        let ends = relative.match_indices('/').map(|(i, _)| i).chain([relative.len()]);
        let is_link = |end| fs::symlink_metadata(self.root().join(&relative[..end])).is_ok_and(|m| m.is_symlink());
        !ends.into_iter().any(is_link)
    }

    /// Makes a relative folder and removes stale parts in it, once per run.
    fn prepare_folder(&self, relative: &str) -> Result<()> {
        let mut state = self.state();
        if state.prepared_folders.contains(relative) {
            return Ok(());
        }
        let path = self.root().join(relative);
        if !relative.is_empty() && !self.is_own_folder(relative) {
            return Err(Error::export("X009", format!("\"{}\" is a link out of the output folder", path.display())));
        }
        if let Some(journal) = &mut state.journal {
            journal.add_folder(relative).map_err(|e| Error::io("write", self.root().join(JOURNAL), e))?;
        }
        retry(|| self.disk().make_dir(&path)).map_err(|e| Error::io("create", &path, e))?;
        remove_stale_parts(self.disk(), &path);
        state.prepared_folders.insert(relative.to_owned());
        Ok(())
    }

    /// Counts a file as finished if the journal has an entry of this key and the bytes on disk agree with it. Without a key
    /// only files of this run count.
    fn reuse_finished(&self, record: &FileRecord) -> Result<bool> {
        if self.shared.options.key.is_empty() && !self.state().finished.contains_key(&record.path) {
            return Ok(false);
        }
        let of_this_key = |state: &FolderState| -> Vec<JournalEntry> {
            let entries = state.journal.iter().flat_map(|j| j.entries(&record.path));
            entries.filter(|e| e.key == self.shared.key).cloned().collect()
        };
        let entries = of_this_key(&self.state());
        let Some(entry) = self.verified_entry(&record.path, &entries) else { return Ok(false) };
        let record = FileRecord { bytes: entry.bytes, blake3: entry.blake3.clone(), ..record.clone() };
        self.state().finished.insert(record.path.clone(), record);
        self.cancel().check()?;
        Ok(true)
    }

    /// The journal entry whose length and hash agree with the file on disk.
    fn verified_entry<'a>(
        &self,
        path: &str,
        entries: impl IntoIterator<Item = &'a JournalEntry>,
    ) -> Option<&'a JournalEntry> {
        let file = open_regular(&self.root().join(path), false).ok()?;
        let length = file.metadata().ok()?.len();
        // Lengths are compared first: most changed files differ in it, and those need not be read.
        let mut fitting = entries.into_iter().filter(|e| e.bytes == length).peekable();
        fitting.peek()?;
        let (hash, _) = hash(file).ok()?;
        fitting.find(|e| e.blake3 == hash.to_hex().as_str())
    }

    /// Whether a file has the length of one of these entries of the journal, but the content of none, as after an edit of one
    /// digit. A file of another length is not read.
    fn has_other_content(&self, path: &str, entries: &[JournalEntry]) -> bool {
        let length = open_regular(&self.root().join(path), false).and_then(|file| file.metadata()).map(|m| m.len());
        let is_candidate = length.is_ok_and(|length| entries.iter().any(|e| e.bytes == length));
        is_candidate && self.verified_entry(path, entries).is_none()
    }

    /// Error `Foreign` if a file that osier did not write has this name and `force` is not set.
    fn check_replaceable(&self, state: &mut FolderState, path: &str) -> Result<()> {
        let target = self.root().join(path);
        let found = match fs::symlink_metadata(&target) {
            Ok(found) => found,
            Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(()),
            Err(e) => return Err(Error::io("create", target, e)),
        };
        let replaceable = found.is_file() || found.is_symlink();
        if self.shared.options.force {
            let not_regular = || io::Error::new(io::ErrorKind::InvalidInput, "not a regular file");
            return if replaceable { Ok(()) } else { Err(Error::io("replace", target, not_regular())) };
        }
        // A file is ours by the journal, or, where the journal was lost, by the generator's name in the file itself.
        let is_claimed = replaceable && self.claims(state, path)?;
        // Lengths show most changes; `has_other_content` finds the others, once per file, when it is begun.
        let is_changed = |journal: &Journal| journal.entries(path).all(|e| e.bytes != found.len());
        if is_claimed && found.is_file() && path != MANIFEST && state.journal.as_ref().is_some_and(is_changed) {
            state.replaced_changes.insert(path.to_owned());
        }
        let ours = is_claimed || (found.is_file() && names_osier(&target));
        if ours { Ok(()) } else { Err(Error::Foreign { path: target }) }
    }

    /// True if the journal lists a path; it is read again first, since another process may have added it.
    fn claims(&self, state: &mut FolderState, path: &str) -> Result<bool> {
        let Some(journal) = &mut state.journal else { return Ok(false) };
        if !journal.claims(path) {
            match journal.reload() {
                Err(JournalError::Io(e)) => return Err(Error::io("read", self.root().join(JOURNAL), e)),
                Err(JournalError::Foreign) | Ok(()) => {}
            }
        }
        Ok(journal.claims(path))
    }

    /// Removes the manifest before the first change to the files that it lists.
    fn withdraw_manifest(&self, state: &mut FolderState) -> Result<()> {
        if state.manifest_withdrawn || self.shared.kind_of_folder != FolderKind::Journalled {
            return Ok(());
        }
        self.check_replaceable(state, MANIFEST)?;
        let path = self.root().join(MANIFEST);
        match retry(|| self.disk().remove(&path)) {
            Ok(()) => retry(|| self.disk().sync_dir(self.root())).map_err(|e| Error::io("sync", self.root(), e))?,
            Err(e) if e.kind() == io::ErrorKind::NotFound => {}
            Err(e) => return Err(Error::io("remove", path, e)),
        }
        state.manifest_withdrawn = true;
        Ok(())
    }

    /// Error if a bake under another key has replaced or removed files of this run meanwhile, since both manifests would then
    /// list wrong files. Files that someone else removed are reported when a bake is checked against its manifest.
    fn check_finished(&self) -> Result<()> {
        let mut state = self.state();
        // Read the journal again: another bake adds its lines to the file, and removes those of this bake when it ends.
        let journal = Journal::open(self.disk(), self.root()).ok();
        let is_replaced = |record: &&FileRecord| {
            let entry = self.entry(record);
            let lines: Vec<&JournalEntry> = journal.iter().flat_map(|j| j.entries(&record.path)).collect();
            let is_listed = lines.contains(&&entry);
            match fs::symlink_metadata(self.root().join(&record.path)) {
                Ok(found) if found.len() != record.bytes => true,
                // A file of the same length is read only if the journal has another content of that length.
                Ok(_) => {
                    let is_other = |line: &&JournalEntry| line.bytes == entry.bytes && line.blake3 != entry.blake3;
                    let is_doubtful = !is_listed || lines.iter().any(is_other);
                    is_doubtful && self.verified_entry(&record.path, [&entry]).is_none()
                }
                Err(_) => !is_listed,
            }
        };
        let Some(replaced) = state.finished.values().find(is_replaced).map(|record| record.path.clone()) else {
            return Ok(());
        };
        // The manifest on disk may be that of the other bake: withdraw it as well.
        state.manifest_withdrawn = false;
        self.withdraw_manifest(&mut state)?;
        let why = "another bake into this folder replaced or removed it; run again";
        let why = io::Error::new(io::ErrorKind::ResourceBusy, why);
        Err(Error::io("keep", self.root().join(replaced), why))
    }

    /// Renames a finished part to its name. The journal entry is written first: if the process dies between the two, the file
    /// counts as osier's.
    pub(super) fn publish(&self, record: FileRecord, rename: impl FnOnce(&Path) -> io::Result<()>) -> Result<()> {
        let target = self.root().join(&record.path);
        let mut state = self.state();
        self.check_replaceable(&mut state, &record.path)?;
        let entry = self.entry(&record);
        if let Some(journal) = &mut state.journal
            && !journal.entries(&record.path).any(|e| *e == entry)
        {
            journal.add(&record.path, entry).map_err(|e| Error::io("write", self.root().join(JOURNAL), e))?;
        }
        rename(&target).map_err(|e| Error::io("rename", target, e))?;
        state.finished.insert(record.path.clone(), record);
        Ok(())
    }

    /// Keeps the bytes of a finished file for [`Folder::take`]; there is no journal in memory.
    pub(super) fn publish_bytes(&self, record: FileRecord, bytes: Vec<u8>) {
        let mut state = self.state();
        state.memory.insert(record.path.clone(), bytes);
        state.finished.insert(record.path.clone(), record);
    }

    /// Removes unchanged files of bakes under other keys, then the folders that this leaves empty, and syncs the directory
    /// entries of the rest.
    fn remove_stale_files(&self) -> Result<()> {
        let state = self.state();
        let Some(journal) = &state.journal else { return self.sync_folders(&state) };
        let stale = journal.files().filter(|(path, entries)| {
            path.as_str() != MANIFEST
                && !state.finished.contains_key(*path)
                && entries.iter().all(|e| !self.is_own_key(e))
                && self.is_own_folder(path.rsplit_once('/').map_or("", |(folder, _)| folder))
        });
        for (path, entries) in stale {
            // A file that was changed since osier wrote it belongs to the user.
            if self.verified_entry(path, entries).is_some() {
                let target = self.root().join(path);
                retry(|| self.disk().remove(&target)).map_err(|e| Error::io("remove", target, e))?;
            }
        }
        let used = |folder: &String| state.finished.keys().any(|p| p.starts_with(&format!("{folder}/")));
        // In reverse order a folder comes after those inside it, so that an empty tree disappears whole.
        for folder in journal.folders().iter().rev().filter(|f| !used(f) && self.is_own_folder(f)) {
            // A folder that is not empty is not removed: the call fails, and the error is ignored.
            let _ = self.disk().remove_dir(&self.root().join(folder));
        }
        self.sync_folders(&state)
    }

    /// Syncs the directory entries of all folders of this run; those removed meanwhile are skipped.
    fn sync_folders(&self, state: &FolderState) -> Result<()> {
        for relative in &state.prepared_folders {
            let path = self.root().join(relative);
            match retry(|| self.disk().sync_dir(&path)) {
                Err(e) if e.kind() != io::ErrorKind::NotFound => return Err(Error::io("sync", path, e)),
                _ => {}
            }
        }
        Ok(())
    }
}
