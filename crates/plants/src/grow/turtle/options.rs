//! Options of the turtle, and the tropisms and organs of its symbols.

use std::collections::BTreeMap;
use std::sync::Arc;

use glam::DVec3;

use super::cylinders::Contour;
use crate::grow::radii::{Pipe, Taper};
use osier_scene::plant::Proto;
use osier_scene::{MaterialId, Mesh};

/// Key of the organ `stalk` among the organs of a plant, a character that no scene can name.
pub const STALK: char = '\u{e000}';

/// A tropism: a growth response that turns the heading towards a direction before each step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tropism {
    /// Direction of the stimulus in plant space; the turtle normalizes it.
    pub dir: DVec3,
    /// Angle to `dir` at which growth is at rest, rad: 0 along it, pi / 2 across it.
    pub angle: f64,
    /// Sign and strength, -1..1.
    pub intensity: f64,
    /// Susceptibility to bending at the start.
    pub elasticity: f64,
    /// Amount that `@Ti` without parameter adds to the elasticity.
    pub step: f64,
    /// Whether it rolls the turtle about its heading instead of turning the heading.
    pub torque: bool,
}

impl Default for Tropism {
    fn default() -> Self {
        Self { dir: DVec3::Y, angle: 0.0, intensity: 1.0, elasticity: 0.0, step: 0.0, torque: false }
    }
}

/// What an organ symbol (`~c`) stands for.
#[derive(Debug, Clone)]
pub struct OrganSpec {
    /// Name in files, `[a-z0-9_]+`; prototypes are called `NAME` or `NAME_0`, `NAME_1`, ...
    pub name: String,
    /// Prototypes in organ space, one picked per organ by its id; their subsets index [`TurtleOptions::materials`], or are
    /// [`TURTLE_COLOR`](super::TURTLE_COLOR) or a [`Paint`](super::Paint).
    pub meshes: Vec<Arc<Mesh>>,
    /// Length along +Y that parameter 1 stands for, m; prototypes are scaled to it.
    pub size: f64,
    /// Distance from the centreline to the pivot at parameter 1, m.
    pub petiole: f64,
}

impl OrganSpec {
    /// A prototype for each mesh, named after the organ.
    pub(in crate::grow) fn prototypes(&self) -> Vec<Proto> {
        let many = self.meshes.len() > 1;
        let name = |i: usize| if many { format!("{}_{i}", self.name) } else { self.name.clone() };
        self.meshes.iter().enumerate().map(|(i, mesh)| Proto { name: name(i), mesh: Arc::clone(mesh) }).collect()
    }
}

/// Source of the radii of axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum RadiusModel {
    /// Turtle widths if the string sets any; else the pipe model, or one width where nothing branches.
    Auto,
    /// The widths that the string sets, or else `width`, are pixels of a drawing (cpfg's line style `pixel`).
    Pixels,
    /// The widths that the string sets, linear along a segment.
    Widths,
    /// The pipe model, whatever the string sets.
    Pipe(Pipe),
    /// A taper along each axis, whatever the string sets.
    Taper(Taper),
    /// Turtle widths if the string sets any, otherwise this taper.
    Hairs(Taper),
}

/// State that the turtle starts with, defaults of its commands, and the organs and materials that symbols name.
#[derive(Debug, Clone)]
pub struct TurtleOptions {
    /// Angle of turns without parameter, rad; `None`: 45 degrees, with a warning where it is used.
    pub angle: Option<f64>,
    /// Size of one turtle unit, m.
    pub unit_m: f64,
    /// Diameter at the start, turtle units.
    pub width: f64,
    /// Amount that `#` adds and `!` subtracts without parameter, turtle units.
    pub width_increment: f64,
    /// Colour index at the start, 0..255.
    pub color: u8,
    /// Whether all parts take the colour index from the start; else parts drawn before the first colour command take the
    /// materials of the plant.
    pub painted: bool,
    /// Amount that `;` adds and `,` subtracts without parameter; indices wrap at 256.
    pub color_increment: u8,
    /// Factor of lengths and widths at the start; commands `@D` change it.
    pub scale: f64,
    /// Factor of `@D` without parameter.
    pub scale_multiplier: f64,
    /// Whether the end of a segment takes the width that is set after the segment; else a segment has one width.
    pub tapered: bool,
    /// Tropisms, numbered from 1 for `@T`; at most 8.
    pub tropisms: Vec<Tropism>,
    /// Direction of the tropism whose elasticity the command `_(e)` sets (cpfg's older form); any length above 0.
    pub old_tropism: DVec3,
    /// Elasticity of `old_tropism` at the start.
    pub old_elasticity: f64,
    /// Amount that `_` without a parameter adds to that elasticity.
    pub old_increment: f64,
    /// Whether a roll made since the last segment survives a tropism.
    pub tropism_keep_roll: bool,
    /// Organs by the symbol after `~`.
    pub organs: BTreeMap<char, OrganSpec>,
    /// Contours of generalised cylinders by number; the number 0 is a circle.
    pub contours: BTreeMap<u32, Contour>,
    /// Sides of a contour of generalised cylinders, unless `@!` sets another number.
    pub sides: u32,
    /// Whether the cross-sections of generalised cylinders roll with the turtle; else they have the least twist.
    pub twist: bool,
    /// Whether the part of the final string from a `%` to the end of its branch is drawn.
    pub past_cut: bool,
    /// Materials by the number that `@Tx` gives; 0 is no texture.
    pub textures: BTreeMap<u32, MaterialId>,
    /// End points of organs that have one, in the units of their meshes: the turtle moves there after it has placed the
    /// organ. After other organs it stays in place.
    pub organ_ends: BTreeMap<char, DVec3>,
    /// Names of the plant's materials, which the indices below refer to.
    pub materials: Vec<String>,
    /// Material of axes that do not take `shoot_material`, index into `materials`.
    pub axis_material: u16,
    /// Material of axes thinner than `shoot_radius` at their base, if it differs.
    pub shoot_material: Option<u16>,
    /// Radius of the first node of an axis below which it takes `shoot_material`, m.
    pub shoot_radius: f64,
    /// Material of polygons, discs, spheres, patches and cylinders that have no texture and no colour.
    pub shape_material: MaterialId,
    /// Whether radii come from the string's widths, the pipe model or a taper.
    pub radii: RadiusModel,
    /// Part of the last step of the derivation that is drawn, above 0 and below 1: what the step changes grows in proportion. `None`: the
    /// whole step.
    pub step_part: Option<f64>,
    /// Description of the plant's origin, for manifests.
    pub source: String,
}

impl Default for TurtleOptions {
    fn default() -> Self {
        Self {
            angle: None,
            unit_m: 1.0,
            width: 1.0,
            width_increment: 0.0,
            color: 128,
            painted: false,
            color_increment: 1,
            scale: 1.0,
            scale_multiplier: 1.0,
            tapered: true,
            tropisms: Vec::new(),
            old_tropism: DVec3::Y,
            old_elasticity: 0.0,
            old_increment: 0.0,
            tropism_keep_roll: false,
            organs: BTreeMap::new(),
            organ_ends: BTreeMap::new(),
            contours: BTreeMap::new(),
            sides: 8,
            twist: false,
            past_cut: true,
            textures: BTreeMap::new(),
            materials: vec!["bark".into()],
            axis_material: 0,
            shoot_material: None,
            shoot_radius: 0.008,
            shape_material: 0,
            radii: RadiusModel::Auto,
            step_part: None,
            source: String::new(),
        }
    }
}
