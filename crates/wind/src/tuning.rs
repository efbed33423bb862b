//! Parameters of the analytic and the looped winds that were chosen by judgement, with the effects of other values.

/// Lowest height of the wind profile, m: nearer to the ground a power law would decrease to 0, although there is grass. Lower:
/// plants of a few decimetres hardly move.
pub(super) const MIN_PROFILE_HEIGHT: f32 = 0.5;

/// Largest eddy velocity divided by the root mean square of the noise. Higher: rare single jerks; lower: turbulence loses its
/// peaks.
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
/// Least number of noise cells per period of a repeating wind. Fewer: a viewer notices that the same gust returns.
pub(super) const MIN_CELLS_PER_PERIOD: f64 = 4.0;

/// Frequency of the first octave of the sine wind's noise, Hz. Higher: leaves tremble; lower: only the sine is visible.
pub(super) const SINE_NOISE_FREQUENCY: f64 = 2.0;
/// Amplitude of the sine wind's noise divided by its mean speed; the printed noise of [zhao-zhang] has 4 m/s at any mean speed.
pub(super) const SINE_NOISE_STRENGTH: f32 = 0.4;
/// Number of octaves of the sine wind's noise, each with half the amplitude of the previous one. More: no visible effect on a
/// plant.
pub(super) const SINE_NOISE_OCTAVES: u32 = 3;
/// Least speed, m/s, at which the waves of the sine wind travel; below it the delay between two plants grows without bound.
pub(super) const MIN_TRAVEL_SPEED: f64 = 0.5;

/// Duration of the cross-fade at the end of a wind that is made periodic, s: the lifetime of an eddy of a few metres.
pub(super) const LOOP_FADE: f64 = 2.0;
