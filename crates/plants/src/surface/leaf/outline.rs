//! The outline of the flat blade: margin, midrib and side veins, in metres; base at the origin, tip at (0, length).

use glam::Vec2;

use super::{BladeSpec, LeafForm};
use osier_base::math;
use osier_base::rng::Rng;

/// A side vein from the midrib to the margin, a quadratic curve.
#[derive(Debug, Clone, Copy)]
pub(super) struct Vein {
    pub root: Vec2,
    pub bend: Vec2,
    pub tip: Vec2,
    /// Index of the tip in the margin of its half.
    pub at: usize,
}

impl Vein {
    /// Point at `t` in [0, 1] from the midrib to the margin.
    pub fn point(&self, t: f32) -> Vec2 {
        let s = 1.0 - t;
        self.root * (s * s) + self.bend * (2.0 * s * t) + self.tip * (t * t)
    }
}

/// Margin and side veins of one side of the flat blade.
#[derive(Debug, Clone)]
pub(super) struct BladeHalf {
    /// Points of the margin from the base to the tip of the blade, both included.
    pub margin: Vec<Vec2>,
    /// Side veins from the base to the tip; their roots and tips ascend.
    pub veins: Vec<Vein>,
}

impl BladeHalf {
    /// Removes veins whose straight line crosses the margin, as that of a bent vein beside a deep bay does. Then removes the
    /// points of the margin that change its shape least, until `most` are left, except those where a vein ends and those without which
    /// the margin would cross a vein.
    /// Source: Visvalingam and Whyatt 1993, "Line generalisation by repeated elimination of points".
    pub fn simplify(&mut self, most: usize) {
        let edges = || self.margin.windows(2);
        self.veins.retain(|v| edges().all(|edge| !cross(edge[0], edge[1], v.root, v.tip)));
        while self.margin.len() > most {
            // Visvalingam's measure: the area of the triangle with both neighbours.
            let fixed = |i: usize| {
                let [from, to] = [i - 1, i + 1];
                let is_cut =
                    |v: &Vein| v.at != from && v.at != to && cross(self.margin[from], self.margin[to], v.root, v.tip);
                self.veins.iter().any(|v| v.at == i || is_cut(v))
            };
            let area = |i: usize| {
                let [a, b, c] = [i - 1, i, i + 1].map(|k| self.margin[k]);
                (b - a).perp_dot(c - a).abs()
            };
            let free = (1..self.margin.len().saturating_sub(1)).filter(|i| !fixed(*i));
            let Some(least) = free.min_by(|i, j| area(*i).total_cmp(&area(*j))) else { return };
            self.margin.remove(least);
            self.veins.iter_mut().filter(|v| v.at > least).for_each(|v| v.at -= 1);
        }
    }
}

/// Whether the line from `a` to `b` crosses that from `c` to `d`; lines that touch do not.
fn cross(a: Vec2, b: Vec2, c: Vec2, d: Vec2) -> bool {
    let side = |p: Vec2, q: Vec2, r: Vec2| (q - p).perp_dot(r - p);
    side(a, b, c) * side(a, b, d) < 0.0 && side(c, d, a) * side(c, d, b) < 0.0
}

/// Margin and veins of a flat blade.
#[derive(Debug, Clone)]
pub(super) struct BladeOutline {
    /// Right (x > 0), then left.
    pub halves: [BladeHalf; 2],
    /// Heights on the midrib: base, all vein roots, tip, increasing.
    pub midrib: Vec<f32>,
    /// Part of the plane that the texture covers, m: smallest corner and size of the margins' box, grown by 2 % on every side.
    pub frame: (Vec2, Vec2),
}

impl BladeOutline {
    /// The outline of a blade. `smooth`: points along each piece of a margin without teeth; `teeth`: whether teeth are made.
    pub fn new(spec: &BladeSpec, smooth: u32, teeth: bool) -> Self {
        let halves = [half(spec, 1.0, smooth, teeth), half(spec, -1.0, smooth, teeth)];
        let mut midrib = vec![0.0, spec.length];
        midrib.extend(halves.iter().flat_map(|h| h.veins.iter().map(|v| v.root.y)));
        midrib.sort_by(f32::total_cmp);
        let points = || halves.iter().flat_map(|h| h.margin.iter().copied());
        let (low, high) = points().fold((Vec2::INFINITY, Vec2::NEG_INFINITY), |(a, b), p| (a.min(p), b.max(p)));
        let pad = (high - low) * 0.02;
        Self { halves, midrib, frame: (low - pad, high - low + pad * 2.0) }
    }

    /// Removes the side veins, all points of the midrib but its ends and its middle, and points of the margins until each has at most
    /// `most`. Returns the former area divided by the present one.
    pub fn simplify_without_veins(&mut self, most: usize) -> f32 {
        let area = |halves: &[BladeHalf; 2]| {
            let [right, left] =
                halves.each_ref().map(|h| h.margin.windows(2).map(|w| w[0].perp_dot(w[1])).sum::<f32>());
            0.5 * (right - left)
        };
        let former = area(&self.halves);
        for half in &mut self.halves {
            half.veins.clear();
            half.simplify(most);
        }
        let tip = self.midrib.last().copied().unwrap_or_default();
        self.midrib = vec![0.0, 0.5 * tip, tip];
        former / area(&self.halves)
    }

    /// Texture coordinates of a point of the flat blade: 0 to 1 over [`Self::frame`].
    pub fn uv(&self, p: Vec2) -> Vec2 {
        (p - self.frame.0) / self.frame.1
    }
}

/// Control points of one side in shares of (half width, length), base and tip included.
fn control_points(spec: &BladeSpec, draw: &mut Rng) -> Vec<Vec2> {
    let table: &[[f32; 2]] = match spec.form {
        LeafForm::Lobed { lobes, depth } => return lobed(lobes, depth, draw),
        LeafForm::Palmate { lobes, depth } => return palmate(lobes, depth, draw),
        LeafForm::Rhombic => &[
            [0.0, 0.0],
            [0.28, 0.012],
            [0.62, 0.095],
            [0.9, 0.22],
            [1.0, 0.34],
            [0.86, 0.48],
            [0.6, 0.64],
            [0.33, 0.8],
            [0.12, 0.92],
            [0.0, 1.0],
        ],
        LeafForm::Deltoid => &[
            [0.0, 0.0],
            [0.3, -0.028],
            [0.66, -0.012],
            [0.93, 0.07],
            [1.0, 0.19],
            [0.88, 0.34],
            [0.64, 0.52],
            [0.37, 0.7],
            [0.16, 0.84],
            [0.06, 0.92],
            [0.0, 1.0],
        ],
        LeafForm::Petal { notch } => return petal(notch, spec.width / spec.length),
        LeafForm::Elliptic => {
            &[[0.0, 0.0], [0.35, 0.07], [0.8, 0.28], [1.0, 0.5], [0.8, 0.74], [0.35, 0.93], [0.0, 1.0]]
        }
    };
    table.iter().map(|&[x, y]| Vec2::new(x, y)).collect()
}

/// Obovate with rounded lobes that lean to the tip: for each lobe its lower shoulder, tip and upper shoulder, then the
/// bottom of the bay above.
#[allow(clippy::cast_precision_loss, reason = "at most 8 lobes")]
fn lobed(lobes: u32, depth: f32, draw: &mut Rng) -> Vec<Vec2> {
    // Half width of the envelope at height y.
    let envelope = |y: f32| 0.16 + 0.84 * math::smoothstep(0.0, 0.58, y) - 0.75 * math::smoothstep(0.62, 1.04, y);
    let mut wobble = |amount: f64| math::narrow(draw.range(-amount, amount));
    let mut out = vec![Vec2::ZERO, Vec2::new(0.1, 0.02)];
    let n = lobes as f32;
    // Lobes are spaced evenly between 13 and 89 % of the length; bays lie midway.
    let height = |k: f32| 0.13 + 0.76 * (k + 0.5) / (n + 0.2);
    let step = height(1.0) - height(0.0);
    for i in 0..lobes {
        let k = i as f32;
        let y = height(k) + wobble(0.08) * step;
        let x = envelope(y) * (1.0 + wobble(0.05));
        let bay_y = height(k + 0.5) + wobble(0.05) * step;
        // Bays are deepest in the middle of the blade.
        let deep = depth * (0.72 + 0.36 * math::sin_f32(std::f32::consts::PI * (k + 0.8) / (n + 0.6)));
        let bay = envelope(bay_y) * (1.0 - deep + wobble(0.04));
        out.push(Vec2::new(math::lerp(bay, x, 0.74), y - 0.20 * step));
        out.push(Vec2::new(x, y + 0.13 * step));
        out.push(Vec2::new(math::lerp(bay, x, 0.72), y + 0.38 * step));
        out.push(Vec2::new(bay.max(0.08), bay_y + 0.06 * step));
    }
    let top = height(n - 0.5) + 0.3 * step;
    out.extend([Vec2::new(0.33, top), Vec2::new(0.31, 0.965), Vec2::new(0.15, 0.995), Vec2::new(0.0, 1.0)]);
    out
}

/// Obovate with a rounded tip; `notch`: depth of the bay in it, share of the half width; `aspect`: width divided by
/// length.
fn petal(notch: f32, aspect: f32) -> Vec<Vec2> {
    // The bay ends at the tip of the midrib, so the shoulders on both sides of the bay lie above that tip.
    let rise = notch * 0.5 * aspect;
    let table = [[0.0, 0.0], [0.2, 0.04], [0.42, 0.2], [0.72, 0.42], [0.97, 0.66], [0.93, 0.83]];
    let mut out: Vec<Vec2> = table.iter().map(|&[x, y]| Vec2::new(x, y)).collect();
    out.extend([Vec2::new(0.66, 0.95 + 0.75 * rise), Vec2::new(0.36, 0.988 + rise), Vec2::new(0.0, 1.0)]);
    out
}

/// Angle from the midrib of the lowest lobe of a palmate leaf, rad, and the length of that lobe divided by that of the
/// middle lobe.
const LOWEST_LOBE: [f32; 2] = [1.85, 0.5];

/// Pointed lobes about the base, the lowest first: for each its lower shoulder, tip and upper shoulder, then the bottom of the
/// bay above, as [`lobed`]; then half of the middle lobe.
#[allow(clippy::cast_precision_loss, reason = "at most 4 lobes")]
fn palmate(lobes: u32, depth: f32, draw: &mut Rng) -> Vec<Vec2> {
    let mut wobble = |amount: f64| math::narrow(draw.range(-amount, amount));
    let n = lobes as f32;
    // Lobe `k` of `n`, counted from the middle one (0) down: its angle to the midrib and its length; fractions are the bays.
    let angle = |k: f32| LOWEST_LOBE[0] * k / n;
    let reach = |k: f32| 1.0 - (1.0 - LOWEST_LOBE[1]) * (k / n).max(0.0) * math::sqrt_f32(k / n);
    let at = |angle: f32, radius: f32| Vec2::new(math::sin_f32(angle), math::cos_f32(angle)) * radius;
    let step = LOWEST_LOBE[0] / n;
    // Shoulders of deep lobes are narrow: their angle to the lobe's axis, and their distance from the base.
    let shoulder = step * (0.42 - 0.22 * depth);
    let out_to = 0.62 + 0.1 * depth;
    let mut out = vec![Vec2::ZERO, at(angle(n) + 0.7 * step, 0.06)];
    for i in 0..lobes {
        let k = n - i as f32;
        let a = angle(k) + wobble(0.04) * step;
        let r = reach(k) * (1.0 + wobble(0.05));
        let bay = reach(k - 0.5) * (1.0 - depth) * 0.9 * (1.0 + wobble(0.05));
        out.push(at(a + shoulder, r * out_to));
        out.push(at(a, r));
        out.push(at(a - shoulder, r * (out_to + 0.04)));
        out.push(at(angle(k - 0.5) + wobble(0.04) * step, bay));
    }
    out.push(at(shoulder, out_to));
    out.push(at(0.34 * shoulder, 0.84));
    out.push(Vec2::new(0.0, 1.0));
    // x in shares of the widest lobe, since the caller multiplies by the half width.
    let widest = out.iter().fold(0.0_f32, |w, p| w.max(p.x)).max(1e-3);
    out.iter().map(|p| Vec2::new(p.x / widest, p.y)).collect()
}

/// Margin and veins of one side; `side`: 1 right, -1 left.
fn half(spec: &BladeSpec, side: f32, smooth: u32, teeth: bool) -> BladeHalf {
    let word = if side > 0.0 { "right" } else { "left" };
    let mut draw = Rng::at(spec.seed, &["blade".into(), word.into()]);
    // Work on the positive side, then mirror: the sides draw from different streams and so differ a little.
    let scale = Vec2::new(spec.width * 0.5, spec.length);
    let points: Vec<Vec2> = control_points(spec, &mut draw).iter().map(|p| *p * scale).collect();
    let lobed = matches!(spec.form, LeafForm::Lobed { .. } | LeafForm::Palmate { .. });
    let curve = spline(&points, smooth);
    let (mut margin, tips) = match (teeth && spec.teeth.count > 0, lobed) {
        (true, _) => toothed(spec, &spline(&points, 12), &mut draw),
        // Lobe tips are every fourth control point from the fourth on.
        (false, true) => {
            let tips = (0..).map(|k| (3 + 4 * k) * smooth as usize).take_while(|t| t + 4 < curve.len());
            (curve.clone(), tips.take(vein_count(spec)).collect())
        }
        (false, false) => (curve.clone(), evenly_spaced_tips(&curve, spec)),
    };
    let mut veins = veins(spec, &margin, &tips, side);
    for p in &mut margin {
        p.x *= side;
    }
    for v in &mut veins {
        for p in [&mut v.root, &mut v.bend, &mut v.tip] {
            p.x *= side;
        }
    }
    BladeHalf { margin, veins }
}

/// Number of side veins on a side: one per lobe, otherwise the number of the species.
fn vein_count(spec: &BladeSpec) -> usize {
    match spec.form {
        LeafForm::Lobed { lobes, .. } | LeafForm::Palmate { lobes, .. } => lobes as usize,
        _ => spec.veins as usize,
    }
}

/// Catmull-Rom curve (centripetal) through the points, `pieces` points for each span.
fn spline(points: &[Vec2], pieces: u32) -> Vec<Vec2> {
    let mut out = Vec::with_capacity(points.len() * pieces as usize);
    for (i, w) in points.windows(2).enumerate() {
        let (a, b) = (w[0], w[1]);
        // Beyond base and tip the margin continues with its mirror image, so that its tangent is level there.
        let before = if i > 0 { points[i - 1] } else { Vec2::new(-b.x, b.y) };
        let after = points.get(i + 2).copied().unwrap_or(Vec2::new(-a.x, a.y));
        for k in 0..pieces {
            out.push(span([before, a, b, after], k as f32 / pieces as f32));
        }
    }
    out.extend(points.last());
    out
}

/// Point at `u` (0..1) of the span between the second and the third of four points.
/// Source: P. Barry, R. Goldman, SIGGRAPH 1988, with centripetal knots t_i+1 = t_i + |p_i+1 - p_i|^(1/2).
fn span(p: [Vec2; 4], u: f32) -> Vec2 {
    let gap = |a: Vec2, b: Vec2| a.distance(b).sqrt().max(1e-5);
    let (t1, t2) = (gap(p[0], p[1]), gap(p[0], p[1]) + gap(p[1], p[2]));
    let t3 = t2 + gap(p[2], p[3]);
    let t = math::lerp(t1, t2, u);
    let mix = |a: Vec2, b: Vec2, from: f32, to: f32| a.lerp(b, (t - from) / (to - from));
    let (a, b, c) = (mix(p[0], p[1], 0.0, t1), mix(p[1], p[2], t1, t2), mix(p[2], p[3], t2, t3));
    mix(mix(a, b, 0.0, t2), mix(b, c, t1, t3), t1, t2)
}

/// Arc length of each point of a polyline from the first, m.
fn arc_lengths(line: &[Vec2]) -> Vec<f32> {
    let mut sum = 0.0;
    let mut out = vec![0.0];
    out.extend(line.windows(2).map(|w| {
        sum += w[0].distance(w[1]);
        sum
    }));
    out
}

/// Point and unit direction at arc length `a`, m, of a polyline with these arc lengths.
fn along(line: &[Vec2], arc_lengths: &[f32], a: f32) -> (Vec2, Vec2) {
    let k = arc_lengths.partition_point(|v| *v <= a).clamp(1, line.len() - 1);
    let (p, q) = (line[k - 1], line[k]);
    let t = ((a - arc_lengths[k - 1]) / (arc_lengths[k] - arc_lengths[k - 1]).max(1e-9)).clamp(0.0, 1.0);
    (p.lerp(q, t), (q - p).normalize_or(Vec2::Y))
}

/// Share of the margin, from the base, where teeth begin and end.
fn toothed_range(spec: &BladeSpec) -> (f32, f32) {
    match spec.form {
        LeafForm::Deltoid => (0.26, 0.93),
        LeafForm::Rhombic => (0.2, 0.97),
        _ => (0.1, 0.96),
    }
}

/// Height up to which single teeth do not fold over each other, as a multiple of their length along the margin. Own, from blades of
/// 12 to 40 teeth: they fold from 1 on; 0.7 keeps a distance from that.
const STEEPEST_SINGLE_TOOTH: f32 = 0.7;
/// Height up to which teeth with two or more minor ones between them do not fold over each other. Own, from the same
/// blades: with two minor teeth, which are half as high, large ones fold from 1.6 on; more minor teeth count as two.
const STEEPEST_DOUBLE_TOOTH: f32 = 1.4;
/// Increase of this height for each minor tooth, so that two of them lead from the one limit to the other.
const STEEPER_PER_MINOR_TOOTH: f32 = 0.35;

/// Depth of teeth, share of the width of the blade, up to which their flanks do not fold over each other.
#[allow(clippy::cast_precision_loss, reason = "at most 300 teeth")]
pub fn steepest_teeth(spec: &BladeSpec) -> f32 {
    let scale = Vec2::new(spec.width * 0.5, spec.length);
    let mut draw = Rng::at(spec.seed, &["blade".into(), "right".into()]);
    let points: Vec<Vec2> = control_points(spec, &mut draw).iter().map(|p| *p * scale).collect();
    let total = arc_lengths(&spline(&points, 12)).last().copied().unwrap_or(0.0);
    let (from, to) = toothed_range(spec);
    let count = spec.teeth.count.max(1) * (spec.teeth.minor + 1);
    let step = (to - from) * total / count as f32;
    let height = STEEPEST_SINGLE_TOOTH + STEEPER_PER_MINOR_TOOTH * spec.teeth.minor as f32;
    height.min(STEEPEST_DOUBLE_TOOTH) * step / spec.width
}

/// A margin of teeth that point to the tip, and the indices of the vein tips: with minor teeth a vein ends in every
/// large tooth, otherwise the veins are spread over the teeth.
#[allow(clippy::cast_precision_loss, reason = "at most 60 teeth of 5 points")]
fn toothed(spec: &BladeSpec, curve: &[Vec2], draw: &mut Rng) -> (Vec<Vec2>, Vec<usize>) {
    // Teeth are placed by arc length between the toothless base and tip.
    let lengths = arc_lengths(curve);
    let total = lengths.last().copied().unwrap_or(0.0);
    let (from, to) = toothed_range(spec);
    let (from, to) = (from * total, to * total);
    let each = spec.teeth.minor + 1;
    let n = spec.teeth.count * each;
    let mut margin: Vec<Vec2> = (0..6).map(|k| along(curve, &lengths, from * k as f32 / 6.0).0).collect();
    let mut tips = Vec::new();
    let step = (to - from) / n as f32;
    for k in 0..n {
        let major = k % each == each - 1;
        let share = k as f32 / n as f32;
        // Height of the tooth: half for minor ones, falling by 55 % towards the tip, with 15 % of irregularity.
        let size = spec.teeth.depth * spec.width * if major { 1.0 } else { 0.5 } * (1.0 - 0.55 * share);
        let size = size * math::narrow(draw.range(0.85, 1.15));
        let here = from + step * (k as f32 + math::narrow(draw.range(-0.08, 0.08)));
        // A tooth is a notch inside the curve and a tip outside it, shifted towards the tip of the blade.
        let (notch, t) = along(curve, &lengths, here);
        let out = Vec2::new(t.y, -t.x);
        let reach = if major { 0.82 } else { 0.74 };
        let (tip, tt) = along(curve, &lengths, here + step * reach);
        margin.push(notch - out * (size * 0.35));
        if spec.teeth.minor == 0 {
            // Rounded: the shoulder keeps the height before the tip.
            let (shoulder, ts) = along(curve, &lengths, here + step * 0.45);
            margin.push(shoulder + Vec2::new(ts.y, -ts.x) * (size * 0.55));
        }
        if major {
            tips.push(margin.len());
        }
        margin.push(tip + Vec2::new(tt.y, -tt.x) * size + tt * (size * 0.4));
    }
    let (last, _) = along(curve, &lengths, to + step * 0.25);
    margin.push(last);
    margin.extend(curve.last());
    let wanted = vein_count(spec);
    if tips.len() > wanted {
        let pick = |i: usize| tips[(i * tips.len()) / wanted];
        tips = (0..wanted).map(pick).collect();
    }
    (margin, tips)
}

/// Vein tips at equal steps along an untoothed margin.
fn evenly_spaced_tips(curve: &[Vec2], spec: &BladeSpec) -> Vec<usize> {
    let lengths = arc_lengths(curve);
    let total = lengths.last().copied().unwrap_or(0.0);
    let (from, to) = toothed_range(spec);
    let n = vein_count(spec);
    let at = |i: usize| (from + (to - from) * (i as f32 + 0.6) / (n as f32 + 0.6)) * total;
    let mut tips: Vec<usize> =
        (0..n).map(|i| lengths.partition_point(|a| *a < at(i)).clamp(1, curve.len() - 2)).collect();
    tips.dedup();
    tips
}

/// Veins to the given margin points; roots rise along the midrib, the lowest near the base. Positive side.
fn veins(spec: &BladeSpec, margin: &[Vec2], tips: &[usize], side: f32) -> Vec<Vein> {
    let slope = math::cos_f32(spec.vein_angle) / math::sin_f32(spec.vein_angle);
    // Veins of the left side leave the midrib a little higher, so that the sides alternate.
    let shift = if side > 0.0 { 0.0 } else { 0.012 * spec.length };
    let gap = 0.018 * spec.length;
    let rise = if matches!(spec.form, LeafForm::Lobed { .. }) { 0.6 } else { 0.42 };
    let mut lowest = gap;
    let mut out = Vec::with_capacity(tips.len());
    for (i, &at) in tips.iter().enumerate() {
        let Some(&tip) = margin.get(at) else { continue };
        let most = spec.length * (0.97 - 0.03 * (tips.len() - i) as f32);
        // Lead the vein back from its tip at the species' angle to the midrib; roots keep their order and a least
        // distance.
        // Veins of palmate leaves all come from the base.
        let y = if matches!(spec.form, LeafForm::Palmate { .. }) { lowest } else { tip.y - tip.x * slope + shift };
        let y = y.clamp(lowest, most.max(lowest));
        let mut vein = Vein { root: Vec2::ZERO, bend: Vec2::ZERO, tip, at };
        // A vein is straight at first and bends to the tip of the blade near the margin; its root is moved up if the
        // vein would cross a bay.
        for k in 0..16_u8 {
            let y = (y + 0.012 * spec.length * f32::from(k)).min(most.max(lowest));
            vein.root = Vec2::new(0.0, y);
            vein.bend = Vec2::new(tip.x * 0.55, math::lerp(y, tip.y, rise));
            if is_inside_margin(margin, &vein) {
                break;
            }
        }
        lowest = vein.root.y + gap;
        out.push(vein);
    }
    out
}

/// True if the polylines that meshes make of the vein lie between midrib and margin.
fn is_inside_margin(margin: &[Vec2], vein: &Vein) -> bool {
    // The vein as the meshes of the detail levels draw it: polylines with these parameters.
    let cuts: [&[f32]; 2] = [&[0.0, 0.34, 0.68, 1.0], &[0.0, 0.5, 1.0]];
    cuts.iter().flat_map(|c| c.windows(2)).all(|w| {
        let (a, b) = (vein.point(w[0]), vein.point(w[1]));
        (1..20_u8).all(|k| inside(margin, a.lerp(b, f32::from(k) / 20.0)))
    })
}

/// Whether `p` lies between the midrib and the margin.
fn inside(margin: &[Vec2], p: Vec2) -> bool {
    // Even-odd rule: count the edges that a ray towards +x crosses.
    let crosses = |w: &&[Vec2]| {
        let (a, b) = (w[0], w[1]);
        (a.y > p.y) != (b.y > p.y) && a.x + (b.x - a.x) * (p.y - a.y) / (b.y - a.y) > p.x
    };
    margin.windows(2).filter(crosses).count() % 2 == 1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn margins_are_simple_and_veins_end_on_them() {
        let palmate = |lobes, depth| BladeSpec { form: LeafForm::Palmate { lobes, depth }, ..BladeSpec::maple() };
        let maples = [palmate(1, 0.3), palmate(2, 0.4), palmate(3, 0.7), palmate(4, 0.85)];
        let petal = |notch| BladeSpec { form: LeafForm::Petal { notch }, ..BladeSpec::petal() };
        let petals = [petal(0.0), petal(0.4), petal(0.9)];
        let leaves = [BladeSpec::oak(), BladeSpec::birch(), BladeSpec::poplar()];
        for spec in leaves.into_iter().chain(maples).chain(petals) {
            let o = BladeOutline::new(&spec, 4, true);
            for half in &o.halves {
                assert!(half.veins.len() >= 5.min(vein_count(&spec)));
                assert!(half.veins.windows(2).all(|v| v[0].root.y < v[1].root.y && v[0].at < v[1].at));
                assert!(half.veins.iter().all(|v| half.margin[v.at] == v.tip));
                let m = &half.margin;
                for i in 0..m.len() - 1 {
                    for j in i + 2..m.len() - 1 {
                        assert!(!cross(m[i], m[i + 1], m[j], m[j + 1]), "{:?}: {i} crosses {j}", spec.form);
                    }
                }
            }
            assert!((o.frame.1.x / 1.04 / spec.width - 1.0).abs() < 0.15, "{:?} {}", spec.form, o.frame.1);
        }
    }
}
