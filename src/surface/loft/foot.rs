//! The foot of a side branch: rows that lie on the parent's surface and ease into the branch.

use glam::{Vec2, Vec3};

use super::Binding;
use super::emit::Job;
use super::link::{foot_rows, rolled, v_of, v_scale};
use super::plan::Foot;
use super::rings::Ring;
use super::row::{Out, Row};
use crate::math;

/// The parent's surface as its mesh has it: frusta between rings, thinned to the middle of the polygon's sides.
struct Tube<'a> {
    rings: &'a [Ring],
    /// Inner over outer radius of the polygon.
    inner: f32,
}

impl Tube<'_> {
    /// Where the line `x + t dir` leaves the tube near segment `k`: t and the unit normal there. A line that misses is
    /// answered with its nearest point.
    fn exit(&self, mut k: usize, x: Vec3, dir: Vec3) -> (f32, Vec3) {
        let last = self.rings.len().saturating_sub(2);
        let mut found = (0.0, Vec3::Y);
        k = k.min(last);
        for _ in 0..6 {
            let Some((a, b)) = self.rings.get(k).zip(self.rings.get(k + 1)) else { break };
            let (t, z, normal) = self.cone(a, b, (x, dir));
            found = (t, normal);
            match z {
                z if z < -1e-4 && k > 0 => k -= 1,
                z if z > 1.0001 && k < last => k += 1,
                _ => break,
            }
        }
        found
    }

    /// Exit from the cone through two rings: t, place between the rings (0..1 inside) and unit normal.
    fn cone(&self, a: &Ring, b: &Ring, (x, dir): (Vec3, Vec3)) -> (f32, f32, Vec3) {
        let span = b.c - a.c;
        let length = span.length().max(1e-9);
        let along = span / length;
        let growth = (b.r - a.r) * self.inner / length;
        let w = x - a.c;
        let (wz, dz) = (w.dot(along), dir.dot(along));
        let (wp, dp) = (w - along * wz, dir - along * dz);
        let radius = a.r * self.inner + growth * wz;
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

/// Writes the hidden ring with its cap, the foot and the rows above it; returns the uppermost row.
/// Each corner of the branch starts where its own line meets the parent, so the foot follows the parent's surface
/// however obliquely the branch leaves; the flare fades with the third power of the way to the first regular ring. On the
/// foot, normals lie between those of both surfaces, which hides the crease.
pub(super) fn write(job: &Job<'_>, foot: &Foot, out: &mut Out<'_>) -> u32 {
    let Some(first) = job.rings.first() else { return 0 };
    let parent = job.shared.plant.axes[job.axis as usize].parent;
    let rings = job.shared.plans.rings(parent as usize);
    let parent_s = job.shared.plant.axes[job.axis as usize].parent_s;
    let sides = job.shared.links[parent as usize].sides;
    let inner = inner_radius(sides);
    let tube = Tube { rings, inner };
    let k = rings.partition_point(|r| r.s <= parent_s).saturating_sub(1);
    let glued = Binding { axis: parent, s: parent_s };

    let e_end = rolled(first.t, first.e, job.link.roll);
    let e = math::transport(first.c, first.t, e_end, foot.o, foot.t);
    let b = foot.t.cross(e);
    let v = v_scale(job.shared.options, &job.link);
    let dv = v_of(job.shared.options, 1.0 / (std::f32::consts::TAU * first.r), 1.0) * v;
    let v_end = job.link.uv[1] + v * v_of(job.shared.options, first.v, first.s);

    // Further back than the parent's axis, so that no corner of the foot lies behind it.
    let back = (0.5 * local_radius(rings, k)).min(foot.r);
    let hidden = Row {
        c: foot.o - foot.t * (foot.depth + back),
        e,
        b,
        r: foot.r.min(0.6 * local_radius(rings, k)),
        lean: foot.t * -std::f32::consts::FRAC_1_SQRT_2,
        out: std::f32::consts::FRAC_1_SQRT_2,
        uv: [job.link.uv[0], job.link.repeats, v_end - dv * first.s],
        bind: glued,
    };
    job.disc(&hidden, foot.t, true, out);
    let mut below = out.row(&hidden, job.circle);

    let widest = 0.97 * inner * local_radius(rings, k) / foot.r;
    let grow = job.shared.options.collar.min(widest - 1.0);
    let b_end = first.t.cross(e_end);
    for &x in foot_rows(job.link.sides) {
        let row = out.at;
        for &[cos, sin, share] in job.circle {
            let dir = e * cos + b * sin;
            let (t, normal) = tube.exit(k, foot.o + dir * (foot.r * (1.0 + grow)), foot.t);
            let t = t.clamp(-foot.depth, (first.s - foot.s) * 0.75);
            let length = first.s - foot.s - t;
            let fade = (1.0 - x) * (1.0 - x);
            let low = foot.o + foot.t * t + dir * foot.r;
            let high = first.c + (e_end * cos + b_end * sin) * first.r;
            let p = low.lerp(high, x) + dir * (foot.r * grow * fade * (1.0 - x));
            let slope = (first.r - foot.r - 3.0 * foot.r * grow * fade) / length.max(1e-6);
            let wall = math::normalize_or(dir - foot.t * slope, dir);
            let n = if x > 0.0 { wall } else { between(wall, normal) };
            let uv = Vec2::new(job.link.uv[0] + job.link.repeats * share, v_end - dv * length * (1.0 - x));
            let s = (foot.s + t + length * x).max(0.0);
            out.point(p, n, uv, if x > 0.0 { Binding { axis: job.axis, s } } else { glued });
        }
        let row = out.base + row;
        out.band(below, row, job.link.sides);
        below = row;
    }
    below
}

fn inner_radius(sides: u32) -> f32 {
    0.998 * math::cos_f32(std::f32::consts::PI / sides as f32)
}

fn local_radius(rings: &[Ring], k: usize) -> f32 {
    rings.get(k).map_or(0.0, |r| r.r)
}

/// Mostly the parent's normal where the surfaces meet at a blunt angle, half of each where they meet in a crotch.
fn between(wall: Vec3, parent: Vec3) -> Vec3 {
    let share = 0.5 + 0.2 * math::smoothstep(0.0, 0.6, wall.dot(parent));
    let mixed = wall * (1.0 - share) + parent * share;
    if mixed.length_squared() > 0.05 { mixed.normalize() } else { wall }
}
