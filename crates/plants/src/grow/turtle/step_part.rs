//! A part of the last step of a derivation: how far each module of the final string has grown, so that a plant changes without jumps
//! from step to step. Own.
//!
//! Just after step n the string of step n + 1 looks like that of step n: new modules have size 0, turns at the level of
//! their predecessor are 0, and the pieces that replace a segment lie on it. All of that grows to its full value in
//! proportion to the part. Modules that only change their parameters interpolate them.

use std::ops::Range;

use osier_grammar::{DerivedString, Grammar, LastStep, Module, Origin};

/// Factors on the effects of a module while it grows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ModuleGrowth {
    /// Factor on the lengths of steps.
    pub length: f64,
    /// Factor on angles of turns.
    pub turn: f64,
    /// Factor on widths, and on the sizes of organs and shapes.
    pub size: f64,
}

impl ModuleGrowth {
    /// Growth of a fully grown module: all factors are 1.
    pub const WHOLE: Self = Self { length: 1.0, turn: 1.0, size: 1.0 };
}

/// A segment or a move that the last step removes; it shrinks in the course of the step.
#[derive(Debug, Clone, Copy)]
pub(super) struct RemovedStep {
    /// Index in the final string of the module before which the removed step is drawn.
    pub at: usize,
    /// Index in the string before the step.
    pub of: usize,
}

/// Growth of all modules of a final string.
#[derive(Debug)]
pub(super) struct StepGrowth {
    /// Growth of each module of the final string.
    pub modules: Vec<ModuleGrowth>,
    /// Steps that the last step of the derivation removes, in the order of the final string.
    pub removed: Vec<RemovedStep>,
    /// Growth of the removed steps.
    pub of_removed: ModuleGrowth,
}

/// The modules of a final string that one module became in the last step.
struct Group {
    /// Index in the string before the step.
    parent: usize,
    /// Indices in the final string; empty if the module was removed.
    range: Range<usize>,
}

/// The groups of a last step, in the order of the string before it. Modules that the step kept, and those of unknown origin, belong to none.
fn groups(step: &LastStep) -> Vec<Group> {
    let mut out: Vec<Group> = Vec::new();
    // Index, in the string before the step, of the first module from which no module of the final string has come so
    // far.
    let mut next = 0;
    for (j, origin) in step.origins.iter().enumerate() {
        let (parent, is_made) = match origin {
            Origin::Made(i) => (*i as usize, true),
            Origin::Kept(i) => (*i as usize, false),
            Origin::Unknown => continue,
        };
        // Modules before it that have no successor.
        out.extend((next..parent).map(|parent| Group { parent, range: j..j }));
        next = next.max(parent + 1);
        match out.last_mut() {
            Some(group) if is_made && group.parent == parent => group.range.end = j + 1,
            _ if is_made => out.push(Group { parent, range: j..j + 1 }),
            _ => {}
        }
    }
    let end = step.origins.len();
    out.extend((next..step.before.len()).map(|parent| Group { parent, range: end..end }));
    out
}

/// Length of a fully grown step of the turtle, turtle units.
fn length(m: Module<'_>) -> f64 {
    m.params.first().map_or(1.0, |x| f64::from(*x))
}

/// A final string, its last step, and which symbols are segments or moves.
struct GrowingString<'a> {
    grammar: &'a Grammar,
    derived: &'a DerivedString,
    step: &'a LastStep,
    /// By symbol, whether it is a segment or a move.
    step_symbols: &'a [bool],
}

impl GrowingString<'_> {
    /// Whether a module is a segment or a move.
    fn is_step(&self, m: Module<'_>) -> bool {
        self.step_symbols.get(usize::from(m.symbol)).copied().unwrap_or(false)
    }

    /// The module of a group that continues its predecessor: the only one with the predecessor's symbol and number of
    /// parameters.
    fn heir(&self, group: &Group) -> Option<usize> {
        let parent = self.step.before.get(group.parent);
        let is_alike = |j: &usize| {
            let m = self.derived.modules.get(*j);
            m.symbol == parent.symbol && m.params.len() == parent.params.len()
        };
        let mut alike = group.range.clone().filter(is_alike);
        let first = alike.next()?;
        alike.next().is_none().then_some(first)
    }

    /// Sets the growth of the modules of a group.
    fn set_growth(&self, group: &Group, growth: &mut StepGrowth) {
        let (parent, part) = (self.step.before.get(group.parent), self.step.part);
        let modules = group.range.clone().map(|j| (j, self.derived.modules.get(j)));
        // Depth of each module within its successor, and the sum of the steps outside of brackets.
        let mut depths = Vec::with_capacity(group.range.len());
        let (mut depth, mut sum) = (0_i32, 0.0);
        for (_, m) in modules.clone() {
            depth -= i32::from(self.grammar.symbols().get(m.symbol) == ']');
            depths.push(depth);
            if depth == 0 && self.is_step(m) {
                sum += length(m);
            }
            depth += i32::from(self.grammar.symbols().get(m.symbol) == '[');
        }
        // Steps that replace one step first share its length l: each is scaled by (1 - part) l / sum + part.
        let replaces = self.is_step(parent) && sum > 0.0;
        let along = if replaces { (1.0 - part) * length(parent) / sum + part } else { part };
        let heir = self.heir(group);
        for ((j, _), depth) in modules.zip(depths) {
            growth.modules[j] = if depth > 0 {
                ModuleGrowth { length: part, turn: 1.0, size: part }
            } else {
                ModuleGrowth { length: along, turn: part, size: part }
            };
            // The heir is fully grown: its parameters are interpolated instead.
            if heir == Some(j) && !self.is_step(parent) {
                growth.modules[j] = ModuleGrowth::WHOLE;
            }
        }
        if self.is_step(parent) && !replaces {
            growth.removed.push(RemovedStep { at: group.range.start, of: group.parent });
        }
    }
}

/// Interpolates the parameters of modules that the last step replaces by a module of the same symbol and number of parameters.
/// Segments and moves are left out; [`StepGrowth`] holds their lengths. `step_symbols`: for each symbol, whether it is a segment
/// or a move.
pub(super) fn interpolate_heirs(grammar: &Grammar, derived: &mut DerivedString, step_symbols: &[bool]) {
    let Some(step) = derived.last_step() else { return };
    let part = step.part;
    let string = GrowingString { grammar, derived, step, step_symbols };
    let change = |group: &Group| {
        let parent = step.before.get(group.parent);
        let heir = string.heir(group).filter(|_| !string.is_step(parent) && !parent.params.is_empty())?;
        Some((heir, parent.params.to_vec()))
    };
    let changes: Vec<(usize, Vec<f32>)> = groups(step).iter().filter_map(change).collect();
    for (heir, old) in changes {
        derived.interpolate_parameters(heir, &old, part);
    }
}

impl StepGrowth {
    /// Growth of the modules of a string whose last step is drawn in part. `step_symbols`: for each symbol, whether it is a
    /// segment or a move.
    pub fn new(grammar: &Grammar, derived: &DerivedString, step: &LastStep, step_symbols: &[bool]) -> Self {
        let growing = ModuleGrowth { length: step.part, turn: step.part, size: step.part };
        let of_origin = |origin: &Origin| if *origin == Origin::Unknown { growing } else { ModuleGrowth::WHOLE };
        let of_removed = ModuleGrowth { length: 1.0 - step.part, ..ModuleGrowth::WHOLE };
        let mut out = Self { modules: step.origins.iter().map(of_origin).collect(), removed: Vec::new(), of_removed };
        let string = GrowingString { grammar, derived, step, step_symbols };
        for group in groups(step) {
            string.set_growth(&group, &mut out);
        }
        // A cut (`%`) removes modules together with their brackets, so that they cannot be drawn where they were.
        if step.before.symbols().iter().any(|s| grammar.symbols().get(*s) == '%') {
            out.removed.clear();
        }
        out
    }
}
