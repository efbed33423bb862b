//! Steps of plane systems of up to 16 maps with AVX2, eight lanes to a register. The results equal those of the scalar
//! loops bit for bit: the same products and sums in the same order.

use std::arch::x86_64::{__m256, __m256i};

use pulp::x86::V3;

use super::lanes::Lanes;
use super::{ChaosGame, Chunk, Coefficients, LANES, TileLayout};

/// Numbers of 32 bits in an AVX2 register.
const WIDTH: usize = 8;
/// Number of registers that are stepped in turn, enough to hide the latency of an addition.
const REGISTERS: usize = 2;

/// Coefficients by map: a b c d e f, each as two registers of eight maps.
struct CoefficientTable {
    low: [[f32; WIDTH]; 6],
    high: [[f32; WIDTH]; 6],
    thresholds: [i32; 15],
    /// Number of thresholds in use.
    count: usize,
}

impl CoefficientTable {
    fn new(game: &ChaosGame) -> Self {
        let mut t = Self { low: [[0.0; WIDTH]; 6], high: [[0.0; WIDTH]; 6], thresholds: [i32::MAX; 15], count: 0 };
        // Maps 0 to 7 go to the low register of each coefficient, 8 to 15 to the high one.
        for (i, c) in game.maps.iter().enumerate() {
            let half = if i < WIDTH { &mut t.low } else { &mut t.high };
            for (row, v) in half.iter_mut().zip([c[0], c[1], c[3], c[4], c[9], c[10]]) {
                row[i % WIDTH] = v;
            }
        }
        let row = game.rows.first().map_or(&[][..], Vec::as_slice);
        t.count = row.len();
        for (to, from) in t.thresholds.iter_mut().zip(row) {
            // A draw has 31 bits, so "at least t" is "more than t - 1" for signed numbers as well; t is at most 2^31.
            *to = from.wrapping_sub(1).cast_signed();
        }
        t
    }
}

/// Fills a chunk. Returns `false` and does nothing without AVX2, and for systems that are not plane, have more than 16
/// maps or have a chaos matrix.
pub(super) fn advance(game: &ChaosGame, lanes: &mut Lanes, chunk: &mut Chunk) -> bool {
    if game.dim != 2 || game.maps.len() > 16 || game.rows.len() != 1 {
        return false;
    }
    let Some(simd) = V3::try_new() else { return false };
    let table = CoefficientTable::new(game);
    if game.maps.len() > WIDTH {
        simd.vectorize(AdvanceKernel::<true> { simd, table: &table, lanes, chunk });
    } else {
        simd.vectorize(AdvanceKernel::<false> { simd, table: &table, lanes, chunk });
    }
    true
}

struct AdvanceKernel<'a, const WIDE: bool> {
    simd: V3,
    table: &'a CoefficientTable,
    lanes: &'a mut Lanes,
    chunk: &'a mut Chunk,
}

/// Generator states and positions of 16 lanes, kept in registers during a chunk.
struct LaneRegisters {
    s: [[__m256i; REGISTERS]; 4],
    x: [__m256; REGISTERS],
    y: [__m256; REGISTERS],
}

#[inline(always)]
fn load_f(row: &[f32; LANES], at: usize) -> __m256 {
    bytemuck::cast::<[f32; WIDTH], _>(std::array::from_fn(|i| row[at + i]))
}

#[inline(always)]
fn load_i(row: &[u32; LANES], at: usize) -> __m256i {
    bytemuck::cast::<[u32; WIDTH], _>(std::array::from_fn(|i| row[at + i]))
}

#[inline(always)]
fn store_f(row: &mut [f32; LANES], at: usize, v: __m256) {
    row[at..at + WIDTH].copy_from_slice(&bytemuck::cast::<_, [f32; WIDTH]>(v));
}

#[inline(always)]
fn store_i(row: &mut [u32; LANES], at: usize, v: __m256i) {
    row[at..at + WIDTH].copy_from_slice(&bytemuck::cast::<_, [u32; WIDTH]>(v));
}

impl<const WIDE: bool> pulp::NullaryFnOnce for AdvanceKernel<'_, WIDE> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { simd, table, lanes, chunk } = self;
        for part in 0..LANES / (WIDTH * REGISTERS) {
            // State of 16 lanes in registers for all steps of the chunk.
            let at = |k: usize| (part * REGISTERS + k) * WIDTH;
            let mut p = LaneRegisters {
                s: std::array::from_fn(|w| std::array::from_fn(|k| load_i(&lanes.s[w], at(k)))),
                x: std::array::from_fn(|k| load_f(&lanes.x, at(k))),
                y: std::array::from_fn(|k| load_f(&lanes.y, at(k))),
            };
            let mut map = [simd.avx._mm256_set1_epi32(0); REGISTERS];
            for step in 0..chunk.steps {
                for k in 0..REGISTERS {
                    // Two independent chains alternate, so that one computes while the other waits for its additions.
                    map[k] = pick(simd, table, draw(simd, &mut p.s, k));
                    apply_map::<WIDE>(simd, table, map[k], &mut p.x[k], &mut p.y[k]);
                    store_f(&mut chunk.x[step], at(k), p.x[k]);
                    store_f(&mut chunk.y[step], at(k), p.y[k]);
                    store_i(&mut chunk.map[step], at(k), map[k]);
                }
            }
            for k in 0..REGISTERS {
                for w in 0..4 {
                    store_i(&mut lanes.s[w], at(k), p.s[w][k]);
                }
                store_f(&mut lanes.x, at(k), p.x[k]);
                store_f(&mut lanes.y, at(k), p.y[k]);
                if chunk.steps > 0 {
                    store_i(&mut lanes.map, at(k), map[k]);
                }
            }
        }
        // z stays 0 in the plane.
    }
}

/// Eight draws of 31 bits.
#[inline(always)]
fn draw(simd: V3, s: &mut [[__m256i; REGISTERS]; 4], k: usize) -> __m256i {
    let i = simd.avx2;
    let [mut a, mut b, mut c, mut d] = [s[0][k], s[1][k], s[2][k], s[3][k]];
    // xoshiro128+ on eight lanes, the same steps as in `Lanes::draw`.
    let result = i._mm256_add_epi32(a, d);
    let t = i._mm256_slli_epi32::<9>(b);
    c = i._mm256_xor_si256(c, a);
    d = i._mm256_xor_si256(d, b);
    b = i._mm256_xor_si256(b, c);
    a = i._mm256_xor_si256(a, d);
    c = i._mm256_xor_si256(c, t);
    d = i._mm256_or_si256(i._mm256_slli_epi32::<11>(d), i._mm256_srli_epi32::<21>(d));
    (s[0][k], s[1][k], s[2][k], s[3][k]) = (a, b, c, d);
    i._mm256_srli_epi32::<1>(result)
}

/// Indices of eight maps: for each draw the number of thresholds that it reaches.
#[inline(always)]
fn pick(simd: V3, table: &CoefficientTable, draw: __m256i) -> __m256i {
    let mut map = simd.avx._mm256_set1_epi32(0);
    for t in table.thresholds.iter().take(table.count) {
        let reached = simd.avx2._mm256_cmpgt_epi32(draw, simd.avx._mm256_set1_epi32(*t));
        // A comparison that holds gives -1: subtracting it adds one for each threshold reached.
        map = simd.avx2._mm256_sub_epi32(map, reached);
    }
    map
}

#[inline(always)]
fn coefficient<const WIDE: bool>(simd: V3, table: &CoefficientTable, which: usize, map: __m256i) -> __m256 {
    // A register of eight coefficients is a lookup table: permute selects by the low three bits of the map.
    let low = simd.avx2._mm256_permutevar8x32_ps(bytemuck::cast(table.low[which]), map);
    if !WIDE {
        return low;
    }
    let high = simd.avx2._mm256_permutevar8x32_ps(bytemuck::cast(table.high[which]), map);
    // The sign bit of map shifted up is its bit 3.
    let side = simd.avx2._mm256_slli_epi32::<28>(map);
    simd.avx._mm256_blendv_ps(low, high, bytemuck::cast(side))
}

#[inline(always)]
fn apply_map<const WIDE: bool>(simd: V3, table: &CoefficientTable, map: __m256i, x: &mut __m256, y: &mut __m256) {
    let i = simd.avx;
    let c = |which: usize| coefficient::<WIDE>(simd, table, which, map);
    let sum = |a: __m256, b: __m256, e: __m256| {
        i._mm256_add_ps(i._mm256_add_ps(i._mm256_mul_ps(a, *x), i._mm256_mul_ps(b, *y)), e)
    };
    let (next_x, next_y) = (sum(c(0), c(1), c(4)), sum(c(2), c(3), c(5)));
    (*x, *y) = (next_x, next_y);
}

/// AVX2 variant of [`super::images`]. Returns `false` and does nothing without AVX2.
pub(super) fn images(map: &Coefficients, place: [&[f32]; 3], layout: TileLayout, out: &mut [u32]) -> bool {
    let Some(simd) = V3::try_new() else { return false };
    if place[2].is_empty() {
        simd.vectorize(ImageKernel::<false> { simd, map, place, layout, out });
    } else {
        simd.vectorize(ImageKernel::<true> { simd, map, place, layout, out });
    }
    true
}

struct ImageKernel<'a, const DEEP: bool> {
    simd: V3,
    map: &'a Coefficients,
    place: [&'a [f32]; 3],
    layout: TileLayout,
    out: &'a mut [u32],
}

impl<const DEEP: bool> pulp::NullaryFnOnce for ImageKernel<'_, DEEP> {
    type Output = ();

    #[inline(always)]
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_possible_wrap,
        clippy::cast_precision_loss,
        reason = "sides of a picture"
    )]
    fn call(self) {
        let Self { simd, map, place, layout, out } = self;
        let (i, i2) = (simd.avx, simd.avx2);
        let (w, h) = (i._mm256_set1_ps(layout.width as f32), i._mm256_set1_ps(layout.height as f32));
        let across = i._mm256_set1_epi32(layout.across() as i32);
        let (within_tile, outside) = (i._mm256_set1_epi32(31), i._mm256_set1_epi32(layout.outside() as i32));
        let zero = i._mm256_set1_ps(0.0);
        let c = map.map(|v| i._mm256_set1_ps(v));
        // Ordered comparisons are false for NaN.
        let within =
            |v: __m256, end: __m256| i._mm256_and_ps(i._mm256_cmp_ps::<13>(v, zero), i._mm256_cmp_ps::<1>(v, end));
        let (full, rest) = out.split_at_mut(out.len() / WIDTH * WIDTH);
        let eight = place.map(|p| p.as_chunks::<WIDTH>().0);
        for (at, out) in full.as_chunks_mut::<WIDTH>().0.iter_mut().enumerate() {
            let p: [__m256; 2] = [bytemuck::cast(eight[0][at]), bytemuck::cast(eight[1][at])];
            let image = |r: usize| {
                let flat = i._mm256_add_ps(i._mm256_mul_ps(c[r * 3], p[0]), i._mm256_mul_ps(c[r * 3 + 1], p[1]));
                if !DEEP {
                    return i._mm256_add_ps(flat, c[9 + r]);
                }
                let z = i._mm256_mul_ps(c[r * 3 + 2], bytemuck::cast(eight[2][at]));
                i._mm256_add_ps(i._mm256_add_ps(flat, z), c[9 + r])
            };
            let (x, y) = (image(0), image(1));
            let inside = i._mm256_and_ps(within(x, w), within(y, h));
            let (x, y) = (i._mm256_cvttps_epi32(x), i._mm256_cvttps_epi32(y));
            // Cell index of the tile layout: tile number, row within the tile, column within the tile.
            let tile = i2._mm256_mullo_epi32(i2._mm256_srli_epi32::<5>(y), across);
            let tile = i2._mm256_add_epi32(tile, i2._mm256_srli_epi32::<5>(x));
            let line = i2._mm256_slli_epi32::<5>(i2._mm256_and_si256(y, within_tile));
            let cell = i2._mm256_or_si256(line, i2._mm256_and_si256(x, within_tile));
            let index = i2._mm256_or_si256(i2._mm256_slli_epi32::<10>(tile), cell);
            *out = bytemuck::cast(i._mm256_blendv_ps(bytemuck::cast(outside), bytemuck::cast(index), inside));
        }
        // The rest of fewer than eight points takes the scalar loop.
        let done = full.len();
        super::lanes::images(map, place.map(|p| p.get(done..).unwrap_or(&[])), layout, rest);
    }
}
