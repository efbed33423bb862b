//! What walls and wet ground are built for, in the air of a lattice: fewer get past a higher wall, what it stops lies before
//! it, and wetter ground lets fewer go.
#![allow(clippy::expect_used, clippy::print_stdout, reason = "tests; figures that documents state are printed")]
#![allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "small whole numbers")]

use std::sync::Arc;

use glam::{DVec3, Vec3};
use osier::geometry::Bounds;
use osier::limits::Limits;
use osier::motion::flight::{
    Catkin, CatkinStart, FlightParams, FlightSimulation, GroundHumidity, ReleaseCondition, SideBoundary,
};
use osier::progress::{Cancel, Silent};
use osier::rng::Rng;
use osier::solid::{Form, Prism, Solid, Solids};
use osier::wind::{InletOptions, InterpolatedWind, LatticeOptions, LatticeSolver, WindSnapshot};

/// The box of air, m, in cells of half a metre unless a test sets others; it goes round along z.
const SIZE: [f64; 3] = [32.0, 20.0, 8.0];
const SPACING: f64 = 0.5;
const FPS: f64 = 24.0;

/// The wall's middle and thickness, m; it goes right across.
const WALL: f32 = 2.0;
const THICK: f32 = 0.5;

fn solids(height: f32) -> Vec<Solid> {
    let prism = Prism::block(Vec3::new(WALL, 0.0, 0.0), Vec3::new(THICK, height, 9.0), 0.0);
    let wall = Solid { name: "wall".into(), form: Form::Prism(prism), humidity: 0.5 };
    if height > 0.0 { vec![wall] } else { Vec::new() }
}

/// Frames of a wind that enters at `speed`, m/s, once it has blown through.
fn blown(speed: f64, steps: u32, solids: &[Solid], frames: usize) -> Vec<Arc<WindSnapshot>> {
    blown_in_cells(SPACING, speed, steps, solids, frames)
}

/// The same in cells of `spacing`, m.
fn blown_in_cells(spacing: f64, speed: f64, steps: u32, solids: &[Solid], frames: usize) -> Vec<Arc<WindSnapshot>> {
    let inlet = InletOptions { speed, turbulence: 0.2, ..LatticeOptions::default().inlet };
    let options = LatticeOptions {
        cells: SIZE.map(|metres| (metres / spacing).round() as u32),
        spacing,
        fps: FPS,
        steps_per_frame: Some(steps),
        inlet,
        ..LatticeOptions::default()
    };
    let mut lattice = LatticeSolver::new(&options, solids, &Limits::default()).expect("a lattice");
    (0..=frames).map(|_| lattice.advance(&Silent, &Cancel::default()).expect("air")).collect()
}

fn options(seed: u64, humidity: f64, edges: [SideBoundary; 2]) -> FlightParams {
    let inside = Bounds { min: Vec3::new(-16.0, 0.0, -4.0), max: Vec3::new(16.0, 20.0, 4.0) };
    FlightParams {
        seed,
        humidity: GroundHumidity::Even(humidity),
        edges,
        inside,
        stick_radius: 0.0,
        substeps: 2,
        min_resolved_height: SPACING / 2.0,
        blocking_height: SPACING / 2.0,
        ..FlightParams::default()
    }
}

/// Some that start between `low` and `high` and fly as long as the wind is known, and for how many frames one or another lay.
fn flown(
    options: FlightParams,
    (low, high): (DVec3, DVec3),
    solids: &[Solid],
    air: &[Arc<WindSnapshot>],
) -> (FlightSimulation, usize) {
    let mut draw = Rng::at(options.seed, &["control".into()]);
    let mut place = || low + (high - low) * DVec3::new(draw.unit_f64(), draw.unit_f64(), draw.unit_f64());
    let starts: Vec<CatkinStart> =
        (0..500).map(|_| CatkinStart { at: place(), wait: ReleaseCondition::Until(0.0) }).collect();
    let mut all = FlightSimulation::new(options, Arc::new(Solids::new(solids.to_vec(), true)), &starts);
    let mut lay = 0;
    for (pair, t0) in air.windows(2).zip((0_u32..).map(|k| f64::from(k) / FPS)) {
        let (before, after) = (Arc::clone(&pair[0]), Arc::clone(&pair[1]));
        all.advance_frame(&InterpolatedWind { before, after, t0, t1: t0 + 1.0 / FPS });
        lay += all.by_id().filter(|c| c.state().is_deposited()).count();
    }
    (all, lay)
}

/// How many lie in each metre before the wall's face, the nearest first, and in the metre behind the wall's middle.
fn lying(all: &FlightSimulation) -> ([usize; 8], usize) {
    let rests = |c: &&Catkin| c.state().is_deposited();
    let before: Vec<f64> = all.by_id().filter(rests).map(|c| f64::from(WALL - THICK / 2.0) - c.position().x).collect();
    let within = |from: f64| before.iter().filter(|x| (from..from + 1.0).contains(*x)).count();
    ([0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0].map(within), within(-1.0 - f64::from(THICK) / 2.0))
}

/// Walls of 0, 2, 4 and 8 m, upwind of which all start, and eight seeds: the higher the wall, the fewer pass it in each seed.
/// What lies before it is spread over its height or more. Before the higher walls the first metre holds the fewest: the air that
/// rises along the face keeps catkins off it.
#[test]
#[ignore = "takes half a minute; tests/full.sh runs it"]
fn a_higher_wall_lets_fewer_pass_and_keeps_them_off_its_foot() {
    let upwind = (DVec3::new(-14.0, 0.2, -4.0), DVec3::new(0.0, 7.0, 4.0));
    let edges = [SideBoundary::Exit, SideBoundary::Periodic];
    let winds = [0.0, 2.0, 4.0, 8.0].map(|height| {
        let solids = solids(height);
        let air = blown(3.0, 4, &solids, 340);
        (solids, air)
    });
    // Over all seeds: how many lie in each metre before each wall, and behind it.
    let mut lie = [([0; 8], 0); 3];
    for seed in 1..=8 {
        let fly = |wind: &(Vec<Solid>, Vec<Arc<WindSnapshot>>), wet| {
            flown(options(seed, wet, edges), upwind, &wind.0, &wind.1).0
        };
        let beyond = |c: &&Catkin| c.position().x > f64::from(WALL);
        let passed = winds.each_ref().map(|wind| fly(wind, 0.9).by_id().filter(beyond).count());
        assert!(passed.windows(2).all(|p| p[0] > p[1]), "seed {seed}: {passed:?}");
        for (wind, sum) in winds.iter().skip(1).zip(&mut lie) {
            let all = fly(wind, 0.1);
            let (before, behind) = lying(&all);
            sum.0.iter_mut().zip(before).for_each(|(sum, n)| *sum += n);
            sum.1 += behind;
            assert_eq!(all.stats().penetrations, 0);
        }
    }
    let mean = |metres: &[usize]| metres.iter().sum::<usize>() as f64 / metres.len() as f64;
    for (before, behind) in lie {
        assert!(behind as f64 * 5.0 < mean(&before[..5]), "{lie:?}");
    }
    let [low, middle, high] = lie.map(|l| l.0);
    assert!(mean(&low[..4]) > 1.3 * mean(&low[5..]), "{lie:?}");
    assert!([middle, high].iter().all(|b| 2.0 * mean(&b[..1]) < mean(&b[1..5])), "{lie:?}");
}

/// Deposits before walls of 2, 4 and 8 m, per metre from the face, of eight seeds, in cells of 0.5 and of 0.25 m, with the mean
/// speed at which the air rises half a metre before the face, over the wall's height. The air rises faster than catkins settle (0.24
/// m/s) over most of a face, and turns down again in a corner vortex that is as large as the wall is high; so where most lie moves away
/// from the wall with its height, and cells of half the size do not bring it back.
#[test]
#[ignore = "minutes; tests/full.sh runs it"]
fn deposits_move_away_from_higher_walls_in_cells_of_any_size() {
    let upwind = (DVec3::new(-14.0, 0.2, -4.0), DVec3::new(0.0, 7.0, 4.0));
    let edges = [SideBoundary::Exit, SideBoundary::Periodic];
    let mut first = Vec::new();
    for (spacing, steps) in [(0.5, 4), (0.25, 8)] {
        for height in [2.0_f32, 4.0, 8.0] {
            let solids = solids(height);
            let air = blown_in_cells(spacing, 3.0, steps, &solids, 340);
            let mut rises = (0.0, 0.0);
            let face = f64::from(WALL - THICK / 2.0);
            let column = ((face - 0.5 + SIZE[0] / 2.0) / spacing) as usize;
            for snapshot in &air {
                for y in 0..(f64::from(height) / spacing) as usize {
                    for z in 0..(SIZE[2] / spacing) as usize {
                        let (u, _) = snapshot.cell([column, y, z]).expect("a cell");
                        rises = (rises.0 + f64::from(u.y), rises.1 + 1.0);
                    }
                }
            }
            let mut sums = [0_usize; 8];
            for seed in 1..=8 {
                let own = FlightParams {
                    min_resolved_height: spacing / 2.0,
                    blocking_height: spacing / 2.0,
                    ..options(seed, 0.1, edges)
                };
                let (before, _) = lying(&flown(own, upwind, &solids, &air).0);
                sums.iter_mut().zip(before).for_each(|(sum, n)| *sum += n);
            }
            println!("| {height} | {spacing} | {:.2} | {sums:?}", rises.0 / rises.1);
            let share = sums[0] as f64 / sums.iter().sum::<usize>() as f64;
            first.push((height, share, rises.0 / rises.1));
        }
    }
    for walls in first.chunks(3) {
        let shares: Vec<f64> = walls.iter().map(|w| w.1).collect();
        // Before the walls of 4 and 8 m the first metre holds less than an even share of eight.
        assert!(shares[0] > shares[1] && shares[1] < 0.125 && shares[2] < 0.125, "{first:?}");
        assert!(walls.iter().all(|w| w.2 > 0.0), "{first:?}");
    }
}

/// In the air of a lattice, before a wall: a quarter of the time step changes the lift-offs, mergers and deposits of eight seeds
/// by no more than 5 %.
#[test]
#[ignore = "a minute; tests/full.sh runs it"]
fn counts_are_independent_of_the_step() {
    let solids = solids(2.0);
    let air = blown(3.0, 4, &solids, 340);
    let near_ground = (DVec3::new(-15.0, 0.1, -4.0), DVec3::new(0.0, 2.0, 4.0));
    let count = |substeps| {
        let mut sums = [0.0; 3];
        for seed in 1..=8 {
            let edges = [SideBoundary::Recycle, SideBoundary::Periodic];
            let own = FlightParams { substeps, stick_radius: 0.1, band: [0.01, 0.1], ..options(seed, 0.0, edges) };
            let (all, lay) = flown(own, near_ground, &solids, &air);
            let t = all.stats();
            assert!(t.penetrations == 0 && t.deposits >= t.lift_offs + t.falls, "{t:?}");
            sums.iter_mut().zip([t.lift_offs, t.merges, lay as u64]).for_each(|(sum, n)| *sum += n as f64);
        }
        sums
    };
    let (whole, quarter) = (count(1), count(4));
    for (a, b) in whole.iter().zip(&quarter) {
        assert!((a - b).abs() < 0.05 * b && *b > 400.0, "{whole:?} {quarter:?}");
    }
}

/// Ground of 0, 1/4, 1/2, 3/4 and quite wet, in a wind of 3 m/s: of those that lie, the fewer are lifted in a second the
/// wetter it is; from three quarters on all stay.
#[test]
fn wetter_ground_lets_fewer_go() {
    let air = blown(3.0, 4, &[], 200);
    let low = (DVec3::new(-16.0, 0.1, -4.0), DVec3::new(16.0, 1.5, 4.0));
    for seed in 1..=2 {
        let lifted = [0.0, 0.25, 0.5, 0.75, 1.0].map(|humidity| {
            let (all, lay) = flown(options(seed, humidity, [SideBoundary::Periodic; 2]), low, &[], &air);
            let tally = all.stats();
            assert!(tally.deposits > 50, "seed {seed}, {humidity}: {tally:?}");
            tally.lift_offs as f64 * FPS / (lay as f64).max(1.0)
        });
        assert!(
            lifted.windows(2).all(|p| p[0] > p[1] || p[0] < 1e-9) && lifted[1] > 1e-9 && lifted[3] < 1e-9,
            "seed {seed}: {lifted:?}"
        );
    }
}
