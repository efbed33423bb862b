//! Chooses and applies productions, one module at a time.

use super::matching::{self, Brackets, ContextView, MadeString};
use super::plan::{Condition, GroupId, PlannedProduction, ProductionGroup, RewritePlan, Template, Weight};
use super::registers::{RegisterFile, ValueSource};
use crate::cpfg_random::CpfgRandom;
use crate::modules::{Module, ModuleBlock, ModuleString};
use crate::vm::{DrawPurpose, Halt, Vm};
use osier_base::convert::{saturating_index, to_usize};
use osier_base::math::narrow;
use osier_base::rng::{self, Rng};

/// Draw number of the choice, u64::MAX: statements number their draws from 0 and weights from 2^32, so that they never reach it.
const CHOICE: rng::ChildId = rng::ChildId::new(u64::MAX);

/// The streams from which the choices of productions are drawn in one step. The part of the address that all modules share
/// is hashed once.
#[derive(Debug, Clone, Copy)]
pub(super) struct StepChoices {
    /// Key of the draw purpose.
    key: u64,
    step: rng::ChildId,
}

impl StepChoices {
    /// The stream of the choice for the module of lineage `h`.
    #[inline]
    pub fn stream(&self, h: u64) -> Rng {
        Rng::from_key(CHOICE.of(self.step.of(rng::child(self.key, h))))
    }
}

/// Purposes of random draws, for each part of a production that draws.
#[derive(Debug, Clone, Copy)]
pub(super) struct DrawPurposes {
    /// Statements, conditions and parameters of the successor.
    pub statement: DrawPurpose,
    pub weight: DrawPurpose,
    /// The choice among the productions that apply.
    pub choice: DrawPurpose,
}

impl DrawPurposes {
    /// Separate purposes for statements, weights and choices, so that draws of one do not affect the others.
    pub fn of_productions() -> Self {
        Self { statement: DrawPurpose::Statement, weight: DrawPurpose::Weight, choice: DrawPurpose::Choice }
    }

    /// One purpose for all draws.
    pub fn all(purpose: DrawPurpose) -> Self {
        Self { statement: purpose, weight: purpose, choice: purpose }
    }
}

/// The productions to apply, and how their draws and the modules they make are addressed.
#[derive(Debug, Clone, Copy)]
pub(super) struct RewriteSettings<'p> {
    pub plan: &'p RewritePlan<'p>,
    pub purposes: DrawPurposes,
    /// Step of the draws; `None` for a homomorphism, whose draws do not change from step to step.
    pub step: Option<u32>,
    /// Step of birth of the new modules.
    pub birth: u32,
    /// Hashed into lineages; 0 for none.
    pub tag: u64,
    pub brackets: Brackets,
}

/// Modules after the current one that a predecessor of several modules may consume, if they are not in the string.
#[derive(Debug)]
pub(super) struct Followers {
    pub modules: ModuleString,
    /// Position in the string at which right contexts begin.
    pub context_from: usize,
}

/// Selects and applies the productions of one section.
#[derive(Debug)]
pub(super) struct Rewriter<'p> {
    pub settings: RewriteSettings<'p>,
    pub vm: Vm,
    /// Modules that a predecessor of several modules may consume; `None` for those that follow in the string.
    pub followers: Option<Followers>,
    /// Register file of each production, which begins with its local variables.
    files: Vec<RegisterFile>,
    /// Productions that apply to the current module.
    candidates: Vec<u32>,
    weights: Vec<f64>,
    /// A step, and the part of the address of its choices that all modules share.
    choice_step: Option<(u32, StepChoices)>,
    /// The string is rewritten from its end.
    pub is_backward: bool,
    /// The new string, while the productions that read it are tested.
    pub made: MadeString,
}

impl<'p> Rewriter<'p> {
    pub fn new(settings: RewriteSettings<'p>, vm: Vm) -> Self {
        let files = Self::register_files(settings.plan);
        Self {
            settings,
            vm,
            followers: None,
            files,
            candidates: Vec::new(),
            weights: Vec::new(),
            choice_step: None,
            is_backward: false,
            made: MadeString::default(),
        }
    }

    fn register_files(plan: &RewritePlan<'_>) -> Vec<RegisterFile> {
        plan.productions.iter().map(|p| p.registers.initial.clone()).collect()
    }

    /// Switches to the productions of another L-system.
    pub fn change_plan(&mut self, plan: &'p RewritePlan<'p>) {
        if !std::ptr::eq(self.settings.plan, plan) {
            self.settings.plan = plan;
            self.files = Self::register_files(plan);
        }
    }

    #[inline]
    pub fn planned(&self, production: u32) -> &'p PlannedProduction<'p> {
        &self.settings.plan.productions[to_usize(production)]
    }

    /// The production drawn for a module of lineage `h` in `step`, if those of its group compete without conditions; else
    /// `None`. The step is hashed once for all modules.
    #[inline]
    pub fn draw_in_step(&mut self, group: GroupId, h: u64, step: u32) -> Option<u32> {
        let group = &self.settings.plan.groups[to_usize(group)];
        let shares = group.shares.as_ref()?;
        let choices = match self.choice_step {
            Some((s, choices)) if s == step => choices,
            _ => {
                let choices = self.step_choices(step);
                self.choice_step = Some((step, choices));
                choices
            }
        };
        group.productions.get(shares.pick(&mut choices.stream(h))).copied()
    }

    /// The random streams for choices of productions in `step`.
    pub fn step_choices(&self, step: u32) -> StepChoices {
        let key = self.vm.streams.purpose_key(self.settings.purposes.choice);
        StepChoices { key, step: rng::ChildId::new(u64::from(step)) }
    }

    /// Makes `step` the current one. `globals`: global variables of each step, if blocks change them.
    #[inline]
    pub fn begin_step(&mut self, step: u32, globals: &[Vec<f64>]) {
        if self.vm.step == step && self.settings.step == Some(step) {
            return;
        }
        self.vm.step = step;
        self.settings.step = Some(step);
        if let Some(values) = globals.get(to_usize(step - 1)) {
            self.vm.globals.clone_from(values);
        }
    }

    /// Makes all draws from here on those of the module of lineage `h`, for `purpose`.
    #[inline]
    fn begin_draws(&mut self, purpose: DrawPurpose, h: u64) {
        self.vm.begin_draws(purpose, h, self.settings.step);
    }

    /// Stores the parameters of a module in the first local variables of a production.
    #[inline]
    fn load_params(&mut self, production: u32, params: &[f32]) {
        let planned = self.planned(production);
        let file = &mut self.files[to_usize(production)];
        for (local, value) in file.iter_mut().zip(params) {
            *local = f64::from(*value);
        }
        if planned.locals > params.len() {
            file[params.len()..planned.locals].fill(0.0);
        }
        planned.registers.load_outside(&self.vm, file);
    }

    /// Evaluates the condition of a production, whose local variables must be set.
    #[inline]
    fn condition_holds(&mut self, production: u32) -> Result<bool, Halt> {
        let planned = self.planned(production);
        let Condition::Value(source, code) = planned.condition else { return Ok(true) };
        let file = &mut self.files[to_usize(production)];
        let value = match source {
            ValueSource::Constant(c) => c,
            ValueSource::Register(r) if planned.registers.run_condition(file) => file[usize::from(r)],
            // The stack machine evaluates the condition again and reports the division by zero.
            ValueSource::Register(_) | ValueSource::Code(_) => self.vm.run(code, &mut file[..planned.locals])?,
        };
        Ok(!crate::code::is_zero(value))
    }

    /// Tests a production with contexts or blocks on `module`, which has index `at`. If the production applies, its local
    /// variables hold the matched parameters. The block after the condition runs later, when the production is applied.
    fn applies(
        &mut self,
        production: u32,
        module: Module<'_>,
        view: &ContextView<'_>,
        at: usize,
    ) -> Result<bool, Halt> {
        let planned = self.planned(production);
        let p = planned.source;
        let file = &mut self.files[to_usize(production)];
        let locals = &mut file[..p.locals];
        locals.fill(0.0);
        // Strict predecessor: the module itself, then its right neighbours one by one.
        let Some((first, others)) = p.predecessor.split_first() else { return Ok(false) };
        if !matching::match_module(first, module, locals) {
            return Ok(false);
        }
        for (k, formal) in others.iter().enumerate() {
            let (modules, i) = match &self.followers {
                Some(f) => (&f.modules, k),
                None => (view.modules, at + 1 + k),
            };
            if i >= modules.len() || !matching::match_module(formal, modules.get(i), locals) {
                return Ok(false);
            }
        }
        let right = self.followers.as_ref().map_or(at + p.predecessor.len(), |f| f.context_from);
        // Contexts: to the left of the first module, to the right of the last one.
        let brackets = self.settings.brackets;
        let ignored = planned.ignored.as_deref().unwrap_or(view.ignored);
        let view = &ContextView { ignored, ..*view };
        if !view.matches_left(brackets, &p.left, at, locals) || !view.matches_right(brackets, &p.right, right, locals) {
            return Ok(false);
        }
        // Contexts of the new string exist only on the side that has been rewritten already: to the left in a forward pass, to
        // the right in a backward pass.
        let made = &mut self.made;
        if !p.new_left.is_empty() && (self.is_backward || !made.ends_with(view, brackets, &p.new_left, locals)) {
            return Ok(false);
        }
        if !p.new_right.is_empty() && (!self.is_backward || !made.begins_with(view, brackets, &p.new_right, locals)) {
            return Ok(false);
        }
        // The block before the condition may assign variables that the condition reads.
        if let Some(code) = &p.before {
            self.vm.run(code, locals)?;
        }
        planned.registers.load_outside(&self.vm, file);
        self.condition_holds(production)
    }

    /// Runs the block after the condition of the chosen production; those of the others have no effect.
    fn run_after(&mut self, production: u32) -> Result<(), Halt> {
        let planned = self.planned(production);
        if let Some(code) = &planned.source.after {
            let file = &mut self.files[to_usize(production)];
            self.vm.run(code, &mut file[..planned.locals])?;
            planned.registers.load_outside(&self.vm, file);
        }
        Ok(())
    }

    /// Selects the production to apply to a module and sets its local variables; `None` if the module stays unchanged.
    /// `view` and `at`: the string for context matching, and the module's index in it.
    #[inline]
    pub fn select(&mut self, module: Module<'_>, view: &ContextView<'_>, at: usize) -> Result<Option<u32>, Halt> {
        let Some(group) = self.settings.plan.group(module.symbol, module.params.len()) else { return Ok(None) };
        self.select_in_group(group, module, view, at)
    }

    /// Like [`Rewriter::select`], for a module whose group is known.
    #[inline]
    pub fn select_in_group(
        &mut self,
        group: GroupId,
        module: Module<'_>,
        view: &ContextView<'_>,
        at: usize,
    ) -> Result<Option<u32>, Halt> {
        let plan = self.settings.plan;
        let group = &plan.groups[to_usize(group)];
        if plan.draws {
            self.begin_draws(self.settings.purposes.statement, module.lineage());
        }
        if let Some(p) = group.always {
            self.load_params(p, module.params);
            return Ok(Some(p));
        }
        // Deterministic L-system: the first production in file order that applies.
        if !plan.stochastic {
            for &p in &group.productions {
                let applies = if group.is_simple {
                    self.load_params(p, module.params);
                    self.condition_holds(p)?
                } else {
                    self.production_applies(p, module, view, at)?
                };
                if applies {
                    self.run_after(p)?;
                    return Ok(Some(p));
                }
            }
            return Ok(None);
        }
        // Stochastic L-system: draw a production among those that apply.
        if let Some(shares) = &group.shares {
            let chosen = shares.pick(&mut self.choice_stream(module.lineage()));
            let p = group.productions[chosen];
            self.load_params(p, module.params);
            return Ok(Some(p));
        }
        self.draw_candidate(group, module, view, at)
    }

    fn production_applies(
        &mut self,
        p: u32,
        module: Module<'_>,
        view: &ContextView<'_>,
        at: usize,
    ) -> Result<bool, Halt> {
        if self.planned(p).is_simple {
            self.load_params(p, module.params);
            return self.condition_holds(p);
        }
        self.applies(p, module, view, at)
    }

    /// Sets the local variables of a production that was drawn for a module.
    #[inline]
    pub fn take(&mut self, production: u32, module: Module<'_>) {
        if self.settings.plan.draws {
            self.begin_draws(self.settings.purposes.statement, module.lineage());
        }
        self.load_params(production, module.params);
    }

    /// Collects every production that applies, each with its variables in its register file, and draws one by weight.
    fn draw_candidate(
        &mut self,
        group: &ProductionGroup,
        module: Module<'_>,
        view: &ContextView<'_>,
        at: usize,
    ) -> Result<Option<u32>, Halt> {
        self.candidates.clear();
        for &p in &group.productions {
            if self.production_applies(p, module, view, at)? {
                self.candidates.push(p);
            }
        }
        // A single candidate is taken without a draw, whatever its weight.
        let chosen = match self.candidates.len() {
            0 => return Ok(None),
            1 => 0,
            _ => self.choose(module.lineage())?,
        };
        let Some(&production) = self.candidates.get(chosen) else { return Ok(None) };
        self.run_after(production)?;
        Ok(Some(production))
    }

    /// Selects a production by weight with cpfg's next random number, which every module consumes, and sets its local
    /// variables. Weights are computed directly after their conditions, in file order.
    pub fn select_by_number(
        &mut self,
        module: Module<'_>,
        view: &ContextView<'_>,
        at: usize,
    ) -> Result<Option<u32>, Halt> {
        let plan = self.settings.plan;
        self.candidates.clear();
        self.weights.clear();
        let group = plan.group(module.symbol, module.params.len());
        for &p in group.map_or(&[][..], |g| &plan.groups[to_usize(g)].productions) {
            if self.production_applies(p, module, view, at)? {
                let weight = self.weight(p)?;
                self.candidates.push(p);
                self.weights.push(weight);
            }
        }
        let number = self.vm.cpfg.as_mut().map_or(0.0, CpfgRandom::choice);
        // cpfg computes this in single precision, which matters at the limits between productions.
        let total = self.weights.iter().fold(0.0_f32, |s, w| s + narrow(*w));
        let mut rest = narrow(f64::from(total) * number);
        for (k, weight) in self.weights.iter().enumerate() {
            rest -= narrow(*weight);
            if rest <= 0.0 {
                let production = self.candidates[k];
                self.run_after(production)?;
                return Ok(Some(production));
            }
        }
        Ok(None)
    }

    /// Weight of a production whose local variables are set; an invalid one is reported and counts as 0.
    fn weight(&mut self, production: u32) -> Result<f64, Halt> {
        let p = self.planned(production);
        let weight = match p.weight {
            Weight::Constant(w) => w,
            Weight::Code(code) => self.vm.run(code, &mut self.files[to_usize(production)][..p.locals])?,
        };
        if weight.is_nan() || weight < 0.0 {
            self.vm.warnings.add("L033", p.source.place, "negative or NaN weight counts as 0");
        }
        // Invalid weights count as 0, so that the others still form a distribution.
        Ok(if weight > 0.0 { weight } else { 0.0 })
    }

    /// The random stream for the choice of a production for the module of lineage `h`.
    #[inline]
    fn choice_stream(&self, h: u64) -> Rng {
        let key = self.vm.streams.key(self.settings.purposes.choice, h, self.settings.step);
        Rng::from_key(CHOICE.of(key))
    }

    /// Index of the candidate drawn by weight; the first one, with L034, if all weights are 0.
    fn choose(&mut self, h: u64) -> Result<usize, Halt> {
        self.weights.clear();
        let mut resume = None;
        for k in 0..self.candidates.len() {
            let production = self.candidates[k];
            // Weights draw from a separate stream, so that they do not affect the draws of the successor.
            if resume.is_none() && matches!(self.planned(production).weight, Weight::Code(_)) {
                resume = Some(self.vm.save_draws());
                self.begin_draws(self.settings.purposes.weight, h);
                self.vm.set_draw_number(1 << 32);
            }
            let weight = self.weight(production)?;
            self.weights.push(weight);
        }
        if let Some(resume) = resume {
            self.vm.restore_draws(resume);
        }
        if !self.weights.iter().any(|w| *w > 0.0) {
            let place = self.planned(self.candidates[0]).source.place;
            self.vm.warnings.add("L034", place, "all weights are 0, the first production is taken");
            return Ok(0);
        }
        Ok(self.choice_stream(h).pick(&self.weights))
    }

    /// Appends the parameters of the successor of a production that was selected.
    #[inline]
    pub fn append_params(&mut self, production: u32, out: &mut Vec<f32>) -> Result<(), Halt> {
        let planned = self.planned(production);
        let template: &Template<'_> = &planned.template;
        let start = out.len();
        out.extend_from_slice(&template.constants);
        if template.computed.is_empty() {
            return Ok(());
        }
        let file = &mut self.files[to_usize(production)];
        let divides_by_zero = !planned.registers.run_successor(file);
        let params = &mut out[start..];
        for parameter in &template.computed {
            let value = match (parameter.source, parameter.code) {
                (ValueSource::Constant(c), _) => c,
                // The stack machine evaluates the expression again and reports the division by zero.
                (ValueSource::Register(_), Some(code)) if divides_by_zero => {
                    self.vm.run(code, &mut file[..planned.locals])?
                }
                (ValueSource::Register(r), _) => file[usize::from(r)],
                (ValueSource::Code(code), _) => self.vm.run(code, &mut file[..planned.locals])?,
            };
            params[to_usize(parameter.target)] = narrow(value);
        }
        Ok(())
    }

    /// Appends the successor of a production that [`Rewriter::select`] chose for the module of lineage `h`.
    pub fn append_successor(&mut self, production: u32, h: u64, out: &mut ModuleString) -> Result<(), Halt> {
        // The tag makes lineages of a homomorphism differ from those of the string that it interprets.
        let h = if self.settings.tag == 0 { h } else { rng::child(h, self.settings.tag) };
        let planned = self.planned(production);
        let template = &planned.template;
        let first_param = saturating_index(out.param_count());
        self.append_params(production, out.params_mut())?;
        let block = ModuleBlock { symbols: &template.symbols, ends: &template.ends, first_param };
        out.append_modules(block, template.ids.iter().map(|ids| ids.lineage(h)), self.settings.birth);
        Ok(())
    }
}
