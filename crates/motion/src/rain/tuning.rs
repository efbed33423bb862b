//! Constants of the rain model that are chosen, not derived: each with its unit, its reason and what a change does.

// Emission: sizes, counts and times of raindrops.

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
/// Length of the slices of time for which emitted drops are drawn, s: a whole part of [`EPOCH_DURATION`]. Fixed, so that another
/// time step gives the same drops; shorter costs more draws.
pub const EMISSION_SLICE: f64 = 0.01;
/// Period of the noise by which the rainfall rate fluctuates, s.
pub const GUST_PERIOD: f64 = 0.5;
/// Smallest terminal speed, m/s; the formula of Atlas et al. becomes negative below 0.11 mm.
pub const MIN_TERMINAL_SPEED: f64 = 0.3;

// Source regions: parts of the emission plane from which drops reach the scene.

/// Height of the emission plane above the bounds of the plants, m. Higher lets drops meet more of the wind, and costs area and time.
pub const EMISSION_CLEARANCE: f64 = 0.5;
/// Distance by which source regions extend beyond the starts of the traced drops, m.
pub const SOURCE_MARGIN: f64 = 0.05;
/// Further margin, as a fraction of the spread of drifts within a height band: gusts carry some drops further than
/// the traced ones.
pub const DRIFT_MARGIN: f64 = 0.15;
/// Duration for which source regions stay the same, s; shorter follows gusts more closely and costs more traces.
pub const EPOCH_DURATION: f64 = 0.1;
/// Number of steps of a traced fall in still air, and largest number of steps of one that an updraft slows down.
pub const TRACE_STEPS: u32 = 48;
pub const MAX_TRACE_STEPS: u32 = 4 * TRACE_STEPS;
/// Bands that the height of the bounds is divided into; more follow the slant of the rain more closely.
pub const HEIGHT_BANDS: usize = 8;
/// Diameters that are traced; drops in between start from the union of the regions of both neighbours.
pub const TRACED_SIZES: usize = 17;
/// Samples along a side of the grid by which the area of a source region is measured.
pub const AREA_SAMPLES: u32 = 32;
/// Times of a clip at which the area of a source region is measured for its mean.
pub const AREA_TIMES: u32 = 16;

// Shelter and ground: ends of the paths of drops, above the emission plane and below it.

/// Time step of the paths that are followed back from places of emission to find shelter, on Earth, s: up to half a metre of fall;
/// longer steps straighten the paths of drops in gusts.
pub const SHELTER_STEP: f64 = 0.05;
/// Largest number of such steps: 100 m of fall of the slowest drops.
pub const MAX_SHELTER_STEPS: u32 = 1000;
/// Bisections that find where a path meets uneven ground: to a billionth of the path of one step.
pub const GROUND_BISECTIONS: u32 = 30;

// Time step, collision and impact of falling drops.

/// Steps for which the hierarchy of leaves and wood is fitted to their motion before it is built anew. Affects speed only: more let the
/// boxes of its inner nodes grow, fewer build more often.
pub const REFITS_PER_BUILD: u32 = 64;
/// Time between two samples of the wind at a falling drop, s: a drop of 1 mm falls 8 cm in it, and takes 0.4 s to follow a gust.
/// Longer lags behind gusts; shorter makes the wind the main cost of a storm.
pub const DROP_WIND_INTERVAL: f64 = 1.0 / 48.0;
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
/// Diameters of splash droplets, m; as many are drawn as hold the splashed volume.
pub const SPLASH_DIAMETERS: [f64; 2] = [2e-4, 5e-4];
/// Largest number of droplets of a splash: that of a drop of 4 mm that loses a third. Larger splashes have larger droplets.
pub const MAX_SPLASH_DROPLETS: usize = 400;
/// Weber number of the rebound above which a drop bounces: below, its motion is weaker than the surface tension that holds it.
pub const REBOUND_WEBER_NUMBER: f64 = 1.0;
/// Angles of splash droplets from the surface normal, degrees: a crown, as in photographs.
pub const SPLASH_ANGLES: [f64; 2] = [50.0, 70.0];
/// Speeds of splash droplets as fractions of the impact speed.
pub const SPLASH_SPEEDS: [f64; 2] = [0.2, 0.4];
/// Distance from the surface at which splash droplets start, m, so that they do not hit it at once.
pub const SPLASH_OFFSET: f64 = 1e-4;
/// Largest relative error of the water budget: rounding of sums over a clip stays far below.
pub const BUDGET_TOLERANCE: f64 = 1e-9;

// Leaf surface: chart, wetness grid and veins.

/// Smallest determinant of a triangle's texture coordinates; below it the triangle belongs to a petiole, which is mapped to a line.
pub const MIN_UV_AREA: f64 = 1e-9;
/// Depth by which two triangles may overlap in a texture, as a fraction of the extent of all: rounding, and slips of an artist that are
/// smaller than a texel of the finest map.
pub const OVERLAP_TOLERANCE: f64 = 1e-4;
/// Fraction of the area of a blade in its texture that may overlap or lie at seams. Petioles of generated leaves, whose tubes lie
/// on a strip of the texture, have a tenth of that; a seam across a mesh of 100,000 triangles has more.
pub const MAX_FAULTY_AREA: f64 = 0.005;
/// Distance in texture coordinates by which corners of neighbouring triangles may lie apart, or beyond the texture.
pub const CHART_SEAM_TOLERANCE: f64 = 1e-3;
/// Smallest fraction of a triangle's area that a projection on a plane may leave, the cosine of 84 degrees: steeper parts would have too
/// few texels.
pub const MIN_PROJECTED_AREA: f64 = 0.1;
/// Gap around pieces of a chart, as a fraction of its side: at 512 texels wider than the continuation of maps beyond the margin.
pub const CHART_GAP: f64 = 1.0 / 64.0;
/// Relative residual at which the embedding of a blade is solved: far below a texel.
pub const EMBED_TOLERANCE: f64 = 1e-9;
/// Largest number of iterations of that solution; a blade of 100,000 triangles needs about a thousand.
pub const EMBED_ROUNDS: usize = 20_000;
/// Wetness of the grid that counts as dry, 0 to 1; ten half-lives.
pub const MIN_WETNESS: f64 = 1.0 / 1024.0;
/// Number of cells along each side of the vein map: on a leaf of 150 mm a cell is as wide as a small drop.
pub const VEIN_CELLS: usize = 128;
/// Cells on either side whose mean a cell is compared with; more also find broad veins.
pub const VEIN_NEIGHBOURHOOD: usize = 5;
/// Depth, 0 to 1, of a cell that is lower than its neighbourhood by the root mean square of the leaf; with 0.5,
/// twice that is a full vein.
pub const VEIN_RMS_SCALE: f64 = 0.5;

// Shape of sessile drops and of their tails: height, skew, stretch and spacing of caps.

/// Height factor of [`CapHeightRule::Paper`](crate::rain::CapHeightRule::Paper), as printed in the paper.
pub const PAPER_HEIGHT_FACTOR: f64 = 0.5;
/// Contact angle, degrees, from which the largest skew replaces the formula of the skew, whose tangents diverge; and that skew:
/// by eye, more makes the front of a drop a wall.
pub const NEAR_RIGHT_ANGLE: f64 = 85.0;
pub const MAX_SKEW: f64 = 0.4;
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
/// Smallest fraction of a growing cap at which it is drawn.
pub const MIN_TAIL_SHARE: f64 = 1e-3;
/// Smallest base radius of a cap in divisions by it, m.
pub const MIN_CAP_RADIUS: f64 = 1e-5;
/// Sphere radius of the smallest cap that a tail leaves behind as a bead, m; smaller caps return to the drop.
pub const MIN_BEAD_RADIUS: f64 = 3e-4;

// Motion of sessile drops: friction, steering, segments of a run, the margin.

/// Speed below which a drop that the forces hold is at rest, m/s: dry friction brings it to exactly 0 within microseconds; larger
/// values would hold drops that start slowly.
pub const STOP_SPEED: f64 = 1e-5;
/// Speed across the margin above which a drop leaves the leaf instead of being stopped by the edge, m/s.
pub const MARGIN_ESCAPE_SPEED: f64 = 0.3;
/// Time constant with which drops respond to the leaf's acceleration, s: about sqrt(rho V / gamma), the time in which surface tension
/// deforms a drop of 10 mm^3. An impact, which accelerates the leaf within a single time step, then acts alike for any step.
pub const ACCELERATION_RESPONSE_TIME: f64 = 0.01;
/// Limit of that acceleration, m/s^2: beyond it, drops would deform rather than follow.
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
/// Larger weights bend paths more; with all at 0 drops run straight. That of noise is multiplied by the variation of pinning.
pub const STEER_DOWNHILL: f64 = 0.5;
pub const STEER_WETNESS: f64 = 0.3;
pub const STEER_VEIN: f64 = 0.2;
pub const STEER_NOISE: f64 = 0.5;
/// Factor on texture coordinates for the noise that steers, so that it differs from that of pinning.
pub const STEER_NOISE_SCALE: f64 = 2.0;
/// Distance before a decision at which it counts as reached, in base radii: far above rounding.
pub const STEER_TOLERANCE: f64 = 1e-6;
/// Longest substeps, s, after which drops of a leaf that touch merge and tails change: while a drop runs, and while
/// none does. Largest distance, in base radii, that a drop may run within one, so that fast drops do not pass over
/// others. Largest number of substeps.
pub const MAX_RUN_STEP: f64 = 1.0 / 384.0;
pub const MAX_REST_STEP: f64 = 1.0 / 120.0;
pub const MAX_DROP_SHIFT: f64 = 0.5;
pub const MAX_SUBSTEPS: u32 = 64;
/// Length of a segment of a run in base radii: below [`MARGIN_DISTANCE`], so that no drop passes the margin undetected.
pub const SEGMENT_LENGTH: f64 = 0.25;
/// Largest turn of the heading in a segment, as a fraction of the speed, if gravity is oblique to it. Such a segment also lasts
/// at most this part of the viscous time constant, and at least the given time, s. Smaller turns cost more segments.
pub const MAX_SEGMENT_TURN: f64 = 0.25;
pub const SEGMENTS_PER_DECAY_TIME: f64 = 8.0;
pub const MIN_SEGMENT_TIME: f64 = 2e-4;
/// Largest number of segments of a substep: more than a drop needs that turns all the time.
pub const MAX_RUN_SEGMENTS: u32 = 256;
/// Length of a piece of the recorded path, in base radii, below which the next is added to it.
pub const PATH_SPACING: f64 = 0.1;
/// Distance from the margin at which a drop is stopped by it, in base radii.
pub const MARGIN_DISTANCE: f64 = 0.3;
/// Distance by which a drop that would cross the margin within a substep is moved inward, in base radii.
pub const MARGIN_INSET: f64 = 0.02;
/// Distance after which a moving drop marks the surface as wet again, in base radii.
pub const WET_MARK_INTERVAL: f64 = 0.25;
/// Distance behind a running drop at which its track begins to act on drops, in base radii: with less, a drop would respond to
/// its water in the coarse grid of wetness.
pub const TRACK_DISTANCE: f64 = 2.5;
/// Relative enlargement of the distance within which pairs of drops are tested for touching, against rounding.
pub const SWEEP_TOLERANCE: f64 = 1e-9;

// Pendant drops: formation, maximum volume, necking and detachment.

/// Largest attachment radius of a pendant drop on a straight margin, m.
pub const MAX_PENDANT_RADIUS: f64 = 1.5e-3;
/// Smallest distance along the margin that is searched for a lower point, m.
pub const LOW_POINT_REACH: f64 = 1e-3;
/// Height difference that counts as level when a lower point of the margin is sought, m.
pub const LEVEL_TOLERANCE: f64 = 1e-6;
/// A drop counts as stuck at the margin below this speed, m/s.
pub const STUCK_SPEED: f64 = 0.01;
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
/// Smallest gravity in the capillary length of sessile and pendant drops, m/s^2, and in the maximum volume of the latter: that of the
/// key `rain.gravity`. A leaf that falls freely has less, with which drops would grow without limit.
pub const MIN_GRAVITY: f64 = 0.01;
/// Largest attraction of [`MergeRule::Paper`](crate::rain::MergeRule::Paper), in units of its constant: the logarithm of the
/// paper has no limit.
pub const MAX_ATTRACTION: f64 = 3.0;
/// Largest factor on the length of the profile of the maximum volume, by which a drop with more water is drawn.
pub const MAX_PENDANT_STRETCH: f64 = 1.6;
/// Shape at the end of necking, after photographs: relative lengthening of the drop, and relative narrowing of its neck.
pub const NECK_LENGTHENING: f64 = 0.45;
pub const NECK_THINNING: f64 = 0.75;
/// As fractions of the length from the apex: height of the neck, height of the waist above which the body narrows into it, and
/// height above which the drop lengthens.
pub const NECK_POSITION: f64 = 0.82;
pub const NECK_WAIST: f64 = 0.5;
pub const NECKED_SHIFT_START: f64 = 0.4;

// Water maps: wet spots, windows of texels, continuation beyond the margin.

/// Wetness of the maps that counts as dry, 0 to 1; equal to [`MIN_WETNESS`] in single precision.
pub const MIN_MAP_WETNESS: f32 = 1.0 / 1024.0;
/// Radius of a wet spot in base radii of its drop: a film creeps beyond the contact line.
pub const WET_RADIUS_FACTOR: f64 = 1.15;
/// Smallest and largest factor on the radius of windows of texels; the factor grows with the distortion of the texture. Too small
/// cuts off parts of drops, larger costs time.
pub const WINDOW_MARGIN_MIN: f64 = 1.05;
pub const WINDOW_MARGIN_MAX: f64 = 1.25;
/// Texels by which maps continue beyond the margin of the blade: enough for bilinear filters and two levels of mipmaps.
pub const MAP_BLEED: usize = 4;
/// Largest number of samples across a texel when the relief of a leaf is reduced to a map; more follow finer relief
/// and cost time once.
pub const MAX_RELIEF_SAMPLES: usize = 4;
/// Cosine of the angle to the mean normal within which all normals lie if the blade is not folded. Folded blades cost more time.
pub const FOLD_COSINE: f32 = 0.8;

// Meshes of drops: numbers of rings, sides, rows and columns, by size in the picture.

/// Number of rings and sides of a small drop and of a large one, and the radius from which a drop is large, m.
pub const SMALL_DROP_GRID: [u32; 2] = [6, 24];
pub const LARGE_DROP_GRID: [u32; 2] = [12, 48];
pub const LARGE_DROP_RADIUS: f64 = 1e-3;
/// The same for drops that are small in the picture, and for drops of a pixel or two.
pub const FAR_DROP_GRID: [u32; 2] = [4, 12];
pub const DISTANT_DROP_GRID: [u32; 2] = [1, 6];
/// Radius over distance below which a drop counts as far, and below which it counts as distant: about 15 and 3 pixels across in a
/// picture of 1080 lines that covers 40 degrees. Polygons of 12 and 6 sides then deviate from the circle by a quarter of a pixel.
/// Larger: the coarse meshes become visible; smaller: files hold vertices that nobody sees.
pub const FAR_DROP_ANGLE: f64 = 5e-3;
pub const DISTANT_DROP_ANGLE: f64 = 1e-3;
/// Exponent of the spacing of rings: above 1 they are denser towards the contact line, where highlights and refraction vary most.
pub const RIM_DENSITY: f64 = 1.6;
/// How far water reaches below the leaf's surface, m, so that no air is left between.
pub const UNDERSIDE_DEPTH: f64 = 1e-4;
/// Columns of a tail body across the path: near, from afar and distant.
pub const TAIL_COLUMNS: [u32; 3] = [14, 6, 4];
/// Rows of a tail body per radius of its narrowest cap: near, from afar and distant; fewest and most rows.
pub const TAIL_ROWS_PER_RADIUS: [f64; 3] = [7.0, 3.0, 1.0];
pub const MIN_TAIL_ROWS: [u32; 3] = [16, 8, 4];
pub const MAX_TAIL_ROWS: u32 = 160;
/// Slices along a tail body, and steps from the middle to the rim of each, by which its volume is measured.
pub const TAIL_SLICES: u32 = 96;
pub const TAIL_SLICE_STEPS: u32 = 24;
/// Limits of the factor on the heights of a tail body that conserves volume; beyond them it would not look like water.
pub const TAIL_HEIGHT_RANGE: [f64; 2] = [0.4, 1.6];
/// Sides of a pendant drop, and about how many points its profile has: near, from afar and distant.
pub const PENDANT_SIDES: [u32; 3] = [32, 12, 6];
pub const PROFILE_POINTS: [usize; 3] = [40, 12, 4];
/// Height of a pendant drop above its attachment, in radii, and the rings of that part: near, from afar and distant.
pub const SEAT_HEIGHT: f64 = 0.35;
pub const SEAT_RINGS: [u32; 3] = [8, 3, 2];

/// Largest diameter of the spot that a drop wets on wood, in diameters of the drop. Own: faster drops splash on rough bark before they
/// spread further.
pub const MAX_BARK_SPREAD: f64 = 6.0;

/// Parts of equal volume into which rain is divided where the exposure of surfaces is computed, each at a different time of the
/// clip. More resolve gusts and sizes better, at a cost in proportion.
pub const EXPOSURE_SAMPLES: u32 = 8;
/// Distance outside of a surface at which its exposure is computed, m: more than the radius of the largest drops, which would
/// touch the surface otherwise.
pub const EXPOSURE_OFFSET: f32 = 5e-3;
