//! `[plants.NAME.turtle]`: how the turtle draws a string.

use crate::recipe::syntax::{BooleanType, InlineTables, NumberArray, OneOf, OptionalKey, degrees, integer, number};
use crate::recipe::syntax::{choices, keys};

choices! {
    /// Line style of turtle segments.
    LineStyle {
        /// Drawn 0.02 units wide.
        Pixel = "pixel",
        /// A flat polygon.
        Polygon = "polygon",
        /// A round cylinder.
        Cylinder = "cylinder",
    }
}

keys! {
    /// Turtle interpretation of the string of a plant. `--set` has precedence over this table, this table over the defaults.
    TurtleKeys at "plants.NAME.turtle" {
        /// Angle of turns without a parameter.
        angle: Option<f64> = "angle_deg" OptionalKey(degrees(45.0, -360.0, 360.0), "45");
        /// Length of a turtle unit.
        unit: f64 = "unit_m" number(1.0, 1e-6, 1e6, "m");
        /// Diameter of segments at the start of the string.
        width: Option<f64> = "width" OptionalKey(number(1.0, 1e-7, 1e6, "turtle units"), "1");
        /// Change of the width by '#' and '!' without a parameter.
        width_increment: Option<f64> = "width_increment" OptionalKey(number(0.0, -1e6, 1e6, "turtle units"), "0");
        /// Line style of cpfg; only "pixel" has an effect: it changes the default of `width` to 0.02.
        line: Option<LineStyle> = "line" OptionalKey(OneOf(LineStyle::Cylinder), "\"pixel\"");
        /// Whether a segment tapers to the next width.
        tapered: Option<bool> = "tapered" OptionalKey(BooleanType(true), "true");
        /// Initial colour index.
        color: Option<u32> = "color" OptionalKey(integer(128, 0, 255), "128");
        /// Change of the colour index by ';' and ',' without a parameter.
        color_increment: Option<u32> = "color_increment" OptionalKey(integer(1, 0, 255), "1");
        /// Factor on lengths at the start of the string.
        scale: Option<f64> = "scale" OptionalKey(number(1.0, 1e-6, 1e6, ""), "1");
        /// Factor of '@D' without a parameter.
        scale_multiplier: Option<f64> = "scale_multiplier" OptionalKey(number(1.0, 1e-6, 1e6, ""), "1");
        /// Whether rolls since the last segment are kept under a tropism.
        tropism_keep_roll: bool = "tropism_keep_roll" BooleanType(false);
        /// Tropisms, numbered from 1 for '@T'.
        tropisms: Vec<TropismKeys> = "tropisms" InlineTables::<TropismKeys>(std::marker::PhantomData);
    }
    /// A tropism that turns the heading towards a direction.
    TropismKeys at "plants.NAME.turtle.tropisms" {
        /// Direction towards which the heading turns; normalised.
        dir: [f64; 3] = "dir" NumberArray([0.0, 1.0, 0.0], number(0.0, -1e6, 1e6, ""));
        /// Angle to `dir` that the heading seeks.
        angle: f64 = "angle_deg" degrees(0.0, -360.0, 360.0);
        /// Strength; negative values turn away.
        intensity: f64 = "intensity" number(1.0, -1.0, 1.0, "");
        /// Initial elasticity.
        elasticity: f64 = "elasticity" number(0.0, -100.0, 100.0, "");
        /// Change of the elasticity by '@Ti' and '@Td' without a parameter.
        step: f64 = "step" number(0.0, -100.0, 100.0, "");
    }
}
