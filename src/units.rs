//! Conversions at the border: degrees outside, radians inside; sRGB outside, linear inside.

use crate::math;

/// Degrees to radians.
pub fn radians(degrees: f64) -> f64 {
    degrees * (std::f64::consts::PI / 180.0)
}

/// Degrees to radians, single precision, rounded once.
#[allow(clippy::cast_possible_truncation, reason = "rounding to f32 is the purpose")]
pub fn radians_f32(degrees: f32) -> f32 {
    radians(f64::from(degrees)) as f32
}

/// One sRGB component in [0, 1] to linear light.
pub fn linear_from_srgb(c: f32) -> f32 {
    if c <= 0.040_45 { c / 12.92 } else { math::pow_f32((c + 0.055) / 1.055, 2.4) }
}

/// One linear component in [0, 1] to sRGB.
pub fn srgb_from_linear(c: f32) -> f32 {
    let c = c.clamp(0.0, 1.0);
    if c <= 0.003_130_8 { c * 12.92 } else { 1.055 * math::pow_f32(c, 1.0 / 2.4) - 0.055 }
}

/// A value in [0, 1] as a byte, rounded to nearest.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to 0..=255 before the cast")]
pub fn byte(c: f32) -> u8 {
    (c.clamp(0.0, 1.0) * 255.0 + 0.5) as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn srgb_round_trips() {
        for i in 0..=255_u8 {
            let c = f32::from(i) / 255.0;
            assert_eq!(byte(srgb_from_linear(linear_from_srgb(c))), i);
        }
        assert!((radians(180.0) - std::f64::consts::PI).abs() < 1e-15);
    }
}
