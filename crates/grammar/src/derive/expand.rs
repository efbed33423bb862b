//! Decomposition and homomorphism: modules expanded depth first, with an explicit stack.

use super::matching::{self, ContextView};
use super::modules::{Module, Modules};
use super::rewriter::{RewriteContext, Rewriter};
use super::step::check_size;
use super::{Derivation, Derived, brackets, halt_error, warnings};
use crate::Grammar;
use crate::vm::{Halt, Purpose, Streams, Vm};
use osier_base::Result;
use osier_base::diagnostic::Diagnostic;
use osier_base::limits::Limits;
use osier_base::rng::word;

/// Homomorphism may draw this many times the modules that may be stored.
const DRAWN_PER_STORED: u64 = 10;

/// Modules waiting to be expanded, the next one on top; parameters lie behind one another in the same order.
#[derive(Debug, Default)]
struct ExpansionStack {
    modules: Modules,
    depth: Vec<u32>,
}

impl ExpansionStack {
    /// Puts the modules of `fresh` on top, the first one uppermost.
    fn push_reversed(&mut self, fresh: &Modules, depth: u32) {
        for i in (0..fresh.len()).rev() {
            self.modules.push(fresh.get(i));
            self.depth.push(depth);
        }
    }
}

/// Expands modules one after the other; reuses its memory.
struct Expander<'p> {
    rewriter: Rewriter<'p>,
    waiting: ExpansionStack,
    fresh: Modules,
    top: Modules,
    /// Modules that may wait at once.
    limit: usize,
}

impl<'p> Expander<'p> {
    fn new(setup: RewriteContext<'p>, vm: Vm, limit: usize) -> Self {
        let rewriter = Rewriter::new(setup, vm);
        Self { rewriter, waiting: ExpansionStack::default(), fresh: Modules::default(), top: Modules::default(), limit }
    }

    /// Expands the module at `at` into `sink`, at most `maximum depth` times over; stops when `sink` says false.
    fn expand(
        &mut self,
        view: ContextView<'_>,
        at: usize,
        sink: &mut impl FnMut(Module<'_>) -> bool,
    ) -> std::result::Result<(), Halt> {
        let rules = self.rewriter.setup.rules;
        let module = view.modules.get(at);
        if rules.depth == 0 || !rules.concerns(module.symbol) {
            return if sink(module) { Ok(()) } else { Err(Halt::Modules) };
        }
        self.waiting.modules.clear();
        self.waiting.depth.clear();
        self.waiting.modules.push(module);
        self.waiting.depth.push(0);
        while let Some(depth) = self.waiting.depth.pop() {
            let n = self.waiting.modules.len() - 1;
            self.top.clear();
            self.top.push(self.waiting.modules.get(n));
            self.waiting.modules.truncate(n);
            let module = self.top.get(0);
            let applicable = if rules.concerns(module.symbol) { self.rewriter.find(module, view, at)? } else { None };
            let Some(p) = applicable.filter(|_| depth < rules.depth) else {
                if let Some(p) = applicable.filter(|_| rules.warn_depth) {
                    self.rewriter.vm.events.add("L052", p.place, "depth limit reached");
                }
                if sink(module) {
                    continue;
                }
                return Err(Halt::Modules);
            };
            self.fresh.clear();
            self.rewriter.setup.birth = module.birth;
            self.rewriter.build(p, module.lineage, &mut self.fresh)?;
            self.waiting.push_reversed(&self.fresh, depth + 1);
            check_size(&self.waiting.modules, 0, 0, self.limit)?;
            // Expansions that vanish produce nothing for the sink to count.
            self.rewriter.vm.statements += 1;
            if self.rewriter.vm.statements > self.rewriter.vm.statement_limit {
                return Err(Halt::Statements(p.place));
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
        let partner = if needs_partners { matching::partners(&self.string, self.brackets) } else { Vec::new() };
        let setup = RewriteContext {
            program: self.program,
            rules,
            stochastic: self.stochastic,
            purposes: [Purpose::Decomposition; 3],
            step: Some(step),
            birth: step,
            tag: 0,
            brackets: self.brackets,
        };
        let limit = usize::try_from(self.limits.get("modules")).unwrap_or(usize::MAX);
        let mut expander = Expander::new(setup, self.vm.clone(), limit);
        self.spare.clear();
        let view = ContextView { modules: &self.string, partner: &partner, hidden: &self.hidden };
        let out = &mut self.spare;
        for i in 0..self.string.len() {
            expander.expand(view, i, &mut |m| {
                out.push(m);
                out.len() <= limit
            })?;
            check_size(out, 0, 0, limit)?;
        }
        self.vm = expander.rewriter.vm;
        std::mem::swap(&mut self.string, &mut self.spare);
        Ok(())
    }
}

/// Hands every module of the final string to `sink`, expanded by the homomorphism.
/// Returns warnings.
/// # Errors
/// `Input` with L044 or L051 like [`super::derive`].
pub fn interpret(
    grammar: &Grammar,
    derived: &Derived,
    limits: &Limits,
    mut sink: impl FnMut(Module<'_>),
) -> Result<Vec<Diagnostic>> {
    let program = &grammar.program;
    let rules = &program.homomorphism;
    if rules.list.is_empty() {
        derived.modules.iter().for_each(sink);
        return Ok(Vec::new());
    }
    let brackets = brackets(program);
    let file_seed = rules.seed.unwrap_or(derived.file_seed);
    let streams = Streams { seed: derived.seed, plant_id: derived.plant_id, file_seed };
    let mut vm = Vm::new(streams, 0, derived.length);
    vm.globals.clone_from(&derived.globals);
    vm.step = derived.steps;
    vm.statement_limit = limits.get("statements");
    let setup = RewriteContext {
        program,
        rules,
        stochastic: derived.stochastic || rules.seed.is_some(),
        purposes: [Purpose::Homomorphism; 3],
        step: None,
        birth: 0,
        tag: word("homomorphism"),
        brackets,
    };
    let needs_partners = rules.list.iter().any(|p| !p.is_context_free());
    let partner = if needs_partners { matching::partners(&derived.modules, brackets) } else { Vec::new() };
    let hidden = program.hidden.table(&program.symbols);
    let view = ContextView { modules: &derived.modules, partner: &partner, hidden: &hidden };
    let waiting = usize::try_from(limits.get("modules")).unwrap_or(usize::MAX);
    let mut expander = Expander::new(setup, vm, waiting);
    let limit = limits.get("modules").saturating_mul(DRAWN_PER_STORED);
    let mut drawn = 0_u64;
    for i in 0..derived.modules.len() {
        let result = expander.expand(view, i, &mut |m| {
            drawn += 1;
            sink(m);
            drawn <= limit
        });
        result.map_err(|h| halt_error(grammar, h, derived.steps, limits))?;
    }
    Ok(warnings(grammar, &expander.rewriter.vm.events))
}
