//! Veins of a leaf, along which running drops are led: where its height map is lower than its neighbourhood.

use glam::DVec2;

use crate::rain::tuning::{VEIN_CELLS, VEIN_NEIGHBOURHOOD, VEIN_RMS_SCALE};
use osier_base::math::narrow;
use osier_scene::{Image, Material, Mesh, Pixels};

/// Depth of a leaf's veins on a grid over its texture.
/// Source: own; [yang-wu] lets drops flow along veins and gives no rule.
#[derive(Debug, Clone)]
pub struct VeinMap {
    /// 0 (no vein) to 1, row by row from the top.
    depth: Vec<f32>,
}

impl VeinMap {
    /// The veins of the first material of a mesh that has a height map. `None` if no material has one, or it is flat.
    pub fn of_first_mapped_material(mesh: &Mesh, materials: &[Material], images: &[Image]) -> Option<Self> {
        mesh.subsets.iter().find_map(|s| {
            let height = materials.get(s.material as usize)?.maps.height?;
            Self::from_image(images.get(height as usize)?)
        })
    }

    fn from_image(image: &Image) -> Option<Self> {
        let (w, h) = (image.width as usize, image.height as usize);
        // Height maps have one channel, of 8 or 16 bits.
        let words: Vec<f64> = match &image.pixels {
            Pixels::U16(words) if image.channels == 1 => words.iter().map(|v| f64::from(*v)).collect(),
            Pixels::U8(bytes) if image.channels == 1 => bytes.iter().map(|v| f64::from(*v)).collect(),
            _ => return None,
        };
        (w > 0 && h > 0 && words.len() == w * h).then(|| Self::from_heights(&words, [w, h]))?
    }

    /// Veins of a height map of `w` by `h` texels, row by row from the top, in any unit.
    fn from_heights(heights: &[f64], [w, h]: [usize; 2]) -> Option<Self> {
        // Average the texels of each cell: at least one, also where the map is coarser than the grid.
        let span = |k: usize, n: usize| k * n / VEIN_CELLS..((k + 1) * n / VEIN_CELLS).max(k * n / VEIN_CELLS + 1);
        let mean = |(x, y): (usize, usize)| {
            let texels = span(y, h).flat_map(|y| span(x, w).map(move |x| heights[y * w + x]));
            let (sum, count) = texels.fold((0.0, 0.0), |s, v| (s.0 + v, s.1 + 1.0));
            sum / count
        };
        let coordinates = || (0..VEIN_CELLS).flat_map(|y| (0..VEIN_CELLS).map(move |x| (x, y)));
        let cells: Vec<f64> = coordinates().map(mean).collect();
        // A high-pass filter: how far each cell is below the mean of its neighbourhood, so that the leaf's coarse relief drops out.
        let below: Vec<f64> =
            coordinates().map(|(x, y)| neighbourhood_mean(&cells, x, y) - cells[y * VEIN_CELLS + x]).collect();
        // Normalize by the root mean square, so that the map's unit does not matter.
        let rms = (below.iter().map(|b| b * b).sum::<f64>() / below.len() as f64).sqrt();
        let depth = |b: &f64| narrow((VEIN_RMS_SCALE * b / rms).clamp(0.0, 1.0));
        (rms > 0.0).then(|| Self { depth: below.iter().map(depth).collect() })
    }

    /// Depth of the vein at texture coordinates: 0 (no vein) to 1; 0 beyond the texture.
    pub fn depth(&self, uv: DVec2) -> f64 {
        let cell = DVec2::new(uv.x, 1.0 - uv.y) * VEIN_CELLS as f64;
        if !(cell.cmpge(DVec2::ZERO).all() && cell.cmplt(DVec2::splat(VEIN_CELLS as f64)).all()) {
            return 0.0;
        }
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "within the grid, as just tested")]
        let (x, y) = (cell.x as usize, cell.y as usize);
        f64::from(self.depth[y * VEIN_CELLS + x])
    }
}

/// Mean of the cells within [`VEIN_NEIGHBOURHOOD`] columns and rows of column `x` of row `y`, itself included.
fn neighbourhood_mean(cells: &[f64], x: usize, y: usize) -> f64 {
    let near = |k: usize| k.saturating_sub(VEIN_NEIGHBOURHOOD)..(k + VEIN_NEIGHBOURHOOD + 1).min(VEIN_CELLS);
    let all = near(y).flat_map(|y| near(x).map(move |x| cells[y * VEIN_CELLS + x]));
    let (sum, count) = all.fold((0.0, 0.0), |s, v| (s.0 + v, s.1 + 1.0));
    sum / count
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// A single vein, about a thirtieth of the texture wide, whose u is a function of v.
    pub fn vein(u: impl Fn(f64) -> f64) -> VeinMap {
        let n = 256;
        let height = |k: usize| {
            let (x, y) = ((k % n) as f64 / n as f64, 1.0 - (k / n) as f64 / n as f64);
            1.0 - osier_base::math::exp(-((x - u(y)) / 0.03) * ((x - u(y)) / 0.03))
        };
        let heights: Vec<f64> = (0..n * n).map(height).collect();
        VeinMap::from_heights(&heights, [n, n]).expect("not flat")
    }

    #[test]
    fn a_vein_is_deep_and_the_blade_is_not() {
        let veins = vein(|v| 0.3 + 0.4 * v);
        for k in 1..10 {
            let v = 0.1 * f64::from(k);
            assert!(veins.depth(DVec2::new(0.3 + 0.4 * v, v)) > 0.9, "{v}");
            for off in [-0.2, 0.2] {
                assert!(veins.depth(DVec2::new(0.3 + 0.4 * v + off, v)) < 0.05, "{v}");
            }
        }
        assert!(veins.depth(DVec2::new(1.2, 0.5)) < 1e-9);
        assert!(VeinMap::from_heights(&[3.0; 64], [8, 8]).is_none());
    }
}
