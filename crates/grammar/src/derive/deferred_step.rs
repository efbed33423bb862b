//! The last step of a derivation by steps, if its string is not stored: the step runs once to count its modules, and again for each
//! use of them. The string before the step is stored, which is several times shorter where the string branches.

use std::ops::ControlFlow;

use super::depth_first::{Block, ModuleSink};
use super::independent::CountingSink;
use super::matching::{self, ContextView};
use super::plan::RewritePlan;
use super::rewriter::{DrawPurposes, RewriteSettings, Rewriter};
use super::{Derivation, brackets};
use crate::grammar::Grammar;
use crate::modules::ModuleString;
use crate::program::Program;
use crate::vm::{Halt, Vm};
use osier_base::convert;
use osier_base::limits::Limits;

/// The string before the last step, and the state of the stack machine there.
#[derive(Debug, Clone)]
pub(super) struct DeferredStep {
    before: ModuleString,
    vm: Vm,
    /// Number of the step.
    step: u32,
    stochastic: bool,
    /// Number of modules of the final string.
    pub module_count: u64,
}

/// Results of running a step.
struct StepRun {
    /// Number of modules of the new string.
    count: u64,
    /// True if any production was applied.
    changed: bool,
}

impl DeferredStep {
    /// Memory that is held until the modules are used, bytes.
    #[cfg(test)]
    pub fn bytes(&self) -> usize {
        self.before.bytes()
    }

    /// Passes the modules of the final string to `sink`, in order.
    /// # Errors
    /// `Modules` beyond the limit or if the sink stops; the halts of statements.
    pub fn run<S: ModuleSink>(&self, grammar: &Grammar, limits: &Limits, sink: &mut S) -> Result<(), Halt> {
        let program = &grammar.program;
        let plan = RewritePlan::new(program, &program.rules, self.stochastic);
        let mut rewriter = Rewriter::new(self.settings(&plan, program), self.vm.clone());
        self.run_with(&mut rewriter, program, limits.get("modules"), sink).map(|_| ())
    }

    /// The productions of the step, and how their draws are addressed.
    fn settings<'p>(&self, plan: &'p RewritePlan<'p>, program: &Program) -> RewriteSettings<'p> {
        let (purposes, brackets) = (DrawPurposes::of_productions(), brackets(program));
        RewriteSettings { plan, purposes, step: Some(self.step), birth: self.step, tag: 0, brackets }
    }

    /// Runs the step by a rewriter whose machine has the state before it. `most`: limit on the modules of the new string.
    fn run_with<S: ModuleSink>(
        &self,
        rewriter: &mut Rewriter<'_>,
        program: &Program,
        most: u64,
        sink: &mut S,
    ) -> Result<StepRun, Halt> {
        let looks_around = rewriter.settings.plan.set.list.iter().any(|p| !p.is_context_free());
        let brackets = rewriter.settings.brackets;
        let partner = if looks_around { matching::matching_brackets(&self.before, brackets) } else { Vec::new() };
        let view = ContextView {
            modules: &self.before,
            partner: &partner,
            ignored: &program.ignored.flags(&program.symbols),
            is_ring: program.is_ring,
            is_reversed: false,
            borders: program.borders(),
        };
        rewrite_into(rewriter, &view, sink, most)
    }
}

/// Rewrites a string into a sink, module by module; `Modules` for more than `most` modules, or if the sink stops.
fn rewrite_into<S: ModuleSink>(
    rewriter: &mut Rewriter<'_>,
    view: &ContextView<'_>,
    sink: &mut S,
    most: u64,
) -> Result<StepRun, Halt> {
    let settings = rewriter.settings;
    let mut run = StepRun { count: 0, changed: false };
    let mut params: Vec<f32> = Vec::new();
    let mut i = 0;
    while let Some(&symbol) = view.modules.symbols().get(i) {
        let module = view.modules.get(i);
        let selected = if settings.plan.has_productions(symbol) { rewriter.select(module, view, i)? } else { None };
        let flow = match selected {
            Some(production) => {
                let planned = rewriter.planned(production);
                params.clear();
                // If the sink reads no parameters, they are computed only if that may report a division by zero or run code.
                if S::NEEDS_PARAMS || !planned.is_pure {
                    rewriter.append_params(production, &mut params)?;
                }
                run.changed = true;
                // A predecessor of several modules consumes all of them.
                i += planned.source.predecessor.len();
                let made = planned.template.symbols.len();
                run.count += made as u64;
                let block = Block::new(&planned.template, &params, &[], module.lineage(), settings.birth);
                if run.count <= most { sink.modules(&block, 0..made) } else { ControlFlow::Break(()) }
            }
            None => {
                i += 1;
                run.count += 1;
                let (end, lineage) = (convert::saturating_index(module.params.len()), module.lineage());
                let block = Block::of_module(&module, &end, &lineage);
                if run.count <= most { sink.modules(&block, 0..1) } else { ControlFlow::Break(()) }
            }
        };
        if flow.is_break() {
            return Err(Halt::Modules);
        }
    }
    Ok(run)
}

impl Derivation<'_> {
    /// True if the last step can run without storing its string: nothing but the productions changes the string in it, from
    /// left to right, without looking at the new string.
    pub(super) fn can_defer_step(&self) -> bool {
        self.plans.decomposition.is_empty()
            && self.program.subsystems.is_empty()
            && self.vm.cpfg.is_none()
            && !self.has_queries
            && !self.plans.rules.main().reads_made
            && !self.program.steps_backward(&self.vm.globals)
    }

    /// Runs the last step without storing its string, only counts its modules; true if any production was applied.
    pub(super) fn count_step(&mut self, step: u32) -> Result<bool, Halt> {
        // The buffers of earlier steps are not needed any more.
        self.block_buffers = Vec::new();
        self.next_string = ModuleString::default();
        let plan = self.plans.rules.main();
        let before = std::mem::take(&mut self.string);
        let mut deferred =
            DeferredStep { before, vm: self.vm.clone(), step, stochastic: plan.stochastic, module_count: 0 };
        let mut rewriter = Rewriter::new(deferred.settings(plan, self.program), self.vm.take());
        let most = self.limits.get("modules");
        let run = deferred.run_with(&mut rewriter, self.program, most, &mut CountingSink);
        self.vm = rewriter.vm;
        match run {
            Ok(StepRun { count, changed }) => {
                deferred.module_count = count;
                self.deferred_step = Some(deferred);
                Ok(changed)
            }
            Err(halt) => {
                // The message names the production that makes most of the string before the step.
                self.string = deferred.before;
                Err(halt)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Deferred, DeriveOptions, DerivedString, derive, derive_deferred};
    use crate::modules::ModuleString;
    use crate::tests::read;
    use osier_base::limits::Limits;

    /// Derives a grammar with a stored and with a deferred last step and checks that both agree; returns the deferred one.
    fn both(items: &str, rules: &str) -> (DerivedString, ModuleString) {
        let text = format!("Lsystem: 1\n{items}\n{rules}\nendlsystem\n");
        let (grammar, _) = read(&text);
        let (options, limits) = (DeriveOptions { seed: 3, ..Default::default() }, Limits::default());
        let stored = derive(&grammar, &options, &limits).expect("derives");
        let deferred = derive_deferred(&grammar, &options, &limits).expect("derives");
        assert_eq!(deferred.module_count(), stored.modules.len() as u64, "{text}");
        for _ in 0..2 {
            assert_eq!(*deferred.string(&grammar, &limits).expect("derives"), stored.modules, "{text}");
        }
        let said = |d: &DerivedString| format!("{:?}", d.warnings);
        assert_eq!((deferred.steps, &deferred.output, said(&deferred)), (stored.steps, &stored.output, said(&stored)));
        assert_eq!((&deferred.globals, deferred.completed), (&stored.globals, stored.completed), "{text}");
        let text = deferred.clone().into_text(&grammar, &limits).expect("derives");
        assert_eq!(text, grammar.print(&stored.modules));
        (deferred, stored.modules)
    }

    #[test]
    fn a_deferred_step_makes_the_string_of_a_stored_one() {
        for (items, rules) in [
            ("derivation length: 5\nAxiom: F", "F < F > F --> F\nF --> F[+F]F[-F]F"),
            (
                "Seed: 4\nderivation length: 9\nAxiom: A(1)B",
                "A(x) > B --> A(x+ran(1))B : 2\nA(x) > B --> [A(x/0)]B\nB --> A(nran(1,2)) B",
            ),
            ("derivation length: 12\nAxiom: CABBB", "A < B --> A\nA --> B\nC --> C[+B]"),
            // Global variables that modules write, output, and several modules at once.
            (
                "derivation length: 7\nStart: {n=0;}\nEndEach: {m=n;}\nAxiom: A A A(2)",
                "A A : 1 {n=n+1; printf(\"%g \",n);} --> A A(n) A\nA(x) --> A(x+m)",
            ),
            ("ring Lsystem\nderivation length: 6\nAxiom: A B B", "A < B --> A B\nA --> B"),
            // The end of the derivation by a step that changes nothing, and by `stop`.
            ("derivation length: 20\nAxiom: A B C", "A < B --> A\nB < C --> B"),
            ("derivation length: 20\nAxiom: A B(1)", "A < B(n) : {if (n>4) {stop(1);}} 1 --> B(n+1) A"),
            ("derivation length: 5\nAxiom: A B(1)", "A < B(n) : {if (n>4) {stop(1);}} 1 --> B(n+1) A"),
            ("derivation length: 3\nAxiom: A [ B % C ] B", "A < B --> A B\nB > B --> B"),
        ] {
            both(items, rules);
        }
    }

    #[test]
    fn strings_with_contexts_take_few_bytes_for_each_drawn_module() {
        let (derived, string) = both("derivation length: 7\nAxiom: F", "F < F > F --> F[+F]F[-F]F\nF --> F[+F]F[-F]F");
        let Some(Deferred::Step(step)) = &derived.deferred else { panic!("the last step is not deferred") };
        assert!(derived.modules.is_empty() && string.len() > 100_000);
        // Two bytes for a symbol, eight for a lineage, four for a birth: the final string would take 14 a module.
        assert_eq!(string.bytes(), 14 * string.len());
        assert!(step.bytes() <= 8 * string.len(), "{} bytes for {} modules", step.bytes(), string.len());
    }
}
