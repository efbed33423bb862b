//! Types of values that keys accept.

use super::digest::Digest;
use super::form::{ValueForm, ValueKind};
use super::key::{
    Fault, KeyListing, KeyTable, TableInfo, ValueType, finite_number, key_and_table_names, outside, refuse_unknown,
    wrong,
};
use super::tree::{TomlNode, TomlValue};
use osier_base::diagnostic::{Diagnostic, Report, Span, nearest};
use osier_base::units;
use serde_json::{Value, json};

/// The unit in which a number is written, and its conversion to SI.
#[derive(Debug, Clone, Copy)]
pub struct Unit {
    /// Symbol in messages and listings; empty without unit.
    symbol: &'static str,
    /// SI value = written value * factor / divisor. One of both is 1: a division by 1000 rounds once, a multiplication by 0.001
    /// twice.
    factor: f64,
    divisor: f64,
    /// Whether the scene hash covers the number as written, because hashes are older than the conversion of this unit.
    hashed_as_written: bool,
}

impl Unit {
    /// A unit without conversion.
    const fn si(symbol: &'static str) -> Self {
        Self { symbol, factor: 1.0, divisor: 1.0, hashed_as_written: false }
    }

    /// A unit that is `factor` SI units.
    const fn times(symbol: &'static str, factor: f64) -> Self {
        Self { symbol, factor, divisor: 1.0, hashed_as_written: false }
    }

    const fn hashed_as_written(mut self) -> Self {
        self.hashed_as_written = true;
        self
    }

    fn to_si(self, written: f64) -> f64 {
        written * self.factor / self.divisor
    }

    /// The number that the scene hash covers for a value in SI units: the value, or the written number restored to 15 digits.
    fn hashed(self, value: f64) -> f64 {
        if !self.hashed_as_written {
            return value;
        }
        let written = value / self.factor * self.divisor;
        // Converting there and back may change the last bit; 15 digits restore what was written.
        format!("{written:.14e}").parse().unwrap_or(written)
    }
}

/// A number in a range, converted to SI.
#[derive(Debug, Clone, Copy)]
pub struct NumberType {
    default: f64,
    min: f64,
    max: f64,
    unit: Unit,
}

/// A number written and read in SI units; `unit` is only displayed.
pub const fn number(default: f64, min: f64, max: f64, unit: &'static str) -> NumberType {
    NumberType { default, min, max, unit: Unit::si(unit) }
}

/// A number written in `unit`, in which `default`, `min` and `max` are given, and read in SI units.
const fn converted(default: f64, min: f64, max: f64, unit: Unit) -> NumberType {
    NumberType { default, min, max, unit }
}

/// A number written in degrees, as are the bounds, and read as radians.
pub const fn degrees(default: f64, min: f64, max: f64) -> NumberType {
    converted(default, min, max, Unit::times("deg", std::f64::consts::PI / 180.0))
}

/// A number written in millimetres, as are the bounds, and read as metres.
pub const fn millimetres(default: f64, min: f64, max: f64) -> NumberType {
    converted(default, min, max, Unit::times("mm", 1e-3))
}

/// A number written in gigapascals, as are the bounds, and read as pascals.
pub const fn gigapascals(default: f64, min: f64, max: f64) -> NumberType {
    converted(default, min, max, Unit::times("GPa", units::GIGAPASCAL).hashed_as_written())
}

/// A number written in milligrams, as are the bounds, and read as kilograms.
pub const fn milligrams(default: f64, min: f64, max: f64) -> NumberType {
    converted(default, min, max, Unit::times("mg", units::MILLIGRAM).hashed_as_written())
}

/// A number written in cubic millimetres, as are the bounds, and read as cubic metres.
pub const fn cubic_millimetres(default: f64, min: f64, max: f64) -> NumberType {
    converted(default, min, max, Unit::times("mm^3", units::CUBIC_MILLIMETRE).hashed_as_written())
}

/// A number written in millimetres of rain per hour and read as m/s: cubic metres of water per square metre and second.
pub const fn rain_rate(default: f64, min: f64, max: f64) -> NumberType {
    let unit = Unit { symbol: "mm/h", factor: 1.0, divisor: units::M_PER_S_TO_MM_PER_H, hashed_as_written: true };
    converted(default, min, max, unit)
}

impl NumberType {
    /// The form of values whose numbers lie in the range, in the written unit.
    fn form(&self, kind: ValueKind, default: Value) -> ValueForm {
        ValueForm::new(kind, default).within(self.min, self.max)
    }

    fn checked(&self, name: &str, node: &TomlNode) -> Result<f64, Fault> {
        // Ranges are in the written unit, so that messages show the numbers of the scene.
        let v = finite_number(name, node)?;
        if v < self.min || v > self.max {
            // A hundred digits of zeros would hide the message.
            let shown = if v.abs() < 1e15 { v.to_string() } else { format!("{v:e}") };
            return Err(outside(name, node, &shown, &self.range()));
        }
        Ok(self.unit.to_si(v))
    }

    fn range(&self) -> String {
        let symbol = self.unit.symbol;
        let unit = if symbol.is_empty() { String::new() } else { format!(" {symbol}") };
        // Absolute bounds of 1e9 and more mean no bound.
        match (self.min > -1e9, self.max < 1e9) {
            (true, true) => format!("{} to {}{unit}", self.min, self.max),
            (true, false) => format!("at least {}{unit}", self.min),
            (false, true) => format!("at most {}{unit}", self.max),
            (false, false) => "any number".into(),
        }
    }
}

impl ValueType for NumberType {
    type Value = f64;
    fn fallback(&self) -> f64 {
        self.unit.to_si(self.default)
    }
    fn read(&self, name: &str, node: &TomlNode) -> Result<f64, Fault> {
        self.checked(name, node)
    }
    fn listing(&self) -> KeyListing {
        KeyListing {
            accepts: format!("number, {}", self.range()),
            default: self.default.to_string(),
            unit: self.unit.symbol,
            form: self.form(ValueKind::Number, json!(self.default)),
        }
    }
    fn digest(&self, value: &f64, hasher: &mut blake3::Hasher) {
        self.unit.hashed(*value).digest(hasher);
    }
}

/// A direction on the horizon: degrees in the scene, 0 towards +X and 90 towards -Z, as the wind's. Read as the azimuth of a
/// [`osier_scene::Sun`], radians from +Z towards +X, which is 90 degrees more.
#[derive(Debug, Clone, Copy)]
pub struct SunDirection(pub f64);

impl SunDirection {
    fn azimuth(written: f64) -> f64 {
        units::radians(written + 90.0)
    }

    const DEGREES: NumberType = number(0.0, -360.0, 360.0, "deg");
}

impl ValueType for SunDirection {
    type Value = f64;
    fn fallback(&self) -> f64 {
        Self::azimuth(self.0)
    }
    fn read(&self, name: &str, node: &TomlNode) -> Result<f64, Fault> {
        Self::DEGREES.read(name, node).map(Self::azimuth)
    }
    fn listing(&self) -> KeyListing {
        NumberType { default: self.0, ..Self::DEGREES }.listing()
    }
    fn digest(&self, value: &f64, hasher: &mut blake3::Hasher) {
        value.digest(hasher);
    }
}

/// A whole number in a range, without unit.
#[derive(Debug, Clone, Copy)]
pub struct IntegerType {
    default: u32,
    min: u32,
    max: u32,
}

/// A whole number from `min` to `max`, both included.
pub const fn integer(default: u32, min: u32, max: u32) -> IntegerType {
    IntegerType { default, min, max }
}

impl ValueType for IntegerType {
    type Value = u32;
    fn fallback(&self) -> u32 {
        self.default
    }
    fn read(&self, name: &str, node: &TomlNode) -> Result<u32, Fault> {
        let TomlValue::Integer(i) = node.value else { return Err(wrong(name, node, "a whole number")) };
        match u32::try_from(i) {
            Ok(v) if v >= self.min && v <= self.max => Ok(v),
            // Negative numbers fail the conversion, large ones the comparison.
            _ => Err(outside(name, node, &i.to_string(), &format!("{} to {}", self.min, self.max))),
        }
    }
    fn listing(&self) -> KeyListing {
        let accepts = format!("whole number, {} to {}", self.min, self.max);
        let form =
            ValueForm::new(ValueKind::Whole, json!(self.default)).within(f64::from(self.min), f64::from(self.max));
        KeyListing { accepts, default: self.default.to_string(), unit: "", form }
    }
    fn digest(&self, value: &Self::Value, hasher: &mut blake3::Hasher) {
        value.digest(hasher);
    }
}

/// The form of a list whose default is empty.
fn empty_list() -> ValueForm {
    ValueForm::new(ValueKind::List, json!([]))
}

/// A list of whole numbers between the two fields, sorted and without repetition; empty by default.
#[derive(Debug, Clone, Copy)]
pub struct IntegerList(pub u32, pub u32);

impl ValueType for IntegerList {
    type Value = Vec<u32>;
    fn fallback(&self) -> Vec<u32> {
        Vec::new()
    }
    fn read(&self, name: &str, node: &TomlNode) -> Result<Vec<u32>, Fault> {
        // The type of a single number checks the bounds; its default is not used.
        let one = integer(self.0, self.0, self.1);
        let TomlValue::List(list) = &node.value else { return Err(wrong(name, node, "a list of whole numbers")) };
        let mut out: Vec<u32> = list.iter().map(|n| one.read(name, n)).collect::<Result<_, _>>()?;
        // Order and repetition have no meaning: equal sets hash equally.
        out.sort_unstable();
        out.dedup();
        Ok(out)
    }
    fn listing(&self) -> KeyListing {
        KeyListing {
            accepts: format!("list of whole numbers, {} to {}", self.0, self.1),
            default: "[]".into(),
            unit: "",
            form: ValueForm::new(ValueKind::List, json!([])).within(f64::from(self.0), f64::from(self.1)),
        }
    }
    fn digest(&self, value: &Self::Value, hasher: &mut blake3::Hasher) {
        value.digest(hasher);
    }
}

/// Side of tiling maps in pixels: a power of two from 16 to 4096. The field is the default.
#[derive(Debug, Clone, Copy)]
pub struct PowerOfTwo(pub u32);

impl ValueType for PowerOfTwo {
    type Value = u32;
    fn fallback(&self) -> u32 {
        self.0
    }
    fn read(&self, name: &str, node: &TomlNode) -> Result<u32, Fault> {
        let v = integer(self.0, 16, 4096).read(name, node)?;
        if v.is_power_of_two() {
            return Ok(v);
        }
        let above = v.next_power_of_two();
        let d = Diagnostic::error(
            "S004",
            format!("{name} is {v}, but must be a power of two"),
            node.span,
            "a power of two",
        );
        Err(Box::new(d.help(format!("write {} or {above}", above / 2))))
    }
    fn listing(&self) -> KeyListing {
        let sides = (4..=12).map(|exponent| json!(1_u32 << exponent));
        KeyListing {
            accepts: "16, 32, 64 ... 4096".into(),
            default: self.0.to_string(),
            unit: "pixels",
            form: ValueForm::new(ValueKind::Whole, json!(self.0)).within(16.0, 4096.0).of_choices(sides),
        }
    }
    fn digest(&self, value: &Self::Value, hasher: &mut blake3::Hasher) {
        value.digest(hasher);
    }
}

/// Bits per channel of a PNG: 8 by default, or 16.
#[derive(Debug, Clone, Copy)]
pub struct PngBits;

impl PngBits {
    const ALL: [u32; 2] = [8, 16];
}

impl ValueType for PngBits {
    type Value = u32;
    fn fallback(&self) -> u32 {
        Self::ALL[0]
    }
    fn read(&self, name: &str, node: &TomlNode) -> Result<u32, Fault> {
        let TomlValue::Integer(i) = node.value else { return Err(wrong(name, node, "a whole number")) };
        let bits = Self::ALL.into_iter().find(|bits| i64::from(*bits) == i);
        bits.ok_or_else(|| outside(name, node, &i.to_string(), "8 or 16"))
    }
    fn listing(&self) -> KeyListing {
        let form = ValueForm::new(ValueKind::Whole, json!(Self::ALL[0])).within(8.0, 16.0);
        KeyListing {
            accepts: "8 or 16".into(),
            default: Self::ALL[0].to_string(),
            unit: "",
            form: form.of_choices(Self::ALL.map(|bits| json!(bits))),
        }
    }
    fn digest(&self, value: &Self::Value, hasher: &mut blake3::Hasher) {
        value.digest(hasher);
    }
}

/// A seed: a whole number, or text of digits where it exceeds 63 bits.
#[derive(Debug, Clone, Copy)]
pub struct SeedType(pub u64);

impl ValueType for SeedType {
    type Value = u64;
    fn fallback(&self) -> u64 {
        self.0
    }
    fn read(&self, name: &str, node: &TomlNode) -> Result<u64, Fault> {
        match &node.value {
            TomlValue::Integer(i) => {
                u64::try_from(*i).map_err(|_| outside(name, node, &i.to_string(), "0 to 18446744073709551615"))
            }
            // TOML's integers end at 2^63 - 1: larger seeds are written as text.
            TomlValue::Text(t) => t.parse().map_err(|_| wrong(name, node, "a whole number")),
            _ => Err(wrong(name, node, "a whole number")),
        }
    }
    fn listing(&self) -> KeyListing {
        KeyListing {
            accepts: "whole number, 0 to 2^64 - 1".into(),
            default: self.0.to_string(),
            unit: "",
            form: ValueForm {
                // Forms hold their ranges as `f64`, so that the upper bound is 2^64.
                range: [Some(0.0), Some(u64::MAX as f64)],
                ..ValueForm::new(ValueKind::Whole, json!(self.0))
            },
        }
    }
    fn digest(&self, value: &Self::Value, hasher: &mut blake3::Hasher) {
        value.digest(hasher);
    }
}

/// A boolean, `true` or `false`; the field is the default.
#[derive(Debug, Clone, Copy)]
pub struct BooleanType(pub bool);

impl ValueType for BooleanType {
    type Value = bool;
    fn fallback(&self) -> bool {
        self.0
    }
    fn read(&self, name: &str, node: &TomlNode) -> Result<bool, Fault> {
        if let TomlValue::Flag(b) = node.value { Ok(b) } else { Err(wrong(name, node, "true or false")) }
    }
    fn listing(&self) -> KeyListing {
        KeyListing {
            accepts: "true or false".into(),
            default: self.0.to_string(),
            unit: "",
            form: ValueForm::new(ValueKind::Flag, json!(self.0)),
        }
    }
    fn digest(&self, value: &Self::Value, hasher: &mut blake3::Hasher) {
        value.digest(hasher);
    }
}

/// A string of any length; the field is the default.
#[derive(Debug, Clone, Copy)]
pub struct StringType(pub &'static str);

impl ValueType for StringType {
    type Value = String;
    fn fallback(&self) -> String {
        self.0.to_owned()
    }
    fn read(&self, name: &str, node: &TomlNode) -> Result<String, Fault> {
        if let TomlValue::Text(t) = &node.value { Ok(t.clone()) } else { Err(wrong(name, node, "a text")) }
    }
    fn listing(&self) -> KeyListing {
        KeyListing {
            accepts: "text".into(),
            default: format!("\"{}\"", self.0),
            unit: "",
            form: ValueForm::new(ValueKind::Text, json!(self.0)),
        }
    }
    fn digest(&self, value: &Self::Value, hasher: &mut blake3::Hasher) {
        value.digest(hasher);
    }
}

/// An enum whose members are words in scenes.
pub trait Choice: Copy + Digest + 'static {
    /// Each word and the member that it names, in the order of listings.
    const ALL: &'static [(&'static str, Self)];
}

/// The word of a member in scenes; empty for a member that `ALL` lacks.
pub fn word_of<W: Choice + PartialEq>(member: W) -> &'static str {
    W::ALL.iter().find(|(_, m)| *m == member).map_or("", |(w, _)| w)
}

/// The words of an enum as JSON, for listings.
fn words<W: Choice>() -> impl Iterator<Item = Value> {
    W::ALL.iter().map(|(word, _)| json!(word))
}

fn choices<W: Choice>() -> String {
    W::ALL.iter().map(|(w, _)| format!("\"{w}\"")).collect::<Vec<_>>().join(", ")
}

/// Words for choices that are those of other tables or programs, with the word that is meant where a key has it: particle-shapes grow
/// round a `box`, which is a `block` among the solids of a scene.
const OTHER_WORDS: [(&str, &str); 3] = [("box", "block"), ("cube", "block"), ("cuboid", "block")];

/// One word of an enum; the field is the default.
#[derive(Debug, Clone, Copy)]
pub struct OneOf<W>(pub W);

impl<W: Choice + PartialEq> ValueType for OneOf<W> {
    type Value = W;
    fn fallback(&self) -> W {
        self.0
    }
    fn read(&self, name: &str, node: &TomlNode) -> Result<W, Fault> {
        let TomlValue::Text(t) = &node.value else {
            return Err(wrong(name, node, &format!("one of {}", choices::<W>())));
        };
        if let Some((_, member)) = W::ALL.iter().find(|(w, _)| w == t) {
            return Ok(*member);
        }
        let d = Diagnostic::error("S003", format!("{name} has no choice \"{t}\""), node.span, "unknown word");
        let all = format!("one of {}", choices::<W>());
        let words = || W::ALL.iter().map(|(w, _)| *w);
        let other = OTHER_WORDS.iter().find(|(other, _)| other.eq_ignore_ascii_case(t)).map(|(_, word)| *word);
        let near: Vec<&str> = match words().find(|w| Some(*w) == other).or_else(|| nearest(t, words())) {
            Some(near) => vec![near],
            // `oak` of `white_oak`.
            None => words().filter(|w| w.split('_').any(|part| part == t)).collect(),
        };
        let quoted = near.iter().map(|w| format!("\"{w}\"")).collect::<Vec<_>>().join(" or ");
        Err(Box::new(match near.len() {
            0 => d.help(all),
            // A similar word need not be the one that was meant.
            1 => d.help(format!("did you mean {quoted}? {all}")).fix(node.span, quoted),
            _ => d.help(format!("did you mean {quoted}? {all}")),
        }))
    }
    fn listing(&self) -> KeyListing {
        KeyListing {
            accepts: format!("one of {}", choices::<W>()),
            default: format!("\"{}\"", word_of(self.0)),
            unit: "",
            form: ValueForm::new(ValueKind::Choice, json!(word_of(self.0))).of_choices(words::<W>()),
        }
    }
    fn digest(&self, value: &Self::Value, hasher: &mut blake3::Hasher) {
        value.digest(hasher);
    }
}

/// A list of words without repetition, or a single word; the field is the default.
#[derive(Debug, Clone, Copy)]
pub struct ListOf<W: 'static>(pub &'static [W]);

impl<W: Choice + PartialEq> ValueType for ListOf<W> {
    type Value = Vec<W>;
    fn fallback(&self) -> Vec<W> {
        self.0.to_vec()
    }
    fn read(&self, name: &str, node: &TomlNode) -> Result<Vec<W>, Fault> {
        // `OneOf` requires a default, which reading does not use.
        let one = OneOf(self.0[0]);
        let TomlValue::List(list) = &node.value else { return Ok(vec![one.read(name, node)?]) };
        let mut out = Vec::new();
        for n in list {
            let w = one.read(name, n)?;
            if !out.contains(&w) {
                out.push(w);
            }
        }
        Ok(out)
    }
    fn listing(&self) -> KeyListing {
        let default = self.0.iter().map(|w| format!("\"{}\"", word_of(*w))).collect::<Vec<_>>().join(", ");
        let chosen: Vec<&str> = self.0.iter().map(|w| word_of(*w)).collect();
        KeyListing {
            accepts: format!("list of {}", choices::<W>()),
            default: format!("[{default}]"),
            unit: "",
            form: ValueForm::new(ValueKind::Choices, json!(chosen)).of_choices(words::<W>()),
        }
    }
    fn digest(&self, value: &Self::Value, hasher: &mut blake3::Hasher) {
        value.digest(hasher);
    }
}

/// A list of words in order, which may repeat, or a single word; empty by default. The field only fixes the type of the words.
#[derive(Debug, Clone, Copy)]
pub struct SequenceOf<W>(pub W);

impl<W: Choice + PartialEq> ValueType for SequenceOf<W> {
    type Value = Vec<W>;
    fn fallback(&self) -> Vec<W> {
        Vec::new()
    }
    fn read(&self, name: &str, node: &TomlNode) -> Result<Vec<W>, Fault> {
        // Repeats are kept: each entry of a sequence counts.
        let one = OneOf(self.0);
        let TomlValue::List(list) = &node.value else { return Ok(vec![one.read(name, node)?]) };
        list.iter().map(|n| one.read(name, n)).collect()
    }
    fn listing(&self) -> KeyListing {
        let none: Vec<&str> = Vec::new();
        KeyListing {
            accepts: format!("list of {}", choices::<W>()),
            default: "[]".into(),
            unit: "",
            form: ValueForm::new(ValueKind::Sequence, json!(none)).of_choices(words::<W>()),
        }
    }
    fn digest(&self, value: &Self::Value, hasher: &mut blake3::Hasher) {
        value.digest(hasher);
    }
}

/// N numbers with their defaults, and one type with range and unit for all.
#[derive(Debug, Clone, Copy)]
pub struct NumberArray<const N: usize>(pub [f64; N], pub NumberType);

/// A point or vector of three numbers in metres, up to 1000 km along each axis.
pub const fn point(default: [f64; 3]) -> NumberArray<3> {
    NumberArray(default, number(0.0, -1e6, 1e6, "m"))
}

impl<const N: usize> ValueType for NumberArray<N> {
    type Value = [f64; N];
    fn fallback(&self) -> [f64; N] {
        self.0.map(|v| self.1.unit.to_si(v))
    }
    fn read(&self, name: &str, node: &TomlNode) -> Result<[f64; N], Fault> {
        let wanted = format!("a list of {N} numbers");
        let TomlValue::List(list) = &node.value else { return Err(wrong(name, node, &wanted)) };
        let values: Vec<f64> = list.iter().map(|n| self.1.checked(name, n)).collect::<Result<_, _>>()?;
        // Errors of single numbers are reported before a wrong count.
        values.try_into().map_err(|v: Vec<f64>| {
            let message = format!("{name} has {} numbers, but must have {N}", v.len());
            Box::new(Diagnostic::error("S003", message, node.span, wanted.clone()).help(format!("write {N} numbers")))
        })
    }
    fn listing(&self) -> KeyListing {
        let default = self.0.map(|v| v.to_string()).join(", ");
        KeyListing {
            accepts: format!("{N} numbers, {}", self.1.range()),
            default: format!("[{default}]"),
            unit: self.1.unit.symbol,
            form: ValueForm { length: N, ..self.1.form(ValueKind::Vector, json!(self.0.as_slice())) },
        }
    }
    fn digest(&self, value: &[f64; N], hasher: &mut blake3::Hasher) {
        value.iter().for_each(|v| self.1.digest(v, hasher));
    }
}

/// Largest number of elements of a [`NumbersByLevel`], which is that of the key `levels` of particle-shapes.
const MAX_LEVELS: usize = 8;

/// One number for each level of branching, from the trunk on; the last one applies to all higher levels. A single number is a
/// list of one. The fields are the default and the type of the numbers.
#[derive(Debug, Clone, Copy)]
pub struct NumbersByLevel(pub &'static [f64], pub NumberType);

impl ValueType for NumbersByLevel {
    type Value = Vec<f64>;
    fn fallback(&self) -> Vec<f64> {
        self.0.iter().map(|v| self.1.unit.to_si(*v)).collect()
    }
    fn read(&self, name: &str, node: &TomlNode) -> Result<Vec<f64>, Fault> {
        let TomlValue::List(list) = &node.value else { return Ok(vec![self.1.checked(name, node)?]) };
        if list.is_empty() || list.len() > MAX_LEVELS {
            let text = format!("{name} has {} numbers, but must have 1 to {MAX_LEVELS}", list.len());
            let d = Diagnostic::error("S003", text, node.span, "one number for each level");
            return Err(Box::new(d.help("write one number for each level; the last one holds for all higher levels")));
        }
        list.iter().map(|n| self.1.checked(name, n)).collect()
    }
    fn listing(&self) -> KeyListing {
        let default: Vec<String> = self.0.iter().map(f64::to_string).collect();
        KeyListing {
            accepts: format!("numbers by level, {}", self.1.range()),
            default: format!("[{}]", default.join(", ")),
            unit: self.1.unit.symbol,
            form: self.1.form(ValueKind::List, json!(self.0)),
        }
    }
    fn digest(&self, value: &Self::Value, hasher: &mut blake3::Hasher) {
        // The length distinguishes lists whose numbers continue each other.
        value.len().digest(hasher);
        value.iter().for_each(|v| self.1.digest(v, hasher));
    }
}

/// A list of numbers of any length; empty by default. The field is the type of the numbers.
#[derive(Debug, Clone, Copy)]
pub struct NumberList(pub NumberType);

impl ValueType for NumberList {
    type Value = Vec<f64>;
    fn fallback(&self) -> Vec<f64> {
        Vec::new()
    }
    fn read(&self, name: &str, node: &TomlNode) -> Result<Vec<f64>, Fault> {
        let TomlValue::List(list) = &node.value else { return Err(wrong(name, node, "a list of numbers")) };
        list.iter().map(|n| self.0.checked(name, n)).collect()
    }
    fn listing(&self) -> KeyListing {
        KeyListing {
            accepts: format!("list of numbers, {}", self.0.range()),
            default: "[]".into(),
            unit: self.0.unit.symbol,
            form: self.0.form(ValueKind::List, json!([])),
        }
    }
    fn digest(&self, value: &Self::Value, hasher: &mut blake3::Hasher) {
        value.len().digest(hasher);
        value.iter().for_each(|v| self.0.digest(v, hasher));
    }
}

/// A list of pairs of numbers, each with a greater first number than the pair before; empty by default.
#[derive(Debug, Clone, Copy)]
pub struct RisingPairs(pub NumberType);

impl ValueType for RisingPairs {
    type Value = Vec<[f64; 2]>;
    fn fallback(&self) -> Self::Value {
        Vec::new()
    }
    fn read(&self, name: &str, node: &TomlNode) -> Result<Self::Value, Fault> {
        let TomlValue::List(list) = &node.value else { return Err(wrong(name, node, "a list of pairs of numbers")) };
        // Both numbers of a pair must lie in the range, but only the first ones must rise.
        let pair = NumberArray([0.0; 2], self.0);
        let rows: Vec<[f64; 2]> = list.iter().map(|n| pair.read(name, n)).collect::<Result<_, _>>()?;
        if let Some((late, _)) = list.iter().skip(1).zip(rows.windows(2)).find(|(_, w)| w[0][0] >= w[1][0]) {
            let text = format!("{name}: the first number of a pair is not above that of the pair before");
            let d = Diagnostic::error("S004", text, late.span, "must be above that of the pair before");
            return Err(Box::new(d.help("write pairs with rising first numbers, such as [[0, 0.5], [10, 1]]")));
        }
        Ok(rows)
    }
    fn listing(&self) -> KeyListing {
        KeyListing {
            accepts: format!("list of [number, number], {}", self.0.range()),
            default: "[]".into(),
            unit: "",
            form: self.0.form(ValueKind::List, json!([])),
        }
    }
    fn digest(&self, value: &Self::Value, hasher: &mut blake3::Hasher) {
        value.digest(hasher);
    }
}

/// Three whole numbers of 0 to 255; `None` for another list.
fn eight_bits(list: &[TomlNode]) -> Option<[u8; 3]> {
    let byte = |node: &TomlNode| match node.value {
        TomlValue::Integer(i) => u8::try_from(i).ok(),
        _ => None,
    };
    list.iter().map(byte).collect::<Option<Vec<u8>>>()?.try_into().ok()
}

/// A colour, read as linear: `"#rrggbb"` in sRGB, or three linear numbers 0 to 1. The field is the default in sRGB.
#[derive(Debug, Clone, Copy)]
pub struct ColorType(pub &'static str);

impl ValueType for ColorType {
    type Value = [f32; 3];
    fn fallback(&self) -> [f32; 3] {
        hex(self.0).unwrap_or_default()
    }
    fn read(&self, name: &str, node: &TomlNode) -> Result<[f32; 3], Fault> {
        // A list is linear already; text is sRGB and converted.
        if let TomlValue::List(list) = &node.value {
            let read = NumberArray([0.0; 3], number(0.0, 0.0, 1.0, "")).read(name, node);
            return match (read, eight_bits(list)) {
                (Ok(linear), _) => Ok(linear.map(osier_base::math::narrow)),
                (Err(fault), Some([r, g, b])) => {
                    let help = "three numbers are linear light from 0 to 1; those of 0 to 255 are written";
                    Err(Box::new((*fault).help(format!("{help} \"#{r:02x}{g:02x}{b:02x}\""))))
                }
                (Err(fault), None) => Err(fault),
            };
        }
        let wanted = "a color, \"#rrggbb\" or three numbers";
        let TomlValue::Text(t) = &node.value else { return Err(wrong(name, node, wanted)) };
        hex(t).ok_or_else(|| {
            let d = Diagnostic::error("S003", format!("{name} is not a color"), node.span, "unreadable color");
            Box::new(d.help("write \"#rrggbb\" (sRGB), or [r, g, b] in linear light, 0 to 1"))
        })
    }
    fn listing(&self) -> KeyListing {
        let accepts = "color, \"#rrggbb\" (sRGB) or [r, g, b] (linear)".into();
        let form = ValueForm::new(ValueKind::Color, json!(self.0));
        KeyListing { accepts, default: format!("\"{}\"", self.0), unit: "", form }
    }
    fn digest(&self, value: &Self::Value, hasher: &mut blake3::Hasher) {
        value.digest(hasher);
    }
}

/// A list of colours, each as in [`ColorType`]; empty by default.
#[derive(Debug, Clone, Copy)]
pub struct ColorList;

impl ValueType for ColorList {
    type Value = Vec<[f32; 3]>;
    fn fallback(&self) -> Self::Value {
        Vec::new()
    }
    fn read(&self, name: &str, node: &TomlNode) -> Result<Self::Value, Fault> {
        let TomlValue::List(list) = &node.value else { return Err(wrong(name, node, "a list of colors")) };
        list.iter().map(|n| ColorType("#000000").read(name, n)).collect()
    }
    fn listing(&self) -> KeyListing {
        KeyListing { accepts: "list of colors".into(), default: "its own".into(), unit: "", form: empty_list() }
    }
    fn digest(&self, value: &Self::Value, hasher: &mut blake3::Hasher) {
        value.digest(hasher);
    }
}

/// Converts `#rgb` or `#rrggbb` (sRGB) to linear light; `None` for other texts.
fn hex(text: &str) -> Option<[f32; 3]> {
    let digits = text.strip_prefix('#')?;
    if !digits.is_ascii() || !digits.bytes().all(|b| b.is_ascii_hexdigit()) {
        return None;
    }
    let part = |i: usize| match digits.len() {
        6 => u8::from_str_radix(digits.get(2 * i..2 * i + 2)?, 16).ok(),
        // 0xf becomes 0xff: f x 17 = ff.
        3 => u8::from_str_radix(digits.get(i..=i)?, 16).ok().map(|v| v * 17),
        _ => None,
    };
    let linear = |i| part(i).map(|v| units::linear_from_srgb(f32::from(v) / 255.0));
    Some([linear(0)?, linear(1)?, linear(2)?])
}

/// A key that may be absent. Field `1` describes in listings where the value then comes from.
#[derive(Debug, Clone, Copy)]
pub struct OptionalKey<K>(pub K, pub &'static str);

impl<K: ValueType> ValueType for OptionalKey<K> {
    type Value = Option<K::Value>;
    fn fallback(&self) -> Self::Value {
        None
    }
    fn read(&self, name: &str, node: &TomlNode) -> Result<Self::Value, Fault> {
        self.0.read(name, node).map(Some)
    }
    fn listing(&self) -> KeyListing {
        // An optional key has no default value; its text says what happens without it.
        let listing = self.0.listing();
        let form = ValueForm { default: Value::Null, ..listing.form };
        KeyListing { default: self.1.to_owned(), form, ..listing }
    }
    fn digest(&self, value: &Self::Value, hasher: &mut blake3::Hasher) {
        // An absent key and one with the default value hash differently, even if they have the same effect.
        u64::from(value.is_some()).digest(hasher);
        value.iter().for_each(|v| self.0.digest(v, hasher));
    }
    fn list_tables(&self, tables: &mut Vec<TableInfo>) {
        self.0.list_tables(tables);
    }
}

/// Frames per second as numerator and denominator, written as 24, 23.976 (24000/1001) or `[num, den]`; 24 by default.
#[derive(Debug, Clone, Copy)]
pub struct FrameRate;

impl FrameRate {
    const RATE: NumberType = number(24.0, 0.1, 1000.0, "frames/s");

    /// A rate written as `[numerator, denominator]`.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "whole numbers of 1..=1e6")]
    fn fraction(name: &str, node: &TomlNode) -> Result<(u32, u32), Fault> {
        let [numerator, denominator] = NumberArray([24.0, 1.0], number(1.0, 1.0, 1e6, "")).read(name, node)?;
        let written = format!("[{numerator}, {denominator}]");
        if numerator.fract() != 0.0 || denominator.fract() != 0.0 {
            let fault = outside(name, node, &written, "two whole numbers");
            return Err(Box::new(fault.help("write the rate alone, such as 29.97, or [30000, 1001]")));
        }
        let rate = numerator / denominator;
        if !(Self::RATE.min..=Self::RATE.max).contains(&rate) {
            return Err(outside(name, node, &format!("{written}, {rate} frames/s"), &Self::RATE.range()));
        }
        Ok((numerator as u32, denominator as u32))
    }
}

impl ValueType for FrameRate {
    type Value = (u32, u32);
    fn fallback(&self) -> (u32, u32) {
        (24, 1)
    }
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "checked to lie in 0..=1e6 before")]
    fn read(&self, name: &str, node: &TomlNode) -> Result<(u32, u32), Fault> {
        if let TomlValue::List(_) = node.value {
            return Self::fraction(name, node);
        }
        let v = Self::RATE.read(name, node)?;
        // Rates such as 23.976 and 29.97 are N x 1000/1001 for the integer N nearest to v x 1.001.
        let ntsc = (v * 1.001).round();
        Ok(if (v - v.round()).abs() < 1e-9 {
            // Of a computed rate such as 23.9999999999 the whole part alone would be another one.
            (v.round() as u32, 1)
        } else if (ntsc / 1.001 - v).abs() < 5e-3 {
            (ntsc as u32 * 1000, 1001)
        } else {
            ((v * 1000.0).round() as u32, 1000)
        })
    }
    fn listing(&self) -> KeyListing {
        KeyListing {
            accepts: "number, 0.1 to 1000, or [numerator, denominator]".into(),
            default: "24".into(),
            unit: "1/s",
            form: ValueForm::new(ValueKind::Number, json!(24)).within(0.1, 1000.0),
        }
    }
    fn digest(&self, value: &Self::Value, hasher: &mut blake3::Hasher) {
        value.digest(hasher);
    }
}

/// A table of names and numbers, as in `set = { branch_angle = 38 }`, in the order of the text; empty by default.
#[derive(Debug, Clone, Copy)]
pub struct NamedNumbers;

impl ValueType for NamedNumbers {
    type Value = Vec<(String, f64)>;
    fn fallback(&self) -> Self::Value {
        Vec::new()
    }
    fn read(&self, name: &str, node: &TomlNode) -> Result<Self::Value, Fault> {
        let TomlValue::Table(t) = &node.value else { return Err(wrong(name, node, "a table of numbers")) };
        t.entries.iter().map(|e| Ok((e.key.clone(), finite_number(&format!("{name}.{}", e.key), &e.node)?))).collect()
    }
    fn listing(&self) -> KeyListing {
        KeyListing {
            accepts: "table of name = number".into(),
            default: "{}".into(),
            unit: "",
            form: ValueForm::new(ValueKind::Table, json!({})),
        }
    }
    fn digest(&self, value: &Self::Value, hasher: &mut blake3::Hasher) {
        value.digest(hasher);
    }
}

/// A reference to a file or preset, with its span. The span is not hashed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Reference {
    /// File name as written in the scene.
    pub text: String,
    /// Position of the name in the scene, for messages.
    pub span: Span,
}

impl Digest for Reference {
    fn digest(&self, hasher: &mut blake3::Hasher) {
        self.text.digest(hasher);
    }
}

/// Name of a file or preset, or `None`. The field lists the accepted endings, for listings.
#[derive(Debug, Clone, Copy)]
pub struct FileReference(pub &'static str);

impl ValueType for FileReference {
    type Value = Option<Reference>;
    fn fallback(&self) -> Self::Value {
        None
    }
    fn read(&self, name: &str, node: &TomlNode) -> Result<Self::Value, Fault> {
        match &node.value {
            TomlValue::Text(t) => Ok(Some(Reference { text: t.clone(), span: node.span })),
            _ => Err(wrong(name, node, "a file name")),
        }
    }
    fn listing(&self) -> KeyListing {
        KeyListing {
            accepts: format!("file name ({})", self.0),
            default: String::new(),
            unit: "",
            form: ValueForm::new(ValueKind::File, Value::Null),
        }
    }
    fn digest(&self, value: &Self::Value, hasher: &mut blake3::Hasher) {
        value.digest(hasher);
    }
}

/// A list of inline tables with the keys of `S`; empty by default.
#[derive(Debug, Clone, Copy)]
pub struct InlineTables<S>(pub std::marker::PhantomData<S>);

impl<S: KeyTable> ValueType for InlineTables<S> {
    type Value = Vec<S>;
    fn fallback(&self) -> Vec<S> {
        Vec::new()
    }
    fn read(&self, name: &str, node: &TomlNode) -> Result<Vec<S>, Fault> {
        let TomlValue::List(list) = &node.value else { return Err(wrong(name, node, "a list of tables")) };
        let mut out = Vec::new();
        for n in list {
            let TomlValue::Table(t) = &n.value else { return Err(wrong(name, n, "a table")) };
            // A value type returns one error: the first of the table is reported.
            let mut report = Report::default();
            out.push(S::read(Some(t), name, &mut report));
            refuse_unknown(t, name, S::PATH, &key_and_table_names::<S>(&[]), &mut report);
            if let Some(d) = report.diagnostics.into_iter().next() {
                return Err(Box::new(d));
            }
        }
        Ok(out)
    }
    fn listing(&self) -> KeyListing {
        let names: Vec<&str> = S::keys().iter().map(|k| k.name).collect();
        let accepts = format!("list of {{ {} }}", names.join(", "));
        KeyListing { accepts, default: "[]".into(), unit: "", form: empty_list() }
    }
    fn digest(&self, value: &Self::Value, hasher: &mut blake3::Hasher) {
        value.digest(hasher);
    }
    fn list_tables(&self, tables: &mut Vec<TableInfo>) {
        S::list(tables);
    }
}

/// A list of points `[x, y, z]` of any length, in metres; empty by default.
#[derive(Debug, Clone, Copy)]
pub struct PointList;

impl ValueType for PointList {
    type Value = Vec<[f64; 3]>;
    fn fallback(&self) -> Self::Value {
        Vec::new()
    }
    fn read(&self, name: &str, node: &TomlNode) -> Result<Self::Value, Fault> {
        let TomlValue::List(list) = &node.value else { return Err(wrong(name, node, "a list of points [x, y, z]")) };
        list.iter().map(|n| point([0.0; 3]).read(name, n)).collect()
    }
    fn listing(&self) -> KeyListing {
        KeyListing { accepts: "list of [x, y, z]".into(), default: "[]".into(), unit: "m", form: empty_list() }
    }
    fn digest(&self, value: &Self::Value, hasher: &mut blake3::Hasher) {
        value.digest(hasher);
    }
}

/// Keyframes: lists of numbers of which the first is a time in seconds; empty by default.
#[derive(Debug, Clone, Copy)]
pub struct TimedRows(Unit);

/// Keyframes whose numbers are in SI units.
pub const fn timed_rows() -> TimedRows {
    TimedRows(Unit::si(""))
}

/// Keyframes whose angles are written in degrees and read as radians.
pub const fn timed_degrees() -> TimedRows {
    TimedRows(Unit { symbol: "deg", factor: std::f64::consts::PI, divisor: 180.0, hashed_as_written: true })
}

impl TimedRows {
    /// Converts all numbers of a row except its time by `unit`.
    fn convert(row: &[f64], unit: impl Fn(f64) -> f64) -> Vec<f64> {
        row.iter().enumerate().map(|(i, v)| if i == 0 { *v } else { unit(*v) }).collect()
    }
}

impl ValueType for TimedRows {
    type Value = Vec<Vec<f64>>;
    fn fallback(&self) -> Self::Value {
        Vec::new()
    }
    fn read(&self, name: &str, node: &TomlNode) -> Result<Self::Value, Fault> {
        let wanted = "a list of keys [s, ...]";
        let TomlValue::List(list) = &node.value else { return Err(wrong(name, node, wanted)) };
        let key = |n: &TomlNode| match &n.value {
            TomlValue::List(row) => row.iter().map(|n| number(0.0, -1e9, 1e9, "").read(name, n)).collect(),
            _ => Err(wrong(name, n, wanted)),
        };
        let rows: Vec<Vec<f64>> = list.iter().map(key).collect::<Result<_, _>>()?;
        Ok(rows.iter().map(|row| Self::convert(row, |v| self.0.to_si(v))).collect())
    }
    fn listing(&self) -> KeyListing {
        let accepts = "list of [s, ...], times rising".into();
        KeyListing { accepts, default: "[]".into(), unit: "", form: empty_list() }
    }
    fn digest(&self, value: &Self::Value, hasher: &mut blake3::Hasher) {
        let hashed: Vec<Vec<f64>> = value.iter().map(|row| Self::convert(row, |v| self.0.hashed(v))).collect();
        hashed.digest(hasher);
    }
}

/// Largest number of full turns between two tables.
const TURNS: f64 = 100.0;

/// Whole numbers of full turns: one for all maps, or one per map; empty by default, which means 0.
#[derive(Debug, Clone, Copy)]
pub struct TurnList;

impl TurnList {
    fn whole(name: &str, node: &TomlNode) -> Result<f64, Fault> {
        let v = finite_number(name, node)?;
        if v.abs() > TURNS || v.fract() != 0.0 {
            return Err(outside(name, node, &v.to_string(), "a whole number, -100 to 100"));
        }
        Ok(v)
    }
}

impl ValueType for TurnList {
    type Value = Vec<f64>;
    fn fallback(&self) -> Self::Value {
        Vec::new()
    }
    fn read(&self, name: &str, node: &TomlNode) -> Result<Self::Value, Fault> {
        match &node.value {
            TomlValue::List(list) => list.iter().map(|n| Self::whole(name, n)).collect(),
            TomlValue::Integer(_) | TomlValue::Number(_) => Ok(vec![Self::whole(name, node)?]),
            _ => Err(wrong(name, node, "a whole number, or a list of them, one per map")),
        }
    }
    fn listing(&self) -> KeyListing {
        let accepts = "whole number, -100 to 100, or a list of them, one per map".into();
        let form = ValueForm::new(ValueKind::Whole, json!(0)).within(-TURNS, TURNS);
        KeyListing { accepts, default: "0".into(), unit: "", form }
    }
    fn digest(&self, value: &Self::Value, hasher: &mut blake3::Hasher) {
        value.digest(hasher);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use osier_base::diagnostic::SourceId;

    fn node(value: TomlValue) -> TomlNode {
        TomlNode { span: Span::new(SourceId(0), 0, 1), value }
    }

    #[test]
    fn units_are_converted_once() {
        assert!((degrees(90.0, 0.0, 90.0).fallback() - std::f64::consts::FRAC_PI_2).abs() < 1e-15);
        assert!((millimetres(12.0, 0.0, 50.0).fallback() - 0.012).abs() < 1e-15);
        let e = degrees(0.0, 0.0, 90.0).read("a", &node(TomlValue::Integer(91))).expect_err("range");
        assert_eq!((e.code, e.message.as_str()), ("S004", "a is 91, but must be 0 to 90 deg"));
    }

    #[test]
    fn fps_are_fractions() {
        let fps = |v| FrameRate.read("fps", &node(TomlValue::Number(v))).expect("fps");
        assert_eq!(fps(24.0), (24, 1));
        assert_eq!(fps(23.976), (24_000, 1001));
        assert_eq!(fps(29.97), (30_000, 1001));
        assert_eq!(fps(12.5), (12_500, 1000));
        assert_eq!((fps(23.999_999_999_9), fps(0.999_999_999_99)), ((24, 1), (1, 1)));
    }

    #[test]
    fn fractions_of_fps_are_whole_numbers_of_a_rate_in_range() {
        let fps = |list: [f64; 2]| {
            let list = list.map(|v| node(TomlValue::Number(v))).to_vec();
            FrameRate.read("fps", &node(TomlValue::List(list)))
        };
        assert_eq!(fps([30_000.0, 1001.0]).expect("fps"), (30_000, 1001));
        let said = |list| fps(list).expect_err("no rate").message;
        assert_eq!(said([29.97, 1.0]), "fps is [29.97, 1], but must be two whole numbers");
        assert_eq!(said([1.0, 1e6]), "fps is [1, 1000000], 0.000001 frames/s, but must be 0.1 to 1000 frames/s");
        assert!(said([1e6, 1.0]).contains("0.1 to 1000"));
    }

    #[test]
    fn colors_are_linear() {
        let c = ColorType("#000").read("c", &node(TomlValue::Text("#ff8000".into()))).expect("color");
        assert!((c[0] - 1.0).abs() < 1e-6 && (c[1] - 0.2159).abs() < 1e-3 && c[2] < 1e-6);
        assert!(ColorType("#000").read("c", &node(TomlValue::Text("#fé".into()))).is_err());
    }
}
