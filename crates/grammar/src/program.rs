//! A grammar after compilation: symbols are numbers, expressions are code.

use std::sync::Arc;

use super::binding::{Dialect, TurtleBindings};
use super::code::{Bytecode, Expr};
use super::functions::FunctionTables;
use super::modules::ModuleString;
use super::symbols::{SymbolId, Symbols};
use super::token::SourcePlace;

/// A module of a predecessor or context; its parameters are bound to local variables from `slot` on.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct FormalModule {
    pub symbol: SymbolId,
    pub arity: u8,
    pub slot: u16,
    pub place: SourcePlace,
}

/// A module or a bracket of the left or right context of a production.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum ContextElement {
    Module(FormalModule),
    /// `[`: the next module begins a branch.
    Open,
    /// `]`: the rest of the branch up to here may hold only branches.
    Close,
    /// `=]`: skips the rest of the branch.
    CloseRest,
}

/// A module of a successor or of the axiom, with expressions as parameters.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct SuccessorModule {
    pub symbol: SymbolId,
    pub args: Box<[Expr]>,
    /// Occurrence of its symbol in the successor, from 0: a part of the lineage.
    pub occurrence: u32,
    pub place: SourcePlace,
}

/// A compiled production: left < predecessor > right : before condition after --> successor : weight.
#[derive(Debug, Clone)]
pub(crate) struct Production {
    pub left: Vec<ContextElement>,
    pub predecessor: Vec<FormalModule>,
    pub right: Vec<ContextElement>,
    /// Left context in the new string: the part already produced in this step must end with these modules.
    pub new_left: Vec<ContextElement>,
    /// Right context in the new string; only in a program that rewrites backward, from the end of the string.
    pub new_right: Vec<ContextElement>,
    /// The symbols that its contexts skip; `None` if they are those of its L-system.
    pub ignored: Option<IgnoredSymbols>,
    pub before: Option<Bytecode>,
    pub condition: Option<Bytecode>,
    pub after: Option<Bytecode>,
    pub successor: Vec<SuccessorModule>,
    pub weight: Option<Bytecode>,
    /// Number of local variables, formal parameters included.
    pub locals: usize,
    /// Location of the predecessor, for messages about the production.
    pub place: SourcePlace,
}

impl Production {
    /// True if the production applies to every module with its predecessor's symbol and number of parameters.
    pub fn is_unconditional(&self) -> bool {
        self.condition.is_none() && self.is_context_free() && self.predecessor.len() == 1
    }

    /// True if the production has no contexts.
    pub fn is_context_free(&self) -> bool {
        self.left.is_empty() && self.right.is_empty() && self.new_left.is_empty() && self.new_right.is_empty()
    }

    /// Code of the production: its statements and expressions, except parameters that are constants or plain variables.
    pub fn codes(&self) -> impl Iterator<Item = &Bytecode> {
        let own = [&self.before, &self.condition, &self.after, &self.weight];
        let args = self.successor.iter().flat_map(|t| &t.args);
        let args = args.filter_map(|e| if let Expr::Code(c) = e { Some(&**c) } else { None });
        own.into_iter().flatten().chain(args)
    }
}

/// Productions with an index by symbol and number of parameters.
#[derive(Debug, Clone, Default)]
pub(crate) struct ProductionSet {
    pub list: Vec<Production>,
    /// Per symbol: (arity, production) in file order.
    by_symbol: Vec<Vec<(u8, u32)>>,
    /// Largest number of expansions of one module by a decomposition or homomorphism (`maximum depth`).
    pub depth: u32,
    /// True to report L052 (`warnings`) when the maximum depth ends an expansion.
    pub warn_depth: bool,
    /// Value of `Seed:` in a homomorphism; `None` without one, and in the other sections, which share one seed.
    pub seed: Option<i64>,
    /// Place of the section's heading.
    pub place: Option<SourcePlace>,
}

impl ProductionSet {
    /// Builds the index; called once after parsing.
    pub fn index(&mut self, symbols: usize) {
        self.by_symbol = vec![Vec::new(); symbols];
        for (i, p) in self.list.iter().enumerate() {
            // Every production has a predecessor, and a file holds fewer than 2^32 of them.
            let (Some(first), Ok(i)) = (p.predecessor.first(), u32::try_from(i)) else { continue };
            if let Some(row) = self.by_symbol.get_mut(usize::from(first.symbol)) {
                row.push((first.arity, i));
            }
        }
    }

    /// Productions whose (first) predecessor has this symbol and number of parameters, in file order.
    pub fn matching(&self, symbol: SymbolId, arity: usize) -> impl Iterator<Item = &Production> {
        let row = self.by_symbol.get(usize::from(symbol)).map_or(&[][..], Vec::as_slice);
        row.iter().filter(move |(a, _)| usize::from(*a) == arity).filter_map(|(_, i)| self.list.get(*i as usize))
    }
}

/// Symbols that context matching skips.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) enum IgnoredSymbols {
    #[default]
    Nothing,
    /// `Ignore:` these symbols.
    Listed(Vec<SymbolId>),
    /// `Consider:` all symbols except these.
    AllExcept(Vec<SymbolId>),
}

impl IgnoredSymbols {
    /// Per symbol number: true if contexts skip the symbol. `Consider:` never lets them skip brackets.
    pub fn flags(&self, symbols: &Symbols) -> Vec<bool> {
        let is_ignored = |(i, c): (SymbolId, char)| match self {
            Self::Nothing => false,
            Self::Listed(list) => list.contains(&i),
            Self::AllExcept(list) => !list.contains(&i) && !matches!(c, '[' | ']'),
        };
        symbols.iter().map(is_ignored).collect()
    }
}

/// Another L-system of the file, whose productions rewrite the modules between `?(label,s)` and `$`.
#[derive(Debug, Clone, Default)]
pub(crate) struct SubSystem {
    /// Label as a number; `None` for a word, which no module can refer to.
    pub label: Option<f64>,
    pub ignored: IgnoredSymbols,
    pub rules: ProductionSet,
    pub decomposition: ProductionSet,
    pub homomorphism: ProductionSet,
}

/// Symbols `?` and `$`, between which the modules of a sub-L-system stand.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Borders {
    pub open: SymbolId,
    pub close: SymbolId,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Section {
    Rules,
    Decomposition,
    Homomorphism,
}

/// Code that runs before and after the derivation (`start`, `end`) and each of its steps (`start_each`, `end_each`).
#[derive(Debug, Clone, Default)]
pub(crate) struct ControlBlocks {
    pub start: Option<Bytecode>,
    pub start_each: Option<Bytecode>,
    pub end_each: Option<Bytecode>,
    pub end: Option<Bytecode>,
    /// Number of global variables: all variables that some block assigns.
    pub globals: usize,
}

/// A compiled file: its main L-system and, in `subsystems`, the others.
#[derive(Debug, Clone, Default)]
pub(crate) struct Program {
    pub symbols: Symbols,
    pub axiom: Vec<SuccessorModule>,
    pub length: u32,
    pub length_place: Option<SourcePlace>,
    pub seed: Option<i64>,
    /// Bindings of symbols to turtle actions; `None` without a `turtle:` line.
    pub turtle: Option<TurtleBindings>,
    pub ignored: IgnoredSymbols,
    /// True if the end of the string is joined to its beginning (`ring Lsystem`).
    pub is_ring: bool,
    /// Each step rewrites from the end of the string to its beginning (`backward()` of L-Py).
    pub is_backward: bool,
    /// Slot of the global variable that says whether a step rewrites backward, where that changes from step to step.
    pub direction: Option<u16>,
    pub blocks: ControlBlocks,
    pub rules: ProductionSet,
    pub decomposition: ProductionSet,
    pub homomorphism: ProductionSet,
    /// The other L-systems of the file.
    pub subsystems: Vec<SubSystem>,
    /// Curves defined in the file itself (L-Py), by the numbers that represent them in parameters.
    pub curves: Arc<FunctionTables>,
}

impl Program {
    /// All productions of all sections and L-systems.
    pub fn productions(&self) -> impl Iterator<Item = &Production> {
        let own = self.rules.list.iter().chain(&self.decomposition.list).chain(&self.homomorphism.list);
        let of_others = self.subsystems.iter().flat_map(|s| [&s.rules, &s.decomposition, &s.homomorphism]);
        own.chain(of_others.flat_map(|set| &set.list))
    }

    /// The productions of a section; `system` is 0 for the main L-system, else 1 + its index in `subsystems`.
    pub fn section(&self, section: Section, system: u16) -> &ProductionSet {
        let sub = usize::from(system).checked_sub(1).and_then(|i| self.subsystems.get(i));
        match (section, sub) {
            (Section::Rules, None) => &self.rules,
            (Section::Decomposition, None) => &self.decomposition,
            (Section::Homomorphism, None) => &self.homomorphism,
            (Section::Rules, Some(s)) => &s.rules,
            (Section::Decomposition, Some(s)) => &s.decomposition,
            (Section::Homomorphism, Some(s)) => &s.homomorphism,
        }
    }

    /// The production sets of a section, of all L-systems.
    pub fn sections(&self, section: Section) -> impl Iterator<Item = &ProductionSet> {
        (0_u16..).take(self.subsystems.len() + 1).map(move |system| self.section(section, system))
    }

    /// The borders of sub-L-systems; `None` without any.
    pub fn borders(&self) -> Option<Borders> {
        if self.subsystems.is_empty() || self.overrides_cpfg('?') {
            return None;
        }
        // If the grammar never uses one of the border symbols, a number that no module has stands for it.
        let none = SymbolId::MAX;
        Some(Borders { open: self.symbols.find('?').unwrap_or(none), close: self.symbols.find('$').unwrap_or(none) })
    }

    /// Per module of a string: the number of its L-system, as in [`Self::section`]; empty without sub-L-systems. Border
    /// symbols belong to the surrounding L-system; an unknown label does not change the L-system.
    pub fn systems_of(&self, modules: &ModuleString) -> Vec<u16> {
        let Some(borders) = self.borders() else { return Vec::new() };
        let mut open: Vec<u16> = vec![0];
        let mut out = Vec::with_capacity(modules.len());
        for m in modules.iter() {
            let now = open.last().copied().unwrap_or(0);
            if m.symbol == borders.close && open.len() > 1 {
                open.pop();
                out.push(open.last().copied().unwrap_or(0));
                continue;
            }
            out.push(now);
            if m.symbol == borders.open
                && let Some(label) = m.params.first()
            {
                let wanted = f64::from(*label);
                #[allow(clippy::float_cmp, reason = "labels are whole numbers")]
                let found = self.subsystems.iter().position(|s| s.label == Some(wanted));
                // A label that no L-system has, or one with a number above 65,535, keeps the surrounding L-system.
                open.push(found.and_then(|i| u16::try_from(i + 1).ok()).unwrap_or(now));
            }
        }
        out
    }

    /// Per L-system, numbered as in [`Self::section`], and symbol: true if its contexts skip the symbol. Empty without
    /// sub-L-systems.
    pub fn hidden_symbols(&self) -> Vec<Vec<bool>> {
        if self.subsystems.is_empty() {
            return Vec::new();
        }
        let all = [&self.ignored].into_iter().chain(self.subsystems.iter().map(|s| &s.ignored));
        all.map(|ignored| ignored.flags(&self.symbols)).collect()
    }

    /// True if productions compete by weight, because of a `Seed:` or `turtle:` item.
    pub fn is_stochastic(&self) -> bool {
        self.seed.is_some() || self.turtle.as_ref().is_some_and(|t| !t.first_applies)
    }

    /// True if the `turtle:` item gives a symbol another meaning than cpfg does.
    pub fn overrides_cpfg(&self, c: char) -> bool {
        // `%` cuts branches in L-Py as in cpfg.
        if c == '%' && self.turtle.as_ref().is_some_and(|t| t.dialect == Dialect::LPy) {
            return false;
        }
        self.turtle.as_ref().is_some_and(|t| t.overrides_cpfg(self.symbols.find(c)))
    }

    /// True if the next step rewrites from the end of the string, with these values of the global variables.
    pub fn steps_backward(&self, globals: &[f64]) -> bool {
        let changes = self.direction.and_then(|slot| globals.get(usize::from(slot)));
        changes.map_or(self.is_backward, |value| !super::code::is_zero(*value))
    }

    /// True if the rewriting of a module depends only on the module and the step, so that modules may be rewritten in any
    /// order and without storing a string.
    pub fn rewrites_independently(&self) -> bool {
        let cuts = self.symbols.find('%').filter(|_| !self.overrides_cpfg('%'));
        let makes_cut = |p: &Production| p.successor.iter().any(|t| Some(t.symbol) == cuts);
        let axiom_cuts = self.axiom.iter().any(|t| Some(t.symbol) == cuts);
        self.decomposition.list.is_empty()
            && self.subsystems.is_empty()
            && !self.has_queries()
            && !self.is_serial()
            && !(cuts.is_some() && (axiom_cuts || self.rules.list.iter().any(makes_cut)))
            && self.rules.list.iter().all(Production::is_context_free)
    }

    /// True if modules must be rewritten one after the other, because productions write global variables or output, or
    /// replace several modules.
    pub fn is_serial(&self) -> bool {
        let writes = |p: &Production| p.codes().any(|c| c.writes_globals() || c.prints());
        self.is_backward
            || self.direction.is_some()
            || !self.subsystems.is_empty()
            || self.rules.list.iter().any(|p| writes(p) || p.predecessor.len() > 1 || !p.new_left.is_empty())
            || self.decomposition.list.iter().any(writes)
    }
}
