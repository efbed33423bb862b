//! `[plants.NAME.turtle]`: how the turtle draws a string.

use crate::recipe::syntax::{
    BooleanType, FileReference, InlineTables, NumberArray, OneOf, OptionalKey, Reference, degrees, integer, number,
};
use crate::recipe::syntax::{choices, keys};

choices! {
    /// Geometry of the segments that a turtle draws.
    LineStyle {
        /// Lines whose widths are pixels.
        Pixel = "pixel",
        /// A flat polygon, whose width is in units of the turtle.
        Polygon = "polygon",
        /// A round cylinder, whose width is in units of the turtle.
        Cylinder = "cylinder",
    }
}

keys! {
    /// Turtle interpretation of the string of a plant. `--set` has precedence over this table, this table over the defaults.
    TurtleKeys at "plants.NAME.turtle" {
        /// View file of cpfg: "auto" is the one with the grammar's name, else the only one beside it; "none" reads none. Keys of this table
        /// have precedence over it.
        view: Option<Reference> = "view" FileReference(".v, \"auto\" or \"none\"");
        /// Colours of indices: a colour map or a material file of cpfg. "auto" is the one with the grammar's name, or the only one beside a
        /// grammar with a view; "none" reads none.
        colors: Option<Reference> = "colors" FileReference(".map, .mat, \"auto\" or \"none\"");
        /// Angle of turns without a parameter.
        angle: Option<f64> = "angle_deg" OptionalKey(degrees(45.0, -360.0, 360.0), "45");
        /// Length of a turtle unit.
        unit: f64 = "unit_m" number(1.0, 1e-6, 1e6, "m");
        /// Diameter of segments at the start of the string.
        width: Option<f64> = "width" OptionalKey(number(1.0, 1e-7, 1e6, "turtle units"), "1");
        /// Change of the width by '#' and '!' without a parameter.
        width_increment: Option<f64> = "width_increment" OptionalKey(number(0.0, -1e6, 1e6, "turtle units"), "0");
        /// Line style of cpfg: with "pixel" widths are pixels, which are shares of the drawing's size.
        line: Option<LineStyle> = "line" OptionalKey(OneOf(LineStyle::Cylinder), "that of the view");
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
        /// Direction of the older tropism of cpfg, which bends after each segment.
        old_tropism: Option<[f64; 3]> = "old_tropism" OptionalKey(NumberArray([0.0, 1.0, 0.0], number(0.0, -1e6, 1e6, "")), "[0, 1, 0]");
        /// Elasticity of the older tropism at the start of the string.
        old_elasticity: Option<f64> = "old_elasticity" OptionalKey(number(0.0, -100.0, 100.0, ""), "0");
        /// Change of that elasticity by '_' without a parameter.
        old_increment: Option<f64> = "old_increment" OptionalKey(number(0.0, -100.0, 100.0, ""), "0");
        /// Number of sides of generalised cylinders with a round contour.
        sides: Option<u32> = "sides" OptionalKey(integer(8, 3, 256), "8");
        /// Whether generalised cylinders turn with the turtle instead of by the least twist.
        twist: Option<bool> = "twist" OptionalKey(BooleanType(false), "false");
        /// Contours of generalised cylinders.
        contours: Vec<ContourKeys> = "contours" InlineTables::<ContourKeys>(std::marker::PhantomData);
        /// Functions for 'func', numbered from 1 after those of the view.
        functions: Vec<FunctionKeys> = "functions" InlineTables::<FunctionKeys>(std::marker::PhantomData);
    }
    /// A contour of generalised cylinders.
    ContourKeys at "plants.NAME.turtle.contours" as list {
        /// Number of the contour, by which '@#' selects it.
        id: u32 = "id" integer(1, 1, 100_000);
        /// Its file.
        file: Option<Reference> = "file" FileReference(".con");
    }
    /// A function for 'func', or a set of them.
    FunctionKeys at "plants.NAME.turtle.functions" as list {
        /// Its file.
        file: Option<Reference> = "file" FileReference(".func, .fset");
        /// Number of samples of its table; 0 takes the number of the file.
        samples: u32 = "samples" integer(0, 0, 100_000);
    }
    /// A tropism that turns the heading towards a direction.
    TropismKeys at "plants.NAME.turtle.tropisms" as list {
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
        /// Turns the frame about the heading towards `dir` instead of the heading.
        torque: bool = "torque" BooleanType(false);
    }
}
