//! What a grammar's own commands draw: `turtle:`, `define-angle:`, `bind`.

use std::collections::BTreeMap;

use super::code::{Bytecode, Op, RandomFunction, UnaryOp};
use super::symbols::{SymbolId, Symbols};
use super::token::{NameTable, SourcePlace};
use osier_base::rng::word;

/// Which commands the turtle knows before any is bound.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Dialect {
    /// All of cpfg's.
    #[default]
    Cpfg,
    /// Brackets alone.
    None,
    /// Brackets, and those of a catkin.
    Catkin,
}

/// An axis of the turtle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TurtleAxis {
    /// Where it goes.
    Heading,
    /// To its left.
    Left,
    /// Above it.
    Up,
}

/// What a bound symbol draws.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum TurtleAction {
    /// Draws a segment.
    Forward,
    /// Goes without drawing.
    Move,
    /// Turns the frame about x, y or z of the world, which leaves its place.
    RotateWorld(usize),
    /// Turns about an axis of its own, right-handed.
    RotateTurtle(TurtleAxis),
    /// Sets the width.
    Width,
    /// Adds to the width.
    Widen,
    /// Sets the colour index.
    Colour,
    /// Opens a polygon.
    Polygon,
    /// Adds a vertex to it.
    Vertex,
    /// Closes and fills it.
    Fill,
    /// Puts up an organ of this name.
    Organ(String),
    /// Puts up a ball.
    Sphere,
    /// Does what cpfg does for this symbol.
    SameAs(char),
    /// Nothing.
    Nothing,
}

/// A bound symbol.
#[derive(Debug, Clone)]
pub(crate) struct SymbolBinding {
    pub action: TurtleAction,
    /// Its number without a parameter, in terms of the angles.
    pub value: Option<Bytecode>,
    /// Where it was bound; `None`: by the dialect.
    pub place: Option<SourcePlace>,
}

/// A number that every occurrence of a symbol draws anew.
#[derive(Debug, Clone)]
pub(crate) struct AngleDefinition {
    pub name: u32,
    /// Hash of its name: the address of its random draws.
    pub draw_key: u64,
    pub code: Bytecode,
    /// Where it was defined; `None`: by the dialect.
    pub place: Option<SourcePlace>,
}

/// Everything that a grammar says of its turtle.
#[derive(Debug, Clone, Default)]
pub(crate) struct TurtleBindings {
    pub dialect: Dialect,
    /// An angle may be made of those before it.
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
            places: Vec::new(),
        };
        for (name, low, high) in [("delta", 0.0, 60.0), ("spin", 0.0, 180.0), ("gamma", -15.0, 15.0)] {
            let code = uniform(low, high);
            self.angles.push(AngleDefinition { name: names.intern(name), draw_key: word(name), code, place: None });
        }
        let mut bind = |c: char, action: TurtleAction, value: Option<Bytecode>| {
            if let Some(id) = symbols.intern(c) {
                self.symbols.insert(id, SymbolBinding { action, value, place: None });
            }
        };
        let step = Bytecode { ops: vec![Op::Const(0.0058)], places: Vec::new() };
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
            let mut ops = vec![Op::Local(angle)];
            ops.extend(clockwise.then_some(Op::Unary(UnaryOp::Neg)));
            bind(c, TurtleAction::RotateWorld(axis), Some(Bytecode { ops, places: Vec::new() }));
        }
    }

    /// Has the symbol lost what it means to cpfg?
    pub fn overrides_cpfg(&self, symbol: Option<SymbolId>) -> bool {
        self.dialect != Dialect::Cpfg || symbol.is_some_and(|s| self.symbols.contains_key(&s))
    }
}
