//! Catkins in flight: the update of table 3 of the paper, and milliseconds a step for many.
//!
//! The paper says neither what its seconds are of nor whether drawing counts. Here one update is timed: two steps of a
//! 70 x 70 x 70 lattice wind and its snapshot, one step of all catkins with a look for contacts, and all points of all hairs
//! brought to world space; no drawing, no files.
#![allow(clippy::print_stdout, clippy::disallowed_methods, clippy::expect_used, reason = "a bench tells times")]

use std::sync::Arc;
use std::time::Instant;

use glam::Vec3;
use osier::bake::BakeContext;
use osier::bake::assets::catkin::{CatkinModel, catkin_models};
use osier::limits::Limits;
use osier::motion::flight::{CatkinKind, FlightParams, FlightSimulation, SideBoundary, SkyRelease, sky_starts};
use osier::par::par_each;
use osier::progress::{Cancel, Silent};
use osier::recipe::KeyTable as _;
use osier::recipe::scene::CatkinKeys;
use osier::solid::Solids;
use osier::wind::{InletOptions, InterpolatedWind, LatticeOptions, LatticeSolver, UniformWind, Wind};

/// Updates before those that are timed, and how many are.
const BEFORE: u32 = 100;
const TIMED: usize = 50;

fn ms(f: impl FnOnce()) -> f64 {
    let start = Instant::now();
    f();
    start.elapsed().as_secs_f64() * 1e3
}

fn median(mut all: Vec<f64>) -> f64 {
    all.sort_by(f64::total_cmp);
    all[all.len() / 2]
}

fn flights(n: u32, models: &[CatkinModel], stick_radius: f64) -> FlightSimulation {
    let options = FlightParams {
        kinds: models.iter().map(|m| CatkinKind { radius: m.radius, weight: 1.0 }).collect(),
        stick_radius,
        edges: [SideBoundary::Periodic; 2],
        ..FlightParams::default()
    };
    let sky_box = SkyRelease { seed: 1, count: n, inside: options.inside, band: [0.3, 0.95], duration: 0.0 };
    let solids = Arc::new(Solids::new(Vec::new(), true));
    let starts = sky_starts(&sky_box, &solids);
    FlightSimulation::new(options, solids, &starts)
}

/// All points of all hairs in world space.
fn drawn(flights: &FlightSimulation, models: &[CatkinModel], out: &mut [Vec3]) {
    let catkins: Vec<_> = flights.by_id().collect();
    let mut chunks: Vec<_> = catkins.chunks(64).zip(out.chunks_mut(64 * 400)).collect();
    par_each(&mut chunks, |(catkins, out)| {
        for (c, out) in catkins.iter().zip(out.chunks_mut(400)) {
            let (at, turn, scale) = (c.position().as_vec3(), c.turn(), c.scale());
            let hairs = &models[usize::from(c.kind())].tuft().hairs.points;
            for (to, p) in out.iter_mut().zip(hairs) {
                *to = at + turn * (*p * scale);
            }
        }
    });
}

/// Table 3 of the paper, by stage.
fn table(models: &[CatkinModel]) {
    println!("catkins   points    lines    wind   flight  points   sum [ms]   s per simulated s");
    for n in [500_u32, 1000, 2000] {
        let options = LatticeOptions {
            cells: [70; 3],
            spacing: 0.5,
            fps: 24.0,
            steps_per_frame: Some(2),
            inlet: InletOptions { speed: 2.0, ..LatticeOptions::default().inlet },
            ..LatticeOptions::default()
        };
        let mut lattice = LatticeSolver::new(&options, &[], &Limits::default()).expect("lattice");
        let mut before = lattice.advance(&Silent, &Cancel::default()).expect("run-up");
        let mut all = flights(n, models, 0.05);
        let mut points = vec![Vec3::ZERO; n as usize * 400];
        let mut times: [Vec<f64>; 3] = Default::default();
        for k in 0..BEFORE as usize + TIMED {
            let mut after = None;
            let wind = ms(|| after = Some(lattice.advance(&Silent, &Cancel::default()).expect("step")));
            let after = after.expect("snapshot");
            let t0 = k as f64 / 24.0;
            let blows =
                InterpolatedWind { before: Arc::clone(&before), after: Arc::clone(&after), t0, t1: t0 + 1.0 / 24.0 };
            let flight = ms(|| all.advance(&blows));
            let shown = ms(|| drawn(&all, models, &mut points));
            before = after;
            if k >= BEFORE as usize {
                times.iter_mut().zip([wind, flight, shown]).for_each(|(to, t)| to.push(t));
            }
        }
        std::hint::black_box(&points);
        let [wind, flight, shown] = times.map(median);
        let sum = wind + flight + shown;
        println!(
            "{n:7}  {:7}  {:7}  {wind:6.2}  {flight:6.2}  {shown:6.2}  {sum:6.2}     {:.3}",
            n * 400,
            n * 100,
            sum * 24.0 / 1e3
        );
    }
}

/// Milliseconds a step by number of catkins in an even wind.
fn many(models: &[CatkinModel]) {
    println!("catkins   ms a step   ns a catkin");
    for n in [2_000_u32, 100_000, 1_000_000] {
        let mut all = flights(n, models, 0.05);
        let wind = UniformWind(Vec3::new(2.0, 0.0, 0.3));
        let rounds = if n > 500_000 { 8 } else { 40 };
        (0..4).for_each(|_| all.advance(&wind));
        let times: Vec<f64> = (0..rounds).map(|_| ms(|| all.advance(&wind as &dyn Wind))).collect();
        let ms = median(times);
        println!("{n:7}   {ms:8.2}    {:.0}", ms * 1e6 / f64::from(n));
    }
}

fn main() {
    let (limits, cancel) = (Limits::default(), Cancel::default());
    let work = BakeContext { limits: &limits, cancel: &cancel, progress: &Silent, cache: None };
    let mut models = Vec::new();
    let keys = CatkinKeys::defaults();
    let made = ms(|| models = catkin_models(&keys, 1, &work).expect("models"));
    println!("five kinds of catkin: {made:.2} ms (table 4 of the paper: 15 s)");
    assert!(models.iter().all(|m| m.tuft().hairs.points.len() == 400));
    for threads in [1, std::thread::available_parallelism().map_or(1, usize::from)] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        println!("-- {threads} thread(s)");
        pool.install(|| {
            table(&models);
            many(&models);
        });
    }
}
