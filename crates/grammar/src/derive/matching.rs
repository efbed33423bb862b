//! Contexts: what stands to the left and right of a module in a bracketed string.

use crate::modules::{Module, ModuleString};
use crate::program::{ContextElement, FormalModule};
use crate::symbols::SymbolId;

/// Stands for "no matching bracket" in a table of indices.
const NO_PARTNER: u32 = u32::MAX;

/// A string prepared for context matching.
#[derive(Debug, Clone, Copy)]
pub(super) struct ContextView<'a> {
    pub modules: &'a ModuleString,
    /// Partner of each bracket; empty if no production asks for contexts.
    pub partner: &'a [u32],
    /// Per symbol: true if contexts ignore it.
    pub ignored: &'a [bool],
}

/// Symbol numbers of `[` and `]`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Brackets {
    pub open: SymbolId,
    pub close: SymbolId,
}

/// Partner of every bracket; `NO_PARTNER` for all else and for brackets without one.
pub(super) fn matching_brackets(modules: &ModuleString, brackets: Brackets) -> Vec<u32> {
    let mut partner = vec![NO_PARTNER; modules.len()];
    let mut stack: Vec<u32> = Vec::new();
    for (i, &s) in (0_u32..).zip(modules.symbols()) {
        if s == brackets.open {
            stack.push(i);
        } else if s == brackets.close
            && let Some(o) = stack.pop()
        {
            partner[o as usize] = i;
            partner[i as usize] = o;
        }
    }
    partner
}

/// Copies the parameters of a matched module to the local variables of the formal module.
fn bind_parameters(formal: &FormalModule, module: Module<'_>, locals: &mut [f64]) {
    let first = usize::from(formal.slot);
    for (i, v) in module.params.iter().enumerate() {
        if let Some(slot) = locals.get_mut(first + i) {
            *slot = f64::from(*v);
        }
    }
}

/// Does the module have the formal's symbol and number of parameters? If so its parameters are bound.
#[inline]
pub(super) fn match_module(formal: &FormalModule, module: Module<'_>, locals: &mut [f64]) -> bool {
    let fits = module.symbol == formal.symbol && module.params.len() == usize::from(formal.arity);
    if fits {
        bind_parameters(formal, module, locals);
    }
    fits
}

impl ContextView<'_> {
    fn partner(&self, i: usize) -> Option<usize> {
        self.partner.get(i).filter(|p| **p != NO_PARTNER).map(|p| *p as usize)
    }

    fn is_ignored(&self, symbol: SymbolId) -> bool {
        self.ignored.get(usize::from(symbol)).copied().unwrap_or(false)
    }

    /// Is the left context there, scanning from module `at` (not included) to the left? Closed branches are jumped
    /// over, openings are stepped over: a branch sees the axis that carries it.
    pub fn matches_left(&self, brackets: Brackets, context: &[ContextElement], at: usize, locals: &mut [f64]) -> bool {
        let mut i = at;
        // The context is matched from its last module, the neighbour, outwards.
        let mut wanted = context.iter().rev();
        let mut next = wanted.next();
        while let Some(element) = next {
            let ContextElement::Module(formal) = element else { return false };
            let Some(k) = i.checked_sub(1) else { return false };
            i = k;
            let symbol = self.modules.symbols()[i];
            // A closed branch is a sibling: jump to its opening bracket. An unmatched bracket ends the search.
            if symbol == brackets.close {
                match self.partner(i) {
                    Some(open) => i = open,
                    None => return false,
                }
            } else if symbol != brackets.open && !self.is_ignored(symbol) {
                if !match_module(formal, self.modules.get(i), locals) {
                    return false;
                }
                next = wanted.next();
            }
        }
        true
    }

    /// Is the right context there, beginning with module `at`?
    pub fn matches_right(&self, brackets: Brackets, context: &[ContextElement], at: usize, locals: &mut [f64]) -> bool {
        let mut i = at;
        for element in context {
            // Each element continues after the module that matched the element before it.
            let found = match element {
                ContextElement::Module(formal) => self.next_on_axis(brackets, formal, i, locals),
                ContextElement::Open => self.skip_ignored(i).filter(|k| self.modules.symbols()[*k] == brackets.open),
                ContextElement::Close => self.end_of_branch(brackets, i, false),
                ContextElement::CloseRest => self.end_of_branch(brackets, i, true),
            };
            match found {
                Some(k) => i = k + 1,
                None => return false,
            }
        }
        true
    }

    /// The next module that is not ignored.
    fn skip_ignored(&self, from: usize) -> Option<usize> {
        (from..self.modules.len()).find(|&i| !self.is_ignored(self.modules.symbols()[i]))
    }

    /// Index of the next module on this axis, if it matches `formal`; branches in between are jumped over.
    fn next_on_axis(
        &self,
        brackets: Brackets,
        formal: &FormalModule,
        from: usize,
        locals: &mut [f64],
    ) -> Option<usize> {
        let mut i = from;
        loop {
            i = self.skip_ignored(i)?;
            let symbol = self.modules.symbols()[i];
            if symbol == brackets.open {
                i = self.partner(i)? + 1;
            } else if symbol == brackets.close {
                // The axis ends here without the module.
                return None;
            } else {
                return match_module(formal, self.modules.get(i), locals).then_some(i);
            }
        }
    }

    /// The closing bracket of the branch; what is left before it must be branches, or anything if `rest`.
    fn end_of_branch(&self, brackets: Brackets, from: usize, rest: bool) -> Option<usize> {
        let mut i = from;
        loop {
            i = if rest { i } else { self.skip_ignored(i)? };
            // Branches that are still open are skipped as a whole.
            let symbol = *self.modules.symbols().get(i)?;
            if symbol == brackets.open {
                i = self.partner(i)? + 1;
            } else if symbol == brackets.close {
                return Some(i);
            } else if rest {
                i += 1;
            } else {
                return None;
            }
        }
    }
}
