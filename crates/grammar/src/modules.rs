//! The string of an L-system: modules with parameters, stored as a structure of arrays.

use crate::symbols::SymbolId;
use osier_base::convert::saturating_index;
use osier_base::rng::ChildId;

/// One module of a string; its parameters are borrowed from the string.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Module<'a> {
    /// Its symbol, an index into the grammar's symbols.
    pub symbol: SymbolId,
    /// Actual parameters, stored in single precision.
    pub params: &'a [f32],
    /// Step in which it was made; 0 = the axiom.
    pub birth: u32,
    pub(crate) ancestry: Ancestry,
}

impl<'a> Module<'a> {
    /// A module of a known lineage, made in step `birth`.
    pub fn new(symbol: SymbolId, params: &'a [f32], lineage: u64, birth: u32) -> Self {
        Self { symbol, params, birth, ancestry: Ancestry::Known(lineage) }
    }

    /// Hash of the module's ancestry: the same in every derivation that produces the module by the same productions.
    #[inline]
    pub fn lineage(&self) -> u64 {
        match self.ancestry {
            Ancestry::Known(lineage) => lineage,
            Ancestry::Child { parent, ids } => ids.lineage(parent),
        }
    }
}

/// What the lineage of a module is computed from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Ancestry {
    Known(u64),
    /// Made from the module of lineage `parent`.
    Child {
        parent: u64,
        ids: LineageIds,
    },
}

/// Symbol and occurrence of a module in its successor, hashed in advance to compute its lineage.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct LineageIds {
    symbol: ChildId,
    occurrence: ChildId,
}

impl LineageIds {
    /// The ids of a symbol with the Unicode scalar value `code`.
    pub fn new(code: u64, occurrence: u32) -> Self {
        Self { symbol: ChildId::new(code), occurrence: ChildId::new(u64::from(occurrence)) }
    }

    /// Lineage of the module if it is made from the module of lineage `h`. It does not depend on the position in the string.
    #[inline]
    pub fn lineage(self, h: u64) -> u64 {
        self.occurrence.of(self.symbol.of(h))
    }
}

/// Consecutive modules of a string, borrowed: their symbols, and the end of each module's parameters.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ModuleBlock<'a> {
    pub symbols: &'a [SymbolId],
    /// Per module: end index of its parameters, relative to the first parameter of the block.
    pub ends: &'a [u32],
    /// Index in the string of the block's first parameter, modulo 2^32, as it wraps when the block leaves out earlier modules.
    pub first_param: u32,
}

/// A bracketed string of modules in the order of the grammar's text.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ModuleString {
    symbols: Vec<SymbolId>,
    /// Per module: end index of its parameters; empty while no module has any.
    ends: Vec<u32>,
    params: Vec<f32>,
    /// Per module: lineage, and step of birth; both empty if ancestries are not stored.
    lineage: Vec<u64>,
    birth: Vec<u32>,
    has_no_ancestry: bool,
}

impl ModuleString {
    /// Empty string for views that need no modules.
    pub(crate) const EMPTY: Self = Self {
        symbols: Vec::new(),
        ends: Vec::new(),
        params: Vec::new(),
        lineage: Vec::new(),
        birth: Vec::new(),
        has_no_ancestry: false,
    };

    /// An empty string that stores neither lineage nor birth; both then read as 0.
    pub(crate) fn without_ancestry() -> Self {
        Self { has_no_ancestry: true, ..Self::default() }
    }

    /// An empty string that stores ancestries if this one does.
    pub(crate) fn empty(&self) -> Self {
        Self { has_no_ancestry: self.has_no_ancestry, ..Self::default() }
    }

    /// Number of modules, brackets included.
    pub fn len(&self) -> usize {
        self.symbols.len()
    }

    /// True if the string has no modules, as after a derivation that stored none.
    pub fn is_empty(&self) -> bool {
        self.symbols.is_empty()
    }

    /// One symbol per module, in the order of the string, brackets included.
    pub fn symbols(&self) -> &[SymbolId] {
        &self.symbols
    }

    /// Memory of the modules, bytes.
    pub(crate) fn bytes(&self) -> usize {
        let four = self.ends.len() + self.params.len() + self.birth.len();
        2 * self.symbols.len() + 4 * four + 8 * self.lineage.len()
    }

    /// Total number of parameters of all modules.
    pub fn param_count(&self) -> usize {
        self.params.len()
    }

    #[inline]
    fn param_range(&self, i: usize) -> std::ops::Range<usize> {
        if self.ends.is_empty() {
            return 0..0;
        }
        let start = i.checked_sub(1).map_or(0, |k| self.ends[k] as usize);
        start..self.ends[i] as usize
    }

    /// Prepares `ends` for new modules whose parameters are already appended; false if no module has parameters yet.
    #[inline]
    fn prepare_ends(&mut self) -> bool {
        if self.params.is_empty() && self.ends.is_empty() {
            return false;
        }
        // Modules before the first parameter end where they begin, at 0.
        if self.ends.is_empty() {
            self.ends.resize(self.symbols.len(), 0);
        }
        true
    }

    /// Module `i`, which must exist.
    #[inline]
    pub fn get(&self, i: usize) -> Module<'_> {
        Module {
            symbol: self.symbols[i],
            params: &self.params[self.param_range(i)],
            birth: self.birth.get(i).copied().unwrap_or(0),
            ancestry: Ancestry::Known(self.lineage.get(i).copied().unwrap_or(0)),
        }
    }

    /// The modules in the order of the string, brackets included.
    pub fn iter(&self) -> impl Iterator<Item = Module<'_>> {
        (0..self.len()).map(|i| self.get(i))
    }

    /// Appends a parameter of the module that the next [`ModuleString::finish_module`] completes.
    #[inline]
    pub(crate) fn push_param(&mut self, value: f32) {
        self.params.push(value);
    }

    /// Appends a module whose parameters were appended before.
    #[inline]
    pub(crate) fn finish_module(&mut self, symbol: SymbolId, lineage: u64, birth: u32) {
        if self.prepare_ends() {
            // Always fits: derivation stops at 2^27 parameters.
            self.ends.push(saturating_index(self.params.len()));
        }
        self.symbols.push(symbol);
        if !self.has_no_ancestry {
            self.lineage.push(lineage);
            self.birth.push(birth);
        }
    }

    /// The parameters of all modules; append those of the modules that [`ModuleString::append_modules`] will complete.
    #[inline]
    pub(crate) fn params_mut(&mut self) -> &mut Vec<f32> {
        &mut self.params
    }

    /// Appends modules whose parameters, from index `block.first_param` on, were appended before. `lineages`: one for each module.
    #[inline]
    pub(crate) fn append_modules(&mut self, block: ModuleBlock<'_>, lineages: impl Iterator<Item = u64>, birth: u32) {
        if self.prepare_ends() {
            self.ends.extend(block.ends.iter().map(|e| e.wrapping_add(block.first_param)));
        }
        self.symbols.extend_from_slice(block.symbols);
        if !self.has_no_ancestry {
            self.lineage.extend(lineages);
            self.birth.resize(self.symbols.len(), birth);
        }
    }

    /// Replaces the first parameters of module `i`, which must exist; excess values are ignored.
    pub(crate) fn set_params(&mut self, i: usize, values: &[f64]) {
        let range = self.param_range(i);
        for (param, value) in self.params[range].iter_mut().zip(values) {
            // Adding 0 turns -0 into 0.
            *param = osier_base::math::narrow(*value + 0.0);
        }
    }

    /// Appends a copy of a module, with its lineage and birth.
    #[inline]
    pub fn push(&mut self, m: Module<'_>) {
        self.params.extend_from_slice(m.params);
        self.finish_module(m.symbol, m.lineage(), m.birth);
    }

    /// Appends modules `range` of `other`, which must store ancestries if this string does.
    pub fn extend(&mut self, other: &Self, range: std::ops::Range<usize>) {
        if range.is_empty() {
            return;
        }
        let params = other.param_range(range.start).start..other.param_range(range.end - 1).end;
        // The copied ends count from `first` in the other string and from `base` here.
        let base = self.ends.last().copied().unwrap_or(0);
        self.params.extend_from_slice(&other.params[params]);
        if self.prepare_ends() {
            if other.ends.is_empty() {
                self.ends.resize(self.ends.len() + range.len(), base);
            } else {
                let first = range.start.checked_sub(1).map_or(0, |k| other.ends[k]);
                self.ends.extend(other.ends[range.clone()].iter().map(|e| (e - first).saturating_add(base)));
            }
        }
        self.symbols.extend_from_slice(&other.symbols[range.clone()]);
        if !self.has_no_ancestry {
            self.lineage.extend_from_slice(&other.lineage[range.clone()]);
            self.birth.extend_from_slice(&other.birth[range]);
        }
    }

    /// Removes all modules, but keeps the allocated memory.
    pub(crate) fn clear(&mut self) {
        self.symbols.clear();
        self.ends.clear();
        self.params.clear();
        self.lineage.clear();
        self.birth.clear();
    }

    pub(crate) fn truncate(&mut self, n: usize) {
        if n >= self.len() {
            return;
        }
        let params = n.checked_sub(1).and_then(|k| self.ends.get(k)).map_or(0, |end| *end as usize);
        self.params.truncate(params);
        self.symbols.truncate(n);
        self.ends.truncate(n);
        self.lineage.truncate(n);
        self.birth.truncate(n);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn string(modules: &[&[f32]]) -> ModuleString {
        let mut out = ModuleString::default();
        for (symbol, params) in (0..).zip(modules) {
            params.iter().for_each(|p| out.push_param(*p));
            out.finish_module(symbol, 0, 0);
        }
        out
    }

    fn params(s: &ModuleString) -> Vec<Vec<f32>> {
        s.iter().map(|m| m.params.to_vec()).collect()
    }

    #[test]
    fn parameters_stay_with_their_modules() {
        let (plain, mixed) = (string(&[&[], &[]]), string(&[&[], &[1.0, 2.0], &[], &[3.0]]));
        let mut s = plain.clone();
        s.extend(&mixed, 1..4);
        s.extend(&plain, 0..1);
        assert_eq!(params(&s), [vec![], vec![], vec![1.0, 2.0], vec![], vec![3.0], vec![]]);
        // Cutting off all parameters leaves a string that takes new ones.
        s.truncate(2);
        s.extend(&plain, 0..2);
        s.extend(&mixed, 3..4);
        assert_eq!(params(&s), [vec![], vec![], vec![], vec![], vec![3.0]]);
        // A block whose first module was left out.
        let (symbols, ends) = ([7, 8], [3, 3]);
        let first_param = u32::try_from(s.param_count()).expect("small").wrapping_sub(2);
        s.params_mut().push(9.0);
        s.append_modules(ModuleBlock { symbols: &symbols, ends: &ends, first_param }, [0, 0].into_iter(), 1);
        assert_eq!(params(&s)[5..], [vec![9.0], vec![]]);
    }
}
