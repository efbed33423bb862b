//! Beam theory of a branch: slope under load, natural frequency, large deflections, and time steps of an oscillator.

use glam::{DQuat, DVec3, Quat, Vec3};
use pulp::{Scalar, Simd};

use crate::lanes::Vec3Lanes;
use osier_base::math;
use osier_base::simd::{F64Lanes, Lane as _};

/// Squared slope below which the series of atan(x) / x is exact to 1e-10.
const SERIES_LIMIT: f64 = 0.05;

/// Slope at `x`, 0 at the base to 1 at the tip, divided by the slope of the tip, for a cantilever under a uniform load:
/// P = 3 x - 3 x^2 + x^3.
pub fn uniform_load_slope(x: f64) -> f64 {
    let x = x.clamp(0.0, 1.0);
    x * (3.0 - x * (3.0 - x))
}

/// Slope along a bent branch, relative to that of its tip.
#[derive(Debug, Clone, Default, PartialEq)]
pub enum SlopeProfile {
    /// A uniform cantilever under a uniform load.
    #[default]
    Even,
    /// Computed from taper and load: values at equidistant points from base to tip.
    Table(Vec<f64>),
}

impl SlopeProfile {
    /// Slope at `x`, 0 at the base to 1 at the tip, divided by the slope of the tip.
    pub fn at(&self, x: f64) -> f64 {
        let Self::Table(table) = self else { return uniform_load_slope(x) };
        // Linear interpolation between the entries around x.
        let last = table.len().saturating_sub(1);
        let place = x.clamp(0.0, 1.0) * last as f64;
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few dozen")]
        let k = (place as usize).min(last.saturating_sub(1));
        match (table.get(k), table.get(k + 1)) {
            (Some(a), Some(b)) => a + (b - a) * (place - k as f64),
            _ => uniform_load_slope(x),
        }
    }

    /// Integral of [`SlopeProfile::at`] from the base to `x`, 0 to 1: the deflection at `x` divided by the length and by the tip slope.
    pub fn integral(&self, x: f64) -> f64 {
        let x = x.clamp(0.0, 1.0);
        // The integral of P = 3 x - 3 x^2 + x^3.
        let Self::Table(table) = self else { return x * x * (1.5 - x * (1.0 - x * 0.25)) };
        // Trapezoids between the entries are exact, since `at` is linear between them.
        let h = 1.0 / table.len().saturating_sub(1).max(1) as f64;
        let mut sum = 0.0;
        for k in 0..table.len().saturating_sub(1) {
            let from = k as f64 * h;
            let to = x.min(from + h);
            if to <= from {
                break;
            }
            sum += 0.5 * (self.at(from) + self.at(to)) * (to - from);
        }
        sum
    }
}

/// Ratio of the second natural frequency of a uniform cantilever to the first.
pub const SECOND_MODE_FREQUENCY_RATIO: f64 = 6.27;

/// Relative slope of a uniform cantilever's second mode: a node of the deflection lies at 0.783, and the slope
/// vanishes at 0.471.
/// Source: Euler's beam, clamped and free; b L = 4.694 solves cos(b L) cosh(b L) = -1.
pub fn second_mode_slope(x: f64) -> f64 {
    const BETA: f64 = 4.694_091_132_974_175;
    let x = x.clamp(0.0, 1.0) * BETA;
    // Derivative of the mode shape cosh - cos - sigma (sinh - sin), up to a factor.
    let slope = |x: f64| {
        let (up, down) = (math::exp(x), math::exp(-x));
        let sigma = (math::exp(BETA) - math::exp(-BETA) - 2.0 * math::sin(BETA))
            / (math::exp(BETA) + math::exp(-BETA) + 2.0 * math::cos(BETA));
        0.5 * (up - down) + math::sin(x) - sigma * (0.5 * (up + down) - math::cos(x))
    };
    slope(x) / slope(BETA)
}

/// Factor on small-deflection slopes, from their square: atan(x) / x keeps the tip below a right angle. Own: it meets
/// the elastica within 1 % up to a load of F L^2 / (E I) = 2 at the tip.
#[inline(always)]
pub(crate) fn large_deflection_factor<S: Simd>(square: F64Lanes<S>) -> F64Lanes<S> {
    let one = F64Lanes::from_scalar(square.simd, 1.0);
    let near = atan_series(square);
    if square.all_lt(SERIES_LIMIT) {
        return near;
    }
    // Halve the angle three times, tan(a/2) = x / (1 + sqrt(1 + x^2)), until the series converges.
    let (mut s, mut k) = (square, one);
    for _ in 0..3 {
        let down = one + (one + s).sqrt();
        k = (k + k).div(down);
        s = s.div(down * down);
    }
    square.select_lt(SERIES_LIMIT, near, atan_series(s) * k)
}

/// The series of atan(x) / x in x^2, exact to 1e-10 below [`SERIES_LIMIT`].
#[inline(always)]
fn atan_series<S: Simd>(s: F64Lanes<S>) -> F64Lanes<S> {
    let mut sum = F64Lanes::from_scalar(s.simd, 1.0 / 13.0);
    for c in [1.0 / 11.0, 1.0 / 9.0, 1.0 / 7.0, 0.2, 1.0 / 3.0, 1.0] {
        sum = F64Lanes::from_scalar(s.simd, c) - s * sum;
    }
    sum
}

/// Polynomial c0 + c1 h + c2 h^2 + ..., in two halves that the processor evaluates in parallel.
#[inline(always)]
fn power_series<S: Simd>(c: &[f64; 7], h: F64Lanes<S>) -> F64Lanes<S> {
    // Estrin's scheme: two short dependency chains in place of one of seven products.
    let (h2, h3) = (h * h, h * h * h);
    let low = F64Lanes::from_scalar(h.simd, c[0]) + h * c[1] + h2 * c[2];
    low + h3 * ((F64Lanes::from_scalar(h.simd, c[3]) + h * c[4] + h2 * c[5]) + h3 * c[6])
}

/// Quaternions (x, y, z, w) of rotation vectors, rad. Exact to 1e-12 up to 1.6 rad: no branch bends farther.
#[inline(always)]
pub(crate) fn rotation_lanes<S: Simd>(v: Vec3Lanes<S>) -> [F64Lanes<S>; 4] {
    // sin(a/2)/a and cos(a/2) as series of (a/2)^2: products only, this is called millions of times.
    const SIN: [f64; 7] =
        [1.0, -1.0 / 6.0, 1.0 / 120.0, -1.0 / 5040.0, 1.0 / 362_880.0, -1.0 / 39_916_800.0, 1.0 / 6_227_020_800.0];
    const COS: [f64; 7] =
        [1.0, -0.5, 1.0 / 24.0, -1.0 / 720.0, 1.0 / 40_320.0, -1.0 / 3_628_800.0, 1.0 / 479_001_600.0];
    let h = v.dot(v) * 0.25;
    let (Vec3Lanes([x, y, z]), cos) = (v * (power_series(&SIN, h) * 0.5), power_series(&COS, h));
    [x, y, z, cos]
}

/// Unit quaternion of a rotation vector, rad; exact to 1e-12 up to 1.6 rad.
pub fn rotation_from_vector(v: DVec3) -> DQuat {
    let [x, y, z, w] =
        rotation_lanes(Vec3Lanes(v.to_array().map(|c| F64Lanes::from_scalar(Scalar, c)))).map(F64Lanes::scalar);
    DQuat::from_xyzw(x, y, z, w)
}

/// As [`rotation_from_vector`] in single precision, for output.
pub fn rotation_f32(v: Vec3) -> Quat {
    rotation_from_vector(v.as_dvec3()).as_quat()
}

/// A straight beam clamped at its base, discretized at stations of given stiffness and mass.
#[derive(Debug, Clone, Default)]
pub struct CantileverBeam {
    /// Distance from the base, m, rising from 0.
    pub x: Vec<f64>,
    /// Bending stiffness E I at the stations, N m^2.
    pub rigidity: Vec<f64>,
    /// Bending stiffness halfway to the next station, N m^2, for Simpson's rule.
    pub between: Vec<f64>,
    /// Mass at the stations, kg.
    pub mass: Vec<f64>,
}

impl CantileverBeam {
    /// Multiplies the bending stiffness at all stations and between them.
    pub fn stiffen(&mut self, factor: f64) {
        self.rigidity.iter_mut().chain(&mut self.between).for_each(|r| *r *= factor);
    }

    /// Tip slope per unit transverse force at each station, 1/N: c(s) = integral of (s - x) / (E I) over x from 0 to s.
    pub fn compliance(&self) -> Vec<f64> {
        let (mut c, mut slope) = (0.0, 0.0);
        let mut list = vec![0.0];
        for i in 1..self.x.len() {
            let h = self.x[i] - self.x[i - 1];
            let [a, m, b] = [self.rigidity[i - 1], self.between[i - 1], self.rigidity[i]].map(inverse_rigidity);
            // Simpson's rule on each interval, with c' = integral of 1 / (E I) and c'' = 1 / (E I).
            c += h * slope + h * h / 6.0 * (a + 2.0 * m);
            slope += h / 6.0 * (a + 4.0 * m + b);
            list.push(c);
        }
        list
    }

    /// Transverse deflection of each station, m, under transverse loads. `load`: N, one per station.
    pub fn deflection(&self, load: &[f64]) -> Vec<f64> {
        self.deflection_and_slope(load).into_iter().map(|b| b[0]).collect()
    }

    /// Slope of each station divided by that of the tip, under transverse loads, N; `None` for a rigid beam.
    pub fn relative_slope(&self, load: &[f64]) -> Option<Vec<f64>> {
        let bent = self.deflection_and_slope(load);
        let tip = bent.last().map_or(0.0, |b| b[1]);
        (tip > 0.0).then(|| bent.iter().map(|b| b[1] / tip).collect())
    }

    /// Deflection, m, and slope of the stations under transverse loads, N.
    fn deflection_and_slope(&self, load: &[f64]) -> Vec<[f64; 2]> {
        let n = self.x.len();
        // Shear force and bending moment from the tip inwards, then M / (E I) integrated twice from the base outwards.
        let (mut shear, mut moment) = (vec![0.0; n], vec![0.0; n]);
        for i in (0..n.saturating_sub(1)).rev() {
            shear[i] = shear[i + 1] + load[i + 1];
            moment[i] = moment[i + 1] + shear[i] * (self.x[i + 1] - self.x[i]);
        }
        let (mut y, mut slope) = (0.0, 0.0);
        let mut list = vec![[0.0; 2]];
        for i in 1..n {
            let h = self.x[i] - self.x[i - 1];
            let a = moment[i - 1] * inverse_rigidity(self.rigidity[i - 1]);
            let m = 0.5 * (moment[i - 1] + moment[i]) * inverse_rigidity(self.between[i - 1]);
            let b = moment[i] * inverse_rigidity(self.rigidity[i]);
            y += h * slope + h * h / 6.0 * (a + 2.0 * m);
            slope += h / 6.0 * (a + 4.0 * m + b);
            list.push([y, slope]);
        }
        list
    }

    /// Fundamental angular frequency, rad/s.
    /// Source: A. Stodola, "Dampf- und Gasturbinen", 1922, with Rayleigh's quotient; two iterations are within 0.15 %.
    pub fn fundamental_angular_frequency(&self) -> f64 {
        let mut load = self.mass.clone();
        let mut square = 0.0;
        // Stodola: the next shape is the deflection under the inertial loads of the last one. Rayleigh: w^2 = sum q y / sum m y^2.
        for _ in 0..2 {
            let y = self.deflection(&load);
            let work = load.iter().zip(&y).fold(0.0, |s, (q, y)| s + q * y);
            let moved = self.mass.iter().zip(&y).fold(0.0, |s, (m, y)| s + m * y * y);
            let most = y.iter().fold(0.0_f64, |m, y| m.max(*y));
            if moved <= 0.0 || most <= 0.0 {
                return 0.0;
            }
            square = work / moved;
            load = self.mass.iter().zip(&y).map(|(m, y)| m * y / most).collect();
        }
        math::sqrt(square)
    }
}

/// 1 / (E I); 0 for wood of zero thickness, which carries no load.
fn inverse_rigidity(rigidity: f64) -> f64 {
    if rigidity > 1e-12 { rigidity.recip() } else { 0.0 }
}

/// Exact step of a damped oscillator under constant load. From the distance y from equilibrium and the velocity v follow those
/// after the step: y' = a y + b v and v' = c y + d v.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OscillatorStep {
    /// From displacement to displacement.
    a: f64,
    /// From velocity to displacement, s.
    b: f64,
    /// From displacement to velocity, 1/s.
    c: f64,
    /// From velocity to velocity.
    d: f64,
}

impl OscillatorStep {
    /// `w`: natural angular frequency, rad/s; `zeta`: damping ratio; `h`: step, s.
    /// Source: the solution of b'' + 2 zeta w b' + w^2 b = 0.
    pub fn new(w: f64, zeta: f64, h: f64) -> Self {
        // Critical damping: the limit of both other cases.
        if (1.0 - zeta).abs() < 1e-4 {
            let e = math::exp(-w * h);
            return Self { a: e * (1.0 + w * h), b: e * h, c: -e * w * w * h, d: e * (1.0 - w * h) };
        }
        // Solution of the homogeneous equation over the step h.
        let e = math::exp(-zeta * w * h);
        // Damped frequency; with overdamping sine and cosine become hyperbolic.
        let wd = w * math::sqrt((1.0 - zeta * zeta).abs());
        let (c, s) = if zeta < 1.0 {
            (math::cos(wd * h), math::sin(wd * h))
        } else {
            let (up, down) = (math::exp(wd * h), math::exp(-wd * h));
            (0.5 * (up + down), 0.5 * (up - down))
        };
        // y(h) = e^(-zeta w h) (y (cos + k sin) + v sin / wd), and its derivative.
        let k = zeta * w / wd;
        Self { a: e * (c + k * s), b: e * s / wd, c: -e * w * w / wd * s, d: e * (c - k * s) }
    }

    /// Quasi-static step for modes above the frame rate: relaxes to equilibrium with the time constant 1/w, without
    /// oscillation.
    pub fn first_order_lag(w: f64, h: f64) -> Self {
        Self { a: math::exp(-w * h), b: 0.0, c: 0.0, d: 0.0 }
    }

    /// Coefficients a, b, c, d of y' = a y + b v and v' = c y + d v, as in the fields.
    pub fn coefficients(&self) -> [f64; 4] {
        [self.a, self.b, self.c, self.d]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PI: f64 = std::f64::consts::PI;

    fn square(x: f64) -> f64 {
        x * x
    }

    fn quad(x: f64) -> f64 {
        square(x) * square(x)
    }

    /// A rod of length `l` from radius `r0` to `r1`.
    fn rod(l: f64, r0: f64, r1: f64, (e, density): (f64, f64), n: usize) -> CantileverBeam {
        let h = l / n as f64;
        let r = |x: f64| r0 + (r1 - r0) * x / l;
        let stiff = |x: f64| e * PI / 4.0 * quad(r(x));
        let x: Vec<f64> = (0..=n).map(|i| i as f64 * h).collect();
        let mass = |x: &f64| {
            let (a, b) = ((x - h / 2.0).max(0.0), (x + h / 2.0).min(l));
            // Simpson's rule over the stretch of the station: exact, since r^2 is quadratic.
            density * PI * (b - a) / 6.0 * (square(r(a)) + 4.0 * square(r((a + b) / 2.0)) + square(r(b)))
        };
        CantileverBeam {
            rigidity: x.iter().map(|x| stiff(*x)).collect(),
            between: x.iter().map(|x| stiff((x + h / 2.0).min(l))).collect(),
            mass: x.iter().map(mass).collect(),
            x,
        }
    }

    #[test]
    fn slopes_add_up_to_the_deflection() {
        let table = SlopeProfile::Table((0..=32).map(|k| uniform_load_slope(f64::from(k) / 32.0)).collect());
        for x in [0.0, 0.2, 0.53, 1.0] {
            let expected =
                (0..1000).map(|k| uniform_load_slope((f64::from(k) + 0.5) * x / 1000.0) * x / 1000.0).sum::<f64>();
            assert!((SlopeProfile::Even.integral(x) - expected).abs() < 1e-6);
            assert!((table.integral(x) - expected).abs() < 1e-3, "{x}");
        }
    }

    #[test]
    fn cantilever_deflection_matches_the_closed_form() {
        for n in [16, 32, 64] {
            let beam = rod(1.2, 0.01, 0.01, (8e9, 900.0), n);
            let mut tip = vec![0.0; n + 1];
            tip[n] = 1.0;
            assert!((beam.deflection(&tip)[n] / 9.167e-3 - 1.0).abs() < 5e-3);
            assert!((beam.compliance()[n] / 0.01146 - 1.0).abs() < 5e-3);
            let even: Vec<f64> = (0..=n).map(|i| if i == 0 || i == n { 0.5 } else { 1.0 } / n as f64).collect();
            assert!((beam.deflection(&even)[n] / 3.438e-3 - 1.0).abs() < 5e-3);
            let slope = beam.compliance().iter().zip(&even).map(|(c, f)| c * f).sum::<f64>();
            assert!((slope / 0.003820 - 1.0).abs() < 5e-3, "{slope}");
        }
    }

    #[test]
    fn rod_and_cone_frequencies_match_beam_theory() {
        for (end, lambda) in [(1.0, 3.516), (0.5, 4.625), (0.25, 5.823), (0.1, 7.205), (0.0, 8.72)] {
            let (l, r, e, density) = (1.2, 0.01, 8e9, 900.0);
            let beam = rod(l, r, r * end, (e, density), 32);
            let unit = math::sqrt(e * PI / 4.0 * quad(r) / (density * PI * r * r)) / (l * l);
            let found = beam.fundamental_angular_frequency() / unit;
            assert!((found / lambda - 1.0).abs() < 5e-3, "radius to {end}: {found} for {lambda}");
        }
        let hertz = |l: f64, r: f64| rod(l, r, r, (8e9, 900.0), 32).fundamental_angular_frequency() / (2.0 * PI);
        for (l, r, f) in [(12.0, 0.2, 1.16), (3.5, 0.035, 2.38), (1.2, 0.01, 5.79), (0.4, 0.003, 15.6)] {
            assert!((hertz(l, r) / f - 1.0).abs() < 5e-3);
        }
    }

    #[test]
    fn measured_slopes_match_the_closed_form() {
        let even = |n: usize| -> Vec<f64> { (0..=n).map(|i| if i == 0 || i == n { 0.5 } else { 1.0 }).collect() };
        let table =
            SlopeProfile::Table(rod(1.2, 0.01, 0.01, (8e9, 900.0), 32).relative_slope(&even(32)).expect("bends"));
        for x in [0.0, 0.1, 0.35, 0.5, 0.8, 1.0] {
            assert!(
                (table.at(x) - uniform_load_slope(x)).abs() < 2e-3,
                "{x}: {} for {}",
                table.at(x),
                uniform_load_slope(x)
            );
        }
        // A cone whose load grows with its radius, cut at half of it: slopes by quadrature.
        let r = |x: f64| 1.0 - 0.5 * x;
        let sum = |f: &dyn Fn(f64) -> f64, a: f64, b: f64| {
            (0..400).map(|i| f(a + (b - a) * (f64::from(i) + 0.5) / 400.0)).sum::<f64>() * (b - a) / 400.0
        };
        let curve = |x: f64| sum(&|s| (s - x) * r(s), x, 1.0) / quad(r(x));
        let load: Vec<f64> = even(32).iter().enumerate().map(|(i, w)| w * r(i as f64 / 32.0)).collect();
        let table = SlopeProfile::Table(rod(1.2, 0.01, 0.005, (8e9, 900.0), 32).relative_slope(&load).expect("bends"));
        for x in [0.2, 0.5, 0.8] {
            let expected = sum(&curve, 0.0, x) / sum(&curve, 0.0, 1.0);
            assert!((table.at(x) - expected).abs() < 5e-3, "{x}: {} for {expected}", table.at(x));
            assert!(expected < uniform_load_slope(x) - 0.02, "thin ends bend more");
        }
    }

    #[test]
    fn second_mode_matches_beam_theory() {
        assert!(second_mode_slope(0.0).abs() < 1e-12 && (second_mode_slope(1.0) - 1.0).abs() < 1e-12);
        assert!(
            second_mode_slope(0.4709).abs() < 2e-3 && second_mode_slope(0.3) < -0.2 && second_mode_slope(0.6) > 0.2
        );
        // At a node of the deflection the integral of the slope is 0.
        let place =
            |end: f64| (0..1000).map(|i| second_mode_slope(end * (f64::from(i) + 0.5) / 1000.0)).sum::<f64>() * end;
        assert!(place(0.77) < 0.0 && place(0.80) > 0.0, "{} {}", place(0.77), place(0.80));
        assert!((SECOND_MODE_FREQUENCY_RATIO / (22.034 / 3.516) - 1.0).abs() < 1e-3);
    }

    #[test]
    fn large_bends_match_the_elastica() {
        // Deflection over length for F L^2 / (E I), even load: as computed and exact.
        let table = [
            (0.1, 0.0125, 0.0125),
            (0.5, 0.0623, 0.0625),
            (1.0, 0.1234, 0.1235),
            (2.0, 0.2381, 0.2385),
            (4.0, 0.4217, 0.4252),
            (8.0, 0.6214, 0.6406),
            (16.0, 0.7479, 0.7970),
        ];
        for (alpha, expected, exact) in table {
            let (y, length) = shape(large(alpha / 6.0));
            assert!((y - expected).abs() < 1e-3, "{alpha}: {y} for {expected}");
            assert!((y / exact - 1.0).abs() < 0.07 && (length - 1.0).abs() < 1e-6);
        }
        for alpha in [0.0, 1e6] {
            let (y, length) = shape(large(alpha));
            assert!(y.is_finite() && (length - 1.0).abs() < 1e-6);
        }
    }

    /// Rotation vector of the tip for the slope of the theory of small deflections.
    fn large(slope: f64) -> DVec3 {
        DVec3::NEG_Z * slope * large_deflection_factor(F64Lanes::from_scalar(Scalar, slope * slope)).scalar()
    }

    /// Position and velocity after a step. `rest`: position of equilibrium.
    fn step(swing: &OscillatorStep, [place, rate]: [f64; 2], rest: f64) -> [f64; 2] {
        let ([a, b, c, d], y) = (swing.coefficients(), place - rest);
        [rest + a * y + b * rate, c * y + d * rate]
    }

    #[test]
    fn large_deflection_factor_is_atan_over_x() {
        for x in [1e-9, 0.01, 0.1, 0.2235, 0.2237, 1.0, 3.0, 100.0, 1e6] {
            let found = large_deflection_factor(F64Lanes::from_scalar(Scalar, x * x)).scalar() * x;
            assert!((found - math::atan(x)).abs() < 1e-10 * math::atan(x), "{x}: {found}");
        }
    }

    /// Deflection and length of an upright rod of 1 m for the bend of its tip.
    fn shape(bend: DVec3) -> (f64, f64) {
        let n = 2000;
        let (mut p, mut length) = (DVec3::ZERO, 0.0);
        for i in 0..n {
            let step = rotation_from_vector(bend * uniform_load_slope((f64::from(i) + 0.5) / f64::from(n))) * DVec3::Y
                / f64::from(n);
            length += step.length();
            p += step;
        }
        (p.x, length)
    }

    #[test]
    fn rotation_series_matches_the_exact_rotation() {
        for a in [0.0, 1e-6, 0.3, 1.0, 1.57] {
            let axis = DVec3::new(0.6, 0.0, 0.8);
            let (q, e) = (rotation_from_vector(axis * a), DQuat::from_axis_angle(axis, a));
            assert!((q - e).length() < 1e-11, "{a}");
        }
    }

    #[test]
    fn oscillation_decays_by_the_logarithmic_decrement() {
        for (zeta, decrement) in [(0.05, 0.3146), (0.08, 0.5043), (0.12, 0.7595), (0.2, 1.2826)] {
            let (f, h) = (1.7, 1e-3);
            let swing = OscillatorStep::new(2.0 * PI * f, zeta, h);
            let (mut state, mut crossings, mut peaks) = ([1.0, 0.0], Vec::new(), Vec::new());
            for k in 0..6000_u32 {
                let next = step(&swing, state, 0.0);
                if state[0] > 0.0 && next[0] <= 0.0 {
                    crossings.push(f64::from(k) + state[0] / (state[0] - next[0]));
                }
                if state[1] > 0.0 && next[1] <= 0.0 {
                    peaks.push(next[0].max(state[0]));
                }
                state = next;
            }
            let period = (crossings[2] - crossings[0]) / 2.0 * h;
            let expected = 1.0 / (f * math::sqrt(1.0 - zeta * zeta));
            assert!((period / expected - 1.0).abs() < 2e-3, "{period} {expected}");
            let found = math::ln(peaks[0] / peaks[1]);
            assert!((found / decrement - 1.0).abs() < 5e-3, "{zeta}: {found} for {decrement}");
        }
    }

    #[test]
    fn oscillator_step_is_exact_and_conserves_energy() {
        for zeta in [0.0, 0.1, 0.99995, 1.0, 1.5, 3.0] {
            let w = 5.0;
            let ring = |h: f64, n: u32| (0..n).fold([1.0, 0.5], |s, _| step(&OscillatorStep::new(w, zeta, h), s, 0.2));
            let (coarse, fine) = (ring(1.0 / 30.0, 30), ring(1.0 / 1000.0, 1000));
            assert!((coarse[0] - fine[0]).abs() < 1e-6 && (coarse[1] - fine[1]).abs() < 1e-5, "{zeta}");
        }
        for zeta in [1.0, 1.7, 3.0] {
            let swing = OscillatorStep::new(7.0, zeta, 0.01);
            let mut state = [1.0, 0.0];
            for _ in 0..2000 {
                state = step(&swing, state, 0.0);
                assert!(state[0] >= -1e-12, "overshoot at {zeta}");
            }
        }
        let (w, swing) = (6.0, OscillatorStep::new(6.0, 0.0, 0.01));
        let energy = |s: [f64; 2]| s[1] * s[1] + w * w * s[0] * s[0];
        let end = (0..100_000).fold([1.0, 0.0], |s, _| step(&swing, s, 0.0));
        assert!((energy(end) / energy([1.0, 0.0]) - 1.0).abs() < 1e-6);
    }
}
