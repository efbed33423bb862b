//! `[[solid]]`: obstacles to wind, rain and catkins.

use super::UpAxis;
use crate::recipe::syntax::{
    BooleanType, ColorType, FileReference, NumberArray, OneOf, OptionalKey, Reference, StringType, degrees, number,
    point,
};
use crate::recipe::syntax::{choices, keys};

choices! {
    /// Geometry of a solid: a primitive, or an imported mesh.
    SolidShape {
        /// A box, for example a wall.
        Block = "block",
        /// A house with a gable roof.
        House = "house",
        /// A mesh of a file. An open mesh stops wind and catkins, but its inside is a guess.
        Mesh = "mesh",
    }
}

keys! {
    /// A solid: an obstacle for wind, rain and catkins.
    SolidKeys at "solid" as list {
        /// Name, also of its deposition maps.
        name: String = "name" StringType("");
        /// Geometric form.
        shape: SolidShape = "shape" OneOf(SolidShape::Block);
        /// Position of its bottom centre.
        at: [f64; 3] = "at" point([0.0; 3]);
        /// Width (X before rotation), height (to the eaves), depth (Z).
        size: [f64; 3] = "size" NumberArray([0.3, 3.0, 10.0], number(1.0, 0.01, 1e4, "m"));
        /// Rotation about the vertical axis, counter-clockwise from above.
        turn: f64 = "turn_deg" degrees(0.0, -360.0, 360.0);
        /// With "house": height of the ridge above the eaves.
        roof: f64 = "roof" number(2.5, 0.1, 1e3, "m");
        /// With "mesh": the file.
        mesh: Option<Reference> = "mesh" FileReference(".obj, .glb, .gltf");
        /// With "mesh": metres per unit of the file.
        mesh_scale: f64 = "mesh_scale" number(1.0, 1e-6, 1e6, "m");
        /// With "mesh": up axis of the file.
        mesh_up: UpAxis = "mesh_up" OneOf(UpAxis::Y);
        /// Humidity of its walls: at 0 catkins slide down at once, at 1 they stay.
        humidity: f64 = "humidity" number(0.5, 0.0, 1.0, "");
        /// Colour of its walls.
        color: Option<[f32; 3]> = "color" OptionalKey(ColorType("#b9aa93"), "plaster");
        /// With "house": colour of the roof.
        roof_color: Option<[f32; 3]> = "roof_color" OptionalKey(ColorType("#7d4433"), "tiles");
        /// Whether it is visible.
        show: bool = "show" BooleanType(true);
    }
}
