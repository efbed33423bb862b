//! Numbers of the rods that were chosen by judgement or by trial, with the effect of changing them.

/// Samples of the spline between two given points: chords and arc length agree to better than a thousandth.
pub(crate) const SPLINE_SUBDIVISIONS: usize = 24;

/// Least and greatest number of sections that is chosen automatically. Fewer: visibly angular bends; more: cost
/// without a visible change.
pub(crate) const SECTION_COUNT_RANGE: [usize; 2] = [5, 16];

/// Length of an interval, in radii, if the number of sections is chosen automatically. Longer intervals are too soft
/// in torsion (see `RodInterval::torsional_softening_ratio`).
pub(crate) const INTERVAL_RADII: f64 = 3.0;

/// Share of the bending stiffness that springs over two intervals carry (flexion springs, S_fl of [yang-wu]). Higher:
/// the longitudinal springs reach their lower bound.
pub(crate) const TWO_INTERVAL_BENDING_SHARE: f64 = 0.2;

/// Bounds of the share of axial stiffness that diagonal springs carry. Lower: the prism shears at no cost; higher:
/// longitudinal springs vanish.
pub(crate) const SHEAR_SHARE_RANGE: [f64; 2] = [0.1, 0.5];

/// Penalty stiffness of a clamp, as a multiple of the largest diagonal entry of its section. Higher: rounding errors in the
/// factorization; lower: the clamp visibly gives way.
pub(crate) const CLAMP_STIFFNESS_FACTOR: f64 = 1e7;

/// Phase, rad, of the fastest visible mode per automatic substep, and the highest frequency, Hz, that counts as
/// visible: implicit damping may weaken faster modes.
pub(crate) const STEP_PHASE: f64 = 0.4;
pub(crate) const MAX_VISIBLE_HZ: f64 = 25.0;

/// Speed of gusts divided by the mean wind, for the automatic substeps of plants. Own: 1 plus the gusts of the default wind, 0.4,
/// plus twice its turbulence, 0.2. Lower: leaves turn over at random in storms; higher: cost.
pub(crate) const PEAK_WIND: f64 = 1.8;

/// Least number of automatic substeps per frame, and per second. Fewer: implicit damping is visible, most at low frame rates;
/// more: cost.
pub(crate) const MIN_STEPS_PER_FRAME: f64 = 8.0;
pub(crate) const MIN_STEPS_PER_SECOND: f64 = 192.0;

/// Times that the substeps of a frame are halved before the simulation fails: sixteenfold substeps. More: a simulation
/// that cannot succeed takes longer to fail.
pub(crate) const MAX_STEP_HALVINGS: u32 = 4;

/// Substep of the explicit integrators, as a fraction of the longest stable one; closer to 1 the fastest mode decays too slowly.
pub(crate) const STABILITY_MARGIN: f64 = 0.9;

/// Newton iterations per step, at most: more gain nothing that is visible at automatic substeps.
pub(crate) const MAX_STEP_ITERATIONS: usize = 4;

/// Newton's method has converged when no corner moves by more than this share of the shortest interval.
pub(crate) const NEWTON_TOLERANCE: f64 = 1e-5;

/// Distance that a rod may move before a step counts as diverged, in total rod lengths. Smaller: simulations of launched rods
/// fail; larger: failures are reported later.
pub(crate) const DIVERGENCE_LENGTHS: f64 = 100.0;

/// Largest number of Newton iterations, and the displacement, as a fraction of the total length, at which they have converged.
/// Slender rods need hundreds of iterations, since [`MAX_NEWTON_STEP`] limits each.
pub(crate) const MAX_EQUILIBRIUM_ITERATIONS: usize = 600;
pub(crate) const EQUILIBRIUM_TOLERANCE: f64 = 1e-10;

/// Largest displacement of a Newton step, as a fraction of the total length: larger steps leave the range of the linearisation.
pub(crate) const MAX_NEWTON_STEP: f64 = 0.1;

/// Under-relaxation of the rest-shape iteration, its greatest number of equilibrium solves, and its tolerance, m. A
/// factor of 1 overshoots in soft rods.
pub(crate) const REST_SHAPE_RELAXATION: f64 = 0.7;
pub(crate) const MAX_EQUILIBRIUM_SOLVES: usize = 20;
pub(crate) const REST_SHAPE_TOLERANCE: f64 = 1e-5;

/// Largest number of iterations of the search by residuals, and its tolerance, m: a ten-thousandth of a millimetre, which
/// no frame resolves.
pub(crate) const MAX_RESIDUAL_ITERATIONS: usize = 300;
pub(crate) const RESIDUAL_TOLERANCE: f64 = 1e-7;

/// Least length of a rod, m and in base radii; shorter axes are rigid with their parent.
pub(crate) const MIN_AXIS_LENGTH: [f64; 2] = [4e-3, 4.0];

/// Least length of a leaf stalk, m. Shorter stalks are so stiff that they dictate the substeps.
pub(crate) const MIN_STALK_LENGTH: f64 = 2e-3;

/// Share of the section budget that the wood of a plant with leaves may take. Higher: fewer leaves move by themselves.
pub(crate) const WOOD_SECTION_SHARE: f64 = 0.6;

/// Distance of the centre of pressure from the centroid in a flow along the blade, as a fraction of the chord.
/// Source: the centre of pressure of a thin plate at a small angle of attack lies at a quarter of the chord.
pub(crate) const PRESSURE_OFFSET: f64 = 0.25;

/// Skin-friction coefficient with respect to the one-sided area. Source: own; a flat plate at Reynolds numbers of a leaf
/// has 0.02 to 0.1.
pub(crate) const SKIN_FRICTION: f64 = 0.06;

/// Vortex shedding: Strouhal number f w / u, wander of the centre of pressure as a fraction of the blade's extent, and amplitude
/// of the fluctuating normal-force coefficient. Higher amplitudes: leaves tremble more at the same wind.
pub(crate) const STROUHAL_NUMBER: f64 = 0.2;
pub(crate) const PRESSURE_WANDER: f64 = 0.12;
pub(crate) const BUFFET_COEFFICIENT: f64 = 0.25;

/// A mesh counts as closed if its vector area is shorter than this fraction of its area; half of its area then faces the wind.
pub(crate) const CLOSED_MESH_SHARE: f64 = 0.2;

/// Spin-up in the wind before the first frame of a clip whose plants on rods do not start at rest, s. Own: a few periods of a
/// branch. Longer: more time before the first frame; shorter: the rods visibly start to move.
pub const PLANT_SPIN_UP_SECONDS: f64 = 2.0;
