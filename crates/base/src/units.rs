//! Unit conversions: files have degrees and sRGB colours, the library computes with radians and linear colours.

use crate::math;

/// One milligram in kg.
pub const MILLIGRAM: f64 = 1e-6;

/// One cubic millimetre, m^3.
pub const CUBIC_MILLIMETRE: f64 = 1e-9;

/// One gigapascal, Pa.
pub const GIGAPASCAL: f64 = 1e9;

/// One metre a second in millimetres an hour, the unit of rain rates.
pub const M_PER_S_TO_MM_PER_H: f64 = 3.6e6;

/// Angle in radians: `degrees` times pi / 180.
#[inline]
pub fn radians(degrees: f64) -> f64 {
    degrees * (std::f64::consts::PI / 180.0)
}

/// Angle in degrees: `radians` divided by pi / 180; a product with 180 / pi would be rounded differently.
#[inline]
pub fn degrees(radians: f64) -> f64 {
    radians / (std::f64::consts::PI / 180.0)
}

/// Degrees to radians, single precision, rounded once.
#[allow(clippy::cast_possible_truncation, reason = "rounding to f32 is the purpose")]
#[inline]
pub fn radians_f32(degrees: f32) -> f32 {
    radians(f64::from(degrees)) as f32
}

/// One sRGB component in [0, 1] to linear light; not clamped. Source: IEC 61966-2-1.
#[inline]
pub fn linear_from_srgb(c: f32) -> f32 {
    if c <= 0.040_45 { c / 12.92 } else { math::pow_f32((c + 0.055) / 1.055, 2.4) }
}

/// One linear component, clamped to [0, 1], to sRGB. Source: IEC 61966-2-1.
#[inline]
pub fn srgb_from_linear(c: f32) -> f32 {
    let c = c.clamp(0.0, 1.0);
    if c <= 0.003_130_8 { c * 12.92 } else { 1.055 * math::pow_f32(c, 1.0 / 2.4) - 0.055 }
}

/// A value as a byte, rounded to nearest: 0 is 0, 1 is 255, values outside of [0, 1] are clamped.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to 0..=255 before the cast")]
#[inline]
pub fn byte(c: f32) -> u8 {
    (c.clamp(0.0, 1.0) * 255.0 + 0.5) as u8
}

/// Tables for the step function `byte(srgb_from_linear(c))` of a linear component c.
struct Steps {
    /// Byte of the component i / 4096, for i from 0 on.
    at: Vec<u8>,
    /// The smallest component whose byte is greater than i, for i from 0 on.
    above: Vec<f32>,
}

impl Steps {
    /// Number of equal classes of components: the curve is nowhere so steep that one class holds two steps.
    const CLASSES: f32 = 4096.0;

    fn new() -> Self {
        let exact = |c: f32| byte(srgb_from_linear(c));
        let at = (0..=4096_u16).map(|i| exact(f32::from(i) / Self::CLASSES)).collect();
        let above = |level: u8| {
            let (mut low, mut high) = (0, 1.0_f32.to_bits());
            while high - low > 1 {
                let middle = low + (high - low) / 2;
                if exact(f32::from_bits(middle)) > level { high = middle } else { low = middle }
            }
            f32::from_bits(high)
        };
        Self { at, above: (0..255).map(above).chain([f32::INFINITY]).collect() }
    }
}

/// One linear component in [0, 1] to an sRGB byte: [`byte`] of [`srgb_from_linear`], from a table.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the table before the cast")]
#[inline]
pub fn srgb_byte(c: f32) -> u8 {
    static STEPS: std::sync::LazyLock<Steps> = std::sync::LazyLock::new(Steps::new);
    let steps = &*STEPS;
    let c = c.clamp(0.0, 1.0);
    let level = steps.at[(c * Steps::CLASSES) as usize];
    level + u8::from(c >= steps.above[usize::from(level)])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_of_srgb_bytes_is_the_formula() {
        let mut tried: Vec<f32> = (0..200_000_u32).map(|i| i as f32 / 199_999.0).collect();
        for step in &Steps::new().above[..255] {
            tried.extend([f32::from_bits(step.to_bits() - 1), *step, f32::from_bits(step.to_bits() + 1)]);
        }
        for c in tried.into_iter().chain([-1.0, 2.0, f32::NAN, f32::INFINITY]) {
            assert_eq!(srgb_byte(c), byte(srgb_from_linear(c)), "{c}");
        }
    }

    #[test]
    fn srgb_round_trips() {
        for i in 0..=255_u8 {
            let c = f32::from(i) / 255.0;
            assert_eq!(byte(srgb_from_linear(linear_from_srgb(c))), i);
        }
        assert!((radians(180.0) - std::f64::consts::PI).abs() < 1e-15);
    }
}
