//! Conversion from the scene's space to POV-Ray's, which is left-handed, z into the screen, `scale` units per metre.

use glam::{Mat3, Vec2, Vec3};

use crate::text::TextBuffer;
use osier_scene::Trs;

/// Writes geometry in POV-Ray's space. With s the scale and F = diag(1, 1, -1): points s F p, normals F n, linear maps F A F,
/// translations s F t.
#[derive(Debug, Clone, Copy)]
pub(super) struct PovSpace {
    /// Units of the POV-Ray scene in one metre.
    pub scale: f32,
}

impl PovSpace {
    /// A point as `<x,y,z>`. `p`: m.
    pub fn write_point(self, text: &mut TextBuffer, p: Vec3) {
        text.put("<").num(p.x * self.scale).put(",").num(p.y * self.scale).put(",").num(-p.z * self.scale).put(">");
    }

    /// A point as `<x,y,z>` with coordinates rounded to multiples of `step` units, a power of ten. `p`: m.
    pub fn write_rounded_point(self, text: &mut TextBuffer, p: Vec3, step: f32) {
        let [x, y, z] = [p.x, p.y, -p.z].map(|x| round_to(x * self.scale, step));
        text.put("<").num(x).put(",").num(y).put(",").num(z).put(">");
    }

    /// A length, converted from m to units.
    pub fn write_length(self, text: &mut TextBuffer, v: f32) {
        text.num(v * self.scale);
    }

    /// A transform as `matrix <..>`: POV-Ray multiplies row vectors, so its rows are the columns of the linear part F A F, and
    /// the translation. F on both sides negates the entries that mix z with x or y.
    pub fn write_matrix(self, text: &mut TextBuffer, trs: &Trs) {
        // The linear part A = R S: the scale acts first, then the rotation.
        let a = Mat3::from_quat(trs.r) * Mat3::from_diagonal(trs.s);
        let (x, y, z, t) = (a.x_axis, a.y_axis, a.z_axis, trs.t * self.scale);
        let rows = [x.x, x.y, -x.z, y.x, y.y, -y.z, -z.x, -z.y, z.z, t.x, t.y, -t.z];
        text.put("matrix <").list(&rows, ",").put(">");
    }
}

/// `x` rounded to a multiple of `step`, a power of ten, so that its shortest decimal form is short.
pub(super) fn round_to(x: f32, step: f32) -> f32 {
    // Division in double precision by the integer 1 / step: the f32 nearest to k / 1000 prints with three decimals.
    let per_unit = (1.0 / f64::from(step)).round();
    let x = f64::from(x);
    osier_base::math::narrow(if per_unit >= 1.0 { (x * per_unit).round() / per_unit } else { x.round() })
}

/// A direction as `<x,y,z>`: z is negated, and the scale is not applied.
pub(super) fn write_direction(text: &mut TextBuffer, n: Vec3) {
    text.put("<").num(n.x).put(",").num(n.y).put(",").num(-n.z).put(">");
}

/// A texture coordinate as `<u,v>`.
pub(super) fn write_uv(text: &mut TextBuffer, v: Vec2) {
    text.put("<").num(v.x).put(",").num(v.y).put(">");
}

/// A linear colour as `rgb <r,g,b>`.
pub(super) fn write_rgb(text: &mut TextBuffer, c: [f32; 3]) {
    text.put("rgb <").list(&c, ",").put(">");
}

#[cfg(test)]
mod tests {
    use glam::Quat;
    use proptest::prelude::*;

    use super::*;

    fn numbers(text: &TextBuffer) -> Vec<f32> {
        let s = std::str::from_utf8(text.bytes()).expect("ascii");
        let inner = s.split(['<', '>']).nth(1).expect("angle brackets");
        inner.split(',').map(|v| v.parse().expect("number")).collect()
    }

    proptest! {
        /// Transforming in POV-Ray's space what was converted equals converting what was transformed in ours.
        #[test]
        fn conversion_commutes_with_transforms(
            q in prop::array::uniform4(-1.0_f32..1.0),
            t in prop::array::uniform3(-5.0_f32..5.0),
            s in prop::array::uniform3(0.1_f32..2.0),
            p in prop::array::uniform3(-2.0_f32..2.0),
        ) {
            let q = Quat::from_array(q);
            prop_assume!(q.length() > 0.1);
            let trs = Trs { t: t.into(), r: q.normalize(), s: s.into() };
            let space = PovSpace { scale: 100.0 };
            let (mut m, mut a, mut b) = (TextBuffer::default(), TextBuffer::default(), TextBuffer::default());
            space.write_matrix(&mut m, &trs);
            space.write_point(&mut a, p.into());
            space.write_point(&mut b, trs.apply(p.into()));
            let (m, a, b) = (numbers(&m), numbers(&a), numbers(&b));
            for row in 0..3 {
                // POV-Ray multiplies row vectors: p' = p * M, the four rows of M listed one after the other.
                let got = a[0] * m[row] + a[1] * m[3 + row] + a[2] * m[6 + row] + m[9 + row];
                prop_assert!((got - b[row]).abs() < 2e-3, "{got} {}", b[row]);
            }
        }
    }
}
