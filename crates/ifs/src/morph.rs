//! Interpolates systems in time: tables as keys, and a system for every time between them.
//!
//! # Examples
//! ```
//! use osier_base::limits::Limits;
//! use osier_ifs::morph::{Morph, MorphKey, MorphOptions};
//! use osier_ifs::{dynamics::study, read::read, weights::WeightRule};
//!
//! let text = b"a { .5 0 0 .5 0 0 1  .5 0 0 .5 1 0 1 }\nb { .3 0 0 .3 0 0 1  .3 0 0 .3 1 0 1 }";
//! let (systems, _) = read("two.ifs", text, &Limits::default())?;
//! let key = |at: f64, i: usize| MorphKey {
//!     at,
//!     system: systems[i].clone(),
//!     study: study(&systems[i], WeightRule::File),
//!     turns: Vec::new(),
//! };
//! let morph = Morph::new(vec![key(0.0, 0), key(1.0, 1)], MorphOptions::default()).expect("tables that fit");
//! assert!((morph.system(0.5).maps[0].affine.norm() - 0.4).abs() < 1e-7);
//! # Ok::<(), osier_base::Error>(())
//! ```

use glam::DVec3;

use super::affine::Affine;
use super::dynamics::SystemAnalysis;
use super::polar::{Turn, parts};
use super::{Ifs, Map};

/// Number of places along a segment at which fixed points are tested.
const FIXED_POINT_SAMPLES: u32 = 32;
/// |det(I - A)| below which a fixed point counts as running to infinity.
const MIN_FIXED_POINT_DET: f64 = 1e-6;

/// A system at one time of the morph, with its analysis and the extra turns of its maps.
#[derive(Debug, Clone)]
pub struct MorphKey {
    /// Time at which the morph equals `system`, s; keys are in order of time.
    pub at: f64,
    /// System at that time. All keys have the same number of maps, dimension and condensation sets.
    pub system: Ifs,
    /// Analysis of `system`, whose probabilities frames between the keys blend.
    pub study: SystemAnalysis,
    /// Full turns that each map makes on its path to this key besides the shortest turn; empty: none.
    pub turns: Vec<f64>,
}

/// How maps, weights and time are interpolated between keys.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct MorphOptions {
    /// Smoothstep in time: velocity 0 at the keys. Otherwise linear.
    pub smooth: bool,
    /// Interpolates the fixed points of the maps linearly instead of their shifts.
    pub fixed_points: bool,
    /// Keeps the weights of the first key at all times, so that every point keeps its word.
    pub hold_weights: bool,
}

/// The first key that cannot be interpolated, with the text of its diagnostic.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct MorphMismatch {
    /// Index of the key that does not fit.
    pub key: usize,
    /// Diagnostic code, I070 or I071.
    pub code: &'static str,
    /// What does not match, with the names of the tables or the number of the map, from 1.
    pub message: String,
    /// What the user can change to make the keys match.
    pub help: &'static str,
}

/// One map on its path from a key to the next.
#[derive(Debug, Clone)]
struct MapPath {
    turn: [Turn; 2],
    stretch: [glam::DMat3; 2],
    /// Shifts at both ends, or fixed points if these are interpolated.
    shift: [DVec3; 2],
    extra_turns: f64,
}

/// All maps, and the final one, between two keys.
#[derive(Debug, Clone)]
struct MorphSegment {
    maps: Vec<MapPath>,
    last: Option<MapPath>,
}

/// A system whose maps and weights are interpolated between keys.
#[derive(Debug, Clone)]
pub struct Morph {
    keys: Vec<MorphKey>,
    segments: Vec<MorphSegment>,
    options: MorphOptions,
    /// Lyapunov exponent nearest to 0 among the keys: its warm-up is long enough for all of them.
    exponent: f64,
}

impl Morph {
    /// Interpolates from each key to the next; their times must rise. A single key gives a system that does not change.
    /// # Errors
    /// I070 for tables of unequal numbers of maps, dimension or condensation sets, I071 where a fixed point that is
    /// interpolated does not stay unique.
    pub fn new(keys: Vec<MorphKey>, options: MorphOptions) -> Result<Self, MorphMismatch> {
        let Some(first) = keys.first() else {
            return Err(mismatch(0, "I070", "a morph without keys".into(), "give it at least two keys"));
        };
        for (i, key) in keys.iter().enumerate() {
            check_match(&first.system, key, i)?;
        }
        let count = first.system.maps.len();
        let dim = first.system.dim;
        let column =
            |m: usize| -> Vec<Affine> { keys.iter().filter_map(|k| k.system.maps.get(m).map(|m| m.affine)).collect() };
        let decompositions: Vec<Vec<(Turn, glam::DMat3)>> =
            (0..count).map(|m| parts(&column(m).iter().map(|a| a.a).collect::<Vec<_>>(), dim)).collect();
        // The final map moves too; keys without one have the identity.
        let finals: Vec<Affine> = keys.iter().map(|k| k.system.last.unwrap_or(Affine::IDENTITY)).collect();
        let shown = keys.iter().any(|k| k.system.last.is_some());
        let final_parts = parts(&finals.iter().map(|a| a.a).collect::<Vec<_>>(), dim);
        let mut segments = Vec::new();
        for k in 1..keys.len() {
            let mut maps = Vec::with_capacity(count);
            for (m, decomposition) in decompositions.iter().enumerate() {
                // Map m between keys k - 1 and k: polar factors of both ends, and their shifts or fixed points.
                let ends = [keys[k - 1].system.maps[m].affine, keys[k].system.maps[m].affine];
                let extra_turns = keys[k].turns.get(m).copied().unwrap_or(0.0);
                let mut path = MapPath::new([decomposition[k - 1], decomposition[k]], ends.map(|a| a.b), extra_turns);
                if options.fixed_points {
                    path.use_fixed_points(ends).map_err(|message| {
                        let help = "keep this map's norm below 1, or leave shift = \"straight\"";
                        mismatch(k, "I071", format!("map {}: {message}", m + 1), help)
                    })?;
                }
                maps.push(path);
            }
            let last =
                shown.then(|| MapPath::new([final_parts[k - 1], final_parts[k]], [finals[k - 1].b, finals[k].b], 0.0));
            segments.push(MorphSegment { maps, last });
        }
        // The slowest contraction decides the warm-up of all frames, so that every frame draws the same number of
        // steps.
        let exponent = keys.iter().fold(f64::NEG_INFINITY, |m, k| m.max(-k.study.exponent.abs()));
        Ok(Self { keys, segments, options, exponent })
    }

    /// Keys in order of time; at least one.
    pub fn keys(&self) -> &[MorphKey] {
        &self.keys
    }

    /// Index of the key at or before a time, s, and the eased fraction of the way to the next one, 0..1.
    /// Before the first key and after the last one nothing changes.
    pub fn place(&self, seconds: f64) -> (usize, f64) {
        let next = self.keys.partition_point(|k| k.at <= seconds);
        if next == 0 || next >= self.keys.len() {
            return (next.saturating_sub(1), 0.0);
        }
        let (a, b) = (self.keys[next - 1].at, self.keys[next].at);
        let t = ((seconds - a) / (b - a)).clamp(0.0, 1.0);
        (next - 1, if self.options.smooth { t * t * (3.0 - 2.0 * t) } else { t })
    }

    /// The system at a time, s. At the time of a key it equals that key's, except for the name: it is always that of the first
    /// key, because the streams of the chaos game are named by it.
    /// Own: rotations take the shortest path, everything else is linear. As ||R S|| = ||S|| and the norm is convex, a map's norm
    /// never exceeds the larger of its keys': what contracts at the keys contracts in every frame.
    pub fn system(&self, seconds: f64) -> Ifs {
        let (k, t) = self.place(seconds);
        // Everything without a value in between (weights rule, palette, condensation) is that of the key before.
        let mut system = Ifs { name: self.keys[0].system.name.clone(), ..self.keys[k].system.clone() };
        let (Some(segment), Some(next)) = (self.segments.get(k).filter(|_| t > 0.0), self.keys.get(k + 1)) else {
            return system;
        };
        for ((map, to), path) in system.maps.iter_mut().zip(&next.system.maps).zip(&segment.maps) {
            blend_attributes(map, to, t);
            map.affine = path.at(t, self.options.fixed_points);
        }
        system.last = segment.last.as_ref().map(|path| path.at(t, false));
        system
    }

    /// Analysis of the system at a time, s, for the chaos game: its weights, divided by their sum. Start and warm-up
    /// are the same at all times, so every point keeps its word while the weights do not change.
    pub fn study(&self, seconds: f64) -> SystemAnalysis {
        let (k, t) = if self.options.hold_weights { (0, 0.0) } else { self.place(seconds) };
        let a = &self.keys[k].study;
        let b = self.keys.get(k + 1).map_or(a, |k| &k.study);
        // A row of next-map probabilities for every map, if any key has a chaos matrix; keys without one repeat their
        // shares.
        let rows = self.keys.iter().any(|k| k.study.next.is_some()) && !(self.options.hold_weights && a.next.is_none());
        let next = rows.then(|| {
            let row = |i: usize| blended(&next_probabilities(a, i), &next_probabilities(b, i), t);
            (0..a.probabilities.len()).map(row).collect()
        });
        SystemAnalysis {
            probabilities: blended(&a.probabilities, &b.probabilities, t),
            next,
            exponent: self.exponent,
            first: self.keys[0].study.first,
            unbounded: self.keys.iter().any(|k| k.study.unbounded),
            diagnostics: Vec::new(),
            ..a.clone()
        }
    }

    /// Index of the first key whose probabilities differ from those of the key before it; `None` if all are alike.
    pub fn reweighted(&self) -> Option<usize> {
        let same = |a: &SystemAnalysis, b: &SystemAnalysis| {
            a.probabilities.iter().zip(&b.probabilities).all(|(p, q)| (p - q).abs() < 1e-9) && a.next == b.next
        };
        (1..self.keys.len()).find(|i| !same(&self.keys[i - 1].study, &self.keys[*i].study))
    }
}

/// Probabilities of the map after map `i`.
fn next_probabilities(study: &SystemAnalysis, i: usize) -> Vec<f64> {
    study.next.as_ref().and_then(|n| n.get(i)).unwrap_or(&study.probabilities).clone()
}

fn blended(a: &[f64], b: &[f64], t: f64) -> Vec<f64> {
    // Equal weights are returned unchanged: rounding would change the word of one point in a billion.
    if t <= 0.0 || a == b {
        return a.to_vec();
    }
    let mixed: Vec<f64> = a.iter().zip(b).map(|(p, q)| lerp(*p, *q, t)).collect();
    let sum = mixed.iter().fold(0.0, |s, p| s + p);
    mixed.iter().map(|p| p / sum).collect()
}

fn lerp(a: f64, b: f64, t: f64) -> f64 {
    a * (1.0 - t) + b * t
}

fn mismatch(key: usize, code: &'static str, message: String, help: &'static str) -> MorphMismatch {
    MorphMismatch { key, code, message, help }
}

fn check_match(first: &Ifs, key: &MorphKey, i: usize) -> Result<(), MorphMismatch> {
    let system = &key.system;
    if system.dim != first.dim {
        let text = format!("\"{}\" has {} dimensions, \"{}\" has {}", system.name, system.dim, first.name, first.dim);
        return Err(mismatch(i, "I070", text, "take tables that all lie in the plane or all in space"));
    }
    let (n, m) = (system.maps.len(), first.maps.len());
    if n != m {
        let text = format!("\"{}\" has {n} maps, \"{}\" has {m}", system.name, first.name);
        return Err(mismatch(i, "I070", text, "maps are matched by index: add maps of weight 0 to the shorter table"));
    }
    if system.condensation != first.condensation {
        let text = format!("\"{}\" and \"{}\" have different condensation sets", system.name, first.name);
        return Err(mismatch(i, "I070", text, "condensation sets do not move: use the same sets in all tables"));
    }
    Ok(())
}

/// Interpolates the attributes of a map besides its coefficients.
fn blend_attributes(map: &mut Map, to: &Map, t: f64) {
    map.weight = map.weight.zip(to.weight).map(|(a, b)| lerp(a, b, t));
    map.color = map
        .color
        .zip(to.color)
        .map(|(a, b)| [0, 1, 2].map(|i| osier_base::math::lerp(a[i], b[i], osier_base::math::narrow(t))));
    map.coord = lerp(map.coord, to.coord, t);
    map.speed = lerp(map.speed, to.speed, t);
    map.opacity = lerp(map.opacity, to.opacity, t);
    map.radius = map.radius.zip(to.radius).map(|(a, b)| lerp(a, b, t));
    map.branch = None;
}

impl MapPath {
    fn new(ends: [(Turn, glam::DMat3); 2], shift: [DVec3; 2], extra_turns: f64) -> Self {
        Self { turn: ends.map(|e| e.0), stretch: ends.map(|e| e.1), shift, extra_turns }
    }

    fn linear(&self, t: f64) -> glam::DMat3 {
        // A(t) = R(t) S(t): the rotation on the shortest path, the symmetric factor linearly.
        let r = self.turn[0].toward(self.turn[1], self.extra_turns, t).matrix();
        r * (self.stretch[0] * (1.0 - t) + self.stretch[1] * t)
    }

    fn at(&self, t: f64, fixed: bool) -> Affine {
        let a = self.linear(t);
        let shift = self.shift[0] * (1.0 - t) + self.shift[1] * t;
        Affine { a, b: if fixed { shift - a * shift } else { shift } }
    }

    /// Interpolates the fixed points linearly instead of the shifts. The error says where on the path the fixed point
    /// is not unique.
    fn use_fixed_points(&mut self, ends: [Affine; 2]) -> Result<(), String> {
        let det = |i: u32| {
            let t = f64::from(i) / f64::from(FIXED_POINT_SAMPLES);
            (t, (glam::DMat3::IDENTITY - self.linear(t)).determinant())
        };
        // det(I - A) must keep its sign along the path; near 0 the fixed point would run to infinity.
        let sign = det(0).1.signum();
        if let Some((t, d)) = (0..=FIXED_POINT_SAMPLES).map(det).find(|(_, d)| *d * sign <= MIN_FIXED_POINT_DET) {
            return Err(format!("it has no single fixed point {:.0} % of the path, det(I - A) = {d:.2e}", t * 100.0));
        }
        for (shift, end) in self.shift.iter_mut().zip(ends) {
            *shift = (glam::DMat3::IDENTITY - end.a).inverse() * end.b;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::cloud::{DrawRequest, cloud};
    use crate::color::{ColorLabels, ColorMode};
    use crate::dynamics::study;
    use crate::game::{InstructionSet, extent};
    use crate::tests::system as table;
    use crate::weights::WeightRule;

    fn key(at: f64, system: Ifs) -> MorphKey {
        let study = study(&system, WeightRule::File);
        MorphKey { at, system, study, turns: Vec::new() }
    }

    fn fern() -> Ifs {
        table("fern_leaf")
    }

    /// A system of rows as in a file.
    fn system(rows: &[[f64; 7]]) -> Ifs {
        let span = fern().span;
        let map = |r: &[f64; 7]| Map::new(Affine::plane([r[0], r[1], r[2], r[3], r[4], r[5]]), Some(r[6]), span);
        Ifs { name: "rows".into(), maps: rows.iter().map(map).collect(), ..fern() }
    }

    fn curled() -> Ifs {
        system(&[
            [0.0, 0.0, 0.0, 0.1, 0.0, 0.0, 0.01],
            [0.6, -0.4, 0.4, 0.6, 0.0, 1.0, 0.85],
            [0.1, -0.1, 0.1, 0.1, 0.0, 1.0, 0.07],
            [-0.1, 0.1, 0.1, 0.1, 0.0, 0.4, 0.07],
        ])
    }

    fn morph(keys: Vec<MorphKey>, options: MorphOptions) -> Morph {
        Morph::new(keys, options).expect("keys that fit")
    }

    #[test]
    fn at_the_keys_times_the_system_is_exactly_the_keys() {
        for fixed_points in [false, true] {
            let options = MorphOptions { fixed_points, ..MorphOptions::default() };
            let m = morph(vec![key(0.5, curled()), key(2.0, fern()), key(3.0, curled())], options);
            for (at, want) in [(0.0, curled()), (0.5, curled()), (2.0, fern()), (3.0, curled()), (9.0, curled())] {
                assert_eq!(m.system(at), Ifs { name: "rows".into(), ..want }, "{at} s");
            }
            // And what is near a key is near it: nothing jumps.
            for at in [0.5, 2.0, 3.0] {
                for (a, b) in m.system(at - 1e-9).maps.iter().zip(&m.system(at + 1e-9).maps) {
                    let off = (a.affine.a - b.affine.a).to_cols_array().iter().fold(0.0_f64, |m, v| m.max(v.abs()));
                    assert!(off.max((a.affine.b - b.affine.b).length()) < 1e-7, "{at} s");
                }
            }
        }
    }

    #[test]
    fn a_quarter_turn_is_half_done_half_way_and_the_singular_row_stays_finite() {
        let turned = |p: f64| {
            let (s, c) = (osier_base::math::sin(p), osier_base::math::cos(p));
            system(&[[0.5 * c, -0.5 * s, 0.5 * s, 0.5 * c, 0.0, 0.0, 0.5], [0.0, 0.0, 0.0, 0.16, 0.0, 0.0, 0.5]])
        };
        let m =
            morph(vec![key(0.0, turned(0.0)), key(1.0, turned(std::f64::consts::FRAC_PI_2))], MorphOptions::default());
        let h = 0.5 * std::f64::consts::FRAC_1_SQRT_2;
        let half = m.system(0.5).maps[0].affine.coefficients(2);
        assert!(half.iter().zip([h, -h, h, h, 0.0, 0.0]).all(|(a, b)| (a - b).abs() < 1e-12), "{half:?}");
        for i in 0..=100 {
            let row = m.system(f64::from(i) * 0.01).maps[1].affine;
            assert!(row.is_finite() && (row.norm() - 0.16).abs() < 1e-12);
        }
        // Smooth: the same middle, slow ends.
        let options = MorphOptions { smooth: true, ..MorphOptions::default() };
        let m = morph(vec![key(0.0, turned(0.0)), key(1.0, turned(1.0))], options);
        assert!((m.place(0.5).1 - 0.5).abs() < 1e-12 && m.place(0.01).1 < 4e-4);
    }

    #[test]
    fn fixed_points_go_straight_where_that_is_asked_for() {
        let options = MorphOptions { fixed_points: true, ..MorphOptions::default() };
        let m = morph(vec![key(0.0, curled()), key(1.0, fern())], options);
        let ends = [curled(), fern()].map(|s| s.maps[1].affine.fixed_point().expect("one"));
        for i in 1..10 {
            let t = f64::from(i) * 0.1;
            let p = m.system(t).maps[1].affine.fixed_point().expect("one");
            assert!((p - ends[0].lerp(ends[1], t)).length() < 1e-9, "{t}: {p}");
        }
        let straight = morph(vec![key(0.0, curled()), key(1.0, fern())], MorphOptions::default());
        assert!((straight.system(0.5).maps[1].affine.b - DVec3::new(0.0, 1.3, 0.0)).length() < 1e-12);
        // A map that passes the identity has no single fixed point on the path.
        let wide = |k: f64| system(&[[k, 0.0, 0.0, k, 1.0, 0.0, 0.1], [0.3, 0.0, 0.0, 0.3, 0.0, 0.0, 0.9]]);
        let fault = Morph::new(vec![key(0.0, wide(0.5)), key(1.0, wide(1.5))], options).expect_err("no fixed point");
        assert_eq!((fault.code, fault.key), ("I071", 1));
    }

    #[test]
    fn tables_that_do_not_fit_are_refused() {
        let short = system(&[[0.5, 0.0, 0.0, 0.5, 0.0, 0.0, 1.0]]);
        let solid = Ifs { dim: 3, ..fern() };
        for (other, words) in [(short, "1 maps"), (solid, "3 dimensions")] {
            let fault =
                Morph::new(vec![key(0.0, fern()), key(1.0, other)], MorphOptions::default()).expect_err("misfit");
            assert!(fault.code == "I070" && fault.key == 1 && fault.message.contains(words), "{}", fault.message);
        }
        assert_eq!(Morph::new(Vec::new(), MorphOptions::default()).expect_err("none").code, "I070");
    }

    #[test]
    fn points_keep_their_words_while_weights_stay() {
        let m = morph(vec![key(0.0, curled()), key(1.0, fern())], MorphOptions::default());
        assert_eq!(m.reweighted(), None);
        let extent = extent(&fern(), &m.keys()[1].study).expect("attractor");
        let drawn = |at: f64| {
            let (system, study) = (m.system(at), m.study(at));
            let labels = ColorLabels::new(&system, ColorMode::Map, &[]);
            let request =
                DrawRequest { system: &system, study: &study, seed: 3, points: 4096, tier: InstructionSet::Best };
            cloud(&request, &labels, &extent, DVec3::ZERO, 0.1)
        };
        let (before, now, after) = (drawn(0.4), drawn(0.4001), drawn(0.6));
        assert!([now.maps.clone(), after.maps, drawn(0.0).maps, drawn(1.0).maps].iter().all(|m| *m == before.maps));
        // Each point is the image of its word: a step of the next map leads from one to the next.
        let farthest = before.positions.iter().zip(&now.positions).map(|(a, b)| a.distance(*b)).fold(0.0, f32::max);
        assert!(farthest > 0.0 && farthest < 1e-3, "{farthest} m in 0.1 ms");
        // Other weights are diagnostics, and held if that is asked for.
        let mut heavy = fern();
        for (map, w) in heavy.maps.iter_mut().zip([0.25; 4]) {
            map.weight = Some(w);
        }
        for hold_weights in [false, true] {
            let options = MorphOptions { hold_weights, ..MorphOptions::default() };
            let m = morph(vec![key(0.0, curled()), key(1.0, heavy.clone())], options);
            assert_eq!(m.reweighted(), Some(1));
            let p = m.study(0.5).probabilities;
            let want = if hold_weights { 0.85 } else { 0.55 };
            assert!((p[1] - want).abs() < 1e-12 && (p.iter().sum::<f64>() - 1.0).abs() < 1e-12, "{p:?}");
        }
    }

    #[test]
    fn chains_of_maps_are_led_over_row_by_row() {
        let mut chained = fern();
        chained.chaos = Some(vec![vec![0.5, 1.0, 1.0, 1.0]; 4]);
        let m = morph(vec![key(0.0, fern()), key(1.0, chained)], MorphOptions::default());
        let next = m.study(0.5).next.expect("rows");
        assert!(
            next.iter()
                .all(|r| (r.iter().sum::<f64>() - 1.0).abs() < 1e-12
                    && (r[0] - 0.5 * (0.01 + 0.005 / 0.995)).abs() < 1e-9)
        );
    }

    proptest! {
        #[test]
        fn no_map_stretches_more_than_at_its_keys(
            a in proptest::array::uniform12(-1.0..1.0_f64),
            b in proptest::array::uniform12(-1.0..1.0_f64),
            t in 0.0..1.0_f64,
        ) {
            for dim in [2, 3] {
                let of = |c: [f64; 12]| {
                    if dim == 3 { Affine::space(c) } else { Affine::plane([c[0], c[1], c[2], c[3], c[4], c[5]]) }
                };
                let decomposition = parts(&[of(a).a, of(b).a], dim);
                let path = MapPath::new([decomposition[0], decomposition[1]], [of(a).b, of(b).b], 0.0);
                let most = of(a).norm().max(of(b).norm());
                prop_assert!(path.at(t, false).norm() <= most + 1e-7, "{} {most}", path.at(t, false).norm());
                prop_assert!((path.at(1.0, false).a - of(b).a).to_cols_array().iter().all(|v| v.abs() < 1e-12));
            }
        }
    }
}
