//! Values of attributes, borrowed from whoever holds them.

use half::f16;

/// A value of an attribute. Quaternions are x, y, z, w.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum UsdValue<'a> {
    /// `bool`.
    Bool(bool),
    /// `float`.
    Float(f32),
    /// `double`.
    Double(f64),
    /// `string`.
    String(&'a str),
    /// `token`.
    Token(&'a str),
    /// `asset`.
    Asset(&'a str),
    /// `float2`.
    Float2([f32; 2]),
    /// `float3` and its roles.
    Float3([f32; 3]),
    /// `float4` and its roles.
    Float4([f32; 4]),
    /// `double3`.
    Double3([f64; 3]),
    /// `quatf`.
    Quatf([f32; 4]),
    /// `matrix4d`, row after row, translation in the last row.
    Matrix4d([f64; 16]),
    /// Any array.
    Array(UsdArray<'a>),
}

/// An array of an attribute.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum UsdArray<'a> {
    /// `int[]`.
    Int(&'a [i32]),
    /// `int64[]`.
    Int64(&'a [i64]),
    /// `float[]`.
    Float(&'a [f32]),
    /// `float2[]` and its roles.
    Float2(&'a [[f32; 2]]),
    /// `float3[]` and its roles.
    Float3(&'a [[f32; 3]]),
    /// `float4[]` and its roles.
    Float4(&'a [[f32; 4]]),
    /// `half3[]`.
    Half3(&'a [[f16; 3]]),
    /// `quatf[]`.
    Quatf(&'a [[f32; 4]]),
    /// `quath[]`.
    Quath(&'a [[f16; 4]]),
    /// `matrix4d[]`.
    Matrix4d(&'a [[f64; 16]]),
    /// `token[]`.
    Token(&'a [String]),
}

impl UsdArray<'_> {
    /// Number of elements.
    pub fn len(&self) -> usize {
        match self {
            Self::Int(v) => v.len(),
            Self::Int64(v) => v.len(),
            Self::Float(v) => v.len(),
            Self::Float2(v) => v.len(),
            Self::Float3(v) => v.len(),
            Self::Float4(v) => v.len(),
            Self::Quatf(v) => v.len(),
            Self::Half3(v) => v.len(),
            Self::Quath(v) => v.len(),
            Self::Matrix4d(v) => v.len(),
            Self::Token(v) => v.len(),
        }
    }

    /// True without elements.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

impl<'a> From<UsdArray<'a>> for UsdValue<'a> {
    fn from(array: UsdArray<'a>) -> Self {
        UsdValue::Array(array)
    }
}

/// Appends single precision numbers, little endian, -0 as 0.
/// `Err` with the place of the first number that is not finite.
pub(super) fn pack_f32(values: &[f32], out: &mut Vec<u8>) -> Result<(), usize> {
    const EXPONENT: u32 = 0x7f80_0000;
    let start = out.len();
    out.resize(start + values.len() * 4, 0);
    let mut bad = false;
    for (slot, x) in out[start..].chunks_exact_mut(4).zip(values) {
        bad |= x.to_bits() & EXPONENT == EXPONENT;
        slot.copy_from_slice(&(x + 0.0).to_le_bytes());
    }
    if bad { Err(values.iter().position(|x| !x.is_finite()).unwrap_or(0)) } else { Ok(()) }
}

/// As [`pack_f32`], double precision.
pub(super) fn pack_f64(values: &[f64], out: &mut Vec<u8>) -> Result<(), usize> {
    for (i, x) in values.iter().enumerate() {
        if !x.is_finite() {
            return Err(i);
        }
        out.extend_from_slice(&(x + 0.0).to_le_bytes());
    }
    Ok(())
}

/// As [`pack_f32`], half precision.
pub(super) fn pack_f16(values: &[f16], out: &mut Vec<u8>) -> Result<(), usize> {
    const EXPONENT: u16 = 0x7c00;
    const MINUS_ZERO: u16 = 0x8000;
    let start = out.len();
    out.resize(start + values.len() * 2, 0);
    let mut bad = false;
    for (slot, x) in out[start..].chunks_exact_mut(2).zip(values) {
        let bits = x.to_bits();
        bad |= bits & EXPONENT == EXPONENT;
        slot.copy_from_slice(&(if bits == MINUS_ZERO { 0 } else { bits }).to_le_bytes());
    }
    if bad { Err(values.iter().position(|x| !x.is_finite()).unwrap_or(0)) } else { Ok(()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn minus_zero_becomes_zero_and_nan_is_found() {
        let mut out = Vec::new();
        pack_f32(&[-0.0, 1.0], &mut out).expect("finite");
        assert_eq!(out, [0, 0, 0, 0, 0, 0, 0x80, 0x3f]);
        assert_eq!(pack_f32(&[1.0, 2.0, f32::NAN], &mut Vec::new()), Err(2));
        assert_eq!(pack_f32(&[f32::INFINITY], &mut Vec::new()), Err(0));
        let mut out = Vec::new();
        pack_f16(&[f16::NEG_ZERO], &mut out).expect("finite");
        assert_eq!(out, [0, 0]);
        assert_eq!(pack_f16(&[f16::ONE, f16::NAN], &mut Vec::new()), Err(1));
    }
}
