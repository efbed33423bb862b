//! Buffers: the binary chunk, `data:` URIs, files beside the document, compressed views.

use std::borrow::Cow;
use std::collections::BTreeMap;

use meshoptimizer_rs::codec::{BufferView, Filter, Mode};
use meshoptimizer_rs::{Limits, Workspace};

use super::document::{CompressedView, GltfDocument};
use crate::{ImportContext, ImportResult};

/// The bytes of all buffers, each at least as long as it declares.
#[derive(Debug)]
pub(super) struct Buffers<'a> {
    list: Vec<Cow<'a, [u8]>>,
    /// Decompressed bytes, by index of the buffer view.
    decoded: BTreeMap<usize, Vec<u8>>,
}

impl<'a> Buffers<'a> {
    /// Loads every buffer; all together stay within the limit for mesh bytes.
    /// # Errors
    /// X009 or X010.
    pub(super) fn load(
        context: &mut ImportContext<'_>,
        document: &GltfDocument,
        bin: Option<&'a [u8]>,
    ) -> ImportResult<Self> {
        let root = &document.root;
        // A buffer that only compressed views refer to needs no bytes: they are decoded from another one.
        let (mut compressed, mut plain) = (vec![false; root.buffers.len()], vec![false; root.buffers.len()]);
        for (i, view) in root.buffer_views.iter().enumerate() {
            let list = if document.compressed_views.contains_key(&i) { &mut compressed } else { &mut plain };
            list.get_mut(view.buffer.value()).into_iter().for_each(|used| *used = true);
        }
        let is_fallback = |i: usize| compressed[i] && !plain[i];
        let mut list = Vec::with_capacity(root.buffers.len());
        let mut left = context.options.limits.get("mesh-bytes");
        for (i, buffer) in root.buffers.iter().enumerate() {
            let bytes = match (&buffer.uri, bin) {
                (Some(uri), _) => Cow::Owned(resource(context, &format!("buffers[{i}]"), uri, left)?),
                // Only the first buffer may omit its uri: it is then the binary chunk of the file.
                (None, Some(bin)) if i == 0 => Cow::Borrowed(bin),
                (None, _) if is_fallback(i) => {
                    list.push(Cow::Owned(Vec::new()));
                    continue;
                }
                (None, _) => return Err(context.error_in_file("X010", format_args!("buffers[{i}] has no bytes"))),
            };
            // More bytes than declared are allowed, since a binary chunk is padded to a multiple of four.
            if (bytes.len() as u64) < buffer.byte_length.0 {
                let (has, wants) = (bytes.len(), buffer.byte_length.0);
                let message = format_args!("buffers[{i}] holds {has} bytes where {wants} are declared");
                return Err(Box::new(
                    context.error_in_file("X010", message).help("export the file again, with its .bin"),
                ));
            }
            left = left.saturating_sub(bytes.len() as u64);
            list.push(bytes);
        }
        let mut decoded = BTreeMap::new();
        for (index, compressed) in &document.compressed_views {
            let bytes = decode_view(&list, compressed, left).map_err(|what| {
                let message = format_args!("bufferViews[{index}]: EXT_meshopt_compression: {what}");
                Box::new(context.error_in_file("X010", message).help("export the file again, without compression"))
            })?;
            left = left.saturating_sub(bytes.len() as u64);
            decoded.insert(*index, bytes);
        }
        Ok(Self { list, decoded })
    }

    /// Bytes of a view by its index; `None` if there is none, or if it passes the end of its buffer.
    pub(super) fn view(&self, document: &GltfDocument, index: usize) -> Option<&[u8]> {
        if let Some(bytes) = self.decoded.get(&index) {
            return Some(bytes);
        }
        let view = document.root.buffer_views.get(index)?;
        let start = view.byte_offset.map_or(0, |o| o.0);
        let end = start.checked_add(view.byte_length.0)?;
        let declared = self.list.get(view.buffer.value())?;
        declared.get(usize::try_from(start).ok()?..usize::try_from(end).ok()?)
    }
}

/// The bytes of a compressed view, at most `left`; the error describes the defect of the view.
fn decode_view(list: &[Cow<'_, [u8]>], view: &CompressedView, left: u64) -> Result<Vec<u8>, String> {
    let source = list.get(view.buffer).and_then(|b| b.get(view.offset..view.offset.checked_add(view.length)?));
    let source = source.ok_or("it passes the end of its buffer")?;
    let plain = |e: meshoptimizer_rs::Error| e.to_string();
    let (mode, filter) = (Mode::parse(&view.mode).map_err(plain)?, Filter::parse(&view.filter).map_err(plain)?);
    let layout = BufferView::new(mode, filter, view.count, view.stride).map_err(plain)?;
    // Check before decoding, so that a short file does not become a large buffer.
    if layout.byte_length() as u64 > left {
        return Err("all buffers together pass --max-mesh-bytes".into());
    }
    layout.decode(source, &mut Workspace::new(Limits::default())).map_err(plain)
}

/// Bytes that a uri stands for, at most `limit`.
/// # Errors
/// X009 or X010.
pub(super) fn resource(context: &mut ImportContext<'_>, place: &str, uri: &str, limit: u64) -> ImportResult<Vec<u8>> {
    if let Some(data) = uri.strip_prefix("data:") {
        let bytes = data.split_once(',').filter(|(kind, _)| kind.ends_with(";base64")).and_then(|(_, b)| base64(b));
        let bytes =
            bytes.ok_or_else(|| context.error_in_file("X010", format_args!("{place}: its data: URI is not base64")))?;
        return if bytes.len() as u64 <= limit {
            Ok(bytes)
        } else {
            Err(context.error_in_file("X010", format_args!("{place}: all buffers together pass --max-mesh-bytes")))
        };
    }
    match context.options.roots.read_uri(context.path, uri, limit) {
        Ok(referred) => {
            context.add_referenced_file(&referred);
            Ok(referred.bytes)
        }
        Err(refusal) => Err(Box::new(
            context.error_in_file(refusal.code(), format_args!("{place}: {refusal}")).help(refusal.help()),
        )),
    }
}

/// Standard base64 with or without padding; `None` for anything else.
fn base64(text: &str) -> Option<Vec<u8>> {
    let digits = text.trim_end_matches('=');
    // At most two signs of padding, and a single digit over a multiple of four holds no byte.
    if text.len() - digits.len() > 2 || digits.len() % 4 == 1 {
        return None;
    }
    let mut bytes = Vec::with_capacity(digits.len() / 4 * 3 + 2);
    let (mut bits, mut held) = (0_u32, 0_u32);
    for c in digits.bytes() {
        let value = match c {
            b'A'..=b'Z' => c - b'A',
            b'a'..=b'z' => c - b'a' + 26,
            b'0'..=b'9' => c - b'0' + 52,
            b'+' => 62,
            b'/' => 63,
            _ => return None,
        };
        bits = (bits << 6) | u32::from(value);
        // Six bits per digit; a byte is complete once eight are held.
        held += 6;
        if held >= 8 {
            held -= 8;
            bytes.extend((bits >> held).to_le_bytes().first());
            bits &= (1 << held) - 1;
        }
    }
    Some(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_is_strict() {
        assert_eq!(base64("Zm9vYmE=").as_deref(), Some(&b"fooba"[..]));
        assert_eq!(base64("Zm9vYg").as_deref(), Some(&b"foob"[..]));
        assert_eq!(base64("+/8=").as_deref(), Some(&[0xfb, 0xff][..]));
        assert_eq!(base64("").as_deref(), Some(&[][..]));
        for bad in ["A", "Zm9v YmE=", "Zm9v====", "Zm-_", "=Zm9v"] {
            assert_eq!(base64(bad), None, "{bad}");
        }
    }
}
