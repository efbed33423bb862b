//! Second pass: sides, texture offsets and places in the arrays; what a continuing branch takes over from its parent.

use glam::Vec3;

use super::plan::{Base, Cap, Plans};
use super::{SkinOptions, Tube};
use osier_base::rng::Rng;
use osier_base::{Error, Result, math};
use osier_scene::plant::Plant;

/// What one tube needs to know beyond its rings.
#[derive(Debug, Clone, Copy)]
pub(super) struct Link {
    /// Number of sides.
    pub sides: u32,
    /// Whole repeats of the bark around the tube.
    pub repeats: f32,
    /// Texture coordinates at the seam of the first ring.
    pub uv: [f32; 2],
    /// Cosine and sine of the roll of all references of the axis about their tangents.
    pub roll: [f32; 2],
    /// How the tube ends: flat where a continuation takes over.
    pub cap: Cap,
}

/// Where every tube goes.
#[derive(Debug, Default)]
pub(super) struct Layout {
    /// By axis.
    pub links: Vec<Link>,
    /// In the order of the mesh.
    pub tubes: Vec<Tube>,
    /// Runs of tubes of one material: (material, number of triangles).
    pub subsets: Vec<(u16, u32)>,
    /// Points and triangles altogether.
    pub totals: (u32, u32),
}

/// Rows of points from the bark of the parent to below the first regular ring of a side branch: a share of the way.
pub(super) fn foot_rows(sides: u32) -> &'static [f32] {
    if sides < 8 { &[0.0, 0.4] } else { &[0.0, 0.18, 0.5] }
}

/// Settles counts and offsets.
/// # Errors
/// `Limit` for more points than the options allow.
pub(super) fn link(plant: &Plant, options: &SkinOptions, plans: &Plans) -> Result<Layout> {
    let mut links: Vec<Link> = Vec::with_capacity(plant.axes.len());
    for i in 0..plant.axes.len() {
        let link = link_axis(plant, options, plans, (i, &links));
        links.push(link);
    }
    for (i, axis) in plant.axes.iter().enumerate() {
        if let (Base::Tip, Some(parent)) = (plans.of(i).base, links.get_mut(axis.parent as usize)) {
            parent.cap = Cap::Disc;
        }
    }
    let mut order: Vec<(u16, u32)> =
        (0_u32..).zip(&plant.axes).map(|(i, _)| (material(plant, options, plans, i), i)).collect();
    order.sort_unstable();
    place(options, plans, links, &order)
}

fn material(plant: &Plant, options: &SkinOptions, plans: &Plans, axis: u32) -> u16 {
    match options.shoot {
        Some((r, shoot)) if plans.of(axis as usize).r_base < r => shoot,
        _ => plant.axes[axis as usize].material,
    }
}

#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to 3..=32 sides before the cast")]
fn link_axis(plant: &Plant, options: &SkinOptions, plans: &Plans, (i, before): (usize, &[Link])) -> Link {
    let axis = &plant.axes[i];
    let girth = std::f32::consts::TAU * plans.of(i).r_base;
    let sides = (girth / options.edge).ceil().clamp(options.sides.0 as f32, options.sides.1 as f32) as u32;
    let repeats = (girth / options.tile[0]).round().max(1.0);
    if let (Base::Tip, Some(parent)) = (plans.of(i).base, before.get(axis.parent as usize)) {
        return inherit(options, plans, (i, axis.parent as usize), (sides, repeats, parent));
    }
    let mut draw = Rng::at(plant.seed, &[plant.id.into(), axis.id.into(), "bark".into()]);
    let uv = [draw.unit_f32(), draw.unit_f32()];
    Link { sides, repeats, uv, roll: [1.0, 0.0], cap: plans.of(i).cap }
}

/// A continuation shares its first ring with the last one of its parent, corner by corner and with the same texture,
/// unless it is so much thinner that it has fewer than half the sides.
fn inherit(
    o: &SkinOptions,
    plans: &Plans,
    (i, p): (usize, usize),
    (sides, repeats, parent): (u32, f32, &Link),
) -> Link {
    let cap = plans.of(i).cap;
    let (Some(last), Some(first)) = (plans.rings(p).last(), plans.rings(i).first()) else {
        return Link { sides, repeats, uv: parent.uv, roll: [1.0, 0.0], cap };
    };
    let e = rolled(last.t, last.e, parent.roll);
    let (x, y) = (first.e.dot(e), first.t.cross(first.e).dot(e));
    let length = (x * x + y * y).sqrt();
    let roll = if length > 1e-6 { [x / length, y / length] } else { [1.0, 0.0] };
    let v = parent.uv[1] + v_scale(o, parent) * v_of(o, last.v, last.s);
    let sides = if sides * 2 >= parent.sides { parent.sides } else { sides };
    let repeats = if repeats * 2.0 >= parent.repeats { parent.repeats } else { repeats };
    Link { sides, repeats, uv: [parent.uv[0], v - v.floor()], roll, cap }
}

/// The reference turned about `t` by the angle whose cosine and sine are given.
pub(super) fn rolled(t: Vec3, e: Vec3, roll: [f32; 2]) -> Vec3 {
    e * roll[0] + t.cross(e) * roll[1]
}

/// Factor from [`v_of`] to v.
pub(super) fn v_scale(options: &SkinOptions, link: &Link) -> f32 {
    match options.uv {
        super::UvMode::Conformal => link.repeats * options.tile[0] / options.tile[1],
        super::UvMode::Metric => 1.0 / options.tile[1],
    }
}

/// The coordinate along the axis that v is proportional to: the integral over the girth, or the arc length.
pub(super) fn v_of(options: &SkinOptions, integral: f32, s: f32) -> f32 {
    match options.uv {
        super::UvMode::Conformal => integral,
        super::UvMode::Metric => s,
    }
}

/// Points and triangles of a tube.
fn counts(plans: &Plans, axis: usize, link: &Link) -> (u64, u64) {
    let (plan, sides) = (plans.of(axis), link.sides);
    let (n, row) = (u64::from(sides), u64::from(sides) + 1);
    let foot = if matches!(plan.base, Base::Side(_)) { foot_rows(sides).len() as u64 } else { 0 };
    let rows = plan.rings.len() as u64 + foot;
    let (cap_points, cap_triangles) = match link.cap {
        Cap::Point => (1, n),
        Cap::Dome => (2 * row + 1, 5 * n),
        Cap::Disc => (row + 1, n),
    };
    (rows * row + row + 1 + cap_points, 2 * n * (rows - 1) + n + cap_triangles)
}

fn place(options: &SkinOptions, plans: &Plans, links: Vec<Link>, order: &[(u16, u32)]) -> Result<Layout> {
    let size = |axis: u32| counts(plans, axis as usize, &links[axis as usize]);
    let wanted: u64 = order.iter().map(|&(_, axis)| size(axis).0).sum();
    if wanted > options.max_points.min(u64::from(u32::MAX / 4)) {
        let limit = options.max_points.to_string();
        let flag = "fewer sides (edge, turn) or a smaller plant".into();
        return Err(Error::Limit { name: "points of the skin".into(), wanted: wanted.to_string(), limit, flag });
    }
    let small = |n: u64| u32::try_from(n).unwrap_or(u32::MAX);
    let mut layout = Layout::default();
    for &(material, axis) in order {
        let (points, triangles) = size(axis);
        let (points, triangles) = (small(points), small(triangles));
        let (p, t) = layout.totals;
        layout.tubes.push(Tube { axis, points: (p, points), triangles: (t, triangles) });
        layout.totals = (p + points, t + triangles);
        match layout.subsets.last_mut() {
            Some(last) if last.0 == material => last.1 += triangles,
            _ => layout.subsets.push((material, triangles)),
        }
    }
    layout.links = links;
    Ok(layout)
}

/// Cosine, sine and share of the turn for every corner of a polygon; the last corner is the first again.
#[derive(Debug)]
pub(super) struct Circles(Vec<Vec<[f32; 3]>>);

impl Circles {
    /// Tables for up to `most` sides.
    pub fn new(most: u32) -> Self {
        let corner = |j: u32, n: u32| {
            let a = f64::from(j % n) / f64::from(n) * std::f64::consts::TAU;
            [math::narrow(math::cos(a)), math::narrow(math::sin(a)), j as f32 / n as f32]
        };
        Self((0..=most).map(|n| (0..=n).filter(|_| n > 0).map(|j| corner(j, n)).collect()).collect())
    }

    /// The table for `sides`.
    pub fn of(&self, sides: u32) -> &[[f32; 3]] {
        &self.0[sides as usize]
    }
}
