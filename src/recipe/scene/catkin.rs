//! `[catkin]`: the tufts of hairs that carry seeds.

use crate::recipe::syntax::{IntegerList, OneOf, OptionalKey, degrees, integer, number};
use crate::recipe::syntax::{choices, keys};

choices! {
    /// Where the angles of a tuft lie.
    HairAngles {
        /// Hairs bend either way, and are swung round by `spin_deg`.
        Signed = "signed",
        /// As in the paper: one angle tilts and swings, and all hairs bend one way.
        Paper = "paper",
    }
    /// How hairs are spread over their tilts.
    HairDistribution {
        /// Every tilt is as likely: dense in the middle.
        Tilt = "tilt",
        /// Every direction is as likely.
        SolidAngle = "solid_angle",
    }
}

keys! {
    /// The tufts of hairs that carry the seeds of willows and poplars. Without anything that lets them fly they are shown side by
    /// side.
    CatkinKeys at "catkin" {
        /// Length of each of the three sections of a hair.
        section: f64 = "section_m" number(0.0058, 1e-4, 0.1, "m");
        /// By which share hairs are longer or shorter.
        jitter: f64 = "jitter" number(0.15, 0.0, 0.9, "");
        /// Radius of a hair where it begins; wider than life, so that it is met by rays.
        hair_radius: f64 = "hair_radius_m" number(30e-6, 1e-6, 5e-3, "m");
        /// Radius at the tip as a share of that.
        tip: f64 = "tip" number(0.25, 0.0, 1.0, "");
        /// Number of hairs.
        hairs: u32 = "hairs" integer(100, 2, 5000);
        /// Farthest that a hair is tilted from the middle.
        fluffiness: Option<f64> = "fluffiness_deg" OptionalKey(degrees(60.0, 0.0, 180.0), "25, 25, 60, 105, 105 by variant");
        /// Farthest that its second and third sections turn away.
        bend: Option<f64> = "bend_deg" OptionalKey(degrees(15.0, 0.0, 90.0), "10, 35, 24, 14, 45 by variant");
        /// Farthest that it is swung round the middle.
        spin: f64 = "spin_deg" degrees(180.0, 0.0, 180.0);
        /// Small semi-axis of the stalk; 0 = none.
        stalk_radius: f64 = "stalk_radius_m" number(0.4e-3, 0.0, 0.02, "m");
        /// Different tufts; beyond five the list of variants begins again with other draws.
        variants: u32 = "variants" integer(5, 1, 64);
        /// Where the angles lie.
        angles: HairAngles = "angles" OneOf(HairAngles::Signed);
        /// How hairs are spread over their tilts.
        polar: HairDistribution = "polar" OneOf(HairDistribution::Tilt);
        /// Points of a hair smoothed by a spline; 0 leaves its straight sections.
        smooth: u32 = "smooth" integer(0, 0, 16);
        /// How finely tufts are shown: 0 hairs as curves (ribbons where a format has none), 1 tubes, 2 ribbons, 3 a third of
        /// them, 4 pictures on three crossed quads, 5 on one.
        lod: u32 = "lod" integer(0, 0, 5);
        /// Levels that USD files hold beside it, to be chosen by the variant set LOD of each prototype; each makes them larger.
        lods: Vec<u32> = "lods" IntegerList(0, 5);
    }
}
