//! Numbers of the sway that were chosen by judgement or by trial, with the effect of changing them.

/// Lower bound of natural frequencies, Hz: for lower ones, spin-up would last minutes.
pub(crate) const MIN_HZ: f64 = 0.1;

/// Relative spread of frequencies between equal branches, and between the two bending directions of one. 0:
/// neighbours sway in unison; higher: twins look unlike.
pub(crate) const FREQUENCY_SPREAD: f64 = 0.18;
pub(crate) const MODE_SPLIT: f64 = 0.03;

/// Slope of the tip of a branch under its weight above which its wood is stiffened, and the exponent e of the factor (slope /
/// limit)^e on the stiffness. Higher slope or lower exponent: long thin limbs swing slowly and far beside neighbours that are
/// drawn slightly thicker; lower slope: nothing bends in a breeze; exponent 1: all thin wood bends alike.
pub(crate) const SELF_WEIGHT_SLOPE: f64 = 0.02;
pub(crate) const SELF_WEIGHT_STIFFENING: f64 = 2.0 / 3.0;

/// Slope of the tip of a branch under a dynamic pressure of 1 Pa, rad/Pa, above which its wood is stiffened: 0.28 rad in a fresh
/// breeze of 10 m/s (61 Pa), about the median of boughs and twigs of the species that grow year by year. And the exponent e of
/// the factor (slope / limit)^e on the stiffness. Higher slope or lower exponent: single thin boughs swing far beside quiet ones
/// of their length; lower slope: nothing bends in a breeze; exponent 1: all thin wood bends alike.
pub(crate) const WIND_SLOPE: f64 = 4.5e-3;
pub(crate) const WIND_STIFFENING: f64 = 0.9;

/// Share by which the wind is weaker at the centre of a crown. Higher: inner branches do not move; 0: crowns move like bare
/// branches.
pub(crate) const CROWN_SHELTER: f64 = 0.6;

/// Radius at the end of a segment divided by the radius at its start. Higher: more, shorter elements.
pub(crate) const SEGMENT_RADIUS_RATIO: f32 = 0.25;

/// Segments per axis, at most. More: more elements for bends that the slope profile already gives.
pub(crate) const MAX_SEGMENTS_PER_AXIS: u32 = 3;

/// Least length of a segment, as a fraction of the length of its axis. Smaller: stubs of segments at abrupt tapers.
pub(crate) const MIN_SEGMENT_SHARE: f32 = 0.05;

/// Stations of the beam of a limb, and of a twig, whose bend is hardly visible. Fewer: frequencies
/// of tapered wood are off by more than a percent.
pub(crate) const LIMB_STATIONS: usize = 32;
pub(crate) const TWIG_STATIONS: usize = 16;

/// Young's modulus, Pa, and radius, m, of thick and of thin wood; smooth in between.
pub(crate) const THICK_WOOD: (f64, f64) = (8.0e9, 0.05);
pub(crate) const THIN_WOOD: (f64, f64) = (5.0e9, 0.005);

/// Least mass of leaves that swing by themselves, per one-sided area, kg/m^2. Own: a tenth of a thin leaf's. Lower: steps must be
/// shorter; higher: thin leaves are too slow.
pub(crate) const MIN_MOVING_LEAF_MASS: f64 = 0.01;

/// Time steps per second, at least: a tenth of the period of visible modes.
pub(crate) const STEPS_PER_SECOND: f64 = 120.0;

/// Wind samples per second, at least, with linear interpolation between them. Fewer: leaves of a crown miss short gusts; more:
/// the wind becomes the main cost.
pub(crate) const WIND_SAMPLES_PER_SECOND: f64 = 24.0;

/// Vortex-shedding force divided by the drag, per unit of flicker. Higher: branches oscillate across the wind as much as along
/// it.
pub(crate) const VORTEX_FORCE: f64 = 2.0;

/// Upper bound of flicker frequencies, Hz: faster motion aliases at 24 frames per second.
pub(crate) const MAX_FLICKER_HZ: f64 = 3.0;

/// Damping ratio of the second mode divided by that of the first. Lower: limbs oscillate for long after a gust.
pub(crate) const SECOND_MODE_DAMPING: f64 = 1.5;

/// Largest ratio of the amplitude of a branch to that of the carrier that shakes it at its natural frequency. The model neglects
/// the force of a swinging branch on its carrier, which damps both; without a limit, branches of three orders and similar
/// frequencies amplify each other's swing until they circle without a gust. Higher: single boughs swing far beside quiet ones;
/// lower: twigs do not lag behind their limb.
pub(crate) const MAX_RESONANCE_GAIN: f64 = 1.5;

/// Limit of the inertial acceleration, m/s^2: a jolt must not throw twigs.
pub(crate) const MAX_INERTIAL_ACCELERATION: f64 = 50.0;

/// Share of the load's deviation from its mean that excites second modes. Higher: limbs
/// look like whips.
pub(crate) const SECOND_MODE_FORCING: f64 = 0.15;

/// Largest number of repetitions of a looping clip that are simulated as spin-up: in them the effect of the start has decayed for
/// a trunk of 0.3 Hz in a clip of 2 s. More: only slower trunks gain.
pub(crate) const MAX_SPIN_UP_CLIPS: u32 = 40;

/// Largest difference of bends between two repetitions of a clip that counts as periodic, rad; it is distributed over the loop.
/// Higher: the motion jumps at the seam; lower: slow trunks take many repetitions.
pub(crate) const LOOP_TOLERANCE: f64 = 1e-4;

/// Spin-up time of a clip that does not loop, s: a few periods of a slow trunk. Shorter: the first frames show the start.
pub const SPIN_UP_SECONDS: f64 = 5.0;

/// Time between two static bends in a mean wind that changes, s, with linear interpolation between them. Longer: the lean lags
/// behind sudden changes of the wind; shorter: static bends cost as much as the simulation itself.
pub(crate) const MEAN_INTERVAL: f64 = 0.25;

/// Least damping ratio in the rate at which the mean bend sets in, if a clip starts from rest: that of wood. Lower: branches of
/// little damping take on the scaled mean bend late.
pub(crate) const MIN_ONSET_DAMPING: f64 = 0.05;

/// Limit of recorded bends, rad, approached by a hyperbolic tangent. Larger: branches fold back on
/// themselves in storms.
pub(crate) const MAX_BEND: f32 = 1.4;

/// Bark within this many radii of a fork follows the parent axis. Larger: thick collars; smaller: the bark
/// tears.
pub(crate) const COLLAR_RADII: f32 = 1.5;

/// A branch this many times as long as the longest branch without joints bends as simulated; shorter ones bend by a decreasing
/// share. Lower: branches that bend are next to rigid ones of nearly their length; higher: more branches bend less than
/// simulated.
pub(crate) const JOINT_FADE: f32 = 1.5;

/// Ratio of two successive lengths among sorted branches, from which the longer ones are a separate class that needs no
/// fading. Lower: accidental gaps between lengths count as classes.
pub(crate) const CLASS_GAP: f32 = 1.25;

/// Largest distance, m, between a leaf and its place on the bark as joints move it, approached by a hyperbolic tangent: about the
/// length of its stalk. Larger: leaves float beside twigs that have no joints; smaller: leaves of such twigs do not move.
pub(crate) const MAX_LEAF_OFFSET: f32 = 0.02;

/// Bark points per task: enough work to outweigh the scheduling.
pub(crate) const POINTS_PER_TASK: usize = 4096;

/// Largest flutter angles, rad: about the width of the blade, about its normal, about its midrib. Source: own, by eye
/// on a beech; [zhao-zhang] 3.3 does not give them.
pub(crate) const MAX_NOD: f32 = 0.611;
pub(crate) const MAX_YAW: f32 = 0.436;
pub(crate) const MAX_TWIST: f32 = 0.785;

/// Twist that accompanies a nod: lambda as printed.
pub(crate) const TWIST_PER_NOD: f32 = 0.4;

/// Wind speed, m/s, at which flutter reaches 1 - 1/e of its amplitude. Lower: leaves tremble in light air.
pub(crate) const FLUTTER_SPEED: f32 = 4.0;

/// Factor on the angle by which a leaf aligns with the flow; in a storm a leaf turns by up to pi/2 times it, rad. Higher: crowns
/// show the undersides of their leaves in any wind.
pub(crate) const FLOW_ALIGNMENT: f32 = 0.6;

/// Lag time of a leaf behind its twig, s, and the largest angle of lag, rad. Larger: leaves trail
/// like cloth.
pub(crate) const LAG_TIME: f32 = 0.06;
pub(crate) const MAX_LAG: f32 = 0.349;

/// Sway weight at the tip of an axis whose carrier has the weight 0.
pub(crate) const TIP_SWAY_SHARE: f32 = 0.5;
