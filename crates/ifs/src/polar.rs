//! Polar decomposition A = R S of linear maps, and interpolation of the rotation R.

use glam::{DMat3, DQuat, DVec3};

use super::affine::turn_z;
use osier_base::math;

/// Sums or singular values below this share of the largest count as 0: the rotation is not determined.
const SINGULAR_RATIO: f64 = 1e-9;

/// The turn R of A = R S with a symmetric S.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Turn {
    /// About z, rad: maps of the plane.
    Plane(f64),
    /// A rotation of space, unit quaternion.
    Space(DQuat),
}

impl Turn {
    /// Matrix of the turn, a rotation with determinant 1.
    pub fn matrix(self) -> DMat3 {
        match self {
            Self::Plane(angle) => turn_z(angle),
            Self::Space(q) => DMat3::from_quat(q),
        }
    }

    /// The identity rotation of the plane (`dim` 2) or of space.
    pub fn none(dim: usize) -> Self {
        if dim == 2 { Self::Plane(0.0) } else { Self::Space(DQuat::IDENTITY) }
    }

    /// The turn at the share `t` of the shortest path from `self` to `other`, extended by `more` full turns in the same
    /// direction; if the path has no length, they are about the vertical.
    /// Source: K. Shoemake, "Animating rotation with quaternion curves", 1985, by axis and angle.
    #[must_use]
    pub fn toward(self, other: Self, more: f64, t: f64) -> Self {
        match (self, other) {
            (Self::Plane(a), Self::Plane(b)) => Self::Plane(a + (shortest(b - a) + more * std::f64::consts::TAU) * t),
            (Self::Space(a), Self::Space(b)) => {
                let way = a.conjugate() * b;
                // q and -q are the same rotation; the one with w >= 0 is the shorter path.
                let way = if way.w < 0.0 { -way } else { way };
                let v = DVec3::new(way.x, way.y, way.z);
                let length = math::sqrt(v.dot(v));
                let axis = if length > 1e-12 { v / length } else { DVec3::Y };
                let angle = 2.0 * math::atan2(length, way.w) + more * std::f64::consts::TAU;
                Self::Space((a * about(axis, angle * t)).normalize())
            }
            (a, _) => a,
        }
    }
}

/// An angle brought to -pi .. pi, rad.
fn shortest(angle: f64) -> f64 {
    let turns = (angle / std::f64::consts::TAU).round();
    angle - turns * std::f64::consts::TAU
}

/// Rotation by `angle`, rad, about a unit axis.
fn about(axis: DVec3, angle: f64) -> DQuat {
    let (s, c) = (math::sin(0.5 * angle), math::cos(0.5 * angle));
    DQuat::from_xyzw(axis.x * s, axis.y * s, axis.z * s, c)
}

/// The smallest rotation that takes the unit vector `from` to `to`.
fn smallest(from: DVec3, to: DVec3) -> DQuat {
    let d = from.dot(to);
    if d < -0.999_999_999 {
        let axis = from.any_orthonormal_vector();
        return DQuat::from_xyzw(axis.x, axis.y, axis.z, 0.0);
    }
    // Half-angle form without trigonometry: q ~ (from x to, 1 + from . to).
    let c = from.cross(to);
    DQuat::from_xyzw(c.x, c.y, c.z, 1.0 + d).normalize()
}

/// A = U diag(s) V^T with s descending and V a rotation. Columns of U whose s is 0 are 0.
/// Source: M. Hestenes, "Inversion of matrices by biorthogonalization", 1958: one-sided Jacobi rotations, which keep
/// small singular values as exact as large ones.
fn svd(a: DMat3) -> (DMat3, DVec3, DMat3) {
    let mut m = [a.x_axis, a.y_axis, a.z_axis];
    let mut v = [DVec3::X, DVec3::Y, DVec3::Z];
    for _ in 0..32 {
        let mut turned = false;
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            let (alpha, beta, gamma) = (m[p].dot(m[p]), m[q].dot(m[q]), m[p].dot(m[q]));
            // Columns orthogonal to rounding error need no rotation.
            if gamma * gamma <= 1e-32 * alpha * beta || gamma.abs() < 1e-290 {
                continue;
            }
            turned = true;
            let zeta = (beta - alpha) / (2.0 * gamma);
            let t = zeta.signum() / (zeta.abs() + math::sqrt(zeta * zeta + 1.0));
            let c = 1.0 / math::sqrt(t * t + 1.0);
            let s = t * c;
            for list in [&mut m, &mut v] {
                (list[p], list[q]) = (list[p] * c - list[q] * s, list[p] * s + list[q] * c);
            }
        }
        if !turned {
            break;
        }
    }
    let length = |m: &[DVec3; 3], i: usize| math::sqrt(m[i].dot(m[i]));
    for (p, q) in [(0, 1), (1, 2), (0, 1)] {
        if length(&m, p) < length(&m, q) {
            // Columns are swapped and one sign is flipped, so that V stays a rotation.
            (m[p], m[q]) = (m[q], -m[p]);
            (v[p], v[q]) = (v[q], -v[p]);
        }
    }
    let s = DVec3::new(length(&m, 0), length(&m, 1), length(&m, 2));
    let unit = |i: usize| if s[i] > 0.0 { m[i] / s[i] } else { DVec3::ZERO };
    (DMat3::from_cols(unit(0), unit(1), unit(2)), s, DMat3::from_cols(v[0], v[1], v[2]))
}

/// Rotation R of a linear map A = R S. `Err` where R is not unique: for a map of rank 1 in space it holds the direction
/// of the largest singular value and its image, otherwise `None`.
/// Source: A. Cauchy's polar decomposition with det R = 1, so that S may have one negative eigenvalue: it holds for
/// reflections and singular maps. In the plane angle(R) = atan2(c - b, a + d); in space R = U diag(1, 1, det(U V^T)) V^T.
fn turn(a: DMat3, dim: usize) -> Result<Turn, Option<(DVec3, DVec3)>> {
    if dim == 2 {
        // The plane has a closed form: the angle of the antisymmetric and symmetric parts of A.
        let (s, c) = (a.x_axis.y - a.y_axis.x, a.x_axis.x + a.y_axis.y);
        let most = a.to_cols_array().iter().fold(0.0_f64, |m, v| m.max(v.abs()));
        return if s.abs().max(c.abs()) > SINGULAR_RATIO * most {
            Ok(Turn::Plane(math::atan2(s, c)))
        } else {
            Err(None)
        };
    }
    let (u, s, v) = svd(a);
    if s.x <= 0.0 {
        return Err(None);
    }
    // The third direction from the first two: U becomes a rotation whatever the sign of det A.
    let third = u.x_axis.cross(u.y_axis);
    if s.y + third.dot(u.z_axis) * s.z <= SINGULAR_RATIO * s.x {
        return Err(Some((v.x_axis, u.x_axis)));
    }
    let r = DMat3::from_cols(u.x_axis, u.y_axis, third) * v.transpose();
    Ok(Turn::Space(DQuat::from_mat3(&r).normalize()))
}

/// Rotations and stretches of one map at successive keys: A = R S. Where the rotation of a key is not determined, that
/// of the nearest earlier key is used, otherwise that of the next later key, otherwise the identity. For rank 1 in
/// space this rotation is changed by the smallest turn that maps the known direction to its image.
pub fn parts(maps: &[DMat3], dim: usize) -> Vec<(Turn, DMat3)> {
    let own: Vec<_> = maps.iter().map(|a| turn(*a, dim)).collect();
    let neighbour = |i: usize| {
        let before = own.iter().take(i).rev().find_map(|t| t.ok());
        before.or_else(|| own.iter().skip(i).find_map(|t| t.ok())).unwrap_or(Turn::none(dim))
    };
    let pair = |(i, a): (usize, &DMat3)| {
        let turn = match (own.get(i).copied().unwrap_or(Err(None)), neighbour(i)) {
            (Ok(turn), _) => turn,
            (Err(Some((from, to))), Turn::Space(q)) => Turn::Space(smallest(q * from, to) * q),
            (Err(_), near) => near,
        };
        (turn, turn.matrix().transpose() * *a)
    };
    maps.iter().enumerate().map(pair).collect()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::affine::Affine;
    use osier_base::units::radians;

    fn plane(c: [f64; 4]) -> DMat3 {
        Affine::plane([c[0], c[1], c[2], c[3], 0.0, 0.0]).a
    }

    fn off(a: DMat3, b: DMat3) -> f64 {
        (a - b).to_cols_array().iter().fold(0.0, |m, v| m.max(v.abs()))
    }

    fn skew(s: DMat3) -> f64 {
        off(s, s.transpose())
    }

    #[test]
    fn a_quarter_turn_is_met_half_way_at_45_degrees() {
        let half = std::f64::consts::FRAC_1_SQRT_2;
        for dim in [2, 3] {
            let keys = parts(&[plane([1.0, 0.0, 0.0, 1.0]), turn_z(radians(90.0))], dim);
            let mut keys = keys.into_iter().map(|p| p.0);
            let (a, b) = (keys.next().expect("two"), keys.next().expect("two"));
            let m = a.toward(b, 0.0, 0.5).matrix();
            assert!((m.x_axis - DVec3::new(half, half, 0.0)).length() < 1e-12, "{dim}: {m}");
            // One full turn more: 90 + 360 degrees, half of it 225.
            let m = a.toward(b, 1.0, 0.5).matrix();
            assert!((m.x_axis + DVec3::new(half, half, 0.0)).length() < 1e-12, "{dim}: {m}");
        }
    }

    #[test]
    fn open_turns_take_their_neighbours() {
        let mirror = plane([0.3, 0.1, 0.1, -0.3]);
        let turned = turn_z(1.2) * 0.4;
        let list = parts(&[mirror, turned, DMat3::ZERO], 2);
        for (turn, s) in list {
            assert!((off(turn.matrix(), turn_z(1.2)) < 1e-12) && skew(s) < 1e-12);
        }
        assert_eq!(parts(&[mirror], 2)[0].0, Turn::Plane(0.0));
        // A line keeps its direction and takes the rest from its neighbour.
        let line = DMat3::from_cols(DVec3::ZERO, DVec3::new(0.3, 0.4, 0.0), DVec3::ZERO);
        let list = parts(&[line, DMat3::from_quat(about(DVec3::Y, 0.7)) * 0.5], 3);
        assert!(off(list[0].0.matrix() * list[0].1, line) < 1e-15 && skew(list[0].1) < 1e-12);
    }

    proptest! {
        #[test]
        fn turn_after_stretch_is_the_map(c in proptest::array::uniform12(-2.0..2.0_f64), flat in 0..4_u8) {
            let mut a = Affine::space(c).a;
            if flat & 1 == 1 { a.z_axis = a.x_axis * 0.5; }
            if flat & 2 == 2 { a.y_axis = a.x_axis * -2.0; }
            let p = plane([c[0], c[1], c[2], c[3]]);
            for (a, dim) in [(a, 3), (p, 2)] {
                let (turn, s) = parts(&[a], dim)[0];
                let r = turn.matrix();
                prop_assert!(off(r * r.transpose(), DMat3::IDENTITY) < 1e-12 && r.determinant() > 0.0);
                prop_assert!(off(r * s, a) < 1e-12);
                prop_assert!(skew(s) < 1e-7, "{}", skew(s));
            }
        }

        #[test]
        fn singular_values_are_those_of_the_squares(c in proptest::array::uniform12(-2.0..2.0_f64)) {
            let a = Affine::space(c);
            let (u, s, v) = svd(a.a);
            prop_assert!(off(u * DMat3::from_diagonal(s) * v.transpose(), a.a) < 1e-12);
            prop_assert!((v.determinant() - 1.0).abs() < 1e-12);
            for (x, y) in s.to_array().iter().zip(a.singular_values()) {
                prop_assert!((x - y).abs() < 1e-6);
            }
        }
    }
}
