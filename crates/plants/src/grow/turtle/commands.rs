//! Commands of the turtle by symbol, as in cpfg and "The Algorithmic Beauty of Plants".

use super::dialect_commands::DialectCommand;
use super::step_part::SymbolRole;

/// What the turtle does for one symbol; parameters are read when it is performed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Command {
    /// A symbol that the turtle ignores.
    Nothing,
    /// `F`: draws a segment and adds a vertex to the open polygon.
    Draw,
    /// `G`: draws a segment.
    DrawOnly,
    /// `f`: moves and adds a vertex to the open polygon.
    Move,
    /// `g`: moves without drawing.
    MoveOnly,
    /// `+`, `-`: turns about up; true for `+`.
    Yaw(bool),
    /// `&`, `^`: turns about left; true for `&`.
    Pitch(bool),
    /// `\`, `/`: turns about the heading; true for `\`.
    Roll(bool),
    /// `|`: turns by 180 degrees about up.
    TurnAround,
    /// `$`: rolls until left is horizontal.
    Level,
    /// `[`: saves the state; a branch begins.
    Push,
    /// `]`: restores the state.
    Pop,
    /// `#`, `!`: widens, narrows; or sets the width.
    Width(bool),
    /// `;`, `,`: next, previous colour; or sets the colour.
    Color(bool),
    /// `{`, which begins a polygon.
    OpenPolygon,
    /// `.` adds the position to the open polygon.
    Vertex,
    /// `}` fills the polygon.
    ClosePolygon,
    /// `_` sets the elasticity of the tropism that is applied after steps.
    TropismElasticity,
    /// `@`: the next symbols are its command.
    At,
    /// `~`: the next symbol names an organ.
    Organ,
    /// `?`: the next symbol is the query.
    Query,
    /// A symbol that the grammar itself binds to an action.
    Bound,
    /// A command of the turtle of another program.
    Dialect(DialectCommand),
}

impl Command {
    /// The command of a symbol in the language of cpfg; [`Command::Nothing`] for symbols that are no command.
    pub fn from_symbol(c: char) -> Self {
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
            '_' => Self::TropismElasticity,
            '@' => Self::At,
            '~' => Self::Organ,
            '?' => Self::Query,
            _ => Self::Nothing,
        }
    }

    /// What the command does for the growth within a step.
    pub fn role(self) -> SymbolRole {
        match self {
            Self::Draw | Self::DrawOnly | Self::Move | Self::MoveOnly => SymbolRole::Step,
            Self::Yaw(_) | Self::Pitch(_) | Self::Roll(_) | Self::TurnAround => SymbolRole::Turn,
            Self::Organ => SymbolRole::Organ,
            Self::Nothing => SymbolRole::Nothing,
            _ => SymbolRole::Other,
        }
    }

    /// Whether the command ends the current segment, which then takes its end width from the current width.
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
