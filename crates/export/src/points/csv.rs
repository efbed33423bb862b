//! Record tables as CSV that Blender's node Import CSV reads without loss: a column whose first fields look like whole numbers
//! becomes integers, one with an exponent, a missing digit or a number beyond 32 bits vanishes.

use osier_base::par::par_map;
use osier_base::{Error, Result};
use osier_scene::{ColumnValues, RecordColumn, RecordTable};

use crate::usd::UpAxis;

const ROWS_PER_TASK: usize = 4096;
/// Most digits behind the point: numbers below 5e-13 become 0.
const MAX_DECIMALS: usize = 12;
/// Powers of ten from 0 to [`MAX_DECIMALS`], all exact in f64.
const POWERS: [f64; MAX_DECIMALS + 1] = [1.0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12];
/// Largest scaled number that is formatted by integer arithmetic: 17 digits.
const MAX_SCALED: f64 = 1e17;

/// A table as text: a header with the names of the columns, then a line per record. Vectors, recognised as columns whose names
/// end in x, y and z after the same prefix, are converted to the axes of the file.
/// # Errors
/// X001 for a number that is not finite, X010 for an integer beyond 32 bits with a sign.
pub(super) fn csv_text(table: &RecordTable, up: UpAxis) -> Result<String> {
    let columns: Vec<Column<'_>> = table.columns.iter().map(|c| Column::new(table, c, up)).collect();
    let names: Vec<&str> = table.columns.iter().map(|c| c.name).collect();
    // Tasks have a fixed number of rows, joined in order: the text does not depend on the number of threads.
    let starts: Vec<usize> = (0..table.len()).step_by(ROWS_PER_TASK).collect();
    let parts = par_map(&starts, |start| {
        let mut text = String::new();
        for row in *start..(start + ROWS_PER_TASK).min(table.len()) {
            for (k, column) in columns.iter().enumerate() {
                if k > 0 {
                    text.push(',');
                }
                column.push_field(row, &mut text)?;
            }
            text.push('\n');
        }
        Ok::<_, Error>(text)
    });
    let mut text = names.join(",") + "\n";
    for part in parts {
        text += &part?;
    }
    Ok(text)
}

struct Column<'a> {
    table: &'static str,
    name: &'static str,
    /// Values of the source column in the scene's axes: with +Z up, y and z of a vector are exchanged.
    values: &'a ColumnValues,
    /// Whether the file holds the values times -1: with +Z up, (x, y, z) of the scene becomes (x, -z, y).
    is_negated: bool,
}

impl<'a> Column<'a> {
    fn new(table: &'a RecordTable, column: &'a RecordColumn, up: UpAxis) -> Self {
        let named = |name: String| table.columns.iter().find(|c| c.name == name);
        // (x, y, z) with Y up becomes (x, -z, y) with Z up; the vector part of a quaternion likewise.
        let swapped = match (up, column.name.split_at(column.name.len().saturating_sub(1))) {
            (UpAxis::Z, (prefix, "y")) => named(format!("{prefix}z")).map(|z| (z, true)),
            (UpAxis::Z, (prefix, "z")) => named(format!("{prefix}y")).map(|y| (y, false)),
            _ => None,
        };
        let (source, is_negated) = swapped.unwrap_or((column, false));
        Self { table: table.name, name: column.name, values: &source.values, is_negated }
    }

    fn push_field(&self, row: usize, text: &mut String) -> Result<()> {
        let sign = if self.is_negated { -1.0 } else { 1.0 };
        let not_finite = || {
            let message = format!("points/{}, column {}, row {row}: not a finite number", self.table, self.name);
            Error::export("X001", message)
        };
        match self.values {
            ColumnValues::F32(v) => push_decimal(sign * f64::from(v[row]), text).ok_or_else(not_finite),
            ColumnValues::F64(v) => push_decimal(sign * v[row], text).ok_or_else(not_finite),
            ColumnValues::I32(v) => {
                text.push_str(&v[row].to_string());
                Ok(())
            }
            ColumnValues::U32(v) => {
                let Ok(value) = i32::try_from(v[row]) else {
                    let message = format!(
                        "points/{}, column {}: {} is beyond the integers of 32 bits that readers have",
                        self.table, self.name, v[row]
                    );
                    return Err(Error::export("X010", message));
                };
                text.push_str(&value.to_string());
                Ok(())
            }
        }
    }
}

/// Appends a number with at least six significant digits, as far as [`MAX_DECIMALS`] allows, without an exponent, with
/// digits on both sides of the point and without trailing zeros. `None` if it is not finite.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "checked against MAX_SCALED")]
fn push_decimal(value: f64, text: &mut String) -> Option<()> {
    if !value.is_finite() {
        return None;
    }
    let size = value.abs();
    // The fewest decimals, at least one, with which the number has six digits after rounding.
    let decimals = (1..MAX_DECIMALS).find(|d| size * POWERS[*d] >= 99_999.5).unwrap_or(MAX_DECIMALS);
    let scaled = (size * POWERS[decimals]).round();
    if scaled >= MAX_SCALED {
        text.push_str(&format!("{value:.1}"));
        return Some(());
    }
    // Removes zeros at the end, but keeps one decimal, by which Blender recognises floats.
    let mut digits = scaled as u64;
    let mut decimals = decimals;
    while decimals > 1 && digits.is_multiple_of(10) {
        digits /= 10;
        decimals -= 1;
    }
    // Minus zero, and numbers that round to it, are written as zero.
    if value < 0.0 && digits > 0 {
        text.push('-');
    }
    let unit = 10_u64.pow(decimals as u32);
    text.push_str(&format!("{}.{:0decimals$}", digits / unit, digits % unit));
    Some(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn decimal(value: f64) -> String {
        let mut text = String::new();
        push_decimal(value, &mut text).expect("finite");
        text
    }

    #[test]
    fn numbers_have_digits_on_both_sides_of_the_point_and_no_exponent() {
        let cases = [
            (0.0, "0.0"),
            (-0.0, "0.0"),
            (1.0, "1.0"),
            (-0.5, "-0.5"),
            (0.1_f32.into(), "0.1"),
            (1e-9, "0.000000001"),
            (-4e-13, "0.0"),
            (123_456.789, "123456.8"),
            (1.0 / 3.0, "0.333333"),
            (9.999_999_9, "10.0"),
            (0.000_123_456_78, "0.000123457"),
            (1e20, "100000000000000000000.0"),
        ];
        for (value, expected) in cases {
            assert_eq!(decimal(value), expected, "{value}");
        }
        assert_eq!(push_decimal(f64::NAN, &mut String::new()), None);
    }

    #[test]
    fn vectors_and_rotations_are_turned_and_scalars_are_not() {
        let one = [0_u8];
        let value = |name, v: f32| RecordColumn::f32(name, "", &one, move |_| v);
        let columns = vec![
            RecordColumn::u32("id", "", &one, |_| 7),
            value("x", 1.0),
            value("y", 2.0),
            value("z", 3.0),
            value("qw", 0.5),
            value("qx", 0.25),
            value("qy", 0.125),
            value("qz", -0.75),
            value("shady", 9.0),
        ];
        let table = RecordTable { name: "things", columns };
        let text = csv_text(&table, UpAxis::Z).expect("text");
        assert_eq!(text, "id,x,y,z,qw,qx,qy,qz,shady\n7,1.0,-3.0,2.0,0.5,0.25,0.75,0.125,9.0\n");
        let text = csv_text(&table, UpAxis::Y).expect("text");
        assert_eq!(text.lines().nth(1), Some("7,1.0,2.0,3.0,0.5,0.25,0.125,-0.75,9.0"));
    }

    #[test]
    fn what_readers_would_lose_is_an_error() {
        let one = [0_u8];
        let table = |column| RecordTable { name: "things", columns: vec![column] };
        let large = table(RecordColumn::u32("id", "", &one, |_| u32::MAX));
        assert!(csv_text(&large, UpAxis::Y).is_err_and(|e| e.to_string().contains("beyond")));
        let broken = table(RecordColumn::f64("x", "", &one, |_| f64::INFINITY));
        assert!(csv_text(&broken, UpAxis::Y).is_err_and(|e| e.to_string().contains("finite")));
    }
}
