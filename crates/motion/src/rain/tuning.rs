//! Constants of the rain model that are chosen, not derived: each with its unit, its reason and what a change does.

/// Drops that one parallel task advances. Affects speed only.
pub const DROPS_PER_TASK: usize = 256;
/// Time for which a drop that has left a leaf ignores that leaf, s. Long enough to fall clear of it; longer lets drops pass through.
pub const IGNORE_LEAF_TIME: f64 = 0.005;
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
/// Largest attachment radius of a pendant drop on a straight margin, m.
pub const MAX_PENDANT_RADIUS: f64 = 1.5e-3;
/// Smallest distance along the margin that is searched for a lower point, m.
pub const LOW_POINT_REACH: f64 = 1e-3;
/// A drop counts as stuck at the margin below this multiple of [`REST_SPEED`].
pub const STUCK_SPEED: f64 = 10.0;
/// A pendant drop runs back onto the leaf where gravity points inward by this fraction of its magnitude.
pub const TIPPED_OVER: f64 = 0.2;
/// How far inside the margin it then lies, in attachment radii.
pub const RETURN_INSET: f64 = 0.35;
/// Largest distance below its attachment at which a detached drop starts, m.
pub const MAX_PENDANT_LENGTH: f64 = 5e-3;
/// Distance after which a moving drop marks the surface as wet again, in base radii.
pub const WET_MARK_INTERVAL: f64 = 0.25;
