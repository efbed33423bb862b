//! The shipped tables against what is known about them.
#![allow(clippy::disallowed_methods, reason = "tests read the tables")]
#![allow(clippy::approx_constant, reason = "an exponent that happens to be near 1/pi")]

use crate::affine::AxisScaling;
use glam::{DMat3, DVec3};

use super::cloud::{DrawRequest, cloud, drop_hidden};
use super::color::{ColorLabels, ColorMode};
use super::dynamics::study;
use super::game::{CHUNK_STEPS, ChaosGame, Chunk, InstructionSet, LANES, PointSink, extent};
use super::histogram::{PictureWindow, histogram};
use super::weights::{WeightRule, probabilities};
use super::words::{Expansion, ExpansionLimits, Letters, Variation, expand};
use super::*;
use osier_base::limits::Limits;
use osier_base::progress::Cancel;

/// The text of a shipped table.
pub(crate) fn table(name: &str) -> String {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../ifs-tables").join(name);
    std::fs::read_to_string(path).expect("a table")
}

pub(crate) fn systems(name: &str) -> Vec<Ifs> {
    let (systems, report) = read::read(name, table(name).as_bytes(), &Limits::default()).expect("reads");
    assert!(report.diagnostics.is_empty(), "{report}");
    systems
}

pub(crate) fn system(name: &str) -> Ifs {
    systems(&format!("{name}.ifs")).remove(0)
}

const PLANE: [&str; 8] =
    ["bamboo_leaf", "bamboo_node", "fern_leaf", "hill", "green_tree", "palm_tree", "gray_tree", "sun"];
const SPACE: [&str; 3] = ["monopodial", "sympodial", "pseudodichotomous"];

#[test]
fn every_table_holds_what_it_should() {
    for name in PLANE.iter().chain(&SPACE) {
        let all = systems(&format!("{name}.ifs"));
        assert_eq!((all.len(), all[0].name.as_str()), (1, *name));
        let sum: f64 = all[0].maps.iter().filter_map(|m| m.weight).sum();
        assert!((sum - 1.0).abs() < 1e-9, "{name}: {sum}");
    }
    let printed = systems("as_printed.ifs");
    assert_eq!(printed.len(), 8);
    let warnings: Vec<(String, Vec<&str>)> = printed
        .iter()
        .map(|s| (s.name.clone(), study(s, WeightRule::File).diagnostics.iter().map(|d| d.code).collect()))
        .filter(|(_, t): &(String, Vec<&str>)| !t.is_empty())
        .collect();
    assert_eq!(warnings, [("raw_bamboo_node".into(), vec!["I025"]), ("raw_hill".into(), vec!["I020"])]);
    let hint = study(&printed[3], WeightRule::File).diagnostics.remove(0).help.unwrap_or_default();
    assert!(hint.starts_with("with b = -0.105 instead of -1.105"), "{hint}");
}

/// Table, largest norm, E1, exponent, mean, variances, sampled box.
type Row = (&'static str, f64, f64, f64, [f64; 2], [f64; 2], [f64; 4]);
const KNOWN: [Row; 8] = [
    ("bamboo_leaf", 0.630, -0.557, -0.618, [0.510575, 0.497521], [0.008976, 0.019281], [0.246, 0.233, 0.812, 0.968]),
    ("bamboo_node", 0.500, -0.693, -0.693, [50.0, 50.0], [833.333, 833.333], [0.0, 0.0, 100.0, 100.0]),
    ("fern_leaf", 0.851, -0.299, -0.318, [0.796833, 6.167579], [1.436309, 6.249628], [-2.182, 0.01, 2.656, 9.998]),
    ("hill", 0.943, -0.701, -0.814, [7.358153, 4.609060], [34.1137, 6.118711], [-13.3, -1.23, 20.9, 10.3]),
    ("green_tree", 0.600, -0.602, -0.777, [0.004416, 0.836255], [0.047957, 0.125247], [-0.650, -0.010, 0.665, 1.622]),
    ("palm_tree", 0.668, -0.568, -0.954, [0.513182, 0.446317], [0.016956, 0.029187], [0.062, 0.044, 0.960, 0.866]),
    ("gray_tree", 0.723, -0.379, -0.653, [-0.019043, 1.075238], [0.659064, 1.884743], [-2.64, -2.16, 2.46, 3.62]),
    ("sun", 0.999997, -0.031, -0.034, [4.929582, 5.040659], [4.938214, 4.872037], [0.67, 0.74, 9.23, 9.30]),
];

#[test]
fn dynamics_and_boxes_are_the_known_ones() {
    for (name, norm, e1, lambda, mean, _, known) in KNOWN {
        let ifs = system(name);
        let s = study(&ifs, WeightRule::File);
        let largest = ifs.maps.iter().fold(0.0_f64, |m, w| m.max(w.affine.norm()));
        assert!((largest - norm).abs() < 6e-4, "{name}: norm {largest}");
        assert!((s.mean_log - e1).abs() < 1.1e-3, "{name}: E1 {}", s.mean_log);
        assert!((s.exponent - lambda).abs() < 0.01, "{name}: exponent {} +- {}", s.exponent, s.error);
        let found = extent(&ifs, &s).expect("an attractor").bounds;
        let exact = exact_mean(&ifs, &s.probabilities);
        assert!((exact - DVec3::new(mean[0], mean[1], 0.0)).length() < 1e-5, "{name}: mean {exact}");
        let size = DVec3::new(known[2] - known[0], known[3] - known[1], 0.0).length();
        let slack = if name == "hill" { 0.1 } else { 0.01 } * size;
        for (a, b) in [found.0.x, found.0.y, found.1.x, found.1.y].iter().zip(known) {
            assert!((a - b).abs() <= slack, "{name}: {found:?}");
        }
    }
}

/// (I - sum p A)^-1 sum p b.
fn exact_mean(ifs: &Ifs, p: &[f64]) -> DVec3 {
    let (mut a, mut b) = (DMat3::IDENTITY, DVec3::ZERO);
    for (m, p) in ifs.maps.iter().zip(p) {
        a -= m.affine.a * *p;
        b += m.affine.b * *p;
    }
    a.inverse() * b
}

#[derive(Default)]
struct Moments {
    lanes: Vec<[f64; 2]>,
    squares: [f64; 2],
    count: f64,
    maps: Vec<f64>,
}

impl PointSink for Moments {
    fn take(&mut self, chunk: &Chunk) {
        self.lanes.resize(LANES, [0.0; 2]);
        for step in 0..chunk.steps.min(CHUNK_STEPS) {
            for lane in 0..LANES {
                let (x, y) = (f64::from(chunk.x[step][lane]), f64::from(chunk.y[step][lane]));
                self.lanes[lane][0] += x;
                self.lanes[lane][1] += y;
                self.squares[0] += x * x;
                self.squares[1] += y * y;
                self.count += 1.0;
                let map = chunk.map[step][lane] as usize;
                self.maps.resize(self.maps.len().max(map + 1), 0.0);
                self.maps[map] += 1.0;
            }
        }
    }
}

#[test]
fn moments_and_map_frequencies_are_exact_within_their_errors() {
    for (name, _, _, _, mean, variance, _) in KNOWN {
        let ifs = system(name);
        let s = study(&ifs, WeightRule::File);
        let game = ChaosGame::new(&ifs, &s, 5, AxisScaling::IDENTITY, 1e15);
        let (blocks, steps) = ChaosGame::plan(1 << 24);
        let (mut means, mut squares, mut count) = (Vec::new(), [0.0; 2], 0.0);
        let mut maps = vec![0.0; ifs.maps.len()];
        for b in 0..blocks {
            let mut m = Moments::default();
            assert_eq!(game.play(b, steps, &mut m).found, 0);
            #[allow(clippy::cast_precision_loss, reason = "steps")]
            let n = steps as f64;
            means.extend(m.lanes.iter().map(|l| [l[0] / n, l[1] / n]));
            (squares[0], squares[1], count) = (squares[0] + m.squares[0], squares[1] + m.squares[1], count + m.count);
            m.maps.iter().zip(&mut maps).for_each(|(a, b)| *b += a);
        }
        for axis in 0..2 {
            #[allow(clippy::cast_precision_loss, reason = "lanes")]
            let n = means.len() as f64;
            let found = means.iter().map(|m| m[axis]).sum::<f64>() / n;
            let spread = means.iter().map(|m| (m[axis] - found).powi(2)).sum::<f64>() / (n - 1.0);
            let error = (spread / n).sqrt();
            assert!((found - mean[axis]).abs() < 5.0 * error + 2e-6, "{name}: mean {found} +- {error}");
            let v = squares[axis] / count - found * found;
            let slack = if name == "sun" { 0.02 } else { 0.01 };
            assert!((v / variance[axis] - 1.0).abs() < slack, "{name}: variance {v}");
        }
        for (found, p) in maps.iter().zip(&s.probabilities) {
            let sigma = (count * p * (1.0 - p)).sqrt();
            assert!((found - count * p).abs() < 5.0 * sigma + 1.0, "{name}: {found} of {}", count * p);
        }
    }
}

#[test]
fn doubled_fern_does_not_contract() {
    let mut fern = system("fern_leaf");
    for m in &mut fern.maps {
        m.affine.a *= 2.0;
    }
    let s = study(&fern, WeightRule::File);
    assert!((s.mean_log - 0.394).abs() < 1e-3, "{}", s.mean_log);
    assert!(s.diagnostics.iter().any(|d| d.code == "I021"));
    assert!(extent(&fern, &s).is_err_and(|d| d.code == "I023"));
    let (_, warnings) = probabilities(&system("sun"), WeightRule::Det);
    assert_eq!(warnings.iter().map(|d| d.code).collect::<Vec<_>>(), ["I027"]);
}

#[test]
fn green_tree_in_polar_form() {
    let want: [(f64, f64, f64, f64); 6] = [
        (0.05, 0.6, 0.0, 0.0),
        (0.05, -0.5, 0.0, 0.0),
        (0.6, 0.5, 40.0, 40.0),
        (0.5, 0.45, 20.0, 20.0),
        (0.5, 0.55, -30.0, -30.0),
        (0.55, 0.4, -35.0, -35.0),
    ];
    for (m, (r, q, alpha, beta)) in system("green_tree").maps.iter().zip(want) {
        let [fr, fq, fa, fb] = m.affine.to_polar();
        // A negative q comes back as a turn by 180 degrees.
        let beta = if q < 0.0 { 180.0_f64 } else { beta };
        assert!((fr - r).abs() < 1e-4 && (fq - f64::abs(q)).abs() < 1e-4);
        assert!((fa.to_degrees() - alpha).abs() < 0.02 && (fb.to_degrees() - beta).abs() < 0.02);
    }
}

fn request<'a>(ifs: &'a Ifs, study: &'a super::dynamics::SystemAnalysis, tier: InstructionSet) -> DrawRequest<'a> {
    DrawRequest { system: ifs, study, seed: 9, points: 300_000, tier }
}

#[test]
fn bamboo_node_fills_cells_in_proportion() {
    let ifs = system("bamboo_node");
    let s = study(&ifs, WeightRule::File);
    let window = PictureWindow { width: 8, height: 8, center: [50.0, 50.0], pixel: 12.5 };
    let h = histogram(&DrawRequest { points: 1 << 21, ..request(&ifs, &s, InstructionSet::Best) }, None, &window);
    let quarter = |x: usize, y: usize| [[0.15, 0.35], [0.35, 0.15]][y][x];
    let mut chi = 0.0;
    #[allow(clippy::cast_precision_loss, reason = "counts")]
    let n = h.hits.iter().sum::<u64>() as f64;
    for y in 0..8 {
        for x in 0..8 {
            let (mut p, row) = (1.0, 7 - y);
            for bit in 0..3 {
                p *= quarter(x >> bit & 1, row >> bit & 1);
            }
            #[allow(clippy::cast_precision_loss, reason = "counts")]
            let found = h.hits[y * 8 + x] as f64;
            chi += (found - n * p).powi(2) / (n * p);
        }
    }
    // Successive points share digits, so the statistic is wider than for free draws; 63 degrees of freedom, p > 1e-4
    // is 116.
    assert!(chi < 116.0, "{chi}");
}

#[test]
fn counts_do_not_depend_on_threads_or_instructions() {
    let window = |ifs: &Ifs, s: &super::dynamics::SystemAnalysis| {
        let (low, high) = extent(ifs, s).expect("one").bounds;
        PictureWindow::fitted(low, high, 200, 150)
    };
    for name in ["fern_leaf", "hill", "monopodial"] {
        let ifs = system(name);
        let s = study(&ifs, WeightRule::File);
        let labels = ColorLabels::new(&ifs, ColorMode::Prefix(3), &[]);
        let window = window(&ifs, &s);
        let run = |tier| {
            let r = request(&ifs, &s, tier);
            (histogram(&r, None, &window), histogram(&r, Some(&labels), &window))
        };
        let points = |tier| {
            let e = extent(&ifs, &s).expect("one");
            cloud(&request(&ifs, &s, tier), &labels, &e, DVec3::ZERO, 1.0)
        };
        let (one, cloud_one) = (run(InstructionSet::Best), points(InstructionSet::Best));
        assert!(one == run(InstructionSet::Plain), "{name}");
        assert!(cloud_one == points(InstructionSet::Plain), "{name}");
        let by_map = ColorLabels::new(&ifs, ColorMode::Map, &[]);
        let colored = histogram(&request(&ifs, &s, InstructionSet::Plain), Some(&by_map), &window);
        assert!(one.0.hits == colored.hits, "{name}: both ways of counting agree");
        for threads in [1, 2, 3, 5, 8] {
            assert!(
                one == osier_base::par::on_threads(threads, || run(InstructionSet::Best)),
                "{name}, {threads} threads"
            );
            assert!(
                cloud_one == osier_base::par::on_threads(threads, || points(InstructionSet::Best)),
                "{name}, {threads} threads"
            );
        }
    }
}

#[test]
fn density_has_mean_one_when_nothing_is_clipped() {
    let ifs = system("fern_leaf");
    let s = study(&ifs, WeightRule::File);
    let (low, high) = extent(&ifs, &s).expect("one").bounds;
    let wide = (low - DVec3::splat(1.0), high + DVec3::splat(1.0));
    let h = histogram(&request(&ifs, &s, InstructionSet::Best), None, &PictureWindow::fitted(wide.0, wide.1, 90, 60));
    assert_eq!(h.outside, 0);
    let estimator = Some(picture::DensityEstimator { radius: 4.0, minimum: 0.0, curve: 0.4 });
    let cancel = Cancel::default();
    let d = picture::density(&h, 3, estimator, &cancel).expect("not cancelled");
    assert_eq!((d.width, d.height), (30, 20));
    let mean = d.value.iter().map(|v| f64::from(*v)).sum::<f64>() / 600.0;
    assert!((mean - 1.0).abs() < 1e-6, "{mean}");
    // The discs of a large picture take minutes, in which a user may interrupt it.
    cancel.request(2);
    let end = picture::density(&h, 3, estimator, &cancel).expect_err("cancelled");
    assert!(matches!(end, osier_base::Error::Cancelled { signal: 2 }), "{end}");
}

#[test]
fn orders_count_branchings_from_the_stem() {
    let ifs = system("monopodial");
    let s = study(&ifs, WeightRule::File);
    let e = extent(&ifs, &s).expect("one");
    let grays = [[0.0; 3], [1.0; 3]];
    let c = cloud(
        &request(&ifs, &s, InstructionSet::Best),
        &ColorLabels::new(&ifs, ColorMode::Order, &grays),
        &e,
        DVec3::ZERO,
        1.0,
    );
    let order = |k: usize| c.colors[k][0] * 5.0;
    let stem = ifs.maps.iter().position(|m| m.stem || super::color::is_squash(m)).expect("a trunk");
    // Chains of a lane follow each other every 32 points.
    let (mut begun, mut added) = (0, 0);
    for k in 32..4096 {
        let map = usize::from(c.maps[k]);
        if map == stem {
            assert!(order(k) < 1e-3, "on a trunk");
            begun += 1;
        } else if usize::from(c.maps[k - 32]) == stem && !ifs.maps[map].axis {
            assert!((order(k) - 1.0).abs() < 1e-3, "on a branch of a trunk: {}", order(k));
            added += 1;
        }
    }
    assert!(begun > 20 && added > 20, "{begun} {added}");
}

#[test]
fn the_first_point_of_a_lane_has_the_word_of_its_warm_up() {
    // 1024 points are one step of each lane.
    let small = |text: &str, mode: ColorMode| {
        let ifs = read::read("t.ifs.toml", text.as_bytes(), &Limits::default()).expect("reads").0.remove(0);
        let s = study(&ifs, WeightRule::File);
        let e = extent(&ifs, &s).expect("one");
        let labels = ColorLabels::new(&ifs, mode, &[[0.0; 3], [1.0; 3]]);
        let r = DrawRequest { points: 1024, ..request(&ifs, &s, InstructionSet::Best) };
        cloud(&r, &labels, &e, DVec3::ZERO, 1.0)
    };
    let line = "[ifs]\nname = \"line\"\nmap = [{ abcdef = [0.5, 0, 0, 0.5, 0, 0], coord = 0 }, \
                { abcdef = [0.5, 0, 0, 0.5, 1, 0], coord = 1 }]\n";
    // Coordinates are binary fractions of random digits: of 256 steps of the palette 1024 points leave out 256 e^-4, about 5.
    // After one step from the middle there would be two colours.
    let colors = small(line, ColorMode::Coord).colors;
    let distinct: std::collections::BTreeSet<u32> = colors.iter().map(|c| c[0].to_bits()).collect();
    assert!(distinct.len() > 230, "{}", distinct.len());
    // A jump into the set with probability 1/2: the depth is geometric with mean 1 and variance 2, and 1/4 of the points are
    // deeper than one map. Five standard errors.
    let text = format!("{line}condensation = [{{ disc = {{ center = [0, 0], radius = 1 }}, weight = 0.5 }}]\n");
    let depths = small(&text, ColorMode::Map).depths;
    let mean = depths.iter().map(|d| f64::from(*d)).sum::<f64>() / 1024.0;
    assert!((mean - 1.0).abs() < 5.0 * (2.0_f64 / 1024.0).sqrt(), "{mean}");
    let deep = depths.iter().filter(|d| **d > 1).count();
    assert!((186..=326).contains(&deep), "{deep}");
}

#[test]
fn a_cloud_has_the_share_of_points_that_opacity_draws() {
    let mut ifs = system("green_tree");
    let s = study(&ifs, WeightRule::File);
    let e = extent(&ifs, &s).expect("one");
    let labels = ColorLabels::new(&ifs, ColorMode::Map, &[]);
    let all = cloud(&request(&ifs, &s, InstructionSet::Best), &labels, &e, DVec3::ZERO, 1.0);
    let mut same = all.clone();
    drop_hidden(&mut same, &ifs, 9);
    assert_eq!(same, all);
    (ifs.maps[2].opacity, ifs.maps[3].opacity) = (0.0, 0.25);
    let mut some = all.clone();
    drop_hidden(&mut some, &ifs, 9);
    let count = |c: &super::cloud::AttractorPoints, map: u8| c.maps.iter().filter(|m| **m == map).count();
    assert_eq!([count(&some, 0), count(&some, 2), count(&some, 4)], [count(&all, 0), 0, count(&all, 4)]);
    // A quarter of the points of map 3, within five standard errors.
    #[allow(clippy::cast_precision_loss, reason = "counts")]
    let (n, found) = (count(&all, 3) as f64, count(&some, 3) as f64);
    assert!((found - 0.25 * n).abs() < 5.0 * (0.1875 * n).sqrt(), "{found} of {n}");
    let length = some.maps.len();
    assert_eq!([some.positions.len(), some.colors.len(), some.depths.len()], [length; 3]);
}

#[test]
fn nothing_lies_in_the_gap_of_a_cantor_dust() {
    let text = "dust {\n .333333 0 0 .333333 0 0 .25\n .333333 0 0 .333333 .666667 0 .25\n\
                .333333 0 0 .333333 0 .666667 .25\n .333333 0 0 .333333 .666667 .666667 .25\n}\n";
    let ifs = read::read("dust.ifs", text.as_bytes(), &Limits::default()).expect("reads").0.remove(0);
    let s = study(&ifs, WeightRule::File);
    let e = extent(&ifs, &s).expect("one");
    let c = cloud(
        &request(&ifs, &s, InstructionSet::Best),
        &ColorLabels::new(&ifs, ColorMode::Map, &[]),
        &e,
        DVec3::ZERO,
        1.0,
    );
    assert!(c.positions.iter().all(|p| [p.x, p.y].iter().all(|v| *v < 0.3334 || *v > 0.6666)));
}

#[test]
fn sierpinski_has_its_box_dimension() {
    let text = "gasket {\n.5 0 0 .5 0 0 1\n.5 0 0 .5 .5 0 1\n.5 0 0 .5 0 .5 1\n}";
    let ifs = read::read("g.ifs", text.as_bytes(), &Limits::default()).expect("reads").0.remove(0);
    let s = study(&ifs, WeightRule::File);
    let r = DrawRequest { points: 1 << 22, ..request(&ifs, &s, InstructionSet::Best) };
    let boxes = |n: usize| {
        #[allow(clippy::cast_precision_loss, reason = "pixels")]
        // Off the gasket's own grid, so that rounding at its lines opens no boxes.
        let window = PictureWindow { width: n, height: n, center: [0.513, 0.487], pixel: 1.1 / n as f64 };
        #[allow(clippy::cast_precision_loss, reason = "pixels")]
        let full = histogram(&r, None, &window).hits.iter().filter(|h| **h > 0).count() as f64;
        full
    };
    let slope = (boxes(512) / boxes(16)).ln() / 32.0_f64.ln();
    assert!((slope - 1.585).abs() < 0.03, "{slope}");
}

fn cut(eps: f64) -> ExpansionLimits {
    ExpansionLimits {
        eps,
        max_depth: u16::MAX,
        max_order: u16::MAX,
        max_words: 1_000_000,
        raised_by: Some("--max-nodes"),
    }
}

fn tree(name: &str) -> (Ifs, Letters) {
    let ifs = systems(&format!("{name}.ifs.toml")).remove(0);
    let letters = Letters::new(&ifs).expect("branches");
    (ifs, letters)
}

#[test]
fn expansions_have_the_known_counts() {
    let known = [("monopodial", 0.085, 1016, 3049, [108, 614, 1686]), ("sympodial", 0.10, 494, 989, [81, 494, 1369])];
    for (name, eps, words, cuts, at) in
        known.into_iter().chain([("pseudodichotomous", 0.10, 511, 512, [127, 511, 2047])])
    {
        let (ifs, letters) = tree(name);
        let e = expand(&ifs, &letters, &cut(eps), None).expect("expands");
        assert_eq!((e.words.len(), e.cuts.len()), (words, cuts), "{name}");
        assert_eq!(letters.count(&ifs, &cut(eps)), Some((words as u64, cuts as u64)), "{name}: predicted");
        for (eps, n) in [0.2, 0.1, 0.07].iter().zip(at) {
            assert_eq!(expand(&ifs, &letters, &cut(*eps), None).expect("expands").words.len(), n, "{name} at {eps}");
        }
        let refused =
            expand(&ifs, &letters, &ExpansionLimits { max_words: 100, ..cut(0.01) }, None).expect_err("too many");
        assert_eq!(refused.code, "I040");
        assert!(
            refused.help.as_deref().is_some_and(|h| h.ends_with("or raise it with --max-nodes")),
            "{:?}",
            refused.help
        );
    }
}

#[test]
fn coarse_words_are_among_the_fine_ones() {
    let (ifs, letters) = tree("monopodial");
    let vary = Some(Variation::new(4, 1, 1.0));
    let of = |eps: f64| expand(&ifs, &letters, &cut(eps), vary).expect("expands");
    let (coarse, fine): (Expansion, Expansion) = (of(0.2), of(0.1));
    for w in &coarse.words {
        let same = fine.words.iter().find(|v| v.id == w.id).expect("still there");
        assert_eq!(same.map, w.map);
    }
    let (x, y) = (DVec3::new(0.3, 0.1, -0.2), DVec3::new(-1.0, 2.0, 0.4));
    for w in expand(&ifs, &letters, &cut(0.1), None).expect("expands").words {
        let stretched = (w.map.apply(x) - w.map.apply(y)).length();
        assert!((stretched - w.size * (x - y).length()).abs() < 1e-12);
    }
}

#[test]
fn heights_and_half_widths_are_the_known_ones() {
    for (name, height, width) in
        [("monopodial", 9.719, 3.437), ("sympodial", 5.789, 2.328), ("pseudodichotomous", 3.722, 2.379)]
    {
        let (ifs, letters) = tree(name);
        let h = super::words::height(&ifs, &letters, (DVec3::ZERO, DVec3::Y));
        assert!((h - height).abs() < 2e-3, "{name}: {h}");
        let words = expand(&ifs, &letters, &cut(0.03), None).expect("expands").words;
        let w = words.iter().map(|w| w.map.apply(DVec3::Y)).fold(0.0_f64, |m, p| m.max(p.x.abs()).max(p.z.abs()));
        assert!((w - width).abs() < 2e-3, "{name}: {w}");
    }
}

/// A tree in space whose maps are branches with these scales, tilted by 20 degrees to different sides.
fn tree_of_scales(scales: &[f64]) -> (Ifs, Letters) {
    let branch = |(i, scale): (usize, &f64)| {
        format!("{{ branch = {{ roll = {}, pitch = 20, scale = {scale} }}, axis = {} }}", 90 * (i % 4), i == 0)
    };
    let maps: Vec<String> = scales.iter().enumerate().map(branch).collect();
    let text = format!("[ifs]\nname = \"tree\"\ndim = 3\nmap = [{}]\n", maps.join(", "));
    let ifs = read::read("tree.ifs.toml", text.as_bytes(), &Limits::default()).expect("reads").0.remove(0);
    let letters = Letters::new(&ifs).expect("branches");
    (ifs, letters)
}

#[test]
fn words_that_are_cut_are_limited_too() {
    let (ifs, letters) = tree_of_scales(&[&[0.9999][..], &[0.01; 900]].concat());
    let few = ExpansionLimits { max_words: 1000, ..cut(0.98) };
    assert_eq!(letters.count(&ifs, &few), None);
    assert_eq!(expand(&ifs, &letters, &few, None).expect_err("too many").code, "I040");
    let e = expand(&ifs, &letters, &cut(0.98), None).expect("expands");
    assert_eq!((e.words.len(), e.cuts.len()), (203, 203 * 900 + 1));
}

#[test]
fn orders_beyond_16_bits_stay_at_the_largest() {
    let (mut ifs, letters) = tree_of_scales(&[0.999_99]);
    ifs.maps[0].axis = false;
    let e = expand(&ifs, &letters, &ExpansionLimits { max_order: u16::MAX, ..cut(0.5) }, None).expect("expands");
    assert_eq!((e.words.len(), e.words[69_000].order), (69_315, u16::MAX));
}

#[test]
fn a_tree_of_too_many_words_is_measured_on_its_larger_ones() {
    // At eps 0.03 it has more than five million words.
    let (ifs, letters) = tree_of_scales(&[0.8; 3]);
    let extent = super::words::tree_extent(&ifs, &letters, (DVec3::ZERO, DVec3::Y));
    assert!((4.2..5.0).contains(&extent.height), "{extent:?}");
    assert!((0.5..4.0).contains(&extent.half_width), "{extent:?}");
}
