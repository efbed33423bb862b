//! Numbers as files write them: finite decimals and nothing else.

/// Why a word is not a number.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum NumberError {
    /// Anything but digits, point, sign and exponent; also `nan` and `inf`.
    #[error("expected a number such as 0.25 or -1e3")]
    Malformed,
    /// A comma as decimal sign: `1,5`.
    #[error("the decimal sign is a point, not a comma")]
    Comma,
    /// Larger than the largest double.
    #[error("the number is too large")]
    TooLarge,
}

/// Reads `[+-] digits [. digits] [e [+-] digits]`, with digits before or after the point, no spaces.
/// Returns a finite value.
/// # Errors
/// Anything else; Rust's own parser would take `nan`, `inf` and `1e999`.
pub fn number(word: &str) -> Result<f64, NumberError> {
    let bytes = word.strip_prefix(['+', '-']).unwrap_or(word).as_bytes();
    let digits = |from: usize| bytes.iter().skip(from).take_while(|b| b.is_ascii_digit()).count();
    let whole = digits(0);
    let mut end = whole;
    let mut fraction = 0;
    if bytes.get(end) == Some(&b'.') {
        fraction = digits(end + 1);
        end += 1 + fraction;
    }
    // A point alone is no number; `.5` and `5.` are.
    if whole + fraction == 0 {
        return Err(NumberError::Malformed);
    }
    if matches!(bytes.get(end), Some(b'e' | b'E')) {
        let sign = usize::from(matches!(bytes.get(end + 1), Some(b'+' | b'-')));
        let exponent = digits(end + 1 + sign);
        if exponent == 0 {
            return Err(NumberError::Malformed);
        }
        end += 1 + sign + exponent;
    }
    match bytes.get(end) {
        None => {}
        Some(b',') if bytes.get(end + 1).is_some_and(u8::is_ascii_digit) => return Err(NumberError::Comma),
        Some(_) => return Err(NumberError::Malformed),
    }
    // The grammar is checked above; the conversion rounds correctly and gives infinity beyond the largest double.
    let value: f64 = word.parse().map_err(|_| NumberError::Malformed)?;
    if value.is_finite() { Ok(value) } else { Err(NumberError::TooLarge) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_grammar_is_finite_decimals() {
        for (word, value) in [("1", 1.0), ("-0.5", -0.5), (".5", 0.5), ("5.", 5.0), ("+1e3", 1000.0), ("1E-2", 0.01)] {
            assert_eq!(number(word), Ok(value), "{word}");
        }
        use NumberError::{Comma, Malformed, TooLarge};
        let cases = [
            ("nan", Malformed),
            ("inf", Malformed),
            ("-Infinity", Malformed),
            ("1e999", TooLarge),
            ("1,5", Comma),
            ("", Malformed),
            ("-", Malformed),
            (".", Malformed),
            ("1e", Malformed),
            ("1e+", Malformed),
            ("0x10", Malformed),
            ("1_000", Malformed),
            ("1 ", Malformed),
            ("--1", Malformed),
            ("1f", Malformed),
            ("\u{661}", Malformed),
        ];
        for (word, why) in cases {
            assert_eq!(number(word), Err(why), "{word}");
        }
    }

    proptest::proptest! {
        #[test]
        fn what_rust_prints_is_read_back(x in proptest::num::f64::NORMAL) {
            proptest::prop_assert_eq!(number(&format!("{x:e}")).map(f64::to_bits), Ok(x.to_bits()));
        }

        #[test]
        fn any_text_is_answered(s in "\\PC*") {
            let _ = number(&s);
        }
    }
}
