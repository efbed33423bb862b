//! Drops that hang: how much a place holds, and the shape of what hangs there.

use std::f64::consts::PI;

use crate::rain::drops::shape::{TENSION, WATER};
use osier_base::math;

/// Radii of attachment, mm, of water on Earth, and the largest volume that hangs there as a share of 2 pi R gamma / (rho g).
/// Source: Young and Laplace, shapes at the limit.
const MAX_VOLUME_TABLE: [(f64, f64); 11] = [
    (0.3, 0.838),
    (0.4, 0.815),
    (0.5, 0.797),
    (0.6, 0.784),
    (0.75, 0.769),
    (1.0, 0.753),
    (1.25, 0.743),
    (1.5, 0.734),
    (1.75, 0.721),
    (2.0, 0.699),
    (2.25, 0.657),
];
/// Capillary length that the table is for, mm.
const TABLE: f64 = 2.727;
/// Step along a profile, as a share of the capillary length.
const STEP: f64 = 0.02 / TABLE;
/// Share of the largest volume that falls. Source: Tate, with Harkins and Brown's 0.61 to 0.78.
pub const DETACHED_FRACTION: f64 = 0.93;
/// Time in which a drop that is too heavy thins until it falls, s.
pub const NECKING_TIME: f64 = 0.04;

/// Smallest and largest radius of attachment, as shares of the capillary length.
pub const RADII: [f64; 2] = [0.3 / TABLE, 2.25 / TABLE];

/// Largest volume that hangs from a circle of radius `radius`, m, under `g`, m/s^2; m^3.
pub fn max_pendant_volume(radius: f64, g: f64) -> f64 {
    let length = math::sqrt(TENSION / (WATER * g.max(0.05)));
    let x = (radius / length * TABLE).clamp(MAX_VOLUME_TABLE[0].0, MAX_VOLUME_TABLE[10].0);
    let k = MAX_VOLUME_TABLE.partition_point(|(r, _)| *r <= x).clamp(1, 10);
    let ((r0, c0), (r1, c1)) = (MAX_VOLUME_TABLE[k - 1], MAX_VOLUME_TABLE[k]);
    let c = c0 + (c1 - c0) * (x - r0) / (r1 - r0);
    c * 2.0 * PI * radius * TENSION / (WATER * g.max(0.05))
}

/// Points of a profile, from the lowest point up: distance from the axis and height, m.
pub type PendantProfile = Vec<[f64; 2]>;

/// Where a profile of curvature ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum ProfileBranch {
    /// Before its widest place.
    Widening,
    /// After it.
    Narrowing,
}

/// A profile in capillary lengths with its volume; none if it never is so wide.
fn integrate_profile(b: f64, radius: f64, end: ProfileBranch) -> Option<(PendantProfile, f64)> {
    let slope = |[x, z, f]: [f64; 3]| {
        let bend = if x < 1e-9 { 1.0 / b } else { 2.0 / b - z - math::sin(f) / x };
        [math::cos(f), math::sin(f), bend]
    };
    let mut s = [0.0, 0.0, 0.0];
    let mut out = vec![[0.0, 0.0]];
    let mut volume = 0.0;
    let mut wide = false;
    for _ in 0..2000 {
        let add = |a: [f64; 3], k: [f64; 3], h: f64| [a[0] + h * k[0], a[1] + h * k[1], a[2] + h * k[2]];
        let k1 = slope(s);
        let k2 = slope(add(s, k1, STEP / 2.0));
        let k3 = slope(add(s, k2, STEP / 2.0));
        let k4 = slope(add(s, k3, STEP));
        let mut next = s;
        (0..3).for_each(|i| next[i] += STEP / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]));
        let slice = |a: [f64; 3], b: [f64; 3]| PI * (b[1] - a[1]) * (a[0] * a[0] + a[0] * b[0] + b[0] * b[0]) / 3.0;
        let crossed = match end {
            ProfileBranch::Widening => next[0] >= radius,
            ProfileBranch::Narrowing => wide && next[0] <= radius,
        };
        if crossed {
            let t = (radius - s[0]) / (next[0] - s[0]);
            let last = [radius, s[1] + t * (next[1] - s[1]), next[2]];
            volume += slice(s, last);
            out.push([last[0], last[1]]);
            return Some((out, volume));
        }
        if next[0] < s[0] {
            if end == ProfileBranch::Widening {
                return None;
            }
            wide = true;
        } else if wide {
            // The neck: no narrower place comes.
            return None;
        }
        volume += slice(s, next);
        s = next;
        out.push([s[0], s[1]]);
    }
    None
}

/// Shapes of what hangs from circles of one radius; finding its limits costs more than any one shape.
#[derive(Debug, Clone, Copy)]
pub struct PendantShapes {
    /// Capillary length and radius of the circle, m.
    length: f64,
    radius: f64,
    /// The same in capillary lengths.
    r: f64,
    /// Radii of curvature at the lowest point where the profile turns from widening to narrowing, and of the largest volume.
    turn: f64,
    last: f64,
}

impl PendantShapes {
    /// From a circle of radius `radius`, m, under `g`, m/s^2.
    pub fn new(radius: f64, g: f64) -> Self {
        let length = math::sqrt(TENSION / (WATER * g.max(0.05)));
        let r = (radius / length).clamp(RADII[0], RADII[1]);
        let turn = min_apex_radius(r);
        Self { length, radius, r, turn, last: apex_radius_of_max_volume(turn, r) }
    }

    /// The shape of a volume, m^3: from its lowest point to the circle. What is too much for the circle is shown as the
    /// largest that hangs, drawn out.
    /// Source: Young and Laplace, dx/ds = cos f, dz/ds = sin f, df/ds = 2/b - z/l^2 - sin(f)/x.
    pub fn profile(&self, volume: f64) -> PendantProfile {
        let l = self.length;
        let wanted = volume / (l * l * l);
        let (points, reached) = self.found(wanted);
        let stretch = if wanted > reached { (wanted / reached).min(1.6) } else { 1.0 };
        let wide = self.radius / self.r;
        points.iter().map(|[x, z]| [x * wide, z * l * stretch]).collect()
    }

    /// Volume grows along the path: first ends before the widest place with a falling radius of curvature, then after it
    /// with a rising one.
    fn found(&self, wanted: f64) -> (PendantProfile, f64) {
        let r = self.r;
        let rising = integrate_profile(self.turn, r, ProfileBranch::Widening).filter(|(_, v)| wanted <= *v).is_some();
        let (mut lo, mut hi, end) = if rising {
            (60.0 * r, self.turn, ProfileBranch::Widening)
        } else {
            (self.turn, self.last, ProfileBranch::Narrowing)
        };
        let half = (vec![[0.0, 0.0], [r, r]], 2.0 / 3.0 * PI * r * r * r);
        let mut best = integrate_profile(hi, r, end).or_else(|| integrate_profile(lo, r, end)).unwrap_or(half);
        if end == ProfileBranch::Narrowing && best.1 <= wanted {
            return best;
        }
        for _ in 0..32 {
            let b = 0.5 * (lo + hi);
            match integrate_profile(b, r, end) {
                Some((p, v)) if v < wanted => {
                    lo = b;
                    best = (p, v);
                }
                Some((p, v)) => {
                    hi = b;
                    best = (p, v);
                }
                None => hi = b,
            }
        }
        best
    }
}

/// The smallest radius of curvature at the lowest point with which a profile still widens to `r`.
fn min_apex_radius(r: f64) -> f64 {
    let (mut lo, mut hi) = (0.5 * r, 4.0 * r);
    while integrate_profile(hi, r, ProfileBranch::Widening).is_none() && hi < 100.0 * r {
        hi *= 1.5;
    }
    for _ in 0..48 {
        let b = 0.5 * (lo + hi);
        if integrate_profile(b, r, ProfileBranch::Widening).is_some() {
            hi = b;
        } else {
            lo = b;
        }
    }
    hi
}

/// The radius of curvature with which most hangs: the largest whose profile comes back to `r` below its neck.
fn apex_radius_of_max_volume(tight: f64, r: f64) -> f64 {
    let mut best = tight;
    let mut most = 0.0;
    let mut b = tight;
    for _ in 0..400 {
        b *= 1.01;
        match integrate_profile(b, r, ProfileBranch::Narrowing) {
            Some((_, v)) if v > most => (best, most) = (b, v),
            _ => break,
        }
    }
    let (mut lo, mut hi) = (best, best * 1.02);
    for _ in 0..30 {
        let b = 0.5 * (lo + hi);
        match integrate_profile(b, r, ProfileBranch::Narrowing) {
            Some((_, v)) if v >= most => (lo, most) = (b, v),
            _ => hi = b,
        }
    }
    lo
}

/// How much longer a drop is when it falls than when it began to thin, and the share of its neck's width that is gone then.
/// Own: after photographs of drops that fall.
const LONGER: f64 = 0.45;
const PINCHED: f64 = 0.75;
/// Where its neck is, and where the body below begins to narrow into it, as shares of its length.
const NECK: [f64; 2] = [0.82, 0.5];

/// A profile that has thinned by a share, 0 to 1: its neck narrows and lengthens, what hangs below takes up the water.
/// Source: own.
pub fn necked_profile(profile: &[[f64; 2]], share: f64) -> PendantProfile {
    let Some([_, length]) = profile.last().copied().filter(|_| share > 0.0) else { return profile.to_vec() };
    let [neck, waist] = NECK;
    let rise = |from: f64, to: f64, s: f64| {
        let t = ((s - from) / (to - from)).clamp(0.0, 1.0);
        t * t * (3.0 - 2.0 * t)
    };
    let pinched = |[x, z]: [f64; 2], fuller: f64| {
        let s = z / length;
        let gone = PINCHED * share * rise(waist, neck, s) * (1.0 - rise(neck, 1.0, s));
        let full = 1.0 + (fuller - 1.0) * (1.0 - rise(waist, neck, s));
        [x * (1.0 - gone) * full, z + length * LONGER * share * rise(0.4, 1.0, s)]
    };
    let mut fuller = 1.0;
    let wanted = volume(profile);
    let mut out = profile.to_vec();
    for _ in 0..8 {
        out = profile.iter().map(|p| pinched(*p, fuller)).collect();
        fuller *= math::sqrt(wanted / volume(&out).max(1e-30));
    }
    out
}

/// Volume of a profile, m^3.
pub fn volume(profile: &[[f64; 2]]) -> f64 {
    let slice = |w: &[[f64; 2]]| {
        let ([x, z], [y, u]) = (w[0], w[1]);
        PI * (u - z) * (x * x + x * y + y * y) / 3.0
    };
    profile.windows(2).map(slice).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_is_what_the_shapes_give() {
        for (mm, c) in MAX_VOLUME_TABLE {
            let r = mm / TABLE;
            let tight = min_apex_radius(r);
            let (_, most) =
                integrate_profile(apex_radius_of_max_volume(tight, r), r, ProfileBranch::Narrowing).expect("a shape");
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
            let shape = PendantShapes::new(1e-3, 9.81).profile(v);
            let found = volume(&shape);
            assert!((found / v - 1.0).abs() < 1e-3, "{k}: {v} {found}");
            let length = shape.last().expect("points")[1];
            assert!(length > last, "{k}: {length} after {last}");
            last = length;
        }
        assert!((last - 5.2e-3).abs() < 1.2e-3, "{last}");
    }

    #[test]
    fn what_thins_keeps_its_water_and_its_seat() {
        let shape = PendantShapes::new(1.5e-3, 9.81).profile(max_pendant_volume(1.5e-3, 9.81));
        let (whole, [seat, mut length]) = (volume(&shape), shape.last().copied().expect("points"));
        let neck = |p: &[[f64; 2]]| {
            let high = p.last().expect("points")[1];
            p.iter().filter(|q| q[1] > 0.6 * high).fold(f64::MAX, |m, q| m.min(q[0]))
        };
        assert_eq!(necked_profile(&shape, 0.0), shape);
        let mut narrow = neck(&shape);
        for share in [0.25, 0.5, 0.75, 1.0] {
            let thin = necked_profile(&shape, share);
            assert!((volume(&thin) / whole - 1.0).abs() < 1e-3, "{share}: {}", volume(&thin) / whole);
            let [x, z] = thin.last().copied().expect("points");
            assert!((x / seat - 1.0).abs() < 1e-9 && z > length && neck(&thin) < narrow, "{share}");
            (length, narrow) = (z, neck(&thin));
        }
        assert!(narrow < 0.4 * seat, "{narrow} of {seat}");
    }

    #[test]
    fn what_falls_is_tates_share() {
        for mm in [0.5, 1.0, 1.5] {
            let r = mm * 1e-3;
            let share = DETACHED_FRACTION * max_pendant_volume(r, 9.81) / (2.0 * PI * r * TENSION / (WATER * 9.81));
            assert!((0.60..0.80).contains(&share), "{mm}: {share}");
        }
    }
}
