//! Which symbols the turtle obeys.

/// A command of one symbol.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Command {
    /// Draws nothing.
    Nothing,
    /// `F`: draws, adds a vertex.
    Draw,
    /// `G`: draws.
    DrawOnly,
    /// `f`: moves, adds a vertex.
    Move,
    /// `g`: moves.
    MoveOnly,
    /// Turns about up, left, heading; the sign.
    Yaw(bool),
    Pitch(bool),
    Roll(bool),
    /// The bar.
    TurnAround,
    /// `$` of the textbook.
    Level,
    Push,
    Pop,
    /// `#`, `!`: up, down.
    Width(bool),
    /// `;` and `,`.
    Color(bool),
    OpenPolygon,
    Vertex,
    ClosePolygon,
    /// `_`.
    OldElasticity,
    /// Begin commands of several symbols.
    At,
    Organ,
    Query,
    /// What the grammar binds the symbol to.
    Bound,
}

impl Command {
    /// The command of a symbol.
    pub fn of(c: char) -> Self {
        match c {
            'F' => Self::Draw,
            'G' => Self::DrawOnly,
            'f' => Self::Move,
            'g' => Self::MoveOnly,
            '+' => Self::Yaw(true),
            '-' => Self::Yaw(false),
            '&' => Self::Pitch(true),
            '^' => Self::Pitch(false),
            '\\' => Self::Roll(true),
            '/' => Self::Roll(false),
            '|' => Self::TurnAround,
            '$' => Self::Level,
            '[' => Self::Push,
            ']' => Self::Pop,
            '#' => Self::Width(true),
            '!' => Self::Width(false),
            ';' | '\'' => Self::Color(true),
            ',' => Self::Color(false),
            '{' => Self::OpenPolygon,
            '.' => Self::Vertex,
            '}' => Self::ClosePolygon,
            '_' => Self::OldElasticity,
            '@' => Self::At,
            '~' => Self::Organ,
            '?' => Self::Query,
            _ => Self::Nothing,
        }
    }

    /// Ends the present segment, which takes its end width from here.
    pub fn closes_segment(self) -> bool {
        matches!(
            self,
            Self::Draw
                | Self::DrawOnly
                | Self::Move
                | Self::MoveOnly
                | Self::Push
                | Self::Pop
                | Self::OpenPolygon
                | Self::ClosePolygon
                | Self::Organ
                | Self::At
        )
    }
}
