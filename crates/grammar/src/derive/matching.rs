//! Matches contexts: the modules to the left and right of a module in a bracketed string.

use crate::modules::{Module, ModuleString};
use crate::program::{Borders, ContextElement, FormalModule};
use crate::symbols::SymbolId;

/// Value for "no matching bracket" in a table of indices.
const NO_PARTNER: u32 = u32::MAX;

/// Everything that context matching reads: a module string with its bracket partners, ignored symbols and borders.
#[derive(Debug, Clone, Copy)]
pub(super) struct ContextView<'a> {
    pub modules: &'a ModuleString,
    /// Partner of each bracket; empty if no production has contexts.
    pub partner: &'a [u32],
    /// Per symbol: true if contexts ignore it.
    pub ignored: &'a [bool],
    /// True if the ends of the string are joined.
    pub is_ring: bool,
    /// True if `modules` and `partner` hold the string in reverse order; positions count from its beginning.
    pub is_reversed: bool,
    /// Border symbols of sub-L-systems, at which context matching ends.
    pub borders: Option<Borders>,
}

/// Symbol numbers of `[` and `]`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Brackets {
    pub open: SymbolId,
    pub close: SymbolId,
}

/// The part of the new string that a step has made so far, with the partners of its brackets.
#[derive(Debug, Default)]
pub(super) struct MadeString {
    modules: ModuleString,
    partner: Vec<u32>,
    open: Vec<u32>,
}

impl MadeString {
    /// Takes over the string until it is given back, and matches the brackets that were added since the last call.
    pub fn lend(&mut self, modules: &mut ModuleString, brackets: Brackets) {
        std::mem::swap(&mut self.modules, modules);
        // A shorter string belongs to another step.
        if self.modules.len() < self.partner.len() {
            self.partner.clear();
            self.open.clear();
        }
        for (i, &s) in (0_u32..).zip(self.modules.symbols()).skip(self.partner.len()) {
            self.partner.push(NO_PARTNER);
            if s == brackets.open {
                self.open.push(i);
            } else if s == brackets.close
                && let Some(o) = self.open.pop()
            {
                self.partner[o as usize] = i;
                self.partner[i as usize] = o;
            }
        }
    }

    pub fn give_back(&mut self, modules: &mut ModuleString) {
        std::mem::swap(&mut self.modules, modules);
    }

    /// True if the new string so far ends with this left context.
    pub fn ends_with(
        &self,
        view: &ContextView<'_>,
        brackets: Brackets,
        context: &[ContextElement],
        locals: &mut [f64],
    ) -> bool {
        let made = self.seen_from(view);
        made.matches_left(brackets, context, self.modules.len(), locals)
    }

    /// True if the new string so far, made in reverse, begins with this right context.
    pub fn begins_with(
        &self,
        view: &ContextView<'_>,
        brackets: Brackets,
        context: &[ContextElement],
        locals: &mut [f64],
    ) -> bool {
        let made = ContextView { is_reversed: true, ..self.seen_from(view) };
        made.matches_right(brackets, context, 0, locals)
    }

    /// The new string as a view with the ignored symbols and borders of `view`. Its ends are not joined.
    fn seen_from<'a>(&'a self, view: &ContextView<'a>) -> ContextView<'a> {
        ContextView { modules: &self.modules, partner: &self.partner, is_ring: false, ..*view }
    }
}

/// Partner of every bracket; `NO_PARTNER` for other symbols and for unmatched brackets.
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

/// True if the module has the symbol and number of parameters of `formal`; its parameters are then bound to local variables.
#[inline]
pub(super) fn match_module(formal: &FormalModule, module: Module<'_>, locals: &mut [f64]) -> bool {
    let fits = module.symbol == formal.symbol && module.params.len() == usize::from(formal.arity);
    if fits {
        bind_parameters(formal, module, locals);
    }
    fits
}

impl<'a> ContextView<'a> {
    /// The view of an L-system. `hidden`: per L-system, the symbols that its contexts skip.
    pub fn of_system(self, hidden: &'a [Vec<bool>], system: u16) -> Self {
        let ignored = hidden.get(usize::from(system)).map_or(self.ignored, Vec::as_slice);
        Self { ignored, ..self }
    }
}

impl ContextView<'_> {
    /// A view of no string, for productions without contexts.
    pub const NONE: ContextView<'static> = ContextView {
        modules: &ModuleString::EMPTY,
        partner: &[],
        ignored: &[],
        is_ring: false,
        is_reversed: false,
        borders: None,
    };

    /// Upper limit of positions: the length of the string; in a ring, once around back to `from`.
    fn end(&self, from: usize) -> usize {
        if self.is_ring { from + self.modules.len() } else { self.modules.len() }
    }

    /// Index of a position; in a ring positions continue after the end of the string.
    #[inline]
    fn index(&self, position: usize) -> usize {
        if self.is_reversed {
            return self.modules.len().wrapping_sub(1).wrapping_sub(position);
        }
        if position < self.modules.len() { position } else { position - self.modules.len() }
    }

    #[inline]
    fn symbol(&self, position: usize) -> Option<SymbolId> {
        self.modules.symbols().get(self.index(position)).copied()
    }

    /// Position of the partner of the bracket at `position`; `None` if it has none.
    fn partner(&self, position: usize) -> Option<usize> {
        let i = self.index(position);
        let partner = self.partner.get(i).filter(|p| **p != NO_PARTNER)?;
        if self.is_reversed {
            return Some(self.index(*partner as usize));
        }
        Some(*partner as usize + (position - i))
    }

    fn is_ignored(&self, symbol: SymbolId) -> bool {
        self.ignored.get(usize::from(symbol)).copied().unwrap_or(false)
    }

    /// True if the module at a position begins or ends a sub-L-system. A query such as `?P(x,y,z)` begins with the same
    /// symbol, but its `?` has no parameter.
    fn is_border(&self, position: usize) -> bool {
        let module = self.modules.get(self.index(position));
        let opens = |b: &Borders| module.symbol == b.open && !module.params.is_empty();
        self.borders.is_some_and(|b| opens(&b) || module.symbol == b.close)
    }

    /// True if the left context precedes module `at`. The search skips closed branches; from within a branch it continues on
    /// the axis that carries the branch.
    pub fn matches_left(&self, brackets: Brackets, context: &[ContextElement], at: usize, locals: &mut [f64]) -> bool {
        // In a ring positions start in a second turn and count down, so that they stay positive until module `at` is reached
        // again.
        let (mut i, least) = if self.is_ring { (at + self.modules.len(), at) } else { (at, 0) };
        // The context is matched from its last module, the neighbour, outwards.
        let mut wanted = context.iter().rev();
        let mut next = wanted.next();
        while let Some(element) = next {
            let ContextElement::Module(formal) = element else { return false };
            let Some(k) = i.checked_sub(1).filter(|k| *k >= least) else { return false };
            i = k;
            let Some(symbol) = self.symbol(i) else { return false };
            // A closed branch is lateral: jump to its opening bracket. An unmatched bracket ends the search.
            if symbol == brackets.close {
                match self.partner(i) {
                    Some(open) => i = open,
                    None => return false,
                }
            } else if self.is_border(i) {
                return false;
            } else if symbol != brackets.open && !self.is_ignored(symbol) {
                if !match_module(formal, self.modules.get(self.index(i)), locals) {
                    return false;
                }
                next = wanted.next();
            }
        }
        true
    }

    /// True if the right context follows, beginning with module `at`.
    pub fn matches_right(&self, brackets: Brackets, context: &[ContextElement], at: usize, locals: &mut [f64]) -> bool {
        let mut i = at;
        let end = self.end(at);
        for element in context {
            // Each element continues after the module that matched the element before it.
            let found = match element {
                ContextElement::Module(formal) => self.next_on_axis(brackets, formal, i, end, locals),
                ContextElement::Open => self.skip_ignored(i, end).filter(|k| self.symbol(*k) == Some(brackets.open)),
                ContextElement::Close => self.end_of_branch(brackets, i, end, false),
                ContextElement::CloseRest => self.end_of_branch(brackets, i, end, true),
            };
            match found {
                Some(k) => i = k + 1,
                None => return false,
            }
        }
        true
    }

    /// The next module that is not ignored, before position `end`.
    fn skip_ignored(&self, from: usize, end: usize) -> Option<usize> {
        (from..end).find(|&i| self.symbol(i).is_some_and(|s| !self.is_ignored(s)))
    }

    /// Position of the next module on this axis, if it matches `formal`; branches in between are skipped.
    fn next_on_axis(
        &self,
        brackets: Brackets,
        formal: &FormalModule,
        from: usize,
        end: usize,
        locals: &mut [f64],
    ) -> Option<usize> {
        let mut i = from;
        loop {
            i = self.skip_ignored(i, end)?;
            let symbol = self.symbol(i)?;
            if symbol == brackets.open {
                i = self.partner(i)? + 1;
            } else if symbol == brackets.close || self.is_border(i) {
                // The axis ends before the module is found.
                return None;
            } else {
                return match_module(formal, self.modules.get(self.index(i)), locals).then_some(i);
            }
        }
    }

    /// Position of the bracket that closes the branch. Before it only further branches may follow, or any modules if `rest`
    /// is true.
    fn end_of_branch(&self, brackets: Brackets, from: usize, end: usize, rest: bool) -> Option<usize> {
        let mut i = from;
        loop {
            i = if rest { i } else { self.skip_ignored(i, end)? };
            if i >= end {
                return None;
            }
            // Skip each further branch as a whole.
            let symbol = self.symbol(i)?;
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
