//! The shape of a drop that lies on a leaf: a cap of a sphere, flattened by its weight, stretched and leaning as it runs.

use std::f64::consts::PI;

use osier_base::math;

/// Density of water, kg/m^3, and its surface tension, N/m.
pub const WATER: f64 = osier_base::physics::WATER_DENSITY;
/// See [`WATER`].
pub const TENSION: f64 = osier_base::physics::WATER_SURFACE_TENSION;

/// How drops are shaped.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CapShape {
    /// Flattened by weight, its volume kept.
    Flattened,
    /// The height of a half-high cap as the paper prints it: volume is not kept.
    Paper,
    /// The paper's wedge factor lambda^kappa.
    Wedge,
}

/// Contact angles and the factor on heights.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WettingParams {
    /// Contact angle at rest, where it gives way at the back and where it moves on at the front, rad.
    pub theta: f64,
    /// See `theta`.
    pub receding: f64,
    /// See `theta`.
    pub advancing: f64,
    /// Height factor; none for the one that weight gives.
    pub omega: Option<f64>,
    /// How it is shaped.
    pub shape: CapShape,
    /// The paper's lambda.
    pub lambda: f64,
    /// Capillary length, m.
    pub capillary: f64,
}

/// A cap.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SphericalCap {
    /// Radius of its sphere, m.
    pub r: f64,
    /// Radius of its base, m.
    pub a: f64,
    /// Factor on its height.
    pub omega: f64,
    /// Cosine of its contact angle.
    pub c: f64,
}

/// Volume of a cap of a unit sphere. Source: [yang-wu] eq. 5, as geometry has it.
pub fn unit_volume(theta: f64) -> f64 {
    let c = math::cos(theta);
    PI / 3.0 * (2.0 - 3.0 * c + c * c * c)
}

impl WettingParams {
    /// The cap of a volume, m^3. `facing`: cosine between the leaf's normal and the cap's, for the paper's wedge.
    /// Source: [yang-wu] eq. 6 and 19.
    pub fn cap(&self, volume: f64, facing: f64) -> SphericalCap {
        let c = math::cos(self.theta);
        let r = math::cbrt(volume.max(0.0) / unit_volume(self.theta));
        let omega = match self.shape {
            CapShape::Flattened => self.omega.unwrap_or_else(|| self.flatness(r * (1.0 - c))),
            CapShape::Paper => self.omega.unwrap_or(0.5),
            CapShape::Wedge => math::pow(self.lambda, facing.clamp(0.0, 1.0)),
        };
        let r = if self.shape == CapShape::Flattened { r / math::cbrt(omega) } else { r };
        SphericalCap { r, a: r * math::sin(self.theta), omega, c }
    }

    /// How much lower a cap of a height is for its weight: none can be higher than a puddle.
    fn flatness(&self, height: f64) -> f64 {
        let most = 2.0 * self.capillary * math::sin(0.5 * self.theta);
        let k = height / most;
        1.0 / math::sqrt(1.0 + k * k * k)
    }

    /// Volume of the cap with a base radius, m^3, without flattening.
    pub fn volume_of_base(&self, a: f64) -> f64 {
        let r = a / math::sin(self.theta);
        unit_volume(self.theta) * r * r * r
    }

    /// Most that a cap leans before it slips. Source: rim angles then meet the angles of hysteresis.
    pub fn lean(&self) -> f64 {
        let t = math::tan(self.theta);
        if self.theta >= 85.0_f64.to_radians() {
            return 0.4;
        }
        (math::tan(self.advancing) / t - 1.0).min(1.0 - math::tan(self.receding) / t).max(0.0)
    }
}

impl SphericalCap {
    /// Height above the leaf at a distance from its axis, as a share of the base radius; 0 outside.
    pub fn height(&self, rho: f64) -> f64 {
        let r1 = self.a * rho;
        let under = self.r * self.r - r1 * r1;
        if under <= 0.0 || (self.c >= 0.0 && rho >= 1.0) {
            return 0.0;
        }
        self.omega * (math::sqrt(under) - self.r * self.c).max(0.0)
    }

    /// Its height at the middle, m.
    pub fn top(&self) -> f64 {
        self.omega * self.r * (1.0 - self.c)
    }

    /// How far it reaches from its axis, m: its base, or its widest place where it overhangs.
    pub fn reach(&self) -> f64 {
        if self.c < 0.0 { self.r } else { self.a }
    }
}

/// How far a drop's own footprint lets it be seen from a place: the ellipse of its base.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Footprint {
    /// Stretch along its axis; across it is 1 / q.
    pub q: f64,
    /// How much higher its front is than its middle, and lower its back.
    pub skew: f64,
}

impl Footprint {
    /// Distance from the axis as a share of the base radius, and the factor by which a leaning drop is higher there.
    /// `along`, `across`: m.
    pub fn at(&self, a: f64, along: f64, across: f64) -> (f64, f64) {
        let (x, y) = (along / (a * self.q), across * self.q / a);
        let rho = math::sqrt(x * x + y * y);
        (rho, 1.0 + self.skew * x.clamp(-1.0, 1.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wetting(theta: f64, omega: Option<f64>, shape: CapShape) -> WettingParams {
        let theta = theta.to_radians();
        WettingParams { theta, receding: theta, advancing: theta, omega, shape, lambda: 1.05, capillary: 2.727e-3 }
    }

    /// By rings from the middle out.
    fn volume(cap: &SphericalCap, print: Footprint) -> f64 {
        let (n, m) = (2000, 64);
        let reach = cap.reach() / cap.a;
        let mut sum = 0.0;
        for i in 0..n {
            let rho = (f64::from(i) + 0.5) / f64::from(n) * reach;
            for k in 0..m {
                let phi = 2.0 * PI * f64::from(k) / f64::from(m);
                let (along, across) = (cap.a * rho * math::cos(phi) * print.q, cap.a * rho * math::sin(phi) / print.q);
                let (rho, lean) = print.at(cap.a, along, across);
                sum += cap.height(rho) * lean * rho * reach / f64::from(n) * 2.0 * PI / f64::from(m) * cap.a * cap.a;
            }
        }
        sum
    }

    #[test]
    fn caps_hold_their_volume() {
        for theta in [30.0, 45.0, 60.0, 75.0, 90.0] {
            for (omega, q, skew) in [(None, 1.0, 0.0), (Some(0.7), 1.4, 0.2), (None, 1.1, 0.26)] {
                let cap = wetting(theta, omega, CapShape::Flattened).cap(2e-8, 1.0);
                let found = volume(&cap, Footprint { q, skew });
                assert!((found / 2e-8 - 1.0).abs() < 0.01, "{theta} {omega:?}: {found}");
            }
        }
    }

    #[test]
    fn the_papers_shape_loses_water_at_sixty_degrees() {
        let cap = wetting(60.0, None, CapShape::Paper).cap(1e-8, 1.0);
        // As printed r sin(theta) is taken from the height, which leaves 0.0539 r^3 of a true 0.6545 r^3.
        assert!((unit_volume(60.0_f64.to_radians()) - 0.6545).abs() < 1e-4);
        assert!((volume(&cap, Footprint { q: 1.0, skew: 0.0 }) / 0.5e-8 - 1.0).abs() < 0.01);
    }

    #[test]
    fn big_drops_are_no_higher_than_puddles() {
        let w = wetting(60.0, None, CapShape::Flattened);
        assert!(w.cap(1e-6, 1.0).top() < 2.0 * 2.727e-3 * math::sin(30.0_f64.to_radians()));
        assert!((w.cap(1e-10, 1.0).omega - 1.0).abs() < 0.01);
    }
}
