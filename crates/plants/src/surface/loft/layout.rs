//! Second pass: numbers of sides, texture offsets and index ranges; also the parameters that a continuing branch
//! inherits from its parent.

use glam::Vec3;

use super::rings::Ring;
use super::thin::is_thin;
use super::tube_plan::{TubeCap, TubePlans, TubeStart};
use super::{SkinOptions, TubeRange};
use osier_base::convert::narrow;
use osier_base::limits::grouped;
use osier_base::rng::Rng;
use osier_base::{Error, Result, math};
use osier_scene::plant::{Axis, AxisKind, Plant};

/// Parameters by which the rings of one tube become points.
#[derive(Debug, Clone, Copy)]
pub(super) struct TubeParams {
    /// Sides of its polygons, 3..=32.
    pub sides: u32,
    /// Whole repeats of the bark around the tube.
    pub repeats: f32,
    /// Size of one repeat of the bark maps, width and height, m.
    pub tile: [f32; 2],
    /// Texture coordinates at the seam of the first ring.
    pub uv: [f32; 2],
    /// Cosine and sine of the roll of all references of the axis about their tangents.
    pub roll: [f32; 2],
    /// How the tube ends; flat where a continuation follows.
    pub cap: TubeCap,
}

/// Parameters and index ranges of all tubes.
#[derive(Debug, Default)]
pub(super) struct SkinLayout {
    /// Parameters of the tube of each axis, in the plant's order.
    pub params: Vec<TubeParams>,
    /// Ranges of all tubes in the order of the mesh: by material, then by axis.
    pub tubes: Vec<TubeRange>,
    /// Consecutive tubes of one material.
    pub subsets: Vec<MaterialRun>,
    /// Number of points of all tubes, without those of blades.
    pub points: u32,
    /// Number of triangles of all tubes, without those of blades.
    pub triangles: u32,
}

/// A run of triangles of one material, after those of the run before.
#[derive(Debug, Clone, Copy)]
pub(super) struct MaterialRun {
    /// Index into the plant's materials.
    pub material: u16,
    /// Number of triangles of its tubes together.
    pub triangles: u32,
}

/// Rings of a junction, as shares (0..1) of the way from the parent's surface to the first regular ring.
pub(super) fn junction_rings(sides: u32) -> &'static [f32] {
    if sides < 8 { &[0.0, 0.4] } else { &[0.0, 0.18, 0.5] }
}

/// Sets the parameters and index ranges of all tubes.
/// # Errors
/// `Limit` for more points than the options allow.
pub(super) fn lay_out(plant: &Plant, options: &SkinOptions, plans: &TubePlans) -> Result<SkinLayout> {
    // Parents come before their children, so a continuation finds its parent's parameters ready.
    let mut params: Vec<TubeParams> = Vec::with_capacity(plant.axes.len());
    for i in 0..plant.axes.len() {
        let tube = tube_params(plant, options, plans, &params, i);
        params.push(tube);
    }
    // An axis that another continues ends flat, inside the continuation.
    for (i, axis) in plant.axes.iter().enumerate() {
        if let (TubeStart::Continuation, Some(parent)) = (plans.plan(i).start, params.get_mut(axis.parent as usize)) {
            parent.cap = TubeCap::Disc;
        }
    }
    // Blades are strips and thin axes are cones, which are appended to the tubes.
    let is_tube = |axis: &Axis| axis.kind != AxisKind::Blade && !is_thin(plant, options, axis);
    let tubes = (0_u32..).zip(&plant.axes).filter(|(_, axis)| is_tube(axis));
    let mut order: Vec<(u16, u32)> = tubes.map(|(i, _)| (material(plant, options, plans, i), i)).collect();
    order.sort_unstable();
    assign_ranges(options, plans, params, &order)
}

/// Index of the material of an axis: that of shoots if its base is thinner than [`SkinOptions::shoot`] says.
fn material(plant: &Plant, options: &SkinOptions, plans: &TubePlans, axis: u32) -> u16 {
    match options.shoot {
        Some((r, shoot)) if plans.plan(axis as usize).r_base < r => shoot,
        _ => plant.axes[axis as usize].material,
    }
}

/// Parameters of one tube. `earlier`: those of all axes before it.
/// A continuation shares its first ring with the last one of its parent, point by point and with the same texture, unless it
/// is so much thinner that it has fewer than half the sides.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to 3..=32 sides before the cast")]
fn tube_params(
    plant: &Plant,
    options: &SkinOptions,
    plans: &TubePlans,
    earlier: &[TubeParams],
    i: usize,
) -> TubeParams {
    let (axis, plan) = (&plant.axes[i], plans.plan(i));
    // Sides of length `edge` around the base, and the whole number of bark repeats nearest to the girth.
    let girth = std::f32::consts::TAU * plan.r_base;
    let sides = (girth / options.edge).ceil().clamp(options.sides.0 as f32, options.sides.1 as f32) as u32;
    let tile = options.tile_of(plan.r_base);
    let repeats = (girth / tile[0]).round().max(1.0);
    let parent = match plan.start {
        TubeStart::Continuation => earlier.get(axis.parent as usize),
        _ => None,
    };
    let Some(parent) = parent else {
        // The seam and the start of the bark are random, so that equal branches do not show equal bark.
        let mut draw = Rng::at(plant.seed, &[plant.id.into(), axis.id.into(), "bark".into()]);
        let uv = [draw.unit_f32(), draw.unit_f32()];
        return TubeParams { sides, repeats, tile, uv, roll: [1.0, 0.0], cap: plan.cap };
    };
    let (Some(last), Some(first)) = (plans.rings(axis.parent as usize).last(), plans.rings(i).first()) else {
        return TubeParams { sides, repeats, tile, uv: parent.uv, roll: [1.0, 0.0], cap: plan.cap };
    };
    // Roll the axis' references so that the first one coincides with the parent's last one: its cosine and sine are the
    // coordinates of that vector in the first ring's plane.
    let e = rolled(last.t, last.e, parent.roll);
    let (x, y) = (first.e.dot(e), first.t.cross(first.e).dot(e));
    let length = (x * x + y * y).sqrt();
    let roll = if length > 1e-6 { [x / length, y / length] } else { [1.0, 0.0] };
    // Texture v continues from the parent's last ring; its whole part is dropped, since maps repeat.
    let v = parent.uv[1] + v_scale(options, parent) * v_coordinate(options, last);
    let sides = if sides * 2 >= parent.sides { parent.sides } else { sides };
    let repeats = if repeats * 2.0 >= parent.repeats { parent.repeats } else { repeats };
    TubeParams { sides, repeats, tile, uv: [parent.uv[0], v - v.floor()], roll, cap: plan.cap }
}

/// The reference turned about `t` by the angle whose cosine and sine are given.
pub(super) fn rolled(t: Vec3, e: Vec3, roll: [f32; 2]) -> Vec3 {
    e * roll[0] + t.cross(e) * roll[1]
}

/// Factor from [`v_coordinate`] to v.
pub(super) fn v_scale(options: &SkinOptions, tube: &TubeParams) -> f32 {
    match options.uv {
        super::UvMode::Conformal => tube.repeats * tube.tile[0] / tube.tile[1],
        super::UvMode::Metric => 1.0 / tube.tile[1],
    }
}

/// The coordinate of a ring along the axis that v is proportional to: the integral over the girth, or the arc length.
pub(super) fn v_coordinate(options: &SkinOptions, ring: &Ring) -> f32 {
    match options.uv {
        super::UvMode::Conformal => ring.v,
        super::UvMode::Metric => ring.s,
    }
}

/// Numbers of points and triangles of a tube; must agree with what the third pass writes.
fn counts(plans: &TubePlans, axis: usize, tube: &TubeParams) -> (u64, u64) {
    let (plan, sides) = (plans.plan(axis), tube.sides);
    // A ring repeats its first point at the texture seam.
    let (n, row) = (u64::from(sides), u64::from(sides) + 1);
    let junction = if matches!(plan.start, TubeStart::Side(_)) { junction_rings(sides).len() as u64 } else { 0 };
    let rows = plan.rings.len() as u64 + junction;
    // The end cap; the flat or hidden cap at the start always has a ring and a middle.
    let (cap_points, cap_triangles) = match tube.cap {
        TubeCap::Point => (1, n),
        TubeCap::Dome => (2 * row + 1, 5 * n),
        TubeCap::Disc => (row + 1, n),
    };
    (rows * row + row + 1 + cap_points, 2 * n * (rows - 1) + n + cap_triangles)
}

/// Numbers the points and triangles of all tubes in the order given.
/// # Errors
/// `Limit` for more points than the options allow or 32-bit indices can number.
fn assign_ranges(
    options: &SkinOptions,
    plans: &TubePlans,
    params: Vec<TubeParams>,
    order: &[(u16, u32)],
) -> Result<SkinLayout> {
    // Check the total before anything is allocated, then hand out consecutive ranges.
    let size = |axis: u32| counts(plans, axis as usize, &params[axis as usize]);
    let wanted: u64 = order.iter().map(|&(_, axis)| size(axis).0).sum();
    let indexed = u64::from(u32::MAX / 4);
    if wanted > options.max_points.min(indexed) {
        // No flag raises the number of points that 32-bit indices can address.
        let flag = if options.max_points < indexed { "--max-vertices" } else { "" };
        return Err(Error::Limit {
            name: "points of the skin".into(),
            wanted: grouped(wanted),
            limit: grouped(options.max_points.min(indexed)),
            flag: flag.into(),
            help: "use a larger edge or turn_deg of the skin, or a smaller plant".into(),
        });
    }
    let mut layout = SkinLayout::default();
    for &(material, axis) in order {
        let (points, triangles) = size(axis);
        let (points, triangles) = (narrow(points, "points of a skin")?, narrow(triangles, "triangles of a skin")?);
        let (first_point, first_triangle) = (layout.points, layout.triangles);
        layout.tubes.push(TubeRange { axis, points: (first_point, points), triangles: (first_triangle, triangles) });
        (layout.points, layout.triangles) = (first_point + points, first_triangle + triangles);
        match layout.subsets.last_mut() {
            Some(last) if last.material == material => last.triangles += triangles,
            _ => layout.subsets.push(MaterialRun { material, triangles }),
        }
    }
    layout.params = params;
    Ok(layout)
}

/// A corner of a regular polygon.
#[derive(Debug, Clone, Copy)]
pub(super) struct CirclePoint {
    pub cos: f32,
    pub sin: f32,
    /// Share of the full turn, 0..=1.
    pub turn: f32,
}

/// Corners of regular polygons by their number of sides; the last corner repeats the first, for the seam.
#[derive(Debug)]
pub(super) struct CircleTables(Vec<Vec<CirclePoint>>);

impl CircleTables {
    /// Tables for up to `max_sides` sides.
    pub fn new(max_sides: u32) -> Self {
        let corner = |j: u32, n: u32| {
            let a = f64::from(j % n) / f64::from(n) * std::f64::consts::TAU;
            CirclePoint { cos: math::narrow(math::cos(a)), sin: math::narrow(math::sin(a)), turn: j as f32 / n as f32 }
        };
        Self((0..=max_sides).map(|n| (0..=n).filter(|_| n > 0).map(|j| corner(j, n)).collect()).collect())
    }

    /// The table for `sides`, at most the number the tables were made for.
    pub fn polygon(&self, sides: u32) -> &[CirclePoint] {
        &self.0[sides as usize]
    }
}
