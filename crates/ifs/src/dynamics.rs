//! Analyses whether a system has an attractor: norms of its maps, Lyapunov exponent, and warnings about them.
//!
//! # Examples
//! ```
//! use osier_base::limits::Limits;
//! use osier_ifs::{dynamics::study, read::read, weights::WeightRule};
//!
//! let text = b"sierpinski { .5 0 0 .5 0 0 1  .5 0 0 .5 .5 0 1  .5 0 0 .5 0 .5 1 }";
//! let (systems, _) = read("sierpinski.ifs", text, &Limits::default())?;
//! let analysis = study(&systems[0], WeightRule::File);
//! // Every step halves distances: the exponent is ln 0.5.
//! assert!((analysis.exponent + 0.693).abs() < 1e-3 && !analysis.unbounded);
//! # Ok::<(), osier_base::Error>(())
//! ```

use glam::DVec3;

use super::weights::{WeightRule, probabilities};
use super::{Ifs, Map};
use osier_base::diagnostic::{Diagnostic, Report, Severity};
use osier_base::math;
use osier_base::rng::Rng;
use osier_base::units;

/// Magnitude of an exponent per step below which growth and decay cannot be distinguished within the sampling error.
const NEUTRAL_EXPONENT: f64 = 1e-3;
/// Independent chains of maps for the Lyapunov exponent, and steps of each.
const LYAPUNOV_CHAINS: u64 = 64;
const LYAPUNOV_STEPS: u32 = 4096;
/// A map is singular if its smallest singular value is at most this share of its largest.
const SINGULAR_RATIO: f64 = 1e-9;

/// Analysis of a system before it is drawn: shares of its maps, how fast it contracts, whether it is bounded.
#[derive(Debug, Clone, PartialEq)]
pub struct SystemAnalysis {
    /// Share of each map in long runs, in the order of the maps.
    pub probabilities: Vec<f64>,
    /// Probability of the next map (column) after the last one (row), where the file has a chaos matrix.
    pub next: Option<Vec<Vec<f64>>>,
    /// E1: sum over the maps of probability times ln of the norm of the linear part. An upper bound of `exponent`;
    /// negative is enough for an attractor.
    pub mean_log: f64,
    /// Top Lyapunov exponent of the random product, per step.
    pub exponent: f64,
    /// Standard error of `exponent` over the chains.
    pub error: f64,
    /// True if a map drawn has a spectral radius of 1 or more: the attractor has no bounds.
    pub unbounded: bool,
    /// Index of the map whose fixed point chains start from.
    pub first: usize,
    /// Warnings and errors about expanding maps (I020 to I022), singular or diverging maps (I025, I026) and weights.
    pub diagnostics: Vec<Diagnostic>,
}

impl SystemAnalysis {
    /// `Err` with a report over `sources` if the system has no attractor.
    /// # Errors
    /// `Input` with all warnings and errors of the analysis.
    pub fn into_result(self, sources: &Report) -> osier_base::Result<(Self, Report)> {
        let mut report = Report { sources: sources.sources.clone(), ..Report::default() };
        self.diagnostics.iter().for_each(|d| report.push(d.clone()));
        report.into_result(self)
    }

    /// Number of steps after which the start point no longer matters (distances have shrunk by e^-16.6), 32 to 4096.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped before the cast")]
    pub fn warm_up(&self) -> u32 {
        (16.6 / self.exponent.abs().max(1e-6)).ceil().clamp(32.0, 4096.0) as u32
    }
}

/// Analyses a system whose probabilities follow the given rule of weights.
/// Source: [zhao-zhang] definition 2, of which a contractive system asks max norm < 1.
/// Differs: contraction on average is enough (E1 <= -1e-3, or a negative exponent): a quarter of the tables in
/// circulation holds a map that stretches and nevertheless has an attractor.
pub fn study(ifs: &Ifs, rule: WeightRule) -> SystemAnalysis {
    let (mut shares, mut diagnostics) = probabilities(ifs, rule);
    // With a chaos matrix the maps form a Markov chain; their long-run shares are its stationary distribution.
    let next = ifs.chaos.as_ref().and_then(|c| transition_matrix(ifs, c, &shares, &mut diagnostics));
    if let Some(next) = &next {
        shares = stationary_distribution(next, shares);
    }
    let norms: Vec<f64> = ifs.maps.iter().map(|m| m.affine.norm()).collect();
    let drawn = |i: &usize| shares.get(*i).is_some_and(|p| *p > 0.0);
    for (i, map) in ifs.maps.iter().enumerate().filter(|(i, _)| norms.get(*i).is_some_and(|n| *n >= 1.0)) {
        diagnostics.push(expanding_map_warning(ifs, i, map, norms.get(i).copied().unwrap_or(0.0)));
    }
    // Repeating one map diverges if its spectral radius is 1 or more, even where the random product contracts.
    let radius: Vec<f64> = ifs.maps.iter().map(|m| m.affine.spectral_radius()).collect();
    let expanding = (0..ifs.maps.len()).filter(drawn).find(|i| radius.get(*i).is_some_and(|r| *r >= 1.0));
    if let Some(i) = expanding {
        let text = format!("map {} alone diverges: its spectral radius is {:.4}", i + 1, radius[i]);
        let d = Diagnostic::warning("I026", text, ifs.maps[i].span, "this map");
        diagnostics.push(d.help("the attractor is unbounded; the picture shows all but 0.1 % of its points"));
    }
    if ifs.maps.iter().all(|m| is_flat(ifs, m)) {
        let text = "every map is singular";
        let d = Diagnostic::warning("I025", text, ifs.span, "in this system");
        diagnostics.push(
            d.help("the attractor is a few lines or points; are the columns r q alpha beta rather than a b c d?"),
        );
    }
    // E1 = sum p_i ln |A_i|: negative is enough for an attractor, as the exponent is at most E1.
    let mean_log = shares.iter().zip(&norms).fold(0.0, |s, (p, n)| s + p * math::ln(n.max(1e-12)));
    let (exponent, error) = lyapunov_exponent(ifs, &shares, next.as_deref());
    judge_contraction(ifs, mean_log, exponent, &mut diagnostics);
    let first = likeliest(&shares);
    SystemAnalysis {
        probabilities: shares,
        next,
        mean_log,
        exponent,
        error,
        unbounded: expanding.is_some(),
        first,
        diagnostics,
    }
}

fn is_flat(ifs: &Ifs, map: &Map) -> bool {
    let s = map.affine.singular_values();
    s.get(ifs.dim - 1).is_none_or(|least| *least <= SINGULAR_RATIO * s[0].max(1e-300))
}

/// Reports I021 for a system that expands on average and I022 for one that neither expands nor contracts.
fn judge_contraction(ifs: &Ifs, mean_log: f64, exponent: f64, diagnostics: &mut Vec<Diagnostic>) {
    if mean_log <= -NEUTRAL_EXPONENT || diagnostics.iter().any(|d| d.severity == Severity::Error) {
        return;
    }
    if exponent > NEUTRAL_EXPONENT {
        let text = format!("\"{}\" does not contract: distances grow by {:.3} per step", ifs.name, math::exp(exponent));
        let d = Diagnostic::error("I021", text, ifs.span, "no attractor");
        diagnostics
            .push(d.help("points diverge; reduce the scale of the maps, or raise the weights of those that contract"));
    } else if exponent > -NEUTRAL_EXPONENT {
        let text = format!("\"{}\" neither contracts nor grows on average", ifs.name);
        let d = Diagnostic::warning("I022", text, ifs.span, "in this system");
        diagnostics.push(d.help("the picture depends on the start points"));
    }
}

/// Diagnostic I020 with the map's numbers and, if changing one digit of a coefficient makes both angles equal, that
/// change.
fn expanding_map_warning(ifs: &Ifs, index: usize, map: &Map, norm: f64) -> Diagnostic {
    let text = format!("map {} expands distances: its norm is {norm:.3}", index + 1);
    if ifs.dim != 2 {
        let d = Diagnostic::warning("I020", text, map.span, "norm of 1 or more");
        return d.help("a system may contain such a map as long as it contracts on average");
    }
    let [r, q, alpha, beta] = map.affine.to_polar();
    let degrees = |a: f64| a / units::radians(1.0);
    let label = format!("r {r:.3} q {q:.3} alpha {:.1} beta {:.1}", degrees(alpha), degrees(beta));
    let d = Diagnostic::warning("I020", text, map.span, label);
    match likely_misprint(map) {
        Some((column, from, to)) => d.help(format!(
            "with {column} = {to} instead of {from} alpha and beta would be equal: possibly a misprint. The map may stay as long as the \
             system contracts on average"
        )),
        None => d.help("a system may contain such a map as long as it contracts on average"),
    }
}

/// A change of one digit of one coefficient that makes alpha and beta equal within a degree, and the norm less than 1.
fn likely_misprint(map: &Map) -> Option<(char, String, String)> {
    // Maps of printed tables are mostly similarities, alpha = beta. Try every other digit in every place and keep the
    // change that brings the angles closest together.
    let numbers = map.affine.coefficients(2);
    let gap = |c: [f64; 6]| {
        let m = super::affine::Affine::plane(c);
        let [r, q, alpha, beta] = m.to_polar();
        let sound = r > 0.0 && q > 0.0 && m.norm() < 1.0;
        if sound { (alpha - beta).abs() } else { f64::MAX }
    };
    let mut best = (units::radians(1.0), None);
    for (i, column) in "abcd".chars().enumerate() {
        let text = numbers.get(i)?.to_string();
        for (k, digit) in text.char_indices().filter(|(_, c)| c.is_ascii_digit()) {
            for new in '0'..='9' {
                let mut changed = text.clone();
                changed.replace_range(k..=k, new.encode_utf8(&mut [0; 4]));
                let Ok(value) = changed.parse::<f64>() else { continue };
                let mut c: [f64; 6] = std::array::from_fn(|j| numbers.get(j).copied().unwrap_or(0.0));
                c[i] = value;
                let found = gap(c);
                if new != digit && found < best.0 {
                    best = (found, Some((column, text.clone(), changed)));
                }
            }
        }
    }
    best.1
}

/// Rows of next-map probabilities q_j c_ij, normalised; `None` with I016 if the matrix makes no sense.
fn transition_matrix(
    ifs: &Ifs,
    chaos: &[Vec<f64>],
    shares: &[f64],
    diagnostics: &mut Vec<Diagnostic>,
) -> Option<Vec<Vec<f64>>> {
    let m = ifs.maps.len();
    let mut bad = |text: String, help: &str| {
        diagnostics.push(Diagnostic::error("I016", text, ifs.span, "in this system").help(help));
    };
    if chaos.len() != m || chaos.iter().any(|r| r.len() != m) {
        bad(format!("the chaos matrix is not {m} x {m}"), "one row per map, each with one factor per map");
        return None;
    }
    let mut next = Vec::with_capacity(m);
    for (i, row) in chaos.iter().enumerate() {
        // Probability of j after i: the share of j times the factor of the matrix, normalized by row.
        let weights: Vec<f64> = row.iter().zip(shares).map(|(c, q)| c.max(0.0) * q).collect();
        let sum = weights.iter().fold(0.0, |s, w| s + w);
        if sum <= 0.0 {
            bad(format!("no map may follow map {}", i + 1), "each row needs a factor above 0");
            return None;
        }
        next.push(weights.iter().map(|w| w / sum).collect::<Vec<f64>>());
    }
    let start = likeliest(shares);
    // Every map with a share must be reachable from the most probable one, or the chain has no single distribution.
    let mut reached = vec![false; m];
    let mut stack = vec![start];
    while let Some(i) = stack.pop() {
        if !std::mem::replace(&mut reached[i], true) {
            stack.extend((0..m).filter(|j| next[i][*j] > 0.0));
        }
    }
    if let Some(lost) = (0..m).find(|i| !reached[*i] && shares[*i] > 0.0) {
        bad(format!("map {} is never reached", lost + 1), "some row needs a factor above 0 in its column");
        return None;
    }
    Some(next)
}

/// The map with the largest share; the first of several.
fn likeliest(shares: &[f64]) -> usize {
    let mut best = 0;
    for (i, p) in shares.iter().enumerate() {
        if *p > shares[best] {
            best = i;
        }
    }
    best
}

/// Long-run shares of a Markov chain, by averaged powers.
fn stationary_distribution(next: &[Vec<f64>], mut shares: Vec<f64>) -> Vec<f64> {
    for _ in 0..4096 {
        let step = |j: usize| shares.iter().zip(next).fold(0.0, |s, (p, row)| s + p * row[j]);
        // The mean of the old and the new shares: with it, periodic chains converge as well.
        let mixed: Vec<f64> = (0..shares.len()).map(|j| 0.5 * (shares[j] + step(j))).collect();
        shares = mixed;
    }
    shares
}

/// Top exponent of the random product and its standard error; seed 0, so that the result does not depend on a scene's
/// seed.
/// Source: H. Furstenberg, H. Kesten, "Products of random matrices", 1960; by simulation.
fn lyapunov_exponent(ifs: &Ifs, shares: &[f64], next: Option<&[Vec<f64>]>) -> (f64, f64) {
    if shares.iter().all(|p| *p <= 0.0) {
        return (0.0, 0.0);
    }
    let mut means = Vec::new();
    for chain in 0..LYAPUNOV_CHAINS {
        // Follow a unit vector through the random product and average the logarithm of its stretch.
        let mut draw = Rng::at(0, &["ifs-exponent".into(), chain.into()]);
        let mut direction = random_direction(&mut draw, ifs.dim);
        let (mut sum, mut last) = (0.0, draw.pick(shares));
        for _ in 0..LYAPUNOV_STEPS {
            let row = next.and_then(|n| n.get(last)).map_or(shares, Vec::as_slice);
            last = draw.pick(row);
            let Some(map) = ifs.maps.get(last) else { continue };
            let image = map.affine.a * direction;
            let length = image.length();
            if length > 1e-12 && length.is_finite() {
                direction = image / length;
            } else {
                direction = random_direction(&mut draw, ifs.dim);
            }
            // A singular map may send the vector to 0: it restarts in a new direction, its stretch clamped.
            sum += math::ln(length.clamp(1e-12, 1e300));
        }
        means.push(sum / f64::from(LYAPUNOV_STEPS));
    }
    #[allow(clippy::cast_precision_loss, reason = "64 chains")]
    let n = means.len() as f64;
    let mean = means.iter().fold(0.0, |s, v| s + v) / n;
    // The spread of the independent chains gives the standard error of their mean.
    let variance = means.iter().fold(0.0, |s, v| s + (v - mean) * (v - mean)) / (n - 1.0);
    (mean, math::sqrt(variance / n))
}

fn random_direction(draw: &mut Rng, dim: usize) -> DVec3 {
    let v = DVec3::new(draw.normal(), draw.normal(), if dim == 3 { draw.normal() } else { 0.0 });
    v.try_normalize().unwrap_or(DVec3::X)
}
