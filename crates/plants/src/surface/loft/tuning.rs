//! Constants of the loft that no source gives, chosen by eye on the presets. Lengths are in radii of the tube unless a unit is given.

/// Axes planned as one task: few enough that their rings fit into memory that the allocator keeps. No effect on the result.
pub(super) const AXES_PER_TASK: usize = 64;
/// Points filled as one task. No effect on the result.
pub(super) const POINTS_PER_TASK: u32 = 1 << 16;

/// Tips of a smaller radius end in one vertex instead of a dome, m: a dome of 3 mm is not seen.
pub(super) const POINTED_TIP_RADIUS: f32 = 0.003;

/// A ring is left out while the radius changes by less than this share; smaller values give more rings on tapering axes.
pub(super) const TAPER: f32 = 0.1;
/// Greatest distance of two rings, in radii; beyond it quads become slivers.
pub(super) const MAX_SPACING: f32 = 12.0;
/// A ring is left out only while the tube stays nearer to the centreline than this share of its radius, so that branches and
/// leaves touch its surface.
pub(super) const SAG: f32 = 0.15;
/// A ring is left out only while a tube that tapers linearly over the gap deviates from the axis' radii by less than this share.
pub(super) const SWELL: f32 = 0.1;
/// Rings nearer than this many radii to the previous one are dropped, except for the last ring.
pub(super) const MIN_SPACING: f32 = 0.25;
/// Sweeps along the axis, forth and back, that tilt crossing rings apart.
pub(super) const TILT_PASSES: usize = 4;
/// The lean of two neighbouring rings together is at most this share of their distance.
pub(super) const MAX_LEAN: f32 = 0.85;

/// A corner is tight when a curve through it has less than this many radii to bend in.
pub(super) const TIGHT: f32 = 1.7;
/// A corner is kept as a corner, even with space for a curve, when the squared tangent of half its angle is above this: 58 degrees.
pub(super) const SHARP: f32 = 0.3073;
/// Radius of a fillet arc, in radii of the tube.
pub(super) const FILLET_RADIUS: f32 = 1.1;
/// Least radius of a fillet arc: below about 1 the rings meet on its inner side.
pub(super) const MIN_FILLET_RADIUS: f32 = 1.04;

/// A branch continues its parent's tip with shared points only if the cosine between both directions is at least this (80 degrees).
pub(super) const MIN_CONTINUATION_COSINE: f32 = 0.17;
/// A child that is not the thickest at the tip continues it only if its radius exceeds this share of the parent's.
pub(super) const MIN_CONTINUATION_RADIUS: f32 = 0.45;
/// A branch gets a junction only if the sine of its angle to the parent is at least this (11.5 degrees).
pub(super) const MIN_JUNCTION_SINE: f32 = 0.2;
/// The same for the straightened line of the junction, squared.
pub(super) const MIN_JUNCTION_SINE_SQUARED: f32 = 0.04;
/// A branch gets a junction only if the cosine between the junction's line and the branch beyond it exceeds this (53 degrees).
pub(super) const MIN_JUNCTION_STRAIGHTNESS: f32 = 0.6;
