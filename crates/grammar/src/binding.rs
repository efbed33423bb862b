//! Bindings of symbols to turtle actions: the items `turtle:`, `define-angle:` and `bind`.

use std::collections::BTreeMap;

use super::code::{Bytecode, Op, RandomFunction, UnaryOp};
use super::symbols::{SymbolId, Symbols};
use super::token::{NameTable, SourcePlace};
use osier_base::rng::word;

/// Turtle commands that symbols have before `bind` changes them.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Dialect {
    /// All turtle commands of cpfg.
    #[default]
    Cpfg,
    /// The commands of "The Algorithmic Beauty of Plants": those of cpfg with `$` and `'`.
    Abop,
    /// Commands of the L-systems of Fractint, which draw lines in the plane x-y.
    Fractint,
    /// Commands of the files of LParser.
    LParser,
    /// Commands of L-Py, whose symbols may have long names.
    LPy,
    /// No commands but the brackets.
    None,
    /// Brackets and the rotations of the catkin model.
    Catkin,
}

impl Dialect {
    /// True for the commands of cpfg, with which `@`, `~` and `?` begin commands of several symbols.
    pub fn has_cpfg_commands(self) -> bool {
        matches!(self, Self::Cpfg | Self::Abop)
    }
}

/// Numbers that files of other programs hold for their turtle.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct DialectSettings {
    /// Turn of commands without a number, degrees.
    pub angle_deg: Option<f64>,
    /// LParser: diameter of segments as a share of their length; 1 if `None`.
    pub thickness: Option<f64>,
    /// LParser: least diameter as a share of the length.
    pub min_thickness: f64,
    /// LParser: share, above 0 and below 1, of their length with which segments of the last step are drawn.
    pub fraction: Option<f64>,
}

/// An axis of the turtle's own frame, about which a bound symbol turns it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TurtleAxis {
    /// The direction of movement, H.
    Heading,
    /// The direction to the left, L.
    Left,
    /// The direction up, U = H x L.
    Up,
}

/// Turtle action that `bind` gives to a symbol.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum TurtleAction {
    /// Moves forward by the number, drawing a segment.
    Forward,
    /// Moves forward by the number without drawing.
    Move,
    /// Rotates the turtle about the x, y or z axis (0, 1, 2) of the world; its position stays.
    RotateWorld(usize),
    /// Rotates the turtle about one of its own axes, right-handed, degrees.
    RotateTurtle(TurtleAxis),
    /// Sets the line width to the number.
    Width,
    /// Adds the number to the line width.
    Widen,
    /// Sets the colour index.
    Colour,
    /// Begins a polygon, as `{` does.
    Polygon,
    /// Adds the current position to the polygon.
    Vertex,
    /// Closes the polygon and fills it.
    Fill,
    /// Places the organ of this name, scaled by the number.
    Organ(String),
    /// Places a sphere whose diameter is the number.
    Sphere,
    /// Does what cpfg does for this symbol.
    SameAs(char),
    /// No action: the symbol is not drawn.
    Nothing,
}

/// Binding of one symbol to a turtle action.
#[derive(Debug, Clone)]
pub(crate) struct SymbolBinding {
    pub action: TurtleAction,
    /// Number of the action for modules without a parameter, an expression of the angles.
    pub value: Option<Bytecode>,
    /// Where it was bound; `None`: by the dialect.
    pub place: Option<SourcePlace>,
}

/// A value that every module draws for itself (`define-angle:`).
#[derive(Debug, Clone)]
pub(crate) struct AngleDefinition {
    pub name: u32,
    /// Hash of its name: the address of its random draws.
    pub draw_key: u64,
    pub code: Bytecode,
    /// Where it was defined; `None`: by the dialect.
    pub place: Option<SourcePlace>,
}

/// The `turtle:`, `define-angle:` and `bind` items of a grammar.
#[derive(Debug, Clone, Default)]
pub(crate) struct TurtleBindings {
    pub dialect: Dialect,
    /// Numbers of the turtle that a file of another program holds.
    pub settings: DialectSettings,
    /// The first production that applies is taken, as in the program that the dialect is of.
    pub first_applies: bool,
    /// The expression of an angle may use the angles before it.
    pub angles: Vec<AngleDefinition>,
    pub symbols: BTreeMap<SymbolId, SymbolBinding>,
}

impl TurtleBindings {
    /// The bindings and angles that a dialect begins with.
    pub fn new(dialect: Dialect, symbols: &mut Symbols, names: &mut NameTable) -> Self {
        let mut out = Self { dialect, ..Self::default() };
        if dialect == Dialect::Catkin {
            out.catkin(symbols, names);
        }
        out
    }

    /// Source: \[catkin\] table 1; "clockwise" is seen looking down the axis to the origin, a negative right-handed angle.
    /// Differs: two symbols that the table lost, `'` and `-`, are taken from eq. 2 in the order of its rows; turns about y
    /// have a maximum of their own, `spin`, and `gamma` has either sign.
    fn catkin(&mut self, symbols: &mut Symbols, names: &mut NameTable) {
        let uniform = |a: f64, b: f64| Bytecode {
            ops: vec![Op::Const(a), Op::Const(b), Op::Random(RandomFunction::Uniform)],
            ..Bytecode::default()
        };
        // Angles of table 1, uniform between their bounds, degrees.
        for (name, low, high) in [("delta", 0.0, 60.0), ("spin", 0.0, 180.0), ("gamma", -15.0, 15.0)] {
            let code = uniform(low, high);
            self.angles.push(AngleDefinition { name: names.intern(name), draw_key: word(name), code, place: None });
        }
        let mut bind = |c: char, action: TurtleAction, value: Option<Bytecode>| {
            if let Some(id) = symbols.intern(c) {
                self.symbols.insert(id, SymbolBinding { action, value, place: None });
            }
        };
        // Step length of a hair, m.
        let step = Bytecode { ops: vec![Op::Const(0.0058)], ..Bytecode::default() };
        bind('F', TurtleAction::Forward, Some(step));
        bind('S', TurtleAction::Organ("stalk".into()), None);
        // Symbol, axis, angle, clockwise.
        let turns = [
            ('$', 1, 1, true),
            ('%', 1, 1, false),
            ('+', 0, 0, true),
            ('&', 0, 0, false),
            ('*', 2, 0, true),
            ('\\', 2, 0, false),
            ('?', 1, 2, true),
            ('\'', 1, 2, false),
            ('-', 0, 2, true),
            ('#', 0, 2, false),
            ('@', 2, 2, true),
            ('!', 2, 2, false),
        ];
        for (c, axis, angle, clockwise) in turns {
            // Clockwise turns negate the angle.
            let mut ops = vec![Op::Local(angle)];
            ops.extend(clockwise.then_some(Op::Unary(UnaryOp::Neg)));
            bind(c, TurtleAction::RotateWorld(axis), Some(Bytecode { ops, ..Bytecode::default() }));
        }
    }

    /// Has the symbol lost what it means to cpfg?
    pub fn overrides_cpfg(&self, symbol: Option<SymbolId>) -> bool {
        !self.dialect.has_cpfg_commands() || symbol.is_some_and(|s| self.symbols.contains_key(&s))
    }
}
