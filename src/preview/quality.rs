//! How much work goes into a picture: every choice between speed and looks in one place.

use super::light::Care;

/// Looks that a draft takes.
const DRAFT_LOOKS: u64 = 400_000;

/// How much work goes into a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Quality {
    /// One look a pixel, or fewer in large pictures: to see the shape.
    Draft,
    /// For contact sheets and everyday use.
    Normal,
    /// For keeping.
    Fine,
}

impl Quality {
    /// Samples for every pixel of a crowded picture on average: what covers little may have more.
    pub(super) fn budget(self) -> f32 {
        match self {
            Self::Draft => 1.0,
            Self::Normal => 3.0,
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

    pub(super) fn care(self) -> Care {
        match self {
            Self::Draft => Care::Sun,
            Self::Normal => Care::Sky,
            Self::Fine => Care::Around,
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

    /// How well boxes are sorted, for up to so many primitives each: few are sorted in no time and met by many rays.
    pub(super) fn sorting(self) -> [usize; 3] {
        match self {
            Self::Draft => [1_000, 2_000, 200_000],
            Self::Normal | Self::Fine => [4_000, 400_000, 1_500_000],
        }
    }

    /// Triangles of a large mesh that share a box.
    pub(super) fn run(self) -> usize {
        match self {
            Self::Draft => 3,
            Self::Normal | Self::Fine => 1,
        }
    }

    /// True if only one pixel of four has a look of its own: in drafts with more pixels than there is time for.
    pub(super) fn is_sparse(self, [width, height]: [u32; 2]) -> bool {
        self == Self::Draft && u64::from(width) * u64::from(height) > DRAFT_LOOKS
    }

    /// True where a second of waiting for a smaller file is too long.
    pub fn hurries(self) -> bool {
        self == Self::Draft
    }
}
