//! A cross-section of a rod: three points, the frame that they span, and how they move as one body.

use glam::{DMat3, DQuat, DVec3};

/// Places, velocities or forces of three corners: x, y, z of each, one after another.
pub type SectionCorners = [f64; 9];
/// A square block of a matrix over corners, by rows.
pub type Matrix9 = [[f64; 9]; 9];

/// Cosine and sine of the corners' angles, 0, 120 and 240 degrees.
const COS: [f64; 3] = [1.0, -0.5, -0.5];
const SIN: [f64; 3] = [0.0, 0.866_025_403_784_438_6, -0.866_025_403_784_438_6];

/// One corner.
#[inline(always)]
pub fn corner(x: &SectionCorners, c: usize) -> DVec3 {
    DVec3::new(x[3 * c], x[3 * c + 1], x[3 * c + 2])
}

/// Adds to one corner.
#[inline(always)]
pub fn add(x: &mut SectionCorners, c: usize, d: DVec3) {
    x[3 * c] += d.x;
    x[3 * c + 1] += d.y;
    x[3 * c + 2] += d.z;
}

/// Three corners from a function of their number.
#[inline(always)]
pub fn corners(f: impl Fn(usize) -> DVec3) -> SectionCorners {
    let mut x = [0.0; 9];
    for c in 0..3 {
        add(&mut x, c, f(c));
    }
    x
}

/// Mean of the corners.
#[inline(always)]
pub fn centroid(x: &SectionCorners) -> DVec3 {
    (corner(x, 0) + corner(x, 1) + corner(x, 2)) / 3.0
}

/// Scalar product over all corners.
#[inline(always)]
pub fn dot(a: &SectionCorners, b: &SectionCorners) -> f64 {
    (0..9).fold(0.0, |sum, k| sum + a[k] * b[k])
}

/// A block times corners.
#[inline(always)]
pub fn matrix_vector(m: &Matrix9, x: &SectionCorners) -> SectionCorners {
    std::array::from_fn(|k| dot(&m[k], x))
}

/// The transposed block times corners.
#[inline(always)]
pub fn transposed_matrix_vector(m: &Matrix9, x: &SectionCorners) -> SectionCorners {
    let mut y = [0.0; 9];
    for k in 0..9 {
        for (y, m) in y.iter_mut().zip(&m[k]) {
            *y += m * x[k];
        }
    }
    y
}

/// Centre and directions of a section: `w` along the rod, `u` to corner 0, v = w x u.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SectionFrame {
    /// Centre, m.
    pub p: DVec3,
    /// To corner 0, unit.
    pub u: DVec3,
    /// Across, unit.
    pub v: DVec3,
    /// Along the rod, unit.
    pub w: DVec3,
}

impl SectionFrame {
    /// The frame that three corners span. Corners on a line give no frame: its directions are then zero.
    /// Source: [yang-wu] 2.1, the frame by moved corners; Own: `u` is the mean of both sides' guesses.
    pub fn from_corners(x: &SectionCorners) -> Self {
        let p = centroid(x);
        let (mut a, mut b) = (DVec3::ZERO, DVec3::ZERO);
        for c in 0..3 {
            let d = corner(x, c) - p;
            a += COS[c] * d;
            b += SIN[c] * d;
        }
        let w = a.cross(b).normalize_or_zero();
        let u = (a.normalize_or_zero() + b.normalize_or_zero().cross(w)).normalize_or_zero();
        Self { p, u, v: w.cross(u), w }
    }

    /// The frame shifted by `by`, m, and turned about its centre by `turn`, rad, which is taken as small.
    pub fn displaced(&self, by: DVec3, turn: DVec3) -> Self {
        let q = DQuat::from_xyzw(0.5 * turn.x, 0.5 * turn.y, 0.5 * turn.z, 1.0).normalize();
        Self { p: self.p + by, u: q * self.u, v: q * self.v, w: q * self.w }
    }

    /// Corners at `rho` from the centre, m.
    pub fn corners(&self, rho: f64) -> SectionCorners {
        corners(|c| self.p + rho * (COS[c] * self.u + SIN[c] * self.v))
    }

    /// From coordinates along (u, v, w) to the world's, as directions.
    pub fn matrix(&self) -> DMat3 {
        DMat3::from_cols(self.u, self.v, self.w)
    }

    /// Corners that ride on the frame. `local`: in its coordinates, m.
    pub fn to_world(&self, local: &SectionCorners) -> SectionCorners {
        let m = self.matrix();
        corners(|c| self.p + m * corner(local, c))
    }

    /// The opposite of [`SectionFrame::to_world`].
    pub fn to_local(&self, x: &SectionCorners) -> SectionCorners {
        let m = self.matrix().transpose();
        corners(|c| m * (corner(x, c) - self.p))
    }

    /// Turn from space whose +Y runs along the rod and +X towards corner 0, as nodes of plants have it.
    pub fn rotation(&self) -> DQuat {
        DQuat::from_mat3(&DMat3::from_cols(self.u, self.w, -self.v)).normalize()
    }
}

/// How three corners move as one body: v = mean, omega = I^-1 sum r x v; and a force and a torque on that body as forces on
/// the corners, which add up to just these.
/// Source: the map W of M_last = diag(m) + W^T M W. Own: [yang-wu] leaves it open.
#[derive(Debug, Clone, Copy)]
pub struct RigidSectionMap {
    /// Centre, m.
    pub p: DVec3,
    /// From the centre to the corners, m.
    arms: [DVec3; 3],
    /// Inverse of I = sum(|r|^2 1 - r r^T), 1/m^2.
    inverse: DMat3,
}

impl RigidSectionMap {
    /// Of some corners, which must not lie on a line.
    pub fn from_corners(x: &SectionCorners) -> Self {
        let p = centroid(x);
        let arms = [0, 1, 2].map(|c| corner(x, c) - p);
        let mut i = DMat3::ZERO;
        for r in arms {
            i += DMat3::from_diagonal(DVec3::splat(r.length_squared())) - outer(r, r);
        }
        Self { p, arms, inverse: i.inverse() }
    }

    /// Velocity of the centre, m/s, and turning, rad/s, of corners that move with `v`.
    pub fn rigid_velocity(&self, v: &SectionCorners) -> (DVec3, DVec3) {
        let spin = (0..3).fold(DVec3::ZERO, |s, c| s + self.arms[c].cross(corner(v, c)));
        (centroid(v), self.inverse * spin)
    }

    /// Forces on the corners, N, of a force and a torque (N m) at the centre.
    pub fn corner_forces(&self, force: DVec3, torque: DVec3) -> SectionCorners {
        let t = self.inverse * torque;
        corners(|c| force / 3.0 + t.cross(self.arms[c]))
    }

    /// Velocities of corners that ride on the body, by those of its own: dV = J dx. `x`: where they are, m.
    pub fn attachment_jacobian(&self, x: &SectionCorners) -> Matrix9 {
        let mut j = [[0.0; 9]; 9];
        for c in 0..3 {
            let q = corner(x, c) - self.p;
            for a in 0..3 {
                // mean + omega x q, omega = I^-1 (r x dx).
                let m = DMat3::from_diagonal(DVec3::splat(1.0 / 3.0)) - cross(q) * self.inverse * cross(self.arms[a]);
                set_block(&mut j, c, a, &m);
            }
        }
        j
    }

    /// Mass of a body that rides on the corners, as a block over them. `at`: from the centre to the body's, m; `mass`, kg;
    /// `inertia` about its own centre, kg m^2, both in the world's directions.
    pub fn mass_matrix(&self, at: DVec3, mass: f64, inertia: DMat3) -> Matrix9 {
        let s = cross(at);
        // Momentum by velocity and turning, and the same for the moment of momentum about the centre of the section.
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

/// The matrix of a cross product: cross(a) b = a x b.
pub fn cross(a: DVec3) -> DMat3 {
    DMat3::from_cols(DVec3::new(0.0, a.z, -a.y), DVec3::new(-a.z, 0.0, a.x), DVec3::new(a.y, -a.x, 0.0))
}

fn outer(a: DVec3, b: DVec3) -> DMat3 {
    DMat3::from_cols(a * b.x, a * b.y, a * b.z)
}

/// Writes the 3x3 block that maps corner `a` to corner `c`.
fn set_block(block: &mut Matrix9, c: usize, a: usize, m: &DMat3) {
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

    fn some() -> (SectionFrame, SectionCorners) {
        let turn = DQuat::from_euler(glam::EulerRot::XYZ, 0.4, -1.1, 0.7);
        let frame =
            SectionFrame { p: DVec3::new(1.0, 2.0, -3.0), u: turn * DVec3::X, v: turn * DVec3::Y, w: turn * DVec3::Z };
        (frame, frame.corners(0.02))
    }

    #[test]
    fn corners_give_their_frame_back() {
        let (frame, x) = some();
        let again = SectionFrame::from_corners(&x);
        for (a, b) in [(frame.p, again.p), (frame.u, again.u), (frame.v, again.v), (frame.w, again.w)] {
            assert!((a - b).length() < 1e-12);
        }
        assert!((again.rotation() * DVec3::Y - frame.w).length() < 1e-12);
        assert!((again.rotation() * DVec3::Z + frame.v).length() < 1e-12);
    }

    #[test]
    fn a_wrench_on_the_corners_is_that_wrench() {
        let (_, x) = some();
        let grip = RigidSectionMap::from_corners(&x);
        let (force, torque) = (DVec3::new(1.0, -2.0, 0.5), DVec3::new(0.02, 0.01, -0.03));
        let f = grip.corner_forces(force, torque);
        let sum = (0..3).fold(DVec3::ZERO, |s, c| s + corner(&f, c));
        let turn = (0..3).fold(DVec3::ZERO, |s, c| s + (corner(&x, c) - grip.p).cross(corner(&f, c)));
        assert!((sum - force).length() < 1e-12 && (turn - torque).length() < 1e-12);
    }

    #[test]
    fn the_mass_of_a_body_is_its_energy() {
        let (_, x) = some();
        let grip = RigidSectionMap::from_corners(&x);
        let (v, w) = (DVec3::new(0.3, -0.2, 1.0), DVec3::new(2.0, 1.0, -1.5));
        let (at, mass, inertia) =
            (DVec3::new(0.05, 0.01, -0.02), 0.3, DMat3::from_diagonal(DVec3::new(1e-4, 2e-4, 3e-4)));
        let moved = corners(|c| v + w.cross(corner(&x, c) - grip.p));
        let m = grip.mass_matrix(at, mass, inertia);
        let energy = 0.5 * dot(&moved, &matrix_vector(&m, &moved));
        let own = 0.5 * mass * (v + w.cross(at)).length_squared() + 0.5 * w.dot(inertia * w);
        assert!((energy - own).abs() < 1e-12, "{energy} {own}");
    }
}
