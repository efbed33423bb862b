//! Constants of the loft that no source gives, chosen by eye on the presets. Lengths are in radii of the tube unless a unit is
//! given.

/// Axes planned as one task: few enough that the allocator reuses their memory, many enough to spread over threads. No effect on
/// the result.
pub(super) const AXES_PER_TASK: usize = 64;
/// Points filled as one task, in whole tubes: some megabytes, so that handing out tasks costs little. No effect on the result.
pub(super) const POINTS_PER_TASK: u32 = 1 << 16;

/// Tips of a smaller radius end in one vertex instead of a dome, m: a dome of 3 mm is not visible on a whole plant.
pub(super) const POINTED_TIP_RADIUS: f32 = 0.003;

/// A ring is left out while the radius changes by less than this share; smaller values give more rings on tapering axes.
pub(super) const RADIUS_TOLERANCE: f32 = 0.1;
/// Greatest distance of two rings, in radii; beyond it quads become slivers.
pub(super) const MAX_RING_SPACING: f32 = 12.0;
/// A ring is left out only while the tube stays nearer to the centreline than this share of its radius, so that branches and
/// leaves touch its surface.
pub(super) const SAG_TOLERANCE: f32 = 0.15;
/// A ring is left out only while a tube that tapers linearly over the gap deviates from the axis' radii by less than this share.
pub(super) const SWELL_TOLERANCE: f32 = 0.1;
/// Rings nearer than this many radii to the previous one are dropped, except for the last ring.
pub(super) const MIN_RING_SPACING: f32 = 0.25;
/// Sweeps along the axis, forth and back, that tilt crossing rings apart; rings that still cross afterwards are removed.
pub(super) const TILT_PASSES: usize = 4;
/// The lean of two neighbouring rings together is at most this share of their distance; at 1 they touch.
pub(super) const MAX_LEAN_SHARE: f32 = 0.85;

/// A corner is tight when the tangent length of a curve through it is less than this many radii: the inner side of the tube
/// would fold.
pub(super) const TIGHT_CORNER_RADII: f32 = 1.7;
/// A corner is kept as a corner, even with space for a curve, when the squared tangent of half its angle is above this: 58
/// degrees.
pub(super) const SHARP_CORNER_TAN2: f32 = 0.3073;
/// Radius of a fillet arc, in radii of the tube, where the segments are long enough.
pub(super) const FILLET_RADIUS: f32 = 1.1;
/// Cosine of the angle, 150 degrees, beyond which a corner turns back and has no fillet: the arc would cut more than three radii
/// off its end, and all of both segments at 180 degrees.
pub(super) const HAIRPIN_COSINE: f32 = -0.866;
/// Squared length of the sum of two unit vectors below which they count as opposite: 179.94 degrees. With a larger
/// value the tangents of sharp corners jump; with a smaller one rounding decides their direction.
pub(super) const TURN_BACK_SUM_SQUARED: f32 = 1e-6;
/// Least radius of a fillet arc: below about 1 the rings meet on its inner side.
pub(super) const MIN_FILLET_RADIUS: f32 = 1.04;

/// A branch continues its parent's tip with shared points only if the cosine between both directions is at least this (80
/// degrees).
pub(super) const MIN_CONTINUATION_COSINE: f32 = 0.17;
/// A child that is not the thickest at the tip continues it only if its radius exceeds this share of the parent's.
pub(super) const MIN_CONTINUATION_RADIUS: f32 = 0.45;
/// Largest distance of the nearest side of a branch from its parent's centreline where it leaves the parent's surface, in
/// radii of the parent; a branch beyond it begins on the centreline, without a junction. A value of 1 would be the surface
/// itself, from which polygons deviate.
pub(super) const MAX_JUNCTION_DISTANCE: f32 = 1.1;
/// A branch gets a junction only if the sine of its angle to the parent is at least this (11.5 degrees).
pub(super) const MIN_JUNCTION_SINE: f32 = 0.2;
/// Square of the least sine between the straightened line of the junction and the parent.
pub(super) const MIN_JUNCTION_SINE_SQUARED: f32 = 0.04;
/// A branch gets a junction only if the cosine between the junction's line and the branch beyond it exceeds this (53 degrees).
pub(super) const MIN_JUNCTION_STRAIGHTNESS: f32 = 0.6;

/// Centrelines of trunks with a flare of [`FLARE_SAMPLE_HEIGHT`] are sampled at these arc lengths, in base radii, those of others at
/// as many heights of their flare: the exponential has decayed to 3.6 % at the last one.
pub(super) const FLARE_SAMPLES: [f32; 8] = [0.6, 1.2, 1.8, 2.5, 3.5, 5.0, 7.0, 10.0];
/// Height of the flare to which the samples belong, in base radii.
pub(super) const FLARE_SAMPLE_HEIGHT: f32 = 3.0;
/// A sample is left out if the axis has a node within this distance, in the unit of the samples.
pub(super) const FLARE_SAMPLE_SPACING: f32 = 0.3;
/// Number of sides that each ridge of a flare needs. With fewer sides ridges would be single corners; the flare then
/// stays round.
pub(super) const SIDES_OF_RIDGE: u32 = 4;
/// How far the widening of a flare varies around the trunk, as a share of its mean: at 1 the trunk would be as narrow between two
/// roots as it is above them.
pub(super) const RIDGE_CONTRAST: f32 = 0.7;
/// Sharpness of a ridge, the exponent of exp(k (cos - 1)), for each ridge of the flare: at 1.2 ridges of one flare just merge.
pub(super) const RIDGE_SHARPNESS: f32 = 1.2;
/// Range of the strength of a ridge, and of its shift, as a share of the angle between two: roots differ and are not spaced evenly.
pub(super) const RIDGE_STRENGTH: [f64; 2] = [0.55, 1.3];
pub(super) const RIDGE_SHIFT: f64 = 0.28;
/// Ridges are left out of rings that the flare widens by less than this share: the trunk is round there.
pub(super) const LEAST_WIDENING: f32 = 0.01;
/// A transition to a continuing branch must advance by at least this share of its length along both of its end tangents;
/// below it the curve folds back on itself.
pub(super) const MIN_CONTINUATION_ADVANCE: f32 = 0.35;

/// Least distance of a ring at a change of colour from the ring before it, in radii; the quads of a nearer ring would
/// fold in bends.
pub(super) const MIN_EDGE_SPACING: f32 = 0.02;
/// A point of the centreline also gets the ring of a change of colour if it lies before that change by at most this
/// share of the arc length; this allows for rounding.
pub(super) const EDGE_TOLERANCE: f32 = 1e-5;
