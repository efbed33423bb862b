//! Veins of a leaf as running drops feel them: where its map of heights lies lower than around.

use glam::DVec2;

use osier_base::math::narrow;
use osier_scene::{Image, Material, Mesh, Pixels};

/// Cells each way: as wide as a small drop on a leaf of a hand's length.
const CELLS: usize = 128;
/// Cells on either side over which a place is compared.
const AROUND: usize = 5;

/// How deep in a vein places of a leaf lie.
/// Source: own; [yang-wu] lets drops flow along veins and gives no rule.
#[derive(Debug, Clone)]
pub struct VeinMap {
    /// From 0 to 1, rows from the top.
    depth: Vec<f32>,
}

impl VeinMap {
    /// Of the materials that a mesh shows, the first with a map of heights; none if there is none or it is flat.
    pub fn of(mesh: &Mesh, materials: &[Material], images: &[Image]) -> Option<Self> {
        mesh.subsets.iter().find_map(|s| {
            let height = materials.get(s.material as usize)?.maps.height?;
            Self::cut(images.get(height as usize)?)
        })
    }

    fn cut(image: &Image) -> Option<Self> {
        let (w, h) = (image.width as usize, image.height as usize);
        let words: Vec<f64> = match &image.pixels {
            Pixels::U16(words) if image.channels == 1 => words.iter().map(|v| f64::from(*v)).collect(),
            Pixels::U8(bytes) if image.channels == 1 => bytes.iter().map(|v| f64::from(*v)).collect(),
            _ => return None,
        };
        (w > 0 && h > 0 && words.len() == w * h).then(|| Self::from_heights(&words, [w, h]))?
    }

    /// `heights`: rows from the top, any unit.
    fn from_heights(heights: &[f64], [w, h]: [usize; 2]) -> Option<Self> {
        let span = |k: usize, n: usize| k * n / CELLS..((k + 1) * n / CELLS).max(k * n / CELLS + 1);
        let mean = |(x, y): (usize, usize)| {
            let texels = span(y, h).flat_map(|y| span(x, w).map(move |x| heights[y * w + x]));
            let (sum, count) = texels.fold((0.0, 0.0), |s, v| (s.0 + v, s.1 + 1.0));
            sum / count
        };
        let places = || (0..CELLS).flat_map(|y| (0..CELLS).map(move |x| (x, y)));
        let cells: Vec<f64> = places().map(mean).collect();
        let below: Vec<f64> =
            places().map(|at| neighbourhood_mean(&cells, at.0, at.1) - cells[at.1 * CELLS + at.0]).collect();
        let deep = (below.iter().map(|b| b * b).sum::<f64>() / below.len() as f64).sqrt();
        // Twice what is usual is a vein.
        let depth = |b: &f64| narrow((0.5 * b / deep).clamp(0.0, 1.0));
        (deep > 0.0).then(|| Self { depth: below.iter().map(depth).collect() })
    }

    /// How deep in a vein texture coordinates lie, 0 to 1; 0 beyond the texture.
    pub fn at(&self, uv: DVec2) -> f64 {
        let place = DVec2::new(uv.x, 1.0 - uv.y) * CELLS as f64;
        if !(place.cmpge(DVec2::ZERO).all() && place.cmplt(DVec2::splat(CELLS as f64)).all()) {
            return 0.0;
        }
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "just looked at")]
        let (x, y) = (place.x as usize, place.y as usize);
        f64::from(self.depth[y * CELLS + x])
    }
}

/// Mean of the cells around column `x` of row `y`, itself included.
fn neighbourhood_mean(cells: &[f64], x: usize, y: usize) -> f64 {
    let near = |k: usize| k.saturating_sub(AROUND)..(k + AROUND + 1).min(CELLS);
    let all = near(y).flat_map(|y| near(x).map(move |x| cells[y * CELLS + x]));
    let (sum, count) = all.fold((0.0, 0.0), |s, v| (s.0 + v, s.1 + 1.0));
    sum / count
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// One vein, some thirtieths of the texture wide, whose place along u is a function of v.
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
        let grooves = vein(|v| 0.3 + 0.4 * v);
        for k in 1..10 {
            let v = 0.1 * f64::from(k);
            assert!(grooves.at(DVec2::new(0.3 + 0.4 * v, v)) > 0.9, "{v}");
            for off in [-0.2, 0.2] {
                assert!(grooves.at(DVec2::new(0.3 + 0.4 * v + off, v)) < 0.05, "{v}");
            }
        }
        assert!(grooves.at(DVec2::new(1.2, 0.5)) < 1e-9);
        assert!(VeinMap::from_heights(&[3.0; 64], [8, 8]).is_none());
    }
}
