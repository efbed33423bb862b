//! Forms of values, for programs that build input fields from `osier list options --json`.

use serde_json::{Value, json};

/// Largest ratio of upper bound to default at which a slider is linear. Own: beyond it the useful values would lie in the
/// first hundredth of the slider.
const MAX_LINEAR_RATIO: f64 = 100.0;
/// Number of steps across a linear range, and from 0 to the default.
const STEPS_OF_RANGE: f64 = 100.0;
const STEPS_OF_DEFAULT: f64 = 20.0;
/// Widest range that is divided into steps: wider ones, such as those of positions, only refuse absurd values.
const MAX_STEPPED_RANGE: f64 = 1000.0;
/// Step of a number without bounds or with wide ones, whose default is 0.
const PLAIN_STEP: f64 = 0.1;

/// Type of a value, by which a panel chooses its control.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum ValueKind {
    /// A real number within the bounds of the form.
    Number,
    /// A number without decimals.
    Whole,
    /// One of the words of the form's list of choices.
    Choice,
    /// A list of words, each at most once.
    Choices,
    /// A list of words in order, some of which may repeat.
    Sequence,
    /// `"#rrggbb"` or three linear numbers.
    Color,
    /// A fixed count of numbers.
    Vector,
    /// `true` or `false`: a switch.
    Flag,
    /// A text without restrictions of its content.
    #[default]
    Text,
    /// Name of a file beside the scene, or of a preset.
    File,
    /// A list of any length, whose elements have the bounds of the form.
    List,
    /// A table of names and numbers.
    Table,
}

impl ValueKind {
    /// Name of this type in JSON listings, by which panels choose a control.
    pub fn word(self) -> &'static str {
        match self {
            Self::Number => "number",
            Self::Whole => "whole",
            Self::Choice => "choice",
            Self::Choices => "choices",
            Self::Sequence => "sequence",
            Self::Color => "color",
            Self::Vector => "vector",
            Self::Flag => "flag",
            Self::Text => "text",
            Self::File => "file",
            Self::List => "list",
            Self::Table => "table",
        }
    }
}

/// Kind, range and default of the values of a key, as they are written in a scene.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ValueForm {
    /// Type of the value, or of the elements of a list.
    pub kind: ValueKind,
    /// Least and greatest number, for vectors of each component; `None` without a bound.
    pub range: [Option<f64>; 2],
    /// Number of components of a vector; 0 for other kinds.
    pub length: usize,
    /// All accepted values; empty if values are not enumerated.
    pub choices: Vec<Value>,
    /// Default value; null if other keys or files decide it.
    pub default: Value,
    /// Value that an input field shows first: the default, or a typical value where the default comes from elsewhere.
    pub initial: Value,
}

impl ValueForm {
    /// A form without bounds, whose input field shows `default` first.
    pub fn new(kind: ValueKind, default: Value) -> Self {
        Self { kind, initial: default.clone(), default, ..Self::default() }
    }

    /// Sets the bounds; `min` of -10^9 or less, or `max` of 10^9 or more, means no bound on that side.
    #[must_use]
    pub fn within(self, min: f64, max: f64) -> Self {
        Self { range: [(min > -1e9).then_some(min), (max < 1e9).then_some(max)], ..self }
    }

    /// Sets the list of all accepted values.
    #[must_use]
    pub fn of_choices(self, choices: impl IntoIterator<Item = Value>) -> Self {
        Self { choices: choices.into_iter().collect(), ..self }
    }

    /// The initial value, or the first component of a vector; `None` if it is no number.
    fn first_number(&self) -> Option<f64> {
        self.initial.as_f64().or_else(|| self.initial.get(0)?.as_f64())
    }

    /// Whether a slider should be logarithmic: useful values lie far below the upper bound.
    pub fn is_logarithmic(&self) -> bool {
        let [Some(min), Some(max)] = self.range else { return false };
        let is_number = matches!(self.kind, ValueKind::Number | ValueKind::Whole) && self.choices.is_empty();
        let initial = self.first_number().unwrap_or(0.0);
        is_number && min >= 0.0 && initial > 0.0 && max > MAX_LINEAR_RATIO * initial
    }

    /// Step of an input field; `None` for values that are not numbers.
    pub fn step(&self) -> Option<f64> {
        if self.kind == ValueKind::Whole {
            return Some(1.0);
        }
        if !matches!(self.kind, ValueKind::Number | ValueKind::Vector) {
            return None;
        }
        let initial = self.first_number().map(f64::abs).filter(|v| *v > 0.0).map(|v| v / STEPS_OF_DEFAULT);
        let of_range = match self.range {
            [Some(min), Some(max)] if !self.is_logarithmic() && max > min && max - min <= MAX_STEPPED_RANGE => {
                Some((max - min) / STEPS_OF_RANGE)
            }
            _ => None,
        };
        let wanted = [initial, of_range].into_iter().flatten().fold(f64::INFINITY, f64::min);
        Some(if wanted.is_finite() { round_down(wanted) } else { PLAIN_STEP })
    }

    /// The form as a JSON object, in the format of `osier list options --json`.
    pub fn as_json(&self) -> Value {
        json!({
            "kind": self.kind.word(), "min": self.range[0], "max": self.range[1], "step": self.step(),
            "log": self.is_logarithmic(), "choices": self.choices, "length": self.length, "default": self.default,
            "initial": self.initial,
        })
    }
}

/// The greatest number 1, 2 or 5 times a power of ten that is at most `v`, which is above 0.
fn round_down(v: f64) -> f64 {
    // Parsing decimal notation yields the floating-point number nearest to the decimal digits.
    let exponents = (-12..=12).rev();
    let mut steps = exponents.flat_map(|e| [5, 2, 1].map(|m| format!("{m}e{e}").parse().unwrap_or(1.0)));
    // The tolerance allows for ranges such as 0.1, which are not exact in binary.
    steps.find(|step| *step <= v * 1.000_000_1).unwrap_or(v)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_are_round_and_fit_the_range() {
        let form = |default: f64, min, max| ValueForm::new(ValueKind::Number, json!(default)).within(min, max);
        assert_eq!(form(0.0, 0.0, 10.0).step(), Some(0.1));
        assert_eq!(form(4.5, 0.0, 100.0).step(), Some(0.2));
        assert_eq!(form(400.0, 0.1, 1e7).step(), Some(20.0));
        assert_eq!(form(0.0, -1e10, 1e10).step(), Some(PLAIN_STEP));
        assert_eq!(form(0.0, -1e6, 1e6).step(), Some(PLAIN_STEP));
        assert!(form(400.0, 0.1, 1e7).is_logarithmic() && !form(4.5, 0.0, 100.0).is_logarithmic());
    }
}
