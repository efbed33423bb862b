//! Queries: `?P`, `?H`, `?L`, `?U` and `?Q` return the turtle's position and orientation; variables hold the bounds of the
//! drawing.

use super::{Derivation, DeriveOptions, DerivedString, Storage, derive_with};
use crate::code::{Bytecode, Op};
use crate::grammar::Grammar;
use crate::program::Program;
use crate::symbols::SymbolId;
use crate::vm::Halt;
use osier_base::Result;
use osier_base::limits::Limits;

/// Symbols that may follow `?`.
const QUERIES: [char; 5] = ['P', 'H', 'L', 'U', 'Q'];

/// The turtle's answer to one query module.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct QueryAnswer {
    /// Index in the string of the query's module, which is that of the letter after `?`.
    pub module: usize,
    /// Value in world axes, with the signs of cpfg.
    pub value: QueryValue,
}

/// The numbers of an answer, which replace the first parameters of the query.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum QueryValue {
    /// x, y, z: a position in turtle units, or a unit vector.
    Vector([f64; 3]),
    /// x, y, z, w of a unit quaternion, from `?Q`.
    Rotation([f64; 4]),
}

impl QueryValue {
    fn numbers(&self) -> &[f64] {
        match self {
            Self::Vector(v) => v,
            Self::Rotation(q) => q,
        }
    }
}

/// Result of an interpretation of the string: the answers to its queries and the extent of the drawing.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct TurtleAnswers {
    /// Answers in the order of the string.
    pub answers: Vec<QueryAnswer>,
    /// Smallest and largest coordinates of all positions, turtle units.
    pub bounds: [[f64; 3]; 2],
}

/// Interprets the string of a step and returns its answers; an error ends the derivation.
pub type AskTurtle<'a> = dyn FnMut(&DerivedString) -> Result<TurtleAnswers> + 'a;

/// Derives a grammar with queries, which `ask` answers after the axiom and after each step.
/// # Errors
/// Errors of [`super::derive`], and those of `ask`.
pub fn derive_with_queries(
    grammar: &Grammar,
    options: &DeriveOptions,
    limits: &Limits,
    ask: &mut AskTurtle<'_>,
) -> Result<DerivedString> {
    derive_with(grammar, options, limits, Storage::String, Some(ask))
}

/// True for the name of a query of L-Py.
fn is_query_name(name: &str) -> bool {
    matches!(name, "?P" | "?H" | "?L" | "?U")
}

impl Program {
    /// True if the program has queries; then its string is interpreted in every step.
    pub fn has_queries(&self) -> bool {
        let asks_bounds = |c: &Bytecode| c.ops.iter().any(|o| matches!(o, Op::Bounds(_)));
        let blocks = [&self.blocks.start, &self.blocks.start_each, &self.blocks.end_each, &self.blocks.end];
        if blocks.into_iter().flatten().any(asks_bounds) || self.productions().any(|p| p.codes().any(asks_bounds)) {
            return true;
        }
        // L-Py spells a query as one symbol.
        let is_long = |s: SymbolId| self.symbols.long_name(self.symbols.get(s)).is_some_and(is_query_name);
        let mut all = self.productions().map(|p| &p.successor).chain([&self.axiom]).flatten();
        if all.any(|t| !t.args.is_empty() && is_long(t.symbol)) {
            return true;
        }
        let Some(mark) = self.symbols.find('?').filter(|_| !self.overrides_cpfg('?')) else { return false };
        let mut successors = self.productions().map(|p| &p.successor).chain([&self.axiom]);
        successors.any(|s| {
            s.windows(2).any(|w| {
                let asks = QUERIES.contains(&self.symbols.get(w[1].symbol));
                w[0].symbol == mark && w[0].args.is_empty() && asks && !w[1].args.is_empty()
            })
        })
    }
}

impl Grammar {
    /// True if the grammar has queries; then use [`derive_with_queries`].
    pub fn has_queries(&self) -> bool {
        self.program.has_queries()
    }
}

impl Derivation<'_> {
    /// Lets the turtle interpret the string and writes its answers into the query modules.
    pub(super) fn ask(&mut self, ask: Option<&mut AskTurtle<'_>>) -> std::result::Result<(), Halt> {
        let Some(ask) = ask.filter(|_| self.has_queries) else { return Ok(()) };
        // The turtle gets the string as if it were the final one.
        let asked = DerivedString {
            modules: std::mem::take(&mut self.string),
            steps: self.vm.step,
            plant_id: self.options.plant_id,
            seed: self.options.seed,
            warnings: Vec::new(),
            stochastic: self.plans.rules.main().stochastic,
            length: self.length,
            completed: self.vm.step,
            file_seed: self.vm.streams.file_seed(),
            globals: self.vm.globals.clone(),
            cpfg: self.vm.cpfg,
            output: String::new(),
            deferred: None,
            text: None,
            count: 0,
            last_step: None,
        };
        let found = ask(&asked);
        self.string = asked.modules;
        match found {
            Ok(found) => {
                // Only query modules receive answers as parameters.
                let symbols = &self.program.symbols;
                let is_query = |s: SymbolId| {
                    let c = symbols.get(s);
                    QUERIES.contains(&c) || symbols.long_name(c).is_some_and(is_query_name)
                };
                for answer in &found.answers {
                    if self.string.symbols().get(answer.module).is_some_and(|s| is_query(*s)) {
                        self.string.set_params(answer.module, answer.value.numbers());
                    }
                }
                self.vm.bounds = found.bounds;
                Ok(())
            }
            Err(e) => {
                self.query_error = Some(e);
                Err(Halt::Query)
            }
        }
    }
}
