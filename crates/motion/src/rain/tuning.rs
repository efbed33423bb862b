//! Constants of the rain model that are chosen, not derived: each with its unit, its reason and what a change does.

// Emission.

/// Diameters of the smallest and the largest raindrop, mm: smaller ones are drizzle, larger ones break up in the air.
pub const DIAMETER_RANGE_MM: [f64; 2] = [0.5, 6.0];
/// Entries of the table of diameters; more follow the distribution of sizes more closely.
pub const DIAMETER_TABLE_SIZE: usize = 1024;
/// Integration steps of the distribution of sizes per entry of that table.
pub const DIAMETER_STEPS_PER_ENTRY: usize = 16;
/// Samples of the envelope over a clip in the integral that sets the total number of drops.
pub const ENVELOPE_SAMPLES: u32 = 2000;
/// Largest mean of a Poisson count that is drawn at once: exp(-30) is far from underflow. Other values change all draws.
pub const POISSON_CHUNK_MEAN: f64 = 30.0;
/// Period of the noise by which the rainfall rate fluctuates, s.
pub const GUST_PERIOD: f64 = 0.5;
/// Smallest terminal speed, m/s; the formula of Atlas et al. becomes negative below 0.11 mm.
pub const MIN_TERMINAL_SPEED: f64 = 0.3;

// Source regions.

/// Height of the emission plane above the bounds of the plants, m. Higher lets drops meet more of the wind, and costs area and time.
pub const EMISSION_CLEARANCE: f64 = 0.5;
/// Distance by which source regions reach beyond what the traced drops need, m.
pub const SOURCE_MARGIN: f64 = 0.05;
/// The same as a fraction of the spread of drifts within a height band: gusts carry some drops further than those traced.
pub const DRIFT_MARGIN: f64 = 0.15;
/// Duration for which source regions stay the same, s; shorter follows gusts more closely and costs more traces.
pub const EPOCH_DURATION: f64 = 0.1;
/// Steps of a traced fall in still air, and most steps of one that an updraft holds up.
pub const TRACE_STEPS: u32 = 48;
pub const MAX_TRACE_STEPS: u32 = 4 * TRACE_STEPS;
/// Bands that the height of the bounds is divided into; more follow the slant of the rain more closely.
pub const HEIGHT_BANDS: usize = 8;
/// Diameters that are traced; drops in between start from the union of the regions of both neighbours.
pub const TRACED_SIZES: usize = 17;
/// Samples along a side of the grid by which the area of a source region is measured.
pub const AREA_SAMPLES: u32 = 32;
/// Times of a clip at which it is measured for the mean.
pub const AREA_TIMES: u32 = 16;

// Time step, collision and impact.

/// Drops that one parallel task advances. Affects speed only.
pub const DROPS_PER_TASK: usize = 256;
/// Time for which a drop that has left a leaf ignores that leaf, s. Long enough to fall clear of it; longer lets drops pass through.
pub const IGNORE_LEAF_TIME: f64 = 0.005;
/// Difference of two hits, as a fraction of the path, within which they count as one and the lower index decides: rounding of `f32`.
pub const HIT_TIE: f32 = 1e-7;
/// Smallest barycentric coordinate of a hit: slightly outside, so that no path slips through between two triangles.
pub const TRIANGLE_SLACK: f32 = -1e-6;
/// Weber number rho u^2 d / gamma above which an impact splashes; lower makes more impacts splash.
pub const SPLASH_WEBER_NUMBER: f64 = 100.0;
/// Number of splash droplets: this many, plus a random number below the second.
pub const SPLASH_DROPLETS: [u32; 2] = [6, 15];
/// Diameters of splash droplets before they are scaled to the splashed volume, m.
pub const SPLASH_DIAMETERS: [f64; 2] = [2e-4, 5e-4];
/// Angles of splash droplets from the surface normal, degrees: a crown, as in photographs.
pub const SPLASH_ANGLES: [f64; 2] = [50.0, 70.0];
/// Speeds of splash droplets as fractions of the impact speed.
pub const SPLASH_SPEEDS: [f64; 2] = [0.2, 0.4];
/// Distance from the surface at which splash droplets start, m, so that they do not hit it at once.
pub const SPLASH_OFFSET: f64 = 1e-4;
/// Largest relative error of the water budget: rounding of sums over a clip stays far below.
pub const BUDGET_TOLERANCE: f64 = 1e-9;

// Leaf surface.

/// Smallest determinant of a triangle's texture coordinates; below it the triangle belongs to a petiole, which is mapped to a line.
pub const MIN_UV_AREA: f64 = 1e-9;
/// Wetness of the grid that counts as dry, 0 to 1; ten half-lives.
pub const MIN_WETNESS: f64 = 1.0 / 1024.0;
/// Cells each way of the vein map: of a leaf of 150 mm a cell is as wide as a small drop.
pub const VEIN_CELLS: usize = 128;
/// Cells on either side whose mean a cell is compared with; more also find broad veins.
pub const VEIN_NEIGHBOURHOOD: usize = 5;
/// Depth of a vein whose lowering is the root mean square of the leaf; 0.5: twice that is a full vein.
pub const VEIN_RMS_SCALE: f64 = 0.5;

// Shape of sessile drops and of their tails.

/// Height factor of [`CapShape::Paper`](crate::rain::CapShape::Paper), as printed in the paper.
pub const PAPER_HEIGHT_FACTOR: f64 = 0.5;
/// Contact angle from which the formula of the skew, whose tangents diverge, is replaced by a constant, degrees; and that constant.
pub const NEAR_RIGHT_ANGLE: f64 = 85.0;
pub const MAX_SKEW_NEAR_RIGHT_ANGLE: f64 = 0.4;
/// Speed at which a drop is stretched most and its tail is longest, m/s.
pub const FULL_TAIL_SPEED: f64 = 0.15;
/// Stretch at that speed, and right after a merger, both beyond 1.
pub const SPEED_STRETCH: f64 = 0.5;
pub const MERGE_STRETCH: f64 = 0.6;
/// Time constant with which the stretch after a merger relaxes, s.
pub const MERGE_STRETCH_TIME: f64 = 0.05;
/// Distance of neighbouring caps of a tail, in base radii of the smaller one; below 1 they overlap.
pub const TAIL_SPACING: f64 = 0.9;
/// Time constant with which a tail grows and shrinks, s.
pub const TAIL_TIME: f64 = 0.08;
/// Smallest fraction of a cap that has begun to grow at which it is shown.
pub const MIN_TAIL_SHARE: f64 = 1e-3;
/// Smallest base radius of a cap in divisions by it, m.
pub const MIN_CAP_RADIUS: f64 = 1e-5;
/// Sphere radius of the smallest cap that a tail leaves behind as a bead, m; smaller ones are drawn in.
pub const MIN_BEAD_RADIUS: f64 = 3e-4;

// Motion of sessile drops.

/// Speed below which a drop is at rest, m/s. Also the limit of the state `runs` in exported tables.
pub const REST_SPEED: f64 = 1e-3;
/// Speed across the margin above which a drop leaves the leaf instead of being stopped by the edge, m/s.
pub const MARGIN_ESCAPE_SPEED: f64 = 0.3;
/// Limit of the leaf's acceleration that acts on drops, m/s^2: an impact's spike within one step would throw off every drop.
pub const MAX_LEAF_ACCELERATION: f64 = 50.0;
/// Time in which the axis of a resting drop turns downhill, s.
pub const AXIS_TURN_TIME: f64 = 0.1;
/// Fraction of the static retention force that still acts on a moving drop (dynamic hysteresis is smaller).
pub const DYNAMIC_RETENTION: f64 = 0.7;
/// Fraction of the retention force that a fully wet surface removes.
pub const WET_RELIEF: f64 = 0.5;
/// Distance ahead of the drop's center at which the surface's wetness counts, in base radii: just beyond the front.
pub const FRONT_DISTANCE: f64 = 1.3;
/// Cells of the pinning noise across the leaf; more make it finer.
pub const PINNING_NOISE_CELLS: f64 = 14.0;
/// Directions that a running drop compares when it steers.
pub const STEER_DIRECTIONS: u32 = 16;
/// Distance between two decisions, and at least the distance it looks ahead, both in base radii.
pub const STEER_INTERVAL: f64 = 0.5;
pub const STEER_LOOKAHEAD: f64 = 0.6;
/// Weights of a direction's score beside its agreement with the present velocity (weight 1): downhill, wetness, veins, noise.
/// Larger weights bend paths more; with all at 0 drops run straight.
pub const STEER_DOWNHILL: f64 = 0.5;
pub const STEER_WETNESS: f64 = 0.3;
pub const STEER_VEIN: f64 = 0.2;
pub const STEER_NOISE: f64 = 0.15;
/// Factor on texture coordinates for the noise that steers, so that it differs from that of pinning.
pub const STEER_NOISE_SCALE: f64 = 2.0;
/// Length of a substep of a run in base radii, and most substeps of a step.
pub const SUBSTEP_LENGTH: f64 = 0.5;
pub const MAX_SUBSTEPS: u32 = 64;
/// Distance from the margin at which a drop is stopped by it, in base radii.
pub const MARGIN_DISTANCE: f64 = 0.3;
/// Distance by which a drop that would cross the margin within a substep is moved inward, in base radii.
pub const MARGIN_INSET: f64 = 0.02;
/// Distance after which a moving drop marks the surface as wet again, in base radii.
pub const WET_MARK_INTERVAL: f64 = 0.25;
/// Relative enlargement of the distance within which pairs of drops are tested for touching, against rounding.
pub const SWEEP_TOLERANCE: f64 = 1e-9;

// Pendant drops.

/// Largest attachment radius of a pendant drop on a straight margin, m.
pub const MAX_PENDANT_RADIUS: f64 = 1.5e-3;
/// Smallest distance along the margin that is searched for a lower point, m.
pub const LOW_POINT_REACH: f64 = 1e-3;
/// Height difference that counts as level when a lower point of the margin is sought, m.
pub const LEVEL_TOLERANCE: f64 = 1e-6;
/// A drop counts as stuck at the margin below this multiple of [`REST_SPEED`].
pub const STUCK_SPEED: f64 = 10.0;
/// A pendant drop runs back onto the leaf where gravity points inward by this fraction of its magnitude.
pub const TIPPED_OVER: f64 = 0.2;
/// How far inside the margin it then lies, in attachment radii.
pub const RETURN_INSET: f64 = 0.35;
/// Fractions of the way from the margin to the middle of the texture at which the surface is looked up, as coordinates of the
/// margin itself may round to beyond the blade; and at which the drop lies if there is no surface at its inset.
pub const MARGIN_UV_SHIFT: f64 = 1e-3;
pub const RETURN_UV_SHIFT: f64 = 1e-2;
/// Largest distance below its attachment at which a detached drop starts, m.
pub const MAX_PENDANT_LENGTH: f64 = 5e-3;
/// Fraction of the maximum volume that detaches. Tate's law with Harkins and Brown's factors gives 0.61 to 0.78 of
/// 2 pi R gamma / (rho g), of which the maximum is 0.66 to 0.84.
pub const DETACHED_FRACTION: f64 = 0.93;
/// Time from exceeding the maximum volume to detachment, s: thinning of the neck of a water drop of some millimetres.
pub const NECKING_TIME: f64 = 0.04;
/// Smallest gravity in profiles of pendant drops, m/s^2; with less the capillary length, hence drops, would grow without limit.
pub const MIN_GRAVITY: f64 = 0.05;
/// Smallest gravity in the capillary length of sessile drops, m/s^2.
pub const MIN_CAPILLARY_GRAVITY: f64 = 1e-3;
/// Largest factor on the length of the profile of the maximum volume with which more water is shown.
pub const MAX_PENDANT_STRETCH: f64 = 1.6;
/// Shape at the end of necking, after photographs: relative lengthening of the drop, and relative narrowing of its neck.
pub const NECK_LENGTHENING: f64 = 0.45;
pub const NECK_THINNING: f64 = 0.75;
/// Heights of the neck, of the waist at which the body begins to narrow into it, and from which on the drop lengthens, as fractions
/// of its length from the apex.
pub const NECK_POSITION: f64 = 0.82;
pub const NECK_WAIST: f64 = 0.5;
pub const NECKED_SHIFT_START: f64 = 0.4;

// Water maps.

/// Wetness of the maps that counts as dry, 0 to 1; equal to [`MIN_WETNESS`] in single precision.
pub const MIN_MAP_WETNESS: f32 = 1.0 / 1024.0;
/// Radius of a wet spot in base radii of its drop: a film creeps beyond the contact line.
pub const WET_RADIUS_FACTOR: f64 = 1.15;
/// Smallest and largest factor on the radius of windows of texels; the factor grows with the distortion of the texture. Too small
/// cuts off parts of drops, larger costs time.
pub const WINDOW_MARGIN_MIN: f64 = 1.05;
pub const WINDOW_MARGIN_MAX: f64 = 1.25;
/// Cosine of the angle to the mean normal within which all normals lie if the blade is not folded. Folded blades cost more time.
pub const FOLD_COSINE: f32 = 0.8;

// Meshes of drops.

/// Rings and sides of a small drop and of a large one, and the radius from which a drop is large, m.
pub const SMALL_DROP_GRID: [u32; 2] = [6, 24];
pub const LARGE_DROP_GRID: [u32; 2] = [12, 48];
pub const LARGE_DROP_RADIUS: f64 = 1e-3;
/// Exponent of the spacing of rings: above 1 they are denser towards the contact line, where highlights and refraction vary most.
pub const RIM_DENSITY: f64 = 1.6;
/// How far water reaches below the leaf's surface, m, so that no air is left between.
pub const UNDERSIDE_DEPTH: f64 = 1e-4;
/// Columns of a tail body across the path.
pub const TAIL_COLUMNS: u32 = 14;
/// Rows of a tail body per radius of its narrowest cap, and most rows.
pub const TAIL_ROWS_PER_RADIUS: f64 = 7.0;
pub const MAX_TAIL_ROWS: u32 = 160;
/// Slices along a tail body, and steps from the middle to the rim of each, by which its volume is measured.
pub const TAIL_SLICES: u32 = 96;
pub const TAIL_SLICE_STEPS: u32 = 24;
/// Limits of the factor on the heights of a tail body that conserves volume; beyond them it would not look like water.
pub const TAIL_HEIGHT_RANGE: [f64; 2] = [0.4, 1.6];
/// Sides of a pendant drop, and about how many points its profile has.
pub const PENDANT_SIDES: u32 = 32;
pub const PROFILE_POINTS: usize = 40;
/// Height of a pendant drop above its attachment, in radii, and the rings of that part.
pub const SEAT_HEIGHT: f64 = 0.35;
pub const SEAT_RINGS: u32 = 8;
