//! Tests with flows of known solution.

#![allow(
    clippy::cast_possible_truncation,
    clippy::cast_possible_wrap,
    clippy::cast_sign_loss,
    clippy::cast_precision_loss,
    clippy::disallowed_methods,
    clippy::float_cmp,
    clippy::needless_range_loop,
    clippy::print_stdout,
    reason = "small known numbers, whose last bits do not matter; figures that documents state are printed"
)]

use super::collide::{equilibrium, smagorinsky_factor};
use super::cut_links::CutHalfLinks;
use super::domain::{Domain, FaceCondition};
use super::flow::FlowState;
use super::grid::{LatticeGrid, StepParity};
use super::ground::{GroundModel, shear_coefficient};
use super::reference::ReferenceSolver;
use super::stencil::{Q, VELOCITIES, weight};
use super::step_tables::FlowParams;
use super::stepper::BoundaryInputs;

const RESTING_WALL: FaceCondition = FaceCondition::Wall([0.0; 3]);

/// A test flow, computed by the reference solver or by the production solver.
enum TestFlow {
    Reference(Box<ReferenceSolver>),
    Production(Box<FlowState>),
}

fn domain(n: [usize; 3], faces: [FaceCondition; 6], solid: impl Fn([usize; 3]) -> bool) -> Domain {
    let grid = LatticeGrid::new(n);
    let mut list = vec![false; grid.cell_count()];
    for z in 0..n[2] {
        for y in 0..n[1] {
            for x in 0..n[0] {
                list[grid.cell_index([x, y, z])] = solid([x, y, z]);
            }
        }
    }
    Domain { grid, faces, solid: list, cuts: CutHalfLinks::default() }
}

/// The domain with every eighth half link of some cells cut, at random, including those at faces.
fn with_random_cuts(mut domain: Domain, cut: impl Fn([usize; 3]) -> bool) -> Domain {
    let n = domain.grid.n;
    let mut rng = osier_base::rng::Rng::at(7, &["cuts".into()]);
    let half = |c: usize| {
        let bits = (1..Q).filter(|_| rng.unit_f64() < 0.125).fold(0, |bits, i| bits | 1 << i);
        if cut([c % n[0], c / n[0] % n[1], c / n[0] / n[1]]) { bits } else { 0 }
    };
    domain.cuts = CutHalfLinks::from_halves((0..domain.grid.cell_count()).map(half).collect());
    domain
}

fn no_wind([_, _, _]: [isize; 3]) -> ([f64; 3], [f64; 2]) {
    ([0.0; 3], [0.0; 2])
}

/// Air without a sponge or rough ground.
fn flow_params(tau: f32, smagorinsky: f64, force: [f32; 3]) -> FlowParams {
    let ground = GroundModel::default();
    FlowParams {
        tau,
        smagorinsky_factor: smagorinsky_factor(smagorinsky) as f32,
        sponge: [Vec::new(), Vec::new()],
        ground,
        force,
    }
}

impl TestFlow {
    fn reference(domain: Domain, tau: f64, force: [f64; 3]) -> Self {
        Self::Reference(Box::new(ReferenceSolver { force, ..ReferenceSolver::new(domain, tau, 0.0) }))
    }

    fn production(domain: Domain, tau: f64, force: [f64; 3]) -> Self {
        let force = force.map(|f| f as f32);
        let v = flow_params(tau as f32, 0.0, force);
        Self::Production(Box::new(FlowState::new(domain, v, false).expect("memory")))
    }

    fn advance(&mut self) {
        match self {
            Self::Reference(f) => f.advance(no_wind, [0.0; 6]),
            Self::Production(f) => {
                f.advance_one_step(BoundaryInputs {
                    inlet_velocity: &[const { Vec::new() }; 3],
                    shear: &[],
                    shear_scale: [0.0; 2],
                    outlet_velocity: [0.0; 6],
                });
            }
        }
    }

    fn run(mut self, steps: usize) -> Self {
        (0..steps).for_each(|_| self.advance());
        self
    }

    fn grid(&self) -> LatticeGrid {
        match self {
            Self::Reference(f) => f.domain.grid,
            Self::Production(f) => f.domain.grid,
        }
    }

    fn outgoing_populations(&self, cell: [usize; 3]) -> [f64; Q] {
        match self {
            Self::Reference(f) => f.outgoing[f.domain.grid.cell_index(cell)],
            Self::Production(f) => f.outgoing_populations(cell).map(f64::from),
        }
    }

    fn set_populations(&mut self, cell: [usize; 3], g: [f64; Q]) {
        match self {
            Self::Reference(f) => f.outgoing[f.domain.grid.cell_index(cell)] = g,
            Self::Production(f) => {
                let e = f.domain.grid.node_element(cell.map(|c| c as isize));
                for i in 0..Q {
                    let (k, e) = f.domain.grid.outgoing_slot_of(StepParity::from_step(f.step), i, e);
                    f.populations.arrays_mut()[k][e] = g[i] as f32;
                }
            }
        }
    }

    fn rebuild_exchange(&mut self) {
        if let Self::Production(f) = self {
            f.exchange.rebuild_from_populations(&f.populations, StepParity::from_step(f.step));
        }
    }

    fn moments_at(&self, cell: [usize; 3]) -> (f64, [f64; 3]) {
        super::collide::moments(&self.outgoing_populations(cell))
    }
}

/// |a - b| / |b| over pairs.
fn relative_l2_error(pairs: impl Iterator<Item = (f64, f64)>) -> f64 {
    let (mut off, mut all) = (0.0, 0.0);
    for (a, b) in pairs {
        off += (a - b) * (a - b);
        all += b * b;
    }
    (off / all).sqrt()
}

fn channel_domain(height: usize, top: FaceCondition) -> Domain {
    domain(
        [1, height, 1],
        [
            FaceCondition::Periodic,
            FaceCondition::Periodic,
            RESTING_WALL,
            top,
            FaceCondition::Periodic,
            FaceCondition::Periodic,
        ],
        |_| false,
    )
}

fn lattice_viscosity(tau: f64) -> f64 {
    (tau - 0.5) / 3.0
}

#[test]
fn couette_flow_has_a_linear_profile() {
    for height in [8, 16, 32] {
        for tau in [0.6, 0.8, 1.5] {
            // 3.5 times H^2 / nu, the time in which friction acts across the channel: the influence of the start has decayed.
            let steps = (3.5 * (height * height) as f64 / lattice_viscosity(tau)) as usize;
            let walls = || channel_domain(height, FaceCondition::Wall([0.1, 0.0, 0.0]));
            for (fluid, bound) in [
                (TestFlow::reference(walls(), tau, [0.0; 3]), 1e-12),
                (TestFlow::production(walls(), tau, [0.0; 3]), 1e-5),
            ] {
                let fluid = fluid.run(steps);
                // Walls lie half a cell beyond the outer nodes.
                let line = |y: usize| 0.1 * (y as f64 + 0.5) / height as f64;
                let off = relative_l2_error((0..height).map(|y| (fluid.moments_at([0, y, 0]).1[0], line(y))));
                println!("couette H {height} tau {tau}: {off:.3e}");
                assert!(off < bound, "H {height}, tau {tau}: {off}");
            }
        }
    }
}

/// Relative errors of the profile, and wall force over body force.
fn poiseuille_errors(height: usize, tau: f64, ours: bool) -> (f64, f64) {
    // The greatest velocity is inversely proportional to the height in cells, so that the error of compressibility, proportional
    // to Ma^2, decreases as fast as that of the resolution.
    let (h, top) = (height as f64, 0.4 / height as f64);
    // u(y) = F / (2 nu) y (H - y) has its maximum F H^2 / (8 nu) in the middle.
    let force = [8.0 * lattice_viscosity(tau) * top / (h * h), 0.0, 0.0];
    let walls = channel_domain(height, RESTING_WALL);
    let fluid = if ours { TestFlow::production(walls, tau, force) } else { TestFlow::reference(walls, tau, force) };
    let fluid = fluid.run((3.5 * h * h / lattice_viscosity(tau)) as usize);
    let curve = |y: usize| {
        let s = (y as f64 + 0.5) / h;
        4.0 * top * s * (1.0 - s)
    };
    // The velocity includes half of the force.
    let u = |y: usize| {
        let (drho, u) = fluid.moments_at([0, y, 0]);
        u[0] - 0.5 * force[0] / (1.0 + drho)
    };
    let off = relative_l2_error((0..height).map(|y| (u(y), curve(y))));
    let mut wall = 0.0;
    for (y, into) in [(0, -1), (height - 1, 1)] {
        let left = fluid.outgoing_populations([0, y, 0]);
        // Bounce-back at a resting wall reverses the momentum.
        wall += (1..Q)
            .filter(|k| VELOCITIES[*k][1] == into)
            .map(|k| f64::from(VELOCITIES[k][0]) * 2.0 * left[k])
            .sum::<f64>();
    }
    (off, wall / (force[0] * h))
}

#[test]
fn poiseuille_flow_is_second_order_and_walls_balance_the_force() {
    for tau in [0.55, 0.8, 1.5] {
        let list = [8, 16, 32].map(|h| poiseuille_errors(h, tau, false));
        // Twice the cells, a quarter of the error: the order is the logarithm of the quotient to base 2.
        let order = [(list[0].0 / list[1].0).log2(), (list[1].0 / list[2].0).log2()];
        println!("poiseuille tau {tau}: {:.4e} {:.4e} {:.4e}, order {order:.3?}", list[0].0, list[1].0, list[2].0);
        println!("  wall force less 1: {:.2e} {:.2e} {:.2e}", list[0].1 - 1.0, list[1].1 - 1.0, list[2].1 - 1.0);
        assert!(order.iter().all(|o| (o - 2.0).abs() < 0.1), "tau {tau}: order {order:?}");
        assert!(list.iter().all(|l| (l.1 - 1.0).abs() < 1e-6));
        if tau == 0.8 {
            // Known figures, which a change of the scheme or of its walls would alter.
            for (l, known) in list.iter().zip([1.11e-2, 2.78e-3, 6.95e-4]) {
                assert!((l.0 / known - 1.0).abs() < 0.05, "{} against {known}", l.0);
            }
        }
    }
    let (off, wall) = poiseuille_errors(32, 0.8, true);
    println!("poiseuille f32 H 32: {off:.3e}, wall {:.2e}", wall - 1.0);
    assert!(off < 8e-4 && (wall - 1.0).abs() < 5e-4, "{off} {wall}");
}

/// Errors of viscosity and of velocity after half of the energy has dissipated.
fn taylor_green_errors(n: usize, ours: bool) -> (f64, f64) {
    let (tau, u0, k) = (0.8, 0.8 / n as f64, std::f64::consts::TAU / n as f64);
    let domain = domain([n, n, 1], [FaceCondition::Periodic; 6], |_| false);
    let mut fluid =
        if ours { TestFlow::production(domain, tau, [0.0; 3]) } else { TestFlow::reference(domain, tau, [0.0; 3]) };
    let (sin, cos) = (|x: usize| (k * x as f64).sin(), |x: usize| (k * x as f64).cos());
    let wave = |x: usize, y: usize| [-u0 * cos(x) * sin(y), u0 * sin(x) * cos(y), 0.0];
    for y in 0..n {
        for x in 0..n {
            let twice = |x: usize| (2.0 * k * x as f64).cos();
            // The pressure that balances the vortices, as a deviation of the density: p = drho / 3.
            let drho = -0.75 * u0 * u0 * (twice(x) + twice(y));
            // The stress of the shear, after the collision: (tau - 1) of -w tau / cs^2 c_a c_b d_a u_b.
            let (xx, yy) = (u0 * k * sin(x) * sin(y), -u0 * k * sin(x) * sin(y));
            let g = std::array::from_fn(|i| {
                let c = VELOCITIES[i].map(f64::from);
                let shear = c[0] * c[0] * xx + c[1] * c[1] * yy;
                equilibrium(i, drho, wave(x, y)) - 3.0 * (tau - 1.0) * super::stencil::weight(i) * shear
            });
            fluid.set_populations([x, y, 0], g);
        }
    }
    fluid.rebuild_exchange();
    let energy = |f: &TestFlow| {
        let all = (0..n * n).map(|c| f.moments_at([c % n, c / n, 0]).1);
        all.map(|u| u[0] * u[0] + u[1] * u[1]).sum::<f64>()
    };
    let before = energy(&fluid);
    // Velocities decay as exp(-2 nu k^2 t), energy with twice the exponent.
    let steps = (std::f64::consts::LN_2 / (2.0 * lattice_viscosity(tau) * 2.0 * k * k)).round();
    // In eight parts, for the plot.
    let steps_until = |part: usize| steps as usize * part / 8;
    for part in 1..=8 {
        fluid = fluid.run(steps_until(part) - steps_until(part - 1));
        let known = (-4.0 * lattice_viscosity(tau) * k * k * steps_until(part) as f64).exp();
        println!(
            "decay N {n} ours {ours}: {:.5} {:.6} {known:.6}",
            steps_until(part) as f64 / steps,
            energy(&fluid) / before
        );
    }
    let measured = (before / energy(&fluid)).ln() / (4.0 * k * k * steps);
    let fade = (-2.0 * lattice_viscosity(tau) * k * k * steps).exp();
    let off = relative_l2_error((0..n * n).flat_map(|c| {
        let (u, w) = (fluid.moments_at([c % n, c / n, 0]).1, wave(c % n, c / n));
        [(u[0], w[0] * fade), (u[1], w[1] * fade)]
    }));
    ((measured / lattice_viscosity(tau) - 1.0).abs(), off)
}

#[test]
fn taylor_green_vortices_decay_at_the_lattice_viscosity() {
    for (n, nu, velocity) in [(16, 5e-3, 2.5e-2), (32, 1.3e-3, 6.5e-3), (64, 3.5e-4, 1.6e-3)] {
        for ours in [false, true] {
            let (off_nu, off) = taylor_green_errors(n, ours);
            println!("taylor-green N {n} ours {ours}: nu {off_nu:.3e}, velocity {off:.3e}");
            assert!(off_nu < nu && off < velocity, "N {n}, ours {ours}: {off_nu} {off}");
        }
    }
}

/// Heights and velocities of Ghia, Ghia, Shin 1982, table I.
const GHIA_HEIGHTS: [f64; 15] = [
    0.9766, 0.9688, 0.9609, 0.9531, 0.8516, 0.7344, 0.6172, 0.5, 0.4531, 0.2813, 0.1719, 0.1016, 0.0703, 0.0625, 0.0547,
];
const GHIA_RE_100: [f64; 15] = [
    0.84123, 0.78871, 0.73722, 0.68717, 0.23151, 0.00332, -0.13641, -0.20581, -0.21090, -0.15662, -0.10150, -0.06434,
    -0.04775, -0.04192, -0.03717,
];
const GHIA_RE_400: [f64; 15] = [
    0.75837, 0.68439, 0.61756, 0.55892, 0.29093, 0.16256, 0.02135, -0.11477, -0.17119, -0.32726, -0.24299, -0.14612,
    -0.10338, -0.09266, -0.08186,
];
const GHIA_RE_1000: [f64; 15] = [
    0.65928, 0.57492, 0.51117, 0.46604, 0.33304, 0.18719, 0.05702, -0.06080, -0.10648, -0.27805, -0.38289, -0.29730,
    -0.22220, -0.20196, -0.18109,
];

fn cavity_domain(n: usize, lid: f64) -> Domain {
    let top = FaceCondition::Wall([lid, 0.0, 0.0]);
    domain(
        [n, n, 1],
        [RESTING_WALL, RESTING_WALL, RESTING_WALL, top, FaceCondition::Periodic, FaceCondition::Periodic],
        |_| false,
    )
}

/// Greatest difference and root mean square difference from the table.
fn lid_driven_cavity_errors(n: usize, re: f64, turns: usize, table: &[f64; 15]) -> (f64, f64) {
    let lid = 0.1;
    // Re = lid n / nu with nu = (tau - 0.5) / 3.
    let tau = 0.5 + 3.0 * lid * n as f64 / re;
    let fluid = TestFlow::production(cavity_domain(n, lid), tau, [0.0; 3]).run(turns * n * 10);
    // n is even: the middle lies between two columns of nodes.
    let middle =
        |y: usize| 0.5 * (fluid.moments_at([n / 2 - 1, y, 0]).1[0] + fluid.moments_at([n / 2, y, 0]).1[0]) / lid;
    let off: Vec<f64> = GHIA_HEIGHTS
        .iter()
        .zip(table)
        .map(|(height, known)| {
            let s = height * n as f64 - 0.5;
            let y = (s as usize).min(n - 2);
            let part = s - y as f64;
            let u = middle(y) + (middle(y + 1) - middle(y)) * part;
            println!("ghia {re} {height} {known} {u:.5}");
            (u - known).abs()
        })
        .collect();
    let rms = (off.iter().map(|o| o * o).sum::<f64>() / 15.0).sqrt();
    let worst = off.iter().copied().fold(0.0, f64::max);
    println!("cavity Re {re} N {n}: max {worst:.3e} rms {rms:.3e}");
    (worst, rms)
}

#[test]
fn cavity_at_re_100_matches_ghia() {
    let (worst, rms) = lid_driven_cavity_errors(64, 100.0, 40, &GHIA_RE_100);
    assert!(worst < 8e-3 && rms < 4e-3, "{worst} {rms}");
}

#[test]
#[ignore = "half a minute; tests/full.sh runs it"]
fn cavity_at_re_400_and_1000_matches_ghia() {
    let (worst, rms) = lid_driven_cavity_errors(64, 400.0, 80, &GHIA_RE_400);
    assert!(worst < 1.4e-2 && rms < 6e-3, "{worst} {rms}");
    let (worst, rms) = lid_driven_cavity_errors(96, 1000.0, 150, &GHIA_RE_1000);
    assert!(worst < 1.9e-2 && rms < 9e-3, "{worst} {rms}");
}

#[test]
fn closed_cavity_conserves_mass() {
    for (ours, bound) in [(false, 1e-14), (true, 1e-6)] {
        let walls = cavity_domain(24, 0.1);
        let fluid =
            if ours { TestFlow::production(walls, 0.6, [0.0; 3]) } else { TestFlow::reference(walls, 0.6, [0.0; 3]) };
        let fluid = fluid.run(10_000);
        let n = fluid.grid().n;
        // Populations are kept less their equilibrium at rest, so that the mass of still air is 0.
        let mass: f64 = (0..n[0] * n[1]).map(|c| fluid.moments_at([c % n[0], c / n[0], 0]).0).sum();
        let drift = mass.abs() / (n[0] * n[1]) as f64;
        println!("mass drift, ours {ours}: {drift:.3e}");
        assert!(drift < bound, "ours {ours}: {drift}");
    }
}

#[test]
fn production_solver_matches_the_reference_solver() {
    let n = [37, 20, 12];
    let faces = [
        FaceCondition::Inlet,
        FaceCondition::Outlet,
        FaceCondition::Rough,
        FaceCondition::Slip,
        FaceCondition::Periodic,
        FaceCondition::Periodic,
    ];
    let make = || {
        let domain = domain(n, faces, |[x, y, z]| (10..14).contains(&x) && y < 8 && (3..8).contains(&z));
        with_random_cuts(domain, |[x, y, _]| (18..24).contains(&x) && y < 9)
    };
    let tau = 0.5005;
    // The reference solver, in double precision with two copies of the populations.
    let mut plain = ReferenceSolver::new(make(), tau, smagorinsky_factor(0.16));
    let sponge: Vec<f64> = (0..n[0])
        .map(|x| {
            // A sponge before the outlet: its increase of tau is proportional to the square of the distance.
            let k = (x as f64 - 28.0).max(0.0) / 8.0;
            k * k
        })
        .collect();
    plain.sponge[0].clone_from(&sponge);
    let ground = GroundModel::for_log_profile(0.1, tau, 0.16, 0.08, 20.0, n[1]);
    plain.ground = ground.clone();
    let v = FlowParams {
        tau: tau as f32,
        smagorinsky_factor: smagorinsky_factor(0.16) as f32,
        sponge: [sponge.iter().map(|t| *t as f32).collect(), Vec::new()],
        ground: ground.clone(),
        force: [0.0; 3],
    };
    // The production solver with the same parameters, in single precision and in place.
    let mut ours = FlowState::new(make(), v, false).expect("memory");
    let inlets = ours.exchange.open_boundary.inlet_positions();
    // The velocity above rough ground, 1 at 20 cells, and its slope, which shears the inflow.
    let log = |y: isize| (((y as f64 + 0.5) / 0.1).max(0.0) + 1.0).ln() / 201.0_f64.ln();
    // Ghost nodes below the ground have no shear.
    let growth = |y: isize| if y < 0 { 0.0 } else { 1.0 / (y as f64 + 0.6) / 201.0_f64.ln() };
    let leans = |y: isize| shear_coefficient(f64::from(ground.min_tau_at(y.max(0) as usize, tau as f32)), growth(y));
    let leaning: Vec<f32> = inlets.iter().map(|p| leans(p[1]) as f32).collect();
    // Ramp up the inflow, then compare the velocities of all fluid cells.
    for step in 1..=600 {
        let t = (step as f64 / 100.0).min(1.0);
        let ramp = 0.08 * t * t * (3.0 - 2.0 * t);
        let wanted = [0.0, 0.8 * ramp, 0.0, 0.0, 0.0, 0.0];
        plain.advance(|p| ([ramp * log(p[1]), 0.0, 0.0], [ramp * leans(p[1]), 0.0]), wanted);
        let wind = inlets.iter().map(|p| (ramp * log(p[1])) as f32).collect();
        let wind = [wind, vec![0.0; inlets.len()], vec![0.0; inlets.len()]];
        let inputs = BoundaryInputs {
            inlet_velocity: &wind,
            shear: &leaning,
            shear_scale: [ramp as f32, 0.0],
            outlet_velocity: wanted.map(|w| w as f32),
        };
        assert_eq!(ours.advance_one_step(inputs), 0);
        if step == 200 || step == 600 {
            let all = (0..n[0] * n[1] * n[2]).map(|c| [c % n[0], c / n[0] % n[1], c / n[0] / n[1]]);
            let fluid = all.filter(|c| !ours.domain.is_solid(*c));
            let off = relative_l2_error(fluid.flat_map(|c| {
                let (a, b) = (ours.moments_at(c).1, plain.moments_at(c).1);
                (0..3).map(move |k| (f64::from(a[k]), b[k])).collect::<Vec<_>>()
            }));
            println!("AA against pull at {step}: {off:.3e}");
            assert!(off < if step == 200 { 5e-6 } else { 3e-5 }, "{off} at {step}");
        }
    }
}

#[test]
fn cut_links_keep_mass_and_let_nothing_through() {
    // Two halves of a closed box separated by a cut plane: air that moves in one leaves the other at rest.
    let n = [24, 10, 8];
    for ours in [false, true] {
        let mut domain = domain(n, [RESTING_WALL; 6], |_| false);
        let half = |c: usize| {
            let bits = (1..Q).filter(|i| c % n[0] == 11 && VELOCITIES[*i][0] == 1);
            bits.fold(0, |bits, i| bits | 1 << i)
        };
        domain.cuts = CutHalfLinks::from_halves((0..domain.grid.cell_count()).map(half).collect());
        let mut flow =
            if ours { TestFlow::production(domain, 0.6, [0.0; 3]) } else { TestFlow::reference(domain, 0.6, [0.0; 3]) };
        for y in 0..n[1] {
            flow.set_populations(
                [4, y, 3],
                std::array::from_fn(|i| weight(i) * (0.02 + 0.1 * f64::from(VELOCITIES[i][0]))),
            );
        }
        flow.rebuild_exchange();
        let mass = |flow: &TestFlow, x: std::ops::Range<usize>| -> f64 {
            let cells = x.flat_map(|x| (0..n[1] * n[2]).map(move |c| [x, c % n[1], c / n[1]]));
            cells.map(|c| flow.moments_at(c).0).sum()
        };
        let before = mass(&flow, 0..12);
        let flow = flow.run(300);
        let (left, right) = (mass(&flow, 0..12), mass(&flow, 12..24));
        println!("cut plane, ours {ours}: mass {before:.6}, then {left:.6} and {right:.1e}");
        assert!((left / before - 1.0).abs() < 1e-5 && right.abs() <= 0.0, "{before} {left} {right}");
    }
}

/// Air at rest in a partly solid box. `along` 0: inlets, outlets and rough ground; otherwise periodic faces, a moving wall and
/// one at rest. `rest`: outlets pass on the non-equilibrium part.
fn flow_with_mixed_boundaries(n: [usize; 3], along: usize, rest: bool) -> FlowState {
    let mut faces = [
        FaceCondition::Periodic,
        FaceCondition::Periodic,
        FaceCondition::Wall([0.0, 0.0, 0.02]),
        FaceCondition::Slip,
        RESTING_WALL,
        FaceCondition::Slip,
    ];
    if along == 0 {
        faces = [
            FaceCondition::Inlet,
            FaceCondition::Outlet,
            FaceCondition::Rough,
            FaceCondition::Slip,
            FaceCondition::Inlet,
            FaceCondition::Outlet,
        ];
    }
    let solid = |[x, y, z]: [usize; 3]| x == n[0] / 2 && y < n[1] / 2 && z < n[2] / 2;
    let sponge = [(0..n[0]).map(|x| if x + 3 > n[0] { 0.4 } else { 0.0 }).collect(), Vec::new()];
    let ground = if along == 0 {
        GroundModel::for_log_profile(0.1, 0.51, 0.16, 0.05, n[1] as f64, n[1])
    } else {
        GroundModel::default()
    };
    let v = FlowParams { sponge, ground, ..flow_params(0.51, 0.16, [0.0; 3]) };
    let domain = with_random_cuts(domain(n, faces, solid), |[x, _, z]| 3 * x < n[0] && 2 * z < n[2]);
    FlowState::new(domain, v, rest).expect("memory")
}

#[test]
fn fused_steps_equal_single_steps() {
    for (n, along, rest) in [
        ([37, 20, 12], 0, true),
        ([16, 9, 5], 0, false),
        ([9, 8, 3], 1, false),
        ([8, 8, 1], 1, false),
        ([33, 12, 17], 1, false),
    ] {
        // One flow makes two single steps, the other one fused pass; both start from the same bits.
        let [mut one, mut two] = [0, 1].map(|_| flow_with_mixed_boundaries(n, along, rest));
        let count = one.exchange.open_boundary.inlet_positions().len();
        for step in 0..24 {
            let u = 0.05 * (1.0 + step as f32 / 24.0);
            let wind = [0, 1].map(|k| [vec![u + 0.001 * k as f32; count], vec![0.0; count], vec![u / 2.0; count]]);
            let leaning = vec![0.01 * u; count];
            let inputs = [0, 1].map(|k| BoundaryInputs {
                inlet_velocity: &wind[k],
                shear: &leaning,
                shear_scale: [1.0, 0.5],
                outlet_velocity: [0.0, u, 0.0, 0.0, 0.0, u / 2.0],
            });
            let both = two.advance_one_or_two_steps(inputs[0], Some(inputs[1]), None).clamped;
            assert_eq!([one.advance_one_step(inputs[0]), one.advance_one_step(inputs[1])], both);
        }
        let fluid = (0..n[0] * n[1] * n[2]).map(|c| [c % n[0], c / n[0] % n[1], c / n[0] / n[1]]);
        let fluid = fluid.filter(|c| !one.domain.is_solid(*c));
        // Equality is meaningless for air at rest: some air must have moved.
        let mut moves = 0.0_f32;
        for cell in fluid {
            assert_eq!(
                one.outgoing_populations(cell).map(f32::to_bits),
                two.outgoing_populations(cell).map(f32::to_bits),
                "{n:?} at {cell:?}"
            );
            moves = moves.max(one.moments_at(cell).1.map(f32::abs).into_iter().fold(0.0, f32::max));
        }
        assert!(moves > 1e-3, "{moves}");
    }
}

#[test]
fn uniform_wind_between_slip_walls_stays_uniform() {
    let faces = [
        FaceCondition::Inlet,
        FaceCondition::Outlet,
        FaceCondition::Slip,
        FaceCondition::Slip,
        FaceCondition::Periodic,
        FaceCondition::Periodic,
    ];
    let v = flow_params(0.5005, 0.16, [0.0; 3]);
    let mut flow = FlowState::new(domain([24, 12, 9], faces, |_| false), v, false).expect("memory");
    let u = [0.08_f32, 0.0, 0.0];
    for c in 0..24 * 12 * 9 {
        let cell = [c % 24, c / 24 % 12, c / 24 / 12];
        let e = flow.domain.grid.node_element(cell.map(|c| c as isize));
        for i in 0..Q {
            let (k, e) = flow.domain.grid.outgoing_slot_of(StepParity::from_step(0), i, e);
            flow.populations.arrays_mut()[k][e] = equilibrium(i, 0.0, u);
        }
    }
    flow.exchange.rebuild_from_populations(&flow.populations, StepParity::from_step(0));
    let wind = u.map(|u| vec![u; flow.exchange.open_boundary.inlet_positions().len()]);
    for _ in 0..500 {
        let shear = vec![0.0; wind[0].len()];
        flow.advance_one_step(BoundaryInputs {
            inlet_velocity: &wind,
            shear: &shear,
            shear_scale: [0.0; 2],
            outlet_velocity: [0.0, u[0], 0.0, 0.0, 0.0, 0.0],
        });
    }
    let off = (0..24 * 12 * 9).map(|c| {
        let now = flow.moments_at([c % 24, c / 24 % 12, c / 24 / 12]).1;
        (0..3).map(|a| (now[a] - u[a]).abs()).fold(0.0, f32::max)
    });
    let off = off.fold(0.0, f32::max);
    println!("uniform wind between slip walls: off by {off:.2e}");
    assert!(off < 1e-6, "{off}");
}
