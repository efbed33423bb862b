//! Collision of one cell: single-relaxation-time (BGK) lattice Boltzmann with a Smagorinsky eddy viscosity.
//!
//! Populations are stored as deviations g_i = f_i - w_i from air at rest, so that f32 keeps its digits for the flow.
//! Opposite directions are treated as pairs: the even part g_i + g_opp carries density and stress, the odd part
//! g_i - g_opp carries momentum. Each part of the equilibrium is then needed once for two directions.

use super::stencil::{Q, VELOCITIES, WEIGHTS, weight};
use osier_base::simd::Lane;

/// Highest speed at which the equilibrium is evaluated, cells per step. The second-order expansion (eq. 8) assumes |u| <<
/// 1/sqrt(3); at higher speeds it becomes negative for some directions and the scheme diverges.
/// |u| << 1/sqrt(3); above, it turns negative for some directions and the scheme diverges.
pub(super) const MAX_SPEED: f64 = 0.3;
/// Speed, cells per step, up to which no cell can exceed [`MAX_SPEED`] in the next step: while no cell of a plane is faster, the
/// kernel omits the speed test. Higher: a cell may exceed the limit unnoticed. Lower: more planes run the slower kernel.
pub(super) const UNCHECKED_SPEED: f64 = 0.25;

/// How populations relax towards the equilibrium.
#[derive(Debug, Clone, Copy)]
pub(super) struct Relaxation<L> {
    /// Relaxation time of the molecular viscosity, steps, above 1/2: nu = (tau - 1/2)/3.
    pub tau: L,
    /// Relaxation rate, 1/tau.
    pub omega: L,
    /// 18 sqrt(2) Cs^2, see [`smagorinsky_factor`].
    pub smagorinsky_factor: L,
    /// Body force, cells per step squared; used where `FORCE` of [`collide`] is set.
    pub force: [L; 3],
}

impl<L: Lane> Relaxation<L> {
    #[inline(always)]
    pub(super) fn new(tau: L, smagorinsky_factor: L, force: [L; 3]) -> Self {
        Self { tau, omega: tau.splat(1.0).div(tau), smagorinsky_factor, force }
    }

    /// The same eddy viscosity and body force with another molecular relaxation time.
    #[inline(always)]
    pub(super) fn with_tau(self, tau: L) -> Self {
        Self { tau, omega: tau.splat(1.0).div(tau), ..self }
    }
}

/// 18 sqrt(2) Cs^2 of a Smagorinsky constant Cs: the factor of |Pi|/rho in the effective relaxation time.
pub(super) fn smagorinsky_factor(constant: f64) -> f64 {
    18.0 * std::f64::consts::SQRT_2 * constant * constant
}

/// Populations as even and odd parts of opposite directions: three pairs along the axes, four along the diagonals.
struct EvenOddPopulations<L> {
    rest: L,
    /// Even parts g_i + g_opp of the pairs.
    even: [L; 7],
    /// Odd parts g_i - g_opp of the pairs.
    odd: [L; 7],
}

impl<L: Lane> EvenOddPopulations<L> {
    #[inline(always)]
    fn new(g: &[L; Q]) -> Self {
        let (mut even, mut odd) = ([g[0]; 7], [g[0]; 7]);
        // Directions 2k+1 and 2k+2 are opposite; direction 0 is at rest.
        for k in 0..7 {
            even[k] = g[2 * k + 1] + g[2 * k + 2];
            odd[k] = g[2 * k + 1] - g[2 * k + 2];
        }
        Self { rest: g[0], even, odd }
    }

    #[inline(always)]
    fn sum_of_diagonal_pairs(&self) -> L {
        (self.even[3] + self.even[4]) + (self.even[5] + self.even[6])
    }

    /// Zeroth moment: density less 1.
    #[inline(always)]
    fn density(&self) -> L {
        self.rest + (((self.even[0] + self.even[1]) + self.even[2]) + self.sum_of_diagonal_pairs())
    }

    /// First moment: sum c_i f_i, to which even parts contribute nothing.
    #[inline(always)]
    fn momentum(&self) -> [L; 3] {
        // Each axis pair adds to one axis; a diagonal pair counts with the signs of its first member: (+++), (++-), (+-+), (-++).
        let d = &self.odd;
        [
            d[0] + ((d[3] + d[4]) + (d[5] - d[6])),
            d[1] + ((d[3] + d[4]) - (d[5] - d[6])),
            d[2] + ((d[3] - d[4]) + (d[5] + d[6])),
        ]
    }

    /// |Pi|^2 of the non-equilibrium stress Pi = sum c c (f - f_eq). `momentum`: rho u; `minus_inverse_density`: -1/rho.
    #[inline(always)]
    fn stress_squared(&self, drho: L, momentum: [L; 3], minus_inverse_density: L) -> L {
        let (s, j) = (&self.even, momentum);
        // Second moments of the populations less those of the equilibrium, rho/3 + j_a j_b / rho. The deviations g lack the part
        // of rho/3 that the weights contribute.
        let diagonal = (drho * drho.splat(-1.0 / 3.0)) + self.sum_of_diagonal_pairs();
        let xx = minus_inverse_density.mul_add(j[0] * j[0], s[0] + diagonal);
        let yy = minus_inverse_density.mul_add(j[1] * j[1], s[1] + diagonal);
        let zz = minus_inverse_density.mul_add(j[2] * j[2], s[2] + diagonal);
        // Only the diagonal directions contribute to the off-diagonal moments, with the sign of c_a c_b.
        let (a, b, c, d) = (s[3] + s[4], s[5] + s[6], s[3] - s[4], s[5] - s[6]);
        let xy = minus_inverse_density.mul_add(j[0] * j[1], a - b);
        let xz = minus_inverse_density.mul_add(j[0] * j[2], c + d);
        let yz = minus_inverse_density.mul_add(j[1] * j[2], c - d);
        let off_diagonal = xy.mul_add(xy, xz.mul_add(xz, yz * yz));
        drho.splat(2.0).mul_add(off_diagonal, xx.mul_add(xx, yy.mul_add(yy, zz * zz)))
    }
}

/// Density less 1, and velocity in cells per step, of populations.
/// Source: \[catkin\] eq. 4 and 5.
/// Differs: eq. 5 divides by a sound speed; momentum is sum c_i f_i.
#[inline(always)]
pub(super) fn moments<L: Lane>(g: &[L; Q]) -> (L, [L; 3]) {
    // u = j/rho with rho = 1 + drho.
    let pairs = EvenOddPopulations::new(g);
    let drho = pairs.density();
    let inverse_density = drho.splat(1.0).div(drho.splat(1.0) + drho);
    let j = pairs.momentum();
    (drho, [j[0] * inverse_density, j[1] * inverse_density, j[2] * inverse_density])
}

/// Population `i` at equilibrium, less its weight.
/// Source: \[catkin\] eq. 8 with c = 1.
#[inline(always)]
pub(super) fn equilibrium<L: Lane>(i: usize, drho: L, u: [L; 3]) -> L {
    // w_i [drho + rho (3 c.u + 4.5 (c.u)^2 - 1.5 u^2)]: eq. 8 less the weight w_i of air at rest.
    let rho = drho.splat(1.0) + drho;
    let c = VELOCITIES[i].map(|c| drho.splat(f64::from(c)));
    let cu = (c[0] * u[0] + c[1] * u[1]) + c[2] * u[2];
    let uu = (u[0] * u[0] + u[1] * u[1]) + u[2] * u[2];
    let base = drho - drho.splat(1.5) * (rho * uu);
    drho.splat(weight(i)) * ((base + drho.splat(4.5) * (rho * (cu * cu))) + drho.splat(3.0) * (rho * cu))
}

/// State of a cell after its collision.
#[derive(Debug, Clone, Copy)]
pub(super) struct CollisionResult<L> {
    /// Populations less their weights.
    pub g: [L; Q],
    /// Density less 1; the collision does not change it.
    pub drho: L,
    /// Velocity, cells per step, clamped to [`MAX_SPEED`]; the collision does not change it.
    pub u: [L; 3],
    /// Square of the speed before clamping.
    pub speed_squared: L,
}

/// Collides one cell (or one cell per lane).
/// `g`: populations less their weights. `EDDIES`: with Smagorinsky's eddy viscosity; else `smagorinsky_factor` is unused.
/// The speed in the equilibrium is clamped to [`MAX_SPEED`] where its square is above `limit`; an infinite `limit` leaves
/// the test out. The caller counts clamped cells. `FORCE`: with a body force, which only validation flows need.
/// Source: \[catkin\] eq. 6 to 9; eddy viscosity: Hou, Sterling, Chen, Doolen 1996; force: Guo, Zheng, Shi 2002.
/// Differs: \[catkin\] gives no relaxation time; opposite directions are relaxed as pairs, which halves the products.
#[inline(always)]
pub(super) fn collide<L: Lane, const EDDIES: bool, const FORCE: bool>(
    g: &[L; Q],
    relaxation: Relaxation<L>,
    limit: f64,
) -> CollisionResult<L> {
    let one = relaxation.tau.splat(1.0);
    // Moments: density and momentum j = rho u.
    let pairs = EvenOddPopulations::new(g);
    let drho = pairs.density();
    let rho = one + drho;
    let inverse_density = one.div(rho);
    let mut j = pairs.momentum();
    // Momentum of the populations in excess of the equilibrium's j: nonzero only with a force or after clamping.
    let mut excess = [one.splat(0.0); 3];
    if FORCE {
        // Guo's scheme: the velocity includes half of the force.
        for ((j, excess), force) in j.iter_mut().zip(&mut excess).zip(relaxation.force) {
            let half = one.splat(0.5) * force;
            (*j, *excess) = (*j + half, *excess - half);
        }
    }
    // Compute |u|^2 = |j|^2 / rho^2 with |j|^2 from the momentum: unlike the velocity, it does not have to wait for the division
    // 1/rho.
    let speed_squared = inverse_density * (inverse_density * j[0].mul_add(j[0], j[1].mul_add(j[1], j[2] * j[2])));
    if limit.is_finite() && speed_squared.any_gt(limit) {
        // Shorten j to the speed limit. The remainder stays in the populations and relaxes as non-equilibrium momentum.
        let scale = speed_squared.select_gt(limit, one.splat(MAX_SPEED).div(speed_squared.sqrt()), one);
        for (j, excess) in j.iter_mut().zip(&mut excess) {
            let clamped = *j * scale;
            (*j, *excess) = (clamped, *excess + (*j - clamped));
        }
    }
    let mut omega = relaxation.omega;
    if EDDIES {
        // Smagorinsky: tau_eff = (tau + sqrt(tau^2 + 18 sqrt(2) Cs^2 |Pi|/rho)) / 2, in closed form since the strain rate
        // is local in the non-equilibrium stress Pi.
        let tau = relaxation.tau;
        let stress = pairs.stress_squared(drho, j, inverse_density * one.splat(-1.0)).sqrt();
        let tau = one.splat(0.5)
            * (tau + tau.mul_add(tau, relaxation.smagorinsky_factor * (stress * inverse_density)).sqrt());
        omega = one.div(tau);
    }
    let mut out = relax_pairs(&pairs, drho, inverse_density, j, excess, omega);
    let u = [j[0] * inverse_density, j[1] * inverse_density, j[2] * inverse_density];
    if FORCE {
        for (i, out) in out.iter_mut().enumerate() {
            *out = *out + (one - one.splat(0.5) * omega) * force_term(i, u, relaxation.force);
        }
    }
    CollisionResult { g: out, drho, u, speed_squared }
}

/// Forcing term of Guo et al. for direction `i`: w_i [3 (c_i - u) + 9 (c_i.u) c_i].F
#[inline(always)]
fn force_term<L: Lane>(i: usize, u: [L; 3], force: [L; 3]) -> L {
    let mut cu = u[0].splat(0.0);
    for (u, c) in u.into_iter().zip(VELOCITIES[i]) {
        cu = cu + u.splat(f64::from(c)) * u;
    }
    let mut sum = u[0].splat(0.0);
    for a in 0..3 {
        let c = u[a].splat(f64::from(VELOCITIES[i][a]));
        sum = sum + (u[a].splat(3.0) * (c - u[a]) + u[a].splat(9.0) * (cu * c)) * force[a];
    }
    sum * u[0].splat(weight(i))
}

/// The relaxed populations g - omega (g - g_eq), pair by pair.
///
/// With s = c_i.u and e = drho + rho (4.5 s^2 - 1.5 u^2) the equilibria of a pair are w (e + 3 rho s) and w (e - 3 rho s), so
/// their even part is 2 w e and their odd part 6 w rho s. `momentum`: j = rho u; `excess`: momentum of the populations in excess
/// of it.
///
/// Results are formed from even and odd parts alone: keeping the fifteen populations until here would exceed the
/// processor's registers and cost a tenth of the time.
#[inline(always)]
fn relax_pairs<L: Lane>(
    pairs: &EvenOddPopulations<L>,
    drho: L,
    inverse_density: L,
    momentum: [L; 3],
    excess: [L; 3],
    omega: L,
) -> [L; Q] {
    let number = |value: f64| omega.splat(value);
    let j = momentum;
    // c_i.j of the seven pairs. (-++): the fourth diagonal runs against x.
    let (plus, minus) = (j[0] + j[1], j[0] - j[1]);
    let along = [j[0], j[1], j[2], plus + j[2], plus - j[2], minus + j[2], j[2] - minus];
    // -1.5 j^2; times 1/rho it is the -1.5 rho u^2 of the equilibrium.
    let square = number(-1.5) * j[0].mul_add(j[0], j[1].mul_add(j[1], j[2] * j[2]));
    let half = omega * number(-0.5);
    let mut out = [pairs.rest; Q];
    // Rest population: g_0 - omega (g_0 - w_0 (drho - 1.5 rho u^2)).
    let rest = number(-WEIGHTS[0]).mul_add(inverse_density.mul_add(square, drho), pairs.rest);
    out[0] = (omega * number(-1.0)).mul_add(rest, pairs.rest);
    // Odd non-equilibrium parts of the diagonals: (g_i - g_opp) - 6 w c_i.j.
    let mut odd = along;
    for k in 3..7 {
        odd[k] = number(-6.0 * WEIGHTS[2]).mul_add(along[k], pairs.odd[k]);
    }
    // Derive the axis-aligned odd parts from the diagonal ones, so that all odd non-equilibrium parts together carry exactly
    // `excess`: relaxation then does not change the last bits of the momentum. Computed independently like the diagonals, they
    // would change these bits in every step, and the errors accumulate.
    let (a, b, c, d) = (odd[3] + odd[4], odd[5] - odd[6], odd[3] - odd[4], odd[5] + odd[6]);
    odd[0] = excess[0] - (a + b);
    odd[1] = excess[1] - (a - b);
    odd[2] = excess[2] - (c + d);
    // Each direction gets half of each part: even part (1 - omega)/2 (g_i + g_opp) + omega w e, and odd part (g_i - g_opp)/2 -
    // omega/2 times its non-equilibrium part.
    let kept = half + number(0.5);
    let (axis_weight, diagonal_weight) = (half * number(-2.0 * WEIGHTS[1]), half * number(-2.0 * WEIGHTS[2]));
    for k in 0..7 {
        // The operations are ordered so that few of them wait for the division 1/rho.
        let quadratic = number(4.5).mul_add(along[k] * along[k], square);
        let even_equilibrium = inverse_density.mul_add(quadratic, drho);
        let even = if k < 3 { axis_weight } else { diagonal_weight }.mul_add(even_equilibrium, kept * pairs.even[k]);
        let odd = half.mul_add(odd[k], number(0.5) * pairs.odd[k]);
        out[2 * k + 1] = even + odd;
        out[2 * k + 2] = even - odd;
    }
    out
}
