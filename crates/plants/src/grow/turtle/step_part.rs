//! A part of the last step of a derivation: how far each module of the final string has grown, so that a plant changes without jumps
//! from step to step. Own.
//!
//! Just after step n the string of step n + 1 looks like that of step n: new modules have size 0, turns at the level of
//! their predecessor are 0, and the pieces that replace a segment lie on it. All of that grows to its full value in
//! proportion to the part. Modules that only change their parameters interpolate them. What the step removes is drawn before what it
//! has become, and shrinks.

use std::ops::Range;

use osier_base::convert::{saturating_index, to_usize};
use osier_grammar::{DerivedString, Grammar, LastStep, Module, ModuleString, Origin};
use osier_scene::plant::NONE;

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

    /// The same factor on everything.
    fn all(factor: f64) -> Self {
        Self { length: factor, turn: factor, size: factor }
    }

    /// The same factor on everything but turns.
    fn without_turns(factor: f64) -> Self {
        Self { turn: 1.0, ..Self::all(factor) }
    }
}

/// What a symbol does for the growth within a step.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum SymbolRole {
    /// Draws a segment or moves.
    Step,
    /// Turns.
    Turn,
    /// Makes an organ of the symbol after it.
    Organ,
    /// No command by itself: the letter of an organ, or a symbol that the homomorphism draws.
    Nothing,
    /// Another command, whose effect is not scaled.
    Other,
}

/// Where a module after a step was before it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum ModuleLink {
    /// It was the module of this index.
    Same(u32),
    /// It was the part of a segment or move between two shares, 0 to 1, of its length.
    Part {
        /// Index of the module of the segment or move.
        of: u32,
        /// Shares of its length at the beginning and the end of the part.
        shares: [f32; 2],
    },
    /// It was not there, and grows from a point of the module of this index.
    Born {
        /// Index of the module.
        at: u32,
        /// The point: 0 is where the turtle stands before the module, 1 after it.
        share: f32,
    },
}

impl ModuleLink {
    /// Index of the module before the step.
    pub fn index(self) -> u32 {
        match self {
            Self::Same(i) | Self::Part { of: i, .. } | Self::Born { at: i, .. } => i,
        }
    }
}

/// The string after a step that is drawn in part, with the modules that the step removes.
#[derive(Debug)]
pub(super) struct GrowingString {
    /// The string to be drawn.
    pub string: DerivedString,
    /// Growth of each of its modules.
    pub growth: Vec<ModuleGrowth>,
    /// Index in it of each module of the string after the step.
    pub of_after: Vec<u32>,
    /// Index in it of each module of the string before the step that is drawn because the step removes it; [`NONE`] for all others.
    pub of_before: Vec<u32>,
}

/// Removed modules that are drawn before a module of the string after the step.
struct Removed {
    /// Index in the string after the step.
    at: usize,
    /// Indices in the string before the step.
    range: Range<usize>,
    /// Whether it is the rest of a branch behind a `%`.
    is_cut: bool,
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
    out.extend((next..step.before.modules.len()).map(|parent| Group { parent, range: end..end }));
    out
}

/// Length of a fully grown step of the turtle, turtle units.
fn length(m: Module<'_>) -> f64 {
    m.params.first().map_or(1.0, |x| f64::from(*x))
}

/// A string and its last step, with the roles of the symbols.
struct StepChange<'a> {
    grammar: &'a Grammar,
    derived: &'a DerivedString,
    step: &'a LastStep,
    roles: &'a [SymbolRole],
    groups: Vec<Group>,
}

/// What a group means for the growth of its modules.
struct GroupChange {
    /// Bracket depth of each module within its successor.
    depths: Vec<i32>,
    /// Length of the steps outside of brackets, if they replace a step.
    replaced: Option<f64>,
    /// The module that continues the predecessor: the first of its symbol and number of parameters outside of brackets. Within
    /// brackets turns are whole from the beginning of the step, so that what is there must grow from nothing.
    heir: Option<usize>,
}

impl<'a> StepChange<'a> {
    fn new(grammar: &'a Grammar, derived: &'a DerivedString, step: &'a LastStep, roles: &'a [SymbolRole]) -> Self {
        Self { grammar, derived, step, roles, groups: groups(step) }
    }

    fn role(&self, m: Module<'_>) -> SymbolRole {
        self.roles.get(usize::from(m.symbol)).copied().unwrap_or(SymbolRole::Other)
    }

    fn symbol(&self, m: Module<'_>) -> char {
        self.grammar.symbols().get(m.symbol)
    }

    fn before(&self) -> &'a ModuleString {
        &self.step.before.modules
    }

    fn change(&self, group: &Group) -> GroupChange {
        let parent = self.before().get(group.parent);
        let (mut depths, mut depth) = (Vec::with_capacity(group.range.len()), 0_i32);
        let (mut sum, mut heir) = (0.0, None);
        for j in group.range.clone() {
            let m = self.derived.modules.get(j);
            depth -= i32::from(self.symbol(m) == ']');
            depths.push(depth);
            if depth == 0 && self.role(m) == SymbolRole::Step {
                sum += length(m);
            }
            if depth == 0 && m.symbol == parent.symbol && m.params.len() == parent.params.len() {
                heir = heir.or(Some(j));
            }
            depth += i32::from(self.symbol(m) == '[');
        }
        // Of a step the lengths change, which are no parameters to be interpolated.
        let is_step = self.role(parent) == SymbolRole::Step;
        GroupChange { depths, replaced: Some(sum).filter(|sum| is_step && *sum > 0.0), heir: heir.filter(|_| !is_step) }
    }

    /// Growth of each module of the string after the step.
    fn growth(&self) -> Vec<ModuleGrowth> {
        let part = self.step.part;
        let of_origin = |origin: &Origin| match origin {
            Origin::Unknown => ModuleGrowth::all(part),
            _ => ModuleGrowth::WHOLE,
        };
        let mut growth: Vec<ModuleGrowth> = self.step.origins.iter().map(of_origin).collect();
        for group in &self.groups {
            let change = self.change(group);
            // Steps that replace a step share its length at first: l (1 - part) / sum + part is the factor on each of their own lengths.
            let shared = |sum: f64| (1.0 - part) * length(self.before().get(group.parent)) / sum + part;
            let along = change.replaced.map_or(part, shared);
            for (j, depth) in group.range.clone().zip(&change.depths) {
                growth[j] = if *depth > 0 {
                    ModuleGrowth::without_turns(part)
                } else {
                    ModuleGrowth { length: along, ..ModuleGrowth::all(part) }
                };
                // The heir is fully grown: its parameters are interpolated instead.
                if change.heir == Some(j) {
                    growth[j] = ModuleGrowth::WHOLE;
                }
            }
        }
        growth
    }

    /// Where each module after the step was before it. Indices of modules before the step never fall.
    fn links(&self) -> Vec<ModuleLink> {
        let mut links = Vec::with_capacity(self.step.origins.len());
        let mut last = 0;
        for origin in self.step.origins.iter() {
            if let Origin::Kept(i) | Origin::Made(i) = origin {
                last = *i;
            }
            links.push(match origin {
                Origin::Kept(i) => ModuleLink::Same(*i),
                // What has no heir grows behind its predecessor.
                _ => ModuleLink::Born { at: last, share: 1.0 },
            });
        }
        for group in &self.groups {
            let change = self.change(group);
            let parent = saturating_index(group.parent);
            let mut reached = 0.0;
            for (j, depth) in group.range.clone().zip(&change.depths) {
                let m = self.derived.modules.get(j);
                links[j] = match (change.replaced, change.heir) {
                    (Some(sum), _) => {
                        let from = osier_base::math::narrow(reached / sum);
                        if *depth == 0 && self.role(m) == SymbolRole::Step {
                            reached += length(m);
                            let to = osier_base::math::narrow(reached / sum);
                            ModuleLink::Part { of: parent, shares: [from, to] }
                        } else {
                            ModuleLink::Born { at: parent, share: from }
                        }
                    }
                    (None, Some(heir)) if heir == j => ModuleLink::Same(parent),
                    (None, Some(heir)) if j < heir => ModuleLink::Born { at: parent, share: 0.0 },
                    (None, _) => ModuleLink::Born { at: parent, share: 1.0 },
                };
            }
        }
        links
    }

    /// The modules that the step removes and that are drawn, in the order of the string.
    fn removed(&self) -> Vec<Removed> {
        // Modules inserted into the string would be neighbours of others.
        if self.grammar.draws_by_context() {
            return Vec::new();
        }
        let before = self.before();
        let is_expanded = self.grammar.has_homomorphism();
        let mut out: Vec<Removed> = Vec::new();
        let mut cut_end = 0;
        for group in &self.groups {
            if group.parent < cut_end {
                continue;
            }
            let m = before.get(group.parent);
            if group.range.is_empty() && self.symbol(m) == '%' && self.role(m) == SymbolRole::Other {
                cut_end = self.end_of_branch(group.parent);
                let range = group.parent + 1..cut_end;
                out.push(Removed { at: group.range.start, range, is_cut: true });
                continue;
            }
            let change = self.change(group);
            if change.replaced.is_some() || change.heir.is_some() {
                continue;
            }
            let follows_organ =
                group.parent.checked_sub(1).is_some_and(|i| self.role(before.get(i)) == SymbolRole::Organ);
            match self.role(m) {
                // An organ has two modules, of which the first may stay.
                SymbolRole::Nothing if follows_organ => {
                    let kept = Origin::Kept(saturating_index(group.parent - 1));
                    let stays = group.range.start.checked_sub(1).is_some_and(|i| self.step.origins[i] == kept);
                    let at = group.range.start - usize::from(stays);
                    out.push(Removed { at, range: group.parent - 1..group.parent + 1, is_cut: false });
                }
                SymbolRole::Step | SymbolRole::Turn => {
                    let range = group.parent..group.parent + 1;
                    out.push(Removed { at: group.range.start, range, is_cut: false });
                }
                SymbolRole::Nothing if is_expanded => {
                    let range = group.parent..group.parent + 1;
                    out.push(Removed { at: group.range.start, range, is_cut: false });
                }
                _ => {}
            }
        }
        out
    }

    /// Index of the bracket that ends the branch of module `i` before the step, or the length of the string.
    fn end_of_branch(&self, i: usize) -> usize {
        let before = self.before();
        let mut depth = 0_usize;
        for k in i..before.len() {
            match self.symbol(before.get(k)) {
                '[' => depth += 1,
                ']' if depth == 0 => return k,
                ']' => depth -= 1,
                _ => {}
            }
        }
        before.len()
    }
}

/// Where each module of a string was before its last step. `roles`: by symbol.
pub(super) fn module_links(
    grammar: &Grammar,
    derived: &DerivedString,
    step: &LastStep,
    roles: &[SymbolRole],
) -> Vec<ModuleLink> {
    StepChange::new(grammar, derived, step, roles).links()
}

impl GrowingString {
    /// The string to be drawn for one whose last step is drawn in part. `roles`: by symbol.
    pub fn new(grammar: &Grammar, derived: &DerivedString, step: &LastStep, roles: &[SymbolRole]) -> Self {
        let change = StepChange::new(grammar, derived, step, roles);
        let (after, before) = (&derived.modules, change.before());
        let growth_after = change.growth();
        let shrunk = 1.0 - step.part;
        let brackets = grammar.symbols().find('[').zip(grammar.symbols().find(']'));
        let mut modules = ModuleString::default();
        let mut growth = Vec::with_capacity(growth_after.len());
        let mut of_after = Vec::with_capacity(after.len());
        let mut of_before = vec![NONE; before.len()];
        let mut next = 0;
        let mut keep = |modules: &mut ModuleString, growth: &mut Vec<ModuleGrowth>, to: usize| {
            let range = next..to.max(next);
            of_after.extend((modules.len()..).take(range.len()).map(saturating_index));
            growth.extend_from_slice(&growth_after[range.clone()]);
            next = range.end;
            modules.extend(after, range);
        };
        for removed in change.removed() {
            keep(&mut modules, &mut growth, removed.at);
            // The rest of a branch that is cut is a branch of its own, so that nothing follows it.
            let cut = removed.is_cut.then(|| before.get(removed.range.start.saturating_sub(1)).lineage());
            let branch = cut.zip(brackets);
            if let Some((lineage, (open, _))) = branch {
                modules.push(Module::new(open, &[], lineage, step.before.steps));
                growth.push(ModuleGrowth::WHOLE);
            }
            let own = if removed.is_cut { ModuleGrowth::without_turns(shrunk) } else { ModuleGrowth::all(shrunk) };
            for (k, i) in (modules.len()..).zip(removed.range.clone()) {
                of_before[i] = saturating_index(k);
                growth.push(own);
            }
            modules.extend(before, removed.range.clone());
            if let Some((lineage, (_, close))) = branch {
                modules.push(Module::new(close, &[], lineage, step.before.steps));
                growth.push(ModuleGrowth::WHOLE);
            }
        }
        keep(&mut modules, &mut growth, after.len());
        // Modules that continue their predecessor move from its parameters to their own.
        let mut string = derived.with_modules(modules);
        for group in &change.groups {
            let old = before.get(group.parent).params;
            let heir = change.change(group).heir.and_then(|heir| of_after.get(heir)).filter(|_| !old.is_empty());
            if let Some(heir) = heir {
                string.interpolate_parameters(to_usize(*heir), old, step.part);
            }
        }
        Self { string, growth, of_after, of_before }
    }
}
