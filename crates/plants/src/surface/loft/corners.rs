//! Fillets: arcs in place of corners that are too tight or too sharp for a smooth curve through the nodes.

use glam::Vec3;

use super::centerline::CurvePoint;
use super::tuning::{FILLET_RADIUS, HAIRPIN_COSINE, MIN_FILLET_RADIUS, SHARP_CORNER_TAN2, TIGHT_CORNER_RADII};
use osier_base::math;

/// The two segments that meet in a point of a curve, with unit directions before and after it.
struct CurveCorner {
    before: Vec3,
    after: Vec3,
    /// Tangent of half the angle.
    tan: f32,
    /// Lengths of the segments before and after, m.
    lengths: (f32, f32),
}

impl CurveCorner {
    fn new(w: &[CurvePoint]) -> Option<Self> {
        let [a, b, c] = w else { return None };
        let (x, y) = (b.p - a.p, c.p - b.p);
        let lengths = (x.length(), y.length());
        let (before, after) = (math::normalize_or(x, y), math::normalize_or(y, x));
        // tan(a / 2) = sin a / (1 + cos a), without an inverse function.
        let tan = before.cross(after).length() / (1.0 + before.dot(after)).max(1e-6);
        Some(Self { before, after, tan, lengths })
    }

    /// Whether the second segment turns back along the first.
    fn is_hairpin(&self) -> bool {
        self.before.dot(self.after) < HAIRPIN_COSINE
    }
}

/// True if the centreline has a tight or a sharp corner of more than `turn` (rad), which [`fillet_corners`] would round.
pub(super) fn has_tight_corner(curve: &[CurvePoint], turn: f32) -> bool {
    let least = (0.5 * turn) * (0.5 * turn);
    curve.windows(3).any(|w| {
        let (x, y) = (w[1].p - w[0].p, w[2].p - w[1].p);
        let (x2, y2) = (x.length_squared(), y.length_squared());
        let room = (x2 * y2).sqrt();
        // Squared tangent of half the angle, tan^2(a / 2) = (1 - cos a) / (1 + cos a), kept as the fraction above / below to
        // avoid the division: this test runs for every node.
        let (above, below) = (room - x.dot(y), (room + x.dot(y)).max(1e-12));
        let reach = TIGHT_CORNER_RADII * w[1].r;
        let tight = above > least * below && 0.25 * x2.min(y2) * below < reach * reach * above;
        tight || above > SHARP_CORNER_TAN2.max(least) * below
    })
}

/// Copies the curve into `out` with an arc of about [`FILLET_RADIUS`] radii in place of every corner of more than `turn` (rad).
/// Neighbours that need the same segment share it in proportion; where less than [`MIN_FILLET_RADIUS`] radii remain, the point
/// stays. So does one at which the curve turns back ([`HAIRPIN_COSINE`]).
/// Own.
pub(super) fn fillet_corners(curve: &[CurvePoint], turn: f32, out: &mut Vec<CurvePoint>) {
    out.clear();
    // Length of either segment that a fillet at point i takes: the tangent length r tan(a / 2).
    let wanted = |i: usize| {
        let corner = i.checked_sub(1).and_then(|h| curve.get(h..h + 3)).and_then(CurveCorner::new);
        corner.filter(|c| !c.is_hairpin()).map_or(0.0, |c| FILLET_RADIUS * curve[i].r * c.tan)
    };
    for (i, knot) in curve.iter().enumerate() {
        let corner = i.checked_sub(1).and_then(|h| curve.get(h..h + 3)).and_then(CurveCorner::new);
        let Some(c) = corner.filter(|c| c.tan > 0.5 * turn && !c.is_hairpin()) else {
            out.push(*knot);
            continue;
        };
        // Two corners on one segment divide it in proportion to the tangent lengths r tan(a / 2) that they ask for.
        let own = wanted(i);
        let share = |length: f32, other: f32| (length / (own + other).max(1e-9)).min(1.0);
        let part = share(c.lengths.0, wanted(i - 1)).min(share(c.lengths.1, wanted(i + 1)));
        if FILLET_RADIUS * part < MIN_FILLET_RADIUS {
            out.push(*knot);
        } else {
            push_arc(curve, i, &c, own * part, turn, out);
        }
    }
}

/// Appends the arc that touches both segments `reach` (m) away from point `i`, one point per `turn` (rad). Arc length and
/// radius are interpolated as on the segments, so that children keep their sites.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "1 to 8")]
fn push_arc(curve: &[CurvePoint], i: usize, c: &CurveCorner, reach: f32, turn: f32, out: &mut Vec<CurvePoint>) {
    let k = curve[i];
    let angle = math::acos_f32(c.before.dot(c.after).clamp(-1.0, 1.0));
    let pieces = (angle / turn).ceil().clamp(1.0, 8.0) as u8;
    // The arc starts at p - t reach along the segment before, with its centre at distance reach / tan(a / 2) on the
    // inner side.
    let inward = math::normalize_or(c.after - c.before, c.before);
    let radius = reach / c.tan;
    let side = math::normalize_or(inward.reject_from_normalized(c.before), inward);
    let start = k.p - c.before * reach;
    let (from, to) = (reach.min(k.s - curve[i - 1].s), reach.min(curve[i + 1].s - k.s));
    // Radii taper on both sides as on the segments that the arc replaces.
    let slope = |other: &CurvePoint| (other.r - k.r) / (other.s - k.s).abs().max(1e-9);
    let (back, ahead) = (slope(&curve[i - 1]), slope(&curve[i + 1]));
    for step in 0..=pieces {
        let u = f32::from(step) / f32::from(pieces);
        let a = angle * u;
        let p = start + c.before * (radius * math::sin_f32(a)) + side * (radius * (1.0 - math::cos_f32(a)));
        let s = k.s - from + (from + to) * u;
        let r = k.r + if s < k.s { back * (k.s - s) } else { ahead * (s - k.s) };
        out.push(CurvePoint { p, r, s });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_arc_touches_both_segments_and_keeps_its_radius() {
        let knot = |x: f32, y: f32, s: f32| CurvePoint { p: Vec3::new(x, y, 0.0), r: 0.1, s };
        let curve = [knot(0.0, 0.0, 0.0), knot(0.3, 0.0, 0.3), knot(0.3, 0.3, 0.6)];
        assert!(has_tight_corner(&curve, 0.2) && !has_tight_corner(&curve, 2.2));
        let mut out = Vec::new();
        fillet_corners(&curve, 0.2, &mut out);
        assert_eq!((out[0].p, out[out.len() - 1].p), (curve[0].p, curve[2].p));
        let middle = Vec3::new(0.3 - 0.11, 0.11, 0.0);
        for k in &out[1..out.len() - 1] {
            assert!((k.p.distance(middle) - 0.11).abs() < 1e-5, "{k:?}");
        }
        assert!(out.len() > 6 && out.windows(2).all(|w| w[0].s < w[1].s));
    }

    #[test]
    fn a_sharp_corner_with_all_the_room_stays_one() {
        let knot = |x: f32, y: f32, s: f32| CurvePoint { p: Vec3::new(x, y, 0.0), r: 0.01, s };
        let corner = |degrees: f32| {
            let a = degrees.to_radians();
            [knot(0.0, 0.0, 0.0), knot(5.0, 0.0, 5.0), knot(5.0 + 5.0 * math::cos_f32(a), 5.0 * math::sin_f32(a), 10.0)]
        };
        assert!(has_tight_corner(&corner(60.0), 0.2) && !has_tight_corner(&corner(55.0), 0.2));
    }

    #[test]
    fn an_arc_cuts_at_most_three_radii_off_a_corner() {
        let knot = |x: f32, y: f32, s: f32| CurvePoint { p: Vec3::new(x, y, 0.0), r: 0.01, s };
        for degrees in [90.0_f32, 120.0, 149.0, 151.0, 170.0, 179.5, 180.0] {
            let a = degrees.to_radians();
            let end = knot(1.0 + math::cos_f32(a), math::sin_f32(a), 2.0);
            let mut out = Vec::new();
            fillet_corners(&[knot(0.0, 0.0, 0.0), knot(1.0, 0.0, 1.0), end], 0.2, &mut out);
            let nearest = out.iter().map(|k| k.p.distance(Vec3::X)).min_by(f32::total_cmp).expect("points");
            // 1.1 (1 / cos(a / 2) - 1) radii to the middle of the arc, at which one of its nine points lies.
            assert!(nearest < 0.035, "{degrees} degrees: {nearest}");
        }
    }

    #[test]
    fn a_corner_without_room_keeps_its_knot() {
        let knot = |x: f32, y: f32, s: f32| CurvePoint { p: Vec3::new(x, y, 0.0), r: 0.1, s };
        let curve = [knot(0.0, 0.0, 0.0), knot(0.1, 0.0, 0.1), knot(0.0, 0.01, 0.2)];
        let mut out = Vec::new();
        fillet_corners(&curve, 0.2, &mut out);
        assert_eq!(out.len(), 3);
    }
}
