//! Integers of a crate file: deltas, two-bit codes, LZ4.

/// Integers that the code packs: 32 or 64 bits wide.
trait CodedInteger: Copy + Ord {
    const ZERO: Self;
    fn minus(self, other: Self) -> Self;
    /// Code (1, 2 or 3) and bytes of the narrowest form.
    fn narrow(self) -> (u8, [u8; 8], usize);
    fn put(self, out: &mut Vec<u8>);
}

fn wide<const N: usize>(bytes: [u8; N]) -> [u8; 8] {
    let mut out = [0; 8];
    out[..N].copy_from_slice(&bytes);
    out
}

impl CodedInteger for i32 {
    const ZERO: Self = 0;

    fn minus(self, other: Self) -> Self {
        self.wrapping_sub(other)
    }

    fn narrow(self) -> (u8, [u8; 8], usize) {
        if let Ok(x) = i8::try_from(self) {
            (1, wide(x.to_le_bytes()), 1)
        } else if let Ok(x) = i16::try_from(self) {
            (2, wide(x.to_le_bytes()), 2)
        } else {
            (3, wide(self.to_le_bytes()), 4)
        }
    }

    fn put(self, out: &mut Vec<u8>) {
        out.extend_from_slice(&self.to_le_bytes());
    }
}

impl CodedInteger for i64 {
    const ZERO: Self = 0;

    fn minus(self, other: Self) -> Self {
        self.wrapping_sub(other)
    }

    fn narrow(self) -> (u8, [u8; 8], usize) {
        if let Ok(x) = i16::try_from(self) {
            (1, wide(x.to_le_bytes()), 2)
        } else if let Ok(x) = i32::try_from(self) {
            (2, wide(x.to_le_bytes()), 4)
        } else {
            (3, self.to_le_bytes(), 8)
        }
    }

    fn put(self, out: &mut Vec<u8>) {
        out.extend_from_slice(&self.to_le_bytes());
    }
}

/// The commonest delta; of equally common ones the largest.
fn most_common_delta<W: CodedInteger>(deltas: &[W]) -> W {
    let mut sorted = deltas.to_vec();
    sorted.sort_unstable();
    let mut best = (W::ZERO, 0);
    for run in sorted.chunk_by(|a, b| a == b) {
        if run.len() >= best.1 {
            best = (run.first().copied().unwrap_or(W::ZERO), run.len());
        }
    }
    best.0
}

fn delta_encode<W: CodedInteger>(values: &[W]) -> Vec<u8> {
    let mut last = W::ZERO;
    let deltas: Vec<W> = values.iter().map(|v| v.minus(std::mem::replace(&mut last, *v))).collect();
    let common = most_common_delta(&deltas);
    let mut out = Vec::with_capacity(values.len() * 2 + 8);
    common.put(&mut out);
    let codes = out.len();
    out.resize(codes + values.len().div_ceil(4), 0);
    for (i, d) in deltas.iter().enumerate().filter(|(_, d)| **d != common) {
        let (code, bytes, n) = d.narrow();
        out[codes + i / 4] |= code << (2 * (i % 4));
        out.extend_from_slice(&bytes[..n]);
    }
    out
}

/// One LZ4 block behind the byte that says "one block".
pub(super) fn lz4_block(bytes: &[u8]) -> Vec<u8> {
    let mut out = vec![0];
    out.extend_from_slice(&lz4_flex::block::compress(bytes));
    out
}

/// 32-bit integers, compressed.
pub(super) fn compress_i32(values: &[i32]) -> Vec<u8> {
    lz4_block(&delta_encode(values))
}

/// 64-bit integers, compressed.
pub(super) fn compress_i64(values: &[i64]) -> Vec<u8> {
    lz4_block(&delta_encode(values))
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
