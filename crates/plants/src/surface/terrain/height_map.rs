//! Terrain from a height map: samples on a grid, resampled to the resolution of the mesh.

use super::Terrain;
use osier_base::math::lerp;
use osier_base::{Error, Result};

/// Size and position of a terrain from a height map, and how its samples are thinned and smoothed.
#[derive(Debug, Clone, PartialEq)]
pub struct HeightMapParams {
    /// Number of samples along x and along z, each at least 2; the outermost lie on the border of the land.
    pub counts: [usize; 2],
    /// Length along x, m, > 0; that along z follows, as cells are square.
    pub width: f32,
    /// Centre of the terrain in the world, x and z, m.
    pub center: [f32; 2],
    /// Distance between the heights that are kept, in samples of the map, at least 1: 2 keeps half as many along each
    /// side.
    pub stride: u32,
    /// Passes of binomial smoothing (1 2 1) over the heights that are kept.
    pub smooth: u32,
    /// Lowest height, m, to which lower ones are raised after smoothing; `None`: no limit.
    pub floor: Option<f32>,
}

impl Terrain {
    /// Terrain from a height map. `heights`: m, rows from -z to +z, in each from -x to +x.
    /// With a `stride` the n samples along x become round((n - 1) / stride) + 1 heights at equal distances, linear between samples.
    /// Cells stay square: as many rows at this distance as fit into the map, in its middle, so that the land ends less than a cell
    /// short of it along z where the stride does not divide both sides.
    /// # Errors
    /// `Range` for fewer than two samples along a side, another number of heights than the counts give, or no positive width.
    pub fn from_height_map(heights: &[f32], params: &HeightMapParams) -> Result<Self> {
        let [columns, rows] = params.counts;
        let fits = columns >= 2 && rows >= 2 && columns.checked_mul(rows) == Some(heights.len());
        if !fits || params.width <= 0.0 {
            let (name, value) = ("terrain: number of heights".to_owned(), heights.len() as f64);
            return Err(Error::Range { name, value, min: 4.0, max: 1e9, unit: "samples" });
        }
        let stride = params.stride.max(1) as usize;
        // Cells along x and along z, at least one. Their sides are (columns - 1) / across samples.
        let across = ((columns - 1 + stride / 2) / stride).max((columns - 1).div_ceil(rows - 1));
        let along = (rows - 1) * across / (columns - 1);
        let kept = [across + 1, along + 1];
        // The part of the map along z that is left over, in samples times `across`; half of it lies before the first
        // row.
        let rest = (rows - 1) * across - along * (columns - 1);
        // Ratio of depth to width: that of the map if nothing is left over.
        let [z, x] = if rest == 0 { [rows - 1, columns - 1] } else { [along, across] };
        let depth = params.width * (z as f32 / x as f32);
        // Fewer heights at equal distances: rows first, then the columns of each.
        let heights = if stride == 1 {
            heights.to_vec()
        } else {
            let row = |j: usize| &heights[j * columns..(j + 1) * columns];
            let mut out = Vec::with_capacity(kept[0] * kept[1]);
            for j in 0..kept[1] {
                let (j, g) = place_between(rest + 2 * j * (columns - 1), 2 * across, rows);
                let (low, high) = (row(j), row(j + 1));
                out.extend((0..kept[0]).map(|i| {
                    let (i, f) = place_between(i * (columns - 1), across, columns);
                    lerp(lerp(low[i], low[i + 1], f), lerp(high[i], high[i + 1], f), g)
                }));
            }
            out
        };
        let mut land = Self {
            counts: kept,
            size: [params.width, depth],
            center: params.center,
            stride: 1,
            tileable: false,
            heights,
            surface: None,
        };
        (0..params.smooth).for_each(|_| land.smooth_binomial());
        if let Some(floor) = params.floor {
            land.heights.iter_mut().for_each(|h| *h = h.max(floor));
        }
        Ok(land)
    }
}

/// Index of the sample before the position `part / whole` among `count` samples, and the position between it and the
/// next one, 0 to 1.
fn place_between(part: usize, whole: usize, count: usize) -> (usize, f32) {
    // In whole numbers, so that the last entry falls exactly on the last sample.
    let (before, rest) = (part / whole, part % whole);
    if before + 1 < count { (before, rest as f32 / whole as f32) } else { (count - 2, 1.0) }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A hill of a raised cosine, 10 m high, 40 m across, on a map of `columns` x `rows` samples over 60 m.
    fn hill(columns: usize, rows: usize) -> Vec<f32> {
        let step = 60.0 / (columns - 1) as f32;
        let height = |x: f32, z: f32| {
            let away = x.hypot(z).min(20.0);
            5.0 + 5.0 * osier_base::math::cos_f32(away / 20.0 * std::f32::consts::PI)
        };
        let at = |i: usize, n: usize| (i as f32 - (n - 1) as f32 / 2.0) * step;
        (0..rows).flat_map(|j| (0..columns).map(move |i| height(at(i, columns), at(j, rows)))).collect()
    }

    fn params(counts: [usize; 2]) -> HeightMapParams {
        HeightMapParams { counts, width: 60.0, center: [7.0, -3.0], stride: 1, smooth: 0, floor: None }
    }

    #[test]
    fn the_map_lies_where_it_should() {
        let land = Terrain::from_height_map(&hill(121, 81), &params([121, 81])).expect("land");
        assert_eq!((land.size, land.cell()), ([60.0, 40.0], 0.5));
        assert!((land.height_at(7.0, -3.0) - 10.0).abs() < 1e-5);
        assert!((land.height_at(17.0, -3.0) - 5.0).abs() < 1e-4 && land.height_at(-20.0, -20.0) < 1e-4);
        assert!(land.normal_at(17.0, -3.0).x > 0.5 && land.covers(-22.9, -22.9) && !land.covers(-23.1, 0.0));
        let flat = Terrain::from_height_map(&hill(121, 81), &HeightMapParams { floor: Some(2.0), ..params([121, 81]) });
        assert!((flat.expect("land").height_at(-20.0, -20.0) - 2.0).abs() < 1e-6);
        assert!(Terrain::from_height_map(&[0.0; 7], &params([4, 2])).is_err());
        // A strip of two rows keeps its depth, whatever the stride.
        let strip = Terrain::from_height_map(&hill(121, 2), &HeightMapParams { stride: 64, ..params([121, 2]) });
        let strip = strip.expect("land");
        assert_eq!(strip.counts, [121, 2]);
        assert!((strip.size[1] - 0.5).abs() < 1e-6, "{:?}", strip.size);
    }

    #[test]
    fn half_the_resolution_agrees() {
        // Halving the map moves no height by more than c^2 / 8 of the greatest curvature in the cell, c its diagonal: here 0.18
        // m at 2 m between heights. The last column stays at the border, whatever the count.
        for counts in [[61, 41], [62, 40]] {
            let full = Terrain::from_height_map(&hill(counts[0], counts[1]), &params(counts)).expect("land");
            let half = HeightMapParams { stride: 2, ..params(counts) };
            let half = Terrain::from_height_map(&hill(counts[0], counts[1]), &half).expect("land");
            assert!(half.counts[0] < 33 && half.size[0].to_bits() == full.size[0].to_bits());
            assert!((half.size[1] / (half.counts[1] - 1) as f32 - half.cell()).abs() < 1e-5, "{:?}", half.size);
            let mut worst = 0.0_f32;
            for k in 0..400_u16 {
                let (x, z) = (f32::from(k % 20) * 3.0 - 22.0, f32::from(k / 20) * 1.9 - 22.0);
                worst = worst.max((full.height_at(x, z) - half.height_at(x, z)).abs());
            }
            assert!((0.005..0.18).contains(&worst), "{worst} m");
        }
    }
}
