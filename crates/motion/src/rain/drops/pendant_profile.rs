//! Pendant drops: the maximum volume that an attachment holds, and axisymmetric profiles by the Young-Laplace equation.
//!
//! Lengths are in units of the capillary length l = sqrt(gamma / (rho g)) where a name says `scaled`, otherwise in metres.

use std::f64::consts::PI;

use crate::rain::tuning::{
    MAX_PENDANT_STRETCH, MIN_GRAVITY, NECK_LENGTHENING, NECK_POSITION, NECK_THINNING, NECK_WAIST, NECKED_SHIFT_START,
};
use osier_base::math;
use osier_base::physics::{WATER_DENSITY, WATER_SURFACE_TENSION};

/// A row of the table of maximum pendant volumes: a radius of attachment and the volume that hangs from it.
#[derive(Debug, Clone, Copy)]
struct MaxVolumeRow {
    /// Radius of attachment of water on Earth, mm.
    radius: f64,
    /// Maximum volume as a fraction of 2 pi R gamma / (rho g), the volume whose weight equals surface tension around the circle.
    fraction: f64,
}

const fn max_volume_row(radius: f64, fraction: f64) -> MaxVolumeRow {
    MaxVolumeRow { radius, fraction }
}

/// Maximum volumes by radius of attachment. Source: Young-Laplace profiles at the limit of stability; the test
/// `the_table_is_what_the_shapes_give` computes them.
const MAX_VOLUME_TABLE: [MaxVolumeRow; 11] = [
    max_volume_row(0.3, 0.838),
    max_volume_row(0.4, 0.815),
    max_volume_row(0.5, 0.797),
    max_volume_row(0.6, 0.784),
    max_volume_row(0.75, 0.769),
    max_volume_row(1.0, 0.753),
    max_volume_row(1.25, 0.743),
    max_volume_row(1.5, 0.734),
    max_volume_row(1.75, 0.721),
    max_volume_row(2.0, 0.699),
    max_volume_row(2.25, 0.657),
];
/// Capillary length for which the table's radii are given, mm.
const TABLE_CAPILLARY_LENGTH: f64 = 2.727;
/// Arc length of an integration step, in capillary lengths: 0.02 mm for water on Earth.
const ARC_STEP: f64 = 0.02 / TABLE_CAPILLARY_LENGTH;
/// Largest number of integration steps of a profile: 40 mm of arc for water on Earth.
const MAX_ARC_STEPS: u32 = 2000;

/// Smallest and largest radius of attachment of the table, in capillary lengths.
pub const RADIUS_RANGE: [f64; 2] = [0.3 / TABLE_CAPILLARY_LENGTH, 2.25 / TABLE_CAPILLARY_LENGTH];

/// Maximum volume that hangs from a circle of `radius`, m, under gravity `g`, m/s^2: in m^3.
pub fn max_pendant_volume(radius: f64, g: f64) -> f64 {
    // Profiles are similar in capillary lengths, so that the table serves any gravity.
    let length = math::sqrt(WATER_SURFACE_TENSION / (WATER_DENSITY * g.max(MIN_GRAVITY)));
    let x = (radius / length * TABLE_CAPILLARY_LENGTH).clamp(MAX_VOLUME_TABLE[0].radius, MAX_VOLUME_TABLE[10].radius);
    let k = MAX_VOLUME_TABLE.partition_point(|row| row.radius <= x).clamp(1, 10);
    let (a, b) = (MAX_VOLUME_TABLE[k - 1], MAX_VOLUME_TABLE[k]);
    let c = a.fraction + (b.fraction - a.fraction) * (x - a.radius) / (b.radius - a.radius);
    c * 2.0 * PI * radius * WATER_SURFACE_TENSION / (WATER_DENSITY * g.max(MIN_GRAVITY))
}

/// Points (x, z) of the profile of an axisymmetric drop from its apex up: distance from the axis and height over the apex, m.
pub type PendantProfile = Vec<[f64; 2]>;

/// On which side of its greatest width a profile ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum ProfileEnd {
    /// Below it, where the radius still grows with height.
    Widening,
    /// Above it, where the radius falls again.
    Narrowing,
}

/// A profile in capillary lengths, with the volume that it encloses.
#[derive(Debug, Clone)]
struct DimensionlessProfile {
    points: PendantProfile,
    /// Volume in cubic capillary lengths.
    volume: f64,
}

/// Integrates the Young-Laplace equation from the apex, of radius of curvature `b`, up to the attachment of `radius`, all in
/// capillary lengths. `None` if the profile does not reach that radius on the branch `end`.
fn integrate_profile(b: f64, radius: f64, end: ProfileEnd) -> Option<DimensionlessProfile> {
    // With arc length s and tangent angle f: dx/ds = cos f, dz/ds = sin f, and the sum of the principal curvatures df/ds and
    // sin(f) / x equals the pressure 2/b - z. At the apex both curvatures are 1/b.
    let slope = |[x, z, f]: [f64; 3]| {
        let bend = if x < 1e-9 { 1.0 / b } else { 2.0 / b - z - math::sin(f) / x };
        [math::cos(f), math::sin(f), bend]
    };
    let mut s = [0.0, 0.0, 0.0];
    let mut points = vec![[0.0, 0.0]];
    let mut volume = 0.0;
    let mut past_widest = false;
    for _ in 0..MAX_ARC_STEPS {
        // Classical fourth-order Runge-Kutta.
        let add = |a: [f64; 3], k: [f64; 3], h: f64| [a[0] + h * k[0], a[1] + h * k[1], a[2] + h * k[2]];
        let k1 = slope(s);
        let k2 = slope(add(s, k1, ARC_STEP / 2.0));
        let k3 = slope(add(s, k2, ARC_STEP / 2.0));
        let k4 = slope(add(s, k3, ARC_STEP));
        let mut next = s;
        (0..3).for_each(|i| next[i] += ARC_STEP / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]));
        // Volume of the conical frustum between two points.
        let frustum = |a: [f64; 3], b: [f64; 3]| PI * (b[1] - a[1]) * (a[0] * a[0] + a[0] * b[0] + b[0] * b[0]) / 3.0;
        let crossed = match end {
            ProfileEnd::Widening => next[0] >= radius,
            ProfileEnd::Narrowing => past_widest && next[0] <= radius,
        };
        if crossed {
            // End exactly at the attachment, by linear interpolation within the step.
            let t = (radius - s[0]) / (next[0] - s[0]);
            let last = [radius, s[1] + t * (next[1] - s[1]), next[2]];
            volume += frustum(s, last);
            points.push([last[0], last[1]]);
            return Some(DimensionlessProfile { points, volume });
        }
        if next[0] < s[0] {
            if end == ProfileEnd::Widening {
                return None;
            }
            past_widest = true;
        } else if past_widest {
            // The neck: from here on the profile widens again and does not reach the radius.
            return None;
        }
        volume += frustum(s, next);
        s = next;
        points.push([s[0], s[1]]);
    }
    None
}

/// The family of profiles of one radius of attachment. Its limits are found once, as they cost more than a profile.
#[derive(Debug, Clone, Copy)]
pub struct PendantFamily {
    /// Capillary length, m.
    capillary_length: f64,
    /// Radius of attachment, m.
    radius: f64,
    /// Radius of attachment in capillary lengths, within [`RADIUS_RANGE`].
    scaled_radius: f64,
    /// Apex radius at which the profile's end changes from [`ProfileEnd::Widening`] to [`ProfileEnd::Narrowing`].
    scaled_turn: f64,
    /// Apex radius of the profile of maximum volume.
    scaled_last: f64,
}

impl PendantFamily {
    /// Profiles from a circle of `radius`, m, under gravity `g`, m/s^2.
    pub fn new(radius: f64, g: f64) -> Self {
        let capillary_length = math::sqrt(WATER_SURFACE_TENSION / (WATER_DENSITY * g.max(MIN_GRAVITY)));
        let scaled_radius = (radius / capillary_length).clamp(RADIUS_RANGE[0], RADIUS_RANGE[1]);
        let scaled_turn = min_widening_apex_radius(scaled_radius);
        let scaled_last = apex_radius_of_max_volume(scaled_turn, scaled_radius);
        Self { capillary_length, radius, scaled_radius, scaled_turn, scaled_last }
    }

    /// The profile of a drop of `volume`, m^3, from the apex to the attachment. Above the maximum volume it is the profile of
    /// the maximum, lengthened. Source: Young-Laplace equation.
    pub fn profile(&self, volume: f64) -> PendantProfile {
        let l = self.capillary_length;
        let target = volume / (l * l * l);
        let DimensionlessProfile { points, volume: reached } = self.profile_of_scaled_volume(target);
        let stretch = if target > reached { (target / reached).min(MAX_PENDANT_STRETCH) } else { 1.0 };
        // A radius outside of the table's range is met by scaling the profile horizontally.
        let horizontal = self.radius / self.scaled_radius;
        points.iter().map(|[x, z]| [x * horizontal, z * l * stretch]).collect()
    }

    /// The profile whose volume is nearest to `target`, in cubic capillary lengths. Volume grows along the family: first the
    /// apex radius falls while the profile ends on its widening branch, then it rises on the narrowing branch.
    fn profile_of_scaled_volume(&self, target: f64) -> DimensionlessProfile {
        let r = self.scaled_radius;
        let at_turn = integrate_profile(self.scaled_turn, r, ProfileEnd::Widening);
        let (mut lo, mut hi, end) = if at_turn.is_some_and(|profile| target <= profile.volume) {
            (60.0 * r, self.scaled_turn, ProfileEnd::Widening)
        } else {
            (self.scaled_turn, self.scaled_last, ProfileEnd::Narrowing)
        };
        // If neither limit has a profile, use a cone with the volume of a half ball.
        let half_ball = DimensionlessProfile { points: vec![[0.0, 0.0], [r, r]], volume: 2.0 / 3.0 * PI * r * r * r };
        let mut best = integrate_profile(hi, r, end).or_else(|| integrate_profile(lo, r, end)).unwrap_or(half_ball);
        if end == ProfileEnd::Narrowing && best.volume <= target {
            return best;
        }
        // Bisection of the apex radius; `lo` has too little volume, `hi` too much or no profile.
        for _ in 0..32 {
            let b = 0.5 * (lo + hi);
            match integrate_profile(b, r, end) {
                Some(profile) if profile.volume < target => {
                    lo = b;
                    best = profile;
                }
                Some(profile) => {
                    hi = b;
                    best = profile;
                }
                None => hi = b,
            }
        }
        best
    }
}

/// The smallest radius of curvature at the apex, in capillary lengths, with which a profile still widens to the radius `r`.
fn min_widening_apex_radius(r: f64) -> f64 {
    // Bracket the limit, then bisect; without gravity the limit would be r, the radius of a half ball.
    let (mut lo, mut hi) = (0.5 * r, 4.0 * r);
    while integrate_profile(hi, r, ProfileEnd::Widening).is_none() && hi < 100.0 * r {
        hi *= 1.5;
    }
    for _ in 0..48 {
        let b = 0.5 * (lo + hi);
        if integrate_profile(b, r, ProfileEnd::Widening).is_some() {
            hi = b;
        } else {
            lo = b;
        }
    }
    hi
}

/// The radius of curvature at the apex of the profile of maximum volume, in capillary lengths, searched upwards from `turn`.
fn apex_radius_of_max_volume(turn: f64, r: f64) -> f64 {
    // Coarse search: volume grows with the apex radius until profiles end at their neck.
    let mut best = turn;
    let mut max_volume = 0.0;
    let mut b = turn;
    for _ in 0..400 {
        b *= 1.01;
        match integrate_profile(b, r, ProfileEnd::Narrowing) {
            Some(profile) if profile.volume > max_volume => (best, max_volume) = (b, profile.volume),
            _ => break,
        }
    }
    // Refine the apex radius by bisection within the last coarse step.
    let (mut lo, mut hi) = (best, best * 1.02);
    for _ in 0..30 {
        let b = 0.5 * (lo + hi);
        match integrate_profile(b, r, ProfileEnd::Narrowing) {
            Some(profile) if profile.volume >= max_volume => (lo, max_volume) = (b, profile.volume),
            _ => hi = b,
        }
    }
    lo
}

/// The profile of a necking drop at `progress`, 0 to 1, of the time until it detaches: the neck narrows, the drop lengthens, and
/// the body below takes up the water of the neck. Volume is conserved. Source: own, after photographs.
pub fn profile_while_necking(profile: &[[f64; 2]], progress: f64) -> PendantProfile {
    let Some([_, length]) = profile.last().copied().filter(|_| progress > 0.0) else { return profile.to_vec() };
    let smoothstep = |from: f64, to: f64, s: f64| {
        let t = ((s - from) / (to - from)).clamp(0.0, 1.0);
        t * t * (3.0 - 2.0 * t)
    };
    // Radii shrink around the neck and grow by `fuller` below the waist; heights above the belly move up.
    let deform = |[x, z]: [f64; 2], fuller: f64| {
        let s = z / length;
        let gone = NECK_THINNING
            * progress
            * smoothstep(NECK_WAIST, NECK_POSITION, s)
            * (1.0 - smoothstep(NECK_POSITION, 1.0, s));
        let full = 1.0 + (fuller - 1.0) * (1.0 - smoothstep(NECK_WAIST, NECK_POSITION, s));
        [x * (1.0 - gone) * full, z + length * NECK_LENGTHENING * progress * smoothstep(NECKED_SHIFT_START, 1.0, s)]
    };
    // Fixed-point iteration for the factor that conserves volume; volume grows with the square of the factor.
    let mut fuller = 1.0;
    let target = profile_volume(profile);
    let mut out = profile.to_vec();
    for _ in 0..8 {
        out = profile.iter().map(|p| deform(*p, fuller)).collect();
        fuller *= math::sqrt(target / profile_volume(&out).max(1e-30));
    }
    out
}

/// Volume of the solid of revolution of a profile, m^3, by conical frusta.
pub fn profile_volume(profile: &[[f64; 2]]) -> f64 {
    let frustum = |w: &[[f64; 2]]| {
        let ([x, z], [y, u]) = (w[0], w[1]);
        PI * (u - z) * (x * x + x * y + y * y) / 3.0
    };
    profile.windows(2).map(frustum).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_is_what_the_shapes_give() {
        for MaxVolumeRow { radius: mm, fraction: c } in MAX_VOLUME_TABLE {
            let r = mm / TABLE_CAPILLARY_LENGTH;
            let tight = min_widening_apex_radius(r);
            let b = apex_radius_of_max_volume(tight, r);
            let most = integrate_profile(b, r, ProfileEnd::Narrowing).expect("a shape").volume;
            // In capillary lengths 2 pi R gamma / (rho g) is 2 pi r.
            let found = most / (2.0 * PI * r);
            assert!((found / c - 1.0).abs() < 0.01, "{mm}: {found} {c}");
        }
    }

    #[test]
    fn profiles_hold_their_volume_and_grow() {
        let mut last = 0.0;
        let most = max_pendant_volume(1e-3, 9.81);
        for k in 1..40 {
            let v = most * f64::from(k) / 40.0;
            let shape = PendantFamily::new(1e-3, 9.81).profile(v);
            let found = profile_volume(&shape);
            assert!((found / v - 1.0).abs() < 1e-3, "{k}: {v} {found}");
            let length = shape.last().expect("points")[1];
            assert!(length > last, "{k}: {length} after {last}");
            last = length;
        }
        assert!((last - 5.2e-3).abs() < 1.2e-3, "{last}");
    }

    #[test]
    fn what_thins_keeps_its_water_and_its_seat() {
        let shape = PendantFamily::new(1.5e-3, 9.81).profile(max_pendant_volume(1.5e-3, 9.81));
        let (whole, [seat, mut length]) = (profile_volume(&shape), shape.last().copied().expect("points"));
        let neck = |p: &[[f64; 2]]| {
            let high = p.last().expect("points")[1];
            p.iter().filter(|q| q[1] > 0.6 * high).fold(f64::MAX, |m, q| m.min(q[0]))
        };
        assert_eq!(profile_while_necking(&shape, 0.0), shape);
        let mut narrow = neck(&shape);
        for share in [0.25, 0.5, 0.75, 1.0] {
            let thin = profile_while_necking(&shape, share);
            assert!((profile_volume(&thin) / whole - 1.0).abs() < 1e-3, "{share}: {}", profile_volume(&thin) / whole);
            let [x, z] = thin.last().copied().expect("points");
            assert!((x / seat - 1.0).abs() < 1e-9 && z > length && neck(&thin) < narrow, "{share}");
            (length, narrow) = (z, neck(&thin));
        }
        assert!(narrow < 0.4 * seat, "{narrow} of {seat}");
    }
}
