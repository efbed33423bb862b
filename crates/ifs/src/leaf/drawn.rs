//! Maps and blade of a traced leaf, and a hash of all that they depend on.

use std::sync::OnceLock;

use glam::DVec2;

use super::{BladePlacement, FlatBlade, LeafColors, LeafSpec, fields, leaf, normals};
use crate::Ifs;
use osier_base::convert::saturating_index;
use osier_base::diagnostic::Diagnostic;
use osier_base::units::{byte, srgb_from_linear};

/// Revision of the tracing algorithm, increased whenever the same table and parameters give another leaf.
const REVISION: u32 = 1;

/// Maps and blade of a leaf. Maps are square, rows from the top.
#[derive(Debug, Clone, PartialEq)]
pub struct DrawnLeaf {
    /// Pixels along a side of the maps.
    pub side: u32,
    /// sRGB and linear coverage, 4 bytes a pixel.
    pub color: Vec<u8>,
    /// Tangent-space normals as (n + 1) / 2, y up, 3 bytes a pixel.
    pub normal: Vec<u8>,
    /// Roughness, 0 smooth to 255 matt, a byte a pixel.
    pub rough: Vec<u8>,
    /// Relief, 16 bits a pixel: 0 (low, also outside the leaf) to 65,535.
    pub height: Vec<u16>,
    /// Triangulated blade, pixels of the maps, y up.
    pub flat: FlatBlade,
    /// Anchor and midrib of the blade on the maps, pixels, y up.
    pub place: BladePlacement,
    /// Anchor and tip, table units, as in the table: before the leaf is turned upright.
    pub ends: [DVec2; 2],
}

/// A leaf that is traced on first use, or the reason why it cannot be traced.
pub type LazyLeaf = OnceLock<Result<DrawnLeaf, Box<Diagnostic>>>;

/// Traces a leaf and paints its maps: colour, normals, roughness and relief.
/// # Errors
/// As [`leaf`].
pub fn mapped(table: &Ifs, spec: &LeafSpec, colors: &LeafColors) -> Result<DrawnLeaf, Box<Diagnostic>> {
    let traced = leaf(table, spec)?;
    let f = fields(&traced.raster, colors, 1.0);
    let n = traced.raster.mask.side;
    let rgba = |c: &[f32; 4]| {
        [byte(srgb_from_linear(c[0])), byte(srgb_from_linear(c[1])), byte(srgb_from_linear(c[2])), byte(c[3])]
    };
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to 16 bits before the cast")]
    // 16 bits for the relief: 8 would show steps under grazing light.
    let deep = |h: &f32| (h.clamp(0.0, 1.0) * 65_535.0 + 0.5) as u16;
    Ok(DrawnLeaf {
        // The side of the maps is at most 4096 pixels.
        side: saturating_index(n),
        color: f.color.iter().flat_map(rgba).collect(),
        normal: normals(&f.height, &traced.raster.mask.set, n),
        rough: f.rough.iter().map(|r| byte(*r)).collect(),
        height: f.height.iter().map(deep).collect(),
        flat: traced.flat,
        place: traced.place,
        ends: traced.ends,
    })
}

/// BLAKE3 hash, 64 hex digits, of everything that determines a leaf: table, parameters, colours, and version of the program. Own:
/// Rust's `Debug` output of a float reads back to the same bits, and that of a struct contains every field.
pub fn hash(table: &Ifs, spec: &LeafSpec, colors: &LeafColors) -> String {
    let text = format!("{} {REVISION} {table:?} {spec:?} {colors:?}", env!("CARGO_PKG_VERSION"));
    blake3::hash(text.as_bytes()).to_hex().to_string()
}
