//! The relief of a bark: plates between cracks, or ridges that part and join again between furrows.

use super::marks::unit_hash;
use super::{BarkRelief, BarkSpec};
use crate::surface::periodic_noise::{CellularNoise, FractalNoise, NearestFeature};
use osier_base::math::smoothstep;

/// Value of the waves, which are about 1 at the crest of a ridge, below which there is a furrow. With a higher value
/// furrows take up more of the bark.
const FURROW: f32 = 0.28;
/// Sideways amplitude of the ridges, in units of their distance. With a lower value they run straight and do not meet,
/// with a higher one they swirl.
const WANDER: f32 = 1.25;
/// Amplitude of the short bends of a ridge, in units of the distance between ridges.
const BENDS: f32 = 0.42;
/// Share by which the height of a ridge rises and falls along it. At 0 no ridge ends.
const SWELL: f32 = 0.5;
/// Weights of the large and the small scales in the height of a scale.
const SCALE_WEIGHTS: [f32; 2] = [0.7, 0.3];

/// Relief of a bark at a texel.
#[derive(Debug, Clone, Copy)]
pub(super) struct Relief {
    /// 0 in a crack, 1 beyond its shoulder.
    pub ground: f32,
    /// Height of the scale relative to the mean of all scales, -0.5..0.5; 0 on bark without scales.
    pub scale: f32,
}

/// The pattern that divides a bark by cracks.
pub(super) enum ReliefPattern {
    /// Cracks on the borders of cells.
    Plates(PlatePattern),
    /// Furrows between ridges.
    Ridges(RidgePattern),
}

impl ReliefPattern {
    /// `seed`: seed of the first noise; the other noises have seeds up to 48 above it.
    pub fn new(spec: &BarkSpec, seed: u64) -> Self {
        match spec.relief {
            BarkRelief::Plates => Self::Plates(PlatePattern::new(spec, seed)),
            BarkRelief::Ridges => Self::Ridges(RidgePattern::new(spec.plates, seed)),
        }
    }

    /// The reliefs of a row of texels. `xs`: their columns, which ascend, at the height `y`; `places`: where each is displaced to
    /// on the unit square; `gap`: width of the cracks' shoulders.
    pub fn row(&self, xs: &[f32], y: f32, places: &[[f32; 2]], gap: f32) -> Vec<Relief> {
        match self {
            Self::Plates(plates) => plates.at_places(places, gap),
            Self::Ridges(ridges) => {
                let waves = ridges.waves(xs, y);
                let relief = |(at, waves)| Relief { ground: ridges.at(waves, at, gap), scale: 0.0 };
                places.iter().copied().zip(&waves).map(relief).collect()
            }
        }
    }
}

/// Closed plates, which may consist of scales.
pub(super) struct PlatePattern {
    cells: CellularNoise,
    /// Large and small scales.
    scales: Option<[CellularNoise; 2]>,
}

impl PlatePattern {
    fn new(spec: &BarkSpec, seed: u64) -> Self {
        let [nx, ny] = spec.plates;
        // About two and a half large scales per plate in each direction, and twice as many small ones; only whole
        // numbers of scales tile.
        let scales =
            |k: u32| CellularNoise::new(seed.wrapping_add(u64::from(k)), [nx * 5 * k / 2, ny * 5 * k / 2], 0.9);
        Self {
            cells: CellularNoise::new(seed, spec.plates, 0.9),
            scales: (spec.scales > 0.0).then(|| [scales(1), scales(2)]),
        }
    }

    fn at_places(&self, places: &[[f32; 2]], gap: f32) -> Vec<Relief> {
        let scales = self.scales.as_ref().map(|scales| scales.each_ref().map(|noise| noise.at_places(places)));
        let scale = |i: usize| match &scales {
            Some(scales) => {
                let heights = scales.each_ref().map(|nearest| unit_hash(nearest[i].id, 8) - 0.5);
                SCALE_WEIGHTS[0] * heights[0] + SCALE_WEIGHTS[1] * heights[1]
            }
            None => 0.0,
        };
        // f2 - f1 of cellular noise is 0 on the cell borders.
        let ground = |nearest: &NearestFeature| smoothstep(0.02, 0.02 + gap, nearest.f2 - nearest.f1);
        let nearest = self.cells.at_places(places);
        nearest.iter().enumerate().map(|(i, nearest)| Relief { ground: ground(nearest), scale: scale(i) }).collect()
    }
}

/// A family of ridges at a texel.
#[derive(Debug, Clone, Copy)]
pub(super) struct RidgeWave {
    /// Sideways displacement, in units of the distance between ridges.
    shift: f32,
    /// Factor on the height of the ridges.
    strength: f32,
}

/// Two families of wandering ridges, one that climbs to the left and one to the right: where both meet, ridges part and join.
pub(super) struct RidgePattern {
    /// Number of ridges of each family around a tile.
    counts: [f32; 2],
    /// Number of ridges by which a family shifts sideways over the height of a tile.
    climb: f32,
    /// Noises of the sideways displacement and the height of each family.
    wander: [FractalNoise; 2],
    bends: [FractalNoise; 2],
    strength: [FractalNoise; 2],
}

impl RidgePattern {
    /// First argument: number of ridges of the denser family around a tile, and number of ridges by which both families
    /// shift sideways over its height.
    fn new([n, climb]: [u32; 2], seed: u64) -> Self {
        let noise = |k: u64, cells: [u32; 2], octaves: u32| FractalNoise::new(seed.wrapping_add(8 * k), cells, octaves);
        Self {
            // The families have different numbers of ridges, so that they are nowhere in phase.
            counts: [n as f32, (n - n / 4) as f32],
            climb: climb as f32,
            wander: [noise(0, [3, 2], 4), noise(1, [4, 2], 4)],
            bends: [noise(2, [20, 4], 4), noise(3, [20, 4], 4)],
            strength: [noise(4, [9, 3], 3), noise(5, [9, 3], 3)],
        }
    }

    fn waves(&self, xs: &[f32], y: f32) -> Vec<[RidgeWave; 2]> {
        let rows = |noise: &[FractalNoise; 2]| noise.each_ref().map(|n| n.row(xs, y));
        let (wander, bends, strength) = (rows(&self.wander), rows(&self.bends), rows(&self.strength));
        let wave = |i: usize, k: usize| RidgeWave {
            shift: WANDER * wander[k][i] + BENDS * bends[k][i],
            strength: 1.0 + SWELL * strength[k][i],
        };
        (0..xs.len()).map(|i| [wave(i, 0), wave(i, 1)]).collect()
    }

    /// Height at a place: that of the higher ridge, 0 in a furrow.
    fn at(&self, waves: &[RidgeWave; 2], [x, y]: [f32; 2], gap: f32) -> f32 {
        let crest = |k: usize, climb: f32| {
            let phase = self.counts[k] * x + climb * y + waves[k].shift;
            // A triangle wave: 1 at the crest of a ridge, 0 midway between two.
            (1.0 - (2.0 * (phase - phase.floor()) - 1.0).abs()) * waves[k].strength
        };
        smoothstep(FURROW, FURROW + gap, crest(0, self.climb).max(crest(1, -self.climb)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surface::periodic_noise::pixel_centres;

    const SIDE: u32 = 256;

    /// Heights above the cracks, row by row.
    fn rows(spec: &BarkSpec) -> Vec<Vec<f32>> {
        let pattern = ReliefPattern::new(spec, spec.seed);
        let xs = pixel_centres(SIDE);
        let row = |y: &f32| {
            let places: Vec<[f32; 2]> = xs.iter().map(|x| [*x, *y]).collect();
            pattern.row(&xs, *y, &places, spec.gap).iter().map(|relief| relief.ground).collect()
        };
        xs.iter().map(row).collect()
    }

    /// Number of furrows that a row crosses.
    fn furrows(row: &[f32]) -> usize {
        row.windows(2).filter(|pair| pair[0] >= 0.3 && pair[1] < 0.3).count()
    }

    #[test]
    fn ridges_part_and_join_and_no_furrow_goes_round_the_stem() {
        for spec in [BarkSpec::furrowed(), BarkSpec::ridged(), BarkSpec::stringy()] {
            for seed in 0..8 {
                let rows = rows(&BarkSpec { seed: 640 * seed, ..spec.clone() });
                let means: Vec<f32> = rows.iter().map(|row| row.iter().sum::<f32>() / SIDE as f32).collect();
                let mean = means.iter().sum::<f32>() / SIDE as f32;
                // Bark with plates in rows has cracks around the stem, where the mean falls to a third and less.
                let lowest = means.iter().copied().fold(f32::INFINITY, f32::min);
                assert!(lowest > 0.7 * mean, "seed {seed}: {lowest} of {mean}");
                let counts: Vec<usize> = rows.iter().map(|row| furrows(row)).collect();
                let (least, most) = (counts.iter().min().expect("rows"), counts.iter().max().expect("rows"));
                assert!(*least >= 4 && *most >= least + 4, "seed {seed}: {least} to {most} furrows");
                // Furrows are long: what is one is still one 3 % of the tile higher, mostly.
                let pairs = rows.iter().zip(&rows[8..]).flat_map(|(a, b)| a.iter().zip(b));
                let (mut low, mut both) = (0, 0);
                for (a, b) in pairs {
                    low += usize::from(*a < 0.3);
                    both += usize::from(*a < 0.3 && *b < 0.3);
                }
                assert!(both * 2 > low, "seed {seed}: {both} of {low}");
            }
        }
    }

    #[test]
    fn scales_are_steps_within_plates() {
        let spec = BarkSpec::plated();
        let pattern = ReliefPattern::new(&spec, 7);
        let xs: Vec<f32> = (0..4000_u16).map(|i| f32::from(i) / 4000.0).collect();
        let places: Vec<[f32; 2]> = xs.iter().map(|x| [*x, 0.37]).collect();
        let reliefs = pattern.row(&xs, 0.37, &places, spec.gap);
        let steps = reliefs.windows(2).filter(|pair| (pair[0].scale - pair[1].scale).abs() > 1e-6).count();
        // At least as many steps along a line as large scales.
        assert!((17..120).contains(&steps), "{steps}");
        assert!(reliefs.iter().all(|r| r.scale.abs() <= 0.5));
        let even = ReliefPattern::new(&BarkSpec { scales: 0.0, ..spec }, 7);
        assert!(even.row(&[0.3], 0.4, &[[0.3, 0.4]], 0.2)[0].scale.abs() < f32::EPSILON);
    }
}
