//! `[[place]]`: where plants stand.

use crate::recipe::syntax::keys;
use crate::recipe::syntax::{OptionalKey, SeedType, StringType, degrees, integer, number, point};

keys! {
    /// Puts plants into the scene.
    PlaceKeys at "place" {
        /// Which plant.
        plant: String = "plant" StringType("");
        /// Where; with `count` the middle of the group.
        at: [f64; 3] = "at" point([0.0; 3]);
        /// Turn about the vertical; drawn for each copy of a group.
        turn: Option<f64> = "turn_deg" OptionalKey(degrees(0.0, -360.0, 360.0), "0, random in groups");
        /// Size.
        scale: f64 = "scale" number(1.0, 1e-3, 1e3, "");
        /// Random share added to or taken from the size.
        vary: f64 = "vary" number(0.0, 0.0, 0.9, "");
        /// Lean from the vertical.
        lean: f64 = "lean_deg" degrees(0.0, 0.0, 90.0);
        /// Where it leans: 0 towards +X, 90 towards -Z.
        lean_to: f64 = "lean_to_deg" degrees(0.0, -360.0, 360.0);
        /// Another individual for the same place.
        seed: u64 = "seed" SeedType(0);
        /// Number of copies, spread over `radius`.
        count: u32 = "count" integer(1, 1, 100_000);
        /// Copies stand within this distance.
        radius: f64 = "radius" number(10.0, 0.0, 1e5, "m");
        /// Copies keep this distance where they can.
        spacing: f64 = "spacing" number(0.0, 0.0, 1e5, "m");
        /// Copies keep this distance from what the places before this one put up.
        clear: f64 = "clear" number(0.0, 0.0, 1e5, "m");
        /// Copies share so many individuals.
        individuals: Option<u32> = "individuals" OptionalKey(integer(1, 1, 10_000), "count: each grows its own");
    }
}
