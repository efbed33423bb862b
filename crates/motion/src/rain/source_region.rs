//! Source regions: where drops must start so that the wind carries them to the bounds of the scene.
//!
//! Drops of several sizes are traced from the emission plane down through the wind. Their drift at each height gives the
//! rectangle of the plane from which the drops come that cross the bounds at that height. Rain starts uniformly over the union of
//! these rectangles, so that the flux through the bounds does not depend on the wind.

use std::sync::Arc;

use glam::{DVec2, DVec3, Vec3};

use crate::rain::fall::{sample_wind, sphere_volume, step_velocity, terminal_speed, terminal_speed_on_earth};
use crate::rain::tuning::{
    AREA_SAMPLES, AREA_TIMES, DRIFT_MARGIN, EMISSION_CLEARANCE, EPOCH_DURATION, HEIGHT_BANDS, MAX_TRACE_STEPS,
    SOURCE_MARGIN, TRACE_STEPS, TRACED_SIZES,
};
use osier_base::geometry::Bounds;
use osier_wind::Wind;

/// A horizontal rectangle: x and z, m.
#[derive(Debug, Clone, Copy, PartialEq)]
struct HorizontalRect {
    min: DVec2,
    max: DVec2,
}

impl HorizontalRect {
    const EMPTY: Self = Self { min: DVec2::INFINITY, max: DVec2::NEG_INFINITY };

    fn is_empty(&self) -> bool {
        self.min.x > self.max.x
    }

    /// The smallest rectangle that contains this one and a point.
    fn including(self, p: DVec2) -> Self {
        Self { min: self.min.min(p), max: self.max.max(p) }
    }

    fn union(self, other: Self) -> Self {
        Self { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    fn center(&self) -> DVec2 {
        (self.min + self.max) * 0.5
    }

    fn size(&self) -> DVec2 {
        self.max - self.min
    }

    fn contains(&self, p: DVec2) -> bool {
        p.cmpge(self.min).all() && p.cmple(self.max).all()
    }
}

/// Horizontal drift, m, of drops of one size since their start, for each band of the bounds' height from the top: the rectangle
/// of the drifts that occur while drops are in the band; empty if no drop reaches it.
type DriftByHeight = [HorizontalRect; HEIGHT_BANDS];

/// The part of the emission plane from which drops of similar size reach the bounds: the union of one rectangle for each height
/// band.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct SourceRegion {
    bounding_rect: HorizontalRect,
    rects: Vec<HorizontalRect>,
}

impl SourceRegion {
    /// The region from which drops with these drifts reach the `footprint` of the bounds.
    fn new(footprint: &HorizontalRect, drift: &DriftByHeight) -> Self {
        // A drop that starts at x - drift crosses the bounds at x; margins cover the wind between the traced drops.
        let source = |drift: &HorizontalRect| {
            let margin = DVec2::splat(SOURCE_MARGIN) + drift.size() * DRIFT_MARGIN;
            HorizontalRect { min: footprint.min - drift.max - margin, max: footprint.max - drift.min + margin }
        };
        let mut rects: Vec<HorizontalRect> = drift.iter().filter(|d| !d.is_empty()).map(source).collect();
        rects.dedup();
        let bounding_rect = rects.iter().fold(HorizontalRect::EMPTY, |all, rect| all.union(*rect));
        Self { bounding_rect, rects }
    }

    /// Area of the bounding rectangle, m^2.
    pub(crate) fn bounding_area(&self) -> f64 {
        if self.rects.is_empty() {
            return 0.0;
        }
        let size = self.bounding_rect.size();
        size.x * size.y
    }

    /// The point (x, z), m, at fractions of the bounding rectangle's sides; `None` outside of the region.
    pub(crate) fn point(&self, fractions: DVec2) -> Option<DVec2> {
        let p = self.bounding_rect.min + self.bounding_rect.size() * fractions;
        self.rects.iter().any(|rect| rect.contains(p)).then_some(p)
    }

    /// Area of the region, m^2, by a grid of points.
    fn area(&self) -> f64 {
        // The area of a single rectangle is known exactly.
        if self.rects.len() < 2 {
            return self.bounding_area();
        }
        let fraction = |k: u32| (f64::from(k) + 0.5) / f64::from(AREA_SAMPLES);
        let inside = |k: &u32| self.point(DVec2::new(fraction(k % AREA_SAMPLES), fraction(k / AREA_SAMPLES))).is_some();
        self.bounding_area() * (0..AREA_SAMPLES * AREA_SAMPLES).filter(inside).count() as f64
            / f64::from(AREA_SAMPLES * AREA_SAMPLES)
    }
}

/// Computes source regions by tracing drops through the wind, epoch by epoch.
#[derive(Debug)]
pub(crate) struct DriftTracer {
    bounds: Bounds,
    wind: Option<Arc<dyn Wind>>,
    g: f64,
    /// Diameters that are traced, ascending, m. A size class lies between two of them.
    diameters: Vec<f64>,
    /// Drifts of the traced diameters in the last two epochs that were requested, the newest first.
    recent: Vec<EpochDrifts>,
}

/// Drifts of the traced diameters, in their order, for drops that start at the beginning of an epoch.
#[derive(Debug)]
struct EpochDrifts {
    epoch: u64,
    drifts: Vec<DriftByHeight>,
}

impl DriftTracer {
    /// A tracer of drops between two diameters, m, that fall on `bounds`, m, under gravity `g`, m/s^2.
    pub(crate) fn new(bounds: Bounds, wind: Option<Arc<dyn Wind>>, [least, most]: [f64; 2], g: f64) -> Self {
        // Without wind, or with drops of one size, one size class suffices.
        let classes = if wind.is_none() || most - least < 1e-9 { 1 } else { TRACED_SIZES - 1 };
        // Drift is proportional to the time of the fall: space the sizes evenly in the inverse of their terminal speeds. A common
        // factor of the speeds does not matter, so the speeds on Earth are used.
        let slowness = |k: usize| {
            let [a, b] = [least, most].map(|d| terminal_speed_on_earth(d).recip());
            a + (b - a) * k as f64 / classes as f64
        };
        let mut diameters = vec![least];
        diameters.extend((1..classes).map(|k| diameter_of_speed(slowness(k).recip(), [least, most])));
        diameters.push(most);
        Self { bounds, wind, g, diameters, recent: Vec::new() }
    }

    /// The wind that drops are traced through; `None` in calm air.
    pub(crate) fn wind(&self) -> Option<&dyn Wind> {
        self.wind.as_deref()
    }

    /// Height of the level plane on which drops are emitted, m, slightly above the bounds.
    pub(crate) fn emission_plane_y(&self) -> f64 {
        f64::from(self.bounds.max.y) + EMISSION_CLEARANCE
    }

    /// Size class of diameter `d`, m: an index of [`DriftTracer::regions`].
    pub(crate) fn size_class(&self, d: f64) -> usize {
        self.diameters.partition_point(|size| *size <= d).clamp(1, self.diameters.len() - 1) - 1
    }

    /// Number of the epoch of time `t`, s; always 0 in a steady wind, which needs to be traced only once.
    pub(crate) fn epoch_index(&self, t: f64) -> u64 {
        let steady = self.wind.as_ref().is_none_or(|w| w.period().is_some_and(|p| p <= 0.0));
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "casts of floats saturate")]
        if steady { 0 } else { (t / EPOCH_DURATION).floor() as u64 }
    }

    /// The source regions of an epoch by size class.
    pub(crate) fn regions(&mut self, epoch: u64) -> Vec<SourceRegion> {
        // Enclose the drifts at the beginning and at the end of the epoch, and those of both diameters that bound a class.
        let footprint = self.bounds_from_above();
        let (a, b) = (self.epoch_drifts(epoch), self.epoch_drifts(epoch + 1));
        let over_epoch: Vec<DriftByHeight> =
            a.iter().zip(&b).map(|(a, b)| std::array::from_fn(|k| a[k].union(b[k]))).collect();
        let classes = over_epoch.windows(2);
        classes.map(|d| SourceRegion::new(&footprint, &std::array::from_fn(|k| d[0][k].union(d[1][k])))).collect()
    }

    /// Mean areas of the source regions by size class between two times, s, in m^2. `weight`: weight of a time, s.
    pub(crate) fn mean_areas(&mut self, [from, to]: [f64; 2], weight: impl Fn(f64) -> f64) -> Vec<f64> {
        // Midpoints of equal intervals.
        let (mut sum, mut areas) = (0.0, vec![0.0; self.diameters.len() - 1]);
        for k in 0..AREA_TIMES {
            let t = from + (to - from) * (f64::from(k) + 0.5) / f64::from(AREA_TIMES);
            // A small constant keeps the mean defined where the weight is 0 throughout.
            let w = weight(t) + 1e-9;
            let epoch = self.epoch_index(t);
            sum += w;
            areas.iter_mut().zip(self.regions(epoch)).for_each(|(area, region)| *area += w * region.area());
        }
        areas.iter().map(|area| area / sum).collect()
    }

    /// The rectangle that the bounds cover from above.
    fn bounds_from_above(&self) -> HorizontalRect {
        let level = |p: Vec3| DVec2::new(f64::from(p.x), f64::from(p.z));
        HorizontalRect { min: level(self.bounds.min), max: level(self.bounds.max) }
    }

    fn epoch_drifts(&mut self, epoch: u64) -> Vec<DriftByHeight> {
        if let Some(known) = self.recent.iter().find(|known| known.epoch == epoch) {
            return known.drifts.clone();
        }
        let t = epoch as f64 * EPOCH_DURATION;
        let drifts: Vec<DriftByHeight> = self.diameters.iter().map(|d| self.drift_by_height(*d, t)).collect();
        self.recent.insert(0, EpochDrifts { epoch, drifts: drifts.clone() });
        // Regions need two successive epochs.
        self.recent.truncate(2);
        drifts
    }

    /// Drift of drops of diameter `d`, m, that start at time `t`, s, and reach the corners and the center of the bounds at their
    /// top, middle and bottom.
    fn drift_by_height(&self, d: f64, t: f64) -> DriftByHeight {
        let footprint = self.bounds_from_above();
        if self.wind.is_none() {
            return [HorizontalRect { min: DVec2::ZERO, max: DVec2::ZERO }; HEIGHT_BANDS];
        }
        // The start of a drop that reaches a given point depends on its drift, which depends on the start. Two fixed-point
        // iterations: the first with a drop from above the center, the second with drops that reach the center.
        let center = footprint.center();
        let first = self.trace_drift(d, t, &[center]);
        let second =
            self.trace_drift(d, t, &[0, HEIGHT_BANDS / 2, HEIGHT_BANDS - 1].map(|k| start_to_reach(&first, k, center)));
        let [a, b] = [footprint.min, footprint.max];
        let targets = [a, b, DVec2::new(a.x, b.y), DVec2::new(b.x, a.y), center];
        let starts: Vec<DVec2> = [0, HEIGHT_BANDS / 2, HEIGHT_BANDS - 1]
            .iter()
            .flat_map(|k| targets.map(|p| start_to_reach(&second, *k, p)))
            .collect();
        self.trace_drift(d, t, &starts)
    }

    /// Drift of drops of diameter `d`, m, that start at points of the emission plane at time `t`, s.
    fn trace_drift(&self, d: f64, t: f64, starts: &[DVec2]) -> DriftByHeight {
        let mut drift = [HorizontalRect::EMPTY; HEIGHT_BANDS];
        // Bands extend beyond the bounds by the same margin as the regions.
        let (low, high) = (f64::from(self.bounds.min.y) - SOURCE_MARGIN, f64::from(self.bounds.max.y) + SOURCE_MARGIN);
        // The time step takes a drop in still air down in `TRACE_STEPS` steps; an updraft makes it take more.
        let h = (self.emission_plane_y() - low) / terminal_speed(d, self.g) / f64::from(TRACE_STEPS);
        let wind = self.wind.as_deref();
        let mut positions: Vec<DVec3> = starts.iter().map(|p| DVec3::new(p.x, self.emission_plane_y(), p.y)).collect();
        let mut velocities: Vec<DVec3> = Vec::new();
        for k in 0..MAX_TRACE_STEPS {
            let sampled: Vec<Vec3> = positions.iter().map(|p| p.as_vec3()).collect();
            let air = sample_wind(wind, &sampled, t + f64::from(k) * h);
            // Drops start at terminal speed in the moving air, as the emitter emits them.
            if velocities.is_empty() {
                velocities = air.iter().map(|a| a.as_dvec3() - DVec3::Y * terminal_speed(d, self.g)).collect();
            }
            for (i, (p, v)) in positions.iter_mut().zip(&mut velocities).enumerate() {
                let before = *p;
                *v = step_velocity(*v, sphere_volume(d), self.g, air[i].as_dvec3(), h);
                *p += *v * h;
                // Add the drifts at both ends of the step to all bands that it passes through.
                let band = |y: f64| ((high - y) / (high - low) * HEIGHT_BANDS as f64).floor();
                let (first, last) =
                    (band(before.y.max(p.y)).max(0.0), band(before.y.min(p.y)).min(HEIGHT_BANDS as f64 - 1.0));
                let drift_at = |p: DVec3| DVec2::new(p.x, p.z) - starts[i];
                #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped")]
                for rect in drift.iter_mut().take((last + 1.0).max(0.0) as usize).skip(first as usize) {
                    *rect = rect.including(drift_at(before)).including(drift_at(*p));
                }
            }
            if positions.iter().all(|p| p.y < low) {
                break;
            }
        }
        drift
    }
}

/// The point of the emission plane from which a drop reaches `target` in a height band, by a known drift. If no drop reaches that
/// band, the drift of the nearest band below is used, else of the nearest above.
fn start_to_reach(drift: &DriftByHeight, band: usize, target: DVec2) -> DVec2 {
    let known = drift[band..].iter().chain(drift[..band].iter().rev()).find(|d| !d.is_empty());
    target - known.map_or(DVec2::ZERO, HorizontalRect::center)
}

/// The diameter, m, between two at which drops fall with terminal speed `speed` on Earth, m/s, by bisection.
fn diameter_of_speed(speed: f64, [mut low, mut high]: [f64; 2]) -> f64 {
    for _ in 0..50 {
        let middle = 0.5 * (low + high);
        *(if terminal_speed_on_earth(middle) < speed { &mut low } else { &mut high }) = middle;
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
        let mut tracer = DriftTracer::new(tree(), None, [5e-4, 6e-3], 9.81);
        let regions = tracer.regions(0);
        assert_eq!(regions.len(), 1);
        assert!((regions[0].area() - 4.1 * 4.1).abs() < 1e-9 && (tracer.emission_plane_y() - 9.5).abs() < 1e-9);
    }

    #[test]
    fn steady_wind_shifts_each_size_by_its_own_drift() {
        let mut tracer = DriftTracer::new(tree(), Some(Arc::new(UniformWind(Vec3::X * 5.0))), [5e-4, 6e-3], 9.81);
        for d in [5e-4, 1e-3, 3e-3, 5.9e-3] {
            let regions = tracer.regions(0);
            let source = &regions[tracer.size_class(d)];
            let vt = terminal_speed(d, 9.81);
            // Seen from the middle of the region at its top and bottom.
            for (fall, z) in [(0.5, 1.9), (4.5, 0.0), (8.5, -1.9)] {
                let from = DVec2::new(-5.0 * fall / vt, z);
                assert!(source.rects.iter().any(|p| p.contains(from)), "{d} {fall}");
            }
            assert!(!source.bounding_rect.contains(DVec2::new(3.0, 0.0)));
            let needed = 4.0 * (4.0 + 5.0 * 8.0 / vt);
            assert!(source.area() < 1.6 * needed && source.area() > needed, "{d}: {} of {needed}", source.area());
        }
    }

    /// Emits drops uniformly from a larger area; nearly all of those that cross the bounds start in a source region.
    #[test]
    fn source_regions_cover_what_crosses_the_bounds_in_gusts() {
        let gust = GustWind::new(GustWindOptions { speed: 8.0, seed: 3, ..GustWindOptions::default() });
        for over in [tree(), Bounds { min: Vec3::new(-0.1, 0.3, -0.1), max: Vec3::new(0.1, 0.6, 0.1) }] {
            let mut tracer = DriftTracer::new(over, Some(Arc::new(gust.clone())), [5e-4, 6e-3], 9.81);
            let (mut crossed, mut covered) = (0, 0);
            for k in 0..40_u32 {
                let t = 0.33 * f64::from(k);
                let epoch = tracer.epoch_index(t);
                let regions = tracer.regions(epoch);
                let d = [5e-4, 8e-4, 1.5e-3, 4e-3][k as usize % 4];
                let source = &regions[tracer.size_class(d)];
                let side = over.size().as_dvec3();
                let wide = 2.5 * source.bounding_rect.size();
                for i in 0..900_u32 {
                    let share = DVec2::new(f64::from(i % 30), f64::from(i / 30)) / 29.0 - 0.5;
                    let from = source.bounding_rect.center() + wide * share;
                    if crosses(&tracer, d, t, from, side.y) {
                        crossed += 1;
                        covered += u32::from(source.rects.iter().any(|p| p.contains(from)));
                    }
                }
            }
            assert!(crossed > 500 && f64::from(covered) > 0.98 * f64::from(crossed), "{covered} of {crossed}");
        }
    }

    fn crosses(tracer: &DriftTracer, d: f64, t: f64, from: DVec2, height: f64) -> bool {
        let h = (height / terminal_speed(d, 9.81) / 30.0).min(0.01);
        let mut p = DVec3::new(from.x, tracer.emission_plane_y(), from.y);
        let air = |p: DVec3, t: f64| sample_wind(tracer.wind(), &[p.as_vec3()], t)[0].as_dvec3();
        let mut v = air(p, t) - DVec3::Y * terminal_speed(d, 9.81);
        let (min, max) = (tracer.bounds.min.as_dvec3(), tracer.bounds.max.as_dvec3());
        let mut k = 0.0;
        while p.y > min.y {
            if p.cmpge(min).all() && p.cmple(max).all() {
                return true;
            }
            v = step_velocity(v, sphere_volume(d), 9.81, air(p, t + k * h), h);
            p += v * h;
            k += 1.0;
        }
        false
    }
}
