//! Quality levels: every trade-off between speed and noise in one place.

/// Trade-off between the speed of rendering and the noise of the picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Quality {
    /// One sample per pixel, rasterised instead of traced, with sunlight and shadows: to judge shapes.
    Draft,
    /// Ray traced with 3 to 24 samples per pixel: for contact sheets and everyday use.
    Normal,
    /// Ray traced with 32 to 192 samples per pixel and one more bounce: for final pictures.
    Fine,
}

/// Which occluders and bounces of light are traced from a surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum LightDepth {
    /// The sun with its shadows, and the sky without occluders.
    Sun,
    /// Also occluders of the sky, with a mean brightness.
    Sky,
    /// Also the light that reaches those occluders.
    Surroundings,
}

/// Numbers of samples in adaptive sampling, and the noise at which it stops.
#[derive(Debug, Clone, Copy)]
pub(super) struct SampleRange {
    /// Samples that every pixel takes.
    pub(super) min: u32,
    /// Samples at which even the noisiest pixel stops.
    pub(super) max: u32,
    /// Difference in displayed brightness (0 to 1, gamma 2) between even and odd samples above which a pixel takes
    /// more.
    pub(super) tolerance: f32,
}

impl Quality {
    /// Samples per pixel on average over a picture of dense foliage; a subject that covers less of the picture may
    /// have more.
    pub(super) fn mean_samples(self) -> f32 {
        match self {
            Self::Draft => 1.0,
            Self::Normal => 2.0,
            Self::Fine => f32::INFINITY,
        }
    }

    pub(super) fn sample_range(self) -> SampleRange {
        match self {
            Self::Draft => SampleRange { min: 1, max: 1, tolerance: 1.0 },
            Self::Normal => SampleRange { min: 3, max: 24, tolerance: 0.05 },
            Self::Fine => SampleRange { min: 32, max: 192, tolerance: 0.008 },
        }
    }

    /// True where samples are so few that pixels of dense foliage share their ambient light.
    pub(super) fn shares_ambient_light(self) -> bool {
        self == Self::Normal
    }

    pub(super) fn light_depth(self) -> LightDepth {
        match self {
            Self::Draft => LightDepth::Sun,
            Self::Normal => LightDepth::Sky,
            Self::Fine => LightDepth::Surroundings,
        }
    }

    /// Width of the smallest detail of an instanced mesh that is drawn, pixels; 0 draws every one.
    pub(super) fn smallest_detail(self) -> f32 {
        match self {
            Self::Draft => 1.5,
            Self::Normal => 0.75,
            Self::Fine => 0.0,
        }
    }

    /// Side of the largest texture that is read in full, texels.
    pub fn texture_side(self) -> u32 {
        match self {
            Self::Draft => 128,
            Self::Normal => 512,
            Self::Fine => 4096,
        }
    }

    /// True where files are compressed for speed rather than for size.
    pub fn prefers_speed(self) -> bool {
        self == Self::Draft
    }
}
