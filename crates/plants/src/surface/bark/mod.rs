//! Bark as tiling maps: plates or ridges between cracks, fibres, marks. Colours and proportions of the species are chosen by eye.
//!
//! ```
//! use osier_plants::surface::bark::{BarkSpec, bark};
//!
//! # fn main() -> osier_base::Result<()> {
//! let birch = bark(&BarkSpec { side: 16, ..BarkSpec::birch() }, None, "birch")?;
//! let names: Vec<&str> = birch.images.iter().map(|i| i.name.as_str()).collect();
//! assert_eq!(names, ["birch_color", "birch_normal", "birch_rough", "birch_height"]);
//! # Ok(())
//! # }
//! ```

mod marks;
mod paint;
mod relief;

pub use marks::BarkMarks;
pub use paint::bark;

use osier_base::{Error, Result};

/// Form of the raised parts between the cracks of a bark.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BarkRelief {
    /// Closed plates, one for each cell of a cellular noise.
    Plates,
    /// Ridges that part and join again between furrows along the stem.
    Ridges,
}

/// Parameters of a bark. Colours are linear.
#[derive(Debug, Clone, PartialEq)]
pub struct BarkSpec {
    /// Form of the raised parts between cracks.
    pub relief: BarkRelief,
    /// Number of plates around and along a tile, 1..=64; for ridged bark the number of ridges around a tile, and the
    /// number of ridges by which they shift sideways over its height.
    pub plates: [u32; 2],
    /// Weight of the scales that plates consist of, in height and tint, 0..1; 0: plates are even. Ridges have none.
    pub scales: f32,
    /// Largest displacement of plates, fibres and marks across and up, shares of the tile, 0..0.5.
    pub warp: [f32; 2],
    /// Weights in the height: plates, fibres, coarse noise; 0..1.
    pub weights: [f32; 3],
    /// Width of the cracks' shoulders, shares of a plate or of the height of a ridge, 0.01..1.
    pub gap: f32,
    /// Colour in the cracks.
    pub crack: [f32; 3],
    /// Colour on the ridges.
    pub ridge: [f32; 3],
    /// Colour of large patches (lichen, weathering) and how much of it, 0..1.
    pub patch: ([f32; 3], f32),
    /// Marks drawn over the plates: cracks, dashes, scars, diamonds, pores or none.
    pub marks: BarkMarks,
    /// Colour of the marks.
    pub mark: [f32; 3],
    /// Height from the deepest crack to the highest ridge, m, 0..0.1.
    pub depth: f32,
    /// Size of one repeat, m, 0.001..100.
    pub tile: f32,
    /// Roughness in the cracks and on the ridges, 0..1.
    pub roughness: [f32; 2],
    /// Pixels along a side of the maps, a power of two, 16..=4096.
    pub side: u32,
    /// Seed of all noises: another one gives other plates and marks of the same kind.
    pub seed: u64,
}

/// A pattern that is laid over a bark, in relief and tint.
#[derive(Debug, Clone, PartialEq)]
pub struct BarkGrain {
    /// Cells along each side of the square pattern, at least 1.
    pub side: usize,
    /// Values 0..1, rows from the top, `side` x `side`.
    pub values: Vec<f32>,
}

impl BarkGrain {
    /// The value at (x, y) of the unit square, y up; repeats beyond it, linear between the centres of cells.
    pub fn at(&self, x: f32, y: f32) -> f32 {
        let n = self.side.max(1);
        let cell = |v: f32| {
            let v = (v - v.floor()) * n as f32 - 0.5 + n as f32;
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0.5..2n")]
            let low = v as usize;
            (low % n, (low + 1) % n, v - v.floor())
        };
        let ((x0, x1, fx), (y0, y1, fy)) = (cell(x), cell(1.0 - y));
        let value = |x: usize, y: usize| self.values.get(y * n + x).copied().unwrap_or(0.5);
        let row = |y: usize| osier_base::math::lerp(value(x0, y), value(x1, y), fx);
        osier_base::math::lerp(row(y0), row(y1), fy)
    }
}

impl BarkSpec {
    /// Ash, linden, maple, willow: a net of long ridges that part and join again.
    pub fn furrowed() -> Self {
        Self {
            relief: BarkRelief::Ridges,
            plates: [17, 2],
            warp: [0.02, 0.03],
            weights: [0.72, 0.14, 0.14],
            gap: 0.60,
            crack: [0.040, 0.031, 0.023],
            depth: 0.016,
            tile: 1.0,
            ridge: [0.235, 0.202, 0.160],
            ..Self::plates()
        }
    }

    /// Oak: broader grey-brown ridges, broken by cracks across, between deep furrows.
    pub fn ridged() -> Self {
        Self {
            plates: [16, 2],
            weights: [0.76, 0.12, 0.12],
            gap: 0.66,
            crack: [0.026, 0.021, 0.017],
            ridge: [0.225, 0.198, 0.166],
            patch: ([0.165, 0.175, 0.120], 0.25),
            mark: [0.045, 0.037, 0.029],
            depth: 0.022,
            seed: 18,
            ..Self::furrowed()
        }
    }

    /// Common values of all kinds with closed plates.
    fn plates() -> Self {
        Self {
            relief: BarkRelief::Plates,
            plates: [12, 2],
            scales: 0.0,
            warp: [0.035, 0.07],
            weights: [0.75, 0.15, 0.10],
            gap: 0.24,
            crack: [0.030, 0.022, 0.015],
            ridge: [0.205, 0.165, 0.122],
            patch: ([0.150, 0.165, 0.095], 0.30),
            marks: BarkMarks::Cracks,
            mark: [0.045, 0.034, 0.024],
            depth: 0.012,
            tile: 0.5,
            roughness: [0.95, 0.80],
            side: 1024,
            seed: 11,
        }
    }

    /// Pine: broad red-brown plates of many scales.
    pub fn plated() -> Self {
        Self {
            plates: [8, 3],
            scales: 0.6,
            warp: [0.065, 0.06],
            weights: [0.70, 0.10, 0.20],
            gap: 0.34,
            crack: [0.078, 0.046, 0.030],
            ridge: [0.270, 0.165, 0.110],
            patch: ([0.175, 0.160, 0.135], 0.35),
            marks: BarkMarks::None,
            depth: 0.016,
            tile: 0.7,
            seed: 12,
            ..Self::plates()
        }
    }

    /// Beech: hardly a crack.
    pub fn smooth() -> Self {
        Self {
            plates: [4, 4],
            weights: [0.05, 0.25, 0.70],
            gap: 0.5,
            crack: [0.120, 0.115, 0.100],
            ridge: [0.235, 0.230, 0.205],
            marks: BarkMarks::None,
            depth: 0.001,
            seed: 13,
            ..Self::plates()
        }
    }

    /// Silver birch: white, with fine lenticels round the girth and black, diamond-shaped scars.
    pub fn scarred() -> Self {
        Self {
            warp: [0.012, 0.004],
            weights: [0.0, 0.25, 0.75],
            crack: [0.470, 0.445, 0.410],
            ridge: [0.740, 0.725, 0.690],
            patch: ([0.590, 0.490, 0.410], 0.30),
            marks: BarkMarks::Scars,
            mark: [0.030, 0.027, 0.025],
            depth: 0.003,
            tile: 1.6,
            seed: 19,
            ..Self::birch()
        }
    }

    /// Cherry, hazel: pale, with dark dashes round the girth and a few black scars.
    pub fn birch() -> Self {
        Self {
            plates: [3, 24],
            weights: [0.10, 0.30, 0.60],
            gap: 0.15,
            crack: [0.520, 0.490, 0.440],
            ridge: [0.720, 0.700, 0.655],
            patch: ([0.560, 0.450, 0.350], 0.35),
            marks: BarkMarks::Dashes,
            mark: [0.040, 0.034, 0.030],
            depth: 0.0015,
            roughness: [0.80, 0.55],
            seed: 14,
            ..Self::plates()
        }
    }

    /// Bark in long narrow strips, as junipers and vines have.
    pub fn stringy() -> Self {
        Self {
            plates: [34, 1],
            weights: [0.55, 0.35, 0.10],
            gap: 0.60,
            depth: 0.006,
            tile: 0.5,
            marks: BarkMarks::None,
            ..Self::furrowed()
        }
    }

    /// Poplar, aspen: pale grey-green, smooth, with rows of dark diamonds and shallow furrows.
    pub fn poplar() -> Self {
        Self {
            plates: [6, 2],
            weights: [0.22, 0.28, 0.50],
            gap: 0.22,
            crack: [0.165, 0.160, 0.115],
            ridge: [0.365, 0.370, 0.290],
            patch: ([0.270, 0.310, 0.190], 0.55),
            marks: BarkMarks::Diamonds,
            mark: [0.052, 0.046, 0.036],
            depth: 0.003,
            roughness: [0.85, 0.62],
            seed: 15,
            ..Self::plates()
        }
    }

    /// Young twigs: thin greenish-brown skin with pale pores.
    pub fn shoot() -> Self {
        Self {
            plates: [4, 2],
            weights: [0.0, 0.5, 0.5],
            gap: 0.5,
            crack: [0.078, 0.066, 0.034],
            ridge: [0.150, 0.140, 0.066],
            patch: ([0.105, 0.125, 0.046], 0.6),
            marks: BarkMarks::Pores,
            mark: [0.310, 0.270, 0.190],
            depth: 0.0006,
            roughness: [0.75, 0.60],
            seed: 16,
            ..Self::plates()
        }
    }

    /// Bamboo: green, waxy, with fine fibres along the culm.
    pub fn culm() -> Self {
        Self {
            plates: [2, 1],
            weights: [0.0, 0.35, 0.65],
            gap: 0.5,
            crack: [0.085, 0.130, 0.030],
            ridge: [0.215, 0.275, 0.075],
            patch: ([0.330, 0.320, 0.130], 0.45),
            marks: BarkMarks::None,
            depth: 0.0003,
            tile: 0.18,
            roughness: [0.46, 0.34],
            seed: 17,
            ..Self::plates()
        }
    }

    /// Checks the ranges stated at the fields, except those of colours and roughness.
    /// # Errors
    /// `Range` naming the first value outside its range.
    pub fn check(&self) -> Result<()> {
        let bad = |name: &str, value: f32, min: f32, max: f32, unit| {
            let name = format!("bark: {name}");
            Err(Error::Range { name, value: value.into(), min: min.into(), max: max.into(), unit })
        };
        if !(16..=4096).contains(&self.side) || !self.side.is_power_of_two() {
            return bad("side of the maps", self.side as f32, 16.0, 4096.0, "pixels, a power of two");
        }
        let [nx, ny] = self.plates.map(|n| n as f32);
        let rows = [
            ("plates around", nx, 1.0, 64.0, ""),
            ("plates up", ny, 1.0, 64.0, ""),
            ("weight of the plates", self.weights[0], 0.0, 1.0, ""),
            ("weight of the fibres", self.weights[1], 0.0, 1.0, ""),
            ("weight of the noise", self.weights[2], 0.0, 1.0, ""),
            ("scales", self.scales, 0.0, 1.0, ""),
            ("gap", self.gap, 0.01, 1.0, ""),
            ("share of patches", self.patch.1, 0.0, 1.0, ""),
            ("warp across", self.warp[0], 0.0, 0.5, "of the tile"),
            ("warp up", self.warp[1], 0.0, 0.5, "of the tile"),
            ("depth", self.depth, 0.0, 0.1, "m"),
            ("tile", self.tile, 0.001, 100.0, "m"),
        ];
        match rows.iter().find(|(_, value, min, max, _)| !(*min..=*max).contains(value)) {
            Some(&(name, value, min, max, unit)) => bad(name, value, min, max, unit),
            None => Ok(()),
        }
    }
}
