//! Keys of wind and of what it moves.

use super::key::{keys, words};
use super::kinds::{Flag, Maybe, OneOf, SomeOf, Steps, Tuple, deg, num, point, whole};

words! {
    /// What wind there is.
    WindModel {
        /// None.
        Calm = "calm",
        /// The same everywhere and always.
        Uniform = "uniform",
        /// Gusts that travel downwind, with eddies in them.
        Gust = "gust",
        /// A sine with noise on it, as in the paper by Zhao and Zhang.
        Perlin = "perlin",
        /// Air that flows round what stands in it, on a lattice; `[wind.lattice]` says how.
        Lattice = "lattice",
    }
    /// How a lattice wind is found.
    Solver {
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
    /// An axis.
    Across {
        /// East.
        X = "x",
        /// Up.
        Y = "y",
        /// South.
        Z = "z",
    }
    /// By which equations branches bend.
    SwayModel {
        /// Beams that swing: forces, frequencies and damping of wood.
        Beam = "beam",
        /// Those of the paper by Zhao and Zhang, one cantilever for an internode.
        Paper = "paper",
    }
    /// What is mended in the paper's equations.
    PaperFix {
        /// The fourth power of the radius instead of the third.
        Radius = "radius4",
        /// The density of air instead of a five hundred thousandth of it.
        Air = "air_density",
        /// Damping against the motion instead of always one way.
        Damping = "damping_sign",
    }
    /// How the slope of a bent branch grows along it.
    Profile {
        /// As of an even rod in an even wind.
        Uniform = "uniform",
        /// As its own taper and load have it: thin ends bend more.
        Measured = "measured",
    }
    /// How a clip that does not repeat begins.
    Start {
        /// In the middle of the wind.
        Moving = "moving",
        /// From rest.
        Rest = "rest",
    }
    /// Kinds of green wood.
    Timber {
        /// Quaking aspen, 5.9 GPa.
        Aspen = "aspen",
        /// Bald cypress, 8.2 GPa.
        BaldCypress = "bald_cypress",
        /// Eastern cottonwood, 7.5 GPa.
        Cottonwood = "cottonwood",
        /// Eastern hemlock, 7.4 GPa.
        EasternHemlock = "eastern_hemlock",
        /// Lodgepole pine, 7.4 GPa.
        LodgepolePine = "lodgepole_pine",
        /// Paper birch, 8.1 GPa.
        PaperBirch = "paper_birch",
        /// Sugar maple, 10.7 GPa.
        SugarMaple = "sugar_maple",
        /// Western hemlock, 9 GPa.
        WesternHemlock = "western_hemlock",
        /// White ash, 9.9 GPa.
        WhiteAsh = "white_ash",
        /// White fir, 8.1 GPa.
        WhiteFir = "white_fir",
        /// White oak, 8.6 GPa.
        WhiteOak = "white_oak",
        /// Black willow, 5.4 GPa.
        Willow = "willow",
    }
}

impl Timber {
    /// Young's modulus of the green wood, Pa.
    /// Source: Forest Products Laboratory, "Wood handbook", table of green clear wood.
    pub fn elasticity(self) -> f64 {
        1e9 * match self {
            Self::Aspen => 5.9,
            Self::BaldCypress => 8.2,
            Self::Cottonwood => 7.5,
            Self::EasternHemlock | Self::LodgepolePine => 7.4,
            Self::PaperBirch | Self::WhiteFir => 8.1,
            Self::SugarMaple => 10.7,
            Self::WesternHemlock => 9.0,
            Self::WhiteAsh => 9.9,
            Self::WhiteOak => 8.6,
            Self::Willow => 5.4,
        }
    }
}

keys! {
    /// Wind. Speeds are those at 10 m above the ground. Each [[wind.add]] is one more wind, with the same keys: their
    /// velocities add up.
    WindKeys at "wind" with ["add", "lattice"] {
        /// What kind.
        model: WindModel = "model" OneOf(WindModel::Gust);
        /// Mean speed.
        speed: f64 = "speed" num(4.5, 0.0, 60.0, "m/s");
        /// Mean speed as a number of Beaufort's scale, instead of `speed`.
        beaufort: Option<f64> = "beaufort" Maybe(num(3.0, 0.0, 12.0, "Bft"), "none");
        /// Factor on all of its velocities; what travels in it keeps its pace.
        scale: f64 = "scale" num(1.0, 0.0, 10.0, "");
        /// Where it blows to: 0 towards +X, 90 towards -Z.
        direction: f64 = "direction_deg" deg(0.0, -360.0, 360.0);
        /// Share of the mean that gusts add and take; 0.3 to 0.5 is natural.
        gust: f64 = "gust" num(0.4, 0.0, 1.0, "");
        /// Length of gusts.
        gust_length: f64 = "gust_length" num(40.0, 2.0, 200.0, "m");
        /// Strength of eddies over the mean; 0.15 to 0.25 is natural.
        turbulence: f64 = "turbulence" num(0.2, 0.0, 1.0, "");
        /// Size of eddies.
        eddy_size: f64 = "eddy_size" num(4.0, 0.5, 20.0, "m");
        /// Strength of the flicker that each branch has for itself, over the mean.
        flicker: f64 = "flicker" num(0.15, 0.0, 1.0, "");
        /// How far the direction wanders.
        wander: f64 = "wander_deg" deg(15.0, 0.0, 90.0);
        /// Power of the height with which the mean grows; 0 for the same at all heights.
        power: f64 = "height_power" num(0.2, 0.0, 1.0, "");
        /// With "perlin": exactly as printed, the same everywhere, down to nothing in every period.
        literal: bool = "literal" Flag(false);
    }
    /// A box of air that flows round solids, with `[wind] model = "lattice"`. Of `[wind]` it takes speed, direction_deg and
    /// scale; of its own gusts and turbulence comes in.
    LatticeKeys at "wind.lattice" {
        /// How it is found.
        solver: Solver = "solver" OneOf(Solver::Lbm);
        /// Whose: keys that are not given take its values.
        preset: LatticePreset = "preset" OneOf(LatticePreset::Own);
        /// Cells along x, y and z.
        cells: [f64; 3] = "cells" Tuple([70.0; 3], num(70.0, 8.0, 4096.0, ""));
        /// Side of a cell.
        dx: f64 = "dx" num(0.5, 0.02, 10.0, "m");
        /// Middle of the bottom of the box, which is ground.
        at: [f64; 3] = "at" point([0.0; 3]);
        /// Kinematic viscosity; the lattice is seldom as thin as air.
        nu: f64 = "nu" num(1.5e-5, 0.0, 0.01, "m^2/s");
        /// Steps a frame.
        steps: Option<u32> = "steps" Maybe(whole(2, 1, 10_000), "as many as the wind needs");
        /// Smagorinsky's constant of eddy viscosity; 0 needs tau_floor = 0.505.
        smagorinsky: f64 = "smagorinsky" num(0.16, 0.0, 0.3, "");
        /// Least relaxation time.
        tau_floor: f64 = "tau_floor" num(0.5005, 0.5001, 1.0, "steps");
        /// What the faces along the wind do.
        sides: LatticeSides = "sides" OneOf(LatticeSides::Auto);
        /// What goes back in from an outlet.
        outlet: LatticeOutlet = "outlet" OneOf(LatticeOutlet::Equilibrium);
        /// Cells before an outlet in which the air thickens.
        sponge: u32 = "sponge" whole(8, 0, 32);
        /// How the wind that comes in grows with the height.
        profile: LatticeProfile = "profile" OneOf(LatticeProfile::Log);
        /// What the ground does to the air.
        ground: LatticeGround = "ground" OneOf(LatticeGround::Rough);
        /// Roughness of the ground: of the profile "log", and of rough ground.
        roughness: f64 = "roughness" num(0.05, 1e-4, 2.0, "m");
        /// With "power": the power.
        exponent: f64 = "exponent" num(0.2, 0.14, 0.4, "");
        /// With "table": heights (m), rising, and factors on the speed.
        profile_table: Vec<[f64; 2]> = "profile_table" Steps(num(0.0, 0.0, 1e4, ""));
        /// Times (s from the clip's first frame), rising, and speeds (m/s) there instead of `wind.speed`, straight between them: a storm that
        /// comes up. Such a wind does not repeat.
        speed_curve: Vec<[f64; 2]> = "speed_curve" Steps(num(0.0, 0.0, 1e4, ""));
        /// Times (s from the clip's first frame), rising, and directions there instead of `wind.direction_deg`, straight between them and
        /// beyond 360 for whole turns: a wind that turns. It does not repeat.
        direction_curve: Vec<[f64; 2]> = "direction_curve" Steps(num(0.0, -1e4, 1e4, ""));
        /// Height at which the wind has its speed.
        reference: Option<f64> = "reference" Maybe(num(10.0, 0.1, 1e4, "m"), "10 m, or the height of the box");
        /// Strength of gusts over the mean.
        gust: f64 = "gust" num(0.2, 0.0, 0.5, "");
        /// Time after which a gust is forgotten.
        gust_period: f64 = "gust_period" num(8.0, 0.1, 600.0, "s");
        /// Strength of each component of turbulence over the mean.
        turbulence: f64 = "turbulence" num(0.1, 0.0, 0.4, "");
        /// Waves that turbulence is made of.
        modes: u32 = "modes" whole(24, 0, 128);
        /// Time before the first frame, in which the wind sets in.
        preroll: Option<f64> = "preroll" Maybe(num(20.0, 0.0, 3600.0, "s"), "one flow through the box");
        /// A bake keeps the air that has set in, in `wind/` of its folder and 60 bytes a cell, and a bake that finds it there goes on from
        /// it: for large boxes.
        keep: bool = "keep" Flag(false);
    }
    /// Files of the wind itself, in `wind/`: planes with velocities as EXR, one for each [[output.wind.slice]], and whole boxes
    /// as VTI. Of any wind; clips only.
    AirKeys at "output.wind" with ["slice"] {
        /// Frames between two boxes.
        vti_every: Option<u32> = "vti_every" Maybe(whole(1, 1, 1_000_000), "no boxes");
        /// Side of a texel of planes and of a cell of boxes.
        texel: Option<f64> = "texel" Maybe(num(0.5, 0.01, 100.0, "m"), "the dx of a lattice, else 0.5 m");
        /// Width, height and depth of the box about the origin that is told, where no lattice and no flight has one.
        size: [f64; 3] = "size" Tuple([35.0; 3], num(35.0, 0.5, 1e4, "m"));
    }
    /// A plane through the wind.
    SliceKeys at "output.wind.slice" {
        /// Axis that it is across.
        across: Across = "across" OneOf(Across::Y);
        /// Where on that axis it lies.
        at: f64 = "at" num(2.0, -1e5, 1e5, "m");
        /// Frames between two files.
        every: u32 = "every" whole(1, 1, 1_000_000);
    }
    /// How plants answer the wind.
    SwayKeys at "sway" {
        /// By which equations.
        model: SwayModel = "model" OneOf(SwayModel::Beam);
        /// With "paper": what is mended; [] for nothing, and then nothing is seen to move.
        fixes: Vec<PaperFix> = "paper_fixes" SomeOf(&[PaperFix::Radius, PaperFix::Air, PaperFix::Damping]);
        /// With "paper": share of the last force that is taken back.
        recoil: f64 = "paper_recoil" num(0.3, 0.0, 0.999, "");
        /// With "paper": damping for the square of the turning rate.
        paper_damping: f64 = "paper_damping" num(0.01, 0.0, 1000.0, "N s^2");
        /// Factor on the swings; 1 is honest, 3 to 10 is usual where a tree shall look alive from afar.
        exaggerate: f64 = "exaggerate" num(1.0, 0.0, 20.0, "");
        /// Factor on the steady lean.
        lean: f64 = "lean" num(1.0, 0.0, 5.0, "");
        /// Factor on how twigs lag behind the branch that throws them.
        whip: f64 = "whip" num(1.0, 0.0, 3.0, "");
        /// Trunks and limbs also swing in their second mode: a tremor in gusts, 6.27 times as fast.
        modes: u32 = "modes" whole(1, 1, 2);
        /// How bends grow along a branch.
        profile: Profile = "profile" OneOf(Profile::Uniform);
        /// A branch that others lean over presses on them with its weight in its new direction.
        gravity: bool = "gravity_change" Flag(false);
        /// The motion repeats after so many seconds, rounded to frames, however long the clip is.
        round: Option<f64> = "loop" Maybe(num(4.0, 2.0, 3600.0, "s"), "the whole clip, if it repeats");
        /// Whether the frame after the last is the first.
        repeat: Option<bool> = "repeat" Maybe(Flag(true), "true for clips of 2 s and more");
        /// Copies of a plant show a repeating motion at so many different times, as gusts reach them; 1 for all as one.
        phases: u32 = "phases" whole(12, 1, 1000);
        /// How a clip that does not repeat begins.
        start: Start = "start" OneOf(Start::Moving);
    }
    /// What a plant is made of, as far as wind can tell.
    WoodKeys at "plants.NAME.wood" {
        /// Kind of wood.
        timber: Option<Timber> = "timber" Maybe(OneOf(Timber::WhiteOak), "8 GPa in thick wood, 5 GPa in twigs");
        /// Young's modulus, instead of `timber`.
        elasticity: Option<f64> = "elasticity_gpa" Maybe(num(8.0, 0.1, 30.0, "GPa"), "the timber's");
        /// Factor on it.
        stiffness: f64 = "stiffness" num(1.0, 0.05, 20.0, "");
        /// Of green wood.
        density: f64 = "density" num(900.0, 100.0, 1500.0, "kg/m^3");
        /// Of leaves, for each m^2 of one side.
        leaf_mass: f64 = "leaf_mass" num(0.2, 0.0, 2.0, "kg/m^2");
        /// Drag coefficient of wood.
        drag: f64 = "drag" num(1.1, 0.0, 3.0, "");
        /// Drag coefficient of leaves.
        leaf_drag: f64 = "leaf_drag" num(0.4, 0.0, 3.0, "");
        /// First frequency of the trunk.
        trunk: Option<f64> = "trunk_hz" Maybe(num(0.5, 0.05, 20.0, "Hz"), "what its shape and load say");
        /// Factor on all frequencies.
        hertz: f64 = "hz_scale" num(1.0, 0.1, 10.0, "");
        /// Factor on all damping.
        damping: f64 = "damping" num(1.0, 0.0, 10.0, "");
    }
}
