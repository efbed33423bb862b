//! Compression of integer arrays in crate files: delta coding with two-bit width codes, then LZ4.
//!
//! A coded array is the most common delta d0 (full width), then a two-bit code for each value, four to a byte and lowest bits
//! first, then the explicit deltas in order. Code 0: the delta is d0 and takes no bytes; codes 1, 2, 3: it follows in 1, 2 or 4
//! bytes for 32-bit values and in 2, 4 or 8 bytes for 64-bit values, little endian and signed. The first delta is against 0.
//! Source: `pxr/usd/sdf/integerCoding.h` of OpenUSD.

/// A delta of 32 or 64 bits.
trait CodedInteger: Copy + Ord {
    const ZERO: Self;
    /// `self` - `other` modulo 2^bits, as the decoder's running sum wraps, too.
    fn wrapping_delta(self, other: Self) -> Self;
    /// Width code (1, 2 or 3), little-endian bytes and their number in the narrowest width that holds the value.
    fn narrowest(self) -> (u8, [u8; 8], usize);
    /// Appends the value at full width.
    fn push_le(self, out: &mut Vec<u8>);
}

/// Zero-pads to eight bytes.
fn zero_extend<const N: usize>(bytes: [u8; N]) -> [u8; 8] {
    let mut out = [0; 8];
    out[..N].copy_from_slice(&bytes);
    out
}

impl CodedInteger for i32 {
    const ZERO: Self = 0;

    fn wrapping_delta(self, other: Self) -> Self {
        self.wrapping_sub(other)
    }

    fn narrowest(self) -> (u8, [u8; 8], usize) {
        // The width in bytes is 1, 2 or 4 here and twice that for 64-bit values.
        if let Ok(x) = i8::try_from(self) {
            (1, zero_extend(x.to_le_bytes()), 1)
        } else if let Ok(x) = i16::try_from(self) {
            (2, zero_extend(x.to_le_bytes()), 2)
        } else {
            (3, zero_extend(self.to_le_bytes()), 4)
        }
    }

    fn push_le(self, out: &mut Vec<u8>) {
        out.extend_from_slice(&self.to_le_bytes());
    }
}

impl CodedInteger for i64 {
    const ZERO: Self = 0;

    fn wrapping_delta(self, other: Self) -> Self {
        self.wrapping_sub(other)
    }

    fn narrowest(self) -> (u8, [u8; 8], usize) {
        if let Ok(x) = i16::try_from(self) {
            (1, zero_extend(x.to_le_bytes()), 2)
        } else if let Ok(x) = i32::try_from(self) {
            (2, zero_extend(x.to_le_bytes()), 4)
        } else {
            (3, self.to_le_bytes(), 8)
        }
    }

    fn push_le(self, out: &mut Vec<u8>) {
        out.extend_from_slice(&self.to_le_bytes());
    }
}

/// The most frequent delta; of equally frequent ones the largest, as OpenUSD chooses it.
fn most_common_delta<W: CodedInteger>(deltas: &[W]) -> W {
    let mut sorted = deltas.to_vec();
    // Equal deltas become runs: counting them this way needs no map.
    sorted.sort_unstable();
    let mut best = (W::ZERO, 0);
    for run in sorted.chunk_by(|a, b| a == b) {
        // Runs come in increasing order of their value, so `>=` lets the largest of equally frequent deltas win.
        if run.len() >= best.1 {
            best = (run.first().copied().unwrap_or(W::ZERO), run.len());
        }
    }
    best.0
}

/// The coded form of an array before LZ4, with the layout described above: common delta, width codes, other deltas.
fn delta_encode<W: CodedInteger>(values: &[W]) -> Vec<u8> {
    let mut last = W::ZERO;
    // d[i] = v[i] - v[i - 1], with v[-1] = 0. Ids that count up become ones, which the common delta encodes in two bits.
    let deltas: Vec<W> = values.iter().map(|v| v.wrapping_delta(std::mem::replace(&mut last, *v))).collect();
    let common = most_common_delta(&deltas);
    let mut out = Vec::with_capacity(values.len() * 2 + 8);
    common.push_le(&mut out);
    // The codes start as zeros, so only deltas other than the common one are written: their code into the two bits of value i,
    // their bytes at the end.
    let codes = out.len();
    out.resize(codes + values.len().div_ceil(4), 0);
    for (i, d) in deltas.iter().enumerate().filter(|(_, d)| **d != common) {
        let (code, bytes, n) = d.narrowest();
        out[codes + i / 4] |= code << (2 * (i % 4));
        out.extend_from_slice(&bytes[..n]);
    }
    out
}

/// Bytes in the framing of OpenUSD's `TfFastCompression`: the number of further chunks (0, as inputs stay below LZ4's limit of
/// 2 GiB), then one raw LZ4 block.
pub(super) fn fast_compress(bytes: &[u8]) -> Vec<u8> {
    let mut out = vec![0];
    out.extend_from_slice(&lz4_flex::block::compress(bytes));
    out
}

/// 32-bit integers (`int[]`, and every column of the structural sections), delta coded and LZ4 compressed.
pub(super) fn compress_i32(values: &[i32]) -> Vec<u8> {
    fast_compress(&delta_encode(values))
}

/// 64-bit integers (`int64[]`), delta coded and LZ4 compressed.
pub(super) fn compress_i64(values: &[i64]) -> Vec<u8> {
    fast_compress(&delta_encode(values))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_code_is_the_documented_one() {
        // Deltas 123, 1, 1, 1, 100, 0, 0, 0, -223, 100000: the commonest is 1 or 0, each three times, so 1.
        let got = delta_encode(&[123, 124, 125, 126, 226, 226, 226, 226, 3, 100_003]);
        let mut want = 1_i32.to_le_bytes().to_vec();
        want.extend([0b00_00_00_01, 0b01_01_01_01, 0b00_00_11_10]);
        want.extend([123, 100, 0, 0, 0]);
        want.extend((-223_i16).to_le_bytes());
        want.extend(100_000_i32.to_le_bytes());
        assert_eq!(got, want);
    }

    #[test]
    fn wide_integers_have_their_own_widths() {
        let got = delta_encode(&[5_i64, 5, 5, 70_005]);
        let mut want = 0_i64.to_le_bytes().to_vec();
        want.extend([0b10_00_00_01]);
        want.extend(5_i16.to_le_bytes());
        want.extend(70_000_i32.to_le_bytes());
        assert_eq!(got, want);
    }

    #[test]
    fn compressed_bytes_come_back() {
        let values: Vec<i32> = (0..1000).map(|i| (i * i) % 77).collect();
        let packed = compress_i32(&values);
        assert_eq!(packed[0], 0);
        let raw = lz4_flex::block::decompress(&packed[1..], 10_000).expect("lz4");
        assert_eq!(raw, delta_encode(&values));
    }
}
