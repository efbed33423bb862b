//! Affine maps of the plane and of space: composition, norms, fixed points.
//!
//! # Examples
//! ```
//! use glam::DVec3;
//! use osier_ifs::affine::Affine;
//!
//! // x' = x / 2 + 1, y' = y / 2.
//! let map = Affine::plane([0.5, 0.0, 0.0, 0.5, 1.0, 0.0]);
//! assert_eq!(map.apply(DVec3::new(2.0, 4.0, 0.0)), DVec3::new(2.0, 2.0, 0.0));
//! assert!((map.norm() - 0.5).abs() < 1e-7);
//! ```

use glam::{DMat3, DVec3};

use osier_base::math::{self, narrow};

/// Axis-aligned change of coordinates u = scale x + shift, as from table units to pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AxisScaling {
    /// Scale factor of each axis; no component may be 0.
    pub scale: DVec3,
    /// Offset added after scaling, in the units of u.
    pub shift: DVec3,
}

impl AxisScaling {
    /// Identity: coordinates stay in table units.
    pub const IDENTITY: Self = Self { scale: DVec3::ONE, shift: DVec3::ZERO };
}

/// w(x) = A x + b. A map of the plane has zeros in the third row and column of A and in b.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Affine {
    /// Linear part A, table units per table unit.
    pub a: DMat3,
    /// Translation b, table units.
    pub b: DVec3,
}

/// Placement of a branch on its parent, as botanical tables state it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Branch {
    /// Height on the parent's segment, 0..1.
    pub h: f64,
    /// Turn about the parent, rad.
    pub roll: f64,
    /// Tilt off the parent, rad.
    pub pitch: f64,
    /// Length of the branch divided by its parent's, (0, 1).
    pub scale: f64,
}

impl Affine {
    /// The map that leaves every point in place, the neutral element of [`Affine::after`].
    pub const IDENTITY: Self = Self { a: DMat3::IDENTITY, b: DVec3::ZERO };

    /// The map of the plane x' = a x + b y + e, y' = c x + d y + f from its coefficients `[a, b, c, d, e, f]`.
    pub fn plane(c: [f64; 6]) -> Self {
        let a = DMat3::from_cols(DVec3::new(c[0], c[2], 0.0), DVec3::new(c[1], c[3], 0.0), DVec3::ZERO);
        Self { a, b: DVec3::new(c[4], c[5], 0.0) }
    }

    /// The map of space with the matrix rows `c[0..3]`, `c[3..6]`, `c[6..9]` and the shift `c[9..12]`.
    pub fn space(c: [f64; 12]) -> Self {
        let column = |i: usize| DVec3::new(c[i], c[i + 3], c[i + 6]);
        Self { a: DMat3::from_cols(column(0), column(1), column(2)), b: DVec3::new(c[9], c[10], c[11]) }
    }

    /// The map of the plane with columns of length `r` and `q` at the angles `alpha` and `beta` + 90 degrees, rad.
    /// Source: [wang-hao] eq. (2): a = r cos alpha, b = -q sin beta, c = r sin alpha, d = q cos beta.
    pub fn polar([r, q, alpha, beta]: [f64; 4], shift: [f64; 2]) -> Self {
        let (a, c) = (r * math::cos(alpha), r * math::sin(alpha));
        let (b, d) = (-q * math::sin(beta), q * math::cos(beta));
        Self::plane([a, b, c, d, shift[0], shift[1]])
    }

    /// The inverse of [`Affine::polar`]: `[r, q, alpha, beta]`, angles in rad; an angle is 0 where its radius is 0.
    /// Source: [wang-hao] eq. (2), solved.
    pub fn to_polar(&self) -> [f64; 4] {
        let (x, y) = (self.a.x_axis, self.a.y_axis);
        let (r, q) = (math::sqrt(x.x * x.x + x.y * x.y), math::sqrt(y.x * y.x + y.y * y.y));
        let angle = |radius: f64, s: f64, c: f64| if radius > 0.0 { math::atan2(s, c) } else { 0.0 };
        [r, q, angle(r, x.y, x.x), angle(q, 0.0 - y.x, y.y)]
    }

    /// The map T(0, h, 0) Ry(roll) Rz(pitch) scale of a branch; angles in rad.
    pub fn branch(b: &Branch) -> Self {
        // The child is scaled, tilted about z, turned about its parent, then moved to its height on the parent.
        let a = turn_y(b.roll) * turn_z(b.pitch) * b.scale;
        Self { a, b: DVec3::new(0.0, b.h, 0.0) }
    }

    /// Multiplies each axis by its component of `scale`, then adds `shift`.
    pub fn scaling(scale: DVec3, shift: DVec3) -> Self {
        Self { a: DMat3::from_diagonal(scale), b: shift }
    }

    /// Coefficients in the order of a file: `a b c d e f`, or `a..i j k l`.
    pub fn coefficients(&self, dim: usize) -> Vec<f64> {
        let (a, b) = (self.a, self.b);
        if dim == 2 {
            return vec![a.x_axis.x, a.y_axis.x, a.x_axis.y, a.y_axis.y, b.x, b.y];
        }
        let row = |i: usize| [a.x_axis[i], a.y_axis[i], a.z_axis[i]];
        [row(0), row(1), row(2)].concat().into_iter().chain(b.to_array()).collect()
    }

    /// Rows of A, then b, in single precision.
    pub(super) fn single(&self) -> [f32; 12] {
        let c = self.coefficients(3);
        std::array::from_fn(|i| c.get(i).map_or(0.0, |v| narrow(*v)))
    }

    /// A p + b, table units.
    pub fn apply(&self, p: DVec3) -> DVec3 {
        self.a * p + self.b
    }

    /// The composition of two maps: `inner` is applied first, then `self`.
    #[must_use]
    pub fn after(&self, inner: &Self) -> Self {
        Self { a: self.a * inner.a, b: self.a * inner.b + self.b }
    }

    /// Determinant of the plane's or space's linear part.
    pub fn det(&self, dim: usize) -> f64 {
        if dim == 2 {
            self.a.x_axis.x * self.a.y_axis.y - self.a.y_axis.x * self.a.x_axis.y
        } else {
            self.a.determinant()
        }
    }

    /// Singular values, largest first; the third of a map of the plane is 0. Relative error about 1e-8 of the largest.
    /// Source: eigenvalues of A^T A by cyclic Jacobi rotations.
    pub fn singular_values(&self) -> [f64; 3] {
        // Largest entry of A: dividing by it keeps A^T A within range.
        let scale = self.a.to_cols_array().iter().fold(0.0_f64, |m, v| m.max(v.abs()));
        if scale <= 0.0 || !scale.is_finite() {
            return [scale; 3];
        }
        // Scaled so that the squares in A^T A neither overflow nor vanish.
        let a = self.a * (1.0 / scale);
        let eigen = eigenvalues((a.transpose() * a).to_cols_array_2d());
        let mut values = eigen.map(|v| scale * math::sqrt(v.max(0.0)));
        values.sort_by(|x, y| y.total_cmp(x));
        values
    }

    /// Largest singular value: the greatest factor by which the map stretches a distance.
    pub fn norm(&self) -> f64 {
        self.singular_values()[0]
    }

    /// Largest magnitude of an eigenvalue: the stretch per step of the map applied many times.
    /// Source: Gelfand's formula, lim |A^k|^(1/k) with k = 2^40 by squaring.
    pub fn spectral_radius(&self) -> f64 {
        let (mut m, mut log, mut share) = (self.a, 0.0, 1.0);
        // Each pass squares the normalized power A^(2^i) and adds its logarithm with weight 2^-i.
        for _ in 0..40 {
            let size = m.to_cols_array().iter().fold(0.0_f64, |s, v| s.max(v.abs()));
            if size < 1e-150 || !size.is_finite() {
                return if size.is_finite() { 0.0 } else { size };
            }
            log += math::ln(size) * share;
            m *= 1.0 / size;
            m = m * m;
            share *= 0.5;
        }
        math::exp(log)
    }

    /// Fixed point (I - A)^-1 b; `None` if it is not unique or not finite.
    pub fn fixed_point(&self) -> Option<DVec3> {
        // x = A x + b has the solution (I - A)^-1 b, unless I - A is singular.
        let m = DMat3::IDENTITY - self.a;
        (m.determinant().abs() > 1e-12).then(|| m.inverse() * self.b).filter(|p| p.is_finite())
    }

    /// The same map in the coordinates u = scale x + shift (scale per axis, none 0).
    #[must_use]
    pub fn conjugated(&self, scale: DVec3, shift: DVec3) -> Self {
        let (s, inverse) = (DMat3::from_diagonal(scale), DMat3::from_diagonal(scale.recip()));
        // u = S x + t with x = w(x): A' = S A S^-1 and b' = S b + t - A' t.
        let a = s * self.a * inverse;
        Self { a, b: scale * self.b + shift - a * shift }
    }

    /// True if no coefficient is NaN or infinite.
    pub fn is_finite(&self) -> bool {
        self.a.is_finite() && self.b.is_finite()
    }
}

/// Rotation matrix about the vertical axis by t rad: x' = x cos t + z sin t, z' = z cos t - x sin t.
pub fn turn_y(t: f64) -> DMat3 {
    let (s, c) = (math::sin(t), math::cos(t));
    DMat3::from_cols(DVec3::new(c, 0.0, -s), DVec3::Y, DVec3::new(s, 0.0, c))
}

/// Rotation matrix about z by t rad: x' = x cos t - y sin t, y' = x sin t + y cos t.
pub fn turn_z(t: f64) -> DMat3 {
    let (s, c) = (math::sin(t), math::cos(t));
    DMat3::from_cols(DVec3::new(c, s, 0.0), DVec3::new(-s, c, 0.0), DVec3::Z)
}

/// Eigenvalues of a symmetric matrix by cyclic Jacobi rotations; unsorted. Sixteen sweeps converge to rounding error.
fn eigenvalues(mut m: [[f64; 3]; 3]) -> [f64; 3] {
    for _ in 0..16 {
        let off = m[0][1].abs() + m[0][2].abs() + m[1][2].abs();
        if off < 1e-300 {
            break;
        }
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            rotate(&mut m, p, q);
        }
    }
    [m[0][0], m[1][1], m[2][2]]
}

/// One Jacobi rotation that makes the entries (p, q) and (q, p) of a symmetric matrix zero.
fn rotate(m: &mut [[f64; 3]; 3], p: usize, q: usize) {
    if m[p][q].abs() < 1e-300 {
        return;
    }
    // The smaller root t of t^2 + 2 theta t - 1 = 0 gives the rotation by less than 45 degrees.
    let theta = (m[q][q] - m[p][p]) / (2.0 * m[p][q]);
    let t = theta.signum() / (theta.abs() + math::sqrt(theta * theta + 1.0));
    let c = 1.0 / math::sqrt(t * t + 1.0);
    let s = t * c;
    // The third index. Only the rows and columns p and q change.
    let r = 3 - p - q;
    let (mpq, mrp, mrq) = (m[p][q], m[r][p], m[r][q]);
    m[p][p] -= t * mpq;
    m[q][q] += t * mpq;
    (m[p][q], m[q][p]) = (0.0, 0.0);
    (m[r][p], m[r][q]) = (c * mrp - s * mrq, s * mrp + c * mrq);
    (m[p][r], m[q][r]) = (m[r][p], m[r][q]);
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use osier_base::units::radians;

    #[test]
    fn known_values() {
        let sun = Affine::plane([0.15596, 0.98776, -0.98776, 0.15596, -0.779, 9.124]);
        assert!((sun.norm() - 0.999_997).abs() < 1e-6 && (sun.spectral_radius() - 0.999_997).abs() < 1e-6);
        let hill = Affine::plane([0.262, -1.105, 0.114, 0.241, -0.473, 3.045]);
        assert!((hill.norm() - 1.155).abs() < 1e-3);
        let shear = Affine::plane([0.5, 100.0, 0.0, 0.25, 0.0, 0.0]);
        assert!((shear.spectral_radius() - 0.5).abs() < 1e-6, "{}", shear.spectral_radius());
        assert_eq!(Affine::plane([0.0; 6]).spectral_radius().to_bits(), 0);
        let fixed = Affine::plane([0.85, 0.04, -0.04, 0.85, 0.0, 1.6]).fixed_point().expect("one");
        assert!((fixed - DVec3::new(2.6556, 9.9585, 0.0)).length() < 1e-3);
    }

    #[test]
    fn branches_point_where_they_are_said_to() {
        let b = Branch { h: 0.4, roll: radians(90.0), pitch: radians(62.0), scale: 0.42 };
        let tip = Affine::branch(&b).apply(DVec3::Y);
        // Pitch leans towards -X, a roll of 90 degrees takes -X to +Z.
        let want = DVec3::new(0.0, 0.4 + 0.42 * math::cos(radians(62.0)), 0.42 * math::sin(radians(62.0)));
        assert!((tip - want).length() < 1e-12, "{tip}");
    }

    proptest! {
        #[test]
        fn polar_form_is_kept(r in 0.01..2.0_f64, q in 0.01..2.0_f64, alpha in -3.1..3.1_f64, beta in -3.1..3.1_f64) {
            let back = Affine::polar([r, q, alpha, beta], [1.0, 2.0]).to_polar();
            for (x, y) in back.iter().zip([r, q, alpha, beta]) {
                prop_assert!((x - y).abs() < 1e-12);
            }
            let m = Affine::polar([r, q, alpha, beta], [0.0; 2]);
            prop_assert!((m.det(2) - r * q * math::cos(alpha - beta)).abs() < 1e-12);
        }

        #[test]
        fn singular_values_fit_det_and_trace(c in proptest::array::uniform12(-2.0..2.0_f64)) {
            let m = Affine::space(c);
            let s = m.singular_values();
            prop_assert!((s[0] * s[1] * s[2] - m.det(3).abs()).abs() < 1e-6);
            let sum: f64 = c[..9].iter().map(|v| v * v).sum();
            prop_assert!((s.iter().map(|v| v * v).sum::<f64>() - sum).abs() < 1e-9);
        }
    }
}
