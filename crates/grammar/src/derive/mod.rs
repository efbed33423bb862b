//! Derivation: from the axiom through the steps to the final string.

mod deferred_step;
mod depth_first;
mod expand;
mod in_order;
mod independent;
mod last_step;
mod matching;
mod plan;
mod predict;
mod queries;
mod registers;
mod rewriter;
mod step;
mod text;
mod weighted_text;

pub use expand::{Interpretation, interpret, interpret_modules};
pub use last_step::{LastStep, Origin, derive_part, derive_steps};
pub use predict::{Prediction, predict};
pub use queries::{AskTurtle, QueryAnswer, QueryValue, TurtleAnswers, derive_with_queries};

use super::code::Bytecode;
use super::cpfg_random::CpfgRandom;
use super::grammar::{Grammar, runtime_error, runtime_report};
use super::modules::ModuleString;
use super::program::{Program, Section};
use super::symbols::SymbolId;
use super::vm::{DrawPurpose, Halt, RandomStreams, RuntimeWarning, RuntimeWarnings, Vm};
use deferred_step::DeferredStep;
use independent::DeferredDerivation;
use matching::Brackets;
use osier_base::Result;
use osier_base::diagnostic::Diagnostic;
use osier_base::limits::Limits;
use osier_base::math::narrow;
use osier_base::rng::{child, mix64};
use plan::Plans;

/// Options of a derivation: seed, plant, and overrides of the grammar's derivation length and choice of productions.
#[derive(Debug, Clone, Default)]
pub struct DeriveOptions {
    /// Seed of all random draws of the derivation and of its interpretation.
    pub seed: u64,
    /// Number of the plant, which lineages are derived from; not a seed.
    pub plant_id: u32,
    /// Derivation length; `None` for that of the grammar.
    pub steps: Option<u32>,
    /// Whether productions compete by weight; `None` if the grammar decides it by a `Seed:`.
    pub stochastic: Option<bool>,
    /// True to draw random numbers one after the other like the program cpfg, in order to reproduce its strings. `seed` has
    /// no effect then.
    pub draw_as_cpfg: bool,
}

/// The final string, with the seed, variables and warnings of its derivation, which its interpretation needs.
#[derive(Debug, Clone)]
pub struct DerivedString {
    /// The final string before the homomorphism; empty if the derivation is deferred.
    pub modules: ModuleString,
    /// Derivation steps up to the last one that changes the string; fewer than the length after `stop(n)` or once nothing
    /// changes.
    pub steps: u32,
    /// [`DeriveOptions::plant_id`], which also addresses the draws of the interpretation.
    pub plant_id: u32,
    /// [`DeriveOptions::seed`], which the interpretation also draws from.
    pub seed: u64,
    /// Warnings of the run: division by zero (L040), weights (L033, L034), depth (L052), idle steps (L054).
    pub warnings: Vec<Diagnostic>,
    pub(crate) stochastic: bool,
    pub(crate) length: u32,
    /// Number of steps done, for `Q`: the derivation length, or the step of `stop(n)`.
    pub(crate) completed: u32,
    pub(crate) file_seed: i64,
    pub(crate) globals: Vec<f64>,
    /// State of cpfg's random numbers at the end of the derivation, if it used them.
    pub(crate) cpfg: Option<CpfgRandom>,
    /// Output of `printf` during the derivation.
    pub output: String,
    /// Data to run the derivation again; `None` if the string is stored.
    deferred: Option<Deferred>,
    /// The string as text, if it was derived as text.
    text: Option<String>,
    count: u64,
    /// The last step; `None` unless only a part of it is drawn.
    last_step: Option<std::sync::Arc<LastStep>>,
}

/// What is run again for each use of the final string instead of storing it.
#[derive(Debug, Clone)]
enum Deferred {
    /// The derivation as a whole.
    Derivation(DeferredDerivation),
    /// The last step.
    Step(Box<DeferredStep>),
}

/// The final string, or the data to derive it again.
struct FinalModules {
    string: ModuleString,
    deferred: Option<Deferred>,
    text: Option<String>,
    count: u64,
}

/// Upper limit on the parameters of a string: 2^27 values of 4 bytes are half a gibibyte. It also ensures that the end
/// indices in [`ModuleString`] fit into 32 bits.
const MAX_PARAMS: usize = 1 << 27;

/// Derives and stores the final string of a grammar: rewrites and decomposes the axiom step by step. [`interpret`] then
/// applies the homomorphism. Queries of the turtle are not answered.
/// # Errors
/// `Input` with L050 if the string would certainly exceed the limit `modules`, with L051 if it does during the derivation,
/// with L044 for an endless loop.
pub fn derive(grammar: &Grammar, options: &DeriveOptions, limits: &Limits) -> Result<DerivedString> {
    derive_with(grammar, options, limits, Storage::String, None)
}

/// Derives a grammar without storing its final string: only counts the modules, and [`interpret`] derives them again while it
/// draws. If modules are rewritten independently of each other, no string is stored at all; else that before the last step is. The
/// final string is stored after decompositions and queries, with sub-L-systems, and if it is rewritten from its end.
/// # Errors
/// Errors of [`derive()`].
pub fn derive_deferred(grammar: &Grammar, options: &DeriveOptions, limits: &Limits) -> Result<DerivedString> {
    derive_with(grammar, options, limits, Storage::Deferred, None)
}

/// Derives the string of a grammar as text, parameters with six digits; [`DerivedString::into_text`] returns it.
/// # Errors
/// Errors of [`derive()`].
pub fn derive_text(grammar: &Grammar, options: &DeriveOptions, limits: &Limits) -> Result<DerivedString> {
    derive_with(grammar, options, limits, Storage::Text, None)
}

/// How a derivation stores its final string: as modules, not at all (it is derived again for drawing), or as text.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Storage {
    String,
    Deferred,
    /// As text, instead of modules.
    Text,
}

fn derive_with(
    grammar: &Grammar,
    options: &DeriveOptions,
    limits: &Limits,
    storage: Storage,
    turtle: Option<&mut AskTurtle<'_>>,
) -> Result<DerivedString> {
    let program = &grammar.program;
    let length = options.steps.unwrap_or(program.length);
    predict::check_limits(grammar, length, options, limits)?;
    let stochastic = options.stochastic.unwrap_or(program.is_stochastic());
    let plans = Plans::new(program, stochastic, options.draw_as_cpfg);
    let mut d = Derivation::new(grammar, &plans, options, length, limits);
    if program.rewrites_independently() && !options.draw_as_cpfg {
        return d.derive_independently(options, storage);
    }
    // Only random draws and the turtle read lineages: without either, text is derived without storing them.
    if storage == Storage::Text && !plans.draws() && turtle.is_none() {
        (d.string, d.next_string) = (ModuleString::without_ancestry(), ModuleString::without_ancestry());
    }
    d.defers_step = storage == Storage::Deferred && turtle.is_none();
    d.derive_by_steps(options, turtle)
}

/// State of a derivation that proceeds step by step: the strings, and everything that productions read.
pub(super) struct Derivation<'g> {
    grammar: &'g Grammar,
    program: &'g Program,
    plans: &'g Plans<'g>,
    limits: &'g Limits,
    vm: Vm,
    string: ModuleString,
    next_string: ModuleString,
    /// Buffers of rewritten blocks, reused from step to step, because allocating fresh pages costs more than the copying.
    block_buffers: Vec<ModuleString>,
    length: u32,
    brackets: Brackets,
    ignored: Vec<bool>,
    cut_symbol: Option<SymbolId>,
    unchanged_since: Option<u32>,
    steps_done: u32,
    /// Sum of the string lengths of all steps so far, compared with the limit `work`.
    work: u64,
    /// True if the turtle answers queries, so that modules change between the steps.
    has_queries: bool,
    /// Error of the interpretation for a query; returned in place of [`Halt::Query`].
    query_error: Option<osier_base::Error>,
    /// The strings after the steps so far; `None` if only the final string is kept.
    record: Option<StepRecord>,
    options: DeriveOptions,
    /// True if the string of the last step need not be stored.
    defers_step: bool,
    /// The last step, if its string is not stored.
    deferred_step: Option<DeferredStep>,
}

/// Strings of a derivation after its single steps.
struct StepRecord {
    /// The first step whose string is kept; 0 is the axiom.
    from: u32,
    strings: Vec<RecordedStep>,
    /// Memory of the strings, bytes.
    bytes: usize,
}

/// The string after one step, with the values that the global variables have then.
struct RecordedStep {
    step: u32,
    modules: ModuleString,
    globals: Vec<f64>,
}

impl<'g> Derivation<'g> {
    fn new(
        grammar: &'g Grammar,
        plans: &'g Plans<'g>,
        options: &DeriveOptions,
        length: u32,
        limits: &'g Limits,
    ) -> Self {
        let program = &grammar.program;
        // The `Seed:` of the file and the seed of the run are separate parts of every draw's address.
        let file_seed = program.seed.unwrap_or(0);
        let streams = RandomStreams::new(options.seed, options.plant_id, file_seed);
        let mut vm = Vm::new(streams, program.blocks.globals, length);
        vm.statement_limit = limits.get("statements");
        vm.cpfg = options.draw_as_cpfg.then(CpfgRandom::default);
        // Only symbols in the axiom or in a successor can occur in the string.
        let is_produced = |c: char| {
            let id = program.symbols.find(c)?;
            let templates = program.productions().flat_map(|p| &p.successor).chain(&program.axiom);
            templates.into_iter().any(|t| t.symbol == id).then_some(id)
        };
        Self {
            grammar,
            program,
            plans,
            limits,
            vm,
            string: ModuleString::default(),
            next_string: ModuleString::default(),
            block_buffers: Vec::new(),
            length,
            brackets: brackets(program),
            ignored: program.ignored.flags(&program.symbols),
            cut_symbol: is_produced('%').filter(|_| !program.overrides_cpfg('%')),
            unchanged_since: None,
            steps_done: 0,
            work: 0,
            has_queries: program.has_queries(),
            query_error: None,
            record: None,
            options: options.clone(),
            defers_step: false,
            deferred_step: None,
        }
    }

    /// Derives step by step: rewrites the whole string before the next step begins.
    fn derive_by_steps(mut self, options: &DeriveOptions, turtle: Option<&mut AskTurtle<'_>>) -> Result<DerivedString> {
        match self.run(turtle) {
            Ok(()) => Ok(self.finish(options)),
            Err(Halt::Query) => Err(self.query_error.take().unwrap_or_else(|| self.halt_report(Halt::Query))),
            Err(halt) => Err(self.halt_report(halt)),
        }
    }

    /// Runs the Start block and makes the axiom.
    fn begin(&mut self) -> std::result::Result<(), Halt> {
        // The Start block assigns the global variables; its `srand` replaces the seed of the file for all later draws.
        self.run_block(self.program.blocks.start.as_ref(), 0)?;
        if let Some(seed) = self.vm.reseeded() {
            self.vm.streams = self.vm.streams.with_file_seed(seed);
        }
        self.append_axiom()
    }

    fn run(&mut self, mut turtle: Option<&mut AskTurtle<'_>>) -> std::result::Result<(), Halt> {
        self.begin()?;
        self.ask(turtle.as_deref_mut())?;
        self.record_step(0)?;
        let blocks = &self.program.blocks;
        for step in 1..=self.length {
            // `Q` counts completed steps: the StartEach block reads the number of the step before.
            self.vm.step = step - 1;
            self.run_block(blocks.start_each.as_ref(), step)?;
            self.vm.step = step;
            let has_cut = self.cut_symbol.is_some_and(|cut| self.remove_cut_branches(cut));
            // Limit the time of the derivation by the sum of string lengths over the steps, because strings may shrink again.
            self.work = self.work.saturating_add(self.string.len() as u64);
            if self.work > self.limits.get("work") {
                return Err(Halt::Work);
            }
            let changed = if self.vm.cpfg.is_some() && !self.program.steps_backward(&self.vm.globals) {
                self.rewrite_in_order(step)?
            } else if self.defers_step && step == self.length && self.can_defer_step() {
                self.count_step(step)?
            } else {
                let rewritten = self.rewrite_string(step)?;
                self.decompose(step)? || rewritten
            };
            self.ask(turtle.as_deref_mut())?;
            self.run_block(blocks.end_each.as_ref(), step)?;
            self.steps_done = step;
            self.record_step(step)?;
            // First of the steps without change since the last change, for the warning L054. Steps that cut branches count as a change.
            self.unchanged_since = match (changed, has_cut) {
                (true, _) => None,
                (false, true) => Some(step + 1),
                (false, false) => self.unchanged_since.or(Some(step)),
            };
            // End early after `stop`, or if no later step can change the string.
            if self.vm.stopped || (!changed && self.nothing_can_change()) {
                break;
            }
        }
        self.run_block(blocks.end.as_ref(), self.steps_done)
    }

    /// Keeps the present string, if the derivation records its steps. All kept strings together have the limit of one string.
    fn record_step(&mut self, step: u32) -> std::result::Result<(), Halt> {
        let Some(record) = self.record.as_mut().filter(|record| step >= record.from) else { return Ok(()) };
        record.bytes = record.bytes.saturating_add(self.string.bytes());
        if record.bytes as u64 > self.limits.get("string-bytes") {
            return Err(Halt::Bytes);
        }
        let (modules, globals) = (self.string.clone(), self.vm.globals.clone());
        record.strings.push(RecordedStep { step, modules, globals });
        Ok(())
    }

    /// True if, after a step that changes nothing, no later step can change anything: there are no queries, no `StartEach`
    /// or `EndEach`, and no production that reads the step, draws random numbers, prints or writes global variables.
    fn nothing_can_change(&self) -> bool {
        let b = &self.program.blocks;
        let uses_step = |c: &Bytecode| {
            use crate::code::Op;
            c.writes_globals()
                || c.prints()
                || c.ops.iter().any(|o| matches!(o, Op::Step | Op::Remaining | Op::Random(_) | Op::Choose(_)))
        };
        // The productions of all L-systems of the file.
        let sections = [Section::Rules, Section::Decomposition];
        let mut productions = sections.into_iter().flat_map(|s| self.program.sections(s)).flat_map(|set| &set.list);
        !self.has_queries
            && b.start_each.is_none()
            && b.end_each.is_none()
            && !productions.any(|p| p.codes().any(uses_step))
    }

    fn run_block(&mut self, code: Option<&Bytecode>, step: u32) -> std::result::Result<(), Halt> {
        self.vm.begin_draws(DrawPurpose::Block, 0, Some(step));
        if let Some(code) = code {
            self.vm.run(code, &mut [])?;
        }
        Ok(())
    }

    fn append_axiom(&mut self) -> std::result::Result<(), Halt> {
        self.vm.begin_draws(DrawPurpose::Block, 1, Some(0));
        for t in &self.program.axiom {
            for arg in &t.args {
                let value = self.vm.eval(arg, &mut [])?;
                self.string.push_param(narrow(value));
            }
            // Lineages of the axiom are derived from the plant number, not from its seed: equal plants of two seeds share lineages.
            let symbol = u64::from(u32::from(self.program.symbols.get(t.symbol)));
            let plant = u64::from(self.vm.streams.plant_id());
            // The second number is that of the L-system: 0 for the main one.
            let lineage = child(mix64(&[plant, 0, symbol]), u64::from(t.occurrence));
            self.string.finish_module(t.symbol, lineage, 0);
        }
        Ok(())
    }

    /// Removes every `%` with the rest of its branch; true if there was any.
    fn remove_cut_branches(&mut self, cut: SymbolId) -> bool {
        if !self.string.symbols().contains(&cut) {
            return false;
        }
        self.next_string.clear();
        // `cut_at`: bracket depth of the active `%`. The closing bracket of that depth ends its effect and is kept.
        let (mut depth, mut cut_at) = (0_usize, None);
        for i in 0..self.string.len() {
            let m = self.string.get(i);
            if m.symbol == self.brackets.close {
                if cut_at == Some(depth) {
                    cut_at = None;
                }
                depth = depth.saturating_sub(1);
            } else if m.symbol == self.brackets.open {
                depth += 1;
            }
            if cut_at.is_none() && m.symbol == cut {
                cut_at = Some(depth);
            }
            if cut_at.is_none() {
                self.next_string.push(m);
            }
        }
        std::mem::swap(&mut self.string, &mut self.next_string);
        true
    }

    fn finish(mut self, options: &DeriveOptions) -> DerivedString {
        let completed = if self.vm.stopped { self.steps_done } else { self.length };
        let string = std::mem::take(&mut self.string);
        let (count, deferred) = match self.deferred_step.take() {
            Some(step) => (step.module_count, Some(Deferred::Step(Box::new(step)))),
            None => (string.len() as u64, None),
        };
        let modules = FinalModules { string, deferred, text: None, count };
        self.result(options, modules, completed)
    }

    /// Assembles the result; adds the warning L054 if the steps from some later step on change nothing.
    fn result(mut self, options: &DeriveOptions, modules: FinalModules, completed: u32) -> DerivedString {
        // L054: the derivation length is larger than the grammar can use.
        if let (Some(step), Some(place)) = (self.unchanged_since, self.program.length_place)
            && step > 1
            && step < self.length
        {
            self.vm.warnings.add("L054", place, &format!("nothing changes from step {step} on"));
        }
        DerivedString {
            modules: modules.string,
            steps: self.steps_done,
            plant_id: options.plant_id,
            seed: options.seed,
            warnings: runtime_diagnostics(self.grammar, &self.vm.warnings),
            stochastic: self.plans.rules.main().stochastic,
            length: self.length,
            completed,
            file_seed: self.vm.streams.file_seed(),
            globals: self.vm.globals,
            cpfg: self.vm.cpfg,
            output: self.vm.output,
            deferred: modules.deferred,
            text: modules.text,
            count: modules.count,
            last_step: None,
        }
    }

    fn halt_report(&self, halt: Halt) -> osier_base::Error {
        let grows = matches!(halt, Halt::Modules | Halt::Bytes | Halt::Parameters | Halt::Work);
        let error = halt_error(self.grammar, halt, self.steps_done + 1, self.limits);
        match (self.main_production().filter(|_| grows), error) {
            (Some(p), osier_base::Error::Input(mut report)) => {
                if let Some(mut d) = report.diagnostics.pop() {
                    // Label the cause first, then the derivation length.
                    d.labels.insert(0, (p.place.span, "this production makes most of them".to_owned()));
                    report.push(d);
                }
                osier_base::Error::Input(report)
            }
            (_, error) => error,
        }
    }

    /// The production that makes the current string grow most; `None` if none makes it grow.
    fn main_production(&self) -> Option<&crate::program::Production> {
        let mut counts = vec![0_u64; self.program.symbols.len()];
        for s in self.string.symbols() {
            if let Some(n) = counts.get_mut(usize::from(*s)) {
                *n += 1;
            }
        }
        let gain = |p: &&crate::program::Production| {
            let of = p.predecessor.first().and_then(|f| counts.get(usize::from(f.symbol))).copied().unwrap_or(0);
            of.saturating_mul(p.successor.len().saturating_sub(p.predecessor.len()) as u64)
        };
        // Homomorphisms do not lengthen the derived string. Of equal productions the first counts.
        let own = [&self.program.rules, &self.program.decomposition];
        let of_others = self.program.subsystems.iter().flat_map(|s| [&s.rules, &s.decomposition]);
        let productions = own.into_iter().chain(of_others).flat_map(|set| &set.list);
        productions.filter(|p| gain(p) > 0).min_by_key(|p| std::cmp::Reverse(gain(p)))
    }
}

/// Symbol numbers of `[` and `]`; `SymbolId::MAX`, which no symbol has, for a bracket that does not occur in the grammar.
fn brackets(program: &Program) -> Brackets {
    let find = |c| program.symbols.find(c).unwrap_or(SymbolId::MAX);
    Brackets { open: find('['), close: find(']') }
}

/// The warnings of the stack machine as diagnostics that refer to the grammar's source.
pub(crate) fn runtime_diagnostics(grammar: &Grammar, warnings: &RuntimeWarnings) -> Vec<Diagnostic> {
    let diagnostic = |e: &RuntimeWarning| {
        // Warnings of the same place are counted during the run; the message gives the number of occurrences.
        let times = if e.count > 1 { format!(", {} times", e.count) } else { String::new() };
        let help = match e.code {
            "L040" => "x/0 counts as x, x%0 as 0; test the divisor in a condition",
            "L026" => "indices run from 0; outside an array a read gives 0 and a write does nothing",
            "L033" => "weights must be 0 or more",
            "L034" => "give at least one production a positive weight",
            "L048" => "name its file in the view file: `function: FILE` or `contour: ID FILE`",
            "L052" => "raise 'maximum depth', or end the expansion by a condition",
            "L054" => "shorten the derivation length",
            _ => "",
        };
        let d = Diagnostic::warning(e.code, format!("{}{times}", e.message), e.place.span, "here");
        let d = if help.is_empty() { d } else { d.help(help) };
        grammar.with_macro_chain(d, e.place)
    };
    warnings.list.iter().map(diagnostic).collect()
}

/// Makes the error of a halted run; `step`: the step in which it halted.
pub(super) fn halt_error(grammar: &Grammar, halt: Halt, step: u32, limits: &Limits) -> osier_base::Error {
    // Errors of limits without a single responsible place refer to the derivation length.
    let at = grammar.length_place();
    match halt {
        Halt::Loop(place) => {
            let d = Diagnostic::error("L044", "this loop does not end", place.span, "after 1,000,000 iterations");
            runtime_report(grammar, grammar.with_macro_chain(d.help("change what its condition tests"), place))
        }
        Halt::Recursion(place) => {
            let message = "this function calls itself without end";
            let d = Diagnostic::error("L044", message, place.span, "after 200 calls within one another");
            let d = d.help("end it by a test of its parameters, or compute the value in a loop");
            runtime_report(grammar, grammar.with_macro_chain(d, place))
        }
        // A long chain of functions that do not call themselves, possibly called from one that does.
        Halt::NestedCalls(place) => {
            let message = "more than 200 calls of functions within one another";
            let d = Diagnostic::error("L044", message, place.span, "the last of them");
            let d = d.help("end functions that call themselves by a test, or write several of the others as one");
            runtime_report(grammar, grammar.with_macro_chain(d, place))
        }
        Halt::Statements(place) => {
            let message = format!("step {step} passes the budget of statements");
            let help = "raise it with --max-statements, or simplify the blocks";
            let d = Diagnostic::error("L051", message, place.span, "reached here").help(help);
            runtime_report(grammar, grammar.with_macro_chain(d, place))
        }
        Halt::Modules => {
            let limit = osier_base::limits::grouped(limits.get("modules"));
            let message = format!("step {step} passes the limit of {limit} modules");
            runtime_error(grammar, "L051", message, at, "raise it with --max-modules, or shorten the derivation")
        }
        Halt::Bytes => {
            let limit = osier_base::limits::grouped(limits.get("string-bytes"));
            let message = format!("step {step} passes the limit of {limit} bytes of strings");
            let help = "raise it with --max-string-bytes, shorten the derivation, or end the growth by a condition";
            runtime_error(grammar, "L051", message, at, help)
        }
        Halt::Expansion(place) => {
            let message = format!("step {step}: this production expands a single module without end");
            let help = "end the expansion by a condition, lower 'maximum depth', or raise --max-modules";
            let most = osier_base::limits::grouped(limits.get("modules") / expand::EXPANSION_SHARE as u64);
            let d =
                Diagnostic::error("L051", message, place.span, format!("applied more than {most} times")).help(help);
            runtime_report(grammar, grammar.with_macro_chain(d, place))
        }
        // The failed interpretation has reported the error.
        Halt::Query => {
            runtime_error(grammar, "L051", "the interpretation for queries failed".into(), at, "leave the queries out")
        }
        Halt::Work => {
            let limit = osier_base::limits::grouped(limits.get("work"));
            let message = format!("step {step} passes the limit of {limit} modules over all steps");
            runtime_error(grammar, "L051", message, at, "raise it with --max-work, or shorten the derivation")
        }
        Halt::Parameters => {
            let message = format!("step {step} passes the memory for parameters");
            runtime_error(grammar, "L051", message, at, "shorten the derivation, or use fewer parameters")
        }
    }
}
