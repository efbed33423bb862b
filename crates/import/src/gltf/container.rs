//! Chunks of a binary glTF file (`.glb`).

use crate::{ImportContext, ImportResult};

/// Chunk types: the ASCII words `JSON` and `BIN` in little-endian order.
const JSON: u32 = 0x4E4F_534A;
const BIN: u32 = 0x004E_4942;

/// The chunks of a glTF file: its JSON, and the binary data of a `.glb`.
#[derive(Debug)]
pub(super) struct GlbChunks<'a> {
    pub(super) json: &'a [u8],
    pub(super) bin: Option<&'a [u8]>,
}

/// Splits a `.glb`; anything that does not begin with its magic is JSON.
/// Source: glTF 2.0 specification, section 4 (GLB file format).
pub(super) fn split<'a>(context: &ImportContext<'_>, bytes: &'a [u8]) -> ImportResult<GlbChunks<'a>> {
    if !bytes.starts_with(b"glTF") {
        return Ok(GlbChunks { json: bytes, bin: None });
    }
    let damaged = |why: &str| {
        Box::new(context.error_about_file("X010", format_args!("is damaged: {why}")).help("export it again"))
    };
    let word = |at: usize| bytes.get(at..at + 4).and_then(|b| b.try_into().ok()).map(u32::from_le_bytes);
    // Header of 12 bytes: magic, version, length of the whole file, each a little-endian word.
    if word(4) != Some(2) {
        return Err(context.error_about_file("X010", "is not glTF 2.0; export it as version 2"));
    }
    let length = word(8).ok_or_else(|| damaged("its header is cut off"))? as usize;
    let body = bytes.get(..length).ok_or_else(|| damaged("it is shorter than its header says"))?;
    let mut chunks = GlbChunks { json: &[], bin: None };
    let mut at = 12_usize;
    while at < body.len() {
        // Each chunk: length of its data, type, data.
        let chunk = word(at).zip(word(at + 4)).and_then(|(n, kind)| {
            let start = at + 8;
            body.get(start..start.checked_add(n as usize)?).map(|data| (kind, data))
        });
        let (kind, data) = chunk.ok_or_else(|| damaged("a chunk is cut off"))?;
        // The first chunk must be JSON, and one binary chunk may follow; a reader ignores chunks of other types.
        match kind {
            JSON if at == 12 => chunks.json = data,
            BIN if chunks.bin.is_none() => chunks.bin = Some(data),
            _ => {}
        }
        at += 8 + data.len();
    }
    if chunks.json.is_empty() { Err(damaged("its first chunk is not JSON")) } else { Ok(chunks) }
}
