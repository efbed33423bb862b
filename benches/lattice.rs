//! Wind on a lattice: million cell updates a second of one size after another, with what they move through memory, beside
//! what an in-place sweep over memory of that size reaches. `cargo bench --bench lattice [-- SIZE...]`; RAYON_NUM_THREADS
//! sets the threads. benches/peers/lbmpy.sh runs it in turn with lbmpy.
#![allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    clippy::print_stdout,
    clippy::disallowed_methods,
    clippy::expect_used,
    reason = "a bench tells times"
)]

use std::time::Instant;

use glam::DVec3;
use osier::limits::Limits;
use osier::par;
use osier::progress::{Cancel, Silent};
use osier::wind::{GroundCondition, InletOptions, LatticeOptions, LatticeSolver, SideCondition, WindProfile};

const ROUNDS: usize = 3;
/// Bytes that a cell costs in a step: fifteen numbers read and written.
const BYTES: f64 = 120.0;

fn options(n: u32, smagorinsky: f64, steps: u32) -> LatticeOptions {
    LatticeOptions {
        cells: [n; 3],
        spacing: 0.5,
        base_center: DVec3::ZERO,
        inlet: InletOptions {
            direction: DVec3::X,
            speed_curve: Vec::new(),
            direction_curve: Vec::new(),
            speed: 2.0,
            profile: WindProfile::Log(0.05),
            reference_height: Some(0.5 * f64::from(n)),
            gust_strength: 0.0,
            gust_period: 8.0,
            turbulence: 0.0,
            turbulence_length: None,
            turbulence_modes: 0,
            seed: 1,
        },
        viscosity: 1.5e-5,
        // So many steps between two snapshots of the same wind.
        fps: 48.0 / f64::from(steps),
        steps_per_frame: Some(steps),
        smagorinsky,
        tau_floor: 0.51,
        ground: GroundCondition::Rough(0.05),
        sides: SideCondition::Auto,
        outlet_nonequilibrium: false,
        sponge_cells: Some(0),
        spin_up: Some(0.0),
        lead_frames: 0,
    }
}

fn median(mut all: Vec<f64>) -> f64 {
    all.sort_by(f64::total_cmp);
    all[all.len() / 2]
}

/// Million cells a second over frames of some steps.
fn pace(n: u32, smagorinsky: f64, steps: u32, turbulence: f64) -> f64 {
    let mut o = options(n, smagorinsky, steps);
    (o.inlet.turbulence, o.inlet.turbulence_modes) = (turbulence, 24);
    let mut lattice = LatticeSolver::new(&o, &[], &Limits::default()).expect("lattice");
    let mut frame = || drop(lattice.advance(&Silent, &Cancel::default()).expect("frame"));
    frame();
    frame();
    let cells = f64::from(n).powi(3);
    let frames = ((2e7 / cells / f64::from(steps)).ceil()).max(1.0);
    let rounds = (0..ROUNDS).map(|_| {
        let start = Instant::now();
        (0..frames as u32).for_each(|_| frame());
        cells * frames * f64::from(steps) / start.elapsed().as_secs_f64() / 1e6
    });
    median(rounds.collect())
}

/// GB/s of reading and writing every number of an array in place.
fn in_place(bytes: usize) -> f64 {
    let mut all = vec![1.0_f32; bytes / 4];
    let rounds = (0..ROUNDS).map(|_| {
        let repeat = (1usize << 30).div_ceil(bytes);
        let start = Instant::now();
        for _ in 0..repeat {
            let mut parts: Vec<&mut [f32]> = all.chunks_mut(1 << 18).collect();
            par::par_each(&mut parts, |part| part.iter_mut().for_each(|v| *v = *v * 0.999 + 0.001));
        }
        (2 * bytes * repeat) as f64 / start.elapsed().as_secs_f64() / 1e9
    });
    median(rounds.collect())
}

fn main() {
    let sizes: Vec<u32> = std::env::args().filter_map(|a| a.parse().ok()).collect();
    let sizes = if sizes.is_empty() { vec![70, 128, 192] } else { sizes };
    for n in sizes {
        let memory = 60 * (n as usize).pow(3);
        let bound = in_place(memory);
        // As many steps to a snapshot as take a tenth of a second or more.
        let steps = if n < 100 { 256 } else { 64 };
        let plain = pace(n, 0.0, steps, 0.0);
        let eddies = pace(n, 0.16, steps, 0.0);
        let whole = pace(n, 0.16, 2, 0.1);
        let share = 100.0 * plain * BYTES / 1000.0 / bound;
        println!(
            "osier n {n} threads {}: {plain:.1} million cells/s ({share:.0} % of {bound:.1} GB/s in place), {eddies:.1} with \
             eddies, {whole:.1} with eddies, turbulence and a snapshot every 2 steps",
            par::threads()
        );
    }
}
