//! The string of an L-system: modules with parameters, stored as a structure of arrays.

use crate::symbols::SymbolId;

/// One module of a string.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Module<'a> {
    /// Its symbol, an index into the grammar's symbols.
    pub symbol: SymbolId,
    /// Actual parameters, stored in single precision.
    pub params: &'a [f32],
    /// Hash of the module's ancestry; equal in every derivation that produces it in the same way.
    pub lineage: u64,
    /// Step in which it was made; 0 = the axiom.
    pub birth: u32,
}

/// A bracketed string of modules in the order of the grammar's text.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ModuleString {
    symbols: Vec<SymbolId>,
    /// Per module: end of its parameters.
    ends: Vec<u32>,
    params: Vec<f32>,
    lineage: Vec<u64>,
    birth: Vec<u32>,
}

impl ModuleString {
    /// Number of modules, brackets included.
    pub fn len(&self) -> usize {
        self.symbols.len()
    }

    /// True without modules.
    pub fn is_empty(&self) -> bool {
        self.symbols.is_empty()
    }

    /// Symbols of all modules.
    pub fn symbols(&self) -> &[SymbolId] {
        &self.symbols
    }

    /// Number of parameters of all modules together.
    pub fn param_count(&self) -> usize {
        self.params.len()
    }

    #[inline]
    fn param_range(&self, i: usize) -> std::ops::Range<usize> {
        let start = i.checked_sub(1).map_or(0, |k| self.ends[k] as usize);
        start..self.ends[i] as usize
    }

    /// Module `i`, which must exist.
    #[inline]
    pub fn get(&self, i: usize) -> Module<'_> {
        Module {
            symbol: self.symbols[i],
            params: &self.params[self.param_range(i)],
            lineage: self.lineage[i],
            birth: self.birth[i],
        }
    }

    /// All modules in order.
    pub fn iter(&self) -> impl Iterator<Item = Module<'_>> {
        (0..self.len()).map(|i| self.get(i))
    }

    /// Appends a parameter of the module that [`ModuleString::finish_module`] will end.
    #[inline]
    pub(crate) fn push_param(&mut self, value: f32) {
        self.params.push(value);
    }

    /// Ends a module whose parameters were appended.
    #[inline]
    pub(crate) fn finish_module(&mut self, symbol: SymbolId, lineage: u64, birth: u32) {
        self.symbols.push(symbol);
        // Always fits: derivation stops at 2^27 parameters.
        self.ends.push(u32::try_from(self.params.len()).unwrap_or(u32::MAX));
        self.lineage.push(lineage);
        self.birth.push(birth);
    }

    /// Replaces the first parameters of module `i`, which must exist; values that it has no parameter for are left out.
    pub(crate) fn set_params(&mut self, i: usize, values: &[f64]) {
        let range = self.param_range(i);
        for (param, value) in self.params[range].iter_mut().zip(values) {
            // Adding 0 turns -0 into 0.
            *param = osier_base::math::narrow(*value + 0.0);
        }
    }

    /// Appends a copy of a module.
    #[inline]
    pub(crate) fn push(&mut self, m: Module<'_>) {
        self.params.extend_from_slice(m.params);
        self.finish_module(m.symbol, m.lineage, m.birth);
    }

    /// Appends modules `range` of another string.
    pub(crate) fn extend(&mut self, other: &Self, range: std::ops::Range<usize>) {
        if range.is_empty() {
            return;
        }
        let params = other.param_range(range.start).start..other.param_range(range.end - 1).end;
        // The copied ends count from `first` in the other string and from `base` here.
        let base = self.ends.last().copied().unwrap_or(0);
        let first = range.start.checked_sub(1).map_or(0, |k| other.ends[k]);
        self.params.extend_from_slice(&other.params[params]);
        self.ends.extend(other.ends[range.clone()].iter().map(|e| (e - first).saturating_add(base)));
        self.symbols.extend_from_slice(&other.symbols[range.clone()]);
        self.lineage.extend_from_slice(&other.lineage[range.clone()]);
        self.birth.extend_from_slice(&other.birth[range]);
    }

    /// Consecutive substrings of `n` modules; the last one may be shorter.
    pub(crate) fn chunks(&self, n: usize) -> Vec<Self> {
        let chunk = |start: usize| {
            let mut chunk = Self::default();
            chunk.extend(self, start..(start + n).min(self.len()));
            chunk
        };
        (0..self.len()).step_by(n.max(1)).map(chunk).collect()
    }

    /// Removes all modules and keeps the memory.
    pub(crate) fn clear(&mut self) {
        self.symbols.clear();
        self.ends.clear();
        self.params.clear();
        self.lineage.clear();
        self.birth.clear();
    }

    /// Keeps the first `n` modules.
    pub(crate) fn truncate(&mut self, n: usize) {
        if n >= self.len() {
            return;
        }
        let params = n.checked_sub(1).map_or(0, |k| self.ends[k] as usize);
        self.params.truncate(params);
        self.symbols.truncate(n);
        self.ends.truncate(n);
        self.lineage.truncate(n);
        self.birth.truncate(n);
    }
}
