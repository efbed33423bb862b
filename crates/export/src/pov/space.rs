//! From osier's space to POV-Ray's: left-handed, z into the screen, `scale` units per metre.

use glam::{Mat3, Vec2, Vec3};

use crate::text::Text;
use osier_scene::Trs;

/// Writes geometry in POV-Ray's space. With F = diag(1, 1, -1): points s F p, normals F n, linear maps F A F,
/// translations s F t.
#[derive(Debug, Clone, Copy)]
pub(super) struct Space {
    /// Units per metre.
    pub scale: f32,
}

impl Space {
    /// A point as `<x,y,z>`. `p`: m.
    pub fn point(self, text: &mut Text, p: Vec3) {
        text.put("<").num(p.x * self.scale).put(",").num(p.y * self.scale).put(",").num(-p.z * self.scale).put(">");
    }

    /// A length. `v`: m.
    pub fn length(self, text: &mut Text, v: f32) {
        text.num(v * self.scale);
    }

    /// A transform as `matrix <..>`: the columns of the linear part, then the translation.
    pub fn matrix(self, text: &mut Text, trs: &Trs) {
        let a = Mat3::from_quat(trs.r) * Mat3::from_diagonal(trs.s);
        let (x, y, z, t) = (a.x_axis, a.y_axis, a.z_axis, trs.t * self.scale);
        let rows = [x.x, x.y, -x.z, y.x, y.y, -y.z, -z.x, -z.y, z.z, t.x, t.y, -t.z];
        text.put("matrix <").list(&rows, ",").put(">");
    }
}

/// A direction as `<x,y,z>`.
pub(super) fn direction(text: &mut Text, n: Vec3) {
    text.put("<").num(n.x).put(",").num(n.y).put(",").num(-n.z).put(">");
}

/// A texture coordinate as `<u,v>`.
pub(super) fn uv(text: &mut Text, v: Vec2) {
    text.put("<").num(v.x).put(",").num(v.y).put(">");
}

/// Three numbers as they are, for colours.
pub(super) fn rgb(text: &mut Text, c: [f32; 3]) {
    text.put("rgb <").list(&c, ",").put(">");
}

#[cfg(test)]
mod tests {
    use glam::Quat;
    use proptest::prelude::*;

    use super::*;

    fn numbers(text: &Text) -> Vec<f32> {
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
            let space = Space { scale: 100.0 };
            let (mut m, mut a, mut b) = (Text::default(), Text::default(), Text::default());
            space.matrix(&mut m, &trs);
            space.point(&mut a, p.into());
            space.point(&mut b, trs.apply(p.into()));
            let (m, a, b) = (numbers(&m), numbers(&a), numbers(&b));
            for row in 0..3 {
                // POV-Ray multiplies row vectors: p' = p * M, the four rows of M listed one after the other.
                let got = a[0] * m[row] + a[1] * m[3 + row] + a[2] * m[6 + row] + m[9 + row];
                prop_assert!((got - b[row]).abs() < 2e-3, "{got} {}", b[row]);
            }
        }
    }
}
