//! The two containers: binary glTF (`.glb`), or JSON (`.gltf`) with a binary file beside it.

use super::buffer::too_large;
use super::document::GltfDocument;
use super::json;
use super::meshopt;
use super::text::to_json;
use osier_base::Result;

/// First word of a .glb: the characters `glTF` in ASCII, read as a little-endian number.
const MAGIC: u32 = 0x4654_6C67;
const VERSION: u32 = 2;
/// Type of the JSON chunk: `JSON` in ASCII.
const JSON: u32 = 0x4E4F_534A;
/// Type of the binary chunk: `BIN` in ASCII and a zero.
const BIN: u32 = 0x004E_4942;

/// Writes a finished document as a .glb through `put` (glTF 2.0, section 4.4): magic, version and length of the file; the JSON
/// chunk (length, type, text padded with spaces); the binary chunk (length, type, buffer padded with zeros).
/// # Errors
/// X005 for more than 2^32 - 1 bytes, X001 for a number that is not finite, whatever `put` returns.
pub(super) fn write_glb(mut document: GltfDocument<'_>, mut put: impl FnMut(&[u8]) -> Result<()>) -> Result<()> {
    let mut bin = take_buffer(&mut document, None)?;
    let mut text = to_json(&document.root)?;
    // Chunks begin and end at multiples of four bytes; JSON admits trailing spaces, the buffer trailing zeros (section 4.4.3).
    text.resize(text.len().next_multiple_of(4), b' ');
    bin.resize(bin.len().next_multiple_of(4), 0);
    let total = file_length(text.len(), bin.len())?;
    // The 12 bytes of the file's header, then length and type of the first chunk, all little-endian u32 (section 4.4.2).
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

/// JSON text and buffer of a .gltf whose buffer is the file at `uri`.
/// # Errors
/// X005 for more than 2^32 - 1 bytes, X001 for a number that is not finite.
pub(super) fn encode_gltf(mut document: GltfDocument<'_>, uri: String) -> Result<(Vec<u8>, Vec<u8>)> {
    let mut bin = take_buffer(&mut document, Some(uri))?;
    if let Some(buffer) = document.root.buffers.first_mut().filter(|_| !bin.is_empty()) {
        // The mark by which a later run recognises the file as its own follows behind all data that the document refers
        // to.
        bin.extend_from_slice(crate::GENERATOR.as_bytes());
        buffer.byte_length = bin.len();
    }
    length(&bin)?;
    Ok((to_json(&document.root)?, bin))
}

/// Takes the bytes out of a finished document, compressed if its options say so, and lists them among its buffers. `uri`:
/// path of a separate binary file.
fn take_buffer(document: &mut GltfDocument<'_>, uri: Option<String>) -> Result<Vec<u8>> {
    let fallback = if document.buffer.compressed {
        meshopt::compress(&mut document.buffer, &mut document.root.buffer_views)?
    } else {
        None
    };
    let bin = std::mem::take(&mut document.buffer.bytes);
    if !bin.is_empty() {
        document.root.buffers.push(json::Buffer { uri, byte_length: bin.len(), extensions: None });
    }
    document.root.buffers.extend(fallback);
    Ok(bin)
}

fn length(bytes: &[u8]) -> Result<u32> {
    u32::try_from(bytes.len()).map_err(|_| too_large(bytes.len()))
}

/// Length of a .glb whose chunks hold `text` and `bin` bytes, both padded: a header of 12 bytes, and 8 for each chunk.
fn file_length(text: usize, bin: usize) -> Result<u32> {
    let bytes = 12 + 8 + text + if bin == 0 { 0 } else { 8 + bin };
    u32::try_from(bytes).map_err(|_| too_large(bytes))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_end_at_four_gibibytes() {
        let most = 0xFFFF_FFFC - 28 - 100;
        assert_eq!(file_length(100, most).expect("fits"), 0xFFFF_FFFC);
        assert!(matches!(file_length(104, most), Err(osier_base::Error::Export { code: "X005", .. })));
        assert_eq!(file_length(100, 0).expect("no buffer"), 120);
    }
}
