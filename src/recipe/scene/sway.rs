//! `[sway]`: how plants answer the wind.

use crate::recipe::syntax::{BooleanType, ListOf, OneOf, OptionalKey, integer, number};
use crate::recipe::syntax::{choices, keys};

choices! {
    /// By which equations branches bend.
    SwayModel {
        /// Beams that swing: forces, frequencies and damping of wood.
        Beam = "beam",
        /// Those of the paper by Zhao and Zhang, one cantilever for an internode.
        Paper = "paper",
    }
    /// What is mended in the paper's equations.
    PaperFix {
        /// The fourth power of the radius instead of the third.
        Radius = "radius4",
        /// The density of air instead of a five hundred thousandth of it.
        Air = "air_density",
        /// Damping against the motion instead of always one way.
        Damping = "damping_sign",
    }
    /// How the slope of a bent branch grows along it.
    BendProfile {
        /// As of an even rod in an even wind.
        Uniform = "uniform",
        /// As its own taper and load have it: thin ends bend more.
        Measured = "measured",
    }
    /// How a clip that does not repeat begins.
    SwayStart {
        /// In the middle of the wind.
        Moving = "moving",
        /// From rest.
        Rest = "rest",
    }
}

keys! {
    /// How plants answer the wind.
    SwayKeys at "sway" {
        /// By which equations.
        model: SwayModel = "model" OneOf(SwayModel::Beam);
        /// With "paper": what is mended; [] for nothing, and then nothing is seen to move.
        fixes: Vec<PaperFix> = "paper_fixes" ListOf(&[PaperFix::Radius, PaperFix::Air, PaperFix::Damping]);
        /// With "paper": share of the last force that is taken back.
        recoil: f64 = "paper_recoil" number(0.3, 0.0, 0.999, "");
        /// With "paper": damping for the square of the turning rate.
        paper_damping: f64 = "paper_damping" number(0.01, 0.0, 1000.0, "N s^2");
        /// Factor on the swings; 1 is honest, 3 to 10 is usual where a tree shall look alive from afar.
        exaggerate: f64 = "exaggerate" number(1.0, 0.0, 20.0, "");
        /// Factor on the steady lean.
        lean: f64 = "lean" number(1.0, 0.0, 5.0, "");
        /// Factor on how twigs lag behind the branch that throws them.
        whip: f64 = "whip" number(1.0, 0.0, 3.0, "");
        /// Trunks and limbs also swing in their second mode: a tremor in gusts, 6.27 times as fast.
        modes: u32 = "modes" integer(1, 1, 2);
        /// How bends grow along a branch.
        profile: BendProfile = "profile" OneOf(BendProfile::Uniform);
        /// A branch that others lean over presses on them with its weight in its new direction.
        gravity: bool = "gravity_change" BooleanType(false);
        /// The motion repeats after so many seconds, rounded to frames, however long the clip is.
        loop_duration: Option<f64> = "loop" OptionalKey(number(4.0, 2.0, 3600.0, "s"), "the whole clip, if it repeats");
        /// Whether the frame after the last is the first.
        repeat: Option<bool> = "repeat" OptionalKey(BooleanType(true), "true for clips of 2 s and more");
        /// Copies of a plant show a repeating motion at so many different times, as gusts reach them; 1 for all as one.
        phases: u32 = "phases" integer(12, 1, 1000);
        /// How a clip that does not repeat begins.
        start: SwayStart = "start" OneOf(SwayStart::Moving);
    }
}
