//! The foot of a side branch: rows that lie on the parent's surface and ease into the branch.

use glam::{Vec2, Vec3};

use super::Binding;
use super::emit::Job;
use super::link::{foot_rows, rolled, v_of, v_scale};
use super::plan::{Base, Foot, Plan};
use super::rings::Ring;
use super::row::Out;
use osier_base::math;

/// Most corners of a row: 32 sides and the seam.
const CORNERS: usize = 33;

/// One segment of a tube: the cone through two rings, thinned to the middle of the polygon's sides.
#[derive(Debug, Clone, Copy)]
struct Cone {
    /// Centre of the lower ring, m, and unit direction to the upper one.
    a: Vec3,
    along: Vec3,
    /// Distance of the rings, m.
    length: f32,
    /// Radius at the lower ring, m, and its change per metre.
    radius: f32,
    growth: f32,
    /// Length by which a normal is out when it leans by `growth`.
    lean: f32,
}

impl Cone {
    fn new((a, ra): (Vec3, f32), (b, rb): (Vec3, f32), inner: f32) -> Self {
        let span = b - a;
        let length = span.length().max(1e-9);
        let growth = (rb - ra) * inner / length;
        let lean = 1.0 / (1.0 + growth * growth).sqrt();
        Self { a, along: span / length, length, radius: ra * inner, growth, lean }
    }

    /// Where the line `x + t dir` leaves the cone: t, place between the rings (0..1 inside) and unit normal.
    fn exit(&self, x: Vec3, dir: Vec3) -> (f32, f32, Vec3) {
        let w = x - self.a;
        let (wz, dz) = (w.dot(self.along), dir.dot(self.along));
        let (wp, dp) = (w - self.along * wz, dir - self.along * dz);
        let radius = self.radius + self.growth * wz;
        let (qa, qb, qc) = (
            dp.length_squared() - self.growth * self.growth * dz * dz,
            wp.dot(dp) - self.growth * dz * radius,
            wp.length_squared() - radius * radius,
        );
        let t = if qa > 1e-6 { ((qb * qb - qa * qc).max(0.0).sqrt() - qb) / qa } else { 0.0 };
        let radial = math::normalize_or(wp + dp * t, dir) - self.along * self.growth;
        (t, (wz + t * dz) / self.length, radial * self.lean)
    }
}

/// The parent's surface as its mesh has it.
struct Tube<'a> {
    rings: &'a [Ring],
    /// Centre and radius of the parent's own foot, below its first ring; or of that ring.
    base: (Vec3, f32),
    /// The first segment, named by its upper ring: 0 with a foot, else 1.
    lowest: usize,
    /// Inner over outer radius of the polygon.
    inner: f32,
}

impl<'a> Tube<'a> {
    fn new(plan: &Plan, rings: &'a [Ring], inner: f32) -> Self {
        match plan.base {
            Base::Side(foot) => Self { rings, base: (foot.o, foot.r), lowest: 0, inner },
            _ => Self { rings, base: (Vec3::ZERO, 1.0), lowest: 1, inner },
        }
    }

    /// The segment below ring `k`, which is at least `lowest`.
    fn cone(&self, k: usize) -> Option<Cone> {
        let b = self.rings.get(k)?;
        let a = k.checked_sub(1).and_then(|k| self.rings.get(k)).map_or(self.base, |a| (a.c, a.r));
        Some(Cone::new(a, (b.c, b.r), self.inner))
    }

    /// Where the line `x + t dir` leaves the tube near the segment `near` below ring `k`: t and the unit normal there. A
    /// line that misses is answered with its nearest point.
    fn exit(&self, (mut k, near): (usize, &Cone), x: Vec3, dir: Vec3) -> (f32, Vec3) {
        let last = self.rings.len().saturating_sub(1);
        let (mut t, mut z, mut normal) = near.exit(x, dir);
        for _ in 0..5 {
            match z {
                z if z < -1e-4 && k > self.lowest => k -= 1,
                z if z > 1.0001 && k < last => k += 1,
                _ => break,
            }
            let Some(cone) = self.cone(k) else { break };
            (t, z, normal) = cone.exit(x, dir);
        }
        (t, normal)
    }
}

/// One corner of the branch between the parent's bark and the first regular ring.
#[derive(Debug, Clone, Copy, Default)]
struct Corner {
    /// Unit vector from the line of the foot.
    dir: Vec3,
    /// Where the corner starts, without the flare, and the way from there to the first regular ring, m.
    low: Vec3,
    way: Vec3,
    /// Where it starts along the line of the foot and what is left of that line, m.
    t: f32,
    length: f32,
    /// Unit normal of the parent at the start.
    normal: Vec3,
}

/// What all corners share.
struct Shape<'a> {
    job: &'a Job<'a>,
    foot: &'a Foot,
    first: &'a Ring,
    /// Binding to the parent.
    glued: Binding,
    /// Width of the flare, as a share of the radius.
    grow: f32,
    /// v at the first regular ring and change of v per metre below it.
    v_end: f32,
    dv: f32,
}

/// Writes the hidden cap, the foot and the rows above it; returns the uppermost row.
/// Each corner of the branch starts where its own line meets the parent, so the foot follows the parent's surface
/// however obliquely the branch leaves; the flare fades with the third power of the way to the first regular ring. On the
/// foot, normals lie between those of both surfaces, which hides the crease. The cap is a fan from the foot to a point
/// under its middle: seen along the branch its corners stand around that point, so none of its triangles can turn, and
/// it stays inside the parent however that bends.
pub(super) fn write(job: &Job<'_>, foot: &Foot, out: &mut Out<'_>) -> u32 {
    let Some(first) = job.rings.first() else { return 0 };
    let axis = &job.shared.plant.axes[job.axis as usize];
    let rings = job.shared.plans.rings(axis.parent as usize);
    let inner = inner_radius(job.shared.links[axis.parent as usize].sides);
    let tube = Tube::new(job.shared.plans.of(axis.parent as usize), rings, inner);
    let last = rings.len().saturating_sub(1);
    let k = rings.partition_point(|r| r.s <= axis.parent_s).max(tube.lowest).min(last);
    let Some(near) = tube.cone(k) else { return 0 };
    let thick = rings.get(k.saturating_sub(1)).map_or(0.0, |r| r.r);

    let v = v_scale(job.shared.options, &job.link);
    let shape = Shape {
        job,
        foot,
        first,
        glued: Binding { axis: axis.parent, s: axis.parent_s },
        grow: job.shared.options.collar.min(0.97 * inner * thick / foot.r - 1.0),
        v_end: job.link.uv[1] + v * v_of(job.shared.options, first.v, first.s),
        dv: v_of(job.shared.options, 1.0 / (std::f32::consts::TAU * first.r), 1.0) * v,
    };
    let mut corners = [Corner::default(); CORNERS];
    let corners = &mut corners[..job.circle.len()];
    shape.corners(&tube, (k, &near), corners);
    shape.cap(0.3 * thick.min(foot.depth), corners, out);
    let mut below = None;
    for &x in foot_rows(job.link.sides) {
        let row = shape.row(x, corners, out);
        if let Some(below) = below {
            out.band(below, row, job.link.sides);
        }
        below = Some(row);
    }
    below.unwrap_or(0)
}

impl Shape<'_> {
    fn corners(&self, tube: &Tube<'_>, near: (usize, &Cone), corners: &mut [Corner]) {
        let (foot, first) = (self.foot, self.first);
        let e_end = rolled(first.t, first.e, self.job.link.roll);
        let e = math::transport(first.c, first.t, e_end, foot.o, foot.t);
        let (b, b_end) = (foot.t.cross(e), first.t.cross(e_end));
        let wide = foot.r * (1.0 + self.grow);
        let reach = first.s - foot.s;
        for (corner, &[cos, sin, _]) in corners.iter_mut().zip(self.job.circle) {
            let dir = e * cos + b * sin;
            let (t, normal) = tube.exit(near, foot.o + dir * wide, foot.t);
            let high = first.c + (e_end * cos + b_end * sin) * first.r;
            let t = t.clamp(-foot.depth, 0.75 * (high - foot.o).dot(foot.t).max(0.0));
            let low = foot.o + foot.t * t + dir * foot.r;
            *corner = Corner { dir, low, way: high - low, t, length: reach - t, normal };
        }
    }

    /// The hidden cap below the foot. `deep`: how far its middle lies below the mean of the corners, m.
    fn cap(&self, deep: f32, corners: &[Corner], out: &mut Out<'_>) {
        let (uv, down) = (self.job.link.uv, -self.foot.t);
        let repeats = self.job.link.repeats;
        let first = out.base + out.at;
        for (c, &[_, _, share]) in corners.iter().zip(self.job.circle) {
            let p = c.low + c.dir * (self.foot.r * self.grow);
            let uv = Vec2::new(uv[0] + repeats * share, self.v_end - self.dv * c.length);
            out.point(p, down, uv, self.glued);
        }
        let sides = corners.len() - 1;
        let t = corners[1..].iter().map(|c| c.t).sum::<f32>() / sides as f32 - deep;
        let v = self.v_end - self.dv * (self.first.s - self.foot.s - t);
        let middle = self.foot.o + self.foot.t * t;
        let middle = out.point(middle, down, Vec2::new(uv[0] + 0.5 * repeats, v), self.glued);
        out.fan(first, middle, self.job.link.sides, true);
    }

    /// The row a share `x` of the way to the first regular ring; returns its first point.
    fn row(&self, x: f32, corners: &[Corner], out: &mut Out<'_>) -> u32 {
        let (foot, uv) = (self.foot, self.job.link.uv);
        let fade = (1.0 - x) * (1.0 - x);
        let flare = foot.r * self.grow * fade;
        let narrows = self.first.r - foot.r - 3.0 * flare;
        let row = out.base + out.at;
        for (c, &[_, _, share]) in corners.iter().zip(self.job.circle) {
            let p = c.low + c.way * x + c.dir * (flare * (1.0 - x));
            let slope = narrows / c.length.max(1e-6);
            let wall = (c.dir - foot.t * slope) / (1.0 + slope * slope).sqrt();
            let uv = Vec2::new(uv[0] + self.job.link.repeats * share, self.v_end - self.dv * c.length * (1.0 - x));
            if x > 0.0 {
                let s = (foot.s + c.t + c.length * x).max(0.0);
                out.point(p, wall, uv, Binding { axis: self.job.axis, s });
            } else {
                out.point(p, between(wall, c.normal), uv, self.glued);
            }
        }
        row
    }
}

fn inner_radius(sides: u32) -> f32 {
    0.998 * math::cos_f32(std::f32::consts::PI / sides as f32)
}

/// Mostly the parent's normal where the surfaces meet at a blunt angle, half of each where they meet in a crotch.
fn between(wall: Vec3, parent: Vec3) -> Vec3 {
    let share = 0.5 + 0.2 * math::smoothstep(0.0, 0.6, wall.dot(parent));
    let mixed = wall * (1.0 - share) + parent * share;
    if mixed.length_squared() > 0.05 { mixed.normalize() } else { wall }
}
