//! One step: all modules are rewritten at once, blocks of them in parallel.

use super::matching::{self, ContextView};
use super::rewriter::{RewriteContext, Rewriter};
use super::{Derivation, MAX_PARAMS, Modules};
use crate::program::Rules;
use crate::vm::{Halt, Purpose};
use osier_base::par;

/// Modules a block holds.
const BLOCK_MODULES: usize = 65_536;

/// A block while it is rewritten.
struct BlockTask {
    range: std::ops::Range<usize>,
    modules: Modules,
    changed: bool,
    vm: crate::vm::Vm,
    halt: Option<Halt>,
}

impl<'g> Derivation<'g> {
    /// Rewrites the string; true if any production was applied.
    pub(super) fn rewrite(&mut self, step: u32) -> Result<bool, Halt> {
        let rules = &self.program.rules;
        let needs_partners = rules.list.iter().any(|p| !p.is_context_free());
        let partner = if needs_partners { matching::partners(&self.string, self.brackets) } else { Vec::new() };
        let setup = self.setup(rules, step);
        let view = ContextView { modules: &self.string, partner: &partner, hidden: &self.hidden };
        let limit = usize::try_from(self.limits.get("modules")).unwrap_or(usize::MAX);
        let n = self.string.len();
        if self.program.is_serial() || n <= BLOCK_MODULES {
            let mut rewriter = Rewriter::new(setup, self.vm.clone());
            self.spare.clear();
            let changed = rewrite_range(&mut rewriter, view, 0..n, &mut self.spare, limit);
            self.vm = rewriter.vm;
            std::mem::swap(&mut self.string, &mut self.spare);
            return changed;
        }
        let mut start = self.vm.clone();
        start.events.0.clear();
        let part = |i: usize| {
            let mut modules = self.pool.pop().unwrap_or_default();
            modules.clear();
            let range = i * BLOCK_MODULES..((i + 1) * BLOCK_MODULES).min(n);
            BlockTask { range, modules, changed: false, vm: start.clone(), halt: None }
        };
        let mut parts: Vec<BlockTask> = (0..n.div_ceil(BLOCK_MODULES)).map(part).collect();
        par::par_each(&mut parts, |part| {
            let mut rewriter = Rewriter::new(setup, part.vm.clone());
            let result = rewrite_range(&mut rewriter, view, part.range.clone(), &mut part.modules, limit);
            part.changed = result.unwrap_or(false);
            part.vm = rewriter.vm;
            part.halt = result.err();
        });
        self.join(parts, limit)
    }

    /// How modules are rewritten in a step.
    pub(super) fn setup<'p>(&self, rules: &'p Rules, step: u32) -> RewriteContext<'p>
    where
        'g: 'p,
    {
        RewriteContext {
            program: self.program,
            rules,
            stochastic: self.stochastic,
            purposes: [Purpose::Statement, Purpose::Weight, Purpose::Choice],
            step: Some(step),
            birth: step,
            tag: 0,
            brackets: self.brackets,
        }
    }

    /// Joins rewritten blocks in order.
    fn join(&mut self, parts: Vec<BlockTask>, limit: usize) -> Result<bool, Halt> {
        let before = self.vm.statements;
        let mut changed = false;
        self.spare.clear();
        for part in parts {
            self.vm.events.merge(part.vm.events);
            self.vm.statements += part.vm.statements - before;
            if let Some(halt) = part.halt {
                return Err(halt);
            }
            changed |= part.changed;
            check_size(&part.modules, self.spare.len(), self.spare.param_count(), limit)?;
            self.spare.extend(&part.modules, 0..part.modules.len());
            self.pool.push(part.modules);
        }
        std::mem::swap(&mut self.string, &mut self.spare);
        Ok(changed)
    }
}

/// Is there room for `out` beside what was made already?
pub(super) fn check_size(out: &Modules, modules: usize, params: usize, limit: usize) -> Result<(), Halt> {
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
    out: &mut Modules,
    limit: usize,
) -> Result<bool, Halt> {
    let rules = rewriter.setup.rules;
    let mut changed = false;
    let mut i = range.start;
    // Modules without productions are copied run by run.
    let mut copied_to = i;
    while i < range.end {
        let symbol = view.modules.symbols()[i];
        if !rules.concerns(symbol) {
            i += 1;
            continue;
        }
        let module = view.modules.get(i);
        let Some(p) = rewriter.find(module, view, i)? else {
            i += 1;
            continue;
        };
        out.extend(view.modules, copied_to..i);
        rewriter.build(p, module.lineage, out)?;
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
