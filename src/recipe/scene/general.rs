//! Keys above the first table, and `[frames]`.

use crate::recipe::syntax::{FrameRate, OptionalKey, SeedType, StringType, integer};
use crate::recipe::syntax::{choices, keys};

choices! {
    /// An upward axis.
    UpAxis {
        /// Y, as glTF.
        Y = "y",
        /// Z, as Blender.
        Z = "z",
    }
}

keys! {
    /// The scene itself (keys above the first table).
    SceneKeys at "" {
        /// Shown in files and listings.
        title: String = "title" StringType("");
        /// Start of every random draw; each whole number is another individual.
        seed: u64 = "seed" SeedType(1);
    }
    /// Which frames there are.
    FramesKeys at "frames" {
        /// First frame.
        start: u32 = "start" integer(1, 0, 999_999);
        /// Last frame; without it the scene stands still.
        end: Option<u32> = "end" OptionalKey(integer(1, 0, 999_999), "start");
        /// Frames per second.
        fps: (u32, u32) = "fps" FrameRate;
    }
}
