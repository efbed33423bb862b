//! The shape of a running drop with its tail: a body along the path, whose cross sections narrow from the head to the end of the
//! tail without creases.

use std::f64::consts::PI;

use glam::DVec3;

use crate::rain::drops::spherical_cap::SphericalCap;
use crate::rain::frame::SessileDrop;
use crate::rain::mesh::DropPlacement;
use crate::rain::tuning::{
    MAX_TAIL_ROWS, MIN_TAIL_ROWS, TAIL_HEIGHT_RANGE, TAIL_ROWS_PER_RADIUS, TAIL_SLICE_STEPS, TAIL_SLICES,
};
use osier_base::math;

/// A running drop with its tail, as a body along the path back from the head's center; arc lengths s are in m.
pub(super) struct TailedDropShape {
    path: Vec<BodyPathPoint>,
    /// Sizes at the centers of the caps, by ascending arc length; caps at one place have one knot.
    knots: Vec<TailKnot>,
    head: StretchedCap,
    tail_end: StretchedCap,
    /// Unit normal of the leaf under the head.
    normal: DVec3,
    /// Skew of the head; caps of the tail have none.
    skew: f64,
    /// Arc length of the front of the head; negative.
    start: f64,
    /// Arc length of the rear of the last cap.
    end: f64,
    /// Factor on heights with which the body holds the drop's volume.
    height_factor: f64,
}

/// A point of the path in leaf space.
#[derive(Debug, Clone, Copy)]
struct BodyPathPoint {
    /// Offset from the head's center, m.
    p: DVec3,
    /// Arc length from the head's center, m.
    s: f64,
}

/// A cap with the stretch of its footprint along the path.
#[derive(Debug, Clone, Copy)]
struct StretchedCap {
    cap: SphericalCap,
    stretch: f64,
}

#[derive(Debug, Clone, Copy)]
struct CrossSection {
    /// Half of the width, m.
    half_width: f64,
    /// Height in the middle, m.
    height: f64,
}

/// Size of a cross section and its derivatives with respect to arc length, at which two cubic pieces meet.
#[derive(Debug, Clone, Copy)]
struct TailKnot {
    s: f64,
    /// Half width and height, m.
    size: [f64; 2],
    /// Their derivatives with respect to arc length.
    slope: [f64; 2],
}

impl TailedDropShape {
    /// The body of a drop with a tail; `None` if a cap lies beyond the blade.
    pub(super) fn new(placement: &DropPlacement<'_>, drop: &SessileDrop) -> Option<Self> {
        let centers: Vec<DVec3> =
            drop.caps.iter().filter_map(|cap| placement.leaf.point_at(cap.uv)).map(|point| point.p).collect();
        if centers.len() != drop.caps.len() {
            return None;
        }
        // The path is the polyline through the centers of the caps.
        let mut path = Vec::new();
        let mut length = 0.0;
        for (i, p) in centers.iter().enumerate() {
            length += if i > 0 { p.distance(centers[i - 1]) } else { 0.0 };
            path.push(BodyPathPoint { p: *p - placement.base.p, s: length });
        }
        let stretch = |i: usize| if i == 0 { drop.deformation.stretch } else { 1.0 };
        let caps: Vec<StretchedCap> =
            drop.caps.iter().enumerate().map(|(i, c)| StretchedCap { cap: c.cap, stretch: stretch(i) }).collect();
        let (head, tail_end) = (*caps.first()?, *caps.last()?);
        let last_s = path.last()?.s;
        let start = -head.cap.widest_radius() * head.stretch;
        let end = last_s + tail_end.cap.widest_radius() * tail_end.stretch;
        let skew = drop.deformation.skew;
        let knots = profile_knots(&path, &caps, skew);
        // Caps with a common center have no path between them: use the drop's axis.
        if length < 1e-6 {
            let back = -drop.axis;
            path = vec![BodyPathPoint { p: DVec3::ZERO, s: 0.0 }, BodyPathPoint { p: back * 1e-3, s: 1e-3 }];
        }
        let normal = placement.base.n;
        let mut body = Self { path, knots, head, tail_end, normal, skew, start, end, height_factor: 1.0 };
        // A body through the sections of the caps has another volume than the caps: correct it by a factor on the height.
        let volume = body.volume();
        if volume > 0.0 {
            body.height_factor = (drop.volume / volume).clamp(TAIL_HEIGHT_RANGE[0], TAIL_HEIGHT_RANGE[1]);
        }
        Some(body)
    }

    /// Number of intervals between rows of its mesh, more for a narrower body; `level`: index of the detail.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped")]
    pub(super) fn row_count(&self, level: usize) -> u32 {
        let narrowest = self.knots.iter().fold(f64::MAX, |m, knot| m.min(knot.size[0])).max(1e-5);
        ((self.end - self.start) / narrowest * TAIL_ROWS_PER_RADIUS[level])
            .ceil()
            .clamp(f64::from(MIN_TAIL_ROWS[level]), f64::from(MAX_TAIL_ROWS)) as u32
    }

    /// Arc length of row `k`, from the front to the rear; rows are denser at both ends, which are round.
    pub(super) fn row_position(&self, k: u32, rows: u32) -> f64 {
        let fraction = 0.5 - 0.5 * math::cos(PI * f64::from(k) / f64::from(rows));
        self.start + (self.end - self.start) * fraction
    }

    /// The cross section at arc length `s`: in front of the head's center and behind the center of the last cap that of the cap,
    /// between them cubic pieces through the sections of all caps. Source: own.
    fn cross_section(&self, s: f64) -> CrossSection {
        let (first, last) = (self.knots[0], self.knots[self.knots.len() - 1]);
        // Cross section of a stretched cap at a distance `x` from its center along the path.
        let cap_section = |end: StretchedCap, x: f64| {
            let StretchedCap { cap, stretch } = end;
            let x = x / stretch;
            let half_width = cap.widest_radius() / stretch
                * math::sqrt((1.0 - (x / cap.widest_radius()).min(1.0) * (x / cap.widest_radius())).max(0.0));
            CrossSection { half_width, height: cap.height((x / cap.a).abs()) }
        };
        if s <= first.s {
            let CrossSection { half_width, height } = cap_section(self.head, first.s - s);
            let shear = 1.0 + self.skew * ((first.s - s) / (self.head.cap.a * self.head.stretch)).clamp(0.0, 1.0);
            return CrossSection { half_width, height: height * shear };
        }
        if s >= last.s {
            let CrossSection { half_width, height } = cap_section(self.tail_end, s - last.s);
            // Continuous with the last knot, which may belong to another cap at the same place.
            let ratio = last.size[1] / self.tail_end.cap.top().max(1e-12);
            return CrossSection { half_width, height: height * ratio };
        }
        // Rounding of a cubic that ends at 0 may be negative.
        let k = self.knots.partition_point(|knot| knot.s <= s).clamp(1, self.knots.len() - 1);
        let (a, b) = (self.knots[k - 1], self.knots[k]);
        let [half_width, height] =
            [0, 1].map(|i| cubic_hermite([a.s, b.s], [a.size[i], b.size[i]], [a.slope[i], b.slope[i]], s).max(0.0));
        CrossSection { half_width, height }
    }

    /// Half of the width at arc length `s`, m; at least 1 micrometre.
    pub(super) fn half_width(&self, s: f64) -> f64 {
        self.cross_section(s).half_width.max(1e-6)
    }

    /// Height at arc length `s` and at `x` across the path, m. Across the path the body has the profile of the head's cap.
    pub(super) fn height(&self, s: f64, x: f64) -> f64 {
        let CrossSection { half_width, height } = self.cross_section(s);
        let rho = (x.abs() / half_width.max(1e-9)).min(1.0);
        height * self.height_factor * relative_cap_height(&self.head.cap, rho)
    }

    /// Volume above the leaf with height factor 1, m^3, by the midpoint rule in both directions.
    fn volume(&self) -> f64 {
        let n = f64::from(TAIL_SLICE_STEPS);
        let mean_height: f64 =
            (0..TAIL_SLICE_STEPS).map(|i| relative_cap_height(&self.head.cap, (f64::from(i) + 0.5) / n) / n).sum();
        let ds = (self.end - self.start) / f64::from(TAIL_SLICES);
        let slice = |k: u32| {
            let CrossSection { half_width, height } = self.cross_section(self.start + (f64::from(k) + 0.5) * ds);
            2.0 * half_width * height * mean_height * ds
        };
        (0..TAIL_SLICES).map(slice).sum()
    }

    /// World position of the point at arc length `s`, `x` across the path and `h` above the leaf, m.
    pub(super) fn world_point(&self, placement: &DropPlacement<'_>, s: f64, x: f64, h: f64) -> DVec3 {
        let last = self.path.len() - 1;
        // The piece of the path at s; the first and the last piece continue straight beyond the path's ends.
        let k = self.path.partition_point(|point| point.s <= s).clamp(1, last);
        let (a, b) = (self.path[k - 1], self.path[k]);
        let t = (s - a.s) / (b.s - a.s).max(1e-9);
        // Interpolate the tangent between the pieces of the path, so that rows do not cross in a bend.
        let direction = |k: usize| (self.path[k.min(last)].p - self.path[k.min(last) - 1].p).normalize_or(DVec3::Y);
        let (before, after) = (direction(k.max(2) - 1), direction(k));
        let tangent = before.lerp(after, (0.5 + t).clamp(0.0, 1.0)).normalize_or(after);
        let across = self.normal.cross(tangent).normalize_or(DVec3::X);
        placement.world_point(a.p + (b.p - a.p) * t + across * x, h)
    }
}

/// Height of a cap at a fraction `rho` of its largest radius, relative to its top.
fn relative_cap_height(cap: &SphericalCap, rho: f64) -> f64 {
    let top = cap.top();
    if top > 0.0 { cap.height(rho * cap.widest_radius() / cap.a) / top } else { 0.0 }
}

/// Knots at the centers of the caps, with slopes for which the cubic pieces are monotonic wherever the sizes are: a tail without
/// bumps between its caps. Source: Fritsch and Butland 1984, the harmonic mean of the secants.
fn profile_knots(path: &[BodyPathPoint], caps: &[StretchedCap], skew: f64) -> Vec<TailKnot> {
    let mut knots: Vec<TailKnot> = Vec::new();
    for (point, StretchedCap { cap, stretch }) in path.iter().zip(caps) {
        // Of several caps at one place only the first has a knot.
        if knots.last().is_none_or(|knot| point.s - knot.s > 1e-7) {
            knots.push(TailKnot { s: point.s, size: [cap.widest_radius() / stretch, cap.top()], slope: [0.0; 2] });
        }
    }
    // Inner knots; those at the ends keep slope 0.
    for k in 1..knots.len().saturating_sub(1) {
        let [a, b, c] = [knots[k - 1], knots[k], knots[k + 1]];
        knots[k].slope = [0, 1].map(|i| {
            let (l, r) = ((b.size[i] - a.size[i]) / (b.s - a.s), (c.size[i] - b.size[i]) / (c.s - b.s));
            if l * r > 0.0 { 2.0 * l * r / (l + r) } else { 0.0 }
        });
    }
    // The shear of the head continues into the tail; three times the secant is the limit at which a cubic stays monotonic.
    if let [first, second, ..] = knots.as_mut_slice()
        && let Some(StretchedCap { cap, stretch }) = caps.first()
    {
        let secant = (second.size[1] - first.size[1]) / (second.s - first.s);
        first.slope[1] = (-skew * cap.top() / (cap.a * stretch)).clamp((3.0 * secant).min(0.0), 0.0);
    }
    knots
}

/// Cubic Hermite interpolation between two positions with values `a`, `b` and derivatives `u`, `v`.
fn cubic_hermite([s0, s1]: [f64; 2], [a, b]: [f64; 2], [u, v]: [f64; 2], s: f64) -> f64 {
    let d = s1 - s0;
    let t = (s - s0) / d;
    let (t2, t3) = (t * t, t * t * t);
    a * (2.0 * t3 - 3.0 * t2 + 1.0) + b * (3.0 * t2 - 2.0 * t3) + d * (u * (t3 - 2.0 * t2 + t) + v * (t3 - t2))
}
