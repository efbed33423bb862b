//! The foot of a side branch: rows that lie on the parent's surface and ease into the branch.

use glam::{Vec2, Vec3};

use super::Binding;
use super::emit::Job;
use super::link::{foot_rows, rolled, v_of, v_scale};
use super::plan::{Base, Foot, Plan};
use super::rings::Ring;
use super::row::Out;
use crate::math;

/// Most corners of a row: 32 sides and the seam.
const CORNERS: usize = 33;

/// The parent's surface as its mesh has it: frusta between rings, thinned to the middle of the polygon's sides.
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

    /// Where the line `x + t dir` leaves the tube near the segment below ring `k`: t and the unit normal there. A line that misses is
    /// answered with its nearest point.
    fn exit(&self, mut k: usize, x: Vec3, dir: Vec3) -> (f32, Vec3) {
        let last = self.rings.len().saturating_sub(1);
        let mut found = (0.0, Vec3::Y);
        k = k.min(last);
        for _ in 0..6 {
            let Some(b) = self.rings.get(k) else { break };
            let a = k.checked_sub(1).and_then(|k| self.rings.get(k)).map_or(self.base, |a| (a.c, a.r));
            let (t, z, normal) = self.cone(a, (b.c, b.r), (x, dir));
            found = (t, normal);
            match z {
                z if z < -1e-4 && k > self.lowest => k -= 1,
                z if z > 1.0001 && k < last => k += 1,
                _ => break,
            }
        }
        found
    }

    /// Exit from the cone through two rings: t, place between the rings (0..1 inside) and unit normal.
    fn cone(&self, a: (Vec3, f32), b: (Vec3, f32), (x, dir): (Vec3, Vec3)) -> (f32, f32, Vec3) {
        let span = b.0 - a.0;
        let length = span.length().max(1e-9);
        let along = span / length;
        let growth = (b.1 - a.1) * self.inner / length;
        let w = x - a.0;
        let (wz, dz) = (w.dot(along), dir.dot(along));
        let (wp, dp) = (w - along * wz, dir - along * dz);
        let radius = a.1 * self.inner + growth * wz;
        let (qa, qb, qc) = (
            dp.length_squared() - growth * growth * dz * dz,
            wp.dot(dp) - growth * dz * radius,
            wp.length_squared() - radius * radius,
        );
        let t = if qa > 1e-6 { ((qb * qb - qa * qc).max(0.0).sqrt() - qb) / qa } else { 0.0 };
        let normal = math::normalize_or(wp + dp * t, along) - along * growth;
        (t, (wz + t * dz) / length, math::normalize_or(normal, along))
    }
}

/// Writes the hidden cap, the foot and the rows above it; returns the uppermost row.
/// Each corner of the branch starts where its own line meets the parent, so the foot follows the parent's surface
/// however obliquely the branch leaves; the flare fades with the third power of the way to the first regular ring. On the
/// foot, normals lie between those of both surfaces, which hides the crease. The cap is a fan from the foot to a point
/// under its middle: seen along the branch its corners stand around that point, so none of its triangles can turn, and
/// it stays inside the parent however that bends.
pub(super) fn write(job: &Job<'_>, foot: &Foot, out: &mut Out<'_>) -> u32 {
    let Some(first) = job.rings.first() else { return 0 };
    let parent = job.shared.plant.axes[job.axis as usize].parent;
    let rings = job.shared.plans.rings(parent as usize);
    let parent_s = job.shared.plant.axes[job.axis as usize].parent_s;
    let sides = job.shared.links[parent as usize].sides;
    let inner = inner_radius(sides);
    let tube = Tube::new(job.shared.plans.of(parent as usize), rings, inner);
    let k = rings.partition_point(|r| r.s <= parent_s).max(tube.lowest);
    let glued = Binding { axis: parent, s: parent_s };

    let e_end = rolled(first.t, first.e, job.link.roll);
    let e = math::transport(first.c, first.t, e_end, foot.o, foot.t);
    let b = foot.t.cross(e);
    let v = v_scale(job.shared.options, &job.link);
    let dv = v_of(job.shared.options, 1.0 / (std::f32::consts::TAU * first.r), 1.0) * v;
    let v_end = job.link.uv[1] + v * v_of(job.shared.options, first.v, first.s);

    let widest = 0.97 * inner * local_radius(rings, k) / foot.r;
    let grow = job.shared.options.collar.min(widest - 1.0);
    let b_end = first.t.cross(e_end);
    let n = job.circle.len();
    let mut exits = [(0.0, Vec3::Y); CORNERS];
    for (exit, &[cos, sin, _]) in exits.iter_mut().zip(job.circle) {
        let dir = e * cos + b * sin;
        let (t, normal) = tube.exit(k, foot.o + dir * (foot.r * (1.0 + grow)), foot.t);
        let high = first.c + (e_end * cos + b_end * sin) * first.r;
        *exit = (t.clamp(-foot.depth, 0.75 * (high - foot.o).dot(foot.t).max(0.0)), normal);
    }
    let corners = &exits[..n];
    let mean = corners[1..].iter().map(|c| c.0).sum::<f32>() / (n - 1) as f32;

    let hidden = out.at;
    let down = -foot.t;
    let v_low = |t: f32| v_end - dv * (first.s - foot.s - t);
    for (&(t, _), &[cos, sin, share]) in corners.iter().zip(job.circle) {
        let dir = e * cos + b * sin;
        let p = foot.o + foot.t * t + dir * foot.r + dir * (foot.r * grow);
        out.point(p, down, Vec2::new(job.link.uv[0] + job.link.repeats * share, v_low(t)), glued);
    }
    let deep = mean - 0.3 * local_radius(rings, k).min(foot.depth);
    let uv = Vec2::new(job.link.uv[0] + 0.5 * job.link.repeats, v_low(deep));
    let middle = out.point(foot.o + foot.t * deep, down, uv, glued);
    out.fan(out.base + hidden, middle, job.link.sides, true);

    let mut below = None;
    for &x in foot_rows(job.link.sides) {
        let row = out.at;
        for (&(t, normal), &[cos, sin, share]) in corners.iter().zip(job.circle) {
            let dir = e * cos + b * sin;
            let length = first.s - foot.s - t;
            let fade = (1.0 - x) * (1.0 - x);
            let low = foot.o + foot.t * t + dir * foot.r;
            let high = first.c + (e_end * cos + b_end * sin) * first.r;
            let p = low + (high - low) * x + dir * (foot.r * grow * fade * (1.0 - x));
            let slope = (first.r - foot.r - 3.0 * foot.r * grow * fade) / length.max(1e-6);
            let wall = math::normalize_or(dir - foot.t * slope, dir);
            let n = if x > 0.0 { wall } else { between(wall, normal) };
            let uv = Vec2::new(job.link.uv[0] + job.link.repeats * share, v_end - dv * length * (1.0 - x));
            let s = (foot.s + t + length * x).max(0.0);
            out.point(p, n, uv, if x > 0.0 { Binding { axis: job.axis, s } } else { glued });
        }
        let row = out.base + row;
        if let Some(below) = below {
            out.band(below, row, job.link.sides);
        }
        below = Some(row);
    }
    below.unwrap_or(hidden)
}

fn inner_radius(sides: u32) -> f32 {
    0.998 * math::cos_f32(std::f32::consts::PI / sides as f32)
}

fn local_radius(rings: &[Ring], k: usize) -> f32 {
    rings.get(k.saturating_sub(1)).map_or(0.0, |r| r.r)
}

/// Mostly the parent's normal where the surfaces meet at a blunt angle, half of each where they meet in a crotch.
fn between(wall: Vec3, parent: Vec3) -> Vec3 {
    let share = 0.5 + 0.2 * math::smoothstep(0.0, 0.6, wall.dot(parent));
    let mixed = wall * (1.0 - share) + parent * share;
    if mixed.length_squared() > 0.05 { mixed.normalize() } else { wall }
}
