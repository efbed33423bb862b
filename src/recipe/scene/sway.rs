//! `[sway]`: model and loop of the plants' sway.

use crate::recipe::syntax::{BooleanType, ListOf, OneOf, OptionalKey, integer, number};
use crate::recipe::syntax::{choices, keys};

choices! {
    /// Equations of the bending of branches.
    SwayModel {
        /// Damped beams with the forces and natural frequencies of wood.
        Beam = "beam",
        /// Equations of the paper by Zhao and Zhang, with one cantilever per internode.
        Paper = "paper",
    }
    /// Correction of an error in the equations of the paper by Zhao and Zhang.
    PaperFix {
        /// The fourth power of the radius instead of the third.
        Radius = "radius4",
        /// The density of air instead of 1/500,000 of it.
        Air = "air_density",
        /// Damping against the direction of motion instead of one fixed sign.
        Damping = "damping_sign",
    }
    /// Slope of a bent branch along its length.
    BendProfile {
        /// That of a uniform rod under a uniform load.
        Uniform = "uniform",
        /// From the measured taper and load: thin ends bend more.
        Measured = "measured",
    }
    /// State at the first frame of a clip without a loop.
    SwayStart {
        /// Already moving, after a spin-up in the wind.
        Moving = "moving",
        /// At rest, without deflection.
        Rest = "rest",
    }
}

keys! {
    /// Motion of plants in the wind.
    SwayKeys at "sway" {
        /// Equations of motion: elastic beams, or those of the paper.
        model: SwayModel = "model" OneOf(SwayModel::Beam);
        /// With "paper": misprints that are corrected; with [] no motion is visible.
        fixes: Vec<PaperFix> = "paper_fixes" ListOf(&[PaperFix::Radius, PaperFix::Air, PaperFix::Damping]);
        /// With "paper": fraction of the last force that is subtracted.
        recoil: f64 = "paper_recoil" number(0.3, 0.0, 0.999, "");
        /// With "paper": damping coefficient of the squared angular velocity.
        paper_damping: f64 = "paper_damping" number(0.01, 0.0, 1000.0, "N s^2");
        /// Factor on the oscillation; 1 is realistic, 3 to 10 is visible from a distance.
        exaggerate: f64 = "exaggerate" number(1.0, 0.0, 20.0, ""), basic;
        /// Factor on the mean deflection.
        lean: f64 = "lean" number(1.0, 0.0, 5.0, ""), basic;
        /// Factor on the lag of twigs behind their branch.
        whip: f64 = "whip" number(1.0, 0.0, 3.0, "");
        /// Number of bending modes of trunks and limbs; the second has 6.27 times the frequency.
        modes: u32 = "modes" integer(1, 1, 2);
        /// Deflection shape along a branch: the same for all ("uniform"), or from taper and load ("measured").
        profile: BendProfile = "profile" OneOf(BendProfile::Uniform);
        /// Whether the weight of a deflected branch acts in its new direction.
        gravity: bool = "gravity_change" BooleanType(false);
        /// Period of the wind and the motion, rounded to frames.
        loop_duration: Option<f64> = "loop" OptionalKey(number(4.0, 2.0, 3600.0, "s"), "the clip, if it loops"), basic;
        /// Whether the clip loops: the frame after the last equals the first. All that reads the wind reads a wind that loops.
        repeat: Option<bool> = "repeat" OptionalKey(BooleanType(true), "true for clips of 2 s and more without [flight]");
        /// Number of time offsets of copies of a plant, by which gusts reach them at different times; 1 moves all copies in
        /// step.
        phases: u32 = "phases" integer(12, 1, 1000);
        /// State at the start of a clip that does not loop: after a spin-up ("moving"), or at rest.
        start: SwayStart = "start" OneOf(SwayStart::Moving);
    }
}
