//! The values of a crate file: appended as they arrive, equal ones stored once.
//!
//! A value is referred to by a 64-bit `ValueRep`: bit 63 array, bit 62 inlined, bit 61 compressed, bits 48 to 55 the type code,
//! and in the low 48 bits the file offset of the value, or the value itself if inlined. Source: `pxr/usd/sdf/crateFile.h`.

use std::collections::BTreeSet;

use super::integer_coding;
use crate::usd::byte_sink::ByteSink;
use crate::usd::value::{UsdArray, UsdValue, push_finite_f16, push_finite_f32, push_finite_f64};
use osier_base::convert::narrow;
use osier_base::par::LookupMap;
use osier_base::{Error, Result};

/// `CrateFile::TypeEnum`: codes of value types.
pub(super) mod type_code {
    pub const BOOL: u8 = 1;
    pub const INT: u8 = 3;
    pub const INT64: u8 = 5;
    pub const FLOAT: u8 = 8;
    pub const DOUBLE: u8 = 9;
    pub const STRING: u8 = 10;
    pub const TOKEN: u8 = 11;
    pub const ASSET_PATH: u8 = 12;
    pub const MATRIX4D: u8 = 15;
    pub const QUATF: u8 = 17;
    pub const QUATH: u8 = 18;
    pub const VEC2F: u8 = 20;
    pub const VEC3D: u8 = 23;
    pub const VEC3F: u8 = 24;
    pub const VEC3H: u8 = 25;
    pub const VEC4F: u8 = 28;
    pub const DICTIONARY: u8 = 31;
    pub const TOKEN_LIST_OP: u8 = 32;
    pub const STRING_LIST_OP: u8 = 33;
    pub const PATH_LIST_OP: u8 = 34;
    pub const REFERENCE_LIST_OP: u8 = 35;
    pub const TOKEN_VECTOR: u8 = 41;
    pub const SPECIFIER: u8 = 42;
    pub const VARIABILITY: u8 = 44;
    pub const VARIANT_SELECTION_MAP: u8 = 45;
    pub const TIME_SAMPLES: u8 = 46;
    pub const DOUBLE_VECTOR: u8 = 48;
    pub const PAYLOAD_LIST_OP: u8 = 55;
}

const IS_ARRAY: u64 = 1 << 63;
const IS_INLINED: u64 = 1 << 62;
const IS_COMPRESSED: u64 = 1 << 61;
/// Arrays of integers and floats shorter than this are not compressed; readers expect the same threshold
/// (`MinCompressedArraySize`).
const MIN_COMPRESSED: usize = 16;

/// A `ValueRep` that holds the value itself: a number of at most 32 bits, or the row of a token or string.
pub(super) fn inline_value_rep(code: u8, bits: u32) -> u64 {
    IS_INLINED | u64::from(code) << 48 | u64::from(bits)
}

/// Appends values to the file and returns their `ValueRep`s.
pub(super) struct ValueHeap {
    pub(super) sink: Box<dyn ByteSink>,
    /// `ValueRep` of each value written so far, by type code (top bit: array) and BLAKE3 hash of its bytes. Two values of
    /// equal hash are taken as equal: a collision of 256 bits does not happen.
    known: LookupMap<(u8, [u8; 32]), u64>,
    scratch: Vec<u8>,
}

impl ValueHeap {
    pub(super) fn new(sink: Box<dyn ByteSink>) -> Self {
        Self { sink, known: LookupMap::default(), scratch: Vec::new() }
    }

    /// Pads the file with zeros to a multiple of 8 bytes, so that readers can map arrays of doubles in place. Returns the offset.
    fn align(&mut self) -> Result<u64> {
        let past_boundary = (self.sink.position() % 8) as usize;
        if past_boundary != 0 {
            self.sink.put(&[0; 8][past_boundary..])?;
        }
        Ok(self.sink.position())
    }

    /// `ValueRep` of a single value of type `code` with this encoding; appended unless an equal one is in the file.
    pub(super) fn store_scalar(&mut self, code: u8, bytes: &[u8]) -> Result<u64> {
        self.deduplicated_value_rep(code, u64::from(code) << 48, bytes, |heap| heap.sink.put(bytes))
    }

    /// `ValueRep` of a value: that of an equal value in the file if there is one, else that of the bytes that `write`
    /// appends.
    /// `kind`: distinguishes values with equal bytes and different types; `flags`: the `ValueRep` without its offset;
    /// `bytes`: the uncompressed encoding, for the comparison.
    fn deduplicated_value_rep(
        &mut self,
        kind: u8,
        flags: u64,
        bytes: &[u8],
        write: impl FnOnce(&mut Self) -> Result<()>,
    ) -> Result<u64> {
        // The key holds the hash, not the bytes, so that an entry's size does not grow with the array.
        let key = (kind, *blake3::hash(bytes).as_bytes());
        if let Some(found) = self.known.get(&key) {
            return Ok(*found);
        }
        let reference = flags | self.align()?;
        write(self)?;
        self.known.insert(key, reference);
        Ok(reference)
    }

    /// `ValueRep` of an array. `tokens`: token rows, if the elements are tokens. `place`: names the attribute in errors.
    pub(super) fn array_value_rep(
        &mut self,
        array: &UsdArray,
        tokens: &[u32],
        place: &dyn Fn() -> String,
    ) -> Result<u64> {
        let code = array_type_code(array);
        let flags = IS_ARRAY | u64::from(code) << 48;
        // An empty array has no bytes in the file; its offset is 0.
        if array.is_empty() {
            return Ok(flags);
        }
        // The buffer is reused from array to array, so that a frame of large arrays allocates once.
        let mut bytes = std::mem::take(&mut self.scratch);
        bytes.clear();
        push_elements_le(array, tokens, &mut bytes).map_err(|i| not_finite(&place(), i))?;
        let count = (array.len() as u64).to_le_bytes();
        // The top bit of the kind distinguishes arrays from single values.
        let kind = code | 0x80;
        // Layout of an array: number of elements (64 bits), then the elements; of a compressed one: number of elements, length
        // of the compressed data, the data.
        let put_compressed = |heap: &mut Self, data: Vec<u8>| {
            heap.sink.put(&count)?;
            heap.sink.put(&(data.len() as u64).to_le_bytes())?;
            heap.sink.put(&data)
        };
        let table = match array {
            UsdArray::Float(v) if v.len() >= MIN_COMPRESSED => distinct_values_and_rows(v),
            _ => None,
        };
        let value_rep = match array {
            UsdArray::Int(v) if v.len() >= MIN_COMPRESSED => {
                self.deduplicated_value_rep(kind, flags | IS_COMPRESSED, &bytes, |heap| {
                    put_compressed(heap, integer_coding::compress_i32(v))
                })
            }
            UsdArray::Int64(v) if v.len() >= MIN_COMPRESSED => {
                self.deduplicated_value_rep(kind, flags | IS_COMPRESSED, &bytes, |heap| {
                    put_compressed(heap, integer_coding::compress_i64(v))
                })
            }
            // Floats with few different values: code `t`, the table of values (its length, then the values), the rows of the
            // table as compressed integers.
            UsdArray::Float(_) if table.is_some() => {
                let (table, rows) = table.unwrap_or_default();
                self.deduplicated_value_rep(kind, flags | IS_COMPRESSED, &bytes, |heap| {
                    let data = integer_coding::compress_i32(&rows);
                    heap.sink.put(&count)?;
                    heap.sink.put(b"t")?;
                    heap.sink.put(&narrow::<u32, usize>(table.len(), "values of an array")?.to_le_bytes())?;
                    heap.sink.put(bytemuck::cast_slice(&table))?;
                    heap.sink.put(&(data.len() as u64).to_le_bytes())?;
                    heap.sink.put(&data)
                })
            }
            _ => self.deduplicated_value_rep(kind, flags, &bytes, |heap| {
                heap.sink.put(&count)?;
                heap.sink.put(&bytes)
            }),
        };
        self.scratch = bytes;
        value_rep
    }

    /// `ValueRep` of a single value. `index`: the row of a token or asset path in TOKENS, or of a string in STRINGS.
    pub(super) fn scalar_value_rep(&mut self, value: &UsdValue, index: u32, place: &dyn Fn() -> String) -> Result<u64> {
        let mut bytes = Vec::new();
        let bad = |i| not_finite(&place(), i);
        let code = match value {
            // Values of at most 32 bits are inlined.
            UsdValue::Bool(b) => return Ok(inline_value_rep(type_code::BOOL, u32::from(*b))),
            // x + 0.0 turns -0 into 0, so that equal numbers are written alike.
            UsdValue::Float(x) if x.is_finite() => return Ok(inline_value_rep(type_code::FLOAT, (x + 0.0).to_bits())),
            UsdValue::Float(_) => return Err(bad(0)),
            UsdValue::String(_) => return Ok(inline_value_rep(type_code::STRING, index)),
            UsdValue::Token(_) => return Ok(inline_value_rep(type_code::TOKEN, index)),
            UsdValue::Asset(_) => return Ok(inline_value_rep(type_code::ASSET_PATH, index)),
            UsdValue::Double(x) => push_finite_f64(&[*x], &mut bytes).map(|()| type_code::DOUBLE),
            UsdValue::Float2(v) => push_finite_f32(v, &mut bytes).map(|()| type_code::VEC2F),
            UsdValue::Float3(v) => push_finite_f32(v, &mut bytes).map(|()| type_code::VEC3F),
            UsdValue::Float4(v) => push_finite_f32(v, &mut bytes).map(|()| type_code::VEC4F),
            UsdValue::Double3(v) => push_finite_f64(v, &mut bytes).map(|()| type_code::VEC3D),
            UsdValue::Quatf(v) => push_finite_f32(v, &mut bytes).map(|()| type_code::QUATF),
            UsdValue::Matrix4d(v) => push_finite_f64(v, &mut bytes).map(|()| type_code::MATRIX4D),
            UsdValue::Array(array) => return self.array_value_rep(array, &[], place),
        }
        .map_err(bad)?;
        self.store_scalar(code, &bytes)
    }
}

/// The different values of an array in ascending order of their bits, as little-endian words, and for each element its row in
/// that table; `None` if there are too many: OpenUSD uses a table of at most a quarter of the elements and at most 1024 values.
fn distinct_values_and_rows(values: &[f32]) -> Option<(Vec<u32>, Vec<i32>)> {
    const MAX_TABLE: usize = 1024;
    let most = MAX_TABLE.min(values.len() / 4);
    // The order of the bits of floats is ascending for positive numbers; any fixed order serves. -0 is stored as 0.
    let bits = |x: &f32| (x + 0.0).to_bits();
    let mut table: BTreeSet<u32> = BTreeSet::new();
    for x in values {
        table.insert(bits(x));
        if table.len() > most {
            return None;
        }
    }
    let table: Vec<u32> = table.into_iter().collect();
    let row = |x: &f32| table.binary_search(&bits(x)).ok().and_then(|row| i32::try_from(row).ok());
    let rows = values.iter().map(row).collect::<Option<Vec<i32>>>()?;
    Some((table.into_iter().map(u32::to_le).collect(), rows))
}

fn not_finite(place: &str, i: usize) -> Error {
    Error::export("X001", format!("{place}: number {i} is not finite"))
}

fn array_type_code(array: &UsdArray) -> u8 {
    match array {
        UsdArray::Int(_) => type_code::INT,
        UsdArray::Int64(_) => type_code::INT64,
        UsdArray::Float(_) => type_code::FLOAT,
        UsdArray::Float2(_) => type_code::VEC2F,
        UsdArray::Float3(_) => type_code::VEC3F,
        UsdArray::Float4(_) => type_code::VEC4F,
        UsdArray::Half3(_) => type_code::VEC3H,
        UsdArray::Quatf(_) => type_code::QUATF,
        UsdArray::Quath(_) => type_code::QUATH,
        UsdArray::Matrix4d(_) => type_code::MATRIX4D,
        UsdArray::Token(_) => type_code::TOKEN,
    }
}

/// Appends the elements, little endian. Errs with the position of the first number that is not finite.
fn push_elements_le(array: &UsdArray, tokens: &[u32], out: &mut Vec<u8>) -> std::result::Result<(), usize> {
    match array {
        UsdArray::Int(v) => out.extend(v.iter().flat_map(|x| x.to_le_bytes())),
        UsdArray::Int64(v) => out.extend(v.iter().flat_map(|x| x.to_le_bytes())),
        UsdArray::Float(v) => push_finite_f32(v, out)?,
        UsdArray::Float2(v) => push_finite_f32(v.as_flattened(), out)?,
        UsdArray::Float3(v) => push_finite_f32(v.as_flattened(), out)?,
        UsdArray::Float4(v) => push_finite_f32(v.as_flattened(), out)?,
        UsdArray::Quatf(v) => push_finite_f32(v.as_flattened(), out)?,
        UsdArray::Half3(v) => push_finite_f16(v.as_flattened(), out)?,
        UsdArray::Quath(v) => push_finite_f16(v.as_flattened(), out)?,
        UsdArray::Matrix4d(v) => push_finite_f64(v.as_flattened(), out)?,
        UsdArray::Token(_) => out.extend(tokens.iter().flat_map(|x| x.to_le_bytes())),
    }
    Ok(())
}
