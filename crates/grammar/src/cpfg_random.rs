//! Random numbers of the program cpfg, drawn in its order, so that osier reproduces its strings.
//!
//! cpfg draws from two linear congruential generators of 48 bits: one chooses productions, the other serves the functions of
//! the language. Both continue from module to module, whereas osier's own draws are addressed by module.

use osier_base::math;

/// Multiplier and addend of the generator. Source: drand48 of POSIX.
const MULTIPLIER: u64 = 0x5_DEEC_E66D;
const ADDEND: u64 = 0xB;
/// States are numbers of 48 bits.
const BITS: u32 = 48;
/// Low 16 bits of the state that a seed sets, as in srand48 of POSIX.
const SEED_LOW: u64 = 0x330E;
/// Limit on the trials of one binomial variate, so that a huge n ends; equal to the limit of osier's own draws.
const MAX_TRIALS: f64 = 1e6;

/// State of a linear congruential generator, a number of 48 bits.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Generator(u64);

impl Generator {
    /// The next number, 0 to below 1.
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(MULTIPLIER).wrapping_add(ADDEND) & ((1 << BITS) - 1);
        self.0 as f64 / (1_u64 << BITS) as f64
    }

    /// The next number above 0 and below 1; zeros are skipped.
    fn next_positive(&mut self) -> f64 {
        loop {
            let u = self.next();
            if u > 0.0 {
                return u;
            }
        }
    }
}

/// State of cpfg's random numbers in a batch run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct CpfgRandom {
    choice: Generator,
    functions: Generator,
    /// Second normal variate of a pair. Before the first `srand` it is 0, so that the first `nran(m,s)` is m.
    spare: Option<f64>,
}

impl Default for CpfgRandom {
    fn default() -> Self {
        Self { choice: Generator(0), functions: Generator(SEED_LOW), spare: Some(0.0) }
    }
}

impl CpfgRandom {
    /// `srand(seed)`: restarts the generator of the functions; the generator that chooses productions continues.
    pub fn seed(&mut self, seed: i64) {
        // Two's complement: 32 bits of the seed above the 16 fixed ones.
        let bits = seed.cast_unsigned() & 0xFFFF_FFFF;
        self.functions = Generator(bits << 16 | SEED_LOW);
        self.spare = None;
    }

    /// The number that each module of the string draws in a step to choose its production, 0 to below 1.
    pub fn choice(&mut self) -> f64 {
        self.choice.next()
    }

    /// A number from 0 to below 1, as `ran(1)` draws it.
    pub fn uniform(&mut self) -> f64 {
        self.functions.next()
    }

    /// `nran(mean, deviation)`. Source: the polar method of G. Marsaglia, which makes normal variates in pairs.
    pub fn normal(&mut self, mean: f64, deviation: f64) -> f64 {
        if let Some(spare) = self.spare.take() {
            return spare * deviation + mean;
        }
        loop {
            let x = 2.0 * self.uniform() - 1.0;
            let y = 2.0 * self.uniform() - 1.0;
            let square = x * x + y * y;
            if square < 1.0 && square > 0.0 {
                let factor = math::sqrt(-2.0 * math::ln(square) / square);
                self.spare = Some(x * factor);
                return y * factor * deviation + mean;
            }
        }
    }

    /// `bran(a, b)`; 0 for shapes that are not positive.
    /// Source: algorithm BA of R. C. H. Cheng, Communications of the ACM 21 (1978), 317.
    pub fn beta(&mut self, a: f64, b: f64) -> f64 {
        // Limit on rejection attempts; shapes from 0.001 to a million are accepted after far fewer.
        const MAX_ATTEMPTS: usize = 100_000;
        if !(a > 0.0 && b > 0.0) {
            return 0.0;
        }
        let sum = a + b;
        let least = a.min(b);
        let lambda = if least <= 1.0 { least } else { math::sqrt((2.0 * a * b - sum) / (sum - 2.0)) };
        for _ in 0..MAX_ATTEMPTS {
            let (u, v) = (self.functions.next_positive(), self.functions.next_positive());
            let odds = math::ln(u / (1.0 - u)) / lambda;
            let y = a * math::exp(odds);
            let bound = sum * math::ln(sum / (b + y)) + (a + lambda) * odds - math::ln(4.0);
            if bound >= math::ln(u * u * v) {
                return y / (b + y);
            }
        }
        a / sum
    }

    /// `biran(n, p)`: draws one number for each trial; a trial whose number is at most p is a success.
    pub fn binomial(&mut self, n: f64, p: f64) -> f64 {
        let trials = n.trunc().clamp(0.0, MAX_TRIALS);
        let (mut done, mut successes) = (0.0, 0.0);
        while done < trials {
            successes += if self.uniform() <= p { 1.0 } else { 0.0 };
            done += 1.0;
        }
        successes
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn first_numbers_are_those_of_srand48() {
        // drand48 after srand48(0), six digits.
        let mut r = CpfgRandom::default();
        let printed: Vec<String> = (0..3).map(|_| format!("{:.6}", r.uniform())).collect();
        assert_eq!(printed, ["0.170828", "0.749902", "0.096372"]);
        r.seed(0);
        assert_eq!(format!("{:.6}", r.uniform()), "0.170828");
        // By hand: the state of srand(1) is 0x1330E; times 0x5DEECE66D plus 0xB, modulo 2^48, over 2^48.
        r.seed(1);
        let state = (0x1_330E_u128 * 0x5_DEEC_E66D + 0xB) % (1 << 48);
        assert_eq!(r.uniform().to_bits(), (state as f64 / (1_u64 << 48) as f64).to_bits());
    }

    #[test]
    fn normal_variates_come_in_pairs_and_the_first_is_the_mean() {
        let mut r = CpfgRandom::default();
        assert_eq!(r.normal(7.0, 2.0).to_bits(), 7.0_f64.to_bits());
        // After srand(0) the numbers 0.170828 and 0.749902 make the pair (x, y) = (-0.658344, 0.499804): their squares sum to
        // 0.683221, the factor is sqrt(-2 ln 0.683221 / 0.683221) = 1.055987; y comes first.
        r.seed(0);
        let (first, second) = (r.normal(0.0, 1.0), r.normal(0.0, 1.0));
        assert!((first - 0.527787).abs() < 2e-5 && (second + 0.695203).abs() < 2e-5, "{first} {second}");
    }

    #[test]
    fn other_variates_stay_in_their_range() {
        let mut r = CpfgRandom::default();
        for (a, b) in [(0.4, 3.0), (1.0, 1.0), (5.0, 16.0)] {
            let mean = (0..2000).fold(0.0, |s, _| s + r.beta(a, b)) / 2000.0;
            assert!((mean - a / (a + b)).abs() < 0.03, "mean of bran({a},{b}): {mean}");
        }
        let heads = r.binomial(2000.0, 0.25);
        assert!((heads - 500.0).abs() < 90.0, "four and a half standard deviations: {heads}");
        assert_eq!((r.beta(0.0, 1.0).to_bits(), r.binomial(0.0, 1.0).to_bits()), (0, 0));
    }
}
