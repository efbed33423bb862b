//! A step in the order of the program cpfg: each module is rewritten and decomposed before the next one, so that random
//! numbers drawn one after the other are used in the same places as in cpfg.

use super::Derivation;
use super::expand::Expander;
use super::matching::{self, ContextView};
use super::rewriter::{DrawPurposes, RewriteSettings, Rewriter};
use super::step::StringBudget;
use crate::modules::ModuleString;
use crate::vm::{DrawPurpose, Halt};

impl Derivation<'_> {
    /// Rewrites the string in cpfg's order; true if any production was applied.
    pub(super) fn rewrite_in_order(&mut self, step: u32) -> Result<bool, Halt> {
        // Context matching needs the partners of brackets.
        let decomposition = &self.plans.decomposition;
        let looks_around = self.plans.rules.needs_partners() || decomposition.needs_partners();
        let partner = if looks_around { matching::matching_brackets(&self.string, self.brackets) } else { Vec::new() };
        let hidden = self.program.hidden_symbols();
        let mut view = ContextView {
            modules: &self.string,
            partner: &partner,
            ignored: &self.ignored,
            is_ring: self.program.is_ring,
            is_reversed: false,
            borders: self.program.borders(),
        };
        let budget = StringBudget::new(self.limits, self.string.bytes() + 4 * partner.len());
        let limit = budget.modules;
        let decomposing = RewriteSettings {
            plan: decomposition.main(),
            purposes: DrawPurposes::all(DrawPurpose::Decomposition),
            step: Some(step),
            birth: step,
            tag: 0,
            brackets: self.brackets,
        };
        let mut rewriter = Rewriter::new(self.rewrite_settings(self.plans.rules.main(), step), self.vm.clone());
        let mut expander = Expander::new(decomposing, decomposition, self.vm.clone(), limit);
        let systems = self.program.systems_of(&self.string);
        let (out, mut successor) = (&mut self.next_string, ModuleString::default());
        out.clear();
        let (mut changed, mut i) = (false, 0);
        while i < view.modules.len() {
            // Modules of another L-system of the file use its productions and its ignored symbols.
            if let Some(system) = systems.get(i) {
                rewriter.change_plan(self.plans.rules.of(*system));
                expander.change_plan(decomposition.of(*system));
                view = view.of_system(&hidden, *system);
            }
            let module = view.modules.get(i);
            // Contexts of the new string read the part made so far.
            let reads_made = rewriter.settings.plan.reads_made;
            if reads_made {
                rewriter.made.lend(out, rewriter.settings.brackets);
            }
            // Every module draws a number, even if no production can apply to it.
            let selected = if rewriter.settings.plan.stochastic {
                rewriter.select_by_number(module, &view, i)
            } else {
                rewriter.select(module, &view, i)
            };
            if reads_made {
                rewriter.made.give_back(out);
            }
            // Make the successor; a module to which no production applies stays as it is.
            successor.clear();
            let mut taken = 1;
            match selected? {
                Some(p) => {
                    rewriter.append_successor(p, module.lineage(), &mut successor)?;
                    taken = rewriter.planned(p).source.predecessor.len();
                    changed = true;
                }
                None => successor.push(module),
            }
            // Decompose the successor at once, before the next module is rewritten.
            if decomposition.is_empty() {
                out.extend(&successor, 0..successor.len());
            } else {
                // Both use the same machine in turn, so that its random numbers and variables continue.
                std::mem::swap(&mut rewriter.vm, expander.vm());
                expander.expand_successor(&successor, &view, i..i + taken, &mut |m| {
                    out.push(m);
                    out.len() <= limit
                })?;
                std::mem::swap(&mut rewriter.vm, expander.vm());
            }
            budget.check(out)?;
            i += taken;
        }
        changed |= expander.has_applied();
        self.vm = rewriter.vm;
        std::mem::swap(&mut self.string, &mut self.next_string);
        Ok(changed)
    }
}
