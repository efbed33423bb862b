//! Keys above the first table, and `[frames]`.

use super::{SeasonSpan, SeasonType};
use crate::recipe::syntax::{FrameRate, OptionalKey, SeedType, StringType, integer, number};
use crate::recipe::syntax::{choices, keys};

choices! {
    /// Axis that points up in an imported or exported file.
    UpAxis {
        /// Y is up, as in glTF.
        Y = "y",
        /// Z is up, as in Blender.
        Z = "z",
    }
}

keys! {
    /// The scene itself (keys above the first table).
    SceneKeys at "" {
        /// Shown in files and listings.
        title: String = "title" StringType("");
        /// Seed of all random numbers; another integer gives another individual.
        seed: u64 = "seed" SeedType(1), basic;
        /// Time of the growing year of all plants that have no `season` of their own.
        season: Option<SeasonSpan> = "season" OptionalKey(SeasonType, "summer leaves");
        /// Geographic latitude of all plants that have no `latitude` of their own; negative in the south.
        latitude: Option<f64> = "latitude" OptionalKey(number(50.0, -90.0, 90.0, "deg"), "that of a species' site, 50");
    }
    /// Frame range and frame rate of the clip.
    FramesKeys at "frames" {
        /// First frame of the clip.
        start: u32 = "start" integer(1, 0, 999_999);
        /// Last frame; without it the scene has one frame and does not move.
        end: Option<u32> = "end" OptionalKey(integer(1, 0, 999_999), "start"), basic;
        /// Frame rate in frames per second.
        fps: (u32, u32) = "fps" FrameRate, basic;
    }
}
