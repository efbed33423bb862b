//! Parameters of the lattice wind that were chosen by judgement or by trial, with the effects of other values.

/// Least depth, cells, of the layer above rough ground in which a mixing length represents eddies that are not resolved. The size
/// of eddies at a height is about the height, and the lattice resolves eddies of some eight cells. Less: waves of a few cells
/// above the ground.
pub(super) const MIN_MIXING_LENGTH_CELLS: f64 = 8.0;
/// Depth of that layer divided by the reference height of the wind, for cells small enough: 4 m below 10 m, which is 8
/// cells of the default size. A depth in metres keeps the viscosity, and with it the wake of a wall, the same for all
/// smaller cells.
/// More: the wind is damped where it could be resolved; less: the wake of a wall depends on the size of the cells.
pub(super) const MIXING_LENGTH_PER_REFERENCE_HEIGHT: f64 = 0.4;
/// Largest depth of that layer divided by the height of the box, for boxes lower than some 24 m: a larger one would leave no
/// resolved eddies.
pub(super) const MIXING_LENGTH_PER_BOX_HEIGHT: f64 = 1.0 / 6.0;

/// Share of the largest speed of a speed curve that the prescribed mean keeps where the curve is 0: far below any speed with an
/// effect, large enough for a direction in f32.
pub(super) const LULL_SPEED_FACTOR: f64 = 1e-9;

/// Speed of the inflow, cells per step, for which the number of steps per frame is chosen. Errors of compressibility increase
/// with its square; the cost decreases in proportion.
pub(super) const TARGET_SPEED: f64 = 0.1;
/// Speed of the inflow, cells per step, above which a warning is given: about 1.5 times the target's error.
pub(super) const WARN_SPEED: f64 = 0.12;
/// Speed of the inflow, cells per step, that is refused: gusts around obstacles are twice as fast and reach the speed limit.
pub(super) const REFUSED_SPEED: f64 = 0.15;
/// Speed of the inflow, cells per step, below which f32 rounding is no longer small against the flow.
pub(super) const SLOW_SPEED: f64 = 0.005;
/// Least relaxation time, steps, that stays stable without an eddy viscosity, by trial in turbulent wakes.
pub(super) const MIN_TAU_WITHOUT_EDDIES: f64 = 0.505;
/// Component of the wind's unit direction normal to a face, below which the wind counts as parallel to the face: about a degree.
/// Larger: faces stay closed at more oblique winds; smaller: rounding opens faces that should slip.
pub(super) const PARALLEL_COMPONENT: f64 = 0.02;
/// Least number of times that sound crosses the box's longest side before the first frame: the start-up pressure waves have left
/// by then.
pub(super) const SPIN_UP_SOUND_CROSSINGS: f64 = 3.0;
/// Number of times that the wind crosses a box with open sides before the first frame. While the inflow increases, air escapes
/// through the sides, and the resulting eddies leave with the wind: in an empty box of 35 x 12 x 35 m, at 2, 10 and 45 degrees to
/// an axis, the wind after one crossing differs from its final state by 9 % of its speed (root mean square; 40 % at worst), after
/// two by 1 %.
pub(super) const OPEN_SIDES_CROSSINGS: f64 = 2.0;
/// Number of steps over which the inflow increases from 0 to its full speed. Fewer: a stronger pressure wave at the start.
pub(super) const RAMP_STEPS: f32 = 100.0;

/// Number of steps between two checks of every cell. A check costs about one step; a diverging flow is reported at most this
/// late.
pub(super) const CHECK_INTERVAL: u64 = 64;
/// Share of fluid cells that may be clamped in one step; if more are, the run has diverged.
pub(super) const MAX_CLAMPED_SHARE: f64 = 0.01;
/// Allowed density; outside, the flow has diverged: the dynamic pressure at the speed limit of 0.3 cells per step changes the
/// density by only 0.15.
pub(super) const DENSITY_RANGE: [f32; 2] = [0.5, 1.5];
/// Mean checkerboard density (the difference of the two sublattices) above which a warning is given: a fifteenth of the dynamic
/// pressure at the target speed.
pub(super) const CHECKERBOARD_WARNING: f64 = 1e-3;

/// Distance from a surface, cells, within which a link counts as cut by it. It must exceed the rounding of positions in f32, a
/// hundred-thousandth of a cell some hundred cells from the origin, so that no link passes between two triangles; but be far less
/// than a cell, so that no other link counts as cut.
pub(super) const SURFACE_SLACK: f64 = 1e-3;
/// Least distance between a solid and an open face, cells; closer solids disturb the flow at the face enough for a warning.
pub(super) const OPEN_FACE_CLEARANCE: usize = 4;
/// Share of the inflow's cross-section that solids may block before a warning: the wind squeezed past them is then some
/// 40 % too fast.
pub(super) const MAX_BLOCKAGE: f64 = 0.3;

/// Share of the inflow that may be blocked at the narrowest position before the run is refused: an inflow of 0.06 to 0.1 cells
/// per step would pass the remaining opening at the speed of sound, 0.58, or faster, and accumulates at the inlet instead.
pub(super) const REFUSED_BLOCKAGE: f64 = 0.9;
/// Least number of cells per height of a solid without a warning: with fewer the length of the wake still depends on the cell
/// size.
pub(super) const MIN_CELLS_PER_HEIGHT: u32 = 8;

/// Number of ticks of the gust process per correlation time; it is linear between ticks. Fewer: visible kinks; more: only
/// computing time.
pub(super) const GUST_TICKS: f64 = 32.0;
/// Length of the moving average of a gust, correlation times: the oldest draw has a weight of e^-7, a thousandth.
pub(super) const GUST_MEMORY: f64 = 7.0;
/// Largest gust, in standard deviations; limits the speed for which the steps per frame are planned.
pub(super) const MAX_GUST: f64 = 2.0;
/// Longest wavelength of inflow turbulence divided by the reference height, if the scene sets none. The spectrum of the
/// vertical velocity over flat ground in neutral air peaks at wavelengths of about twice the height (Kaimal, Wyngaard,
/// Izumi, Cote 1972); longer waves are gusts.
pub(super) const TURBULENCE_LENGTH_PER_HEIGHT: f64 = 2.0;
/// Shortest wavelength of inflow turbulence divided by the longest. Smaller eddies have a quarter of the energy, and
/// follow from the larger ones within a few of their lengths.
pub(super) const TURBULENCE_RANGE: f64 = 0.125;
/// Shortest wavelength that the cells resolve, cells: shorter waves are damped within a few cells of the inlet, and are omitted.
pub(super) const SHORTEST_WAVELENGTH_CELLS: f64 = 6.0;
/// Share of the turbulence's root mean square that the cells resolve, below which a warning is given.
pub(super) const MIN_CARRIED_TURBULENCE: f64 = 0.8;
/// Height divided by the longest wavelength, above which inflow turbulence has its full strength; below, it decreases linearly to
/// 0 at the ground, through which no eddy may blow.
pub(super) const TURBULENCE_FULL_HEIGHT: f64 = 0.15;
/// Depth of the sponge before an outlet, m, if the scene sets none: about the height of a wall, over which eddies are damped.
pub(super) const SPONGE_DEPTH: f64 = 4.0;
/// Least and greatest depth of that sponge, cells. Fewer: sound is reflected; more: no benefit, only a smaller usable box.
pub(super) const SPONGE_CELLS: [f64; 2] = [4.0, 32.0];
/// Largest share of the box's length that the sponge of a small box takes.
pub(super) const MAX_SPONGE_SHARE: f64 = 1.0 / 6.0;
/// Turn of the wind, rad, per interval of Simpson's rule for the distance that the mean wind has travelled.
pub(super) const TURN_PER_INTERVAL: f64 = 0.1;

/// Number of cells outside the box over which the wind blends into the undisturbed inflow.
pub(super) const OUTSIDE_BLEND_CELLS: f32 = 4.0;
/// Mean of the factor of a speed curve over a clip, below which no mean wind of the clip is computed, because the air that still
/// moves in such a lull is driven by earlier wind.
pub(super) const MIN_MEAN_SPEED: f64 = 0.05;
/// Number of cells recorded around the requested bounds, so that interpolation at their edge has all eight neighbours.
pub(super) const RECORDING_MARGIN: f32 = 2.0;

/// Largest number of snapshots at a time: the two between which a wind is interpolated, the next, and one that a reader still
/// holds. For the memory estimate only.
pub(super) const HELD_SNAPSHOTS: u64 = 4;
/// Number of arrays with one byte per cell that marks solid cells. For the memory estimate only.
pub(super) const SOLID_FLAG_COPIES: u64 = 3;
/// Bytes per cell at an open face: exchanged populations, ghost node and indices. For the memory estimate only, measured.
pub(super) const BYTES_PER_OPEN_CELL: u64 = 260;
/// Bytes per turbulence mode and inlet cell: cosine and sine of the phase. For the memory estimate only.
pub(super) const BYTES_PER_MODE_AND_INLET_CELL: u64 = 8;
/// Bytes per inlet cell: velocities of two steps, mean, shear and position. For the memory estimate only, measured.
pub(super) const BYTES_PER_INLET_CELL: u64 = 40;
