//! The chunks of a binary file.

use crate::{Job, Outcome};

const JSON: u32 = 0x4E4F_534A;
const BIN: u32 = 0x004E_4942;

/// The two parts of a glTF file.
#[derive(Debug)]
pub(super) struct Parts<'a> {
    pub(super) json: &'a [u8],
    pub(super) bin: Option<&'a [u8]>,
}

/// Splits a `.glb`; anything that does not begin with its magic is JSON.
/// Source: glTF 2.0 specification, section 4 (GLB file format).
pub(super) fn split<'a>(job: &Job<'_>, bytes: &'a [u8]) -> Outcome<Parts<'a>> {
    if !bytes.starts_with(b"glTF") {
        return Ok(Parts { json: bytes, bin: None });
    }
    let damaged = |why: &str| Box::new(job.fault("X010", format_args!("is damaged: {why}")).help("export it again"));
    let word = |at: usize| bytes.get(at..at + 4).and_then(|b| b.try_into().ok()).map(u32::from_le_bytes);
    if word(4) != Some(2) {
        return Err(job.fault("X010", "is not glTF 2.0; export it as version 2"));
    }
    let length = word(8).ok_or_else(|| damaged("its header is cut off"))? as usize;
    let body = bytes.get(..length).ok_or_else(|| damaged("it is shorter than its header says"))?;
    let mut parts = Parts { json: &[], bin: None };
    let mut at = 12_usize;
    while at < body.len() {
        let chunk = word(at).zip(word(at + 4)).and_then(|(n, kind)| {
            let start = at + 8;
            body.get(start..start.checked_add(n as usize)?).map(|data| (kind, data))
        });
        let (kind, data) = chunk.ok_or_else(|| damaged("a chunk is cut off"))?;
        match kind {
            JSON if at == 12 => parts.json = data,
            BIN if parts.bin.is_none() => parts.bin = Some(data),
            _ => {}
        }
        at += 8 + data.len();
    }
    if parts.json.is_empty() { Err(damaged("its first chunk is not JSON")) } else { Ok(parts) }
}
