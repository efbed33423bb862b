//! Decomposition and homomorphism: modules expanded depth first, with an explicit stack.

use std::ops::ControlFlow;

use super::matching::{self, Brackets, ContextView};
use super::plan::{RewritePlan, SectionPlans};
use super::rewriter::{DrawPurposes, Followers, RewriteSettings, Rewriter};
use super::step::StringBudget;
use super::{Derivation, DerivedString, brackets, halt_error, runtime_diagnostics};
use crate::binding::Dialect;
use crate::grammar::Grammar;
use crate::modules::{Module, ModuleString};
use crate::program::{Program, Section};
use crate::symbols::SymbolId;
use crate::vm::{DrawPurpose, Halt, RandomStreams, Vm};
use osier_base::Result;
use osier_base::convert;
use osier_base::diagnostic::Diagnostic;
use osier_base::limits::Limits;
use osier_base::rng::word;

/// Factor on the limit `modules` for the modules that a homomorphism draws, since they take time but no memory. A larger
/// factor lets `interpret` run longer before L051.
const MAX_DRAWN_PER_STORED: u64 = 10;

/// Divisor of the limit `modules` that gives the applications of productions allowed for a single module, so that an endless
/// expansion ends before it fills the memory. Own: the 800,000 of the default take a fifth of a second, and 160 MB if each
/// draws a segment.
pub(super) const EXPANSION_SHARE: usize = 25;

/// Limit on the modules that wait for their expansion, bytes. Own: four million modules; models have a few hundred.
const MAX_STACK_BYTES: usize = 64 << 20;

/// Stack of the modules to expand, with the depth of each; the last one is expanded next.
#[derive(Debug, Default)]
struct ExpansionStack {
    modules: ModuleString,
    depth: Vec<u32>,
}

impl ExpansionStack {
    /// Pushes the modules of `successor` in reverse order, so that its first module is on top.
    fn push_reversed(&mut self, successor: &ModuleString, depth: u32) {
        for i in (0..successor.len()).rev() {
            self.modules.push(successor.get(i));
            self.depth.push(depth);
        }
    }

    /// At most `count` modules from the top of the stack that have this depth: the rest of the same successor.
    fn followers(&self, depth: u32, count: usize, context_from: usize) -> Followers {
        let same = self.depth.iter().rev().take(count).take_while(|d| **d == depth).count();
        let mut modules = ModuleString::default();
        (1..=same).for_each(|k| modules.push(self.modules.get(self.modules.len() - k)));
        Followers { modules, context_from }
    }

    fn clear(&mut self) {
        self.modules.clear();
        self.depth.clear();
    }

    fn drop_top(&mut self, count: usize) {
        let n = self.depth.len().saturating_sub(count);
        self.depth.truncate(n);
        self.modules.truncate(n);
    }
}

/// Expands modules one after the other, reusing its buffers.
pub(super) struct Expander<'p> {
    rewriter: Rewriter<'p>,
    stack: ExpansionStack,
    successor: ModuleString,
    current: ModuleString,
    applied: bool,
    /// Largest number of modules in a predecessor of these productions.
    longest: usize,
    /// Limit on the modules on the stack; divided by [`EXPANSION_SHARE`], the limit on applications of productions.
    limit: usize,
}

impl<'p> Expander<'p> {
    pub fn new(settings: RewriteSettings<'p>, plans: &SectionPlans<'_>, vm: Vm, limit: usize) -> Self {
        let rewriter = Rewriter::new(settings, vm);
        let longest = plans.longest_predecessor();
        Self {
            applied: false,
            longest,
            rewriter,
            stack: ExpansionStack::default(),
            successor: ModuleString::default(),
            current: ModuleString::default(),
            limit,
        }
    }

    /// Switches to the productions of another L-system.
    pub fn change_plan(&mut self, plan: &'p RewritePlan<'p>) {
        self.rewriter.change_plan(plan);
    }

    pub fn vm(&mut self) -> &mut Vm {
        &mut self.rewriter.vm
    }

    pub fn has_applied(&self) -> bool {
        self.applied
    }

    /// Expands a successor, which replaces the modules `replaced` of the string, into `sink`; contexts are matched in the string.
    pub fn expand_successor(
        &mut self,
        successor: &ModuleString,
        view: &ContextView<'_>,
        replaced: std::ops::Range<usize>,
        sink: &mut impl FnMut(Module<'_>) -> bool,
    ) -> std::result::Result<(), Halt> {
        if self.rewriter.settings.plan.set.depth == 0 {
            return if successor.iter().all(sink) { Ok(()) } else { Err(Halt::Modules) };
        }
        // Begin with depth 1 instead of 0, so that predecessors of several modules are matched within the successor, not the string.
        self.stack.clear();
        self.stack.push_reversed(successor, 1);
        self.expand_stack(view, replaced, 1, sink)?;
        Ok(())
    }

    /// Expands the module at `at` into `sink`, at most `maximum depth` times; stops when `sink` returns false. Returns the
    /// number of modules of the string that were replaced, which is that of the predecessor.
    fn expand(
        &mut self,
        view: &ContextView<'_>,
        at: usize,
        sink: &mut impl FnMut(Module<'_>) -> bool,
    ) -> std::result::Result<usize, Halt> {
        self.expand_module(view.modules.get(at), view, at, sink)
    }

    /// Like [`Expander::expand`], for a module whose contexts are those of position `at` of the string.
    fn expand_module(
        &mut self,
        module: Module<'_>,
        view: &ContextView<'_>,
        at: usize,
        sink: &mut impl FnMut(Module<'_>) -> bool,
    ) -> std::result::Result<usize, Halt> {
        let plan = self.rewriter.settings.plan;
        let rules = plan.set;
        // Pass modules without productions unchanged, and all modules if the maximum depth is 0.
        if rules.depth == 0 || !plan.has_productions(module.symbol) {
            return if sink(module) { Ok(1) } else { Err(Halt::Modules) };
        }
        self.stack.clear();
        self.stack.modules.push(module);
        self.stack.depth.push(0);
        self.expand_stack(view, at..at + 1, 0, sink)
    }

    /// Expands the stack, whose modules stand for the range `replaced` of the string. `base`: their initial depth.
    fn expand_stack(
        &mut self,
        view: &ContextView<'_>,
        replaced: std::ops::Range<usize>,
        base: u32,
        sink: &mut impl FnMut(Module<'_>) -> bool,
    ) -> std::result::Result<usize, Halt> {
        let plan = self.rewriter.settings.plan;
        let rules = plan.set;
        let max_depth = rules.depth.saturating_add(base);
        let at = replaced.start;
        let (mut taken, mut expansions) = (replaced.len(), 0_usize);
        self.rewriter.followers = None;
        while let Some(depth) = self.stack.depth.pop() {
            // Move the topmost module to a separate buffer: the production reads its parameters while successors are pushed.
            let n = self.stack.modules.len() - 1;
            self.current.clear();
            self.current.push(self.stack.modules.get(n));
            self.stack.modules.truncate(n);
            if depth > 0 && (self.longest > 1 || base > 0) {
                self.rewriter.followers = Some(self.stack.followers(depth, self.longest - 1, at + taken));
            }
            let module = self.current.get(0);
            let applicable =
                if plan.has_productions(module.symbol) { self.rewriter.select(module, view, at)? } else { None };
            // A module is final if no production applies to it or if it has reached the maximum depth.
            let Some(p) = applicable.filter(|_| depth < max_depth) else {
                if let Some(p) = applicable.filter(|_| rules.warn_depth) {
                    let place = self.rewriter.planned(p).source.place;
                    self.rewriter.vm.warnings.add("L052", place, "depth limit reached");
                }
                if sink(module) {
                    continue;
                }
                return Err(Halt::Modules);
            };
            let source = self.rewriter.planned(p).source;
            // A predecessor of several modules also consumes modules after the first, from the string or from the same successor.
            if depth == 0 {
                taken = source.predecessor.len();
            } else {
                self.stack.drop_top(source.predecessor.len() - 1);
            }
            self.applied = true;
            expansions += 1;
            if expansions > self.limit / EXPANSION_SHARE {
                return Err(Halt::Expansion(source.place));
            }
            self.successor.clear();
            // Expansion refines a module within its step: successors keep its birth.
            self.rewriter.settings.birth = module.birth;
            self.rewriter.append_successor(p, module.lineage(), &mut self.successor)?;
            self.stack.push_reversed(&self.successor, depth + 1);
            if self.stack.modules.len() > self.limit {
                return Err(Halt::Modules);
            }
            if self.stack.modules.bytes() > MAX_STACK_BYTES {
                return Err(Halt::Expansion(source.place));
            }
            // An expansion that ends in nothing never reaches the sink, so that applications are counted as statements.
            self.rewriter.vm.statements += 1;
            if self.rewriter.vm.statements > self.rewriter.vm.statement_limit {
                return Err(Halt::Statements(source.place));
            }
        }
        self.rewriter.followers = None;
        Ok(taken)
    }
}

impl Derivation<'_> {
    /// Replaces the string by its decomposition; true if any production was applied.
    pub(super) fn decompose(&mut self, step: u32) -> std::result::Result<bool, Halt> {
        let plans = &self.plans.decomposition;
        if plans.is_empty() {
            return Ok(false);
        }
        let partner =
            if plans.needs_partners() { matching::matching_brackets(&self.string, self.brackets) } else { Vec::new() };
        let settings = RewriteSettings {
            plan: plans.main(),
            purposes: DrawPurposes::all(DrawPurpose::Decomposition),
            step: Some(step),
            birth: step,
            tag: 0,
            brackets: self.brackets,
        };
        // Modules are expanded in string order into the second buffer; contexts see the string before decomposition.
        let budget = StringBudget::new(self.limits, self.string.bytes());
        let mut expander = Expander::new(settings, plans, self.vm.take(), budget.modules);
        self.next_string.clear();
        let hidden = self.program.hidden_symbols();
        let mut view = ContextView {
            modules: &self.string,
            partner: &partner,
            ignored: &self.ignored,
            is_ring: self.program.is_ring,
            is_reversed: false,
            borders: self.program.borders(),
        };
        let out = &mut self.next_string;
        let mut i = 0;
        let systems = self.program.systems_of(&self.string);
        while i < self.string.len() {
            if let Some(system) = systems.get(i) {
                expander.rewriter.change_plan(plans.of(*system));
                view = view.of_system(&hidden, *system);
            }
            // A predecessor of several modules replaces all of them at once.
            let taken = expander.expand(&view, i, &mut |m| {
                out.push(m);
                budget.check(out).is_ok()
            });
            // If the sink stopped the expansion, the budget gives the limit that was exceeded.
            i += taken.map_err(|halt| budget.check(out).err().unwrap_or(halt))?;
            budget.check(out)?;
        }
        let applied = expander.applied;
        self.vm = expander.rewriter.vm;
        std::mem::swap(&mut self.string, &mut self.next_string);
        Ok(applied)
    }
}

/// Skips the parts of the final string that an interpretation does not draw. With L-Py these are the parts of branches after
/// a `%`; cpfg removes them only at the beginning of the next step, and draws them until then.
struct CutBranches {
    /// Number of the symbol `%` in a grammar of L-Py; `None` if nothing is skipped.
    cut: Option<SymbolId>,
    brackets: Brackets,
    /// Nesting of brackets since the `%` whose branch is being skipped; `None` outside such a branch.
    open: Option<u32>,
}

impl CutBranches {
    fn new(program: &Program, brackets: Brackets) -> Self {
        let is_lpy = program.turtle.as_ref().is_some_and(|t| t.dialect == Dialect::LPy);
        Self { cut: program.symbols.find('%').filter(|_| is_lpy), brackets, open: None }
    }

    /// True if the next symbol of the string is skipped. The bracket that closes the branch is not.
    fn hides(&mut self, symbol: SymbolId) -> bool {
        match self.open {
            None if self.cut == Some(symbol) => self.open = Some(0),
            None => return false,
            Some(0) if symbol == self.brackets.close => {
                self.open = None;
                return false;
            }
            Some(n) if symbol == self.brackets.close => self.open = Some(n - 1),
            Some(n) if symbol == self.brackets.open => self.open = Some(n.saturating_add(1)),
            Some(_) => {}
        }
        true
    }
}

/// Results of an interpretation besides the modules that it passes on.
#[derive(Debug, Clone, Default)]
pub struct Interpretation {
    /// Warnings of the homomorphism.
    pub warnings: Vec<Diagnostic>,
    /// Output of `printf` in productions of the homomorphism.
    pub output: String,
}

/// Passes every module of the final string to `sink`, expanded by the homomorphism.
/// # Errors
/// `Input` with L044 or L051 like [`super::derive`].
pub fn interpret(
    grammar: &Grammar,
    derived: &DerivedString,
    limits: &Limits,
    mut sink: impl FnMut(Module<'_>),
) -> Result<Interpretation> {
    interpret_modules(grammar, derived, limits, |m, _| sink(m))
}

/// Like [`interpret`]; `sink` also receives the index of the module in the derived string that each drawn module comes from.
/// # Errors
/// As [`interpret`].
pub fn interpret_modules(
    grammar: &Grammar,
    derived: &DerivedString,
    limits: &Limits,
    mut sink: impl FnMut(Module<'_>, usize),
) -> Result<Interpretation> {
    let program = &grammar.program;
    let rules = &program.homomorphism;
    // A `seed:` of the homomorphism makes its productions compete by weight even in a deterministic grammar, except with
    // cpfg's random numbers: cpfg takes the first production that applies.
    let competes = derived.cpfg.is_none() && (derived.stochastic || rules.seed.is_some());
    let plans = SectionPlans::new(program, Section::Homomorphism, competes);
    let mut index = 0;
    if plans.is_empty() {
        derived.for_each(grammar, limits, |m| {
            sink(m, index);
            index += 1;
            ControlFlow::Continue(())
        })?;
        return Ok(Interpretation::default());
    }
    // The machine continues from the end of the derivation: same seeds, last step, final values of the global variables.
    let brackets = brackets(program);
    let file_seed = rules.seed.unwrap_or(derived.file_seed);
    let streams = RandomStreams::new(derived.seed, derived.plant_id, file_seed);
    let mut vm = Vm::new(streams, 0, derived.length);
    vm.globals.clone_from(&derived.globals);
    vm.cpfg = derived.cpfg;
    if let (Some(cpfg), Some(seed)) = (&mut vm.cpfg, rules.seed) {
        cpfg.seed(seed);
    }
    vm.step = derived.completed;
    vm.statement_limit = limits.get("statements");
    let settings = RewriteSettings {
        plan: plans.main(),
        purposes: DrawPurposes::all(DrawPurpose::Homomorphism),
        step: None,
        birth: 0,
        tag: word("homomorphism"),
        brackets,
    };
    let mut expander = Expander::new(settings, &plans, vm, convert::limit(limits.get("modules")));
    // Interpreted modules are passed on one by one and not stored, so that more of them are allowed than in a string. The
    // callback ends the expansion when this limit is reached.
    let limit = limits.get("modules").saturating_mul(MAX_DRAWN_PER_STORED);
    let mut drawn = 0_u64;
    let mut draw = |m: Module<'_>, i: usize| {
        drawn += 1;
        sink(m, i);
        drawn <= limit
    };
    let halted = |h: Halt| halt_error(grammar, h, derived.steps, limits);
    let mut cuts = CutBranches::new(program, brackets);
    let looks_around = plans.needs_partners() || plans.longest_predecessor() > 1;
    if !looks_around && program.subsystems.is_empty() {
        let mut halt = None;
        derived.for_each(grammar, limits, |m| {
            if cuts.hides(m.symbol) {
                index += 1;
                return ControlFlow::Continue(());
            }
            let expanded = expander.expand_module(m, &ContextView::NONE, 0, &mut |m| draw(m, index));
            index += 1;
            match expanded {
                Ok(_) => ControlFlow::Continue(()),
                Err(h) => {
                    halt = Some(h);
                    ControlFlow::Break(())
                }
            }
        })?;
        halt.map_or(Ok(()), |h| Err(halted(h)))?;
        return Ok(interpretation(grammar, expander));
    }
    // Contexts are matched in the derived string, which must be stored for that.
    let string = derived.string(grammar, limits)?;
    let partner = if plans.needs_partners() { matching::matching_brackets(&string, brackets) } else { Vec::new() };
    let hidden = program.hidden_symbols();
    let mut view = ContextView {
        modules: &string,
        partner: &partner,
        ignored: &program.ignored.flags(&program.symbols),
        is_ring: program.is_ring,
        is_reversed: false,
        borders: program.borders(),
    };
    let systems = program.systems_of(&string);
    let mut i = 0;
    while i < string.len() {
        if let Some(system) = systems.get(i) {
            expander.rewriter.change_plan(plans.of(*system));
            view = view.of_system(&hidden, *system);
        }
        if cuts.hides(string.get(i).symbol) {
            i += 1;
            continue;
        }
        i += expander.expand(&view, i, &mut |m| draw(m, i)).map_err(halted)?;
    }
    Ok(interpretation(grammar, expander))
}

impl Grammar {
    /// Whether modules become others when they are drawn, by productions of the homomorphism.
    pub fn has_homomorphism(&self) -> bool {
        !SectionPlans::new(&self.program, Section::Homomorphism, false).is_empty()
    }

    /// Whether what a module is drawn as depends on the modules around it: the homomorphism has contexts or productions of several
    /// modules, or the string has sub-L-systems.
    pub fn draws_by_context(&self) -> bool {
        let plans = SectionPlans::new(&self.program, Section::Homomorphism, false);
        plans.needs_partners() || plans.longest_predecessor() > 1 || !self.program.subsystems.is_empty()
    }
}

/// Collects the warnings and the output of the machine that ran the homomorphism.
fn interpretation(grammar: &Grammar, expander: Expander<'_>) -> Interpretation {
    let vm = expander.rewriter.vm;
    Interpretation { warnings: runtime_diagnostics(grammar, &vm.warnings), output: vm.output }
}
