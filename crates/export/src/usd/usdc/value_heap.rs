//! The heap of a crate file: values appended as they arrive, equal ones once.

use super::integer_coding;
use crate::usd::byte_sink::ByteSink;
use crate::usd::value::{UsdArray, UsdValue, pack_f16, pack_f32, pack_f64};
use osier_base::par::LookupMap;
use osier_base::{Error, Result};

/// Type codes of values.
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

const ARRAY: u64 = 1 << 63;
const INLINE: u64 = 1 << 62;
const COMPRESSED: u64 = 1 << 61;
/// Integer arrays shorter than this stay as they are.
const MIN_COMPRESSED: usize = 16;

/// A value reference that holds its value itself.
pub(super) fn inline_value_rep(code: u8, bits: u32) -> u64 {
    INLINE | u64::from(code) << 48 | u64::from(bits)
}

/// Bytes of values and where equal ones lie.
pub(super) struct ValueHeap {
    pub(super) sink: Box<dyn ByteSink>,
    known: LookupMap<(u8, [u8; 32]), u64>,
    scratch: Vec<u8>,
}

impl ValueHeap {
    pub(super) fn new(sink: Box<dyn ByteSink>) -> Self {
        Self { sink, known: LookupMap::default(), scratch: Vec::new() }
    }

    /// Brings the end of the file to a multiple of 8.
    fn align(&mut self) -> Result<u64> {
        let over = self.sink.position() % 8;
        if over != 0 {
            self.sink.put(&[0; 8][usize::try_from(over).unwrap_or(0)..])?;
        }
        Ok(self.sink.position())
    }

    /// Appends one value's bytes, or finds them.
    pub(super) fn append(&mut self, code: u8, bytes: &[u8]) -> Result<u64> {
        self.deduplicated(code, u64::from(code) << 48, bytes, |heap| heap.sink.put(bytes))
    }

    /// Reference to bytes: that of equal ones if there are any, else of what `write` appends.
    /// `kind`: what tells equal bytes of unequal meaning apart; `flags`: the reference without its offset.
    fn deduplicated(
        &mut self,
        kind: u8,
        flags: u64,
        bytes: &[u8],
        write: impl FnOnce(&mut Self) -> Result<()>,
    ) -> Result<u64> {
        let key = (kind, *blake3::hash(bytes).as_bytes());
        if let Some(found) = self.known.get(&key) {
            return Ok(*found);
        }
        let reference = flags | self.align()?;
        write(self)?;
        self.known.insert(key, reference);
        Ok(reference)
    }

    /// Reference to an array. `tokens`: indices, if it is one of tokens. `place`: for complaints.
    pub(super) fn array_rep(&mut self, array: &UsdArray, tokens: &[u32], place: &dyn Fn() -> String) -> Result<u64> {
        let code = array_type_code(array);
        let flags = ARRAY | u64::from(code) << 48;
        if array.is_empty() {
            return Ok(flags);
        }
        let mut bytes = std::mem::take(&mut self.scratch);
        bytes.clear();
        pack_array(array, tokens, &mut bytes).map_err(|i| not_finite(&place(), i))?;
        let count = (array.len() as u64).to_le_bytes();
        // The top bit of the kind parts arrays from single values.
        let kind = code | 0x80;
        let packed = |heap: &mut Self, data: Vec<u8>| {
            heap.sink.put(&count)?;
            heap.sink.put(&(data.len() as u64).to_le_bytes())?;
            heap.sink.put(&data)
        };
        let reference = match array {
            UsdArray::Int(v) if v.len() >= MIN_COMPRESSED => {
                self.deduplicated(kind, flags | COMPRESSED, &bytes, |heap| {
                    packed(heap, integer_coding::compress_i32(v))
                })
            }
            UsdArray::Int64(v) if v.len() >= MIN_COMPRESSED => {
                self.deduplicated(kind, flags | COMPRESSED, &bytes, |heap| {
                    packed(heap, integer_coding::compress_i64(v))
                })
            }
            _ => self.deduplicated(kind, flags, &bytes, |heap| {
                heap.sink.put(&count)?;
                heap.sink.put(&bytes)
            }),
        };
        self.scratch = bytes;
        reference
    }

    /// Reference to a single value; tokens, strings and paths to assets come as indices in `index`.
    pub(super) fn scalar_rep(&mut self, value: &UsdValue, index: u32, place: &dyn Fn() -> String) -> Result<u64> {
        let mut bytes = Vec::new();
        let bad = |i| not_finite(&place(), i);
        let code = match value {
            UsdValue::Bool(b) => return Ok(inline_value_rep(type_code::BOOL, u32::from(*b))),
            UsdValue::Float(x) if x.is_finite() => return Ok(inline_value_rep(type_code::FLOAT, (x + 0.0).to_bits())),
            UsdValue::Float(_) => return Err(bad(0)),
            UsdValue::String(_) => return Ok(inline_value_rep(type_code::STRING, index)),
            UsdValue::Token(_) => return Ok(inline_value_rep(type_code::TOKEN, index)),
            UsdValue::Asset(_) => return Ok(inline_value_rep(type_code::ASSET_PATH, index)),
            UsdValue::Double(x) => pack_f64(&[*x], &mut bytes).map(|()| type_code::DOUBLE),
            UsdValue::Float2(v) => pack_f32(v, &mut bytes).map(|()| type_code::VEC2F),
            UsdValue::Float3(v) => pack_f32(v, &mut bytes).map(|()| type_code::VEC3F),
            UsdValue::Float4(v) => pack_f32(v, &mut bytes).map(|()| type_code::VEC4F),
            UsdValue::Double3(v) => pack_f64(v, &mut bytes).map(|()| type_code::VEC3D),
            UsdValue::Quatf(v) => pack_f32(v, &mut bytes).map(|()| type_code::QUATF),
            UsdValue::Matrix4d(v) => pack_f64(v, &mut bytes).map(|()| type_code::MATRIX4D),
            UsdValue::Array(array) => return self.array_rep(array, &[], place),
        }
        .map_err(bad)?;
        self.append(code, &bytes)
    }
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

fn pack_array(array: &UsdArray, tokens: &[u32], out: &mut Vec<u8>) -> std::result::Result<(), usize> {
    match array {
        UsdArray::Int(v) => out.extend(v.iter().flat_map(|x| x.to_le_bytes())),
        UsdArray::Int64(v) => out.extend(v.iter().flat_map(|x| x.to_le_bytes())),
        UsdArray::Float(v) => pack_f32(v, out)?,
        UsdArray::Float2(v) => pack_f32(v.as_flattened(), out)?,
        UsdArray::Float3(v) => pack_f32(v.as_flattened(), out)?,
        UsdArray::Float4(v) => pack_f32(v.as_flattened(), out)?,
        UsdArray::Quatf(v) => pack_f32(v.as_flattened(), out)?,
        UsdArray::Half3(v) => pack_f16(v.as_flattened(), out)?,
        UsdArray::Quath(v) => pack_f16(v.as_flattened(), out)?,
        UsdArray::Matrix4d(v) => pack_f64(v.as_flattened(), out)?,
        UsdArray::Token(_) => out.extend(tokens.iter().flat_map(|x| x.to_le_bytes())),
    }
    Ok(())
}
