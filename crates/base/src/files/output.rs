//! One file being written.

use std::fs::File;
use std::io::{self, BufWriter, Cursor, Seek, SeekFrom, Write};
use std::sync::Arc;

use super::file_system::{Disk, hash, retry};
use super::folder::{FileRecord, Folder};
use super::part_file::PartFile;
use super::patchable_hash::PatchableHash;
use crate::{Error, Result};

/// Bytes buffered per file: large enough that network file systems see few writes.
const BUFFER: usize = 1 << 20;

/// A file whose writes go through the [`Disk`].
#[derive(Debug)]
struct DiskFile {
    disk: Arc<dyn Disk>,
    file: File,
}

impl Write for DiskFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        retry(|| self.disk.write(&mut self.file, bytes))
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Seek for DiskFile {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.file.seek(to)
    }
}

#[derive(Debug)]
enum OutputSink {
    // The part outlives the writer: fields drop in this order.
    Disk(BufWriter<DiskFile>, PartFile),
    Memory(Cursor<Vec<u8>>),
}

impl Folder {
    /// Starts a file at a relative path with `/`, or gives `None` if the journal proves that it is already finished:
    /// then skip the work. `frame`: number for members of a sequence.
    /// # Errors
    /// X009 for a path that leaves the folder, `Foreign` if a file that osier did not write is in the way, `Io`, `Cancelled`.
    pub fn create(&self, path: &str, kind: &'static str, frame: Option<u32>) -> Result<Option<Output>> {
        let Some(record) = self.begin_file(path, kind, frame)? else { return Ok(None) };
        if self.is_in_memory() {
            return Ok(Some(Output::in_memory(self.clone(), record)));
        }
        Output::on_disk(self.clone(), record).map(Some)
    }

    /// Writes a file from bytes in memory, without a frame number. A file that is already finished is kept; in a plain folder so
    /// is any file with these bytes, whoever wrote it.
    /// # Errors
    /// As [`Folder::create`].
    pub fn write(&self, path: &str, kind: &'static str, bytes: &[u8]) -> Result<()> {
        match self.create(path, kind, None) {
            Ok(Some(mut out)) => {
                out.put(bytes)?;
                out.commit()
            }
            Ok(None) => Ok(()),
            // A text such as a grammar cannot name its maker, so that a file of an earlier run looks foreign; with equal bytes it is kept.
            Err(Error::Foreign { .. }) if self.keep_equal(path, kind, bytes) => Ok(()),
            Err(refused) => Err(refused),
        }
    }
}

/// A file being written; it appears under its name at [`Output::commit`] and leaves nothing behind if dropped before.
#[derive(Debug)]
pub struct Output {
    folder: Folder,
    sink: OutputSink,
    hasher: PatchableHash,
    /// True if bytes were overwritten after they were added to the hash.
    stale: bool,
    record: FileRecord,
}

impl Output {
    pub(super) fn on_disk(folder: Folder, record: FileRecord) -> Result<Self> {
        let target = folder.root().join(&record.path);
        let parent = target.parent().unwrap_or(folder.root());
        let name = record.path.rsplit('/').next().unwrap_or_default();
        let disk = folder.disk();
        // Another process may have removed the folder while it was empty.
        let recreate_folder = |e: io::Error| {
            if e.kind() == io::ErrorKind::NotFound { disk.make_dir(parent) } else { Err(e) }?;
            PartFile::create(disk, parent, name)
        };
        let (part, file) = PartFile::create(disk, parent, name)
            .or_else(recreate_folder)
            .map_err(|e| Error::io("create", &target, e))?;
        let writer = BufWriter::with_capacity(BUFFER, DiskFile { disk: Arc::clone(folder.disk()), file });
        Ok(Self::new(folder, OutputSink::Disk(writer, part), record))
    }

    pub(super) fn in_memory(folder: Folder, record: FileRecord) -> Self {
        Self::new(folder, OutputSink::Memory(Cursor::default()), record)
    }

    fn new(folder: Folder, sink: OutputSink, record: FileRecord) -> Self {
        Self { folder, sink, hasher: PatchableHash::new(), stale: false, record }
    }

    fn failed(&self, action: &'static str) -> impl FnOnce(io::Error) -> Error + use<> {
        let path = self.folder.root().join(&self.record.path);
        move |e| Error::io(action, path, e)
    }

    /// Appends bytes at the end of the file, through a buffer of 1 MiB.
    /// # Errors
    /// `Io` naming the file, `Cancelled`.
    pub fn put(&mut self, bytes: &[u8]) -> Result<()> {
        self.folder.cancel().check()?;
        self.write_all(bytes).map_err(|e| self.failed("write")(e))
    }

    /// Overwrites bytes at an absolute offset; later bytes are appended at the end again. If some lie beyond the first 1024
    /// bytes, [`Output::commit`] reads the whole file again for its hash.
    /// # Errors
    /// `Io` naming the file.
    pub fn put_at(&mut self, offset: u64, bytes: &[u8]) -> Result<()> {
        fn overwrite(sink: &mut (impl Write + Seek), offset: u64, bytes: &[u8]) -> io::Result<()> {
            sink.seek(SeekFrom::Start(offset))?;
            sink.write_all(bytes)?;
            sink.seek(SeekFrom::End(0)).map(drop)
        }
        // The hash can replace bytes of its first chunk only; any other patch makes it stale.
        self.stale |= !self.hasher.overwrite(offset, bytes);
        let end = offset.saturating_add(bytes.len() as u64);
        self.record.bytes = self.record.bytes.max(end);
        match &mut self.sink {
            OutputSink::Disk(w, _) => overwrite(w, offset, bytes),
            OutputSink::Memory(w) => overwrite(w, offset, bytes),
        }
        .map_err(|e| self.failed("write")(e))
    }

    /// Length of the file so far in bytes, with those still buffered: the offset of the next [`Output::put`].
    pub fn position(&self) -> u64 {
        self.record.bytes
    }

    /// Flushes and syncs the file and renames it to its path; it is then one of [`Folder::files`].
    /// # Errors
    /// `Io` naming the file, `Foreign` if something appeared under its name, `Cancelled`; nothing is left behind.
    pub fn commit(self) -> Result<()> {
        self.folder.cancel().check()?;
        let (write, read, sync) = (self.failed("write"), self.failed("read"), self.failed("sync"));
        let Self { folder, sink, hasher, stale, mut record } = self;
        match sink {
            OutputSink::Memory(bytes) => {
                let bytes = bytes.into_inner();
                let digest = if stale { blake3::hash(&bytes) } else { hasher.finalize() };
                record.blake3 = digest.to_hex().to_string();
                folder.publish_bytes(record, bytes);
                Ok(())
            }
            OutputSink::Disk(writer, part) => {
                let DiskFile { disk, mut file } = writer.into_inner().map_err(|e| write(e.into_error()))?;
                let digest = if stale {
                    file.seek(SeekFrom::Start(0)).and_then(|_| hash(&file)).map_err(read)?.0
                } else {
                    hasher.finalize()
                };
                record.blake3 = digest.to_hex().to_string();
                // The bytes are made durable before the rename, so that after a power cut the name never stands for an
                // incomplete file.
                retry(|| disk.sync(&file)).map_err(sync)?;
                drop(file);
                folder.publish(record, |target| part.rename(target))
            }
        }
    }
}

impl Write for Output {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let n = match &mut self.sink {
            OutputSink::Disk(w, _) => w.write(bytes)?,
            OutputSink::Memory(w) => w.write(bytes)?,
        };
        if !self.stale {
            self.hasher.update(bytes.get(..n).unwrap_or_default());
        }
        self.record.bytes += n as u64;
        Ok(n)
    }

    fn flush(&mut self) -> io::Result<()> {
        match &mut self.sink {
            OutputSink::Disk(w, _) => w.flush(),
            OutputSink::Memory(_) => Ok(()),
        }
    }
}
