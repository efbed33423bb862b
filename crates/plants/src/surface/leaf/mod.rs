//! Leaf blades from a few botanical numbers: outline, veins, mesh and maps all come from one [`BladeSpec`].
//!
//! ```
//! use osier_plants::surface::leaf::{BladeDetail, BladeSpec, blade};
//!
//! # fn main() -> osier_base::Result<()> {
//! let oak = blade(&BladeSpec::oak(), 0, BladeDetail::Light)?;
//! // The petiole begins at the origin, the blade extends along +Y.
//! assert!(oak.bounds().max.y > 0.1);
//! # Ok(())
//! # }
//! ```

mod blade;
mod compound;
mod edge_flips;
mod maps;
mod needles;
mod outline;

pub use blade::{BladeDetail, blade};
pub use compound::{CompoundSpec, compound_leaf};
pub use maps::{LeafColors, leaf_color_maps, leaf_material};
pub use needles::{NeedleSpec, needle_shoot};
pub use outline::steepest_teeth;

use osier_base::{Error, Result};

/// Shape of the margin without its teeth, with examples of species.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum LeafForm {
    /// Widest beyond the middle, with rounded lobes: oaks.
    Lobed {
        /// Lobes on each side besides the one at the tip, 1..=8.
        lobes: u32,
        /// How far the bays reach towards the midrib, share of the half width, 0..0.9.
        depth: f32,
    },
    /// Pointed lobes from the base like fingers: maples.
    Palmate {
        /// Lobes on each side besides the one at the tip, 1..=4.
        lobes: u32,
        /// How far the bays reach towards the base, share of the length of the lobes beside them, 0..0.9.
        depth: f32,
    },
    /// Narrow at the base, widest near the rounded tip: petals.
    Petal {
        /// Depth of the notch in the tip, share of the half width, 0..0.9.
        notch: f32,
    },
    /// Widest below the middle with straight sides to a fine tip: birches.
    Rhombic,
    /// A broad flat base, rounded corners and a long tip: poplars.
    Deltoid,
    /// Widest in the middle: beeches, willows.
    Elliptic,
}

/// Teeth along the margin, pointing to the tip.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Teeth {
    /// Teeth on each side, 0..=60.
    pub count: u32,
    /// Height, share of the width, 0..0.3.
    pub depth: f32,
    /// Smaller teeth after each large one, 0..=4.
    pub minor: u32,
}

/// Parameters of a leaf blade. Lengths in m, angles in rad.
#[derive(Debug, Clone, PartialEq)]
pub struct BladeSpec {
    /// Shape of the margin without its teeth.
    pub form: LeafForm,
    /// Teeth of the margin; a count of 0 leaves it entire.
    pub teeth: Teeth,
    /// Length of the blade without the petiole, 1e-7..2 m: leaflets are a part of a leaf of a millimetre or more.
    pub length: f32,
    /// Greatest width, 1e-7..6 m.
    pub width: f32,
    /// Side veins on each side of the midrib, 1..=16; lobed blades have one for each lobe instead.
    pub veins: u32,
    /// Angle between midrib and side veins, 0.3..1.4 rad.
    pub vein_angle: f32,
    /// Angle by which each half is folded up at the midrib, -1.2..1.2 rad.
    pub fold: f32,
    /// Angle by which the tip is bent down relative to the base, -3..3 rad.
    pub curl: f32,
    /// Height of the waves of the margin, share of the width, 0..0.3.
    pub waviness: f32,
    /// Length of the petiole, 0..1 m.
    pub petiole_length: f32,
    /// Radius of the petiole, 0.0001..0.01 m.
    pub petiole_radius: f32,
    /// Thickness of the petiole divided by its width: 1 round, 2 flattened like a poplar's, 0.3..3.
    pub petiole_flatness: f32,
    /// Seed of the irregularities that all variants and the maps share.
    pub seed: u64,
}

impl BladeSpec {
    /// Pedunculate oak: five rounded lobes a side, hardly a petiole, 11 cm.
    pub fn oak() -> Self {
        Self {
            form: LeafForm::Lobed { lobes: 5, depth: 0.42 },
            teeth: Teeth { count: 0, depth: 0.0, minor: 0 },
            length: 0.11,
            width: 0.066,
            veins: 5,
            vein_angle: 0.9,
            fold: 0.16,
            curl: 0.5,
            waviness: 0.05,
            petiole_length: 0.007,
            petiole_radius: 0.000_8,
            petiole_flatness: 1.0,
            seed: 1,
        }
    }

    /// Silver birch: rhombic, doubly toothed, 5 cm, petiole 1.5 cm.
    pub fn birch() -> Self {
        Self {
            form: LeafForm::Rhombic,
            teeth: Teeth { count: 7, depth: 0.055, minor: 2 },
            length: 0.05,
            width: 0.038,
            veins: 7,
            vein_angle: 0.8,
            fold: 0.22,
            curl: 0.6,
            waviness: 0.025,
            petiole_length: 0.015,
            petiole_radius: 0.000_5,
            petiole_flatness: 1.0,
            seed: 2,
        }
    }

    /// Black poplar: deltoid with a drip tip and fine teeth, 7 cm, on a long flattened petiole.
    pub fn poplar() -> Self {
        Self {
            form: LeafForm::Deltoid,
            teeth: Teeth { count: 16, depth: 0.016, minor: 0 },
            length: 0.07,
            width: 0.066,
            veins: 6,
            vein_angle: 0.85,
            fold: 0.1,
            curl: 0.35,
            waviness: 0.03,
            petiole_length: 0.05,
            petiole_radius: 0.000_8,
            petiole_flatness: 1.8,
            seed: 3,
        }
    }

    /// Norway maple: five pointed lobes, 11 cm, on a long petiole.
    pub fn maple() -> Self {
        Self {
            form: LeafForm::Palmate { lobes: 2, depth: 0.42 },
            teeth: Teeth { count: 0, depth: 0.0, minor: 0 },
            length: 0.11,
            width: 0.13,
            veins: 2,
            vein_angle: 0.8,
            fold: 0.1,
            curl: 0.45,
            waviness: 0.03,
            petiole_length: 0.09,
            petiole_radius: 0.000_9,
            petiole_flatness: 1.0,
            seed: 4,
        }
    }

    /// Elliptic with an entire margin, as beeches have: 8 cm, petiole as a birch's.
    pub fn elliptic() -> Self {
        Self {
            form: LeafForm::Elliptic,
            teeth: Teeth { count: 0, depth: 0.0, minor: 0 },
            length: 0.08,
            width: 0.045,
            ..Self::birch()
        }
    }

    /// A petal without a stalk, 2 cm, slightly hollow.
    pub fn petal() -> Self {
        Self {
            form: LeafForm::Petal { notch: 0.0 },
            teeth: Teeth { count: 0, depth: 0.0, minor: 0 },
            length: 0.02,
            width: 0.012,
            veins: 4,
            vein_angle: 0.35,
            fold: 0.12,
            curl: 0.3,
            waviness: 0.03,
            petiole_length: 0.0,
            petiole_radius: 0.000_2,
            petiole_flatness: 1.0,
            seed: 5,
        }
    }

    /// Checks the ranges stated at the fields, including those of form and teeth.
    /// # Errors
    /// `Range` naming the first value outside its range.
    pub fn check(&self) -> Result<()> {
        let (lobes, most, depth) = match self.form {
            LeafForm::Lobed { lobes, depth } => (lobes, 8.0, depth),
            LeafForm::Palmate { lobes, depth } => (lobes, 4.0, depth),
            LeafForm::Petal { notch } => (1, 8.0, notch),
            _ => (1, 8.0, 0.0),
        };
        let rows = [
            ("lobes", lobes as f32, 1.0, most),
            ("depth of the lobes", depth, 0.0, 0.9),
            ("teeth", self.teeth.count as f32, 0.0, 60.0),
            ("depth of the teeth", self.teeth.depth, 0.0, 0.3),
            ("minor teeth", self.teeth.minor as f32, 0.0, 4.0),
            ("length", self.length, 1e-7, 2.0),
            ("width", self.width, 1e-7, 6.0),
            ("veins", self.veins as f32, 1.0, 16.0),
            ("vein angle", self.vein_angle, 0.3, 1.4),
            ("fold", self.fold, -1.2, 1.2),
            ("curl", self.curl, -3.0, 3.0),
            ("waviness", self.waviness, 0.0, 0.3),
            ("petiole length", self.petiole_length, 0.0, 1.0),
            ("petiole radius", self.petiole_radius, 0.000_1, 0.01),
            ("petiole flatness", self.petiole_flatness, 0.3, 3.0),
        ];
        for (name, value, min, max) in rows {
            if !(min..=max).contains(&value) {
                let name = format!("leaf: {name}");
                return Err(Error::Range { name, value: value.into(), min: min.into(), max: max.into(), unit: "" });
            }
        }
        Ok(())
    }
}
