//! `[catkin]`: the tufts of hairs that carry seeds.

use crate::recipe::syntax::{IntegerList, OneOf, OptionalKey, degrees, integer, number};
use crate::recipe::syntax::{choices, keys};

choices! {
    /// Signs and axes of the random angles of hairs.
    HairAngles {
        /// Hairs bend either way, and are swung round by `spin_deg`.
        Signed = "signed",
        /// As in the paper: one angle tilts and swings, and all hairs bend one way.
        Paper = "paper",
    }
    /// Distribution of the hairs' tilt from the axis of the tuft.
    HairDistribution {
        /// All tilts are equally likely, which makes the middle dense.
        Tilt = "tilt",
        /// All directions are equally likely.
        SolidAngle = "solid_angle",
    }
}

keys! {
    /// Tufts of hairs that carry the seeds of willows and poplars. Without `[flight]` they are placed side by side.
    CatkinKeys at "catkin" {
        /// Length of each of the three sections of a hair.
        section: f64 = "section_m" number(0.0058, 1e-4, 0.1, "m");
        /// Random variation of the length of hairs, as a fraction.
        jitter: f64 = "jitter" number(0.15, 0.0, 0.9, "");
        /// Radius of a hair at its base; larger than in nature by default, so that renderers need fewer samples.
        hair_radius: f64 = "hair_radius_m" number(30e-6, 1e-6, 5e-3, "m");
        /// Radius at the tip divided by that at the base.
        tip: f64 = "tip" number(0.25, 0.0, 1.0, "");
        /// Number of hairs of a tuft.
        hairs: u32 = "hairs" integer(100, 2, 5000), basic;
        /// Largest inclination of a hair to the axis of the tuft.
        fluffiness: Option<f64> = "fluffiness_deg"
            OptionalKey(degrees(60.0, 0.0, 180.0), "25, 25, 60, 105, 105 by variant"), basic;
        /// Largest bend between the sections of a hair.
        bend: Option<f64> = "bend_deg" OptionalKey(degrees(15.0, 0.0, 90.0), "10, 35, 24, 14, 45 by variant");
        /// Largest rotation of a hair about the axis of the tuft.
        spin: f64 = "spin_deg" degrees(180.0, 0.0, 180.0);
        /// Small semi-axis of the stalk; 0 for no stalk.
        stalk_radius: f64 = "stalk_radius_m" number(0.4e-3, 0.0, 0.02, "m");
        /// Number of different tufts; beyond five the variants repeat with other random numbers.
        variants: u32 = "variants" integer(5, 1, 64);
        /// Distribution of angles: with either sign ("signed"), or as printed in the paper.
        angles: HairAngles = "angles" OneOf(HairAngles::Signed);
        /// Distribution of inclinations: uniform in the angle ("tilt") or in the solid angle.
        polar: HairDistribution = "polar" OneOf(HairDistribution::Tilt);
        /// Number of points of a spline along a hair; below 2 keeps three straight sections.
        smooth: u32 = "smooth" integer(0, 0, 16);
        /// Level of detail: 0 hairs as curves (ribbons in formats without curves), 1 tubes, 2 ribbons, 3 a third of the
        /// ribbons, 4 three crossed billboards, 5 one billboard.
        lod: u32 = "lod" integer(0, 0, 5);
        /// Further levels of detail in USD files, as a variant set LOD of each prototype.
        lods: Vec<u32> = "lods" IntegerList(0, 5);
    }
}
