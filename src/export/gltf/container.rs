//! The two containers: one binary file, or JSON with a binary file beside it.

use super::document::Document;
use super::json;
use super::text::to_json;
use crate::{Error, Result};

const MAGIC: u32 = 0x4654_6C67;
const VERSION: u32 = 2;
const JSON: u32 = 0x4E4F_534A;
const BIN: u32 = 0x004E_4942;

/// Hands a finished document out as a .glb, piece by piece.
/// # Errors
/// X005 for more than 2^32 - 1 bytes, X001 for a number that is not finite, whatever `put` returns.
pub(super) fn glb(mut document: Document<'_>, mut put: impl FnMut(&[u8]) -> Result<()>) -> Result<()> {
    let mut bin = std::mem::take(&mut document.buffer.bytes);
    if !bin.is_empty() {
        document.root.buffers.push(json::Buffer { uri: None, byte_length: bin.len() });
    }
    let mut text = to_json(&document.root)?;
    text.resize(text.len().next_multiple_of(4), b' ');
    bin.resize(bin.len().next_multiple_of(4), 0);
    let total = 12 + 8 + text.len() + if bin.is_empty() { 0 } else { 8 + bin.len() };
    let total = u32::try_from(total).map_err(|_| too_large(total))?;
    for word in [MAGIC, VERSION, total, length(&text)?, JSON] {
        put(&word.to_le_bytes())?;
    }
    put(&text)?;
    if !bin.is_empty() {
        put(&length(&bin)?.to_le_bytes())?;
        put(&BIN.to_le_bytes())?;
        put(&bin)?;
    }
    Ok(())
}

/// JSON text and binary part of a .gltf whose buffer is found at `uri`.
/// # Errors
/// X005 for more than 2^32 - 1 bytes, X001 for a number that is not finite.
pub(super) fn gltf(mut document: Document<'_>, uri: String) -> Result<(Vec<u8>, Vec<u8>)> {
    let bin = std::mem::take(&mut document.buffer.bytes);
    length(&bin)?;
    if !bin.is_empty() {
        document.root.buffers.push(json::Buffer { uri: Some(uri), byte_length: bin.len() });
    }
    Ok((to_json(&document.root)?, bin))
}

fn length(bytes: &[u8]) -> Result<u32> {
    u32::try_from(bytes.len()).map_err(|_| too_large(bytes.len()))
}

fn too_large(bytes: usize) -> Error {
    let reason =
        format!("glTF file of {bytes} bytes, the format ends at {}; place fewer assets or write usd", u32::MAX);
    Error::export("X005", reason)
}
