//! `.osier`: the list, kept in an output folder, of the files that osier wrote there.
//!
//! One line per file, added before the file takes its name: a line proves a finished file only together with the bytes
//! on disk, and it claims the name even if the process dies in between. Lines stand alone, so that two processes may
//! write into one folder. Malformed lines, such as one torn by a power cut, are skipped.

use std::collections::{BTreeMap, BTreeSet};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::file_system::{Disk, SystemDisk, open_regular, read_limited, retry};
use super::part_file::PartFile;
use super::unique_names::is_plain_path;

/// Name of the journal in its folder.
pub(super) const JOURNAL: &str = ".osier";
const HEADER: &str = "osier journal 1\n";
/// Longest journal that is read, bytes: lines of 150 to 250 bytes for four million files and more.
const LIMIT: u64 = 1 << 30;

/// One line: a file that was finished for a key.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct JournalEntry {
    pub(super) key: String,
    pub(super) blake3: String,
    pub(super) bytes: u64,
}

/// The journal as last read, and what this process added.
#[derive(Debug)]
pub(super) struct Journal {
    disk: Arc<dyn Disk>,
    path: PathBuf,
    text: String,
    files: BTreeMap<String, BTreeSet<JournalEntry>>,
    folders: BTreeSet<String>,
}

/// Why a journal could not be used.
#[derive(Debug)]
pub(super) enum JournalError {
    /// `.osier` is no regular file, lacks the header, or is longer than [`LIMIT`].
    Foreign,
    Io(io::Error),
}

impl Journal {
    /// Reads the journal of a folder; an absent one is empty.
    pub(super) fn open(disk: &Arc<dyn Disk>, folder: &Path) -> Result<Self, JournalError> {
        let mut journal = Self {
            disk: Arc::clone(disk),
            path: folder.join(JOURNAL),
            text: String::new(),
            files: BTreeMap::new(),
            folders: BTreeSet::new(),
        };
        journal.reload()?;
        Ok(journal)
    }

    /// Removes a foreign `.osier` and starts an empty journal; its file is made with the first line.
    pub(super) fn replacing(disk: &Arc<dyn Disk>, folder: &Path) -> io::Result<Self> {
        let path = folder.join(JOURNAL);
        retry(|| disk.remove(&path))?;
        let (files, folders) = (BTreeMap::new(), BTreeSet::new());
        Ok(Self { disk: Arc::clone(disk), path, text: String::new(), files, folders })
    }

    /// Reads the file again and adds the lines that other processes wrote meanwhile.
    pub(super) fn reload(&mut self) -> Result<(), JournalError> {
        let file = match open_regular(&self.path, false) {
            Ok(file) => file,
            Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(()),
            Err(_) if self.path.symlink_metadata().is_ok_and(|m| !m.is_file()) => return Err(JournalError::Foreign),
            Err(e) => return Err(JournalError::Io(e)),
        };
        let bytes = read_limited(file, LIMIT).map_err(JournalError::Io)?.ok_or(JournalError::Foreign)?;
        let text = String::from_utf8_lossy(&bytes).into_owned();
        // A file that is a beginning of the header is a journal whose first write was cut off.
        if !text.starts_with(HEADER) && !HEADER.starts_with(&text) {
            return Err(JournalError::Foreign);
        }
        // A last line without a line end was cut off while it was written, and proves nothing.
        for line in text.split_inclusive('\n').filter_map(|l| l.strip_suffix('\n')) {
            if let Some((path, entry)) = parse(line) {
                self.files.entry(path).or_default().insert(entry);
            } else if let Some(folder) = line.strip_prefix("folder\t").filter(|f| is_plain_path(f)) {
                self.folders.insert(folder.to_owned());
            }
        }
        self.text = text;
        Ok(())
    }

    /// True if the journal has a line for the path, under any key.
    pub(super) fn claims(&self, path: &str) -> bool {
        self.files.contains_key(path)
    }

    /// Journal lines about `path`, one per key it was finished for.
    pub(super) fn entries(&self, path: &str) -> impl Iterator<Item = &JournalEntry> {
        self.files.get(path).into_iter().flatten()
    }

    /// All paths in ascending order, each with its lines for all keys.
    pub(super) fn files(&self) -> impl Iterator<Item = (&String, &BTreeSet<JournalEntry>)> {
        self.files.iter()
    }

    /// Folders that hold or may hold files of osier, relative to the root, each before those inside it.
    pub(super) fn folders(&self) -> BTreeSet<String> {
        let parents =
            |path: &str| -> Vec<String> { path.match_indices('/').map(|(i, _)| path[..i].to_owned()).collect() };
        let mut all: BTreeSet<String> = self.files.keys().flat_map(|p| parents(p)).collect();
        for folder in &self.folders {
            all.extend(parents(folder));
            all.insert(folder.clone());
        }
        all
    }

    /// Appends a line for a file about to be renamed to `path`, which from then on counts as osier's.
    pub(super) fn add(&mut self, path: &str, entry: JournalEntry) -> io::Result<()> {
        self.append(&line(path, &entry))?;
        self.files.entry(path.to_owned()).or_default().insert(entry);
        Ok(())
    }

    /// Appends a line for a folder before anything is made in it, unless it or a file below it has one.
    pub(super) fn add_folder(&mut self, folder: &str) -> io::Result<()> {
        if !folder.is_empty() && !self.folders().contains(folder) {
            self.append(&format!("folder\t{folder}\n"))?;
            self.folders.insert(folder.to_owned());
        }
        Ok(())
    }

    fn append(&mut self, line: &str) -> io::Result<()> {
        // A torn last line is ended, so that it does not run into the new one; a torn header is completed.
        let mut text = match self.text.len() {
            n if n < HEADER.len() => HEADER[n..].to_owned(),
            _ if self.text.ends_with('\n') => String::new(),
            _ => "\n".to_owned(),
        };
        text.push_str(line);
        retry(|| self.disk.append(&self.path, text.as_bytes()))?;
        self.text.push_str(&text);
        Ok(())
    }

    /// Rewrites the journal so that it holds these files in path order and nothing else.
    pub(super) fn rewrite(&mut self, files: BTreeMap<String, JournalEntry>) -> io::Result<()> {
        let text = settled(files.iter());
        // Another process may have appended meanwhile, so the file is compared, not `self.text`.
        let same = open_regular(&self.path, false)
            .and_then(|f| read_limited(f, LIMIT))
            .is_ok_and(|b| b.as_deref() == Some(text.as_bytes()));
        if !same {
            let folder = self.path.parent().unwrap_or(Path::new("."));
            // Like every file, the journal is written beside its name and renamed, so that it is never incomplete.
            let (part, mut file) = PartFile::create(&self.disk, folder, "osier")?;
            let mut rest = text.as_bytes();
            while !rest.is_empty() {
                let n = retry(|| self.disk.write(&mut file, rest))?;
                if n == 0 {
                    return Err(io::ErrorKind::WriteZero.into());
                }
                rest = rest.get(n..).unwrap_or_default();
            }
            retry(|| self.disk.sync(&file))?;
            part.rename(&self.path)?;
        }
        self.text = text;
        self.files = files.into_iter().map(|(p, e)| (p, BTreeSet::from([e]))).collect();
        self.folders.clear();
        Ok(())
    }
}

/// Text of a journal after [`super::Folder::finish`]: the header, then one line per file.
fn settled<'a>(files: impl Iterator<Item = (&'a String, &'a JournalEntry)>) -> String {
    files.fold(HEADER.to_owned(), |text, (path, entry)| text + &line(path, entry))
}

/// False if the journal of a folder is that of a run that ended before [`super::Folder::finish`] (its files may be complete,
/// but those of earlier bakes are not yet removed), or if it has lines of another [`super::WriteOptions::key`] than `key`.
/// True for a folder without a readable journal.
pub fn is_settled(root: &Path, key: &str) -> bool {
    let disk: Arc<dyn Disk> = Arc::new(SystemDisk);
    let Ok(journal) = Journal::open(&disk, root) else { return true };
    let files = journal.files.iter().filter_map(|(path, entries)| Some((path, entries.first()?)));
    let key = key_digest(key);
    let is_own = |e: &JournalEntry| e.key == key;
    journal.text.is_empty() || (journal.text == settled(files) && journal.files.values().flatten().all(is_own))
}

/// Whether a folder has a file that a run with this [`super::WriteOptions::key`] finished, which a later run with the same key keeps.
pub fn has_finished_files(root: &Path, key: &str) -> bool {
    let disk: Arc<dyn Disk> = Arc::new(SystemDisk);
    let Ok(journal) = Journal::open(&disk, root) else { return false };
    let key = key_digest(key);
    let is_there = |path: &String| std::fs::symlink_metadata(root.join(path)).is_ok_and(|found| found.is_file());
    journal.files().any(|(path, entries)| entries.iter().any(|e| e.key == key) && is_there(path))
}

/// The form of a key in a journal: the first 32 hex digits of its BLAKE3.
pub(super) fn key_digest(key: &str) -> String {
    blake3::hash(key.as_bytes()).to_hex().chars().take(32).collect()
}

fn line(path: &str, e: &JournalEntry) -> String {
    format!("file\t{}\t{}\t{}\t{path}\n", e.key, e.blake3, e.bytes)
}

fn parse(line: &str) -> Option<(String, JournalEntry)> {
    let mut fields = line.splitn(5, '\t');
    let hex = |s: &str, n: usize| s.len() == n && s.bytes().all(|b| b.is_ascii_hexdigit());
    fields.next().filter(|w| *w == "file")?;
    let key = fields.next().filter(|k| hex(k, 32))?.to_owned();
    let blake3 = fields.next().filter(|h| hex(h, 64))?.to_owned();
    let bytes = fields.next()?.parse().ok()?;
    // The folder may come from an untrusted source: a line must not lead out of it.
    let path = fields.next().filter(|p| is_plain_path(p))?.to_owned();
    Some((path, JournalEntry { key, blake3, bytes }))
}

#[cfg(test)]
#[allow(clippy::disallowed_methods, reason = "tests look at the disk themselves")]
mod tests {
    use super::*;

    fn entry(n: u64) -> JournalEntry {
        JournalEntry { key: key_digest("mine"), blake3: "a".repeat(64), bytes: n }
    }

    #[test]
    fn a_run_goes_on_from_files_of_its_own_key_that_are_there() {
        let dir = tempfile::tempdir().expect("dir");
        let disk: Arc<dyn Disk> = Arc::new(SystemDisk);
        assert!(!has_finished_files(dir.path(), "mine"), "no journal");
        // The line of a file precedes the file.
        Journal::open(&disk, dir.path()).expect("open").add("a", entry(1)).expect("add");
        assert!(!has_finished_files(dir.path(), "mine"), "no file");
        std::fs::write(dir.path().join("a"), "x").expect("write");
        assert!(has_finished_files(dir.path(), "mine") && !has_finished_files(dir.path(), "of another scene"));
    }

    #[test]
    fn torn_and_hostile_lines_are_skipped_and_the_rest_is_read_back() {
        let dir = tempfile::tempdir().expect("dir");
        let disk: Arc<dyn Disk> = Arc::new(SystemDisk);
        let path = dir.path().join(JOURNAL);
        let good = line("usd/a.usdc", &entry(5));
        for cut in 0..HEADER.len() {
            std::fs::write(&path, &HEADER[..cut]).expect("write");
            let mut j = Journal::open(&disk, dir.path()).expect("a torn header is ours");
            j.add("b", entry(1)).expect("add");
            assert!(Journal::open(&disk, dir.path()).expect("open").claims("b"));
        }
        let evil = line("../../etc/passwd", &entry(1)) + &line("/etc/passwd", &entry(1)) + "file\tx\n\0\0\n";
        std::fs::write(&path, format!("{HEADER}{evil}{good}file\tabc")).expect("write");
        let mut j = Journal::open(&disk, dir.path()).expect("open");
        assert!(j.files().count() == 1 && !is_settled(dir.path(), "mine"));
        j.add("c", entry(2)).expect("add");
        let again = Journal::open(&disk, dir.path()).expect("open");
        assert!(again.claims("c") && again.claims("usd/a.usdc") && again.files().count() == 2);
        let files = ["usd/a.usdc", "b"].map(|path| (path.to_owned(), entry(5)));
        j.rewrite(BTreeMap::from(files)).expect("rewrite");
        assert!(is_settled(dir.path(), "mine") && !is_settled(dir.path(), "of another program"));
        j.add("a", entry(1)).expect("add");
        assert!(!is_settled(dir.path(), "mine"), "b stands before a");
        std::fs::write(&path, "my own notes").expect("write");
        assert!(matches!(Journal::open(&disk, dir.path()), Err(JournalError::Foreign)));
    }
}
