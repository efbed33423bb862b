//! Where the bytes of a layer go: a file of its own, or a member of a package.

use crate::Result;
use crate::fence::Output;

/// A growing run of bytes with a head that can be rewritten.
pub(super) trait Sink: Send {
    /// Appends bytes.
    fn put(&mut self, bytes: &[u8]) -> Result<()>;
    /// Overwrites bytes at an offset; appending goes on at the end.
    fn put_at(&mut self, offset: u64, bytes: &[u8]) -> Result<()>;
    /// Bytes so far.
    fn position(&self) -> u64;
    /// Closes the file.
    fn commit(self: Box<Self>) -> Result<()>;
}

impl Sink for Output {
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
