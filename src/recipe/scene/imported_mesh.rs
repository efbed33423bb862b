//! `[plants.NAME.import]`: how the mesh of a whole plant gets its skeleton.

use super::UpAxis;
use crate::recipe::syntax::keys;
use crate::recipe::syntax::{OneOf, OptionalKey, StringType, number, point};

keys! {
    /// How the mesh of a whole plant gets its skeleton.
    ImportedMeshKeys at "plants.NAME.import" {
        /// Objects and materials whose name holds one of these words are leaves. If none is, small flat parts are.
        leaf_pattern: String = "leaf_pattern" StringType("leaf|leaves|blade|needle|frond");
        /// Distance of the points of the skeleton along the wood.
        spacing: Option<f64> = "spacing" OptionalKey(number(0.1, 1e-4, 100.0, "m"), "three radii of the wood");
        /// Where the trunk begins, in the mesh's place.
        root: Option<[f64; 3]> = "root" OptionalKey(point([0.0; 3]), "its lowest thick end");
        /// Metres per unit of the mesh.
        mesh_scale: f64 = "mesh_scale" number(1.0, 1e-6, 1e6, "m");
        /// Upward axis of the mesh.
        mesh_up: UpAxis = "mesh_up" OneOf(UpAxis::Y);
        /// Flutter of the leaves: 1 for round stalks, 2 to 3 for the flat ones of poplars.
        flutter: f64 = "flutter" number(1.0, 0.0, 10.0, "");
    }
}
