//! One step: all modules are rewritten at once, blocks of them in parallel.

use super::matching::{self, ContextView};
use super::rewriter::{DrawPurposes, RewriteSettings, Rewriter};
use super::{Derivation, MAX_PARAMS};
use crate::modules::ModuleString;
use crate::program::ProductionSet;
use crate::vm::{DrawPurpose, Halt};
use osier_base::par;

/// Modules a block holds.
const BLOCK_MODULES: usize = 65_536;

/// A block while it is rewritten.
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
        let rules = &self.program.rules;
        let needs_partners = rules.list.iter().any(|p| !p.is_context_free());
        let partner =
            if needs_partners { matching::matching_brackets(&self.string, self.brackets) } else { Vec::new() };
        let settings = self.rewrite_settings(rules, step);
        let view = ContextView { modules: &self.string, partner: &partner, ignored: &self.ignored };
        let limit = usize::try_from(self.limits.get("modules")).unwrap_or(usize::MAX);
        let n = self.string.len();
        if self.program.is_serial() || n <= BLOCK_MODULES {
            let mut rewriter = Rewriter::new(settings, self.vm.clone());
            self.next_string.clear();
            let changed = rewrite_range(&mut rewriter, view, 0..n, &mut self.next_string, limit);
            self.vm = rewriter.vm;
            std::mem::swap(&mut self.string, &mut self.next_string);
            return changed;
        }
        let mut start = self.vm.clone();
        start.warnings.list.clear();
        let block = |i: usize| {
            let mut modules = self.block_buffers.pop().unwrap_or_default();
            modules.clear();
            let range = i * BLOCK_MODULES..((i + 1) * BLOCK_MODULES).min(n);
            BlockTask { range, modules, changed: false, vm: start.clone(), halt: None }
        };
        let mut blocks: Vec<BlockTask> = (0..n.div_ceil(BLOCK_MODULES)).map(block).collect();
        par::par_each(&mut blocks, |block| {
            let mut rewriter = Rewriter::new(settings, block.vm.clone());
            let result = rewrite_range(&mut rewriter, view, block.range.clone(), &mut block.modules, limit);
            block.changed = result.unwrap_or(false);
            block.vm = rewriter.vm;
            block.halt = result.err();
        });
        self.join_blocks(blocks, limit)
    }

    /// How modules are rewritten in a step.
    pub(super) fn rewrite_settings<'p>(&self, rules: &'p ProductionSet, step: u32) -> RewriteSettings<'p>
    where
        'g: 'p,
    {
        RewriteSettings {
            program: self.program,
            rules,
            stochastic: self.stochastic,
            purposes: DrawPurposes {
                statement: DrawPurpose::Statement,
                weight: DrawPurpose::Weight,
                choice: DrawPurpose::Choice,
            },
            step: Some(step),
            birth: step,
            tag: 0,
            brackets: self.brackets,
        }
    }

    /// Joins rewritten blocks in order.
    fn join_blocks(&mut self, blocks: Vec<BlockTask>, limit: usize) -> Result<bool, Halt> {
        let before = self.vm.statements;
        let mut changed = false;
        self.next_string.clear();
        for block in blocks {
            self.vm.warnings.merge(block.vm.warnings);
            self.vm.statements += block.vm.statements - before;
            if let Some(halt) = block.halt {
                return Err(halt);
            }
            changed |= block.changed;
            check_size(&block.modules, self.next_string.len(), self.next_string.param_count(), limit)?;
            self.next_string.extend(&block.modules, 0..block.modules.len());
            self.block_buffers.push(block.modules);
        }
        std::mem::swap(&mut self.string, &mut self.next_string);
        Ok(changed)
    }
}

/// Is there room for `out` beside what was made already?
pub(super) fn check_size(out: &ModuleString, modules: usize, params: usize, limit: usize) -> Result<(), Halt> {
    if out.len() + modules > limit {
        return Err(Halt::Modules);
    }
    if out.param_count() + params > MAX_PARAMS {
        return Err(Halt::Parameters);
    }
    Ok(())
}

/// Rewrites the modules of `range` into `out`; true if any production was applied.
pub(super) fn rewrite_range(
    rewriter: &mut Rewriter<'_>,
    view: ContextView<'_>,
    range: std::ops::Range<usize>,
    out: &mut ModuleString,
    limit: usize,
) -> Result<bool, Halt> {
    let rules = rewriter.settings.rules;
    let mut changed = false;
    let mut i = range.start;
    // Modules without productions are copied run by run.
    let mut copied_to = i;
    while i < range.end {
        let symbol = view.modules.symbols()[i];
        if !rules.has_productions(symbol) {
            i += 1;
            continue;
        }
        let module = view.modules.get(i);
        let Some(p) = rewriter.select(module, view, i)? else {
            i += 1;
            continue;
        };
        out.extend(view.modules, copied_to..i);
        rewriter.append_successor(p, module.lineage, out)?;
        check_size(out, 0, 0, limit)?;
        changed = true;
        i += p.predecessor.len();
        copied_to = i;
    }
    if copied_to < range.end {
        out.extend(view.modules, copied_to..range.end);
    }
    check_size(out, 0, 0, limit)?;
    Ok(changed)
}
