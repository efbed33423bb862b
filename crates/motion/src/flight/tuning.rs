//! Numbers of the flight that were chosen by judgement or by trial, with the effect of changing them.

/// Members of a cluster at which the wind is sampled, at most. More: no visible change in its motion.
pub(crate) const MAX_WIND_SAMPLES: usize = 64;

/// Clusters per task: a cluster costs some dozen wind samples, so that fewer would be scheduling overhead.
pub(crate) const CLUSTERS_PER_TASK: usize = 64;

/// Largest angular velocity of a cluster, rad/s, and the time constant with which it follows the wind's rotation, s.
/// Faster: small clusters spin like propellers.
pub(crate) const MAX_CLUSTER_SPIN: f32 = 6.0;
pub(crate) const CLUSTER_SPIN_TIME: f32 = 0.3;

/// Attempts to find a start position outside of solids. Fewer: more catkins are lost in dense scenes.
pub(crate) const MAX_START_DRAWS: u32 = 64;

/// Frames for which a recycled catkin is hidden: one at the old position, one at the new, so that interpolation
/// between frames draws no streak between them.
pub(crate) const HIDDEN_FRAMES: f64 = 2.0;

/// Cells of the contact grid along an axis, at most: 256^3 cells take 64 MiB.
pub(crate) const MAX_CELLS_PER_AXIS: f32 = 256.0;

/// Cell size of the grid of deposited catkins, m: a few catkins wide. Smaller: more cells per query; larger: more
/// pairs.
pub(crate) const REST_CELL: f32 = 0.25;

/// Planes of cells of the contact grid per task.
pub(crate) const PLANES_PER_TASK: i32 = 4;

/// Safety factor on bounding radii against f32 rounding. Exactly 1: a contact at grazing distance may be missed.
pub(crate) const ROUNDING_MARGIN: f32 = 1.0 + 1e-5;

/// Largest number of sphere-tracing steps, and length of the shortest step, m. Fewer steps: grazing sweeps end early; a shorter
/// step: they take longer.
pub(crate) const MAX_TRACE_STEPS: u32 = 32;
pub(crate) const MIN_TRACE_STEP: f32 = 1e-5;

/// Push-out passes for penetrating spheres, at most; a corner of three faces needs three.
pub(crate) const MAX_PUSH_OUT_PASSES: u32 = 4;

/// Distance of the centre from a surface that counts as contact, in radii. Larger: deposits cling to walls that they do not touch.
pub(crate) const CONTACT_FACTOR: f32 = 1.05;

/// Surfaces whose normal's y is above this (slopes below 60 degrees) count as ground, others as walls.
pub(crate) const GROUND_NORMAL_Y: f32 = 0.5;

/// Catkins drop straight down from surfaces whose normal has a y below this (overhangs of more than 15 degrees). Lower: they
/// slide along the underside of a roof; 0: rounding errors make overhangs of upright walls.
pub(crate) const OVERHANG_NORMAL_Y: f32 = -0.26;

/// Penetration below which nothing is pushed out, m.
pub(crate) const PENETRATION_TOLERANCE: f32 = 1e-6;

/// Relaxation rounds that push a joining catkin out of the members that it overlaps, at most. Fewer: visible
/// overlaps.
pub(crate) const MAX_JOIN_PUSH_OUT_ROUNDS: u32 = 8;

/// Tolerance for equal times, s: far below a step, far above rounding.
pub(crate) const SAME_TIME: f64 = 1e-9;

/// Time constant of contraction, s. Shorter: joins look like jumps; longer: pairs fly apart visibly.
pub(crate) const CONTRACTION_TIME: f64 = 0.6;

/// Square of the distance below which a contraction is completed at once, m^2.
pub(crate) const NEGLIGIBLE_LENGTH_SQUARED: f64 = 1e-10;

/// Least distance of two members of a heap, as a fraction of the sum of their radii: under their weight hairs interpenetrate.
/// Smaller: flatter heaps.
pub(crate) const PACKING_SHARE: f64 = 0.5;

/// Distance within which a lower member counts as support, as a multiple of the least distance. Larger: members roll off members
/// that they do not touch.
pub(crate) const SUPPORT_FACTOR: f64 = 1.2;

/// Relaxation rounds that push a sinking member out of others, at most. More: slower, with the same heaps.
pub(crate) const MAX_HEAP_PUSH_OUT_ROUNDS: u32 = 4;

/// A member that sinks by less than this share of its displacement is supported. Smaller: heaps creep for long.
pub(crate) const MIN_SINK_SHARE: f64 = 0.05;

/// Tolerance on positions in a heap, m: a hundredth of a small catkin.
pub(crate) const POSITION_TOLERANCE: f64 = 1e-4;

/// Interval at which attraction targets are chosen anew, s: the time step of \[catkin\] 4.3. Longer: catkins arrive
/// later at heaps; results do not depend on the time step.
pub(crate) const ATTRACTION_TICK: f64 = 0.3;

/// Time after which two catkins within reach of each other that did not stick may try again, s: about as long as two
/// that fly past each other stay within reach. Shorter: `stick_probability` has less effect.
pub(crate) const ENCOUNTER_TIME: f64 = 1.0;

/// Reference height of the threshold wind, m.
pub(crate) const LIFT_HEIGHT: f64 = 0.1;

/// Creep speed of a dry single, as a fraction of the wind speed. Higher: catkins slide like leaves on ice.
pub(crate) const CREEP_SHARE: f64 = 0.3;

/// Updraft at lift-off, as a fraction of the wind speed in excess of the threshold. Lower: catkins hop; higher: they fly off.
pub(crate) const UPDRAFT_SHARE: f64 = 0.5;

/// Height that every lift-off reaches in calm air, in radii. Lower: invisible lift-offs are counted, more of them with shorter time steps.
pub(crate) const MIN_HOP: f64 = 2.0;

/// Decay time of the updraft after a lift-off, s. Longer: lifted catkins rise out of sight; shorter: they drop at
/// once.
pub(crate) const UPDRAFT_TIME: f64 = 0.6;

/// Frequency of the oscillation at settling speed, Hz. Higher: nervous flutter.
pub(crate) const SWING_HZ: f32 = 0.8;

/// Damping ratio of the oscillation. Higher: tufts align without swinging.
pub(crate) const DAMPING_RATIO: f32 = 0.35;

/// Random angular acceleration, rad/s^2, and its correlation time, s. Stronger: catkins tumble in calm air.
pub(crate) const RANDOM_TORQUE: f32 = 6.0;
pub(crate) const RANDOM_TORQUE_TIME: f32 = 0.4;

/// Random spin about the tuft's axis, rad/s, and its correlation time, s. Slower spins are invisible, faster ones
/// look driven.
pub(crate) const AXIAL_SPIN: f32 = 0.6;
pub(crate) const AXIAL_SPIN_TIME: f32 = 1.5;

/// Largest angular velocity, rad/s: above, frames at 24 Hz alias.
pub(crate) const MAX_SPIN: f32 = 12.0;

/// Longest step of the rotation of tumbling, s; longer steps of the flight are divided. Longer: the swing of catkins depends on
/// the frame rate. Shorter: tumbling costs more, without a visible change.
pub(crate) const MAX_TUMBLE_STEP: f64 = 1.0 / 24.0;

/// Decay time of rotation after deposition, s. Longer: deposits spin on the ground.
pub(crate) const REST_DAMPING_TIME: f32 = 0.1;
