//! `[[place]]`: where plants stand.

use crate::recipe::syntax::keys;
use crate::recipe::syntax::{BooleanType, OptionalKey, SeedType, StringType, degrees, integer, number, point};

keys! {
    /// Places plants in the scene.
    PlaceKeys at "place" {
        /// Name of the plant, as in `[plants.NAME]`.
        plant: String = "plant" StringType(""), basic;
        /// Position; with `count` the centre of the group.
        at: [f64; 3] = "at" point([0.0; 3]), basic;
        /// Rotation about the vertical axis.
        turn: Option<f64> = "turn_deg" OptionalKey(degrees(0.0, -360.0, 360.0), "0; random in groups"), basic;
        /// Factor on the size of the copies.
        scale: f64 = "scale" number(1.0, 1e-3, 1e3, ""), basic;
        /// Random variation of the scale, as a fraction.
        vary: f64 = "vary" number(0.0, 0.0, 0.9, ""), basic;
        /// Inclination from the vertical.
        lean: f64 = "lean_deg" degrees(0.0, 0.0, 90.0);
        /// Direction of the inclination: 0 is +X, 90 is -Z.
        lean_to: f64 = "lean_to_deg" degrees(0.0, -360.0, 360.0);
        /// Selects another individual.
        seed: u64 = "seed" SeedType(0);
        /// Number of copies within `radius`.
        count: u32 = "count" integer(1, 1, 100_000), basic;
        /// Radius of the group.
        radius: f64 = "radius" number(10.0, 0.0, 1e5, "m"), basic;
        /// Smallest distance between copies, where there is room.
        spacing: f64 = "spacing" number(0.0, 0.0, 1e5, "m"), basic;
        /// Smallest distance to plants of earlier `[[place]]` tables.
        clear: f64 = "clear" number(0.0, 0.0, 1e5, "m");
        /// Whether these copies of a species, and those of all other such tables, grow in one field of light.
        together: bool = "together" BooleanType(false);
        /// Number of individuals that the copies share.
        individuals: Option<u32> = "individuals" OptionalKey(integer(1, 1, 10_000), "count: one each");
    }
}
