//! What a grammar's own commands draw: `turtle:`, `define-angle:`, `bind`.

use std::collections::BTreeMap;

use super::code::{Code, Op, Random, Unary};
use super::derive::{Derived, Module};
use super::program::{SymbolId, Symbols};
use super::token::{Names, SourcePlace};
use super::vm::{Purpose, Streams, Vm};
use super::{Grammar, derive};
use osier_base::diagnostic::Diagnostic;
use osier_base::limits::Limits;
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
pub enum Own {
    /// Where it goes.
    Heading,
    /// To its left.
    Left,
    /// Above it.
    Up,
}

/// What a bound symbol draws.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Action {
    /// Draws a segment.
    Forward,
    /// Goes without drawing.
    Move,
    /// Turns the frame about x, y or z of the world, which leaves its place.
    World(usize),
    /// Turns about an axis of its own, right-handed.
    Turtle(Own),
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
    As(char),
    /// Nothing.
    Nothing,
}

/// A bound symbol.
#[derive(Debug, Clone)]
pub(crate) struct SymbolBinding {
    pub action: Action,
    /// Its number without a parameter, in terms of the angles.
    pub value: Option<Code>,
    /// Where it was bound; `None`: by the dialect.
    pub place: Option<SourcePlace>,
}

/// A number that every occurrence of a symbol draws anew.
#[derive(Debug, Clone)]
pub(crate) struct Angle {
    pub name: u32,
    /// Its name in the addresses of draws.
    pub word: u64,
    pub code: Code,
    /// Where it was defined; `None`: by the dialect.
    pub place: Option<SourcePlace>,
}

/// Everything that a grammar says of its turtle.
#[derive(Debug, Clone, Default)]
pub(crate) struct Rebinding {
    pub dialect: Dialect,
    /// An angle may be made of those before it.
    pub angles: Vec<Angle>,
    pub bindings: BTreeMap<SymbolId, SymbolBinding>,
}

impl Rebinding {
    /// The bindings and angles that a dialect begins with.
    pub fn of(dialect: Dialect, symbols: &mut Symbols, names: &mut Names) -> Self {
        let mut out = Self { dialect, ..Self::default() };
        if dialect == Dialect::Catkin {
            out.catkin(symbols, names);
        }
        out
    }

    /// Source: \[catkin\] table 1; "clockwise" is seen looking down the axis to the origin, a negative right-handed angle.
    /// Differs: two symbols that the table lost, `'` and `-`, are taken from eq. 2 in the order of its rows; turns about y
    /// have a maximum of their own, `spin`, and `gamma` has either sign.
    fn catkin(&mut self, symbols: &mut Symbols, names: &mut Names) {
        let uniform = |a: f64, b: f64| Code {
            ops: vec![Op::Const(a), Op::Const(b), Op::Random(Random::Uniform)],
            places: Vec::new(),
        };
        for (name, low, high) in [("delta", 0.0, 60.0), ("spin", 0.0, 180.0), ("gamma", -15.0, 15.0)] {
            let code = uniform(low, high);
            self.angles.push(Angle { name: names.intern(name), word: word(name), code, place: None });
        }
        let mut bind = |c: char, action: Action, value: Option<Code>| {
            if let Some(id) = symbols.intern(c) {
                self.bindings.insert(id, SymbolBinding { action, value, place: None });
            }
        };
        let step = Code { ops: vec![Op::Const(0.0058)], places: Vec::new() };
        bind('F', Action::Forward, Some(step));
        bind('S', Action::Organ("stalk".into()), None);
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
            ops.extend(clockwise.then_some(Op::Unary(Unary::Neg)));
            bind(c, Action::World(axis), Some(Code { ops, places: Vec::new() }));
        }
    }

    /// Has the symbol lost what it means to cpfg?
    pub fn strips(&self, symbol: Option<SymbolId>) -> bool {
        self.dialect != Dialect::Cpfg || symbol.is_some_and(|s| self.bindings.contains_key(&s))
    }
}

/// Reads the local variables, here angles, that a code names.
fn named(code: &Code) -> impl Iterator<Item = usize> {
    code.ops.iter().filter_map(|o| if let Op::Local(i) = o { Some(usize::from(*i)) } else { None })
}

/// Angles that a code is made of, directly or through others, in their order.
fn needs(code: &Code, angles: &[Angle]) -> Vec<usize> {
    let mut wanted = vec![false; angles.len()];
    named(code).filter(|i| *i < angles.len()).for_each(|i| wanted[i] = true);
    // An angle is made of earlier ones only, so that one pass from the last to the first reaches all.
    for i in (0..angles.len()).rev() {
        if wanted[i] {
            named(&angles[i].code).filter(|k| *k < i).for_each(|k| wanted[k] = true);
        }
    }
    (0..angles.len()).filter(|i| wanted[*i]).collect()
}

/// Gives each module what its symbol is bound to.
#[derive(Debug)]
pub struct Drawing<'g> {
    rebinding: Option<&'g Rebinding>,
    /// Angles that each bound symbol is made of.
    needs: BTreeMap<SymbolId, Vec<usize>>,
    vm: Vm,
    angles: Vec<f64>,
}

impl<'g> Drawing<'g> {
    /// For the modules of a derivation of `grammar`.
    pub fn new(grammar: &'g Grammar, derived: &Derived, limits: &Limits) -> Self {
        let rebinding = grammar.program.turtle.as_ref();
        let streams = Streams { seed: derived.seed, plant_id: derived.plant_id, file_seed: derived.file_seed };
        let mut vm = Vm::new(streams, 0, derived.length);
        vm.globals.clone_from(&derived.globals);
        vm.step = derived.steps;
        vm.statement_limit = limits.get("statements");
        let of = |r: &Rebinding| {
            let list = r.bindings.iter().filter_map(|(s, b)| Some((*s, needs(b.value.as_ref()?, &r.angles))));
            list.collect()
        };
        let angles = vec![0.0; rebinding.map_or(0, |r| r.angles.len())];
        Self { needs: rebinding.map(of).unwrap_or_default(), rebinding, vm, angles }
    }

    /// The turtle's commands before any is bound.
    pub fn dialect(&self) -> Dialect {
        self.rebinding.map_or(Dialect::Cpfg, |r| r.dialect)
    }

    /// What a symbol is bound to.
    pub fn action(&self, symbol: SymbolId) -> Option<&'g Action> {
        self.rebinding?.bindings.get(&symbol).map(|b| &b.action)
    }

    /// The number that a bound module acts with, if it has no parameter of its own: drawn by its lineage alone, so that
    /// it is the same whatever else the string holds.
    pub fn value(&mut self, m: Module<'_>) -> Option<f64> {
        let rebinding = self.rebinding?;
        let code = rebinding.bindings.get(&m.symbol)?.value.as_ref()?;
        for &i in self.needs.get(&m.symbol).into_iter().flatten() {
            let angle = &rebinding.angles[i];
            self.vm.begin(Purpose::Angle, m.lineage, None);
            // Numbered by its name: another angle before it changes none of its draws.
            self.vm.number_from(angle.word >> 1);
            let value = self.vm.run(&angle.code, &mut self.angles).unwrap_or(0.0);
            self.angles[i] = value;
        }
        self.vm.begin(Purpose::Angle, m.lineage, None);
        self.vm.run(code, &mut self.angles).ok()
    }

    /// What was odd.
    pub fn warnings(&self, grammar: &Grammar) -> Vec<Diagnostic> {
        derive::warnings(grammar, &self.vm.events)
    }
}
