//! `[plants.NAME.rods]`: plants that move as elastic rods.

use crate::recipe::syntax::keys;
use crate::recipe::syntax::{OptionalKey, gigapascals, integer, millimetres, number};

keys! {
    /// Moves a plant as rods: twigs bend, leaves hang on stalks. With this table wind moves it so, instead of by `sway`;
    /// stiffness, weight, drag and damping stand in `[plants.NAME.wood]`.
    RodPlantKeys at "plants.NAME.rods" {
        /// Wood thicker than this, in radius, stands still.
        thickest: f64 = "thickest_mm" millimetres(15.0, 0.1, 1000.0);
        /// Young's modulus of stalks.
        petiole_elasticity: f64 = "petiole_elasticity_gpa" gigapascals(0.3, 0.001, 30.0);
        /// Radius of stalks.
        petiole_radius: Option<f64> = "petiole_radius_mm" OptionalKey(millimetres(0.8, 0.1, 10.0), "the leaf's own, or 0.8");
        /// Shear modulus over Young's.
        shear_ratio: f64 = "shear_ratio" number(1.0 / 15.0, 0.02, 0.5, "");
        /// Strength of the springs back to how it grew.
        recovery: f64 = "recovery" number(0.25, 0.0, 4.0, "");
        /// Divides the stiffness of all wood and stalks, for exaggerated bending.
        compliance: f64 = "compliance" number(1.0, 1.0, 20.0, "");
        /// Cross-sections of a twig.
        sections: Option<u32> = "sections" OptionalKey(integer(9, 3, 64), "an interval of 3 radii, 5 to 16");
        /// Cross-sections of a stalk.
        petiole_sections: u32 = "petiole_sections" integer(5, 3, 16);
        /// Steps a frame.
        substeps: Option<u32> = "substeps" OptionalKey(integer(16, 1, 10_000), "8 to 64, by its slowest swings");
        /// Leaves on stalks of their own; further ones are rigid with their twigs.
        max_leaves: u32 = "max_leaves" integer(400, 0, 100_000);
        /// Cross-sections of the whole plant; twigs without room are rigid with what they stand on.
        max_sections: u32 = "max_sections" integer(4000, 3, 1_000_000);
    }
}
