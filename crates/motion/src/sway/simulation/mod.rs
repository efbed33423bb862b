//! Branches swinging in the wind, step by step.
//!
//! Each element is an oscillator about the bend that the wind of the moment would hold it at. What stays is in
//! `constants.rs`, what a step does in `step.rs`; this file knows the wind.

mod constants;
mod step;

use glam::{DVec3, Vec3};
use pulp::Arch;

use self::constants::SimulationConstants;
use self::step::{IntegrateStep, SimulationState, UpdatePositions};
use crate::sway::elements::{BeamElement, BeamElements};
use crate::sway::wood::WoodParams;
use osier_base::rng;
use osier_scene::Trs;
use osier_wind::{TimeNoise, Wind};

/// Steps a second, at least.
const STEPS_PER_SECOND: f64 = 120.0;
/// Looks at the wind a second, at least.
const WIND_SAMPLES_PER_SECOND: f64 = 24.0;
/// Push across the wind by eddies that a branch sheds, over its drag and its flicker.
const VORTEX_FORCE: f64 = 2.0;
/// Fastest flicker of the wind at one branch, Hz.
const MAX_FLICKER_HZ: f64 = 3.0;

/// How a plant takes the wind.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SwayParams {
    /// What it is made of.
    pub wood: WoodParams,
    /// Strength of each branch's own flicker over the wind, 0..1; eddies that it sheds go with it.
    pub flicker: f64,
    /// Factor on how twigs lag behind the branch that throws them, 0..3.
    pub whip: f64,
    /// Where the plant stands: from its own space to the world.
    pub stand: Trs,
    /// Gravity presses where branches lean away from how they grew.
    pub gravity: bool,
    /// Frames a second.
    pub fps: f64,
}

/// A plant in motion.
pub struct SwaySimulation<'a> {
    elements: &'a BeamElements,
    wind: &'a dyn Wind,
    manner: SwayParams,
    /// Length of a step, s.
    step: f64,
    constants: SimulationConstants,
    state: SimulationState,
    /// Flicker and shed eddies of each element.
    element_noise: Vec<[TimeNoise; 2]>,
    /// Steps since the places were last unknown.
    known: u32,
    /// Steps since the air was looked up.
    since: u32,
    /// Places of the stations in the world, and the air there.
    world: Vec<Vec3>,
    station_wind: Vec<Vec3>,
    arch: Arch,
}

impl<'a> SwaySimulation<'a> {
    /// At rest.
    pub fn new(elements: &'a BeamElements, wind: &'a dyn Wind, manner: SwayParams) -> Self {
        let per_frame = (STEPS_PER_SECOND / manner.fps).ceil().max(1.0);
        let step = (manner.fps * per_frame).recip();
        let constants = SimulationConstants::new(elements, &manner, step);
        let stations = elements.stations.len();
        Self {
            state: SimulationState::new(&constants),
            element_noise: elements.list.iter().map(|e| element_noise(e, wind.period())).collect(),
            known: 0,
            since: 0,
            world: vec![Vec3::ZERO; stations],
            station_wind: vec![Vec3::ZERO; stations],
            arch: Arch::new(),
            constants,
            elements,
            wind,
            manner,
            step,
        }
    }

    /// Steps in a frame.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few")]
    pub fn steps(&self) -> u32 {
        (1.0 / (self.step * self.manner.fps)).round() as u32
    }

    /// Bends of both ways, rad, per element, then those of second modes.
    pub fn bends(&self) -> Vec<[f64; 2]> {
        let bend = |row: &usize| {
            let [a, _, b, _] = self.state.first_mode.row(*row);
            [a, b]
        };
        let over = self.constants.second_modes.iter().flat_map(|o| &o.rows);
        let ring = |row: &usize| {
            let [a, _, b, _] = self.state.second_mode.row(*row);
            [a, b]
        };
        self.constants.rows.iter().map(bend).chain(over.map(ring)).collect()
    }

    /// Puts every element back to how it grew.
    pub fn reset_to_rest(&mut self) {
        self.state.first_mode.clear();
        self.state.second_mode.clear();
        self.known = 0;
    }

    /// Puts every element where a steady wind of the mean would hold it, at rest.
    pub fn relax_to_mean_wind(&mut self) {
        for _ in 0..24 {
            self.update_positions(true);
            let stand = self.manner.stand;
            for (s, row) in self.elements.stations.iter().zip(&self.constants.stations) {
                let height = stand.apply(vector(self.state.places.row(*row)).as_vec3()).y;
                let air = stand.r.conjugate() * self.wind.mean_at(height) * s.open;
                self.state.air.iter_mut().for_each(|a| a.set(*row, air.as_dvec3().to_array()));
            }
            self.integrate(0.0, true);
        }
        for row in &self.constants.rows {
            let [a, _, b, _] = self.state.first_mode.row(*row);
            self.state.mean.set(*row, [a, b]);
        }
        self.known = 0;
    }

    /// Goes on by a step from time `t`, s.
    pub fn advance(&mut self, t: f64) {
        let every = steps_per_wind_sample(self.step);
        self.update_positions(self.known == 0);
        if self.known == 0 || self.since == every {
            if self.known == 0 {
                self.sample_wind(t);
            }
            self.sample_wind(t + self.step * f64::from(every));
            self.since = 0;
        }
        self.integrate(f64::from(self.since) / f64::from(every), false);
        self.since += 1;
        self.known = self.known.saturating_add(1);
    }

    fn update_positions(&mut self, fresh: bool) {
        self.arch.dispatch(UpdatePositions { constants: &self.constants, state: &mut self.state, fresh });
    }

    fn integrate(&mut self, between: f64, settle: bool) {
        self.arch.dispatch(IntegrateStep {
            constants: &self.constants,
            state: &mut self.state,
            step: self.step,
            fresh: settle || self.known == 0,
            between,
            whip: if settle || self.known < 2 { 0.0 } else { self.manner.whip },
            settle,
        });
    }

    /// Looks up the air of a moment, at all stations in the plant's space: `WIND_SAMPLES_PER_SECOND` times a second, linear between.
    fn sample_wind(&mut self, t: f64) {
        let stand = self.manner.stand;
        let back = stand.r.conjugate();
        for (w, row) in self.world.iter_mut().zip(&self.constants.stations) {
            *w = stand.apply(vector(self.state.places.row(*row)).as_vec3());
        }
        self.wind.sample(&self.world, t, &mut self.station_wind);
        self.state.air.swap(0, 1);
        self.state.shed.swap(0, 1);
        for (e, element) in self.elements.list.iter().enumerate() {
            let [gust, eddy] = self.element_noise[e].map(|noise| noise.at(t));
            self.state.shed[1].set(self.constants.rows[e], [VORTEX_FORCE * self.manner.flicker * f64::from(eddy)]);
            let factor = 1.0 + osier_base::math::narrow(self.manner.flicker) * gust;
            for i in element.stations.clone() {
                let air = back * self.station_wind[i] * (self.elements.stations[i].open * factor);
                self.state.air[1].set(self.constants.stations[i], air.as_dvec3().to_array());
            }
        }
    }
}

fn vector(v: [f64; 3]) -> DVec3 {
    DVec3::from_array(v)
}

/// Steps between two looks at the wind.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few")]
fn steps_per_wind_sample(step: f64) -> u32 {
    (1.0 / (step * WIND_SAMPLES_PER_SECOND)).round().max(1.0) as u32
}

/// Noises of an element that repeat with the wind.
fn element_noise(e: &BeamElement, period: Option<f64>) -> [TimeNoise; 2] {
    let mut draw = rng::Rng::from_key(rng::child(e.id, rng::word("flicker")));
    let hertz = e.w[0] / std::f64::consts::TAU;
    let wanted = [(hertz * draw.range(0.7, 1.3)).min(MAX_FLICKER_HZ), hertz.min(2.0 * MAX_FLICKER_HZ)];
    #[allow(clippy::cast_possible_truncation, reason = "half of a hash is a hash")]
    wanted.map(|hertz| TimeNoise::new((draw.next_u64() >> 32) as u32, hertz, period))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sway::segments::ElementBudget;
    use crate::sway::testing::leafy;
    use osier_wind::{GustWind, GustWindOptions};

    #[test]
    fn every_width_of_lanes_gives_the_same_bits() {
        let wood = WoodParams { stiffness: 0.1, measured: true, second_modes: true, ..WoodParams::default() };
        let elements = BeamElements::build(&leafy(23), &wood, ElementBudget::Elements(1000));
        let wind = GustWind::new(GustWindOptions { speed: 40.0, seed: 3, ..GustWindOptions::default() });
        let manner = SwayParams { wood, flicker: 0.15, whip: 1.0, stand: Trs::IDENTITY, gravity: true, fps: 24.0 };
        let run = |arch: Arch| {
            let mut sim = SwaySimulation { arch, ..SwaySimulation::new(&elements, &wind, manner) };
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
