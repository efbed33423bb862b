//! `[wind.lattice]`: the lattice Boltzmann wind.

use glam::DVec3;

use crate::recipe::Recipe;
use crate::recipe::resolve::{Resolver, span_of};
use crate::recipe::syntax::{
    BooleanType, NumberArray, OneOf, OptionalKey, RisingPairs, TomlTable, integer, number, point,
};
use crate::recipe::syntax::{choices, keys};
use osier_base::diagnostic::Diagnostic;
use osier_base::math::{cos, sin};
use osier_base::physics::AIR_VISCOSITY;
use osier_wind::{
    GroundCondition, InletOptions, LatticeFault, LatticeOptions, SideCondition, WindProfile, lattice_fault,
};

choices! {
    /// Solver of a lattice wind.
    WindSolver {
        /// Lattice Boltzmann simulation, with wakes and shelter of solids.
        Lbm = "lbm",
        /// Profile and gusts of the inlet in the whole domain: no simulation, no wakes.
        Analytic = "analytic",
        /// No wind: velocities are zero.
        Still = "none",
    }
    /// Source of the default values of a lattice wind.
    LatticePreset {
        /// Defaults of this program.
        Own = "own",
        /// Table 2 of the paper on catkins: 70 cells of 0.5 m along each axis, 2 m/s at the top, no gusts, no sponge, smooth
        /// ground.
        Paper = "paper",
    }
    /// Boundary condition of the side faces of the domain.
    LatticeSides {
        /// Periodic if the wind is within 1 degree of an axis, else open.
        Auto = "auto",
        /// Impermeable without friction.
        Slip = "slip",
        /// Air enters or leaves with the prescribed wind.
        Open = "open",
    }
    /// Boundary condition of the ground.
    LatticeGround {
        /// Wall stress of a logarithmic profile over the roughness, so that the wind keeps its profile.
        Rough = "rough",
        /// No slip half a cell below the lowest cell centres, as in the paper.
        Smooth = "smooth",
    }
    /// Populations that enter the domain from an outlet.
    LatticeOutlet {
        /// Equilibrium populations.
        Equilibrium = "equilibrium",
        /// Equilibrium populations plus the nonequilibrium part of those that left, which damps less.
        Nonequilibrium = "nonequilibrium",
    }
    /// Speed of the inlet as a function of height.
    LatticeProfile {
        /// Logarithmic law over ground of a roughness.
        Log = "log",
        /// Power law with `exponent`.
        Power = "power",
        /// The same speed at all heights.
        Uniform = "uniform",
        /// Linear interpolation of `profile_table`.
        Table = "table",
    }
}

keys! {
    /// Lattice Boltzmann wind around solids, with `[wind] model = "lattice"`. It uses speed, direction_deg and scale of
    /// `[wind]`; gusts and turbulence of the inflow are those of this table.
    LatticeKeys at "wind.lattice" {
        /// Solver: lattice Boltzmann ("lbm"), the undisturbed inflow everywhere ("analytic"), or no wind.
        solver: WindSolver = "solver" OneOf(WindSolver::Lbm);
        /// Source of the defaults: osier's ("own"), or Table 2 of the paper.
        preset: LatticePreset = "preset" OneOf(LatticePreset::Own);
        /// Number of cells along x, y and z.
        cells: [f64; 3] = "cells" NumberArray([70.0; 3], number(70.0, 8.0, 4096.0, ""));
        /// Side length of a cell.
        cell_size: f64 = "dx" number(0.5, 0.02, 10.0, "m");
        /// Bottom centre of the domain, on the ground.
        at: [f64; 3] = "at" point([0.0; 3]);
        /// Kinematic viscosity; `tau_floor` usually imposes a larger one.
        viscosity: f64 = "nu" number(AIR_VISCOSITY, 0.0, 0.01, "m^2/s");
        /// Time steps per frame.
        steps: Option<u32> = "steps" OptionalKey(integer(2, 1, 10_000), "from the wind speed");
        /// Smagorinsky constant of the eddy viscosity; 0 requires tau_floor = 0.505.
        smagorinsky: f64 = "smagorinsky" number(0.16, 0.0, 0.3, "");
        /// Smallest relaxation time.
        tau_floor: f64 = "tau_floor" number(0.5005, 0.5001, 1.0, "steps");
        /// Boundary condition of the sides along the wind.
        sides: LatticeSides = "sides" OneOf(LatticeSides::Auto);
        /// Populations that enter at outlets.
        outlet: LatticeOutlet = "outlet" OneOf(LatticeOutlet::Equilibrium);
        /// Width in cells of the viscous layer (sponge) before an outlet.
        sponge: Option<u32> = "sponge" OptionalKey(integer(8, 0, 32), "4 m, at most a sixth of the box");
        /// Inflow profile over height.
        profile: LatticeProfile = "profile" OneOf(LatticeProfile::Log);
        /// Boundary condition of the ground: wall stress of a rough surface, or no slip.
        ground: LatticeGround = "ground" OneOf(LatticeGround::Rough);
        /// Roughness length of the ground and of the profile "log".
        roughness: f64 = "roughness" number(0.05, 1e-4, 2.0, "m");
        /// With "power": exponent of the profile.
        exponent: f64 = "exponent" number(0.2, 0.14, 0.4, "");
        /// With "table": pairs of height (m, increasing) and factor on the speed.
        profile_table: Vec<[f64; 2]> = "profile_table" RisingPairs(number(0.0, 0.0, 1e4, ""));
        /// Pairs of time (s from the first frame, increasing) and speed (m/s), linearly interpolated, instead of
        /// `wind.speed`. Such a wind does not loop.
        speed_curve: Vec<[f64; 2]> = "speed_curve" RisingPairs(number(0.0, 0.0, 1e4, ""));
        /// Pairs of time (s from the first frame, increasing) and direction (degrees), linearly interpolated, instead of
        /// `wind.direction_deg`; values beyond 360 for full rotations. Such a wind does not loop.
        direction_curve: Vec<[f64; 2]> = "direction_curve" RisingPairs(number(0.0, -1e4, 1e4, ""));
        /// Height at which the wind has its speed.
        reference_height: Option<f64> = "reference_height" OptionalKey(number(10.0, 0.1, 1e4, "m"), "10 m, or the height of the domain");
        /// Relative amplitude of gusts of the inflow.
        gust: f64 = "gust" number(0.2, 0.0, 0.5, "");
        /// Correlation time of gusts.
        gust_period: f64 = "gust_period" number(8.0, 0.1, 600.0, "s");
        /// Turbulence intensity of the inflow, per component.
        turbulence: f64 = "turbulence" number(0.1, 0.0, 0.4, "");
        /// Longest wavelength of the turbulence; the shortest is an eighth of it, or six cells if that is longer.
        turbulence_length: Option<f64> = "turbulence_length" OptionalKey(number(20.0, 0.1, 1e3, "m"), "twice the reference height, at most the height of the domain");
        /// Number of Fourier modes of the turbulence.
        modes: u32 = "modes" integer(24, 0, 128);
        /// Duration of the spin-up before the first frame.
        spin_up: Option<f64> = "spin_up_s" OptionalKey(number(20.0, 0.0, 3600.0, "s"), "the time in which the wind crosses the domain, twice that with open sides");
        /// Whether a bake stores the state after spin-up in `wind/` of its folder (60 bytes per cell), from which later
        /// bakes start.
        keep: bool = "keep" BooleanType(false);
    }
}

impl Recipe {
    /// Options of the solver from the keys of `[wind]` and `[wind.lattice]`.
    pub fn lattice_options(&self) -> LatticeOptions {
        let (wind, keys) = (&self.wind, &self.lattice);
        let direction = DVec3::new(cos(wind.direction), 0.0, -sin(wind.direction));
        // cos(90 degrees) is 6e-17 in floating point: set such components to zero, so that the wind is exactly along an axis.
        let direction =
            DVec3::from_array(direction.to_array().map(|d| if d.abs() < 1e-12 { 0.0 } else { d })).normalize();
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "whole numbers from 8 to 4096")]
        let cells = keys.cells.map(|n| n as u32);
        LatticeOptions {
            cells,
            spacing: keys.cell_size,
            base_center: DVec3::from_array(keys.at),
            inlet: InletOptions {
                direction,
                speed: wind.speed,
                speed_curve: keys.speed_curve.clone(),
                direction_curve: keys.direction_changes(),
                profile: match keys.profile {
                    LatticeProfile::Log => WindProfile::Log(keys.roughness),
                    LatticeProfile::Power => WindProfile::Power(keys.exponent),
                    LatticeProfile::Uniform => WindProfile::Uniform,
                    LatticeProfile::Table => WindProfile::Table(keys.profile_table.clone()),
                },
                reference_height: keys.reference_height,
                gust_strength: keys.gust,
                gust_period: keys.gust_period,
                turbulence: keys.turbulence,
                turbulence_length: keys.turbulence_length,
                turbulence_modes: keys.modes,
                seed: self.general.seed,
            },
            viscosity: keys.viscosity,
            fps: self.clip.fps(),
            steps_per_frame: keys.steps,
            smagorinsky: keys.smagorinsky,
            tau_floor: keys.tau_floor,
            ground: match keys.ground {
                LatticeGround::Rough => GroundCondition::Rough(keys.roughness),
                LatticeGround::Smooth => GroundCondition::Smooth,
            },
            sides: match keys.sides {
                LatticeSides::Auto => SideCondition::Auto,
                LatticeSides::Slip => SideCondition::Slip,
                LatticeSides::Open => SideCondition::Open,
            },
            outlet_nonequilibrium: keys.outlet == LatticeOutlet::Nonequilibrium,
            sponge_cells: keys.sponge,
            spin_up: keys.spin_up,
            lead_frames: 0,
        }
    }
}

impl Resolver<'_> {
    /// S004 for a number of time steps or a relaxation time that does not fit the wind of a lattice. A scene with other errors is not
    /// checked, since its recipe lacks what could not be read.
    pub(in crate::recipe) fn check_lattice(&mut self, root: &TomlTable, recipe: &Recipe) {
        let is_simulated = recipe.has_lattice_wind() && recipe.lattice.solver == WindSolver::Lbm;
        // A still scene reads the wind in the spin-up of a flight only.
        if self.report.has_errors() || !is_simulated || recipe.clip.len() < 2 && recipe.flight.is_none() {
            return;
        }
        let place = |key: &str| span_of(root, &["wind", "lattice", key]);
        let d = match lattice_fault(&recipe.lattice_options()) {
            None => return,
            Some(LatticeFault::TimeSteps { steps, needed }) => {
                let text = format!("wind.lattice.steps is {steps}, but this wind needs {needed} or more per frame");
                let at = place("steps").unwrap_or(self.whole);
                let help = "leave steps out: their number follows from the speed of the wind";
                Diagnostic::error("S004", text, at, format!("must be {needed} or more")).help(help)
            }
            Some(LatticeFault::RelaxationTime { tau, least }) => {
                let text = format!("wind.lattice.smagorinsky is 0, but the relaxation time is only {tau} steps");
                let at = place("tau_floor").or_else(|| place("smagorinsky")).unwrap_or(self.whole);
                let help = format!("write tau_floor = {least}, or leave smagorinsky out");
                Diagnostic::error("S004", text, at, format!("must be {least} or more")).help(help)
            }
        };
        self.report.push(d);
    }
}
