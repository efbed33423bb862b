//! Finds, for each module of the final string, the module of the previous string from which it came.

use std::sync::Arc;

use super::plan::Plans;
use super::{Derivation, DeriveOptions, DerivedString, RecordedStep, StepRecord, derive, predict};
use crate::grammar::{Grammar, runtime_error};
use crate::modules::{LineageIds, Module, ModuleString};
use crate::symbols::SymbolId;
use osier_base::Result;
use osier_base::convert::saturating_index;
use osier_base::limits::Limits;

/// Limit on the modules whose origin may remain unknown, beyond which the search ends: each of them costs a pass over the
/// string before the step. Only decompositions and cut branches cause any.
const MAX_UNKNOWN: usize = 16;

/// The last step of a derivation, if only a part of it is drawn.
#[derive(Debug, Clone)]
pub struct LastStep {
    /// The string before the step.
    pub before: Arc<DerivedString>,
    /// Origin of each module of the string after the step.
    pub origins: Arc<Vec<Origin>>,
    /// The fraction of the step that is drawn, 0 to 1.
    pub part: f64,
}

impl LastStep {
    /// Whether the search for origins ended before the end of the string: what follows would be drawn as if it were new.
    pub fn is_incomplete(&self) -> bool {
        self.origins.iter().filter(|origin| **origin == Origin::Unknown).count() > MAX_UNKNOWN
    }
}

/// Where a module of the string after a step comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Origin {
    /// The module was in the string before the step, with this index.
    Kept(u32),
    /// A production made the module from the one with this index in the string before the step.
    Made(u32),
    /// Several productions, one after the other, made the module in the step.
    Unknown,
}

/// Derives a grammar to a step of which only the fraction `part` is drawn: the string has all steps of `options`, and
/// [`DerivedString::last_step`] describes the last one.
/// # Errors
/// Errors of [`derive_steps`].
pub fn derive_part(grammar: &Grammar, options: &DeriveOptions, part: f64, limits: &Limits) -> Result<DerivedString> {
    let length = options.steps.unwrap_or(grammar.program.length);
    let mut strings = derive_steps(grammar, options, length.saturating_sub(1), limits)?;
    let Some(derived) = strings.pop() else { return derive(grammar, options, limits) };
    // If the derivation ended before its last step, there is no part to draw.
    let Some(before) = strings.pop().filter(|_| derived.steps == length) else { return Ok(derived) };
    Ok(DerivedString::between(grammar, &Arc::new(before), derived, part))
}

/// The strings of a derivation after the step `from` and after each later one, up to its end; the last of them only if it ends before
/// `from`. Step 0 is the axiom. Each string has the length of the whole derivation as `Z`.
/// # Errors
/// Errors of [`derive()`], among them L051 if all strings together need more memory than one may have; `Input` with L063 for grammars
/// with queries, and for random numbers drawn as in cpfg.
pub fn derive_steps(
    grammar: &Grammar,
    options: &DeriveOptions,
    from: u32,
    limits: &Limits,
) -> Result<Vec<DerivedString>> {
    if grammar.has_queries() || options.draw_as_cpfg {
        let what = if options.draw_as_cpfg { "random numbers are drawn as in cpfg" } else { "the turtle is queried" };
        let message = format!("a part of a step cannot be drawn where {what}");
        return Err(runtime_error(grammar, "L063", message, grammar.length_place(), "use a whole number of steps"));
    }
    let program = &grammar.program;
    let length = options.steps.unwrap_or(program.length);
    predict::check_limits(grammar, length, options, limits)?;
    let plans = Plans::new(program, options.stochastic.unwrap_or(program.is_stochastic()), false);
    let mut derivation = Derivation::new(grammar, &plans, options, length, limits);
    derivation.record = Some(StepRecord { from, strings: Vec::new(), bytes: 0 });
    if let Err(halt) = derivation.run(None) {
        return Err(derivation.halt_report(halt));
    }
    let recorded = derivation.record.take().map(|record| record.strings).unwrap_or_default();
    // The last string is that of the whole derivation, whose variables the block `End` may have changed.
    let last = derivation.finish(options);
    let earlier = recorded.into_iter().filter(|kept| kept.step < last.steps);
    let string = |kept: RecordedStep| DerivedString {
        count: kept.modules.len() as u64,
        modules: kept.modules,
        globals: kept.globals,
        steps: kept.step,
        completed: kept.step,
        output: String::new(),
        warnings: Vec::new(),
        ..last.clone()
    };
    let mut strings: Vec<DerivedString> = earlier.map(string).collect();
    strings.push(last);
    Ok(strings)
}

/// The origin of each module of `after`. Both strings are in the order of derivation, so that the search moves only forward in both.
fn origins(grammar: &Grammar, before: &ModuleString, after: &ModuleString) -> Vec<Origin> {
    let mut search = OriginSearch { grammar, before, at: 0, occurrences: Vec::new() };
    let mut unknown = 0;
    let mut origin = |m: Module<'_>| {
        let found = if unknown < MAX_UNKNOWN { search.origin(m) } else { Origin::Unknown };
        unknown += usize::from(found == Origin::Unknown);
        found
    };
    after.iter().map(&mut origin).collect()
}

/// State of the search for origins.
struct OriginSearch<'a> {
    grammar: &'a Grammar,
    before: &'a ModuleString,
    /// Current index in the string before the step.
    at: usize,
    /// Symbols of the modules found so far that were made from the module at `at`, each with its number.
    occurrences: Vec<(SymbolId, u32)>,
}

impl OriginSearch<'_> {
    /// Origin of the next module of the final string. A module that the step made is recognised by its lineage, which follows
    /// from that of its parent.
    fn origin(&mut self, m: Module<'_>) -> Origin {
        let code = u64::from(u32::from(self.grammar.symbols().get(m.symbol)));
        let lineage = m.lineage();
        for i in self.at..self.before.len() {
            let parent = self.before.get(i).lineage();
            let known = self.occurrences.iter().position(|(symbol, _)| *symbol == m.symbol).filter(|_| i == self.at);
            let occurrence = known.map_or(0, |k| self.occurrences[k].1);
            if LineageIds::new(code, occurrence).lineage(parent) == lineage {
                if i != self.at {
                    (self.at, self.occurrences) = (i, Vec::new());
                }
                match known {
                    Some(k) => self.occurrences[k].1 += 1,
                    None => self.occurrences.push((m.symbol, 1)),
                }
                return Origin::Made(saturating_index(i));
            }
            if parent == lineage {
                (self.at, self.occurrences) = (i + 1, Vec::new());
                return Origin::Kept(saturating_index(i));
            }
        }
        Origin::Unknown
    }
}

impl DerivedString {
    /// The last step; `None` unless only a part of it is drawn.
    pub fn last_step(&self) -> Option<&LastStep> {
        self.last_step.as_deref()
    }

    /// The string `after` one step, of which the fraction `part` is drawn; `before`: the string before that step.
    pub fn between(grammar: &Grammar, before: &Arc<Self>, after: Self, part: f64) -> Self {
        let origins = Arc::new(origins(grammar, &before.modules, &after.modules));
        after.with_last_step(LastStep { before: Arc::clone(before), origins, part })
    }

    /// The string with the description of its last step, of which a part is drawn.
    pub fn with_last_step(mut self, step: LastStep) -> Self {
        self.last_step = Some(Arc::new(step));
        self
    }

    /// The string with other modules and without a last step.
    pub fn with_modules(&self, modules: ModuleString) -> Self {
        let count = modules.len() as u64;
        Self { modules, count, last_step: None, ..self.clone() }
    }

    /// Interpolates the parameters of module `i`, which must exist: sets each to `(1 - part) * old + part * value`.
    pub fn interpolate_parameters(&mut self, i: usize, old: &[f32], part: f64) {
        let params = self.modules.get(i).params;
        let blend = |(old, new): (&f32, &f32)| (1.0 - part) * f64::from(*old) + part * f64::from(*new);
        let values: Vec<f64> = old.iter().zip(params).map(blend).collect();
        self.modules.set_params(i, &values);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::read;

    fn letters(text: &str, steps: u32) -> Vec<String> {
        let (grammar, _) = read(text);
        let options = DeriveOptions { steps: Some(steps), ..DeriveOptions::default() };
        let derived = derive_part(&grammar, &options, 0.5, &Limits::default()).expect("derives");
        let step = derived.last_step().expect("a last step");
        let name = |m: Module<'_>| grammar.symbols().get(m.symbol);
        let origin = |(m, origin): (Module<'_>, &Origin)| match origin {
            Origin::Kept(i) => format!("{}={i}", name(m)),
            Origin::Made(i) => format!("{}<{}{i}", name(m), name(step.before.modules.get(*i as usize))),
            Origin::Unknown => format!("{}?", name(m)),
        };
        derived.modules.iter().zip(step.origins.iter()).map(origin).collect()
    }

    #[test]
    fn modules_know_what_they_were_made_from() {
        // ABC becomes BAA, nothing, C: equal symbols of one successor are told apart by their number.
        let text = "Lsystem: 1\nderivation length: 1\nAxiom: ABC\nA --> BAA\nB --> *\nendlsystem\n";
        assert_eq!(letters(text, 1), ["B<A0", "A<A0", "A<A0", "C=2"]);
        assert_eq!(letters(text, 2), ["B<A1", "A<A1", "A<A1", "B<A2", "A<A2", "A<A2", "C=3"]);
    }

    #[test]
    fn decomposed_modules_have_an_unknown_origin() {
        let text = "Lsystem: 1\nderivation length: 1\nAxiom: AC\nA --> B\ndecomposition\nB --> DE\nendlsystem\n";
        assert_eq!(letters(text, 1), ["D?", "E?", "C=1"]);
    }
}
