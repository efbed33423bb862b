//! `[plants.NAME.rods]`: plants that move as elastic rods.

use crate::recipe::syntax::keys;
use crate::recipe::syntax::{OptionalKey, gigapascals, integer, millimetres, number};

keys! {
    /// Simulates twigs and petioles of a plant as elastic rods, instead of by `[sway]`. Stiffness, density, drag and damping
    /// are those of `[plants.NAME.wood]`.
    RodPlantKeys at "plants.NAME.rods" {
        /// Largest radius of wood that moves; thicker wood is static.
        thickest: f64 = "thickest_mm" millimetres(15.0, 0.1, 1000.0);
        /// Young's modulus of petioles.
        petiole_elasticity: f64 = "petiole_elasticity_gpa" gigapascals(0.3, 0.001, 30.0);
        /// Radius of petioles.
        petiole_radius: Option<f64> = "petiole_radius_mm" OptionalKey(millimetres(0.8, 0.1, 10.0), "that of the leaf, else 0.8");
        /// Shear modulus divided by Young's modulus.
        shear_ratio: f64 = "shear_ratio" number(1.0 / 15.0, 0.02, 0.5, "");
        /// Stiffness of the springs that restore the grown pose, as a fraction of the bending stiffness.
        recovery: f64 = "recovery" number(0.25, 0.0, 4.0, "");
        /// Divides the stiffness of wood and petioles, for exaggerated bending.
        compliance: f64 = "compliance" number(1.0, 1.0, 20.0, "");
        /// Number of cross-sections of a twig.
        sections: Option<u32> = "sections" OptionalKey(integer(9, 3, 64), "an interval of 3 radii, 5 to 16");
        /// Number of cross-sections of a petiole.
        petiole_sections: u32 = "petiole_sections" integer(5, 3, 16);
        /// Time steps per frame.
        substeps: Option<u32> = "substeps" OptionalKey(integer(16, 1, 10_000), "8, more below 24 frames per second, or as many as the lowest natural frequencies need");
        /// Largest number of leaves with a petiole of their own; further leaves are rigidly attached.
        max_leaves: u32 = "max_leaves" integer(400, 0, 100_000);
        /// Largest number of cross-sections of the plant; further twigs are rigidly attached.
        max_sections: u32 = "max_sections" integer(4000, 3, 1_000_000);
    }
}
