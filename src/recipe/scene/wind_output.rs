//! `[output.wind]`: files of the wind field.

use crate::recipe::syntax::{NumberArray, OneOf, OptionalKey, integer, number};
use crate::recipe::syntax::{choices, keys};

choices! {
    /// An axis.
    SliceAxis {
        /// East.
        X = "x",
        /// Up.
        Y = "y",
        /// South.
        Z = "z",
    }
}

keys! {
    /// Files of the wind itself, in `wind/`: planes with velocities as EXR, one for each [[output.wind.slice]], and whole boxes
    /// as VTI. Of any wind; clips only.
    WindOutputKeys at "output.wind" {
        /// Frames between two boxes.
        vti_every: Option<u32> = "vti_every" OptionalKey(integer(1, 1, 1_000_000), "no boxes");
        /// Side of a texel of planes and of a cell of boxes.
        texel: Option<f64> = "texel" OptionalKey(number(0.5, 0.01, 100.0, "m"), "the dx of a lattice, else 0.5 m");
        /// Width, height and depth of the box about the origin that is told, where no lattice and no flight has one.
        size: [f64; 3] = "size" NumberArray([35.0; 3], number(35.0, 0.5, 1e4, "m"));
    }
    /// A plane through the wind.
    WindSliceKeys at "output.wind.slice" {
        /// Axis that it is across.
        across: SliceAxis = "across" OneOf(SliceAxis::Y);
        /// Where on that axis it lies.
        at: f64 = "at" number(2.0, -1e5, 1e5, "m");
        /// Frames between two files.
        every: u32 = "every" integer(1, 1, 1_000_000);
    }
}
