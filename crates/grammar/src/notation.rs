//! Notations that grammar files are written in.

/// Notations of grammar files: that of cpfg with one of three turtle dialects, and the formats of three other programs.
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
    /// Files of L-Py (`.lpy`).
    LPy,
}

impl Notation {
    /// All notations, with their names in options and scenes.
    pub const ALL: [(&'static str, Self); 6] = [
        ("cpfg", Self::Cpfg),
        ("abop", Self::Abop),
        ("catkin", Self::Catkin),
        ("fractint", Self::Fractint),
        ("lparser", Self::LParser),
        ("lpy", Self::LPy),
    ];

    /// The name of the notation in [`Self::ALL`].
    pub fn word(self) -> &'static str {
        Self::ALL.iter().find(|(_, n)| *n == self).map_or("cpfg", |(w, _)| *w)
    }

    /// The notation with this name in [`Self::ALL`]; `None` for other names, also if only the case differs.
    pub fn of_word(word: &str) -> Option<Self> {
        Self::ALL.iter().find(|(w, _)| *w == word).map(|(_, n)| *n)
    }
}
