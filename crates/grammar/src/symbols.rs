//! The symbols of a grammar: one character each, stored as a number.

use std::collections::BTreeMap;

/// Turtle commands of cpfg that consist of two characters; in the string these are two separate symbols.
pub(crate) const TWO_CHARACTER_COMMANDS: [(char, char); 20] = [
    ('@', 'v'),
    ('@', 'M'),
    ('@', 'R'),
    ('@', 'D'),
    ('@', 'o'),
    ('@', 'c'),
    ('@', 'O'),
    ('@', 'b'),
    ('@', 'T'),
    ('@', 'G'),
    ('@', 'P'),
    ('@', 'L'),
    ('@', '#'),
    ('@', '!'),
    ('@', ';'),
    ('@', ','),
    ('?', 'P'),
    ('?', 'H'),
    ('?', 'U'),
    ('?', 'L'),
];

/// Number of a symbol: its index in the [`Symbols`] of its grammar.
pub type SymbolId = u16;

/// The symbols of a grammar in order of appearance.
#[derive(Debug, Clone, Default)]
pub struct Symbols {
    list: Vec<char>,
    index: BTreeMap<char, SymbolId>,
    /// Names of symbols of several characters, by the private-use character that represents each.
    names: BTreeMap<char, String>,
}

/// First of the private-use characters that represent symbols of several characters.
const FIRST_PRIVATE: u32 = 0xF_0000;

impl Symbols {
    /// Number of a symbol; `None` if the table is full (65,535 symbols).
    pub(crate) fn intern(&mut self, c: char) -> Option<SymbolId> {
        if let Some(&i) = self.index.get(&c) {
            return Some(i);
        }
        // The largest number is reserved for "no symbol".
        let i = SymbolId::try_from(self.list.len()).ok().filter(|i| *i < SymbolId::MAX)?;
        self.list.push(c);
        self.index.insert(c, i);
        Some(i)
    }

    /// The private-use character that represents a symbol of several characters; `None` if none is left.
    pub(crate) fn private_character(&mut self, name: &str) -> Option<char> {
        if let Some((c, _)) = self.names.iter().find(|(_, n)| *n == name) {
            return Some(*c);
        }
        let c = char::from_u32(FIRST_PRIVATE + u32::try_from(self.names.len()).ok()?)?;
        self.names.insert(c, name.to_owned());
        Some(c)
    }

    /// The name of a symbol of several characters, by its private-use character; `None` for other characters.
    pub fn long_name(&self, c: char) -> Option<&str> {
        self.names.get(&c).map(String::as_str)
    }

    /// Appends a symbol as written in grammars: its character or its long name.
    #[inline]
    pub(crate) fn append_spelling(&self, symbol: SymbolId, out: &mut String) {
        let c = self.get(symbol);
        match self.long_name(c) {
            Some(name) => out.push_str(name),
            None => out.push(c),
        }
    }

    /// The number of a symbol; `None` if it does not occur in the grammar.
    pub fn find(&self, c: char) -> Option<SymbolId> {
        self.index.get(&c).copied()
    }

    /// The character of a symbol number; `?` for an unknown number.
    pub fn get(&self, id: SymbolId) -> char {
        self.list.get(usize::from(id)).copied().unwrap_or('?')
    }

    /// Every symbol with its number, in order of appearance in the file.
    pub fn iter(&self) -> impl Iterator<Item = (SymbolId, char)> {
        (0..).zip(self.list.iter().copied())
    }

    /// Number of different symbols, brackets included.
    pub fn len(&self) -> usize {
        self.list.len()
    }

    /// True if there are no symbols; a parsed grammar has at least `[`, `]` and `%`.
    pub fn is_empty(&self) -> bool {
        self.list.is_empty()
    }
}
