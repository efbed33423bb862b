//! `[plants.NAME.wood]`: mechanical properties of a plant.

use crate::recipe::syntax::{OneOf, OptionalKey, gigapascals, number};
use crate::recipe::syntax::{choices, keys};

choices! {
    /// Timber whose Young's modulus in the green state is tabulated.
    WoodSpecies {
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

keys! {
    /// Mechanical properties of a plant, for sway and rods.
    WoodKeys at "plants.NAME.wood" {
        /// Species, which sets Young's modulus of the green wood.
        timber: Option<WoodSpecies> = "timber" OptionalKey(OneOf(WoodSpecies::WhiteOak), "8 GPa in thick wood, 5 GPa in twigs");
        /// Young's modulus, instead of `timber`.
        elasticity: Option<f64> = "elasticity_gpa" OptionalKey(gigapascals(8.0, 0.1, 30.0), "by timber");
        /// Factor on Young's modulus.
        stiffness: f64 = "stiffness" number(1.0, 0.05, 20.0, ""), basic;
        /// Density of green wood.
        density: f64 = "density" number(900.0, 100.0, 1500.0, "kg/m^3");
        /// Mass of leaves per square metre of one side. Leaves in rain and on rods move as those of 0.01 at least.
        leaf_mass: f64 = "leaf_mass" number(0.2, 0.0, 2.0, "kg/m^2");
        /// Drag coefficient of wood.
        drag: f64 = "drag" number(1.1, 0.0, 3.0, "");
        /// Drag coefficient of leaves.
        leaf_drag: f64 = "leaf_drag" number(0.4, 0.0, 3.0, "");
        /// Natural frequency of the trunk.
        trunk_frequency: Option<f64> = "trunk_hz" OptionalKey(number(0.5, 0.05, 20.0, "Hz"), "from shape and load");
        /// Factor on all natural frequencies.
        frequency_scale: f64 = "hz_scale" number(1.0, 0.1, 10.0, "");
        /// Factor on all damping ratios.
        damping: f64 = "damping" number(1.0, 0.0, 10.0, "");
    }
}

impl WoodSpecies {
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
