//! Drops as the sky lets them go: how many, how large, from where; and how they fall.

use std::f64::consts::PI;

use glam::{DVec3, Vec3};

use crate::geometry::Bounds;
use crate::math;
use crate::noise::gradient1;
use crate::rng::Rng;
use crate::wind::Wind;

/// Smallest and largest raindrop, mm.
const SIZES: [f64; 2] = [0.5, 6.0];
/// Pieces of the table of sizes.
const TABLE: usize = 1024;
/// Height from which rain falls above everything, m, and how far it reaches beyond it to the sides.
const ABOVE: f64 = 0.5;
const BESIDE: f64 = 0.05;
/// Mean of the largest draw by multiplication.
const CHUNK: f64 = 30.0;
/// Period of gusts of rain, s.
const PERIOD: f64 = 0.5;

/// Velocity at which a raindrop of a diameter, m, falls in still air, m/s. Source: Atlas et al. 1973.
pub fn terminal(d: f64) -> f64 {
    (9.65 - 10.3 * math::exp(-600.0 * d)).max(0.3)
}

/// Volume of a ball of a diameter.
pub fn ball(d: f64) -> f64 {
    PI / 6.0 * d * d * d
}

/// Diameter of a ball of a volume.
pub fn across(volume: f64) -> f64 {
    math::cbrt(volume * 6.0 / PI)
}

/// How large drops are.
#[derive(Debug, Clone, PartialEq)]
pub enum Size {
    /// As in rain of its strength. Source: Marshall and Palmer 1948.
    Natural,
    /// All alike, m.
    Fixed(f64),
    /// Around a median, m, by a factor with this logarithm.
    LogNormal(f64, f64),
}

/// How rain's strength changes over a clip.
#[derive(Debug, Clone, PartialEq)]
pub enum Envelope {
    /// Always the same.
    Constant,
    /// A bell around a time, s, with a width, s. Source: [yang-wu] section 3.
    Bell(f64, f64),
    /// Seconds and factors, linear between.
    Keys(Vec<[f64; 2]>),
}

/// Rain.
#[derive(Debug, Clone)]
pub struct Rainfall {
    /// Seed of its draws.
    pub seed: u64,
    /// Water over time, m/s (10 mm/h are 2.8e-6).
    pub strength: f64,
    /// How large drops are.
    pub size: Size,
    /// Drops that a clip of `duration` seconds has in all, instead of `strength`.
    pub total: Option<f64>,
    /// How strength changes.
    pub envelope: Envelope,
    /// How much it changes by chance, 0 to 1.
    pub jitter: f64,
    /// s.
    pub duration: f64,
    /// m/s^2.
    pub g: f64,
}

/// Rain over a place.
#[derive(Debug)]
pub struct Shower {
    fall: Rainfall,
    /// Rectangle that it falls from: corner and sides, m.
    corner: DVec3,
    sides: [f64; 2],
    /// Diameters of equal chance, m.
    sizes: Vec<f64>,
    /// Drops per m^2 and s.
    flux: f64,
}

/// A drop that is let go.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Born {
    /// When, s.
    pub t: f64,
    /// Where, m.
    pub p: DVec3,
    /// m/s.
    pub v: DVec3,
    /// m^3.
    pub volume: f64,
}

impl Shower {
    /// Rain that falls on everything in a box, m, with a mean wind, m/s.
    pub fn new(fall: Rainfall, over: Bounds, wind: Vec3) -> Self {
        let (min, max) = (over.min.as_dvec3(), over.max.as_dvec3());
        let sizes = sizes(&fall);
        let mean = sizes.iter().map(|d| ball(*d)).sum::<f64>() / sizes.len().max(1) as f64;
        let middle = sizes.get(sizes.len() / 2).copied().unwrap_or(1e-3);
        let drift = wind.as_dvec3() * ((ABOVE + 0.5 * (max.y - min.y)) / terminal(middle));
        let corner = DVec3::new(min.x - BESIDE - drift.x, max.y + ABOVE, min.z - BESIDE - drift.z);
        let sides = [max.x - min.x + 2.0 * BESIDE, max.z - min.z + 2.0 * BESIDE];
        let mut shower = Self { corner, sides, sizes, flux: 1.0, fall };
        shower.flux = match shower.fall.total {
            Some(total) => total / (sides[0] * sides[1] * shower.whole()).max(f64::MIN_POSITIVE),
            None => shower.fall.strength / mean,
        };
        shower
    }

    /// Drops per m^2 and s at full strength.
    pub fn flux(&self) -> f64 {
        self.flux
    }

    /// Drops let go in a second at full strength.
    pub fn rate(&self) -> f64 {
        self.flux * self.sides[0] * self.sides[1]
    }

    /// Strength over the clip, s.
    fn whole(&self) -> f64 {
        let n = 2000;
        let h = self.fall.duration / f64::from(n);
        (0..n).map(|k| self.share((f64::from(k) + 0.5) * h) * h).sum()
    }

    fn share(&self, t: f64) -> f64 {
        match &self.fall.envelope {
            Envelope::Constant => 1.0,
            Envelope::Bell(middle, width) => {
                let k = (t - middle) / width;
                math::exp(-0.5 * k * k)
            }
            Envelope::Keys(keys) => {
                let k = keys.partition_point(|key| key[0] <= t);
                match (k.checked_sub(1).map(|k| keys[k]), keys.get(k)) {
                    (Some(a), Some(b)) => a[1] + (b[1] - a[1]) * (t - a[0]) / (b[0] - a[0]),
                    (Some(a), None) => a[1],
                    (None, Some(b)) => b[1],
                    (None, None) => 1.0,
                }
            }
        }
    }

    /// Drops of step `number`, which begins at `t` and lasts `h` seconds. The wind where they start: `air`, m/s.
    pub fn drops(&self, number: u64, (t, h): (f64, f64), air: DVec3) -> Vec<Born> {
        let mut draw = Rng::at(self.fall.seed, &["rain".into(), 0_u64.into(), number.into()]);
        let key = Rng::key(self.fall.seed, &["rain".into(), "gusts".into()]);
        let gust = 1.0 + self.fall.jitter * f64::from(gradient1(key, math::narrow(t / PERIOD), 1 << 20));
        let mean = self.rate() * self.share(t) * h * gust.max(0.0);
        let count = poisson(mean, &mut draw);
        let mut born: Vec<Born> = (0..count)
            .map(|_| {
                let at = draw.range(0.0, h);
                let d = self.size(draw.unit_f64());
                let [x, z] = self.sides.map(|s| draw.range(0.0, s));
                let p = self.corner + DVec3::new(x, 0.0, z);
                Born { t: t + at, p, v: air - DVec3::Y * terminal(d), volume: ball(d) }
            })
            .collect();
        born.sort_by(|a, b| a.t.total_cmp(&b.t));
        born
    }

    /// The middle of where drops start, m.
    pub fn middle(&self) -> DVec3 {
        self.corner + DVec3::new(self.sides[0] / 2.0, 0.0, self.sides[1] / 2.0)
    }

    fn size(&self, u: f64) -> f64 {
        let x = u * self.sizes.len() as f64 - 0.5;
        let last = self.sizes.len().saturating_sub(1);
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped")]
        let k = x.floor().clamp(0.0, last as f64) as usize;
        let (a, b) = (self.sizes[k], self.sizes[(k + 1).min(last)]);
        a + (b - a) * (x - k as f64).clamp(0.0, 1.0)
    }
}

/// Middles of pieces of equal chance.
fn sizes(fall: &Rainfall) -> Vec<f64> {
    let n = TABLE as f64;
    let [least, most] = SIZES;
    let density: Box<dyn Fn(f64) -> f64> = match fall.size {
        Size::Fixed(d) => return vec![d],
        Size::LogNormal(median, sigma) => Box::new(move |mm: f64| {
            let k = math::ln(mm * 1e-3 / median) / sigma;
            math::exp(-0.5 * k * k) / mm
        }),
        Size::Natural => {
            let slope = 4.1 * math::pow((fall.strength * 3.6e6).max(0.01), -0.21);
            Box::new(move |mm: f64| math::exp(-slope * mm) * terminal(mm * 1e-3))
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
pub fn poisson(mean: f64, draw: &mut Rng) -> u32 {
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

/// A falling drop after `h` seconds in air that moves with `air`, m/s. Source: drag that balances gravity at terminal speed;
/// semi-implicit.
pub fn fall(v: DVec3, (volume, g): (f64, f64), air: DVec3, h: f64) -> DVec3 {
    let rel = v - air;
    let vt = terminal(across(volume));
    let rel = (rel - DVec3::Y * (g * h)) / (1.0 + h * g * rel.length() / (vt * vt));
    air + rel
}

/// The wind at some places.
pub fn air_at(wind: Option<&dyn Wind>, places: &[Vec3], t: f64) -> Vec<Vec3> {
    let mut out = vec![Vec3::ZERO; places.len()];
    if let Some(wind) = wind {
        wind.sample(places, t, &mut out);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rainfall() -> Rainfall {
        Rainfall {
            seed: 5,
            strength: 10.0 / 3.6e6,
            size: Size::Natural,
            total: None,
            envelope: Envelope::Constant,
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
        let shower = Shower::new(rainfall(), over(), Vec3::ZERO);
        assert!((2300.0..3100.0).contains(&shower.flux()), "{}", shower.flux());
        let (mut water, mut counts, h) = (0.0, Vec::new(), 0.005);
        for k in 0..8000_u64 {
            let born = shower.drops(k, (k as f64 * h, h), DVec3::ZERO);
            water += born.iter().map(|b| b.volume).sum::<f64>();
            counts.push(born.len());
        }
        assert!(counts.iter().sum::<usize>() > 100_000);
        let area = 1.0;
        assert!((water / (area * 8000.0 * h) / rainfall().strength - 1.0).abs() < 0.03);
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
        let shower = Shower::new(rainfall(), over(), Vec3::ZERO);
        let mut found: Vec<f64> = Vec::new();
        let mut k = 0_u64;
        while found.len() < 20_000 {
            found.extend(shower.drops(k, (0.0, 0.01), DVec3::ZERO).iter().map(|b| across(b.volume) * 1e3));
            k += 1;
        }
        found.sort_by(f64::total_cmp);
        let slope = 4.1 * math::pow(10.0, -0.21);
        let density = |mm: f64| math::exp(-slope * mm) * terminal(mm * 1e-3);
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
            (0..12_000).for_each(|_| v = fall(v, (ball(d), 9.81), DVec3::X * 2.0, 1e-3));
            assert!((v.y / -terminal(d) - 1.0).abs() < 0.01, "{mm}: {v}");
            assert!((v.x - 2.0).abs() < 0.01);
        }
    }

    #[test]
    fn a_clip_has_as_many_drops_as_it_is_told() {
        let bell = Envelope::Bell(5.0, 2.5);
        let fall = Rainfall { total: Some(2000.0), envelope: bell, jitter: 0.2, ..rainfall() };
        let shower = Shower::new(fall, over(), Vec3::X);
        let count: usize = (0..2000_u64).map(|k| shower.drops(k, (k as f64 * 0.005, 0.005), DVec3::ZERO).len()).sum();
        assert!((count as f64 - 2000.0).abs() < 5.0 * 2000.0_f64.sqrt() + 60.0, "{count}");
    }
}
