//! Targets for the bytes of a layer: a separate file, or a member of a package.

use osier_base::Result;
use osier_base::files::Output;

/// An append-only destination of bytes; its beginning can be overwritten, for a header that is known at the end.
pub(crate) trait ByteSink: Send {
    /// Appends bytes at the end, where [`Self::position`] points.
    fn put(&mut self, bytes: &[u8]) -> Result<()>;
    /// Overwrites bytes that were written at `offset`; the next `put` appends at the end as before.
    fn put_at(&mut self, offset: u64, bytes: &[u8]) -> Result<()>;
    /// Number of bytes appended, which is the offset of the next one.
    fn position(&self) -> u64;
    /// Completes the file and gives it its final name.
    fn commit(self: Box<Self>) -> Result<()>;
}

/// Counts bytes and discards them: for a payload that an interrupted bake has left complete, whose extents and bindings the
/// wrapper still needs.
#[derive(Debug, Default)]
pub(crate) struct CountingSink {
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
