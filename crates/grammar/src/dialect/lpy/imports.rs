//! Names that a model gives to Python modules and to their functions.

use super::Model;
use super::expression::{PyExpr, constant_name};
use super::pieces::split;
use crate::dialect::text::{Piece, lines};

/// Names of the Python modules whose functions are known.
const KNOWN: [&str; 4] = ["math", "random", "numpy", "numpy.random"];

/// Functions of `math` and `random` whose number of parameters is not one.
const OF_SEVERAL: [(&str, usize); 10] = [
    ("random", 0),
    ("atan2", 2),
    ("pow", 2),
    ("hypot", 2),
    ("fmod", 2),
    ("uniform", 2),
    ("randint", 2),
    ("gauss", 2),
    ("normalvariate", 2),
    ("normal", 2),
];

/// The text with prefixes such as `m.` of `m.sqrt`, after `import math as m`, replaced by blanks, because functions are
/// known by their own names. All offsets stay the same.
pub(super) fn without_aliases(text: &str) -> String {
    let mut aliases: Vec<&str> = Vec::new();
    for line in lines(text) {
        let (word, rest) = line.first_word(&[]);
        if word.text == "import" {
            let both = split(rest.before(';')).into_iter().filter_map(renamed);
            aliases.extend(both.filter(|(name, _)| KNOWN.contains(&name.text)).map(|(_, other)| other.text));
        }
    }
    let is_word = |c: char| c.is_alphanumeric() || c == '_';
    let mut out = String::with_capacity(text.len());
    let mut rest = text;
    // Process the text before each word, then the word. A prefix at the beginning of a line is kept, because blanks would
    // indent the line.
    while let Some(begin) = rest.find(is_word) {
        let (before, tail) = rest.split_at(begin);
        let begins_line = before.rsplit(['\n', '\r']).next().is_none_or(|t| t.trim().is_empty())
            && (out.is_empty() || before.contains(['\n', '\r']));
        out.push_str(before);
        let (word, after) = tail.split_at(tail.find(|c: char| !is_word(c)).unwrap_or(tail.len()));
        let dot = after.strip_prefix('.').filter(|a| a.starts_with(|c: char| c.is_alphabetic() || c == '_'));
        match dot {
            Some(name) if aliases.contains(&word) && !before.ends_with('.') && !begins_line => {
                out.extend(std::iter::repeat_n(' ', word.len() + 1));
                rest = name;
            }
            _ => {
                out.push_str(word);
                rest = after;
            }
        }
    }
    out.push_str(rest);
    out
}

/// Both names in `name as other`.
fn renamed(part: Piece<'_>) -> Option<(Piece<'_>, Piece<'_>)> {
    let (name, rest) = part.first_word(&[]);
    let (word, other) = rest.first_word(&[]);
    (word.text == "as" && !other.text.is_empty()).then_some((name, other))
}

impl Model<'_, '_> {
    /// Reads an import. `from math import sqrt as root` defines a function `root` of the model. Names of other imports are
    /// either known, or refused where a production uses them.
    pub(super) fn import(&mut self, piece: Piece<'_>) {
        let (word, rest) = piece.first_word(&[]);
        let (module, _) = rest.first_word(&[]);
        let at = piece.text.find(" import ").filter(|_| word.text == "from" && KNOWN.contains(&module.text));
        let Some(at) = at else { return };
        let list = piece.from(at + " import ".len()).trimmed();
        let inner = list.text.strip_prefix('(').and_then(|t| t.strip_suffix(')'));
        let list = inner.map_or(list, |t| Piece::new(list.at + 1, t));
        for (name, other) in split(list).into_iter().filter_map(renamed) {
            if let Some(value) = constant_name(name.text) {
                self.scope.constants.insert(other.text.to_owned(), value);
                continue;
            }
            let count = OF_SEVERAL.iter().find(|(known, _)| *known == name.text).map_or(1, |(_, count)| *count);
            let params: Vec<String> = (0..count).map(|k| format!("({k} of {})", other.text)).collect();
            let args = params.iter().map(|p| PyExpr::Name(p.clone(), other.range())).collect();
            let call = PyExpr::Call(name.text.to_owned(), args, name.range());
            self.scope.defaults.remove(other.text);
            self.scope.functions.insert(other.text.to_owned(), (params, call));
        }
    }
}
