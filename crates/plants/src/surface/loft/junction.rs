//! The junction of a side branch: its collar, whose first ring lies on the parent's surface, and the rings from there to the
//! first regular ring.

use glam::{Vec2, Vec3};

use super::layout::{CirclePoint, junction_rings, rolled, v_coordinate, v_scale};
use super::rings::Ring;
use super::tube::TubeInputs;
use super::tube_plan::{Junction, TubePlan, TubeStart};
use super::writer::TubeWriter;
use super::{AxisBinding, UvMode};
use osier_base::math;

/// Most points of a ring: 32 sides and the seam.
const MAX_CORNERS: usize = 33;

/// One segment of a tube: the cone through two rings, with the radius of the circle inscribed in their polygons.
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
    /// 1 / sqrt(1 + growth^2), which makes the normal radial - growth * along a unit vector.
    normal_scale: f32,
}

impl Cone {
    /// The cone through two circles. `inscribed`: inradius divided by circumradius of the polygon.
    fn new(lower: Circle, upper: Circle, inscribed: f32) -> Self {
        // Inscribed radii: the mesh of the parent is a prism within its circles, and the branch must not float above
        // its facets.
        let span = upper.c - lower.c;
        let length = span.length().max(1e-9);
        let growth = (upper.r - lower.r) * inscribed / length;
        let normal_scale = 1.0 / (1.0 + growth * growth).sqrt();
        Self { a: lower.c, along: span / length, length, radius: lower.r * inscribed, growth, normal_scale }
    }

    /// Where the line `x + t dir` leaves the cone; for a line that misses, its nearest point.
    fn exit(&self, x: Vec3, dir: Vec3) -> ConeExit {
        // With w = x - a, split along the axis (z) and across it (p), the surface is |wp + t dp| = radius + growth (wz + t dz).
        // Squared, it is the quadratic qa t^2 + 2 qb t + qc = 0, whose larger root is the exit.
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
        ConeExit { t, ring_fraction: (wz + t * dz) / self.length, normal: radial * self.normal_scale }
    }
}

/// A circle of a tube: centre and radius, m.
#[derive(Debug, Clone, Copy)]
struct Circle {
    c: Vec3,
    r: f32,
}

/// Where a line leaves a cone.
#[derive(Debug, Clone, Copy)]
struct ConeExit {
    /// Parameter of the line.
    t: f32,
    /// Position between the rings: 0 at the lower one, 1 at the upper one.
    ring_fraction: f32,
    /// Unit normal of the cone.
    normal: Vec3,
}

/// The parent's surface as its mesh has it: cones between neighbouring rings.
struct ParentTube<'a> {
    rings: &'a [Ring],
    /// The circle of the parent's own junction, below its first ring; unused without one.
    base: Circle,
    /// Index of the upper ring of the first segment: 0 with a junction, otherwise 1.
    lowest: usize,
    /// Inradius divided by circumradius of the polygon.
    inscribed: f32,
}

impl<'a> ParentTube<'a> {
    fn new(plan: &TubePlan, rings: &'a [Ring], inscribed: f32) -> Self {
        match plan.start {
            TubeStart::Side(site) => Self { rings, base: Circle { c: site.o, r: site.r }, lowest: 0, inscribed },
            _ => Self { rings, base: Circle { c: Vec3::ZERO, r: 1.0 }, lowest: 1, inscribed },
        }
    }

    /// The segment below ring `k`, which is at least `lowest`.
    fn cone(&self, k: usize) -> Option<Cone> {
        let upper = self.rings.get(k)?;
        let lower = k.checked_sub(1).and_then(|k| self.rings.get(k));
        let lower = lower.map_or(self.base, |ring| Circle { c: ring.c, r: ring.r });
        Some(Cone::new(lower, Circle { c: upper.c, r: upper.r }, self.inscribed))
    }

    /// Where the line `x + t dir` leaves the tube. The search begins at the segment `cone` below ring `k` and walks along the
    /// tube for at most five segments.
    fn exit(&self, mut k: usize, cone: &Cone, x: Vec3, dir: Vec3) -> ConeExit {
        let last = self.rings.len().saturating_sub(1);
        // The quadratic of one segment is exact only between its rings: step to the neighbour on whose side the exit
        // lies.
        let mut exit = cone.exit(x, dir);
        for _ in 0..5 {
            match exit.ring_fraction {
                f if f < -1e-4 && k > self.lowest => k -= 1,
                f if f > 1.0001 && k < last => k += 1,
                _ => break,
            }
            let Some(cone) = self.cone(k) else { break };
            exit = cone.exit(x, dir);
        }
        exit
    }
}

/// One point of a ring of the branch, followed from the parent's surface to the first regular ring.
#[derive(Debug, Clone, Copy, Default)]
struct JunctionCorner {
    /// Unit vector away from the junction's line.
    dir: Vec3,
    /// Where the corner starts, without the collar, and the vector from there to the first regular ring, m.
    low: Vec3,
    way: Vec3,
    /// Where it starts along the junction's line, and the length from there to the first regular ring, m.
    t: f32,
    length: f32,
    /// Unit normal of the parent at the start.
    normal: Vec3,
}

/// Geometry and texture coordinates that all corners of a junction have in common.
struct JunctionShape<'a> {
    tube: &'a TubeInputs<'a>,
    site: &'a Junction,
    /// The first regular ring of the branch.
    first: &'a Ring,
    /// Binding of the points on the parent's surface: to the parent.
    parent: AxisBinding,
    /// Widening by the collar, as a share of the radius.
    collar: f32,
    /// v at the first regular ring and change of v per metre below it.
    v_end: f32,
    v_per_metre: f32,
}

/// Writes the hidden cap, the collar and the rings above it; returns the first point of the uppermost ring.
/// Each corner of the branch starts where its own line meets the parent, so the collar follows the parent's surface
/// however obliquely the branch leaves; its widening falls with the third power of the remaining distance to the first
/// regular ring. On the parent's surface the normals lie between those of both surfaces, which hides the crease. The cap is
/// a fan from the collar to a point below its middle: seen along the branch its corners surround that point, so none of
/// its triangles can turn over, and it stays inside the parent however that bends.
pub(super) fn write_junction(tube: &TubeInputs<'_>, site: &Junction, out: &mut TubeWriter<'_>) -> u32 {
    let (context, Some(first)) = (&tube.context, tube.rings.first()) else { return 0 };
    // The parent's surface, and its segment at the attachment.
    let axis = &context.plant.axes[tube.axis as usize];
    let rings = context.plans.rings(axis.parent as usize);
    let inscribed = inscribed_radius(context.params[axis.parent as usize].sides);
    let parent = ParentTube::new(context.plans.plan(axis.parent as usize), rings, inscribed);
    let last = rings.len().saturating_sub(1);
    let k = rings.partition_point(|r| r.s <= axis.parent_s).max(parent.lowest).min(last);
    let Some(cone) = parent.cone(k) else { return 0 };
    let thick = rings.get(k.saturating_sub(1)).map_or(0.0, |r| r.r);

    let v_scale = v_scale(context.options, &tube.params);
    let v_rate = match context.options.uv {
        UvMode::Conformal => 1.0 / (std::f32::consts::TAU * first.r),
        UvMode::Metric => 1.0,
    };
    let shape = JunctionShape {
        tube,
        site,
        first,
        parent: AxisBinding { axis: axis.parent, s: axis.parent_s },
        // The collar is never wider than the parent.
        collar: context.options.collar.min(0.97 * inscribed * thick / site.r - 1.0),
        v_end: tube.params.uv[1] + v_scale * v_coordinate(context.options, first),
        v_per_metre: v_rate * v_scale,
    };
    // Follow every corner from the parent to the first regular ring, then write the cap and the rings between.
    let mut corners = [JunctionCorner::default(); MAX_CORNERS];
    let corners = &mut corners[..tube.circle.len()];
    shape.place_corners(&parent, k, &cone, corners);
    shape.write_cap(0.3 * thick.min(site.depth), corners, out);
    let mut below = None;
    for &x in junction_rings(tube.params.sides) {
        let ring = shape.write_ring(x, corners, out);
        if let Some(below) = below {
            out.quad_strip(below, ring, tube.params.sides);
        }
        below = Some(ring);
    }
    below.unwrap_or(0)
}

impl JunctionShape<'_> {
    /// Sets where every corner starts on the parent and ends on the first regular ring. `cone`: the parent's segment below its
    /// ring `k`.
    fn place_corners(&self, parent: &ParentTube<'_>, k: usize, cone: &Cone, corners: &mut [JunctionCorner]) {
        let (site, first) = (self.site, self.first);
        // The reference of the first regular ring, transported back to the parent's surface, so that corners do not twist.
        let e_end = rolled(first.t, first.e, self.tube.params.roll);
        let e = math::transport(first.c, first.t, e_end, site.o, site.t);
        let (b, b_end) = (site.t.cross(e), first.t.cross(e_end));
        let wide = site.r * (1.0 + self.collar);
        let reach = first.s - site.s;
        for (corner, &CirclePoint { cos, sin, .. }) in corners.iter_mut().zip(self.tube.circle) {
            let dir = e * cos + b * sin;
            let exit = parent.exit(k, cone, site.o + dir * wide, site.t);
            let high = first.c + (e_end * cos + b_end * sin) * first.r;
            // A corner may start neither behind the parent's axis nor close to the first regular ring.
            let t = exit.t.clamp(-site.depth, 0.75 * (high - site.o).dot(site.t).max(0.0));
            let low = site.o + site.t * t + dir * site.r;
            *corner = JunctionCorner { dir, low, way: high - low, t, length: reach - t, normal: exit.normal };
        }
    }

    /// Writes the hidden cap below the collar. `deep`: how far its middle lies below the mean of the corners, m.
    fn write_cap(&self, deep: f32, corners: &[JunctionCorner], out: &mut TubeWriter<'_>) {
        let (uv, down) = (self.tube.params.uv, -self.site.t);
        let repeats = self.tube.params.repeats;
        let first = out.first_point + out.points_written;
        for (c, &CirclePoint { turn, .. }) in corners.iter().zip(self.tube.circle) {
            let p = c.low + c.dir * (self.site.r * self.collar);
            let uv = Vec2::new(uv[0] + repeats * turn, self.v_end - self.v_per_metre * c.length);
            out.point(p, down, uv, self.parent);
        }
        // The middle of the fan lies below the mean of the corners, inside the parent.
        let sides = corners.len() - 1;
        let t = corners[1..].iter().map(|c| c.t).sum::<f32>() / sides as f32 - deep;
        let v = self.v_end - self.v_per_metre * (self.first.s - self.site.s - t);
        let middle = self.site.o + self.site.t * t;
        let middle = out.point(middle, down, Vec2::new(uv[0] + 0.5 * repeats, v), self.parent);
        out.triangle_fan(first, middle, self.tube.params.sides, true);
    }

    /// Writes the ring a share `x` (0..1) of the way to the first regular ring; returns its first point.
    fn write_ring(&self, x: f32, corners: &[JunctionCorner], out: &mut TubeWriter<'_>) -> u32 {
        let (site, uv) = (self.site, self.tube.params.uv);
        // The radius along the way is r + x (r_first - r) + r collar (1 - x)^3; `narrows` is its derivative by x.
        let fade = (1.0 - x) * (1.0 - x);
        let flare = site.r * self.collar * fade;
        let narrows = self.first.r - site.r - 3.0 * flare;
        let ring = out.first_point + out.points_written;
        for (c, &CirclePoint { turn, .. }) in corners.iter().zip(self.tube.circle) {
            let p = c.low + c.way * x + c.dir * (flare * (1.0 - x));
            let slope = narrows / c.length.max(1e-6);
            let wall = (c.dir - site.t * slope) / (1.0 + slope * slope).sqrt();
            let v = self.v_end - self.v_per_metre * c.length * (1.0 - x);
            let uv = Vec2::new(uv[0] + self.tube.params.repeats * turn, v);
            if x > 0.0 {
                let s = (site.s + c.t + c.length * x).max(0.0);
                out.point(p, wall, uv, AxisBinding { axis: self.tube.axis, s });
            } else {
                out.point(p, blend_normals(wall, c.normal), uv, self.parent);
            }
        }
        ring
    }
}

/// Inradius divided by circumradius of a regular polygon, reduced by 0.2 %, so that the junction does not float above
/// the parent's facets.
fn inscribed_radius(sides: u32) -> f32 {
    0.998 * math::cos_f32(std::f32::consts::PI / sides as f32)
}

/// The normal on the crease between a branch's wall and its parent: 70 % of the parent's where the surfaces meet at a blunt
/// angle, half of each where they meet in a crotch.
fn blend_normals(wall: Vec3, parent: Vec3) -> Vec3 {
    let share = 0.5 + 0.2 * math::smoothstep(0.0, 0.6, wall.dot(parent));
    let mixed = wall * (1.0 - share) + parent * share;
    if mixed.length_squared() > 0.05 { mixed.normalize() } else { wall }
}
