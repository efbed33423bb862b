//! Flights of catkins: playback of the simulation frame by frame, with its table, deposition maps and trajectories.

pub(crate) mod assembly;
mod deposition_maps;
mod stats;
mod trajectories;

use std::sync::{Arc, Mutex, PoisonError};

use glam::{DVec3, Vec3};

use crate::bake::assets::catkin::CatkinModel;
use crate::bake::motion::flight::deposition_maps::DepositionMaps;
use crate::bake::motion::flight::trajectories::Trajectories;
use crate::bake::motion::{AssetMotion, FrameTime, TableRow};
use crate::bake::wind::playback::WindPlayback;
use crate::recipe::scene::{FlightBoundary, FlightKeys, FlightRelease};
use crate::recipe::{FlightRecipe, Recipe};
use osier_base::Result;
use osier_base::geometry::Bounds;
use osier_base::math::{ln, narrow};
use osier_base::rng::Rng;
use osier_import::GreyImage;
use osier_motion::flight::{
    Catkin, CatkinKind, CatkinStart, CatkinState, FlightParams, FlightSimulation, GroundHumidity, ReleaseCondition,
    SideBoundary, SkyRelease, sky_starts,
};
use osier_scene::solid::Solids;
use osier_scene::{
    Asset, AssetFrame, AssetKind, Attribute, AttributeData, CurvesFrame, InstanceState, Instancer, InstancerFrame,
    InstancerMotion, Prototype, Table,
};
use osier_wind::Wind;

/// Instance attribute: how often a catkin was recycled to its start.
const GENERATION: &str = "generation";

/// Time constant, s, of the visual settling of a deposited catkin, whose bounding ball touches before its hairs do. Own: by eye;
/// longer shows it hover, shorter shows it jump.
const SETTLE_TIME: f32 = 0.12;

/// A flight that can be evaluated at any frame. Frames in rising order cost one step each; an earlier frame restarts it.
#[derive(Debug)]
pub struct FlightPlayback {
    start: FlightSimulation,
    /// Frames simulated before the first of the clip.
    spin_up: u64,
    deposits: DepositionMaps,
    /// Points of the hairs of each kind, m.
    hairs: Vec<Vec<Vec3>>,
    settle: bool,
    /// Width of the trajectories at the catkins, m.
    trail_width: f32,
    state: Mutex<FlightState>,
}

#[derive(Debug)]
struct FlightState {
    simulation: FlightSimulation,
    /// Frames done, counted from the start of the spin-up.
    frames: u64,
    wind: WindPlayback,
    /// Offset, m, by which each deposited catkin is drawn closer to the surface that it lies on.
    settled: Vec<Vec3>,
    trails: Option<Trajectories>,
}

/// The parts of a scene that a flight takes place in.
pub(crate) struct FlightContext<'a> {
    pub recipe: &'a Recipe,
    pub flight: &'a FlightRecipe,
    /// Box of the flight, m; its sides are the side boundary.
    pub domain: Bounds,
    /// Obstacles and land.
    pub solids: Arc<Solids>,
    /// Least height above a surface at which the wind is known, m.
    pub known_height: f64,
    /// Width of a lattice wind's cells, m; `None` for an analytic wind.
    pub cell_size: Option<f64>,
    /// Release points of a canopy.
    pub twigs: &'a [TwigTip],
}

/// A twig's end that releases catkins.
#[derive(Debug, Clone, Copy)]
pub(crate) struct TwigTip {
    /// Position in the world, m.
    pub(crate) position: Vec3,
    /// Share of the catkins that start here, relative to the other tips; the weight of its plant.
    pub(crate) weight: f64,
}

impl FlightPlayback {
    /// A flight at its first frame.
    pub(crate) fn new(scene: &FlightContext<'_>, wind: WindPlayback, models: &[CatkinModel]) -> Self {
        let keys = &scene.flight.keys;
        let params = flight_params(scene, models);
        let starts = catkin_starts(scene, &params);
        let start = FlightSimulation::new(params, Arc::clone(&scene.solids), &starts);
        let trails = new_trajectories(scene, start.options());
        let settled = vec![Vec3::ZERO; start.len()];
        let mut state = FlightState { simulation: start.clone(), frames: 0, wind, settled, trails };
        state.extend_trajectories();
        let hairs = |m: &CatkinModel| m.tuft().hairs.points.clone();
        Self {
            spin_up: spin_up_frames(scene.flight, scene.recipe),
            deposits: DepositionMaps::new(keys, scene.domain, &scene.solids),
            hairs: models.iter().map(hairs).collect(),
            settle: keys.settle,
            trail_width: narrow(keys.trail_width),
            state: Mutex::new(state),
            start,
        }
    }

    /// Number of catkins for which no start outside of solids was found.
    pub fn enclosed_start_count(&self) -> u64 {
        self.start.stats().buried
    }

    /// Declarations of the flight's table and deposition maps, which frames fill. `warnings`: those so far, by code.
    pub fn table_and_fields(
        &self,
        keys: &FlightKeys,
        warnings: Vec<(&'static str, String)>,
    ) -> (Table, &[osier_scene::Field]) {
        let lattice = self.state.lock().unwrap_or_else(PoisonError::into_inner).wind.lattice_stats();
        let solids: Vec<&str> = self.start.solids().list().iter().map(|s| s.name.as_str()).collect();
        (stats::flight_table(keys, self.start.len(), &solids, lattice, warnings), &self.deposits.fields)
    }

    /// The asset at rest: at the start of the spin-up, or in a `still` scene at the scene's one frame. `material`: index in the
    /// scene of the trajectories' material.
    /// # Errors
    /// `TooMany`; those of [`WindPlayback::wind_between`].
    pub fn asset(&self, prototypes: Vec<Prototype>, material: u32, still: bool) -> Result<Asset> {
        let all: Vec<&Catkin> = self.start.by_id().collect();
        let instancer = Instancer {
            name: "catkins".into(),
            prototypes,
            ids: (0..all.len() as u64).collect(),
            protos: all.iter().map(|c| u32::from(c.kind())).collect(),
            scales: all.iter().map(|c| Vec3::splat(c.scale())).collect(),
            rest: if still { self.state_at(0)? } else { self.initial_state() },
            motion: InstancerMotion::Free,
            tracked: true,
        };
        let curves = |state: &mut FlightState| {
            state.trails.as_ref().map(|t| t.curves(self.trail_width, material, !still)).transpose()
        };
        let trails = if still {
            self.at_frame(0, curves)??
        } else {
            curves(&mut self.state.lock().unwrap_or_else(PoisonError::into_inner))?
        };
        Ok(Asset {
            id: "catkins".into(),
            kind: AssetKind::Tracks,
            group: String::new(),
            skeleton: None,
            meshes: Vec::new(),
            instancers: vec![instancer],
            points: Vec::new(),
            curves: trails.into_iter().collect(),
        })
    }

    /// The wind at a frame of the clip, and the time at which to sample it, s.
    /// # Errors
    /// Those of [`WindPlayback::wind_between`].
    pub fn wind_at(&self, number: u64) -> Result<(Arc<dyn Wind>, f64)> {
        let fps = self.start.options().fps;
        let frame = self.spin_up + number;
        // The wind of the step that ended at this frame, which is at hand; the next one would advance the lattice.
        let wind = self.at_frame(number, |state| state.wind.wind_between(frame.saturating_sub(1), fps))??;
        Ok((wind, frame as f64 / fps))
    }

    /// Brings the simulation to a frame of the clip and evaluates its state there.
    fn at_frame<R>(&self, number: u64, evaluate: impl FnOnce(&mut FlightState) -> R) -> Result<R> {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        let target = self.spin_up + number;
        // The simulation cannot step back: an earlier frame starts it again, spin-up included.
        if state.frames > target {
            state.simulation = self.start.clone();
            state.settled.fill(Vec3::ZERO);
            state.frames = 0;
            state.trails.iter_mut().for_each(Trajectories::clear);
            state.extend_trajectories();
        }
        while state.frames < target {
            let (frame, fps) = (state.frames, state.simulation.options().fps);
            let wind = state.wind.wind_between(frame, fps)?;
            state.simulation.advance_frame(&*wind);
            state.frames += 1;
            self.settle_deposited(&mut state);
            state.extend_trajectories();
        }
        Ok(evaluate(&mut state))
    }

    /// Lowers deposited catkins until their lowest hair touches, and raises those that lift off again, with the time constant
    /// [`SETTLE_TIME`]. Only their drawing moves, not the simulation.
    fn settle_deposited(&self, state: &mut FlightState) {
        if !self.settle {
            return;
        }
        // Exponential approach: after one frame the share 1 - exp(-dt/tau) of the remaining way is done.
        let share = 1.0 - osier_base::math::exp_f32(-narrow(1.0 / state.simulation.options().fps) / SETTLE_TIME);
        let FlightState { simulation, settled, .. } = state;
        for (c, settled) in simulation.by_id().zip(settled) {
            let goal = if c.state().is_deposited() { self.gap_below_hairs(c) } else { Vec3::ZERO };
            *settled += (goal - *settled) * share;
        }
    }

    /// Vector from the lowest hair to the lowest point of the bounding ball, m, along the normal of the surface. In a corner of
    /// wall and ground the ground's normal counts.
    fn gap_below_hairs(&self, c: &Catkin) -> Vec3 {
        let normal = if c.state() == CatkinState::Corner { Vec3::Y } else { c.rests_on().1 };
        let out = c.turn().conjugate() * normal;
        let hairs = self.hairs.get(usize::from(c.kind())).map_or(&[][..], Vec::as_slice);
        let lowest = hairs.iter().map(|p| p.dot(out)).fold(0.0, f32::min);
        -normal * (c.radius() + lowest * c.scale()).max(0.0)
    }

    fn state_at(&self, number: u64) -> Result<InstanceState> {
        self.at_frame(number, |state| state.instance_state())
    }

    /// The catkins before the first step, for the asset at rest.
    fn initial_state(&self) -> InstanceState {
        self.state.lock().unwrap_or_else(PoisonError::into_inner).instance_state()
    }
}

impl AssetMotion for FlightPlayback {
    fn frame(&self, _asset: &Asset, time: FrameTime) -> Result<AssetFrame> {
        self.at_frame(time.index(), |state| AssetFrame {
            instancers: vec![InstancerFrame::State(state.instance_state())],
            curves: state.trails.iter().map(|t| CurvesFrame::Points(t.points().to_vec())).collect(),
            ..AssetFrame::default()
        })
    }

    fn row(&self, frame: u64) -> Result<Option<TableRow>> {
        self.at_frame(frame, |state| Some(TableRow { table: stats::TABLE, values: state.table_row() }))
    }

    fn fields(&self, frame: u64) -> Result<Vec<Vec<f32>>> {
        self.at_frame(frame, |state| self.deposits.densities(&state.simulation))
    }
}

impl FlightState {
    fn table_row(&self) -> Vec<f64> {
        stats::flight_row(&self.simulation.stats(), &self.simulation.deposits_per_solid(), self.wind.lattice_stats())
    }

    /// Appends the current positions to the trajectories.
    fn extend_trajectories(&mut self) {
        if let Some(mut trails) = self.trails.take() {
            let state = self.instance_state();
            trails.push(&state, state.attribute(GENERATION).and_then(AttributeData::integers).unwrap_or_default());
            self.trails = Some(trails);
        }
    }

    /// Transforms and attributes of all catkins, settling included, in the order of their ids.
    fn instance_state(&self) -> InstanceState {
        let s = self.simulation.frame();
        let number = |v: &u32| i32::try_from(*v).unwrap_or(i32::MAX);
        InstanceState {
            positions: s.positions.iter().zip(&self.settled).map(|(p, settled)| *p + *settled).collect(),
            orientations: s.orientations,
            alive: s.states.iter().map(|s| s.is_seen()).collect(),
            velocities: s.velocities,
            angular_velocities: s.angular_velocities,
            attributes: vec![
                Attribute::instance("state", AttributeData::I32(s.states.iter().map(|s| *s as i32).collect())),
                Attribute::instance("cluster", AttributeData::I32(s.clusters.iter().map(number).collect())),
                Attribute::instance(GENERATION, AttributeData::I32(s.generations.iter().map(number).collect())),
            ],
        }
    }
}

/// Trajectories of the length that `flight.trails` asks for; `None` where it is 0. A catkin that moves by more than half the
/// domain's width in a frame was recycled or wrapped.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most ten minutes of frames")]
fn new_trajectories(scene: &FlightContext<'_>, params: &FlightParams) -> Option<Trajectories> {
    let frames = (scene.flight.keys.trails * params.fps).round() as usize;
    let size = scene.domain.size();
    (frames > 0).then(|| Trajectories::new(frames + 1, size.x.min(size.z) / 2.0))
}

/// Frames of the spin-up, simulated before the first frame of the clip.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most an hour of frames")]
pub(crate) fn spin_up_frames(flight: &FlightRecipe, recipe: &Recipe) -> u64 {
    (flight.keys.spin_up * recipe.clip.fps()).round() as u64
}

/// Parameters of the simulation from the keys of `[flight]`.
fn flight_params(scene: &FlightContext<'_>, models: &[CatkinModel]) -> FlightParams {
    let (recipe, keys) = (scene.recipe, &scene.flight.keys);
    let forms = &scene.flight.forms;
    let kind = |(i, m): (usize, &CatkinModel)| CatkinKind { radius: m.radius, weight: forms[i % forms.len().max(1)] };
    // Catkins released all over the sky are recycled unless the keys say otherwise, so that their number stays.
    let default = if keys.release == FlightRelease::Sky { FlightBoundary::Recycle } else { FlightBoundary::Exit };
    let edge = match keys.sides.unwrap_or(default) {
        FlightBoundary::Exit => SideBoundary::Exit,
        FlightBoundary::Recycle => SideBoundary::Recycle,
        FlightBoundary::Periodic => SideBoundary::Periodic,
    };
    let map = |wet: &GreyImage| GroundHumidity::Map { width: wet.width, values: wet.values.clone() };
    FlightParams {
        seed: recipe.general.seed,
        fps: recipe.clip.fps(),
        substeps: keys.substeps,
        inside: scene.domain,
        edges: [edge; 2],
        band: keys.band,
        kinds: models.iter().enumerate().map(kind).collect(),
        scales: keys.scale,
        mass: keys.mass,
        fall: keys.fall,
        fall_spread: keys.fall_spread,
        glide: keys.glide,
        inertia: keys.inertia,
        cluster_rotation: keys.cluster_rotation,
        beta: keys.beta,
        release_rate: keys.release_rate,
        release_speed: keys.release_speed,
        stick_radius: keys.stick_radius,
        stick_probability: keys.stick_probability,
        stick_close: keys.stick_close,
        check_every: keys.check_every,
        gamma: keys.gamma,
        humidity: scene.flight.wet.as_ref().map_or(GroundHumidity::Even(keys.humidity), map),
        lift_speed: keys.lift_speed,
        lift_wet: keys.lift_wet,
        known_height: scene.known_height,
        // A catkin that crosses a cell of the wind in one step would miss what the wind does there.
        longest_step: scene.cell_size.unwrap_or(f64::INFINITY),
        flutter: keys.flutter,
        ..FlightParams::default()
    }
}

/// Where and under which condition each catkin is released.
fn catkin_starts(scene: &FlightContext<'_>, params: &FlightParams) -> Vec<CatkinStart> {
    let (flight, keys) = (scene.flight, &scene.flight.keys);
    let seed = scene.recipe.general.seed;
    let from_sky = |duration| {
        let sky_box = SkyRelease { seed, count: keys.count, inside: params.inside, band: keys.band, duration };
        sky_starts(&sky_box, &scene.solids)
    };
    match keys.release {
        FlightRelease::Sky => from_sky(0.0),
        FlightRelease::Rain => from_sky(keys.duration),
        FlightRelease::Points => {
            let start = |p: &[f64; 3]| CatkinStart { at: DVec3::from_array(*p), wait: ReleaseCondition::Until(0.0) };
            flight.starts.iter().map(start).collect()
        }
        FlightRelease::Canopy => canopy_starts(scene.twigs, keys.count, seed),
    }
}

/// Starts at twig tips drawn by weight. Each catkin waits for a wind exposure drawn from the unit exponential distribution.
fn canopy_starts(twigs: &[TwigTip], count: u32, seed: u64) -> Vec<CatkinStart> {
    // Cumulative weights: a uniform draw times their total falls into one tip's interval.
    let mut cumulative = Vec::with_capacity(twigs.len());
    let mut sum = 0.0;
    for tip in twigs {
        sum += tip.weight;
        cumulative.push(sum);
    }
    if sum <= 0.0 {
        return Vec::new();
    }
    (0..count)
        .map(|id| {
            let mut draw = Rng::at(seed, &["flight".into(), id.into(), 0_u64.into(), "start".into()]);
            let pick = draw.unit_f64() * sum;
            let twig = cumulative.partition_point(|s| *s <= pick).min(twigs.len() - 1);
            // A normal offset of 5 cm, so that the catkins of one tip do not start in one point and stick together.
            let offset = DVec3::new(draw.normal(), draw.normal(), draw.normal()) * 0.05;
            CatkinStart {
                at: twigs[twig].position.as_dvec3() + offset,
                // The inverse distribution function of the unit exponential: -ln(1 - u).
                wait: ReleaseCondition::Wind(-ln(1.0 - draw.unit_f64())),
            }
        })
        .collect()
}
