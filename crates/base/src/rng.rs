//! Streams of random numbers with addresses: every decision draws from a separate stream, so that no draw depends on the order of work.
//!
//! A stream is named by a seed and a path of integers and words; the same address gives the same numbers for ever.

use rand_pcg::Pcg64Mcg;
use rand_pcg::rand_core::Rng as _;

use crate::math;

// 2^64 divided by the golden ratio, the increment of splitmix64. It is added because the finalizer maps 0 to 0, and keys and ids may be 0.
const GOLDEN: u64 = 0x9E37_79B9_7F4A_7C15;
const MULTIPLIER: u64 = 0xD134_2543_DE82_EF95;

/// Finalizer of splitmix64: a bijection that mixes all bits.
#[inline]
const fn fin(z: u64) -> u64 {
    let z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

/// Key of the address that `id` extends by one element, where `k` is the key of the shorter address.
#[inline]
pub const fn child(k: u64, id: u64) -> u64 {
    ChildId::new(id).of(k)
}

/// The part of [`child`] that depends on the id alone, for loops that need children of the same id below many keys.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ChildId(u64);

impl ChildId {
    /// Mixes the id once; each parent key then costs a single further mix.
    #[inline]
    pub const fn new(id: u64) -> Self {
        Self(fin(id.wrapping_add(GOLDEN)))
    }

    /// Key of the child of key `k`: what [`child`] gives.
    #[inline]
    pub const fn of(self, k: u64) -> u64 {
        // The parent is multiplied before the xor, so that swapping parent and child gives another key.
        fin(k.wrapping_mul(MULTIPLIER) ^ self.0)
    }
}

/// Mixes a sequence of integers into one key; the empty sequence gives 0.
#[inline]
pub fn mix64(values: &[u64]) -> u64 {
    let Some((first, rest)) = values.split_first() else { return 0 };
    rest.iter().fold(fin(first.wrapping_add(GOLDEN)), |k, &v| child(k, v))
}

/// 64-bit FNV-1a of the UTF-8 bytes: how a word becomes a path element.
#[inline]
pub const fn word(text: &str) -> u64 {
    let bytes = text.as_bytes();
    let mut hash = 0xCBF2_9CE4_8422_2325_u64;
    let mut i = 0;
    while i < bytes.len() {
        hash = (hash ^ bytes[i] as u64).wrapping_mul(0x0000_0100_0000_01B3);
        i += 1;
    }
    hash
}

/// One element of a stream's address: an integer, or a text by its [`word`].
#[derive(Debug, Clone, Copy)]
pub struct Key(pub u64);

impl From<u64> for Key {
    fn from(v: u64) -> Self {
        Self(v)
    }
}
impl From<u32> for Key {
    fn from(v: u32) -> Self {
        Self(u64::from(v))
    }
}
impl From<i64> for Key {
    fn from(v: i64) -> Self {
        Self(v.cast_unsigned())
    }
}
impl From<usize> for Key {
    fn from(v: usize) -> Self {
        Self(v as u64)
    }
}
impl From<&str> for Key {
    fn from(v: &str) -> Self {
        Self(word(v))
    }
}

/// A stream of random numbers: PCG XSL RR 128/64 (MCG), whose state of 128 bits is mixed from a key.
///
/// ```
/// use osier_base::rng::Rng;
/// let mut leaf = Rng::at(42, &["leaf".into(), 3_u64.into()]);
/// assert_eq!(leaf.next_u64(), 0x89c5_d2de_302e_b114);
/// ```
#[derive(Debug, Clone)]
pub struct Rng(Pcg64Mcg);

impl Rng {
    /// The stream of an address, from its beginning; draws from other streams do not change it.
    #[inline]
    pub fn at(seed: u64, path: &[Key]) -> Self {
        Self::from_key(Self::key(seed, path))
    }

    /// The key of an address; streams of equal keys are equal.
    #[inline]
    pub fn key(seed: u64, path: &[Key]) -> u64 {
        path.iter().fold(fin(seed.wrapping_add(GOLDEN)), |k, e| child(k, e.0))
    }

    /// The stream of a key of [`Rng::key`], from its beginning.
    #[inline]
    pub fn from_key(k: u64) -> Self {
        let high = u128::from(fin(k.wrapping_add(GOLDEN)));
        let low = u128::from(fin(k.wrapping_add(GOLDEN.wrapping_mul(2))));
        Self(Pcg64Mcg::new((high << 64) | low))
    }

    /// 64 random bits. One draw.
    #[inline]
    pub fn next_u64(&mut self) -> u64 {
        self.0.next_u64()
    }

    /// Uniform in [0, 1), a multiple of 2^-24. One draw.
    #[inline]
    pub fn unit_f32(&mut self) -> f32 {
        // The 24 high bits, as many as the significand of an f32 holds: every value is exact, and 1 cannot appear by
        // rounding.
        (self.next_u64() >> 40) as f32 * (1.0 / 16_777_216.0)
    }

    /// Uniform in [0, 1), a multiple of 2^-53. One draw.
    #[inline]
    pub fn unit_f64(&mut self) -> f64 {
        // The 53 high bits, as many as the significand of an f64 holds, divided by 2^53.
        (self.next_u64() >> 11) as f64 * (1.0 / 9_007_199_254_740_992.0)
    }

    /// Uniform between `a` and `b`; `b` may appear by rounding. One draw.
    #[inline]
    pub fn range(&mut self, a: f64, b: f64) -> f64 {
        a + (b - a) * self.unit_f64()
    }

    /// Uniform in 0..n; 0 for n = 0. One draw.
    #[allow(
        clippy::cast_possible_truncation,
        reason = "the product is below n * 2^64, so the shifted value is below n"
    )]
    #[inline]
    pub fn below(&mut self, n: u32) -> u32 {
        // Multiply and shift instead of a remainder. Without rejection the bias is below n / 2^64, and the number of
        // draws is fixed.
        ((u128::from(self.next_u64()) * u128::from(n)) >> 64) as u32
    }

    /// True with probability `p`; never for NaN. One draw.
    #[inline]
    pub fn chance(&mut self, p: f64) -> bool {
        self.unit_f64() < p
    }

    /// Standard normal (Box-Muller, the second value is not kept), magnitude at most 8.58. Two draws.
    #[inline]
    pub fn normal(&mut self) -> f64 {
        let u1 = self.unit_f64();
        let u2 = self.unit_f64();
        // 1 - u1 lies in (0, 1], so that the logarithm is finite.
        math::sqrt(-2.0 * math::ln(1.0 - u1)) * math::cos(2.0 * std::f64::consts::PI * u2)
    }

    /// Standard normal by the inverse of its distribution function, for loops that draw millions: four times as fast as
    /// [`Rng::normal`] and of the same distribution, but other numbers. Magnitude at most 8.3. One draw.
    #[inline]
    pub fn normal_by_quantile(&mut self) -> f64 {
        // The middle of one of 2^53 equal intervals of (0, 1), less 1/2: never the ends, whose quantiles are infinite.
        let q = (((self.next_u64() >> 11) as f64) + 0.5) * (1.0 / 9_007_199_254_740_992.0) - 0.5;
        normal_quantile(q)
    }

    /// Index picked in proportion to `weights`; the last positive one if rounding runs past the end; 0 if none is
    /// positive. One draw.
    #[inline]
    pub fn pick(&mut self, weights: &[f64]) -> usize {
        weighted_index(self.unit_f64(), weights)
    }

    /// Fisher-Yates shuffle from the end. `len - 1` draws.
    #[allow(clippy::cast_possible_truncation, reason = "lists are limited far below 2^32 items")]
    #[inline]
    pub fn shuffle<T>(&mut self, items: &mut [T]) {
        for i in (1..items.len()).rev() {
            let j = self.below(i as u32 + 1) as usize;
            items.swap(i, j);
        }
    }
}

/// Weights prepared for many picks: running sums instead of the weights.
#[derive(Debug, Clone, PartialEq)]
pub struct Shares {
    sums: Vec<f64>,
    /// Index of the last positive weight, for targets that rounding puts past the end; 0 without one.
    last: usize,
}

impl Shares {
    /// Prepares weights; negative ones and NaN count as 0.
    pub fn new(weights: &[f64]) -> Self {
        let mut sum = 0.0;
        let sums = weights.iter().map(|w| {
            sum += w.max(0.0);
            sum
        });
        Self { sums: sums.collect(), last: weights.iter().rposition(|w| *w > 0.0).unwrap_or(0) }
    }

    /// The index that [`Rng::pick`] picks from the weights. One draw.
    #[inline]
    pub fn pick(&self, rng: &mut Rng) -> usize {
        let target = rng.unit_f64() * self.sums.last().copied().unwrap_or(0.0);
        // The number of sums up to the target is the index of the first one beyond it, without a branch on the random target.
        let index = self.sums.iter().map(|sum| usize::from(*sum <= target)).sum::<usize>();
        if index < self.sums.len() { index } else { self.last }
    }
}

/// Index that [`Rng::pick`] picks where its draw is `unit`, 0 to below 1.
#[inline]
pub fn weighted_index(unit: f64, weights: &[f64]) -> usize {
    // Inverse of the cumulative distribution; negative weights and NaN count as 0.
    let total = weights.iter().fold(0.0, |t, w| t + w.max(0.0));
    let target = unit * total;
    let mut running = 0.0;
    let mut last = 0;
    for (i, w) in weights.iter().enumerate().filter(|(_, w)| **w > 0.0) {
        running += w;
        last = i;
        if running > target {
            return i;
        }
    }
    last
}

/// Quantile of the standard normal distribution at the probability 1/2 + `q`, -1/2 < q < 1/2, to 1e-15 of its value.
/// Source: M. J. Wichura, Algorithm AS 241 (PPND16), Applied Statistics 37 (1988), 477-484: one ratio of polynomials of degree 7
/// for the central 85 %, one of two others for the tails.
#[inline]
fn normal_quantile(q: f64) -> f64 {
    // Boundaries of the three regions, and where the argument of each is centred.
    const CENTRAL: f64 = 0.425;
    const CENTRAL_SQUARED: f64 = 0.180_625;
    const NEAR_TAIL: f64 = 5.0;
    const NEAR_TAIL_CENTER: f64 = 1.6;
    if q.abs() <= CENTRAL {
        return q * ratio(&CENTRAL_RATIO, CENTRAL_SQUARED - q * q);
    }
    let r = math::sqrt(-math::ln(0.5 - q.abs()));
    let size = if r <= NEAR_TAIL {
        ratio(&NEAR_TAIL_RATIO, r - NEAR_TAIL_CENTER)
    } else {
        ratio(&FAR_TAIL_RATIO, r - NEAR_TAIL)
    };
    size.copysign(q)
}

/// Coefficients of numerator and denominator, from the constant on.
type Ratio = [[f64; 8]; 2];

const CENTRAL_RATIO: Ratio = [
    [
        3.387_132_872_796_366_5,
        133.141_667_891_784_38,
        1_971.590_950_306_551_3,
        13_731.693_765_509_46,
        45_921.953_931_549_87,
        67_265.770_927_008_7,
        33_430.575_583_588_13,
        2_509.080_928_730_122_7,
    ],
    [
        1.0,
        42.313_330_701_600_91,
        687.187_007_492_057_9,
        5_394.196_021_424_751,
        21_213.794_301_586_597,
        39_307.895_800_092_71,
        28_729.085_735_721_943,
        5_226.495_278_852_854,
    ],
];
const NEAR_TAIL_RATIO: Ratio = [
    [
        1.423_437_110_749_683_5,
        4.630_337_846_156_546,
        5.769_497_221_460_691,
        3.647_848_324_763_204_5,
        1.270_458_252_452_368_4,
        0.241_780_725_177_450_6,
        0.022_723_844_989_269_184,
        7.745_450_142_783_414e-4,
    ],
    [
        1.0,
        2.053_191_626_637_759,
        1.676_384_830_183_803_8,
        0.689_767_334_985_1,
        0.148_103_976_427_480_08,
        0.015_198_666_563_616_457,
        5.475_938_084_995_345e-4,
        1.050_750_071_644_416_9e-9,
    ],
];
const FAR_TAIL_RATIO: Ratio = [
    [
        6.657_904_643_501_103,
        5.463_784_911_164_114,
        1.784_826_539_917_291_3,
        0.296_560_571_828_504_87,
        0.026_532_189_526_576_124,
        0.001_242_660_947_388_078_4,
        2.711_555_568_743_487_6e-5,
        2.010_334_399_292_288_1e-7,
    ],
    [
        1.0,
        0.599_832_206_555_888,
        0.136_929_880_922_735_8,
        0.014_875_361_290_850_615,
        7.868_691_311_456_133e-4,
        1.846_318_317_510_054_7e-5,
        1.421_511_758_316_446e-7,
        2.044_263_103_389_939_8e-15,
    ],
];

/// Ratio of two polynomials at `x`, by Horner's scheme.
#[inline]
fn ratio(coefficients: &Ratio, x: f64) -> f64 {
    let horner = |c: &[f64; 8]| c.iter().rev().fold(0.0, |sum, c| sum * x + c);
    horner(&coefficients[0]) / horner(&coefficients[1])
}

#[cfg(test)]
#[allow(clippy::cast_possible_truncation, reason = "bins of a histogram")]
mod tests {
    use super::*;

    #[test]
    fn prepared_weights_pick_like_weights() {
        for weights in [&[1.0, 2.0][..], &[0.0, 3.0, -1.0, 0.5, f64::NAN, 0.0], &[], &[0.0, 0.0], &[0.1; 7]] {
            let shares = Shares::new(weights);
            for i in 0..1000_u64 {
                let mut rng = Rng::from_key(i);
                assert_eq!(shares.pick(&mut rng.clone()), rng.pick(weights), "{weights:?}");
            }
        }
    }

    #[test]
    fn pinned_streams() {
        let path = |p: &[u64]| p.iter().map(|&v| Key(v)).collect::<Vec<_>>();
        assert_eq!(Rng::key(42, &[]), 0xbdd7_3226_2feb_6e95);
        assert_eq!(Rng::at(42, &[]).next_u64(), 0xf205_2c08_f103_09a8);
        assert_eq!(Rng::key(42, &path(&[1, 2, 3])), 0xc6f6_74a6_9ab8_0a7f);
        let mut r = Rng::at(42, &path(&[1, 2, 3]));
        assert_eq!((r.next_u64(), r.next_u64()), (0xc1c4_8cc6_02d0_3b23, 0xd23d_bc29_e8a8_cd92));
        assert_eq!(Rng::at(42, &path(&[3, 2, 1])).next_u64(), 0xb9dc_6ca0_f011_376c);
        assert_eq!(Rng::key(42, &["leaf".into(), 3_u64.into()]), 0x9025_dac2_b50f_57b4);
        assert_eq!(mix64(&[42, 1, 2, 3]), Rng::key(42, &path(&[1, 2, 3])));
    }

    /// Pearson's statistic against equal shares.
    fn chi_square(counts: &[u32]) -> f64 {
        let n: u32 = counts.iter().sum();
        let expected = f64::from(n) / counts.len() as f64;
        counts.iter().fold(0.0, |s, &c| s + (f64::from(c) - expected) * (f64::from(c) - expected) / expected)
    }

    #[test]
    fn draws_are_uniform() {
        let mut r = Rng::at(7, &["chi".into()]);
        let mut bins = [[0_u32; 16]; 3];
        for _ in 0..100_000 {
            bins[0][(r.unit_f64() * 16.0) as usize] += 1;
            bins[1][r.below(16) as usize] += 1;
            bins[2][r.pick(&[1.0; 16])] += 1;
        }
        // 15 degrees of freedom: 37.7 is the 0.999 quantile.
        for b in &bins {
            assert!(chi_square(b) < 37.7, "{b:?}");
        }
    }

    #[test]
    fn quantiles_of_the_normal_distribution_are_those_of_tables() {
        for (p, z) in [
            (0.5, 0.0),
            (0.6, 0.253_347_103_135_799_7),
            (0.975, 1.959_963_984_540_054),
            (0.999, 3.090_232_306_167_813_5),
            (0.999_999_713_348_428, 5.0),
        ] {
            assert!((normal_quantile(p - 0.5) - z).abs() < 1e-8, "{p}: {}", normal_quantile(p - 0.5));
            assert!((normal_quantile(0.5 - p) + z).abs() < 1e-8);
        }
        // The three regions join; in the far tail the last bit of q alone is worth 1e-5.
        for q in [0.425, 0.5 - math::exp(-25.0)] {
            assert!((normal_quantile(q * (1.0 + 1e-15)) - normal_quantile(q)).abs() < 1e-4 && q < 0.5);
        }
        let mut r = Rng::at(5, &[]);
        let draws: Vec<f64> = (0..100_000).map(|_| r.normal_by_quantile()).collect();
        let mean = draws.iter().fold(0.0, |s, x| s + x) / 1e5;
        let var = draws.iter().fold(0.0, |s, x| s + (x - mean) * (x - mean)) / 1e5;
        assert!(mean.abs() < 0.012 && (var - 1.0).abs() < 0.02, "{mean} {var}");
    }

    #[test]
    fn neighbouring_addresses_are_independent() {
        let mut bins = [0_u32; 64];
        for i in 0..100_000_u64 {
            let mut r = Rng::at(1, &[i.into()]);
            bins[(r.unit_f32() * 8.0) as usize * 8 + (r.unit_f32() * 8.0) as usize] += 1;
        }
        assert!(chi_square(&bins) < 103.4, "63 degrees of freedom");
    }

    #[test]
    fn normal_has_unit_variance_and_shuffle_permutes() {
        let mut r = Rng::at(3, &[]);
        let draws: Vec<f64> = (0..100_000).map(|_| r.normal()).collect();
        let mean = draws.iter().fold(0.0, |s, x| s + x) / 1e5;
        let var = draws.iter().fold(0.0, |s, x| s + (x - mean) * (x - mean)) / 1e5;
        assert!(mean.abs() < 0.012 && (var - 1.0).abs() < 0.02, "{mean} {var}");
        let mut items: Vec<u32> = (0..20).collect();
        r.shuffle(&mut items);
        let mut sorted = items.clone();
        sorted.sort_unstable();
        assert_ne!(items, sorted);
        assert_eq!(sorted, (0..20).collect::<Vec<_>>());
    }
}
