//! One derivation step, which rewrites all modules at once, in parallel blocks.

use super::matching::{self, Brackets, ContextView};
use super::plan::{RewritePlan, SectionPlans};
use super::rewriter::{DrawPurposes, RewriteSettings, Rewriter};
use super::{Derivation, MAX_PARAMS};
use crate::modules::ModuleString;
use crate::program::Program;
use crate::symbols::SymbolId;
use crate::vm::Halt;
use osier_base::limits::Limits;
use osier_base::{convert, par};

/// Number of modules in a block, which one thread rewrites. Smaller blocks balance the threads better, larger ones need
/// fewer copies of the stack machine.
const BLOCK_MODULES: usize = 65_536;

/// Range of the string that one thread rewrites, and the result.
struct BlockTask {
    range: std::ops::Range<usize>,
    modules: ModuleString,
    changed: bool,
    vm: crate::vm::Vm,
    halt: Option<Halt>,
}

impl<'g> Derivation<'g> {
    /// Rewrites the string; true if any production was applied.
    pub(super) fn rewrite_string(&mut self, step: u32) -> Result<bool, Halt> {
        let plan = self.plans.rules.main();
        // Only productions with contexts need matched brackets; without them the table stays empty.
        let needs_partners = self.plans.rules.needs_partners();
        let partner =
            if needs_partners { matching::matching_brackets(&self.string, self.brackets) } else { Vec::new() };
        let settings = self.rewrite_settings(plan, step);
        let view = ContextView {
            modules: &self.string,
            partner: &partner,
            ignored: &self.ignored,
            is_ring: self.program.is_ring,
            is_reversed: false,
            borders: self.program.borders(),
        };
        let held = self.string.bytes() + 4 * partner.len();
        let budget = StringBudget::new(self.limits, held);
        let n = self.string.len();
        if !self.program.subsystems.is_empty() {
            let rewriter = Rewriter::new(settings, self.vm.take());
            let systems = SystemRuns { program: self.program, plans: &self.plans.rules };
            let (changed, vm) = systems.rewrite(rewriter, &view, &mut self.next_string, budget);
            self.vm = vm;
            std::mem::swap(&mut self.string, &mut self.next_string);
            return changed;
        }
        if self.program.steps_backward(&self.vm.globals) {
            let mut rewriter = Rewriter::new(settings, self.vm.take());
            let changed = rewrite_backward(&mut rewriter, &view, &mut self.next_string, budget);
            self.vm = rewriter.vm;
            std::mem::swap(&mut self.string, &mut self.next_string);
            return changed;
        }
        // Rewrite in one pass if the grammar is serial, that is, one module affects the next (global variables, predecessors
        // of several modules); for short strings and on a single thread, where parallel blocks do not pay; and if the limit
        // on bytes could end the step, because one pass detects that in time, while blocks need extra memory until they are joined.
        let may_pass = self.largest_result().saturating_mul(2) > budget.bytes;
        let in_one_pass = self.program.is_serial() || may_pass || n <= BLOCK_MODULES || par::threads() == 1;
        if !in_one_pass {
            // Every block begins with the state of the machine before the step. Random draws are addressed by lineage, not
            // by order, so that the blocks give the same string as a serial pass.
            let mut start = self.vm.clone();
            start.warnings.list.clear();
            let block = |i: usize| {
                // Reuse the buffers of the last step: touching fresh memory pages costs more than the rewriting itself.
                let mut modules = self.block_buffers.pop().unwrap_or_else(|| self.string.empty());
                modules.clear();
                let range = i * BLOCK_MODULES..((i + 1) * BLOCK_MODULES).min(n);
                BlockTask { range, modules, changed: false, vm: start.clone(), halt: None }
            };
            let mut blocks: Vec<BlockTask> = (0..n.div_ceil(BLOCK_MODULES)).map(block).collect();
            par::par_each(&mut blocks, |block| {
                let mut rewriter = Rewriter::new(settings, block.vm.clone());
                let result = rewrite_range(&mut rewriter, &view, block.range.clone(), &mut block.modules, budget);
                let result = result.map(|r| r.changed);
                block.changed = result.unwrap_or(false);
                block.vm = rewriter.vm;
                block.halt = result.err();
            });
            // All blocks together may exceed the limit on statements even if no single one does. One pass then ends at the
            // same statement for any number of threads.
            let used = blocks.iter().fold(self.vm.statements, |sum, b| sum + b.vm.statements - start.statements);
            if used <= self.vm.statement_limit {
                return self.join_blocks(blocks, budget);
            }
        }
        self.block_buffers.clear();
        let mut rewriter = Rewriter::new(settings, self.vm.take());
        self.next_string.clear();
        let rewritten = rewrite_range(&mut rewriter, &view, 0..n, &mut self.next_string, budget);
        self.vm = rewriter.vm;
        std::mem::swap(&mut self.string, &mut self.next_string);
        rewritten.map(|r| r.changed)
    }

    /// Settings of the main productions in one step, which addresses their draws and is the birth of the new modules.
    pub(super) fn rewrite_settings<'p>(&self, plan: &'p RewritePlan<'p>, step: u32) -> RewriteSettings<'p> {
        let purposes = DrawPurposes::of_productions();
        RewriteSettings { plan, purposes, step: Some(step), birth: step, tag: 0, brackets: self.brackets }
    }

    /// Upper bound of the next string's size, bytes: each module counts as the longest successor of its symbol.
    fn largest_result(&self) -> usize {
        // Bytes of a module: 2 for its symbol, 8 for its lineage, 4 for its birth, 4 for the end of its parameters; 4 for
        // each parameter.
        let one = |modules: usize, params: usize| 18 * modules + 4 * params;
        let mut longest = vec![0_usize; self.program.symbols.len()];
        for p in &self.program.rules.list {
            let params = p.successor.iter().map(|t| t.args.len()).sum();
            let slot = p.predecessor.first().and_then(|f| longest.get_mut(usize::from(f.symbol)));
            if let Some(slot) = slot {
                *slot = one(p.successor.len(), params).max(*slot);
            }
        }
        let copied = 4 * self.string.param_count();
        let of = |s: &SymbolId| longest.get(usize::from(*s)).copied().unwrap_or(0).max(one(1, 0));
        self.string.symbols().iter().map(of).fold(copied, usize::saturating_add)
    }

    /// Concatenates the rewritten blocks in order and merges their warnings and counters.
    fn join_blocks(&mut self, blocks: Vec<BlockTask>, budget: StringBudget) -> Result<bool, Halt> {
        // Each block counted its statements from the same start, so that only the differences are added.
        let before = self.vm.statements;
        let mut changed = false;
        self.next_string.clear();
        for block in blocks {
            self.vm.warnings.merge(block.vm.warnings);
            self.vm.statements += block.vm.statements - before;
            // Report the error of the first block in string order, as a serial pass would.
            if let Some(halt) = block.halt {
                return Err(halt);
            }
            changed |= block.changed;
            self.next_string.extend(&block.modules, 0..block.modules.len());
            budget.check(&self.next_string)?;
            self.block_buffers.push(block.modules);
        }
        std::mem::swap(&mut self.string, &mut self.next_string);
        Ok(changed)
    }
}

/// Limits on the size of a string.
#[derive(Debug, Clone, Copy)]
pub(super) struct StringBudget {
    pub modules: usize,
    pub bytes: usize,
}

impl StringBudget {
    /// The limits `modules` and `string-bytes`; other strings take `held` bytes of the latter.
    pub fn new(limits: &Limits, held: usize) -> Self {
        let bytes = convert::limit(limits.get("string-bytes")).saturating_sub(held);
        Self { modules: convert::limit(limits.get("modules")), bytes }
    }

    /// Fails if `out` exceeds the limits on modules, bytes or parameters.
    #[inline]
    pub fn check(self, out: &ModuleString) -> Result<(), Halt> {
        if out.len() > self.modules {
            return Err(Halt::Modules);
        }
        if out.bytes() > self.bytes {
            return Err(Halt::Bytes);
        }
        if out.param_count() > MAX_PARAMS {
            return Err(Halt::Parameters);
        }
        Ok(())
    }
}

/// Rewrites a string with sub-L-systems: the modules between two borders are rewritten by the productions of their L-system.
struct SystemRuns<'p> {
    program: &'p Program,
    plans: &'p SectionPlans<'p>,
}

impl<'p> SystemRuns<'p> {
    /// Rewrites a string run by run; returns whether any production was applied, and the machine.
    fn rewrite(
        &self,
        mut rewriter: Rewriter<'p>,
        view: &ContextView<'_>,
        out: &mut ModuleString,
        budget: StringBudget,
    ) -> (Result<bool, Halt>, crate::vm::Vm) {
        let program = self.program;
        let systems = program.systems_of(view.modules);
        let hidden = program.hidden_symbols();
        out.clear();
        let mut changed = false;
        let (mut start, mut rewritten_to) = (0, 0);
        for run in systems.chunk_by(|a, b| a == b) {
            // A predecessor of several modules may have consumed the first modules of this run.
            let (from, end) = (rewritten_to.max(start), start + run.len());
            start = end;
            if from >= end {
                continue;
            }
            let system = run.first().copied().unwrap_or(0);
            // Each L-system has its own productions and its own list of ignored symbols.
            rewriter.change_plan(self.plans.of(system));
            let view = view.of_system(&hidden, system);
            match rewrite_range(&mut rewriter, &view, from..end, out, budget) {
                Ok(r) => (changed, rewritten_to) = (changed || r.changed, r.end),
                Err(halt) => return (Err(halt), rewriter.vm),
            }
        }
        (Ok(changed), rewriter.vm)
    }
}

/// Result of rewriting a part of the string.
struct RewrittenRange {
    /// True if any production was applied.
    changed: bool,
    /// Index after its last module, which may lie beyond the requested end after a predecessor of several modules.
    end: usize,
}

/// Rewrites the modules of `range` into `out`.
fn rewrite_range(
    rewriter: &mut Rewriter<'_>,
    view: &ContextView<'_>,
    range: std::ops::Range<usize>,
    out: &mut ModuleString,
    budget: StringBudget,
) -> Result<RewrittenRange, Halt> {
    let plan = rewriter.settings.plan;
    let mut changed = false;
    let mut i = range.start;
    // Copy modules without productions in runs.
    let mut copied_to = i;
    while i < range.end {
        let symbol = view.modules.symbols()[i];
        if !plan.has_productions(symbol) {
            i += 1;
            continue;
        }
        let module = view.modules.get(i);
        let selected = if plan.reads_made {
            // The new string is complete up to this module: lend it to the contexts that read it.
            out.extend(view.modules, copied_to..i);
            copied_to = i;
            rewriter.made.lend(out, rewriter.settings.brackets);
            let selected = rewriter.select(module, view, i);
            rewriter.made.give_back(out);
            selected?
        } else {
            rewriter.select(module, view, i)?
        };
        let Some(p) = selected else {
            i += 1;
            continue;
        };
        // A production applies: copy the unchanged run before the module, then append the successor.
        out.extend(view.modules, copied_to..i);
        rewriter.append_successor(p, module.lineage(), out)?;
        budget.check(out)?;
        changed = true;
        // A predecessor of several modules consumes all of them.
        i += rewriter.planned(p).source.predecessor.len();
        copied_to = i;
    }
    if copied_to < range.end {
        out.extend(view.modules, copied_to..range.end);
    }
    budget.check(out)?;
    Ok(RewrittenRange { changed, end: i })
}

/// Rewrites all modules from the last to the first into `out`; true if any production was applied. Productions may have
/// contexts in the new string to the right of their module.
fn rewrite_backward(
    rewriter: &mut Rewriter<'_>,
    view: &ContextView<'_>,
    out: &mut ModuleString,
    budget: StringBudget,
) -> Result<bool, Halt> {
    // The new string is made in reverse, so that closing and opening brackets exchange roles. While it is reversed at the
    // end, two copies exist.
    let Brackets { open, close } = rewriter.settings.brackets;
    let turned = Brackets { open: close, close: open };
    let budget = StringBudget { bytes: budget.bytes / 2, ..budget };
    let (mut reversed, mut successor) = (view.modules.empty(), view.modules.empty());
    let mut changed = false;
    rewriter.is_backward = true;
    for i in (0..view.modules.len()).rev() {
        let module = view.modules.get(i);
        rewriter.made.lend(&mut reversed, turned);
        let selected = rewriter.select(module, view, i);
        rewriter.made.give_back(&mut reversed);
        successor.clear();
        match selected? {
            Some(p) => {
                rewriter.append_successor(p, module.lineage(), &mut successor)?;
                changed = true;
            }
            None => successor.push(module),
        }
        (0..successor.len()).rev().for_each(|k| reversed.push(successor.get(k)));
        budget.check(&reversed)?;
    }
    out.clear();
    (0..reversed.len()).rev().for_each(|k| out.push(reversed.get(k)));
    Ok(changed)
}
