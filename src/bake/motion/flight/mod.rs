//! Flights of catkins: playback of the simulation frame by frame, with its table, deposition maps and trajectories.

pub(crate) mod assembly;
pub(crate) mod canopy;
mod deposition_maps;
mod points;
mod side_jumps;
mod stats;
mod trajectories;
mod volumes;

use std::sync::{Arc, Mutex, PoisonError};

use glam::{DVec3, Vec3};

use crate::bake::assets::catkin::CatkinModel;
use crate::bake::motion::flight::canopy::{Canopy, CatkinSite, TwigPositions};
use crate::bake::motion::flight::deposition_maps::{DepositionMaps, TexelSums};
use crate::bake::motion::flight::side_jumps::SideJumps;
use crate::bake::motion::flight::trajectories::Trajectories;
use crate::bake::motion::flight::volumes::FlightVolumes;
use crate::bake::motion::{AssetMotion, FrameTime, TableRow};
use crate::bake::scene::builder::CATKINS_ID;
use crate::bake::wind::scene_wind::{SceneWind, WindUser};
use crate::recipe::scene::{FlightBoundary, FlightKeys, FlightRelease, FlightZoneKeys, WindModel};
use crate::recipe::{FlightRecipe, Recipe};
use osier_base::Result;
use osier_base::convert::to_usize;
use osier_base::geometry::Bounds;
use osier_base::math::narrow;
use osier_import::GreyImage;
use osier_motion::flight::{
    Catkin, CatkinKind, CatkinStart, CatkinState, FlightParams, FlightSimulation, GroundHumidity, ReleaseCondition,
    SideBoundary, SkyRelease, sky_starts,
};
use osier_scene::solid::Solids;
use osier_scene::{
    Asset, AssetFrame, AssetKind, Attribute, AttributeData, CurvesFrame, InstanceState, Instancer, InstancerFrame,
    InstancerMotion, Prototype, RecordTable, Table, VolumeFrame, attribute_number,
};
use osier_wind::{ShiftedWind, Wind};

/// Name of the instance attribute that counts how often a catkin was recycled to its start.
const GENERATION: &str = "generation";

/// Time constant, s, with which a deposited catkin settles visually, since its bounding ball touches before its hairs do. Own: by
/// eye; with a longer one it hovers, with a shorter one it jumps.
const SETTLE_TIME: f32 = 0.12;

/// Height above a surface, m, below which an analytic wind normal to the surface decreases to 0. Own: the size of eddies near the
/// ground, where the default eddies are 4 m; higher: catkins of gusts stay longer in the air, lower: gusts press them down.
const ANALYTIC_BLOCKING_HEIGHT: f64 = 1.0;

/// A flight that can be evaluated at any frame. Frames in ascending order cost one step each; an earlier frame restarts the
/// flight.
#[derive(Debug)]
pub struct FlightPlayback {
    /// Starts of the catkins, with parameters and solids: the flight begins again from these if an earlier frame is asked for.
    starts: Vec<CatkinStart>,
    params: FlightParams,
    solids: Arc<Solids>,
    /// Number of catkins for which no start outside of solids was found.
    enclosed: u64,
    /// The wind of the scene, which all of its parts share.
    wind: Arc<SceneWind>,
    /// The twigs that release catkins; empty unless the release is `canopy`.
    canopy: Canopy,
    /// Twig of each catkin, by id; empty if catkins do not start at twigs.
    sites: Vec<CatkinSite>,
    /// Flight before the first frame of the clip.
    spin_up: SpinUp,
    deposits: DepositionMaps,
    /// Declarations of the voxel grids, and which catkins each counts.
    volumes: FlightVolumes,
    /// Rectangles on the ground in which depositions are counted.
    zones: Vec<FlightZoneKeys>,
    /// Points of the hairs of each kind at scale 1, m, in the space of the tuft.
    hairs: Vec<Vec<Vec3>>,
    settle: bool,
    /// Width of the trajectories at the catkins, m.
    trail_width: f32,
    state: Mutex<FlightState>,
}

#[derive(Debug)]
struct FlightState {
    simulation: FlightSimulation,
    /// Number of simulated frames, counted from the start of the spin-up.
    frames: u64,
    /// Offset, m, by which each deposited catkin is drawn closer to the surface on which it rests.
    settled: Vec<Vec3>,
    /// Catkins that crossed a periodic side in the last step.
    side_jumps: SideJumps,
    trails: Option<Trajectories>,
    /// Sums of all depositions so far, if the maps are cumulative; else empty.
    landed: TexelSums,
    /// Depositions so far in each zone.
    in_zones: Vec<u64>,
    /// Positions of the twigs at the last frame in which a catkin waited at one; `None` before that and after a restart.
    twigs: Option<TwigPositions>,
}

/// The parts of a scene from which the parameters of a flight are made.
pub(crate) struct FlightSetup<'a> {
    pub recipe: &'a Recipe,
    pub flight: &'a FlightRecipe,
    /// Box of the flight, m; the side boundary conditions apply at its sides.
    pub domain: Bounds,
    /// Obstacles and land, with which catkins collide.
    pub solids: Arc<Solids>,
    /// Least height above a surface at which the wind is known, m.
    pub min_resolved_height: f64,
    /// Width of a lattice wind's cells, m; `None` for an analytic wind.
    pub cell_size: Option<f64>,
}

impl FlightPlayback {
    /// A flight before its spin-up, with its random starts drawn; nothing is simulated yet.
    /// # Errors
    /// Errors of the motions of plants that release catkins.
    pub(crate) fn new(
        scene: &FlightSetup<'_>,
        wind: &Arc<SceneWind>,
        canopy: Canopy,
        models: &[CatkinModel],
    ) -> Result<Self> {
        let keys = &scene.flight.keys;
        let params = flight_params(scene, models);
        let spin_up = SpinUp::new(keys.spin_up, params.fps);
        // Catkins of a canopy start at the positions of its twigs at the beginning of the spin-up.
        let (starts, sites) = match keys.release {
            FlightRelease::Canopy => {
                let twigs = canopy.positions(frame_time(-spin_up.frames.cast_signed(), params.fps))?;
                canopy.draw_catkin_starts(keys.count, keys.ripening, scene.recipe.general.seed, &twigs)
            }
            _ => (sky_or_point_starts(scene, &params), Vec::new()),
        };
        // The number of catkins need not be that of the key: a file of points gives as many as it has.
        let simulation = FlightSimulation::new(params.clone(), Arc::clone(&scene.solids), &starts);
        let enclosed = simulation.stats().buried;
        let trails = new_trajectories(scene, &params);
        let settled = vec![Vec3::ZERO; starts.len()];
        // All sums begin at 0; maps of landings add up over the clip, those of deposits are made anew in each frame.
        let deposits = DepositionMaps::new(keys, scene.domain, &scene.solids);
        let landed = if deposits.cumulative { deposits.empty_sums() } else { TexelSums::new() };
        let mut state = FlightState {
            simulation,
            frames: 0,
            settled,
            side_jumps: SideJumps::default(),
            trails,
            landed,
            in_zones: vec![0; scene.flight.zones.len()],
            twigs: None,
        };
        state.follow_side_jumps();
        state.extend_trajectories();
        let hairs = |m: &CatkinModel| m.tuft().hairs.points.clone();
        Ok(Self {
            wind: Arc::clone(wind),
            canopy,
            sites,
            spin_up,
            deposits,
            volumes: FlightVolumes::from_recipe(scene.recipe, keys.count, scene.domain),
            zones: scene.flight.zones.clone(),
            hairs: models.iter().map(hairs).collect(),
            settle: keys.settle,
            trail_width: narrow(keys.trail_width),
            state: Mutex::new(state),
            starts,
            params,
            solids: Arc::clone(&scene.solids),
            enclosed,
        })
    }

    /// Whether the flight has no catkins, not even catkins that wait for their release.
    pub fn is_empty(&self) -> bool {
        self.starts.is_empty()
    }

    /// Number of catkins for which no start outside of solids was found.
    pub fn enclosed_start_count(&self) -> u64 {
        self.enclosed
    }

    /// Number of catkins that start above the domain, or beyond a side of it at which catkins leave.
    pub fn outside_start_count(&self) -> usize {
        let FlightParams { inside, edges, .. } = &self.params;
        let leaves =
            |axis: usize, v: f32, low: f32, high: f32| edges[axis] == SideBoundary::Exit && !(low..=high).contains(&v);
        let is_outside = |p: &Vec3| {
            let beside = leaves(0, p.x, inside.min.x, inside.max.x) || leaves(1, p.z, inside.min.z, inside.max.z);
            beside || p.y > inside.max.y
        };
        self.starts.iter().filter(|start| is_outside(&start.at.as_vec3())).count()
    }

    /// Declarations of the flight's table and deposition maps, which frames fill. `warnings`: codes and texts so far.
    pub fn table_and_fields(
        &self,
        keys: &FlightKeys,
        warnings: Vec<(&'static str, String)>,
    ) -> (Table, &[osier_scene::Field]) {
        let lattice = self.wind.lattice_stats(self.clip_frame(0));
        let solids: Vec<&str> = self.solids.list().iter().map(|s| s.name.as_str()).collect();
        let zones: Vec<&str> = self.zones.iter().map(|z| z.name.as_str()).collect();
        let places = stats::CountedPlaceNames { solids: &solids, zones: &zones };
        (stats::flight_table(keys, self.starts.len(), places, lattice, warnings), &self.deposits.fields)
    }

    /// The asset at rest: at the start of the spin-up, or in a `still` scene at the scene's one frame. `material`: index in the
    /// scene of the trajectories' material.
    /// # Errors
    /// `TooMany`; those of [`SceneWind::wind_until_next_frame`].
    pub fn asset(&self, prototypes: Vec<Prototype>, material: u32, still: bool) -> Result<Asset> {
        let (protos, scales): (Vec<u32>, Vec<Vec3>) = {
            let state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
            state.simulation.by_id().map(|c| (u32::from(c.kind()), Vec3::splat(c.scale()))).unzip()
        };
        let instancer = Instancer {
            name: "catkins".into(),
            prototypes,
            ids: (0..self.starts.len() as u64).collect(),
            protos,
            scales,
            // A picture of one frame shows its catkins in flight; a clip begins before the first is released.
            rest: if still { self.state_at(0)? } else { self.catkins_before_first_step() },
            motion: InstancerMotion::Free,
            tracked: true,
        };
        // Trajectories are curves with a point per step, which grow from frame to frame.
        let curves = |state: &mut FlightState| {
            state.trails.as_ref().map(|t| t.curves(self.trail_width, material, !still)).transpose()
        };
        let trails = if still {
            self.with_state_at(0, curves)??
        } else {
            curves(&mut self.state.lock().unwrap_or_else(PoisonError::into_inner))?
        };
        Ok(Asset {
            id: CATKINS_ID.into(),
            kind: AssetKind::Tracks,
            group: String::new(),
            skeleton: None,
            meshes: Vec::new(),
            instancers: vec![instancer],
            points: Vec::new(),
            curves: trails.into_iter().collect(),
            rigged: None,
        })
    }

    /// Number of a frame counted from the clip's first, negative during the spin-up. `simulated`: number of frames since the
    /// start of the spin-up.
    fn clip_frame(&self, simulated: u64) -> i64 {
        // Both numbers are below 2^32, so that the casts keep their values.
        simulated.cast_signed() - self.spin_up.frames.cast_signed()
    }

    fn stats_row(&self, state: &FlightState) -> Vec<f64> {
        let (simulation, lattice) = (&state.simulation, self.wind.lattice_stats(self.clip_frame(state.frames)));
        let counts = stats::PlaceCounts {
            resting: &simulation.deposits_per_solid(),
            landed: simulation.landings_per_solid(),
            in_zones: &state.in_zones,
        };
        stats::flight_row(&simulation.stats(), counts, lattice)
    }

    /// Steps the simulation to frame `number` of the clip, from the start if it has passed it, and evaluates its state there.
    fn with_state_at<R>(&self, number: u64, evaluate: impl FnOnce(&mut FlightState) -> R) -> Result<R> {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        let target = self.spin_up.frames + number;
        // The simulation cannot step back: an earlier frame starts it again, spin-up included.
        if state.frames > target {
            state.simulation = FlightSimulation::new(self.params.clone(), Arc::clone(&self.solids), &self.starts);
            state.settled.fill(Vec3::ZERO);
            state.frames = 0;
            state.landed.iter_mut().for_each(|sums| sums.fill(0.0));
            state.in_zones.fill(0);
            state.twigs = None;
            state.trails.iter_mut().for_each(Trajectories::clear);
            state.side_jumps = SideJumps::default();
            state.follow_side_jumps();
            state.extend_trajectories();
        }
        while state.frames < target {
            // The clock of the simulation starts with the spin-up, that of the wind with the clip.
            let wind = self.wind.wind_until_next_frame(WindUser::Flight, self.clip_frame(state.frames))?;
            let lead = self.spin_up.seconds(state.simulation.options().fps);
            self.advance_frame(&mut state, &ShiftedWind { wind, lead })?;
            state.frames += 1;
            self.lower_drawn_deposits(&mut state);
            state.follow_side_jumps();
            state.extend_trajectories();
        }
        Ok(evaluate(&mut state))
    }

    /// Advances the simulation by one frame; catkins that wait at a twig move with it in each substep.
    fn advance_frame(&self, state: &mut FlightState, wind: &dyn Wind) -> Result<()> {
        let (fps, substeps) = (state.simulation.options().fps, state.simulation.options().substeps.max(1));
        if self.sites.is_empty() || !state.simulation.has_pending() {
            for _ in 0..substeps {
                self.advance_substep(state, wind);
            }
            return Ok(());
        }
        let twigs_at = |frame: u64| self.canopy.positions(frame_time(self.clip_frame(frame), fps));
        let before = state.twigs.take().map_or_else(|| twigs_at(state.frames), Ok)?;
        let after = twigs_at(state.frames + 1)?;
        // If the first interval is shorter, only its last part is simulated.
        let simulated = if state.frames == 0 { self.spin_up.first_interval_share(fps) } else { 1.0 };
        for k in 0..substeps {
            let share = 1.0 - simulated + simulated * (f64::from(k) / f64::from(substeps));
            self.move_pending_with_twigs(state, [&before, &after], share);
            self.advance_substep(state, wind);
        }
        // At the end of the frame, move the waiting catkins to the positions of their twigs at that time, not at the beginning of
        // the last step.
        self.move_pending_with_twigs(state, [&before, &after], 1.0);
        state.twigs = Some(after);
        Ok(())
    }

    /// Moves waiting catkins to the positions of their twigs at a share, 0 to 1, of the time between two frames.
    fn move_pending_with_twigs(&self, state: &mut FlightState, twigs: [&TwigPositions; 2], share: f64) {
        let duration = 1.0 / state.simulation.options().fps;
        let site = |id: u32| self.sites.get(to_usize(id))?.catkin_between_frames(twigs, share, duration);
        state.simulation.move_pending(site);
    }

    /// Advances the simulation by one step, and counts its depositions by zone and on maps.
    fn advance_substep(&self, state: &mut FlightState, wind: &dyn Wind) {
        state.simulation.advance(wind);
        for place in state.simulation.landings().iter().filter(|place| self.deposits.is_on_ground(place)) {
            let holds = |zone: &FlightZoneKeys| {
                (zone.x[0]..zone.x[1]).contains(&place.position.x) && (zone.z[0]..zone.z[1]).contains(&place.position.z)
            };
            for (count, _) in state.in_zones.iter_mut().zip(&self.zones).filter(|(_, zone)| holds(zone)) {
                *count += 1;
            }
        }
        if self.deposits.cumulative {
            self.deposits.add(&mut state.landed, state.simulation.landings().iter().copied());
        }
    }

    /// Area density in each texel of every map, 1/m^2 or mg/m^2: of all depositions so far if the maps are cumulative, else
    /// of the catkins at rest in `state`.
    fn deposition_densities(&self, state: &FlightState) -> Vec<Vec<f32>> {
        if self.deposits.cumulative {
            return self.deposits.densities(state.landed.clone());
        }
        let mut sums = self.deposits.empty_sums();
        self.deposits.add(&mut sums, state.simulation.by_id().filter_map(Catkin::resting_place));
        self.deposits.densities(sums)
    }

    /// Lowers deposited catkins until their lowest hair touches, and raises those that lift off again, with the time constant
    /// [`SETTLE_TIME`]. This changes only where they are drawn, not the simulation.
    fn lower_drawn_deposits(&self, state: &mut FlightState) {
        if !self.settle {
            return;
        }
        // Exponential approach: a frame covers the share 1 - exp(-dt/tau) of the remaining distance.
        let share = 1.0 - osier_base::math::exp_f32(-narrow(1.0 / state.simulation.options().fps) / SETTLE_TIME);
        let FlightState { simulation, settled, .. } = state;
        for (c, settled) in simulation.by_id().zip(settled) {
            let goal = if c.state().is_deposited() { self.gap_below_hairs(c) } else { Vec3::ZERO };
            *settled += (goal - *settled) * share;
        }
    }

    /// Vector from the lowest hair to the lowest point of the bounding ball, m, along the normal of the surface. In a corner of
    /// wall and ground the normal of the ground is used.
    fn gap_below_hairs(&self, c: &Catkin) -> Vec3 {
        let normal = if c.state() == CatkinState::Corner { Vec3::Y } else { c.rests_on().1 };
        let out = c.turn().conjugate() * normal;
        let hairs = self.hairs.get(usize::from(c.kind())).map_or(&[][..], Vec::as_slice);
        let lowest = hairs.iter().map(|p| p.dot(out)).fold(0.0, f32::min);
        -normal * (c.radius() + lowest * c.scale()).max(0.0)
    }

    fn state_at(&self, number: u64) -> Result<InstanceState> {
        self.with_state_at(number, |state| state.shown_state())
    }

    /// Transforms of the catkins before the first step, which are those of the asset at rest.
    fn catkins_before_first_step(&self) -> InstanceState {
        self.state.lock().unwrap_or_else(PoisonError::into_inner).instance_state()
    }
}

impl AssetMotion for FlightPlayback {
    fn frame(&self, _asset: &Asset, time: FrameTime) -> Result<AssetFrame> {
        self.with_state_at(time.index(), |state| AssetFrame {
            instancers: vec![InstancerFrame::State(state.shown_state())],
            curves: state.trails.iter().map(|t| CurvesFrame::Points(t.points().to_vec())).collect(),
            ..AssetFrame::default()
        })
    }

    fn row(&self, frame: u64) -> Result<Option<TableRow>> {
        self.with_state_at(frame, |state| Some(TableRow { table: stats::TABLE, values: self.stats_row(state) }))
    }

    fn fields(&self, frame: u64) -> Result<Vec<Vec<f32>>> {
        self.with_state_at(frame, |state| self.deposition_densities(state))
    }

    fn volumes(&self, frame: u64) -> Result<Vec<VolumeFrame>> {
        self.with_state_at(frame, |state| self.volumes.fill(&state.simulation))
    }

    fn point_tables(&self, frame: u64) -> Result<Vec<RecordTable>> {
        self.with_state_at(frame, |state| vec![points::catkin_points(state)])
    }
}

impl FlightState {
    /// Records the catkins that have crossed a periodic side in this frame.
    fn follow_side_jumps(&mut self) {
        let Self { simulation, side_jumps, .. } = self;
        side_jumps.follow(simulation);
    }

    /// Appends the positions at which catkins are drawn to the trajectories.
    fn extend_trajectories(&mut self) {
        if let Some(mut trails) = self.trails.take() {
            let state = self.shown_state();
            trails.push(&state, state.attribute(GENERATION).and_then(AttributeData::integers).unwrap_or_default());
            self.trails = Some(trails);
        }
    }

    /// [`FlightState::instance_state`] as the asset shows it: catkins that cross a periodic side are hidden, because programs
    /// interpolate between frames.
    fn shown_state(&self) -> InstanceState {
        let mut state = self.instance_state();
        self.side_jumps.hide(&mut state);
        state
    }

    /// Transforms and attributes of all catkins, including the visual settling, in the order of their ids.
    fn instance_state(&self) -> InstanceState {
        let s = self.simulation.frame();
        let number = |v: &u32| attribute_number(*v);
        InstanceState {
            positions: s.positions.iter().zip(&self.settled).map(|(p, settled)| *p + *settled).collect(),
            orientations: s.orientations,
            alive: s.states.iter().map(|s| s.is_seen()).collect(),
            sizes: Vec::new(),
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

/// Trajectories of the length `flight.trails`; `None` if it is 0. A catkin that moves by more than half the domain's width in a
/// frame was recycled or wrapped.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most ten minutes of frames")]
fn new_trajectories(scene: &FlightSetup<'_>, params: &FlightParams) -> Option<Trajectories> {
    let frames = (scene.flight.keys.trails * params.fps).round() as usize;
    let size = scene.domain.size();
    (frames > 0).then(|| Trajectories::new(frames + 1, size.x.min(size.z) / 2.0))
}

/// The flight before the first frame of the clip: intervals between frames, of which the first is shorter than the others unless the
/// spin-up is a whole number of frames.
#[derive(Debug, Clone, Copy, PartialEq)]
struct SpinUp {
    /// Number of intervals.
    frames: u64,
    /// Duration of the first one, s; 0 if it is as long as the others.
    first: f64,
}

impl SpinUp {
    /// A spin-up of `seconds`, 0 or more, at a frame rate, frames per second.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most an hour of frames")]
    fn new(seconds: f64, fps: f64) -> Self {
        let exact = seconds * fps;
        // Rounding errors of frame rates such as 29.97 must not add an interval.
        let frames = (exact - 1e-6).ceil().max(0.0);
        let first = (exact - (frames - 1.0)) / fps;
        let is_whole = frames < 1.0 || (exact - frames).abs() < 1e-6;
        Self { frames: frames as u64, first: if is_whole { 0.0 } else { first } }
    }

    /// Duration, s.
    fn seconds(self, fps: f64) -> f64 {
        let whole = if self.first > 0.0 { self.frames - 1 } else { self.frames };
        self.first + whole as f64 / fps
    }

    /// Duration of the first interval, as a share of that between two frames.
    fn first_interval_share(self, fps: f64) -> f64 {
        if self.first > 0.0 { self.first * fps } else { 1.0 }
    }
}

/// Parameters of the simulation from the keys of `[flight]`.
fn flight_params(scene: &FlightSetup<'_>, models: &[CatkinModel]) -> FlightParams {
    let (recipe, keys) = (scene.recipe, &scene.flight.keys);
    let forms = &scene.flight.forms;
    let kind = |(i, m): (usize, &CatkinModel)| CatkinKind { radius: m.radius, weight: forms[i % forms.len().max(1)] };
    let map = |wet: &GreyImage| GroundHumidity::Map { width: wet.width, values: wet.values.clone() };
    FlightParams {
        seed: recipe.general.seed,
        fps: recipe.clip.fps(),
        substeps: keys.substeps,
        first_interval: SpinUp::new(keys.spin_up, recipe.clip.fps()).first,
        inside: scene.domain,
        edges: side_boundaries(scene),
        band: keys.band,
        kinds: models.iter().enumerate().map(kind).collect(),
        scales: keys.scale,
        mass: keys.mass,
        fall: keys.fall,
        fall_spread: keys.fall_spread,
        glide: keys.glide,
        inertia: keys.inertia,
        gravity: recipe.gravity(),
        cluster_rotation: keys.cluster_rotation,
        beta: keys.beta,
        release_rate: keys.release_rate,
        release_speed: keys.release_speed,
        stick_radius: keys.stick_radius,
        stick_probability: keys.stick_probability,
        stick_close: keys.stick_close,
        gamma: keys.gamma,
        humidity: scene.flight.wet.as_ref().map_or(GroundHumidity::Even(keys.humidity), map),
        lift_speed: keys.lift_speed,
        lift_wet: keys.lift_wet,
        lift_rate: keys.lift_rate,
        min_resolved_height: scene.min_resolved_height,
        // A lattice wind flows around solids to within a cell; an analytic wind blows through them and into the ground.
        blocking_height: if scene.cell_size.is_some() { scene.min_resolved_height } else { ANALYTIC_BLOCKING_HEIGHT },
        roughness: if recipe.wind.model == WindModel::Lattice {
            recipe.lattice.roughness
        } else {
            FlightParams::default().roughness
        },
        // A catkin that crosses a cell of the wind in one step would skip the wind there.
        longest_step: scene.cell_size.unwrap_or(f64::INFINITY),
        flutter: keys.flutter,
        ..FlightParams::default()
    }
}

/// Boundary conditions of the sides across x and across z: those of the keys, otherwise those that suit the wind and the release.
fn side_boundaries(scene: &FlightSetup<'_>) -> [SideBoundary; 2] {
    // Sides at which the lattice wind is periodic are periodic for catkins too. At other sides, catkins released from the whole
    // sky are recycled, which keeps their number constant, and other catkins leave.
    let keys = &scene.flight.keys;
    let lattice = scene.cell_size.is_some();
    let periodic = if lattice { scene.recipe.lattice_options().periodic_sides() } else { [false; 2] };
    let open = if keys.release == FlightRelease::Sky { FlightBoundary::Recycle } else { FlightBoundary::Exit };
    let own = [keys.sides_x, keys.sides_z];
    std::array::from_fn(|axis| {
        let default = if periodic[axis] { FlightBoundary::Periodic } else { open };
        match own[axis].or(keys.sides).unwrap_or(default) {
            FlightBoundary::Exit => SideBoundary::Exit,
            FlightBoundary::Recycle => SideBoundary::Recycle,
            FlightBoundary::Periodic => SideBoundary::Periodic,
        }
    })
}

/// The time of a frame, counted from the clip's first, for the motions of plants.
fn frame_time(frame: i64, fps: f64) -> FrameTime {
    FrameTime { seconds: frame as f64 / fps, step: 1.0 / fps }
}

/// Start and release condition of each catkin that starts in the sky or at given points; empty for releases from a canopy.
fn sky_or_point_starts(scene: &FlightSetup<'_>, params: &FlightParams) -> Vec<CatkinStart> {
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
        FlightRelease::Canopy => Vec::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The spin-up takes the same time at any frame rate; a whole number of frames has no shorter interval.
    #[test]
    fn a_spin_up_lasts_as_long_at_any_frame_rate() {
        for fps in [1.0, 12.0, 24_000.0 / 1001.0, 24.0, 25.0, 60.0] {
            for seconds in [0.0, 0.3, 0.45, 2.0, 12.0, 3600.0] {
                let spin_up = SpinUp::new(seconds, fps);
                assert!((spin_up.seconds(fps) - seconds).abs() < 1e-6, "{spin_up:?} for {seconds} s at {fps}");
                assert!((0.0..1.0 / fps).contains(&spin_up.first), "{spin_up:?} for {seconds} s at {fps}");
            }
        }
        assert_eq!(SpinUp::new(2.0, 24.0), SpinUp { frames: 48, first: 0.0 });
        assert_eq!(SpinUp::new(0.4, 1.0).frames, 1);
    }
}
