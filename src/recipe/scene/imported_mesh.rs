//! `[plants.NAME.import]`: how the mesh of a whole plant gets its skeleton.

use super::UpAxis;
use crate::recipe::syntax::keys;
use crate::recipe::syntax::{OneOf, OptionalKey, StringType, number, point};

keys! {
    /// Extraction of the skeleton of a plant mesh (`mesh` of the plant).
    ImportedMeshKeys at "plants.NAME.import" {
        /// Words, separated by bars; objects and materials whose name contains one are leaves. If no name matches, small
        /// flat parts are leaves.
        leaf_pattern: String = "leaf_pattern" StringType("leaf|leaves|blade|needle|frond");
        /// Distance between points of the skeleton along the wood.
        spacing: Option<f64> = "spacing" OptionalKey(number(0.1, 1e-4, 100.0, "m"), "three radii of the wood");
        /// Base of the trunk, in metres with +Y up, as `mesh_scale` and `mesh_up` make the mesh.
        root: Option<[f64; 3]> = "root" OptionalKey(point([0.0; 3]), "the lowest thick end");
        /// Metres per unit of the mesh.
        mesh_scale: f64 = "mesh_scale" number(1.0, 1e-6, 1e6, "m");
        /// Up axis of the mesh.
        mesh_up: UpAxis = "mesh_up" OneOf(UpAxis::Y);
        /// Factor on leaf flutter: 1 for round petioles, 2 to 3 for the flat petioles of poplars.
        flutter: f64 = "flutter" number(1.0, 0.0, 10.0, "");
    }
}
