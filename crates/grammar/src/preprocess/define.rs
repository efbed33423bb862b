//! Parameters of grammars: `#define`s without arguments, with the range that a comment gives them.

use osier_base::diagnostic::Span;

/// A `#define` without arguments: a parameter that `--set` changes.
#[derive(Debug, Clone, PartialEq)]
pub struct Define {
    /// Name of the macro, as `--set` takes it.
    pub name: String,
    /// Its replacement as written in the grammar, or the text of the override.
    pub value: String,
    /// Its replacement as written in the grammar, even if it is overridden.
    pub written: String,
    /// Place of the name in the `#define` line.
    pub span: Span,
    /// Place of the replacement in the grammar; the empty range after the name if there is none.
    pub value_span: Span,
    /// The comment after the definition on the same line, without comment delimiters.
    pub comment: String,
}

/// Recommended range of a parameter.
#[derive(Debug, Clone, PartialEq)]
pub struct DefineRange {
    /// Smallest recommended value, below `max`.
    pub min: f64,
    /// Largest recommended value, above `min`.
    pub max: f64,
    /// Unit of both values; empty if there is none.
    pub unit: String,
}

impl Define {
    /// The value as a number; `None` for expressions and names.
    pub fn number(&self) -> Option<f64> {
        plain_number(&self.value)
    }

    /// The range at the beginning of the comment, as in `0..40 deg: how crooked limbs are`. Without one, the range between 0
    /// and twice the value written in the grammar, or 0 to 1 if that value is 0. It is extended to include the current
    /// value, which a scene may have set outside. `None` if the value written in the grammar is not a number.
    pub fn range(&self) -> Option<DefineRange> {
        let written = plain_number(&self.written)?;
        let far = if written == 0.0 { 1.0 } else { 2.0 * written };
        let twice = DefineRange { min: far.min(0.0), max: far.max(0.0), unit: String::new() };
        let DefineRange { min, max, unit } = split_comment(&self.comment).map_or(twice, |(range, _)| range);
        let value = self.number().unwrap_or(written);
        Some(DefineRange { min: min.min(value), max: max.max(value), unit })
    }

    /// The comment without its range.
    pub fn about(&self) -> &str {
        split_comment(&self.comment).map_or(&self.comment, |(_, about)| about)
    }

    /// False for a macro that abbreviates a part of productions, such as `B(R1*d, n-1)`: it has no comment and uses names
    /// that are not among `all` macros of the grammar.
    pub fn is_parameter(&self, all: &[Self]) -> bool {
        let is_macro = |name: &str| all.iter().any(|d| d.name == name);
        !self.comment.is_empty() || self.written.contains('"') || plain_names(&self.written).all(is_macro)
    }
}

/// Names in a text that no parenthesis follows.
fn plain_names(text: &str) -> impl Iterator<Item = &str> {
    let is_word = |c: char| c.is_alphanumeric() || c == '_' || c == '.';
    let mut rest = text;
    let words = std::iter::from_fn(move || {
        let tail = &rest[rest.find(is_word)?..];
        let (word, after) = tail.split_at(tail.find(|c: char| !is_word(c)).unwrap_or(tail.len()));
        rest = after;
        Some((word, after))
    });
    let is_name = |word: &str| word.starts_with(|c: char| c.is_alphabetic() || c == '_');
    words.filter_map(move |(word, after)| (is_name(word) && !after.trim_start().starts_with('(')).then_some(word))
}

/// Value of a text that is just a finite number; `None` for expressions and names.
fn plain_number(text: &str) -> Option<f64> {
    text.parse().ok().filter(|v: &f64| v.is_finite())
}

/// Range and meaning of a comment `MIN..MAX UNIT: MEANING`, the unit optional.
fn split_comment(comment: &str) -> Option<(DefineRange, &str)> {
    let (range, about) = comment.split_once(':')?;
    let (min, rest) = range.split_once("..")?;
    let rest = rest.trim();
    let (max, unit) = rest.split_once(char::is_whitespace).unwrap_or((rest, ""));
    let (min, max) = (plain_number(min.trim())?, plain_number(max)?);
    (min < max).then(|| (DefineRange { min, max, unit: unit.trim().to_owned() }, about.trim()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use osier_base::diagnostic::SourceId;

    fn define(written: &str, comment: &str) -> Define {
        let span = Span::new(SourceId(0), 0, 0);
        let (name, value) = ("A".into(), written.into());
        Define { name, value, written: written.into(), span, value_span: span, comment: comment.into() }
    }

    #[test]
    fn a_comment_gives_the_range_before_its_colon() {
        let crook = define("9", "0..40 deg: how crooked limbs are");
        assert_eq!(crook.range(), Some(DefineRange { min: 0.0, max: 40.0, unit: "deg".into() }));
        assert_eq!((crook.about(), crook.number()), ("how crooked limbs are", Some(9.0)));
        let share = define("-0.5", "-1..1: to which side");
        assert_eq!(share.range(), Some(DefineRange { min: -1.0, max: 1.0, unit: String::new() }));
    }

    #[test]
    fn without_a_range_it_is_0_to_twice_the_value() {
        let range = |written: &str, comment: &str| define(written, comment).range().map(|r| [r.min, r.max]);
        assert_eq!(range("5.4", "length of the trunk axis"), Some([0.0, 10.8]));
        assert_eq!(range("-75", "the third is rolled by this"), Some([-150.0, 0.0]));
        assert_eq!(range("0", ""), Some([0.0, 1.0]));
        assert_eq!(range("(0.58+ran(0.08))", "0..1: share"), None);
        assert_eq!(range("3", "9..2: no range"), Some([0.0, 6.0]));
        assert_eq!(define("1", "a: b").about(), "a: b");
    }

    #[test]
    fn the_range_holds_the_value_that_a_scene_sets() {
        let range = |value: &str| {
            let tuft = Define { value: value.into(), ..define("1", "0..4: leaves at each end") };
            tuft.range().map(|r| [r.min, r.max])
        };
        assert_eq!([range("3"), range("7"), range("-2")], [Some([0.0, 4.0]), Some([0.0, 7.0]), Some([-2.0, 4.0])]);
        assert_eq!(range("2*N"), Some([0.0, 4.0]));
    }
}
