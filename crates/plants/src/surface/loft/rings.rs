//! Where rings stand along an axis and how they are turned.

use glam::Vec3;

use super::corners;
use osier_base::math;

/// A point of a centreline.
#[derive(Debug, Clone, Copy)]
pub(super) struct Knot {
    /// Position, m.
    pub p: Vec3,
    /// Radius, m.
    pub r: f32,
    /// Arc length on the axis, m.
    pub s: f32,
}

/// A ring of a tube.
#[derive(Debug, Clone, Copy)]
pub(super) struct Ring {
    /// Centre, m.
    pub c: Vec3,
    /// Unit normal of its plane.
    pub t: Vec3,
    /// Unit reference in its plane.
    pub e: Vec3,
    /// Radius, m.
    pub r: f32,
    /// Change of radius per metre.
    pub slope: f32,
    /// Arc length on the axis, m.
    pub s: f32,
    /// Integral of ds / (2 pi r) from the first ring.
    pub v: f32,
}

/// Rings are left out where the tangent hardly turned, the radius changed by less than this share ...
const TAPER: f32 = 0.1;
/// ... and the last one is nearer than this many radii ...
const SPACING: f32 = 12.0;
/// ... and the tube stays nearer to the centreline than this share of its radius, so that branches and leaves meet it.
const SAG: f32 = 0.15;
/// ... and is nowhere thicker or thinner than the axis by more than this share.
const SWELL: f32 = 0.1;
/// Rings nearer than this many radii to the last one are dropped, but for the last of all.
const CLOSE: f32 = 0.25;

/// Sweeps along the axis, forth and back, that part crossing rings.
const PASSES: usize = 4;

/// Working memory of [`choose`], kept from axis to axis.
#[derive(Debug, Default)]
pub(super) struct Scratch {
    /// Input: the centreline.
    pub knots: Vec<Knot>,
    fine: Vec<Knot>,
    tangents: Vec<Vec3>,
}

/// Appends the rings of the centreline in `scratch.knots` (at least two knots, apart) to `out`. `first`: tangent at the
/// first knot, or the first segment's direction; `e0`: wanted reference there, any vector; `turn`: rad.
/// Knots between which the tangent turns by more than `turn` are joined by a centripetal Catmull-Rom curve, or, where
/// that would bend more tightly than the tube allows, by arcs within the corners.
pub(super) fn choose(scratch: &mut Scratch, first: Option<Vec3>, e0: Vec3, turn: f32, out: &mut Vec<Ring>) {
    let start = out.len();
    tangents(&scratch.knots, first, &mut scratch.tangents);
    if corners::any_tight(&scratch.knots, turn) {
        corners::round(&scratch.knots, turn, &mut scratch.fine);
        tangents(&scratch.fine, first, &mut scratch.tangents);
    } else if refine(&scratch.knots, &scratch.tangents, turn, &mut scratch.fine) {
        tangents(&scratch.fine, first, &mut scratch.tangents);
    }
    let fixed = first.is_some();
    select((&scratch.fine, &scratch.tangents), turn, fixed, out);
    orient(&mut out[start..], e0);
    if out[start..].windows(2).any(|w| crossing(&w[0], &w[1])) {
        uncross(&mut out[start..], e0, fixed);
        drop_crossing(start, out);
        orient(&mut out[start..], e0);
    }
    measure(&mut out[start..]);
}

fn direction(a: &Knot, b: &Knot) -> Vec3 {
    math::normalize_or(b.p - a.p, Vec3::Y)
}

fn tangents(knots: &[Knot], first: Option<Vec3>, out: &mut Vec<Vec3>) {
    out.clear();
    let Some(second) = knots.get(1) else { return };
    let mut before = direction(&knots[0], second);
    out.push(first.unwrap_or(before));
    for w in knots.windows(2).skip(1) {
        let after = direction(&w[0], &w[1]);
        out.push(math::normalize_or(before + after, after));
        before = after;
    }
    out.push(before);
}

/// Copies the knots into `out` and adds points between those that turn too much; true if any were added.
fn refine(knots: &[Knot], tangents: &[Vec3], turn: f32, out: &mut Vec<Knot>) -> bool {
    out.clear();
    let limit = math::cos_f32(turn);
    for i in 0..knots.len() {
        out.push(knots[i]);
        if i + 1 < knots.len() && tangents[i].dot(tangents[i + 1]) < limit {
            insert(knots, i, tangents[i].dot(tangents[i + 1]), turn, out);
        }
    }
    out.len() > knots.len()
}

#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a ratio of angles, at most 315")]
fn insert(knots: &[Knot], i: usize, cosine: f32, turn: f32, out: &mut Vec<Knot>) {
    let (a, b) = (knots[i], knots[i + 1]);
    let room = a.p.distance(b.p) / (0.3 * a.r.max(b.r));
    let pieces = (math::acos_f32(cosine.clamp(-1.0, 1.0)) / turn).ceil().min(room).min(8.0) as u32;
    let before = if i > 0 { knots[i - 1].p } else { a.p * 2.0 - b.p };
    let after = knots.get(i + 2).map_or(b.p * 2.0 - a.p, |k| k.p);
    for k in 1..pieces {
        let u = k as f32 / pieces as f32;
        let p = catmull_rom([before, a.p, b.p, after], u);
        out.push(Knot { p, r: math::lerp(a.r, b.r, u), s: math::lerp(a.s, b.s, u) });
    }
}

/// Centripetal Catmull-Rom curve through four points, between the middle two, `u` in [0, 1].
/// Source: P. Barry, R. Goldman, "A recursive evaluation algorithm for a class of Catmull-Rom splines", SIGGRAPH 1988.
fn catmull_rom(p: [Vec3; 4], u: f32) -> Vec3 {
    let gap = |a: Vec3, b: Vec3| a.distance(b).sqrt().max(1e-6);
    let t1 = gap(p[0], p[1]);
    let t2 = t1 + gap(p[1], p[2]);
    let t3 = t2 + gap(p[2], p[3]);
    let t = math::lerp(t1, t2, u);
    let mix = |a: Vec3, b: Vec3, from: f32, to: f32| a.lerp(b, (t - from) / (to - from));
    let (a, b, c) = (mix(p[0], p[1], 0.0, t1), mix(p[1], p[2], t1, t2), mix(p[2], p[3], t2, t3));
    mix(mix(a, b, 0.0, t2), mix(b, c, t1, t3), t1, t2)
}

/// `fixed`: the first ring is prescribed, so the second stands a radius away lest it cross it.
fn select((knots, tangents): (&[Knot], &[Vec3]), turn: f32, fixed: bool, out: &mut Vec<Ring>) {
    let limit = math::cos_f32(turn);
    let (narrow, wide) = (1.0 - TAPER, 1.0 + TAPER);
    let (start, last) = (out.len(), knots.len().saturating_sub(1));
    let mut kept: Option<(Knot, Vec3)> = None;
    let mut skipped = 0;
    for (i, (k, t)) in knots.iter().zip(tangents).enumerate() {
        let wanted = kept.is_none_or(|(l, lt)| {
            let gap = k.s - l.s;
            let changed = lt.dot(*t) < limit || k.r < l.r * narrow || k.r > l.r * wide || gap > SPACING * l.r;
            let close = if fixed && out.len() == start + 1 { 1.0 } else { CLOSE };
            let sags = || sags(l, &knots[skipped..=i + 1]) || swells(l, &knots[skipped..=i + 1]);
            i == last || gap > close * l.r && (changed || sags())
        });
        if !wanted {
            continue;
        }
        skipped = i + 1;
        // The last ring replaces one that it would crowd.
        if i == last && out.len() > start + 1 && kept.is_some_and(|(l, _)| k.s - l.s < CLOSE * l.r) {
            out.pop();
        }
        out.push(Ring { c: k.p, t: *t, e: Vec3::X, r: k.r, slope: 0.0, s: k.s, v: 0.0 });
        kept = Some((*k, *t));
    }
}

/// Whether the straight line from `from` to the last of the knots passes too far from any of the others.
fn sags(from: Knot, knots: &[Knot]) -> bool {
    let Some((to, between)) = knots.split_last() else { return false };
    let along = math::normalize_or(to.p - from.p, Vec3::Y);
    between.iter().any(|k| (k.p - from.p).reject_from_normalized(along).length_squared() > (SAG * k.r) * (SAG * k.r))
}

/// Whether a tube that tapers evenly from `from` to the last of the knots is thicker or thinner than any of the others
/// by a share of [`SWELL`]: the rings of a culm's node stand where they belong.
fn swells(from: Knot, knots: &[Knot]) -> bool {
    let Some((to, between)) = knots.split_last() else { return false };
    let span = (to.s - from.s).max(1e-9);
    between.iter().any(|k| (k.r - math::lerp(from.r, to.r, (k.s - from.s) / span)).abs() > SWELL * k.r)
}

/// Whether a corner of ring `b` lies behind its twin on ring `a`, seen along the mean of their normals.
fn crossing(a: &Ring, b: &Ring) -> bool {
    let m = a.t + b.t;
    let ahead = (b.c - a.c).dot(m);
    let x = (b.e * b.r - a.e * a.r).dot(m);
    let y = (b.t.cross(b.e) * b.r - a.t.cross(a.e) * a.r).dot(m);
    ahead <= 0.0 || ahead * ahead <= 1.05 * (x * x + y * y)
}

/// Turns the planes of crossing neighbours towards their chord until what the two lean is at most 0.85 of their
/// distance. `fixed`: the first ring stays as it is.
fn uncross(rings: &mut [Ring], e0: Vec3, fixed: bool) {
    for pass in 0..PASSES {
        for k in 1..rings.len() {
            let i = if pass % 2 == 0 { k } else { rings.len() - k };
            let (a, b) = (rings[i - 1], rings[i]);
            let d = a.c.distance(b.c);
            if d < 1e-9 || !crossing(&a, &b) {
                continue;
            }
            let chord = (b.c - a.c) / d;
            let (la, lb) = (a.r * sine(a.t, chord), b.r * sine(b.t, chord));
            if fixed && i == 1 {
                rings[i].t = lean_to(b.t, chord, ((0.85 * d - la) / lb.max(1e-9)).clamp(0.0, 1.0));
            } else {
                let share = (0.85 * d / (la + lb).max(1e-9)).min(1.0);
                rings[i - 1].t = lean_to(a.t, chord, share);
                rings[i].t = lean_to(b.t, chord, share);
            }
        }
        orient(rings, e0);
    }
}

/// Removes rings, but for the first and last, that still cross the one before.
fn drop_crossing(start: usize, out: &mut Vec<Ring>) {
    let mut kept = start + 1;
    let last = out.len() - 1;
    for i in start + 1..=last {
        let ring = out[i];
        if i == last {
            while kept > start + 1 && crossing(&out[kept - 1], &ring) {
                kept -= 1;
            }
        } else if crossing(&out[kept - 1], &ring) {
            continue;
        }
        out[kept] = ring;
        kept += 1;
    }
    out.truncate(kept);
}

fn sine(a: Vec3, b: Vec3) -> f32 {
    (1.0 - a.dot(b) * a.dot(b)).max(0.0).sqrt()
}

/// The direction whose sine against `chord` is `share` of that of `t`, on the same side, leaning forward.
fn lean_to(t: Vec3, chord: Vec3, share: f32) -> Vec3 {
    let across = t - chord * t.dot(chord);
    let s = across.length() * share;
    let c = (1.0 - s * s).max(0.0).sqrt();
    math::normalize_or(chord * c + across * share, chord)
}

fn orient(rings: &mut [Ring], e0: Vec3) {
    let Some(first) = rings.first_mut() else { return };
    let across = e0 - first.t * first.t.dot(e0);
    first.e = if across.length_squared() > 1e-6 { across.normalize() } else { math::perpendicular(first.t) };
    for i in 1..rings.len() {
        let (a, b) = (rings[i - 1], rings[i]);
        rings[i].e = math::transport(a.c, a.t, a.e, b.c, b.t);
    }
}

/// Slopes by differences over the neighbours, and the integral along the axis that texture coordinates need. The
/// thinnest quarter of an axis is measured as if it were a quarter as thick as its base, lest v run away at the tip.
fn measure(rings: &mut [Ring]) {
    let n = rings.len();
    let least = rings.first().map_or(0.0, |r| r.r * 0.25);
    for i in 0..n {
        let (a, b) = (rings[i.saturating_sub(1)], rings[(i + 1).min(n - 1)]);
        let span = b.s - a.s;
        rings[i].slope = if span > 1e-9 { ((b.r - a.r) / span).clamp(-4.0, 4.0) } else { 0.0 };
        if i > 0 {
            let mean = (a.r.max(least) + rings[i].r.max(least)) * 0.5;
            rings[i].v = a.v + (rings[i].s - a.s) / (std::f32::consts::TAU * mean);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn helix(turns: u32, per_turn: u32, radius: f32, pitch: f32) -> Vec<Knot> {
        let knot = |i: u32| {
            let a = i as f32 / per_turn as f32 * std::f32::consts::TAU;
            let p = Vec3::new(radius * math::cos_f32(a), pitch * a, radius * math::sin_f32(a));
            Knot { p, r: 0.01, s: a * (radius * radius + pitch * pitch).sqrt() }
        };
        (0..=turns * per_turn).map(knot).collect()
    }

    #[test]
    fn roll_on_a_helix_is_the_integral_of_torsion() {
        let (radius, pitch, turns) = (1.0_f32, 0.3_f32, 3_u32);
        let mut scratch = Scratch { knots: helix(turns, 64, radius, pitch), ..Scratch::default() };
        let mut rings = Vec::new();
        choose(&mut scratch, None, Vec3::Y, 0.01, &mut rings);
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
    fn no_flip_at_vertical_or_reversed_tangents() {
        // Straight up, then a loop back to straight up: the tangent passes every direction of a plane.
        let point = |i: u32| {
            let a = i.saturating_sub(4).min(24) as f32 * (std::f32::consts::TAU / 24.0);
            let rise = i.min(4) as f32 * 0.25 + i.saturating_sub(28) as f32 * 0.25;
            Vec3::new(0.002 * i as f32, rise + math::sin_f32(a), 1.0 - math::cos_f32(a))
        };
        let knots = (0..34).map(|i| Knot { p: point(i), r: 0.05, s: 0.25 * i as f32 }).collect();
        let mut rings = Vec::new();
        choose(&mut Scratch { knots, ..Scratch::default() }, None, Vec3::X, 0.2, &mut rings);
        assert!(rings.iter().any(|r| r.t.y < -0.9) && rings.iter().any(|r| r.t.y > 0.99));
        for r in &rings {
            assert!(r.e.x > 0.9, "{} at {}", r.e, r.c);
            assert!(r.e.dot(r.t).abs() < 1e-5 && (r.e.length() - 1.0).abs() < 1e-5);
        }
    }
}
