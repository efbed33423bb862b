//! `[plants.NAME.turtle]`: how the turtle draws a string.

use crate::recipe::syntax::{BooleanType, InlineTables, NumberArray, OneOf, OptionalKey, degrees, integer, number};
use crate::recipe::syntax::{choices, keys};

choices! {
    /// Line style of turtle segments.
    LineStyle {
        /// Drawn 0.02 units wide.
        Pixel = "pixel",
        /// Flat.
        Polygon = "polygon",
        /// Round.
        Cylinder = "cylinder",
    }
}

keys! {
    /// How the turtle draws a plant's string. Precedence: `--set`, here, then the default.
    TurtleKeys at "plants.NAME.turtle" {
        /// Angle of a turn without parameter.
        angle: Option<f64> = "angle_deg" OptionalKey(degrees(45.0, -360.0, 360.0), "45");
        /// Size of one turtle unit.
        unit: f64 = "unit_m" number(1.0, 1e-6, 1e6, "m");
        /// Diameter at the start, in turtle units.
        width: Option<f64> = "width" OptionalKey(number(1.0, 1e-7, 1e6, "turtle units"), "1");
        /// What '#' and '!' without parameter add and take.
        width_increment: Option<f64> = "width_increment" OptionalKey(number(0.0, -1e6, 1e6, "turtle units"), "0");
        /// Line style.
        line: Option<LineStyle> = "line" OptionalKey(OneOf(LineStyle::Cylinder), "\"pixel\"");
        /// Whether a segment takes the next width at its end.
        tapered: Option<bool> = "tapered" OptionalKey(BooleanType(true), "true");
        /// Colour index at the start.
        color: Option<u32> = "color" OptionalKey(integer(128, 0, 255), "128");
        /// What ';' and ',' without parameter add and take.
        color_increment: Option<u32> = "color_increment" OptionalKey(integer(1, 0, 255), "1");
        /// Scale at the start.
        scale: Option<f64> = "scale" OptionalKey(number(1.0, 1e-6, 1e6, ""), "1");
        /// Factor of '@D' without parameter.
        scale_multiplier: Option<f64> = "scale_multiplier" OptionalKey(number(1.0, 1e-6, 1e6, ""), "1");
        /// Whether a roll made since the last segment survives a tropism.
        tropism_keep_roll: bool = "tropism_keep_roll" BooleanType(false);
        /// Pulls on the heading, numbered from 1 for '@T'.
        tropisms: Vec<TropismKeys> = "tropisms" InlineTables::<TropismKeys>(std::marker::PhantomData);
    }
    /// One tropism.
    TropismKeys at "plants.NAME.turtle.tropisms" {
        /// Where it pulls; made a unit vector.
        dir: [f64; 3] = "dir" NumberArray([0.0, 1.0, 0.0], number(0.0, -1e6, 1e6, ""));
        /// Angle to the direction that it seeks.
        angle: f64 = "angle_deg" degrees(0.0, -360.0, 360.0);
        /// Sign and strength.
        intensity: f64 = "intensity" number(1.0, -1.0, 1.0, "");
        /// Elasticity at the start.
        elasticity: f64 = "elasticity" number(0.0, -100.0, 100.0, "");
        /// What '@Ti' without parameter adds.
        step: f64 = "step" number(0.0, -100.0, 100.0, "");
    }
}
