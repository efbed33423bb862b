//! Probabilities of the maps of a system, from its file, by area or by similarity dimension.
//!
//! # Examples
//! ```
//! use osier_ifs::weights::similarity_dimension;
//!
//! // Sierpinski's triangle: three maps of scale 1/2 in the plane, D = ln 3 / ln 2.
//! assert!((similarity_dimension(&[0.5; 3], 2.0) - 1.585).abs() < 1e-3);
//! ```

use super::Ifs;
use osier_base::diagnostic::{Diagnostic, Severity};
use osier_base::math;

/// How the probabilities of the maps follow from the file's weights or from the maps.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum WeightRule {
    /// The file's column divided by its sum; a column of running sums is turned into differences first. A file without
    /// a column follows [`WeightRule::Det`] or, in space, [`WeightRule::Moran`].
    File,
    /// The file's column as it is, divided by its sum.
    Raw,
    /// Proportional to |det A|: the area or volume of each map's image.
    Det,
    /// s^D: s is the mean contraction of a map, D the similarity dimension, for which these powers add up to 1.
    Moran,
    /// The same for every map, whatever the weights of the file.
    Equal,
    /// As Fractint draws: a running sum of the weights; the last map takes the rest.
    Fractint,
}

/// Smallest weight, as a share of the largest one, that a map gets by [`WeightRule::Det`] and [`WeightRule::Moran`].
const MIN_WEIGHT_SHARE: f64 = 0.01;
/// Deviation of a sum of weights from 1 that is taken as rounding.
const SUM_TOLERANCE: f64 = 0.005;
/// Norm from which weights by area give one map nearly all points (I027).
const MAX_AREA_NORM: f64 = 0.99;

/// Probabilities, one per map, sum 1, with warnings about them (I012 to I017, I024, I027).
/// Source: [wang-hao] eq. (3) for weights by area, here with a floor.
/// Differs: eq. (3) divides by the sum of |det| and starves singular maps.
pub fn probabilities(ifs: &Ifs, rule: WeightRule) -> (Vec<f64>, Vec<Diagnostic>) {
    let mut warnings = Vec::new();
    let column: Option<Vec<f64>> = ifs.maps.iter().map(|m| m.weight).collect();
    let positive = |w: &[f64]| w.iter().any(|p| *p > 0.0);
    // Without usable weights in the file: by area in the plane, by similarity dimension in space, where areas of thin
    // maps are 0.
    let fallback = if ifs.dim == 2 { WeightRule::Det } else { WeightRule::Moran };
    let rule = match (rule, &column) {
        (WeightRule::File | WeightRule::Raw | WeightRule::Fractint, None) => fallback,
        (WeightRule::File, Some(w)) if !positive(w) => fallback,
        (rule, _) => rule,
    };
    let column = column.unwrap_or_default();
    let weights = match rule {
        WeightRule::File => differences(&column).unwrap_or_else(|| column.iter().map(|p| p.max(0.0)).collect()),
        WeightRule::Raw => {
            if !positive(&column) {
                let d = Diagnostic::error("I017", "every weight is 0", ifs.span, "in this system");
                warnings.push(d.help("give a map a weight, or choose weights = \"det\""));
            }
            column.iter().map(|p| p.max(0.0)).collect()
        }
        WeightRule::Det => area_weights(ifs, &mut warnings),
        WeightRule::Moran => moran_weights(ifs),
        WeightRule::Equal => vec![1.0; ifs.maps.len()],
        WeightRule::Fractint => fractint_shares(&column),
    };
    (normalized(weights), warnings)
}

fn normalized(mut weights: Vec<f64>) -> Vec<f64> {
    let sum = weights.iter().fold(0.0, |s, w| s + w);
    let n = weights.len();
    for w in &mut weights {
        #[allow(clippy::cast_precision_loss, reason = "at most some thousand maps")]
        let even = 1.0 / n as f64;
        *w = if sum > 0.0 { *w / sum } else { even };
    }
    weights
}

/// Differences of a column that is a running sum; `None` for other columns.
fn differences(column: &[f64]) -> Option<Vec<f64>> {
    let sum = column.iter().fold(0.0, |s, w| s + w);
    // A running sum rises from 0 or more to 1; shares of 1 would not sum to more than 1.
    let rises =
        column.len() >= 2 && column.windows(2).all(|w| w[1] > w[0]) && column.first().is_some_and(|p| *p >= 0.0);
    let ends = column.last().is_some_and(|p| (p - 1.0).abs() <= SUM_TOLERANCE);
    (rises && ends && sum > 1.0 + SUM_TOLERANCE).then(|| {
        let mut before = 0.0;
        // Undo the running sum: p_i = P_i - P_(i-1).
        column.iter().map(|p| p - std::mem::replace(&mut before, *p)).collect()
    })
}

fn area_weights(ifs: &Ifs, warnings: &mut Vec<Diagnostic>) -> Vec<f64> {
    let areas: Vec<f64> = ifs.maps.iter().map(|m| m.affine.det(ifs.dim).abs()).collect();
    let largest = areas.iter().fold(0.0_f64, |m, a| m.max(*a));
    // A map that hardly contracts keeps almost all of its area, so weights by area would give it nearly all points.
    if let Some(turn) = ifs.maps.iter().find(|m| m.affine.norm() > MAX_AREA_NORM) {
        let text = "weights by area are unsuitable for a map that hardly contracts";
        let d = Diagnostic::warning("I027", text, turn.span, format!("norm {:.6}", turn.affine.norm()));
        warnings.push(d.help("the weights of the file are used; by area the other maps would get almost no points"));
        let column: Option<Vec<f64>> = ifs.maps.iter().map(|m| m.weight.map(|w| w.max(0.0))).collect();
        if let Some(column) = column.filter(|c| c.iter().any(|w| *w > 0.0)) {
            return column;
        }
    }
    // Maps onto lines have no area: use the square of the norm instead.
    if largest <= 0.0 {
        let d = Diagnostic::warning("I024", "no map has an area", ifs.span, "every determinant is 0");
        warnings.push(d.help("weights by the square of the norm are used"));
        return ifs.maps.iter().map(|m| m.affine.norm() * m.affine.norm()).collect();
    }
    areas.iter().map(|a| a.max(MIN_WEIGHT_SHARE * largest)).collect()
}

/// q_i ~ s_i^D with sum s_i^D = 1, s_i = |det A_i|^(1/d), D clamped to 0.1..d.
fn moran_weights(ifs: &Ifs) -> Vec<f64> {
    #[allow(clippy::cast_precision_loss, reason = "2 or 3")]
    let d = ifs.dim as f64;
    // The mean contraction of a map: |det A| is the d-th power of a length ratio.
    let ratios: Vec<f64> = ifs.maps.iter().map(|m| math::pow(m.affine.det(ifs.dim).abs(), 1.0 / d)).collect();
    let dimension = similarity_dimension(&ratios, d);
    let weights: Vec<f64> = ratios.iter().map(|s| math::pow(*s, dimension)).collect();
    let largest = weights.iter().fold(0.0_f64, |m, w| m.max(*w));
    weights.iter().map(|w| w.max(MIN_WEIGHT_SHARE * largest)).collect()
}

/// The D with sum s_i^D = 1, clamped to 0.1..`most`; ratios of 0 do not count.
/// Source: P. Moran, "Additive functions of intervals and Hausdorff measure", 1946.
pub fn similarity_dimension(ratios: &[f64], most: f64) -> f64 {
    let excess = |d: f64| ratios.iter().filter(|s| **s > 0.0).fold(-1.0, |t, s| t + math::pow(*s, d));
    // sum s_i^D falls strictly with D for ratios below 1: bisection to 2^-60 of the interval.
    let (mut low, mut high) = (0.1, most);
    if excess(low) <= 0.0 {
        return low;
    }
    if excess(high) >= 0.0 {
        return high;
    }
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if excess(middle) > 0.0 { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

/// Shares as Fractint draws them from the running sum: maps beyond a sum of 1 get nothing, the last map gets the rest.
fn fractint_shares(column: &[f64]) -> Vec<f64> {
    let mut left = 1.0;
    let last = column.len().saturating_sub(1);
    column
        .iter()
        .enumerate()
        .map(|(i, p)| {
            let q = if i == last { left } else { p.clamp(0.0, left) };
            left -= q;
            q
        })
        .collect()
}

/// Warnings about the weights and their factors in the chaos matrix as written (I012 to I015), or about a part of them.
/// Only the rule of the file reads running sums and expects a sum of 1: flames, whose weights are relative, and tables
/// with another rule get neither I012 nor I014 for a sum.
pub(super) fn column_warnings(ifs: &Ifs) -> Vec<Diagnostic> {
    let mut warnings = Vec::new();
    let row = |i: usize| ifs.maps.get(i).map_or(ifs.span, |m| m.span);
    // Rules that read the column fall back on the maps if a weight is missing.
    let reads = !matches!(ifs.weights, Some(WeightRule::Det | WeightRule::Moran | WeightRule::Equal));
    let missing: Vec<usize> = (0..ifs.maps.len()).filter(|i| ifs.maps[*i].weight.is_none()).collect();
    if let Some(first) = missing.first().filter(|_| reads && missing.len() < ifs.maps.len()) {
        let text = format!("{} of {} maps have no weight", missing.len(), ifs.maps.len());
        let d = Diagnostic::warning("I014", text, row(*first), "the first of them");
        warnings.push(d.help("the weights of the others are not used either; give every map a p, or none"));
    }
    for (i, factors) in ifs.chaos.iter().flatten().enumerate() {
        if let Some(j) = factors.iter().position(|c| *c < 0.0) {
            let text = format!("the chaos matrix has a negative factor of map {} after map {}", j + 1, i + 1);
            let d = Diagnostic::warning("I013", text, row(i), "taken as 0");
            warnings.push(d.help("it multiplies the weight of the next map: 0 excludes that map, 1 leaves its weight"));
        }
    }
    let column: Option<Vec<f64>> = ifs.maps.iter().map(|m| m.weight).collect();
    let Some(column) = column.filter(|c| c.iter().any(|p| *p != 0.0)) else { return warnings };
    for (i, _) in column.iter().enumerate().filter(|(_, p)| **p < 0.0) {
        let text = format!("the weight of map {} is negative", i + 1);
        warnings.push(Diagnostic::warning("I013", text, row(i), "taken as 0").help("weights are shares of the points"));
    }
    // Negative weights are reported above and count as 0.
    let sum = column.iter().fold(0.0, |s, w| s + w.max(0.0));
    let by_file = matches!(ifs.weights, None | Some(WeightRule::File));
    if by_file && differences(&column).is_some() {
        let d = Diagnostic::warning("I012", "the weights look like a running sum", ifs.span, "in this system");
        warnings.push(d.help("their differences are used; weights = \"file-raw\" takes them as they are"));
    } else if by_file && (sum - 1.0).abs() > SUM_TOLERANCE && ifs.chaos.is_none() && ifs.condensation.is_empty() {
        let text = format!("the weights sum to {sum:.4}, not to 1");
        let effect = if sum < 1.0 { "the last map takes the rest" } else { "the last maps get too few points" };
        let d = Diagnostic::warning("I014", text, ifs.span, "in this system");
        warnings.push(d.help(format!("they are divided by their sum; in Fractint {effect}")));
    }
    let unused: Vec<usize> = (0..column.len()).filter(|i| column[*i] == 0.0).collect();
    if let Some(first) = unused.first() {
        let text = format!("{} of {} maps have the weight 0", unused.len(), column.len());
        let d = Diagnostic::warning("I015", text, row(*first), "the first of them");
        warnings.push(d.help("they are not drawn; expansion by words uses them"));
    }
    debug_assert!(warnings.iter().all(|d| d.severity == Severity::Warning));
    warnings
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Map, affine::Affine};
    use osier_base::diagnostic::{SourceId, Span};

    pub(crate) fn system(rows: &[[f64; 7]]) -> Ifs {
        let span = Span::new(SourceId(0), 0, 0);
        let map = |r: &[f64; 7]| Map::new(Affine::plane([r[0], r[1], r[2], r[3], r[4], r[5]]), Some(r[6]), span);
        Ifs {
            name: "test".into(),
            dim: 2,
            maps: rows.iter().map(map).collect(),
            chaos: None,
            last: None,
            condensation: Vec::new(),
            view: None,
            palette: Vec::new(),
            weights: None,
            span,
        }
    }

    fn with_weights(p: &[f64]) -> Ifs {
        system(&p.iter().map(|p| [0.5, 0.0, 0.0, 0.5, 0.0, 0.0, *p]).collect::<Vec<_>>())
    }

    fn codes(warnings: &[Diagnostic]) -> Vec<&'static str> {
        warnings.iter().map(|d| d.code).collect()
    }

    #[test]
    fn running_sums_are_seen_and_equal_weights_are_not() {
        let fern = with_weights(&[0.01, 0.86, 0.93, 1.0]);
        assert_eq!(codes(&column_warnings(&fern)), ["I012"]);
        let q = probabilities(&fern, WeightRule::File).0;
        for (a, b) in q.iter().zip([0.01, 0.85, 0.07, 0.07]) {
            assert!((a - b).abs() < 1e-12);
        }
        assert!((probabilities(&fern, WeightRule::Raw).0[0] - 0.01 / 2.8).abs() < 1e-12);
        assert_eq!(codes(&column_warnings(&with_weights(&[1.0, 1.0, 1.0]))), ["I014"]);
        assert_eq!(codes(&column_warnings(&with_weights(&[0.5, 0.5]))), [] as [&str; 0]);
        assert_eq!(codes(&column_warnings(&with_weights(&[0.5, -0.1, 0.0, 0.5]))), ["I013", "I015"]);
        // Weights of a flame are relative: neither a rising column nor a sum of 2.8 is a fault.
        let flame = Ifs { weights: Some(WeightRule::Raw), ..fern };
        assert_eq!(codes(&column_warnings(&flame)), [] as [&str; 0]);
        let mut partly = with_weights(&[0.98, 0.01, 0.01]);
        partly.maps[1].weight = None;
        assert_eq!(codes(&column_warnings(&partly)), ["I014"]);
        partly.weights = Some(WeightRule::Equal);
        assert_eq!(codes(&column_warnings(&partly)), [] as [&str; 0]);
        let flame = Ifs { weights: Some(WeightRule::Raw), ..with_weights(&[2.0, -1.0, 0.0]) };
        assert_eq!(codes(&column_warnings(&flame)), ["I013", "I015"]);
    }

    #[test]
    fn negative_factors_of_the_chaos_matrix_are_told_once_a_row() {
        let rows = vec![vec![1.0, 1.0, 1.0], vec![-2.0, 1.0, -1.0], vec![0.0, 1.0, -0.5]];
        // With weights, and without.
        let mut chained = Ifs { chaos: Some(rows), ..with_weights(&[0.5, 0.25, 0.25]) };
        for _ in 0..2 {
            let warnings = column_warnings(&chained);
            assert_eq!(codes(&warnings), ["I013", "I013"]);
            assert!(warnings[0].message.contains("map 1 after map 2"), "{}", warnings[0].message);
            assert!(warnings[1].message.contains("map 3 after map 3"), "{}", warnings[1].message);
            chained.maps.iter_mut().for_each(|m| m.weight = None);
        }
    }

    #[test]
    fn area_keeps_singular_maps_alive() {
        let fern = system(&[
            [0.0, 0.0, 0.0, 0.16, 0.0, 0.0, 0.01],
            [0.85, 0.04, -0.04, 0.85, 0.0, 1.6, 0.85],
            [0.2, -0.26, 0.23, 0.22, 0.0, 1.6, 0.07],
        ]);
        let (q, warnings) = probabilities(&fern, WeightRule::Det);
        assert!((q[0] / q[1] - 0.01).abs() < 1e-12 && warnings.is_empty());
        let flat = system(&[[0.5, 0.5, 0.0, 0.0, 0.0, 0.0, 0.5], [0.5, 0.5, 0.0, 0.0, 50.0, 0.0, 0.5]]);
        let (q, warnings) = probabilities(&flat, WeightRule::Det);
        assert!((q[0] - 0.5).abs() < 1e-9 && codes(&warnings) == ["I024"]);
        let none = with_weights(&[0.0, 0.0]);
        assert_eq!(codes(&probabilities(&none, WeightRule::Raw).1), ["I017"]);
    }

    #[test]
    fn fractint_starves_or_feeds_the_last_map() {
        let q = |p: &[f64]| probabilities(&with_weights(p), WeightRule::Fractint).0;
        let near = |a: Vec<f64>, b: &[f64]| a.iter().zip(b).all(|(x, y)| (x - y).abs() < 1e-12);
        assert!(near(q(&[0.2, 0.2, 0.2]), &[0.2, 0.2, 0.6]));
        assert!(near(q(&[0.7, 0.5, 0.5]), &[0.7, 0.3, 0.0]));
    }

    #[test]
    fn moran_of_sierpinski() {
        let d = similarity_dimension(&[0.5, 0.5, 0.5], 2.0);
        assert!((d - math::ln(3.0) / math::ln(2.0)).abs() < 1e-9, "{d}");
    }
}
