//! Flights over a clip: from a recipe to states, rows of a table and maps, frame by frame.

use std::sync::{Arc, Mutex, PoisonError};

use glam::{DVec3, Vec3};

use super::catkin::CatkinModel;
use super::deposits::Deposits;
use super::stream::Stream;
use crate::Result;
use crate::geometry::Bounds;
use crate::math::{ln, narrow};
use crate::motion::flight::{Catkin, Edge, Flights, Humidity, Kind, Options, Sky, Start, Tally, Wait, sky};
use crate::recipe::flight_keys::{FlightKeys, Release, Sides};
use crate::recipe::{FlightRecipe, Recipe};
use crate::rng::Rng;
use crate::scene::{
    Asset, AssetFrame, AssetKind, InstanceState, Instancer, InstancerFrame, InstancerMotion, Prototype, Table,
};
use crate::solid::Solids;

/// Time in which a catkin that came to rest sinks until its lowest hair touches, s.
const SETTLE_TIME: f32 = 0.12;

/// Columns of the table of a flight, with units.
const COLUMNS: [(&str, &str); 19] = [
    ("pending", ""),
    ("airborne", ""),
    ("grounded", ""),
    ("on_wall", ""),
    ("corner", ""),
    ("exited", ""),
    ("clusters", ""),
    ("singles", ""),
    ("largest", ""),
    ("merges", ""),
    ("deposits", ""),
    ("lift_offs", ""),
    ("recycled", ""),
    ("mean_speed", "m/s"),
    ("max_speed", "m/s"),
    ("ground_wind", "m/s"),
    ("flight_time", "s"),
    ("flight_distance", "m"),
    ("penetrations", ""),
];

/// A flight that can be asked for any frame; asked in order it goes on from the last.
#[derive(Debug)]
pub struct Course {
    start: Flights,
    /// Frames flown before the first of the clip.
    before: u64,
    deposits: Deposits,
    /// Points of the hairs of each kind, m.
    hairs: Vec<Vec<Vec3>>,
    settle: bool,
    now: Mutex<Now>,
}

#[derive(Debug)]
struct Now {
    flights: Flights,
    frames: u64,
    stream: Stream,
    /// How far each is sunk towards what it lies on, m.
    sunk: Vec<f32>,
}

/// What a flight needs of its scene.
pub struct Setting<'a> {
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
    /// Ends of twigs that let go, m, with their weights.
    pub twigs: &'a [(Vec3, f64)],
}

impl Course {
    /// A flight at its first frame.
    pub fn new(setting: &Setting<'_>, stream: Stream, models: &[CatkinModel]) -> Self {
        let keys = &setting.flight.keys;
        let options = options(setting, models);
        let starts = starts(setting, &options);
        let start = Flights::new(options, Arc::clone(&setting.solids), &starts);
        let now = Now { flights: start.clone(), frames: 0, stream, sunk: vec![0.0; start.len()] };
        let hairs = |m: &CatkinModel| m.tuft().hairs.points.clone();
        Self {
            before: before(setting.flight, setting.recipe),
            deposits: Deposits::new(keys, setting.inside, &setting.solids),
            hairs: models.iter().map(hairs).collect(),
            settle: keys.settle,
            now: Mutex::new(now),
            start,
        }
    }

    /// Number of those that found no place to start outside of solids.
    pub fn buried(&self) -> u64 {
        self.start.tally().buried
    }

    /// The table that frames fill, and the maps.
    pub fn measures(&self, keys: &FlightKeys) -> (Table, &[crate::scene::Field]) {
        let plot = |names: &[&str]| names.iter().filter_map(|n| COLUMNS.iter().position(|c| c.0 == *n)).collect();
        let table = Table {
            name: "flight".into(),
            columns: COLUMNS.to_vec(),
            plots: vec![
                ("Catkins by what they do", plot(&["airborne", "grounded", "on_wall", "corner", "exited", "pending"])),
                ("Sticking and coming to rest", plot(&["clusters", "largest", "merges", "deposits", "lift_offs"])),
                ("Speed", plot(&["mean_speed", "max_speed", "ground_wind"])),
            ],
            about: serde_json::json!({
                "count": self.start.len(), "humidity": keys.humidity, "fall_speed_m_s": keys.fall,
                "stick_radius_m": keys.stick_radius, "gamma_1_m2": keys.gamma, "buried": self.buried(),
            }),
        };
        (table, &self.deposits.fields)
    }

    /// The asset at rest: as it starts, or in a `still` scene as its one frame has it.
    /// # Errors
    /// Those of [`Stream::during`].
    pub fn asset(&self, prototypes: Vec<Prototype>, still: bool) -> Result<Asset> {
        let all: Vec<&Catkin> = self.start.by_number().collect();
        let instancer = Instancer {
            name: "catkins".into(),
            prototypes,
            ids: (0..all.len() as u64).collect(),
            protos: all.iter().map(|c| u32::from(c.kind())).collect(),
            scales: all.iter().map(|c| Vec3::splat(c.scale())).collect(),
            rest: if still { self.state(0)? } else { self.rest() },
            motion: InstancerMotion::Free,
            tracked: true,
            marks: vec!["state", "cluster", "generation"],
        };
        Ok(Asset {
            id: "catkins".into(),
            kind: AssetKind::Tracks,
            skeleton: None,
            meshes: Vec::new(),
            instancers: vec![instancer],
            points: Vec::new(),
            curves: Vec::new(),
        })
    }

    /// The asset at a frame, counted from the first.
    /// # Errors
    /// Those of [`Stream::during`].
    pub fn frame(&self, number: u64) -> Result<AssetFrame> {
        Ok(AssetFrame { instancers: vec![InstancerFrame::State(self.state(number)?)], ..AssetFrame::default() })
    }

    /// Row of the table and values of the maps at a frame.
    /// # Errors
    /// Those of [`Stream::during`].
    pub fn measured(&self, number: u64) -> Result<(Vec<f64>, Vec<Vec<f32>>)> {
        self.at(number, |now| (row(&now.flights.tally()), self.deposits.values(&now.flights)))
    }

    fn at<R>(&self, number: u64, look: impl FnOnce(&Now) -> R) -> Result<R> {
        let mut now = self.now.lock().unwrap_or_else(PoisonError::into_inner);
        let wanted = self.before + number;
        if now.frames > wanted {
            now.flights = self.start.clone();
            now.sunk.fill(0.0);
            now.frames = 0;
        }
        while now.frames < wanted {
            let (frame, fps) = (now.frames, now.flights.options().fps);
            let wind = now.stream.during(frame, fps)?;
            now.flights.advance_frame(&*wind);
            now.frames += 1;
            self.sink(&mut now);
        }
        Ok(look(&now))
    }

    /// Lowers what rests until its lowest hair touches, and raises what flies again, both softly.
    fn sink(&self, now: &mut Now) {
        if !self.settle {
            return;
        }
        let share = 1.0 - crate::math::exp_f32(-narrow(1.0 / now.flights.options().fps) / SETTLE_TIME);
        let Now { flights, sunk, .. } = now;
        for (c, sunk) in flights.by_number().zip(sunk) {
            let wanted = if c.state().is_deposited() { self.gap(c) } else { 0.0 };
            *sunk += (wanted - *sunk) * share;
        }
    }

    /// From the ball's lowest point, seen from what it lies on, to the lowest hair, m.
    fn gap(&self, c: &Catkin) -> f32 {
        let (_, normal) = c.rests_on();
        let out = c.turn().conjugate() * normal;
        let hairs = self.hairs.get(usize::from(c.kind())).map_or(&[][..], Vec::as_slice);
        let lowest = hairs.iter().map(|p| p.dot(out)).fold(0.0, f32::min);
        (c.radius() + lowest * c.scale()).max(0.0)
    }

    fn state(&self, number: u64) -> Result<InstanceState> {
        self.at(number, shown)
    }

    /// All at the flight's very start: what is written where nothing moves.
    fn rest(&self) -> InstanceState {
        let now = self.now.lock().unwrap_or_else(PoisonError::into_inner);
        shown(&now)
    }
}

fn shown(now: &Now) -> InstanceState {
    let s = now.flights.sample();
    let sunk = now.flights.by_number().zip(&now.sunk).map(|(c, sunk)| c.rests_on().1 * -*sunk);
    let number = |v: &u32| i32::try_from(*v).unwrap_or(i32::MAX);
    InstanceState {
        positions: s.positions.iter().zip(sunk).map(|(p, down)| *p + down).collect(),
        orientations: s.orientations,
        alive: s.states.iter().map(|s| s.is_seen()).collect(),
        velocities: s.velocities,
        angular_velocities: s.angular_velocities,
        marks: vec![
            s.states.iter().map(|s| *s as i32).collect(),
            s.clusters.iter().map(number).collect(),
            s.generations.iter().map(number).collect(),
        ],
    }
}

/// Frames of a flight before the first of the clip.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most an hour of frames")]
pub fn before(flight: &FlightRecipe, recipe: &Recipe) -> u64 {
    (flight.keys.preroll * recipe.clip.fps()).round() as u64
}

fn row(t: &Tally) -> Vec<f64> {
    let counts = [
        t.pending,
        t.airborne,
        t.grounded,
        t.on_wall,
        t.corner,
        t.exited,
        t.clusters,
        t.singles,
        t.largest,
        t.merges,
        t.deposits,
        t.lift_offs,
        t.recycled,
    ];
    let measured = [t.mean_speed, t.max_speed, t.ground_wind, t.flight_time, t.flight_distance];
    let mut row: Vec<f64> = counts.iter().map(|v| *v as f64).collect();
    row.extend(measured);
    row.push(t.penetrations as f64);
    row
}

fn options(setting: &Setting<'_>, models: &[CatkinModel]) -> Options {
    let (recipe, keys) = (setting.recipe, &setting.flight.keys);
    let forms = &setting.flight.forms;
    let kind = |(i, m): (usize, &CatkinModel)| Kind { radius: m.radius, weight: forms[i % forms.len().max(1)] };
    let own = if keys.release == Release::Sky { Sides::Recycle } else { Sides::Exit };
    let edge = match keys.sides.unwrap_or(own) {
        Sides::Exit => Edge::Exit,
        Sides::Recycle => Edge::Recycle,
        Sides::Periodic => Edge::Periodic,
    };
    let map = |(width, _, values): &(usize, usize, Vec<f32>)| Humidity::Map { width: *width, values: values.clone() };
    Options {
        seed: recipe.seed,
        fps: recipe.clip.fps(),
        substeps: keys.substeps,
        inside: setting.inside,
        edges: [edge; 2],
        band: keys.band,
        kinds: models.iter().enumerate().map(kind).collect(),
        scales: keys.scale,
        mass: keys.mass * 1e-6,
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
        check_every: keys.check_every,
        gamma: keys.gamma,
        humidity: setting.flight.wet.as_ref().map_or(Humidity::Even(keys.humidity), map),
        lift_speed: keys.lift_speed,
        lift_wet: keys.lift_wet,
        known_height: setting.known_height,
        flutter: keys.flutter,
        ..Options::default()
    }
}

fn starts(setting: &Setting<'_>, options: &Options) -> Vec<Start> {
    let (flight, keys) = (setting.flight, &setting.flight.keys);
    let seed = setting.recipe.seed;
    let all_over = |duration| {
        let sky_box = Sky { seed, count: keys.count, inside: options.inside, band: keys.band, duration };
        sky(&sky_box, &setting.solids)
    };
    match keys.release {
        Release::Sky => all_over(0.0),
        Release::Rain => all_over(keys.duration),
        Release::Points => {
            let start = |p: &[f64; 3]| Start { at: DVec3::from_array(*p), wait: Wait::Until(0.0) };
            flight.starts.iter().map(start).collect()
        }
        Release::Canopy => canopy(setting.twigs, (keys.count, seed)),
    }
}

/// Twigs drawn by weight, each seed with a patience of its own.
fn canopy(twigs: &[(Vec3, f64)], (count, seed): (u32, u64)) -> Vec<Start> {
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
            Start { at: twigs[twig].0.as_dvec3() + about, wait: Wait::Wind(-ln(1.0 - draw.unit_f64())) }
        })
        .collect()
}
