//! Chooses and applies productions, one module at a time.

use super::matching::{self, Brackets, ContextView};
use super::plan::{GroupId, PlannedProduction, ProductionGroup, RewritePlan, Weight};
use crate::modules::{Module, ModuleBlock, ModuleString};
use crate::program::Production;
use crate::vm::{DrawPurpose, Halt, Vm};
use osier_base::convert::to_usize;
use osier_base::math::narrow;
use osier_base::rng::{self, Rng};

/// Purposes of random draws, by the part of a production that makes them.
#[derive(Debug, Clone, Copy)]
pub(super) struct DrawPurposes {
    /// Statements, conditions and parameters of the successor.
    pub statement: DrawPurpose,
    pub weight: DrawPurpose,
    /// The choice among the productions that apply.
    pub choice: DrawPurpose,
}

impl DrawPurposes {
    /// Statements, weights and choices draw from separate streams, so that one does not shift the others.
    pub fn of_productions() -> Self {
        Self { statement: DrawPurpose::Statement, weight: DrawPurpose::Weight, choice: DrawPurpose::Choice }
    }

    /// One purpose for all parts.
    pub fn all(purpose: DrawPurpose) -> Self {
        Self { statement: purpose, weight: purpose, choice: purpose }
    }
}

/// The productions to apply, and how their draws and the modules they produce are labelled.
#[derive(Debug, Clone, Copy)]
pub(super) struct RewriteSettings<'p> {
    pub plan: &'p RewritePlan<'p>,
    pub purposes: DrawPurposes,
    /// Step of the draws; `None` for a homomorphism, whose draws do not change from step to step.
    pub step: Option<u32>,
    /// Written into the modules made.
    pub birth: u32,
    /// Mixed into lineages; 0 = nothing.
    pub tag: u64,
    pub brackets: Brackets,
}

/// A production that applies to the current module.
#[derive(Debug, Clone, Copy)]
struct Candidate {
    production: u32,
    /// Start of its local variables in `saved_locals`.
    offset: usize,
}

/// Selects and applies the productions of one section.
#[derive(Debug)]
pub(super) struct Rewriter<'p> {
    pub settings: RewriteSettings<'p>,
    pub vm: Vm,
    locals: Vec<f64>,
    /// Productions that apply to the current module.
    candidates: Vec<Candidate>,
    saved_locals: Vec<f64>,
    weights: Vec<f64>,
}

impl<'p> Rewriter<'p> {
    pub fn new(settings: RewriteSettings<'p>, vm: Vm) -> Self {
        let (locals, candidates, saved_locals, weights) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        Self { settings, vm, locals, candidates, saved_locals, weights }
    }

    /// The production of an index.
    #[inline]
    pub fn planned(&self, production: u32) -> &'p PlannedProduction<'p> {
        &self.settings.plan.productions[to_usize(production)]
    }

    /// Draws from here on are for `purpose` and belong to the module of lineage `h`.
    fn begin_draws(&mut self, purpose: DrawPurpose, h: u64) {
        self.vm.begin_draws(purpose, h, self.settings.step);
    }

    /// Makes the parameters of a module the first local variables, of `count` in all.
    #[inline]
    fn load_params(&mut self, params: &[f32], count: usize) {
        self.locals.clear();
        self.locals.extend(params.iter().map(|v| f64::from(*v)));
        if self.locals.len() != count {
            self.locals.resize(count, 0.0);
        }
    }

    /// Tests a production that looks at nothing but the module and its condition.
    #[inline]
    fn simple_applies(&mut self, p: &PlannedProduction<'_>, params: &[f32]) -> Result<bool, Halt> {
        self.load_params(params, p.source.locals);
        match &p.condition {
            None => Ok(true),
            Some(condition) => Ok(!crate::code::is_zero(condition.value(&mut self.vm, &mut self.locals)?)),
        }
    }

    /// Tests a production at `module`, the module of index `at`: predecessor, contexts, condition. Local variables hold its
    /// parameters afterwards if it applies.
    fn applies(&mut self, p: &Production, module: Module<'_>, view: ContextView<'_>, at: usize) -> Result<bool, Halt> {
        self.locals.clear();
        self.locals.resize(p.locals, 0.0);
        // Strict predecessor: the module itself, then its right neighbours one by one.
        let Some((first, others)) = p.predecessor.split_first() else { return Ok(false) };
        if !matching::match_module(first, module, &mut self.locals) {
            return Ok(false);
        }
        for (k, formal) in others.iter().enumerate() {
            let i = at + 1 + k;
            if i >= view.modules.len() || !matching::match_module(formal, view.modules.get(i), &mut self.locals) {
                return Ok(false);
            }
        }
        // Contexts: to the left of the first module, to the right of the last one.
        let brackets = self.settings.brackets;
        if !view.matches_left(brackets, &p.left, at, &mut self.locals)
            || !view.matches_right(brackets, &p.right, at + p.predecessor.len(), &mut self.locals)
        {
            return Ok(false);
        }
        // The block before the condition may assign variables that the condition reads.
        if let Some(code) = &p.before {
            self.vm.run(code, &mut self.locals)?;
        }
        if let Some(code) = &p.condition
            && crate::code::is_zero(self.vm.run(code, &mut self.locals)?)
        {
            return Ok(false);
        }
        if let Some(code) = &p.after {
            self.vm.run(code, &mut self.locals)?;
        }
        Ok(true)
    }

    /// The production to apply to a module, with its local variables set; `None`: the module is copied unchanged. `view` and
    /// `at`: the string that contexts see, and the module's place in it.
    #[inline]
    pub fn select(&mut self, module: Module<'_>, view: ContextView<'_>, at: usize) -> Result<Option<u32>, Halt> {
        let Some(group) = self.settings.plan.group(module.symbol, module.params.len()) else { return Ok(None) };
        self.select_in_group(group, module, view, at)
    }

    /// As [`Rewriter::select`], for a module whose group is known.
    #[inline]
    pub fn select_in_group(
        &mut self,
        group: GroupId,
        module: Module<'_>,
        view: ContextView<'_>,
        at: usize,
    ) -> Result<Option<u32>, Halt> {
        let plan = self.settings.plan;
        let group = &plan.groups[to_usize(group)];
        self.begin_draws(self.settings.purposes.statement, module.lineage);
        if let Some(p) = group.always {
            self.load_params(module.params, self.planned(p).source.locals);
            return Ok(Some(p));
        }
        // Deterministic L-system: the first production in file order that applies.
        if !plan.stochastic {
            for &p in &group.productions {
                if self.production_applies(p, module, view, at)? {
                    return Ok(Some(p));
                }
            }
            return Ok(None);
        }
        self.draw_one(group, module, view, at)
    }

    fn production_applies(
        &mut self,
        p: u32,
        module: Module<'_>,
        view: ContextView<'_>,
        at: usize,
    ) -> Result<bool, Halt> {
        let planned = self.planned(p);
        if planned.is_simple {
            return self.simple_applies(planned, module.params);
        }
        self.applies(planned.source, module, view, at)
    }

    /// Stochastic L-system: collects every production that applies, with its variables, and draws one by weight.
    fn draw_one(
        &mut self,
        group: &ProductionGroup,
        module: Module<'_>,
        view: ContextView<'_>,
        at: usize,
    ) -> Result<Option<u32>, Halt> {
        self.candidates.clear();
        self.saved_locals.clear();
        for &p in &group.productions {
            if self.production_applies(p, module, view, at)? {
                self.candidates.push(Candidate { production: p, offset: self.saved_locals.len() });
                self.saved_locals.extend_from_slice(&self.locals);
            }
        }
        // A single candidate is taken without a draw, whatever its weight.
        let chosen = match self.candidates.len() {
            0 => return Ok(None),
            1 => 0,
            _ => self.choose(module.lineage)?,
        };
        let Some(&Candidate { production: p, offset }) = self.candidates.get(chosen) else { return Ok(None) };
        self.locals.clear();
        // Testing later candidates overwrote the local variables; restore those of the chosen one.
        let locals = self.planned(p).source.locals;
        self.locals.extend_from_slice(&self.saved_locals[offset..offset + locals]);
        Ok(Some(p))
    }

    /// Index of the candidate drawn by weight.
    fn choose(&mut self, h: u64) -> Result<usize, Halt> {
        self.weights.clear();
        let mut resume = None;
        for k in 0..self.candidates.len() {
            let Candidate { production, offset } = self.candidates[k];
            let p = self.planned(production);
            let weight = match p.weight {
                Weight::Constant(w) => w,
                Weight::Code(code) => {
                    // Weights have a stream of their own, so that their draws do not shift those of the successor.
                    if resume.is_none() {
                        resume = Some(self.vm.save_draws());
                        self.begin_draws(self.settings.purposes.weight, h);
                        self.vm.set_draw_number(1 << 32);
                    }
                    let locals = &mut self.saved_locals[offset..offset + p.source.locals];
                    self.vm.run(code, locals)?
                }
            };
            // Invalid weights are reported and count as 0, so that the rest still forms a distribution.
            if weight.is_nan() || weight < 0.0 {
                self.vm.warnings.add("L033", p.source.place, "negative or NaN weight counts as 0");
            }
            self.weights.push(if weight > 0.0 { weight } else { 0.0 });
        }
        if let Some(resume) = resume {
            self.vm.restore_draws(resume);
        }
        if !self.weights.iter().any(|w| *w > 0.0) {
            let place = self.planned(self.candidates[0].production).source.place;
            self.vm.warnings.add("L034", place, "all weights are 0, the first production is taken");
            return Ok(0);
        }
        // The choice is drawn at the address u64::MAX of the module, which statements and weights, numbered from 0 and
        // 2^32, cannot reach.
        let key = self.vm.streams.key(self.settings.purposes.choice, h, self.settings.step);
        Ok(Rng::from_key(rng::child(key, u64::MAX)).pick(&self.weights))
    }

    /// Appends the parameters of the successor of a production that was selected.
    #[inline]
    pub fn append_params(&mut self, p: &PlannedProduction<'_>, out: &mut Vec<f32>) -> Result<(), Halt> {
        let start = out.len();
        out.extend_from_slice(&p.template.constants);
        for parameter in &p.template.computed {
            let value = narrow(parameter.value.value(&mut self.vm, &mut self.locals)?);
            for target in &parameter.targets {
                out[start + to_usize(*target)] = value;
            }
        }
        Ok(())
    }

    /// Appends the successor of a production that [`Rewriter::select`] chose for the module of lineage `h`.
    pub fn append_successor(&mut self, production: u32, h: u64, out: &mut ModuleString) -> Result<(), Halt> {
        // The tag separates the lineages of a homomorphism from those of the string that it draws.
        let h = if self.settings.tag == 0 { h } else { rng::child(h, self.settings.tag) };
        let planned = self.planned(production);
        let template = &planned.template;
        let first_param = out.param_count();
        self.append_params(planned, out.params_mut())?;
        let block = ModuleBlock { symbols: &template.symbols, ends: &template.ends, first_param };
        out.finish_modules(block, template.ids.iter().map(|ids| ids.lineage(h)), self.settings.birth);
        Ok(())
    }
}
