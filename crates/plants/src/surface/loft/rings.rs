//! Where rings stand along an axis and how they are turned.

use glam::Vec3;

use super::centerline::CurvePoint;
use super::corners;
use super::tuning::{
    EDGE_TOLERANCE, MAX_LEAN_SHARE, MAX_RING_SPACING, MIN_EDGE_SPACING, MIN_RING_SPACING, RADIUS_TOLERANCE,
    SAG_TOLERANCE, SWELL_TOLERANCE, TILT_PASSES, TURN_BACK_SUM_SQUARED,
};
use osier_base::math;

/// A cross-section of a tube: a circle in the plane normal to the centreline.
#[derive(Debug, Clone, Copy)]
pub(super) struct Ring {
    /// Centre on the centreline, m.
    pub c: Vec3,
    /// Unit tangent of the centreline, the normal of the plane.
    pub t: Vec3,
    /// Unit reference in the plane, towards the texture seam; rotation-minimizing along the axis.
    pub e: Vec3,
    /// Radius of the circle, m.
    pub r: f32,
    /// Change of radius per metre.
    pub slope: f32,
    /// Arc length on the axis, m.
    pub s: f32,
    /// Integral of ds / (2 pi r) from the first ring.
    pub v: f32,
}

/// Buffers of [`place_rings`], reused from axis to axis.
#[derive(Debug, Default)]
pub(super) struct RingScratch {
    /// Input: the centreline, at least two points that are apart.
    pub curve: Vec<CurvePoint>,
    /// Input: arc lengths, rising, m, at which a ring separates two colours.
    pub edges: Vec<f32>,
    fine: Vec<CurvePoint>,
    tangents: Vec<Vec3>,
}

/// Prescribed orientation of the first ring of a tube.
#[derive(Debug, Clone, Copy)]
pub(super) struct FirstRing {
    /// Unit tangent; `None`: the direction of the first segment.
    pub tangent: Option<Vec3>,
    /// Direction of the reference, any vector; its part along the tangent is removed.
    pub reference: Vec3,
}

/// How closely rings follow a centreline.
#[derive(Debug, Clone, Copy)]
pub(super) struct RingShape {
    /// Greatest angle between neighbouring tangents, rad.
    pub turn: f32,
    /// The centreline stays straight between its points, as the lines of a drawing do: every corner is an arc within it.
    pub straight: bool,
}

/// Appends the rings of the centreline in `scratch.curve` to `out`. Points between which the tangent turns by more than the shape
/// allows are joined by a centripetal Catmull-Rom curve, or, where that would bend more tightly than the tube allows, by arcs
/// within the corners.
pub(super) fn place_rings(scratch: &mut RingScratch, first: FirstRing, shape: RingShape, out: &mut Vec<Ring>) {
    let FirstRing { tangent: first, reference: e0 } = first;
    let RingShape { turn, straight } = shape;
    let start = out.len();
    // Resample the centreline where it bends too much. Where no point was added, the tangents stay valid.
    set_tangents(&scratch.curve, first, &mut scratch.tangents);
    if straight || corners::has_tight_corner(&scratch.curve, turn) {
        corners::fillet_corners(&scratch.curve, turn, &mut scratch.fine);
        set_tangents(&scratch.fine, first, &mut scratch.tangents);
    } else if subdivide_bends(&scratch.curve, &scratch.tangents, turn, &mut scratch.fine) {
        set_tangents(&scratch.fine, first, &mut scratch.tangents);
    }
    let fixed = first.is_some();
    // Keep as few of its points as the tolerances allow, then propagate the reference of the first ring.
    select_rings(&scratch.fine, &scratch.tangents, &scratch.edges, turn, fixed, out);
    transport_references(&mut out[start..], e0);
    // Rings that intersect or face back would turn quads inside out: tilt them, then remove those that still cross.
    if out[start..].windows(2).any(|w| rings_cross(&w[0], &w[1]) || one_faces_back(&w[0], &w[1])) {
        tilt_crossing_rings(&mut out[start..], e0, fixed);
        remove_crossing_rings(start, out);
        transport_references(&mut out[start..], e0);
    }
    set_slopes_and_v(&mut out[start..]);
}

/// Unit direction of the first segment that has a length.
fn first_direction(curve: &[CurvePoint]) -> Vec3 {
    let mut directions = curve.windows(2).map(|w| math::normalize_or(w[1].p - w[0].p, Vec3::ZERO));
    directions.find(|d| *d != Vec3::ZERO).unwrap_or(Vec3::Y)
}

/// Unit tangents at the points: the mean direction of both segments, at the ends that of the one segment. A segment
/// without length has the direction of the segment before it.
fn set_tangents(curve: &[CurvePoint], first: Option<Vec3>, out: &mut Vec<Vec3>) {
    out.clear();
    if curve.len() < 2 {
        return;
    }
    // At inner points t = (d1 + d2) / |d1 + d2|, the bisector; the ends take the direction of their only segment.
    let mut before = first_direction(curve);
    out.push(first.unwrap_or(before));
    for w in curve.windows(2).skip(1) {
        let after = math::normalize_or(w[1].p - w[0].p, before);
        let sum = before + after;
        // Where the curve turns back along itself the sum is only rounding error: the tangent is set perpendicular to
        // the segments.
        let turns_back = sum.length_squared() < TURN_BACK_SUM_SQUARED;
        out.push(if turns_back { math::perpendicular(before) } else { math::normalize_or(sum, after) });
        before = after;
    }
    out.push(before);
}

/// Copies the curve into `out` and adds points where its tangent turns by more than `turn` (rad); true if any were added.
fn subdivide_bends(curve: &[CurvePoint], tangents: &[Vec3], turn: f32, out: &mut Vec<CurvePoint>) -> bool {
    out.clear();
    let limit = math::cos_f32(turn);
    for i in 0..curve.len() {
        out.push(curve[i]);
        if i + 1 < curve.len() && tangents[i].dot(tangents[i + 1]) < limit {
            insert_spline_points(curve, i, tangents[i].dot(tangents[i + 1]), turn, out);
        }
    }
    out.len() > curve.len()
}

/// Appends spline points between points `i` and `i + 1`, whose tangents have this cosine: one per `turn` (rad), at most one per
/// 0.3 radii.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a ratio of angles, at most 315")]
fn insert_spline_points(curve: &[CurvePoint], i: usize, cosine: f32, turn: f32, out: &mut Vec<CurvePoint>) {
    let (a, b) = (curve[i], curve[i + 1]);
    // One piece per `turn`, but none shorter than 0.3 radii, whose rings would cross.
    let most = a.p.distance(b.p) / (0.3 * a.r.max(b.r));
    let pieces = (math::acos_f32(cosine.clamp(-1.0, 1.0)) / turn).ceil().min(most).min(8.0) as u32;
    // At the ends of the curve the neighbour is mirrored.
    let before = if i > 0 { curve[i - 1].p } else { a.p * 2.0 - b.p };
    let after = curve.get(i + 2).map_or(b.p * 2.0 - a.p, |k| k.p);
    for k in 1..pieces {
        let u = k as f32 / pieces as f32;
        let p = catmull_rom([before, a.p, b.p, after], u);
        out.push(CurvePoint { p, r: math::lerp(a.r, b.r, u), s: math::lerp(a.s, b.s, u) });
    }
}

/// Centripetal Catmull-Rom curve through four points, between the middle two, `u` in [0, 1].
/// Source: P. Barry, R. Goldman, "A recursive evaluation algorithm for a class of Catmull-Rom splines", SIGGRAPH 1988.
fn catmull_rom(p: [Vec3; 4], u: f32) -> Vec3 {
    // Knots t_i+1 = t_i + |p_i+1 - p_i|^(1/2) (centripetal), then the pyramid of linear interpolations.
    let gap = |a: Vec3, b: Vec3| a.distance(b).sqrt().max(1e-6);
    let t1 = gap(p[0], p[1]);
    let t2 = t1 + gap(p[1], p[2]);
    let t3 = t2 + gap(p[2], p[3]);
    let t = math::lerp(t1, t2, u);
    let mix = |a: Vec3, b: Vec3, from: f32, to: f32| a.lerp(b, (t - from) / (to - from));
    let (a, b, c) = (mix(p[0], p[1], 0.0, t1), mix(p[1], p[2], t1, t2), mix(p[2], p[3], t2, t3));
    mix(mix(a, b, 0.0, t2), mix(b, c, t1, t3), t1, t2)
}

/// Appends a ring at every point of the curve that the tolerances ask for, not yet oriented. `fixed`: the first ring is
/// prescribed, so the second keeps a distance of one radius in order not to cross it.
fn select_rings(curve: &[CurvePoint], tangents: &[Vec3], edges: &[f32], turn: f32, fixed: bool, out: &mut Vec<Ring>) {
    let limit = math::cos_f32(turn);
    let (narrow, wide) = (1.0 - RADIUS_TOLERANCE, 1.0 + RADIUS_TOLERANCE);
    let (start, last) = (out.len(), curve.len().saturating_sub(1));
    let mut kept: Option<(CurvePoint, Vec3)> = None;
    let mut skipped = 0;
    let mut passed = SkippedPoints::default();
    let mut edges = edges;
    for (i, (k, t)) in curve.iter().zip(tangents).enumerate() {
        // A ring is needed at the ends, where tangent or radius changed since the last one, after a long gap, and where the
        // tube without it would leave the centreline or its radii.
        let mut at_edge = false;
        while let Some((_, rest)) = edges.split_first().filter(|(s, _)| k.s >= **s - EDGE_TOLERANCE * **s) {
            (edges, at_edge) = (rest, true);
        }
        let needed = kept.is_none_or(|(l, lt)| {
            let gap = k.s - l.s;
            let changed = lt.dot(*t) < limit || k.r < l.r * narrow || k.r > l.r * wide || gap > MAX_RING_SPACING * l.r;
            let close = if fixed && out.len() == start + 1 { 1.0 } else { MIN_RING_SPACING };
            let mut deviates = || {
                let chord = &curve[skipped..=i + 1];
                // Many points are tested one by one only where their bounds do not prove that they are near enough.
                let bounded = i - skipped >= FEW_POINTS;
                if bounded {
                    passed.add(l, &curve[skipped..=i]);
                }
                ((!bounded || passed.may_sag(l, &curve[i + 1])) && exceeds_sag(l, chord))
                    || ((!bounded || passed.may_swell(l, &curve[i + 1])) && exceeds_swell(l, chord))
            };
            i == last || gap > close * l.r && (changed || deviates()) || at_edge && gap > MIN_EDGE_SPACING * l.r
        });
        if !needed {
            continue;
        }
        skipped = i + 1;
        if passed.count > 0 {
            passed = SkippedPoints::default();
        }
        // The last ring replaces the ring before it if both are too close to each other.
        if i == last && out.len() > start + 1 && kept.is_some_and(|(l, _)| k.s - l.s < MIN_RING_SPACING * l.r) {
            out.pop();
        }
        out.push(Ring { c: k.p, t: *t, e: Vec3::X, r: k.r, slope: 0.0, s: k.s, v: 0.0 });
        kept = Some((*k, *t));
    }
}

/// Number of points after a ring up to which testing each point is faster than computing bounds.
const FEW_POINTS: usize = 6;
/// Share of a tolerance that bounds may use up, so that rounding does not decide.
const BOUND_SHARE: f32 = 0.9;

/// Bounds of the points after the last ring, to which points are added as they are passed: a long straight axis would otherwise
/// be searched again at each of its points.
#[derive(Debug, Default)]
struct SkippedPoints {
    count: usize,
    /// Unit direction from the ring to the last of the points that were added first; those nearer to the ring may lie aside.
    along: Vec3,
    /// Greatest distances from the ring in that direction and across it, m.
    ahead: f32,
    aside: f32,
    /// Least and greatest radius, m.
    radii: [f32; 2],
}

impl SkippedPoints {
    /// Adds the points beyond those already counted. `from`: the ring; `points`: all points after it so far.
    fn add(&mut self, from: CurvePoint, points: &[CurvePoint]) {
        if let (0, Some(last)) = (self.count, points.last()) {
            self.along = math::normalize_or(last.p - from.p, Vec3::Y);
            self.radii = [last.r, last.r];
        }
        for k in points.iter().skip(self.count) {
            let d = k.p - from.p;
            self.count += 1;
            self.ahead = self.ahead.max(d.dot(self.along).abs());
            self.aside = self.aside.max(d.reject_from_normalized(self.along).length());
            self.radii = [self.radii[0].min(k.r), self.radii[1].max(k.r)];
        }
    }

    /// False if no point can be farther from the chord to `to` than [`SAG_TOLERANCE`] radii: a chord that leans by a moves
    /// away from a point by no more than its distance ahead times sin a.
    fn may_sag(&self, from: CurvePoint, to: &CurvePoint) -> bool {
        let chord = math::normalize_or(to.p - from.p, Vec3::Y);
        let lean = chord.cross(self.along).length();
        self.aside + self.ahead * lean > BOUND_SHARE * SAG_TOLERANCE * self.radii[0]
    }

    /// False if no radius can differ from a linear taper to `to` by a share of [`SWELL_TOLERANCE`]: all lie between the least and
    /// the greatest.
    fn may_swell(&self, from: CurvePoint, to: &CurvePoint) -> bool {
        let least = self.radii[0].min(from.r).min(to.r);
        let greatest = self.radii[1].max(from.r).max(to.r);
        greatest - least > BOUND_SHARE * SWELL_TOLERANCE * self.radii[0]
    }
}

/// Whether the chord from `from` to the last of the points passes any of the others at more than [`SAG_TOLERANCE`] radii.
fn exceeds_sag(from: CurvePoint, curve: &[CurvePoint]) -> bool {
    let Some((to, between)) = curve.split_last() else { return false };
    // The distance from the chord, |d - (d . t) t|, compared squared to save the root.
    let along = math::normalize_or(to.p - from.p, Vec3::Y);
    between.iter().any(|k| {
        (k.p - from.p).reject_from_normalized(along).length_squared() > (SAG_TOLERANCE * k.r) * (SAG_TOLERANCE * k.r)
    })
}

/// Whether a tube that tapers linearly from `from` to the last of the points is thicker or thinner than any of the others by
/// a share of [`SWELL_TOLERANCE`]. This keeps the swollen nodes of a culm.
fn exceeds_swell(from: CurvePoint, curve: &[CurvePoint]) -> bool {
    let Some((to, between)) = curve.split_last() else { return false };
    let span = (to.s - from.s).max(1e-9);
    between.iter().any(|k| (k.r - math::lerp(from.r, to.r, (k.s - from.s) / span)).abs() > SWELL_TOLERANCE * k.r)
}

/// Whether a point of ring `b` lies behind the corresponding point of ring `a`, seen along the mean of their tangents.
/// The distance of corresponding points along that mean is ahead + x cos a + y sin a, negative somewhere if ahead^2 < x^2 + y^2
/// (here with a margin of 5 %).
fn rings_cross(a: &Ring, b: &Ring) -> bool {
    // The polygons are compared along the sum of both tangents; its length cancels in the test below.
    let m = a.t + b.t;
    let ahead = (b.c - a.c).dot(m);
    let x = (b.e * b.r - a.e * a.r).dot(m);
    let y = (b.t.cross(b.e) * b.r - a.t.cross(a.e) * a.r).dot(m);
    ahead <= 0.0 || ahead * ahead <= 1.05 * (x * x + y * y)
}

/// A ring faces back if the cosine between its tangent and the direction to its neighbour is below this. It is not 0
/// because of rounding: the ring at a hairpin is perpendicular to the directions on both of its sides.
const BACK: f32 = -1e-3;

/// Whether one of two neighbouring rings faces back against the direction between them, as at a hairpin where points
/// were left out. Such rings are not removed, because all rings after a hairpin lie behind the ring before it.
fn one_faces_back(a: &Ring, b: &Ring) -> bool {
    let step = b.c - a.c;
    step.dot(a.t).min(step.dot(b.t)) < BACK * step.length()
}

/// Tilts the planes of neighbours that cross or face back towards their chord until both together lean by at most
/// [`MAX_LEAN_SHARE`] of their distance. `fixed`: the first ring stays as it is.
fn tilt_crossing_rings(rings: &mut [Ring], e0: Vec3, fixed: bool) {
    for pass in 0..TILT_PASSES {
        for k in 1..rings.len() {
            let i = if pass % 2 == 0 { k } else { rings.len() - k };
            let (a, b) = (rings[i - 1], rings[i]);
            let d = a.c.distance(b.c);
            if d < 1e-9 || !(rings_cross(&a, &b) || one_faces_back(&a, &b)) {
                continue;
            }
            // Radius times the sine of the angle to the chord: how far a plane leans towards the other.
            let chord = (b.c - a.c) / d;
            let (la, lb) = (a.r * sine(a.t, chord), b.r * sine(b.t, chord));
            if fixed && i == 1 {
                rings[i].t = tilt_towards(b.t, chord, ((MAX_LEAN_SHARE * d - la) / lb.max(1e-9)).clamp(0.0, 1.0));
            } else {
                let share = (MAX_LEAN_SHARE * d / (la + lb).max(1e-9)).min(1.0);
                rings[i - 1].t = tilt_towards(a.t, chord, share);
                rings[i].t = tilt_towards(b.t, chord, share);
            }
        }
        transport_references(rings, e0);
    }
}

/// Removes rings from `start` on that cross the one before; the first and the last stay.
fn remove_crossing_rings(start: usize, out: &mut Vec<Ring>) {
    let mut kept = start + 1;
    let last = out.len() - 1;
    for i in start + 1..=last {
        let ring = out[i];
        if i == last {
            while kept > start + 1 && rings_cross(&out[kept - 1], &ring) {
                kept -= 1;
            }
        } else if rings_cross(&out[kept - 1], &ring) {
            continue;
        }
        out[kept] = ring;
        kept += 1;
    }
    out.truncate(kept);
}

/// Sine of the angle between unit vectors.
fn sine(a: Vec3, b: Vec3) -> f32 {
    (1.0 - a.dot(b) * a.dot(b)).max(0.0).sqrt()
}

/// The unit vector at an angle to `chord` whose sine is `share` times that of `t`, on the same side, leaning forward. A
/// `t` that faces back is turned only until it is perpendicular to the chord: the chord on the other side of a hairpin
/// runs the opposite way.
fn tilt_towards(t: Vec3, chord: Vec3, share: f32) -> Vec3 {
    // Scale the component across the chord, |across| = sine, and restore unit length by the cosine.
    let ahead = t.dot(chord);
    let across = t - chord * ahead;
    if ahead < BACK && across.length_squared() > 1e-6 {
        return across.normalize();
    }
    let s = across.length() * share;
    let c = (1.0 - s * s).max(0.0).sqrt();
    math::normalize_or(chord * c + across * share, chord)
}

/// Sets the references of all rings: `e0` projected into the first plane, then parallel transport by double reflection.
fn transport_references(rings: &mut [Ring], e0: Vec3) {
    let Some(first) = rings.first_mut() else { return };
    // Gram-Schmidt in the first plane; a reference nearly along the tangent is replaced by any perpendicular.
    let across = e0 - first.t * first.t.dot(e0);
    first.e = if across.length_squared() > 1e-6 { across.normalize() } else { math::perpendicular(first.t) };
    for i in 1..rings.len() {
        let (a, b) = (rings[i - 1], rings[i]);
        rings[i].e = math::transport(a.c, a.t, a.e, b.c, b.t);
    }
}

/// Sets slopes by central differences, and v by the trapezoidal rule on the radius. For v, radii below a quarter of the base
/// radius count as that quarter; otherwise v would diverge at the tip.
fn set_slopes_and_v(rings: &mut [Ring]) {
    let n = rings.len();
    let least = rings.first().map_or(0.0, |r| r.r * 0.25);
    for i in 0..n {
        let (a, b) = (rings[i.saturating_sub(1)], rings[(i + 1).min(n - 1)]);
        // dr/ds by central differences (one-sided at the ends), at most 4: a cone of 76 degrees, beyond which normals
        // of a step in radius would point along the axis.
        let span = b.s - a.s;
        rings[i].slope = if span > 1e-9 { ((b.r - a.r) / span).clamp(-4.0, 4.0) } else { 0.0 };
        if i > 0 {
            // v = integral of ds / (2 pi r): equal steps of v and u are equal lengths on the tube, so the mapping is
            // conformal.
            let mean = (a.r.max(least) + rings[i].r.max(least)) * 0.5;
            rings[i].v = a.v + (rings[i].s - a.s) / (std::f32::consts::TAU * mean);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bent(turn: f32) -> RingShape {
        RingShape { turn, straight: false }
    }

    #[test]
    fn lines_keep_their_corners_and_axes_become_curves() {
        // Seven sides of an octagon of side 1, 0.01 thick.
        let side = |i: u32| {
            let a = i as f32 * std::f32::consts::FRAC_PI_4;
            Vec3::new(math::cos_f32(a), math::sin_f32(a), 0.0)
        };
        let corners: Vec<Vec3> = (0..8).map(|k| (0..k).map(side).sum()).collect();
        let curve: Vec<CurvePoint> =
            corners.iter().zip(0_u8..).map(|(p, k)| CurvePoint { p: *p, r: 0.005, s: f32::from(k) }).collect();
        // Greatest distance of a ring from the nearest side.
        let drift = |shape: RingShape| {
            let mut rings = Vec::new();
            let first = FirstRing { tangent: None, reference: Vec3::Z };
            place_rings(&mut RingScratch { curve: curve.clone(), ..RingScratch::default() }, first, shape, &mut rings);
            let from_side = |c: Vec3, w: &[Vec3]| {
                let along = w[1] - w[0];
                c.distance(w[0] + along * ((c - w[0]).dot(along)).clamp(0.0, 1.0))
            };
            let nearest =
                |r: &Ring| corners.windows(2).map(|w| from_side(r.c, w)).min_by(f32::total_cmp).unwrap_or(0.0);
            rings.iter().map(nearest).max_by(f32::total_cmp).unwrap_or(0.0)
        };
        assert!(drift(RingShape { turn: 0.2, straight: true }) < 0.002);
        assert!(drift(bent(0.2)) > 0.05);
    }

    fn helix(turns: u32, per_turn: u32, radius: f32, pitch: f32) -> Vec<CurvePoint> {
        let knot = |i: u32| {
            let a = i as f32 / per_turn as f32 * std::f32::consts::TAU;
            let p = Vec3::new(radius * math::cos_f32(a), pitch * a, radius * math::sin_f32(a));
            CurvePoint { p, r: 0.01, s: a * (radius * radius + pitch * pitch).sqrt() }
        };
        (0..=turns * per_turn).map(knot).collect()
    }

    #[test]
    fn roll_on_a_helix_is_the_integral_of_torsion() {
        let (radius, pitch, turns) = (1.0_f32, 0.3_f32, 3_u32);
        let mut scratch = RingScratch { curve: helix(turns, 64, radius, pitch), ..RingScratch::default() };
        let mut rings = Vec::new();
        place_rings(&mut scratch, FirstRing { tangent: None, reference: Vec3::Y }, bent(0.01), &mut rings);
        // The Frenet normal points to the helix axis; the rotation-minimising reference turns against it by -torsion.
        let angle = |r: &Ring| {
            let axis = Vec3::new(-r.c.x, 0.0, -r.c.z);
            let normal = math::normalize_or(axis - r.t * r.t.dot(axis), Vec3::X);
            math::atan2(f64::from(r.t.cross(normal).dot(r.e)), f64::from(normal.dot(r.e)))
        };
        let mut total = 0.0;
        let inner = &rings[1..rings.len() - 1];
        for w in inner.windows(2) {
            let d = angle(&w[1]) - angle(&w[0]);
            total += d - (d / std::f64::consts::TAU).round() * std::f64::consts::TAU;
        }
        let torsion = f64::from(pitch / (radius * radius + pitch * pitch));
        let length = f64::from(inner[inner.len() - 1].s - inner[0].s);
        let expected = torsion * length;
        assert!((total.abs() - expected).abs() < 1e-3 * expected, "{total} instead of {expected}");
    }

    #[test]
    fn rings_of_a_hairpin_face_forward_and_stay() {
        let ring = |c: Vec3, t: Vec3| Ring { c, t, e: math::perpendicular(t), r: 0.0017, slope: 0.0, s: 0.0, v: 0.0 };
        let (low, high) = (ring(Vec3::ZERO, Vec3::Y), Vec3::new(0.002, 0.031, -0.0115));
        // Leaning by 47 degrees from the way between the rings, which are 20 radii apart, and the same reversed.
        let t = Vec3::new(0.61, 0.69, -0.27).normalize();
        assert!(!one_faces_back(&low, &ring(high, t)));
        assert!(one_faces_back(&low, &ring(high, -t)) && one_faces_back(&ring(Vec3::ZERO, -Vec3::Y), &ring(high, t)));
        // Five rings up, one that leans by 40 degrees at the bend, seven down beside them, 18 radii apart.
        let up = (0_u8..5).map(|i| ring(Vec3::Y * (0.03 * f32::from(i)), Vec3::Y));
        let bend = ring(Vec3::Y * 0.15, Vec3::new(0.643, 0.766, 0.0).normalize());
        let down = (1_u8..8).map(|i| {
            let i = f32::from(i);
            ring(Vec3::new(0.0002 + 0.0006 * i, 0.15 - 0.03 * i, 0.0), Vec3::new(0.02, -1.0, 0.0).normalize())
        });
        let mut rings: Vec<Ring> = up.chain([bend]).chain(down).collect();
        transport_references(&mut rings, Vec3::X);
        tilt_crossing_rings(&mut rings, Vec3::X, false);
        remove_crossing_rings(0, &mut rings);
        assert!(rings.len() == 13 && !rings.windows(2).any(|w| one_faces_back(&w[0], &w[1])), "{rings:?}");
    }

    #[test]
    fn an_axis_that_turns_back_keeps_its_end() {
        // Up, to the right, back and up again: the end of the spike is at (1, 1).
        let knot = |p: Vec3, s: f32| CurvePoint { p, r: 0.005, s };
        let spike = Vec3::new(1.0, 1.0, 0.0);
        for degrees in [155.0_f32, 170.0, 179.5, 180.0] {
            let a = degrees.to_radians();
            let back = spike + Vec3::new(math::cos_f32(a), math::sin_f32(a), 0.0);
            let points = [Vec3::ZERO, Vec3::Y, spike, back, back + Vec3::Y];
            let curve: Vec<CurvePoint> = points.iter().zip(0_u8..).map(|(p, k)| knot(*p, f32::from(k))).collect();
            for straight in [false, true] {
                let mut rings = Vec::new();
                let first = FirstRing { tangent: None, reference: Vec3::Z };
                let shape = RingShape { turn: 0.2, straight };
                place_rings(
                    &mut RingScratch { curve: curve.clone(), ..RingScratch::default() },
                    first,
                    shape,
                    &mut rings,
                );
                let nearest = rings.iter().map(|r| r.c.distance(spike)).min_by(f32::total_cmp).expect("rings");
                assert!(nearest < 1e-4, "{degrees} degrees: {nearest}");
                let top = rings.last().expect("rings").c;
                assert!(top.distance(back + Vec3::Y) < 1e-4, "{degrees} degrees: {top}");
                assert!(rings.iter().all(|r| r.t.is_finite() && r.e.is_finite()), "{degrees} degrees");
            }
        }
    }

    #[test]
    fn no_flip_at_vertical_or_reversed_tangents() {
        // Straight up, then a loop back to straight up: the tangent passes every direction of a plane.
        let point = |i: u32| {
            let a = i.saturating_sub(4).min(24) as f32 * (std::f32::consts::TAU / 24.0);
            let rise = i.min(4) as f32 * 0.25 + i.saturating_sub(28) as f32 * 0.25;
            Vec3::new(0.002 * i as f32, rise + math::sin_f32(a), 1.0 - math::cos_f32(a))
        };
        let curve = (0..34).map(|i| CurvePoint { p: point(i), r: 0.05, s: 0.25 * i as f32 }).collect();
        let mut rings = Vec::new();
        let first = FirstRing { tangent: None, reference: Vec3::X };
        place_rings(&mut RingScratch { curve, ..RingScratch::default() }, first, bent(0.2), &mut rings);
        assert!(rings.iter().any(|r| r.t.y < -0.9) && rings.iter().any(|r| r.t.y > 0.99));
        for r in &rings {
            assert!(r.e.x > 0.9, "{} at {}", r.e, r.c);
            assert!(r.e.dot(r.t).abs() < 1e-5 && (r.e.length() - 1.0).abs() < 1e-5);
        }
    }
}
