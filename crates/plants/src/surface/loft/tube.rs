//! Input of the mesh of one tube, and the rings and discs that all tubes share.

use glam::{Vec2, Vec3};

use super::layout::{CirclePoint, CircleTables, TubeParams, rolled, v_coordinate};
use super::rings::Ring;
use super::tube_plan::{TubePlan, TubePlans};
use super::writer::{PointRing, TubeWriter};
use super::{AxisBinding, SkinOptions};
use osier_scene::plant::Plant;

/// Inputs of the third pass that all tubes share.
#[derive(Debug, Clone, Copy)]
pub(super) struct SkinContext<'a> {
    pub plant: &'a Plant,
    pub options: &'a SkinOptions,
    pub plans: &'a TubePlans,
    /// Parameters of the tube of each axis, in the plant's order.
    pub params: &'a [TubeParams],
    pub circles: &'a CircleTables,
}

/// Inputs of the mesh of one axis: its plan, rings and cross-section.
#[derive(Debug, Clone, Copy)]
pub(super) struct TubeInputs<'a> {
    pub context: SkinContext<'a>,
    /// Index into the plant's axes.
    pub axis: u32,
    pub plan: &'a TubePlan,
    pub params: TubeParams,
    pub rings: &'a [Ring],
    /// Corners of the regular polygon with `params.sides` sides; the last repeats the first.
    pub circle: &'a [CirclePoint],
}

impl<'a> TubeInputs<'a> {
    pub fn new(context: SkinContext<'a>, axis: u32) -> Self {
        let i = axis as usize;
        let params = context.params[i];
        Self {
            context,
            axis,
            plan: context.plans.plan(i),
            params,
            rings: context.plans.rings(i),
            circle: context.circles.polygon(params.sides),
        }
    }

    /// The points of a regular ring, with the exact normals of the cone through it. `v_scale`: v per unit of the ring's
    /// coordinate.
    #[inline]
    pub fn point_ring(&self, ring: &Ring, v_scale: f32) -> PointRing {
        let e = rolled(ring.t, ring.e, self.params.roll);
        // The normal of a cone of slope m is (radial - m tangent) / sqrt(1 + m^2).
        let radial = 1.0 / (1.0 + ring.slope * ring.slope).sqrt();
        // v of the ring: offset of the tube plus the scaled coordinate along it.
        let v = self.params.uv[1] + v_scale * v_coordinate(self.context.options, ring);
        PointRing {
            c: ring.c,
            e,
            b: ring.t.cross(e),
            r: ring.r,
            radial,
            axial: ring.t * (-ring.slope * radial),
            uv: [self.params.uv[0], self.params.repeats, v],
            binding: AxisBinding { axis: self.axis, s: ring.s.max(0.0) },
        }
    }

    /// Writes a flat cap on a ring. Its points are not those of the wall, since their normal is `t`, or -`t` for `down`. Returns
    /// the index of the first of them.
    pub fn write_disc(&self, ring: &PointRing, t: Vec3, down: bool, out: &mut TubeWriter<'_>) -> u32 {
        let normal = if down { -t } else { t };
        let flat = PointRing { axial: normal, radial: 0.0, ..*ring };
        let first = out.ring(&flat, self.circle);
        let uv = Vec2::new(ring.uv[0] + 0.5 * ring.uv[1], ring.uv[2]);
        let middle = out.point(ring.c, normal, uv, ring.binding);
        out.triangle_fan(first, middle, self.params.sides, down);
        first
    }
}
