//! Values of attributes, borrowed from the scene or from the arrays that were computed for a sample.

use half::f16;

/// A value of an attribute; a variant is named after the value type of USD, and serves the roles of that type, too
/// (`Float3`: `float3`, `point3f`, `color3f`). Quaternions are x, y, z, w.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum UsdValue<'a> {
    Bool(bool),
    Float(f32),
    Double(f64),
    String(&'a str),
    Token(&'a str),
    Asset(&'a str),
    Float2([f32; 2]),
    Float3([f32; 3]),
    Float4([f32; 4]),
    Double3([f64; 3]),
    Quatf([f32; 4]),
    /// Row after row, for row vectors: the translation is the last row.
    Matrix4d([f64; 16]),
    Array(UsdArray<'a>),
}

/// An array of an attribute; a variant is named after the type of its elements.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum UsdArray<'a> {
    Int(&'a [i32]),
    Int64(&'a [i64]),
    Float(&'a [f32]),
    Float2(&'a [[f32; 2]]),
    Float3(&'a [[f32; 3]]),
    Float4(&'a [[f32; 4]]),
    Half3(&'a [[f16; 3]]),
    /// Order x, y, z, w: imaginary part first, as in memory; text has the real part first.
    Quatf(&'a [[f32; 4]]),
    /// Order x, y, z, w: imaginary part first, as in memory; text has the real part first.
    Quath(&'a [[f16; 4]]),
    /// As [`UsdValue::Matrix4d`].
    Matrix4d(&'a [[f64; 16]]),
    Token(&'a [String]),
}

impl UsdArray<'_> {
    pub(crate) fn len(&self) -> usize {
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

    pub(crate) fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

impl<'a> From<UsdArray<'a>> for UsdValue<'a> {
    fn from(array: UsdArray<'a>) -> Self {
        UsdValue::Array(array)
    }
}

/// Appends single precision numbers, little endian, -0 as 0.
/// Errs with the index of the first number that is not finite.
pub(crate) fn push_finite_f32(values: &[f32], out: &mut Vec<u8>) -> Result<(), usize> {
    const EXPONENT: u32 = 0x7f80_0000;
    let start = out.len();
    out.resize(start + values.len() * 4, 0);
    // NaN and infinity are the numbers whose exponent bits are all ones. The loop only notes that there is one, so that it
    // vectorises; -0 + 0 is +0, every other number stays as it is.
    let mut has_non_finite = false;
    for (slot, x) in out[start..].chunks_exact_mut(4).zip(values) {
        has_non_finite |= x.to_bits() & EXPONENT == EXPONENT;
        slot.copy_from_slice(&(x + 0.0).to_le_bytes());
    }
    if has_non_finite { Err(values.iter().position(|x| !x.is_finite()).unwrap_or(0)) } else { Ok(()) }
}

/// Appends double precision numbers, as [`push_finite_f32`] does.
pub(crate) fn push_finite_f64(values: &[f64], out: &mut Vec<u8>) -> Result<(), usize> {
    for (i, x) in values.iter().enumerate() {
        if !x.is_finite() {
            return Err(i);
        }
        out.extend_from_slice(&(x + 0.0).to_le_bytes());
    }
    Ok(())
}

/// Appends half precision numbers, as [`push_finite_f32`] does.
pub(crate) fn push_finite_f16(values: &[f16], out: &mut Vec<u8>) -> Result<(), usize> {
    const EXPONENT: u16 = 0x7c00;
    const MINUS_ZERO: u16 = 0x8000;
    let start = out.len();
    out.resize(start + values.len() * 2, 0);
    let mut has_non_finite = false;
    for (slot, x) in out[start..].chunks_exact_mut(2).zip(values) {
        let bits = x.to_bits();
        has_non_finite |= bits & EXPONENT == EXPONENT;
        slot.copy_from_slice(&(if bits == MINUS_ZERO { 0 } else { bits }).to_le_bytes());
    }
    if has_non_finite { Err(values.iter().position(|x| !x.is_finite()).unwrap_or(0)) } else { Ok(()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn minus_zero_becomes_zero_and_nan_is_found() {
        let mut out = Vec::new();
        push_finite_f32(&[-0.0, 1.0], &mut out).expect("finite");
        assert_eq!(out, [0, 0, 0, 0, 0, 0, 0x80, 0x3f]);
        assert_eq!(push_finite_f32(&[1.0, 2.0, f32::NAN], &mut Vec::new()), Err(2));
        assert_eq!(push_finite_f32(&[f32::INFINITY], &mut Vec::new()), Err(0));
        let mut out = Vec::new();
        push_finite_f16(&[f16::NEG_ZERO], &mut out).expect("finite");
        assert_eq!(out, [0, 0]);
        assert_eq!(push_finite_f16(&[f16::ONE, f16::NAN], &mut Vec::new()), Err(1));
    }
}
