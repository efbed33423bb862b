//! `[output.wind]`: files of the wind field.

use crate::recipe::syntax::{NumberArray, OneOf, OptionalKey, integer, number};
use crate::recipe::syntax::{choices, keys};

choices! {
    /// Axis normal to a plane.
    SliceAxis {
        /// X, to the east.
        X = "x",
        /// Y, upwards.
        Y = "y",
        /// Z, to the south.
        Z = "z",
    }
}

keys! {
    /// Wind velocities as files in `wind/`: a plane per `[[output.wind.slice]]` as EXR, volumes as VTI. For any wind; clips
    /// only.
    WindOutputKeys at "output.wind" {
        /// Frames between two volumes.
        vti_every: Option<u32> = "vti_every" OptionalKey(integer(1, 1, 1_000_000), "no volumes");
        /// Side length of texels and cells.
        texel: Option<f64> = "texel" OptionalKey(number(0.5, 0.01, 100.0, "m"), "dx of a lattice, else 0.5 m");
        /// Width, height and depth of the domain about the origin, without a lattice or a flight.
        size: [f64; 3] = "size" NumberArray([35.0; 3], number(35.0, 0.5, 1e4, "m"));
    }
    /// Plane on which wind velocities are written as EXR files.
    WindSliceKeys at "output.wind.slice" as list {
        /// Axis normal to the plane.
        across: SliceAxis = "across" OneOf(SliceAxis::Y);
        /// Position on that axis.
        at: f64 = "at" number(2.0, -1e5, 1e5, "m");
        /// Frames between two files.
        every: u32 = "every" integer(1, 1, 1_000_000);
    }
}
