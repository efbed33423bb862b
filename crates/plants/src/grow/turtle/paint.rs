//! Colour indices as provisional materials of the shapes that the turtle draws.
//!
//! Which indices a string uses is known only when it is drawn. Until then meshes of polygons, discs, spheres and surfaces name
//! the materials of this module; the code that knows the colours replaces them by real ones.

use osier_scene::MaterialId;

/// Bit of all provisional materials, beyond any real index.
const PAINT: MaterialId = 1 << 24;
/// Bit of provisional materials of thin surfaces.
const THIN: MaterialId = 1 << 8;

/// Provisional material of a surface that takes the turtle's colour at the place of each instance.
pub const TURTLE_COLOR: MaterialId = PAINT | (1 << 9);

/// Colour index of surfaces that are placed before any colour is set, where the grammar has no colours: the leaf green of the
/// default colours.
const UNPAINTED_LEAF: u8 = 1;

/// A colour index, and whether the coloured surface is thin.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Paint {
    /// Colour index of the turtle, an entry of the colour map.
    pub index: u8,
    /// Whether the surface is thin and seen from both sides, as polygons and leaves; else it is the outside of something round.
    pub thin: bool,
}

impl Paint {
    /// Provisional material that holds the index and thinness; [`Paint::of`] reads them back.
    pub fn material(self) -> MaterialId {
        PAINT | if self.thin { THIN } else { 0 } | MaterialId::from(self.index)
    }

    /// The colour index that a material stands for; `None` for real materials and for [`TURTLE_COLOR`].
    #[allow(clippy::cast_possible_truncation, reason = "the low byte is meant")]
    pub fn of(material: MaterialId) -> Option<Self> {
        let is_paint = material & PAINT != 0 && material != TURTLE_COLOR;
        is_paint.then_some(Self { index: material as u8, thin: material & THIN != 0 })
    }

    /// A thin surface in the turtle's colour; `color`: that colour, if one is set.
    pub(super) fn leaf(color: Option<u8>) -> Self {
        Self { index: color.unwrap_or(UNPAINTED_LEAF), thin: true }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn materials_tell_their_color() {
        for index in [0, 1, 128, 255] {
            for thin in [false, true] {
                let paint = Paint { index, thin };
                assert_eq!(Paint::of(paint.material()), Some(paint));
            }
        }
        assert_eq!((Paint::of(0), Paint::of(700), Paint::of(TURTLE_COLOR)), (None, None, None));
    }
}
