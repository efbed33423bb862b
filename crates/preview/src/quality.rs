//! How much work goes into a picture: every choice between speed and looks in one place.

use super::light::LightDepth;

/// How much work goes into a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Quality {
    /// One sample a pixel, projected instead of traced: to judge the shape.
    Draft,
    /// For contact sheets and everyday use.
    Normal,
    /// For final pictures: up to 192 samples a pixel.
    Fine,
}

impl Quality {
    /// Samples for every pixel of a dense_foliage picture on average: what covers little may have more.
    pub(super) fn budget(self) -> f32 {
        match self {
            Self::Draft => 1.0,
            Self::Normal => 2.0,
            Self::Fine => f32::INFINITY,
        }
    }

    /// Fewest and most samples a pixel, and the disagreement of shown values that asks for more.
    pub(super) fn samples(self) -> (u32, u32, f32) {
        match self {
            Self::Draft => (1, 1, 1.0),
            Self::Normal => (3, 24, 0.05),
            Self::Fine => (32, 192, 0.008),
        }
    }

    /// True where looks are so few that in a crowd of leaves a pixel's light from around is taken from its neighbours' as well.
    pub(super) fn smooths(self) -> bool {
        self == Self::Normal
    }

    pub(super) fn light_depth(self) -> LightDepth {
        match self {
            Self::Draft => LightDepth::Sun,
            Self::Normal => LightDepth::Sky,
            Self::Fine => LightDepth::Around,
        }
    }

    /// Smallest detail of a leaf that is drawn, pixels; 0 for every one.
    pub(super) fn grain(self) -> f32 {
        match self {
            Self::Draft => 1.5,
            Self::Normal => 0.75,
            Self::Fine => 0.0,
        }
    }

    /// Widest picture on a surface that is read in full, pixels.
    pub fn texture_side(self) -> u32 {
        match self {
            Self::Draft => 128,
            Self::Normal => 512,
            Self::Fine => 4096,
        }
    }

    /// True where a second of waiting for a smaller file is too long.
    pub fn hurries(self) -> bool {
        self == Self::Draft
    }
}
