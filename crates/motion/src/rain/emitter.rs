//! Emission of raindrops: how many, of what sizes, and from where.

use std::collections::VecDeque;
use std::sync::Arc;

use glam::{DVec2, DVec3, Vec3};

use crate::rain::fall::{EmittedDrop, sample_wind, sphere_volume, terminal_speed, terminal_speed_on_earth};
use crate::rain::shelter::Shelter;
use crate::rain::source_region::{DriftTracer, SourceRegion};
use crate::rain::tuning::{
    DIAMETER_RANGE_MM, DIAMETER_STEPS_PER_ENTRY, DIAMETER_TABLE_SIZE, EMISSION_SLICE, ENVELOPE_SAMPLES, GUST_PERIOD,
    POISSON_CHUNK_MEAN,
};
use osier_base::geometry::Bounds;
use osier_base::keyframes::interpolate;
use osier_base::math;
use osier_base::noise::gradient1;
use osier_base::rng::Rng;
use osier_wind::Wind;

/// Diameters of raindrops: a distribution over the drops that cross a level area, or one diameter.
#[derive(Debug, Clone, PartialEq)]
pub enum DropSizes {
    /// Exponential, with a slope that depends on the rainfall rate. Source: Marshall and Palmer 1948.
    MarshallPalmer,
    /// All drops have this diameter, m.
    Fixed(f64),
    /// Log-normal distribution of the drops that cross a level area.
    LogNormal {
        /// Median diameter, m.
        median: f64,
        /// Standard deviation of the diameter's natural logarithm.
        sigma: f64,
    },
}

/// Course of the rainfall over a clip, as a factor on its rate.
#[derive(Debug, Clone, PartialEq)]
pub enum IntensityEnvelope {
    /// The factor 1 at all times.
    Constant,
    /// A normal density with the value 1 at its center. Source: [yang-wu] section 3.
    Bell {
        /// Time of the maximum, s.
        center: f64,
        /// Standard deviation, s.
        width: f64,
    },
    /// Keyframes of time, s, and factor, linearly interpolated.
    Keys(Vec<[f64; 2]>),
}

/// How much rain falls over a clip, when, and in drops of what sizes.
#[derive(Debug, Clone)]
pub struct RainfallParams {
    /// Seed of the random draws of counts, sizes and positions.
    pub seed: u64,
    /// Rainfall rate, m/s (10 mm/h are 2.8e-6).
    pub intensity: f64,
    /// Distribution of the diameters of drops; Marshall and Palmer's depends on `intensity`.
    pub size: DropSizes,
    /// Expected number of drops of the clip, the spin-up left out; replaces `intensity` as the measure of how much rain falls.
    pub total: Option<f64>,
    /// Factor on the rate over the time of the clip; with `total` only its course counts.
    pub envelope: IntensityEnvelope,
    /// Relative amplitude of random fluctuations of the rate, 0 to 1.
    pub jitter: f64,
    /// Duration of spin-up and clip, s.
    pub duration: f64,
    /// Duration of the spin-up, s.
    pub spin_up: f64,
    /// Gravity along -Y, m/s^2.
    pub g: f64,
}

/// Source of raindrops on a level plane above a scene, which emits the drops that can reach the bounds of the scene.
#[derive(Debug)]
pub struct RainEmitter {
    params: RainfallParams,
    tracer: DriftTracer,
    /// Diameters of equal probability, m, ascending.
    diameters: Vec<f64>,
    /// Size class of each diameter, an index of the tracer's source regions.
    classes: Vec<usize>,
    /// Number flux at factor 1 of the envelope, 1/(m^2 s).
    flux: f64,
    /// Mean of the envelope's factor over the clip.
    mean_factor: f64,
    /// Mean volume of a drop, m^3.
    mean_volume: f64,
    /// Mean area of the source regions over diameters and the clip, m^2.
    area: f64,
    /// Mean over emitted drops of the time that a drop takes to fall by a metre at its terminal speed, s/m.
    time_per_metre: f64,
    /// Solids and ground that keep rain from parts of the emission plane; `None` if there are none.
    shelter: Option<Shelter>,
    /// The epoch of the last slice; none before the first.
    epoch: Option<WindEpoch>,
    /// Number of the next time slice to be drawn, and the drops of earlier slices that are not yet emitted, in the
    /// order of times.
    next_slice: u64,
    pending: VecDeque<EmittedDrop>,
}

/// Source regions during one epoch, an interval of time in which the wind counts as unchanged.
#[derive(Debug)]
struct WindEpoch {
    number: u64,
    /// Source region of each size class.
    regions: Vec<SourceRegion>,
    /// Cumulative areas of the regions' bounding rectangles over the table of diameters, m^2.
    cumulative_areas: Vec<f64>,
}

struct DiameterSample {
    class: usize,
    /// Diameter of the drop, m.
    d: f64,
}

impl RainEmitter {
    /// Rain that falls on everything within `bounds`, m, through a wind.
    pub fn new(params: RainfallParams, bounds: Bounds, wind: Option<Arc<dyn Wind>>) -> Self {
        let diameters = diameters_of_equal_probability(&params);
        let mean_volume = diameters.iter().map(|d| sphere_volume(*d)).sum::<f64>() / diameters.len().max(1) as f64;
        let end = |d: Option<&f64>| d.copied().unwrap_or(1e-3);
        let mut tracer = DriftTracer::new(bounds, wind, [end(diameters.first()), end(diameters.last())], params.g);
        let classes: Vec<usize> = diameters.iter().map(|d| tracer.size_class(*d)).collect();
        // The area that an average drop of the clip is emitted from: needed for `total`, for estimates and statistics. The area
        // during the spin-up may differ, if the wind changes.
        let areas = tracer.mean_areas([params.spin_up, params.duration], |t| intensity_factor(&params, t));
        let area_of = |class: &usize| areas.get(*class).copied().unwrap_or(0.0);
        let area = classes.iter().map(area_of).sum::<f64>() / classes.len().max(1) as f64;
        // The number of drops of a diameter is proportional to the area of its source region.
        let time_of = |(d, class): (&f64, &usize)| area_of(class) / terminal_speed(*d, params.g);
        let times = diameters.iter().zip(&classes).map(time_of).sum::<f64>();
        let time_per_metre = times / classes.iter().map(area_of).sum::<f64>().max(f64::MIN_POSITIVE);
        // Number flux from the rainfall rate: volume per area and time, divided by the mean volume of a drop.
        let integral = envelope_integral_of_clip(&params);
        let flux = match params.total {
            // An envelope that is 0 throughout the clip has no drops.
            Some(_) if integral <= 0.0 => 0.0,
            Some(total) => total / (area * integral).max(f64::MIN_POSITIVE),
            None => params.intensity / mean_volume,
        };
        let mean_factor = integral / (params.duration - params.spin_up);
        Self {
            params,
            tracer,
            diameters,
            classes,
            flux,
            mean_factor,
            mean_volume,
            area,
            time_per_metre,
            shelter: None,
            epoch: None,
            next_slice: 0,
            pending: VecDeque::new(),
        }
    }

    /// This emitter without the drops that solids or ground keep from reaching the emission plane.
    #[must_use]
    pub(crate) fn with_shelter(self, shelter: Shelter) -> Self {
        Self { shelter: Some(shelter), ..self }
    }

    /// Number flux at factor 1 of the envelope, drops per m^2 and s.
    pub fn drop_flux(&self) -> f64 {
        self.flux
    }

    /// Rainfall rate at factor 1 of the envelope, m/s: that of the parameters, or the rate that results from a total number of drops.
    pub fn rate(&self) -> f64 {
        self.flux * self.mean_volume
    }

    /// Mean area of the source regions over diameters and the clip, m^2.
    pub fn mean_area(&self) -> f64 {
        self.area
    }

    /// Mean over emitted drops of the time, s, that a drop takes to fall to the height `foot`, m, at its terminal speed.
    pub fn mean_fall_time(&self, foot: f64) -> f64 {
        (self.tracer.emission_plane_y() - foot).max(0.0) * self.time_per_metre
    }

    /// Mean of the envelope's factor over the clip.
    pub fn mean_factor(&self) -> f64 {
        self.mean_factor
    }

    /// Mean number of drops per second over the clip.
    pub fn mean_drop_rate(&self) -> f64 {
        self.flux * self.area * self.mean_factor
    }

    /// Emits the drops of all times before `end`, s, that were not emitted before, in the order of their times. They do not depend on
    /// the times at which this is called: counts, sizes and positions are drawn for slices of time of fixed length.
    pub fn emit_until(&mut self, end: f64) -> Vec<EmittedDrop> {
        while self.next_slice as f64 * EMISSION_SLICE < end {
            let drops = self.draw_slice(self.next_slice);
            self.pending.extend(drops);
            self.next_slice += 1;
        }
        let count = self.pending.partition_point(|drop| drop.t < end);
        self.pending.drain(..count).collect()
    }

    /// Draws the drops of the time slice `number`, in the order of their times.
    fn draw_slice(&mut self, number: u64) -> Vec<EmittedDrop> {
        let (start, middle) = (number as f64 * EMISSION_SLICE, (number as f64 + 0.5) * EMISSION_SLICE);
        let mut draw = Rng::at(self.params.seed, &["rain".into(), 0_u64.into(), number.into()]);
        let key = Rng::key(self.params.seed, &["rain".into(), "gusts".into()]);
        let fluctuation =
            1.0 + self.params.jitter * f64::from(gradient1(key, math::narrow(middle / GUST_PERIOD), 1 << 20));
        let epoch = self.take_or_trace_epoch(middle);
        // The count is Poisson distributed. Its mean covers the bounding rectangles of the source regions, averaged over diameters;
        // candidates outside of a region are rejected below.
        let mean_area = epoch.cumulative_areas.last().copied().unwrap_or(0.0) / self.diameters.len().max(1) as f64;
        let rate = self.flux * mean_area * intensity_factor(&self.params, middle) * fluctuation.max(0.0);
        let count = sample_poisson(rate * EMISSION_SLICE, &mut draw);
        let mut drops: Vec<EmittedDrop> = Vec::new();
        for _ in 0..count {
            let offset = draw.range(0.0, EMISSION_SLICE);
            let DiameterSample { class, d } = self.sample_diameter(&epoch.cumulative_areas, draw.unit_f64());
            let fractions = DVec2::new(draw.unit_f64(), draw.unit_f64());
            // Rejection sampling: a drop from outside of the region of its size would miss the bounds.
            let Some(p) = epoch.regions.get(class).and_then(|region| region.point(fractions)) else { continue };
            let p = DVec3::new(p.x, self.tracer.emission_plane_y(), p.y);
            let v = -DVec3::Y * terminal_speed(d, self.params.g);
            drops.push(EmittedDrop { t: start + offset, p, v, volume: sphere_volume(d) });
        }
        self.epoch = Some(epoch);
        if let Some(shelter) = &self.shelter {
            shelter.retain_unsheltered(&mut drops, self.tracer.wind(), middle);
        }
        // Drops start with the velocity of the air around them.
        let positions: Vec<Vec3> = drops.iter().map(|b| b.p.as_vec3()).collect();
        let winds = sample_wind(self.tracer.wind(), &positions, middle);
        drops.iter_mut().zip(winds).for_each(|(b, wind)| b.v += wind.as_dvec3());
        drops.sort_by(|a, b| a.t.total_cmp(&b.t));
        drops
    }

    /// The epoch at time `t`, s: that of the last slice if it still lasts.
    fn take_or_trace_epoch(&mut self, t: f64) -> WindEpoch {
        let number = self.tracer.epoch_index(t);
        if let Some(epoch) = self.epoch.take().filter(|epoch| epoch.number == number) {
            return epoch;
        }
        let regions = self.tracer.regions(number);
        let areas: Vec<f64> = regions.iter().map(SourceRegion::bounding_area).collect();
        // Each entry of the table of diameters is as probable as the others per area: weight it with the area of its class.
        let mut sum = 0.0;
        let add = |class: &usize| {
            sum += areas.get(*class).copied().unwrap_or(0.0);
            sum
        };
        let cumulative_areas = self.classes.iter().map(add).collect();
        WindEpoch { number, regions, cumulative_areas }
    }

    /// The diameter at cumulative probability `u`, 0 to 1. The flux per area is the same for all sizes, so the probability of a size is
    /// proportional to the area that it is emitted from.
    fn sample_diameter(&self, cumulative_areas: &[f64], u: f64) -> DiameterSample {
        // Invert the cumulative distribution, then interpolate towards the neighbouring entry on the side of `u`
        // from the entry's middle.
        let last = self.diameters.len().saturating_sub(1);
        let target = u * cumulative_areas.last().copied().unwrap_or(0.0);
        let k = cumulative_areas.partition_point(|s| *s <= target).min(last);
        let below = if k > 0 { cumulative_areas[k - 1] } else { 0.0 };
        let x = (target - below) / (cumulative_areas[k] - below).max(f64::MIN_POSITIVE) - 0.5;
        let neighbour = if x < 0.0 { k.saturating_sub(1) } else { (k + 1).min(last) };
        let d = self.diameters[k] + (self.diameters[neighbour] - self.diameters[k]) * x.abs().min(0.5);
        DiameterSample { class: self.classes[k], d }
    }
}

/// Integral of the envelope over the clip, s, by the midpoint rule.
fn envelope_integral_of_clip(params: &RainfallParams) -> f64 {
    let h = (params.duration - params.spin_up) / f64::from(ENVELOPE_SAMPLES);
    (0..ENVELOPE_SAMPLES).map(|k| intensity_factor(params, params.spin_up + (f64::from(k) + 0.5) * h) * h).sum()
}

/// Factor of the envelope on the rainfall rate at time `t` of the clip, s.
fn intensity_factor(params: &RainfallParams, t: f64) -> f64 {
    match &params.envelope {
        IntensityEnvelope::Constant => 1.0,
        IntensityEnvelope::Bell { center, width } => {
            let k = (t - center) / width;
            math::exp(-0.5 * k * k)
        }
        IntensityEnvelope::Keys(keys) => interpolate(keys, t).unwrap_or(1.0),
    }
}

/// A point of the cumulative distribution of diameters, from which quantiles are interpolated.
#[derive(Debug, Clone, Copy)]
struct CumulativePoint {
    /// Integral of the density up to `mm`; not normalized.
    sum: f64,
    /// Upper end of the integral: a diameter, mm.
    mm: f64,
}

/// The table of [`DIAMETER_TABLE_SIZE`] diameters, m, at the middles of intervals of equal probability. Probabilities are those
/// among the drops that cross a level area, not among the drops in a volume of air.
pub(crate) fn diameters_of_equal_probability(params: &RainfallParams) -> Vec<f64> {
    let n = DIAMETER_TABLE_SIZE as f64;
    let [least, most] = DIAMETER_RANGE_MM;
    // Densities over the diameter in mm; constant factors cancel.
    let density: Box<dyn Fn(f64) -> f64> = match params.size {
        DropSizes::Fixed(d) => return vec![d],
        DropSizes::LogNormal { median, sigma } => Box::new(move |mm: f64| {
            let k = math::ln(mm * 1e-3 / median) / sigma;
            math::exp(-0.5 * k * k) / mm
        }),
        DropSizes::MarshallPalmer => {
            // Drops in a volume of air follow exp(-slope d), slope = 4.1 R^-0.21 per mm with R in mm/h; the flux through an area
            // weights them by their speed. A constant factor of the speed would cancel, so the speed on Earth serves any gravity.
            let slope = 4.1 * math::pow((params.intensity * 3.6e6).max(0.01), -0.21);
            Box::new(move |mm: f64| math::exp(-slope * mm) * terminal_speed_on_earth(mm * 1e-3))
        }
    };
    // Integrate the density by the midpoint rule.
    let mut sum = 0.0;
    let mut cumulative = vec![CumulativePoint { sum, mm: least }];
    let steps = DIAMETER_STEPS_PER_ENTRY * DIAMETER_TABLE_SIZE;
    let step = (most - least) / steps as f64;
    for k in 0..steps {
        let mm = least + (k as f64 + 0.5) * step;
        sum += density(mm) * step;
        cumulative.push(CumulativePoint { sum, mm: mm + 0.5 * step });
    }
    // Invert it by linear interpolation.
    let quantile = |u: f64| {
        let target = u * sum;
        let k = cumulative.partition_point(|s| s.sum < target).clamp(1, cumulative.len() - 1);
        let (a, b) = (cumulative[k - 1], cumulative[k]);
        (a.mm + (b.mm - a.mm) * (target - a.sum) / (b.sum - a.sum).max(f64::MIN_POSITIVE)) * 1e-3
    };
    (0..DIAMETER_TABLE_SIZE).map(|k| quantile((k as f64 + 0.5) / n)).collect()
}

/// A Poisson-distributed count with the given mean. Source: Knuth's multiplication of uniform draws.
pub(crate) fn sample_poisson(mean: f64, draw: &mut Rng) -> u32 {
    // A sum of Poisson counts is Poisson distributed: large means are drawn in chunks, as exp(-mean) would underflow.
    let (mut left, mut count) = (mean.max(0.0), 0);
    while left > 0.0 {
        let chunk = left.min(POISSON_CHUNK_MEAN);
        left -= chunk;
        let limit = math::exp(-chunk);
        let mut product = draw.unit_f64();
        while product > limit {
            count += 1;
            product *= draw.unit_f64();
        }
    }
    count
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rain::fall::sphere_diameter;

    fn rainfall() -> RainfallParams {
        RainfallParams {
            seed: 5,
            intensity: 10.0 / 3.6e6,
            size: DropSizes::MarshallPalmer,
            total: None,
            envelope: IntensityEnvelope::Constant,
            jitter: 0.0,
            duration: 10.0,
            spin_up: 0.0,
            g: 9.81,
        }
    }

    fn bounds() -> Bounds {
        Bounds { min: Vec3::ZERO, max: Vec3::new(0.9, 1.0, 0.9) }
    }

    #[test]
    fn ten_millimetres_an_hour_are_ten_millimetres_an_hour() {
        let mut emitter = RainEmitter::new(rainfall(), bounds(), None);
        assert!((2300.0..3100.0).contains(&emitter.drop_flux()), "{}", emitter.drop_flux());
        let (mut water, mut counts, h) = (0.0, Vec::new(), 0.005);
        for k in 0..8000_u64 {
            let emitted = emitter.emit_until((k + 1) as f64 * h);
            water += emitted.iter().map(|b| b.volume).sum::<f64>();
            counts.push(emitted.len());
        }
        assert!(counts.iter().sum::<usize>() > 100_000);
        let area = 1.0;
        assert!((water / (area * 8000.0 * h) / rainfall().intensity - 1.0).abs() < 0.03);
        let (mean, n) = (emitter.mean_drop_rate() * h, counts.len() as f64);
        // The variance of the counts is that of a Poisson distribution.
        let scatter: f64 = counts.iter().map(|c| (*c as f64 - mean) * (*c as f64 - mean) / mean).sum();
        assert!(sigmas(scatter, n).abs() < 3.29, "{scatter}");
        // The frequency of each count is that of the distribution, by a chi-square test; both tests at p = 0.001.
        let (mut share, mut left, mut found) = (math::exp(-mean), 1.0, 0.0);
        let (mut bins, mut bin) = (Vec::new(), (0.0, 0.0));
        for k in 0..40 {
            bin = (bin.0 + n * share, bin.1 + counts.iter().filter(|c| **c == k).count() as f64);
            (left, share) = (left - share, share * mean / (k + 1) as f64);
            if bin.0 >= 5.0 && n * left >= 5.0 {
                found += bin.1;
                bins.push(std::mem::take(&mut bin));
            }
        }
        bins.push((n - bins.iter().map(|b| b.0).sum::<f64>(), n - found));
        let chi: f64 = bins.iter().map(|(meant, seen)| (seen - meant) * (seen - meant) / meant).sum();
        assert!(bins.len() > 15 && sigmas(chi, bins.len() as f64 - 1.0) < 3.09, "{chi} of {}", bins.len());
    }

    /// Deviation of a chi square with these degrees of freedom, in standard deviations. Source: Wilson and Hilferty 1931.
    fn sigmas(chi: f64, degrees: f64) -> f64 {
        let spread = 2.0 / (9.0 * degrees);
        (math::cbrt(chi / degrees) - (1.0 - spread)) / spread.sqrt()
    }

    #[test]
    fn sizes_are_marshall_and_palmers() {
        let mut emitter = RainEmitter::new(rainfall(), bounds(), None);
        let mut found: Vec<f64> = Vec::new();
        let mut k = 0_u64;
        while found.len() < 20_000 {
            found.extend(emitter.emit_until((k + 1) as f64 * 0.01).iter().map(|b| sphere_diameter(b.volume) * 1e3));
            k += 1;
        }
        found.sort_by(f64::total_cmp);
        let slope = 4.1 * math::pow(10.0, -0.21);
        let density = |mm: f64| math::exp(-slope * mm) * terminal_speed_on_earth(mm * 1e-3);
        let (n, step) = (20_000, 5.5 / 20_000.0);
        let at = |k: usize| 0.5 + (k as f64 + 0.5) * step;
        let whole: f64 = (0..n).map(|k| density(at(k))).sum();
        let (mut sum, mut seen, mut worst) = (0.0, 0, 0.0_f64);
        for k in 0..n {
            sum += density(at(k)) / whole;
            while seen < found.len() && found[seen] <= at(k) + 0.5 * step {
                seen += 1;
            }
            worst = worst.max((sum - seen as f64 / found.len() as f64).abs());
        }
        // Kolmogorov-Smirnov test at p = 0.001.
        assert!(worst < 1.95 / (found.len() as f64).sqrt(), "{worst}");
    }

    #[test]
    fn the_same_drops_fall_at_any_time_step() {
        let drops = |h: f64| {
            let wind = osier_wind::GustWind::new(osier_wind::GustWindOptions::default());
            let rain = RainfallParams { jitter: 0.3, ..rainfall() };
            let mut emitter = RainEmitter::new(rain, bounds(), Some(Arc::new(wind)));
            let (mut t, mut all) = (0.0, Vec::new());
            while t < 1.0 {
                let emitted = emitter.emit_until(t + h);
                assert!(emitted.iter().all(|drop| (t..t + h).contains(&drop.t)));
                all.extend(emitted);
                t += h;
            }
            all.retain(|drop| drop.t < 1.0);
            all
        };
        let first = drops(1.0 / 192.0);
        assert!(first.len() > 1000);
        for h in [1.0 / 12.0, 1.0 / 24.0, 1.0 / 1000.0] {
            assert!(drops(h) == first, "{h}");
        }
    }

    #[test]
    fn a_clip_has_the_total_number_of_drops() {
        let bell = IntensityEnvelope::Bell { center: 5.0, width: 2.5 };
        let fall = RainfallParams { total: Some(2000.0), envelope: bell, jitter: 0.2, ..rainfall() };
        let mut emitter = RainEmitter::new(fall, bounds(), Some(Arc::new(osier_wind::UniformWind(Vec3::X))));
        let count = emitter.emit_until(10.0).len();
        assert!((count as f64 - 2000.0).abs() < 5.0 * 2000.0_f64.sqrt() + 60.0, "{count}");
        // Four seconds of spin-up fall in addition to the drops of the clip's six.
        let fall = RainfallParams { total: Some(2000.0), spin_up: 4.0, ..rainfall() };
        let mut emitter = RainEmitter::new(fall, bounds(), None);
        drop(emitter.emit_until(4.0));
        let count = emitter.emit_until(10.0).len();
        assert!((count as f64 - 2000.0).abs() < 5.0 * 2000.0_f64.sqrt(), "{count}");
    }

    /// A storm of 12 m/s that ends after 8 s.
    #[derive(Debug)]
    struct ShortStorm;

    impl Wind for ShortStorm {
        fn sample(&self, _: &[Vec3], t: f64, out: &mut [Vec3]) {
            out.fill(if t < 8.0 { Vec3::X * 12.0 } else { Vec3::ZERO });
        }
        fn mean(&self) -> Vec3 {
            Vec3::ZERO
        }
        fn mean_at(&self, _: Vec3) -> Vec3 {
            Vec3::ZERO
        }
        fn period(&self) -> Option<f64> {
            None
        }
    }

    #[test]
    fn the_wind_of_the_spin_up_does_not_change_the_total_number_of_the_clip() {
        let fall = RainfallParams { total: Some(2000.0), spin_up: 8.0, ..rainfall() };
        let mut emitter = RainEmitter::new(fall, bounds(), Some(Arc::new(ShortStorm)));
        drop(emitter.emit_until(8.0));
        let count = emitter.emit_until(10.0).len();
        assert!((count as f64 - 2000.0).abs() < 5.0 * 2000.0_f64.sqrt(), "{count}");
    }

    /// Drops of one size need one time; natural rain has smaller drops, which take longer, and larger ones.
    #[test]
    fn drops_fall_in_the_mean_time_of_their_sizes() {
        let time = |size: DropSizes, g: f64| {
            let emitter = RainEmitter::new(RainfallParams { size, g, ..rainfall() }, bounds(), None);
            emitter.mean_fall_time(emitter.tracer.emission_plane_y() - 1.0)
        };
        let large = time(DropSizes::Fixed(4e-3), 9.81);
        assert!((large * terminal_speed(4e-3, 9.81) - 1.0).abs() < 1e-12, "{large}");
        assert!((time(DropSizes::Fixed(4e-3), 9.81 / 4.0) / large - 2.0).abs() < 1e-9);
        let natural = time(DropSizes::MarshallPalmer, 9.81);
        assert!((1.5 * large..0.5).contains(&natural), "{natural}");
    }

    /// The rate of a total number of drops is that of the water which falls: 40,000 drops of 2 mm on 1 m^2 in 10 s.
    #[test]
    fn a_total_number_of_drops_has_a_rate() {
        let plain = RainEmitter::new(rainfall(), bounds(), None);
        assert!((plain.rate() / rainfall().intensity - 1.0).abs() < 1e-12);
        let size = DropSizes::Fixed(2e-3);
        let mut emitter =
            RainEmitter::new(RainfallParams { total: Some(40_000.0), size, ..rainfall() }, bounds(), None);
        let expected = 40_000.0 * sphere_volume(2e-3) / (emitter.mean_area() * 10.0);
        assert!((emitter.rate() / expected - 1.0).abs() < 1e-9, "{} {expected}", emitter.rate());
        assert!(emitter.rate() > 2.0 * rainfall().intensity);
        let water: f64 = emitter.emit_until(10.0).iter().map(|drop| drop.volume).sum();
        assert!((water / (emitter.mean_area() * 10.0) / emitter.rate() - 1.0).abs() < 0.03);
    }

    /// The mean over the clip is the same whatever the envelope, also where it begins late; without rain in the clip it is 0.
    #[test]
    fn a_total_number_of_drops_has_one_mean_rate() {
        let emitter = |keys: Vec<[f64; 2]>| {
            let envelope = IntensityEnvelope::Keys(keys);
            RainEmitter::new(RainfallParams { total: Some(2000.0), envelope, ..rainfall() }, bounds(), None)
        };
        for keys in
            [vec![[0.0, 1.0]], vec![[0.0, 0.0], [1.0, 0.0], [2.0, 1.0], [5.0, 0.0]], vec![[0.0, 3.0], [4.0, 0.0]]]
        {
            let mut emitter = emitter(keys);
            assert!((emitter.mean_drop_rate() - 200.0).abs() < 1e-6, "{}", emitter.mean_drop_rate());
            let count = emitter.emit_until(10.0).len();
            assert!((count as f64 - 2000.0).abs() < 5.0 * 2000.0_f64.sqrt(), "{count}");
        }
        let mut dry = emitter(vec![[0.0, 0.0], [9.0, 0.0]]);
        assert!(dry.mean_drop_rate() <= 0.0 && dry.emit_until(10.0).is_empty());
    }
}
