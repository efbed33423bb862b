//! `[wind.lattice]`: the lattice Boltzmann wind.

use crate::recipe::syntax::{BooleanType, NumberArray, OneOf, OptionalKey, RisingPairs, integer, number, point};
use crate::recipe::syntax::{choices, keys};

choices! {
    /// How a lattice wind is found.
    WindSolver {
        /// By the lattice.
        Lbm = "lbm",
        /// What comes in, everywhere: at once, without wakes.
        Analytic = "analytic",
        /// Still air.
        Still = "none",
    }
    /// Whose lattice wind.
    LatticePreset {
        /// One's own.
        Own = "own",
        /// That of the paper on catkins, its Table 2: 70 cells of 0.5 m each way, 2 m/s at the top, no gusts, no sponge, smooth ground.
        Paper = "paper",
    }
    /// What the faces along the wind do.
    LatticeSides {
        /// Joined if the wind blows along an axis to 1 degree, else open.
        Auto = "auto",
        /// Nothing passes, nothing drags.
        Slip = "slip",
        /// Air comes in or goes out, as the wind has it.
        Open = "open",
    }
    /// What the ground does to the air.
    LatticeGround {
        /// It takes the stress of a logarithmic profile over its roughness, so that the wind keeps its profile.
        Rough = "rough",
        /// It holds the air half a cell below the lowest middles, as the paper has it.
        Smooth = "smooth",
    }
    /// What goes back in from an outlet.
    LatticeOutlet {
        /// Air at equilibrium.
        Equilibrium = "equilibrium",
        /// With the rest of what came out: less damped.
        Nonequilibrium = "nonequilibrium",
    }
    /// How the wind that comes in grows with the height.
    LatticeProfile {
        /// With the logarithm, over ground of a roughness.
        Log = "log",
        /// With a power.
        Power = "power",
        /// Not at all.
        Uniform = "uniform",
        /// As `profile_table` says.
        Table = "table",
    }
}

keys! {
    /// A box of air that flows round solids, with `[wind] model = "lattice"`. Of `[wind]` it takes speed, direction_deg and
    /// scale; of its own gusts and turbulence comes in.
    LatticeKeys at "wind.lattice" {
        /// How it is found.
        solver: WindSolver = "solver" OneOf(WindSolver::Lbm);
        /// Whose: keys that are not given take its values.
        preset: LatticePreset = "preset" OneOf(LatticePreset::Own);
        /// Cells along x, y and z.
        cells: [f64; 3] = "cells" NumberArray([70.0; 3], number(70.0, 8.0, 4096.0, ""));
        /// Side of a cell.
        cell_size: f64 = "dx" number(0.5, 0.02, 10.0, "m");
        /// Middle of the bottom of the box, which is ground.
        at: [f64; 3] = "at" point([0.0; 3]);
        /// Kinematic viscosity; the lattice is seldom as thin as air.
        viscosity: f64 = "nu" number(1.5e-5, 0.0, 0.01, "m^2/s");
        /// Steps a frame.
        steps: Option<u32> = "steps" OptionalKey(integer(2, 1, 10_000), "as many as the wind needs");
        /// Smagorinsky's constant of eddy viscosity; 0 needs tau_floor = 0.505.
        smagorinsky: f64 = "smagorinsky" number(0.16, 0.0, 0.3, "");
        /// Least relaxation time.
        tau_floor: f64 = "tau_floor" number(0.5005, 0.5001, 1.0, "steps");
        /// What the faces along the wind do.
        sides: LatticeSides = "sides" OneOf(LatticeSides::Auto);
        /// What goes back in from an outlet.
        outlet: LatticeOutlet = "outlet" OneOf(LatticeOutlet::Equilibrium);
        /// Cells before an outlet in which the air thickens.
        sponge: u32 = "sponge" integer(8, 0, 32);
        /// How the wind that comes in grows with the height.
        profile: LatticeProfile = "profile" OneOf(LatticeProfile::Log);
        /// What the ground does to the air.
        ground: LatticeGround = "ground" OneOf(LatticeGround::Rough);
        /// Roughness of the ground: of the profile "log", and of rough ground.
        roughness: f64 = "roughness" number(0.05, 1e-4, 2.0, "m");
        /// With "power": the power.
        exponent: f64 = "exponent" number(0.2, 0.14, 0.4, "");
        /// With "table": heights (m), rising, and factors on the speed.
        profile_table: Vec<[f64; 2]> = "profile_table" RisingPairs(number(0.0, 0.0, 1e4, ""));
        /// Times (s from the clip's first frame), rising, and speeds (m/s) there instead of `wind.speed`, straight between them: a storm that
        /// comes up. Such a wind does not repeat.
        speed_curve: Vec<[f64; 2]> = "speed_curve" RisingPairs(number(0.0, 0.0, 1e4, ""));
        /// Times (s from the clip's first frame), rising, and directions there instead of `wind.direction_deg`, straight between them and
        /// beyond 360 for whole turns: a wind that turns. It does not repeat.
        direction_curve: Vec<[f64; 2]> = "direction_curve" RisingPairs(number(0.0, -1e4, 1e4, ""));
        /// Height at which the wind has its speed.
        reference_height: Option<f64> = "reference_height" OptionalKey(number(10.0, 0.1, 1e4, "m"), "10 m, or the height of the box");
        /// Strength of gusts over the mean.
        gust: f64 = "gust" number(0.2, 0.0, 0.5, "");
        /// Time after which a gust is forgotten.
        gust_period: f64 = "gust_period" number(8.0, 0.1, 600.0, "s");
        /// Strength of each component of turbulence over the mean.
        turbulence: f64 = "turbulence" number(0.1, 0.0, 0.4, "");
        /// Waves that turbulence is made of.
        modes: u32 = "modes" integer(24, 0, 128);
        /// Time before the first frame, in which the wind sets in.
        spin_up: Option<f64> = "preroll" OptionalKey(number(20.0, 0.0, 3600.0, "s"), "one flow through the box");
        /// A bake keeps the air that has set in, in `wind/` of its folder and 60 bytes a cell, and a bake that finds it there goes on from
        /// it: for large boxes.
        keep: bool = "keep" BooleanType(false);
    }
}
