//! Numbers of the analytic and the looped winds that were chosen by judgement, with what changes when they move.

/// Lowest height of the wind profile, m: nearer the ground a power law would fall to 0, where there is grass instead.
/// Lower: plants of a few decimetres hardly move.
pub(super) const MIN_PROFILE_HEIGHT: f32 = 0.5;

/// Largest eddy velocity divided by the root mean square of the noise. Higher: rare single jerks; lower: turbulence
/// loses its peaks.
pub(super) const MAX_EDDY: f32 = 2.5;
/// Vertical eddy velocity divided by that along the wind. Near the ground of the atmosphere the standard deviations of
/// the components along, across and up are about as 1 : 0.8 : 0.5.
pub(super) const VERTICAL_EDDY: f32 = 0.5;
/// Eddy velocity across the wind divided by that along it, as [`VERTICAL_EDDY`].
pub(super) const LATERAL_EDDY: f32 = 0.7;
/// Width of a gust divided by its length. Smaller: neighbouring plants sway out of step; larger: gusts are endless
/// fronts.
pub(super) const GUST_WIDTH: f64 = 2.0;
/// Correlation time of the wind's direction, s. Shorter: the direction flutters; longer: it seems constant in a clip.
pub(super) const WANDER_TIME: f64 = 12.0;
/// Noise cells per period of a repeating wind, at least. Fewer: a viewer notices that the same gust comes back.
pub(super) const MIN_CELLS_PER_PERIOD: f64 = 4.0;

/// Frequency of the first octave of the sine wind's noise, Hz. Higher: leaves tremble; lower: the sine alone is seen.
pub(super) const SINE_NOISE_FREQUENCY: f64 = 2.0;
/// Amplitude of the sine wind's noise divided by its mean speed; the noise that [zhao-zhang] prints has 4 m/s whatever
/// the mean.
pub(super) const SINE_NOISE_STRENGTH: f32 = 0.4;
/// Octaves of the sine wind's noise, each with half the amplitude of the one before. More: no visible effect on a
/// plant.
pub(super) const SINE_NOISE_OCTAVES: u32 = 3;
/// Least speed, m/s, at which the waves of the sine wind travel; below it the delay between two plants grows without bound.
pub(super) const MIN_TRAVEL_SPEED: f64 = 0.5;

/// Cross-fade at the end of a wind that is made to repeat, s: as long as an eddy of a few metres lives.
pub(super) const LOOP_FADE: f64 = 2.0;
