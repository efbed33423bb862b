//! Sessile drops as spherical caps: flattened by gravity, stretched and sheared while they run.

use std::f64::consts::PI;

use crate::rain::tuning::{MAX_SKEW, NEAR_RIGHT_ANGLE, PAPER_HEIGHT_FACTOR};
use osier_base::math;

/// How the height of a sessile drop follows from its volume: by gravity, or by a rule of [yang-wu].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CapHeightRule {
    /// Flattened by gravity at constant volume; the only rule that conserves volume.
    Flattened,
    /// The fixed height factor that [yang-wu] prints, 0.5; does not conserve volume.
    Paper,
    /// The factor lambda^kappa of [yang-wu] eq. 19, where kappa is the cosine between the normal of the leaf and that of the cap at
    /// each place; does not conserve volume.
    Wedge,
}

/// Contact angles of water on a leaf, and the shape of drops that follows from them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WettingParams {
    /// Contact angle of a drop at rest, rad.
    pub contact_angle: f64,
    /// Contact angle below which the contact line at the rear of a drop recedes, rad.
    pub receding: f64,
    /// Contact angle above which the contact line at the front of a drop advances, rad.
    pub advancing: f64,
    /// Factor on the height of caps, except with [`CapHeightRule::Wedge`]; `None` for the factor of the rule.
    pub height_factor: Option<f64>,
    /// Rule by which gravity, `height_factor` or `wedge_base` sets the height of caps.
    pub shape: CapHeightRule,
    /// Base lambda of the height factor of [`CapHeightRule::Wedge`].
    pub wedge_base: f64,
    /// Capillary length sqrt(gamma / (rho g)), m; 2.7 mm for water on Earth.
    pub capillary_length: f64,
}

/// Quantities that caps of all volumes share: functions of the contact angle, and the rule for the height.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CapLaw {
    shape: CapHeightRule,
    /// Factor on the height; `None` for the factor of the rule.
    height_factor: Option<f64>,
    /// Sine of the contact angle.
    sine: f64,
    /// Cosine of the contact angle.
    cosine: f64,
    /// Volume of the cap of a unit sphere, m^3.
    unit_volume: f64,
    /// Height that puddles approach under gravity, m.
    puddle: f64,
    /// As in [`SphericalCap::wedge`].
    wedge: f64,
}

/// A cap of a sphere, scaled in height.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SphericalCap {
    /// Radius of the sphere, m.
    pub r: f64,
    /// Radius of the base (the contact line), r sin(contact angle), m.
    pub a: f64,
    /// Factor on the height above the base.
    pub height_factor: f64,
    /// Logarithm of a further factor where the cap's normal is that of the leaf; 0 for [`CapHeightRule::Flattened`] and
    /// [`CapHeightRule::Paper`]. Elsewhere it is multiplied by the cosine between both, at least 0.
    pub wedge: f64,
    /// Cosine of the contact angle; negative for a cap that overhangs its base.
    pub cos_angle: f64,
}

/// Volume of the cap of a unit sphere with contact angle `theta`, rad: pi / 3 (2 - 3 cos + cos^3).
/// Source: [yang-wu] eq. 5, corrected by geometry.
pub fn unit_cap_volume(theta: f64) -> f64 {
    let c = math::cos(theta);
    PI / 3.0 * (2.0 - 3.0 * c + c * c * c)
}

impl WettingParams {
    /// The cap of a drop of `volume`, m^3, at rest. For many drops, take the [law](WettingParams::cap_law) once.
    pub fn cap(&self, volume: f64) -> SphericalCap {
        self.cap_law().cap(volume)
    }

    /// The law of caps at these angles, with sines, cosines and the volume of a unit cap computed once.
    pub fn cap_law(&self) -> CapLaw {
        CapLaw {
            shape: self.shape,
            height_factor: self.height_factor,
            sine: math::sin(self.contact_angle),
            cosine: math::cos(self.contact_angle),
            unit_volume: unit_cap_volume(self.contact_angle),
            puddle: 2.0 * self.capillary_length * math::sin(0.5 * self.contact_angle),
            wedge: if self.shape == CapHeightRule::Wedge { math::ln(self.wedge_base) } else { 0.0 },
        }
    }

    /// Volume of the cap with base radius `a`, m, without flattening by gravity, m^3.
    pub fn volume_of_base(&self, a: f64) -> f64 {
        let r = a / math::sin(self.contact_angle);
        unit_cap_volume(self.contact_angle) * r * r * r
    }

    /// Largest skew of a cap before its contact line moves: the slope at the front then is that of the advancing angle, or at the
    /// rear that of the receding angle, whichever is reached first; at most `MAX_SKEW`.
    pub fn max_skew(&self) -> f64 {
        // The tangents diverge towards 90 degrees: from there on no shear of the height makes a slope so steep.
        let steep = |angle: f64| angle >= NEAR_RIGHT_ANGLE.to_radians();
        if steep(self.contact_angle) {
            return MAX_SKEW;
        }
        let slope = |angle: f64| math::tan(angle) / math::tan(self.contact_angle);
        let front = if steep(self.advancing) { MAX_SKEW } else { slope(self.advancing) - 1.0 };
        front.min(1.0 - slope(self.receding)).clamp(0.0, MAX_SKEW)
    }
}

impl CapLaw {
    /// The cap of a drop of `volume`, m^3. Source: [yang-wu] eq. 6 and 19.
    pub fn cap(&self, volume: f64) -> SphericalCap {
        // The sphere whose cap has this volume: V = r^3 V_1(theta).
        let r = math::cbrt(volume.max(0.0) / self.unit_volume);
        let gravity_factor = || self.gravity_height_factor(r * (1.0 - self.cosine));
        let height_factor = match self.shape {
            CapHeightRule::Flattened => self.height_factor.unwrap_or_else(gravity_factor),
            CapHeightRule::Paper => self.height_factor.unwrap_or(PAPER_HEIGHT_FACTOR),
            CapHeightRule::Wedge => 1.0,
        };
        // Volume is proportional to the height factor and to r^3: a flatter cap is wider by its inverse cube root.
        let r = if self.shape == CapHeightRule::Flattened { r / math::cbrt(height_factor) } else { r };
        SphericalCap { r, a: r * self.sine, height_factor, wedge: self.wedge, cos_angle: self.cosine }
    }

    /// Height factor by which gravity flattens a cap of `height`, m. It blends between a sphere and a puddle, whose height is
    /// 2 l sin(theta / 2) with the capillary length l: heights approach that limit and never exceed it.
    fn gravity_height_factor(&self, height: f64) -> f64 {
        // With k = height / puddle the factor is (1 + k^3)^(-1/2): 1 for small drops.
        let k = height / self.puddle;
        1.0 / math::sqrt(1.0 + k * k * k)
    }
}

impl SphericalCap {
    /// Height above the leaf, m, at `rho` base radii from the axis; 0 outside of the cap.
    /// h = factor (sqrt(r^2 - a^2 rho^2) - r cos(theta)).
    pub fn height(&self, rho: f64) -> f64 {
        let r1 = self.a * rho;
        let under = self.r * self.r - r1 * r1;
        // A cap that overhangs is wider than its base: it ends at the sphere's equator, not at the contact line.
        if under <= 0.0 || (self.cos_angle >= 0.0 && rho >= 1.0) {
            return 0.0;
        }
        let cosine = math::sqrt(under) / self.r;
        self.height_factor_at(cosine) * (self.r * (cosine - self.cos_angle)).max(0.0)
    }

    /// Factor on the height where the normal of the sphere has this cosine with that of the leaf.
    pub fn height_factor_at(&self, cosine: f64) -> f64 {
        if self.wedge == 0.0 {
            return self.height_factor;
        }
        self.height_factor * math::exp(self.wedge * cosine.max(0.0))
    }

    /// Height at the axis, m, the largest of the cap.
    pub fn top(&self) -> f64 {
        self.height_factor_at(1.0) * self.r * (1.0 - self.cos_angle)
    }

    /// Largest distance of the cap from its axis, m: the base radius, or the sphere's radius if it overhangs.
    pub fn widest_radius(&self) -> f64 {
        if self.cos_angle < 0.0 { self.r } else { self.a }
    }
}

/// Deformation of a cap that runs or is about to run: its base is an ellipse of the same area, its height is sheared forwards.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CapDeformation {
    /// Factor on the base radius along the drop's axis; across it the factor is 1 / `stretch`.
    pub stretch: f64,
    /// Relative change of the height from the middle to the front; the rear is lower by as much.
    pub skew: f64,
}

/// A point of the undeformed cap that corresponds to a point of a deformed one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct UndeformedPoint {
    /// Distance from the axis in base radii of the undeformed cap.
    pub rho: f64,
    /// Factor on the height there: above 1 towards the front, below 1 towards the rear.
    pub height_factor: f64,
}

impl CapDeformation {
    /// A circle without shear.
    pub const ROUND: Self = Self { stretch: 1.0, skew: 0.0 };

    /// Maps a point at `along` and `across` the drop's axis, m, to the undeformed cap of base radius `a`, m.
    pub fn to_undeformed(&self, a: f64, along: f64, across: f64) -> UndeformedPoint {
        // Stretch s along and 1 / s across the axis keep the area, hence the volume.
        let (x, y) = (along / (a * self.stretch), across * self.stretch / a);
        let rho = math::sqrt(x * x + y * y);
        UndeformedPoint { rho, height_factor: 1.0 + self.skew * x.clamp(-1.0, 1.0) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wetting(theta: f64, omega: Option<f64>, shape: CapHeightRule) -> WettingParams {
        let theta = theta.to_radians();
        WettingParams {
            contact_angle: theta,
            receding: theta,
            advancing: theta,
            height_factor: omega,
            shape,
            wedge_base: 1.05,
            capillary_length: 2.727e-3,
        }
    }

    /// Volume of a deformed cap by a quadrature over rings and azimuths.
    fn volume(cap: &SphericalCap, deformation: CapDeformation) -> f64 {
        let (n, m) = (2000, 64);
        let reach = cap.widest_radius() / cap.a;
        let mut sum = 0.0;
        for i in 0..n {
            let rho = (f64::from(i) + 0.5) / f64::from(n) * reach;
            for k in 0..m {
                let phi = 2.0 * PI * f64::from(k) / f64::from(m);
                let (along, across) = (
                    cap.a * rho * math::cos(phi) * deformation.stretch,
                    cap.a * rho * math::sin(phi) / deformation.stretch,
                );
                let UndeformedPoint { rho, height_factor } = deformation.to_undeformed(cap.a, along, across);
                sum += cap.height(rho) * height_factor * rho * reach / f64::from(n) * 2.0 * PI / f64::from(m)
                    * cap.a
                    * cap.a;
            }
        }
        sum
    }

    #[test]
    fn caps_hold_their_volume() {
        for theta in [30.0, 45.0, 60.0, 75.0, 90.0] {
            for (omega, q, skew) in [(None, 1.0, 0.0), (Some(0.7), 1.4, 0.2), (None, 1.1, 0.26)] {
                let cap = wetting(theta, omega, CapHeightRule::Flattened).cap(2e-8);
                let found = volume(&cap, CapDeformation { stretch: q, skew });
                assert!((found / 2e-8 - 1.0).abs() < 0.01, "{theta} {omega:?}: {found}");
            }
        }
    }

    #[test]
    fn the_papers_shape_loses_water_at_sixty_degrees() {
        let cap = wetting(60.0, None, CapHeightRule::Paper).cap(1e-8);
        // As printed r sin(theta) is taken from the height, which leaves 0.0539 r^3 of a true 0.6545 r^3.
        assert!((unit_cap_volume(60.0_f64.to_radians()) - 0.6545).abs() < 1e-4);
        assert!((volume(&cap, CapDeformation::ROUND) / 0.5e-8 - 1.0).abs() < 0.01);
    }

    #[test]
    fn big_drops_are_no_higher_than_puddles() {
        let w = wetting(60.0, None, CapHeightRule::Flattened);
        assert!(w.cap(1e-6).top() < 2.0 * 2.727e-3 * math::sin(30.0_f64.to_radians()));
        assert!((w.cap(1e-10).height_factor - 1.0).abs() < 0.01);
    }

    #[test]
    fn the_wedge_raises_a_cap_by_the_cosine_of_its_own_normal() {
        let plain = wetting(60.0, Some(1.0), CapHeightRule::Flattened).cap(1e-8);
        let raised = wetting(60.0, None, CapHeightRule::Wedge).cap(1e-8);
        for rho in [0.0, 0.3, 0.6, 0.9] {
            let sine = rho * plain.a / plain.r;
            let wanted = math::pow(1.05, math::sqrt(1.0 - sine * sine));
            assert!((raised.height(rho) / plain.height(rho) - wanted).abs() < 1e-12, "{rho}");
        }
        assert!((raised.top() / plain.top() - 1.05).abs() < 1e-12);
    }

    #[test]
    fn drops_lean_where_only_the_front_is_steep() {
        let skew = |receding: f64, theta: f64, advancing: f64| {
            let [receding, advancing] = [receding, advancing].map(f64::to_radians);
            WettingParams { receding, advancing, ..wetting(theta, None, CapHeightRule::Flattened) }.max_skew()
        };
        assert!((skew(52.0, 60.0, 68.0) - 0.261).abs() < 1e-3, "{}", skew(52.0, 60.0, 68.0));
        assert!((skew(50.0, 72.0, 95.0) - MAX_SKEW).abs() < 1e-12 && (skew(50.0, 72.0, 84.9) - MAX_SKEW).abs() < 1e-12);
        assert!(skew(60.0, 60.0, 95.0) < 1e-12, "without hysteresis at the rear it runs before it leans");
    }
}
