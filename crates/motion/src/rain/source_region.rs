//! Where drops have to start so that the wind carries them to a region.
//!
//! Drops of each size are traced from the plane that they start from down through the wind that they meet. How far they
//! drift until they are at a height tells from which rectangle those come that cross the region at that height; rain
//! starts evenly over the union of these rectangles, so that what falls on the region does not depend on the wind.

use std::sync::Arc;

use glam::{DVec2, DVec3, Vec3};

use crate::rain::emitter::{fall, sphere_volume, terminal_speed, wind_at};
use osier_base::geometry::Bounds;
use osier_wind::Wind;

/// Height of the plane above the region, m, and how far starts reach beyond what is needed: m, and by share of how much
/// the drift differs.
const ABOVE: f64 = 0.5;
const BESIDE: f64 = 0.05;
const SPARE: f64 = 0.15;
/// Time for which the same places are started from, s.
const EPOCH: f64 = 0.1;
/// Steps of a traced fall, and most of one that the wind holds up.
const STEPS: u32 = 48;
const MOST: u32 = 4 * STEPS;
/// Parts of the region's height.
const BANDS: usize = 8;
/// Sizes that are traced.
const SIZES: usize = 17;
/// Places along a side by which an area is measured.
const FINE: u32 = 32;
/// Times of a clip by which its mean area is measured.
const TIMES: u32 = 16;

/// A level rectangle: x and z, m.
#[derive(Debug, Clone, Copy, PartialEq)]
struct LevelRect {
    min: DVec2,
    max: DVec2,
}

impl LevelRect {
    const EMPTY: Self = Self { min: DVec2::INFINITY, max: DVec2::NEG_INFINITY };

    fn is_empty(&self) -> bool {
        self.min.x > self.max.x
    }

    fn with(self, p: DVec2) -> Self {
        Self { min: self.min.min(p), max: self.max.max(p) }
    }

    fn and(self, other: Self) -> Self {
        Self { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    fn middle(&self) -> DVec2 {
        (self.min + self.max) * 0.5
    }

    fn sides(&self) -> DVec2 {
        self.max - self.min
    }

    fn max_pendant_volume(&self, p: DVec2) -> bool {
        p.cmpge(self.min).all() && p.cmple(self.max).all()
    }
}

/// How far drops of a size drift until they are in each part of the region's height.
type DriftByBand = [LevelRect; BANDS];

/// Where drops of similar size start.
#[derive(Debug, Clone, PartialEq)]
pub struct SourceRegion {
    whole: LevelRect,
    parts: Vec<LevelRect>,
}

impl SourceRegion {
    fn new(over: &LevelRect, drift: &DriftByBand) -> Self {
        let part = |drift: &LevelRect| {
            let spare = DVec2::splat(BESIDE) + drift.sides() * SPARE;
            LevelRect { min: over.min - drift.max - spare, max: over.max - drift.min + spare }
        };
        let mut parts: Vec<LevelRect> = drift.iter().filter(|d| !d.is_empty()).map(part).collect();
        parts.dedup();
        let whole = parts.iter().fold(LevelRect::EMPTY, |all, part| all.and(*part));
        Self { whole, parts }
    }

    /// Area of the rectangle around it, m^2.
    pub fn around(&self) -> f64 {
        if self.parts.is_empty() {
            return 0.0;
        }
        let sides = self.whole.sides();
        sides.x * sides.y
    }

    /// A place of the rectangle around it by shares of its sides; none if drops from there pass the region.
    pub fn place(&self, shares: DVec2) -> Option<DVec2> {
        let p = self.whole.min + self.whole.sides() * shares;
        self.parts.iter().any(|part| part.max_pendant_volume(p)).then_some(p)
    }

    /// Its area, m^2.
    fn area(&self) -> f64 {
        if self.parts.len() < 2 {
            return self.around();
        }
        let share = |k: u32| (f64::from(k) + 0.5) / f64::from(FINE);
        let hit = |k: &u32| self.place(DVec2::new(share(k % FINE), share(k / FINE))).is_some();
        self.around() * (0..FINE * FINE).filter(hit).count() as f64 / f64::from(FINE * FINE)
    }
}

/// Finds where drops start.
#[derive(Debug)]
pub struct SourceTracer {
    over: Bounds,
    wind: Option<Arc<dyn Wind>>,
    g: f64,
    /// Diameters that are traced, smallest first, m.
    sizes: Vec<f64>,
    /// Drifts at the last times that were asked for, by the number of their epoch.
    known: Vec<(u64, Vec<DriftByBand>)>,
}

impl SourceTracer {
    /// For drops between two diameters, m, that are to fall on a box.
    pub fn new(over: Bounds, wind: Option<Arc<dyn Wind>>, [least, most]: [f64; 2], g: f64) -> Self {
        let pieces = if wind.is_none() || most - least < 1e-9 { 1 } else { SIZES - 1 };
        // Drift is as long as the fall: sizes are spaced evenly by the time that they take.
        let slow = |k: usize| {
            let [a, b] = [least, most].map(|d| terminal_speed(d).recip());
            a + (b - a) * k as f64 / pieces as f64
        };
        let mut sizes = vec![least];
        sizes.extend((1..pieces).map(|k| of_speed(slow(k).recip(), [least, most])));
        sizes.push(most);
        Self { over, wind, g, sizes, known: Vec::new() }
    }

    /// Moving air.
    pub fn wind(&self) -> Option<&dyn Wind> {
        self.wind.as_deref()
    }

    /// Height that drops start from, m.
    pub fn height(&self) -> f64 {
        f64::from(self.over.max.y) + ABOVE
    }

    /// Which of the sources a diameter belongs to.
    pub fn class(&self, d: f64) -> usize {
        self.sizes.partition_point(|size| *size <= d).clamp(1, self.sizes.len() - 1) - 1
    }

    /// Number of the epoch that a time is in.
    pub fn epoch(&self, t: f64) -> u64 {
        // Wind that never changes needs to be traced once.
        let steady = self.wind.as_ref().is_none_or(|w| w.period().is_some_and(|p| p <= 0.0));
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "casts of floats saturate")]
        if steady { 0 } else { (t / EPOCH).floor() as u64 }
    }

    /// Where drops start in an epoch, for each class of sizes.
    pub fn sources(&mut self, epoch: u64) -> Vec<SourceRegion> {
        let over = self.floor_plan();
        let (a, b) = (self.drifts(epoch), self.drifts(epoch + 1));
        let both: Vec<DriftByBand> = a.iter().zip(&b).map(|(a, b)| std::array::from_fn(|k| a[k].and(b[k]))).collect();
        let pairs = both.windows(2);
        pairs.map(|d| SourceRegion::new(&over, &std::array::from_fn(|k| d[0][k].and(d[1][k])))).collect()
    }

    /// Mean area that rain of each class starts from between two times, m^2. Times are weighted by `share`.
    pub fn areas(&mut self, duration: f64, share: impl Fn(f64) -> f64) -> Vec<f64> {
        let (mut sum, mut areas) = (0.0, vec![0.0; self.sizes.len() - 1]);
        for k in 0..TIMES {
            let t = duration * (f64::from(k) + 0.5) / f64::from(TIMES);
            let weight = share(t) + 1e-9;
            let epoch = self.epoch(t);
            sum += weight;
            areas.iter_mut().zip(self.sources(epoch)).for_each(|(area, s)| *area += weight * s.area());
        }
        areas.iter().map(|area| area / sum).collect()
    }

    fn floor_plan(&self) -> LevelRect {
        let flat = |p: Vec3| DVec2::new(f64::from(p.x), f64::from(p.z));
        LevelRect { min: flat(self.over.min), max: flat(self.over.max) }
    }

    fn drifts(&mut self, epoch: u64) -> Vec<DriftByBand> {
        if let Some((_, known)) = self.known.iter().find(|k| k.0 == epoch) {
            return known.clone();
        }
        let t = epoch as f64 * EPOCH;
        let found: Vec<DriftByBand> = self.sizes.iter().map(|d| self.drift(*d, t)).collect();
        self.known.insert(0, (epoch, found.clone()));
        self.known.truncate(2);
        found
    }

    /// Drift of a size from a time on, of drops that come to all sides of the region at its top, middle and bottom.
    fn drift(&self, d: f64, t: f64) -> DriftByBand {
        let over = self.floor_plan();
        if self.wind.is_none() {
            return [LevelRect { min: DVec2::ZERO, max: DVec2::ZERO }; BANDS];
        }
        let middle = over.middle();
        let first = self.trace(d, t, &[middle]);
        // Where the drop of the middle comes from, which the first guess has not met.
        let second = self.trace(d, t, &[0, BANDS / 2, BANDS - 1].map(|k| start(&first, k, middle)));
        let [a, b] = [over.min, over.max];
        let sides = [a, b, DVec2::new(a.x, b.y), DVec2::new(b.x, a.y), middle];
        let starts: Vec<DVec2> =
            [0, BANDS / 2, BANDS - 1].iter().flat_map(|k| sides.map(|p| start(&second, *k, p))).collect();
        self.trace(d, t, &starts)
    }

    /// How far drops that start at some places drift.
    fn trace(&self, d: f64, t: f64, starts: &[DVec2]) -> DriftByBand {
        let mut drift = [LevelRect::EMPTY; BANDS];
        let (low, high) = (f64::from(self.over.min.y) - BESIDE, f64::from(self.over.max.y) + BESIDE);
        let h = (self.height() - low) / terminal_speed(d) / f64::from(STEPS);
        let wind = self.wind.as_deref();
        let mut places: Vec<DVec3> = starts.iter().map(|p| DVec3::new(p.x, self.height(), p.y)).collect();
        let mut speeds: Vec<DVec3> = Vec::new();
        for k in 0..MOST {
            let at: Vec<Vec3> = places.iter().map(|p| p.as_vec3()).collect();
            let air = wind_at(wind, &at, t + f64::from(k) * h);
            if speeds.is_empty() {
                speeds = air.iter().map(|a| a.as_dvec3() - DVec3::Y * terminal_speed(d)).collect();
            }
            for (i, (p, v)) in places.iter_mut().zip(&mut speeds).enumerate() {
                let before = *p;
                *v = fall(*v, sphere_volume(d), self.g, air[i].as_dvec3(), h);
                *p += *v * h;
                let band = |y: f64| ((high - y) / (high - low) * BANDS as f64).floor();
                let (first, last) = (band(before.y.max(p.y)).max(0.0), band(before.y.min(p.y)).min(BANDS as f64 - 1.0));
                let gone = |p: DVec3| DVec2::new(p.x, p.z) - starts[i];
                #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped")]
                for part in drift.iter_mut().take((last + 1.0).max(0.0) as usize).skip(first as usize) {
                    *part = part.with(gone(before)).with(gone(*p));
                }
            }
            if places.iter().all(|p| p.y < low) {
                break;
            }
        }
        drift
    }
}

/// From where a drop comes to a place in a part of the region, by a known drift.
fn start(drift: &DriftByBand, part: usize, place: DVec2) -> DVec2 {
    let known = drift[part..].iter().chain(drift[..part].iter().rev()).find(|d| !d.is_empty());
    place - known.map_or(DVec2::ZERO, LevelRect::middle)
}

/// Diameter between two at which drops fall at a speed, m/s, by bisection.
fn of_speed(speed: f64, [mut low, mut high]: [f64; 2]) -> f64 {
    for _ in 0..50 {
        let middle = 0.5 * (low + high);
        *(if terminal_speed(middle) < speed { &mut low } else { &mut high }) = middle;
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use super::*;
    use osier_wind::{GustWind, GustWindOptions, UniformWind};

    fn tree() -> Bounds {
        Bounds { min: Vec3::new(-2.0, 1.0, -2.0), max: Vec3::new(2.0, 9.0, 2.0) }
    }

    #[test]
    fn calm_rain_starts_right_above() {
        let mut reach = SourceTracer::new(tree(), None, [5e-4, 6e-3], 9.81);
        let sources = reach.sources(0);
        assert_eq!(sources.len(), 1);
        assert!((sources[0].area() - 4.1 * 4.1).abs() < 1e-9 && (reach.height() - 9.5).abs() < 1e-9);
    }

    #[test]
    fn steady_wind_shifts_each_size_by_its_own_drift() {
        let mut reach = SourceTracer::new(tree(), Some(Arc::new(UniformWind(Vec3::X * 5.0))), [5e-4, 6e-3], 9.81);
        for d in [5e-4, 1e-3, 3e-3, 5.9e-3] {
            let sources = reach.sources(0);
            let source = &sources[reach.class(d)];
            let vt = terminal_speed(d);
            // Seen from the middle of the region at its top and bottom.
            for (fall, z) in [(0.5, 1.9), (4.5, 0.0), (8.5, -1.9)] {
                let from = DVec2::new(-5.0 * fall / vt, z);
                assert!(source.parts.iter().any(|p| p.max_pendant_volume(from)), "{d} {fall}");
            }
            assert!(!source.whole.max_pendant_volume(DVec2::new(3.0, 0.0)));
            let needed = 4.0 * (4.0 + 5.0 * 8.0 / vt);
            assert!(source.area() < 1.6 * needed && source.area() > needed, "{d}: {} of {needed}", source.area());
        }
    }

    /// Drops that are let go evenly all around, and how many of those that cross the region start from its sources.
    #[test]
    fn nearly_all_that_crosses_the_region_in_gusts_is_let_go() {
        let gust = GustWind::new(GustWindOptions { speed: 8.0, seed: 3, ..GustWindOptions::default() });
        for over in [tree(), Bounds { min: Vec3::new(-0.1, 0.3, -0.1), max: Vec3::new(0.1, 0.6, 0.1) }] {
            let mut reach = SourceTracer::new(over, Some(Arc::new(gust.clone())), [5e-4, 6e-3], 9.81);
            let (mut met, mut started) = (0, 0);
            for k in 0..40_u32 {
                let t = 0.33 * f64::from(k);
                let epoch = reach.epoch(t);
                let sources = reach.sources(epoch);
                let d = [5e-4, 8e-4, 1.5e-3, 4e-3][k as usize % 4];
                let source = &sources[reach.class(d)];
                let side = over.size().as_dvec3();
                let wide = 2.5 * source.whole.sides();
                for i in 0..900_u32 {
                    let share = DVec2::new(f64::from(i % 30), f64::from(i / 30)) / 29.0 - 0.5;
                    let from = source.whole.middle() + wide * share;
                    if crosses(&reach, d, (t, from), side.y) {
                        met += 1;
                        started += u32::from(source.parts.iter().any(|p| p.max_pendant_volume(from)));
                    }
                }
            }
            assert!(met > 500 && f64::from(started) > 0.98 * f64::from(met), "{started} of {met}");
        }
    }

    fn crosses(reach: &SourceTracer, d: f64, (t, from): (f64, DVec2), tall: f64) -> bool {
        let h = (tall / terminal_speed(d) / 30.0).min(0.01);
        let mut p = DVec3::new(from.x, reach.height(), from.y);
        let air = |p: DVec3, t: f64| wind_at(reach.wind(), &[p.as_vec3()], t)[0].as_dvec3();
        let mut v = air(p, t) - DVec3::Y * terminal_speed(d);
        let (min, max) = (reach.over.min.as_dvec3(), reach.over.max.as_dvec3());
        let mut k = 0.0;
        while p.y > min.y {
            if p.cmpge(min).all() && p.cmple(max).all() {
                return true;
            }
            v = fall(v, sphere_volume(d), 9.81, air(p, t + k * h), h);
            p += v * h;
            k += 1.0;
        }
        false
    }
}
