//! `[[solid]]`: obstacles to wind and catkins.

use crate::recipe::syntax::{
    BooleanType, ColorType, FileReference, NumberArray, OneOf, OptionalKey, Reference, StringType, degrees, number,
    point,
};
use crate::recipe::syntax::{choices, keys};

choices! {
    /// Forms of solids.
    SolidShape {
        /// A box: a wall, a block.
        Block = "block",
        /// A house with a gable roof.
        House = "house",
        /// A closed mesh of a file.
        Mesh = "mesh",
    }
}

keys! {
    /// Something in the way of wind and catkins.
    SolidKeys at "solid" {
        /// Its name; names its maps.
        name: String = "name" StringType("");
        /// Form.
        shape: SolidShape = "shape" OneOf(SolidShape::Block);
        /// Middle of its foot.
        at: [f64; 3] = "at" point([0.0; 3]);
        /// Width (along X before it is turned), height (of the eaves), depth.
        size: [f64; 3] = "size" NumberArray([0.3, 3.0, 10.0], number(1.0, 0.01, 1e4, "m"));
        /// Turned about the vertical, counter-clockwise seen from above.
        turn: f64 = "turn_deg" degrees(0.0, -360.0, 360.0);
        /// With "house": height of the ridge over the eaves.
        roof: f64 = "roof" number(2.5, 0.1, 1e3, "m");
        /// With "mesh": the file.
        mesh: Option<Reference> = "mesh" FileReference(".obj, .glb, .gltf");
        /// With "mesh": metres per unit of the file.
        mesh_scale: f64 = "mesh_scale" number(1.0, 1e-6, 1e6, "m");
        /// How wet its steep faces are: 0 lets slide down at once, 1 holds for ever.
        humidity: f64 = "humidity" number(0.5, 0.0, 1.0, "");
        /// Its walls.
        color: Option<[f32; 3]> = "color" OptionalKey(ColorType("#b9aa93"), "plaster");
        /// With "house": its roof.
        roof_color: Option<[f32; 3]> = "roof_color" OptionalKey(ColorType("#7d4433"), "tiles");
        /// Whether it is seen.
        show: bool = "show" BooleanType(true);
    }
}
