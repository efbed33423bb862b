//! Derivation of L-systems whose modules are rewritten independently of each other: their modules can be counted before they
//! are stored or drawn, without storing a string.

use std::borrow::Cow;
use std::ops::{ControlFlow, Range};

use super::depth_first::{Block, DepthFirst, DepthFirstJob, DerivationCounts, ModuleSink};
use super::plan::RewritePlan;
use super::text::{TextSink, repeated_text, repeats};
use super::weighted_text::{is_drawn_by_weight, weighted_text};
use super::{
    Deferred, Derivation, DeriveOptions, DerivedString, FinalModules, MAX_PARAMS, Storage, brackets, halt_error,
    predict,
};
use crate::grammar::{Grammar, runtime_report};
use crate::modules::{Module, ModuleString};
use crate::vm::{Halt, RandomStreams, Vm};
use osier_base::Result;
use osier_base::diagnostic::Diagnostic;
use osier_base::limits::{Limits, grouped};

/// Length up to which a string is stored without counting its modules first; counting this many takes milliseconds.
const COUNTED_FROM: u128 = 1 << 20;
/// Factor on the limit of modules: a predicted upper bound above it counts as an explosion. Own: models whose conditions end
/// the growth also have bounds far above it, but their short derivations cost little.
const EXPLOSION: u128 = 50;
/// Factor on the expected length of a text, as random growth exceeds it by a few percent.
const TEXT_MARGIN: f64 = 1.1;
/// Limit on the stored values of global variables, over all steps, if blocks change them from step to step.
const MAX_STEP_VALUES: usize = 1 << 22;

/// Data to run a derivation again for each use of its modules instead of storing them.
#[derive(Debug, Clone)]
pub(super) struct DeferredDerivation {
    axiom: ModuleString,
    /// Global variables after the `Start` block; `step_globals` holds those after the `StartEach` block of each step, if
    /// blocks change them.
    start_globals: Vec<f64>,
    step_globals: Vec<Vec<f64>>,
    /// Last step: the derivation length, or the step of a `stop(n)`.
    last_step: u32,
}

/// Sink that discards all modules, for passes that only count them.
pub(super) struct CountingSink;

impl ModuleSink for CountingSink {
    const NEEDS_LINEAGE: bool = false;
    const NEEDS_PARAMS: bool = false;

    #[inline]
    fn modules(&mut self, _block: &Block<'_>, _range: Range<usize>) -> ControlFlow<()> {
        ControlFlow::Continue(())
    }
}

/// Sink that passes modules to a function one by one.
struct CallingSink<F>(F);

impl<F: FnMut(Module<'_>) -> ControlFlow<()>> ModuleSink for CallingSink<F> {
    const NEEDS_LINEAGE: bool = true;

    #[inline]
    fn modules(&mut self, block: &Block<'_>, mut range: Range<usize>) -> ControlFlow<()> {
        range.try_for_each(|i| (self.0)(block.module(i)))
    }
}

impl DeferredDerivation {
    /// Prepares the derivation from its beginning. `streams`: its random streams.
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

/// Limits of a derivation.
#[derive(Debug, Clone, Copy)]
struct DerivationBounds {
    /// Derivation length, which grammars read as `Z`.
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
    /// Derives depth first. The blocks do not depend on the string, so that they run before it.
    pub(super) fn derive_independently(mut self, options: &DeriveOptions, storage: Storage) -> Result<DerivedString> {
        let deferred = match self.run_blocks() {
            Ok(Some(deferred)) => deferred,
            // The values are too many to store for all steps: derive step by step, where each step computes its own.
            Ok(None) => return self.restarted(options).derive_by_steps(options, None),
            Err(halt) => return Err(self.halt_report(halt)),
        };
        let bounds = DerivationBounds::new(self.length, deferred.last_step, self.limits);
        let streams = self.vm.streams;
        let plan = self.plans.rules.main();
        // If conditions decide whether the string explodes, short derivations find that faster than the whole one.
        let upper = predict(self.grammar, deferred.last_step, plan.stochastic).upper;
        if upper > EXPLOSION * u128::from(bounds.max_modules)
            && let Some((step, counts)) = self.first_step_beyond(&deferred, streams, bounds)
            && step < bounds.last_step
        {
            return Err(self.too_long(&counts, step));
        }
        let mut run = deferred.restart(self.grammar, plan, streams, bounds);
        let (mut string, mut text) = (ModuleString::default(), None);
        let result = match storage {
            Storage::Deferred => count(&mut run, bounds),
            Storage::Text => self.write_text(&mut run, bounds).map(|t| text = Some(t)),
            Storage::String => {
                // Count before storing a long string, so that one beyond a limit is refused without using its memory.
                let counted = if upper > COUNTED_FROM { count(&mut run, bounds) } else { Ok(()) };
                counted.and_then(|()| {
                    run = deferred.restart(self.grammar, plan, streams, bounds);
                    run.run(&mut string)
                })
            }
        };
        let result = if string.param_count() > MAX_PARAMS { Err(Halt::Parameters) } else { result };
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
        // If the last steps change nothing, only the first of them is counted as done.
        let last = deferred.last_step;
        self.unchanged_since = (counts.last_change < last).then_some(counts.last_change + 1);
        self.steps_done = self.unchanged_since.filter(|_| self.nothing_can_change()).unwrap_or(last);
        let end = self.program.blocks.end.as_ref();
        self.vm.step = last;
        if let Err(halt) = self.run_block(end, last) {
            return Err(self.halt_report(halt));
        }
        let deferred = (storage != Storage::String).then_some(Deferred::Derivation(deferred));
        Ok(self.result(options, FinalModules { string, deferred, text, count: counts.modules }, last))
    }

    /// The final string as text. Parts that repeat are copied instead of derived.
    fn write_text(&self, run: &mut DepthFirst<'_>, bounds: DerivationBounds) -> std::result::Result<String, Halt> {
        let plan = self.plans.rules.main();
        if repeats(plan, &run.axiom, bounds.last_step) {
            // Repeated parts are copied, not derived, so that a separate pass must count the modules.
            count(run, bounds)?;
            let text = repeated_text(plan, &run.axiom, bounds.last_step, run.counts.modules);
            return Ok(text.unwrap_or_default());
        }
        // Reserving memory of the expected length avoids copying a growing text; an excess only costs address space.
        let expected = predict(self.grammar, bounds.last_step, plan.stochastic).expected.min(bounds.max_modules as f64);
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most the limit of modules")]
        let expected = (expected * TEXT_MARGIN).max(0.0) as u64;
        if is_drawn_by_weight(plan, &run.axiom) {
            return weighted_text(run, osier_base::convert::limit(expected));
        }
        let mut sink = TextSink::new(self.grammar, expected);
        run.run(&mut sink)?;
        Ok(sink.text)
    }

    /// Runs the blocks of all steps; `None` if their values are too many to store. Afterwards the global variables have
    /// their final values.
    fn run_blocks(&mut self) -> std::result::Result<Option<DeferredDerivation>, Halt> {
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
                // The block before a step reads the number of the step before.
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
        Ok(Some(DeferredDerivation { axiom, start_globals, step_globals, last_step }))
    }

    /// A new derivation with the same input, as before its first block.
    fn restarted(&self, options: &DeriveOptions) -> Self {
        Self::new(self.grammar, self.plans, options, self.length, self.limits)
    }

    /// Makes the error of a halted derivation. For [`Halt::Modules`] it searches the first step beyond the limit with
    /// shorter derivations.
    fn independent_report(
        &self,
        halt: Halt,
        deferred: &DeferredDerivation,
        streams: RandomStreams,
        bounds: DerivationBounds,
    ) -> osier_base::Error {
        if halt != Halt::Modules {
            return self.halt_report(halt);
        }
        match self.first_step_beyond(deferred, streams, bounds) {
            Some((step, counts)) => self.too_long(&counts, step),
            None => self.halt_report(halt),
        }
    }

    /// The first step whose string exceeds the limit of modules, or the last step if no earlier one does, and the counts of
    /// a derivation of about that length. `None` if one of these derivations halts for another reason.
    fn first_step_beyond(
        &self,
        deferred: &DeferredDerivation,
        streams: RandomStreams,
        bounds: DerivationBounds,
    ) -> Option<(u32, DerivationCounts)> {
        // A depth-first derivation that grows too long halts somewhere in its last step. Search the first step beyond the
        // limit by counting shorter derivations.
        let mut fits = 0;
        let mut passes = bounds.last_step;
        let mut counts = DerivationCounts::default();
        while passes > fits + 1 {
            // Double the number of steps, but limit it to the step predicted from the growth so far, and to the open interval.
            let expected = counts.step_beyond(bounds.max_modules, fits);
            let last_step = (fits * 2).max(1).min(expected.unwrap_or(u32::MAX)).clamp(fits + 1, passes - 1);
            let probe = DerivationBounds { last_step, ..bounds };
            let mut run = deferred.restart(self.grammar, self.plans.rules.main(), streams, probe);
            match run.run(&mut CountingSink) {
                Ok(()) => fits = last_step,
                Err(Halt::Modules) => passes = last_step,
                Err(_) => return None,
            }
            counts = run.counts;
        }
        Some((passes, counts))
    }

    /// L051 for a string that exceeds the limit in `step`.
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

/// Counts the modules of a derivation: from the growth matrix if that is exact, else by running it.
fn count(run: &mut DepthFirst<'_>, bounds: DerivationBounds) -> std::result::Result<(), Halt> {
    let Some(counts) = DerivationCounts::predicted(run.plan(), &run.axiom, bounds.last_step) else {
        return run.run(&mut CountingSink);
    };
    run.counts = counts;
    if run.counts.modules > bounds.max_modules { Err(Halt::Modules) } else { Ok(()) }
}

impl DerivedString {
    /// Number of modules of the final string, even if the string is not stored.
    pub fn module_count(&self) -> u64 {
        self.count
    }

    /// Passes the modules of the final string to `sink`, in order, until it breaks. A deferred derivation runs again for this.
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
        // If the sink stopped, it has what it needs: the halt is not an error.
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
    pub fn into_text(self, grammar: &Grammar, limits: &Limits) -> Result<String> {
        if let Some(text) = self.text {
            return Ok(text);
        }
        let Some(deferred) = &self.deferred else { return Ok(grammar.print(&self.modules)) };
        let mut sink = TextSink::new(grammar, self.count);
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
        let deferred = match deferred {
            Deferred::Derivation(deferred) => deferred,
            Deferred::Step(step) => {
                return step.run(grammar, limits, sink).map_err(|halt| halt_error(grammar, halt, self.length, limits));
            }
        };
        let plan = RewritePlan::new(&grammar.program, &grammar.program.rules, self.stochastic);
        let streams = RandomStreams::new(self.seed, self.plant_id, self.file_seed);
        let bounds = DerivationBounds::new(self.length, deferred.last_step, limits);
        let mut run = deferred.restart(grammar, &plan, streams, bounds);
        let result = run.run(sink);
        result.map_err(|halt| halt_error(grammar, halt, run.rewriter.vm.step, limits))
    }
}

#[cfg(test)]
mod tests {
    use super::super::{DeriveOptions, derive, derive_deferred, derive_text, plan::Plans};
    use super::*;
    use crate::tests::read;
    use osier_base::limits::Limits;

    /// Derives step by step; the string and the first step from which nothing changed.
    fn stepwise(text: &str) -> (ModuleString, u32) {
        let (grammar, _) = read(text);
        let (options, limits) = (DeriveOptions { seed: 3, ..Default::default() }, Limits::default());
        let plans = Plans::new(&grammar.program, grammar.program.is_stochastic(), false);
        let mut d = Derivation::new(&grammar, &plans, &options, grammar.program.length, &limits);
        d.append_axiom().expect("axiom");
        let mut idle = 0;
        for step in 1..=d.length {
            d.vm.step = step;
            let changed = d.rewrite_string(step).expect("rewrites");
            idle = if changed { step + 1 } else { idle };
        }
        (d.string, idle)
    }

    fn both(length: u32, rules: &str) -> (ModuleString, u32) {
        both_with("Seed: 5", length, rules)
    }

    fn both_with(seed: &str, length: u32, rules: &str) -> (ModuleString, u32) {
        let text = format!("Lsystem: 1\n{seed}\nderivation length: {length}\nAxiom: A(0) B\n{rules}\nendlsystem\n");
        let (grammar, _) = read(&text);
        let (options, limits) = (DeriveOptions { seed: 3, ..Default::default() }, Limits::default());
        let derived = derive(&grammar, &options, &limits).expect("derives");
        let (string, idle) = stepwise(&text);
        assert!(string.len() > 1024, "{} modules prove nothing", string.len());
        assert_eq!(derived.modules, string, "{rules}");
        // The same string derived while it is handed over, and as text.
        let deferred = derive_deferred(&grammar, &options, &limits).expect("derives");
        assert!(deferred.modules.is_empty() && deferred.module_count() == string.len() as u64);
        assert_eq!(*deferred.string(&grammar, &limits).expect("derives"), string, "{rules}");
        let text = derive_text(&grammar, &options, &limits).expect("derives");
        assert_eq!(text.into_text(&grammar, &limits).expect("derives"), grammar.print(&string), "{rules}");
        let said = derived.warnings.iter().find(|d| d.code == "L054").map(|d| d.message.clone());
        let wanted = (idle < length).then(|| format!("nothing changes from step {idle} on"));
        assert_eq!(said, wanted, "{rules}");
        (string, derived.steps)
    }

    #[test]
    fn depth_first_gives_the_string_that_steps_give() {
        // Draws, erases, and asks for the step.
        let (string, steps) = both(
            14,
            "A(x) --> F(x+ran(1)) [ A(x+1) ] A(nran(0,2))\nB : Q%3==0 --> B C\nC --> \nB --> B D(1)\nD(n) : n<5 --> D(n+1)",
        );
        assert!(string.len() > 8192 && steps == 14);
        // Alternatives by weight.
        both(13, "A(x) --> A(x) F A(x+1) :3\nA(x) --> F(x) A(x) [ A(0) ] :2");
        // Comes to rest, some modules before others.
        // Modules without parameters, by weight and by single productions.
        both(9, "B --> B [ C B ] : 1\nB --> C B B : 3\nC --> \nA(x) --> B B");
        both(8, "B --> B [ + C ] B - B\nC --> C + C\nA(x) --> B");
        let (_, steps) = both(40, "A(x) : x<12 --> A(x+1) A(x+1) F\nA(x) : x>=12 && x<20 --> A(x+1)");
        assert_eq!(steps, 21);
        // Conditions on one parameter: from either side, in file order, with productions after one that always applies.
        both_with("", 13, "A(x) : 3<x --> A(0)\nA(x) : x==1 --> A(x+1) B A(4)\nA(x) --> A(x+1) A(1)\nA(x) : x<9 --> C");
        both_with("", 13, "A(x) : x!=2 --> A(x+1) A(2) A(1/x)\nA(x) : 2>=x --> A(5) B\nB : Q<4 --> B A(1)");
    }

    /// Derives a grammar without parameters as text; checks it against the string that steps give, at every length.
    fn text_is_that_of_steps(axiom: &str, rules: &str) {
        let (options, limits) = (DeriveOptions { seed: 3, ..Default::default() }, Limits::default());
        for length in 0..9 {
            let text =
                format!("Lsystem: 1\nSeed: 5\nderivation length: {length}\nAxiom: {axiom}\n{rules}\nendlsystem\n");
            let (grammar, _) = read(&text);
            let (string, _) = stepwise(&text);
            let derived = derive_text(&grammar, &options, &limits).expect("derives");
            assert_eq!(derived.module_count(), string.len() as u64, "{length}: {rules}");
            let counted = derive_deferred(&grammar, &options, &limits).expect("derives");
            assert_eq!((derived.steps, derived.module_count()), (counted.steps, counted.module_count()));
            assert_eq!(
                derived.into_text(&grammar, &limits).expect("derives"),
                grammar.print(&string),
                "{length}: {rules}"
            );
        }
    }

    #[test]
    fn text_drawn_by_weight_is_that_of_steps() {
        text_is_that_of_steps("A", "A --> A[+A]A : 1\nA --> -A A : 2.5\nA --> B : 0.25");
        // Single productions beside competing ones, successors longer than sixteen bytes, empty ones, letters beyond ASCII.
        text_is_that_of_steps(
            "B A C B",
            "A --> A C B : 1\nA --> : 1\nA --> A ++++++++ C -------- A C é : 2\nC --> C B\nB --> B C A B",
        );
    }

    #[test]
    fn limits_hold_for_text_drawn_by_weight() {
        let text = "Lsystem: 1\nSeed: 5\nderivation length: 12\nAxiom: A\nA --> A B A : 1\nA --> A A : 2\nendlsystem\n";
        let (grammar, _) = read(text);
        let derived = |limit: &str, value: u64| {
            let mut limits = Limits::default();
            limits.set(limit, &value.to_string()).expect("a limit");
            derive_text(&grammar, &DeriveOptions::default(), &limits).map_err(|e| e.to_string())
        };
        // Each step doubles the A: 4096 of them, and a B for about every third of 4095 attempts.
        let count = derived("modules", 10_000).expect("fits").module_count();
        assert!((5200..5800).contains(&count), "{count}");
        assert_eq!(derived("modules", count).expect("fits").module_count(), count);
        let why = derived("modules", count - 1).expect_err("one too many");
        assert!(why.contains("step 12 passes the limit of"), "{why}");
        assert!(derived("work", 4095).is_ok() && derived("work", 4094).is_err());
    }

    #[test]
    fn what_has_to_be_said_is_said_as_step_by_step() {
        let text = "Lsystem: 1\nderivation length: 14\nAxiom: A(0)\nA(x) --> A(x+1/0) A(x+1)\nendlsystem\n";
        let (grammar, _) = read(text);
        let derived = derive(&grammar, &DeriveOptions::default(), &Limits::default()).expect("derives");
        assert_eq!(derived.modules, stepwise(text).0);
        let said = derived.warnings.iter().find(|d| d.code == "L040").map(|d| d.message.clone());
        assert_eq!(said.as_deref(), Some("division by zero, 16383 times"));
    }

    #[test]
    fn a_limit_that_is_passed_on_the_way_is_told_with_its_step() {
        let (grammar, _) = read(
            "Lsystem: 1\nderivation length: 30\nAxiom: A(0)\nA(x) : x<12 --> A(x+1) A(x+1)\nA(x) : x>=12 && x < 14 --> A(x+1) C C\nC --> \nendlsystem\n",
        );
        let fails = |modules: u64| {
            let mut limits = Limits::default();
            limits.set("modules", &modules.to_string()).expect("a limit");
            derive(&grammar, &DeriveOptions::default(), &limits).err().map(|e| e.to_string())
        };
        assert!(fails(12_288).is_none(), "{:?}", fails(12_288));
        let why = fails(12_287).expect("step 13 has 12,288 modules");
        assert!(why.contains("step 13 passes the limit"), "{why}");
    }

    #[test]
    fn blocks_before_each_step_are_seen_by_every_module() {
        let rules = "A(x) : n<9 --> A(n)[B(q)]A(x+r)\nB(x) --> B(x)C\nC --> ";
        let text = format!(
            "Lsystem: 1\nderivation length: 11\nAxiom: A(0)\nStart: {{ q = 1; }} StartEach: {{ n = n+1; r = q*2; }}\n\
             EndEach: {{ q = q*2; }}\n{rules}\nendlsystem\n"
        );
        let (grammar, _) = read(&text);
        let (options, limits) = (DeriveOptions::default(), Limits::default());
        let derived = derive(&grammar, &options, &limits).expect("derives");
        let plans = Plans::new(&grammar.program, false, false);
        let d = Derivation::new(&grammar, &plans, &options, 11, &limits);
        let by_steps = d.derive_by_steps(&options, None).expect("derives");
        assert!(derived.modules.len() > 500 && derived.modules == by_steps.modules);
        assert_eq!((derived.steps, derived.globals), (by_steps.steps, by_steps.globals));
    }

    #[test]
    fn growth_without_end_is_refused_with_its_production_and_step() {
        let (grammar, _) =
            read("Lsystem: 1\nderivation length: 60\nAxiom: F(1)\nF(x) : x>0 --> F(x*0.9)F(x*0.9)\nendlsystem\n");
        let why = derive_deferred(&grammar, &DeriveOptions::default(), &Limits::default()).expect_err("endless");
        let why = why.to_string();
        // 2^24 = 16,777,216 modules fit into 20 million.
        assert!(why.contains("L051") && why.contains("step 25 passes the limit of 20,000,000 modules"), "{why}");
        assert!(why.contains("speed.l:4") || why.contains(":4:1"), "at the production: {why}");
        assert!(why.contains("24 or less"), "{why}");
        // Growth that begins late.
        let (grammar, _) = read(
            "Lsystem: 1\nderivation length: 90\nAxiom: A(0)\nA(n) : n<40 --> A(n+1)\nA(n) : n>=40 --> A(n)A(n)A(n)\n\
             endlsystem\n",
        );
        let mut limits = Limits::default();
        limits.set("modules", "10000").expect("a limit");
        let why = derive(&grammar, &DeriveOptions::default(), &limits).expect_err("endless").to_string();
        // 3^8 = 6,561 modules after step 48.
        assert!(why.contains("step 49 passes the limit of 10,000 modules"), "{why}");
    }
}
