//! Numbers as text for the readable formats: the shortest decimal that reads back to the same `f32`, without exponent, with `.`
//! as separator, `0` for minus zero.
//!
//! ```
//! use osier_export::text::TextBuffer;
//!
//! let mut text = TextBuffer::default();
//! text.put("v ").list(&[0.1, -0.0, 1e-7], " ").put("\n");
//! assert_eq!(text.bytes(), b"v 0.1 0 0.0000001\n");
//! assert!(text.is_finite() && !text.num(f32::NAN).is_finite());
//! ```

/// A text that is being written. It records whether every number in it was finite.
#[derive(Debug, Clone)]
pub struct TextBuffer {
    bytes: Vec<u8>,
    finite: bool,
}

impl Default for TextBuffer {
    fn default() -> Self {
        Self { bytes: Vec::new(), finite: true }
    }
}

impl TextBuffer {
    /// An empty text that takes `bytes` bytes before it allocates again.
    pub fn with_capacity(bytes: usize) -> Self {
        Self { bytes: Vec::with_capacity(bytes), finite: true }
    }

    /// Appends a string unchanged.
    pub fn put(&mut self, s: &str) -> &mut Self {
        self.bytes.extend_from_slice(s.as_bytes());
        self
    }

    /// Appends a number. NaN and infinity append `0`, and [`Self::is_finite`] is false from then on.
    pub fn num(&mut self, v: f32) -> &mut Self {
        if v == 0.0 {
            self.bytes.push(b'0');
        } else if v.is_finite() {
            append_decimal(&mut self.bytes, v);
        } else {
            self.bytes.push(b'0');
            self.finite = false;
        }
        self
    }

    /// Appends an integer in decimal, without separators.
    pub fn int(&mut self, v: impl Into<u64>) -> &mut Self {
        // Digits from the last one backwards; u64 has at most 20.
        let mut digits = [0_u8; 20];
        let mut first = digits.len();
        let mut rest = v.into();
        loop {
            first -= 1;
            digits[first] = b'0' + (rest % 10) as u8;
            rest /= 10;
            if rest == 0 {
                break;
            }
        }
        self.bytes.extend_from_slice(&digits[first..]);
        self
    }

    /// Appends numbers as [`Self::num`] does, with `separator` between them but not at the ends.
    pub fn list(&mut self, values: &[f32], separator: &str) -> &mut Self {
        for (i, v) in values.iter().enumerate() {
            if i > 0 {
                self.put(separator);
            }
            self.num(*v);
        }
        self
    }

    /// Appends another text; if it contains a number that was not finite, this text does too.
    pub fn append(&mut self, other: &Self) -> &mut Self {
        self.bytes.extend_from_slice(&other.bytes);
        self.finite &= other.finite;
        self
    }

    /// Appends what `line` writes for each item and its index, in parallel, in the order of the items.
    /// `line` writes line breaks itself.
    pub fn lines<T: Sync>(&mut self, items: &[T], line: impl Fn(&mut Self, usize, &T) + Sync + Send) -> &mut Self {
        // Each chunk is formatted in a separate buffer, and the buffers are joined in order: the text does not
        // depend on the number of threads.
        let parts = osier_base::par::par_chunks(items, osier_base::par::CHUNK, |first, chunk| {
            let mut part = Self::with_capacity(chunk.len() * 36);
            for (k, item) in chunk.iter().enumerate() {
                line(&mut part, first + k, item);
            }
            part
        });
        self.bytes.reserve(parts.iter().map(Self::len).sum());
        for part in &parts {
            self.append(part);
        }
        self
    }

    /// The text as bytes; UTF-8, as it is made of strings and digits.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// Number of bytes appended so far.
    pub fn len(&self) -> usize {
        self.bytes.len()
    }

    /// True until a byte is appended; an empty string appends none.
    pub fn is_empty(&self) -> bool {
        self.bytes.is_empty()
    }

    /// False if a NaN or an infinity was appended.
    pub fn is_finite(&self) -> bool {
        self.finite
    }
}

/// Formats a number for `format!` in the same notation. NaN and infinity print as `0`: check them before.
#[derive(Debug, Clone, Copy)]
pub struct Decimal(pub f32);

impl std::fmt::Display for Decimal {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let mut text = TextBuffer::with_capacity(16);
        text.num(self.0);
        f.write_str(std::str::from_utf8(text.bytes()).unwrap_or("0"))
    }
}

/// Appends a decimal without exponent. `v`: finite, not zero. ryu uses an exponent outside of 1e-5 to 1e12.
fn append_decimal(out: &mut Vec<u8>, v: f32) {
    let mut buffer = ryu::Buffer::new();
    let digits = buffer.format_finite(v).as_bytes();
    let size = v.abs();
    if (1e-5..1e12).contains(&size) {
        out.extend_from_slice(digits.strip_suffix(b".0").unwrap_or(digits));
    } else {
        expand_exponent(out, digits);
    }
}

/// Appends ryu's digits without the exponent: `1.234e-7` as `0.0000001234`, `1.5e20` as `150000000000000000000`.
fn expand_exponent(out: &mut Vec<u8>, digits: &[u8]) {
    let split = digits.iter().position(|c| *c == b'e');
    let (mantissa, exponent) = match split {
        Some(at) => (&digits[..at], std::str::from_utf8(&digits[at + 1..]).ok().and_then(|e| e.parse::<i32>().ok())),
        None => (digits, Some(0)),
    };
    let exponent = exponent.unwrap_or(0);
    let mantissa = match mantissa.strip_prefix(b"-") {
        Some(rest) => {
            out.push(b'-');
            rest
        }
        None => mantissa,
    };
    let mantissa = mantissa.strip_suffix(b".0").unwrap_or(mantissa);
    // The decimal point goes behind the integer digits of the mantissa, moved by the exponent: into, before or behind the digits.
    let integer_digits = mantissa.iter().take_while(|c| **c != b'.').fold(0_i32, |n, _| n + 1);
    let plain: Vec<u8> = mantissa.iter().copied().filter(|c| *c != b'.').collect();
    let point = integer_digits + exponent;
    let Ok(before) = usize::try_from(point) else {
        out.extend_from_slice(b"0.");
        out.extend(std::iter::repeat_n(b'0', point.unsigned_abs() as usize));
        out.extend_from_slice(&plain);
        return;
    };
    if before == 0 {
        out.extend_from_slice(b"0.");
        out.extend_from_slice(&plain);
    } else if before >= plain.len() {
        out.extend_from_slice(&plain);
        out.extend(std::iter::repeat_n(b'0', before - plain.len()));
    } else {
        out.extend_from_slice(&plain[..before]);
        out.push(b'.');
        out.extend_from_slice(&plain[before..]);
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn show(v: f32) -> String {
        Decimal(v).to_string()
    }

    #[test]
    fn edges() {
        let cases = [
            (0.0, "0"),
            (-0.0, "0"),
            (1.0, "1"),
            (-0.5, "-0.5"),
            (1e-5, "0.00001"),
            (1.25e-7, "0.000000125"),
            (1e12, "1000000000000"),
            (1.5e20, "150000000000000000000"),
            (16_777_216.0, "16777216"),
        ];
        for (v, s) in cases {
            assert_eq!(show(v), s);
        }
        let mut t = TextBuffer::default();
        assert!(t.int(0_u32).put(" ").int(u32::MAX).is_finite());
        assert_eq!(t.bytes(), b"0 4294967295");
        assert!(!t.num(f32::NAN).is_finite());
    }

    proptest! {
        #[test]
        fn every_float_reads_back_and_is_as_short_as_can_be(bits: u32) {
            let v = f32::from_bits(bits);
            prop_assume!(v.is_finite() && v != 0.0);
            let s = show(v);
            prop_assert_eq!(s.parse::<f32>().expect("a number").to_bits(), bits);
            prop_assert!(!s.contains('e'));
            prop_assert_eq!(s.len(), format!("{v}").len());
        }
    }
}
