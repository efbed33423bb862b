//! Derivations of L-systems whose modules are rewritten independently of each other: they are counted before they are stored or
//! drawn, and need no string.

use std::borrow::Cow;
use std::ops::{ControlFlow, Range};

use super::depth_first::{Block, DepthFirst, DepthFirstJob, DerivationCounts, ModuleSink};
use super::plan::RewritePlan;
use super::registers::RegisterCompiler;
use super::text::{TextSink, repeated_text};
use super::{
    Derivation, DeriveOptions, DerivedString, FinalModules, MAX_PARAMS, Storage, brackets, halt_error, predict,
};
use crate::grammar::{Grammar, runtime_report};
use crate::modules::{Module, ModuleString};
use crate::vm::{Halt, RandomStreams, Vm};
use osier_base::Result;
use osier_base::diagnostic::Diagnostic;
use osier_base::limits::{Limits, grouped};

/// Modules up to which a string is stored without counting them first; counting a string of this length takes milliseconds.
const COUNTED_FROM: u128 = 1 << 20;
/// Values of global variables over all steps that are kept, if blocks change them from step to step.
const MAX_STEP_VALUES: usize = 1 << 22;

/// Where a derivation without a string begins.
#[derive(Debug, Clone)]
pub(super) struct Deferred {
    axiom: ModuleString,
    /// Global variables in the axiom's step and in each step.
    start_globals: Vec<f64>,
    step_globals: Vec<Vec<f64>>,
    /// Last step: the derivation length, or the step of a `stop(n)`.
    last_step: u32,
}

/// Counts modules.
struct CountingSink;

impl ModuleSink for CountingSink {
    const NEEDS_LINEAGE: bool = false;
    const NEEDS_PARAMS: bool = false;

    #[inline]
    fn modules(&mut self, _block: &Block<'_>, _range: Range<usize>) -> ControlFlow<()> {
        ControlFlow::Continue(())
    }
}

/// Hands modules over one by one.
struct CallingSink<F>(F);

impl<F: FnMut(Module<'_>) -> ControlFlow<()>> ModuleSink for CallingSink<F> {
    const NEEDS_LINEAGE: bool = true;

    #[inline]
    fn modules(&mut self, block: &Block<'_>, mut range: Range<usize>) -> ControlFlow<()> {
        range.try_for_each(|i| (self.0)(block.module(i)))
    }
}

impl Deferred {
    /// The derivation from its beginning. `streams`: of its random draws; `globals_end`: values of the last step.
    fn restart<'p>(
        &self,
        grammar: &'p Grammar,
        plan: &'p RewritePlan<'p>,
        streams: RandomStreams,
        bounds: DerivationBounds,
    ) -> DepthFirst<'p> {
        let mut vm = Vm::new(streams, 0, bounds.length);
        vm.globals.clone_from(&self.start_globals);
        vm.statement_limit = bounds.max_statements;
        let job = DepthFirstJob {
            plan,
            brackets: brackets(&grammar.program),
            length: bounds.last_step,
            max_modules: bounds.max_modules,
            max_work: bounds.max_work,
        };
        DepthFirst::new(job, &grammar.program, &self.axiom, vm, self.step_globals.clone())
    }
}

/// How far a derivation may go.
#[derive(Debug, Clone, Copy)]
struct DerivationBounds {
    /// `Z`.
    length: u32,
    last_step: u32,
    max_modules: u64,
    max_work: u64,
    max_statements: u64,
}

impl DerivationBounds {
    fn new(length: u32, last_step: u32, limits: &Limits) -> Self {
        Self {
            length,
            last_step,
            max_modules: limits.get("modules"),
            max_work: limits.get("work"),
            max_statements: limits.get("statements"),
        }
    }
}

impl Derivation<'_> {
    /// Derives depth first; what the blocks do does not depend on the string, so that they run first.
    pub(super) fn derive_independently(mut self, options: &DeriveOptions, storage: Storage) -> Result<DerivedString> {
        let deferred = match self.run_blocks() {
            Ok(Some(deferred)) => deferred,
            // Too many values to keep: every step computes its own.
            Ok(None) => return self.restarted(options).derive_by_steps(options, None),
            Err(halt) => return Err(self.halt_report(halt)),
        };
        let bounds = DerivationBounds::new(self.length, deferred.last_step, self.limits);
        let streams = self.vm.streams;
        let mut run = deferred.restart(self.grammar, self.plans.rules.main(), streams, bounds);
        let upper = predict(self.grammar, deferred.last_step, self.plans.rules.main().stochastic).upper;
        let mut string = ModuleString::default();
        let mut result = Ok(());
        // Count before anything is stored: a string that passes a limit is refused without its memory.
        let stores = storage == Storage::String;
        if !stores || upper > COUNTED_FROM {
            result = run.run(&mut CountingSink);
        }
        if stores && result.is_ok() {
            let warnings = std::mem::take(&mut run.rewriter.vm.warnings);
            let counted = upper > COUNTED_FROM;
            run = deferred.restart(self.grammar, self.plans.rules.main(), streams, bounds);
            result = run.run(&mut string);
            if counted {
                run.rewriter.vm.warnings = warnings;
            }
            if string.param_count() > MAX_PARAMS {
                result = Err(Halt::Parameters);
            }
        }
        self.steps_done = run.rewriter.vm.step.saturating_sub(1);
        if let Err(halt) = result {
            return Err(self.independent_report(halt, &deferred, streams, bounds));
        }
        let counts = run.counts;
        let (longest, step) = counts.longest(deferred.axiom.len() as u64);
        if longest > bounds.max_modules {
            return Err(self.too_long(&counts, step));
        }
        self.vm.warnings.merge(run.rewriter.vm.warnings);
        self.vm.statements += run.rewriter.vm.statements;
        // Where nothing changes in the last steps, the first of them is the last that counts.
        let last = deferred.last_step;
        self.unchanged_since = (counts.last_change < last).then_some(counts.last_change + 1);
        self.steps_done = self.unchanged_since.filter(|_| self.nothing_can_change()).unwrap_or(last);
        let end = self.program.blocks.end.as_ref();
        self.vm.step = last;
        if let Err(halt) = self.run_block(end, last) {
            return Err(self.halt_report(halt));
        }
        let deferred = (!stores).then_some(deferred);
        Ok(self.result(options, FinalModules { string, deferred, count: counts.modules }, last))
    }

    /// Runs the blocks of all steps; `None` if they make too many values to keep. Global variables hold those of the end.
    fn run_blocks(&mut self) -> std::result::Result<Option<Deferred>, Halt> {
        self.begin()?;
        let axiom = std::mem::take(&mut self.string);
        let start_globals = self.vm.globals.clone();
        let blocks = &self.program.blocks;
        let mut step_globals = Vec::new();
        let mut last_step = self.length;
        if blocks.start_each.is_some() || blocks.end_each.is_some() {
            if (self.length as usize).saturating_mul(start_globals.len()) > MAX_STEP_VALUES {
                return Ok(None);
            }
            for step in 1..=self.length {
                self.vm.step = step - 1;
                self.run_block(blocks.start_each.as_ref(), step)?;
                self.vm.step = step;
                step_globals.push(self.vm.globals.clone());
                self.run_block(blocks.end_each.as_ref(), step)?;
                self.steps_done = step;
                if self.vm.stopped {
                    last_step = step;
                    break;
                }
            }
        }
        Ok(Some(Deferred { axiom, start_globals, step_globals, last_step }))
    }

    /// The derivation before its first block.
    fn restarted(&self, options: &DeriveOptions) -> Self {
        Self::new(self.grammar, self.plans, options, self.length, self.limits)
    }

    /// The error of a derivation that was halted.
    fn independent_report(
        &self,
        halt: Halt,
        deferred: &Deferred,
        streams: RandomStreams,
        bounds: DerivationBounds,
    ) -> osier_base::Error {
        if halt != Halt::Modules {
            return self.halt_report(halt);
        }
        // Depth first, a derivation that grows too long is halted somewhere in its last step. The first step that passes the
        // limit is found by counting shorter derivations.
        let mut fits = 0;
        let mut passes = bounds.last_step;
        let mut counts = DerivationCounts::default();
        while passes - fits > 1 {
            // Twice as many steps, but no more than the growth so far lets expect to fit or to pass.
            let expected = counts.step_beyond(bounds.max_modules, fits);
            let last_step = (fits * 2).max(1).min(expected.unwrap_or(u32::MAX)).clamp(fits + 1, passes - 1);
            let probe = DerivationBounds { last_step, ..bounds };
            let mut run = deferred.restart(self.grammar, self.plans.rules.main(), streams, probe);
            if run.run(&mut CountingSink).is_ok() {
                fits = last_step;
            } else {
                passes = last_step;
                // Growth that is as regular as the expectation needs no further count, the longest of all.
                if expected == Some(last_step) {
                    break;
                }
            }
            counts = run.counts;
        }
        self.too_long(&counts, passes)
    }

    /// L051 for a string that passes the limit in `step`.
    fn too_long(&self, counts: &DerivationCounts, step: u32) -> osier_base::Error {
        let main = counts.main_production().and_then(|i| self.program.rules.list.get(i));
        let Some(p) = main else {
            return halt_error(self.grammar, Halt::Modules, step, self.limits);
        };
        let limit = self.limits.get("modules");
        let message = format!("step {step} passes the limit of {} modules", grouped(limit));
        let help = format!(
            "set the derivation length to {} or less, end the growth by a condition, or raise --max-modules",
            step.saturating_sub(1)
        );
        let d = Diagnostic::error("L051", message, p.place.span, "this production makes most of them").help(help);
        runtime_report(self.grammar, self.grammar.with_macro_chain(d, p.place))
    }
}

impl DerivedString {
    /// Number of modules of the final string.
    pub fn module_count(&self) -> u64 {
        self.count
    }

    /// Hands the modules of the final string to `sink`, in order, until it breaks. The string of a deferred derivation is derived
    /// for this.
    /// # Errors
    /// `Input` with L051 beyond a limit.
    pub(crate) fn for_each(
        &self,
        grammar: &Grammar,
        limits: &Limits,
        mut sink: impl FnMut(Module<'_>) -> ControlFlow<()>,
    ) -> Result<()> {
        let Some(deferred) = &self.deferred else {
            let _ = self.modules.iter().try_for_each(&mut sink);
            return Ok(());
        };
        let mut is_stopped = false;
        let stopping = |m: Module<'_>| {
            let flow = sink(m);
            is_stopped |= flow.is_break();
            flow
        };
        let result = self.run_again(grammar, deferred, limits, &mut CallingSink(stopping));
        if is_stopped { Ok(()) } else { result }
    }

    /// The final string, derived again if it was not stored.
    /// # Errors
    /// `Input` with L051 beyond a limit.
    pub fn string(&self, grammar: &Grammar, limits: &Limits) -> Result<Cow<'_, ModuleString>> {
        let Some(deferred) = &self.deferred else { return Ok(Cow::Borrowed(&self.modules)) };
        let mut string = ModuleString::default();
        self.run_again(grammar, deferred, limits, &mut string)?;
        Ok(Cow::Owned(string))
    }

    /// The final string as text, parameters with six digits.
    /// # Errors
    /// `Input` with L051 beyond a limit.
    pub fn text(&self, grammar: &Grammar, limits: &Limits) -> Result<String> {
        let Some(deferred) = &self.deferred else { return Ok(grammar.print(&self.modules)) };
        let program = &grammar.program;
        let plan = RewritePlan::new(program, &program.rules, self.stochastic);
        let axiom = plan.template(program, &program.axiom, &mut RegisterCompiler::new(0));
        if let Some(text) = repeated_text(&plan, &axiom, deferred.last_step, self.count) {
            return Ok(text);
        }
        let mut sink = TextSink { grammar, text: String::with_capacity(osier_base::convert::limit(self.count)) };
        self.run_again(grammar, deferred, limits, &mut sink)?;
        Ok(sink.text)
    }

    fn run_again<S: ModuleSink>(
        &self,
        grammar: &Grammar,
        deferred: &Deferred,
        limits: &Limits,
        sink: &mut S,
    ) -> Result<()> {
        let plan = RewritePlan::new(&grammar.program, &grammar.program.rules, self.stochastic);
        let streams = RandomStreams::new(self.seed, self.plant_id, self.file_seed);
        let bounds = DerivationBounds::new(self.length, deferred.last_step, limits);
        let mut run = deferred.restart(grammar, &plan, streams, bounds);
        let result = run.run(sink);
        result.map_err(|halt| halt_error(grammar, halt, run.rewriter.vm.step, limits))
    }
}
