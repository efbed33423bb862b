//! Reasons why a model cannot be read.

use std::ops::Range;

use crate::dialect::text::Piece;

/// The unsupported construct in a text, and its place.
#[derive(Debug, Clone)]
pub(super) struct Refusal {
    pub construct: String,
    pub range: Range<usize>,
    /// Rewritten form that is supported; `None` for the general advice.
    pub remedy: Option<&'static str>,
}

impl Refusal {
    pub fn new(construct: impl Into<String>, range: Range<usize>) -> Self {
        Self { construct: construct.into(), range, remedy: None }
    }

    pub fn remedy(self, remedy: &'static str) -> Self {
        Self { remedy: Some(remedy), ..self }
    }
}

/// The replacement for an unsupported Python statement.
pub(super) fn remedy_of(word: &str) -> Option<&'static str> {
    Some(match word {
        "with" => "write the statements of its block without it",
        "raise" | "del" => "leave it out",
        "class" => "hand its values on as parameters of modules",
        _ => return None,
    })
}

/// The refusal of a line that is indented more than the line before it, although that one does not begin a block.
pub(super) fn indented_refusal(piece: Piece<'_>) -> Refusal {
    let why = Refusal::new("an indented line behind a line that heads no block", piece.range());
    why.remedy("begin it where the line before it begins")
}

/// The refusal of a change of an item within a list of lists.
pub(super) fn nested_change(range: Range<usize>) -> Refusal {
    let why = Refusal::new("a change of an item within a list of lists", range);
    why.remedy("change the inner list under a name of its own, then set the whole item: q[0] = p")
}
