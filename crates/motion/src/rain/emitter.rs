//! Drops as the sky lets them go: how many, how large, from where; and how they fall.

use std::f64::consts::PI;
use std::sync::Arc;

use glam::{DVec2, DVec3, Vec3};

use crate::rain::source_region::{SourceRegion, SourceTracer};
use osier_base::geometry::Bounds;
use osier_base::keyframes::interpolate;
use osier_base::math;
use osier_base::noise::gradient1;
use osier_base::rng::Rng;
use osier_wind::Wind;

/// Smallest and largest raindrop, mm.
const SIZES: [f64; 2] = [0.5, 6.0];
/// Pieces of the table of sizes.
const TABLE: usize = 1024;
/// Mean of the largest draw by multiplication.
const CHUNK: f64 = 30.0;
/// Period of gusts of rain, s.
const PERIOD: f64 = 0.5;

/// Velocity at which a raindrop of a diameter, m, falls in still air, m/s. Source: Atlas et al. 1973.
pub fn terminal_speed(d: f64) -> f64 {
    (9.65 - 10.3 * math::exp(-600.0 * d)).max(0.3)
}

/// Volume of a ball of a diameter.
pub fn sphere_volume(d: f64) -> f64 {
    PI / 6.0 * d * d * d
}

/// Diameter of a ball of a volume.
pub fn sphere_diameter(volume: f64) -> f64 {
    math::cbrt(volume * 6.0 / PI)
}

/// How large drops are.
#[derive(Debug, Clone, PartialEq)]
pub enum DropSizes {
    /// As in rain of its strength. Source: Marshall and Palmer 1948.
    Natural,
    /// All alike, m.
    Fixed(f64),
    /// Around a median, m, by a factor with this logarithm.
    LogNormal(f64, f64),
}

/// How rain's strength changes over a clip.
#[derive(Debug, Clone, PartialEq)]
pub enum IntensityEnvelope {
    /// Always the same.
    Constant,
    /// A bell around a time, s, with a width, s. Source: [yang-wu] section 3.
    Bell(f64, f64),
    /// Seconds and factors, linear between.
    Keys(Vec<[f64; 2]>),
}

/// Rain.
#[derive(Debug, Clone)]
pub struct RainfallParams {
    /// Seed of its draws.
    pub seed: u64,
    /// Water over time, m/s (10 mm/h are 2.8e-6).
    pub intensity: f64,
    /// How large drops are.
    pub size: DropSizes,
    /// Drops that a clip of `duration` seconds has in all, instead of `strength`.
    pub total: Option<f64>,
    /// How strength changes.
    pub envelope: IntensityEnvelope,
    /// How much it changes by chance, 0 to 1.
    pub jitter: f64,
    /// s.
    pub duration: f64,
    /// m/s^2.
    pub g: f64,
}

/// Rain over a place.
#[derive(Debug)]
pub struct RainEmitter {
    fall: RainfallParams,
    reach: SourceTracer,
    /// Diameters of equal chance, m, each with the class of sizes that it belongs to.
    sizes: Vec<f64>,
    classes: Vec<usize>,
    /// Drops per m^2 and s.
    flux: f64,
    /// Area that rain starts from, in the mean over sizes and the clip, m^2.
    area: f64,
    /// Where drops of each class start now, the number of the epoch, and the rectangles of all sizes so far, m^2.
    now: Option<EmissionEpoch>,
}

#[derive(Debug)]
struct EmissionEpoch {
    epoch: u64,
    sources: Vec<SourceRegion>,
    sums: Vec<f64>,
}

/// A drop that is let go.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EmittedDrop {
    /// When, s.
    pub t: f64,
    /// Where, m.
    pub p: DVec3,
    /// m/s.
    pub v: DVec3,
    /// m^3.
    pub volume: f64,
}

impl RainEmitter {
    /// Rain that falls on everything in a box, m, through a wind.
    pub fn new(fall: RainfallParams, over: Bounds, wind: Option<Arc<dyn Wind>>) -> Self {
        let sizes = diameters_of_equal_chance(&fall);
        let mean = sizes.iter().map(|d| sphere_volume(*d)).sum::<f64>() / sizes.len().max(1) as f64;
        let end = |d: Option<&f64>| d.copied().unwrap_or(1e-3);
        let reach = SourceTracer::new(over, wind, [end(sizes.first()), end(sizes.last())], fall.g);
        let classes: Vec<usize> = sizes.iter().map(|d| reach.class(*d)).collect();
        let mut shower = Self { reach, classes, sizes, flux: 1.0, area: 0.0, now: None, fall };
        let fall = &shower.fall;
        let areas = shower.reach.areas(fall.duration, |t| envelope_factor(fall, t));
        let of = |class: &usize| areas.get(*class).copied().unwrap_or(0.0);
        shower.area = shower.classes.iter().map(of).sum::<f64>() / shower.classes.len().max(1) as f64;
        shower.flux = match shower.fall.total {
            Some(total) => total / (shower.area * shower.envelope_integral()).max(f64::MIN_POSITIVE),
            None => shower.fall.intensity / mean,
        };
        shower
    }

    /// Drops per m^2 and s at full strength.
    pub fn flux(&self) -> f64 {
        self.flux
    }

    /// Area that rain starts from, in the mean over sizes and the clip, m^2.
    pub fn area(&self) -> f64 {
        self.area
    }

    /// Drops let go in a second at full strength, in the mean over the clip.
    pub fn rate(&self) -> f64 {
        self.flux * self.area
    }

    /// Strength over the clip, s.
    fn envelope_integral(&self) -> f64 {
        let n = 2000;
        let h = self.fall.duration / f64::from(n);
        (0..n).map(|k| envelope_factor(&self.fall, (f64::from(k) + 0.5) * h) * h).sum()
    }

    /// Emits the drops of step `number`, which begins at time `t` and lasts `h`, s, ordered by time.
    pub fn emit(&mut self, number: u64, t: f64, h: f64) -> Vec<EmittedDrop> {
        let mut draw = Rng::at(self.fall.seed, &["rain".into(), 0_u64.into(), number.into()]);
        let key = Rng::key(self.fall.seed, &["rain".into(), "gusts".into()]);
        let gust = 1.0 + self.fall.jitter * f64::from(gradient1(key, math::narrow(t / PERIOD), 1 << 20));
        let now = self.epoch_at(t);
        let around = now.sums.last().copied().unwrap_or(0.0) / self.sizes.len().max(1) as f64;
        let mean = self.flux * around * envelope_factor(&self.fall, t) * h * gust.max(0.0);
        let count = sample_poisson(mean, &mut draw);
        let mut born: Vec<EmittedDrop> = Vec::new();
        for _ in 0..count {
            let at = draw.range(0.0, h);
            let (class, d) = self.sample_diameter(&now.sums, draw.unit_f64());
            let shares = DVec2::new(draw.unit_f64(), draw.unit_f64());
            // Candidates are uniform over the bounding rectangle; those outside of the source region would miss everything.
            let Some(p) = now.sources.get(class).and_then(|s| s.place(shares)) else { continue };
            let p = DVec3::new(p.x, self.reach.height(), p.y);
            born.push(EmittedDrop { t: t + at, p, v: -DVec3::Y * terminal_speed(d), volume: sphere_volume(d) });
        }
        self.now = Some(now);
        let places: Vec<Vec3> = born.iter().map(|b| b.p.as_vec3()).collect();
        let airs = wind_at(self.reach.wind(), &places, t);
        born.iter_mut().zip(airs).for_each(|(b, air)| b.v += air.as_dvec3());
        born.sort_by(|a, b| a.t.total_cmp(&b.t));
        born
    }

    /// Where drops start at a time.
    fn epoch_at(&mut self, t: f64) -> EmissionEpoch {
        let epoch = self.reach.epoch(t);
        if let Some(now) = self.now.take().filter(|now| now.epoch == epoch) {
            return now;
        }
        let sources = self.reach.sources(epoch);
        let around: Vec<f64> = sources.iter().map(SourceRegion::around).collect();
        let mut sum = 0.0;
        let add = |class: &usize| {
            sum += around.get(*class).copied().unwrap_or(0.0);
            sum
        };
        let sums = self.classes.iter().map(add).collect();
        EmissionEpoch { epoch, sources, sums }
    }

    /// A size by its chance to start now: the larger the area that a size starts from, the more drops of it there are.
    fn sample_diameter(&self, sums: &[f64], u: f64) -> (usize, f64) {
        let last = self.sizes.len().saturating_sub(1);
        let wanted = u * sums.last().copied().unwrap_or(0.0);
        let k = sums.partition_point(|s| *s <= wanted).min(last);
        let below = if k > 0 { sums[k - 1] } else { 0.0 };
        let x = (wanted - below) / (sums[k] - below).max(f64::MIN_POSITIVE) - 0.5;
        let other = if x < 0.0 { k.saturating_sub(1) } else { (k + 1).min(last) };
        let d = self.sizes[k] + (self.sizes[other] - self.sizes[k]) * x.abs().min(0.5);
        (self.classes[k], d)
    }
}

/// Share of its full strength that rain has at a time, s.
fn envelope_factor(fall: &RainfallParams, t: f64) -> f64 {
    match &fall.envelope {
        IntensityEnvelope::Constant => 1.0,
        IntensityEnvelope::Bell(middle, width) => {
            let k = (t - middle) / width;
            math::exp(-0.5 * k * k)
        }
        IntensityEnvelope::Keys(rows) => interpolate(rows, t).unwrap_or(1.0),
    }
}

/// Middles of pieces of equal chance.
fn diameters_of_equal_chance(fall: &RainfallParams) -> Vec<f64> {
    let n = TABLE as f64;
    let [least, most] = SIZES;
    let density: Box<dyn Fn(f64) -> f64> = match fall.size {
        DropSizes::Fixed(d) => return vec![d],
        DropSizes::LogNormal(median, sigma) => Box::new(move |mm: f64| {
            let k = math::ln(mm * 1e-3 / median) / sigma;
            math::exp(-0.5 * k * k) / mm
        }),
        DropSizes::Natural => {
            let slope = 4.1 * math::pow((fall.intensity * 3.6e6).max(0.01), -0.21);
            Box::new(move |mm: f64| math::exp(-slope * mm) * terminal_speed(mm * 1e-3))
        }
    };
    let (mut sum, mut sums) = (0.0, vec![(0.0, least)]);
    let fine = 16 * TABLE;
    let step = (most - least) / fine as f64;
    for k in 0..fine {
        let mm = least + (k as f64 + 0.5) * step;
        sum += density(mm) * step;
        sums.push((sum, mm + 0.5 * step));
    }
    let place = |u: f64| {
        let wanted = u * sum;
        let k = sums.partition_point(|s| s.0 < wanted).clamp(1, sums.len() - 1);
        let ((a, x), (b, y)) = (sums[k - 1], sums[k]);
        (x + (y - x) * (wanted - a) / (b - a).max(f64::MIN_POSITIVE)) * 1e-3
    };
    (0..TABLE).map(|k| place((k as f64 + 0.5) / n)).collect()
}

/// A count whose mean is `mean`. Source: Knuth's multiplication, in parts of at most 30.
pub fn sample_poisson(mean: f64, draw: &mut Rng) -> u32 {
    let (mut left, mut count) = (mean.max(0.0), 0);
    while left > 0.0 {
        let part = left.min(CHUNK);
        left -= part;
        let least = math::exp(-part);
        let mut product = draw.unit_f64();
        while product > least {
            count += 1;
            product *= draw.unit_f64();
        }
    }
    count
}

/// Velocity of a falling drop of `volume`, m^3, after `h`, s, under gravity `g`, m/s^2, in air of velocity `air`, m/s.
/// Source: quadratic drag that balances gravity at terminal speed, a = -g |v| v / vt^2.
pub fn fall(v: DVec3, volume: f64, g: f64, air: DVec3, h: f64) -> DVec3 {
    let rel = v - air;
    // Gravity explicit, drag implicit in the velocity with its coefficient g |v| / vt^2 of the old one: stable for any h.
    let vt = terminal_speed(sphere_diameter(volume));
    let rel = (rel - DVec3::Y * (g * h)) / (1.0 + h * g * rel.length() / (vt * vt));
    air + rel
}

/// The wind at some places.
pub fn wind_at(wind: Option<&dyn Wind>, places: &[Vec3], t: f64) -> Vec<Vec3> {
    let mut out = vec![Vec3::ZERO; places.len()];
    if let Some(wind) = wind {
        wind.sample(places, t, &mut out);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rainfall() -> RainfallParams {
        RainfallParams {
            seed: 5,
            intensity: 10.0 / 3.6e6,
            size: DropSizes::Natural,
            total: None,
            envelope: IntensityEnvelope::Constant,
            jitter: 0.0,
            duration: 10.0,
            g: 9.81,
        }
    }

    fn over() -> Bounds {
        Bounds { min: Vec3::ZERO, max: Vec3::new(0.9, 1.0, 0.9) }
    }

    #[test]
    fn ten_millimetres_an_hour_are_ten_millimetres_an_hour() {
        let mut shower = RainEmitter::new(rainfall(), over(), None);
        assert!((2300.0..3100.0).contains(&shower.flux()), "{}", shower.flux());
        let (mut water, mut counts, h) = (0.0, Vec::new(), 0.005);
        for k in 0..8000_u64 {
            let born = shower.emit(k, k as f64 * h, h);
            water += born.iter().map(|b| b.volume).sum::<f64>();
            counts.push(born.len());
        }
        assert!(counts.iter().sum::<usize>() > 100_000);
        let area = 1.0;
        assert!((water / (area * 8000.0 * h) / rainfall().intensity - 1.0).abs() < 0.03);
        let (mean, n) = (shower.rate() * h, counts.len() as f64);
        // Counts scatter as Poisson's do, neither more nor less.
        let scatter: f64 = counts.iter().map(|c| (*c as f64 - mean) * (*c as f64 - mean) / mean).sum();
        assert!(sigmas(scatter, n).abs() < 3.29, "{scatter}");
        // And each number of drops is as frequent as it should be; both at p = 0.001.
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

    /// By how many sigmas a chi square of so many degrees is off. Source: Wilson and Hilferty 1931.
    fn sigmas(chi: f64, degrees: f64) -> f64 {
        let spread = 2.0 / (9.0 * degrees);
        (math::cbrt(chi / degrees) - (1.0 - spread)) / spread.sqrt()
    }

    #[test]
    fn sizes_are_marshall_and_palmers() {
        let mut shower = RainEmitter::new(rainfall(), over(), None);
        let mut found: Vec<f64> = Vec::new();
        let mut k = 0_u64;
        while found.len() < 20_000 {
            found.extend(shower.emit(k, 0.0, 0.01).iter().map(|b| sphere_diameter(b.volume) * 1e3));
            k += 1;
        }
        found.sort_by(f64::total_cmp);
        let slope = 4.1 * math::pow(10.0, -0.21);
        let density = |mm: f64| math::exp(-slope * mm) * terminal_speed(mm * 1e-3);
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
        // Kolmogorov and Smirnov at p = 0.001.
        assert!(worst < 1.95 / (found.len() as f64).sqrt(), "{worst}");
    }

    #[test]
    fn drops_fall_at_their_own_speed() {
        for mm in [0.5, 1.0, 2.0, 5.0] {
            let d = mm * 1e-3;
            let mut v = DVec3::ZERO;
            (0..12_000).for_each(|_| v = fall(v, sphere_volume(d), 9.81, DVec3::X * 2.0, 1e-3));
            assert!((v.y / -terminal_speed(d) - 1.0).abs() < 0.01, "{mm}: {v}");
            assert!((v.x - 2.0).abs() < 0.01);
        }
    }

    #[test]
    fn a_clip_has_as_many_drops_as_it_is_told() {
        let bell = IntensityEnvelope::Bell(5.0, 2.5);
        let fall = RainfallParams { total: Some(2000.0), envelope: bell, jitter: 0.2, ..rainfall() };
        let mut shower = RainEmitter::new(fall, over(), Some(Arc::new(osier_wind::UniformWind(Vec3::X))));
        let count: usize = (0..2000_u64).map(|k| shower.emit(k, k as f64 * 0.005, 0.005).len()).sum();
        assert!((count as f64 - 2000.0).abs() < 5.0 * 2000.0_f64.sqrt() + 60.0, "{count}");
    }
}
