//! Derivation depth first, for L-systems whose modules are rewritten independently of each other: each module is rewritten through
//! all remaining steps before the next one, so that no string is stored. The modules come out in the order of the final string.
//!
//! ```text
//! axiom   A ............................ B      frame 0: next active module A
//!         |
//! step 1  F [ + A ] A                            frame 1: emits "F [ +", then descends into A
//!             |
//! step 2      F [ + A ] A                        last step: emitted whole
//! ```

use std::ops::{ControlFlow, Range};

use super::matching::{Brackets, ContextView};
use super::plan::{RewritePlan, Template, TemplateText};
use super::registers::RegisterCompiler;
use super::rewriter::{DrawPurposes, RewriteSettings, Rewriter};
use crate::modules::{Ancestry, LineageIds, Module, ModuleBlock, ModuleString};
use crate::program::Program;
use crate::symbols::SymbolId;
use crate::vm::{Halt, Vm};
use osier_base::convert::{saturating_index, to_usize};

/// Receives the modules of a final string, in order.
pub(super) trait ModuleSink {
    /// True if the sink reads lineages, which cost time to compute.
    const NEEDS_LINEAGE: bool;
    /// If false, a derivation skips the parameters of modules that are not rewritten any more.
    const NEEDS_PARAMS: bool = true;

    /// Receives modules `range` of a block; `Break` ends the derivation.
    fn modules(&mut self, block: &Block<'_>, range: Range<usize>) -> ControlFlow<()>;
}

/// The modules that one application of a production made, or a single module that was kept.
#[derive(Debug, Clone, Copy)]
pub(super) struct Block<'a> {
    pub symbols: &'a [SymbolId],
    /// Per module: end index of its parameters in `params`.
    ends: &'a [u32],
    params: &'a [f32],
    ids: &'a [LineageIds],
    /// Lineages of modules that are known, as those of the axiom, which have no parent; empty for all other blocks.
    axiom_lineages: &'a [u64],
    /// Lineage of the module that was rewritten; 0 where no lineage is needed.
    parent: u64,
    birth: u32,
    /// Text of the modules, if none of them has parameters.
    pub text: Option<&'a TemplateText>,
}

impl<'a> Block<'a> {
    #[inline]
    pub fn new(
        template: &'a Template<'_>,
        params: &'a [f32],
        axiom_lineages: &'a [u64],
        parent: u64,
        birth: u32,
    ) -> Self {
        let Template { symbols, ends, ids, .. } = template;
        Self { symbols, ends, params, ids, axiom_lineages, parent, birth, text: template.text.as_ref() }
    }

    /// A module that a step leaves unchanged. `end`: number of its parameters; `lineage`: its own.
    #[inline]
    pub fn of_module(module: &'a Module<'a>, end: &'a u32, lineage: &'a u64) -> Self {
        Self {
            symbols: std::slice::from_ref(&module.symbol),
            ends: std::slice::from_ref(end),
            params: module.params,
            ids: &[],
            axiom_lineages: std::slice::from_ref(lineage),
            parent: 0,
            birth: module.birth,
            text: None,
        }
    }

    #[inline]
    fn param_range(&self, i: usize) -> Range<usize> {
        let start = i.checked_sub(1).map_or(0, |k| to_usize(self.ends[k]));
        start..to_usize(self.ends[i])
    }

    fn lineage(&self, i: usize) -> u64 {
        self.axiom_lineages.get(i).copied().unwrap_or_else(|| self.ids[i].lineage(self.parent))
    }

    /// Module `i` of the block; its lineage is computed on demand.
    #[inline]
    pub fn module(&self, i: usize) -> Module<'a> {
        Module {
            symbol: self.symbols[i],
            params: &self.params[self.param_range(i)],
            birth: self.birth,
            ancestry: match self.axiom_lineages.get(i) {
                Some(lineage) => Ancestry::Known(*lineage),
                None => Ancestry::Child { parent: self.parent, ids: self.ids[i] },
            },
        }
    }
}

impl ModuleSink for ModuleString {
    const NEEDS_LINEAGE: bool = true;

    #[inline]
    fn modules(&mut self, block: &Block<'_>, range: Range<usize>) -> ControlFlow<()> {
        if range.is_empty() {
            return ControlFlow::Continue(());
        }
        let params = block.param_range(range.start).start..block.param_range(range.end - 1).end;
        // `ends` are indices into all parameters of the block, but only those of `range` are copied, so that the offset may wrap.
        let first_param = saturating_index(self.param_count()).wrapping_sub(saturating_index(params.start));
        self.params_mut().extend_from_slice(&block.params[params]);
        let part =
            ModuleBlock { symbols: &block.symbols[range.clone()], ends: &block.ends[range.clone()], first_param };
        self.append_modules(part, range.map(|i| block.lineage(i)), block.birth);
        ControlFlow::Continue(())
    }
}

/// Plan, length and limits of a derivation.
#[derive(Debug, Clone, Copy)]
pub(super) struct DepthFirstJob<'p> {
    pub plan: &'p RewritePlan<'p>,
    pub brackets: Brackets,
    /// Derivation length: number of steps.
    pub length: u32,
    /// Limit on the modules of the final string.
    pub max_modules: u64,
    /// Limit on the attempts to rewrite a module, summed over all steps.
    pub max_work: u64,
}

/// Growth factor between steps below which no step is predicted, because slow growth varies too much.
const SMALLEST_FACTOR: f64 = 1.1;
/// Relative difference up to which two growth factors count as equal.
const FACTOR_TOLERANCE: f64 = 0.01;

/// A block whose active modules are being rewritten.
#[derive(Debug, Clone, Copy)]
struct Frame {
    /// Production that made the block; `None` for the axiom.
    production: Option<u32>,
    /// Start of the block's parameters in the pool.
    params: usize,
    parent: u64,
    /// Step in which the block was made; 0 for the axiom.
    birth: u32,
    /// Number of active modules processed so far.
    next: u32,
    /// Number of modules emitted or rewritten so far.
    emitted: u32,
    /// Start of the block's choices in the pool of choices.
    choices: usize,
}

impl Frame {
    fn new(production: Option<u32>, params: usize, choices: usize, parent: u64, birth: u32) -> Self {
        Self { production, params, parent, birth, next: 0, emitted: 0, choices }
    }
}

/// Lineage and production of an active module. They are computed for all modules of a block together, so that the processor
/// overlaps the hash chains.
#[derive(Debug, Clone, Copy)]
struct Choice {
    lineage: u64,
    /// The production that was drawn, if productions compete by weight without conditions; else `None`.
    production: Option<u32>,
}

/// Numbers of modules that a derivation makes: in total, per step and per production.
#[derive(Debug, Clone, Default)]
pub(super) struct DerivationCounts {
    /// Number of modules of the final string counted so far.
    pub modules: u64,
    /// Last step in which a production was applied; 0 if none was.
    pub last_change: u32,
    /// Per step: change of the number of modules.
    gains: Vec<i64>,
    /// Number of modules that each production has made, by its index in the plan.
    made: Vec<u64>,
    /// Number of attempts to rewrite a module.
    pub work: u64,
}

impl DerivationCounts {
    /// The counts of `steps` steps from `axiom`, computed without a derivation; `None` unless all modules of a kind are
    /// rewritten by the same production. The counts of each step follow from those of the step before (the growth matrix).
    pub fn predicted(plan: &RewritePlan<'_>, axiom: &Template<'_>, steps: u32) -> Option<Self> {
        let mut productions = plan.productions.iter();
        if !plan.groups.iter().all(|g| g.always.is_some()) || !productions.all(|p| p.is_pure) {
            return None;
        }
        let add = |counts: &mut [u64], template: &Template<'_>, times: u64| {
            for active in &template.active {
                if let Some(p) = plan.groups[to_usize(active.group)].always {
                    counts[to_usize(p)] = counts[to_usize(p)].saturating_add(times);
                }
            }
        };
        let mut out = Self {
            modules: axiom.symbols.len() as u64,
            gains: vec![0; to_usize(steps)],
            made: vec![0; plan.productions.len()],
            ..Self::default()
        };
        let mut rewritten = vec![0_u64; plan.productions.len()];
        add(&mut rewritten, axiom, 1);
        for step in 1..=steps {
            let mut next = vec![0_u64; rewritten.len()];
            for (i, p) in plan.productions.iter().enumerate().filter(|(i, _)| rewritten[*i] > 0) {
                let (times, made) = (rewritten[i], p.template.symbols.len() as u64);
                out.last_change = step;
                out.made[i] = out.made[i].saturating_add(times.saturating_mul(made));
                out.modules = out.modules.saturating_add(times.saturating_mul(made)).saturating_sub(times);
                // Counts above 2^63 saturate, as every limit is far below.
                let signed = |n: u64| i64::try_from(n).unwrap_or(i64::MAX);
                let gain = &mut out.gains[to_usize(step - 1)];
                *gain = gain.saturating_add(signed(times.saturating_mul(made)).saturating_sub(signed(times)));
                add(&mut next, &p.template, times);
            }
            // Stop once no module is left to rewrite.
            if out.last_change < step {
                break;
            }
            rewritten = next;
        }
        Some(out)
    }

    /// Largest number of modules in any step, and that step. `axiom`: number of modules of the axiom.
    pub fn longest(&self, axiom: u64) -> (u64, u32) {
        let mut length = 0_i64.saturating_add_unsigned(axiom);
        let mut longest = (axiom, 0);
        for (step, gain) in (1_u32..).zip(&self.gains) {
            length = length.saturating_add(*gain);
            let now = length.max(0).unsigned_abs();
            if now > longest.0 {
                longest = (now, step);
            }
        }
        longest
    }

    /// First step after the counted `steps` whose string would exceed `limit` modules if the growth factor of the last two
    /// steps continued; `None` if their factors differ or are too small.
    pub fn step_beyond(&self, limit: u64, steps: u32) -> Option<u32> {
        let last = to_usize(steps).checked_sub(1)?;
        let gain = |step: usize| self.gains.get(step).copied().filter(|g| *g > 0).map(|g| g as f64);
        // Compare the gains of steps, which grow by the same factor as the lengths, but do not include the axiom.
        let (a, b, c) = (gain(last.checked_sub(2)?)?, gain(last - 1)?, gain(last)?);
        let (before, factor) = (b / a, c / b);
        if factor < SMALLEST_FACTOR || (factor - before).abs() > FACTOR_TOLERANCE * factor {
            return None;
        }
        let (mut length, mut gain, mut step) = (self.modules as f64, c, steps);
        while length <= limit as f64 {
            gain *= factor;
            length += gain;
            step += 1;
        }
        Some(step)
    }

    /// Index of the production that made most modules, the first of equal ones; `None` without productions.
    pub fn main_production(&self) -> Option<usize> {
        (0..self.made.len()).max_by_key(|i| (self.made[*i], std::cmp::Reverse(*i)))
    }
}

/// Derives each module up to the last step before the next module, so that the strings of the steps are never stored.
pub(super) struct DepthFirst<'p> {
    pub job: DepthFirstJob<'p>,
    pub axiom: Template<'p>,
    pub axiom_lineages: Vec<u64>,
    pub rewriter: Rewriter<'p>,
    pub counts: DerivationCounts,
    stack: Vec<Frame>,
    /// Parameters of all blocks on the stack.
    pool: Vec<f32>,
    /// Choices for the active modules of all blocks on the stack.
    choices: Vec<Choice>,
    /// Per step: global variables after `StartEach`; empty if no block changes them.
    globals: Vec<Vec<f64>>,
}

impl<'p> DepthFirst<'p> {
    /// Prepares the derivation of `program` from the axiom `modules`. `globals`: global variables in each step, if blocks change them.
    pub fn new(
        job: DepthFirstJob<'p>,
        program: &'p Program,
        modules: &ModuleString,
        vm: Vm,
        globals: Vec<Vec<f64>>,
    ) -> Self {
        let mut axiom = job.plan.template(program, &program.axiom, &mut RegisterCompiler::new(0));
        // The parameters of the axiom are evaluated already.
        axiom.computed.clear();
        axiom.constants.clear();
        modules.iter().for_each(|m| axiom.constants.extend_from_slice(m.params));
        let settings = RewriteSettings {
            plan: job.plan,
            purposes: DrawPurposes::of_productions(),
            step: Some(0),
            birth: 0,
            tag: 0,
            brackets: job.brackets,
        };
        let counts = DerivationCounts {
            gains: vec![0; to_usize(job.length)],
            made: vec![0; job.plan.productions.len()],
            ..DerivationCounts::default()
        };
        Self {
            job,
            axiom,
            axiom_lineages: modules.iter().map(|m| m.lineage()).collect(),
            rewriter: Rewriter::new(settings, vm),
            counts,
            stack: Vec::new(),
            pool: Vec::new(),
            choices: Vec::new(),
            globals,
        }
    }

    pub fn plan(&self) -> &'p RewritePlan<'p> {
        self.job.plan
    }

    /// Passes the modules of the final string to `sink`.
    /// # Errors
    /// `Modules` and `Work` beyond the job's limits; `Modules` also if the sink stops; and the halts of statements.
    pub fn run<S: ModuleSink>(&mut self, sink: &mut S) -> Result<(), Halt> {
        if S::NEEDS_LINEAGE || self.job.plan.draws {
            self.run_with::<S, true>(sink)
        } else {
            self.run_with::<S, false>(sink)
        }
    }

    fn run_with<S: ModuleSink, const LINEAGE: bool>(&mut self, sink: &mut S) -> Result<(), Halt> {
        let plan = self.job.plan;
        self.stack.clear();
        self.pool.clear();
        self.pool.extend_from_slice(&self.axiom.constants);
        self.choices.clear();
        self.stack.push(Frame::new(None, 0, 0, 0, 0));
        'frames: while let Some(mut frame) = self.stack.pop() {
            let (template, axiom_lineages): (&Template<'_>, &[u64]) = match frame.production {
                None => (&self.axiom, &self.axiom_lineages),
                Some(p) => (&plan.productions[to_usize(p)].template, &[]),
            };
            if LINEAGE && frame.next == 0 && frame.birth < self.job.length {
                let lineage = |i: usize| match axiom_lineages.get(i) {
                    Some(lineage) => *lineage,
                    None => template.ids[i].lineage(frame.parent),
                };
                self.rewriter.begin_step(frame.birth + 1, &self.globals);
                for active in &template.active {
                    let lineage = lineage(to_usize(active.index));
                    let production = self.rewriter.draw_in_step(active.group, lineage, frame.birth + 1);
                    self.choices.push(Choice { lineage, production });
                }
            }
            // Rewrite the active modules of the block in turn: each successor is a new frame on the stack, completed before the
            // next module.
            while let Some(active) = template.active.get(to_usize(frame.next)) {
                let choice = if LINEAGE { self.choices.get(frame.choices + to_usize(frame.next)) } else { None };
                let lineage = choice.map_or(0, |c| c.lineage);
                frame.next += 1;
                let params = frame.params + to_usize(active.first_param)..frame.params + to_usize(active.end_param);
                let module = Module {
                    symbol: template.symbols[to_usize(active.index)],
                    params: &self.pool[params],
                    birth: frame.birth,
                    ancestry: Ancestry::Known(lineage),
                };
                let (rewriter, counts) = (&mut self.rewriter, &mut self.counts);
                let group = &plan.groups[to_usize(active.group)];
                let next = |production| Applied { production, step: frame.birth + 1, has_variables: false };
                let applied = match (choice.and_then(|c| c.production), &group.tests) {
                    // The production was drawn already; it applies in the next step.
                    (Some(production), _) => {
                        counts.work += 1;
                        Some(next(production))
                    }
                    // If no production applies in the next step, none ever will, since the parameters stay the same.
                    (None, Some(tests)) if group.is_stationary && frame.birth < self.job.length => {
                        counts.add_work(self.job.max_work)?;
                        let first = tests.iter().position(|t| t.is_none_or(|t| t.holds(module.params)));
                        first.map(|k| next(group.productions[k]))
                    }
                    _ => apply_next(rewriter, counts, &self.job, &self.globals, module, active.group)?,
                };
                let Some(Applied { production, step, has_variables }) = applied else { continue };
                // Emit the modules before this one first, then those of its successor.
                if frame.emitted < active.index {
                    let params = &self.pool[frame.params..];
                    let block = Block::new(template, params, axiom_lineages, frame.parent, frame.birth);
                    let before = to_usize(frame.emitted)..to_usize(active.index);
                    emit(counts, self.job.max_modules, sink, &block, before)?;
                }
                frame.emitted = active.index + 1;
                let planned = rewriter.planned(production);
                let made = planned.template.symbols.len();
                counts.count_production(production, step, made);
                let is_final = step == self.job.length || planned.template.active.is_empty();
                // If the sink reads no parameters, they are computed only if that may report a division by zero or run code.
                if is_final && !S::NEEDS_PARAMS && planned.is_pure {
                    counts.count_modules(made as u64, self.job.max_modules)?;
                    continue;
                }
                // A successor without expressions needs no variables.
                if !has_variables && !planned.template.computed.is_empty() {
                    rewriter.begin_step(step, &self.globals);
                    rewriter.take(production, module);
                }
                let params = self.pool.len();
                rewriter.append_params(production, &mut self.pool)?;
                if !is_final {
                    self.stack.push(frame);
                    self.stack.push(Frame::new(Some(production), params, self.choices.len(), lineage, step));
                    continue 'frames;
                }
                // No module of the successor is rewritten any more: emit the whole block.
                let block = Block::new(&planned.template, &self.pool[params..], &[], lineage, step);
                emit(counts, self.job.max_modules, sink, &block, 0..made)?;
                self.pool.truncate(params);
            }
            // All active modules are processed: emit the rest of the block.
            let rest = to_usize(frame.emitted)..template.symbols.len();
            if !rest.is_empty() {
                let block = Block::new(template, &self.pool[frame.params..], axiom_lineages, frame.parent, frame.birth);
                emit(&mut self.counts, self.job.max_modules, sink, &block, rest)?;
            }
            self.pool.truncate(frame.params);
            self.choices.truncate(frame.choices);
        }
        Ok(())
    }
}

impl DerivationCounts {
    #[inline]
    fn count_modules(&mut self, n: u64, max_modules: u64) -> Result<(), Halt> {
        self.modules += n;
        if self.modules > max_modules { Err(Halt::Modules) } else { Ok(()) }
    }

    /// Counts an attempt to rewrite a module against the limit.
    #[inline]
    fn add_work(&mut self, max_work: u64) -> Result<(), Halt> {
        self.work += 1;
        if self.work > max_work { Err(Halt::Work) } else { Ok(()) }
    }

    /// Counts an application of a production in `step` that replaced one module by `made` modules.
    #[inline]
    pub fn count_production(&mut self, production: u32, step: u32, made: usize) {
        self.made[to_usize(production)] += made as u64;
        self.gains[to_usize(step - 1)] += made as i64 - 1;
        self.last_change = self.last_change.max(step);
    }
}

struct Applied {
    production: u32,
    step: u32,
    /// True if the rewriter has set the local variables of the production already.
    has_variables: bool,
}

/// Passes modules to the sink and counts them; [`Halt::Modules`] beyond the limit, or if the sink stops.
#[inline]
fn emit<S: ModuleSink>(
    counts: &mut DerivationCounts,
    max_modules: u64,
    sink: &mut S,
    block: &Block<'_>,
    range: Range<usize>,
) -> Result<(), Halt> {
    counts.count_modules(range.len() as u64, max_modules)?;
    if sink.modules(block, range).is_break() { Err(Halt::Modules) } else { Ok(()) }
}

/// The first production that applies to a module in any step after its birth; the rewriter then holds its local variables.
#[inline(always)]
fn apply_next(
    rewriter: &mut Rewriter<'_>,
    counts: &mut DerivationCounts,
    job: &DepthFirstJob<'_>,
    globals: &[Vec<f64>],
    module: Module<'_>,
    group: u32,
) -> Result<Option<Applied>, Halt> {
    // Productions without contexts read no string.
    const NO_STRING: ContextView<'static> = ContextView::NONE;
    let is_stationary = job.plan.groups[to_usize(group)].is_stationary;
    let first = module.birth + 1;
    let last = if is_stationary { job.length.min(first) } else { job.length };
    for step in first..=last {
        counts.add_work(job.max_work)?;
        rewriter.begin_step(step, globals);
        if let Some(production) = rewriter.select_in_group(group, module, &NO_STRING, 0)? {
            return Ok(Some(Applied { production, step, has_variables: true }));
        }
    }
    Ok(None)
}
