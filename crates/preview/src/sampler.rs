//! Scrambled Sobol points: well distributed in the unit square, different in every pixel.

/// Sample points of one pixel; equal pixels, seeds and indices have equal points, whatever the order of the calls.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sampler {
    seed: u32,
}

impl Sampler {
    /// Derives the scrambling of a pixel. `pixel`: its index in the picture, row by row.
    pub(super) fn new(pixel: u32, seed: u32) -> Self {
        Self { seed: hash(pixel ^ hash(seed)) }
    }

    /// Sample `index` of the two-dimensional dimension `dimension` (lens, sun, sky …): both coordinates in [0, 1).
    /// Points of one pixel and dimension are a scrambled Sobol sequence: any first 2^n of them fill a grid of 2^n
    /// cells.
    /// Source: B. Burley, "Practical hash-based Owen scrambling", JCGT 9(4), 2020.
    pub(super) fn point(&self, index: u32, dimension: u32) -> [f32; 2] {
        let seed = hash(self.seed ^ dimension.wrapping_mul(0x9e37_79b9));
        // Shuffling the order decorrelates pixels and dimensions; scrambling the digits of x and y
        // shifts the points themselves.
        let index = scramble(index, seed);
        let x = scramble(index.reverse_bits(), hash(seed ^ 0xa511_e9b3));
        let y = scramble(second(index), hash(seed ^ 0x63d8_3595));
        [unit(x), unit(y)]
    }
}

/// The second dimension of Sobol's sequence, as 32 bits after the binary point. The first is the reversed index.
fn second(mut index: u32) -> u32 {
    // XOR of the direction numbers of all set bits of the index. In the second dimension they are
    // the rows of Pascal's triangle modulo 2, each of which follows from the one before by v ^ (v
    // >> 1).
    let mut direction = 1_u32 << 31;
    let mut result = 0;
    while index != 0 {
        if index & 1 != 0 {
            result ^= direction;
        }
        index >>= 1;
        direction ^= direction >> 1;
    }
    result
}

/// Nested uniform (Owen) scrambling in base 2: every bit is flipped depending on the bits above it. The hash works on
/// the reversed number, where a multiplication by an even constant carries only from those bits.
fn scramble(x: u32, seed: u32) -> u32 {
    // Reversed, the most significant digit is the lowest bit and influences all others by carries.
    let mut x = x.reverse_bits().wrapping_add(seed);
    x ^= x.wrapping_mul(0x6c50_b47c);
    x ^= x.wrapping_mul(0xb82f_1e52);
    x ^= x.wrapping_mul(0xc7af_e638);
    x ^= x.wrapping_mul(0x8d22_f6e6);
    x.reverse_bits()
}

/// An integer hash in which every input bit changes about half of the output bits.
pub(super) fn hash(mut x: u32) -> u32 {
    x ^= x >> 16;
    x = x.wrapping_mul(0x21f0_aaad);
    x ^= x >> 15;
    x = x.wrapping_mul(0xd35a_2d97);
    x ^ (x >> 15)
}

/// The upper 24 bits as a number in [0, 1).
#[allow(clippy::cast_precision_loss, reason = "24 bits fit")]
fn unit(x: u32) -> f32 {
    (x >> 8) as f32 * (1.0 / 16_777_216.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sixteen_points_fill_every_grid_of_sixteen_cells() {
        for pixel in 0..50 {
            let sampler = Sampler::new(pixel, 3);
            for (columns, rows) in [(16_u32, 1_u32), (4, 4), (1, 16), (2, 8)] {
                let mut cells = vec![0; 16];
                for i in 0..16 {
                    let [x, y] = sampler.point(i, 1);
                    let cell = |v: f32, n: u32| (0..n).rfind(|k| v >= *k as f32 / n as f32).expect("in [0, 1)");
                    cells[(cell(y, rows) * columns + cell(x, columns)) as usize] += 1;
                }
                assert!(cells.iter().all(|c| *c == 1), "{columns} x {rows}: {cells:?}");
            }
        }
    }

    #[test]
    fn pixels_and_dimensions_differ() {
        let at = |pixel, dimension| Sampler::new(pixel, 0).point(0, dimension).map(f32::to_bits);
        assert_ne!(at(0, 0), at(1, 0));
        assert_ne!(at(0, 0), at(0, 1));
    }
}
