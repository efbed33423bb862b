//! A triangular cross-section: three corners, the frame that they span, and their rigid-body motion.

use glam::{DMat3, DQuat, DVec3};

/// Positions, velocities or forces of three corners: x, y, z of each, one after another.
pub type Vector9 = [f64; 9];
/// A 9x9 block of a matrix over the degrees of freedom of two sections, by rows.
pub type Matrix9 = [[f64; 9]; 9];

/// Cosine and sine of the corners' angles, 0, 120 and 240 degrees.
const CORNER_COSINES: [f64; 3] = [1.0, -0.5, -0.5];
const CORNER_SINES: [f64; 3] = [0.0, 0.866_025_403_784_438_6, -0.866_025_403_784_438_6];

/// Position, velocity or force of corner `c`, 0 to 2.
#[inline(always)]
pub fn corner(x: &Vector9, c: usize) -> DVec3 {
    DVec3::new(x[3 * c], x[3 * c + 1], x[3 * c + 2])
}

/// Adds `d` to the vector of corner `c`, 0 to 2.
#[inline(always)]
pub fn add_to_corner(x: &mut Vector9, c: usize, d: DVec3) {
    x[3 * c] += d.x;
    x[3 * c + 1] += d.y;
    x[3 * c + 2] += d.z;
}

/// Corner vectors by evaluating a function of the corner's index, 0 to 2.
#[inline(always)]
pub fn corners_from_fn(f: impl Fn(usize) -> DVec3) -> Vector9 {
    let mut x = [0.0; 9];
    for c in 0..3 {
        add_to_corner(&mut x, c, f(c));
    }
    x
}

/// Mean of the three corner vectors; of positions, the centroid of the section.
#[inline(always)]
pub fn centroid(x: &Vector9) -> DVec3 {
    (corner(x, 0) + corner(x, 1) + corner(x, 2)) / 3.0
}

/// Scalar product over all nine components, such as force times displacement.
#[inline(always)]
pub fn corner_dot(a: &Vector9, b: &Vector9) -> f64 {
    (0..9).fold(0.0, |sum, k| sum + a[k] * b[k])
}

/// Product m x of a 9x9 matrix stored in rows.
#[inline(always)]
pub fn matrix_vector(m: &Matrix9, x: &Vector9) -> Vector9 {
    std::array::from_fn(|k| corner_dot(&m[k], x))
}

/// Product of the transpose of m and x, without building the transpose.
#[inline(always)]
pub fn transposed_matrix_vector(m: &Matrix9, x: &Vector9) -> Vector9 {
    let mut y = [0.0; 9];
    for k in 0..9 {
        for (y, m) in y.iter_mut().zip(&m[k]) {
            *y += m * x[k];
        }
    }
    y
}

/// Orthonormal frame of a section: `w` along the rod, `u` towards corner 0, v = w x u.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SectionFrame {
    /// Centroid of the corners, m.
    pub p: DVec3,
    /// Unit vector towards corner 0.
    pub u: DVec3,
    /// Unit vector w x u, which completes the right-handed frame.
    pub v: DVec3,
    /// Unit tangent of the rod.
    pub w: DVec3,
}

impl SectionFrame {
    /// The frame that three corners span. Collinear corners have no frame: its directions are then zero.
    /// Source: [yang-wu] 2.1, the frame from deformed corners; Own: `u` is the mean of the estimates from both axes.
    pub fn from_corners(x: &Vector9) -> Self {
        let p = centroid(x);
        let (mut a, mut b) = (DVec3::ZERO, DVec3::ZERO);
        // Least-squares axes of the triangle: sum of cos(a_c) d_c lies along u, sum of sin(a_c) d_c along v.
        for c in 0..3 {
            let d = corner(x, c) - p;
            a += CORNER_COSINES[c] * d;
            b += CORNER_SINES[c] * d;
        }
        // w: normal of the triangle. u: mean direction of a and of b, the latter rotated by -90 degrees about w.
        let w = a.cross(b).normalize_or_zero();
        let u = (a.normalize_or_zero() + b.normalize_or_zero().cross(w)).normalize_or_zero();
        Self { p, u, v: w.cross(u), w }
    }

    /// The frame translated by `by`, m, and rotated about its origin by the small rotation vector `turn`, rad.
    pub fn translated_and_rotated(&self, by: DVec3, turn: DVec3) -> Self {
        // First-order quaternion of the rotation vector, normalized.
        let q = DQuat::from_xyzw(0.5 * turn.x, 0.5 * turn.y, 0.5 * turn.z, 1.0).normalize();
        Self { p: self.p + by, u: q * self.u, v: q * self.v, w: q * self.w }
    }

    /// Corners, m, of an equilateral triangle with circumradius `rho`, m, around the origin of the frame.
    pub fn corner_positions(&self, rho: f64) -> Vector9 {
        corners_from_fn(|c| self.p + rho * (CORNER_COSINES[c] * self.u + CORNER_SINES[c] * self.v))
    }

    /// Rotation from section coordinates (u, v, w) to world directions, by columns.
    pub fn matrix(&self) -> DMat3 {
        DMat3::from_cols(self.u, self.v, self.w)
    }

    /// World positions of corners given in the frame's coordinates `local`, m.
    pub fn local_positions_to_world(&self, local: &Vector9) -> Vector9 {
        let m = self.matrix();
        corners_from_fn(|c| self.p + m * corner(local, c))
    }

    /// Coordinates, m, in this frame of corners at world positions; the inverse of [`SectionFrame::local_positions_to_world`].
    pub fn corners_to_local(&self, x: &Vector9) -> Vector9 {
        let m = self.matrix().transpose();
        corners_from_fn(|c| m * (corner(x, c) - self.p))
    }

    /// Rotation in the convention of plant nodes: +Y along the rod, +X towards corner 0.
    pub fn rotation(&self) -> DQuat {
        DQuat::from_mat3(&DMat3::from_cols(self.u, self.w, -self.v)).normalize()
    }
}

/// Rigid-body motion of three corners: v = mean, omega = I^-1 sum r x v; and conversely the corner forces that are
/// equivalent to a force and a torque.
/// Source: the map W of M_last = diag(m) + W^T M W. Own: [yang-wu] does not give W.
#[derive(Debug, Clone, Copy)]
pub struct CornerRigidMotion {
    /// Centroid of the corners, m.
    pub p: DVec3,
    /// Vectors from the centroid to the corners, m.
    arms: [DVec3; 3],
    /// Inverse of I = sum(|r|^2 1 - r r^T), 1/m^2.
    inverse: DMat3,
}

impl CornerRigidMotion {
    /// The map for corners at `x`, m, which must not be collinear: I would be singular.
    pub fn from_corners(x: &Vector9) -> Self {
        let p = centroid(x);
        let arms = [0, 1, 2].map(|c| corner(x, c) - p);
        let mut i = DMat3::ZERO;
        for r in arms {
            i += DMat3::from_diagonal(DVec3::splat(r.length_squared())) - outer_product(r, r);
        }
        Self { p, arms, inverse: i.inverse() }
    }

    /// Velocity of the centroid, m/s, and angular velocity, rad/s, of corners with velocities `v`, m/s.
    pub fn rigid_velocity(&self, v: &Vector9) -> (DVec3, DVec3) {
        let spin = (0..3).fold(DVec3::ZERO, |s, c| s + self.arms[c].cross(corner(v, c)));
        (centroid(v), self.inverse * spin)
    }

    /// Corner forces, N, equivalent to a force, N, and a torque, N m, at the centroid.
    pub fn corner_forces(&self, force: DVec3, torque: DVec3) -> Vector9 {
        // f_c = F/3 + (I^-1 T) x r_c: the corner forces of least norm with this resultant.
        let t = self.inverse * torque;
        corners_from_fn(|c| force / 3.0 + t.cross(self.arms[c]))
    }

    /// Jacobian J of points that are rigid with the section, dX = J dx, with respect to the section's corners. `x`:
    /// the points, m.
    pub fn attachment_jacobian(&self, x: &Vector9) -> Matrix9 {
        let mut j = [[0.0; 9]; 9];
        for c in 0..3 {
            let q = corner(x, c) - self.p;
            for a in 0..3 {
                // mean + omega x q, omega = I^-1 (r x dx).
                let m = DMat3::from_diagonal(DVec3::splat(1.0 / 3.0))
                    - cross_matrix(q) * self.inverse * cross_matrix(self.arms[a]);
                set_corner_block(&mut j, c, a, &m);
            }
        }
        j
    }

    /// Mass matrix W^T M W of a rigid body attached to the section, over the corners. `at`: from the centroid to the
    /// centre of the body, m; `mass`, kg; `inertia` about the centre of the body, kg m^2, both in world directions.
    pub fn body_mass_matrix(&self, at: DVec3, mass: f64, inertia: DMat3) -> Matrix9 {
        let s = cross_matrix(at);
        // The 6x6 spatial mass matrix about the section's centroid, [[m, -m s], [m s, I - m s s]] with s = [at]x.
        let (a, b) = (DMat3::from_diagonal(DVec3::splat(mass)), s * -mass);
        let (c, d) = (s * mass, inertia - s * s * mass);
        let mut m = [[0.0; 9]; 9];
        // Column by column: corner j moves along k.
        for j in 0..3 {
            for k in 0..3 {
                let mut v = [0.0; 9];
                v[3 * j + k] = 1.0;
                let (v, w) = self.rigid_velocity(&v);
                let f = self.corner_forces(a * v + b * w, c * v + d * w);
                for row in 0..9 {
                    m[row][3 * j + k] = f[row];
                }
            }
        }
        m
    }
}

/// Cross-product matrix: cross_matrix(a) b = a x b.
pub fn cross_matrix(a: DVec3) -> DMat3 {
    DMat3::from_cols(DVec3::new(0.0, a.z, -a.y), DVec3::new(-a.z, 0.0, a.x), DVec3::new(a.y, -a.x, 0.0))
}

fn outer_product(a: DVec3, b: DVec3) -> DMat3 {
    DMat3::from_cols(a * b.x, a * b.y, a * b.z)
}

/// Writes the 3x3 block that maps corner `a` to corner `c`.
fn set_corner_block(block: &mut Matrix9, c: usize, a: usize, m: &DMat3) {
    for k in 0..3 {
        let column = m.col(k);
        for (row, v) in column.to_array().into_iter().enumerate() {
            block[3 * c + row][3 * a + k] = v;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample_corners() -> (SectionFrame, Vector9) {
        let turn = DQuat::from_euler(glam::EulerRot::XYZ, 0.4, -1.1, 0.7);
        let frame =
            SectionFrame { p: DVec3::new(1.0, 2.0, -3.0), u: turn * DVec3::X, v: turn * DVec3::Y, w: turn * DVec3::Z };
        (frame, frame.corner_positions(0.02))
    }

    #[test]
    fn frame_from_its_own_corners_is_the_frame() {
        let (frame, x) = sample_corners();
        let again = SectionFrame::from_corners(&x);
        for (a, b) in [(frame.p, again.p), (frame.u, again.u), (frame.v, again.v), (frame.w, again.w)] {
            assert!((a - b).length() < 1e-12);
        }
        assert!((again.rotation() * DVec3::Y - frame.w).length() < 1e-12);
        assert!((again.rotation() * DVec3::Z + frame.v).length() < 1e-12);
    }

    #[test]
    fn corner_forces_sum_to_the_wrench() {
        let (_, x) = sample_corners();
        let rigid = CornerRigidMotion::from_corners(&x);
        let (force, torque) = (DVec3::new(1.0, -2.0, 0.5), DVec3::new(0.02, 0.01, -0.03));
        let f = rigid.corner_forces(force, torque);
        let sum = (0..3).fold(DVec3::ZERO, |s, c| s + corner(&f, c));
        let turn = (0..3).fold(DVec3::ZERO, |s, c| s + (corner(&x, c) - rigid.p).cross(corner(&f, c)));
        assert!((sum - force).length() < 1e-12 && (turn - torque).length() < 1e-12);
    }

    #[test]
    fn body_mass_matrix_gives_kinetic_energy() {
        let (_, x) = sample_corners();
        let rigid = CornerRigidMotion::from_corners(&x);
        let (v, w) = (DVec3::new(0.3, -0.2, 1.0), DVec3::new(2.0, 1.0, -1.5));
        let (at, mass, inertia) =
            (DVec3::new(0.05, 0.01, -0.02), 0.3, DMat3::from_diagonal(DVec3::new(1e-4, 2e-4, 3e-4)));
        let moved = corners_from_fn(|c| v + w.cross(corner(&x, c) - rigid.p));
        let m = rigid.body_mass_matrix(at, mass, inertia);
        let energy = 0.5 * corner_dot(&moved, &matrix_vector(&m, &moved));
        let own = 0.5 * mass * (v + w.cross(at)).length_squared() + 0.5 * w.dot(inertia * w);
        assert!((energy - own).abs() < 1e-12, "{energy} {own}");
    }
}
