//! JSON whose floats are plain decimals.

use std::io;

use serde::Serialize;
use serde_json::ser::{Formatter, Serializer};

use osier_base::{Error, Result};

/// Compact JSON whose floats are the shortest decimals that read back to the same f32, without exponent, -0 as 0.
/// # Errors
/// X001 if a number is not finite, which JSON cannot express.
pub(super) fn to_json(value: &impl Serialize) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    let mut serializer = Serializer::with_formatter(&mut bytes, Decimals);
    value.serialize(&mut serializer).map_err(|e| Error::export("X001", format!("glTF document: {e}")))?;
    Ok(bytes)
}

/// Formats f32 without exponent and without a negative zero.
struct Decimals;

impl Formatter for Decimals {
    fn write_f32<W: ?Sized + io::Write>(&mut self, writer: &mut W, value: f32) -> io::Result<()> {
        write!(writer, "{}", value + 0.0)
    }

    // serde_json writes NaN and infinity as null. Absent values are omitted from the document, so null means a bad number.
    fn write_null<W: ?Sized + io::Write>(&mut self, _: &mut W) -> io::Result<()> {
        Err(io::Error::other("a transform or factor is not finite"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn floats_are_shortest_decimals_without_exponent() {
        let text = |v: &[f32]| String::from_utf8(to_json(&v).expect("finite")).expect("utf-8");
        assert_eq!(text(&[0.1, -0.0, 1.0, 1e-7, 3e20]), "[0.1,0,1,0.0000001,300000000000000000000]");
    }

    #[test]
    fn a_number_that_is_not_finite_is_an_error() {
        for bad in [f32::NAN, f32::INFINITY] {
            assert!(matches!(to_json(&[1.0, bad]), Err(Error::Export { code: "X001", .. })));
        }
    }

    proptest::proptest! {
        #[test]
        fn decimals_read_back_to_the_same_bits(bits: u32) {
            let x = f32::from_bits(bits);
            proptest::prop_assume!(x.is_finite());
            let text = String::from_utf8(to_json(&x).expect("finite")).expect("utf-8");
            proptest::prop_assert!(!text.contains('e'));
            proptest::prop_assert_eq!(text.parse::<f32>().expect("number").to_bits(), (x + 0.0).to_bits());
        }
    }
}
