//! A system's density as a square tile of a surface: the culm of [wang-hao] Fig. 7(b).
//!
//! # Examples
//! ```
//! use osier_base::limits::Limits;
//! use osier_ifs::{read::read, tile::tile};
//!
//! let text = b"sierpinski { .5 0 0 .5 0 0 1  .5 0 0 .5 .5 0 1  .5 0 0 .5 0 .5 1 }";
//! let (systems, _) = read("sierpinski.ifs", text, &Limits::default())?;
//! let tile = tile(&systems[0], 16).expect("an attractor");
//! assert!(tile.len() == 256 && tile.iter().all(|v| (0.0..=1.0).contains(v)));
//! # Ok::<(), osier_base::Error>(())
//! ```

use super::Ifs;
use super::cloud::DrawRequest;
use super::dynamics::study;
use super::game::{InstructionSet, extent};
use super::histogram::{PictureWindow, histogram};
use super::weights::WeightRule;
use osier_base::diagnostic::Diagnostic;
use osier_base::math::{ln, narrow};

/// Points drawn per cell of the tile. Fewer show sampling noise, more cost time in proportion.
const POINTS_PER_CELL: u64 = 64;
/// The share of cells below the brightness that counts as full.
const FULL_QUANTILE: f64 = 0.99;

/// The density of a plane system on `n` x `n` cells that cover its longer side without margin, rows from the top, each
/// 0..1: ln(1 + hits) / ln(1 + hits_99) with the 99 % quantile of the cells. The same at any thread count.
/// Own: [wang-hao] prints the table of the culm and does not state how it is applied to the surface.
/// # Errors
/// I023 for a system without attractor.
pub fn tile(ifs: &Ifs, n: usize) -> Result<Vec<f32>, Box<Diagnostic>> {
    let study = study(ifs, ifs.weights.unwrap_or(WeightRule::File));
    let extent = extent(ifs, &study)?;
    let (low, high) = if study.unbounded { extent.quantile } else { extent.bounds };
    let (size, middle) = (high - low, (low + high) * 0.5);
    #[allow(clippy::cast_precision_loss, reason = "some hundred cells")]
    // The longer side of the attractor fills the tile.
    let pixel = (size.x.max(size.y) / n.max(1) as f64).max(1e-12);
    let window = PictureWindow { width: n, height: n, center: [middle.x, middle.y], pixel };
    let points = POINTS_PER_CELL * (n * n) as u64;
    let request = DrawRequest { system: ifs, study: &study, seed: 0, points, tier: InstructionSet::Best };
    let hits = histogram(&request, None, &window).hits;
    // The brightest percent of the cells is clipped, or single dense cells would leave the rest dark.
    let mut sorted = hits.clone();
    sorted.sort_unstable();
    #[allow(clippy::cast_precision_loss, reason = "counts below 2^53")]
    let log = |h: u64| ln(1.0 + h as f64);
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        clippy::cast_precision_loss,
        reason = "a place in the list"
    )]
    let full = sorted.get((FULL_QUANTILE * sorted.len() as f64) as usize).map_or(1.0, |h| log(*h).max(1e-9));
    Ok(hits.iter().map(|h| narrow((log(*h) / full).clamp(0.0, 1.0))).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::system;

    #[test]
    fn the_culm_is_the_product_of_its_weights() {
        let n = 64;
        let field = tile(&system("bamboo_node"), n).expect("a square");
        assert!(field.iter().all(|v| (0.0..=1.0).contains(v)));
        let mean = |x0: usize, y0: usize| {
            let cells = (0..n * n).filter(|i| (i % n) / 32 == x0 && i / n / 32 == y0);
            cells.map(|i| f64::from(field[i])).sum::<f64>() / 1024.0
        };
        // Rows from the top: .35 and .15 above, .15 and .35 below.
        let q = [mean(0, 0), mean(1, 0), mean(0, 1), mean(1, 1)];
        assert!(q[0] > q[1] + 0.05 && q[3] > q[2] + 0.05, "{q:?}");
        assert!((q[0] - q[3]).abs() < 0.01 && (q[1] - q[2]).abs() < 0.01, "{q:?}");
    }
}
