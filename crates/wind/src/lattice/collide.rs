//! Collision: what happens to the air in one cell.

use super::stencil::{C, Q, W, weight};
use osier_base::simd::Lane;

/// Fastest equilibrium, in cells a step: beyond, the expansion of eq. 8 is worth nothing.
pub(super) const FASTEST: f64 = 0.3;
/// Where nothing is faster, nothing passes [`FASTEST`] in the next step.
pub(super) const FAST: f64 = 0.25;

/// How fast populations relax.
#[derive(Debug, Clone, Copy)]
pub(super) struct Relax<L> {
    /// Relaxation time without eddies, steps, above 1/2, and one over it.
    pub tau: L,
    pub omega: L,
    /// 18 sqrt(2) Cs^2.
    pub eddies: L,
    /// Body force, with the last switch of [`collide`].
    pub force: [L; 3],
}

impl<L: Lane> Relax<L> {
    #[inline(always)]
    pub(super) fn new(tau: L, eddies: L, force: [L; 3]) -> Self {
        Self { tau, omega: tau.splat(1.0).div(tau), eddies, force }
    }

    /// The same air with another relaxation time.
    #[inline(always)]
    pub(super) fn with(self, tau: L) -> Self {
        Self { tau, omega: tau.splat(1.0).div(tau), ..self }
    }
}

/// 18 sqrt(2) Cs^2 of a Smagorinsky constant.
pub(super) fn eddies(smagorinsky: f64) -> f64 {
    18.0 * std::f64::consts::SQRT_2 * smagorinsky * smagorinsky
}

/// Sums and differences of opposite populations.
struct Pairs<L> {
    rest: L,
    sum: [L; 7],
    difference: [L; 7],
}

impl<L: Lane> Pairs<L> {
    #[inline(always)]
    fn of(g: &[L; Q]) -> Self {
        let (mut sum, mut difference) = ([g[0]; 7], [g[0]; 7]);
        for k in 0..7 {
            sum[k] = g[2 * k + 1] + g[2 * k + 2];
            difference[k] = g[2 * k + 1] - g[2 * k + 2];
        }
        Self { rest: g[0], sum, difference }
    }

    #[inline(always)]
    fn diagonals(&self) -> L {
        (self.sum[3] + self.sum[4]) + (self.sum[5] + self.sum[6])
    }

    /// Deviation of the density from 1.
    #[inline(always)]
    fn density(&self) -> L {
        self.rest + (((self.sum[0] + self.sum[1]) + self.sum[2]) + self.diagonals())
    }

    #[inline(always)]
    fn momentum(&self) -> [L; 3] {
        let d = &self.difference;
        [
            d[0] + ((d[3] + d[4]) + (d[5] - d[6])),
            d[1] + ((d[3] + d[4]) - (d[5] - d[6])),
            d[2] + ((d[3] - d[4]) + (d[5] + d[6])),
        ]
    }

    /// Square of the stress that is not of the equilibrium, |Pi|^2. `back`: -1/rho; `j`: momentum.
    #[inline(always)]
    fn stress(&self, drho: L, j: [L; 3], back: L) -> L {
        let s = &self.sum;
        let diagonal = (drho * drho.splat(-1.0 / 3.0)) + self.diagonals();
        let xx = back.mul_add(j[0] * j[0], s[0] + diagonal);
        let yy = back.mul_add(j[1] * j[1], s[1] + diagonal);
        let zz = back.mul_add(j[2] * j[2], s[2] + diagonal);
        let (a, b, c, d) = (s[3] + s[4], s[5] + s[6], s[3] - s[4], s[5] - s[6]);
        let xy = back.mul_add(j[0] * j[1], a - b);
        let xz = back.mul_add(j[0] * j[2], c + d);
        let yz = back.mul_add(j[1] * j[2], c - d);
        let across = xy.mul_add(xy, xz.mul_add(xz, yz * yz));
        drho.splat(2.0).mul_add(across, xx.mul_add(xx, yy.mul_add(yy, zz * zz)))
    }
}

/// Density less 1, and velocity in cells a step, of populations.
/// Source: \[catkin\] eq. 4 and 5.
/// Differs: eq. 5 divides by a sound speed; momentum is sum c_i f_i.
#[inline(always)]
pub(super) fn moments<L: Lane>(g: &[L; Q]) -> (L, [L; 3]) {
    let pairs = Pairs::of(g);
    let drho = pairs.density();
    let share = drho.splat(1.0).div(drho.splat(1.0) + drho);
    let j = pairs.momentum();
    (drho, [j[0] * share, j[1] * share, j[2] * share])
}

/// Population `i` at equilibrium, less its weight.
/// Source: \[catkin\] eq. 8 with c = 1.
#[inline(always)]
pub(super) fn equilibrium<L: Lane>(i: usize, drho: L, u: [L; 3]) -> L {
    let rho = drho.splat(1.0) + drho;
    let c = C[i].map(|c| drho.splat(f64::from(c)));
    let s = (c[0] * u[0] + c[1] * u[1]) + c[2] * u[2];
    let uu = (u[0] * u[0] + u[1] * u[1]) + u[2] * u[2];
    let base = drho - drho.splat(1.5) * (rho * uu);
    drho.splat(weight(i)) * ((base + drho.splat(4.5) * (rho * (s * s))) + drho.splat(3.0) * (rho * s))
}

/// What a collision leaves.
#[derive(Debug, Clone, Copy)]
pub(super) struct Collided<L> {
    /// Populations less their weights.
    pub g: [L; Q],
    /// Density less 1, and velocity, held to [`FASTEST`]: the collision changes neither.
    pub drho: L,
    pub u: [L; 3],
    /// Square of the velocity before it was held.
    pub square: L,
}

/// A collision.
/// `g`: populations less their weights. `EDDIES`: with Smagorinsky's eddy viscosity; without it `relax.eddies` is unused.
/// The speed in the equilibrium is held to [`FASTEST`] where its square is above `limit`, which is infinite where nothing
/// can be near it; to count these cells is the caller's. `FORCE`: with a body force, which only flows with known solutions
/// need.
/// Source: \[catkin\] eq. 6 to 9; eddy viscosity: Hou, Sterling, Chen, Doolen 1996; force: Guo, Zheng, Shi 2002.
/// Differs: \[catkin\] gives no relaxation time; opposites are taken together, which saves half of the products.
#[inline(always)]
pub(super) fn collide<L: Lane, const EDDIES: bool, const FORCE: bool>(
    g: &[L; Q],
    relax: Relax<L>,
    limit: f64,
) -> Collided<L> {
    let one = relax.tau.splat(1.0);
    let pairs = Pairs::of(g);
    let drho = pairs.density();
    let rho = one + drho;
    let share = one.div(rho);
    let mut j = pairs.momentum();
    // What the populations have more than the momentum below; nothing, but for forces and what is held.
    let mut held = [one.splat(0.0); 3];
    if FORCE {
        for ((j, held), force) in j.iter_mut().zip(&mut held).zip(relax.force) {
            let half = one.splat(0.5) * force;
            (*j, *held) = (*j + half, *held - half);
        }
    }
    // Not from the velocities: nothing that can be found beside the division should wait for it.
    let square = share * (share * j[0].mul_add(j[0], j[1].mul_add(j[1], j[2] * j[2])));
    if limit.is_finite() && square.any_gt(limit) {
        let slower = square.select_gt(limit, one.splat(FASTEST).div(square.sqrt()), one);
        for (j, held) in j.iter_mut().zip(&mut held) {
            let less = *j * slower;
            (*j, *held) = (less, *held + (*j - less));
        }
    }
    let mut omega = relax.omega;
    if EDDIES {
        let tau = relax.tau;
        let stress = pairs.stress(drho, j, share * one.splat(-1.0)).sqrt();
        let tau = one.splat(0.5) * (tau + tau.mul_add(tau, relax.eddies * (stress * share)).sqrt());
        omega = one.div(tau);
    }
    let mut out = relaxed(&pairs, (drho, share), (j, held), omega);
    let u = [j[0] * share, j[1] * share, j[2] * share];
    if FORCE {
        for (i, out) in out.iter_mut().enumerate() {
            *out = *out + (one - one.splat(0.5) * omega) * pushed(i, u, relax.force);
        }
    }
    Collided { g: out, drho, u, square }
}

/// w_i [3 (c_i - u) + 9 (c_i.u) c_i].F
#[inline(always)]
fn pushed<L: Lane>(i: usize, u: [L; 3], force: [L; 3]) -> L {
    let mut along = u[0].splat(0.0);
    for a in 0..3 {
        along = along + u[a].splat(f64::from(C[i][a])) * u[a];
    }
    let mut sum = u[0].splat(0.0);
    for a in 0..3 {
        let c = u[a].splat(f64::from(C[i][a]));
        sum = sum + (u[a].splat(3.0) * (c - u[a]) + u[a].splat(9.0) * (along * c)) * force[a];
    }
    sum * u[0].splat(weight(i))
}

/// g - omega (g - geq), by pairs of opposites: geq = w e + 3 w s and w e - 3 w s. `share`: 1/rho; `j`: momentum rho u, from
/// which s is made, so that it keeps what the sums have found; `held`: what the populations have more.
///
/// Pairs are made of their sums and differences alone: the populations themselves, kept until then, would find no room in the
/// processor's registers, which takes a tenth of its time.
///
/// What relaxes of the pairs along the axes is not found anew but from the diagonals: all of it together moves nothing.
/// Found anew, it would leave the last bits of the momentum in every step, and those of some steps pile up.
#[inline(always)]
fn relaxed<L: Lane>(pairs: &Pairs<L>, (drho, share): (L, L), (j, held): ([L; 3], [L; 3]), omega: L) -> [L; Q] {
    let number = |value: f64| omega.splat(value);
    let (plus, minus) = (j[0] + j[1], j[0] - j[1]);
    // (-++): the fourth diagonal runs against x.
    let along = [j[0], j[1], j[2], plus + j[2], plus - j[2], minus + j[2], j[2] - minus];
    let square = number(-1.5) * j[0].mul_add(j[0], j[1].mul_add(j[1], j[2] * j[2]));
    let half = omega * number(-0.5);
    let mut out = [pairs.rest; Q];
    let rest = number(-W[0]).mul_add(share.mul_add(square, drho), pairs.rest);
    out[0] = (omega * number(-1.0)).mul_add(rest, pairs.rest);
    let mut odd = along;
    for k in 3..7 {
        odd[k] = number(-6.0 * W[2]).mul_add(along[k], pairs.difference[k]);
    }
    let (a, b, c, d) = (odd[3] + odd[4], odd[5] - odd[6], odd[3] - odd[4], odd[5] + odd[6]);
    odd[0] = held[0] - (a + b);
    odd[1] = held[1] - (a - b);
    odd[2] = held[2] - (c + d);
    let kept = half + number(0.5);
    let (straight, across) = (half * number(-2.0 * W[1]), half * number(-2.0 * W[2]));
    for k in 0..7 {
        // Little of it waits for the density.
        let bent = number(4.5).mul_add(along[k] * along[k], square);
        let meant = share.mul_add(bent, drho);
        let even = if k < 3 { straight } else { across }.mul_add(meant, kept * pairs.sum[k]);
        let odd = half.mul_add(odd[k], number(0.5) * pairs.difference[k]);
        out[2 * k + 1] = even + odd;
        out[2 * k + 2] = even - odd;
    }
    out
}
