//! Where the bytes of a layer go: a file of its own, or a member of a package.

use osier_base::Result;
use osier_base::files::Output;

/// A growing run of bytes with a head that can be rewritten.
pub(super) trait ByteSink: Send {
    /// Appends bytes.
    fn put(&mut self, bytes: &[u8]) -> Result<()>;
    /// Overwrites bytes at an offset; appending goes on at the end.
    fn put_at(&mut self, offset: u64, bytes: &[u8]) -> Result<()>;
    /// Bytes so far.
    fn position(&self) -> u64;
    /// Closes the file.
    fn commit(self: Box<Self>) -> Result<()>;
}

/// Counts bytes and keeps none: for a layer that is on disk already, of which others still need to know what it holds.
#[derive(Debug, Default)]
pub(super) struct CountingSink {
    position: u64,
}

impl ByteSink for CountingSink {
    fn put(&mut self, bytes: &[u8]) -> Result<()> {
        self.position += bytes.len() as u64;
        Ok(())
    }

    fn put_at(&mut self, _offset: u64, _bytes: &[u8]) -> Result<()> {
        Ok(())
    }

    fn position(&self) -> u64 {
        self.position
    }

    fn commit(self: Box<Self>) -> Result<()> {
        Ok(())
    }
}

impl ByteSink for Output {
    fn put(&mut self, bytes: &[u8]) -> Result<()> {
        Self::put(self, bytes)
    }

    fn put_at(&mut self, offset: u64, bytes: &[u8]) -> Result<()> {
        Self::put_at(self, offset, bytes)
    }

    fn position(&self) -> u64 {
        Self::position(self)
    }

    fn commit(self: Box<Self>) -> Result<()> {
        Self::commit(*self)
    }
}
