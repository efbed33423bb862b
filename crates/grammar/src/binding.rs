//! Bindings of symbols to turtle actions: the items `turtle:`, `define-angle:` and `bind`.

use std::collections::BTreeMap;

use super::code::{Bytecode, Op, RandomFunction, UnaryOp};
use super::symbols::{SymbolId, Symbols};
use super::token::{NameTable, SourcePlace};
use osier_base::rng::word;

/// Turtle commands that the symbols of a grammar stand for before a `bind` item changes them.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Dialect {
    /// All turtle commands of cpfg, including those of several symbols that begin with `@`, `~` or `?`.
    #[default]
    Cpfg,
    /// The commands of "The Algorithmic Beauty of Plants": those of cpfg with `$` and `'`.
    Abop,
    /// Commands of the L-systems of Fractint, which draw lines in the plane x-y.
    Fractint,
    /// Commands of LParser's files; the numbers after `turtle: lparser` set their defaults ([`DialectSettings`]).
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

/// Numeric settings after the turtle's name, as in `turtle: lparser angle = 20 thickness = 30`; percentages are stored as
/// fractions.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct DialectSettings {
    /// Angle of rotation commands without a parameter, degrees.
    pub angle_deg: Option<f64>,
    /// LParser: diameter of segments as a fraction of their length; 1 if `None`.
    pub thickness: Option<f64>,
    /// LParser: smallest diameter, as a fraction of the initial step length.
    pub min_thickness: f64,
    /// LParser: the parameter value that equals the initial step length; 1 if `None`.
    pub unit: Option<f64>,
    /// LParser: fraction of the last derivation step that is drawn, above 0 and below 1.
    pub fraction: Option<f64>,
}

/// Axis of the turtle's frame that `rotate turtle h|l|u` names.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TurtleAxis {
    /// The direction of movement, H.
    Heading,
    /// The direction to the left, L.
    Left,
    /// The direction up, U = H x L.
    Up,
}

/// Action of `bind SYMBOL : ACTION`. "The number" is the module's parameter or, without one, the value of the binding.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum TurtleAction {
    /// Moves forward by the number, drawing a segment.
    Forward,
    /// Moves forward by the number without drawing.
    Move,
    /// Rotates the turtle about the x, y or z axis (0, 1, 2) of the world; its position stays.
    RotateWorld(usize),
    /// Rotates the turtle about the H, L or U axis of its frame by the number, right-handed, degrees.
    RotateTurtle(TurtleAxis),
    /// Sets the line width to the number.
    Width,
    /// Adds the number to the line width.
    Widen,
    /// Sets the colour index to the number.
    Colour,
    /// Begins a polygon, as `{` does.
    Polygon,
    /// Adds the current position to the polygon.
    Vertex,
    /// Closes the polygon and fills it, as `}` does.
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

/// Turtle action of one symbol, set by a `bind` item or by the dialect.
#[derive(Debug, Clone)]
pub(crate) struct SymbolBinding {
    pub action: TurtleAction,
    /// Number of the action for modules without a parameter: an expression that may use the angles.
    pub value: Option<Bytecode>,
    /// Place of the `bind` item; `None` if the dialect sets the binding.
    pub place: Option<SourcePlace>,
}

/// A named value that `define-angle:` computes anew for every module.
#[derive(Debug, Clone)]
pub(crate) struct AngleDefinition {
    pub name: u32,
    /// Hash of the name, which addresses the random draws of the angle.
    pub draw_key: u64,
    pub code: Bytecode,
    /// Place of the definition; `None` if the dialect defines the angle.
    pub place: Option<SourcePlace>,
}

/// The `turtle:`, `define-angle:` and `bind` items of a grammar.
#[derive(Debug, Clone, Default)]
pub(crate) struct TurtleBindings {
    pub dialect: Dialect,
    pub settings: DialectSettings,
    /// True if the first production in the file that applies is chosen, as the program of the dialect does.
    pub first_applies: bool,
    /// Angles in the order of definition; the expression of an angle may use the earlier ones.
    pub angles: Vec<AngleDefinition>,
    pub symbols: BTreeMap<SymbolId, SymbolBinding>,
}

impl TurtleBindings {
    /// An empty set of bindings and angles; for [`Dialect::Catkin`], one filled with its table of symbols.
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
        // Symbol, world axis (0 x, 1 y, 2 z), index of the angle above, whether it is clockwise.
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
            // A turn that is clockwise when seen from the end of the axis has a negative angle in the right-handed sense.
            let mut ops = vec![Op::Local(angle)];
            ops.extend(clockwise.then_some(Op::Unary(UnaryOp::Neg)));
            bind(c, TurtleAction::RotateWorld(axis), Some(Bytecode { ops, ..Bytecode::default() }));
        }
    }

    /// True if the symbol does not act as in cpfg: another dialect, or a `bind` of this symbol.
    pub fn overrides_cpfg(&self, symbol: Option<SymbolId>) -> bool {
        !self.dialect.has_cpfg_commands() || symbol.is_some_and(|s| self.symbols.contains_key(&s))
    }
}
