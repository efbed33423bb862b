//! Notations that grammar files are written in.

/// Languages of grammar files: cpfg's notation with one of three turtles, and the formats of three other programs.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Notation {
    /// The notation of cpfg, which is the default of osier.
    #[default]
    Cpfg,
    /// The notation of cpfg, drawn by the turtle of "The Algorithmic Beauty of Plants".
    Abop,
    /// The notation of cpfg, drawn by the turtle of the catkin model.
    Catkin,
    /// L-systems of Fractint: files of many entries.
    Fractint,
    /// Files of LParser (`.ls`): settings, axiom and productions by position.
    LParser,
    /// Files of L-Py whose productions are rules and expressions.
    LPy,
}

impl Notation {
    /// All notations with the words that choose them.
    pub const ALL: [(&'static str, Self); 6] = [
        ("cpfg", Self::Cpfg),
        ("abop", Self::Abop),
        ("catkin", Self::Catkin),
        ("fractint", Self::Fractint),
        ("lparser", Self::LParser),
        ("lpy", Self::LPy),
    ];

    /// The word of [`Self::ALL`] that stands for the notation.
    pub fn word(self) -> &'static str {
        Self::ALL.iter().find(|(_, n)| *n == self).map_or("cpfg", |(w, _)| *w)
    }

    /// The notation that a word of [`Self::ALL`] stands for; `None` for every other word, capitals included.
    pub fn of_word(word: &str) -> Option<Self> {
        Self::ALL.iter().find(|(w, _)| *w == word).map(|(_, n)| *n)
    }
}
