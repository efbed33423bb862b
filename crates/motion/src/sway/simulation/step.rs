//! One time step: positions from the ground up, loads at all stations, forces from the tips down, then oscillators.
//! Only the passes along the hierarchy are scalar, all others run in SIMD lanes.

use pulp::{Simd, WithSimd};

use super::constants::{SecondModes, SimulationConstants};
use crate::lanes::{Columns, RotationLanes, Vec3Lanes};
use crate::sway::beam::{large_deflection_factor, rotation_lanes};
use crate::sway::tuning::{MAX_INERTIAL_ACCELERATION, SECOND_MODE_FORCING};
use crate::sway::wood::LEAF_FOLD_SPEED;
use osier_base::simd::{F64Lanes, Lane as _};

/// Wind across a branch below which vortex shedding vanishes, m/s; avoids a division by zero.
const MIN_CROSS_SPEED: f64 = 1e-30;

/// State of a simulation, in the rows of [`SimulationConstants`].
#[derive(Debug)]
pub(crate) struct SimulationState {
    /// Angle, rad, and angular velocity, rad/s, of both directions.
    pub(crate) first_mode: Columns<4>,
    /// The same for second modes; and the static bend in the mean wind, rad.
    pub(crate) second_mode: Columns<4>,
    pub(crate) mean: Columns<2>,
    /// Rotation vectors of the tip in both modes, in the plant's space.
    bend: Columns<3>,
    second_bend: Columns<3>,
    /// Per station, in the frame of its element's base: rotation, start of its stretch, position.
    turns: Columns<4>,
    from: Columns<3>,
    local_positions: Columns<3>,
    /// Inputs of [`place_on_carriers`] per element, and its outputs: rotation and position of the base in the frame
    /// of the carrier.
    carrier: Columns<10>,
    link: Columns<7>,
    /// Rotation from rest and position of each element's base in the plant's space, by columns and by rows.
    carried: Columns<7>,
    bases: Vec<[f64; 7]>,
    /// Per station: position, position one step ago, and the positions one and two steps ago that it would have on a rigid element.
    pub(crate) places: Columns<3>,
    before: Columns<3>,
    rigid: Columns<6>,
    /// Force, N, of an element and of all that it carries, and the tip slope by inertia and by the elements that it carries, as a
    /// vector; both in plant space. Tip slope by the wind on its own stations, in the frame of the element.
    forces: Columns<6>,
    loads: Columns<3>,
    /// Wind at the last sample and the next, per station in the plant's space, m/s.
    pub(crate) air: [Columns<3>; 2],
    /// Vortex-shedding force divided by the drag at both samples, per element.
    pub(crate) shed: [Columns<1>; 2],
}

impl SimulationState {
    pub(crate) fn new(constants: &SimulationConstants) -> Self {
        // `n`: elements, in rows of lanes; `m`: stations along them, at which the wind acts.
        let (n, m) =
            (constants.station_slots.first().map_or(0, |s| s.1), constants.station_slots.iter().map(|s| s.1).sum());
        // A carrier at rest: no displacement, no velocity, the identity as its quaternion.
        let unturned = |rows: usize| {
            let mut carrier = Columns::<10>::new(rows);
            (0..rows).for_each(|i| carrier.set(i, [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]));
            carrier
        };
        Self {
            first_mode: Columns::new(n),
            second_mode: Columns::new(n),
            mean: Columns::new(n),
            bend: Columns::new(n),
            second_bend: Columns::new(n),
            turns: Columns::new(m),
            from: Columns::new(m),
            local_positions: Columns::new(m),
            carrier: unturned(n),
            link: Columns::new(n),
            carried: Columns::new(n),
            bases: vec![[0.0; 7]; n],
            places: Columns::new(m),
            before: Columns::new(m),
            rigid: Columns::new(m),
            forces: Columns::new(n),
            loads: Columns::new(n),
            air: [Columns::new(m), Columns::new(m)],
            shed: [Columns::new(n), Columns::new(n)],
        }
    }
}

/// Number of SIMD registers that hold the rows of all elements, padding included.
#[inline(always)]
fn element_groups<S: Simd>(constants: &SimulationConstants) -> usize {
    constants.station_slots.first().map_or(0, |s| s.1) / S::F64_LANES
}

/// Number of stations of each element in a register of elements.
#[inline(always)]
fn station_count<S: Simd>(constants: &SimulationConstants, group: usize) -> usize {
    let mut count = 0;
    // Elements are sorted by descending station count, so the rows of the k-th stations are a prefix of the elements'
    // rows.
    while count < constants.station_slots.len() && group * S::F64_LANES < constants.station_slots[count].1 {
        count += 1;
    }
    count
}

/// Index of the register that holds the `k`-th stations of a register of elements.
#[inline(always)]
fn station_group<S: Simd>(constants: &SimulationConstants, k: usize, group: usize) -> usize {
    constants.station_slots[k].0 / S::F64_LANES + group
}

#[inline(always)]
fn vector_pair<S: Simd>([a, b, c, d, e, f]: [F64Lanes<S>; 6]) -> [Vec3Lanes<S>; 2] {
    [Vec3Lanes([a, b, c]), Vec3Lanes([d, e, f])]
}

/// Drag of wood and leaves in relative wind, N, and the wind speed across the wood. On wood the component across it
/// acts; leaves reconfigure, so that their drag becomes linear in fast wind. `wood`, `leaf`: rho C A / 2.
#[inline(always)]
pub(crate) fn drag<S: Simd>(
    [wood, leaf]: [F64Lanes<S>; 2],
    along: Vec3Lanes<S>,
    wind: Vec3Lanes<S>,
) -> (Vec3Lanes<S>, F64Lanes<S>) {
    // Cross-flow principle: only the component normal to its axis exerts drag on wood.
    let across = wind - along * wind.dot(along);
    let (slow, speed) = (across.length(), wind.length());
    let one = F64Lanes::from_scalar(speed.simd, 1.0);
    (across * (wood * slow) + wind * (leaf * speed).div(one + speed * (1.0 / LEAF_FOLD_SPEED)), slow)
}

/// Computes positions of all stations in the plant's space. `fresh`: whether there is no previous step.
pub(crate) struct UpdatePositions<'a> {
    pub(crate) constants: &'a SimulationConstants,
    pub(crate) state: &'a mut SimulationState,
    pub(crate) fresh: bool,
}

impl WithSimd for UpdatePositions<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { constants, state, fresh } = self;
        bend_elements(constants, state, simd);
        place_on_carriers(constants, state, simd);
        accumulate_base_transforms(constants, state);
        place_stations(constants, state, fresh, simd);
    }
}

/// Bends each element in the frame of its base: rotation and position of all of its stations.
#[inline(always)]
fn bend_elements<S: Simd>(constants: &SimulationConstants, state: &mut SimulationState, simd: S) {
    let zero = F64Lanes::from_scalar(simd, 0.0);
    for g in 0..element_groups::<S>(constants) {
        let count = station_count::<S>(constants, g);
        let [x, z] = vector_pair(constants.bend_axes.get(simd, g));
        let [a, _, b, _] = state.first_mode.get(simd, g);
        // Rotation vector of the tip: both bend axes times their angles.
        let bend = x * a + z * b;
        state.bend.put(g, bend.0);
        let second_mode = constants.second_modes.as_ref().filter(|o| g * S::F64_LANES < o.count());
        let mut second_bend = Vec3Lanes([zero; 3]);
        if second_mode.is_some() {
            let [a, _, b, _] = state.second_mode.get(simd, g);
            second_bend = x * a + z * b;
            state.second_bend.put(g, second_bend.0);
        }
        let mut from = Vec3Lanes([zero; 3]);
        for k in 0..count {
            let s = station_group::<S>(constants, k, g);
            let [ax, ay, az, cx, cy, cz, share] = constants.shape.get(simd, s);
            let mut here = bend * share;
            if let Some(second_mode) = second_mode {
                let [share] = second_mode.shape.get(simd, s);
                here = here + second_bend * share;
            }
            // The rotation at a station is that of the tip times the slope profile there; stretches are chained, each rotated as
            // its station is, so that a branch keeps its length at any bend.
            let q = rotation_lanes(here);
            let turned = RotationLanes::from_quaternion(q);
            state.turns.put(s, q);
            state.from.put(s, from.0);
            state.local_positions.put(s, (from + turned.apply(Vec3Lanes([ax, ay, az]))).0);
            if k + 1 < count {
                from = from + turned.apply(Vec3Lanes([cx, cy, cz]));
            }
        }
    }
}

/// Positions each element's base in the frame of its carrier's base.
#[inline(always)]
fn place_on_carriers<S: Simd>(constants: &SimulationConstants, state: &mut SimulationState, simd: S) {
    for link in &constants.order {
        let Some(carrier) = link.carrier else { continue };
        let [first, second] = link.shares;
        // Rotation of the carrier at the base of this element, and the station to which the offset of the base refers.
        let ([a, b, c], [u, v, w]) = (state.bend.row(carrier), state.second_bend.row(carrier));
        let [a, b, c] = [a * first + u * second, b * first + v * second, c * first + w * second];
        let [d, e, f] = state.from.row(link.stand);
        let [x, y, z, w] = state.turns.row(link.stand);
        state.carrier.set(link.row, [a, b, c, d, e, f, x, y, z, w]);
    }
    for g in 0..element_groups::<S>(constants) {
        let [a, b, c, d, e, f, x, y, z, w] = state.carrier.get(simd, g);
        let place = Vec3Lanes([d, e, f])
            + RotationLanes::from_quaternion([x, y, z, w]).apply(Vec3Lanes(constants.base_offset.get(simd, g)));
        let [x, y, z, w] = rotation_lanes(Vec3Lanes([a, b, c]));
        state.link.put(g, [x, y, z, w, place.0[0], place.0[1], place.0[2]]);
    }
}

/// Composes the base transforms from the ground up, in the plant's space.
#[inline(always)]
fn accumulate_base_transforms(constants: &SimulationConstants, state: &mut SimulationState) {
    for link in &constants.order {
        let [x, y, z, w, px, py, pz] = state.link.row(link.row);
        let base = match link.carrier {
            None => [x, y, z, w, px, py, pz],
            Some(carrier) => {
                let [a, b, c, d, ox, oy, oz] = state.bases[carrier];
                // The vector turned by a quaternion: v + 2 w (u x v) + 2 u x (u x v).
                let (tx, ty, tz) = (2.0 * (b * pz - c * py), 2.0 * (c * px - a * pz), 2.0 * (a * py - b * px));
                [
                    // Hamilton product of the carrier's rotation and the link's, then the link's offset turned and added.
                    d * x + a * w + b * z - c * y,
                    d * y - a * z + b * w + c * x,
                    d * z + a * y - b * x + c * w,
                    d * w - a * x - b * y - c * z,
                    ox + px + d * tx + (b * tz - c * ty),
                    oy + py + d * ty + (c * tx - a * tz),
                    oz + pz + d * tz + (a * ty - b * tx),
                ]
            }
        };
        state.bases[link.row] = base;
        state.carried.set(link.row, base);
    }
}

/// Transforms all stations to the plant's space.
#[inline(always)]
fn place_stations<S: Simd>(constants: &SimulationConstants, state: &mut SimulationState, fresh: bool, simd: S) {
    for g in 0..element_groups::<S>(constants) {
        let count = station_count::<S>(constants, g);
        let [x, y, z, w, px, py, pz] = state.carried.get(simd, g);
        let (turned, base) = (RotationLanes::from_quaternion([x, y, z, w]), Vec3Lanes([px, py, pz]));
        for k in 0..count {
            let s = station_group::<S>(constants, k, g);
            let place = base + turned.apply(Vec3Lanes(state.local_positions.get(simd, s)));
            // Positions of the step before give the velocities of stations by a backward difference.
            let before = if fresh { place } else { Vec3Lanes(state.places.get(simd, s)) };
            state.before.put(s, before.0);
            state.places.put(s, place.0);
        }
    }
}

/// Computes loads and advances all oscillators by a step.
pub(crate) struct IntegrateStep<'a> {
    pub(crate) constants: &'a SimulationConstants,
    pub(crate) state: &'a mut SimulationState,
    /// Time step of the integrator, s.
    pub(crate) step: f64,
    /// Scale of the plant: lengths in the world divided by lengths in its own space, in which positions are stored.
    pub(crate) scale: f64,
    /// Whether there is no previous step, so that stations have no velocity.
    pub(crate) fresh: bool,
    /// Position between the two wind samples, 0 to 1.
    pub(crate) between: f64,
    /// Factor on inertial loads; 0 while too few previous steps are known.
    pub(crate) whip: f64,
    /// Whether to relax towards equilibrium without dynamics.
    pub(crate) settle: bool,
}

impl WithSimd for IntegrateStep<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        self.apply_station_loads(simd);
        self.sum_subtree_forces();
        self.advance_oscillators(simd);
    }
}

impl IntegrateStep<'_> {
    /// Computes aerodynamic and inertial loads at every station, and sums them for each element.
    #[inline(always)]
    fn apply_station_loads<S: Simd>(&mut self, simd: S) {
        let (constants, state) = (self.constants, &mut *self.state);
        let zero = Vec3Lanes([F64Lanes::from_scalar(simd, 0.0); 3]);
        let between = F64Lanes::from_scalar(simd, self.between);
        // 1/dt and 1/dt^2 for the differences below, times the scale: velocities and accelerations are those in the world. Inertia
        // acts against the acceleration, hence the sign.
        let (rate, square, whip) = (self.scale / self.step, self.scale / (self.step * self.step), -self.whip);
        for g in 0..element_groups::<S>(constants) {
            let count = station_count::<S>(constants, g);
            let [x, y, z, w, px, py, pz] = state.carried.get(simd, g);
            let (turned, base) = (RotationLanes::from_quaternion([x, y, z, w]), Vec3Lanes([px, py, pz]));
            let ([last], [next]) = (state.shed[0].get(simd, g), state.shed[1].get(simd, g));
            let shed = last + (next - last) * between;
            let (mut total, mut load, mut inertial_load) = (zero, zero, zero);
            for k in 0..count {
                let s = station_group::<S>(constants, k, g);
                let [wood, leaf, lever, inertia, stops] = constants.load_terms.get(simd, s);
                let [rest, along] = vector_pair(constants.rest.get(simd, s));
                let (last, next) = (Vec3Lanes(state.air[0].get(simd, s)), Vec3Lanes(state.air[1].get(simd, s)));
                let air = last + (next - last) * between;
                // Limit on aerodynamic damping: scale the velocity of the station down so that drag takes at most half of it
                // within the step.
                let slowed =
                    F64Lanes::from_scalar(simd, 0.5).div((stops * air.length() * self.step).max(between.splat(0.5)));
                let speed =
                    (Vec3Lanes(state.places.get(simd, s)) - Vec3Lanes(state.before.get(simd, s))) * (slowed * rate);
                // Wind relative to the station, in the frame of the element's base.
                let relative = turned.apply_inverse(air - speed);
                let along = RotationLanes::from_quaternion(state.turns.get(simd, s)).apply(along);
                let (drag, slow) = drag([wood, leaf], along, relative);
                // Vortex shedding pushes across wind and branch with the strength of the drag.
                let sideways = (shed * drag.length()).div(slow.max(slow.splat(MIN_CROSS_SPEED)));
                let force = drag + relative.cross(along) * sideways;
                total = total + force;
                load = load + force * lever;
                // Inertia of being carried: the second difference of the position that the station would have on a rigid
                // element, capped so that a jolt cannot throw twigs.
                let rigid = base + turned.apply(rest);
                let [one, two] = if self.fresh { [rigid; 2] } else { vector_pair(state.rigid.get(simd, s)) };
                let acceleration = (rigid - one - (one - two)) * F64Lanes::from_scalar(simd, square);
                let most = F64Lanes::from_scalar(simd, MAX_INERTIAL_ACCELERATION)
                    .div(acceleration.length().max(between.splat(MAX_INERTIAL_ACCELERATION)));
                inertial_load = inertial_load + acceleration * (most * inertia * whip);
                let ([a, b, c], [d, e, f]) = (rigid.0, one.0);
                state.rigid.put(s, [a, b, c, d, e, f]);
            }
            // The total force, rotated to the plant's space, acts on the carrier.
            let [a, b, c] = turned.apply(total).0;
            let [d, e, f] = inertial_load.0;
            state.forces.put(g, [a, b, c, d, e, f]);
            state.loads.put(g, load.0);
        }
    }

    /// Accumulates forces of subtrees on their carriers, from the tips down.
    #[inline(always)]
    fn sum_subtree_forces(&mut self) {
        for link in self.constants.order.iter().rev() {
            let Some(carrier) = link.carrier else { continue };
            let [x, y, z, ..] = self.state.forces.row(link.row);
            self.state.forces.add(
                carrier,
                [x, y, z, x * link.carrier_compliance, y * link.carrier_compliance, z * link.carrier_compliance],
            );
        }
    }

    /// Advances each oscillator about the static bend under the present load.
    #[inline(always)]
    fn advance_oscillators<S: Simd>(&mut self, simd: S) {
        let (constants, state) = (self.constants, &mut *self.state);
        let (none, left) = (F64Lanes::from_scalar(simd, 0.0), F64Lanes::from_scalar(simd, 0.4));
        for g in 0..element_groups::<S>(constants) {
            let [x, y, z, w, ..] = state.carried.get(simd, g);
            let [_, pulled] = vector_pair(state.forces.get(simd, g));
            let turned = RotationLanes::from_quaternion([x, y, z, w]);
            let mut load = Vec3Lanes(state.loads.get(simd, g)) + turned.apply_inverse(pulled);
            // Gravity relative to the grown pose: the difference of its directions in the frame of the element.
            if let Some([gx, gy, gz]) = constants.gravity {
                let down = Vec3Lanes([
                    F64Lanes::from_scalar(simd, gx),
                    F64Lanes::from_scalar(simd, gy),
                    F64Lanes::from_scalar(simd, gz),
                ]);
                let [weight] = constants.weight.get(simd, g);
                load = load + (turned.apply_inverse(down) - down) * weight;
            }
            let bend_axes = vector_pair(constants.bend_axes.get(simd, g));
            // Rotation vector of a force, growth x force, in components along both bend axes.
            let (a, b) = (bend_axes[1].dot(load), -bend_axes[0].dot(load));
            // Large deflections: the static bend saturates below a right angle.
            let share = large_deflection_factor(a * a + b * b);
            let [c0, c1, c2, c3, d0, d1, d2, d3] = if self.settle {
                [left, none, none, none, left, none, none, none]
            } else {
                constants.oscillator.get(simd, g)
            };
            let [p, v, q, u] = state.first_mode.get(simd, g);
            let (a, b) = (a * share, b * share);
            if let Some(second_mode) =
                constants.second_modes.as_ref().filter(|o| !self.settle && g * S::F64_LANES < o.count())
            {
                advance_second_modes(second_mode, state, g, [a, b]);
            }
            // Exact oscillator step about the static bend.
            let (y, z) = (p - a, q - b);
            state.first_mode.put(g, [a + c0 * y + c1 * v, c2 * y + c3 * v, b + d0 * z + d1 * u, d2 * z + d3 * u]);
        }
    }
}

/// Advances second modes about a share of the deviation of the first modes' static bend `goal`, rad, from its mean.
#[inline(always)]
fn advance_second_modes<S: Simd>(
    second_mode: &SecondModes,
    state: &mut SimulationState,
    g: usize,
    goal: [F64Lanes<S>; 2],
) {
    let simd = goal[0].simd;
    let [c0, c1, c2, c3, d0, d1, d2, d3] = second_mode.oscillator.get(simd, g);
    let ([still, level], [p, v, q, u]) = (state.mean.get(simd, g), state.second_mode.get(simd, g));
    let (a, b) = ((goal[0] - still) * SECOND_MODE_FORCING, (goal[1] - level) * SECOND_MODE_FORCING);
    let (y, z) = (p - a, q - b);
    state.second_mode.put(g, [a + c0 * y + c1 * v, c2 * y + c3 * v, b + d0 * z + d1 * u, d2 * z + d3 * u]);
}

#[cfg(test)]
mod tests {
    use pulp::Scalar;

    use super::*;
    use crate::sway::wood::AIR_DENSITY;

    /// Drag along a wind of `u` m/s, N, of areas of wood and leaves, m^2; `growth`: direction of the wood.
    fn along_wind([wood, leaf]: [f64; 2], growth: [f64; 3], u: f64) -> f64 {
        let lane = |v: f64| F64Lanes::from_scalar(Scalar, v);
        let areas = [wood * 1.1, leaf * 0.4].map(|a| lane(0.5 * AIR_DENSITY * a));
        drag(areas, Vec3Lanes(growth.map(lane)), Vec3Lanes([u, 0.0, 0.0].map(lane))).0.0[0].scalar()
    }

    #[test]
    fn wood_drag_is_quadratic_and_leaf_drag_saturates() {
        const UP: [f64; 3] = [0.0, 1.0, 0.0];
        let (wood, leaf) = ([0.1, 0.0], [0.0, 1.0]);
        assert!((along_wind(wood, UP, 10.0) / along_wind(wood, UP, 5.0) - 4.0).abs() < 1e-9);
        assert!((along_wind(leaf, UP, 60.0) / along_wind(leaf, UP, 30.0) - 2.235).abs() < 1e-3);
        assert!((along_wind(wood, UP, 10.0) - 0.5 * 1.225 * 1.1 * 0.1 * 100.0).abs() < 1e-9);
        assert!(along_wind(wood, [1.0, 0.0, 0.0], 10.0).abs() < 1e-12, "wood along the wind catches none");
    }
}
