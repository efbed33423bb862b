//! Time integration of sway.
//!
//! Each element is a damped oscillator about the static bend under the present load. `constants.rs` holds what
//! stays constant, `step.rs` computes a step, this file samples the wind.

mod constants;
mod step;

use glam::{DVec3, Vec3};
use pulp::Arch;

use self::constants::SimulationConstants;
use self::step::{IntegrateStep, SimulationState, UpdatePositions};
use crate::sway::elements::{BeamElement, BeamElements};
use crate::sway::tuning::{MAX_FLICKER_HZ, STEPS_PER_SECOND, VORTEX_FORCE, WIND_SAMPLES_PER_SECOND};
use crate::sway::wood::WoodParams;
use osier_base::rng;
use osier_scene::Trs;
use osier_wind::{TimeNoise, Wind};

/// Material and placement of a plant, and how branches excite themselves beyond the wind field.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SwayParams {
    /// Stiffness, density, drag and damping of wood and leaves.
    pub wood: WoodParams,
    /// Relative strength, 0..1, of a fluctuation of the wind that differs from branch to branch, and of vortex shedding.
    pub flicker: f64,
    /// Factor on the inertial force that a moving carrier exerts on twigs, 0..3.
    pub whip: f64,
    /// World from plant space: position, rotation and scale of the plant.
    pub stand: Trs,
    /// Gravitational acceleration that acts on deviations from the grown pose, m/s^2; `None` if gravity is taken as balanced in
    /// any pose.
    pub gravity: Option<f64>,
    /// Frame rate of the clip, 1/s.
    pub fps: f64,
}

/// Sway of one plant in a wind: a damped oscillator for each bend, advanced in steps of at most 1/120 s.
pub struct SwaySimulation<'a> {
    elements: &'a BeamElements,
    wind: &'a dyn Wind,
    params: SwayParams,
    /// Time step of the integrator, s.
    step: f64,
    constants: SimulationConstants,
    state: SimulationState,
    /// Noise of flicker and vortex shedding of each element.
    element_noise: Vec<[TimeNoise; 2]>,
    /// Steps since positions were reset; inertial loads need two.
    steps_since_reset: u32,
    /// Steps since the last wind sample.
    steps_since_sample: u32,
    /// Positions of the stations in the world, m, and the wind there, m/s.
    world: Vec<Vec3>,
    station_wind: Vec<Vec3>,
    arch: Arch,
}

impl<'a> SwaySimulation<'a> {
    /// A simulation with all elements in the grown pose, at rest.
    pub fn new(elements: &'a BeamElements, wind: &'a dyn Wind, params: SwayParams) -> Self {
        // A whole number of steps per frame.
        let per_frame = (STEPS_PER_SECOND / params.fps).ceil().max(1.0);
        let step = (params.fps * per_frame).recip();
        let constants = SimulationConstants::new(elements, &params, step);
        let stations = elements.stations.len();
        Self {
            state: SimulationState::new(&constants),
            element_noise: elements.list.iter().map(|e| element_noise(e, wind.period())).collect(),
            steps_since_reset: 0,
            steps_since_sample: 0,
            world: vec![Vec3::ZERO; stations],
            station_wind: vec![Vec3::ZERO; stations],
            arch: Arch::new(),
            constants,
            elements,
            wind,
            params,
            step,
        }
    }

    /// Time steps per frame, at least 1.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few")]
    pub fn steps(&self) -> u32 {
        (1.0 / (self.step * self.params.fps)).round() as u32
    }

    /// Both bending angles of each element, rad, then those of second modes.
    pub fn bends(&self) -> Vec<[f64; 2]> {
        let bend = |row: &usize| {
            let [a, _, b, _] = self.state.first_mode.row(*row);
            [a, b]
        };
        let second_mode = self.constants.second_modes.iter().flat_map(|o| &o.rows);
        let second_bend = |row: &usize| {
            let [a, _, b, _] = self.state.second_mode.row(*row);
            [a, b]
        };
        self.constants.rows.iter().map(bend).chain(second_mode.map(second_bend)).collect()
    }

    /// Resets all elements to the grown pose, at rest.
    pub fn reset_to_rest(&mut self) {
        self.state.first_mode.clear();
        self.state.second_mode.clear();
        self.steps_since_reset = 0;
    }

    /// Moves all elements to their static equilibrium in the mean wind at time 0, as [`SwaySimulation::relax_to_mean_wind_at`].
    pub fn relax_to_mean_wind(&mut self) {
        self.relax_to_mean_wind_at(0.0);
    }

    /// Moves all elements to their static equilibrium in the mean wind at time `t`, s, without dynamics, in 24 iterations.
    pub fn relax_to_mean_wind_at(&mut self, t: f64) {
        // Under-relaxed fixed-point iteration: the load depends on the pose through drag and gravity.
        for _ in 0..24 {
            self.update_positions(true);
            let stand = self.params.stand;
            for (s, row) in self.elements.stations.iter().zip(&self.constants.stations) {
                let place = stand.apply(to_dvec3(self.state.places.row(*row)).as_vec3());
                let air = stand.r.conjugate() * self.wind.mean_at_time(place, t) * s.open;
                self.state.air.iter_mut().for_each(|a| a.set(*row, air.as_dvec3().to_array()));
            }
            self.integrate(0.0, true);
        }
        for row in &self.constants.rows {
            let [a, _, b, _] = self.state.first_mode.row(*row);
            self.state.mean.set(*row, [a, b]);
        }
        self.steps_since_reset = 0;
    }

    /// Advances by one time step from time `t`, s; samples the wind when the interval between two samples is over.
    pub fn advance(&mut self, t: f64) {
        // Keep two wind samples around the present time: one is shifted out when the interval is over.
        let every = steps_per_wind_sample(self.step);
        self.update_positions(self.steps_since_reset == 0);
        if self.steps_since_reset == 0 || self.steps_since_sample == every {
            if self.steps_since_reset == 0 {
                self.sample_wind(t);
            }
            self.sample_wind(t + self.step * f64::from(every));
            self.steps_since_sample = 0;
        }
        self.integrate(f64::from(self.steps_since_sample) / f64::from(every), false);
        self.steps_since_sample += 1;
        self.steps_since_reset = self.steps_since_reset.saturating_add(1);
    }

    fn update_positions(&mut self, fresh: bool) {
        self.arch.dispatch(UpdatePositions { constants: &self.constants, state: &mut self.state, fresh });
    }

    fn integrate(&mut self, between: f64, settle: bool) {
        self.arch.dispatch(IntegrateStep {
            constants: &self.constants,
            state: &mut self.state,
            step: self.step,
            scale: f64::from(self.params.stand.s.x),
            fresh: settle || self.steps_since_reset == 0,
            between,
            // The second difference of positions needs two earlier steps; in equilibrium nothing accelerates.
            whip: if settle || self.steps_since_reset < 2 { 0.0 } else { self.params.whip },
            settle,
        });
    }

    /// Samples the wind at time `t`, s, at all stations, in the plant's space, with flicker and vortex shedding.
    fn sample_wind(&mut self, t: f64) {
        let stand = self.params.stand;
        let back = stand.r.conjugate();
        for (w, row) in self.world.iter_mut().zip(&self.constants.stations) {
            // Sample the wind at world positions, then rotate it to the plant's space.
            *w = stand.apply(to_dvec3(self.state.places.row(*row)).as_vec3());
        }
        self.wind.sample(&self.world, t, &mut self.station_wind);
        // The older sample becomes the first of the interval.
        self.state.air.swap(0, 1);
        self.state.shed.swap(0, 1);
        for (e, element) in self.elements.list.iter().enumerate() {
            let [gust, eddy] = self.element_noise[e].map(|noise| noise.at(t));
            self.state.shed[1].set(self.constants.rows[e], [VORTEX_FORCE * self.params.flicker * f64::from(eddy)]);
            let factor = 1.0 + osier_base::math::narrow(self.params.flicker) * gust;
            for i in element.stations.clone() {
                let air = back * self.station_wind[i] * (self.elements.stations[i].open * factor);
                self.state.air[1].set(self.constants.stations[i], air.as_dvec3().to_array());
            }
        }
    }
}

fn to_dvec3(v: [f64; 3]) -> DVec3 {
    DVec3::from_array(v)
}

/// Number of time steps between two wind samples, at least 1.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few")]
fn steps_per_wind_sample(step: f64) -> u32 {
    (1.0 / (step * WIND_SAMPLES_PER_SECOND)).round().max(1.0) as u32
}

/// Noise of flicker and of vortex shedding of an element, periodic if the wind is.
fn element_noise(e: &BeamElement, period: Option<f64>) -> [TimeNoise; 2] {
    let mut draw = rng::Rng::from_key(rng::child(e.id, rng::word("flicker")));
    let hertz = e.w[0] / std::f64::consts::TAU;
    // Flicker near the natural frequency of the element, spread by 30 % so that neighbours do not beat together; shedding at
    // that frequency.
    let wanted = [(hertz * draw.range(0.7, 1.3)).min(MAX_FLICKER_HZ), hertz.min(2.0 * MAX_FLICKER_HZ)];
    #[allow(clippy::cast_possible_truncation, reason = "half of a hash is a hash")]
    wanted.map(|hertz| TimeNoise::new((draw.next_u64() >> 32) as u32, hertz, period))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sway::testing::leafy;
    use osier_wind::{GustWind, GustWindOptions};

    #[test]
    fn results_are_independent_of_the_simd_width() {
        let wood = WoodParams { stiffness: 0.1, measured: true, second_modes: true, ..WoodParams::default() };
        let elements = BeamElements::build(&leafy(23), &wood, 1000);
        let wind = GustWind::new(GustWindOptions { speed: 40.0, seed: 3, ..GustWindOptions::default() });
        let params =
            SwayParams { wood, flicker: 0.15, whip: 1.0, stand: Trs::IDENTITY, gravity: Some(9.81), fps: 24.0 };
        let run = |arch: Arch| {
            let mut sim = SwaySimulation { arch, ..SwaySimulation::new(&elements, &wind, params) };
            sim.relax_to_mean_wind();
            (0..600_u32).for_each(|k| sim.advance(f64::from(k) / 120.0));
            sim.bends().iter().flatten().map(|b| b.to_bits()).collect::<Vec<u64>>()
        };
        let one = run(Arch::Scalar);
        assert_eq!(one, run(Arch::new()));
        let far = one.iter().map(|b| f64::from_bits(*b).abs()).fold(0.0, f64::max);
        assert!(far > 0.3, "a storm bends farther than short series reach: {far}");
    }
}
