//! Corners too tight or too sharp for a smooth curve through the nodes: arcs in their place.

use glam::Vec3;

use super::rings::Knot;
use osier_base::math;

/// A corner is tight when a curve through it has less than this many radii of room to bend in.
const TIGHT: f32 = 1.7;
/// A corner is meant as one, whatever the room, when half its angle has a tangent whose square is above this: 58 degrees.
const SHARP: f32 = 0.3073;
/// Radius of an arc, in radii of the tube ...
const WIDE: f32 = 1.1;
/// ... and the least with which its rings stay apart on the inner side.
const LEAST: f32 = 1.04;

/// A knot with the directions of the segments before and behind it.
struct Corner {
    before: Vec3,
    after: Vec3,
    /// Tangent of half the angle.
    tan: f32,
    /// Lengths of both segments, m.
    lengths: (f32, f32),
}

impl Corner {
    fn new(w: &[Knot]) -> Option<Self> {
        let [a, b, c] = w else { return None };
        let (x, y) = (b.p - a.p, c.p - b.p);
        let lengths = (x.length(), y.length());
        let (before, after) = (math::normalize_or(x, y), math::normalize_or(y, x));
        let tan = before.cross(after).length() / (1.0 + before.dot(after)).max(1e-6);
        Some(Self { before, after, tan, lengths })
    }
}

/// Whether the centreline has a tight or a sharp corner of more than `turn` (rad).
pub(super) fn any_tight(knots: &[Knot], turn: f32) -> bool {
    let least = (0.5 * turn) * (0.5 * turn);
    knots.windows(3).any(|w| {
        let (x, y) = (w[1].p - w[0].p, w[2].p - w[1].p);
        let (x2, y2) = (x.length_squared(), y.length_squared());
        let room = (x2 * y2).sqrt();
        // Square of the tangent of half the angle, as a fraction.
        let (above, below) = (room - x.dot(y), (room + x.dot(y)).max(1e-12));
        let reach = TIGHT * w[1].r;
        let tight = above > least * below && 0.25 * x2.min(y2) * below < reach * reach * above;
        tight || above > SHARP.max(least) * below
    })
}

/// Copies the knots into `out` with an arc of about [`WIDE`] radii in place of every corner of more than `turn` (rad).
/// Neighbours that want the same segment share it in proportion; where less than [`LEAST`] radii remain, the knot stays.
/// Own.
pub(super) fn round(knots: &[Knot], turn: f32, out: &mut Vec<Knot>) {
    out.clear();
    let wanted = |i: usize| {
        let corner = i.checked_sub(1).and_then(|h| knots.get(h..h + 3)).and_then(Corner::new);
        corner.map_or(0.0, |c| WIDE * knots[i].r * c.tan)
    };
    for (i, knot) in knots.iter().enumerate() {
        let corner = i.checked_sub(1).and_then(|h| knots.get(h..h + 3)).and_then(Corner::new);
        let Some(c) = corner.filter(|c| c.tan > 0.5 * turn) else {
            out.push(*knot);
            continue;
        };
        let own = wanted(i);
        let share = |length: f32, other: f32| (length / (own + other).max(1e-9)).min(1.0);
        let part = share(c.lengths.0, wanted(i - 1)).min(share(c.lengths.1, wanted(i + 1)));
        if WIDE * part < LEAST {
            out.push(*knot);
        } else {
            arc(knots, i, (&c, own * part), turn, out);
        }
    }
}

/// The arc that touches both segments `reach` away from knot `i`.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "1 to 8")]
fn arc(knots: &[Knot], i: usize, (c, reach): (&Corner, f32), turn: f32, out: &mut Vec<Knot>) {
    let k = knots[i];
    let angle = math::acos_f32(c.before.dot(c.after).clamp(-1.0, 1.0));
    let pieces = (angle / turn).ceil().clamp(1.0, 8.0) as u8;
    let inward = math::normalize_or(c.after - c.before, c.before);
    let radius = reach / c.tan;
    let side = math::normalize_or(inward.reject_from_normalized(c.before), inward);
    let start = k.p - c.before * reach;
    let (from, to) = (reach.min(k.s - knots[i - 1].s), reach.min(knots[i + 1].s - k.s));
    let slope = |other: &Knot| (other.r - k.r) / (other.s - k.s).abs().max(1e-9);
    let (back, ahead) = (slope(&knots[i - 1]), slope(&knots[i + 1]));
    for step in 0..=pieces {
        let u = f32::from(step) / f32::from(pieces);
        let a = angle * u;
        let p = start + c.before * (radius * math::sin_f32(a)) + side * (radius * (1.0 - math::cos_f32(a)));
        let s = k.s - from + (from + to) * u;
        let r = k.r + if s < k.s { back * (k.s - s) } else { ahead * (s - k.s) };
        out.push(Knot { p, r, s });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_arc_touches_both_segments_and_keeps_its_radius() {
        let knot = |x: f32, y: f32, s: f32| Knot { p: Vec3::new(x, y, 0.0), r: 0.1, s };
        let knots = [knot(0.0, 0.0, 0.0), knot(0.3, 0.0, 0.3), knot(0.3, 0.3, 0.6)];
        assert!(any_tight(&knots, 0.2) && !any_tight(&knots, 2.2));
        let mut out = Vec::new();
        round(&knots, 0.2, &mut out);
        assert_eq!((out[0].p, out[out.len() - 1].p), (knots[0].p, knots[2].p));
        let middle = Vec3::new(0.3 - 0.11, 0.11, 0.0);
        for k in &out[1..out.len() - 1] {
            assert!((k.p.distance(middle) - 0.11).abs() < 1e-5, "{k:?}");
        }
        assert!(out.len() > 6 && out.windows(2).all(|w| w[0].s < w[1].s));
    }

    #[test]
    fn a_sharp_corner_with_all_the_room_stays_one() {
        let knot = |x: f32, y: f32, s: f32| Knot { p: Vec3::new(x, y, 0.0), r: 0.01, s };
        let corner = |degrees: f32| {
            let a = degrees.to_radians();
            [knot(0.0, 0.0, 0.0), knot(5.0, 0.0, 5.0), knot(5.0 + 5.0 * math::cos_f32(a), 5.0 * math::sin_f32(a), 10.0)]
        };
        assert!(any_tight(&corner(60.0), 0.2) && !any_tight(&corner(55.0), 0.2));
    }

    #[test]
    fn a_corner_without_room_keeps_its_knot() {
        let knot = |x: f32, y: f32, s: f32| Knot { p: Vec3::new(x, y, 0.0), r: 0.1, s };
        let knots = [knot(0.0, 0.0, 0.0), knot(0.1, 0.0, 0.1), knot(0.0, 0.01, 0.2)];
        let mut out = Vec::new();
        round(&knots, 0.2, &mut out);
        assert_eq!(out.len(), 3);
    }
}
