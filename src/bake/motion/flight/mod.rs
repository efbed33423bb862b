//! Flights over a clip: from a recipe to states, rows of a table and maps, frame by frame.

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

/// Attribute of a catkin: how often it has come back to its start.
const GENERATION: &str = "generation";

/// Time in which a catkin that came to rest sinks until its lowest hair touches, s.
const SETTLE_TIME: f32 = 0.12;

/// A flight that can be asked for any frame; asked in order it goes on from the last.
#[derive(Debug)]
pub struct FlightPlayback {
    start: FlightSimulation,
    /// Frames flown before the first of the clip.
    before: u64,
    deposits: DepositionMaps,
    /// Points of the hairs of each kind, m.
    hairs: Vec<Vec<Vec3>>,
    settle: bool,
    /// Thickness of the lines behind them, m.
    line: f32,
    now: Mutex<FlightState>,
}

#[derive(Debug)]
struct FlightState {
    flights: FlightSimulation,
    frames: u64,
    stream: WindPlayback,
    /// How far each is sunk towards what it lies on, m.
    sunk: Vec<Vec3>,
    trails: Option<Trajectories>,
}

/// What a flight needs of its scene.
pub struct FlightContext<'a> {
    /// The scene.
    pub recipe: &'a Recipe,
    /// Its flight.
    pub flight: &'a FlightRecipe,
    /// The box of air.
    pub inside: Bounds,
    /// What is in the way.
    pub solids: Arc<Solids>,
    /// Least height above a surface at which the wind is known, m.
    pub known_height: f64,
    /// Width of the wind's cells, m, if it has any.
    pub cell: Option<f64>,
    /// Ends of twigs that let go, m, with their weights.
    pub twigs: &'a [(Vec3, f64)],
}

impl FlightPlayback {
    /// A flight at its first frame.
    pub fn new(setting: &FlightContext<'_>, stream: WindPlayback, models: &[CatkinModel]) -> Self {
        let keys = &setting.flight.keys;
        let options = options(setting, models);
        let starts = starts(setting, &options);
        let start = FlightSimulation::new(options, Arc::clone(&setting.solids), &starts);
        let trails = lines(setting, start.options());
        let mut now =
            FlightState { flights: start.clone(), frames: 0, stream, sunk: vec![Vec3::ZERO; start.len()], trails };
        now.draw();
        let hairs = |m: &CatkinModel| m.tuft().hairs.points.clone();
        Self {
            before: before(setting.flight, setting.recipe),
            deposits: DepositionMaps::new(keys, setting.inside, &setting.solids),
            hairs: models.iter().map(hairs).collect(),
            settle: keys.settle,
            line: narrow(keys.trail_width),
            now: Mutex::new(now),
            start,
        }
    }

    /// Number of those that found no place to start outside of solids.
    pub fn buried(&self) -> u64 {
        self.start.stats().buried
    }

    /// The table that frames fill, and the maps. `said`: warnings so far.
    pub fn measures(&self, keys: &FlightKeys, said: Vec<(&'static str, String)>) -> (Table, &[osier_scene::Field]) {
        let lattice = self.now.lock().unwrap_or_else(PoisonError::into_inner).stream.health();
        let solids: Vec<&str> = self.start.solids().list().iter().map(|s| s.name.as_str()).collect();
        (stats::table(keys, self.start.len(), &solids, lattice, said), &self.deposits.fields)
    }

    /// The asset at rest: as it starts, or in a `still` scene as its one frame has it. `material`: of the lines behind them.
    /// # Errors
    /// Those of [`WindPlayback::during`].
    pub fn asset(&self, prototypes: Vec<Prototype>, material: u32, still: bool) -> Result<Asset> {
        let all: Vec<&Catkin> = self.start.by_id().collect();
        let instancer = Instancer {
            name: "catkins".into(),
            prototypes,
            ids: (0..all.len() as u64).collect(),
            protos: all.iter().map(|c| u32::from(c.kind())).collect(),
            scales: all.iter().map(|c| Vec3::splat(c.scale())).collect(),
            rest: if still { self.state(0)? } else { self.rest() },
            motion: InstancerMotion::Free,
            tracked: true,
        };
        let drawn = |now: &mut FlightState| now.trails.as_ref().map(|t| t.curves(self.line, material, !still));
        let trails = if still {
            self.at(0, drawn)?
        } else {
            drawn(&mut self.now.lock().unwrap_or_else(PoisonError::into_inner))
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

    /// The wind at a frame, and the time to ask it at, s.
    /// # Errors
    /// Those of [`WindPlayback::during`].
    pub fn wind(&self, number: u64) -> Result<(Arc<dyn Wind>, f64)> {
        let fps = self.start.options().fps;
        let frame = self.before + number;
        // Of the frame that was flown last: a lattice need not go on for this.
        let wind = self.at(number, |now| now.stream.during(frame.saturating_sub(1), fps))??;
        Ok((wind, frame as f64 / fps))
    }

    fn at<R>(&self, number: u64, look: impl FnOnce(&mut FlightState) -> R) -> Result<R> {
        let mut now = self.now.lock().unwrap_or_else(PoisonError::into_inner);
        let wanted = self.before + number;
        if now.frames > wanted {
            now.flights = self.start.clone();
            now.sunk.fill(Vec3::ZERO);
            now.frames = 0;
            now.trails.iter_mut().for_each(Trajectories::clear);
            now.draw();
        }
        while now.frames < wanted {
            let (frame, fps) = (now.frames, now.flights.options().fps);
            let wind = now.stream.during(frame, fps)?;
            now.flights.advance_frame(&*wind);
            now.frames += 1;
            self.sink(&mut now);
            now.draw();
        }
        Ok(look(&mut now))
    }

    /// Lowers what rests until its lowest hair touches, and raises what flies again, both softly.
    fn sink(&self, now: &mut FlightState) {
        if !self.settle {
            return;
        }
        let share = 1.0 - osier_base::math::exp_f32(-narrow(1.0 / now.flights.options().fps) / SETTLE_TIME);
        let FlightState { flights, sunk, .. } = now;
        for (c, sunk) in flights.by_id().zip(sunk) {
            let wanted = if c.state().is_deposited() { self.gap(c) } else { Vec3::ZERO };
            *sunk += (wanted - *sunk) * share;
        }
    }

    /// From the lowest hair, seen from what it lies on, to the ball's lowest point, m. At the foot of a wall it lies on
    /// the ground.
    fn gap(&self, c: &Catkin) -> Vec3 {
        let normal = if c.state() == CatkinState::Corner { Vec3::Y } else { c.rests_on().1 };
        let out = c.turn().conjugate() * normal;
        let hairs = self.hairs.get(usize::from(c.kind())).map_or(&[][..], Vec::as_slice);
        let lowest = hairs.iter().map(|p| p.dot(out)).fold(0.0, f32::min);
        -normal * (c.radius() + lowest * c.scale()).max(0.0)
    }

    fn state(&self, number: u64) -> Result<InstanceState> {
        self.at(number, |now| shown(now))
    }

    /// All at the flight's very start: what is written where nothing moves.
    fn rest(&self) -> InstanceState {
        let now = self.now.lock().unwrap_or_else(PoisonError::into_inner);
        shown(&now)
    }
}

impl AssetMotion for FlightPlayback {
    fn frame(&self, _asset: &Asset, time: FrameTime) -> Result<AssetFrame> {
        self.at(time.index(), |now| AssetFrame {
            instancers: vec![InstancerFrame::State(shown(now))],
            curves: now.trails.iter().map(|t| CurvesFrame::Points(t.points().to_vec())).collect(),
            ..AssetFrame::default()
        })
    }

    fn row(&self, frame: u64) -> Result<Option<TableRow>> {
        self.at(frame, |now| Some(TableRow { table: stats::TABLE, values: now.row() }))
    }

    fn fields(&self, frame: u64) -> Result<Vec<Vec<f32>>> {
        self.at(frame, |now| self.deposits.values(&now.flights))
    }
}

impl FlightState {
    /// Row of the table.
    fn row(&self) -> Vec<f64> {
        stats::row(&self.flights.stats(), &self.flights.deposits_per_solid(), self.stream.health())
    }

    /// Draws the lines on to where all are.
    fn draw(&mut self) {
        if let Some(mut trails) = self.trails.take() {
            let state = shown(self);
            trails.push(&state, state.attribute(GENERATION).and_then(AttributeData::integers).unwrap_or_default());
            self.trails = Some(trails);
        }
    }
}

/// The lines of a scene whose catkins draw any.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most ten minutes of frames")]
fn lines(setting: &FlightContext<'_>, options: &FlightParams) -> Option<Trajectories> {
    let frames = (setting.flight.keys.trails * options.fps).round() as usize;
    let size = setting.inside.size();
    (frames > 0).then(|| Trajectories::new(frames + 1, size.x.min(size.z) / 2.0))
}

fn shown(now: &FlightState) -> InstanceState {
    let s = now.flights.frame();
    let number = |v: &u32| i32::try_from(*v).unwrap_or(i32::MAX);
    InstanceState {
        positions: s.positions.iter().zip(&now.sunk).map(|(p, sunk)| *p + *sunk).collect(),
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

/// Frames of a flight before the first of the clip.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most an hour of frames")]
pub fn before(flight: &FlightRecipe, recipe: &Recipe) -> u64 {
    (flight.keys.spin_up * recipe.clip.fps()).round() as u64
}

fn options(setting: &FlightContext<'_>, models: &[CatkinModel]) -> FlightParams {
    let (recipe, keys) = (setting.recipe, &setting.flight.keys);
    let forms = &setting.flight.forms;
    let kind = |(i, m): (usize, &CatkinModel)| CatkinKind { radius: m.radius, weight: forms[i % forms.len().max(1)] };
    let own = if keys.release == FlightRelease::Sky { FlightBoundary::Recycle } else { FlightBoundary::Exit };
    let edge = match keys.sides.unwrap_or(own) {
        FlightBoundary::Exit => SideBoundary::Exit,
        FlightBoundary::Recycle => SideBoundary::Recycle,
        FlightBoundary::Periodic => SideBoundary::Periodic,
    };
    let map = |wet: &GreyImage| GroundHumidity::Map { width: wet.width, values: wet.values.clone() };
    FlightParams {
        seed: recipe.general.seed,
        fps: recipe.clip.fps(),
        substeps: keys.substeps,
        inside: setting.inside,
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
        humidity: setting.flight.wet.as_ref().map_or(GroundHumidity::Even(keys.humidity), map),
        lift_speed: keys.lift_speed,
        lift_wet: keys.lift_wet,
        known_height: setting.known_height,
        longest_step: setting.cell.unwrap_or(f64::INFINITY),
        flutter: keys.flutter,
        ..FlightParams::default()
    }
}

fn starts(setting: &FlightContext<'_>, options: &FlightParams) -> Vec<CatkinStart> {
    let (flight, keys) = (setting.flight, &setting.flight.keys);
    let seed = setting.recipe.general.seed;
    let all_over = |duration| {
        let sky_box = SkyRelease { seed, count: keys.count, inside: options.inside, band: keys.band, duration };
        sky_starts(&sky_box, &setting.solids)
    };
    match keys.release {
        FlightRelease::Sky => all_over(0.0),
        FlightRelease::Rain => all_over(keys.duration),
        FlightRelease::Points => {
            let start = |p: &[f64; 3]| CatkinStart { at: DVec3::from_array(*p), wait: ReleaseCondition::Until(0.0) };
            flight.starts.iter().map(start).collect()
        }
        FlightRelease::Canopy => canopy_starts(setting.twigs, keys.count, seed),
    }
}

/// Twigs drawn by weight, each seed with a patience of its own.
fn canopy_starts(twigs: &[(Vec3, f64)], count: u32, seed: u64) -> Vec<CatkinStart> {
    let mut sums = Vec::with_capacity(twigs.len());
    let mut sum = 0.0;
    for (_, weight) in twigs {
        sum += weight;
        sums.push(sum);
    }
    if sum <= 0.0 {
        return Vec::new();
    }
    (0..count)
        .map(|id| {
            let mut draw = Rng::at(seed, &["flight".into(), id.into(), 0_u64.into(), "start".into()]);
            let at = draw.unit_f64() * sum;
            let twig = sums.partition_point(|s| *s <= at).min(twigs.len() - 1);
            // Some way about the very end, else those of one twig would start as one.
            let about = DVec3::new(draw.normal(), draw.normal(), draw.normal()) * 0.05;
            CatkinStart {
                at: twigs[twig].0.as_dvec3() + about,
                wait: ReleaseCondition::Wind(-ln(1.0 - draw.unit_f64())),
            }
        })
        .collect()
}
