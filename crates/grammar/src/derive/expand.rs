//! Decomposition and homomorphism: modules expanded depth first, with an explicit stack.

use std::ops::ControlFlow;

use super::matching::{self, ContextView};
use super::plan::RewritePlan;
use super::rewriter::{DrawPurposes, RewriteSettings, Rewriter};
use super::step::check_size;
use super::{Derivation, DerivedString, brackets, halt_error, runtime_diagnostics};
use crate::grammar::Grammar;
use crate::modules::{Module, ModuleString};
use crate::program::Production;
use crate::vm::{DrawPurpose, Halt, RandomStreams, Vm};
use osier_base::Result;
use osier_base::convert;
use osier_base::diagnostic::Diagnostic;
use osier_base::limits::Limits;
use osier_base::rng::word;

/// Factor on the limit `modules` for modules that a homomorphism draws: they take time but no memory. Raising it lets
/// `interpret` run longer before L051.
const MAX_DRAWN_PER_STORED: u64 = 10;

/// Stack of modules to expand, with the depth of each; the last one is next.
#[derive(Debug, Default)]
struct ExpansionStack {
    modules: ModuleString,
    depth: Vec<u32>,
}

impl ExpansionStack {
    /// Puts the modules of `successor` on top, the first one uppermost.
    fn push_reversed(&mut self, successor: &ModuleString, depth: u32) {
        for i in (0..successor.len()).rev() {
            self.modules.push(successor.get(i));
            self.depth.push(depth);
        }
    }
}

/// Expands modules one after the other; reuses its memory.
struct Expander<'p> {
    rewriter: Rewriter<'p>,
    stack: ExpansionStack,
    successor: ModuleString,
    current: ModuleString,
    /// Modules that may wait at once.
    limit: usize,
}

impl<'p> Expander<'p> {
    fn new(settings: RewriteSettings<'p>, vm: Vm, limit: usize) -> Self {
        let rewriter = Rewriter::new(settings, vm);
        Self {
            rewriter,
            stack: ExpansionStack::default(),
            successor: ModuleString::default(),
            current: ModuleString::default(),
            limit,
        }
    }

    /// Expands the module at `at` into `sink`, at most `maximum depth` times over; stops when `sink` says false.
    fn expand(
        &mut self,
        view: &ContextView<'_>,
        at: usize,
        sink: &mut impl FnMut(Module<'_>) -> bool,
    ) -> std::result::Result<(), Halt> {
        self.expand_module(view.modules.get(at), view, at, sink)
    }

    /// As [`Expander::expand`], for a module whose contexts are those of place `at` of the string.
    fn expand_module(
        &mut self,
        module: Module<'_>,
        view: &ContextView<'_>,
        at: usize,
        sink: &mut impl FnMut(Module<'_>) -> bool,
    ) -> std::result::Result<(), Halt> {
        let plan = self.rewriter.settings.plan;
        let rules = plan.set;
        // Modules without productions, and all modules where the maximum depth is 0, pass unchanged.
        if rules.depth == 0 || !plan.has_productions(module.symbol) {
            return if sink(module) { Ok(()) } else { Err(Halt::Modules) };
        }
        self.stack.modules.clear();
        self.stack.depth.clear();
        self.stack.modules.push(module);
        self.stack.depth.push(0);
        while let Some(depth) = self.stack.depth.pop() {
            // Pop the topmost module into a buffer of its own: the production reads its parameters while successors are
            // pushed.
            let n = self.stack.modules.len() - 1;
            self.current.clear();
            self.current.push(self.stack.modules.get(n));
            self.stack.modules.truncate(n);
            let module = self.current.get(0);
            let applicable =
                if plan.has_productions(module.symbol) { self.rewriter.select(module, view, at)? } else { None };
            // A module that no production applies to, or that has reached the maximum depth, is final.
            let Some(p) = applicable.filter(|_| depth < rules.depth) else {
                if let Some(p) = applicable.filter(|_| rules.warn_depth) {
                    let place = self.rewriter.planned(p).source.place;
                    self.rewriter.vm.warnings.add("L052", place, "depth limit reached");
                }
                if sink(module) {
                    continue;
                }
                return Err(Halt::Modules);
            };
            self.successor.clear();
            // Expansion refines a module within its step: successors keep its birth.
            self.rewriter.settings.birth = module.birth;
            self.rewriter.append_successor(p, module.lineage(), &mut self.successor)?;
            self.stack.push_reversed(&self.successor, depth + 1);
            check_size(&self.stack.modules, 0, 0, self.limit)?;
            // Expansions that vanish produce nothing for the sink to count.
            self.rewriter.vm.statements += 1;
            if self.rewriter.vm.statements > self.rewriter.vm.statement_limit {
                return Err(Halt::Statements(self.rewriter.planned(p).source.place));
            }
        }
        Ok(())
    }
}

impl Derivation<'_> {
    /// Replaces the string by its decomposition.
    pub(super) fn decompose(&mut self, step: u32) -> std::result::Result<(), Halt> {
        let rules = &self.program.decomposition;
        if rules.list.is_empty() {
            return Ok(());
        }
        let needs_partners = rules.list.iter().any(|p| !p.is_context_free());
        let partner =
            if needs_partners { matching::matching_brackets(&self.string, self.brackets) } else { Vec::new() };
        let settings = RewriteSettings {
            plan: &self.plans.decomposition,
            purposes: DrawPurposes::all(DrawPurpose::Decomposition),
            step: Some(step),
            birth: step,
            tag: 0,
            brackets: self.brackets,
        };
        let limit = convert::limit(self.limits.get("modules"));
        // Modules are expanded in string order into the second buffer; contexts see the string before decomposition.
        let mut expander = Expander::new(settings, self.vm.clone(), limit);
        self.next_string.clear();
        let view = ContextView { modules: &self.string, partner: &partner, ignored: &self.ignored };
        let out = &mut self.next_string;
        for i in 0..self.string.len() {
            expander.expand(&view, i, &mut |m| {
                out.push(m);
                out.len() <= limit
            })?;
            check_size(out, 0, 0, limit)?;
        }
        self.vm = expander.rewriter.vm;
        std::mem::swap(&mut self.string, &mut self.next_string);
        Ok(())
    }
}

/// Hands every module of the final string to `sink`, expanded by the homomorphism.
/// Returns warnings.
/// # Errors
/// `Input` with L044 or L051 like [`super::derive`].
pub fn interpret(
    grammar: &Grammar,
    derived: &DerivedString,
    limits: &Limits,
    mut sink: impl FnMut(Module<'_>),
) -> Result<Vec<Diagnostic>> {
    let program = &grammar.program;
    let rules = &program.homomorphism;
    let halted = |h: Halt| halt_error(grammar, h, derived.steps, limits);
    if rules.list.is_empty() {
        derived.for_each(grammar, limits, |m| {
            sink(m);
            ControlFlow::Continue(())
        })?;
        return Ok(Vec::new());
    }
    // The machine continues where the derivation ended: same seeds, last step, final values of the global variables.
    let brackets = brackets(program);
    let file_seed = rules.seed.unwrap_or(derived.file_seed);
    let streams = RandomStreams::new(derived.seed, derived.plant_id, file_seed);
    let mut vm = Vm::new(streams, 0, derived.length);
    vm.globals.clone_from(&derived.globals);
    vm.step = derived.completed;
    vm.statement_limit = limits.get("statements");
    // A `seed:` of the homomorphism makes its productions compete by weight even in a deterministic grammar.
    let plan = RewritePlan::new(program, rules, derived.stochastic || rules.seed.is_some());
    let settings = RewriteSettings {
        plan: &plan,
        purposes: DrawPurposes::all(DrawPurpose::Homomorphism),
        step: None,
        birth: 0,
        tag: word("homomorphism"),
        brackets,
    };
    let mut expander = Expander::new(settings, vm, convert::limit(limits.get("modules")));
    // Interpreted modules are handed over one by one and not stored, so that more of them are allowed than a string may
    // hold.
    let limit = limits.get("modules").saturating_mul(MAX_DRAWN_PER_STORED);
    let mut drawn = 0_u64;
    let mut draw = |m: Module<'_>| {
        drawn += 1;
        sink(m);
        // The callback ends the expansion when the budget is used up.
        drawn <= limit
    };
    let ignored = program.ignored.flags(&program.symbols);
    if rules.list.iter().all(Production::is_context_free) {
        let view = ContextView { modules: &ModuleString::EMPTY, partner: &[], ignored: &ignored };
        let mut halt = None;
        derived.for_each(grammar, limits, |m| match expander.expand_module(m, &view, 0, &mut draw) {
            Ok(()) => ControlFlow::Continue(()),
            Err(h) => {
                halt = Some(h);
                ControlFlow::Break(())
            }
        })?;
        halt.map_or(Ok(()), |h| Err(halted(h)))?;
    } else {
        // Contexts are those of the derived string, which must be stored for them.
        let string = derived.string(grammar, limits)?;
        let partner = matching::matching_brackets(&string, brackets);
        let view = ContextView { modules: &string, partner: &partner, ignored: &ignored };
        for i in 0..string.len() {
            expander.expand(&view, i, &mut draw).map_err(halted)?;
        }
    }
    Ok(runtime_diagnostics(grammar, &expander.rewriter.vm.warnings))
}
