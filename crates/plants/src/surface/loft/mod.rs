//! Tubes around the axes of a plant: rings on rotation-minimising frames, joined where branches leave.
//!
//! Three passes: `plan` chooses the rings of every axis on its own, `link` settles counts, offsets and what a branch
//! inherits from the axis it continues, `emit` fills the arrays in place. The first and the last run in parallel over
//! fixed runs of axes, so the bytes do not depend on the number of threads.

mod corners;
mod emit;
mod foot;
mod link;
mod plan;
mod rings;
mod row;

use std::f32::consts::PI;

use osier_base::{Error, Result};
use osier_scene::Mesh;
use osier_scene::plant::Plant;

/// How texture coordinates run along an axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum UvMode {
    /// Keeps the proportions of the maps along the taper: thin branches show finer bark.
    Conformal,
    /// A fixed number of centimetres per repeat.
    Metric,
}

/// How finely and in what style a plant is skinned.
#[derive(Debug, Clone, PartialEq)]
pub struct SkinOptions {
    /// A ring stands wherever the axis turned by more than this since the last one, rad, 0.01..1.5.
    pub turn: f32,
    /// Length of a polygon side around the base of an axis, m, > 0.
    pub edge: f32,
    /// Fewest and most sides of a tube, 3..=32.
    pub sides: (u32, u32),
    /// Size of one repeat of the bark maps, width and height, m, > 0.
    pub tile: [f32; 2],
    /// Texture coordinates along the axis.
    pub uv: UvMode,
    /// How much wider a branch is where it leaves its parent, as a share of its radius, 0..1.
    pub collar: f32,
    /// How much wider a trunk is at the ground, as a share of its radius, 0..2.
    pub flare: f32,
    /// How far a trunk goes on below its first node, m, so that uneven ground hides its end.
    pub bury: f32,
    /// Axes thinner at their base than the radius (m) take this material (index into the plant's) instead of their own.
    pub shoot: Option<(f32, u16)>,
    /// Most points; more is an error.
    pub max_points: u64,
}

impl Default for SkinOptions {
    fn default() -> Self {
        Self {
            turn: 12.0 * PI / 180.0,
            edge: 0.04,
            sides: (5, 32),
            tile: [0.5, 0.5],
            uv: UvMode::Conformal,
            collar: 0.6,
            flare: 0.0,
            bury: 0.0,
            shoot: None,
            max_points: 50_000_000,
        }
    }
}

/// Where on the skeleton a point of the skin belongs.
#[derive(Debug, Clone, Copy, Default, PartialEq, bytemuck::Zeroable)]
#[repr(C)]
pub struct Binding {
    /// Index into [`Plant::axes`].
    pub axis: u32,
    /// Arc length on that axis, m, within it.
    pub s: f32,
}

/// The tube of one axis within the skin.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Tube {
    /// Index into [`Plant::axes`].
    pub axis: u32,
    /// First point and number of points.
    pub points: (u32, u32),
    /// First triangle and number of triangles.
    pub triangles: (u32, u32),
}

/// The skin of a plant.
#[derive(Debug, Clone, Default)]
pub struct Skin {
    /// Tubes of all axes; subsets by material, whose ids are indices into [`Plant::materials`].
    pub mesh: Mesh,
    /// One per point.
    pub binding: Vec<Binding>,
    /// One per axis, in the order of the mesh: by material, then as in the plant. Each is closed when points that share
    /// a place are welded.
    pub tubes: Vec<Tube>,
}

/// Skins a plant that [`osier_scene::plant::validate`] accepted. Each axis becomes one closed tube that starts inside its
/// parent; side branches stand on a widened foot that lies on the parent's surface, branches at the tip grow out of the
/// parent's last ring. Positions in m, plant space; normals are exact on cones.
/// # Errors
/// `Range` for an option outside its range, `Limit` for more than `max_points` points.
/// Own: rings, feet and continuations; frames after [`osier_base::math::transport`].
pub fn skin(plant: &Plant, options: &SkinOptions) -> Result<Skin> {
    let mut out = Skin::default();
    skin_into(plant, options, &mut out)?;
    Ok(out)
}

/// As [`skin`], into the memory of an earlier skin, which saves asking the system for fresh pages: for callers that skin
/// again and again. What `out` held does not matter.
/// # Errors
/// As [`skin`]; `out` is then as before.
/// Own.
pub fn skin_into(plant: &Plant, options: &SkinOptions, out: &mut Skin) -> Result<()> {
    check(options)?;
    let plans = plan::plan(plant, options);
    let layout = link::link(plant, options, &plans)?;
    emit::emit(plant, options, &plans, layout, out);
    Ok(())
}

fn check(o: &SkinOptions) -> Result<()> {
    let rows = [
        ("turn", o.turn, 0.01, 1.5, "rad"),
        ("edge", o.edge, 1e-5, 100.0, "m"),
        ("sides, fewest", o.sides.0 as f32, 3.0, o.sides.1 as f32, ""),
        ("sides, most", o.sides.1 as f32, o.sides.0 as f32, 32.0, ""),
        ("tile, width", o.tile[0], 1e-3, 100.0, "m"),
        ("tile, height", o.tile[1], 1e-3, 100.0, "m"),
        ("collar", o.collar, 0.0, 1.0, ""),
        ("flare", o.flare, 0.0, 2.0, ""),
        ("bury", o.bury, 0.0, 100.0, "m"),
    ];
    for (name, value, min, max, unit) in rows {
        if !(min..=max).contains(&value) {
            let name = format!("skin: {name}");
            return Err(Error::Range { name, value: value.into(), min: min.into(), max: max.into(), unit });
        }
    }
    Ok(())
}
