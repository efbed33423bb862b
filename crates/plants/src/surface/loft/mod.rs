//! Lofting: one closed tube of rings per axis of a plant, on rotation-minimizing frames, joined where branches leave.
//!
//! Three passes: `tube_plan` places the rings of every axis independently; `layout` sets the number of sides, the texture
//! offsets and index ranges, and what a branch inherits from the axis that it continues; `emit` fills the arrays in place.
//! The first and the last pass run in parallel over fixed ranges of axes, so the bytes do not depend on the number of threads.
//!
//! ```
//! use osier_plants::surface::{SkinOptions, skin};
//! use osier_scene::plant::Plant;
//!
//! # fn main() -> osier_base::Result<()> {
//! // A plant without axes has a skin without points; `turtle::grow` makes plants worth skinning.
//! let skin = skin(&Plant::default(), &SkinOptions::default())?;
//! assert_eq!(skin.mesh.points.len(), skin.bindings.len());
//! # Ok(())
//! # }
//! ```

mod by_material;
mod centerline;
mod corners;
mod emit;
mod flare;
mod junction;
mod layout;
mod ribbon;
mod rings;
mod thin;
mod tube;
mod tube_plan;
mod tuning;
mod writer;

use std::f32::consts::PI;

use osier_base::{Error, Result};
use osier_scene::Mesh;
use osier_scene::plant::Plant;

/// How texture coordinates run along an axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum UvMode {
    /// Keeps the proportions of the maps along the taper: thin branches show finer bark.
    Conformal,
    /// Every repeat has the same length, that of [`SkinOptions::tile`] or of [`SkinOptions::shoot_tile`].
    Metric,
}

/// Options of [`skin`]: density of rings and sides, texture coordinates, and the widening of branches at their bases.
#[derive(Debug, Clone, PartialEq)]
pub struct SkinOptions {
    /// A ring is placed wherever the axis turned by more than this since the last one, rad, 0.01..1.5.
    pub turn: f32,
    /// Length of a polygon side around the base of an axis, m, > 0.
    pub edge: f32,
    /// Fewest and most sides of a tube, 3..=32.
    pub sides: (u32, u32),
    /// Size of one repeat of the bark maps, width and height, m, > 0.
    pub tile: [f32; 2],
    /// Size of one repeat for axes that take the material of [`SkinOptions::shoot`], m.
    pub shoot_tile: [f32; 2],
    /// Whether the length of a repeat along an axis follows its radius or is fixed.
    pub uv: UvMode,
    /// Widening of a branch where it leaves its parent, as a share of its radius, 0..1.
    pub collar: f32,
    /// Widening of a trunk at the ground, as a share of its radius, 0..2.
    pub flare: f32,
    /// Height over which that widening falls to 1/e of itself, in radii of the trunk's base, 0.2..10.
    pub flare_height: f32,
    /// Ridges of the flare, one for each root that shows, 0..12; fewer than 2: the flare is round.
    pub buttresses: u32,
    /// Length by which a trunk is extended below its first node, m, so that uneven ground hides its end.
    pub bury: f32,
    /// Axes thinner at their base than the radius (m) take this material (index into the plant's) instead of their own.
    pub shoot: Option<(f32, u16)>,
    /// Axes thinner than this radius at their base are cones of three sides instead of tubes, m, >= 0.
    pub thin: f32,
    /// Most points of the skin; more are the error `Limit`.
    pub max_points: u64,
}

impl Default for SkinOptions {
    fn default() -> Self {
        Self {
            turn: 12.0 * PI / 180.0,
            edge: 0.04,
            sides: (5, 32),
            tile: [0.5, 0.5],
            shoot_tile: [0.5, 0.5],
            uv: UvMode::Conformal,
            collar: 0.6,
            flare: 0.0,
            flare_height: 3.0,
            buttresses: 0,
            bury: 0.0,
            shoot: None,
            thin: 0.0,
            max_points: 50_000_000,
        }
    }
}

impl SkinOptions {
    /// Size of one repeat of the maps on an axis with a radius at its base, m.
    fn tile_of(&self, r_base: f32) -> [f32; 2] {
        match self.shoot {
            Some((r, _)) if r_base < r => self.shoot_tile,
            _ => self.tile,
        }
    }
}

/// The location on the skeleton that a point of the skin is bound to.
#[derive(Debug, Clone, Copy, Default, PartialEq, bytemuck::Zeroable)]
#[repr(C)]
pub struct AxisBinding {
    /// Index into [`Plant::axes`].
    pub axis: u32,
    /// Arc length on that axis, m, within it.
    pub s: f32,
}

/// The points and triangles of one axis within the skin.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TubeRange {
    /// Index into [`Plant::axes`].
    pub axis: u32,
    /// First point in the mesh and number of points.
    pub points: (u32, u32),
    /// First triangle in the mesh and number of triangles.
    pub triangles: (u32, u32),
}

/// The axes of a plant as a mesh, and the place on the skeleton of each of its points.
#[derive(Debug, Clone, Default)]
pub struct PlantSkin {
    /// Tubes of all axes; subsets by material, whose ids are indices into [`Plant::materials`].
    pub mesh: Mesh,
    /// The skeleton location of each point, parallel to `mesh.points`.
    pub bindings: Vec<AxisBinding>,
    /// Tubes, one per axis that is neither a blade nor a cone, in the order of the mesh: by material, then as in the
    /// plant. Each is a closed surface once points that share a position are welded.
    pub tubes: Vec<TubeRange>,
}

/// Skins a plant that [`osier_scene::plant::validate`] accepted. Each axis becomes one closed tube that starts inside its
/// parent; side branches begin with a widened collar that lies on the parent's surface, branches at the tip continue from the
/// parent's last ring. Axes of the kind [`osier_scene::plant::AxisKind::Blade`] become strips instead, those thinner than
/// [`SkinOptions::thin`] closed cones. Positions in m, plant space; normals are exact on cones.
/// # Errors
/// `Range` for an option outside its range, `Limit` for more than `max_points` points.
/// Own: rings, junctions and continuations; frames after [`osier_base::math::transport`].
pub fn skin(plant: &Plant, options: &SkinOptions) -> Result<PlantSkin> {
    let mut out = PlantSkin::default();
    skin_into(plant, options, &mut out)?;
    Ok(out)
}

/// As [`skin`], but reuses the buffers of an earlier skin, which avoids page faults for callers that skin repeatedly. The old
/// contents of `out` do not matter.
/// # Errors
/// As [`skin`]. `out` is then unchanged, unless only the blades exceed `max_points`: then it holds tubes and some blades.
pub fn skin_into(plant: &Plant, options: &SkinOptions, out: &mut PlantSkin) -> Result<()> {
    check(options)?;
    let plans = tube_plan::plan_tubes(plant, options);
    let layout = layout::lay_out(plant, options, &plans)?;
    emit::emit(plant, options, &plans, layout, out);
    thin::append_thin_axes(plant, options, out)?;
    ribbon::append_ribbons(plant, options, out)
}

fn check(o: &SkinOptions) -> Result<()> {
    let ranges = [
        ("turn", o.turn, 0.01, 1.5, "rad"),
        ("edge", o.edge, 1e-5, 100.0, "m"),
        ("sides, fewest", o.sides.0 as f32, 3.0, o.sides.1 as f32, ""),
        ("sides, most", o.sides.1 as f32, o.sides.0 as f32, 32.0, ""),
        ("tile, width", o.tile[0], 1e-3, 100.0, "m"),
        ("tile, height", o.tile[1], 1e-3, 100.0, "m"),
        ("tile of shoots, width", o.shoot_tile[0], 1e-3, 100.0, "m"),
        ("tile of shoots, height", o.shoot_tile[1], 1e-3, 100.0, "m"),
        ("collar", o.collar, 0.0, 1.0, ""),
        ("flare", o.flare, 0.0, 2.0, ""),
        ("flare_height", o.flare_height, 0.2, 10.0, "radii"),
        ("buttresses", o.buttresses as f32, 0.0, 12.0, ""),
        ("bury", o.bury, 0.0, 100.0, "m"),
        ("thin", o.thin, 0.0, 100.0, "m"),
    ];
    for (name, value, min, max, unit) in ranges {
        if !(min..=max).contains(&value) {
            let name = format!("skin: {name}");
            return Err(Error::Range { name, value: value.into(), min: min.into(), max: max.into(), unit });
        }
    }
    Ok(())
}
