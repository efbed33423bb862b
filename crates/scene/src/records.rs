//! Record tables: what a simulation knows of each of its elements at a frame, as rows of typed numbers for other programs.
//!
//! ```
//! use osier_scene::{RecordColumn, RecordTable};
//!
//! struct Flake { id: u32, mass: f64 }
//! let flakes = [Flake { id: 7, mass: 3.0e-6 }, Flake { id: 9, mass: 1.0e-6 }];
//! let columns = vec![RecordColumn::u32("id", "", &flakes, |f| f.id), RecordColumn::f64("mass", "kg", &flakes, |f| f.mass)];
//! let table = RecordTable { name: "flakes", columns };
//! assert_eq!((table.len(), table.record_bytes()), (2, 12));
//! ```

/// Values of a column, one per record. The variant is the type in which files store them.
#[derive(Debug, Clone, PartialEq)]
pub enum ColumnValues {
    /// Unsigned integers: counts, identifiers, codes of a [`CodeList`].
    U32(Vec<u32>),
    /// Signed integers: references that may be absent, which is -1.
    I32(Vec<i32>),
    /// Numbers for which seven digits suffice, such as positions and velocities.
    F32(Vec<f32>),
    /// Numbers that need double precision, such as volumes and times.
    F64(Vec<f64>),
}

/// One quantity of all records of a table, with its unit.
#[derive(Debug, Clone, PartialEq)]
pub struct RecordColumn {
    /// `[a-z0-9_]+`, unique in the table.
    pub name: &'static str,
    /// SI unit as files spell it (`m^3`, `m/s`); empty for pure numbers.
    pub unit: &'static str,
    /// One value per record of the table.
    pub values: ColumnValues,
}

/// Records of one kind at one frame. Frames of a clip that hold a table of this name give it the same columns.
#[derive(Debug, Clone, PartialEq)]
pub struct RecordTable {
    /// File stem, `[a-z0-9_]+`, unique in the frame.
    pub name: &'static str,
    /// At least one, in the order in which a record stores them.
    pub columns: Vec<RecordColumn>,
}

/// Words for integers in record tables: a value is an index into the list.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CodeList {
    /// Key of the list in the files that describe the tables.
    pub name: &'static str,
    /// One word per code, from 0.
    pub words: Vec<&'static str>,
}

impl ColumnValues {
    /// Number of values, one per record.
    pub fn len(&self) -> usize {
        match self {
            Self::U32(v) => v.len(),
            Self::I32(v) => v.len(),
            Self::F32(v) => v.len(),
            Self::F64(v) => v.len(),
        }
    }

    /// True without values, in a table without records.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Type of a value as array libraries name it, without byte order: `u4`, `i4`, `f4`, `f8`.
    pub fn type_code(&self) -> &'static str {
        match self {
            Self::U32(_) => "u4",
            Self::I32(_) => "i4",
            Self::F32(_) => "f4",
            Self::F64(_) => "f8",
        }
    }

    /// Bytes of one value in a file: 8 in double precision, else 4.
    pub fn value_bytes(&self) -> usize {
        if matches!(self, Self::F64(_)) { 8 } else { 4 }
    }
}

impl RecordColumn {
    /// A column stored as unsigned integers of 4 bytes: `value` of each row, in order.
    pub fn u32<R>(name: &'static str, unit: &'static str, rows: &[R], value: impl Fn(&R) -> u32) -> Self {
        Self { name, unit, values: ColumnValues::U32(rows.iter().map(value).collect()) }
    }

    /// A column stored as signed integers of 4 bytes: `value` of each row, in order.
    pub fn i32<R>(name: &'static str, unit: &'static str, rows: &[R], value: impl Fn(&R) -> i32) -> Self {
        Self { name, unit, values: ColumnValues::I32(rows.iter().map(value).collect()) }
    }

    /// A column stored in single precision, 4 bytes: `value` of each row, in order.
    pub fn f32<R>(name: &'static str, unit: &'static str, rows: &[R], value: impl Fn(&R) -> f32) -> Self {
        Self { name, unit, values: ColumnValues::F32(rows.iter().map(value).collect()) }
    }

    /// A column stored in double precision, 8 bytes: `value` of each row, in order.
    pub fn f64<R>(name: &'static str, unit: &'static str, rows: &[R], value: impl Fn(&R) -> f64) -> Self {
        Self { name, unit, values: ColumnValues::F64(rows.iter().map(value).collect()) }
    }
}

impl RecordTable {
    /// Number of records: values of the first column.
    pub fn len(&self) -> usize {
        self.columns.first().map_or(0, |c| c.values.len())
    }

    /// True without records, and for a table without columns.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Bytes of a record without padding.
    pub fn record_bytes(&self) -> usize {
        self.columns.iter().map(|c| c.values.value_bytes()).sum()
    }

    /// All records, one after the other, little-endian. A column that is too short ends the record early; checked scenes have
    /// none.
    pub fn to_le_bytes(&self) -> Vec<u8> {
        let mut bytes = Vec::with_capacity(self.len() * self.record_bytes());
        for i in 0..self.len() {
            for column in &self.columns {
                match &column.values {
                    ColumnValues::U32(v) => bytes.extend(v.get(i).into_iter().flat_map(|x| x.to_le_bytes())),
                    ColumnValues::I32(v) => bytes.extend(v.get(i).into_iter().flat_map(|x| x.to_le_bytes())),
                    ColumnValues::F32(v) => bytes.extend(v.get(i).into_iter().flat_map(|x| x.to_le_bytes())),
                    ColumnValues::F64(v) => bytes.extend(v.get(i).into_iter().flat_map(|x| x.to_le_bytes())),
                }
            }
        }
        bytes
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn records_are_interleaved_in_the_order_of_the_columns() {
        let rows = [(1_u32, -1_i32, 0.5_f32, 2.0_f64), (2, 7, 1.5, 4.0)];
        let columns = vec![
            RecordColumn::u32("id", "", &rows, |r| r.0),
            RecordColumn::i32("other", "", &rows, |r| r.1),
            RecordColumn::f32("x", "m", &rows, |r| r.2),
            RecordColumn::f64("volume", "m^3", &rows, |r| r.3),
        ];
        let table = RecordTable { name: "things", columns };
        let bytes = table.to_le_bytes();
        assert_eq!((table.len(), table.record_bytes(), bytes.len()), (2, 20, 40));
        assert_eq!(bytes[4..8], (-1_i32).to_le_bytes());
        assert_eq!(bytes[20..24], 2_u32.to_le_bytes());
        assert_eq!(bytes[32..], 4.0_f64.to_le_bytes());
    }
}
